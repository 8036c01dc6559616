#!/usr/bin/env bash
# Looks for undefined behaviour: runs crates/dic/tests/miri.rs (passes over a few pixels, a mesh, factors) in the interpreter Miri, on a
# nightly toolchain (scripts/prepare.sh --miri).
set -euo pipefail
cd "$(dirname "$0")/.."

nightly=nightly-2026-10-30
export MIRIFLAGS="-Zmiri-disable-isolation -Zmiri-tree-borrows -Zmiri-ignore-leaks"
unset RUSTC_WORKSPACE_WRAPPER # that of CI: it does not ask it which compiler it is
exec cargo "+$nightly" miri test --locked --package quadrille-dic --test miri --target-dir target/miri
