"""The table of materials against its sources, and what a material refuses."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from struck.errors import MaterialError
from struck.model.damping import InternalFriction, Rayleigh
from struck.model.material import AIR, Material, materials

NAMES = sorted(materials())
FIELDS = {
    "group",
    "aliases",
    "density",
    "youngs_modulus",
    "poisson_ratio",
    "loss_tangent",
    "source",
}

# Wang & James 2019 (KleinPAT), table 4, also in the Khronos draft KHR_audio_rigid_bodies:
# density, Young's modulus, Poisson's ratio, alpha (mass), beta (stiffness); loss factor at 1 kHz
KLEINPAT = {
    "ceramic": (2700, 72e9, 0.19, 6, 1e-7, 0.001583),
    "glass": (2600, 62e9, 0.20, 1, 1e-7, 0.000787),
    "wood": (750, 11e9, 0.25, 60, 2e-6, 0.022116),
    "plastic": (1070, 1.4e9, 0.35, 30, 1e-6, 0.011058),
    "iron": (8000, 210e9, 0.28, 5, 1e-7, 0.001424),
    "polycarbonate": (1190, 2.4e9, 0.37, 0.5, 4e-7, 0.002593),
    "steel": (7850, 200e9, 0.29, 5, 3e-8, 0.000984),
    "tin": (7265, 50e9, 0.325, 2, 3e-8, 0.000507),
}

# Cremer & Heckl as quoted by Irvine 2004, table 1: density, Young's modulus, shear modulus,
# Poisson's ratio
CREMER_HECKL = {
    "aluminium": (2700, 72e9, 27e9, 0.34),
    "lead": (11300, 17e9, 6e9, 0.43),
    "gold": (19300, 80e9, 28e9, 0.423),
    "copper": (8900, 125e9, 46e9, 0.35),
    "magnesium": (1740, 43e9, 17e9, 0.29),
    "brass": (8500, 95e9, 36e9, 0.33),
    "nickel": (8900, 205e9, 77e9, 0.30),
    "silver": (10500, 80e9, 29e9, 0.37),
}

# O'Brien et al. 2002, table 1: alpha_1 multiplies the stiffness, alpha_2 the mass
OBRIEN = {"aluminium": (1e-7, 0), "oak": (8e-6, 50)}

# Where the families of materials lie (Ashby's charts), wide enough for each member and narrow
# enough that a lost power of ten falls out: density, Young's modulus, loss tangent
FAMILIES = {
    "metal": ((1700, 19500), (15e9, 215e9), (5e-5, 3e-2)),
    "glass": ((2200, 3300), (55e9, 75e9), (3e-4, 3e-3)),
    "ceramic": ((2200, 4000), (50e9, 410e9), (5e-5, 3e-3)),
    "stone": ((2200, 3000), (20e9, 80e9), (1e-3, 2e-2)),
    "wood": ((400, 1000), (8e9, 16e9), (4e-3, 2e-2)),
    "plastic": ((900, 1500), (1e9, 5e9), (5e-3, 6e-2)),
    "other": ((900, 1000), (1e6, 10e9), (5e-3, 0.3)),
}


@pytest.mark.parametrize("name", NAMES)
def test_entry_loads_with_source_and_lies_in_its_family(name: str) -> None:
    entry = materials()[name]
    assert set(entry) - {"heard", "heard_bowl"} == FIELDS
    densities, moduli, losses = FAMILIES[entry["group"]]
    material = Material.named(name)
    assert material.name == name
    assert material.source == entry["source"]
    assert len(material.source) > len("constants: ")
    assert "  " not in material.source
    assert densities[0] <= material.density <= densities[1]
    assert moduli[0] <= material.youngs_modulus <= moduli[1]
    assert 0.15 <= material.poisson_ratio <= 0.49
    assert isinstance(material.damping, InternalFriction)
    assert losses[0] <= material.damping.loss_tangent <= losses[1]


def test_there_are_enough_of_each_family() -> None:
    groups = [entry["group"] for entry in materials().values()]
    assert len(groups) >= 25
    assert set(groups) == set(FAMILIES)
    assert all(groups.count(group) >= 2 for group in FAMILIES)


def test_names_and_aliases_are_unambiguous_and_found_in_any_spelling() -> None:
    spoken = [*materials(), *(a for entry in materials().values() for a in entry["aliases"])]
    assert len(set(spoken)) == len(spoken)
    for name, entry in materials().items():
        for word in (name, *entry["aliases"]):
            spelling = f" {word.replace(' ', '-').title()} "
            assert Material.named(spelling).name == name


@pytest.mark.parametrize("name", KLEINPAT)
def test_kleinpat_set(name: str) -> None:
    density, youngs, poisson, alpha, beta, loss_factor = KLEINPAT[name]
    heard = Material.named(name, damping="heard")
    assert (heard.density, heard.youngs_modulus, heard.poisson_ratio) == (density, youngs, poisson)
    assert heard.damping == Rayleigh(mass=alpha, stiffness=beta, contains_air=True)
    # the loss factor of a mode is 2 d / omega
    loss = heard.damping.decays(1000.0) / (np.pi * 1000.0)
    assert loss == pytest.approx(loss_factor, abs=6e-7)


@pytest.mark.parametrize("name", CREMER_HECKL)
def test_cremer_heckl_constants_are_those_of_an_isotropic_solid(name: str) -> None:
    density, youngs, shear, poisson = CREMER_HECKL[name]
    material = Material.named(name)
    assert (material.density, material.youngs_modulus) == (density, youngs)
    assert material.poisson_ratio == poisson
    # the three printed constants hold E = 2 G (1 + nu) to their two digits
    assert material.shear_modulus == pytest.approx(shear, rel=0.03)


@pytest.mark.parametrize(("name", "printed"), [("zinc", 13.1e9), ("tin", 4.4e9)])
def test_two_moduli_of_cremer_heckl_are_ten_times_too_low(name: str, printed: float) -> None:
    usual = Material.named(name).youngs_modulus
    assert 7 < usual / printed < 13
    assert "ten times too low" in Material.named(name).source


@pytest.mark.parametrize("name", OBRIEN)
def test_obrien_set_keeps_mass_and_stiffness_apart(name: str) -> None:
    alpha_1, alpha_2 = OBRIEN[name]
    heard = Material.named(name, damping="heard").damping
    assert heard == Rayleigh(mass=alpha_2, stiffness=alpha_1, contains_air=True)


def test_bowl_1_of_2002_decays_as_printed() -> None:
    bowl = Material.named("aluminium", damping="heard_bowl").damping
    assert bowl.decays(551.3).item() == pytest.approx(15.6, abs=0.05)  # table 1


def test_ice_is_the_average_of_its_crystal() -> None:
    # Gammon et al. 1983, monocrystal at -16 degrees Celsius, Pa; Hill's mean of Voigt and Reuss
    c11, c12, c13, c33, c44 = np.array([139.29, 70.82, 57.65, 150.10, 30.14]) * 1e8
    stiffness = np.diag([c11, c11, c33, c44, c44, (c11 - c12) / 2])
    stiffness[:3, :3] = [[c11, c12, c13], [c12, c11, c13], [c13, c13, c33]]
    compliance = np.linalg.inv(stiffness)
    bulk = (stiffness[:3, :3].sum() / 9 + 1 / compliance[:3, :3].sum()) / 2
    shear = (voigt_shear(stiffness) + reuss_shear(compliance)) / 2
    ice = Material.named("ice")
    assert ice.youngs_modulus == pytest.approx(9 * bulk * shear / (3 * bulk + shear), rel=2e-3)
    assert ice.poisson_ratio == pytest.approx(
        (3 * bulk - 2 * shear) / (6 * bulk + 2 * shear), rel=2e-3
    )


def voigt_shear(stiffness: np.ndarray) -> float:
    normal, rest = np.trace(stiffness[:3, :3]), np.trace(stiffness[3:, 3:])
    crossed = stiffness[0, 1] + stiffness[0, 2] + stiffness[1, 2]
    return (normal - crossed + 3 * rest) / 15


def reuss_shear(compliance: np.ndarray) -> float:
    normal, rest = np.trace(compliance[:3, :3]), np.trace(compliance[3:, 3:])
    crossed = compliance[0, 1] + compliance[0, 2] + compliance[1, 2]
    return 15 / (4 * normal - 4 * crossed + 3 * rest)


@pytest.mark.parametrize(
    ("wrong", "right"),
    [("steal", "steel"), ("Aluminuim", "aluminium"), ("porcelan", "porcelain"), ("glas", "glass")],
)
def test_unknown_name_offers_the_nearest(wrong: str, right: str) -> None:
    with pytest.raises(MaterialError, match=rf"{wrong!r}: did you mean .*\b{right}\b.*\?"):
        Material.named(wrong)


def test_name_like_no_other_says_where_all_are_listed() -> None:
    with pytest.raises(MaterialError, match=r"'qqqq': 'struck materials' lists all \d+") as caught:
        Material.named("qqqq")
    assert "did you mean" not in str(caught.value)


def test_missing_and_misspelt_damping_sets_are_refused() -> None:
    with pytest.raises(MaterialError, match="granite has no published set 'as heard'"):
        Material.named("granite", damping="heard")
    with pytest.raises(MaterialError, match="steel has no published set 'as heard of a bowl'"):
        Material.named("steel", damping="heard_bowl")
    with pytest.raises(MaterialError, match="damping is 'loud': give one of own, heard, heard_"):
        Material.named("steel", damping="loud")


@pytest.mark.parametrize("poisson", [0.5, 0.4999, -1.0, 1.2, math.nan])
def test_impossible_poisson_ratio_is_refused_with_the_way_out(poisson: float) -> None:
    with pytest.raises(MaterialError, match=rf"is {poisson}: .*above -1.*0\.495.*take 0\.49"):
        Material(density=1000, youngs_modulus=1e6, poisson_ratio=poisson)


@pytest.mark.parametrize("value", [0.0, -1.0, math.inf, math.nan])
def test_density_and_modulus_must_be_positive_and_finite(value: float) -> None:
    with pytest.raises(
        MaterialError, match=rf"density of custom is {value} kg.m.3: it must exceed 0"
    ):
        Material(density=value, youngs_modulus=1e9, poisson_ratio=0.3)
    with pytest.raises(MaterialError, match=rf"Young's modulus of custom is {value}"):
        Material(density=1000, youngs_modulus=value, poisson_ratio=0.3)


@pytest.mark.parametrize(
    ("first", "shear"), [(1e9, 0.0), (-1e9, 1e9), (1e9, -1e9), (math.nan, 1e9)]
)
def test_lame_constants_of_no_solid_are_refused(first: float, shear: float) -> None:
    with pytest.raises(MaterialError, match="Lame's constants of custom"):
        Material.from_lame(
            first=first, shear=shear, density=1000, damping=InternalFriction(loss_tangent=0)
        )


@given(st.floats(1e6, 1e12), st.floats(-0.99, 0.49))
def test_lame_constants_lead_back_to_the_material(youngs: float, poisson: float) -> None:
    material = Material(density=1000, youngs_modulus=youngs, poisson_ratio=poisson)
    again = Material.from_lame(
        first=material.first_lame,
        shear=material.shear_modulus,
        density=1000,
        damping=material.damping,
    )
    assert again.youngs_modulus == pytest.approx(youngs, rel=1e-9)
    assert again.poisson_ratio == pytest.approx(poisson, rel=1e-9, abs=1e-12)


@given(st.floats(1e6, 1e12), st.floats(-0.99, 0.49))
def test_lame_constants_are_those_of_hookes_law(youngs: float, poisson: float) -> None:
    # a bar pulled along x: stress E, no stress across, from the stiffness matrix of Lame
    material = Material(density=1000, youngs_modulus=youngs, poisson_ratio=poisson)
    stiffness = material.first_lame * np.ones((3, 3)) + 2 * material.shear_modulus * np.eye(3)
    stress = stiffness @ [1, -poisson, -poisson]
    scale = np.abs(stiffness).max()
    np.testing.assert_allclose(stress, [youngs, 0, 0], rtol=0, atol=1e-12 * scale)


def test_damped_changes_the_losses_alone() -> None:
    steel = Material.named("steel")
    muffled = steel.damped(Rayleigh(mass=80, stiffness=0))
    assert muffled.damping == Rayleigh(mass=80, stiffness=0)
    assert muffled.damped(steel.damping) == steel


def test_air_is_a_gas() -> None:
    laplace = np.sqrt(1.4 * 101325 / AIR.density)  # Laplace: adiabatic sound in an ideal gas
    assert AIR.sound_speed == pytest.approx(laplace, rel=1e-3)


@pytest.mark.parametrize(
    ("modulus", "density", "told"),
    [
        (200.0, 7850.0, "200 GPa is 200e9"),
        (69.0, 2700.0, "69 GPa is 69e9"),
        (210_000.0, 7850.0, "210000 MPa is 210000e6"),  # N/mm^2
        (70_000.0, 2500.0, "70000 MPa is 70000e6"),
        (11.0, 600.0, "11 GPa is 11e9"),
    ],
)
def test_a_modulus_in_another_unit_is_told(modulus: float, density: float, told: str) -> None:
    meant = Material(density=density, youngs_modulus=modulus, poisson_ratio=0.3)
    assert meant.doubt.endswith(told)
    assert "m/s" in meant.doubt


def test_a_density_and_a_modulus_in_other_units_are_told() -> None:
    meant = Material(density=7.8, youngs_modulus=200, poisson_ratio=0.3)
    assert meant.doubt.endswith("in g/cm3, it is 7800 kg/m3, and 200 GPa is 200e9")


@pytest.mark.parametrize(
    ("modulus", "density"), [(200e9, 7.85), (78e9, 19.3), (70e9, 2.7), (2e8, 7.85)]
)
def test_a_density_in_another_unit_is_told(modulus: float, density: float) -> None:
    meant = Material(density=density, youngs_modulus=modulus, poisson_ratio=0.3)
    assert meant.doubt.endswith(f"in g/cm3, it is {1000 * density:g} kg/m3")


def test_no_true_material_is_doubted() -> None:
    rubber = Material(density=1100, youngs_modulus=3e5, poisson_ratio=0.49)
    without_units = Material(density=1.0, youngs_modulus=2.6, poisson_ratio=0.3)
    assert not rubber.doubt
    assert not without_units.doubt
    assert not any(Material.named(name).doubt for name in NAMES)


def test_text_for_a_modulus_is_told_with_its_unit() -> None:
    with pytest.raises(
        TypeError, match="youngs_modulus is '200 GPa': Material takes a number in Pa"
    ):
        Material(density=7850, youngs_modulus="200 GPa", poisson_ratio=0.3)  # pyright: ignore[reportArgumentType]
