"""Processor time of everyday work in this tree and in another checkout of struck, in turns.

``python bench/versions.py PATH`` takes a checkout of an earlier version. Each tree has a process of
its own, and the two take turns at each piece of work; the median of the ratios is printed, and
whatever has become more than 5 % slower makes the run fail.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TextIO, cast

HERE = Path(__file__).parents[1]
SLOWER = 1.05
ALONE = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}


def everyday_work(folder: Path) -> dict[str, Callable[[], object]]:
    """Return what is timed, by name: only calls that both versions offer."""
    return bodies(folder) | sounds(folder) | ears_and_files(folder) | blocks()


def bodies(folder: Path) -> dict[str, Callable[[], object]]:
    """Return analyses: finite elements of meshes and tubes, closed forms."""
    import trimesh

    import struck
    from struck import shapes
    from struck.solids import Tube

    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.08)
    ball.vertices *= [1, 0.8, 1.2]
    ball.export(folder / "ball.stl")
    mesh = str(folder / "ball.stl")
    tube = Tube(length=0.5, radius=0.0125, wall=0.001)
    round_drum = shapes.CircularMembrane(radius=0.2, thickness=2.5e-4, tension=3000)
    drum = shapes.PolygonMembrane.l_shape(side=0.2, thickness=2.5e-4, tension=3000)
    bar = shapes.Bar(length=0.3, width=0.03, thickness=0.005, ends="free")
    flat = shapes.RectangularPlate(length=0.4, width=0.3, thickness=0.003)
    disc = shapes.CircularPlate(radius=0.15, thickness=0.002)
    return {
        "solid mesh": lambda: struck.analyze(mesh, "steel", accuracy="preview"),
        "hollow mesh": lambda: struck.analyze(mesh, "glass", wall=0.008, accuracy="preview"),
        "tube": lambda: struck.analyze(tube, "aluminium"),
        "round membrane": lambda: struck.analyze(round_drum, "steel", band=(20, 2500)),
        "L-shaped membrane": lambda: struck.analyze(drum, "steel", band=(20, 900)),
        "rectangular plate": lambda: struck.analyze(flat, "steel", band=(20, 8000)),
        "circular plate": lambda: struck.analyze(disc, "steel"),
        "five bars": lambda: [struck.analyze(bar, "steel") for _ in range(5)],
    }


def sounds(folder: Path) -> dict[str, Callable[[], object]]:
    """Return renders, and the fit of a model to a recording of one of them."""
    import numpy as np

    import struck
    from struck import Roll, Scrape, Strike
    from struck.shapes import RectangularPlate
    from struck.solids import Tube

    chime = struck.analyze(Tube(length=0.5, radius=0.0125, wall=0.001), "aluminium")
    flat = RectangularPlate(length=0.4, width=0.3, thickness=0.003)
    plate = struck.analyze(flat, "steel", band=(20, 8000))
    scrape = Scrape(path=[(0.05, 0.05), (0.3, 0.2)], speed=0.2, load=2.0, roughness="sandpaper")
    roll = Roll(path=["end", "middle"], radius=0.01, speed=0.1, mass=0.05)
    # The same for both: an earlier version hears no recoil.
    chance = np.random.default_rng(0)
    poles = -chance.uniform(2, 60, 40) + 2j * np.pi * np.sort(chance.uniform(300, 15_000, 40))
    rings = np.imag(
        chance.uniform(0.1, 1, 40) @ np.exp(np.outer(poles, np.arange(72_000) / 48_000))
    )
    samples = np.pad(rings[None] / (2 * np.abs(rings).max()), ((0, 0), (24_000, 0)))
    noise = 1e-4 * chance.standard_normal(samples.shape)
    tap = folder / "tap.wav"
    struck.Sound(samples=(samples + noise).astype(np.float32), sample_rate=48_000).save(tap)
    return {
        "ten strikes": lambda: [
            struck.render(chime, Strike(at="end"), seconds=2) for _ in range(10)
        ],
        "scrape": lambda: struck.render(plate, scrape, seconds=2),
        "roll": lambda: struck.render(chime, roll, seconds=2),
        "fit": lambda: struck.fit(str(tap), cache=False),
    }


def ears_and_files(folder: Path) -> dict[str, Callable[[], object]]:
    """Return what is heard by two ears, told of sounds, drawn and kept."""
    import struck
    from struck import Binaural, Body, Strike
    from struck.shapes import Bar

    bar = struck.analyze(Bar(length=0.3, width=0.03, thickness=0.005, ends="free"), "steel")
    moving = Body(
        model=bar, excitations=Strike(at=(0.02,)), position=([0, 1], [(-5, 3, 1), (5, 3, 1)])
    )
    ears = Binaural(position=(0, 1.5, 0), facing=(1, 0, 0))
    kept = folder / "bar.struck"

    def keep() -> None:
        struck.save(bar, kept)
        struck.load(kept)

    return {
        "two ears": lambda: struck.render([moving], listener=ears, seconds=1),
        "sound map": lambda: struck.sound_map(bar, 12.0),
        "sonic distances": lambda: [
            struck.sonic_distance(bar, bar, at=(0.02,), against=(0.15,)) for _ in range(20)
        ],
        "twenty files": lambda: [keep() for _ in range(20)],
        "picture": lambda: struck.show(bar, folder / "bar.png"),
    }


def blocks() -> dict[str, Callable[[], object]]:
    """Return blocks of resonators: modes, samples, outputs, one steady or moving push."""
    import numpy as np

    try:
        from struck.excitation import Push
    except ImportError:  # where it stood before the house was laid anew
        from struck.excitation.pushing import Push  # pyright: ignore[reportMissingImports]
    from struck.synth.resonators import Resonators

    def played(
        modes: int, block: int, points: int = 1, *, moving: bool = False
    ) -> Callable[[], None]:
        engine = Resonators([Bank(modes)], block=block, points=points)
        gains = np.ones((2, modes)) * [[1.0], [0.9]]
        pushes = [[Push(force=np.ones(block), drive=drive)] for drive in gains]
        engine.process(pushes[0], [np.ones((points, modes))])
        count = round(3e7 / (modes * block))

        def run() -> None:
            for number in range(count):
                engine.process(pushes[number % 2 if moving else 0])

        return run

    return {
        "256 modes by 64": played(256, 64),
        "1024 modes by 128": played(1024, 128),
        "8192 modes by 128": played(8192, 128),
        "the same, 2 outputs": played(8192, 128, 2),
        "1024 modes, moving": played(1024, 128, moving=True),
    }


class Bank:
    """What rings: Hz and 1/s."""

    def __init__(self, modes: int) -> None:
        import numpy as np

        self.frequencies = np.geomspace(30.0, 18e3, modes)
        self.decays = np.geomspace(0.5, 200.0, modes)


def serve() -> None:
    """Do the work named on each line of standard input; answer with its processor time, s."""
    with tempfile.TemporaryDirectory() as folder:
        work = everyday_work(Path(folder))
        print(*work, sep="|", flush=True)
        for line in sys.stdin:
            before = time.process_time()
            work[line.strip()]()
            print(time.process_time() - before, flush=True)


class Tree:
    """A process that works with the code of one checkout."""

    def __init__(self, root: Path) -> None:
        paths = {"PYTHONPATH": str(root / "src"), "PYTHONWARNINGS": "ignore"}
        process = subprocess.Popen(
            [sys.executable, __file__, "--serve"],
            env=os.environ | ALONE | paths | {"STRUCK_CACHE": "off", "MPLBACKEND": "Agg"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self._questions = cast("TextIO", process.stdin)
        self._answers = cast("TextIO", process.stdout)
        self.names = self._answers.readline().strip().split("|")

    def seconds(self, name: str) -> float:
        """Return the processor time that a piece of work takes once, s."""
        self._questions.write(f"{name}\n")
        self._questions.flush()
        return float(self._answers.readline())


def compare(root: Path, rounds: int, only: str) -> bool:
    """Print the ratio of each piece of work; return whether none is slower than allowed."""
    new, old = Tree(HERE), Tree(root)
    slower = []
    print(f"{'work':20}{'now, s':>10}{'then, s':>10}{'ratio':>8}{'lowest':>8}{'highest':>9}")
    for name in (name for name in new.names if only in name):
        for tree in (new, old):
            tree.seconds(name)  # what is compiled or read once is not counted
        pairs = [(new.seconds(name), old.seconds(name)) for _ in range(rounds)]
        ratios = sorted(now / then for now, then in pairs)
        middle = statistics.median(ratios)
        now, then = (statistics.median(side) for side in zip(*pairs, strict=True))
        row = f"{name:20}{now:10.3f}{then:10.3f}{middle:8.3f}{ratios[0]:8.3f}{ratios[-1]:9.3f}"
        print(row, flush=True)
        if middle > SLOWER:
            slower.append(name)
    print(f"more than 5 % slower: {', '.join(slower) or 'nothing'}")
    return not slower


def main() -> None:
    """Compare with the checkout that the command line names."""
    parser = argparse.ArgumentParser(description="Compare with an earlier version")
    parser.add_argument("checkout", type=Path, nargs="?", help="folder of the other version")
    parser.add_argument("--rounds", type=int, default=9, help="pairs of runs (9)")
    parser.add_argument("--only", default="", help="work whose name holds this")
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve:
        serve()
    elif options.checkout is None:
        parser.error("name the checkout of another version, as in: bench/versions.py ../before")
    else:
        sys.exit(not compare(options.checkout.resolve(), options.rounds, options.only))


if __name__ == "__main__":
    main()
