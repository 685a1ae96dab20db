"""Models and sounds told to people: a few lines of text, or one HTML page that plays."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from struck.model import ModalModel
from struck.sound import Sound
from struck.tables import modes_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_ROWS = 12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Exhibit:
    """A body with what a person would see and hear of it.

    Parameters
    ----------
    title, text : str
    model : ModalModel
    sounds : sequence of (caption, Sound)
    picture : Figure
    spectrograms : sequence of Figure
        One for each sound, or none.
    """

    title: str
    text: str
    model: ModalModel
    sounds: Sequence[tuple[str, Sound]]
    picture: Figure
    spectrograms: Sequence[Figure] = ()


def summary(model: ModalModel) -> list[str]:
    """Return what a model holds, a line each."""
    material = model.material
    gains = "Pa per N s at 1 m" if model.calibrated else "relative"
    lines = [f"{len(model.frequencies)} modes, none missing up to {model.complete_to:.0f} Hz"]
    if model.errors is not None and np.isfinite(model.errors).any():
        middle, worst = np.nanmedian(model.errors), np.nanmax(model.errors)
        lines.append(
            f"errors    half of the frequencies within {100 * middle:.2g} %, "
            f"all within {100 * worst:.2g} %"
        )
    if material is not None:
        lines.append(
            f"material  {material.name}: {material.density:g} kg/m3, "
            f"E = {material.youngs_modulus / 1e9:g} GPa, Poisson {material.poisson_ratio:g}, "
            f"{material.damping}"
        )
    if model.mass is not None:
        lines.append(f"mass      {model.mass:.4g} kg")
    if model.geometry is not None:
        size = " x ".join(f"{edge:.4g}" for edge in _size(model))
        lines.append(f"size      {size} m, {model.geometry.up} up")
    lines += [f"gains     {gains}", f"places    {', '.join(sorted(model.places)) or 'none named'}"]
    lines.append(f"method    {model.provenance.method}")
    lines += [f"          {name}: {value}" for name, value in model.provenance.details.items()]
    return lines + [f"dropped   {loss}" for loss in model.provenance.dropped]


def _size(model: ModalModel) -> list[float]:
    if model.geometry is None:
        return []
    low, high = model.geometry.bounds
    return (high - low).tolist()


def page(
    title: str,
    introduction: str,
    exhibits: Sequence[Exhibit],
    links: Mapping[str, str] = MappingProxyType({}),
) -> str:
    """Return one HTML page that shows and plays the exhibits, with titles of other pages."""
    more = " &middot; ".join(
        f'<a href="{html.escape(name)}">{html.escape(text)}</a>' for name, text in links.items()
    )
    sections = "\n".join(_section(exhibit) for exhibit in exhibits)
    return _PAGE.format(
        title=html.escape(title), text=html.escape(introduction), links=more, body=sections
    )


def _section(exhibit: Exhibit) -> str:
    model = exhibit.model
    count = min(_ROWS, len(model.frequencies))
    errors = None if model.errors is None else model.errors[:count]
    table = modes_table(model.frequencies[:count], model.t60[:count], model.decays[:count], errors)
    facts = "<br>".join(html.escape(line) for line in summary(model)[:3])
    sounds = "".join(
        f"<figure><figcaption>{html.escape(caption)}</figcaption>{sound._repr_html_()}"
        f"{_image(caption, picture) if picture else ''}</figure>"
        for (caption, sound), picture in zip_longest(exhibit.sounds, exhibit.spectrograms)
    )
    return (
        f"<section><h2>{html.escape(exhibit.title)}</h2><p>{html.escape(exhibit.text)}</p>"
        f'<div class="sounds">{sounds}</div>{_image(exhibit.title, exhibit.picture)}'
        f"<details><summary>{count} of {len(model.frequencies)} modes</summary>"
        f"<p>{facts}</p>{table}</details></section>"
    )


def _image(text: str, figure: Figure) -> str:
    data = io.BytesIO()
    figure.savefig(data, format="png", dpi=110)
    encoded = base64.b64encode(data.getvalue()).decode("ascii")
    return f'<img alt="{html.escape(text)}" src="data:image/png;base64,{encoded}">'


_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title>
<meta name="viewport" content="width=device-width, initial-scale=1"><style>
body {{ font: 16px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 62rem;
  padding: 0 1rem; color: #222; background: #fbfaf8; }}
section {{ margin: 2.5rem 0; padding: 1.5rem; background: #fff; border-radius: 8px;
  box-shadow: 0 1px 4px #0002; }}
h1, h2 {{ font-weight: 600; margin-top: 0; }}
img {{ max-width: 100%; }}
.sounds {{ display: flex; flex-wrap: wrap; gap: 1rem; }}
figure {{ margin: 0; max-width: 30rem; }} figcaption {{ font-size: .9rem; color: #555; }}
table {{ border-collapse: collapse; font-variant-numeric: tabular-nums; }}
td, th {{ padding: .15rem .8rem; text-align: right; }} th {{ border-bottom: 1px solid #bbb; }}
</style></head><body><h1>{title}</h1><p>{text}</p>
<nav>{links}</nav>
{body}
</body></html>
"""
