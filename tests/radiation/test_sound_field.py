"""A body's timbre field: which modes on which mesh, what they radiate, and what is kept of it."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import struck
from struck.analysis.analysis import radiating
from struck.errors import ContactError, MeshError, OptionError, ScaleWarning, SolverError
from struck.files import model_file
from struck.model.gains import ShapeGains
from struck.model.material import AIR
from struck.model.mesh import Mesh
from struck.radiation import sound_field
from struck.radiation.boundary_elements import Walls
from struck.radiation.directivity import RadiatingGains
from struck.radiation.multipoles import sphere_rule
from struck.radiation.remeshing import remesh
from struck.radiation.sound_field import FieldPlan, fields_of, fitting_mesh, velocities_on
from struck.solids import Block, Revolution, Tube
from tests.excitation.recordings import recorded
from tests.radiation import bodies

BAND = 20.0, 20_000.0


@pytest.fixture(scope="module")
def block() -> struck.ModalModel:
    """Return a block that is small against its waves."""
    made = Block(size=(0.06, 0.02, 0.01))
    return struck.analyze(made, "steel", accuracy="preview", band=(20, 20_000), cache=False)


def shaped(model: struck.ModalModel) -> ShapeGains:
    assert isinstance(model.gains, ShapeGains)
    return model.gains


def test_a_field_is_computed_kept_and_taken_up_again(
    block: struck.ModalModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = float(block.natural_frequencies[0])
    band, told = (20.0, 1.01 * first), []
    made = radiating(block, band, cache=tmp_path, progress=lambda *each: told.append(each))
    assert made.gains.directional
    assert made.provenance.details["radiation"] == "field"
    assert told[0][0].startswith("forecast: timbre field, about ")
    assert told[-1] == ("computing the timbre field", 1.0)
    monkeypatch.setattr(sound_field, "solve_field", solved_again)
    again = radiating(block, band, cache=tmp_path)
    place = np.array([[0.1, 0.3, -0.2]])
    np.testing.assert_array_equal(made.gains.toward(place), again.gains.toward(place))
    estimate = np.abs(shaped(block).outputs)
    levels = 20 * np.log10(np.abs(shaped(made).outputs) / estimate)
    assert abs(levels[0]) < 4  # the estimate's measured error on blocks is 3 dB
    np.testing.assert_allclose(levels[1:], 0, atol=1e-9)  # out of the band


@pytest.fixture(scope="module")
def sounding(block: struck.ModalModel) -> struck.ModalModel:
    """Return the block with the field of its first mode, kept near it as well."""
    return block.radiating(band=(20.0, 1.01 * float(block.natural_frequencies[0])), near=True)


def ways(count: int) -> np.ndarray:
    chance = np.random.default_rng(7).normal(size=(count, 3))
    return chance / np.linalg.norm(chance, axis=1)[:, None]


def apart(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return by mode the root mean square of a difference over that of the other."""
    return np.sqrt(np.mean(np.abs(one - other) ** 2, axis=0) / np.mean(np.abs(other) ** 2, axis=0))


@pytest.mark.prove
def test_a_scaled_field_is_a_larger_bodys_own(
    block: struck.ModalModel, sounding: struck.ModalModel
) -> None:
    larger = block.scaled(2)
    band = 20.0, 1.01 * float(larger.natural_frequencies[0])
    fresh, scaled = larger.radiating(band=band).gains, sounding.scaled(2).gains
    for distance in (0.11, 0.3, 2.0):  # 1.7 radii and farther
        places = distance * ways(200)
        missed = apart(scaled.toward(places)[:, 0], fresh.toward(places)[:, 0])
        assert missed.max() < 0.01


def test_stated_errors_of_the_waves_are_those_beside_the_surface_integral(
    sounding: struck.ModalModel,
) -> None:
    gains = sounding.gains
    part = gains.near[0]  # there is one for each mesh
    own = part.modes
    for distance, stated in ((1.5, gains.field.errors[own, 0]), (1.2, gains.field.errors[own, 1])):
        places = distance * gains.radius * ways(1000)
        exact = part.pressure(gains.centre + places, np.arange(len(own)))
        late = np.exp(1j * part.wave_numbers * distance * gains.radius)
        missed = apart(gains.field.at(places)[:, own], exact * late)
        assert np.all(missed < 1.15 * stated)
        assert np.all(missed > 0.85 * stated)  # it is the error, not only a bound
    assert np.all(gains.field.errors[own, 0] < 0.02)
    computed = np.concatenate([each.modes for each in gains.near])
    assert np.isfinite(gains.field.errors[computed]).all()
    assert np.isnan(np.delete(gains.field.errors, computed, axis=0)).all()  # estimates have none
    kept = model_file.from_bytes(model_file.to_bytes(sounding)).gains
    np.testing.assert_array_equal(kept.field.errors, gains.field.errors)


def test_a_recorded_body_is_refused_with_the_way_out() -> None:
    with pytest.raises(OptionError, match="gains are recorded: analyze a body with radiation="):
        recorded("field").radiating()


def solved_again(**given: object) -> None:
    raise AssertionError(f"what was kept is solved again: {given}")


def test_net_flux_is_that_of_the_bodys_own_surface(block: struck.ModalModel) -> None:
    gains = shaped(block)
    plan, modes = FieldPlan.of(gains, block.natural_frequencies, BAND), np.arange(gains.count)
    mesh = sound_field.remesh(plan.skin.mesh, 2 * plan.edges[0], plan.wall)
    velocities = velocities_on(mesh, gains, plan.skin, modes)
    own = np.einsum("fd,fcdm->m", gains.surface.area_vectors, gains.shapes[gains.surface.faces])
    scale = mesh.areas @ np.abs(velocities)
    np.testing.assert_allclose((mesh.areas @ velocities - own / 3) / scale, 0, atol=1e-6)


def test_higher_modes_get_finer_meshes_and_the_highest_none(block: struck.ModalModel) -> None:
    gains, natural = shaped(block), block.natural_frequencies
    plan = FieldPlan.of(gains, natural, (20.0, 2e4))
    every = np.concatenate([*plan.mesh_modes, plan.left_out])
    np.testing.assert_array_equal(np.sort(every), np.arange(len(natural)))
    assert list(plan.edges) == sorted(plan.edges)
    for edge, modes in zip(plan.edges, plan.mesh_modes, strict=True):
        assert (plan.wave_numbers[modes] * edge <= 1.01 * 2 * np.pi / 6).all()
    high = FieldPlan.of(gains, 40 * natural, (20.0, 1e6)).left_out
    ka = 2 * np.pi * 40 * natural / 343.21 * gains.radius
    np.testing.assert_array_equal(high, np.flatnonzero(ka > 24))


def test_too_little_memory_and_a_relative_estimate_are_refused(
    block: struck.ModalModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = FieldPlan.of(shaped(block), block.natural_frequencies, BAND)
    monkeypatch.setattr(sound_field, "available", lambda: 2**20)
    with pytest.raises(SolverError, match="give a band= that ends lower"):
        fields_of(shaped(block), plan)
    relative = struck.analyze(
        Block(size=(0.06, 0.02, 0.01)), "steel", accuracy="preview", radiation="obrien2002"
    )
    with pytest.raises(OptionError, match="radiation='power'"):
        relative.radiating()


def of_surface(model: struck.ModalModel, surface: Mesh) -> struck.ModalModel:
    """Return a model whose modes bend another surface along x, by y."""
    bent = np.zeros((len(surface.points), 3, len(model.frequencies)), np.float32)
    bent[:, 0] = (surface.points[:, 1:2] / surface.extent) ** 2
    return replace(model, gains=replace(shaped(model), surface=surface, shapes=bent))


def test_open_and_crossing_skins_are_refused(block: struck.ModalModel) -> None:
    ball = bodies.ball(0.02, 2)
    shifted = Mesh(points=ball.points + np.array([0.02, 0.001, 0]), faces=ball.faces)
    with pytest.raises(MeshError, match=r"9 edges .* of 0 at most: analyze"):
        of_surface(block, Mesh(points=ball.points, faces=ball.faces[5:])).radiating()
    with pytest.raises(MeshError, match=r"crosses itself: .*% .* of 0.1% at most"):
        of_surface(block, bodies.joined(ball, shifted)).radiating()


@pytest.fixture(scope="module")
def bowl(block: struck.ModalModel) -> struck.ModalModel:
    """Return a bowl with a field near it: its wall is 0.7 elements thick."""
    band = 20.0, 1.01 * float(block.natural_frequencies[0])
    made = of_surface(block, bodies.bowl(0.02, 0.002, 16, 8))
    return made.radiating(band=band, near=True)


def test_a_thin_wall_makes_the_stated_error_larger(bowl: struck.ModalModel) -> None:
    (part,) = bowl.gains.near
    told = float(str(bowl.provenance.details["field_error"]).rstrip("%")) / 100
    assert 0.1 < Walls.of(part.mesh).min_ratio < 1
    np.testing.assert_allclose(told, part.errors.max(), atol=1e-3)
    assert 0.01 < told < 0.2


@pytest.mark.prove
def test_elements_too_large_for_a_wall_are_made_smaller() -> None:
    can, wall = bodies.tube(0.05, 0.001, 0.05, 32, 8), 0.000995
    edge = wall / 0.15  # as a plan has it
    first = remesh(can, edge, wall)
    assert Walls.of(first).min_ratio < 0.1  # which was refused
    mesh = fitting_mesh(can, edge, wall)
    assert Walls.of(mesh).min_ratio >= 0.1
    assert len(mesh.faces) < 1.5 * len(first.faces)


def test_a_wall_that_no_elements_fit_is_named_with_two_ways_out(block: struck.ModalModel) -> None:
    """Following the message, the model sounds as it is, and a thicker sheet has its elements."""
    knob = bodies.ball(0.02, 2)
    knob = Mesh(points=knob.points + np.array([0, 0, 0.03]), faces=knob.faces)
    thin, thick = (
        bodies.joined(bodies.box((0.04, 0.04, depth), (1, 1, 1)), knob) for depth in (4e-6, 4e-3)
    )
    said = r"is 0\.\d+ mm thick at \(.*\) m, .* of 0.1 at least, .*: keep .*, or thicken the body"
    with pytest.raises(MeshError, match=said):
        fitting_mesh(thin, 0.015, 0.02)
    assert struck.render(of_surface(block, thin), struck.Strike(at=(0, 0, 0.05))).samples.any()
    assert Walls.of(fitting_mesh(thick, 0.015, 0.02)).min_ratio >= 0.1


def test_modes_above_the_bound_are_named_one_by_one(block: struck.ModalModel) -> None:
    large = of_surface(block, bodies.ball(0.2, 2))  # wave number times radius: 48 and more
    made = large.radiating()
    assert not made.gains.directional
    assert made.provenance.dropped[-1].startswith("2 modes without a timbre field, by an estimate")
    for mode, frequency in enumerate(block.frequencies, start=1):
        assert f"{mode} ({frequency:.0f} Hz)" in made.provenance.dropped[-1]


def test_a_band_without_modes_says_so_and_no_band_is_refused(block: struck.ModalModel) -> None:
    with pytest.warns(ScaleWarning, match="no mode lies from 20 to 30 Hz"):
        made = block.radiating(band=(20, 30))
    assert made.provenance.dropped[-1] == (
        "no mode lies from 20 to 30 Hz: no timbre field is computed"
    )
    for band in ((2000, 20), (np.nan, 100), (-1, 100), (1, 2, 3)):
        with pytest.raises(OptionError, match="in Hz, or notes, the lower first"):
            block.radiating(band=band)


def test_forty_thousand_elements_are_refused_where_they_do_not_fit(
    block: struck.ModalModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    gains, monkey = shaped(block), monkeypatch
    plan = FieldPlan.of(gains, block.natural_frequencies, BAND)
    edge = plan.edges[0] * (plan.counts[0] / 40_000) ** 0.5
    finer = replace(plan, edges=(float(edge),) * len(plan.edges))
    np.testing.assert_allclose(finer.counts, 40_000)
    monkey.setattr(sound_field, "available", lambda: 16 * 2**30)
    with pytest.raises(SolverError, match=r"needs about 26.8 GiB of memory, but 16 GiB are free"):
        fields_of(gains, finer)


def test_nobody_listens_within_a_wall_or_a_closed_cavity(bowl: struck.ModalModel) -> None:
    assert np.isfinite(bowl.gains.toward(np.array([[0.0, 0.0, -0.01]]))).all()
    with pytest.raises(ContactError, match="inside the body's surface"):
        bowl.gains.toward(np.array([[0.0, 0.0, -0.019]]))
    ball = bodies.ball(0.02, 2)
    cavity = Mesh(points=0.7 * ball.points, faces=ball.faces[:, ::-1])
    hollow = of_surface(bowl, bodies.joined(ball, cavity)).gains
    field = replace(bowl.gains.near[0], mesh=ball)
    with pytest.raises(ContactError, match="in a cavity of the body that is closed"):
        replace(hollow, near=(field,)).toward(np.zeros((1, 3)))


def test_a_hair_off_the_surface_the_sound_is_that_nearby(bowl: struck.ModalModel) -> None:
    # The elements are larger than the surface's triangles, and cut through the air inside the bowl.
    surface = bowl.gains.surface
    (part,) = bowl.gains.near
    close, off = (surface.centroids + way * surface.face_normals for way in (1e-6, 3e-4))
    assert part.mesh.locator.holds(close).any()
    mode = int(part.modes[0])
    heard, nearby = (bowl.gains.toward(places)[:, 0, mode] for places in (close, off))
    assert np.abs(heard - nearby).max() < 0.25 * np.abs(nearby).max()


RUN = """
import resource, sys, time
import struck
from struck.analysis.analysis import radiating
from struck.radiation import sound_field

solve, solves = sound_field.solve_field, []
def counted(**given):
    solves.append(1)
    return solve(**given)
sound_field.solve_field = counted
model, begun = struck.load(sys.argv[1]), time.process_time()
def told(stage, share):
    print(stage, share, time.process_time() - begun, sep="|", flush=True)
radiating(model, (20.0, float(sys.argv[2])), cache=sys.argv[3], progress=told)
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(len(solves), time.process_time() - begun, peak * 1024, sep="|")
"""
SPOT = Path(__file__).parents[3] / "shared/data/meshes/spot.obj"


def command(model: struck.ModalModel, highest: float, folder: Path) -> list[str]:
    """Return the command that computes a field up to a frequency, Hz, with a cache in a folder."""
    struck.save(model, folder / "body.struck")
    arguments = [str(folder / "body.struck"), str(highest), str(folder / "cache")]
    return [sys.executable, "-c", RUN, *arguments]


def chime(highest: float) -> struck.ModalModel:
    made = Tube(length=0.505, radius=0.0125, wall=0.001)
    return struck.analyze(made, "aluminium", band=(20, highest))


def oak_block(highest: float) -> struck.ModalModel:
    return struck.analyze(Block(size=(0.12, 0.05, 0.03)), "oak", band=(20, highest))


def cow(highest: float) -> struck.ModalModel:
    return struck.analyze(SPOT, "ceramic", size=0.15, wall=0.008, band=(20, highest))


@pytest.mark.prove
def test_a_killed_field_is_resumed(tmp_path: Path) -> None:
    highest = 16_000.0
    model = oak_block(highest)
    plan = FieldPlan.of(shaped(model), model.natural_frequencies, (20.0, highest))
    solutions = sum(len(list(plan.groups(modes))) for modes in plan.mesh_modes)
    stored = (solutions + 1) // 2
    run = command(model, highest, tmp_path)
    with subprocess.Popen(run, stdout=subprocess.PIPE, text=True) as first:
        assert first.stdout is not None
        for _ in range(stored + 1):  # the forecast, and a line for each solution
            next(first.stdout)
        first.send_signal(signal.SIGKILL)
    assert first.returncode == -signal.SIGKILL
    done = subprocess.run(run, stdout=subprocess.PIPE, text=True, check=True)
    later = int(done.stdout.splitlines()[-1].split("|")[0])
    assert later in {solutions - stored, solutions - stored - 1}  # one more before it died


@pytest.mark.prove
@pytest.mark.timed
@pytest.mark.parametrize(
    ("body", "highest"),
    [
        (oak_block, 16_000.0),
        (chime, 5000.0),
        pytest.param(
            cow,
            8000.0,
            marks=pytest.mark.skipif(
                not SPOT.exists(), reason="the mesh of the cow is not beside the checkout"
            ),
        ),
    ],
)
def test_seconds_of_a_field_are_forecast(
    body: Callable[[float], struck.ModalModel], highest: float, tmp_path: Path
) -> None:
    run = command(body(highest), highest, tmp_path)
    lines = subprocess.run(run, stdout=subprocess.PIPE, text=True, check=True).stdout.splitlines()
    forecast = float(lines[0].split("|")[0].split()[4])
    _, seconds, peak = map(float, lines[-1].split("|"))
    assert peak < 4 * 2**30
    assert seconds / 1.5 < forecast < 1.5 * seconds


def test_losses_of_a_field_are_its_power_within_its_error(
    block: struck.ModalModel, sounding: struck.ModalModel
) -> None:
    losses, estimated, gains = shaped(sounding).losses, shaped(block).losses, sounding.gains
    assert losses is not None
    assert estimated is not None
    assert isinstance(gains, RadiatingGains)
    (part,) = gains.near
    directions, weights = sphere_rule(8)
    pressures = 10.0 * np.abs(part.pressure(10.0 * directions, np.arange(len(part.modes))))
    # 4 pi r^2 p^2 / (2 rho c), of an energy of 1/2 J that falls at twice the decay rate.
    mean_squares = weights @ np.square(pressures) / weights.sum()
    power = 2 * np.pi * mean_squares / AIR.impedance
    np.testing.assert_allclose(losses.sound[part.modes], power, rtol=0.03)
    expected = 20 * np.log10(1 + part.errors)
    np.testing.assert_allclose(losses.uncertainty[part.modes], expected)
    others = np.setdiff1d(np.arange(len(losses.sound)), part.modes)
    np.testing.assert_array_equal(losses.sound[others], estimated.sound[others])
    np.testing.assert_array_equal(losses.surface, estimated.surface)
    halved = shaped(sounding.scaled(0.5)).losses
    assert halved is not None
    np.testing.assert_allclose(halved.sound, 2 * losses.sound)


def test_a_bottle_decays_in_its_sound_by_material_and_radiation() -> None:
    profile = [(0, 0), (0.036, 0), (0.036, 0.15), (0.013, 0.21), (0.013, 0.27)]
    bottle = Revolution(profile=profile, wall=0.003, smooth=False)
    options = {"accuracy": "preview", "band": (2000, 3000), "recoil": False, "progress": None}
    pair = struck.analyze(bottle, "glass", **options, radiation="field")
    material = struck.analyze(bottle, "glass", **options, air=False).decays
    directions, weights = sphere_rule(8)
    places = pair.centre + 30.0 * directions
    squares = np.square(30.0 * np.abs(pair.gains.toward(places)[:, 0]))
    sound = 2 * np.pi * (weights @ squares / weights.sum()) / AIR.impedance
    assert len(sound) == 2  # two ovals at right angles, of one frequency
    assert np.all(sound > material)
    blow = struck.Strike(at="rim", striker="wood", speed=1.0)
    samples = struck.render(pair, blow, seconds=1.0, fade=0, listener=places[0]).samples[0]
    # Schroeder's integral, from -5 to -35 dB.
    remaining = np.cumsum(np.square(samples[::-1].astype(float)))[::-1]
    levels = 10 * np.log10(remaining / remaining[0])
    start, end = np.argmax(levels < -5), np.argmax(levels < -35)
    rate = (levels[start] - levels[end]) * 48_000 / (end - start) / (20 * np.log10(np.e))
    np.testing.assert_allclose(rate, material + sound, rtol=0.05)
