#!/usr/bin/env python3
"""Light that flickers: iterations per frame of a series whose grey levels are changed as a whole, by another gain and offset in every
frame, next to those of the same series in steady light. A table of benches/RESULTS.md.

    scripts/flicker.py [--program target/release/quadrille] [--output out/flicker]
"""

import argparse
import json
import random
import struct
import subprocess
from pathlib import Path

FRAMES = 12
SIZE = 1024


def strips(tiff: bytes) -> list[tuple[int, int]]:
    """Where the pixels of a little-endian TIFF without compression stand: offset and length of each strip."""
    at = struct.unpack_from("<I", tiff, 4)[0]
    tags = {}
    for k in range(struct.unpack_from("<H", tiff, at)[0]):
        tag, kind, count = struct.unpack_from("<HHI", tiff, at + 2 + 12 * k)
        letter = {3: "H", 4: "I"}.get(kind)
        if letter and tag in (273, 279):
            place = at + 10 + 12 * k
            if count * struct.calcsize(letter) > 4:
                place = struct.unpack_from("<I", tiff, place)[0]
            tags[tag] = struct.unpack_from(f"<{count}{letter}", tiff, place)
    return list(zip(tags[273], tags[279]))


def in_light(tiff: bytes, gain: float, offset: float) -> bytes:
    """The image with every grey level g at gain g + offset."""
    table = bytes(min(255, max(0, round(gain * grey + offset))) for grey in range(256))
    changed = bytearray(tiff)
    for at, length in strips(tiff):
        changed[at : at + length] = tiff[at : at + length].translate(table)
    return bytes(changed)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", type=Path, default=Path("target/release/quadrille"))
    parser.add_argument("--output", type=Path, default=Path("out/flicker"))
    options = parser.parse_args()
    steady, flickering = options.output / "steady", options.output / "flickering"
    flickering.mkdir(parents=True, exist_ok=True)
    synth = ["make", "images", "accuracy", "--size", f"{SIZE}x{SIZE}", "--frames", str(FRAMES), "--amplitude", "2", "--overwrite", "--output"]
    subprocess.run([options.program, *synth, steady], check=True, capture_output=True)
    draws = random.Random(1)
    for image in sorted(steady.glob("*.tif")):
        is_reference = image.stem == "000000"
        gain, offset = (0.85, 5.0) if is_reference else (draws.uniform(0.8, 0.95), draws.uniform(0.0, 10.0))
        (flickering / image.name).write_bytes(in_light(image.read_bytes(), gain, offset))

    print("| elements | light | iterations, frame by frame | mean |")
    print("| --- | --- | --- | --- |")
    for size in (16, 8):
        for folder in (steady, flickering):
            out = options.output / f"{folder.name}{size}"
            inside = f"64,64,{SIZE - 128},{SIZE - 128}"
            words = ["correlate", f"{folder}/*.tif", "--roi", inside, "--element-size", str(size), "--overwrite"]
            subprocess.run([options.program, *words, "--export", "none", "--quiet", "--output", out], check=True)
            frames = json.loads((out / "summary.json").read_text())["frames"]
            iterations = [frame["iterations"] for frame in frames]
            print(f"| {size} px | {folder.name} | {', '.join(map(str, iterations))} | {sum(iterations) / len(iterations):.1f} |")


if __name__ == "__main__":
    main()
