"""Draw the layers of struck and the imports between them: docs/images/layers.png.

Run it after a change of subpackages: `python docs/layers.py` also prints the table of the page.
"""

from __future__ import annotations

import tomllib
from collections import Counter
from pathlib import Path

import grimp
import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

mpl.use("Agg")
import matplotlib.pyplot as plt  # the backend is chosen first

ROOT = Path(__file__).parents[1]
PICTURE = ROOT / "docs/images/layers.png"
BLUE, GREY = "#2a6f97", "#8d99ae"


def layers() -> list[list[str]]:
    """Return the packages of each layer from top to bottom, in the order of the contract."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = settings["tool"]["importlinter"]["contracts"]
    rows = next(contract["layers"] for contract in contracts if contract["type"] == "layers")
    names = [[name.strip() for name in row.split(":")] for row in rows]
    return [[name for name in row if not name.startswith(("(", "_"))] for row in names]


def imports() -> Counter[tuple[str, str]]:
    """Return how many modules of one package import modules of another."""
    graph = grimp.build_graph("struck", cache_dir=None)
    pairs: Counter[tuple[str, str]] = Counter()
    for module in graph.modules:
        for imported in graph.find_modules_directly_imported_by(module):
            packages = [name.split(".")[1] for name in (module, imported) if "." in name]
            if len(packages) == 2 and packages[0] != packages[1]:
                pairs[packages[0], packages[1]] += 1
    return pairs


def sizes(package: str) -> tuple[int, int]:
    """Return the number of modules and of lines of a package."""
    folder = ROOT / "src/struck" / package
    files = list(folder.rglob("*.py")) or [folder.with_suffix(".py")]
    lines = sum(len(file.read_text(encoding="utf-8").splitlines()) for file in files)
    return len(files), lines


def table() -> list[str]:
    """Return a Markdown table with one row per package: its size and its imports."""
    pairs = imports()
    rows = ["| package | modules | lines | imports |", "|---|---|---|---|"]
    order = [package for row in layers() for package in row]
    for package in order:
        count, lines = sizes(package)
        below = ", ".join(other for other in order if (package, other) in pairs)
        rows.append(f"| {package} | {count} | {round(lines, -2)} | {below or 'nothing'} |")
    return rows


def draw() -> None:
    """Draw the packages from top to bottom, and an arc for each pair of which one imports."""
    rows = [row for row in layers() if row]
    figure, axes = plt.subplots(figsize=(8, 11), layout="constrained")
    positions: dict[str, tuple[float, float]] = {}
    for level, row in enumerate(rows):
        for column, package in enumerate(row):
            width = 2.0 / len(row)
            positions[package] = (column * (width + 0.1), -float(level))
            draw_package(axes, package, *positions[package], width)
    strongest = max(imports().values())
    for (upper, lower), many in imports().items():
        if upper in positions and lower in positions:
            (_, top), (_, bottom) = positions[upper], positions[lower]
            arc = FancyArrowPatch(
                (2.15, top),
                (2.15, bottom),
                connectionstyle=f"arc3,rad={-0.25 - 0.02 * (top - bottom)}",
                arrowstyle="-|>",
                mutation_scale=9,
                color=BLUE,
                alpha=0.25 + 0.6 * many / strongest,
                linewidth=0.6 + 2.5 * many / strongest,
            )
            axes.add_patch(arc)
    axes.set(xlim=(-0.1, 4.1), ylim=(-len(rows) + 0.3, 0.7))
    axes.axis("off")
    figure.savefig(PICTURE, dpi=110)


def draw_package(axes: Axes, package: str, left: float, height: float, width: float) -> None:
    """Draw the box of a package with its name and size."""
    box = FancyBboxPatch(
        (left, height - 0.3),
        width,
        0.6,
        boxstyle="round,pad=0.02",
        facecolor="white",
        edgecolor=BLUE,
        linewidth=1.2,
    )
    axes.add_patch(box)
    count, lines = sizes(package)
    centre = left + width / 2
    axes.text(centre, height + 0.07, package, ha="center", va="center", fontsize=11, weight="bold")
    small = f"{count} modules, {lines:,} lines" if count > 1 else f"{lines} lines"
    axes.text(centre, height - 0.17, small, ha="center", va="center", fontsize=6.5, color=GREY)


if __name__ == "__main__":
    draw()
    print("\n".join(table()))
