"""
Any force
=========

Apply a measured, computed or drawn force: `ForceTrack`.
"""

import numpy as np

import struck
from struck import ForceTrack
from struck.report.charts import spectrogram
from struck.solids import Block

block = struck.analyze(Block(size=(0.30, 0.05, 0.01)), "oak", accuracy="preview")
times = np.arange(48_000) / 48_000
taps = np.where((times % 0.2) < 5e-4, 10.0, 0.0) * times  # N: every 0.2 s, with increasing force
sound = struck.render(block, ForceTrack(at="end", force=taps, sample_rate=48_000), seconds=1.5)
spectrogram(sound)

# %%
sound

# %%
# The force of a simulation, 1000 values per second, spread over a pulse for the soft contact.
steps = np.zeros(1000)
steps[[50, 300, 450]] = 80.0, 40.0, 20.0
bumps = ForceTrack(at="end", force=steps, sample_rate=1000, kernel="gaussian", softness=2e-3)
struck.render(block, bumps, seconds=1.5)
