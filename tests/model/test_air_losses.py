"""Losses to the air: what gains do with them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

import struck
from struck.errors import OptionError
from struck.explorer.facts import change
from struck.model.air_losses import AirLosses
from struck.model.gains import ShapeGains
from struck.model.material import AIR
from struck.model.mesh import Mesh
from struck.radiation import by_name
from struck.solids import Block

FREQUENCIES = np.array([300.0, 900.0, 2700.0])


def losses(count: int = 3) -> AirLosses:
    values = np.arange(1.0, count + 1)
    return AirLosses(sound=values, surface=0.1 * values, uncertainty=np.full(count, 2.0))


def gains(name: str = "power") -> ShapeGains:
    body = trimesh.creation.icosphere(subdivisions=2, radius=0.1)
    surface = Mesh(points=np.array(body.vertices), faces=np.array(body.faces))
    shapes = np.random.default_rng(6).normal(size=(len(surface.points), 3, 3))
    return ShapeGains.radiating(surface, shapes, FREQUENCIES, np.zeros(3), by_name(name))


def of(gains: ShapeGains) -> AirLosses:
    assert gains.losses is not None
    return gains.losses


def test_total_is_the_sum() -> None:
    np.testing.assert_allclose(losses().total, 1.1 * losses().sound)


def test_sound_is_the_power_of_the_outputs() -> None:
    body = gains()
    # W = 4 pi r^2 p^2 / (2 rho c) of an energy of 1/2 J that falls at twice the decay rate.
    power = 4 * np.pi * np.abs(body.outputs) ** 2 / (2 * AIR.impedance)
    np.testing.assert_allclose(of(body).sound, power)


def test_relative_gains_have_none() -> None:
    assert gains("obrien2002").losses is None


@pytest.mark.parametrize(("size", "density"), [(3.0, 1.0), (1.0, 2.0), (0.2, 0.3)])
def test_scaled_losses_are_those_of_the_scaled_body(size: float, density: float) -> None:
    body = gains()
    computed = of(body.similar(size, density))
    again = of(body.changed(FREQUENCIES / size, np.arange(3), size, density))
    for name in ("sound", "surface", "uncertainty"):
        expected = getattr(again, name)
        np.testing.assert_allclose(getattr(computed, name), expected, rtol=1e-5, err_msg=name)


def test_weights_change_no_loss() -> None:
    body = gains()
    weighted = of(body.weighted(np.array([2, 0]), np.array([0.1, -5.0])))
    np.testing.assert_array_equal(weighted.sound, of(body).sound[[2, 0]])
    np.testing.assert_array_equal(weighted.uncertainty, of(body).uncertainty[[2, 0]])


def test_losses_must_fit_the_modes() -> None:
    body = gains()
    with pytest.raises(OptionError, match="losses"):
        ShapeGains(
            surface=body.surface,
            shapes=body.shapes,
            outputs=body.outputs,
            centre=body.centre,
            radiation=body.radiation,
            losses=losses(2),
        )
    with pytest.raises(OptionError, match="surface"):
        AirLosses(sound=np.ones(3), surface=np.ones(2), uncertainty=np.ones(3))
    with pytest.raises(OptionError, match="sound"):
        AirLosses(sound=-np.ones(3), surface=np.ones(3), uncertainty=np.ones(3))


def saved_and_loaded(model: struck.ModalModel, folder: Path) -> struck.ModalModel:
    struck.save(model, folder / "sheet.struck")
    return struck.load(folder / "sheet.struck")


FRICTION = struck.InternalFriction(loss_tangent=0.001, external=3.0)
RATES = {"frequencies": [100.0, 9000.0], "rates": [3.0, 30.0]}
# Changes of a model, and whether the law that it then has contains the air; None: that of before.
CHANGES: dict[str, tuple[Callable[[struck.ModalModel, Path], struck.ModalModel], bool | None]] = {
    "none": (lambda model, _: model, None),
    "saved": (saved_and_loaded, None),
    "another law": (lambda model, _: model.damped(FRICTION), False),
    "measured": (lambda model, _: model.damped(struck.Measured(**RATES)), True),
    "measured in vacuum": (
        lambda model, _: model.damped(struck.Measured(**RATES, contains_air=False)),
        False,
    ),
    "measured, and a law again": (
        lambda model, _: model.damped(struck.Measured(**RATES)).damped(FRICTION),
        False,
    ),
    "larger": (lambda model, _: model.scaled(1.7), None),
    "larger and back": (lambda model, _: model.scaled(1.7).scaled(1 / 1.7), None),
    "tuned": (lambda model, _: model.tuned(lowest=900.0), None),
    "of glass": (lambda model, _: model.made_of("glass"), False),
    "as heard": (lambda model, _: model.made_of(struck.Material.named("glass", "heard")), True),
    "changed in turn": (
        lambda model, folder: saved_and_loaded(model.made_of("glass").scaled(0.5), folder).damped(
            FRICTION
        ),
        False,
    ),
}


@pytest.fixture(scope="module", params=["own", "heard"])
def sheets(request: pytest.FixtureRequest) -> dict[bool, struck.ModalModel]:
    """Return a thin sheet with the air and without."""
    options = {"accuracy": "preview", "band": (20, 9000), "damping": request.param}
    block = Block(size=(0.1, 0.08, 0.001))
    return {
        air: struck.analyze(block, "steel", air=air, progress=None, **options)
        for air in (True, False)
    }


@pytest.mark.parametrize("air", [True, False])
@pytest.mark.parametrize("name", CHANGES)
def test_the_air_is_counted_once(
    name: str, *, air: bool, sheets: dict[bool, struck.ModalModel], tmp_path: Path
) -> None:
    change, contains = CHANGES[name]
    sheet = sheets[air]
    if contains is None:
        contains = isinstance(sheet.material.damping, struck.Rayleigh)
    changed = change(sheet, tmp_path)
    assert changed.air == air
    natural, law = changed.natural_frequencies, changed.material.damping
    assert isinstance(changed.gains, ShapeGains)
    expected = law.decays(natural)
    if air and not contains:
        expected = expected + 2 * np.pi * np.square(np.abs(changed.gains.outputs)) / AIR.impedance
        expected += of(changed.gains).surface
        assert np.max(expected / law.decays(natural)) > 1.05
    np.testing.assert_allclose(changed.decays, expected, rtol=1e-6)
    np.testing.assert_allclose(
        changed.frequencies, np.sqrt(natural**2 - (expected / (2 * np.pi)) ** 2), rtol=1e-9
    )


def test_twins_are_modes_of_one_frequency_in_any_order() -> None:
    bar = struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005)
    gains = struck.analyze(bar, "steel", band=(20, 8000)).gains
    assert isinstance(gains, ShapeGains)
    frequencies = np.array([810.0, 800.0])
    shapes = gains.shapes[:, :, :2]
    arguments = (gains.surface, shapes, frequencies, gains.centre, gains.radiation)
    falling = ShapeGains.radiating(*arguments).losses
    expected = ShapeGains.radiating(
        gains.surface, shapes[:, :, ::-1], frequencies[::-1], gains.centre, gains.radiation
    ).losses
    assert falling is not None
    assert expected is not None
    np.testing.assert_allclose(falling.sound, expected.sound[::-1])


@pytest.mark.parametrize("wishes", [{}, {"size": 1, "damping": 1, "material": "steel"}])
def test_a_change_to_the_same_body_keeps_its_decays(wishes: dict[str, object]) -> None:
    plate = struck.shapes.RectangularPlate(length=0.3, width=0.2, thickness=0.001)
    model = struck.analyze(plate, "steel", band=(20, 1000))
    assert (model.air_decays > 0.1 * model.decays).any()
    answer = change(model, wishes)
    np.testing.assert_allclose(answer["decays"], model.decays)
    np.testing.assert_allclose(answer["frequencies"], model.frequencies)
