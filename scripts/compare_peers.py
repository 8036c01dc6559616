#!/usr/bin/env python3
"""Runs quadrille, pyxel-dic, pyvale and OpenCorr on the same images, alternately in one run.

    scripts/compare_peers.py [--sizes 512,1024,2048] [--threads 2] [--repeat 5] [--series N] [--program FILE] [--python WHEEL]
                             [--opencorr PROGRAM] [--json FILE]

Installs pyxel-dic and pyvale from PyPI into .venv-peers (once), builds quadrille unless its program is given, makes the images
with `quadrille make images` (8 bit, exact field known), and prints a table. In every repetition all codes have their turn, so that
another load of the machine hits them alike; ratios are taken turn by turn. Figures are median (least to largest). Two
times for each code:

Fresh process (cold): from its start to its end, from two TIFF files in the page cache to the field in files. quadrille:
`quadrille correlate --export csv`, with its store and its report; a second line is without the report, which draws maps and which
no other code writes. The others with the start of Python and their imports.

Repeated (warm): from two arrays in memory to the field, nothing known of the motion, in a process that has done the same once
before. The Python codes keep one process and have a repetition in every turn. quadrille from its module of Python, given
--python WHEEL (from `make wheel`), likewise; else `testbed devices`, which makes images of the same texture and field itself and
in every turn prepares the reference twice and correlates the frame twice in one process: the second times count. The fresh process
is then the command that the wheel installs, unless --program is given.

pyxel-dic: mesh, integration points, matrix, MultiscaleInit and Correlate (global Q4, as quadrille); above 1024 px it has one turn
only, since its time grows with the third power of the side. pyvale: calculate_2d with subsets of 17 px every 16 px, its Gaussian
prefilter off, its result file included (it has no other output). Both zones leave out 16 px at each side.

With --series N in place of the pair N frames whose motion grows evenly to that of the pair, with noise of one grey level, in
fresh processes: pyxel-dic keeps its matrix and factor and starts each frame from the one before. The error is that of the last
frame. OpenCorr does not take part.

OpenCorr comes as a library in C++. A program around it that takes part is called as

    PROGRAM reference.tif deformed.tif points.csv result.csv RADIUS THREADS REPETITIONS

and prints the seconds of each repetition, one a line. It reads both images (Image2D) and the points, `x,y` a line without a
header (IO2D::loadPOI2D); sets omp_set_num_threads(THREADS); and in each repetition, which is what it times, makes a new queue of
POI2D and new objects: FFTCC2D(RADIUS, RADIUS, THREADS) with setImages and compute, or, where the motion is larger than RADIUS
(here up to 0.44 % of the side: 9 px at 2048 px), SIFT2D and FeatureAffine2D; then ICGN2D1(RADIUS, RADIUS, 0.001, 10, THREADS) with
setImages, prepare and compute. In the end it sets u and v of points with a negative result.zncc to NaN and writes a table with a
header that has x, y, u and v (IO2D::saveTable2D, delimiter a comma). REPETITIONS is 1 for the fresh process and 2 for the
repeated pair, of which the second counts.

Error: root mean square over both components of measured less exact displacement, at the points of the element corners or subset
centres 32 px and more from the border, and of the field between them (bilinear). Memory: the peak of the fresh process.
"""

import argparse
import contextlib
import csv
import json
import os
import pathlib
import platform
import shutil
import statistics
import subprocess
import sys
import tempfile
import time

SCRIPT = pathlib.Path(__file__).resolve()
ROOT = SCRIPT.parent.parent
VENV = ROOT / ".venv-peers"
ELEMENT = 16
RADIUS = 8
BORDER = 32
LOAD = 0.3
BARE = "quadrille, no report"
TABLES = {
    **dict.fromkeys(("quadrille", BARE), ("csv/*.csv", "x_px", "y_px", "ux_px", "uy_px")),
    "pyvale": ("*.csv", "subset_x", "subset_y", "disp_u", "disp_v"),
}


def install():
    python = VENV / "bin" / "python"
    probe = [python, "-c", "import pyxel, pyvale.dic"]
    if python.exists() and subprocess.run(probe, cwd=VENV, capture_output=True).returncode == 0:  # a log of theirs comes to lie there
        return python
    print("installing pyxel-dic and pyvale into", VENV.name, file=sys.stderr)
    subprocess.run([sys.executable, "-m", "venv", "--clear", VENV], check=True)
    subprocess.run([python, "-m", "pip", "install", "--quiet", "pyxel-dic", "pyvale"], check=True)
    return python


def build():
    subprocess.run(["cargo", "build", "--release", "--locked", "--quiet", "-p", "quadrille", "-p", "quadrille-testbed"], cwd=ROOT, check=True)
    return ROOT / "target" / "release" / "quadrille"


def machine():
    """Processor, cores and memory."""
    with contextlib.suppress(OSError, StopIteration):
        model = next(line.split(":")[1].strip() for line in open("/proc/cpuinfo", encoding="utf8") if line.startswith("model name"))
        memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
        return f"{model}, {os.cpu_count()} cores, {memory:.0f} GiB"
    return f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores"


def versions(python, program, module):
    names = ["pyxel-dic", "pyvale", "numpy"] + ["quadrille"] * bool(module)
    code = "import importlib.metadata, json, sys; print(json.dumps({n: importlib.metadata.version(n) for n in sys.argv[1:]}))"
    found = json.loads(subprocess.run([python, "-c", code, *names], check=True, capture_output=True, text=True).stdout)
    own = subprocess.run([program, "--version"], check=True, capture_output=True, text=True).stdout.split()[-1]
    return {"quadrille": own, **found, "Python": platform.python_version()}


def images_of(program, folder, size, frames):
    """Reference and deformed images of the accuracy field: sinusoids, 0.5 % stretch, 0.2 degrees; noise in a series."""
    where = folder / f"images{size}"
    noise = ["--noise", "1"] if frames > 1 else []
    subprocess.run([program, "make", "images", "accuracy", "--size", f"{size}x{size}", "--frames", str(frames), *noise,
                    "--grid", "4", "--output", where], check=True, capture_output=True)
    with open(where / "points.csv", "w", encoding="utf8") as points:
        places = range(ELEMENT, size - ELEMENT + 1, ELEMENT)
        points.writelines(f"{x},{y}\n" for y in places for x in places)
    return where


def files_of(where):
    """The files of a series, the reference first; they are then in the page cache."""
    files = sorted(where.glob("??????.tif"))
    for file in files:
        file.read_bytes()
    return files


def columns(file, *names):
    """Columns of a table; in those of quadrille comments begin with #."""
    import numpy as np

    rows = csv.DictReader(line for line in open(file, encoding="utf8") if not line.startswith("#"))
    return np.array([[float(row[name]) for name in names] for row in rows]).T


# --- the codes of Python: images, the reference first, to points and field of each deformed one --------------


def module(images, size, threads, out):
    import quadrille

    reference, *deformed = images
    low, high = ELEMENT, size - ELEMENT
    correlator = quadrille.Correlator(reference, [low, low, high, high], element_size_px=ELEMENT, threads=threads, device="cpu")
    for image in deformed:
        field = correlator.correlate(image)
        yield field.positions, field.displacement


def pyxel_dic(images, size, threads, out):
    import numpy as np
    import pyxel

    def of_floats(pixels):
        image = pyxel.Image("")
        image.pix = pixels.astype(np.float64)
        return image

    images = map(of_floats, images)
    f = next(images)
    low, high = ELEMENT, size - ELEMENT
    mesh, camera = pyxel.MeshFromROI(np.array([[low, low], [high, high]]), ELEMENT, typel=3)
    mesh.Connectivity()
    mesh.DICIntegration(camera)
    nodes = np.transpose(camera.P(mesh.n[:, 0], mesh.n[:, 1]))
    engine = pyxel.DICEngine()
    hessian = engine.ComputeLHS(f, mesh, camera)
    found = None
    for g in images:
        if found is None:
            found = pyxel.MultiscaleInit(f, g, mesh, camera, scales=[3, 2, 1], disp=False)
        found, _ = pyxel.Correlate(f, g, mesh, camera, dic=engine, H=hessian, U0=found, disp=False)
        moved = mesh.n + found[mesh.conn]
        yield nodes, np.transpose(camera.P(moved[:, 0], moved[:, 1])) - nodes


def pyvale(images, size, threads, out):
    """Writes its tables itself."""
    import numpy as np
    import pyvale.dic

    reference, *deformed = images
    mask = np.zeros((size, size), dtype=bool)
    mask[ELEMENT : size - ELEMENT, ELEMENT : size - ELEMENT] = True
    pyvale.dic.calculate_2d(reference, deformed[0] if isinstance(reference, np.ndarray) else deformed, mask, [size // 2, size // 2],
                            subset_size=2 * RADIUS + 1, subset_step=ELEMENT, num_threads=threads, image_filter_kernel=1,
                            output_basepath=out, print_level=0)
    return []


CODES = {"quadrille": module, "pyxel-dic": pyxel_dic, "pyvale": pyvale}


def load(file):
    import numpy as np
    from PIL import Image

    return np.array(Image.open(file))


def fresh(code, where, size, threads, out):
    """From files to files, once: all of a fresh process."""
    import numpy as np

    files = files_of(where)
    fields = CODES[code](files if code == "pyvale" else map(load, files), size, threads, out)
    for k, (points, field) in enumerate(fields, 1):
        np.savetxt(out / f"{k:06}.csv", np.c_[points, field], delimiter=",", header="x,y,u,v", comments="")


def repeated(code, where, size, threads, out):
    """The pair in memory once, and once more for each line of the input; prints the seconds of each."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what a code prints does not come between
    images = [load(file) for file in files_of(where)]
    while True:
        begin = time.perf_counter()
        for _ in CODES[code](images, size, threads, out):
            pass
        print(time.perf_counter() - begin, file=answers, flush=True)
        if not sys.stdin.readline():
            return


def score(code, where, size, threads, out):
    """Prints the errors of the last frame."""
    import numpy as np
    from scipy.interpolate import LinearNDInterpolator, RegularGridInterpolator

    pattern, *names = TABLES.get(code, ("*.csv", "x", "y", "u", "v"))
    x, y, u, v = columns(sorted(out.glob(pattern))[-1], *names)
    points, field = np.c_[x, y], np.c_[u, v]
    x, y, u, v = columns(sorted((where / "exact").glob("*.csv"))[-1], "x_px", "y_px", "ux_px", "uy_px")
    at, truth = np.c_[x, y], np.c_[u, v]
    xs, ys = np.unique(at[:, 0]), np.unique(at[:, 1])
    order = np.lexsort((at[:, 0], at[:, 1]))
    grids = [RegularGridInterpolator((ys, xs), truth[order, c].reshape(len(ys), len(xs)), method="cubic")
             for c in range(2)]
    exact_at = lambda p: np.c_[[grid(p[:, ::-1]) for grid in grids]].T
    good = np.isfinite(field).all(axis=1)
    points, field = points[good], field[good]
    inside = lambda p: ((p >= BORDER) & (p <= size - 1 - BORDER)).all(axis=1)
    rms = lambda e: float(np.sqrt((e**2).mean()))
    node = rms(field[inside(points)] - exact_at(points[inside(points)]))
    # Bilinear between the points, which form a regular grid; triangles would favour nobody else.
    px, py = np.unique(points[:, 0].round(6)), np.unique(points[:, 1].round(6))
    if len(px) * len(py) == len(points):
        order = np.lexsort((points[:, 0], points[:, 1]))
        between = [RegularGridInterpolator((py, px), field[order, c].reshape(len(py), len(px))) for c in range(2)]
        found_at = lambda p: np.c_[[grid(p[:, ::-1]) for grid in between]].T
    else:
        linear = LinearNDInterpolator(points, field)
        found_at = linear
    some = at[inside(at)]
    some = some[(some[:, 0] >= px[0]) & (some[:, 0] <= px[-1]) & (some[:, 1] >= py[0]) & (some[:, 1] <= py[-1])]
    errors = found_at(some) - exact_at(some)
    errors = errors[np.isfinite(errors).all(axis=1)]
    print(json.dumps({"node_rms_px": node, "field_rms_px": rms(errors), "points": len(points)}))


INNER = {function.__name__: function for function in (fresh, repeated, score)}

# --- all codes alternately ---------------------------------------------------------------------------------


class Failed(Exception):
    """A code did not do its part."""


class Contest:
    """The codes on one set of images."""

    def __init__(self, programs, where, size, arguments, scratch, log):
        self.programs, self.where, self.files, self.size = programs, where, files_of(where), size
        self.threads, self.module, self.scratch, self.log = arguments.threads, arguments.python, scratch, log
        names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
        self.environment = {**os.environ, **dict.fromkeys(names, str(arguments.threads))}

    def inner(self, what, code, out):
        return [self.programs["python"], SCRIPT, "--inner", what, code, self.where, self.size, self.threads, out]

    def folder(self, code):
        return pathlib.Path(tempfile.mkdtemp(prefix=code, dir=self.scratch))

    def start(self, command, **options):
        return subprocess.Popen(list(map(str, command)), cwd=self.scratch, env=self.environment, stderr=self.log, text=True, **options)

    def answer(self, command):
        process = self.start(command, stdout=subprocess.PIPE)
        answer, _ = process.communicate()
        if process.returncode != 0:
            raise Failed
        return answer

    def opencorr(self, out, repetitions):
        points, result = self.where / "points.csv", out / "result.csv"
        return [self.programs["OpenCorr"], *self.files, points, result, RADIUS, self.threads, repetitions]

    def cold(self, code):
        """Seconds and peak memory (MiB) of a fresh process, and the folder of its results."""
        low, high, out = ELEMENT, self.size - ELEMENT, self.folder(code)
        if code in ("quadrille", BARE):
            command = [self.programs["quadrille"], "correlate", *self.files, "--roi", f"{low},{low},{high},{high}", "--element-size",
                       ELEMENT, "--threads", self.threads, "--output", out, "--export", "csv", "--quiet",
                       *["--no-report"] * (code == BARE)]
        else:
            command = self.opencorr(out, 1) if code == "OpenCorr" else self.inner("fresh", code, out)
        begin = time.perf_counter()
        process = self.start(command, stdout=self.log)
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - begin
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode != 0:
            raise Failed
        return seconds, usage.ru_maxrss / 1024, out

    def warm(self, code, stack):
        """A function that has the seconds of one more repetition."""
        out = self.folder(code)
        if code == "OpenCorr":
            return lambda: float(self.answer(self.opencorr(out, 2)).split()[1])
        if code == "quadrille" and not self.module:
            command = [self.programs["quadrille"].with_name("testbed"), "devices", "--size", self.size,
                       "--element-size", ELEMENT, "--runs", 1, "--frames", 1, "--device", "cpu", "--threads", self.threads, "--json"]

            def bench():
                pair = json.loads(self.answer(command))["devices"][0]["sizes"][0]["pair"]
                return sum(pair[part]["wall"]["median"] for part in ("reference_s", "frame_s"))

            return bench
        worker = self.start(self.inner("repeated", code, out), stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        stack.callback(worker.communicate)

        def seconds():
            line = worker.stdout.readline()
            if not line:
                raise Failed
            return float(line)

        def again():
            print(file=worker.stdin, flush=True)
            return seconds()

        seconds()  # the first one compiles and warms up
        return again


def contest(programs, where, size, arguments, folder):
    """What each code did with one set of images."""
    log = open(folder / "log", "w+", encoding="utf8")
    one = Contest(programs, where, size, arguments, folder, log)
    results, repetitions = {}, {}

    @contextlib.contextmanager
    def part(code):
        try:
            yield
        except (Failed, OSError, ValueError, IndexError):
            results.pop(code, None)
            log.seek(0)
            print(f"{code} at {size}: failed\n{log.read()[-1500:]}", file=sys.stderr)

    with contextlib.ExitStack() as stack:
        for code in ["quadrille", BARE, "pyxel-dic", "pyvale"] + ["OpenCorr"] * ("OpenCorr" in programs):
            with part(code):
                if code != BARE and not arguments.series:
                    repetitions[code] = one.warm(code, stack)
                results[code] = {"code": code, "size": size, "cold": [], "warm": [], "memory_mib": 0}
        for turn in range(arguments.repeat):
            for code, result in list(results.items()):
                if code == "pyxel-dic" and size > 1024 and turn > 0:
                    continue
                with part(code):
                    seconds, memory, out = one.cold(code)
                    result["cold"].append(seconds)
                    result["memory_mib"] = max(result["memory_mib"], memory)
                    if turn == 0:
                        result.update(json.loads(one.answer(one.inner("score", code, out))))
                    shutil.rmtree(out)
                    if code in repetitions:
                        result["warm"].append(repetitions[code]())
                    print(f"{code} at {size}: {seconds:.4g} s" + "".join(f", {s:.4g} s" for s in result["warm"][-1:]), file=sys.stderr)
    return list(results.values())


def ratios(some, others):
    """Turn by turn."""
    return [a / b for a, b in zip(some, others)]


def shown(values, digits=4):
    """Median, least and largest."""
    middle, least, most = (f"{f(values):.{digits}g}" for f in (statistics.median, min, max)) if values else "---"
    return f"{middle} ({least} to {most})" if least != most else middle


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", default="512,1024,2048")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--series", type=int, default=0, metavar="N")
    parser.add_argument("--program", type=pathlib.Path, help="quadrille; built with the profile release if not given")
    parser.add_argument("--python", metavar="WHEEL")
    parser.add_argument("--opencorr", type=pathlib.Path, metavar="PROGRAM")
    parser.add_argument("--json", type=pathlib.Path)
    parser.add_argument("--inner", nargs=6, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.inner:
        what, code, where, size, threads, out = arguments.inner
        return INNER[what](code, pathlib.Path(where), int(size), int(threads), pathlib.Path(out))
    if arguments.series and (arguments.python or arguments.opencorr):
        parser.error("--python and --opencorr are for pairs")

    programs = {"python": install()}
    if arguments.python:
        subprocess.run([programs["python"], "-m", "pip", "install", "--quiet", "--force-reinstall", "--no-deps", arguments.python],
                       check=True)
    own = arguments.program or (VENV / "bin" / "quadrille" if arguments.python else build())
    programs["quadrille"] = own.resolve()
    if arguments.opencorr:
        programs["OpenCorr"] = arguments.opencorr.resolve()
    run = {
        "what": f"series of {arguments.series} frames" if arguments.series else "pair",
        "date": time.strftime("%Y-%m-%d %H:%M"), "machine": machine(), "threads": arguments.threads, "element_px": ELEMENT,
        "versions": versions(programs["python"], programs["quadrille"], arguments.python), "load_before": os.getloadavg(),
    }
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        sizes = [int(size) for size in arguments.sizes.split(",")]
        results = [result for size in sizes for result in
                   contest(programs, images_of(programs["quadrille"], folder, size, arguments.series or 1), size, arguments, folder)]
    run["load_after"] = os.getloadavg()
    run["results"] = results
    before, after = run["load_before"][0], run["load_after"][0]
    print(f"{run['what']}, 8 bit, {ELEMENT} px elements or steps, {arguments.threads} threads, {run['date']}, {run['machine']}, "
          f"load {before:.1f} before and {after:.1f} after; " + ", ".join(map(" ".join, run["versions"].items())))
    if before > LOAD * os.cpu_count():
        print(f"WARNING: the machine had other work to do (load {before:.1f}): seconds are too long, and ratios as good as their ranges")
    print("| image | code | turns | fresh process (cold), s | times quadrille | repeated (warm), s | "
          "times quadrille | cold / warm | rms at points / between, px | MiB |")
    print("|" + " --- |" * 10)
    reference = {r["size"]: r for r in results if r["code"] == "quadrille"}
    for r in results:
        for kind in ("cold", "warm"):
            r[f"{kind}_ratios"] = ratios(r[kind], reference.get(r["size"], {kind: []})[kind])
        r["cold_to_warm"] = ratios(r["cold"], r["warm"])
        cells = [f"{r['size']}²", r["code"], str(len(r["cold"])), shown(r["cold"]), shown(r["cold_ratios"], 3), shown(r["warm"]),
                 shown(r["warm_ratios"], 3), shown(r["cold_to_warm"], 3), f"{r['node_rms_px']:.4f} / {r['field_rms_px']:.4f}",
                 f"{r['memory_mib']:.0f}"]
        print("|", " | ".join(cells), "|")
    if arguments.json:
        arguments.json.write_text(json.dumps(run, indent=1) + "\n")


if __name__ == "__main__":
    sys.exit(main())
