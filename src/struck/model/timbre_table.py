"""Timbre tables: the gain of every pair on a grid of contacts and listeners, linear in between."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from struck.errors import ContactError, OptionError, require_choice
from struck.model.arrays import Array, Complex, Index, Mask, brief, checked
from struck.model.contact import require_recorded
from struck.model.gains import RecordedGains
from struck.model.survey import Survey, from_spherical

_CLOSE = 1e-9  # share of an axis within which two values are the same: exactly that node


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GridAxis:
    """One coordinate of a grid."""

    nodes: Array  # (n,), ascending
    period: float = 0.0  # of the coordinate; 0 for none

    @classmethod
    def through(cls, values: Array, period: float = 0.0) -> GridAxis:
        """Make the axis of all different values."""
        nodes = np.sort(values % period if period else values)
        min_spacing = _CLOSE * max(period, float(np.ptp(nodes)), float(np.abs(nodes).max()))
        is_distinct = np.concatenate([[True], np.diff(nodes) > min_spacing])
        if period and nodes[-1] > nodes[0] + period - min_spacing:
            is_distinct &= nodes < nodes[0] + period - min_spacing
        return cls(nodes=nodes[is_distinct], period=period)

    def weights(self, values: Array) -> Array:
        """Return the weight of each node at values (K,): (K, n); clamped beyond the ends."""
        nodes, count = self.nodes, len(self.nodes)
        if self.period:
            values = nodes[0] + (values - nodes[0]) % self.period
            nodes = np.append(nodes, nodes[0] + self.period)
        lower_indices = np.clip(
            np.searchsorted(nodes, values, side="right") - 1, 0, max(len(nodes) - 2, 0)
        )
        upper_indices = np.minimum(lower_indices + 1, len(nodes) - 1)
        gaps = nodes[upper_indices] - nodes[lower_indices]
        shares = np.clip((values - nodes[lower_indices]) / np.where(gaps > 0, gaps, 1.0), 0.0, 1.0)
        shares = np.where(shares < _CLOSE, 0.0, np.where(shares > 1 - _CLOSE, 1.0, shares))
        weights = np.zeros((len(values), count))
        rows = np.arange(len(values))
        np.add.at(weights, (rows, lower_indices), 1 - shares)
        np.add.at(weights, (rows, upper_indices % count), shares)
        return weights


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Grid:
    """Places at all combinations of the nodes of some axes."""

    axes: tuple[GridAxis, ...]
    sources: Index  # (nodes,), number of the place of each combination, the last axis fastest
    count: int  # number of places

    def weights(self, points: Array) -> Array:
        """Return the weight of each place at points (K, axes): (K, count)."""
        products = np.ones((len(points), 1))
        for axis, values in zip(self.axes, points.T, strict=True):
            axis_weights = axis.weights(values)
            products = (products[:, :, None] * axis_weights[:, None]).reshape(len(points), -1)
        source_weights = np.zeros((self.count, len(points)))
        np.add.at(source_weights, self.sources, products.T)
        return source_weights.T


def combinations(axes: tuple[GridAxis, ...]) -> Array:
    """Return the coordinates of all combinations of nodes, the last axis fastest (nodes, axes)."""
    coordinate_grids = np.meshgrid(*(axis.nodes for axis in axes), indexing="ij")
    return np.stack([grid.ravel() for grid in coordinate_grids], axis=1)


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class SinglePoint(RecordedGains):
    """Gains of a body struck at one place and heard from one, alike in all directions.

    Whatever contact is asked for, it is the recorded one. Where the microphone stood is not known:
    it counts as 1 m from the centre, from where sound falls as 1/r.

    Parameters
    ----------
    outputs : array (M,), complex
        Recorded outputs, relative to the arrival of the sound.
    centre : array (3,), optional
        Acoustic centre in the coordinates of the recorded body, m. Default: the origin.
    is_calibrated : bool, default False
        Whether outputs are in Pa/(N s).
    is_deconvolved : bool, default False
        Whether the recorded strike was divided out.
    """

    outputs: Complex
    centre: Array = field(default_factory=lambda: np.zeros(3))
    is_calibrated: bool = False
    is_deconvolved: bool = False

    def deconvolved(self, spectrum: Complex) -> SinglePoint:
        """Divide a recorded strike out of the gains.

        Parameters
        ----------
        spectrum : array (M,), complex
            Spectrum of the recorded strike at the pole of each mode.

        Returns
        -------
        SinglePoint
            Gains for a force in N.
        """
        return replace(self, outputs=self.outputs / spectrum, is_deconvolved=True)

    @property
    def count(self) -> int:
        """Number of modes that the gains are of, M."""
        return len(self.outputs)

    def at(self, points: Array, directions: Array) -> Array:
        """Return the drive 1 for any contact.

        Parameters
        ----------
        points : array (K, D)
            Contacts.
        directions : array (K, 3)
            Has no effect.

        Returns
        -------
        array (K, 1, M)
            Ones.
        """
        del directions
        return np.ones((len(np.atleast_2d(points)), 1, len(self.outputs)))

    def toward(self, listeners: Array) -> Complex:
        """Compute outputs that fall as 1/r, without the delay r/c.

        Parameters
        ----------
        listeners : array (L, 3)
            Positions in body coordinates, m.

        Returns
        -------
        array (L, 1, M), complex
            Output of each mode.

        Raises
        ------
        ContactError
            If a listener is at the centre.
        """
        places = np.atleast_2d(np.asarray(listeners, np.float64))
        distances = np.linalg.norm(places - self.centre, axis=1)
        if not distances.all():
            raise ContactError(
                "a listener is 0 m from the body's centre, where 1/r has no end: move it away; "
                "recordings count as made at 1 m"
            )
        return self.outputs / distances[:, None, None]

    def changed(self, frequencies: Array, modes: Index, size: float, density: float) -> SinglePoint:
        """Compute the gains of chosen modes of a body with other frequencies, size or density.

        Shapes go with (density size^3)^(-1/2) where a body is pushed and where it radiates; what
        was heard at 1 m is heard at `size` m.

        Parameters
        ----------
        frequencies : array (K,)
            Has no effect.
        modes : array (K,) of int
            Numbers of the chosen modes.
        size : float
            Ratio of the new to the present size.
        density : float
            Ratio of the new to the present density.

        Returns
        -------
        SinglePoint
            Gains of the changed body.
        """
        del frequencies
        return replace(
            self,
            outputs=self.outputs[modes] * (size / (density * size**3)),
            centre=self.centre * size,
        )


SYSTEMS = ("spherical", "cartesian")
_SAME_FRACTION = 1e-6  # share of the largest distance within which two places are the same


@dataclass(frozen=True, kw_only=True, eq=False)
class TimbreTable(RecordedGains):
    """Gains of a body as recorded for every contact with every listener, each its own.

    A product for each contact: drives are the weights of linear interpolation over contacts,
    outputs the gains from each, interpolated linearly over listeners (2007, section 2). For
    listeners beyond the grid counts its nearest place, from where sound falls as 1/r.

    Parameters
    ----------
    contacts : Grid
        Grid of contacts over u, or u and v.
    listeners : Grid
        Grid of listeners over distance, azimuth and polar angle from the centre, or over x, y, z
        from it.
    gains : array (P, Q, M), complex
        Gains relative to the arrival time r/c, so that interpolated values have no travel phase.
    system : {"spherical", "cartesian"}
        Coordinates of the grid of listeners.
    mirrored : bool
        Whether gains at azimuths a and -a are equal.
    centre : array (3,)
        Acoustic centre in the coordinates of the recorded body, m.
    size : float, default 1.0
        Ratio of the size of the body to the recorded one.
    is_calibrated : bool, default False
        Whether gains are in Pa/(N s).
    is_deconvolved : bool, default False
        Whether the recorded strike was divided out.
    """

    __repr__ = brief
    contacts: Grid
    listeners: Grid
    gains: Complex
    system: str
    mirrored: bool
    centre: Array
    size: float = 1.0
    is_calibrated: bool = False
    is_deconvolved: bool = False

    @classmethod
    def of(cls, survey: Survey, *, system: str = "spherical") -> TimbreTable:
        """Make the timbre table of a survey.

        A distance at which there is only one listener is equal in all directions, as a point inside
        the body.

        Parameters
        ----------
        survey : Survey
            Gains of all contacts with all listeners.
        system : {"spherical", "cartesian"}, default "spherical"
            Coordinates of the grid of listeners.

        Returns
        -------
        TimbreTable
            The table.

        Raises
        ------
        OptionError
            If contacts or listeners form no grid, or pairs are missing.
        """
        require_choice("system", system, SYSTEMS)
        folded = survey.folded()
        mirrored = survey.symmetry == "axial"
        if system == "spherical":
            listeners = _spherical_grid(folded.places, mirrored=mirrored)
        else:
            places = _coordinates(folded.places, system, mirrored=mirrored)
            listeners = _plain_grid(places, "listeners")
        return cls(
            contacts=_plain_grid(folded.contacts, "contacts"),
            listeners=listeners,
            gains=_means(folded),
            system=system,
            mirrored=mirrored,
            centre=survey.centre,
            is_calibrated=survey.calibrated,
        )

    @property
    def directional(self) -> bool:
        """True: the sound differs with the direction of the listener."""
        return True

    @property
    def axial(self) -> bool:
        """Whether the body was recorded as round about the z axis."""
        return self.mirrored

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest contact coordinates (D,)."""
        axes = self.contacts.axes
        return np.array([a.nodes[0] for a in axes]), np.array([a.nodes[-1] for a in axes])

    @property
    def count(self) -> int:
        """Number of modes that the gains are of, M."""
        return self.gains.shape[-1]

    @property
    def axes(self) -> int:
        """Number of coordinates of a contact, D."""
        return len(self.contacts.axes)

    @property
    def rank(self) -> int:
        """How many products there are: as many as contacts."""
        return len(self.gains)

    def at(self, points: Array, directions: Array) -> Array:
        """Compute the interpolation weights of the contacts.

        Parameters
        ----------
        points : array (K, D)
            Contact coordinates.
        directions : array (K, 3)
            Has no effect.

        Returns
        -------
        array (K, P, M)
            Weight of each recorded contact.

        Raises
        ------
        ContactError
            If the number of coordinates is wrong, or they are outside the recorded range.
        """
        del directions
        weights = self._weights(points)
        return np.broadcast_to(weights[:, :, None], (*weights.shape, self.gains.shape[2]))

    def motion(self, points: Array) -> Array:
        """Compute the factor of the gains that depends on the contact alone.

        The result (K, 1, R, M) is the same for all R products of a mode.

        Gains (P, Q) of a mode come nearest to a product of real drives (P,) and outputs (Q,) where
        the drives are the leading eigenvector of Re(G G*).

        Parameters
        ----------
        points : array (K, D)
            Contact coordinates.

        Returns
        -------
        array (K, 1, R, M)
            Factor, the same for all R products of a mode.
        """
        products = np.einsum("pqm,rqm->mpr", self.gains, self.gains.conj()).real
        drives = np.linalg.eigh(products)[1][:, :, -1]
        leading = np.take_along_axis(drives, np.abs(drives).argmax(axis=1)[:, None], axis=1)
        moved = self._weights(points) @ (drives / leading).T
        return np.broadcast_to(
            moved[:, None, None], (len(moved), 1, self.rank, self.gains.shape[2])
        )

    def deconvolved(self, spectrum: Complex) -> TimbreTable:
        """Divide a recorded strike out of the gains.

        Parameters
        ----------
        spectrum : array (M,), complex
            Spectrum of the recorded strike at the pole of each mode.

        Returns
        -------
        TimbreTable
            Gains for a force in N.
        """
        return replace(self, gains=self.gains / spectrum, is_deconvolved=True)

    def _weights(self, points: Array) -> Array:
        """Return the weights of contacts at coordinates (K, D): (K, P)."""
        places = np.atleast_2d(np.asarray(points, np.float64))
        if places.shape[1] != len(self.contacts.axes):
            raise ContactError(
                f"a contact has {places.shape[1]} coordinates: this table has "
                f"{len(self.contacts.axes)}"
            )
        require_recorded(places, *self.bounds)
        return self.contacts.weights(places)

    def toward(self, listeners: Array) -> Complex:
        """Interpolate the gains, relative to the arrival time r/c.

        Parameters
        ----------
        listeners : array (L, 3)
            Positions in body coordinates, m.

        Returns
        -------
        array (L, P, M), complex
            Gain from each recorded contact.
        """
        places = np.atleast_2d(np.asarray(listeners, np.float64)) / self.size - self.centre
        coordinates = _coordinates(places, self.system, mirrored=self.mirrored)
        lowest = [axis.nodes[0] for axis in self.listeners.axes]
        highest = [axis.nodes[-1] for axis in self.listeners.axes]
        inside = np.clip(coordinates, lowest, highest)
        reach = np.linalg.norm(inside, axis=1) if self.system == "cartesian" else inside[:, 0]
        distances = np.linalg.norm(places, axis=1)
        spread = np.minimum(reach / np.maximum(distances, np.finfo(np.float64).tiny), 1.0)
        weights = self.listeners.weights(coordinates) * spread[:, None]
        return np.einsum("lq,pqm->lpm", weights, self.gains)

    def changed(self, frequencies: Array, modes: Index, size: float, density: float) -> TimbreTable:
        """Compute the gains of chosen modes of a body with other frequencies, size or density.

        Parameters
        ----------
        frequencies : array (K,)
            Has no effect.
        modes : array (K,) of int
            Numbers of the chosen modes.
        size : float
            Ratio of the new to the present size.
        density : float
            Ratio of the new to the present density.

        Returns
        -------
        TimbreTable
            Gains of the changed body.
        """
        del frequencies
        gains = self.gains[:, :, modes] / (density * size**3)
        return replace(self, gains=gains, size=self.size * size)


def _coordinates(places: Array, system: str, *, mirrored: bool) -> Array:
    """Return coordinates (L, 3) of places from the centre."""
    x, y, z = places.T
    if system == "cartesian":
        return np.stack([x, np.abs(y) if mirrored else y, z], axis=1)
    azimuth = np.arctan2(y, x)
    polar = np.arctan2(np.hypot(x, y), z)
    distance = np.linalg.norm(places, axis=1)
    return np.stack([distance, np.abs(azimuth) if mirrored else azimuth, polar], axis=1)


def _spherical_grid(places: Array, *, mirrored: bool) -> Grid:
    """Return the grid of listeners over distance, azimuth and polar angle."""
    distance, azimuth, polar = _coordinates(places, "spherical", mirrored=mirrored).T
    off_axis = np.sin(polar) > _SAME_FRACTION
    axes = (
        GridAxis.through(distance),
        GridAxis.through(
            azimuth[off_axis] if off_axis.any() else np.zeros(1), 0 if mirrored else 2 * np.pi
        ),
        GridAxis.through(polar),
    )
    nodes = combinations(axes)
    reach = _SAME_FRACTION * distance.max()
    gaps = np.linalg.norm(from_spherical(*nodes.T)[:, None] - places, axis=2)
    level = np.abs(nodes[:, :1] - distance) <= reach
    is_alone = np.count_nonzero(level, axis=1) == 1
    sources = np.where(level, gaps, np.inf).argmin(axis=1)
    missing = ~is_alone & (gaps.min(axis=1) > reach)
    _require_complete(nodes, missing, "distance, azimuth, polar angle")
    return Grid(axes=axes, sources=sources, count=len(places))


def _plain_grid(places: Array, what: str) -> Grid:
    """Return the grid whose nodes are places (n, axes), each of them one."""
    axes = tuple(GridAxis.through(values) for values in places.T)
    nodes = combinations(axes)
    gaps = np.linalg.norm(nodes[:, None] - places, axis=2)
    reach = _SAME_FRACTION * max(float(np.abs(places).max()), np.finfo(np.float64).tiny)
    _require_complete(nodes, gaps.min(axis=1) > reach, what)
    return Grid(axes=axes, sources=gaps.argmin(axis=1), count=len(places))


def _require_complete(nodes: Array, missing: Mask, what: str) -> None:
    if missing.any():
        raise OptionError(
            f"{np.count_nonzero(missing)} of {len(nodes)} places of the grid were not recorded, "
            f"the first at {nodes[missing][0].tolist()} ({what}): record them, or give "
            "interpolation='field'"
        )


def _means(survey: Survey) -> Complex:
    """Return the mean gain of each pair (P, Q, M)."""
    shape = len(survey.contacts), len(survey.listeners), len(survey.frequencies)
    sums, counts = np.zeros(shape, np.complex128), np.zeros(shape[:2])
    np.add.at(sums, tuple(survey.pairs.T), survey.gains)
    np.add.at(counts, tuple(survey.pairs.T), 1)
    if not counts.all():
        contact, listener = np.argwhere(counts == 0)[0]
        raise OptionError(
            f"{np.count_nonzero(counts == 0)} of {counts.size} pairs were not recorded, the first "
            f"contact {contact} with listener {listener}: record them, or give "
            "interpolation='field'"
        )
    return sums / counts[:, :, None]
