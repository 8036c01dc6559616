#!/usr/bin/env python3
"""Long and hostile runs: every write that fails, a hundred thousand frames with kills, shards of which one dies again and again, a
thousand zones, images larger than the memory that may be had, a clock that jumps. The table of docs/robustness.md.

    scripts/soak.py [--frames 100000] [--zones 1000] [--side 20000] [--parts disk,series,shards,zones,large,clock]
                    [--program target/release/quadrille] [--output out/soak]

Each part prints what was done and what was lost, and the script ends with 1 when something was. 100 000 frames are 1.5 million
small files, 7 GB; of the run that others are compared with, digests alone are kept.
"""

import argparse
import hashlib
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SEED = 20261123
TINY = ["--element-size", "16", "--export", "none", "--quiet", "--device", "cpu", "--threads", "1"]
lost: list[str] = []


def report(part: str, what: str, *failures: str) -> None:
    lost.extend(f"{part}: {failure}" for failure in failures)
    print(f"| {part} | {what} | {'; '.join(failures[:5]) or 'nothing'} |", flush=True)


def run(*words, **more) -> subprocess.CompletedProcess:
    return subprocess.run([str(word) for word in words], capture_output=True, text=True, stdin=subprocess.DEVNULL, **more)


def contents(folder: Path) -> dict[str, str]:
    """What is in a run, but for times, locks and names of folders: a hash of each file of the store and the table of statuses."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.suffix in (".csv", ".vtu", ".npz", ".mat") or (path.is_file() and "fields.zarr" in path.parts and path.name != "zarr.json"):
            found[str(path.relative_to(folder))] = hashlib.sha256(path.read_bytes()).hexdigest()
    summary = folder / "summary.json"
    if summary.exists():
        frames = json.loads(summary.read_text()).get("frames", [])
        for frame in frames:
            found[f"frame {frame['number']}"] = f"{frame['status']} {frame.get('rigid_motion')} {frame.get('residual_grey')}"
    return found


def taken(folder: Path) -> dict[str, str]:
    """What is in a run, which is then deleted: two of a long series need not lie on the disk at the same time."""
    found = contents(folder)
    shutil.rmtree(folder)
    return found


def compared(wanted: dict[str, str], folder: Path) -> list[str]:
    """How the run in `folder` differs from what was wanted. It is deleted when it does not."""
    wrong = differences(wanted, contents(folder))
    if not wrong:
        shutil.rmtree(folder)
    return wrong


def differences(wanted: dict[str, str], there: dict[str, str]) -> list[str]:
    wrong = [name for name in wanted.keys() | there.keys() if wanted.get(name) != there.get(name)]
    return [f"{len(wrong)} of {len(wanted)} files differ, such as {min(wrong)}"] if wrong else []


def ended(ran: subprocess.CompletedProcess, codes: tuple[int, ...]) -> list[str]:
    """What is wrong with the end of a program."""
    wrong = []
    if ran.returncode not in codes:
        wrong.append(f"exit {ran.returncode}: {ran.stderr[-300:]!r}")
    if "panicked" in ran.stderr or "abort" in ran.stderr:
        wrong.append(f"panic: {ran.stderr[-300:]!r}")
    return wrong


def images(program: Path, folder: Path) -> Path:
    """The reference and 20 frames of 96 x 96 px."""
    if not folder.exists():
        done = run(program, "make", "images", "accuracy", "--size", "96x96", "--frames", "20", "--noise", "1", "--grid", "64", "--output", folder)
        assert done.returncode == 0, done.stderr
    return folder


def links(base: Path, folder: Path, n: int) -> Path:
    """A series of `n` frames, to and fro."""
    if not folder.exists():
        folder.mkdir(parents=True)
        for frame in range(n):
            at = frame % 38
            os.link(base / f"{min(at, 38 - at) + 1:06}.tif", folder / f"{frame:06}.tif")
    return folder


def preload(output: Path) -> Path:
    library = output / "full_disk.so"
    subprocess.run(["cc", "-shared", "-fPIC", "-o", library, ROOT / "scripts/full_disk.c", "-ldl"], check=True)
    return library


# ---- every write fails ----


def commands(program: Path, output: Path) -> dict[str, list[str]]:
    """Commands that write into disk/out, and what they need beside it."""
    base = images(program, output / "base")
    common = [str(program)]
    frames = [str(base / f"{k:06}.tif") for k in (1, 2, 3)]
    run(program, "correlate", *TINY, "--reference", base / "000000.tif", "--output", output / "whole", *frames)
    correlate = [*common, "correlate", "--quiet", "--device", "cpu", "--reference", str(base / "000000.tif"), "--output", "disk/out"]
    joint = output / "joint/case.toml"
    joint.parent.mkdir(exist_ok=True)
    text = (
        '[mesh]\nelement_size_mm = 0.5\ncolumns = 8\nrows = 2\ngap_mm = 0.1\n[groups]\nwall = "y = min"\ngrip = "y = max"\n'
        '[[support]]\ngroup = "wall"\nu_x_mm = 0.0\nu_y_mm = 0.0\n'
        '[[support]]\ngroup = "grip"\nu_y_mm = { to = 0.01, instants = 4 }\n'
        '[substrate]\nmodel = "linear-elastic"\nE_MPa = 72000.0\nnu = 0.33\n'
        '[cohesive]\nmodel = "extended-xu-needleman"\nphi_n_N_per_mm = 1.0\ndelta_n_mm = 0.005\ndelta_t_mm = 0.05\nr = 4.0\n'
    )
    joint.write_text(text)
    run(program, "simulate", joint, "--output", joint.parent / "truth")
    fit = joint.with_name("fit.toml")
    fit.write_text(
        text + '[measurement]\nfile = "truth/solution.csv"\nnodes = "free"\nweights = "uniform"\nboundary = "exact"\nnoise_mm = 1e-5\n'
        '[fit]\nparameters = ["phi_n"]\n[fit.start]\nphi_n = 1.2\n'
    )
    # Two images of a joint, and a fit that ends soon: a run is given again hundreds of times.
    virtual = output / "virtual"
    run(program, "make", "virtual-test", "--instants", "2", "--output", virtual)
    case = (virtual / "case.toml").read_text()
    case, of_fit = case.split("[fit]\n")
    plasticity = ("sigma_0_MPa", "alpha", "n")
    case = "".join(line for line in case.splitlines(keepends=True) if line.split(" = ")[0] not in plasticity)
    case = case.replace('"ramberg-osgood"', '"linear-elastic"').replace("element_size_px = 16", "element_size_px = 32")
    of_fit = '[fit]\nintervals = "linear"\ndiscretisation = "off"\nparameters = ["phi_n"]\n' + of_fit[of_fit.index("exact = ") : of_fit.index("[fit.start]")]
    (virtual / "small.toml").write_text(f"{case}{of_fit}[fit.start]\nphi_n = 1.5\n")
    return {
        "correlate": [*correlate, *frames],
        "correlate, reference renewed": [*correlate, "--update-reference", "every:1", "--export", "none", *frames],
        "export": [*common, "export", str(output / "whole"), "--output", "disk/out", "--to", "npz,mat,csv,vtu"],
        "simulate": [*common, "simulate", str(joint), "--output", "disk/out"],
        "identify": [*common, "identify", str(fit), "--output", "disk/out"],
        "run": [*common, "run", str(virtual / "small.toml"), "--quiet", "--device", "cpu", "--output", "disk/out"],
    }


def each_write(name: str, command: list[str], output: Path, library: Path, step: int) -> None:
    """The `command` with each of its writes failing, and given again."""
    work = output / "full"

    def once(at: int, more: dict[str, str], again: bool) -> subprocess.CompletedProcess:
        if not again:
            shutil.rmtree(work, ignore_errors=True)
            (work / "disk").mkdir(parents=True)
        environment = {**os.environ, "LD_PRELOAD": str(library), "QUADRILLE_TEST_COUNT": str(work / "count"), **more}
        if at:
            environment["QUADRILLE_TEST_FULL_AT"] = str(at)
        # A machine whose cores are busy with others may let it wait for minutes; what waits for ever is found all the same.
        return run(*command, cwd=work, env=environment, timeout=1800)

    first = once(0, {}, False)
    if first.returncode not in (0, 1):
        report("disk", name, f"does not run: {first.stderr[-300:]!r}")
        return
    n = int((work / "count").read_text())
    out = work / "disk/out"
    files = {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()}
    wanted = contents(out)
    wrong = []
    for more in ({}, {"QUADRILLE_TEST_ONCE": "1"}):
        for at in range(1, n + 1, step):
            full = once(at, more, False)
            what = f"write {at}{' alone' if more else ''}"
            wrong += [f"{what}: {failure}" for failure in ended(full, (1, 2))]
            if full.returncode in (1, 2) and "No space left" not in full.stderr:
                wrong.append(f"{what}: does not say why: {full.stderr[-200:]!r}")
            again = once(0, {}, True)
            if again.returncode == 2 and "--overwrite" in again.stderr:
                command.append("--overwrite")
                again = once(0, {}, True)
                command.pop()
            wrong += [f"{what}, again: {failure}" for failure in ended(again, (first.returncode,))]
            wrong += [f"{what}, again: {failure}" for failure in differences(wanted, contents(out))]
            there = {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()}
            if there != files:
                wrong.append(f"{what}, again: other files: {sorted(there ^ files)[:4]}")
    report("disk", f"`{name}`: {n} operations, {2 * len(range(1, n + 1, step))} of them failing for once or for good", *wrong)


def disk(options) -> None:
    library = preload(options.output)
    for name, command in commands(options.program, options.output).items():
        if options.commands and name not in options.commands:
            continue
        each_write(name, command, options.output, library, options.step)


# ---- long series ----


def kill_until_done(command: list, kills: int, moments: random.Random, seconds: float, **more) -> tuple[int, list[str]]:
    """Runs the command, ends it by SIGKILL at random moments, gives it again, and lets the last one end."""
    done = 0
    while True:
        process = subprocess.Popen([str(word) for word in command], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, **more)
        if done < kills:
            try:
                process.wait(timeout=moments.uniform(0.02, 1.0) * seconds)
            except subprocess.TimeoutExpired:
                process.send_signal(signal.SIGKILL)
                process.wait()
                done += 1
                continue
        said = process.stderr.read()
        code = process.wait()
        return done, [] if code == 0 and "panicked" not in said else [f"exit {code}: {said[-300:]!r}"]


def series(options) -> None:
    n = options.frames
    base = images(options.program, options.output / "base")
    folder = links(base, options.output / f"links{n}", n)
    command = [options.program, "correlate", *TINY, "--reference", base / "000000.tif", "--output"]
    begin = time.monotonic()
    whole = run(*command, options.output / "series", f"{folder}/*.tif")
    seconds = time.monotonic() - begin
    wrong = ended(whole, (0,))
    wanted = taken(options.output / "series")
    moments = random.Random(SEED)
    kills, failures = kill_until_done([*command, options.output / "killed", f"{folder}/*.tif"], 10, moments, seconds / 10)
    wrong += failures + compared(wanted, options.output / "killed")
    what = f"{len(wanted)} digests of files and frames compared"
    report("series", f"{n} frames, tracked ({seconds:.0f} s); {kills} times killed and given again; {what}", *wrong)


def shards(options) -> None:
    n = options.frames
    base = images(options.program, options.output / "base")
    folder = links(base, options.output / f"links{n}", n)
    command = [options.program, "correlate", *TINY, "--start", "independent", "--reference", base / "000000.tif", "--output"]
    begin = time.monotonic()
    whole = run(*command, options.output / "alone", f"{folder}/*.tif")
    seconds = time.monotonic() - begin
    wrong = ended(whole, (0,))
    wanted = taken(options.output / "alone")
    of = [[*command, options.output / "shards", "--shard", f"{k}/4", f"{folder}/*.tif"] for k in (1, 2, 3, 4)]
    others = [subprocess.Popen([str(word) for word in words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) for words in of[1:]]
    kills, failures = kill_until_done(of[0], 10, random.Random(SEED), seconds / 30)
    codes = [process.wait() for process in others]
    wrong += failures + [f"another shard ended with {code}" for code in codes if code != 0]
    wrong += ended(run(options.program, "status", options.output / "shards"), (0,))
    wrong += compared(wanted, options.output / "shards")
    what = f"{len(wanted)} digests of files and frames compared"
    report("shards", f"{n} frames, 4 processes, the first {kills} times killed and given again; {what}", *wrong)


# ---- many zones, large images ----


def zones(options) -> None:
    columns = max(1, round(options.zones**0.5))
    rows = -(-options.zones // columns)
    size = [34 * columns + 32, 34 * rows + 32]
    folder = options.output / "zones"
    folder.mkdir(exist_ok=True)
    run(options.program, "make", "images", "translation", "--shift", "0.6,-0.3", "--size", f"{size[0]}x{size[1]}", "--output", folder / "images")
    case = ["[images]", 'reference = "images/000000.tif"', 'deformed = "images/000001.tif"']
    for zone in range(options.zones):
        x, y = 16 + 34 * (zone % columns), 16 + 34 * (zone // columns)
        case += ["[[zone]]", f'name = "z{zone}"', f"roi = [{x}, {y}, {x + 32}, {y + 32}]"]
    (folder / "case.toml").write_text("\n".join(case) + "\n")
    begin = time.monotonic()
    ran = run(options.program, "correlate", "--device", "cpu", "--quiet", "--case", folder / "case.toml", "--output", folder / "out", "--overwrite")
    seconds = time.monotonic() - begin
    wrong = ended(ran, (0,))
    if not wrong:
        found = json.loads((folder / "out/summary.json").read_text())["frames"][0]["zones"]
        off = max(abs(zone["rigid_motion"]["translation_px"][k] - (0.6, -0.3)[k]) for zone in found for k in (0, 1))
        if len(found) != options.zones or off > 0.02:
            wrong.append(f"{len(found)} zones, {off:.3f} px off")
    report("zones", f"{options.zones} zones of 32 x 32 px in {size[0]} x {size[1]} px ({seconds:.0f} s)", *wrong)


def tiled(tile: bytes, side: int, of: int, path: Path) -> None:
    """An 8-bit TIFF file of `side`² px: the tile of `of`² px again and again."""
    import struct

    entries = [(256, 4, 1, side), (257, 4, 1, side), (258, 3, 1, 8), (259, 3, 1, 1), (262, 3, 1, 1), (273, 4, 1, 8), (277, 3, 1, 1),
               (278, 4, 1, side), (279, 4, 1, side * side)]
    with path.open("wb") as out:
        out.write(b"II*\0" + struct.pack("<I", 8 + side * side))
        for row in range(side):
            line = tile[row % of * of : row % of * of + of]
            out.write((line * (side // of + 1))[:side])
        out.write(struct.pack("<H", len(entries)))
        out.writelines(struct.pack("<HHII", *entry) for entry in entries)
        out.write(b"\0\0\0\0")


def large(options) -> None:
    folder = options.output / "large"
    folder.mkdir(exist_ok=True)
    side, of = options.side, 512
    run(options.program, "make", "images", "translation", "--shift", "0.6,-0.3", "--size", f"{of}x{of}", "--output", folder / "tile")
    for name in ("000000", "000001"):
        bytes_of = (folder / f"tile/{name}.tif").read_bytes()
        start = bytes_of.find(b"II*\0")
        offset = pixels_of(bytes_of)
        tiled(bytes_of[offset : offset + of * of], side, of, folder / f"{name}.tif")
        assert start == 0
    for gib in options.gib:
        limit = gib << 30
        begin = time.monotonic()
        ran = run(options.program, "correlate", "--device", "cpu", "--quiet", "--export", "none", "--element-size", "64", "--threads", "2", "--max-iterations", "8",
                  "--reference", folder / "000000.tif", "--output", folder / f"out{gib}", "--overwrite", folder / "000001.tif",
                  preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (limit, limit)))
        wrong = ended(ran, (0, 1, 2))
        said = " ".join(ran.stderr.split())
        report("large", f"{side} x {side} px in {gib} GiB: exit {ran.returncode} after {time.monotonic() - begin:.0f} s, {said[:160]!r}", *wrong)


def pixels_of(tiff: bytes) -> int:
    """Where the one strip of a TIFF file without compression begins."""
    import struct

    (ifd,) = struct.unpack_from("<I", tiff, 4)
    (n,) = struct.unpack_from("<H", tiff, ifd)
    for k in range(n):
        tag, kind, count, value = struct.unpack_from("<HHII", tiff, ifd + 2 + 12 * k)
        if tag == 273:
            return value if count == 1 else struct.unpack_from("<I", tiff, value)[0]
    raise SystemExit("no strips")


# ---- clocks ----


def clock(options) -> None:
    library = preload(options.output)
    base = images(options.program, options.output / "base")
    frames = [base / f"{k:06}.tif" for k in range(1, 21)]
    command = [options.program, "correlate", *TINY, "--reference", base / "000000.tif", *frames, "--output"]
    wrong = ended(run(*command, options.output / "steady"), (0,))
    for days in (-4000, -1, 1, 4000):
        environment = {**os.environ, "LD_PRELOAD": str(library), "QUADRILLE_TEST_CLOCK": str(86400 * days)}
        out = options.output / f"clock{days}"
        _, failures = kill_until_done([*command, out], 3, random.Random(SEED), 0.5, env=environment)
        wrong += failures + differences(contents(options.output / "steady"), contents(out))
    # Files of the future, as a clock leaves them that went back; the frame done last is damaged as by a machine that went down.
    out = options.output / "future"
    wrong += ended(run(*command, out), (0,))
    ahead = time.time() + 86400
    for number in range(1, 20):
        os.utime(out / f"fields.zarr/status/c.{number - 1}", (ahead, ahead))
    damaged = next((out / "fields.zarr/displacement_px").glob("c.19*"))
    damaged.write_bytes(bytes(damaged.stat().st_size))
    (out / "summary.json").unlink()
    wrong += ended(run(*command, out), (0,)) + differences(contents(options.output / "steady"), contents(out))
    report("clock", "20 frames, killed 3 times, the time of day jumps by 1 and 4000 days at every look; files of the future and a damaged frame", *wrong)


PARTS = {"disk": disk, "series": series, "shards": shards, "zones": zones, "large": large, "clock": clock}


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--frames", type=int, default=100_000)
    options.add_argument("--zones", type=int, default=1000)
    options.add_argument("--side", type=int, default=20_000)
    options.add_argument("--gib", type=int, nargs="+", default=[1, 2, 4, 8], help="memory for the large images")
    options.add_argument("--step", type=int, default=1, help="of the writes, every so many")
    options.add_argument("--commands", nargs="+", help="of the part disk: correlate, export, simulate, identify, run")
    options.add_argument("--parts", default=",".join(PARTS))
    options.add_argument("--program", type=Path, default=ROOT / "target/release/quadrille")
    options.add_argument("--output", type=Path, default=ROOT / "out/soak")
    options = options.parse_args()
    options.output, options.program = options.output.resolve(), options.program.resolve()
    shutil.rmtree(options.output, ignore_errors=True)
    options.output.mkdir(parents=True)
    print("| part | done | lost |\n| --- | --- | --- |")
    for part in options.parts.split(","):
        PARTS[part](options)
    print(f"{len(lost)} faults" if lost else "nothing was lost")
    (options.output / "faults.txt").write_text("\n".join(lost) + "\n" if lost else "")
    return 1 if lost else 0


if __name__ == "__main__":
    sys.exit(main())
