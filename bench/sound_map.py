"""How many contacts a sound map stores, against regular grids of the same worst error.

    python bench/sound_map.py [folder]

prints the table, and draws ``sound_map.png`` and ``sound_map_grids.png`` into the folder.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from struck import ModalModel, analyze, sound_map
from struck.perception.sonic_distance import HeardModel, band_excess, erb_distance
from struck.report.charts import save
from struck.report.sound_map_picture import sound_map_picture
from struck.shapes import RectangularPlate

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

SIZE = np.array([0.30, 0.22])
THRESHOLDS = (6.0, 4.0, 3.0, 2.5)
SIDES = (9, 13, 17, 25, 33, 49, 65, 97)
CONTACTS = 10_000


def main(folder: Path) -> None:
    """Measure, print and draw."""
    shape = RectangularPlate(length=0.30, width=0.22, thickness=0.003, edges="clamped")
    plate = analyze(shape, "steel", band=(20, 16_000))
    maps = [sound_map(plate, threshold) for threshold in THRESHOLDS]
    print(f"clamped steel plate, {len(plate.frequencies)} modes")
    for made in maps:
        print(f"map: {len(made.contacts):6d} contacts for both sides, at most {made.bound:.2f} dB")
    grids = [[worst_of_a_grid(plate, side, straight) for side in SIDES] for straight in (1, 0)]
    for side, straight, nearest in zip(SIDES, *grids, strict=True):
        print(f"grid: {side**2:5d} on top, {straight:5.1f} dB straight, {nearest:5.1f} dB nearest")
    save(sound_map_picture(maps[THRESHOLDS.index(3.0)]), folder / "sound_map.png")
    save(
        compared([(len(m.contacts), m.bound) for m in maps], grids), folder / "sound_map_grids.png"
    )


def worst_of_a_grid(plate: ModalModel, side: int, straight: bool) -> float:  # noqa: FBT001
    """Return the worst sonic distance of many contacts on top when side^2 of them are stored.

    Played by their signed gains, straight between the four around, or by the nearest one at the
    level that it should have; its grid stands in the middles of its cells.
    """
    hearing, random = HeardModel.at(plate), np.random.default_rng(1)
    shares = random.uniform(0, 1, (CONTACTS, 2))
    true = played(hearing, shares)
    if straight:
        told = between(hearing, shares * (side - 1), side)
    else:
        told = played(hearing, (np.floor(shares * side) + 0.5) / side)
        told *= (np.linalg.norm(true, axis=1) / np.linalg.norm(told, axis=1))[:, None]
    excess = [band_excess(plate.frequencies, np.square(each)) for each in (true, told)]
    return float(erb_distance(*excess).max())


def between(hearing: HeardModel, places: Array, side: int) -> Array:
    """Return what lies straight between the four nodes around places (K, 2)."""
    corner = np.minimum(np.floor(places), side - 2)
    told = 0.0
    for step in ((0, 0), (0, 1), (1, 0), (1, 1)):
        node = corner + step
        share = np.prod(1 - np.abs(places - node), axis=1)[:, None]
        told = told + share * played(hearing, node / (side - 1))
    return np.asarray(told)


def played(hearing: HeardModel, shares: Array) -> Array:
    """Return the amplitudes of pushes from above at shares (K, 2) of both sides."""
    points = np.column_stack([shares * SIZE, np.full(len(shares), 0.0015)])
    return hearing.amplitudes(points, np.tile([0.0, 0.0, -1.0], (len(points), 1)))


def compared(maps: list[tuple[int, float]], grids: list[list[float]]) -> Figure:
    """Draw worst errors over numbers of contacts."""
    figure = Figure(figsize=(7.0, 4.2), dpi=120, layout="constrained", facecolor="white")
    axes = figure.subplots()
    counts = np.square(SIDES)
    axes.plot(
        counts,
        grids[0],
        "s-",
        color="#a33b20",
        ms=4,
        label="regular grid, signed gains (worst of 10,000)",
    )
    axes.plot(
        counts,
        grids[1],
        "^-",
        color="#c98a1b",
        ms=4,
        label="regular grid, nearest (worst of 10,000)",
    )
    axes.plot(
        *zip(*maps, strict=True), "o-", color="#20558a", ms=5, label="sound map (bound everywhere)"
    )
    axes.axhline(3, color="#6b6b6b", linewidth=0.8, linestyle=":")
    axes.set(xscale="log", yscale="log", ylim=(1.5, 40), xlabel="stored contacts")
    axes.set(ylabel="worst sonic distance (dB)", title="A clamped steel plate, 85 dB")
    axes.set_yticks([2, 3, 5, 10, 20, 30], labels=["2", "3", "5", "10", "20", "30"])
    axes.minorticks_off()
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)
    return figure


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path())
