"""The field of one image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    import pandas
    import pyvista
    import xarray
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from ._images import Image

#: What is the matter with an element, by the code in :attr:`Field.marks`.
MARKS = ("none", "misfit", "still", "no_texture", "left_image", "saturated", "no_match")

_STRAINS = ("exx", "eyy", "exy")


@dataclass(frozen=True, eq=False, repr=False, slots=True, kw_only=True)
class Field:
    """What was measured on one image, on n nodes and m elements. Lengths are px of the reference image, x right, y down."""

    #: ``converged``, ``iteration_limit``, ``diverged``, ``left_image``, ``ambiguous`` or ``partly_lost``.
    status: str
    #: Places of the nodes in the reference image, (n, 2), px.
    positions: NDArray[np.float64]
    #: Nodes of each element, (m, 4); of a triangle the last twice.
    elements: NDArray[np.uint32]
    #: Number of the zone of each node, (n,).
    node_zone: NDArray[np.uint32]
    #: Displacement of the nodes, (n, 2), px; NaN where not measured. These are the coefficients of the fitted field; for the
    #: displacement at a point read :attr:`displacement_point`.
    displacement: NDArray[np.float64]
    #: Its standard uncertainty, (n, 2), px.
    sigma: NDArray[np.float64]
    #: exx, eyy, exy (tensor shear) at the nodes, (n, 3), over two elements; no unit.
    strain: NDArray[np.float64]
    #: The same at the centres of the elements, (m, 3).
    element_strain: NDArray[np.float64]
    #: How strains are defined: ``green-lagrange``, ``hencky`` or ``infinitesimal``.
    strain_definition: str
    #: Root mean square of the residual in each element, (m,), grey levels.
    residual: NDArray[np.float64]
    #: Whether a node was measured, (n,).
    measured: NDArray[np.bool_]
    #: Fault of each element, (m,), numbers in :data:`MARKS`.
    marks: NDArray[np.uint8]
    #: Iterations on the image itself.
    iterations: int
    #: Largest correction of the last iteration, px.
    correction_px: float
    #: Root mean square of the residual, grey levels.
    residual_grey: float
    #: The same in per cent of the range of the reference.
    residual_percent: float
    #: By what the displacement may be off, where the texture repeats.
    ambiguity: str | None
    #: Zone by zone: name, correlation coefficient, residual_grey, noise_grey, gain.
    zones: list[dict[str, Any]]
    #: Estimated error of the displacement beyond noise, (n, 2), px.
    model_error: NDArray[np.float64] | None = None
    #: Displacement that is not followed in an element, (m,), px; 0 where the residual is noise.
    misfit: NDArray[np.float64] | None = None
    #: Displacement at the nodes as values at points, (n, 2), px; NaN where not measured. None of a frame without a field.
    displacement_point: NDArray[np.float64] | None = None
    #: Its standard uncertainty, (n, 2), px.
    sigma_point: NDArray[np.float64] | None = None
    #: Whether it is a value, (n,); where not, it is the coefficient as it stands: too few nodes near, or a regularised field.
    is_point_value: NDArray[np.bool_] | None = None
    #: Strains over a window of nodes, (n, 3), where ``strain_window`` asks for it.
    window_strain: NDArray[np.float64] | None = None
    #: Their standard uncertainty, (n, 3).
    window_strain_sigma: NDArray[np.float64] | None = None
    #: What they may be off at the node beyond noise, (n, 3): the window flattens. To be added to the sigma in squares.
    window_strain_model_error: NDArray[np.float64] | None = None

    def __repr__(self) -> str:
        n, m = len(self.positions), len(self.elements)
        return f"<quadrille.Field: {self.status}, {int(self.measured.sum())} of {n} nodes, {m} elements, residual {self.residual_percent:.2f} %>"

    def values(self, name: str) -> NDArray[np.float64]:
        """Values at the nodes, (n,): ``ux``, ``uy``, ``u`` (size) at points, ``sigma_ux``, ``sigma_uy``, ``exx``, ``eyy``, ``exy``; at the
        elements, (m,): ``residual``, ``misfit``.

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
        if name == "residual":
            return self.residual
        if name == "misfit" and self.misfit is not None:
            return self.misfit
        raise KeyError(f"{name!r} is no quantity of a field; there are ux, uy, u, sigma_ux, sigma_uy, exx, eyy, exy, residual, misfit")

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
        if len(values) == len(self.positions) and quantity not in ("residual", "misfit"):
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
        unit = "" if quantity in _STRAINS else " (grey levels)" if quantity == "residual" else " (px)"
        figure = ax.get_figure()
        if figure is not None:
            figure.colorbar(drawn, ax=ax, label=f"{quantity}{unit}")
        return ax
