"""What can go wrong. The text of each says what, where, and what to do; it is that of the program."""


class QuadrilleError(Exception):
    """Any error of quadrille."""


class ImageError(QuadrilleError, ValueError):
    """A file that is no image, an array that is none, another size than the reference, no contrast."""


class OptionError(QuadrilleError, ValueError):
    """An option, or options that contradict each other."""


class ZoneError(QuadrilleError, ValueError):
    """A zone, mask, crack or mesh that does not fit the reference."""


class TextureError(QuadrilleError, ValueError):
    """Nodes of the reference that see too little texture."""


class CaseError(QuadrilleError, ValueError):
    """A case file, or a table that it names."""


class DeviceError(QuadrilleError, RuntimeError):
    """A device that is not there, or fails."""


class FolderError(QuadrilleError, OSError):
    """A folder of results: another run's, in use, not to be written."""


class StoreError(QuadrilleError, OSError):
    """A store of fields that cannot be read."""


class ModelError(QuadrilleError, ValueError):
    """A joint that cannot be computed."""


class FitError(QuadrilleError, ValueError):
    """A fit that cannot be begun."""
