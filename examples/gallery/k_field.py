"""
Sound around a body
===================

Compute a timbre field: the gains at every listener position. `ModalModel.radiating`.
"""

import numpy as np

import struck
from struck import Mono, Strike
from struck.solids import Block

shape = Block(size=(0.20, 0.05, 0.012))
block = struck.analyze(shape, "oak", accuracy="preview", band=(20, 6000))
field = block.radiating(band=(20, 6000))
struck.show(field, field=0)

# %%
# Brightness of a strike on three planes around the body.
struck.show(field, field="brightness")

# %%
# Eight strikes, while the listener walks around the body.
angles = np.linspace(0, 2 * np.pi, 97)
walk = np.stack([0.5 * np.cos(angles), 0.5 * np.sin(angles), 0 * angles + 0.1], axis=1)
taps = [Strike(at="end", striker="wood", speed=1.0, time=0.25 * n) for n in range(8)]
listener = Mono(position=(np.linspace(0, 2, 97), walk))
struck.render(field, taps, seconds=2.0, listener=listener)
