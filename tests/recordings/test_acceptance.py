"""Takes that are accepted, and the reasons on which others are refused."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pytest

from struck.files.sound import Sound
from struck.recordings.acceptance import MARGIN, Bounds, TakeVerdict, examine_take
from tests.recordings.hits import LEAD_IN, ONSET, RATE, SECONDS, clip, end_early, hit

Change = Callable[[np.ndarray], np.ndarray]


def judged(samples: np.ndarray, bounds: Bounds | None = None) -> TakeVerdict:
    sound = Sound(samples=samples.astype(np.float32), sample_rate=RATE)
    return examine_take(
        sound,
        lead_in=LEAD_IN,
        seconds=SECONDS,
        bounds=bounds or Bounds(),
        channels=len(samples),
    )


def changed(change: Change, **given: float) -> np.ndarray:
    return change(hit(**given))  # type: ignore[arg-type] - numbers alone


def clip_early(samples: np.ndarray) -> np.ndarray:
    return np.clip(samples, -0.2, 0.2)


def drop(samples: np.ndarray) -> np.ndarray:
    lost = samples.copy()
    lost[:, round(0.4 * RATE) : round(0.42 * RATE)] = 0
    return lost


def bounce(samples: np.ndarray) -> np.ndarray:
    return 0.7 * (samples + 0.9 * hit(onset=ONSET + 0.2, seed=2))


def cut(samples: np.ndarray) -> np.ndarray:
    return samples[:, : round(0.5 * RATE)]


def deafen(samples: np.ndarray) -> np.ndarray:
    return np.concatenate([samples, hit(peak=1e-9)])


REFUSED = {
    "clipped": (clip, {}, "channel 1 is clipped: .* samples at full scale; turn the gain down"),
    "clipped before": (clip_early, {}, "flat at -14.0 dB; turn the preamplifier down"),
    "lost samples": (drop, {}, "lost samples: 20 ms are exact zeros"),
    "bounce": (bounce, {}, "struck twice, 0.20 s apart"),
    "cut short": (cut, {}, "ends 0.25 s after the hit, and 0.4 s are planned"),
    "late": (np.copy, {"onset": 0.5}, "ends 0.30 s after the hit"),
    "no lead-in": (end_early, {}, "lasts 0.10 s, the lead-in alone 0.2 s"),
    "early": (np.copy, {"onset": 0.11}, "something sounds 0.11 s into the lead-in"),
    "quiet": (np.copy, {"peak": 5e-3}, "channel 1 is too quiet: its peak is -4"),
    "loud": (np.copy, {"peak": 0.95}, "channel 1 is too loud: its peak is -0.4 dB"),
    "nothing": (np.copy, {"peak": 1e-9}, "channel 1 hears no hit"),
    "in noise": (np.copy, {"noise": 0.1}, "channel 1 hears no hit: its peak is 1"),
    "one is deaf": (deafen, {}, "channel 2 hears no hit"),
}


@pytest.mark.parametrize("fault", REFUSED)
def test_a_bad_take_is_refused_with_its_reason(fault: str) -> None:
    change, given, words = REFUSED[fault]
    verdict = judged(changed(change, **given))
    assert verdict.sound is None
    assert re.search(words, verdict.reason), verdict.reason


@pytest.mark.parametrize("onset", [0.21, 0.2534, 0.39])
def test_a_take_is_kept_from_its_lead_in_to_its_planned_end(onset: float) -> None:
    samples = hit(onset=onset)
    verdict = judged(samples)
    assert verdict.reason == ""
    assert verdict.sound is not None
    kept = verdict.sound.samples[0]
    before = len(kept) - round(SECONDS * RATE)
    assert before / RATE == pytest.approx(LEAD_IN + MARGIN, abs=2e-3)
    quiet, rung = kept[: round(LEAD_IN * RATE)], kept[before : before + RATE // 50]
    assert np.abs(quiet).max() < 6e-4
    assert np.abs(rung).max() > 0.4
    first = round(onset * RATE) - before
    assert any(
        np.array_equal(kept, samples[0, n : n + len(kept)].astype(np.float32))
        for n in range(first - 20, first + 20)
    )
    assert verdict.peak == pytest.approx(20 * np.log10(0.5), abs=0.02)
    assert verdict.above_noise == pytest.approx(20 * np.log10(0.5 / 1e-4), abs=0.3)


def test_beats_a_long_rise_and_digital_silence_are_no_second_hit_and_no_loss() -> None:
    times = np.arange(round(3 * RATE)) / RATE - 0.25
    beat = np.sin(2 * np.pi * 900 * times) + np.sin(2 * np.pi * 904 * times)
    rung = np.where(times >= 0, beat * np.exp(-times) * (1 - np.exp(-times / 5e-3)), 0.0)
    verdict = judged((0.2 * rung)[None])
    assert verdict.reason == ""
    gone = np.where(times < 0.2, rung, 0.0)
    assert judged((0.2 * gone)[None]).reason == ""  # not even the room was heard


def test_bounds_can_be_changed() -> None:
    assert "too loud" in judged(hit(), Bounds(loudest=-10)).reason
    assert "too quiet" in judged(hit(), Bounds(quietest=-3)).reason
    assert "no hit" in judged(hit(), Bounds(above_noise=90)).reason
    assert judged(hit(peak=5e-3), Bounds(quietest=-60)).reason == ""
