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
from struck.ears.hearing import Hearing
from struck.ears.listeners import Binaural, Mono, Stereo, Trajectory
from struck.ears.propagation import Emitter
from struck.excitation.excitation import Hold, Push, drive
from struck.excitation.hertz import strikers
from struck.excitation.pulses import sampled
from struck.explorer.page_files import head_bytes, refined
from struck.files.container import pack
from struck.live.commands import PlayedBody
from struck.live.limiter import limit, limiter
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
from struck.synth.poles import Poles
from struck.synth.resonators import Resonators

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
    die = struck.analyze(Block(size=(0.016, 0.016, 0.02)), "acrylic", accuracy="preview")
    yield "die", die  # without modes: its recoil alone is heard
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
    case.arrays["toward"] = in_pairs(outputs)
    case.arrays["logarithms"] = in_pairs(Poles.of(model, RATE).values / RATE)
    case.arrays["aside"] = in_pairs(PlayedBody(model, RATE).outputs_aside())
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


def in_pairs(values: Array) -> Array:
    return np.stack([values.real, values.imag], axis=-1)


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


@dataclass(frozen=True, kw_only=True)
class Modes:
    """Frequencies, Hz, and decays, 1/s (M,), of a body that rings."""

    frequencies: Array
    decays: Array


def rung(seconds: float = 10.0) -> Case:
    """Return ten seconds of a body that is struck, moved, changed and held, block by block."""
    rng = np.random.default_rng(11)
    count, block = 45, 128
    bodies = [
        Modes(frequencies=np.sort(rng.uniform(40, 23e3, count)), decays=rng.uniform(0.2, 30, count))
    ]
    bodies.append(Modes(frequencies=bodies[0].frequencies * 1.05, decays=bodies[0].decays * 1.7))
    raised = rng.uniform(0, 40, count)
    bodies.append(Modes(frequencies=bodies[1].frequencies, decays=bodies[1].decays + raised))
    outputs = [rng.normal(size=count) + 1j * rng.normal(size=count) for _ in range(2)]
    blocks = round(seconds * RATE / block)
    changes = {blocks // 4: 1, blocks // 2: 2, 3 * blocks // 4: 1}  # other material, hold, let go
    strikes = [
        {"voice": number % 3, "block": int(rng.integers(0, blocks - 100)), "length": 4 + number}
        for number in range(24)
    ]
    strikes = without_overlap([{"voice": 0, "block": 0, "length": 3}, *strikes])
    drives = [rng.normal(size=count) for _ in strikes]
    forces = [rng.normal(size=(each["length"], block)) for each in strikes]
    bank = Resonators([bodies[0]], sample_rate=RATE, block=block, voices=3)
    heard = []
    for number in range(blocks):
        if number in changes:
            bank.change(0, bodies[changes[number]])
        pushes = [
            Push(force=force[number - each["block"]], drive=drive, voice=each["voice"])
            for each, drive, force in zip(strikes, drives, forces, strict=True)
            if each["block"] <= number < each["block"] + each["length"]
        ]
        moved = {0: 0, blocks // 3: 1}.get(number)
        given = [] if moved is None else [outputs[moved][None]]
        heard.append(bank.process(pushes, given)[0, 0].copy())
    return Case(
        text={"blocks": blocks, "strikes": strikes, "changes": changes, "moved": blocks // 3},
        arrays={
            "heard": np.concatenate(heard),
            "frequencies": np.stack([each.frequencies for each in bodies]),
            "decays": np.stack([each.decays for each in bodies]),
            "outputs": np.stack([[each.real, each.imag] for each in outputs]),
            "drives": np.stack(drives),
            "forces": np.concatenate(forces).ravel(),
        },
    )


def without_overlap(strikes: list[dict[str, int]]) -> list[dict[str, int]]:
    """Return strikes of which none meets the voice of another at work."""
    kept: list[dict[str, int]] = []
    for each in sorted(strikes, key=lambda strike: strike["block"]):
        free = all(
            each["voice"] != other["voice"] or other["block"] + other["length"] < each["block"]
            for other in kept
        )
        kept += [each] * free
    return kept


LISTENERS = {"mono": Mono, "stereo": Stereo, "binaural": Binaural}


def heard_by(kind: str, seconds: float = 0.6) -> Case:
    """Return what a listener hears who walks past two bodies and turns."""
    rng = np.random.default_rng(13)
    times = np.linspace(0, seconds, 9)
    places = np.column_stack(
        [np.linspace(-1.5, 2.0, 9), 0.8 + 0.2 * np.sin(9 * times), 0.1 * times]
    )
    ahead = np.column_stack([np.cos(4 * times), np.sin(4 * times), 0.2 * np.cos(3 * times)])
    sides = {} if kind == "mono" else {"facing": (times, ahead)}
    listener = LISTENERS[kind](position=(times, places), **sides)
    centres = np.array([[0.0, 0.0, 0.1], [-0.5, -0.7, -0.4]])
    emitters = [Emitter(centre=Trajectory.of("position", centre), radius=0.1) for centre in centres]
    hearing = Hearing(emitters, listener, sample_rate=RATE, brief=True)
    sent = rng.normal(size=(2, 128 * round(seconds * RATE / 128)))
    heard = np.concatenate(
        [
            hearing.next_block(sent[:, first : first + 512])
            for first in range(0, sent.shape[1], 512)
        ],
        axis=1,
    )
    up = np.broadcast_to((0.0, 0.0, 1.0), ahead.shape)
    arrays = {"sent": sent, "heard": heard, "centres": centres}
    return Case(
        text={"lead": hearing.lead},
        arrays=arrays | {"poses": np.column_stack([times, places, ahead, up])},
    )


def limited() -> Case:
    """Return loud samples before and after a limiter, which opens."""
    rng = np.random.default_rng(17)
    samples = rng.normal(size=(2, 128 * 40)) * np.linspace(0.1, 3, 128 * 40)
    samples[0, 3000] = np.nan
    after, state = samples.copy(), limiter(sample_rate=RATE, channels=2)
    limit(state, after, opened=True)
    return Case(arrays={"before": samples, "after": after})


def write_sounds(folder: Path) -> None:
    """Write what Python makes of resonators, ears and limiter, for `sound.test.mjs`."""
    rung().write(folder / "rung.golden")
    limited().write(folder / "limited.golden")
    for kind in LISTENERS:
        heard_by(kind).write(folder / f"{kind}.golden")
    for name in ("exact", "kemar"):
        (folder / f"{name}.head").write_bytes(head_bytes(name, RATE))
