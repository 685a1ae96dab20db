"""Tuning of solids and shapes, by number and by family of the mode, against closed forms."""

from __future__ import annotations

import math
import re
from functools import partial

import numpy as np
import pytest

import struck
from struck.analysis import tune
from struck.analysis.tuning import _Mode
from struck.errors import OptionError
from struck.model import Material
from struck.shapes import Bar, CircularMembrane, CircularPlate, String
from struck.solids import Block, Revolution, Tube
from struck.solids.revolution import bowl, wine_glass

STEEL = Material(density=7850.0, youngs_modulus=200e9, poisson_ratio=0.29)
SLENDER = Bar(length=0.3, width=0.03, thickness=0.005, theory="euler-bernoulli")
TUBE = Tube(length=0.4, radius=0.0125, wall=0.001, elements=(8, 12, 1))
# Of a free bar by Euler and Bernoulli, roots of cos x cosh x = 1.
ROOTS = (4.730040744862704, 7.853204624095838, 10.995607838001671)


def bending(bar: Bar, number: int) -> float:
    waves = math.sqrt(STEEL.youngs_modulus / STEEL.density / 12) * bar.thickness / bar.length**2
    return ROOTS[number - 1] ** 2 * waves / (2 * math.pi)


@pytest.mark.parametrize("mode", [1, "2", "bending 3"])
@pytest.mark.parametrize("vary", ["length", "thickness"])
def test_a_bar_of_a_formula_is_tuned_by_each_mode(mode: int | str, vary: str) -> None:
    found = tune(SLENDER, STEEL, vary=vary, frequency="A5", mode=mode)
    number = int(str(mode)[-1])
    times = 880.0 / bending(SLENDER, number)
    wanted = {"length": 0.3 / math.sqrt(times), "thickness": 0.005 * times}[vary]
    assert getattr(found.body, vary) == pytest.approx(wanted, rel=1e-6)
    assert found.before == pytest.approx((getattr(SLENDER, vary), bending(SLENDER, number)))
    assert found.after == pytest.approx((wanted, 880.0))
    assert struck.tune(SLENDER, STEEL, vary=vary, frequency=880, mode=mode) == found.body


def test_strings_are_tuned_by_their_tension() -> None:
    string = String(length=0.65, radius=0.0003, tension=60.0)
    mass = math.pi * 0.0003**2 * STEEL.density  # kg/m
    tuned = struck.tune(string, STEEL, vary="tension", lowest="E3")
    hertz = 440 * 2 ** (-17 / 12)
    stiff = tuned.vibration(STEEL, 2 * hertz).frequencies[0] / hertz
    assert stiff == pytest.approx(1.0, rel=1e-6)
    assert tuned.tension == pytest.approx(mass * (2 * 0.65 * hertz) ** 2, rel=0.01)


@pytest.mark.parametrize(
    ("mode", "speed", "within"),
    [
        ("torsion", math.sqrt(STEEL.shear_modulus / STEEL.density), 5e-4),  # exact of round tubes
        ("stretching", math.sqrt(STEEL.youngs_modulus / STEEL.density), 0.005),  # of slender ones
    ],
)
def test_a_tube_is_tuned_by_its_half_waves(mode: str, speed: float, within: float) -> None:
    found = tune(TUBE, STEEL, vary="length", frequency=4000.0, mode=mode)
    assert found.body.length == pytest.approx(speed / (2 * 4000.0), rel=within)


def test_a_shape_twists_as_its_solid() -> None:
    """Of a thin strip: torsion goes with thickness over width (Saint-Venant), bending stays."""
    strip = Bar(length=0.3, width=0.03, thickness=0.005)
    found = tune(strip, STEEL, vary="width", frequency=3000.0, mode="torsion", accuracy="preview")
    ratio = 0.005 / found.body.width
    stiffness = (1 - 0.63 * ratio) / 3 * 12 / (1 + ratio**2)  # its share of the polar moment
    speed = math.sqrt(STEEL.shear_modulus / STEEL.density * stiffness) * ratio
    assert speed / (2 * 0.3) == pytest.approx(3000.0, rel=0.03)


@pytest.mark.prove
def test_a_pair_of_one_frequency_is_one_of_its_family() -> None:
    second = tune(TUBE, STEEL, vary="length", frequency=2000.0, mode="bending 2")
    third = tune(TUBE, STEEL, vary="length", frequency=2000.0, mode=3)
    assert second.body.length == pytest.approx(third.body.length, rel=1e-5)


def test_what_was_changed_is_said() -> None:
    told: list[str] = []
    found = tune(SLENDER, STEEL, vary="length", lowest=880, progress=lambda s, _: told.append(s))
    cents = 1200 * np.log2(880 / bending(SLENDER, 1))
    assert str(found) == (
        f"length 0.3 -> {found.body.length:.7g} ({100 * (found.body.length / 0.3 - 1):+.2f} %): "
        f"mode 1 {bending(SLENDER, 1):.2f} -> 880.00 Hz ({cents:+.0f} cents)"
    )
    assert told[-1] == f"tuned: {found}"


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"lowest": 880, "mode": "wobble 2"}, "mode is 'wobble 2': .*bending, torsion, stretch"),
        ({"frequency": 880, "mode": "torsoin"}, "did you mean torsion"),
        ({"frequency": 880, "mode": 0}, "mode is 0: .*modes are counted from 1"),
        ({"lowest": 880, "mode": 2}, "lowest is 880.0, but mode is 'mode 2': give frequency="),
        ({}, "no frequency is given to tune to: give one of lowest= and frequency="),
        ({"lowest": 880, "frequency": 880}, "lowest is 880.0 and frequency is 880.0: give one"),
        ({"lowest": 880, "accuracy": "fine"}, "accuracy='fine' does not apply to a bar"),
        ({"frequency": 880, "mode": 90}, "'mode 90', and up to 64 times .* there are 20 in all"),
        ({"lowest": 880, "vary": "lenght"}, "vary is 'lenght': did you mean length.* width"),
    ],
)
def test_what_cannot_be_tuned_is_refused(given: dict, words: str) -> None:
    with pytest.raises(OptionError, match=words):
        tune(SLENDER, STEEL, **{"vary": "length", **given})


def test_a_solid_has_a_second_mode() -> None:
    block = Block(size=(0.3, 0.03, 0.005), elements=(8, 1, 1))
    with pytest.raises(OptionError, match="this body has length, width, height to vary"):
        tune(block, STEEL, vary="size", frequency=500.0, mode=2)


def test_a_block_is_tuned_by_its_edges() -> None:
    made = tune(
        Block(size=(0.3, 0.03, 0.02)), "rosewood", vary="length", frequency=1760.0,
        mode="bending 2", accuracy="preview",
    )  # fmt: skip
    assert made.after[1] == pytest.approx(1760, rel=1e-3)
    assert made.body.size[1:] == (0.03, 0.02)
    assert made.body.size[0] == made.after[0] != 0.3
    with pytest.raises(OptionError, match="this body has length, width, height to vary"):
        tune(Block(size=(0.3, 0.03, 0.02)), "rosewood", vary="radius", lowest=1760.0)
    with pytest.raises(
        OptionError, match=r"no numbers .*partial\(bowl, .* scale its model by ModalModel"
    ):
        tune(bowl(radius=0.06, height=0.05, wall=0.002), "bronze", vary="wall", lowest=440.0)


def drum(*, radius: float = 0.2, tension: float = 300.0) -> CircularMembrane:
    """Return a drum; all its arguments have values."""
    return CircularMembrane(radius=radius, thickness=2e-4, tension=tension)


def test_a_function_with_defaults_is_tuned_without_more() -> None:
    found = tune(drum, "mylar", vary="tension", lowest="A3")
    assert found.body.tension == found.after[0]
    assert found.after == tune(partial(drum), "mylar", vary="tension", lowest="A3").after
    assert found.after[1] == pytest.approx(220.0, rel=1e-6)


def stick(length: float) -> Tube:
    """Return a rod; its argument has no value."""
    return Tube(length=length, radius=0.01, wall=0.01)


def test_a_function_without_defaults_is_told_how_to_give_values() -> None:
    with pytest.raises(
        OptionError, match=r"stick has no value for length: .*partial\(stick, length="
    ):
        tune(stick, "bronze", vary="length", lowest=440.0)


@pytest.mark.parametrize("notes", ["C4,D4", "C4 D4", ["C4", "D4"], (261.0, 293.0)])
def test_several_notes_are_refused_with_a_way_out(notes: object) -> None:
    with pytest.raises(OptionError, match=r"call (tune|it) once for each"):
        tune(SLENDER, STEEL, vary="length", lowest=notes)


@pytest.mark.prove
def test_rounding_in_the_elements_refuses_no_tuning() -> None:
    """Frequencies of a long tube differ by 1e-5 where its lengths hardly do."""
    tube = Tube(length=3.9, radius=0.0125, wall=0.001, elements=(8, 12, 1))
    for hertz in (10.0, 2.0):
        found = tune(tube, STEEL, vary="length", lowest=hertz)
        assert found.after[1] == pytest.approx(hertz, rel=5e-4)
        assert found.body.length == found.after[0]


@pytest.mark.prove
def test_what_is_not_reached_tells_what_was_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    tube = Tube(length=0.5, radius=0.0125, wall=0.001, elements=(8, 12, 1))
    with pytest.raises(OptionError) as refused:
        tune(tube, STEEL, vary="wall", frequency="D6", mode=5)
    told = re.fullmatch(
        r"wall cannot bring mode 5 to 1174.659 Hz: between wall = 0.001 and (0.01\d+) it rings at "
        r"(\d+\.?\d*) to (\d+\.?\d*) Hz, nearest at (\S+) Hz with wall = (0.01\d+); check the "
        r"lengths \(m\), or vary another dimension or mode",
        str(refused.value),
    )
    assert told is not None
    thickest, low, high, nearest, wall = map(float, told.groups())
    assert 0.012 < thickest <= 0.0125
    assert wall == pytest.approx(thickest, rel=1e-4)
    assert 1174.659 < nearest == low < high

    def jumps(_mode: _Mode, body: Bar, *_: object) -> float:
        return (30.0 if body.length > 0.3 else 30.3) / body.length

    monkeypatch.setattr(_Mode, "natural", jumps)
    with pytest.raises(OptionError, match=r"to 100\.5 Hz: .* nearest at (101|9\d\.\d+) Hz "):
        tune(SLENDER, STEEL, vary="length", lowest=100.5)


def test_a_step_beyond_what_a_body_allows_is_shortened(monkeypatch: pytest.MonkeyPatch) -> None:
    """A frequency that falls late, as the wall fills the tube, and a step that goes past that."""

    def falls(_mode: _Mode, tube: Tube, *_: object) -> float:
        return 100.0 * math.sqrt(1 - (tube.wall / tube.radius) ** 4 / 2)

    monkeypatch.setattr(_Mode, "natural", falls)
    thin = Tube(length=0.5, radius=0.0125, wall=0.005)
    found = tune(thin, STEEL, vary="wall", lowest=100 * math.sqrt(1 - 0.98**4 / 2))
    assert found.body.wall == pytest.approx(0.98 * 0.0125, rel=1e-6)


@pytest.mark.parametrize(
    ("body", "vary"),
    [
        (partial(bowl, height=0.05), "radius"),
        (wine_glass, "height"),
        (CircularPlate(radius=0.1, thickness=0.002), "radius"),
        (String(length=0.65, radius=0.0003, tension=60.0), "tension"),
        (Tube(length=0.005, radius=0.05, wall=0.05), "radius"),
    ],
)
def test_bodies_without_families_are_tuned_by_number(body: object, vary: str) -> None:
    for family in ("bending", "torsion 2"):
        with pytest.raises(
            OptionError, match=rf"mode is '{family}', but .* this is a [a-z ]+: .* as mode=2"
        ):
            tune(
                partial(body) if callable(body) else body,
                STEEL,
                vary=vary,
                frequency=900,
                mode=family,
            )


@pytest.mark.prove
def test_turned_rods_have_families_and_hinged_bars_bend() -> None:
    def rod(length: float = 0.3) -> Revolution:
        return Revolution(profile=[(0.01, 0), (0.01, length)], smooth=False, elements=(8, 12, 1))

    speed = math.sqrt(STEEL.shear_modulus / STEEL.density)
    found = tune(partial(rod), STEEL, vary="length", frequency=4000.0, mode="torsion")
    assert found.after[0] == pytest.approx(speed / (2 * 4000.0), rel=1e-3)
    hinged = Bar(length=0.3, width=0.03, thickness=0.005, ends="hinged")
    assert tune(hinged, STEEL, vary="length", frequency=900, mode="bending").mode == "bending 1"
    with pytest.raises(OptionError, match=r"'hinged': .* or let go \('free'\); tune its bending$"):
        tune(hinged, STEEL, vary="length", frequency=900, mode="torsion")
