"""The blow of recordings is divided out, against bodies whose answer to a force is known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import struck
from struck.errors import OptionError
from struck.excitation.force_track import ForceTrack
from struck.excitation.strike import Strike
from struck.files import model_file
from struck.model.timbre_table import SinglePoint
from struck.recordings.fit import without_blow
from struck.recordings.takes import Take
from struck.synth.ring_down import Pulse, ring_down
from tests.excitation.recordings import DECAYS, FREQUENCIES, recorded

Complex = NDArray[np.complex128]
RATE = 48000
GAINS = np.array([40.0, 25.0, 30.0, -18.0, 12.0, 9.0]) + 0j
BLOW = Strike(impulse=0.02, duration=4e-4)


def take(blow: Strike, level: float = 60.0) -> Take:
    """Record a half-sine blow at 0.2 s, as it sounds at 1 m from a body of known gains."""
    pulse = Pulse(gains=blow.impulse * GAINS, onset=0.2, duration=blow.duration)
    sound = ring_down(FREQUENCIES, DECAYS, [pulse], sample_rate=RATE, length=RATE * 3 // 2)
    noise = np.abs(sound).max() * 10 ** (-level / 20)
    sound += noise * np.random.default_rng(0).standard_normal(len(sound))
    return Take(samples=sound, sample_rate=RATE)


@pytest.mark.prove
def test_gains_are_those_of_the_body_once_the_blow_is_divided_out() -> None:
    held = struck.fit([take_sound(BLOW)], cache=False)
    freed = struck.fit([take_sound(BLOW)], blow=BLOW, cache=False)
    nearest = np.abs(freed.frequencies - FREQUENCIES[:, None]).argmin(axis=1)
    sizes = np.abs(outputs(freed)[nearest])
    assert 20 * np.log10(sizes / np.abs(GAINS)) == pytest.approx(0, abs=0.5)
    # With the blow in them treble is missing: 0.4 ms last longer than half a period of 3.1 kHz.
    dull = 20 * np.log10(np.abs(outputs(held)[nearest]) / (0.02 * np.abs(GAINS)))
    assert dull[-1] < -5
    assert freed.gains.of_surface
    assert freed.provenance.details["divided_blow"] == {"impulse": 0.02, "duration": 4e-4}
    assert freed.of_object.tolist() == held.of_object.tolist()
    assert model_file.from_bytes(model_file.to_bytes(freed)).gains.of_surface


def take_sound(blow: Strike) -> struck.Sound:
    recorded_take = take(blow)
    return struck.Sound(samples=recorded_take.samples.astype(np.float32), sample_rate=RATE)


def outputs(model: struck.ModalModel) -> Complex:
    assert isinstance(model.gains, SinglePoint)
    return model.gains.outputs


@pytest.mark.parametrize("kind", ["one", "field", "round", "table"])
def test_the_blow_gives_back_what_was_recorded(kind: str) -> None:
    """Struck by the very blow, a model without it sounds as the one that holds it."""
    model = recorded(kind)
    freed = without_blow(model, BLOW)
    place = np.array([[1.0, 0.2, 0.3]])
    where = model.contact("recorded").point[None]
    begun = [
        (each.gains.at(where, np.zeros((1, 3)))[0] * each.gains.toward(place)[0]).sum(axis=0)
        for each in (model, freed)
    ]
    held = ring_down(
        FREQUENCIES, DECAYS, [Pulse(gains=begun[0], onset=0.1, duration=0.0)],
        sample_rate=RATE, length=RATE // 4,
    )  # fmt: skip
    again = ring_down(
        FREQUENCIES, DECAYS, [Pulse(gains=0.02 * begun[1], onset=0.1, duration=4e-4)],
        sample_rate=RATE, length=RATE // 4,
    )  # fmt: skip
    after = slice(round(0.101 * RATE), None)
    assert np.abs(again - held)[after].max() < 1e-9 * np.abs(held).max()


def test_modes_that_a_blow_hardly_drives_are_counted_and_bounded() -> None:
    """The half-sine of 1 ms has zeros at 1.5 and 2.5 kHz, and falls off beyond."""
    model = recorded("one")
    freed = without_blow(model, Strike(impulse=1.0, duration=1e-3))
    assert np.abs(outputs(freed) / outputs(model)).max() < 10.5
    assert any("were hardly driven by a blow of 0.001 s" in n for n in freed.provenance.dropped)


def test_freed_gains_need_no_note_and_default_to_a_striker() -> None:
    freed = without_blow(recorded("field"), BLOW)
    track = ForceTrack(at=(0.3,), force=np.ones(480), sample_rate=RATE)
    assert not struck.render(freed, track, seconds=0.1).notes
    assert "hold the blow" in struck.render(recorded("field"), track, seconds=0.1).notes[0]
    assert Strike().resolved(freed, freed.contact()).duration > 0


def test_blows_that_cannot_be_are_refused() -> None:
    with pytest.raises(OptionError, match="residual=True keeps the attack"):
        struck.fit([take_sound(BLOW)], blow=BLOW, residual=True, cache=False)
    with pytest.raises(OptionError, match="blow has the shape 'gaussian'"):
        struck.fit([take_sound(BLOW)], blow=Strike(impulse=1, shape="gaussian"), cache=False)
    with pytest.raises(OptionError, match="for a force in N already"):
        without_blow(without_blow(recorded("one"), BLOW), BLOW)
