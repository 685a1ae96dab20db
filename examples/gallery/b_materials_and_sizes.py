"""
Other materials and sizes
=========================

One analysis is sufficient for other isotropic materials, sizes and dampings.
"""

import struck
from struck import InternalFriction, Strike
from struck.shapes import Bar

bar = struck.analyze(Bar(length=0.2, width=0.03, thickness=0.006, ends="free"), "steel")
struck.show(bar)

# %%
# The bar in steel.
strike = Strike(at="end", striker="wood", speed=0.5)
struck.render(bar, strike, seconds=1.0)

# %%
# The same bar in glass, and in oak.
struck.render(bar.made_of("glass"), strike, seconds=1.0)

# %%
struck.render(bar.made_of("oak"), strike, seconds=1.0)

# %%
# Twice as large, an octave lower; `tuned` finds the size for a note.
struck.render(bar.scaled(2.0), strike, seconds=1.0)

# %%
# A hand adds 20 1/s to the decay rate of every mode.
in_hand = bar.damped(InternalFriction(loss_tangent=3e-4, external=20.0))
print(f"T60 of the lowest mode: {bar.t60[0]:.1f} s free, {in_hand.t60[0]:.2f} s held")
struck.render(in_hand, strike, seconds=1.0)
