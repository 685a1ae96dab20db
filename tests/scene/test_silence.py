"""Logs in which nothing sounds, and excitations given beside a body."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import struck
from struck import Body, Hold, Mono, Stereo, Strike
from struck.errors import MaterialError, OptionError
from struck.scene import Contacts, Poses, RigidBody, Scene, events_of
from struck.solids import Block
from tests.scene.boxes import box
from tests.scene.logs import SCENE, Solver, landing

BLOCK = box((0.2, 0.1, 0.1))
EARS = Stereo(position=(0, -1, 0.5), facing=(0, 1, 0))


def log(impulse: float, *, rows: int = 120, dt: float = 1 / 60) -> Contacts:
    """Return the same push of the board on the block in each frame."""
    return Contacts(
        names=["board", "block"],
        time=dt * np.arange(rows),
        dt=dt,
        body0=np.zeros(rows),
        body1=np.ones(rows),
        position=np.tile([0.0, 0.0, 0.01], (rows, 1)),
        impulse=np.tile([0.0, 0.0, impulse], (rows, 1)),
    )


STILL = Poses.together(np.linspace(0, 1, 11), np.zeros((11, 2, 3)), [[[1.0, 0, 0, 0]] * 2] * 11)
MUTE = Scene(bodies={"board": Body(model=RigidBody()), "block": Body(model=RigidBody(mass=0.1))})
REST = (
    "silence: no blow that counts in {} of contacts, and nothing slides or rolls: a load at rest "
    "makes no sound"
)
MUTED = (
    "silence: 1 blow and 0 lasting contacts are between bodies without a model of their sound: "
    "give one a ModalModel, or a material in a simulation"
)
# Scene, log, length when nothing says one, s, and the last note.
SILENT = {
    "load at rest": (
        SCENE,
        log(0.035),
        2.0,
        REST.format("120 rows"),
    ),
    "no impulse": (
        SCENE,
        log(0.0, rows=1),
        0.1,
        REST.format("1 row"),
    ),
    "dropped": (
        SCENE,
        log(1e-6, rows=1, dt=0.0),
        0.1,
        REST.format("1 row"),
    ),
    "empty": (SCENE, log(0.1, rows=0), 0.1, "silence: the log has no contacts"),
    "motion alone": (
        SCENE,
        Contacts.of_motion(["board", "block"], STILL),
        1.0,
        "silence: the log has no contacts; struck.scene.infer_contacts finds those of a motion",
    ),
    "without models": (
        MUTE,
        log(0.1, rows=1),
        0.1,
        MUTED,
    ),
}


@pytest.mark.parametrize("case", SILENT)
def test_a_log_in_which_nothing_sounds_renders_to_silence(case: str) -> None:
    scene, contacts, seconds, note = SILENT[case]
    for listener, ears in ((None, 1), (EARS, 2)):
        sound = struck.render(scene, contacts, listener=listener)
        assert sound.samples.shape == (ears, round(seconds * 48_000))
        assert not sound.samples.any()
        assert sound.notes[-1] == note
    sound = struck.render(scene, contacts, seconds=0.25, sample_rate=8000)
    assert sound.samples.shape == (1, 2000)
    # The scene that the events excite is as silent.
    again = struck.render(events_of(scene, contacts).on(), seconds=0.25, sample_rate=8000)
    assert again.notes == sound.notes
    np.testing.assert_array_equal(again.samples, sound.samples)


def test_a_fade_is_no_longer_than_the_silence() -> None:
    with pytest.raises(OptionError, match="fade is 3 s and the sound lasts 2 s"):
        struck.render(SCENE, log(0.035), fade=3)


def test_a_log_that_sounds_is_not_called_silent_and_scenes_without_a_log_are_refused() -> None:
    contacts = landing(Solver(), seconds=0.3)
    sound = struck.render(SCENE, contacts, listener=EARS, seconds=0.3)
    assert sound.samples.any()
    assert not any("silence" in note for note in sound.notes)
    with pytest.raises(OptionError, match="nothing to render: give at least one strike"):
        struck.render(SCENE)
    # A hand that holds a body makes no sound of a silent log.
    held = replace(SCENE.bodies["block"], excitations=Hold(grip=5.0))
    scene = Scene(bodies={**SCENE.bodies, "block": held})
    sound = struck.render(scene, log(0.035), seconds=0.1)
    assert sound.notes[-1] == REST.format("120 rows")
    assert not sound.samples.any()
    # A body of the scene that has its own excitations sounds, whatever the log holds.
    struck_block = replace(SCENE.bodies["block"], excitations=Strike(impulse=0.01))
    scene = Scene(bodies={**SCENE.bodies, "block": struck_block})
    assert struck.render(scene, log(0.0), seconds=0.1).samples.any()


@pytest.mark.parametrize(
    "actions",
    [
        Strike(impulse=0.01, direction=(0, 0, 1)),
        [Strike(impulse=0.01), Strike(impulse=0.02, time=0.1, shape="gaussian"), Hold(grip=5.0)],
    ],
)
@pytest.mark.parametrize("listener", [None, (0.0, 0.0, 2.0), EARS])
def test_excitations_beside_a_body_are_those_of_the_body(actions: object, listener: object) -> None:
    given = {"position": (0.3, 0, 0), "rotation": (2**-0.5, 0, 0, 2**-0.5)}
    heard = {"listener": listener, "seconds": 0.2}
    beside = struck.render(Body(model=BLOCK, **given), actions, **heard)
    inside = struck.render(Body(model=BLOCK, excitations=actions, **given), **heard)
    listed = struck.render([Body(model=BLOCK, **given)], actions, **heard)
    assert inside.samples.any()
    for sound in (beside, listed):
        np.testing.assert_array_equal(sound.samples, inside.samples)
        assert sound.notes == inside.notes


STRIKE = Strike(impulse=0.01)
STRUCK = Body(model=BLOCK, excitations=STRIKE)


@pytest.mark.parametrize(
    ("bodies", "said"),
    [
        (STRUCK, r"the Body has its own excitations \(1\), and more are given besides: give all"),
        ([STRUCK], r"the Body has its own excitations \(1\)"),
        ([Body(model=BLOCK)] * 2, "there are 2 bodies, and nothing says which of them is excited"),
        ([STRUCK, Body(model=BLOCK)], "there are 2 bodies"),
        (Body(model=RigidBody()), "1 excitation on a body without sound"),
        (Scene(bodies={"a": Body(model=BLOCK)}), "a scene takes Contacts"),
    ],
)
def test_excitations_that_could_mean_several_things_are_refused(bodies: object, said: str) -> None:
    with pytest.raises(OptionError, match=said):
        struck.render(bodies, STRIKE)


def test_rigid_bodies_take_materials_by_name() -> None:
    oak = struck.Material.named("oak")
    assert RigidBody(material="Oak").material == oak == RigidBody(material=oak).material
    with pytest.raises(MaterialError, match="did you mean oak"):
        RigidBody(material="oack")
    # A blow lasts as long, whichever way the material was named.
    durations = [
        events_of(
            Scene(
                bodies={
                    "board": Body(model=RigidBody(material=material, mass=1.0)),
                    "block": Body(model=BLOCK),
                }
            ),
            log(0.1, rows=1),
        ).durations
        for material in ("oak", oak)
    ]
    np.testing.assert_array_equal(*durations)
    assert durations[0] > 0
    with pytest.raises(OptionError, match="plane is True, and there is a geometry"):
        RigidBody(geometry=BLOCK.geometry, plane=True)


def test_notes_name_bodies_and_equal_ones_are_one_line() -> None:
    """Four dice and a marble without modes, beside a block with twelve."""
    die = struck.analyze(Block(size=(0.012,) * 3), "steel", accuracy="preview")
    hit = {"excitations": STRIKE}
    bodies = {f"c{n}": Body(model=die, **hit) for n in (2, 0, 3, 1)}
    bodies |= {"marble": Body(model=replace(die, complete_to=800.0), **hit), "block": STRUCK}
    alone = "so that its recoil alone is heard"
    sound = struck.render(Scene(bodies=bodies), listener=Mono(position=(0, -1, 0)), seconds=0.05)
    assert sound.notes[:3] == (
        "c0 to c3: no modes up to 20 kHz, so that their recoil alone is heard",
        f"marble: no modes up to 800 Hz, {alone}",
        "c0 to c3 and marble: struck at the top; no place was given",
    )
    assert sound.notes[3].startswith("block: struck at ")
    assert len(sound.notes) == 4
    listed = [Body(model=die, **hit), STRUCK, Body(model=die, **hit)]
    sound = struck.render(listed, listener=Mono(position=(0, -1, 0)), seconds=0.05)
    assert sound.notes[0].startswith("body 0 and body 2: no modes up to 20 kHz, so that their r")
    single = struck.render(listed[0], listener=Mono(position=(0, -1, 0)), seconds=0.05)
    assert single.notes[0] == f"no modes up to 20 kHz, {alone}"
    assert single.notes[1:] == ("struck at the top; no place was given",)


def test_impacts_below_a_millionth_of_the_largest_are_counted_and_not_listed() -> None:
    times = np.array([0.1, 0.2, 0.3, 0.4])
    impulses = np.array([1.0, 2e-6, 0.9e-6, 1e-18])
    scene = Scene(
        bodies={
            "board": Body(model=BLOCK, fixed=True),
            "grain": Body(model=RigidBody(mass=1e-17), position=(0, 0, 0.05)),
        }
    )
    contacts = Contacts(
        names=["board", "grain"],
        time=times,
        body0=np.zeros(4),
        body1=np.ones(4),
        position=np.tile([0.0, 0.0, 0.05], (4, 1)),
        impulse=impulses[:, None] * [0.0, 0.0, 1.0],
    )
    events = events_of(scene, contacts)
    assert len(events.impacts) == 4
    assert [row["time"] for row in events.table()] == [0.1, 0.2]
    assert events.notes == (
        "2 impacts of less than 1e-06 of the largest impulse left out of the table of events",
    )


@pytest.mark.parametrize(("along", "lasting"), [(0.0, 0), (0.02, 1)])
def test_bodies_that_sink_into_each_other_do_not_slide(along: float, lasting: int) -> None:
    """A soft solver lets a block at rest sink by a millimetre, at up to 10 mm/s."""
    contacts = landing(Solver(), speed=0.0, at=0.0, slides=lambda times: along * times)
    poses = contacts.poses
    assert poses is not None

    def depth(times: np.ndarray) -> np.ndarray:
        return 1e-3 * (1 - np.exp(-times / 0.1))

    sunk = np.where(poses.body == 1, depth(poses.time), 0.0)[:, None] * [0.0, 0.0, 1.0]
    rows = depth(contacts.time)[:, None] * [0.0, 0.0, 0.5]
    sinking = replace(
        contacts,
        position=contacts.position - rows,
        velocity=contacts.velocity - 20 * (1e-3 * np.array([0, 0, 0.5]) - rows),
        poses=replace(poses, position=poses.position - sunk),
    )
    events = events_of(SCENE, sinking)
    assert len(events.sustained) == lasting
    for contact in events.sustained:
        assert contact.speeds[0].max() == pytest.approx(along, rel=0.05)
