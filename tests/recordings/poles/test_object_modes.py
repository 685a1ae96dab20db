"""The object's modes of takes with noise: all true ones, and none that stands for the blow."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import struck
from struck import Strike
from struck.cli import main
from struck.model.model import ModalModel
from struck.report.model_page import summary
from struck.shapes import Bar

Array = NDArray[np.float64]
RATE = 48_000


@pytest.fixture(scope="module")
def bar() -> ModalModel:
    return struck.analyze(Bar(length=0.3, width=0.03, thickness=0.005, ends="free"), "steel")


def take(bar: ModalModel, path: Path, noise: float = 1e-4, seed: int = 0, **blow: float) -> Path:
    """Save a take of the bar, struck at `at` for `seconds` of sound, after noise alone."""
    seconds, at = blow.pop("seconds", 3.0), blow.pop("at", 0.1)
    strike = Strike(at=(at,), **blow)
    sound = struck.render(bar, strike, seconds=seconds, listener=(0, 0, 0.3), fade=0)
    samples = np.pad(0.5 * sound.samples[0] / sound.peak, (30_000, 0))
    chance = np.random.default_rng(seed)
    samples = np.float32(samples + noise * chance.standard_normal(len(samples)))
    struck.Sound(samples=samples, sample_rate=RATE).save(path, level="peak")
    return path


def false_and_true(bar: ModalModel, fitted: ModalModel) -> tuple[Array, int]:
    """Return the object's modes that are none of the bar, Hz, and how many of the bar's are there.

    A mode is that of the bar within 1 Hz; broad modes near one are none.
    """
    own = fitted.frequencies[fitted.of_object]
    slow = fitted.decays[fitted.of_object] < 20
    away = np.abs(own[:, None] - bar.frequencies)
    right = (away.min(axis=1) < 1) & slow
    return own[~right], len(np.unique(away.argmin(axis=1)[right]))


CASES = {
    "ideal": {"impulse": 1e-3},
    "0.4 ms": {"impulse": 1e-3, "duration": 4e-4},
    "felt": {"striker": "felt", "speed": 1.0, "at": 0.02},
    "wood": {"striker": "wood", "speed": 0.5, "at": 0.02, "seconds": 1.5},
    "steel": {"striker": "steel", "speed": 1.0, "at": 0.02, "seconds": 0.5},
    "short": {"striker": "wood", "speed": 0.5, "at": 0.02, "seconds": 0.5, "noise": 1e-3},
}


@pytest.mark.parametrize("case", CASES)
def test_every_mode_of_a_bar_is_found_and_no_other(
    bar: ModalModel, case: str, tmp_path: Path
) -> None:
    fitted = struck.fit(take(bar, tmp_path / "tap.wav", **CASES[case]), cache=False)
    false, count = false_and_true(bar, fitted)
    assert not false.size, false
    assert count == 12
    assert fitted.errors is not None
    assert fitted.errors[fitted.of_object].max() < 0.3


def test_several_short_takes_hold_no_mode_of_their_blows(bar: ModalModel, tmp_path: Path) -> None:
    takes = [
        take(bar, tmp_path / f"{n}.wav", seed=n, at=at, impulse=1e-3, seconds=1.0)
        for n, at in enumerate((0.02, 0.1, 0.155, 0.25))
    ]
    fitted = struck.fit(takes, cache=False)
    false, count = false_and_true(bar, fitted)
    assert not false.size, false
    assert count == 12


def test_shell_page_and_python_count_alike(
    bar: ModalModel, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The README's take in more noise, 54 dB below its peak."""
    path = take(bar, tmp_path / "tap.wav", 1e-3, at=0.02, seconds=1.5, striker="wood")
    model, page = tmp_path / "tap.struck", tmp_path / "tap.html"
    fitted = struck.fit(path, report=page, cache=False)
    struck.save(fitted, model)
    own = fitted.of_object
    assert fitted.frequencies[own][:3] == pytest.approx([287.96, 792.29, 1548.98], abs=0.1)
    assert main(["info", str(model)]) == 0
    count = f"{np.count_nonzero(own)} modes"
    assert capsys.readouterr().out.startswith(count)
    assert f"<li>{count} from" in page.read_text(encoding="utf-8")
    assert summary(fitted)[0].startswith(count)
