"""Refined poles and their statistics: the core, plain NumPy, and what numba gave before."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from struck.model.arrays import AnyArray, Array, Index
from struck.model.exponentials import Exponentials, samples
from struck.recordings.noise import Noise
from struck.recordings.poles import normal_equations, uncertainty
from struck.recordings.poles.normal_equations import add_unique, take_turns
from struck.recordings.poles.projection import GroupBlocks
from struck.recordings.poles.refinement import blocks_around, find_groups
from struck.recordings.poles.uncertainty import pole_statistics
from struck.recordings.segments import Segment

RATE = 8000
GOLDEN = Path(__file__).parent / "golden/poles.npz"
ALIKE = 1e-10  # -200 dB


def rung(seed: int) -> tuple[list[Segment], Exponentials]:
    """Return noisy segments of one and of three channels, and modes close to those within."""
    chance = np.random.default_rng(seed)
    frequencies = np.geomspace(200, 3000, 20) * chance.uniform(0.99, 1.01, 20)
    frequencies = np.concatenate((frequencies, frequencies[::4] + chance.uniform(3, 9, 5)))
    decays = np.exp(chance.uniform(np.log(8), np.log(90), 25))
    poles = -decays + 2j * np.pi * frequencies
    gains = chance.standard_normal((4, 25)) + 1j * chance.standard_normal((4, 25))
    heard = samples(poles, gains[:1], 6000, RATE), samples(poles, gains[1:], 4000, RATE)
    segments = []
    for each, row in zip(heard, (0, 1), strict=True):
        noisy = each + 0.01 * chance.standard_normal(each.shape)
        segments.append(Segment.of(noisy, RATE, Noise.white(np.full(len(each), 1e-4)), row))
    poles = poles + chance.uniform(-0.2, 0.2, 25) + 1j * chance.uniform(-0.5, 0.5, 25)
    return segments, Exponentials(poles=poles, gains=gains * chance.uniform(0.9, 1.1, gains.shape))


def results(seed: int) -> dict[str, AnyArray]:
    """Return all that the loops write, by name."""
    segments, modes = rung(seed)
    groups = find_groups(modes.poles, 0.75, 0.02)
    blocks = blocks_around(segments, modes.poles, groups)
    start = modes.poles[blocks.members]
    tried = take_turns(blocks, modes.poles, modes.gains, start + 1, blocks.starts, 2, keep=False)
    names = ("moved", "own", "costs", "misfits")
    found = {f"tried_{name}": each for name, each in zip(names, tried, strict=True)}
    poles, gains = modes.poles.copy(), modes.gains.copy()
    swept = take_turns(blocks, poles, gains, start, blocks.starts, 3, keep=True)
    found |= {f"swept_{name}": each for name, each in zip(names, swept, strict=True)}
    energies, shares = np.zeros(len(poles)), np.zeros(len(poles))
    add_unique(blocks, poles, gains, energies, shares)
    statistics = pole_statistics(segments, Exponentials(poles=poles, gains=gains))
    fields = ("variances", "sizes", "energies", "crossed", "whole")
    found |= {name: getattr(statistics, name) for name in fields}
    found |= {"turns": blocks.turns[::16], "starts": blocks.starts, "members": blocks.members}
    return found | {"poles": poles, "gains": gains, "unique": energies, "shares": shares}


def assert_alike(ours: dict[str, AnyArray], theirs: dict[str, AnyArray]) -> None:
    assert ours.keys() == theirs.keys()
    for name, each in ours.items():
        assert abs(each - theirs[name]).max() <= ALIKE * abs(theirs[name]).max(), name


def without_core(patch: pytest.MonkeyPatch) -> None:
    for module in (normal_equations, uncertainty):
        patch.setattr(module, "entry", lambda _name: None)


@pytest.mark.parametrize("compiled", [True, False])
def test_poles_and_statistics_are_those_that_numba_gave(
    *, compiled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not compiled:
        without_core(monkeypatch)
    with np.load(GOLDEN) as file:
        assert_alike(results(1), dict(file))


def test_core_and_numpy_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = results(2)
    without_core(monkeypatch)
    assert_alike(results(2), compiled)


def spoil_work_space(patch: pytest.MonkeyPatch) -> None:
    def for_core(blocks: GroupBlocks, starts: Index, count: int) -> tuple[tuple[Any, ...], Array]:
        given, space = plain(blocks, starts, count)
        return given, np.full_like(space, np.nan)

    plain = GroupBlocks.for_core
    patch.setattr(GroupBlocks, "for_core", for_core)


def test_what_the_work_space_held_before_does_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    clean = results(3)
    spoil_work_space(monkeypatch)
    for name, each in results(3).items():
        assert each.tobytes() == clean[name].tobytes(), name


def test_nor_where_the_residual_is_beyond_all_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    spoil_work_space(monkeypatch)
    segments, modes = rung(1)
    blocks = blocks_around(segments, modes.poles, find_groups(modes.poles, 0.75))
    loud, start = blocks._replace(data=blocks.data * 1e200), modes.poles[blocks.members]
    options = {"steps": 3, "keep": False}
    moved, own, costs, _ = take_turns(
        loud, modes.poles, modes.gains, start, blocks.starts, **options
    )
    assert np.isinf(costs).all()
    assert np.isfinite(own).all()
    assert np.array_equal(moved, start)
