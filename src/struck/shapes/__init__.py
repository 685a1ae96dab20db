"""Bodies whose modes are known in closed form, or nearly so (1998, sections 2 and 6)."""

from struck.shapes.annular_membrane import AnnularMembrane
from struck.shapes.bar import Bar
from struck.shapes.bending import BendingForms
from struck.shapes.circular_membrane import CircularMembrane
from struck.shapes.circular_plate import CircularPlate
from struck.shapes.fourier_bessel import PolygonForms
from struck.shapes.polygon_membrane import PolygonMembrane
from struck.shapes.rectangular_membrane import RectangularMembrane, SineForms
from struck.shapes.rectangular_plate import RectangularPlate
from struck.shapes.ritz_forms import RitzForms
from struck.shapes.round_forms import RoundForms
from struck.shapes.sections import GivenSection, RectangularSection, RoundSection
from struck.shapes.string import String, StringForms

__all__ = [
    "AnnularMembrane",
    "Bar",
    "CircularMembrane",
    "CircularPlate",
    "GivenSection",
    "PolygonMembrane",
    "RectangularMembrane",
    "RectangularPlate",
    "RectangularSection",
    "RoundSection",
    "String",
]

# What a model file may hold: see struck.files.formulas.
FORMS: tuple[type, ...] = (
    BendingForms,
    PolygonForms,
    RitzForms,
    RoundForms,
    SineForms,
    StringForms,
)
