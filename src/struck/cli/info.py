"""`struck info`: the contents of a model file, or the bodies of a mesh file."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

import struck
from struck.cli import Result
from struck.cli.options import budget, refuse
from struck.errors import counted, rounded
from struck.files.recognition import recognise
from struck.model.html import aligned, headings, modes_rows
from struck.model.model import LOUDEST
from struck.model.provenance import TerminalProgress

if TYPE_CHECKING:
    from struck.files import MeshPart

LISTED_MODES = 6  # modes, by default
PARTS = 20  # of a mesh file
EXAMPLES = ("bell.struck", "bell.struck --all", "kitchen.glb", "plates.stl --units mm")


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `struck info`."""
    parser.add_argument("file", help="model file or mesh file")
    parser.add_argument(
        "--modes",
        type=budget,
        default=LISTED_MODES,
        help=f"number of modes to list, or all; default: {LISTED_MODES}, with --json all",
    )
    parser.add_argument(
        "--all",
        action="store_true",
        help="list every mode and place, and the methods with their papers",
    )
    parser.add_argument(
        "--units", help="unit of the coordinates in a mesh file: m, cm, mm, in or ft"
    )


def run(options: argparse.Namespace, _progress: TerminalProgress) -> Result:
    """Run `struck info`."""
    kind = recognise(options.file)
    group = "" if kind is None else kind.group
    mesh = group in {"surface", "volume"}
    others, file_kind = (("modes", "all"), "model") if mesh else (("units",), "mesh file")
    refuse(options, others, f"is for a {file_kind}, and {options.file} is none: give one")
    if mesh:
        return (_parts if group == "surface" else _elements)(options.file, options.units)
    model = struck.load(options.file)
    places = [_Place.of(model, name) for name in (LOUDEST, *sorted(model.places))]
    unit = "dB re 20 uPa at 1 m" if model.calibrated else "dB"
    rows = [("place", ", ".join(model.coordinates) or "-", f"of a strike, {unit}")]
    rows += [place.row for place in places if options.all or place.name[0] not in "+-"]
    facts = {"levels": [asdict(place) for place in places]}
    mode_count = len(model.decays) if options.modes is None else options.modes  # None for all
    listed_count = mode_count if "modes" in options.given else None
    return describe_model(
        model, [], listed=listed_count, whole=options.all, places=aligned(rows), **facts
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Place:
    """A place of a model, its coordinates, and the level of `Strike(at=name)` there, dB."""

    name: str
    point: list[float]
    level: float | None  # None for silence

    @classmethod
    def of(cls, model: struck.ModalModel, name: str) -> _Place:
        """Strike a place, and take the loudest 1/8 s of the sound."""
        sound = struck.render(model, struck.Strike(at=name), seconds=0.5, fade=0)
        squares = np.square(sound.samples[0].astype(float))
        window = sound.sample_rate // 8
        peak_power = np.diff(np.cumsum(squares)[::window], prepend=0.0).max() / window
        level = 10 * math.log10(peak_power / 20e-6**2) if peak_power else None
        return cls(name=name, point=model.contact(name).point.tolist(), level=level)

    @property
    def row(self) -> tuple[str, str, str]:
        """Return a row's cells as texts for a table."""
        level = "silent" if self.level is None else f"{self.level:.1f}"
        point = ", ".join(rounded(round(each, 9) + 0.0, 4) for each in self.point)
        return self.name, point or "-", level


def _parts(file: str, units: str | None) -> Result:
    """Return the bodies in a file of a surface, and which of them `struck analyze` takes."""
    from struck.files import list_parts

    parts = list_parts(file, units=units)
    rows = [("part", "faces", "size, m", "volume, m^3", "")]
    has_several = len(parts) > 1
    for part in parts[:PARTS]:
        size = " x ".join(rounded(edge, 4) for edge in part.size)
        volume = "open" if part.volume is None else rounded(part.volume, 4)
        taken = "taken" if has_several and part.taken else ""
        rows.append((part.name, str(part.faces), size, volume, taken))
    more = [f"... and {len(parts) - PARTS} more"] if len(parts) > PARTS else []
    notes = [*([_taken_note(parts)] if has_several else []), *_unit(units)]
    return Result([*aligned(rows), *more, *notes], parts=[asdict(part) for part in parts])


def _taken_note(parts: Sequence[MeshPart]) -> str:
    """Return which of several parts `struck analyze` takes, as a sentence."""
    taken = [part.name for part in parts if part.taken]
    if parts[0].taken is None:
        return (
            "The surface is open: struck analyze sews it together, or takes it as a sheet with "
            "--wall; --part takes one part alone."
        )
    if len(taken) == len(parts):
        return "struck analyze takes all as one body, as they touch or overlap; --part takes one."
    if len(taken) == 1:
        return f"struck analyze takes {taken[0]}, the largest; --part takes another."
    return (
        f"struck analyze takes {counted(len(taken), 'part')} as one body, the largest, as they "
        "touch or overlap; --part takes one."
    )


def _elements(file: str, units: str | None) -> Result:
    """Return the elements and the size of a volume mesh file."""
    from struck.files import load_volume

    mesh = load_volume(file, units=units)
    edges = np.ptp(mesh.nodes, axis=0).tolist()
    volume = mesh.volume()
    elements, nodes = counted(len(mesh.elements), "element"), counted(len(mesh.nodes), "node")
    lines = [
        f"{elements} of kind {mesh.kind} on {nodes}",
        f"size      {' x '.join(rounded(edge, 4) for edge in edges)} m",
        f"volume    {rounded(volume, 4)} m^3",
        *_unit(units),
    ]
    return Result(
        lines,
        kind=mesh.kind,
        elements=len(mesh.elements),
        nodes=len(mesh.nodes),
        size=edges,
        volume=volume,
    )


def _unit(units: str | None) -> list[str]:
    """Return a note on the unit of a file's numbers where none is given."""
    return [] if units else ["Numbers of the file are taken as metres: --units says otherwise."]


def describe_model(
    model: struck.ModalModel,
    last: Sequence[str],
    *,
    listed: int | None = None,
    whole: bool = False,
    places: Sequence[str] = (),
    **facts: object,
) -> Result:
    """Return the contents of a model, with a table of `places`, `last` lines and more `facts`.

    Lines show its first modes, facts all of them or the number `listed`; `whole` shows all in both.
    """
    from struck.report.model_page import known_power, summary

    object_modes = np.flatnonzero(model.of_object)
    reported_modes = np.arange(len(model.decays)) if listed is None else object_modes[:listed]
    table_modes = (
        object_modes
        if whole and listed is None
        else object_modes[: LISTED_MODES if listed is None else listed]
    )
    mode_errors = np.full(len(model.decays), np.nan) if model.errors is None else model.errors
    rows = [headings(model), *modes_rows(model, table_modes)]
    power = known_power(model)
    efficiencies = None if power is None else power.efficiencies
    if efficiencies is not None:
        column = ("radiation efficiency", *(rounded(e, 2) for e in efficiencies[table_modes]))
        rows = [(*row, cell) for row, cell in zip(rows, column, strict=True)]
    left = len(object_modes) - len(table_modes)
    remark = [f"... and {left} more: struck info MODEL --modes {len(object_modes)}"] if left else []
    blocks = [*places, *([""] if places else []), *aligned(rows), *remark]
    blocks += [] if whole else ["how it was made: struck info MODEL --all"]
    lines = summary(model, whole=whole, power=power)
    lines = [line for line in lines if not (places and line.startswith("places"))]
    return Result(
        [*lines, "", *blocks, *last],
        frequencies=model.frequencies[reported_modes].tolist(),
        decays=model.decays[reported_modes].tolist(),
        decay_bounds=model.decay_bounds
        and [b[reported_modes].tolist() for b in model.decay_bounds],
        radiation_efficiencies=None
        if efficiencies is None
        else efficiencies[reported_modes].tolist(),
        errors=None if model.errors is None else or_null(mode_errors[reported_modes]),
        complete_to=model.complete_to,
        mass=model.mass,
        calibrated=model.calibrated,
        # Axes, levels in Pa s/N at 1 m, corners in Hz and damping ratios.
        recoil=model.recoil
        and {item.name: getattr(model.recoil, item.name).tolist() for item in fields(model.recoil)},
        places=sorted(model.places),
        provenance={
            "method": model.provenance.method,
            "dropped": list(model.provenance.dropped),
            "references": list(model.provenance.references),
            "details": dict(model.provenance.details),
        },
        **facts,
    )


def or_null(values: np.ndarray) -> list[float | None]:
    """Return numbers for JSON, with null in place of NaN."""
    return [value if math.isfinite(value) else None for value in values.tolist()]
