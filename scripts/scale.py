#!/usr/bin/env python3
"""What a frame costs as such, and what memory a size of image takes: the figures of docs/scale.md.

    scripts/scale.py [--frames 100000] [--sizes 1024,2048,5504] [--folder DIR]

Makes images with `quadrille make images` in a temporary folder (in DIR, which needs room: 100 000 frames are 800 000 small files),
and prints seconds and peak memory of each command. The many frames are links to 20 images of 96 x 96 px, to and fro; of each
larger size there are 6, and the bytes per frame are those of the store.
"""

import argparse
import os
import pathlib
import subprocess
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent


def timed(*command):
    """Seconds and peak memory, MB, of a command."""
    begin = time.perf_counter()
    process = subprocess.Popen([str(part) for part in command], stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    if status != 0:
        raise SystemExit(f"{' '.join(map(str, command[:3]))} ... ended with {os.waitstatus_to_exitcode(status)}")
    return time.perf_counter() - begin, usage.ru_maxrss * 1024 / 1e6


def images(quadrille, folder, size, frames):
    subprocess.run([quadrille, "make", "images", "accuracy", "--size", f"{size}x{size}", "--frames", str(frames), "--noise", "1",
                    "--grid", "64", "--output", folder], check=True, capture_output=True)


def many(quadrille, folder, frames):
    images(quadrille, folder / "base", 96, 20)
    (folder / "links").mkdir()
    for frame in range(frames):
        at = frame % 38
        os.link(folder / "base" / f"{min(at, 38 - at) + 1:06}.tif", folder / "links" / f"{frame:06}.tif")
    correlate = [quadrille, "correlate", folder / "base" / "000000.tif", f"{folder}/links/*.tif", "--roi", "16,16,80,80",
                 "--export", "none", "--quiet", "--output", folder / "out"]
    for what, command in [("correlate", correlate), ("status", [quadrille, "status", folder / "out"]),
                          ("correlate again: nothing is missing", correlate)]:
        seconds, memory = timed(*command)
        print(f"{frames} frames of 96 x 96 px, {what}: {seconds:.2f} s, {memory:.0f} MB", flush=True)


def large(quadrille, folder, size, frames=6):
    images(quadrille, folder / "images", size, frames)
    out, far = folder / "out", size - 32
    seconds, memory = timed(quadrille, "correlate", *sorted((folder / "images").glob("*.tif")), "--roi",
                            f"32,32,{far},{far}", "--export", "none", "--quiet", "--output", out)
    fields = ["displacement_px", "sigma_px", "measured", "strain_element", "strain_node", "residual_grey", "model_error_px",
              "misfit_px", "mark", "status"]
    stored = sum(file.stat().st_size for name in fields for file in (out / "fields.zarr" / name).glob("c.*"))
    print(f"{frames} frames of {size} x {size} px: {seconds:.2f} s, {memory:.0f} MB, {memory * 1e6 / size**2:.0f} bytes per pixel; "
          f"{stored / frames / 1e6:.2f} MB per frame in the store", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=100_000)
    parser.add_argument("--sizes", default="1024,2048,5504")
    parser.add_argument("--folder", type=pathlib.Path)
    arguments = parser.parse_args()
    subprocess.run(["cargo", "build", "--release", "--locked", "--quiet"], cwd=ROOT, check=True)
    quadrille = ROOT / "target" / "release" / "quadrille"
    if arguments.frames:
        with tempfile.TemporaryDirectory(dir=arguments.folder) as folder:
            many(quadrille, pathlib.Path(folder), arguments.frames)
    for size in arguments.sizes.split(","):
        with tempfile.TemporaryDirectory(dir=arguments.folder) as folder:
            large(quadrille, pathlib.Path(folder), int(size))


if __name__ == "__main__":
    main()
