"""One HTML page that shows and plays what was recorded, the model of it, and the rest."""

from __future__ import annotations

import html
import os
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from struck.files.atomic import write_bytes
from struck.fitting import report_pictures, report_places, report_tables
from struck.fitting.outcome import Fitting
from struck.fitting.report_tables import counted
from struck.model.html import document, picture, table
from struck.model.model import ModalModel
from struck.model.survey import Survey
from struck.recordings.gain_table import Recorded
from struck.recordings.poles.fitted import Fitted
from struck.recordings.residual_sound import loudest
from struck.report import players
from struck.report.fit_pictures import (
    Energies,
    Played,
    chosen_hits,
    hits_of,
    played,
    setting_in,
    with_residual,
)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_FIRST, _OTHERS = 3e6, 3e6
"""What the sounds of the loudest hit, and of all others, may take in the page, bytes."""
_NOTES = 6


def save_report(fitting: Fitting, path: str | os.PathLike[str]) -> None:
    """Write the page, whole or not at all.

    Raises
    ------
    FileFormatError
        When the file cannot be written.
    """
    write_bytes(path, report(fitting).encode())


def report(fitting: Fitting) -> str:
    """Return a page that needs no other file.

    It says how well modes explain the recordings, plays hits as recorded and as fitted, and shows
    their spectra, every mode with its errors, gains over contact and listener, and every take.
    """
    fitted, recorded = fitting.fitted, fitting.recorded
    energies = Energies.of(fitted)
    chosen = chosen_hits(fitted, energies)
    times = setting_in(fitted, recorded, fitting.lead)
    hits = [played(fitted, recorded, rows, times) for rows in chosen]
    first = _with_rest(fitting, hits[0])
    names = report_tables.short_names(recorded)
    sections = (
        _section("", _summary(fitting)),
        _section("Listen", _players(fitting, [first, *hits[1:]], names)),
        _section("Spectrograms of the loudest hit", _spectrograms(first, fitted)),
        _section("Modes", _modes(fitting, first)),
        _section("Contacts and listeners", "".join(_places(fitting))),
        _section("Takes", _takes(fitted, recorded, energies)),
        _section("References", _references(fitting.model)),
    )
    others = f" and {len(names) - 1} more" if len(names) > 1 else ""
    script = f"<script>\n{players.SCRIPT}{_SORTING}</script>"
    body = "\n".join((*filter(None, sections), script))
    return document(f"Fit of {names[0]}{others}", body, style=players.STYLE + _STYLE)


def _section(title: str, body: str) -> str:
    heading = f"<h2>{title}</h2>" if title else ""
    return f"<section>{heading}{body}</section>" if body else ""


def _with_rest(fitting: Fitting, hit: Played) -> Played:
    """Return the loudest hit, with attack and noise where the model has them or they help."""
    fitted, recorded, residual = fitting.fitted, fitting.recorded, fitting.residual
    if fitting.model.residual is None and not residual.levels.any():
        return hit
    row = fitted.rows[loudest(fitted)]
    return with_residual(hit, residual, recorded.distance(row.take, row.channel))


def _summary(fitting: Fitting) -> str:
    fitted, model = fitting.fitted, fitting.model
    count = len(model.frequencies)
    verdict, *meaning = report_tables.verdict_lines(fitted.verdict, count)
    lines = [*meaning, report_tables.modes_line(model.frequencies, model.decays), _made_of(fitting)]
    kind = "modal" if fitted.verdict.modal else "caution"
    told = "".join(f"<li>{html.escape(line)}</li>" for line in lines)
    notes = list(dict.fromkeys((*fitted.notes, *model.provenance.dropped)))
    return f'<p class="{kind}">{html.escape(verdict)}</p><ul>{told}</ul>{_noted(notes)}'


def _made_of(fitting: Fitting) -> str:
    fitted, takes, survey = fitting.fitted, fitting.recorded.takes, fitting.survey
    channels = sorted({take.channels for take in takes})
    each = counted(channels[-1], "channel")
    each = each if len(channels) == 1 else f"{channels[0]} to {each}"
    hits = counted(len(hits_of(fitted)), "hit")
    line = f"{counted(len(takes), 'take')} of {each} at {takes[0].sample_rate} Hz, {hits}"
    if survey is not None:
        places = (
            counted(len(survey.contacts), "contact"),
            counted(len(survey.listeners), "listener"),
        )
        line += f", {' and '.join(places)}"
    return f"{line}; {fitting.model.provenance.method}."


def _noted(notes: Sequence[str]) -> str:
    def listed(some: Sequence[str]) -> str:
        return f"<ul>{''.join(f'<li>{html.escape(note)}</li>' for note in some)}</ul>"

    if not notes:
        return ""
    shown, more = notes[:_NOTES], notes[_NOTES:]
    rest = f"<details><summary>{counted(len(more), 'more note')}</summary>{listed(more)}</details>"
    return f'<div class="notes"><b>Notes</b>{listed(shown)}{rest if more else ""}</div>'


def _players(fitting: Fitting, hits: Sequence[Played], names: Sequence[str]) -> str:
    first, *others = hits
    one = players.player(f"{_named(first, names)}, the loudest hit", first, _FIRST)
    share = _OTHERS / max(len(others), 1)
    more = [players.player(_named(hit, names), hit.in_one_channel(), share) for hit in others]
    hidden = len(hits_of(fitting.fitted)) - len(hits)
    return f"<p>{_how(fitting, first)}</p>{one}{_folded(more, hidden)}"


def _how(fitting: Fitting, first: Played) -> str:
    beside = "" if first.beside is None else _BESIDE
    lost = _LOST if beside and fitting.model.residual is None else ""
    return " ".join(filter(None, (_HOW, beside, lost, _SWITCH)))


def _folded(players: Sequence[str], hidden: int) -> str:
    if not players:
        return ""
    told = counted(len(players), "other hit")
    told += f"; {counted(hidden, 'more hit')} not played here" if hidden else ""
    return f"<details><summary>{told}</summary>{''.join(players)}</details>"


def _named(hit: Played, names: Sequence[str]) -> str:
    return f"{names[hit.take]}, hit at {hit.onset:.2f} s"


def _spectrograms(first: Played, fitted: Fitted) -> str:
    lowest = report_pictures.lowest_shown(fitted.frequencies)
    text = "Spectrograms of original, model and residual"
    return _wide(picture(text, report_pictures.spectrograms(first, lowest)))


def _modes(fitting: Fitting, first: Played) -> str:
    fitted = fitting.fitted
    lowest = report_pictures.lowest_shown(fitted.frequencies)
    drawn = report_pictures.spectra(first, fitted.frequencies, lowest)
    seen = _wide(picture("Spectra of original and residual, with the modes", drawn))
    known = _known(fitting.model)
    errors = np.where(known, fitted.decay_errors, np.nan)
    rings = report_pictures.ringing_times(
        fitted.frequencies, fitted.decays, errors, first.sample_rate / 2
    )
    seen += _wide(picture("How long each mode rings, over its frequency", rings))
    headings, rows = report_tables.MODES, report_tables.mode_table(fitted, known)
    if fitting.survey is not None:
        headings += report_tables.PLACES
        more = report_tables.place_columns(*_ranks(fitting.model))
        rows = [[*row, *columns] for row, columns in zip(rows, more, strict=True)]
    if fitting.room is not None:
        headings += report_tables.ROOM
        rows = [
            [*row, "perhaps" if own else ""] for row, own in zip(rows, fitting.room, strict=True)
        ]
    return f"{seen}<p>{_ERRORS}</p>{_scrolling('modes', table(headings, rows))}"


def _known(model: ModalModel) -> Mask:
    """Return of which modes the method tells errors (M,)."""
    if model.errors is None:
        return np.zeros(len(model.frequencies), bool)
    return np.isfinite(model.errors)


def _ranks(model: ModalModel) -> tuple[Array, Mask]:
    """Return each mode's rank error, NaN where none is known, and whether it was not measured."""
    count = len(model.frequencies)
    errors = getattr(model.gains, "rank_errors", np.full(count, np.nan))
    lost = np.isin(np.arange(count), getattr(model.gains, "unmeasured", []))
    return errors, lost


def _places(fitting: Fitting) -> Iterator[str]:
    survey = fitting.survey
    if survey is None or len(survey.contacts) * len(survey.listeners) < 2:
        return
    errors, lost = _ranks(fitting.model)
    if np.isfinite(errors).any():
        drawn = report_places.rank_errors(survey.frequencies, errors, lost)
        yield f"<p>{_RANK}</p>{_wide(picture('Rank error of each mode', drawn))}"
    names = f"contact: {', '.join(fitting.model.coordinates)}", "listener: x, y, z (m)"
    for side, (what, places) in enumerate(zip(names, _sides(survey), strict=True)):
        if len(places) > 1:
            levels = report_places.levels_at(survey, side)
            named = report_places.named(places)
            drawn = report_places.gain_map(levels, survey.frequencies, named, lost, what)
            yield _wide(picture(f"How loud each mode is at each {what}", drawn))


def _sides(survey: Survey) -> tuple[Array, Array]:
    return survey.contacts, survey.listeners


def _takes(fitted: Fitted, recorded: Recorded, energies: Energies) -> str:
    rows = report_tables.take_table(fitted, recorded, energies)
    return _scrolling("takes", table(report_tables.TAKES, rows))


def _references(model: ModalModel) -> str:
    lines = filter(None, model.cite().splitlines())
    return "".join(f"<p>{html.escape(line)}</p>" for line in lines)


def _wide(image: str) -> str:
    return f'<div class="wide">{image}</div>'


def _scrolling(name: str, rows: str) -> str:
    return f'<div class="{name} sortable">{rows}</div>'


_HOW = (
    "The original is as recorded, the model its modes alone, the residual the original less the "
    "model, all on one scale."
)
_BESIDE = "With residual, the model has attack and noise as well."
_LOST = "It was saved without them: fit with residual=True, or --residual, to keep them."
_SWITCH = "A name plays its sound; another one goes on with that from the same moment."
_ERRORS = (
    "&plusmn; are standard errors. Levels are those of each mode where it is loudest, as it sets "
    "in, below the loudest of all. A heading sorts."
)
_RANK = (
    "Rank error: how far the gains of a mode are from a part of the contact times a part of the "
    "listener. Where it is large, the object was moved or held otherwise between takes, or two "
    "modes were taken for one."
)
_STYLE = """\
.modal, .caution { font-size: 1.15rem; font-weight: 600; padding-left: .8rem;
  border-left: 6px solid #2e8b57; }
.caution { border-color: #d1611c; }
.notes { color: #555; overflow-wrap: anywhere; }
.wide { overflow-x: auto; margin-bottom: 1rem; }
.wide img { min-width: 40rem; }
.sortable { max-height: 32rem; overflow: auto; }
.sortable th { cursor: pointer; white-space: nowrap; }
.sortable td { white-space: nowrap; }
.takes td:first-child, .takes th:first-child { text-align: left; }
@media (max-width: 40rem) { body { margin: 1rem auto; padding: 0 .5rem; }
  section { padding: 1rem; } }
"""
_SORTING = """\
for (const table of document.querySelectorAll(".sortable table")) {
  const [headings] = table.tHead.rows;
  const [body] = table.tBodies;
  [...headings.cells].forEach((heading, column) => heading.addEventListener("click", () => {
    const down = heading.dataset.order === "up";
    for (const each of headings.cells) delete each.dataset.order;
    heading.dataset.order = down ? "down" : "up";
    const text = (row) => row.cells[column].textContent;
    const compare = (one, other) => {
      const [a, b] = [text(one), text(other)];
      if (isNaN(a) !== isNaN(b)) return isNaN(a) ? 1 : -1;
      const order = isNaN(a) ? a.localeCompare(b) : a - b;
      return down ? -order : order;
    };
    body.append(...[...body.rows].sort(compare));
  }));
}
"""
"""A heading sorts, and turns the order round; what is no number comes last."""
