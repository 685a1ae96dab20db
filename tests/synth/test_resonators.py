"""Resonators against closed forms, SciPy's filters, and plain NumPy that steps no sample."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
import pytest

from struck.errors import OptionError
from struck.excitation.excitation import Push
from struck.synth.resonators import Resonators
from tests.samples import sampled
from tests.synth.scenes import RATE, Array, Bank, Complex, bank, decibels, exactly, reference

BLOCKS = (1, 17, 64, 128, 4096)


def gains(random: np.random.Generator, points: int, modes: int) -> Complex:
    return random.standard_normal((points, modes)) + 1j * random.standard_normal((points, modes))


def played(resonators: Resonators, force: Array, drive: Array, outputs: Complex) -> Array:
    """Return what one body sounds like under a force (points, samples)."""
    block = resonators.block
    return np.concatenate(
        [
            resonators.process(
                [Push(force=force[k : k + block], drive=drive)], [outputs] if k == 0 else ()
            )[0].copy()
            for k in range(0, len(force), block)
        ],
        axis=1,
    )


def test_ring_down_for_ten_seconds_is_the_closed_form() -> None:
    random = np.random.default_rng(1)
    modes, seconds = bank(random, 200), 10
    drive, outputs = random.standard_normal(200), gains(random, 1, 200)
    resonators = Resonators([modes])
    blow = np.zeros(128)
    blow[0] = RATE
    heard = [resonators.process([Push(force=blow, drive=drive)], [outputs])[0, 0].copy()]
    heard += [resonators.process()[0, 0].copy() for _ in range(seconds * RATE // 128)]
    samples = np.concatenate(heard)
    some = random.integers(1, len(samples), 2000)
    poles = (-modes.decays + 2j * np.pi * modes.frequencies) / RATE
    expected = (np.exp(np.outer(some, poles)) @ (drive * outputs[0])).imag
    assert 20 * np.log10(np.abs(samples[some] - expected).max() / np.abs(samples).max()) <= -190


@cache
def dense_noise() -> tuple[Bank, Array, Complex, Array, Array]:
    """Return modes, drive, outputs, ten seconds of force, and what filters make of them."""
    random = np.random.default_rng(2)
    modes = bank(random, 40)
    drive, outputs = random.standard_normal(40), gains(random, 2, 40)
    force = random.standard_normal(10 * RATE)
    return modes, drive, outputs, force, exactly(modes, outputs, drive, force)


@pytest.mark.parametrize("block", sampled(BLOCKS, 64, 128, 4096))
def test_dense_noise_is_what_filters_make(block: int) -> None:
    modes, drive, outputs, force, exact = dense_noise()
    count = (RATE // 20 if block == 1 else len(force)) // block * block
    resonators = Resonators([modes], block=block, points=2, voices=1)
    heard = played(resonators, force[:count], drive, outputs)
    expected = exact[:, :count]
    assert decibels(heard - expected, expected) <= -200


@pytest.mark.parametrize("block", BLOCKS)
def test_blocks_of_any_length_sound_the_same(block: int) -> None:
    random = np.random.default_rng(3)
    modes, count = bank(random, 30), 17 * 4096
    drive, outputs = random.standard_normal(30), gains(random, 1, 30)
    force = random.standard_normal(count) * (np.arange(count) % 9000 < 3000)
    if block == 1:
        force = force[:6000]
    heard = played(Resonators([modes], block=block), force, drive, outputs)
    alike = played(
        Resonators([modes], block=1024), force[: len(force) // 1024 * 1024], drive, outputs
    )
    shared = min(heard.shape[1], alike.shape[1])
    assert decibels(heard[:, :shared] - alike[:, :shared], alike) <= -200


# Each number of outputs, real or complex, for so many voices has loops of its own to compile.
@pytest.mark.parametrize(
    ("block", "points", "bodies", "voices", "begun"),
    [
        (128, 1, 1, 1, 3),
        (128, 2, 1, 1, 0),
        (100, 1, 3, 3, 0),
        (7, 1, 3, 5, 0),
        pytest.param(100, 1, 3, 3, 3, marks=pytest.mark.prove),
        pytest.param(128, 2, 3, 1, 3, marks=pytest.mark.prove),
        pytest.param(64, 2, 3, 6, 3, marks=pytest.mark.prove),
        pytest.param(64, 3, 3, 6, 3, marks=pytest.mark.prove),
        pytest.param(17, 9, 3, 9, 3, marks=pytest.mark.prove),
    ],
)
def test_moving_gains_and_poles_as_in_plain_numpy(
    block: int, points: int, bodies: int, voices: int, begun: int
) -> None:
    """Outputs are first given in the block `begun`; until then they are real: nought."""
    random = np.random.default_rng(4)
    models = [bank(random, count, highest=30000.0) for count in (30, 51, 8)[:bodies]]
    sizes = [len(model.frequencies) for model in models]
    options = {"block": block, "points": points, "voices": 1 if bodies == 1 else 40}
    both = Resonators(models, **options), reference(models, **options)
    assert both[0].dropped == both[1].dropped
    heard: Sequence[list[Array]] = ([], [])
    for step in range(60):
        pushes = [
            Push(
                force=random.standard_normal(block),
                drive=random.standard_normal(size),
                body=body,
                voice=voice,
            )
            for body, size in enumerate(sizes)
            for voice in range(voices if body else 1)
            if step % 20 < 10
        ]
        outputs = [gains(random, points, size) for size in sizes] if step % 7 == begun else []
        for resonators, samples in zip(both, heard, strict=True):
            if step == 35:
                body = min(1, bodies - 1)
                changed = Bank(models[body].frequencies * 1.1, models[body].decays * 3)
                resonators.change(body, changed)
            samples.append(resonators.process(pushes, outputs).copy())
    expected = np.array(heard[1])
    assert decibels(np.array(heard[0]) - expected, expected) <= -200


@pytest.mark.parametrize(
    ("block", "points"),
    [
        (128, 1),
        pytest.param(64, 2, marks=pytest.mark.prove),
        pytest.param(8, 8, marks=pytest.mark.prove),
        pytest.param(8, 2, marks=pytest.mark.prove),
        (8, 1),
        (100, 1),
        (7, 1),
    ],
)
def test_pushes_that_stay_as_they_are_and_change_by_chance(block: int, points: int) -> None:
    random = np.random.default_rng(14)
    size = 41
    model = bank(random, size, highest=30000.0)
    both = (
        Resonators([model], block=block, points=points),
        reference([model], block=block, points=points),
    )
    # Half of the modes of each drive have a node there.
    drives = [random.standard_normal(size) * random.integers(0, 2, size) for _ in range(4)]
    heard: Sequence[list[Array]] = ([], [])
    voices = {0: drives[0]}
    for step in range(300):
        if random.random() < 0.2:
            count = random.choice(3, p=[0.2, 0.6, 0.2])
            chosen = random.choice(3, count, replace=False).tolist()
            voices = {voice: drives[random.integers(4)] for voice in chosen}
        pushes = [
            Push(force=random.standard_normal(block), drive=drive, voice=voice)
            for voice, drive in voices.items()
        ]
        moves = step == 0 or random.random() < 0.1
        outputs = [gains(random, points, size)] if moves else []
        changed = Bank(model.frequencies * random.uniform(0.9, 1.1), model.decays)
        for resonators, samples in zip(both, heard, strict=True):
            if step % 40 == 39:
                resonators.change(0, changed)
            samples.append(resonators.process(pushes, outputs).copy())
    expected = np.array(heard[1])
    assert decibels(np.array(heard[0]) - expected, expected) <= -200


def test_a_hundred_bodies_sound_as_they_do_alone() -> None:
    random = np.random.default_rng(5)
    models = [bank(random, count) for count in random.integers(1, 40, 100)]
    force = random.standard_normal(4 * 128)
    drives = [random.standard_normal(len(model.frequencies)) for model in models]
    outputs = [gains(random, 1, len(drive)) for drive in drives]
    together = Resonators(models)
    heard = [
        together.process(
            [
                Push(force=force[k : k + 128], drive=drive, body=body)
                for body, drive in enumerate(drives)
            ],
            outputs if k == 0 else (),
        ).copy()
        for k in range(0, len(force), 128)
    ]
    for body in (0, 41, 99):
        alone = played(Resonators([models[body]]), force, drives[body], outputs[body])
        assert np.array_equal(np.hstack([each[body] for each in heard]), alone)


def test_a_body_sleeps_and_wakes_as_the_one_it_would_have_been() -> None:
    random = np.random.default_rng(6)
    modes = bank(random, 50, decays=(20.0, 200.0))
    drive, outputs = random.standard_normal(50), gains(random, 1, 50)
    resonators = Resonators([modes], quiet=1e-4)
    force = np.zeros((800, 128))
    force[0, 0] = force[700, 5] = RATE
    heard, asleep = [], []
    for k, some in enumerate(force):
        pushes = [Push(force=some, drive=drive)] if some.any() else []
        heard.append(resonators.process(pushes, [outputs] if k == 0 else ())[0].copy())
        asleep.append(bool(resonators.asleep[0]))
    assert [asleep[k] for k in (10, 600, 700)] == [False, True, False]
    samples, expected = np.hstack(heard), exactly(modes, outputs, drive, force.ravel())
    bound = 1e-4 * np.abs(drive * outputs[0]).sum() * np.sqrt(2)
    first = asleep.index(True) * 128
    assert np.abs(samples - expected)[:, first : 700 * 128].max() <= bound
    assert decibels((samples - expected)[:, 700 * 128 :], expected) <= -200


def test_a_body_at_rest_costs_no_work_until_it_is_pushed() -> None:
    resonators = Resonators([bank(np.random.default_rng(7), 20)], voices=1)
    resonators.process([], [np.ones((1, 20))])
    resonators.process()
    assert resonators.asleep[0]
    resonators.process([Push(force=np.ones(128), drive=np.ones(20))])
    assert not resonators.asleep[0]


def test_what_has_died_away_becomes_zero_before_its_numbers_are_the_least_there_are() -> None:
    # Sums of numbers near 1e-308 take tenfold the time.
    modes = Bank(frequencies=np.array([440.0, 3000.0]), decays=np.array([0.1, 2000.0]))
    resonators = Resonators([modes], sample_rate=RATE, block=128)
    push = Push(force=np.eye(1, 128)[0], drive=np.ones(2))
    resonators.process([push], [np.ones((1, 2), complex)])
    sizes = []
    for _ in range(round(0.3 * RATE / 128)):
        resonators.process()
        sizes.append(np.abs(resonators.states(0)))
    slow, fast = np.array(sizes).T
    assert slow.min() > 1e-6
    assert fast[-1] == 0
    assert 1e-220 < fast[fast > 0].min() < 1e-190


def test_a_steady_load_is_silent_and_its_end_is_heard() -> None:
    modes = bank(np.random.default_rng(8), 30, decays=(50.0, 200.0))
    resonators, drive = Resonators([modes], voices=1), np.ones(30)
    load = Push(force=np.full(128, 3.0), drive=drive)
    heard = [resonators.process([load], [np.ones((1, 30))])[0, 0].copy() for _ in range(400)]
    assert np.abs(heard[-1]).max() < 1e-9 * np.abs(heard[0]).max()
    assert np.abs(resonators.process()[0, 0]).max() > 0.1 * np.abs(heard[0]).max()


def test_energy_never_rises_on_its_own() -> None:
    random = np.random.default_rng(9)
    modes = bank(random, 40)
    resonators, drive = Resonators([modes], quiet=0.0, voices=1), random.standard_normal(40)
    resonators.process([Push(force=random.standard_normal(128), drive=drive)], [np.ones((1, 40))])
    sizes = []
    for step in range(200):
        resonators.process()
        if step % 50 == 20:
            scale = random.uniform(0.5, 2)
            resonators.change(0, Bank(modes.frequencies * scale, modes.decays * scale))
        sizes.append(np.abs(resonators.states(0)))
    assert np.max(np.diff(np.array(sizes), axis=0)) <= 1e-15


@pytest.mark.parametrize("kind", [Resonators, reference])
def test_a_steady_load_stays_silent_when_poles_change_twice_in_a_block(
    kind: Callable[..., Resonators],
) -> None:
    model, drive = bank(np.random.default_rng(21), 20, highest=9000.0), np.ones(20)
    resonators = kind([model], voices=1)
    push, outputs = [Push(force=np.full(128, 3.0), drive=drive)], [np.ones((1, 20))]
    struck = np.abs(resonators.process(push, outputs)).max()
    for _ in range(4000):
        resonators.process(push)
    for factor in (1.3, 1.0001):
        resonators.change(0, Bank(model.frequencies * factor, model.decays))
    assert np.abs(resonators.process(push)).max() <= 0.01 * struck


def test_a_change_while_it_sounds_does_not_click() -> None:
    modes = Bank(np.array([440.0, 1000.0]), np.array([1.0, 2.0]))
    blow = np.zeros(128)
    blow[0] = RATE

    def second_difference(*, changed: bool) -> float:
        resonators = Resonators([modes], voices=1)
        heard = [resonators.process([Push(force=blow, drive=np.ones(2))], [np.ones((1, 2))]).copy()]
        for step in range(30):
            if changed and step == 10:
                resonators.change(0, Bank(modes.frequencies * 1.05, modes.decays * 20))
            heard.append(resonators.process().copy())
        samples = np.concatenate([each[0, 0] for each in heard])
        return float(np.abs(np.diff(samples[256:], 2)).max())

    assert second_difference(changed=True) <= 1.5 * second_difference(changed=False)


NOISE = np.random.default_rng(10).standard_normal(128)


@pytest.mark.parametrize("kind", [Resonators, reference])
@pytest.mark.parametrize(
    ("push", "message"),
    [
        (Push(force=NOISE * np.nan, drive=np.ones(20)), "nan N: it must be finite"),
        (Push(force=NOISE * np.inf, drive=np.ones(20)), "inf N: it must be finite"),
        (Push(force=NOISE * 1e12, drive=np.ones(20)), "at most 1e"),
        (Push(force=NOISE[:100], drive=np.ones(20)), "give 128 samples"),
        (Push(force=NOISE, drive=np.full(20, np.nan)), "a drive is not finite"),
        (Push(force=NOISE, drive=np.ones(19)), "19 modes, the body 20"),
        (Push(force=NOISE, drive=np.ones(20), body=1), "names body 1"),
    ],
)
def test_a_bad_push_is_refused_and_changes_nothing(
    kind: Callable[..., Resonators], push: Push, message: str
) -> None:
    modes = bank(np.random.default_rng(11), 20)
    good = Push(force=NOISE, drive=np.ones(20))
    hurt, fine = kind([modes], voices=2), kind([modes], voices=2)
    for resonators in (hurt, fine):
        resonators.process([good], [np.ones((1, 20))])
    with pytest.raises(OptionError, match=message):
        hurt.process([good, Push(force=push.force, drive=push.drive, body=push.body, voice=1)])
    assert np.array_equal(hurt.process([good]), fine.process([good]))


@pytest.mark.parametrize("kind", [Resonators, reference])
def test_sessions_out_of_bounds_are_refused(
    kind: Callable[..., Resonators],
) -> None:
    modes = bank(np.random.default_rng(12), 5)
    for bad in ({"sample_rate": 7999}, {"sample_rate": 192001}, {"block": 0}, {"block": 4097}):
        with pytest.raises(OptionError, match=str(next(iter(bad.values())))):
            kind([modes], **bad)  # type: ignore[arg-type] - that is the point
    for wrong, message in (
        (Bank(np.zeros(0), np.zeros(0)), "0 modes"),
        (Bank(np.ones(2), np.array([1.0, -1.0])), "at least 0, the first -1"),
        (Bank(np.array([100.0, np.nan]), np.ones(2)), "above 0, the first nan"),
    ):
        with pytest.raises(OptionError, match=message):
            kind([wrong])
    with pytest.raises(OptionError, match="more than 2"):
        kind([modes], voices=2).process(
            [Push(force=NOISE, drive=np.ones(5), voice=voice) for voice in range(3)]
        )


@pytest.mark.parametrize("rate", [8000, 192000])
def test_modes_past_half_the_rate_are_left_out_and_counted(rate: int) -> None:
    modes = Bank(np.array([1000.0, 5000.0, 95000.0, 99000.0]), np.ones(4))
    resonators = Resonators([modes], sample_rate=rate, voices=1)
    assert resonators.dropped == ((3,) if rate == 8000 else (1,))
    resonators.process([Push(force=NOISE, drive=np.ones(4))], [np.ones((1, 4))])
    assert np.count_nonzero(resonators.states(0)) == 4 - resonators.dropped[0]


@pytest.mark.parametrize(("frequency", "decay"), [(1e-200, 0.0), (440.0, 3.5e7), (440.0, 1e300)])
def test_modes_that_barely_are_add_nothing(frequency: float, decay: float) -> None:
    random = np.random.default_rng(12)
    modes, force = bank(random, 3), random.standard_normal(128)
    drive, outputs = np.ones(3), gains(random, 1, 3)
    alone = played(Resonators([modes]), force, drive, outputs)
    both = Bank(np.append(modes.frequencies, frequency), np.append(modes.decays, decay))
    more = np.ones(4), np.append(outputs, [[1j]], axis=1)
    assert np.array_equal(played(Resonators([both]), force, *more), alone)
