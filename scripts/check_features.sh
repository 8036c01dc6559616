#!/usr/bin/env bash
# The crate without its optional parts: it compiles without a warning, as does the program without graphics devices, and nothing
# heavy is left in the bare correlator. Arguments (such as --profile ci) go to cargo.
set -euo pipefail
cd "$(dirname "$0")/.."

tree() { # FEATURES: the crates that it depends on
    cargo tree --locked --no-default-features --features "$1" -e normal --prefix none --format '{p}' |
        sed 's/ (\*)$//; s/ (proc-macro)$//' | sort -u
}

bare=$(tree "")
if left=$(grep -E '^(clap|wgpu|zarrs|resvg) ' <<<"$bare"); then
    echo "without features the crate still depends on: $left"
    exit 1
fi
if left=$(tree cli | grep -E '^(wgpu|naga|ash) '); then
    echo "without graphics devices the program still depends on: $left"
    exit 1
fi
echo "crates: $(wc -l <<<"$bare") without features, $(tree cli,gpu,store,report | wc -l) with all"

log=$(mktemp)
trap 'rm -f "$log"' EXIT
compiles() { # FEATURES TARGETS...: without a warning (of the whole, clippy says more)
    local features=$1
    shift
    cargo check --locked ${words[@]+"${words[@]}"} --no-default-features --features "$features" "$@" 2>&1 | tee "$log"
    if grep -q '^warning: \(unused\|`quadrille\)' "$log"; then
        echo "there are warnings with the features '$features'"
        exit 1
    fi
}
words=("$@")
compiles "" --lib
compiles report,store --lib
compiles cli --lib --bins
