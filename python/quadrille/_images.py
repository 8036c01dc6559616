"""Images from files."""

from __future__ import annotations

import os
import warnings
from typing import TYPE_CHECKING, Any, TypeAlias

from ._quadrille import read_image as _read_image

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    Image: TypeAlias = "ArrayLike | str | os.PathLike[str]"
    GreyLevels: TypeAlias = NDArray[np.uint8] | NDArray[np.uint16] | NDArray[np.float32]


def read_image(path: str | os.PathLike[str], page: int = 0) -> GreyLevels:
    """The grey levels of the image file ``path``, in its own depth: an array of uint8, uint16 or float32, rows by columns.

    Reads TIFF (any usual depth and compression; page ``page`` of several), PNG, BMP, JPEG and PGM. Remarks on the
    file, such as colours that were made grey, are warnings.

    Raises ImageError when the file cannot be read as an image.
    """
    array: GreyLevels
    array, notes = _read_image(path, page)
    for note in notes:
        warnings.warn(f"{os.fspath(path)}: {note}", stacklevel=2)
    return array


def as_background(image: Any) -> Any:
    """An image as an array, to draw on."""
    import numpy as np

    if isinstance(image, (str, os.PathLike)):
        return _read_image(image, 0)[0]
    return np.squeeze(np.asarray(image))
