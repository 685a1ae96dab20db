"""Repair of surfaces by the process that reads foreign files, within a bound of processor time."""

from __future__ import annotations

import time
from pathlib import Path

from struck.errors import MeshError, rounded
from struck.files.guard import read_foreign, texts_in
from struck.files.messages import READING_SECONDS, Answer, Frame, ReadingLimits
from struck.model.arrays import AnyArray, require_number
from struck.model.mesh import Mesh
from struck.solids.surface.repair import Repair, clean_repair, repair_mesh

REPAIR_SECONDS = READING_SECONDS  # s, default processor time for reading a file and its repair
_LEAST_SECONDS = 1e-3  # a limit of 0 s would be none


def repair_in_time(
    mesh: Mesh,
    *,
    wall: float | None,
    holes: str | None,
    seconds: float | None,
    time_spent: float = 0.0,
) -> tuple[Repair, float]:
    """Repair a surface as `repair_mesh` does, and return the processor time that it took, s.

    At most `seconds` are allowed; by default `REPAIR_SECONDS` less the `time_spent` on reading it.
    MeshError beyond them. A clean surface is returned at once.
    """
    if seconds is not None:
        require_number("repair_seconds", seconds, 0.0, 1e5, above=True, hint="it must exceed 0")
    result = clean_repair(mesh)
    if result is not None:
        return result, 0.0
    limit = max(REPAIR_SECONDS - time_spent, _LEAST_SECONDS) if seconds is None else seconds
    reading = f" after {rounded(time_spent, 2)} s for reading" * (time_spent > 0 and not seconds)
    return read_foreign(
        "repair",
        "",
        _repair_of,
        error=MeshError,
        work="repairing its surface",
        advice=f"allow more{reading} by repair_seconds=, give a coarser mesh (decimate it) or a "
        "closed one, or refuse what needs a repair by repair=False",
        options={"up": mesh.up, "wall": wall, "holes": holes},
        arrays=(mesh.points, mesh.faces),
        seconds=limit,
    )


def answer(
    _: Path,
    __: ReadingLimits,
    *,
    arrays: list[AnyArray],
    up: str,
    wall: float | None,
    holes: str | None,
) -> Answer:
    """Return a repaired surface as an answer of the process that reads files."""
    start, (points, faces) = time.process_time(), arrays
    result = repair_mesh(Mesh(points=points, faces=faces, up=up), wall=wall, holes=holes)
    content = {
        "up": up,
        "faults": result.faults,
        "changes": result.changes,
        "volume_before": result.volume_before,
        "volume_after": result.volume_after,
        "sheet": result.sheet,
        "seconds": time.process_time() - start,
    }
    return content, [result.mesh.points, result.mesh.faces]


def _repair_of(frame: Frame) -> tuple[Repair, float]:
    """Return the repaired surface that a message holds, and the processor time it took, s."""
    points, faces = frame.arrays
    content = frame.content
    repair = Repair(
        mesh=Mesh(points=points, faces=faces, up=content["up"]),
        faults=tuple(texts_in(frame, "faults")),
        changes=tuple(texts_in(frame, "changes")),
        volume_before=float(content["volume_before"]),
        volume_after=float(content["volume_after"]),
        sheet=bool(content["sheet"]),
    )
    return repair, float(content["seconds"])
