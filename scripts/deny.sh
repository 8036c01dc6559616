#!/usr/bin/env bash
# What is built on (deny.toml): licences, sources, banned and doubled crates, and what is known against them (advisories), whose database
# is fetched from where it is kept. Where that cannot be reached one line says so; with `advisories` it is a fault. And whether the
# notices in the program are those of its crates. Other arguments go to cargo-deny (such as --config FILE).
set -euo pipefail
cd "$(dirname "$0")/.."

required=no
if [ "${1:-}" = advisories ]; then
    required=yes
    shift
fi
scripts/licences.py --check
deny=$(command -v cargo-deny || echo .venv/bin/cargo-deny)
[ -x "$deny" ] || { echo "cargo-deny is missing: cargo install cargo-deny, or scripts/prepare.sh --deny" >&2; exit 1; }

"$deny" --locked --all-features "$@" check bans licenses sources
# The database is fetched by itself: a check that cannot fetch ends with the same status as one that found something.
if why=$(timeout 300 "$deny" --locked "$@" fetch db 2>&1); then
    "$deny" --locked --offline --all-features "$@" check advisories
else
    why=$(grep -om1 'fatal: .*' <<<"$why" || tail -n 1 <<<"${why:-no answer in five minutes}")
    echo "advisories: not asked for, their database cannot be had ($why)"
    [ "$required" = no ]
fi
