"""Images in memory."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias, cast

from . import _quadrille
from ._errors import OptionError
from ._field import Field
from ._values import plain_value

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    from ._camera import Camera
    from ._images import Image

    Zone: TypeAlias = Sequence[float] | Sequence[Sequence[float]] | Mapping[str, Any]


def zone_list(zones: Any) -> list[dict[str, Any]]:
    """Zones as a case file has them: of one or several rectangles, polygons, mappings."""
    if zones is None:
        return []
    plain = plain_value(zones, "zones")
    if isinstance(plain, dict):
        return [plain]
    if not isinstance(plain, list) or not plain:
        raise OptionError("zones is no zone; give [x0, y0, x1, y1], [[x, y], ...], a mapping with the keys of [[zone]], or a list of them")
    if all(isinstance(item, (int, float)) for item in plain):
        return [{"roi": plain}]
    if all(isinstance(item, list) and len(item) == 2 and all(isinstance(v, (int, float)) for v in item) for item in plain):
        return [{"polygon": plain}]
    return [zone for item in plain for zone in zone_list(item)]


def case_text(
    options: Mapping[str, Any], zones: Any = None, cracks: Any = None, case: Mapping[str, Any] | None = None
) -> str:
    """The sections of a case file, as JSON: those of ``case`` with the options and zones over them."""
    sections = plain_value(case or {}, "case")
    correlation = {**sections.get("correlation", {}), **plain_value(options, "options")}
    if correlation:
        sections["correlation"] = correlation
    if zones is not None:
        sections["zone"] = zone_list(zones)
    if cracks is not None:
        plain = plain_value(cracks, "cracks")
        sections["crack"] = [{"path": crack} if isinstance(crack, list) else crack for crack in plain]
    return json.dumps(sections)


class Correlator:
    """A reference image, prepared: meshes, factors, uncertainty. Any number of images can be correlated with it, from several threads.

    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> image = np.kron(rng.integers(0, 255, (24, 32)), np.ones((4, 4))).astype(np.uint8)
    >>> correlator = Correlator(image, [16, 16, 112, 80], device="cpu")
    >>> field = correlator.correlate(np.roll(image, 1, axis=1))
    >>> field.status, bool(np.abs(field.displacement - [1, 0]).max() < 0.01)
    ('converged', True)
    """

    def __init__(
        self,
        reference: Image,
        zones: Zone | Sequence[Zone] | None = None,
        *,
        mask: ArrayLike | None = None,
        cracks: Sequence[Any] | None = None,
        device: str = "auto",
        isa: str | None = None,
        threads: int | None = None,
        camera: Camera | str | os.PathLike[str] | None = None,
        **options: Any,
    ) -> None:
        """Prepares ``reference``.

        reference: uint8, uint16 or float32 (float64 is rounded), rows by columns, any strides; or the name of a file.
        zones: where to measure, px: a rectangle ``[x0, y0, x1, y1]``, a polygon ``[[x, y], ...]``, a mapping with the keys of
            ``[[zone]]`` in a case file (name, roi, polygon, exclude, mask, mesh, guard_px, ...), or a list of these. Without it the
            specimen is found in the reference, and a warning says what was left out.
        mask: bool, of the shape of the reference: where to measure, for all zones.
        cracks: paths ``[[x, y], ...]``, px, along which the mesh is cut, or mappings with the keys of ``[[crack]]``.
        device: auto, cpu, gpu, or a part of the name of one.
        isa: instruction path of the CPU (avx512, avx2, baseline, scalar).
        threads: number of own threads; without it all correlators share one thread per core. Results do not depend on it.
        camera: how it sees the plane of the specimen, of which strains then are: a :class:`Camera`, or the name of its file. Places and
            displacements stay those of the image; :meth:`Camera.displacement_mm` maps them.
        options: the keys of ``[correlation]`` in a case file: element_size_px=16, interpolation="quintic", brightness="auto",
            start="previous", noise, regularisation, cutoff_px, strain="green-lagrange", strain_window, drop_textureless, ...

        Raises ImageError, OptionError, ZoneError, TextureError, DeviceError.
        """
        section = None if camera is None else {"file": os.fspath(camera)} if isinstance(camera, (str, os.PathLike)) else camera.keys
        text = case_text(options, zones, cracks, {"camera": section})
        self._engine = _quadrille.Correlator(reference, text, mask, device, isa, threads)
        for remark in self.remarks:
            if remark["code"] == "zones-found" or remark["severity"] == "warning":
                warnings.warn(remark["text"], stacklevel=2)

    @cached_property
    def positions(self) -> NDArray[np.float64]:
        """Places of the nodes, (n, 2), px."""
        return self._engine.positions()

    @cached_property
    def elements(self) -> NDArray[np.uint32]:
        """Nodes of each element, (m, 4), around it; of a triangle the last twice."""
        return self._engine.elements()

    @cached_property
    def node_zone(self) -> NDArray[np.uint32]:
        """Number of the zone of each node, (n,), into :attr:`zones`."""
        return self._engine.node_zone()

    @property
    def zones(self) -> list[str]:
        """Names of the zones."""
        return self._engine.zones()

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the images, px."""
        return self._engine.shape()

    @property
    def device(self) -> str:
        """The device that does the work."""
        return self._engine.device()

    @property
    def remarks(self) -> list[dict[str, Any]]:
        """What there is to say of zones, masks and device: dicts with code, severity, about, values and text."""
        return self._engine.remarks()

    def correlate(self, image: Image) -> Field:
        """Finds the displacement field of ``image``, without any knowledge of the motion.

        An array in C order is not copied: do not let another thread write to it during the call.

        Not converging is not an error: see :attr:`Field.status`. Raises ImageError (another size, no contrast, NaN) and DeviceError.
        """
        return self._field(self._engine.correlate(image))

    def _field(self, found: dict[str, Any]) -> Field:
        measured, engine = found.pop("measured_field"), self._engine
        return Field(
            _quantities=lambda case: engine.quantities(measured, case),
            positions=self.positions,
            elements=self.elements,
            node_zone=self.node_zone,
            strain_definition=self._engine.strain(),
            **cast(Any, found),
        )

    def __repr__(self) -> str:
        rows, columns = self.shape
        return f"<quadrille.Correlator: {columns} x {rows} px, {len(self.positions)} nodes, {self.device}>"


class Tracker:
    """Images of a series, one after the other: each is predicted from those before, as ``quadrille correlate`` does."""

    def __init__(self, correlator: Correlator) -> None:
        """Begins a series on a prepared reference."""
        self.correlator = correlator
        self._engine = _quadrille.Tracker(correlator._engine)

    def correlate(self, image: Image, number: int | None = None) -> Field:
        """Finds the next image, or that of frame ``number``; numbers must rise, and count from 1.

        Raises as :meth:`Correlator.correlate`, and OptionError for a number that does not rise.
        """
        return self.correlator._field(self._engine.correlate(image, number))
