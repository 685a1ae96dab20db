"""Every place of the package that interprets bytes is listed here, with bounds and tests."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from struck.batch.batch_report import PAGES
from struck.batch.cluster import _is_of
from tests.fuzz.targets import TARGETS

PACKAGE = Path(__file__).parents[2] / "src/struck"
# Whole dotted names, with what a call returned written as "name()".
PARSER = re.compile(
    r"json\.(load|loads|JSONDecoder)|pickle\.(load|loads|Unpickler)|marshal\.loads?|shelve\.open"
    r"|(numpy|np)\.(load|loadtxt|genfromtxt|fromfile|fromregex|memmap|frombuffer|lib\.format\.\w+)"
    r"|struct\.(unpack|unpack_from|iter_unpack|Struct)|tomllib\.loads?|configparser\.\w+"
    r"|csv\.(reader|DictReader)|yaml\.\w+|ast\.literal_eval|eval|exec|compile"
    r"|xml\.etree\.ElementTree\.(fromstring|fromstringlist|parse|iterparse|XML|XMLParser|XMLPullParser)"
    r"|xml\.(sax|dom)\..*|lxml\..*|html\.parser\..*"
    r"|zipfile\.(ZipFile|Path)|tarfile\.\w+|gzip\.(open|GzipFile|decompress)"
    r"|bz2\.(open|BZ2File|BZ2Decompressor|decompress)|zlib\.(decompress|decompressobj)"
    r"|lzma\.(open|LZMAFile|LZMADecompressor|decompress)"
    r"|safetensors\.(\w+\.)?(load|load_file|safe_open|deserialize)"
    r"|.*\b(soundfile|_soundfile\(\))\.(SoundFile|read|blocks|info)|wave\.open"
    r"|scipy\.io\..*|.*\bh5py\.(File|Dataset\.\w+)|netCDF4\..*"
    r"|trimesh\.(load\w*|exchange\.\w+\.load\w*)|.*\bmeshio\.(read|\w+\.read)|getattr\(meshio\)\.read"
    r"|.*\bMj(Spec|Model)\.from_\w+|PIL\.Image\.open|.*\bparquet\.(read_table|ParquetFile)"
)


@dataclass(frozen=True, slots=True)
class Place:
    """A place where bytes are interpreted: its bounds in words, and what tries damaged ones."""

    bounds: str
    tests: str = ""  # targets with "; " between, or a test; "" for bytes of the package itself


SURFACES = "; ".join(name for name in TARGETS if name.startswith("surface"))
GLTF = "surface glb; surface gltf; animation glb; animation gltf"
PACKED = "surface gz; surface bz2; surface xz; surface zip"
WAVS = "sound wav; take wav; force wav"
TABLES = "jobs csv; jobs toml; strikes csv"
SEALED = "model; sound map; cached result"
SOFA = "gains sofa; responses sofa; head sofa"
SCENES = "scene mjcf; scene urdf"
SOUNDS = "sound flac; sound ogg; sound aiff; sound mp3; take flac; take ogg; take aiff; take rf64"
FRAMES = "tests/files/test_guard.py::test_corrupted_frames_are_refused_or_well_formed"

GUARDED = "in the separate process: 256 MB, 10 s of processor time, 2 GB of memory"
OWN = "part of the package"
PIPE = "from a process that this one has started, or the one that started it"
UNPACKED = f"{GUARDED}; 200 bytes from one above 16 MB"

# By module and function, with the parser that it names.
PLACES = {
    "batch/batch:_Batch._copied json.loads": Place("written by this process"),
    "batch/cluster:_is_of json.loads": Place(
        "a folder that this run writes to", "tests/fuzz/test_parsers.py::test_a_report_that_is_none"
    ),
    "batch/job:_companions json.loads": Place("2 GiB; errors mean no companions", "jobs csv"),
    "batch/job_process:_answer pickle.loads": Place(PIPE),
    "batch/job_process:_facts json.loads": Place("2 GiB; a damaged one is computed again", "facts"),
    "batch/job_table:table_rows csv.DictReader": Place("4 MiB", TABLES),
    "batch/processes:_Worker._listen json.loads": Place(PIPE),
    "ears/measured_head:read_bundled numpy.load": Place(OWN),
    "excitation/roughness:_load_profile safetensors.numpy.load": Place(OWN),
    "explorer/jobs:Jobs._compute json.loads": Place(PIPE),
    "explorer/jobs:main json.loads": Place(PIPE),
    "explorer/server:_Answers._answer_with json.loads": Place(
        "64 kB", "tests/explorer/test_server.py::test_bad_changes_get_a_sentence"
    ),
    "files/archives:- bz2.BZ2Decompressor": Place(UNPACKED, PACKED),
    "files/archives:- gzip.GzipFile": Place(UNPACKED, PACKED),
    "files/archives:- lzma.LZMADecompressor": Place(UNPACKED, PACKED),
    "files/archives:_read_zip zipfile.ZipFile": Place(UNPACKED, PACKED),
    "files/contact_log:_csv_lines csv.reader": Place(GUARDED, "log csv; log semicolons"),
    "files/contact_log:_csv_lines json.loads": Place(GUARDED, "log csv"),
    "files/contact_log:_json_lines json.loads": Place(GUARDED, "log jsonl"),
    "files/contact_log:_read_arrays numpy.load": Place(UNPACKED, "log npz"),
    "files/contact_log:_read_arrays zipfile.ZipFile": Place(UNPACKED, "log npz"),
    "files/container:_read_header json.loads": Place("2 GiB, of which 16 MB are JSON", SEALED),
    "files/container:from_bytes json.loads": Place("16 MB", "sound map; cached result"),
    "files/container:unpack safetensors.numpy.load": Place("2 GiB, behind a checksum", SEALED),
    "files/gltf:_open json.loads": Place(GUARDED, GLTF),
    "files/gltf:_open numpy.frombuffer": Place(GUARDED, GLTF),
    "files/mesh_formats:_by_trimesh trimesh.load_scene": Place(
        GUARDED, "surface stl; surface ascii stl; surface ply; surface ascii ply"
    ),
    "files/mesh_formats:_reader getattr(meshio).read": Place(
        GUARDED, "; ".join(name for name in TARGETS if name.startswith("volume"))
    ),
    "files/messages:read_frame json.loads": Place("16 MB; form and lengths are checked", FRAMES),
    "files/model_file:from_bytes json.loads": Place("16 MB", "model"),
    "files/model_file:to_bytes json.loads": Place("written here"),
    "files/model_schema:model_schema json.loads": Place(OWN),
    "files/sofa:answer h5py.File": Place(f"{GUARDED}, 2^27 numbers", SOFA),
    "files/sofa:write_container h5py.File": Place("written here"),
    "files/sound_formats:answer soundfile.SoundFile": Place(f"{GUARDED}, 1 GiB", SOUNDS),
    "files/sound_formats:decoded.decode soundfile.SoundFile": Place("written by `encoded`"),
    "files/sound_formats:encoded.encode soundfile.SoundFile": Place("written here"),
    "files/toml_text:_parse tomllib.loads": Place(
        "4 MiB, keys of 8 parts, 1,000 tables of dotted names, numbers of 63 bits",
        "jobs toml; strikes toml; manifest toml; manifest written; plan",
    ),
    "files/wav:_chunks struct.unpack_from": Place("2 GiB", WAVS),
    "files/wav:_read_comment struct.unpack_from": Place("2 GiB", WAVS),
    "files/wav:_read_format struct.unpack_from": Place("2 GiB", WAVS),
    "files/wav:_unpack numpy.frombuffer": Place("2 GiB, of flat numbers", WAVS),
    "files/worker:main json.loads": Place(PIPE),
    "model/provenance:table_of tomllib.loads": Place(OWN),
    "recordings/manifest:csv_entries csv.reader": Place("4 MiB", "manifest csv"),
    "scene/engines/scene_file:FlatScene._spec mujoco_itself().MjSpec.from_string": Place(
        f"{GUARDED}; then in the program, 20,000 bodies and geoms", SCENES
    ),
    "scene/engines/scene_file:FlatScene.answer numpy.frombuffer": Place("written here"),
    "scene/engines/scene_file:FlatScene.convert_meshes xml.etree.ElementTree.fromstring": Place(
        "written by the separate process, 32 MB", "scene urdf"
    ),
    "scene/engines/scene_file:_parsed xml.etree.ElementTree.fromstring": Place(
        f"{GUARDED}; 32 MB, no entities, 400 levels", SCENES
    ),
}


def parsers(module: Path) -> Iterator[str]:
    """Yield "module:function parser" for each parser that a module names."""
    tree = ast.parse(module.read_text(encoding="utf-8"))
    imported = dict(_imports(tree))
    name = module.relative_to(PACKAGE).with_suffix("").as_posix()
    for owner, node in _with_owners(tree, ""):
        text = _dotted(node, imported)
        if text and PARSER.fullmatch(text):
            yield f"{name}:{owner or '-'} {text}"


def _imports(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """Yield local names with the whole names of what they are."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                if alias.asname:
                    yield alias.asname, alias.name
        if isinstance(node, ast.ImportFrom) and not node.level:
            for alias in node.names:
                yield alias.asname or alias.name, f"{node.module}.{alias.name}"


def _with_owners(node: ast.AST, owner: str) -> Iterator[tuple[str, ast.AST]]:
    """Yield the names below a node outside annotations, with the function or class around them."""
    for name, value in ast.iter_fields(node):
        for child in value if isinstance(value, list) else [value]:
            if not isinstance(child, ast.AST) or name in {"annotation", "returns"}:
                continue
            if isinstance(child, ast.Attribute | ast.Name):
                yield owner, child
            is_scope = isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)
            yield from _with_owners(
                child, f"{owner}.{child.name}".lstrip(".") if is_scope else owner
            )


def _dotted(node: ast.AST, imported: dict[str, str]) -> str:
    """Return a dotted name, whole as far as the imports say; "" of all else."""
    if isinstance(node, ast.Name):
        return imported.get(node.id, node.id)
    if isinstance(node, ast.Attribute):
        base = _dotted(node.value, imported)
        return f"{base}.{node.attr}" if base else ""
    if isinstance(node, ast.Call):
        base = _dotted(node.func, imported)
        if base == "getattr" and node.args and isinstance(node.args[0], ast.Name):
            return f"getattr({node.args[0].id})"
        return f"{base}()" if base else ""
    return ""


def test_every_parser_is_in_the_list_with_its_bounds_and_its_tests() -> None:
    named = {place for path in sorted(PACKAGE.rglob("*.py")) for place in parsers(path)}
    assert sorted(named - PLACES.keys()) == [], "add them to PLACES, with bounds and a fuzz target"
    assert sorted(PLACES.keys() - named) == [], "they are gone: take them out of PLACES"


@pytest.mark.parametrize("tests", sorted({each.tests for each in PLACES.values() if each.tests}))
def test_what_tries_a_parser_is_there(tests: str) -> None:
    file, _, name = tests.partition("::")
    if name:
        source = (PACKAGE.parents[1] / file).read_text(encoding="utf-8")
        assert f"def {name}(" in source
    else:
        assert {*tests.split("; ")} <= TARGETS.keys()


def test_parsers_are_found_by_any_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = """
from tomllib import loads as read
import numpy as np, json
from xml.etree import ElementTree as ET
def outer(data: json.JSONDecoder) -> csv.reader:
    class Inner:
        def use(self, x):
            return read(x), [np.load(y) for y in x]
    return ET.fromstring, partial(lzma.LZMADecompressor), library().MjSpec.from_file(data)
value = getattr(meshio, kind).read
"""
    (tmp_path / "a.py").write_text(source, encoding="utf-8")
    monkeypatch.setattr("tests.fuzz.test_parsers.PACKAGE", tmp_path)
    assert sorted(parsers(tmp_path / "a.py")) == [
        "a:- getattr(meshio).read",
        "a:outer library().MjSpec.from_file",
        "a:outer lzma.LZMADecompressor",
        "a:outer xml.etree.ElementTree.fromstring",
        "a:outer.Inner.use numpy.load",
        "a:outer.Inner.use tomllib.loads",
    ]


@pytest.mark.parametrize("text", ["", "[]", "7", "{", '{"run": 5}', "[" * 20_000, "\ud800"])
def test_a_report_that_is_none(tmp_path: Path, text: str) -> None:
    (tmp_path / PAGES[0]).write_text(text, encoding="utf-8", errors="surrogatepass")
    assert not _is_of("run", tmp_path)
    (tmp_path / PAGES[0]).write_text('{"run": "run"}', encoding="utf-8")
    assert _is_of("run", tmp_path)
