"""Pictures of timbre fields: what they say of sources whose pattern is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

import struck
from struck.cli import main
from struck.errors import OptionError
from struck.radiation.directivity import RadiatingGains
from tests.radiation.sources import RADIUS, plain_ball, radiating_ball, some_sources


def test_a_dipole_is_4_8_db_louder_along_its_axis_than_on_average() -> None:
    frequencies = np.array([20.0])
    plain = plain_ball(frequencies, 0)
    pair = replace(
        some_sources(frequencies, count=2),
        positions=np.array([[0.01, 0, 0], [-0.01, 0, 0]]),
        strengths=np.array([[1.0], [-1.0]]),
    )
    model = replace(plain, gains=RadiatingGains.of(plain.gains, frequencies, [pair]))
    figure = struck.show(model, field=0)
    assert "20 Hz, loudest 4.8 dB above" in figure.get_suptitle()
    above = figure.axes[1].lines[0].get_ydata()  # along x loud, along y silent
    np.testing.assert_allclose(np.asarray(above)[[0, 180]], 30.0, atol=0.1)
    assert np.asarray(above)[90] < 5


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
        with pytest.raises(OptionError, match="number of a mode, 0 to 5, or 'brightness'"):
            struck.show(model, field=wrong)
