"""Options by source: what `analyze` refuses is what the one list names, and defaults avoid it."""

from __future__ import annotations

import pytest
import trimesh

import struck
from struck.analysis.source_options import applicable, refusals
from struck.errors import OptionError
from struck.model.mesh import Mesh
from struck.scene.engines.sound_sources import SoundOptions, SoundSources
from struck.shapes import Bar, CircularMembrane
from struck.solids import Block

BLOCK = Block(size=(0.05, 0.03, 0.02), elements=(2, 1, 1))
BOX = trimesh.creation.box((0.1, 0.05, 0.03))
OPTIONS = {
    "units": "m",
    "size": 0.1,
    "part": "0",
    "up": "z",
    "wall": 0.002,
    "holes": "fill",
    "repair": True,
    "repair_seconds": 20.0,
    "accuracy": "preview",
    "backend": "auto",
    "fixed": ((-1.0, -1.0, -1.0), (0.0, 1.0, 1.0)),
}
SURFACE = {"wall", "holes", "repair", "repair_seconds"}
FILE = {"units", "size", "part", "up"}
SOURCES = {
    "bar": (Bar(length=0.3, width=0.03, thickness=0.005), {*OPTIONS}),
    "membrane": (CircularMembrane(radius=0.1, thickness=2e-4, tension=2000.0), {*OPTIONS}),
    "block": (Block(size=(0.05, 0.03, 0.02)), FILE | SURFACE),
    "block of elements": (BLOCK, FILE | SURFACE | {"accuracy"}),
    "volume mesh": (BLOCK.volume_mesh(), FILE | SURFACE | {"accuracy"}),
    "volume file": ("box.inp", {"size", "part", "up", "accuracy"} | SURFACE),
    "surface": (Mesh(points=BOX.vertices, faces=BOX.faces), FILE - {"part"}),
    "arrays": ((BOX.vertices, BOX.faces), set()),
    "surface file": ("box.obj", set()),
}


class BegunError(Exception):
    """Every option was accepted."""


def stop(_stage: str, _fraction: float) -> None:
    raise BegunError


@pytest.mark.parametrize("name", SOURCES)
def test_options_are_refused_by_the_one_list(name: str) -> None:
    source, expected = SOURCES[name]
    messages = refusals(source)
    assert set(messages) == expected
    for option, value in OPTIONS.items():
        if option == "holes" and option not in expected:
            continue  # it needs a wall beside it
        with pytest.raises((BegunError, OptionError)) as raised:
            struck.analyze(source, "steel", **{option: value}, cache=False, progress=stop)
        refused = isinstance(raised.value, OptionError)
        assert refused == (option in expected), option
        if refused and option != "holes":
            assert str(raised.value) == messages[option].format(value=value)


@pytest.mark.parametrize("name", SOURCES)
def test_applicable_defaults_are_accepted(name: str) -> None:
    source, expected = SOURCES[name]
    options = applicable(source, **OPTIONS)
    assert set(options) == set(OPTIONS) - expected
    options.pop("holes", None)
    with pytest.raises(BegunError):
        struck.analyze(source, "steel", **options, cache=False, progress=stop)


def test_elements_of_a_closed_form_take_what_its_solid_takes() -> None:
    bar = Bar(length=0.3, width=0.03, thickness=0.005)
    assert set(refusals(bar, formula=False)) == FILE | SURFACE


def test_a_simulation_takes_given_elements_as_they_are() -> None:
    """Its accuracy is one for all bodies, and chooses nothing of this one."""
    sources = SoundSources(SoundOptions(band=(20.0, 60e3), cache=False))
    model = sources._analyze_shape(BLOCK, struck.Material.named("steel"), "block")
    assert isinstance(model, struck.ModalModel), model
    assert len(model.frequencies)
