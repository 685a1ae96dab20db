"""Tuning: the dimension of a body that makes one of its modes ring at a wanted frequency.

The chimes of O'Brien et al. 2002 (Table 2, "adjusted") were tuned so by their lengths.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from struck.analysis.discretisation import Solid
from struck.analysis.source_options import is_shape
from struck.core.machine import in_few_threads
from struck.errors import COUNTED, MeshError, NoModeError, OptionError, kind_of, nearest, rounded
from struck.model.arrays import Array, checked
from struck.model.damping import hertz, ringing
from struck.model.material import Material
from struck.model.modes import Modes
from struck.model.provenance import Progress, reported, shown
from struck.solids.fem.vibration import lowest_frequency, vibration_modes

if TYPE_CHECKING:
    from struck.shapes.shape import Shape

    Body = Solid | Shape

Point = tuple[float, float]  # a value, and the frequency that it gives, Hz
FAMILIES = ("bending", "torsion", "stretching")
_IN_TUNE = 1e-7
# Under a cent: enough where rounding in the elements lets no step come nearer.
_CLOSE_TOLERANCE = 5e-4
_EDGES = ("length", "width", "height")  # of a block, along x, y and z
_STEPS = 40
_MAX_FACTOR = 64.0  # times the wanted frequency up to which a mode is looked for
# Modes of a family whose frequencies differ by less, relative, are one pair.
_PAIR_TOLERANCE = 1e-4
_ADVICE = (
    "give a body of struck.solids or struck.shapes, or what makes one, as "
    "functools.partial(bowl, radius=0.1), or scale its model by ModalModel.tuned(lowest=)"
)
_SLICES = 24  # across the longest axis; families differ by how these move


@dataclass(frozen=True, slots=True, kw_only=True)
class Tuning:
    """A tuned body, and by how much it was changed; `str` says it in a line.

    Parameters
    ----------
    body : solid or shape
        A copy of the one that was given, with the dimension found.
    vary : str
        Name of the dimension.
    mode : str
        The mode that was tuned, by its number or family.
    before, after : pair of float
        The dimension in its own units, as m, and the frequency that it gave, Hz.
    """

    body: Any
    vary: str
    mode: str
    before: tuple[float, float]
    after: tuple[float, float]

    def __str__(self) -> str:
        (old_size, old_frequency), (new_size, new_frequency) = self.before, self.after
        change = 100 * (new_size / old_size - 1)
        cents = 1200 * np.log2(new_frequency / old_frequency)
        return (
            f"{self.vary} {old_size:.7g} -> {new_size:.7g} ({change:+.2f} %): {self.mode} "
            f"{old_frequency:.2f} -> {new_frequency:.2f} Hz ({cents:+.0f} cents)"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Mode:
    """The mode that is tuned: number `number` of all, or of a family, from 1."""

    number: int
    family: str = ""

    @classmethod
    def of(cls, mode: int | str) -> _Mode:
        """Read "3", 3, "bending" or "bending 2"."""
        family, _, number = f"{mode}".strip().rpartition(" ")
        if not family and number in FAMILIES:
            family, number = number, "1"
        known = number.isdecimal() and int(number) >= 1
        if not known or family not in {"", *FAMILIES}:
            suggestion = nearest(family or number, FAMILIES)
            raise OptionError(
                f"mode is {mode!r}: {suggestion}give its number, or a family and a number, "
                f"as 'bending 2': {', '.join(FAMILIES)}; {COUNTED}"
            )
        return cls(number=int(number), family=family)

    def __str__(self) -> str:
        return f"{self.family or 'mode'} {self.number}"

    def natural(self, body: Body, material: Material, accuracy: str, start: float) -> float:
        """Return its natural frequency, looked for from `start` on, Hz."""
        if is_shape(body):
            if self.family in {"", "bending"}:
                return self._first(body.vibration(material, f).frequencies for f in _up(start))
            try:
                return self._of_solid(body.solid(), material, accuracy, start)
            except OptionError as error:
                message = str(error).replace("take method='formula'", "tune its bending")
                raise OptionError(message) from None
        if self.family:
            return self._of_solid(body, material, accuracy, start)
        return lowest_frequency(body.volume_mesh(accuracy), material, number=self.number)

    def _of_solid(self, solid: Solid, material: Material, accuracy: str, start: float) -> float:
        mesh, find_fixed = solid.volume_mesh(accuracy), getattr(solid, "fixed", None)
        fixed = None if find_fixed is None else find_fixed(mesh.nodes)

        def family_frequencies() -> Iterator[Array]:
            for limit_frequency in _up(start):
                try:
                    modes = vibration_modes(mesh, material, limit_frequency, fixed=fixed)
                except NoModeError:
                    continue
                yield modes.frequencies[np.array(families_of(modes)) == self.family]

        return self._first(family_frequencies())

    def _first(self, bands: Iterator[Array]) -> float:
        """Return the frequency of the first band that holds it."""
        most = 0
        for frequencies in bands:
            distinct_frequencies = [
                f for last, f in pairwise((0.0, *frequencies)) if f > last * (1 + _PAIR_TOLERANCE)
            ]
            listed = distinct_frequencies if self.family else frequencies
            if len(listed) >= self.number:
                return float(listed[self.number - 1])
            most = len(listed)
        raise OptionError(
            f"mode is '{self}', and up to {_MAX_FACTOR:g} times the wanted frequency there are "
            f"{most} {self.family or 'in all'}: give a lower number or another family"
        )


def _up(start: float) -> Iterator[float]:
    """Yield ends of bands, Hz, each twice the last."""
    return iter(start * 2.0 ** np.arange(1, np.log2(_MAX_FACTOR) + 1))


def _is_long(body: Any) -> bool:  # noqa: ANN401 - a shape or solid, by the attributes it has
    """Return whether a body may have families: a bar, block, tube or rod, no disc and no shell."""
    if is_shape(body):
        return hasattr(body, "ends")
    if hasattr(body, "profile"):  # turned; with a wall a bowl, bell or glass
        return body.wall is None
    return getattr(body, "length", np.inf) > 2 * getattr(body, "radius", 0.0)


def families_of(modes: Modes) -> list[str]:
    """Return the family of each mode of a long body, by how slices across it move as a whole.

    Those whose slices change their shapes most are "section".
    """
    points = modes.surface.points - modes.surface.points.mean(axis=0)
    axes = np.linalg.svd(points, full_matrices=False)[2]
    points, shapes = points @ axes.T, np.einsum("vdm,ed->vem", modes.shapes, axes)
    positions = points[:, 0]
    slice_edges = np.linspace(positions.min(), positions.max() * (1 + 1e-9), _SLICES + 1)
    energies = np.zeros((len(FAMILIES), len(modes.frequencies)))
    for low, high in pairwise(slice_edges):
        in_slice = (positions >= low) & (positions < high)
        if in_slice.sum() >= 3:
            energies += _as_a_whole(points[in_slice], shapes[in_slice])
    shares = energies / np.square(shapes).sum(axis=(0, 1))
    best = np.where(shares.max(axis=0) > 0.5, shares.argmax(axis=0), len(FAMILIES))
    return [(*FAMILIES, "section")[item] for item in best]


def _as_a_whole(points: Array, moved: Array) -> Array:
    """Return the squares of a slice's moves aside, about its axis and along it (3, M)."""
    offsets = points - points.mean(axis=0)
    rotations = [np.cross(axis, offsets) for axis in np.eye(3)]
    translations = [np.tile(axis, (len(offsets), 1)) for axis in np.eye(3)]
    motions = np.stack([*translations, *rotations]).reshape(6, -1).T
    weights = np.linalg.lstsq(motions, moved.reshape(-1, moved.shape[2]), rcond=None)[0]
    squares = np.square(weights) * np.square(motions).sum(axis=0)[:, None]
    return np.stack([squares[[1, 2, 4, 5]].sum(axis=0), squares[3], squares[0]])


@in_few_threads
@checked
def tune(
    body: Any,  # noqa: ANN401 - anything else is refused by name
    material: Material | str,
    *,
    vary: str,
    lowest: float | str | None = None,
    frequency: float | str | None = None,
    mode: int | str = 1,
    accuracy: str | None = None,
    progress: Progress | None = shown,
) -> Tuning:
    """Find the dimension of a body for which one of its modes has a given frequency.

    The elements are those with which `accuracy` begins. `struck.analyze` may take finer ones, and
    then differs by at most its stated error.

    Parameters
    ----------
    body : body of struck.solids or struck.shapes, or callable
        The body, or a function that makes it: one whose arguments have defaults, or
        ``functools.partial(bowl, radius=0.1)``.
    material : Material or str
        The material.
    vary : str
        Name of the dimension, such as "length", or of another number, such as the "tension" of a
        string.
    lowest : float or str, optional
        Frequency of the lowest mode, Hz, or a note such as "A5" or "A5+12c".
    frequency : float or str, optional
        Instead of `lowest`: frequency of `mode`.
    mode : int or str, default 1
        Number of the mode, from 1; or of one of a family: "bending 2", "torsion" or "stretching",
        by the motion of slices across the longest axis. Two modes of one frequency count once in a
        family.
    accuracy : {"preview", "standard", "fine"}, optional
        Accuracy of finite elements; not for formulas. Default: "standard".
    progress : callable or None, optional
        As for `struck.analyze`. The last stage reports the change.

    Returns
    -------
    Tuning
        The changed copy as its `body`; as text, the change.

    Raises
    ------
    OptionError
        If the body has no such dimension or family, or it does not reach the frequency.

    Examples
    --------
    >>> from struck.shapes import String
    >>> string = String(length=0.65, radius=0.0005, tension=70.0)
    >>> tuning = struck.analysis.tune(string, "steel", vary="tension", lowest="E3", progress=None)
    >>> round(tuning.body.tension, 2)
    283.03
    """
    _require_one(lowest, frequency)
    maker = _maker(body)
    body = _make(maker)
    if not (isinstance(body, Solid) or is_shape(body)):
        name = getattr(body, "__name__", type(body).__name__)
        raise OptionError(f"{name} has no dimensions to vary: {_ADVICE}")
    progress, chosen = reported(progress), _Mode.of(mode)
    target = _target_frequency(lowest, frequency, chosen)
    if chosen.family and not _is_long(body):
        raise OptionError(
            f"mode is {mode!r}, but {', '.join(FAMILIES)} are families of bars, blocks and long "
            f"tubes alone, and this is {kind_of(body)}: give a number, as mode=2"
        )
    if accuracy is not None and is_shape(body) and chosen.family in {"", "bending"}:
        raise OptionError(
            f"accuracy={accuracy!r} does not apply to {kind_of(body)}, which is computed by a "
            "formula: leave it out"
        )
    material = Material.of(material)

    def measured(value: float) -> Point:
        try:
            varied_body = _make(_with(maker, vary, value))
        except (OptionError, MeshError):  # beyond what the body allows
            return value, np.nan
        natural = chosen.natural(varied_body, material, accuracy or "standard", target)
        return value, float(ringing(natural, material.damping.decays(natural)))

    points, best_point = _approach(measured, _dimension(maker, vary), target, progress)
    if abs(best_point[1] / target - 1) > _CLOSE_TOLERANCE:
        (low, high), (deep, bright) = (
            (min(values), max(values)) for values in zip(*points, strict=True)
        )
        raise OptionError(
            f"{vary} cannot bring {chosen} to {target:.7g} Hz: between {vary} = {rounded(low, 5)} "
            f"and {rounded(high, 5)} it rings at {deep:.7g} to {bright:.7g} Hz, nearest at "
            f"{best_point[1]:.7g} Hz with {vary} = {best_point[0]:.7g}; check the lengths "
            "(m), or vary another dimension or mode"
        )
    tuned_body = _make(_with(maker, vary, best_point[0]))
    tuning = Tuning(
        body=tuned_body, vary=vary, mode=f"{chosen}", before=points[0], after=best_point
    )
    progress(f"tuned: {tuning}", 1.0)
    return tuning


def _approach(
    measured: Callable[[float], Point], start: float, target: float, progress: Progress
) -> tuple[list[Point], Point]:
    """Return values tried and their frequencies, Hz, until none comes nearer, and the nearest."""
    points = [best_point := measured(start)]
    # Bending goes with 1 / length^2, all else more gently: a first step that seldom overshoots.
    guess, step = start * (best_point[1] / target) ** 0.5, 0
    while step < _STEPS and np.isfinite(guess):
        progress("tuning", step / _STEPS)
        step, last, point = step + 1, points[-1][0], measured(guess)
        if np.isnan(point[1]):
            guess = (guess * last) ** 0.5 if abs(guess / last - 1) > 1e-3 else np.nan
            continue
        points.append(point)
        deviation, best_point = min((abs(item[1] / target - 1), item) for item in points)
        if deviation < _IN_TUNE or (deviation < _CLOSE_TOLERANCE and best_point not in points[-2:]):
            break
        guess = _next_value(points[-2:], target)
    return points, best_point


def _require_one(*pitches: object) -> None:
    """Refuse several notes in a text, as "C4,D4"."""
    for pitch in pitches:
        if isinstance(pitch, str) and len(notes := re.split(r"[,;\s]+", pitch.strip())) > 1:
            raise OptionError(
                f"{pitch!r} are {len(notes)} notes, and one body is tuned at a time: call tune "
                "once for each"
            )


def _target_frequency(
    lowest: float | str | None, frequency: float | str | None, mode: _Mode
) -> float:
    """Return the frequency to tune to, Hz, from one of two arguments."""
    if (lowest is None) == (frequency is None):
        missing_text = "no frequency is given to tune to"
        conflict_text = f"lowest is {lowest!r} and frequency is {frequency!r}"
        raise OptionError(
            f"{missing_text if lowest is None else conflict_text}: give one of lowest= and "
            "frequency=, in Hz or as a note, as 440 or A4"
        )
    if lowest is not None and (mode.family or mode.number != 1):
        raise OptionError(f"lowest is {lowest!r}, but mode is '{mode}': give frequency= of that")
    name, value = ("frequency", frequency) if lowest is None else ("lowest", lowest)
    return hertz(name, cast("float | str", value))


def _maker(body: Any) -> Any:  # noqa: ANN401 - a body, or what makes one
    """Return a body or a partial itself, and any other function as a partial of its defaults."""
    if isinstance(body, partial | Solid) or is_shape(body) or not callable(body):
        return body
    name, parameters = getattr(body, "__name__", "it"), inspect.signature(body).parameters.values()
    variadic = {inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD}
    required_names = [
        item.name for item in parameters if item.default is item.empty and item.kind not in variadic
    ]
    if required_names:
        values = ", ".join(f"{item}=..." for item in required_names)
        raise OptionError(
            f"{name} has no value for {', '.join(required_names)}: give "
            f"functools.partial({name}, {values})"
        )
    return partial(body)


def _make(body: Any) -> Any:  # noqa: ANN401 - a body, or what makes one
    return body() if isinstance(body, partial) else body


def _arguments(body: Any) -> dict[str, Any]:  # noqa: ANN401 - a body, or what makes one
    """Return all arguments of a body, or of its maker, by name."""
    if isinstance(body, partial):
        parameters = inspect.signature(body.func).parameters.items()
        return {name: item.default for name, item in parameters} | body.keywords
    names = [field.name for field in fields(body)] if is_dataclass(body) else []
    return {name: getattr(body, name) for name in names}


def _dimension(body: Any, vary: str) -> float:  # noqa: ANN401 - a body, or what makes one
    """Return a number of a body; the edges of a block are length, width and height."""
    values = _arguments(body)
    numbers = {name: item for name, item in values.items() if type(item) in {int, float}}
    numbers |= dict(zip(_EDGES, values.get("size", ()), strict=False))
    if vary not in numbers:
        suggestion = nearest(vary, list(numbers))
        raise OptionError(
            f"vary is {vary!r}: {suggestion}this body has {', '.join(numbers) or 'no numbers'} to "
            f"vary{'' if numbers else f': {_ADVICE}'}"
        )
    return float(numbers[vary])


def _with(body: Any, vary: str, value: float) -> Any:  # noqa: ANN401 - a body, or what makes one
    """Return a copy with another dimension; `_dimension` has seen that there is one."""
    known, change = _arguments(body), {vary: value}
    if vary not in known:
        edges = dict(zip(_EDGES, known["size"], strict=True)) | change
        change = {"size": tuple(edges.values())}
    if isinstance(body, partial):
        return partial(body.func, *body.args, **body.keywords | change)
    return replace(body, **change)


def _next_value(points: list[Point], target: float) -> float:
    """Return the secant's next value, by a factor of 2 at most; NaN where it leads nowhere."""
    (x0, x1), (y0, y1) = np.log(np.array(points)).T
    slope = (y1 - y0) / (x1 - x0) if x1 != x0 else 0.0
    if not np.isfinite(slope) or abs(slope) < 1e-3:
        return np.nan
    return float(np.exp(x1 + np.clip((np.log(target) - y1) / slope, -np.log(2), np.log(2))))
