"""Tuning: the dimension of a solid that makes its lowest mode ring at a wanted frequency.

The chimes of O'Brien et al. 2002 (Table 2, "adjusted") were tuned so by their lengths.
"""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import Any, cast

import numpy as np

from struck.analysis.discretisation import Solid
from struck.errors import OptionError
from struck.model.arrays import checked
from struck.model.damping import hertz, ringing
from struck.model.material import Material
from struck.model.provenance import Progress, silent
from struck.solids.fem.vibration import lowest_frequency

_IN_TUNE = 1e-7
_STEPS = 40


@checked
def tuned(
    body: Any,  # noqa: ANN401 - anything else is refused by name
    material: Material | str,
    *,
    vary: str,
    lowest: float | str,
    accuracy: str = "standard",
    progress: Progress = silent,
) -> Solid:
    """Find the dimension `vary` that makes the lowest mode of `body` ring at `lowest` Hz.

    The elements are those that `accuracy` begins with. `struck.analyze` may take finer ones, and is
    then off `lowest` by up to its stated error.

    Parameters
    ----------
    body : a solid of struck.solids
    material : Material or str
    vary : str
        Name of the dimension, such as "length".
    lowest : float
        Hz, or a note as "A5" or "A5+12c".
    accuracy : str
        "preview", "standard" or "fine".
    progress : callable
        Told the stage and the fraction of it that is done.

    Returns
    -------
    solid
        A copy with that dimension.

    Raises
    ------
    OptionError
        When the body has no such dimension, or it does not reach the frequency.
    """
    if not isinstance(body, Solid):
        raise OptionError(
            f"{type(body).__name__} has no dimensions to vary: give a solid, or scale its model "
            "by ModalModel.tuned(lowest=)"
        )
    if isinstance(material, str):
        material = Material.named(material)
    lowest = hertz("lowest", lowest)
    start = _dimension(body, vary)
    points = [_measured(body, material, start, vary, accuracy)]
    # Bending goes with 1 / length^2, all else more gently: a first step that seldom overshoots.
    guess = points[0][0] * (points[0][1] / lowest) ** 0.5
    for step in range(_STEPS):
        progress("tune", step / _STEPS)
        points.append(_measured(body, material, guess, vary, accuracy))
        if abs(points[-1][1] / lowest - 1) < _IN_TUNE:
            return _with(body, vary, guess)
        guess = _next(points[-2:], lowest)
    raise OptionError(
        f"{vary} cannot bring the lowest mode to {lowest:g} Hz: after {_STEPS} steps it rings at "
        f"{points[-1][1]:.5g} Hz with {vary} = {points[-1][0]:.5g}; vary another dimension"
    )


def _dimension(body: Solid, vary: str) -> float:
    names = [field.name for field in fields(body)] if is_dataclass(body) else []
    numbers = [name for name in names if isinstance(getattr(body, name), int | float)]
    if vary not in numbers:
        raise OptionError(f"vary is {vary!r}: this body has {', '.join(numbers) or 'no numbers'}")
    return float(getattr(body, vary))


def _with(body: Solid, vary: str, value: float) -> Solid:
    """Return a copy with another dimension; `_dimension` has seen that it is a dataclass."""
    return replace(cast("Any", body), **{vary: value})


def _measured(
    body: Solid, material: Material, value: float, vary: str, accuracy: str
) -> tuple[float, float]:
    """Return the dimension with the lowest ringing frequency it gives."""
    mesh = _with(body, vary, value).volume_mesh(accuracy)
    natural = lowest_frequency(mesh, material)
    return value, float(ringing(natural, material.damping.decays(natural)))


def _next(points: list[tuple[float, float]], lowest: float) -> float:
    """Return the secant's next value, on logarithms, in steps of a factor of 2 at most."""
    (x0, x1), (y0, y1) = np.log(np.array(points)).T
    slope = (y1 - y0) / (x1 - x0) if x1 != x0 else 0.0
    if not np.isfinite(slope) or abs(slope) < 1e-3:
        raise OptionError("the lowest mode does not follow this dimension: vary another")
    return float(np.exp(x1 + np.clip((np.log(lowest) - y1) / slope, -np.log(2), np.log(2))))
