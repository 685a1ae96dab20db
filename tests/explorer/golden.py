"""Golden cases for the page's modules, written by Python when the tests run; never kept."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import struck
from struck import Strike
from struck.excitation.excitation import Hold, drive
from struck.excitation.hertz import strikers
from struck.excitation.pulses import sampled
from struck.explorer.page_files import refined
from struck.files.container import pack
from struck.model.contact import Contact
from struck.model.model import ModalModel
from struck.model.timbre_table import SinglePoint
from struck.shapes import (
    AnnularMembrane,
    Bar,
    CircularMembrane,
    CircularPlate,
    PolygonMembrane,
    RectangularMembrane,
    RectangularPlate,
    String,
)
from struck.solids import Block, Tube

Array = NDArray[Any]
RATE = 48_000
SKIN = {"density": 1300.0, "youngs_modulus": 3.5e9, "poisson_ratio": 0.4}
L_SHAPE = [(0, 0), (0.4, 0), (0.4, 0.2), (0.2, 0.2), (0.2, 0.4), (0, 0.4)]


@dataclass
class Case:
    """What a page's test reads: JSON values and arrays, in a container as the page reads them."""

    text: dict[str, Any] = field(default_factory=dict)
    arrays: dict[str, Array] = field(default_factory=dict)

    def write(self, path: Path) -> None:
        metadata = {"format": "golden", "version": "1", "json": json.dumps(self.text)}
        path.write_bytes(pack(self.arrays, metadata))


def bodies() -> Iterator[tuple[str, ModalModel]]:
    """Yield a body of each kind that the page knows by a formula, and two of elements."""
    mylar = struck.Material(name="mylar", damping=struck.Rayleigh(mass=2.0, stiffness=1e-7), **SKIN)
    yield (
        "string",
        struck.analyze(String(length=0.65, radius=5e-4, tension=70.0), "steel", band=(20, 4000)),
    )
    yield "bar", struck.analyze(Bar(length=0.3, width=0.03, thickness=0.005), "steel")
    clamped = Bar(length=0.3, width=0.03, thickness=0.005, ends=("clamped", "hinged"))
    yield "clamped bar", struck.analyze(clamped, "aluminium")
    damping = struck.Rayleigh(mass=2.0, stiffness=1e-7)
    mylar = struck.Material(name="mylar", damping=damping, **SKIN)
    for name, shape, highest in (
        ("drum", CircularMembrane(radius=0.16, thickness=5e-4, tension=1000.0), 500),
        ("ring", AnnularMembrane(radius=0.2, hole=0.05, thickness=5e-4, tension=2000.0), 500),
        ("square", RectangularMembrane(length=0.3, width=0.2, thickness=5e-4, tension=2000.0), 500),
        ("corner", PolygonMembrane(corners=L_SHAPE, thickness=5e-4, tension=2000.0), 300),
    ):
        yield name, refined(struck.analyze(shape, mylar, band=(20, highest)))
    plate = RectangularPlate(length=0.3, width=0.2, thickness=0.003)
    yield "plate", struck.analyze(plate, "steel", band=(20, 1500))
    disk = CircularPlate(radius=0.1, thickness=0.002)
    yield "disk", struck.analyze(disk, "brass", band=(20, 3000)).scaled(1.3)
    block = Block(size=(0.2, 0.05, 0.02))
    yield "block", struck.analyze(block, "oak", accuracy="preview", band=(20, 8000))
    tube = Tube(length=0.3, radius=0.0125, wall=0.002)
    yield "tube", struck.analyze(tube, "aluminium", accuracy="preview", band=(20, 6000))
    yield "recorded", recorded()


def recorded() -> ModalModel:
    """Return a model as a single recording gives it."""
    rng = np.random.default_rng(7)
    frequencies = np.sort(rng.uniform(200, 8000, 20))
    return ModalModel(
        frequencies=frequencies,
        natural_frequencies=frequencies,
        decays=rng.uniform(2, 50, 20),
        gains=SinglePoint(outputs=rng.normal(size=20) + 1j * rng.normal(size=20)),
        complete_to=8000.0,
        coordinates=(),
    )


def gains_of(model: ModalModel) -> Case:
    """Return contacts, drives, outputs, holds and strikes of a body."""
    case = Case()
    rng = np.random.default_rng(3)
    far = 2.0 + 5 * rng.random((3, 3))
    case.arrays["listeners"] = far
    outputs = model.gains.toward(far)[:, 0]
    case.arrays["toward"] = np.stack([outputs.real, outputs.imag], axis=-1)
    if model.geometry is None:
        return case
    mesh = model.geometry
    faces = rng.integers(0, len(mesh.faces), 12)
    weights = rng.dirichlet(np.ones(3), len(faces))
    points = np.einsum("kc,kcd->kd", weights, mesh.points[mesh.faces[faces]])
    contacts = [model.contact(point) for point in points]
    case.arrays["points"], case.arrays["faces"] = points, faces.astype(np.uint32)
    case.arrays["directions"] = np.stack([each.direction for each in contacts])
    case.arrays["drives"] = np.stack([drive(model, each) for each in contacts])
    holds = [Hold(at=point, grip=12.0) for point in points[:3]]
    case.arrays["raised"] = np.stack([hold.raised(model) for hold in holds])
    case.text["extent"], case.text["radius"] = float(mesh.extent), float(model.gains.radius)
    case.text["blows"] = list(blows_of(model, contacts[0]))
    return case


def blows_of(model: ModalModel, contact: Contact) -> Iterator[dict[str, Any]]:
    for said in (
        {"striker": "wood"},
        {"striker": "steel", "speed": 1.7},
        {"striker": "felt", "impulse": 0.02},
        {"striker": "fingertip", "speed": 0.3, "duration": 0.002},
        {"impulse": 0.01, "duration": 0.001},
        {"impulse": 0.01},
    ):
        blow = Strike(at=contact.point, **said).resolved(model, contact)
        yield {"said": said, "impulse": blow.impulse, "duration": blow.duration}


def pulses() -> Case:
    """Return band-limited half-sines at chance onsets."""
    case, said = Case(), []
    rng = np.random.default_rng(5)
    for number, duration in enumerate((0.0, 2e-5, 3.3e-4, 4e-3, 0.021)):
        given = {"impulse": 0.013, "onset": float(rng.random()), "duration": duration}
        pulse = sampled("half-sine", sample_rate=RATE, **given)
        case.arrays[f"force{number}"] = pulse.force
        said.append({**given, "first": pulse.first})
    case.text = {"pulses": said, "sampleRate": RATE, "strikers": dict(strikers())}
    return case


def write_models(folder: Path) -> None:
    """Write models, and what Python makes of them, for `models.mjs`."""
    names = []
    for name, model in bodies():
        names.append(name)
        struck.save(model, folder / f"{name}.struck")
        gains_of(model).write(folder / f"{name}.golden")
    pulses().write(folder / "pulses.golden")
    (folder / "names.json").write_text(json.dumps(names))
