"""Timbre fields (GeneralTF-E) and impulse responses (GeneralFIR-E) of bodies as SOFA files."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from struck.errors import (
    FileFormatError,
    LossWarning,
    OptionError,
    counted,
    require_choice,
    rounded,
)
from struck.files.atomic import ended
from struck.files.sampled_field import WAYS, Origin, SampledField
from struck.files.sofa import (
    CONVENTIONS,
    LONGEST,
    MOST_VALUES,
    Container,
    Variable,
    metres,
    opened,
    write_container,
)
from struck.model.arrays import Array, checked
from struck.model.contact import Place
from struck.model.exponentials import samples
from struck.model.material import AIR
from struck.model.model import ModalModel
from struck.model.provenance import Provenance
from struck.model.survey import SYMMETRIES

_LONGEST = 10.0  # s, of impulse responses unless their length is given

Places = ArrayLike | Sequence[Place]

_PASCAL, _RELATIVE = "Pa/(N s)", "relative"
_AXES = ("ContactU", "ContactV")
_UNKNOWN = "unknown"
_SOURCE, _MODEL = "GainSource", "model"
_SPARE_BYTES = 100  # bytes for a last line
_PLACE = "RecordedContact"
_ERRORS, _UNMEASURED = "ModeError", "ModeUnmeasured"
_SURFACE = (
    " ContactU and ContactV are coordinates on the surface; EmitterPosition repeats them as "
    "(u, v, 0), as their places in space are not known."
)
_RESPONSES_COMMENT = (
    "Responses of a struck body to a unit impulse, in GainUnit: sums of {count} modes{left_out}. "
    "Emitters are contacts, measurements are listeners. Data.Delay is the travel time from "
    "SoundCentre."
)
_FIELD_COMMENT = (
    "Modes of a struck body: N holds their ringing frequencies in Hz, ModeDecay the decay rates d "
    "of their amplitudes in 1/s. Emitters are contacts, measurements are listeners. The pressure "
    "after a unit impulse is the sum over modes of Im[g exp((-d + 2 pi i f) t)] with g from "
    "Data.Real and Data.Imag, in GainUnit; t counts from the arrival, which is distance from "
    "SoundCentre / speed of sound after the impulse."
)


def save_sofa(
    source: ModalModel | SampledField,
    path: str | os.PathLike[str],
    *,
    contacts: Places | None = None,
    listeners: ArrayLike | None = None,
    title: str = "",
    author: str = "",
    licence: str = "",
) -> None:
    """Write the gains of a model as a SOFA file of convention GeneralTF-E (AES69-2022).

    Contacts (P, D), coordinates of the model's field, points on its surface, m, or names, become
    emitters; listeners (Q, 3), body coordinates, m, become measurements; by default the
    recorded ones. Decays are stored in an additional variable, ModeDecay; frequencies and decays
    come back to the last bit. So do errors of frequencies (ModeError), the radius of the body
    (BodyRadius), references and notes.
    """
    field = sampled(source, contacts, listeners)
    data = field.gains.transpose(1, 2, 0)[:, np.newaxis]  # listeners, receiver, modes, contacts
    variables = {
        "Data.Real": Variable(data.real, "MRNE"),
        "Data.Imag": Variable(data.imag, "MRNE"),
        "N": Variable(field.frequencies, "N", {"LongName": "frequency", "Units": "hertz"}),
        "ModeDecay": Variable(
            field.decays, "N", {"LongName": "decay rate of the amplitude", "Units": "1/s"}
        ),
        **_origin_variables(field.origin, len(field.frequencies)),
    }
    names = (title or field.title, author, licence)
    _write(path, (CONVENTIONS[0], "1.0", "TF-E"), field, variables, _FIELD_COMMENT, *names)


def load_sofa_field(path: str | os.PathLike[str]) -> SampledField:
    """Read the gains of modes from contacts to listeners in a SOFA file (GeneralTF-E)."""
    with opened(path) as file:
        file.require_convention(CONVENTIONS[0])
        frequencies, decays = _modes(file)
        listeners, (contacts, coordinates) = _listeners_of(file), _contacts_of(file)
        shape = (len(listeners), 1, len(frequencies), len(contacts))
        data = file.numbers("Data.Real", shape) + 1j * file.numbers("Data.Imag", shape)
        return SampledField(
            frequencies=frequencies,
            decays=decays,
            contacts=contacts,
            listeners=listeners,
            gains=np.ascontiguousarray(data[:, 0].transpose(2, 0, 1)),
            centre=_centre_of(file),
            symmetry=_choice(file, "Symmetry", SYMMETRIES),
            calibrated=file.text("GainUnit") == _PASCAL,
            coordinates=coordinates,
            title=file.text("Title"),
            interpolation=_choice(file, "Interpolation", WAYS),
            radius=_radius_of(file),
            origin=_origin_of(file, len(frequencies)),
        )


def sampled(
    source: ModalModel | SampledField, contacts: Places | None, listeners: ArrayLike | None
) -> SampledField:
    """Return gains at contacts and listeners; a sampled field is returned unchanged."""
    if isinstance(source, SampledField):
        if contacts is not None or listeners is not None:
            raise OptionError("a SampledField has its own contacts and listeners: leave them out")
        return source
    return SampledField.of(source, contacts, listeners)


def _modes(file: Container) -> tuple[Array, Array]:
    """Return frequencies and decays (M,)."""
    if "ModeDecay" not in file:
        raise FileFormatError(
            "it has no variable ModeDecay, so its spectra are not those of modes: fit a model to "
            "impulse responses instead"
        )
    frequencies = file.numbers("N")
    decays = file.numbers("ModeDecay", frequencies.shape)
    if frequencies.ndim != 1 or not len(frequencies):
        raise FileFormatError(f"its N has shape {frequencies.shape}: give one frequency a mode")
    if frequencies.min() <= 0 or decays.min() < 0:
        raise FileFormatError(
            f"its modes have frequencies from {rounded(frequencies.min())} Hz and decays from "
            f"{rounded(decays.min())} 1/s: frequencies above 0 and decays of at least 0 are read"
        )
    return frequencies, decays


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Responses:
    """Impulse responses of P contacts at Q listeners."""

    samples: Array  # (P, Q, n) from the arrival on, in Pa/(N s) if calibrated, else relative
    sample_rate: float  # Hz
    delays: Array  # (P, Q), s, from the impulse to the first sample
    contacts: Array  # (P, D): coordinates u, or u and v, or x, y, z in m
    listeners: Array  # (Q, 3), m
    calibrated: bool


def save_sofa_responses(
    source: ModalModel | SampledField,
    path: str | os.PathLike[str],
    *,
    seconds: float,
    sample_rate: int = 48_000,
    contacts: Places | None = None,
    listeners: ArrayLike | None = None,
    title: str = "",
    author: str = "",
    licence: str = "",
) -> int:
    """Write impulse responses of a model as a SOFA file of convention GeneralFIR-E (AES69-2022).

    A response, some seconds long, is the sum over modes of Im[g exp((-d + 2 pi i f) t)], sampled;
    other arguments as of `save_sofa`. Returns how many modes at or above half the sample rate, Hz,
    were left out.
    """
    field = sampled(source, contacts, listeners)
    length = _length(field, seconds, sample_rate)
    is_below_nyquist = field.frequencies < sample_rate / 2
    lost_count = int(np.count_nonzero(~is_below_nyquist))
    remark = (
        f" ({lost_count} more at or above {rounded(sample_rate / 2)} Hz are left out)"
        if lost_count
        else ""
    )
    comment = _RESPONSES_COMMENT.format(count=np.count_nonzero(is_below_nyquist), left_out=remark)
    variables = {
        "Data.IR": Variable(_responses(field, is_below_nyquist, length, sample_rate), "MRNE"),
        "Data.SamplingRate": Variable(np.array([float(sample_rate)]), "I", {"Units": "hertz"}),
        "Data.Delay": Variable(_travels(field) * sample_rate, "MRE"),
    }
    names = (title or field.title, author, licence)
    _write(path, (CONVENTIONS[1], "2.0", "FIR-E"), field, variables, comment, *names)
    return lost_count


@checked
def load_sofa_responses(path: str | os.PathLike[str]) -> Responses:
    """Read impulse responses from a SOFA file of convention GeneralFIR-E.

    Parameters
    ----------
    path : path
        The file; its Data.IR has the shape (listeners, 1, samples, contacts).

    Returns
    -------
    Responses
        The impulse responses.

    Raises
    ------
    FileFormatError
        If the file cannot be read, is damaged, or has another convention.
    MissingDependencyError
        If h5py is not installed.
    """
    with opened(path) as file:
        file.require_convention(CONVENTIONS[1])
        listeners, (contacts, _) = _listeners_of(file), _contacts_of(file)
        listener_count, contact_count = len(listeners), len(contacts)
        shape = file.shape("Data.IR")
        if len(shape) != 4 or shape[2] < 1:
            raise FileFormatError(
                f"its Data.IR has shape {shape}, and (listeners, 1, samples, contacts) is read: "
                "save it again with a SOFA library"
            )
        data = file.numbers("Data.IR", (listener_count, 1, shape[2], contact_count))
        rates = np.unique(file.numbers("Data.SamplingRate", (1,), (listener_count,)))
        if len(rates) != 1 or rates[0] < 1:
            raise FileFormatError(
                f"its sample rates are {', '.join(map(rounded, rates[:3]))} Hz, "
                "and one of at least 1 Hz is read: resample it"
            )
        shapes = (1, 1, contact_count), (listener_count, 1, contact_count)
        delays = file.numbers("Data.Delay", *shapes)[:, 0] / rates[0]
        return Responses(
            samples=np.ascontiguousarray(data[:, 0].transpose(2, 0, 1)),
            sample_rate=float(rates[0]),
            delays=np.broadcast_to(delays, (listener_count, contact_count)).T.copy(),
            contacts=contacts,
            listeners=listeners,
            calibrated=file.text("GainUnit") == _PASCAL,
        )


def _length(field: SampledField, seconds: float, sample_rate: int) -> int:
    if not (sample_rate >= 1 and float(sample_rate).is_integer()):
        raise OptionError(f"sample_rate is {sample_rate}: give a whole number of Hz, such as 48000")
    pairs = field.gains.shape[0] * field.gains.shape[1]
    longest = MOST_VALUES // pairs / sample_rate
    if not 1 / sample_rate <= seconds <= longest:
        raise OptionError(
            f"seconds is {seconds}: from one sample to {rounded(longest, 3)} s are written for "
            f"{pairs} pairs of contact and listener; choose fewer of them, or a lower rate"
        )
    return round(seconds * sample_rate)


def _responses(
    field: SampledField, is_below_nyquist: NDArray[np.bool_], length: int, sample_rate: int
) -> Array:
    """Return the samples by listener, receiver, time and contact (M, 1, N, E)."""
    poles = (-field.decays + 2j * np.pi * field.frequencies)[is_below_nyquist]
    contact_count, listener_count, _ = field.gains.shape
    gains = field.gains[:, :, is_below_nyquist].reshape(contact_count * listener_count, -1)
    sums = samples(poles, gains, length, sample_rate).reshape(contact_count, listener_count, length)
    return np.ascontiguousarray(sums.transpose(1, 2, 0)[:, np.newaxis])


def _travels(field: SampledField) -> Array:
    """Return the travel times, s, by listener, receiver and contact (M, 1, E)."""
    contact_count, listener_count, _ = field.gains.shape
    distances = np.linalg.norm(field.listeners - field.centre, axis=1)
    return np.broadcast_to(
        (distances / AIR.sound_speed)[:, None, None], (listener_count, 1, contact_count)
    )


def _write(
    path: str | os.PathLike[str],
    kind: tuple[str, str, str],
    field: SampledField,
    variables: Mapping[str, Variable],
    comment: str,
    *names: str,
) -> None:
    """Write variables of a field, its places and origin; `names` are title, author, licence."""
    axes = field.contacts.shape[1]
    title, author, licence = (name or "not stated" for name in names)
    attributes = {
        **dict(zip(("SOFAConventions", "SOFAConventionsVersion", "DataType"), kind, strict=True)),
        "Title": title,
        "AuthorContact": author,
        "Organization": author,
        "License": licence,
        "Comment": comment + (_SURFACE if axes in {1, 2} else ""),
        "GainUnit": _PASCAL if field.calibrated else _RELATIVE,
        "Symmetry": field.symmetry,
        "Interpolation": field.interpolation,
        **({} if axes else {"ContactPlaces": _UNKNOWN}),
        **_origin_attributes(field.origin),
    }
    write_container(path, {**_geometry_of(field), **variables}, attributes)


def _geometry_of(field: SampledField) -> dict[str, Variable]:
    """Return the variables of places: measurements are listeners, emitters contacts."""
    count, axes = field.contacts.shape
    emitters = np.zeros((count, 3))
    emitters[:, :axes] = field.contacts
    origin = np.zeros((1, 3))
    places = {
        "ListenerPosition": metres(field.listeners, "MC"),
        "ReceiverPosition": metres(origin, "RC"),
        "SourcePosition": metres(origin, "IC"),
        "EmitterPosition": metres(emitters, "EC"),
        "SoundCentre": metres(field.centre[np.newaxis], "IC"),
    }
    if field.radius:
        attributes = {
            "LongName": "of a ball about SoundCentre that holds the body",
            "Units": "metre",
        }
        radius = np.array([field.radius])
        places["BodyRadius"] = Variable(radius, "I", attributes)
    if axes > 2:
        return places
    axis_columns = zip(_AXES, field.contacts.T, field.coordinates or ("u", "v"), strict=False)
    for axis, values, name in axis_columns:
        places[axis] = Variable(values, "E", {"LongName": name})
    return places


def _listeners_of(file: Container) -> Array:
    """Return one listener for each measurement (M, 3), m."""
    receivers = file.places("ReceiverPosition")
    if len(receivers) != 1:
        raise FileFormatError(
            f"it has {len(receivers)} receivers, and 1 for each listener is read: split them into "
            "measurements"
        )
    if receivers.any() and "ListenerView" in file:
        raise FileFormatError(
            "its receiver is off the listener, who looks somewhere: give ListenerPosition as the "
            "place of the microphone"
        )
    return file.places("ListenerPosition") + receivers


def _contacts_of(file: Container) -> tuple[Array, tuple[str, ...]]:
    """Return contacts (E, D) and the names of their coordinates; x, y, z where no others are."""
    axes = [axis for axis in _AXES if axis in file]
    if axes:
        count = file.shape("EmitterPosition")[:1]
        values = [file.numbers(axis, count) for axis in axes]
        return np.stack(values, axis=1), tuple(file.text("LongName", axis) for axis in axes)
    if file.text("ContactPlaces") == _UNKNOWN:
        return np.zeros((file.shape("EmitterPosition")[0], 0)), ()
    sources = file.places("SourcePosition")
    if len(sources) != 1 or "SourceView" in file:
        raise FileFormatError(
            f"its source has {len(sources)} places, or a view, and a body that stands still is "
            "read: give one SourcePosition, and EmitterPosition along the axes of the room"
        )
    return file.places("EmitterPosition") + sources, ("x (m)", "y (m)", "z (m)")


def _centre_of(file: Container) -> Array:
    """Return the apparent origin of the sound (3,), m: the source where no other is given."""
    name = "SoundCentre" if "SoundCentre" in file else "SourcePosition"
    places = file.places(name)
    if len(places) != 1:
        raise FileFormatError(f"its {name} has {len(places)} places, and 1 is read: give one")
    return places[0]


def _radius_of(file: Container) -> float:
    """Return the radius of a ball about the centre that holds the body, m; 0 where not known."""
    if "BodyRadius" not in file:
        return 0.0
    radius = float(file.numbers("BodyRadius", (1,))[0])
    if radius < 0:
        raise FileFormatError(f"its BodyRadius is {rounded(radius)}: give at least 0 m")
    return radius


def _choice(file: Container, name: str, choices: Sequence[str]) -> str:
    """Return an attribute that is one of some words; the first of them where it is missing."""
    value = file.text(name) or choices[0]
    require_choice(f"its {name}", value, choices, FileFormatError)
    return value


def _origin_attributes(origin: Origin | None) -> dict[str, str]:
    """Return the texts about the model that gains came from; none of measured gains."""
    if origin is None:
        return {}
    provenance = origin.provenance
    attributes = {
        _SOURCE: _MODEL,
        "Method": provenance.method,
        "References": provenance.cite(),
        "ReferenceKeys": " ".join(provenance.references),
        "Notes": _lines(provenance.dropped),
        "FieldNotes": _lines(origin.notes),
        _PLACE: "" if origin.place is None else " ".join(map(repr, origin.place.tolist())),
    }
    return {name: text for name, text in attributes.items() if text}


def _origin_variables(origin: Origin | None, count: int) -> dict[str, Variable]:
    """Return the numbers about the modes of the model that gains came from."""
    variables: dict[str, Variable] = {}
    if origin is None:
        return variables
    if origin.errors is not None:
        attributes = {
            "LongName": "relative error of the frequency, NaN where unknown",
            "Units": "1",
        }
        variables[_ERRORS] = Variable(origin.errors, "N", attributes)
    if len(origin.unmeasured):
        values = np.isin(np.arange(count), origin.unmeasured).astype(np.float64)
        attributes = {"LongName": "1 where a mode was not measured well", "Units": "1"}
        variables[_UNMEASURED] = Variable(values, "N", attributes)
    return variables


def _origin_of(file: Container, count: int) -> Origin | None:
    """Return the model that gains came from; None where they were measured."""
    if file.text(_SOURCE) != _MODEL:
        return None
    errors = file.numbers(_ERRORS, (count,), gaps=True) if _ERRORS in file else None
    unmeasured = file.numbers(_UNMEASURED, (count,)) if _UNMEASURED in file else np.zeros(count)
    return Origin(
        provenance=Provenance(
            method=file.text("Method"),
            references=tuple(file.text("ReferenceKeys").split()),
            dropped=tuple(file.text("Notes").splitlines()),
        ),
        errors=errors,
        unmeasured=np.flatnonzero(unmeasured),
        notes=tuple(file.text("FieldNotes").splitlines()),
        place=_place_of(file.text(_PLACE)),
    )


def _place_of(text: str) -> Array | None:
    if not text:
        return None
    try:
        place = np.array([float(number) for number in text.split()])
    except ValueError:
        place = np.full(1, np.nan)
    if not np.isfinite(place).all():
        raise FileFormatError(f"its {_PLACE} is {text[:80]!r}: give finite coordinates")
    return place


def _lines(sentences: Iterable[str]) -> str:
    """Return the sentences that fit into an attribute, a line each, and the number of others."""
    lines = [" ".join(sentence.split()) for sentence in sentences]
    lengths = np.cumsum([len(line.encode()) + 1 for line in lines])
    count = int(np.count_nonzero(lengths < LONGEST - _SPARE_BYTES))
    remark = [f"... and {counted(len(lines) - count, 'more note')}"] if count < len(lines) else []
    return "\n".join([*lines[:count], *remark])


def export(
    model: ModalModel,
    path: str | os.PathLike[str],
    *,
    contacts: Places | None = None,  # coordinates (P, D), points, m, or names; None: recorded
    listeners: ArrayLike | None = None,  # (Q, 3), body coordinates, m; None: recorded
    convention: str = CONVENTIONS[0],
    seconds: float | None = None,  # of impulse responses; None: until a fall of 60 dB, at most 10
    sample_rate: int = 48_000,  # of impulse responses, Hz
    title: str = "",
    author: str = "",
    licence: str = "",
) -> int:
    """Write the gains of a model as a SOFA file; return how many modes its responses lack."""
    if Path(path).suffix.lower() != ".sofa":
        raise OptionError(f"{path} {ended(path)}: SOFA files end in '.sofa'")
    require_choice("convention", convention, CONVENTIONS)
    titles = {"title": title, "author": author, "licence": licence}
    if convention == CONVENTIONS[0]:
        if seconds is not None:
            raise OptionError(
                f"seconds is {seconds}: {convention} holds modes, not samples; leave it out, or "
                f"choose {CONVENTIONS[1]}"
            )
        save_sofa(model, path, contacts=contacts, listeners=listeners, **titles)
        lost_count = 0
    else:
        if seconds is None:
            fall, min_decay = float(np.log(1000)), float(np.min(model.decays, initial=np.inf))
            seconds = fall / min_decay if min_decay * _LONGEST > fall else _LONGEST
        lost_count = save_sofa_responses(
            model,
            path,
            seconds=seconds,
            sample_rate=sample_rate,
            contacts=contacts,
            listeners=listeners,
            **titles,
        )
    losses = left_out(model)
    if losses:
        warnings.warn(
            f"{path} holds gains alone, without {', '.join(losses)}: keep a .struck file as well",
            LossWarning,
            stacklevel=2,
        )
    return lost_count


def left_out(model: ModalModel) -> tuple[str, ...]:
    """Return the parts of a model that SOFA files cannot hold."""
    parts = {
        "its residual (attack and noise)": model.residual,
        "its recoil": model.recoil,
        "its shape": model.geometry,
        "its chart (where contacts lie, in m)": model.chart,
        "its material": model.material,
        "its marks of the blow's modes": None if model.of_object.all() else model.of_object,
    }
    return tuple(name for name, part in parts.items() if part is not None)
