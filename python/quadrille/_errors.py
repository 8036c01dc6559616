"""Exceptions. Their messages are those of the program: what is wrong, where, and what to do."""


class QuadrilleError(Exception):
    """Any error of quadrille."""


class ImageError(QuadrilleError, ValueError):
    """A file or array that is not an image, has another size than the reference, or has no contrast."""


class OptionError(QuadrilleError, ValueError):
    """An option, or options that contradict each other."""


class ZoneError(QuadrilleError, ValueError):
    """A zone, mask, crack or mesh that does not fit the reference."""


class TextureError(QuadrilleError, ValueError):
    """Nodes of the reference that see too little texture."""


class CaseError(QuadrilleError, ValueError):
    """A case file, or a table that it names."""


class DeviceError(QuadrilleError, RuntimeError):
    """A device that does not exist, or fails."""


class FolderError(QuadrilleError, OSError):
    """A folder of results that belongs to another run, is in use, or cannot be written."""


class StoreError(QuadrilleError, OSError):
    """A store of fields that cannot be read."""


class CalibrationError(QuadrilleError, ValueError):
    """Images that do not determine a camera."""


class ModelError(QuadrilleError, ValueError):
    """A joint that cannot be computed."""


class FitError(QuadrilleError, ValueError):
    """A fit that cannot be started."""
