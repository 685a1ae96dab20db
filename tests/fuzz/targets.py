"""Fuzz targets: each reader of files, with seeds of one format and the changes that fit it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from random import Random

import numpy as np

import struck
from struck.analysis.cached_steps import _load_value, holding
from struck.batch.batch_report import BatchRow
from struck.batch.job import FACTS, BodyJob
from struck.batch.job_process import find_finished
from struck.batch.job_table import jobs_of, table_rows
from struck.batch.strike_set import StrikeSet, named_strikes
from struck.cli.options import _walk
from struck.ears.measured_head import MeasuredHead
from struck.errors import FileFormatError, MeshError
from struck.files import cache as caches
from struck.files import list_parts, load_body, load_sofa_responses, load_surface, load_volume
from struck.recordings import Take, read_manifest, read_plan
from struck.recordings.manifest import recorded_so_far
from struck.scene import Simulation, load_animation, load_contacts, save_contacts
from struck.solids.surface.closedness import require_closed
from tests.fuzz import mutations as change
from tests.fuzz.mutations import ANYWHERE, IN_BINARY, IN_TEXT, Mutation, mutant

SEEDS = Path(__file__).with_name("corpus") / "seeds"
COMPUTED_AGAIN = "damaged results are no error: they are computed again"
KEY = "5" * 64  # of an entry of the cache


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """A reader of files of one format."""

    read: Callable[[Path], object]  # the reader, and a use of what it returns
    seeds: tuple[str, ...]  # in `SEEDS`
    changes: Sequence[Mutation]
    name: str = ""  # of the file that is read; default: "a" and the ending of the seed
    beside: Mapping[str, str] = field(default_factory=dict)  # other files there, by their seeds
    few: bool = False  # takes long: five inputs in a sample

    def content(self, number: int) -> bytes:
        """Return input `number`; the same for the same number."""
        seed = self.seeds[number % len(self.seeds)]
        chance = Random(f"{seed} {number}")  # noqa: S311 - repeatable, nothing secret
        return mutant((SEEDS / seed).read_bytes(), self.changes, chance)

    @property
    def file(self) -> str:
        """Name of the file that is read."""
        return self.name or f"a{Path(self.seeds[0]).suffix}"

    def path(self, folder: Path) -> Path:
        """Return where the file is expected in a folder, with the others that belong there."""
        for name, seed in self.beside.items():
            (folder / name).write_bytes((SEEDS / seed).read_bytes() if seed else b"")
        return folder / self.file


# Readers, each with a use of its result.


def _render(path: Path) -> None:
    model = struck.load(path)
    place = None if model.places or model.geometry is not None else [0.4] * len(model.coordinates)
    sound = struck.render(model, struck.Strike(at=place), seconds=0.02, sample_rate=8000)
    assert np.isfinite(sound.samples).all()
    assert model._repr_html_()


def _load_and_save(path: Path) -> None:
    save_contacts(load_contacts(path), path.with_name("again.jsonl"))


def _list_and_load(path: Path) -> None:
    with _naming(path):
        surface = load_surface(path)
        assert list_parts(path)
    assert np.isfinite(surface.points).all()
    assert 0 <= surface.faces.min() <= surface.faces.max() < len(surface.points)


def _repair(path: Path) -> None:
    with _naming(path):
        body = load_body(path).mesh
    require_closed(body)
    assert 0 < body.volume < np.inf


def _load_elements(path: Path) -> None:
    with _naming(path):
        mesh = load_volume(path)
    assert np.isfinite(mesh.nodes).all()


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Require that errors begin with the name of the file."""
    try:
        yield
    except MeshError as error:
        assert str(error).startswith(f"{path}: ")  # noqa: PT017 - and goes on
        raise


def _take_from_cache(path: Path) -> None:
    """Take a cached result; a damaged one is computed again."""
    cache = caches.Cache(path.parent)
    if _load_value(holding("mesh", struck.Mesh), cache, path.name) is None:
        raise FileFormatError(COMPUTED_AGAIN)


def _take_sealed(path: Path) -> None:
    """Take a cached result whose checksum fits it."""
    content = path.read_bytes()
    path.write_bytes(caches._HEAD + caches._seal(path.name, content) + content)
    _take_from_cache(path)


def _simulate(path: Path) -> None:
    Simulation(path, cache=False, convex="hull")


def _plan_jobs(path: Path) -> None:
    jobs_of(None, "steel", path, {})


def _plan_strikes(path: Path) -> None:
    rows = table_rows(path)
    StrikeSet(strikes=rows)
    named_strikes(rows, path)


def _report_facts(path: Path) -> None:
    job = BodyJob(file="a.obj", output="a", material="steel", options={}, key="k")
    facts = find_finished(job, path.parent)
    if facts is None:
        raise FileFormatError(COMPUTED_AGAIN)
    row = BatchRow.of(job, facts)
    row.plain()


def _push(path: Path) -> None:
    struck.ForceTrack(force=path)


# Changes by format.

_JSON: list[Mutation] = [*[change.change_json] * 14, *IN_TEXT]
_TABLE: list[Mutation] = [*[change.replace_cells] * 12, *IN_TEXT]
_TOML: list[Mutation] = [*[change.change_toml] * 12, *IN_TEXT]
_XML: list[Mutation] = [*[change.change_xml] * 30, *IN_TEXT]
_SEALED: list[Mutation] = [*[change.change_container] * 20, *ANYWHERE]
_GLTF: list[Mutation] = [
    *[change.change_gltf_header] * 12,
    *[change.change_gltf_buffers] * 6,
    *IN_TEXT[::2],
]
_HDF5: list[Mutation] = [*[change.change_hdf5] * 16, *IN_BINARY]
_RIFF: list[Mutation] = [*[change.change_chunks] * 12, *IN_BINARY]
_AIFF: list[Mutation] = [*[partial(change.change_chunks, order=">")] * 12, *IN_BINARY]
_FLAC: list[Mutation] = [*[change.change_flac_blocks] * 12, *IN_BINARY]
_OGG: list[Mutation] = [*[change.change_ogg_pages] * 12, *IN_BINARY]
_NPZ: list[Mutation] = [*[change.change_arrays] * 10, *[change.change_members] * 6, *ANYWHERE]

_MODELS = ("bar", "membrane", "block", "fitted", "field", "ball")
_WAVS = ("float32.wav", "int24.wav", "int16.wav")
_CUP = {"cup.stl": "box.stl", "part.xml": "part.xml"}
_TAKES = {"a.wav": "", "b.wav": ""}

TARGETS: dict[str, Target] = {
    "model": Target(
        read=_render, seeds=tuple(f"{name}.struck" for name in _MODELS), changes=_SEALED
    ),
    "gains sofa": Target(read=_render, seeds=("gains.sofa",), changes=_HDF5),
    "responses sofa": Target(read=load_sofa_responses, seeds=("responses.sofa",), changes=_HDF5),
    "head sofa": Target(read=MeasuredHead.read, seeds=("head.sofa",), changes=_HDF5),
    "sound map": Target(read=struck.SoundMap.load, seeds=("map.safetensors",), changes=_SEALED),
    "cached result": Target(
        read=_take_sealed, seeds=("mesh.safetensors",), changes=_SEALED, name=KEY
    ),
    "cache entry": Target(
        read=_take_from_cache, seeds=("mesh.cached",), changes=IN_BINARY, name=KEY
    ),
    **{
        f"{kind} {name}": Target(read=read, seeds=seeds, changes=changes)
        for name, seeds, changes in (
            ("wav", _WAVS, _RIFF),
            ("flac", ("sound.flac",), _FLAC),
            ("ogg", ("sound.ogg",), _OGG),
            ("aiff", ("sound.aiff",), _AIFF),
        )
        for kind, read in (("sound", struck.Sound.load), ("take", Take.load))
    },
    "sound mp3": Target(read=struck.Sound.load, seeds=("sound.mp3",), changes=IN_BINARY),
    "take rf64": Target(read=Take.load, seeds=("sound.rf64",), changes=_RIFF),
    "force wav": Target(read=_push, seeds=_WAVS, changes=_RIFF),
    "log csv": Target(read=_load_and_save, seeds=("log.csv",), changes=_TABLE),
    "log semicolons": Target(read=_load_and_save, seeds=("semicolons.csv",), changes=_TABLE),
    "log jsonl": Target(
        read=_load_and_save,
        seeds=("log.jsonl",),
        changes=[*[change.change_json_lines] * 14, *IN_TEXT],
    ),
    "log npz": Target(read=_load_and_save, seeds=("log.npz",), changes=_NPZ),
    **{
        f"surface {name.replace('.', ' ')}": Target(
            read=_list_and_load, seeds=seeds, changes=changes, name=f"a.{name.split('.')[-1]}"
        )
        for name, seeds, changes in (
            ("obj", ("box.obj", "open.obj"), IN_TEXT),
            ("off", ("box.off",), IN_TEXT),
            ("stl", ("box.stl",), IN_BINARY),
            ("ascii.stl", ("ascii.stl",), IN_TEXT),
            ("ply", ("box.ply",), [*IN_BINARY, *[change.replace_numbers] * 3]),
            ("ascii.ply", ("ascii.ply",), IN_TEXT),
            ("glb", ("box.glb", "two.glb"), _GLTF),
            ("gltf", ("box.gltf",), _GLTF),
        )
    },
    **{
        f"surface {packing}": Target(
            read=_list_and_load,
            seeds=(f"box.obj.{packing}",),
            changes=[partial(change.change_packed, packing=packing, change=change.replace_numbers)],
            name=f"a.obj.{packing}",
        )
        for packing in ("gz", "bz2", "xz", "zip")
    },
    "body": Target(
        read=_repair,
        seeds=("crossing.obj", "torn.obj", "box.obj"),
        changes=[change.replace_numbers, change.move_lines],
        few=True,
    ),
    "animation glb": Target(read=load_animation, seeds=("moving.glb",), changes=_GLTF),
    "animation gltf": Target(read=load_animation, seeds=("moving.gltf",), changes=_GLTF),
    **{
        f"volume {name}": Target(read=_load_elements, seeds=seeds, changes=changes, name=file)
        for name, seeds, changes, file in (
            ("vtk", ("ascii.vtk", "binary.vtk"), IN_TEXT, "a.vtk"),
            ("vtu", ("ascii.vtu", "packed.vtu"), [*_XML, *IN_TEXT], "a.vtu"),
            ("msh 2.2", ("two.msh",), IN_TEXT, "a.msh"),
            ("msh 4.1", ("four.msh", "binary.msh"), IN_TEXT, "a.msh"),
            ("inp", ("hexahedra.inp",), [*IN_TEXT, *[change.replace_cells] * 4], "a.inp"),
        )
    },
    "scene mjcf": Target(
        read=_simulate, seeds=("scene.xml",), changes=_XML, name="scene.xml", beside=_CUP
    ),
    "scene urdf": Target(read=_simulate, seeds=("robot.urdf",), changes=_XML, beside=_CUP),
    "manifest toml": Target(
        read=read_manifest, seeds=("manifest.toml",), changes=_TOML, beside=_TAKES
    ),
    "manifest csv": Target(
        read=read_manifest, seeds=("manifest.csv",), changes=_TABLE, beside=_TAKES
    ),
    "manifest written": Target(
        read=recorded_so_far, seeds=("manifest.toml",), changes=_TOML, beside=_TAKES
    ),
    "plan": Target(read=read_plan, seeds=("plan.toml",), changes=_TOML),
    "jobs csv": Target(read=_plan_jobs, seeds=("jobs.csv",), changes=_TABLE),
    "jobs toml": Target(read=_plan_jobs, seeds=("jobs.toml",), changes=_TOML),
    "strikes csv": Target(read=_plan_strikes, seeds=("strikes.csv",), changes=_TABLE),
    "strikes toml": Target(read=_plan_strikes, seeds=("strikes.toml",), changes=_TOML),
    "walk": Target(read=_walk, seeds=("walk.csv",), changes=_TABLE),
    "facts": Target(
        read=_report_facts,
        seeds=("facts.json",),
        changes=_JSON,
        name=f"a{FACTS}",
        beside={"a.struck": "walk.csv"},
    ),
}


def share(count: int) -> dict[str, int]:
    """Return how many of `count` inputs each target gets; of a sample the slow ones get five."""
    is_sample = count < 200 * len(TARGETS)
    few = 5 if is_sample else count // len(TARGETS)
    slow = [name for name, target in TARGETS.items() if target.few]
    each, rest = divmod(count - few * len(slow), len(TARGETS) - len(slow))
    shares = {}
    for name in TARGETS:
        shares[name] = few if name in slow else each + (rest > 0)
        rest -= name not in slow
    return shares
