"""`struck analyze-many`: patterns of mesh files in, a folder of models and a report out."""

from __future__ import annotations

import argparse
from pathlib import Path

from struck import analyze_many
from struck.cli import SOME_FAILED, Result
from struck.cli.analyze import add_how, how
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
    parser.add_argument("files", nargs="*", help="patterns, folders or names of mesh files")
    parser.add_argument("-o", "--output", required=True, help="folder of the models")
    parser.add_argument("--table", help="CSV or TOML of files with options of their own")
    add_how(parser)
    add_budget(parser)
    work = parser.add_argument_group("work")
    work.add_argument("--anew", action="store_true", help="do again what is there, failures too")
    work.add_argument("--processes", type=int, help="at once; as many as cores unless given")
    work.add_argument("--memory", type=float, help="of all together, bytes; what is free")
    work.add_argument("--scheduler", help="of a Dask cluster, as tcp://host:8786")
    sounds = parser.add_argument_group("sounds")
    sounds.add_argument("--strikes", help="how many of each model, or a CSV or TOML table of them")
    sounds.add_argument("--seed", type=int, default=0, help="of random strikes (default 0)")
    sounds.add_argument("--seconds", type=float, default=1.0, help="of each sound (default 1)")
    sounds.add_argument("--rate", type=int, default=48_000, help="samples a second")
    sounds.add_argument("--sounds", default="wav", help="wav (default), flac or npz")
    add_fade(sounds)
    sounds.add_argument("--labels", default="labels.csv", help="table of strikes: .csv, .parquet")


def run(options: argparse.Namespace, progress: TerminalProgress) -> Result:
    """Run `struck analyze-many`."""
    named, number = options.material, options.strikes or ""
    if number and not number.isdecimal() and not is_file(number):
        raise OptionError(
            f"--strikes {number} is neither a number nor a file: give how many of each model, or a "
            "table, as strikes.csv"
        )
    same = ("table", "processes", "memory", "scheduler")
    same += ("seed", "seconds", "sounds", "fade", "labels")
    with orderly_end():
        report = analyze_many(
            options.files,
            None if named is None else material_of(named),
            out=options.output,
            strikes=int(number) if number.isdecimal() else number or None,
            sample_rate=options.rate,
            modes=options.modes,
            resume=not options.anew,
            progress=progress,
            **{name: getattr(options, name) for name in same},
            **how(options),
        )
    failed = [f"failed: {row.file} {row.part}: {row.message}" for row in report.failed[:20]]
    if len(report.failed) > len(failed):
        failed.append(f"and {len(report.failed) - len(failed)} more")
    told = [f"{Path(row.file).name}: {each}" for row in report.rows for each in row.warnings]
    failed += told[:20] + [f"and {counted(len(told) - 20, 'more warning')}"] * (len(told) > 20)
    page = report.folder / "report.html"
    result = Result(
        [*failed, str(report), f"open {page} in a browser to see and hear them"],
        page=str(page),
        computed=report.computed,
        rows=[row.plain() for row in report.rows],
    )
    result.code = SOME_FAILED if report.failed else 0
    return result
