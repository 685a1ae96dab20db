"""The published schema of model files against the code: every kind, every name, files of each."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import struck
from struck.files import fields_file, model_file
from struck.files.container import unpack
from struck.model.chart import Chart
from struck.model.gains import TransverseShapes
from struck.model.material import Material
from struck.model.model import _OTHERS
from struck.model.provenance import Provenance
from struck.model.recoil import Recoil
from struck.model.residual import Residual
from struck.model.timbre_table import SYSTEMS, SinglePoint
from struck.radiation.radiated_power import ESTIMATES
from struck.shapes import (
    Bar,
    CircularMembrane,
    PolygonMembrane,
    RectangularMembrane,
    RectangularPlate,
    String,
)
from tests.files.test_model_file import SCHEMA, complaints

DEFS = SCHEMA["$defs"]
FORMS = {kind.__name__ for kind in model_file._formulas() if kind is not TransverseShapes}
AXES = {"x", "y", "z"}
# By place in the schema: the choices that the code has.
CHOICES: dict[str, set[Any]] = {
    "properties.units": {"SI"},
    "properties.geometry": {"surface", None},
    "properties.up": AXES | {None},
    "properties.gains": set(model_file.GAINS),
    "$defs.radiation": set(ESTIMATES),
    "$defs.timbre_table.properties.system": set(SYSTEMS),
    "$defs.damping": set(model_file._DAMPINGS),
    "$defs.formula.anyOf.1.properties.TransverseShapes.properties.forms": FORMS,
}
# By place in the schema: the names that an object must have by the code.
NAMES: dict[str, set[str]] = {
    "properties.recoil": {each.name for each in fields(Recoil)},
    "properties.provenance": {each.name for each in fields(Provenance)},
    "properties.chart.anyOf.1": {each.name for each in fields(Chart)},
    "$defs.material": {each.name for each in fields(Material)},
    **{
        f"$defs.damping.oneOf.{number}": {"kind", *(each.name for each in fields(law))}
        for number, law in enumerate(model_file._DAMPINGS.values())
    },
}


def at(place: str) -> Any:  # noqa: ANN401 - a part of the schema
    value: Any = SCHEMA
    for key in place.split("."):
        value = value[int(key)] if isinstance(value, list) else value[key]
    return value


def kind_in(schema: dict[str, Any]) -> str:
    whole = DEFS[schema["$ref"].removeprefix("#/$defs/")] if "$ref" in schema else schema
    return whole["properties"]["kind"]["const"]


def choices_in(schema: dict[str, Any]) -> set[Any]:
    if "oneOf" in schema:
        return {kind_in(each) for each in schema["oneOf"]}
    if "const" in schema:
        return {schema["const"]}
    return set(schema["enum"] if "enum" in schema else schema["properties"])


def branches(value: Any, place: str = "") -> Iterator[str]:  # noqa: ANN401 - a part of the schema
    """Yield the places where the schema offers choices."""
    parts = value.items() if isinstance(value, dict) else enumerate(value)
    if isinstance(value, dict) and value.keys() & {"enum", "oneOf", "const", "minProperties"}:
        yield place.removeprefix(".")
    for key, part in parts:
        if isinstance(part, dict | list):
            yield from branches(part, f"{place}.{key}")


@pytest.mark.parametrize("place", CHOICES)
def test_choices_of_the_schema_are_those_of_the_code(place: str) -> None:
    assert choices_in(at(place)) == CHOICES[place]


@pytest.mark.parametrize("place", NAMES)
def test_names_of_the_schema_are_those_of_the_code(place: str) -> None:
    schema = at(place)
    assert set(schema["properties"]) == NAMES[place]
    assert set(schema["required"]) == NAMES[place] - {"contains_air"}  # absent in older files


def test_no_choice_of_the_schema_is_left_unchecked() -> None:
    kinds = {place for place in branches(SCHEMA) if place.endswith(".properties.kind")}
    assert {*branches(SCHEMA)} - kinds == set(CHOICES)


def test_fields_of_recordings_are_among_the_gains() -> None:
    assert set(fields_file.FIELDS) <= set(model_file.GAINS)


PAGE = Path(__file__).parents[2] / "docs/reference/model_file.md"


def test_the_page_on_model_files_lists_every_key_of_the_schema() -> None:
    metadata, gains = (
        PAGE.read_text(encoding="utf-8").split("## Metadata")[1].split("| `gains.kind`")
    )
    rows = re.findall(r"^\| (`[^|]*) \|", metadata, re.MULTILINE)
    keys = {key for row in rows for key in re.findall(r"`([a-z_]+)`", row)}
    assert keys == set(SCHEMA["properties"])
    for each in SCHEMA["properties"]["gains"]["oneOf"]:
        assert f"| `{kind_in(each)}` |" in gains


def test_files_with_a_residual_follow_the_schema() -> None:
    bands = {"edges": np.array([20.0, 2e4]), "levels": np.ones(1), "decays": np.ones(1)}
    residual = Residual(attack=np.ones(8, np.float32), sample_rate=48_000, lead=1e-4, **bands)
    one = SinglePoint(outputs=np.ones(1, complex))
    model = struck.ModalModel(
        frequencies=np.array([440.0]),
        natural_frequencies=np.array([440.0]),
        decays=np.ones(1),
        gains=one,
        complete_to=0.0,
        coordinates=(),
        places={"recorded": np.zeros(0)},
        residual=residual,
    )
    text = model_file._serialise(model)[0]
    assert set(text["residual"]) == set(at("properties.residual.anyOf.1")["properties"])
    assert complaints(text, SCHEMA, SCHEMA) == []
    text["residual"]["sample_rate"] = 0.5
    assert complaints(text, SCHEMA, SCHEMA)


def test_modes_that_are_not_the_objects_are_listed_by_number() -> None:
    details = SCHEMA["properties"]["provenance"]["properties"]["details"]
    assert set(details["properties"]) == set(_OTHERS)
    for kind in _OTHERS:
        assert complaints({kind: [0, 3]}, details, SCHEMA) == []
        assert complaints({kind: ["noise"]}, details, SCHEMA)
        assert complaints({kind: [-1]}, details, SCHEMA)


SHAPES = {
    "BendingForms": Bar(length=0.3, width=0.03, thickness=0.005),
    "PolygonForms": PolygonMembrane.l_shape(side=0.3, thickness=2e-4, tension=300.0),
    "RitzForms": RectangularPlate(length=0.3, width=0.2, thickness=0.002),
    "RoundForms": CircularMembrane(radius=0.2, thickness=2e-4, tension=300.0),
    "SineForms": RectangularMembrane(length=0.4, width=0.3, thickness=2e-4, tension=300.0),
    "StringForms": String(length=0.6, radius=2e-4, tension=60.0),
}


def test_every_form_has_a_body() -> None:
    assert set(SHAPES) == FORMS


@pytest.mark.parametrize("name", SHAPES)
def test_files_of_each_closed_form_follow_the_schema(name: str) -> None:
    material = "mylar" if "tension" in repr(SHAPES[name]) else "steel"
    band = (20, 150 if name == "PolygonForms" else 600)  # its modes take longest
    model = struck.analyze(SHAPES[name], material, band=band, recoil=False)
    metadata, _ = unpack(model_file.to_bytes(model), kind="struck", newest=model_file.VERSION)
    text = json.loads(metadata["json"])
    assert set(text["gains"]["formula"]["TransverseShapes"]["forms"]) == {name}
    assert complaints(text, SCHEMA, SCHEMA) == []
    text["gains"]["formula"]["TransverseShapes"]["forms"] = {"OtherForms": {}}
    assert complaints(text, SCHEMA, SCHEMA)


@pytest.mark.parametrize("name", ESTIMATES)
def test_files_of_each_estimate_follow_the_schema(name: str) -> None:
    model = struck.analyze(SHAPES["BendingForms"], "steel", band=(20, 3000), radiation=name)
    metadata, _ = unpack(model_file.to_bytes(model), kind="struck", newest=model_file.VERSION)
    text = json.loads(metadata["json"])
    assert text["gains"]["radiation"] == name
    assert complaints(text, SCHEMA, SCHEMA) == []
    assert complaints({**text, "gains": {**text["gains"], "radiation": "other"}}, SCHEMA, SCHEMA)
