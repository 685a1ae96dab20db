"""Bodies of the gallery in closed form: the six of 1998, section 6, and their kin."""

from __future__ import annotations

from struck.demo.piece import Piece
from struck.excitation.pluck import Pluck
from struck.excitation.strike import Strike
from struck.model.damping import InternalFriction
from struck.model.material import Material
from struck.shapes import (
    AnnularMembrane,
    Bar,
    CircularMembrane,
    CircularPlate,
    PolygonMembrane,
    RectangularMembrane,
    RectangularPlate,
    String,
)

INTRODUCTION = (
    "The sounds of physical shapes (van den Doel & Pai 1998): the modes of this body have a "
    "formula. Listen how the timbre changes with the place that is struck."
)
# Polyester film, as drums have it, with air that takes its share.
_SKIN = Material(
    name="polyester film",
    density=1390.0,
    youngs_modulus=4.5e9,
    poisson_ratio=0.38,
    damping=InternalFriction(loss_tangent=0.006, external=4.0),
)
_WIRE = Material(
    name="music wire",
    density=7850.0,
    youngs_modulus=2.1e11,
    poisson_ratio=0.29,
    damping=InternalFriction(loss_tangent=4e-4, external=0.5),
)


# A drum has tens of thousands of modes up to 20 kHz; its blows wake some hundreds.
_DRUM = (20.0, 2500.0)


def _blow(at: tuple[float, ...] | str, striker: str = "wood") -> Strike:
    return Strike(at=at, striker=striker, speed=1.0)


PIECES = (
    Piece(
        name="string",
        title="A taut string",
        text="A steel string of 650 mm at 110 Hz, stiff as it is. Struck, its n-th mode is weaker "
        "by 1/n, plucked by 1/n^2: a piano, a guitar.",
        body=lambda: String(length=0.65, radius=4e-4, tension=80.7, stiff=True),
        material=_WIRE,
        sounds=(
            ("struck near the end", Strike(at=(0.06,), impulse=0.005, duration=4e-4)),
            ("struck at the middle", Strike(at=(0.325,), impulse=0.005, duration=4e-4)),
            ("plucked near the end", Pluck(at=(0.06,), force=3.0)),
            ("plucked at the middle", Pluck(at=(0.325,), force=3.0)),
        ),
    ),
    Piece(
        name="bar",
        title="A clamped bar",
        text="A steel bar of 300 mm with both ends held, the paper's second body.",
        body=lambda: Bar(length=0.30, width=0.03, thickness=0.005, ends="clamped"),
        material="steel",
        damping="heard",
        sounds=(
            ("near the end", _blow((0.02,))),
            ("at a quarter", _blow((0.075,))),
            ("at the middle", _blow((0.15,))),
        ),
    ),
    Piece(
        name="rectangular_membrane",
        title="A rectangular membrane",
        text="A drum of 500 by 400 mm.",
        body=lambda: RectangularMembrane(length=0.5, width=0.4, thickness=2.5e-4, tension=3000.0),
        material=_SKIN,
        band=_DRUM,
        sounds=(
            ("near the corner", _blow((0.05, 0.04))),
            ("near an edge", _blow((0.05, 0.16))),
            ("near the middle", _blow((0.25, 0.16))),
        ),
    ),
    Piece(
        name="circular_membrane",
        title="A circular membrane",
        text="A drum head of 330 mm, without the air's load.",
        body=lambda: CircularMembrane(radius=0.165, thickness=2.5e-4, tension=3000.0),
        material=_SKIN,
        band=_DRUM,
        sounds=(
            ("near the rim", _blow((0.15, 0.0))),
            ("halfway", _blow((0.08, 0.0))),
            ("at the middle", _blow((0.0, 0.0))),
        ),
    ),
    Piece(
        name="annular_membrane",
        title="An annular membrane",
        text="A drum head held at its rim and around a hub.",
        body=lambda: AnnularMembrane(radius=0.165, hole=0.05, thickness=2.5e-4, tension=3000.0),
        material=_SKIN,
        band=_DRUM,
        sounds=(
            ("near the rim", _blow((0.155, 0.0))),
            ("halfway", _blow((0.107, 0.0))),
        ),
    ),
    Piece(
        name="circular_plate",
        title="A clamped circular plate",
        text="A steel disk of 240 mm, 2 mm thick, held at its rim: far fewer modes than a drum.",
        body=lambda: CircularPlate(radius=0.12, thickness=0.002, edge="clamped"),
        material="steel",
        damping="heard",
        sounds=(
            ("near the rim", _blow((0.105, 0.0))),
            ("halfway", _blow((0.06, 0.0))),
            ("at the middle", _blow((0.0, 0.0))),
        ),
    ),
    Piece(
        name="rectangular_plate",
        title="A free rectangular plate",
        text="A glass plate of 300 by 200 mm, 4 mm thick, that hangs free.",
        body=lambda: RectangularPlate(length=0.3, width=0.2, thickness=0.004, edges="free"),
        material="glass",
        damping="heard",
        sounds=(
            ("at the corner", _blow((0.29, 0.19))),
            ("at the middle of an edge", _blow((0.15, 0.19))),
            ("at the middle", _blow((0.15, 0.1))),
        ),
    ),
    Piece(
        name="l_membrane",
        title="The L-shaped membrane",
        text="Three squares, the classic without a formula: its corner that points inward makes "
        "the modes singular. Found by the method of particular solutions.",
        body=lambda: PolygonMembrane.l_shape(side=0.2, thickness=2.5e-4, tension=3000.0),
        material=_SKIN,
        band=_DRUM,
        sounds=(
            ("near the inward corner", _blow((0.21, 0.19))),
            ("in the end of an arm", _blow((0.36, 0.1))),
            ("in the square between", _blow((0.1, 0.1))),
        ),
    ),
)
