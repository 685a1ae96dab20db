"""Impulse responses of bodies as SOFA files, convention GeneralFIR-E: what other programs read."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from struck.errors import FileFormatError, OptionError
from struck.files.sofa import MOST_VALUES, Variable, opened, write_container
from struck.files.sofa_field import Contacts, sampled
from struck.files.sofa_geometry import (
    attributes_of,
    contacts_of,
    geometry_of,
    is_calibrated,
    listeners_of,
)
from struck.files.sofa_origin import origin_attributes
from struck.model.air import AIR
from struck.model.exponentials import samples
from struck.model.model import ModalModel
from struck.model.sampled_field import SampledField

Array = NDArray[np.float64]

CONVENTION = "GeneralFIR-E"
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
        "SOFAConventions": CONVENTION,
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
        file.require_convention(CONVENTION)
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
