"""Walk around a ringing bowl, and move an ear into it, with its computed timbre field."""

import numpy as np

import struck
from struck import InternalFriction, Mono, Strike
from struck.solids import Revolution

angles = np.linspace(0, np.pi / 2, 7)
profile = [(0.06 * np.sin(angle), 0.06 - 0.06 * np.cos(angle)) for angle in angles]
bowl = struck.analyze(
    Revolution(profile=profile, wall=0.003), "bronze", accuracy="preview", band=(20, 6000)
)
bowl = bowl.damped(InternalFriction(loss_tangent=2e-4)).radiating(band=(20, 6000), near=True)
print(f"{len(bowl.frequencies)} modes, degrees {bowl.gains.field.degrees}")
struck.save(bowl, "bowl.struck")
struck.show(bowl, "balloon.png", field=2)
struck.show(bowl, "brightness.png", field="brightness")

# Once around the bowl, 30 cm from its axis; then from 30 cm above its rim down into it, 3 cm from
# the axis, on which nearly all modes cancel.
angles = np.linspace(0, 2 * np.pi, 97)
walk = np.stack([0.3 * np.cos(angles), 0.3 * np.sin(angles), np.full(97, 0.1)], axis=1)
paths = {
    "round it": (np.linspace(0, 3, 97), walk),
    "into it": ([0.0, 3.0], [(0.03, 0.0, 0.36), (0.03, 0.0, 0.035)]),
}
strikes = [Strike(at=(0.06, 0, 0.06), striker="wood", speed=1.0, time=0.5 * n) for n in range(6)]
for name, path in paths.items():
    sound = struck.render(bowl, strikes, listener=Mono(position=path), seconds=3)
    sound.save(f"bowl_{name.replace(' ', '_')}.wav")
    levels = 20 * np.log10(np.abs(sound.samples).reshape(6, -1).max(axis=1))
    print(f"{name:9}" + " ".join(f"{level:6.1f}" for level in levels) + " dB")
