"""The command of the shell that records: a measurement by a plan."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from struck.cli import Result
from struck.cli.options import require_alone
from struck.cli.play import device as device_of
from struck.errors import DeviceError, OptionError, RecordingError, printable
from struck.files.atomic import is_file
from struck.model.provenance import TerminalProgress
from struck.processes.termination import orderly_end

if TYPE_CHECKING:
    from struck.recordings.capture import Outcome, Recorder
    from struck.recordings.capture_plan import CapturePlan

_MAX_LISTED_FILES = 4  # files that a message names


EXAMPLES = ("plan.toml -o takes",)


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `struck record`."""
    parser.add_argument(
        "plan", nargs="?", metavar="PLAN", help="TOML file that lists the takes to record"
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="FOLDER",
        help="folder for takes and manifest; default: PLAN_takes",
    )
    parser.add_argument(
        "--device",
        help="number of the audio device, or part of its name; default: that of the plan",
    )
    parser.add_argument(
        "--list-devices", action="store_true", help="list the audio devices and exit"
    )
    parser.add_argument(
        "--simulate", metavar="FOLDER", help="read the WAV files of FOLDER instead of a device"
    )


def run(options: argparse.Namespace, progress: TerminalProgress) -> Result:
    """Run `struck record`."""
    from struck.recordings.capture import capture
    from struck.recordings.capture_plan import read_plan

    if options.list_devices:
        require_alone(options, "list_devices")
        return _devices()
    if options.plan is None:
        raise OptionError("there is nothing to record: give a plan, as `struck record plan.toml`")
    plan = read_plan(options.plan)
    folder = Path(options.output or f"{Path(options.plan).with_suffix('')}_takes")
    with orderly_end(), _recorder(plan, options) as recorder:
        operator = Terminal(progress, waits=options.simulate is None)
        outcome = capture(plan, folder, recorder, operator=operator, progress=progress)
    return _result(plan, outcome)


@contextmanager
def _recorder(plan: CapturePlan, options: argparse.Namespace) -> Iterator[Recorder]:
    from struck.recordings.capture import SimulatedRecorder

    if options.simulate is not None:
        folder = Path(options.simulate)
        _require_rehearsal(plan, folder)
        yield SimulatedRecorder(folder)
        return
    from struck.live.recorder import DeviceRecorder

    device = plan.device if options.device is None else device_of(options.device)
    with DeviceRecorder(device, channels=plan.channels, sample_rate=plan.sample_rate) as recorder:
        yield recorder


def _require_rehearsal(plan: CapturePlan, folder: Path) -> None:
    """Refuse to rehearse a plan of recordings from a folder without any of its files."""
    names = [point.file(hit) for point in plan.every() for hit in range(1, point.hits + 1)]
    if any(is_file(folder / name) for name in names):
        return
    remark = f" ... ({len(names)} in all)" if len(names) > _MAX_LISTED_FILES else ""
    raise RecordingError(
        f"{folder} has no recording that this plan could be rehearsed with: give a folder of WAV "
        f"files called {', '.join(names[:_MAX_LISTED_FILES])}{remark}"
    )


class Terminal:
    """Operator at a terminal: questions and messages on standard error, with the progress line.

    Parameters
    ----------
    progress : TerminalProgress
        Its line is cleared before questions.
    waits : bool
        Whether the Enter key is waited for.
    """

    def __init__(self, progress: TerminalProgress, *, waits: bool) -> None:
        self._progress, self._waits = progress, waits

    def ready(self, text: str) -> None:
        """Show a message, and wait for the Enter key.

        Raises
        ------
        RecordingError
            When the input has ended, so that no person can press it.
        """
        if not self._waits:
            self.tell(text)
            return
        self._progress.close()
        sys.stderr.write(f"{printable(text)}\n  press Enter, keep still, and strike at the cue ")
        sys.stderr.flush()
        if not sys.stdin.readline():
            raise RecordingError(
                "Enter was not pressed, as the input has ended: run it in a terminal, or plan "
                'hooks.strike and prompt = "never"'
            )

    def tell(self, text: str) -> None:
        """Write a line to the person at the terminal."""
        self._progress.close()
        sys.stderr.write(f"{printable(text)}\n")
        sys.stderr.flush()


def _result(plan: CapturePlan, outcome: Outcome) -> Result:
    refusal_note = f", {len(outcome.refusals)} refused" if outcome.refusals else ""
    existing_note = f" ({outcome.earlier} were there)" if outcome.earlier else ""
    return Result(
        [
            f"recorded {outcome.recorded} of {plan.count} takes{existing_note}{refusal_note}",
            f"wrote {outcome.manifest}",
        ],
        manifest=str(outcome.manifest),
        planned=plan.count,
        recorded=outcome.recorded,
        earlier=outcome.earlier,
        refusals=[asdict(refusal) for refusal in outcome.refusals],
    )


def _devices() -> Result:
    from struck.live.device import PortAudio

    with PortAudio() as portaudio:
        devices = portaudio.recorders()
    if not devices:
        raise DeviceError("no audio device can record: connect one, or start a sound server")
    lines = list(map(str, devices))
    return Result(lines, devices=lines)
