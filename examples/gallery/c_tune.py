"""
Tune a body
===========

`struck.tune` finds the dimension at which the lowest mode of a body has a given frequency.
"""

import struck
from struck import Strike
from struck.solids import Tube

blank = Tube(length=0.5, radius=0.0125, wall=0.001)
for note in ("C5", "E5", "G5"):
    tube = struck.tune(blank, "aluminium", vary="length", lowest=note, accuracy="preview")
    print(f"{note}: {1000 * tube.length:.1f} mm")

# %%
# The last tube.
model = struck.analyze(tube, "aluminium", accuracy="preview", band=(20, 8000))
struck.show(model)

# %%
struck.render(model, Strike(at="end", striker="wood", speed=1.0), seconds=1.0)
