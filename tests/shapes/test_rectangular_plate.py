"""Rectangular plates: every mix of edges, orthonormal forms, bad input."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray

from struck.errors import OptionError
from struck.model.material import Material
from struck.shapes import RectangularPlate
from struck.shapes.rectangular_plate import edge_polynomials

Array = NDArray[np.float64]
STEEL = Material(density=7850.0, youngs_modulus=2e11, poisson_ratio=0.3)
KINDS = ("free", "supported", "clamped")
plate = partial(RectangularPlate, length=0.3, width=0.2, thickness=0.002)


@pytest.mark.parametrize("ends", list(itertools.product((0, 1, 2), repeat=2)))
def test_polynomials_are_orthonormal_and_held(ends: tuple[int, int]) -> None:
    u, weights = leggauss(60)
    values = edge_polynomials(40, ends, u)
    np.testing.assert_allclose(values.T @ (weights[:, None] * values), np.eye(40), atol=1e-12)
    for end, zeros in zip((-1.0, 1.0), ends, strict=True):
        for order in range(zeros):
            held = edge_polynomials(10, ends, np.array([end]), order)
            assert np.abs(held).max() < 1e-9
    step = 1e-5
    near = [edge_polynomials(10, ends, np.array([0.3 + d])) for d in (-step, 0, step)]
    first, second = (edge_polynomials(10, ends, np.array([0.3]), order) for order in (1, 2))
    np.testing.assert_allclose((near[2] - near[0]) / (2 * step), first, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(
        (near[2] - 2 * near[1] + near[0]) / step**2, second, rtol=1e-3, atol=1e-2
    )


@pytest.mark.prove
@pytest.mark.parametrize("edges", list(itertools.product(KINDS, repeat=4)))
def test_every_mix_of_edges(edges: tuple[str, str, str, str]) -> None:
    check_edges(edges)


@pytest.mark.parametrize("edges", list(itertools.combinations_with_replacement(KINDS, 4))[::2])
def test_mixes_of_edges(edges: tuple[str, str, str, str]) -> None:
    check_edges(edges)


def check_edges(edges: tuple[str, str, str, str]) -> None:
    """More held edges are stiffer, and the plate turned over vibrates as before."""
    found = plate(edges=edges).vibration(STEEL, 400.0)
    turned = plate(edges=(edges[1], edges[0], edges[3], edges[2])).vibration(STEEL, 400.0)
    np.testing.assert_allclose(found.frequencies, turned.frequencies, rtol=1e-7)
    assert found.errors.max(initial=0.0) < 1e-4
    softer = tuple(KINDS[max(KINDS.index(edge) - 1, 0)] for edge in edges)
    count = len(found.frequencies)
    below = plate(edges=softer).vibration(STEEL, 400.0).frequencies
    assert len(below) + _rigid(softer) >= count + _rigid(edges)


def _rigid(edges: tuple[str, ...]) -> int:
    held = sorted(KINDS.index(edge) for edge in edges)
    return 3 if held[-1] == 0 else 1 if held[-2] == 0 and held[-1] == 1 else 0


@pytest.mark.parametrize("edges", ["free", ("clamped", "free", "supported", "free")])
def test_forms_are_orthonormal(edges: str | tuple[str, str, str, str]) -> None:
    forms = plate(edges=edges).vibration(STEEL, 5000.0).forms
    u, weights = leggauss(90)
    shares = (u + 1) / 2
    places = np.stack(np.meshgrid(0.3 * shares, 0.2 * shares, indexing="ij"), -1).reshape(-1, 2)
    values = forms.values(places)
    both = np.multiply.outer(weights, weights).ravel() / 4
    gram = values.T @ (both[:, None] * values)
    np.testing.assert_allclose(gram, np.eye(len(gram)), atol=1e-9)


@pytest.mark.parametrize(
    ("highest", "least"), [(20_000.0, 130), pytest.param(51_000.0, 350, marks=pytest.mark.prove)]
)
def test_hundreds_of_modes_by_weyl(highest: float, least: int) -> None:
    """The count of modes follows Weyl's law with its term for the edges."""
    body = plate(edges="supported")
    vibration = body.vibration(STEEL, highest)
    stiffness = STEEL.youngs_modulus * 0.002**2 / (12 * (1 - 0.09) * STEEL.density)
    wave = np.sqrt(2 * np.pi * highest / np.sqrt(stiffness))
    exact = sum(
        (m * np.pi / 0.3) ** 2 + (n * np.pi / 0.2) ** 2 <= wave**2
        for m in range(1, 200)
        for n in range(1, 200)
    )
    assert len(vibration.frequencies) == exact > least


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: plate(thickness=0.0), "thickness.*must exceed 0"),
        (lambda: plate(length=float("nan")), "length"),
        (lambda: plate(edges="glued"), "glued"),
        (lambda: plate(edges=("free", "free")), "one or four"),
        (lambda: plate(thickness=1e-5).vibration(STEEL, 20_000.0), "at most 5000"),
    ],
)
def test_impossible_plates_are_refused(make: Callable[[], object], told: str) -> None:
    with pytest.raises(OptionError, match=told):
        make()


def test_places_beyond_the_edge_are_read_at_it() -> None:
    forms = plate().vibration(STEEL, 2000.0).forms
    inside, beyond = forms.values(np.array([[0.3, 0.1]])), forms.values(np.array([[0.305, 0.1]]))
    np.testing.assert_array_equal(inside, beyond)
