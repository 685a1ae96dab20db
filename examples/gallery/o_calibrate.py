"""
Infer the material
==================

From a recording and the shape: E over density, Poisson's ratio and damping of the material.
`struck.recordings.calibrated`, and `struck calibrate` in the shell.
"""

import numpy as np

import struck
from struck import Strike
from struck.recordings import calibrated, corrected
from struck.solids import Block

shape = Block(size=(0.20, 0.03, 0.006))
true = struck.analyze(shape, "brass", accuracy="preview")  # stands for the object on the desk
hit = struck.render(true, Strike(at="end", striker="wood", speed=0.5), seconds=1.0)
samples = np.concatenate([np.zeros(24_000), 0.5 * hit.samples[0] / hit.peak])
samples += 1e-4 * np.random.default_rng(0).standard_normal(len(samples))
struck.Sound(samples=np.float32(samples), sample_rate=48_000).save("tap.wav")

model = struck.fit("tap.wav", modes=None)
guess = struck.analyze(shape, "bronze", accuracy="preview")  # a wrong one
found = calibrated(model, guess)
error = found.standard_errors[0]
print(f"E / density {found.specific_stiffness:.4g} m2/s2, give or take {error:.2g}")
brass = struck.Material.named("brass")
print(f"of brass {brass.youngs_modulus / brass.density:.4g} m2/s2")

# %%
struck.show(guess)

# %%
# The computed shapes with the frequencies and decays that were recorded.
struck.render(corrected(guess, model), Strike(at="end", striker="wood"), seconds=1.0)
