"""Runs python/notebooks/*.ipynb, each in a folder of its own under out/notebooks, and keeps them there with what they show. Needs
nbclient and ipykernel: scripts/wheel.sh --all."""

import os
import shutil
import sys
import time
from pathlib import Path

import nbclient
import nbformat

ROOT = Path(__file__).resolve().parent.parent
# The program of the same environment.
os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
for path in sorted((ROOT / "python/notebooks").glob("*.ipynb")):
    folder = ROOT / "out/notebooks" / path.stem
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True, exist_ok=True)
    notebook = nbformat.read(path, as_version=4)
    begin = time.perf_counter()
    nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(folder)}}).execute()
    nbformat.write(notebook, folder / path.name)
    print(f"{path.name}: {time.perf_counter() - begin:.1f} s")
