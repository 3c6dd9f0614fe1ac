"""Exceptions for errors that the user can correct, each also a ValueError or an OSError.

The message is one line that says what is wrong, where, and what to do. The command line prints it and exits with status 2. Every other
exception is a defect of the program, and the command line shows its traceback.
"""


class UserError(Exception):
    """Base class of the errors that the user can correct; only its subclasses are raised."""


class InputError(UserError, ValueError):
    """Raised if a value, the content of a file, or a combination of values cannot be used."""


class ConfigError(InputError):
    """Raised for a wrong configuration key, option, type or combination of options."""


class MeshError(InputError):
    """Raised for a mesh that cannot be used, for example because it has NaN coordinates, is empty or is in wrong units."""


class ScanError(MeshError):
    """Raised if a scan file or folder cannot be converted to a scene."""


class SceneError(InputError):
    """Raised for a scene that cannot be simulated, for example without material labels or with the sensor inside a solid."""


class LayoutError(InputError):
    """Raised if a furniture layout file cannot be read, or if an object cannot stand at its position in the room."""


class MaterialError(InputError):
    """Raised for an unknown material, or for a frequency outside the range of the material's data."""


class LabelError(InputError):
    """Raised if the answers about the materials of surfaces cannot be used, or if a surface has no answer."""


class PoseError(InputError):
    """Raised for poses that are not rigid, not finite or not of the same number of frames."""


class RecordingError(InputError):
    """Raised for a recording or radar file whose parts do not fit together."""


class MissingError(UserError, FileNotFoundError):
    """Raised if a file, a folder or a stored result is absent."""


class OutputError(UserError, OSError):
    """Raised if a file or folder cannot be written."""


class BackendError(UserError, OSError):
    """Raised if a compiler, library or device that the simulation needs cannot be used."""


class CrashError(BackendError):
    """Raised if a worker process dies or runs out of memory. The run has failed, but the user's input is not wrong."""
