"""A job in a separate process: one body is analyzed, and its files are written whole.

The process that `processes` starts loads struck once, and forks for each job. It reads jobs as
pickles on standard input and answers lines of JSON on standard output; it ends with its input.
"""

from __future__ import annotations

import contextlib
import json
import os
import pickle
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path, PurePath
from types import UnionType
from typing import IO, Any

import numpy as np

from struck.analysis.analysis import CERTAIN, analyze
from struck.batch.job import FACTS, MODEL, BodyJob, content_of
from struck.errors import (
    CacheWarning,
    ContactError,
    LossWarning,
    MaterialError,
    MeshError,
    OptionError,
    RepairWarning,
    ScaleWarning,
    SolverError,
    StruckError,
    counted,
)
from struck.files import guard, meshes, model_file
from struck.files.atomic import make_folder, read_bytes, remove, write_bytes
from struck.model.model import ModalModel
from struck.model.provenance import ForecastStage
from struck.processes.address_space import reserve_blas_buffers
from struck.radiation import by_name
from struck.solids.resolution import coarser

Facts = dict[str, Any]  # results of a job, as JSON values
GIB = 2**30
PERMISSION = b"+"
_KEPT_ERRORS = (MeshError, MaterialError, OptionError, ContactError)  # which come again
_REPORTED_WARNINGS = (CacheWarning, LossWarning, RepairWarning, ScaleWarning)
_FIRST_TO_GO = b"500"  # of 1,000: where memory is short the system ends a job, not its user's work
_SLACK = 2 * GIB  # bytes that libraries reserve and do not use
# Types of the values in a facts file, which may come from elsewhere.
_TYPES: Mapping[str, type | UnionType] = {
    **dict.fromkeys(("key", "failure", "message"), str),
    **dict.fromkeys(("lowest", "error", "cpu", "memory"), int | float | None),
    **dict.fromkeys(("warnings", "parts", "labels"), list),
    "modes": int,
    "files": dict,
}


# The process


def main() -> None:
    """Do one job after the other, each in a fork where the system has them, until input ends."""
    import rslab  # noqa: F401 - once for all jobs, as all that stands above

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the program
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # libraries print elsewhere
    while size := _read(8):
        request = _read(int.from_bytes(size, "little"))
        if not hasattr(os, "fork"):
            _answer(request, answers)
            _tell(answers, ended=0)
            continue
        child = os.fork()
        if not child:
            try:
                _answer(request, answers)
            except BaseException:  # noqa: BLE001 - this fork must end on any error
                os._exit(1)
            os._exit(0)
        _tell(answers, ended=os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))


def _read(count: int) -> bytes:
    """Return a number of bytes of standard input, or none where it ends before."""
    data = b""
    while len(data) < count and (more := os.read(0, count - len(data))):
        data += more
    return data if len(data) == count else b""


def _tell(answers: IO[str], **message: object) -> None:
    answers.write(json.dumps(message) + "\n")
    answers.flush()


def _answer(request: bytes, answers: IO[str]) -> None:
    """Do the job that a pickle of (job, folder, memory) holds, and write its facts to `answers`."""
    job, folder, memory = pickle.loads(request)  # noqa: S301 - from who started this process
    allowed = threading.Event()
    threading.Thread(target=_listen, args=(allowed,), daemon=True).start()
    _confine(memory)

    coarser_levels = coarser(job.options.get("accuracy") or "standard")

    def wait(stage: str, _fraction: float) -> None:
        if isinstance(stage, ForecastStage):
            if memory is not None and stage.memory > CERTAIN * memory:
                raise SolverError(
                    f"finding its modes needs about {stage.memory / GIB:.1f} GiB of memory, and it "
                    f"may take {memory / GIB:.1f} GiB: give more memory=, "
                    f"{coarser_levels}{', ' if coarser_levels else ''}a narrower band or a simpler "
                    "mesh"
                )
            _tell(answers, forecast=stage.memory)
            allowed.wait()

    _tell(answers, facts=done(job, Path(folder), wait))


def _listen(allowed: threading.Event) -> None:
    """Wait for the parent's leave to compute; once the parent is gone, end the whole group."""
    while os.read(0, 1) == PERMISSION:
        allowed.set()
    if hasattr(os, "killpg"):
        os.killpg(0, signal.SIGKILL)
    os._exit(1)


def _confine(memory: int | None) -> None:
    """Bound the memory of this process, and offer it to the system as the first to be ended."""
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_bytes(_FIRST_TO_GO)
    with contextlib.suppress(ImportError, OSError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        if memory is not None:
            hard_limit = resource.getrlimit(resource.RLIMIT_DATA)[1]
            resource.setrlimit(resource.RLIMIT_DATA, (memory + _SLACK, hard_limit))


# The job


def done(job: BodyJob, folder: Path, progress: Callable[[str, float], None]) -> Facts:
    """Analyze a body, write its model into a folder, and return the facts of its facts file."""
    facts: Facts = {"key": job.key}
    try:
        reserve_blas_buffers()
        make_folder(job.path(folder).parent, parents=True)
        with _noting_warnings(facts):
            facts["parts"] = _several(job)
            if facts["parts"]:
                return _keep(job, folder, facts)
            options = {**job.options, "cache": job.cache, "progress": progress}
            by_name(options.get("radiation", "power"))  # refuses "field", which takes too long here
            model = analyze(job.file, job.material, **options)
        if content_of(job.file) != job.content:
            raise OSError(f"{job.file} changed while it was read: run it again")  # noqa: TRY301
        return _write(job, folder, facts | _describe(model), model)
    except Exception as error:  # noqa: BLE001 - an error of one file does not stop the others
        short = "memory is short: give it more, or run fewer jobs at once (processes=)"
        message = short if isinstance(error, MemoryError) else str(error)
        facts |= {"failure": type(error).__name__, "message": message, **_cost()}
        if isinstance(error, _KEPT_ERRORS) and not _may_pass(error):
            with contextlib.suppress(StruckError):
                _keep(job, folder, facts)
        return facts


def _several(job: BodyJob) -> list[str]:
    """Return the names of a file's bodies where it holds several and none was chosen."""
    if job.options.get("part") is not None or Path(job.file).suffix.lower() in meshes.SUFFIXES:
        return []
    try:
        return meshes.body_names(job.file)
    except MeshError:  # the analysis tells it, after repair
        return []


@contextlib.contextmanager
def _noting_warnings(facts: Facts) -> Iterator[None]:
    """Note the warnings that a person should read."""
    with warnings.catch_warnings(record=True) as records:
        warnings.simplefilter("always")
        try:
            yield
        finally:
            facts["warnings"] = [
                str(item.message) for item in records if item.category in _REPORTED_WARNINGS
            ]


def _describe(model: ModalModel) -> Facts:
    errors = np.empty(0) if model.errors is None else model.errors[np.isfinite(model.errors)]
    return {
        "modes": len(model.frequencies),
        "lowest": min(model.frequencies.tolist(), default=None),
        "error": max(errors.tolist(), default=None),
        "message": "; ".join(model.provenance.dropped),
    }


def _write(job: BodyJob, folder: Path, facts: Facts, model: ModalModel) -> Facts:
    """Write sounds and the model, and facts last: each file is the old or the new one."""
    # Strikes that cannot be made leave what an earlier run has made.
    chosen = [] if job.strikes is None else job.strikes.labels(model, job.output)
    stem = Path(job.output).name
    old_names = [name for name in reopen(job, folder) if Path(name).name.startswith(stem)]
    labels = chosen
    if job.strikes is not None:
        labels = job.strikes.written(model, chosen, job.output, folder)
    data = model_file.to_bytes(model)
    write_bytes(job.path(folder), data)
    sounds = dict.fromkeys(label["sound"] for label in labels)
    remaining_names = [
        name for name in old_names if job.strikes is None and not name.endswith(MODEL)
    ]
    if old_sounds := [name for name in remaining_names if (folder / name).is_file()]:
        files = counted(len(old_sounds), "file")
        warning = f"{files} of sounds of an earlier run: strikes= makes them again"
        facts["warnings"] = [*facts.get("warnings", []), warning]
        sounds |= dict.fromkeys(old_sounds)
    sizes = {name: (folder / name).stat().st_size for name in sounds}
    facts |= {"files": {**sizes, f"{job.output}{MODEL}": len(data)}, "labels": labels, **_cost()}
    for name in {*old_names} - {*facts["files"]}:  # made with other options
        remove(folder / name)
    return _keep(job, folder, facts)


def reopen(job: BodyJob, folder: Path) -> list[str]:
    """Mark a job as unfinished before its files are replaced; return the names of its files."""
    facts = _facts(job, folder)
    names: dict[str, int] = facts.get("files", {})
    if "key" in facts:  # else there are no facts, or they are of a run that was killed
        _keep(job, folder, {"files": names})
    return [*names]


def _keep(job: BodyJob, folder: Path, facts: Facts) -> Facts:
    write_bytes(job.path(folder, FACTS), json.dumps(facts, indent=1).encode())
    return facts


def find_finished(job: BodyJob, folder: Path) -> Facts | None:
    """Return the facts of a job that was finished before, None where it was not."""
    facts = _facts(job, folder)
    try:
        is_complete = all((folder / name).stat().st_size == n for name, n in facts["files"].items())
    except (OSError, KeyError):
        is_complete = "failure" in facts or bool(facts.get("parts"))
    return facts if is_complete and facts.get("key") == job.key else None


def _facts(job: BodyJob, folder: Path) -> Facts:
    """Return the facts of a facts file, none where it is missing or damaged."""
    with contextlib.suppress(StruckError, ValueError, RecursionError):
        facts = json.loads(read_bytes(job.path(folder, FACTS)))
        if _are_facts(facts):
            return facts
    return {}


def _are_facts(value: Any) -> bool:  # noqa: ANN401 - of JSON
    """Return whether a value of JSON has the form of facts, and names files in the folder alone."""
    if not isinstance(value, dict):
        return False
    if not all(isinstance(value[name], kind) for name, kind in _TYPES.items() if name in value):
        return False
    texts = [*value.get("warnings", ()), *value.get("parts", ())]
    labels = value.get("labels", ())
    return (
        all(isinstance(text, str) for text in texts)
        and all(isinstance(label, dict) and "sound" in label for label in labels)
        and all(isinstance(v, str | int | float) for label in labels for v in label.values())
        and all(map(_is_within, value.get("files", {})))
    )


def _is_within(name: str) -> bool:
    """Return whether a name in a facts file leads to no place outside the folder of the batch."""
    # Files of an earlier run, which the facts name, are removed.
    path = PurePath(name)
    return not path.is_absolute() and ".." not in path.parts and "\0" not in name


def _cost() -> dict[str, float]:
    """Return the processor time, s, and the peak of memory, bytes, of this process so far."""
    guard.close()  # whose time counts once it has ended
    try:
        import resource
    except ImportError:
        return {"cpu": time.process_time(), "memory": 0.0}
    usages = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    unit = 1 if sys.platform == "darwin" else 1024
    return {
        "cpu": sum(item.ru_utime + item.ru_stime for item in usages),
        "memory": float(unit * max(item.ru_maxrss for item in usages)),
    }


def _may_pass(error: BaseException | None) -> bool:
    """Return whether an error, or its cause, may not occur again at a second try."""
    while error is not None and not isinstance(error, OSError | MemoryError):
        error = error.__cause__ or error.__context__
    return error is not None
