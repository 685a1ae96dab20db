"""Pictures of timbre fields: what they say of sources whose pattern is known."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import struck
from struck import ModalModel, Strike
from struck.cli import main
from struck.errors import OptionError
from struck.model.timbre_table import SinglePoint
from struck.radiation.directivity import RadiatingGains
from struck.report import blow_response, grid_picture
from struck.report.surface_picture import Painter
from struck.shapes import RectangularMembrane
from tests.radiation.sources import RADIUS, plain_ball, radiating_ball, some_sources


def dipole() -> ModalModel:
    """Return a model of one mode that sounds as two opposite sources along x."""
    frequencies = np.array([20.0])
    plain = plain_ball(frequencies, 0)
    pair = replace(
        some_sources(frequencies, count=2),
        positions=np.array([[0.01, 0, 0], [-0.01, 0, 0]]),
        strengths=np.array([[1.0], [-1.0]]),
    )
    return replace(plain, gains=RadiatingGains.of(plain.gains, frequencies, [pair]))


def test_a_dipole_is_4_8_db_louder_along_its_axis_than_on_average() -> None:
    figure = struck.show(dipole(), field=0)
    assert "mode 1: 20 Hz, loudest 4.8 dB above" in figure.get_suptitle()
    above = figure.axes[1].lines[0].get_ydata()  # along x loud, along y silent
    np.testing.assert_allclose(np.asarray(above)[[0, 180]], 30.0, atol=0.1)
    assert np.asarray(above)[90] < 5


@pytest.mark.prove
def test_a_plane_where_nothing_is_heard_is_grey_and_the_struck_place_is_named() -> None:
    model = dipole()
    contact = model.contact()
    for places, name in (
        ({"knob": contact.point}, "knob"),
        ({}, r"\(.*, .*, .*\) m"),
    ):
        figure = struck.show(replace(model, places=places), field="brightness")
        assert re.match(rf"brightness of a strike at {name}: .*\ngrey: ", figure.get_suptitle())
    above, front, side = (
        np.ma.filled(axes.collections[0].get_array().astype(float), np.nan)
        for axes in figure.axes[:3]
    )
    assert np.isnan(side).all()  # halfway between the two sources
    for values in (above, front):
        assert np.nanmax(values) == pytest.approx(20.0)
        assert np.isnan(values[:, 60]).all()
        assert np.isfinite(values[10, :50]).all()


@pytest.mark.parametrize("near", [False, True])
def test_slices_are_coloured_where_the_field_is_known(near: bool) -> None:  # noqa: FBT001
    model, _ = radiating_ball(near=near)
    figure = struck.show(model, field="brightness")
    values = np.ma.filled(figure.axes[0].collections[0].get_array().astype(float), np.nan)
    line = np.linspace(-4, 4, 121) * RADIUS
    distances = np.hypot(*np.meshgrid(line, line))
    assert np.isfinite(values[distances > 1.21 * RADIUS]).all()
    assert np.isnan(values[distances < 0.9 * RADIUS]).all()
    assert np.isfinite(values[distances < 1.19 * RADIUS]).any() == near
    place = np.array([[line[100], line[10], 0.0]])
    contact = model.contact(None)
    drives = model.gains.at(contact.point[None], contact.direction[None])[0, 0]
    powers = np.abs(model.gains.toward(place)[0, 0] * drives) ** 2 / model.decays
    assert values[10, 100] == pytest.approx(powers @ model.frequencies / powers.sum())


@pytest.mark.prove
def test_the_shell_draws_fields(tmp_path: Path) -> None:
    struck.save(radiating_ball()[0], tmp_path / "a.struck")
    picture = tmp_path / "a.png"
    assert main(["show", str(tmp_path / "a.struck"), "-o", str(picture), "--field", "2"]) == 0
    assert matplotlib.image.imread(picture).std() > 0.05


def test_what_has_no_field_or_no_such_mode_is_told() -> None:
    model, _ = radiating_ball()
    with pytest.raises(OptionError, match="no timbre field"):
        struck.show(plain_ball(model.natural_frequencies), field=0)
    for wrong in (6, -1, "loudness"):
        with pytest.raises(OptionError, match="index of a mode, from 0 to 5, or 'brightness'"):
            struck.show(model, field=wrong)


def a_membrane() -> struck.ModalModel:
    shape = RectangularMembrane(length=0.3, width=0.3, thickness=1e-4, tension=30_000.0)
    return struck.analyze(shape, "steel", band=(20, 2000))


def plain_recording() -> ModalModel:
    """Return a model of recordings at one place."""
    model = a_membrane()
    single = SinglePoint(outputs=np.ones(len(model.frequencies), complex))
    return replace(model, gains=single, geometry=None, places={})


def test_the_response_to_a_blow_is_that_of_the_integrated_modes() -> None:
    model = a_membrane()
    strike = Strike(at=(0.07, 0.1), impulse=1e-3, duration=4e-4)
    instant = 1e-3  # from the begin of the blow
    _, moved = blow_response(model, strike, np.array([instant - 2e-4]))
    contact = model.contact(strike.at)
    drives = model.gains.at(contact.point[None], contact.direction[None]).reshape(-1)

    def force(time: float) -> float:
        return 1e-3 * np.pi / 8e-4 * np.sin(np.pi * time / 4e-4) * (time < 4e-4)

    def motion(time: float, state: np.ndarray) -> np.ndarray:
        place, speed = state.reshape(2, -1)
        pull = -np.square(2 * np.pi * model.natural_frequencies) * place - 2 * model.decays * speed
        return np.concatenate([speed, pull + drives * force(time)])

    rest = np.zeros(2 * len(drives))
    solved = solve_ivp(motion, (0, instant), rest, rtol=1e-9, atol=1e-15, max_step=2e-5)
    modal = solved.y[: len(drives), -1]
    np.testing.assert_allclose(moved[0], model.gains.shapes @ modal, atol=2e-3 * abs(moved).max())


def test_blow_and_answer_change_places() -> None:
    model = a_membrane()
    points = model.gains.surface.points
    inside = np.flatnonzero(np.abs(points[:, :2] - 0.15).max(axis=1) < 0.1)[[3, 40]]
    times = np.array([3e-4, 8e-4])
    down = {"impulse": 1e-3, "direction": (0, 0, -1)}
    there, back = (
        blow_response(model, Strike(at=points[here], **down), times)[1][:, other, 2]
        for here, other in (inside, inside[::-1])
    )
    np.testing.assert_allclose(there, back, rtol=1e-4)


def test_modes_are_drawn_as_many_as_are_asked_for() -> None:
    figure = struck.show(a_membrane(), modes=9)
    titles = [axes.get_title() for axes in figure.axes if axes.get_title()]
    hertz = np.array([float(title.split()[1]) for title in titles])
    waves = np.sort(np.hypot(*np.meshgrid(np.arange(1, 6), np.arange(1, 6))).ravel())[:9]
    np.testing.assert_allclose(hertz / hertz[0], waves / waves[0], rtol=3e-4)


def test_a_surface_is_seen_from_the_side_that_is_struck() -> None:
    model = a_membrane()
    figure = struck.show(model, strike=Strike(at="middle"))
    assert len([axes for axes in figure.axes if "after the blow" in axes.get_title()]) == 4
    painter = Painter.of(model.geometry)
    assert painter.toward(-painter.view[2]).view[2] @ painter.view[2] < 0


def test_contacts_and_listeners_of_a_plan_are_drawn_where_they_are(tmp_path: Path) -> None:
    contacts, listeners = np.array([[0.1, 0, 0.3], [0.1, 0, 0.0]]), np.eye(3)
    axes = grid_picture(contacts, listeners, surface=a_membrane().geometry).axes[0]
    dots = next(each for each in axes.collections if "3 listeners" in each.get_label())
    np.testing.assert_array_equal(np.transpose(dots._offsets3d), listeners)
    plan = tmp_path / "plan.toml"
    plan.write_text(
        "seconds = 1.0\ncontacts = [[1.0], [0.0]]\nlisteners = [[0, 0, 1], [1, 0, 0]]\n"
    )
    picture = tmp_path / "a.png"
    assert main(["show", str(plan), "-o", str(picture)]) == 2  # how long is a unit?
    assert main(["show", str(plan), "-o", str(picture), "--pitch", "0.3"]) == 0
    assert matplotlib.image.imread(picture).std() > 0.05
    plan.write_text("seconds = 1.0\ncontacts = [[1.0], [0.0]]\n")
    assert main(["show", str(plan), "-o", str(picture), "--pitch", "0.3"]) == 2


def test_pictures_that_cannot_be_drawn_are_refused() -> None:
    model = a_membrane()
    with pytest.raises(OptionError, match="field and modes are two pictures"):
        struck.show(model, field=0, modes=3)
    for wrong in (0, 65):
        with pytest.raises(OptionError, match="give 1 to"):
            struck.show(model, modes=wrong)
    with pytest.raises(OptionError, match="no mode shapes to draw"):
        struck.show(plain_recording(), strike=Strike())
    with pytest.raises(OptionError, match="numbers"):
        grid_picture([[0, 0]], [[1, 1, 1]])
