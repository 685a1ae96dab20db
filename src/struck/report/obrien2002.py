"""The five scenes of O'Brien, Shen & Gatchalian (2002), with the constants of their Table 1.

The paper gives materials, the lengths of the chimes and the sizes of blocks and boxes. What it does
not give was chosen: the bowl, the figurine, the places of all. Its printed base frequencies are not
aimed at. Each scene is a MuJoCo file in a folder, simulated, rendered and drawn.
"""

# MuJoCo is compiled, and has no stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import html
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from struck.analysis.analysis import analyze
from struck.ears.listeners import Binaural
from struck.errors import require_choice
from struck.files.atomic import make_folder, write_bytes
from struck.files.sound import Sound
from struck.model.arrays import Array, checked
from struck.model.damping import Rayleigh
from struck.model.material import Material
from struck.model.mesh import Mesh
from struck.model.model import ModalModel
from struck.model.picture_style import in_default_style
from struck.model.provenance import Progress, silent
from struck.report.charts import save as save_picture
from struck.report.contact_sheet import contact_sheet
from struck.report.figurine import bird, written
from struck.scene.animation import save_animation
from struck.scene.body import Scene
from struck.scene.contacts import Contacts
from struck.scene.engines.simulation import Simulation
from struck.scene.events import events_of
from struck.scene.log_files import save_contacts
from struck.scene.render import render
from struck.scene.stems import save_stems
from struck.solids import Block, Extrusion, Tube
from struck.solids.revolution import bowl

if TYPE_CHECKING:
    import mujoco

# Table 1: lambda and mu, Pa; alpha_1 of the stiffness, s, and alpha_2 of the mass, 1/s; kg/m^3.
TABLE1: Mapping[str, tuple[float, float, float, float, float]] = {
    "chime": (4.98e10, 2.57e10, 1e-7, 0.0, 2700.0),
    "bowl 1": (4.98e9, 2.57e9, 1e-7, 30.0, 2700.0),
    "bowl 2": (5.00e8, 1.00e8, 8e-6, 50.0, 750.0),
    "bunny, ceramic": (3.99e9, 2.05e9, 1e-6, 10.0, 2700.0),
    "plastic shelf": (2.49e10, 1.28e10, 1e-6, 50.0, 2700.0),
    "aluminium shelf": (4.98e10, 2.56e10, 1e-7, 0.0, 2700.0),
    "wood shelf": (5.00e8, 1.00e8, 8e-6, 50.0, 750.0),
    "blocks": (5.00e8, 1.00e8, 8e-6, 50.0, 550.0),
    "the end": (1.49e9, 7.70e8, 2e-7, 30.0, 2700.0),
}
# Table 2: adjusted lengths of the chimes, m.
CHIMES = {"d3": 0.5061, "e3": 0.4770, "g3": 0.4366, "a4": 0.4115, "b4": 0.3878, "d4": 0.3548}
_RADIUS, _WALL, _NODE = 0.0125, 0.001, 0.224  # of a chime, m; where it hangs, of its length
_BLOCK = 0.05  # m
_SOFT = (20.0, 8000.0)  # Hz: above it materials of alpha_1 = 8e-6 ring for less than a millisecond
_CLAPPER = (
    '<body name="clapper" pos="0 0 1"><joint type="ball" damping="2e-4"/>'
    '<geom type="cylinder" size=".035 .006" pos="0 0 -.32" mass=".06"/>'
    '<geom type="box" size=".045 .002 .045" pos="0 0 -.62" mass=".01" contype="0" '
    'conaffinity="0"/></body>'
)
# Shelves of the chute: row of Table 1, place of the middle, m, tilt, degrees, and band, Hz.
_SHELF = (0.34, 0.24, 0.012)
_SHELVES = {
    "plastic": ("plastic shelf", (-0.1, 0, 0.75), 24, _SOFT),
    "aluminium": ("aluminium shelf", (0.17, 0, 0.47), -24, (20.0, 16_000.0)),
    "wood": ("wood shelf", (-0.1, 0, 0.19), 22, (20.0, 3000.0)),
}
_RING = 1.5  # s, heard after motion ends
_OPTIONS = '<option timestep="0.001" integrator="implicitfast"/>'


@dataclass(frozen=True, kw_only=True, eq=False)
class Staged:
    """One scene, ready to be simulated."""

    name: str
    title: str
    text: str
    mjcf: str
    materials: Mapping[str, str | Material] = field(default_factory=dict)
    models: Mapping[str, Any] = field(default_factory=dict)
    mute: tuple[str, ...] = ()
    restitution: float | str = "materials"
    seconds: float = 4.0
    listener: tuple[float, float, float] = (0.0, -1.2, 0.6)
    control: Callable[[mujoco.MjModel, mujoco.MjData], None] | None = None
    keyframe: str | None = None
    again: Mapping[str, Mapping[str, ModalModel]] = field(default_factory=dict)  # same motion

    @property
    def ears(self) -> Binaural:
        """The listener of the scenes."""
        return Binaural(position=self.listener, facing=(0.0, 1.0, 0.0))


@dataclass(frozen=True, kw_only=True, eq=False)
class Played:
    """Results of a scene: its sound, notes and files."""

    staged: Staged
    scene: Scene
    contacts: Contacts
    sounds: Mapping[str, Sound]  # by the names of their files


def constants(name: str) -> Material:
    """Return a row of Table 1."""
    first, shear, stiffness, mass, density = TABLE1[name]
    # The decay rates that the table prints are all that the paper's bodies lose.
    damping = Rayleigh(mass=mass, stiffness=stiffness, contains_air=True)
    return Material.from_lame(first=first, shear=shear, density=density, damping=damping, name=name)


@checked
def scene2002(
    name: str,
    folder: Path,
    *,
    accuracy: str = "standard",
    stems: bool = False,
    progress: Progress = silent,
) -> list[Path]:
    """Compute one of the scenes of 2002: sounds, contact log, animation and pictures in a folder.

    Parameters
    ----------
    name : {"chimes", "bowl", "chute", "blocks", "boxes", "the_end"}
        Name of the scene.
    folder : Path
        Folder, which is created if it does not exist.
    accuracy : str, default "standard"
        As for `struck.analyze`.
    stems : bool, default False
        Write also the sound of each body.
    progress : callable, optional
        Called as ``progress(stage, fraction)``. Default: silent.

    Returns
    -------
    list of Path
        The sounds; the other files have their names.

    Raises
    ------
    OptionError
        If the name is another.
    MissingDependencyError
        If MuJoCo is not installed.
    """
    require_choice("name", name, SCENES)
    make_folder(folder, parents=True)
    played = _played(SCENES[name](folder, accuracy), folder, accuracy, progress)
    return _saved(played, folder, stems=stems)


def ready(staged: Staged, folder: Path, accuracy: str, progress: Progress = silent) -> Simulation:
    """Return the simulation of a scene, whose file is written to a folder."""
    path = folder / f"{staged.name}.xml"
    write_bytes(path, staged.mjcf.encode())
    return Simulation(
        path,
        materials=staged.materials,
        models=staged.models,
        mute=staged.mute,
        restitution=staged.restitution,
        keyframe=staged.keyframe,
        accuracy=accuracy,
        progress=progress,
    )


def _played(staged: Staged, folder: Path, accuracy: str, progress: Progress) -> Played:
    """Simulate and render a scene."""
    simulation = ready(staged, folder, accuracy, progress)
    scene, contacts = simulation.run(staged.seconds, control=staged.control, progress=progress)
    progress("computing the sound", 0.0)
    scenes = {staged.name: scene} | {
        f"{staged.name}_{name}": _remodelled(scene, models) for name, models in staged.again.items()
    }
    sounds = {
        name: render(scene, contacts, listener=staged.ears, seconds=staged.seconds + _RING)
        for name, scene in scenes.items()
    }
    return Played(staged=staged, scene=scene, contacts=contacts, sounds=sounds)


def _remodelled(scene: Scene, models: Mapping[str, ModalModel]) -> Scene:
    """Return the same motion of bodies with other models."""
    bodies = {
        name: replace(body, model=models.get(name, body.model))
        for name, body in scene.bodies.items()
    }
    return replace(scene, bodies=bodies)


def _saved(played: Played, folder: Path, *, stems: bool = False) -> list[Path]:
    """Write all that came of a scene, and return its sounds."""
    staged, base = played.staged, folder / played.staged.name
    paths, seconds = [folder / f"{name}.wav" for name in played.sounds], staged.seconds
    factors = [
        sound.save(path, encoding="int24")
        for path, sound in zip(paths, played.sounds.values(), strict=True)
    ]
    if stems:
        excitations = events_of(played.scene, played.contacts).on()
        options = {"listener": staged.ears, "seconds": seconds + _RING}
        paths += save_stems(excitations, paths[0], factor=factors[0], **options)
    save_contacts(played.contacts, base.with_suffix(".npz"))
    save_animation(played.scene, base.with_suffix(".glb"), seconds=seconds)
    first = next(iter(played.sounds.values()))
    sheet = contact_sheet(events_of(played.scene, played.contacts), first, seconds=seconds)
    save_picture(sheet, base.with_suffix(".png"))
    return paths


def scene_sections(folder: Path, progress: Progress = silent) -> Iterator[str]:
    """Make all scenes at preview accuracy, and yield the HTML that shows and plays each.

    Their files are in the folder "scenes", as bodies of the gallery have some of the same names.
    """
    files = make_folder(folder / "scenes")
    for name, make in SCENES.items():
        staged = make(files, "preview")

        def report_progress(stage: str, fraction: float, title: str = staged.title) -> None:
            progress(f"{title}: {stage}", fraction)

        paths = _saved(_played(staged, files, "preview", report_progress), files)
        sounds = "".join(
            f'<figure><figcaption>{path.stem}</figcaption><audio controls src="scenes/{path.name}">'
            "</audio></figure>"
            for path in paths
        )
        yield (
            f"<section><h2>{html.escape(staged.title)}</h2><p>{html.escape(staged.text)} "
            f'<a href="scenes/{name}.glb">animation (GLB)</a>, '
            f'<a href="scenes/{name}.xml">scene (MJCF)</a></p>'
            f'{sounds}<img src="scenes/{name}.png" alt="{html.escape(staged.title)}" '
            'style="max-width:100%"></section>'
        )


# Chimes.


def _chimes(_folder: Path, accuracy: str) -> Staged:
    """Return six chimes in a ring, and a clapper among them whose sail hangs in the wind."""
    parts, tendons, models = [], [], {}
    for number, (name, length) in enumerate(CHIMES.items()):
        angle = np.deg2rad(60 * number)
        x, y = 0.068 * np.cos(angle), 0.068 * np.sin(angle)
        hang = (0.5 - _NODE) * length
        z = 1.0 - 0.06 - hang
        parts.append(
            f'<site name="roof {name}" pos="{x} {y} 1"/><body name="{name}" pos="{x} {y} {z}">'
            f'<freejoint/><geom type="cylinder" size="{_RADIUS} {length / 2}"/>'
            f'<site name="hole {name}" pos="0 0 {hang}"/></body>'
        )
        tendons.append(
            f'<spatial limited="true" range="0 0.0602" solreflimit="0.004 1">'
            f'<site site="roof {name}"/><site site="hole {name}"/></spatial>'
        )
        models[name] = analyze(
            Tube(length=length, radius=_RADIUS, wall=_WALL),
            constants("chime"),
            accuracy=accuracy,
            progress=None,
        )
    return Staged(
        name="chimes",
        title="Wind chimes",
        text="Six aluminium tubes of Table 2's adjusted lengths, hung at the nodes of their lowest "
        "modes, and a wooden clapper whose sail hangs in gusts of wind.",
        mjcf=_mjcf(
            "".join(parts) + _CLAPPER,
            f"<tendon>{''.join(tendons)}</tendon>",
            '<option timestep="0.001" integrator="implicitfast" density="1.2" viscosity="1.8e-5"/>',
        ),
        models=models,
        materials={"clapper": "oak", "*": constants("chime")},
        mute=("clapper",),
        seconds=8.0,
        listener=(0.0, -0.9, 0.8),
        control=_wind(8.0),
    )


def _wind(seconds: float) -> Callable[[mujoco.MjModel, mujoco.MjData], None]:
    """Return gusts on the clapper's sail: drag of a plate in air that comes and goes."""
    chance = np.random.default_rng(2002)
    # Two components of air speed with a memory of half a second about a mean, m/s.
    step, memory, count = 0.01, 0.5, int(seconds / 0.01) + 2
    keep = np.exp(-step / memory)
    air = np.zeros((count, 2))
    for number in range(1, count):
        shock = chance.standard_normal(2) * 2.2 * np.sqrt(1 - keep**2)
        air[number] = keep * air[number - 1] + shock
    air = np.pad(air + np.array([1.5, 1.0]), ((0, 0), (0, 1)))
    area, arm, drag = 0.09**2, np.array([0.0, 0.0, -0.62]), 0.5 * 1.2 * 1.2

    def blow(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        body = model.body("clapper").id
        turn = data.xmat[body].reshape(3, 3)
        lever = turn @ arm
        spin = turn @ data.qvel[model.body_dofadr[body] :][:3]
        wind = air[min(int(data.time / step), count - 1)] - _cross(spin, lever)
        force = drag * area * np.sqrt(wind @ wind) * wind
        data.xfrc_applied[body, 3:] = _cross(lever, force)  # about the joint

    return blow


def _cross(a: Array, b: Array) -> Array:
    """Return the cross product of two vectors, in a tenth of the time that NumPy's takes."""
    (x, y, z), (u, v, w) = a.tolist(), b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])


# Bowl.


def _bowl(folder: Path, accuracy: str) -> Staged:
    """Return a bowl that is dropped on its rim and rolls on it, in two materials."""
    solid = bowl(radius=0.09, height=0.055, wall=0.004)
    written(solid.volume_mesh("preview").surface()[0], folder / "bowl.obj")
    bands = {"bowl 1": (20.0, 16_000.0), "bowl 2": (20.0, 5000.0)}
    made = {
        name: analyze(solid, constants(name), band=band, accuracy=accuracy, progress=None)
        for name, band in bands.items()
    }
    body = (
        '<body name="bowl" pos="0 0 .16" euler="0 68 0"><freejoint/>'
        '<geom type="mesh" mesh="bowl" friction=".5 .002 .0005" condim="6"/></body>'
    )
    return Staged(
        name="bowl",
        title="A bowl in two materials",
        text="The same motion twice: dropped on its rim, rolling on it, and coming to rest; once "
        "with the constants of Bowl 1 (aluminium), once with those of Bowl 2 (oak).",
        mjcf=_mjcf(
            _table(0.5, 0.4) + body,
            '<keyframe><key name="go" qpos="0 0 .16 .829 0 .559 0" qvel="0 .5 0 0 0 7"/>'
            "</keyframe>",
            assets='<mesh name="bowl" file="bowl.obj"/>',
        ),
        models={"bowl": made["bowl 1"], "table": _slab(1.0, 0.8, accuracy)},
        seconds=4.0,
        keyframe="go",
        again={"oak": {"bowl": made["bowl 2"]}},
    )


# Chute.


def _chute(folder: Path, accuracy: str) -> Staged:
    """Return hollow figurines that fall down a chute of three shelves."""
    figure = bird()
    written(figure, folder / "bird.obj")
    models: dict[str, Any] = {
        name: analyze(
            Block(size=_SHELF), constants(row), band=band, accuracy=accuracy, progress=None
        )
        for name, (row, _, _, band) in _SHELVES.items()
    }
    path = folder / "bird.obj"
    models["bird*"] = analyze(
        path,
        constants("bunny, ceramic"),
        up="z",
        wall=0.004,
        band=_SOFT,
        accuracy=accuracy,
        progress=None,
    )
    parts = [
        f'<body name="{name}" pos="{x} {y} {z}" euler="0 {tilt} 0">'
        f'<geom type="box" size="{_SHELF[0] / 2} {_SHELF[1] / 2} {_SHELF[2] / 2}"/></body>'
        for name, (_, (x, y, z), tilt, _) in _SHELVES.items()
    ]
    parts += [
        f'<body name="bird {n + 1}" pos="{-0.16 + 0.01 * n} {0.03 * (n % 2) - 0.015} '
        f'{0.92 + 0.19 * n}" euler="{15 * n} {20 - 10 * n} {40 * n}"><freejoint/>'
        '<geom type="mesh" mesh="bird" friction=".25 .002 .0001"/></body>'
        for n in range(3)
    ]
    return Staged(
        name="chute",
        title="Figurines down a chute",
        text="Three hollow ceramic birds of the project's own fall down shelves of plastic, "
        "aluminium and wood, which sound as well.",
        mjcf=_mjcf(
            "".join(parts) + '<geom name="ground" type="plane" size="2 2 .1" pos="0 0 -.25"/>',
            assets='<mesh name="bird" file="bird.obj"/>',
        ),
        models=models,
        materials={"ground": "rubber"},
        restitution=0.4,
        seconds=4.0,
        listener=(0.0, -1.3, 0.6),
    )


# Blocks and boxes.


def _stack(_folder: Path, accuracy: str, *, times: float = 1.0) -> Staged:
    """Return a stack of hollow cubes that is knocked over, small or ten times as large."""
    edge, root = _BLOCK * times, np.sqrt(times)
    cube = _cube(_BLOCK)
    model = analyze(
        cube, constants("blocks"), wall=0.05 * _BLOCK, band=_SOFT, accuracy=accuracy, progress=None
    )
    rows = [(row, column) for row in range(4) for column in range(4 - row)]
    parts = [
        f'<body name="cube {n + 1}" pos="{(c - (3 - r) / 2) * 1.04 * edge} 0 '
        f'{(r + 0.5) * edge}"><freejoint/>'
        f'<geom type="box" size="{edge / 2} {edge / 2} {edge / 2}" friction=".5"/></body>'
        for n, (r, c) in enumerate(rows)
    ]
    ball = (
        f'<body name="ball" pos="{-6 * edge} {0.2 * edge} {2.2 * edge}"><freejoint/>'
        f'<geom size="{0.7 * edge}" mass="{0.35 * times**3}"/></body>'
    )
    still = " ".join("0 0 0 0 0 0" for _ in rows)
    key = f'<keyframe><key name="go" qvel="{still} {2.6 * root} 0 {0.9 * root} 0 0 0"/></keyframe>'
    floor = f'<geom name="floor" type="plane" size="{40 * edge} {40 * edge} .1"/>'
    small = times == 1
    return Staged(
        name="blocks" if small else "boxes",
        title="A stack of 5 cm blocks" if small else "A stack of 50 cm boxes",
        text="Ten hollow cubes, their walls 5 % of their width, knocked over by a ball."
        + ("" if small else " Ten times as large as the blocks, all else alike."),
        mjcf=_mjcf(floor + "".join(parts) + ball, key),
        models={"cube*": model if small else model.scaled(times)},
        materials={"ball": "rubber", "floor": "concrete"},
        mute=("ball", "floor"),
        keyframe="go",
        restitution=0.35,
        seconds=2.5 if small else 5.0,
        listener=(0.0, -1.2, 0.4) if small else (0.0, -7.0, 1.7),
    )


def _cube(edge: float) -> Mesh:
    import trimesh

    solid = trimesh.creation.box((edge, edge, edge))
    return Mesh(points=np.asarray(solid.vertices), faces=np.asarray(solid.faces, np.int64))


# Letters.


def _the_end(folder: Path, accuracy: str) -> Staged:
    """Return the letters of "The End", cut out of a plate, which fall and lie."""
    models, assets, parts, x = {}, [], [], 0.0
    for number, letter in enumerate("TheEnd"):
        solid, width = _letter(letter)
        name = f"{letter} {number + 1}"
        written(solid.volume_mesh("preview").surface()[0], folder / f"letter{number}.obj")
        assets.append(f'<mesh name="{name}" file="letter{number}.obj"/>')
        row, lift = divmod(number, 3)
        parts.append(
            f'<body name="{name}" pos="{x - 0.19} {0.05 - 0.16 * row} {0.12 + 0.11 * lift}" '
            f'euler="{70 - 15 * lift} {10 * lift} 0"><freejoint/>'
            f'<geom type="mesh" mesh="{name}"/></body>'
        )
        x = 0.0 if number == 2 else x + width + 0.02
        models[name] = analyze(
            solid, constants("the end"), band=_SOFT, accuracy=accuracy, progress=None
        )
    return Staged(
        name="the_end",
        title="The End",
        text="Letters of matplotlib's own font (DejaVu Sans Bold), 12 cm high and 2 cm thick, fall "
        "on a table and lie.",
        mjcf=_mjcf(_table(0.6, 0.5) + "".join(parts), assets="".join(assets)),
        models={**models, "table": _slab(1.2, 1.0, accuracy)},
        restitution=0.4,
        seconds=2.5,
    )


@in_default_style
def _letter(letter: str) -> tuple[Extrusion, float]:
    """Return a letter as a plate, and its width, m."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    bold = FontProperties(family="DejaVu Sans", weight="bold")
    path = TextPath((0, 0), letter, size=1.0, prop=bold)
    loops = [_thinned(np.asarray(loop)[:-1]) for loop in path.to_polygons()]
    scale = 0.12 / 0.73  # the font's capitals are 0.73 high
    loops = sorted((loop * scale for loop in loops), key=_area, reverse=True)
    width = float(np.ptp(loops[0][:, 0]))
    return Extrusion(outline=loops[0], holes=tuple(loops[1:]), height=0.02), width


def _thinned(loop: Array) -> Array:
    """Leave out points closer than 3 % of the font's size to the one before."""
    points = [loop[0]]
    for point in loop[1:]:
        if np.linalg.norm(point - points[-1]) > 0.03:
            points.append(point)
    if np.linalg.norm(points[-1] - points[0]) < 0.03:
        points.pop()
    return np.array(points)


def _area(loop: Array) -> float:
    x, y = loop.T
    return abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))) / 2


# What scenes have in common.


def _table(x: float, y: float) -> str:
    """Return a table, its top at height 0, half as wide as said along x and y."""
    return f'<geom name="table" type="box" size="{x} {y} .02" pos="0 0 -.02"/>'


def _slab(x: float, y: float, accuracy: str) -> ModalModel:
    """Return the model of a table's top of granite, of modes up to 4 kHz."""
    return analyze(
        Block(size=(x, y, 0.04)), "granite", band=(20.0, 4000.0), accuracy=accuracy, progress=None
    )


def _mjcf(world: str, rest: str = "", options: str = _OPTIONS, *, assets: str = "") -> str:
    return (
        f"<mujoco>{options}<asset>{assets}</asset><worldbody>{world}</worldbody>{rest}</mujoco>\n"
    )


SCENES: Mapping[str, Callable[[Path, str], Staged]] = {
    "chimes": _chimes,
    "bowl": _bowl,
    "chute": _chute,
    "blocks": _stack,
    "boxes": partial(_stack, times=10.0),
    "the_end": _the_end,
}
