from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import struck
from struck.errors import ArgumentError, FileFormatError, OptionError, SimulationError
from struck.model.mesh import Surface
from struck.scene import Contacts, MujocoRecorder, Scene, Simulation
from struck.solids import Block
from tests.samples import sampled

mujoco = pytest.importorskip("mujoco")

GRAVITY = np.array([0.0, 0.0, -9.81])


def written(folder: Path, body: str, *, options: str = "", assets: str = "") -> Path:
    """Return a scene file of some bodies in the world."""
    path = folder / "scene.xml"
    path.write_text(
        f"<mujoco><option {options}/><asset>{assets}</asset><worldbody>{body}</worldbody></mujoco>"
    )
    return path


FLOOR = '<geom name="floor" type="plane" size="2 2 .1" condim="{0}"/>'
PLANK = (
    '<body name="plank" pos="0 0 .15" euler="20 15 0"><freejoint/>'
    '<geom type="box" size=".15 .05 .005" mass="2.355" condim="{0}"/></body>'
)
ROD = (
    '<body name="rod" pos="0 .02 .3" euler="80 10 40"><freejoint/>'
    '<geom type="cylinder" size=".0125 .2525" mass=".1028" condim="{0}"/></body>'
)


def closure(contacts: Contacts, name: str, mass: float, gained: np.ndarray) -> float:
    """Return what is missing of a body's momentum, as a share of all that it exchanged."""
    number = contacts.names.index(name)
    impulse, second = np.asarray(contacts.impulse), np.asarray(contacts.body1) == number
    mine = second | (np.asarray(contacts.body0) == number)
    total = impulse[second].sum(axis=0) - impulse[mine & ~second].sum(axis=0)
    return float(
        np.linalg.norm(total - mass * gained) / np.linalg.norm(impulse[mine], axis=1).sum()
    )


@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
@pytest.mark.parametrize("dimensions", [1, 3, 4, 6])
def test_momentum_of_free_bodies_closes(tmp_path: Path, cone: str, dimensions: int) -> None:
    bodies = (FLOOR + PLANK + ROD).format(dimensions)
    options = f'timestep=".001" cone="{cone}"'
    model = mujoco.MjModel.from_xml_path(str(written(tmp_path, bodies, options=options)))
    data = mujoco.MjData(model)
    log = MujocoRecorder(model)
    for _ in range(500):
        mujoco.mj_step(model, data)
        log.step(data)
    contacts = log.contacts()
    assert len(contacts) > 200
    for name in ("plank", "rod"):
        body = model.body(name)
        gained = data.qvel[body.dofadr[0] :][:3] - GRAVITY * data.time
        assert closure(contacts, name, body.mass[0], gained) < 1e-3


@pytest.mark.prove
def test_momentum_of_a_mesh_of_several_hulls_closes_in_wind(tmp_path: Path) -> None:
    channel().export(tmp_path / "channel.stl")
    bodies = (
        FLOOR.format(3)
        + '<body name="channel" pos="0 0 .04" euler="5 0 0"><freejoint/>'
        + '<geom type="mesh" mesh="channel" density="30"/></body>'
        + '<body name="ball" pos=".01 0 .12"><freejoint/><geom size=".01"/></body>'
    )
    path = written(
        tmp_path,
        bodies,
        options='timestep=".001" density="1.2" viscosity="2e-5" wind="3 0 0"',
        assets='<mesh name="channel" file="channel.stl"/>',
    )
    simulation = Simulation(path, cache=False)
    assert any("convex parts" in note for note in simulation.notes)
    model = simulation.model
    data, log = mujoco.MjData(model), MujocoRecorder(model)
    dragged = np.zeros(model.nv)
    for _ in range(400):
        mujoco.mj_step(model, data)
        log.step(data)
        dragged += data.qfrc_passive * model.opt.timestep
    contacts = log.contacts()
    assert len(contacts) > 200
    for name in ("channel", "ball"):
        body = model.body(name)
        at, mass = body.dofadr[0], body.mass[0]
        assert np.linalg.norm(dragged[at : at + 3]) > 1e-6
        gained = data.qvel[at : at + 3] - GRAVITY * data.time - dragged[at : at + 3] / mass
        assert closure(contacts, name, mass, gained) < 1e-3
    # The ball fell between the walls, not on a lid: its centre is below their tops.
    where = data.body("ball").xpos - data.body("channel").xpos
    assert where[2] < 0.03


def channel() -> trimesh.Trimesh:
    """Return a trough, 60 mm wide and 40 mm high, its floor and walls 10 mm thick."""
    outline = [(-30, 0), (30, 0), (30, 40), (20, 40), (20, 10), (-20, 10), (-20, 40), (-30, 40)]
    bottom = np.array([(x, -50.0, z) for x, z in outline]) / 1e3
    top = bottom + np.array([0, 0.1, 0])
    quads = [(n, (n + 1) % 8) for n in range(8)]
    sides = [face for a, b in quads for face in ((a, a + 8, b), (b, a + 8, b + 8))]
    caps = [(0, 1, 4), (1, 2, 4), (2, 3, 4), (0, 4, 5), (0, 5, 7), (5, 6, 7)]
    faces = sides + caps + [(c + 8, b + 8, a + 8) for a, b, c in caps]
    mesh = trimesh.Trimesh(np.concatenate([bottom, top]), faces)
    assert mesh.is_watertight
    return mesh if mesh.volume > 0 else trimesh.Trimesh(mesh.vertices, mesh.faces[:, ::-1])


BALL = '<body name="ball" pos="{x} 0 {z}"><freejoint/><geom size=".013" density="7850"/></body>'
HEAVY = '<body name="heavy"><freejoint/><geom size=".026" density="7850"/></body>'


def rebound(simulation: Simulation, name: str, speed: float, *, rest: str = "") -> float:
    """Return the restitution of a body that comes down at a speed, without gravity."""
    model = simulation.model
    data = mujoco.MjData(model)
    at = model.body(name).dofadr[0] + 2
    data.qvel[at] = -speed
    for _ in range(int(0.01 / speed / model.opt.timestep) + 30):
        mujoco.mj_step(model, data)
    other = data.qvel[model.body(rest).dofadr[0] + 2] if rest else 0.0
    return float(data.qvel[at] - other) / speed


@pytest.mark.parametrize("step", sampled([0.0005, 0.001], 0.001))
@pytest.mark.parametrize("asked", [0.0, 0.3, 0.5, 0.8])
@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
def test_bodies_rebound_as_asked(tmp_path: Path, step: float, asked: float, cone: str) -> None:
    options = f'timestep="{step}" gravity="0 0 0" cone="{cone}"'
    plane = Simulation(
        written(tmp_path, FLOOR.format(3) + BALL.format(x=0.3, z=0.0177), options=options),
        restitution=asked,
    )
    pair = Simulation(
        written(tmp_path, HEAVY + BALL.format(x=0, z=0.0437), options=options),
        restitution={("ball", "heavy"): asked},
    )
    for speed in (0.5, 1.7, 5.0):
        assert rebound(plane, "ball", speed) == pytest.approx(asked, abs=0.05)
        assert rebound(pair, "ball", speed, rest="heavy") == pytest.approx(asked, abs=0.05)
    box = '<body name="box" pos="0 0 .031"><freejoint/><geom type="box" size=".05 .04 .03"/></body>'
    flat = Simulation(written(tmp_path, FLOOR.format(3) + box, options=options), restitution=asked)
    assert rebound(flat, "box", 1.0) == pytest.approx(asked, abs=0.1)


def test_restitution_of_materials_is_that_of_the_softer_one(tmp_path: Path) -> None:
    options = 'timestep=".001" gravity="0 0 0"'
    path = written(tmp_path, FLOOR.format(3) + BALL.format(x=0, z=0.0177), options=options)
    materials = {"ball": "steel", "floor": "rubber"}
    mute = ("ball", "floor")
    simulation = Simulation(path, materials=materials, mute=mute, restitution="materials")
    # Rubber is ten thousand times softer than steel: what it does alone counts.
    assert rebound(simulation, "ball", 1.0) == pytest.approx(0.5, abs=0.01)
    steel = Simulation(path, materials="steel", mute=mute, restitution="materials")
    assert rebound(steel, "ball", 1.0) == pytest.approx(0.6, abs=0.01)


def test_solver_settings_of_a_file_stay_as_they_are(tmp_path: Path) -> None:
    settings = '<geom name="floor" type="plane" size="1 1 .1" solref=".02 .7" solimp=".8 .9 .01"/>'
    path = written(tmp_path, settings + BALL.format(x=0, z=0.1), options='timestep=".002"')
    simulation = Simulation(path)
    assert simulation.model.opt.timestep == 0.002
    assert simulation.model.geom_solref[0].tolist() == [0.02, 0.7]
    assert simulation.model.geom_solimp[0][:3].tolist() == [0.8, 0.9, 0.01]


def test_runge_kutta_steps_cannot_rebound_and_say_so(tmp_path: Path) -> None:
    options = 'timestep=".001" integrator="RK4"'
    path = written(tmp_path, FLOOR.format(3) + BALL.format(x=0, z=0.1), options=options)
    with pytest.raises(SimulationError, match="set integrator to Euler or implicitfast"):
        Simulation(path, restitution=0.5)
    # With the file's own settings they run, and tell that their contacts are of one stage alone.
    _, contacts = Simulation(path).run(0.3)
    assert len(contacts)
    assert "the last of RK4's four stages" in contacts.notes[0]


def test_compiled_meshes_are_turned_back_to_their_files(tmp_path: Path) -> None:
    block = trimesh.creation.box((0.1, 0.06, 0.02))
    block.apply_translation((0.03, 0.01, 0.005))
    block.export(tmp_path / "block.stl")
    turn = "20 -35 50"
    body = (
        f'<body name="block" pos="0 0 .2" euler="{turn}"><freejoint/>'
        '<geom type="mesh" mesh="block" pos=".01 .02 .03" euler="0 90 0"/></body>'
    )
    path = written(tmp_path, FLOOR.format(3) + body, assets='<mesh file="block.stl"/>')
    simulation = Simulation(path, restitution=0.3)
    scene, contacts = simulation.run(0.4)
    geometry = scene.bodies["block"].model.geometry
    assert geometry is not None
    np.testing.assert_allclose(geometry.bounds, block.bounds, atol=1e-7)
    number = contacts.names.index("block")
    assert contacts.poses is not None
    times, places, turns = contacts.poses.of(number)
    outer = Rotation.from_euler("XYZ", [20, -35, 50], degrees=True)
    start = outer.apply([0.01, 0.02, 0.03]) + np.array([0, 0, 0.2])
    np.testing.assert_allclose(places[0], start, atol=1e-6)
    # Wherever it is touched, the file's own surface is there.
    rows = np.flatnonzero(np.isin(contacts.time, times))
    assert len(rows) > 20
    which = np.searchsorted(times, np.asarray(contacts.time)[rows])
    moved = np.asarray(contacts.position)[rows] - places[which]
    local = Rotation.from_quat(turns[which], scalar_first=True).inv().apply(moved)
    distances, _, _ = Surface(geometry).closest(local)
    assert distances.max() < 2e-3


def test_bodies_weigh_what_their_elements_do_unless_the_file_says(tmp_path: Path) -> None:
    box = (
        '<body name="{0}" pos="{1} 0 .1" euler="0 0 30"><freejoint/>'
        '<geom type="box" size=".05 .03 .01" pos=".02 0 0" {2}/></body>'
    )
    bodies = box.format("own", 0, "") + box.format("said", 0.3, 'mass="3"')
    path = written(tmp_path, FLOOR.format(3) + bodies)
    simulation = Simulation(path, materials="glass", accuracy="preview", cache=False)
    own, said = simulation.model.body("own"), simulation.model.body("said")
    mass = 2600 * 0.1 * 0.06 * 0.02
    assert own.mass[0] == pytest.approx(mass, rel=1e-6)
    np.testing.assert_allclose(own.ipos, [0.02, 0, 0], atol=1e-9)
    moments = mass / 12 * np.array([0.06**2 + 0.02**2, 0.1**2 + 0.02**2, 0.1**2 + 0.06**2])
    np.testing.assert_allclose(np.sort(own.inertia), np.sort(moments), rtol=1e-6)
    assert said.mass[0] == 3.0
    assert any("'own' weighs" in note for note in simulation.notes)
    assert any("'floor' is silent: a plane has no end" in note for note in simulation.notes)


def test_options_that_change_nothing_are_told_or_refused(tmp_path: Path) -> None:
    body = '<body name="b" pos="0 0 .05"><freejoint/><geom type="box" size=".02 .01 .01"/></body>'
    path = written(tmp_path, FLOOR.format(3) + body)
    made = {"materials": {"b": "lead"}, "accuracy": "preview", "damping": "heard"}
    notes = Simulation(path, **made).notes
    assert "lead has no set 'heard': it rings with its default damping" in notes
    assert any(
        note.startswith("convex='hull' changes nothing")
        for note in Simulation(path, convex="hull").notes
    )
    made = {"models": {"b": struck.analyze(Block(size=(0.04, 0.02, 0.02)), "glass")}}
    notes = Simulation(path, **made, accuracy="preview", damping="heard").notes
    for told in ("accuracy='preview'", "damping='heard'"):
        assert f"{told} changes nothing: no body is analyzed" in notes
    assert not any("changes nothing" in note for note in Simulation(path, **made).notes)
    for pairs in ({("b", "ceiling"): 0.5}, {"b": 0.5}, {("b", "b"): 0.5}):
        with pytest.raises(OptionError, match=r"restitution names .* fit no two of 'floor', 'b'"):
            Simulation(path, **made, restitution=pairs)


STIFF = 'solref="-1e8 -10" solimp=".99 .99 .001"'


@pytest.mark.parametrize(
    ("body", "options", "said"),
    [
        (
            f'<body name="b" pos="0 0 .02"><freejoint/><geom size=".01" {STIFF}/></body>',
            'timestep=".001"',
            "exploded at .* s: 'b' gained",
        ),
        (
            '<body name="b" pos="0 0 .004"><freejoint/><geom size=".01"/></body>',
            "",
            "'floor' and 'b' start .* m deep in each other",
        ),
        ('<body name="b" pos="0 0 1"><freejoint/></body>', "", "MuJoCo refuses the scene: .*mass"),
        ('<body name="b"><geom size="-1"/></body>', "", "MuJoCo .* the scene: "),
    ],
)
def test_impossible_simulations_are_refused(
    tmp_path: Path, body: str, options: str, said: str
) -> None:
    path = written(tmp_path, FLOOR.format(3) + body, options=options)
    with pytest.raises(SimulationError, match=said):
        Simulation(path).run(0.3)


def test_a_row_of_touching_bodies_that_is_hit_does_not_explode(tmp_path: Path) -> None:
    row = "".join(
        f'<body name="b{n}" pos="{0.02 * n} 0 .0101"><freejoint/>'
        f'<geom size=".01" mass="{mass}"/></body>'
        for n, mass in enumerate((0.05, 0.02, 0.01))
    )
    hit = '<body name="hammer" pos="-.05 0 .0101"><freejoint/><geom size=".01" mass=".2"/></body>'
    still = "0 " * 18
    key = f'<keyframe><key name="k" qvel="{still}3 0 0 0 0 0"/></keyframe>'
    path = written(tmp_path, FLOOR.format(3) + row + hit, options='timestep=".001"')
    path.write_text(path.read_text().replace("</mujoco>", f"{key}</mujoco>"))
    _, contacts = Simulation(path, restitution=0.8, keyframe="k").run(0.1)
    assert np.linalg.norm(contacts.impulse, axis=1).max() > 0.02


FLOOR_AND_BALL = (
    '<geom name="floor" type="plane" size="1 1 .1"/>'
    '<body name="ball" pos="0 0 .05"><freejoint/><geom name="ball" size=".01"/></body>'
)


def test_dead_contacts_are_told(tmp_path: Path) -> None:
    dull = '<geom name="floor" type="plane" size="1 1 .1" solref=".05 2"/>'
    ball = '<body name="ball" pos="0 0 .1"><freejoint/><geom size=".01" solref=".05 2"/></body>'
    _, contacts = Simulation(written(tmp_path, dull + ball)).run(0.2)
    assert any("blows are dead" in note for note in contacts.notes)
    _, contacts = Simulation(written(tmp_path, dull + ball), restitution=0.5).run(0.2)
    assert not any("blows are dead" in note for note in contacts.notes)


def test_blows_of_more_steps_than_count_as_one_are_told(tmp_path: Path) -> None:
    floor = '<geom name="floor" type="plane" size="1 1 .1"/>'
    ball = '<body name="ball" pos="0 0 .02"><freejoint/><geom size=".01"/></body>'
    path = written(tmp_path, floor + ball)
    said = "a blow takes about 20 ms, or 100 steps, of which more than 31"
    assert any(said in note for note in Simulation(path, step=2e-4).run(0.1)[1].notes)
    assert not any("a blow takes" in note for note in Simulation(path, step=1e-3).run(0.1)[1].notes)
    scene, _ = Simulation(path, step=1e-3, restitution="materials").run(0.1)
    assert any("'floor', 'ball' stay as the file says" in note for note in scene.notes)


def test_soft_contacts_that_let_go_late_are_no_explosion(tmp_path: Path) -> None:
    """A can that falls on its rim is still pushed 24 ms after it has stopped."""
    floor = '<geom name="floor" type="plane" size="2 2 .1"/>'
    can = '<geom type="cylinder" size=".04 .05" mass=".3"/>'
    body = f'<body name="can" pos="0 0 .5" euler="30 20 0"><freejoint/>{can}</body>'
    path = written(tmp_path, floor + body, options='timestep=".001"')
    scene, contacts = Simulation(path, friction=0.5).run(0.5)
    assert len(contacts) > 30
    assert list(scene.bodies) == ["floor", "can"]


def test_a_loop_of_ones_own_gives_the_same_log(tmp_path: Path) -> None:
    bodies = FLOOR.format(3) + BALL.format(x=0, z=0.03) + BALL.format(x=0.1, z=0.04)
    path = written(tmp_path, bodies.replace('"ball"', '"mug"', 1), options='timestep=".001"')
    _, log = Simulation(path, cache=False).run(0.2)
    model = mujoco.MjModel.from_xml_path(str(path))
    data, recorder = mujoco.MjData(model), MujocoRecorder(model)
    for _ in range(200):
        mujoco.mj_step(model, data)
        recorder.step(data)
    scene, again = recorder.scene(materials={"mug": "rubber"}, cache=False)
    np.testing.assert_array_equal(log.impulse, again.impulse)
    assert scene.bodies["mug"].model.material is not None
    assert scene.bodies["ball"].model.material is None
    with pytest.raises(OptionError, match=r"call step\(\) once after each"):
        recorder.step(data)
    with pytest.raises(OptionError, match="materials names 'cup'"):
        recorder.scene(materials={"cup": "steel"})


# Files.


def test_robots_are_read_with_their_packages_and_what_is_seen_of_them(tmp_path: Path) -> None:
    package = tmp_path / "mugs"
    for folder in ("meshes", "urdf"):
        (package / folder).mkdir(parents=True)
    shape = trimesh.creation.box((0.08, 0.06, 0.04))
    shape.export(package / "meshes/mug.ply")
    robot = """<robot name="mug"><link name="mug"><inertial><mass value=".3"/>
      <inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial>
      <visual><geometry><mesh filename="package://mugs/meshes/mug.ply"/></geometry></visual>
      <collision><geometry><sphere radius=".03"/></geometry></collision></link></robot>"""
    path = package / "urdf/mug.urdf"
    path.write_text(robot)
    with pytest.raises(FileFormatError, match="folder="):
        Simulation(path)
    simulation = Simulation(path, folder=tmp_path)
    geometry = simulation.scene.bodies["mug"].model.geometry
    assert geometry is not None
    assert geometry.volume == pytest.approx(0.08 * 0.06 * 0.04, rel=1e-5)
    assert simulation.model.body("mug").mass[0] == pytest.approx(0.3)
    assert simulation.model.body("mug").jntnum[0] == 1


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('<mujoco><asset><mesh file="../secret.stl"/></asset></mujoco>', "lies outside of"),
        ('<mujoco><asset><mesh file="{root}/secret.stl"/></asset></mujoco>', "lies outside of"),
        ('<mujoco><include file="../secret.stl"/></mujoco>', "lies outside of"),
        ('<mujoco><include file="scene.xml"/></mujoco>', "includes itself"),
        ('<mujoco><asset><mesh file="gone.stl"/></asset></mujoco>', "is not in"),
        ('<mujoco><asset><model file="gone.xml"/></asset></mujoco>', "is not in"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><mujoco>&b;</mujoco>', "declares entities"),
        ("<sdf/>", "begins with <sdf>"),
        ("no scene", "is no XML"),
        ("<mujoco>" + 401 * "<body>" + 401 * "</body>" + "</mujoco>", "402 deep in each other"),
        (
            '<mujoco><asset><hfield nrow="60000" ncol="60000" size="1 1 1 1"/></asset></mujoco>',
            "it is damaged, or another format",
        ),
    ],
)
def test_hostile_scene_files_are_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "secret.stl").write_bytes(b"secret")
    folder = tmp_path / "scene"
    folder.mkdir()
    path = folder / "scene.xml"
    path.write_text(text.replace("{root}", str(tmp_path)))
    with pytest.raises(FileFormatError, match=said):
        Simulation(path)


def test_files_that_include_each_other_twice_are_not_read_a_million_times(tmp_path: Path) -> None:
    for number in range(21):
        twice = f'<include file="{number + 1}.xml"/>' * 2 * (number < 20)
        (tmp_path / f"{number}.xml").write_text(f"<mujoco>{twice}</mujoco>")
    with pytest.raises(FileFormatError, match="includes or attaches more than 1000 files"):
        Simulation(tmp_path / "0.xml")


@pytest.mark.prove
def test_a_hundred_million_copies_end_with_their_time(tmp_path: Path) -> None:
    body = '<body><geom size=".1"/></body>'
    copies = f'<replicate count="100000000">{body}</replicate>'
    path = tmp_path / "copies.xml"
    path.write_text(f"<mujoco><worldbody>{copies}</worldbody></mujoco>")
    with pytest.raises(FileFormatError, match="took more than 10 s of the processor: take some"):
        Simulation(path)


def test_included_files_and_folders_of_meshes_are_found(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    trimesh.creation.box((0.1, 0.1, 0.1)).export(tmp_path / "parts/cube.obj")
    (tmp_path / "parts/cube.xml").write_text(
        '<mujocoinclude><asset><mesh file="cube.obj"/></asset></mujocoinclude>'
    )
    body = '<body name="cube" pos="0 0 1"><freejoint/><geom type="mesh" mesh="cube"/></body>'
    path = tmp_path / "scene.xml"
    path.write_text(
        '<mujoco><compiler meshdir="parts"/><include file="parts/cube.xml"/>'
        f"<worldbody>{body}</worldbody></mujoco>"
    )
    model = Simulation(path).model
    assert model.body("cube").mass[0] == pytest.approx(1.0)


def test_nothing_that_touches_is_told(tmp_path: Path) -> None:
    scene, contacts = Simulation(written(tmp_path, FLOOR.format(3) + PLANK.format(3))).run(0.05)
    assert isinstance(scene, Scene)
    assert not len(contacts)
    assert any("nothing touches anything" in note for note in contacts.notes)


def speeds(contacts: Contacts, names: Sequence[str], after: float) -> float:
    """Return how fast bodies move at most after a time, m/s."""
    assert contacts.poses is not None
    fastest = 0.0
    for name in names:
        times, places, _ = contacts.poses.of(contacts.names.index(name))
        late = times >= after
        steps = np.diff(places[late], axis=0) / np.diff(times[late])[:, None]
        fastest = max(fastest, float(np.linalg.norm(steps, axis=1).max()))
    return fastest


@pytest.mark.prove
def test_a_stack_comes_to_rest_whatever_its_restitution(tmp_path: Path) -> None:
    box = (
        '<body name="{0}" pos="0 0 {1}"><freejoint/>'
        '<geom type="box" size=".025 .025 .025" mass=".05" condim="4"/></body>'
    )
    names = ["low", "middle", "high"]
    stack = "".join(box.format(n, 0.026 + 0.051 * k) for k, n in enumerate(names))
    path = written(tmp_path, FLOOR.format(4) + stack, options='timestep=".001"')
    _, contacts = Simulation(path, restitution=0.8).run(1.5)
    assert speeds(contacts, names, 1.3) < 1e-3


def test_steps_that_are_not_logged_are_counted(tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(written(tmp_path, FLOOR_AND_BALL)))
    data, log = mujoco.MjData(model), MujocoRecorder(model)
    with pytest.raises(OptionError, match="once after each mj_step"):
        log.step(data)
    for number in range(1, 301):
        mujoco.mj_step(model, data)
        if number % 3 == 0:
            log.step(data)
    assert any(note.startswith("198 steps not logged") for note in log.contacts().notes)


def test_bodies_that_weigh_other_than_they_sound_are_named(tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(written(tmp_path, FLOOR_AND_BALL)))
    data, log = mujoco.MjData(model), MujocoRecorder(model)
    for _ in range(200):
        mujoco.mj_step(model, data)
        log.step(data)
    scene, _ = log.scene(materials={"ball": "steel"}, band=(20, 30_000), accuracy="preview")
    (note,) = [each for each in scene.notes if "MuJoCo's own" in each]
    moves, sounds = map(float, re.findall(r"([\d.]+) kg", note))
    assert moves == pytest.approx(1000 * 4 / 3 * np.pi * 0.01**3, rel=0.01)
    assert sounds == pytest.approx(7850 * 4 / 3 * np.pi * 0.01**3, rel=0.1)


def test_what_is_no_model_and_no_control_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match=r"takes a mujoco\.MjModel"):
        MujocoRecorder("scene.xml")
    with pytest.raises(ArgumentError, match="give a function"):
        Simulation(written(tmp_path, FLOOR_AND_BALL)).run(0.1, control=[0, 1])


def test_warnings_of_the_engine_are_notes_and_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    huge = '<hfield name="h" nrow="60000" ncol="60000" size="1 1 1 1"/>'
    with pytest.raises(FileFormatError, match="it is damaged"):
        Simulation(written(tmp_path, PLANK.format(3), assets=huge))
    # After that MuJoCo would hang at its next warning, in the same process.
    path = written(tmp_path, PLANK.format(3).replace("<geom", '<geom rgba="nan 0 0 1"'))
    notes = Simulation(path).notes
    assert [note for note in notes if "MuJoCo" in note] == [
        "MuJoCo warns: XML contains a 'NaN'. Please check it carefully."
    ]
    far = path.read_text().replace("0 0 .15", "0 0 1e26")
    path.write_text(far.replace("nan", "0"))
    with pytest.raises(SimulationError, match=r"body_pos holds 1e\+26: .* within 1e9 m"):
        Simulation(path)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]
