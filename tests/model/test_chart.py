"""Where the contact coordinates of recordings lie, against arcs, cones and straight lines."""

from __future__ import annotations

import json
import pathlib
from dataclasses import replace

import numpy as np
import pytest
import trimesh

import struck
from struck.cli import main
from struck.errors import OptionError
from struck.excitation.path import Path
from struck.files import model_file
from struck.files.container import unpack
from struck.model.chart import Chart, outline_of
from struck.model.mesh import Mesh
from tests.excitation.bodies import plate
from tests.excitation.recordings import HEARD, WIDTH, recorded
from tests.files.test_model_file import SCHEMA, complaints


def surface(solid: trimesh.Trimesh) -> Mesh:
    return Mesh(points=np.asarray(solid.vertices), faces=np.asarray(solid.faces))


@pytest.mark.parametrize(
    ("names", "pitch"),
    [
        (("height (m)",), [1.0]),
        (("x (cm)", "y (mm)"), [0.01, 0.001]),
        (("height (m)", "azimuth (rad)"), None),
        (("u",), None),
        ((), None),
    ],
)
def test_units_in_names_tell_the_pitch(names: tuple[str, ...], pitch: list[float] | None) -> None:
    chart = Chart.named(names)
    assert (None if chart is None else chart.pitch.tolist()) == pitch
    if names and len(names) == len(recorded("field").coordinates):
        model = replace(recorded("field"), coordinates=names, chart=None)
        assert (None if model.chart is None else model.chart.pitch.tolist()) == pitch


def test_round_a_body_a_way_is_an_arc() -> None:
    model = recorded("round")
    around = Path.over(model, [(0.5, -1.0), (0.5, 2.0)])
    assert around.length == pytest.approx(3 * WIDTH, rel=1e-4)
    whole = Path.over(model, [(0.5, 0.0), (0.5, 2 * np.pi)])
    assert whole.length == pytest.approx(2 * np.pi * WIDTH, rel=2e-4)


def test_on_a_surface_a_way_follows_its_outline() -> None:
    """A cone of half angle a: 1/cos(a) times as long as it is high, whatever the azimuth."""
    cone = surface(trimesh.creation.cone(radius=0.1, height=0.24, sections=256))
    up = Path.over(recorded("field").charted(pitch=0.24, geometry=cone), [(0.0,), (1.0,)])
    assert up.length == pytest.approx(np.hypot(0.24, 0.1), rel=1e-3)
    model = recorded("round").charted(pitch=0.24, geometry=cone)
    around = Path.over(model, [(0.25, 0.0), (0.25, 1.0)])
    assert around.length == pytest.approx(0.075, rel=1e-3)


def test_the_outline_of_a_ball_is_its_circle() -> None:
    ball = surface(trimesh.creation.icosphere(subdivisions=4, radius=0.2))
    moved = Mesh(points=ball.points + np.array([0.3, -0.1, 0.05]), faces=ball.faces)
    heights, radii = outline_of(moved, np.array([0.3, -0.1, 0.0])).T
    inside = np.abs(heights - 0.05) < 0.19
    expected = np.sqrt(0.2**2 - (heights[inside] - 0.05) ** 2)
    assert radii[inside] == pytest.approx(expected, abs=1e-3)


def test_a_larger_body_has_longer_ways() -> None:
    model = recorded("plane")
    ends = [(0.0, 0.0), (1.0, 1.0)]
    assert Path.over(model.scaled(3.0), ends).length == pytest.approx(
        3 * Path.over(model, ends).length
    )


@pytest.mark.parametrize("kind", ["field", "plane", "round", "table"])
def test_files_keep_charts(kind: str) -> None:
    cone = surface(trimesh.creation.cone(radius=0.1, height=0.24, sections=32))
    model = recorded(kind)
    if kind in {"field", "round"}:
        model = model.charted(pitch=0.24, geometry=cone)
    data = model_file.to_bytes(model)
    text = json.loads(unpack(data, kind="struck", newest=model_file.VERSION)[0]["json"])
    assert complaints(text, SCHEMA, SCHEMA) == []
    again = model_file.from_bytes(data)
    assert again.chart.around == model.chart.around
    assert np.array_equal(again.chart.pitch, model.chart.pitch)
    points = np.random.default_rng(0).random((9, len(model.coordinates)))
    assert np.array_equal(again.chart.places(points), model.chart.places(points))
    assert model_file.from_bytes(model_file.to_bytes(recorded(kind, charted=False))).chart is None


def test_impossible_charts_are_refused() -> None:
    box = surface(trimesh.creation.box((0.1, 0.1, 0.1)))
    flat, heights = recorded("plane"), recorded("field", charted=False)
    for pitch in (0.0, -1.0, np.nan, np.inf, 1e9):
        with pytest.raises(OptionError, match=r"pitch is \[.*\]: give metres a unit of each"):
            heights.charted(pitch=pitch)
    with pytest.raises(OptionError, match="give metres a unit of each of u, v"):
        flat.charted(pitch=0.3)
    with pytest.raises(OptionError, match="how long a unit of u and of v is is unknown"):
        flat.charted()
    with pytest.raises(OptionError, match="a round body alone, recorded with symmetry='axial'"):
        flat.charted(pitch=(0.1, 0.1), geometry=box)
    with pytest.raises(OptionError, match=r"z from 0 to 0\.3 m, and the geometry goes from -0\.05"):
        heights.charted(pitch=0.3, geometry=box)
    with pytest.raises(OptionError, match="this body was recorded at one: leave"):
        recorded("one").charted(pitch=1.0)
    with pytest.raises(OptionError, match="this body has a surface: leave it out"):
        plate(8).charted(pitch=1.0)
    with pytest.raises(OptionError, match="its chart has 2 pitches for 1 coordinates"):
        replace(heights, chart=Chart(pitch=np.ones(2)))
    with pytest.raises(OptionError, match="heights must ascend"):
        Chart(pitch=np.ones(1), outline=np.array([[0.0, 1.0], [0.0, 1.0]]))


def test_points_of_other_coordinates_are_refused() -> None:
    outline = np.array([[0.0, 0.1], [1.0, 0.2]])
    chart = Chart(pitch=np.ones(1), around=True, outline=outline)
    with pytest.raises(
        OptionError, match=r"shape \(3, 2\): a chart of 1 coordinate takes \(K, 1\)"
    ):
        chart.places(np.ones((3, 2)))


def test_the_shell_takes_a_pitch(tmp_path: pathlib.Path) -> None:
    path = str(tmp_path / "vase.struck")
    struck.save(recorded("field", charted=False), path)
    listener = ",".join(map(str, HEARD))
    asked = ["render", path, "--scrape", "0.1..0.9", "--seconds", "0.2", "--listener", listener]
    assert main([*asked, "-o", str(tmp_path / "a.wav")]) == 2
    assert main([*asked, "--pitch", "0.24", "-o", str(tmp_path / "a.wav")]) == 0
