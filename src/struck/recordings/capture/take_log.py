"""What a measurement has recorded so far: takes and their manifest, each written whole."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from struck.errors import FileFormatError, RecordingError
from struck.files import wav
from struck.files.atomic import write_bytes
from struck.files.sound import Sound
from struck.recordings.acceptance import Verdict
from struck.recordings.capture_plan import CapturePlan, Point
from struck.recordings.manifest import NAME, recorded_so_far
from struck.recordings.manifests.entries import Entry


class TakeLog:
    """A folder of takes with a manifest, from an earlier run or new.

    Parameters
    ----------
    plan : CapturePlan
    folder : Path
        Made if only its last part is missing.

    Raises
    ------
    FileFormatError
        When the folder cannot be made, or its manifest cannot be read.
    RecordingError
        When it holds takes of another rate.
    """

    def __init__(self, plan: CapturePlan, folder: Path) -> None:
        _make(folder)
        self._plan = plan
        self._manifest = recorded_so_far(folder / NAME)
        if plan.sample_rate is not None:
            self._require_rate(plan.sample_rate)

    @property
    def path(self) -> Path:
        """The manifest."""
        return self._manifest.path

    def has(self, point: Point, hit: int) -> bool:
        """Tell whether a take is there.

        Raises
        ------
        RecordingError
            When its name is there, but of other places.
        """
        entry = self._entry(point.file(hit))
        if entry is None:
            return False
        if (entry.contact, entry.listeners) != (point.contact, point.listeners):
            raise RecordingError(
                f"{self.path} has {entry.file} with contact {entry.contact} and listeners "
                f"{entry.listeners}, and the plan says {point.contact} and {point.listeners}: name "
                "the places in the plan, or record into another folder"
            )
        return True

    def add(self, point: Point, hit: int, verdict: Verdict) -> None:
        """Write a take that was taken, then the manifest: a kill leaves both whole.

        Raises
        ------
        FileFormatError
            When they cannot be written.
        """
        sound = verdict.sound
        if sound is None:
            raise RecordingError(f"{point.file(hit)} was refused: {verdict.reason}")
        self._require_rate(sound.sample_rate)
        data = wav.encode(wav.Recording(samples=sound.samples, sample_rate=sound.sample_rate))
        write_bytes(self.path.with_name(point.file(hit)), data)
        entry = Entry(
            file=point.file(hit),
            contact=point.contact,
            listeners=point.listeners,
            hit=hit,
            sample_rate=sound.sample_rate,
            lead_in=self._plan.lead_in,
            peak=round(verdict.peak, 2),
            above_noise=round(verdict.above_noise, 2),
        )
        self._write((*self._others(entry.file), entry))

    def sounds(self, point: Point) -> list[Sound]:
        """Return the takes of a point."""
        paths = [self.path.with_name(point.file(hit)) for hit in range(1, point.hits + 1)]
        heard = [wav.decode(path.read_bytes(), str(path)) for path in paths]
        return [Sound(samples=each.samples, sample_rate=each.sample_rate) for each in heard]

    def _entry(self, file: str) -> Entry | None:
        return next((entry for entry in self._manifest.entries if entry.file == file), None)

    def _others(self, file: str) -> tuple[Entry, ...]:
        return tuple(entry for entry in self._manifest.entries if entry.file != file)

    def _write(self, entries: tuple[Entry, ...]) -> None:
        plan = self._plan
        self._manifest = replace(
            self._manifest,
            entries=entries,
            symmetry=plan.symmetry,
            centre=plan.centre,
            coordinates=plan.coordinates,
        )
        write_bytes(self.path, self._manifest.text().encode("utf-8"))

    def _require_rate(self, rate: int) -> None:
        known = {entry.sample_rate for entry in self._manifest.entries} - {None, rate}
        if known:
            raise RecordingError(
                f"{self.path} has takes of {known.pop()} Hz, and now {rate} Hz are recorded: give "
                "that sample_rate in the plan, or record into another folder"
            )


def _make(folder: Path) -> None:
    try:
        folder.mkdir(exist_ok=True)
    except FileNotFoundError as error:
        raise FileFormatError(f"there is no folder {folder.parent}: make it first") from error
    except OSError as error:
        raise FileFormatError(
            f"the folder {folder} cannot be made ({error.strerror or error}): give another"
        ) from error
