"""Pictures are drawn in matplotlib's own style, and what a user has set stays set."""

from __future__ import annotations

import ast
import builtins
import io
import threading
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

import struck
from struck.errors import FileFormatError
from struck.model.html import picture
from struck.model.picture_style import default_style
from struck.report import overview
from struck.report.charts import save, spectrogram

PACKAGE = Path(struck.__file__).parent
HOSTILE = {
    "text.usetex": True,
    "font.size": 33.0,
    "figure.figsize": (1.0, 1.0),
    "savefig.dpi": 7.0,
    "savefig.bbox": "tight",
    "axes.facecolor": "red",
    "image.cmap": "jet",
    "lines.linewidth": 9.0,
}
# These return figures that others of the list draw.
OTHERS = {"chart", "show", "_planned"}


@pytest.fixture(scope="module")
def bar() -> struck.ModalModel:
    body = struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005)
    return struck.analyze(body, "steel", band=(20, 4000))


@pytest.fixture
def hostile() -> Iterator[dict[str, object]]:
    with mpl.rc_context(HOSTILE):
        yield dict(mpl.rcParams)


def png(figure: Figure) -> bytes:
    data = io.BytesIO()
    figure.savefig(data, format="png")
    return data.getvalue()


def test_an_unknown_backend_is_refused_in_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    """By matplotlib as it is imported, where a variable MPLBACKEND names one."""
    plain = builtins.__import__

    def refusing(name: str, *given: Any, **named: Any) -> Any:  # noqa: ANN401 - as its original
        if name == "matplotlib":
            raise ValueError("Key backend: 'nonsense' is not a valid value; supported are ['agg']")
        return plain(name, *given, **named)

    monkeypatch.setattr(builtins, "__import__", refusing)
    refusal = pytest.raises(FileFormatError, match=r"value\): correct or unset .* MPLBACKEND$")
    with refusal, default_style():
        pass


@pytest.mark.prove
def test_pictures_are_the_same_and_settings_stay(bar: struck.ModalModel, tmp_path: Path) -> None:
    """In a file and on a page, drawn and saved under the settings of a user."""

    def drawn(path: Path) -> tuple[bytes, str]:
        figure = overview(bar)
        save(figure, path)
        return path.read_bytes(), picture("a bar", figure)

    clean = drawn(tmp_path / "clean.png")
    with mpl.rc_context(HOSTILE):
        before = dict(mpl.rcParams)
        assert drawn(tmp_path / "hostile.png") == clean
        assert dict(mpl.rcParams) == before


@pytest.mark.usefixtures("hostile")
def test_user_saves_a_returned_figure_without_latex(bar: struck.ModalModel) -> None:
    """Ticks are made when a figure is drawn: by then the user's settings are back."""
    mpl.rcParams["savefig.dpi"] = "figure"
    sound = struck.render(bar, struck.Strike(), seconds=0.1)
    assert len(png(spectrogram(sound))) > 10_000


def test_settings_stay_after_an_error(hostile: dict[str, object]) -> None:
    def fail() -> None:
        with default_style(), default_style():
            assert mpl.rcParams["text.usetex"] is False
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert dict(mpl.rcParams) == hostile


def test_own_settings_within_a_drawing_end_with_it(hostile: dict[str, object]) -> None:
    with default_style():
        mpl.rcParams["lines.linewidth"] = 5.0
    assert dict(mpl.rcParams) == hostile


def test_threads_do_not_leave_each_others_settings(hostile: dict[str, object]) -> None:
    """Who leaves last would otherwise restore what the first one had set."""
    widths, inside = [], threading.Barrier(2, timeout=0.3)

    def draw() -> None:
        with default_style():
            widths.append(mpl.rcParams["lines.linewidth"])
            with suppress(threading.BrokenBarrierError):  # as one of them waits outside
                inside.wait()

    threads = [threading.Thread(target=draw) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert inside.broken
    assert widths == [mpl.rcParamsDefault["lines.linewidth"]] * 2
    assert dict(mpl.rcParams) == hostile


def test_users_own_figure_keeps_its_settings() -> None:
    with mpl.rc_context({"lines.linewidth": 9.0, "axes.facecolor": "red"}):
        axes = Figure().subplots()
        with default_style():
            axes.plot(np.arange(3))
        axes.plot(np.arange(3))
    assert [line.get_linewidth() for line in axes.lines] == [1.5, 9.0]
    assert axes.get_facecolor() == (1.0, 0.0, 0.0, 1.0)


def test_each_function_that_draws_does_so_in_the_default_style() -> None:
    plain = []
    for path in sorted(PACKAGE.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if "Figure" not in text:
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef):
                draws = node.returns is not None and ast.unparse(node.returns) == "Figure"
                saves = any(getattr(each, "attr", "") == "savefig" for each in ast.walk(node))
                styled = "in_default_style" in map(ast.unparse, node.decorator_list)
                if (draws or saves) and not styled and node.name not in OTHERS:
                    plain.append(f"{path.name}: {node.name}")
    assert not plain
