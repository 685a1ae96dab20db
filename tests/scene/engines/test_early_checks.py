"""Faults that are known before any mode is computed, and gathered notes of a simulation."""

from __future__ import annotations

import gzip
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import struck
from struck.cli import main
from struck.errors import MeshError, StruckError
from struck.scene import Simulation
from struck.scene.engines import sound_sources
from struck.solids import Block

pytest.importorskip("mujoco")

SCENE = """<mujoco><option integrator="{0}"/><worldbody>
<geom name="floor" type="plane" size="1 1 .1"/>
<body name="base" pos="0 0 .1"><freejoint/><geom type="box" size=".05 .05 .02"/></body>
<body name="upper" pos="0 0 {1}"><freejoint/><geom type="box" size=".05 .05 .02"/></body>
<body name="arm" pos="1 0 .5"><joint axis="0 1 0"/><geom type="box" size=".05 .01 .01"/></body>
</worldbody><keyframe><key name="in each other" qpos="0 0 .1 1 0 0 0 0 0 .12 1 0 0 0 0"/></keyframe>
</mujoco>"""


def written(folder: Path, integrator: str = "Euler", height: float = 0.3) -> Path:
    path = folder / "scene.xml"
    path.write_text(SCENE.format(integrator, height))
    return path


@pytest.fixture
def analyzed(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """Return a list of the bodies that were analyzed, none of which is."""
    bodies: list[object] = []

    def analyze(body: object, *_: object, **__: object) -> None:
        bodies.append(body)
        raise AssertionError("a mode was computed")

    monkeypatch.setattr(sound_sources, "analyze", analyze)
    return bodies


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"height": 0.12}, "'base' and 'upper' start 0.02 m deep in each other, more than 0.004"),
        ({"keyframe": "in each other"}, "'base' and 'upper' start 0.02 m deep in each other"),
        ({"keyframe": "start"}, "keyframe is 'start'"),
        ({"materials": {"*": "oak", "upper": "oack"}}, "did you mean oak"),
        ({"materials": {"base": "oak", "uper": "oak"}}, "materials names 'uper': did you mean up"),
        ({"walls": {"upper": -0.001}}, "wall of 'upper' is -0.001: it must exceed 0 m"),
        ({"walls": {"lower": 0.001}}, "walls names 'lower'"),
        ({"fixed": {"lower": None}}, "fixed names 'lower'"),
        ({"roughness": {"upper": "sandpapre"}}, "did you mean sandpaper"),
        ({"mute": ("hand",)}, "mute names 'hand'"),
        ({"models": {"upper": "gone.struck"}}, "gone.struck is missing"),
        ({"models": {"upper": "gone.obj"}}, "gone.obj is missing"),
        ({"accuracy": "fin"}, "accuracy is 'fin'"),
        ({"damping": "herd"}, "damping is 'herd'"),
        ({"restitution": 1.5}, "restitution is 1.5"),
        ({"restitution": "material"}, "restitution is 'material'"),
        ({"restitution": {("base", "uper"): 0.5}}, "fit no two of"),
        ({"friction": {("base", "uper"): 0.5}}, "fit no two of"),
        ({"restitution": 0.5, "integrator": "RK4"}, "set integrator to Euler or implicitfast"),
        ({"engine": "rapier"}, "'arm' has joints: Rapier gets free and fixed bodies alone"),
    ],
)
def test_faults_are_found_before_a_mode_is_computed(
    tmp_path: Path, analyzed: list[object], options: Mapping[str, Any], said: str
) -> None:
    of_the_scene = {k: v for k, v in options.items() if k in {"integrator", "height"}}
    given = {k: v for k, v in options.items() if k not in of_the_scene}
    path = written(tmp_path, **of_the_scene)
    with pytest.raises(StruckError, match=said.replace("(", r"\(")):
        Simulation(path, **{"materials": "oak", **given})
    assert not analyzed
    # Without the fault they would be.
    with pytest.raises(AssertionError, match="a mode was computed"):
        Simulation(written(tmp_path), materials="oak")
    assert analyzed


def test_the_shell_refuses_a_fade_before_a_mode_is_computed(
    tmp_path: Path, analyzed: list[object], capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["simulate", str(written(tmp_path)), "--material", "oak", "--seconds", "1"]
    assert main([*words, "--ring", "0.5", "--fade", "2"]) == 2
    assert "--fade is 2 s and the sound lasts 1.5 s" in capsys.readouterr().err
    assert not analyzed


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        (
            "chair.fbx",
            b"Kaydara FBX Binary",
            r"it is a scene of meshes \(FBX\), which struck does",
        ),
        ("take.wav", b"RIFF\0\0\0\0WAVEfmt ", r"it is a sound \(WAV\) and not a mesh"),
        ("body.bin", b"glTF\2\0\0\0", r"its content is GLB: end its name in \.glb"),
        ("body.obj", b"glTF\2\0\0\0", r"its content is GLB: end its name in \.glb"),
        ("plain", b"v 0 0 0", "it has no extension: use one of surfaces as obj"),
    ],
)
def test_files_of_other_kinds_are_no_shapes(
    tmp_path: Path, analyzed: list[object], name: str, content: bytes, said: str
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(StruckError, match=said):
        Simulation(written(tmp_path), materials="oak", models={"upper": tmp_path / name})
    assert not analyzed


def test_each_shape_is_analyzed_once_by_its_content(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two volume meshes of as many nodes are printed alike, and have different modes."""
    mesh = Block(size=(0.1, 0.1, 0.04)).volume_mesh("preview")
    twin, larger = replace(mesh), replace(mesh, nodes=1.5 * mesh.nodes)
    assert repr(mesh) == repr(larger)
    packed = tmp_path / "box.obj.gz"  # of which the content is not part of a key
    packed.write_bytes(gzip.compress(b"v 0 0 0"))
    bodies: list[object] = []

    def analyze(body: object, *_: object, **__: object) -> None:
        bodies.append(body)
        raise MeshError("no modes here")

    monkeypatch.setattr(sound_sources, "analyze", analyze)
    models = {"base": mesh, "upper": twin, "arm": larger}
    Simulation(written(tmp_path), materials="oak", models=models, cache=False)
    assert bodies == [mesh, larger]
    bodies.clear()
    Simulation(written(tmp_path), materials="oak", models={"*": packed}, cache=False)
    assert bodies == [packed]


DICE = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 .1"/>{}
<body name="ball" pos="0 1 .5"><freejoint/><geom size=".01"/></body>
<body name="stone" pos="0 2 .5"><freejoint/><geom size=".01"/></body></worldbody></mujoco>"""
DIE = '<body name="d{0}" pos="{1} 0 .3"><freejoint/><geom type="box" size=".006 .006 .006"/></body>'


def test_notes_of_a_simulation_are_gathered(tmp_path: Path) -> None:
    path = tmp_path / "dice.xml"
    path.write_text(DICE.format("".join(DIE.format(n, 0.1 * n) for n in range(14))))
    die = struck.analyze(Block(size=(0.012,) * 3), "steel", accuracy="preview")
    notes = Simulation(path, models={"d*": die}, mute=("stone",)).notes
    mass = 7850 * 0.012**3
    assert notes == (
        "'floor' is silent: a plane has no end; name a shape with models=",
        "'ball' is silent: its material is not given; name it with materials=",
        "'stone' is silent: mute= says so",
        f"14 bodies weigh {mass:.3g} kg each, as their elements do: 'd0' to 'd13'",
    )
    plain = Simulation(path).notes
    assert plain[1] == (
        "'d0' to 'd13', 'ball' and 'stone' are silent: their material is not given; name it with "
        "materials="
    )
    heavy = struck.analyze(Block(size=(0.012,) * 3), "lead", accuracy="preview")
    notes = Simulation(path, models={"d0": die, "d1": heavy}).notes
    least, most = f"{mass:.3g}", f"{heavy.mass:.3g}"
    assert notes[-1] == f"2 bodies weigh {least} to {most} kg, as their elements do: 'd0' and 'd1'"
