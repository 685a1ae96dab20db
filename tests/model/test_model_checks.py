"""What is no model is refused alike, whether a person, a program or a sealed file gives it."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import safetensors.numpy

import struck
from struck import ModalModel, Rayleigh, Strike
from struck.errors import FileFormatError, MaterialError, OptionError
from struck.files import model_file
from struck.files.container import pack
from struck.model.provenance import Provenance
from struck.model.timbre_table import SinglePoint
from struck.shapes import (
    Bar,
    CircularMembrane,
    PolygonMembrane,
    RectangularMembrane,
    RectangularPlate,
    String,
)

BAR = struck.analyze(Bar(length=0.3, width=0.03, thickness=0.005), "steel", recoil=False)
COUNT = len(BAR.frequencies)
ALL = f"{COUNT} of {COUNT} numbers are"
# Each by the beginning of its message; values of a model that are no model's.
WRONG: dict[str, dict[str, object]] = {
    "decays: some go down to -1": {"decays": np.full(COUNT, -1.0)},
    "decays: some go down to -1e308": {"decays": np.full(COUNT, -1e308)},
    "decays: the shape is": {"decays": np.ones(COUNT - 1)},
    f"decays: {ALL} not finite or beyond 1e100, as nan": {"decays": np.full(COUNT, np.nan)},
    "frequencies: some go down to": {"frequencies": -BAR.frequencies},
    f"frequencies: {ALL} not finite or beyond 1e100, as inf": {
        "frequencies": np.full(COUNT, np.inf)
    },
    "its natural_frequencies must ascend": {"natural_frequencies": BAR.natural_frequencies[::-1]},
    "its natural_frequencies must ascend from above 0": {"natural_frequencies": np.zeros(COUNT)},
    "errors: some go down to": {"errors": np.full(COUNT, -0.1)},
    "poisson_slopes: the shape is": {"poisson_slopes": np.ones((COUNT, 2))},
    "its mass is 0": {"mass": 0.0},
    "mass: 1 of 1 numbers are not finite or beyond 1e100, as nan": {"mass": np.nan},
    "mass: 1 of 1 numbers are not finite or beyond 1e100, as 1e+101": {"mass": 1e101},
    "centre: 1 of 3 numbers are not finite": {"centre": np.array([-np.inf, 0, 0])},
    "inertia: the shape is (3,)": {"inertia": np.ones(3)},
    "complete_to: some go down to": {"complete_to": -5.0},
    "place 'rim': the shape is (2,)": {"places": {"rim": np.zeros(2)}},
    "its gains are those of 3 modes": {"gains": SinglePoint(outputs=np.ones(3, complex))},
}


@pytest.mark.parametrize("message", WRONG)
def test_a_person_is_told_what_is_no_model(message: str) -> None:
    with pytest.raises(OptionError) as caught:
        replace(BAR, **WRONG[message])
    assert str(caught.value).startswith(message.partition("-1")[0])


@pytest.mark.parametrize(
    "wrong",
    [{"decays": "loud"}, {"decays": [1, 2]}, {"gains": None}, {"material": "steel"}, {"mass": "1"},
     {"mass": True}, {"coordinates": (1, 2)}, {"provenance": {}}, {"geometry": 3}],
    ids=repr,
)  # fmt: skip
def test_wrong_types_are_told(wrong: dict[str, object]) -> None:
    with pytest.raises(TypeError, match=next(iter(wrong))):
        replace(BAR, **wrong)


@pytest.mark.parametrize(
    "wrong",
    [{"outputs": np.full(COUNT, np.nan + 0j)}, {"centre": np.zeros(2)}, {"shapes": np.ones(3)}],
    ids=lambda wrong: next(iter(wrong)),
)
def test_gains_on_a_surface_are_checked(wrong: dict[str, object]) -> None:
    with pytest.raises(OptionError, match=next(iter(wrong))):
        replace(BAR.gains, **wrong)


# Sealed files


def parts(model: ModalModel) -> tuple[dict[str, Any], dict[str, Any]]:
    data = model_file.to_bytes(model)
    header = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])
    return safetensors.numpy.load(data), json.loads(header["__metadata__"]["json"])


def loaded(tensors: dict[str, Any], text: dict[str, Any]) -> ModalModel:
    sealed = {"format": "struck", "version": "1", "json": json.dumps(text)}
    return model_file.from_bytes(pack(tensors, sealed))


Change = Callable[[dict[str, Any], dict[str, Any]], object]
SEALED: dict[str, Change] = {
    "decays: some go down to -1": lambda t, _: t["decays"].fill(-1.0),
    "frequencies: some go down to -2": lambda t, _: t["frequencies"].fill(-2.0),
    "natural_frequencies: some go down": lambda t, _: np.negative(
        t["natural_frequencies"], out=t["natural_frequencies"]
    ),
    "errors: some go down to -1": lambda t, _: t["errors"].fill(-1.0),
    "its mass is 0": lambda _, m: m.update(mass=0),
    "its mass is False: give a number or null": lambda _, m: m.update(mass=False),
    "its centre is [0, 0]: give null or at least 3 items": lambda _, m: m.update(centre=[0, 0]),
    "complete_to: some go down to": lambda _, m: m.update(complete_to=-1e308),
    "its provenance.references.0 is 3: give a text": lambda _, m: m["provenance"].update(
        references=[3]
    ),
    "its provenance.method is None: give a text": lambda _, m: m["provenance"].update(method=None),
}


@pytest.mark.parametrize("message", SEALED)
def test_a_sealed_file_of_no_model_is_refused(message: str) -> None:
    tensors, text = parts(BAR)
    SEALED[message](tensors, text)
    with pytest.raises(FileFormatError) as caught:
        loaded(tensors, text)
    assert message in str(caught.value)


def test_references_of_a_newer_version_are_left_out_with_a_note() -> None:
    tensors, text = parts(BAR)
    text["provenance"]["references"] += ["nobody2099", "later2031"]
    newer = loaded(tensors, text)
    assert newer.cite() == BAR.cite()
    assert newer.provenance.dropped == (
        *BAR.provenance.dropped,
        "2 references, unknown to this version: nobody2099, later2031",
    )
    assert loaded(*parts(newer)).provenance == newer.provenance
    mine = Provenance(references=("doel1998", "mine2027"))
    assert mine.references == ("doel1998",)
    assert "mine2027" in mine.dropped[0]


SKIN = {"thickness": 1e-4, "tension": 2000.0}
FORMULAS = {
    "bending": (Bar(length=0.3, width=0.03, thickness=0.005), "steel", 8_000.0),
    "string": (String(length=0.6, radius=5e-4, tension=100.0), "steel", 2_000.0),
    "sines": (RectangularMembrane(length=0.3, width=0.2, **SKIN), "polyethylene", 700.0),
    "round": (CircularMembrane(radius=0.15, **SKIN), "polyethylene", 700.0),
    "plate": (RectangularPlate(length=0.2, width=0.1, thickness=0.002), "steel", 5000.0),
    "polygon": (
        PolygonMembrane(corners=((0, 0), (0.2, 0), (0.05, 0.2)), **SKIN),
        "polyethylene",
        900.0,
    ),
}


DAMAGED: list[Any] = [None, "x", -1e308, 0, [], True]  # in the place of a number or an array


@pytest.mark.parametrize("name", FORMULAS)
def test_damaged_parts_of_a_formula_never_come_through(name: str) -> None:
    """Refused, or the very shapes that the vertices have: then the part did no harm."""
    shape, material, highest = FORMULAS[name]
    model = struck.analyze(shape, material, band=(20.0, highest))
    whole, text = parts(model)
    assert loaded(whole, text).gains.formula is not None
    (kind,) = text["gains"]["formula"]["TransverseShapes"]["forms"]
    refused = 0
    for place in (
        "size",
        "weights",
        "forms",
        *text["gains"]["formula"]["TransverseShapes"]["forms"][kind],
    ):
        for wrong in DAMAGED:
            tensors, text = parts(model)
            owner = text["gains"]["formula"]["TransverseShapes"]
            owner = owner if place in owner else owner["forms"][kind]
            owner[place] = wrong
            refused += comes_through(model, tensors, text)
    for array in (each for each in whole if each.startswith("formula.")):
        for change in (0, 5, 10**9):
            tensors, text = parts(model)
            tensors[array] = (tensors[array] * 0 + change).astype(tensors[array].dtype)
            refused += comes_through(model, tensors, text)
        tensors, text = parts(model)
        tensors[array] = tensors[array][:-1]
        refused += comes_through(model, tensors, text)
    assert refused > 25


def comes_through(model: ModalModel, tensors: dict[str, Any], text: dict[str, Any]) -> bool:
    """Return whether a file is refused; fail when it is another body."""
    try:
        other = loaded(tensors, text)
    except FileFormatError:
        return True
    points = model.geometry.points[::7]
    assert other.gains.shapes_at(points) == pytest.approx(
        model.gains.shapes_at(points), abs=2e-3 * float(np.abs(model.gains.shapes).max())
    )
    return False


# Bodies without modes


def test_a_body_without_modes_is_silent_and_says_so() -> None:
    with pytest.warns(struck.errors.ScaleWarning, match="no mode that rings"):
        silent = BAR.damped(Rayleigh(mass=1e6, stiffness=0))
    assert not len(silent.frequencies)
    assert not len(loaded(*parts(silent)).frequencies)
    ways: list[tuple[object, object]] = [
        (Strike(), None),
        (Strike(at="end", shape="hertz"), (0, 0, 1.0)),
        ([Strike(), Strike(at="end", time=0.2)], struck.Binaural(position=(0, 0, 1.0))),
    ]
    for what, listener in ways:
        sound = struck.render(silent, what, seconds=0.3, listener=listener)
        assert not sound.samples.any()
        assert sum("no modes" in note for note in sound.notes) == 1
    assert struck.render(silent, Strike()).duration > 0
    with pytest.raises(MaterialError, match="no modes to tune"):
        silent.tuned(lowest=100)
