"""Options of `struck.analyze` on water and air, against the functions that compute them."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
import pytest

import struck
from struck.analysis.fluid_options import FluidOptions
from struck.batch.job_table import jobs_of
from struck.cli import main
from struck.errors import OptionError
from struck.radiation import add_air_mass, fill, immerse
from struck.shapes import Bar, CircularMembrane, CircularPlate, RectangularMembrane
from struck.solids import Block, bowl
from tests.radiation.test_fluid_loading import tub
from tests.samples import sampled

PET = struck.Material(density=1390.0, youngs_modulus=5e9, poisson_ratio=0.38)
HEAD = CircularMembrane(radius=0.3302, thickness=0.00019, tension=4000.0)
BOWL = bowl(radius=0.06, height=0.04, wall=0.002)


class FluidArguments(TypedDict):
    filled: float | None
    immersed: float | None
    air_mass: bool


@cache
def analyzed(
    name: str,
    *,
    filled: float | None = None,
    immersed: float | None = None,
    air_mass: bool = False,
) -> struck.ModalModel:
    options: FluidArguments = {"filled": filled, "immersed": immersed, "air_mass": air_mass}
    if name == "bowl":
        return struck.analyze(BOWL, "glass", accuracy="preview", band=(20, 3000), **options)
    if name == "head":
        return struck.analyze(HEAD, PET, band=(20, 300), **options)
    plate = CircularPlate(radius=0.1, thickness=0.002, edge="clamped")
    return struck.analyze(plate, "steel", band=(20, 1500), **options)


CASES: dict[str, tuple[str, dict[str, Any], Any]] = {
    "filled": ("bowl", {"filled": 0.03}, lambda dry: fill(dry, 0.03)),
    "immersed": ("bowl", {"immersed": 0.02}, lambda dry: immerse(dry, level=0.02)),
    "both": (
        "bowl",
        {"filled": 0.01, "immersed": 0.02},
        lambda dry: immerse(dry, level=0.02, filled=0.01),
    ),
    "deep": ("plate", {"immersed": math.inf}, immerse),
    "air": ("head", {"air_mass": True}, add_air_mass),
}


@pytest.mark.parametrize("case", sampled(CASES, "deep", "air"))
def test_options_are_the_functions(case: str) -> None:
    name, options, load = CASES[case]
    loaded, expected = analyzed(name, **options), load(analyzed(name))
    assert loaded.natural_frequencies == pytest.approx(expected.natural_frequencies, rel=1e-9)
    assert loaded.decays == pytest.approx(expected.decays, rel=1e-9)
    assert loaded.provenance.details["fluid"] == expected.provenance.details["fluid"]
    assert loaded.natural_frequencies[0] < 0.99 * analyzed(name).natural_frequencies[0]


def test_levels_are_those_of_the_functions() -> None:
    dry = tub()
    for options, expected in (
        (FluidOptions(inner_level=0.03), fill(dry, 0.03)),
        (FluidOptions(outer_level=0.05), immerse(dry, level=0.05)),
        (FluidOptions(inner_level=0.03, outer_level=0.05), immerse(dry, level=0.05, filled=0.03)),
    ):
        loaded = options.load(dry)
        assert loaded.natural_frequencies == pytest.approx(expected.natural_frequencies)
        assert loaded.provenance.details["fluid"] == expected.provenance.details["fluid"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"filled": math.nan}, r"filled is nan m: it must be a finite height"),
        ({"filled": math.inf}, r"filled is inf m: it must be a finite height"),
        ({"filled": -2e70}, r"filled is -2e\+70 m: it must be"),
        ({"immersed": -math.inf}, r"immersed is -inf m: .*or math\.inf"),
        ({"filled": 0.05, "immersed": math.inf}, r"filled is 0\.05 m and immersed is inf: .*leave"),
        ({"filled": 0.05, "air_mass": True}, r"air_mass is True and filled is 0\.05 m: .*leave"),
        ({"immersed": 0.1, "air_mass": True}, r"air_mass is True and immersed is 0\.1 m"),
    ],
)
def test_senseless_options_are_refused_before_the_body_is_read(
    options: dict[str, Any], words: str
) -> None:
    with pytest.raises(OptionError, match=words):
        struck.analyze("missing.stl", "steel", **options)


def test_options_that_do_not_fit_the_body_are_refused() -> None:
    bar = Bar(length=0.3, width=0.03, thickness=0.005)
    with pytest.raises(OptionError, match=r"no flat sheet across z.*air_mass=False"):
        struck.analyze(bar, "steel", band=(20, 2000), air_mass=True)
    with pytest.raises(OptionError, match=r"level is 0\.1 m, and a flat sheet.*immersed=math\.inf"):
        struck.analyze(HEAD, PET, band=(20, 200), immersed=0.1)


def air_notes(model: struck.ModalModel) -> list[str]:
    return [note for note in model.provenance.dropped if "mass of the air" in note]


def test_a_light_sheet_states_once_that_it_lacks_the_air() -> None:
    (note,) = air_notes(analyzed("head"))
    assert "lowest mode of the body analyzed by about 34 %" in note
    assert "air_mass=True (--air-mass)" in note
    assert not air_notes(analyzed("head", air_mass=True))
    assert not air_notes(add_air_mass(analyzed("head")))
    assert air_notes(analyzed("head").scaled(0.5)) == [note]
    assert not air_notes(analyzed("plate"))


SHEETS = {
    "round head": (HEAD, PET),
    "square head": (RectangularMembrane(length=0.3, width=0.3, thickness=1e-4, tension=1e3), PET),
    "clamped plate": (CircularPlate(radius=0.15, thickness=5e-4, edge="clamped"), "aluminium"),
    "free plate": (CircularPlate(radius=0.15, thickness=5e-4, edge="free"), "aluminium"),
    "free sheet": (Block(size=(0.3, 0.2, 0.001)), "aluminium"),
}


@pytest.mark.prove
@pytest.mark.parametrize("name", SHEETS)
def test_the_estimate_is_near_the_lowering(name: str) -> None:
    body, material = SHEETS[name]
    options = {} if name != "free sheet" else {"accuracy": "preview"}
    dry = struck.analyze(body, material, band=(20, 700), **options)
    wet = struck.analyze(body, material, band=(20, 700), air_mass=True, **options)
    lowering = 100 * (1 - wet.natural_frequencies[0] / dry.natural_frequencies[0])
    (note,) = air_notes(dry) or ["about 1 %"]
    assert 0.8 < float(note.split("about ")[1].split()[0]) / lowering < 1.4


def test_the_shell_takes_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plate = "circular-plate:radius=10cm,thickness=2mm,edge=clamped"
    output = str(tmp_path / "wet.struck")
    arguments = ["analyze", plate, "--material", "steel", "--band", "20,1500", "-o", output]
    assert main([*arguments, "--immersed", "inf"]) == 0
    assert "fluid     water, setting free" in capsys.readouterr().out
    expected = analyzed("plate", immersed=math.inf).natural_frequencies
    assert struck.load(output).natural_frequencies == pytest.approx(expected)
    assert main([*arguments, "--filled", "5cm", "--air-mass"]) == 2
    assert "--air-mass is True and filled is 0.05 m" in capsys.readouterr().err
    assert main([*arguments, "--immersed", "deep"]) == 2
    assert "'deep': give a length in m" in capsys.readouterr().err


def test_rows_of_a_table_have_their_own_fluid(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\n")
    table = tmp_path / "jobs.csv"
    table.write_text(
        "file,output,filled,immersed,air_mass\na.obj,a,0.03,0.02,false\na.obj,b,0.04,inf,true\n"
    )
    first, second = jobs_of(None, "steel", table, {})
    assert first.options == {"filled": 0.03, "immersed": 0.02, "air_mass": False}
    assert second.options == {"filled": 0.04, "immersed": math.inf, "air_mass": True}
    assert first.with_key().key != second.with_key().key
    assert np.isinf(second.options["immersed"])
