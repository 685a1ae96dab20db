from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import soundfile
from scipy.spatial.transform import Rotation

from struck.cli import main
from struck.scene import load_contacts

pytest.importorskip("mujoco")

SCENE = """<mujoco><option timestep="0.001"/><worldbody>
<geom name="shelf" type="box" size=".05 .04 .006" pos="0 0 -.006"/>
<body name="tile" pos="0 0 .06" euler="30 20 0"><freejoint/>
<geom type="box" size=".05 .04 .006"/></body>
<body name="ghost" pos="0 0 .3"><freejoint/><geom size=".01"/></body></worldbody></mujoco>"""
WORDS = [
    *("--seconds", "0.3", "--ring", "0.2", "--accuracy", "preview", "--restitution", "0.5"),
    *("--material", "tile=steel", "--material", "shelf=steel"),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder in which a scene was simulated."""
    folder = tmp_path_factory.mktemp("scene")
    (folder / "scene.xml").write_text(SCENE)
    words = ["simulate", str(folder / "scene.xml"), *WORDS, "--stems"]
    assert main([*words, "-o", str(folder / "out.wav")]) == 0
    return folder


@pytest.mark.prove
def test_stems_add_up_to_the_sound(folder: Path) -> None:
    whole, rate = soundfile.read(folder / "out.wav")
    parts = [soundfile.read(folder / f"out.{name}.wav")[0] for name in ("tile", "shelf")]
    assert rate == 48_000
    assert len(whole) == 24_000
    assert all(np.abs(part).max() > 0.01 for part in parts)
    np.testing.assert_allclose(sum(parts), whole, atol=2e-5)


def test_log_and_events_tell_the_same_blows(folder: Path) -> None:
    contacts = load_contacts(folder / "out.npz")
    with (folder / "out.events.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["body0"] == "shelf" and row["impulse"]]
    assert rows
    assert contacts.names == ("shelf", "tile", "ghost")
    blows = np.sum([json.loads(row["impulse"]) for row in rows], axis=0)
    total = np.asarray(contacts.impulse)[np.asarray(contacts.body0) == 0].sum(axis=0)
    assert 0.5 * total[2] < blows[2] <= 1.001 * total[2]


def test_animation_keeps_the_clock_of_the_log(folder: Path) -> None:
    data = (folder / "out.glb").read_bytes()
    length = int.from_bytes(data[12:16], "little")
    document, binary = json.loads(data[20 : 20 + length]), data[28 + length :]

    def values(number: int) -> np.ndarray:
        accessor = document["accessors"][number]
        view = document["bufferViews"][accessor["bufferView"]]
        part = binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        return np.frombuffer(part, "<f4").reshape(accessor["count"], -1)

    names = [node["name"] for node in document["nodes"]]
    channels = {
        (names[c["target"]["node"]], c["target"]["path"]): document["animations"][0]["samplers"][
            c["sampler"]
        ]
        for c in document["animations"][0]["channels"]
    }
    times = values(channels["tile", "translation"]["input"])[:, 0]
    np.testing.assert_allclose(np.diff(times), 1 / 60, rtol=1e-4)
    contacts = load_contacts(folder / "out.npz")
    assert contacts.poses is not None
    clock, places, turns = contacts.poses.of(contacts.names.index("tile"))
    shown = values(channels["tile", "translation"]["output"])
    wanted = np.array([np.interp(times, clock, places[:, axis]) for axis in range(3)]).T
    np.testing.assert_allclose(shown, wanted, atol=1e-5)
    spun = Rotation.from_quat(values(channels["tile", "rotation"]["output"]))
    start = Rotation.from_quat(turns[0], scalar_first=True)
    assert (spun[0].inv() * start).magnitude() < 1e-5
    assert ("shelf", "translation") not in channels


def test_pictures_show_the_scene(folder: Path) -> None:
    from PIL import Image

    picture = np.asarray(Image.open(folder / "out.png").convert("RGB"), float)
    row = picture[: int(picture.shape[0] * 0.7)]
    assert np.mean(row.std(axis=2) > 2) > 0.005  # coloured surfaces on white
    assert picture.std() > 20


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--material", "cup=steel"], "--material names 'cup'"),
        (["--wall", "0.1"], "PATTERN=VALUE"),
        (["--restitution", "tile=0.3"], "give two patterns"),
        (["--restitution", "often"], "often: give materials, pairs as ball,floor*=0.8, or a numb"),
        (["--restitution", "1.5"], "restitution is 1.5: it must be at most 1"),
        (["--seconds", "0"], "seconds is 0.0"),
        (
            ["--restitution", "cup,shelf=0.5"],
            "names 'cup' and 'shelf', which fit no two of 'shelf', 'tile', 'ghost'",
        ),
        (
            ["--damping", "herd"],
            "damping is 'herd': did you mean heard? give",
        ),
        (["--accuracy", "fin"], "accuracy is 'fin'"),
        (["--model", "tile=no.struck", "--wall", "tile=2mm"], "--wall names 'tile', whose modes"),
        (["--model", "t*=no.struck", "--material", "tile=oak"], "--material names 'tile', whose"),
        (["--keyframe", "start"], "is 'start': the scene has no keyframes: leave --keyframe out"),
        (["--friction", "tile,shlf=1"], "no two of 'shelf', 'tile', 'ghost': did you mean shelf?"),
        (["--log", "log.txt"], "npz"),
        (["--listener", "0,0"], "--listener"),
        (["--rate", "0"], "--rate is 0"),
        (["--material", "*=oack"], "did you mean oak"),
        (
            [],
            "nothing sounds: 'shelf', 'tile' and 'ghost' are silent: their material is not given;",
        ),
    ],
)
def test_wrong_words_are_refused(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    output = tmp_path / "no.wav"
    length = [] if "--seconds" in words else ["--seconds", "0.2"]
    given = [*length, *words, "-o", str(output)]
    assert main(["simulate", str(folder / "scene.xml"), *given]) == 2
    assert said in capsys.readouterr().err
    assert not output.exists()


FREE = """<mujoco><option gravity="0 0 {0}"/><worldbody>{1}
<body name="box" pos="0 0 .02"><freejoint/><geom type="box" size=".02 .02 .02"/></body>
</worldbody></mujoco>"""
FLOOR = '<geom name="floor" type="plane" size="1 1 .1"/>'


@pytest.mark.parametrize(
    ("gravity", "rest", "words", "said"),
    [
        (0.0, "", [], "nothing touches anything, so that there is no sound: let it run longer"),
        (0.0, "", ["--material", "box=steel", "--listener", "0,-1,0"], "silence: the log has no"),
        (0.0, FLOOR, ["--engine", "rapier"], "silence: the log has no"),
        (-9.81, FLOOR, ["--material", "box=steel"], "silence: no blow that counts in"),
    ],
)
def test_a_simulation_in_which_nothing_happens_writes_silence(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    gravity: float,
    rest: str,
    words: list[str],
    said: str,
) -> None:
    path, output = tmp_path / "scene.xml", tmp_path / "out.wav"
    path.write_text(FREE.format(gravity, rest))
    length = ["--seconds", "0.3", "--ring", "0.2", "--accuracy", "preview"]
    assert main(["simulate", str(path), *length, *words, "-o", str(output)]) == 0
    told = capsys.readouterr().out
    assert said in told
    assert "out.wav (0.50 s, silent)" in told
    samples, _ = soundfile.read(output)
    assert len(samples) == 24_000
    assert not samples.any()
    assert (tmp_path / "out.png").is_file()
    assert (tmp_path / "out.events.csv").read_text(encoding="utf-8") == "event,time\n"


def test_a_scene_without_a_surface_has_no_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "scene.xml").write_text(f"<mujoco><worldbody>{FLOOR}</worldbody></mujoco>")
    output = tmp_path / "out.wav"
    given = ["--seconds", "0.1", "-o", str(output)]
    assert main(["simulate", str(tmp_path / "scene.xml"), *given]) == 0
    assert "no body has a surface: there is no animation and no picture" in capsys.readouterr().out
    assert output.is_file()
    assert not (tmp_path / "out.png").exists()
