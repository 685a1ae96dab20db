"""Make the seeds: small valid files of every format that is read, by struck and other writers.

`python -m tests.fuzz.seeds` writes `corpus/seeds`; needed when a format changes, as a seed that is
refused shows nothing.
"""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import meshio
import numpy as np
import soundfile
import trimesh

import struck
from struck.files.container import to_bytes
from struck.files.sofa import Variable, metres, write_container
from struck.files.sofa_fields import save_sofa_responses
from struck.model import Survey, TimbreField
from struck.model.model import ModalModel
from struck.recordings.fit import fit_recordings
from struck.scene import Contacts, Poses, save_contacts
from struck.shapes import Bar, CircularMembrane
from struck.solids import Block
from tests.files.test_radiating_model_file import with_a_skin
from tests.fuzz.mutations import PACKINGS
from tests.fuzz.targets import KEY, SEEDS
from tests.radiation.sources import radiating_ball
from tests.scene.tumbling import cube, tumble, write_glb

RATE = 8000
LISTENERS = np.array([[1.0, 0.0, 0.1], [0.0, 1.2, 0.0]])


def _models() -> dict[str, ModalModel]:
    """Return a model of each kind: formula, elements, one point, recorded and computed field."""
    bar = struck.analyze(Bar(length=0.3, width=0.03, thickness=0.005), "steel", band=(20, 8000))
    membrane = CircularMembrane(radius=0.1, thickness=1e-3, tension=3000.0)
    block = Block(size=(0.2, 0.03, 0.01), elements=(4, 1, 1))
    sound = struck.render(bar, struck.Strike(), seconds=0.2, sample_rate=RATE)
    fitted = fit_recordings(sound, modes=3, residual=True, force=True, cache=False).model
    chance = np.random.default_rng(1)
    frequencies = np.array([300.0, 700.0])
    gains = chance.normal(size=(6, 8, 2)) + 1j * chance.normal(size=(6, 8, 2))
    survey = Survey.full(chance.random((6, 1)), 1 + chance.random((8, 3)), gains, frequencies)
    field = replace(
        fitted,
        gains=TimbreField.of(survey),
        errors=None,
        coordinates=("height",),
        places={},
        frequencies=frequencies,
        natural_frequencies=frequencies,
        decays=np.ones(2),
    )
    return {
        "bar": bar,
        "membrane": struck.analyze(membrane, "steel", band=(20, 130)),
        "block": struck.analyze(block, "oak", band=(20, 5000)),
        "fitted": fitted,
        "field": field,
        "ball": with_a_skin(radiating_ball(subdivisions=0)[0]),
    }


def write_models(folder: Path) -> None:
    models = _models()
    for name, model in models.items():
        struck.save(model, folder / f"{name}.struck")
    field = models["field"]
    struck.save(field, folder / "gains.sofa", contacts=[[0.2], [0.4]], listeners=LISTENERS)
    places = {"contacts": [[0.2], [0.4]], "listeners": LISTENERS}
    save_sofa_responses(field, folder / "responses.sofa", seconds=0.02, sample_rate=RATE, **places)
    solid = trimesh.creation.box((0.2, 0.1, 0.01))
    mesh = struck.Mesh(points=np.asarray(solid.vertices), faces=np.asarray(solid.faces))
    (folder / "mesh.safetensors").write_bytes(to_bytes(mesh, (struck.Mesh,)))
    # That of an analyzed body has thousands of triangles.
    sound_map = struck.SoundMap(
        frequencies=np.array([440.0, 900.0]),
        decays=np.array([2.0, 3.0]),
        contacts=mesh.points[:2],
        directions=np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]),
        gains=np.array([[1.0 + 1j, 2.0], [0.5, 1.0]]),
        calibrated=True,
        listener=LISTENERS[0],
        level=85.0,
        threshold=3.0,
        bound=2.5,
        surface=mesh,
        owners=np.arange(12) % 2,
        factors=np.ones((12, 3)),
        brightness=np.full((12, 3), 700.0),
    )
    sound_map.save(folder / "map.safetensors")
    cache = struck.files.Cache(folder / "cache")
    cache.put(KEY, (folder / "mesh.safetensors").read_bytes())
    cache.entries()[0].path.rename(folder / "mesh.cached")


def write_head(folder: Path) -> None:
    """Write a measured head of twelve directions."""
    chance = np.random.default_rng(4)
    directions = 1.5 * trimesh.creation.icosahedron().vertices
    directions *= 1.5 / np.linalg.norm(directions, axis=1, keepdims=True)
    ears, origin = np.array([[0.0, 0.09, 0.0], [0.0, -0.09, 0.0]]), np.zeros((1, 3))
    variables = {
        "Data.IR": Variable(chance.normal(size=(12, 2, 32)) * 0.5 ** np.arange(32), "MRN"),
        "Data.SamplingRate": Variable(np.array([48000.0]), "I", {"Units": "hertz"}),
        "Data.Delay": Variable(np.zeros((1, 2)), "IR"),
        "ListenerPosition": metres(origin, "IC"),
        "ListenerView": metres(np.array([[1.0, 0.0, 0.0]]), "IC"),
        "ListenerUp": metres(np.array([[0.0, 0.0, 1.0]]), "IC"),
        "SourcePosition": metres(directions, "MC"),
        "ReceiverPosition": metres(ears, "RC"),
        "EmitterPosition": metres(origin, "EC"),
    }
    kind = {"SOFAConventions": "SimpleFreeFieldHRIR", "SOFAConventionsVersion": "1.0"}
    texts = {"DataType": "FIR", "Title": "Chance", "License": "CC0-1.0", "RoomType": "free field"}
    write_container(folder / "head.sofa", variables, {**kind, **texts})


def write_sounds(folder: Path) -> None:
    time = np.arange(1200) / RATE
    samples = 0.5 * np.exp(-20 * time) * np.sin(2 * np.pi * 700 * time)
    sound = struck.Sound(samples=samples, sample_rate=RATE)
    for encoding in ("float32", "int24", "int16"):
        sound.save(folder / f"{encoding}.wav", encoding=encoding)
    for ending in ("flac", "aiff"):
        sound.save(folder / f"sound.{ending}", encoding="int16")
    for ending in ("ogg", "mp3"):
        struck.Sound(samples=np.tile(samples, 2), sample_rate=16_000).save(
            folder / f"sound.{ending}"
        )
    stereo = np.stack([samples, samples[::-1]], axis=1)
    soundfile.write(folder / "sound.rf64", stereo, RATE, format="RF64", subtype="PCM_16")


def write_logs(folder: Path) -> None:
    poses = Poses(
        time=[0.0, 0.5],
        body=[1, 1],
        position=[[0.0, 0.0, 0.1], [0.0, 0.0, 0.05]],
        rotation=[[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]],
    )
    log = Contacts(
        names=["floor", "block"],
        time=[0.1, 0.2, 0.4],
        dt=[0.001, 0.001, 0.002],
        body0=[0, 0, 1],
        body1=[1, 1, 0],
        position=np.eye(3) / 10,
        normal=np.tile([0.0, 0.0, 1.0], (3, 1)),
        impulse=np.eye(3) / 100,
        velocity=np.eye(3),
        id=[0, 1, 1],
        poses=poses,
    )
    for ending in ("csv", "jsonl", "npz"):
        save_contacts(log, folder / f"log.{ending}")
    text = (folder / "log.csv").read_text(encoding="utf-8")
    lines = [line if line[:1] == "#" else line.replace(",", ";") for line in text.splitlines()]
    decimal = [line if line[:1] == "#" else re.sub(r"(\d)\.(\d)", r"\1,\2", line) for line in lines]
    (folder / "semicolons.csv").write_text("\n".join([*decimal, ""]), encoding="utf-8")


def write_surfaces(folder: Path) -> None:
    box, other = trimesh.creation.box((1, 2, 3)), trimesh.creation.box((1, 1, 1))
    for ending in ("obj", "off", "stl", "ply", "glb"):
        box.export(folder / f"box.{ending}")
    (folder / "ascii.stl").write_text(trimesh.exchange.stl.export_stl_ascii(box), encoding="ascii")
    (folder / "ascii.ply").write_bytes(trimesh.exchange.ply.export_ply(box, encoding="ascii"))
    gltf = box.export(file_type="gltf", embed_buffers=True)["model.gltf"]
    (folder / "box.gltf").write_bytes(gltf)
    scene = trimesh.Scene({"a": box, "b": other.copy().apply_translation((4, 0, 0))})
    scene.export(folder / "two.glb")
    crossing = trimesh.util.concatenate([box, other.copy().apply_translation((0.4, 0, 0))])
    crossing.export(folder / "crossing.obj")
    for packing, (pack, _) in PACKINGS.items():
        (folder / f"box.obj.{packing}").write_bytes(pack((folder / "box.obj").read_bytes()))
    ball = trimesh.creation.icosphere(subdivisions=1)
    ball.update_faces(np.arange(len(ball.faces)) > 1)
    ball.export(folder / "torn.obj")
    box.update_faces(np.arange(len(box.faces)) > 1)
    box.export(folder / "open.obj")


def write_animations(folder: Path) -> None:
    bodies = [cube(np.random.default_rng(2), np.array([0.0, 0.0, 0.3]))]
    bodies[0].mesh = trimesh.creation.box((0.1, 0.1, 0.1))
    tumble(bodies, 0.1)
    write_glb(bodies, 60.0, folder / "moving.glb")
    data = (folder / "moving.glb").read_bytes()
    end = 20 + int.from_bytes(data[12:16], "little")
    header = json.loads(data[20:end])
    text = base64.b64encode(data[end + 8 :]).decode()
    header["buffers"][0]["uri"] = f"data:application/octet-stream;base64,{text}"
    (folder / "moving.gltf").write_text(json.dumps(header), encoding="utf-8")


def write_volumes(folder: Path) -> None:
    corners = np.array([(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))])
    points = np.concatenate([corners, corners + np.array([0, 0, 1])]).astype(float)
    cells = [("hexahedron", np.array([np.arange(8), np.arange(8, 16)]))]
    mesh = meshio.Mesh(points, cells)
    mesh.write(folder / "ascii.vtk", file_format="vtk", binary=False)
    mesh.write(folder / "binary.vtk", file_format="vtk", binary=True)
    mesh.write(folder / "ascii.vtu", file_format="vtu", binary=False)
    mesh.write(folder / "packed.vtu", file_format="vtu", binary=True)
    mesh.write(folder / "two.msh", file_format="gmsh22", binary=False)
    mesh.write(folder / "four.msh", file_format="gmsh", binary=False)
    mesh.write(folder / "binary.msh", file_format="gmsh", binary=True)
    mesh.write(folder / "hexahedra.inp", file_format="abaqus")


TEXTS = {
    "scene.xml": """<mujoco model="table">
 <compiler angle="degree" meshdir="."/>
 <option timestep="0.002" gravity="0 0 -9.81"/>
 <default><geom friction="0.8 0.005 0.0001" density="700"/></default>
 <asset><mesh name="cup" file="cup.stl" scale="0.1 0.1 0.1"/><material name="oak"/></asset>
 <worldbody>
  <geom name="floor" type="plane" size="2 2 0.1" material="oak"/>
  <include file="part.xml"/>
  <body name="cup" pos="0 0 0.5" quat="1 0 0 0"><freejoint/><geom type="mesh" mesh="cup"/></body>
  <body name="arm" pos="1 0 0.5"><joint name="hinge" type="hinge" axis="0 1 0" range="-45 45"/>
   <geom type="capsule" fromto="0 0 0 0 0 0.3" size="0.02"/>
   <body name="hand" pos="0 0 0.3"><joint type="slide" axis="0 0 1"/>
    <geom type="box" size="0.03 0.02 0.01"/></body></body>
 </worldbody>
 <actuator><motor joint="hinge" gear="1"/></actuator>
 <keyframe><key name="home" qpos="0 0 0.6 1 0 0 0 0 0 0 0 0.7 1 0 0 0"/></keyframe>
</mujoco>
""",
    "part.xml": """<mujocoinclude>
 <body name="brick" pos="0 0.5 0.5"><freejoint/><geom type="box" size="0.1 0.05 0.03"/></body>
</mujocoinclude>
""",
    "robot.urdf": """<robot name="mug">
 <material name="clay"><color rgba="1 0.5 0 1"/></material>
 <link name="mug"><inertial><mass value="0.3"/>
  <inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial>
  <visual><origin xyz="0 0 0" rpy="0 0 0"/><geometry><mesh filename="package://x/cup.stl"
   scale="0.1 0.1 0.1"/></geometry><material name="clay"/></visual>
  <collision><geometry><sphere radius="0.03"/></geometry></collision></link>
 <link name="lid"><inertial><mass value="0.1"/>
  <inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><geometry><box size="0.05 0.05 0.01"/></geometry></collision></link>
 <joint name="hinge" type="revolute"><parent link="mug"/><child link="lid"/>
  <origin xyz="0 0 0.06"/><axis xyz="0 1 0"/><limit lower="0" upper="1" effort="1" velocity="1"/>
 </joint>
</robot>
""",
    "manifest.toml": """coordinates = ["height"]
centre = [0.0, 0.0, 0.1]
symmetry = "axial"
[[takes]]
file = "a.wav"
contact = [0.02]
listeners = [[1.0, 0.0, 0.1]]
hit = 1
sample_rate = 48000
lead_in = 0.5
[[takes]]
file = "b.wav"
contact = [0.05]
listeners = [[1.0, 0.0, 0.1]]
note = "struck twice"
""",
    "manifest.csv": """file,channel,u,v,x,y,z,hit,sample_rate,lead_in,note
a.wav,1,0.02,0.1,1.0,0.0,0.1,1,48000,0.5,first
a.wav,2,0.02,0.1,0.0,1.0,0.1,1,48000,0.5,first
b.wav,1,0.05,0.2,1.0,0.0,0.1,1,48000,0.5,"a, b"
""",
    "plan.toml": """seconds = 2.0
lead_in = 0.5
sample_rate = 48000
channels = 1
hits = 2
tries = 3
[levels]
quietest = -40
loudest = -3
[hooks]
move = ["move", "{contact}"]
timeout = 5.0
[[contacts]]
name = "rim"
at = [0.1]
[[contacts]]
name = "side"
at = [0.05]
[[listeners]]
name = "front"
at = [1.0, 0.0, 0.0]
""",
    "jobs.csv": """file,output,material,size,modes,band,repair,fixed
a.obj,a,oak,0.2,20,20 8000,true,0 0 0 0.1 0.1 0.1
b.stl,b/c,steel,,64,,false,
""",
    "jobs.toml": """[[files]]
file = "a.obj"
output = "a"
material = "oak"
modes = 20
band = [20, 8000.0]
repair = true
[[files]]
file = "b.stl"
wall = 0.002
fixed = [0, 0, 0, 0.1, 0.1, 0.1]
""",
    "strikes.csv": """at,time,impulse,seconds,striker
top,0,0.01,0.5,steel
"0.1,0,0",0.1,0.02,,wood
""",
    "strikes.toml": """[[strikes]]
at = "top"
impulse = 0.01
striker = "steel"
[[strikes]]
at = [0.1, 0.0, 0.0]
direction = [0.0, 0.0, -1.0]
striker = "wood"
speed = 1.5
""",
    "walk.csv": "0,1,0,0\n0.5,1,0.5,0\n1.5,0,2,0.1\n",
    "facts.json": json.dumps(
        {
            "key": "k",
            "warnings": ["repaired"],
            "parts": [],
            "modes": 3,
            "lowest": 440.0,
            "error": 0.001,
            "message": "",
            "cpu": 1.5,
            "memory": 1e8,
            "files": {"a.struck": 32},
            "labels": [{"sound": "a_0.wav", "at": "top", "impulse": 0.01}],
        }
    ),
}


def write_texts(folder: Path) -> None:
    for name, text in TEXTS.items():
        (folder / name).write_text(text, encoding="utf-8")


WRITERS: tuple[Callable[[Path], None], ...] = (
    write_models,
    write_head,
    write_sounds,
    write_logs,
    write_surfaces,
    write_animations,
    write_volumes,
    write_texts,
)


def main() -> Iterator[Path]:
    """Write all seeds, and yield their paths."""
    SEEDS.mkdir(parents=True, exist_ok=True)
    for write in WRITERS:
        with TemporaryDirectory() as folder:
            write(Path(folder))
            for path in sorted(path for path in Path(folder).iterdir() if path.is_file()):
                (SEEDS / path.name).write_bytes(path.read_bytes())
                yield SEEDS / path.name


if __name__ == "__main__":
    for written in main():
        print(f"{written.stat().st_size:7} {written.name}")  # noqa: T201 - a program
