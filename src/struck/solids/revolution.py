"""Bodies of revolution about the z axis: bowls, bells, glasses, turned solids."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from struck.errors import MeshError, OptionError, rounded
from struck.model.arrays import Array, checked, numbers
from struck.solids.lathe import LatheSolid
from struck.solids.meridian import (
    Counts,
    Goblet,
    Shell,
    Spindle,
    check_contour,
    check_wall,
    outline,
    revolve,
    smooth_curve,
    smooth_wall,
    straight_curve,
    straight_wall,
    volume,
)
from struck.solids.polygon_mesh import Pairs, as_points
from struck.solids.resolution import (
    Sizes,
    refine_round_counts,
    require_counts,
    require_length,
    require_round,
    round_sizes,
    shell_counts,
    solid_counts,
)
from struck.solids.volume_mesh import VolumeMesh

Thickness = float | Sequence[float] | Array


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class Stem:
    """A solid stem with a foot, for a bowl that starts on the axis.

    Parameters
    ----------
    radii : sequence of float
        Radii at equal heights from the top of the foot to the underside of the bowl, m; between
        them the radius changes smoothly.
    foot : sequence of (r, z)
        Mid-line of the foot, from the axis outward, m.
    foot_wall : float or sequence of float
        Thickness of the foot, m: one, or one per point.

    Raises
    ------
    OptionError
        If radii or thicknesses are not positive, or points are not finite pairs.
    MeshError
        If the foot does not start on the axis.

    Examples
    --------
    >>> from struck.solids import Revolution, Stem
    >>> stem = Stem(radii=[0.004, 0.003, 0.006], foot=[(0.0, 0.0), (0.03, 0.0)], foot_wall=0.003)
    >>> goblet = Revolution(
    ...     profile=[(0.0, 0.1), (0.03, 0.11), (0.04, 0.16)], wall=0.0015, stem=stem
    ... )
    >>> sorted(goblet.places)
    ['bottom', 'foot', 'rim', 'side', 'stem']
    """

    radii: Sequence[float] | Array
    foot: Pairs
    foot_wall: Thickness

    def __post_init__(self) -> None:
        object.__setattr__(self, "radii", tuple(numbers("radii", self.radii).ravel().tolist()))
        object.__setattr__(self, "foot", _profile("foot", self.foot))
        object.__setattr__(self, "foot_wall", _thickness("foot_wall", self.foot_wall, self.foot))
        if len(self.radii) < 2:
            raise OptionError(f"the stem has {len(self.radii)} radii: give at least 2")
        for radius in self.radii:
            require_length("radius of the stem", radius)
        _require_start_on_axis("the foot", self.foot)


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class Revolution:
    """A body of revolution about the z axis.

    Parameters
    ----------
    profile : sequence of (r, z)
        With a `wall`: the mid-line of the wall, m. An end at r = 0 closes the body there, at a
        right angle to the axis if `smooth`. Without a wall: the side of a solid from bottom to top,
        undercut or not; flats close it where its ends are off the axis.
    wall : float or sequence of float, optional
        Wall thickness, m: one, or one per point of the profile (between the points it changes
        smoothly, or linearly where the profile is straight). Default: a solid.
    smooth : bool, default True
        Whether the profile is a smooth curve (a cubic spline) through its points, or straight
        between them, with mitred walls at the corners.
    stem : Stem, optional
        A stem and foot below a bowl whose profile starts on the axis.
    elements : tuple of three ints, optional
        Number of elements around (a multiple of 4), along the profile and through the wall (in a
        solid: between the axis and the side, beyond the core). Default: by the accuracy.

    Raises
    ------
    OptionError
        If thicknesses are not positive, points are not finite pairs, or counts are impossible.
    MeshError
        If the profile crosses itself or the axis, or bends too tightly for its wall.

    Examples
    --------
    >>> bowl = Revolution(profile=[(0, 0), (0.07, 0.01), (0.1, 0.06)], wall=0.003)
    >>> sorted(bowl.places)
    ['bottom', 'rim', 'side']
    """

    profile: Pairs
    wall: Thickness | None = None
    smooth: bool = True
    stem: Stem | None = None
    elements: tuple[int, int, int] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "profile", _profile("profile", self.profile))
        if self.wall is not None:
            object.__setattr__(self, "wall", _thickness("wall", self.wall, self.profile))
        if self.elements is not None:
            require_counts(self.elements, ("around", "along", "through"), (8, 1, 1))
            require_round(self.elements[0])
        if self.stem is not None:
            _require_start_on_axis("a bowl on a stem", self.profile)
        check_contour(outline(self._section.contour()))

    @property
    def _section(self) -> Shell | Spindle | LatheSolid | Goblet:
        if self.wall is None:
            if self.stem is not None:
                raise OptionError("the body has a stem but no wall: give the wall of its bowl")
            return _make_solid(np.array(self.profile), smooth=self.smooth)
        shell = _shell(self.profile, self.wall, smooth=self.smooth)
        if self.stem is None:
            return shell
        foot = _shell(self.stem.foot, self.stem.foot_wall, smooth=self.smooth)
        return Goblet(bowl=shell, foot=foot, radii=np.array(self.stem.radii))

    @property
    def volume(self) -> float:
        """Volume of the material, m^3, by Pappus from the curves that bound it."""
        return volume(self._section.contour())

    @property
    def places(self) -> Mapping[str, Array]:
        """Contacts on the outside, at y = 0, where the body has them.

        "rim": 1 % of the profile off its free end; "side": half way along it; "top" and
        "bottom": on the axis; of a body with a stem also "stem" and "foot".
        """
        points = self._section.places()
        return MappingProxyType({name: np.array([r, 0.0, z]) for name, (r, z) in points.items()})

    @property
    def playing_place(self) -> str | None:
        """Name of the place where it is struck by default: the rim of a shell that has one."""
        return "rim" if self.wall is not None and "rim" in self.places else None

    def volume_mesh(self, accuracy: str = "standard", finer: float = 1.0) -> VolumeMesh:
        """Return curved 20-node hexahedra, without a pole.

        Parameters
        ----------
        accuracy : {"preview", "standard", "fine"}, default "standard"
            Resolution, if the body has no `elements`.
        finer : float, default 1.0
            Approximate factor of the number of elements in each direction.

        Returns
        -------
        VolumeMesh
            Nodes and elements.
        """
        base_counts = self.elements or self._counts(accuracy)
        around_count, along_count, through_count = refine_round_counts(
            base_counts, self._sizes, finer
        )
        counts = Counts(around=around_count, along=along_count, through=through_count)
        section = self._section
        if isinstance(section, LatheSolid):
            nodes, elements = section.mesh(counts)
        else:
            nodes, elements = revolve(section.patches(counts), around_count)
        return VolumeMesh(nodes=nodes, elements=elements, kind="hex20")

    @property
    def _sizes(self) -> Sizes:
        points = np.array(self.profile)
        length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
        radius = float(points[:, 0].max())
        return round_sizes(
            length, radius, radius if self.wall is None else float(np.max(self.wall))
        )

    def _counts(self, accuracy: str) -> tuple[int, int, int]:
        round_the_axis, length, wall = self._sizes
        radius = round_the_axis / (2 * np.pi)
        if self.wall is None:
            around_count, along_count, through_count = solid_counts(length, radius, accuracy)
            # What closes on the axis or undercuts is as wide as long, and stout.
            around_count = (
                max(around_count, 12) if isinstance(self._section, LatheSolid) else around_count
            )
        else:
            around_count, along_count, through_count = shell_counts(length, radius, wall, accuracy)
        # A profile given in detail is followed, one given in excess is not.
        return (
            around_count,
            max(along_count, min(len(self.profile) - 1, 2 * along_count)),
            through_count,
        )


def _profile(name: str, values: Pairs) -> tuple[tuple[float, float], ...]:
    points = as_points(name, values)
    if len(points) < 2:
        raise OptionError(f"{name} has {len(points)} points: give at least 2")
    for (r, z), following in zip(points, (*points[1:], None), strict=True):
        if r < 0:
            raise MeshError(f"{name} has r = {r} m at z = {z} m: radii are 0 or more")
        if (r, z) == following:
            raise MeshError(f"{name} repeats the point ({r}, {z}) m: give it once")
    if points[0] == points[-1]:
        place = ", ".join(map(rounded, points[0]))
        raise MeshError(f"{name} closes on itself at {place} m: leave a gap between its ends")
    return points


def _thickness(name: str, value: Thickness, profile: Pairs) -> tuple[float, ...]:
    """Return the wall's thickness at each point."""
    thicknesses = tuple(float(t) for t in np.atleast_1d(np.asarray(value, float)))
    if len(thicknesses) == 1:
        thicknesses *= len(profile)
    if len(thicknesses) != len(profile):
        raise OptionError(
            f"{name} holds {len(thicknesses)} values for {len(profile)} points: give one, or one "
            "each"
        )
    for thickness in thicknesses:
        require_length(name, thickness)
    return thicknesses


def _require_start_on_axis(name: str, profile: Pairs) -> None:
    if profile[0][0] != 0 or profile[-1][0] == 0:
        raise MeshError(
            f"{name} runs from r = {profile[0][0]} m to r = {profile[-1][0]} m: start on the axis, "
            "at r = 0, and end off it"
        )


def _shell(profile: Pairs, thickness: Thickness, *, smooth: bool) -> Shell:
    points, thicknesses = np.array(profile), np.array(thickness)
    wall = (smooth_wall if smooth else straight_wall)(points, thicknesses)
    check_wall(wall)
    breaks = wall.knots[[0, -1]] if smooth else wall.knots
    return Shell(wall=wall, breaks=breaks, on_axis=(points[0, 0] == 0, points[-1, 0] == 0))


def _make_solid(points: Array, *, smooth: bool) -> Spindle | LatheSolid:
    side = (smooth_curve if smooth else straight_curve)(points)
    breaks = side.knots[[0, -1]] if smooth else side.knots
    r, z = side.sample(0.0, float(side.knots[-1])).T
    if r.min() > 1e-6 * r.max() and np.diff(z).min() > 0:
        return Spindle(side=side, breaks=breaks)
    lathe_solid = LatheSolid(side=side, breaks=breaks)
    lathe_solid.check()
    return lathe_solid


@checked
def bowl(*, radius: float = 0.1, height: float = 0.05, wall: float = 0.003) -> Revolution:
    """Make a bowl that opens upward: half an ellipsoid of constant thickness.

    Parameters
    ----------
    radius : float, default 0.1
        Radius of the mid-line at the rim, m.
    height : float, default 0.05
        Height of the rim above the bottom, m.
    wall : float, default 0.003
        Wall thickness, m.

    Returns
    -------
    Revolution
        The body.

    Raises
    ------
    OptionError
        If a length is not positive.
    MeshError
        If the wall is too thick for the bends.

    Examples
    --------
    >>> bowl = struck.solids.bowl(radius=0.06, height=0.04, wall=0.002)
    >>> model = struck.analyze(bowl, "glass", accuracy="preview", progress=None)
    >>> model.playing_place
    'rim'
    """
    _require(radius=radius, height=height, wall=wall)
    angle = np.linspace(0, np.pi / 2, 9)
    profile = np.stack([radius * np.sin(angle), height * (1 - np.cos(angle))], axis=1)
    return Revolution(profile=profile.tolist(), wall=wall)


# Mid-line (r over mouth radius, z over height) and thickness (over that of the sound bow) of a
# church bell, drawn by us: flat crown, round shoulder, concave waist, thick sound bow, thin lip.
_BELL = np.array(
    [
        (0.000, 1.000, 0.45),
        (0.270, 0.990, 0.44),
        (0.430, 0.940, 0.44),
        (0.505, 0.830, 0.43),
        (0.545, 0.640, 0.44),
        (0.620, 0.410, 0.50),
        (0.745, 0.220, 0.68),
        (0.890, 0.085, 1.00),
        (1.000, 0.000, 0.55),
    ]
)


@checked
def bell(*, height: float = 0.2, radius: float = 0.125, sound_bow: float = 0.018) -> Revolution:
    """Make a church bell with its mouth at z = 0.

    Parameters
    ----------
    height : float, default 0.2
        Height of the mid-line from mouth to crown, m.
    radius : float, default 0.125
        Radius of the mouth, m.
    sound_bow : float, default 0.018
        Wall thickness where the clapper strikes, m; the waist has 0.44 of it.

    Returns
    -------
    Revolution
        The body.

    Raises
    ------
    OptionError
        If a length is not positive.
    MeshError
        If the wall is too thick for the bends.

    Examples
    --------
    >>> bell = struck.solids.bell(height=0.2, radius=0.125)
    >>> sorted(bell.places)
    ['rim', 'side', 'top']
    """
    _require(height=height, radius=radius, sound_bow=sound_bow)
    r, z, thickness = (_BELL * (radius, height, sound_bow)).T
    return Revolution(profile=np.stack([r, z], axis=1).tolist(), wall=thickness.tolist())


# Mid-line of the bowl (r over its largest radius, z over the glass's height) and thickness
# (over that of the rim).
_GLASS = np.array(
    [
        (0.00, 0.450, 3.5),
        (0.50, 0.485, 2.0),
        (0.88, 0.600, 1.3),
        (1.00, 0.720, 1.0),
        (0.95, 0.860, 1.0),
        (0.84, 1.000, 1.0),
    ]
)
_FOOT = np.array([(0.0, 4.5), (0.5, 3.0), (0.9, 1.8)])  # flat below
_STEM_RATIOS = (0.24, 0.12, 0.10, 0.12, 0.22)  # radii over the bowl's


@checked
def wine_glass(*, height: float = 0.2, radius: float = 0.038, wall: float = 0.001) -> Revolution:
    """Make a wine glass: a bowl on a solid stem and foot, which stands on z = 0.

    Parameters
    ----------
    height : float, default 0.2
        Height, m.
    radius : float, default 0.038
        Largest radius of the mid-line of the bowl, m.
    wall : float, default 0.001
        Wall thickness at the rim, m; bottom and foot are thicker.

    Returns
    -------
    Revolution
        The body.

    Raises
    ------
    OptionError
        If a length is not positive.
    MeshError
        If the wall is too thick for the bends.

    Examples
    --------
    >>> glass = struck.solids.wine_glass(height=0.2, wall=0.001)
    >>> sorted(glass.places)
    ['bottom', 'foot', 'rim', 'side', 'stem']
    """
    _require(height=height, radius=radius, wall=wall)
    r, z, thickness = (_GLASS * (radius, height, wall)).T
    foot_r, foot_thickness = (_FOOT * (radius, wall)).T
    stem = Stem(
        radii=[ratio * radius for ratio in _STEM_RATIOS],
        foot=np.stack([foot_r, foot_thickness / 2], axis=1).tolist(),
        foot_wall=foot_thickness.tolist(),
    )
    profile = np.stack([r, z], axis=1).tolist()
    return Revolution(profile=profile, wall=thickness.tolist(), stem=stem)


def _require(**lengths: float) -> None:
    for name, value in lengths.items():
        require_length(name, value)
