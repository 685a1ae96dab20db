"""Analysis of many mesh files: worker processes write models, and a report lists every file."""

from __future__ import annotations

import json
import os
import secrets
from collections import deque
from collections.abc import Iterable
from functools import partial
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any

from struck.batch.batch_report import PAGES, BatchReport, BatchRow, require_labels
from struck.batch.job import FACTS, OPTIONS, BodyJob
from struck.batch.job_process import Facts, find_finished, reopen
from struck.batch.job_table import Table, jobs_of, require_known, table_rows
from struck.batch.processes import Processes, failure
from struck.batch.strike_set import Strikes, StrikeSet
from struck.core import machine
from struck.errors import OptionError, SolverError, StruckError
from struck.files.atomic import make_folder, read_bytes, real, sweep, unread, write_bytes
from struck.model.arrays import checked, require_number
from struck.model.material import Material
from struck.model.provenance import Progress, silent

if TYPE_CHECKING:
    from distributed import Client

    from struck.batch.cluster import Cluster

_PATIENCE = 0.2  # s between two looks at the crew
_STAGE = "models"


@checked
def analyze_many(
    files: str | os.PathLike[str] | Iterable[str | os.PathLike[str]] | None = None,
    material: Material | str | None = None,
    *,
    out: str | os.PathLike[str],
    table: Table = None,
    strikes: Strikes | str | os.PathLike[str] | None = None,
    seed: int = 0,
    seconds: float = 1.0,
    sample_rate: int = 48_000,
    sounds: str = "wav",
    fade: float | None = None,
    labels: str = "labels.csv",
    resume: bool = True,
    processes: int | None = None,
    memory: float | None = None,
    scheduler: str | Client | None = None,
    cache: bool | str | os.PathLike[str] = True,
    progress: Progress | None = silent,
    **options: Any,  # noqa: ANN401 - of `struck.analyze`
) -> BatchReport:
    """Analyze many mesh files into a folder of models, with a report.

    Each body is analyzed by a process of one thread, which writes its ``.struck`` file completely
    or not at all: byte for byte the result of `struck.analyze` with one thread. A failure of one
    file does not stop the others, and is reported in its row.

    Parameters
    ----------
    files : str, path or sequence of them, optional
        Patterns such as ``meshes/**/*.obj``, folders, and names of files. The folders below the
        fixed part of a pattern are kept in `out`. A file of several bodies gives one model per
        body. Default: the files of `table`.
    material : Material or str, optional
        Material of every file for which the table has none.
    out : path
        Folder for the models and the report. It is created if it does not exist.
    table : path or sequence of mappings, optional
        Options of single files: CSV with names in its first line, or TOML with ``[[files]]`` for
        each. Columns are `file` (relative to the table), `material`, `output` (name of the model
        without its ending) and the options of `struck.analyze`; `band` and `fixed` are numbers
        separated by spaces. Its files need not be among `files`.
    strikes : int, path, sequence of mappings, or callable, optional
        Strikes of each model, whose sounds are written next to it: a number of random ones; or the
        same for all, by a CSV or TOML table of arguments of `struck.Strike`, and `listener`; or a
        function of a module, ``chosen(model, generator)``, that returns strikes or pairs of strike
        and listener. Default: no sounds.
    seed : int, default 0
        Seed of random strikes and of the generator.
    seconds : float, default 1.0
        Duration of each sound, s.
    sample_rate : int, default 48000
        Sample rate of the sounds, Hz.
    sounds : {"wav", "flac", "npz"}, default "wav"
        Format of the sounds: WAV; FLAC of 24 bit (struck[recordings]); or one array of all sounds
        of a model.
    fade : float, optional
        Duration of the fade of sounds that are cut off, s, as for `struck.render`; 0 for none.
        Default: 0.01.
    labels : str, default "labels.csv"
        Table in `out` of the contact, strike and listener of each sound: ``.csv``, or ``.parquet``
        (struck[parquet]).
    resume : bool, default True
        Keep results in `out` of the same content and options, including failures of a mesh.
        Otherwise compute all again.
    processes : int, optional
        Number of processes on this machine. Default: one per core.
    memory : float, optional
        Bytes that all processes may use together: as many run at once as their forecasts allow; a
        body whose forecast exceeds it runs alone, or is refused if that is impossible. Default: the
        free memory.
    scheduler : str or distributed.Client, optional
        A Dask cluster that does the work instead (struck[batch]), such as "tcp://host:8786".
    cache : bool or path, default True
        As for `struck.analyze`; on a cluster, a cache of each worker.
    progress : callable or None, optional
        Called as ``progress(stage, fraction)``. Default: silent.
    **options
        Options of `struck.analyze` for every file for which the table has no others.

    Returns
    -------
    BatchReport
        One row for each body; also written to `out` as ``report.csv``, ``.json`` and ``.html``.

    Raises
    ------
    OptionError
        If there are no files, two models would have one name, or an option is unknown.
    FileFormatError
        If a table is damaged, or the folder cannot be written.
    MissingDependencyError
        If an option needs a package that is not installed.

    Examples
    --------
    >>> import trimesh
    >>> for name, radius in (("small", 0.02), ("large", 0.03)):
    ...     _ = trimesh.creation.icosphere(subdivisions=2, radius=radius).export(f"{name}.stl")
    >>> report = struck.analyze_many(
    ...     "*.stl", "steel", out="models", accuracy="preview", units="m", progress=None
    ... )
    >>> [row.model for row in report.rows]
    ['large.struck', 'small.struck']
    """
    strike_set = None
    require_known(options, "analyze_many", (*OPTIONS, *[*signature(analyze_many).parameters][:-1]))
    sound_options = {
        "seed": (seed, 0),
        "seconds": (seconds, 1.0),
        "sample_rate": (sample_rate, 48_000),
    }
    sound_options |= {
        "sounds": (sounds, "wav"),
        "fade": (fade, None),
        "labels": (labels, "labels.csv"),
    }
    for name, (value, default) in ({} if strikes is not None else sound_options).items():
        if value != default:
            raise OptionError(
                f"{name}={value!r} is for sounds, which are made by strikes=: give it, or leave "
                f"{name}= out"
            )
    if strikes is not None:
        strike_source = table_rows(strikes) if isinstance(strikes, str | os.PathLike) else strikes
        strike_set = StrikeSet(
            strikes=strike_source,
            seed=seed,
            seconds=seconds,
            sample_rate=sample_rate,
            sounds=sounds,
            fade=fade,
        )
    if processes is not None:
        require_number("processes", processes, 1, 10_000, whole=True, hint="give 1 or more")
    if memory is not None:
        require_number("memory", memory, 1e6, 1e18, hint="give 1e6 or more", unit=" bytes")
    require_labels(labels)
    chosen = cache if isinstance(cache, bool) else os.fspath(cache)
    jobs = jobs_of(
        files, material, table, options, partial(BodyJob, strikes=strike_set, cache=chosen)
    )
    folder = Path(out)
    _require_apart(jobs, table, [folder / name for name in (*PAGES, labels)], folder)
    progress = progress or silent
    batch = _Batch(folder, run=_make_run(folder, jobs), resume=resume, progress=progress)
    for number, job in enumerate(jobs):
        progress("looking through files", number / len(jobs))
        batch.add(job)
    if not batch.waiting:
        progress("writing the report", 0.0)
    elif scheduler is None:
        free = machine.available() if memory is None else int(memory)
        count = processes or machine.cores()
        batch.run(Processes(folder, count=count, memory=free))
    else:
        from struck.batch.cluster import Cluster

        batch.run(Cluster(folder, scheduler, batch.name))
    return batch.report().written(labels)


def _require_apart(jobs: Iterable[BodyJob], table: Table, pages: list[Path], folder: Path) -> None:
    """Raise OptionError where an output file would replace an input file."""
    read = {real(job.file) for job in jobs}
    read |= {real(table)} if isinstance(table, str | os.PathLike) else set()
    for path in (*pages, *(job.path(folder) for job in jobs)):
        if real(path) in read:
            raise OptionError(f"{path} is read as well: give another folder for out=")


def _make_run(folder: Path, jobs: Iterable[BodyJob]) -> str:
    """Make the output folder without files of killed runs, and return the name of this run."""
    make_folder(folder, parents=True)
    for each in {job.path(folder).parent for job in jobs}:
        sweep(each)
    name = secrets.token_hex(16)
    write_bytes(folder / PAGES[0], json.dumps({"run": name}).encode())
    return name


class _Batch:
    """Jobs of one run: waiting, running, and the facts of ended ones."""

    def __init__(self, folder: Path, *, run: str, resume: bool, progress: Progress) -> None:
        self._folder, self._resume, self._progress = folder, resume, progress
        self.name = run
        self.waiting: deque[BodyJob] = deque()
        self._running: list[BodyJob] = []
        self._ended: dict[str, tuple[BodyJob, Facts]] = {}  # by their outputs
        self._alike: dict[str, list[BodyJob]] = {}  # by their keys: the first does the work of all
        self._computed = 0

    def add(self, job: BodyJob) -> None:
        """Take a job in, unless it was finished before or another does the same work."""
        try:
            job = job if job.key else job.with_key()
        except StruckError as error:
            self._end(job, failure(type(error).__name__, str(error)))
            return
        except (OSError, ValueError) as error:
            self._end(job, failure("FileFormatError", f"{job.file} {unread(job.file, error)}"))
            return
        twins = self._alike.setdefault(job.key, [])
        twins.append(job)
        facts = find_finished(job, self._folder) if self._resume else None
        if facts is not None:
            self._end(job, facts)
        elif twins[0] is job:
            self.waiting.append(job)
        elif twins[0].output in self._ended:
            self._end(job, self._copied(twins[0], job))

    def run(self, crew: Processes | Cluster) -> None:
        """Run all waiting jobs by a crew; on a SolverError of the crew the remaining jobs fail."""
        try:
            while self.waiting or self._running:
                while self.waiting and crew.free():
                    self._running.append(self.waiting.popleft())
                    crew.start(self._running[-1])
                outcome = crew.finished(_PATIENCE)
                if outcome is not None:
                    self._running.remove(outcome[0])
                    self._computed += 1
                    self._end(*outcome)
                left = len(self.waiting) + len(self._running)
                self._progress("computing models", 1 - left / (left + len(self._ended)))
        except SolverError as error:
            for job in (*self._running, *self.waiting):
                self._end(job, failure("SolverError", str(error)))
        finally:
            crew.close()
            for parent in {job.path(self._folder).parent for job in self._running}:
                sweep(parent)

    def report(self) -> BatchReport:
        """Return a row for each body, in the order of their outputs."""
        outcomes = [self._ended[output] for output in sorted(self._ended)]
        rows = [BatchRow.of(job, facts) for job, facts in outcomes if not facts.get("parts")]
        return BatchReport(folder=self._folder, rows=tuple(rows), computed=self._computed)

    def _end(self, job: BodyJob, facts: Facts) -> None:
        """Store the facts of an ended job, of its parts and of jobs with the same content."""
        self._ended[job.output] = job, facts
        for part in map(job.for_part, facts.get("parts", ())):
            other = self._ended.get(part.output, (part, facts))[0]
            if (other.file, other.options) == (part.file, part.options):
                self.add(part)
            else:
                message = f"it would become {part.output}, as {other.file} does: rename that"
                self._ended[f"{part.output} {job.key}"] = part, failure("OptionError", message)
        first, *others = self._alike.get(job.key, [job])
        for twin in others if first is job else ():
            if twin.output not in self._ended:
                self._end(twin, self._copied(job, twin))

    def _copied(self, first: BodyJob, twin: BodyJob) -> Facts:
        """Copy the model of a job with the same content and options to another name."""
        text = json.dumps(self._ended[first.output][1])
        facts = json.loads(text.replace(json.dumps(first.file)[1:-1], json.dumps(twin.file)[1:-1]))
        try:
            if "files" in facts:
                make_folder(twin.path(self._folder).parent, parents=True)
                model = read_bytes(first.path(self._folder))
                facts["files"] = {twin.path(Path()).as_posix(): len(model)}
                reopen(twin, self._folder)
                write_bytes(twin.path(self._folder), model)
                write_bytes(twin.path(self._folder, FACTS), json.dumps(facts, indent=1).encode())
        except (OSError, StruckError) as error:
            return failure("FileFormatError", str(error))
        return facts
