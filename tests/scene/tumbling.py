"""Bouncing balls and cubes, exact between blows and at them, and their animation as a GLB file.

A ball or a cube turns evenly in flight, as its moments of inertia are all the same; so flights are
closed forms, and the time of the next blow is a root.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import struck
from struck.model.material import Material
from struck.scene import Body, RigidBody, Scene

Array = NDArray[np.float64]
GRAVITY = np.array([0.0, 0.0, -9.81])
REBOUND, FRICTION = 0.7, 0.2
LOOK = 2e-3  # s, from one look for blows to the next
SLOWEST = 0.05  # m/s, of approach: the scene ends before bodies come to rest


@dataclass(kw_only=True)
class Tumbler:
    """A ball (`corners` empty, `radius`) or a cube in flight."""

    mesh: trimesh.Trimesh
    mass: float
    inertia: float
    radius: float
    corners: Array
    place: Array
    pace: Array
    turn: Rotation
    spin: Array
    since: float = 0.0
    shown: list[tuple[Array, Array]] = field(default_factory=list)

    def at(self, time: float) -> tuple[Array, Rotation]:
        t = time - self.since
        place = self.place + self.pace * t + GRAVITY * t * t / 2
        return place, Rotation.from_rotvec(self.spin * t) * self.turn

    def advance(self, time: float) -> None:
        self.place, self.turn = self.at(time)
        self.pace = self.pace + GRAVITY * (time - self.since)
        self.since = time

    def points(self, time: float) -> Array:
        """Return what may touch the floor (n, 3), the radius apart."""
        place, turn = self.at(time)
        return place + (turn.apply(self.corners) if len(self.corners) else np.zeros((1, 3)))

    def height(self, time: float) -> float:
        return float(self.points(time)[:, 2].min()) - self.radius

    def speed_at(self, point: Array) -> Array:
        return self.pace + np.cross(self.spin, point - self.place)

    def push(self, point: Array, impulse: Array) -> None:
        self.pace = self.pace + impulse / self.mass
        self.spin = self.spin + np.cross(point - self.place, impulse) / self.inertia

    def mobility(self, point: Array, way: Array) -> float:
        torque = np.cross(point - self.place, way)
        return 1 / self.mass + float(torque @ torque) / self.inertia


@dataclass(frozen=True, kw_only=True)
class Blow:
    """What truly happened: the impulse is on the first body."""

    time: float
    bodies: tuple[int, int]  # -1 is the floor
    impulse: Array
    place: Array


def ball(chance: np.random.Generator, place: Array) -> Tumbler:
    radius = chance.uniform(0.03, 0.06)
    mass = 700 * 4 / 3 * np.pi * radius**3
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=radius)
    return _thrown(chance, mesh, mass, 0.4 * mass * radius**2, radius, np.zeros((0, 3)), place)


def cube(chance: np.random.Generator, place: Array) -> Tumbler:
    edge = chance.uniform(0.05, 0.1)
    mesh = trimesh.creation.box((edge, edge, edge)).subdivide()
    corners = edge / 2 * np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)])
    mass = 700 * edge**3
    return _thrown(chance, mesh, mass, mass * edge**2 / 6, 0.0, corners, place)


def _thrown(
    chance: np.random.Generator,
    mesh: trimesh.Trimesh,
    mass: float,
    inertia: float,
    radius: float,
    corners: Array,
    place: Array,
) -> Tumbler:
    return Tumbler(
        mesh=mesh,
        mass=mass,
        inertia=inertia,
        radius=radius,
        corners=corners,
        place=place,
        pace=chance.normal(0, 0.5, 3),
        turn=Rotation.random(rng=chance),
        spin=chance.normal(0, 4, 3),
    )


def _root(gap: object, low: float, high: float) -> float:
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if gap(middle) > 0 else (low, middle)
    return low


def _strike(one: Tumbler, other: Tumbler | None, point: Array, normal: Array) -> Array:
    """Let two bodies rebound with friction; return the impulse on the first, along the normal."""
    speed = one.speed_at(point) - (np.zeros(3) if other is None else other.speed_at(point))
    light = one.mobility(point, normal) + (0 if other is None else other.mobility(point, normal))
    impulse = -(1 + REBOUND) * float(speed @ normal) / light
    slip = speed - (speed @ normal) * normal
    size = float(np.linalg.norm(slip))
    push = impulse * normal
    if size > 1e-9:
        way = -slip / size
        across = one.mobility(point, way) + (0 if other is None else other.mobility(point, way))
        push = push + way * min(FRICTION * impulse, size / across)
    one.push(point, push)
    if other is not None:
        other.push(point, -push)
    return push


def tumble(bodies: list[Tumbler], seconds: float, rate: float = 60.0) -> list[Blow]:
    """Let bodies fall and bounce; show them at a rate, and return their blows."""
    blows: list[Blow] = []
    frames, now = np.arange(round(seconds * rate)) / rate, 0.0
    times = np.unique(np.round(np.concatenate([frames, np.arange(0, seconds, LOOK)]), 9))
    shown = 0
    for then in times:
        while True:
            first = _first(bodies, now, then)
            if first is None:
                break
            time, number, other = first
            one, two = bodies[number], None if other < 0 else bodies[other]
            for each in (one, two):
                if each is not None:
                    each.advance(time)
            if two is None:
                points = one.points(time)
                point = points[np.argmin(points[:, 2])] - [0, 0, one.radius]
                normal = np.array([0, 0, 1.0])
            else:
                normal = (one.place - two.place) / np.linalg.norm(one.place - two.place)
                point = two.place + two.radius * normal
            speed = one.speed_at(point) - (0 if two is None else two.speed_at(point))
            if -speed @ normal < SLOWEST:
                return blows
            push = _strike(one, two, point, normal)
            blows.append(Blow(time=time, bodies=(number, other), impulse=push, place=point))
            now = time
        now = then
        if shown < len(frames) and abs(frames[shown] - then) < 1e-9:
            for each in bodies:
                place, turn = each.at(then)
                each.shown.append((place, turn.as_quat()))
            shown += 1
    return blows


def _first(bodies: list[Tumbler], now: float, then: float) -> tuple[float, int, int] | None:
    """Return time and bodies of the first blow in a short while."""
    found = []
    for number, one in enumerate(bodies):
        gap = one.height
        if gap(then) < 0 and _falls(one, then):
            found.append((_root(gap, max(now, one.since), then), number, -1))
        for other in range(number):
            two = bodies[other]
            if len(one.corners) or len(two.corners):
                continue  # balls alone hit each other

            def apart(time: float, one: Tumbler = one, two: Tumbler = two) -> float:
                way = one.at(time)[0] - two.at(time)[0]
                return float(np.linalg.norm(way)) - one.radius - two.radius

            if apart(then) < 0 and apart(then) < apart(max(then - 1e-6, one.since, two.since)):
                begin = max(now, one.since, two.since)
                found.append((_root(apart, begin, then), number, other))
    return min(found, default=None)


def _falls(one: Tumbler, then: float) -> bool:
    return one.height(then) < one.height(max(then - 1e-6, one.since)) or then - one.since < 1e-6


def scene_of(bodies: list[Tumbler]) -> Scene:
    """Return the bodies, silent, on a floor."""
    plate = trimesh.creation.box((20, 20, 0.1)).subdivide()
    plate.apply_translation((0, 0, -0.05))
    wood = Material.named("oak")
    floor = RigidBody(geometry=_mesh(plate), material=wood)
    named = {"floor": Body(model=floor, fixed=True)}
    for number, each in enumerate(bodies):
        model = RigidBody(
            geometry=_mesh(each.mesh),
            material=wood,
            mass=each.mass,
            centre=np.zeros(3),
            inertia=np.eye(3) * each.inertia,
        )
        named[f"body {number}"] = Body(model=model)
    return Scene(bodies=named)


def _mesh(mesh: trimesh.Trimesh) -> struck.Mesh:
    return struck.Mesh(points=np.asarray(mesh.vertices), faces=np.asarray(mesh.faces))


def write_glb(bodies: list[Tumbler], rate: float, path: Path) -> None:
    """Write a GLB file with an animation of the bodies, as modelling programs do."""
    data, views, accessors = b"", [], []

    def accessor(values: Array, kind: str, form: str) -> int:
        nonlocal data
        array = np.ascontiguousarray(values, "<u4" if form == "index" else "<f4")
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": array.nbytes})
        data += array.tobytes()
        accessors.append(
            {
                "bufferView": len(views) - 1,
                "componentType": 5125 if form == "index" else 5126,
                "count": len(array),
                "type": kind,
            }
        )
        return len(accessors) - 1

    nodes, meshes, samplers, channels = [], [], [], []
    times = accessor(np.arange(len(bodies[0].shown)) / rate, "SCALAR", "number")
    for number, each in enumerate(bodies):
        position = accessor(np.asarray(each.mesh.vertices), "VEC3", "number")
        index = accessor(np.asarray(each.mesh.faces).ravel(), "SCALAR", "index")
        meshes.append({"primitives": [{"attributes": {"POSITION": position}, "indices": index}]})
        nodes.append({"name": f"body {number}", "mesh": number})
        courses = (
            ("translation", "VEC3", [place for place, _ in each.shown]),
            ("rotation", "VEC4", [turn for _, turn in each.shown]),
        )
        for path_, kind, values in courses:
            output = accessor(np.array(values), kind, "number")
            samplers.append({"input": times, "output": output, "interpolation": "LINEAR"})
            target = {"node": number, "path": path_}
            channels.append({"sampler": len(samplers) - 1, "target": target})
    head = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "scene": 0,
        "nodes": nodes,
        "meshes": meshes,
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(data)}],
        "animations": [{"samplers": samplers, "channels": channels}],
    }
    text = json.dumps(head).encode()
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    chunks = b"".join(
        len(part).to_bytes(4, "little") + kind + part
        for part, kind in ((text, b"JSON"), (data, b"BIN\0"))
    )
    size = (12 + len(chunks)).to_bytes(4, "little")
    path.write_bytes(b"glTF" + (2).to_bytes(4, "little") + size + chunks)
