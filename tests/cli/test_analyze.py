"""Closed forms as the shell names them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from struck.cli import main
from struck.cli.options import arguments_of, body_named, makers
from struck.errors import OptionError
from struck.model.material import Material
from struck.shapes import (
    AnnularMembrane,
    Bar,
    CircularMembrane,
    CircularPlate,
    PolygonMembrane,
    RectangularMembrane,
    RectangularPlate,
    RoundSection,
    String,
)
from struck.solids import Block, Tube
from struck.solids.revolution import bell, bowl, wine_glass

FILM = "thickness=0.2mm,tension=2000"
NAMED: dict[str, object] = {
    "block:size=0.1,0.05,0.03": Block(size=(0.1, 0.05, 0.03)),
    "block:size=10cmx50mmx0.03": Block(size=(0.1, 0.05, 0.03)),
    "tube:length=20in,radius=1cm,wall=1mm": Tube(length=0.508, radius=0.01, wall=0.001),
    "bowl:radius=8cm,wall=2mm": bowl(radius=0.08, wall=0.002),
    "bell:": bell(),
    "glass:height=20cm": wine_glass(),
    "string:length=60cm,radius=2e-4,tension=60,stiff=yes": String(
        length=0.6, radius=2e-4, tension=60.0, stiff=True
    ),
    "bar:length=0.3,width=0.03,thickness=0.005,ends=clamped,free": Bar(
        length=0.3, width=0.03, thickness=0.005, ends=("clamped", "free")
    ),
    "bar:length=0.3,width=0.03,thickness=0.005,theory=euler-bernoulli": Bar(
        length=0.3, width=0.03, thickness=0.005, theory="euler-bernoulli"
    ),
    "rod:length=0.5,radius=0.01,wall=0.001": Bar(
        length=0.5, section=RoundSection(radius=0.01, wall=0.001)
    ),
    f"rectangular-membrane:length=0.5,width=0.4,{FILM}": RectangularMembrane(
        length=0.5, width=0.4, thickness=2e-4, tension=2000.0
    ),
    f"circular-membrane:radius=0.2,{FILM}": CircularMembrane(
        radius=0.2, thickness=2e-4, tension=2000.0
    ),
    f"annular-membrane:radius=0.2,hole=0.05,{FILM}": AnnularMembrane(
        radius=0.2, hole=0.05, thickness=2e-4, tension=2000.0
    ),
    f"l-membrane:side=0.2,{FILM}": PolygonMembrane.l_shape(
        side=0.2, thickness=2e-4, tension=2000.0
    ),
    f"polygon-membrane:corners=0x0,0.3x0,0x0.2,{FILM}": PolygonMembrane(
        corners=((0.0, 0.0), (0.3, 0.0), (0.0, 0.2)), thickness=2e-4, tension=2000.0
    ),
    "circular-plate:radius=0.1,thickness=0.001,edge=clamped": CircularPlate(
        radius=0.1, thickness=0.001, edge="clamped"
    ),
    "rectangular-plate:length=0.3,width=0.2,thickness=0.002": RectangularPlate(
        length=0.3, width=0.2, thickness=0.002
    ),
    "rectangular-plate:length=0.3,width=0.2,thickness=0.002,edges=clamped,free,supported,free": RectangularPlate(  # noqa: E501
        length=0.3, width=0.2, thickness=0.002, edges=("clamped", "free", "supported", "free")
    ),
}


# A value that fits, of each argument in the list of bodies.
FITTING = {"size": "0.3,0.2,0.1", "corners": "0x0,0.3x0,0x0.2", "ends": "free", "edges": "free"}
FITTING |= {"edge": "free", "theory": "timoshenko", "stiff": "no", "hole": "0.01", "wall": "2mm"}


@pytest.mark.parametrize("kind", makers())
def test_the_list_tells_what_each_body_needs(kind: str) -> None:
    needed, more = arguments_of(makers()[kind])
    words = {name: f"{name}={FITTING.get(name, '0.05')}" for name in (*needed, *more)}
    whole = [words[name] for name in needed]
    for name in (None, *more):
        body_named(f"{kind}:{','.join([*whole, *([words[name]] if name else ())])}")
    for name in needed:
        rest = ",".join(each for each in whole if each != words[name])
        with pytest.raises(OptionError, match=f"give {kind}:.*{name}="):
            body_named(f"{kind}:{rest}")


def test_a_tension_has_its_unit() -> None:
    for kind, unit in (
        ("string:length=1,radius=1mm", "N"),
        ("circular-membrane:radius=9cm,thickness=1mm", "N/m"),
    ):
        assert body_named(f"{kind},tension=60{unit}") == body_named(f"{kind},tension=60")


@pytest.mark.parametrize("text", NAMED)
def test_every_shape_has_its_name(text: str) -> None:
    assert body_named(text) == NAMED[text]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("bar:width=0.03", "bar:length=..."),
        ("string:length=1,radius=1e-3,tension=1,width=1", "no width=.*if wanted, stiff"),
        ("circular-membrane:radius=0.1", "tension=..."),
        ("bar:length=-0.3,width=0.03,thickness=0.005", "must exceed 0"),
        ("string:length=1,radius=1e-3,tension=60cm", "'60cm'.* a tension in N as 60N"),
        ("circular-membrane:radius=0.1,thickness=1e-3,tension=6N", "in N/m as 60N/m"),
        ("polygon-membrane:thickness=1e-3", "give polygon-membrane:corners=0x0,0.3x0,0x0.2,"),
        ("bar:length=0.3,width=0.03,thickness=0.005,ends=glued", "glued"),
    ],
)
def test_what_is_missing_or_wrong_is_told(text: str, told: str) -> None:
    with pytest.raises(OptionError, match=told):
        body_named(text)


def test_a_bar_is_analyzed_rendered_and_mapped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    size = "bar:length=30cm,width=3cm,thickness=5mm"
    made = ["analyze", size, "--material", "steel", "-o", "bar.struck"]
    assert main([*made, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    steel = Material.named("steel")
    speed = np.sqrt(steel.youngs_modulus / steel.density)
    slender = 4.730040744862704**2 / (2 * np.pi * 0.3**2) * speed * 0.005 / np.sqrt(12)
    assert told["frequencies"][0] == pytest.approx(slender, rel=0.005)
    assert np.max(told["errors"]) < 1e-9
    assert main(["render", "bar.struck", "--strike", "0.02", "--seconds", "0.5"]) == 0
    assert main(["sound-map", "bar.struck", "--threshold", "12", "-o", "map.png"]) == 0
    assert (tmp_path / "map.png").stat().st_size > 10_000


def test_help_shows_a_line_that_works(capsys: pytest.CaptureFixture[str]) -> None:
    for verb, words in {"analyze": "bar:length=30cm", "sound-map": "sound-map"}.items():
        with pytest.raises(SystemExit, match="0"):
            main([verb, "--help"])
        assert words in capsys.readouterr().out


def test_a_body_without_a_material_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["analyze", "--material", "steel"]) == 2
    assert "give both" in capsys.readouterr().err
