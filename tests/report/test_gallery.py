"""The gallery: its recording, and the list of what it made."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from importlib import import_module
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

import struck
from struck.cli import main
from struck.recordings.fit import fit_recordings
from struck.report.gallery import NAME, recording


@pytest.mark.prove
def test_the_recording_is_found_and_heard_in_three_sizes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gallery = import_module("struck.report.gallery")  # the package names a function so, too
    monkeypatch.setattr(
        gallery, "fit_recordings", partial(fit_recordings, modes=8, force=True, cache=False)
    )
    monkeypatch.setattr(gallery, "report", lambda made: made.recorded.takes[0].name)
    assert recording(tmp_path, lambda _stage, _share: None).endswith("tabla.wav")
    assert 0 < len(struck.load(tmp_path / f"{NAME}.struck").frequencies) <= 8
    for size in ("half", "recorded", "twice"):
        sound = struck.Sound.load(tmp_path / f"{NAME}_{size}.wav")
        assert abs(sound.samples[:, 0]).max() < 0.01 * sound.peak  # no jump


@pytest.mark.prove
def test_a_recorded_drum_becomes_a_model_and_a_page(tmp_path: Path) -> None:
    page = recording(tmp_path, lambda _stage, _share: None)
    model = struck.load(tmp_path / f"{NAME}.struck")
    assert page.startswith("<!doctype html>")
    assert len(model.frequencies) <= 64
    assert model.provenance.details["signal_to_residual"] > 25
    for name in ("half", "recorded", "twice"):
        assert struck.Sound.load(tmp_path / f"{NAME}_{name}.wav").peak > 0


@pytest.mark.prove
def test_pages_tell_formulas_from_elements_and_which_damping_is_used() -> None:
    origin = import_module("struck.report.gallery")._origin
    tube = struck.solids.Tube(length=0.1, radius=0.0125, wall=0.001)
    by_elements = struck.analyze(
        tube, "aluminium", accuracy="preview", damping="heard", band=(20, 6000)
    )
    assert 'finite elements; damping "as heard"' in origin(by_elements)
    bar = struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005, ends="free")
    assert "a formula; its own losses" in origin(struck.analyze(bar, "steel"))
    die = struck.solids.Block(size=(0.012, 0.012, 0.012))
    assert "by its recoil alone" in origin(struck.analyze(die, "steel", accuracy="preview"))


Entry = Callable[..., Iterator[tuple[str, str]]]


def entries(names: dict[str, str], *, stops_after: int = 9) -> Entry:
    """Return a maker of pages by their titles, which is stopped by Ctrl-C after some of them."""

    def make(folder: Path, *_: object) -> Iterator[tuple[str, str]]:
        for number, (name, title) in enumerate(names.items()):
            if number == stops_after:
                raise KeyboardInterrupt
            (folder / name).write_text(title, encoding="utf-8")
            yield name, title

    return make


@pytest.fixture
def gallery(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Return the module with two pages in place of all that takes long."""
    module = import_module("struck.report.gallery")
    monkeypatch.setattr(module, "_pages_of_shapes", entries({}))
    monkeypatch.setattr(module, "_page_of_scenes", entries({"scenes.html": "Scenes"}))
    monkeypatch.setattr(module, "recording", lambda _folder, _progress: "a drum")
    monkeypatch.setattr(module, "SOLIDS", ())
    return module


@pytest.mark.usefixtures("gallery")
def test_demo_leaves_a_list_of_what_it_made(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The command as `make demo OPEN=0` runs it."""
    assert main(["demo", "--out", str(tmp_path / "made")]) == 0
    said = capsys.readouterr().out
    assert str(tmp_path / "made" / "list.txt") in said
    assert "struck explore" in said
    listed = (tmp_path / "made" / "list.txt").read_text(encoding="utf-8").splitlines()
    assert listed == sorted({"index.html", "scenes.html", f"{NAME}.html"})
    assert {path.name for path in (tmp_path / "made").iterdir()} == {*listed, "list.txt"}
    assert "so far" not in (tmp_path / "made" / "index.html").read_text(encoding="utf-8")


def test_files_of_scenes_are_apart_from_those_of_bodies(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    obrien2002 = import_module("struck.report.obrien2002")

    def write(_played: object, folder: Path) -> list[Path]:
        paths = [folder / f"bowl{ending}" for ending in (".wav", ".png", ".glb", ".xml")]
        for path in paths:
            path.write_bytes(b"scene")
        return paths[:1]

    staged = SimpleNamespace(name="bowl", title="A bowl", text="in two materials")
    monkeypatch.setattr(obrien2002, "SCENES", {"bowl": lambda *_: staged})
    monkeypatch.setattr(obrien2002, "_played", lambda *_: None)
    monkeypatch.setattr(obrien2002, "_saved", write)
    Path(tmp_path, "bowl.png").write_bytes(b"body")
    (section,) = obrien2002.scene_sections(tmp_path)
    links = re.findall(r'(?:src|href)="([^"]+)"', section)
    assert len(links) == 4
    assert {Path(tmp_path, link).read_bytes() for link in links} == {b"scene"}
    assert Path(tmp_path, "bowl.png").read_bytes() == b"body"


def test_the_index_is_there_first_and_grows_with_each_entry(
    tmp_path: Path, gallery: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[str] = []

    def watched(folder: Path, *_: object) -> Iterator[tuple[str, str]]:
        for name in ("a.html", "b.html"):
            seen.append((folder / "index.html").read_text(encoding="utf-8"))
            yield name, f"page {name}"
        seen.append((folder / "index.html").read_text(encoding="utf-8"))

    monkeypatch.setattr(gallery, "_pages_of_shapes", watched)
    index = gallery.gallery(tmp_path)
    for number, page in enumerate(seen):
        assert page.count('href="') == number
        assert f"{['0 entries', '1 entry', '2 entries'][number]} made so far: reload" in page
    assert index.read_text(encoding="utf-8").count('href="') == 4


@pytest.mark.parametrize("after", [0, 1, 2])
def test_a_stopped_demo_leaves_a_page_of_its_finished_entries(
    after: int, tmp_path: Path, gallery: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    pages = {"string.html": "A string", "bar.html": "A bar", "drum.html": "A drum"}
    monkeypatch.setattr(gallery, "_pages_of_shapes", entries(pages, stops_after=after))
    with pytest.raises(KeyboardInterrupt):
        gallery.gallery(tmp_path)
    index = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert index.endswith("</html>\n")
    assert re.findall('href="(.*?)"', index) == list(pages)[:after]
    assert all((tmp_path / name).is_file() for name in re.findall('href="(.*?)"', index))
    listed = (tmp_path / "list.txt").read_text(encoding="utf-8").splitlines()
    assert listed == sorted(["index.html", *list(pages)[:after]])


def test_a_solid_is_on_the_index_as_soon_as_it_is_made(
    tmp_path: Path, gallery: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Stopped:
        name = "stopped"

        def exhibit(self, _folder: Path, _progress: object) -> None:
            raise KeyboardInterrupt

    die = gallery.Piece(
        name="die",
        body=lambda: struck.solids.Block(size=(0.012, 0.012, 0.012)),
        material="steel",
        sounds=(("steel", struck.Strike(at="top", striker="steel", speed=0.5)),),
    )
    monkeypatch.setattr(gallery, "SOLIDS", (die, Stopped()))
    with pytest.raises(KeyboardInterrupt):
        gallery.gallery(tmp_path)
    index = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert index.count("<section>") == 1
    assert f"<h2>{die.title}</h2>" in index
    assert "3 entries made so far" in index


@pytest.mark.parametrize(("terminal", "display"), [(True, True), (True, False), (False, True)])
def test_demo_opens_the_room_where_there_are_a_terminal_and_a_display(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    *,
    terminal: bool,
    display: bool,
) -> None:
    """The command as `make demo` runs it."""
    opened, made = [], tmp_path / "made"

    def explore() -> SimpleNamespace:
        opened.append("the room")
        return SimpleNamespace(url="http://127.0.0.1")

    def gallery(folder: Path, *_: object, **_options: object) -> Path:
        return folder / "index.html"

    monkeypatch.setattr(sys.stdin, "isatty", lambda: terminal)
    monkeypatch.setattr(struck, "explore", explore)
    monkeypatch.setattr(import_module("struck.explorer.server"), "has_display", lambda: display)
    monkeypatch.setattr(import_module("struck.report.gallery"), "gallery", gallery)
    assert main(["demo", "--out", str(made), "--open"]) == 0
    both = terminal and display
    assert opened == (["the room"] if both else [])
    assert (str(made / "index.html") in capsys.readouterr().out) is not both


@pytest.mark.parametrize(("variables", "options"), [((), " --open"), (("OPEN=0",), "")])
def test_make_demo_runs_the_command(variables: tuple[str, ...], options: str) -> None:
    root = Path(__file__).parents[2]
    passed = ("MAKE", "OPEN")
    environment = {name: os.environ[name] for name in os.environ if not name.startswith(passed)}
    command = ["make", "--no-print-directory", "-n", "-o", ".venv/all.stamp", "demo", *variables]
    done = subprocess.run(
        command, cwd=root, env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == f".venv/bin/struck demo --out gallery{options}"
