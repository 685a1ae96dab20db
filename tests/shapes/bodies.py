"""One body of each kind, with a band that holds a few dozen modes."""

from __future__ import annotations

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
    RoundSection,
    String,
)
from struck.shapes.shape import Shape

FILM = Material(
    name="film",
    density=1390.0,
    youngs_modulus=4.5e9,
    poisson_ratio=0.38,
    damping=InternalFriction(loss_tangent=0.006),
)
WOOD = Material(name="other", density=700.0, youngs_modulus=1.1e10, poisson_ratio=0.30)
STEEL = Material(name="mild", density=7850.0, youngs_modulus=2.0e11, poisson_ratio=0.29)

BODIES: dict[str, tuple[Shape, Material, float]] = {
    "string": (String(length=0.65, radius=2e-4, tension=60.0), STEEL, 4000.0),
    "stiff string": (String(length=0.65, radius=4e-4, tension=80.0, stiff=True), STEEL, 4000.0),
    "bar": (Bar(length=0.3, width=0.02, thickness=0.004), STEEL, 15000.0),
    "pipe": (
        Bar(length=0.5, section=RoundSection(radius=0.0125, wall=0.001), ends=("clamped", "free")),
        STEEL,
        15000.0,
    ),
    "rectangle": (
        RectangularMembrane(length=0.5, width=0.4, thickness=2.5e-4, tension=3000.0),
        FILM,
        700.0,
    ),
    "drum": (CircularMembrane(radius=0.165, thickness=2.5e-4, tension=3000.0), FILM, 900.0),
    "ring": (
        AnnularMembrane(radius=0.165, hole=0.05, thickness=2.5e-4, tension=3000.0),
        FILM,
        1200.0,
    ),
    "disk": (CircularPlate(radius=0.12, thickness=0.002, edge="clamped"), STEEL, 5000.0),
    "plate": (RectangularPlate(length=0.3, width=0.2, thickness=0.002), STEEL, 3000.0),
    "L": (PolygonMembrane.l_shape(side=0.2, thickness=2.5e-4, tension=3000.0), FILM, 600.0),
}
