"""Break a mesh on purpose, and see what is repaired, what is said, and what it costs the pitch."""

import warnings
from pathlib import Path

import numpy as np

import struck
from struck import Mesh
from struck.errors import RepairWarning
from struck.report.gallery import bird, written

whole = bird()
random = np.random.default_rng(1)
head = whole.points[whole.points[:, 2].argmax()]
far = np.linalg.norm(whole.centroids - head, axis=1) > 0.008
faces = whole.faces[far]  # a hole in the head
over = random.random(len(faces)) < 0.1
faces = np.where(over[:, None], faces[:, ::-1], faces)  # every tenth face the wrong way round
written(whole, Path("bird.obj"))
written(Mesh(points=whole.points, faces=faces), Path("broken.obj"))

with warnings.catch_warnings(record=True) as told:
    warnings.simplefilter("always", RepairWarning)
    model = struck.analyze("broken.obj", "ceramic", size=0.15, up="z", accuracy="preview")
for warning in told:
    print(warning.message)

details = model.provenance.details
print(f"volume {1e6 * details['volume_before']:.1f} cm3 as given, ", end="")
print(f"{1e6 * details['volume_after']:.1f} cm3 repaired")

clean = struck.analyze("bird.obj", "ceramic", size=0.15, up="z", accuracy="preview")
for mine, its, error in zip(model.frequencies, clean.frequencies, model.errors, strict=True):
    print(f"{mine:8.1f} Hz, within {100 * error:.2g} %; unbroken {its:8.1f} Hz")
assert np.allclose(model.frequencies, clean.frequencies, rtol=0.01)
