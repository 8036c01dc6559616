#!/usr/bin/env bash
# The tests of the workspace (the long ones: scripts/release-check.sh), then the examples in the documentation. cargo-nextest, where it is installed, prints the time of each test and
# ends one that hangs; `cargo test` runs them else.
#
#     scripts/test.sh [words for cargo, such as --profile ci] [-- names of tests]
set -euo pipefail
cd "$(dirname "$0")/.."

words=() names=()
while [ $# -gt 0 ]; do
    if [ "$1" = -- ]; then
        shift
        names=("$@")
        break
    fi
    words+=("$1")
    shift
done

scripts/prepare.sh
# The tests take a QUADRILLE_PYTHON at its word and fail when it has no meshio; without one they try python3.
if [ -z "${QUADRILLE_PYTHON:-}" ] && [ -x .venv/bin/python ]; then
    export QUADRILLE_PYTHON="$PWD/.venv/bin/python"
fi
# Where the software driver is installed, a test that finds no GPU fails; elsewhere it says that it did not run.
if [ -n "${QUADRILLE_GPU:-}" ]; then
    echo "prepare: gpu: $QUADRILLE_GPU (QUADRILLE_GPU)"
elif scripts/prepare.sh --has-vulkan; then
    export QUADRILLE_GPU=require
    echo "prepare: gpu: required"
else
    echo "prepare: gpu: not required (no software Vulkan driver could be installed)"
fi
made=() # for the time of the tests
trap 'rm -rf ${made[@]+"${made[@]}"}' EXIT
# The driver looks for a folder of its own, and complains without one.
if [ -z "${XDG_RUNTIME_DIR:-}" ]; then
    XDG_RUNTIME_DIR=$(mktemp -d)
    export XDG_RUNTIME_DIR
    made+=("$XDG_RUNTIME_DIR")
fi
# Thousands of files that live for a second: in memory where there is room, which takes a quarter off the tests of the commands.
room=$(df --output=avail -k /dev/shm 2>/dev/null | tail -1)
if [ -z "${TMPDIR:-}" ] && [ "${room:-0}" -gt $((4 * 1024 * 1024)) ] && TMPDIR=$(mktemp -d -p /dev/shm); then
    export TMPDIR
    made+=("$TMPDIR")
fi
# What several tests begin with, made by the first of them (tests/common/shared.rs).
QUADRILLE_SHARED=$(mktemp -d)
export QUADRILLE_SHARED
made+=("$QUADRILLE_SHARED")

# The test bed would compile the program again, with a device of its own: `make release-check PARTS=testbed`.
all=(--locked --workspace --exclude quadrille-testbed)
# All of them, also after one that fails: a run in CI tells all that is wrong.
status=0
if cargo nextest --version >/dev/null 2>&1; then
    # nextest has profiles of its own.
    nextest=()
    for word in ${words[@]+"${words[@]}"}; do
        nextest+=("${word/#--profile/--cargo-profile}")
    done
    cargo nextest run "${all[@]}" ${nextest[@]+"${nextest[@]}"} ${names[@]+"${names[@]}"} || status=1
else
    cargo test "${all[@]}" --tests --no-fail-fast ${words[@]+"${words[@]}"} -- ${names[@]+"${names[@]}"} || status=1
fi
if [ ${#names[@]} -eq 0 ]; then
    cargo test "${all[@]}" --doc ${words[@]+"${words[@]}"} || status=1
fi
exit $status
