"""Amplitudes of a struck or displaced body as 1998 tells them, section 2 and 3."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError
from struck.forms import TransverseShapes
from struck.model.contact import Place
from struck.model.gains import ShapeGains
from struck.model.model import ModalModel
from struck.plan import plan_rule

Array = NDArray[np.float64]
Field = Callable[[Array], Array]


def impact_amplitudes(
    model: ModalModel, at: Place, *, energy: float = 1.0, distance: float = 1.0
) -> Array:
    """Return the amplitudes of the heard modes for a blow of given energy (1998, eq. 11).

    a_n = sqrt(energy) Psi_n(p) / (omega_n Q(p) distance), Q(p)^2 the sum of Psi_n(p)^2 over all
    modes of the model (the paper's n_f of them). The paper prints the energy without its root,
    against its own section 1.2.

    Parameters
    ----------
    model : ModalModel
    at : place
        Where it is struck, straight into the surface.
    energy : float
        Of the vibration, in any unit: amplitudes are relative.
    distance : float
        To the listener, m.

    Returns
    -------
    array (M,)

    Raises
    ------
    OptionError
        When energy or distance do not exceed 0, or no mode moves there.
    """
    for name, value in (("energy", energy), ("distance", distance)):
        if not (np.isfinite(value) and value > 0):
            raise OptionError(f"{name} is {value}: it must be a finite number above 0")
    shapes = _along_push(model, at)
    rates = 2 * np.pi * model.natural_frequencies
    return np.sqrt(energy) * shapes / (rates * np.linalg.norm(shapes) * distance)


def impact_impulse(model: ModalModel, at: Place, energy: float) -> float:
    """Return the impulse that gives the modes of a body so much energy at one place, N s.

    ``Strike(at=p, impulse=impact_impulse(model, p, energy))`` is the paper's blow: its amplitudes
    are those of eq. 11 wherever it lands.

    Parameters
    ----------
    model : ModalModel
        Mass-normalised, as bodies with mode shapes are.
    at : place
    energy : float
        J.

    Raises
    ------
    OptionError
        When the energy does not exceed 0, or no mode moves there.
    """
    if not (np.isfinite(energy) and energy > 0):
        raise OptionError(f"energy is {energy}: it must be a finite number above 0")
    return float(np.sqrt(2 * energy) / np.linalg.norm(_along_push(model, at)))


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
    displacement, velocity : callable, optional
        Along z at points on top of the body (K, 3): m and m/s (K,). Zero unless given.

    Returns
    -------
    two arrays (M,)
        m.

    Raises
    ------
    OptionError
        When the model knows its shapes at vertices alone.
    """
    formula = _formula(model)
    places, weights = plan_rule(model.gains.surface)  # type: ignore[attr-defined]  # has a formula
    forms = formula.displacements(places)[:, 2]
    scale = np.sqrt(weights @ np.square(forms))
    rates = 2 * np.pi * model.natural_frequencies

    def mean(field: Field | None) -> Array:
        values = np.zeros(len(places)) if field is None else np.asarray(field(places), float)
        return (weights * values) @ (forms / scale)

    return mean(velocity) / rates, mean(displacement)


def _along_push(model: ModalModel, at: Place) -> Array:
    contact = model.contact(at)
    shapes = model.gains.at(contact.point[None], contact.direction[None])[0, 0]
    if not np.any(np.abs(shapes) > np.finfo(float).eps * np.sqrt(len(shapes))):
        raise OptionError(f"no mode moves at {at}: strike another place")
    return shapes


def _formula(model: ModalModel) -> TransverseShapes:
    gains = model.gains
    if not isinstance(gains, ShapeGains) or gains.formula is None:
        raise OptionError(
            "this model knows its shapes at vertices alone: analyze a body of struck.shapes"
        )
    return gains.formula
