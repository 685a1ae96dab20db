"""The shell: the same verbs as in Python, nothing else."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path

import struck
from struck.cli.analyze import LISTED, MATERIAL, declare_analyze, described
from struck.cli.cache import declare_cache
from struck.cli.calibrate import declare_calibrate
from struck.cli.command import Result, command, warnings_in_one_line
from struck.cli.compare import declare_compare
from struck.cli.export import declare_export
from struck.cli.fit import declare_fit
from struck.cli.options import add_listener, add_room, body_named, listener, material_named, room
from struck.cli.play import declare_play
from struck.cli.record import declare_record
from struck.cli.render import add_touches, touches
from struck.cli.sound_map import declare_sound_map
from struck.errors import StruckError
from struck.files.atomic import writable
from struck.model.html import aligned
from struck.model.provenance import TerminalProgress

BAD_INPUT = 2
INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code: 0, 2 on bad input, 130 when interrupted."""
    options = _parser().parse_args(arguments)
    progress = TerminalProgress()
    try:
        with warnings_in_one_line():
            result = options.run(options, progress)
    except StruckError as error:
        progress.close()
        print(f"struck: {error}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        progress.close()
        print("struck: interrupted", file=sys.stderr)
        return INTERRUPTED
    progress.close()
    return _told(json.dumps(result.facts, indent=2) if options.json else result.text)


def _told(text: str) -> int:
    """Print, and end quietly when the reader has gone, as `head` does."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="struck", description="The sounds of physical objects, computed from what they are."
    )
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for declare in (
        declare_analyze,
        _info,
        _show,
        _render,
        declare_sound_map,
        declare_play,
        declare_record,
        declare_fit,
        declare_compare,
        declare_calibrate,
        declare_export,
        _tune,
        _materials,
        declare_cache,
        _demo,
    ):
        declare(commands)
    return parser


def _info(commands: argparse._SubParsersAction) -> None:
    parser = command(commands, _run_info, "info", "tell what a model holds", "bell.struck")
    parser.add_argument("model")
    parser.add_argument("--modes", type=int, default=LISTED, help="how many to list")


def _run_info(options: argparse.Namespace, _progress: TerminalProgress) -> Result:
    model = struck.load(options.model)
    return described(model, "", listed=options.modes)


def _show(commands: argparse._SubParsersAction) -> None:
    parser = command(
        commands, _run_show, "show", "draw shape, modes and spectrum", "bell.struck -o bell.png"
    )
    parser.add_argument("model")
    parser.add_argument("-o", "--output", help="picture; MODEL.png unless given")


def _run_show(options: argparse.Namespace, _progress: TerminalProgress) -> Result:
    output = writable(
        options.output or Path(options.model).with_suffix(".png"), unlike=[options.model]
    )
    struck.show(struck.load(options.model), output)
    return Result(f"wrote {output}", output=str(output))


def _render(commands: argparse._SubParsersAction) -> None:
    parser = command(
        commands,
        _run_render,
        "render",
        "strike, scrape, roll on, pluck or hold a model and save the sound",
        "bell.struck --strike rim --striker wood --speed 1 --listener 0,2,0 --facing 1,0,0 "
        "--hrtf kemar -o bell.wav",
    )
    parser.add_argument("model")
    add_touches(parser)
    add_listener(parser)
    add_room(parser)
    parser.add_argument("--seconds", type=float, help="length of the sound")
    parser.add_argument("--rate", type=int, default=48_000, help="samples a second")
    parser.add_argument("--level", default="peak", help="peak (default) or absolute (1.0 = 20 Pa)")
    parser.add_argument("--encoding", default="float32", help="float32 (default), int24 or int16")
    parser.add_argument("-o", "--output", help="sound file; MODEL.wav unless given")


def _run_render(options: argparse.Namespace, progress: TerminalProgress) -> Result:
    read = filter(None, (options.model, options.walk, options.hrtf))
    output = writable(options.output or Path(options.model).with_suffix(".wav"), unlike=read)
    model = struck.load(options.model)
    progress("render", 0.0)
    sound = struck.render(
        model,
        touches(options),
        seconds=options.seconds,
        sample_rate=options.rate,
        listener=listener(options),
        room=room(options),
    )
    factor = sound.save(output, level=options.level, encoding=options.encoding)
    text = "\n".join((*sound.notes, f"wrote {output} ({sound.duration:.2f} s)"))
    return Result(
        text, output=str(output), seconds=sound.duration, factor=factor, notes=list(sound.notes)
    )


def _tune(commands: argparse._SubParsersAction) -> None:
    parser = command(
        commands,
        _run_tune,
        "tune",
        "find the dimension that makes a body ring at a frequency",
        "tube:length=0.5,radius=0.0125,wall=0.001 --material aluminium --vary length "
        "--lowest 587.33",
    )
    parser.add_argument("body", help="tube:length=0.5,radius=0.0125,wall=0.001")
    parser.add_argument("--material", required=True, help=MATERIAL)
    parser.add_argument("--vary", required=True, help="name of the dimension")
    parser.add_argument("--lowest", type=float, required=True, help="Hz")
    parser.add_argument("--accuracy", default="standard", help="preview, standard or fine")


def _run_tune(options: argparse.Namespace, progress: TerminalProgress) -> Result:
    body = struck.tune(
        body_named(options.body),
        material_named(options.material),
        vary=options.vary,
        lowest=options.lowest,
        accuracy=options.accuracy,
        progress=progress,
    )
    value = getattr(body, options.vary)
    return Result(f"{options.vary} = {value:.7g}", **{options.vary: value})


def _materials(commands: argparse._SubParsersAction) -> None:
    command(commands, _run_materials, "materials", "list materials with their sources", "--json")


def _run_materials(_options: argparse.Namespace, _progress: TerminalProgress) -> Result:
    head = ("material", "kg/m3", "GPa", "Poisson", "tan phi", "heard")
    rows = [
        (
            name,
            f"{entry['density']:.0f}",
            f"{entry['youngs_modulus'] / 1e9:.4g}",
            f"{entry['poisson_ratio']:.3g}",
            f"{entry['loss_tangent']:.2g}",
            "yes" if "heard" in entry else "",
        )
        for name, entry in struck.materials().items()
    ]
    return Result(
        aligned([head, *rows]), **{name: dict(e) for name, e in struck.materials().items()}
    )


def _demo(commands: argparse._SubParsersAction) -> None:
    parser = command(
        commands, _run_demo, "demo", "make a gallery of sounds and pictures", "--out gallery"
    )
    parser.add_argument("--out", default="gallery", help="folder to make")


def _run_demo(options: argparse.Namespace, progress: TerminalProgress) -> Result:
    from struck.report.gallery import gallery

    page = gallery(Path(options.out), progress)
    return Result(f"open {page.resolve()} in a browser to see and hear it", page=str(page))
