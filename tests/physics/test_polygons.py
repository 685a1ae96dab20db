"""Membranes along polygons against closed forms, published digits, and other finite elements."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse.linalg
from numpy.typing import NDArray
from skfem import (
    Basis,
    BilinearForm,
    ElementTriCR,
    ElementTriP2,
    MeshTri,
)
from skfem.helpers import dot, grad

from struck import Material
from struck.shapes import PolygonMembrane
from struck.shapes.particular_solutions import Trial, refine
from struck.shapes.polygon import plan_of
from struck.shapes.polygon_membrane import _candidates, _refine_all
from struck.shapes.shape import Vibration

Array = NDArray[np.float64]
UNIT = Material(density=1.0, youngs_modulus=1.0, poisson_ratio=0.3)

# Betcke & Trefethen, SIAM Review 47, 469-491, 2005 (14 digits); R. S. Jones (1,001 digits).
LOWEST_OF_L = 9.63972384402194105271
# T. Betcke, PhD thesis, Oxford, 2005, and collocation with ball arithmetic.
L_SHAPE = (9.63972384402194, 15.1972519264543, 19.7392088021787, 29.5214811141449)
L_SHAPE += (31.9126359571378, 41.4745098902149, 44.9484877813512)
L_SHAPE += (49.3480220054468, 49.3480220054468)
# Gordon, Webb & Wolpert 1992, with legs of length 2; T. A. Driscoll, SIAM Review 39, 1-17, 1997.
DRUMS = (
    ((0, 0), (0, 2), (4, 6), (4, 4), (6, 4), (4, 2), (2, 2), (2, 0)),
    ((2, 0), (0, 2), (0, 4), (4, 4), (4, 6), (6, 4), (4, 2), (2, 2)),
)
DRISCOLL = (2.5379439998, 3.65550971352, 5.17555935622, 6.53755744376, 7.24807786256)
DRISCOLL += (9.2092949984, 10.5969856913, 11.5413953956, 12.3370055014, 13.0536540557)
DRISCOLL += (14.3138624643, 15.87130262, 16.941751688, 17.6651184368, 18.9810673877)
DRISCOLL += (20.8823950433, 21.2480051774, 22.232851793, 23.7112974848, 24.4792340693)
DRISCOLL += (24.6740110027, 26.0802400997, 27.3040189211, 28.1751285815, 29.5697729132)


def up_to(corners: object, highest: float) -> Vibration:
    """Return the modes with waves of speed 1 up to an eigenvalue of the Laplacian, 1/m^2."""
    body = PolygonMembrane(corners=corners, thickness=1.0, tension=1.0)  # type: ignore[arg-type]
    return body.vibration(UNIT, np.sqrt(highest) / (2 * np.pi))


def eigenvalues(vibration: Vibration) -> Array:
    return (2 * np.pi * vibration.frequencies) ** 2


def l_shape_up_to(highest: float) -> Vibration:
    body = PolygonMembrane.l_shape(side=1.0, thickness=1.0, tension=1.0)
    return body.vibration(UNIT, np.sqrt(highest) / (2 * np.pi))


@pytest.fixture(scope="module")
def l_shape() -> Vibration:
    return l_shape_up_to(50.0)


@pytest.fixture(scope="module")
def wide_l_shape() -> Vibration:
    return l_shape_up_to(102.0)


def test_l_shape_rings_as_published(l_shape: Vibration) -> None:
    found = eigenvalues(l_shape)
    assert len(found) == len(L_SHAPE)
    assert found[0] == pytest.approx(LOWEST_OF_L, rel=1e-13)
    assert found[:9] == pytest.approx(L_SHAPE, rel=1e-12)
    assert l_shape.errors.max() < 1e-10


@pytest.mark.prove
def test_l_shape_has_the_modes_of_its_squares(wide_l_shape: Vibration) -> None:
    """Products of sines pi m x, pi n y vanish where the three squares meet."""
    found = eigenvalues(wide_l_shape) / np.pi**2
    for whole, times in ((2, 1), (5, 2), (8, 1), (10, 2)):
        assert np.count_nonzero(np.abs(found / whole - 1) < 1e-12) == times


@pytest.mark.prove
@pytest.mark.parametrize("offset", [-3.2e-4, 3.2e-4])
def test_waves_of_many_periods_are_refined_to_the_end(offset: float) -> None:
    """A square's sines of 24 half waves a side, from as far off as elements leave a value."""
    exact = np.pi**2 * (24**2 + 24**2)
    corners = np.array([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], float)
    trial = Trial(next(_candidates(plan_of(corners), 1.05 * exact**0.5)))
    (found,) = refine(trial, exact * (1 + offset), 1, 1e-8)
    assert found.value == pytest.approx(exact, rel=1e-12)
    assert found.error < 1e-11


@pytest.mark.prove
def test_three_hundred_modes_of_the_l_shape_are_proved() -> None:
    found = eigenvalues(l_shape_up_to(1370.0)) / np.pi**2
    assert len(found) > 300
    squares = [m * m + n * n for m in range(1, 12) for n in range(1, 12) if m * m + n * n < 138]
    for whole in squares:
        assert np.count_nonzero(np.abs(found / whole - 1) < 1e-10) == squares.count(whole)


@pytest.mark.prove
@pytest.mark.parametrize("count", [9, 20])
def test_another_basis_gives_the_same(wide_l_shape: Vibration, count: int) -> None:
    """Fewer Fourier-Bessel functions with fundamental solutions instead of many alone."""
    found = eigenvalues(wide_l_shape)[:count]
    assert len(found) == count
    corners = np.array([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], float)
    first, second, *_ = _candidates(plan_of(corners), float(np.sqrt(found[-1])))
    assert len(second.sources) > 50 > second.counts.sum()
    assert first.counts.sum() > 80 > len(first.sources)
    again = _refine_all(Trial(second), found * (1 + 1e-5))
    assert [each.value for each in again] == pytest.approx(found.tolist(), rel=1e-12)


@BilinearForm
def _stiffness(u, v, _):  # noqa: ANN001, ANN202 - as scikit-fem calls it
    return dot(grad(u), grad(v))


@BilinearForm
def _mass(u, v, _):  # noqa: ANN001, ANN202
    return u * v


def by_elements(mesh: MeshTri, element: object, count: int) -> Array:
    """Return the lowest eigenvalues of scikit-fem's elements, held along the boundary."""
    basis = Basis(mesh, element)
    inner = basis.complement_dofs(basis.get_dofs())
    matrices = (form.assemble(basis)[inner][:, inner] for form in (_stiffness, _mass))
    stiffness, mass = matrices
    found = scipy.sparse.linalg.eigsh(stiffness, count, mass, sigma=0, return_eigenvectors=False)
    return np.sort(found)


@pytest.mark.prove
def test_each_mode_of_the_l_shape_lies_between_bounds(wide_l_shape: Vibration) -> None:
    """Quadratic elements bound it from above, nonconforming ones from below (Liu 2015)."""
    found = eigenvalues(wide_l_shape)
    mesh = MeshTri.init_lshaped().refined(5)
    upper = by_elements(mesh, ElementTriP2(), len(found) + 1)
    ends = mesh.p[:, mesh.facets]
    slack = (0.1893 * np.linalg.norm(ends[:, 0] - ends[:, 1], axis=0).max()) ** 2
    raviart = by_elements(mesh, ElementTriCR(), len(found) + 1)
    lower = raviart / (1 + slack * raviart)
    assert (lower[:-1] < found).all()
    assert (found < upper[:-1] * (1 + 1e-12)).all()
    assert (upper / lower < 1.025).all()
    assert lower[-1] > 102.0  # so these are all


@pytest.mark.prove
@pytest.mark.parametrize(("highest", "count"), [(7.5, 5), (29.6, 25)])
def test_one_cannot_hear_the_shape_of_a_drum(highest: float, count: int) -> None:
    drums = [up_to(corners, highest) for corners in DRUMS]
    one, other = (eigenvalues(drum) for drum in drums)
    assert one == pytest.approx(other, rel=1e-11)
    assert one == pytest.approx(DRISCOLL[:count], rel=2e-11)
    exact = 5 * np.pi**2 / 4 * np.array([1, 2])
    exact = exact[exact < highest]
    assert one[[8, 20][: len(exact)]] == pytest.approx(exact, rel=1e-12)
    for drum in drums:
        assert drum.errors.max() < 1e-8
        assert drum.details["proved complete up to (Hz)"] > np.sqrt(highest) / (2 * np.pi)


def squares(highest: float) -> list[float]:
    pairs = [(m, n) for m in range(1, 40) for n in range(1, 40)]
    return sorted(np.pi**2 * (m**2 + n**2) for m, n in pairs if m**2 + n**2 <= highest / np.pi**2)


def oblong(highest: float) -> list[float]:
    """A rectangle of 3 by sqrt(2)."""
    pairs = [(m, n) for m in range(1, 40) for n in range(1, 40)]
    every = (np.pi**2 * (m**2 / 9 + n**2 / 2) for m, n in pairs)
    return sorted(each for each in every if each <= highest)


def half_square(highest: float) -> list[float]:
    """The modes of the square that are odd about its diagonal."""
    pairs = [(m, n) for m in range(1, 40) for n in range(1, m)]
    return sorted(np.pi**2 * (m**2 + n**2) for m, n in pairs if m**2 + n**2 <= highest / np.pi**2)


def equilateral(highest: float) -> list[float]:
    """Lame 1852: 16 pi^2 / 9 (m^2 + m n + n^2)."""
    every = (m * m + m * n + n * n for m in range(1, 40) for n in range(1, 40))
    return sorted(16 * np.pi**2 / 9 * x for x in every if 16 * np.pi**2 / 9 * x <= highest)


def half_equilateral(highest: float) -> list[float]:
    every = (m * m + m * n + n * n for m in range(1, 40) for n in range(1, m))
    return sorted(16 * np.pi**2 / 9 * x for x in every if 16 * np.pi**2 / 9 * x <= highest)


HEIGHT = np.sqrt(0.75)


@pytest.mark.parametrize(
    ("corners", "highest", "family"),
    [
        pytest.param(((0, 0), (1, 0), (1, 1), (0, 1)), 400.0, squares, marks=pytest.mark.prove),
        pytest.param(
            ((0, 0), (3, 0), (3, 2**0.5), (0, 2**0.5)), 100.0, oblong, marks=pytest.mark.prove
        ),
        pytest.param(((0, 0), (1, 0), (0, 1)), 700.0, half_square, marks=pytest.mark.prove),
        pytest.param(((0, 0), (1, 0), (0.5, HEIGHT)), 900.0, equilateral, marks=pytest.mark.prove),
        (((0, 0), (0.5, 0), (0.5, HEIGHT)), 1800.0, half_equilateral),
    ],
    ids=["square", "rectangle", "half square", "equilateral", "half equilateral"],
)
def test_closed_forms_with_their_multiplicities(corners: object, highest: float, family) -> None:  # noqa: ANN001
    found = up_to(corners, highest)
    assert len(found.frequencies) >= 20
    assert eigenvalues(found) == pytest.approx(family(highest), rel=1e-11)
    assert (np.abs(eigenvalues(found) / family(highest) - 1) <= found.errors).all()


@pytest.mark.prove
def test_pentagon_has_pairs() -> None:
    """As a disk's: with 0, 1, 2, 0 (twice radial) and 3 nodal diameters."""
    around = 2 * np.pi * np.arange(5) / 5
    found = eigenvalues(up_to(np.column_stack([np.cos(around), np.sin(around)]), 60.0))
    starts = np.flatnonzero(np.diff(found, prepend=0.0, append=np.inf) > 1e-10 * found[-1])
    assert np.diff(starts).tolist() == [1, 2, 2, 1, 2]


@pytest.mark.prove
def test_narrow_bridge_makes_neighbours() -> None:
    """Two squares joined by a narrow channel: pairs of modes, even and odd, hardly apart."""
    corners = [(0, 0), (1, 0), (1, 0.35), (1.3, 0.35), (1.3, 0), (2.3, 0)]
    corners += [(2.3, 1), (1.3, 1), (1.3, 0.65), (1, 0.65), (1, 1), (0, 1)]
    found = up_to(corners, 21.0)
    value = eigenvalues(found)
    assert len(value) == 2
    assert 3e-3 < value[1] / value[0] - 1 < 5e-3
    assert value.max() < 2 * np.pi**2  # lower than a square's
    places = np.array([[0.5, 0.5], [1.8, 0.5]])
    left, right = found.forms.values(places)
    assert left * right == pytest.approx([right[0] ** 2, -(right[1] ** 2)], rel=1e-6)
