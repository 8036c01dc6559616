#!/usr/bin/env python3
"""Which law: truths of every kind on the virtual test, noise on every displacement, and what `quadrille identify --tournament` says.

The boundary of the virtual test (or of a small joint, --small) moves a joint whose adhesive is of the true law (`quadrille simulate`); white noise goes onto the
displacements of all nodes, and the tournament gets them with the noise stated. The case starts the extended law of Xu and
Needleman, whatever the truth is. A tournament is right when the true law is the one chosen or among those that are named as not to
be told apart. Printed is how often that is so, how many laws are left, and how often the averaged works and tractions (at tenths
of the reach of the true law) hold the truth in their 95 % intervals. Every law of every draw is written to OUTPUT/tournament.csv.
A draw that is in OUTPUT already is not computed again. With --again nothing is computed at all: the draws that are in OUTPUT are read, and
which laws are told apart and what their averages hold is worked out here, by the rule of docs/identification.md and not by the program
(which may have had another rule when they were made; --scatter 0 is one that is too narrow).

With --images nothing is simulated for the program: the virtual test is photographed with an adhesive of the true law (`quadrille
make virtual-test --law`), another texture and other noise for every seed, and `quadrille run` gets the images and the case file beside them.

    scripts/tournament.py --seeds 20 --output out/tournament
    scripts/tournament.py --images --noise 2 --instants 6 --seeds 5 --output out/tournament-images
    scripts/tournament.py --again --small --instants 6 --noise 0.3 --output out/tournament
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
# The data are computed with small rotations.
EXACT = '["thickness", "faces", "pixel_size", "noise_level", "rotations"]'
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


def finished(folder):
    return (folder / "tournament.json").exists() and (folder / "tournament-tractions.csv").exists()


def read(folder):
    """Record and table of tractions of a tournament."""
    return json.loads((folder / "tournament.json").read_text()), table(folder / "tournament-tractions.csv")


def draw(program, head, output, rows, name, noise_px, seed):
    """One tournament: its record, the table of tractions, seconds."""
    folder = output / name / f"{noise_px}-{seed}"
    if finished(folder / "laws"):
        return *read(folder / "laws"), 0.0
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
        f'laws = {json.dumps(LAWS)}\nexact = {EXACT}\ndiscretisation = "off"\n')
    begin = time.monotonic()
    call(program, "identify", folder / "case.toml", "--tournament", "--output", folder / "laws", "--quiet", "--threads", 1)
    return *read(folder / "laws"), time.monotonic() - begin


def photographed(program, output, name, noise_grey, instants, seed):
    """One tournament from images: its record, the table of tractions, seconds, parameters of the truth."""
    folder = output / name / f"{noise_grey}-{seed}"
    test = folder / "test"
    if finished(folder / "run"):
        return *read(folder / "run"), 0.0, list(json.loads((test / "truth.json").read_text())["parameters"].values())
    shutil.rmtree(folder, ignore_errors=True)
    call(program, "make", "virtual-test", "--law", name, "--noise", noise_grey, "--instants", instants, "--seed", seed, "--output", test,
         "--threads", 1)
    truth = json.loads((test / "truth.json").read_text())["parameters"]
    case = (test / "case.toml").read_text()
    (test / "case.toml").write_text(case.replace("[fit]\n", f"[fit]\nlaws = {json.dumps(LAWS)}\n"))
    begin = time.monotonic()
    call(program, "run", test / "case.toml", "--output", folder / "run", "--quiet", "--threads", 1, "--device", "cpu")
    seconds = time.monotonic() - begin
    shutil.rmtree(test / "images")
    return *read(folder / "run"), seconds, list(truth.values())


def holds(ends, truth):
    return (ends[0] is None or ends[0] <= truth) and (ends[1] is None or truth <= ends[1])


def at(rows, law, mode, s):
    """Traction and band of a law (0: the average; 1, 2... in the order of the case) at the jump `s`: interpolated."""
    curve = [[float(r[key]) for key in ("jump_mm", "traction_MPa", "low95_MPa", "high95_MPa")] for r in rows
             if r["law"] == str(law) and r["mode"] == str(mode + 1)]
    for (a, *first), (b, *second) in zip(curve, curve[1:]):
        if a <= s <= b:
            share = (s - a) / (b - a)
            # Where the data give no band its ends are infinite.
            between = lambda a, b: a + share * (b - a) if math.isfinite(a) and math.isfinite(b) else min(a, b, key=lambda v: -abs(v))
            return [between(a, b) for a, b in zip(first, second)]
    return None


def of_program(record, rows):
    """What the program says of a draw: laws that are not told apart, ends of the averaged works, band of the averaged traction."""
    average = record["average"]
    if average is None:
        return record["alike"], None, None
    return (record["alike"], [average[key]["ends95"] for key in ("opening_work", "sliding_work")],
            lambda mode, s: (at(rows, 0, mode, s) or [None])[1:] or None)


def of_rule(record, rows, scatter):
    """The same by the rule of docs/identification.md, from what the program says of each law. Two laws are told apart where their objectives differ by
    more than the 99 % quantile of chi-square less chi-square (normal approximation). An average holds of each law's interval the share
    that is left of the likelihood over all laws: omega above the best less what noise does (`scatter` standard deviations of it free)."""
    laws = {law["law"]: (index + 1, law, len(law["parameters"])) for index, law in enumerate(record["laws"])}
    left = {name: law for name, law in laws.items()
            if law[1]["status"] == "converged" and not law[1]["rejected"] and law[1]["aic"] is not None}
    if not left:
        return [], None, None
    _, best, free = min(left.values(), key=lambda law: law[1]["aic"])
    above = {name: law["omega"] - best["omega"] for name, (_, law, _) in left.items()}
    spread = {name: math.sqrt(2 * (free + p)) for name, (_, _, p) in left.items()}
    alike = [name for name, (_, _, p) in left.items() if above[name] <= free - p + 2.326 * spread[name]]
    shares = {}
    for name, (index, law, p) in left.items():
        beyond = max(0.0, above[name] - (free - p) - scatter * spread[name])
        if beyond < 1.96**2:
            shares[name] = (index, law, math.sqrt(1 - beyond / 1.96**2))
    shrink = lambda share, value, end, none: none if end is None or not math.isfinite(end) else value + share * (end - value)
    works = [[min(shrink(share, law[key]["value"], law[key]["ends95"][0], -math.inf) for _, law, share in shares.values()),
              max(shrink(share, law[key]["value"], law[key]["ends95"][1], math.inf) for _, law, share in shares.values())]
             for key in ("opening_work", "sliding_work")]

    def band(mode, s):
        bands = [(share, at(rows, index, mode, s)) for index, _, share in shares.values()]
        bands = [(share, *band) for share, band in bands if band]
        return bands and (min(shrink(share, value, low, -math.inf) for share, value, low, _ in bands),
                          max(shrink(share, value, high, math.inf) for share, value, _, high in bands))
    return alike, works, band


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
    parser.add_argument("--again", action="store_true", help="compute nothing: the rule on the draws that are in OUTPUT")
    parser.add_argument("--scatter", type=float, help="with --again: standard deviations of what noise does that count whole (default 1)")
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    if args.scatter is not None and not args.again:
        parser.error("--scatter goes with --again")
    test, head, data = args.output / "test", None, {}
    if not args.images and not args.again:
        if args.small:
            head = small_joint(test, instants=args.instants)
        else:
            if not (test / "truth.json").exists():
                call(args.program, "make", "virtual-test", "--output", test)
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
                    folder = args.output / name / f"{noise}-{seed}"
                    if args.again and not finished(folder / ("run" if args.images else "laws")):
                        return None
                    if args.images:
                        return photographed(args.program, args.output, name, noise, args.instants, seed)
                    return *draw(args.program, head, args.output, data.get(name), name, noise, seed), list(TRUTHS[name][0].values())
                right, alone, left, works, tractions, seconds, n = 0, 0, 0, [], [], [], 0
                for seed, done in zip(range(1, args.seeds + 1), pool.map(one, range(1, args.seeds + 1))):
                    if done is None:
                        continue
                    record, rows, took, value = done
                    alike, ends, band = of_rule(record, rows, 1.0 if args.scatter is None else args.scatter) if args.again else of_program(record, rows)
                    n, left = n + 1, left + len(alike)
                    seconds += [took] if took else []
                    right += name in alike
                    alone += alike == [name]
                    for law in record["laws"]:
                        written.writerow([name, noise, seed, law["law"], law["status"], law["rejected"], law["omega"], law["aic"],
                                          law["left_out_omega"], law["weight"], law["law"] in alike,
                                          law["evaluations"]])
                    out.flush()
                    if ends is None:
                        continue
                    # The law of the images has the works of the default one: 1 and 4 N/mm too.
                    works += [holds(*pair) for pair in zip(ends, TRUTHS[name][1])]
                    for mode in (0, 1):
                        end = reach(name, value, mode)
                        for k in range(1, 10):
                            s = 0.1 * k * end
                            interval = band(mode, s)
                            if interval:
                                tractions.append(holds(interval, traction(name, value, mode, s)))
                if n == 0:
                    continue
                share = lambda held: f"{sum(held)} of {len(held)} ({100 * sum(held) / max(1, len(held)):.1f} %)"
                print(f"{name:21}  {noise:<4}  {right:2} of {n:<2}  {alone:2}  {left / n:4.1f}  {share(works)}  {share(tractions)}"
                      f"  {sum(seconds) / max(1, len(seconds)):.1f}", flush=True)


if __name__ == "__main__":
    main()
