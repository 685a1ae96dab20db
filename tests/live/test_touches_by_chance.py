"""Everything that touches a body, by chance, for long: no NaN, no blast, memory flat."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import struck
from struck.excitation.force_track import ForceTrack
from struck.excitation.roughness import Profile, Roughness, profiles, roughnesses
from struck.excitation.scrape import Roll, Scrape
from struck.excitation.scraping_force import Tool
from struck.excitation.strike import Strike
from struck.excitation.touch import TouchLog
from struck.live import limiter
from struck.model.gains import ShapeGains
from struck.model.model import ModalModel
from struck.model.timbre_table import SinglePoint
from struck.solids import Block
from tests.excitation.recordings import recorded
from tests.live.hand import CEILING, Hand, HandPlayer, Make, by_hand
from tests.live.test_ordeals import lasting

__all__ = ["by_hand"]
Array = NDArray[np.float64]
RATE, BLOCK = 44100.0, 512
RECORDED = ("one", "field", "table")
GROWTH = 3 * 2**19
"""Bytes by which memory may grow in a fifth of the time, once everything was there."""
DROPPED = 0.05
"""The share of what is asked that there may be no voice for."""
STRIKERS = ("fingertip", "felt", "rubber", "plastic", "wood", "brass", "steel", "glass")


class Chance:
    """Draws what touches bodies: ordinary, none at all or huge."""

    def __init__(self, models: list[ModalModel], seed: int) -> None:
        self.models, self._random = models, np.random.default_rng(seed)
        self.extreme: Counter[str] = Counter()
        self._kinds: dict[str, Callable[[int], Any]] = {
            "scrape": self.scrape,
            "roll": self.roll,
            "log": self.log,
            "track": self.track,
            "strike": self.strike,
        }

    def drawn(self) -> tuple[str, int, Any]:
        """Return the name of a kind, the number of a body, and an excitation of it."""
        kind, body = str(self._random.choice(list(self._kinds))), self.body()
        return kind, body, self._kinds[kind](body)

    def body(self) -> int:
        return int(self._random.integers(len(self.models)))

    def happens(self, share: float) -> bool:
        return bool(self._random.random() < share)

    def amount(self, lowest: float, highest: float, most: float, count: int | None = None) -> Any:  # noqa: ANN401 - a number, or an array of them
        """Return numbers over decades; one time in ten each, 0, and up to the most allowed."""
        numbers = 10 ** self._random.uniform(np.log10(lowest), np.log10(highest), count or 1)
        fate = self._random.random(len(numbers))
        numbers[fate < 0.1] = 0.0
        numbers[fate > 0.9] = 10 ** self._random.uniform(np.log10(highest), np.log10(most))
        self.extreme["none"] += int(np.count_nonzero(fate < 0.1))
        self.extreme["huge"] += int(np.count_nonzero(fate > 0.9))
        return float(numbers[0]) if count is None else numbers

    def course(self, lowest: float, highest: float, most: float) -> Any:  # noqa: ANN401 - a `Course`
        """Return a constant, or a curve over two seconds."""
        if self.happens(0.5):
            return self.amount(lowest, highest, most)
        values = self.amount(lowest, highest, most, 5)
        return np.linspace(0, 2, 5).tolist(), values.tolist()

    def places(self, body: int, count: int) -> Array:
        """Return places on a body (K, D); of one that was recorded at one place, in metres."""
        gains = self.models[body].gains
        if isinstance(gains, ShapeGains):
            points = np.asarray(gains.surface.points)
            return points[self._random.choice(len(points), count, replace=False)]
        return self._random.uniform(0, 1, (count, 1))

    def rough(self) -> Roughness:
        if self.happens(0.5):
            return Roughness.named(str(self._random.choice(list(roughnesses()))))
        length = 10 ** self._random.uniform(-6, -2)
        return Roughness(
            rms=10 ** self._random.uniform(-9, -2),
            correlation_length=length,
            slope=self._random.uniform(-4, -1.2),
            shortest=length / 10 ** self._random.uniform(0.5, 2),
            waviness=self.amount(1e-7, 1e-3, 1e-1),
            waviness_length=length * 10 ** self._random.uniform(0, 1),
        )

    def finish(self) -> Roughness | Profile:
        if self.happens(0.2):
            return Profile.named(str(self._random.choice(list(profiles()))))
        return self.rough()

    def way(self, body: int) -> dict[str, Any]:
        return {
            "path": list(self.places(body, int(self._random.integers(2, 5)))),
            "speed": self.course(1e-3, 3.0, 1e5),
            "seconds": 10 ** self._random.uniform(-2, 0.3),
            "repeat": str(self._random.choice(["once", "back", "loop"])),
            "seed": int(self._random.integers(1 << 62)),
        }

    def scrape(self, body: int) -> Scrape:
        return Scrape(
            **self.way(body),
            load=self.course(1e-3, 100, 1e6),
            roughness=self.finish(),
            striker=str(self._random.choice(STRIKERS)),
            radius=10 ** self._random.uniform(-6, 0),
        )

    def roll(self, body: int) -> Roll:
        return Roll(
            **self.way(body),
            radius=10 ** self._random.uniform(-3, 0),
            load=self.course(1e-3, 100, 1e6),
            roughness=self.rough(),
            roller_roughness=self.rough(),
            roundness=self.amount(1e-8, 1e-5, 9e-4),
            flat=self.amount(1e-7, 1e-5, 9e-4),
        )

    def log(self, body: int) -> TouchLog:
        count = int(self._random.integers(2, 200))
        times = np.cumsum(self._random.exponential(1 / self._random.uniform(60, 1000), count))
        begin, end = self.places(body, 2)
        turns = np.cumsum(self._random.normal(0, 0.1, count))
        points = np.where((np.abs(turns) % 1 < 0.5)[:, None], begin, end)  # it leaps at times
        if not isinstance(self.models[body].gains, ShapeGains):
            points = begin + np.abs(np.sin(turns))[:, None] * (end - begin)
        return TouchLog(
            times=times,
            points=None if self._alike(body) else points,
            forces=np.append(self.amount(1e-3, 100, 1e6, count - 1), 0),
            speeds=self.amount(1e-3, 3.0, 1e5, count),
            tool=Tool(roughness=self.finish(), radius=10 ** self._random.uniform(-6, 0)),
        )

    def spot(self, body: int) -> Array | None:
        return None if self._alike(body) else self.places(body, 1)[0]

    def _alike(self, body: int) -> bool:
        """Whether a body was recorded at one place, and has no coordinates."""
        return isinstance(self.models[body].gains, SinglePoint)

    def track(self, body: int) -> ForceTrack:
        noise = self._random.standard_normal(int(self._random.integers(1, 8000)))
        rate = float(self._random.choice([8000, 44100, 48000]))
        gain = self.amount(1e-3, 10, 1e6)
        return ForceTrack(at=self.spot(body), force=noise, sample_rate=rate, gain=gain)

    def strike(self, body: int) -> Strike:
        return Strike(
            at=self.spot(body),
            impulse=max(1e-12, self.amount(1e-5, 1, 1e4)),
            duration=float(self._random.choice([0, 1e-5, 1e-3, 0.1])),
            transient=float(self._random.choice([0, 0, 1])),
        )


class Hands:
    """Begins, stops and holds by chance, and counts what was done."""

    def __init__(self, player: HandPlayer, chance: Chance) -> None:
        self._player, self._chance = player, chance
        self._started: list[Any] = []
        self._held: list[tuple[int, Array | None]] = []
        self.done: Counter[tuple[str, int]] = Counter()

    def act(self, _block: int) -> None:
        chance, player = self._chance, self._player
        self._started = [each for each in self._started if not each.finished]
        if chance.happens(0.04) and len(self._started) < 6:
            kind, body, excitation = chance.drawn()
            self.done[kind, body] += 1
            self._started.append(player.start(excitation, body=body))
        if chance.happens(0.005):
            body = chance.body()
            self.done["hold", body] += 1
            self._held.append((body, chance.spot(body)))
            player.dampen(self._held[-1][1], chance.amount(0.1, 100, 1e6), body=body)
        if chance.happens(0.01) and self._held:
            body, place = self._held.pop(0)
            player.dampen(place, 0.0, body=body)
        if chance.happens(0.002) and self._started:
            self._started.pop(0).stop()
        if chance.happens(0.002):
            player.listener = 0.5 + np.abs(chance.places(0, 1)[0])


@pytest.fixture(scope="module")
def models() -> list[ModalModel]:
    """Return a computed body with recoil, and recorded ones of each kind."""
    block = struck.analyze(Block(size=(0.15, 0.1, 0.008)), "steel", accuracy="preview")
    assert block.recoil is not None
    return [block, *(recorded(kind) for kind in RECORDED)]


@pytest.mark.prove
def test_ten_minutes_of_every_touch(
    by_hand: Make, models: list[ModalModel], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Hand, "sample_rate", RATE)
    player = by_hand(models, block=BLOCK, listener=(1, 0.3, 0.2))
    chance = Chance(models, 2007)
    hands = Hands(player, chance)
    blocks, heard_in = round(600 * RATE / BLOCK), 0
    memory: list[int] = []
    for number in range(blocks):
        if number in {k * blocks // 5 for k in range(1, 5)}:
            memory.append(lasting())
        heard = player.hear(1, hands.act)
        assert np.isfinite(heard).all(), number
        loudest = float(np.abs(heard).max())
        assert loudest <= CEILING, number
        heard_in += loudest > 1e-6
    memory.append(lasting())
    # At times it may grow, in a process that has run much else: a leak grows all the time.
    assert np.diff(memory).min() < GROWTH
    assert player._limiter_state[limiter.REPLACED] == 0  # nor did the limiter hide any
    assert player.late == 0
    assert player.dropped <= DROPPED * hands.done.total()
    assert heard_in > blocks / 2
    assert len(hands.done) == 6 * len(models)  # each kind on each body
    assert min(chance.extreme["none"], chance.extreme["huge"]) > 100
