"""Compare the results of two trees to the bit, and their processor time, room by room.

`python .ci/same_results.py BASE` checks out the revision BASE and runs the same cases in both,
one process for each tree, case and round, in turn, and prints a line for each room. It fails if a
result differs, or if the ratio of processor times exceeds 1.05 in a room: of the least of all
rounds, as other programs on the machine only ever add to a time.

Cases use public names only. A result is hashed with the bytes of its arrays.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[1]
BOUND = 1.05  # ratio of processor times
ROUNDS = 3
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
Case = Callable[[], Iterator[Any]]
CASES: dict[str, Case] = {}


def case(function: Case) -> Case:
    """Register the case of a room under its name."""
    CASES[function.__name__] = function
    return function


def block() -> Any:  # noqa: ANN401 - a model
    """Return the model of a steel block."""
    import struck
    from struck.solids import Block

    body = Block(size=(0.2, 0.1, 0.01))
    return struck.analyze(body, "steel", accuracy="preview", progress=None, cache=False)


def ball(folder: Path) -> Path:
    """Return the path of a mesh file."""
    import trimesh

    path = folder / "ball.stl"
    trimesh.creation.icosphere(subdivisions=2, radius=0.08).export(path)
    return path


def taps(number: int) -> Any:  # noqa: ANN401 - a sound
    """Return a sound of decaying tones in noise, some of them close pairs."""
    import struck

    rng = np.random.default_rng(1)
    t = np.arange(72_000) / 48_000
    f = np.sort(rng.uniform(200, 9000, number))
    d, a = rng.uniform(3, 60, number), rng.uniform(0.05, 1, number)
    f, d, a = (np.append(x, x[:4] + shift) for x, shift in ((f, 1.5), (d, 1.0), (a, 0.0)))
    tones = a[:, None] * np.exp(-d[:, None] * t) * np.sin(2 * np.pi * f[:, None] * t)
    samples = np.pad(tones.sum(axis=0), (24_000, 0))
    samples = 0.3 * samples / np.abs(samples).max() + 1e-4 * rng.standard_normal(len(samples))
    return struck.Sound(samples=np.float32(samples)[None], sample_rate=48_000)


def facts(model: Any) -> Iterator[Any]:  # noqa: ANN401 - a model
    """Yield frequencies, decays and gains of a model."""
    yield model.frequencies
    yield model.decays
    contact = model.contact(None)
    yield model.gains.at(contact.point[None], contact.direction[None])
    yield model.gains.toward(np.array([[0.3, 0.2, 1.0]]))


@case
def analysis() -> Iterator[Any]:
    """Yield the results of a block and a tuned tube."""
    import struck
    from struck.solids import Tube

    yield from facts(block())
    tube = Tube(length=0.3, radius=0.0125, wall=0.001)
    yield struck.tune(tube, "aluminium", vary="length", lowest="A4", progress=None)


@case
def batch() -> Iterator[Any]:
    """Yield the results of a folder of one mesh."""
    import struck

    folder = Path.cwd()
    ball(folder)
    struck.analyze_many(
        "*.stl", "steel", out="models", accuracy="preview", progress=None, cache=False
    )
    for path in sorted(folder.glob("models/**/*.struck")):
        yield from facts(struck.load(path))


@case
def cli() -> Iterator[Any]:
    """Yield the results of the file that a command writes."""
    from struck.cli import main

    bar = "bar:length=0.3,width=0.03,thickness=0.005,ends=free"
    main(["analyze", bar, "--material", "steel", "--quiet", "-o", "bar.struck"])
    main(["render", "bar.struck", "--strike", "end", "--quiet", "-o", "bar.wav"])
    yield Path("bar.wav").read_bytes()


@case
def ears() -> Iterator[Any]:
    """Yield the results of one ear, a measured and a spherical head, and a room."""
    import struck

    model = block()
    blow = struck.Strike(at="top", striker="wood", speed=1.0)
    heads = [struck.Mono(position=(0, 1, 1)), struck.Binaural(position=(0, 1, 1))]
    heads += [struck.Stereo(position=(0, 1, 1))]
    for head in heads:
        yield struck.render(model, blow, seconds=1.0, listener=head).samples
    room = struck.Room(size=(5, 4, 3), walls="plaster")
    places = {"listener": struck.Mono(position=(1, 1, 1.5)), "room": room}
    body = struck.Body(model=model, position=(3, 2, 1), excitations=[blow])
    yield struck.render(body, seconds=1.0, **places).samples


@case
def excitation() -> Iterator[Any]:
    """Yield the results of scrapes, a roll and a pluck."""
    import struck

    model = block()
    path = {"path": [(-0.08, 0, 0.005), (0.08, 0.02, 0.005)], "repeat": "back"}
    for roughness in ("wood", "sandpaper"):
        scrape = struck.Scrape(**path, speed=0.15, load=1.0, roughness=roughness)
        yield struck.render(model, scrape, seconds=2.0).samples
    roll = struck.Roll(**path, speed=0.5, load=1.0, radius=0.01)
    yield struck.render(model, roll, seconds=2.0).samples
    yield struck.render(model, struck.Pluck(at="top", force=1.0), seconds=1.0).samples


@case
def files() -> Iterator[Any]:
    """Yield the results of a model and a mesh read from files."""
    import struck

    model = block()
    struck.save(model, "block.struck")
    yield from facts(struck.load("block.struck"))
    mesh = struck.files.load_surface(ball(Path.cwd()))
    yield mesh.points
    yield mesh.faces


@case
def model() -> Iterator[Any]:
    """Yield the results of a scaled, a recast and a tuned model."""
    body = block()
    for other in (body.scaled(1.3), body.made_of("glass"), body.tuned(lowest=440.0)):
        yield from facts(other)


@case
def perception() -> Iterator[Any]:
    """Yield the results of audible modes, a distance and a map."""
    import struck

    body = block()
    yield struck.audible(body).frequencies
    yield struck.sonic_distance(body, body.made_of("glass"))
    yield struck.sound_map(body, progress=None).gains


@case
def radiation() -> Iterator[Any]:
    """Yield the results of a computed sound field."""
    import struck
    from struck.solids import Block

    body = Block(size=(0.08, 0.06, 0.03))
    options = {"accuracy": "preview", "radiation": "field", "band": (20, 9000)}
    field = struck.analyze(body, "oak", progress=None, cache=False, **options)
    yield field.gains.toward(np.random.default_rng(0).uniform(0.2, 1.0, (20, 3)))


@case
def recordings() -> Iterator[Any]:
    """Yield the results of three fits."""
    import struck

    for number, options in ((12, {}), (12, {"modes": None}), (30, {"modes": 20})):
        fitted = struck.fit(taps(number), cache=False, progress=None, **options)
        yield fitted.frequencies
        yield fitted.decays


@case
def scene() -> Iterator[Any]:
    """Yield the results of a simulation and its sound."""
    import struck

    Path("fall.xml").write_text(
        '<mujoco><option timestep="0.001"/><worldbody>'
        '<geom name="floor" type="plane" size="1 1 0.1"/>'
        '<body name="box" pos="0 0 0.2"><freejoint/>'
        '<geom name="box" type="box" size="0.05 0.03 0.01" density="700"/></body>'
        "</worldbody></mujoco>",
        encoding="utf-8",
    )
    options = {"accuracy": "preview", "materials": {"box": "oak"}, "progress": None}
    scene, log = struck.simulate("fall.xml", seconds=1.0, **options)
    yield log.impulse
    yield struck.render(scene, log, listener=(0.5, 0.0, 1.0)).samples


@case
def shapes() -> Iterator[Any]:
    """Yield the results of six closed forms."""
    import struck
    from struck import shapes as forms

    skin = {"thickness": 2.5e-4, "tension": 3000.0}
    bodies = [
        forms.Bar(length=0.3, width=0.03, thickness=0.005, ends="free"),
        forms.CircularPlate(radius=0.1, thickness=0.002, edge="free"),
        forms.RectangularPlate(length=0.3, width=0.2, thickness=0.003, edges="free"),
        forms.CircularMembrane(radius=0.15, **skin),
        forms.RectangularMembrane(length=0.4, width=0.4, **skin),
        forms.PolygonMembrane.l_shape(side=0.2, **skin),
    ]
    for body in bodies:
        yield from facts(struck.analyze(body, "steel", band=(20, 500), progress=None))


@case
def solids() -> Iterator[Any]:
    """Yield the results of four meshes."""
    import trimesh

    import struck

    made = trimesh.creation
    bodies = {
        "torus": (made.torus(0.05, 0.006), {}),
        "sheet": (made.box((0.2, 0.15, 0.004)), {}),
        "hollow": (made.icosphere(subdivisions=3, radius=0.05), {"wall": 0.004}),
        "annulus": (made.annulus(0.03, 0.05, 0.06), {}),
    }
    options = {"accuracy": "preview", "units": "m", "cache": False, "progress": None}
    for body, wall in bodies.values():
        yield from facts(struck.analyze(body, "steel", **options, **wall))


@case
def synth() -> Iterator[Any]:
    """Yield the results of a hundred strikes."""
    import struck

    model = block()
    blows = [struck.Strike(at="top", impulse=0.01, time=0.01 * k) for k in range(100)]
    yield struck.render(model, blows, seconds=8.0).samples


def digest(values: Iterator[Any]) -> str:
    """Return a hash of arrays, bytes, numbers and models."""
    total = hashlib.sha256()
    for value in values:
        if isinstance(value, bytes):
            total.update(value)
        elif isinstance(value, np.ndarray | np.number | float | int):
            total.update(np.ascontiguousarray(value).tobytes())
        elif hasattr(value, "frequencies"):
            total.update(digest(facts(value)).encode())
        else:
            total.update(repr(value).encode())
    return total.hexdigest()[:16]


def run(room: str) -> None:
    """Run one case in this process and print its digest and processor time, s."""
    start = time.process_time()
    value = digest(CASES[room]())
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = time.process_time() - start + children.ru_utime + children.ru_stime
    print(json.dumps([value, seconds]))


def measured(tree: Path, room: str) -> tuple[str, float]:
    """Return the digest and the processor time of a case in a tree."""
    environment = {**os.environ, **dict.fromkeys(THREADS, "1"), "STRUCK_CACHE": "off"}
    environment |= {"PYTHONPATH": str(tree / "src"), "MPLBACKEND": "Agg"}
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, "-W", "ignore", str(Path(__file__).resolve()), "--run", room],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
    if done.returncode:
        return f"failed: {done.stderr.strip().splitlines()[-1]}", float("nan")
    value, seconds = json.loads(done.stdout.splitlines()[-1])
    return value, seconds


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("base", nargs="?", default="HEAD", help="revision to compare with")
    parser.add_argument("--run", metavar="ROOM", choices=CASES, help=argparse.SUPPRESS)
    parser.add_argument("--rooms", nargs="+", choices=CASES, default=list(CASES))
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    options = parser.parse_args()
    if options.run:
        run(options.run)
        return 0
    failures = 0
    with tempfile.TemporaryDirectory() as scratch:
        base = Path(scratch) / "base"
        git = ("git", "-C", str(ROOT))
        subprocess.run([*git, "worktree", "add", "-q", "--detach", base, options.base], check=True)
        try:
            core = base / "src/struck/core/build.py"
            subprocess.run([sys.executable, core], check=True, stdout=subprocess.DEVNULL)
            for room in options.rooms:
                pairs = [
                    [measured(tree, room) for tree in (base, ROOT)] for _ in range(options.rounds)
                ]
                digests = {value for pair in pairs for value, _ in pair}
                seconds = min(time for _, (_, time) in pairs)
                ratio = seconds / min(time for (_, time), _ in pairs)
                same = len(digests) == 1 and not any("failed" in each for each in digests)
                failures += not same or ratio > BOUND
                word = "identical" if same else f"DIFFERENT {sorted(digests)}"
                print(f"{room:12}{word}  {seconds:6.2f} s, ratio {ratio:.3f}", flush=True)
        finally:
            subprocess.run([*git, "worktree", "remove", "--force", base], check=True)
    return bool(failures)


if __name__ == "__main__":
    sys.exit(main())
