"""Facts of a model for the page: figures, numbered places, and changes of material or size."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np

from struck.errors import ContactError, MaterialError, OptionError, StruckError, rounded
from struck.excitation.strike import Strike
from struck.model.arrays import Array, Complex, Index
from struck.model.contact import Place
from struck.model.damping import Damping, Each, InternalFriction, Rayleigh
from struck.model.gains import ShapeGains
from struck.model.material import Material, materials
from struck.model.mesh import Mesh
from struck.model.model import ModalModel
from struck.model.recoil import Recoil
from struck.model.timbre_table import SinglePoint
from struck.scene.render import render

POINTS = 10  # that keys strike: 1 to 9, and 0
SMALLEST, LARGEST = 0.1, 10.0  # bounds of a change of size
MOST_LOSSES = 1000.0  # times those of the body
_LOW = "where its lowest modes speak most"  # a playing place without a name
_LEVEL_SECONDS = 0.25  # of a blow, in which any body reaches its peak


def facts(model: ModalModel) -> dict[str, Any]:
    """Return the facts of a model that the page shows, as JSON values."""
    surface = model.geometry
    points = list(numbered(model))
    return {
        "modes": len(model.frequencies),
        "complete_to": model.complete_to,
        "calibrated": model.calibrated,
        "mass": model.mass,
        "material": _material(model.material),
        "size": None if surface is None else np.ptp(surface.bounds, axis=0).tolist(),
        "vertices": 0 if surface is None else len(surface.points),
        "tensioned": model.tensioned,
        "method": model.provenance.method,
        "dropped": list(model.provenance.dropped),
        # Modes that a fit spends on the noise of the blow, by their numbers.
        "noise": np.flatnonzero(~model.of_object).tolist(),
        # Whether the page plays the mean over all directions of what the model radiates.
        "averaged": hasattr(model.gains, "averaged"),
        "points": points,
        "peak": max((peak(model, each["point"]) for each in points), default=0.0),
    }


def _material(material: Material | None) -> dict[str, Any] | None:
    if material is None:
        return None
    known = materials().get(material.name)
    return {"name": material.name, "group": known["group"] if known else "other"}


def peak(model: ModalModel, at: Place) -> float:
    """Return the peak of the usual blow, wood at 1 m/s, at a contact, Pa at 1 m, or 0."""
    if not len(model.frequencies) and model.recoil is None:
        return 0.0
    try:
        model.contact(at)
    except ContactError:  # a field of recordings has places by number, none of them the usual one
        return 0.0
    how: dict[str, Any] = {"striker": "wood", "speed": 1.0}
    if not model.gains.of_surface:
        how = {"impulse": 1.0, "duration": 0.0}
    blow = Strike(at=at, **how)
    where = (model.gains.centre if isinstance(model.gains, ShapeGains) else 0.0) + np.zeros(3)
    reach = model.gains.radius if isinstance(model.gains, ShapeGains) else 0.0
    away = max(1.0, 2 * reach)
    sound = render(model, blow, seconds=_LEVEL_SECONDS, listener=where + np.array([away, 0.0, 0.0]))
    return float(sound.peak * away)


def numbered(model: ModalModel) -> Iterator[dict[str, Any]]:
    """Yield places all over a body for the keys 1 to 9 and 0: its playing place first."""
    surface = model.geometry
    if surface is None:
        yield {"name": next(iter(model.places), "as recorded"), "point": None, "direction": None}
        return
    taken: list[Array] = []
    near = 0.02 * surface.extent
    # Names of people first; those of axes may lie on top of them.
    named = sorted(model.places.items(), key=lambda pair: pair[0][0] in "+-" or pair[0] == "bottom")
    playing = model.contact()
    first = [(playing.name or _LOW, None)]
    for name, place in (*first, *named, *_spread(surface, playing.point)):
        try:
            contact = model.contact(place)
        except StruckError:
            continue
        if any(np.linalg.norm(contact.point - other) < near for other in taken):
            continue
        taken.append(contact.point)
        yield {
            "name": name,
            "point": contact.point.tolist(),
            "direction": contact.direction.tolist(),
        }
        if len(taken) == POINTS:
            return


def _spread(surface: Mesh, first: Array) -> Iterator[tuple[str, Array]]:
    """Yield middles of faces, each as far from all before as any: from the first place on."""
    distances = np.linalg.norm(surface.centroids - first, axis=1)
    for number in range(2 * POINTS):
        farthest = surface.centroids[int(np.argmax(distances))]
        distances = np.minimum(distances, np.linalg.norm(surface.centroids - farthest, axis=1))
        yield f"place {number + 1}", farthest


# Changes: the same body of another material, size or damping


def change(model: ModalModel, wanted: Mapping[str, Any]) -> dict[str, Any]:
    """Return the change of a model to another material, size or damping, as JSON values.

    Mode shapes are not among it: they are those of the model times "factor", and its vertices times
    "size". "modes" lists which mode of the model each mode was; null where all stay in order.
    Outputs follow size and damping exactly; of another material they are computed anew, which
    takes up to a second, or with "quick" kept as they are per velocity: then "settled" is false.

    Parameters
    ----------
    model : ModalModel
        As it was computed or loaded.
    wanted : mapping
        "material": a name of `struck materials`; "size": how many times as large; "damping": how
        many times as much is lost; "quick": whether to answer at once.

    Raises
    ------
    OptionError
        On other names, or numbers outside their bounds.
    MaterialError
        When the material is unknown, or the model has none to start from.
    """
    unknown = set(wanted) - {"material", "size", "damping", "quick"}
    if unknown:
        names = ", ".join(sorted(unknown))
        raise OptionError(f"{names} cannot be changed: give material, size or damping")
    size = _number("size", wanted.get("size", 1.0), SMALLEST, LARGEST)
    losses = _number("damping", wanted.get("damping", 1.0), 0.0, MOST_LOSSES)
    # In place of gains numbers, which tell which modes stay: what changes gains keeps their phase.
    numbers = SinglePoint(outputs=np.array([complex(1, n) for n in range(len(model.frequencies))]))
    after = replace(model, gains=numbers, geometry=None, places={})
    name = wanted.get("material")
    if name is not None and (model.material is None or name != model.material.name):
        after = after.made_of(_named(model, name))
    if size != 1:
        after = after.scaled(size)
    if losses != 1:
        after = after.damped(_law(after, losses))
    return _changed_facts(model, after, size, quick=wanted.get("quick") is True)


def _named(model: ModalModel, name: object) -> Material:
    """Return a material by name, with "heard" losses where the model's losses are "heard" ones."""
    if not isinstance(name, str):
        raise OptionError(f"material is {name!r}: give a name of `struck materials`")
    heard = model.material is not None and isinstance(model.material.damping, Rayleigh)
    if heard and "heard" in materials().get(name, {}):
        return Material.named(name, "heard")
    return Material.named(name)


def _law(model: ModalModel, losses: float) -> Damping:
    """Return a law of damping by which a model loses `losses` times as much."""
    law = None if model.material is None else model.material.damping
    if isinstance(law, Rayleigh):
        return Rayleigh(mass=law.mass * losses, stiffness=law.stiffness * losses)
    if isinstance(law, InternalFriction):
        return InternalFriction(
            loss_tangent=law.loss_tangent * losses, external=law.external * losses
        )
    return Each(rates=model.decays * losses)


def _number(name: str, value: object, least: float, most: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
        raise OptionError(
            f"{name} is {value!r}: it must lie from {rounded(least)} to {rounded(most)}"
        )
    return float(value)


def _outputs(
    model: ModalModel, after: ModalModel, kept: Index, size: float, density: float, *, quick: bool
) -> tuple[Complex, bool]:
    """Return the outputs of a changed model (M,), and whether they are final."""
    own = getattr(model.gains, "outputs", None)
    if own is None:
        raise MaterialError("bodies with a recorded timbre field cannot be changed in the page")
    # A body of another size has the same waves around it, all lengths and periods in proportion:
    # for the same velocity of its skin the pressure at 1 m goes with its size.
    before = model.natural_frequencies[kept]
    same = np.allclose(after.natural_frequencies * size, before, rtol=1e-9)
    if isinstance(model.gains, ShapeGains) and (same or quick):
        return own[kept] * (size * _growth(size, density)), same
    gains = model.gains.changed(after.natural_frequencies, kept, size, density)
    return getattr(gains, "outputs", own), True


def _growth(size: float, density: float) -> float:
    """Return the factor of mass-normalised shapes of a body of another size and density."""
    return (density * size**3) ** -0.5


def _changed_facts(
    model: ModalModel, after: ModalModel, size: float, *, quick: bool
) -> dict[str, Any]:
    """Return a changed model without its shapes, as JSON values."""
    numbers = np.array(getattr(after.gains, "outputs", []), np.complex128)
    kept = np.rint(numbers.imag / numbers.real).astype(np.intp)
    material, density = after.material, 1.0
    if material is not None and model.material is not None:
        density = material.density / model.material.density
    outputs, settled = _outputs(model, after, kept, size, density, quick=quick)
    whole = len(kept) == len(model.frequencies) and bool((np.diff(kept) > 0).all())
    return {
        "modes": None if whole else kept.tolist(),
        "frequencies": after.frequencies.tolist(),
        "natural_frequencies": after.natural_frequencies.tolist(),
        "decays": after.decays.tolist(),
        "outputs": np.stack([outputs.real, outputs.imag], axis=-1).tolist(),
        "settled": settled,
        "factor": _growth(size, density),
        "size": size,
        "mass": after.mass,
        "centre": None if after.centre is None else after.centre.tolist(),
        "inertia": None if after.inertia is None else after.inertia.tolist(),
        "material": material and {**(_material(material) or {}), **_elastic(material)},
        "recoil": after.recoil
        and {each.name: getattr(after.recoil, each.name).tolist() for each in fields(Recoil)},
        "complete_to": after.complete_to,
        "dropped": list(after.provenance.dropped[len(model.provenance.dropped) :]),
    }


def _elastic(material: Material) -> dict[str, float]:
    return {
        name: getattr(material, name) for name in ("density", "youngs_modulus", "poisson_ratio")
    }
