#!/usr/bin/env python3
"""Runs quadrille, pyxel-dic and pyvale on the same image pairs, one after the other in one run.

    scripts/compare_peers.py [--sizes 512,1024,2048] [--threads 2] [--repeat 5] [--series 20] [--python WHEEL] [--json FILE]

Installs pyxel-dic and pyvale from PyPI into .venv-peers (once), builds quadrille when it is not there, makes
the pairs with `quadrille synth` (8 bit, exact field known), and prints a table: wall time of a cold pair, its
ratio, error of the field, peak memory, versions.

What is timed, for each code alone in a process of its own, images in memory: everything from two arrays (or decoded images)
to the displacement field, nothing known of the motion. quadrille: preparation of the reference and the
frame with its uncertainty, repeated in one process as for the others (`cargo bench --bench report -- pairs`, for the
sizes that it has); the first pair of a fresh process stands beside it (`seconds_reference` + `seconds` of summary.json).
pyxel-dic: mesh, integration points,
MultiscaleInit and Correlate (global Q4, as quadrille). pyvale: calculate_2d with subsets of 17 px every 16 px,
its Gaussian prefilter off, its result file included (it has no other output). The median over the repetitions
counts; the first one, which compiles or warms up, does not.

With --series N in place of the pairs a series of N frames whose motion grows evenly to that of the pair, with noise of
one grey level, from the files to the results, once: quadrille the whole command with the start of the process;
pyxel-dic with its matrix and factor kept and each frame started from the one before, images read by Pillow; pyvale
with the list of files, its result files included. Both others without the start of Python and its imports. The error
is that of the last frame.

With --python WHEEL quadrille is its module of Python, from the wheel that `make wheel` has put into out/wheel: three scripts in one
language, in one environment, each from two arrays in memory to the field.

Error: root mean square over both components of measured less exact displacement, at the points of the
element corners (quadrille, pyxel-dic) or subset centres (pyvale) 32 px and more from the border, and of the field between them (bilinear).
"""

import argparse
import csv
import importlib.metadata
import json
import os
import pathlib
import resource
import statistics
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv-peers"
ELEMENT = 16
BORDER = 32


def install():
    python = VENV / "bin" / "python"
    probe = "import pyxel, pyvale.dic"
    if python.exists() and subprocess.run([python, "-c", probe], capture_output=True).returncode == 0:
        return python
    print("installing pyxel-dic and pyvale into", VENV.name, file=sys.stderr)
    subprocess.run([sys.executable, "-m", "venv", "--clear", VENV], check=True)
    subprocess.run([python, "-m", "pip", "install", "--quiet", "pyxel-dic", "pyvale"], check=True)
    return python


def program():
    path = ROOT / "target" / "release" / "quadrille"
    subprocess.run(["cargo", "build", "--release", "--locked", "--quiet"], cwd=ROOT, check=True)
    return path


def benched():
    """Median, fastest and slowest cold pair of quadrille in one process, by image size."""
    command = ["cargo", "bench", "--locked", "--bench", "report", "--", "pairs"]
    ran = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    found = {}
    for line in ran.stdout.splitlines():
        cells = [cell.strip() for cell in line.strip("| ").split("|")]
        if len(cells) == 7 and cells[0].endswith("²"):
            median, rest = cells[3].split(" (")
            fastest, slowest = rest.rstrip(")").split("-")
            found[int(cells[0].rstrip("²"))] = [float(fastest), float(median), float(slowest)]
    return found


def images_of(quadrille, folder, size, frames):
    """Reference and deformed images of the accuracy field: sinusoids, 0.5 % stretch, 0.2 degrees; noise in a series."""
    where = folder / f"images{size}"
    noise = ["--noise", "1"] if frames > 1 else []
    subprocess.run([quadrille, "synth", "accuracy", "--size", f"{size}x{size}", "--frames", str(frames), *noise,
                    "--grid", "4", "--output", where], check=True, capture_output=True)
    return where


def files_of(where):
    """The files of a series, the reference first."""
    return sorted(where.glob("??????.tif"))


def columns(file, *names):
    """Columns of one of quadrille's tables, whose comments begin with #."""
    import numpy as np

    rows = csv.DictReader(line for line in open(file, encoding="utf8") if not line.startswith("#"))
    return np.array([[float(row[name]) for name in names] for row in rows]).T


# --- one code in one process: prints a JSON object -----------------------------------------------------


def run_quadrille(where, size, threads, repeat):
    quadrille = ROOT / "target" / "release" / "quadrille"
    low, high = ELEMENT, size - ELEMENT
    times = []
    with tempfile.TemporaryDirectory() as out:
        command = [quadrille, "correlate", where / "000000.tif", where / "000001.tif", "--roi",
                   f"{low},{low},{high},{high}", "--element-size", str(ELEMENT), "--threads", str(threads),
                   "--output", out, "--overwrite", "--export", "csv", "--start", "independent", "--quiet"]
        for _ in range(repeat):
            subprocess.run(command, check=True)
            summary = json.load(open(pathlib.Path(out) / "summary.json"))
            times.append(summary["seconds_reference"] + summary["frames"][0]["seconds"])
        x, y, u, v = columns(pathlib.Path(out) / "csv" / "000001.csv", "x_px", "y_px", "ux_px", "uy_px")
    import numpy as np

    points, field = np.c_[x, y], np.c_[u, v]
    memory = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    return times, points, field, memory, summary["quadrille"]


def run_module(where, size, threads, repeat):
    import quadrille

    reference, deformed = load(where)
    low, high = ELEMENT, size - ELEMENT
    times = []
    for _ in range(repeat):
        begin = time.perf_counter()
        correlator = quadrille.Correlator(reference, [low, low, high, high], element_size_px=ELEMENT, threads=threads, device="cpu")
        field = correlator.correlate(deformed)
        times.append(time.perf_counter() - begin)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return times, field.positions, field.displacement, memory, quadrille.__version__


def load(where):
    import numpy as np
    from PIL import Image

    return [np.array(Image.open(where / name)) for name in ("000000.tif", "000001.tif")]


def run_pyxel(where, size, threads, repeat):
    import contextlib
    import io

    import numpy as np
    import pyxel

    reference, deformed = load(where)
    times = []
    for _ in range(repeat):
        begin = time.perf_counter()
        with contextlib.redirect_stdout(io.StringIO()):
            images = []
            for pixels in (reference, deformed):
                image = pyxel.Image("")
                image.pix = pixels.astype(np.float64)
                images.append(image)
            f, g = images
            low, high = ELEMENT, size - ELEMENT
            mesh, camera = pyxel.MeshFromROI(np.array([[low, low], [high, high]]), ELEMENT, typel=3)
            mesh.Connectivity()
            mesh.DICIntegration(camera)
            start = pyxel.MultiscaleInit(f, g, mesh, camera, scales=[3, 2, 1], disp=False)
            found, _ = pyxel.Correlate(f, g, mesh, camera, U0=start, disp=False)
            u, v = camera.P(mesh.n[:, 0], mesh.n[:, 1])
            nodes = np.c_[u, v]
            moved = mesh.n + found[mesh.conn]
            u, v = camera.P(moved[:, 0], moved[:, 1])
            field = np.c_[u, v] - nodes
        times.append(time.perf_counter() - begin)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return times, nodes, field, memory, importlib.metadata.version("pyxel-dic")


def run_pyvale(where, size, threads, repeat):
    import numpy as np
    import pyvale.dic

    reference, deformed = load(where)
    mask = np.zeros(reference.shape, dtype=bool)
    mask[ELEMENT : size - ELEMENT, ELEMENT : size - ELEMENT] = True
    times = []
    with tempfile.TemporaryDirectory() as out:
        for _ in range(repeat):
            begin = time.perf_counter()
            pyvale.dic.calculate_2d(reference, deformed, mask, [size // 2, size // 2], subset_size=17,
                                    subset_step=ELEMENT, num_threads=threads, image_filter_kernel=1,
                                    output_basepath=out, print_level=0)
            times.append(time.perf_counter() - begin)
        files = sorted(pathlib.Path(out).glob("*.csv"))
        x, y, u, v = columns(files[-1], "subset_x", "subset_y", "disp_u", "disp_v")
    points, field = np.c_[x, y], np.c_[u, v]
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return times, points, field, memory, importlib.metadata.version("pyvale")


# --- the same for a series: seconds, and points and field of the last frame ---------------------------------


def series_quadrille(where, size, threads):
    import numpy as np

    quadrille = ROOT / "target" / "release" / "quadrille"
    low, high = ELEMENT, size - ELEMENT
    files = files_of(where)
    with tempfile.TemporaryDirectory() as out:
        begin = time.perf_counter()
        subprocess.run([quadrille, "correlate", *files, "--roi", f"{low},{low},{high},{high}", "--element-size",
                        str(ELEMENT), "--threads", str(threads), "--output", out, "--export", "none", "--quiet"], check=True)
        seconds = time.perf_counter() - begin
        subprocess.run([quadrille, "export", out, "--to", "csv", "--frames", str(len(files) - 1)],
                       check=True, capture_output=True)
        x, y, u, v = columns(pathlib.Path(out) / "csv" / f"{len(files) - 1:06}.csv", "x_px", "y_px", "ux_px", "uy_px")
        version = json.load(open(pathlib.Path(out) / "summary.json"))["quadrille"]
    return seconds, np.c_[x, y], np.c_[u, v], resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss, version


def series_pyxel(where, size, threads):
    import contextlib
    import io

    import numpy as np
    import pyxel
    from PIL import Image

    def load_as_float(file):
        image = pyxel.Image("")
        image.pix = np.array(Image.open(file)).astype(np.float64)
        return image

    files = files_of(where)
    begin = time.perf_counter()
    with contextlib.redirect_stdout(io.StringIO()):
        f = load_as_float(files[0])
        low, high = ELEMENT, size - ELEMENT
        mesh, camera = pyxel.MeshFromROI(np.array([[low, low], [high, high]]), ELEMENT, typel=3)
        mesh.Connectivity()
        mesh.DICIntegration(camera)
        engine = pyxel.DICEngine()
        hessian = engine.ComputeLHS(f, mesh, camera)
        found = None
        for file in files[1:]:
            g = load_as_float(file)
            if found is None:
                found = pyxel.MultiscaleInit(f, g, mesh, camera, scales=[3, 2, 1], disp=False)
            found, _ = pyxel.Correlate(f, g, mesh, camera, dic=engine, H=hessian, U0=found, disp=False)
    seconds = time.perf_counter() - begin
    u, v = camera.P(mesh.n[:, 0], mesh.n[:, 1])
    nodes = np.c_[u, v]
    moved = mesh.n + found[mesh.conn]
    u, v = camera.P(moved[:, 0], moved[:, 1])
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return seconds, nodes, np.c_[u, v] - nodes, memory, importlib.metadata.version("pyxel-dic")


def series_pyvale(where, size, threads):
    import numpy as np
    import pyvale.dic

    mask = np.zeros((size, size), dtype=bool)
    mask[ELEMENT : size - ELEMENT, ELEMENT : size - ELEMENT] = True
    files = files_of(where)
    with tempfile.TemporaryDirectory() as out:
        begin = time.perf_counter()
        pyvale.dic.calculate_2d(files[0], files[1:], mask, [size // 2, size // 2], subset_size=17, subset_step=ELEMENT,
                                num_threads=threads, image_filter_kernel=1, output_basepath=out, print_level=0)
        seconds = time.perf_counter() - begin
        x, y, u, v = columns(sorted(pathlib.Path(out).glob("*.csv"))[-1], "subset_x", "subset_y", "disp_u", "disp_v")
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return seconds, np.c_[x, y], np.c_[u, v], memory, importlib.metadata.version("pyvale")


CODES = {"quadrille": run_quadrille, "pyxel-dic": run_pyxel, "pyvale": run_pyvale}
SERIES = {"quadrille": series_quadrille, "pyxel-dic": series_pyxel, "pyvale": series_pyvale}


def one(code, where, size, threads, repeat, series, module):
    """Runs one code and scores it; this is the inner process."""
    import numpy as np
    from scipy.interpolate import LinearNDInterpolator, RegularGridInterpolator

    where = pathlib.Path(where)
    if series:
        seconds, points, field, memory, version = SERIES[code](where, size, threads)
        times = [None, seconds]
    else:
        run = run_module if module and code == "quadrille" else CODES[code]
        times, points, field, memory, version = run(where, size, threads, repeat + 1)
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
    print("RESULT" + json.dumps({
        "version": version, "seconds": times[1:], "node_rms_px": node, "field_rms_px": rms(errors),
        "points": len(points), "memory_mib": memory / 1024,
    }))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", default="512,1024,2048")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--json", type=pathlib.Path)
    parser.add_argument("--series", type=int, default=0, metavar="N")
    parser.add_argument("--python", metavar="WHEEL", default="")
    parser.add_argument("--one", nargs=5, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        code, where, size, threads, repeat = arguments.one
        return one(code, where, int(size), int(threads), int(repeat), arguments.series, arguments.python)

    if arguments.python and arguments.series:
        parser.error("--python is for pairs")
    python = install()
    if arguments.python:
        subprocess.run([python, "-m", "pip", "install", "--quiet", "--force-reinstall", "--no-deps", arguments.python], check=True)
    quadrille = VENV / "bin" / "quadrille" if arguments.python else program()
    threads = str(arguments.threads)
    environment = dict(os.environ)
    environment.update({name: threads for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")})
    results = []
    own_times = {} if arguments.series or arguments.python else benched()
    with tempfile.TemporaryDirectory() as folder:
        for size in (int(size) for size in arguments.sizes.split(",")):
            where = images_of(quadrille, pathlib.Path(folder), size, arguments.series or 1)
            for code in CODES:
                # pyxel's time grows with the third power of the side: fewer repetitions there.
                repeat = arguments.repeat if code != "pyxel-dic" else max(1, min(arguments.repeat, 3 * 512 // size))
                inner = [python, __file__, "--series", str(arguments.series), "--python", arguments.python, "--one", code, where, str(size), threads,
                         str(repeat)]
                ran = subprocess.run(inner, env=environment, capture_output=True, text=True)
                line = next((l for l in ran.stdout.splitlines() if l.startswith("RESULT")), None)
                if line is None:
                    print(f"{code} at {size}: failed\n{ran.stderr[-1500:]}", file=sys.stderr)
                    continue
                result = {"code": code, "size": size, **json.loads(line.removeprefix("RESULT"))}
                if code == "quadrille" and size in own_times:
                    result["fresh_process_seconds"] = statistics.median(result["seconds"])
                    result["seconds"] = own_times[size]
                result["median_seconds"] = statistics.median(result["seconds"])
                results.append(result)
                print(f"{code} at {size}: {result['median_seconds']:.4g} s", file=sys.stderr)
    what = f"series of {arguments.series} frames from files" if arguments.series else "cold pair"
    print(f"{what}, 8 bit, {ELEMENT} px elements or steps, {threads} threads, {time.strftime('%Y-%m-%d')}, "
          f"{os.cpu_count()} cores")
    print("| image | code | version | s, median (min to max) | times quadrille | node rms px | field rms px | MiB |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    own = {r["size"]: r["median_seconds"] for r in results if r["code"] == "quadrille"}
    for r in results:
        ratio = r["median_seconds"] / own.get(r["size"], float("nan"))
        r["ratio"] = ratio
        if "fresh_process_seconds" in r:
            r["code"] += f" (first pair of a process: {r['fresh_process_seconds']:.3f} s)"
        print(f"| {r['size']}² | {r['code']} | {r['version']} | {r['median_seconds']:.4g} ({min(r['seconds']):.4g} to "
              f"{max(r['seconds']):.4g}) | {ratio:.3g} | {r['node_rms_px']:.4f} | {r['field_rms_px']:.4f} | {r['memory_mib']:.0f} |")
    if arguments.json:
        arguments.json.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    sys.exit(main())
