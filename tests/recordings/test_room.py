"""Modes of a room told from those of an object, by how long they last."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import fftconvolve

from struck.errors import OptionError, RecordingError
from struck.recordings.fit import fit_recordings
from struck.recordings.residual_sound import may_be_of_room, reverberation
from struck.recordings.takes import Take
from struck.report.fit_page import report
from tests.recordings.strings import DECAYS, FREQUENCIES, ONSET, RATE, gains, noise, ringing, take


def echo(seconds: float, seed: int, length: float = 1.5) -> np.ndarray:
    """Return what a room answers to a click: noise that falls by 60 dB in so many seconds."""
    times = np.arange(round(length * RATE)) / RATE
    return np.random.default_rng(seed).standard_normal(len(times)) * 1000 ** (-times / seconds)


@pytest.mark.parametrize("seconds", [0.2, 0.5, 1.0])
def test_a_clap_tells_the_reverberation(seconds: float) -> None:
    room = np.pad(echo(seconds, 1), (round(ONSET * RATE), 0))
    clap = take(room + noise(len(room), 50, 2))
    assert reverberation(clap) == pytest.approx(seconds, rel=0.1)


def test_a_time_is_taken_as_it_is_and_what_is_none_refused() -> None:
    assert reverberation(0.4) == 0.4
    with pytest.raises(OptionError, match=r"0\.01 to 30"):
        reverberation(0.0)
    with pytest.raises(RecordingError, match="no clap"):
        reverberation(take(noise(RATE, 20, 3)))
    soft = np.pad(echo(0.5, 4), (round(ONSET * RATE), 0))
    soft *= 0.2 / np.abs(soft).max()
    with pytest.raises(RecordingError, match="clap louder"):
        reverberation(take(soft + noise(len(soft), 30, 5)))


def test_slower_modes_than_the_room_are_the_objects() -> None:
    rates = np.log(1000) / np.array([2.0, 0.8, 0.4, 0.1])
    assert may_be_of_room(rates, 0.4).tolist() == [False, False, True, True]


@pytest.mark.prove
@pytest.mark.parametrize("level", [40, pytest.param(60, marks=pytest.mark.prove)])
def test_an_object_in_a_room_keeps_its_slow_modes(level: float) -> None:
    """A room of 0.3 s, 6 dB below the direct sound: what it adds is told, the object is not."""
    direct = ringing(gains(np.array(0.05))[0])
    answer = fftconvolve(direct, echo(0.3, 6))[: len(direct)]
    answer *= 0.5 * np.linalg.norm(direct) / np.linalg.norm(answer)
    heard = take(direct + answer + noise(len(direct), level, 7))
    made = fit_recordings(heard, modes=None, room=0.3, cache=False)
    slow = ~may_be_of_room(DECAYS, 0.3 / 0.8)
    nearest = np.abs(made.model.frequencies[:, None] - FREQUENCIES[slow]).argmin(axis=0)
    assert not made.room[nearest].any()
    others = np.setdiff1d(np.arange(len(made.room)), nearest)
    # The crowd is left out of the model: what stays of the room are one or two modes of many.
    assert np.count_nonzero(~made.room[others]) <= 1
    assert len(others) <= 5
    dropped = made.model.provenance.dropped
    assert any("left out of the model as modes of the room" in note for note in dropped)
    assert any("as fast as the room" in note for note in made.model.provenance.dropped)
    assert "perhaps" in report(made)


def test_nobody_told_of_a_room() -> None:
    direct = ringing(gains(np.array(0.05))[0])
    made = fit_recordings(take(direct + noise(len(direct), 60, 8)), cache=False)
    assert made.room is None
    assert isinstance(made.recorded.takes[0], Take)
