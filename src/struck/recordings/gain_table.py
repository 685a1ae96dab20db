"""What is fitted: takes, and where each was struck and heard."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from struck.errors import OptionError, RecordingError
from struck.files.sound import Sound
from struck.model.survey import SYMMETRIES
from struck.progress import Progress, silent
from struck.recordings.manifest import KINDS, NAME, Manifest, read_manifest
from struck.recordings.takes.force import force_channels
from struck.recordings.takes.take import Take

Array = NDArray[np.float64]
Recording = str | os.PathLike[str] | Sound | Take
"""What can be fitted: a file, or samples."""
_ONE = (str, os.PathLike, Sound, Take)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recorded:
    """Takes of one object with their places.

    Parameters
    ----------
    takes : tuple of Take
    contacts : array (takes, D) or None
        Coordinates u, or u and v, of what was struck; None where nobody told.
    listeners : tuple of arrays (channels, 3) or None
        Body coordinates of the microphones of each take, m; None where nobody told. Channels that
        hold a force need none.
    coordinates : tuple of str
        Names and units of a contact's coordinates.
    centre : array (3,)
        Where the sound seems to come from, m.
    symmetry : str
        "none" or "axial", as in `Survey`.

    Raises
    ------
    OptionError
        When places do not fit the takes.
    """

    takes: tuple[Take, ...]
    contacts: Array | None = None
    listeners: tuple[Array, ...] | None = None
    coordinates: tuple[str, ...] = ()
    centre: Array = field(default_factory=lambda: np.zeros(3))
    symmetry: str = "none"

    def __post_init__(self) -> None:
        if self.symmetry not in SYMMETRIES:
            raise OptionError(f"symmetry is {self.symmetry!r}: give one of {', '.join(SYMMETRIES)}")
        if self.centre.shape != (3,) or not np.isfinite(self.centre).all():
            raise OptionError(f"centre is {self.centre.tolist()}: give x, y, z, m")
        _require_contacts(self)
        if self.listeners is not None:
            object.__setattr__(self, "listeners", tuple(_of_all_channels(self)))

    def distance(self, take: int, channel: int) -> float:
        """Return how far from the centre a channel listened, m; 1 where nobody told."""
        if self.listeners is None:
            return 1.0
        return float(np.linalg.norm(self.listeners[take][channel] - self.centre))

    @classmethod
    def of(
        cls,
        recordings: Recording | Sequence[Recording],
        *,
        contacts: ArrayLike | None = None,
        listeners: ArrayLike | Sequence[ArrayLike] | None = None,
        manifest: str | os.PathLike[str] | None = None,
        symmetry: str | None = None,
        centre: ArrayLike | None = None,
        progress: Progress = silent,
    ) -> Recorded:
        """Read recordings and gather their places; see `struck.recordings.fit.fit_recordings`.

        Raises
        ------
        OptionError
            When there is no recording, or places are given twice or do not fit.
        FileFormatError, RecordingError
            When a file cannot be read, holds nothing to fit, or has no entry in the manifest.
        """
        several = _several(recordings)
        told = _manifest(several, manifest)
        if told is None:
            takes = tuple(_taken(several, progress))
            return cls(
                takes=takes,
                contacts=None if contacts is None else _columns(contacts),
                listeners=None if listeners is None else _microphones(listeners, takes),
                coordinates=() if contacts is None else ("u", "v")[: _columns(contacts).shape[1]],
                centre=np.zeros(3) if centre is None else _numbers("centre", centre),
                symmetry=symmetry or "none",
            )
        if contacts is not None or listeners is not None:
            raise OptionError(
                f"places are given, and {told.path} tells them too: leave one of them out"
            )
        return cls._told(told, symmetry, centre, progress)

    @classmethod
    def _told(
        cls,
        manifest: Manifest,
        symmetry: str | None,
        centre: ArrayLike | None,
        progress: Progress,
    ) -> Recorded:
        contacts = np.array([entry.contact for entry in manifest.entries])
        listeners = tuple(np.array(entry.listeners) for entry in manifest.entries)
        return cls(
            takes=tuple(_taken(manifest.files, progress)),
            contacts=contacts if manifest.has_contacts else None,
            listeners=listeners if manifest.has_listeners else None,
            coordinates=manifest.coordinates or ("u", "v")[: contacts.shape[1]],
            centre=_numbers("centre", manifest.centre if centre is None else centre),
            symmetry=symmetry or manifest.symmetry,
        )


def _manifest(
    recordings: list[Recording], manifest: str | os.PathLike[str] | None
) -> Manifest | None:
    """Return the manifest that was named, or that is itself the recording, or lies in a folder."""
    if not recordings:
        raise OptionError("there are no recordings: give at least one")
    files = [each for each in recordings if isinstance(each, str | os.PathLike)]
    paths = [Path(each).resolve() for each in files]
    twice = [str(path) for path in paths if paths.count(path) > 1]
    if twice:
        raise OptionError(f"{twice[0]} is given twice, as if it were two recordings: give it once")
    if manifest is not None:
        if len(files) < len(recordings):
            raise OptionError(f"{manifest} tells of files: give recordings as paths")
        return read_manifest(manifest).chosen(files)
    if len(files) != 1 or len(recordings) != 1:
        return None
    path = Path(files[0])
    if path.is_dir():
        if not (path / NAME).is_file():
            raise RecordingError(f"{path} has no {NAME}: give its recordings one by one")
        path = path / NAME
    return read_manifest(path) if path.suffix.lower() in KINDS else None


def _taken(recordings: Sequence[Recording], progress: Progress) -> Iterator[Take]:
    for number, each in enumerate(recordings):
        progress("reading", number / len(recordings))
        if isinstance(each, Take):
            yield each
        elif isinstance(each, Sound):
            yield Take.of(each, f"recording {number + 1}")
        else:
            yield Take.load(each)
    progress("reading", 1.0)


def _several(recordings: Recording | Sequence[Recording]) -> list[Recording]:
    several = [recordings] if isinstance(recordings, _ONE) else recordings
    if not isinstance(several, Sequence) or not all(isinstance(each, _ONE) for each in several):
        raise OptionError(
            f"recordings are of type {type(recordings).__name__}: give files, or samples as "
            "struck.Sound(samples=..., sample_rate=...), one or several"
        )
    return list(several)


def _numbers(name: str, given: ArrayLike) -> Array:
    try:
        return np.asarray(given, np.float64)
    except (TypeError, ValueError) as error:
        raise OptionError(f"{name} is {given!r}: give numbers, as many for each") from error


def _columns(contacts: ArrayLike) -> Array:
    given = np.atleast_1d(_numbers("contacts", contacts))
    return given[:, None] if given.ndim == 1 else given


def _microphones(
    listeners: ArrayLike | Sequence[ArrayLike], takes: Sequence[Take]
) -> tuple[Array, ...]:
    """Return the places of each take's channels: one for all takes, or one set for each."""
    try:
        given = [np.asarray(each, np.float64) for each in listeners]  # type: ignore[union-attr] - an array or a list
    except (TypeError, ValueError) as error:
        raise OptionError(f"listeners are {listeners!r}: give x, y, z of each, m") from error
    if len(given) == 3 and all(each.ndim == 0 for each in given):
        return tuple(np.array([given]) for _ in takes)
    return tuple(each[None] if each.ndim == 1 else each for each in given)


def _require_contacts(recorded: Recorded) -> None:
    contacts, count = recorded.contacts, len(recorded.takes)
    if contacts is None:
        return
    if contacts.ndim != 2 or len(contacts) != count or contacts.shape[1] not in {1, 2}:
        raise OptionError(
            f"contacts have shape {contacts.shape}, and there are {count} recordings: give one or "
            "two coordinates for each"
        )
    if not np.isfinite(contacts).all():
        raise OptionError("a contact is not finite: give numbers")


def _of_all_channels(recorded: Recorded) -> Iterator[Array]:
    """Yield the places of each take's channels, unknown for those that hold a force."""
    listeners, takes = recorded.listeners or (), recorded.takes
    if len(listeners) != len(takes):
        raise OptionError(
            f"listeners are given for {len(listeners)} recordings of {len(takes)}: give them for "
            "each, or one place for all"
        )
    for take, places in zip(takes, listeners, strict=True):
        sounding = ~force_channels(take)
        every = np.full((take.channels, 3), np.nan)
        told = places[sounding] if len(places) == take.channels else places
        if told.shape != (np.count_nonzero(sounding), 3) or not np.isfinite(told).all():
            raise OptionError(
                f"listeners of {take.name} have shape {places.shape}, and it has "
                f"{np.count_nonzero(sounding)} microphones: give x, y, z for each, m"
            )
        every[sounding] = told
        yield every
