"""Options of `struck.analyze` by the kind of body: which apply to it, and why the others do not."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from struck.analysis.discretisation import Solid
from struck.analysis.discretisation import Source as ElementsSource
from struck.errors import OptionError, kind_of
from struck.files.messages import READERS
from struck.model.mesh import Mesh
from struck.solids.volume_mesh import VolumeMesh

if TYPE_CHECKING:
    from typing_extensions import TypeIs

    from struck.shapes.shape import Shape

Source: TypeAlias = "ElementsSource | Shape"

_FILE = ("units", "size", "part", "up")
_SURFACE = ("wall", "holes", "repair", "repair_seconds")
_NOT_OF_FORMULA = (*_SURFACE, "fixed", "accuracy", "backend")
_NO_FILE = "{0}= does not apply here: {1} is no file, and has its own size, axes and one piece"


def is_shape(body: Source) -> TypeIs[Shape]:
    """Return whether a body is in closed form, without loading struck.shapes for all others."""
    shapes = sys.modules.get("struck.shapes.shape")
    return shapes is not None and isinstance(body, shapes.Shape)


def refusals(body: Source, *, formula: bool = True) -> dict[str, str]:
    """Return the options that do not apply to a body, each with a message about its `{value!r}`.

    This is the only list of them: `require_applicable` refuses what it names, and `applicable`
    leaves it out. Closed forms are computed by their formula, or by finite elements without
    `formula`.
    """
    kind = kind_of(getattr(body, "of", body))
    if is_shape(body):
        messages = {name: _NO_FILE.format(name, kind) for name in _FILE}
        if formula:
            return messages | {name: _formula_message(body, kind, name) for name in _NOT_OF_FORMULA}
        return refusals(body.solid()) | messages
    if isinstance(body, Mesh):
        return {
            name: f"{name}= does not apply here: a Mesh is in metres already"
            for name in _FILE
            if name != "part"
        }
    if isinstance(body, str | os.PathLike) and Path(body).suffix.lower() in READERS:
        messages = {
            name: f"{name}= does not apply here: elements of another program take units= only"
            for name in _FILE
            if name != "units"
        }
        return messages | _surface_messages("a volume mesh") | _accuracy_messages("a volume mesh")
    if isinstance(body, VolumeMesh | Solid):
        messages = {name: _NO_FILE.format(name, "this body") for name in _FILE}
        messages |= _surface_messages(kind)
        has_elements = getattr(body, "elements", None) is not None
        return messages | (_accuracy_messages(kind_of(body)) if has_elements else {})
    return {}  # files and surfaces take all, and what is no body is refused where it is read


def require_applicable(body: Source, *, formula: bool = True, **options: object) -> None:
    """Refuse options that do not apply to a body; None is the value of an option not given.

    Raises
    ------
    OptionError
        With the option, its value, and what to do instead.
    """
    messages = refusals(body, formula=formula)
    for name, value in options.items():
        if value is not None and name in messages:
            raise OptionError(messages[name].format(value=value))


def applicable(body: Source, **options: Any) -> dict[str, Any]:  # noqa: ANN401 - of `analyze`
    """Return the options that apply to a body: for defaults that several kinds of body share."""
    messages = refusals(body)
    return {name: value for name, value in options.items() if name not in messages}


def _formula_message(shape: Shape, kind: str, name: str) -> str:
    """Return the message about an option that a formula does not take."""
    value = "" if name == "fixed" else "{value!r}"
    text = f"{name}={value} does not apply to {kind}, which is computed by a formula: leave it out"
    try:
        is_held = shape.solid().fixed is not None
    except OptionError:  # finite elements cannot compute it
        return text
    by_elements = name in {"accuracy", "backend"} or (name == "fixed" and not is_held)
    return f"{text}, or take method='fem'" if by_elements else text


def _surface_messages(kind: str) -> dict[str, str]:
    """Return the messages about options that only surfaces take."""
    return {
        name: f"{name}= applies to surfaces, and {kind} has its own dimensions: leave it out, or "
        "for a hollow body give a mesh of its surface"
        for name in _SURFACE
    }


def _accuracy_messages(kind: str) -> dict[str, str]:
    """Return the message about the accuracy of a body whose elements are given."""
    return {
        "accuracy": f"accuracy={{value!r}} chooses elements, and {kind} brings its own: "
        "leave one of them out"
    }
