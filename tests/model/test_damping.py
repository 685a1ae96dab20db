"""Damping laws against closed forms and the roots of the oscillator's own equation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from struck.errors import MaterialError
from struck.model.damping import Damping, InternalFriction, Measured, Rayleigh, ringing

LAWS = [
    InternalFriction(loss_tangent=0.01, external=3.0),
    Rayleigh(mass=5.0, stiffness=3e-8, external=3.0),
    Measured(frequencies=(100.0, 1000.0), rates=(1.0, 8.0)),
]


def test_decay_time_of_1998() -> None:
    # van den Doel & Pai 1998, eq. 12: 1 / (pi f tan phi) is 31.83 ms at 1 kHz and 0.01
    decay = InternalFriction(loss_tangent=0.01).decays(1000.0)
    assert 1 / decay == pytest.approx(0.03183098861837907, rel=1e-12)


def test_external_losses_of_1998_are_the_same_for_all_modes() -> None:
    # eq. 13: exp(-t / tau_0) multiplies every mode
    frequencies = np.array([50.0, 500.0, 5000.0])
    free = InternalFriction(loss_tangent=2e-3).decays(frequencies)
    held = InternalFriction(loss_tangent=2e-3, external=25.0).decays(frequencies)
    np.testing.assert_allclose(held - free, 25.0, rtol=1e-12)


def test_quality_factor_of_internal_friction_is_one_over_the_loss_tangent() -> None:
    frequencies = np.geomspace(20, 20000, 7)
    decays = InternalFriction(loss_tangent=0.01).decays(frequencies)
    np.testing.assert_allclose(np.pi * frequencies / decays, 100.0, rtol=1e-12)


def test_rayleigh_mass_and_stiffness_are_not_swapped() -> None:
    # the mass part decays all modes alike, the stiffness part grows with the square
    low, high = 100.0, 1000.0
    mass = Rayleigh(mass=30.0, stiffness=0.0).decays([low, high])
    np.testing.assert_allclose(mass, 15.0, rtol=1e-15)
    stiffness = Rayleigh(mass=0.0, stiffness=1e-7).decays([low, high])
    assert stiffness[1] / stiffness[0] == pytest.approx((high / low) ** 2, rel=1e-12)


def test_the_same_letters_mean_opposite_things_in_two_papers() -> None:
    # 2002: C = alpha_1 K + alpha_2 M (bowl 1); KleinPAT: C = alpha M + beta K (steel)
    alpha_1, alpha_2 = 1e-7, 30.0
    of_2002 = Rayleigh(stiffness=alpha_1, mass=alpha_2)
    assert of_2002.decays(551.3) == pytest.approx(15.6, abs=5e-4)  # as printed in Table 1
    alpha, beta = 5.0, 3e-8
    kleinpat = Rayleigh(mass=alpha, stiffness=beta)
    omega = 2 * np.pi * 1000.0
    assert kleinpat.decays(1000.0) == pytest.approx((alpha + beta * omega**2) / 2, rel=1e-12)
    # first letter on the wrong matrix: bowl 1 would die within a hundredth of a microsecond
    assert Rayleigh(mass=alpha_1, stiffness=alpha_2).decays(551.3) > 1e8


def test_measured_rates_are_met_and_straight_between_on_logarithmic_axes() -> None:
    law = Measured(frequencies=(100.0, 1000.0, 4000.0), rates=(1.0, 8.0, 2.0))
    np.testing.assert_allclose(law.decays([100, 1000, 4000]), [1, 8, 2], rtol=1e-12)
    np.testing.assert_allclose(
        law.decays([math.sqrt(100 * 1000), 2000]), [math.sqrt(8), 4], rtol=1e-12
    )
    np.testing.assert_allclose(law.decays([0.0, 1.0, 20000.0]), [1, 1, 2], rtol=1e-12)


@given(
    st.lists(st.floats(20, 20000), min_size=1, max_size=6, unique=True),
    st.lists(st.floats(1e-2, 1e4), min_size=6, max_size=6),
    st.floats(1, 40000),
)
def test_measured_rates_never_leave_the_range_of_what_was_measured(
    frequencies: list[float], rates: list[float], wanted: float
) -> None:
    rates = rates[: len(frequencies)]
    law = Measured(frequencies=tuple(sorted(frequencies)), rates=tuple(rates))
    assert min(rates) * (1 - 1e-12) <= law.decays(wanted) <= max(rates) * (1 + 1e-12)


@given(st.floats(10, 20000), st.floats(0, 0.999))
def test_ringing_frequency_and_decay_are_the_roots_of_the_oscillator(
    natural: float, share: float
) -> None:
    # z'' + 2 d z' + (2 pi f0)^2 z = 0 rings as exp(s t)
    omega = 2 * np.pi * natural
    decay = share * omega
    roots = np.roots([1.0, 2 * decay, omega**2])
    assume(abs(roots[0].imag) > 1e-3 * omega)
    assert -roots[0].real == pytest.approx(decay, rel=1e-9, abs=1e-9 * omega)
    assert ringing(natural, decay) == pytest.approx(abs(roots[0].imag) / (2 * np.pi), rel=1e-6)


def test_overdamped_modes_do_not_ring() -> None:
    critical = 2 * np.pi * 100.0
    np.testing.assert_array_equal(
        ringing([100.0, 100.0, 100.0], [0.0, critical * 1.001, 10 * critical]), [100.0, 0.0, 0.0]
    )


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_every_law_is_a_damping_for_numbers_and_arrays(law: Damping) -> None:
    assert isinstance(law, Damping)
    together = law.decays(np.array([[100.0, 300.0], [700.0, 2000.0]]))
    assert together.shape == (2, 2)
    assert together[1, 0] == law.decays(700.0)
    assert np.all(together > 0)


@pytest.mark.parametrize("value", [-1e-9, math.nan, math.inf])
def test_negative_and_endless_coefficients_are_refused(value: float) -> None:
    for make in (
        lambda: InternalFriction(loss_tangent=value),
        lambda: InternalFriction(loss_tangent=0.0, external=value),
        lambda: Rayleigh(mass=value, stiffness=0.0),
        lambda: Rayleigh(mass=0.0, stiffness=value),
    ):
        with pytest.raises(MaterialError, match=rf"is {value}: .*at least 0"):
            make()


@pytest.mark.parametrize(
    ("frequencies", "rates", "reason"),
    [
        ((100.0, 200.0), (1.0,), "2 frequencies and 1 of rates="),
        ((), (), "at least one"),
        ((200.0, 100.0), (1.0, 1.0), "must ascend"),
        ((0.0, 100.0), (1.0, 1.0), "above 0 Hz"),
        ((100.0, 200.0), (1.0, 0.0), "exceed 0"),
    ],
)
def test_measured_rates_that_make_no_law_are_refused(
    frequencies: tuple[float, ...], rates: tuple[float, ...], reason: str
) -> None:
    with pytest.raises(MaterialError, match=reason):
        Measured(frequencies=frequencies, rates=rates)
