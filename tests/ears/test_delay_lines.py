"""Delay lines against plain NumPy, and against shifted sines."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.ears import delay_lines
from struck.ears.delay_lines import READ, DelayLines, Paths

Array = NDArray[np.float64]
RATE = 48000


def played(
    hear: Callable[..., None], monkeypatch: pytest.MonkeyPatch, block: int = 128, taps: int = 21
) -> Array:
    random = np.random.default_rng(3)
    monkeypatch.setattr(delay_lines, "hear", hear)
    count = 6
    delayed = DelayLines(lines=3, paths=count, block=block, longest=900, taps=taps)
    before = random.standard_normal((count, taps)).astype(np.float32)
    heard = []
    for _ in range(20):
        after = random.standard_normal((count, taps)).astype(np.float32)
        paths = Paths(
            lines=np.arange(count) // 2,
            ears=np.arange(count) % 2,
            delays=random.uniform(READ / 2, 900, (count, 3)),
            gains=random.standard_normal((count, 3)),
            before=before,
            after=after,
            stretch=2 * block,
        )
        before = after
        for since in (0, block):
            samples = random.standard_normal((3, block))
            heard.append(delayed.next_block(samples, paths, 2, since=since))
    return np.concatenate(heard, axis=1)


@pytest.mark.parametrize(("block", "taps"), [(128, 21), (64, 256), (1, 8), (1024, 1)])
def test_compiled_as_in_plain_numpy(monkeypatch: pytest.MonkeyPatch, block: int, taps: int) -> None:
    compiled = played(delay_lines.hear, monkeypatch, block, taps)
    plain = played(delay_lines.hear_plainly, monkeypatch, block, taps)
    np.testing.assert_allclose(compiled, plain, atol=2e-6 * np.abs(plain).max())


def shifted(frequency: float, delay: float, block: int = 128) -> tuple[Array, Array]:
    """Return a delayed sine, and what it should be."""
    numbers = np.arange(4096)
    sine = np.sin(2 * np.pi * frequency * numbers / RATE)
    delayed = DelayLines(lines=1, paths=1, block=block, longest=delay, taps=1)
    unit = np.ones((1, 1), np.float32)
    paths = Paths(
        lines=np.zeros(1, np.int64),
        ears=np.zeros(1, np.int64),
        delays=np.full((1, 3), delay),
        gains=np.full((1, 3), 0.5),
        before=unit,
        after=unit,
        stretch=block,
    )
    heard = [delayed.next_block(sine[None, k : k + block], paths, 1) for k in range(0, 4096, block)]
    wanted = 0.5 * np.sin(2 * np.pi * frequency * (numbers - delay) / RATE)
    return np.concatenate(heard, axis=1)[0], wanted


@pytest.mark.parametrize("frequency", [100.0, 1000.0, 8000.0, 16000.0, 19200.0])
@pytest.mark.parametrize("delay", [16.0, 33.25, 500.71, 1999.999])
def test_a_sine_comes_late_by_what_was_asked_between_samples_too(
    frequency: float, delay: float
) -> None:
    heard, wanted = shifted(frequency, delay)
    settled = slice(int(delay) + READ, None)
    assert np.abs(heard - wanted)[settled].max() <= 0.5 * 10 ** (-85 / 20)


def test_delays_may_grow_as_long_as_a_way_does_at_less_than_the_speed_of_sound() -> None:
    delayed = DelayLines(lines=1, paths=1, block=64, longest=20, taps=1)
    unit, zero = np.ones((1, 1), np.float32), np.zeros(1, np.int64)
    samples = np.random.default_rng(1).standard_normal(64 * 40)
    for k in range(0, len(samples), 64):
        late = 20.0 + 40 * (k // 64)
        delayed.lengthen(late)
        paths = Paths(
            lines=zero,
            ears=zero,
            delays=np.full((1, 3), late),
            gains=np.ones((1, 3)),
            before=unit,
            after=unit,
            stretch=64,
        )
        heard = delayed.next_block(samples[None, k : k + 64], paths, 1)[0]
        wanted = np.pad(samples, (int(late), 0))[k : k + 64]
        np.testing.assert_allclose(heard, wanted, atol=1e-6)
