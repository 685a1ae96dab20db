"""Timbre fields as SOFA files: gains, frequencies and decays of modes, convention GeneralTF-E."""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from struck.errors import FileFormatError, OptionError
from struck.files.sofa import Container, Variable, opened, write_container
from struck.files.sofa_geometry import (
    attributes_of,
    centre_of,
    contacts_of,
    geometry_of,
    is_calibrated,
    listeners_of,
    radius_of,
    symmetry_of,
    way_of,
)
from struck.files.sofa_origin import origin_attributes, origin_of, origin_variables
from struck.model.contact import Place
from struck.model.model import ModalModel
from struck.model.sampled_field import SampledField

Array = NDArray[np.float64]
Contacts = ArrayLike | Sequence[Place]

CONVENTION = "GeneralTF-E"
_COMMENT = (
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
        **attributes_of(field, _COMMENT, title or field.title, author, licence),
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
