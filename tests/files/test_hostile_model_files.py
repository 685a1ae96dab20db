"""Well-sealed model files and sound maps whose content is wrong: each is one FileFormatError."""

from __future__ import annotations

import json
import re
import tracemalloc
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import struck
from struck.errors import FileFormatError, MeshError, StruckError
from struck.files import model_file
from struck.files.container import from_plain, pack, to_plain
from struck.files.model_schema import _RULES, require_schema
from struck.model.provenance import Provenance
from struck.perception.sound_map import SoundMap
from tests.files.test_model_file import SCHEMA, complaints, model
from tests.samples import sampled

Tensors = dict[str, Any]


@pytest.fixture(scope="module")
def content() -> tuple[str, Tensors]:
    """Return the metadata, as JSON, and the tensors of a model."""
    text, tensors = model_file._serialise(model())
    return json.dumps(text, default=model_file._plain), tensors


def refused(text: object, tensors: Tensors, version: str = "2") -> str:
    data = pack(tensors, {"format": "struck", "version": version, "json": json.dumps(text)})
    with pytest.raises(FileFormatError) as caught:
        model_file.from_bytes(data)
    return str(caught.value)


# Geometry


def without_area(points: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return points, np.zeros_like(faces)


def on_a_line(points: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return points * [1.0, 0.0, 0.0], faces


def below_arithmetic(points: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return points * 1e-100, faces


@pytest.mark.parametrize("damage", [without_area, on_a_line, below_arithmetic])
def test_surfaces_without_an_area_are_refused_in_one_sentence(
    content: tuple[str, Tensors], damage: Callable[..., tuple[np.ndarray, np.ndarray]]
) -> None:
    """Rendering a model of such a surface did not end."""
    text, tensors = content
    points, faces = damage(tensors["vertices"], tensors["faces"])
    with pytest.raises(
        MeshError, match=f"all of its {len(faces)} faces are lines or points"
    ) as caught:
        struck.Mesh(points=points, faces=faces)
    assert refused(json.loads(text), {**tensors, "vertices": points, "faces": faces}) == str(
        caught.value
    )


def test_vertices_too_far_for_arithmetic_are_refused() -> None:
    with pytest.raises(
        MeshError, match="2e100 from the origin, and volumes can be computed within 1e60"
    ):
        struck.Mesh(points=np.eye(3) * 2e100, faces=np.array([[0, 1, 2]]))


# Metadata


def put(text: dict[str, Any], path: str, value: object) -> dict[str, Any]:
    *outer, last = path.split(".")
    part = text
    for key in outer:
        part = part[key]
    part[last] = value
    return text


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("provenance.details", 5, "its provenance.details is 5: give an object"),
        ("provenance.details.blow", "x", "its provenance.details.blow is 'x': give a list"),
        ("provenance.details.blow", [0.5], "blow.0 is 0.5: give a whole number"),
        ("provenance.details.vague", [-1], "vague.0 is -1: give a number of at least 0"),
        ("provenance.details.blow", [10**30], "give a number of at most 4.29497e9"),
        ("gains", "x", "its gains is 'x': give an object"),
        ("gains.kind", ["ShapeGains"], "gains.kind is .*: give one of ShapeGains, Radiating"),
        ("mass", 10**400, "its mass is 1000.*: give a number or null"),
        ("supported", 1, "its supported is 1: give true or false"),
        ("places", {"\x1b[31m": None}, r"its places.\\x1b\[31m is None: give a list"),
        ("units", "imperial", "its units is 'imperial': give \"SI\""),
    ],
)
def test_metadata_follow_the_schema_or_are_refused(
    content: tuple[str, Tensors], path: str, value: object, words: str
) -> None:
    message = refused(put(json.loads(content[0]), path, value), content[1])
    assert re.search(words, message), message


@pytest.mark.parametrize("text", [None, 5, "x", [], {}])
def test_metadata_that_are_no_object(content: tuple[str, Tensors], text: object) -> None:
    assert "docs/reference/model_file.md" in refused(text, content[1])


def test_every_keyword_of_the_schema_is_understood() -> None:
    known = {*_RULES, "required", "properties", "additionalProperties", "items", "anyOf", "oneOf"}
    known |= {"$ref", "$schema", "$id", "$defs", "title", "description"}

    def keywords(schema: dict[str, Any]) -> set[str]:
        found = set(schema)
        for key in ("properties", "$defs"):
            found |= {word for part in schema.get(key, {}).values() for word in keywords(part)}
        parts = [schema.get(key) for key in ("items", "additionalProperties")]
        parts += schema.get("anyOf", []) + schema.get("oneOf", [])
        return found | {word for part in parts if part for word in keywords(part)}

    assert keywords(SCHEMA) <= known


def nodes_of(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:  # noqa: ANN401 - JSON
    """Return the places of all parts of a JSON value but the whole."""
    pairs = value.items() if isinstance(value, dict) else enumerate(value)
    places = []
    for key, part in pairs:
        places.append((*path, key))
        if isinstance(part, dict | list):
            places += nodes_of(part, (*path, key))
    return places


@pytest.mark.parametrize("seed", sampled(range(10), 0))
def test_two_readings_of_the_schema_agree(content: tuple[str, Tensors], seed: int) -> None:
    chance = np.random.default_rng(seed)
    values = [None, "x", -1, 0.5, [], {}, [1.0, 2.0], [1.0, 2.0, "x"], {"kind": "x"}, 7]
    outcomes = set()
    for _ in range(100):
        text = json.loads(content[0])
        places = nodes_of(text)
        *outer, last = places[chance.integers(len(places))]
        part = text
        for key in outer:
            part = part[key]
        if chance.random() < 0.2 and isinstance(part, dict):
            del part[last]
        else:
            part[last] = values[chance.integers(len(values))]
        try:
            require_schema(text)
            is_sound = True
        except FileFormatError:
            is_sound = False
        assert is_sound == (not complaints(text, SCHEMA, SCHEMA)), (*outer, last)
        outcomes.add(is_sound)
    assert outcomes == {True, False}


def test_metadata_of_the_largest_size_are_judged_in_time(content: tuple[str, Tensors]) -> None:
    """What is listed a million times is refused, or looked at once; messages stay short."""
    places = put(json.loads(content[0]), "places", {f"{i}": [] for i in range(100_001)})
    assert "give at most 100000 keys" in refused(places, content[1])
    outline = {"pitch": [1.0], "around": True, "outline": [[float(i), 1.0] for i in range(10_001)]}
    message = refused(put(json.loads(content[0]), "chart", outline), content[1])
    assert "at most 10000 items" in message
    assert len(message) < 200


@pytest.mark.parametrize("details", [{"blow": "x"}, {"blow": [0.5]}, {"vague": 3}])
def test_a_model_names_modes_by_their_indices(details: dict[str, object]) -> None:
    with pytest.raises(StruckError, match="give a list of indices of modes"):
        replace(model(), provenance=Provenance(details=details))
    with pytest.raises(StruckError, match="details are 5: give a mapping"):
        Provenance(details=5)  # type: ignore[arg-type]


# Types of arrays


@pytest.mark.parametrize(
    "dtype", ["S1000000000", "O", "V8", "M8[s]", "float16", "<f8", "float64,float64", "int64", 5]
)
def test_a_file_chooses_no_type_of_an_array(dtype: object) -> None:
    tracemalloc.start()
    with pytest.raises(FileFormatError, match="its array 'a' is float64"):
        from_plain({"array": ["a", dtype]}, {}, {"a": np.zeros(1000)})
    assert tracemalloc.get_traced_memory()[1] < 1e6
    tracemalloc.stop()


@pytest.mark.parametrize("dtype", ["float64", "float32", "uint32", "bool", "int64", "complex128"])
def test_types_of_arrays_that_are_written_return(dtype: str) -> None:
    array, arrays = np.arange(6).reshape(2, 3).astype(dtype), {}
    loaded = from_plain(to_plain(array, (), arrays), {}, arrays)
    assert loaded.dtype == dtype
    np.testing.assert_array_equal(loaded, array)


def test_formulas_of_other_forms_are_refused(content: tuple[str, Tensors]) -> None:
    form = {"BendingForms": {"length": {"array": ["array0", "S1000000000"]}}}
    formula = {"TransverseShapes": {"forms": form}}
    text = put(json.loads(content[0]), "gains.formula", formula)
    tensors = {**content[1], "formula.array0": np.zeros(8)}
    assert "its array 'array0' is float64 (8,), to be read as 'S1000" in refused(text, tensors)


# Sound maps


@pytest.fixture(scope="module")
def sound_map() -> tuple[dict[str, Any], Tensors]:
    """Return the plain content and the arrays of a small map."""
    points = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]])
    made = SoundMap(
        frequencies=np.array([440.0, 700.0]),
        decays=np.array([3.0, 4.0]),
        contacts=points[:1],
        directions=np.array([[0.0, 0.0, -1.0]]),
        gains=np.ones((1, 2), complex),
        calibrated=True,
        listener=np.ones(3),
        level=85.0,
        threshold=3.0,
        bound=2.5,
        surface=struck.Mesh(points=points, faces=np.array([[0, 1, 2]])),
        owners=np.zeros(1, np.int64),
        factors=np.ones((1, 3)),
        brightness=np.full((1, 3), np.nan),
    )
    arrays: Tensors = {}
    return to_plain(made, (SoundMap, struck.Mesh), arrays), arrays


def map_file(path: Path, plain: object, arrays: Tensors) -> Path:
    text = json.dumps(plain)
    path.write_bytes(pack(arrays, {"format": "struck-packing", "version": "1", "json": text}))
    return path


@pytest.mark.parametrize(
    "plain",
    [
        {"SoundMap": "x"},
        {"SoundMap": {"surface": "x"}},
        {"int": 5},
        {"array": "x"},
        {"array": ["array0"]},
        {"array": [["array0"], "float64"]},
        {"mapping": [5]},
        {"tuple": {"a": 1}},
        {"list": "x"},
        {"SoundMap": {}, "Mesh": {}},
        [],
        "x",
        None,
    ],
)
def test_maps_of_other_content_are_refused(
    tmp_path: Path, sound_map: tuple[dict[str, Any], Tensors], plain: object
) -> None:
    with pytest.raises(FileFormatError, match=r"a\.map"):
        SoundMap.load(map_file(tmp_path / "a.map", plain, sound_map[1]))


@pytest.mark.parametrize("name", [field.name for field in fields(SoundMap)])
def test_maps_with_a_part_of_another_type_are_refused_or_work(
    tmp_path: Path, sound_map: tuple[dict[str, Any], Tensors], name: str
) -> None:
    plain, arrays = sound_map
    values = ["x", None, -1, {"list": []}, {"tuple": ["x"]}, {"mapping": [["a", 1]]}]
    values += [{"array": [array, tensor.dtype.name]} for array, tensor in arrays.items()]
    values += [{"array": ["array4", "complex128"]}, {"array": ["array0", "bool"]}]
    refusals = 0
    for value in values:
        changed = {"SoundMap": {**plain["SoundMap"], name: value}}
        path = map_file(tmp_path / "a.map", changed, arrays)
        try:
            loaded = SoundMap.load(path)
        except FileFormatError:
            refusals += 1
        else:
            loaded.at([0.02, 0.02, 0.0])
            assert np.isfinite(loaded.stored_brightness).all()
    assert refusals


def test_a_map_of_faces_without_area_is_refused(
    tmp_path: Path, sound_map: tuple[dict[str, Any], Tensors]
) -> None:
    plain, arrays = sound_map
    faces = plain["SoundMap"]["surface"]["Mesh"]["faces"]["array"][0]
    path = map_file(tmp_path / "a.map", plain, {**arrays, faces: np.zeros((1, 3), np.uint32)})
    with pytest.raises(FileFormatError, match="all of its 1 faces are lines or points"):
        SoundMap.load(path)
