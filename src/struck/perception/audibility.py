"""Audible modes, by the threshold in quiet and by masking, and a model of these alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from struck.errors import OptionError
from struck.model.arrays import Array, Index, checked
from struck.model.contact import Place
from struck.model.gains import Gains, ShapeGains
from struck.model.model import ModalModel
from struck.perception.auditory_scale import JUST_NOTICED, spreading, threshold_in_quiet
from struck.perception.sonic_distance import (
    HeardModel,
    band_excess,
    contacts_over,
    erb_distance,
    filter_centres,
    surface_of,
)

# Spread over the surface where nobody says which contacts count.
_CONTACTS = 256
_SPREAD = 1024  # contacts over which the loss by a number of modes is told
# Filters a quarter of their bandwidth apart see what a mode adds between two others.
_FINE = 0.25
# How much a change of a kept mode counts against what it mends: without it, modes that share a
# filter at all contacts would trade their energies at will.
_STAYING = 0.05
_REFERENCES = ("glasberg1990", "terhardt1979", "fastl2007")


@checked
def audible(
    model: ModalModel,
    contacts: Sequence[Place] | None = None,
    *,
    listener: ArrayLike | None = None,
    level: float | None = None,
) -> ModalModel:
    """Return a model of the modes that are heard anywhere (see `struck.audible`)."""
    hearing = HeardModel.at(model, listener, level)
    intensities = _intensities(model, contacts, hearing)
    cases = intensities.reshape(-1, intensities.shape[2])
    kept = np.flatnonzero(~_left_out(model.frequencies, cases))
    if len(kept) == len(model.frequencies):
        return model
    if not len(kept):
        raise OptionError(
            f"level is {hearing.level:g}: none of {len(model.frequencies)} modes is heard"
        )
    factors = _solved(model.frequencies, cases, kept)
    loss = f"are not heard when the loudest contact reaches {hearing.level:g} dB"
    return _of_modes(model, kept, factors, loss, audible_level=hearing.level)


@checked
def budgeted(
    model: ModalModel, modes: int | None, *, listener: ArrayLike | None = None
) -> ModalModel:
    """Return a model within a budget of modes: the ones loudest over contacts.

    A mode counts by its share of the energy behind the ear's filters, the mean over contacts all
    over the surface. What is left out is told in `provenance`, in dB of sonic distance.

    Raises
    ------
    OptionError
        On less than one mode, or a model without mode shapes.
    """
    require_budget(modes)
    if modes is None or (count := len(model.frequencies)) <= modes:
        return model
    if not isinstance(model.gains, ShapeGains):
        raise OptionError(
            f"modes is {modes} of {count}, and this model has no mode shapes: leave modes out "
            "where it was made, as by struck.fit(modes=)"
        )
    named = [model.contact(place) for place in model.places]
    own = [each.point for each in named], [each.direction for each in named]
    over, hearing = contacts_over(surface_of(model), _SPREAD), HeardModel.at(model, listener)
    contacts = [np.concatenate([a, np.reshape(b, (-1, 3))]) for a, b in zip(over, own, strict=True)]
    before = hearing.intensities(*contacts)
    centres = filter_centres()
    passing = spreading(model.frequencies, centres)
    around = before.reshape(-1, count) @ passing.T + 10 ** (threshold_in_quiet(centres) / 10)
    share = before.reshape(-1, count) * ((1 / around) @ passing)
    kept = np.sort(np.argsort(-share.mean(axis=0), kind="stable")[:modes])
    fewer = _of_modes(model, kept, np.ones(modes), "are beyond the number asked for")
    after = HeardModel.at(fewer, listener).intensities(*contacts)
    distances = erb_distance(
        band_excess(model.frequencies, before), band_excess(fewer.frequencies, after)
    )
    most, middle = float(distances.max()), float(np.median(distances))
    told = (
        f"which changes none of {len(before)} contacts by more than {most:.2f} dB of sonic distance"
    )
    lost = f"{fewer.provenance.dropped[-1]}, {told} ({middle:.2f} dB in the median)"
    dropped = (*fewer.provenance.dropped[:-1], lost)
    made = replace(fewer.provenance, dropped=dropped).extended(budget_distance=most)
    return replace(fewer, provenance=made)


def within_budget(
    modes: int | None,
    work: Callable[..., ModalModel],
    **given: Any,  # noqa: ANN401 - of the work
) -> ModalModel:
    """Return the model that `work` makes of its arguments, within a budget of modes."""
    require_budget(modes)
    return budgeted(work(**given), modes)


def require_budget(modes: int | None) -> None:
    """Refuse less than one mode."""
    if modes is not None and modes < 1:
        raise OptionError(f"modes is {modes}: give a whole number of at least 1, or None for all")


def _intensities(model: ModalModel, contacts: Sequence[Place] | None, hearing: HeardModel) -> Array:
    """Return the intensity of each mode relative to 20 micropascal (K, L, M)."""
    if contacts is None:
        return hearing.intensities(*contacts_over(surface_of(model), _CONTACTS))
    if isinstance(contacts, str) or not len(contacts):
        raise OptionError(f"contacts are {contacts!r}: give a list of at least one place")
    found = [model.contact(place) for place in contacts]
    points, directions = ([each.point for each in found], [each.direction for each in found])
    return hearing.intensities(np.stack(points), np.stack(directions))


def _left_out(frequencies: Array, intensities: Array) -> NDArray[np.bool_]:
    """Return which modes are missed in none of several cases of intensities (C, M)."""
    # Those that add least first, as long as behind no filter all those left out together exceed
    # the threshold that the others leave: in quiet, and a just noticeable share of excitation.
    centres = filter_centres(_FINE)
    passing = spreading(frequencies, centres)
    quiet = 10 ** (threshold_in_quiet(centres) / 10)
    room = (quiet + JUST_NOTICED * (intensities @ passing.T)) / (1 + JUST_NOTICED)
    prominence = [
        (case[:, None] * share / room).max()
        for case, share in zip(intensities.T, passing.T, strict=True)
    ]
    out = np.zeros(len(frequencies), np.bool_)
    for mode in np.argsort(prominence, kind="stable"):
        less = room - intensities[:, mode, None] * passing[:, mode]
        if less.min() >= 0:
            room, out[mode] = less, True
    return out


def _solved(frequencies: Array, intensities: Array, kept: Index) -> Array:
    """Return factors for the intensities of the modes that stay, given all intensities (C, M)."""
    from scipy.optimize import nnls

    centres = filter_centres()
    passing = spreading(frequencies, centres)
    quiet = 10 ** (threshold_in_quiet(centres) / 10)
    matrix, aim = np.zeros((len(kept), len(kept))), np.zeros(len(kept))
    for case in intensities:
        excitation = passing @ case
        shares = passing[:, kept] * case[kept] / (excitation + quiet)[:, None]
        matrix += shares.T @ shares
        aim += (excitation / (excitation + quiet)) @ shares
    pull = _STAYING * np.trace(matrix) / len(kept)
    root = np.linalg.cholesky(matrix + pull * np.eye(len(kept)))
    factors, _ = nnls(root.T, np.linalg.solve(root, aim + pull))
    return factors


def _of_modes(
    model: ModalModel, kept: Index, factors: Array, why: str, **details: object
) -> ModalModel:
    lost = np.setdiff1d(np.arange(len(model.frequencies)), kept)
    loss = f"{len(lost)} of {len(model.frequencies)} modes {why}"
    slopes, errors = model.poisson_slopes, model.errors
    return replace(
        model,
        frequencies=model.frequencies[kept],
        natural_frequencies=model.natural_frequencies[kept],
        decays=model.decays[kept],
        gains=_weighted(model.gains, kept, factors),
        poisson_slopes=None if slopes is None else slopes[kept],
        errors=None if errors is None else errors[kept],
        complete_to=min(model.complete_to, float(model.natural_frequencies[lost].min())),
        provenance=model.provenance.extended(references=_REFERENCES, dropped=(loss,), **details),
    )


def _weighted(gains: Gains, kept: Index, factors: Array) -> ShapeGains:
    """Return the gains of some modes, their squares multiplied by `factors`."""
    if not isinstance(gains, ShapeGains):
        raise OptionError("this model has no mode shapes: leave modes out where it was made")
    # Half goes to the contact side and half to the listener's: as for a mode of less mass, whose
    # shape, and what it radiates, grow alike.
    return gains.weighted(kept, factors**0.25)
