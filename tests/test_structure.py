"""The rules of the house: layers, budgets, names, what an import costs, what no file may name."""

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

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src/struck"
SOURCES = sorted(PACKAGE.rglob("*.py"))

# What later rooms bring to the lines and modules of the rest.
BROUGHT = {
    "touch: textures and envelopes": (500, 2),
    "scene: bodies that turn, contact logs, impulses of trajectories, events": (3_000, 8),
    "explorer: what the page is sent": (250, 2),
    "touch: recorded bodies, their charts and blows": (1_000, 1),
    "touch: the recoil of free bodies": (500, 2),
    "scene/engines: simulations in MuJoCo and Rapier, their verb, live, pictures": (3_500, 16),
    "live: scenes that play, bodies that move, moments": (350, 1),
    "explorer: its server, its objects and its command": (1_500, 6),
    "radiation: boundary elements, multipoles, gains of computed fields": (2_100, 6),
    "batch: tables, processes, data sets, reports, clusters and the command": (1_800, 8),
    "recordings: verdicts, hum, gain control, residuals by default": (1_917, 6),
    "habits: endings, levels of sets, objects of others, places, thread counts": (2_353, 6),
    "figures of the papers": (300, 2),
}
LINES = 47_000 + sum(lines for lines, _ in BROUGHT.values())
MODULES = 200 + sum(modules for _, modules in BROUGHT.values())
LINES_A_FILE, FEW_LINES, LINES_A_BODY = 700, 100, 40
MODULES_A_ROOM, ENTRIES, PUBLIC_NAMES = 20, 22, 40
LARGER_ROOMS = {"cli": 21}  # one command a file, and what they share
C_LINES, C_LINES_A_FILE, C_LINES_A_BODY = 3_000, 500, 60
ALONE = 15  # modules with one importer, in their own room

# Files under 100 lines, and why a reader looks for each by itself.
SHORT: dict[str, str] = {
    "solids/fem/cubic_surface.py": "the surface of thin bodies, which others do not load",
    "report/figurine.py": "a body that pages, examples and proofs share",
    "scene/engines/step_log.py": "what both engines note alike",
    "scene/stems.py": "files that a command and the scenes of 2002 write alike",
    "files/worker.py": "the whole of what runs in the process that reads foreign files",
    **dict.fromkeys(
        (
            f"cli/{name}.py"
            for name in (
                "cache",
                "analyze_many",
                "calibrate",
                "demo",
                "explore",
                "materials",
                "radiate",
                "show",
                "sound_map",
                "tune",
            )
        ),
        "one command a file",
    ),
}
# Modules with one importer in their own room, and why they are not joined to it.
KEPT_ALONE: dict[str, str] = {
    "excitation/envelope.py": "what a ball feels that rolls, a law of its own",
    "batch/cluster.py": "Dask, loaded where a cluster is asked for",
    "explorer/admission.py": "who is let in, for whoever judges how safe the server is",
    "explorer/jobs.py": "runs as processes of its own as well",
    "excitation/path.py": "paths along a surface, which other touches will follow",
    "radiation/remeshing.py": "a subject of its own: the surface, whatever is solved on it",
    "radiation/sound_field.py": "loaded only where a field is computed",
    "scene/engines/convex_parts.py": "a way to cut meshes, by a library of its own",
    "scene/engines/rapier.py": "one engine, loaded where it is asked for",
    "scene/engines/scene_file.py": "two formats, and what is read of them",
    "solids/turned.py": "solids that close on the axis or undercut, by a way of their own",
    "synth/reference.py": "plain NumPy, by which the core is judged",
    "solids/fem/cubic_surface.py": "loaded for thin bodies alone",
    "shapes/bessel_series.py": "Bessel functions and their loops, which are tested by themselves",
}
# Libraries that are imported by the function that uses them.
HEAVY = {"igl", "manifold3d", "matplotlib", "meshio", "scipy.signal", "trimesh"}
# Paths of one machine, and where packages are fetched from.
FOREIGN = re.compile(
    r"(?<![\w.-])/(?:work|root|home/\w+|tmp/\w+)\b"
    r"|index[-]url|https?:/{2}\S*/simple\b|py[p]i\.org|python[h]osted|registry\.npm[j]s"
)


def name_of(path: Path) -> str:
    return path.relative_to(PACKAGE).as_posix()


def lines_of(path: Path) -> int:
    return len(path.read_text(encoding="utf-8").splitlines())


@cache
def trees() -> list[tuple[Path, ast.Module]]:
    return [(path, ast.parse(path.read_text(encoding="utf-8"))) for path in SOURCES]


@cache
def imports() -> grimp.ImportGraph:
    return grimp.build_graph("struck", cache_dir=None)


def body_lines(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Return the lines of a function without signature and docstring."""
    documented = ast.get_docstring(function) is not None
    body = function.body[1:] if documented else function.body
    return (body[-1].end_lineno or 0) - body[0].lineno + 1 if body else 0


def single_importers() -> dict[str, tuple[str, int]]:
    """Return, by module, its one importer and the lines both have, where rooms are the same."""
    graph = imports()
    paths = {path_module(path): path for path in SOURCES}
    found = {}
    for module, path in paths.items():
        importers = graph.find_modules_that_directly_import(module)
        if path.name == "__init__.py" or len(importers) != 1:
            continue
        (importer,) = importers
        same_room = importer.rpartition(".")[0] == module.rpartition(".")[0]
        if same_room and paths[importer].name != "__init__.py":
            found[name_of(path)] = (importer, lines_of(path) + lines_of(paths[importer]))
    return found


def path_module(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def too_long() -> dict[str, int]:
    sizes = {name_of(path): lines_of(path) for path in SOURCES}
    long = {name: lines for name, lines in sizes.items() if lines > LINES_A_FILE}
    for path, tree in trees():
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                lines = body_lines(node)
                if lines > LINES_A_BODY:
                    long[f"{name_of(path)}:{node.name}"] = lines
    return long


def too_short() -> dict[str, int]:
    sizes = {name_of(path): lines_of(path) for path in SOURCES if path.name != "__init__.py"}
    return {name: lines for name, lines in sizes.items() if lines < FEW_LINES}


def crowded() -> dict[str, int]:
    rooms = Counter(path.parent for path in SOURCES)
    most = {room: LARGER_ROOMS.get(name_of(room), MODULES_A_ROOM) for room in rooms}
    return {name_of(room): many for room, many in rooms.items() if many > most[room]}


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
    entries = {path.name for path in PACKAGE.iterdir() if path.suffix == ".py" or path.is_dir()}
    entries -= {"__pycache__"}
    alone = single_importers()
    joinable = {name for name, (_, lines) in alone.items() if lines <= LINES_A_FILE}
    assert sum(map(lines_of, SOURCES)) <= LINES
    assert len(SOURCES) <= MODULES
    assert len(entries) <= ENTRIES, sorted(entries)
    assert not too_long()
    assert too_short().keys() == SHORT.keys(), too_short()
    assert not crowded()
    assert not repeated_files()
    assert not repeated_classes()
    kept = {name for name in joinable if not name.startswith("cli/")}
    assert kept == KEPT_ALONE.keys(), {name: alone[name] for name in kept}
    assert len(KEPT_ALONE) <= ALONE


def test_the_core_is_small() -> None:
    texts = {path: path.read_text(encoding="utf-8") for path in PACKAGE.glob("core/*.[ch]")}
    sizes = {path.name: text.count("\n") for path, text in texts.items()}
    assert 1_000 < sum(sizes.values()) <= C_LINES
    assert max(sizes.values()) <= C_LINES_A_FILE, sizes
    # A body ends with a brace at the margin.
    bodies = [
        body
        for text in texts.values()
        for body in re.findall(r"\{\n(.*?)^\}", text, re.DOTALL | re.MULTILINE)
    ]
    assert len(bodies) > 50
    assert max(body.count("\n") for body in bodies) <= C_LINES_A_BODY


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


LOADED = {
    "a mesh analyzed": (49, "struck.analyze('ball.stl', 'steel', accuracy='preview')"),
    "a loaded model struck": (43, "struck.render(struck.load('m.struck'), struck.Strike())"),
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


@pytest.mark.parametrize("work", LOADED)
def test_work_loads_no_more_modules_than_it_needs(work: str, some_files: Path) -> None:
    most, what = LOADED[work]
    mine = "[name for name in sys.modules if name.partition('.')[0] == 'struck']"
    loaded = run(f"import struck, sys; {what}; print(*{mine})", some_files).split()
    assert 10 < len(loaded) <= most, sorted(loaded)


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


def test_fifteen_questions_are_answered_by_the_files_that_the_page_names() -> None:
    row = re.compile(r"^\| [^|]+ \| `([\w/]+\.(?:py|c))` \| `(\w+)` \|$", re.MULTILINE)
    rows = row.findall(PAGE.read_text(encoding="utf-8"))
    assert len(rows) == 15
    for name, what in rows:
        text = (PACKAGE / name).read_text(encoding="utf-8")
        if name.endswith(".c"):
            assert re.search(rf"^\w.* {what}\(", text, re.MULTILINE), (name, what)
            continue
        tree = ast.parse(text)
        kinds = ast.FunctionDef | ast.ClassDef
        assert what in {node.name for node in tree.body if isinstance(node, kinds)}, (name, what)
