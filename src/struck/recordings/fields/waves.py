"""Sound around a body as a sum of outgoing waves."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from struck.model.waves import Law, fit_waves
from struck.recordings.fields.outgoing import ORDER, degrees, real_harmonics

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Index = NDArray[np.int64]

_ANGULAR = degrees(ORDER)[1]
# Share of the energy that waves must explain for their phases to be believed.
_EXPLAINED = 0.75


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Waves:
    """Sound around a body, relative to the arrival time r/c.

    p = sum_k r^-(k+1) sum_lm parts_klm Y_lm. Waves of degree l that solve the wave equation have
    parts up to k = l; sound whose directions are the same at all distances has k = 0 alone.
    Nearer than `limit`, distances count as that and Y_lm as r^l Y_lm.

    Parameters
    ----------
    parts : array (ORDER + 1, (ORDER + 1)^2, M), complex
    limit : float
        Distance down to which the law is trusted, m.
    levelled : array (M,), bool
        Modes that send out more lobes than there are listeners to tell: of these the levels alone
        are interpolated, with the same phase everywhere.
    """

    parts: Complex
    limit: float
    levelled: NDArray[np.bool_]

    @classmethod
    def of(
        cls,
        places: Array,
        outputs: Complex,
        weights: Array,
        wave_numbers: Array,
        *,
        radius: float = 0.0,
        mirrored: bool = False,
    ) -> Waves:
        """Fit outputs (Q, M), each counting with its weight (Q, M), at places (Q, 3).

        Parameters
        ----------
        wave_numbers : array (M,)
            rad/m.
        radius : float
            Of the body, m. The waves are trusted down to it, or to half the distance of the nearest
            listener if that is more.
        mirrored : bool
            Whether outputs are even in y.

        Notes
        -----
        See `struck.model.waves.fit_waves`. Waves and sound with the same directions
        at all distances are tried. Where both together explain less than 3/4 of the energy, what
        they make of phases would only cancel out: there levels are fitted.
        """
        distances = np.linalg.norm(places, axis=1)
        reference = float(np.exp(np.log(distances).mean()))
        same, levels = Law.same(reference), np.abs(outputs)
        laws = (same, Law.waves(reference, wave_numbers))
        waves = cls(
            parts=fit_waves(laws, places, outputs, weights, mirrored=mirrored),
            limit=max(radius, float(distances.min()) / 2),
            levelled=np.zeros(outputs.shape[1], np.bool_),
        )
        missing = (weights * np.square(np.abs(waves.at(places) - outputs))).sum(axis=0)
        levelled = missing > (1 - _EXPLAINED) * (weights * levels**2).sum(axis=0)
        parts = fit_waves((same,), places, levels + 0j, weights, mirrored=mirrored)
        return replace(waves, parts=np.where(levelled, parts, waves.parts), levelled=levelled)

    def at(self, places: Array) -> Complex:
        """Return what is heard at places (L, 3) from the centre: (L, M)."""
        return np.einsum("lkb,kbm->lm", self._seen(places), self.parts)

    def turned(self, places: Array) -> Complex:
        """Return what is heard by angular order: (L, 2 ORDER + 1, M).

        1, then cosine and sine of each: a contact at azimuth a is heard as their sum with the
        factors 1, cos a, sin a, cos 2 a, ...
        """
        seen = self._seen(places)
        sides = [0, *(side for order in range(1, ORDER + 1) for side in (order, -order))]
        heard = [
            np.einsum(
                "lkb,kbm->lm", seen[:, :, side == _ANGULAR], self.parts[:, abs(side) == _ANGULAR]
            )
            for side in sides
        ]
        return np.stack(heard, axis=1)

    def chosen(self, modes: Index, size: float, factor: float) -> Waves:
        """Return some modes of a body `size` times as large, which rings as much lower."""
        powers = size ** np.arange(1.0, ORDER + 2)[:, None, None]
        return Waves(
            parts=np.ascontiguousarray(self.parts[:, :, modes] * powers * factor),
            limit=self.limit * size,
            levelled=self.levelled[modes],
        )

    def _seen(self, places: Array) -> Array:
        """Return r^-(k+1) Y_lm at places (L, ORDER + 1, B)."""
        distances = np.maximum(np.linalg.norm(places, axis=1), self.limit)[:, None]
        harmonics = real_harmonics(places / distances, ORDER)
        return distances[:, :, None] ** -np.arange(1.0, ORDER + 2)[:, None] * harmonics[:, None]
