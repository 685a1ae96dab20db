"""Fit a model to a recording, render it at another size, and compare it (2007)."""

import numpy as np

import struck
from struck.solids import Block

# A computed block of oak replaces the recording; use a recording of your own object instead.
oak = struck.analyze(Block(size=(0.2, 0.05, 0.02)), "oak", accuracy="preview")
struck_once = struck.render(oak, struck.Strike(at="end", striker="wood"), seconds=1.0)
samples = np.pad(struck_once.samples[0] / struck_once.peak, (24_000, 0))
noise = 3e-4 * np.random.default_rng(1).standard_normal(len(samples))
struck.Sound(samples=np.float32(0.5 * samples + noise), sample_rate=48_000).save("tap.wav")

model = struck.fit("tap.wav", modes=None, residual=True, report="tap.html")
print(f"{len(model.frequencies)} modes, the lowest at {model.frequencies[0]:.2f} Hz")
for line in model.provenance.dropped:
    print(f"  note: {line}")

struck.render(model, struck.Strike(), seconds=1.0).save("again.wav")
struck.render(model.scaled(2.0), struck.Strike(), seconds=1.0).save("twice_as_large.wav")

comparison = struck.compare(oak, "tap.wav", strike=struck.Strike(at="end", striker="wood"))
print("\n".join(comparison.summary()))
comparison.save_page("comparison.html")
