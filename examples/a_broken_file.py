"""Damage a mesh, and compare its repair, its warnings and its frequencies with the original."""

import warnings
from pathlib import Path

import numpy as np

import struck
from struck import Mesh
from struck.errors import RepairWarning
from struck.report.gallery import bird, written

original = bird()
random = np.random.default_rng(1)
head = original.points[original.points[:, 2].argmax()]
far = np.linalg.norm(original.centroids - head, axis=1) > 0.008
faces = original.faces[far]  # a hole in the head
over = random.random(len(faces)) < 0.1
faces = np.where(over[:, None], faces[:, ::-1], faces)  # every tenth face flipped
written(original, Path("bird.obj"))
written(Mesh(points=original.points, faces=faces), Path("broken.obj"))

with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always", RepairWarning)
    model = struck.analyze("broken.obj", "ceramic", size=0.15, up="z", accuracy="preview")
for warning in caught:
    print(warning.message)

details = model.provenance.details
print(f"volume {1e6 * details['volume_before']:.1f} cm3 as given, ", end="")
print(f"{1e6 * details['volume_after']:.1f} cm3 repaired")

clean = struck.analyze("bird.obj", "ceramic", size=0.15, up="z", accuracy="preview")
for mine, its, error in zip(model.frequencies, clean.frequencies, model.errors, strict=True):
    print(f"{mine:8.1f} Hz, within {100 * error:.2g} %; unbroken {its:8.1f} Hz")
assert np.allclose(model.frequencies, clean.frequencies, rtol=0.01)
