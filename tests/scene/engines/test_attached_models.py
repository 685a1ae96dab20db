"""Models that an MJCF attaches, compared with the same scene written out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from struck.errors import FileFormatError, SimulationError
from struck.scene import Simulation

mujoco = pytest.importorskip("mujoco")

LEG = (
    '<mujoco model="leg"><compiler angle="radian" meshdir="shapes"/>'
    '<asset><mesh name="foot" file="foot.stl"/><material name="oak"/></asset>'
    '<worldbody><body name="shin" pos="0 0 .1" euler="0 0 1.5707963"><joint axis="0 1 0"/>'
    '<geom type="box" size=".01 .01 .05" material="oak"/>'
    '<geom type="mesh" mesh="foot" pos="0 0 -.06"/></body></worldbody></mujoco>'
)
SCENE = (
    "<mujoco><asset>{model}</asset><worldbody>"
    '<geom name="floor" type="plane" size="1 1 .1"/>'
    '<body name="trunk" pos="0 0 1"><freejoint/><geom type="box" size=".1 .1 .02"/>{rest}</body>'
    "</worldbody></mujoco>"
)
MODEL = '<model name="leg" file="parts/leg.xml"/>'


def written(folder: Path, model: str = MODEL, rest: str = "", leg: str = LEG) -> Path:
    """Return a scene file beside a folder with the model of a leg."""
    shapes = folder / "parts/shapes"
    shapes.mkdir(parents=True, exist_ok=True)
    trimesh.creation.box((0.04, 0.02, 0.02)).export(shapes / "foot.stl")
    (folder / "parts/leg.xml").write_text(leg)
    path = folder / "scene.xml"
    path.write_text(SCENE.format(model=model, rest=rest))
    return path


def compiled(path: Path) -> mujoco.MjModel:
    return Simulation(path).model


TWO = (
    '<frame pos="-.1 0 0"><attach model="leg" body="shin" prefix="left "/></frame>'
    '<frame pos=".1 0 0"><attach model="leg" body="shin" prefix="right "/></frame>'
)


def test_an_attached_model_is_the_same_scene_as_written_out(tmp_path: Path) -> None:
    """Mass, places and shapes are those of one file that says all of it, as MuJoCo reads it."""
    made = compiled(written(tmp_path, rest=TWO))
    leg = (
        '<body name="{0} shin" pos="{1} 0 .1" euler="0 0 90"><joint axis="0 1 0"/>'
        '<geom type="box" size=".01 .01 .05"/><geom type="mesh" mesh="foot" pos="0 0 -.06"/></body>'
    )
    foot = (tmp_path / "parts/shapes/foot.stl").read_bytes()
    plain = SCENE.format(
        model='<mesh name="foot" file="foot.stl"/>',
        rest=leg.format("left", -0.1) + leg.format("right", 0.1),
    )
    wanted = mujoco.MjModel.from_xml_string(plain, assets={"foot.stl": foot})
    assert [made.body(n).name for n in range(made.nbody)] == [
        wanted.body(n).name for n in range(wanted.nbody)
    ]
    for name in ("body_pos", "body_mass", "geom_size", "geom_type", "body_parentid"):
        np.testing.assert_allclose(getattr(made, name), getattr(wanted, name), atol=1e-7)
    np.testing.assert_allclose(np.abs(made.body_quat), np.abs(wanted.body_quat), atol=1e-7)
    assert made.nmesh == 2
    for name in ("left shin", "right shin"):
        assert made.mat(made.geom_matid[made.body(name).geomadr[0]]).name == name[:-4] + "oak"


def test_whole_models_nested_ones_and_copies_are_attached(tmp_path: Path) -> None:
    leg = LEG.replace('<joint axis="0 1 0"/>', "")
    path = written(tmp_path, leg=leg)
    pair = (
        '<mujoco model="pair"><asset><model file="leg.xml"/></asset><worldbody>'
        '<replicate count="2" offset=".2 0 0"><attach model="leg" prefix="a-"/></replicate>'
        "</worldbody></mujoco>"
    )
    (tmp_path / "parts/pair.xml").write_text(pair)
    rest = '<attach model="pair" prefix="front "/>'
    path = written(tmp_path, model='<model file="parts/pair.xml"/>', rest=rest, leg=leg)
    model = compiled(path)
    names = [model.body(n).name for n in range(2, model.nbody)]
    assert names == ["front a-shin0", "front a-shin1"]
    assert model.body("front a-shin1").pos[0] - model.body("front a-shin0").pos[0] == pytest.approx(
        0.2
    )


ATTACH = '<attach model="leg" body="shin" prefix="p"/>'


@pytest.mark.parametrize(
    ("model", "rest", "leg", "said"),
    [
        ('<model name="leg" file="../secret.xml"/>', ATTACH, LEG, "lies outside of"),
        ('<model name="leg" file="{root}/secret.xml"/>', ATTACH, LEG, "lies outside of"),
        ('<model name="leg" file="link.xml"/>', ATTACH, LEG, "lies outside of"),
        ('<model name="leg" file="gone.xml"/>', ATTACH, LEG, "'gone.xml' is not in"),
        ('<model name="leg"/>', ATTACH, LEG, "'' is not in"),
        ('<model name="leg" file="scene.xml"/>', ATTACH, LEG, "attaches itself"),
        (
            '<model name="leg" file="parts/shapes/foot.stl"/>',
            ATTACH,
            LEG,
            r"foot.stl is a mesh \(STL\) and not a scene",
        ),
        ('<model name="leg" file="robot.urdf"/>', ATTACH, LEG, "begins with <robot>: give a mo"),
        (MODEL, ATTACH.replace('"leg"', '"lag"'), LEG, "model 'lag', .* 'leg': did you mean leg"),
        (MODEL, ATTACH.replace('"shin"', '"shn"'), LEG, "body 'shn' of .* did you mean shin"),
        ("", ATTACH, LEG, "names model 'leg', and there are none: name a <model>"),
        (MODEL, ATTACH, LEG.replace("foot.stl", "../../../secret.xml"), "lies outside of"),
        (MODEL, ATTACH, LEG.replace("<asset>", '<asset><model file="leg.xml"/>'), "attaches its"),
        (
            MODEL,
            ATTACH,
            LEG.replace("<asset>", '<asset><model file="../scene.xml"/>'),
            "attaches itself",
        ),
        (
            MODEL,
            ATTACH,
            LEG.replace("<asset>", '<include file="../../secret.xml"/><asset>'),
            "outs",
        ),
        (MODEL, ATTACH, "<!DOCTYPE a [<!ENTITY b 'c'>]>" + LEG, "declares entities"),
    ],
)
def test_hostile_models_are_refused(
    tmp_path: Path, model: str, rest: str, leg: str, said: str
) -> None:
    (tmp_path / "secret.xml").write_text(LEG)
    folder = tmp_path / "scene"
    path = written(folder, model.replace("{root}", str(tmp_path)), rest, leg)
    (folder / "link.xml").symlink_to(tmp_path / "secret.xml")
    (folder / "robot.urdf").write_text('<robot name="r"><link name="l"/></robot>')
    with pytest.raises(FileFormatError, match=said):
        Simulation(path)


def test_models_that_attach_each_other_without_end_are_refused(tmp_path: Path) -> None:
    """Twelve files, each of which attaches the next one twice, are 4,096 bodies: too many."""
    for number in range(12):
        next_one = f'<asset><model name="m" file="f{number + 1}.xml"/></asset>'
        twice = '<attach model="m" prefix="a"/><attach model="m" prefix="b"/>'
        (tmp_path / f"f{number}.xml").write_text(
            f"<mujoco>{next_one}<worldbody>{twice}</worldbody></mujoco>"
        )
    (tmp_path / "f12.xml").write_text(
        '<mujoco><worldbody><body name="b"><geom size=".1"/></body></worldbody></mujoco>'
    )
    with pytest.raises(FileFormatError, match="includes or attaches more than 1000 files"):
        Simulation(tmp_path / "f0.xml")
    for number in range(12):
        text = f'<include file="g{number + 1}.xml"/>' * 2
        (tmp_path / f"g{number}.xml").write_text(f"<mujoco>{text}</mujoco>")
    (tmp_path / "g12.xml").write_text("<mujoco/>")
    with pytest.raises(FileFormatError, match="includes or attaches more than 1000 files"):
        Simulation(tmp_path / "g0.xml")


def test_errors_of_the_engine_about_attached_models_are_its_own(tmp_path: Path) -> None:
    path = written(tmp_path, rest=ATTACH, leg=LEG.replace('size=".01 .01 .05"', 'size="big"'))
    with pytest.raises(SimulationError, match="MuJoCo cannot read the scene"):
        Simulation(path)
