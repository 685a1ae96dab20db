"""`struck materials`: the table of materials with their sources."""

from __future__ import annotations

import argparse

import struck
from struck.cli import Result
from struck.errors import MaterialError, require_choice, rounded
from struck.model.html import aligned
from struck.model.provenance import TerminalProgress

EXAMPLES = ("--json", "steel oak")


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `struck materials`."""
    parser.add_argument("names", nargs="*", metavar="NAME", help="name of a material; default: all")


def run(options: argparse.Namespace, _progress: TerminalProgress) -> Result:
    """Run `struck materials`."""
    materials = struck.materials()
    full_name = " ".join(options.names)  # "cast iron" is one name, with quotes and without
    names = [full_name] if full_name in materials else options.names
    for name in names:
        require_choice("material", name, materials, MaterialError)
    entries = {name: materials[name] for name in names or materials}
    head = ("material", "kg/m3", "GPa", "Poisson", "tan phi", "heard")
    rows = [
        (
            name,
            f"{entry['density']:.0f}",
            rounded(entry["youngs_modulus"] / 1e9, 4),
            rounded(entry["poisson_ratio"], 3),
            rounded(entry["loss_tangent"], 2),
            "yes" if "heard" in entry else "",
        )
        for name, entry in entries.items()
    ]
    sources = [f"{name}: {entries[name]['source']}" for name in dict.fromkeys(names)]
    return Result(
        [*aligned([head, *rows]), *sources],
        **{name: dict(entry) for name, entry in entries.items()},
    )
