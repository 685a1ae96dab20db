"""Solids of simple form: as many modes at preview as finer elements have, within stated errors."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

import numpy as np
import pytest

import struck
from struck.errors import OptionError
from struck.solids import Block, Tube
from struck.solids.fem.assembly import System, assemble
from struck.solids.fem.factorisation import Factoriser
from struck.solids.fem.vibration import vibration_modes
from struck.solids.resolution import Forecast
from tests.physics.bodies import ALUMINIUM

MODES = 12  # of each body that are compared
WALLS = (1.0, 0.5, 0.1, 0.02, 0.005)


def swept() -> dict[str, Tube | Block]:
    """Return thirty tubes, rods, discs and blocks, from as thick as wide to 1:200."""
    bodies: dict[str, Tube | Block] = {}
    for length, walls in ((0.3, WALLS), (2.0, WALLS), (8.0, (0.1, 0.005))):
        for wall in walls:
            tube = Tube(length=length * 0.05, radius=0.05, wall=wall * 0.05)
            bodies[f"tube {length:g}, wall {wall:g}"] = tube
    for thickness in (2.0, *WALLS):
        disc = Tube(length=2 * thickness * 0.05, radius=0.05, wall=0.05)
        bodies[f"disc {thickness:g}"] = disc
    for width in (1.0, 0.5, 0.1):
        for thickness in (1.0, 0.2, 0.05, 0.005):
            bodies[f"block {width:g} x {thickness:g}"] = Block(
                size=(0.1, 0.1 * width, min(0.1 * thickness, 0.1 * width))
            )
    return bodies


def highest_of(body: Tube | Block) -> float:
    """Return a frequency up to which there are a dozen modes or a few more, Hz."""
    mesh = body.volume_mesh("preview")
    highest = Forecast.of(mesh.surface()[0], ALUMINIUM).lowest
    while True:
        highest *= 1.6
        with contextlib.suppress(OptionError):  # no mode lies below that yet
            found = vibration_modes(mesh, ALUMINIUM, highest).frequencies
            if len(found) >= MODES:
                return float(found[MODES - 1] * 1.001)


def below(system: System, highest: Sequence[float]) -> list[int]:
    """Return how many elastic modes lie below each frequency, by the inertia of K - w^2 M."""
    factorise = Factoriser()
    return [factorise(system.shifted((2 * np.pi * each) ** 2)).negative - 6 for each in highest]


BODIES = swept()
SAMPLE = "tube 0.3, wall 0.5"


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=() if name == SAMPLE else pytest.mark.prove) for name in BODIES],
)
def test_preview_has_the_modes_that_finer_elements_have(name: str) -> None:
    body = BODIES[name]
    highest = highest_of(body)
    finer = assemble(body.volume_mesh("standard" if name == SAMPLE else "fine"), ALUMINIUM)
    model = struck.analyze(body, ALUMINIUM, band=(1, highest), accuracy="preview", cache=False)
    # The last may lie beyond the band by their errors.
    error = model.errors[-1]
    fewest, most = below(finer, [highest * (1 - 2 * error), highest * (1 + error)])
    assert fewest <= len(model.frequencies) <= most
