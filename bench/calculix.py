"""The frequencies that CalculiX finds on a mesh of ours.

Its C3D10 is our tet10 and its C3D20 our hex20, node for node; C3D10 integrates stiffness and mass
alike at four points.
Run as a program, it asks CalculiX anew for what the tests keep of it.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from struck import Material
from struck.report.gallery import bird
from struck.solids import VolumeMesh
from struck.solids.filling.filling import fill_body
from struck.solids.surface.distance import FilledBody

MISSING = "CalculiX is not here (no ccx on PATH): on Debian, apt-get install calculix-ccx"
COUNT = 50
_NAME, _TYPES = "body", {"tet10": "C3D10", "hex20": "C3D20"}
_KEPT = Path(__file__).parents[1] / "tests/physics/calculix_bird.npz"


def installed() -> bool:
    """Tell whether ccx is on PATH."""
    return shutil.which("ccx") is not None


def frequencies(
    mesh: VolumeMesh, material: Material, count: int, folder: Path
) -> NDArray[np.float64]:
    """Return the lowest `count` elastic frequencies of a free body, Hz, to 7 digits."""
    (folder / f"{_NAME}.inp").write_text(_deck(mesh, material, count + 6), encoding="ascii")
    subprocess.run(
        [shutil.which("ccx") or "ccx", _NAME],
        cwd=folder,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        stdout=subprocess.DEVNULL,
        check=True,
    )
    lines = (folder / f"{_NAME}.dat").read_text(encoding="ascii").splitlines()
    table = [words for words in map(str.split, lines) if len(words) == 5 and words[0].isdigit()]
    return np.array([float(cycles) for _, _, _, cycles, _ in table[6 : count + 6]])


def kept() -> tuple[VolumeMesh, NDArray[np.float64]]:
    """Return elements of a hollow bird of ceramic, and the frequencies that CalculiX found, Hz."""
    with np.load(_KEPT) as file:
        mesh = VolumeMesh(nodes=file["nodes"], elements=file["elements"], kind="tet10")
        return mesh, file["frequencies"]


def keep() -> None:
    """Ask CalculiX for what `kept` returns: a coarse mesh, so that the file stays small."""
    mesh = replace(fill_body(FilledBody(mesh=bird(), wall=0.0063), "preview").mesh, cubic=False)
    with tempfile.TemporaryDirectory() as folder:
        found = frequencies(mesh, Material.named("ceramic"), COUNT, Path(folder))
    elements = mesh.elements.astype(np.int32)
    np.savez_compressed(_KEPT, nodes=mesh.nodes, elements=elements, frequencies=found)


def _lines(numbers: list[int]) -> str:
    """Return numbers on lines of at most sixteen, which is all that its reader takes."""
    parts = [numbers[start : start + 16] for start in range(0, len(numbers), 16)]
    return ",\n".join(",".join(map(str, part)) for part in parts)


def _deck(mesh: VolumeMesh, material: Material, count: int) -> str:
    # Its reader takes numbers of at most 20 characters.
    nodes = (f"{i},{x:.12e},{y:.12e},{z:.12e}" for i, (x, y, z) in enumerate(mesh.nodes, 1))
    elements = (_lines([i, *e]) for i, e in enumerate(mesh.elements + 1, 1))
    rest = [
        "*MATERIAL, NAME=STUFF",
        "*ELASTIC",
        f"{material.youngs_modulus:.12e},{material.poisson_ratio:.12e}",
        "*DENSITY",
        f"{material.density:.12e}",
        "*SOLID SECTION, ELSET=BODY, MATERIAL=STUFF",
        "*STEP",
        "*FREQUENCY",
        f"{count}",
        "*END STEP",
    ]
    heads = ["*NODE, NSET=ALL"], [f"*ELEMENT, TYPE={_TYPES[mesh.kind]}, ELSET=BODY"]
    return "\n".join([*heads[0], *nodes, *heads[1], *elements, *rest]) + "\n"


if __name__ == "__main__":
    keep()
