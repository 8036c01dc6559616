#!/usr/bin/env python3
"""What gets in the way of a measurement, one obstacle at a time, on images whose displacement is known.

    scripts/obstacles.py [--output FOLDER] [--quadrille PROGRAM] [--only NAME,NAME] [--keep]

The images are drawn here, not by quadrille: Gaussian spots, looked up where an affine motion says that the material of each pixel
was, noise of 2 grey levels, 8 bit, 512 x 512 px. Every scene is correlated with a drawn zone and no other option, and once more
without its obstacle, motion and noise to the bit the same. Printed is a table:

    frames         how they ended
    measured       nodes with a result in a converged frame, of all nodes and frames
    error          of nodes none of whose elements the obstacle touches (measured, not marked): rms over that without the obstacle
    bad named      nodes without a result or marked, of those that are off by more than five sigma or, touched, have no result
    good lost      nodes without a result or marked, of those that the obstacle does not touch and that are not off
    off, no mark   nodes of converged frames, off by more than five sigma and not marked: there should be none

Of a frame that did not converge all nodes count as nodes without a result. FOLDER/frames.csv has the same for every frame.
A node is marked where the column `mark` of the table of displacements says another word than `none`; without the column none is.
Needs numpy."""

import argparse
import csv
import json
import math
import pathlib
import shutil
import struct
import subprocess
import sys
import zlib

try:
    import numpy as np
except ImportError:
    sys.exit("obstacles.py needs numpy: pip install -r scripts/requirements.txt, or .venv/bin/python after make test")

ROOT = pathlib.Path(__file__).resolve().parent.parent
SIDE = 512
NOISE = 2.0
SPOT = 2.0  # standard deviation of a spot, px
LEVEL = 30.0  # grey level between the spots
ZONE = (40, 40, 472, 472)
ELEMENT = 16  # the default of quadrille
SUPPORT = 2  # pixels beyond an element that interpolation looks at
SIGMAS = 5.0

ROWS, COLUMNS = (a.astype(float) for a in np.mgrid[0:SIDE, 0:SIDE])
EVERYWHERE = np.ones((SIDE, SIDE), bool)


class Affine:
    """The motion x = X + shift + gradient (X - middle)."""

    def __init__(self, shift, gradient=((0.0, 0.0), (0.0, 0.0))):
        self.shift, self.gradient = np.array(shift, float), np.array(gradient, float)

    def displacement(self, x, y):
        b = self.gradient
        dx, dy = x - SIDE / 2, y - SIDE / 2
        return self.shift[0] + b[0, 0] * dx + b[0, 1] * dy, self.shift[1] + b[1, 0] * dx + b[1, 1] * dy

    def material(self, x, y):
        """Where the material that is at (x, y) was at first."""
        inverse = np.linalg.inv(np.eye(2) + self.gradient)
        dx, dy = x - SIDE / 2 - self.shift[0], y - SIDE / 2 - self.shift[1]
        return SIDE / 2 + inverse[0, 0] * dx + inverse[0, 1] * dy, SIDE / 2 + inverse[1, 0] * dx + inverse[1, 1] * dy


REST = Affine((0.0, 0.0))


class Spots:
    """Gaussian spots; `blur` makes them wider and lower, as a lens out of focus does."""

    def __init__(self, seed, period=None):
        random = np.random.default_rng(seed)
        if period:
            along = np.arange(-10 * period, SIDE + 10 * period, period) + 3.3
            self.x, self.y = (a.ravel() for a in np.meshgrid(along, along))
            self.height = np.full(self.x.size, 120.0)
        else:
            reach = 64
            n = int((SIDE + 2 * reach) ** 2 / (7.0 * SPOT**2))
            self.x, self.y = random.uniform(-reach, SIDE + reach, (2, n))
            self.height = random.uniform(33.0, 88.0, n)

    def image(self, motion=REST, blur=0.0):
        """Grey levels without noise; those of a pixel are the sum of the spots at its place in the material."""
        x, y = motion.material(COLUMNS, ROWS)
        u, v = motion.displacement(self.x, self.y)
        near = [np.round(self.x + u).astype(int), np.round(self.y + v).astype(int)]
        width = math.hypot(SPOT, blur)
        height = self.height * (SPOT / width) ** 2
        grey = np.full(SIDE * SIDE, LEVEL)
        reach = math.ceil(5.0 * width) + 1
        for dy in range(-reach, reach + 1):
            for dx in range(-reach, reach + 1):
                column, row = near[0] + dx, near[1] + dy
                inside = (column >= 0) & (column < SIDE) & (row >= 0) & (row < SIDE)
                column, row = column[inside], row[inside]
                r2 = (x[row, column] - self.x[inside]) ** 2 + (y[row, column] - self.y[inside]) ** 2
                value = height[inside] * np.exp(-0.5 * r2 / width**2)
                grey += np.bincount(row * SIDE + column, value, SIDE * SIDE)
        return grey.reshape(SIDE, SIDE)


def recorded(grey, seed):
    """What an 8 bit camera makes of it."""
    noise = np.random.default_rng(seed).normal(0.0, NOISE, grey.shape)
    return np.clip(np.round(grey + noise), 0, 255).astype(np.uint8)


def write_png(path, image):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows = np.hstack([np.zeros((image.shape[0], 1), np.uint8), image]).tobytes()
    head = struct.pack(">IIBBBBB", image.shape[1], image.shape[0], 8, 0, 0, 0, 0)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows, 1)) + chunk(b"IEND", b""))


class Frame:
    """A deformed image with the obstacle and without: grey levels, and what the obstacle touches.

    `in_image` and `in_material` are masks of pixels of the deformed image and of the reference. `truth` gives the displacement of
    places of the reference, `clean_truth` that of the image without the obstacle where it is another one."""

    def __init__(self, truth, clean, grey, in_image=None, in_material=None, clean_truth=None):
        nothing = np.zeros((SIDE, SIDE), bool)
        self.truth, self.clean, self.grey = truth, clean, grey
        self.clean_truth = truth if clean_truth is None else clean_truth
        self.in_image = nothing if in_image is None else in_image
        self.in_material = nothing if in_material is None else in_material


class Scene:
    """Images with an obstacle; `reference_clean` where the reference without the obstacle is another one."""

    def __init__(self, name, reference, frames, reference_clean=None):
        self.name, self.reference, self.frames = name, reference, frames
        self.reference_clean = reference if reference_clean is None else reference_clean


def loaded(k):
    """Instant k of the series: some tenths of a pixel further, stretched and turned a little more."""
    return Affine((0.35 * k, -0.23 * k), np.array([[8e-4, 2e-4], [-3e-4, -2.5e-4]]) * k)


class Series:
    """Six instants of one specimen, which all series have in common."""

    def __init__(self):
        self.spots = Spots(1)
        self.motions = [loaded(k) for k in range(1, 7)]
        self.reference = self.spots.image()
        self.images = [self.spots.image(motion) for motion in self.motions]

    def scene(self, name, change):
        """`change(k, grey)` gives the image with the obstacle and its masks, k from 1."""
        frames = []
        for k, (motion, clean) in enumerate(zip(self.motions, self.images), 1):
            frames.append(Frame(motion.displacement, clean, *change(k, clean)))
        return Scene(name, self.reference, frames)


def block(k, grey):
    x0 = 500 - 32 * k
    covered = (COLUMNS >= x0) & (np.abs(ROWS - 250) < 70)
    return np.where(covered, 110.0 + 0.1 * (COLUMNS - x0), grey), covered


def hole(series):
    def change(k, grey):
        x, y = series.motions[k - 1].material(COLUMNS, ROWS)
        inside = (x - 230) ** 2 + (y - 270) ** 2 < (6.0 + 9.0 * k) ** 2
        of_material = (COLUMNS - 230) ** 2 + (ROWS - 270) ** 2 < (6.0 + 9.0 * k) ** 2
        return np.where(inside, 12.0, grey), inside, of_material

    return change


def glare(k, grey):
    light = 400.0 * np.exp(-((COLUMNS - 120 - 45 * k) ** 2 + (ROWS - 180 - 20 * k) ** 2) / (2 * 22.0**2))
    return grey + light, light > 1.0


def torn(series):
    """Rows of another instant, black rows, half a frame.

    Rows of another instant show the specimen as it was then, and are measured as that: the truth is what the image shows, and what is
    touched is the seam."""
    rows_of = {2: (ROWS >= 300, 6), 3: ((ROWS >= 150) & (ROWS < 200), None), 4: (ROWS < 180, 1), 5: (ROWS >= 256, None)}

    def frame(k):
        own, clean = series.motions[k - 1], series.images[k - 1]
        if k not in rows_of:
            return Frame(own.displacement, clean, clean)
        rows, other = rows_of[k]
        if other is None:
            return Frame(own.displacement, clean, np.where(rows, 0.0, clean), rows)
        then = series.motions[other - 1]

        def truth(x, y):
            u, v = then.displacement(x, y)
            shown = rows[np.clip(np.round(y + v).astype(int), 0, SIDE - 1), 0]
            return tuple(np.where(shown, a, b) for a, b in zip((u, v), own.displacement(x, y)))

        seam = rows & (~np.roll(rows, 1, 0) | ~np.roll(rows, -1, 0))
        seam[[0, -1]] = False
        return Frame(truth, clean, np.where(rows, series.images[other - 1], clean), seam, None, own.displacement)

    return Scene("torn frames", series.reference, [frame(k) for k in range(1, 7)])


def dust(spots, motion):
    random = np.random.default_rng(5)
    lying = np.zeros((SIDE, SIDE), bool)
    for x, y, r in zip(*random.uniform(60, 450, (2, 25)), random.uniform(2.5, 5.0, 25)):
        lying |= (COLUMNS - x) ** 2 + (ROWS - y) ** 2 < r * r
    rest, moved = spots.image(), spots.image(motion)
    frame = Frame(motion.displacement, moved, np.where(lying, 15.0, moved), lying, lying)
    return Scene("dust, 25 spots", np.where(lying, 15.0, rest), [frame], rest)


def reflection(spots, motion):
    mirrored = Spots(77).image()
    rest, moved = spots.image(), spots.image(motion)
    frame = Frame(motion.displacement, moved, 0.7 * moved + 0.3 * mirrored, EVERYWHERE)
    return Scene("reflection of 30 %", 0.7 * rest + 0.3 * mirrored, [frame], rest)


def shadow(spots, motion):
    def light(x, y, at):
        return 1.0 - 0.45 / (1.0 + np.exp((x + 0.4 * y - at) / 6.0))

    rest, moved = spots.image(), spots.image(motion)
    u, v = motion.displacement(COLUMNS, ROWS)
    before = light(COLUMNS, ROWS, 260.0)
    # What is dark in both images has less texture, and so more noise than without the shadow.
    dark = np.minimum(before, light(COLUMNS + u, ROWS + v, 330.0)) < 0.98
    frame = Frame(motion.displacement, moved, moved * light(COLUMNS, ROWS, 330.0), None, dark)
    return Scene("moving shadow", rest * before, [frame], rest)


def split(name, spots, above, below, row, gap=False, clean=None):
    """Two motions on either side of a row of the reference; what opens between is dark."""
    rest = spots.image()
    y_above, y_below = above.material(COLUMNS, ROWS)[1], below.material(COLUMNS, ROWS)[1]
    upper, lower = y_above < row, y_below >= row
    moved = np.where(upper, spots.image(above), spots.image(below))
    if gap:
        moved = np.where(~upper & ~lower, 15.0, moved)

    def truth(x, y):
        return tuple(np.where(y < row, a, b) for a, b in zip(above.displacement(x, y), below.displacement(x, y)))

    line = np.abs(ROWS - (row - 0.5)) < 1.0
    motion = above if clean is None else clean
    return Scene(name, rest, [Frame(truth, spots.image(motion), moved, ~upper & ~lower, line, motion.displacement)])


def blurred(spots, motion):
    frame = Frame(motion.displacement, spots.image(motion), spots.image(motion, blur=1.5), EVERYWHERE)
    return Scene("out of focus by 1.5 px", spots.image(), [frame])


def lattice(shift, period):
    motion, grid, spots = Affine(shift), Spots(0, period), Spots(3)
    frame = Frame(motion.displacement, spots.image(motion), grid.image(motion), EVERYWHERE)
    return Scene(f"grid of {period} px moved by {shift[0]} px", grid.image(), [frame], spots.image())


def scenes():
    """Each by its name and what makes it."""
    series = Series()
    spots, motion = Spots(2), Affine((2.6, -1.3), ((6e-4, 1e-4), (-2e-4, -1.5e-4)))
    yield "block", lambda: series.scene("block moving in", block)
    yield "hole", lambda: series.scene("hole growing", hole(series))
    yield "glare", lambda: series.scene("glare wandering", glare)
    yield "torn", lambda: torn(series)
    yield "dust", lambda: dust(spots, motion)
    yield "reflection", lambda: reflection(spots, motion)
    yield "shadow", lambda: shadow(spots, motion)
    yield "strip", lambda: split("strip at rest beside a moving one", spots, REST, Affine((3.2, 0.4)), 259, clean=Affine((3.2, 0.4)))
    yield "slip", lambda: split("slip of 2 px", spots, Affine((1.3, 0.3)), Affine((-0.7, 0.3)), 259)
    # The gap is 1.5 px wide at the left border of the image and 3 px at the right.
    half = ((0.0, 0.0), (-0.75 / SIDE, 0.0)), ((0.0, 0.0), (0.75 / SIDE, 0.0))
    yield "crack", lambda: split("crack of 1.5 to 3 px", spots, Affine((0.3, -1.125), half[0]), Affine((0.3, 1.125), half[1]), 259, gap=True)
    yield "focus", lambda: blurred(spots, motion)
    yield "grid", lambda: lattice((7.3, 0.4), 12)


# ---- what quadrille makes of them ----


class Ran:
    """A run of quadrille: how each frame ended and its table, or why it was refused."""

    def __init__(self, program, folder, images):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        paths = []
        for k, image in enumerate(images):
            paths.append(folder / f"{k:02}.png")
            write_png(paths[-1], image)
        words = [str(program), "correlate", "--overwrite", "--no-report", "--export", "csv", "--roi", ",".join(map(str, ZONE))]
        ran = subprocess.run([*words, "--output", str(folder / "out"), *map(str, paths)], capture_output=True, text=True)
        (folder / "said.txt").write_text(ran.stderr)
        self.refused = ran.stderr.strip().splitlines()[-1].removeprefix("quadrille: ") if ran.returncode not in (0, 1) else None
        self.frames = []
        if self.refused is None:
            summary = json.load(open(folder / "out/summary.json"))
            for frame in summary["frames"]:
                table = folder / f"out/csv/{frame['number']:06}.csv"
                self.frames.append((frame["status"], read_table(table) if table.is_file() else {}))

    def converged(self, k):
        """The table of frame k, without any node unless it converged."""
        if k >= len(self.frames) or self.frames[k][0] != "converged":
            return {}
        return self.frames[k][1]


def read_table(path):
    """Displacement, sigma and mark of each node with a result, by its place."""
    with open(path) as lines:
        rows = csv.DictReader(line for line in lines if not line.startswith("#"))
        keys = ("ux_px", "uy_px", "sigma_ux_px", "sigma_uy_px")
        return {
            (float(row["x_px"]), float(row["y_px"])): ([float(row[key]) for key in keys], row.get("mark") or "none")
            for row in rows
        }


def nodes_of_zone():
    x0, y0, x1, y1 = ZONE
    return [(float(x), float(y)) for y in range(y0, y1 + 1, ELEMENT) for x in range(x0, x1 + 1, ELEMENT)]


def touched(frame, x, y):
    """Whether the obstacle touches one of the four elements of the node at (x, y)."""
    far = ELEMENT + SUPPORT
    u, v = (float(component) for component in frame.truth(np.float64(x), np.float64(y)))

    def any_in(mask, x, y):
        rows = slice(max(0, math.floor(y - far)), max(0, math.ceil(y + far) + 1))
        columns = slice(max(0, math.floor(x - far)), max(0, math.ceil(x + far) + 1))
        return bool(mask[rows, columns].any())

    return any_in(frame.in_image, x + u, y + v) or any_in(frame.in_material, x, y)


def judged(frame, found, clean):
    """The sums of one frame."""
    sums = dict.fromkeys(("nodes", "measured", "bad", "named", "off_unmarked", "good", "lost", "n_good"), 0)
    squares = [0.0, 0.0]
    for place in nodes_of_zone():
        x, y = np.float64(place[0]), np.float64(place[1])
        truth = [float(component) for component in frame.truth(x, y)]
        hit = touched(frame, *place)
        row = found.get(place)
        sums["nodes"] += 1
        sums["measured"] += row is not None
        off = marked = False
        if row is not None:
            (u, v, sigma_u, sigma_v), mark = row
            errors = (u - truth[0], v - truth[1])
            marked = mark != "none"
            off = any(abs(error) > SIGMAS * sigma for error, sigma in zip(errors, (sigma_u, sigma_v)))
        if off or (hit and row is None):
            sums["bad"] += 1
            sums["named"] += row is None or marked
            sums["off_unmarked"] += off and not marked
        if not hit and not off:
            sums["good"] += 1
            sums["lost"] += row is None or marked
        if not hit and row is not None and not marked and place in clean:
            exact = [float(component) for component in frame.clean_truth(x, y)]
            squares[0] += sum(error * error for error in errors)
            squares[1] += sum((w - e) ** 2 for w, e in zip(clean[place][0], exact))
            sums["n_good"] += 2
    # The truth itself is on trial in the images without the obstacle.
    off_clean = 0
    for place, (row, _) in clean.items():
        exact = [float(component) for component in frame.clean_truth(*map(np.float64, place))]
        off_clean += any(abs(w - e) > SIGMAS * sigma for w, e, sigma in zip(row, exact, row[2:]))
    return {**sums, "squares": squares[0], "squares_clean": squares[1], "off_clean": off_clean}


def percent(part, whole):
    return f"{100 * part / whole:.1f} %" if whole else "-"


def ratio(sums):
    return f"{math.sqrt(sums['squares'] / sums['squares_clean']):.3f}" if sums["squares_clean"] else "-"


def summed(all_sums):
    return {key: sum(sums[key] for sums in all_sums) for key in all_sums[0]}


def cells(sums):
    return [
        percent(sums["measured"], sums["nodes"]),
        ratio(sums),
        percent(sums["named"], sums["bad"]),
        percent(sums["lost"], sums["good"]),
        str(sums["off_unmarked"]),
    ]


def counted(words):
    return ", ".join(f"{words.count(word)} {word.replace('_', ' ')}" for word in dict.fromkeys(words))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=pathlib.Path, default=ROOT / "out" / "obstacles")
    parser.add_argument("--quadrille", type=pathlib.Path, default=ROOT / "target" / "release" / "quadrille")
    parser.add_argument("--only", default="", help="names of scenes, separated by commas: block, hole, glare, torn, dust, reflection, shadow, strip, slip, crack, focus, grid")
    parser.add_argument("--keep", action="store_true", help="keep images and results of every scene")
    arguments = parser.parse_args()
    program, output = arguments.quadrille.resolve(), arguments.output.resolve()
    if not program.is_file():
        print(f"{program}: no such program; build it, or name one with --quadrille", file=sys.stderr)
        return 2
    only = [name for name in arguments.only.split(",") if name]
    output.mkdir(parents=True, exist_ok=True)
    header = ["scene", "frames", "measured", "error", "bad named", "good lost", "off, no mark"]
    rows, of_frames, everything = [header], [["scene", "frame", "status", *header[2:], "rms without, px"]], []
    for number, (name, make) in enumerate(scenes()):
        if only and name not in only:
            continue
        print(f"{name} ...", file=sys.stderr, flush=True)
        scene = make()
        seeds = [1000 * number + k for k in range(len(scene.frames) + 1)]
        disturbed = [scene.reference, *(frame.grey for frame in scene.frames)]
        plain = [scene.reference_clean, *(frame.clean for frame in scene.frames)]
        with_obstacle, without = (
            Ran(program, output / name / kind, [recorded(grey, seed) for grey, seed in zip(greys, seeds)])
            for kind, greys in (("obstacle", disturbed), ("clean", plain))
        )
        if with_obstacle.refused is not None:
            rows.append([scene.name, f"refused: {with_obstacle.refused[:60]}", "", "", "", "", ""])
        else:
            all_sums = []
            for k, frame in enumerate(scene.frames):
                all_sums.append(judged(frame, with_obstacle.converged(k), without.converged(k)))
                sums = all_sums[-1]
                clean = f"{math.sqrt(sums['squares_clean'] / sums['n_good']):.4f}" if sums["n_good"] else "-"
                of_frames.append([name, k + 1, with_obstacle.frames[k][0], *cells(sums), clean])
            total = summed(all_sums)
            everything.append(total)
            rows.append([scene.name, counted([status for status, _ in with_obstacle.frames]), *cells(total)])
        if not arguments.keep:
            shutil.rmtree(output / name)
    widths = [max(len(row[k]) for row in rows) for k in range(len(header))]
    for k, row in enumerate(rows):
        print("| " + " | ".join(cell.ljust(width) for cell, width in zip(row, widths)) + " |")
        if k == 0:
            print("|" + "|".join("-" * (width + 2) for width in widths) + "|")
    unmarked, off_clean = (sum(total[key] for total in everything) for key in ("off_unmarked", "off_clean"))
    print(f"\nnodes of converged frames off by more than five sigma without a mark: {unmarked} (wanted: 0)")
    print(f"nodes off by more than five sigma where there is no obstacle: {off_clean} (wanted: 0)")
    with open(output / "frames.csv", "w", newline="") as table:
        csv.writer(table).writerows(of_frames)
    print(f"frame by frame: {output / 'frames.csv'}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
