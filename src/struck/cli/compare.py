"""`struck compare`: a model compared with a recording of the body or with another model."""

from __future__ import annotations

import argparse
from contextlib import suppress
from typing import TYPE_CHECKING

import struck
from struck.cli import Result
from struck.cli.info import or_null
from struck.cli.options import POSITION, place
from struck.errors import OptionError, StruckError
from struck.excitation.strike import Strike
from struck.files.atomic import writable
from struck.files.model_file import is_model
from struck.model.html import PAGES
from struck.model.provenance import TerminalProgress

if TYPE_CHECKING:
    from struck.report.comparison import Comparison


EXAMPLES = (
    "bell.struck real_bell.wav --at rim -o bell.html",
    "bell.struck thicker_bell.struck --at rim -o difference.html",
)


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `struck compare`."""
    parser.add_argument("model", help="model file")
    parser.add_argument(
        "other", help="recording of the body with one or more hits, or another model file"
    )
    parser.add_argument(
        "--at",
        "--strike",
        metavar="PLACE",
        type=place,
        help="contact of both strikes: name, vertex:N or x,y,z in m; default: the playing place",
    )
    parser.add_argument(
        "--against",
        metavar="PLACE",
        type=place,
        help="contact of the strike on the other model, if it differs",
    )
    parser.add_argument(
        "--striker", help="striker of both: fingertip, felt, rubber, wood, steel, ..."
    )
    parser.add_argument("--speed", type=float, help="speed of the striker, m/s")
    parser.add_argument("--impulse", type=float, help="impulse of both strikes, N s")
    parser.add_argument(
        "--listener", type=POSITION, help="position x,y,z, m; default: next to each body"
    )
    parser.add_argument("-o", "--output", metavar="PAGE", help="HTML page with pictures and sounds")


def run(options: argparse.Namespace, progress: TerminalProgress) -> Result:
    """Run `struck compare`."""
    from struck.report.comparison import compare

    read = [options.model, options.other]
    _require_order(*read)
    output = None
    if options.output is not None:
        output = writable(options.output, unlike=read, endings=PAGES, kind="pages")
    blow = {name: getattr(options, name) for name in ("striker", "speed", "impulse")}
    model = struck.load(options.model)
    comparison = compare(
        model,
        options.other,
        at=options.at,
        strike=Strike(**blow) if any(value is not None for value in blow.values()) else None,
        against=None if options.against is None else Strike(at=options.against, **blow),
        listener=options.listener,
        progress=progress,
    )
    lines, facts, written = comparison.summary(), _facts(comparison), {}
    if is_model(options.other):
        places = {"at": options.at, "against": options.against, "listener": options.listener}
        with suppress(StruckError):  # of recordings, whose levels are relative
            distance = struck.sonic_distance(model, struck.load(options.other), **places)
            facts["sonic_distance"] = distance
            places_text = "there" if options.at else "where each is struck unless told"
            lines.append(f"sonic distance {distance:.1f} dB, of an impulse each {places_text}")
    if output is not None:
        progress("writing the page", 0.0)
        comparison.save_page(output)
        lines.append(f"wrote {output}")
        written = {"output": str(output)}
    return Result(lines, **facts, **written)


def _require_order(model: str, other: str) -> None:
    if is_model(other) and not is_model(model):
        raise OptionError(
            f"{model} is no model, and {other} is: give the model first, as `struck compare "
            f"{other} {model}`"
        )


def _facts(comparison: Comparison) -> dict[str, object]:
    """Return the result of a comparison for `--json`."""
    mine, others = comparison.model.partials, comparison.other.partials
    one, two = comparison.pairing.computed, comparison.pairing.fitted
    columns = {
        "mode": one + 1,
        "frequency": mine.frequencies[one],
        "other_frequency": others.frequencies[two],
        "cents": comparison.cents,
        "decay": mine.decays[one],
        "other_decay": others.decays[two],
        "decay_ratio": comparison.decay_ratios,
        "level_difference": comparison.level_differences,
        "confidence": comparison.pairing.confidence,
    }
    rows = zip(*map(or_null, columns.values()), strict=True)
    return {
        "pairs": [dict(zip(columns, row, strict=True)) for row in rows],
        "missing": mine.frequencies[comparison.missing].tolist(),
        "twins": mine.frequencies[comparison.twins].tolist(),
        "extra": others.frequencies[comparison.extra].tolist(),
        "level_offset": comparison.level_offset,
        "explained": comparison.explained,
        "by_chance": comparison.by_chance,
        "strikes": {side.name: side.struck for side in (comparison.model, comparison.other)},
        "notes": list(comparison.notes),
    }
