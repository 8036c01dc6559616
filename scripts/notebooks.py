"""Runs python/notebooks/*.ipynb, or those that are named, each twice in one folder outside this checkout, and keeps them with what they
show in out/notebooks. Each has a picture. Needs nbclient, ipykernel, matplotlib, pandas and zarr: scripts/wheel.sh --notebooks."""

import os
import sys
import tempfile
import time
from pathlib import Path

import nbclient
import nbformat

ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "out/notebooks"
OUT.mkdir(parents=True, exist_ok=True)
# The kernel finds the program by its Python alone.
os.environ["PATH"] = os.defpath
for path in map(Path, sys.argv[1:]) if sys.argv[1:] else sorted((ROOT / "python/notebooks").glob("*.ipynb")):
    with tempfile.TemporaryDirectory(prefix="another folder ") as folder:
        for again in ("", ", again"):
            notebook = nbformat.read(path, as_version=4)
            begin = time.perf_counter()
            words = {"timeout": 600, "kernel_name": "python3", "extra_arguments": ["--log-level=ERROR"], "resources": {"metadata": {"path": folder}}}
            nbclient.NotebookClient(notebook, **words).execute()
            outputs = [output.get("data", {}) for cell in notebook.cells for output in cell.get("outputs", [])]
            pictures = sum("image/png" in shown or "image/png" in shown.get("text/html", "") for shown in outputs)
            assert pictures, f"{path.name} shows no picture"
            print(f"{path.name}{again}: {time.perf_counter() - begin:.1f} s, {pictures} pictures", flush=True)
    nbformat.write(notebook, OUT / path.name)
