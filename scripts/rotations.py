#!/usr/bin/env python3
"""Arms that turn: what finite and small rotations find of the law, over angles and draws of the noise.

A joint is computed with finite rotations on a mesh twice as fine (`quadrille simulate`), its displacements get noise of 0.02 px, and
`quadrille identify` looks for the law on the coarser mesh, with finite and with small rotations. In a DCB both arms turn, each by the angle,
in a peel test the upper one alone. Every fit is written to OUTPUT/rotations.csv.

    scripts/rotations.py --draws 8 --output out/rotations
"""

import argparse
import csv
import json
import math
import random
import statistics
import sys
from pathlib import Path

from study import call

PROGRAM = "target/release/quadrille"
SIZE, GAP, ROWS, INSTANTS = 0.0309, 0.06, 4, 6
NOISE = 0.02 * SIZE / 16.0
TRUTH = {"phi_n": 1.0, "delta_n": 0.005, "delta_t": 0.05}
STRIPS = "[substrate]\nE_MPa = 72000.0\nnu = 0.33\nsigma_0_MPa = 180.0\nalpha = 0.06\nn = 7.0\nexact = true\n"


def mesh(columns, size):
    """Nodes as `quadrille` numbers those of a rectangle: strip by strip, row by row from below."""
    rows = round(ROWS * SIZE / size)
    for strip in range(2):
        for row in range(rows + 1):
            for column in range(columns + 1):
                y = 0.5 * GAP + row * size if strip else row * size - rows * size - 0.5 * GAP
                yield column * size, y, column in (0, columns) or row == (rows if strip else 0), (row, column)


def border(test, degrees, columns):
    """How the outer nodes of the finer mesh move: the middle of each arm bends, without getting longer, behind a front that goes on."""
    theta, pieces = math.radians(degrees), 200
    # Arms bend over a longer way the more they turn: strains stay small.
    width = 0.1 * math.sqrt(degrees / 2.0)
    length = columns * SIZE
    for k in range(1, INSTANTS + 1):
        front = length - 0.12 - 0.08 * k
        for node, (x, y, outer, _) in enumerate(mesh(2 * columns, SIZE / 2)):
            if not outer:
                continue
            side = 1.0 if y > 0 else -1.0
            turns = side if test == "dcb" or y > 0 else 0.0
            middle = side * (0.5 * GAP + 0.5 * ROWS * SIZE)
            angle = lambda at: turns * theta / (1.0 + math.exp(-(at - front) / width))
            step = x / pieces
            a = sum(step * math.cos(angle((i + 0.5) * step)) for i in range(pieces))
            b = sum(step * math.sin(angle((i + 0.5) * step)) for i in range(pieces))
            sin, cos = math.sin(angle(x)), math.cos(angle(x))
            ux = a - (y - middle) * sin + side * 4e-4 * k - x
            uy = b + middle + (y - middle) * cos - y
            yield k, node, x, y, ux, uy


def cohesive(kinematics, phi_n, delta_n, delta_t):
    return (f"[cohesive]\nphi_n_N_per_mm = {phi_n}\ndelta_n_mm = {delta_n}\ndelta_t_mm = {delta_t}\nr = 4.0\nexact = true\n"
            f'kinematics = "{kinematics}"\n')


def truth(folder, test, degrees, columns):
    """Solves the finer joint; gives the displacements of the nodes of the coarser one, instant by instant."""
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / "fine.csv", "w") as out:
        out.write("instant,node,x_mm,y_mm,ux_mm,uy_mm\n")
        for row in border(test, degrees, columns):
            out.write(",".join(map(repr, row)) + "\n")
    case = (f"[mesh]\nelement_size_mm = {SIZE / 2}\ncolumns = {2 * columns}\nrows = {2 * ROWS}\ngap_mm = {GAP}\n"
            f'[boundary]\nfile = "fine.csv"\n{STRIPS}{cohesive("finite", *TRUTH.values())}'
            "[output]\nfigures = []\nenergies = false\n")
    (folder / "fine.toml").write_text(case)
    call(PROGRAM, "simulate", folder / "fine.toml", "--output", folder / "fine", "--overwrite", "--quiet")
    coarse = {}
    for node, (*_, (row, column)) in enumerate(mesh(2 * columns, SIZE / 2)):
        if row % 2 == 0 and column % 2 == 0:
            coarse[node] = len(coarse)
    fields = [[None] * len(coarse) for _ in range(INSTANTS)]
    with open(folder / "fine" / "solution.csv") as text:
        for row in csv.reader(line for line in text if not line.startswith(("#", "instant"))):
            if int(row[1]) in coarse:
                fields[int(row[0]) - 1][coarse[int(row[1])]] = [float(row[2]), float(row[3])]
    return fields


def fitted(folder, fields, columns, kinematics, seed):
    """`fit.json` of one draw of the noise."""
    draw = random.Random(seed)
    nodes = list(mesh(columns, SIZE))
    with open(folder / "border.csv", "w") as out, open(folder / "measured.csv", "w") as measured:
        out.write("instant,node,x_mm,y_mm,ux_mm,uy_mm\n")
        measured.write("instant,node,ux_mm,uy_mm\n")
        for k, field in enumerate(fields, 1):
            for node, ((x, y, outer, _), (ux, uy)) in enumerate(zip(nodes, field)):
                if outer:
                    out.write(f"{k},{node},{x!r},{y!r},{ux!r},{uy!r}\n")
                measured.write(f"{k},{node},{ux + draw.gauss(0, NOISE)!r},{uy + draw.gauss(0, NOISE)!r}\n")
    case = (f"[mesh]\nelement_size_mm = {SIZE}\ncolumns = {columns}\nrows = {ROWS}\ngap_mm = {GAP}\n"
            f'[boundary]\nfile = "border.csv"\n{STRIPS}{cohesive(kinematics, 1.2, 0.0045, 0.06)}'
            '[measurement]\nfile = "measured.csv"\nnodes = "free"\nweights = "uniform"\nboundary = "exact"\n'
            f"noise_mm = {NOISE}\ncommon_reference = false\n"
            '[fit]\nparameters = ["phi_n", "delta_n", "delta_t"]\ndiscretisation = "included"\nintervals = "linear"\n'
            'bootstrap = 0\nexact = ["thickness", "faces", "pixel_size", "noise_level"]\n[output]\nfigures = []\n')
    (folder / "case.toml").write_text(case)
    call(PROGRAM, "identify", folder / "case.toml", "--output", folder / "fit", "--overwrite", "--quiet")
    return json.loads((folder / "fit" / "fit.json").read_text())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", default="target/release/quadrille")
    parser.add_argument("--draws", type=int, default=8)
    parser.add_argument("--tests", nargs="+", choices=("dcb", "peel"), default=["dcb", "peel"])
    parser.add_argument("--angles", type=float, nargs="+", default=[2.0, 5.0, 10.0, 20.0])
    parser.add_argument("--output", type=Path, required=True)
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    global PROGRAM
    PROGRAM = args.program
    rows = []
    head = "| test | angle, degrees | rotations | mean error | scatter | std | element size | errors below 1.5 std | intervals hold | determined |"
    print(head + "\n|" + "---|" * 10)
    for test in args.tests:
        for degrees in args.angles:
            columns = round(24 * math.sqrt(degrees / 2.0))
            folder = args.output / f"{test}-{degrees:g}"
            fields = truth(folder, test, degrees, columns)
            for kinematics in ("finite", "objective"):
                fits = [fitted(folder, fields, columns, kinematics, seed) for seed in range(1, args.draws + 1)]
                cells = {what: [] for what in ("error", "scatter", "std", "size")}
                near = held = 0
                for name, true in TRUTH.items():
                    found = [fit["parameters"][name] for fit in fits]
                    errors = [100.0 * (p["value"] / true - 1.0) for p in found]
                    stds = [100.0 * p["std"] / true for p in found]
                    sizes = [100.0 * (p["discretisation"] or math.nan) / true for p in found]
                    near += sum(abs(e) < 1.5 * s for e, s in zip(errors, stds))
                    held += sum(p["interval95"] is not None and p["interval95"][0] <= true <= p["interval95"][1] for p in found)
                    cells["error"].append(statistics.fmean(errors))
                    cells["scatter"].append(statistics.stdev(errors) if len(errors) > 1 else math.nan)
                    cells["std"].append(statistics.fmean(stds))
                    cells["size"].append(statistics.fmean(sizes))
                    rows += [[test, degrees, kinematics, seed, name, e, s, d, fit["verdict"]["outcome"]]
                             for seed, (e, s, d, fit) in enumerate(zip(errors, stds, sizes, fits), 1)]
                told = {what: ", ".join(f"{value:{'+' if what in ('error', 'size') else ''}.2f}" for value in list_)
                        for what, list_ in cells.items()}
                determined = sum(fit["verdict"]["determined"] for fit in fits)
                n = 3 * len(fits)
                print(f"| {test} | {degrees:g} | {'finite' if kinematics == 'finite' else 'small'} | {told['error']} | {told['scatter']} | "
                      f"{told['std']} | {told['size']} | {near} of {n} | {held} of {n} | {determined} of {len(fits)} |", flush=True)
    with open(args.output / "rotations.csv", "w", newline="") as out:
        table = csv.writer(out)
        table.writerow(["test", "degrees", "kinematics", "seed", "parameter", "error_percent", "std_percent", "element_size_percent", "outcome"])
        table.writerows(rows)


if __name__ == "__main__":
    sys.exit(main())
