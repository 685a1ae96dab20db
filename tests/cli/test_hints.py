"""Hints of the shell: options, commands, bodies and files that are typed as a newcomer would."""

from __future__ import annotations

import gzip
import json
import re
from pathlib import Path

import pytest
import trimesh
from scipy.io import wavfile

import struck
from struck.cli import _COMMAND_MEANINGS, _OPTION_MEANINGS, COMMANDS, Parser, declare, main
from struck.cli.options import body_named
from struck.errors import _SYNONYMS, COUNTED, OptionError, nearest
from struck.files.messages import FORMATS, READERS
from struck.files.recognition import _NAMES, kind_by_content, list_readable
from struck.shapes import Bar, CircularPlate, RoundSection
from struck.solids import Tube
from struck.solids.revolution import bell

TUBE = "tube:length=50cm,diameter=25mm,wall=1mm"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def computed(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("computed") / "bar.struck"
    body = "bar:length=0.3,width=0.03,thickness=0.005"
    assert main(["analyze", body, "--material", "steel", "-o", str(path)]) == 0
    return path.read_bytes()


@pytest.fixture
def bar(folder: Path, computed: bytes) -> str:
    (folder / "bar.struck").write_bytes(computed)
    return "bar.struck"


NUMBER = f"give a mode's number, up to 12, or brightness; {COUNTED}"
HINTS = {
    "render bar.struck --hit end": "did you mean --strike?",
    "render bar.struck --gain 3": "did you mean --level?",
    "render bar.struck --volume 3": "did you mean --level?",
    "render bar.struck --loudness 3": "did you mean --level?",
    "render bar.struck --loud 3": "did you mean --level?",
    "render bar.struck --channels 2": "did you mean --stereo?",
    "render bar.struck --quality high": "did you mean --accuracy of struck analyze?",
    "render bar.struck --length 3": "did you mean --seconds?",
    "render bar.struck --time 3": "did you mean --seconds?",
    "render bar.struck --hammer wood": "did you mean --striker?",
    "render bar.struck --velocity 1": "did you mean --speed?",
    "render bar.struck --binaural": "did you mean --hrtf?",
    "render bar.struck --rt60 1": "did you mean --reverberation?",
    "render bar.struck --material steel": "--material is an option of struck analyze",
    "render bar.struck --accuracy fine": "--accuracy is an option of struck analyze",
    "render bar.struck --midi song.mid": "did you mean --strikes TABLE",
    "render bar.struck --strikr end": "did you mean --striker?",
    "analyze box.stl --quality high": "did you mean --accuracy?",
    "analyze box.stl --preview": "did you mean --accuracy preview?",
    "analyze box.stl --fast": "did you mean --accuracy preview?",
    "analyze box.stl --thickness 1mm": "did you mean --wall?",
    "analyze box.stl --length 1": "did you mean --size?",
    "info bar.struck --csv": "did you mean --json, a result for machines?",
    "tune bar:length=1 --material ice --vary length --pitch A4": "did you mean --lowest?",
    "list": "did you mean materials (of materials) or analyze --list (of bodies)?",
    "analyse box.stl": "did you mean analyze? there are",
    "strike bar.struck": "did you mean render?",
    "plot bar.struck": "did you mean show?",
    "batch": "did you mean analyze-many?",
    "materials stel": "material is 'stel': did you mean steel?",
    "tune bar:length=1,width=1cm,thickness=1mm --material steel --vary length --note C4,D4": (
        "it is 'C4,D4': one body is tuned at a time, so run struck tune once for each note, as C4"
    ),
    "analyze tube:length=1,diameter=3cm,radius=1cm,wall=1mm --material steel": (
        "radius is 0.01 and diameter is 0.03: give one of the two"
    ),
    "analyze bar:length=1,diameter=1cm --material steel": (
        "it has no diameter=: a round bar is rod:length=...,radius=...; else give bar:length=..."
    ),
    "show bar.struck --field 0": f"--field is 0: {NUMBER}",
    "show bar.struck --field 13": f"--field is 13: {NUMBER}",
    "show bar.struck --field brigth": "--field is brigth: did you mean brightness? give a mode",
    "show bar.struck --modes 0": f"it is '0': give a whole number; {COUNTED}",
    "info bar.struck --modes 0": COUNTED,
    "tune bar:length=1,width=1cm,thickness=1mm --material steel --vary length --frequency A4 "
    "--mode 0": COUNTED,
    "render bar.struck --stereo --hrtf kemar": "--hrtf kemar has two ears already: leave out --st",
    "render bar.struck --facing 1,0,0": "--facing needs two ears: give --stereo, --hrtf kemar",
    # Files of other kinds.
    "info chair.fbx": "chair.fbx is a scene of meshes (FBX), which struck does not read: open",
    "render chair.fbx": "chair.fbx is a scene of meshes (FBX), which struck does not read: open it",
    "analyze chair.fbx --material ice": "it is a scene of meshes (FBX), which struck does not read",
    "analyze fbx.obj --material ice": "fbx.obj: its content is FBX and not OBJ: open it in a 3D",
    "info fbx.obj": "fbx.obj is a scene of meshes (FBX), which struck does not read",
    "info fbx.struck": "fbx.struck is a scene of meshes (FBX), which struck does not read",
    "info t.bdf": "t.bdf is a volume mesh (Nastran), which struck does not read: write the volume",
    "analyze t.bdf --material ice": "it is a volume mesh (Nastran), which struck does not read",
    "analyze t.inp.gz --material ice": "(Abaqus or CalculiX), and those are read unpacked alone",
    "render x.gltf": "x.gltf is a mesh (glTF) and not a model: struck analyze makes a model of it",
    "render x.struck": "is a mesh (glTF) and not a model: end its name in .gltf; struck analyze",
    "render box.stl": "box.stl is a mesh (STL) and not a model: struck analyze makes a model of it",
    "render w.wav": "w.wav is a sound (WAV) and not a model: struck fit makes a model of rec",
    "info bar.struck.gz": "bar.struck.gz is packed (gzip), and models are read unpacked alone",
    "render gz.struck": "gz.struck is packed (gzip), and models are read unpacked alone: unpack it",
    "render box.obj.gz": "is a mesh (OBJ) and not a model: struck analyze makes a model of it",
    "info gz.dat": "gz.dat is a packed file (gzip), which struck does not read: unpack it",
    "info glb.bin": "glb.bin: its content is GLB: end its name in .glb",
    "analyze glb.bin --material ice": "glb.bin: its content is GLB: end its name in .glb",
    "analyze bar.bin --material ice": "bar.bin: it is a model (struck) and not a mesh: struck info",
    "analyze bar.wav --material ice": "bar.wav: it is a model (struck) and not a mesh: struck info",
    "info x.qqq": "x.qqq ends in '.qqq', and its content is of no kind that is read: struck reads",
    "info none": "none has no ending, and its content is of no kind that is read: struck reads",
    "info missing.qqq": "missing.qqq is missing, there is no file of that name",
    "fit chair.fbx": "chair.fbx is a scene of meshes (FBX), which struck does not read: open",
    "simulate x.gltf": "x.gltf is a mesh (glTF) and not a scene: struck analyze makes a model",
    "simulate chair.fbx": "chair.fbx is a scene of meshes (FBX), which struck does not read",
}


@pytest.fixture
def files(folder: Path, bar: str) -> None:
    assert bar
    for name in ("chair.fbx", "fbx.obj", "fbx.struck"):
        (folder / name).write_bytes(b"Kaydara FBX Binary  \0\x1a\0" + bytes(100))
    for name in ("x.gltf", "x.struck"):
        (folder / name).write_text('{"asset": {"version": "2.0"}}')
    for name in ("x.qqq", "none", "t.bdf", "t.inp.gz"):
        (folder / name).write_text("hello")
    for name in ("bar.bin", "bar.wav"):
        (folder / name).write_bytes((folder / bar).read_bytes())
    for name in ("bar.struck.gz", "gz.struck", "gz.dat", "box.obj.gz"):
        (folder / name).write_bytes(gzip.compress((folder / bar).read_bytes()))
    trimesh.creation.box((0.1, 0.05, 0.03)).export("box.stl")
    trimesh.creation.box((0.1, 0.05, 0.03)).export("glb.bin", file_type="glb")
    wavfile.write("w.wav", 8000, trimesh.creation.box().vertices.astype("float32"))


@pytest.mark.usefixtures("files")
@pytest.mark.parametrize("words", HINTS)
def test_what_was_typed_is_answered_by_what_was_meant(
    words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        code = main(words.split())
    except OptionError as error:
        pytest.fail(str(error))
    told = capsys.readouterr().err.splitlines()[-1]
    assert code == 2
    assert HINTS[words] in told
    assert "e+" not in told


@pytest.mark.usefixtures("files")
@pytest.mark.parametrize("words", ["info x.qqq", "render chair.fbx", "info t.bdf", "render w.wav"])
def test_all_formats_that_are_read_are_listed(
    words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words.split()) == 2
    told = capsys.readouterr().err
    assert list_readable() in told
    assert all(re.search(rf"\b{name}\b", told) for name in FORMATS)
    assert all(re.search(rf"\b{name[1:]}\b", told) for name in READERS)


def test_info_and_analyze_list_the_same_meshes(capsys: pytest.CaptureFixture[str]) -> None:
    Path("t.med").write_text("hello")
    for words in ("info t.med", "analyze t.med --material ice"):
        assert main(words.split()) == 2
        assert list_readable(meshes=True) in capsys.readouterr().err


def test_what_is_read_is_called_unread_nowhere() -> None:
    read = {f".{name}" for name in FORMATS} | set(READERS)
    groups = {name: group for name, (_, group) in _NAMES.items()}
    assert {groups[name] for name in read} == {"surface", "volume"}
    assert kind_by_content(b"") is None
    assert kind_by_content(b"plain text") is None


def options_of(command: str) -> set[str]:
    parser = Parser(prog="struck")
    declare(parser, command)
    return {name.lstrip("-") for name in parser._option_string_actions}


def test_each_hint_leads_to_what_exists() -> None:
    every = {name: options_of(name) for name in COMMANDS}
    for needed, text in _OPTION_MEANINGS.values():
        assert any(needed in options for options in every.values())
        assert (named := re.findall(r"--([\w-]+)", text))
        for options in every.values():
            assert needed not in options or set(named) <= options
    for meant in _COMMAND_MEANINGS.values():
        for command, option in re.findall(r"(?:^| or )([\w-]+)(?: --([\w-]+))?", meant):
            if not command.startswith("-"):
                assert command in COMMANDS
                assert not option or option in every[command]
    for word, names in _SYNONYMS.items():
        for options in every.values():
            offered = re.findall(r"--([\w-]+)", nearest(word, options, "--{}"))
            assert set(offered) <= options
        assert names


def test_diameters_are_understood() -> None:
    assert body_named(TUBE) == Tube(length=0.5, radius=0.0125, wall=0.001)
    section = RoundSection(radius=0.005)
    assert body_named("rod:length=1,diameter=1cm") == Bar(length=1.0, section=section, ends="free")
    plate = CircularPlate(radius=0.1, thickness=0.001)
    assert body_named("circular-plate:diameter=20cm,thickness=1mm") == plate
    assert body_named("bell:height=0.6,diameter=0.76") == bell(height=0.6, radius=0.38)
    with pytest.raises(OptionError, match="radius is 'wide': give lengths"):
        body_named("tube:length=1,diameter=wide,wall=1mm")


def test_materials_are_listed_by_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["materials", "oak", "steel"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[1:3]] == ["oak", "steel"]
    assert lines[3] == f"oak: {struck.materials()['oak']['source']}"
    assert main(["materials", "stainless", "steel", "--json"]) == 0
    assert list(json.loads(capsys.readouterr().out)) == ["stainless steel"]


def test_stereo_is_two_ears(bar: str) -> None:
    common = ["--listener", "0.5,0.5,0", "--seconds", "0.1"]
    for name, ears in {"one": ["--stereo"], "other": ["--head", "exact"]}.items():
        assert main(["render", bar, *ears, *common, "-o", f"{name}.wav"]) == 0
    (_, one), (_, other) = wavfile.read("one.wav"), wavfile.read("other.wav")
    assert one.shape == (4800, 2)
    assert (one == other).all()


def test_a_note_is_tuned(capsys: pytest.CaptureFixture[str]) -> None:
    body = "bar:length=30cm,width=3cm,thickness=5mm"
    words = ["--material", "steel", "--vary", "length", "--json"]
    for option in ("--note", "--lowest"):
        assert main(["tune", body, *words, option, "A4"]) == 0
    one, other, _ = capsys.readouterr().out.split("}\n")
    assert json.loads(f"{one}}}") == json.loads(f"{other}}}")
    assert json.loads(f"{one}}}")["frequency"] == pytest.approx(440, rel=1e-6)


def boxes(*offsets: tuple[float, float, float], name: str) -> None:
    scene = trimesh.Scene()
    for number, offset in enumerate(offsets):
        box = trimesh.creation.box((0.1, 0.1, 0.1 + 0.02 * number))
        scene.add_geometry(box.apply_translation(offset), geom_name=f"part {number}")
    scene.export(name)


TAKEN = {
    "apart": ((0, 0, 0), (0.5, 0, 0), (0, 0.5, 0)),
    "overlapping": ((0, 0, 0), (0.05, 0.01, 0), (0.1, 0.02, 0)),
    "two of three": ((0, 0, 0), (0.05, 0.01, 0), (0.5, 0.5, 0)),
}


@pytest.mark.parametrize("name", TAKEN)
def test_info_says_which_parts_analyze_takes(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    boxes(*TAKEN[name], name="parts.glb")
    assert main(["info", "parts.glb", "--json"]) == 0
    parts = json.loads(capsys.readouterr().out)["parts"]
    taken = {part["name"] for part in parts if part["taken"]}
    mesh = struck.files.load_body("parts.glb").mesh
    volumes = [part["volume"] for part in parts if part["taken"]]
    assert max(volumes) * 0.999 <= mesh.volume <= sum(volumes) * 1.001
    assert (mesh.volume > 1.01 * max(volumes)) == (len(taken) > 1)
    count = {"apart": 1, "overlapping": 3, "two of three": 2}[name]
    assert len(taken) == count
    assert main(["info", "parts.glb"]) == 0
    told = capsys.readouterr().out
    says = {1: "takes part 2, the largest; --part", 3: "takes all as one body", 2: "takes 2 parts"}
    assert says[count] in told
    assert len(re.findall(r" taken$", told, re.MULTILINE)) == count


LINK = """<link name="{}">
<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>
</link>"""
WELDED = f"""<robot name="arm">{LINK.format("fore")}{LINK.format("tool")}
<joint name="w" type="fixed"><parent link="fore"/><child link="tool"/><origin xyz="0 0 0.1"/>
</joint></robot>"""


def test_a_welded_tool_is_told_why_it_has_no_material(
    capsys: pytest.CaptureFixture[str],
) -> None:
    pytest.importorskip("mujoco")
    Path("arm.urdf").write_text(WELDED)
    words = ["simulate", "arm.urdf", "--seconds", "0.01", "--material", "tool=steel", "-o", "a.wav"]
    assert main(words) == 2
    told = capsys.readouterr().err
    assert "names 'tool', and 'tool' is welded to 'fore': the two ring as one" in told


def test_info_describes_a_volume_mesh(capsys: pytest.CaptureFixture[str]) -> None:
    meshio = pytest.importorskip("meshio")
    points = [(0, 0, 0), (0.2, 0, 0), (0, 0.3, 0), (0, 0, 0.5)]
    meshio.Mesh(points, [("tetra", [[0, 1, 2, 3]])]).write("t.vtu")
    assert main(["info", "t.vtu", "--units", "mm"]) == 0
    told = capsys.readouterr().out.splitlines()
    assert told[0] == "1 element of kind tet4 on 4 nodes"
    assert told[1] == "size      0.0002 x 0.0003 x 0.0005 m"
    assert main(["info", "t.vtu", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["volume"] == pytest.approx(0.005)


PLAIN = (
    "info bar.struck",
    "info bar.struck --all",
    "materials",
    "analyze --list",
    "render bar.struck --impulse 1e-9 --seconds 0.1",
    "render bar.struck --striker steel --speed 90 --seconds 0.1",
    "render bar.struck --strike 0.1,0,0.004 --seconds 0.1 --level absolute",
    "compare bar.struck bar.struck --at end --against middle",
    "sound-map bar.struck --threshold 20",
    "tune bar:length=30cm,width=3cm,thickness=5mm --material rosewood --vary thickness --note A6",
    "analyze block:size=1,1,1 --material density=7850,youngs_modulus=2e5,poisson_ratio=0.3",
    "analyze bar:length=900,width=0.03,thickness=0.005 --material steel",
    "cache",
)


@pytest.mark.parametrize("words", PLAIN)
def test_no_command_writes_powers_of_ten_where_none_is_needed(
    words: str, bar: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert bar
    assert main(words.split()) in {0, 2}
    captured = capsys.readouterr()
    assert not re.search(r"\de\+\d", captured.out + captured.err)


def test_pictures_count_modes_from_1(bar: str) -> None:
    assert main(["export", bar, "-o", "bar.vtu"]) == 0
    first = struck.load(bar).frequencies[0]
    assert f"mode 01 ({first:.2f} Hz)" in Path("bar.vtu").read_text(errors="replace")
    assert "mode 00" not in Path("bar.vtu").read_text(errors="replace")
