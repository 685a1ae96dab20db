"""`struck analyze-many`: patterns of mesh files in, a folder of models and a report out."""

from __future__ import annotations

import argparse
from pathlib import Path

from struck import analyze_many
from struck.cli import SOME_FAILED, Result
from struck.cli.analyze import add_how, analysis_options
from struck.cli.options import add_budget, add_fade, material_of
from struck.errors import OptionError, counted
from struck.files.atomic import is_file
from struck.model.provenance import TerminalProgress
from struck.processes.termination import orderly_end

EXAMPLES = (
    "'meshes/**/*.obj' --material steel -o models",
    "--table objects.csv -o models --strikes 5 --seed 1 --sounds flac",
    "meshes --material oak -o models --scheduler tcp://head:8786",
)


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `struck analyze-many`."""
    parser.add_argument("files", nargs="*", help="mesh files, folders of them, or patterns")
    parser.add_argument(
        "-o", "--output", required=True, help="folder for the models and the report"
    )
    parser.add_argument("--table", help="CSV or TOML table of files, with options for each")
    add_how(parser)
    add_budget(parser)
    work = parser.add_argument_group("processing")
    work.add_argument(
        "--anew", action="store_true", help="compute everything again, failures included"
    )
    work.add_argument(
        "--processes", type=int, help="number of simultaneous processes; default: number of cores"
    )
    work.add_argument(
        "--memory",
        type=float,
        help="memory limit of all processes together, bytes; default: free memory",
    )
    work.add_argument("--scheduler", help="address of a Dask scheduler, e.g. tcp://host:8786")
    sounds = parser.add_argument_group("sounds")
    sounds.add_argument(
        "--strikes",
        help="number of random strikes of each model, or a CSV or TOML table of strikes",
    )
    sounds.add_argument(
        "--seed", type=int, default=0, help="seed of the random strikes (default: 0)"
    )
    sounds.add_argument(
        "--seconds", type=float, default=1.0, help="length of each sound, s (default: 1)"
    )
    sounds.add_argument("--rate", type=int, default=48_000, help="sample rate, Hz (default: 48000)")
    sounds.add_argument(
        "--sounds", default="wav", help="format of the sounds: wav (default), flac or npz"
    )
    add_fade(sounds)
    sounds.add_argument(
        "--labels",
        default="labels.csv",
        help="table of strikes, .csv or .parquet (default: labels.csv)",
    )


def run(options: argparse.Namespace, progress: TerminalProgress) -> Result:
    """Run `struck analyze-many`."""
    material, number = options.material, options.strikes or ""
    if number and not number.isdecimal() and not is_file(number):
        raise OptionError(
            f"--strikes {number} is neither a number nor a file: give how many of each model, or a "
            "table, as strikes.csv"
        )
    option_names = ("table", "processes", "memory", "scheduler")
    option_names += ("seed", "seconds", "sounds", "fade", "labels")
    with orderly_end():
        report = analyze_many(
            options.files,
            None if material is None else material_of(material),
            out=options.output,
            strikes=int(number) if number.isdecimal() else number or None,
            sample_rate=options.rate,
            modes=options.modes,
            resume=not options.anew,
            progress=progress,
            **{name: getattr(options, name) for name in option_names},
            **analysis_options(options),
        )
    failure_lines = [f"failed: {row.file} {row.part}: {row.message}" for row in report.failed[:20]]
    if len(report.failed) > len(failure_lines):
        failure_lines.append(f"and {len(report.failed) - len(failure_lines)} more")
    warning_lines = [
        f"{Path(row.file).name}: {warning}" for row in report.rows for warning in row.warnings
    ]
    failure_lines += warning_lines[:20]
    if len(warning_lines) > 20:
        failure_lines.append(f"and {counted(len(warning_lines) - 20, 'more warning')}")
    page = report.folder / "report.html"
    result = Result(
        [*failure_lines, str(report), f"open {page} in a browser to see and hear them"],
        page=str(page),
        computed=report.computed,
        rows=[row.plain() for row in report.rows],
    )
    result.code = SOME_FAILED if report.failed else 0
    return result
