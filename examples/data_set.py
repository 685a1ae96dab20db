"""Random bodies, struck at random: arrays of sounds and a table of labels.

python examples/data_set.py 200 makes two hundred bodies with five sounds each, on all processors.
The default is four bodies. Bodies that cannot be computed are listed with the reason.
"""

import csv
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np

import struck
from struck import Strike
from struck.errors import StruckError
from struck.shapes import Bar, CircularPlate
from struck.solids import Block

BODIES = int(sys.argv[1]) if sys.argv[1:] and sys.argv[1].isdigit() else 4
SOUNDS, SECONDS, RATE = 5, 1.0, 16_000  # of each body; s; Hz
BAND = (50.0, 7500.0)  # Hz; at most half of the sample rate
MATERIALS = ("steel", "aluminium", "glass", "oak", "acrylic", "ceramic")
STRIKERS = ("fingertip", "felt", "rubber", "wood", "steel")


def random_body(generator: np.random.Generator) -> Block | Bar | CircularPlate:
    """Draw a body of one of three kinds, with log-uniform dimensions."""
    long, wide, thin = (
        float(generator.uniform(*np.log(ends)))
        for ends in ((0.08, 0.4), (0.02, 0.08), (2e-3, 1e-2))
    )
    length, width, thickness = np.exp([long, wide, thin]).tolist()
    kind = generator.choice(["block", "bar", "plate"])
    if kind == "block":
        return Block(size=(length, width, thickness))
    if kind == "bar":
        return Bar(length=length, width=width, thickness=thickness, ends="free")
    return CircularPlate(radius=length / 2, thickness=thickness, edge="clamped")


def sounds_of(number: int) -> tuple[int, str, list[dict[str, object]], np.ndarray]:
    """Return the number of a body, the error message or "", its labels, and sounds (SOUNDS, n)."""
    generator = np.random.default_rng([27, number])  # the same in every process
    body, material = random_body(generator), str(generator.choice(MATERIALS))
    labels, sounds = [], np.zeros((SOUNDS, round(SECONDS * RATE)), np.float32)
    try:
        model = struck.analyze(body, material, accuracy="preview", band=BAND, cache=False)
        for row in range(SOUNDS):
            vertex = int(generator.integers(len(model.geometry.points)))
            striker, speed = str(generator.choice(STRIKERS)), float(generator.uniform(0.1, 2.0))
            strike = Strike(at=f"vertex:{vertex}", striker=striker, speed=speed)
            sound = struck.render(model, strike, seconds=SECONDS, sample_rate=RATE)
            sounds[row] = sound.samples[0]  # Pa, not normalised
            labels.append(
                {
                    "body": number,
                    "kind": repr(body),
                    "material": material,
                    "vertex": vertex,
                    "striker": striker,
                    "speed": speed,
                    "modes": len(model.frequencies),
                    "lowest": float(model.frequencies[:1].sum()),
                }
            )
    except StruckError as error:  # too many modes, no mode in the band, too thin for elements ...
        return number, str(error), [], sounds[:0]
    return number, "", labels, sounds


if __name__ == "__main__":
    for library in ("OMP", "OPENBLAS"):  # one thread in each process
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    # Spawned processes inherit no locks. Each holds one model in memory, and returns sounds only.
    labels, sounds, refused = [], [], []
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        for number, reason, rows, made in pool.map(sounds_of, range(BODIES)):
            labels += rows
            sounds.append(made)
            refused += [(number, reason)] * bool(reason)
    samples = np.concatenate(sounds)
    np.save("sounds.npy", samples)
    with open("labels.csv", "w", newline="", encoding="utf-8") as file:  # noqa: PTH123 - as in the documentation of csv
        table = csv.DictWriter(file, labels[0])
        table.writeheader()
        table.writerows(labels)
    peaks = np.abs(samples).max(axis=1)
    silent = np.count_nonzero(peaks == 0)  # for example struck at a clamped place
    ends = 20 * np.log10(np.array([peaks[peaks > 0].min(), peaks.max()]) / 2e-5)
    print(f"{len(samples)} sounds, {silent} silent, the others {ends.round()} dB re 20 uPa")
    for number, reason in refused:
        print(f"body {number} refused: {reason}")
    assert len(labels) == len(samples) == SOUNDS * (BODIES - len(refused))
