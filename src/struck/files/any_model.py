"""Models in files of any kind that holds one, told by the ending of the name."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from struck.errors import FileFormatError, LossWarning, OptionError
from struck.files import model_file, sofa_field, sofa_fields
from struck.files.atomic import writable
from struck.files.sofa_field import Contacts, load_sofa_field, save_sofa
from struck.files.sofa_fields import save_sofa_responses
from struck.model.model import ModalModel

ENDINGS = (".struck", ".sofa")
"""Of names of files that hold models."""
CONVENTIONS = (sofa_field.CONVENTION, sofa_fields.CONVENTION)
"""Of SOFA files: gains, frequencies and decays of modes; impulse responses."""
_SOFA = ".sofa"
_LONGEST = 10.0


def model_path(
    path: str | os.PathLike[str], *, unlike: Iterable[str | os.PathLike[str]] = ()
) -> Path:
    """Return the path of a model to write, refused before any work when that cannot do.

    Parameters
    ----------
    path, unlike
        As for `writable`.

    Raises
    ------
    OptionError
        On an ending that is none of `ENDINGS`.
    FileFormatError
        As `writable`.
    """
    _require_ending(path)
    return writable(path, unlike=unlike)


def is_model(path: str | os.PathLike[str]) -> bool:
    """Tell whether a file is one of a model, by the ending of its name."""
    return Path(path).suffix.lower() in ENDINGS


def save(
    model: ModalModel,
    path: str | os.PathLike[str],
    *,
    contacts: Contacts | None = None,
    listeners: ArrayLike | None = None,
) -> None:
    """Write a model to a ``.struck`` file, or its gains to a ``.sofa`` file, atomically.

    Parameters
    ----------
    model : ModalModel
    path : path
    contacts, listeners : array-like, optional
        For ``.sofa`` files, as for `export`.

    Raises
    ------
    FileFormatError
        When the file cannot be written, or cannot keep the model.
    OptionError
        On another ending, on contacts or listeners for a ``.struck`` file, and as `export`.
    ContactError, MissingDependencyError
        As `export`.

    Warns
    -----
    LossWarning
        As `export`.
    """
    _require_ending(path)
    if _is_sofa(path):
        export(model, path, contacts=contacts, listeners=listeners)
        return
    if contacts is not None or listeners is not None:
        raise OptionError(
            f"{path} keeps a model as a whole: leave contacts= and listeners= out, or end in .sofa"
        )
    model_file.save(model, path)


def load(path: str | os.PathLike[str]) -> ModalModel:
    """Read a model from a ``.struck`` file, or from a ``.sofa`` file of gains of modes.

    Raises
    ------
    FileFormatError
        When the file is missing, damaged, no model, or of a newer version.
    MissingDependencyError
        When h5py, which reads SOFA files, is not installed.
    """
    if not _is_sofa(path):
        return model_file.load(path)
    field = load_sofa_field(path)
    try:
        return field.model()
    except OptionError as error:
        raise FileFormatError(f"{path}: no model can be made of it: {error}") from error


def export(
    model: ModalModel,
    path: str | os.PathLike[str],
    *,
    contacts: Contacts | None = None,
    listeners: ArrayLike | None = None,
    convention: str = sofa_field.CONVENTION,
    seconds: float | None = None,
    sample_rate: int = 48_000,
    title: str = "",
    author: str = "",
    licence: str = "",
) -> int:
    """Write the gains of a model as a SOFA file (AES69).

    Parameters
    ----------
    model : ModalModel
    path : path
        Ends in ``.sofa``.
    contacts : array-like (P, D), optional
        Coordinates of a recorded model, or points on a surface, m, or names. Those that were
        recorded unless given; of a computed model they must be given.
    listeners : array-like (Q, 3), optional
        Body coordinates, m; the same holds for them.
    convention : str
        "GeneralTF-E": gains, frequencies and decays of modes, which come back to the last bit;
        "GeneralFIR-E": impulse responses, for other programs.
    seconds : float, optional
        Length of impulse responses; until the slowest mode has fallen by 60 dB, at most 10 s,
        unless given.
    sample_rate : int
        Of impulse responses, Hz.
    title, author, licence : str
        What a reader should know.

    Returns
    -------
    int
        How many modes impulse responses leave out, at or above half the sample rate.

    Raises
    ------
    OptionError
        On another ending or convention, and as `save_sofa` and `save_sofa_responses`.
    ContactError
        On a contact off the body, or a listener inside it.
    FileFormatError
        When the file cannot be written.
    MissingDependencyError
        Without h5py.

    Warns
    -----
    LossWarning
        When the model has what SOFA files cannot hold; see `left_out`.
    """
    if not _is_sofa(path):
        raise OptionError(f"{path} ends in {Path(path).suffix!r}: SOFA files end in '.sofa'")
    if convention not in CONVENTIONS:
        raise OptionError(f"convention is {convention!r}: give one of {', '.join(CONVENTIONS)}")
    told = {"title": title, "author": author, "licence": licence}
    if convention == sofa_field.CONVENTION:
        if seconds is not None:
            raise OptionError(
                f"seconds is {seconds}: {convention} holds modes, not samples; leave it out, or "
                f"choose {sofa_fields.CONVENTION}"
            )
        save_sofa(model, path, contacts=contacts, listeners=listeners, **told)
        beyond = 0
    else:
        beyond = save_sofa_responses(
            model,
            path,
            seconds=_ringing(model) if seconds is None else seconds,
            sample_rate=sample_rate,
            contacts=contacts,
            listeners=listeners,
            **told,
        )
    _tell_losses(model, path)
    return beyond


def left_out(model: ModalModel) -> tuple[str, ...]:
    """Return what a model has that SOFA files cannot hold."""
    parts = {
        "its residual (attack and noise)": model.residual,
        "its shape": model.geometry,
        "its material": model.material,
    }
    return tuple(name for name, part in parts.items() if part is not None)


def _tell_losses(model: ModalModel, path: str | os.PathLike[str]) -> None:
    lost = left_out(model)
    if lost:
        warnings.warn(
            f"{path} holds gains alone, without {', '.join(lost)}: keep a .struck file as well",
            LossWarning,
            stacklevel=3,
        )


def _require_ending(path: str | os.PathLike[str]) -> None:
    if not is_model(path):
        ending = Path(path).suffix
        raise OptionError(
            f"{path} ends in {ending!r}: models end in .struck, or in .sofa for their gains alone"
        )


def _is_sofa(path: str | os.PathLike[str]) -> bool:
    return Path(path).suffix.lower() == _SOFA


def _ringing(model: ModalModel) -> float:
    slowest = float(np.min(model.decays, initial=np.inf))
    fallen = float(np.log(1000))
    return fallen / slowest if slowest * _LONGEST > fallen else _LONGEST
