"""Places that every body has: where they lie, and which face a push there meets."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
import trimesh

import struck
from struck import Mesh, ModalModel
from struck.cli.info import _Place
from struck.model.mesh import places_of
from struck.model.playing_place import default_blows
from struck.shapes import Bar, RectangularPlate
from struck.solids import Block, Revolution, Tube
from struck.solids.revolution import bell, bowl, wine_glass
from tests.live.hand import ball

NAMES = ("bottom", "middle", "side", "top")


def of(made: trimesh.Trimesh, up: str = "z") -> dict[str, np.ndarray]:
    return dict(places_of(Mesh(points=made.vertices, faces=made.faces, up=up)))


def test_a_box_lying_and_standing() -> None:
    box = trimesh.creation.box(extents=(0.1, 0.05, 0.03))
    places = of(box)
    assert sorted(places) == ["+x", "+y", "+z", "-x", "-y", "-z", *NAMES]
    np.testing.assert_allclose(places["middle"], (0, 0, 0.015), atol=1e-12)
    np.testing.assert_allclose(of(box, "y")["middle"], (0, 0.025, 0), atol=1e-12)
    for name, axis, end in (("top", 2, 0.015), ("bottom", 2, -0.015), ("side", 0, 0.05)):
        place = places[name]  # on that face, and not quite on its edge
        assert place[axis] == pytest.approx(end, abs=1e-12)
        assert (np.abs(np.delete(place, axis)) < np.delete((0.05, 0.025, 0.015), axis) - 5e-5).all()


def test_what_is_open_above_has_a_rim_and_what_is_not_has_none() -> None:
    bowl = Revolution(profile=[(0, 0), (0.07, 0.01), (0.1, 0.06)], wall=0.003)
    outer = trimesh.creation.box(extents=(0.3, 0.2, 0.1))
    inner = trimesh.creation.box(extents=(0.28, 0.18, 0.1)).apply_translation((0, 0, 0.01))
    for box in (outer, inner):
        box.update_faces(box.triangles_center[:, 2] < box.bounds[1, 2] - 1e-6)
    crate = trimesh.util.concatenate(outer, inner)
    for mesh, radius, height, depth in (
        (bowl.volume_mesh("preview").surface()[0], 0.1, 0.06, 0.05),
        (Mesh(points=crate.vertices, faces=crate.faces), 0.14, 0.06, 0.05),
    ):
        places = places_of(mesh)
        assert places["rim"][0] == pytest.approx(radius, rel=0.06)
        assert places["rim"][2] == pytest.approx(height, abs=0.012)
        assert places["middle"][2] < places["rim"][2] - depth
    for closed in (trimesh.creation.icosphere(2, 0.1), trimesh.creation.cylinder(0.04, 0.1)):
        assert "rim" not in of(closed)
    dome = trimesh.Trimesh(*bowl_upside_down())
    assert "rim" not in of(dome)


def bowl_upside_down() -> tuple[np.ndarray, np.ndarray]:
    mesh = Revolution(profile=[(0, 0), (0.07, 0.01), (0.1, 0.06)], wall=0.003)
    surface = mesh.volume_mesh("preview").surface()[0]
    return surface.points * [1, 1, -1], surface.faces[:, ::-1]


def test_the_end_of_a_standing_tube_is_struck_from_above_and_its_rim_from_the_side() -> None:
    mesh = Tube(length=0.3, radius=0.01, wall=0.001).volume_mesh("preview").surface()[0]
    places = places_of(mesh)
    for name, axis in (("top", 2), ("rim", 0), ("side", 0)):
        _, faces, _ = mesh.locator.closest(places[name][None])
        assert mesh.face_normals[faces[0], axis] > 0.9, name


def level(model: ModalModel, at: str) -> float:
    """Return the level that `struck info` lists for a place, dB."""
    told = _Place.of(model, at).level
    return -np.inf if told is None else told


def strummed() -> Iterator[tuple[str, ModalModel]]:
    bar = Bar(length=0.3, width=0.03, thickness=0.005)
    yield "bar", struck.analyze(bar, "rosewood")
    yield "held bar", struck.analyze(replace(bar, ends=("clamped", "free")), "steel")
    plate = RectangularPlate(length=0.3, width=0.2, thickness=0.003, edges="free")
    yield "plate", struck.analyze(plate, "glass", band=(20, 1500))
    yield "ball", ball()


def turned() -> Iterator[tuple[str, ModalModel]]:
    for body, material in ((bell(), "bronze"), (wine_glass(), "glass"), (bowl(), "rosewood")):
        yield type(body).__name__, struck.analyze(body, material, accuracy="preview")
    tube = Tube(length=0.5, radius=0.0125, wall=0.001)
    yield "tube", struck.analyze(tube, "brass", accuracy="preview")
    yield "crumb", struck.analyze(Block(size=(0.02, 0.015, 0.01)), "oak", accuracy="preview")


@pytest.mark.parametrize("made", [strummed, pytest.param(turned, marks=pytest.mark.prove)])
def test_no_place_by_name_is_louder_than_the_loudest(
    made: Callable[[], Iterator[tuple[str, ModalModel]]],
) -> None:
    for name, model in made():
        levels = {place: level(model, place) for place in ("loudest", *model.places)}
        if name == "Revolution":  # four places that are one; the facets make them differ by 1.4 dB
            sides = [levels.pop(place) for place in ("+x", "-x", "+y", "-y")]
            levels["sides"] = 10 * np.log10(np.mean(10 ** (np.array(sides) / 10)))
        # The choice leaves out beats, between modes and with the recoil: at places that are alike
        # they make 0.24 dB (a push on the bottom of the wooden bowl from inside and from below).
        assert levels["loudest"] >= max(levels.values()) - 0.3, (name, levels)
        contact = model.contact("loudest")
        (mass,), (duration,) = default_blows(model, contact.point[None], contact.direction[None])
        blow = struck.Strike().resolved(model, contact)
        assert duration == pytest.approx(blow.duration, rel=1e-4), name
        assert 0.8 * mass == pytest.approx(blow.impulse, rel=1e-4), name  # 0.5 m/s and 0.6 back
