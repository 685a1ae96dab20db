"""A patch against the closed-form mean of a wave over a disc."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import j1

from struck.errors import OptionError
from struck.excitation.excitation import drive
from tests.excitation.bodies import SIZE, WAVENUMBERS, plate


@pytest.mark.prove
def test_a_disc_weakens_each_wave_as_a_bessel_function() -> None:
    contact = plate().contact((0.05, 0.03, SIZE[2] / 2), (0, 0, -1))
    signs = np.sign(plate().gains.shapes[0, 2] * np.cos(WAVENUMBERS * -SIZE[0] / 2 + 0.3))
    for radius in (0.005, 0.02, 0.04):
        turns = WAVENUMBERS * radius
        mean = -signs * np.cos(WAVENUMBERS * 0.05 + 0.3) * 2 * j1(turns) / turns
        assert drive(plate(), contact, radius=radius) == pytest.approx(mean, abs=0.01)


@pytest.mark.prove
def test_a_point_is_the_shape_there() -> None:
    contact = plate().contact((0.05, 0.03, SIZE[2] / 2), (0, 0, -1))
    expected = plate().gains.at(contact.point[None], contact.direction[None])[0, 0]
    assert np.array_equal(drive(plate(), contact), expected)


def test_gains_that_a_push_cannot_carry_are_refused() -> None:
    contact = plate().contact((0.05, 0.03, SIZE[2] / 2))
    table = SimpleNamespace(at=lambda points, _: np.ones((len(points), 2, 3)))
    with pytest.raises(OptionError, match=r"sum of 2 products.*expanded"):
        drive(SimpleNamespace(gains=table), contact)
    broken = SimpleNamespace(at=lambda points, _: np.full((len(points), 1, 3), np.nan))
    with pytest.raises(OptionError, match="3 of 3 modes have gains that are not finite"):
        drive(SimpleNamespace(gains=broken), contact)
