"""The field of one image."""

from __future__ import annotations

import base64
import csv
import html
import io
import json
import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

from ._errors import QuadrilleError
from ._values import plain_value

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy as np
    import pandas
    import pyvista
    import xarray
    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike, NDArray

    from ._images import Image

#: What is the matter with an element, by the code in :attr:`Field.marks`.
MARKS = ("none", "misfit", "still", "no_texture", "left_image", "saturated", "no_match")

_STRAINS = ("exx", "eyy", "exy")


def columns_of(text: str) -> dict[str, Any]:
    """A table of CSV: a list of texts, or an array, for each column."""
    import numpy as np

    rows = list(csv.reader(line for line in text.splitlines() if not line.startswith("#")))
    names = {"status", "point", "line", "extensometer", "region", "opening", "crack", "mark", "end", "state", "zone"}
    columns: dict[str, Any] = {}
    for at, name in enumerate(rows[0]):
        cells = [row[at] for row in rows[1:]]
        columns[name] = cells if name in names else np.array([float(cell) if cell else math.nan for cell in cells])
    return columns


def html_of(rows: dict[str, str], picture: bytes | None = None) -> str:
    """What a notebook shows: a table of two columns, and a picture (PNG)."""
    left = "style='text-align:left'"
    cells = "".join(f"<tr><th {left}>{html.escape(name)}</th><td {left}>{html.escape(text)}</td></tr>" for name, text in rows.items())
    shown = "" if picture is None else f"<img alt='' src='data:image/png;base64,{base64.b64encode(picture).decode()}'>"
    return f"<table>{cells}</table>{shown}"


def _numbers(columns: dict[str, Any]) -> dict[str, float]:
    """The numbers of a table with one row."""
    return {name: float(values[0]) for name, values in columns.items() if not isinstance(values, list)}


@dataclass(frozen=True, eq=False, repr=False, slots=True, kw_only=True)
class Field:
    """What was measured on one image, on n nodes and m elements. Lengths are px of the reference image, x right, y down.

    status: ``converged``, ``iteration_limit``, ``diverged``, ``left_image``, ``ambiguous`` or ``partly_lost``.
    positions: Places of the nodes in the reference image, (n, 2), px.
    elements: Nodes of each element, (m, 4); of a triangle the last twice.
    node_zone: Number of the zone of each node, (n,).
    displacement: Displacement of the nodes, (n, 2), px; NaN where not measured. These are the coefficients of the fitted field; for the
        displacement at a point read :attr:`displacement_point`.
    sigma: Its standard uncertainty, (n, 2), px.
    strain: exx, eyy, exy (tensor shear) at the nodes, (n, 3), over two elements; no unit.
    element_strain: The same at the centres of the elements, (m, 3).
    strain_definition: How strains are defined: ``green-lagrange``, ``hencky`` or ``infinitesimal``.
    residual: Root mean square of the residual in each element, (m,), grey levels.
    measured: Whether a node was measured, (n,).
    marks: Fault of each element, (m,), numbers in :data:`MARKS`.
    iterations: Iterations on the image itself.
    correction_px: Largest correction of the last iteration, px.
    residual_grey: Root mean square of the residual, grey levels.
    residual_percent: The same in per cent of the range of the reference.
    ambiguity: By what the displacement may be off, where the texture repeats.
    zones: Zone by zone: name, correlation coefficient, residual_grey, noise_grey, gain.
    model_error: Estimated error of the displacement beyond noise, (n, 2), px.
    misfit: Displacement that is not followed in an element, (m,), px; 0 where the residual is noise.
    displacement_point: Displacement at the nodes as values at points, (n, 2), px; NaN where not measured. None of a frame without a
        field.
    sigma_point: Its standard uncertainty, (n, 2), px.
    is_point_value: Whether it is a value, (n,); where not, it is the coefficient as it stands: too few nodes near, or a regularised
        field.
    window_strain: Strains over a window of nodes, (n, 3), where ``strain_window`` asks for it.
    window_strain_sigma: Their standard uncertainty, (n, 3).
    window_strain_model_error: What they may be off at the node beyond noise, (n, 3): the window flattens. To be added to the sigma in
        squares.
    interpolation_bias_px: Bias of the interpolation along x and y, (2,), root mean square over the nodes, px: the part of the model
        error that is alike at all nodes that move by the same fraction of a pixel, and does not average out.
    remarks: What there is to say of the frame, as summary.json has it: dicts with code, severity, about, values and text.
    """

    status: str
    positions: NDArray[np.float64]
    elements: NDArray[np.uint32]
    node_zone: NDArray[np.uint32]
    displacement: NDArray[np.float64]
    sigma: NDArray[np.float64]
    strain: NDArray[np.float64]
    element_strain: NDArray[np.float64]
    strain_definition: str
    residual: NDArray[np.float64]
    measured: NDArray[np.bool_]
    marks: NDArray[np.uint8]
    iterations: int
    correction_px: float
    residual_grey: float
    residual_percent: float
    ambiguity: str | None
    zones: list[dict[str, Any]]
    model_error: NDArray[np.float64] | None = None
    misfit: NDArray[np.float64] | None = None
    displacement_point: NDArray[np.float64] | None = None
    sigma_point: NDArray[np.float64] | None = None
    is_point_value: NDArray[np.bool_] | None = None
    window_strain: NDArray[np.float64] | None = None
    window_strain_sigma: NDArray[np.float64] | None = None
    window_strain_model_error: NDArray[np.float64] | None = None
    interpolation_bias_px: NDArray[np.float64] | None = None
    remarks: Sequence[dict[str, Any]] = ()
    _quantities: Callable[[str], dict[str, str]] | None = None

    def __getstate__(self) -> list[Any]:
        # What measured it stays behind when a field is copied to another process.
        return [None if own.name == "_quantities" else getattr(self, own.name) for own in fields(self)]

    def probe(self, **sections: Any) -> dict[str, dict[str, Any]]:
        """The tables of ``quadrille probe`` for this field: by their names, a dict with a column for each name. Numbers are arrays, NaN
        where there is none; texts are lists. ``pandas.DataFrame(field.probe(...)["points"])`` is a table.

        sections: of a case file, a mapping or a list of them: probe, line, extensometer, region, opening, crack, quantities.

        Raises OptionError and CaseError for what means nothing, QuadrilleError for a field that was not made by a
        :class:`Correlator` of this process.
        """
        if self._quantities is None:
            raise QuadrilleError("this field was copied without what measured it; correlate again, or use `quadrille probe` on a run")
        lists = {"probe", "line", "extensometer", "region", "opening", "crack"}
        plain = plain_value(sections, "sections")
        case = {key: [value] if key in lists and isinstance(value, dict) else value for key, value in plain.items()}
        tables = {name: columns_of(text) for name, text in self._quantities(json.dumps(case)).items()}
        return {name: {key: of for key, of in table.items() if key not in ("frame", "status")} for name, table in tables.items()}

    def at(self, points: ArrayLike) -> dict[str, Any]:
        """Displacement, strains and what follows from them at ``points``, (n, 2) or (2,), px, each with its standard uncertainty:
        columns ``ux_px``, ``sigma_ux_px``, ``exx``, ``e1`` ... of ``points.csv``. NaN beside the mesh."""
        import numpy as np

        places = np.asarray(points, dtype=float).reshape(-1, 2).tolist()
        return self.probe(probe=[{"point": place} for place in places])["points"]

    def line(self, start: Sequence[float], end: Sequence[float], step_px: float | None = None) -> dict[str, Any]:
        """The same along a line; ``along_px`` counts from ``start``. step_px: a quarter of the element size without."""
        section = {"from": start, "to": end, **({} if step_px is None else {"step_px": step_px})}
        return self.probe(line=section)["lines"]

    def extensometer(self, start: Sequence[float], end: Sequence[float], width_px: float = 0.0) -> dict[str, float]:
        """Elongation and strain between two points, px, or between two gauge lines of ``width_px`` across them: ``elongation_px``,
        ``strain_engineering``, ``strain_true``, and ``sigma_`` of each."""
        section = {"from": start, "to": end, "width_px": width_px}
        return _numbers(self.probe(extensometer=section)["extensometers"])

    def region(self, outline: str | Sequence[Any]) -> dict[str, float]:
        """Means over a region and how it varies: a rectangle ``[x0, y0, x1, y1]``, a polygon ``[[x, y], ...]``, px, or the name of a
        zone. ``measured_percent`` says how much of it has a value."""
        key = "zone" if isinstance(outline, str) else "roi" if len(outline) == 4 and not hasattr(outline[0], "__len__") else "polygon"
        return _numbers(self.probe(region={key: outline})["regions"])

    def opening(self, plus: str, minus: str) -> dict[str, Any]:
        """Opening and sliding between two zones along their facing edges, the upper one first: columns of ``openings.csv``."""
        return self.probe(opening={"zones": [plus, minus]})["openings"]

    def __repr__(self) -> str:
        n, m = len(self.positions), len(self.elements)
        return f"<quadrille.Field: {self.status}, {int(self.measured.sum())} of {n} nodes, {m} elements, residual {self.residual_percent:.2f} %>"

    def _repr_html_(self) -> str:
        rows = {
            "status": self.status,
            "nodes measured": f"{int(self.measured.sum())} of {len(self.positions)}",
            "elements": str(len(self.elements)),
            "residual": f"{self.residual_grey:.3g} grey levels, {self.residual_percent:.2f} %",
            "trust": self.trust,
        }
        if said := [remark["text"] for remark in self.remarks]:
            rows["remarks"] = "; ".join(said)
        return html_of(rows, self._picture())

    def _picture(self) -> bytes | None:
        """A small map of the size of the displacement, PNG; None without matplotlib."""
        try:
            from matplotlib.figure import Figure
        except ImportError:
            return None
        figure = Figure(figsize=(4.0, 3.0), layout="constrained")
        self.plot("u", ax=figure.add_subplot())
        file = io.BytesIO()
        figure.savefig(file, format="png", dpi=80)
        return file.getvalue()

    def values(self, name: str) -> NDArray[np.float64]:
        """Values at the nodes, (n,): ``ux``, ``uy``, ``u`` (size) at points, ``sigma_ux``, ``sigma_uy``, ``exx``, ``eyy``, ``exy``, with
        a strain window ``exx_window`` and so on, ``model_error`` (size); at the elements, (m,): ``residual``, ``misfit``, ``marks``.

        Raises KeyError for another name.
        """
        import numpy as np

        at_points = self.displacement_point if self.displacement_point is not None else self.displacement
        sigma = self.sigma_point if self.sigma_point is not None else self.sigma
        if name in ("ux", "uy"):
            return at_points[:, "xy".index(name[-1])]
        if name == "u":
            return np.hypot(at_points[:, 0], at_points[:, 1])
        if name in ("sigma_ux", "sigma_uy"):
            return sigma[:, "xy".index(name[-1])]
        if name in _STRAINS:
            return self.strain[:, _STRAINS.index(name)]
        if self.window_strain is not None and name.removesuffix("_window") in _STRAINS:
            return self.window_strain[:, _STRAINS.index(name.removesuffix("_window"))]
        if name == "model_error" and self.model_error is not None:
            return np.hypot(self.model_error[:, 0], self.model_error[:, 1])
        if name == "residual":
            return self.residual
        if name == "misfit" and self.misfit is not None:
            return self.misfit
        if name == "marks":
            return self.marks.astype(float)
        raise KeyError(f"{name!r} is no quantity of a field; there are ux, uy, u, sigma_ux, sigma_uy, exx, eyy, exy, model_error, residual, misfit, marks; with a strain window exx_window, eyy_window, exy_window")

    @property
    def trust(self) -> str:
        """How far the displacements of the nodes can be trusted: standard uncertainty and model error, root mean squares over the
        measured nodes, in px. The report says it of the worst frame."""
        import numpy as np

        if not self.measured.any():
            return "no displacement is measured"
        sigma = float(np.sqrt(np.mean(self.sigma[self.measured] ** 2)))
        model = 0.0 if self.model_error is None else float(np.sqrt(np.mean(self.model_error[self.measured] ** 2)))
        return (
            f"displacements of measured nodes are known to about {np.hypot(sigma, model):.2g} px (standard uncertainty {sigma:.2g}, "
            f"model error {model:.2g} px)"
        )

    def to_pandas(self) -> pandas.DataFrame:
        """One row per node, with the columns of ``csv/NNNNNN.csv``: x_px, y_px, ux_px, uy_px, sigma_ux_px, sigma_uy_px, exx, eyy,
        exy, measured, and the displacement at points. Needs pandas (``pip install quadrille[pandas]``)."""
        import pandas

        columns: dict[str, Any] = {
            "x_px": self.positions[:, 0],
            "y_px": self.positions[:, 1],
            "zone": self.node_zone,
            "ux_px": self.displacement[:, 0],
            "uy_px": self.displacement[:, 1],
            "sigma_ux_px": self.sigma[:, 0],
            "sigma_uy_px": self.sigma[:, 1],
            **{name: self.strain[:, at] for at, name in enumerate(_STRAINS)},
            "measured": self.measured,
        }
        if self.displacement_point is not None and self.sigma_point is not None:
            for at, axis in enumerate("xy"):
                columns[f"u{axis}_point_px"] = self.displacement_point[:, at]
                columns[f"sigma_u{axis}_point_px"] = self.sigma_point[:, at]
            columns["is_point_value"] = self.is_point_value
        return pandas.DataFrame(columns)

    def to_xarray(self) -> xarray.Dataset:
        """The field with named dimensions (node, element, corner, component, strain_component) and units. Needs xarray."""
        import xarray

        px, grey = {"units": "px"}, {"units": "grey levels"}
        strain = {"units": "1", "definition": self.strain_definition}
        data: dict[str, Any] = {
            "displacement": (("node", "component"), self.displacement, px),
            "sigma": (("node", "component"), self.sigma, px),
            "strain": (("node", "strain_component"), self.strain, strain),
            "element_strain": (("element", "strain_component"), self.element_strain, strain),
            "residual": (("element",), self.residual, grey),
            "measured": (("node",), self.measured),
            "marks": (("element",), self.marks, {"meanings": " ".join(MARKS)}),
            "elements": (("element", "corner"), self.elements),
        }
        coordinates: dict[str, Any] = {
            "x": (("node",), self.positions[:, 0], px),
            "y": (("node",), self.positions[:, 1], px),
            "zone": (("node",), self.node_zone),
            "component": ["x", "y"],
            "strain_component": list(_STRAINS),
        }
        if self.displacement_point is not None and self.sigma_point is not None:
            data["displacement_point"] = (("node", "component"), self.displacement_point, px)
            data["sigma_point"] = (("node", "component"), self.sigma_point, px)
            data["is_point_value"] = (("node",), self.is_point_value)
        attributes = {"status": self.status, "residual_percent": self.residual_percent, "iterations": self.iterations}
        return xarray.Dataset(data, coordinates, attributes)

    def to_pyvista(self, scale: float = 0.0) -> pyvista.UnstructuredGrid:
        """The mesh with its values, for pyvista; moved by ``scale`` times the displacement. y points down, as in the image."""
        import numpy as np
        import pyvista

        triangle = self.elements[:, 2] == self.elements[:, 3]
        cells = np.concatenate([
            np.r_[3, corners[:3]] if is_triangle else np.r_[4, corners]
            for corners, is_triangle in zip(self.elements.astype(np.int64), triangle, strict=True)
        ])
        kinds = np.where(triangle, 5, 9).astype(np.uint8)
        moved = self.positions + scale * np.nan_to_num(self.displacement)
        grid = pyvista.UnstructuredGrid(cells, kinds, np.c_[moved, np.zeros(len(moved))])
        grid.point_data["displacement"] = np.c_[self.displacement, np.zeros(len(moved))]
        grid.point_data["sigma"] = self.sigma
        if self.displacement_point is not None:
            grid.point_data["displacement_point"] = np.c_[self.displacement_point, np.zeros(len(moved))]
            grid.point_data["sigma_point"] = self.sigma_point
        grid.point_data["strain"] = self.strain
        grid.cell_data["residual"] = self.residual
        grid.cell_data["marks"] = self.marks
        return grid

    def plot(
        self, quantity: str = "u", image: Image | None = None, ax: Axes | None = None, *, cmap: str = "viridis", alpha: float = 0.8,
        limits: tuple[float, float] | None = None,
    ) -> Axes:
        """A map of ``quantity`` (see :meth:`values`) over ``image``, elements that are left out not drawn. Needs matplotlib.

        limits: ends of the scale; by default the 1 and 99 % quantiles.
        """
        import numpy as np
        from matplotlib.collections import PolyCollection

        from ._images import as_background

        values = self.values(quantity)
        if len(values) == len(self.positions) and quantity not in ("residual", "misfit", "marks"):
            values = values[self.elements].mean(axis=1)
        if ax is None:
            from matplotlib import pyplot

            ax = pyplot.figure().add_subplot()
        if image is not None:
            ax.imshow(as_background(image), cmap="gray")
        shown = np.isfinite(values)
        drawn = PolyCollection(list(self.positions[self.elements[shown]]), array=values[shown], cmap=cmap, alpha=alpha, linewidths=0)
        if shown.any():
            low, high = limits or np.quantile(values[shown], [0.01, 0.99])
            drawn.set_clim(float(low), float(high))
        ax.add_collection(drawn)
        if image is None:
            ax.autoscale_view()
            ax.invert_yaxis()
        ax.set_aspect("equal")
        ax.set_xlabel("x (px)")
        ax.set_ylabel("y (px)")
        unit = "" if quantity.removesuffix("_window") in (*_STRAINS, "marks") else " (grey levels)" if quantity == "residual" else " (px)"
        figure = ax.get_figure()
        if figure is not None:
            figure.colorbar(drawn, ax=ax, label=f"{quantity}{unit}")
        return ax
