"""Bodies whose modes are known in closed form, or nearly so (1998, sections 2 and 6)."""

from struck.shapes.bar import Bar, GivenSection, RectangularSection, RoundSection
from struck.shapes.beam import BendingForms
from struck.shapes.circular_membrane import AnnularMembrane, CircularMembrane, RoundForms
from struck.shapes.circular_plate import CircularPlate
from struck.shapes.particular_solutions import PolygonForms
from struck.shapes.polygon_membrane import PolygonMembrane
from struck.shapes.rectangular_membrane import RectangularMembrane, SineForms
from struck.shapes.rectangular_plate import RectangularPlate, RitzForms
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

# What a model file may hold: see struck.files.gains_file.
FORMS: tuple[type, ...] = (
    BendingForms,
    PolygonForms,
    RitzForms,
    RoundForms,
    SineForms,
    StringForms,
)
