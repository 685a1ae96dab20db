"""Air: tabulated constants, and what it refuses."""

from __future__ import annotations

import math

import pytest

from struck.errors import OptionError
from struck.model.material import AIR, Air

# U.S. Standard Atmosphere, 1976, tables I and III: altitude 0 and 2,000 m.
ATMOSPHERE = [
    # K, Pa, kg/m^3, m/s, Pa s, W/(m K)
    (288.15, 101_325.0, 1.2250, 340.294, 1.7894e-5, 2.5326e-2),
    (275.154, 79_501.0, 1.0066, 332.53, 1.7260e-5, 2.4303e-2),
]


@pytest.mark.parametrize("row", ATMOSPHERE)
def test_air_is_that_of_the_standard_atmosphere(row: tuple[float, ...]) -> None:
    temperature, pressure, *expected = row
    air = Air.at(temperature=temperature, pressure=pressure)
    computed = [air.density, air.sound_speed, air.viscosity, air.conductivity]
    assert computed == pytest.approx(expected, rel=1e-3)


def test_default_air_has_20_degrees() -> None:
    warm = Air.at(temperature=293.15)
    for name in ("density", "sound_speed", "viscosity", "conductivity", "heat_capacity"):
        assert getattr(AIR, name) == pytest.approx(getattr(warm, name), rel=2e-4), name
    assert AIR.heat_ratio == warm.heat_ratio


@pytest.mark.parametrize("name", ["density", "sound_speed", "viscosity", "conductivity"])
@pytest.mark.parametrize("value", [0.0, -1.2, math.nan, math.inf])
def test_no_gas_has_such_a_constant(name: str, value: float) -> None:
    constants = {"density": 1.2, "sound_speed": 343.0} | {name: value}
    with pytest.raises(OptionError, match=f"{name} of the air is .*above 0"):
        Air(**constants)


def test_no_gas_has_less_heat_at_constant_pressure() -> None:
    with pytest.raises(OptionError, match=r"heat_ratio of the air is 0\.9"):
        Air(density=1.2, sound_speed=343.0, heat_ratio=0.9)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"temperature": 20.0}, r"temperature of the air is 20.* K, of 173.* to 373.* 293\.15 K"),
        ({"temperature": math.nan}, "temperature of the air is nan"),
        ({"pressure": 1013.25e4}, "pressure of the air is .* Pa, of .*101325 Pa"),
        ({"pressure": 101.3}, "pressure of the air is .*101325 Pa"),
    ],
)
def test_air_out_of_range_is_refused(options: dict[str, float], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        Air.at(**options)
