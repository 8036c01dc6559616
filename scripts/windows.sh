#!/usr/bin/env bash
# Builds quadrille.exe on Linux, and where there is wine lets it correlate a pair: the displacements are those that the program for Linux
# finds in the same images. The program for Windows is target/x86_64-pc-windows-gnu/PROFILE/quadrille.exe and needs no other file.
#
#     scripts/windows.sh [--profile PROFILE] [CARGO-WORDS...]     (release)
set -euo pipefail
cd "$(dirname "$0")/.."

profile=release
if [ "${1:-}" = --profile ]; then
    profile=$2
    shift 2
fi
words=("$@")
target=x86_64-pc-windows-gnu
scripts/prepare.sh --windows || { echo "windows: no cross compiler; see above" >&2; exit 2; }
rustup target add "$target"
export CARGO_TARGET_X86_64_PC_WINDOWS_GNU_LINKER=x86_64-w64-mingw32-gcc
cargo build --locked --profile "$profile" --bin quadrille ${words[@]+"${words[@]}"}
cargo build --locked --profile "$profile" --bin quadrille ${words[@]+"${words[@]}"} --target "$target"
folder=$(realpath "${CARGO_TARGET_DIR:-target}")
linux=$folder/$profile/quadrille
windows=$folder/$target/$profile/quadrille.exe
echo "windows: $windows, $(($(stat -c %s "$windows") / 1048576)) MiB"

wine=$(command -v wine64 || command -v wine || ls /usr/lib/wine/wine64 2>/dev/null || true)
if [ -z "$wine" ]; then
    echo "windows: linked; not tried, there is no wine"
    exit 0
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export WINEPREFIX=$work/prefix WINEDEBUG=-all
# Older wine does not have this library of Windows 10, which the standard library of Rust takes random numbers from.
cat > "$work/prng.c" <<'C'
__declspec(dllimport) unsigned char __stdcall SystemFunction036(void *, unsigned long);
__declspec(dllexport) int ProcessPrng(unsigned char *to, unsigned long long n) { return SystemFunction036(to, (unsigned long)n); }
C
mkdir "$work/program"
x86_64-w64-mingw32-gcc -shared -O1 -o "$work/program/bcryptprimitives.dll" "$work/prng.c" -ladvapi32
cp "$windows" "$work/program/"
windows=$work/program/$(basename "$windows")
"$linux" make images accuracy --size 256x192 --frames 3 --output "$work/images" > /dev/null
cd "$work/images"
first=$(ls ./*.tif | head -1)
words=(correlate --device cpu --element-size 16 --export csv --quiet --reference "$first")
"$linux" "${words[@]}" --output ../linux ./*.tif
# A pattern that the program itself resolves, and a folder with a drive: wine shows / as drive Z.
"$wine" "$windows" "${words[@]}" --output "Z:${work//\//\\}\\windows" './*.tif'
cd "$OLDPWD"
python3 - "$work/linux" "$work/windows" <<'PY'
import csv, sys
from pathlib import Path

def tables(folder):
    return {p.name: [row for row in csv.reader(l for l in p.open() if not l.startswith("#"))] for p in Path(folder).rglob("*.csv")}

linux, windows = map(tables, sys.argv[1:])
assert linux.keys() == windows.keys() and linux, (linux.keys(), windows.keys())
worst = 0.0
for name, rows in linux.items():
    assert len(rows) == len(windows[name]) and rows[0] == windows[name][0], name
    for ours, theirs in zip(rows[1:], windows[name][1:]):
        for head, a, b in zip(rows[0], ours, theirs):
            if head.endswith("_px"):
                worst = max(worst, abs(float(a) - float(b)))
# The same additions in the same order; functions of another C library differ in the last digit.
print(f"windows: {len(linux)} tables, displacements within {worst:.1e} px of those of Linux")
sys.exit(worst > 1e-6)
PY
