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
from struck.recordings.onsets import Hit, clipped, lead_in
from struck.recordings.takes import Take

_FEWEST_SAMPLES = 1024  # samples of the shortest spectrum
_ALIVE = 10.0  # decay times after which a mode is over: 87 dB down


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
        whole = fft.prev_fast_len(length >> halvings) << halvings
        return cls(
            samples=samples,
            sample_rate=sample_rate,
            noise=noise,
            rows=slice(first_row, first_row + len(samples)),
            spectra=tuple(
                SegmentSpectrum.of(samples, whole >> each, sample_rate)
                for each in range(halvings + 1)
            ),
            before=samples[:, :0] if before is None else before,
        )

    @property
    def duration(self) -> float:
        """Length of the segment, s."""
        return self.samples.shape[1] / self.sample_rate

    def levels(self, slowest: Array) -> NDArray[np.int64]:
        """Return the number of the shortest spectrum in which each mode (decays, 1/s) is over."""
        durations = np.array([each.length for each in self.spectra]) / self.sample_rate
        long_enough = durations[:, None] >= _ALIVE / slowest
        return np.maximum(long_enough.sum(axis=0) - 1, 0)

    def model(self, ringing: Exponentials) -> Array:
        """Return the sound of modes in this segment (C, n)."""
        gains = ringing.gains[self.rows]
        return samples(ringing.poles, gains, self.samples.shape[1], self.sample_rate)

    def noisier(self, left: Array, breadth: float = 100.0) -> Segment:
        """Return the segment with its noise raised to samples (C, n), as `Noise.raised` does."""
        return replace(self, noise=self.noise.raised(left, self.sample_rate, breadth))

    def later(self, time: float) -> Segment:
        """Return the segment from a time on, s."""
        rest = self.samples[:, round(time * self.sample_rate) :]
        return Segment.of(rest, self.sample_rate, self.noise, self.rows.start, self.before)

    def residual(self, ringing: Exponentials) -> Array:
        """Return the samples without the sound of these modes (C, n)."""
        return self.samples - self.model(ringing) if ringing.count else self.samples


_QUANTUM = 1e-5  # least standard deviation of noise, over the peak
_LOOKED_AT = 65536  # samples
SHORTEST, _LONGEST = 0.05, 30.0  # of a segment, s
_SPOILT = 0.05  # longest clipped beginning of a hit, s
_BLOCK = 0.05  # s
_OVER_NOISE = 2.0
_FAINT = 1e-3  # least energy of a hit over that of the loudest: -30 dB
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


def cut(
    takes: Sequence[Take], hits: Sequence[Sequence[Hit]], *, attack: bool = False
) -> list[Stretch]:
    """Cut takes at their hits and these where they are over; `attack` keeps the blow as well."""
    found = []
    for number, (take, own) in enumerate(zip(takes, hits, strict=True)):
        if not own:
            raise RecordingError(
                f"no hit was found in {take.name}: no moment at which many frequencies rise at "
                "once; record single hits after some silence, or give the times of hits by onsets="
            )
        # Of a blow with two contacts the first is left out: no free decay explains both.
        begun = [replace(h, start=h.arrival) if attack and not h.again else h for h in own]
        stretches = list(_stretches(number, take, begun))
        if not stretches:
            raise RecordingError(
                f"no hit of {take.name} rings freely for {SHORTEST} s: record single hits that "
                f"are not clipped, and on for a second or more{_ends_soon(take, begun[-1])}"
            )
        found += stretches
    return found


def _ends_soon(take: Take, hit: Hit) -> str:
    """Return after how little of its last hit a take ends, in words."""
    rest = take.samples.shape[1] - hit.start
    lasts = f"; it ends {1000 * rest / take.sample_rate:.0f} ms after its last hit: "
    why = "it is cut off there, or it breaks off and nothing was struck"
    return f"{lasts}{why}" if rest < 2 * SHORTEST * take.sample_rate else ""


def joined(stretches: Sequence[Stretch]) -> tuple[list[Segment], list[Row]]:
    """Return stretches joined to segments of one length each, and the rows of their channels."""
    alike: dict[tuple[int, int], list[Stretch]] = defaultdict(list)
    for stretch in stretches:
        alike[stretch.samples.shape[1], stretch.before.shape[1]].append(stretch)
    segments: list[Segment] = []
    rows: list[Row] = []
    for own in alike.values():
        segments.append(
            Segment.of(
                np.concatenate([each.samples for each in own]),
                own[0].sample_rate,
                Noise.joined([each.noise for each in own]),
                len(rows),
                np.concatenate([each.before for each in own]),
            )
        )
        rows += [row for each in own for row in each.rows()]
    return segments, rows


def _stretches(number: int, take: Take, hits: Sequence[Hit]) -> Iterator[Stretch]:
    before = lead_in(take, hits)
    floor = max((_QUANTUM * float(np.abs(take.samples).max())) ** 2, _step(take) ** 2 / 12)
    quiet = before if before.shape[1] else take.samples
    measure = Noise.heard_in if before.shape[1] else Noise.quietest
    noise = measure(quiet, take.sample_rate, floor)
    flat = clipped(take)
    early = round(_SPOILT * take.sample_rate)
    firsts = [take.samples[:, hit.start : min(hit.end, hit.start + early)] for hit in hits]
    loudness = [float((first**2).sum()) for first in firsts]
    for place, hit in enumerate(hits):
        if loudness[place] < _FAINT * max(loudness):
            continue
        whole = _unclipped(hit, flat, take.sample_rate)
        end = _over(take, whole, noise)
        if end - whole.start >= SHORTEST * take.sample_rate:
            yield Stretch(
                take=number,
                number=place,
                hit=whole,
                samples=take.samples[:, whole.start : end],
                noise=noise,
                before=before,
                sample_rate=take.sample_rate,
            )


def _step(take: Take) -> float:
    """Return the least difference between samples: rounding to 16 bits is noise, too."""
    middle = int(np.abs(take.samples).max(axis=0).argmax())
    values = np.unique(take.samples[:, max(0, middle - _LOOKED_AT // 8) :][:, :_LOOKED_AT])
    return float(np.diff(values).min(initial=np.inf)) if len(values) > 1 else 0.0


def _unclipped(hit: Hit, flat: NDArray[np.bool_], sample_rate: int) -> Hit:
    """Begin after the last clipped sample; leave the hit out (empty) if that is late."""
    spoilt = np.flatnonzero(flat[hit.onset : hit.end])
    if not len(spoilt):
        return hit
    last = int(spoilt[-1])
    start = hit.onset + last + 1 if last < _SPOILT * sample_rate else hit.end
    return replace(hit, start=max(hit.start, start))


def _over(take: Take, hit: Hit, noise: Noise) -> int:
    """Return where a hit is over: twice as late as it falls into the noise, on a coarse grid."""
    size = round(_BLOCK * take.sample_rate)
    end = min(hit.end, hit.start + round(_LONGEST * take.sample_rate))
    count = (end - hit.start) // size
    if count < 1:
        return hit.start
    blocks = take.samples[:, hit.start : hit.start + count * size].reshape(-1, count, size)
    loud = ((blocks**2).sum(axis=2) > _OVER_NOISE * noise.energy(size)[:, None]).any(axis=0)
    last = count - int(np.argmax(loud[::-1])) if loud.any() else 0
    end = min(end, hit.start + 2 * (last + 1) * size)
    grid = take.sample_rate / _GRID
    return hit.start + int(int((end - hit.start) / grid) * grid)
