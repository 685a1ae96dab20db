"""A sound map as samples: a WAV file for each stored contact, and a list of its users."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from struck.errors import OptionError, article, require_choice
from struck.files import wav
from struck.files.atomic import make_folder, write_bytes
from struck.files.sound import PEAK, Sound
from struck.model.arrays import Array, checked
from struck.perception.sound_map import SoundMap

Render = Callable[[Array, Array], Sound]

MANIFEST = "sound_map.json"

_FORMAT, _VERSION = "struck-bank", 1
_ENCODING = "int24"


@checked
def write_bank(
    sound_map: SoundMap,
    folder: str | os.PathLike[str],
    render: Render,
    *,
    encoding: str = _ENCODING,
) -> Path:
    """Write the sounds of the stored contacts with a manifest.

    All files have one scale, so that they keep their levels: the loudest sample of all is at -1 dB
    of full scale. The manifest comes last: where it is, the bank is whole.

    Parameters
    ----------
    sound_map : SoundMap
        The map.
    folder : path
        Folder, which is created if it does not exist.
    render : callable
        Takes a contact (3,), m, and the direction of the push (3,); returns what it sounds like,
        such as ``lambda at, direction: struck.render(model, Strike(at=at, direction=direction))``.
    encoding : {"int24", "int16", "float32"}, default "int24"
        Encoding of the samples.

    Returns
    -------
    Path
        Of the manifest: JSON with the files, their contacts, and for each triangle of the surface
        the file that sounds and what to multiply it by at its corners, in between weighted as the
        place is by the corners.

    Raises
    ------
    OptionError
        On an unknown encoding, or sounds that are all silent or differ in rate or channels.
    FileFormatError
        When a file cannot be written.
    """
    require_choice("encoding", encoding, wav.ENCODINGS)
    contacts_and_directions = zip(sound_map.contacts, sound_map.directions, strict=True)
    sounds = [
        _render_contact(render, contact, direction)
        for contact, direction in contacts_and_directions
    ]
    factor = PEAK / _peak(sounds)
    place = make_folder(folder, parents=True)
    digits = len(str(len(sounds) - 1))
    names = [f"contact_{number:0{digits}d}.wav" for number in range(len(sounds))]
    for name, sound in zip(names, sounds, strict=True):
        samples = (sound.samples * np.float64(factor)).astype(np.float32)
        recording = wav.Recording(samples=samples, sample_rate=sound.sample_rate)
        write_bytes(place / name, wav.encode(recording, encoding))
    text = json.dumps(_manifest(sound_map, names, sounds[0], factor), separators=(",", ":"))
    write_bytes(place / MANIFEST, text.encode())
    return place / MANIFEST


def _peak(sounds: list[Sound]) -> float:
    kinds = {(sound.sample_rate, sound.channels, sound.calibrated) for sound in sounds}
    if len(kinds) > 1:
        raise OptionError(
            f"the sounds have {len(kinds)} combinations of rate, channels and unit: "
            "render all alike"
        )
    peak = max(sound.peak for sound in sounds)
    if not peak:
        raise OptionError(f"all {len(sounds)} sounds are silent: look at what render returns")
    return peak


def _manifest(sound_map: SoundMap, names: list[str], sound: Sound, factor: float) -> dict[str, Any]:
    return {
        "format": _FORMAT,
        "version": _VERSION,
        "sample_rate": sound.sample_rate,
        "channels": sound.channels,
        "samples_are": f"pressure ({'Pa' if sound.calibrated else 'relative'}) times factor",
        "factor": factor,
        "threshold_db": sound_map.threshold,
        "bound_db": sound_map.bound,
        "level_db": sound_map.level,
        "contacts": [
            {"file": name, "at": at.tolist(), "direction": direction.tolist()}
            for name, at, direction in zip(
                names, sound_map.contacts, sound_map.directions, strict=True
            )
        ],
        "surface": {
            "points": sound_map.surface.points.tolist(),
            "triangles": sound_map.surface.faces.tolist(),
            "contacts": sound_map.owners.tolist(),
            "factors": np.round(sound_map.factors, 6).tolist(),
        },
    }


def _render_contact(render: Render, contact: Array, direction: Array) -> Sound:
    """Return the result of `render` for a contact, checked to be a Sound."""
    sound = render(contact, direction)
    if not isinstance(sound, Sound):
        raise OptionError(f"render returned {article(type(sound).__name__)}: return a Sound")
    return sound
