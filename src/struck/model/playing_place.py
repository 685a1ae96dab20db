"""The place where a body is struck by default, and the one where it is loudest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from struck.model.arrays import Array, Index
from struck.model.gains import ShapeGains
from struck.model.material import Material
from struck.model.mesh import Mesh, places_of

# Constants of the default strike, by the wooden head of `strikers.toml` at 0.5 m/s: kg, Pa, and the
# factor from (m / E*)^0.4 to the duration.
_HEAD, _HEAD_MODULUS, _DURATION_FACTOR = 0.015, 1.1396e9, 7.9797
_LOUDEST_PART = 0.125  # s: over the loudest 1/8 s, as the ear does, levels of places are taken
_MAX_DURATION = 10.0  # s: the longest sound that `struck.render` makes of a strike by default
_MAX_FREQUENCY = 24e3  # Hz: half the default sample rate, from which modes are left out of a sound
_MOST_FACES = 1000  # that are tried, evenly among all: they lie a thirtieth of a body apart
_ONE_LINE = 2e-3  # of the frequency: closer modes, as twins, make one line of a spectrum
# Which of the lowest lines count, and how: chosen by the figures of 42 bodies (closed forms, solids
# and meshes), so that the lines that can come within 20 dB of the strongest one do.
_LINES = 3
_AUDIBLE_LEVEL = -30.0  # dB re the strongest line: weaker ones do not count
_SUFFICIENT_LEVEL = -10.0  # dB: a line need not be stronger
_NEGLIGIBLE_LEVEL = -25.0  # dB: a line is as good as absent
_SLOPE = 2.0  # dB of the place's level that a line is worth for each dB between the two
_MIN_LEVEL = -15.0  # dB re the loudest place: softer ones are not taken
_HELD_LEVEL = -25.0  # dB: a body's own playing place counts as held where it is softer
# What a place by name may be worse by: people can tell each other such places, and axes less so.
_NAME_BONUS, _AXIS_BONUS = 3.0, 2.0  # dB
_EQUAL_LEVEL = 0.5  # dB: of places that differ by less (of a symmetric body) the highest wins
_LOUD_NAME_BONUS = 0.5  # dB
_POSITION_STEP = 1e-4  # of the extent


class _Model(Protocol):
    """A model as this module needs it, which stands below that of models."""

    @property
    def frequencies(self) -> Array: ...

    @property
    def decays(self) -> Array: ...

    @property
    def material(self) -> Material | None: ...

    @property
    def mass(self) -> float | None: ...

    @property
    def centre(self) -> Array | None: ...

    @property
    def inertia(self) -> Array | None: ...

    @property
    def supported(self) -> bool: ...

    @property
    def places(self) -> Mapping[str, Array]: ...

    @property
    def playing_place(self) -> str | None: ...

    @property
    def coordinates(self) -> tuple[str, ...]: ...


def playing_place(model: _Model, gains: ShapeGains, surface: Mesh) -> tuple[Array, str | None]:
    """Return the place (3,), m, where a model with a surface is struck by default, and its name.

    It is the one that `model.playing_place` names, unless the body is held there. Else it is the
    loudest one, less a penalty for its three lowest lines: of the audible lines (-30 dB re the
    strongest at some place), each that is more than 10 dB below the strongest line there
    counts as 2 dB for each dB of that. A place by name is preferred.
    """
    if not len(model.decays):
        return places_of(surface)["top"], "top"
    places = _Candidates.of(model, gains, surface)
    levels = places.levels
    levels = levels - levels.max()
    if model.playing_place in places.names:
        number = places.names.index(model.playing_place)
        if levels[number] >= _HELD_LEVEL:
            return places.points[number], model.playing_place
    is_loud = levels >= _MIN_LEVEL
    lines = places.lines
    audible_lines = np.flatnonzero(lines[is_loud].max(axis=0) >= _AUDIBLE_LEVEL)[:_LINES]
    deficits = np.clip(
        _SUFFICIENT_LEVEL - lines[:, audible_lines], 0.0, _SUFFICIENT_LEVEL - _NEGLIGIBLE_LEVEL
    ).sum(axis=1)
    return places.best(
        np.where(is_loud, levels - _SLOPE * deficits, -np.inf), _NAME_BONUS, _AXIS_BONUS
    )


def loudest_place(model: _Model, gains: ShapeGains, surface: Mesh) -> tuple[Array, str | None]:
    """Return the place (3,), m, where a default strike is loudest at the default ear, and its name.

    It is one of the places by name unless another is at least 0.5 dB above them.
    """
    if not len(model.decays):
        return places_of(surface)["top"], "top"
    places = _Candidates.of(model, gains, surface)
    return places.best(places.levels, _LOUD_NAME_BONUS, _LOUD_NAME_BONUS)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Candidates:
    """Places by name, then others all over a body, and a default strike at each."""

    points: Array  # (K, 3), m
    names: tuple[str, ...]  # of the first ones
    levels: Array  # (K,): of the sound, dB
    lines: Array  # (K, L): of lines of the spectrum by ascending frequency, dB re the strongest
    keys: Array  # (K, 3): rounded places, upward last

    @classmethod
    def of(cls, model: _Model, gains: ShapeGains, surface: Mesh) -> _Candidates:
        names = tuple(sorted(model.places, key=lambda name: name[:1] in "+-"))
        named_points = np.array([model.places[name] for name in names]).reshape(-1, 3)
        _, faces, named_points = gains.locator.closest(named_points)
        sample_points, sample_pushes, sample_faces = _spread(gains, surface, len(model.coordinates))
        points = np.concatenate([named_points, sample_points])
        directions = np.concatenate([-surface.normals_at(faces, named_points), sample_pushes])
        all_faces = None if sample_faces is None else np.concatenate([faces, sample_faces])
        masses, durations = default_blows(model, points, directions)
        ear = gains.centre + max(1.0, 2 * gains.radius) * np.eye(3)[0]
        outputs = np.abs(gains.toward(ear[None])[0, 0])
        strengths = gains.at(points, directions, all_faces)[:, 0] * masses[:, None]
        strengths *= outputs * _pulses(model.frequencies, durations)
        energies = _mean(2 * model.decays, _LOUDEST_PART)
        amplitudes = strengths * (
            _mean(model.decays, _MAX_DURATION) * (model.frequencies < _MAX_FREQUENCY)
        )
        lines = np.add.reduceat(np.square(amplitudes), _starts(model.frequencies), axis=1)
        axes = ("xyz".index(surface.up) + np.array([2, 1, 0])) % 3
        return cls(
            points=points,
            names=names,
            levels=_decibels(np.square(strengths) @ energies),
            lines=_decibels(lines) - _decibels(lines.max(axis=1, keepdims=True)),
            keys=np.round(points[:, axes] / (_POSITION_STEP * surface.extent)),
        )

    def best(self, scores: Array, name_bonus: float, axis_bonus: float) -> tuple[Array, str | None]:
        """Return the place (3,), m, of the highest score (K,), dB, and its name."""
        count = len(self.names)
        bonuses = [axis_bonus if name[:1] in "+-" else name_bonus for name in self.names]
        named_scores = scores[:count] + bonuses
        others = scores[count:]
        if not len(others) or (count and named_scores.max() >= others.max()):
            number = int(np.argmax(named_scores))
            return self.points[number], self.names[number]
        candidates = count + np.flatnonzero(others >= others.max() - _EQUAL_LEVEL)
        return self.points[candidates[np.lexsort(self.keys[candidates].T)[-1]]], None


def _spread(gains: ShapeGains, surface: Mesh, axes: int) -> tuple[Array, Array, Index | None]:
    """Return places all over the outside of a body, pushes into it (K, 3), and their faces."""
    normals, points = surface.face_normals, surface.centroids
    is_outside = np.einsum("fd,fd->f", normals, points - gains.centre) > 0
    if gains.formula is not None:  # it moves along z alone: its top, of a slender body the middle
        is_outside = normals[:, 2] > np.sqrt(0.5)
    chosen = np.flatnonzero(is_outside) if is_outside.any() else np.arange(len(points))
    chosen = chosen[:: -(-len(chosen) // _MOST_FACES)]
    if gains.formula is None:
        return points[chosen], -normals[chosen], chosen
    top = points[chosen].copy()
    top[:, axes:] = surface.bounds.mean(axis=0)[axes:]
    top[:, 2] = surface.bounds[1, 2]
    return top, np.tile([0.0, 0.0, -1.0], (len(top), 1)), None


def default_blows(model: _Model, points: Array, ways: Array) -> tuple[Array, Array]:
    """Return masses in contact (K,), kg, and durations (K,), s, of default strikes."""
    lightness = np.full(len(points), 1 / _HEAD)
    if not (model.supported or model.mass is None or model.centre is None or model.inertia is None):
        torques = np.cross(points - model.centre, ways)
        angular_responses = np.linalg.solve(model.inertia, torques.T).T
        # The inertia of a damaged file may be that of no body, and rotation would then take away.
        rotation = np.maximum(np.einsum("kd,kd->k", torques, angular_responses), 0.0)
        lightness += 1 / model.mass + rotation
    softness, body = 1 / _HEAD_MODULUS, model.material
    if body is not None:
        softness += (1 - body.poisson_ratio**2) / body.youngs_modulus
    return 1 / lightness, _DURATION_FACTOR * (softness / lightness) ** 0.4


def _pulses(frequencies: Array, durations: Array) -> Array:
    """Return the spectra at frequencies, Hz, of half-sines of some durations, s (K, M)."""
    cycles = np.multiply.outer(durations, frequencies)
    return (np.sinc(cycles - 0.5) + np.sinc(cycles + 0.5)) * np.pi / 4


def _mean(rates: Array, seconds: float) -> Array:
    """Return the mean of exp(-rate t) over some seconds (M,)."""
    losses = np.maximum(rates * seconds, np.finfo(np.float32).tiny)
    return -np.expm1(-losses) / losses


def _starts(frequencies: Array) -> Index:
    """Return where each line begins, of frequencies that ascend, except for damping, Hz (M,)."""
    starts = [0]
    for mode, frequency in enumerate(frequencies):
        if frequency - frequencies[starts[-1]] > _ONE_LINE * frequency:
            starts.append(mode)
    return np.array(starts)


def _decibels(powers: Array) -> Array:
    return 10 * np.log10(np.maximum(powers, np.finfo(np.float64).tiny))
