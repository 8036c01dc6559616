#!/usr/bin/env python3
"""How often the bands of tractions hold the truth: the virtual test from its images, over many seeds.

For every seed the virtual test is photographed anew, measured and identified as `quadrille run` does. Every node pair and
instant of traction-bands.csv, which report.html draws, is compared with truth/tractions.csv; the table gives per cent of T_n, T_t by
third of the joint and where the adhesive is compressed. The figures of one seed are right or wrong together: the last column
is the standard deviation of T_n over the seeds divided by their root.

    scripts/bands.py --seeds 10 --output out/bands
"""

import argparse
import csv
import math
import shutil
import subprocess
import sys
from pathlib import Path

NORMAL_95 = 1.959963984540054
PLACES = ["whole joint", "first third", "middle third", "last third", "compressed (T_n < 0)"]


def table(path):
    """Rows of a table of the program, as numbers by column."""
    with open(path) as file:
        lines = [line for line in file if not line.startswith("#")]
    return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(lines)]


def call(program, *words):
    done = subprocess.run([program, *map(str, words)], capture_output=True, text=True)
    if done.returncode not in (0, 1):
        sys.exit(f"quadrille {' '.join(map(str, words))}\n{done.stderr}")


def counts(folder):
    """By place: [within the band, within 1.96 std] of T_n and T_t, and how many there are."""
    truth = {}
    for row in table(folder / "test/truth/tractions.csv"):
        truth.setdefault(int(row["instant"]), []).append((row["x_mm"], row["Tn_MPa"], row["Tt_MPa"]))
    sums = [[[0, 0], [0, 0], 0] for _ in PLACES]
    for row in table(folder / "run/traction-bands.csv"):
        of_instant = truth[int(row["instant"])]
        # The joint of the virtual test lies along x and begins with the region measured.
        begin, end = (end_of(x for x, *_ in of_instant) for end_of in (min, max))
        end -= begin
        x, *exact = min(of_instant, key=lambda pair: abs(pair[0] - begin - row["along_mm"]))
        along = x - begin
        if abs(along - row["along_mm"]) > 1e-3 * end:
            sys.exit(f"{folder}: no true traction at {row['along_mm']} mm")
        places = [0, 1 + min(2, int(3 * along / end))] + ([4] if exact[0] < 0 else [])
        for c, name in enumerate(["Tn", "Tt"]):
            held = row[f"{name}_low95_MPa"] <= exact[c] <= row[f"{name}_high95_MPa"]
            linear = abs(row[f"{name}_MPa"] - exact[c]) <= NORMAL_95 * row[f"{name}_std_MPa"]
            for place in places:
                sums[place][c][0] += held
                sums[place][c][1] += linear
        for place in places:
            sums[place][2] += 1
    return sums


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", default="target/release/quadrille")
    parser.add_argument("--output", type=Path, default=Path("out/bands"))
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--keep", action="store_true", help="leave the folders of the seeds, and use those that are there")
    args = parser.parse_args()
    seeds = []
    for seed in range(1, args.seeds + 1):
        folder = args.output / str(seed)
        if not (args.keep and (folder / "run/fit.json").exists()):
            shutil.rmtree(folder, ignore_errors=True)
            call(args.program, "make", "virtual-test", "--seed", seed, "--output", folder / "test")
            call(args.program, "run", folder / "test/case.toml", "--output", folder / "run", "--quiet")
        seeds.append(counts(folder))
        if not args.keep:
            shutil.rmtree(folder)
        print(f"seed {seed}", file=sys.stderr, flush=True)
    print("| place | of | T_n in its band | T_t | T_n within 1.96 std | T_t | +- |")
    print("|---|---|---|---|---|---|---|")
    for place, name in enumerate(PLACES):
        n = sum(seed[place][2] for seed in seeds)
        share = lambda c, k: f"{100 * sum(seed[place][c][k] for seed in seeds) / n:.1f}"
        each = [100 * seed[place][0][0] / seed[place][2] for seed in seeds if seed[place][2]]
        mean = sum(each) / len(each)
        off = math.sqrt(sum((e - mean) ** 2 for e in each) / max(len(each) - 1, 1) / len(each))
        print(f"| {name} | {n} | {share(0, 0)} | {share(1, 0)} | {share(0, 1)} | {share(1, 1)} | {off:.1f} |")


if __name__ == "__main__":
    main()
