"""Everything that can go wrong, in one tree.

StruckError
├── OptionError               an argument outside its bound
├── MeshError                 a body whose geometry cannot ring as it stands
├── MaterialError             an unknown or impossible material or damping
├── ContactError              a contact off the body, or a listener inside it
├── SolverError               modes that could not be computed or certified
├── RecordingError            a recording from which no model can be had as it stands
├── FileFormatError           a file that is not what it says, or cannot be read
├── SimulationError           a rigid-body simulation that fails or explodes
├── DeviceError               an audio device that is missing or refuses
└── MissingDependencyError    an optional package that is not installed

Each message holds the value, the bound and the way out.
"""


class StruckError(Exception):
    """Base of all errors that struck raises on purpose."""


class OptionError(StruckError, ValueError):
    """An argument outside its bound."""


class ArgumentError(OptionError, TypeError):
    """An argument of a wrong type."""


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
    """A file that is not what it says, or cannot be read or written."""


class SimulationError(StruckError, RuntimeError):
    """A rigid-body simulation that fails or explodes."""


class DeviceError(StruckError, OSError):
    """An audio device that is missing or refuses to play."""


class MissingDependencyError(StruckError, ImportError):
    """An optional package that is not installed."""


class CacheWarning(UserWarning):
    """Something could not be kept, or was damaged; what was asked for is computed."""


class CoreWarning(UserWarning):
    """The compiled core cannot be used: everything is computed, but slowly."""


class LossWarning(UserWarning):
    """A file was written that cannot keep all of a model: what it leaves out."""


class ScaleWarning(UserWarning):
    """Lengths may not be in metres, or a modulus not in Pa: the unit that may be meant."""


class RepairWarning(UserWarning):
    """A surface was repaired: what was wrong with it, and what was changed."""
