"""Contacts inferred from motion alone, against bouncing bodies whose blows are known exactly."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.errors import FileFormatError, OptionError
from struck.scene import (
    Body,
    Contacts,
    Poses,
    Scene,
    events_of,
    infer_contacts,
    load_animation,
)
from tests.scene.tumbling import Blow, Tumbler, ball, cube, scene_of, tumble, write_glb

Array = NDArray[np.float64]
RATE = 60.0


def thrown(seed: int, count: int) -> list[Tumbler]:
    chance = np.random.default_rng(seed)
    places = [np.array([*chance.uniform(-0.3, 0.3, 2), 0.3 + 0.25 * k]) for k in range(count)]
    return [(ball if k % 2 else cube)(chance, place) for k, place in enumerate(places)]


def inferred(bodies: list[Tumbler], seconds: float, folder: Path) -> tuple[list[Blow], Contacts]:
    blows = tumble(bodies, seconds, RATE)
    write_glb(bodies, RATE, folder / "scene.glb")
    motion = load_animation(folder / "scene.glb")
    poses = replace(motion.poses, body=motion.poses.body + 1)
    motion = replace(motion, names=("floor", *motion.names), poses=poses)
    return blows, infer_contacts(scene_of(bodies), motion)


def found_of(blow: Blow, log: Contacts) -> Sequence[int]:
    """Return the rows that tell of a blow, the nearest in time first."""
    ends = {blow.bodies[0] + 1, blow.bodies[1] + 1}
    near = np.flatnonzero((log.dt == 0) & (np.abs(log.time - blow.time) < 0.02))
    same = [row for row in near.tolist() if {int(log.body0[row]), int(log.body1[row])} == ends]
    return sorted(same, key=lambda row: abs(log.time[row] - blow.time))


def on_first(blow: Blow, log: Contacts, row: int) -> Array:
    return log.impulse[row] * (1 if log.body1[row] == blow.bodies[0] + 1 else -1)


def is_alone(blow: Blow, blows: Sequence[Blow]) -> bool:
    """Tell whether no other blow on either body is within 50 ms."""
    mine = set(blow.bodies) - {-1}
    others = [each for each in blows if each is not blow and mine & set(each.bodies)]
    return all(abs(each.time - blow.time) >= 0.05 for each in others)


def judged(blows: Sequence[Blow], log: Contacts) -> tuple[list[bool], list[bool]]:
    """Return which lone, strong blows are found, and which strong rows are true."""
    sizes = [float(np.linalg.norm(each.impulse)) for each in blows]
    least = 0.05 * max(sizes)
    found = []
    for blow, size in zip(blows, sizes, strict=True):
        if size < least or not is_alone(blow, blows):
            continue
        rows = found_of(blow, log)
        if rows:
            row = rows[0]
            missed = np.linalg.norm(on_first(blow, log, row) - blow.impulse) / size
            away = np.linalg.norm(log.position[row] - blow.place)
            late = abs(log.time[row] - blow.time)
        found.append(bool(rows) and late < 5e-3 and missed < 0.2 and away < 0.01)
    strong = np.flatnonzero((np.linalg.norm(log.impulse, axis=1) > least) & (log.dt == 0))
    told = {row for blow in blows for row in found_of(blow, log)}
    return found, [row in told for row in strong.tolist()]


def close_sums(blows: Sequence[Blow], log: Contacts) -> list[float]:
    """Return by what share the summed impulse of strong blows that are close is missed."""
    largest = max(float(np.linalg.norm(each.impulse)) for each in blows)
    missed = []
    for number in {body for blow in blows for body in blow.bodies} - {-1}:
        mine = [blow for blow in blows if number in blow.bodies]
        times = np.array([blow.time for blow in mine])
        for part in np.split(np.arange(len(mine)), np.flatnonzero(np.diff(times) > 0.05) + 1):
            low, high = times[part[0]] - 0.02, times[part[-1]] + 0.02
            signs = [1 if mine[k].bodies[0] == number else -1 for k in part]
            wanted = sum(s * mine[k].impulse for s, k in zip(signs, part, strict=True))
            if len(part) < 2 or np.linalg.norm(wanted) < 0.05 * largest or high > 10:
                continue
            middle = log.time + log.dt / 2
            rows = np.flatnonzero((middle > low) & (middle < high))
            got = sum(
                log.impulse[row]
                * (int(log.body1[row] == number + 1) - int(log.body0[row] == number + 1))
                for row in rows
            )
            missed.append(float(np.linalg.norm(got - wanted) / np.linalg.norm(wanted)))
    return missed


def test_blows_of_an_animation_are_found(tmp_path: Path) -> None:
    blows, log = inferred(thrown(3, 4), 1.0, tmp_path)
    found, true = judged(blows, log)
    assert len(found) >= 4
    assert all(found)
    assert all(true)


@pytest.mark.prove
def test_blows_of_many_animations_are_found_and_few_are_invented(tmp_path: Path) -> None:
    found, true, missed = [], [], []
    for seed in range(12):
        blows, log = inferred(thrown(seed, 6), 3.0, tmp_path)
        some, told = judged(blows, log)
        found += some
        true += told
        missed += close_sums(blows, log)
    assert len(found) > 60
    assert np.mean(found) >= 0.9
    assert np.mean(true) >= 0.9
    assert len(missed) > 80
    assert max(missed) < 0.3


@pytest.mark.prove
def test_what_lands_and_slides_is_a_blow_and_a_load() -> None:
    frames = np.arange(90) / RATE
    land, rate = 0.5037, 1 / RATE
    height = np.where(frames < land, 9.81 / 2 * (land**2 - frames**2), 0.0)
    place = np.zeros((90, 2, 3))
    place[:, 1] = np.column_stack([0.4 * frames, 0 * frames, 0.05 + height])
    poses = Poses.together(frames, place, np.tile([1.0, 0, 0, 0], (90, 2, 1)))
    tumbler = cube(np.random.default_rng(0), np.zeros(3))
    tumbler.mesh.apply_scale(0.1 / np.ptp(tumbler.mesh.vertices[:, 0]))
    scene = scene_of([tumbler])
    motion = Contacts.of_motion(["floor", "body 0"], poses)
    log = infer_contacts(scene, motion)
    (blow,) = np.flatnonzero(log.dt == 0)
    mass = float(scene.bodies["body 0"].model.mass or 0)
    assert log.time[blow] == pytest.approx(land, abs=3e-3)
    assert log.impulse[blow, 2] == pytest.approx(mass * 9.81 * land, rel=0.02)
    assert abs(log.position[blow, 2]) < 1e-3
    rest = (log.dt > 0) & (log.time > land + 3 * rate) & (log.time < frames[-3])
    np.testing.assert_allclose(log.impulse[rest, 2], mass * 9.81 * rate, rtol=1e-6)
    assert rest.sum() > 30
    # The same box, with a sound, is heard to slide.
    (found,) = events_of(audible(scene), log).sustained
    np.testing.assert_allclose(found.speeds[0][20:-20], 0.4, rtol=0.05)


def audible(scene: Scene) -> Scene:
    from tests.scene.boxes import box

    body = Body(model=box((0.1, 0.1, 0.1)))
    return Scene(bodies={**scene.bodies, "body 0": body})


def shown(body: Tumbler) -> Poses:
    """Return the poses of one body."""
    places, turns = (np.array(each) for each in zip(*body.shown, strict=True))
    times = np.arange(len(places)) / RATE
    return Poses.together(times, places[:, None], turns[:, None, [3, 0, 1, 2]])


def test_leaps_with_nothing_near_are_counted() -> None:
    bodies = thrown(3, 1)
    tumble(bodies, 1.0, RATE)
    poses = shown(bodies[0])
    scene = Scene(bodies={"body 0": scene_of(bodies).bodies["body 0"]})
    motion = Contacts.of_motion(["body 0"], poses)
    log = infer_contacts(scene, motion)
    assert len(log) == 0
    assert "leaps of speed with nothing near: left out" in log.notes[0]
    with pytest.raises(OptionError, match="no poses"):
        infer_contacts(scene, replace(motion, poses=None))
    uneven = replace(poses, time=poses.time + 0.02 * (poses.time > 0.15))
    with pytest.raises(OptionError, match="uneven times"):
        infer_contacts(scene, replace(motion, poses=uneven))


def test_files_without_an_animation_are_told(tmp_path: Path) -> None:
    (tmp_path / "a.gltf").write_text(json.dumps({"asset": {"version": "2.0"}}), encoding="utf-8")
    with pytest.raises(FileFormatError, match="no animation of a mesh"):
        load_animation(tmp_path / "a.gltf")
    for text in ("{", '{"nodes": 5}', '{"asset": []}', "[" * 100_000, '{"animations": [5]}'):
        (tmp_path / "b.gltf").write_text(text, encoding="utf-8")
        with pytest.raises(FileFormatError, match="no animation"):
            load_animation(tmp_path / "b.gltf")


def test_bodies_that_are_held_make_no_contacts() -> None:
    bodies = thrown(3, 1)
    tumble(bodies, 0.5, RATE)
    poses = shown(bodies[0])
    scene = scene_of(bodies)
    motion = Contacts.of_motion(["body 0", "floor"], poses)
    assert len(infer_contacts(scene, motion)) > 0
    held = replace(scene.bodies["body 0"], fixed=True)
    scene = replace(scene, bodies={**scene.bodies, "body 0": held})
    assert len(infer_contacts(scene, motion)) == 0
