"""The examples as a user runs them."""

import importlib
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

EXAMPLES = Path(__file__).parent.parent / "examples"


def ran(*words, cwd):
    done = subprocess.run([sys.executable, *map(str, words)], capture_output=True, text=True, cwd=cwd, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_pair(series, tmp_path):
    pytest.importorskip("matplotlib")
    said = ran(EXAMPLES / "pair.py", series / "000000.tif", series / "000005.tif", cwd=tmp_path)
    assert "converged" in said and (tmp_path / "ux.png").stat().st_size > 1000


def test_a_series(series, tmp_path):
    pytest.importorskip("zarr")
    said = ran(EXAMPLES / "series.py", series / "*.tif", tmp_path / "out", cwd=tmp_path)
    assert said.startswith("fine") and "px" in said


def test_frames_over_two_processes_have_the_bits_of_one(series, tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.syspath_prepend(EXAMPLES)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        example = importlib.import_module("dask_frames")
        reference, *images = sorted(map(str, series.glob("*.tif")))
        alone = np.stack([example.displacement(reference, image) for image in images])
    script = tmp_path / "spread.py"
    script.write_text(f"""
import dask_frames
if __name__ == "__main__":
    found = dask_frames.main({str(series / "*.tif")!r}, n_workers=2, threads_per_worker=1)
    print(found.tobytes().hex())
""")
    monkeypatch.setenv("PYTHONPATH", str(EXAMPLES))
    assert bytes.fromhex(ran(script, cwd=tmp_path).split()[-1]) == alone.tobytes()
