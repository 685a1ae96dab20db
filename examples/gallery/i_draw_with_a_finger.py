"""
Touch with a finger
===================

Log the positions and forces of a finger, as of a tablet: `TouchLog`.
"""

import numpy as np

import struck
from struck.excitation import Tool, TouchLog
from struck.report.charts import spectrogram
from struck.solids import Block

block = Block(size=(0.30, 0.20, 0.003))
plate = struck.analyze(block, "steel", accuracy="preview", band=(20, 8000))
times = np.arange(0, 2, 1 / 100)  # 100 updates per second
angles = 2 * np.pi * times
circle = np.column_stack([0.08 * np.cos(angles), 0.06 * np.sin(angles), 0 * times + 0.0015])
forces = 1.0 + np.sin(angles / 2) ** 2  # N
log = TouchLog(times=times, forces=forces, points=circle, tool=Tool(roughness="wood", radius=1e-3))
sound = struck.render(plate, log, seconds=2.2)
spectrogram(sound)

# %%
sound
