"""Gains with a computed field: what they say of places, sizes and materials."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from struck.errors import ContactError, OptionError
from struck.model.damping import InternalFriction
from struck.model.gains import ShapeGains
from struck.radiation import by_name
from struck.radiation.directivity import RadiatingGains
from tests.radiation.sources import METAL, RADIUS, plain_ball, radiating_ball, some_sources

FAR = np.array([[0.5, 0.2, -0.3], [-0.09, 0.02, 0.05]])


def test_a_strike_is_heard_as_the_sources_say() -> None:
    model, sources = radiating_ball()
    distances = np.linalg.norm(FAR, axis=1)[:, None]
    heard = sources.pressure(FAR, np.arange(6)) * np.exp(1j * sources.wave_numbers * distances)
    found = model.gains.toward(FAR)[:, 0]
    assert np.all(np.abs(found - 1j * heard) < 0.02 * np.abs(heard).max(axis=0))
    assert model.gains.directional
    assert model.calibrated


def test_a_strike_begins_as_newton_has_it() -> None:
    # A source of volume flow Q cos wt sounds as rho w Q / 4 pi r times -sin w(t - r/c).
    frequencies = np.array([400.0])
    sources = replace(
        some_sources(frequencies, count=1), positions=np.zeros((1, 3)), strengths=np.array([[1j]])
    )
    model = plain_ball(frequencies)
    gains = RadiatingGains.of(model.gains, frequencies, [sources])
    np.testing.assert_allclose(gains.toward(np.array([[2.0, 0, 0]])), -0.5, rtol=1e-6)


def test_contacts_are_those_of_the_shapes() -> None:
    model, _ = radiating_ball()
    plain = plain_ball(model.natural_frequencies)
    point, push = np.array([[RADIUS, 0, 0]]), np.array([[-1.0, 0, 0]])
    np.testing.assert_array_equal(model.gains.at(point, push), plain.gains.at(point, push))
    assert not model.recorded


def test_a_larger_body_scales_exactly() -> None:
    model, _ = radiating_ball()
    larger = model.scaled(2.0)
    assert isinstance(larger.gains, RadiatingGains)
    found, wanted = larger.gains.toward(2 * FAR), model.gains.toward(FAR)
    np.testing.assert_allclose(found, wanted * 8**-0.5, rtol=1e-12)


def test_other_losses_keep_the_field() -> None:
    model, _ = radiating_ball()
    damped = model.damped(InternalFriction(loss_tangent=0.01))
    np.testing.assert_array_equal(damped.gains.toward(FAR), model.gains.toward(FAR))


def test_another_material_drops_to_the_estimate_and_says_so() -> None:
    model, _ = radiating_ball()
    other = model.made_of(replace(METAL, density=4000.0))
    assert type(other.gains) is ShapeGains
    assert any("compute the field anew" in note for note in other.provenance.dropped)
    assert not any("anew" in note for note in model.scaled(2).provenance.dropped)


def test_within_the_field_the_surface_is_needed() -> None:
    model, sources = radiating_ball()
    beside = np.array([[1.1 * RADIUS, 0, 0]])
    with pytest.raises(ContactError, match=r"0\.066 m .* in to 0\.072 m.*near=True"):
        model.gains.toward(beside)
    near, _ = radiating_ball(near=True)
    both = np.vstack([beside, FAR])
    heard = sources.pressure(beside, np.arange(6)) * np.exp(1.1j * RADIUS * sources.wave_numbers)
    np.testing.assert_allclose(near.gains.toward(both)[0, 0], 1j * heard[0], rtol=1e-12)
    np.testing.assert_array_equal(near.gains.toward(both)[1:], model.gains.toward(FAR))
    assert near.scaled(2.0).gains.near[0].modes.tolist() == list(range(6))


def test_nobody_listens_inside() -> None:
    model, _ = radiating_ball(near=True)
    with pytest.raises(ContactError, match="inside the body's surface"):
        model.gains.toward(np.array([[0.01, 0, 0]]))


def test_modes_without_a_field_keep_their_estimate() -> None:
    frequencies = np.array([500.0, 900.0, 1500.0])
    model = plain_ball(frequencies)
    part = replace(some_sources(frequencies[[1]]), modes=np.array([1]))
    gains = RadiatingGains.of(model.gains, frequencies, [part], near=True)
    for place in (FAR, np.array([[1.05 * RADIUS, 0, 0]])):
        found, estimate = gains.toward(place)[:, 0], model.gains.toward(place)[:, 0]
        np.testing.assert_allclose(np.abs(found[:, [0, 2]]), np.abs(estimate[:, [0, 2]]))


def test_relative_estimates_and_missing_modes_are_refused() -> None:
    model, sources = radiating_ball()
    relative = ShapeGains.radiating(
        model.geometry,
        model.gains.shapes,
        model.natural_frequencies,
        np.zeros(3),
        by_name("obrien2002"),
    )
    with pytest.raises(OptionError, match="radiation='power'"):
        RadiatingGains.of(relative, model.natural_frequencies, [sources])
    with pytest.raises(OptionError, match="compute the field of all modes"):
        replace(model.gains, field=model.gains.field.chosen(np.arange(3), 1.0, 1.0))
