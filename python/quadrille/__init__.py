"""Global Q4 digital image correlation, and cohesive laws from the fields that it measures.

Two images::

    import quadrille
    correlator = quadrille.Correlator("ref.tif")
    field = correlator.correlate("deformed.tif")

Images are arrays of ``uint8``, ``uint16`` or ``float32`` with the axes rows, columns (any strides), or names of files. Places
and displacements are in px of the reference image, x to the right, y down, with the origin at the centre of the top-left pixel;
grey levels are those of the images; strains have no unit. What was not measured is NaN.

Whole runs into a folder, to the same bits as the program ``quadrille``: :func:`run`, :func:`identify`, :func:`simulate`,
:func:`reduce`, :func:`tournament`, :func:`virtual_test`, :func:`calibrate`; :func:`command` for the rest of the program. On
images alone: :func:`metrology`. Every error is a :class:`QuadrilleError`. ``MARKS`` are the names of :attr:`Field.marks`, an ``Event`` is what
happens in a run, ``__version__`` is that of the program, too.
"""

from ._camera import Camera
from ._correlator import Correlator, Tracker
from ._errors import (
    CalibrationError,
    CaseError,
    DeviceError,
    FitError,
    FolderError,
    ImageError,
    ModelError,
    OptionError,
    QuadrilleError,
    StoreError,
    TextureError,
    ZoneError,
)
from ._field import MARKS, Field
from ._images import read_image
from ._progress import Progress
from ._quadrille import VERSION as __version__
from ._runs import (
    Calibration,
    Event,
    Result,
    calibrate,
    command,
    devices,
    identify,
    metrology,
    open_store,
    reduce,
    run,
    simulate,
    to_xarray,
    tournament,
    virtual_test,
)

__all__ = [
    "MARKS",
    "Calibration",
    "CalibrationError",
    "Camera",
    "CaseError",
    "Correlator",
    "DeviceError",
    "Event",
    "Field",
    "FitError",
    "FolderError",
    "ImageError",
    "ModelError",
    "OptionError",
    "Progress",
    "QuadrilleError",
    "Result",
    "StoreError",
    "TextureError",
    "Tracker",
    "ZoneError",
    "__version__",
    "calibrate",
    "command",
    "devices",
    "identify",
    "metrology",
    "open_store",
    "read_image",
    "reduce",
    "run",
    "simulate",
    "to_xarray",
    "tournament",
    "virtual_test",
]
