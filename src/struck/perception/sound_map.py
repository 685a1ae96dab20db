"""Sound maps: few stored sounds that stand for all contacts of a body (1998, section 5)."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from struck.errors import FileFormatError, OptionError
from struck.files.atomic import write_bytes
from struck.files.container import from_bytes, to_bytes
from struck.model.arrays import Array, Complex, Index
from struck.model.contact import Contact
from struck.model.mesh import Mesh, Surface
from struck.model.model import ModalModel
from struck.perception.auditory_scale import integrated
from struck.perception.covering import Cover, Ear, covered
from struck.perception.sonic_distance import HeardModel, surface_of

THRESHOLD = 3.0


@dataclass(frozen=True, kw_only=True, eq=False)
class SoundMap:
    """Stored contacts, and which of them sounds, how loudly, wherever a body is struck.

    The surface is cut into triangles, finer where the timbre changes faster. Each takes the timbre
    of one stored contact, at a level that goes with the amplitude from corner to corner.

    Parameters
    ----------
    frequencies, decays : array (M,)
        Of the modes, Hz and 1/s.
    contacts, directions : array (K, 3)
        Where bodies were struck, m, and which way: straight into the surface.
    gains : array (K, M), complex
        Of the modes at the listener, Pa/(N s), or relative where not `calibrated`.
    calibrated : bool
        Whether gains are Pa/(N s).
    listener : array (3,)
        m.
    level : float
        That the loudest contact reaches where `bound` holds, dB re 20 micropascal.
    threshold : float
        Asked for, dB.
    bound : float
        No contact sounds farther from what is stored for it, by the sonic distance, dB.
    surface : Mesh
        The triangles.
    owners : array (F,)
        Which stored contact each takes its timbre from.
    factors : array (F, 3)
        What its sound is multiplied by at the corners.
    brightness : array (F, 3)
        Of the body itself at the corners: centroids of the spectra, Hz; NaN where it is silent.

    Raises
    ------
    OptionError
        When the arrays do not belong together.
    """

    frequencies: Array
    decays: Array
    contacts: Array
    directions: Array
    gains: Complex
    calibrated: bool
    listener: Array
    level: float
    threshold: float
    bound: float
    surface: Mesh
    owners: Index
    factors: Array
    brightness: Array

    def __post_init__(self) -> None:
        stored, modes, faces = len(self.contacts), len(self.frequencies), len(self.surface.faces)
        wanted = {
            "decays": (modes,),
            "contacts": (stored, 3),
            "directions": (stored, 3),
            "gains": (stored, modes),
            "listener": (3,),
            "owners": (faces,),
            "factors": (faces, 3),
            "brightness": (faces, 3),
        }
        for name, shape in wanted.items():
            if np.shape(getattr(self, name)) != shape:
                found = np.shape(getattr(self, name))
                raise OptionError(f"{name} are {found}, not {shape}: make the map again")
        if not (self.owners.min() >= 0 and self.owners.max() < stored):
            raise OptionError(f"triangles take sounds beyond the {stored} stored: make it again")

    def __repr__(self) -> str:
        return (
            f"SoundMap({len(self.contacts)} contacts of {len(self.frequencies)} modes, no other "
            f"farther than {self.bound:.2f} dB)"
        )

    @cached_property
    def locator(self) -> Surface:
        """The triangles as a place to look contacts up on."""
        return Surface(self.surface)

    def stored(self, point: ArrayLike) -> tuple[int, float]:
        """Return which stored contact sounds at a point, and what to multiply it by.

        Parameters
        ----------
        point : array-like (3,)
            In the body's coordinates, m; the push goes straight into the surface.

        Raises
        ------
        ContactError
            When the point is off the body.
        """
        wanted = np.asarray(point, float)
        contact = Contact.on(self.locator, self.surface, wanted)
        faces, weights = self.locator.barycentric(contact.point)
        return int(self.owners[faces[0]]), float(weights[0] @ self.factors[faces[0]])

    def at(self, point: ArrayLike) -> Complex:
        """Return the gains of a unit impulse at a point, straight into the surface (M,).

        With `frequencies` and `decays` they are all that a synthesizer needs:
        p(t) = sum_n Im[g_n exp((-d_n + 2 pi i f_n) t)].

        Raises
        ------
        ContactError
            When the point is off the body.
        """
        number, factor = self.stored(point)
        return factor * self.gains[number]

    @property
    def stored_brightness(self) -> Array:
        """Centroids of the spectra of the stored sounds, Hz (K,)."""
        energies = np.square(np.abs(self.gains)) * integrated(self.decays)
        return energies @ self.frequencies / energies.sum(axis=1)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the map as parameters, whole or not at all: a safetensors file.

        Raises
        ------
        FileFormatError
            When it cannot be written.
        """
        write_bytes(path, to_bytes(self, (SoundMap, Mesh)))

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> SoundMap:
        """Read a map that `save` wrote.

        Raises
        ------
        FileFormatError
            When it cannot be read, or is damaged or no map.
        """
        try:
            data = Path(path).read_bytes()
        except OSError as error:
            raise FileFormatError(f"{path} cannot be read: {error.strerror or error}") from error
        try:
            found = from_bytes(data, (SoundMap, Mesh))
        except FileFormatError as error:
            raise FileFormatError(f"{path}: {error}") from error
        if not isinstance(found, cls):
            raise FileFormatError(f"{path} holds no sound map: save one with SoundMap.save")
        return found


def sound_map(
    model: ModalModel,
    threshold_db: float = THRESHOLD,
    *,
    listener: ArrayLike | None = None,
    level: float | None = None,
) -> SoundMap:
    """Choose how few contacts are enough, and which sounds where.

    Parameters
    ----------
    model : ModalModel
        With a surface.
    threshold_db : float
        How far, by `sonic_distance`, what is stored may be from what sounds at any contact, pushed
        straight into the surface.
    listener : array-like (3,), optional
        m; beside the model unless given.
    level : float, optional
        Of the loudest contact, dB re 20 micropascal; 85 unless given. Softer needs fewer.

    Returns
    -------
    SoundMap
        Its `bound` holds at all contacts, not at samples: see `struck.perception.covering`. For
        modes given at vertices it follows from their being straight in between; for modes in
        closed form, what they bend between the corners and middles of edges is taken as twice the
        most that the middles show.

    Raises
    ------
    OptionError
        When the threshold does not exceed 0 or is too fine, the model is silent, or several
        listeners are given.
    ContactError
        When the model has no surface, or the listener is inside it.
    """
    if not (np.isfinite(threshold_db) and threshold_db > 0):
        raise OptionError(f"threshold_db is {threshold_db}: it must exceed 0, such as 3")
    surface = surface_of(model)
    heard = HeardModel.at(model, listener, level)
    if len(heard.listeners) > 1:
        raise OptionError(f"{len(heard.listeners)} listeners are given: make a map for each")
    cover = covered(Ear.of(heard), surface, threshold_db)
    gains = heard.gains(cover.points, cover.directions)[:, 0]
    return SoundMap(
        frequencies=model.frequencies,
        decays=model.decays,
        contacts=cover.points,
        directions=cover.directions,
        gains=gains,
        calibrated=model.calibrated,
        listener=heard.listeners[0],
        level=heard.level,
        threshold=float(threshold_db),
        bound=float(cover.misfits.max()),
        surface=_joined(cover, surface.up),
        owners=cover.owners,
        factors=_factors(heard, cover),
        brightness=cover.brightness,
    )


def _factors(heard: HeardModel, cover: Cover) -> Array:
    """Return amplitudes at the corners over those of the contacts that sound there (F, 3)."""
    own = np.linalg.norm(heard.amplitudes(cover.points, cover.directions), axis=1)
    return cover.amplitudes / own[cover.owners][:, None]


def _joined(cover: Cover, up: str) -> Mesh:
    """Return the triangles with the corners that they share."""
    points, numbers = np.unique(cover.corners.reshape(-1, 3), axis=0, return_inverse=True)
    return Mesh(points=points, faces=numbers.reshape(-1, 3), up=up)
