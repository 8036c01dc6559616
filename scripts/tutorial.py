"""Follows docs/tutorials/python.md in a folder of its own, with the quadrille of this environment (scripts/wheel.sh): its commands and,
each by itself, its examples."""

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

page = Path(__file__).resolve().parent.parent / "docs/tutorials/python.md"
# The program of the same environment.
os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
with tempfile.TemporaryDirectory() as folder:
    blocks = re.findall(r"^```(sh|python)\n(.*?)^```", page.read_text(), re.S | re.M)
    for kind, block in blocks:
        words = ["bash", "-ec", block] if kind == "sh" else [sys.executable, "-W", "ignore", "-c", block]
        done = subprocess.run(words, cwd=folder, capture_output=True, text=True)
        if done.returncode != 0:
            sys.exit(f"{block}\n{done.stdout}{done.stderr}")
print(f"{page.name}: {len(blocks)} blocks")
