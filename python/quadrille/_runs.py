"""Whole runs, into a folder: what the commands of the program do, to the same bits."""

from __future__ import annotations

import io
import json
import os
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from . import _quadrille
from ._camera import Camera
from ._correlator import case_text
from ._errors import CaseError, OptionError, QuadrilleError, StoreError
from ._field import columns_of, html_of
from ._values import plain_value

if TYPE_CHECKING:
    import pandas
    import xarray
    import zarr

    from ._correlator import Zone
    from ._images import Image

#: What happens in a run: a dict whose key ``event`` is begun (total, before), note (text), remark (code, severity,
#: about, values, text), frame (the record of summary.json), finished (frames, seconds), fitting (doing, evaluation, omega, parameters, ...), identified, simulated, compared (folder),
#: reported (page).
Event: TypeAlias = dict[str, Any]
Path_: TypeAlias = "str | os.PathLike[str]"
Watcher: TypeAlias = "Callable[[Event], object] | None"


@dataclass(frozen=True, slots=True)
class Result:
    """The result of a run.

    outcome: ``fine``; ``incomplete``: it ran, but a frame or a fit did not converge, or the data reject the model; ``stopped``.
    folder: Where the results are.
    record: The record of the run: what summary.json, fit.json, tournament.json or truth.json holds.
    """

    outcome: str
    folder: Path
    record: dict[str, Any] = field(repr=False)

    def open_store(self) -> zarr.Group:
        """The fields of the run: see :func:`open_store`."""
        return open_store(self.folder)

    def to_xarray(self) -> xarray.Dataset:
        """Fields, quantities and loads over frames: see :func:`to_xarray`."""
        return to_xarray(self.folder)

    def table(self, name: str) -> pandas.DataFrame:
        """A table of the run: a file ``NAME.csv`` of its folder, as ``extensometers``, ``openings_mean``, ``points`` of its gauges, or
        ``law``, ``budget``, ``tractions`` of a joint. Needs pandas.

        Raises StoreError for another name.
        """
        import pandas

        files = {path.stem: path for part in (self.folder, self.folder / "quantities") for path in sorted(part.glob("*.csv"))}
        if name not in files:
            raise StoreError(f"{self.folder}: there is no table {name!r}; there are {', '.join(files) or 'none'}")
        lines = files[name].read_text(encoding="utf8").splitlines(keepends=True)
        return pandas.read_csv(io.StringIO("".join(line for line in lines if not line.startswith("#"))))

    def _repr_html_(self) -> str:
        rows = {"outcome": self.outcome, "folder": str(self.folder)}
        frames = self.record.get("frames")
        if isinstance(frames, list):
            rows["frames"] = f"{sum(frame['status'] == 'converged' for frame in frames)} of {len(frames)} converged"
        for name, found in self.record.get("parameters", {}).items():
            if isinstance(found, dict) and found.get("ends95"):
                low, high = found["ends95"]
                rows[name] = f"{found['value']:.4g} {found['unit']}, 95 % {low:.4g} to {high:.4g}"
        if page := next((name for name in ("report.html", "tournament.html") if (self.folder / name).is_file()), None):
            rows["to read"] = str(self.folder / page)
        picture = next((path for name in _PICTURES if (path := self.folder / "figures" / name).is_file()), None)
        return html_of(rows, None if picture is None else picture.read_bytes())


#: What a notebook shows of a run: the first of these that was drawn.
_PICTURES = ("law-opening.png", "mesh.png", "register.png")


@dataclass(frozen=True, slots=True)
class Calibration:
    """What :func:`calibrate` has found.

    camera: The camera, for :class:`Correlator` and :func:`run`.
    folder: Where its ``camera.toml`` is, with the run and the figures that show it.
    said: What these images determine, and what is missing, in sentences.
    """

    camera: Camera
    folder: Path
    said: list[str]


def _names(files: str | os.PathLike[str] | Sequence[str | os.PathLike[str]] | None) -> list[str]:
    if files is None:
        return []
    if isinstance(files, (str, os.PathLike)):
        return [os.fspath(files)]
    return [os.fspath(file) for file in files]


def _text_of(case: str | os.PathLike[str]) -> dict[str, Any]:
    try:
        return tomllib.loads(Path(case).read_text(encoding="utf8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        return {}  # the engine says what is wrong, with the place


def run(
    case: Path_ | Mapping[str, Any] | None,
    output: Path_,
    *,
    images: Path_ | Sequence[Path_] | None = None,
    reference: Path_ | Sequence[Path_] | None = None,
    zones: Zone | Sequence[Zone] | None = None,
    overwrite: bool = False,
    shard: str | None = None,
    export: Sequence[str] | None = None,
    report: bool = True,
    max_seconds: float | None = None,
    max_evaluations: int | None = None,
    device: str = "auto",
    isa: str | None = None,
    threads: int | None = None,
    on_event: Watcher = None,
    **options: Any,
) -> Result:
    """Correlates a series of image files into the folder ``output``, as ``quadrille correlate``; a case with ``[interface]`` and
    ``[cohesive]`` goes on to the law and its report, as ``quadrille run``.

    The same call resumes where an earlier one was stopped, to the same bits. Ctrl-C, or an exception of ``on_event``, stops it: frames
    in flight are finished, nothing else is begun, and the exception is raised.

    case: a case file; its sections as a mapping; or None, with ``images``.
    images: names or patterns of the deformed images, instead of those of the case; the first is the reference unless one is named.
    zones, options: as for :class:`quadrille.Correlator`, instead of those of the case.
    shard: ``"2/4"``: every fourth frame from the second on, for one of several processes; with ``start="independent"``.
    export: tables per frame beside the store: csv, vtu, or none.
    max_seconds, max_evaluations: limits of the fit.

    Raises CaseError, OptionError, ImageError, ZoneError, TextureError, DeviceError, FolderError, StoreError, ModelError, FitError.
    A frame that cannot be read or does not converge is a result.
    """
    output = Path(output)
    is_file = case is not None and not isinstance(case, Mapping)
    sections = _text_of(case) if is_file else dict(case or {})  # type: ignore[arg-type]
    if "interface" in sections and "cohesive" in sections:
        given = [
            name
            for name, value in [("images", images), ("reference", reference), ("zones", zones), ("shard", shard),
                                ("export", export), ("isa", isa), *options.items()]
            if value is not None
        ]
        if not is_file:
            raise OptionError("a case with a joint is to be a file: its tables have names that are relative to it")
        if given:
            raise OptionError(f"{', '.join(given)}: the case file of a joint says it all; write it there")
        outcome = _quadrille.run_case(
            case, output, overwrite=overwrite, max_seconds=max_seconds, max_evaluations=max_evaluations, device=device,
            threads=threads, on_event=on_event,
        )
        fit = output / "fit.json"
        return Result(outcome, output, json.loads(fit.read_text(encoding="utf8")) if fit.exists() else {})
    path = os.fspath(case) if is_file else None  # type: ignore[arg-type]
    text = None if is_file and zones is None and not options else case_text(options, zones, case=sections)
    if path is not None and text is not None and not sections:
        raise CaseError(f"{path}: cannot be read, or is empty; name a case file")
    outcome, record = _quadrille.run_series(
        path, text, output, reference=_names(reference), deformed=_names(images), overwrite=overwrite, shard=shard,
        export=None if export is None else _names(export), report=report, device=device, isa=isa, threads=threads, on_event=on_event,
    )
    return Result(outcome, output, record)


def identify(
    case: Path_, output: Path_, *, overwrite: bool = False, max_seconds: float | None = None, max_evaluations: int | None = None,
    threads: int | None = None, on_event: Watcher = None,
) -> Result:
    """The parameters of the adhesive's law from measured displacements, as ``quadrille identify``; the record is fit.json.

    Raises CaseError, ModelError, FitError, FolderError. A fit that does not converge is a result.
    """
    outcome, record = _quadrille.identify(
        case, output, overwrite=overwrite, max_seconds=max_seconds, max_evaluations=max_evaluations, threads=threads, on_event=on_event
    )
    return Result(outcome, Path(output), record)


def reduce(case: Path_, output: Path_, *, overwrite: bool = False) -> Result:
    """J, energy release rates by the standards and the traction from images and loads, as ``quadrille reduce``; the record is
    reduction.json.

    Raises CaseError, StoreError, FolderError, QuadrilleError.
    """
    outcome, record = _quadrille.reduce(case, output, overwrite=overwrite)
    return Result(outcome, Path(output), record)


def virtual_test(
    output: Path_,
    *,
    law: str = "extended-xu-needleman",
    instants: int = 19,
    seed: int = 1,
    depth: int = 8,
    noise: float = 2.0,
    mixity: str = "mixed",
    kinematics: str = "paper",
    overwrite: bool = False,
    threads: int | None = None,
) -> Result:
    """A bonded joint that is pulled apart in the computer: images, ``case.toml`` for :func:`run`, and the truth, as ``quadrille make
    virtual-test``; the record is truth.json.

    law: of the adhesive, with the strengths and works of separation of the default one.
    instants: images after the reference.
    depth: 8 or 16 bits; noise: its standard deviation, grey levels of 255.
    mixity: ``opening``, ``mixed`` or ``sliding``.
    kinematics: ``paper`` (small rotations) or ``finite``.

    Raises OptionError, FolderError.
    """
    outcome, record = _quadrille.virtual_test(
        output, law=law, instants=instants, seed=seed, depth=depth, noise=noise, mixity=mixity, kinematics=kinematics,
        overwrite=overwrite, threads=threads,
    )
    return Result(outcome, Path(output), record)


def calibrate(
    images: Path_ | Sequence[Path_],
    output: Path_,
    *,
    lengths: Sequence[Sequence[float]] = (),
    points: Sequence[Sequence[float]] = (),
    chessboard: tuple[int, int] | None = None,
    dots: tuple[int, int] | None = None,
    pitch_mm: float | None = None,
    mark_std_px: float | None = None,
    zones: Zone | Sequence[Zone] | None = None,
    overwrite: bool = False,
    device: str = "auto",
    threads: int | None = None,
    on_event: Watcher = None,
    **options: Any,
) -> Calibration:
    """The camera from image files, as ``quadrille calibrate``: of the specimen, moved in its plane by hand; of a flat target; or one
    image with points or lengths on it.

    images: names or patterns; the first is the reference.
    lengths: rows ``x0, y0, x1, y1, mm``: the ends of a known length on the first image, px.
    points: rows ``x, y, X, Y``: four or more places on the first image, px, and where they are, mm.
    chessboard, dots: columns and rows of the inner corners, or of the dots, of a target that the images show; ``pitch_mm`` from each
        to the next.
    mark_std_px: standard uncertainty of what was marked, 0.5 px without.
    zones, options: as for :class:`Correlator`.

    Raises CalibrationError for images that do not determine a camera, and as :func:`run`.
    """
    said = _quadrille.calibrate(
        case_text(options, zones), output, images=_names(images), lengths=plain_value(lengths, "lengths"),
        points=plain_value(points, "points"), chessboard=chessboard, dots=dots, pitch_mm=pitch_mm, mark_std_px=mark_std_px,
        overwrite=overwrite, device=device, threads=threads, on_event=on_event,
    )
    return Calibration(Camera.read(Path(output) / "camera.toml"), Path(output), said)


def command(words: str | Sequence[Path_]) -> str:
    """Runs the program ``quadrille`` of this Python, in a process of its own: what it says on standard output.

    words: a command line without the name of the program, ``"make images star --output images"``, or its words.

    Raises QuadrilleError with what the program says where it cannot run. A result that did not converge is none.
    """
    split = shlex.split(words) if isinstance(words, str) else _names(words)
    ran = subprocess.run([sys.executable, "-m", "quadrille", *split], capture_output=True, text=True, encoding="utf8", errors="replace")
    if ran.returncode not in (0, 1):
        said = ran.stderr.strip().removeprefix("quadrille: ")
        raise QuadrilleError(said or f"quadrille {shlex.join(split)}: ended with {ran.returncode}")
    return ran.stdout


def simulate(
    case: Path_, output: Path_, *, overwrite: bool = False, threads: int | None = None, on_event: Watcher = None
) -> Result:
    """The forward model of a joint whose border moves as measured, as ``quadrille simulate``; the record is summary.json.

    Raises CaseError, ModelError, FolderError. An instant without a solution is a result.
    """
    outcome, record = _quadrille.simulate(case, output, overwrite=overwrite, threads=threads, on_event=on_event)
    return Result(outcome, Path(output), record)


def tournament(
    case: Path_, output: Path_, laws: Sequence[str] = (), *, overwrite: bool = False, max_seconds: float | None = None,
    max_evaluations: int | None = None, threads: int | None = None, on_event: Watcher = None,
) -> Result:
    """Several laws on the same data, as ``quadrille identify --tournament``; the record is tournament.json.

    laws: names of laws; by default those of ``[fit]``.

    Raises CaseError, OptionError, ModelError, FitError, FolderError. A law that the data reject is a result.
    """
    outcome, record = _quadrille.tournament(
        case, output, laws=list(laws), overwrite=overwrite, max_seconds=max_seconds, max_evaluations=max_evaluations, threads=threads,
        on_event=on_event,
    )
    return Result(outcome, Path(output), record)


def metrology(
    reference: Image,
    stills: Sequence[Image] = (),
    *,
    element_sizes: Sequence[int] | None = None,
    roi: Sequence[float] | None = None,
    noise: float | None = None,
    target_sigma_px: float = 0.02,
    resolve_period_px: float | None = None,
    seed: int = 1,
    threads: int | None = None,
) -> dict[str, Any]:
    """Noise, texture, uncertainty and resolution of images, as ``quadrille metrology``: what metrology.json holds.

    reference: the specimen at rest; stills: further images of it, for the noise.
    element_sizes: px, those that are usual without; roi: the part that is looked at, ``x0, y0, x1, y1``, px.
    noise: standard deviation of the noise of one image, grey levels, where it is known.
    target_sigma_px: standard uncertainty that is wanted; resolve_period_px: the shortest wave that is to be seen.

    Raises ImageError for images without texture, of different sizes, or too small.
    """
    found = _quadrille.metrology(
        reference, list(stills), element_sizes=None if element_sizes is None else list(element_sizes),
        roi=None if roi is None else list(roi), noise=noise, target_sigma_px=target_sigma_px, resolve_period_px=resolve_period_px,
        seed=seed, threads=threads,
    )
    return found


def devices() -> list[dict[str, str | None]]:
    """Graphics devices of this machine: name, kind (discrete, integrated, software, ...), and why one cannot be used."""
    return [{"name": name, "kind": kind, "unusable": unusable} for name, kind, unusable in _quadrille.devices()]


def open_store(path: Path_) -> zarr.Group:
    """The fields of a run, read lazily, also while the run is in progress (zarr: ``pip install quadrille[store]``).

    path: the folder of a run, or its ``fields.zarr``. For example ``open_store("out")["displacement_px"][3]`` is frame 4, (n, 2), px.

    Raises StoreError when there is none.
    """
    try:
        import zarr
    except ImportError as error:
        raise StoreError("to read a store zarr 3 is needed: pip install 'quadrille[store]'") from error
    return zarr.open_group(str(_store_in(path)), mode="r")


def _store_in(path: Path_) -> Path:
    folder = Path(path)
    inside = folder / "fields.zarr"
    folder = inside if inside.is_dir() else folder
    if not (folder / "zarr.json").is_file():
        raise StoreError(f"{path}: there is no store; name the folder of a run, or its fields.zarr")
    return folder


#: Tables of quantities with one row for each frame and thing, and the column that names the thing.
_OF_FRAMES = {"points": "point", "extensometers": "extensometer", "regions": "region", "openings_mean": "opening"}


def to_xarray(path: Path_) -> xarray.Dataset:
    """A run as one dataset: fields over ``frame`` and ``node`` or ``element``, read lazily; the columns of the tables of quantities as
    ``points_ux_px`` and so on over ``frame`` and ``point``, ``extensometer``, ``region`` or ``opening``; those of the load file over
    ``frame``. Frames count from 1. Needs xarray and zarr.

    path: the folder of a run, or its ``fields.zarr``.

    Raises StoreError when there is no run.
    """
    import numpy as np
    import xarray

    store = _store_in(path)
    data: xarray.Dataset = xarray.open_zarr(str(store), consolidated=False, chunks=None)
    data = data.assign_coords(
        frame=np.arange(1, data.sizes["frame"] + 1),
        component=["x", "y"],
        x=data["node_position_px"][:, 0].drop_vars("component", errors="ignore"),
        y=data["node_position_px"][:, 1].drop_vars("component", errors="ignore"),
    )
    if "strain_component" in data.sizes:
        data = data.assign_coords(strain_component=["xx", "yy", "xy"])
    for table, key in _OF_FRAMES.items():
        file = store.parent / "quantities" / f"{table}.csv"
        if not file.is_file():
            continue
        columns = columns_of(file.read_text(encoding="utf8"))
        names = list(dict.fromkeys(columns[key]))
        shape = (len(columns[key]) // len(names), len(names))
        places = {"frame": columns["frame"].reshape(shape)[:, 0].astype(int), key: names}
        # The columns of the load file stand before that of the names.
        loads = list(columns)[2 : list(columns).index(key)]
        for name, values in columns.items():
            if name in loads:
                data[name] = xarray.DataArray(values.reshape(shape)[:, 0], {"frame": places["frame"]}, ("frame",))
            elif not isinstance(values, list) and name != "frame":
                data[f"{table}_{name}"] = xarray.DataArray(values.reshape(shape), places, ("frame", key))
    return data
