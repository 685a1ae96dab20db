"""`struck render`: strikes, scrapes and other excitations from the words of the shell."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

import struck
from struck.cli import Result
from struck.cli.options import (
    PITCH,
    POSITION,
    add_budget,
    add_fade,
    add_listener,
    add_room,
    length,
    listener,
    numbers,
    place,
    refuse,
    room,
    select_options,
)
from struck.errors import OptionError, counted, rounded
from struck.excitation.excitation import Hold
from struck.excitation.pluck import Pluck
from struck.excitation.scrape import Roll, Scrape
from struck.excitation.strike import Strike
from struck.files.atomic import writable
from struck.files.model_file import require_model
from struck.files.sound import FULL_SCALE
from struck.files.sound_formats import ENDINGS, chosen
from struck.files.sound_set import OF_A_SOUND, TABLE, require_names, save_set
from struck.model.provenance import TerminalProgress
from struck.scene.body import Action, centre_of, with_fewer_modes

EXAMPLES = (
    (
        "bell.struck --strike rim --striker wood --speed 1 --listener 0,2,0 --facing 1,0,0 "
        "--hrtf kemar -o bell.wav"
    ),
    "bell.struck --strikes strikes.csv --sounds flac -o bell_sounds",
)
_PLACE = "PLACE[@SECONDS]"
_PATH_FORM = "FROM..TO[@SECONDS]"
_SPEED = 0.1
_Spot = str | tuple[float, ...]
# Options that describe an excitation, and the kinds of excitation that use each.
_OF: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys(("impulse", "duration"), ("strike",)),
    "direction": ("strike", "pluck"),
    "striker": ("strike", "scrape"),
    "speed": ("strike", "scrape", "roll"),
    "load": ("scrape",),
    "roughness": ("scrape", "roll"),
    **dict.fromkeys(("radius", "mass"), ("roll",)),
    "force": ("pluck",),
    "grip": ("hold",),
    "pitch": ("scrape", "roll"),
}
_COLUMNS = ("strike", "impulse", "duration", "direction", "striker", "speed")  # of tables too
_KINDS = {kind for kinds in _OF.values() for kind in kinds}


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `struck render`."""
    parser.add_argument("model", help="model file")
    add_touches(parser)
    parser.add_argument(
        "--pitch",
        type=PITCH,
        help="metres per unit of the contacts of a recorded body, for scrapes and rolls",
    )
    add_listener(parser)
    add_room(parser)
    parser.add_argument(
        "--position",
        type=POSITION,
        help="centre of the body in the room: x,y,z, m; default: centre of the room",
    )
    add_budget(parser)
    parser.add_argument(
        "--seconds",
        type=float,
        help="length of the sound, s; default: until it has decayed by 60 dB, at most 10 s",
    )
    add_fade(parser)
    parser.add_argument("--rate", type=int, default=48_000, help="sample rate, Hz (default: 48000)")
    parser.add_argument(
        "--level",
        type=level,
        help="pressure at full scale: a number in Pa, absolute (20 Pa), or peak (default: 1 dB "
        "above the peak)",
    )
    parser.add_argument(
        "--encoding",
        help="sample format: float32, int24 or int16; default: the best of the file format",
    )
    parser.add_argument(
        "--strikes",
        metavar="TABLE",
        help="CSV or TOML table of strikes (name, at, striker, speed, ...): one sound for each "
        "row, all at one level",
    )
    parser.add_argument(
        "--sounds",
        default="wav",
        help="format of the sounds of a table: wav (default), flac, ogg, ...",
    )
    parser.add_argument(
        "-o",
        "--output",
        help="sound file (default: MODEL.wav), or folder for the sounds of a table",
    )


def run(options: argparse.Namespace, progress: TerminalProgress) -> Result:
    """Run `struck render`."""
    require_model(options.model)
    if options.strikes:
        return _render_set(options, progress)
    refuse(options, ["sounds"], "is for --strikes, which is not given: give it")
    requested_kinds = {kind for kind in _KINDS if getattr(options, kind)} or {"strike"}
    for name, others in _OF.items():
        if not requested_kinds & {*others}:
            kinds = " or ".join(f"--{kind}" for kind in others)
            refuse(options, [name], f"is for {kinds}, which is not given: give it")
    read = filter(None, (options.model, options.walk, options.hrtf))
    output = writable(options.output or Path(options.model).with_suffix(".wav"), unlike=read)
    chosen(output, options.encoding)
    # Errors in the options are reported before the model is loaded.
    actions, sound_options = touches(options), _sound_options(options)
    model, notes_of_model = _model(options)
    progress("computing the sound", 0.0)
    sound = struck.render(*_place_in_room(model, actions, options), **sound_options)
    factor = sound.save(output, level=options.level or "peak", encoding=options.encoding)
    last = f"wrote {output} ({sound.duration:.2f} s{saved(sound, factor)})"
    notes = [*notes_of_model, *sound.notes]
    return Result(
        [*notes, last],
        output=str(output),
        seconds=sound.duration,
        factor=factor,
        notes=notes,
    )


def saved(sound: struck.Sound, factor: float) -> str:
    """Return a sentence about the change of level by saving a sound."""
    if not sound.peak:
        return ", silent"
    peak = f", peak at {20 * math.log10(sound.peak * factor):.1f} dB of full scale"
    return f"{peak}, which is {rounded(1 / factor, 4)} Pa" if sound.calibrated else peak


def level(text: str) -> str | float:
    """Return a level of saving: a name, or a pressure in Pa."""
    with suppress(ValueError):
        return float(text)
    if text not in {"peak", "absolute"}:
        raise argparse.ArgumentTypeError(f"it is {text!r}: give peak, absolute, or a number in Pa")
    return text


def _render_set(options: argparse.Namespace, progress: TerminalProgress) -> Result:
    """Write a sound for each strike of a table, and their table, with one level for all."""
    from struck.batch.job_table import table_rows
    from struck.batch.strike_set import named_strikes, row_of

    table = f"--strikes {options.strikes}"
    refuse(options, _COLUMNS, f"is for one sound: {table} has columns for it, a strike a row")
    refuse(options, {*_OF} | _KINDS, f"is for one sound, and {table} is a table of strikes alone")
    _require_folder(options, table)
    full_scale = {None: None, "peak": None, "absolute": FULL_SCALE}.get(
        options.level, options.level
    )
    chosen(f"sound.{options.sounds}", options.encoding)
    rows_of_table = table_rows(options.strikes)
    sound_options, strikes = _sound_options(options), named_strikes(rows_of_table, options.strikes)
    require_names([name for name, _, _ in strikes], "row", f" of {options.strikes}")
    if all(row_listener is not None for _, _, row_listener in strikes):
        reason = f"is for rows without a listener, and each row of {table} has one"
        refuse(options, ("listener", "walk"), reason)
    (model, notes_of_model), sounds = _model(options), []
    for number, (name, strike, row_listener) in enumerate(strikes):
        progress("computing the sound", number / len(strikes))
        with row_of(options.strikes, number + 1):
            row_options = (
                sound_options
                if row_listener is None
                else sound_options | {"listener": listener(options, row_listener)}
            )
            placed = _place_in_room(model, strike, options)
            sounds.append((name, struck.render(*placed, **row_options)))
    rows = save_set(
        sounds,
        options.output,
        strikes=[(strike, row_listener) for _, strike, row_listener in strikes],
        level=full_scale,
        encoding=options.encoding,
        ending=f".{options.sounds}",
    )
    levels = [row["level_db"] for row in rows if row["level_db"] is not None]
    span = f", peaks from {min(levels):.1f} to {max(levels):.1f} dB of it" if levels else ""
    scale = f"full scale is {rounded(rows[0]['full_scale'], 4)} {rows[0]['unit']}{span}"
    notes = [*notes_of_model, *_group_notes(sounds)]
    if options.sounds in {"ogg", "mp3"}:
        notes.append(f"{options.sounds} leaves out what is not heard: levels are kept within 1 dB")
    if unused_names := [name for name in OF_A_SOUND if name in rows_of_table[0]]:
        notes.append(f"not used of {table}: {', '.join(unused_names)}; options say them anew")
    last = f"wrote {counted(len(rows), 'sound')} and {TABLE} to {options.output}: {scale}"
    return Result([*notes, last], output=options.output, sounds=rows, notes=notes)


def _group_notes(sounds: list[tuple[str, struck.Sound]]) -> list[str]:
    """Return the notes of sounds, each once, after the name of the first sound that has it."""
    names: dict[str, list[str]] = {}
    for name, sound in sounds:
        for note in sound.notes:
            names.setdefault(note, []).append(name)
    return [
        f"{first}{' and ' + counted(len(more), 'more sound') if more else ''}: {note}"
        for note, (first, *more) in names.items()
    ]


def _require_folder(options: argparse.Namespace, table: str) -> None:
    """Refuse the sounds of a table without a folder, or with an ending of no sound."""
    if f".{options.sounds}".lower() not in ENDINGS:
        known = ", ".join(item[1:] for item in ENDINGS)
        raise OptionError(f"--sounds {options.sounds} is no kind of sounds: give one of {known}")
    if options.output is None:
        raise OptionError(f"{table} makes many sounds: give -o FOLDER")
    path = Path(options.output)
    if path.suffix.lower() in ENDINGS:
        raise OptionError(
            f"{table} makes many sounds, and {path} names one: give a folder, as -o {path.stem}"
        )


def _model(options: argparse.Namespace) -> tuple[struck.ModalModel, tuple[str, ...]]:
    """Return the model within its budget of modes, and notes of the modes left out."""
    model, notes_of_model = with_fewer_modes(struck.load(options.model), options.modes)
    if options.rate / 2 <= (lowest := model.frequencies.min(initial=np.inf)) < np.inf:
        raise OptionError(
            f"--rate {options.rate}: all modes lie at or above half of it, the lowest at "
            f"{rounded(lowest, 4)} Hz: give a higher one, as 44100"
        )
    return model if options.pitch is None else model.charted(pitch=options.pitch), notes_of_model


def _place_in_room(
    model: struck.ModalModel, touched: Action | list[Action], options: argparse.Namespace
) -> tuple[Any, ...]:
    """Return model and touches, or in a room the body placed in it, for `struck.render`."""
    room_options = room(options)
    if room_options is None:
        return model, touched
    middle = np.array(options.position or np.divide(room_options.size, 2), np.float64)
    room_options.require_inside(middle[None], "body")
    origin = tuple((middle - centre_of(model)).tolist())
    return (struck.Body(model=model, excitations=touched, position=origin),)


def _sound_options(options: argparse.Namespace) -> dict[str, Any]:
    """Return length, rate and listener of a sound, as `struck.render` takes them."""
    return {
        "seconds": options.seconds,
        "sample_rate": options.rate,
        "listener": listener(options),
        "room": room(options),
        "fade": options.fade,
    }


def add_touches(parser: argparse.ArgumentParser) -> None:
    """Add the options that `touches` reads."""
    kinds = (
        (
            "--strike",
            _PLACE,
            "strike a place: name, vertex:N or x,y,z in m; default: the playing place",
        ),
        ("--scrape", _PATH_FORM, "drag a tip from place to place"),
        ("--roll", _PATH_FORM, "roll a ball from place to place"),
        ("--pluck", _PLACE, "load a place and let go"),
        ("--hold", _PLACE, "damp a place with a hand"),
    )
    for name, value, text in kinds:
        parser.add_argument(name, action="append", metavar=value, help=f"{text}; may be repeated")
    parser.add_argument("--impulse", type=float, help="impulse of a strike, N s")
    tip = "wood (default of a strike), steel (default of a scrape), ..."
    parser.add_argument(
        "--striker", help=f"striker, or tip of a scrape: fingertip, felt, rubber, plastic, {tip}"
    )
    parser.add_argument(
        "--speed",
        type=float,
        help="speed of the striker, tip or ball, m/s; default: 0.5 for strikes, 0.1 for scrapes "
        "and rolls",
    )
    parser.add_argument("--duration", type=float, help="duration of the force of a strike, s")
    parser.add_argument(
        "--direction",
        type=numbers(3, form="x,y,z"),
        help="direction of a strike or pluck, x,y,z; default: into the surface",
    )
    parser.add_argument(
        "--load", type=float, default=1.0, help="normal force on the tip, N (default: 1)"
    )
    parser.add_argument(
        "--roughness", help="surface finish; default: sandpaper for scrapes, wood for rolls"
    )
    parser.add_argument(
        "--radius", type=length, default=0.01, help="radius of the ball, m (default: 0.01)"
    )
    parser.add_argument(
        "--mass", type=float, default=0.02, help="mass of the ball, kg (default: 0.02)"
    )
    parser.add_argument("--force", type=float, default=1.0, help="force of a pluck, N (default: 1)")
    parser.add_argument(
        "--grip", type=float, default=10.0, help="resistance of the hand, N s/m (default: 10)"
    )


def touches(options: argparse.Namespace) -> list[Action]:
    """Return the excitations of the options; without any, one strike at the playing place.

    Raises
    ------
    OptionError
        When seconds are no number, a way has no end, or a touch is impossible.
    """
    actions: list[Action] = [_strike(text, options) for text in options.strike or ()]
    actions += [_scrape(text, options) for text in options.scrape or ()]
    actions += [_roll(text, options) for text in options.roll or ()]
    actions += [_pluck(text, options) for text in options.pluck or ()]
    if not (actions or options.hold):
        actions.append(_strike("", options))
    return actions + [_hold(text, options) for text in options.hold or ()]


def _strike(text: str, options: argparse.Namespace) -> Strike:
    place_text, time = _split_time("--strike", text)
    blow = select_options(options, "impulse striker speed duration direction")
    return Strike(at=_place(place_text), time=time, **blow)


def _scrape(text: str, options: argparse.Namespace) -> Scrape:
    path_text, time = _split_time("--scrape", text)
    return Scrape(
        path=_parse_path("--scrape", path_text),
        speed=_SPEED if options.speed is None else options.speed,
        load=options.load,
        roughness=options.roughness or "sandpaper",
        striker=options.striker or "steel",
        time=time,
    )


def _roll(text: str, options: argparse.Namespace) -> Roll:
    path_text, time = _split_time("--roll", text)
    return Roll(
        path=_parse_path("--roll", path_text),
        speed=_SPEED if options.speed is None else options.speed,
        **select_options(options, "radius mass"),
        time=time,
        **({} if options.roughness is None else {"roughness": options.roughness}),
    )


def _pluck(text: str, options: argparse.Namespace) -> Pluck:
    place_text, time = _split_time("--pluck", text)
    return Pluck(at=_place(place_text), time=time, force=options.force, direction=options.direction)


def _hold(text: str, options: argparse.Namespace) -> Hold:
    place_text, time = _split_time("--hold", text)
    return Hold(at=_place(place_text), time=time, grip=options.grip)


def _split_time(option: str, text: str) -> tuple[str, float]:
    what, at_sign, time = text.partition("@")
    with suppress(ValueError):
        if 0 <= (seconds := float(time) if at_sign else 0.0) < math.inf:
            return what, seconds
    raise OptionError(f"{option} {text} ends in {time!r}: give seconds after @, of at least 0")


def _parse_path(option: str, text: str) -> tuple[_Spot, ...]:
    places = text.split("..")
    if len(places) < 2 or not all(places):
        raise OptionError(f"{option} {text} names no way: give two places or more, as in rim..top")
    return tuple(place(item) for item in places)


def _place(text: str) -> _Spot | None:
    return place(text) if text else None
