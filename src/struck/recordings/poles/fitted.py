"""What a fit of shared poles found, with how far it may be off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.model.exponentials import Ringing, samples
from struck.recordings.poles.ambient import ambient
from struck.recordings.poles.selection import energies
from struck.recordings.poles.uncertainty import standard_errors
from struck.recordings.poles.verdict import Verdict
from struck.recordings.segments import Row
from struck.recordings.takes.segment import Segment

Array = NDArray[np.float64]
Complex = NDArray[np.complexfloating]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

_CLEAR = 40.0
"""Energy of a mode that is measured, over that of the noise in a bin."""
CLEAR = 10 * np.log10(2 * _CLEAR)
"""The same over the noise's energy in a sample, dB."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fitted:
    """Modes fitted to recordings.

    Parameters
    ----------
    frequencies : array (M,)
        Ringing frequencies, ascending, Hz.
    decays : array (M,)
        Amplitude decay rates, 1/s.
    gains : array (rows, M), complex
        A row sounds as Im[g exp((-d + 2 pi i f) t)] from its time on, in the unit of the samples,
        without what still rings of earlier hits.
    frequency_errors, decay_errors : array (M,)
        Standard errors, Hz and 1/s.
    gain_errors : array (rows, M)
        Standard errors of the gains' sizes.
    rows : tuple of Row
        What each row of gains belongs to, in order of takes, hits and channels.
    segments : tuple of Segment
        What was fitted.
    heard : Ringing
        All that rings in the segments: earlier hits and tones of the surroundings too.
    order : array (rows,)
        Which row of `heard` each row is.
    verdict : Verdict
        Whether it is the sound of a struck object.
    notes : tuple of str
        What a person should know: what is wrong with the takes, and what was left out.
    """

    frequencies: Array
    decays: Array
    gains: Complex
    frequency_errors: Array
    decay_errors: Array
    gain_errors: Array
    rows: tuple[Row, ...]
    segments: tuple[Segment, ...]
    heard: Ringing
    order: Index
    verdict: Verdict
    notes: tuple[str, ...] = ()

    def heard_in(self, row: int) -> tuple[Array, Array]:
        """Return samples (n,) of one row from its time on: as recorded, and what was fitted."""
        segment, channel = self._segment(row)
        original = segment.samples[channel]
        return original, self.ringing(row, self.rows[row].time, len(original))

    def ringing(self, row: int, time: float, length: int) -> Array:
        """Return what was fitted to a row, from a time of its take on, s, also backwards (n,)."""
        segment, _ = self._segment(row)
        poles, gains = self.heard.poles, self.heard.gains[self.order[row]]
        shifted = gains * np.exp(poles * (time - self.rows[row].time))
        return samples(poles, shifted[None], length, segment.sample_rate)[0]

    def noise_in(self, row: int, edges: Array) -> Array:
        """Return the power of the noise of one row in bands (B,) between edges (B + 1,), Hz."""
        segment, channel = self._segment(row)
        middles = np.sqrt(edges[1:] * edges[:-1])
        density = segment.noise.at(middles)[channel]
        return density * 2 * np.diff(edges) / segment.sample_rate

    def _segment(self, row: int) -> tuple[Segment, int]:
        place = int(self.order[row])
        segment = next(each for each in self.segments if place < each.rows.stop)
        return segment, place - segment.rows.start


def fitted_of(
    segments: list[Segment],
    rows: list[Row],
    heard: Ringing,
    verdict: Verdict,
    notes: list[str],
    *,
    measured: bool = False,
) -> Fitted:
    """Return a fit with its errors, tones of the surroundings and earlier hits taken off.

    Where modes are to be `measured`, those that are hardly there are left out, too.
    """
    surrounding = ambient(segments, heard)
    errors = standard_errors(segments, heard)
    weak = _weak(segments, heard) & ~surrounding if measured else np.zeros_like(surrounding)
    if surrounding.any():
        tones = ", ".join(f"{each:.1f}" for each in heard.frequencies[surrounding])
        notes = [*notes, f"tones of the surroundings, left out of the model: {tones} Hz"]
    if weak.any():
        lost = ", ".join(f"{each:.1f}" for each in heard.frequencies[weak])
        notes = [*notes, f"too weak to be measured, left out of the model: {lost} Hz"]
    kept = ~(surrounding | weak)
    endless = np.count_nonzero((errors.decays > heard.decays) & kept)
    if endless:
        notes = [*notes, f"{endless} modes ring for longer than the takes can tell: record longer"]
    own = heard.of(kept)
    order = np.array(sorted(range(len(rows)), key=lambda row: (rows[row].take, rows[row].hit, row)))
    ordered = [rows[row] for row in order]
    return Fitted(
        frequencies=own.frequencies,
        decays=own.decays,
        gains=_without_earlier(own.gains[order], own.poles, ordered),
        frequency_errors=errors.frequencies[kept],
        decay_errors=errors.decays[kept],
        gain_errors=errors.gains[order][:, kept],
        rows=tuple(ordered),
        segments=tuple(segments),
        heard=heard,
        order=order,
        verdict=verdict,
        notes=tuple(notes),
    )


def _weak(segments: list[Segment], heard: Ringing) -> Mask:
    """Return the modes of which hardly more is known than that something is there.

    At an energy E over noise a decay rate is known to sqrt(2 / E) of itself at best: 22 %. Whether
    it is one mode or two nobody can tell.
    """
    alone, share = energies(segments, heard)
    return alone < _CLEAR * share


def _without_earlier(gains: Complex, poles: Complex, rows: list[Row]) -> Complex:
    """Take off each hit's gains what the hit before has left ringing."""
    own = gains.copy()
    last: dict[tuple[int, int], int] = {}
    for row, what in enumerate(rows):
        earlier = last.get((what.take, what.channel))
        if earlier is not None:
            own[row] -= gains[earlier] * np.exp(poles * (what.time - rows[earlier].time))
        last[what.take, what.channel] = row
    return own
