"""Nodal lines of plates, membranes and computed bodies against those of the closed forms."""

from __future__ import annotations

from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

import struck
from struck.cli import main
from struck.errors import OptionError
from struck.report.charts import quantity
from struck.report.model_pictures import _colour_range, _round_ticks
from struck.report.nodal_lines import PlanView, _refined, zero_lines
from struck.shapes import Bar, CircularPlate, RectangularMembrane, RectangularPlate
from struck.solids import Block
from tests.report.test_model_pictures import plain_recording

SIDE = 0.2  # m


def panels(figure: Figure) -> list[np.ndarray]:
    """Return the nodal segments (S, 2, 2) of each mode of a picture, m."""
    found = []
    for axes in figure.axes:
        lines = [each for each in axes.collections if isinstance(each, LineCollection)]
        if lines:
            segments = lines[-1].get_segments()
            found.append(np.array(segments).reshape(-1, 2, 2))
    return found


def length(segments: np.ndarray) -> float:
    return float(np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1).sum())


def square(edges: str = "supported") -> struck.ModalModel:
    plate = RectangularPlate(length=SIDE, width=0.16, thickness=0.002, edges=edges)
    return struck.analyze(plate, "glass", band=(20, 4000), recoil=False)


@pytest.mark.prove
def test_a_supported_plate_has_straight_lines_at_equal_parts() -> None:
    """Mode (m, n) is sin(m pi x / a) sin(n pi y / b): m - 1 and n - 1 lines divide the sides."""
    model, width = square(), 0.16
    orders = sorted(
        ((m / SIDE) ** 2 + (n / width) ** 2, m, n) for m in range(1, 6) for n in range(1, 6)
    )[:9]
    assert (2, 3) in {(m, n) for _, m, n in orders}
    drawn = panels(struck.show(model, nodal_lines=9))
    fine, _ = _refined(model.gains, 1)
    cell = max(np.ptp(fine.points[face], axis=0).max() for face in fine.faces[:50])
    assert cell < 0.003
    for (_, m, n), segments in zip(orders, drawn, strict=True):
        down, across = SIDE * np.arange(1, m) / m, width * np.arange(1, n) / n
        total = len(down) * width + len(across) * SIDE
        assert length(segments) == pytest.approx(total, rel=0.05, abs=1e-6), (m, n)
        for point in segments.reshape(-1, 2):
            off = [*np.abs(down - point[0]), *np.abs(across - point[1])]
            assert min(off) < cell, (m, n, point)  # where lines cross a cell may be cut


@pytest.mark.prove
@pytest.mark.parametrize("edge", ["clamped", "free"])
def test_a_circular_plate_has_circles_and_diameters(edge: str) -> None:
    """Of n diameters and s circles within the edge, by the order of the modes (Leissa 1969)."""
    radius = 0.1
    plate = CircularPlate(radius=radius, thickness=0.002, edge=edge)
    model = struck.analyze(plate, "steel", band=(20, 9000), recoil=False)
    orders = {  # diameters and circles of the first modes, twins twice
        "clamped": [(0, 0), (1, 0), (1, 0), (2, 0), (2, 0), (0, 1)],
        "free": [(2, 0), (2, 0), (0, 1), (3, 0), (3, 0), (1, 1), (1, 1)],
    }[edge]
    # Radii of the circles of (0, 1): 0.379 of the clamped plate's (Leissa, table 2.2), and of a
    # free plate with Poisson's ratio 0.29 some 0.680 (table 2.6: 0.680 with 0.33).
    circle = {"clamped": 0.379, "free": 0.680}[edge]
    for (diameters, circles), segments in zip(
        orders, panels(struck.show(model, nodal_lines=len(orders))), strict=True
    ):
        distances = np.linalg.norm(segments, axis=2)
        if diameters == 0 and circles == 0:
            assert not len(segments)
        elif not diameters:
            assert distances == pytest.approx(circle * radius, rel=0.01)
            assert length(segments) == pytest.approx(2 * np.pi * circle * radius, rel=0.02)
        elif not circles:
            assert length(segments) == pytest.approx(2 * radius * diameters, rel=0.05)
            ends = segments[distances.max(axis=1) > 0.3 * radius].reshape(-1, 2)
            angles = np.arctan2(*ends.T[::-1]) * diameters * 2
            turned = np.angle(np.exp(1j * (angles - angles[0])))  # equal parts: all of one phase
            assert np.abs(turned).max() < 0.1


def test_computed_bodies_are_seen_from_their_broad_side() -> None:
    """A free bar's first mode is still at 0.2242 of its length from the ends, and a plate's too."""
    slender = Bar(length=0.3, width=0.03, thickness=0.002, theory="euler-bernoulli")
    computed = Block(size=(0.002, 0.02, 0.3), elements=(1, 2, 16))  # on edge, along z
    for body, along, start in ((slender, 0, 0.0), (computed, None, -0.15)):
        model = struck.analyze(body, "steel", band=(20, 2000), recoil=False)
        segments = panels(struck.show(model, nodal_lines=1))[0]
        axis = int(np.argmax(np.ptp(model.geometry.bounds, axis=0))) if along is None else along
        assert axis == (2 if along is None else 0)
        places = np.sort(np.abs(segments[..., 0] - (start + 0.15)).ravel())
        assert places == pytest.approx(0.15 - 0.2242 * 0.3, abs=1.5e-3)


def test_a_mode_in_the_plane_has_no_lines_and_says_so() -> None:
    block = struck.solids.Block(size=(0.2, 0.05, 0.004), elements=(8, 2, 1))
    model = struck.analyze(block, "steel", band=(20, 12000), recoil=False)
    gains = model.gains
    shares = np.abs(gains.shapes[:, 2]).max(axis=0) / np.abs(gains.shapes).max(axis=(0, 1))
    sideways = np.flatnonzero(shares < 0.05)
    assert len(sideways)
    figure = struck.show(model, nodal_lines=int(sideways[0]) + 1)
    title = figure.axes[sideways[0]].get_title()
    assert title.startswith(f"{sideways[0] + 1}:")
    plan = PlanView.of(model.geometry)
    flat = plan.motion(gains.shapes[:, :, sideways[0]] * [1.0, 1.0, 0.0])
    assert not flat.any()
    assert not len(plan.nodal_lines(flat))


def test_lines_through_vertices_are_drawn_once() -> None:
    """Of f = x y on a grid whose lines are those of the zeros, and a held border without any."""
    x, y = (each.ravel() for each in np.meshgrid(np.arange(-3.0, 4), np.arange(-3.0, 4)))
    corner = np.array([7 * row + column for row in range(6) for column in range(6)])
    faces = np.concatenate(
        [corner[:, None] + [0, 1, 8], corner[:, None] + [0, 8, 7]]
    )  # squares in two
    points = np.column_stack([x, y])
    crossing = length(zero_lines(points, faces, x * y))
    assert 12 - 2 * (2 - np.sqrt(2)) - 1e-9 <= crossing <= 12  # cut by diagonals of two cells
    held = x * np.where((np.abs(x) == 3) | (np.abs(y) == 3), 0.0, 1.0)
    lines = zero_lines(points, faces, held)
    assert np.abs(lines[..., 0]).max() == 0
    assert length(lines) == pytest.approx(4.0)


def test_a_string_shows_its_nodes_and_not_its_ends() -> None:
    """Mode n has n - 1 nodes; across so thin a body, lines are shorter than a pixel."""
    string = struck.shapes.String(length=0.6, radius=2e-4, tension=60.0)
    model = struck.analyze(string, "steel", band=(20, 900), recoil=False)
    figure = struck.show(model, nodal_lines=4)
    for mode, (axes, segments) in enumerate(zip(figure.axes, panels(figure), strict=True)):
        nodes = 0.6 * np.arange(1, mode + 1) / (mode + 1)
        marks = np.concatenate([each.get_xdata() for each in axes.lines])
        for drawn in (segments[..., 0].ravel(), marks):
            assert len(drawn) if mode else not len(drawn)
            off = np.abs(drawn[:, None] - nodes)
            assert (off.min(axis=1, initial=1.0) < 0.003).all(), mode
            assert (off.min(axis=0, initial=1.0) < 0.003).all(), mode
    corner = np.arange(8)  # a strip, two rows of nine vertices, held at its ends
    points = np.array([(x, y) for y in (0.0, 1.0) for x in range(9)], float)
    faces = np.concatenate([corner[:, None] + [0, 1, 10], corner[:, None] + [0, 10, 9]])
    lines = zero_lines(points, faces, -np.sin(np.pi * points[:, 0] / 4).round(12))
    assert {*lines[..., 0].ravel()} == {4.0}


@pytest.mark.prove
def test_the_shell_draws_nodal_lines(tmp_path: Path) -> None:
    membrane = RectangularMembrane(length=0.3, width=0.3, thickness=1e-4, tension=30_000.0)
    struck.save(struck.analyze(membrane, "steel", band=(20, 1500)), tmp_path / "a.struck")
    picture = tmp_path / "a.png"
    given = ["show", str(tmp_path / "a.struck"), "-o", str(picture), "--nodal-lines", "4"]
    assert main(given) == 0
    assert matplotlib.image.imread(picture).std() > 0.05
    assert main([*given[:-1], "0"]) == 2
    with pytest.raises(OptionError, match="nodal_lines is 99: give 1 to"):
        struck.show(struck.load(tmp_path / "a.struck"), nodal_lines=99)
    with pytest.raises(OptionError, match="no mode shapes to draw"):
        struck.show(plain_recording(), nodal_lines=1)


def test_numbers_in_pictures_have_no_exponent() -> None:
    told = {
        (1.7e-4, "m"): "170 µm",
        (9.96e-4, "m"): "1 mm",
        (3.17e-5, "Pa"): "32 µPa",
        (1234.0, "g"): "1.2 kg",
        (2e-13, "m"): "0.0002 nm",
        (0.0, "m"): "0 m",
        (-0.25, "m/s"): "-250 mm/s",
    }
    assert {given: quantity(*given) for given in told} == told


def test_blows_and_overviews_name_where_they_strike() -> None:
    model = square()
    place = model.contact().place
    titles = [axes.get_title() for axes in struck.show(model).axes]
    assert any(title.startswith(f"struck at {place}\n") for title in titles)
    blow = struck.show(model, strike=struck.Strike(at="quarter", speed=2.0, striker="steel"))
    assert blow.get_suptitle().endswith("at the quarter")
    captions = [text.get_text() for axes in blow.axes for text in axes.texts]
    assert captions
    assert not any("e+" in each or "e-" in each for each in captions)


def test_brightness_has_round_ticks_and_no_full_range_for_little() -> None:
    for low, high in ((5158.0, 5573.0), (90.0, 150.0), (200.0, 9000.0)):
        least, most = _colour_range(low, high)
        assert most / least >= 2 - 1e-9
        assert least <= low * (1 + 1e-9)
        assert most >= high * (1 - 1e-9)
        ticks = _round_ticks(least, most)
        assert len(ticks) >= 3
        assert all(least <= each <= most for each in ticks)
        assert all(float(f"{each:.1e}") == pytest.approx(each) for each in ticks)
