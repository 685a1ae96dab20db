"""Stages: computed once for the same content, anew for any other, the same to the last bit."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

import struck
from struck.analysis.analysis import MODES
from struck.analysis.cached_steps import Stages, fingerprint
from struck.analysis.discretisation import ELEMENTS, FILLING, SURFACE
from struck.errors import CacheWarning, FileFormatError, MeshError
from struck.files import model_file
from struck.files.cache import Cache
from struck.files.container import from_bytes, to_bytes
from struck.files.meshes import load_mesh
from struck.model.damping import InternalFriction
from struck.model.material import Material
from struck.model.mesh import Mesh
from struck.model.modes import Modes
from struck.model.provenance import Provenance
from struck.solids import Block, Tube
from struck.solids.fem.spectrum import Solver
from struck.solids.filling.filling import fill_body
from struck.solids.surface.distance import FilledBody

STEEL = Material.named("steel")
BLOCK = Block(size=(0.1, 0.12, 0.15))
TUBE = Tube(length=0.5, radius=0.0125, wall=0.001)
EGG = trimesh.creation.icosphere(subdivisions=2, radius=0.05).apply_scale([1, 1.2, 1.4])

KEPT = " taken from the cache"


@pytest.fixture
def cache(tmp_path: Path) -> Cache:
    return Cache(tmp_path / "cache")


@pytest.fixture
def egg(tmp_path: Path) -> Path:
    EGG.export(tmp_path / "egg.stl")
    return tmp_path / "egg.stl"


def some_modes() -> Modes:
    rng = np.random.default_rng(1)
    return Modes(
        frequencies=np.sort(rng.random(5) * 1000),
        surface=Mesh(points=EGG.vertices, faces=EGG.faces, up="y"),
        shapes=rng.standard_normal((len(EGG.vertices), 3, 5)),
        mass=np.float64(1 / 3),
        centre=rng.random(3),
        inertia=np.asfortranarray(rng.random((3, 3))),
        complete_to=2e4,
        poisson_slopes=rng.random(5),
        errors=np.array([np.nan, 0.0, -0.0, np.inf, 5e-324]),
        provenance=Provenance(
            method="a test", references=("a", "b"), details={"a": (1, [0.1, None]), "b": {"c": "d"}}
        ),
    )


def bits(value: object) -> object:
    """Return what a value holds, down to the bits of its arrays."""
    if isinstance(value, np.ndarray):
        return value.dtype, value.shape, value.tobytes()
    if hasattr(value, "__dataclass_fields__"):
        return {name: bits(getattr(value, name)) for name in value.__dataclass_fields__}
    return value


# Bytes


def test_modes_come_back_bit_for_bit() -> None:
    modes = some_modes()
    again = MODES.unpack(MODES.pack(modes))
    assert bits(again) == bits(modes)
    assert all(array.flags.c_contiguous for array in (again.shapes, again.inertia))


def test_elements_and_fillings_come_back_bit_for_bit() -> None:
    mesh = BLOCK.volume_mesh("preview")
    assert bits(ELEMENTS.unpack(ELEMENTS.pack(mesh))) == bits(mesh)
    filling = fill_body(FilledBody(mesh=Mesh(points=EGG.vertices, faces=EGG.faces)), "preview")
    assert bits(FILLING.unpack(FILLING.pack(filling))) == bits(filling)


@pytest.mark.parametrize(
    "array",
    [
        np.array([True, False]),
        np.array([[0, 2**32 - 1]]),
        np.zeros((0, 3), np.int64),
        np.array([1 + 2j, -0.0j]),
        np.float32([[1, 2], [3, 4]]).T,
        np.array(7.0),
    ],
    ids=lambda array: f"{array.dtype}{array.shape}",
)
def test_arrays_come_back_bit_for_bit(array: np.ndarray) -> None:
    assert bits(from_bytes(to_bytes((array, "x"), ()), ())[0]) == bits(array)


@pytest.mark.parametrize(
    "value", [print, np.array([-1]), np.array([2**32]), np.array(["a"]), {1: 2}, BLOCK]
)
def test_what_bytes_cannot_hold_is_refused(value: object) -> None:
    with pytest.raises(FileFormatError, match="cannot be kept"):
        to_bytes([value], (Mesh,))


def test_only_expected_dataclasses_are_made() -> None:
    data = to_bytes(BLOCK, (Block,))
    with pytest.raises(FileFormatError, match="Block"):
        from_bytes(data, (Mesh,))


# Keys


@dataclass(frozen=True)
class OwnSolid:
    """A body that somebody else may change tomorrow."""

    size: float = 1.0


def test_equal_content_has_one_fingerprint() -> None:
    array = np.arange(6.0).reshape(2, 3)
    assert fingerprint(array) == fingerprint(np.asfortranarray(array.copy()))
    assert fingerprint(Tube(length=1.0, radius=0.1, wall=0.01)) == fingerprint(
        Tube(length=1.0, radius=0.1, wall=0.01)
    )
    assert fingerprint(np.float64(0.1)) == fingerprint(0.1)
    assert fingerprint(Mesh(points=EGG.vertices, faces=EGG.faces)) == fingerprint(
        Mesh(points=EGG.vertices.copy(), faces=EGG.faces.copy())
    )


def test_different_content_has_different_fingerprints() -> None:
    mesh = Mesh(points=EGG.vertices, faces=EGG.faces)
    moved = EGG.vertices.copy()
    moved[7, 1] = np.nextafter(moved[7, 1], 1)
    values: list[object] = [
        *(None, True, 1, 1.0, "1", b"1", (), [], {}, (1,), ((1,),), (1, 1), "", "None"),
        *(("ab", "c"), ("a", "bc"), {"a": 1}, {"b": 1}, {"a": 1, "b": 1}, float("nan"), -0.0),
        *(np.zeros(6), np.zeros((2, 3)), np.zeros((3, 2)), np.zeros(6, np.float32), np.zeros(0)),
        *(
            mesh,
            replace(mesh, points=moved),
            replace(mesh, up="y"),
            replace(mesh, faces=mesh.faces[1:]),
        ),
        *(Solver(), Solver(lumped=True), Solver(backend="superlu")),
        *(STEEL, STEEL.damped(InternalFriction(loss_tangent=0.1)), replace(STEEL, density=1.0)),
        *(BLOCK, Block(size=(0.1, 0.12, 0.1500000001)), Tube(length=1.0, radius=0.1, wall=0.01)),
    ]
    assert len({fingerprint(value) for value in values}) == len(values)


@pytest.mark.parametrize("value", [print, OwnSolid(), object(), np.array([None]), {1, 2}])
def test_unknown_content_has_no_fingerprint(value: object) -> None:
    with pytest.raises(TypeError):
        fingerprint(("a", {"b": [value]}))


def test_a_file_counts_by_content_and_format(tmp_path: Path, egg: Path) -> None:
    copies = [tmp_path / name for name in ("a.stl", "b.STL", "c.ply", "d.stl")]
    for copy in copies:
        copy.write_bytes(egg.read_bytes())
    copies[3].write_bytes(egg.read_bytes()[:-1] + b"\1")
    stl, other_name, other_format, changed = (fingerprint(copy) for copy in copies)
    assert fingerprint(egg) == stl == other_name
    assert len({stl, other_format, changed}) == 3


@pytest.mark.parametrize("name", ["scene.gltf", "missing.stl", "folder.stl"])
def test_files_that_may_hold_more_have_no_fingerprint(tmp_path: Path, name: str) -> None:
    (tmp_path / "scene.gltf").write_text("{}")  # it may refer to others
    (tmp_path / "folder.stl").mkdir()
    with pytest.raises(TypeError):
        fingerprint(tmp_path / name)


def test_fingerprints_are_the_same_in_every_process() -> None:
    program = """
        from struck.solids import Tube
        from struck.analysis.cached_steps import fingerprint
        print(fingerprint({"b": Tube(length=1.0, radius=0.1, wall=0.01), "a": ("x", None, 0.1)}))
    """
    value = {"b": Tube(length=1.0, radius=0.1, wall=0.01), "a": ("x", None, 0.1)}
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONHASHSEED": "7"},
    )
    assert done.stdout.strip() == fingerprint(value)


# Keeping


class Counted:
    """Work that counts how often it is done."""

    def __init__(self, work: Callable[[], object]) -> None:
        self.work, self.count = work, 0

    def __call__(self) -> object:
        self.count += 1
        return self.work()


def test_the_same_is_computed_once(cache: Cache) -> None:
    work, told = Counted(some_modes), []
    for _ in range(3):
        stages = Stages(cache=cache, progress=lambda *step: told.append(step))
        modes = stages.get_or_compute(MODES, work, band=1.0)
        assert bits(modes) == bits(some_modes())
    assert work.count == 1
    assert told == [("modes taken from the cache", 1.0)] * 2
    Stages(cache=Cache(cache.folder)).get_or_compute(MODES, work, band=1.0)
    assert work.count == 1
    Stages(cache=cache).get_or_compute(MODES, work, band=2.0)
    assert work.count == 2


def test_two_stages_of_the_same_inputs_are_two(cache: Cache) -> None:
    Stages(cache=cache).get_or_compute(MODES, some_modes, band=1.0)
    expected = BLOCK.volume_mesh("preview")
    mesh = Stages(cache=cache).get_or_compute(ELEMENTS, lambda: expected, band=1.0)
    assert bits(mesh) == bits(expected)
    assert len(cache.entries()) == 2


def test_without_a_cache_everything_is_computed() -> None:
    work = Counted(some_modes)
    assert Stages(cache=None).get_or_compute(MODES, work, band=1.0) is not Stages(
        cache=None
    ).get_or_compute(MODES, work, band=1.0)
    assert work.count == 2


def test_unknown_inputs_are_computed_and_not_kept(cache: Cache) -> None:
    work = Counted(some_modes)
    for _ in range(2):
        Stages(cache=cache).get_or_compute(MODES, work, fixed=lambda points: points)
    assert work.count == 2
    assert not cache.entries()


@pytest.mark.parametrize("error", [MeshError("no"), KeyboardInterrupt(), MemoryError()])
def test_what_failed_is_not_kept(cache: Cache, error: BaseException) -> None:
    def fails() -> Modes:
        raise error

    with pytest.raises(type(error)):
        Stages(cache=cache).get_or_compute(MODES, fails, band=1.0)
    assert not cache.entries()


@pytest.mark.parametrize("step", ["_write_through", "_sync_folder"])
def test_an_interruption_while_keeping_leaves_all_or_nothing(
    cache: Cache, monkeypatch: pytest.MonkeyPatch, step: str
) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(f"struck.files.atomic.{step}", interrupt)
    with pytest.raises(KeyboardInterrupt):
        Stages(cache=cache).get_or_compute(MODES, some_modes, band=1.0)
    monkeypatch.undo()
    assert len(list(cache.folder.iterdir())) == len(cache.entries()) == (step == "_sync_folder")
    assert bits(Stages(cache=cache).get_or_compute(MODES, some_modes, band=1.0)) == bits(
        some_modes()
    )


@pytest.mark.prove
def test_a_file_changed_while_it_is_read_is_not_kept(cache: Cache, egg: Path) -> None:
    def load() -> Mesh:
        mesh = load_mesh(egg)
        EGG.copy().apply_scale(2).export(egg)
        return mesh

    Stages(cache=cache).get_or_compute(SURFACE, load, file=egg)
    assert not cache.entries()
    assert Stages(cache=cache).get_or_compute(
        SURFACE, lambda: load_mesh(egg), file=egg
    ).extent == pytest.approx(0.28)


def test_a_damaged_entry_is_computed_again(cache: Cache) -> None:
    work = Counted(some_modes)
    Stages(cache=cache).get_or_compute(MODES, work, band=1.0)
    (entry,) = cache.entries()
    entry.path.write_bytes(entry.path.read_bytes()[:-1])
    with pytest.warns(CacheWarning, match="computed again"):
        assert bits(Stages(cache=cache).get_or_compute(MODES, work, band=1.0)) == bits(some_modes())
    assert (work.count, cache.damaged) == (2, 1)
    Stages(cache=cache).get_or_compute(MODES, work, band=1.0)
    assert work.count == 2


@pytest.mark.parametrize("content", [b"", b"sealed and yet no modes", to_bytes({"a": 1}, ())[:-1]])
def test_a_sound_entry_that_holds_something_else_is_computed_again(
    cache: Cache, content: bytes
) -> None:
    work = Counted(some_modes)
    Stages(cache=cache).get_or_compute(MODES, work, band=1.0)
    cache.put(cache.entries()[0].path.name, content)
    with pytest.warns(CacheWarning, match="computed again"):
        Stages(cache=cache).get_or_compute(MODES, work, band=1.0)
    assert work.count == 2


def test_what_cannot_be_packed_is_returned_and_said_once(cache: Cache) -> None:
    def keep() -> None:
        for _ in range(2):
            assert type(Stages(cache=cache).get_or_compute(MODES, object, band=1.0)) is object

    with pytest.warns(CacheWarning, match=r"modes: finished work is not kept.*object") as said:
        keep()
    assert len(said) == 1


@pytest.mark.parametrize("step", ["pack", "unpack"])
def test_short_memory_costs_the_entry_and_not_the_work(cache: Cache, step: str) -> None:
    def short(_: object) -> bytes:
        raise MemoryError

    Stages(cache=cache).get_or_compute(MODES, some_modes, band=1.0)
    work, stage = Counted(some_modes), replace(MODES, **{step: short})
    with pytest.warns(CacheWarning, match="modes: "):
        made = Stages(cache=cache).get_or_compute(stage, work, band=2.0)
    assert bits(made) == bits(some_modes())
    assert work.count == len(cache.entries()) == 1


# The whole analysis


def stages_kept(body: object, material: Material, cache: Path, **options: object) -> set[str]:
    """Analyze a body and return which stages were there already."""
    told: set[str] = set()
    struck.analyze(
        body,
        material,
        accuracy="preview",
        cache=cache,
        progress=lambda stage, _: told.add(stage),
        **options,
    )
    return {stage.removesuffix(KEPT) for stage in told if stage.endswith(KEPT)}


@pytest.mark.prove
def test_another_material_takes_up_the_elements_alone(tmp_path: Path) -> None:
    cache, band = tmp_path / "cache", (20.0, 1000.0)
    assert not stages_kept(TUBE, STEEL, cache, band=band)
    solved = {"elements", "coarse modes", "modes"}
    assert stages_kept(TUBE, STEEL, cache, band=band) == solved | {"model"}
    lossy = STEEL.damped(InternalFriction(loss_tangent=0.01))
    assert stages_kept(TUBE, lossy, cache, band=band) == solved
    assert stages_kept(TUBE, Material.named("brass"), cache, band=band) == {"elements"}
    assert stages_kept(replace(TUBE, wall=0.002), STEEL, cache, band=band) == set()


@pytest.mark.prove
def test_another_option_takes_up_all_that_does_not_depend_on_it(egg: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    assert not stages_kept(egg, STEEL, cache)
    meshed = {"surface", "coarse filling", "filling"}
    solved = meshed | {"coarse modes", "modes"}
    assert stages_kept(egg, STEEL, cache) == solved | {"model"}
    lossy = STEEL.damped(InternalFriction(loss_tangent=0.01))
    assert stages_kept(egg, lossy, cache) == solved
    assert stages_kept(egg, STEEL, cache, radiation="obrien2002") == solved
    assert stages_kept(egg, STEEL, cache, band=(20.0, 19_000.0)) == meshed
    assert stages_kept(egg, Material.named("brass"), cache) == meshed
    assert stages_kept(egg, STEEL, cache, fixed=lambda points: points[:, 2] < -0.03) == meshed
    assert stages_kept(egg, STEEL, cache, fixed=[(-1, -1, -1), (1, 1, -0.03)]) == {*solved, "model"}
    assert stages_kept(egg, STEEL, cache, size=0.15) == set()


@pytest.mark.prove
@pytest.mark.parametrize(
    ("body", "options"),
    [
        pytest.param("egg.stl", {}, marks=pytest.mark.prove),
        pytest.param("egg.stl", {"fixed": [(-1, -1, -1), (1, 1, -0.03)]}, marks=pytest.mark.prove),
        (TUBE, {"band": (20.0, 5000.0)}),
    ],
    ids=["a body", "a body that is held", "a tube"],
)
def test_with_and_without_a_cache_the_model_is_the_same_to_the_last_bit(
    egg: Path, tmp_path: Path, body: object, options: dict[str, object]
) -> None:
    def model(*, cache: bool | Path) -> bytes:
        made = struck.analyze(
            egg if body == egg.name else body, STEEL, accuracy="preview", cache=cache, **options
        )
        return model_file.to_bytes(made)

    without = model(cache=False)
    assert model(cache=tmp_path / "cache") == without
    assert model(cache=tmp_path / "cache") == without


def test_trouble_with_the_cache_is_said_once_and_the_model_is_there(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        assert stages_kept(TUBE, STEEL, tmp_path / "file", band=(20.0, 1000.0)) == set()
    assert [each.category for each in said] == [CacheWarning]
