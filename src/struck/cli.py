"""The shell: the same verbs as in Python, nothing else."""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import struck
from struck.arguments import body_named, material_named, numbers, writable
from struck.cache_command import declare_cache
from struck.command import Result, command, warnings_in_one_line
from struck.errors import StruckError
from struck.listener_arguments import add_listener, add_room, listener, room
from struck.play_command import declare_play
from struck.progress import TerminalProgress
from struck.tables import HEADINGS, aligned, modes_rows
from struck.touch_arguments import add_touches, touches

if TYPE_CHECKING:
    import numpy as np

BAD_INPUT = 2
INTERRUPTED = 130
_LISTED = 20
_MATERIAL = "name (see 'struck materials') or density=,youngs_modulus=,poisson_ratio="


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
        _analyze,
        _info,
        _show,
        _render,
        declare_play,
        _tune,
        _materials,
        declare_cache,
        _demo,
    ):
        declare(commands)
    return parser


def _analyze(commands: argparse._SubParsersAction) -> None:
    parser = command(
        commands,
        _run_analyze,
        "analyze",
        "compute the modes of a body and save its model",
        "bell.stl --material bronze --units mm -o bell.struck",
    )
    parser.add_argument("body", help="mesh file, or tube:length=0.5,radius=0.0125,wall=0.001")
    parser.add_argument("--material", required=True, help=_MATERIAL)
    parser.add_argument("--damping", default="own", help="own (default) or heard")
    parser.add_argument("--units", help="of the file's numbers: m, cm, mm, in or ft")
    parser.add_argument("--size", type=float, help="longest edge of the body instead, m")
    parser.add_argument("--wall", type=float, help="thickness of a hollow body's wall, m")
    parser.add_argument("--no-repair", dest="repair", action="store_false", help="refuse instead")
    parser.add_argument("--part", help="which of several bodies in the file")
    parser.add_argument("--up", help="axis that points up: x, y or z")
    parser.add_argument("--fixed", type=numbers(6), help="box x0,y0,z0,x1,y1,z1 that is held, m")
    parser.add_argument("--accuracy", default="standard", help="preview, standard or fine")
    parser.add_argument("--band", type=numbers(2), default=(20.0, 20_000.0), help="low,high in Hz")
    parser.add_argument("--radiation", default="power", help="power (default) or obrien2002")
    parser.add_argument("--method", default="quadratic", help="quadratic (default) or obrien2002")
    parser.add_argument(
        "--no-cache",
        dest="cache",
        action="store_false",
        help="neither take up nor keep finished work",
    )
    parser.add_argument("-o", "--output", help="model file; BODY.struck unless given")


def _run_analyze(options: argparse.Namespace, progress: TerminalProgress) -> Result:
    body = body_named(options.body)
    output = writable(options.output or f"{Path(options.body.partition(':')[0]).stem}.struck")
    fixed = options.fixed and (options.fixed[:3], options.fixed[3:])
    same = ("units", "size", "wall", "repair", "part", "up", "accuracy", "cache")
    same = (*same, "radiation", "method")
    model = struck.analyze(
        body,
        material_named(options.material, options.damping),
        **{name: getattr(options, name) for name in same},
        fixed=fixed,
        band=options.band,
        progress=progress,
    )
    struck.save(model, output)
    return _described(model, f"wrote {output}", output=str(output))


def _info(commands: argparse._SubParsersAction) -> None:
    parser = command(commands, _run_info, "info", "tell what a model holds", "bell.struck")
    parser.add_argument("model")
    parser.add_argument("--modes", type=int, default=_LISTED, help="how many to list")


def _run_info(options: argparse.Namespace, _progress: TerminalProgress) -> Result:
    model = struck.load(options.model)
    return _described(model, "", listed=options.modes)


def _show(commands: argparse._SubParsersAction) -> None:
    parser = command(
        commands, _run_show, "show", "draw shape, modes and spectrum", "bell.struck -o bell.png"
    )
    parser.add_argument("model")
    parser.add_argument("-o", "--output", help="picture; MODEL.png unless given")


def _run_show(options: argparse.Namespace, _progress: TerminalProgress) -> Result:
    output = writable(options.output or Path(options.model).with_suffix(".png"))
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
    output = writable(options.output or Path(options.model).with_suffix(".wav"))
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
    parser.add_argument("--material", required=True, help=_MATERIAL)
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
    from struck.demo import gallery

    page = gallery(Path(options.out), progress)
    return Result(f"open {page.resolve()} in a browser to see and hear it", page=str(page))


def _described(
    model: struck.ModalModel, last: str, *, listed: int = _LISTED, **facts: object
) -> Result:
    from struck.report import summary

    rows = modes_rows(model.frequencies, model.t60, model.decays, model.errors)
    more = [f"... and {len(rows) - listed} more"] if len(rows) > listed else []
    lines = [*summary(model), "", aligned([HEADINGS, *rows[:listed]]), *more, last]
    return Result(
        "\n".join(lines).rstrip(),
        frequencies=model.frequencies.tolist(),
        decays=model.decays.tolist(),
        errors=_or_null(model.errors),
        complete_to=model.complete_to,
        mass=model.mass,
        calibrated=model.calibrated,
        places=sorted(model.places),
        provenance={
            "method": model.provenance.method,
            "dropped": list(model.provenance.dropped),
            "references": list(model.provenance.references),
            "details": dict(model.provenance.details),
        },
        **facts,
    )


def _or_null(errors: np.ndarray | None) -> list[float | None] | None:
    """Return errors for JSON, which has no word for what is not a number."""
    if errors is None:
        return None
    return [error if math.isfinite(error) else None for error in errors.tolist()]
