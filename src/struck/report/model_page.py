"""Models and sounds shown to people: a few lines of text, or one HTML page that plays."""

from __future__ import annotations

import html
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from struck.errors import counted, rounded
from struck.files.sound import Sound
from struck.model.air_losses import AirLosses
from struck.model.damping import contains_air
from struck.model.gains import ExpandedGains, ShapeGains, SkinRadiation
from struck.model.html import document, modes_table, picture
from struck.model.model import ModalModel
from struck.model.radiation_efficiency import RadiationEfficiency, known_losses

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from struck.model.timbre_field import TimbreField
    from struck.model.timbre_table import TimbreTable

_ROWS = 12
_FLUID = ("fluid", "level", "filled", "setting", "kettle")  # details of a loaded model
_HIGH_EFFICIENCY = 0.5  # radiation efficiency: half of that of a large surface in phase


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Exhibit:
    """A body with its pictures and sounds for a page."""

    title: str
    text: str
    model: ModalModel
    sounds: Sequence[tuple[str, Sound]]  # with their captions
    picture: Figure
    spectrograms: Sequence[Figure] = ()  # one for each sound, or none


def summary(
    model: ModalModel, *, whole: bool = True, power: RadiationEfficiency | None = None
) -> list[str]:
    """Return the contents of a model, a line each; the `whole` with how it was made.

    The radiation of its modes, `power`, is computed if it is not given.
    """
    power = power or known_power(model)
    material = model.material
    is_object_mode = model.of_object
    limit = f"none missing up to {model.complete_to:.0f} Hz"
    completeness = limit if model.complete_to else "others may be missing"
    lines = [f"{counted(np.count_nonzero(is_object_mode), 'mode')}, {completeness}"]
    indices = np.asarray(model.provenance.details.get("blow", ()), int)
    is_blow = np.isin(np.arange(len(is_object_mode)), indices)
    is_vague = ~(is_object_mode | is_blow)
    if is_blow.any():
        lines.append(f"blow      {counted(np.count_nonzero(is_blow), 'further mode')} in its place")
    if is_vague.any():
        others = counted(np.count_nonzero(is_vague), "further mode")
        lines.append(f"vague     {others}, known to 30 % at best")
    if model.recoil is not None:
        times = 1e3 / (2 * np.pi * model.recoil.corners * model.recoil.dampings)
        lines.append(
            f"recoil    of the body as a whole, over within some {rounded(7 * times.max(), 2)} ms"
        )
    if (residual := model.residual) is not None:
        seconds, size = len(residual.attack) / residual.sample_rate, residual.size / 1000
        lines.append(
            f"residual  attack of {rounded(seconds, 2)} s, and noise after it: {size:.0f} kB"
        )
    if model.errors is not None and np.isfinite(model.errors[is_object_mode]).any():
        errors = model.errors[is_object_mode]
        half, most = rounded(100 * np.nanmedian(errors), 2), rounded(100 * np.nanmax(errors), 2)
        lines.append(f"errors    frequencies: half within {half} %, all within {most} %")
    if material is not None:
        kind, _, values = repr(material.damping).rstrip(")").partition("(")
        values = re.sub(r", contains_air=(True|False)", "", values)
        kind = re.sub("(?<=[a-z])(?=[A-Z])", " ", kind).lower()
        lines.append(
            f"material  {material.name}: {rounded(material.density)} kg/m3, E = "
            f"{rounded(material.youngs_modulus / 1e9)} GPa, Poisson "
            f"{rounded(material.poisson_ratio)}, {kind} of "
            f"{values.replace('_', ' ').replace('=', ' ')}"
        )
    lines += _describe_fluid(model)
    lines += [] if model.mass is None else [f"mass      {rounded(model.mass, 4)} kg"]
    if model.geometry is not None:
        size = " x ".join(rounded(edge, 4) for edge in np.ptp(model.geometry.bounds, axis=0))
        up = model.provenance.details.get("up", model.geometry.up)
        hint = "; another by up= when it is analyzed" if "," in str(up) else ""
        lines += [f"size      {size} m", f"up        {up}: it says where top is{hint}"]
    unit = "Pa per N s" if model.gains.directional else "Pa per N s at 1 m"
    efficiency = "" if power is None else f"; {_efficiency(power)}"
    lines.append(f"gains     {unit if model.calibrated else 'relative'}{efficiency}")
    if not isinstance(model.gains, ShapeGains):
        lines += [*_recorded(model), "force     acts as the recorded blow, whatever its direction"]
    lines.append(f"places    {', '.join(sorted(model.places)) or 'none named'}")
    if (model.places or not model.recorded) and (contact := model.contact()).point.size:
        lines.append(f"struck    at {contact.place}, unless a place is given")
    lines += _method(model) if whole else []
    lines += [f"note      {loss}" for loss in model.provenance.dropped]
    if power is not None and isinstance(model.gains, ShapeGains):
        lines += _describe_air_losses(model, known_losses(model.gains))
    caution = model.provenance.details.get("caution")
    return [*lines, f"caution   {caution}"] if caution else lines


def known_power(model: ModalModel) -> RadiationEfficiency | None:
    """Return the radiation of the modes; None where it is not known in W."""
    gains = model.gains
    has_skin = isinstance(gains, ShapeGains) and isinstance(gains.radiation, SkinRadiation)
    is_known = has_skin and model.calibrated and len(model.decays) > 0
    return model.radiated_power() if is_known else None


def _efficiency(power: RadiationEfficiency) -> str:
    """Return the range of the radiation efficiency, and where it passes 0.5, in words."""
    values = power.efficiencies
    text = f"{rounded(values.min(), 2)} to {rounded(values.max(), 2)}"
    text += f", half below {rounded(np.median(values), 2)}"
    columns = power.bands.columns
    is_strong = columns["radiation efficiency"] >= _HIGH_EFFICIENCY
    if is_strong.any():
        band = columns["third octave (Hz)"][np.argmax(is_strong)]
        text += f", {_HIGH_EFFICIENCY:g} from about {rounded(band, 3)} Hz"
    return f"radiation efficiency {text}"


def _describe_fluid(model: ModalModel) -> list[str]:
    """Return a line on the fluid that loads a body, with the lengths of the body analyzed."""
    details = model.provenance.details
    texts = [f"{name} {details[name]}" for name in _FLUID[1:] if name in details]
    fluid = details.get("fluid")
    return [] if fluid is None else [f"fluid     {', '.join([str(fluid), *texts])}"]


def _describe_air_losses(model: ModalModel, losses: AirLosses) -> list[str]:
    """Return a line on the modes that lose more to the air than to the material."""
    if model.material is not None and contains_air(model.material.damping):
        return ["air       T60 contains the losses to the air, as the damping law does"]
    is_included = bool(model.air_decays.any())
    air_decays = model.air_decays if is_included else losses.sound
    others = model.decays - air_decays if is_included else model.decays
    mode_indices = np.flatnonzero(air_decays > others)
    count = f"{len(mode_indices)} of {counted(len(others), 'mode')}"
    if not len(mode_indices):
        if not is_included:
            return []
        max_ratio = np.max(air_decays / np.maximum(model.decays, np.finfo(float).tiny))
        percentage = rounded(100 * max_ratio, 2)
        return [f"air       T60 contains the losses to the air, at most {percentage} %"]
    mode = mode_indices[0]
    times = [
        f"{rounded(np.log(1000) / decay, 2)} s" if decay else "endless"
        for decay in (others[mode] + air_decays[mode], others[mode])
    ]
    example = f"{model.frequencies[mode]:.0f} Hz"
    if is_included:
        text = f"{count} lose more to the air than to all else, as {example}"
        return [f"air       {text} (T60 {times[0]}, without air {times[1]})"]
    text = f"T60 leaves out what the sound itself takes: {count} lose more by that, as {example}"
    return [f"air       {text} ({times[0]} in place of {times[1]})"]


def _method(model: ModalModel) -> list[str]:
    """Return how a model was made, and the papers behind that, a line each."""
    details = [
        f"          {name}: {len(value) if isinstance(value, list) else value}"
        for name, value in model.provenance.details.items()
        if name not in {"blow", "vague", "up", "caution", *_FLUID}  # which have their own lines
    ]
    papers = [f"cite      {paper}" for paper in model.cite().splitlines()]
    return [f"method    {model.provenance.method}", *details, *papers]


def _recorded(model: ModalModel) -> list[str]:
    """Return lines on the recordings that a model's gains were made of."""
    from struck.model.timbre_field import TimbreField
    from struck.model.timbre_table import SinglePoint, TimbreTable

    gains = model.gains.products if isinstance(model.gains, ExpandedGains) else model.gains
    if isinstance(gains, SinglePoint):
        return ["recorded  at one place, from one; the microphone counts as 1 m away"]
    if isinstance(gains, TimbreTable):
        return [_table(model, gains)]
    if isinstance(gains, TimbreField):
        return _field(model, gains)
    return []


def _table(model: ModalModel, table: TimbreTable) -> str:
    ranges = [(axis.nodes[0], axis.nodes[-1]) for axis in table.contacts.axes]
    contacts, listeners, _ = table.gains.shape
    places = f"{counted(contacts, 'contact')} with {counted(listeners, 'listener')}"
    return f"recorded  a table of {places}{_over(model, ranges)}"


def _field(model: ModalModel, field: TimbreField) -> list[str]:
    part = field.contact_part
    ranges = list(zip(part.lowest, part.lowest + part.spans, strict=True))
    inner_count = len(field.listener_part.inside.places)
    places = counted(len(part.contacts), "contact")
    places += f" and {counted(inner_count, 'listener')} inside" if inner_count else ""
    lines = [f"recorded  a field of {places}{_over(model, ranges)}"]
    errors = field.rank_errors[model.of_object[: field.count]]
    errors = errors[np.isfinite(errors)]
    if errors.size:
        lines.append(
            f"rank      gains are products of contact and listener to "
            f"{rounded(100 * np.median(errors), 2)} % in half of the modes, to "
            f"{rounded(100 * errors.max(), 2)} % in all"
        )
    return lines + [f"note      {note}" for note in field.notes]


def _over(model: ModalModel, ranges: Sequence[tuple[float, float]]) -> str:
    """Return the ranges of the coordinates of contacts, in words."""
    names = model.coordinates
    lines = [
        f"{name} from {rounded(low, 4)} to {rounded(high, 4)}"
        for name, (low, high) in zip(names, ranges, strict=False)
    ]
    lines += [f"{name} all around" for name in names[len(ranges) :]]
    return f", {', '.join(lines)}" if lines else ""


def page(
    title: str,
    introduction: str,
    exhibits: Sequence[Exhibit],
    links: Mapping[str, str] = MappingProxyType({}),
) -> str:
    """Return an HTML page that shows and plays exhibits, with links to other pages by title."""
    return page_of(title, introduction, [section(exhibit) for exhibit in exhibits], links)


def page_of(
    title: str, introduction: str, sections: Sequence[str], links: Mapping[str, str]
) -> str:
    """Return an HTML page of sections (HTML), with links to other pages by title."""
    more = " &middot; ".join(
        f'<a href="{html.escape(name)}">{html.escape(text)}</a>' for name, text in links.items()
    )
    shown = "\n".join(sections)
    return document(title, f"<p>{html.escape(introduction)}</p>\n<nav>{more}</nav>\n{shown}")


def section(exhibit: Exhibit) -> str:
    """Return the part of a page that shows and plays an exhibit."""
    model = exhibit.model
    object_modes = np.flatnonzero(model.of_object)
    modes = object_modes[:_ROWS]
    table = modes_table(model, modes)
    facts = "<br>".join(html.escape(line) for line in summary(model)[:3])
    sounds = "".join(
        f"<figure><figcaption>{html.escape(caption)}</figcaption>{sound._repr_html_()}"
        f"{picture(caption, figure) if figure else ''}</figure>"
        for (caption, sound), figure in zip_longest(exhibit.sounds, exhibit.spectrograms)
    )
    return (
        f"<section><h2>{html.escape(exhibit.title)}</h2><p>{html.escape(exhibit.text)}</p>"
        f'<div class="sounds">{sounds}</div>{picture(exhibit.title, exhibit.picture)}'
        f"<details><summary>{len(modes)} of {len(object_modes)} modes</summary>"
        f"<p>{facts}</p>{table}</details></section>"
    )
