"""
Analyze and strike
==================

A shape and a material become a model, and the model a sound. `struck.analyze`, `struck.render` and
`Strike`.
"""

import struck
from struck import Strike
from struck.solids import Tube

tube = Tube(length=0.505, radius=0.0125, wall=0.001)  # m
chime = struck.analyze(tube, "aluminium", accuracy="preview", band=(20, 8000))
struck.show(chime)

# %%
# Struck at its end by wood. A strike is said by striker and speed, by an energy, or by an impulse.
struck.render(chime, Strike(at="end", striker="wood", speed=1.0), seconds=1.5)

# %%
# In its middle other modes sound, and felt wakes fewer of the high ones.
struck.render(chime, Strike(at="middle", striker="felt", speed=1.0), seconds=1.5)

# %%
# A model is kept in one file.
struck.save(chime, "chime.struck")
again = struck.load("chime.struck")
print(again.frequencies[:4], "Hz, T60", again.t60[:4], "s")
