"""Paths against great circles, straight lines and unfolded boxes."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import trimesh

from struck.errors import ContactError, OptionError
from struck.excitation.path import Path
from struck.model.model import ModalModel
from tests.excitation.bodies import of


@cache
def sphere() -> ModalModel:
    return of(trimesh.creation.icosphere(subdivisions=4))


def box(*size: float, divided: int = 3) -> trimesh.Trimesh:
    solid = trimesh.creation.box(size)
    for _ in range(divided):
        solid = solid.subdivide()
    return solid


@cache
def block() -> ModalModel:
    return of(box(0.3, 0.2, 0.1))


@pytest.mark.parametrize("seed", range(5))
def test_on_a_sphere_it_is_a_great_circle(seed: int) -> None:
    begin, end = np.random.default_rng(seed).normal(size=(2, 3))
    begin, end = begin / np.linalg.norm(begin), end / np.linalg.norm(end)
    path = Path.over(sphere(), [begin, end])
    assert path.length == pytest.approx(np.arccos(begin @ end), rel=0.01)
    across = np.cross(begin, end) / np.linalg.norm(np.cross(begin, end))
    assert np.abs(path.points @ across).max() < 0.03
    assert np.abs(np.linalg.norm(path.points, axis=1) - 1).max() < 0.005


def test_on_a_plane_it_is_a_straight_line() -> None:
    begin, end = np.array([0.1, 0.05, 0.05]), np.array([-0.12, -0.07, 0.05])
    path = Path.over(block(), [begin, end])
    assert path.length == pytest.approx(np.linalg.norm(end - begin), rel=1e-6)
    assert path.at(path.length / 4) == pytest.approx(begin + (end - begin) / 4, abs=1e-6)
    assert path.normal(0.01) == pytest.approx([0, 0, 1])


@pytest.mark.parametrize("divided", [0, 3])
def test_round_an_edge_it_is_straight_once_unfolded(divided: int) -> None:
    body = of(box(0.3, 0.2, 0.1, divided=divided))
    path = Path.over(body, [(0.1, 0.05, 0.05), (0.15, -0.05, -0.02)])
    assert path.length == pytest.approx(np.hypot(0.05 + 0.07, 0.10), rel=0.01)
    assert path.normal(0.0) == pytest.approx([0, 0, 1])
    assert path.normal(path.length) == pytest.approx([1, 0, 0])


def test_it_goes_round_a_thin_plate_and_not_through_it() -> None:
    thin = of(box(0.3, 0.2, 0.003))
    path = Path.over(thin, [(0.1, 0.0, 0.0015), (0.12, 0.01, -0.0015)])
    assert path.length == pytest.approx(0.08, rel=0.15)
    assert np.diff(path.lengths).max() < 0.003


def test_there_and_back_and_round_and_round() -> None:
    places = [(0.1, 0.05, 0.05), (-0.1, 0.05, 0.05), (-0.1, -0.05, 0.05)]
    once, back, loop = (
        Path.over(block(), places, repeat=repeat) for repeat in ("once", "back", "loop")
    )
    assert once.length == pytest.approx(0.3, rel=1e-6)
    assert once.at(1.0) == pytest.approx(places[-1], abs=1e-9)
    assert back.at(back.length + 0.05) == pytest.approx(once.at(once.length - 0.05), abs=1e-9)
    assert back.at(2 * back.length) == pytest.approx(places[0], abs=1e-9)
    assert loop.length == pytest.approx(0.3 + np.hypot(0.2, 0.1), rel=1e-4)
    assert loop.at(loop.length + 0.07) == pytest.approx(loop.at(0.07), abs=1e-9)


def test_it_moves_without_leaps() -> None:
    path = Path.over(sphere(), [(0, 0, 1), (1, 0, 0)])
    ways = np.linspace(0, path.length, 1000)
    steps = np.linalg.norm(np.diff([path.at(way) for way in ways], axis=0), axis=1)
    assert steps == pytest.approx(path.length / 999, rel=0.02)


def test_impossible_paths_are_refused() -> None:
    with pytest.raises(OptionError, match="give two places or more"):
        Path.over(block(), [(0.1, 0.05, 0.05)])
    with pytest.raises(OptionError, match="repeat is 'twice'"):
        Path.over(block(), [(0.1, 0.05, 0.05), (0, 0, 0.05)], repeat="twice")
    with pytest.raises(OptionError, match="one and the same"):
        Path.over(block(), [(0.1, 0.05, 0.05), (0.1, 0.05, 0.05)])
    with pytest.raises(OptionError, match="one and the same"):
        Path.over(block(), [(0.1, 0.05, 0.05), (0.1, 0.05 - 1e-17, 0.05)])
    with pytest.raises(OptionError, match="one and the same"):
        Path.over(block(), [(0.1, 0.03, 0.05), (0.1, 0.03 + 1e-13, 0.05)])
    with pytest.raises(ContactError, match="off the body"):
        Path.over(block(), [(0.1, 0.05, 0.05), (1, 0, 0)])
    other = trimesh.creation.box((0.1, 0.1, 0.1)).apply_translation((0.5, 0, 0))
    two = of(trimesh.util.concatenate([box(0.3, 0.2, 0.1), other]))
    with pytest.raises(ContactError, match="separate parts"):
        Path.over(two, [(0.1, 0.05, 0.05), (0.5, 0, 0.05)])
