"""The camera, and places in the plane of the specimen."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import _quadrille
from ._values import plain_value
from ._errors import OptionError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray


def _points(values: ArrayLike, what: str) -> tuple[NDArray[np.float64], tuple[int, ...]]:
    """``values`` as rows of two numbers, and their own shape."""
    import numpy as np

    try:
        array = np.asarray(values, np.float64)
    except (TypeError, ValueError) as error:
        raise OptionError(f"{what} are no numbers: {error}") from None
    if array.ndim == 0 or array.shape[-1] != 2:
        raise OptionError(f"{what} have the shape {array.shape}; give x and y along the last axis")
    return np.ascontiguousarray(array.reshape(-1, 2)), array.shape


class Camera:
    """How a camera sees the plane of the specimen: lens, tilt and scale, with what is unknown of them.

    Places in mm have y up, as everything in mm; the origin is what is seen at pixel (0, 0) of a camera without distortion.

    >>> camera = Camera(image_size_px=[1024, 768], distortion=[0.01], distortion_std=[1e-3], pixel_size_mm=0.05)
    >>> camera.to_mm([1023.0, 767.0]).round(2).tolist()
    [50.9, -38.16]
    >>> camera.sigma_mm([1023.0, 767.0]).round(3).tolist()
    [0.024, 0.018]
    """

    def __init__(self, **keys: Any) -> None:
        """A camera by the keys of ``[camera]`` in a case file: image_size_px, focal_px, centre_px, distortion=[k1, k2, p1, p2, k3],
        tilt_per_px, stretch, distortion_std, covariance_of, covariance, pixel_size_mm, pixel_size_relative_std, exact, ...

        Raises CaseError for numbers that are no camera, OptionError without image_size_px.
        """
        self._engine = _quadrille.Camera(json.dumps({"camera": plain_value(keys, "camera")}))

    @classmethod
    def read(cls, path: str | os.PathLike[str], image_size_px: tuple[int, int] | None = None) -> Camera:
        """The camera of ``camera.toml``, or of a result of OpenCV (YAML, JSON).

        image_size_px: columns and rows of the images, where the file does not say them.

        Raises CaseError, and OptionError where the size is missing.
        """
        camera = cls.__new__(cls)
        camera._engine = _quadrille.Camera.read(path, image_size_px)
        return camera

    def write(self, path: str | os.PathLike[str]) -> None:
        """Writes ``camera.toml``, which :meth:`read` and ``quadrille correlate --camera`` read. Raises OSError."""
        Path(path).write_text(self._engine.text(), encoding="utf-8")

    @property
    def keys(self) -> dict[str, Any]:
        """Its numbers by the keys of ``[camera]``, None where one is not stated."""
        return self._engine.keys()

    def to_mm(self, px: ArrayLike) -> NDArray[np.float64]:
        """Where in the plane is seen what is at these pixels, (..., 2), mm; NaN where nothing is. Raises OptionError without a scale."""
        points, shape = _points(px, "px")
        return self._engine.to_mm(points).reshape(shape)

    def to_px(self, mm: ArrayLike) -> NDArray[np.float64]:
        """At which pixels, (..., 2), these places of the plane are seen. Raises OptionError without a scale."""
        points, shape = _points(mm, "mm")
        return self._engine.to_px(points).reshape(shape)

    def terms_mm(self, px: ArrayLike) -> NDArray[np.float64]:
        """By how much each place in mm is off, (k, ..., 2), when the camera is off by one standard uncertainty in each of k
        independent ways; the last is the size of a pixel. Common to all places: the terms of a difference are the differences of the
        terms, and its variance is the sum of their squares."""
        points, shape = _points(px, "px")
        terms = self._engine.terms_mm(points)
        return terms.reshape(len(terms), *shape)

    def sigma_mm(self, px: ArrayLike) -> NDArray[np.float64]:
        """Standard uncertainty of :meth:`to_mm` by what is unknown of the camera, (..., 2), mm."""
        import numpy as np

        sigma: NDArray[np.float64] = np.sqrt((self.terms_mm(px) ** 2).sum(axis=0))
        return sigma

    def displacement_mm(
        self, px: ArrayLike, displacement_px: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The displacement in the plane, (..., 2), mm, y up, of what moved by ``displacement_px`` from ``px`` in the image, as
        :attr:`Field.positions` and :attr:`Field.displacement` are; and its standard uncertainty by what is unknown of the
        camera and of its distance. Noise, :attr:`Field.sigma`, comes to it in squares."""
        import numpy as np

        start, shape = _points(px, "px")
        moved, other = _points(displacement_px, "displacement_px")
        if shape != other:
            raise OptionError(f"px have the shape {shape}, displacement_px {other}; give one for each place")
        end = start + moved
        terms = self._engine.terms_mm(end) - self._engine.terms_mm(start)
        displacement = self._engine.to_mm(end) - self._engine.to_mm(start)
        variance = (terms**2).sum(axis=0) + self._engine.distance_mm(end) ** 2
        return displacement.reshape(shape), np.sqrt(variance).reshape(shape)

    def __repr__(self) -> str:
        keys = self.keys
        columns, rows = keys["image_size_px"]
        return f"<quadrille.Camera: {columns} x {rows} px, distortion {keys['distortion']}, {keys['pixel_size_mm']} mm per px>"
