"""Model files of recorded bodies: the same gains back, and damage told, for every kind."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass, replace
from functools import cache
from importlib import resources
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import safetensors.numpy
from numpy.typing import NDArray
from scipy.special import sph_harm_y

from struck.cli import main
from struck.errors import ContactError, FileFormatError, OptionError
from struck.files import model_file
from struck.files.container import pack, unpack
from struck.model.gains import Gains, ShapeGains
from struck.model.mesh import Mesh
from struck.model.model import ModalModel
from struck.model.provenance import Provenance
from struck.model.survey import Survey, from_spherical
from struck.model.timbre_field import TimbreField
from struck.model.timbre_table import SinglePoint, TimbreTable
from struck.radiation import by_name
from tests.files.test_model_file import SCHEMA, complaints
from tests.model.vases import HEIGHTS, RADIUS, Vase, listeners, noisy

Array = NDArray[np.float64]

STORED = Path(__file__).parent / "version1.safetensors"
CORNERS = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
TETRAHEDRON = Mesh(points=CORNERS, faces=np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]))
NOWHERE = np.zeros((1, 3))


def vase() -> tuple[Survey, Vase]:
    chance = np.random.default_rng(2007)
    drawn = Vase.drawn(chance)
    gains = noisy(drawn.gains(HEIGHTS[:, 0], listeners()), 20.0, chance)
    return drawn.survey(HEIGHTS, gains), drawn


def turned() -> TimbreField:
    """A field of contacts at three heights and four azimuths."""
    survey, drawn = vase()
    contacts = np.array([(h, a) for h in HEIGHTS[:, 0] for a in (0.0, 1.0, 2.0, 4.0)])
    gains = np.repeat(drawn.gains(HEIGHTS[:, 0], listeners()), 4, axis=0)
    around = Survey.full(contacts, listeners(), gains, survey.frequencies, symmetry="axial")
    return TimbreField.of(around, radius=RADIUS)


def flat() -> TimbreField:
    """A field over u and v, of listeners on one side, with a mode that nobody heard."""
    chance = np.random.default_rng(3)
    contacts = np.array([(u, v) for u in (0.0, 0.1) for v in (-1.0, 0.0, 3.0)])
    places = chance.normal((0, 0, 4), size=(7, 3))
    gains = chance.normal(size=(6, 7, 5)) + 1j * chance.normal(size=(6, 7, 5))
    gains[:, :, 2] = 0
    frequencies = np.linspace(200, 900, 5)
    return TimbreField.of(Survey.full(contacts, places, gains, frequencies, centre=places[0] / 9))


def cartesian() -> TimbreTable:
    chance = np.random.default_rng(4)
    contacts = np.array([(u, v) for u in (0.0, 0.1) for v in (-1.0, 0.0, 3.0)])
    places = np.array([(x, y, z) for x in (1.0, 2.0) for y in (-1.0, 1.0) for z in (0.5, 0.7, 1.0)])
    gains = chance.normal(size=(6, 12, 4)) + 1j * chance.normal(size=(6, 12, 4))
    survey = Survey.full(contacts, places, gains, np.linspace(200, 900, 4), calibrated=True)
    return TimbreTable.of(survey, system="cartesian")


def unturned_table() -> TimbreTable:
    """A table whose azimuths go all around."""
    chance = np.random.default_rng(5)
    azimuths = np.array([0.1, 1.5, 3.0, 5.0])
    places = from_spherical(1.0, azimuths, np.pi / 3)
    gains = chance.normal(size=(3, 4, 2)) + 1j * chance.normal(size=(3, 4, 2))
    return TimbreTable.of(Survey.full(HEIGHTS, places, gains, np.array([100.0, 200.0])))


def point() -> SinglePoint:
    return SinglePoint(outputs=np.array([1.0, 0.3j, 0.1 / 3 - 0.1j]), centre=np.array([0, 0.1, 0]))


def shapes() -> ShapeGains:
    return ShapeGains(
        surface=TETRAHEDRON,
        shapes=np.arange(24, dtype=np.float32).reshape(4, 3, 2),
        outputs=np.array([0.2, 0.1j]),
        centre=CORNERS.mean(axis=0),
        radiation=by_name("power"),
    )


GAINS: dict[str, Callable[[], Gains]] = {
    "field": lambda: TimbreField.of(vase()[0], radius=RADIUS),
    "field all around": turned,
    "field over u and v": flat,
    "table": lambda: TimbreTable.of(vase()[0]),
    "cartesian table": cartesian,
    "table of azimuths": unturned_table,
    "single point": point,
}
AXES = {"field all around": 2, "field over u and v": 2, "cartesian table": 2, "single point": 0}


@cache
def model(name: str) -> ModalModel:
    gains = GAINS[name]()
    modes = gains.toward(np.array([[3.0, 1.0, 2.0]])).shape[2]
    chance = np.random.default_rng(modes)
    natural, axes = np.sort(chance.random(modes)) * 1e4, AXES.get(name, 1)
    return ModalModel(
        frequencies=natural * (1 - 1e-9),
        natural_frequencies=natural,
        decays=chance.random(modes),
        gains=gains,
        centre=np.zeros(3),
        complete_to=0.0,
        places={"recorded": np.linspace(0.1, 0.02, axes)},
        coordinates=("height", "azimuth (rad)")[:axes],
        provenance=Provenance(method="recordings"),
    )


def shaped() -> ModalModel:
    two = np.array([1000.0, 2500.0])
    return replace(
        model("single point"),
        frequencies=two,
        natural_frequencies=two,
        decays=two / 100,
        gains=shapes(),
        geometry=TETRAHEDRON,
        errors=np.array([0.1, np.nan]),
        places={"tip": CORNERS[3]},
        coordinates=("x (m)", "y (m)", "z (m)"),
    )


def again(made: ModalModel) -> ModalModel:
    return model_file.from_bytes(model_file.to_bytes(made))


def points(gains: Gains, count: int = 6) -> tuple[Array, Array]:
    """Return contacts (K, D) that lie where any of the fields knows, and listeners (L, 3)."""
    chance = np.random.default_rng(1)
    axes = 2 if isinstance(gains, TimbreField) and gains.listener_part.turned else None
    if isinstance(gains, TimbreField):
        axes = axes or len(gains.contact_part.spans)
    elif isinstance(gains, TimbreTable):
        axes = len(gains.contacts.axes)
    return 0.1 * chance.random((count, axes or 0)), chance.normal((0, 0, 3), size=(count, 3))


def bits(array: np.ndarray) -> tuple[object, ...]:
    return array.dtype, array.shape, array.tobytes()


def assert_same_content(first: object, second: object) -> None:
    """Compare dataclasses of arrays to the last bit."""
    if isinstance(first, np.ndarray):
        assert bits(first) == bits(np.asarray(second))
    elif isinstance(first, tuple):
        for one, other in zip(first, second, strict=True):  # type: ignore[call-overload]
            assert_same_content(one, other)
    elif is_dataclass(first):
        assert type(first) is type(second)
        for each in fields(first):
            assert_same_content(getattr(first, each.name), getattr(second, each.name))
    else:
        assert (first == second) is True


# The same back


@pytest.mark.parametrize("name", GAINS)
def test_gains_return_to_the_last_bit(name: str) -> None:
    made = model(name)
    loaded = again(made)
    assert_same_content(made.gains, loaded.gains)
    contacts, places = points(made.gains)
    assert bits(loaded.gains.at(contacts, NOWHERE)) == bits(made.gains.at(contacts, NOWHERE))
    assert bits(loaded.gains.toward(places)) == bits(made.gains.toward(places))
    assert loaded.gains.toward(places).any()
    assert bits(loaded.frequencies) == bits(made.frequencies)
    assert bits(loaded.contact().point) == bits(made.contact().point)
    assert (loaded.coordinates, loaded.geometry) == (made.coordinates, None)


@pytest.mark.parametrize("name", GAINS)
def test_changed_gains_return(name: str) -> None:
    """Of another size, with some modes, as model.scaled and model.damped make them."""
    made = model(name)
    modes = np.array([1, 0])
    gains = made.gains.changed(made.frequencies[modes], modes, 1.7, 0.9)
    few = {each: getattr(made, each)[modes] for each in ("frequencies", "decays")}
    changed = replace(
        made, **few, natural_frequencies=few["frequencies"].max() * np.ones(2), gains=gains
    )
    loaded = again(changed)
    assert_same_content(gains, loaded.gains)
    places = 3 * points(gains)[1]
    np.testing.assert_allclose(loaded.gains.toward(places), gains.toward(places), rtol=1e-13)


def test_rank_errors_that_were_not_measured_stay_unknown() -> None:
    made = model("field")
    assert isinstance(made.gains, TimbreField)
    unknown = replace(made.gains, rank_errors=np.full(len(made.frequencies), np.nan))
    loaded = again(replace(made, gains=unknown)).gains
    assert isinstance(loaded, TimbreField)
    assert np.isnan(loaded.rank_errors).all()


def test_recorded_bodies_may_have_a_surface() -> None:
    made = replace(model("single point"), geometry=TETRAHEDRON)
    loaded = again(made)
    assert loaded.geometry is not None
    assert bits(loaded.geometry.points) == bits(TETRAHEDRON.points)
    assert bits(loaded.geometry.faces) == bits(TETRAHEDRON.faces)


def test_a_stored_file_of_the_first_writer_reads_as_ever() -> None:
    """Written before files kept anything but mode shapes."""
    loaded = model_file.load(STORED)
    gains = loaded.gains
    assert isinstance(gains, ShapeGains)
    assert loaded.frequencies.tolist() == [999.9, 2499.8]
    assert loaded.natural_frequencies.tolist() == [1000.0, 2500.0]
    assert loaded.decays.tolist() == [5.0, 12.0]
    assert gains.shapes.tolist() == np.arange(24.0).reshape(4, 3, 2).tolist()
    assert gains.outputs.tolist() == [0.2, 0.1j]
    assert gains.surface.points.tolist() == CORNERS.tolist()
    assert gains.surface.faces.tolist() == [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]
    assert (gains.surface.up, gains.radiation.name) == ("y", "power")
    assert loaded.geometry is gains.surface
    assert loaded.material is not None
    assert loaded.material.name == "clay"
    assert loaded.places["tip"].tolist() == [0, 0, 0.1]
    assert loaded.errors is not None
    assert loaded.errors[0] == 1e-3
    assert np.isnan(loaded.errors[1])
    assert loaded.provenance.method == "by hand"


# What is in them


def parts(made: ModalModel) -> tuple[dict[str, Any], dict[str, Any]]:
    metadata, tensors = unpack(model_file.to_bytes(made), kind="struck", newest=1)
    return dict(tensors), json.loads(metadata["json"])


@pytest.mark.parametrize("name", GAINS)
def test_files_hold_no_surface_and_follow_the_schema(name: str) -> None:
    tensors, text = parts(model(name))
    own = {"frequencies", "natural_frequencies", "decays"}
    assert all(each.startswith("field_") for each in tensors.keys() - own)
    assert complaints(text, SCHEMA, SCHEMA) == []
    assert set(text) == set(SCHEMA["properties"]) - {"recoil", "chart", "playing_place", "air"}
    kinds = {each["properties"]["kind"]["const"]: each for each in GAINS_SCHEMAS}
    assert set(text["gains"]) == set(kinds[text["gains"]["kind"]]["properties"])
    text["gains"]["kind"] = "ShapeGains"
    assert complaints(text, SCHEMA, SCHEMA)


GAINS_SCHEMAS = [
    SCHEMA["$defs"][each["$ref"].removeprefix("#/$defs/")]
    for each in SCHEMA["properties"]["gains"]["oneOf"]
]


def test_the_schema_knows_every_kind() -> None:
    assert {each["properties"]["kind"]["const"] for each in GAINS_SCHEMAS} == set(model_file.GAINS)
    assert resources.files("struck.files").joinpath("model.schema.json").is_file()


def test_complex_gains_are_pairs_for_other_programs(tmp_path: Path) -> None:
    made = model("cartesian table")
    model_file.save(made, tmp_path / "a.struck")
    tensors = safetensors.numpy.load_file(tmp_path / "a.struck")
    assert isinstance(made.gains, TimbreTable)
    assert tensors["field_gains"].shape == (6, 12, 4, 2)
    assert bits(tensors["field_gains"][..., 1]) == bits(made.gains.gains.imag)


def harmonics(azimuth: float, polar: float, degrees: int) -> Array:
    """Return the real spherical harmonics of the page (degrees^2,)."""
    values = []
    for degree in range(degrees):
        for order in range(-degree, degree + 1):
            legendre = sph_harm_y(degree, abs(order), polar, 0.0).real
            turn = np.sin(-order * azimuth) if order < 0 else np.cos(order * azimuth)
            values.append(np.sqrt((8 if order else 4) * np.pi) * legendre * turn)
    return np.array(values)


@pytest.mark.parametrize("name", ["field", "field all around", "field over u and v"])
def test_fields_are_read_by_what_the_page_says(name: str) -> None:
    """Contact by contact and listener by listener, by the formulas of docs/reference."""
    made = model(name)
    tensors, text = parts(made)
    gains = text["gains"]
    parts_, corrections = (
        tensors[each][..., 0] + 1j * tensors[each][..., 1]
        for each in ("field_parts", "field_corrections")
    )
    count = len(parts_)
    contacts, places = points(made.gains)
    places[:2] *= 0.05  # within the limit, and close to the listener inside
    found = np.einsum("prm,lrm->plm", made.gains.at(contacts, NOWHERE), made.gains.toward(places))
    for (contact, place), gain in zip(
        product(contacts, places), found.reshape(36, -1), strict=True
    ):
        u = contact[:1] if gains["turned"] else contact
        scaled = (u - gains["lowest"]) / np.array(gains["spans"])
        squares = np.square(scaled - tensors["field_contacts"]).sum(axis=1)
        likeness = np.exp(-squares / (2 * np.square(gains["lengths"])[:, None]))
        drive = np.einsum("kp,kpn->n", likeness, tensors["field_factors"])
        x, y, z = place - gains["centre"]
        azimuth = np.arctan2(y, x) - (contact[1] if gains["turned"] else 0.0)
        waves = harmonics(azimuth, np.arctan2(np.hypot(x, y), z), count)
        if gains["turned"]:
            waves *= np.array([m >= 0 for top in range(count) for m in range(-top, top + 1)])
        r = np.linalg.norm([x, y, z])
        outside = max(r, gains["limit"])
        waves *= (r / outside) ** np.repeat(np.arange(count), 2 * np.arange(count) + 1)
        output = np.einsum("k,b,kbn->n", outside ** -np.arange(1.0, count + 1), waves, parts_)
        y = abs(y) if gains["mirrored"] else y
        here = [np.hypot(x, y), 0, z] if gains["turned"] else [x, y, z]
        d = np.linalg.norm(tensors["field_inside"] - here, axis=1) / gains["reach"]
        output += (np.maximum(1 - d, 0) ** 4 * (4 * d + 1)) @ corrections
        np.testing.assert_allclose(gain, drive * output, rtol=1e-9, atol=1e-12)


# Damage


def sealed(tensors: dict[str, Any], text: object) -> bytes:
    return pack(tensors, {"format": "struck", "version": "1", "json": json.dumps(text)})


def refused(tensors: dict[str, Any], text: object) -> str:
    with pytest.raises(FileFormatError) as caught:
        model_file.from_bytes(sealed(tensors, text))
    assert "\n" not in str(caught.value)
    return str(caught.value)


FAULTS: dict[str, tuple[str, Callable[[dict[str, Any], dict[str, Any]], object]]] = {
    "'field_parts' is missing": ("field", lambda t, _: t.pop("field_parts")),
    "'field_factors' is float64 (9, 3, 24)": (
        "field",
        lambda t, _: t.update(field_factors=t["field_factors"][:, :, 1:]),
    ),
    "'field_corrections' holds numbers that are not finite": (
        "field",
        lambda t, _: t.update(field_corrections=t["field_corrections"] * np.inf),
    ),
    "'field_unmeasured' goes up to 25: of 25 modes": (
        "field",
        lambda t, _: t.update(field_unmeasured=np.array([25], np.uint32)),
    ),
    "'field_levelled' goes up to 2": (
        "field",
        lambda t, _: t["field_levelled"].__setitem__(0, 2),
    ),
    "its drives are likenesses over": ("field", lambda _, g: g["lengths"].reverse()),
    "its gains.limit is 0: give a number of at least 1e-9": (
        "field",
        lambda _, g: g.update(limit=0),
    ),
    "its gains.radius is -1: give a number of at least 0": (
        "field",
        lambda _, g: g.update(radius=-1),
    ),
    "its gains.spans.0 is -1.0": ("field", lambda _, g: g.update(spans=[-1.0])),
    "its contacts have 1 coordinates": ("field", lambda _, g: g.update(turned=True)),
    "give contacts with 1 coordinates": (
        "field over u and v",
        lambda _, g: g.update(turned=True),
    ),
    "its gains.notes is 'x': give a list": ("field", lambda _, g: g.update(notes="x")),
    "its gains.calibrated is 1: give true or false": ("field", lambda _, g: g.update(calibrated=1)),
    "'field_gains' is float64 (3, 15, 25)": (
        "table",
        lambda t, _: t.update(field_gains=t["field_gains"][..., 0]),
    ),
    "'field_contact_sources' goes up to 3: of 3 contacts": (
        "table",
        lambda t, _: t["field_contact_sources"].__setitem__(0, 3),
    ),
    "do not ascend": ("table", lambda _, g: g["contacts"][0]["nodes"].reverse()),
    "within its period of 1": (
        "table of azimuths",
        lambda _, g: g["listeners"][1].update(period=1.0),
    ),
    "{'nodes': [0.0,: give at least 3 items": ("table", lambda _, g: g["listeners"].pop()),
    "its gains.size is 0": ("table", lambda _, g: g.update(size=0)),
    'its gains.system is \'polar\': give "spherical" or "cartesian"': (
        "table",
        lambda _, g: g.update(system="polar"),
    ),
    "its gains.centre.0 is None: give a number": (
        "single point",
        lambda _, g: g.update(centre=[None, 0, 0]),
    ),
    "its gains.centre is [0, 0]: give at least 3 items": (
        "single point",
        lambda _, g: g.update(centre=[0, 0]),
    ),
    "its gains.kind is 'Magic': give one of ShapeGains, RadiatingGains": (
        "single point",
        lambda _, g: g.update(kind="Magic"),
    ),
    "its gains.radiation is missing": ("single point", lambda _, g: g.update(kind="ShapeGains")),
    "'shapes' is missing": (
        "single point",
        lambda _, g: g.update(kind="ShapeGains", radiation="power"),
    ),
}


@pytest.mark.parametrize("message", FAULTS)
def test_files_with_wrong_gains(message: str) -> None:
    name, change = FAULTS[message]
    tensors, text = parts(model(name))
    change(tensors, text["gains"])
    if message == "'shapes' is missing":
        tensors |= {"vertices": CORNERS, "faces": TETRAHEDRON.faces.astype(np.uint32)}
    assert message in refused(tensors, text)


def test_half_a_surface_is_refused() -> None:
    tensors, text = parts(model("single point"))
    assert "it has vertices, and" in refused({**tensors, "vertices": CORNERS}, text)
    assert "it has none, and" in refused(tensors, {**text, "geometry": "surface"})


def test_places_have_as_many_numbers_as_there_are_coordinates() -> None:
    for name, wanted in (("field", 1), ("field all around", 2), ("single point", 0)):
        tensors, text = parts(model(name))
        text["places"]["recorded"] = [0.5, 0.5, 0.5]
        assert f"the shape is (3,) and must be ({wanted}" in refused(tensors, text)
    with pytest.raises(OptionError, match=r"'rim': the shape is .3,. and must be .1,"):
        replace(model("field"), places={"rim": np.zeros(3)})


@pytest.mark.parametrize("name", ["field", "field all around", "table", "cartesian table"])
def test_coordinates_that_the_gains_do_not_know_are_refused(name: str) -> None:
    with pytest.raises(OptionError, match="its contacts have 3 coordinates"):
        replace(model(name), coordinates=("x", "y", "z"), places={})


def test_gains_of_expanded_models_are_refused() -> None:
    expanded = model("table").expanded()
    with pytest.raises(FileFormatError, match="save the model that it was made from"):
        model_file.to_bytes(expanded)


LEAVES: list[Any] = [
    *(None, True, False, -1, 0, 1, 3, 2**40, 10**400, 1e308, -1e308, 1e-320, float("nan")),
    *(float("inf"), "x", "", [], {}, [[]], [0], [0.5, 0.5], [1, 2, 3], [1e308] * 3, ["x"]),
    *({"nodes": [0, 1], "period": 0}, [{"nodes": [0.0], "period": 0.0}]),
]
WORDS = {
    "float64": (np.nan, np.inf, -np.inf, 1e300, -1e300, 1e-310, 0.0, -1.0),
    "float32": (np.nan, np.inf, -np.inf, 3e38, 0.0),
    "uint32": (0, 1, 2, 1000, 2**32 - 1),
}


def paths(value: object, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    yield at
    inner = value.items() if isinstance(value, dict) else ()
    inner = enumerate(value) if isinstance(value, list) else inner
    for key, each in inner:
        yield from paths(each, (*at, key))


def with_other_text(text: dict[str, Any], chance: np.random.Generator) -> object:
    """Return metadata with one value replaced, left out or doubled."""
    changed: Any = copy.deepcopy(text)
    every = list(paths(text))
    gains = [path for path in every if path[:1] == ("gains",)]
    among = gains if chance.random() < 0.7 else every
    path = among[chance.integers(len(among))]
    leaf = LEAVES[chance.integers(len(LEAVES))]
    if not path:
        return leaf
    owner = changed
    for key in path[:-1]:
        owner = owner[key]
    if chance.random() < 0.15:
        del owner[path[-1]]
    else:
        owner[path[-1]] = leaf
    return changed


def with_other_tensor(tensors: dict[str, Any], chance: np.random.Generator) -> dict[str, Any]:
    """Return tensors of which one has another type, shape or number, or is gone."""
    name = sorted(tensors)[chance.integers(len(tensors))]
    array = tensors[name].copy()
    kind = chance.integers(6)
    if kind == 0:
        return {each: tensors[each] for each in tensors if each != name}
    if kind == 1:
        with np.errstate(invalid="ignore"):
            array = array.astype(chance.choice(["float64", "float32", "uint32"]))
    elif kind == 2:
        array = np.moveaxis(array, 0, -1).copy()
    elif kind == 3:
        array = np.delete(array, 0, chance.integers(array.ndim)) if array.size else array
    elif kind == 4:
        array = array[:0]
    elif array.size:
        words = WORDS[array.dtype.name]
        array.flat[chance.integers(array.size)] = words[chance.integers(len(words))]
    return {**tensors, name: array}


def survives(data: bytes) -> bool:
    """Tell whether a file is read; then its gains must be numbers."""
    try:
        loaded = model_file.from_bytes(data)
    except FileFormatError:
        return False
    try:
        if isinstance(loaded.gains, ShapeGains):
            contacts, places = CORNERS[:2], points(loaded.gains)[1]
        else:
            contacts, places = points(loaded.gains)
        with np.errstate(over="ignore"):
            drives = loaded.gains.at(contacts, np.zeros((len(contacts), 3)))
            outputs = loaded.gains.toward(places)
    except ContactError:
        return True
    assert not np.isnan(drives).any()
    assert not np.isnan(outputs).any()
    assert drives.shape[1:] == outputs.shape[1:]
    assert drives.shape[2] == len(loaded.frequencies)
    return True


def damage(name: str, count: int, seed: int) -> tuple[int, int]:
    tensors, text = parts(shaped() if name == "shapes" else model(name))
    chance = np.random.default_rng(seed)
    read = 0
    for turn in range(count):
        if turn % 2:
            data = sealed(with_other_tensor(tensors, chance), text)
        else:
            data = sealed(tensors, with_other_text(text, chance))
        read += survives(data)
    return read, count


@pytest.mark.parametrize("name", ["shapes", *GAINS])
def test_crafted_files_are_refused_or_give_numbers(name: str) -> None:
    read, count = damage(name, 100, seed=7)
    assert 0 < read < count / 2


@pytest.mark.prove
@pytest.mark.parametrize("name", ["shapes", *GAINS])
def test_crafted_files_by_the_thousand(name: str) -> None:
    read, count = damage(name, 4000, seed=8)
    assert 0 < read < count / 2


@pytest.mark.parametrize("name", ["field", "table", "single point"])
def test_any_flipped_byte_is_found(name: str) -> None:
    content = model_file.to_bytes(model(name))
    chance = np.random.default_rng(2002)
    for place in chance.integers(len(content), size=60):
        damaged = bytearray(content)
        damaged[place] ^= chance.integers(1, 256)
        with pytest.raises(FileFormatError):
            model_file.from_bytes(bytes(damaged))


# The command


@pytest.mark.parametrize(
    "name",
    [
        "single point",
        *(pytest.param(name, marks=pytest.mark.prove) for name in ("field all around", "table")),
    ],
)
def test_info_and_show_of_recorded_bodies(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    made = model(name)
    model_file.save(replace(made, decays=made.decays + 20), "a.struck")
    assert main(["info", "a.struck"]) == 0
    assert "recorded" in capsys.readouterr().out
    assert main(["info", "a.struck", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["places"] == ["recorded"]
    assert main(["show", "a.struck", "-o", "a.png"]) == 0
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
