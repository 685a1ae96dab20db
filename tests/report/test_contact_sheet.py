"""Pictures of a scene: their moments, what they hold, and what hides what."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

import struck
from struck import Body
from struck.model.mesh import Mesh
from struck.report.contact_sheet import contact_sheet
from struck.report.depth_image import GROUND, DepthImage
from struck.report.scene_moments import MOST, moments_of
from struck.scene import Contacts, Events, Poses, RigidBody, Scene, events_of
from tests.scene.boxes import box

SILENCE = struck.Sound(samples=np.zeros((1, 48_000), np.float32), sample_rate=48_000)
FLOOR = Body(model=RigidBody(plane=True))


def cube(edge: float) -> Mesh:
    solid = trimesh.creation.box((edge,) * 3)
    return Mesh(points=np.asarray(solid.vertices), faces=np.asarray(solid.faces, np.int64))


def bouncing(times: list[float], impulses: list[float], *, seconds: float = 2.0) -> Events:
    """Return the events of a cube that goes up and down and sideways, and hits a floor."""
    clock = np.linspace(0, seconds, 201)
    place = np.stack([clock, 0 * clock, 0.5 + 0.3 * np.cos(9 * clock)], axis=1)
    poses = Poses.together(clock, place[:, None], np.tile([1.0, 0, 0, 0], (201, 1, 1)))
    count = len(times)
    contacts = Contacts(
        names=["cube", "floor"],
        time=np.array(times),
        body0=np.ones(count),
        body1=np.zeros(count),
        position=np.zeros((count, 3)),
        impulse=np.array(impulses)[:, None] * [0.0, 0.0, 1.0],
        normal=np.tile([0.0, 0.0, 1.0], (count, 1)),
        velocity=np.tile([0.0, 0.0, -1.5], (count, 1)),
        poses=poses,
    )
    model = box((0.2, 0.2, 0.2))
    return events_of(Scene(bodies={"floor": FLOOR, "cube": Body(model=model)}), contacts)


def test_frames_are_at_the_largest_blows() -> None:
    chance = np.random.default_rng(5)
    times = np.sort(chance.uniform(0.05, 1.95, 40)).tolist()
    impulses = chance.uniform(0.5, 9.0, 40).tolist()
    moments = moments_of(bouncing(times, impulses), 2.0)
    shown = np.array([moment.time for moment in moments])
    assert len(moments) <= MOST
    assert np.all(np.diff(shown) > 0)
    assert moments[0].caption == "start"
    # Of the blows the largest one of each fortieth of the duration, eight of them.
    order = np.argsort(impulses)[::-1]
    chosen: list[float] = []
    for row in order.tolist():
        if len(chosen) < 8 and all(abs(times[row] - other) >= 0.05 for other in chosen):
            chosen.append(times[row])
            assert np.abs(shown - times[row]).min() < 1e-9
    captions = {round(each.time, 9): each.caption for each in moments}
    assert all(captions[round(time, 9)] == "cube hits floor, 1.5 m/s" for time in chosen)


def test_frames_without_blows_are_where_something_moves() -> None:
    events = bouncing([], [])
    times = [moment.time for moment in moments_of(events, 2.0)]
    assert len(times) == MOST
    assert (times[0], times[-1]) == (0.0, 2.0)
    # A scene that stops after a tenth of the time has its pictures there.
    poses = events.contacts.poses
    assert poses is not None
    early = np.minimum(poses.time, 0.2)
    place = np.stack([early, 0 * early, 0.5 + 0 * early], axis=1)
    stopped = replace(events.contacts, poses=replace(poses, position=place))
    times = [moment.time for moment in moments_of(events_of(events.scene, stopped), 2.0)]
    assert all(time <= 0.21 for time in times[:-1])
    still = replace(events.contacts, poses=None)
    scene = Scene(bodies={"floor": FLOOR, "cube": Body(model=box((0.2, 0.2, 0.2)))})
    assert [moment.time for moment in moments_of(events_of(scene, still), 2.0)] == [0.0]


@pytest.mark.parametrize("away", [0.0, pytest.param(40.0, marks=pytest.mark.prove)])
def test_no_body_leaves_its_frame_and_floors_are_drawn(away: float) -> None:
    """Pixels at the edge of each frame are floor; a cube that goes far away makes others closer."""
    clock = np.linspace(0, 1, 101)
    far = np.stack([0.3 + away * clock, 0 * clock, 0.1 + 0 * clock], axis=1)
    near = np.tile([0.0, 0.0, 0.1], (101, 1))
    poses = Poses.together(
        clock, np.stack([near, far], axis=1), np.tile([1.0, 0, 0, 0], (101, 2, 1))
    )
    bodies = {
        "near": Body(model=RigidBody(geometry=cube(0.2), mass=1.0)),
        "far": Body(model=RigidBody(geometry=cube(0.2), mass=1.0)),
        "floor": FLOOR,
    }
    motion = Contacts.of_motion(["near", "far"], poses)
    figure = contact_sheet(events_of(Scene(bodies=bodies), motion), SILENCE, seconds=1.0)
    panels = [axes for axes in figure.subfigs[0].axes if axes.images]
    assert panels
    for axes in panels:
        image = np.asarray(axes.images[0].get_array())
        border = np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]])
        assert np.ptp(border, axis=1).max() < 0.02  # grey
        assert border.min() > 0.6  # of tiles or a shadow
        coloured = np.ptp(image, axis=2) > 0.1
        assert coloured.mean() > (1e-5 if away else 0.01)
    first = np.asarray(panels[0].images[0].get_array())
    assert (np.ptp(first, axis=2) > 0.1).mean() > 0.05
    words = " ".join(axes.get_title() for axes in panels)
    assert words.startswith("0.00 s: start")
    assert "N s" not in words
    (levels,) = figure.subfigs[1].axes[0].collections
    assert np.max(levels.get_array()) < -90  # silence is black
    legend = [text.get_text() for text in figure.subfigs[0].legends[0].get_texts()]
    assert legend[:2] == ["near", "far"]
    assert legend[2].startswith("floor: tiles of ")


@pytest.mark.prove
def test_ground_that_is_a_huge_box_leaves_what_moves_in_sight() -> None:
    """As scene files without planes have it; times of a short scene keep apart."""
    events = bouncing([0.02], [1.0], seconds=0.08)
    ground = Body(model=RigidBody(geometry=cube(100.0)), position=(0.0, 0.0, -50.0))
    events = replace(events, scene=Scene(bodies={**events.scene.bodies, "floor": ground}))
    figure = contact_sheet(events, SILENCE, seconds=0.08)
    panels = [axes for axes in figure.axes if axes.images and "s" in axes.get_title()]
    titles = [axes.get_title().partition(" ")[0] for axes in panels]
    assert len(set(titles)) == len(titles) > 2
    for axes in panels:
        (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
        assert right - left < 2.0
        assert high - low < 2.0


def test_nearer_surfaces_hide_farther_ones_whatever_their_size() -> None:
    """A small triangle over the corner of a large one, of which only the depth decides."""
    large = np.array([[[-9.0, -9, 0], [9, -9, 0], [0, 9, 0]]])
    red, blue = np.array([[1.0, 0, 0]]), np.array([[0.0, 0, 1]])
    for height, order in ((0.1, 1), (0.1, -1), (-0.1, 1), (-0.1, -1)):
        small = np.array([[[-0.3, -0.3, height], [0.3, -0.3, height], [0, 0.3, height]]])
        image = DepthImage(low=np.array([-1.0, -1.0]), pixel=0.02, width=100, height=100)
        for corners, colour in ((large, red), (small, blue))[::order]:
            image.add_triangles(corners, colour, GROUND)
        pixels = image.image()
        blue_share = float((pixels[:, :, 2] > 0.5).mean())
        assert blue_share == pytest.approx(0.18 / 4 if height > 0 else 0.0, abs=0.002)
        assert np.all(pixels[:, :, 0] + pixels[:, :, 2] == pytest.approx(1.0))
        image.add_triangles(large[:, ::-1] + [0, 0, 1], blue, GROUND)  # seen from behind
        np.testing.assert_array_equal(image.image(), pixels)


def test_a_plane_hides_what_is_below_it() -> None:
    view = np.eye(3)
    image = DepthImage(low=np.array([-1.0, -1.0]), pixel=0.02, width=100, height=100)
    triangle = np.array([[[-0.5, -0.5, -0.1], [0.5, -0.5, -0.1], [0, 0.5, 0.3]]])
    image.add_triangles(triangle, np.array([[1.0, 0, 0]]), 0)
    tiles = np.array([0.9, 0.9, 0.9]), np.array([0.8, 0.8, 0.8])
    image.add_plane(np.zeros(3), view, 0.5, *tiles)
    red = np.ptp(image.image(), axis=2) > 0.2
    # It rises out of the plane a quarter of the way up: 9/16 of half a square metre of 4.
    assert red.mean() == pytest.approx(0.5 * 9 / 16 / 4, abs=0.003)
    away = DepthImage(low=np.array([-1.0, -1.0]), pixel=0.02, width=100, height=100)
    away.add_plane(np.zeros(3), -view, 0.5, *tiles)  # it faces the other way
    assert np.all(away.image() == 1.0)
