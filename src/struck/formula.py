"""From a closed-form body and a material to a model, without elements."""

from __future__ import annotations

from dataclasses import replace
from importlib.metadata import version

from struck.errors import OptionError
from struck.model.material import Material
from struck.model.model import ModalModel
from struck.places import places_of
from struck.radiation import by_name
from struck.shapes.shape import Shape


def by_formula(
    shape: Shape, material: Material, radiation: str, band: tuple[float, float], **given: object
) -> ModalModel:
    """Return the model of a shape; see `struck.analyze`.

    Raises
    ------
    OptionError
        When no mode lies within the band, or something is `given` that the shape tells itself.
    """
    for name, value in given.items():
        if value is not None:
            raise OptionError(
                f"{name}= does not apply to {type(shape).__name__}, which tells it itself: leave "
                "it out, or take method='fem'"
            )
    modes = shape.modes(material, band)
    versions = {name: version(name) for name in ("struck", "numpy", "scipy")}
    provenance = modes.provenance.extended(body=repr(shape), versions=versions)
    return ModalModel.of(
        replace(modes, provenance=provenance),
        material,
        radiation=by_name(radiation),
        lowest=band[0],
        places={**places_of(modes.surface), **shape.places},
    )
