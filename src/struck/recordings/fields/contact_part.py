"""Contact parts between the places that were struck: Gaussian processes over u, or u and v."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from struck.errors import ContactError
from struck.recordings.fields.evidence import shares

Array = NDArray[np.float64]
Index = NDArray[np.int64]

LENGTHS = (0.15, 0.2, 0.25, 0.35, 0.5, 0.7, 1.0, 1.5, 2.5)
"""Distances over which shapes may stay alike, as shares of the range of a coordinate."""
_NOISES = (1e-8, 1.0)  # the least keeps what is known twice over solvable
SNAP = 0.02
"""Share of its range by which a coordinate may lie outside of it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ContactPart:
    """Real, signed drives over contact coordinates.

    Parameters
    ----------
    lowest, spans : array (D,)
        Where coordinates begin, and how far they range.
    contacts : array (P, D)
        Places that were struck, from 0 to 1 in each coordinate.
    factors : array (K, P, M)
        For each length, what the likeness to each contact counts for.
    """

    lowest: Array
    spans: Array
    contacts: Array
    factors: Array

    @classmethod
    def of(cls, contacts: Array, drives: Array, errors: Array) -> ContactPart:
        """Fit drives (P, M) at contacts (P, D), with errors (M,) over their root mean squares.

        Notes
        -----
        A Gaussian process with a squared-exponential kernel of unknown scale, averaged over its
        lengths by their evidence (C. E. Rasmussen and C. K. I. Williams, Gaussian
        Processes for Machine Learning, MIT Press, 2006, chapters 2 and 5).
        """
        lowest = contacts.min(axis=0)
        spans = np.ptp(contacts, axis=0)
        places = (contacts - lowest) / np.where(spans > 0, spans, 1.0)
        kernels = _likenesses(places, places).transpose(1, 0, 2)
        noises = np.clip(np.square(errors), *_NOISES)
        fits = [_fit(kernel, drives, noises) for kernel in kernels]
        believed = shares(np.stack([evidence for evidence, _ in fits]))
        return cls(
            lowest=lowest,
            spans=spans,
            contacts=places,
            factors=np.stack([factors for _, factors in fits]) * believed[:, None],
        )

    def at(self, points: Array) -> Array:
        """Return drives (K, M) at points (K, D).

        Raises
        ------
        ContactError
            Where a coordinate lies farther outside of its range than 2 % of it.
        """
        self._require_inside(points)
        places = np.clip((points - self.lowest) / np.where(self.spans > 0, self.spans, 1.0), 0, 1)
        return np.einsum("knp,npm->km", _likenesses(places, self.contacts), self.factors)

    def chosen(self, modes: Index, factor: float = 1.0) -> ContactPart:
        """Return the drives of some modes, times a factor."""
        return replace(self, factors=np.ascontiguousarray(self.factors[:, :, modes] * factor))

    def _require_inside(self, points: Array) -> None:
        highest, reach = self.lowest + self.spans, SNAP * self.spans
        outside = (points < self.lowest - reach) | (points > highest + reach)
        if np.isnan(points).any() or outside.any():
            wrong = points[np.argmax(outside.any(axis=1))]
            nearest = np.clip(wrong, self.lowest, highest)
            raise ContactError(
                f"the contact {wrong.tolist()} lies outside of what was recorded: the nearest is "
                f"{nearest.tolist()}"
            )


def _likenesses(some: Array, others: Array) -> Array:
    """Return the kernels exp(-distance^2 / (2 length^2)) of all lengths (K, lengths, P)."""
    squares = np.square(some[:, None] - others).sum(axis=2)
    return np.exp(-squares[:, None] / (2 * np.square(LENGTHS)[:, None]))


def _fit(kernel: Array, drives: Array, noises: Array) -> tuple[Array, Array]:
    """Return evidence (M,) and factors (P, M) for noises (M,), the scale left free."""
    powers, vectors = np.linalg.eigh(kernel)
    seen = vectors.T @ drives
    variances = np.maximum(powers, 0.0)[:, None] + noises
    quadratic = np.maximum((np.square(seen) / variances).sum(axis=0), np.finfo(np.float64).tiny)
    evidence = -0.5 * (len(drives) * np.log(quadratic) + np.log(variances).sum(axis=0))
    return evidence, vectors @ (seen / variances)
