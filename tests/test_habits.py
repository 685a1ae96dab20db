"""What people do wrong at first, by a trial of four of them, and how each is told the way out."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import json
import pickle
import re
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from threadpoolctl import threadpool_info, threadpool_limits

import struck
from struck.analysis.cached_steps import Stages
from struck.analysis.discretisation import FileOptions, discretise
from struck.cli import main
from struck.core.machine import thread_count
from struck.errors import article, counted
from struck.files.meshes import part_of
from struck.model import Material, Measured, provenance
from struck.model.provenance import silent
from struck.model.residual import Residual
from struck.shapes import Bar, CircularMembrane, PolygonMembrane, RectangularPlate
from struck.solids import Block, Tube, bell
from tests.folders import closed_to_writing
from tests.test_words import public

BLOCK = Block(size=(0.1, 0.05, 0.03))
BAR = Bar(length=0.3, width=0.03, thickness=0.005)
MEMBRANE = CircularMembrane(radius=0.2, thickness=2e-4, tension=3000)
TUBE = "tube:length=0.5,radius=0.0125,wall=0.001"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a model, a sound of it, and a ball of 46 m."""
    path = tmp_path_factory.mktemp("habits")
    model = struck.analyze(BLOCK, "steel", accuracy="preview", recoil=False)
    struck.save(model, path / "b.struck")
    struck.render(model, struck.Strike(), seconds=0.1).save(path / "w.wav")
    (path / "sound.struck").write_bytes((path / "w.wav").read_bytes())
    trimesh.creation.icosphere(subdivisions=3, radius=23).export(path / "nut.ply")
    return path


def shell(*words: str) -> Callable[[], object]:
    return lambda: main(words)


def tuned_by(vary: str) -> list[str]:
    return ["--material", "steel", "--vary", vary, "--lowest", "A5"]


def model() -> struck.ModalModel:
    return struck.load("b.struck")


def hit(**given: object) -> struck.Sound:
    return struck.render(model(), struck.Strike(**given), seconds=0.1)


def soft() -> object:
    material = Material(density=7800, youngs_modulus=200, poisson_ratio=0.3)
    return struck.analyze(BLOCK, material, cache=False)


# By what was tried: the call, and what the answer says: value, bound, way out.
USES: dict[str, tuple[Callable[[], object], tuple[str, ...]]] = {
    "1 no units": (
        lambda: struck.analyze("nut.ply", "steel", cache=False),
        ("46 m", "modes below 20000 Hz", "units="),
    ),
    "2 a tube of 300 m": (
        lambda: struck.analyze(Tube(length=300, radius=0.01, wall=0.001), "steel", cache=False),
        ("300 m", "modes below 20000 Hz", "if its lengths are in mm"),
    ),
    "3 E in GPa": (soft, ("200 Pa", "0.16 m/s", "200 GPa is 200e9")),
    "4 E as text": (
        lambda: Material(density=1, youngs_modulus="2e9", poisson_ratio=0.3),
        ("youngs_modulus|Young's modulus", "'2e9'", "give a number in Pa|takes a number"),
    ),
    "5 tuned to no note": (
        lambda: model().tuned(lowest="H9"),
        ("lowest is 'H9'", "C-1 to B10", "as A5"),
    ),
    "6 tune to no note": (
        shell("tune", TUBE, "--material", "steel", "--vary", "length", "--lowest", "H9"),
        ("'H9'", "C-1 to B10", "as A5"),
    ),
    "7 a vector of impulse": (
        lambda: struck.Strike(impulse=(0, 1e-3, 0)),
        ("impulse is \\(0, 0.001, 0\\)", "takes a number", "direction= says which way"),
    ),
    "8 an unknown ending": (
        lambda: hit().save("x.wma"),
        ("x.wma", "sounds end in .wav", "as x.wav"),
    ),
    "9 a solid misspelt": (
        shell("analyze", "bowel:radius=0.1", "--material", "steel"),
        ("'bowel'", "did you mean bowl", "struck analyze --list"),
    ),
    "10 an argument misspelt": (
        shell("analyze", "tube:len=0.3", "--material", "steel"),
        ("tube:len=0.3", "no len=: did you mean length=", "give tube:length=...,radius="),
    ),
    "11 an unknown unit": (
        shell("analyze", "tube:length=50furlong,radius=1,wall=1", "--material", "steel"),
        ("'50furlong'", "give lengths as", "50cm"),
    ),
    "12 --listener left": (
        shell("render", "b.struck", "--listener", "left"),
        ("--listener", "'left'", "give x,y,z in m"),
    ),
    "13 --room large": (
        shell("render", "b.struck", "--room", "large"),
        ("--room", "'large'", "give x,y,z in m"),
    ),
    "14 listener='left'": (
        lambda: struck.render(model(), struck.Strike(), listener="left"),
        ("listener is 'left'", "one position", "\\(x, y, z\\) in m"),
    ),
    "15 analyse": (shell("analyse", "x"), ("'analyse'", "did you mean analyze", "there are")),
    "16 no body": (lambda: struck.analyze(object(), "steel"), ("object", "no body", "a Mesh")),
    "17 a tuple of no mesh": (
        lambda: struck.analyze((1, 2, 3), "steel"),
        ("tuple|1, 2, 3", "no body|numbers|vertices", "give"),
    ),
    "18 nothing to tune": (
        lambda: struck.tune(BAR, "steel", vary="colour", lowest=880),
        ("vary is 'colour'", "this body has length, width, thickness"),
    ),
    "19 Tube by position": (
        lambda: Tube(0.3, 0.01, 0.001),
        ("0.3 without a name", "give", "Tube\\(length=0.3, radius=0.01, wall=0.001\\)"),
    ),
    "20 Strike by position": (
        lambda: struck.Strike("side"),
        ("'side' without a name", "give", "Strike\\(at='side'\\)"),
    ),
    "21 velocity=": (
        lambda: struck.Strike(velocity=1),
        ("velocity= .*1", "did you mean speed=", "it takes at="),
    ),
    "21 hammer=": (
        lambda: struck.Strike(hammer="wood"),
        ("hammer= .*'wood'", "did you mean striker=", "it takes at="),
    ),
    "22 --strike 0,0": (
        shell("render", "b.struck", "--strike", "0,0"),
        ("contact is 0,0", "three finite numbers", "x, y, z"),
    ),
    "23 a hold alone": (
        lambda: struck.render(model(), struck.Hold(at="top"), seconds=0.1),
        ("1 hold", "nothing that strikes", "at least one strike"),
    ),
    "24 --accuracy high": (
        shell("analyze", "no_file.stl", "--material", "steel", "--accuracy", "high"),
        ("'high'", "one of preview", "fine"),
    ),
    "25 speed of 200 m/s": (
        lambda: hit(striker="steel", speed=200),
        ("200 m/s", "above 100 m/s", "200 cm/s is 2"),
    ),
    "an impulse that is a force": (
        lambda: struck.render(model(), struck.Strike(impulse=5000.0), seconds=0.1),
        ("moves its body at", "above 100 m/s", "forces times the step"),
    ),
    "26 a sound as a model": (
        shell("render", "w.wav"),
        ("w.wav is a sound .WAV. and not a model", "struck fit"),
    ),
    "26 a sound by the name of a model": (
        shell("render", "sound.struck"),
        ("sound.struck", "is a sound .WAV. and not a model", "end its name in .wav", "struck fit"),
    ),
    "a formula of some accuracy": (
        lambda: struck.analyze(BAR, "steel", accuracy="fine"),
        ("accuracy='fine'", "does not apply to a bar", "leave it out"),
    ),
    "a formula of a box that is held": (
        lambda: struck.analyze(BAR, "steel", fixed=((0, 0, 0), (1, 1, 1))),
        ("^fixed= does not apply to a bar", "leave it out, or take method='fem' ?$"),
    ),
    "a formula of held ends and a box": (
        lambda: struck.analyze(
            dataclasses.replace(BAR, ends="clamped"), "steel", fixed=((0, 0, 0), (1, 1, 1))
        ),
        ("does not apply to a bar, which is computed by a formula: leave it out ?$",),
    ),
    "a tension of some accuracy": (
        lambda: struck.analyze(MEMBRANE, "steel", accuracy="fine"),
        ("does not apply to a circular membrane, which is computed by a formula: leave it out ?$",),
    ),
    "supported edges of some accuracy": (
        lambda: struck.analyze(
            RectangularPlate(length=0.3, width=0.2, thickness=0.002, edges="supported"),
            "steel",
            accuracy="fine",
        ),
        ("does not apply to a rectangular plate, which is computed by a formula: leave it out ?$",),
    ),
    "a wall of a bar's elements": (
        lambda: struck.analyze(BAR, "steel", method="fem", wall=0.001, cache=False),
        ("wall= applies to surfaces, and a bar has its own dimensions", "leave it out"),
    ),
    "--hammer": (
        shell("render", "b.struck", "--hammer", "wood"),
        ("'--hammer'", "did you mean --striker", "--help"),
    ),
    "a band of no note": (
        lambda: struck.analyze(BAR, "steel", band=("C3", "H9")),
        ("band is 'H9'", "C-1 to B10", "as A5"),
    ),
    "a band upside down": (
        lambda: struck.analyze(BAR, "steel", band=("C5", "C3")),
        ("band is \\('C5', 'C3'\\)", "in Hz, or notes, the lower first"),
    ),
    "a field of no note": (
        lambda: model().radiating(band=("H1", "C3")),
        ("band is 'H1'", "C-1 to B10", "as A5"),
    ),
    "--wall 2q": (
        shell("analyze", "nut.ply", "--material", "steel", "--wall", "2q"),
        ("--wall", "'2q'", "in m, cm, mm, in, ft, as 5cm"),
    ),
    "--listener in an unknown unit": (
        shell("render", "b.struck", "--listener", "1,0,5q"),
        ("--listener", "'1,0,5q'", "give x,y,z in m, or with units"),
    ),
    "units in the shell": (
        shell("analyze", "nut.ply", "--material", "steel", "--no-cache"),
        ("46 m", "modes below 20000 Hz", "\\(--units mm of a file", "--band 20,"),
    ),
    "a field in the shell": (
        shell("show", "b.struck", "--field", "brightness"),
        ("no timbre field", "compute one with struck radiate, or"),
    ),
    "a mode of an other family in the shell": (
        shell("tune", TUBE, *tuned_by("length"), "--mode", "2"),
        ("lowest is 880", "'mode 2'", "give --frequency of that"),
    ),
    "a mesh to tune": (
        shell("tune", "nut.ply", *tuned_by("length")),
        ("nut.ply", "mesh file", "give a body as bowl:radius=8cm", "at another --size"),
    ),
    "a bowl has no such dimension": (
        shell("tune", "bowl:radius=8cm", *tuned_by("raduis")),
        ("vary is 'raduis'", "did you mean radius", "this body has radius, height, wall"),
    ),
    "an option twice": (
        shell("render", "b.struck", "--striker", "wood", "--striker", "metal"),
        ("--striker", "'wood', and 'metal' too", "give it once"),
    ),
    "a listener twice": (
        shell("render", "b.struck", "--listener", "1,0,0", "--listener=0,1,0"),
        ("--listener", "\\(1.0, 0.0, 0.0\\), and \\(0.0, 1.0, 0.0\\)", "give it once"),
    ),
    "a wall of a body in a scene": (
        shell("simulate", "none.xml", "--wall", "mug*=3q"),
        ("--wall", "'3q' is no length", "give m, or a unit, as mug\\*=3mm"),
    ),
    "--modes many": (
        shell("render", "b.struck", "--modes", "many"),
        ("--modes", "'many'", "whole number of at least 1, or all"),
    ),
    "--seconds long": (
        shell("render", "b.struck", "--seconds", "long"),
        ("--seconds", "'long'", "give a number"),
    ),
    "--rate 44.1k": (
        shell("render", "b.struck", "--rate", "44.1k"),
        ("--rate", "'44.1k'", "give a whole number"),
    ),
    "a body outside its room": (
        shell("render", "b.struck", "--room", "5,4,3", "--position", "6,2,1"),
        ("body at 6, 2, 1 m", "from 0, 0, 0 to 5, 4, 3 m", "move it in"),
    ),
    "a place in no room": (
        shell("render", "b.struck", "--position", "1,2,1"),
        ("--position 1.0,2.0,1.0", "needs a room", "give --room x,y,z"),
    ),
    "--verison": (
        shell("--verison"),
        ("no option '--verison'", "did you mean --version", "give a command: see 'struck --help'"),
    ),
    "--radiation feld": (
        shell("analyze", TUBE, "--material", "steel", "--radiation", "feld"),
        ("'feld'", "did you mean 'field'", "give 'power' or .* or 'field'"),
    ),
    "a block by its edges alone": (
        shell("analyze", "block:10x5x3", "--material", "steel"),
        ("'block:10x5x3' does not describe", "give block:size=0.1,0.05,0.03"),
    ),
    "a block of 10 m": (
        shell("analyze", "block:size=10x5x3", "--material", "steel"),
        ("10 m", "--units mm of a file, and those of a solid are given in m"),
    ),
    "--impulse 0,0,-1": (
        shell("render", "b.struck", "--impulse", "0,0,-1"),
        ("--impulse", "'0,0,-1'", "give a number alone, .*, and which way by --direction x,y,z"),
    ),
    "cls is no argument": (
        lambda: PolygonMembrane.l_shape(size=0.2),
        ("did you mean side=.? it takes side=, thickness=, tension= ?$",),
    ),
    "Rayleigh of 2002": (
        lambda: struck.Rayleigh(alpha1=1e-7, alpha2=1),
        ("no alpha1= .*did you mean stiffness=",),
    ),
    "tan phi": (
        lambda: struck.InternalFriction(tan_phi=1e-3),
        ("did you mean loss_tangent=",),
    ),
    "a name in use elsewhere, misspelt": (
        lambda: struck.Strike(postion="top"),
        ("no postion= .*did you mean at=.? it",),
    ),
    "modes=True": (
        lambda: struck.analyze(BAR, "steel", modes=True),
        ("modes is True: analyze takes a whole number or None",),
    ),
    "part=0": (lambda: struck.analyze(BAR, "steel", part=0), ("part is 0: .* as part='0'",)),
    "an array to fit": (
        lambda: struck.fit(np.zeros(99)),
        ("recordings is .*: fit takes .* an array as Sound\\(samples=array, sample_rate=48000",),
    ),
    "a sound saved as a model": (
        lambda: struck.save(hit(), "a.struck"),
        ("save takes a ModalModel; a Sound has its own save\\(path\\)",),
    ),
    "path and model": (
        lambda: struck.save("a.struck", model()),
        ("model is 'a.struck': .* give it first, and then the path",),
    ),
    "a path to explore": (
        lambda: struck.explore("b.struck"),
        ("explore takes .*, as struck.load\\('b.struck'\\)",),
    ),
    "a law for damping": (
        lambda: struck.analyze(BAR, "steel", damping=struck.Rayleigh(mass=1, stiffness=0)),
        ("takes text, own or heard; a law .* material.damped\\(law\\)",),
    ),
    "a membrane by an unknown method": (
        lambda: struck.analyze(MEMBRANE, "nylon", method="formulas"),
        ("method is 'formulas': did you mean formula",),
    ),
    "memory=1GB": (
        lambda: struck.analyze_many("x.obj", "steel", out="o", memory="1GB"),
        ("memory is '1GB': .* in bytes, as 2e9",),
    ),
    "samples last": (
        lambda: struck.Sound(samples=np.zeros((48000, 2)), sample_rate=48000),
        ("shape \\(48000, 2\\), and channels come first: give samples.T",),
    ),
    "a listener that outruns the sound": (
        lambda: sys.stderr.write(
            struck.render(
                model(),
                struck.Strike(),
                seconds=0.1,
                listener=struck.Mono(position=([0, 0.1], [(1, 0, 0), (90, 0, 0)])),
            ).notes[0]
        ),
        ("moves at up to 890 m/s, and sound at 343.21: .* places are given in m, times in s",),
    ),
    "a drum head of mylar": (
        lambda: sys.stderr.write(f"{Material.named('PET film').density} {Material.named('mylar')}"),
        ("1390.0 .*Mylar polyester film, Physical-Thermal Properties",),
    ),
    "times of another number": (
        lambda: Measured(frequencies=(100, 200), t60=(3,)),
        ("2 frequencies and 1 of t60=", "give as many of both"),
    ),
    "strikes instead of rows": (
        lambda: struck.analyze_many("nut.ply", "steel", out="o", strikes=[struck.Strike()]),
        ("rows of type Strike", "'impulse': 0.01", "function \\(model, generator\\)"),
    ),
    "strikes= of a Body": (
        lambda: struck.Body(model=model(), strikes=[struck.Strike()]),
        ("no strikes=", "did you mean excitations="),
    ),
    "bodies that are no files": (
        lambda: struck.analyze_many([trimesh.creation.box()], "steel", out="o"),
        ("files hold a Trimesh", "give mesh files", "struck.analyze, one by one"),
    ),
    "a function to tune": (
        lambda: struck.tune(lambda radius: bell(radius=radius), "bronze", vary="height", lowest=9),
        ("has no value for radius", "give functools.partial\\(.*radius=...\\)"),
    ),
    "a body that was made to tune": (
        lambda: struck.tune(bell(), "bronze", vary="height", lowest="A5"),
        ("vary is 'height'", "give .*what makes one, as functools.partial"),
    ),
    "bare frequencies": (
        lambda: struck.recordings.calibrated((440.0, 880.0), model()),
        ("fitted is \\(440.0, 880.0\\)", "of struck.fit, or any object with frequencies, decays"),
    ),
    "a strike after the end": (
        lambda: sys.stderr.write(
            struck.render(model(), struck.Strike(time=3), seconds=1).notes[0] + "\n"
        ),
        ("1 of 1 excitations \\(strike\\)", "after the end at 1 s", "give more seconds"),
    ),
}


@pytest.mark.parametrize("name", USES)
def test_a_wrong_use_is_told_its_value_its_bound_and_a_way_out(
    name: str,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(folder)
    call, words = USES[name]
    said: list[object] = []
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        try:
            code = call()
        except struck.errors.StruckError as error:
            said = [error]
    told = capsys.readouterr().err
    if told.startswith("struck:"):
        assert code == 2
        assert told.count("\n") == 1
    text = " ".join([*map(str, said), told, *(str(each.message) for each in warned)])
    for word in words:
        assert re.search(word, text), (word, text)
    assert "Traceback" not in text


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("analyze", (BLOCK, "steel")),
        ("fit", ("w.wav",)),
        ("compare", ("b.struck", "w.wav")),
        ("sound_map", ("b.struck",)),
        ("simulate", ("scene.xml",)),
        ("tune", (BAR, "steel")),
        ("analyze_many", ("nut.ply", "steel")),
    ],
)
def test_progress_is_a_function_or_none(name: str, given: tuple[object, ...], folder: Path) -> None:
    made = tuple(struck.load(folder / each) if each == "b.struck" else each for each in given)
    more = {"tune": {"vary": "length", "lowest": 900}, "analyze_many": {"out": folder / "o"}}
    told = r"progress is 'no': .* takes a function of a stage and the fraction done or None"
    with pytest.raises(struck.errors.OptionError, match=told):
        getattr(struck, name)(*made, **more.get(name, {}), progress="no")


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("Tube", "it is struck.solids.Tube"),
        ("bowl", "it is struck.solids.bowl"),
        ("Bell", "it is struck.solids.bell"),
        ("strike", "it is struck.Strike"),
        ("Plate", "it is struck.shapes.CircularPlate or struck.shapes.RectangularPlate"),
        ("hit", r"did you mean struck\.Strike"),
        ("list", r"it is struck\.materials\(\) of materials"),
        ("radiate", "it is ModalModel.radiating"),
        ("sonic_distanz", r"did you mean struck\.sonic_distance"),
        ("zzz", "see dir"),
    ],
)
def test_a_missing_name_of_struck_is_told_where_it_is(name: str, told: str) -> None:
    with pytest.raises(AttributeError, match=f"struck has no '{name}': {told}"):
        getattr(struck, name)


def test_nouns_are_counted_and_have_their_articles(folder: Path) -> None:
    words = [counted(count, noun) for count in (0, 1, 2) for noun in ("sound", "inner vertex")]
    assert words[:2] == ["0 sounds", "0 inner vertices"]
    assert words[2:] == ["1 sound", "1 inner vertex", "2 sounds", "2 inner vertices"]
    kinds = [article(each) for each in ("WAV", "OGG", "MP3", "AIFF", "Trimesh", "ndarray", "int")]
    assert kinds == ["a WAV", "an OGG", "an MP3", "an AIFF", "a Trimesh", "a ndarray", "an int"]
    for ending in ("ogg", "mp3", "aiff"):
        with pytest.raises(
            struck.errors.FileFormatError, match=rf"is a sound \({ending.upper()}\) and not a model"
        ):
            struck.load(folder / f"x.{ending}")


def test_what_a_model_keeps_of_a_recording_is_told(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = struck.load(folder / "b.struck")
    bands = {"edges": np.array([100.0, 1000.0]), "levels": np.ones(1), "decays": np.ones(1)}
    rest = Residual(attack=np.ones(2400, np.float32), sample_rate=48000, lead=0.0, **bands)
    struck.save(dataclasses.replace(made, residual=rest), folder / "rest.struck")
    assert main(["info", str(folder / "rest.struck")]) == 0
    told = capsys.readouterr().out
    assert f"residual  attack of 0.05 s, and noise after it: {rest.size / 1000:.0f} kB" in told


@pytest.mark.prove
def test_few_pairs_of_two_designs_are_told_to_say_little(folder: Path) -> None:
    made = struck.load(folder / "b.struck")
    stiff = struck.analyze(Bar(length=0.1, width=0.03, thickness=0.005), "steel")
    told = struck.compare(made, stiff, progress=None).summary()
    few = [each for each in told if "by frequency alone" in each]
    assert re.match(rf"caution: {told[0].split(' of ')[0]} by .* see their sonic distance", few[0])
    assert not any("alone" in each for each in struck.compare(made, made).summary())


@pytest.mark.parametrize(
    ("words", "kind"),
    [
        (("compare", "b.struck", "w.wav", "-o", "out.png"), "pages end in .html"),
        (("show", "b.struck", "-o", "out.html"), "pictures end in .png"),
        (("sound-map", "b.struck", "-o", "out.wav"), "pictures end in .png"),
        (("fit", "w.wav", "-o", "new.struck", "--report", "out.png"), "pages end in .html"),
        (("fit", "w.wav", "-o", "out.wav"), "models end in .struck"),
        (("export", "b.struck", "-o", "out.txt"), "files of a model's data end in .sofa, .vtu"),
        (("render", "b.struck", "-o", "out.struck"), "sounds end in .wav"),
        (("simulate", "no_scene.xml", "-o", "out.png"), "sounds end in .wav"),
        (("analyze", TUBE, "--material", "steel", "-o", "out.html"), "models end in .struck"),
        (("radiate", "b.struck", "-o", "out.wav"), "models end in .struck"),
    ],
)
def test_outputs_have_the_endings_of_their_kind(
    words: tuple[str, ...],
    kind: str,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(folder)
    before = set(folder.iterdir())
    assert main(words) == 2
    assert kind in capsys.readouterr().err
    assert set(folder.iterdir()) == before


def forms(solid: trimesh.Trimesh) -> dict[str, object]:
    """Return one surface as other libraries and people hold it."""
    points, faces = np.array(solid.vertices), np.array(solid.faces)
    row = np.insert(faces, 0, 3, axis=1).ravel()
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    corners = np.array([[x, y, z] for x in (0, 0.1) for y in (0, 0.05) for z in (0, 0.03)])
    return {
        "trimesh": solid,
        "pair": (points, faces),
        "lists": (points.tolist(), faces.tolist()),
        "open3d": SimpleNamespace(vertices=points, triangles=faces),
        "pyvista": SimpleNamespace(points=points, faces=row),
        "pyvista of quads": SimpleNamespace(
            points=corners, faces=np.ravel([[4, *each] for each in quads])
        ),
    }


def source_of(body: object, **given: object) -> object:
    """Return what is filled with elements, before that takes time."""
    stages = Stages(cache=None, progress=silent)
    file = FileOptions(**given)
    return discretise(body, file, stages, wall=None, accuracy="preview", repair=True)


def test_surfaces_of_other_libraries_are_one_body() -> None:
    for name, body in forms(trimesh.creation.box((0.1, 0.05, 0.03))).items():
        source = source_of(body)
        assert source.outline.volume == pytest.approx(0.1 * 0.05 * 0.03), name
        assert np.ptp(source.outline.bounds, axis=0) == pytest.approx([0.1, 0.05, 0.03]), name
        assert len(source.outline.faces) == 12, name
        assert source.units == "m, as none were given", name


def test_units_that_were_taken_are_told(folder: Path) -> None:
    ball, box = folder / "nut.ply", trimesh.creation.box((100, 50, 30))
    for body, given, told in (
        (ball, {"units": "mm"}, "mm"),
        (ball, {"size": 0.1}, "scaled to a size of 0.1 m"),
        (ball, {}, "m, as none were given"),
        ((box.vertices, box.faces), {"units": "mm"}, "mm"),
        (struck.model.Mesh(points=box.vertices / 1000, faces=box.faces), {}, "m"),
    ):
        assert source_of(body, **given).units == told
    box.units = "mm"
    assert source_of(box).units == "mm, its own"
    assert source_of(box).outline.extent == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (([[0, 0, 0]], [[0, 1, "x"]]), "faces: .* holds what is no number"),
        ((np.zeros((4, 3)), [[0, 1, 2, 3]]), r"faces have shape \(1, 4\), not \(F, 3\)"),
        (("steel", "box"), "vertices: 'steel' holds what is no number"),
        (
            SimpleNamespace(points=np.zeros((3, 3)), faces=[3, 0, 1]),
            "row of 3 numbers, and 3 at 0 is no count",
        ),
        (
            SimpleNamespace(points=np.zeros((3, 3)), faces=[0, 3, 0, 1, 2]),
            "row of 5 numbers, and 0 at 0 is no count",
        ),
        (
            ([[0, 1, 2]], np.full((3, 3), 0.1)),
            r"\(1, 3\), and faces \(3, 3\) with fractions.*these may be swapped",
        ),
        ((np.zeros((3, 3)),), r"tuple is no body: give .* \(vertices, faces\)"),
    ],
)
def test_what_is_no_surface_of_another_library_is_refused(body: object, words: str) -> None:
    with pytest.raises(struck.errors.MeshError, match=words):
        struck.analyze(body, "steel", cache=False)


def test_27_a_model_that_has_sounded_is_copied_and_pickled(folder: Path) -> None:
    made = struck.load(folder / "b.struck")
    before = struck.render(made, struck.Strike(), seconds=0.1)
    for again in (pickle.loads(pickle.dumps(made)), copy.deepcopy(made)):  # noqa: S301 - our own
        after = struck.render(again, struck.Strike(), seconds=0.1)
        assert np.array_equal(after.samples, before.samples)


def test_progress_is_a_line_after_two_and_each_ten_seconds_without_a_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = [0.0]
    monkeypatch.setattr(provenance.time, "monotonic", lambda: clock[0])
    told = provenance.reported(provenance.shown)
    for second in range(36):
        clock[0] = float(second)
        told("iterate", second / 100)
    lines = capsys.readouterr().err.splitlines()
    assert lines == [f"struck: iterate {n:3} %, about {100 - n} s left" for n in (2, 12, 22, 32)]
    provenance.reported(None)("iterate", 0.9)
    clock[0] = 100.0
    struck.analyze(BAR, "steel", progress=None)
    assert capsys.readouterr().err == ""
    assert provenance.reported(silent) is silent


def test_progress_is_a_bar_in_notebooks(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    states: list[dict[str, str]] = []

    def display(state: dict[str, str], **_: object) -> SimpleNamespace:
        states.append(state)
        return SimpleNamespace(update=lambda state, **_: states.append(state))

    shell = SimpleNamespace(kernel=object())
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))
    monkeypatch.setitem(sys.modules, "IPython.display", SimpleNamespace(display=display))
    block = Block(size=(0.1, 0.05, 0.03), elements=(2, 1, 1))
    struck.analyze(block, "steel", cache=False)
    assert len(states) > 2
    assert states[0]["text/html"].startswith('<progress value="0.000"></progress> cutting the')
    before = len(states)
    struck.analyze(block, "steel", cache=False, progress=None)
    shell.kernel = None  # IPython on a terminal
    struck.analyze(block, "steel", cache=False)
    assert len(states) == before
    assert capsys.readouterr().err == ""


def test_products_use_one_thread_unless_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def threads() -> set[int]:
        return {each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"}

    block = Block(size=(0.1, 0.05, 0.03), elements=(2, 1, 1))
    with threadpool_limits(3, user_api="blas"):
        for told, most in ((None, {1}), ("2", {2})):
            monkeypatch.delenv("STRUCK_THREADS", raising=False)
            if told:
                monkeypatch.setenv("STRUCK_THREADS", told)
            seen: set[int] = set()
            struck.analyze(
                block, "steel", cache=False, progress=lambda *_, seen=seen: seen.update(threads())
            )
            assert seen == most
            assert threads() == {3}
    assert thread_count() == 2
    for wrong in ("many", "0", "-1", "1.5"):
        monkeypatch.setenv("STRUCK_THREADS", wrong)
        with pytest.raises(struck.errors.OptionError, match=f"STRUCK_THREADS is '{wrong}': set"):
            struck.analyze(block, "steel", cache=False)


def test_notes_and_times_stand_for_frequencies_and_decays(folder: Path) -> None:
    made = struck.load(folder / "b.struck")
    for note, hertz in (
        ("A5", 880.0),
        ("A5+12c", 880 * 2**0.01),
        ("880", 880.0),
        ("Bb3", 233.0819),
    ):
        assert made.tuned(lowest=note).frequencies[0] == pytest.approx(hertz, rel=1e-6)
    times = Measured(frequencies=("A3", "A5"), t60=(2.0, 1.0))
    assert times == Measured(frequencies=(220.0, 880.0), rates=tuple(np.log(1000) / [2.0, 1.0]))


def test_the_shell_alone_shows_its_help_and_its_version(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main([]) == 0
    assert "analyze-many" in capsys.readouterr().out
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"struck {struck.__version__}\n"


def test_a_folder_closed_to_writing_is_named(folder: Path) -> None:
    made, sound = struck.load(folder / "b.struck"), struck.Sound.load(folder / "w.wav")
    # In a place that all may enter, as pytest's own is not.
    with tempfile.TemporaryDirectory() as name, closed_to_writing(Path(name)) as closed:
        for call in (
            lambda: struck.save(made, closed / "b.struck"),
            lambda: sound.save(closed / "w.wav"),
            lambda: struck.files.save_set({"a": sound}, closed),
        ):
            with pytest.raises(struck.errors.FileFormatError, match=r"allows no new files.* give"):
                call()
        assert not list(closed.iterdir())


@pytest.mark.prove
def test_a_list_into_a_closed_pipe_is_no_traceback() -> None:
    line = f"{sys.executable} -m struck analyze --list | true"
    done = subprocess.run(["/bin/sh", "-c", line], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_body_without_damping_rings_endlessly() -> None:
    stiff = Material(density=7850, youngs_modulus=2e11, poisson_ratio=0.29)
    assert np.isfinite(struck.analyze(BAR, stiff, band=(20, 3000)).t60).all()  # by the air
    made = struck.analyze(BAR, stiff, band=(20, 3000), air=False)
    assert np.isposinf(made.t60).all()
    assert made._repr_html_().count("endless") == 2 * len(made.t60)
    found = struck.compare(made, struck.analyze(BAR, "steel", band=(20, 3000)), progress=None)
    assert found.summary()
    assert struck.render(made, struck.Strike(), seconds=0.1).peak > 0
    assert struck.sonic_distance(made, made) == 0
    assert made.damped(struck.InternalFriction(loss_tangent=1e-300)).t60.min() > 1e290


def test_models_and_what_they_hold_are_told_in_a_line(folder: Path) -> None:
    made = struck.load(folder / "b.struck")
    count = len(made.frequencies)
    told = rf"<ModalModel: {count} modes from \d+ to \d+(\.\d+)? Hz, steel, 1.18 kg>"
    assert re.fullmatch(told, repr(made))
    points, faces = made.geometry.points.shape, made.geometry.faces.shape
    assert repr(made.geometry) == f"Mesh(points=array {points}, faces=array {faces}, up='z')"
    sound = struck.Sound(samples=np.zeros((2, 999)), sample_rate=8000)
    assert repr(sound) == (
        "Sound(samples=array (2, 999), sample_rate=8000, calibrated=False, notes=())"
    )
    assert re.search(r"shapes=array \(\d+, 3, \d+\).*, centre=\[", repr(made.gains))


def held() -> list[type]:
    """Return the public dataclasses with arrays among their fields."""
    classes = [each for each in public().values() if dataclasses.is_dataclass(each)]
    told = {each: {str(field.type) for field in dataclasses.fields(each)} for each in classes}
    return [each for each in classes if re.search(r"Array\b|Index|Complex", " ".join(told[each]))]


def test_no_public_class_prints_its_arrays() -> None:
    assert len(held()) > 20
    generated = [each for each in held() if hasattr(each.__repr__, "__wrapped__")]
    assert not generated  # by dataclass, whose own prints all


MADE_BY_US = {  # what people are given, and do not make themselves
    *("BatchReport", "BatchRow", "Calibration", "CapturePlan", "Comparison", "Device", "Events"),
    *("Explorer", "Exponentials", "Fitting", "Gains", "Heuristic1998", "Manifest", "PoleFit"),
    *("MeasuredHead", "MeshPart", "ModalModel", "Modes", "MujocoRecorder", "ObrienCoupling"),
    *("Player", "PortAudio", "Provenance", "Push", "Residual", "ShapeGains", "Shape", "SoundMap"),
    *("SurveyPlan", "TimbreField", "TimbreTable"),
}


def asked() -> dict[str, Callable[..., object]]:
    """Return the public functions and classes that people call with arguments."""
    found = {}
    for name, value in public().items():
        owner = name.split(".")[-2]
        protocol = getattr(value, "_is_protocol", False) or (
            isinstance(value, type) and issubclass(value, Exception)
        )
        if owner[0].isupper() or protocol or name.split(".")[-1] in MADE_BY_US:
            continue
        if inspect.signature(value).parameters and name.split(".")[-1] not in HAND_ON:
            found[name] = value
    return found


# What they hand on is answered by another name, once what they need is given.
HAND_ON = {
    "Simulation": {"file": "scene.xml"},
    "analyze_many": {"files": "x.obj", "material": "steel", "out": "out"},
    "simulate": {"file": "scene.xml"},
    "tune": {"body": BAR, "material": "steel", "vary": "length", "lowest": 900.0},
}


def test_an_unknown_keyword_is_answered_with_those_there_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert len(asked()) > 80
    bare = []
    for name, call in asked().items():
        try:
            call(no_such_thing=1)
        except struck.errors.ArgumentError as error:
            bare += [] if "no_such_thing= " in str(error) else [(name, str(error))]
        except Exception as error:  # noqa: BLE001 - any other is what is looked for
            bare.append((name, repr(error)))
    assert not bare
    Path("scene.xml").write_text("<mujoco/>", encoding="utf-8")
    for name, given in HAND_ON.items():
        call = getattr(struck, name, struck.scene.Simulation)
        with pytest.raises(struck.errors.OptionError, match="no_such_thing"):
            call(**given, no_such_thing=1)
    with pytest.raises(struck.errors.ArgumentError, match="given speed=, load=: it takes path=,"):
        struck.Scrape(path=[(0.0, 0.0, 0.0), (0.1, 0.0, 0.0)])
    with pytest.raises(struck.errors.ArgumentError, match=r"simulate has no wall= .* mean walls="):
        struck.simulate("scene.xml", wall=0.003)
    with pytest.raises(struck.errors.ArgumentError, match="did you mean threshold_db="):
        struck.sound_map(None, threshold=3)
    with pytest.raises(struck.errors.ArgumentError, match=r"InternalFriction\(loss_tangent=0.01\)"):
        struck.analyze(BAR, "steel", band=(20, 3000)).damped(0.01)


def test_formulas_refuse_what_they_do_not_use_also_at_its_usual_value() -> None:
    for name, value in {"accuracy": "standard", "repair": True, "backend": "auto"}.items():
        with pytest.raises(struck.errors.OptionError, match=f"{name}=.* does not apply to a bar"):
            struck.analyze(BAR, "steel", **{name: value})


def test_given_elements_refuse_what_chooses_elements() -> None:
    block = struck.solids.Block(size=(0.05, 0.03, 0.02), elements=(2, 1, 1))
    for body in (block, block.volume_mesh()):
        with pytest.raises(struck.errors.OptionError, match="brings its own: leave one of them"):
            struck.analyze(body, "steel", accuracy="preview")
        with pytest.raises(struck.errors.OptionError, match="repair= applies to surfaces"):
            struck.analyze(body, "steel", repair=True)


def test_the_shell_names_its_own_options_in_errors(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    assert main(["export", "b.struck", "-o", "x.sofa"]) == 2
    told = capsys.readouterr().err
    assert "give --contacts, as names" in told
    assert "--listeners, as x, y, z in m" in told


def test_which_axis_is_up_is_told_with_its_reason(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    box = trimesh.creation.box((0.1, 0.05, 0.03))
    for ending, given, told in (
        ("obj", {}, "y, as usual in OBJ, GLTF, GLB files"),
        ("stl", {}, "z, as usual in STL, PLY, OFF files"),
        ("obj", {"up": "x"}, "x, as given"),
    ):
        box.export(folder / f"box.{ending}")
        source = source_of(folder / f"box.{ending}", units="m", **given)
        assert source.up == told
        assert source.outline.up == told[0]
    assert source_of(box).up == "z, as none was given"
    assert source_of(box, up="y").up == "y, as given"
    made = struck.load(folder / "b.struck")
    provenance = made.provenance.extended(up="y, as usual in OBJ files")
    struck.save(dataclasses.replace(made, provenance=provenance), folder / "up.struck")
    monkeypatch.chdir(folder)
    for file, told in (("up.struck", "y, as usual in OBJ files: "), ("b.struck", "z: ")):
        assert main(["info", file]) == 0
        (line,) = re.findall("^up .*", capsys.readouterr().out, re.MULTILINE)
        assert line.startswith(f"up        {told}it says where top is")
        assert ("--up" in line) == (file == "up.struck")


def test_info_begins_with_what_is_asked_first_and_counts_its_modes(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)

    def told(*words: str) -> str:
        assert main(["info", "b.struck", *words]) == 0
        return capsys.readouterr().out

    first = told().splitlines()
    assert len(first) <= 24  # lines of a terminal
    for word in ("material", "mass", "size", "loudest", "top", "Hz"):
        assert any(line.startswith(word) for line in first), word
    assert not any(line.startswith(("method", "+x")) for line in first)
    whole = told("--all")
    assert len(re.findall(r"^\d+\.\d\d ", whole, re.MULTILINE)) == len(model().decays)
    assert "\nmethod" in whole
    assert "\n+x" in whole
    three, every = (json.loads(told("--json", *words)) for words in (("--modes", "3"), ()))
    for name in ("frequencies", "decays", "errors"):
        assert three[name] == every[name][:3]
        assert len(every[name]) == len(model().decays)
    assert len(every["levels"]) == len(every["places"]) + 1
    assert main(["info", "b.struck", "--modes", "-1"]) == 2


def test_quiet_commands_tell_no_progress(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    monkeypatch.setattr(provenance, "_FIRST_DELAY", 0.0)  # s until a first line
    words = ["render", "b.struck", "--seconds", "0.1", "-o", "quiet.wav"]
    assert main(words) == 0
    assert capsys.readouterr().err == "struck: computing the sound\n"
    assert main([*words, "--quiet"]) == 0
    assert capsys.readouterr().err == ""


def test_options_that_nothing_uses_are_told() -> None:
    model = struck.analyze(Bar(length=0.3, width=0.03, thickness=0.005), "steel")
    with pytest.raises(struck.errors.OptionError, match="0 of 1 bodies have"):
        struck.render(model, struck.Strike(), listener=struck.Stereo(field="ears"), seconds=0.01)
    for roughness, told in (("wood", 1), (None, 0)):
        body = struck.Body(model=model, excitations=struck.Strike(), roughness=roughness)
        for given in (body, [body, body], struck.scene.Scene(bodies={"bar": body})):
            notes = struck.render(given, seconds=0.01).notes
            assert sum("'wood' of a Body changes" in each for each in notes) == told
    with pytest.raises(struck.errors.OptionError, match=r"models end in \.struck, as m\.struck"):
        struck.save(model, "m.wav")


@pytest.mark.prove
def test_a_body_of_a_surface_in_memory_is_chosen() -> None:
    far = trimesh.creation.box((0.05, 0.03, 0.02)).apply_translation((0.3, 0, 0))
    both = trimesh.util.concatenate([trimesh.creation.box((0.1, 0.05, 0.02)), far])
    mesh = struck.Mesh(points=both.vertices, faces=both.faces, up="y")
    for part, extent in (("0", 0.1), ("1", 0.05)):
        chosen = part_of(mesh, part)
        assert (chosen.extent, chosen.up) == (pytest.approx(extent), "y")
    model = struck.analyze(both, "steel", part="1", accuracy="preview")
    assert model.geometry is not None
    assert model.geometry.extent == pytest.approx(0.05)
    for body in (both, (both.vertices, both.faces), mesh):
        with pytest.raises(struck.errors.MeshError, match="no part '2': give one of '0', '1'"):
            struck.analyze(body, "steel", part="2")
    for other in (trimesh.Scene([far]), trimesh.PointCloud(far.vertices)):
        with pytest.raises(struck.errors.MeshError, match=r"is no body: .* Scene its .to_mesh\(\)"):
            struck.analyze(other, "steel")
