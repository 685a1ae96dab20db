"""Surveys: gains measured for pairs of contact and listener, from which timbre fields are made."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from struck.errors import OptionError, require_choice
from struck.model.arrays import Array, Complex, Index, checked

_ROUNDS = 30
_LEAST = 1e-12  # less than that would only make denormal numbers, which processors are slow at


def shares(evidence: Array) -> Array:
    """Return the weight of each explanation (K, M), of sum 1 for each mode, by its log evidence."""
    # Modes are taken as draws from one mixture of the explanations. Its weights come from all
    # modes by expectation maximisation, from equal ones: a mode with little evidence
    # goes with the others (empirical Bayes; C. M. Bishop, Pattern Recognition and Machine
    # Learning, Springer, 2006, chapter 9).
    count, modes = evidence.shape
    relative = np.exp(evidence - evidence.max(axis=0, initial=-np.inf))
    common = np.full(count, 1 / count)
    weights = relative
    for _ in range(_ROUNDS):
        weights = relative * common[:, None]
        weights /= weights.sum(axis=0)
        # One more mode with equal evidence for all: no weight ever vanishes.
        common = (weights.sum(axis=1) + 1 / count) / (modes + 1)
    return np.where(weights > _LEAST, weights, 0.0)


SYMMETRIES = ("none", "axial")
# Share of the extent within which two places are the same.
_SAME = 1e-6


def from_spherical(radius: ArrayLike, azimuth: ArrayLike, polar: ArrayLike) -> Array:
    """Return places (n, 3), m, of radius, azimuth from x to y, and polar angle from z, rad."""
    flat = np.asarray(radius, np.float64) * np.sin(polar)
    x, y, z = np.broadcast_arrays(
        flat * np.cos(azimuth), flat * np.sin(azimuth), np.asarray(radius) * np.cos(polar)
    )
    return np.stack([x, y, z], axis=-1).reshape(-1, 3)


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Survey:
    """Recordings of a body: contacts, listeners, and the gains of some of their pairs.

    Parameters
    ----------
    contacts : array (P, D)
        Contact coordinates u, or u and v. With axial symmetry: height, or height and azimuth, rad.
    listeners : array (Q, 3)
        Microphone positions in body coordinates, m.
    pairs : array (n, 2) of int
        Numbers of contact and listener of each recording.
    gains : array (n, M), complex
        Gains relative to the arrival time r/c, with r from the centre: gains whose time counts from
        the impact, times exp((-d + 2 pi i f) r/c).
    frequencies : array (M,)
        Ringing frequencies, Hz.
    errors : array (n, M) or None, default None
        Standard errors of the gains, above 0, which are their weights. None: equal weights.
    centre : array (3,)
        Acoustic centre in body coordinates, m.
    symmetry : {"none", "axial"}, default "none"
        "axial": a body of revolution about the z axis through the centre. Then only the azimuth
        between contact and listener matters, in either direction.
    calibrated : bool, default False
        Whether gains are in Pa/(N s).

    Raises
    ------
    OptionError
        If arrays do not fit each other or are not finite, or a pair has no such contact or
        listener.
    """

    contacts: Array
    listeners: Array
    pairs: Index
    gains: Complex
    frequencies: Array
    errors: Array | None = None
    centre: Array
    symmetry: str = "none"
    calibrated: bool = False

    def __post_init__(self) -> None:
        _require_places(self)
        _require_gains(self)

    @classmethod
    @checked
    def full(
        cls,
        contacts: Array,
        listeners: Array,
        gains: Complex,
        frequencies: Array,
        *,
        errors: Array | None = None,
        centre: Array | None = None,
        symmetry: str = "none",
        calibrated: bool = False,
    ) -> Survey:
        """Make a survey of all contacts with all listeners.

        Parameters
        ----------
        contacts : array (P, D)
            Contact coordinates, as in the class.
        listeners : array (Q, 3)
            Positions, m.
        gains : array (P, Q, M), complex
            Gains, as in the class.
        frequencies : array (M,)
            Ringing frequencies, Hz.
        errors : array (P, Q, M), optional
            Standard errors of the gains. Default: equal ones.
        centre : array (3,), optional
            Acoustic centre, m. Default: the origin.
        symmetry : {"none", "axial"}, default "none"
            Symmetry, as in the class.
        calibrated : bool, default False
            Whether gains are in Pa/(N s).

        Returns
        -------
        Survey
            The survey, with P Q pairs.

        Raises
        ------
        OptionError
            On gains of another shape, or as the class.
        """
        if gains.ndim != 3:
            raise OptionError(f"gains have shape {gains.shape}: give (contacts, listeners, modes)")
        return cls(
            contacts=contacts,
            listeners=listeners,
            pairs=np.argwhere(np.ones(gains.shape[:2])),
            gains=gains.reshape(-1, gains.shape[2]),
            frequencies=frequencies,
            errors=None if errors is None else errors.reshape(-1, gains.shape[2]),
            centre=np.zeros(3) if centre is None else centre,
            symmetry=symmetry,
            calibrated=calibrated,
        )

    @cached_property
    def places(self) -> Array:
        """Positions of the listeners from the centre of the body, m (Q, 3)."""
        return np.asarray(self.listeners - self.centre, np.float64)

    @property
    def turns(self) -> bool:
        """Whether contacts lie all around an axially symmetric body."""
        return self.symmetry == "axial" and self.contacts.shape[1] == 2

    def folded(self) -> Survey:
        """Merge contacts and listeners that are equal, or equivalent by symmetry.

        With axial symmetry contacts keep their height alone, and listeners stand at the azimuth
        from their contact, from 0 to pi.

        Returns
        -------
        Survey
            The survey with fewer contacts and listeners.
        """
        contacts, places, pairs = self.contacts, self.places, self.pairs
        if self.turns:
            contacts, places = contacts[:, :1], _turned(places[pairs[:, 1]], contacts[pairs[:, 0]])
            pairs = np.stack([pairs[:, 0], np.arange(len(pairs))], axis=1)
        if self.symmetry == "axial":
            places = places * [1, 0, 1] + np.abs(places) * [0, 1, 0]
        contacts, contact = distinct(contacts)
        places, place = distinct(places)
        return replace(
            self,
            contacts=contacts,
            listeners=places + self.centre,
            pairs=np.stack([contact[pairs[:, 0]], place[pairs[:, 1]]], axis=1),
        )


def _turned(places: Array, contacts: Array) -> Array:
    """Return places (n, 3) turned back by the azimuth of each contact (n, 2)."""
    flat = (places[:, 0] + 1j * places[:, 1]) * np.exp(-1j * contacts[:, 1])
    return np.stack([flat.real, flat.imag, places[:, 2]], axis=1)


def distinct(places: Array) -> tuple[Array, Index]:
    """Return each place once, and for every given one its number."""
    step = _SAME * max(float(np.abs(places).max()), np.finfo(np.float64).tiny)
    rounded = np.round(places / step)
    _, first, number = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
    return places[first], number.reshape(-1)


def _require_places(survey: Survey) -> None:
    require_choice("symmetry", survey.symmetry, SYMMETRIES)
    contacts, listeners = survey.contacts, survey.listeners
    if contacts.ndim != 2 or contacts.shape[1] not in {1, 2} or not len(contacts):
        raise OptionError(f"contacts have shape {contacts.shape}: give one or two coordinates each")
    if listeners.ndim != 2 or listeners.shape[1] != 3 or not len(listeners):
        raise OptionError(f"listeners have shape {listeners.shape}: give x, y, z of each, m")
    if not (np.isfinite(contacts).all() and np.isfinite(listeners).all()):
        raise OptionError("a contact or a listener is not finite: give numbers")


def _require_gains(survey: Survey) -> None:
    pairs, gains = survey.pairs, survey.gains
    if gains.ndim != 2 or gains.shape != (len(pairs), len(survey.frequencies)) or not gains.size:
        raise OptionError(
            f"gains have shape {gains.shape} for {len(pairs)} pairs and "
            f"{len(survey.frequencies)} frequencies: give one of each"
        )
    if not np.isfinite(gains).all():
        raise OptionError("gains are not finite: leave those recordings or modes out")
    errors = survey.errors
    if errors is not None and (errors.shape != gains.shape or not np.all(errors > 0)):
        raise OptionError(
            f"errors have shape {errors.shape} for gains {gains.shape}, or are not above 0: give a "
            "standard error for each gain, or none"
        )
    counts = np.array([len(survey.contacts), len(survey.listeners)])
    if pairs.shape[1:] != (2,) or (pairs < 0).any() or (pairs >= counts).any():
        raise OptionError(
            f"pairs name contacts up to {counts[0] - 1} and listeners up to {counts[1] - 1}: give "
            "two such numbers for each recording"
        )
