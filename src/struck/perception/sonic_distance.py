"""How different two struck bodies, or two contacts of one, sound to an ear."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from struck.errors import ContactError, OptionError, require_choice
from struck.model.arrays import Array, Complex, checked, require_number
from struck.model.contact import Place
from struck.model.mesh import Mesh
from struck.model.model import ModalModel
from struck.perception.auditory_scale import (
    REFERENCE_PRESSURE,
    decibels,
    erb_number,
    frequency_of,
    integrated,
    sensitivity,
    spreading,
    threshold_in_quiet,
)

LEVEL = 85.0  # default level of the loudest contact of a body, dB

_MAX_LEVEL = 300.0  # dB
_SAMPLES = 1000
# Steps of the most even sequence in a square: powers of the inverse of the plastic number.
_EVEN_STEPS = np.array([0.7548776662466927, 0.5698402909980532])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeardModel:
    """A struck model as ears hear it, at a calibrated level."""

    model: ModalModel
    listeners: Array  # (L, 3), m
    outputs: Complex  # (L, R, M): of its gains, toward the listeners
    level: float  # of the loudest contact at the loudest listener, dB re 20 micropascal
    # (M,): factor on the square of a gain, the mean square of its ringing over the ear's
    # integration time at the calibrated level, over that of 20 micropascal
    weights: Array

    @classmethod
    def at(
        cls, model: ModalModel, listener: ArrayLike | None = None, level: float | None = None
    ) -> HeardModel:
        """Put ears somewhere and turn the volume so that the loudest contact reaches `level`."""
        listeners = _places(model, listener)
        target_level = LEVEL if level is None else level
        hint = "give dB re 20 micropascal, such as 85"
        require_number("level", target_level, -_MAX_LEVEL, _MAX_LEVEL, hint=hint)
        if not len(model.frequencies):
            raise OptionError("the model has 0 modes, so there is nothing to hear: widen its band")
        hearing = cls(
            model=model,
            listeners=listeners,
            outputs=model.gains.toward(listeners),
            level=target_level,
            weights=integrated(model.decays) / (2 * REFERENCE_PRESSURE**2),
        )
        level_change = target_level - hearing.loudest(*contacts_over(surface_of(model), _SAMPLES))
        return replace(hearing, weights=hearing.weights * 10 ** (level_change / 10))

    def loudest(self, points: Array, directions: Array) -> float:
        """Return the level of the loudest of some contacts at the loudest listener, dB."""
        intensity = self.intensities(points, directions).sum(axis=2).max(initial=0)
        if not (np.isfinite(intensity) and intensity > 0):
            raise OptionError(
                f"the loudest contact has an intensity of {intensity}: no push along the surface's "
                "normals sounds, so its level cannot be set"
            )
        return float(decibels(intensity))

    def gains(self, points: Array, directions: Array) -> Complex:
        """Return gains of unit impulses at points (K, 3) along directions (K, 3): (K, L, M)."""
        return np.einsum("krm,lrm->klm", self.model.gains.at(points, directions), self.outputs)

    def intensities(self, points: Array, directions: Array) -> Array:
        """Return the intensity of each mode relative to 20 micropascal (K, L, M)."""
        return np.square(np.abs(self.gains(points, directions))) * self.weights

    def amplitudes(self, points: Array, directions: Array) -> Array:
        """Return real parts (K, P) whose squares add up to the first listener's intensities."""
        # Linear in the gains: P = M where a mode's phase is the same for all contacts, else 2 M.
        weight_roots = np.sqrt(self.weights)
        drives = self.model.gains.at(points, directions)
        if self.outputs.shape[1] == 1:
            return drives[:, 0] * (np.abs(self.outputs[0, 0]) * weight_roots)
        gains = np.einsum("krm,rm->km", drives, self.outputs[0]) * weight_roots
        return np.concatenate([gains.real, gains.imag], axis=1)

    def passing(self, centres: Array) -> Array:
        """Return the share of the squares of `amplitudes` that passes the ear's filters (B, P)."""
        fractions = spreading(self.model.frequencies, centres)
        return fractions if self.outputs.shape[1] == 1 else np.tile(fractions, 2)


def surface_of(model: ModalModel) -> Mesh:
    """Return the surface of a model, or raise a ContactError where it has none."""
    if model.geometry is None:
        raise ContactError("this model has no surface to touch: analyze a body")
    return model.geometry


def contacts_over(mesh: Mesh, count: int) -> tuple[Array, Array]:
    """Return points (K, 3) spread evenly over a surface, and the directions straight into it."""
    cumulative_areas = np.cumsum(mesh.areas)
    positions = (np.arange(count) + 0.5) * cumulative_areas[-1] / count
    faces = np.minimum(np.searchsorted(cumulative_areas, positions), len(mesh.faces) - 1)
    u, v = ((np.arange(count)[:, None] + 0.5) * _EVEN_STEPS % 1.0).T
    is_beyond = u + v > 1  # a square folded onto a triangle
    u, v = np.where(is_beyond, 1 - u, u), np.where(is_beyond, 1 - v, v)
    weights = np.stack([1 - u - v, u, v], axis=1)
    points = np.einsum("kc,kcd->kd", weights, mesh.points[mesh.faces[faces]])
    return points, -mesh.face_normals[faces]


def _places(model: ModalModel, listener: ArrayLike | None) -> Array:
    if listener is None:
        centre = np.zeros(3) if model.centre is None else np.asarray(model.centre, float)
        radius = np.linalg.norm(surface_of(model).points - centre, axis=1).max()
        return (centre + np.array([max(1.0, 2 * radius), 0.0, 0.0]))[None]
    places = np.atleast_2d(np.asarray(listener, float))
    if places.ndim != 2 or places.shape[1] != 3 or not np.isfinite(places).all():
        raise ContactError(f"listener is {listener!r}: give x, y and z in m")
    return places


METHODS = ("erb", "doel1998", "doel1998-mean")

# Filters a half of their bandwidth apart: every tone passes the nearest with a loss below 1.4 dB.
_STEP = 0.5
_MIN_FREQUENCY, _MAX_FREQUENCY = 20.0, 20_000.0


@checked
def sonic_distance(
    a: ModalModel,
    b: ModalModel,
    *,
    at: Place = None,
    against: Place = None,
    listener: ArrayLike | None = None,
    level: float | None = None,
    method: str = "erb",
) -> float:
    """Return how different the sounds of two strikes are, dB.

    Parameters
    ----------
    a : ModalModel
        First model.
    b : ModalModel
        Second model. Give one model twice to compare two of its contacts.
    at : str or array-like, optional
        Contact on `a`, as for `ModalModel.contact`. Default: its playing place.
    against : str or array-like, optional
        Contact on `b`. Default: its playing place.
    listener : array-like (3,), optional
        Position in the coordinates of each model, m. Default: next to the model.
    level : float, optional
        Level of the loudest contact of each model, dB re 20 micropascal, so that bodies are
        compared by timbre. Default: 85.
    method : {"erb", "doel1998", "doel1998-mean"}, default "erb"
        "erb": root mean square difference of the levels in those auditory filters in which either
        sound is above the threshold in quiet. "doel1998": the sum over modes of van den Doel and
        Pai (1998), section 5, whose root grows with the number of modes. "doel1998-mean": the same
        divided by the sum of weights, a weighted root mean square.

    Returns
    -------
    float
        Distance, dB; 0 for indistinguishable sounds.

    Raises
    ------
    OptionError
        If the method is unknown, or a method of 1998 is used on models with different modes.
    ContactError
        If a contact is not on the body.

    Examples
    --------
    >>> bar = struck.solids.Block(size=(0.2, 0.03, 0.01))
    >>> model = struck.analyze(bar, "steel", accuracy="preview", progress=None)
    >>> struck.sonic_distance(model, model)
    0.0
    >>> struck.sonic_distance(model, model, at="end", against="middle") > 3
    True
    """
    require_choice("method", method, METHODS)
    hearing = HeardModel.at(a, listener, level)
    other_hearing = hearing if a is b else HeardModel.at(b, listener, level)
    first, second = (
        _intensities_at(hearing, at),
        _intensities_at(other_hearing, at if against is None else against),
    )
    if method == "erb":
        return erb_distance(
            band_excess(a.frequencies, first), band_excess(b.frequencies, second)
        ).item()
    _require_common(a, b)
    return doel_distance(a.frequencies, first, second, mean=method.endswith("mean"))


def filter_centres(step: float = _STEP) -> Array:
    """Return the centre frequencies of the ear's filters, every `step` bandwidths, Hz (B,)."""
    low, high = erb_number([_MIN_FREQUENCY, _MAX_FREQUENCY]) / step
    return frequency_of(np.arange(np.ceil(low), np.floor(high) + 1) * step)


def band_excess(frequencies: Array, intensities: Array) -> Array:  # (M,), Hz, and (..., M)
    """Return levels behind the ear's filters above the threshold in quiet, dB (..., B)."""
    centres = filter_centres()
    excitation = decibels(intensities @ spreading(frequencies, centres).T)
    return np.maximum(excitation - threshold_in_quiet(centres), 0.0)


def erb_distance(first: Array, second: Array) -> Array:
    """Return the rms difference of two excesses (..., B), over the bands in which either is > 0."""
    filter_counts = np.count_nonzero((first > 0) | (second > 0), axis=-1)
    return np.sqrt(np.square(first - second).sum(axis=-1) / np.maximum(filter_counts, 1))


def doel_distance(frequencies: Array, first: Array, second: Array, *, mean: bool) -> float:
    """Return the distance of 1998, section 5, of two sets of intensities (M,), dB."""
    weights = sensitivity(frequencies)
    thresholds = threshold_in_quiet(frequencies)
    one, other = (
        np.maximum(decibels(intensities) - thresholds, 0.0) for intensities in (first, second)
    )
    total = weights @ np.square(one - other)
    return float(np.sqrt(total / weights.sum() if mean else total))


def _intensities_at(hearing: HeardModel, at: Place) -> Array:
    """Return the intensities of the modes of a body struck at a place (M,)."""
    contact = hearing.model.contact(at)
    return hearing.intensities(contact.point[None], contact.direction[None])[0, 0]


def _require_common(a: ModalModel, b: ModalModel) -> None:
    one, other = a.frequencies, b.frequencies
    if len(one) != len(other) or not np.allclose(one, other, rtol=1e-9, atol=0):
        raise OptionError(
            f"models of {len(one)} and {len(other)} modes at different frequencies have no "
            "common set of modes, which the distance of 1998 sums over: take method='erb'"
        )
