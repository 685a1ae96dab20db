"""The rules of the house: layers, names, what an import costs, what no file may name."""

from __future__ import annotations

import ast
import graphlib
import re
import subprocess
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import grimp
import numpy as np
import pytest
import trimesh

import struck
from tests.samples import sampled

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src/struck"
SOURCES = sorted(PACKAGE.rglob("*.py"))

PUBLIC_NAMES = 40
# Libraries that are imported by the function that uses them.
HEAVY = {"igl", "manifold3d", "matplotlib", "meshio", "scipy.signal", "trimesh"}
# Paths of one machine, and where packages are fetched from.
FOREIGN = re.compile(
    r"(?<![\w.-])/(?:work|root|home/\w+|tmp/\w+)\b"
    r"|index[-]url|https?:/{2}\S*/simple\b|py[p]i\.org|python[h]osted|registry\.npm[j]s"
)


def name_of(path: Path) -> str:
    return path.relative_to(PACKAGE).as_posix()


@cache
def trees() -> list[tuple[Path, ast.Module]]:
    return [(path, ast.parse(path.read_text(encoding="utf-8"))) for path in SOURCES]


@cache
def imports() -> grimp.ImportGraph:
    return grimp.build_graph("struck", cache_dir=None)


def path_module(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def repeated_files() -> list[str]:
    modules = [path for path in SOURCES if path.name != "__init__.py" and path.parent.name != "cli"]
    return [name for name, count in Counter(path.name for path in modules).items() if count > 1]


def repeated_classes() -> dict[str, list[str]]:
    holders = defaultdict(list)
    for path, tree in trees():
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                holders[node.name].append(name_of(path))
    return {name: paths for name, paths in holders.items() if len(paths) > 1}


def written_files() -> Iterator[Path]:
    folders = ("src", "tests", "docs", "bench", "examples", ".ci")
    inside = (path for folder in folders for path in (ROOT / folder).rglob("*"))
    for path in (*ROOT.iterdir(), *inside):
        generated = {"__pycache__", "_build"} & set(path.parts)
        generated |= {"made by Sphinx"} if path.is_relative_to(ROOT / "docs/gallery") else set()
        if path.is_file() and path.name != ".git" and not generated:
            yield path


def test_rules_of_the_house() -> None:
    assert not repeated_files()
    assert not repeated_classes()


def test_public_names_are_few_and_exist() -> None:
    assert 0 < len(struck.__all__) <= PUBLIC_NAMES
    assert len(set(struck.__all__)) == len(struck.__all__)
    assert not [name for name in struck.__all__ if not hasattr(struck, name)]


def offered(stub: Path) -> tuple[str, list[str]]:
    """Return a room and the names that its stub offers."""
    statements = ast.parse(stub.read_text(encoding="utf-8")).body
    imports = [each for each in statements if isinstance(each, ast.ImportFrom)]
    return path_module(stub), [alias.name for each in imports for alias in each.names]


@pytest.mark.prove
def test_names_of_a_room_are_there_whichever_room_comes_first() -> None:
    rooms = dict(map(offered, sorted(PACKAGE.rglob("*.pyi"))))
    assert sum(map(len, rooms.values())) > 100
    run(f"""if True:
        import importlib, sys
        for room, names in {rooms}.items():
            for module in [each for each in sys.modules if each.partition(".")[0] == "struck"]:
                del sys.modules[module]
            for name in names:
                getattr(importlib.import_module(room), name)
    """)


def test_documents_name_public_places_alone() -> None:
    page = (ROOT / "docs/reference/api.md").read_text(encoding="utf-8")
    documented = re.findall(r"^\.\. auto\w+:: (struck\S*)", page, re.MULTILINE)
    deep = [name for name in documented if not public(name)]
    assert len(documented) > 10
    assert not deep


def public(name: str) -> bool:
    """Return whether a dotted name is a room, or a name that its room's stub offers."""
    parts = name.split(".")
    folder = ROOT / "src" / Path(*parts)
    if folder.is_dir() or name == "struck.errors":
        return True
    stub = folder.parent / "__init__.pyi"
    return stub.is_file() and f" as {parts[-1]}\n" in stub.read_text(encoding="utf-8")


def test_modules_do_not_import_each_other_in_circles() -> None:
    graph = imports()
    needed = {module: graph.find_modules_directly_imported_by(module) for module in graph.modules}
    graphlib.TopologicalSorter(needed).prepare()  # raises CycleError, which names the circle


def test_folders_within_a_subpackage_have_no_circles() -> None:
    """A folder such as `solids.fem` counts as one, modules next to it one by one."""
    graph = imports()

    def unit(module: str) -> str:
        return ".".join(module.split(".")[:3])

    needed: dict[str, set[str]] = defaultdict(set)
    for module in graph.modules:
        needed[unit(module)] |= set(map(unit, graph.find_modules_directly_imported_by(module)))
    needed = {name: others - {name} for name, others in needed.items() if name.count(".") == 2}
    graphlib.TopologicalSorter(needed).prepare()  # raises CycleError, which names the circle


def test_layers_hold() -> None:
    linter = Path(sys.executable).with_name("lint-imports")
    done = subprocess.run(
        [linter, "--no-cache"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout


def run(program: str, folder: Path = ROOT) -> str:
    """Return what a fresh interpreter prints."""
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
    return done.stdout


# Modules of struck that a task loads, when last measured. Today's number may grow by 30 % until
# the entry is measured again, so that a new module does not fail here and an eager import does.
LOADED = {
    "a mesh analyzed": (49, "struck.analyze('ball.stl', 'steel', accuracy='preview')"),
    "a loaded model struck": (56, "struck.render(struck.load('m.struck'), struck.Strike())"),
    "a recording fitted": (60, "struck.fit('tap.wav', cache=False)"),
}


@pytest.fixture(scope="module")
def some_files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a mesh, a model and a recording of it."""
    folder = tmp_path_factory.mktemp("files")
    trimesh.creation.icosphere(subdivisions=2, radius=0.08).export(folder / "ball.stl")
    block = struck.solids.Block(size=(0.1, 0.02, 0.01))
    model = struck.analyze(block, "steel", accuracy="preview")
    struck.save(model, folder / "m.struck")
    sound = struck.render(model, struck.Strike(), seconds=1.0)
    samples = np.pad(sound.samples, ((0, 0), (24_000, 0))) / sound.peak
    noise = 1e-4 * np.random.default_rng(0).standard_normal(samples.shape)
    taken = np.float32(0.5 * samples + noise)
    struck.Sound(samples=taken, sample_rate=48_000).save(folder / "tap.wav")
    return folder


@pytest.mark.parametrize("work", sampled(LOADED, "a mesh analyzed", "a loaded model struck"))
def test_work_loads_no_more_modules_than_it_needs(work: str, some_files: Path) -> None:
    measured, what = LOADED[work]
    mine = "[name for name in sys.modules if name.partition('.')[0] == 'struck']"
    loaded = run(f"import struck, sys; {what}; print(*{mine})", some_files).split()
    assert 10 < len(loaded) <= 1.3 * measured, sorted(loaded)


def test_import_is_light() -> None:
    assert not run(f"import sys, struck; print(*sorted({HEAVY} & set(sys.modules)))").split()


@pytest.mark.parametrize("path", [["", "root", "struck"], ["cd ", "work", "x"], ["'", "tmp", "a"]])
def test_paths_of_a_machine_are_recognised(path: list[str]) -> None:
    assert FOREIGN.search("/".join(path))


def test_no_file_names_a_machine_or_a_registry() -> None:
    texts = {path: path.read_bytes().decode("utf-8", errors="ignore") for path in written_files()}
    found = {path.relative_to(ROOT).as_posix(): FOREIGN.findall(texts[path]) for path in texts}
    assert not {name: hits for name, hits in found.items() if hits}


PAGE = ROOT / "docs/explanation/architecture.md"


def test_page_of_the_layers_is_that_of_the_real_imports() -> None:
    from docs.layers import table

    shown = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line[:2] == "| "]
    parts = [line.split("|") for line in table()]
    real = {row[1].strip(): row[4].strip() for row in parts[2:]}
    told = [line.split("|") for line in shown]
    listed = {row[1].strip(): row[4].strip() for row in told if len(row) == 6}
    assert {room: listed.get(room) for room in real} == real


def test_topics_of_the_page_are_in_the_files_that_it_names() -> None:
    row = re.compile(r"^\| [^|]+ \| `([\w/]+\.(?:py|c|js))` \| `(\w+)` \|$", re.MULTILINE)
    rows = row.findall(PAGE.read_text(encoding="utf-8"))
    assert len(rows) == 26
    for name, what in rows:
        text = (PACKAGE / name).read_text(encoding="utf-8")
        if not name.endswith(".py"):
            definition = rf"^\w.* {what}\(" if name.endswith(".c") else rf"^export class {what} "
            assert re.search(definition, text, re.MULTILINE), (name, what)
            continue
        tree = ast.parse(text)
        kinds = ast.FunctionDef | ast.ClassDef
        assert what in {node.name for node in tree.body if isinstance(node, kinds)}, (name, what)
