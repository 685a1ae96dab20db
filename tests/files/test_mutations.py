"""Damaged models, manifests and plans: what loads renders finite sound, all else is refused."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import struck
from struck.errors import FileFormatError, StruckError
from struck.files import model_file
from struck.files.container import pack, unpack
from struck.model import Survey, TimbreField
from struck.model.arrays import AnyArray, Array
from struck.model.model import ModalModel
from struck.recordings import read_manifest, read_plan
from struck.recordings.fit import fit_recordings
from struck.shapes import Bar, CircularMembrane
from struck.solids import Block
from tests.files.test_fuzz import IN_TEXT, LEAVES, leaves
from tests.files.test_radiating_model_file import with_a_skin
from tests.radiation.sources import radiating_ball

LONG = pytest.mark.prove
SAMPLE, ALL = range(100), range(100, 1767)  # of each kind: 300 and 5,000 files


@cache
def models() -> list[ModalModel]:
    """Return a model of each kind: formula, elements, one point, recorded and computed field."""
    bar = struck.analyze(Bar(length=0.3, width=0.03, thickness=0.005), "steel", band=(20, 8000))
    head = struck.analyze(
        CircularMembrane(radius=0.1, thickness=1e-3, tension=3000.0), "steel", band=(20, 300)
    )
    block = struck.analyze(
        Block(size=(0.2, 0.03, 0.01), elements=(4, 1, 1)),
        "oak",
        band=(20, 5000),
    )
    sound = struck.render(bar, struck.Strike(), seconds=0.2, sample_rate=8000)
    fitted = fit_recordings(sound, modes=3, residual=True, force=True, cache=False).model
    chance = np.random.default_rng(1)
    frequencies = np.array([300.0, 700.0])
    gains = chance.normal(size=(6, 8, 2)) + 1j * chance.normal(size=(6, 8, 2))
    survey = Survey.full(chance.random((6, 1)), 1 + chance.random((8, 3)), gains, frequencies)
    field = replace(
        fitted,
        gains=TimbreField.of(survey),
        errors=None,
        coordinates=("height",),
        places={},
        **ringing(frequencies),
    )
    return [bar, head, block, fitted, field, with_a_skin(radiating_ball(subdivisions=0)[0])]


def ringing(frequencies: Array) -> dict[str, Array]:
    return {
        "frequencies": frequencies,
        "natural_frequencies": frequencies,
        "decays": np.ones(len(frequencies)),
    }


@cache
def opened(number: int) -> tuple[dict[str, str], dict[str, AnyArray]]:
    """Return what the file of a model holds: metadata and arrays."""
    whole = model_file.to_bytes(models()[number])
    return unpack(whole, kind="struck", newest=model_file.VERSION)


def changed_model(number: int) -> bytes:
    """Return a model file with one to three changes, sealed as if nothing had happened."""
    chance = np.random.default_rng([7, number])
    metadata, tensors = opened(number % len(models()))
    text, arrays = json.loads(metadata["json"]), dict(tensors)
    for _ in range(chance.integers(1, 4)):
        if chance.random() < 0.5:
            change_leaf(text, chance)
        else:
            change_array(arrays, chance)
    return pack(arrays, {**metadata, "json": json.dumps(text)})


def change_leaf(text: dict[str, Any], chance: np.random.Generator) -> None:
    places = list(leaves(text))
    container, key = places[chance.integers(len(places))]
    if chance.random() < 0.2:
        del container[key]
    else:
        container[key] = LEAVES[chance.integers(len(LEAVES))]


NUMBERS = (np.nan, np.inf, -np.inf, -1.0, 0.0, 1e300, -1e300, 1e-320, 1.0, 7.0, 65536.0)


def change_array(arrays: dict[str, Any], chance: np.random.Generator) -> None:
    name = sorted(arrays)[chance.integers(len(arrays))]
    array = arrays[name].copy()
    kind = chance.integers(5)
    if kind == 0:
        del arrays[name]
        return
    if kind == 1:
        array = array[: chance.integers(max(1, len(array)))]
    elif kind == 2:
        array = array.reshape(-1)
    elif kind == 3:
        array = array.astype(np.float32 if array.dtype == np.float64 else np.float64)
    elif array.size:
        with np.errstate(all="ignore"):
            array.flat[chance.integers(array.size)] = np.float64(
                NUMBERS[chance.integers(len(NUMBERS))]
            ).astype(array.dtype)
    arrays[name] = array


def outcome_of_model(number: int) -> str:
    changed, begun = changed_model(number), time.process_time()
    try:
        made = model_file.from_bytes(changed)
    except FileFormatError as error:
        return "refused" if "\n" not in str(error) else "several lines"
    assert time.process_time() - begun < 2
    try:
        sound = struck.render(made, struck.Strike(), seconds=0.02, sample_rate=8000)
    except StruckError:
        return "told"
    assert np.isfinite(sound.samples).all()
    return "heard"


MANIFEST = b"""coordinates = ["height"]
centre = [0.0, 0.0, 0.1]
symmetry = "axial"
[[takes]]
file = "a.wav"
contact = [0.02]
listeners = [[1.0, 0.0, 0.1]]
hit = 1
sample_rate = 48000
lead_in = 0.5
[[takes]]
file = "b.wav"
contact = [0.05]
listeners = [[1.0, 0.0, 0.1]]
"""
PLAN = b"""seconds = 2.0
lead_in = 0.5
sample_rate = 48000
channels = 1
hits = 2
tries = 3
[[contacts]]
name = "rim"
at = [0.1]
[[contacts]]
name = "side"
at = [0.05]
[[listeners]]
name = "front"
at = [1.0, 0.0, 0.0]
"""


def changed_text(plain: bytes, number: int) -> bytes:
    chance = np.random.default_rng([8, number])
    data = bytearray(plain)
    for _ in range(chance.integers(1, 4)):
        data = IN_TEXT[chance.integers(len(IN_TEXT))](data, chance) or bytearray(b" ")
    return bytes(data)


def outcome_of_text(path: Path, number: int) -> str:
    """Return what comes of a changed manifest or plan, by the name of the path."""
    manifest = path.stem == "manifest"
    path.write_bytes(changed_text(MANIFEST if manifest else PLAN, number))
    begun = time.process_time()
    try:
        read_manifest(path) if manifest else read_plan(path)
    except StruckError as error:
        return "refused" if "\n" not in str(error) else "several lines"
    finally:
        assert time.process_time() - begun < 2
    return "read"


@pytest.fixture(autouse=True)
def _takes(tmp_path: Path) -> None:
    for name in ("a.wav", "b.wav"):
        (tmp_path / name).touch()


def test_what_nobody_changed_is_read(tmp_path: Path) -> None:
    for name, plain in (("manifest", MANIFEST), ("plan", PLAN)):
        path = tmp_path / f"{name}.toml"
        path.write_bytes(plain)
        read_manifest(path) if name == "manifest" else read_plan(path)


@pytest.mark.parametrize("numbers", [SAMPLE, pytest.param(ALL, marks=LONG)], ids=["some", "all"])
def test_damaged_models_are_refused_or_sound(numbers: range) -> None:
    outcomes = [outcome_of_model(number) for number in numbers]
    assert {"refused", "heard"} <= set(outcomes) <= {"refused", "heard", "told"}


@pytest.mark.parametrize("kind", ["manifest", "plan"])
@pytest.mark.parametrize("numbers", [SAMPLE, pytest.param(ALL, marks=LONG)], ids=["some", "all"])
def test_damaged_tables_are_refused_or_read(kind: str, numbers: range, tmp_path: Path) -> None:
    path = tmp_path / f"{kind}.toml"
    assert {outcome_of_text(path, number) for number in numbers} == {"refused", "read"}
