"""Errors that the user can correct.

Each is a ValueError or an OSError. Its message is one line: what is wrong, where, and what to do. The command line prints that line and
exits with status 2; every other exception is a defect and keeps its traceback.
"""


class UserError(Exception):
    """Base class of the errors that the user can correct. It is never raised itself."""


class InputError(UserError, ValueError):
    """A value, file content or combination that cannot be used."""


class ConfigError(InputError):
    """A wrong configuration key, option, type or combination."""


class MeshError(InputError):
    """Geometry that cannot be used, for example because it has NaN, is empty or is in wrong units."""


class ScanError(MeshError):
    """A scan file or folder that cannot become a scene."""


class SceneError(InputError):
    """A scene that cannot be simulated, for example without labels or with the sensor inside a solid."""


class LayoutError(InputError):
    """A layout that cannot be read, or an object that cannot stand at its place."""


class MaterialError(InputError):
    """An unknown material, or a frequency outside the range of its data."""


class LabelError(InputError):
    """Unusable answers about materials, or surfaces without an answer."""


class PoseError(InputError):
    """Poses that are not rigid, not finite or of different lengths."""


class RecordingError(InputError):
    """A recording or radar file whose parts do not fit together."""


class MissingError(UserError, FileNotFoundError):
    """An absent file, folder or product."""


class OutputError(UserError, OSError):
    """A path that cannot be written."""


class BackendError(UserError, OSError):
    """A compiler, library or device that the simulation needs and cannot use."""
