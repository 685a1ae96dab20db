"""Strings: harmonic, or as sharp as their stiffness makes them."""

from __future__ import annotations

import numpy as np
import pytest

from struck import Material
from struck.errors import OptionError
from struck.shapes.string import String
from struck.solids.surface.closedness import require_closed
from tests.shapes.legendre_beams import stiff_string

STEEL = Material(density=7850.0, youngs_modulus=200e9, poisson_ratio=0.29)
WIRE = String(length=0.62, radius=0.0005, tension=700.0)


def test_the_ideal_string_is_harmonic() -> None:
    # Mersenne's law: pitch = sqrt(tension / line density) / (2 length).
    lowest = np.sqrt(700.0 / (7850.0 * np.pi * 0.0005**2)) / (2 * 0.62)
    frequencies = WIRE.vibration(STEEL, 100.5 * lowest).frequencies
    assert frequencies == pytest.approx(lowest * np.arange(1, 101), rel=1e-14)


@pytest.mark.parametrize("radius", [0.0005, 0.005])
def test_the_stiff_string_solves_its_equation(radius: float) -> None:
    string = String(length=0.62, radius=radius, tension=700.0, stiff=True)
    expected = stiff_string(
        length=0.62,
        line_density=7850.0 * np.pi * radius**2,
        tension=700.0,
        bending=200e9 * np.pi / 4 * radius**4,
        degree=34,
    )
    vibration = string.vibration(STEEL, float(expected[9] + expected[10]) / 2)
    assert vibration.frequencies == pytest.approx(expected[:10], rel=1e-8)


def test_inharmonicity_of_a_piano_string() -> None:
    # Fletcher 1964, with the diameter: B = pi^3 E d^4 / (64 T L^2).
    stiff = String(length=0.62, radius=0.0005, tension=700.0, stiff=True)
    expected = np.pi**3 * 200e9 * 0.001**4 / (64 * 700.0 * 0.62**2)
    assert stiff.vibration(STEEL, 2e4).details["inharmonicity"] == pytest.approx(expected)
    assert WIRE.vibration(STEEL, 2e4).details["inharmonicity"] == 0


def test_stiffness_takes_modes_out_of_the_band_but_misses_none() -> None:
    stiff = String(length=0.62, radius=0.002, tension=700.0, stiff=True)
    for highest in np.linspace(100, 20_000, 40):
        frequencies = stiff.vibration(STEEL, highest).frequencies
        wider = stiff.vibration(STEEL, 2 * highest).frequencies
        assert frequencies.tolist() == wider[wider <= highest].tolist()


def test_forms_are_orthonormal_sines() -> None:
    forms = WIRE.vibration(STEEL, 60e3).forms
    x = (np.arange(1000) + 0.5)[:, None] / 1000 * 0.62
    values = forms.values(x)
    assert values.shape[1] >= 200
    np.testing.assert_allclose(
        values.T @ values / 1000, np.eye(values.shape[1]), rtol=0, atol=1e-12
    )
    middle = forms.values(np.array([[0.31]]))[0]
    assert middle[:4] == pytest.approx(np.sqrt(2) * np.array([1, 0, -1, 0]), abs=1e-14)
    beyond = forms.values(np.array([[-0.01], [0.63]]))
    assert beyond == pytest.approx(0, abs=1e-10)


def test_forms_of_some_modes() -> None:
    forms = WIRE.vibration(STEEL, 10e3).forms
    x = np.array([[0.1], [0.2]])
    some = np.array([3, 0, 0])
    assert forms.chosen(some).values(x).tolist() == forms.values(x)[:, some].tolist()
    assert forms.dimensions == 1


def test_its_body() -> None:
    skin = WIRE.skin(0.02)
    require_closed(skin)
    assert skin.volume == pytest.approx(np.pi * 0.0005**2 * 0.62, rel=1e-12)
    assert WIRE.volume == pytest.approx(skin.volume, rel=1e-12)
    assert skin.extent == pytest.approx(WIRE.extent)
    assert WIRE.supported
    assert WIRE.tensioned
    assert WIRE.places["top"].tolist() == WIRE.places["middle"].tolist() == [0.31, 0, 0.0005]
    assert WIRE.places["quarter"][0] == 0.155
    assert WIRE.places["end"][0] == pytest.approx(0.6138)


def test_a_band_below_all_modes_holds_none() -> None:
    vibration = WIRE.vibration(STEEL, 100.0)
    assert len(vibration.frequencies) == 0
    assert vibration.half_wave == 0.62


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"length": 0.0}, r"length of the string is 0.0 m: it must exceed 0"),
        ({"radius": -1e-3}, r"radius of the string is -0.001 m: it must exceed 0"),
        ({"tension": 0.0}, r"tension of the string is 0.0 N: it must exceed 0"),
        ({"tension": float("inf")}, r"tension of the string is inf N: it must exceed 0"),
    ],
)
def test_bad_strings_are_refused(wrong: dict[str, float], message: str) -> None:
    right = {"length": 0.62, "radius": 0.0005, "tension": 700.0}
    with pytest.raises(OptionError, match=message):
        String(**(right | wrong))  # type: ignore[arg-type]
