"""Run fuzz targets in child processes, and report what is neither a result nor one StruckError.

`python -m tests.fuzz.run --count 50000` runs as many inputs, spread over all targets, in two
processes, and prints for each target inputs, answers, processor time and peak memory. An input that
fails is saved in `--save`, by default `corpus/failures`, whose `failures.toml` needs a line on it.
`--only NAME --number N` runs a single one.
"""

from __future__ import annotations

import argparse
import json
import os
import select
import shutil
import signal
import sys
import time
import traceback
import warnings
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, NoReturn

# Before NumPy is imported: children are made by forks, which must not find threads.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[variable] = "1"
os.environ["STRUCK_CACHE"] = "off"

from struck import errors  # noqa: E402
from struck.files import guard  # noqa: E402
from tests.fuzz.targets import SEEDS, TARGETS, Target, share  # noqa: E402

SECONDS = 10.0  # of processor time for one input, in the program and in the process that reads
# Starting that process again is no part of reading.
_START = 1.0
MEMORY = 2 * 2**30  # bytes that one input may take, in each of the two
_WALL = 180.0  # s, after which a child that says nothing is ended: the guard's limit is 120 s
_AT_ONCE = 8  # inputs between two decisions which child takes the next ones
FAILURES = SEEDS.with_name("failures")
# Warnings that struck issues on purpose.
_OWN_WARNINGS = (errors.CacheWarning, errors.LossWarning, errors.RepairWarning, errors.ScaleWarning)


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """One input: a mutant by its number, or a file as it is."""

    target: str
    number: int
    file: str = ""  # path; "": the mutant

    def content(self) -> bytes:
        """Return the bytes that are read."""
        if self.file:
            return Path(self.file).read_bytes()
        return TARGETS[self.target].content(self.number)


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What became of one input."""

    target: str
    number: int
    file: str
    answer: str  # "read", "refused", or what is wrong
    seconds: float = 0.0  # of processor time, in both processes
    memory: int = 0  # bytes by which the program grew at most
    reader_memory: int = 0  # bytes that the process that reads has held at most

    @property
    def has_failed(self) -> bool:
        """Whether it is neither a result nor one StruckError within the bounds."""
        return self.answer not in {"read", "refused"}


@dataclass(kw_only=True)
class Summary:
    """What became of the inputs of one target."""

    answers: Counter[str] = field(default_factory=Counter)
    seconds: float = 0.0
    longest: float = 0.0  # s
    memory: int = 0  # bytes
    reader_memory: int = 0  # bytes

    def add(self, outcome: Outcome) -> None:
        """Count one input."""
        self.answers["failed" if outcome.has_failed else outcome.answer] += 1
        self.seconds += outcome.seconds
        self.longest = max(self.longest, outcome.seconds)
        self.memory = max(self.memory, outcome.memory)
        self.reader_memory = max(self.reader_memory, outcome.reader_memory)


# In a child.


def answer_of(target: Target, path: Path) -> str:
    """Return "read", "refused" or, of any other answer of a reader, what is wrong with it."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for category in _OWN_WARNINGS:
            warnings.simplefilter("ignore", category)
        try:
            target.read(path)
        except errors.StruckError as error:
            message = str(error)
            if not message.isprintable():
                return f"message with control characters: {message[:300]!r}"
            return "refused" if message else "an error without a message"
        except Exception as error:  # noqa: BLE001 - any other is what is looked for
            place = traceback.extract_tb(error.__traceback__)[-1]
            name = f"{type(error).__name__}: {str(error)[:200]!r}"
            return f"{name} at {Path(place.filename).name}:{place.lineno}"
    return "read"


def _status(process: int | str, name: str) -> int:
    """Return a number of bytes in the system's status of a process; 0 where it has none."""
    with suppress(OSError):
        for line in Path(f"/proc/{process}/status").read_text(encoding="ascii").splitlines():
            if line.startswith(name):
                return 1024 * int(line.split()[1])
    return 0


def _reader_seconds() -> float:
    """Return the processor time of all processes that have read files, s."""
    ended = os.times()
    seconds = ended.children_user + ended.children_system
    with suppress(OSError):
        text = Path(f"/proc/{guard._GUARD.process_id}/stat").read_text(encoding="ascii")
        user, system = text.rpartition(")")[2].split()[11:13]
        seconds += (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")
    return seconds


def _forget_peak() -> None:
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


def examine(task: Task, path: Path) -> Outcome:
    """Read one file, within the bounds."""
    target = TARGETS[task.target]
    _forget_peak()
    before = _status("self", "VmRSS")
    seconds, answer = 0.0, ""
    for _ in range(2):  # other programs may have slowed it down: then once more
        start = time.process_time() + _reader_seconds()
        answer = answer_of(target, path)
        seconds = time.process_time() + _reader_seconds() - start
        if seconds <= SECONDS + _START:
            break
    else:
        answer = f"{seconds:.1f} s of processor time, at most {SECONDS} s are for it ({answer})"
    return Outcome(
        **asdict(task),
        answer=answer,
        seconds=seconds,
        memory=max(0, _status("self", "VmHWM") - before),
        reader_memory=_status(guard._GUARD.process_id or "none", "VmHWM"),
    )


def _confine() -> None:
    """Let this process take little more memory than it has, and leave no image of a crash."""
    with suppress(ImportError, OSError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        hard_limit = resource.getrlimit(resource.RLIMIT_AS)[1]
        if size := _status("self", "VmSize"):
            resource.setrlimit(resource.RLIMIT_AS, (size + MEMORY, hard_limit))


def _work(tasks: IO[str], answers: IO[str]) -> None:
    """Examine the inputs that lines of `tasks` name, and answer each with a line."""
    _confine()
    with TemporaryDirectory(prefix="struck-fuzz-") as folder:
        for count, line in enumerate(tasks):
            task = Task(**json.loads(line))
            target, place = TARGETS[task.target], Path(folder) / str(count)
            place.mkdir()
            path = target.path(place)
            path.write_bytes(task.content())
            # Ended by the system itself: compiled code would not let Python end it.
            signal.setitimer(signal.ITIMER_PROF, 2 * (SECONDS + _START))
            outcome = examine(task, path)
            signal.setitimer(signal.ITIMER_PROF, 0)
            answers.write(f"{json.dumps(asdict(outcome))}\n")
            answers.flush()
            shutil.rmtree(place)
    guard.close()


# In the parent.


class _Child:
    """A fork that examines inputs, and those that it has not answered yet."""

    def __init__(self, siblings: Iterable[_Child]) -> None:
        (their_tasks, our_tasks), (self.answers, their_answers) = os.pipe(), os.pipe()
        self.process = os.fork()
        if not self.process:
            # A sibling ends when nobody can write to it any more.
            for descriptor in (our_tasks, *(sibling.tasks.fileno() for sibling in siblings)):
                os.close(descriptor)
            self._answer(their_tasks, their_answers)
        os.close(their_tasks)
        os.close(their_answers)
        self.tasks = os.fdopen(our_tasks, "w")
        self.pending: deque[Task] = deque()
        self.last_word = time.monotonic()
        self._text = b""

    @staticmethod
    def _answer(tasks: int, answers: int) -> NoReturn:
        code = 1
        try:
            signal.signal(signal.SIGPROF, signal.SIG_DFL)
            _work(os.fdopen(tasks), os.fdopen(answers, "w"))
            code = 0
        except BaseException:  # noqa: BLE001 - a fork must end here on any error
            traceback.print_exc()
        finally:
            os._exit(code)

    def give(self, tasks: Sequence[Task]) -> None:
        """Send inputs."""
        self.pending += tasks
        with suppress(BrokenPipeError):
            self.tasks.write("".join(f"{json.dumps(asdict(task))}\n" for task in tasks))
            self.tasks.flush()

    def outcomes(self) -> Iterator[Outcome]:
        """Yield the outcomes that have arrived; EOFError once the process has ended."""
        data = os.read(self.answers, 2**16)
        if not data:
            raise EOFError
        self.last_word = time.monotonic()
        *lines, self._text = (self._text + data).split(b"\n")
        for line in lines:
            self.pending.popleft()
            yield Outcome(**json.loads(line))

    def end(self) -> int:
        """Wait for the end, and return how the process has ended."""
        with suppress(BrokenPipeError):
            self.tasks.close()
        os.close(self.answers)
        return os.waitstatus_to_exitcode(os.waitpid(self.process, 0)[1])

    def failure(self) -> Outcome:
        """Return what is wrong with the input amid which the process has ended or says nothing."""
        is_silent = time.monotonic() - self.last_word >= _WALL
        if is_silent:
            os.kill(self.process, signal.SIGKILL)
        code, task = self.end(), self.pending.popleft()
        answer = f"a crash (exit code {code})"
        if is_silent:
            answer = f"no answer within {_WALL} s"
        elif code == -signal.SIGPROF:
            answer = f"more than {2 * (SECONDS + _START)} s of processor time"
        return Outcome(**asdict(task), answer=answer)


def run(tasks: Sequence[Task], children: int = 2) -> Iterator[Outcome]:
    """Yield what becomes of inputs, each read in a child process."""
    waiting, crew = deque(tasks), list[_Child]()
    while waiting or crew:
        while waiting and len(crew) < children:
            crew.append(_Child(crew))
        for child in crew:
            if waiting and not child.pending:
                child.give([waiting.popleft() for _ in range(min(_AT_ONCE, len(waiting)))])
        for child in [child for child in crew if not child.pending]:
            crew.remove(child)
            child.end()
        ready, _, _ = select.select([child.answers for child in crew], [], [], 1.0)
        for child in list(crew):
            try:
                if child.answers in ready:
                    yield from child.outcomes()
                elif time.monotonic() - child.last_word >= _WALL:
                    raise EOFError  # noqa: TRY301 - as if it had ended
            except EOFError:
                crew.remove(child)
                yield child.failure()
                waiting.extendleft(reversed(child.pending))


def corpus() -> list[Task]:
    """Return all seeds, and all files that have failed once, as they are."""
    seeds = [(name, SEEDS / seed) for name, target in TARGETS.items() for seed in target.seeds]
    failures = [(path.parent.name, path) for path in sorted(FAILURES.glob("*/*"))]
    return [Task(target=name, number=-1, file=str(path)) for name, path in [*seeds, *failures]]


def inputs(count: int) -> list[Task]:
    """Return `count` inputs, spread over all targets, those that take long first."""
    shares = share(count)
    names = sorted(shares, key=lambda name: not TARGETS[name].few)
    return [Task(target=name, number=number) for name in names for number in range(shares[name])]


def saved(outcome: Outcome, folder: Path) -> Path:
    """Save the input of a failure, and return its path."""
    target = TARGETS[outcome.target]
    ending = "".join(Path(target.file).suffixes)
    path = folder / outcome.target / f"{outcome.number}{ending}"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(target.content(outcome.number))
    return path


def table(summaries: dict[str, Summary]) -> str:
    """Return the summaries as a table."""
    columns = "target             inputs   read refused failed   CPU s longest     MB reader MB"
    lines = [columns]
    for name, each in sorted(summaries.items(), key=lambda item: -item[1].seconds):
        counts = each.answers
        lines.append(
            f"{name:18} {counts.total():6} {counts['read']:6} {counts['refused']:7} "
            f"{counts['failed']:6} {each.seconds:7.2f} {each.longest:7.2f} "
            f"{each.memory / 1e6:6.0f} {each.reader_memory / 1e6:9.0f}"
        )
    return "\n".join(lines)


def main() -> int:
    """Run the inputs that options select, and print the failures and a table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--count", type=int, default=1000, help="mutants (default: 1000)")
    parser.add_argument("--only", default="", help="part of the names of targets")
    parser.add_argument("--number", type=int, help="a single input of them")
    parser.add_argument("--children", type=int, default=2, help="processes (default: 2)")
    parser.add_argument("--save", type=Path, default=FAILURES, help="folder for failures")
    parser.add_argument("--json", action="store_true", help="print a line of JSON for each input")
    options = parser.parse_args()
    tasks = [*corpus(), *inputs(options.count)]
    tasks = [task for task in tasks if options.only in task.target]
    if options.number is not None:
        names = dict.fromkeys(task.target for task in tasks)
        tasks = [Task(target=name, number=options.number) for name in names]
    summaries: dict[str, Summary] = {}
    failures = 0
    for outcome in run(tasks, options.children):
        summaries.setdefault(outcome.target, Summary()).add(outcome)
        if options.json:
            print(json.dumps(asdict(outcome)), flush=True)  # noqa: T201
        if outcome.has_failed:
            failures += 1
            path = outcome.file or saved(outcome, options.save)
            sys.stderr.write(f"{outcome.target}, {path}: {outcome.answer}\n")
    if not options.json:
        print(table(summaries))  # noqa: T201
    return bool(failures)


if __name__ == "__main__":
    sys.exit(main())
