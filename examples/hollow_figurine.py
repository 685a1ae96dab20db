"""Analyze a closed mesh file as a hollow figurine, and strike it in three places."""

from pathlib import Path

import struck
from struck import Strike
from struck.report.gallery import bird, written

written(bird(), Path("bird.obj"))  # or any closed OBJ, STL, PLY, OFF, GLB or glTF file

model = struck.analyze(
    "bird.obj", "ceramic", size=0.15, wall=0.008, up="z", accuracy="preview", damping="heard"
)
print(f"{len(model.frequencies)} modes up to {model.complete_to:.0f} Hz, {model.mass:.3f} kg")
print(model.cite())

taps = [
    Strike(at=place, striker="wood", time=0.4 * i) for i, place in enumerate(("top", "-x", "+y"))
]
struck.render(model, taps, seconds=1.5).save("bird.wav")
struck.show(model, "bird.png")
assert Path("bird.png").exists()
