#!/usr/bin/env bash
# Builds the wheel of Python into out/wheel, checks it, installs it in a fresh environment, correlates a first pair there, and runs its
# tests (python/tests), type checks and the examples in its documentation.
#
#     scripts/wheel.sh [--zig] [--all|--notebooks] [PYTHON...]
#
# --zig links for glibc 2.28 (RHEL 8 and newer) with zig, which PyPI has; without it the wheel is for this machine and newer ones.
# --all installs the optional packages, too, and runs the notebooks; --notebooks installs what these need alone. PYTHON: further interpreters that the wheel is tried in.
# PROFILE is the profile of cargo, release by default; CARGO_TARGET_DIR holds what is built.
set -euo pipefail
cd "$(dirname "$0")/.."

zig=no all=no notebooks=no pythons=()
for word in "$@"; do
    case $word in
        --zig) zig=yes ;;
        --all) all=yes notebooks=yes ;;
        --notebooks) notebooks=yes ;;
        *) pythons+=("$word") ;;
    esac
done
first=${PYTHON:-python3}
out=$PWD/out/wheel
rm -rf "$out"
mkdir -p "$out"

venv() { # FOLDER PYTHON: a fresh environment
    "$2" -m venv "$1"
    "$1/bin/python" -m pip --version >/dev/null
}
pip() { # FOLDER WORDS...
    local folder=$1
    shift
    "$folder/bin/python" -m pip install --quiet --disable-pip-version-check "$@"
}

for licence in LICENSE-MIT LICENSE-APACHE; do
    cmp "$licence" "python/$licence" || { echo "python/$licence is to be a copy of $licence" >&2; exit 1; }
done

echo "== build"
venv "$out/build" "$first"
words=(--profile "${PROFILE:-release}" --locked --out "$out")
if [ "$zig" = yes ]; then
    pip "$out/build" 'maturin[zig]>=1.9,<2' auditwheel abi3audit
    words+=(--zig --compatibility manylinux_2_28)
else
    pip "$out/build" 'maturin>=1.9,<2' auditwheel abi3audit
    words+=(--compatibility linux)
fi
(cd python && PATH="$out/build/bin:$PATH" "$out/build/bin/maturin" build "${words[@]}")
wheel=$(ls "$out"/quadrille-*.whl)
size=$(stat -c %s "$wheel")
echo "wheel: $(basename "$wheel"), $((size / 1048576)).$((size % 1048576 * 10 / 1048576)) MiB"
[ "$size" -le $((25 * 1048576)) ] || { echo "the wheel is larger than 25 MiB" >&2; exit 1; }

echo "== what is in it"
"$out/build/bin/auditwheel" show "$wheel"
"$out/build/bin/abi3audit" --strict "$wheel"
"$first" - "$wheel" <<'PY'
import sys, zipfile
names = zipfile.ZipFile(sys.argv[1]).namelist()
for wanted in ["LICENSE-MIT", "LICENSE-APACHE", "THIRD_PARTY.txt", "py.typed", "_quadrille.pyi", "entry_points.txt"]:
    assert any(name.endswith(wanted) for name in names), f"{wanted} is not in the wheel"
PY

try_in() { # PYTHON FOLDER: installs the wheel and correlates a pair, timed from the empty environment to the field
    local begin end
    venv "$2" "$1"
    pip "$2" numpy # what users have; its download is not ours
    begin=$(date +%s.%N)
    pip "$2" "$wheel"
    "$2/bin/python" -W ignore scripts/wheel_pair.py
    end=$(date +%s.%N)
    awk -v a="$begin" -v b="$end" -v p="$("$2/bin/python" -V)" 'BEGIN { printf "%s: installed and a pair correlated in %.1f s\n", p, b - a; exit b - a > 10 }'
}

echo "== a pair in fresh environments"
try_in "$first" "$out/venv"
for python in ${pythons[@]+"${pythons[@]}"}; do
    try_in "$python" "$out/venv-$(basename "$(dirname "$(dirname "$python")")")"
done

echo "== tests"
extras=(pytest mypy zarr)
[ "$notebooks" = yes ] && extras+=(matplotlib pandas pandas-stubs nbclient ipykernel)
[ "$all" = yes ] && extras+=(xarray pyvista scikit-image tqdm 'dask[array]' distributed)
pip "$out/venv" "${extras[@]}"
python=$out/venv/bin/python
(cd python/tests && "$python" -m pytest -q -p no:cacheprovider .)
echo "== documentation and types"
(cd "$out" && "$python" -W ignore - <<'PY'
import doctest, importlib, sys
failed = tried = 0
for name in ["", "._camera", "._correlator", "._field", "._images", "._progress", "._runs"]:
    result = doctest.testmod(importlib.import_module("quadrille" + name))
    failed, tried = failed + result.failed, tried + result.attempted
print(f"{tried} examples")
sys.exit(failed > 0 or tried == 0)
PY
)
"$python" scripts/tutorial.py
(cd "$out" && MYPY_CACHE_DIR="$out/mypy" "$python" -m mypy.stubtest quadrille._quadrille)
(cd "$out" && MYPY_CACHE_DIR="$out/mypy" "$python" -m mypy --strict --ignore-missing-imports -p quadrille)
MYPY_CACHE_DIR="$out/mypy" "$python" -m mypy --strict --ignore-missing-imports python/examples
if [ "$notebooks" = yes ]; then
    echo "== notebooks"
    "$python" scripts/notebooks.py
fi
