"""
See a body move
===============

`struck.show` draws modes, and the motion of the surface after a strike.
"""

import struck
from struck import Strike
from struck.shapes import RectangularMembrane

shape = RectangularMembrane(length=0.3, width=0.3, thickness=2.5e-4, tension=3000.0)
drum = struck.analyze(shape, "nylon", band=(20, 2000))
struck.show(drum, modes=9)

# %%
# A strike off the centre: the wave spreads, and is reflected by the edges.
strike = Strike(at=(0.1, 0.1), striker="wood", speed=1.0)
struck.show(drum, strike=strike)

# %%
struck.render(drum, strike, seconds=1.0)
