#!/usr/bin/env python3
"""What everybody types first, on every set of images in a folder: no zone, no option, only the names of files.

    scripts/first_command.py FOLDER [--output FOLDER] [--quadrille PROGRAM] [--only NAME,NAME]

A set is the images of one format in one subfolder of FOLDER. The reference is the first file, unless the name of another says
that it is. Printed is a table: how the frames ended, the iterations they took together and the most of one, the share of the image that is a zone,
the share of its nodes that have a result, and the largest error over the frames, for sets of which something is known. Needs nothing but the standard library."""

import argparse
import csv
import json
import math
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
FORMATS = ("tif", "tiff", "png", "bmp", "jpg", "jpeg", "pgm")
SAYS_REFERENCE = re.compile(r"(^|[^a-z])(ref|reference|undeformed|unloaded|initial)([^a-z]|$)", re.IGNORECASE)


def natural(path):
    return [int(part) if part.isdigit() else part.lower() for part in re.split(r"(\d+)", path.name)]


def sets_in(folder):
    """Name, reference or None, images in natural order, of every set."""
    for place in sorted(path for path in folder.iterdir() if path.is_dir()):
        by_format = {}
        for path in sorted(place.iterdir(), key=natural):
            ending = path.suffix.lower().lstrip(".")
            if ending in FORMATS:
                by_format.setdefault(ending, []).append(path)
        for ending, images in by_format.items():
            if len(images) > 1:
                name = place.name if len(by_format) == 1 else f"{place.name}, {ending}"
                named = [path for path in images if SAYS_REFERENCE.search(path.stem)]
                yield name, named[0] if len(named) == 1 else None, images


def rms(values):
    values = list(values)
    return math.sqrt(sum(v * v for v in values) / len(values)) if values else math.nan


def rows_of(path):
    with open(path) as lines:
        for row in csv.DictReader(line for line in lines if not line.startswith("#")):
            yield [float(row[key]) for key in ("x_px", "y_px", "ux_px", "uy_px")]


def against(motion):
    """The error against a motion that is known everywhere."""

    def error(rows, _frame, _data):
        pairs = [(u - motion_at[0], v - motion_at[1]) for x, y, u, v in rows if (motion_at := motion(x, y, _frame)) is not None]
        return rms(math.hypot(*pair) for pair in pairs), f"rms over {len(pairs)} nodes"

    return error


def shifted(_x, _y, frame):
    n = float(re.search(r"def_(\d+)", frame["file"]).group(1))
    return n, n


def contrast(_x, _y, frame):
    return (0.1, 0.1) if "X0.10" in frame["file"] else (0.0, 0.0)


def pages(_x, _y, frame):
    return (1.4, 1.4) if "def2" in frame["file"] else (0.4, 0.4)


def star(x, y, _frame):
    # v = cos(2 pi (y - 250) / p) / 2; where p is long against the elements.
    period = 10 + 290 * x / 4000
    return (0.0, 0.5 * math.cos(2 * math.pi * (y - 250) / period)) if x > 2500 else None


def turned(x, y, _frame):
    a = math.radians(-170)
    dx, dy = x - 256, y - 256
    return math.cos(a) * dx - math.sin(a) * dy - dx, math.sin(a) * dx + math.cos(a) * dy - dy


def points(table):
    """The error against single points of frames, x, y, u and v (None: unknown), by the nodes around them."""

    def error(rows, frame, _data):
        worst, n = 0.0, 0
        for x, y, *wanted in table.get(frame["number"], ()):
            near = [(math.exp(-((r[0] - x) ** 2 + (r[1] - y) ** 2) / 200), r) for r in rows if math.hypot(r[0] - x, r[1] - y) < 25]
            if near:
                weight = sum(w for w, _ in near)
                found = [sum(w * r[2 + c] for w, r in near) / weight for c in range(2)]
                worst = max([worst, *(abs(f - w) for f, w in zip(found, wanted) if w is not None)])
                n += 1
        return (worst if n else math.nan), f"largest at {n} points"

    return error


def table(name, columns, keep=lambda row: True):
    """The error against a field in a file: median over its points of the distance from the plane through the nodes around."""

    def error(rows, frame, data):
        path = data / name.format(number=frame["number"])
        if not path.is_file():
            return math.nan, ""
        cells = {}
        for r in rows:
            cells.setdefault((int(r[0] // 32), int(r[1] // 32)), []).append(r)
        off = []
        for line in open(path):
            try:
                known = [float(cell) for cell in line.split(",")]
                x, y, u, v = (known[k] for k in columns)
            except (ValueError, IndexError):
                continue
            if not keep(known):
                continue
            i, j = int(x // 32), int(y // 32)
            near = [r for di in (-1, 0, 1) for dj in (-1, 0, 1) for r in cells.get((i + di, j + dj), ()) if math.hypot(r[0] - x, r[1] - y) < 20]
            if len(near) >= 4:
                off.append(math.hypot(plane(near, x, y, 2) - u, plane(near, x, y, 3) - v))
        off.sort()
        return (off[len(off) // 2] if off else math.nan), f"median over {len(off)} points"

    return error


def plane(rows, x, y, column):
    """The value at (x, y) of the least-squares plane through a column of `rows`."""
    sums = [[0.0] * 4 for _ in range(3)]
    for row in rows:
        terms = (1.0, row[0] - x, row[1] - y)
        for i in range(3):
            for j in range(3):
                sums[i][j] += terms[i] * terms[j]
            sums[i][3] += terms[i] * row[column]
    for k in range(3):
        pivot = sums[k][k] or 1e-12
        for i in range(3):
            if i != k:
                factor = sums[i][k] / pivot
                sums[i] = [a - factor * b for a, b in zip(sums[i], sums[k])]
    return sums[0][3] / (sums[0][0] or 1e-12)


def sinusoid(rows, frame, data):
    column = {"L1": 1, "L3": 3, "L5": 5}[re.search(r"L[135]", frame["file"]).group(0)]
    truth = {}
    for row in csv.reader(open(data / "truth_command.csv")):
        try:
            truth[round(float(row[0]))] = float(row[column])
        except (ValueError, IndexError):
            continue
    off = [math.hypot(u - truth[round(x)], v) for x, y, u, v in rows if 100 < x < 1950 and round(x) in truth]
    return rms(off), f"rms over {len(off)} nodes"


NECKING = {1: (-2.36, -1.57, -0.58), 2: (-4.58, -2.97, -0.84), 3: (-14.4, -11.2, -6.7), 4: (-41.3, -32.4, -7.2)}
# Who the images are of, and what others have found in them.
KNOWN = {
    "pixel-shift": against(shifted),
    "dicchallenge-s05-contrast": against(contrast),
    "dicchallenge-s12-openhole": table("reference/DICe_solution_{number:02}.txt", (0, 1, 2, 3)),
    "dicchallenge-s14-sinusoid": sinusoid,
    "dicchallenge2-star": against(star),
    "openhole-bmp": table("reference/oht_cfrp_4_fftcc_icgn1_r16.csv", (0, 1, 2, 3), keep=lambda row: row[6] > 0.9),
    "rotation-170": against(turned),
    "sundic-necking": points({k: [(x, 300, u, None) for x, u in zip((300, 850, 1350), us)] for k, us in NECKING.items()}),
    "crack-heterogeneous, png": points({10: [(500, 60, 2.1, -33.8), (500, 600, -9.1, -34.1), (500, 1140, 2.2, -35.0)], 19: [(500, 600, -16.6, -56.4)]}),
    "crack-heterogeneous, tif": table("reference/fe-global_img_0570_tif_alpha1.csv", (0, 1, 2, 3)),
    "format-multipage": against(pages),
}


HEADS = ("images", "frames", "iterations, most", "zone", "nodes measured, least", "largest error")


def tried(program, name, reference, images, output, patience):
    folder = output / re.sub(r"\W+", "-", name)
    empty = [""] * (len(HEADS) - 2)
    words = [str(program), "correlate", "--overwrite", "--output", str(folder)]
    words += ["--reference", str(reference)] if reference else []
    try:
        ran = subprocess.run([*words, *map(str, images)], capture_output=True, text=True, timeout=patience)
    except subprocess.TimeoutExpired:
        return [name, f"longer than {patience} s", *empty]
    (output / f"{folder.name}.txt").write_text(ran.stderr)
    if ran.returncode == 2:
        said = ran.stderr.strip().splitlines()[-1].removeprefix("quadrille: ")
        return [name, f"refused: {said[:90]}", *empty]
    summary = json.load(open(folder / "summary.json"))
    states = ", ".join(f"{n} {state.replace('_', ' ')}" for state, n in sorted(summary["counts"].items()))
    iterations = [frame["iterations"] or 0 for frame in summary["frames"]]
    taken = f"{sum(iterations)}, {max(iterations)}" if iterations else ""
    zone = re.search(r"zones? found: ([\d %,]+?) of the image", ran.stderr)
    with_table = [frame for frame in summary["frames"] if (folder / f"csv/{frame['number']:06}.csv").is_file()]
    shares = [frame["nodes_measured"] / summary["n_nodes"] for frame in with_table]
    share = f"{100 * min(shares):.0f} %" if shares else "none"
    errors = []
    for frame in with_table if name in KNOWN else ():
        error, what = KNOWN[name](list(rows_of(folder / f"csv/{frame['number']:06}.csv")), frame, images[0].parent)
        if not math.isnan(error):
            errors.append((error, what, frame["number"]))
    worst = max(errors, default=None)
    return [name, states, taken, zone.group(1) if zone else "?", share, f"{worst[0]:.3f} px, {worst[1]}, frame {worst[2]}" if worst else "not known"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=pathlib.Path, help="folder whose subfolders hold images")
    parser.add_argument("--output", type=pathlib.Path, default=ROOT / "out" / "first")
    parser.add_argument("--quadrille", type=pathlib.Path, default=ROOT / "target" / "release" / "quadrille")
    parser.add_argument("--only", default="", help="names of sets, separated by commas")
    parser.add_argument("--patience", type=float, default=600.0, help="seconds for one set")
    arguments = parser.parse_args()
    if not arguments.data.is_dir():
        print(f"{arguments.data}: no folder; name one whose subfolders hold images", file=sys.stderr)
        return 2
    arguments.output.mkdir(parents=True, exist_ok=True)
    only = [name for name in arguments.only.split(",") if name]
    rows = [HEADS]
    for name, reference, images in sets_in(arguments.data.resolve()):
        if not only or any(name.startswith(one) for one in only):
            rows.append(tried(arguments.quadrille.resolve(), name, reference, images, arguments.output.resolve(), arguments.patience))
            print(f"{name}: {rows[-1][1]}", file=sys.stderr)
    widths = [max(len(row[k]) for row in rows) for k in range(len(HEADS))]
    for k, row in enumerate(rows):
        print("| " + " | ".join(cell.ljust(width) for cell, width in zip(row, widths)) + " |")
        if k == 0:
            print("|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return 0


if __name__ == "__main__":
    sys.exit(main())
