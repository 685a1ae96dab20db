from __future__ import annotations

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from struck.errors import ContactError, OptionError
from struck.model.survey import Survey, from_spherical
from struck.model.timbre_table import GridAxis, TimbreTable
from tests.model.vases import HEIGHTS, Vase, listeners, noisy

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
NOWHERE = np.zeros((1, 3))


def heard(table: TimbreTable, contacts: Array, places: Array) -> Complex:
    return np.einsum("krm,lrm->klm", table.at(contacts, NOWHERE), table.toward(places))


def recorded() -> tuple[Survey, Complex]:
    """Return the vase of 2007 with gains (3, 19, M) that are the same at y and -y."""
    chance = default_rng(1)
    vase = Vase.drawn(chance)
    gains = noisy(vase.gains(HEIGHTS[:, 0], listeners()), 20.0, chance)
    places = listeners()
    for listener, (x, y, z) in enumerate(places):
        twin = np.linalg.norm(places - [x, -y, z], axis=1).argmin()
        gains[:, listener] = gains[:, min(listener, int(twin))]
    return vase.survey(HEIGHTS, gains), gains


def test_the_table_of_2007_gives_its_57_points_back_exactly() -> None:
    survey, gains = recorded()
    table = TimbreTable.of(survey)
    assert table.rank == 3
    assert table.directional
    order = survey.folded().contacts[:, 0]
    assert order.tolist() == sorted(HEIGHTS[:, 0])
    np.testing.assert_array_equal(heard(table, HEIGHTS, listeners()), gains)


def test_between_its_points_the_table_is_linear_in_each_coordinate() -> None:
    survey, gains = recorded()
    table = TimbreTable.of(survey)
    # Half-way in height, distance, azimuth and polar angle: the mean of 16 recordings.
    at = from_spherical(0.75, np.pi / 4, 3 * np.pi / 8)
    corners = [
        int(np.linalg.norm(listeners() - from_spherical(r, a, p), axis=1).argmin())
        for r in (0.5, 1.0)
        for a in (0.0, np.pi / 2)
        for p in (np.pi / 4, np.pi / 2)
    ]
    expected = gains[:2, corners].mean(axis=(0, 1))
    np.testing.assert_allclose(heard(table, np.array([[0.75]]), at)[0, 0], expected, rtol=1e-12)
    # Near the centre all directions come together in the one listener inside.
    np.testing.assert_allclose(
        heard(table, HEIGHTS, from_spherical(0.12, 2.0, 1.0))[:, 0], gains[:, -1], rtol=1e-12
    )
    # Outside of the grid sound falls as 1/r.
    far = heard(table, HEIGHTS, np.array([[4.0, 0.0, 0.0]]))[:, 0]
    np.testing.assert_allclose(far, gains[:, 14] / 4, rtol=1e-12)
    assert listeners()[14].round(9).tolist() == [1.0, 0.0, 0.0]


def test_quinti_linear_interpolation_is_that_of_scipy() -> None:
    chance = default_rng(2)
    axes = [np.array(each) for each in ([0, 1, 3], [-1, 2], [0.2, 0.7, 1], [-1, 1], [2, 3, 4, 6])]
    values = chance.normal(size=[len(each) for each in axes]) + 0j
    contacts = np.stack(np.meshgrid(*axes[:2], indexing="ij"), axis=-1).reshape(-1, 2)
    places = np.stack(np.meshgrid(*axes[2:], indexing="ij"), axis=-1).reshape(-1, 3)
    survey = Survey.full(
        contacts, places, values.reshape(len(contacts), len(places), 1), np.array([300.0])
    )
    table = TimbreTable.of(survey, system="cartesian")
    low, high = np.array([(each[0], each[-1]) for each in axes]).T
    points = chance.uniform(low, high, (50, 5))
    drives, outputs = table.at(points[:, :2], NOWHERE), table.toward(points[:, 2:])
    found = np.einsum("krm,krm->km", drives, outputs)[:, 0]
    np.testing.assert_allclose(found, RegularGridInterpolator(axes, values)(points), rtol=1e-10)


def test_azimuths_go_round() -> None:
    axis = GridAxis.through(np.array([0.0, np.pi / 2, np.pi, -np.pi / 2, -np.pi]), 2 * np.pi)
    assert len(axis.nodes) == 4
    np.testing.assert_allclose(
        axis.weights(np.array([-np.pi / 4, 9 * np.pi / 4])),
        [[0.5, 0, 0, 0.5], [0.5, 0.5, 0, 0]],
        atol=1e-12,
    )


def test_a_larger_body_keeps_its_table() -> None:
    survey, gains = recorded()
    modes = np.array([2, 7])
    larger = TimbreTable.of(survey).changed(survey.frequencies[modes], modes, 2.0, 1.0)
    np.testing.assert_allclose(
        heard(larger, HEIGHTS, 2 * listeners()), gains[:, :, modes] / 8, rtol=1e-12
    )


def test_what_is_no_full_grid_is_refused() -> None:
    survey, gains = recorded()
    places, height = listeners(), np.array([[0.5]])
    few = Survey.full(HEIGHTS, places[:-2], gains[:, :-2], survey.frequencies, symmetry="axial")
    TimbreTable.of(few)  # the azimuth pi/2 stands for -pi/2
    gap = Survey.full(HEIGHTS, places[:12], gains[:, :12], survey.frequencies)
    with pytest.raises(OptionError, match="places of the grid were not recorded"):
        TimbreTable.of(gap)
    with pytest.raises(OptionError, match="system is 'polar'"):
        TimbreTable.of(survey, system="polar")
    with pytest.raises(OptionError, match="1 of 57 pairs were not recorded"):
        TimbreTable.of(
            Survey(
                contacts=HEIGHTS,
                listeners=places,
                pairs=survey.pairs[1:],
                gains=survey.gains[1:],
                frequencies=survey.frequencies,
                centre=np.zeros(3),
            )
        )
    with pytest.raises(ContactError, match="has 2 coordinates: this table has 1"):
        TimbreTable.of(survey).at(np.repeat(height, 2, axis=1), NOWHERE)
