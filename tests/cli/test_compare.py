"""`struck compare` from the shell: a body beside itself, beside another, beside what is none."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import struck
from struck.cli import Parser, Result, declare
from struck.errors import ContactError, FileFormatError, OptionError
from struck.model.provenance import TerminalProgress
from struck.shapes import Bar
from struck.solids import Block

RATE = 44_100
PLACES = {"bar": "end", "block": "corner"}
MODES = {"bar": 12, "block": 11}
"""That are heard: sideways a block's top wakes none."""


def struck_compare(*arguments: object) -> Result:
    whole = Parser(prog="struck")
    declare(whole.add_subparsers().add_parser("compare"), "compare")
    options = whole.parse_args(["compare", *map(str, arguments)])
    return options.run(options, TerminalProgress())


@pytest.fixture(scope="module", params=["bar", "block"])
def body(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a model and a recording of it, struck after a lead-in."""
    folder = tmp_path_factory.mktemp(request.param)
    bodies = {
        "bar": (Bar(length=0.3, width=0.03, thickness=0.005), "steel"),
        "block": (Block(size=(0.2, 0.03, 0.01)), "oak"),
    }
    solid, material = bodies[request.param]
    how = {} if request.param == "bar" else {"accuracy": "preview"}
    model = struck.analyze(solid, material, recoil=False, **how)
    struck.save(model, folder / "model.struck")
    strike = struck.Strike(at=PLACES[request.param], striker="wood", time=0.35)
    struck.render(model, strike, seconds=2.5, sample_rate=RATE).save(folder / "real.wav")
    return folder


def test_a_body_beside_itself_at_another_contact(body: Path) -> None:
    """Under 0.1 cent and 2 % of decay, in every mode that either has."""
    kind = "bar" if body.name.startswith("bar") else "block"
    contact = {"bar": "quarter", "block": "0.07,0.01,0.005"}[kind]
    told = struck_compare(body / "model.struck", body / "real.wav", "--strike", contact)
    facts = json.loads(json.dumps(told.facts))
    pairs = facts["pairs"]
    assert len(pairs) == MODES[kind]
    assert max(abs(pair["cents"]) for pair in pairs) < 0.1
    assert max(abs(pair["decay_ratio"] - 1) for pair in pairs) < 0.02
    assert min(pair["confidence"] for pair in pairs) > 0.9
    assert np.ptp([pair["level_difference"] for pair in pairs if pair["level_difference"]]) > 1
    assert facts["explained"]
    assert not facts["extra"]
    model = struck.load(body / "model.struck")
    assert len(model.frequencies) >= MODES[kind]
    expected = model.frequencies[[pair["mode"] - 1 for pair in pairs]]
    assert [pair["frequency"] for pair in pairs] == expected.tolist()


@pytest.mark.parametrize("body", ["bar"], indirect=True)
def test_people_read_the_summary_and_get_a_page(body: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    told = struck_compare(body / "model.struck", body / "real.wav", "-o", page)
    lines = told.lines
    assert lines[-1] == f"wrote {page}"
    assert told.facts["output"] == str(page)
    written = page.read_text(encoding="utf-8")
    assert written.count("<audio") == 2
    assert all(line in written for line in lines[:-1])


@pytest.mark.parametrize("body", ["bar"], indirect=True)
def test_two_models_are_told_apart(body: Path, tmp_path: Path) -> None:
    struck.save(struck.load(body / "model.struck").scaled(1.01), tmp_path / "larger.struck")
    told = struck_compare(
        body / "model.struck", tmp_path / "larger.struck", "--strike", "end", "--against", "end"
    )
    cents = [pair["cents"] for pair in json.loads(json.dumps(told.facts))["pairs"]]
    assert cents == pytest.approx(len(cents) * [-1200 * np.log2(1.01)], abs=0.2)


@pytest.mark.parametrize("body", ["bar"], indirect=True)
def test_what_cannot_be_compared_is_refused(body: Path, tmp_path: Path) -> None:
    model, real = body / "model.struck", body / "real.wav"
    with pytest.raises(ContactError, match="the place is 'rim'"):
        struck_compare(model, real, "--strike", "rim")
    with pytest.raises(OptionError, match="struck once"):
        struck_compare(model, real, "--against", "end")
    with pytest.raises(FileFormatError, match="no folder"):
        struck_compare(model, real, "-o", tmp_path / "nowhere" / "page.html")
    with pytest.raises(FileFormatError):
        struck_compare(model, tmp_path / "nothing.wav")
    with pytest.raises(OptionError, match=r"is no model, and .* give the model first"):
        struck_compare(real, model)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("body", ["bar"], indirect=True)
@pytest.mark.parametrize("name", ["model.struck", "real.wav"])
def test_no_page_replaces_what_is_compared(body: Path, name: str) -> None:
    before = (body / name).read_bytes()
    with pytest.raises(FileFormatError, match="another name"):
        struck_compare(body / "model.struck", body / "real.wav", "-o", body / name)
    assert (body / name).read_bytes() == before
