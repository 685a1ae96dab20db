"""`struck fit`: recordings of an object in, its model out."""

from __future__ import annotations

import argparse
from contextlib import suppress
from pathlib import Path

import numpy as np

import struck
from struck.cli import OnOff, Result
from struck.cli.info import describe_model, or_null
from struck.cli.options import PITCH, POSITION, add_cache, budget, length, numbers
from struck.errors import OptionError, rounded
from struck.excitation.strike import Strike
from struck.files.atomic import is_file, is_folder, real, writable
from struck.files.model_file import is_model, model_path
from struck.model.html import PAGES
from struck.model.provenance import TerminalProgress
from struck.recordings.fit import Fitting, files_read, fit_recordings
from struck.report.fit_page import save_report

_SAME = (
    *(
        "manifest",
        "symmetry",
        "centre",
        "radius",
        "interpolation",
        "method",
        "residual",
        "force",
        "cache",
    ),
    *("pitch", "geometry", "onsets"),
)


EXAMPLES = ("taps/*.wav -o mug.struck --report mug.html", "takes -o vase.struck --symmetry axial")


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `struck fit`."""
    parser.add_argument(
        "recordings", nargs="+", help="sound files, or a manifest, or the folder of a manifest"
    )
    parser.add_argument(
        "--manifest", help="TOML or CSV file with the contact and listeners of each recording"
    )
    parser.add_argument(
        "--symmetry", help="none, or axial for a body of revolution about the z axis"
    )
    parser.add_argument(
        "--centre", type=POSITION, help="acoustic centre x,y,z, m; default: the origin"
    )
    parser.add_argument(
        "--radius", type=length, default=0.0, help="radius of a sphere that encloses the body, m"
    )
    parser.add_argument("--pitch", type=PITCH, help="metres per unit of each contact coordinate")
    parser.add_argument(
        "--geometry", help="mesh file, in m, of a body of revolution about the z axis"
    )
    parser.add_argument(
        "--blow",
        type=numbers(2),
        metavar="N_S,SECONDS",
        help="impulse (N s) and duration (s) of the recorded strikes, which are deconvolved",
    )
    parser.add_argument(
        "--onsets",
        type=numbers(*range(1, 1000), form="seconds with commas between"),
        action="append",
        metavar="S,S",
        help="times of the hits in a recording, s; once for each recording; default: detected",
    )
    parser.add_argument(
        "--interpolation",
        default="field",
        help="interpolation of the gains over places: field (default) or table",
    )
    parser.add_argument(
        "--method", default="shared", help="estimator of the modes: shared (default) or corbett2007"
    )
    parser.add_argument(
        "--modes", type=budget, default=64, help="maximum number of modes, or all (default: 64)"
    )
    parser.add_argument(
        "--room", help="reverberation time T60 of the room, s, or a recording of a clap in it"
    )
    parser.add_argument(
        "--residual",
        action=OnOff,
        help="include attack and noise; default: if an auditory band would lose over 6 dB",
    )
    parser.add_argument(
        "--force",
        action="store_true",
        help="fit recordings even if they are not of a struck object",
    )
    parser.add_argument("--report", help="HTML page that compares the recordings with the model")
    add_cache(parser)
    parser.add_argument(
        "-o", "--output", help="model file; default: named after the first recording"
    )


def run(options: argparse.Namespace, progress: TerminalProgress) -> Result:
    """Run `struck fit`."""
    paths = options.recordings
    for path in filter(is_model, paths):
        raise OptionError(f"{path} is a model, not a recording of one: give sound files")
    read = files_read(paths, options.manifest)
    output = model_path(options.output or f"{_name(paths[0])}.struck", unlike=read)
    report = None
    if options.report:
        other_paths = [*read, output]
        report = writable(options.report, unlike=other_paths, endings=PAGES, kind="pages")
    fitting = fit_recordings(
        paths[0] if len(paths) == 1 else paths,
        modes=options.modes,
        room=_room(options.room),
        blow=options.blow and Strike(impulse=options.blow[0], duration=options.blow[1]),
        progress=progress,
        **{name: getattr(options, name) for name in _SAME},
    )
    struck.save(fitting.model, output)
    written = [_residual_line(fitting), f"wrote {output}, {output.stat().st_size / 1000:.0f} kB"]
    if report is not None:
        progress("writing the report", 0.0)
        save_report(fitting, report)
        written.append(f"wrote {report}")
    return _result(fitting, written, output=str(output), report=report and str(report))


def _name(recording: str) -> str:
    """Return the name for the model of a recording, a manifest, or the folder of one."""
    path = Path(recording)
    return real(path).name if is_folder(path) else path.stem


def _room(text: str | None) -> float | str | None:
    with suppress(ValueError):
        return None if text is None else float(text)
    if text is None or is_file(text):
        return text
    raise OptionError(
        f"--room {text} is neither a number nor a file: give seconds as 0.4, or a recording of a "
        "clap in the room"
    )


def _residual_line(fitting: Fitting) -> str:
    residual = fitting.model.residual
    shortfall_note = f"a band of the ear is {fitting.short:.0f} dB short at most"
    if residual is None:
        return f"without a residual (attack and noise): {shortfall_note}"
    size = f"{residual.size / 1000:.0f} kB"
    return f"with a residual (attack and noise), {size}: without it {shortfall_note}"


def _result(fitting: Fitting, written: list[str], *, output: str, report: str | None) -> Result:
    fitted = fitting.fitted
    verdict = fitted.verdict
    fraction = float(str(fitting.model.provenance.details["explained_by_one_strike"]))
    ratio = (
        f"signal to residual {verdict.signal_to_residual:.1f} dB; one strike of the model explains "
        f"{rounded(100 * fraction, 3)} % of its take's energy"
    )
    caution = [] if verdict.modal else [f"caution: {verdict.reason}"]
    return describe_model(
        fitting.model,
        [ratio, *caution, *written],
        decay_errors=or_null(fitted.decay_errors),
        of_room=None if fitting.room is None else (np.flatnonzero(fitting.room) + 1).tolist(),
        modal=verdict.modal,
        reason=verdict.reason,
        signal_to_residual=verdict.signal_to_residual,
        output=output,
        report=report,
    )
