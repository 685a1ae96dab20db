"""The place where a body is struck by default: its low modes speak there, whatever the body."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest
import trimesh

import struck
from struck import Mesh, ModalModel, Strike
from struck.model.gains import ShapeGains
from struck.shapes import Bar, CircularMembrane, RectangularPlate, RoundSection, String
from struck.solids import Tube
from struck.solids.revolution import bell, bowl, wine_glass
from tests.live.hand import ball

_TWINS = 2e-3  # of the frequency: closer modes are one line of a spectrum
_SILENT = 1e-6  # of the largest motion along the normal: such modes move along the surface alone


def lines_below_strongest(model: ModalModel, count: int) -> np.ndarray:
    """Return the lowest lines in the spectrum of a bare strike, dB re its strongest."""
    gains = cast("ShapeGains", model.gains)
    across = np.einsum("vd,vdm->vm", gains.surface.vertex_normals, gains.shapes)
    speaks = np.abs(across * np.abs(gains.outputs)).max(axis=0)
    own = model.frequencies[speaks > _SILENT * speaks.max()]
    first = own[np.diff(own, prepend=0.0) > _TWINS * own][:count]
    assert len(first) == count
    sound = struck.render(model, Strike())
    frequencies, (values,) = sound.spectrum()
    widths = np.maximum(_TWINS * first, frequencies[1])
    near = [np.abs(frequencies - f) <= w for f, w in zip(first, widths, strict=True)]
    return np.array([20 * np.log10(values[part].max() / values.max()) for part in near])


def spheroid() -> Mesh:
    made = trimesh.creation.icosphere(2, 0.05).apply_scale([1.6, 1.0, 0.7])
    return Mesh(points=made.vertices, faces=made.faces)


def of_mesh() -> ModalModel:
    return struck.analyze(spheroid(), "steel", wall=0.004, accuracy="preview", band=(20, 12000))


PLATE = RectangularPlate(length=0.3, width=0.2, thickness=0.003, edges="supported")
BODIES: dict[str, tuple[Callable[[], ModalModel], str | None, int]] = {
    # Hum, prime, tierce, quint and nominal of the bell.
    "bell": (
        lambda: struck.analyze(replace(bell(), elements=(16, 8, 1)), "bronze", band=(20, 4000)),
        "rim",
        5,
    ),
    "bowl": (
        lambda: struck.analyze(replace(bowl(), elements=(16, 6, 1)), "bronze", band=(20, 6000)),
        "rim",
        3,
    ),
    "small bowl": (
        lambda: struck.analyze(
            replace(bowl(radius=0.04, height=0.03, wall=0.002), elements=(16, 6, 1)),
            "glass",
        ),
        "rim",
        3,
    ),
    "glass": (
        lambda: struck.analyze(
            replace(wine_glass(), elements=(16, 8, 1)), "glass", band=(20, 4000)
        ),
        "rim",
        3,
    ),
    "tube": (
        lambda: struck.analyze(
            Tube(length=0.5, radius=0.0125, wall=0.001, elements=(8, 16, 1)),
            "brass",
            band=(20, 6000),
        ),
        "end",
        3,
    ),
    "tube by formula": (
        lambda: struck.analyze(
            Bar(length=0.5, section=RoundSection(radius=0.0125, wall=0.001)), "brass"
        ),
        "end",
        3,
    ),
    "bar": (lambda: struck.analyze(Bar(length=0.3, width=0.03, thickness=0.005), "steel"), None, 3),
    "held bar": (
        lambda: struck.analyze(
            Bar(length=0.3, width=0.03, thickness=0.005, ends=("clamped", "free")), "steel"
        ),
        None,
        3,
    ),
    "plate": (lambda: struck.analyze(PLATE, "glass", band=(20, 6000)), None, 3),
    "membrane": (
        lambda: struck.analyze(
            CircularMembrane(radius=0.2, thickness=2.5e-4, tension=3000.0), "nylon", band=(20, 1500)
        ),
        None,
        3,
    ),
    "string": (
        lambda: struck.analyze(String(length=0.65, radius=4e-4, tension=80.7), "steel"),
        None,
        3,
    ),
    "mesh": (of_mesh, None, 3),
}


@pytest.mark.parametrize("name", BODIES)
def test_low_modes_of_a_bare_strike_lie_within_20_db_of_the_strongest_line(name: str) -> None:
    make, place, count = BODIES[name]
    model = make()
    contact = model.contact()
    assert place in {None, contact.name}
    lines = lines_below_strongest(model, count)
    assert lines.min() >= -20.0, (contact.place, lines)
    told = struck.render(model, Strike(), seconds=0.01).notes
    speaks = "" if contact.name else ", where its lowest modes speak most"
    assert told[-1] == f"struck at {contact.place}{speaks}; no place was given"
    np.testing.assert_array_equal(contact.direction, -contact.normal)


def test_a_place_that_is_given_is_not_named() -> None:
    bar = struck.analyze(Bar(length=0.3, width=0.03, thickness=0.005), "steel")
    assert struck.render(bar, Strike(at="middle", striker="felt"), seconds=0.01).notes == ()
    held = [Strike(at="quarter"), struck.Hold(time=0.001)]
    assert struck.render(bar, held, seconds=0.01).notes[-1].startswith("held at ")


def test_the_loudest_place_can_be_asked_for() -> None:
    model = ball()
    assert model.contact("loudest").place != model.contact().place


@pytest.mark.parametrize("end", [-1, 1])
def test_an_end_that_is_held_is_not_struck(end: int) -> None:
    tube = Tube(length=0.3, radius=0.01, wall=0.002, elements=(8, 10, 1))
    model = struck.analyze(
        tube, "brass", band=(20, 8000), fixed=lambda points: end * points[:, 2] > 0.1
    )
    contact = model.contact()
    assert (contact.name == "end") == (end < 0)
    assert end * contact.point[2] < 0.1
    assert lines_below_strongest(model, 3).min() >= -20.0


def test_a_solver_that_turns_twins_changes_nothing() -> None:
    """Modes of one frequency are any basis of their space: any rotation of it is as good."""
    tube = Tube(length=0.3, radius=0.01, wall=0.002, elements=(8, 10, 1))
    model = replace(struck.analyze(tube, "brass", band=(20, 8000)), places={}, playing_place=None)
    gains, random = cast("ShapeGains", model.gains), np.random.default_rng(5)
    shapes = gains.shapes.astype(float)
    pairs = np.flatnonzero(np.diff(model.frequencies) < 1e-6 * model.frequencies[1:])
    assert len(pairs) >= 3
    for first in pairs:
        c, s = np.cos(angle := random.uniform(0, 2 * np.pi)), np.sin(angle)
        shapes[..., first : first + 2] = shapes[..., first : first + 2] @ [[c, -s], [s, c]]
    turned = replace(model, gains=replace(gains, shapes=shapes.astype(np.float32)))
    np.testing.assert_allclose(turned.contact().point, model.contact().point, atol=1e-9)
    again = np.random.default_rng(6).normal(scale=1e-6, size=shapes.shape) * np.abs(shapes).max()
    noisy = replace(model, gains=replace(gains, shapes=(shapes + again).astype(np.float32)))
    np.testing.assert_allclose(noisy.contact().point, model.contact().point, atol=1e-9)


def test_the_playing_place_goes_with_size_material_and_file(tmp_path: Path) -> None:
    make, _, _ = BODIES["tube by formula"]
    made = make()
    damped = made.damped(struck.Rayleigh(mass=1.0, stiffness=1e-8))
    for changed in (made.scaled(2.0), made.made_of("glass"), damped):
        assert changed.contact().name == "end"
    struck.save(made, tmp_path / "tube.struck")
    assert struck.load(tmp_path / "tube.struck").playing_place == "end"
    # A name that the body lacks, as of a file by hand, counts as none.
    other = replace(made, playing_place="knob")
    assert other.contact().point[0] == replace(made, playing_place=None).contact().point[0]
