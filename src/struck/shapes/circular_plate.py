"""Circular plates: free, supported or clamped around (1998, section 6)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from struck.errors import require_choice
from struck.model.arrays import Array, Index, checked
from struck.model.material import Material
from struck.shapes.bessel import (
    Function,
    edge_values,
    find_enclosed_roots,
    require_counts,
    separators,
    zeros_below,
)
from struck.shapes.circular_membrane import RoundForms, expand_pairs
from struck.shapes.shape import (
    Counterpart,
    Shape,
    Vibration,
    plate_overestimate,
    require_clamped_or_free,
    require_countable,
    thinness,
)
from struck.shapes.skins import Disk, Sheet
from struck.solids import Tube
from struck.solids.resolution import require_length

EDGES = ("free", "supported", "clamped")

# Waves along a free rim have at least 0.98 of the number of those around it (Konenkov 1960).
_RIM_WAVE = 0.9
# Phases, over pi, past the k-th root, after which the next cannot be missed.
_CLAMPED_PHASE, _SUPPORTED_PHASE = 0.4, 1.2
_COARSE_PRECISION = 1e-7


def plate_roots(edge: str, max_root: float, poisson_ratio: float) -> Array:
    """Return lambda (M, K) up to `max_root` of a plate with m nodal diameters, infinity beyond.

    Rows of a free plate with m below 2 begin with infinity: rigid motions are left out. The ratio
    of a load on the edge to its displacement falls, or rises, with lambda between its poles, by
    Green's identity, however the edge is held otherwise. So the roots of plates that differ by one
    constraint alternate strictly. Seen from the zeros j(m, k) of J_m, which belong to an edge with
    w = 0 and no Laplacian of w:

    - clamped: one root between j(m, k) and j(m, k + 1);
    - supported: one root between j(m, k) and j(m, k + 1), and one below j(m, 1);
    - free: one root between successive roots of the supported plate, and, with two or more nodal
      diameters, one below them all.

    The signs at `max_root` decide how many there are below.
    """
    orders = np.arange(int(max_root / _RIM_WAVE) + 2, dtype=float)
    root_counts = zeros_below(orders, max_root)
    if edge == "clamped":
        places = separators(orders, max_root, _CLAMPED_PHASE)
        roots = find_enclosed_roots(clamped_edge, places, max_root)
        require_counts(roots, _counts(clamped_edge, max_root, root_counts - 1, 1))
        return roots

    def hinge(m: Array, x: Array) -> Array:
        return supported_edge(m, x, poisson_ratio)

    def rim(m: Array, x: Array) -> Array:
        return free_edge(m, x, poisson_ratio)

    precision = {"precision": _COARSE_PRECISION} if edge == "free" else {}
    places = _bracket_supported(orders, max_root, poisson_ratio)
    hinged_roots = find_enclosed_roots(hinge, places, max_root, **precision)
    root_counts = _counts(hinge, max_root, root_counts, -1)
    require_counts(hinged_roots, root_counts)
    if edge == "supported":
        return hinged_roots
    roots = find_enclosed_roots(rim, _bracket_free(hinged_roots), max_root)
    rigid_counts = np.where(orders < 2, 1, 0)
    require_counts(
        roots, _counts(rim, max_root, root_counts - rigid_counts, np.where(orders < 2, -1, 1))
    )
    return roots


def _counts(edge: Function, max_root: float, min_counts: Index, start: int | Index) -> Index:
    """Return numbers of roots up to `max_root`: `min_counts` or one more, by the sign there."""
    orders = np.arange(len(min_counts), dtype=float)
    signs = np.sign(edge(orders, np.full(len(min_counts), max_root))) * start
    return np.maximum(min_counts + (signs != np.where(min_counts % 2, -1, 1)), 0)


def _bracket_supported(orders: Array, max_root: float, poisson_ratio: float) -> Array:
    """Return places below the first root and between successive ones of supported plates."""
    # By the series of both quotients of Bessel functions.
    first = orders.copy()
    first[0] = (1 + poisson_ratio) ** 0.25
    return np.column_stack([first, separators(orders, max_root, _SUPPORTED_PHASE)])


def _bracket_free(supported_roots: Array) -> Array:
    first = _RIM_WAVE * np.arange(len(supported_roots))
    first[:2] = np.inf
    return np.column_stack([first, supported_roots, np.full(len(supported_roots), np.inf)])


def clamped_edge(orders: Array, x: Array) -> Array:
    """Return J_m I_{m+1} / I_m + J_{m+1}: zero where w and dw/dr can vanish on the edge."""
    wave, following, growth = edge_values(orders, x)
    return wave * growth + following


def supported_edge(orders: Array, x: Array, poisson_ratio: float) -> Array:
    """Return a function whose zeros let w and the bending moment vanish on the edge."""
    wave, following, growth = edge_values(orders, x)
    return following + wave * (growth - 2 * x / (1 - poisson_ratio))


def free_edge(orders: Array, x: Array, poisson_ratio: float) -> Array:
    """Return a function whose zeros let moment and Kirchhoff's shear force vanish on the edge."""
    wave, wave_slope, growing_slope = edge_slopes(orders, x)
    moment = bending_moment(orders, -(x**2), wave, wave_slope, poisson_ratio)
    growing_moment = bending_moment(orders, x**2, np.ones_like(x), growing_slope, poisson_ratio)
    twist = (1 - poisson_ratio) * orders**2
    shear = -(x**2) * wave_slope - twist * (wave_slope - wave)
    growing_shear = x**2 * growing_slope - twist * (growing_slope - 1)
    return moment * growing_shear - growing_moment * shear


def edge_slopes(orders: Array, x: Array) -> tuple[Array, Array, Array]:
    """Return J_m(x r), its d/dr, and d/dr of I_m(x r) / I_m(x), at r = 1."""
    wave, following, growth = edge_values(orders, x)
    return wave, orders * wave - x * following, orders + x * growth


def bending_moment(
    orders: Array, curvature: Array, value: Array, slope: Array, poisson_ratio: float
) -> Array:
    """Return -M_r R^2 / D at r = 1 of a form whose Laplacian is `curvature` times itself."""
    return curvature * value - (1 - poisson_ratio) * (slope - orders**2 * value)


def plate_forms(
    edge: str, radius: float, waves: tuple[Index, Index], roots: Array, poisson_ratio: float
) -> tuple[RoundForms, Array]:
    """Return forms with roots lambda, and the slopes of ln lambda^2 over Poisson's ratio."""
    orders, sines = waves
    m = orders.astype(float)
    wave, wave_slope, growing_slope = edge_slopes(m, roots)
    growing = -wave
    if edge == "free":
        ones = np.ones_like(roots)
        balance = bending_moment(m, -(roots**2), wave, wave_slope, poisson_ratio)
        growing = -balance / bending_moment(m, roots**2, ones, growing_slope, poisson_ratio)
    square = _mean_square(m, roots, (wave, wave_slope, growing_slope), growing)
    size = np.where(orders > 0, math.sqrt(2), 1.0) / np.sqrt(square)
    forms = RoundForms(
        radius=radius,
        orders=orders,
        sines=sines,
        wavenumbers=roots,
        regular=size,
        singular=np.zeros(len(roots)),
        growing=size * growing,
    )
    deflection, slope = wave + growing, wave_slope + growing * growing_slope
    return forms, _twisting(m, deflection, slope) / (square * roots**4)


def _mean_square(m: Array, roots: Array, edge: tuple[Array, Array, Array], growing: Array) -> Array:
    """Return 2 times the integral of w^2 r from 0 to 1, by Lommel's integrals."""
    wave, wave_slope, growing_slope = edge
    order_ratios = (m / roots) ** 2
    waves = (wave_slope / roots) ** 2 + (1 - order_ratios) * wave**2
    cross_terms = (wave * growing_slope - wave_slope) / roots**2
    growths = 1 + order_ratios - (growing_slope / roots) ** 2
    return waves + 2 * growing * cross_terms + growing**2 * growths


def _twisting(m: Array, deflection: Array, slope: Array) -> Array:
    """Return the integral over the plate of the factor of 1 - nu in the energy of bending.

    That is 2 w_rr (w_r / r + w_tt / r^2) - 2 [(w_t / r)_r]^2, a divergence, so that the edge alone
    counts. Where the integral of w^2 is 1, it is the slope of lambda^4 over nu (Rayleigh).
    """
    return slope**2 - 2 * m**2 * slope * deflection + m**2 * deflection**2


_ROUNDING = 1e-12


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class CircularPlate(Shape):
    """A thin disk around the origin that resists bending.

    Parameters
    ----------
    radius : float
        Radius, m.
    thickness : float
        Thickness, m.
    edge : {"free", "supported", "clamped"}, default "free"
        Edge; a supported one is held and free to rotate.

    Raises
    ------
    OptionError
        If lengths are not positive, or the edge is unknown.

    Notes
    -----
    Kirchhoff's theory: f = lambda^2 / (2 pi radius^2) [D / (density thickness)]^(1/2) with
    D = E thickness^3 / (12 (1 - nu^2)), and deflections of J_m(lambda r) and I_m(lambda r) times
    cosine and sine of m times the angle (Leissa 1969, chapter 2). Shear and rotation, which it
    leaves out, lower frequencies by about (lambda thickness / radius)^2 [1/24 + 1/(10 (1 - nu))]
    (Mindlin 1951).

    Places, at y = 0: "middle" (also "top"), "quarter" of the diameter, "edge" (also "rim") 1 % off.

    Examples
    --------
    >>> plate = CircularPlate(radius=0.1, thickness=0.001, edge="clamped")
    >>> steel = Material(density=7850.0, youngs_modulus=200e9, poisson_ratio=0.29)
    >>> plate.vibration(steel, 1000.0).frequencies.round(2)
    array([247.55, 515.18, 515.18, 845.13, 845.13, 963.73])
    """

    radius: float
    thickness: float
    edge: str = "free"

    def __post_init__(self) -> None:
        require_length("radius of the plate", self.radius)
        require_length("thickness of the plate", self.thickness)
        require_choice("edge of the plate", self.edge, EDGES)

    @property
    def supported(self) -> bool:
        """Whether the plate's edge is held."""
        return self.edge != "free"

    @property
    def geometry(self) -> Sheet:
        """Surface of the plate, and places on it by name."""
        return Sheet(Disk(self.radius), self.thickness)

    def vibration(self, material: Material, highest: float) -> Vibration:
        """Compute all modes up to a frequency, without rigid motions of a free plate.

        Parameters
        ----------
        material : Material
            Material of the body.
        highest : float
            Upper limit of the frequencies, Hz.

        Returns
        -------
        Vibration
            Frequencies and shapes of the modes.

        Raises
        ------
        OptionError
            When they are more than 100,000.
        """
        nu, unit = material.poisson_ratio, self._unit(material)
        max_root = math.sqrt(highest / unit)
        require_countable("plate", math.pi, max_root, highest)
        orders, sines, roots = expand_pairs(plate_roots(self.edge, max_root, nu))
        overestimates = plate_overestimate(roots * self.thickness / self.radius, nu)
        forms, slopes = plate_forms(self.edge, self.radius, (orders, sines), roots, nu)
        return Vibration(
            frequencies=unit * roots**2,
            forms=forms,
            poisson_slopes=slopes + nu / (1 - nu**2),
            errors=np.full(len(roots), _ROUNDING),
            overstated=overestimates,
            half_wave=math.pi * self.radius / float(roots.max(initial=math.pi)),
            method=f"circular plate, {self.edge}: Kirchhoff's theory, roots counted by their signs",
            references=("leissa1969", "mindlin1951"),
            details=thinness(self.thickness, self.radius, overestimates),
        )

    def solid(self) -> Counterpart:
        """Return the solid disk that the plate idealises.

        Returns
        -------
        Counterpart
            The solid in the coordinates of the plate.

        Raises
        ------
        OptionError
            On a supported edge.
        """
        require_clamped_or_free("plate", (self.edge,))
        disk = Tube(length=self.thickness, radius=self.radius, wall=self.radius)
        return Counterpart(
            solid=disk, of="CircularPlate", rim=self.radius if self.supported else None
        )

    def _unit(self, material: Material) -> float:
        """Return the frequency at which lambda would be 1, Hz."""
        inertia = 12 * (1 - material.poisson_ratio**2) * material.density
        speed = math.sqrt(material.youngs_modulus / inertia)
        return speed * self.thickness / (2 * math.pi * self.radius**2)
