#!/usr/bin/env python3
"""Beam specimens by `quadrille simulate` against beam theory.

    scripts/beams.py [--quadrille PROGRAM] [--output FOLDER] [--only dcb,enf,mmb]

Printed is a table: what is compared, theory, what was computed, the difference and the aim. Exit status 1 where an aim is missed.

    dcb   deflection of the arms against Timoshenko beams on an elastic foundation; the force while the crack grows
    enf   compliance and energy release rate of an elastic beam, with the rotation of the crack's root; the force when it grows
    mmb   at three mixities the force while the crack grows, by the criterion of Benzeggagh and Kenane with the mixity of beam
          theory and the energy release rate of elastic computations (their compliance, derived by the length of the crack)

All beams have nu = 0, so that plane stress, plane strain and beam theory agree. The elements are too stiff in bending by half the square
of their length over the arm's thickness: 0.35 % here."""

import argparse
import csv
import math
import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
E, ARM = 70000.0, 3.0
G = E / 2
SIZES = {"arm": ARM, "adhesive": 0, "element": 0.25, "rows": 4}


class Runs:
    def __init__(self, program, folder):
        self.program, self.folder = program, folder
        self.missed = 0

    def compute(self, kind, name, law, extra="", **sizes):
        """Rows of group -> (ux, uy, Fx, Fy) per instant, and the other groups' displacements."""
        folder = self.folder / name
        words = [self.program, "make", "specimen", kind, "--output", folder, "--overwrite"]
        for key, value in {**SIZES, **sizes}.items():
            words += [f"--{key}", value]
        self.call(words)
        case = (folder / "case.toml").read_text()
        head = case[:case.index("[substrate]")]
        (folder / "case.toml").write_text(
            head + f'[substrate]\nmodel = "linear-elastic"\nE_MPa = {E}\nnu = 0.0\n' + law
            + "[output]\nfigures = []\nenergies = false\n" + extra)
        self.call([self.program, "simulate", folder / "case.toml", "--output", folder / "out", "--overwrite", "--quiet"])
        groups = {}
        with open(folder / "out" / "reactions.csv") as file:
            for row in csv.DictReader(line for line in file if not line.startswith("#")):
                values = [float(row[key]) for key in ("ux_mm", "uy_mm", "Fx_N_per_mm", "Fy_N_per_mm")]
                groups.setdefault(row["group"], []).append(values)
        return groups

    def call(self, words):
        done = subprocess.run(list(map(str, words)), capture_output=True, text=True)
        if done.returncode not in (0, 1):
            sys.exit(f"{' '.join(map(str, words))}\n{done.stderr}")

    def row(self, what, theory, found, aim):
        off = found / theory - 1
        fine = aim is None or abs(off) <= aim
        self.missed += not fine
        aim = "" if aim is None else f"{100 * aim:.1f} %{'' if fine else ' missed'}"
        print(f"| {what} | {theory:.5g} | {found:.5g} | {100 * off:.2f} % | {aim} |", flush=True)


def law(K, t_n, t_t, g_n, g_t, eta=2.0):
    return (f'[cohesive]\nmodel = "bilinear-benzeggagh-kenane"\nkinematics = "objective"\nK_MPa_per_mm = {K}\nT_n0_MPa = {t_n}\n'
            f"T_t0_MPa = {t_t}\nG_Ic_N_per_mm = {g_n}\nG_IIc_N_per_mm = {g_t}\neta = {eta}\n")


def elastic(K):
    """So strong that nothing of it softens."""
    return law(K, 1e4, 1e4, 1e9 / K, 1e9 / K)


def foundation(a, K):
    """Deflection of one arm's end under a unit force: Timoshenko beam, free over `a`, on springs of 2 K beyond."""
    bend, shear, k = E * ARM**3 / 12, 5 / 6 * G * ARM, 2 * K
    root = 0.5 * math.sqrt(k / bend)
    p, q = math.sqrt(root + k / (4 * shear)), math.sqrt(root - k / (4 * shear))
    # w = exp(-p x) (A cos q x + B sin q x); moment a and shear force -1 at x = 0.
    def rows(w, dw, ddw, dddw):
        return bend * (ddw - k / shear * w), -bend * (dddw - k / shear * dw)
    of_a = rows(1, -p, p * p - q * q, -p**3 + 3 * p * q * q)
    of_b = rows(0, q, -2 * p * q, 3 * p * p * q - q**3)
    determinant = of_a[0] * of_b[1] - of_a[1] * of_b[0]
    A = (a * of_b[1] + of_b[0]) / determinant
    B = (-of_a[0] - a * of_a[1]) / determinant
    slope = -p * A + q * B + 1 / shear
    return A - slope * a + a**3 / (3 * bend) + a / shear


def between(less, low, high):
    """Where `less` stops to hold."""
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if less(middle) else (low, middle)
    return low


def root_rotation():
    gamma = 1.18 * E / G
    return ARM * math.sqrt(E / (11 * G) * (3 - 2 * (gamma / (1 + gamma)) ** 2))


def dcb(runs):
    a = 40.0
    for K in (50.0, 500.0, 5000.0):
        pin = runs.compute("dcb", f"dcb-{K}", elastic(K), length=100, crack=a, opening=1, instants=1)["upper_pin"][0]
        runs.row(f"DCB, K = {K:g} MPa/mm: deflection of an arm under 1 N/mm, mm", foundation(a, K), pin[1] / pin[3], 0.01)
    # Growing: J = P (theta_upper - theta_lower) = G_c; with the deflection of the foundation's beam of the same length.
    g, K = 0.5, 1e4
    pin = runs.compute("dcb", "dcb-grows", law(K, 20, 20, g, g), length=100, crack=a, opening=6, instants=24)["upper_pin"]
    for k in (15, 23):
        _, u, _, force = pin[k]
        # The length of an elastic beam with this opening and this force; its force at G_c.
        crack, h = between(lambda length: foundation(length, K) * force < u, a, 95.0), 1e-3
        rate = force**2 * (foundation(crack + h, K) - foundation(crack - h, K)) / (2 * h)
        runs.row(f"DCB, crack {crack:.1f} mm: energy release rate while it grows, N/mm", g, rate, 0.01)


def enf(runs):
    half, K = 60.0, 1e5
    root = 0.42 * root_rotation()
    def theory(a):
        bent = (2 * half**3 + 3 * a**3) / (8 * E * ARM**3)
        return bent * (1 + 2 * (1.2 * half + 0.9 * a) * ARM**2 * E / ((2 * half**3 + 3 * a**3) * G))
    found = {}
    for a in (40.0, 45.0, 50.0):
        point = runs.compute("enf", f"enf-{a}", elastic(K), length=2 * half, crack=a, opening=0.1, instants=1)["middle"][0]
        found[a] = point[1] / point[3]
        runs.row(f"ENF, crack {a:g} mm: deflection under 1 N/mm, mm (crack longer by {root:.2f} mm)",
                 theory(a + root), found[a], 0.01)
    rate = 0.5 * (found[50.0] - found[40.0]) / 10
    # The central difference of a cube is larger by the square of the half step.
    wanted = 9 * ((45 + root) ** 2 + 25 / 3) / (16 * E * ARM**3)
    runs.row("ENF, crack 45 mm: energy release rate under 1 N/mm, N/mm", wanted, rate, 0.01)
    # Growing: the crack of the same compliance, and its energy release rate.
    g, end = 1.0, 51.0
    opening = 1.02 * theory(end + root) * math.sqrt(16 * g * E * ARM**3 / 9) / (end + root)
    points = runs.compute("enf", "enf-grows", law(K, 80, 80, g, g), length=2 * half, crack=45, opening=opening,
                          instants=40)["middle"]
    _, u, _, force = points[-1]
    crack = between(lambda a: theory(a) * force > u, 40.0, 60.0)  # both are negative
    runs.row(f"ENF, crack {crack - root:.1f} mm: energy release rate while it grows, N/mm", g,
             9 * crack**2 * force**2 / (16 * E * ARM**3), 0.02)


def mmb(runs):
    half, K, g_n, g_t, eta = 60.0, 1e5, 0.5, 1.0, 2.0
    # With this ratio of the strengths an adhesive takes the criterion's toughness whatever the mixity was on the way (Turon et al. 2010);
    # with others it takes that of the mixity at each point of the process zone, which is not that of the beam.
    t_n, t_t = 120.0, 120.0 * math.sqrt(g_t / g_n)
    for share, lever in ((0.2, 106.5), (0.5, 49.5), (0.8, 32.9)):
        def mixity(a):
            opening = 4 / 3 * ((3 * lever - half) / (lever + half)) ** 2
            # The roots of the crack turn more in opening than in sliding.
            opening *= ((a + root_rotation()) / (a + 0.42 * root_rotation())) ** 2
            return 1 / (1 + opening)
        lengths, compliances = (40.0, 45.0, 50.0, 55.0), []
        for a in lengths:
            point = runs.compute("mmb", f"mmb-{share}-{a:g}", elastic(K), length=2 * half, crack=a, opening=0.05,
                                 instants=1, lever=lever)["lever"][0]
            compliances.append(0.05 / -point[3])
        # A cubic through the four.
        def compliance(a):
            total = 0.0
            for i, x in enumerate(lengths):
                total += compliances[i] * math.prod((a - y) / (x - y) for y in lengths if y != x)
            return total
        def slope(a, h=1e-3):
            return (compliance(a + h) - compliance(a - h)) / (2 * h)
        def toughness(a):
            return g_n + (g_t - g_n) * mixity(a) ** eta
        opening = 1.02 * compliance(51.0) * math.sqrt(2 * toughness(51.0) / slope(51.0))
        points = runs.compute("mmb", f"mmb-{share}-grows", law(K, t_n, t_t, g_n, g_t, eta), length=2 * half, crack=45,
                              opening=opening, instants=40, lever=lever)["lever"]
        _, u, _, force = points[-1]
        crack = between(lambda a: compliance(a) * force > u, 40.0, 55.0)
        runs.row(f"MMB, G_II/G = {mixity(crack):.2f}, crack {crack:.1f} mm: energy release rate while it grows, N/mm",
                 toughness(crack), force**2 / 2 * slope(crack), 0.01)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quadrille", default=str(ROOT / "target/release/quadrille"))
    parser.add_argument("--output", type=pathlib.Path, default=ROOT / "out/beams")
    parser.add_argument("--only", default="dcb,enf,mmb")
    args = parser.parse_args()
    runs = Runs(args.quadrille, args.output)
    print("| what | theory | quadrille | difference | aim |\n| --- | --- | --- | --- | --- |")
    for name in args.only.split(","):
        {"dcb": dcb, "enf": enf, "mmb": mmb}[name](runs)
    sys.exit(1 if runs.missed else 0)


if __name__ == "__main__":
    main()
