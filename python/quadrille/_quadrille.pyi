import os
from collections.abc import Callable, Sequence
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

_Path = str | os.PathLike[str]
_Watcher = Callable[[dict[str, Any]], object] | None

__all__ = [
    "VERSION",
    "Camera",
    "Correlator",
    "Measured",
    "Tracker",
    "calibrate",
    "command",
    "devices",
    "identify",
    "metrology",
    "read_image",
    "reduce",
    "run_case",
    "run_series",
    "simulate",
    "tournament",
    "virtual_test",
]

VERSION: str

@final
class Camera:
    def __new__(cls, json: str, image_size_px: tuple[int, int] | None = None) -> Camera: ...
    @staticmethod
    def read(path: _Path, image_size_px: tuple[int, int] | None = None) -> Camera: ...
    def text(self, /) -> str: ...
    def keys(self, /) -> dict[str, Any]: ...
    def to_mm(self, /, px: NDArray[np.float64]) -> NDArray[np.float64]: ...
    def to_px(self, /, mm: NDArray[np.float64]) -> NDArray[np.float64]: ...
    def terms_mm(self, /, px: NDArray[np.float64]) -> NDArray[np.float64]: ...
    def distance_mm(self, /, px: NDArray[np.float64]) -> NDArray[np.float64]: ...

@final
class Measured: ...

@final
class Correlator:
    def __new__(
        cls,
        reference: Any,
        case: str,
        mask: Any | None = None,
        device: str = "auto",
        isa: str | None = None,
        threads: int | None = None,
    ) -> Correlator: ...
    def correlate(self, /, image: Any) -> dict[str, Any]: ...
    def quantities(self, /, field: Measured, case: str) -> dict[str, str]: ...
    def positions(self, /) -> NDArray[np.float64]: ...
    def elements(self, /) -> NDArray[np.uint32]: ...
    def node_zone(self, /) -> NDArray[np.uint32]: ...
    def zones(self, /) -> list[str]: ...
    def device(self, /) -> str: ...
    def remarks(self, /) -> list[dict[str, Any]]: ...
    def shape(self, /) -> tuple[int, int]: ...
    def strain(self, /) -> str: ...

@final
class Tracker:
    def __new__(cls, correlator: Correlator) -> Tracker: ...
    def correlate(self, /, image: Any, number: int | None = None) -> dict[str, Any]: ...

def read_image(path: _Path, page: int = 0) -> tuple[Any, list[str]]: ...
def run_series(
    case: _Path | None,
    json: str | None,
    output: _Path,
    *,
    reference: Sequence[str],
    deformed: Sequence[str],
    overwrite: bool,
    shard: str | None,
    export: Sequence[str] | None,
    report: bool,
    device: str,
    isa: str | None,
    threads: int | None,
    on_event: _Watcher,
) -> tuple[str, dict[str, Any]]: ...
def run_case(
    case: Any,
    output: _Path,
    *,
    overwrite: bool,
    max_seconds: float | None,
    max_evaluations: int | None,
    device: str,
    threads: int | None,
    on_event: _Watcher,
) -> str: ...
def calibrate(
    json: str,
    output: _Path,
    *,
    images: Sequence[str],
    lengths: Sequence[Sequence[float]],
    points: Sequence[Sequence[float]],
    chessboard: tuple[int, int] | None,
    dots: tuple[int, int] | None,
    pitch_mm: float | None,
    mark_std_px: float | None,
    overwrite: bool,
    device: str,
    threads: int | None,
    on_event: _Watcher,
) -> list[str]: ...
def virtual_test(
    output: _Path,
    *,
    law: str,
    instants: int,
    seed: int,
    depth: int,
    noise: float,
    mixity: str,
    kinematics: str,
    overwrite: bool,
    threads: int | None,
) -> tuple[str, dict[str, Any]]: ...
def reduce(case: _Path, output: _Path, *, overwrite: bool) -> tuple[str, dict[str, Any]]: ...
def simulate(
    case: _Path, output: _Path, *, overwrite: bool, threads: int | None, on_event: _Watcher
) -> tuple[str, dict[str, Any]]: ...
def identify(
    case: _Path,
    output: _Path,
    *,
    overwrite: bool,
    max_seconds: float | None,
    max_evaluations: int | None,
    threads: int | None,
    on_event: _Watcher,
) -> tuple[str, dict[str, Any]]: ...
def tournament(
    case: _Path,
    output: _Path,
    *,
    laws: Sequence[str],
    overwrite: bool,
    max_seconds: float | None,
    max_evaluations: int | None,
    threads: int | None,
    on_event: _Watcher,
) -> tuple[str, dict[str, Any]]: ...
def metrology(
    reference: Any,
    stills: Sequence[Any],
    *,
    element_sizes: Sequence[int] | None,
    roi: Sequence[float] | None,
    noise: float | None,
    target_sigma_px: float,
    resolve_period_px: float | None,
    seed: int,
    threads: int | None,
) -> dict[str, Any]: ...
def devices() -> list[tuple[str, str, str | None]]: ...
def command(words: Sequence[str]) -> int: ...
