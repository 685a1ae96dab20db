"""How model files keep what recordings have beside their modes."""

from __future__ import annotations

from struck.files.layout import Kept, Layout, Tensor, Tensors, Text, require_layout
from struck.files.values import number
from struck.model.residual import Residual

_LAYOUT: Layout = {
    "residual_attack": Tensor("float32", ("A",)),
    "residual_edges": Tensor("float64", ("E",)),
    "residual_levels": Tensor("float64", ("B",)),
    "residual_decays": Tensor("float64", ("B",)),
}


def keep_residual(residual: Residual | None) -> Kept:
    """Return what a file keeps of it; null for none."""
    if residual is None:
        return Kept(text={"residual": None}, tensors={})
    tensors = {
        "residual_attack": residual.attack,
        "residual_edges": residual.edges,
        "residual_levels": residual.levels,
        "residual_decays": residual.decays,
    }
    text = {"sample_rate": int(residual.sample_rate), "lead": float(residual.lead)}
    return Kept(text={"residual": text}, tensors=tensors)


def make_residual(text: Text, tensors: Tensors) -> Residual | None:
    """Return what a file keeps of it; None where it tells of none.

    Raises
    ------
    FileFormatError, OptionError
        When tensors are missing or do not fit each other, or numbers are out of bounds.
    """
    told = text.get("residual")
    if told is None:
        return None
    require_layout(tensors, _LAYOUT)
    return Residual(
        attack=tensors["residual_attack"],
        sample_rate=int(number(told["sample_rate"], "residual's sample rate", 1, 1e9)),
        lead=number(told["lead"], "residual's lead", 0),
        edges=tensors["residual_edges"],
        levels=tensors["residual_levels"],
        decays=tensors["residual_decays"],
    )
