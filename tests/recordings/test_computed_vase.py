"""A survey as of 2007 of a vase whose field is computed: 57 recordings, fitted."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.model.material import AIR
from struck.model.survey import from_spherical
from struck.radiation.boundary_elements import SurfaceField, solve_field
from struck.recordings.fit import fit_recordings
from struck.recordings.takes import Take
from tests.model.vases import HEIGHTS, RATE, listeners
from tests.radiation.bodies import revolved

Array = NDArray[np.float64]
IMPACT, SECONDS, LEVEL = 0.3, 0.8, 20.0  # s, s, dB
HALF = 0.08  # m, of the height of the vase
SIZE = 0.095  # m, of the ball that holds it
# Nodal diameters, and the power with which a mode grows toward the rim.
MODES = ((2, 2), (0, 1), (3, 3), (1, 1), (2, 1), (4, 4), (0, 2), (1, 3), (3, 1), (2, 4))
FREQUENCIES = np.array([430.0, 560, 700, 850, 1020, 1210, 1400, 1570, 1900, 2300])
DECAYS = 6 + 4e-7 * FREQUENCIES**2


def heights_of(z: Array) -> Array:
    return np.clip(z / (2 * HALF) + 0.5, 0.05, 1.0)


def fields() -> list[SurfaceField]:
    """Return the sound of each mode of a vase, 5 cm in radius at its rim, with a wall of 6 mm."""
    rows = np.linspace(-HALF, HALF, 15)
    outer = 0.035 + 0.015 * heights_of(rows)
    inner = rows[rows > -HALF + 0.008]
    within = (0.029 + 0.015 * heights_of(inner))[::-1]
    radii = np.concatenate([[0.0, 0.02], outer, within, [0.015, 0]])
    heights = np.concatenate([[-HALF, -HALF], rows, inner[::-1], [inner[0], inner[0]]])
    skin = revolved(radii, heights, 28)
    x, y, z = skin.centroids.T
    flat = np.maximum(np.hypot(x, y), 1e-9)
    outward = (skin.face_normals[:, 0] * x + skin.face_normals[:, 1] * y) / flat
    found = []
    for number, ((order, power), frequency) in enumerate(zip(MODES, FREQUENCIES, strict=True)):
        moves = heights_of(z) ** power * np.cos(order * np.arctan2(y, x)) * outward
        wave_number = 2 * np.pi * frequency / AIR.sound_speed
        found.append(solve_field(skin, wave_number, moves[:, None], np.array([number])))
    return found


def outputs(parts: list[SurfaceField], places: Array) -> NDArray[np.complex128]:
    """Return what arrives at places (L, 3) of each mode, relative to the arrival (L, M)."""
    distances = np.linalg.norm(places, axis=1)
    columns = [
        1j * part.pressure(places, np.array([0]))[:, 0] * np.exp(1j * part.wave_numbers * distances)
        for part in parts
    ]
    return np.stack(columns, axis=1)


@pytest.mark.prove
def test_a_fitted_survey_agrees_with_the_computed_field_between_its_places() -> None:
    parts, chance = fields(), np.random.default_rng(4)
    drives = heights_of(2 * HALF * (HEIGHTS[:, 0] - 0.5))[:, None] ** [p for _, p in MODES]
    gains = drives[:, None] * outputs(parts, listeners())
    poles = -DECAYS + 2j * np.pi * FREQUENCIES
    ways = np.linalg.norm(listeners(), axis=1)[:, None] / AIR.sound_speed
    times = np.arange(round(SECONDS * RATE)) / RATE - IMPACT
    rung = np.exp(np.outer(poles, np.maximum(times, 0)))
    sounds = np.imag((gains * np.exp(-ways * poles)).reshape(-1, len(poles)) @ rung)
    sounds *= times >= np.tile(ways, (3, 1))
    first = round(IMPACT * RATE)
    loud = np.sqrt((sounds[:, first : first + RATE // 10] ** 2).mean(axis=1))[:, None]
    sounds += loud * 10 ** (-LEVEL / 20) * chance.standard_normal(sounds.shape)
    sounds /= 1.1 * np.abs(sounds).max()
    model = fit_recordings(
        [Take(samples=each, sample_rate=RATE) for each in sounds],
        contacts=np.repeat(HEIGHTS, 19, axis=0).tolist(),
        listeners=np.tile(listeners(), (3, 1)).tolist(),
        symmetry="axial",
        radius=SIZE,
        cache=False,
    ).model
    distances, azimuths = np.repeat([0.5, 0.7, 1.0], 60), chance.uniform(-np.pi, np.pi, 180)
    polar = chance.uniform(0, np.pi / 2, 180)
    unseen = from_spherical(distances, azimuths, polar)
    true = np.abs(drives[0] * outputs(parts, unseen))
    nearest = np.abs(model.frequencies[:, None] - FREQUENCIES).argmin(axis=0)
    heard = np.abs(model.frequencies[nearest] - FREQUENCIES) < 1.0
    gains_there = model.gains.at(HEIGHTS[:1], np.zeros((1, 3)))[0] * model.gains.toward(unseen)
    levels = 20 * np.log10(np.abs(gains_there.sum(axis=1))[:, nearest] / true)
    levels -= np.median(levels[:, heard])  # takes are as loud as the recorder made them
    apart = np.median(np.abs(levels), axis=0)
    measured = ~np.isin(nearest, model.gains.unmeasured)
    low = 2 * np.pi * FREQUENCIES * SIZE / AIR.sound_speed <= 3
    assert np.count_nonzero(heard & measured & low) >= 5
    assert np.all(apart[heard & measured] < 3.0)  # all others are named
    # The others radiate next to nothing at their frequencies, and drown in the noise.
    loudest = np.abs(gains).max(axis=(0, 1))
    assert np.all(loudest[~heard] < 1e-2 * loudest.max())
