#!/usr/bin/env python3
"""Measures, and writes benches/RESULTS.md: `make results`.

    scripts/results.py [--only SECTION,SECTION] [--list] [--program FILE] [--data FOLDER] [--profile release]

Runs the benches of the repository with fixed arguments, reads what they print, and writes one section for each: what
was measured, date, machine and versions, the command, its table. Sections that are not run stay on the page as they
are, with their own date and machine. `--only ""` runs nothing and rewrites the introductions.

Two sections run only when they are named: `card` needs a graphics card, `real` the images that --data names. Run all
on a quiet machine: it takes half an hour to an hour. A section whose command fails keeps its old figures.
"""

import argparse
import inspect
import json
import os
import platform
import re
import shlex
import shutil
import statistics
import subprocess
import sys
import tempfile
import textwrap
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "benches" / "RESULTS.md"
HEAD = """\
# Speed and accuracy: current figures

Written by `make results` (`scripts/results.py`). Every section has its own date and machine. Times are on the wall,
median (fastest-slowest). Compare within a section only. Before 2026-11-30 the default was cubic.
"""
MEMORY = Path("/dev/shm") if Path("/dev/shm").is_dir() else Path(tempfile.gettempdir())
WIDTH = 112  # of the lines of the page
BUSY = 0.3  # load per core from which the stamp says that the machine had other work
SYNTH = "quadrille make images accuracy --noise 1 --size {0}x{0} --frames {1} --amplitude {2} -o images"
CORRELATE = "quadrille correlate -o out -q --device cpu --threads 2 --export none --no-report {0} images/*.tif"


class Failed(Exception):
    """A command did not do its part."""


# --- tables ------------------------------------------------------------------------------------------------


def table(head, rows):
    """A table of Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)


def tables(text):
    """The tables of Markdown in a text, each as its head and its rows."""
    found, inside = [], False
    for line in map(str.strip, text.splitlines()):
        if line.startswith("|"):
            if not inside:
                found.append([])
            found[-1].append([cell.strip() for cell in line.strip("|").split("|")])
        inside = line.startswith("|")
    if not found:
        raise Failed("it printed no table")
    return [(head, rows) for head, _, *rows in found]


def columns(text, *wanted):
    """Some columns of the first printed table that has them: each `name there = name here`, or the name in both."""
    there, here = zip(*(name.split(" = ") if " = " in name else (name, name) for name in wanted))
    for head, rows in tables(text):
        if set(there) <= set(head):
            places = [head.index(name) for name in there]
            return table(here, [[row[place] for place in places] for row in rows])
    raise Failed(f"no table has the columns {', '.join(there)}")


def crossed(corner, found):
    """A table of `found`, {(row, column): cell}."""
    rows, head = (list(dict.fromkeys(names)) for names in zip(*found))
    return table([corner, *head], [[row, *(found.get((row, name), "") for name in head)] for row in rows])


def spread(values, digits=3):
    """Median (least-largest)."""
    middle, least, most = (f"{f(values):.{digits}g}" for f in (statistics.median, min, max))
    return f"{middle} ({least}-{most})" if least != most else middle


def of_spread(seconds, scale=1.0, digits=3):
    """The same of what `--json` of quadrille has."""
    return spread([scale * seconds[key] for key in ("fastest", "median", "slowest")], digits)


# --- running -----------------------------------------------------------------------------------------------


class Bench:
    """Runs commands for one section, and keeps what they are for the page."""

    def __init__(self, arguments, scratch):
        self.arguments, self.scratch, self.parts = arguments, scratch, []

    def program(self):
        """quadrille, built when it is not given, the testbed with it."""
        if not self.arguments.program:
            packages = ["-p", "quadrille", "-p", "quadrille-testbed"]
            subprocess.run(["cargo", "build", "--locked", "--profile", self.arguments.profile, *packages], cwd=ROOT, check=True)
            folder = "debug" if self.arguments.profile == "dev" else self.arguments.profile
            self.arguments.program = ROOT / "target" / folder / "quadrille"
        return self.arguments.program.resolve()

    def cargo(self, what, rest):
        """The command by which cargo runs a bench or tests."""
        usual = "" if what == "bench" else " --release"
        profile = usual if self.arguments.profile == "release" else f" --profile {self.arguments.profile}"
        package = " -p quadrille-testbed" if what == "bench" else ""
        return f"cargo {what} --locked{profile}{package} {rest}"

    def series(self, device, rest):
        """The command that measures a series, but for its margin."""
        return f"testbed series --device {device} --folder {self.arguments.folder} --size {rest} --margin "

    def words(self, command):
        """The words of a command as they are run."""
        words = shlex.split(command)
        if words[0] == "quadrille":
            words[0] = str(self.program())
        elif words[0] == "testbed":
            words[0] = str(self.program().with_name("testbed"))
        elif words[0].startswith("scripts/"):
            words[0:1] = [sys.executable, str(ROOT / words[0])]
        return words

    def output(self, command, hidden=""):
        """What a command prints. `hidden` are words that the page does not show."""
        print(f"{command} {hidden}", file=sys.stderr)
        words = self.words(f"{command} {hidden}")
        ran = subprocess.run(words, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=False)
        if ran.returncode != 0:
            raise Failed(f"{command}: exit status {ran.returncode}")
        return ran.stdout

    def json(self, command):
        return json.loads(self.output(f"{command} --json"))

    def say(self, command, *blocks):
        """One part of the section: a command, what it found."""
        self.parts.append("\n\n".join([f"`{command}`".replace("`, `", "`,\n`"), *blocks]))

    def timed(self, command, repeat):
        """Wall time, processor time (s) and peak memory (MB) of `repeat` processes, which run in the scratch folder."""
        words = self.words(command)
        at = len(words) - 1 if words[-1].endswith("*.tif") else None
        if at:
            words[at : at + 1] = sorted(str(path) for path in (self.scratch / "images").glob("??????.tif"))
        runs = []
        for _ in range(repeat):
            begin = time.perf_counter()
            process = subprocess.Popen(words, cwd=self.scratch, stdout=subprocess.DEVNULL)
            _, status, usage = os.wait4(process.pid, 0)
            runs.append((time.perf_counter() - begin, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024 / 1e6))
            process.returncode = os.waitstatus_to_exitcode(status)
            if process.returncode != 0:
                raise Failed(f"{command}: exit status {process.returncode}")
            shutil.rmtree(self.scratch / "out", ignore_errors=True)
        return list(zip(*runs))

    def correlate(self, options, repeat):
        """Wall and processor time and peak memory of `quadrille correlate` on the images, as cells of a table."""
        wall, processor, memory = self.timed(CORRELATE.format(options), repeat)
        return spread(wall), f"{statistics.median(processor):.3g}", f"{statistics.median(memory):.0f}"

    def images(self, size, frames, amplitude):
        """Makes the images of a series, read once."""
        shutil.rmtree(self.scratch / "images", ignore_errors=True)
        self.timed(SYNTH.format(size, frames, amplitude), 1)
        for file in (self.scratch / "images").glob("*.tif"):
            file.read_bytes()


# --- the sections ------------------------------------------------------------------------------------------


def peers(bench):
    """Next to other codes

    8 bit, elements or steps of 16 px, 2 threads. *Fresh*: from two files to files, for quadrille with its report.
    *Repeated*: in memory, once more. Codes take turns; ratios are those within a turn.
    """
    command = "scripts/compare_peers.py --sizes 1024"
    printed = bench.output(command, f"--program {bench.program()}").replace(" to ", "-")
    (_, rows), = tables(printed)
    rows = [[code, fresh, fresh_times, warm, warm_times, rms, memory]
            for _, code, _, fresh, fresh_times, warm, warm_times, _, rms, memory in rows]
    bench.say(command, table(["1024²", "fresh, s", "times quadrille", "repeated, s", "times quadrille",
                              "rms at points / between, px", "MiB"], rows))


def pairs(bench):
    """A pair in memory

    8 bit, 16 px elements, 2 threads. *Reference*: done once. *Frame*: search, iterations, uncertainty.
    """
    command = bench.cargo("bench", "--bench report -- pairs")
    bench.say(command, columns(bench.output(command), "size = image", "reference = reference, s", "frame = frame, s",
                               "frame from the prediction = predicted frame, s",
                               "B/px beyond the images = memory, B/px"))


def cold(bench):
    """A pair from a fresh process

    `quadrille correlate` on two files: without an option ("all"), or the store alone.
    """
    command = f"scripts/cold.py --sizes 1024,2048,4096 --repeat 5 --folder {bench.arguments.folder}"
    printed = bench.output(command, f"--program {bench.program()}").replace(" to ", "-")
    (_, rows), = tables(printed)
    found = {(written, image): f"{wall}; {memory}" for image, written, _, wall, *_, memory in rows}
    bench.say(command, crossed("wall, s; peak, MB", found))


def runs(bench):
    """A series, whole process

    60 frames in memory, start and reference included.
    """
    found = {}
    for size in (1024, 2048):
        bench.images(size, 60, 4)
        far = size - 32
        zones = {"found by the program": "", "to the last pixel": f"--roi 0,0,{size},{size}",
                 "32 px inside": f"--roi 32,32,{far},{far}"}
        for zone, options in zones.items():
            wall, processor, memory = bench.correlate(options, 5)
            found[zone, f"{size}²"] = f"{wall}; {processor}; {memory}"
    bench.say(f"{SYNTH.format('SIZE', 60, 4)}`, `{CORRELATE.format('--roi ROI')}",
              crossed("zone: wall, s; processor, s; peak, MB", found))


def small(bench):
    """Small elements

    Zones 32 px inside. With 4 px there is one unknown for eight pixels.
    """
    rows = []
    for size, frames, elements, repeat in ((2048, 8, 16, 3), (2048, 8, 8, 3), (2048, 8, 4, 3), (4096, 3, 4, 1)):
        bench.images(size, frames, 1)
        options = f"--element-size {elements} --roi 32,32,{size - 32},{size - 32}"
        rows.append([f"{size}²", frames, f"{elements} px", *bench.correlate(options, repeat)])
    bench.say(f"{SYNTH.format('SIZE', 'N', 1)}`, `{CORRELATE.format('--element-size E')}",
              table(["image", "frames", "elements", "wall, s", "processor, s", "peak, MB"], rows))


def of_series(measured):
    """The table of `testbed series --json`, for one or more of them."""
    found = {}
    for one in measured:
        zone = "2 elements inside" if one["margin_elements"] else "to the border"
        for cost in one["series"]:
            rate = spread([1 / cost["frame_s"][key] for key in ("fastest", "median", "slowest")])
            cell = f"{rate}; {100 * cost['share_of_bound']:.0f} %"
            found[f"{cost['format'].upper()}, {zone}", f"{cost['size_px']}²"] = cell
    return crossed("frames/s; of 1/(1/d + 1/c)", found)


def series(bench):
    """A series, from files to store

    Without the start. *1/(1/d + 1/c)*: what decoding and correlation alone would allow.
    """
    command = bench.series("cpu", "1024,2048 --frames 60")
    bench.say(f"{command}2`, `--margin 0", of_series(bench.json(f"{command}{margin}") for margin in (2, 0)))


def host(bench):
    """What the host does next to a graphics card

    With a device that answers at once, 2048².
    """
    command = bench.series("instant", "2048 --format tiff --frames 60")
    rows = []
    for margin, zone in ((2, "2 elements inside"), (0, "to the border")):
        cost, = bench.json(f"{command}{margin}")["series"]
        busy, turn = cost["frame_processor_s"], cost["frame_in_turn_s"]
        rows.append([zone, of_spread(busy, 1e3), f"{16 / busy['median']:.0f}", of_spread(turn, 1e3),
                     f"{1 / turn['median']:.0f}"])
    head = ["zone", "processor, ms/frame", "16 cores, frames/s", "in turn, ms/frame", "that, frames/s"]
    bench.say(f"{command}2`, `--margin 0", table(head, rows))


def kernels(bench):
    """Kernels of the CPU

    One thread, 1024², cubic, 16 px elements, ns per pixel. *Residual*: the inner loop.
    """
    command = bench.cargo("bench", "--bench report -- kernels")
    (head, rows), = tables(bench.output(command))
    bench.say(command, table(head[1:], [row[1:] for row in rows if row[0] == "1024²"]))


PASSES = ("frame", "residual, 0.1 % strain", "residual", "iteration")


def devices(bench):
    """Devices side by side

    ns per pixel, fastest of 5, of one core (CPU, software driver) or of the card.
    """
    command = "testbed devices --size 1024,2048 --runs 5 --frames 6"
    found = {(f"{device['device']}: {one['name']}", f"{size['size_px']}²"): f"{one['ns_per_px']:.3g}"
             for device in bench.json(command)["devices"] for size in device["sizes"] for one in size["passes"]
             if one["name"] in PASSES}
    bench.say(command, crossed("pass", found))


def card(bench):
    """A graphics card

    By `make results ONLY=card` on a machine that has one; medians of kernels by its clock.
    """
    command = "testbed devices --device gpu --size 1024,2048,4096 --runs 9 --frames 60"
    record = bench.json(command)
    found = {(one["kernel"], f"{size['size_px']}²"): f"{1e3 * one['seconds']['median']:.3g} ({one['dispatches']})"
             for size in record["devices"][0]["sizes"] for one in size["kernels"]}
    bench.say(command, crossed("kernel, ms (dispatches)", found))
    for device in ("gpu", "cpu"):
        command = bench.series(device, "1024,2048 --format tiff --frames 200")
        bench.say(f"{command}2`, `--margin 0", of_series(bench.json(f"{command}{margin}") for margin in (2, 0)))


def borders(bench):
    """The whole image as the zone

    Whole image over a zone inside: processor time per pixel (iterations inside, whole image).
    """
    command = bench.cargo("bench", "--bench report -- borders")
    (_, rows), = tables(bench.output(command))
    found = {(motion, size): f"{ratio} ({inside}, {whole})" for size, motion, inside, whole, *_, ratio in rows}
    bench.say(command, crossed("border moves by", found))


def solvers(bench):
    """Solvers of the normal equations

    2 threads, ms, median of 5; conjugate gradients stop at 0.3 %.
    """
    command = bench.cargo("bench", "--bench report -- solvers")
    bench.say(command, columns(bench.output(command), "mesh = image/element", "nodes",
                               "solve, direct = solve by factor",
                               "solve, CG to 3e-3 (iterations) = conjugate gradients (iterations)"))


def iterations(bench):
    """Iterations

    12 tracked frames of 1024²; *flickering*: random gain and offset.
    """
    command = "scripts/flicker.py"
    printed = bench.output(command, f"--program {bench.program()} --output {bench.scratch}/flicker")
    bench.say(command, columns(printed, "elements", "light", "mean = iterations, mean"))


def mechanics(bench):
    """Mechanics of a joint

    19 instants, four sensitivities, one thread.
    """
    command = bench.cargo("bench", "--bench mechanics")
    bench.say(command, columns(bench.output(command), "elements", "unknowns", "solver", "run, s",
                               "iterations = Newton iterations", "process peak, MiB = peak, MiB"))


def identification(bench):
    """Identification

    19 instants, 585 elements, three parameters, 2 threads; then the demo, images to report.
    """
    command = bench.cargo("bench", "--bench identification")
    printed = bench.output(command).replace(" to ", "-")
    bench.say(command, columns(printed, "what", "s: median of 5 (range) = s"))
    command = "quadrille demo --output out"
    bench.say(command, f"{spread(bench.timed(command, 3)[0])} s.")


ACCURACY = [  # what is printed, what it is called here, which of the values count
    (r"16 px, node: ([\d.]+), projection ([\d.]+)", "rms at nodes, 16 px (best)", None),
    (r"16 px, field: ([\d.]+), projection ([\d.]+)", "rms between them (best)", None),
    (r"Cubic, F32: largest bias ([\d.e-]+) px", "bias, cubic", max),
    (r"Cubic, U8: largest bias ([\d.e-]+) px", "bias, cubic, 8 bit", max),
    (r"Quintic, F32: largest bias ([\d.e-]+) px", "bias, quintic", max),
    (r"whole pixels: ([\d.e-]+) px", "whole-pixel translation", max),
    (r"f32 against f64: ([\d.e-]+) px", "against an f64 code", max),
    (r"\w+ and \w+, \w+: ([\d.e-]+) px", "between instruction paths", max),
    (r"noise ([\d.]+) of the theory", "noise over theory", None),
    (r"printed uncertainty ([\d.]+) of the scatter", "uncertainty over scatter", None),
    (r"inside [\d.]+ -> ([\d.]+), all nodes", "128 px waves, values at points", max),
    (r"inside ([\d.]+) -> [\d.]+, all nodes", "128 px waves, coefficients", max),
    (r"splines 16 px ([\d.]+) px", "64 px waves, cubic splines", max),
    (r"bilinear 16 px ([\d.]+) px", "64 px waves, bilinear", max),
]
TESTS = ("accuracy::", "uncertainty::", "engine::", "point_values::", "splines::")


def accuracy(bench):
    """Accuracy

    Against exact fields, px. *Best*: their projection on the elements. Waves have an amplitude of 0.5 px.
    """
    command = bench.cargo("test", f"--test correlation -- {' '.join(TESTS)} --nocapture")
    printed, rows = bench.output(command), []
    for pattern, name, combined in ACCURACY:
        found = re.findall(pattern, printed)
        if not found:
            raise Failed(f"nothing printed is like {pattern}")
        if isinstance(found[0], tuple):
            cell = f"{float(found[0][0]):.4f} ({float(found[0][1]):.4f})"
        else:
            cell = combined(found, key=float) if combined else f"{min(found, key=float)} to {max(found, key=float)}"
        rows.append([name, cell])
    bench.say(command, table(["what", "found"], rows))


REAL = "largest error|worst deviation|: rms|in each phase|frames converged|largest difference at"


def real(bench):
    """Real images

    By `make results ONLY=real DATA=FOLDER`, with public sets (DIC Challenge) in it.
    """
    command = "scripts/real_images.py --no-maps"
    data = f"--data {shlex.quote(str(bench.arguments.data))}" if bench.arguments.data else ""
    printed = bench.output(command, f"{data} --quadrille {bench.program()} --output {bench.scratch}/real")
    (head, rows), = tables(printed)
    bench.say(command, table(head[:3], [row[:3] for row in rows if re.search(REAL, row[1])]))


# In the order of the page. The first line of what each says of itself is its title, the rest what the page says.
SECTIONS = [peers, pairs, cold, runs, series, host, small, kernels, devices, card, borders, solvers, iterations,
            mechanics, identification, accuracy, real]
BY_NAME = {function.__name__ for function in (card, real)}


# --- the page ----------------------------------------------------------------------------------------------


def printed_by(*command):
    """The first line of what a program says, or nothing."""
    try:
        return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()[0]
    except (OSError, subprocess.CalledProcessError, IndexError):
        return ""


def machine():
    """Processor, cores, memory, graphics card."""
    model = platform.processor() or platform.machine()
    for line in Path("/proc/cpuinfo").read_text(encoding="utf8").splitlines() if Path("/proc/cpuinfo").exists() else []:
        if line.startswith("model name"):
            model = line.split(":", 1)[1].strip()
        if line.startswith("flags"):
            paths = [name for flag, name in (("avx512f", "AVX-512"), ("avx2", "AVX2")) if f" {flag}" in line]
            model += f" ({paths[0]})" if paths else ""
            break
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    graphics = printed_by("nvidia-smi", "--query-gpu=name,driver_version", "--format=csv,noheader")
    return f"{os.cpu_count()} cores of {model}, {memory:.0f} GiB" + f", {graphics}" * bool(graphics)


def stamp(bench, load):
    """The line above a section's tables."""
    versions = f"{printed_by(str(bench.program()), '--version')}, {printed_by('rustc', '--version').split(' (')[0]}"
    busy = f"; **the machine had other work (load {load:.1f})**" if load > BUSY * os.cpu_count() else ""
    return textwrap.fill(f"*{time.strftime('%Y-%m-%d')}, {machine()}; {versions}{busy}.*", WIDTH)


def kept(page):
    """What the page has, section by section."""
    return dict(re.findall(r"^<!-- begin (\w+) -->\n(.*?)^<!-- end -->$", page, re.MULTILINE | re.DOTALL))


def write(bodies):
    parts = [HEAD]
    for function in SECTIONS:
        name = function.__name__
        title, introduction = inspect.getdoc(function).split("\n\n", 1)
        if name in bodies:
            parts.append(f"## {title}\n\n{introduction}\n\n<!-- begin {name} -->\n{bodies[name]}<!-- end -->\n")
    PAGE.write_text("\n".join(parts), encoding="utf8")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", help="sections, separated by commas; none is run for an empty word")
    parser.add_argument("--list", action="store_true", help="names of the sections")
    parser.add_argument("--program", type=Path, help="quadrille; built if not given")
    parser.add_argument("--profile", default="release", help="of what is built")
    parser.add_argument("--folder", type=Path, default=MEMORY, help="where images and results are kept meanwhile")
    parser.add_argument("--data", type=Path, help="folder of the real images")
    arguments = parser.parse_args()
    names = [function.__name__ for function in SECTIONS]
    if arguments.list:
        print("\n".join(name + " (only when named)" * (name in BY_NAME) for name in names))
        return 0
    usual = [name for name in names if name not in BY_NAME]
    chosen = usual if arguments.only is None else list(filter(None, arguments.only.split(",")))
    if unknown := set(chosen) - set(names):
        parser.error(f"no section is called {', '.join(sorted(unknown))}: there are {', '.join(names)}")
    bodies = kept(PAGE.read_text(encoding="utf8")) if PAGE.exists() else {}
    load, failed = os.getloadavg()[0], []  # before anything is built
    for function in SECTIONS:
        if function.__name__ not in chosen:
            continue
        print(f"== {function.__name__}", file=sys.stderr)
        with tempfile.TemporaryDirectory(dir=arguments.folder) as scratch:
            bench = Bench(arguments, Path(scratch))
            try:
                function(bench)
                bodies[function.__name__] = "\n\n".join([stamp(bench, load), *bench.parts]) + "\n"
            except (Failed, OSError, ValueError, KeyError, IndexError, subprocess.CalledProcessError) as error:
                print(f"{function.__name__}: {error}; its old figures stay", file=sys.stderr)
                failed.append(function.__name__)
        write(bodies)
    write(bodies)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
