"""The callback without a device: called as PortAudio calls it, with buffers of our own."""

from __future__ import annotations

import ctypes

import numpy as np
from numpy.typing import NDArray

from struck.live import callback_memory, limiter
from struck.live.callback_memory import CALLS, LATE, OPEN, UNDERFLOWS, Shared
from struck.live.device import COMPLETE, CONTINUE, OUTPUT_OVERFLOW, OUTPUT_UNDERFLOW
from struck.live.ring import Ring
from tests.live.records import push

Array = NDArray[np.float64]
RATE, BLOCK, CHANNELS = 48000, 128, 2


@ctypes.CFUNCTYPE(
    None, ctypes.POINTER(ctypes.c_double), ctypes.POINTER(ctypes.c_int64),
    ctypes.POINTER(ctypes.c_double), ctypes.c_int64, ctypes.POINTER(ctypes.c_double), ctypes.c_int64
)  # fmt: skip
def play_the_force(arena, integers, reals, fresh, outputs, _channels):  # noqa: ANN001, ANN201, PLR0917, RUF100 - as C calls it
    """Play a record's reals left and their negative right; note which record, fresh or not."""
    arena[0] = integers[0]
    arena[1] += fresh
    for place in range(BLOCK):
        outputs[place], outputs[BLOCK + place] = reals[place], -reals[place]


class Device:
    """What calls the callback."""

    def __init__(self) -> None:
        self.records = Ring(capacity=4, integers=1, reals=BLOCK)
        self.arena = np.zeros(2)
        limited = limiter.limiter(sample_rate=RATE, channels=CHANNELS)
        self.shared = Shared(
            records=self.records, limited=limited, arena=self.arena, channels=CHANNELS, block=BLOCK,
            process=ctypes.cast(play_the_force, ctypes.c_void_p).value,
        )  # fmt: skip
        whole, word, place = ctypes.c_int, ctypes.c_ulong, ctypes.c_void_p
        prototype = ctypes.CFUNCTYPE(whole, place, place, word, place, word, place)
        self._call = prototype(callback_memory.play())
        self.answer = CONTINUE

    def play(self, flags: int = 0) -> NDArray[np.float32]:
        """Return a block (channels, block) as the loudspeaker hears it."""
        frames = np.full((BLOCK, CHANNELS), np.nan, dtype=np.float32)
        self.answer = self._call(
            None, frames.ctypes.data, BLOCK, None, flags, self.shared.address
        )  # fmt: skip
        return frames.T


def test_records_are_heard_in_order_each_for_one_block() -> None:
    device = Device()
    sent, heard = [], []
    ramp = np.linspace(0, 0.5, BLOCK)
    for number in range(20):
        sent.append(ramp + 0.01 * number)
        assert push(device.records, np.array([number]), sent[-1])
        heard.append(device.play())
        assert device.arena.tolist() == [number, number + 1]
    played = np.concatenate(heard, axis=1)
    delay = round(0.0015 * RATE)
    opened = round(0.02 * RATE)  # after the fade
    expected = np.concatenate(sent)[opened - delay : -delay].astype(np.float32)
    assert np.array_equal(played[0, opened:], expected)
    assert np.array_equal(played[1], -played[0])
    assert device.shared.counters[[CALLS, UNDERFLOWS, LATE]].tolist() == [20, 0, 0]


def test_a_late_record_is_counted_and_the_last_one_goes_on() -> None:
    device = Device()
    assert not device.play().any()  # nothing was ever sent: silence, and nothing is late
    push(device.records, np.array([5]), np.full(BLOCK, 0.25))
    for _ in range(10):
        played = device.play()
    assert np.all(played[0] == 0.25)
    assert device.arena.tolist() == [5, 1]
    assert device.shared.counters[LATE] == 9
    push(device.records, np.array([6]), np.zeros(BLOCK))
    device.play()
    assert device.arena.tolist() == [6, 2]
    assert device.shared.counters[LATE] == 9


def test_what_is_being_heard_cannot_be_overwritten() -> None:
    device = Device()
    for number in range(4):
        push(device.records, np.array([number]), np.zeros(BLOCK))
    device.play()
    assert device.records.reserve() is None
    device.play()
    assert device.records.reserve() is not None


def test_underflows_are_counted_and_other_flags_are_not() -> None:
    device = Device()
    for flags in (0, OUTPUT_UNDERFLOW, OUTPUT_OVERFLOW, OUTPUT_UNDERFLOW | 1):
        device.play(flags)
    assert device.shared.counters[[CALLS, UNDERFLOWS]].tolist() == [4, 2]


def test_it_fades_out_and_ends_when_it_is_told_to() -> None:
    device = Device()
    push(device.records, np.array([0]), np.full(BLOCK, 0.5))
    for _ in range(20):
        device.play()
        assert device.answer == CONTINUE
    device.shared.counters[OPEN] = 0
    heard = []
    while device.answer == CONTINUE:
        heard.append(device.play()[0])
    fading = np.concatenate(heard)
    assert len(heard) == np.ceil(0.02 * RATE / BLOCK)
    assert device.answer == COMPLETE
    assert np.all(np.diff(fading) <= 0)
    assert fading[-1] == 0
    assert np.abs(np.diff(fading)).max() < 0.5 * np.pi / 2 / (0.02 * RATE) * 1.01


def test_nothing_that_the_host_sends_is_louder_than_the_ceiling() -> None:
    device = Device()
    chance = np.random.default_rng(5)
    for _ in range(200):
        forces = 10 ** chance.uniform(-3, 12) * chance.normal(size=BLOCK)
        forces[chance.random(BLOCK) < 0.01] = chance.choice([np.nan, np.inf, -np.inf])
        push(device.records, np.array([0]), forces)
        played = device.play()
        assert np.isfinite(played).all()
        assert np.abs(played).max() <= 0.89
