"""Numbers that ask for too much are refused with their bound, before memory is asked for."""

from __future__ import annotations

import re
import resource
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import struck
from struck import Material, Pluck, Rayleigh, Roll, Scrape, Strike
from struck.cli import main
from struck.ears import Reverberation, Room
from struck.errors import MaterialError, OptionError
from struck.shapes import Bar, CircularPlate, GivenSection, RectangularMembrane, String
from struck.solids import Block, Tube
from struck.synth import Resonators

BAR = struck.analyze(Bar(length=0.3, width=0.03, thickness=0.005), "steel")
SOFT = Material(density=7850, youngs_modulus=1.0, poisson_ratio=0.3)
PATH = [(0.1, 0, 0), (0.2, 0, 0)]
MEGABYTES = 200


def bar_of(section: GivenSection) -> object:
    return struck.analyze(Bar(length=0.3, section=section), "steel")


# What is refused, and what its message must hold.
REFUSED: list[tuple[Callable[[], object], str]] = [
    (lambda: struck.render(BAR, Strike(), sample_rate=10**9), "at most 1e6"),
    (lambda: struck.render(BAR, Strike(), sample_rate=10**400), "than 300 digits"),
    (lambda: struck.render(BAR, Strike(), sample_rate=np.nan), "sample_rate is nan"),
    (lambda: struck.render(BAR, Strike(), seconds=3600, sample_rate=10**6), "3.6e9 samples"),
    (lambda: struck.render(BAR, Strike(), seconds=1e9), "at most 3600"),
    (lambda: Room(size=(3, 4, 5), order=60), "order of reflections is 60.* 24"),
    (lambda: Room(size=(3, 4, 5), order=np.nan), "order is nan"),
    (lambda: Room(size=(3, 4, 5), order=10**400), "order is a number of more than 300 digits"),
    (lambda: Resonators([BAR], points=10**9), "points is 1e9.* 65536"),
    (lambda: Resonators([BAR], points=1.5), "points is 1.5"),
    (lambda: Resonators([BAR], voices=10**9), "voices is 1e9.* 65536"),
    (lambda: Resonators([BAR], voices=np.inf), "voices is inf"),
    (lambda: Pluck(force=1.0, rise=1e4), "rise is 10000: it must be at most 60"),
    (lambda: Pluck(force=np.inf), "force is inf"),
    (lambda: Reverberation(seconds=1e300, volume=60), "at most 120"),
    (lambda: Reverberation(seconds={1e300: 1.0}, volume=60), "at most 1e"),
    (lambda: Reverberation(seconds=1.0, volume=60, seed=-1), "seed is -1"),
    (lambda: String(length=0.6, radius=1e9, tension=100), "1e9 m: it must be at most 1e6"),
    (
        lambda: struck.analyze(String(length=1e5, radius=1e3, tension=1e-9), "steel"),
        "the string has about .* at most 100000",
    ),
    (lambda: bar_of(GivenSection(area=1e300, second_moment=1e-9, shear_coefficient=0.8)), "1e24"),
    (lambda: bar_of(GivenSection(area=1e-300, second_moment=1e-9, shear_coefficient=0.8)), "1e-36"),
    (lambda: Bar(length=0.3, width=0.03, thickness=1e-300), "1e-300 m: it must exceed"),
    (lambda: Bar(length=10**400, width=0.03, thickness=0.005), "more than 300 digits"),
    (lambda: CircularPlate(radius=1e300, thickness=1e-3), "at most 1e6"),
    (lambda: Tube(length=1e300, radius=0.1, wall=0.01), "at most 1e6"),
    (lambda: Block(size=(1e-12, 0.1, 0.1)), "1e-12 m: it must exceed 0, and 1e-09"),
    (
        lambda: struck.analyze(
            RectangularMembrane(length=1e5, width=1e5, thickness=1e-4, tension=1.0), "steel"
        ),
        "the membrane has about",
    ),
    (
        lambda: struck.analyze(Bar(length=0.3, width=0.03, thickness=0.005), SOFT),
        "about .* modes of one kind .*200e9",
    ),
    (
        lambda: struck.analyze(Bar(length=0.3, width=0.03, thickness=0.005, ends="hinged"), SOFT),
        "about .* modes of one kind .*200e9",
    ),
    (lambda: struck.sound_map(BAR, level=1e9), "level is 1e9: it must be at most 300"),
    (lambda: struck.sound_map(BAR, level=-1e9), "level is -1"),
    (lambda: BAR.scaled(1e300), "factor is 1e300: it must be at most 1e9"),
    (lambda: BAR.scaled(1e-300), "factor is 1e-300"),
    (lambda: Scrape(path=PATH, speed=0.1, load=1.0, radius=1e300), "radius is 1e300.* 1e6"),
    (lambda: Roll(path=PATH, radius=1e-9, speed=0.1, mass=0.1), "radius is 1e-09.*above 1e-7"),
    (lambda: Scrape(path=PATH, speed=0.1, load=1.0, seed=-1), "seed is -1"),
    (lambda: Material(density=1e300, youngs_modulus=1e9, poisson_ratio=0.3), "at most 1e30"),
    (lambda: Rayleigh(mass=10**400, stiffness=0), "mass is a number of more than 300 digits"),
]  # fmt: skip


@pytest.fixture
def little_memory() -> Iterator[None]:
    """Let nothing take more than 200 MB beyond what is in use."""
    pages = int(Path("/proc/self/statm").read_text("ascii").split()[0])
    before = resource.getrlimit(resource.RLIMIT_AS)
    most = pages * resource.getpagesize() + MEGABYTES * 2**20
    resource.setrlimit(resource.RLIMIT_AS, (most, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)


@pytest.mark.filterwarnings("ignore::struck.errors.ScaleWarning")
@pytest.mark.usefixtures("little_memory")
@pytest.mark.parametrize(("make", "message"), REFUSED, ids=map(str, range(len(REFUSED))))
def test_numbers_beyond_their_bound_are_refused_at_once(
    make: Callable[[], object], message: str
) -> None:
    begun = time.process_time()
    with pytest.raises((OptionError, MaterialError)) as caught:
        make()
    assert time.process_time() - begun < 2
    pattern = ".*".join(
        "|".join(re.escape(choice) for choice in part.split("|")) for part in message.split(".*")
    )
    assert re.search(pattern, str(caught.value))


WRONG: list[Callable[[object], object]] = [
    lambda wrong: Strike(impulse=wrong),
    lambda wrong: Pluck(force=1.0, rise=wrong),
    lambda wrong: Roll(path=PATH, radius=wrong, speed=0.1, mass=0.1),
    lambda wrong: Rayleigh(mass=wrong, stiffness=0),
    lambda wrong: Material(density=wrong, youngs_modulus=1e9, poisson_ratio=0.3),
    lambda wrong: Material(density=1e3, youngs_modulus=1e9, poisson_ratio=wrong),
    lambda wrong: Bar(length=wrong, width=0.1, thickness=0.01),
    lambda wrong: String(length=1.0, radius=1e-3, tension=wrong),
    lambda wrong: GivenSection(area=wrong, second_moment=1e-9, shear_coefficient=0.8),
    BAR.scaled,
    lambda wrong: struck.render(BAR, Strike(), seconds=wrong),
    lambda wrong: struck.render(BAR, Strike(), sample_rate=wrong),
    lambda wrong: struck.sound_map(BAR, level=wrong),
    lambda wrong: Room(size=(3, 4, 5), order=wrong),
    lambda wrong: Resonators([BAR], points=wrong),
]


@pytest.mark.parametrize("wrong", ["7", np.ones(3), 1j, [1.0]], ids=repr)
@pytest.mark.parametrize("make", WRONG, ids=map(str, range(len(WRONG))))
def test_what_is_no_number_is_told(make: Callable[[object], object], wrong: object) -> None:
    with pytest.raises((TypeError, OptionError, MaterialError), match="is "):
        make(wrong)


def test_the_shell_tells_the_bound_in_one_line(
    tmp_path: object, capsys: pytest.CaptureFixture[str]
) -> None:
    struck.save(BAR, f"{tmp_path}/bar.struck")
    code = main(
        ["render", f"{tmp_path}/bar.struck", "--rate", "99999999999", "-o", f"{tmp_path}/x.wav"]
    )
    assert code == 2
    told = capsys.readouterr().err
    assert "at most 1e6" in told
    assert told.count("\n") == 1
