"""Calls of the public names with arguments that are right; tests put others in their place."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

import struck
from struck import (
    analysis,
    ears,
    excitation,
    files,
    model,
    perception,
    radiation,
    recordings,
    report,
    scene,
    shapes,
    solids,
    synth,
)
from tests.excitation.recordings import recorded
from tests.scene.tumbling import cube, tumble, write_glb
from tests.yardstick import seconds_foretold, slowness

RATE = 8000
ON = (0.1, 0.0, 0.0025)
PATH = [ON, (0.2, 0.0, 0.0025)]


@dataclass(frozen=True, kw_only=True)
class Call:
    """A callable, arguments that it takes, and what is done with what it returns."""

    made: Callable[..., Any]
    given: Mapping[str, Any]
    use: Callable[[Any], object] | None = None
    dear: bool = False  # takes more than 0.3 s of a processor even with the right arguments
    long: bool = False  # may take minutes, of arguments that a person might give


@cache
def bar() -> struck.ModalModel:
    return struck.analyze(shapes.Bar(length=0.3, width=0.03, thickness=0.005), "steel")


@cache
def sheet() -> struck.ModalModel:
    plate = shapes.CircularPlate(radius=0.1, thickness=0.002, edge="clamped")
    return struck.analyze(plate, "steel", band=(20, 1500))


@cache
def vessel() -> struck.ModalModel:
    bowl = solids.bowl(radius=0.06, height=0.04, wall=0.002)
    return struck.analyze(bowl, "glass", accuracy="preview", band=(20, 5000))


@cache
def box() -> struck.Mesh:
    solid = trimesh.creation.box((0.2, 0.1, 0.01))
    return struck.Mesh(points=np.asarray(solid.vertices), faces=np.asarray(solid.faces))


@cache
def block() -> struck.ModalModel:
    return struck.analyze(solids.Block(size=(0.2, 0.03, 0.01)), "steel", accuracy="preview")


@cache
def sound() -> struck.Sound:
    strike = struck.Strike(at=(0.2804, 0.0, 0.0025), impulse=0.01)
    return struck.render(bar(), strike, seconds=0.3, sample_rate=RATE)


@cache
def fitting() -> recordings.Fitting:
    return recordings.fit_recordings(sound(), modes=4, cache=False)


@cache
def survey() -> model.Survey:
    chance = np.random.default_rng(3)
    contacts, listeners = chance.random((6, 2)), 1 + chance.random((5, 3))
    gains = chance.normal(size=(6, 5, 3)) + 1j * chance.normal(size=(6, 5, 3))
    return model.Survey.full(contacts, listeners, gains, np.array([300.0, 700.0, 900.0]))


@cache
def sound_map() -> struck.SoundMap:
    return struck.sound_map(bar(), 20.0)


@cache
def resonators() -> synth.Resonators:
    engine = synth.Resonators([bar()], block=16, sample_rate=RATE)
    engine.process([], [np.ones((1, len(bar().frequencies)))])
    return engine


def heard(made: Any) -> struck.Sound:  # noqa: ANN401 - of any excitation
    """Play an excitation: what comes out is finite."""
    return finite(struck.render(bar(), made, seconds=0.05, sample_rate=RATE))


def finite(made: struck.Sound) -> struck.Sound:
    assert np.isfinite(made.samples).all()
    return made


def sounding(made: struck.ModalModel) -> struck.Sound | None:
    """Strike a model: what comes out is finite."""
    if made.geometry is None and len(made.frequencies):
        return None
    return finite(struck.render(made, struck.Strike(), seconds=0.05, sample_rate=RATE))


def heard_by(made: Any) -> struck.Sound:  # noqa: ANN401 - of any listener
    blow = struck.Strike()
    return finite(struck.render(bar(), blow, listener=made, seconds=0.05, sample_rate=RATE))


def analyzed(made: Any) -> struck.Sound | None:  # noqa: ANN401 - of any shape
    return sounding(struck.analyze(made, "steel", band=(20.0, 2000.0)))


def cut(made: Any) -> np.ndarray:  # noqa: ANN401 - of any solid
    nodes = made.volume_mesh("preview").nodes
    assert np.isfinite(nodes).all()
    return nodes


def of_material(made: struck.Material) -> struck.Sound | None:
    return sounding(bar().made_of(made))


def damped(made: struck.Damping) -> struck.Sound | None:
    return sounding(bar().damped(made))


def foretold(**given: Any) -> struck.ModalModel:  # noqa: ANN401 - what an analysis takes
    """Analyze a body: it takes at most twice as long as it says, and what starting takes.

    The least of three times counts, as other programs on the machine only add to one.
    """
    times = []
    for _ in range(3):
        stages: list[str] = []
        begun = time.process_time()
        made = struck.analyze(**given, progress=lambda stage, _, to=stages: to.append(stage))
        times.append(time.process_time() - begun)
        if times[-1] < 2 * seconds_foretold(stages) + 2 * max(slowness(), 1.0):
            return made
    raise AssertionError(f"{times} s where {seconds_foretold(stages)} s were stated")


def hit_scene() -> scene.Scene:
    """Return the bar on a floor that is silent."""
    floor = scene.Body(model=scene.RigidBody())
    return scene.Scene(bodies={"floor": floor, "bar": scene.Body(model=bar())})


def hit() -> scene.Contacts:
    return scene.Contacts(
        names=["floor", "bar"],
        time=[0.01],
        body0=[0],
        body1=[1],
        position=[ON],
        impulse=[[0.0, 0.0, 0.1]],
    )


def moved() -> scene.Contacts:
    """Return the motion of the bar, which falls."""
    times = np.arange(12) / 60
    places = np.zeros((12, 2, 3))
    places[:, 1, 2] = 1 - 4.905 * times**2
    poses = scene.Poses.together(times, places, np.tile([1.0, 0, 0, 0], (12, 2, 1)))
    return scene.Contacts.of_motion(["floor", "bar"], poses)


def _animation_file(folder: Path) -> Path:
    """Return a GLB file in which a cube falls."""
    chance = np.random.default_rng(0)
    bodies = [cube(chance, np.array([0.0, 0.0, 1.0]))]
    tumble(bodies, 0.2)
    write_glb(bodies, 60.0, folder / "falls.glb")
    return folder / "falls.glb"


def _log_file(folder: Path) -> Path:
    """Return a file of a contact log."""
    scene.save_contacts(hit(), folder / "log.csv")
    return folder / "log.csv"


def on_floor(events: scene.Events) -> struck.Sound:
    return finite(struck.render(events.on(), seconds=0.05, sample_rate=RATE))


def inside(made: ears.Room) -> struck.Sound:
    heard_in = struck.Mono(position=(1.0, 1.0, 1.5))
    body = scene.Body(model=bar(), excitations=struck.Strike(), position=(2.0, 2.0, 1.0))
    options = {"listener": heard_in, "room": made, "seconds": 0.05, "sample_rate": RATE}
    return finite(struck.render([body], **options))


def fall(seconds: float, **options: Any) -> tuple[scene.Scene, scene.Contacts]:  # noqa: ANN401
    """Simulate a silent block that falls on the ground."""
    Path("fall.xml").write_text(
        "<mujoco><worldbody><geom type='plane' size='1 1 0.1'/><body name='block' pos='0 0 0.011'>"
        "<freejoint/><geom type='box' size='0.05 0.03 0.01'/></body></worldbody></mujoco>",
        "ascii",
    )
    return scene.Simulation("fall.xml", mute=["block"], **options).run(seconds)


MODES = {
    "points": box().points,
    "faces": box().faces,
    "frequencies": [400.0, 900.0],
    "shapes": np.random.default_rng(0).normal(size=(len(box().points), 3, 2)),
    "material": struck.Material.named("steel"),
    "mass": 1.0,
    "centre": (0.0, 0.0, 0.0),
    "inertia": np.eye(3),
}


def calls(folder: Path) -> dict[str, Call]:
    """Return a call of each public name that takes arguments."""
    return {
        **_shapes(),
        **_materials(),
        **_excitations(),
        **_ears(),
        **_models(folder),
        **_verbs(folder),
    }


def _shapes() -> dict[str, Call]:
    sheet = {"thickness": 2e-4, "tension": 5000.0}
    box_of = {"length": 0.3, "width": 0.2}
    return {
        "shapes.Bar": Call(
            made=shapes.Bar,
            given={
                "length": 0.3,
                "width": 0.03,
                "thickness": 0.005,
                "ends": "free",
                "theory": "timoshenko",
            },
            use=analyzed,
        ),
        "shapes.String": Call(
            made=shapes.String,
            given={"length": 0.6, "radius": 4e-4, "tension": 100.0, "stiff": True},
            use=analyzed,
        ),
        "shapes.CircularMembrane": Call(
            made=shapes.CircularMembrane, given={"radius": 0.15, **sheet}, use=analyzed
        ),
        "shapes.AnnularMembrane": Call(
            made=shapes.AnnularMembrane, given={"radius": 0.15, "hole": 0.03, **sheet}, use=analyzed
        ),
        "shapes.RectangularMembrane": Call(
            made=shapes.RectangularMembrane, given={**box_of, **sheet}, use=analyzed
        ),
        "shapes.PolygonMembrane": Call(
            made=shapes.PolygonMembrane,
            given={"corners": [(0, 0), (0.3, 0), (0.3, 0.2), (0, 0.2)], **sheet},
            use=analyzed,
            dear=True,
        ),
        "shapes.PolygonMembrane.l_shape": Call(
            made=shapes.PolygonMembrane.l_shape, given={"side": 0.1, **sheet}
        ),
        "shapes.CircularPlate": Call(
            made=shapes.CircularPlate,
            given={"radius": 0.1, "thickness": 2e-3, "edge": "free"},
            use=analyzed,
        ),
        "shapes.RectangularPlate": Call(
            made=shapes.RectangularPlate,
            given={**box_of, "thickness": 2e-3, "edges": "supported"},
            use=analyzed,
        ),
        "shapes.RectangularSection": Call(
            made=shapes.RectangularSection, given={"width": 0.03, "thickness": 0.005}
        ),
        "shapes.RoundSection": Call(
            made=shapes.RoundSection, given={"radius": 0.01, "wall": 0.001}
        ),
        "shapes.GivenSection": Call(
            made=shapes.GivenSection,
            given={"area": 1e-4, "second_moment": 1e-9, "shear_coefficient": 0.8},
        ),
        "solids.Block": Call(
            made=solids.Block, given={"size": (0.3, 0.2, 0.1), "elements": (2, 2, 2)}, use=cut
        ),
        "solids.Tube": Call(
            made=solids.Tube, given={"length": 0.3, "radius": 0.02, "wall": 0.002}, use=cut
        ),
        "solids.Extrusion": Call(
            made=solids.Extrusion,
            given={"outline": [(0, 0), (0.1, 0), (0.1, 0.1), (0, 0.1)], "height": 0.01},
            use=cut,
        ),
        "solids.Revolution": Call(
            made=solids.Revolution,
            given={"profile": [(0.0, 0.0), (0.05, 0.0), (0.06, 0.1)], "wall": 0.003},
            use=cut,
        ),
        "solids.bell": Call(made=solids.bell, given={"height": 0.2, "radius": 0.12}),
        "solids.bowl": Call(made=solids.bowl, given={"radius": 0.1, "height": 0.05}),
        "solids.wine_glass": Call(made=solids.wine_glass, given={"height": 0.2, "wall": 0.001}),
        "solids.Stem": Call(
            made=solids.Stem,
            given={
                "radii": [0.01, 0.005, 0.01],
                "foot": [(0.0, -0.1), (0.04, -0.1)],
                "foot_wall": 0.003,
            },
        ),
        "solids.VolumeMesh": Call(
            made=solids.VolumeMesh,
            given={
                "nodes": np.vstack([np.zeros(3), np.eye(3)]),
                "elements": [[0, 1, 2, 3]],
                "kind": "tet4",
                "up": "z",
            },
        ),
    }


def _materials() -> dict[str, Call]:
    constants = {"density": 7800.0, "youngs_modulus": 2e11, "poisson_ratio": 0.3}
    rayleigh = model.Rayleigh(mass=1.0, stiffness=1e-7)
    return {
        "model.Material": Call(
            made=struck.Material,
            given={**constants, "name": "mine", "damping": rayleigh},
            use=of_material,
        ),
        "model.Material.from_lame": Call(
            made=struck.Material.from_lame,
            given={"first": 1e11, "shear": 8e10, "density": 7800.0, "damping": rayleigh},
            use=of_material,
        ),
        "model.Material.named": Call(
            made=struck.Material.named, given={"name": "steel", "damping": "own"}, use=of_material
        ),
        "model.Rayleigh": Call(
            made=model.Rayleigh, given={"mass": 1.0, "stiffness": 1e-7, "external": 0.0}, use=damped
        ),
        "model.InternalFriction": Call(
            made=model.InternalFriction, given={"loss_tangent": 1e-3, "external": 0.0}, use=damped
        ),
        "model.Measured": Call(
            made=model.Measured,
            given={"frequencies": (100.0, 1000.0), "rates": (1.0, 5.0)},
            use=damped,
        ),
        "radiation.by_name": Call(made=radiation.by_name, given={"name": "power"}),
        "radiation.RadiatedPower": Call(made=radiation.RadiatedPower, given={"air": model.AIR}),
        "radiation.add_air_mass": Call(
            made=radiation.add_air_mass,
            given={"model": sheet(), "setting": "wall", "kettle": 0.1},
            dear=True,
        ),
        "radiation.immerse": Call(
            made=radiation.immerse,
            given={"model": sheet(), "fluid": "water", "setting": "one side"},
            dear=True,
        ),
        "radiation.fill": Call(
            made=radiation.fill,
            given={"model": vessel(), "level": 0.02, "fluid": "water"},
            dear=True,
        ),
        "radiation.immerse a vessel": Call(
            made=radiation.immerse,
            given={"model": vessel(), "level": 0.02, "filled": 0.01},
            dear=True,
        ),
    }


def _excitations() -> dict[str, Call]:
    rubbing = {"path": PATH, "speed": 0.1, "load": 1.0}
    common = {"at": ON, "time": 0.0, "patch": 0.0}
    return {
        "excitation.Strike": Call(
            made=struck.Strike,
            given={
                **common,
                "impulse": 0.01,
                "duration": 1e-3,
                "shape": "hertz",
                "transient": 0.1,
                "seed": 1,
            },
            use=heard,
        ),
        "excitation.Strike by striker": Call(
            made=struck.Strike,
            given={"striker": "wood", "speed": 1.0, "direction": (0.0, 0.0, -1.0)},
            use=heard,
        ),
        "excitation.Pluck": Call(
            made=struck.Pluck, given={**common, "force": 1.0, "rise": 0.05}, use=heard
        ),
        "excitation.Release": Call(
            made=struck.Release,
            given={
                "displacement": lambda points: 1e-4 * np.ones(len(points)),
                "rise": 0.05,
                "time": 0.0,
            },
            use=heard,
        ),
        "excitation.Hold": Call(
            made=struck.Hold,
            given={**common, "grip": 10.0, "seconds": 0.1},
            use=lambda made: heard([made, struck.Strike(impulse=0.01)]),  # a hold sounds of nothing
        ),
        "excitation.ForceTrack": Call(
            made=struck.ForceTrack,
            given={**common, "force": np.ones(80), "sample_rate": 8000.0, "gain": 1.0},
            use=heard,
        ),
        "excitation.ForceTrack of a soft, rough contact": Call(
            made=struck.ForceTrack,
            given={
                "force": np.ones(80),
                "at": ON,
                "sample_rate": 8000.0,
                "gain": 1.0,
                "kernel": "gaussian",
                "softness": 1e-3,
                "roughness": "wood",
                "speed": 0.1,
                "striker": "steel",
                "radius": 0.005,
                "seed": 0,
            },
            use=heard,
        ),
        "excitation.Scrape": Call(
            made=struck.Scrape,
            given={
                **rubbing,
                "roughness": "sandpaper",
                "radius": 0.005,
                "seconds": 0.05,
                "repeat": "once",
                "seed": 0,
            },
            use=heard,
        ),
        "excitation.Roll": Call(
            made=struck.Roll,
            given={
                **rubbing,
                "radius": 0.01,
                "material": "steel",
                "flat": 0.0,
                "seconds": 0.05,
                "seed": 0,
            },
            use=heard,
        ),
        "excitation.TouchLog": Call(
            made=excitation.TouchLog,
            given={
                "times": [0.0, 0.01],
                "points": PATH,
                "forces": [1.0, 0.0],
                "speeds": [0.1, 0.1],
            },
            use=heard,
        ),
        "excitation.Tool": Call(
            made=excitation.Tool,
            given={
                "roughness": "steel",
                "striker": "steel",
                "radius": 1e-3,
                "seed": 1,
                "kernel": "gaussian",
                "softness": 2e-3,
            },
        ),
        "excitation.Roughness": Call(
            made=struck.Roughness,
            given={"rms": 1e-5, "correlation_length": 1e-4, "slope": -2.0, "waviness": 1e-5},
            use=lambda made: made.layers().at(np.zeros((3, 3))),
        ),
        "excitation.Profile": Call(
            made=excitation.Profile,
            given={"heights": 1e-6 * np.sin(np.arange(64.0)), "pitch": 1e-4, "name": "mine"},
            use=lambda made: made.roughness(),
        ),
        "excitation.Profile.named": Call(made=excitation.Profile.named, given={"name": "wood"}),
        "excitation.Roughness.named": Call(made=struck.Roughness.named, given={"name": "wood"}),
        "excitation.Push": Call(
            made=excitation.Push,
            given={"force": np.ones(16), "drive": np.ones(len(bar().frequencies))},
            use=lambda made: resonators().process([made]),
        ),
        "excitation.contact_time": Call(
            made=excitation.contact_time,
            given={"mass": 0.01, "radius": 0.01, "modulus": 1e9, "speed": 1.0},
        ),
        "excitation.impact_amplitudes": Call(
            made=excitation.impact_amplitudes,
            given={"model": bar(), "at": ON, "energy": 1.0, "distance": 1.0},
        ),
        "excitation.impact_impulse": Call(
            made=excitation.impact_impulse, given={"model": bar(), "at": ON, "energy": 1.0}
        ),
    }


def _ears() -> dict[str, Call]:
    place = {"position": (0.0, 1.0, 0.0)}
    facing = {**place, "facing": (0.0, -1.0, 0.0), "up": (0.0, 0.0, 1.0), "radius": 0.09}
    return {
        "ears.Mono": Call(made=struck.Mono, given=place, use=heard_by),
        "ears.Stereo": Call(
            made=struck.Stereo, given={**facing, "head": "simple1998"}, use=heard_by
        ),
        "ears.Binaural": Call(
            made=struck.Binaural, given={**facing, "hrtf": "kemar"}, use=heard_by, dear=True
        ),
        "ears.SphereHead": Call(made=ears.SphereHead, given={"radius": 0.0875, "ear_angle": 90.0}),
        "ears.MeasuredHead.named": Call(
            made=ears.MeasuredHead.named, given={"name": "kemar"}, dear=True
        ),
        "ears.Room": Call(
            made=struck.Room,
            given={
                "size": (5.0, 4.0, 3.0),
                "walls": "brick",
                "order": 2,
                "corner": (0.0, 0.0, 0.0),
            },
            use=inside,
        ),
        "ears.Room.reverberation_time": Call(
            made=struck.Room(size=(5, 4, 3)).reverberation_time, given={"formula": "eyring"}
        ),
        "ears.Room.responses": Call(
            made=struck.Room(size=(5, 4, 3)).responses, given={"sample_rate": 8000.0, "taps": 64}
        ),
        "ears.Room.require_inside": Call(
            made=struck.Room(size=(5, 4, 3)).require_inside,
            given={"positions": [(1.0, 1.0, 1.0)], "name": "it"},
        ),
        "ears.Room.full_responses": Call(
            made=struck.Room(size=(5, 4, 3)).full_responses,
            given={
                "source": (1.0, 1.0, 1.0),
                "listeners": [(2.0, 2.0, 1.0)],
                "sample_rate": 8000.0,
                "order": 2,
            },
        ),
        "ears.Reverberation": Call(
            made=struck.Reverberation, given={"seconds": 0.5, "volume": 60.0, "seed": 0}
        ),
        "ears.Reverberation.tail": Call(
            made=struck.Reverberation(seconds=0.3, volume=60).tail,
            given={"sample_rate": 8000.0, "channels": 2, "start": 0.0, "ear_spacing": 0.175},
        ),
        "ears.Trajectory.of": Call(
            made=ears.Trajectory.of, given={"name": "it", "course": (0.0, 1.0, 0.0)}
        ),
        "ears.Emitter": Call(
            made=ears.Emitter,
            given={"centre": ears.Trajectory.of("it", (0, 0, 0)), "radius": 0.1, "field": "head"},
        ),
        "ears.Hearing": Call(
            made=ears.Hearing,
            given={
                "emitters": [ears.Emitter(centre=ears.Trajectory.of("it", (0, 0, 0)))],
                "listener": struck.Mono(position=(0, 1, 0)),
                "sample_rate": 8000.0,
            },
            use=lambda made: made.next_block(np.zeros((1, 32))),
        ),
    }


def _models(folder: Path) -> dict[str, Call]:
    chance = np.random.default_rng(5)
    places = {"contacts": chance.random((6, 2)), "listeners": 1 + chance.random((5, 3))}
    return {
        "model.Mesh": Call(
            made=struck.Mesh, given={"points": box().points, "faces": box().faces, "up": "z"}
        ),
        "model.Mesh.scaled": Call(made=box().scaled, given={"factor": 2.0}),
        "model.NumberTable": Call(
            made=model.NumberTable, given={"columns": {"Hz": [440.0, 880.0]}}, use=str
        ),
        "model.RadiationEfficiency": Call(
            made=model.RadiationEfficiency,
            given={
                **dict.fromkeys(
                    [
                        *("frequencies", "efficiencies", "mean_squares"),
                        *("decays", "fractions", "uncertainties"),
                    ],
                    (0.5,),
                ),
                "area": 0.1,
                "impedance": 413.0,
            },
        ),
        "model.ModalModel.contact": Call(
            made=bar().contact, given={"at": ON, "direction": (0.0, 0.0, 1.0)}
        ),
        "model.ModalModel.damped": Call(
            made=bar().damped, given={"damping": model.Rayleigh(mass=1, stiffness=0)}, use=sounding
        ),
        "model.ModalModel.scaled": Call(made=bar().scaled, given={"factor": 2.0}, use=sounding),
        "model.ModalModel.tuned": Call(made=bar().tuned, given={"lowest": 440.0}, use=sounding),
        "model.ModalModel.made_of": Call(
            made=bar().made_of, given={"material": "glass"}, use=sounding
        ),
        "model.ModalModel.radiating": Call(
            made=block().radiating,
            given={"band": (20.0, 2500.0), "near": False},
            use=sounding,
            dear=True,
            long=True,
        ),
        "model.ModalModel.charted": Call(
            made=recorded("round", charted=False).charted,
            given={"pitch": [0.2, 0.1], "geometry": None},
            use=sounding,
        ),
        "model.Chart": Call(
            made=model.Chart,
            given={
                "pitch": np.ones(2),
                "around": True,
                "outline": np.array([[0.0, 0.1], [1.0, 0.2]]),
            },
            use=lambda chart: chart.places(np.ones((3, 2))),
        ),
        "model.SinglePoint": Call(
            made=model.SinglePoint, given={"outputs": np.ones(3, complex), "centre": np.zeros(3)}
        ),
        "model.Survey.full": Call(
            made=model.Survey.full,
            given={
                **places,
                "gains": np.ones((6, 5, 2), complex),
                "frequencies": np.array([300.0, 500.0]),
                "symmetry": "none",
            },
        ),
        "model.TimbreField.of": Call(
            made=model.TimbreField.of, given={"survey": survey(), "radius": 0.1, "worst": 0.1}
        ),
        "recordings.SurveyPlan.of": Call(
            made=recordings.SurveyPlan.of, given={**places, "symmetry": "none", "listener": 0}
        ),
        "recordings.Take": Call(
            made=recordings.Take,
            given={"samples": sound().samples, "sample_rate": 8000, "name": "it"},
        ),
        "recordings.Take.of": Call(made=recordings.Take.of, given={"sound": sound(), "name": "it"}),
        "files.Sound": Call(
            made=struck.Sound,
            given={
                "samples": np.zeros((1, 100), np.float32),
                "sample_rate": 8000,
                "calibrated": True,
                "notes": ("a",),
            },
            use=lambda made: made.save(folder / "made.wav"),
        ),
        "files.Sound.save": Call(
            made=sound().save,
            given={"path": folder / "sound.wav", "level": "peak", "encoding": "int16"},
        ),
        "files.Sound.spectrogram": Call(
            made=sound().spectrogram, given={"window": 0.04, "step": 0.005}
        ),
        "files.Cache": Call(
            made=files.Cache, given={"folder": folder / "cache", "most_bytes": 2**20}
        ),
        "perception.SoundMap.at": Call(made=sound_map().at, given={"point": ON}),
        "perception.SoundMap.stored": Call(made=sound_map().stored, given={"point": ON}),
        "perception.SoundMap.save": Call(
            made=sound_map().save, given={"path": folder / "map.safetensors"}
        ),
        "synth.Resonators": Call(
            made=synth.Resonators,
            given={
                "models": [bar()],
                "sample_rate": 8000.0,
                "block": 16,
                "points": 1,
                "voices": 2,
                "quiet": 1e-6,
            },
            use=lambda made: made.process(),
        ),
        "synth.Resonators.process": Call(
            made=resonators().process,
            given={
                "pushes": [
                    excitation.Push(force=np.ones(16), drive=np.ones(len(bar().frequencies)))
                ],
                "outputs": [np.ones((1, len(bar().frequencies)))],
            },
        ),
        "synth.Resonators.change": Call(
            made=resonators().change, given={"body": 0, "model": bar()}
        ),
        "synth.Resonators.states": Call(made=resonators().states, given={"body": 0}),
        "scene.Body": Call(
            made=scene.Body,
            given={
                "model": bar(),
                "excitations": struck.Strike(),
                "position": (0.0, 0.0, 0.0),
                "rotation": np.eye(3),
            },
            use=lambda made: finite(struck.render([made], seconds=0.05, sample_rate=RATE)),
        ),
        "scene.RigidBody": Call(
            made=scene.RigidBody,
            given={"geometry": box(), "mass": 1.0, "centre": np.zeros(3), "inertia": np.eye(3)},
        ),
        "scene.Scene": Call(
            made=scene.Scene,
            given={
                "bodies": {"bar": scene.Body(model=bar())},
                "gravity": (0.0, 0.0, -9.81),
            },
        ),
        "scene.events_of": Call(
            made=scene.events_of, given={"scene": hit_scene(), "contacts": hit()}, use=on_floor
        ),
        "scene.Events.on": Call(
            made=scene.events_of(hit_scene(), hit()).on,
            given={"forces": "noise2002", "seed": 1},
            use=lambda made: finite(struck.render(made, seconds=0.05, sample_rate=RATE)),
        ),
        "scene.load_contacts": Call(made=scene.load_contacts, given={"path": _log_file(folder)}),
        "scene.save_animation": Call(
            made=scene.save_animation,
            given={
                "scene": hit_scene(),
                "path": folder / "scene.glb",
                "seconds": 0.1,
                "frames_per_second": 60.0,
            },
        ),
        "scene.save_contacts": Call(
            made=scene.save_contacts, given={"contacts": hit(), "path": folder / "new.csv"}
        ),
        "scene.infer_contacts": Call(
            made=scene.infer_contacts, given={"scene": hit_scene(), "motion": moved()}
        ),
        "scene.load_animation": Call(
            made=scene.load_animation, given={"path": _animation_file(folder)}
        ),
        "scene.Poses": Call(
            made=scene.Poses,
            given={
                "time": [0.0],
                "body": [0],
                "position": [[0.0, 0.0, 0.0]],
                "rotation": [[1.0, 0.0, 0.0, 0.0]],
            },
        ),
        "scene.Contacts": Call(
            made=scene.Contacts,
            given={
                "names": ["floor", "bar"],
                "time": [0.1],
                "dt": 0.001,
                "body0": [0],
                "body1": [1],
                "position": [[0.0, 0.0, 0.0]],
                "impulse": [[0.0, 0.0, 0.1]],
                "normal": [[0.0, 0.0, 1.0]],
                "velocity": [[0.0, 0.0, -1.0]],
                "id": [3],
            },
        ),
        "analysis.model_of_modes": Call(made=analysis.model_of_modes, given=MODES, use=sounding),
        "report.overview": Call(
            made=report.overview, given={"model": bar(), "sound": sound(), "title": "it"}, dear=True
        ),
        "report.sound_map_picture": Call(
            made=report.sound_map_picture,
            given={"sound_map": sound_map(), "cells": True},
            dear=True,
        ),
        "report.blow_response": Call(
            made=report.blow_response,
            given={"model": bar(), "strike": struck.Strike(at=ON), "times": [1e-3, 2e-3]},
        ),
        "report.grid_picture": Call(
            made=report.grid_picture,
            given={"contacts": [[0.1, 0, 0]], "listeners": [[1.0, 0, 0]], "directions": None},
            dear=True,
        ),
        "report.save_report": Call(
            made=report.save_report, given={"fitting": fitting(), "path": folder / "report.html"}
        ),
        "report.report": Call(made=report.report, given={"fitting": fitting()}, dear=True),
    }


def _verbs(folder: Path) -> dict[str, Call]:
    file, picture, wav = folder / "bar.struck", folder / "bar.png", folder / "bar.wav"
    struck.save(bar(), file)
    sound().save(wav)
    trimesh.creation.box((0.2, 0.1, 0.01)).export(folder / "box.stl")
    heard_there = {"listener": (0.0, 1.0, 0.0), "level": 80.0}
    return {
        "analyze": Call(
            made=struck.analyze,
            given={
                "body": shapes.Bar(length=0.3, width=0.03, thickness=0.005),
                "material": "steel",
                "band": (20.0, 5000.0),
                "damping": "own",
                "radiation": "power",
                "filled": None,
                "immersed": None,
                "air_mass": False,
            },
            use=sounding,
        ),
        "analyze a file": Call(
            made=foretold,
            given={
                "body": folder / "box.stl",
                "material": "steel",
                "units": "m",
                "part": None,
                "up": "z",
                "accuracy": "preview",
                "band": (20.0, 5000.0),
                "wall": None,
                "fixed": None,
                "method": "fem",
                "backend": "auto",
                "cache": False,
            },
            use=sounding,
            dear=True,
        ),
        "analyze a solid": Call(
            made=foretold,
            given={
                "body": solids.Block(size=(0.2, 0.03, 0.01), elements=(4, 1, 1)),
                "material": "steel",
                "accuracy": None,
                "band": (20.0, 3000.0),
                "fixed": [[0, 0, 0], [0.01, 1, 1]],
                "size": None,
                "cache": False,
            },
            use=sounding,
        ),
        "render": Call(
            made=struck.render,
            given={
                "model": bar(),
                "excitations": [struck.Strike(impulse=0.01)],
                "seconds": 0.05,
                "sample_rate": RATE,
                "listener": (0.0, 1.0, 0.0),
                "room": None,
                "modes": 2,
            },
            use=finite,
        ),
        "load": Call(made=struck.load, given={"path": file}, use=sounding),
        "energy": Call(
            made=struck.energy,
            given={
                "model": bar(),
                "excitations": [struck.Strike(impulse=0.01)],
                "seconds": 0.05,
                "sample_rate": RATE,
            },
            use=str,
        ),
        "scene.Energy": Call(
            made=struck.scene.Energy,
            given={
                **dict.fromkeys(
                    [
                        *("frequencies", "entered", "material", "support"),
                        *("hold", "surface", "sound", "radiated"),
                    ],
                    (0.5,),
                ),
                **dict.fromkeys(["modes_sound", "recoil", "recoil_sound", "striker"], 0.1),
            },
            use=str,
        ),
        "save": Call(made=struck.save, given={"model": bar(), "path": folder / "again.struck"}),
        "save for others": Call(
            made=struck.save,
            given={
                "model": block(),
                "path": folder / "it.sofa",
                "contacts": ["top"],
                "listeners": [(1.0, 0.0, 0.0)],
            },
        ),
        "show": Call(
            made=struck.show,
            given={"model": bar(), "path": picture, "strike": None, "nodal_lines": 1},
            dear=True,
        ),
        "compare": Call(
            made=struck.compare,
            given={
                "model": bar(),
                "other": sound(),
                "at": ON,
                "strike": struck.Strike(),
                "listener": (0.0, 1.0, 0.0),
            },
            dear=True,
        ),
        "fit": Call(
            made=struck.fit,
            given={
                "recordings": sound(),
                "modes": 4,
                "method": "shared",
                "interpolation": "field",
                "radius": 0.0,
                "force": True,
                "cache": False,
            },
            dear=True,
        ),
        "tune": Call(
            made=struck.tune,
            given={
                "body": solids.Block(size=(0.2, 0.03, 0.01), elements=(4, 1, 1)),
                "material": "steel",
                "vary": "size",
                "lowest": 400.0,
                "accuracy": None,
            },
            dear=True,
        ),
        "audible": Call(
            made=struck.audible,
            given={"model": bar(), "contacts": [ON], **heard_there},
            use=sounding,
        ),
        "sonic_distance": Call(
            made=struck.sonic_distance,
            given={"a": bar(), "b": bar(), "at": ON, "against": ON, "method": "erb", **heard_there},
        ),
        "sound_map": Call(
            made=struck.sound_map,
            given={"model": bar(), "threshold_db": 3.0, **heard_there},
            long=True,
        ),
        "files.Sound.load": Call(made=struck.Sound.load, given={"path": wav}),
        "files.load_body": Call(
            made=files.load_body,
            given={
                "path": folder / "box.stl",
                "units": "m",
                "part": None,
                "wall": 2e-3,
                "holes": "fill",
            },
        ),
        "files.save_set": Call(
            made=files.save_set,
            given={
                "sounds": {"a": struck.Sound(samples=np.ones(9, np.float32), sample_rate=8000)},
                "folder": folder / "set",
                "level": 2.0,
                "encoding": "int24",
                "ending": ".wav",
            },
        ),
        "files.save_table": Call(
            made=files.save_table,
            given={
                "table": model.NumberTable(columns={"Hz": np.array([440.0])}),
                "path": folder / "table.csv",
            },
        ),
        "files.list_parts": Call(
            made=files.list_parts, given={"path": folder / "box.stl", "units": "mm"}
        ),
        "files.load_surface": Call(
            made=files.load_surface, given={"path": folder / "box.stl", "size": 0.2}
        ),
        "files.load_volume": Call(
            made=files.load_volume, given={"path": folder / "no.msh", "units": "m"}
        ),
        "files.load_sofa_responses": Call(
            made=files.load_sofa_responses, given={"path": folder / "no.sofa"}
        ),
        "recordings.read_manifest": Call(
            made=recordings.read_manifest, given={"path": folder / "no.csv"}
        ),
        "recordings.read_plan": Call(made=recordings.read_plan, given={"path": folder / "no.toml"}),
        "recordings.Take.load": Call(made=recordings.Take.load, given={"path": wav}),
        "recordings.fit_recordings": Call(
            made=recordings.fit_recordings,
            given={"recordings": [sound()], "modes": 4, "room": None, "residual": False},
            dear=True,
        ),
        "recordings.fit_poles": Call(
            made=recordings.fit_poles,
            given={
                "takes": recordings.Take.of(sound()),
                "method": "shared",
                "budget": 4,
                "attack": False,
            },
            dear=True,
        ),
        "recordings.inferable": Call(
            made=recordings.inferable, given={"model": block(), "size_error": 0.0}
        ),
        "recordings.calibrated": Call(
            made=recordings.calibrated,
            given={"fitted": fitting().fitted, "model": bar(), "widest": 2.0, "size_error": 0.0},
            dear=True,
        ),
        "recordings.corrected": Call(
            made=recordings.corrected, given={"model": bar(), "fitted": fitting().fitted}
        ),
        "perception.write_bank": Call(
            made=perception.write_bank,
            given={
                "sound_map": sound_map(),
                "folder": folder / "bank",
                "render": lambda _point, _direction: sound(),
                "encoding": "int24",
            },
        ),
    }
