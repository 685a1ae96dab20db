"""Arguments that nobody should give, to all public names: what comes is an answer or our error."""

from __future__ import annotations

import contextlib
import os
import re
import resource
import signal
import time
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import hypothesis
import numpy as np
import pytest
from hypothesis import strategies

import struck
from struck.cli import main
from struck.errors import StruckError
from tests import foreign_numbers
from tests.foreign_numbers import bits, python_number, python_numbers
from tests.hostile_calls import Call, calls, fall

NUMBERS = (0, -1, 1, 3, 0.5, 1e-300, 1e300, -1e300, 1e9, 2**63, 10**400)
NUMBERS += (float("nan"), float("inf"), -float("inf"))
TEXTS = ("", "x", "nan", "1e400", "../x", "a$\\frac{$b", "steel\0", "/dev/zero", "x" * 5000)
ARRAYS = ([], (), [1.0], [0, 0, 0], [np.nan] * 3, [1e300] * 3, [[1, 2], [3]], ["a", "b"], [None])
ARRAYS += (
    np.empty((0, 3)),
    np.full((2, 3), np.inf),
    np.ones((2, 2, 2)),
    np.array(3.0),
    [[1e9] * 3],
)
OTHERS = (
    None,
    True,
    1j,
    b"x",
    {},
    object(),
    {"a": 1},
    print,
    slice(2),
    np.array(["a"]),
    Path("no"),
)
VALUES = (*NUMBERS, *TEXTS, *ARRAYS, *OTHERS)

REFUSED, ACCEPTED = 2.0, 20.0  # seconds of a processor
MEGABYTES, MOST_MEGABYTES = 200, 1500


class TooLong(BaseException):
    """More time than a call may take."""


@contextmanager
def bounded(megabytes: int) -> Iterator[None]:
    """Let a call take so much memory beyond what is in use, and `ACCEPTED` seconds."""

    def stop(*_: object) -> None:
        raise TooLong

    pages = int(Path("/proc/self/statm").read_text("ascii").split()[0])
    before = resource.getrlimit(resource.RLIMIT_AS)
    handler = signal.signal(signal.SIGVTALRM, stop)
    resource.setrlimit(
        resource.RLIMIT_AS, (pages * resource.getpagesize() + megabytes * 2**20, before[1])
    )
    signal.setitimer(signal.ITIMER_VIRTUAL, ACCEPTED)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        resource.setrlimit(resource.RLIMIT_AS, before)
        signal.signal(signal.SIGVTALRM, handler)


def kind(value: object) -> str:
    """Return what sort of thing a value is: another sort is a wrong type."""
    if isinstance(value, bool | np.bool_) or value is None:
        return str(value)
    if isinstance(value, int | float):
        return "number"
    if isinstance(value, str):
        return "text"
    if isinstance(value, np.ndarray) and (value.dtype.kind not in "fiuc" or not value.ndim):
        return "no array of numbers"
    if isinstance(value, list | tuple | np.ndarray):
        return "array"
    return type(value).__name__


def attempt(call: Call, changed: Mapping[str, object]) -> str:
    """Return what is wrong with what comes of changed arguments; nothing where it is right."""
    wrong_type = any(kind(value) != kind(call.given[name]) for name, value in changed.items())
    allowed = (StruckError, TypeError) if wrong_type else StruckError
    for megabytes in (MEGABYTES, MOST_MEGABYTES):
        begun = time.process_time()
        try:
            with contextlib.chdir(folder()), bounded(megabytes), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                made = call.made(**{**call.given, **changed})
                if call.use is not None:
                    call.use(made)
        except allowed as error:
            taken = time.process_time() - begun
            if taken > REFUSED:
                return f"{taken:.1f} s until it was refused"
            return "" if str(error) else f"{type(error).__name__} without a word"
        except TooLong:
            return "" if call.long else f"more than {ACCEPTED} s"
        except MemoryError:
            continue
        except Exception as error:  # noqa: BLE001 - what is looked for
            return f"{type(error).__name__}: {error}"
        return ""
    return f"more than {MOST_MEGABYTES} MB"


@cache
def folder() -> Path:
    """Return where calls write, whatever names they are given."""
    return Path(mkdtemp(prefix="struck-hostile-"))


@cache
def table() -> dict[str, Call]:
    return calls(folder())


def draw(data: strategies.DataObject, *, dear: bool) -> None:
    """Change one or two arguments of one call."""
    names = [name for name, call in table().items() if dear or not call.dear]
    name = data.draw(strategies.sampled_from(names))
    call = table()[name]
    options = sorted(call.given)
    chosen = data.draw(
        strategies.lists(strategies.sampled_from(options), min_size=1, max_size=2, unique=True)
    )
    changed = {
        option: VALUES[data.draw(strategies.integers(0, len(VALUES) - 1))] for option in chosen
    }
    assert not attempt(call, changed), (name, changed)


@hypothesis.settings(max_examples=50, suppress_health_check=list(hypothesis.HealthCheck))
@hypothesis.given(strategies.data())
def test_what_nobody_should_give_is_refused_in_words(data: strategies.DataObject) -> None:
    draw(data, dear=False)


@pytest.mark.prove
@hypothesis.settings(max_examples=5000, suppress_health_check=list(hypothesis.HealthCheck))
@hypothesis.given(strategies.data())
def test_five_thousand_times_nobody_should(data: strategies.DataObject) -> None:
    draw(data, dear=True)


@pytest.mark.prove
@pytest.mark.filterwarnings("ignore::struck.errors.LossWarning")
def test_the_right_arguments_are_taken() -> None:
    for call in table().values():
        if call.dear or "/no." in str(call.given):
            continue
        made = call.made(**call.given)
        if call.use is not None:
            call.use(made)


# Numbers and arrays of other types than Python's own, the values that each argument takes.

# Calls whose results depend on calls before, one that times itself, and one of some seconds.
WITH_MEMORY = {"synth.Resonators.process", "synth.Resonators.change", "excitation.Push"}
WITH_MEMORY |= {"analyze a solid", "sound_map"}
OF_NOTES = {"band", "frequencies", "lowest"}  # arguments that are of numbers or of texts, as "A4"
SAMPLE = (  # calls of whose types some are tried in each run
    *("shapes.Bar", "shapes.RoundSection", "shapes.CircularPlate", "shapes.GivenSection"),
    *("solids.Block", "solids.Extrusion", "solids.Revolution", "solids.VolumeMesh"),
    *("model.Material", "model.Measured", "model.Mesh", "model.Survey.full", "model.Chart"),
    *("excitation.Strike", "excitation.Scrape", "excitation.ForceTrack", "excitation.TouchLog"),
    *("excitation.Roughness", "excitation.Profile", "ears.Mono", "ears.Stereo", "ears.Room"),
    *("scene.Contacts", "scene.Poses", "scene.Body", "scene.Simulation", "files.Sound"),
    *("perception.SoundMap.at", "recordings.Take", "render", "analyze"),
)


@cache
def all_calls() -> dict[str, Call]:
    """Return the calls of the table, and one that simulates."""
    given = {"seconds": 0.02, "step": 1e-3, "restitution": 0.5, "friction": 0.3}
    return table() | {"scene.Simulation": Call(made=fall, given=given)}


@cache
def typed_arguments(name: str) -> dict[tuple[str, str], tuple[object, bool]]:
    """Return values by argument of a call and name of a type, and whether each is of numbers."""
    values: dict[tuple[str, str], tuple[object, bool]] = {}
    for argument, value in all_calls()[name].given.items():
        if isinstance(value, int | float) and not isinstance(value, bool):
            base, of_numbers, others = value, foreign_numbers.SCALARS, foreign_numbers.NO_SCALARS
        elif isinstance(value, list | tuple | np.ndarray):
            base, others = np.asarray(value), foreign_numbers.NO_ARRAYS
            tables = {"c": foreign_numbers.ARRAYS_OF_COMPLEX}
            tables |= dict.fromkeys("if", foreign_numbers.ARRAYS)
            if base.dtype.kind not in tables:
                continue
            of_numbers = tables[base.dtype.kind]
        else:
            continue
        with np.errstate(over="ignore"):  # of numbers beyond 65,504 in half precision
            values |= {(argument, kind): (make(base), True) for kind, make in of_numbers.items()}
            values |= {
                (argument, kind): (make(base), False)
                for kind, make in others.items()
                if not (kind.startswith("text") and argument in OF_NOTES)
            }
    return values


def result(call: Call, changed: Mapping[str, object]) -> tuple[str, Any]:
    """Return the error, or nothing and what comes of changed arguments."""
    with contextlib.chdir(folder()), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            made = call.made(**{**call.given, **changed})
            used = call.use(made) if call.use is not None else None
        except StruckError as error:
            return type(error).__name__, str(error)
    return "", bits(made if used is None else used)


def wrong_of_type(name: str, argument: str, kind: str) -> str:
    """Return what is wrong with a call by a value of a type; nothing where it is right."""
    call, (value, is_of_numbers) = all_calls()[name], typed_arguments(name)[argument, kind]
    try:
        error, found = result(call, {argument: value})
    except Exception as raw:  # noqa: BLE001 - what is looked for
        return f"{name}({argument}={kind}): {type(raw).__name__} {raw}"
    if not is_of_numbers:
        return "" if error else f"{name}({argument}={kind}) was taken"
    if isinstance(call.given[argument], int | float):
        plain = python_number(value, whole=isinstance(call.given[argument], int))
    else:
        plain = python_numbers(value)
    plain_error, expected = result(call, {argument: plain})
    if error == plain_error and (error or found == expected):
        return ""
    return f"{name}({argument}={kind}): {error} {found!s:.200}, of {plain!r:.80}: {plain_error}"


def calls_by_type(names: Iterable[str], count: int) -> list[tuple[str, str, str]]:
    """Return a draw of calls, each with an argument and the name of a type."""
    every = [(name, *case) for name in names for case in typed_arguments(name)]
    chance = np.random.default_rng(59)
    return [every[number] for number in chance.permutation(len(every))[:count]]


def test_results_do_not_depend_on_the_types_of_numbers() -> None:
    wrong = [wrong_of_type(*case) for case in calls_by_type(SAMPLE, 200)]
    assert not [*filter(None, wrong)]


@pytest.mark.prove
def test_two_thousand_results_do_not_depend_on_the_types_of_numbers() -> None:
    names = [n for n, call in all_calls().items() if not call.dear and n not in WITH_MEMORY]
    cases = calls_by_type(names, 2000)
    assert len(cases) == 2000
    assert not [*filter(None, map(wrong_of_type, *zip(*cases, strict=True)))]


# The shell: each command with words that are right, of which one is exchanged.
TUBE = "tube:length=0.2,radius=0.01,wall=0.001"
BAR = "bar:length=0.3,width=0.03,thickness=0.005"
LINES = [
    f"analyze {BAR} --material steel --band 20,5000 -o a.struck",
    f"analyze {TUBE} --material oak --accuracy preview --no-cache -o b.struck",
    "analyze box.stl --material glass --units m --accuracy preview --band 20,4000 -o c.struck",
    "info bar.struck --modes 5",
    "render bar.struck --strike 0.02@0 --impulse 0.1 --seconds 0.1 --rate 8000 -o d.wav",
    "render bar.struck --scrape 0.1..0.2 --load 1 --speed 0.1 --seconds 0.1 -o e.wav",
    "render bar.struck --pluck 0.1 --force 1 --listener 0,1,0 --head exact --seconds 0.1 -o f.wav",
    "export bar.struck --contacts 0.02 --listeners 1,0,0 --seconds 0.1 --rate 8000 -o g.sofa",
    "compare bar.struck bar.wav --strike 0.02 --listener 0,1,0",
    "fit bar.wav --modes 4 --force --interpolation field --method shared --no-cache -o h.struck",
    f"tune {TUBE} --material steel --vary length --lowest 700 --accuracy preview",
    "calibrate bar.struck bar.wav --density 7850 --size-error 0.01",
    "sound-map bar.struck --threshold 20 --level 80 --listener 0,1,0",
    "record plan.toml -o takes --simulate nowhere",
    "play bar.struck --seconds 0.1 --rate 8000 --block 64 --device nothing",
    "show bar.struck -o j.png",
]
WORDS = ("-1", "0", "inf", "1e300", "-", "--", "0,0", "1,2,x", "..", "@", "--nonsense", *TEXTS[:-2])


def outcome_of_line(words: list[str]) -> str:
    """Return what is wrong with what a command does; nothing where it is right."""
    begun = time.process_time()
    try:
        with bounded(MOST_MEGABYTES), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            code = main(words)
    except SystemExit as end:
        code = end.code
    except TooLong:
        return f"more than {ACCEPTED} s"
    except BaseException as error:  # noqa: BLE001 - what is looked for
        return f"{type(error).__name__}: {error}"
    if code == 2 and time.process_time() - begun > REFUSED:
        return "a long time until it was refused"
    return "" if code in {0, 2} else f"exit code {code}"


def draw_line(data: strategies.DataObject) -> None:
    words = data.draw(strategies.sampled_from(LINES)).split()
    place = data.draw(strategies.integers(1, len(words) - 1))
    words[place] = data.draw(strategies.sampled_from(WORDS))
    table()  # writes the files that commands read
    with contextlib.chdir(folder()), open_ended():
        assert not outcome_of_line(words), words


@contextmanager
def open_ended() -> Iterator[None]:
    """Let what commands print go nowhere."""
    with (
        Path(os.devnull).open("w") as nowhere,
        contextlib.redirect_stdout(nowhere),
        contextlib.redirect_stderr(nowhere),
    ):
        yield


@hypothesis.settings(max_examples=15, suppress_health_check=list(hypothesis.HealthCheck))
@hypothesis.given(strategies.data())
def test_words_that_nobody_should_type_are_refused(data: strategies.DataObject) -> None:
    draw_line(data)


@pytest.mark.prove
@hypothesis.settings(max_examples=500, suppress_health_check=list(hypothesis.HealthCheck))
@hypothesis.given(strategies.data())
def test_five_hundred_times_nobody_should_type_them(data: strategies.DataObject) -> None:
    draw_line(data)


# Public names that no call of the table makes, by why.
UNCALLED = {
    "to be had by others' things": "Damping Excitation Filters Gains Head Listener Shape",
    "made by struck itself": "Calibration CapturePlan Comparison Device Exponentials PoleFit",
    "made by it as well": "Fitting Manifest MeasuredHead ModalModel Modes Provenance Residual",
    "made by it in between": "MeshPart ShapeGains TimbreTable",
    "without arguments": "AIR Heuristic1998 ObrienCoupling bird materials profiles roughnesses",
    "without arguments either": "strikers wall_materials",
    "of an engine": "MujocoRecorder Simulation scene2002",
    "on a device": "DeviceRecorder Player PortAudio capture microphone",
    "for minutes": "gallery",
    "on a port": "Explorer explore",
    "in other processes": "BatchReport BatchRow analyze_many",
}


def test_every_public_name_is_called() -> None:
    stubs = Path(struck.__file__).parent.glob("*/__init__.pyi")
    listed = re.compile(r"^from \.\S+ import (\w+) as", re.MULTILINE)
    public = {name for stub in stubs for name in listed.findall(stub.read_text("utf-8"))}
    called = {word for key in table() for word in re.split(r"[. ]", key)}
    exempt = {name for names in UNCALLED.values() for name in names.split()}
    assert public - called - exempt == set()
    assert not (exempt & called) - {"MeasuredHead", "ModalModel"}  # methods of theirs are called
