#!/usr/bin/env python3
"""Load curves of real tests through `quadrille identify`: what the curve alone says of the adhesive, beside what was published.

    scripts/real_curves.py DATA [--quadrille PROGRAM] [--output FOLDER] [--only dcb,lap] [--tests 1,3,7]

DATA is the folder with dcb-curves/ (github DCHartlen/CompliantCrackEquivalenceMethods, cfa1899, MIT) and fesma-lapshear/ (github
Lingzhen-Li/Fe-SMA-to-steel_debonding_model, 7abef6f); nothing of it is copied.

    dcb   a laminate, after de Gracia et al. 2015: opening against load. The modulus is that with which a beam meets the first part of
          the curve; beside what is fitted stands the energy release rate of the beam whose crack is as long as the compliance says,
          at the peak and at the end of the curve (no number comes with the data)
    lap   strips of a shape memory alloy on steel: the coupon's curve is the strip's (`tabulated`), the work of separation in sliding
          is fitted to the load that the long bond bears; published is the work that was measured along the bond

Printed is a table; exit status 1 where a fit does not end. Needs numpy."""

import argparse
import json
import math
import pathlib
import subprocess
import sys

try:
    import numpy as np
except ImportError:
    sys.exit("real_curves.py needs numpy: pip install -r scripts/requirements.txt")

ROOT = pathlib.Path(__file__).resolve().parent.parent


class Program:
    def __init__(self, path):
        self.path, self.failed = path, 0

    def __call__(self, *words):
        words = [self.path, *map(str, words)]
        done = subprocess.run(words, capture_output=True, text=True)
        if done.returncode == 2:
            sys.exit(f"{' '.join(words)}\n{done.stderr}")
        return done

    def fit(self, folder):
        self("identify", folder / "case.toml", "--output", folder / "fit", "--overwrite", "--quiet")
        file = folder / "fit" / "fit.json"
        if not file.exists():
            self.failed += 1
            return None
        return json.loads(file.read_text())


def row(*cells):
    print("| " + " | ".join(cells) + " |", flush=True)


def outcome(fit):
    return fit["verdict"]["outcome"] if fit["status"] == "converged" else f"not converged ({fit['status']})"


def told(fit, key):
    """Value and standard uncertainty of a parameter."""
    found = fit["parameters"][key]
    # Of a fit that did not converge the values are the best so far, and say nothing of how sure they are.
    std = found["std"] if fit["status"] == "converged" else None
    return f"{found['value']:.4g}" + (f" ± {std:.2g}" if std else ""), found["value"]


def table(path, columns):
    path.write_text("\n".join([",".join(columns), *(",".join(repr(float(v)) for v in line) for line in zip(*columns.values()))]) + "\n")


# --- A double cantilever beam ------------------------------------------------------------------------------------------

ARM, WIDTH, CRACK, LENGTH = 1.5, 15.0, 40.0, 100.0
E_3, G_13 = 7000.0, 4000.0


def root(e_1):
    """By how much the rotation of the root makes the crack longer (Williams 1989)."""
    gamma = 1.18 * math.sqrt(e_1 * E_3) / G_13
    return ARM * math.sqrt(e_1 / (11 * G_13) * (3 - 2 * (gamma / (1 + gamma)) ** 2))


def reduced(e_1, compliance, load):
    """Energy release rate of the beam with this compliance: bending and shear, the crack longer by the rotation of its root."""
    low, high = 1.0, 200.0
    bend, shear = 8 / (WIDTH * ARM**3 * e_1), 12 / (5 * WIDTH * ARM * G_13)
    for _ in range(60):
        a = 0.5 * (low + high)
        low, high = (a, high) if bend * a**3 + shear * a < compliance else (low, a)
    return 6 * load**2 / (WIDTH**2 * ARM) * (2 * a**2 / (ARM**2 * e_1) + 1 / (5 * G_13))


def beam(folder, program, e_1, opening, cohesive, extra):
    program("make", "specimen", "dcb", "--output", folder, "--overwrite", "--length", LENGTH, "--crack", CRACK, "--arm", ARM, "--adhesive", 0,
            "--element", 0.5, "--rows", 3, "--opening", 10, "--instants", 10)
    half = (0.5 * np.asarray(opening)).tolist()
    pins = "".join(f'[[support]]\ngroup = "{name}_pin"\nrigid = true\nu_x_mm = 0\nu_y_mm = {[side * u for u in half]}\n'
                   for name, side in (("upper", 1), ("lower", -1)))
    (folder / "case.toml").write_text(
        f'[mesh]\nfile = "mesh.json"\n{pins}[substrate]\nmodel = "orthotropic"\nplane = "stress"\nE_1_MPa = {e_1}\nE_2_MPa = {E_3}\n'
        f"nu_12 = 0.3\nG_12_MPa = {G_13}\nangle_deg = 0\nexact = true\n{cohesive}[output]\nfigures = []\nenergies = false\n{extra}")


def dcb(args, program):
    data = np.loadtxt(args.data / "dcb-curves" / "deGraciaDcbTestData.csv", delimiter=",")
    data = data[np.argsort(data[:, 0])]
    # The line through the first part, as the reduction takes it, is where opening and load begin.
    early = (data[:, 1] > 2) & (data[:, 1] < 18)
    slope, load = np.polyfit(data[early, 0], data[early, 1], 1)
    opening, force = data[:, 0] + load / slope, data[:, 1]
    compliance = 1 / slope
    # The modulus with which a beam with the crack has this compliance.
    low, high = 1e4, 1e6
    for _ in range(60):
        e_1 = math.sqrt(low * high)
        a = CRACK + root(e_1)
        stiff = 8 * a**3 / (WIDTH * ARM**3 * e_1) + 12 * a / (5 * WIDTH * ARM * G_13) < compliance
        low, high = (low, e_1) if stiff else (e_1, high)
    row(f"de Gracia et al. 2015, modulus E_1 from the slope of {slope:.3f} N/mm, MPa", "", f"{e_1:.0f}", "", "")
    top = int(np.argmax(force))
    wanted = [reduced(e_1, opening[k] / force[k], force[k]) for k in (top, len(force) - 1)]
    # Every third point before the first loss of stiffness, all behind it.
    chosen = [k for k in range(len(opening)) if opening[k] > 0.2 and (opening[k] > 4.3 or k % 3 == 0)]
    folder = args.output / "dcb"
    folder.mkdir(parents=True, exist_ok=True)
    laws = (("bilinear", 'model = "bilinear-benzeggagh-kenane"\nK_MPa_per_mm = 2e4\nT_n0_MPa = 20\nT_t0_MPa = 40\nG_Ic_N_per_mm = 0.35\n'
             'G_IIc_N_per_mm = 1.0\neta = 2.0\n', ["G_Ic", "T_n0"], "G_Ic"),)
    for name, law, parameters, work in laws:
        beam(folder, program, e_1, opening[chosen], f'[cohesive]\nkinematics = "finite"\nexact = true\n{law}',
             '[force]\nfile = "load.csv"\ngroup = "upper_pin"\n'
             f"width_mm = {WIDTH}\nwidth_mm_std = 0.05\nstd_N = 0.3\n[measurement]\nboundary = \"exact\"\n"
             f"[fit]\nparameters = {json.dumps(parameters)}\ndiscretisation = \"off\"\nmax_evaluations = 40\nbootstrap = 0\nintervals = \"linear\"\n")
        table(folder / "load.csv", {"load_N": force[chosen]})
        fit = program.fit(folder)
        if fit is None:
            row(f"  {name}", "", "no fit", "", "")
            continue
        text, value = told(fit, work)
        rms = fit["force"]["rms_N"] if fit.get("force") else math.nan
        row(f"  {name}: {work}, N/mm (by the reduction {wanted[0]:.3f} at the peak, {wanted[1]:.3f} at the end; rms {rms:.2f} N)",
            f"{wanted[0]:.3f} to {wanted[1]:.3f}", text, f"{100 * (value / wanted[0] - 1):+.1f} to {100 * (value / wanted[1] - 1):+.1f} %",
            fit["verdict"]["outcome"])


# --- Strips on steel ---------------------------------------------------------------------------------------------------


def coupon(path, until):
    """Strain and stress of a coupon, rising, in some 40 rows; and the slope that none of them exceeds."""
    data = np.loadtxt(path, delimiter=",", skiprows=1)[:3000]
    strain, stress = data[:, 0] / 100, data[:, 1] - data[0, 1]
    edges = np.concatenate([np.linspace(0, 0.01, 16), np.linspace(0.01, until, 26)[1:]])
    rows = [(0.0, 0.0)]
    for low, high in zip(edges, edges[1:]):
        inside = (strain > low) & (strain <= high)
        if inside.sum() > 1:
            point = strain[inside].mean(), stress[inside].mean()
            # Rising, and ever less steep: what noise the machine had goes no further.
            if point[0] > rows[-1][0] and point[1] > rows[-1][1]:
                rows.append(point)
    slopes = [(b[1] - a[1]) / (b[0] - a[0]) for a, b in zip(rows, rows[1:])]
    return rows, max(slopes)


def lap(args, program):
    tests = np.loadtxt(args.data / "fesma-lapshear" / "lap_shear_tests.csv", delimiter=",", skiprows=1)
    plain = {1, 2, 3, 4, 5, 6, 25}
    wanted = range(1, len(tests) + 1) if args.tests == "all" else map(int, args.tests.split(","))
    thick, width = 1.5, 50.0
    differences = []
    for number in wanted:
        load, work = 1e3 * float(tests[number - 1, 0]), float(tests[number - 1, 1])
        name = "Non_prestrained" if number in plain else "Prestrained"
        curve, young = coupon(args.data / "fesma-lapshear" / f"{name}_SMA_strain_stress.csv", 0.09)
        strain, stress = np.array(curve).T
        # How far the end has moved when the bond has separated over half of its length.
        long, size, tau = (160.0, 1.0, 25.0) if work < 5 else (400.0, 2.0, 20.0)
        pulled = float(np.interp(load / (thick * width), stress, strain))
        slip = 2 * work / tau
        end = slip + 0.5 * long * pulled
        columns, n = round(long / size), 24
        x = [size * k for k in range(columns + 1)]
        free = 10
        xs = [size * (k - free) for k in range(columns + 1 + free)]
        # A rigid base of one row, and the strip in two; the strip's free end is on the left.
        nodes = [[at, y] for y in (-2.0, -1.0) for at in x] + [[at, y] for y in (0.0, 0.5 * thick, thick) for at in xs]
        low, high = lambda i, j: j * (columns + 1) + i, lambda i, j: 2 * (columns + 1) + j * len(xs) + i
        quads = [[low(i, 0), low(i + 1, 0), low(i + 1, 1), low(i, 1)] for i in range(columns)]
        group = [0] * len(quads)
        for j in range(2):
            quads += [[high(i, j), high(i + 1, j), high(i + 1, j + 1), high(i, j + 1)] for i in range(len(xs) - 1)]
        group += [1] * (len(quads) - len(group))
        bonds = [[low(i, 1), low(i + 1, 1), high(i + free, 0), high(i + 1 + free, 0)] for i in range(columns)]
        folder = args.output / f"lap-{number}"
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "mesh.json").write_text(json.dumps(
            {"nodes": nodes, "quads": quads, "cohesive": bonds, "groups": ["base", "strip"], "quad_group": group,
             "node_groups": {"base": list(range(2 * (columns + 1))), "end": [high(0, j) for j in range(3)]}}))
        table(folder / "coupon.csv", {"strain": strain, "stress_MPa": stress})
        # Loaded on the left: the share of the load that is known is that of the last instants, where the separation goes on evenly.
        moves = [-end * (k / n) for k in range(1, n + 1)]
        (folder / "load.csv").write_text("frame,load_N\n" + "".join(f"{k},{load!r}\n" for k in (n - 2, n - 1, n)))
        (folder / "case.toml").write_text(
            '[mesh]\nfile = "mesh.json"\n[[support]]\ngroup = "base"\nu_x_mm = 0\nu_y_mm = 0\n[[support]]\ngroup = "end"\n'
            f"u_x_mm = {moves}\nu_y_mm = 0\n"
            '[substrate]\nmodel = "linear-elastic"\nE_MPa = 200000\nnu = 0.3\nexact = true\n'
            f'[substrate.strip]\nmodel = "tabulated"\nE_MPa = {young * 1.02:.1f}\nnu = 0.3\nfile = "coupon.csv"\nexact = true\n'
            '[cohesive]\nmodel = "bilinear-benzeggagh-kenane"\nkinematics = "objective"\nexact = true\nK_MPa_per_mm = 400\n'
            f"T_n0_MPa = {tau}\nT_t0_MPa = {tau}\nG_Ic_N_per_mm = {work}\nG_IIc_N_per_mm = {1.3 * work}\neta = 2.0\n"
            '[force]\nfile = "load.csv"\ngroup = "end"\ndirection = "-x"\n'
            f'width_mm = {width}\nwidth_mm_std = 0.1\nstd_N = 300\n[measurement]\nboundary = "exact"\n'
            '[fit]\nparameters = ["G_IIc"]\ndiscretisation = "off"\nbootstrap = 0\nintervals = "linear"\n[output]\nfigures = []\nenergies = false\n')
        fit = program.fit(folder)
        if fit is None:
            row(f"test {number}", f"{work:.3f}", "no fit", "", "")
            continue
        text, value = told(fit, "G_IIc")
        # The same from the coupon's curve alone: what the strip stores more than it gives back, by the length that separates.
        here = np.linspace(0, load / (thick * width), 2000)
        balance = thick * np.trapezoid(np.interp(here, stress, strain), here)
        differences.append(value / work - 1)
        row(f"Fe-SMA strip, test {number} ({'no prestrain' if number in plain else 'prestrained'}): {load / 1e3:.2f} kN, G_IIc, N/mm "
            f"(energy balance of the coupon {balance:.3f})", f"{work:.3f}", text, f"{100 * (value / work - 1):+.1f} %",
            outcome(fit))
    if len(differences) > 1:
        row("mean and spread of these", "", "", f"{100 * np.mean(differences):+.1f} ± {100 * np.std(differences, ddof=1):.1f} %", "")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=pathlib.Path)
    parser.add_argument("--quadrille", default=str(ROOT / "target/release/quadrille"))
    parser.add_argument("--output", type=pathlib.Path, default=ROOT / "out/real_curves")
    parser.add_argument("--only", default="dcb,lap")
    parser.add_argument("--tests", default="1,2,3,5,7,10,13", help="numbers of lap shear tests, or all")
    args = parser.parse_args()
    program = Program(args.quadrille)
    print("| what | published | quadrille | difference | verdict |\n| --- | --- | --- | --- | --- |")
    for name in args.only.split(","):
        {"dcb": dcb, "lap": lap}[name](args, program)
    sys.exit(1 if program.failed else 0)


if __name__ == "__main__":
    main()
