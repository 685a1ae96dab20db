"""Takes: recordings from files or samples, with their contacts and listeners."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from struck.errors import (
    FileFormatError,
    MissingDependencyError,
    OptionError,
    RecordingError,
    require_choice,
    rounded,
)
from struck.files import wav
from struck.files.atomic import is_file, is_folder, read_bytes, real
from struck.files.recognition import another_kind
from struck.files.sound import Sound
from struck.files.sound_formats import read_coded
from struck.model.arrays import Array, Mask, checked, numbers
from struck.model.provenance import Progress, silent
from struck.model.survey import SYMMETRIES
from struck.recordings.manifest import KINDS, NAME, Manifest, manifest_in, read_manifest

_RATES = (4000, 400_000)  # Hz
_MIN_DURATION = 0.1  # s
_MAX_VALUES = 30_000_000  # values of all channels, 11 minutes of one at 44,100 Hz: fitted in 2 GB
_TABLE = "a list of recordings, not one: give it alone, or as manifest="
_OTHERS = {
    ".csv": _TABLE,
    ".toml": _TABLE,
    ".struck": "a model, not a recording of one: give sound files",
    ".sofa": "a file of gains or responses, not a recording: give sound files",
}


@checked
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Take:
    """Samples of one or several microphones, with one hit or several.

    Parameters
    ----------
    samples : array (channels, n) or (n,)
        Samples in any unit; 1.0 is full scale of files.
    sample_rate : int
        Sample rate, Hz.
    name : str, default "the take"
        Name in messages.

    Raises
    ------
    RecordingError
        When samples are not (channels, n) finite numbers, are silent, shorter than 0.1 s or more
        than 30 million, or the rate is none that sound is recorded at.

    Examples
    --------
    >>> from struck.recordings import Take
    >>> take = Take(samples=np.random.default_rng(0).standard_normal(48_000), sample_rate=48_000)
    >>> take.samples.shape
    (1, 48000)
    """

    samples: Array
    sample_rate: int
    name: str = "the take"

    def __post_init__(self) -> None:
        _require_brief(np.size(self.samples), self.name)
        samples = np.array(self.samples, dtype=float, ndmin=2)
        object.__setattr__(self, "samples", samples)
        _require_sound(samples, self.sample_rate, self.name)
        samples.setflags(write=False)

    @classmethod
    @checked
    def of(cls, sound: Sound, name: str = "the take") -> Take:
        """Make a take of a sound.

        Parameters
        ----------
        sound : Sound
            The sound.
        name : str, default "the take"
            Name in messages.

        Returns
        -------
        Take
            The take.
        """
        return cls(samples=sound.samples.astype(float), sample_rate=sound.sample_rate, name=name)

    @classmethod
    @checked
    def load(cls, path: str | os.PathLike[str]) -> Take:
        """Read a take from a WAV, FLAC or AIFF file.

        Parameters
        ----------
        path : path
            The file.

        Returns
        -------
        Take
            The take.

        Raises
        ------
        FileFormatError
            When it cannot be read, is cut short or is no such file.
        MissingDependencyError
            When it is none of the WAV files that struck reads itself, and soundfile is missing.
        RecordingError
            When no model can come from what it holds.
        """
        samples, sample_rate = _read(Path(path))
        return cls(samples=samples, sample_rate=sample_rate, name=str(path))

    @property
    def duration(self) -> float:
        """Length of the take, s."""
        return self.samples.shape[1] / self.sample_rate

    @property
    def channels(self) -> int:
        """Number of microphones."""
        return len(self.samples)


def require_one_rate(takes: list[Take]) -> None:
    """Refuse takes of different sample rates."""
    for take in takes[1:]:
        if take.sample_rate != takes[0].sample_rate:
            raise RecordingError(
                f"{take.name} was recorded at {take.sample_rate} Hz, {takes[0].name} at "
                f"{takes[0].sample_rate}: fit them one by one, or convert one of them"
            )


def _require_brief(values: float, name: str) -> None:
    if values > _MAX_VALUES:
        raise RecordingError(
            f"{name} holds {values / 1e6:.0f} million values, and at most "
            f"{rounded(_MAX_VALUES / 1e6)} million are fitted, 11 minutes of one channel: cut its "
            "hits out of it"
        )


def _require_sound(samples: Array, sample_rate: float, name: str) -> None:
    if not _RATES[0] <= sample_rate <= _RATES[1]:
        raise RecordingError(
            f"{name} has a sample rate of {sample_rate} Hz: give one of {_RATES[0]} to {_RATES[1]}"
        )
    if samples.ndim != 2:
        raise RecordingError(f"{name} has shape {samples.shape}: give (channels, n) samples")
    if samples.shape[1] < _MIN_DURATION * sample_rate:
        raise RecordingError(
            f"{name} holds {samples.shape[1]} samples, "
            f"{rounded(samples.shape[1] / sample_rate, 3)} s: give {_MIN_DURATION} s or more, "
            "better a second"
        )
    invalid_count = np.count_nonzero(~np.isfinite(samples))
    if invalid_count:
        first = int(np.argmax(~np.isfinite(samples).all(axis=0)))
        raise RecordingError(
            f"{invalid_count} samples of {name} are not finite numbers, the first at "
            f"{first / sample_rate:.4f} s: record or export it again"
        )
    silent = [str(number) for number, channel in enumerate(samples, 1) if not np.ptp(channel)]
    if silent:
        raise RecordingError(
            f"{name} is silent in channel {', '.join(silent)}: leave the channel out, or check the "
            "microphone and record again"
        )


def _read(path: Path) -> tuple[Array, int]:
    """Return samples (C, n) and rate; plain WAV without soundfile, which accepts cut files."""
    if is_file(path):  # of 16 bits or more, before it is read
        _require_brief(path.stat().st_size / 2, str(path))
    data = read_bytes(path)
    _require_lossless(path, data[:3])
    if data[:4] != b"RIFF":
        return _read_other(path, f"{path} is no WAV file")
    try:
        recording = wav.decode(data, str(path))
    except FileFormatError as error:
        if "convert it to one of" not in str(error):
            raise
        return _read_other(path, str(error))
    return recording.samples.astype(float), recording.sample_rate


def _require_lossless(path: Path, head: bytes) -> None:
    """Refuse models, lists, gains and MP3 before a sound library looks at them."""
    kind = path.suffix.lower()
    if kind in _OTHERS:
        raise FileFormatError(f"{path} is {_OTHERS[kind]}")
    synchronised = len(head) > 1 and head[0] == 0xFF and head[1] >= 0xE0
    if kind == ".mp3" or head == b"ID3" or synchronised:
        raise FileFormatError(
            f"{path} is an MP3 file, which leaves out what rings softly: record WAV or FLAC, or "
            "convert it to one of them"
        )


def _read_other(path: Path, reason: str) -> tuple[Array, int]:
    try:
        sound = read_coded(path, "float64")
    except MissingDependencyError as error:
        raise MissingDependencyError(
            f"{reason}; to read others: pip install struck[recordings]"
        ) from error
    except FileFormatError as error:
        raise FileFormatError(f"{path}: {error}") from error
    if sound.problem:
        reason_for_refusal = another_kind(path, "sound") or (
            f"is no sound file that is read ({sound.problem}): convert it to WAV or FLAC"
        )
        raise FileFormatError(f"{path} {reason_for_refusal}")
    samples = sound.samples
    _require_brief(samples.size, str(path))
    if samples.shape[1] < sound.frames:
        raise FileFormatError(
            f"{path} is cut short: it should have {sound.frames} samples and has {samples.shape[1]}"
        )
    return samples, sound.sample_rate


_PULSE, _QUIET_TIME = 0.002, 0.1  # half of a blow, and from its peak until all is quiet again, s
_MIN_PULSE_FRACTION = 0.8  # least share of the energy in the pulse
_MAX_COPY_DIFFERENCE = 2e-6  # least difference of two microphones' sounds, of their energy
_MIN_SIGN_FRACTION = 0.8  # least share of one sign: a blow does not pull


def force_channels(take: Take) -> Mask:
    """Return which channels (C,) hold the force of a hammer: pulses of one sign; never all."""
    is_force = np.array([_is_force(channel, take.sample_rate) for channel in take.samples])
    return is_force & ~is_force.all()


def copied_channels(take: Take) -> Mask:
    """Return which channels (C,) are another one again, louder or softer, within rounding."""
    centred = take.samples - take.samples.mean(axis=1, keepdims=True)
    units = centred / np.linalg.norm(centred, axis=1, keepdims=True)
    return (np.tril(np.abs(units @ units.T), -1) > 1 - _MAX_COPY_DIFFERENCE).any(axis=1)


def left_out(take: Take) -> Mask:
    """Return which channels (C,) are without independent sound: forces, and copies of others."""
    return force_channels(take) | copied_channels(take)


def without_force(take: Take) -> Take:
    """Return a take without its force channels, and without copies of others."""
    is_idle = left_out(take)
    return replace(take, samples=take.samples[~is_idle]) if is_idle.any() else take


def _is_force(channel: Array, sample_rate: int) -> bool:
    centred = channel - np.median(channel)
    energy = centred**2
    peak = int(np.argmax(energy))
    width = round(_PULSE * sample_rate)
    first = max(0, peak - width)
    pulse, total_energy = (
        energy[first : peak + width],
        energy[first : peak + round(_QUIET_TIME * sample_rate)],
    )
    signed_energy = np.abs((np.sign(centred[first : peak + width]) * pulse).sum())
    return bool(
        pulse.sum() > _MIN_PULSE_FRACTION * total_energy.sum()
        and signed_energy > _MIN_SIGN_FRACTION * pulse.sum()
    )


Recording = str | os.PathLike[str] | Sound | Take
"""A recording that can be fitted: the path of a file, a Sound or a Take."""
_ONE = (str, os.PathLike, Sound, Take)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecordingSet:
    """Takes of one object with the places of their contacts and listeners."""

    takes: tuple[Take, ...]
    contacts: Array | None = None  # (takes, D), coordinates u or u and v; None: unknown
    listeners: tuple[Array, ...] | None = None  # (channels, 3) of each take, m; NaN: a force
    coordinates: tuple[str, ...] = ()  # names and units of a contact's coordinates
    # where the sound seems to come from, m
    centre: Array = field(default_factory=lambda: np.zeros(3))
    symmetry: str = "none"  # "none" or "axial", as in `Survey`

    def __post_init__(self) -> None:
        require_choice("symmetry", self.symmetry, SYMMETRIES)
        if self.centre.shape != (3,) or not np.isfinite(self.centre).all():
            raise OptionError(f"centre is {self.centre.tolist()}: give x, y, z, m")
        _require_contacts(self)
        if self.listeners is not None:
            object.__setattr__(self, "listeners", tuple(_positions_of_channels(self)))

    def distance(self, take: int, channel: int) -> float:
        """Return how far from the centre a channel listened, m; 1 where unknown."""
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
    ) -> RecordingSet:
        """Read recordings and their places; see `struck.recordings.fit.fit_recordings`."""
        sources = _require_several(recordings)
        takes_manifest = _find_manifest(sources, manifest)
        if takes_manifest is None:
            takes = tuple(_read_takes(sources, progress))
            return cls(
                takes=takes,
                contacts=None if contacts is None else _columns(contacts),
                listeners=None if listeners is None else _microphones(listeners, takes),
                coordinates=() if contacts is None else ("u", "v")[: _columns(contacts).shape[1]],
                centre=np.zeros(3) if centre is None else numbers("centre", centre),
                symmetry=symmetry or "none",
            )
        if contacts is not None or listeners is not None:
            raise OptionError(
                f"places are given, and {takes_manifest.path} has them too: leave one of them out"
            )
        return cls._of_manifest(takes_manifest, symmetry, centre, progress)

    @classmethod
    def _of_manifest(
        cls, manifest: Manifest, symmetry: str | None, centre: ArrayLike | None, progress: Progress
    ) -> RecordingSet:
        contacts = np.array([entry.contact for entry in manifest.entries])
        listeners = tuple(np.array(entry.listeners) for entry in manifest.entries)
        return cls(
            takes=tuple(_read_takes(manifest.files, progress)),
            contacts=contacts if manifest.has_contacts else None,
            listeners=listeners if manifest.has_listeners else None,
            coordinates=manifest.coordinates or ("u", "v")[: contacts.shape[1]],
            centre=numbers("centre", manifest.centre if centre is None else centre),
            symmetry=symmetry or manifest.symmetry,
        )


def _find_manifest(
    recordings: list[Recording], manifest: str | os.PathLike[str] | None
) -> Manifest | None:
    """Return the manifest that was named, or that is itself the recording, or lies in a folder."""
    if not recordings:
        raise OptionError("there are no recordings: give at least one")
    files = [source for source in recordings if isinstance(source, str | os.PathLike)]
    paths = [real(file) for file in files]
    repeated_paths = [str(path) for path in paths if paths.count(path) > 1]
    if repeated_paths:
        raise OptionError(
            f"{repeated_paths[0]} is given twice, as if it were two recordings: give it once"
        )
    if manifest is not None:
        if len(files) < len(recordings):
            raise OptionError(f"{manifest} lists files: give recordings as paths")
        return read_manifest(manifest).chosen(files)
    if len(files) != 1 or len(recordings) != 1:
        return None
    path = Path(files[0])
    if is_folder(path):
        folder, path = path, manifest_in(path)
        if not is_file(path):
            raise RecordingError(
                f"{folder} has no {NAME}, nor one table alone (.csv, .toml) of its takes: give its "
                "recordings one by one, or the table by manifest="
            )
    return read_manifest(path) if path.suffix.lower() in KINDS else None


def _read_takes(recordings: Sequence[Recording], progress: Progress) -> Iterator[Take]:
    for number, source in enumerate(recordings):
        progress("reading recordings", number / len(recordings))
        yield take_of(source, f"recording {number + 1}")
    progress("reading recordings", 1.0)


def take_of(recording: Recording, name: str) -> Take:
    """Return a recording as a take: itself, of a sound under this name, or read from a file."""
    if isinstance(recording, Take):
        return recording
    return Take.of(recording, name) if isinstance(recording, Sound) else Take.load(recording)


def _require_several(recordings: Recording | Sequence[Recording]) -> list[Recording]:
    sources = [recordings] if isinstance(recordings, _ONE) else recordings
    if not isinstance(sources, Sequence) or not all(isinstance(source, _ONE) for source in sources):
        raise OptionError(
            f"recordings are of type {type(recordings).__name__}: give files, or samples as "
            "struck.Sound(samples=..., sample_rate=...), one or several"
        )
    return list(sources)


def _columns(contacts: ArrayLike) -> Array:
    values = np.atleast_1d(numbers("contacts", contacts))
    return values[:, None] if values.ndim == 1 else values


def _microphones(
    listeners: ArrayLike | Sequence[ArrayLike], takes: Sequence[Take]
) -> tuple[Array, ...]:
    """Return the places of each take's channels: one place for all takes, or a set for each."""
    if not isinstance(listeners, Sequence):
        listeners = np.atleast_1d(numbers("listeners", listeners))
    points = [numbers("listeners", place) for place in listeners]
    if len(points) == 3 and all(place.ndim == 0 for place in points):
        return tuple(np.array([points]) for _ in takes)
    return tuple(place[None] if place.ndim == 1 else place for place in points)


def _require_contacts(recording_set: RecordingSet) -> None:
    contacts, count = recording_set.contacts, len(recording_set.takes)
    if contacts is None:
        return
    if contacts.ndim != 2 or len(contacts) != count or contacts.shape[1] not in {1, 2}:
        raise OptionError(
            f"contacts have shape {contacts.shape}, and there are {count} recordings: give one or "
            "two coordinates for each"
        )
    if not np.isfinite(contacts).all():
        raise OptionError("a contact is not finite: give numbers")


def _positions_of_channels(recording_set: RecordingSet) -> Iterator[Array]:
    """Yield each take's places (channels, 3), NaN for channels that hold a force."""
    listeners, takes = recording_set.listeners or (), recording_set.takes
    if len(listeners) != len(takes):
        raise OptionError(
            f"listeners are given for {len(listeners)} recordings of {len(takes)}: give them for "
            "each, or one place for all"
        )
    for take, places in zip(takes, listeners, strict=True):
        has_sound = ~left_out(take)
        positions = np.full((take.channels, 3), np.nan)
        microphones = places[has_sound] if len(places) == take.channels else places
        if (
            microphones.shape != (np.count_nonzero(has_sound), 3)
            or not np.isfinite(microphones).all()
        ):
            raise OptionError(
                f"listeners of {take.name} have shape {places.shape}, and it has "
                f"{np.count_nonzero(has_sound)} microphones: give x, y, z for each, m"
            )
        positions[has_sound] = microphones
        yield positions
