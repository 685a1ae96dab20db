"""Plucks: a load, or any form, put on softly and let go; amplitudes as 1998, section 2 and 3."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from struck.errors import OptionError
from struck.excitation.excitation import (
    Burst,
    freeze_place,
    require_at_least_zero,
    require_positive,
)
from struck.excitation.pulses import LEAD, Samples, low_pass
from struck.model.arrays import Array, checked, numbers
from struck.model.contact import Place
from struck.model.gains import ShapeGains
from struck.model.mesh import Mesh
from struck.model.model import ModalModel

Field = Callable[[Array], Array]

_POINTS_PER_SAMPLE = 256  # points per sample of the band-limited step
# Radon's rule of 7 points on a triangle, exact to degree 5 (Zienkiewicz 2013, table 3.4).
_ROOT = np.sqrt(15)
_NEAR, _FAR = (6 - _ROOT) / 21, (6 + _ROOT) / 21
_CORNER = np.vstack(
    [np.full((1, 3), 1 / 3)]
    + [np.full((3, 3), part) + (1 - 3 * part) * np.eye(3) for part in (_NEAR, _FAR)]
)
_WEIGHTS = np.concatenate([[9 / 40], np.repeat([(155 - _ROOT) / 1200, (155 + _ROOT) / 1200], 3)])


def plan_rule(surface: Mesh) -> tuple[Array, Array]:
    """Return points on top of a body (Q, 3) and weights (Q,) that average over its plan.

    Each face that looks up counts by the area of its shadow.
    """
    shadows = surface.area_vectors[:, 2]
    top = shadows > 0
    points = np.einsum("qc,fcd->fqd", _CORNER, surface.points[surface.faces[top]])
    weights = np.multiply.outer(shadows[top] / shadows[top].sum(), _WEIGHTS)
    return points.reshape(-1, 3), weights.ravel()


@checked
def impact_amplitudes(
    model: ModalModel, at: Place, *, energy: float = 1.0, distance: float = 1.0
) -> Array:
    """Compute the amplitudes of the modes for a strike of given energy (1998, eq. 11).

    a_n = sqrt(energy) Psi_n(p) / (omega_n Q(p) distance), Q(p)^2 the sum of Psi_n(p)^2 over all
    modes of the model (the paper's n_f of them). The paper prints the energy without its root,
    against its own section 1.2.

    Parameters
    ----------
    model : ModalModel
        The model.
    at : str, array-like or None
        Contact, as for `ModalModel.contact`, struck straight into the surface.
    energy : float, default 1.0
        Energy of the vibration, in any unit: amplitudes are relative.
    distance : float, default 1.0
        Distance of the listener, m.

    Returns
    -------
    array (M,)
        Relative amplitudes.

    Raises
    ------
    OptionError
        If energy or distance is not positive, or no mode moves there.
    """
    for name, value in (("energy", energy), ("distance", distance)):
        if not (np.isfinite(value) and value > 0):
            raise OptionError(f"{name} is {value}: it must be a finite number above 0")
    shapes = _compute_shapes(model, at)
    rates = 2 * np.pi * model.natural_frequencies
    return np.sqrt(energy) * shapes / (rates * np.linalg.norm(shapes) * distance)


@checked
def impact_impulse(model: ModalModel, at: Place, energy: float) -> float:
    """Compute the impulse that gives the modes of a body a total energy.

    ``Strike(at=p, impulse=impact_impulse(model, p, energy))`` is the paper's blow: its amplitudes
    are those of eq. 11 wherever it lands.

    Parameters
    ----------
    model : ModalModel
        Mass-normalised model, as of bodies with mode shapes.
    at : str, array-like or None
        Contact, as for `ModalModel.contact`.
    energy : float
        Energy, J.

    Returns
    -------
    float
        Impulse, N s.

    Raises
    ------
    OptionError
        If the energy is not positive, or no mode moves there.
    """
    require_positive(energy=energy)
    return float(np.sqrt(2.0 * energy) / np.linalg.norm(_compute_shapes(model, at)))


def initial_amplitudes(
    model: ModalModel, *, displacement: Field | None = None, velocity: Field | None = None
) -> tuple[Array, Array]:
    """Return a_n and b_n of a body let go in some state (1998, eq. 4 and 5).

    It then moves as the sum over n of (a_n sin(2 pi f_n t) + b_n cos(2 pi f_n t)) Psi_n, where the
    Psi_n have a mean square of 1.

    Parameters
    ----------
    model : ModalModel
        Of a body of struck.shapes.
    displacement : callable, optional
        Function of points on top of the body, m (K, 3), that returns their displacements along z, m
        (K,). Default: zero.
    velocity : callable, optional
        Function of these points that returns their velocities along z, m/s (K,). Default: zero.

    Returns
    -------
    two arrays (M,)
        m.

    Raises
    ------
    OptionError
        When the model knows its shapes at vertices alone.
    """
    gains = model.gains
    if not isinstance(gains, ShapeGains) or gains.formula is None:
        raise OptionError(
            "this model knows its shapes at vertices alone: analyze a body of struck.shapes"
        )
    places, weights = plan_rule(gains.surface)
    forms = gains.formula.displacements(places)[:, 2]
    scale = np.sqrt(weights @ np.square(forms))
    rates = 2 * np.pi * model.natural_frequencies

    def mean(field: Field | None) -> Array:
        values = np.zeros(len(places)) if field is None else numbers("field", field(places))
        if values.shape != (len(places),):
            raise OptionError(
                f"the field returned shape {values.shape}: return one number for each place"
            )
        return (weights * values) @ (forms / scale)

    return mean(velocity) / rates, mean(displacement)


def _compute_shapes(model: ModalModel, at: Place) -> Array:
    contact = model.contact(at)
    shapes = model.gains.at(contact.point[None], contact.direction[None])[0, 0]
    if not np.any(np.abs(shapes) > np.finfo(float).eps * np.sqrt(len(shapes))):
        raise OptionError(f"no mode moves at {at}: strike another place")
    return shapes


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class Pluck:
    """A force that rises slowly and is then released.

    The force rises over `rise` as half a cosine, slowly enough to be inaudible, and ends at once. A
    step of force F excites a mode of frequency f as an impulse F / (2 pi f) would. The upper modes
    of a plucked string are therefore weaker by 1/n than those of a struck one: amplitudes fall as
    1/n^2 instead of 1/n (1998, section 6).

    Parameters
    ----------
    at : str, array-like or None, default None
        Contact: a point in body coordinates, m, or a name such as "top", "rim" or "vertex:120".
        None: the playing place of the body (see `ModalModel.contact`).
    force : float, default 1.0
        Load that is released, N.
    rise : float, default 0.05
        Duration of the rise of the load, s. It excites modes below about 2 / rise.
    time : float, default 0.0
        Start of the rise, s. The load is released at time + rise.
    direction : array-like (3,) or None, default None
        Direction of the load, of any length. None: straight into the surface.
    patch : float, default 0.0
        Radius of the area of contact, m; 0 for a point.

    Raises
    ------
    OptionError
        If a number is out of range.

    Examples
    --------
    >>> string = struck.shapes.String(length=0.65, radius=0.0005, tension=70.0)
    >>> model = struck.analyze(string, "steel", progress=None)
    >>> sound = struck.render(model, struck.Pluck(at="quarter", force=2.0), seconds=0.5)
    >>> sound.samples.shape
    (1, 24000)
    """

    at: Place = None
    force: float = 1.0
    rise: float = 0.05
    time: float = 0.0
    direction: Place = None
    patch: float = 0.0

    def __post_init__(self) -> None:
        freeze_place(self, "direction")
        require_positive(force=self.force, rise=self.rise)
        require_at_least_zero(time=self.time, patch=self.patch)

    def begin(self, model: ModalModel, sample_rate: float, *, start: int = 0) -> Burst:
        """Begin the excitation on a model.

        The moment of release lies between samples as it falls; the force is band-limited there
        like a pulse.

        Parameters
        ----------
        model : ModalModel
            Model of the body.
        sample_rate : float
            Sample rate of the forces, Hz.
        start : int, default 0
            Number of the first sample; negative for a prelude.

        Returns
        -------
        Burst
            The excitation at work, which returns its pushes block by block.

        Raises
        ------
        ContactError
            When it touches no body.
        """
        require_positive(sample_rate=sample_rate)
        contact = model.contact(self.at, self.direction)
        samples = self.sampled(sample_rate)
        return Burst.at(contact, samples, model, patch=self.patch, start=start)

    def sampled(self, sample_rate: float) -> Samples:
        """Compute the samples of the force.

        Parameters
        ----------
        sample_rate : float
            Sample rate, Hz.

        Returns
        -------
        Samples
            The force, N.
        """
        first = int(np.floor(self.time * sample_rate))
        release = (self.time + self.rise) * sample_rate
        numbers = np.arange(first, int(np.ceil(release)) + LEAD, dtype=np.float64)
        progress = np.clip((numbers / sample_rate - self.time) / self.rise, 0, 1)
        load = self.force * np.sin(np.pi / 2 * progress) ** 2
        table = _step()
        step = np.interp(numbers - release, np.linspace(-LEAD, LEAD, len(table)), table)
        return Samples(first=first, force=load * (1 - step))


@cache
def _step() -> Array:
    """Return a band-limited step from 0 to 1, from `LEAD` samples before it to as many after."""
    pulse = low_pass(np.linspace(-LEAD, LEAD, 2 * LEAD * _POINTS_PER_SAMPLE + 1))
    rising = np.concatenate([[0.0], np.cumsum(pulse[1:] + pulse[:-1])])
    return rising / rising[-1]


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class Release:
    """A flat body that is slowly deflected into any form and released (1998, eq. 5).

    Parameters
    ----------
    displacement : callable
        Called with points on top of the body (K, 3), m; returns their displacements along z (K,),
        m.
    rise : float, default 0.05
        Duration of the deflection, s (see `Pluck`).
    time : float, default 0.0
        Start of the deflection, s. The body is released at time + rise.

    Raises
    ------
    OptionError
        If a number is out of range.

    Examples
    --------
    >>> string = struck.shapes.String(length=0.65, radius=0.0005, tension=70.0)
    >>> model = struck.analyze(string, "steel", band=(20.0, 5000.0), progress=None)
    >>> arch = struck.Release(displacement=lambda points: np.sin(np.pi * points[:, 0] / 0.65) / 1e3)
    >>> sound = struck.render(model, arch, seconds=0.5)
    >>> frequencies, levels = sound.spectrum()
    >>> float(frequencies[levels[0].argmax()].round())
    82.0
    """

    displacement: Callable[[Array], Array]
    rise: float = 0.05
    time: float = 0.0

    def __post_init__(self) -> None:
        require_positive(rise=self.rise)
        require_at_least_zero(time=self.time)

    def begin(self, model: ModalModel, sample_rate: float, *, start: int = 0) -> Burst:
        """Begin the excitation on a model.

        Parameters
        ----------
        model : ModalModel
            Model of the body.
        sample_rate : float
            Sample rate of the forces, Hz.
        start : int, default 0
            Number of the first sample; negative for a prelude.

        Returns
        -------
        Burst
            The excitation at work, which returns its pushes block by block.

        Raises
        ------
        OptionError
            When the model is not of a body of struck.shapes, or the displacement is not finite.
        """
        require_positive(sample_rate=sample_rate)
        _, amplitudes = initial_amplitudes(model, displacement=self.displacement)
        if not np.isfinite(amplitudes).all():
            raise OptionError("displacement returned numbers that are not finite: give metres")
        load = Pluck(force=1.0, rise=self.rise, time=self.time).sampled(sample_rate)
        stiffness = np.square(2 * np.pi * model.natural_frequencies)
        return Burst(load, stiffness * amplitudes * np.sqrt(model.mass or 1.0), start=start)
