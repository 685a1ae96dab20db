"""Facts of a model for the page: figures, numbered places, and changes of material or size."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np

from struck.errors import ContactError, MaterialError, OptionError, StruckError, rounded
from struck.excitation.strike import Strike
from struck.model.air_losses import AirLosses
from struck.model.arrays import Array, Complex, Index
from struck.model.contact import Place
from struck.model.damping import (
    Damping,
    Each,
    InternalFriction,
    Rayleigh,
    contains_air,
    ringing,
)
from struck.model.gains import ShapeGains
from struck.model.material import Material, materials
from struck.model.mesh import Mesh
from struck.model.model import ModalModel
from struck.model.recoil import Recoil
from struck.model.timbre_table import SinglePoint
from struck.scene.render import render

POINTS = 10  # that keys strike: 1 to 9, and 0
MIN_SIZE, MAX_SIZE = 0.1, 10.0  # bounds of a change of size
MAX_LOSSES = 1000.0  # times those of the body
_UNNAMED_PLACE = "where its lowest modes speak most"  # a playing place without a name
_LEVEL_SECONDS = 0.25  # of a blow, in which any body reaches its peak


def facts(model: ModalModel) -> dict[str, Any]:
    """Return the facts of a model that the page shows, as JSON values."""
    surface = model.geometry
    points = list(number_places(model))
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
        "peak": max((peak(model, point["point"]) for point in points), default=0.0),
    }


def _material(material: Material | None) -> dict[str, Any] | None:
    if material is None:
        return None
    entry = materials().get(material.name)
    return {"name": material.name, "group": entry["group"] if entry else "other"}


def peak(model: ModalModel, at: Place) -> float:
    """Return the peak of the usual blow, wood at 1 m/s, at a contact, Pa at 1 m, or 0."""
    if not len(model.frequencies) and model.recoil is None:
        return 0.0
    try:
        model.contact(at)
    except ContactError:  # a field of recordings has numbered places, and no default one
        return 0.0
    options: dict[str, Any] = {"striker": "wood", "speed": 1.0}
    if not model.gains.of_surface:
        options = {"impulse": 1.0, "duration": 0.0}
    blow = Strike(at=at, **options)
    centre = (model.gains.centre if isinstance(model.gains, ShapeGains) else 0.0) + np.zeros(3)
    reach = model.gains.radius if isinstance(model.gains, ShapeGains) else 0.0
    distance = max(1.0, 2 * reach)
    sound = render(
        model, blow, seconds=_LEVEL_SECONDS, listener=centre + np.array([distance, 0.0, 0.0])
    )
    return float(sound.peak * distance)


def number_places(model: ModalModel) -> Iterator[dict[str, Any]]:
    """Yield places all over a body for the keys 1 to 9 and 0: its playing place first."""
    surface = model.geometry
    if surface is None:
        yield {"name": next(iter(model.places), "as recorded"), "point": None, "direction": None}
        return
    points: list[Array] = []
    min_distance = 0.02 * surface.extent
    # Everyday names first; those of axes may be at the same points.
    named_places = sorted(
        model.places.items(), key=lambda pair: pair[0].startswith(("+", "-")) or pair[0] == "bottom"
    )
    playing = model.contact()
    first = [(playing.name or _UNNAMED_PLACE, None)]
    for name, place in (*first, *named_places, *_spread(surface, playing.point)):
        try:
            contact = model.contact(place)
        except StruckError:
            continue
        if any(np.linalg.norm(contact.point - point) < min_distance for point in points):
            continue
        points.append(contact.point)
        yield {
            "name": name,
            "point": contact.point.tolist(),
            "direction": contact.direction.tolist(),
        }
        if len(points) == POINTS:
            return


def _spread(surface: Mesh, first: Array) -> Iterator[tuple[str, Array]]:
    """Yield centroids of faces, each farthest from all before it and from the first place."""
    distances = np.linalg.norm(surface.centroids - first, axis=1)
    for number in range(2 * POINTS):
        farthest_point = surface.centroids[int(np.argmax(distances))]
        distances = np.minimum(
            distances, np.linalg.norm(surface.centroids - farthest_point, axis=1)
        )
        yield f"place {number + 1}", farthest_point


# Changes: the same body of another material, size or damping


def change(model: ModalModel, request: Mapping[str, Any]) -> dict[str, Any]:
    """Return the change of a model to another material, size or damping, as JSON values.

    Mode shapes are not among it: they are those of the model times "factor", and its vertices times
    "size". "modes" lists which mode of the model each mode was; null where all stay in order.
    Outputs follow size and damping exactly; of another material they are computed again, which
    takes up to a second, or with "quick" kept as they are per velocity: then "settled" is false.

    Parameters
    ----------
    model : ModalModel
        As it was computed or loaded.
    request : mapping
        "material": a name of `struck materials`; "size": how many times as large; "damping": how
        many times as much is lost; "quick": whether to answer at once.

    Raises
    ------
    OptionError
        On other names, or numbers outside their bounds.
    MaterialError
        When the material is unknown, or the model has none to start from.
    """
    unknown_names = set(request) - {"material", "size", "damping", "quick"}
    if unknown_names:
        names = ", ".join(sorted(unknown_names))
        raise OptionError(f"{names} cannot be changed: give material, size or damping")
    size = _number("size", request.get("size", 1.0), MIN_SIZE, MAX_SIZE)
    losses = _number("damping", request.get("damping", 1.0), 0.0, MAX_LOSSES)
    # Gains are replaced by the numbers of modes, to find the modes that stay: changes of gains keep
    # their phase.
    numbers = SinglePoint(outputs=np.array([complex(1, n) for n in range(len(model.frequencies))]))
    # Without the losses to the air, which those of the changed body replace.
    decays = model.decays - model.air_decays
    changed_model = replace(model, gains=numbers, decays=decays, geometry=None, places={})
    name = request.get("material")
    if name is not None and (model.material is None or name != model.material.name):
        changed_model = changed_model.made_of(_find_material(model, name))
    if size != 1:
        changed_model = changed_model.scaled(size)
    if losses != 1:
        changed_model = changed_model.damped(_law(changed_model, losses))
    return _changed_facts(model, changed_model, size, quick=request.get("quick") is True)


def _find_material(model: ModalModel, name: object) -> Material:
    """Return a material by name, with "heard" losses where the model's losses are "heard" ones."""
    if not isinstance(name, str):
        raise OptionError(f"material is {name!r}: give a name of `struck materials`")
    is_rayleigh = model.material is not None and isinstance(model.material.damping, Rayleigh)
    if is_rayleigh and "heard" in materials().get(name, {}):
        return Material.named(name, "heard")
    return Material.named(name)


def _law(model: ModalModel, losses: float) -> Damping:
    """Return a law of damping by which a model loses `losses` times as much."""
    law = None if model.material is None else model.material.damping
    if isinstance(law, Rayleigh):
        factors = {"mass": law.mass * losses, "stiffness": law.stiffness * losses}
        return replace(law, **factors, external=law.external * losses)
    if isinstance(law, InternalFriction):
        factors = {"loss_tangent": law.loss_tangent * losses}
        return replace(law, **factors, external=law.external * losses)
    rates = model.decays if law is None else law.decays(model.natural_frequencies)
    return Each(rates=rates * losses, contains_air=law is None or contains_air(law))


def _number(name: str, value: object, min_value: float, max_value: float) -> float:
    if (
        isinstance(value, bool)
        or not isinstance(value, int | float)
        or not min_value <= value <= max_value
    ):
        raise OptionError(
            f"{name} is {value!r}: it must lie from {rounded(min_value)} to {rounded(max_value)}"
        )
    return float(value)


def _radiation(
    model: ModalModel,
    changed_model: ModalModel,
    mode_numbers: Index,
    size: float,
    density: float,
    *,
    quick: bool,
) -> tuple[Complex, AirLosses | None, bool]:
    """Return outputs of a changed model (M,), its losses to the air, and whether both are final."""
    gains = model.gains
    outputs = getattr(gains, "outputs", None)
    if outputs is None:
        raise MaterialError("bodies with a recorded timbre field cannot be changed in the page")
    # A body of another size has the same waves around it, all lengths and periods in proportion:
    # for the same velocity of its skin the pressure at 1 m goes with its size.
    frequencies = model.natural_frequencies[mode_numbers]
    is_scaled = np.allclose(changed_model.natural_frequencies * size, frequencies, rtol=1e-9)
    if isinstance(gains, ShapeGains) and (is_scaled or quick):
        losses = gains.losses and gains.losses.chosen(mode_numbers).scaled(size, density)
        return outputs[mode_numbers] * (size * _growth(size, density)), losses, is_scaled
    new_gains = gains.changed(changed_model.natural_frequencies, mode_numbers, size, density)
    return getattr(new_gains, "outputs", outputs), getattr(new_gains, "losses", None), True


def _growth(size: float, density: float) -> float:
    """Return the factor of mass-normalised shapes of a body of another size and density."""
    return (density * size**3) ** -0.5


def _changed_facts(
    model: ModalModel, changed_model: ModalModel, size: float, *, quick: bool
) -> dict[str, Any]:
    """Return a changed model without its shapes, as JSON values."""
    numbers = np.array(getattr(changed_model.gains, "outputs", []), np.complex128)
    mode_numbers = np.rint(numbers.imag / numbers.real).astype(np.intp)
    material, density = changed_model.material, 1.0
    if material is not None and model.material is not None:
        density = material.density / model.material.density
    outputs, losses, is_final = _radiation(
        model, changed_model, mode_numbers, size, density, quick=quick
    )
    natural, decays = changed_model.natural_frequencies, changed_model.decays
    if model.air and losses and material is not None and not contains_air(material.damping):
        decays = decays + losses.total
    is_ringing = decays < 2 * np.pi * natural
    mode_numbers, natural, decays = (
        mode_numbers[is_ringing],
        natural[is_ringing],
        decays[is_ringing],
    )
    outputs = outputs[is_ringing]
    is_complete = len(mode_numbers) == len(model.frequencies) and bool(
        (np.diff(mode_numbers) > 0).all()
    )
    return {
        "modes": None if is_complete else mode_numbers.tolist(),
        "frequencies": ringing(natural, decays).tolist(),
        "natural_frequencies": natural.tolist(),
        "decays": decays.tolist(),
        "outputs": np.stack([outputs.real, outputs.imag], axis=-1).tolist(),
        "settled": is_final,
        "factor": _growth(size, density),
        "size": size,
        "mass": changed_model.mass,
        "centre": None if changed_model.centre is None else changed_model.centre.tolist(),
        "inertia": None if changed_model.inertia is None else changed_model.inertia.tolist(),
        "material": material and {**(_material(material) or {}), **_read_elasticity(material)},
        "recoil": changed_model.recoil
        and {
            item.name: getattr(changed_model.recoil, item.name).tolist() for item in fields(Recoil)
        },
        "complete_to": changed_model.complete_to,
        "dropped": list(changed_model.provenance.dropped[len(model.provenance.dropped) :]),
    }


def _read_elasticity(material: Material) -> dict[str, float]:
    return {
        name: getattr(material, name) for name in ("density", "youngs_modulus", "poisson_ratio")
    }
