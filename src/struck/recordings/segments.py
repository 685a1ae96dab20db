"""Segments: the stretches of takes in which the object rings freely, one for each hit."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from struck.errors import RecordingError
from struck.model.arrays import Array
from struck.model.exponentials import Exponentials, SegmentSpectrum, samples
from struck.recordings.noise import Noise
from struck.recordings.onsets import Hit, find_clipped, lead_in
from struck.recordings.takes import Take

_FEWEST_SAMPLES = 1024  # samples of the shortest spectrum
_RINGING_TIMES = 10.0  # decay times after which a mode is over: 87 dB down


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Segment:
    """Channels of one length that ring freely from their first sample on, with their spectra."""

    samples: Array  # (C, n)
    sample_rate: float  # Hz
    noise: Noise
    rows: slice  # where its gains stand among those of all segments
    # of all samples, of the first half, of the first quarter ...
    spectra: tuple[SegmentSpectrum, ...]
    before: Array  # (C, m), ambient sound before anything was struck; m may be 0

    @classmethod
    def of(
        cls,
        samples: Array,
        sample_rate: float,
        noise: Noise,
        first_row: int = 0,
        before: Array | None = None,
    ) -> Segment:
        """Return the segment of samples (C, n), with its transform."""
        length = samples.shape[1]
        halvings = max(0, int(np.log2(max(length / _FEWEST_SAMPLES, 1))))
        # No large prime factors: transforms take an eighth of the time.
        fast_length = fft.prev_fast_len(length >> halvings) << halvings
        return cls(
            samples=samples,
            sample_rate=sample_rate,
            noise=noise,
            rows=slice(first_row, first_row + len(samples)),
            spectra=tuple(
                SegmentSpectrum.of(samples, fast_length >> halving, sample_rate)
                for halving in range(halvings + 1)
            ),
            before=samples[:, :0] if before is None else before,
        )

    @property
    def duration(self) -> float:
        """Length of the segment, s."""
        return self.samples.shape[1] / self.sample_rate

    def levels(self, min_decays: Array) -> NDArray[np.int64]:
        """Return the number of the shortest spectrum in which each mode (decays, 1/s) is over."""
        durations = np.array([spectrum.length for spectrum in self.spectra]) / self.sample_rate
        is_long_enough = durations[:, None] >= _RINGING_TIMES / min_decays
        return np.maximum(is_long_enough.sum(axis=0) - 1, 0)

    def model(self, ringing: Exponentials) -> Array:
        """Return the sound of modes in this segment (C, n)."""
        gains = ringing.gains[self.rows]
        return samples(ringing.poles, gains, self.samples.shape[1], self.sample_rate)

    def noisier(self, left: Array, breadth: float = 100.0) -> Segment:
        """Return the segment with its noise raised to samples (C, n), as `Noise.raised` does."""
        return replace(self, noise=self.noise.raised(left, self.sample_rate, breadth))

    def later(self, time: float) -> Segment:
        """Return the segment from a time on, s."""
        later_samples = self.samples[:, round(time * self.sample_rate) :]
        return Segment.of(later_samples, self.sample_rate, self.noise, self.rows.start, self.before)

    def residual(self, ringing: Exponentials) -> Array:
        """Return the samples without the sound of these modes (C, n)."""
        return self.samples - self.model(ringing) if ringing.count else self.samples


_QUANTUM = 1e-5  # least standard deviation of noise, over the peak
_STEP_SAMPLES = 65536  # samples
MIN_DURATION, _MAX_DURATION = 0.05, 30.0  # of a segment, s
_MAX_CLIPPED_TIME = 0.05  # longest clipped beginning of a hit, s
_BLOCK = 0.05  # s
_OVER_NOISE = 2.0
_MIN_HIT_RATIO = 1e-3  # least energy of a hit over that of the loudest: -30 dB
_GRID = 32  # lengths are multiples of 1 / this, s: equal ones are transformed together


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """The take, hit and channel of a row of gains, each counted from 0."""

    take: int
    hit: int
    channel: int
    onset: float  # beginning of the hit, s in the take
    time: float  # moment of the gains, s in the take


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stretch:
    """One hit cut out of a take, with its noise."""

    take: int  # its number
    number: int  # of the hit in the take
    hit: Hit
    samples: Array  # (C, n)
    noise: Noise
    before: Array  # (C, m), ambient sound before the first hit
    sample_rate: int  # Hz

    def rows(self) -> Iterator[Row]:
        """Yield the rows of a segment's channels."""
        onset, time = self.hit.onset / self.sample_rate, self.hit.start / self.sample_rate
        for channel in range(len(self.samples)):
            yield Row(take=self.take, hit=self.number, channel=channel, onset=onset, time=time)


def cut_takes(
    takes: Sequence[Take], hits: Sequence[Sequence[Hit]], *, attack: bool = False
) -> list[Stretch]:
    """Cut takes at their hits and these where they are over; `attack` keeps the blow as well."""
    all_stretches = []
    for number, (take, take_hits) in enumerate(zip(takes, hits, strict=True)):
        if not take_hits:
            raise RecordingError(
                f"no hit was found in {take.name}: no moment at which many frequencies rise at "
                "once; record single hits after some silence, or give the times of hits by onsets="
            )
        # The first of two contacts of a blow is left out: no free decay explains both.
        starting_hits = [
            replace(h, start=h.arrival) if attack and not h.again else h for h in take_hits
        ]
        stretches = list(_stretches(number, take, starting_hits))
        if not stretches:
            raise RecordingError(
                f"no hit of {take.name} rings freely for {MIN_DURATION} s: record single hits that "
                f"are not clipped, and on for a second or more{_ends_soon(take, starting_hits[-1])}"
            )
        all_stretches += stretches
    return all_stretches


def _ends_soon(take: Take, hit: Hit) -> str:
    """Return after how little of its last hit a take ends, in words."""
    samples_left = take.samples.shape[1] - hit.start
    text = f"; it ends {1000 * samples_left / take.sample_rate:.0f} ms after its last hit: "
    reason = "it is cut off there, or it breaks off and nothing was struck"
    return f"{text}{reason}" if samples_left < 2 * MIN_DURATION * take.sample_rate else ""


def join_stretches(stretches: Sequence[Stretch]) -> tuple[list[Segment], list[Row]]:
    """Return stretches joined to segments of one length each, and the rows of their channels."""
    groups: dict[tuple[int, int], list[Stretch]] = defaultdict(list)
    for stretch in stretches:
        groups[stretch.samples.shape[1], stretch.before.shape[1]].append(stretch)
    segments: list[Segment] = []
    rows: list[Row] = []
    for group in groups.values():
        segments.append(
            Segment.of(
                np.concatenate([member.samples for member in group]),
                group[0].sample_rate,
                Noise.joined([member.noise for member in group]),
                len(rows),
                np.concatenate([member.before for member in group]),
            )
        )
        rows += [row for member in group for row in member.rows()]
    return segments, rows


def _stretches(number: int, take: Take, hits: Sequence[Hit]) -> Iterator[Stretch]:
    lead_in_samples = lead_in(take, hits)
    floor = max((_QUANTUM * float(np.abs(take.samples).max())) ** 2, _step(take) ** 2 / 12)
    ambient_samples = lead_in_samples if lead_in_samples.shape[1] else take.samples
    measure = Noise.heard_in if lead_in_samples.shape[1] else Noise.quietest
    noise = measure(ambient_samples, take.sample_rate, floor)
    is_clipped = find_clipped(take)
    max_clipped_length = round(_MAX_CLIPPED_TIME * take.sample_rate)
    firsts = [
        take.samples[:, hit.start : min(hit.end, hit.start + max_clipped_length)] for hit in hits
    ]
    loudness = [float((first**2).sum()) for first in firsts]
    for place, hit in enumerate(hits):
        if loudness[place] < _MIN_HIT_RATIO * max(loudness):
            continue
        unclipped_hit = _skip_clipping(hit, is_clipped, take.sample_rate)
        end = _find_end(take, unclipped_hit, noise)
        if end - unclipped_hit.start >= MIN_DURATION * take.sample_rate:
            yield Stretch(
                take=number,
                number=place,
                hit=unclipped_hit,
                samples=take.samples[:, unclipped_hit.start : end],
                noise=noise,
                before=lead_in_samples,
                sample_rate=take.sample_rate,
            )


def _step(take: Take) -> float:
    """Return the least difference between samples: rounding to 16 bits is noise, too."""
    loudest_sample = int(np.abs(take.samples).max(axis=0).argmax())
    values = np.unique(
        take.samples[:, max(0, loudest_sample - _STEP_SAMPLES // 8) :][:, :_STEP_SAMPLES]
    )
    return float(np.diff(values).min(initial=np.inf)) if len(values) > 1 else 0.0


def _skip_clipping(hit: Hit, flat: NDArray[np.bool_], sample_rate: int) -> Hit:
    """Begin after the last clipped sample; leave the hit out (empty) if that is late."""
    clipped_samples = np.flatnonzero(flat[hit.onset : hit.end])
    if not len(clipped_samples):
        return hit
    last = int(clipped_samples[-1])
    start = hit.onset + last + 1 if last < _MAX_CLIPPED_TIME * sample_rate else hit.end
    return replace(hit, start=max(hit.start, start))


def _find_end(take: Take, hit: Hit, noise: Noise) -> int:
    """Return where a hit is over: twice as late as it falls into the noise, on a coarse grid."""
    size = round(_BLOCK * take.sample_rate)
    end = min(hit.end, hit.start + round(_MAX_DURATION * take.sample_rate))
    count = (end - hit.start) // size
    if count < 1:
        return hit.start
    blocks = take.samples[:, hit.start : hit.start + count * size].reshape(-1, count, size)
    is_loud = ((blocks**2).sum(axis=2) > _OVER_NOISE * noise.energy(size)[:, None]).any(axis=0)
    last = count - int(np.argmax(is_loud[::-1])) if is_loud.any() else 0
    end = min(end, hit.start + 2 * (last + 1) * size)
    grid = take.sample_rate / _GRID
    return hit.start + int(int((end - hit.start) / grid) * grid)
