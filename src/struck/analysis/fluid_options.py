"""Options of `struck.analyze` on the fluid around or inside a body: water, and the mass of air."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from struck.errors import OptionError, rounded
from struck.model.arrays import require_number
from struck.model.mesh import MAX_COORDINATE
from struck.model.model import ModalModel
from struck.radiation import add_air_mass, fill, immerse
from struck.radiation.fluid_loading import AIR_LEFT_OUT, estimate_air_lowering

# Lowering of the lowest mode by the air, from which on a model has a note that it leaves it out:
# twice the error that most frequencies have at the default accuracy.
_MIN_LOWERING = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class FluidOptions:
    """Fluid that an analysis loads the modes with."""

    inner_level: float | None = None  # level of water inside a vessel, m
    outer_level: float | None = None  # level of water outside, m; infinite without a surface
    air_mass: bool = False  # of a membrane or thin plate in free air

    def __post_init__(self) -> None:
        hint = "it must be a finite height in coordinates of the body"
        if self.inner_level is not None:
            require_number(
                "filled", self.inner_level, -MAX_COORDINATE, MAX_COORDINATE, hint=hint, unit=" m"
            )
        if self.outer_level is not None and self.outer_level != math.inf:
            hint += ", or math.inf for water without a surface"
            require_number(
                "immersed", self.outer_level, -MAX_COORDINATE, MAX_COORDINATE, hint=hint, unit=" m"
            )
        if self.inner_level is not None and self.outer_level == math.inf:
            raise OptionError(
                f"filled is {rounded(self.inner_level, 4)} m and immersed is inf: water without a "
                "surface fills the vessel too; give its level, which must be below the rim, or "
                "leave filled= out"
            )
        if self.air_mass and (self.inner_level is not None or self.outer_level is not None):
            if self.inner_level is not None:
                water = f"filled is {rounded(self.inner_level, 4)} m"
            elif self.outer_level is not None and math.isfinite(self.outer_level):
                water = f"immersed is {rounded(self.outer_level, 4)} m"
            else:
                water = "immersed is inf"
            raise OptionError(
                f"air_mass is True and {water}: a body in water is loaded by the water alone; "
                "leave one of them out"
            )

    def load(self, model: ModalModel) -> ModalModel:
        """Return the model with the fluid, or with a note if it lacks air that matters."""
        if self.outer_level is not None:
            level = None if self.outer_level == math.inf else self.outer_level
            return immerse(model, level=level, filled=self.inner_level)
        if self.inner_level is not None:
            return fill(model, self.inner_level)
        if self.air_mass:
            return add_air_mass(model)
        lowering = estimate_air_lowering(model) if model.calibrated else 0.0
        if not lowering > _MIN_LOWERING:
            return model
        note = (
            f"{AIR_LEFT_OUT}, which lowers the lowest mode of the body analyzed by about "
            f"{rounded(100 * lowering, 2)} %: air_mass=True (--air-mass) includes it"
        )
        return replace(model, provenance=model.provenance.extended(dropped=(note,)))
