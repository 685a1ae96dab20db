"""57 recordings of a synthetic vase, as sound: the system of 2007 from microphone to walk."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import struck
from struck import Mono, Strike
from struck.model.material import AIR
from struck.model.survey import from_spherical
from struck.recordings.fit import Fitting, fit_recordings
from struck.recordings.takes import Take
from tests.model import test_point_sources as point_sources
from tests.model.vases import HEIGHTS, NODES, RADIUS, RATE, Vase, error, listeners

IMPACT, SECONDS = 0.3, 0.8


def takes(
    vase: Vase, pairs: list[tuple[int, int]], level: float, seed: int, places: np.ndarray
) -> list[Take]:
    """Record pairs of height and place: each in noise, sound arriving as late as its way."""
    chance = np.random.default_rng(seed)
    heights, heard = np.array(pairs).T
    ways = np.linalg.norm(places[heard], axis=1)[:, None] / AIR.sound_speed
    times = np.arange(round(SECONDS * RATE)) / RATE - IMPACT
    poles = -vase.decays + 2j * np.pi * vase.frequencies
    delayed = vase.gains(HEIGHTS[:, 0], places)[heights, heard] * np.exp(-ways * poles)
    waves = delayed @ np.exp(np.outer(poles, np.maximum(times, 0)))
    sound = np.where(times >= ways, waves.imag, 0.0)
    first = round(IMPACT * RATE)
    loud = np.sqrt((sound[:, first : first + RATE // 10] ** 2).mean(axis=1)).mean()
    sound += loud * 10 ** (-level / 20) * chance.standard_normal(sound.shape)
    sound /= 1.1 * np.abs(sound).max()
    return [Take(samples=each, sample_rate=RATE) for each in sound]


def fitted(
    vase: Vase,
    pairs: list[tuple[int, int]],
    level: float,
    seed: int,
    places: np.ndarray | None = None,
    **options: object,
) -> Fitting:
    places = listeners() if places is None else places
    return fit_recordings(
        takes(vase, pairs, level, seed, places),
        contacts=[HEIGHTS[height] for height, _ in pairs],
        listeners=[places[listener] for _, listener in pairs],
        symmetry="axial",
        radius=RADIUS,
        cache=False,
        **options,
    )


def gains_of(made: Fitting, vase: Vase) -> tuple[np.ndarray, np.ndarray]:
    """Return found and true gains (3, 19, modes) as of the arrival.

    Up to one common factor, and one common moment: nobody told when the vase was struck.
    """
    model = made.model
    nearest = np.abs(model.frequencies - vase.frequencies[:, None]).argmin(axis=1)
    modes = nearest[np.abs(model.frequencies[nearest] - vase.frequencies) < 0.5]
    drives = model.gains.at(HEIGHTS, np.zeros((3, 3)))
    gains = np.einsum("prm,qrm->pqm", drives, model.gains.toward(listeners()))[:, :, modes]
    true = vase.gains(HEIGHTS[:, 0], listeners())[:, :, np.isin(nearest, modes)]
    poles = (-model.decays + 2j * np.pi * model.frequencies)[modes]
    moments = made.lead + np.linspace(-1, 1, 201) / RATE
    tried = [gains * np.exp(-poles * moment) for moment in moments]
    best = max(tried, key=lambda each: abs(np.vdot(each, true)) / np.linalg.norm(each))
    return best * np.vdot(best, true) / np.vdot(best, best), true


@pytest.fixture(scope="module")
def vase() -> Vase:
    return Vase.drawn(np.random.default_rng(1))


@pytest.fixture(scope="module")
def whole(vase: Vase) -> tuple[Fitting, list[tuple[str, float]]]:
    told: list[tuple[str, float]] = []
    pairs = [(height, listener) for height in range(3) for listener in range(19)]
    made = fitted(vase, pairs, 20, 1, progress=lambda stage, share: told.append((stage, share)))
    return made, told


@pytest.mark.prove
def test_57_recordings_show_progress(whole: tuple[Fitting, list[tuple[str, float]]]) -> None:
    _, told = whole
    stages = list(dict.fromkeys(stage for stage, _ in told))
    assert stages == ["reading recordings", "looking for modes", "refining the modes"]
    assert len(told) > 60
    for name in stages:
        shares = [share for stage, share in told if stage == name]
        assert shares == sorted(shares)


@pytest.mark.prove
def test_a_vase_from_57_sounds_at_20_db(
    vase: Vase, whole: tuple[Fitting, list[tuple[str, float]]]
) -> None:
    made, _ = whole
    found, true = gains_of(made, vase)
    assert found.shape[2] == len(vase.frequencies)
    assert len(made.model.frequencies) == len(vase.frequencies)
    assert error(found, true) <= -33
    assert len(made.survey.pairs) == 57


@pytest.mark.prove
def test_modes_silent_at_the_pivot_are_named(vase: Vase) -> None:
    pairs = [(height, 0) for height in range(3)] + [(0, listener) for listener in range(1, 19)]
    made = fitted(vase, [*pairs, (2, 9)], 20, 2)
    found, named = made.model.frequencies, made.model.frequencies[made.model.gains.unmeasured]
    silent = [tone for tone in vase.frequencies[list(NODES)] if np.abs(found - tone).min() < 1]
    assert silent
    assert all(np.abs(named - tone).min() < 1 for tone in silent)
    assert any("were not measured" in note for note in made.model.provenance.dropped)


class Sources(point_sources.Vase):
    """Modes that are equally loud in the mean over places, and that ring."""

    def __init__(self, places: np.ndarray) -> None:
        super().__init__(0)
        self.decays = 1.5 + 2.5e-7 * self.frequencies**2
        self.louder = 1 / np.sqrt(np.square(np.abs(self.outputs(places))).mean(axis=0))

    def gains(self, heights: np.ndarray, places: np.ndarray) -> np.ndarray:
        return self.drives(heights)[:, None] * self.outputs(places) * self.louder


@pytest.mark.prove
def test_levels_around_point_sources_are_told_by_their_sound() -> None:
    """All 57 takes, and 21 of them: 3 heights at one place, and one height at all."""
    places, chance = point_sources.listeners(), np.random.default_rng(50)
    unseen = from_spherical(
        chance.uniform(0.6, 1.5, 80),
        chance.uniform(0, 2 * np.pi, 80),
        np.arccos(chance.uniform(-1, 1, 80)),
    )
    vase = Sources(places)
    true = np.abs(vase.gains(HEIGHTS[:, 0], unseen))
    medians = []
    for kept in (57, 21):
        pairs = [(height, each) for height in range(3) for each in range(19)]
        pairs = [pair for pair in pairs if kept == 57 or pair[0] == 1 or pair[1] == 9]
        model = fitted(vase, pairs, 45, 0, places).model
        assert np.abs(model.frequencies - vase.frequencies).max() < 0.5
        drives = model.gains.at(HEIGHTS, np.zeros((3, 3)))
        found = np.abs(np.einsum("prm,qrm->pqm", drives, model.gains.toward(unseen)))
        levels = 20 * np.log10(found / true)
        off = np.median(np.abs(levels - np.median(levels)), axis=(0, 1))
        low, named = vase.frequencies < 4500, np.isin(np.arange(24), model.gains.unmeasured)
        assert np.count_nonzero(named) <= 8
        assert off[~named].max() <= 3
        medians.append(np.median(off[low]))
    assert medians[0] <= 1
    assert medians[1] - medians[0] <= 0.3


@pytest.mark.prove
def test_a_walk_round_it_is_as_smooth_as_standing_still(
    whole: tuple[Fitting, list[tuple[str, float]]], tmp_path: Path
) -> None:
    """Its second difference stays within 1.5 times that of somebody who stands, in any place."""
    path = tmp_path / "vase.struck"
    struck.save(whole[0].model, path)
    model = struck.load(path)
    times = np.linspace(0, 2, 65)
    angles = np.pi * times
    places = np.stack([np.cos(angles), np.sin(angles), np.full(65, 0.3)], axis=1)
    strike = Strike(at=(1.0,), impulse=1.0)
    walk = struck.render(model, strike, listener=Mono(position=(times, places)), seconds=1.0)
    bends = [
        np.abs(
            np.diff(
                struck.render(model, strike, listener=Mono(position=place), seconds=1.0).samples[0],
                2,
            )
        ).max()
        for place in places[:33:4]
    ]
    assert np.abs(np.diff(walk.samples[0], 2)).max() <= 1.5 * max(bends)
    assert np.abs(walk.samples).max() > 0
