"""Bodies that turn, that are silent, and that are listened to from near by."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.ears.listeners import Mono, Stereo
from struck.errors import ContactError, MeshError, OptionError
from struck.excitation.strike import Strike
from struck.model.material import AIR
from struck.model.model import ModalModel
from struck.scene.body import Body, RigidBody, Scene
from struck.scene.render import render
from tests.scene.boxes import box
from tests.scene.test_mixing import sided
from tests.scene.test_render import BLOCK, TOP

Array = NDArray[np.float64]
RATE = 16_000
STRIKE = Strike(at=TOP, impulse=0.02, duration=1e-3)
SPIN = 8.0  # rad/s
ALOFT = np.array([0.4, -0.3, 0.2])  # where two bodies are heard, m


def turned(time: float) -> Array:
    """Return a rotation about z."""
    cosine, sine = np.cos(SPIN * time), np.sin(SPIN * time)
    return np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])


def about(centre: Array) -> ModalModel:
    """Return the block with the centre of its sound elsewhere."""
    return replace(BLOCK, centre=centre, gains=replace(BLOCK.gains, centre=centre))


def back(vector: Array, late: float) -> Callable[[float], Array]:
    """Return a vector of a world that turns, as seen when what was sent `late` s ago arrives."""
    return lambda time: turned(time - late).T @ vector


def level(error: Array, wanted: Array) -> float:
    return 20 * np.log10(max(np.abs(error).max() / np.abs(wanted).max(), 1e-12))


def test_bodies_that_turn_are_heard_as_when_the_world_turns_the_other_way() -> None:
    # Both spin about z, with the centre of their sound on it: one is a timbre field, one is not.
    field = replace(about(np.zeros(3)), gains=sided())
    ears = {"facing": np.array([-1.0, 0.2, 0.0]), "up": np.array([0.1, 0.0, 1.0])}
    heard = {name: np.zeros((2, round(0.3 * RATE))) for name in ("bodies", "world", "nothing")}
    # By bare ears, as the centre of the head stays on one side of the field.
    for model, height, way in ((field, 0.0, "ears"), (about(np.zeros(3)), 0.3, None)):
        fixed = Stereo(position=ALOFT, field=way, **ears)
        place = np.array([0, 0, height])
        body = Body(model=model, excitations=STRIKE, position=place, rotation=turned)
        still = replace(body, rotation=np.eye(3))
        late = float(np.linalg.norm(ALOFT - place)) / AIR.sound_speed
        moved = {name: back(v, late) for name, v in (ears | {"position": ALOFT}).items()}
        world = Stereo(field=way, **moved)
        for name, each, listener in (
            ("bodies", body, fixed),
            ("world", still, world),
            ("nothing", still, fixed),
        ):
            sound = render(each, listener=listener, seconds=0.3, fade=0, sample_rate=RATE)
            heard[name] += sound.samples
    settled = slice(round(0.02 * RATE), None)  # until then the world is held as at 0 s
    apart = {
        name: level((heard[name] - heard["bodies"])[:, settled], heard["bodies"]) for name in heard
    }
    assert apart["world"] < -100
    assert apart["nothing"] > -20


def test_a_table_of_rotations_carries_the_centre_along() -> None:
    away = about(np.array([0.3, 0.0, 0.0]))
    times = np.linspace(0, 0.4, 401)
    half = SPIN * times / 2
    table = np.stack([np.cos(half), 0 * half, 0 * half, np.sin(half)], axis=1)
    turning = Body(model=away, excitations=STRIKE, rotation=(times, table))
    carried = Body(
        model=about(np.zeros(3)),
        excitations=STRIKE,
        position=lambda time: turned(time) @ away.centre,
    )
    listener = Mono(position=(2, 1, 0))
    one, other = (
        render(each, listener=listener, seconds=0.3, fade=0, sample_rate=RATE).samples.astype(float)
        for each in (turning, carried)
    )
    assert level(one - other, other) < -100


def test_a_listener_above_a_floor_hears_it() -> None:
    floor = box((2.0, 2.0, 0.03))
    hit = Strike(at=(0.31, 0.17, 0.015), impulse=1.0, duration=2e-3)
    above = np.array([0.0, 0.0, 1.0])
    near, far = (
        render(floor, hit, listener=height * above, seconds=0.5, fade=0, sample_rate=8000).samples
        for height in (1.0, 2.0)
    )
    np.testing.assert_allclose(near, 2 * far, rtol=1e-5, atol=1e-12)
    # Down to the boards no louder than at the radius of a ball of the floor's area.
    reach = np.sqrt((2 * 2 * 2 + 4 * 2 * 0.03) / (4 * np.pi))
    close = render(floor, hit, listener=0.016 * above, seconds=0.5, fade=0, sample_rate=8000).peak
    assert close == pytest.approx(np.abs(near).max() / reach, rel=1e-4)
    with pytest.raises(ContactError, match="inside the body's surface"):
        render(floor, hit, listener=0.014 * above)


def test_two_ears_above_a_floor_and_no_ear_inside_it() -> None:
    slab = about(np.zeros(3))
    body = Body(model=slab, excitations=STRIKE, rotation=(2**-0.5, 0, 0, 2**-0.5))
    # 0.2 m long along x, which is turned to y; the ball about it has a radius of 0.12 m.
    ears = Stereo(position=(0.06, 0, 0), facing=(0, 1, 0), head="woodworth")
    assert render(body, listener=ears, seconds=0.1, fade=0).peak > 0
    with pytest.raises(ContactError, match="inside its surface"):
        render(body, listener=Mono(position=(0, 0.06, 0)))
    loud, soft = (
        render(body, listener=Mono(position=(x, 0, 0)), seconds=0.2, fade=0).peak
        for x in (0.051, 0.12)
    )
    reach = np.sqrt((2 * 0.1 * 0.1 + 4 * 0.2 * 0.1) / (4 * np.pi))
    assert loud / soft == pytest.approx(0.12 / reach, rel=1e-3)


def test_bodies_may_be_silent_or_at_peace() -> None:
    hit = Body(model=BLOCK, excitations=STRIKE)
    others = [Body(model=BLOCK, position=(1, 0, 0)), Body(model=RigidBody(), position=(0, 2, 0))]
    listener = Mono(position=(0, 1, 0))
    alone, among = (
        render(each, listener=listener, seconds=0.2, fade=0).samples
        for each in ([hit], [hit, *others])
    )
    np.testing.assert_array_equal(alone, among)
    with pytest.raises(OptionError, match="nothing to render"):
        render(others, listener=listener)
    with pytest.raises(OptionError, match="1 excitation on a body without sound"):
        Body(model=RigidBody(), excitations=STRIKE)


def test_a_body_that_is_inside_out_is_refused() -> None:
    mesh = BLOCK.geometry
    with pytest.raises(MeshError, match=r"encloses -0\.002 m\^3: it is inside out"):
        RigidBody(geometry=replace(mesh, faces=mesh.faces[:, ::-1]))


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (lambda: RigidBody(mass=0.0), "mass is 0"),
        (lambda: RigidBody(inertia=np.ones(3)), "must be"),
        (lambda: Scene(bodies={}), "none: give each name a Body"),
        (lambda: Scene(bodies={"a": BLOCK}), "'a' is a ModalModel"),
        (lambda: Scene(bodies={"a": Body(model=BLOCK)}, gravity=(0, np.inf, 0)), "not finite"),
        (lambda: Body(model=BLOCK, roughness="sandpapre"), "did you mean sandpaper"),
    ],
)
def test_scenes_that_cannot_be_are_refused(made: object, message: str) -> None:
    with pytest.raises(OptionError, match=message):
        made()
