"""Audible modes, by the threshold in quiet and by masking, and a model of these alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from struck.errors import OptionError, rounded
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

# Contacts spread over the surface if none are given.
_CONTACTS = 256
_BUDGET_CONTACTS = 1024  # contacts over which the loss by a budget of modes is computed
# Filters a quarter of their bandwidth apart see what a mode adds between two others.
_FINE = 0.25
# Weight of the change of a selected mode: without it, the energies of modes that share a filter at
# all contacts would not be determined.
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
    """Reduce a model to the modes that are audible.

    Modes are removed, quietest first, while in every auditory filter their summed level stays below
    the masking threshold of the remaining modes, at every contact and listener. The gains of the
    remaining modes are scaled so that the output of the filters changes least.

    Parameters
    ----------
    model : ModalModel
        A model with a surface.
    contacts : sequence of str or array-like (3,), optional
        Contacts, as for `ModalModel.contact`. Default: 256 spread over the surface.
    listener : array-like (3,) or (L, 3), optional
        Listeners, m. Default: next to the model.
    level : float, optional
        Level of the loudest contact, dB re 20 micropascal. Default: 85.

    Returns
    -------
    ModalModel
        The reduced model. Its provenance counts the modes that were removed.

    Raises
    ------
    ContactError
        If a contact is not on the body.
    OptionError
        If the model has no surface, or no mode is audible at this level.

    Examples
    --------
    >>> plate = struck.solids.Block(size=(0.3, 0.2, 0.004))
    >>> model = struck.analyze(plate, "steel", accuracy="preview", progress=None)
    >>> len(struck.audible(model).frequencies) < len(model.frequencies)
    True
    """
    hearing = HeardModel.at(model, listener, level)
    intensities = _intensities(model, contacts, hearing)
    cases = intensities.reshape(-1, intensities.shape[2])
    modes = np.flatnonzero(~_left_out(model.frequencies, cases))
    if len(modes) == len(model.frequencies):
        return model
    if not len(modes):
        raise OptionError(
            f"level is {rounded(hearing.level)}: none of {len(model.frequencies)} modes is audible"
        )
    factors = _solve_factors(model.frequencies, cases, modes)
    loss = f"are not heard when the loudest contact reaches {rounded(hearing.level)} dB"
    return _select_modes(model, modes, factors, loss, audible_level=hearing.level)


@checked
def budgeted(
    model: ModalModel, modes: int | None, *, listener: ArrayLike | None = None
) -> ModalModel:
    """Return a model within a budget of modes: the ones loudest over contacts.

    Modes are ranked by their fraction of the energy behind the ear's filters, averaged over
    contacts spread over the surface. `provenance` gives the loss, in dB of sonic distance.

    Raises
    ------
    OptionError
        If modes is less than 1, or the model has no mode shapes.
    """
    require_budget(modes)
    if modes is None or (count := len(model.frequencies)) <= modes:
        return model
    if not isinstance(model.gains, ShapeGains):
        raise OptionError(
            f"modes is {modes} of {count}, and this model has no mode shapes: leave modes out "
            "where it was made, as by struck.fit(modes=)"
        )
    named_contacts = [model.contact(place) for place in model.places]
    pushes_at_places = (
        [contact.point for contact in named_contacts],
        [contact.direction for contact in named_contacts],
    )
    pushes_on_surface, hearing = (
        contacts_over(surface_of(model), _BUDGET_CONTACTS),
        HeardModel.at(model, listener),
    )
    contacts = [
        np.concatenate([a, np.reshape(b, (-1, 3))])
        for a, b in zip(pushes_on_surface, pushes_at_places, strict=True)
    ]
    full_intensities = hearing.intensities(*contacts)
    centres = filter_centres()
    passing = spreading(model.frequencies, centres)
    excitations = full_intensities.reshape(-1, count) @ passing.T + 10 ** (
        threshold_in_quiet(centres) / 10
    )
    energy_fractions = full_intensities.reshape(-1, count) * ((1 / excitations) @ passing)
    chosen_modes = np.sort(np.argsort(-energy_fractions.mean(axis=0), kind="stable")[:modes])
    reduced_model = _select_modes(
        model, chosen_modes, np.ones(modes), "are beyond the number asked for"
    )
    reduced_intensities = HeardModel.at(reduced_model, listener).intensities(*contacts)
    distances = erb_distance(
        band_excess(model.frequencies, full_intensities),
        band_excess(reduced_model.frequencies, reduced_intensities),
    )
    max_distance, median_distance = float(distances.max()), float(np.median(distances))
    effect = (
        f"which changes none of {len(full_intensities)} contacts by more than "
        f"{max_distance:.2f} dB of sonic distance"
    )
    loss = (
        f"{reduced_model.provenance.dropped[-1]}, {effect} ({median_distance:.2f} dB in the median)"
    )
    notes = (*reduced_model.provenance.dropped[:-1], loss)
    provenance = replace(reduced_model.provenance, dropped=notes).extended(
        budget_distance=max_distance
    )
    return replace(reduced_model, provenance=provenance)


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
    resolved_contacts = [model.contact(place) for place in contacts]
    points, directions = (
        [contact.point for contact in resolved_contacts],
        [contact.direction for contact in resolved_contacts],
    )
    return hearing.intensities(np.stack(points), np.stack(directions))


def _left_out(frequencies: Array, intensities: Array) -> NDArray[np.bool_]:
    """Return which modes are missed in none of several cases of intensities (C, M)."""
    # Those that add least first, as long as behind no filter all those left out together exceed
    # the threshold that the others leave: in quiet, and a just noticeable share of excitation.
    centres = filter_centres(_FINE)
    passing = spreading(frequencies, centres)
    threshold = 10 ** (threshold_in_quiet(centres) / 10)
    room = (threshold + JUST_NOTICED * (intensities @ passing.T)) / (1 + JUST_NOTICED)
    prominence = [
        (case[:, None] * filter_weights / room).max()
        for case, filter_weights in zip(intensities.T, passing.T, strict=True)
    ]
    out = np.zeros(len(frequencies), np.bool_)
    for mode in np.argsort(prominence, kind="stable"):
        remaining_room = room - intensities[:, mode, None] * passing[:, mode]
        if remaining_room.min() >= 0:
            room, out[mode] = remaining_room, True
    return out


def _solve_factors(frequencies: Array, intensities: Array, modes: Index) -> Array:
    """Return factors for the intensities of the modes that stay, given all intensities (C, M)."""
    from scipy.optimize import nnls

    centres = filter_centres()
    passing = spreading(frequencies, centres)
    threshold = 10 ** (threshold_in_quiet(centres) / 10)
    matrix, aim = np.zeros((len(modes), len(modes))), np.zeros(len(modes))
    for case in intensities:
        excitation = passing @ case
        shares = passing[:, modes] * case[modes] / (excitation + threshold)[:, None]
        matrix += shares.T @ shares
        aim += (excitation / (excitation + threshold)) @ shares
    regularisation = _STAYING * np.trace(matrix) / len(modes)
    root = np.linalg.cholesky(matrix + regularisation * np.eye(len(modes)))
    factors, _ = nnls(root.T, np.linalg.solve(root, aim + regularisation))
    return factors


def _select_modes(
    model: ModalModel, modes: Index, factors: Array, reason: str, **details: object
) -> ModalModel:
    lost_modes = np.setdiff1d(np.arange(len(model.frequencies)), modes)
    loss = f"{len(lost_modes)} of {len(model.frequencies)} modes {reason}"
    slopes, errors = model.poisson_slopes, model.errors
    return replace(
        model,
        frequencies=model.frequencies[modes],
        natural_frequencies=model.natural_frequencies[modes],
        decays=model.decays[modes],
        gains=_weighted(model.gains, modes, factors),
        poisson_slopes=None if slopes is None else slopes[modes],
        errors=None if errors is None else errors[modes],
        complete_to=min(model.complete_to, float(model.natural_frequencies[lost_modes].min())),
        provenance=model.provenance.extended(references=_REFERENCES, dropped=(loss,), **details),
    )


def _weighted(gains: Gains, modes: Index, factors: Array) -> ShapeGains:
    """Return the gains of some modes, their squares multiplied by `factors`."""
    if not isinstance(gains, ShapeGains):
        raise OptionError("this model has no mode shapes: leave modes out where it was made")
    # Half goes to the contact side and half to the listener's: as for a mode of less mass, whose
    # shape and radiation grow by the same factor.
    return gains.weighted(modes, factors**0.25)
