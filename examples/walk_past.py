"""Walk past a ringing bar, and turn around next to it, with the ears of a dummy head."""

import numpy as np

import struck
from struck import Binaural, InternalFriction, Strike
from struck.solids import Block

bar = struck.analyze(Block(size=(0.30, 0.03, 0.005)), "steel", accuracy="preview")
bar = bar.damped(InternalFriction(loss_tangent=2e-4))
strikes = [Strike(at="end", striker="wood", speed=1.0, time=0.5 * number) for number in range(6)]

walking = Binaural(position=([0, 3], [(-6, 1, 0), (6, 1, 0)]), facing=(1, 0, 0))
turning = Binaural(
    position=(0, 1, 0), facing=lambda t: (np.cos(2 * np.pi * t / 3), np.sin(2 * np.pi * t / 3), 0)
)
for name, listener in {"walking": walking, "turning": turning}.items():
    sound = struck.render(bar, strikes, listener=listener, seconds=3)
    sound.save(f"bar_{name}.wav")
    levels = 20 * np.log10(np.abs(sound.samples).reshape(2, 6, -1).max(axis=2))
    for ear, row in zip(("left", "right"), levels, strict=True):
        print(f"{name:8} {ear:5} " + " ".join(f"{level:6.1f}" for level in row) + " dB")
