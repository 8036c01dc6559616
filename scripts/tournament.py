#!/usr/bin/env python3
"""Which law: truths of every kind on the virtual test, noise on every displacement, and what `quadrille tournament` says.

The boundary of the virtual test (or of a small joint, --small) moves a joint whose adhesive is of the true law (`quadrille simulate`); white noise goes onto the
displacements of all nodes, and the tournament gets them with the noise stated. The case starts the extended law of Xu and
Needleman, whatever the truth is. A tournament is right when the true law is the one chosen or among those that are named as not to
be told apart. Printed is how often that is so, how many laws are left, and how often the averaged works and tractions (at tenths
of the reach of the true law) hold the truth in their 95 % intervals. Every law of every draw is written to OUTPUT/tournament.csv.

With --images nothing is simulated for the program: the virtual test is photographed with an adhesive of the true law (`quadrille
virtual --law`), another texture and other noise for every seed, and `quadrille run` gets the images and the case file beside them.

    scripts/tournament.py --seeds 20 --output out/tournament
    scripts/tournament.py --images --noise 2 --instants 6 --seeds 5 --output out/tournament-images
"""

import argparse
import csv
import json
import math
import random
import re
import shutil
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from study import call

PX = 0.00193125  # mm
LAWS = ["extended-xu-needleman", "xu-needleman", "bilinear-power", "trapezoidal-power", "park-paulino-roesler", "smith-ferrante"]
# The true laws: parameters, works of separation in opening and sliding (N/mm).
TRUTHS = {
    "extended-xu-needleman": ({"phi_n_N_per_mm": 1.0, "delta_n_mm": 0.005, "delta_t_mm": 0.05, "r": 4.0}, (1.0, 4.0)),
    "xu-needleman": ({"phi_n_N_per_mm": 1.0, "delta_n_mm": 0.005, "delta_t_mm": 0.05, "q": 4.0, "r_star": 0.0}, (1.0, 4.0)),
    "bilinear-power": ({"K_MPa_per_mm": 2e4, "T_n0_MPa": 60.0, "T_t0_MPa": 60.0, "G_Ic_N_per_mm": 1.0,
                        "G_IIc_N_per_mm": 4.0, "eta": 1.0}, (1.0, 4.0)),
    "trapezoidal-power": ({"K_MPa_per_mm": 2e4, "T_n0_MPa": 50.0, "T_t0_MPa": 50.0, "G_Ic_N_per_mm": 1.0,
                           "G_IIc_N_per_mm": 4.0, "eta": 1.0, "plateau": 0.4}, (1.0, 4.0)),
    "park-paulino-roesler": ({"phi_n_N_per_mm": 1.0, "phi_t_N_per_mm": 4.0, "T_n0_MPa": 60.0, "T_t0_MPa": 60.0, "alpha": 3.0,
                              "beta": 3.0, "lambda_n": 0.1, "lambda_t": 0.1}, (1.0, 4.0)),
}


def table(path):
    """Rows of a table of the program, by the names of its columns."""
    with open(path) as lines:
        return list(csv.DictReader(line for line in lines if not line.startswith("#")))


def small_joint(folder, columns=24, rows=4, instants=12, size=0.0309, gap=0.06):
    """A joint of few elements that is peeled open from its right end and slid: its border in `folder`, and its tables."""
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / "border.csv", "w") as out:
        out.write("instant,node,x_mm,y_mm,ux_mm,uy_mm\n")
        for instant in range(1, instants + 1):
            t = 6.0 * instant / instants
            for strip, (side, bottom) in enumerate(((-1, -gap / 2 - rows * size), (1, gap / 2))):
                for j in range(rows + 1):
                    for i in range(columns + 1):
                        if i in (0, columns) or j == (rows if strip else 0):
                            node, x, y = (strip * (rows + 1) + j) * (columns + 1) + i, i * size, bottom + j * size
                            out.write(f"{instant},{node},{x},{y},{side * 0.006 * t},{side * 0.004 * t * (0.1 + 4 * x)}\n")
    return (f"[mesh]\nelement_size_mm = {size}\ncolumns = {columns}\nrows = {rows}\ngap_mm = {gap}\n"
            f'[boundary]\nfile = "{(folder / "border.csv").resolve()}"\n[substrate]\nE_MPa = 72000.0\nnu = 0.33\n'
            "sigma_0_MPa = 180.0\nalpha = 0.06\nn = 7.0\nexact = true\n\n")


def virtual_joint(test):
    """The joint of the virtual test in `test`: its tables."""
    substrate = re.search(r"\[substrate\]\n(?:.+\n)+", (test / "case.toml").read_text())[0]
    substrate = re.sub(r"^exact = .*\n", "", substrate, flags=re.M) + "exact = true\n"
    truth = (test / "truth").resolve()
    return (f'[mesh]\nfile = "{truth / "mesh.json"}"\n[boundary]\nfile = "{truth / "boundary_displacements.csv"}"\n'
            f"{substrate}\n")


def simulated(program, head, output, name):
    """Displacements of the joint with a true law, and the law's tractions in pure opening and sliding: functions of mm."""
    keys, _ = TRUTHS[name]
    folder = output / name
    folder.mkdir(parents=True, exist_ok=True)
    law = "".join(f"{key} = {value}\n" for key, value in keys.items())
    (folder / "simulate.toml").write_text(f'{head}[cohesive]\nmodel = "{name}"\n{law}[output]\nfigures = []\n')
    if not (folder / "simulate/solution.csv").exists():
        call(program, "simulate", folder / "simulate.toml", "--output", folder / "simulate", "--quiet", "--overwrite")
    return table(folder / "simulate/solution.csv")


def traction(name, value, mode, s):
    """Traction of a law with the parameters `value` (in their order) at the jump `s` (mm) in a pure mode, from its published formula
    (corners rounded as documented)."""
    if name in ("extended-xu-needleman", "xu-needleman"):
        phi_n, delta_n, delta_t, r = value[:4]
        if mode == 0:
            return phi_n / delta_n * (s / delta_n) * math.exp(-s / delta_n)
        return 2 * r * phi_n / delta_t * (s / delta_t) * math.exp(-((s / delta_t) ** 2))
    if name == "park-paulino-roesler":
        phi, strength, alpha, share = value[mode], value[2 + mode], value[4 + mode], value[6 + mode]
        m = alpha * (alpha - 1) * share**2 / (1 - alpha * share**2)
        form = lambda x: (alpha + m) * alpha / m * x * (1 - x) ** (alpha - 1) * (1 + alpha / m * x) ** (m - 1)
        end = phi / strength * form(share)
        return phi / end * form(s / end) if s < end else 0.0
    stiffness, strength, work = value[0], value[1 + mode], value[3 + mode]
    plateau = value[6] if len(value) > 6 else 0.0
    onset = strength / stiffness
    end = (2 * work / strength + plateau * onset) / (1 + plateau)
    top = onset + plateau * (end - onset)
    slope = strength / (end - top)

    def ramp(x, width):
        return 0.0 if x <= -width else x if x >= width else (x + width) ** 2 / (4 * width)

    width = 0.1 * onset
    return (stiffness * s - stiffness * ramp(s - onset, width) - slope * ramp(s - top, width)
            + slope * ramp(s - end, width * math.sqrt(stiffness / slope + 1)))


def reach(name, value, mode):
    """The jump (mm) beyond which a law has less than a fiftieth of its largest traction."""
    points = [1e-4 * k for k in range(1, 5000)]
    values = [traction(name, value, mode, s) for s in points]
    return max(s for s, value in zip(points, values) if value > 0.02 * max(values))


def draw(program, head, output, rows, name, noise_px, seed):
    """One tournament: its record, the table of tractions, seconds."""
    folder = output / name / f"{noise_px}-{seed}"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    noise, normal = noise_px * PX, random.Random(f"{name} {noise_px} {seed}")
    with open(folder / "measured.csv", "w") as out:
        out.write("instant,node,ux_mm,uy_mm\n")
        for row in rows:
            u = [float(row[key]) + normal.gauss(0, noise) for key in ("ux_mm", "uy_mm")]
            out.write(f"{row['instant']},{row['node']},{u[0]:.17e},{u[1]:.17e}\n")
    (folder / "case.toml").write_text(
        f'{head}[cohesive]\nphi_n_N_per_mm = 1.5\ndelta_n_mm = 0.0035\ndelta_t_mm = 0.07\nr = 3.0\n'
        f'[measurement]\nfile = "measured.csv"\nnodes = "free"\nweights = "covariance"\nboundary = "exact"\n'
        f'common_reference = false\nnoise_mm = {noise}\n[fit]\nparameters = ["phi_n", "delta_n", "delta_t", "r"]\n'
        f'laws = {json.dumps(LAWS)}\nexact = true\ndiscretisation = "off"\n')
    begin = time.monotonic()
    call(program, "tournament", folder / "case.toml", "--output", folder / "laws", "--quiet", "--threads", 1)
    seconds = time.monotonic() - begin
    return json.loads((folder / "laws/tournament.json").read_text()), table(folder / "laws/tournament-tractions.csv"), seconds


def photographed(program, output, name, noise_grey, instants, seed):
    """One tournament from images: its record, the table of tractions, seconds, parameters of the truth."""
    folder = output / name / f"{noise_grey}-{seed}"
    shutil.rmtree(folder, ignore_errors=True)
    test = folder / "test"
    call(program, "virtual", "--law", name, "--noise", noise_grey, "--instants", instants, "--seed", seed, "--output", test,
         "--threads", 1)
    truth = json.loads((test / "truth.json").read_text())["parameters"]
    case = (test / "case.toml").read_text()
    (test / "case.toml").write_text(case.replace("[fit]\n", f"[fit]\nlaws = {json.dumps(LAWS)}\n"))
    begin = time.monotonic()
    call(program, "run", test / "case.toml", "--output", folder / "run", "--quiet", "--threads", 1, "--device", "cpu")
    seconds = time.monotonic() - begin
    shutil.rmtree(test / "images")
    record = json.loads((folder / "run/tournament.json").read_text())
    return record, table(folder / "run/tournament-tractions.csv"), seconds, list(truth.values())


def holds(ends, truth):
    return (ends[0] is None or ends[0] <= truth) and (ends[1] is None or truth <= ends[1])


def at(rows, mode, s):
    """Band of the average at the jump `s`: interpolated."""
    curve = [(float(r["jump_mm"]), float(r["low95_MPa"]), float(r["high95_MPa"])) for r in rows
             if r["law"] == "0" and r["mode"] == str(mode + 1)]
    for (a, low_a, high_a), (b, low_b, high_b) in zip(curve, curve[1:]):
        if a <= s <= b:
            share = (s - a) / (b - a)
            # Where the data give no band its ends are infinite.
            between = lambda a, b: a + share * (b - a) if math.isfinite(a) and math.isfinite(b) else min(a, b, key=lambda v: -abs(v))
            return between(low_a, low_b), between(high_a, high_b)
    return None


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", default="target/release/quadrille")
    parser.add_argument("--output", type=Path, default=Path("out/tournament"))
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--noise", type=float, nargs="+", default=[0.03, 0.3], help="px; grey levels with --images")
    parser.add_argument("--images", action="store_true", help="from images of the virtual test with an adhesive of the true law")
    parser.add_argument("--truths", nargs="+", default=list(TRUTHS), choices=list(TRUTHS))
    parser.add_argument("--small", action="store_true", help="a joint of 24 x 4 elements for the virtual test")
    parser.add_argument("--instants", type=int, default=12, help="of the small joint, and of the images")
    parser.add_argument("--jobs", type=int, default=2)
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    test, data = args.output / "test", {}
    if not args.images:
        if args.small:
            head = small_joint(test, instants=args.instants)
        else:
            if not (test / "truth.json").exists():
                call(args.program, "virtual", "--output", test)
            head = virtual_joint(test)
        data = {name: simulated(args.program, head, args.output, name) for name in args.truths}
    print("truth                  px    right  chosen alone  left (mean)  works held  tractions held  seconds")
    with open(args.output / "tournament.csv", "w", newline="") as out, ThreadPoolExecutor(args.jobs) as pool:
        written = csv.writer(out)
        written.writerow(["truth", "noise_px", "seed", "law", "status", "rejected", "omega", "aic", "left_out_omega", "weight",
                          "alike", "evaluations"])
        for name in args.truths:
            for noise in args.noise:
                def one(seed, name=name, noise=noise):
                    if args.images:
                        return photographed(args.program, args.output, name, noise, args.instants, seed)
                    return *draw(args.program, head, args.output, data[name], name, noise, seed), list(TRUTHS[name][0].values())
                right, alone, left, works, tractions, seconds, n = 0, 0, 0, [], [], 0.0, 0
                for seed, (record, rows, took, value) in zip(range(1, args.seeds + 1), pool.map(one, range(1, args.seeds + 1))):
                    n, seconds, left = n + 1, seconds + took, left + len(record["alike"])
                    right += name in record["alike"]
                    alone += record["alike"] == [name]
                    for law in record["laws"]:
                        written.writerow([name, noise, seed, law["law"], law["status"], law["rejected"], law["omega"], law["aic"],
                                          law["left_out_omega"], law["weight"], law["law"] in record["alike"],
                                          law["evaluations"]])
                    out.flush()
                    if record["average"] is None:
                        continue
                    # The law of the images has the works of the default one: 1 and 4 N/mm too.
                    for key, truth in zip(("opening_work", "sliding_work"), TRUTHS[name][1]):
                        works.append(holds(record["average"][key]["ends95"], truth))
                    for mode in (0, 1):
                        end = reach(name, value, mode)
                        for k in range(1, 10):
                            s = 0.1 * k * end
                            band = at(rows, mode, s)
                            if band is not None:
                                tractions.append(holds(band, traction(name, value, mode, s)))
                share = lambda held: f"{sum(held)} of {len(held)}"
                print(f"{name:21}  {noise:<4}  {right:2} of {n:<2}  {alone:2}  {left / n:4.1f}  {share(works)}  {share(tractions)}"
                      f"  {seconds / n:.1f}", flush=True)


if __name__ == "__main__":
    main()
