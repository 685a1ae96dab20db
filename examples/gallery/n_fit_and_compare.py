"""
Fit a recording
===============

Fit a model to a recording, and compare it with a computed model: `struck.fit` and `struck.compare`.
"""

import numpy as np

import struck
from struck import Strike
from struck.report.charts import spectrogram
from struck.shapes import Bar

bar = struck.analyze(Bar(length=0.25, width=0.03, thickness=0.006, ends="free"), "aluminium")
strike = Strike(at="end", striker="wood", speed=0.5)

# %%
# The recording: a computed bar with a little noise, and a lead-in of half a second.
hit = struck.render(bar, strike, seconds=1.0)
samples = np.concatenate([np.zeros(24_000), 0.5 * hit.samples[0] / hit.peak])
samples += 1e-4 * np.random.default_rng(0).standard_normal(len(samples))
recording = struck.Sound(samples=np.float32(samples), sample_rate=48_000)
recording.save("tap.wav")
spectrogram(recording)

# %%
recording

# %%
# A strike on the fitted model.
model = struck.fit("tap.wav", modes=None)
print(*(f"{frequency:.2f} Hz" for frequency in model.frequencies))
struck.render(model, Strike(), seconds=1.0)

# %%
# Comparison with the computed model.
print(*struck.compare(bar, "tap.wav", strike=strike).summary(), sep="\n")
