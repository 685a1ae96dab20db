"""One HTML page that shows and plays recordings, the model of them, and the remainder."""

from __future__ import annotations

import base64
import html
import os
from collections.abc import Iterator, Sequence
from importlib import resources
from pathlib import PurePath
from typing import TYPE_CHECKING

import numpy as np

from struck.errors import counted, rounded
from struck.files import wav
from struck.files.atomic import require_ending, write_bytes
from struck.files.sound import PEAK
from struck.model.arrays import Array, Mask, checked
from struck.model.html import PAGES, document, note, picture, table
from struck.model.model import ModalModel
from struck.recordings.fit import Fitting
from struck.recordings.poles.search import PoleFit
from struck.recordings.poles.verdict import MODAL_MARGIN, ModalVerdict
from struck.recordings.residual_sound import loudest_row, one_strike
from struck.recordings.takes import RecordingSet
from struck.report import fit_pictures
from struck.report.fit_pictures import (
    Energies,
    RenderedHit,
    chosen_hits,
    hits_of,
    played,
    setting_in,
    with_residual,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Headings of the table of modes
MODES = ("mode", "Hz", "note", "\u00b1 Hz", "T60 (s)", "\u00b1 %", "Q", "level (dB)")
KIND = ("kind",)  # One more: whether a mode is of the blow, or vague
PLACES = ("rank error (%)", "measured")  # Further ones, of gains over contacts and listeners
ROOM = ("of the room",)  # One more, where the room's reverberation is given
# Headings of the table of takes
TAKES = ("take", "hits", "channels", "peak (dB FS)", "lead-in (dB FS)", "signal to residual (dB)")
_LITTLE = 20.0
_HARDLY_ANY = 30.0
_OF_NOISE = 3.0
# What the sounds of the loudest hit, and of all others, may take in the page, bytes
_FIRST, _OTHERS = 3e6, 3e6
_NOTES = 6
_BYTES = 2 * 4 / 3  # of one sample of 16 bits, as text
_SHORTER = 0.1  # a sound may lack this much of its end without a word, s


@checked
def save_report(fitting: Fitting, path: str | os.PathLike[str]) -> None:
    """Write the HTML page of a fit, completely or not at all.

    Parameters
    ----------
    fitting : Fitting
        Result of `struck.recordings.fit_recordings`.
    path : path
        The file.

    Raises
    ------
    FileFormatError
        If the file cannot be written, or its name does not end as that of a page.
    """
    require_ending(path, PAGES, "pages")
    write_bytes(path, report(fitting).encode())


@checked
def report(fitting: Fitting) -> str:
    """Make the HTML page of a fit, without other files.

    It shows how well modes explain the recordings, plays hits as recorded and as fitted, and shows
    their spectra, every mode with its errors, gains over contact and listener, and every take.

    Parameters
    ----------
    fitting : Fitting
        Result of `struck.recordings.fit_recordings`.

    Returns
    -------
    str
        HTML.
    """
    fitted, recorded = fitting.fitted, fitting.recorded
    energies = Energies.of(fitted)
    chosen = chosen_hits(fitted, energies)
    times = setting_in(fitted, recorded, fitting.lead)
    hits = [played(fitted, recorded, rows, times) for rows in chosen]
    first = _with_rest(fitting, hits[0])
    names = short_names(recorded)
    references = filter(None, fitting.model.cite().splitlines())
    sections = (
        _section("", _summary(fitting)),
        _section("Listen", _players(fitting, [first, *hits[1:]], names)),
        _section("Spectrograms of the loudest hit", _spectrograms(first, fitted)),
        _section("Modes", _modes(fitting, first)),
        _section("Contacts and listeners", "".join(_places(fitting))),
        _section("Takes", _sortable("takes", TAKES, take_table(fitted, recorded, energies))),
        _section("References", "".join(f"<p>{html.escape(line)}</p>" for line in references)),
    )
    others = f" and {len(names) - 1} more" if len(names) > 1 else ""
    body = "\n".join((*filter(None, sections), f"<script>\n{_asset('fit_page.js')}</script>"))
    return document(f"Fit of {names[0]}{others}", body, style=_asset("fit_page.css"))


def _asset(name: str) -> str:
    """Return the text of a file in the folder of this module."""
    return (resources.files("struck.report") / name).read_text(encoding="utf-8")


def _section(title: str, body: str) -> str:
    heading = f"<h2>{title}</h2>" if title else ""
    return f"<section>{heading}{body}</section>" if body else ""


def _with_rest(fitting: Fitting, hit: RenderedHit) -> RenderedHit:
    """Return the loudest hit, with attack and noise where the model has them or they help."""
    fitted, recorded, residual = fitting.fitted, fitting.recorded, fitting.residual
    if fitting.model.residual is None and not residual.levels.any():
        return hit
    row = fitted.rows[loudest_row(fitted)]
    return with_residual(hit, residual, recorded.distance(row.take, row.channel))


def _summary(fitting: Fitting) -> str:
    fitted, model = fitting.fitted, fitting.model
    is_object_mode = ~(fitted.blow | fitted.vague)
    verdict, *meaning = verdict_lines(fitted.verdict, len(is_object_mode))
    fraction = one_strike(fitted)
    meaning.append(
        f"One strike of the model explains {rounded(100 * fraction, 3)} % of its take's energy."
    )
    is_shown = is_object_mode if is_object_mode.any() else ~is_object_mode
    lines = [*meaning, modes_line(model.frequencies[is_shown], model.decays[is_shown])]
    lines.append(_made_of(fitting))
    counts = int(np.count_nonzero(fitted.vague & ~fitted.blow)), int(np.count_nonzero(fitted.blow))
    for count, kind_text in zip(counts, (_VAGUE, "for the blow"), strict=True):
        if count:
            verb = "stands" if count == 1 else "stand"
            lines.insert(-1, f"{counted(count, 'further mode')} {verb} {kind_text}.")
    kind = "modal" if fitted.verdict.modal else "caution"
    items = "".join(f"<li>{html.escape(line)}</li>" for line in lines)
    notes = list(dict.fromkeys((*fitted.notes, *model.provenance.dropped)))
    return f'<p class="{kind}">{html.escape(verdict)}</p><ul>{items}</ul>{_noted(notes)}'


def _made_of(fitting: Fitting) -> str:
    fitted, takes, survey = fitting.fitted, fitting.recorded.takes, fitting.survey
    channels = sorted({take.channels for take in takes})
    channel_text = counted(channels[-1], "channel")
    channel_text = channel_text if len(channels) == 1 else f"{channels[0]} to {channel_text}"
    hits = counted(len(hits_of(fitted)), "hit")
    line = f"{counted(len(takes), 'take')} of {channel_text} at {takes[0].sample_rate} Hz, {hits}"
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
    first_notes, further_notes = notes[:_NOTES], notes[_NOTES:]
    summary = counted(len(further_notes), "more note")
    rest = f"<details><summary>{summary}</summary>{listed(further_notes)}</details>"
    return (
        f'<div class="notes"><b>Notes</b>{listed(first_notes)}{rest if further_notes else ""}</div>'
    )


def _players(fitting: Fitting, hits: Sequence[RenderedHit], names: Sequence[str]) -> str:
    first, *others = hits
    one = player(f"{_named(first, names)}, the loudest hit", first, _FIRST)
    size = _OTHERS / max(len(others), 1)
    players = [player(_named(hit, names), hit.in_one_channel(), size) for hit in others]
    hidden_count = len(hits_of(fitting.fitted)) - len(hits)
    return f"<p>{_how(fitting, first)}</p>{one}{_folded(players, hidden_count)}"


def _how(fitting: Fitting, first: RenderedHit) -> str:
    beside = "" if first.beside is None else _BESIDE
    lost = _LOST if beside and fitting.model.residual is None else ""
    return " ".join(filter(None, (_EXPLANATION, beside, lost, _SWITCH)))


def player(title: str, hit: RenderedHit, size: float) -> str:
    """Return a player of one hit on one scale, shortened where it takes more than `size` bytes."""
    count = sum(1 for _ in hit.sounds()) * len(hit.original)
    excerpt = hit.shortened(size / (_BYTES * count * hit.sample_rate))
    if hit.duration - excerpt.duration > _SHORTER:
        title = f"{title}; its first {excerpt.duration:.1f} s of {hit.duration:.1f}"
    peak = max(float(np.abs(samples).max()) for _, samples in excerpt.sounds())
    factor = PEAK / peak if peak else 1.0
    sounds = "".join(
        f'<figure><figcaption><button type="button">{caption}</button>'
        f"</figcaption>{_audio(factor * samples, excerpt.sample_rate)}</figure>"
        for caption, samples in excerpt.sounds()
    )
    return f'<div class="hit"><p>{html.escape(title)}</p><div class="sounds">{sounds}</div></div>'


def _audio(samples: Array, sample_rate: int) -> str:
    recording = wav.Recording(samples=samples.astype(np.float32), sample_rate=sample_rate)
    data = base64.b64encode(wav.encode(recording, "int16")).decode("ascii")
    return f'<audio controls src="data:audio/wav;base64,{data}"></audio>'


def _folded(players: Sequence[str], hidden_count: int) -> str:
    if not players:
        return ""
    heading = counted(len(players), "other hit")
    heading += f"; {counted(hidden_count, 'more hit')} not played here" if hidden_count else ""
    return f"<details><summary>{heading}</summary>{''.join(players)}</details>"


def _named(hit: RenderedHit, names: Sequence[str]) -> str:
    return f"{names[hit.take]}, hit at {hit.onset:.2f} s"


def _spectrograms(first: RenderedHit, fitted: PoleFit) -> str:
    lowest = fit_pictures.lowest_shown(fitted.frequencies)
    text = "Spectrograms of original, model and residual"
    return _drawing(text, fit_pictures.spectrograms(first, lowest))


def _modes(fitting: Fitting, first: RenderedHit) -> str:
    fitted = fitting.fitted
    lowest = fit_pictures.lowest_shown(fitted.frequencies)
    is_sure = ~(fitted.blow | fitted.vague)
    figure = fit_pictures.spectra(first, fitted.frequencies, is_sure, lowest)
    pictures = _drawing("Spectra of original and residual, with the modes", figure)
    is_known = _known(fitting.model)
    errors = np.where(is_known, fitted.decay_errors, np.nan)
    rings = fit_pictures.ringing_times(
        fitted.frequencies, fitted.decays, errors, first.sample_rate / 2
    )
    pictures += _drawing("How long each mode rings, over its frequency", rings)
    headings, rows = MODES, mode_table(fitted, is_known)
    if (fitted.blow | fitted.vague).any():
        headings += KIND
        kinds = np.where(fitted.blow, "of the blow", np.where(fitted.vague, "vague", ""))
        rows = [[*row, str(kind)] for row, kind in zip(rows, kinds, strict=True)]
    if fitting.survey is not None:
        headings += PLACES
        columns_of_places = place_columns(*_ranks(fitting.model))
        rows = [[*row, *columns] for row, columns in zip(rows, columns_of_places, strict=True)]
    if fitting.room is not None:
        headings += ROOM
        rows = [
            [*row, "perhaps" if in_room else ""]
            for row, in_room in zip(rows, fitting.room, strict=True)
        ]
    return f"{pictures}<p>{_ERRORS}</p>{_sortable('modes', headings, rows)}"


def _known(model: ModalModel) -> Mask:
    """Return which modes have known errors (M,)."""
    if model.errors is None:
        return np.zeros(len(model.frequencies), bool)
    return np.isfinite(model.errors)


def _ranks(model: ModalModel) -> tuple[Array, Mask]:
    """Return each mode's rank error, NaN where none is known, and whether it was not measured."""
    count = len(model.frequencies)
    errors = getattr(model.gains, "rank_errors", np.full(count, np.nan))
    return errors, np.isin(np.arange(count), getattr(model.gains, "unmeasured", []))


def _places(fitting: Fitting) -> Iterator[str]:
    survey = fitting.survey
    if survey is None or len(survey.contacts) * len(survey.listeners) < 2:
        return
    is_object_mode = fitting.model.of_object
    errors, lost = _ranks(fitting.model)
    errors, lost = errors[is_object_mode], lost[is_object_mode]
    tones = survey.frequencies[is_object_mode]
    if np.isfinite(errors).any():
        figure = fit_pictures.rank_errors(tones, errors, lost)
        yield f"<p>{_RANK}</p>{_drawing('Rank error of each mode', figure)}"
    names = f"contact: {', '.join(fitting.model.coordinates)}", "listener: x, y, z (m)"
    sides = survey.contacts, survey.listeners
    for side, (axis_name, places) in enumerate(zip(names, sides, strict=True)):
        if len(places) > 1:
            levels = fit_pictures.levels_at(survey, side)[:, is_object_mode]
            labels = fit_pictures.named(places)
            figure = fit_pictures.gain_map(levels, tones, labels, lost, axis_name)
            yield _drawing(f"How loud each mode is at each {axis_name}", figure)


def _drawing(text: str, figure: Figure) -> str:
    return f'<div class="wide">{picture(text, figure)}</div>'


def _sortable(name: str, headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return f'<div class="{name} sortable">{table(headings, rows)}</div>'


# Words and tables: results, their errors, and their takes.


def verdict_lines(verdict: ModalVerdict, count: int) -> list[str]:
    """Return a verdict on a fit of a number of modes, in plain words."""
    if not verdict.modal:
        return [f"Not modal: {verdict.reason}.", *([_ratio(verdict)] if count else [])]
    return ["Modal: decaying modes explain what was recorded.", _ratio(verdict)]


def _ratio(verdict: ModalVerdict) -> str:
    ratio = verdict.signal_to_residual
    if not np.isfinite(ratio):
        return "The modes leave nothing."
    percentage = 100 * 10 ** (-ratio / 10)
    return (
        f"Signal to residual {ratio:.1f} dB: what the modes leave holds {figure(percentage)} % of "
        f"the energy; {_meaning(verdict)}."
    )


def _meaning(verdict: ModalVerdict) -> str:
    ratio = verdict.signal_to_residual
    if verdict.signal_to_misfit > ratio + _OF_NOISE:
        return "most of that is the noise of the recording"
    if ratio >= _HARDLY_ANY:
        return "hardly anything is missing"
    if ratio >= _LITTLE:
        return "little is missing: as a rule the attack, and the room"
    if ratio >= MODAL_MARGIN:
        return "part of the sound is missing: attack, room, noise; listen to the residual"
    return "the modes are not what one hears"


def modes_line(frequencies: Array, decays: Array) -> str:
    """Return how many modes there are, how high, and how long they ring, in words."""
    count = len(frequencies)
    if not count:
        return "No modes were found."
    times = np.log(1000) / np.maximum(decays, 1e-300)
    low, high = frequencies.min(), frequencies.max()
    return (
        f"{counted(count, 'mode')} from {low:.1f} to {high:.1f} Hz, which fall by 60 dB in "
        f"{rounded(times.min(), 2)} to {rounded(times.max(), 2)} s."
    )


def mode_table(fitted: PoleFit, known: Mask) -> list[list[str]]:
    """Return a row for each mode, under `MODES`, with errors of the `known` modes (M,)."""
    columns = (
        fitted.frequencies,
        np.where(known, fitted.frequency_errors, np.nan),
        np.maximum(fitted.decays, 1e-300),
        np.where(known, fitted.decay_errors, np.nan),
        _levels(fitted),
    )
    return [
        [str(number), *_mode_row(*values)]
        for number, values in enumerate(zip(*columns, strict=True), start=1)
    ]


def _mode_row(
    frequency: float, frequency_error: float, decay: float, decay_error: float, level: float
) -> list[str]:
    quality = np.pi * frequency / decay
    return [
        f"{frequency:.3f}",
        note(frequency),
        figure(frequency_error),
        figure(np.log(1000) / decay, 3),
        figure(100 * decay_error / decay),
        figure(quality, 3) if quality < 100 else f"{quality:.0f}",
        f"{level:.1f}" if np.isfinite(level) else "-",
    ]


def place_columns(rank_errors: Array, unmeasured: Mask) -> list[list[str]]:
    """Return rank error and measuredness of each mode's gains, under `PLACES`."""
    return [
        [figure(100 * error), "not measured" if lost else "yes"]
        for error, lost in zip(rank_errors, unmeasured, strict=True)
    ]


def take_table(fitted: PoleFit, recorded: RecordingSet, energies: Energies) -> list[list[str]]:
    """Return a row for each take, under `TAKES`."""
    names = short_names(recorded)
    return [
        _take_row(names[number], number, fitted, recorded, energies)
        for number in range(len(recorded.takes))
    ]


def short_names(recorded: RecordingSet) -> list[str]:
    """Return the names of takes without folders, where all names remain different."""
    names = [take.name for take in recorded.takes]
    base_names = [PurePath(name).name or name for name in names]
    return base_names if len(set(base_names)) == len(set(names)) else names


def figure(value: float, digits: int = 2) -> str:
    """Return a number of some digits, without an exponent; a dash where it is unknown."""
    if not np.isfinite(value):
        return "-"
    return np.format_float_positional(value, digits, fractional=False, trim="-")


def _levels(fitted: PoleFit) -> Array:
    """Return levels of modes where they are loudest, dB re the object's loudest (M,)."""
    sizes = np.abs(fitted.gains).max(axis=0, initial=0.0)
    object_sizes = sizes[~fitted.blow] if not fitted.blow.all() else sizes
    with np.errstate(divide="ignore"):
        return np.asarray(20 * np.log10(sizes / object_sizes.max(initial=1e-300)), np.float64)


def _take_row(
    name: str, number: int, fitted: PoleFit, recorded: RecordingSet, energies: Energies
) -> list[str]:
    take = recorded.takes[number]
    hits = [rows for rows in hits_of(fitted) if fitted.rows[rows[0]].take == number]
    rows = [row for hit in hits for row in hit]
    return [
        name,
        str(len(hits)),
        str(take.channels),
        f"{_decibels(float(np.abs(take.samples).max())):.1f}",
        _lead_in(fitted, rows),
        f"{energies.ratio(rows):.1f}" if rows else "-",
    ]


def _lead_in(fitted: PoleFit, rows: Sequence[int]) -> str:
    """Return the level of the sound before the first hit, dB of full scale."""
    recordings = [_before(fitted, row) for row in rows]
    lead_ins = [samples for samples in recordings if samples.size]
    if not lead_ins:
        return "-"
    level = _decibels(float(np.sqrt(np.mean([np.mean(samples**2) for samples in lead_ins]))))
    return f"{level:.1f}" if np.isfinite(level) else "silent"


def _before(fitted: PoleFit, row: int) -> Array:
    place = int(fitted.order[row])
    segment = next(segment for segment in fitted.segments if place < segment.rows.stop)
    return segment.before[place - segment.rows.start]


def _decibels(size: float) -> float:
    return float(20 * np.log10(size)) if size > 0 else -np.inf


_EXPLANATION = (
    "The original is as recorded, the model its modes alone, the residual the original less the "
    "model, all on one scale."
)
_BESIDE = "With residual, the model has attack and noise as well."
_LOST = "It was saved without them: fit with residual=True, or --residual, to keep them."
_SWITCH = "A name plays its sound; another one goes on with that from the same moment."
_ERRORS = (
    "&plusmn; are standard errors. Levels are those of each mode where it is loudest, as it sets "
    "in, re the object's loudest. A heading sorts."
)
_VAGUE = "beside them whose decay is known to no better than 30 %"
_RANK = (
    "Rank error: how far the gains of a mode are from a part of the contact times a part of the "
    "listener. Where it is large, the object was moved or held otherwise between takes, or two "
    "modes were taken for one."
)
