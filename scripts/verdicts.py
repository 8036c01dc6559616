#!/usr/bin/env python3
"""Is it true what is said around the displacement: standard uncertainty, model error, marks of elements?

    scripts/verdicts.py [--binary PROGRAM] [--scenes NAME,...] [--short] [--data FOLDER | --no-real]
                        [--keep DIR] [--out FILE]

Draws some 40 scenes: dots summed one by one where the material is, integrated over each pixel; noise; 8 bit. Correlates
them with the options that a user must give, and compares with the known motion. A scene has two runs, each with its own
noise in the reference and two frames of the same motion, and one run without noise and rounding, whose error is `true`,
the systematic one. Lengths are mpx, thousandths of a pixel, of one component. FOLDER (or QUADRILLE_DATA) has the real
images, of which error is against a truth or other codes. The columns:

    true      error of nodes without noise             z          error of nodes / sqrt(sigma^2 + model error^2)
    z noise   (error - true) / sigma                   z points   as z, along lines of `quadrille probe`
    z window  as z, of strains over 5 x 5 nodes        z mean     mean error of all nodes / (sigma / sqrt(3 elements))
    m/true    model error / true, rms over the components of nodes where true > sigma (their share in brackets)
    m/sigma   model error / sigma, rms over the other components at nodes whose elements all follow
    follow    elements that miss less than 1 sigma of the motion: rms over 16 points inside, without noise
    misfit    elements that miss more than 3 sigma
    false     marked, or left out for no match, of those that follow
    missed    neither marked nor left out, of those that miss more than 3 sigma
    bad       measured nodes of converged frames that are off by more than 0.1 px and 5 times all that is stated

Model errors of points and windows count in z as soon as the tables and the store have them.
Exit status 1 when a limit fails: false <= 2 % and missed <= 5 % over all scenes; in each scene bad <= 1 %, m/true 0.5
to 2, m/sigma < 1, and z of nodes, points and windows 0.85 to 1.15. Needs numpy."""

import argparse
import csv
import json
import math
import os
import pathlib
import shutil
import struct
import subprocess
import sys
import tempfile
import time

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parent.parent
SIDE, MIDDLE, DRAWS, FRAMES = 480, 240.0, 2, 2
COLUMNS = np.arange(SIDE, dtype=float)[None]
NAMES = {1: "misfit", 2: "still", 3: "no texture", 4: "left image", 5: "saturated", 6: "no match"}
GAP = 25.0  # grey level where there is no material
# Width of a dot (standard deviation, or radius of a sharp disc), px; points per pixel and direction.
TEXTURES = {"soft": (1.6, 2), "fine": (0.6, 3), "coarse": (3.6, 2), "sharp": (2.5, 4)}
# Of the luminance in JPEG files, at quality 50.
QUANTISATION = np.array("""
    16 11 10 16 24 40 51 61     12 12 14 19 26 58 60 55     14 13 16 24 40 57 69 56      14 17 22 29 51 87 80 62
    18 22 37 56 68 109 103 77   24 35 55 64 81 104 113 92   49 64 78 87 103 121 120 101  72 92 95 98 112 100 103 99
    """.split(), float).reshape(8, 8)


class Body:
    """Material that moves smoothly by `u`; `inside`: what of the reference it is; `affine`: shift and gradient of u."""

    def __init__(self, u, inside=None, affine=None):
        self.u, self.affine = u, affine
        self.inside = inside or (lambda x, y: np.ones(np.shape(x), bool))

    def material(self, x, y):
        if self.affine is not None:
            (shift, gradient), d = self.affine, np.array([x, y]) - MIDDLE
            return MIDDLE + np.tensordot(np.linalg.inv(np.eye(2) + gradient), d - shift[:, None, None], 1)
        at, place = np.array([x, y]), np.array([x, y])
        for _ in range(40):
            before, at = at, place - self.u(*at)
            if np.abs(at - before).max() < 1e-6:
                break
        return at

    def stretch(self):
        return 1.0 if self.affine is None else np.linalg.svd(np.eye(2) + self.affine[1])[1].max()


def move(shift, gradient=((0, 0), (0, 0)), inside=None):
    s, g = np.array(shift, float), np.array(gradient, float)
    at = lambda x: s.reshape(2, *[1] * np.ndim(x))
    return Body(lambda x, y: at(x) + np.tensordot(g, np.array([x, y]) - MIDDLE, 1), inside, (s, g))


def stretch(by):
    return [move((0.2, 0.4), ((by - 1, 0), (0, by**-0.3 - 1)))]


def turn(degrees):
    sin, cos = math.sin(math.radians(degrees)), math.cos(math.radians(degrees))
    return [move((0.4, -0.3), ((cos - 1, -sin), (sin, cos - 1)))]


def wave(period, height):
    k = 2 * math.pi / period
    return [Body(lambda x, y: height * np.array([np.sin(k * x + 0.3), 0.7 * np.sin(k * (x + y) / 2**0.5 + 1)]))]


def crack(opening):
    """Mode I, its tip in the middle of the image, the crack left of it: two bodies that meet in front of the tip."""
    kappa = 2.7 / 1.3
    height = opening / (2 * math.sqrt(MIDDLE) * (kappa + 1))

    def field(side):
        def u(x, y):
            x, y = x - MIDDLE, y - MIDDLE
            angle, root = np.arctan2(y, x), height * np.sqrt(np.hypot(x, y))
            half = 0.5 * np.where(side * angle < -math.pi / 2, angle + side * 2 * math.pi, angle)
            return root * np.array([np.cos(half) * (kappa - 1 + 2 * np.sin(half) ** 2),
                                    np.sin(half) * (kappa + 1 - 2 * np.cos(half) ** 2)])
        return u

    return [Body(field(-1), lambda x, y: y < MIDDLE), Body(field(1), lambda x, y: y >= MIDDLE)]


def slide(by):
    return [move((by, 0.3), inside=lambda x, y: y < MIDDLE), move((0, 0.3), inside=lambda x, y: y >= MIDDLE)]


def hole(radius):
    def u(x, y):
        x, y = (x - MIDDLE) / radius, (y - MIDDLE) / radius
        near = 0.5 / np.maximum(x * x + y * y, 0.3)
        return np.array([0.4 * x + near * x + 0.3, -0.1 * y - near * y + 0.2])
    return [Body(u, lambda x, y: np.hypot(x - MIDDLE, y - MIDDLE) > radius)]


def truth(bodies, x, y):
    """Displacement of places of the reference, NaN where there is no material."""
    u = np.full((2, *np.shape(x)), np.nan)
    for body in bodies:
        u = np.where(body.inside(x, y), body.u(x, y), u)
    return np.moveaxis(u, 0, -1)


def strain(bodies, x, y, step=1e-3):
    """Green-Lagrange: exx, eyy, exy."""
    du = [(truth(bodies, x + a, y + b) - truth(bodies, x - a, y - b)) / (2 * step) for a, b in ((step, 0), (0, step))]
    f = np.eye(2) + np.stack(du, axis=-1)
    e = (np.swapaxes(f, -1, -2) @ f - np.eye(2)) / 2
    return np.stack([e[..., 0, 0], e[..., 1, 1], e[..., 0, 1]], axis=-1)


class Texture:
    def __init__(self, kind, seed):
        self.width, self.points = TEXTURES[kind]
        self.sharp = kind == "sharp"
        random, extent = np.random.default_rng(seed), SIDE + 160.0
        per_dot = math.pi * self.width**2 / 0.6 if self.sharp else 4 * self.width**2
        n = int(extent**2 / per_dot)
        self.at = random.uniform(-80, SIDE + 80, (2, n))
        self.at = self.at[:, np.argsort(np.round(self.at[1]) * 1000 + self.at[0])]
        self.height = np.ones(n) if self.sharp else 30 * random.choice((-1.0, 1.0), n) * random.uniform(0.5, 1.4, n)
        self.height *= 1 if self.sharp else math.sqrt(per_dot / (math.pi * self.width**2))

    def image(self, bodies, blur=0.0):
        """Grey levels without noise. A blur adds three Gauss-Hermite points in each direction."""
        offsets, weights = np.polynomial.legendre.leggauss(self.points)
        points = [(a / 2, w / 2) for a, w in zip(offsets, weights)]
        if blur:
            points = [(a + b, w * v) for a, w in points
                      for b, v in ((-(3**0.5) * blur, 1 / 6), (0, 2 / 3), (3**0.5 * blur, 1 / 6))]
        return sum(v * w * self.sample(bodies, a, b) for a, v in points for b, w in points)

    def sample(self, bodies, x, y):
        """Grey level at the places x + (column, row) of all pixels."""
        grey = np.full((SIDE, SIDE), GAP)
        for body in bodies:
            reach = math.ceil((1.1 if self.sharp else 4.0) * self.width * body.stretch()) + 1
            span = SIDE + 4 * reach
            places = np.arange(-2 * reach, SIDE + 2 * reach, dtype=float)
            material = body.material(*np.meshgrid(places + x, places + y)).astype(np.float32)
            mx, my = material.reshape(2, -1)
            middle = np.round(self.at + body.u(*self.at)).astype(int)
            near = np.all((middle > -reach) & (middle < SIDE + reach), axis=0)
            column, row = middle[:, near] + 2 * reach
            first, (ax, ay), height = row * span + column, self.at[:, near].astype(np.float32), self.height[near]
            total, k = np.zeros(span * span), np.float32(-0.5 / self.width**2)
            for dx, dy in ((i, j) for i in range(-reach, reach + 1) for j in range(-reach, reach + 1)):
                if math.hypot(dx, dy) > reach + 0.5:
                    continue
                pixel = first + (dy * span + dx)
                square = (mx[pixel] - ax) ** 2 + (my[pixel] - ay) ** 2
                if self.sharp:  # an edge of 0.3 px
                    value = np.clip(0.5 + (self.width - np.sqrt(square)) / 0.3, 0, 1)
                else:
                    value = height * np.exp(k * square)
                total += np.bincount(pixel, value, span * span)
            total = 55 + 140 * np.minimum(total, 1) if self.sharp else 120 + total
            seen = slice(2 * reach, 2 * reach + SIDE)
            material = material[:, seen, seen]
            grey = np.where(body.inside(*material), total.reshape(span, span)[seen, seen], grey)
        return grey


def compressed(image, quality=75):
    """What JPEG leaves of an 8 bit image."""
    k = np.arange(8)
    dct = np.sqrt(np.where(k == 0, 1, 2) / 8)[:, None] * np.cos((2 * k + 1) * k[:, None] * math.pi / 16)
    table = np.maximum(1, np.floor((QUANTISATION * (200 - 2 * quality) + 50) / 100))
    blocks = image.reshape(SIDE // 8, 8, SIDE // 8, 8).swapaxes(1, 2) - 128.0
    blocks = dct.T @ (np.round(dct @ blocks @ dct.T / table) * table) @ dct + 128
    return blocks.swapaxes(1, 2).reshape(SIDE, SIDE)


def write_exact(path, image):
    """A TIFF of 32 bit floats."""
    tags = [(256, SIDE), (257, SIDE), (258, 32), (259, 1), (262, 1), (273, 8), (277, 1), (278, SIDE),
            (279, 4 * SIDE * SIDE), (339, 3)]
    directory = struct.pack("<H", len(tags)) + b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags)
    head = struct.pack("<2sHI", b"II", 42, 8 + 4 * SIDE * SIDE)
    path.write_bytes(head + image.astype("<f4").tobytes() + directory + bytes(4))


def photograph(path, image, noise, random, jpeg):
    image = np.clip(np.round(image + random.normal(0, noise, image.shape)), 0, 255)
    image = np.clip(np.round(compressed(image)), 0, 255) if jpeg else image
    path.write_bytes(b"P5 %d %d 255\n" % (SIDE, SIDE) + image.astype(np.uint8).tobytes())


def correlate(program, out, reference, frames, *options):
    """The summary and the arrays of a run, or what it said when it refused."""
    words = [program, "correlate", "--output", out, "--overwrite", "--quiet", "--export", "none", "--no-report"]
    words = [str(word) for word in (*words, *options, "--reference", reference, *frames)]
    ran = subprocess.run(words, capture_output=True, text=True)
    if ran.returncode not in (0, 1):
        return ran.stderr.strip()[:300], None
    subprocess.run([str(program), "export", str(out), "--to", "npz", "--quiet"], check=True, capture_output=True)
    with np.load(out / "fields.npz", allow_pickle=False) as store:
        return json.loads((out / "summary.json").read_text()), {name: store[name] for name in store.files}


def rms(values):
    values = np.asarray(values, float)
    values = values[np.isfinite(values)]
    return math.sqrt(np.mean(values**2)) if values.size else math.nan


def stated(store, k, names=("sigma_px", "model_error_px", "bias_px")):
    """The root of the sum of squares of all these arrays that are there."""
    return np.sqrt(sum(np.nan_to_num(store[name][k].astype(float)) ** 2 for name in names if name in store))


def probe(program, out, bodies, frames):
    """z of points on two lines across the image; columns of a model error or bias count as soon as they are there."""
    lines = ["--line", "31,47,449,433", "--line", "40,440,443,29", "--step", "9", "--quiet"]
    subprocess.run([str(program), "probe", str(out), *lines], capture_output=True)
    table, found = out / "quantities/lines.csv", []
    if not table.is_file():
        return found
    with open(table) as text:
        for row in csv.DictReader(line for line in text if not line.startswith("#")):
            if int(row["frame"]) - 1 in frames and row["ux_px"] and row["sigma_ux_px"]:
                u = truth(bodies, *(np.float64(row[key]) for key in ("x_px", "y_px")))
                for c, name in enumerate(("ux", "uy")):
                    # No camera has drawn these scenes: what a usual one may be off is none of their errors.
                    parts = [float(v) for key, v in row.items()
                             if v and key.endswith(f"_{name}_px") and not key.startswith("camera_")]
                    found.append((float(row[f"{name}_px"]) - u[c]) / math.hypot(*parts))
    return found


def measure(program, scene, folder, references):
    """The runs with noise, that without, and the index of the first frame to judge."""
    name, _, texture, bodies, noise, more = scene
    dots, whole = Texture(texture, 7), len(bodies) > 1 or bodies[0].inside(MIDDLE, MIDDLE)
    key = texture if whole else name
    if key not in references:
        references[key] = dots.image([move((0, 0), inside=None if whole else bodies[0].inside)])
    before = [dots.image(b) for b in more.get("before", [])]
    images = [references[key], *before, dots.image(bodies, more.get("blur", 0))]
    if more.get("light"):
        images[-1] = images[-1] * (0.95 + 0.2 * (COLUMNS - MIDDLE) / SIDE) + 6
    random, runs, again = np.random.default_rng(sum(map(ord, name))), [], ["--case", folder / "out0/run.toml"]
    for draw in range(DRAWS):
        paths = [folder / f"{draw}-{k:02}.pgm" for k in range(len(images) + FRAMES - 1)]
        for path, image in zip(paths, images + images[-1:] * (FRAMES - 1)):
            photograph(path, image, noise, random, more.get("jpeg"))
        words = again if draw else ["--strain-window", 5, *more.get("options", [])]
        runs.append(correlate(program, folder / f"out{draw}", paths[0], paths[1:], *words))
        if runs[-1][1] is None:
            return runs, None, 0
    paths = [folder / f"exact-{k:02}.tif" for k in range(len(images))]
    for path, image in zip(paths, images):
        write_exact(path, image)
    # Light is followed as it was with noise: without, any change is significant.
    smooth = '"light":' in json.dumps([summary["frames"] for summary, _ in runs])
    light = ["--brightness", "smooth" if smooth else "zone"]
    return runs, correlate(program, folder / "exact", paths[0], paths[1:], *again, *light), len(images) - 2


def field(store, k):
    return np.where(store["measured"][k][:, None] > 0, store["displacement_px"][k], np.nan)


def unfollowed(store, bodies):
    """The motion that each element misses inside: rms of either component over 4 x 4 points, without noise."""
    s, t = (a.ravel() for a in np.meshgrid(*[(np.arange(4) + 0.5) / 4] * 2))
    shape = np.array([(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t]).T
    inner = lambda values: np.einsum("pc,ec...->ep...", shape, values[store["element_nodes"].astype(int)])
    right = truth(bodies, *np.moveaxis(inner(store["node_position_px"]), -1, 0))
    off = right - inner(field(store, -1))
    with np.errstate(invalid="ignore", divide="ignore"):
        missed = np.sqrt(np.nansum(off**2, 1) / np.isfinite(off).sum(1))
    missed[store["mark"][-1] == 6] = np.inf
    missed[np.isfinite(right[..., 0]).mean(1) < 0.5] = np.nan
    return missed


def judge_frame(store, k, status, bodies, exact, missed):
    """Arrays of one frame by what they are; `n` counts elements and nodes."""
    x, y = store["node_position_px"].T
    corners, mark = store["element_nodes"].astype(int), store["mark"][k]
    right = truth(bodies, x, y)
    error, true = field(store, k) - right, field(exact, -1) - right
    on = np.isfinite(error)
    arrays = store["sigma_px"][k].astype(float), store["model_error_px"][k].astype(float), true
    sigma, model, true = (np.where(on, a, np.nan) for a in arrays)
    like = [name for name in store if "strain_window" in name and name != "strain_window"]
    like = [name for name in like if store[name].shape == store["sigma_strain_window"].shape]
    window = (store["strain_window"][k] - strain(bodies, x, y)) / stated(store, k, like)
    mean = np.nanmean(error, 0)
    ratio = np.max(missed / np.where(on, sigma, np.nanmedian(sigma, 0))[corners].mean(1), 1)
    measured, marked = (mark <= 2) & on[corners].all((1, 2)), np.isin(mark, (1, 2, 5, 6))
    alone, far = np.ones(len(x), bool), np.abs(true) > sigma
    alone[corners[~(ratio < 1)].ravel()] = False
    near = alone[:, None] & (np.abs(true) <= sigma)
    n = {"elements": measured, "marked": measured & marked, "followed": ratio < 1, "false": marked & (ratio < 1),
         "misfit": ratio > 3, "missed": measured & ~marked & (ratio > 3), "all": mark >= 0, "values": on,
         "far": far, "near": near, "nodes": on.all(1) & (status == "converged")}
    n["bad"] = n["nodes"] & ((np.abs(error) > 5 * stated(store, k)) & (np.abs(error) > 0.1)).any(1)
    return {"error": error, "true": true, "sigma": sigma, "model": model, "z window": window, "mean": mean,
            "z": error / stated(store, k), "z noise": (error - true) / sigma,
            "z mean": mean / np.sqrt(np.nanmean(sigma**2, 0) / (3 * len(corners))), "far model": model[far],
            "far true": true[far], "near model": model[near], "near sigma": sigma[near],
            "n": {key: int(part.sum()) for key, part in n.items()} | {c: int(np.sum(mark == c)) for c in NAMES}}


def judge(program, scene, folder, references):
    """Draws, correlates and judges one scene; a dict of numbers."""
    result, bodies = {"scene": scene[0], "kind": scene[1]}, scene[3]
    runs, exact, first = measure(program, scene, folder, references)
    if exact is None or exact[1] is None:
        return result | {"status": (exact or runs[-1])[0]}
    missed, judged, points, frames = unfollowed(exact[1], bodies), [], [], []
    for draw, (summary, store) in enumerate(runs):
        steps = range(first, first + FRAMES)
        frames += [summary["frames"][k] for k in steps]
        judged += [judge_frame(store, k, summary["frames"][k]["status"], bodies, exact[1], missed)
                   for k in steps if store["measured"][k].any()]
        points += probe(program, folder / f"out{draw}", bodies, steps)
    words = [frame["status"] for frame in frames]
    status = ", ".join(w if words.count(w) == len(words) else f"{words.count(w)} {w}" for w in dict.fromkeys(words))
    last, steps = exact[0]["frames"][-1], [s.get("reference_updates", []) for s, _ in (*runs, exact)]
    status += "" if last["status"] == "converged" else f" (without noise: {last['status']})"
    status += f"; references {', '.join(map(str, steps))}" if any(steps) else ""
    if not judged:
        return result | {"status": status}
    value = {key: rms(np.concatenate([np.ravel(j[key]) for j in judged])) for key in judged[0] if key != "n"}
    n = {key: sum(j["n"][key] for j in judged) for key in judged[0]["n"]}
    return result | value | {
        "status": status, "n": n, "frames": len(judged), "z points": rms(points),
        "seconds": sum(frame["seconds"] for frame in frames) / len(frames),
        "m/true": value["far model"] / value["far true"] if n["far"] >= 40 else math.nan,
        "m/sigma": value["near model"] / value["near sigma"] if n["near"] >= 40 else math.nan}


def scenes():
    """(name, kind, texture, bodies, noise in grey levels, what else)"""
    def part(by):
        return {"options": ["--roi", f"{MIDDLE - 228 / by:.0f},20,{MIDDLE + 228 / by:.0f},{SIDE - 20}"]}

    for texture in ("soft", "sharp", "fine", "coarse"):
        yield f"{texture}-shift", "affine", texture, [move((0.5, 0.3))], 2, {}
    for texture in ("soft", "sharp"):
        yield f"{texture}-strain-1%", "affine", texture, stretch(1.01), 2, {}
    for texture, by in (("soft", 1.08), ("soft", 1.24), ("sharp", 1.24), ("soft", 1.4)):
        yield f"{texture}-stretch-{by}", "affine", texture, stretch(by), 2, part(by)
    for name, rule in (("", "residual"), ("-chain", "every 4")):
        yield f"soft-stretch-1.8{name}", "affine", "soft", stretch(1.8), 2, {
            "before": [stretch(1 + k / 10) for k in range(1, 8)],
            "options": [*part(1.8)["options"], "--update-reference", rule]}
    for degrees in (5, 20):
        yield f"soft-turn-{degrees}", "affine", "soft", turn(degrees), 2, {}
    heights = {512: 1.0, 256: 1.0, 128: 0.7, 96: 0.6, 64: 0.5, 48: 0.4, 32: 0.3}
    for period, height in heights.items():
        yield f"soft-wave-{period}", "wave", "soft", wave(period, height), 2, {}
    for texture, period in (("sharp", 256), ("sharp", 64), ("coarse", 128), ("fine", 64)):
        yield f"{texture}-wave-{period}", "wave", texture, wave(period, heights[period]), 2, {}
    for period in (128, 64):  # where little noise hides it
        yield f"soft-wave-{period}-noise-0.5", "wave", "soft", wave(period, heights[period]), 0.5, {}
    yield "soft-wave-64-12px", "wave", "soft", wave(64, 0.5), 2, {"options": ["--element-size", "12"]}
    yield "soft-wave-128-24px", "wave", "soft", wave(128, 0.7), 2, {"options": ["--element-size", "24"]}
    yield "sharp-shift-12px", "affine", "sharp", [move((0.5, 0.3))], 2, {"options": ["--element-size", "12"]}
    for texture in ("soft", "sharp"):
        yield f"{texture}-crack", "jump", texture, crack(2.0), 2, {}
    yield "soft-hole", "jump", "soft", hole(45), 2, {}
    yield "soft-slide", "jump", "soft", slide(1.0), 2, {}
    yield "soft-light", "image", "soft", stretch(1.01), 2, {"light": True}
    yield "soft-blur-0.3", "image", "soft", stretch(1.01), 2, {"blur": 0.3}
    yield "soft-blur-0.6", "image", "soft", stretch(1.01), 2, {"blur": 0.6}
    yield "soft-jpeg", "image", "soft", stretch(1.01), 2, {"jpeg": True}
    yield "sharp-jpeg-wave-128", "image", "sharp", wave(128, 0.7), 2, {"jpeg": True}
    for noise in (0.5, 1, 4, 8, 16):
        # A user has to draw the zone in the strongest noise.
        yield f"soft-noise-{noise}", "noise", "soft", stretch(1.01), noise, part(1) if noise == 16 else {}


def bilinear(store, values, at):
    """Values of nodes between them, on a mesh of rectangles; NaN off it."""
    corners, nodes = store["element_nodes"].astype(int), store["node_position_px"]
    low, high = nodes[corners].min(1), nodes[corners].max(1)
    inside = np.all((at[:, None] >= low) & (at[:, None] <= high), axis=2)
    element = inside.argmax(1)
    s, t = ((at - low[element]) / (high - low)[element]).T
    weights = np.array([(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t]).T
    found = np.einsum("pc,pcd->pd", weights, values[corners[element]])
    found[~inside.any(1)] = np.nan
    return found


def real_sets(data):
    """(folder, images, options, what is known of a frame at nodes: places and displacements, or nothing)"""
    everywhere = lambda u: lambda frame, nodes: (nodes, np.array([u(frame, *xy) for xy in nodes]))
    five = [f"Sample5{k}.tif" for k in (" Reference", "-000 X0.00 Y0.00 N2 C75 R10", "-001 X0.10 Y0.10 N2 C100 R20")]
    yield "dicchallenge-s05-contrast", five, [], everywhere(lambda k, x, y: [0.1 * k] * 2)

    def dice(frame, nodes):
        file = data / f"dicchallenge-s12-openhole/reference/DICe_solution_{frame + 1:02}.txt"
        rows = np.genfromtxt(file, delimiter=",", skip_header=22, usecols=range(4))
        rows = rows[np.hypot(rows[:, 0] - 192.5, rows[:, 1] - 541.4) > 120]
        return rows[:, :2], rows[:, 2:4]
    yield "dicchallenge-s12-openhole", [f"oht_cfrp_{k:02}.tiff" for k in range(12)], [], dice

    def sinusoid(frame, nodes):
        file = data / "dicchallenge-s14-sinusoid/truth_command.csv"
        rows = np.genfromtxt(file, delimiter=",", skip_header=1, usecols=(0, 1, 3, 5))
        nodes = nodes[(nodes[:, 0] > 100) & (nodes[:, 0] < 1940)]
        return nodes, np.stack([np.interp(nodes[:, 0], rows[:, 0], rows[:, 1 + frame]), 0 * nodes[:, 0]], 1)
    fourteen = [f"Sample14 L{k} Amp0.1b.tif" for k in (1, 3, 5)]
    yield "dicchallenge-s14-sinusoid", ["Sample14 Reference.tif", *fourteen], ["--roi", "100,100,1956,484"], sinusoid
    star = ["DIC_Challenge_Star_Noise_Ref.tiff", "DIC_Challenge_Star_Noise_Def.tiff"]
    yield "dicchallenge2-star", star, ["--roi", "4,10,3996,500"], everywhere(
        lambda k, x, y: (0, 0.5 * math.cos(2 * math.pi * (y - 250) / (10 + 290 * x / 4000))))
    sin, cos = math.sin(math.radians(-170)), math.cos(math.radians(-170))
    yield "rotation-170", ["rotation_000.tif", "rotation_170.tif"], ["--roi", "120,120,392,392"], everywhere(
        lambda k, x, y: ((cos - 1) * (x - 256) - sin * (y - 256), sin * (x - 256) + (cos - 1) * (y - 256)))
    yield "openhole-bmp", ["oht_cfrp_0.bmp", "oht_cfrp_4.bmp"], [], None
    yield "sundic-necking", [f"img_{k}.tif" for k in range(5)], ["--update-reference", "residual"], None
    yield "crack-heterogeneous", [f"img_{30 * k:04} .png" for k in (0, 1, 2, 4, 7, 10)], [], None


def show_real(program, data, folder, wanted, say):
    say("\n| real images | frame | status | residual % | sigma mpx (median) | model mpx (median) | "
        "model mpx (rms) | marked % | elements by mark | error mpx | z |\n|" + " --- |" * 11)
    for name, images, options, known in real_sets(data):
        if not (data / name).is_dir() or not wanted(name):
            continue
        paths = [data / name / image for image in images]
        summary, store = correlate(program, folder / name, paths[0], paths[1:], *options)
        if store is None:
            say(f"| {name} | | {summary} | | | | | | | | |")
            continue
        for k, frame in enumerate(summary["frames"]):
            sigma, model, mark = store["sigma_px"][k], store["model_error_px"][k], store["mark"][k]
            on = store["measured"][k] > 0
            error = z = math.nan
            if known and on.any():
                at, right = known(k, store["node_position_px"][on])
                values = np.where(on[:, None], store["displacement_px"][k], np.nan)
                off = bilinear(store, values, at) - right
                error, z = rms(off), rms(off / bilinear(store, stated(store, k), at))
            names = ", ".join(f"{int(np.sum(mark == c))} {word}" for c, word in NAMES.items() if np.any(mark == c))
            marked = np.isin(mark, (1, 2)).sum() / max(1, (mark <= 2).sum())
            residual = frame.get("residual_percent") or math.nan
            middle = [1e3 * np.median(a[on]) if on.any() else math.nan for a in (sigma, model)]
            numbers = residual, *middle, 1e3 * rms(model[on]), 100 * marked
            say(f"| {name} | {frame['number']} | {frame['status']} | " + " | ".join(f"{v:.2f}" for v in numbers)
                + f" | {names} | {1e3 * error:.1f} | {z:.2f} |")


HEAD = ["scene", "status", "error mpx", "true mpx", "sigma mpx", "model mpx", "z", "z noise", "z points", "z window",
        "mean mpx", "z mean", "m/true (share %)", "m/sigma", "follow %", "misfit %", "marked %", "false %", "missed %",
        "bad %", "elements by mark", "s"]
SHARES = [("followed", "all"), ("misfit", "all"), ("marked", "elements"), ("false", "followed"), ("missed", "misfit"),
          ("bad", "nodes")]
LIMITS = {"m/true": (0.5, 2), "m/sigma": (0, 1)} | dict.fromkeys(("z", "z points", "z window"), (0.85, 1.15))
SHORT = ("sharp-shift", "soft-stretch-1.24", "soft-turn-5", "soft-wave-256", "soft-wave-64", "soft-crack",
         "soft-blur-0.6", "soft-noise-8")


def share(n, part, whole):
    return 100 * n[part] / n[whole] if n[whole] else math.nan


def cells(r):
    if "n" not in r:
        return [r["scene"], r["status"], *[""] * (len(HEAD) - 2)]
    n = r["n"]
    counts = [(n[code] / r["frames"], word) for code, word in NAMES.items()]
    names = ", ".join(f"{count:.0f} {word}" for count, word in counts if count >= 0.5)
    return [r["scene"], r["status"], *(f"{1e3 * r[key]:.1f}" for key in ("error", "true", "sigma", "model")),
            *(f"{r[key]:.2f}" for key in ("z", "z noise", "z points", "z window")), f"{1e3 * r['mean']:.2f}",
            f"{r['z mean']:.1f}", f"{r['m/true']:.2f} ({share(n, 'far', 'values'):.0f})", f"{r['m/sigma']:.2f}",
            *(f"{share(n, *pair):.1f}" for pair in SHARES), names, f"{r['seconds']:.2f}"]


def show_kinds(done, say):
    """The table of docs/correlation.md: the scenes of each kind, smallest and largest value."""
    say("\n| scenes | " + " | ".join(LIMITS) + " | false % | missed % |\n|" + " --- |" * (len(LIMITS) + 3))
    for kind in dict.fromkeys(r["kind"] for r in done):
        of_kind = [r for r in done if r["kind"] == kind]
        spans = []
        for key in LIMITS:
            values = [r[key] for r in of_kind if math.isfinite(r[key])]
            spans.append(f"{min(values):.2f} to {max(values):.2f}" if values else "")
        for part, whole in SHARES[3:5]:
            n = sum(r["n"][whole] for r in of_kind)
            spans.append(f"{100 * sum(r['n'][part] for r in of_kind) / n:.1f}" if n else "")
        say(f"| {len(of_kind)} {kind} | " + " | ".join(spans) + " |")


def summarise(results, say):
    """Says what came out over all scenes; the limits that failed."""
    done, failed = [r for r in results if "n" in r], [f"{r['scene']}: {r['status']}" for r in results if "n" not in r]
    total = {key: sum(r["n"][key] for r in done) for key in (done[0]["n"] if done else ())}
    if not done:
        return failed
    false, missed = share(total, "false", "followed"), share(total, "missed", "misfit")
    show_kinds(done, say)
    say(f"\n- false marks: {false:.2f} % of {total['followed']} elements that follow (limit 2 %)")
    say(f"- found: {100 - missed:.1f} % of {total['misfit']} elements that miss more than 3 sigma (limit 95 %)")
    failed += [f"false marks {false:.2f} %"] if false > 2 else []
    failed += [f"found {100 - missed:.1f} %"] if missed > 5 else []
    bad = {r["scene"]: share(r["n"], "bad", "nodes") for r in done}
    failed += [f"{name}: bad {percent:.1f} %" for name, percent in bad.items() if percent > 1]
    for key, (low, high) in LIMITS.items():
        known = [r for r in done if math.isfinite(r[key])]
        out = [r for r in known if not low <= r[key] <= high]
        failed += [f"{r['scene']}: {key} {r[key]:.2f}" for r in out]
        say(f"- {key}: {len(known) - len(out)} of {len(known)} scenes within {low} to {high}")
    return failed


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--binary", type=pathlib.Path, default=ROOT / "target/release/quadrille")
    parser.add_argument("--scenes", help="names of scenes and real sets, separated by commas; parts of names do")
    parser.add_argument("--short", action="store_true", help="eight scenes, no real images")
    data = os.environ.get("QUADRILLE_DATA", ROOT.parent / "shared/data")
    parser.add_argument("--data", type=pathlib.Path, default=data, help="folder of the real images")
    parser.add_argument("--no-real", action="store_true", help="no real images")
    parser.add_argument("--keep", type=pathlib.Path, help="folder for images and results, which stay")
    parser.add_argument("--out", type=pathlib.Path, help="the tables go into this file as well")
    args = parser.parse_args()
    program, begin, lines = args.binary.resolve(), time.monotonic(), []
    if not program.is_file():
        print(f"{program}: no such program; build it, or name one with --binary", file=sys.stderr)
        return 2

    def say(line):
        print(line, flush=True)
        lines.append(line)

    def wanted(name):
        words = (args.scenes or "").split(",")
        return (not args.short or name in SHORT) and any(word in name for word in words if word or not args.scenes)

    chosen = [scene for scene in scenes() if wanted(scene[0])]
    folder = pathlib.Path(args.keep or tempfile.mkdtemp(prefix="verdicts-")).resolve()
    try:
        say("| " + " | ".join(HEAD) + " |\n|" + " --- |" * len(HEAD))
        results, references = [], {}
        for scene in chosen:
            here = folder / scene[0]
            here.mkdir(parents=True, exist_ok=True)
            results.append(judge(program, scene, here, references))
            say("| " + " | ".join(cells(results[-1])) + " |")
            if not args.keep:
                shutil.rmtree(here)
        failed = summarise(results, say)
        if not (args.no_real or args.short) and args.data.is_dir():
            show_real(program, args.data.resolve(), folder, wanted, say)
    finally:
        if not args.keep:
            shutil.rmtree(folder)
    say(f"\n{time.monotonic() - begin:.0f} s")
    for line in failed:
        say(f"NOT MET: {line}")
    if args.out:
        args.out.write_text("\n".join(lines) + "\n")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
