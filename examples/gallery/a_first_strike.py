"""
Analyze and strike
==================

Compute a model from a shape and a material, and render a sound with it: `struck.analyze`,
`struck.render`, `Strike` and `struck.energy`.
"""

import struck
from struck import Strike
from struck.solids import Tube

tube = Tube(length=0.505, radius=0.0125, wall=0.001)  # m
chime = struck.analyze(tube, "aluminium", accuracy="preview", band=(20, 8000))
struck.show(chime)

# %%
# Strike the end with wood. Give a striker and its speed, an energy, or an impulse.
struck.render(chime, Strike(at="end", striker="wood", speed=1.0), seconds=1.5)

# %%
# The energy of the strike in joules: what the striker brings, what enters the modes, and what the
# material and the air take.
print(struck.energy(chime, Strike(at="end", striker="wood", speed=1.0)))

# %%
# A strike at the middle excites other modes, and felt excites fewer high modes.
struck.render(chime, Strike(at="middle", striker="felt", speed=1.0), seconds=1.5)

# %%
# Save the model to one file, and load it.
struck.save(chime, "chime.struck")
again = struck.load("chime.struck")
print(again.frequencies[:4], "Hz, T60", again.t60[:4], "s")
