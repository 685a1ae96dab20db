"""A group of modes against the bins that hold it: linear gains, energies, normal equations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.recordings.takes.ringing import Ringing, Spectrum
from struck.recordings.takes.segment import Segment

Array = NDArray[np.float64]
Complex = NDArray[np.complexfloating]
Index = NDArray[np.int64]

_BINS = 16
_WIDTHS = 8.0
"""A mode is fitted within so many bins or half widths d / 2 pi of its frequency."""


_INDEPENDENT = 1e-4
_CHANCE = 3.0
"""Standard deviations of the mean energy that a bin of noise leaves."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Block:
    """Bins of a spectrum cleared of all modes but those of one group.

    Parameters
    ----------
    spectrum : Spectrum
        Where the bins come from.
    bins : array (K,), int
        Which.
    data : array (K, C), complex
        The transforms there.
    weights : array (C,)
        One over the noise's energy in a bin.
    rows : slice
        Where the channels' gains stand.
    """

    spectrum: Spectrum
    bins: Index
    data: Complex
    weights: Array
    rows: slice

    @classmethod
    def cleared(cls, segment: Segment, ringing: Ringing, group: Index) -> Block:
        """Take all other modes off the bins around a group."""
        own, others = ringing.of(group), ringing.of(_without(group, ringing.count))
        block = cls.around(segment, own)
        gains = ringing.gains[segment.rows]
        data = block.spectrum.values[block.bins]
        data = data - block.spectrum.at(block.bins, others, others.gains[segment.rows])
        data -= block.spectrum.mirrored(block.bins, own.poles, gains[:, group])
        return cls(
            spectrum=block.spectrum,
            bins=block.bins,
            data=data,
            weights=block.weights,
            rows=block.rows,
        )

    @classmethod
    def around(cls, segment: Segment, group: Ringing) -> Block:
        """Choose bins around the modes of a group; the data are left out."""
        spectrum = segment.spectrum(group.decays.min())
        reach = np.maximum(_BINS * spectrum.spacing, _WIDTHS * group.decays / (2 * np.pi))
        density = segment.noise.at(group.frequencies.mean())
        return cls(
            spectrum=spectrum,
            bins=spectrum.near(group.poles, reach),
            data=np.zeros((0, len(density)), complex),
            weights=1 / (density * spectrum.length),
            rows=segment.rows,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Projection:
    """Data split into what the modes explain and the rest.

    Parameters
    ----------
    block : Block
        The data.
    lines : array (K, M), complex
        Transforms of the modes.
    basis, triangle : arrays (K, M) and (M, M), complex
        Their QR factors.
    residues : array (M, C), complex
        Least-squares factors of the lines.
    left : array (K, C), complex
        What they leave of the data.
    """

    block: Block
    lines: Complex
    basis: Complex
    triangle: Complex
    residues: Complex
    left: Complex

    @classmethod
    def of(cls, block: Block, poles: Complex) -> Projection:
        """Fit the lines of some poles to a block."""
        lines = block.spectrum.lines(block.bins, poles)
        basis, triangle = _factors(lines)
        parts = basis.conj().T @ block.data
        return cls(
            block=block,
            lines=lines,
            basis=basis,
            triangle=triangle,
            residues=np.linalg.solve(triangle, parts),
            left=block.data - basis @ parts,
        )

    @property
    def cost(self) -> float:
        """Energy left, in units of the noise's in one bin."""
        return float(self.block.weights @ (np.abs(self.left) ** 2).sum(axis=0))

    def normal_equations(self) -> tuple[Complex, Complex]:
        """Return matrix (M, M) and right side (M,) for steps of the poles, gains eliminated.

        Variable projection with Kaufman's derivative: the slopes of the lines, less what the
        lines themselves explain of them, times the residues. Summed over the channels this is an
        elementwise product, so their number costs next to nothing.
        """
        slopes = (self.lines * self.lines - self.lines) / self.block.spectrum.sample_rate
        slopes -= self.basis @ (self.basis.conj().T @ slopes)
        weighted = self.residues.conj() * self.block.weights
        matrix = (slopes.conj().T @ slopes) * (weighted @ self.residues.T)
        return matrix, ((slopes.conj().T @ self.left) * weighted).sum(axis=1)


def unique(block: Block, group: Ringing) -> tuple[Array, Array]:
    """Return the energies that only one mode explains, and their shares of its whole energy.

    Parameters
    ----------
    block : Block
        Bins around the group.
    group : Ringing
        M modes.

    Returns
    -------
    energies : array (M,)
        What the fit would lose without the mode, all others fitted anew, in units of the noise's
        energy in a bin, summed over channels.
    shares : array (M,)
        1 for a mode that no other overlaps.
    """
    lines = block.spectrum.lines(block.bins, group.poles)
    _, triangle = _factors(lines)
    inverse = np.linalg.inv(triangle)
    alone = 1 / (np.abs(inverse) ** 2).sum(axis=1)
    residues = block.spectrum.residues(group.poles, group.gains[block.rows])
    energies = block.weights @ np.abs(residues) ** 2
    return energies * alone, alone / (np.abs(lines) ** 2).sum(axis=0)


def misfit(projections: Sequence[Projection]) -> float:
    """Return the energy left a bin and channel, noise being 1; 1 where chance may explain it."""
    unknowns = sum(each.residues.size for each in projections) + len(projections[0].residues)
    values = max(sum(each.left.size for each in projections) - unknowns, 1)
    left = sum(each.cost for each in projections) / values
    return left if left > 1 + _CHANCE / np.sqrt(values) else 1.0


def _factors(lines: Complex) -> tuple[Complex, Complex]:
    """Return QR factors, the second never singular.

    By Cholesky's factor of the Gram matrix, several times as fast as reflections, where the lines
    are independent enough to keep half the digits.
    """
    sizes = np.sqrt((lines.real**2 + lines.imag**2).sum(axis=0))
    unit = lines / sizes
    gram = unit.conj().T @ unit
    try:
        triangle = np.linalg.cholesky(gram, upper=True)
    except np.linalg.LinAlgError:
        triangle = np.zeros_like(gram)
    if np.abs(np.diag(triangle)).min() > _INDEPENDENT:
        basis = unit @ np.linalg.inv(triangle)
    else:
        basis, triangle = np.linalg.qr(unit)
        triangle = triangle + 1e-14 * np.eye(len(triangle))
    return basis, triangle * sizes


def _without(group: Index, count: int) -> Index:
    others = np.ones(count, bool)
    others[group] = False
    return np.flatnonzero(others)
