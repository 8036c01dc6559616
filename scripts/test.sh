#!/usr/bin/env bash
# Every test: `cargo test` over all targets, then the examples in the documentation. Arguments go to the first.
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/prepare.sh
# The tests take a QUADRILLE_PYTHON at its word and fail when it has no meshio; without one they try python3.
if [ -z "${QUADRILLE_PYTHON:-}" ] && [ -x .venv/bin/python ]; then
    export QUADRILLE_PYTHON="$PWD/.venv/bin/python"
fi
cargo test --locked --all-targets "$@"
cargo test --locked --doc
