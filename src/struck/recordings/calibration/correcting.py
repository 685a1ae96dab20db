"""Make a computed model ring as a recording does, mode by mode."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from struck.errors import RecordingError
from struck.model.damping import Measured, ringing
from struck.model.model import ModalModel
from struck.recordings.calibration.pairing import Pairing, paired
from struck.recordings.calibration.partials import FittedModes, Partials

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# Modes closer than this share of their frequency are two of a round body's pair.
_SHARED = 1e-3


def corrected(
    model: ModalModel, fitted: FittedModes | ModalModel, pairing: Pairing | None = None
) -> ModalModel:
    """Return a computed model with the frequencies and decays of a recording of the body.

    Shapes, and so how the timbre changes over the surface, stay those computed.

    Parameters
    ----------
    model : ModalModel
        The body as computed.
    fitted : FittedModes or ModalModel
        Anything with `frequencies`, `decays` and `gains`.
    pairing : Pairing, optional
        Which mode is which; found unless given.

    Returns
    -------
    ModalModel
        Modes with a partner ring as it does. The others follow by the factor and Poisson's ratio
        that the partners have in common, or with their twin where they share a frequency with a
        mode that has one, and by the median of the partners' decays over the computed ones. The
        provenance counts both. The material's damping becomes the curve through all decays; its
        constants stay as assumed: `calibrated` finds them.

    Raises
    ------
    RecordingError
        When no mode can be paired.
    """
    partials = Partials.of(fitted)
    pairs = paired(partials, model) if pairing is None else pairing
    if not len(pairs):
        raise RecordingError(
            f"none of {len(partials.frequencies)} fitted modes could be paired with the model's: "
            "check the shape and its size"
        )
    natural = _frequencies(model, partials, pairs)
    decays = _decays(model, partials, pairs)
    order = np.argsort(natural, kind="stable")
    natural, decays = natural[order], decays[order]
    slopes, material = model.poisson_slopes, model.material
    ratios = partials.natural_frequencies[pairs.fitted] / model.natural_frequencies[pairs.computed]
    count, every = len(pairs), len(natural)
    return replace(
        model,
        natural_frequencies=natural,
        frequencies=ringing(natural, decays),
        decays=decays,
        gains=model.gains.changed(natural, order, 1, 1),
        material=None if material is None else material.damped(_curve(natural, decays)),
        complete_to=model.complete_to * min(1.0, float(ratios.min())),
        poisson_slopes=None if slopes is None else slopes[order],
        errors=_errors(model, partials, pairs)[order],
        provenance=model.provenance.extended(
            corrected=f"{count} of {every} modes ring as recorded, {every - count} follow them",
            recorded_over_computed=pairs.factor,
        ),
    )


def _frequencies(model: ModalModel, partials: Partials, pairs: Pairing) -> Array:
    """Return natural frequencies in the model's order, Hz."""
    computed = model.natural_frequencies
    natural = pairs.expected.copy()
    natural[pairs.computed] = partials.natural_frequencies[pairs.fitted]
    for mode in pairs.missing:
        gaps = np.abs(computed[pairs.computed] / computed[mode] - 1)
        if gaps.min() < _SHARED:
            natural[mode] = natural[pairs.computed[np.argmin(gaps)]]
    return natural


def _decays(model: ModalModel, partials: Partials, pairs: Pairing) -> Array:
    """Return decays in the model's order, 1/s."""
    heard, told = partials.decays[pairs.fitted], model.decays[pairs.computed]
    known = told > 0
    more = float(np.median(heard[known] / told[known])) if known.any() else 1.0
    decays = model.decays * more
    decays[pairs.computed] = heard
    return decays


def _errors(model: ModalModel, partials: Partials, pairs: Pairing) -> Array:
    """Return relative errors of the frequencies: those of the fit, or the scatter of the others."""
    errors = np.full(len(model.natural_frequencies), pairs.scatter)
    stated = partials.frequency_errors[pairs.fitted] / partials.frequencies[pairs.fitted]
    errors[pairs.computed] = np.where(stated > 0, stated, np.nan)
    return errors


def _curve(natural: Array, decays: Array) -> Measured:
    """Return the damping that goes through all decays; modes of one frequency share their mean."""
    places, twins = np.unique(natural, return_inverse=True)
    kept = np.maximum(decays, np.finfo(float).tiny)
    means = np.exp(np.bincount(twins, np.log(kept)) / np.bincount(twins))
    return Measured(frequencies=tuple(places.tolist()), rates=tuple(means.tolist()))
