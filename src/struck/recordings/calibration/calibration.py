"""What a body is made of, from a recording of it and a model of its shape.

2002's future work: "using their measured data for a given object to infer material parameters that
could then be applied to the geometry of a different object". Frequencies tell E / density and, as
far as modes follow it differently, Poisson's ratio; decays tell the damping. Sound alone tells
neither Young's modulus nor density, and 1 % of size is 2 % of E / density.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from struck.errors import MaterialError, OptionError, RecordingError
from struck.model.material import Material
from struck.model.model import ModalModel
from struck.recordings.calibration.chance import explains
from struck.recordings.calibration.elastic_fit import elastic_fit
from struck.recordings.calibration.expected import Expected
from struck.recordings.calibration.losses import Losses, losses
from struck.recordings.calibration.pairing import Pairing, paired
from struck.recordings.calibration.partials import FittedModes, Partials

Array = NDArray[np.float64]

FEWEST = 3
"""Pairs without which nothing is told."""
_ROUNDS = 8
# Steps this small, slopes carry on exactly.
_SETTLED = 1e-5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Calibration:
    """What a recording tells of a material.

    Parameters
    ----------
    specific_stiffness : float
        E / density, m^2/s^2: the square of the speed of sound along a thin bar.
    poisson_ratio : float
    covariance : array (2, 2)
        Of ln(E / density) and Poisson's ratio.
    freedom : float
        Degrees of freedom that the covariance was found with.
    scatter : float
        Relative standard deviation of frequencies about the model's, errors of fitting apart.
    losses : Losses
        The law of damping, with its errors and rivals.
    density : float
        kg/m^3; the model's, as sound does not tell it.
    name : str
        Of the model's material.
    pairing : Pairing
        With the modes of `model`.
    model : ModalModel
        The body as last computed.
    residuals : array (P,)
        Fitted frequencies over those of the model with these constants, cents.
    """

    specific_stiffness: float
    poisson_ratio: float
    covariance: Array
    freedom: float
    scatter: float
    losses: Losses
    density: float
    name: str
    pairing: Pairing
    model: ModalModel
    residuals: Array

    @property
    def standard_errors(self) -> tuple[float, float]:
        """Of E / density, relative, and of Poisson's ratio."""
        relative, ratio = np.sqrt(np.diag(self.covariance))
        return float(relative), float(ratio)

    def interval(self, level: float = 0.95) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return between which bounds E / density and Poisson's ratio lie with this probability.

        Raises
        ------
        OptionError
            When the level is not between 0 and 1.
        """
        if not 0 < level < 1:
            raise OptionError(f"level is {level}: give a probability between 0 and 1")
        reach = float(student.ppf((1 + level) / 2, self.freedom))
        relative, ratio = self.standard_errors
        stretch = np.exp(reach * relative)
        return (
            (self.specific_stiffness / stretch, self.specific_stiffness * stretch),
            (self.poisson_ratio - reach * ratio, self.poisson_ratio + reach * ratio),
        )

    def material(self, density: float | None = None) -> Material:
        """Return the material to analyze other bodies with.

        Parameters
        ----------
        density : float, optional
            kg/m^3; that of the model's material unless given. Frequencies do not depend on it.
        """
        given = self.density if density is None else density
        stiffness, ratio = self.standard_errors
        return Material(
            name=f"{self.name} as heard",
            density=given,
            youngs_modulus=self.specific_stiffness * given,
            poisson_ratio=self.poisson_ratio,
            damping=self.losses.law,
            source=(
                f"{len(self.pairing)} modes of a recording: E / density within "
                f"{100 * stiffness:.2g} %, "
                f"Poisson's ratio within {ratio:.2g}, standard errors; the density was assumed"
            ),
        )

    def errors_of(self, model: ModalModel) -> Array:
        """Return the relative standard errors of another body's frequencies due to the material.

        Parameters
        ----------
        model : ModalModel
            Computed with `material()`, with the slopes of its modes over Poisson's ratio.
        """
        slopes = model.poisson_slopes
        if slopes is None or not np.isfinite(slopes).all():
            raise MaterialError("these modes do not tell how they follow Poisson's ratio")
        design = np.stack([np.full(len(slopes), 0.5), slopes], axis=1)
        return np.sqrt(np.einsum("mi,ij,mj->m", design, self.covariance, design))

    def summary(self) -> list[str]:
        """Return what was found, a line each, with standard errors."""
        stiffness, ratio = self.standard_errors
        young = self.specific_stiffness * self.density / 1e9
        extra, missing = len(self.pairing.extra), len(self.pairing.missing)
        off = np.sqrt(np.mean(self.residuals**2))
        return [
            f"E/density {self.specific_stiffness:.6g} m2/s2, error {100 * stiffness:.2g} %",
            f"Poisson   {self.poisson_ratio:.4f}, error {ratio:.2g}",
            f"E         {young:.5g} GPa, if the density is {self.density:g} kg/m3",
            f"damping   {self.losses.name}: {self.losses.law}",
            f"pairs     {len(self.pairing)}; alone {extra} fitted modes, {missing} of the model",
            f"residual  {off:.2g} cents root mean square",
        ]


def calibrated(
    fitted: FittedModes | ModalModel,
    model: ModalModel,
    *,
    recompute: Callable[[Material], ModalModel] | None = None,
    widest: float = 2.0,
    size_error: float = 0.0,
) -> Calibration:
    """Infer a material from modes fitted to a recording and a model of the same shape.

    Parameters
    ----------
    fitted : FittedModes or ModalModel
        Anything with `frequencies`, `decays` and `gains`; standard errors count where it has them.
        Which mode is which need not be known.
    model : ModalModel
        The body, of a material that is about right.
    recompute : callable, optional
        Computes the body of another material, where that is exact and cheap. Without it, modes
        follow Poisson's ratio by their slopes: within 0.2 % for a ratio wrong by 0.05.
    widest : float
        Largest factor between fitted and computed frequencies, either way.
    size_error : float
        Relative standard error of the lengths that the model was made with: a body 1 % too large
        makes its material 2 % too stiff. A sheet goes with its thickness over its length squared.

    Returns
    -------
    Calibration

    Raises
    ------
    MaterialError
        When tension, not stiffness, drives the body back, or the model's material is unknown.
    RecordingError
        When fewer than three modes can be paired, or no more than by chance.
    OptionError
        On a `size_error` below 0.
    """
    known = inferable(model, size_error)
    partials = Partials.of(fitted)
    pairing = _require_pairs(paired(partials, model, widest=widest), partials)
    _require_likeness(partials, model, pairing)
    if recompute is not None:
        model, pairing = _recomputed(partials, model, pairing, recompute)
    fit = elastic_fit(partials, Expected(model=model), pairing, known.poisson_ratio)
    base = inferable(model)
    covariance = fit.covariance + np.diag([(2 * size_error) ** 2, 0.0])
    return Calibration(
        specific_stiffness=base.youngs_modulus / base.density * float(np.exp(2 * fit.shift)),
        poisson_ratio=fit.ratio,
        covariance=covariance,
        freedom=fit.freedom,
        scatter=fit.scatter,
        losses=_losses(partials, pairing),
        density=known.density,
        name=known.name,
        pairing=pairing,
        model=model,
        residuals=1200 / np.log(2) * fit.residuals,
    )


def inferable(model: ModalModel, size_error: float = 0.0) -> Material:
    """Return the material of a model from which another can be inferred.

    Raises
    ------
    MaterialError
        When tension, not stiffness, drives the body back, or the model's material is unknown.
    OptionError
        On a `size_error` below 0.
    """
    if not (np.isfinite(size_error) and size_error >= 0):
        raise OptionError(f"size_error is {size_error}: give a relative error of at least 0")
    if model.material is None:
        raise MaterialError("the model's own material is unknown: analyze the shape with a guess")
    if model.tensioned:
        raise MaterialError(
            "tension, not stiffness, drives this body back: its frequencies do not tell what it "
            "is made of"
        )
    return model.material


def _require_pairs(pairing: Pairing, partials: Partials) -> Pairing:
    if len(pairing) < FEWEST:
        raise RecordingError(
            f"{len(pairing)} of {len(partials.frequencies)} fitted modes could be paired with the "
            f"model's, fewer than {FEWEST}: check the shape and its size, or widen `widest`"
        )
    return pairing


def _require_likeness(partials: Partials, model: ModalModel, pairing: Pairing) -> None:
    if not explains(partials, model, pairing):
        raise RecordingError(
            f"only {len(pairing)} of {len(partials.frequencies)} fitted modes agree with the "
            f"model's {len(model.frequencies)}, no more than with random ones: check that it is "
            "the body recorded, its shape and how it was held"
        )


def _recomputed(
    partials: Partials,
    model: ModalModel,
    pairing: Pairing,
    recompute: Callable[[Material], ModalModel],
) -> tuple[ModalModel, Pairing]:
    """Compute the body anew until it is of the material that is heard."""
    known = inferable(model)
    for _ in range(_ROUNDS):
        material = inferable(model)
        fit = elastic_fit(partials, Expected(model=model), pairing, known.poisson_ratio)
        if abs(fit.shift) + abs(fit.ratio - material.poisson_ratio) < _SETTLED:
            break
        stiffness = material.youngs_modulus * float(np.exp(2 * fit.shift))
        wanted = replace(material, youngs_modulus=stiffness, poisson_ratio=fit.ratio)
        model = recompute(wanted)
        pairing = _require_pairs(paired(partials, model, widest=1), partials)
    return model, pairing


def _losses(partials: Partials, pairing: Pairing) -> Losses:
    heard = pairing.fitted
    return losses(
        partials.natural_frequencies[heard], partials.decays[heard], partials.decay_errors[heard]
    )
