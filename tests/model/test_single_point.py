"""Models of one recorded place: heard by every listener, alike wherever they are struck."""

from __future__ import annotations

import numpy as np
import pytest

from struck.errors import ContactError
from struck.excitation.strike import Strike
from struck.model.model import ModalModel
from struck.model.timbre_table import SinglePoint
from struck.scene.render import render

FREQUENCIES = np.array([440.0, 1000.0, 3000.0])
DECAYS = np.array([3.0, 5.0, 9.0])
OUTPUTS = np.array([1.0, 0.3j, 0.1 - 0.1j])
NOWHERE = np.zeros((1, 3))
RATE = 48000


def model() -> ModalModel:
    return ModalModel(
        frequencies=FREQUENCIES,
        natural_frequencies=np.hypot(FREQUENCIES, DECAYS / (2 * np.pi)),
        decays=DECAYS,
        gains=SinglePoint(outputs=OUTPUTS),
        complete_to=0.0,
        places={"recorded": np.zeros(0)},
        coordinates=(),
    )


def expected(impulse: float = 1.0) -> np.ndarray:
    """Return sum_n Im[g_n exp((-d_n + 2 pi i f_n) t)], one second of it."""
    times = np.arange(RATE) / RATE
    turns = np.exp(np.outer(times, -DECAYS + 2j * np.pi * FREQUENCIES))
    return impulse * np.imag(turns @ OUTPUTS)


@pytest.mark.parametrize("axes", [0, 1, 2, 3])
def test_every_contact_is_the_recorded_one(axes: int) -> None:
    gains = SinglePoint(outputs=OUTPUTS)
    assert gains.at(np.full((4, axes), 0.3), NOWHERE).tolist() == np.ones((4, 1, 3)).tolist()
    assert gains.at(np.full(axes, 0.3), NOWHERE).shape == (1, 1, 3)


def test_sound_falls_with_the_distance_from_the_centre() -> None:
    centre = np.array([0.0, 0.2, 0.0])
    gains = SinglePoint(outputs=OUTPUTS, centre=centre)
    places = centre + np.diag([1.0, -4.0, 0.25])
    np.testing.assert_allclose(
        gains.toward(places)[:, 0], [OUTPUTS, OUTPUTS / 4, 4 * OUTPUTS], rtol=1e-14
    )
    with pytest.raises(ContactError, match="0 m from the body's centre"):
        gains.toward(np.stack([places[0], centre]))


def test_nobody_knows_its_directions_or_units_unless_told() -> None:
    gains = SinglePoint(outputs=OUTPUTS)
    assert (gains.calibrated, gains.directional, gains.rank) == (False, False, 1)
    assert SinglePoint(outputs=OUTPUTS, is_calibrated=True).calibrated


def test_a_strike_rings_as_recorded_at_one_metre() -> None:
    sound = render(model(), Strike(impulse=0.5), seconds=1, fade=0, sample_rate=RATE)
    np.testing.assert_allclose(sound.samples[0], expected(0.5), atol=1e-6)
    farther = render(
        model(), Strike(impulse=0.5), seconds=1, fade=0, listener=(0, 0, -2), sample_rate=RATE
    )
    np.testing.assert_allclose(farther.samples[0], expected(0.25), atol=1e-6)


def test_the_recorded_place_has_a_name_and_others_have_none() -> None:
    assert model().contact("recorded").point.shape == (0,)
    with pytest.raises(ContactError, match="the place is 'rim': give one of recorded"):
        model().contact("rim")
    with pytest.raises(ContactError, match=r"recorded at one place.*strike 'recorded'"):
        model().contact((0.0, 0.0, 0.1))


@pytest.mark.parametrize(("size", "density"), [(2.0, 1.0), (1.0, 3.0), (0.5, 0.7)])
def test_changed_bodies_sound_as_shapes_scale(size: float, density: float) -> None:
    """Both parts go with (density size^3)^(-1/2); what was at 1 m is at `size` m."""
    gains = SinglePoint(outputs=OUTPUTS, centre=np.array([0, 0.1, 0]), is_calibrated=True)
    modes = np.array([2, 0])
    changed = gains.changed(FREQUENCIES[modes], modes, size, density)
    before = gains.toward(np.array([[0, 0.1, 1.0]]))[0, 0, modes]
    after = changed.toward(size * np.array([[0, 0.1, 1.0]]))[0, 0]
    np.testing.assert_allclose(after, before / (density * size**3), rtol=1e-14)
    assert changed.calibrated
    assert model().scaled(2.0).frequencies[0] == pytest.approx(220, rel=1e-4)
