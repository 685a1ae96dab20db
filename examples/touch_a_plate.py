"""Strike, scrape, roll on, pluck and hold one steel plate."""

from dataclasses import replace

import numpy as np

import struck
from struck import Hold, Pluck, Roll, Scrape, Strike
from struck.solids import Block

body = Block(size=(0.30, 0.20, 0.003))
plate = struck.analyze(body, "steel", accuracy="preview", damping="heard")
here, there = (-0.10, -0.06, 0.0015), (0.11, 0.05, 0.0015)

path = [here, there]
tip = Scrape(path=path, speed=0.15, load=2.0, roughness="wood", radius=0.5e-3)

touches = {
    "struck": Strike(at=here, striker="wood", speed=1.0),
    "sandpaper": replace(tip, roughness="sandpaper"),
    "wood": tip,
    "concrete": replace(tip, roughness="concrete"),
    "twice as fast": replace(tip, speed=0.30),
    "rolled on": Roll(path=path, radius=0.012, speed=0.15, mass=0.02),
    "plucked": Pluck(at=here, force=5.0),
    "held": [Strike(at=here, striker="wood", speed=1.0), Hold(at=there, grip=30.0, time=0.5)],
}
for name, touch in touches.items():
    sound = struck.render(plate, touch, seconds=1.5)
    sound.save(f"plate_{name.replace(' ', '_')}.wav")
    power = np.abs(np.fft.rfft(sound.samples[0])) ** 2
    centre = power @ np.fft.rfftfreq(sound.samples.shape[1], 1 / 48_000) / power.sum()
    print(f"{name:14} peak {np.abs(sound.samples).max():.3f} Pa, centre {centre:.0f} Hz")
