"""What is told of a body before it is cut: against counts of modes, true sizes and wrong units."""

from __future__ import annotations

import re
import time
from pathlib import Path

import numpy as np
import pytest
import trimesh

import struck
from struck.core import machine
from struck.errors import OptionError, ScaleWarning, SolverError
from struck.files.meshes import mesh_of
from struck.model.material import Material
from struck.model.mesh import Mesh
from struck.shapes import CircularPlate, RectangularPlate
from struck.solids import Block, Tube
from struck.solids.resolution import MOST_MODES, Forecast, coarser
from struck.solids.revolution import bell, bowl, wine_glass
from tests.yardstick import seconds_foretold, slowness

STEEL, BRONZE, GLASS = (Material.named(name) for name in ("steel", "bronze", "glass"))


def forecast(solid: trimesh.Trimesh, material: Material = STEEL) -> Forecast:
    return Forecast.of(Mesh(points=solid.vertices, faces=solid.faces), material)


@pytest.mark.parametrize(
    ("plate", "highest"),
    [
        pytest.param(
            RectangularPlate(length=0.4, width=0.3, thickness=0.003, edges="free"),
            20_000.0,
            marks=pytest.mark.prove,
        ),
        (CircularPlate(radius=0.15, thickness=0.002, edge="free"), 20_000.0),
        (CircularPlate(radius=0.5, thickness=0.002, edge="free"), 5_000.0),
    ],
)
def test_plates_have_as_many_modes_as_their_closed_forms(
    plate: RectangularPlate | CircularPlate, highest: float
) -> None:
    outline = plate.solid().volume_mesh("preview").surface()[0]
    expected = len(plate.modes(STEEL, (1.0, highest)).frequencies)
    assert 0.9 < Forecast.of(outline, STEEL).modes(highest) / expected < 1.4


def test_a_bulk_has_as_many_modes_as_weyl_says() -> None:
    """Far above its lowest mode: V omega^3 (2 / c_T^3 + 1 / c_L^3) / (6 pi^2)."""
    omega, ball = 2 * np.pi * 20_000, trimesh.creation.icosphere(subdivisions=3, radius=20.0)
    shear, bulk = (np.sqrt(each / STEEL.density) for each in (
        STEEL.shear_modulus, STEEL.first_lame + 2 * STEEL.shear_modulus))  # fmt: skip
    weyl = ball.volume * omega**3 / (6 * np.pi**2) * (2 / shear**3 + 1 / bulk**3)
    assert forecast(ball).modes(20_000) == pytest.approx(weyl, rel=0.05)


BODIES = {
    "chime": Tube(length=0.505, radius=0.0125, wall=0.001),
    "pipe": Tube(length=0.3, radius=0.05, wall=0.003),
    "rod": Tube(length=0.2, radius=0.01, wall=0.01),
    "bar": Block(size=(0.3, 0.03, 0.005)),
    "beam": Block(size=(1.0, 0.01, 0.01)),
    "cube": Block(size=(0.2, 0.2, 0.2)),
    "brick": Block(size=(0.3, 0.2, 0.1)),
    "slab": Block(size=(0.3, 0.2, 0.02)),
    "bowl": bowl(),
    "bell": bell(),
    "wine glass": wine_glass(),
}


def solid_mesh(solid: trimesh.Trimesh) -> Mesh:
    return Mesh(points=solid.vertices, faces=solid.faces)


MESHES = {
    "ball": solid_mesh(trimesh.creation.icosphere(subdivisions=3, radius=0.08)),
    "capsule": solid_mesh(trimesh.creation.capsule(height=0.2, radius=0.04)),
    "torus": solid_mesh(trimesh.creation.torus(major_radius=0.1, minor_radius=0.03)),
    "nut of a mesh": solid_mesh(trimesh.creation.annulus(r_min=0.02, r_max=0.04, height=0.03)),
    "rail": solid_mesh(trimesh.creation.box((0.8, 0.07, 0.15))),
    "board": solid_mesh(trimesh.creation.box((0.3, 0.2, 0.02))),
    "cone": solid_mesh(trimesh.creation.cone(radius=0.08, height=0.3)),
    "egg": solid_mesh(
        trimesh.creation.icosphere(subdivisions=3, radius=0.08).apply_scale((1, 1, 1.6))
    ),
    "stick": solid_mesh(trimesh.creation.capsule(height=0.5, radius=0.02)),
}


@pytest.mark.parametrize(
    "name",
    [
        each if each == "bar" else pytest.param(each, marks=pytest.mark.prove)
        for each in BODIES | MESHES
    ],
)
def test_forecasts_are_within_a_factor_of_two_in_modes_and_three_in_seconds(name: str) -> None:
    body = (BODIES | MESHES)[name]
    stages: list[str] = []
    begun = time.process_time()
    found = struck.analyze(
        body,
        STEEL,
        accuracy="preview",
        cache=False,
        progress=lambda stage, _: stages.append(stage),
    )
    taken = time.process_time() - begun
    outline = body if isinstance(body, Mesh) else body.volume_mesh("preview").surface()[0]
    told = Forecast.of(outline, STEEL)
    assert 0.5 < told.modes(20_000) / len(found.frequencies) < 2
    assert told.lowest / found.frequencies[0] < 2  # else bodies with modes would be refused
    here, slow = seconds_foretold(stages), slowness()
    # The machine may have been quicker during the analysis than it is now, or slower.
    assert here * max(1.0, 1 / slow) / taken > 1 / 3
    assert here * min(1.0, 1 / slow) / taken < 3


def nut(size: float) -> trimesh.Trimesh:
    return trimesh.creation.annulus(r_min=0.25 * size, r_max=0.5 * size, height=0.4 * size)


# A body in its file's numbers, with what it should say if they are taken as metres.
IN_MILLIMETRES = {
    "nut": nut(46),
    "coin": trimesh.creation.cylinder(radius=12.5, height=2),
    "ball": trimesh.creation.icosphere(subdivisions=2, radius=50),
    "brick": trimesh.creation.box((300, 60, 30)),
    "nail": trimesh.creation.cylinder(radius=2, height=100),
    "plate": trimesh.creation.box((300, 200, 3)),
    "torus": trimesh.creation.torus(major_radius=30, minor_radius=12),
}


@pytest.mark.parametrize("name", IN_MILLIMETRES)
def test_millimetres_taken_for_metres_are_told_at_once(name: str) -> None:
    solid = IN_MILLIMETRES[name]
    begun = time.process_time()
    with pytest.raises(OptionError, match=rf"about \S+ modes.*at most {MOST_MODES:,}.*units='mm'"):
        struck.analyze(Mesh(points=solid.vertices, faces=solid.faces), "steel", cache=False)
    assert time.process_time() - begun < 2


@pytest.mark.parametrize("size", [1e-6, 1e-5, 1e-4])
def test_metres_taken_for_less_are_told_at_once(size: float) -> None:
    with pytest.raises(OptionError, match=r"no mode lies below 20000 Hz.*check its units"):
        struck.analyze(Block(size=(size, size, size / 2)), "steel")


def test_a_size_that_is_too_large_is_told(tmp_path: Path) -> None:
    trimesh.creation.icosphere(subdivisions=2).export(tmp_path / "ball.obj")
    with pytest.raises(OptionError, match="modes below 20000 Hz"):
        struck.analyze(tmp_path / "ball.obj", "steel", size=100, accuracy="preview")


def test_what_takes_long_is_warned_of_with_the_band_that_does_not() -> None:
    with (
        pytest.warns(ScaleWarning, match=r"take about \S+ s of a processor.*band=\(20, \d+\)"),
        pytest.raises(OptionError, match="stopped"),
    ):
        struck.analyze(HULL, "oak", band=(20, 20_000), progress=stopped, cache=False)


def test_a_body_of_metres_in_place_of_millimetres_is_told_to_check_its_lengths() -> None:
    huge = Block(size=(232.0, 150.0, 0.006))
    with pytest.raises(OptionError, match=r"modes below 20000 Hz.*: check its lengths"):
        struck.analyze(huge, "oak", progress=stopped, cache=False)


def test_a_band_that_nobody_asked_for_is_refused_where_it_takes_long() -> None:
    begun = time.process_time()
    solid = trimesh.creation.box((2.5, 1.8, 0.02))
    wide = Mesh(points=solid.vertices, faces=solid.faces)
    with pytest.raises(OptionError, match=r"min of a processor.*by band=\(20, 20000\)") as refused:
        struck.analyze(wide, "steel", progress=stopped, cache=False)
    assert time.process_time() - begun < 2
    lower = float(re.findall(r"lower, as in band=\(20, (\d+)\)", str(refused.value))[0])
    with pytest.raises(OptionError, match="stopped"):  # and no warning
        struck.analyze(wide, "steel", band=(20, lower), progress=stopped, cache=False)


def test_where_no_band_takes_little_another_way_is_told() -> None:
    surface = Block(size=(0.5, 0.3, 0.05)).volume_mesh("preview").surface()[0]
    many = (60_000, 180_000)
    forecast = Forecast.of(surface, STEEL)
    way = {"coarser": coarser("standard")}
    with pytest.raises(OptionError, match=r"8 GB: take accuracy='preview', or request all"):
        forecast.require_reasonable(2_000, many, requested=False, **way)
    assert "take accuracy='preview'" in forecast.require_reasonable(2_000, many, **way)
    assert "accuracy" not in forecast.require_reasonable(2_000, many)


@pytest.mark.parametrize(
    ("accuracy", "below"),
    [
        ("fine", "accuracy='standard' or 'preview'"),
        ("standard", "accuracy='preview'"),
        ("preview", ""),
    ],
)
def test_advice_on_memory_names_only_coarser_settings(
    accuracy: str, below: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "available", lambda: 2**20)
    block = Block(size=(0.05, 0.04, 0.03))
    with pytest.raises(SolverError, match=r"GiB are free: use") as refused:
        struck.analyze(block, "steel", accuracy=accuracy, cache=False, progress=None)
    assert f"are free: use {below}{', ' if below else ''}a simpler mesh" in str(refused.value)


HULL = Block(size=(4.0, 2.0, 0.1), elements=(2, 2, 1))


def stopped(stage: str, _fraction: float) -> None:
    if stage == "setting up the equations of motion":
        raise OptionError("stopped")


TRUE = {
    "church bell": (trimesh.creation.capsule(height=1.0, radius=0.7), BRONZE, 0.08),
    "girder": (trimesh.creation.box((12, 0.3, 0.02)), STEEL, None),
    "gong": (trimesh.creation.cylinder(radius=0.5, height=0.004), BRONZE, None),
    "rail": (trimesh.creation.box((2, 0.07, 0.15)), STEEL, None),
    "table": (trimesh.creation.box((1.6, 0.9, 0.03)), Material.named("oak"), None),
    "window": (trimesh.creation.box((1.2, 0.8, 0.004)), GLASS, None),
    "anvil": (trimesh.creation.box((0.6, 0.2, 0.3)), STEEL, None),
    "die": (trimesh.creation.box((0.016, 0.016, 0.016)), Material.named("oak"), None),
    "triangle": (trimesh.creation.cylinder(radius=0.005, height=0.6), STEEL, None),
    "crystal glass": (trimesh.creation.capsule(height=0.06, radius=0.03), GLASS, 0.001),
}


@pytest.mark.parametrize("name", TRUE)
def test_true_bodies_draw_no_error(name: str) -> None:
    solid, material, wall = TRUE[name]
    told = Forecast.of(Mesh(points=solid.vertices, faces=solid.faces), material, wall)
    told.require_reasonable(20_000)


def test_a_modulus_that_can_hardly_be_meant_is_told() -> None:
    with (
        pytest.warns(ScaleWarning, match="200 GPa is 200e9"),
        pytest.raises(OptionError, match="at most"),
    ):
        struck.analyze(
            Block(size=(0.3, 0.03, 0.005)),
            Material(density=7850, youngs_modulus=200.0, poisson_ratio=0.3),
        )


@pytest.mark.prove
@pytest.mark.parametrize("own", ["millimeters", "in"])
def test_a_trimesh_object_has_its_own_units(own: str) -> None:
    solid = trimesh.creation.box((100, 80, 60))
    solid.units = own
    factor = {"m": 1e-3, "i": 0.0254}[own[0]]
    made = struck.analyze(solid, "steel", accuracy="preview", band=(20, 20_000.0 * 1e-3 / factor))
    assert made.geometry is not None
    assert made.geometry.extent == pytest.approx(100 * factor)


def test_units_that_contradict_each_other_are_refused() -> None:
    solid = trimesh.creation.box((200, 100, 20))
    solid.units = "mm"
    assert mesh_of(solid, units="mm").extent == pytest.approx(0.2)
    assert mesh_of(solid).extent == pytest.approx(0.2)
    assert mesh_of(solid, size=0.5).extent == pytest.approx(0.5)
    with pytest.raises(OptionError, match=r"units='m', but .* \.units are 'mm': give one alone"):
        struck.analyze(solid, "steel", units="m")
    solid.units = "parsecs of cheese"
    with pytest.raises(OptionError, match=r"\.units are 'parsecs of cheese', no length"):
        struck.analyze(solid, "steel")
