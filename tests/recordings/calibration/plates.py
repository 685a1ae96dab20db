"""Plates whose modes are known by two methods, and what a recording would tell of them."""

from __future__ import annotations

import functools
from dataclasses import dataclass, fields

import numpy as np
import scipy.linalg
from numpy.polynomial import legendre
from numpy.random import Generator
from numpy.typing import NDArray

from struck import InternalFriction, Material, ModalModel
from struck.model.gains import Gains
from struck.shapes.shape import Shape

Array = NDArray[np.float64]
Index = NDArray[np.int64]

STEEL = Material(
    density=7850.0,
    youngs_modulus=200e9,
    poisson_ratio=0.29,
    damping=InternalFriction(loss_tangent=1e-3, external=1.0),
)
HIGHEST = 8000.0
_ALONG, _ACROSS = 24, 18


class Unheard(Gains):
    """Gains of a model of which frequencies and decays alone matter."""

    @property
    def calibrated(self) -> bool:
        return False

    def changed(self, *_: object) -> Gains:  # type: ignore[override] - whatever has changed
        return self

    def at(self, points: Array, directions: Array) -> Array:
        raise NotImplementedError

    def toward(self, listeners: Array) -> NDArray[np.complex128]:
        raise NotImplementedError


def model_of(shape: Shape, material: Material = STEEL, highest: float = HIGHEST) -> ModalModel:
    """Return the model of a shape, without what it looks and sounds like."""
    told = shape.vibration(material, highest)
    model = ModalModel(
        frequencies=told.frequencies,
        natural_frequencies=told.frequencies,
        decays=np.zeros_like(told.frequencies),
        gains=Unheard(),
        material=material,
        supported=shape.supported,
        tensioned=shape.tensioned,
        complete_to=highest,
        poisson_slopes=told.poisson_slopes,
        errors=told.errors,
    )
    return model.damped(material.damping)


@dataclass(frozen=True, kw_only=True, eq=False)
class Modes:
    """Modes with the standard errors of a fit; truth: numbers of the body's modes, -1 for none."""

    frequencies: Array
    decays: Array
    gains: NDArray[np.complex128]
    frequency_errors: Array
    decay_errors: Array
    truth: Index

    def chosen(self, which: Array) -> Modes:
        return Modes(**{each.name: getattr(self, each.name)[which] for each in fields(self)})


def ringing_plate(
    size: tuple[float, float, float], material: Material, highest: float = HIGHEST
) -> Modes:
    """Return the modes of a free thin plate, length x width x thickness, m, without errors.

    By Ritz's method with Legendre polynomials, none of which the library uses (Leissa, NASA SP-160,
    1969, lists the energies).
    """
    nu = material.poisson_ratio
    stiffness = material.youngs_modulus * size[2] ** 2 / (12 * (1 - nu**2) * material.density)
    natural = np.sqrt(_eigenvalues(size[0], size[1], nu) * stiffness) / (2 * np.pi)
    return of_frequencies(natural[natural < highest], material)


def of_frequencies(natural: Array, material: Material) -> Modes:
    """Return modes with the material's damping, without errors."""
    decays = material.damping.decays(natural)
    none = np.zeros(len(natural))
    return Modes(
        frequencies=np.sqrt(natural**2 - (decays / (2 * np.pi)) ** 2),
        decays=decays,
        gains=np.ones(len(natural), complex),
        frequency_errors=none,
        decay_errors=none,
        truth=np.arange(len(natural)),
    )


@functools.cache
def _eigenvalues(length: float, width: float, nu: float) -> Array:
    """Return eigenvalues of the biharmonic operator, ascending, but for rigid motions."""
    one, bent, mixed, turned = _energies(_ALONG, length)
    other, other_bent, other_mixed, other_turned = _energies(_ACROSS, width)
    stiffness = np.kron(bent, other) + np.kron(one, other_bent)
    both = np.kron(mixed, other_mixed.T)
    stiffness += nu * (both + both.T) + 2 * (1 - nu) * np.kron(turned, other_turned)
    return scipy.linalg.eigvalsh(stiffness)[3:]


def _energies(degrees: int, length: float) -> tuple[Array, ...]:
    """Return integrals of w w, w'' w'', w'' w and w' w' of orthonormal polynomials w."""
    places, weights = legendre.leggauss(degrees + 4)
    basis = [legendre.Legendre.basis(n) * np.sqrt(n + 0.5) for n in range(degrees)]
    plain, slope, bend = (
        np.array([(each.deriv(order) if order else each)(places) for each in basis])
        * (2 / length) ** order
        for order in range(3)
    )
    pairs = ((plain, plain), (bend, bend), (bend, plain), (slope, slope))
    return tuple((a * weights) @ b.T for a, b in pairs)


def as_fitted(
    true: Modes,
    chance: Generator,
    *,
    missing: float = 0.2,
    extra: float = 0.2,
    cents: float = 0.01,
    decay: float = 0.01,
) -> Modes:
    """Return modes in any order, with errors, some missing and some that the body does not have."""
    count = len(true.frequencies)
    kept = true.chosen(chance.permutation(count)[round(missing * count) :])
    lowest, highest = np.log(true.frequencies[[0, -1]])
    strange = np.exp(chance.uniform(lowest, highest, round(extra * count)))
    rates = np.interp(strange, true.frequencies, true.decays)
    frequencies = np.r_[kept.frequencies, strange]
    decays = np.r_[kept.decays, rates * np.exp(chance.normal(0, 0.5, len(strange)))]
    frequency_errors, decay_errors = cents * np.log(2) / 1200 * frequencies, decay * decays
    total = len(frequencies)
    fitted = Modes(
        frequencies=frequencies + frequency_errors * chance.normal(size=total),
        decays=decays + decay_errors * chance.normal(size=total),
        gains=10 ** (chance.normal(0, 8, total) / 20) + 0j,
        frequency_errors=frequency_errors,
        decay_errors=decay_errors,
        truth=np.r_[kept.truth, np.full(len(strange), -1)],
    )
    return fitted.chosen(chance.permutation(total))
