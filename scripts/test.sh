#!/usr/bin/env bash
# Every test: `cargo test` over the library and the test programs, then the examples in the documentation. Arguments (such as
# --profile ci) go to both.
set -euo pipefail
cd "$(dirname "$0")/.."

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
# All of them, also after one that fails: a run in CI tells all that is wrong. As the whole workspace, packages have the features that the
# module of Python needs too (it has no tests in Rust): one build serves both.
status=0
cargo test --locked --workspace --tests --no-fail-fast "$@" || status=1
cargo test --locked --workspace --doc "$@" || status=1
exit $status
