"""Bodies of revolution that people strike: bowls, bells, wine glasses, in sensible proportions."""

from __future__ import annotations

import numpy as np

from struck.solids.resolution import require_length
from struck.solids.revolution import Revolution, Stem


def bowl(*, radius: float = 0.1, height: float = 0.05, wall: float = 0.003) -> Revolution:
    """Return a bowl that opens upward: half an ellipsoid of even thickness.

    Parameters
    ----------
    radius, height : float
        Of the mid-line at the rim, above the bottom, m.
    wall : float
        m.

    Raises
    ------
    OptionError
        On lengths that are not positive.
    MeshError
        When the wall is too thick for the bends.
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


def bell(*, height: float = 0.2, radius: float = 0.125, sound_bow: float = 0.018) -> Revolution:
    """Return a church bell, its mouth at z = 0.

    Parameters
    ----------
    height : float
        From mouth to crown along the mid-line, m.
    radius : float
        Of the mouth, m.
    sound_bow : float
        Thickness where the clapper strikes, m; the waist has 0.44 of it.

    Raises
    ------
    OptionError
        On lengths that are not positive.
    MeshError
        When the wall is too thick for the bends.
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
_STEM = (0.24, 0.12, 0.10, 0.12, 0.22)  # radii over the bowl's


def wine_glass(*, height: float = 0.2, radius: float = 0.038, wall: float = 0.001) -> Revolution:
    """Return a wine glass: a bowl on a solid stem and foot, standing on z = 0.

    Parameters
    ----------
    height : float
        m.
    radius : float
        Largest radius of the bowl's mid-line, m.
    wall : float
        Thickness at the rim, m; bottom and foot are thicker.

    Raises
    ------
    OptionError
        On lengths that are not positive.
    MeshError
        When the wall is too thick for the bends.
    """
    _require(height=height, radius=radius, wall=wall)
    r, z, thickness = (_GLASS * (radius, height, wall)).T
    foot_r, foot_thickness = (_FOOT * (radius, wall)).T
    stem = Stem(
        radii=[share * radius for share in _STEM],
        foot=np.stack([foot_r, foot_thickness / 2], axis=1).tolist(),
        foot_wall=foot_thickness.tolist(),
    )
    profile = np.stack([r, z], axis=1).tolist()
    return Revolution(profile=profile, wall=thickness.tolist(), stem=stem)


def _require(**lengths: float) -> None:
    for name, value in lengths.items():
        require_length(name, value)
