"""What a user can get wrong, each with what to do about it.

Every error here is a ValueError or an OSError, and its message is one line that names what is wrong, where, and the
remedy. The command line turns them into that line and exit status 2; anything else is a defect and keeps its traceback.
"""


class UserError(Exception):
    """Marks what the user can mend. Never raised by itself."""


class InputError(UserError, ValueError):
    """A value, file content or combination that cannot be used."""


class ConfigError(InputError):
    """A configuration key, option, type or combination."""


class MeshError(InputError):
    """Geometry: NaN, empty, wrong units."""


class ScanError(MeshError):
    """A scan file or folder that cannot become a scene."""


class SceneError(InputError):
    """A scene that cannot be simulated: unlabelled, sensor inside a solid, unknown surface."""


class LayoutError(InputError):
    """A layout that cannot be read, or an object that cannot stand where it is put."""


class MaterialError(InputError):
    """An unknown material, or one outside the range its values were fitted in."""


class LabelError(InputError):
    """Answers about materials that cannot be used, or surfaces nobody answered."""


class PoseError(InputError):
    """Poses or motion that are not rigid, not finite or not of one length."""


class RecordingError(InputError):
    """A recording or radar file whose parts do not fit together."""


class MissingError(UserError, FileNotFoundError):
    """A file, folder or product that is not there."""


class OutputError(UserError, OSError):
    """A place that cannot be written."""


class BackendError(UserError, OSError):
    """A compiler, library or device the simulation needs and cannot use."""
