"""Contacts become blows and lasting contacts, judged by the law of contact and by ear."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import struck
from struck.ears.listeners import Mono
from struck.errors import ContactError, OptionError
from struck.excitation.hertz import CONTACT_CONSTANT, contact_modulus
from struck.excitation.strike import Strike
from struck.model.material import Material
from struck.scene import Body, Contacts, Poses, RigidBody, Scene, events_of
from struck.synth.ring_down import half_sine
from tests.scene.boxes import box
from tests.scene.logs import BLOCK, BOARD, CORNERS, MASS, SCENE, Solver, landing

Array = NDArray[np.float64]
RATE = 48_000
EAR = Mono(position=(0.0, 0.3, 1.0))
SOLVERS = {
    "hard": Solver(),
    "hard, fine steps": Solver(step=0.25e-3),
    "soft": Solver(spread=12),
    "soft, coarse steps": Solver(step=2e-3, spread=8),
    "flickering": Solver(flicker=True, sway=0.1),
    "soft and flickering": Solver(spread=12, flicker=True, sway=0.1),
}


def heard(contacts: Contacts, seconds: float = 1.0) -> Array:
    sound = struck.render(SCENE, contacts, listener=EAR, seconds=seconds, sample_rate=RATE)
    return sound.samples[0].astype(float)


def decibels(share: float) -> float:
    return 20 * np.log10(max(share, 1e-15))


# Blows.


def law(
    radius: float, speed: float, material: Material, length: float, thickness: float, place: float
) -> tuple[Array, Array]:
    """Return times, s, and the force of a ball on a free rod by Hertz's law at 2 MHz, N.

    The rod has its two rigid motions and bending modes by Euler and Bernoulli (1e-5 of roots).
    """
    mass = material.density * length * thickness**2
    ball = material.density * 4 / 3 * np.pi * radius**3
    roots = np.array([4.730041, 7.853205, 10.995608, 14.137165, 17.278760, 20.420352, 23.561945])
    sizes = (np.cosh(roots) - np.cos(roots)) / (np.sinh(roots) - np.sin(roots))
    x = place / length
    shapes = (
        np.cosh(roots * x) + np.cos(roots * x) - sizes * (np.sinh(roots * x) + np.sin(roots * x))
    )
    bending = (
        roots**2 / length**2 * thickness * np.sqrt(material.youngs_modulus / 12 / material.density)
    )
    drives = np.concatenate([[1.0, np.sqrt(12) * (x - 0.5)], shapes]) / np.sqrt(mass)
    turns = np.concatenate([[0.0, 0.0], bending])
    stiffness = 4 / 3 * contact_modulus(material, material) * np.sqrt(radius)
    step, forces = 0.5e-6, []
    gap, pace, q, v = 0.0, -speed, np.zeros(len(turns)), np.zeros(len(turns))
    while True:
        dent = max(0.0, drives @ q - gap)
        force = stiffness * dent**1.5
        if len(forces) > 4 and not dent:
            return step * np.arange(len(forces)), np.array(forces)
        forces.append(force)
        pace += step * force / ball
        v += step * (-(turns**2) * q - force * drives)
        gap, q = gap + step * pace, q + step * v


@pytest.mark.parametrize("spread", [1, 12])
@pytest.mark.parametrize(("radius", "speed"), [(0.01, 1.0), (0.0075, 3.0)])
def test_a_ball_on_a_rod_pushes_its_modes_as_the_law_of_contact_says(
    radius: float, speed: float, spread: int
) -> None:
    steel = Material.named("steel")
    length, thickness, place = 0.3, 0.012, 0.11
    times, forces = law(radius, speed, steel, length, thickness, place)
    impulse = float(forces.sum() * (times[1] - times[0]))
    rod = box((length, thickness, thickness), material=steel)
    import trimesh

    sphere = trimesh.creation.icosphere(subdivisions=3, radius=radius)
    ball = RigidBody(
        geometry=struck.Mesh(points=sphere.vertices, faces=sphere.faces),
        material=steel,
        mass=steel.density * 4 / 3 * np.pi * radius**3,
    )
    up = thickness / 2 + radius
    scene = Scene(
        bodies={"rod": Body(model=rod), "ball": Body(model=ball, position=(place - 0.15, 0, up))}
    )
    shape = np.sin(np.pi * (np.arange(spread) + 0.5) / spread)
    contacts = Contacts(
        names=["rod", "ball"],
        time=0.1 + 1e-3 * np.arange(spread),
        dt=1e-3,
        body0=np.zeros(spread),
        body1=np.ones(spread),
        position=np.tile([place - 0.15, 0.0, thickness / 2], (spread, 1)),
        impulse=np.outer(impulse * shape / shape.sum(), [0, 0, 1]),
        normal=np.tile([0, 0, 1.0], (spread, 1)),
        velocity=np.outer(np.where(np.arange(spread) == 0, -speed, 0.0), [0, 0, 1]),
    )
    events = events_of(scene, contacts)
    (body,) = (each for each in events.on().bodies.values() if each.actions)
    (strike,) = body.actions
    assert isinstance(strike, Strike)
    assert strike.impulse == pytest.approx(impulse, rel=1e-9)
    assert events.impacts.time[0] == pytest.approx(0.1 + spread * 0.5e-3, abs=1e-9)
    for frequency in np.linspace(500, 12_000, 24):
        turning = np.exp(-2j * np.pi * frequency * times)
        wanted = abs((forces * turning).sum()) * (times[1] - times[0]) / impulse
        fine = np.linspace(0, strike.duration, 2001)
        pulse = half_sine(fine, strike.duration)
        found = abs(np.trapezoid(pulse * np.exp(-2j * np.pi * frequency * fine), fine))
        assert abs(decibels(found / wanted)) < (1 if frequency <= 8000 else 2), frequency


def test_a_ball_bounces_off_a_ball_for_as_long_as_hertz_says() -> None:
    steel = Material.named("steel")
    import trimesh

    sphere = trimesh.creation.icosphere(subdivisions=3, radius=0.02)
    mesh = struck.Mesh(points=sphere.vertices, faces=sphere.faces)
    ball = RigidBody(geometry=mesh, material=steel, mass=0.26)
    scene = Scene(bodies={"a": Body(model=ball), "b": Body(model=ball, position=(0, 0, 0.04))})
    contacts = one_hit([0, 0, 0.02], [0, 0, 0.13 * 2.0], velocity=[[0, 0, -1.0]])
    wanted = CONTACT_CONSTANT * (0.13**2 / (0.01 * contact_modulus(steel, steel) ** 2)) ** 0.2
    assert events_of(scene, contacts).durations[0] == pytest.approx(wanted, rel=0.01)


def one_hit(position: object, impulse: object, **more: object) -> Contacts:
    columns = {"names": ["a", "b"], "time": [0.1], "body0": [0], "body1": [1]}
    return Contacts(**columns, position=[position], impulse=[impulse], **more)


@pytest.mark.parametrize("solver", SOLVERS.values(), ids=SOLVERS)
def test_whatever_the_solver_a_landing_sounds_as_one_clean_hit(solver: Solver) -> None:
    clean = heard(landing(Solver(), rests=False))
    found = heard(landing(solver))
    assert abs(10 * np.log10((found**2).sum() / (clean**2).sum())) < 1
    assert np.abs(np.diff(found, 2)).max() < 1.5 * np.abs(np.diff(clean, 2)).max()


def test_a_hundred_points_at_once_and_a_double_hit_are_one_clean_hit() -> None:
    clean = heard(landing(Solver(points=np.zeros((1, 2))), rests=False))
    crowd = np.random.default_rng(1).uniform(-1e-3, 1e-3, (100, 2))
    double = landing(Solver(points=np.zeros((1, 2)), spread=2), rests=False)
    for contacts in (landing(Solver(points=crowd), rests=False), double):
        found = heard(contacts)
        assert abs(10 * np.log10((found**2).sum() / (clean**2).sum())) < 1
        assert np.abs(np.diff(found, 2)).max() < 1.5 * np.abs(np.diff(clean, 2)).max()


@pytest.mark.parametrize("solver", [SOLVERS["hard"], SOLVERS["soft and flickering"]])
def test_what_has_settled_is_silent(solver: Solver) -> None:
    sound = heard(landing(solver, seconds=2.5), 2.5)
    assert decibels(np.abs(sound[round(1.2 * RATE) :]).max() / np.abs(sound).max()) < -90


def test_no_line_at_the_rate_of_the_steps_is_heard() -> None:
    solver = Solver(flicker=True, sway=0.2)
    contacts = landing(solver, slides=lambda t: 0.08 * np.clip(t - 0.1, 0, 1.2), seconds=1.5)
    sound = heard(contacts, 1.5)
    loudest = np.sqrt(np.square(sound[:RATE]).mean())
    part = sound[round(0.6 * RATE) : round(1.2 * RATE)]
    window = np.hanning(len(part))
    lines = np.abs(np.fft.rfft(part * window)) * 2 / window.sum()
    bins = np.arange(1, 20) * round(1000 * len(part) / RATE)
    around = np.array([np.median(lines[b - 40 : b + 40]) for b in bins])
    above = np.array([lines[b - 1 : b + 2].max() for b in bins]) - 4 * around
    assert decibels(above.max() / loudest) < -60
    assert np.sqrt(np.square(part).mean()) > 1e-4 * loudest  # it is heard to slide


def test_far_points_of_a_flat_landing_are_struck_each() -> None:
    impacts = events_of(SCENE, landing(Solver())).impacts
    assert len(impacts) == 4
    assert set(impacts.blow) == {0}
    np.testing.assert_allclose(impacts.impulse.sum(axis=0), [0, 0, 0.5 * MASS], atol=1e-3 * MASS)
    np.testing.assert_allclose(np.sort(impacts.position[:, 0]), np.sort(CORNERS[:, 0]), atol=1e-9)


# Both bodies.


def test_both_bodies_get_the_same_force() -> None:
    contacts = landing(Solver(flicker=True), slides=lambda t: 0.05 * np.clip(t - 0.1, 0, 1))
    turned = (2**-0.5, 0.0, 0.0, 2**-0.5)  # the board's own axes lie across the scene's
    poses = contacts.poses
    rotation = np.where((poses.body == 0)[:, None], np.array(turned), poses.rotation)
    contacts = replace(contacts, poses=replace(poses, rotation=rotation))
    excited = events_of(SCENE, contacts).on(seed=4).bodies
    forces = {"board": np.zeros((RATE, 3)), "block": np.zeros((RATE, 3))}
    for name, body in excited.items():
        for action in body.actions:
            pushing = action.begin(body.model, RATE)
            way = action.direction if isinstance(action, Strike) else action.directions[0]
            push = pushing.advance(RATE)
            if push is not None:
                forces[name] += np.outer(push.force, way)
    board = forces["board"] @ np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]]).T
    largest = np.abs(board).max()
    assert largest > 0
    np.testing.assert_allclose(board, -forces["block"], atol=1e-12 * largest)


def test_a_box_that_slides_sweeps_the_floor_and_not_itself() -> None:
    for solver in (Solver(), Solver(flicker=True, sway=0.2)):
        contacts = landing(solver, slides=lambda t: 0.05 * np.clip(t - 0.1, 0, 1.0))
        (found,) = events_of(SCENE, contacts).sustained
        moving = (found.times > 0.2) & (found.times < 1.0)
        np.testing.assert_allclose(found.speeds[0][moving], 0.05, rtol=0.02)
        np.testing.assert_array_equal(found.speeds[1][moving], 0.0)
        np.testing.assert_array_equal(found.speeds[0][found.times > 1.2], 0.0)
        np.testing.assert_allclose(found.load[moving], 9.81 * MASS, rtol=0.05)


def test_a_ball_that_rolls_sweeps_both_bodies() -> None:
    radius, speed, step = 0.02, 0.3, 1e-3
    times = step * np.arange(800)
    way = speed * times
    half = way / radius / 2
    rotation = np.zeros((800, 2, 4))
    rotation[:, 0, 0] = 1.0
    rotation[:, 1] = np.stack([np.cos(half), 0 * half, np.sin(half), 0 * half], axis=1)
    place = np.zeros((800, 2, 3))
    place[:, 1] = np.stack([way - 0.12, 0 * way, np.full(800, 0.01 + radius)], axis=1)
    contacts = Contacts(
        names=["board", "ball"],
        time=times,
        dt=step,
        body0=np.zeros(800),
        body1=np.ones(800),
        position=place[:, 1] - [0, 0, radius],
        impulse=np.tile([0, 0, 0.2 * 9.81 * step], (800, 1)),
        velocity=np.zeros((800, 3)),
        poses=Poses.together(times, place, rotation),
    )
    ball = Body(model=RigidBody(mass=0.2, material=Material.named("steel")), roughness="steel")
    scene = Scene(bodies={"board": Body(model=BOARD, fixed=True), "ball": ball})
    (found,) = events_of(scene, contacts).sustained
    for sweep in found.speeds:
        np.testing.assert_allclose(sweep[5:-5], speed, rtol=0.02)
    assert np.abs(heard_scene(scene, contacts)).max() > 0


def heard_scene(scene: Scene, contacts: Contacts) -> Array:
    return struck.render(scene, contacts, listener=EAR, seconds=0.5).samples[0]


# The paper's own forces, and what is refused.


@pytest.mark.prove
def test_forces_of_2002_stay_by_name() -> None:
    contacts = landing(Solver(), seconds=0.3)
    events = events_of(SCENE, contacts)
    rows = len(contacts)
    for forces, duration in (("impulses2002", 0.0), ("gaussian2002", 3e-3), ("noise2002", 3e-3)):
        actions = events.on(forces=forces).bodies["board"].actions
        assert len(actions) == rows
        assert {each.duration for each in actions} == {duration}
        assert sum(each.impulse for each in actions) == pytest.approx(contacts.impulse[:, 2].sum())
    with pytest.raises(
        OptionError,
        match="forces is 'gauss': did you mean gaussian2002",
    ):
        events.on(forces="gauss")


@pytest.mark.prove
def test_a_gaussian_kernel_dulls_and_raw_steps_buzz() -> None:
    contacts = landing(Solver(), seconds=0.2)
    events, bright = events_of(SCENE, contacts), {}
    for forces in ("events", "impulses2002", "gaussian2002"):
        scene = events.on(forces=forces)
        sound = struck.render(scene, listener=EAR, seconds=0.6, sample_rate=16_000).samples[0]
        spectrum = np.square(np.abs(np.fft.rfft(sound)))
        bright[forces] = spectrum[round(0.6 * 1500) :].sum() / spectrum.sum()
    assert bright["impulses2002"] > bright["events"] > 10 * bright["gaussian2002"]


def test_blows_that_change_no_speed_are_counted_and_silent() -> None:
    scene = Scene(bodies={"a": Body(model=BOARD), "b": Body(model=BLOCK, position=(0, 0, 0.035))})
    events = events_of(scene, one_hit([0, 0, 0.01], [0, 0, 1e-6]))
    assert len(events.impacts) == 0
    assert events.notes == ("1 blow left out: no speed changes by more than 2 mm/s",)
    sound = struck.render(scene, one_hit([0, 0, 0.01], [0, 0, 1e-6]))
    assert not sound.samples.any()
    assert sound.notes[0] == events.notes[0]


def test_contacts_off_the_body_are_counted_or_refused() -> None:
    scene = Scene(bodies={"a": Body(model=BOARD), "b": Body(model=RigidBody(mass=0.1))})
    sound = struck.render(scene, one_hit([0, 0, 0.06], [0, 0, 0.01]), listener=EAR, seconds=0.1)
    assert "1 of 1 contacts of 'a' lay up to 0.05 m off its surface" in sound.notes[0]
    with pytest.raises(ContactError, match=r"contacts of 'a' are 60 m off.*units of the log"):
        struck.render(scene, one_hit([0, 0, 60.0], [0, 0, 0.01]), listener=EAR)


def test_gaps_between_poses_are_told() -> None:
    contacts = landing(Solver(), seconds=0.6)
    poses = contacts.poses
    for kept, count in (
        (poses.time < 0.3, 4 * 251),
        ((poses.time < 0.3) | (poses.time > 0.5), 4 * 202),
    ):
        rows = {
            name: getattr(poses, name)[kept] for name in ("time", "body", "position", "rotation")
        }
        notes = events_of(SCENE, replace(contacts, poses=Poses(**rows))).notes
        assert [note[: note.index(" of")] for note in notes] == [f"{count} contacts"] * 2, notes


def test_the_same_seed_gives_the_same_bytes_and_another_does_not() -> None:
    contacts = landing(Solver(flicker=True), slides=lambda t: 0.05 * np.clip(t - 0.1, 0, 1))
    first, second, other = (
        struck.render(events_of(SCENE, contacts).on(seed=seed), listener=EAR, seconds=0.4)
        for seed in (1, 1, 2)
    )
    assert first.samples.tobytes() == second.samples.tobytes()
    assert first.samples.tobytes() != other.samples.tobytes()


def test_contacts_without_their_scene_are_refused() -> None:
    with pytest.raises(OptionError, match="give Scene"):
        struck.render(BLOCK, one_hit([0, 0, 0], [0, 0, 1]))
    with pytest.raises(OptionError, match="a scene takes Contacts"):
        struck.render(SCENE, Strike())


def test_the_table_of_events_names_bodies_and_times() -> None:
    events = events_of(SCENE, landing(Solver(), slides=lambda t: 0.05 * np.clip(t - 0.1, 0, 1)))
    rows = events.table()
    assert [row["event"] for row in rows] == ["impact"] * 4 + ["sustained"] or rows[0][
        "time"
    ] == 0.1
    assert {row["body0"] for row in rows} == {"board"}
    assert sum(row["impulse"][2] for row in rows if row["event"] == "impact") == pytest.approx(
        0.5 * MASS, rel=1e-3
    )
