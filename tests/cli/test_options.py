"""What options take, and how messages of the library name them."""

from __future__ import annotations

import argparse
import inspect
import json
import os
import re
from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import soundfile
import trimesh

import struck
from struck import Room, Strike
from struck.analysis import tune
from struck.analysis.analysis import METHODS
from struck.cli import COMMANDS, Parser, declare, in_shell_words, main
from struck.cli.options import body_named, material_of
from struck.cli.render import touches
from struck.cli.simulate import _measures
from struck.ears import Reverberation
from struck.errors import MaterialError, OptionError, ScaleWarning
from struck.scene import Simulation
from struck.shapes import Bar, String

BAR = Bar(length=0.3, width=0.03, thickness=0.005)


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("options") / "bar.struck"
    struck.save(struck.analyze(BAR, "steel", recoil=False), path)
    return path


@pytest.fixture
def bar(kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    return str(kept)


def parser_of(command: str) -> Parser:
    parser = Parser(prog=command)
    declare(parser, command)
    return parser


def options() -> Iterator[tuple[str, argparse.Action]]:
    for command in COMMANDS:
        for action in parser_of(command)._actions:
            if action.option_strings:
                yield command, action


def test_every_frequency_may_be_a_note() -> None:
    """By the types of all options whose help tells of Hz, and of all arguments so called."""
    asked = 0
    for _, action in options():
        if "Hz" in (action.help or "") and "--rate" not in action.option_strings:
            text = "C3,C7" if "band" in action.dest else "C3"
            assert np.ravel(action.type(text))[0] == pytest.approx(130.8128, rel=1e-6)
            asked += 1
    assert asked >= 4
    for function in (struck.analyze, struck.ModalModel.radiating, struck.tune, tune):
        for name, each in inspect.signature(function).parameters.items():
            if name in {"band", "lowest", "frequency"}:
                assert re.search(r"\bstr\b|\bBand\b", str(each.annotation)), (function, name)


def test_notes_are_taken_for_bands_and_reverberation() -> None:
    noted = struck.analyze(BAR, "steel", band=("C5", "2 kHz"), recoil=False)
    assert noted.frequencies.min() > 523.25
    assert noted.complete_to == 2000
    with pytest.warns(ScaleWarning, match="no mode lies from 16"):
        field = struck.analyze(BAR, "steel", recoil=False).radiating(band=("C0", "D0"))
    assert "no mode lies from 16.3516 to 18.354 Hz" in field.provenance.dropped[-1]
    times = Reverberation(seconds={"1 kHz": 0.6, "A4": 0.5}, level=0)
    assert times.bands().tolist() == [[440, 0.5], [1000, 0.6]]
    assert "sounds" in inspect.signature(Simulation).parameters  # `band` goes on to `analyze`


@pytest.mark.parametrize(
    ("command", "words", "name", "value"),
    [
        ("analyze", "--size 4in", "size", 0.1016),
        ("analyze", "--wall 2mm", "wall", 0.002),
        ("analyze-many", "-o x --wall 2mm", "wall", 0.002),
        (
            "analyze",
            "--fixed -1cm,-1cm,0,1cm,1cm,2cm",
            "fixed",
            (-0.01, -0.01, 0, 0.01, 0.01, 0.02),
        ),
        ("render", "x --listener 2m,-5cm,0", "listener", (2, -0.05, 0)),
        ("render", "x --room 5,4m,300cm", "room", (5, 4, 3)),
        ("render", "x --position 1ft,0,0", "position", (0.3048, 0, 0)),
        ("render", "x --radius 10mm", "radius", 0.01),
        ("render", "x --pitch 30cm,1", "pitch", (0.3, 1)),
        ("render", "x --facing -1,0,0", "facing", (-1, 0, 0)),
        ("render", "x --direction -.5,0,0", "direction", (-0.5, 0, 0)),
        ("compare", "x y --at 5cm,0,0", "at", (0.05, 0, 0)),
        ("compare", "x y --at -5cm,0,0", "at", (-0.05, 0, 0)),
        ("compare", "x y --at rim", "at", "rim"),
        ("show", "x --strike -0.05,0,1in", "strike", (-0.05, 0, 0.0254)),
        ("show", "x --pitch 30cm", "pitch", 0.3),
        ("export", "x --listeners -1,0,0 0,1m,0", "listeners", [(-1, 0, 0), (0, 1, 0)]),
        ("sound-map", "x --listener 50cm,0,0", "listener", (0.5, 0, 0)),
        ("play", "x --listener -50cm,0,0", "listener", (-0.5, 0, 0)),
        ("fit", "x --centre 0,0,8cm", "centre", (0, 0, 0.08)),
        ("fit", "x --radius 8cm", "radius", 0.08),
        ("fit", "x --pitch 8cm", "pitch", (0.08,)),
        ("render", "x --modes all", "modes", None),
        ("info", "x --modes all", "modes", None),
        ("fit", "x", "modes", 64),
    ],
)
def test_lengths_have_units_and_vectors_may_begin_below_0(
    command: str, words: str, name: str, value: object
) -> None:
    found = getattr(parser_of(command).parse_args(words.split()), name)
    if isinstance(value, str | list | None):
        assert found == value
    else:
        assert found == pytest.approx(value)


def test_every_length_of_every_command_takes_units() -> None:
    """Of all options whose help gives metres, but for files."""
    lengths, asked = re.compile(r"(?<![\d/])\bm\b(?!/)|metres"), 0
    for command, action in options():
        if action.dest in {"walk", "geometry", "units"} or not lengths.search(action.help or ""):
            continue
        if action.metavar in {"PATTERN=VALUE", "PLACE[@SECONDS]"}:  # split up before, see below
            continue
        read, kind = [], action.type
        for text in ("1cm", "1cm,0,0", "0,0,0,1cm,1cm,1cm"):
            with suppress(argparse.ArgumentTypeError, ValueError):
                read += [kind(text)] if kind else []
        assert any(np.max(np.ravel(each)) == 0.01 for each in read if not isinstance(each, str)), (
            command,
            action.dest,
        )
        asked += 1
    assert asked > 15
    words = ["x", "--strike", "5cm,0,1in@0.5", "--roll", "0,0,0..1cm,0,0"]
    struck_at, rolled = touches(parser_of("render").parse_args(words))
    assert (struck_at.at, struck_at.time) == ((0.05, 0, 0.0254), 0.5)
    assert rolled.path == ((0, 0, 0), (0.01, 0, 0))
    assert _measures("--wall", ["mug*=3mm"]) == {"mug*": 0.003}


@pytest.mark.parametrize(
    ("command", "text", "words"),
    [
        ("analyze", "3 m (units='mm'); else", "3 m (--units mm); else"),
        ("analyze", "as in band=(20, 9000), or", "as in --band 20,9000, or"),
        ("analyze", "leave wall= out", "leave --wall out"),
        ("simulate", "materials names 'tiel', and there", "--material names 'tiel', and there"),
        ("sound-map", "threshold_db is 0: the surface", "--threshold is 0: the surface"),
        ("render", "mode is 3: give", "mode is 3: give"),
        ("render", "hits.csv: speed is 0", "hits.csv: speed is 0"),
        ("simulate", "name a shape with models=", "name a shape with --model"),
        ("simulate", 'restitution="materials" lets', "--restitution materials lets"),
        ("simulate", "it with materials=; x", "it with --material; x"),
        ("render", "or take radiation='power'", "or take --radiation power of struck analyze"),
        (
            "render",
            "the field with near=True, which",
            "the field with --near of struck radiate, which",
        ),
        ("render", "fit it with blow= to", "fit it with --blow of struck fit to"),
        ("render", "at= or sample_rate=8000", "--strike or --rate 8000"),
        ("render", "by pitch=, as in model.charted(pitch=0.25), or", "by --pitch, or"),
        ("play", "as by struck.fit(modes=)", "as by struck fit --modes"),
        ("show", "by model.radiating(), or", "by struck radiate, or"),
        ("play", "listener=Mono(position=1), x", "--listener Mono(position=1) (in Python), x"),
        ("render", "add kernel='gaussian', or", "add kernel='gaussian' (in Python), or"),
        (
            "analyze",
            "use a solid of struck.solids, or",
            "use a solid of 'struck analyze --list', or",
        ),
        ("analyze", "Tube(length=1, wall=2, x=(1, 2))", "Tube(length=1, wall=2, x=(1, 2))"),
        ("info", "runs/seed=3 has wall=3.stl", "runs/seed=3 has wall=3.stl"),
        (
            "calibrate",
            "--material density=1,poisson_ratio=2",
            "--material density=1,poisson_ratio=2",
        ),
        ("analyze", "tube:length=1,wall=2 of x.wall=3", "tube:length=1,wall=2 of x.wall=3"),
    ],
)
def test_advice_names_options(command: str, text: str, words: str) -> None:
    assert in_shell_words(parser_of(command), text) == words


@pytest.mark.parametrize(
    ("body", "vary", "before"),
    [
        ("rod:length=30cm,radius=5mm", "radius", 0.005),
        pytest.param("bowl:radius=6cm,wall=2mm", "wall", 0.002, marks=pytest.mark.prove),
        pytest.param("bell:", "sound_bow", 0.018, marks=pytest.mark.prove),
        pytest.param("glass:radius=3cm", "height", 0.2, marks=pytest.mark.prove),
    ],
)
def test_bodies_are_tuned_by_the_names_of_their_list(
    capsys: pytest.CaptureFixture[str], body: str, vary: str, before: float
) -> None:
    how = ("--material", "bronze", "--json", *(() if "rod" in body else ("--accuracy", "preview")))
    assert main(["tune", body, *how, "--vary", vary, "--lowest", "A5"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["frequency"] == pytest.approx(880, rel=1e-6)
    assert told["before"] == before != told[vary]


def test_what_makes_a_body_is_tuned() -> None:
    made = partial(Bar, length=0.3, width=0.03, thickness=0.005)
    assert struck.tune(made, "steel", vary="length", lowest="A5") == struck.tune(
        BAR, "steel", vary="length", lowest="A5"
    )


def test_a_body_stands_in_its_room(bar: str) -> None:
    room = ("--room", "5,4,3", "--listener", "1,1,1.5")
    common = ("--speed", "1", "--striker", "wood", "--seconds", "0.3", "--level", "absolute")
    model = struck.load(bar)
    for name, place, words in (
        ("middle", (2.5, 2.0, 1.5), ()),
        ("moved", (1.0, 3.0, 0.5), ("--position", "1,300cm,0.5")),
    ):
        assert main(["render", bar, *room, *common, *words, "-o", f"{name}.wav"]) == 0
        origin = np.array(place) - model.centre
        standing = struck.Body(
            model=model,
            excitations=Strike(speed=1.0, striker="wood"),
            position=tuple(origin.tolist()),
        )
        sound = struck.render(
            standing, listener=(1, 1, 1.5), room=Room(size=(5, 4, 3)), seconds=0.3
        )
        heard = struck.Sound.load(f"{name}.wav")
        assert np.abs(sound.samples).max() > 0
        assert heard.samples == pytest.approx(sound.samples, abs=1e-6 * sound.peak)


def test_both_sides_of_a_comparison_are_struck_alike(
    bar: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        main(["compare", bar, bar, "--impulse", "0.3", "--at", "middle", "--against", "end"]) == 0
    )
    told = capsys.readouterr().out
    assert re.findall(r"struck at (\w+) .* by (\S+) N s", told) == [
        ("middle", "0.3"),
        ("end", "0.3"),
    ]
    durations = {}
    for striker in ("felt", "steel"):
        assert main(["compare", bar, bar, "--striker", striker, "--speed", "2"]) == 0
        blows = re.findall(r"N s in (\S+) ms", capsys.readouterr().out)
        assert len(blows) == 2
        durations[striker] = float(blows[0])
        assert blows[0] == blows[1]
    assert durations["felt"] > 2 * durations["steel"]


@pytest.mark.prove
def test_pairs_by_chance_are_told(bar: str) -> None:
    model = struck.load(bar)
    strip = Bar(length=0.37, width=0.02, thickness=0.004, ends=("clamped", "free"))
    other = struck.compare(model, struck.analyze(strip, "brass", recoil=False))
    larger = struck.compare(model, model.scaled(1.02))
    assert (larger.explained, larger.by_chance) == (True, 0)
    assert not other.explained
    share = min(100, round(100 * other.by_chance / len(other.pairs)))
    assert share > 0
    assert f"about {share} % of the pairs would be found by chance" in other.summary()


TABLES = {
    "name,at,velocity\na,end,1\n": ("row 1 of hits.csv", "'velocity'", "did you mean speed", "at,"),
    "at,speed\nend,1\nend,1\n": (
        "row 1 of hits.csv",
        "speed is 1",
        "add a striker, such as striker '",
    ),
    "at,striker,speed\nend,wood,1\nend,wool,1\n": ("row 2 of hits.csv", "'wool'", "give one of"),
    "at,impulse\nend,1\n5,1\n": ("row 2 of hits.csv", "at is 5.0", "coordinates in m, or the name"),
    "at,impulse\nend,0,1\n": ("row 1 of hits.csv", "1 cells more than columns", 'in "quotes"'),
}


@pytest.mark.parametrize("table", TABLES)
def test_rows_of_a_table_that_are_no_strikes_are_named(
    bar: str, table: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("hits.csv").write_text(table)
    assert main(["render", bar, "--strikes", "hits.csv", "-o", "hits"]) == 2
    told = capsys.readouterr().err
    for word in TABLES[table]:
        assert word in told
    assert "=" not in told


@pytest.mark.parametrize("between", [",", ";", "\t"])
def test_tables_have_commas_or_semicolons_or_tabs(bar: str, between: str) -> None:
    rows = ("name,at,striker,speed", "soft,end,felt,1", "hard,end,steel,1")
    Path("hits.csv").write_text("\n".join(rows).replace(",", between))
    words = ("--seconds", "0.1", "-o", "hits")
    assert main(["render", bar, "--strikes", "hits.csv", *words]) == 0
    assert {path.name for path in Path("hits").glob("*.wav")} == {"soft.wav", "hard.wav"}


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("--load 3", "--load 3.0 is for --scrape, which is not given: give it, or leave it out"),
        ("--strike end --mass 2", "--mass 2.0 is for --roll"),
        ("--pluck end --striker felt", "--striker felt is for --strike or --scrape"),
        ("--scrape end..top --grip 3", "--grip 3.0 is for --hold"),
        ("--roll end..top --force 50", "--force 50.0 is for --pluck"),
        ("--walls brick", "--walls brick needs a room: give --room x,y,z, or leave it out"),
        ("--sounds flac", "--sounds flac is for --strikes"),
        ("--position 1,1,1", "--position 1.0,1.0,1.0 needs a room"),
        ("--hold end", "1 hold and nothing that strikes: give at least one strike"),
    ],
)
def test_options_that_say_nothing_here_are_refused(
    words: str, told: str, bar: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["render", bar, *words.split(), "-o", "none.wav"]) == 2
    assert told in capsys.readouterr().err
    assert not Path("none.wav").exists()


IDLE = {
    "analyze box.stl --material steel --units mn": "did you mean m? give",
    "analyze box.stl --material steel --accuracy prevew": "did you mean preview? give one of",
    "analyze box.stl --material steel --damping herd": "did you mean heard?",
    "analyze box.stl --material steel --part a": "it has no part 'a': give one of '0'",
    "analyze box.stl --material steel --wall 10": "the longest edge of the body is 0.1 m: give",
    "analyze box.stl --material steel --fixed 5,5,5,6,6,6": "give a box that holds a part of it",
    "analyze box.stl --material density=1,youngs_modulus=2GPa,poisson_ratio=0.3": (
        "youngs_modulus is '2GPa': give a number in SI units"
    ),
    "analyze box.stl --material steel --band 5000,50": "--band is 5000,50: give two",
    "analyze string:length=1,radius=1mm,tension=60kN --material steel": "tension is '60kN': give",
    "analyze block:size=10cm --material ice": "size is '10cm': give three lengths, as size=0.1,",
    "analyze block:size=1,2,3,4 --material ice": "is 1,2,3,4: give its edges along x, y and z\n",
    "analyze block:size=30x3x2cm --material ice": "'30x3x2cm': give each length its unit, as 30cmx",
    "analyze bar:length=1,width=0.1,thickness=0.1,ends=free,free,free --material ice": (
        "ends are free,free,free: give one or two of free, clamped, hinged, sliding, two as ends="
    ),
    "analyze rod:length=1,radius=1cm,ends=fixed --material ice": "'fixed': did you mean clamped?",
    "analyze polygon-membrane:corners=(0,0),(3,0),(0,2),thickness=1mm,tension=3 --material ice": (
        "corners is '(0,0),(3,0),(0,2)': give the corners' x and y with 'x' between, as corners=0x"
    ),
    "analyze circular-membrane:radius=10cm,thickness=1mm,tension=3kN/m --material ice": (
        "tension is '3kN/m': give a tension in N as 60N, in membranes in N/m as 60N/m, without k or"
    ),
    "export BAR --contacts end --listeners 1,0": "--listeners 1,0: give x,y,z of each, m, as 1,0,0",
    "export BAR --contacts end,middle": "--contacts end,middle: part them by blanks, as end mid",
    "analyze-many box.stl --material ice -o n --strikes three": (
        "--strikes three is neither a number nor a file: give how many of each model, or a table"
    ),
    "render BAR --rate 44": "--rate 44: all modes lie at or above half of it, the lowest at ",
    "render BAR --strike -z": "expected one argument; one that begins with a minus as --str",
    "render BAR --hold middle@-1": "--hold middle@-1 ends in '-1': give seconds after @, of at ",
    "render BAR --walk back.csv": "back.csv has times 2,0: they must be finite and ascend, in s",
    "render BAR --room 5,4,3 --walls floor=wood": "--walls is 'floor=wood': did you mean wood?",
    "compare BAR none.wav --at ende": "on the model, the place is 'ende': did you mean end",
    "compare BAR BAR --against ende": "on the other model, the place is 'ende': did you mean end",
    "fit none.wav --residual --no-residual": "--residual/--no-residual: both: give it once",
    "simulate none.xml --restitution material": "material: did you mean materials? give mat",
    "fit box.stl --interpolation tabel": "--interpolation is 'tabel': did you mean table?",
    "fit box.stl --method corbet2007": "--method is 'corbet2007': did you mean corbett2007?",
    "render BAR --head exakt -o a.wav": "--head is 'exakt': did you mean exact?",
    "render BAR --hrtf kemra -o a.wav": "--hrtf is 'kemra': did you mean kemar?",
    "render BAR --strike ende -o a.wav": "the place is 'ende': did you mean end",
    "render BAR --room 5000,4000,3000 -o a.wav": "a room of size 5000,4000,3000: give three",
    "render BAR --room 5,4,3 --walls plastr -o a.wav": "--walls is 'plastr': did you mean plaster",
    "render BAR --room 5,4,3 --reverberation 0 -o a.wav": "reverberation in s is 0.0: give one",
    "render BAR --head exact --facing 0,0,1 -o a.wav": "facing lies along up, z by default: tilt",
    "render BAR -o a": "a has no ending: sounds end in .wav",
    "simulate box.stl --ring -1": "--ring is -1.0 s: give 0 s or more",
    "render BAR --strikes hits.csv --speed 2 -o n": "--speed 2.0 is for one sound: --strikes hits",
    "render BAR --strikes hits.csv --roll a..b -o n": "--roll a..b is for one sound, and --strikes",
    "render BAR --strikes hits.csv --listener 0,1,0 -o n": "is for rows without a listener",
    "analyze block:size=1cmx1cmx1cm --material ice --method formula": "this body has none, as it",
    "analyze block:size=1cmx1cmx1cm --material ice --part 2": "this body is no file, and has",
    "render BAR --strike 0.1,0.2 -o n.wav": "give 1 coordinate or x, y, z, in m",
    "render BAR --walk none.csv -o n.wav": "none.csv is missing, there is no file of that name: ",
    "render BAR --strikes hit.csv -o n": "no file of that name: did you mean hits.csv",
    "render BAR --hrtf bx.sofa -o n.wav": "bx.sofa is missing, there is no file of that name: did",
    "info bx.sofa": "bx.sofa is missing, there is no file of that name: did you mean box.st",
    "render BAR --strikes comma.csv -o n": "row 1 of comma.csv: speed is 0,5: give one numb",
    "fit BAR": "bar.struck is a model, not a recording of one: give sound files",
    "simulate BAR": "bar.struck is a model (struck) and not a scene: struck info lists",
    "simulate scene.xml --seconds -1": "--seconds is -1.0: it must lie above 0",
    "analyze BAR --material ice": "bar.struck is a model, whose modes are known: struck info",
    "radiate BAR --band 20,21 -o n.struck": "no mode lies from 20 to 21 Hz: no timbre field is",
    "render BAR --seconds 0 -o n.wav": "--seconds is 0.0",
    "sound-map BAR --parameters map.npz": "map.npz ends in '.npz'",
    "render BAR --level absolute --encoding int16 --striker fingertip --speed 1e-6 -o n.wav": (
        "int16 would leave silence of it: its peak is at -"
    ),
    "analyze box.stl --material ice --holes fill": "--holes fill without a wall",
    "render BAR --pitch 0.3 -o n.wav": "--pitch 0.3 is for --scrape or --roll",
    "analyze-many box.stl --material ice -o n --seed 3": "--seed 3 is for sounds, which are made",
    "analyze --list --up z": "--up z does not go with --list, which lists and ends: leave it out",
    "analyze box.stl --list": "BODY box.stl does not go with --list",
    "play BAR --list-devices": "does not go with --list-devices",
    "record plan.toml --list-devices": "PLAN plan.toml does not go with --list-devices",
    "play BAR --soak 1 --strikes-per-second 2": "--strikes-per-second 2.0 is what --soak chooses",
    "info BAR --units mm": "--units mm is for a mesh file, and",
    "info box.stl --all": "--all is for a model, and box.stl is none",
    "info box.stl --modes 6": "--modes 6 is for a model",
    "export BAR --rate 44100 --contacts end --listeners 0,1,0": "give --convention GeneralFIR-E",
    "export BAR --title x -o n.vtu": "--title x is of SOFA files",
    "simulate scene.xml --play --stems": "--stems is for a file: leave out --play",
    "analyze block:size=1cmx1cmx1cm --material ice --no-repair": "--no-repair applies to surfaces",
    "analyze block:size=1cmx1cmx1cm --material ice --holes fill": "--holes fill without a wall",
    "analyze box.stl --damping herd --material density=1,youngs_modulus=1e9,poisson_ratio=0.3": (
        "damping is 'herd': did you mean heard? give one of own, heard, heard_bowl"
    ),
    "analyze box.stl --damping heard --material density=1,youngs_modulus=1e9,poisson_ratio=0.3": (
        "looked up for materials by name"
    ),
}


@pytest.mark.parametrize("words", IDLE)
def test_options_of_another_use_of_a_command_are_refused(
    words: str, bar: str, capsys: pytest.CaptureFixture[str]
) -> None:
    trimesh.creation.box((0.1, 0.05, 0.03)).export("box.stl")
    Path("hits.csv").write_text('name,at,listener\nsoft,end,"0,1,0"\n')
    Path("back.csv").write_text("2,1,0,0\n0,1,0,0\n")
    Path("comma.csv").write_text("name;at;speed\na;end;0,5\n")
    before = {*Path().iterdir()}
    assert main(words.replace("BAR", bar).split()) == 2
    assert IDLE[words] in capsys.readouterr().err
    assert {*Path().iterdir()} == before


def test_where_two_ears_or_one_in_a_room_stand_is_told(
    bar: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("--seconds", "0.05", "-o", "a.wav")
    assert main(["render", bar, "--room", "4,3,2.5", *words]) == 0
    assert "heard at 3, 1.5, 1.25 m, beside the body" in capsys.readouterr().out
    assert main(["render", bar, "--room", "4,3,2.5", "--listener", "3,1.5,1.25", *words]) == 0
    assert "beside the body" not in capsys.readouterr().out


def test_a_listener_of_a_row_has_the_ears_of_the_options(bar: str) -> None:
    rows = ("name,at,listener", 'own,end,"0,2,0"', "other,end,")
    Path("hits.csv").write_text("\n".join(rows))
    heard = ("--head", "exact", "--listener", "0,1,0", "--seconds", "0.05")
    assert main(["render", bar, "--strikes", "hits.csv", *heard, "-o", "hits"]) == 0
    own, other = (soundfile.read(f"hits/{name}.wav")[0] for name in ("own", "other"))
    assert own.shape == other.shape
    assert own.shape[1] == 2
    assert 1.8 < np.abs(other).max() / np.abs(own).max() < 2.2


@pytest.mark.parametrize(
    ("words", "meant"), [("True true yes 1", True), ("False false no 0", False)]
)
def test_yes_and_no_are_taken_in_all_spellings(words: str, *, meant: bool) -> None:
    for word in words.split():
        string = body_named(f"string:length=0.6,radius=2e-4,tension=1,stiff={word}")
        assert string == String(length=0.6, radius=2e-4, tension=1.0, stiff=meant)
    with pytest.raises(OptionError, match=r"stiff is '2': give 0 or 1"):
        body_named("string:length=0.6,radius=2e-4,tension=1,stiff=2")


@pytest.mark.parametrize(
    ("more", "why"),
    [
        ("poisson_ratio=0.3,rayleigh_stiffness=1e-7", "rayleigh_mass= missing: give"),
        ("poisson_ratio=0.3,rayleigh_mass=1", "rayleigh_stiffness= missing: give"),
        ("loss_tangent=1e-3", "poisson_ratio= missing: give"),
        (
            "poisson_ratio=0.3,loss_tangnet=1e-3",
            "it has no loss_tangnet=: did you mean loss_tangent=",
        ),
        (
            "poisson_ratio=0.3,loss_tangent=1e-3,rayleigh_mass=1,rayleigh_stiffness=1e-7",
            "loss_tangent= and rayleigh_mass= and rayleigh_stiffness= are two laws of damping: ",
        ),
    ],
)
def test_what_a_material_lacks_is_named(more: str, why: str) -> None:
    with pytest.raises(MaterialError, match=f"is no material: {why}.* one of loss_tangent=... or"):
        material_of(f"density=7850,youngs_modulus=2e11,{more}")


def test_one_list_of_methods_is_in_help_and_refusal(capsys: pytest.CaptureFixture[str]) -> None:
    how = next(
        each for command, each in options() if each.dest == "method" and command == "analyze"
    )
    wanted = ", ".join(name for name in METHODS if name in str(how.help))
    for body in ("block:size=10cmx2cmx1cm", "bar:length=30cm,width=3cm,thickness=5mm"):
        assert main(["analyze", body, "--material", "steel", "--method", "magic"]) == 2
        assert f"method is 'magic': give one of quadratic, {wanted}" in capsys.readouterr().err
    block = struck.solids.Block(size=(0.1, 0.02, 0.01))
    fem, plain = (
        struck.analyze(block, "steel", method=method, accuracy="preview").frequencies
        for method in ("fem", "quadratic")
    )
    assert fem.tolist() == plain.tolist() != []


@pytest.mark.parametrize("command", ["render", "info", "play"])
def test_a_body_is_no_model(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([command, "bowl:radius=8cm"]) == 2
    wanted = "bowl:radius=8cm is a body, not a model: analyze it first (struck analyze)"
    assert wanted in capsys.readouterr().err


@pytest.mark.skipif(os.name == "nt", reason="no file there has a colon in its name")
def test_a_file_may_be_called_as_a_body_is(bar: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path("bowl:radius=8cm").write_bytes(Path(bar).read_bytes())
    assert main(["info", "bowl:radius=8cm"]) == 0
    assert "steel" in capsys.readouterr().out


WAYS = {
    "analyze bar:length=30cm,width=3cm,thickness=5mm,ends=clamped/free --material steel": (
        "did you mean free or clamped? give one of free, clamped, hinged, sliding, or two of them\n"
    ),
    "analyze circular-membrane:radius=20cm,thickness=0.2mm,tension=3000 --material steel "
    "--accuracy fine": "which is computed by a formula: leave it out\n",
    "analyze bar:length=30cm,width=3cm,thickness=5mm --material steel --fixed 0,0,0,1,1,1": (
        "--fixed does not apply to a bar, which is computed by a formula: leave it out, or take "
        "--method fem\n"
    ),
    "analyze rod:length=30cm,radius=5mm --material steel --method fem --wall 1mm": (
        "--wall applies to surfaces, and a bar has its own"
    ),
    "render BAR --mass 20g": "'20g': give a number alone, in the unit that --help names",
    "render BAR --rate 48k": "'48k': give a whole number:",
    "fit take.wav --room 400ms": "--room 400ms is neither a number nor a file: give seconds as 0.4",
    "render BAR --strikes BAR -o n": "bar.struck is no UTF-8 text: save it as UTF-8",
    "render BAR --walk hits.csv": (
        "hits.csv tells no walk, line 1 is 'name,at': give lines of four numbers, time,x,y,z in s"
    ),
    "render BAR --walk BAR": "tells no walk, it is no text: give lines",
    "render BAR --scrape end..top --pitch 1": (
        "--pitch is about the way between places that were recorded, and this body has a surface: "
        "leave it out"
    ),
    "tune BAR --material steel --vary length --lowest A4": (
        "bar.struck is a model, which has no dimensions to vary: give a body as bowl:radius=8cm "
        "(struck analyze --list), or analyze its mesh at another --size"
    ),
    "tune box.stl --material steel --vary length --lowest A4": (
        "box.stl is a mesh file, which has no dimensions to vary: give a body as bowl:radius=8cm "
        "(struck analyze --list), or analyze it at another --size"
    ),
    "render BAR --strikes hits.csv -o set.wav": (
        "makes many sounds, and set.wav names one: give a folder, as -o set\n"
    ),
    "render BAR --strikes hits.csv -o n --sounds aac": (
        "--sounds aac is no kind of sounds: give one of wav, flac, ogg, aiff, aif, mp3\n"
    ),
    "render BAR -o n.mp3 --encoding int24": ("encoding is 'int24': for MP3 give mp3\n"),
    "render BAR -o n.mp3 --rate 96000 --seconds 0.1": (
        "at 96000 Hz (MPEG-1/2/2.5 only supports sample rates of 8000, 11025"
    ),
}


@pytest.mark.parametrize("words", WAYS)
def test_a_refusal_in_the_shell_names_a_way_out_that_it_takes(
    words: str, bar: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("hits.csv").write_text("name,at\nsoft,end\n")
    before = {*Path().iterdir()}
    assert main(words.replace("BAR", bar).split()) == 2
    assert WAYS[words] in capsys.readouterr().err
    assert {*Path().iterdir()} == before


def test_the_list_of_bodies_tells_how_two_ends_are_given(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["analyze", "--list"]) == 0
    assert "two ends as bar:...,ends=clamped,free" in capsys.readouterr().out
    two = body_named("bar:length=30cm,width=3cm,thickness=5mm,ends=clamped,free")
    assert isinstance(two, Bar)
    assert two.ends == ("clamped", "free")
