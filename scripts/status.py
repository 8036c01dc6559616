#!/usr/bin/env python3
"""Is what counts as measured measured, and is the rest said? Scenes that used to end "converged" and were not.

    scripts/status.py [--binary PROGRAM] [--scenes NAME,...] [--data FOLDER | --no-real] [--keep DIR]

The scenes are drawn as those of scripts/verdicts.py; FOLDER (or QUADRILLE_DATA) has the real images. The columns:

    exit      exit status                     measured  per cent of the nodes, in the last frame
    bad       measured nodes off by more than 5 sigma and 0.1 px, per cent over all frames that converged
    rms       error of the measured nodes, mpx
    it.       iterations of a frame in the mean

Exit status 1 when a limit fails: bad <= 1 % in frames that converged, exit 1 where a third of the nodes is lost, at
most 20 iterations in the mean of several frames, large speckles within 50 mpx, openings beside drawn paths within 2 sigma (or none), the
size of a fixed pattern within 30 %, and 13 of 15 intervals of the joint. Needs numpy."""

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
from verdicts import MIDDLE, ROOT, SIDE, Body, Texture, correlate, field, move, photograph, rms, truth

verdicts.TEXTURES |= {"25 px": (7.5, 2), "45 px": (13.5, 2)}
BOX = (150.0, 320.0, 130.0, 330.0)
JOINTS, SEEDS = (6, 8, 12, 16), 5


def is_in_box(x, y):
    return (x >= BOX[0]) & (x < BOX[1]) & (y >= BOX[2]) & (y < BOX[3])


def body_before_ground(step):
    """A body that moves by `step` from frame to frame before a still ground of the same texture."""
    return lambda k: [move((0, 0), inside=lambda x, y: ~is_in_box(x, y)), move((k * step, 0.4 * k * step), inside=is_in_box)]


def apart(opening, step=1):
    """Two halves that part across the middle."""
    return lambda k: [move((0, 0), inside=lambda x, y: y < MIDDLE),
                      move((0.3 * k, opening * (k * step)), inside=lambda x, y: y >= MIDDLE)]


def two_bodies(k):
    """Two halves that part and slide while one of them stretches."""
    return [move((-1.5 * k, 0.4 * k), inside=lambda x, y: x < MIDDLE),
            move((1.2 * k, -0.3 * k), ((0.004 * k, 0), (0, -0.001 * k)), inside=lambda x, y: x >= MIDDLE)]


def between_grips(k):
    """A strip that is stretched between grips of the same texture, the left one still."""
    bend = lambda x: np.clip((x - 120.0) / 240.0, 0, 1)
    return [Body(lambda x, y: np.array([2.5 * k * bend(x), 0 * y]))]


class Judge:
    def __init__(self, program, folder):
        self.program, self.folder, self.failed = program, folder, []

    def hold(self, holds, name, what):
        if not holds:
            self.failed.append(f"{name}: {what}")

    def row(self, name, cells):
        print(f"{name:34} " + " ".join(f"{cell:>9}" for cell in cells), flush=True)

    def scene(self, name, texture, bodies, frames, noise=2.0, pattern=0.0, hot=0.0, options=(), near=0.0, parted=False):
        """Correlates frames 1 to `frames` of bodies(k) and judges them; gives the folder of the run and its summary. Nodes on
        the line where bodies have `parted` belong to either; a share of `hot` pixels is brighter by 60 to 120."""
        dots, random = Texture(texture, 7), np.random.default_rng(sum(map(ord, name)))
        own = pattern * random.standard_normal((SIDE, SIDE))
        own += (random.random((SIDE, SIDE)) < hot) * random.uniform(60, 120, (SIDE, SIDE))
        folder = self.folder / name.replace(" ", "-").replace(",", "")
        folder.mkdir()
        paths = [folder / f"{k:02}.pgm" for k in range(frames + 1)]
        for k, path in enumerate(paths):
            photograph(path, dots.image(bodies(k)) + own, noise, random, False)
        out = folder / "out"
        summary, store = correlate(self.program, out, paths[0], paths[1:], *options)
        if store is None:
            self.row(name, ["refused"])
            self.hold(False, name, summary)
            return out, None
        lost, bad, counted, errors = 0, 0, 0, []
        x, y = store["node_position_px"].T
        y = np.where(parted & (np.abs(y - MIDDLE) < 3), np.nan, y)
        for k, frame in enumerate(summary["frames"]):
            if "measured_percent" not in frame:
                lost += 1
                continue
            lost += frame["measured_percent"] < 100 / 1.5
            error = field(store, k) - truth(bodies(k + 1), x, y)
            error = error[np.isfinite(error).all(1)]
            sigma = store["sigma_px"][k][np.isfinite((field(store, k) - truth(bodies(k + 1), x, y))[:, 0])]
            if frame["status"] == "converged":
                far = ((np.abs(error) > 5 * sigma) & (np.abs(error) > 0.1)).any(1)
                bad, counted = bad + far.sum(), counted + len(far)
            errors.append(error)
        exit_status = 1 if set(summary["counts"]) - {"converged"} else 0
        iterations = np.mean([frame.get("iterations", 0) for frame in summary["frames"]])
        percent = 100 * bad / max(counted, 1)
        measured = summary["frames"][-1].get("measured_percent", math.nan)
        self.row(name, [exit_status, f"{measured:.1f}", f"{percent:.2f}", f"{1e3 * rms(np.concatenate(errors)):.0f}",
                        f"{iterations:.1f}"])
        self.hold(percent <= 1, name, f"{percent:.1f} % of the nodes of converged frames are off")
        self.hold(exit_status == 1 or not lost, name, "a third is lost and the exit status is 0")
        self.hold(frames == 1 or iterations <= 20, name, f"{iterations:.0f} iterations")
        self.hold(not near or 1e3 * rms(np.concatenate(errors)) <= near, name, "too far off")
        return out, summary

    def openings(self, off, opening):
        name = f"crack open {opening} px, path {off} px off"
        path = f"{-0.5},{MIDDLE + off} {SIDE - 0.5},{MIDDLE + off}"
        out, summary = self.scene(name, "soft", apart(opening), 1, options=["--crack", path, "--element-size", 16], parted=True)
        if summary is None:
            return
        table, z = out / "quantities" / "cracks.csv", []
        with open(table) as text:
            for line in csv.DictReader(line for line in text if not line.startswith("#")):
                if line["opening_px"]:
                    z.append((float(line["opening_px"]) - opening) / float(line["sigma_opening_px"]))
        z = np.array(z)
        self.row("", [f"{len(z)} pairs", f"z {rms(z):.2f}" if len(z) else "none"])
        self.hold(not len(z) or rms(z) < 2, name, f"openings off by {rms(z):.1f} sigma")

    def joint(self, noise):
        """Fits of the virtual test with the border that its data ask for, and with a free one: intervals that hold, and the
        mean error of phi_n over the seeds, per cent."""
        held, errors, said = {"auto": 0, "free": 0}, {"auto": [], "free": []}, []
        quiet = {"check": True, "capture_output": True}
        for seed in range(1, SEEDS + 1):
            test, out = self.folder / f"joint-{noise}-{seed}", self.folder / f"joint-{noise}-{seed}-out"
            make = [self.program, "make", "virtual-test", "--noise", noise, "--seed", seed, "--output", test]
            subprocess.run([str(word) for word in make], **quiet)
            run = [self.program, "run", test / "case.toml", "--output", out, "--quiet"]
            ran = subprocess.run([str(word) for word in run], capture_output=True, text=True)
            if not (out / "fit.json").is_file():
                said.append(ran.stderr.strip()[-200:])
                continue
            case = (out / "identify.toml").read_text().replace("[measurement]", '[measurement]\nborder = "free"')
            (out / "free.toml").write_text(case)
            free = [self.program, "identify", out / "free.toml", "--output", out / "free", "--quiet"]
            subprocess.run([str(word) for word in free], capture_output=True)
            right = json.loads((test / "truth.json").read_text())["parameters"]
            for border, fit in (("auto", out / "fit.json"), ("free", out / "free" / "fit.json")):
                for name, parameter in json.loads(fit.read_text())["parameters"].items():
                    low, high = parameter.get("interval95") or (math.nan, math.nan)
                    held[border] += low <= right[name] <= high
                    if name == "phi_n":
                        errors[border].append(100 * (parameter["value"] / right[name] - 1))
        name = f"joint at noise {noise}"
        for border in held:
            mean = f"{np.mean(errors[border]):+.1f} %" if errors[border] else "none"
            self.row(f"{name}, border {border}", [f"{held[border]} held", f"{len(said)} ref.", mean])
        self.hold(held["auto"] >= 13 and not said, name, f"{held['auto']} of 15 intervals hold, {len(said)} refused {said[:1]}")

    def real(self, data):
        """Iterations of a frame in the mean, of the sets of verdicts.py with files as the only input."""
        for name, images, options, _ in verdicts.real_sets(data):
            if not (data / name).is_dir():
                continue
            paths = [data / name / image for image in images]
            summary, store = correlate(self.program, self.folder / name, paths[0], paths[1:], *options)
            self.hold(store is not None, name, summary)
            if store is not None:
                iterations = np.mean([frame.get("iterations", 0) for frame in summary["frames"]])
                last = summary["frames"][-1]
                cells = [last["status"], f"{last.get('measured_percent', 0):.1f}", "", "", f"{iterations:.1f}"]
                self.row(name, cells)
                self.hold(iterations <= 20, name, f"{iterations:.0f} iterations")

    def necking(self, data, size):
        images = sorted((data / "sundic-necking").glob("*.tif*"))
        if not images:
            return
        name, out = f"necking bar, {size} px", self.folder / f"necking-{size}"
        options = ["--element-size", size, *(["--update-reference", "residual"] if size > 16 else [])]
        summary, store = correlate(self.program, out, images[0], images[1:], *options)
        self.hold(store is not None, name, summary)
        if store is not None:
            last = summary["frames"][-1]
            self.row(name, [last["status"], f"{last.get('measured_percent', 0):.1f}"])
            self.hold(last.get("measured_percent", 0) > 80, name, "the last frame is not measured")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--binary", type=pathlib.Path, default=ROOT / "target/release/quadrille")
    parser.add_argument("--scenes", default="")
    parser.add_argument("--data", type=pathlib.Path, default=os.environ.get("QUADRILLE_DATA"))
    parser.add_argument("--no-real", action="store_true")
    parser.add_argument("--keep", type=pathlib.Path)
    asked = parser.parse_args()
    folder = asked.keep or pathlib.Path(tempfile.mkdtemp(prefix="quadrille-status-"))
    folder.mkdir(parents=True, exist_ok=True)
    judge = Judge(asked.binary.resolve(), folder)
    wanted = [name for name in asked.scenes.split(",") if name]
    on = lambda name: not wanted or any(word in name for word in wanted)
    judge.row("scene", ["exit", "measured", "bad", "rms", "it."])
    if on("ground"):
        judge.scene("ground still, steps of 15 px", "soft", body_before_ground(15.0), 2)
        _, summary = judge.scene("ground still, steps of 0.8 px", "soft", body_before_ground(0.8), 14)
        means = [zone["name"] for zone in ((summary or {}).get("frames") or [{}])[-1].get("zones", [])]
        judge.hold(means == ["specimen", "still"], "ground", f"the zones are {means}")
    if on("bodies"):
        _, summary = judge.scene("bodies that part", "soft", two_bodies, 6)
        names = [zone["name"] for zone in ((summary or {}).get("frames") or [{}])[-1].get("zones", [])]
        judge.hold(names == ["specimen1", "specimen2"], "bodies", f"the zones are {names}")
    if on("grips"):
        judge.scene("strip between grips", "soft", between_grips, 6)
    if on("broken"):
        for size in (16, 20, 24, 32):
            judge.scene(f"broken, {size} px", "soft", apart(17.5), 1, options=["--element-size", size], parted=True)
    if on("speckles"):
        for texture, size in (("25 px", 64), ("45 px", 112)):
            judge.scene(f"large speckles of {texture}, {size} px", texture, lambda k: [move((4.2 * k, 2.1 * k))], 1, near=50,
                        options=["--element-size", size, "--roi", "16,16,464,464"])
    if on("pattern"):
        for size in (2.0, 4.0):
            name = f"fixed pattern of {size:.0f}"
            _, summary = judge.scene(name, "soft", lambda k: [move(((0, 0.1, 0.25, 0.4, 6.3)[k], 0))], 4, 0.8, size)
            said = [remark for remark in (summary or {}).get("remarks", []) if remark["code"] == "fixed-pattern"]
            found = [value for remark in said for key, value in remark["values"].items() if "grey" in key]
            judge.hold(found and abs(found[0] / size - 1) < 0.3, name, f"its size is {found}")
    if on("hot"):
        _, summary = judge.scene("hot pixels", "soft", lambda k: [move((0.37 * k, 0.2 * k))], 4, hot=0.002, near=50)
        judge.hold((summary or {}).get("hot_pixels", 0) > 350, "hot pixels", "they are not named")
    if on("crack"):
        for opening in (2.0, 9.0):
            for off in (0, 2, 4, 6, 8):
                judge.openings(off, opening)
    if on("joint"):
        for noise in JOINTS:
            judge.joint(noise)
    if on("real") and asked.data and not asked.no_real:
        judge.real(pathlib.Path(asked.data))
    if on("necking") and asked.data and not asked.no_real:
        for size in (16, 30, 32, 48):
            judge.necking(pathlib.Path(asked.data), size)
    print("\n".join(judge.failed) or "all limits hold")
    raise SystemExit(1 if judge.failed else 0)


if __name__ == "__main__":
    main()
