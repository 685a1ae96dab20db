"""The block transform against exponentials in double precision and SciPy's recursive filter."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from struck.errors import OptionError
from struck.synth.block_transform import BLOCKS, HEAVIEST, BlockTransform, suits, wins

RATE = 48000.0
PROMISED = -120.0
"""dB: error over signal, of root mean squares as of peaks."""

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


def some_poles(
    count: int,
    seed: int,
    decays: tuple[float, float] = (0.5, 200.0),
    frequencies: tuple[float, float] = (30.0, 18000.0),
) -> Complex:
    chance = np.random.default_rng(seed)
    decay = np.exp(chance.uniform(*np.log(decays), count))
    return -decay + 2j * np.pi * np.exp(chance.uniform(*np.log(frequencies), count))


def noise(seed: int, *shape: int) -> Array:
    return np.random.default_rng(seed).standard_normal(shape)


def complex_noise(seed: int, *shape: int) -> Complex:
    return noise(seed, *shape) + 1j * noise(seed + 1000, *shape)


def error(samples: NDArray[np.inexact], exact: NDArray[np.inexact]) -> float:
    """Return the larger error, of the mean square or of the peak, in dB."""
    wrong, right = np.abs(samples - exact), np.abs(exact)
    mean = np.sqrt(np.mean(wrong**2) / np.mean(right**2))
    return float(20 * np.log10(max(mean, wrong.max() / right.max())))


def waves(poles: Complex, times: Array) -> Complex:
    return np.exp(np.outer(poles / RATE, times))


def pushed_through(
    transform: BlockTransform, force: Array, drive: Array, outputs: Complex
) -> Array:
    """Play a force block by block, from silence."""
    block = transform.block
    states = np.zeros(transform.modes, dtype=complex)
    answers = [transform.answer(output * drive) for output in outputs]
    sound = np.zeros((len(outputs), len(force)))
    for first in range(0, len(force), block):
        part, into = force[first : first + block], np.zeros((len(outputs), block))
        transform.ringing(states, outputs, into)
        for answer, row in zip(answers, into, strict=True):
            transform.pushed(part, answer, row)
        transform.advance(states)
        transform.absorb(states, part, drive)
        sound[:, first : first + block] = into
    return sound


def filtered(poles: Complex, forces: Array) -> Complex:
    """Return c[k] = z c[k-1] + F[k] of each mode by SciPy, each with its own force."""
    steps = np.exp(poles / RATE)
    return np.array([lfilter([1.0], [1.0, -z], f) for z, f in zip(steps, forces, strict=True)])


@pytest.mark.parametrize("block", [16, 64, 100, 128, 513, 1024, 4096])
def test_every_mode_is_exact_whatever_its_frequency_and_decay(block: int) -> None:
    nepers = np.array([0.0, 0.3, 1.0, 1.99, 2.0, 3.1, 4.0, 7.9, HEAVIEST])
    frequencies = RATE / 2 * np.array([0.0, 1e-4, 0.011, 0.5003, 0.97, 0.9999, 1 - 1e-12])
    poles = (-nepers[:, None] * RATE / block + 2j * np.pi * frequencies).ravel()
    transform = BlockTransform(poles, RATE, block)
    exact = waves(poles[transform.order], np.arange(block))
    for which, single in enumerate(np.eye(len(poles))):
        sine, cosine = transform.answer(single + 0j), transform.answer(1j * single)
        assert error(cosine + 1j * sine, exact[which]) <= PROMISED - 5


@pytest.mark.parametrize("block", [64, 128, 1024])
@pytest.mark.parametrize("seconds", [0, 1, 10])
def test_ring_down_stays_exact(block: int, seconds: float) -> None:
    poles = some_poles(400, 1)
    transform = BlockTransform(poles, RATE, block)
    poles = poles[transform.order]
    states, outputs = complex_noise(2, 400), complex_noise(3, 2, 400)
    begun = states.copy()
    blocks = int(seconds * RATE / block)
    for _ in range(blocks):
        transform.advance(states)
    samples = np.ones((2, block))  # to be added to
    transform.ringing(states, outputs, samples)
    exact = ((outputs * begun) @ waves(poles, np.arange(block) + float(blocks * block))).imag
    assert error(samples - 1.0, exact) <= PROMISED


@pytest.mark.parametrize("block", [16, 64, 100, 128, 512, 2048, 4096])
def test_dense_noise_is_that_of_recursive_filters(block: int) -> None:
    poles = some_poles(150, 4, decays=(0.5, 4 * RATE / block))
    transform = BlockTransform(poles, RATE, block)
    poles = poles[transform.order]
    drive, outputs, force = noise(5, 150), complex_noise(6, 2, 150), noise(7, 4 * block)
    exact = (outputs @ (drive[:, None] * filtered(poles, np.tile(force, (150, 1))))).imag
    sound = pushed_through(transform, force, drive, outputs)
    assert error(sound[:, block:], exact[:, block:]) <= PROMISED
    assert error(sound[:, :block], exact[:, :block]) <= PROMISED


@pytest.mark.parametrize("block", [16, 100, 512])
def test_what_a_force_leaves_is_its_sum_over_the_block(block: int) -> None:
    poles = some_poles(203, 8, decays=(0.5, HEAVIEST * RATE / block))
    transform = BlockTransform(poles, RATE, block)
    force = noise(9, block)
    exact = waves(poles[transform.order], np.arange(block, 0, -1)) @ force
    assert error(transform.collected(force), exact) <= PROMISED


def test_many_modes_in_one_bin_add_up_exactly() -> None:
    poles = some_poles(20000, 10, frequencies=(30.0, 180.0))
    transform = BlockTransform(poles, RATE, 128)
    poles, exact = poles[transform.order], np.zeros(128)
    weights = complex_noise(11, 20000)
    for first in range(0, 20000, 4000):
        part = slice(first, first + 4000)
        exact += (weights[part] @ waves(poles[part], np.arange(128))).imag
    assert error(transform.answer(weights), exact) <= PROMISED


def test_gains_change_linearly_as_told() -> None:
    block, count = 128, 150
    poles = some_poles(count, 12)
    transform = BlockTransform(poles, RATE, block)
    poles = poles[transform.order]
    (old_drive, new_drive), (old, new) = noise(13, 2, count), complex_noise(14, 2, count)
    tau, force, states = np.arange(1, block + 1) / block, noise(15, block), complex_noise(16, count)

    ramped = old_drive[:, None] * (1 - tau) + new_drive[:, None] * tau
    forced = np.concatenate([ramped * force, np.zeros((count, 1))], axis=1)
    moved = filtered(poles, forced) + states[:, None] * waves(poles, np.arange(block + 1))
    exact = (moved[:, :-1] * (old[:, None] * (1 - tau) + new[:, None] * tau)).sum(axis=0).imag

    sounds = np.zeros((2, block))
    transform.ringing(states, np.array([old, new]), sounds)
    transform.advance(states)
    for drive, part in ((old_drive, (1 - tau) * force), (new_drive, tau * force)):
        transform.pushed(part, transform.answer(old * drive), sounds[0])
        transform.pushed(part, transform.answer(new * drive), sounds[1])
        transform.absorb(states, part, drive)
    assert error((1 - tau) * sounds[0] + tau * sounds[1], exact) <= PROMISED
    assert error(states, moved[:, -1]) <= PROMISED


def test_real_outputs_are_complex_outputs_without_a_turn() -> None:
    poles = some_poles(50, 17)
    transform = BlockTransform(poles, RATE, 64)
    states, outputs, plain, turned = complex_noise(18, 50), noise(19, 3, 50), *np.zeros((2, 3, 64))
    transform.ringing(states, outputs, plain)
    transform.ringing(states, outputs + 0j, turned)
    assert np.abs(plain).max() > 1
    np.testing.assert_array_equal(plain, turned)


def test_modes_that_decay_too_fast_do_not_suit() -> None:
    limit = HEAVIEST * RATE / 512
    poles = np.array([-1.0, -limit, -limit * (1 + 1e-9)]) + 1000j
    assert suits(poles, RATE, 512).tolist() == [True, True, False]
    assert suits(poles, RATE, 256).all()
    with pytest.raises(OptionError, match="mode 2 decays by more than 16 nepers in a block of 512"):
        BlockTransform(poles, RATE, 512)


@pytest.mark.parametrize(
    ("poles", "block", "said"),
    [
        ([-1 + 1000j], BLOCKS[0] - 1, "block is 15 samples: 16 to 4096"),
        ([-1 + 1000j], BLOCKS[1] + 1, "block is 4097"),
        ([], 128, "shape \\(0,\\)"),
        ([-1 + 1000j, complex(np.nan, 1000)], 128, "of mode 1 must be finite"),
        ([complex(-np.inf, 1000)], 128, "must be finite"),
        ([0.1 + 1000j], 128, "decay"),
        ([-1 - 1000j], 128, "turn at 0 to 24000 Hz"),
        ([-1 + 1j * np.pi * RATE], 128, "leave out modes above half the sample rate"),
    ],
)
def test_impossible_plans_are_refused(poles: list[complex], block: int, said: str) -> None:
    with pytest.raises(OptionError, match=said):
        BlockTransform(np.array(poles, dtype=complex), RATE, block)


def test_arrays_of_another_length_are_refused() -> None:
    transform = BlockTransform(some_poles(10, 20), RATE, 64)
    states, short, gains = np.zeros(10, dtype=complex), np.zeros(9, dtype=complex), np.zeros(10)
    calls: list[Callable[[], object]] = [
        lambda: transform.ringing(short, gains[None], np.zeros((1, 64))),
        lambda: transform.ringing(states, gains[None, 1:], np.zeros((1, 64))),
        lambda: transform.ringing(states, gains[None], np.zeros((2, 64))),
        lambda: transform.ringing(states, gains[None], np.zeros((1, 63))),
        lambda: transform.advance(short),
        lambda: transform.absorb(short, np.zeros(64), gains),
        lambda: transform.absorb(states, np.zeros(65), gains),
        lambda: transform.absorb(states, np.zeros(64), gains[1:]),
        lambda: transform.collected(np.zeros(63)),
        lambda: transform.pushed(np.zeros(64), np.zeros(63), np.zeros(64)),
    ]
    for call in calls:
        with pytest.raises(OptionError, match="has shape"):
            call()


def thread_time_of(call: Callable[[], object], turns: int = 15) -> float:
    taken = []
    for _ in range(turns):
        begun = time.thread_time()
        for _ in range(5):
            call()
        taken.append((time.thread_time() - begun) / 5)
    return min(taken)


def test_a_block_stays_fast() -> None:
    # 16384 modes for 128 samples are two million samples of modes. SciPy's filter, one sample of
    # one mode after the other, gives the speed of the machine.
    transform = BlockTransform(some_poles(16384, 21), RATE, 128)
    states, gains, force, into = (
        np.ones(16384) + 0j,
        noise(22, 16384),
        noise(23, 128),
        noise(0, 1, 128),
    )
    signal = noise(24, 40000)

    def one_block() -> None:
        transform.ringing(states, gains[None], into)
        transform.advance(states)
        transform.absorb(states, force, gains)

    one_block()
    filters = (
        16384 * 128 / 40000 * thread_time_of(lambda: lfilter([1.0], [1.0, -1.9, 0.95], signal))
    )
    assert filters > 40 * thread_time_of(one_block), "some loop over modes is no longer vectors"


def test_it_is_chosen_for_many_modes_and_long_blocks() -> None:
    assert wins(16384, 128)
    assert wins(65536, 512)
    assert not wins(256, 128)
    assert not wins(1024, 32)
