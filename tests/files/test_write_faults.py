"""Whatever call fails while files are written, each is the old or the new one."""

from __future__ import annotations

import ast
import importlib
import inspect
import os
import re
import shutil
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from functools import cache
from pathlib import Path
from unittest.mock import patch

import pytest

import struck
from struck.errors import StruckError
from tests.files.failing_disk import ENDED, ENDS, OF_WRITES, FailingDisk, Fault, Step
from tests.files.writers import SETTINGS, WRITERS, Writer
from tests.samples import sampled

SAMPLE = ("log.csv", "cache", "redirect", "cluster")
SOURCES = Path(struck.__file__).parent
WRITING = re.compile(r"save|write|to_|export")
CHANGING = (
    *("write_text", "write_bytes", "savefig", "save_npz", "savez", "savez_compressed", "savetxt"),
    *("tofile", "to_file", "to_csv", "export", "dump", "mkdir", "makedirs", "unlink", "rmdir"),
    *("rmtree", "copyfile", "copy2", "copytree", "truncate", "symlink_to"),
)
OPENING = ("open", "fdopen", "File", "SoundFile", "ZipFile")
# Functions that write elsewhere than by `write_bytes`, and why.
ELSEWHERE = {
    "struck.batch.batch_report:label_table": "into memory",
    "struck.batch.job_process:_confine": "a setting of the system",
    "struck.batch.job_process:main": "a pipe",
    "struck.batch.strike_set:StrikeSet.written": "into memory",
    "struck.cli.__init__:main": "the null device",
    "struck.core.build:build": "before the package is installed",
    "struck.explorer.jobs:main": "a pipe",
    "struck.explorer.private_folder:_lock_folder": "an empty file, which a lock holds",
    "struck.explorer.private_folder:_remove_dead": "a temporary folder",
    "struck.files.cache:Cache.discard": "removes a damaged entry",
    "struck.files.cache:Cache.put": "makes a private folder",
    "struck.files.cache:_removed": "removes an old entry",
    "struck.files.mesh_formats:write_shapes": "a temporary folder",
    "struck.files.sofa:write_container": "into memory",
    "struck.files.sound_formats:encoded.<locals>.encode": "into memory",
    "struck.files.worker:main": "a pipe",
    "struck.live.commands:Host.fill": "a ring in memory",
    "struck.model.html:picture": "into memory",
    "struck.report.charts:save": "into memory",
    "struck.scene.log_files:save_contacts": "into memory",
}
Contents = dict[str, bytes]


@pytest.fixture(autouse=True)
def settings() -> Iterator[None]:
    """Let results of two runs be the same, and without computing them anew."""
    with ExitStack() as stack, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for place, name, value in SETTINGS:
            stack.enter_context(patch.object(place, name, value))
        yield


def contents(folder: Path) -> Contents:
    paths = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


def calls_of(path: Path) -> Iterator[tuple[str, ast.Call]]:
    """Yield the calls of a module of struck, each with the function in which it stands."""
    module = ".".join(("struck", *path.relative_to(SOURCES).with_suffix("").parts))

    def walk(node: ast.AST, place: str) -> Iterator[tuple[str, ast.Call]]:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.Call):
                yield f"{module}:{place}", child
            inner = place
            if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
                local = ".<locals>" if isinstance(node, ast.FunctionDef) else ""
                inner = f"{place}{local}.{child.name}".removeprefix(".")
            yield from walk(child, inner)

    yield from walk(ast.parse(path.read_text(encoding="utf-8")), "")


@cache
def all_calls() -> list[tuple[str, ast.Call]]:
    return [item for path in SOURCES.rglob("*.py") for item in calls_of(path)]


def writes(call: ast.Call) -> bool:
    """Return whether a call may change files, but for those of `struck.files.atomic`."""
    arguments, is_method = call.args, isinstance(call.func, ast.Attribute)
    name = getattr(call.func, "attr", getattr(call.func, "id", ""))
    named = [keyword.value for keyword in call.keywords if keyword.arg == "mode"]
    is_opening = name in OPENING and any(
        _is_mode(item) and {*ast.literal_eval(item)} & {*"wax+"} for item in [*arguments, *named]
    )
    return (
        is_opening
        or (is_method and name in CHANGING)
        or (is_method and name in {"replace", "rename"} and len(arguments) == 1)  # else of a text
        or (is_method and name in {"write", "write_table"} and len(arguments) > 1)  # no stream
    )


def _is_mode(node: ast.expr) -> bool:
    value = node.value if isinstance(node, ast.Constant) else None
    return isinstance(value, str) and {*value} <= {*"rwaxbt+"}


def public_writers() -> Iterator[str]:
    """Yield the public functions and methods that are named as writers and take a path."""
    stubs = [path.parent for path in SOURCES.rglob("__init__.pyi")]
    packages = [".".join(("struck", *path.relative_to(SOURCES).parts)) for path in stubs]
    for package in map(importlib.import_module, packages):
        for thing in (getattr(package, name) for name in dir(package) if name[0] != "_"):
            members = [member for _, member in inspect.getmembers(thing, inspect.isfunction)]
            for function in members if inspect.isclass(thing) else [thing]:
                plain = inspect.unwrap(function) if callable(function) else None
                if inspect.isfunction(plain) and WRITING.match(plain.__name__):
                    kinds = map(str, inspect.get_annotations(plain).values())
                    if any("Path" in kind for kind in kinds):
                        yield f"{plain.__module__}:{plain.__qualname__}"


class Rehearsal:
    """Old and new files of a writer, and the calls that make the new ones of the old."""

    def __init__(self, writer: Writer, scratch: Path) -> None:
        self.writer, self.old_folder, self.folder = writer, scratch / "old", scratch / "files"
        self.old_folder.mkdir()
        writer.write(self.old_folder, 0)
        self.old = contents(self.old_folder)
        self.restore()
        self.disk = FailingDisk(self.folder)
        with self.disk:
            writer.write(self.folder, 1)
        self.new = contents(self.folder)

    def restore(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)
        shutil.copytree(self.old_folder, self.folder)

    def write(self, fault: Fault, at: int) -> None:
        """Write the new files while a call fails: it raises StruckError, or all are there."""
        disk = FailingDisk(self.folder, fault, at)
        message = None
        try:
            with disk:
                self.writer.write(self.folder, 1)
        except StruckError as error:
            message = str(error)
        if message is None:
            assert self.is_new() or self.writer.quiet
        else:
            assert fault is not Fault.FEWER, message
            assert "\n" not in message

    def is_new(self) -> bool:
        return self._known(contents(self.folder)) == self._known(self.new)

    def require_whole_files(self) -> None:
        """Require the old file, or one that the dry run gave that name."""
        content = self.writer.content
        for name, data in contents(self.folder).items():
            if name.endswith(".part"):
                continue
            if name in self.writer.reports:  # which say what failed
                assert self.writer.reports[name](data), name
                continue
            versions = self.disk.versions.get(name, [])
            if name in self.old:
                versions = [self.old[name], *versions]
            assert content(data) in [content(version) for version in versions], name
        missing = {*self.old} & {*self.new} - {*contents(self.folder)}
        assert not missing

    def _known(self, files: Contents) -> dict[str, object]:
        reports = self.writer.reports  # which count what an earlier run has left to do
        return {n: n in reports or self.writer.content(data) for n, data in files.items()}


def cases(steps: list[Step]) -> Iterator[tuple[Fault, int]]:
    """Yield each fault at each call where it can be."""
    for number, step in enumerate(steps):
        for fault in Fault:
            if step.operation == "write" or fault not in OF_WRITES:
                yield fault, number


def in_a_fork(work: Callable[[], object]) -> int:
    """Do work in a fork of this process, and return the status with which that ends."""
    child = os.fork()
    if not child:
        status = 1
        with suppress(BaseException):
            work()
            status = 0
        os._exit(status)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


@pytest.fixture(scope="module")
def rehearsal_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Rehearsal]:
    return cache(lambda name: Rehearsal(WRITERS[name], tmp_path_factory.mktemp("writer")))


@pytest.mark.parametrize("name", WRITERS)
def test_the_disk_sees_all_that_a_writer_writes(
    name: str, rehearsal_of: Callable[[str], Rehearsal]
) -> None:
    rehearsal = rehearsal_of(name)
    changed = {file for file, data in rehearsal.new.items() if rehearsal.old.get(file) != data}
    assert changed
    assert changed <= {*rehearsal.disk.versions}
    steps: dict[str, list[Step]] = {}
    for step in rehearsal.disk.steps:
        steps.setdefault(step.name, []).append(step)
    parts = {part: made for part, made in steps.items() if part.endswith(".part")}
    for made in parts.values():
        operations = [step.operation for step in made]
        assert operations[0] == "open"
        assert operations[-3:] == ["fsync", "replace", "unlink"]
        assert "write" in operations
    sizes = sorted(sum(step.size for step in made) for made in parts.values())
    versions = rehearsal.disk.versions.values()
    assert sizes == sorted(len(data) for given in versions for data in given)


def test_every_writer_is_in_the_table(rehearsal_of: Callable[[str], Rehearsal]) -> None:
    seen = set().union(*(rehearsal_of(name).disk.callers for name in WRITERS))
    places = {
        place
        for place, call in all_calls()
        if isinstance(call.func, ast.Name) and call.func.id == "write_bytes"
    }
    assert len(places) > 20
    assert not places - seen
    public = {*public_writers()}
    assert len(public) > 5
    assert not public - seen


def test_files_are_written_through_one_function() -> None:
    """Lists stay true: what is no longer written has no entry."""
    places = {
        place
        for place, call in all_calls()
        if writes(call) and not place.startswith("struck.files.atomic:")
    }
    assert places == {*ELSEWHERE}


@pytest.mark.parametrize("name", sampled(WRITERS, *SAMPLE))
def test_files_are_old_or_new_whatever_fails(
    name: str, rehearsal_of: Callable[[str], Rehearsal]
) -> None:
    rehearsal = rehearsal_of(name)
    for fault, number in cases(rehearsal.disk.steps):
        rehearsal.restore()
        if fault not in ENDS:
            rehearsal.write(fault, number)
        elif hasattr(os, "fork"):
            status = in_a_fork(lambda: rehearsal.write(fault, number))  # noqa: B023 - waited for
            assert status == ENDED, (fault, number, rehearsal.disk.steps[number])
        rehearsal.require_whole_files()
        rehearsal.writer.write(rehearsal.folder, 1)
        left = [name for name in contents(rehearsal.folder) if name.endswith(".part")]
        assert not left, (fault, number, rehearsal.disk.steps[number])
        assert rehearsal.is_new(), (fault, number, rehearsal.disk.steps[number])
