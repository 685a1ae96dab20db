"""Materials of bodies, by constants or by name; and the air around them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np

from struck.errors import MaterialError, OptionError, nearest, require_choice, rounded
from struck.model.arrays import checked, require_number
from struck.model.damping import Damping, InternalFriction, Rayleigh
from struck.model.provenance import table_of


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class Material:
    """A homogeneous, isotropic, elastic material.

    Parameters
    ----------
    name : str, default "custom"
        Name of the material.
    density : float
        Density, kg/m^3.
    youngs_modulus : float
        Young's modulus, Pa.
    poisson_ratio : float
        Poisson's ratio, above -1 and below 0.5.
    damping : Damping, optional
        Damping law. Default: no losses.
    source : str, default ""
        Source of the constants.

    Raises
    ------
    MaterialError
        If no stable solid has these constants.

    Examples
    --------
    >>> steel = struck.Material.named("steel")
    >>> steel.density, steel.poisson_ratio
    (7850.0, 0.29)
    >>> lossy = steel.damped(struck.InternalFriction(loss_tangent=0.01))
    >>> round(float(lossy.damping.decays(1000.0)), 2)
    31.42
    """

    name: str = "custom"
    density: float
    youngs_modulus: float
    poisson_ratio: float
    damping: Damping = field(default_factory=lambda: InternalFriction(loss_tangent=0.0))
    source: str = ""

    def __post_init__(self) -> None:
        for label, value, unit in (
            ("density", self.density, " kg/m^3"),
            ("Young's modulus", self.youngs_modulus, " Pa"),
        ):
            require_number(
                f"{label} of {self.name}",
                value,
                1e-9,
                1e30,
                hint="it must exceed 0, and 1e-09 is the least",
                unit=unit,
                error=MaterialError,
            )
        hint = (
            f"it must lie above -1 and at most at {_LARGEST_POISSON_RATIO} (at 0.5 a solid cannot "
            "be compressed, and these elements lock); take 0.49 for rubber-like materials"
        )
        name, value = f"Poisson's ratio of {self.name}", self.poisson_ratio
        require_number(name, value, -1, np.inf, above=True, hint=hint, error=MaterialError)
        if value > _LARGEST_POISSON_RATIO:
            raise MaterialError(f"{name} is {value}: {hint}")

    @classmethod
    @checked
    def from_lame(
        cls, *, first: float, shear: float, density: float, damping: Damping, name: str = "custom"
    ) -> Material:
        """Make a material from Lame's constants (lambda and mu of 2002, Table 1).

        Parameters
        ----------
        first : float
            First constant, lambda, Pa.
        shear : float
            Second constant, the shear modulus mu, Pa.
        density : float
            Density, kg/m^3.
        damping : Damping
            Damping law.
        name : str, default "custom"
            Name of the material.

        Returns
        -------
        Material
            The material with the same elasticity.

        Raises
        ------
        MaterialError
            If the two do not make a solid that resists both shear and compression.
        """
        if not (shear > 0 and 3 * first + 2 * shear > 0):
            raise MaterialError(
                f"Lame's constants of {name} are {first} and {shear}: the second must exceed 0 and "
                "the first -2/3 of the second"
            )
        return cls(
            name=name,
            density=density,
            youngs_modulus=shear * (3 * first + 2 * shear) / (first + shear),
            poisson_ratio=first / (2 * (first + shear)),
            damping=damping,
        )

    @classmethod
    @checked
    def named(cls, name: str, damping: str = "own") -> Material:
        """Look up a material by name.

        Parameters
        ----------
        name : str
            A name or alias of ``materials.toml``, in any case.
        damping : {"own", "heard", "heard_bowl"}, default "own"
            "own": internal friction. "heard": the Rayleigh constants that graphics research tuned
            by ear, mounting and radiation included. "heard_bowl": the constants of an aluminium
            bowl (O'Brien et al. 2002, bowl 1).

        Returns
        -------
        Material
            The material.

        Raises
        ------
        MaterialError
            If the name is unknown (the nearest names are offered), or the material has no such
            damping.
        """
        entry = materials().get(_canonical(name))
        if entry is None:
            raise MaterialError(_unknown(name))
        return _from_entry(_canonical(name), entry, damping)

    @classmethod
    def of(cls, material: Material | str, damping: str = "own") -> Material:
        """Return a material, or look it up by name.

        Parameters
        ----------
        material : Material or str
            A material, which is returned as it is, or a name.
        damping : str, default "own"
            Set of damping constants of a material that is given by name, as for `named`.

        Returns
        -------
        Material
            The material.

        Raises
        ------
        MaterialError
            If the name is unknown, has no such damping, or `damping` is not "own" for a material
            that is not given by name.
        """
        if isinstance(material, str):
            return cls.named(material, damping)
        require_damping(damping)
        if damping != "own":
            raise MaterialError(
                f"damping is {damping!r}, which is looked up for materials by name: leave it out, "
                "or give the material that law, as material.damped(...)"
            )
        return material

    @property
    def shear_modulus(self) -> float:
        """Lame's second constant mu, Pa."""
        return self.youngs_modulus / (2 * (1 + self.poisson_ratio))

    @property
    def bulk_modulus(self) -> float:
        """Resistance to compression, Pa."""
        return self.youngs_modulus / (3 * (1 - 2 * self.poisson_ratio))

    @property
    def first_lame(self) -> float:
        """Lame's first constant lambda, Pa."""
        return 2 * self.shear_modulus * self.poisson_ratio / (1 - 2 * self.poisson_ratio)

    @checked
    def damped(self, damping: Damping) -> Material:
        """Return a copy with another damping law.

        Parameters
        ----------
        damping : Damping
            The new law.

        Returns
        -------
        Material
            The copy.
        """
        return replace(self, damping=damping)

    @property
    def doubt(self) -> str:
        """Warning about constants so low that other units were probably meant, or ""."""
        modulus = self.youngs_modulus
        speed = math.sqrt(modulus / self.density)
        if speed > _FASTEST:
            return (
                f"sound goes through {self.name} at {rounded(speed, 2)} m/s by its density of "
                f"{rounded(self.density)} kg/m3, faster than through diamond: if that was meant in "
                f"g/cm3, it is {rounded(1000 * self.density)} kg/m3"
            )
        if self.density < _LIGHTEST:  # or numbers are without units
            light = f"{self.name} weighs {rounded(self.density)} kg/m3, less than any solid: if "
            light += f"that was meant in g/cm3, it is {rounded(1000 * self.density)} kg/m3"
            if 1 < modulus < _LARGEST_IN_GPA and self.density > 1:
                return f"{light}, and {rounded(modulus)} GPa is {rounded(modulus)}e9"
            return light if modulus >= _SOFTEST else ""
        if modulus >= _SOFTEST and speed >= _SLOWEST:
            return ""
        unit, factor = ("GPa", "e9") if modulus < _LARGEST_IN_GPA else ("MPa", "e6")
        return (
            f"Young's modulus of {self.name} is {rounded(modulus)} Pa, so sound goes through it at "
            f"{rounded(speed, 2)} m/s: if it was meant in {unit}, {rounded(modulus)} {unit} is "
            f"{rounded(modulus)}{factor}"
        )


_LARGEST_POISSON_RATIO = 0.495
_SOFTEST, _SLOWEST = 1e5, 10.0  # Pa, m/s: less than of rubber
_LIGHTEST = 10.0  # kg/m^3, of solids
_FASTEST = 20_000.0  # m/s: more than in diamond
_LARGEST_IN_GPA = 1300.0  # no solid's exceeds it


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class Air:
    """A gas at rest, which carries sound from a body to an ear.

    Parameters
    ----------
    density : float
        Density, kg/m^3.
    sound_speed : float
        Speed of sound, m/s.
    viscosity : float, default 1.8134e-5
        Dynamic viscosity, Pa s. This default and the next ones are of dry air at 20 degrees
        Celsius (U.S. Standard Atmosphere, 1976).
    conductivity : float, default 0.02572
        Thermal conductivity, W/(m K).
    heat_capacity : float, default 1004.7
        Heat capacity at constant pressure, J/(kg K).
    heat_ratio : float, default 1.4
        Ratio of the heat capacities at constant pressure and at constant volume, at least 1.

    Raises
    ------
    OptionError
        If a value is not finite, or not above 0.

    Examples
    --------
    >>> from struck.model.material import Air
    >>> cold = Air.at(temperature=253.15)
    >>> round(cold.density, 3), round(cold.sound_speed, 1)
    (1.394, 319.0)
    """

    density: float
    sound_speed: float
    viscosity: float = 1.8134e-5
    conductivity: float = 0.02572
    heat_capacity: float = 1004.7
    heat_ratio: float = 1.4

    def __post_init__(self) -> None:
        for name, unit in (
            ("density", " kg/m^3"),
            ("sound_speed", " m/s"),
            ("viscosity", " Pa s"),
            ("conductivity", " W/(m K)"),
            ("heat_capacity", " J/(kg K)"),
        ):
            require_number(
                f"{name} of the air",
                getattr(self, name),
                above=True,
                hint="it must be finite and above 0, as of Air.at(temperature=293.15)",
                unit=unit,
            )
        hint = "it must be at least 1, as 1.4 of air"
        require_number("heat_ratio of the air", self.heat_ratio, 1.0, hint=hint)

    @classmethod
    @checked
    def at(cls, *, temperature: float = 293.15, pressure: float = 101_325.0) -> Air:
        """Compute the constants of dry air, as an ideal gas.

        Viscosity and conductivity by Sutherland's formulas, as in the U.S. Standard Atmosphere,
        1976.

        Parameters
        ----------
        temperature : float, default 293.15
            Temperature, K, from 173 to 373.
        pressure : float, default 101325
            Pressure, Pa, from 1e3 to 1e6.

        Returns
        -------
        Air
            The air.

        Raises
        ------
        OptionError
            If temperature or pressure are out of range.
        """
        for name, value, (minimum, maximum), unit in (
            ("temperature", temperature, _TEMPERATURES, "K"),
            ("pressure", pressure, _PRESSURES, "Pa"),
        ):
            if not minimum <= value <= maximum:
                raise OptionError(
                    f"{name} of the air is {rounded(value)} {unit}, of {rounded(minimum)} to "
                    f"{rounded(maximum)} {unit}: give it in {unit} (20 degrees Celsius are "
                    "293.15 K, one atmosphere is 101325 Pa), or all constants, as Air(density=...)"
                )
        root = temperature**1.5
        return cls(
            density=pressure / (_GAS_CONSTANT * temperature),
            sound_speed=math.sqrt(_HEAT_RATIO * _GAS_CONSTANT * temperature),
            viscosity=1.458e-6 * root / (temperature + 110.4),
            conductivity=2.64638e-3 * root / (temperature + 245.4 * 10 ** (-12 / temperature)),
            heat_capacity=_GAS_CONSTANT * _HEAT_RATIO / (_HEAT_RATIO - 1),
            heat_ratio=_HEAT_RATIO,
        )

    @property
    def impedance(self) -> float:
        """Characteristic impedance rho c, Pa s/m."""
        return self.density * self.sound_speed


# Bounds within which air is nearly an ideal gas of constant heat capacity, chosen by judgement:
# -100 to 100 degrees Celsius, a hundredth to ten atmospheres.
_TEMPERATURES, _PRESSURES = (173.0, 373.0), (1e3, 1e6)  # K, Pa
_GAS_CONSTANT, _HEAT_RATIO = 287.053, 1.4  # J/(kg K), of dry air: U.S. Standard Atmosphere, 1976

AIR = Air(density=1.2041, sound_speed=343.21)  # dry, at 20 degrees Celsius and 101.325 kPa


@checked
def materials() -> Mapping[str, Mapping[str, Any]]:
    """Return the table of materials.

    Returns
    -------
    mapping
        By name: group, aliases, constants in SI units, sets of damping constants, and sources.

    Examples
    --------
    >>> struck.materials()["steel"]["density"]
    7850.0
    """
    return table_of("struck.model", "materials")


@cache
def _aliases() -> Mapping[str, str]:
    pairs = {alias: name for name, entry in materials().items() for alias in entry["aliases"]}
    return pairs | {name: name for name in materials()}


def _canonical(name: str) -> str:
    plain = name.strip().lower().replace("_", " ").replace("-", " ")
    return _aliases().get(plain, plain)


def _unknown(name: str) -> str:
    suggestion = nearest(_canonical(name), _aliases())
    command = f"'struck materials' lists all {len(materials())}"
    return f"no material is called {name!r}: {suggestion}{command}"


def require_damping(damping: str) -> None:
    """Raise MaterialError on the name of a damping that no material has."""
    require_choice("damping", damping, ("own", "heard", "heard_bowl"), MaterialError)


def _from_entry(name: str, entry: Mapping[str, Any], damping: str) -> Material:
    require_damping(damping)
    if damping not in {"own", *entry}:
        kind = damping.replace("heard", "as heard").replace("_", " of a ")
        raise MaterialError(
            f"{name} has no published set {kind!r}: take damping='own', or give a Rayleigh set"
        )
    internal_friction = InternalFriction(loss_tangent=entry["loss_tangent"])
    return Material(
        name=name,
        density=entry["density"],
        youngs_modulus=entry["youngs_modulus"],
        poisson_ratio=entry["poisson_ratio"],
        damping=internal_friction
        if damping == "own"
        else Rayleigh(**entry[damping], contains_air=True),
        source=entry["source"],
    )
