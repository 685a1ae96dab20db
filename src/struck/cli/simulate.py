"""`struck simulate`: a scene file becomes a sound, a log, an animation and pictures."""

from __future__ import annotations

import argparse
import csv
import io
import json
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

import struck
from struck.cli import Result
from struck.cli.options import add_fade, add_listener, add_room, listener, metres, refuse, room
from struck.cli.play import device, played_result
from struck.cli.render import saved
from struck.ears.listeners import Listener, Mono, is_listener, position_of
from struck.errors import OptionError, counted, nearest
from struck.files.atomic import writable, write_bytes
from struck.files.sound import Sound
from struck.files.sound_formats import chosen
from struck.model.provenance import TerminalProgress
from struck.report.charts import save as save_picture
from struck.report.contact_sheet import contact_sheet
from struck.scene import Events, Scene, events_of, save_animation, save_contacts
from struck.scene.ending import require_fade
from struck.scene.engines.restitution import PairValues
from struck.scene.engines.simulation import Simulation, require_seconds
from struck.scene.render import require_length
from struck.scene.stems import save_stems

EXAMPLES = (
    (
        "shelf.xml --seconds 3 --material 'mug*=ceramic' --material '*=oak' "
        "--restitution materials --listener 0,-1.5,1 -o shelf.wav"
    ),
)
_PATTERN = "PATTERN=VALUE"
_POLL_INTERVAL = 0.02  # s between two checks whether it still plays


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `struck simulate`."""
    parser.add_argument("scene", help="scene file, MJCF or URDF")
    parser.add_argument(
        "--seconds", type=float, default=5.0, help="duration of the simulation, s (default: 5)"
    )
    many = {"action": "append", "metavar": _PATTERN, "default": []}
    bodies = parser.add_argument_group("bodies, selected by patterns of their names")
    bodies.add_argument(
        "--material", **many, help="material, e.g. mug*=ceramic, or one for all bodies"
    )
    bodies.add_argument("--wall", **many, help="wall thickness of hollow bodies, m")
    bodies.add_argument(
        "--model", **many, help="model or mesh file that sounds instead of the shape in the scene"
    )
    bodies.add_argument("--roughness", **many, help="surface finish")
    bodies.add_argument(
        "--mute",
        action="append",
        default=[],
        help="pattern of bodies without sound, which are not analyzed",
    )
    bodies.add_argument(
        "--accuracy",
        default="standard",
        help="accuracy of the frequencies: preview, standard (default) or fine",
    )
    bodies.add_argument(
        "--damping", default="own", help="damping constants: own (default) or heard"
    )
    engine = parser.add_argument_group("engine")
    pair = "PAIR=VALUE"
    for name in ("restitution", "friction"):
        text = "a number, materials, or values of pairs, e.g. ball,floor*=0.8; default: the file's"
        engine.add_argument(f"--{name}", action="append", metavar=pair, default=[], help=text)
    engine.add_argument(
        "--engine", default="mujoco", help="physics engine: mujoco (default) or rapier"
    )
    engine.add_argument("--step", type=float, help="time step, s; default: that of the file")
    engine.add_argument("--keyframe", help="name of the keyframe to start from")
    engine.add_argument(
        "--folder",
        help="folder that contains all files of the scene; default: that of the scene file",
    )
    engine.add_argument(
        "--convex",
        default="parts",
        help="collision shape of concave meshes: parts (default) or hull, both convex",
    )
    add_listener(parser)
    add_room(parser)
    parser.add_argument("--play", action="store_true", help="play live, and write no files")
    parser.add_argument("--device", help="output device, as for 'struck play'")
    parser.add_argument(
        "--ring",
        type=float,
        default=2.0,
        help="time rendered after the simulation ends, s (default: 2)",
    )
    parser.add_argument("--rate", type=int, default=48_000, help="sample rate, Hz (default: 48000)")
    add_fade(parser)
    parser.add_argument("--stems", action="store_true", help="also write a sound of each body")
    parser.add_argument(
        "--log", help="contact log, .npz, .csv or .jsonl; default: OUTPUT with the ending .npz"
    )
    parser.add_argument("-o", "--output", help="sound file; default: SCENE.wav")


def run(options: argparse.Namespace, progress: TerminalProgress) -> Result:
    """Run `struck simulate`."""
    others = ("log", "output", "rate", "ring", "fade", "stems") if options.play else ("device",)
    hint = "a file: leave out --play" if options.play else "playing: give --play"
    refuse(options, others, f"is for {hint}")
    require_seconds(options.seconds, options.ring)
    if options.play:
        return _play_live(options, progress)
    _sound_options(options)  # refused before bodies are analyzed
    require_length(options.seconds + options.ring, options.rate)
    require_fade(options.fade, options.seconds + options.ring)
    output = writable(options.output or Path(options.scene).with_suffix(".wav"))
    chosen(output)
    log = writable(options.log or output.with_suffix(".npz"), unlike=[options.scene])
    scene, contacts = struck.simulate(
        options.scene, options.seconds, progress=progress, **_simulation_options(options)
    )
    save_contacts(contacts, log)
    progress("computing the sound", 0.0)
    events = events_of(scene, contacts)
    excitations = events.on()
    _require_models(excitations, events, options)
    if options.listener is None and options.walk is None:
        options.listener = _place_before(excitations)
    sound_options = _sound_options(options)
    sound = struck.render(excitations, **sound_options)
    factor = sound.save(output)
    table = events.table()
    others, missing = _write_others(output, scene, events, table, sound, options.seconds, progress)
    files = [output, log, *others]
    if options.stems:
        files += save_stems(excitations, output, factor=factor, **sound_options)
    notes = list(dict.fromkeys((*scene.notes, *sound.notes, *missing)))
    last = f"wrote {output} ({sound.duration:.2f} s{saved(sound, factor)})"
    impacts = sum(row["event"] == "impact" for row in table)
    count = (
        f"{counted(len(contacts), 'row')} of contacts, {counted(impacts, 'point')} of blows, "
        f"{counted(len(events.sustained), 'lasting contact')}"
    )
    lines = [*notes, count, *(f"wrote {file}" for file in files[1:]), last]
    return Result(
        lines,
        output=str(output),
        files=[str(file) for file in files],
        contacts=len(contacts),
        impacts=impacts,
        sustained=len(events.sustained),
        factor=factor,
        notes=notes,
    )


def _require_models(scene: Scene, events: Events, options: argparse.Namespace) -> None:
    """Refuse a scene whose bodies touch, none of which has a model of its sound."""
    if len(events.contacts) and all(body.silent for body in scene.bodies.values()):
        notes = options.in_shell_words("; ".join(dict.fromkeys(scene.notes)))
        raise OptionError(f"nothing sounds: {notes}")


def _play_live(options: argparse.Namespace, progress: TerminalProgress) -> Result:
    """Play a simulation until its time is over, or it explodes."""
    ears = _ears(options)  # refused before bodies are analyzed
    simulation = Simulation(options.scene, progress=progress, **_simulation_options(options))
    progress.close()
    with struck.play(simulation, listener=ears, device=device(options.device)) as player:
        end = time.monotonic() + options.seconds
        with suppress(KeyboardInterrupt):
            while time.monotonic() < end and player.simulating:
                time.sleep(_POLL_INTERVAL)
        player.listen(player.listener)  # tells what went wrong
        return played_result(player, simulation.notes)


def _simulation_options(options: argparse.Namespace) -> dict[str, Any]:
    """Return the options of a `Simulation`."""
    plain = ("mute", "engine", "step", "keyframe", "folder", "convex", "accuracy", "damping")
    return {name: getattr(options, name) for name in plain} | {
        "materials": _table("--material", options.material) or None,
        "walls": _measures("--wall", options.wall),
        "models": _table("--model", options.model, whole=False),
        "roughness": _table("--roughness", options.roughness, whole=False),
        "restitution": _pairs("--restitution", options.restitution),
        "friction": _pairs("--friction", options.friction),
    }


def _sound_options(options: argparse.Namespace) -> dict[str, Any]:
    """Return length, rate, listener and room of a scene, as `struck.render` takes them."""
    return {
        "listener": _ears(options),
        "room": room(options),
        "seconds": options.seconds + options.ring,
        "sample_rate": options.rate,
        "fade": options.fade,
    }


def _ears(options: argparse.Namespace) -> Listener | None:
    """Return the listener; a bare position is an ear in the scene."""
    someone = listener(options)
    if someone is None or is_listener(someone):
        return someone
    return Mono(position=position_of(someone))


def _place_before(scene: Scene) -> tuple[float, float, float]:
    """Return a place 1 m or more in front of a scene's moving bodies and half as far above, m."""
    places = [body.origin.points for body in scene.bodies.values() if body.moves]
    points = np.concatenate(places or [np.zeros((1, 3))])
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    distance = max(1.0, 1.5 * float(np.linalg.norm(np.ptp(points, axis=0))))
    x, y, z = (middle + distance * np.array([0.0, -1.0, 0.5])).tolist()
    return x, y, z


def _write_others(
    output: Path,
    scene: Scene,
    events: Events,
    table: Sequence[Mapping[str, object]],
    sound: Sound,
    seconds: float,
    progress: TerminalProgress,
) -> tuple[Sequence[Path], Sequence[str]]:
    """Write the list of events, the animation and the picture; return their files, and notes."""
    listing, motion, sheet = (
        output.with_suffix(ending) for ending in (".events.csv", ".glb", ".png")
    )
    write_bytes(listing, _lines(table).encode())
    if not any(body.model.geometry is not None for body in scene.bodies.values()):
        return [listing], ["no body has a surface: there is no animation and no picture"]
    progress("writing animation and pictures", 0.0)
    save_animation(scene, motion, seconds=seconds)
    save_picture(contact_sheet(events, sound, seconds=seconds), sheet)
    return [listing, motion, sheet], []


def _lines(rows: Sequence[Mapping[str, object]]) -> str:
    """Return a table as CSV text, lists in its cells as JSON."""
    columns = list(dict.fromkeys(name for row in rows for name in row)) or ["event", "time"]
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    for row in rows:
        plain = {k: json.dumps(v) if isinstance(v, list) else v for k, v in row.items()}
        writer.writerow(plain)
    return text.getvalue()


def _table(option: str, texts: Sequence[str], *, whole: bool = True) -> dict[str, str]:
    """Return values by patterns; where `whole`, one without a pattern is everything's."""
    table = {}
    for text in texts:
        pattern, equals, value = text.rpartition("=")
        if not (equals or whole) or not value or (equals and not pattern):
            raise OptionError(f"{option} {text}: give {_PATTERN}, as in mug*=...")
        table[pattern if equals else "*"] = value
    return table


def _measures(option: str, texts: Sequence[str]) -> dict[str, float]:
    try:
        return {k: metres(v) for k, v in _table(option, texts, whole=False).items()}
    except ValueError as error:
        raise OptionError(f"{option}: {error}: give m, or a unit, as mug*=3mm") from None


def _number(option: str, text: str, many: str = "give") -> float:
    try:
        return float(text)
    except ValueError:
        raise OptionError(f"{option} {text}: {many} a number") from None


def _pairs(option: str, texts: Sequence[str]) -> PairValues | None:
    """Return one value, "materials", or values of pairs."""
    if not texts:
        return None
    if len(texts) == 1 and "=" not in texts[0]:
        forms = f"{nearest(texts[0], ['materials'])}give materials, pairs as ball,floor*=0.8, or"
        return texts[0] if texts[0] == "materials" else _number(option, texts[0], forms)
    values: dict[tuple[str, str], float] = {}
    for pair, value in _table(option, texts, whole=False).items():
        one, comma, other = pair.partition(",")
        if not comma:
            raise OptionError(f"{option} {pair}={value}: give two patterns, as ball,floor*={value}")
        values[one, other] = _number(option, value)
    return values
