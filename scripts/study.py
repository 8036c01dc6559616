#!/usr/bin/env python3
"""Identification from images, over many seeds: errors, scatter and what the intervals hold.

For every seed the virtual test is photographed anew (another texture, other noise), measured and identified as `quadrille
run` does; the same fields are then identified under other weights. Prints one table, and writes every fit to OUTPUT/study.csv.

    scripts/study.py --seeds 20 --output out/study
"""

import argparse
import csv
import json
import math
import shutil
import subprocess
import sys
import time
from pathlib import Path

TRUTH = {"phi_n": 1.0, "delta_n": 0.005, "delta_t": 0.05}  # N/mm, mm, mm
# Name, keys of [measurement] for it.
VARIANTS = [
    ("covariance, boundary measured", {"weights": "covariance", "boundary": "measured"}),
    ("covariance, boundary estimated", {"weights": "covariance", "boundary": "estimated"}),
    ("uniform, all nodes", {"weights": "uniform", "boundary": "measured"}),
    ("paper, all nodes", {"weights": "paper", "boundary": "measured"}),
    ("paper, 80 nodes", {"weights": "paper", "boundary": "measured", "nodes": None}),
]


def call(program, *words, refused=False):
    """Runs the program; its exit status and what it said. Anything but 0 and 1 (did not converge, or rejected) ends the study,
    unless 2 (refused) is expected too."""
    done = subprocess.run([program, *map(str, words)], capture_output=True, text=True)
    if done.returncode not in ((0, 1, 2) if refused else (0, 1)):
        sys.exit(f"quadrille {' '.join(map(str, words))}\n{done.stderr}")
    return done.returncode, done.stderr.strip()


def selected(columns, rows):
    """The 80 nodes of `testbed paper` in the numbers of a correlation of two zones, lower zone first, rows downwards."""
    per_row = columns + 1
    per_zone = per_row * (rows + 1)
    thirds = [columns // 3, 2 * columns // 3]
    lower = [*range(1, columns), *(per_row + k for k in thirds)]
    face = rows * per_row
    upper = [*(face - per_row + k for k in thirds), *(face + k for k in range(1, columns))]
    return lower + [per_zone + k for k in upper]


def variant_of(text, keys):
    """The case `text` with other keys in [measurement], without figures."""
    lines, section = [], ""
    for line in text.splitlines():
        if line.startswith("["):
            section = line.strip()
        name = line.split("=")[0].strip()
        if section == "[measurement]" and name in keys:
            line = f"{name} = {json.dumps(keys[name])}"
        lines.append(line)
    return "\n".join(lines) + "\n\n[output]\nfigures = []\n"


def interval(p):
    """The ends of a 95 % interval; one that is not there is infinitely far away."""
    low, high = p["ends95"]
    return [-math.inf if low is None else low, math.inf if high is None else high]


def study(program, folder, seed, noise, depth, variants):
    """The fits of one series: `(variant, fit.json)`."""
    shutil.rmtree(folder, ignore_errors=True)
    call(program, "make", "virtual-test", "--seed", seed, "--noise", noise, "--depth", depth, "--output", folder / "test")
    call(program, "run", folder / "test/case.toml", "--output", folder / "run", "--quiet")
    text = (folder / "run/identify.toml").read_text()
    # File names in the case are relative to its folder.
    for number, (name, keys) in enumerate(variants):
        if number == 0:
            yield name, json.loads((folder / "run/fit.json").read_text())
            continue
        keys = dict(keys)
        if "nodes" in keys:
            keys["nodes"] = selected(39, 10)
        case = folder / f"run/variant-{number}.toml"
        case.write_text(variant_of(text, keys))
        call(program, "identify", case, "--output", folder / f"variant-{number}", "--quiet")
        yield name, json.loads((folder / f"variant-{number}/fit.json").read_text())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", default="target/release/quadrille")
    parser.add_argument("--output", type=Path, default=Path("out/study"))
    parser.add_argument("--seeds", type=int, default=20)
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    series = [(seed, 2, 8, VARIANTS) for seed in range(1, args.seeds + 1)]
    series += [(1, 0, depth, VARIANTS[:1]) for depth in (8, 16)] + [(1, 2, 16, VARIANTS[:1])]
    fits, begin = {}, time.monotonic()
    with open(args.output / "study.csv", "w", newline="") as out:
        table = csv.writer(out)
        table.writerow(["seed", "noise_grey", "depth_bits", "variant", "status", "parameter", "value", "std",
                        "discretisation", "low95", "high95", "truth", "omega", "omega_expected", "seconds"])
        for seed, noise, depth, variants in series:
            for name, fit in study(args.program, args.output / "series", seed, noise, depth, variants):
                fits.setdefault((noise, depth, name), []).append(fit)
                for key, truth in TRUTH.items():
                    p = fit["parameters"][key]
                    table.writerow([seed, noise, depth, name, fit["status"], key, p["value"], p["std"], p["discretisation"],
                                    *interval(p), truth, fit["omega"], fit["omega_expected"], fit["seconds"]])
            out.flush()
            print(f"{time.monotonic() - begin:7.1f} s  seed {seed}, noise {noise}, {depth} bit", file=sys.stderr)
    print("phi_n, delta_n, delta_t in %; intervals: how many hold the truth\n")
    print("| noise, depth | weights | fits | mean error | scatter | predicted std | element size | intervals | without it | all three |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for (noise, depth, name), list_ in fits.items():
        cells = {key: [] for key in ("mean", "scatter", "std", "size", "held", "noise")}
        for key, truth in TRUTH.items():
            found = [fit["parameters"][key] for fit in list_]
            errors = [100 * (p["value"] / truth - 1) for p in found]
            mean, n = sum(errors) / len(errors), len(errors)
            cells["mean"].append(f"{mean:+.2f}")
            scatter = math.sqrt(sum((e - mean) ** 2 for e in errors) / (n - 1)) if n > 1 else float("nan")
            cells["scatter"].append(f"{scatter:.2f}" if n > 1 else "-")
            cells["std"].append(f"{sum(100 * p['std'] / truth for p in found) / n:.2f}")
            cells["size"].append(f"{sum(100 * (p['discretisation'] or 0) / truth for p in found) / n:+.2f}")
            cells["held"].append(str(sum(interval(p)[0] <= truth <= interval(p)[1] for p in found)))
            cells["noise"].append(str(sum(abs(p["value"] - truth) <= 1.959964 * p["std"] for p in found)))
        ends = lambda fit, key: interval(fit["parameters"][key])
        holds = lambda fit, key: ends(fit, key)[0] <= TRUTH[key] <= ends(fit, key)[1]
        cells["all"] = [str(sum(all(holds(fit, key) for key in TRUTH) for fit in list_))]
        converged = sum(fit["status"] == "converged" for fit in list_)
        row = [f"{noise} grey, {depth} bit", name, f"{converged} of {len(list_)} converged"]
        print("| " + " | ".join(row + [", ".join(cells[k]) for k in ("mean", "scatter", "std", "size", "held", "noise", "all")]) + " |")


if __name__ == "__main__":
    main()
