"""Report of a batch: a row for each body as CSV and JSON, labels of its sounds, and a page."""

from __future__ import annotations

import csv
import hashlib
import html
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from struck.batch.job import MODEL, BodyJob
from struck.batch.strike_set import struck_as
from struck.errors import MissingDependencyError, OptionError, StruckError, counted, rounded
from struck.excitation.strike import Strike
from struck.files import model_file
from struck.files.atomic import write_bytes
from struck.model.html import document, picture, table
from struck.model.material import Material
from struck.model.mesh import Mesh
from struck.model.picture_style import in_default_style

PAGES = ("report.json", "report.csv", "report.html")
_MAX_FIGURES = 20  # bodies or strikes on the page
_EXAMPLE_DURATION = 1.5  # s, of a body without strikes
_HEADINGS = ("file", "part", "status", "modes", "lowest (Hz)", "error (%)", "CPU (s)", "GB", "told")
_SEAL = "<!-- of {} -->\n"


@dataclass(frozen=True, slots=True, kw_only=True)
class BatchRow:
    """Result of one body of a batch.

    Parameters
    ----------
    file : str
        Name of the file.
    part : str, default ""
        Name of the part of a file with several bodies.
    material : str, default ""
        Name of the material.
    model : str, default ""
        Name of the model in the folder; empty if there is none.
    status : str
        "done" or "failed".
    modes : int, default 0
        Number of modes. If 0, only the recoil of the body is audible, as `message` states.
    lowest : float or None, default None
        Lowest frequency, Hz.
    error : float or None, default None
        Largest relative error of a frequency.
    cpu : float, default 0.0
        Processor time, s.
    memory : float, default 0.0
        Peak memory of the process, bytes.
    warnings : tuple of str, optional
        Repairs and doubts.
    failure : str, default ""
        Name of the error.
    message : str, default ""
        Text of the error, or what was left out.
    labels : tuple of mappings, optional
        Arguments of `struck.Strike` and `struck.render` for each of its sounds.
    """

    file: str
    part: str = ""
    material: str = ""
    model: str = ""
    status: str
    modes: int = 0
    lowest: float | None = None
    error: float | None = None
    cpu: float = 0.0
    memory: float = 0.0
    warnings: tuple[str, ...] = ()
    failure: str = ""
    message: str = ""
    labels: tuple[Mapping[str, Any], ...] = field(default=(), repr=False)

    @classmethod
    def of(cls, job: BodyJob, facts: Mapping[str, Any]) -> BatchRow:
        """Make the row of a finished job.

        Parameters
        ----------
        job : BodyJob
            The job.
        facts : mapping
            Content of its facts file.

        Returns
        -------
        BatchRow
            The row.
        """
        material, model = job.material, "" if "failure" in facts else f"{job.output}{MODEL}"
        material_name = material.name if isinstance(material, Material) else material
        body = {
            "file": job.file,
            "part": job.options.get("part") or "",
            "material": material_name,
            "model": model,
        }
        names = ("modes", "lowest", "error", "cpu", "memory", "failure", "message")
        return cls(
            **body,
            status="done" if model else "failed",
            **{name: facts[name] for name in names if name in facts},
            warnings=tuple(facts.get("warnings", ())),
            labels=tuple({**body, **each} for each in facts.get("labels", ())),
        )

    def plain(self) -> dict[str, Any]:
        """Return the row as JSON values.

        Returns
        -------
        dict
            Values by name, without the labels of the sounds.
        """
        values = asdict(self)
        del values["labels"]
        return values


@dataclass(frozen=True, slots=True, kw_only=True)
class BatchReport:
    """Results of all bodies of a batch, with the report written of them.

    Parameters
    ----------
    folder : Path
        Folder of the models and the report.
    rows : tuple of BatchRow
        Rows in the order of the names of the models.
    computed : int, default 0
        Number of bodies that were analyzed in this run; the others were there already.
    """

    folder: Path
    rows: tuple[BatchRow, ...]
    computed: int = 0

    @property
    def failed(self) -> tuple[BatchRow, ...]:
        """Rows of the bodies without a model."""
        return tuple(row for row in self.rows if row.status == "failed")

    @property
    def labels(self) -> list[Mapping[str, Any]]:
        """Labels of all sounds, in order."""
        return [label for row in self.rows for label in row.labels]

    def __str__(self) -> str:
        done = len(self.rows) - len(self.failed)
        cpu = sum(row.cpu for row in self.rows)
        return (
            f"{done} of {len(self.rows)} models in {self.folder}, {self.computed} computed now "
            f"({cpu:.0f} s of a processor in all)"
        )

    def written(self, labels: str) -> BatchReport:
        """Write report, page and the table of labels to the folder.

        Parameters
        ----------
        labels : str
            Name of the table of labels.

        Returns
        -------
        BatchReport
            The report itself.
        """
        rows, folder = [row.plain() for row in self.rows], self.folder
        write_bytes(folder / PAGES[0], json.dumps(rows, indent=1).encode())
        write_bytes(
            folder / PAGES[1],
            _csv([{**row, "warnings": " ".join(row["warnings"])} for row in rows]),
        )
        if self.labels:
            write_bytes(folder / labels, label_table(labels, self.labels))
        seal = _SEAL.format(hashlib.sha256(json.dumps([rows, self.labels]).encode()).hexdigest())
        page = folder / PAGES[2]
        if not _begins(page, seal.encode()):
            write_bytes(page, seal.encode(), self._page().encode())
        return self

    def _page(self) -> str:
        """Return an HTML page with some bodies or strikes, and a table of all."""
        entries = [
            (row, label) for row in self.rows if row.model for label in row.labels or (None,)
        ]
        chosen = np.unique(
            np.linspace(0, len(entries) - 1, min(len(entries), _MAX_FIGURES)).astype(int)
        )
        shown = ""
        for row, some in groupby((entries[each] for each in chosen), key=itemgetter(0)):
            shown += self._shown(row, [label for _, label in some])
        failed, done = self.failed, [row for row in self.rows if row.model]
        body = f"<p>{len(done)} of {len(self.rows)} bodies have a model.</p>"
        if shown:
            title = f"{len(chosen)} of {len(entries)} sounds"
            key = "A dot marks where it was struck, a ring that this is on the far side."
            body += f"<section><h2>{title}</h2><p>{key if self.labels else ''}</p>"
            body += f'<div class="sounds">{shown}</div></section>'
        for title, rows in ((f"{len(failed)} failed", failed), (f"{len(done)} models", done)):
            if rows:
                cells = table(_HEADINGS, [_cells(row) for row in rows])
                body += f"<section><h2>{title}</h2>{cells}</section>"
        return document("struck: many bodies", body, style=_STYLE)

    def _shown(self, row: BatchRow, labels: Sequence[Mapping[str, Any] | None]) -> str:
        """Return a body's picture and the sound of each of some strikes."""
        from struck.scene.render import render

        name, figures = f"{row.file} {row.part}".strip(), ""
        try:
            model = model_file.load(self.folder / row.model)
            picture = None if model.geometry is None else _Picture(model.geometry)
            for label in labels:
                if label is None:
                    sound = render(model, Strike(), seconds=_EXAMPLE_DURATION)
                    caption = counted(row.modes, "mode")
                    caption += f" from {row.lowest:.0f} Hz" if row.lowest else ""
                    caption += f", struck at {model.contact().place}"
                else:
                    sound = struck_as(model, label)
                    impulse = f"{rounded(label['impulse'], 2)} N s".replace(
                        " ", "\N{NO-BREAK SPACE}"
                    )
                    caption = f"{label['striker'] or 'struck'}, {impulse}"
                image = "" if picture is None else picture.of(f"the body of {name}", label)
                text = html.escape(f"{name}, {row.material}: {caption}")
                content = f"{image}<br>{sound._repr_html_()}<figcaption>{text}</figcaption>"
                figures += f"<figure>{content}</figure>"
        except StruckError as error:  # a file that was changed meanwhile
            return f"<figure><figcaption>{html.escape(str(error))}</figcaption></figure>"
        return figures


_STYLE = """\
.sounds figure { flex: 1 1 14rem; max-width: 16rem; }
audio { width: 100%; }
table { font-size: .85rem; }
:is(td, th):is(:first-child, :last-child) { text-align: left; overflow-wrap: anywhere; }
td:last-child { max-width: 28rem; }
section { overflow-x: auto; }
"""


def _cells(row: BatchRow) -> tuple[str, ...]:
    lowest = "" if row.lowest is None else f"{row.lowest:.1f}"
    error = "" if row.error is None else rounded(100 * row.error, 2)
    remarks = " ".join(part for part in (row.failure, row.message, *row.warnings) if part)
    counts = (str(row.modes) if row.model else "", lowest, error)
    return (
        row.file,
        row.part,
        row.status,
        *counts,
        f"{row.cpu:.1f}",
        f"{row.memory / 1e9:.2f}",
        remarks,
    )


class _Picture:
    """A body, drawn once, on which one strike after the other is marked."""

    @in_default_style
    def __init__(self, surface: Mesh) -> None:
        from struck.report.charts import ORANGE, chart
        from struck.report.surface_picture import Painter

        self._figure, self._painter = chart(2.6, 1.9), Painter.of(surface)
        axes = self._figure.subplots()
        self._painter.paint(axes)
        (self._mark,) = axes.plot([], [], "o", color=ORANGE, markersize=7)

    def of(self, text: str, label: Mapping[str, Any] | None) -> str:
        """Return the image as HTML, with an alternative text."""
        if label is not None:
            x, y, height = self._painter.view @ [label[axis] for axis in "xyz"]
            is_hidden = height < (self._painter.surface.points @ self._painter.view[2]).mean()
            self._mark.set(data=([x], [y]), fillstyle="none" if is_hidden else "full")
        image = picture(text, self._figure)
        self._figure.set_layout_engine("none")  # found once
        return image


def _csv(rows: Sequence[Mapping[str, Any]]) -> bytes:
    """Return a table as CSV, floats in as many digits as they have."""
    text = io.StringIO(newline="")
    names = list(dict.fromkeys(name for row in rows for name in row))
    writer = csv.DictWriter(text, names, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue().encode()


def require_labels(name: str) -> None:
    """Raise MissingDependencyError or OptionError where labels of that name cannot be written."""
    if Path(name).name != name or not name.endswith((".csv", ".parquet")):
        raise OptionError(f"labels is {name!r}: give the name of a .csv or .parquet in the folder")
    if name.endswith(".parquet"):
        try:
            import pyarrow.parquet  # noqa: F401 - imported to see whether it is installed
        except ImportError as error:
            raise MissingDependencyError(
                "Parquet files need pyarrow: pip install 'struck[parquet]', or name a .csv"
            ) from error


def label_table(name: str, labels: list[Mapping[str, Any]]) -> bytes:
    """Return labels as CSV, or as Parquet by the ending of their table's name."""
    if name.endswith(".csv"):
        return _csv(labels)
    from pyarrow import Table, parquet

    data = io.BytesIO()
    parquet.write_table(Table.from_pylist(labels), data)
    return data.getvalue()


def _begins(path: Path, head: bytes) -> bool:
    """Return whether a file is there and begins with some bytes."""
    try:
        with path.open("rb") as file:
            return file.read(len(head)) == head
    except OSError:
        return False
