#!/usr/bin/env python3
"""Are constants of a specimen what it was made of, within their standard uncertainties?

    scripts/constants.py [--binary PROGRAM] [--scenes bar,hole] [--seeds N] [--keep DIR]

bar: a bar of an aluminium after Ramberg and Osgood (E 70 GPa, nu 0.33, Rp0.2 250 MPa, r 0.8) is pulled in 60 steps up
to 3 % of strain. Its images are drawn as those of scripts/verdicts.py (soft dots, 480 px), with noise of 2 and 8 grey levels,
N times (20); its force is read with a noise of 0.3 % of the largest, the area is off by its own uncertainty of 0.5 %.
`quadrille correlate` finds the constants from a region and from two extensometers.

hole: a plate with a hole of E 70 GPa, nu 0.33, pulled in 12 steps to 0.2 % of mean strain; its displacement is computed
on a fine mesh that follows the hole, its force has a noise of 0.3 % of the largest. `quadrille identify` fits E and nu
of a model of the zone, whose hole is stair steps of 16 px: its ends and its hole are measured, its sides are free.

z is the root mean square of error over standard uncertainty, held the share within 1.96 of them, bias the mean error
over the mean uncertainty. Exit status 1 when a limit fails: over all constants of a kind and a noise 90 to 99.5 % held,
and no bias of a constant beyond 0.33 + 2/sqrt(N). Needs numpy."""

import argparse
import csv
import json
import math
import os
import pathlib
import subprocess
import tempfile

import numpy as np

import verdicts
from verdicts import ROOT, Texture, move

YOUNG, NU, PROOF, POWER, R, AREA, STEPS = 70e3, 0.33, 250.0, 15, 0.8, 37.5, 60
LOAD_STD, AREA_STD = 30.0, 0.19  # N, mm2
SIDES = "upper = 'y = max'\nlower = 'y = min'\n"
GAUGES = {
    "region": '[[region]]\nname = "middle"\nroi = [150, 60, 330, 420]\n[tension]\n',
    "extensometers": '[[extensometer]]\nname = "long"\nfrom = [240, 60]\nto = [240, 420]\nwidth_px = 180\n'
                     '[[extensometer]]\nname = "wide"\nfrom = [150, 240]\nto = [330, 240]\nwidth_px = 360\n'
                     '[tension]\nalong = "long"\nacross = "wide"\n',
}


def strains(stress):
    """Engineering strains along and across; elastic parts small, plastic parts of kept volume."""
    along = stress / YOUNG + 0.002 * (stress / PROOF) ** POWER
    plastic = math.log1p(along) - stress * (1 + along) / YOUNG
    return along, math.expm1(-NU * stress * (1 + along) / YOUNG - R / (1 + R) * plastic)


def steps():
    """Stresses: even in the elastic part, then even in strain."""
    elastic = np.linspace(0, 0.72 * PROOF, STEPS // 2 + 1)[1:]
    grid = np.linspace(0.72 * PROOF, 1.25 * PROOF, 4000)
    ends = np.linspace(strains(grid[0])[0], 0.03, STEPS - STEPS // 2 + 1)[1:]
    return np.concatenate([elastic, np.interp(ends, [strains(s)[0] for s in grid], grid)])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--binary", type=pathlib.Path, default=ROOT / "target/release/quadrille")
    parser.add_argument("--scenes", default="bar,hole")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--keep", type=pathlib.Path)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = args.keep or pathlib.Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        failed = []
        for name in args.scenes.split(","):
            failed += study({"bar": Bar, "hole": Hole}[name](args.binary, folder), args.seeds)
    print("\n".join(failed) or "all limits hold")
    raise SystemExit(1 if failed else 0)


def study(scene, seeds):
    """Runs a scene; the limits that fail."""
    failed = []
    print(f"{'gauge, noise':24} {'constant':8} {'truth':>9} {'mean':>9} {'sigma':>9} {'z':>6} {'held':>6} {'bias':>6}")
    for noise in (2, 8):
        found = {}
        for seed in range(seeds):
            for kind, constants in scene.run(noise, np.random.default_rng(1000 * noise + seed)).items():
                for name in scene.truth:
                    found.setdefault(kind, {}).setdefault(name, []).append(constants[name])
        for kind, constants in found.items():
            all_held, label = [], f"{kind}, {noise}"
            for name, right in scene.truth.items():
                values = np.array(constants[name], float)
                error, sigma = values[:, 0] - right, values[:, 1]
                z, held = math.sqrt(np.mean((error / sigma) ** 2)), np.abs(error) <= 1.96 * sigma
                bias = np.mean(error) / np.mean(sigma)
                all_held.extend(held)
                print(f"{label:24} {name:8} {right:9.5g} {values[:, 0].mean():9.5g} {sigma.mean():9.2g} "
                      f"{z:6.2f} {100 * held.mean():5.0f}% {bias:6.2f}", flush=True)
                if abs(bias) > 0.33 + 2 / math.sqrt(seeds):
                    failed.append(f"{label}: bias of {name} {bias:.2f}")
            share = np.mean(all_held)
            print(f"{label:24} all {100 * share:.1f} % held")
            if not 0.90 <= share <= 0.995:
                failed.append(f"{label}: {100 * share:.1f} % held")
    if verdicts_of := getattr(scene, "verdicts", None):
        print("verdicts: " + ", ".join(f"{verdicts_of.count(v)} {v}" for v in sorted(set(verdicts_of))))
    return failed


class Scene:
    """Images without noise, and the program that measures them."""

    def __init__(self, program, folder):
        self.program, self.folder, texture = program, folder, Texture("soft", 3)
        self.clean = [texture.image(bodies) for bodies in self.motions()]
        (folder / "images").mkdir(exist_ok=True)

    def call(self, *words):
        ran = subprocess.run([str(word) for word in (self.program, *words)], capture_output=True, text=True)
        if ran.returncode not in (0, 1):
            raise SystemExit(f"{words}: {ran.stderr}")

    def photograph(self, noise, random):
        images = []
        for k, image in enumerate(self.clean):
            grey = np.clip(np.round(image + random.normal(0, noise, image.shape)), 0, 255).astype(np.uint8)
            images.append(self.folder / "images" / f"frame_{k:03}.pgm")
            images[-1].write_bytes(b"P5\n%d %d\n255\n" % grey.shape[::-1] + grey.tobytes())
        return images

    def record(self, loads):
        (self.folder / "load.csv").write_text("load_N\n" + "\n".join(f"{load!r}" for load in loads.tolist()) + "\n")

    def correlate(self, case, images):
        out = self.folder / "out"
        self.call("correlate", "--case", case, "--output", out, "--overwrite", "--quiet", "--export", "none",
                  "--no-report", *images)
        return out


class Bar(Scene):
    truth = {"E_MPa": YOUNG, "nu": NU, "Rp_MPa": PROOF, "Rm_MPa": None, "r": R}

    def motions(self):
        self.stresses = steps()
        self.truth["Rm_MPa"] = self.stresses[-1]
        yield [move((0, 0))]
        for stress in self.stresses:
            along, across = strains(stress)
            yield [move((0.3, 0.5), ((across, 0), (0, along)))]

    def run(self, noise, random):
        """Constants of one series by each kind of gauge: value and standard uncertainty."""
        images = self.photograph(noise, random)
        self.record(self.stresses * AREA + random.normal(0, LOAD_STD, len(self.stresses)))
        area, found = AREA + random.normal(0, AREA_STD), {}
        for kind, gauges in GAUGES.items():
            case = self.folder / f"{kind}.toml"
            case.write_text(f"[camera]\nexact = true\n[[zone]]\nroi = [120, 30, 360, 450]\n[load]\nfile = 'load.csv'\n"
                            f"area_mm2 = {area!r}\n{gauges}area_mm2_std = {AREA_STD}\nload_N_std = {LOAD_STD}\n")
            if kind == "region":
                out = self.correlate(case, images)
            else:
                self.call("probe", self.folder / "out", "--case", case, "--quiet")
            with open(out / "quantities" / "tension.csv") as text:
                rows = csv.DictReader(line for line in text if not line.startswith("#"))
                found[kind] = {row["constant"]: (row["value"], row["sigma"]) for row in rows}
        return found


class Hole(Scene):
    """A plate with a hole and free sides, pulled along x; its displacement is computed by the program on a mesh of its
    own that follows the hole, four times as fine as the one that is fitted."""
    truth = {"E": YOUNG, "nu": NU}
    RADIUS, BOX, MM, THICKNESS, STD = 60.0, (24.0, 80.0, 456.0, 400.0), 0.02, 2.0, 0.003
    N_ROUND, N_OUT, STRAINS = 288, 60, np.linspace(0, 0.002, 13)[1:]
    ELASTIC = f"model = 'linear-elastic'\nE_MPa = {YOUNG}\nnu = {NU}\n"

    def outline(self, angle):
        """Distance of the border of the plate from its middle, px."""
        half = [0.5 * (self.BOX[2] - self.BOX[0]), 0.5 * (self.BOX[3] - self.BOX[1])]
        with np.errstate(divide="ignore"):
            return np.minimum(half[0] / np.abs(np.cos(angle)), half[1] / np.abs(np.sin(angle)))

    def rays(self):
        """Angles of the rays: evenly around, and through the corners."""
        corner = math.atan2(self.BOX[3] - self.BOX[1], self.BOX[2] - self.BOX[0])
        corners = np.array([corner, math.pi - corner, -math.pi + corner, -corner])
        angles = np.linspace(-math.pi, math.pi, self.N_ROUND + 1)[:-1]
        nearest = np.abs(angles[:, None] - corners).argmin(axis=0)
        angles[nearest] = corners
        return angles

    def compute(self):
        """Nodal displacements of the instants on rays and rings, px with y down, and the force on the right end, N."""
        angles, shares = self.rays(), np.linspace(0, 1, self.N_OUT + 1) ** 1.3
        r = self.RADIUS + shares[:, None] * (self.outline(angles) - self.RADIUS)
        nodes = self.MM * np.stack([r * np.cos(angles), r * np.sin(angles)], axis=-1).reshape(-1, 2)  # y up
        n = len(angles)
        at = lambda i, j: i * n + j % n
        quads = [[at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)] for i in range(self.N_OUT) for j in range(n)]
        (self.folder / "truth.json").write_text(json.dumps({"nodes": nodes.tolist(), "quads": quads}))
        half = self.MM * 0.5 * (self.BOX[2] - self.BOX[0])
        ends = [k for k, (x, _) in enumerate(nodes.tolist()) if abs(abs(x) - half) < 1e-9]
        places = nodes.tolist()
        rows = [f"{i},{k},{places[k][0]!r},{places[k][1]!r},{e * places[k][0]!r},0.0"
                for i, e in enumerate(self.STRAINS.tolist(), 1) for k in ends]
        (self.folder / "truth.csv").write_text("\n".join(["instant,node,x_mm,y_mm,ux_mm,uy_mm", *rows, ""]))
        case = self.folder / "truth.toml"
        case.write_text(f"[mesh]\nfile = 'truth.json'\n[groups]\nright = 'x = max'\n{SIDES}"
                        f"hole = 'x > -2 and x < 2 and y > -2 and y < 2'\n[boundary]\nfile = 'truth.csv'\n"
                        f"free = ['upper', 'lower', 'hole']\n[substrate]\n{self.ELASTIC}"
                        f"[cohesive]\nmodel = 'none'\nkinematics = 'paper'\n")
        self.call("simulate", case, "--output", self.folder / "truth", "--overwrite", "--quiet")
        table = np.genfromtxt(self.folder / "truth/solution.csv", delimiter=",", comments="#", skip_header=3)
        u = table[:, -2:].reshape(len(self.STRAINS), self.N_OUT + 1, n, 2) / self.MM * [1, -1]
        with open(self.folder / "truth/reactions.csv") as text:
            rows = list(csv.DictReader(line for line in text if not line.startswith("#")))
        force = [float(row["Fx_N_per_mm"]) for row in rows if row["group"] == "right"]
        return angles, shares, u, self.THICKNESS * np.array(force)

    def displacement(self, k, x, y):
        """Of places of the image, linear in angle and share of the ray; beyond it as at its ends."""
        angles, shares, u, _ = self.computed
        x, y = x - verdicts.MIDDLE, verdicts.MIDDLE - y
        angle = np.arctan2(y, x)
        share = (np.hypot(x, y) - self.RADIUS) / (self.outline(angle) - self.RADIUS)
        n = len(angles)
        j = (np.searchsorted(angles, angle, side="right") - 1) % n
        step = (angles[(j + 1) % n] - angles[j]) % (2 * math.pi)
        b = ((angle - angles[j]) % (2 * math.pi)) / step
        i = np.clip(np.searchsorted(shares, share, side="right") - 1, 0, len(shares) - 2)
        a = np.clip((share - shares[i]) / (shares[i + 1] - shares[i]), -1, 2)
        corner = lambda di, dj: np.moveaxis(u[k][i + di, (j + dj) % n], -1, 0)
        return (1 - a) * ((1 - b) * corner(0, 0) + b * corner(0, 1)) + a * ((1 - b) * corner(1, 0) + b * corner(1, 1))

    def inside(self, x, y):
        x0, y0, x1, y1 = self.BOX
        return (np.hypot(x - verdicts.MIDDLE, y - verdicts.MIDDLE) > self.RADIUS) & (y > y0) & (y < y1)

    def motions(self):
        self.computed = self.compute()
        still = lambda x, y: np.zeros((2, *np.shape(x)))
        yield [verdicts.Body(still, self.inside)]
        for k in range(len(self.STRAINS)):
            yield [verdicts.Body(lambda x, y, k=k: self.displacement(k, x, y), self.inside)]

    def run(self, noise, random):
        images, force = self.photograph(noise, random), self.computed[3]
        std = float(self.STD * force[-1])
        self.record(force + random.normal(0, std, len(force)))
        angle = np.linspace(0, 2 * math.pi, 73)[:-1]
        ring = [[verdicts.MIDDLE + self.RADIUS * f(t) for f in (math.cos, math.sin)] for t in angle.tolist()]
        case, fit = self.folder / "hole.toml", self.folder / "fit"
        case.write_text(f"images.pixel_size_mm = {self.MM}\n[camera]\nexact = true\n[[zone]]\n"
                        f"roi = {list(self.BOX)}\nexclude = [{ring}]\nguard_px = 3\n")
        self.correlate(case, images)
        store = "store = 'out/fields.zarr'\n"
        case.write_text(f"[mesh]\n{store}[groups]\nright = 'x = max'\n{SIDES}[boundary]\n{store}"
                        f"free = ['upper', 'lower']\n[measurement]\n{store}[substrate]\nmodel = 'linear-elastic'\n"
                        f"E_MPa = 50000\nnu = 0.25\n[cohesive]\nmodel = 'none'\nkinematics = 'paper'\n"
                        f"[force]\nfile = 'load.csv'\ngroup = 'right'\ndirection = 'x'\nwidth_mm = {self.THICKNESS}\n"
                        f"std_N = {std!r}\n[fit]\nparameters = ['E', 'nu']\n"
                        f"exact = ['width', 'pixel_size', 'camera', 'rotations']\n")
        self.call("identify", case, "--output", fit, "--overwrite", "--quiet")
        record = json.loads((fit / "fit.json").read_text())
        self.verdicts = getattr(self, "verdicts", []) + [record["verdict"]["outcome"]]
        return {"hole": {name: (of["value"], of["std"]) for name, of in record["parameters"].items()}}


if __name__ == "__main__":
    main()
