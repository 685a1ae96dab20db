"""Everything that can go wrong, in one tree.

StruckError
├── OptionError               an argument outside its bound
│   └── NoModeError           a band in which a body has no mode
├── MeshError                 a body whose geometry cannot ring as it stands
├── MaterialError             an unknown or impossible material or damping
├── ContactError              a contact off the body, or a listener inside it
├── SolverError               modes that could not be computed or certified
├── RecordingError            a recording from which no model can be had as it stands
├── FileFormatError           a file that is not what it says, or cannot be read
├── SimulationError           a rigid-body simulation that fails or explodes
├── DeviceError               an audio device that is missing or refuses
└── MissingDependencyError    an optional package that is not installed

Each message holds the value, the bound and the way out, and the nearest name where one is unknown.
"""

import difflib
import math
import re
import unicodedata
from collections.abc import Callable, Iterable, Sequence
from typing import SupportsFloat, SupportsIndex


class StruckError(Exception):
    """Base of all errors that struck raises on purpose; their text is one printable line."""

    def __str__(self) -> str:
        """Return the message; control characters, as of a name in a file, are escaped."""
        return printable(super().__str__())


class OptionError(StruckError, ValueError):
    """An argument outside its bound."""


class ArgumentError(OptionError, TypeError):
    """An argument of a wrong type."""


class NoModeError(OptionError):
    """A band in which a body has no mode."""


class MeshError(StruckError, ValueError):
    """A body whose geometry cannot ring as it stands."""


class MaterialError(StruckError, ValueError):
    """An unknown or impossible material or damping."""


class ContactError(StruckError, ValueError):
    """A contact off the body, or a listener inside it."""


class SolverError(StruckError, RuntimeError):
    """Modes that could not be computed or certified."""


class RecordingError(StruckError, ValueError):
    """A recording from which no model can be had as it stands."""


class FileFormatError(StruckError, ValueError):
    """A file whose content does not fit its format, or which cannot be read or written."""


class SimulationError(StruckError, RuntimeError):
    """A rigid-body simulation that fails or explodes."""


class DeviceError(StruckError, OSError):
    """An audio device that is missing or refuses to play."""


class MissingDependencyError(StruckError, ImportError):
    """An optional package that is not installed."""


class CacheWarning(UserWarning):
    """The cache could not keep a result, or a kept one is damaged; the result is computed again."""


class CoreWarning(UserWarning):
    """The compiled core cannot be used: everything is computed, but slowly."""


class LossWarning(UserWarning):
    """A file was written whose format cannot hold all of a model: the message lists the losses."""


class ScaleWarning(UserWarning):
    """Lengths may not be in metres, or a modulus not in Pa: the unit that may be meant."""


class RepairWarning(UserWarning):
    """A surface was repaired: the message lists its faults and the changes made."""


COUNTED = "modes are counted from 1"
"""How the shell, tables, pictures and files count modes; arrays in Python count from 0."""

# Names in use elsewhere, and the names here; of several, the first that is known is offered.
_SYNONYMS = {
    **dict.fromkeys(("velocity", "v"), ("speed",)),
    **dict.fromkeys(("hammer", "mallet", "stick", "beater"), ("striker",)),
    **dict.fromkeys(("position", "place", "point", "where", "at"), ("at", "strike", "listener")),
    **dict.fromkeys(("force", "strength"), ("impulse", "load")),
    **dict.fromkeys(
        ("hit", "blow", "knock", "tap"), ("strike", "strikes", "at", "excitations", "Strike")
    ),
    **dict.fromkeys(("synthesize", "synthesise", "sonify", "sound"), ("render",)),
    **dict.fromkeys(
        ("gain", "volume", "loudness", "loud", "amplitude", "normalize", "db"), ("level",)
    ),
    **dict.fromkeys(("quality", "resolution", "precision", "mesh-size"), ("accuracy",)),
    **dict.fromkeys(("stereo", "ears", "channels"), ("stereo", "head", "listener")),
    **dict.fromkeys(("binaural", "headphones"), ("hrtf", "head")),
    **dict.fromkeys(("reverb", "rt60", "t60"), ("reverberation",)),
    **dict.fromkeys(("drag", "rub", "slide"), ("scrape",)),
    **dict.fromkeys(("pull", "twang"), ("pluck",)),
    **dict.fromkeys(("damp", "grab", "mute"), ("hold",)),
    **dict.fromkeys(("format", "bits", "depth"), ("encoding", "sounds")),
    **dict.fromkeys(("diameter", "dia", "d"), ("diameter", "radius", "section")),
    **dict.fromkeys(("radius", "r"), ("radius", "section")),  # of a bar it is that of its section
    **dict.fromkeys(("hollow", "shell"), ("wall",)),
    **dict.fromkeys(("support", "clamp"), ("fixed", "ends")),
    **dict.fromkeys(("range", "frequencies", "max-frequency"), ("band",)),
    **dict.fromkeys(("count", "number", "n"), ("modes",)),
    **dict.fromkeys(("solver",), ("method", "backend", "engine")),
    **dict.fromkeys(("dimension", "parameter"), ("vary",)),
    **dict.fromkeys(("samplerate", "sample-rate"), ("rate", "sample_rate")),
    **dict.fromkeys(("duration", "length", "len", "time", "secs", "long"), ("seconds", "size")),
    **dict.fromkeys(("strikes", "hits", "actions"), ("excitations",)),
    **dict.fromkeys(("sr", "fs", "rate", "samplerate"), ("sample_rate", "rate")),
    **dict.fromkeys(("pan", "microphone", "mic", "observer"), ("listener",)),
    **dict.fromkeys(("frequency", "pitch", "f0", "note", "tone"), ("lowest",)),
    **dict.fromkeys(("thickness", "thick"), ("wall",)),
    **dict.fromkeys(("scale", "unit"), ("units", "size")),
    **dict.fromkeys(("e", "young", "youngs"), ("youngs_modulus",)),
    **dict.fromkeys(("nu", "poisson"), ("poisson_ratio",)),
    **dict.fromkeys(("rho",), ("density",)),
    **dict.fromkeys(("alpha1", "alpha_1", "beta"), ("stiffness",)),  # of O'Brien et al. 2002
    **dict.fromkeys(("alpha2", "alpha_2", "alpha"), ("mass",)),
    **dict.fromkeys(("tan_phi", "tanphi", "phi", "eta", "loss_factor"), ("loss_tangent",)),
    **dict.fromkeys(("lam", "lambda", "lambda_"), ("first",)),
    **dict.fromkeys(("bodya", "body_a", "object0", "geom1"), ("body0",)),
    **dict.fromkeys(("bodyb", "body_b", "object1", "geom2"), ("body1",)),
    **dict.fromkeys(("fixed", "held", "built-in"), ("clamped",)),
    **dict.fromkeys(("pinned", "simply-supported"), ("hinged", "supported")),
    **dict.fromkeys(("out", "output_file", "file", "wav"), ("output", "path")),
}


_RATIO_MARGIN = 0.1  # of difflib's ratio: a name less similar than the best by more is not meant


def nearest(name: str, known: Iterable[str], form: str = "{}", *, spelling: bool = True) -> str:
    """Return "did you mean ...? " with the known names nearest to a name, or "" if none is near.

    Nearest by meaning, and otherwise by `spelling`.
    """
    names = list(known)
    plain = name.strip().lower()
    similar_names = difflib.get_close_matches(plain, [*names, *_SYNONYMS], n=1, cutoff=0.85)
    term = similar_names[0] if similar_names and similar_names[0] not in names else plain
    matches = [item for item in _SYNONYMS.get(term, ()) if item in names][:1]
    if plain.isdigit():  # a number that is near another one is not meant for it
        return ""
    parts = re.split(r"[^\w-]+", plain)  # of "clamped/free" or "floor=wood"
    if len(parts) > 1:
        matches = matches or [item for item in names if item in parts][:3]
    cutoff = 0.55 if spelling else 0.85  # then only of a slip of the fingers
    matches = matches or _find_similar_names(plain, names, cutoff)
    return f"did you mean {' or '.join(map(form.format, matches))}? " if matches else ""


def _find_similar_names(name: str, names: Sequence[str], cutoff: float) -> list[str]:
    """Return up to three of `names`: the most similar one, and others nearly as similar."""
    ratios = {item: difflib.SequenceMatcher(b=name, a=item).ratio() for item in names}
    close_names = difflib.get_close_matches(name, names, n=3, cutoff=cutoff)
    return [item for item in close_names if ratios[item] > ratios[close_names[0]] - _RATIO_MARGIN]


def require_choice(
    name: str,
    value: object,
    known: Iterable[str],
    error: Callable[[str], Exception] = OptionError,
    *,
    more: str = "",
) -> None:
    """Require one of the known names; the message offers the nearest, and then `more`."""
    names = tuple(known)
    if value not in names:
        suggestion = f"{nearest(str(value), names)}give one of {', '.join(names)}"
        raise error(f"{name} is {value!r}: {suggestion}{more}")


def counted(count: SupportsIndex, noun: str) -> str:
    """Return a count with its noun: "1 face", "2 faces", "3 vertices"."""
    plural = {"vertex": "vertices", "body": "bodies", "entry": "entries", "patch": "patches"}
    adjective, space, last = noun.rpartition(" ")
    return f"{count} {adjective}{space}{last if count == 1 else plural.get(last, f'{last}s')}"


def rounded(value: SupportsFloat, digits: int = 6, *, sign: bool = False) -> str:
    """Return a number for people: significant digits, and powers of ten only where it needs them.

    From 0.0001 to below a million it has none, so that 172.4 to two digits is "170"; beyond it is
    written as "7.2e10" or "2.1e-9".
    """
    plus, number = "+" if sign else "", float(f"{float(value):.{digits}g}")
    if not math.isfinite(number) or number == 0:
        return f"{abs(number) if number == 0 else number:{plus}g}"
    power = math.floor(math.log10(abs(number)))
    if -4 <= power < 6:
        text = f"{number:{plus}.{max(0, digits - 1 - power)}f}"
        return text.rstrip("0").rstrip(".") if "." in text else text
    mantissa, _, exponent = f"{number:{plus}.{digits - 1}e}".partition("e")
    mantissa = mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa
    return f"{mantissa}e{int(exponent)}"


def kind_of(body: object) -> str:
    """Return the name of a body's class, or of the class of that name, as "a polygon membrane"."""
    name = body if isinstance(body, str) else type(body).__name__
    return article(re.sub("(?<=[a-z])(?=[A-Z])", " ", name).lower())


def printable(text: str) -> str:
    """Return a text as one line that can be printed: control characters are escaped.

    A name of a file, or in one, could otherwise colour a terminal, turn the direction of the text
    or forge a line. Bytes of a name that are no text, and separators of lines, are escaped too.
    """
    return text if text.isprintable() else "".join(map(_escaped, text))


def _escaped(letter: str) -> str:
    if "\udc80" <= letter <= "\udcff":  # a byte of a name that Python could not decode
        return f"\\x{ord(letter) - 0xDC00:02x}"
    controls = {"Cc", "Cf", "Cs", "Zl", "Zp"}
    if unicodedata.category(letter) in controls:
        return letter.encode("unicode_escape").decode("ascii")
    return letter


def article(noun: str) -> str:
    """Return a noun with its article: "a WAV", "an OGG", "an MP3"."""
    return f"a{'n' if noun[:1] in {*'AEIOaeio'} or noun[:2] == 'MP' else ''} {noun}"
