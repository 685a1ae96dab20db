"""The command of the shell that plays."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

import struck
from struck.cli import Result
from struck.cli.options import (
    add_budget,
    add_listener,
    listener,
    refuse,
    require_alone,
    select_options,
)
from struck.errors import DeviceError, OptionError, printable
from struck.model.provenance import TerminalProgress
from struck.processes.termination import orderly_end

if TYPE_CHECKING:
    from struck.live.keys import Keys, Robot
    from struck.live.player import Player

_SOAK_MODES, _SOAK_STRIKES, _SOAK_SCRAPES = 2000, 200.0, 2
_POLL_INTERVAL = 0.004  # s between two looks at the keyboard
_RING = 2.0  # s that the last strike sounds after the end of piped keys
_UPDATE_INTERVAL = 0.2  # s between two updates of the line


EXAMPLES = ("--list-devices",)


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `struck play`."""
    parser.add_argument("models", nargs="*", metavar="MODEL", help="model files")
    parser.add_argument(
        "--list-devices", action="store_true", help="list the audio devices and exit"
    )
    parser.add_argument(
        "--device",
        help="number of the output device, or part of its name; default: that of the system",
    )
    parser.add_argument("--rate", type=float, help="sample rate, Hz; default: that of the device")
    parser.add_argument("--block", type=int, default=128, help="samples per block (default: 128)")
    parser.add_argument(
        "--ahead",
        type=int,
        default=2,
        help="number of blocks of forces computed ahead (default: 2)",
    )
    parser.add_argument(
        "--voices",
        type=int,
        default=16,
        help="maximum number of simultaneous excitations (default: 16)",
    )
    parser.add_argument(
        "--volume",
        type=float,
        default=0.0,
        help="dB; at 0 (default) the default strike peaks at -12 dB of full scale",
    )
    add_listener(parser)
    add_budget(parser)
    parser.add_argument(
        "--seconds",
        type=float,
        help="stop after this time, s; default: at q, or at the end of piped keys",
    )
    parser.add_argument(
        "--strikes-per-second",
        dest="strikes",
        type=float,
        default=0.0,
        help="number of random strikes per second (default: 0)",
    )
    parser.add_argument(
        "--scrapes", type=int, default=0, help="number of endless scrapes (default: 0)"
    )
    parser.add_argument(
        "--busy", action="store_true", help="run a thread that computes in Python all the time"
    )
    parser.add_argument(
        "--soak",
        type=float,
        metavar="SECONDS",
        help="stress test: 2,000 modes, 200 strikes per second, two scrapes, a busy thread",
    )


def run(options: argparse.Namespace, progress: TerminalProgress) -> Result:
    """Run `struck play`."""
    from struck.live.keys import repeat_models
    from struck.scene.body import with_fewer_modes

    _require_counts(options)
    if options.list_devices:
        require_alone(options, "list_devices")
        return _devices()
    if options.soak is not None:
        others = ("seconds", "strikes", "scrapes")
        refuse(options, others, "is what --soak chooses itself: leave out --soak")
    models, notes = with_fewer_modes(list(map(struck.load, options.models)), options.modes)
    if options.soak is not None:
        models = repeat_models(models or [_usual_model()], _SOAK_MODES)
        options.seconds, options.busy = options.soak, True
        options.strikes, options.scrapes = _SOAK_STRIKES, _SOAK_SCRAPES
    if not models:
        raise OptionError("there is nothing to play: give a model, as `struck play bell.struck`")
    progress("opening the audio device", 0.0)
    player = struck.play(
        models,
        listener=listener(options),
        device=device(options.device),
        sample_rate=options.rate,
        **select_options(options, "block ahead voices volume"),
    )
    progress.close()
    with orderly_end(), player:
        strikes, seconds = _play(player, models, options)
        modes = sum(len(model.frequencies) for model in models)
        return played_result(player, notes, modes=modes, strikes=strikes, seconds=seconds)


def _require_counts(options: argparse.Namespace) -> None:
    bounds = {
        "--seconds": options.seconds,
        "--strikes-per-second": options.strikes,
        "--scrapes": options.scrapes,
        "--soak": options.soak,
    }
    for name, value in bounds.items():
        if value is not None and not 0 <= value < math.inf:
            raise OptionError(f"{name} is {value}: it must be finite and at least 0")


def _play(
    player: Player, models: list[struck.ModalModel], options: argparse.Namespace
) -> tuple[int, float]:
    """Play until the person or the clock ends it; return the number of strikes and the time, s."""
    from struck.live.keys import Robot, busy_thread, places_by_key, terminal_keys

    robot = Robot(player, models, strikes=options.strikes, scrapes=options.scrapes)
    end = time.monotonic() + (math.inf if options.seconds is None else options.seconds)
    start = time.monotonic()
    places = places_by_key(models[0])
    with terminal_keys() as keys, busy_thread(is_busy=options.busy):
        _explain(player, places)
        try:
            typed = _loop(player, keys, places, robot, end)
        except KeyboardInterrupt:
            typed = 0
    return robot.strikes + typed, time.monotonic() - start


def _loop(player: Player, keys: Keys, places: dict, robot: Robot, end: float) -> int:
    from struck.live.keys import QUIT

    typed, shown, last = 0, 0.0, None
    while time.monotonic() < end:
        key = keys.pressed(_POLL_INTERVAL).lower()
        if key == QUIT:
            break
        if keys.ended and not robot.plays and last is None:
            last = time.monotonic() + (_RING if typed else 0.0)
            end = min(end, last)
        if key in places:
            player.strike(at=places[key])
            typed += 1
        robot.go_on()
        if not player.active:
            player.strike()  # tells what is wrong
        if time.monotonic() - shown > _UPDATE_INTERVAL:
            shown = time.monotonic()
            _show(_line(player))
    return typed


def _explain(player: Player, places: dict) -> None:
    if not sys.stderr.isatty():
        return
    key_places = [
        f"{key}={place}" for key, place in places.items() if place and ":" not in str(place)
    ]
    sys.stderr.write(
        f"latency {1000 * player.latency:.0f} ms; space strikes, "
        f"{printable(' '.join(key_places))}, letters strike all over, q ends\n"
    )


def _show(line: str) -> None:
    if sys.stderr.isatty():
        sys.stderr.write(f"\r{line}\033[K")
        sys.stderr.flush()


def _line(player: Player) -> str:
    peak = 20 * math.log10(max(player.peak, 1e-6))
    load, delay = player.simulation_load, player.slipped
    run = f"simulation {load:.0f} %  slipped {delay:.2f} s  " if load else ""
    return (
        f"load {player.load:.0f} %  {run}underflows {player.underflows}  late {player.late}  "
        f"dropped {player.dropped}  peak {peak:.1f} dB"
    )


def played_result(player: Player, notes: Sequence[str] = (), **more: float) -> Result:
    """Return the result of a command that played: notes, and counts of late and dropped blocks."""
    if sys.stderr.isatty():
        sys.stderr.write("\n")
    names = ("load", "simulation_load", "underflows", "late", "dropped", "slipped", "overdue")
    names += ("peak", "sample_rate", "latency")
    lead = "".join(f"{value:.0f} {name}, " for name, value in more.items())
    facts = {name: getattr(player, name) for name in names}
    return Result([*notes, lead + _line(player)], **more, **facts)


def _devices() -> Result:
    from struck.live.device import PortAudio

    with PortAudio() as portaudio:
        devices = portaudio.devices()
    if not devices:
        raise DeviceError("no audio device can play: connect one, or start a sound server")
    lines = list(map(str, devices))
    return Result(lines, devices=lines)


def device(text: str | None) -> int | str | None:
    """Return the number of a device, or part of its name."""
    return int(text) if text is not None and text.isdecimal() else text


def _usual_model() -> struck.ModalModel:
    from struck.solids import Tube

    tube = Tube(length=0.505, radius=0.0125, wall=0.001)
    return struck.analyze(tube, "steel", accuracy="preview", progress=None)
