#!/usr/bin/env python3
"""What a user waits for who correlates one pair: the program from its start to the results on the disk.

    scripts/cold.py [--sizes 1024,2048,4096] [--repeat 5] [--program target/release/quadrille] [--before PROGRAM] [--folder DIR]

Makes a pair of each size with `quadrille make images` (8-bit TIFF, noise of one grey level, moved by (1.3, -0.7) px) in a temporary
folder (in DIR), reads it once so that it comes from the page cache, and starts `quadrille correlate` on it, each time into a new
folder: with the whole image as the zone and nothing but the store written, and with no option at all. Prints the median of
wall time (fastest to slowest), processor time, page faults and peak memory. With --before another build does the same by
turns, and the ratio of processor times stands beside: that tells most on a machine that is shared.
"""

import argparse
import os
import pathlib
import shutil
import statistics
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent


def once(program, pair, out, options):
    """Wall time, processor time, page faults and peak memory (MB) of one process."""
    begin = time.perf_counter()
    process = subprocess.Popen([str(program), "correlate", "--quiet", "--output", str(out), *map(str, pair), *options])
    _, status, usage = os.wait4(process.pid, 0)
    wall = time.perf_counter() - begin
    if os.waitstatus_to_exitcode(status) != 0:
        raise SystemExit(f"quadrille ended with {os.waitstatus_to_exitcode(status)}")
    shutil.rmtree(out)
    return wall, usage.ru_utime + usage.ru_stime, usage.ru_minflt, usage.ru_maxrss * 1024 / 1e6


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", default="1024,2048,4096")
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--program", type=pathlib.Path, default=ROOT / "target" / "release" / "quadrille")
    parser.add_argument("--before", type=pathlib.Path)
    parser.add_argument("--folder")
    arguments = parser.parse_args()
    if not arguments.program.exists():
        raise SystemExit(f"{arguments.program} is not there: cargo build --release --locked")
    programs = [program for program in (arguments.before, arguments.program) if program]
    print(f"cold pair, 8-bit TIFF files to files, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, median of {arguments.repeat}")
    print("| image | written | program | wall, s | processor, s | page faults | MB |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory(dir=arguments.folder) as folder:
        folder = pathlib.Path(folder)
        for size in map(int, arguments.sizes.split(",")):
            images = folder / str(size)
            subprocess.run([arguments.program, "make", "images", "translation", "--size", f"{size}x{size}", "--shift", "1.3,-0.7", "--frames", "1",
                            "--noise", "1", "--output", images], check=True, capture_output=True)
            pair = sorted(images.glob("??????.tif"))
            for file in pair:
                file.read_bytes()
            whole = ["--roi", f"0,0,{size},{size}", "--export", "none"]
            for name, options in (("store", whole), ("all, zone found", [])):
                runs = {program: [] for program in programs}
                for _ in range(arguments.repeat):
                    for program in programs:
                        runs[program].append(once(program, pair, folder / "out", options))
                first = None
                for program in programs:
                    wall, processor, faults, memory = zip(*runs[program])
                    middle = statistics.median(processor)
                    first = first or middle
                    beside = f" ({middle / first:.2f} of the first)" if len(programs) > 1 else ""
                    print(f"| {size}² | {name} | {program.name} | {statistics.median(wall):.3f} ({min(wall):.3f} to {max(wall):.3f}) | "
                          f"{middle:.3f}{beside} | {statistics.median(faults):.0f} | {statistics.median(memory):.0f} |")
                    sys.stdout.flush()


if __name__ == "__main__":
    main()
