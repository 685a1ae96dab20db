"""Closed forms as models: contacts, files, other sizes and materials, errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import struck
from struck.errors import ContactError, MaterialError, OptionError
from struck.model.gains import ShapeGains
from struck.shapes import Bar, CircularMembrane, CircularPlate, RectangularPlate, String
from tests.shapes.bodies import BODIES, FILM, STEEL, WOOD

Array = NDArray[np.float64]


@pytest.fixture(scope="module", params=BODIES)
def model(request: pytest.FixtureRequest) -> struck.ModalModel:
    """A model of each kind."""
    shape, material, highest = BODIES[request.param]
    return struck.analyze(shape, material, band=(20, highest), radiation="heuristic1998")


def gains(model: struck.ModalModel) -> ShapeGains:
    assert isinstance(model.gains, ShapeGains)
    return model.gains


def inside(model: struck.ModalModel, count: int = 20) -> Array:
    """Return points on top of a body, away from its vertices."""
    surface = gains(model).surface
    top = surface.centroids[surface.area_vectors[:, 2] > 0]
    return np.random.default_rng(5).permutation(top)[:count]


def test_shapes_between_vertices_are_those_of_the_formula(model: struck.ModalModel) -> None:
    """What the faces interpolate comes near the formula where waves are wide."""
    points = inside(model)
    faces, weights = gains(model).locator.barycentric(points)
    corners = gains(model).shapes[gains(model).surface.faces[faces]]
    between = np.einsum("kc,kcdm->kdm", weights, corners.astype(float))
    exact = gains(model).shapes_at(points)
    scale = np.abs(exact).max(axis=(0, 1))[:3]
    assert np.abs(between - exact)[..., :3].max() < 0.02 * scale.max()
    assert np.abs(exact[:, :2]).max() == 0


def test_a_place_in_the_plan_is_the_point_on_top(model: struck.ModalModel) -> None:
    axes = len(model.coordinates)
    top = np.array(model.places.get("quarter", model.places["top"]))
    contact = model.contact(tuple(top[:axes]))
    np.testing.assert_allclose(contact.point, top, atol=2e-3 * gains(model).radius)
    assert contact.direction.tolist() == [0, 0, -1]
    points = gains(model).surface.points
    far = points[np.argmin(points[:, 0])]  # at the end or edge, where normals turn
    assert model.contact(tuple(far[:axes])).direction.tolist() == [0, 0, -1]


def test_the_papers_behind_it_are_cited(model: struck.ModalModel) -> None:
    assert "The sounds of physical shapes" in model.cite()
    assert len(model.cite().splitlines()) == len(model.provenance.references)


def test_the_loudest_contact_is_heard(model: struck.ModalModel) -> None:
    contact = model.contact()
    assert abs(contact.direction[2]) > 0.8
    assert np.abs(gains(model).shapes_at(contact.point[None])).max() > 0


def test_a_place_outside_is_refused_with_the_nearest_point(model: struck.ModalModel) -> None:
    axes = len(model.coordinates)
    with pytest.raises(ContactError, match="the nearest point is"):
        model.contact((5.0,) * axes)


def test_files_keep_the_formula(model: struck.ModalModel, tmp_path: Path) -> None:
    struck.save(model, tmp_path / "body.struck")
    again = struck.load(tmp_path / "body.struck")
    points = inside(model)
    assert np.array_equal(gains(again).shapes_at(points), gains(model).shapes_at(points))
    assert again.tensioned == model.tensioned
    assert again.coordinates == model.coordinates
    smaller = (each.scaled(0.5) for each in (model, again))
    one, other = (gains(each).shapes_at(points / 2) for each in smaller)
    assert np.array_equal(one, other)


def test_twice_as_large_is_an_octave_lower(model: struck.ModalModel) -> None:
    large, points = model.scaled(2.0), inside(model)
    np.testing.assert_allclose(large.natural_frequencies, model.natural_frequencies / 2, rtol=1e-12)
    np.testing.assert_allclose(
        gains(large).shapes_at(2 * points), gains(model).shapes_at(points) * 2**-1.5, rtol=1e-9
    )
    assert large.mass == pytest.approx(8 * (model.mass or 0.0))


def test_tuned_to_a_note(model: struck.ModalModel) -> None:
    assert model.tuned(lowest=220.0).frequencies[0] == pytest.approx(220.0, rel=1e-9)


def test_mass_centre_and_inertia_are_of_the_body(model: struck.ModalModel) -> None:
    assert model.mass is not None
    assert model.centre is not None
    assert model.inertia is not None
    surface = gains(model).surface
    trimesh = pytest.importorskip("trimesh")
    body = trimesh.Trimesh(surface.points, surface.faces, process=False)
    assert body.is_watertight
    np.testing.assert_allclose(model.centre, body.center_mass, atol=1e-9)
    inertia = body.moment_inertia / body.volume * model.mass
    np.testing.assert_allclose(model.inertia, inertia, rtol=1e-6, atol=1e-9 * inertia.max())


@pytest.mark.prove
def test_a_drum_of_another_film_keeps_its_tension() -> None:
    shape, material, highest = BODIES["drum"]
    other = struck.analyze(shape, material, band=(20, highest)).made_of(WOOD)
    fresh = struck.analyze(shape, WOOD, band=(20, 2 * highest))
    count = len(other.natural_frequencies)
    np.testing.assert_allclose(
        other.natural_frequencies, fresh.natural_frequencies[:count], rtol=1e-9
    )


def test_a_stiff_string_of_another_wire_is_computed_anew() -> None:
    shape, material, highest = BODIES["stiff string"]
    model = struck.analyze(shape, material, band=(20, highest))
    with pytest.raises(MaterialError, match="compute the modes again"):
        model.made_of(WOOD)


@pytest.mark.parametrize(
    "name",
    ["bar", *(pytest.param(each, marks=pytest.mark.prove) for each in ("plate", "disk"))],
)
def test_bodies_of_another_material_are_within_their_stated_errors(name: str) -> None:
    shape, material, highest = BODIES[name]
    other = struck.analyze(shape, material, band=(20, highest)).made_of("glass")
    fresh = struck.analyze(shape, "glass", band=(20, 2 * highest))
    count = len(other.natural_frequencies)
    assert other.errors is not None
    difference = np.abs(other.natural_frequencies / fresh.natural_frequencies[:count] - 1)
    assert np.all(difference <= other.errors + 1e-12)


@pytest.mark.parametrize(
    ("band", "told"),
    [((20.0, 50.0), "above the band's end"), ((700.0, 701.0), "widen the band")],
)
def test_bands_without_a_mode_tell_where_modes_are(band: tuple[float, float], told: str) -> None:
    shape, material, _ = BODIES["drum"]
    with pytest.raises(OptionError, match=told):
        struck.analyze(shape, material, band=band)


def test_what_a_shape_tells_itself_is_refused() -> None:
    shape, material, highest = BODIES["bar"]
    for option in ({"units": "mm"}, {"wall": 0.001}, {"fixed": ((0, 0, 0), (1, 1, 1))}):
        with pytest.raises(OptionError, match=next(iter(option))):
            struck.analyze(shape, material, band=(20, highest), **option)


@pytest.mark.parametrize(
    ("shape", "told"),
    [
        (CircularMembrane(radius=0.1, thickness=1e-4, tension=100.0), "tension"),
        (String(length=1.0, radius=1e-3, tension=100.0), "tension"),
        (Bar(length=0.3, width=0.01, thickness=0.01, ends="hinged"), "hinged"),
        (CircularPlate(radius=0.1, thickness=0.001, edge="supported"), "supported"),
        (RectangularPlate(length=0.1, width=0.1, thickness=0.001, edges="supported"), "supported"),
    ],
)
def test_bodies_without_a_solid_say_so(shape: struck.shapes.Bar, told: str) -> None:
    with pytest.raises(OptionError, match=f"{told}.*method='formula'"):
        struck.analyze(shape, STEEL, method="fem")


def test_a_scrape_over_a_drum_is_heard() -> None:
    shape, material, highest = BODIES["drum"]
    model = struck.analyze(shape, material, band=(20, highest))
    path = [(-0.1, 0.02), (0.12, 0.05)]
    scrape = struck.Scrape(path=path, speed=0.3, load=0.5, radius=1e-3)
    sound = struck.render(model, scrape)
    assert np.isfinite(sound.samples).all()
    assert np.abs(sound.samples).max() > 0


def test_a_formula_has_no_error_of_elements() -> None:
    shape, _, highest = BODIES["drum"]
    model = struck.analyze(shape, FILM, band=(20, highest))
    assert model.errors is not None
    assert model.errors.max() < 1e-9
