"""Images for the tests, made by themselves: spots at random places, moved exactly."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

SHAPE = (96, 128)


def spots(shape=SHAPE, move=(0.0, 0.0), stretch=0.0, seed=3):
    """A sum of Gaussian spots whose centres move: the displacement at x is move + stretch * (x - middle, 0), in px."""
    rng = np.random.default_rng(seed)
    rows, columns = shape
    n = rows * columns // 12
    centres = rng.uniform([-8, -8], [columns + 8, rows + 8], (n, 2))
    heights = rng.uniform(30, 90, n)
    moved = centres + move + stretch * np.c_[centres[:, 0] - columns / 2, np.zeros(n)]
    image = np.zeros(shape)
    y, x = np.mgrid[:rows, :columns]
    for (cx, cy), height in zip(moved, heights, strict=True):
        x0, x1 = max(0, int(cx) - 8), min(columns, int(cx) + 9)
        y0, y1 = max(0, int(cy) - 8), min(rows, int(cy) + 9)
        if x0 < x1 and y0 < y1:
            box = np.s_[y0:y1, x0:x1]
            image[box] += height * np.exp(-((x[box] - cx) ** 2 + (y[box] - cy) ** 2) / (2 * 1.6**2))
    return np.clip(np.rint(20 + image), 0, 255).astype(np.uint8)


@pytest.fixture(scope="session")
def reference():
    return spots()


@pytest.fixture(scope="session")
def deformed():
    return spots(move=(0.4, -0.3))


@pytest.fixture(scope="session")
def program():
    """The command of the wheel, beside this Python."""
    path = Path(sys.executable).with_name("quadrille")
    assert path.exists(), f"{path} is missing: the wheel brings no program"

    def run(*words, **options):
        return subprocess.run([path, *map(str, words)], capture_output=True, text=True, **options)

    return run


@pytest.fixture(scope="session")
def series(tmp_path_factory, program):
    """A folder with a reference and five frames, as files."""
    folder = tmp_path_factory.mktemp("series")
    made = program("make", "images", "accuracy", "--size", "160x128", "--frames", "5", "--noise", "1", "--output", folder / "images")
    assert made.returncode == 0, made.stderr
    return folder / "images"
