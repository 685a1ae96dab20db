"""
Estimate the material
=====================

Estimate E over density, Poisson's ratio and damping from a recording and the shape:
`struck.recordings.calibrated`, and `struck calibrate` in the shell.
"""

import numpy as np

import struck
from struck import Strike
from struck.recordings import calibrated, corrected
from struck.solids import Block

shape = Block(size=(0.20, 0.03, 0.006))
brass_block = struck.analyze(shape, "brass", accuracy="preview")  # replaces a real object
hit = struck.render(brass_block, Strike(at="end", striker="wood", speed=0.5), seconds=1.0)
samples = np.concatenate([np.zeros(24_000), 0.5 * hit.samples[0] / hit.peak])
samples += 1e-4 * np.random.default_rng(0).standard_normal(len(samples))
struck.Sound(samples=np.float32(samples), sample_rate=48_000).save("tap.wav")

model = struck.fit("tap.wav", modes=None)
guess = struck.analyze(shape, "bronze", accuracy="preview")  # a wrong material
estimate = calibrated(model, guess)
error = estimate.standard_errors[0]
print(f"E / density {estimate.specific_stiffness:.4g} m2/s2, standard error {error:.2g}")
brass = struck.Material.named("brass")
print(f"of brass {brass.youngs_modulus / brass.density:.4g} m2/s2")

# %%
struck.show(guess)

# %%
# The computed mode shapes with the recorded frequencies and decay rates.
struck.render(corrected(guess, model), Strike(at="end", striker="wood"), seconds=1.0)
