"""Impulse responses of bodies as SOFA files, convention GeneralFIR-E: what other programs read."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from struck.errors import FileFormatError, OptionError
from struck.files.sampled_field import SampledField
from struck.files.sofa import (
    MOST_VALUES,
    Container,
    Variable,
    attributes_of,
    centre_of,
    contacts_of,
    geometry_of,
    is_calibrated,
    listeners_of,
    opened,
    origin_attributes,
    origin_of,
    origin_variables,
    radius_of,
    symmetry_of,
    way_of,
    write_container,
)
from struck.model.arrays import Array
from struck.model.contact import Place
from struck.model.exponentials import samples
from struck.model.material import AIR
from struck.model.model import ModalModel

# Timbre fields as SOFA files: gains, frequencies and decays of modes, convention GeneralTF-E.

Contacts = ArrayLike | Sequence[Place]

CONVENTION = "GeneralTF-E"
_SOFA_FIELD_COMMENT = (
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
    contacts: Contacts | None = None,
    listeners: ArrayLike | None = None,
    title: str = "",
    author: str = "",
    licence: str = "",
) -> None:
    """Write the gains of a model as a SOFA file of convention GeneralTF-E.

    Parameters
    ----------
    source : ModalModel or SampledField
    path : path
        By custom ending in ``.sofa``; a file there is replaced as a whole.
    contacts : array-like (P, D), optional
        Where a model is struck: coordinates of its field, or points on its surface, m, or names.
        They become emitters. Those that were recorded unless given.
    listeners : array-like (Q, 3), optional
        Where it is heard, body coordinates, m. They become measurements. Unless given, those that
        were recorded.
    title, author, licence : str
        What a reader should know.

    Raises
    ------
    OptionError
        When a computed model comes without contacts or listeners, or they do not fit it.
    ContactError
        On a contact off the body, or a listener inside it.
    FileFormatError
        When the file cannot be written.
    MissingDependencyError
        Without h5py.

    Notes
    -----
    AES69-2022, AES standard for file exchange: spatial acoustic data file format. Decays stand in a
    variable of our own, ModeDecay; frequencies and decays come back to the last bit. So do errors
    of frequencies (ModeError), the radius of the body (BodyRadius), references and notes.
    """
    field = sampled(source, contacts, listeners)
    told = {
        "SOFAConventions": CONVENTION,
        "SOFAConventionsVersion": "1.0",
        "DataType": "TF-E",
        **attributes_of(field, _SOFA_FIELD_COMMENT, title or field.title, author, licence),
        **origin_attributes(field.origin),
    }
    data = field.gains.transpose(1, 2, 0)[:, np.newaxis]  # listeners, receiver, modes, contacts
    variables = {
        **geometry_of(field),
        "Data.Real": Variable(values=data.real, letters="MRNE"),
        "Data.Imag": Variable(values=data.imag, letters="MRNE"),
        "N": Variable(
            values=field.frequencies,
            letters="N",
            attributes={"LongName": "frequency", "Units": "hertz"},
        ),
        "ModeDecay": Variable(
            values=field.decays,
            letters="N",
            attributes={"LongName": "decay rate of the amplitude", "Units": "1/s"},
        ),
        **origin_variables(field.origin, len(field.frequencies)),
    }
    write_container(path, variables, told)


def load_sofa_field(path: str | os.PathLike[str]) -> SampledField:
    """Read the gains of a SOFA file of convention GeneralTF-E with a variable ModeDecay.

    Raises
    ------
    FileFormatError
        When it is no such file, or what it holds is out of bounds.
    MissingDependencyError
        Without h5py.
    """
    with opened(path) as file:
        file.require_convention(CONVENTION)
        frequencies, decays = _modes(file)
        listeners, (contacts, coordinates) = listeners_of(file), contacts_of(file)
        shape = (len(listeners), 1, len(frequencies), len(contacts))
        data = file.numbers("Data.Real", shape) + 1j * file.numbers("Data.Imag", shape)
        return SampledField(
            frequencies=frequencies,
            decays=decays,
            contacts=contacts,
            listeners=listeners,
            gains=np.ascontiguousarray(data[:, 0].transpose(2, 0, 1)),
            centre=centre_of(file),
            symmetry=symmetry_of(file),
            calibrated=is_calibrated(file),
            coordinates=coordinates,
            title=file.text("Title"),
            way=way_of(file),
            radius=radius_of(file),
            origin=origin_of(file, len(frequencies)),
        )


def sampled(
    source: ModalModel | SampledField, contacts: Contacts | None, listeners: ArrayLike | None
) -> SampledField:
    """Return gains at contacts and listeners; those of a field as they are.

    Raises
    ------
    OptionError
        When a computed model comes without them, or a `SampledField` with them.
    """
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
            f"its modes have frequencies from {frequencies.min():g} Hz and decays from "
            f"{decays.min():g} 1/s: frequencies above 0 and decays of at least 0 are read"
        )
    return frequencies, decays


RESPONSES_CONVENTION = "GeneralFIR-E"
_COMMENT = (
    "Responses of a struck body to a unit impulse, in GainUnit: sums of {count} modes{left_out}. "
    "Emitters are contacts, measurements are listeners. Data.Delay is the travel time from "
    "SoundCentre."
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Responses:
    """Responses of every contact with every listener.

    Parameters
    ----------
    samples : array (P, Q, n)
        From the arrival on, in Pa/(N s) when `calibrated`, else relative.
    sample_rate : float
        Hz.
    delays : array (P, Q)
        From the impulse to the first sample, s.
    contacts : array (P, D)
        Coordinates u, or u and v, or x, y, z in m.
    listeners : array (Q, 3)
        m.
    calibrated : bool
    """

    samples: Array
    sample_rate: float
    delays: Array
    contacts: Array
    listeners: Array
    calibrated: bool


def save_sofa_responses(
    source: ModalModel | SampledField,
    path: str | os.PathLike[str],
    *,
    seconds: float,
    sample_rate: int = 48_000,
    contacts: Contacts | None = None,
    listeners: ArrayLike | None = None,
    title: str = "",
    author: str = "",
    licence: str = "",
) -> int:
    """Write impulse responses of a model as a SOFA file of convention GeneralFIR-E.

    Parameters
    ----------
    source, path, contacts, listeners, title, author, licence
        As for `save_sofa`.
    seconds : float
        Length of each response.
    sample_rate : int
        Hz.

    Returns
    -------
    int
        How many modes were left out, at or above half the sample rate.

    Raises
    ------
    OptionError
        On seconds or a rate out of bounds, or too many samples; and as `save_sofa`.
    ContactError, FileFormatError, MissingDependencyError
        As `save_sofa`.

    Notes
    -----
    AES69-2022. A response is the sum over modes of Im[g exp((-d + 2 pi i f) t)], sampled.
    """
    field = sampled(source, contacts, listeners)
    length = _length(field, seconds, sample_rate)
    kept = field.frequencies < sample_rate / 2
    lost = int(np.count_nonzero(~kept))
    left_out = f" ({lost} more at or above {sample_rate / 2:g} Hz are left out)" if lost else ""
    told = {
        "SOFAConventions": RESPONSES_CONVENTION,
        "SOFAConventionsVersion": "2.0",
        "DataType": "FIR-E",
        **attributes_of(
            field,
            _COMMENT.format(count=np.count_nonzero(kept), left_out=left_out),
            title or field.title,
            author,
            licence,
        ),
        **origin_attributes(field.origin),
    }
    variables = {
        **geometry_of(field),
        "Data.IR": Variable(values=_responses(field, kept, length, sample_rate), letters="MRNE"),
        "Data.SamplingRate": Variable(
            values=np.array([float(sample_rate)]), letters="I", attributes={"Units": "hertz"}
        ),
        "Data.Delay": Variable(values=_travels(field) * sample_rate, letters="MRE"),
    }
    write_container(path, variables, told)
    return lost


def load_sofa_responses(path: str | os.PathLike[str]) -> Responses:
    """Read the responses of a SOFA file of convention GeneralFIR-E.

    Raises
    ------
    FileFormatError
        When it is no such file, or what it holds is out of bounds.
    MissingDependencyError
        Without h5py.
    """
    with opened(path) as file:
        file.require_convention(RESPONSES_CONVENTION)
        listeners, (contacts, _) = listeners_of(file), contacts_of(file)
        heard, struck = len(listeners), len(contacts)
        shape = file.shape("Data.IR")
        if len(shape) != 4 or shape[2] < 1:
            raise FileFormatError(
                f"its Data.IR has shape {shape}, and (listeners, 1, samples, contacts) is read: "
                "save it again with a SOFA library"
            )
        data = file.numbers("Data.IR", (heard, 1, shape[2], struck))
        rates = np.unique(file.numbers("Data.SamplingRate", (1,), (heard,)))
        if len(rates) != 1 or rates[0] <= 0:
            raise FileFormatError(
                f"its sample rates are {', '.join(f'{rate:g}' for rate in rates[:3])} Hz, and one "
                "above 0 is read: resample it"
            )
        delays = file.numbers("Data.Delay", (1, 1, struck), (heard, 1, struck))[:, 0] / rates[0]
        return Responses(
            samples=np.ascontiguousarray(data[:, 0].transpose(2, 0, 1)),
            sample_rate=float(rates[0]),
            delays=np.broadcast_to(delays, (heard, struck)).T.copy(),
            contacts=contacts,
            listeners=listeners,
            calibrated=is_calibrated(file),
        )


def _length(field: SampledField, seconds: float, sample_rate: int) -> int:
    if not (sample_rate >= 1 and float(sample_rate).is_integer()):
        raise OptionError(f"sample_rate is {sample_rate}: give a whole number of Hz, such as 48000")
    pairs = field.gains.shape[0] * field.gains.shape[1]
    longest = MOST_VALUES // pairs / sample_rate
    if not 1 / sample_rate <= seconds <= longest:
        raise OptionError(
            f"seconds is {seconds}: from one sample to {longest:.3g} s are written for {pairs} "
            "pairs of contact and listener; choose fewer of them, or a lower rate"
        )
    return round(seconds * sample_rate)


def _responses(
    field: SampledField, kept: NDArray[np.bool_], length: int, sample_rate: int
) -> Array:
    """Return the samples by listener, receiver, time and contact (M, 1, N, E)."""
    poles = (-field.decays + 2j * np.pi * field.frequencies)[kept]
    struck, heard, _ = field.gains.shape
    gains = field.gains[:, :, kept].reshape(struck * heard, -1)
    sums = samples(poles, gains, length, sample_rate).reshape(struck, heard, length)
    return np.ascontiguousarray(sums.transpose(1, 2, 0)[:, np.newaxis])


def _travels(field: SampledField) -> Array:
    """Return the travel times, s, by listener, receiver and contact (M, 1, E)."""
    struck, heard, _ = field.gains.shape
    distances = np.linalg.norm(field.listeners - field.centre, axis=1)
    return np.broadcast_to((distances / AIR.sound_speed)[:, None, None], (heard, 1, struck))
