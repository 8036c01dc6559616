#!/usr/bin/env bash
# What is long and seldom tells more than .ci/run: for whoever changes the parts that it looks at, and before a release.
#
#     scripts/release-check.sh [PART...]
#
# Without a part all of them, in this order:
#     deny      licences, sources and advisories of the crates that are used (deny.toml)
#     features  the library without its optional parts
#     package   what crates.io would get
#     release   archive, bill of materials, notes and checksums of a release
#     book      the pages as one book
#     examples  the examples of the library, run
#     testbed   the tests of benches/testbed: figures of the benches, the paper again
#     gate      ratios of the engine's times (benches/testbed/benches/report.rs)
#     browser   every page in Chromium
#     slurm     a cluster of one node
#     thorough  the tests in modules of that name: more kills, the paper again, every altered shader
#     fuzz      every reader of files for a minute
#     drivers   the shaders on SwiftShader and under the validation layer
#     wheel     the wheel of Python with its notebooks
#     miri      undefined behaviour
set -euo pipefail
cd "$(dirname "$0")/.."

profile=(--profile ci)
# The test bed would compile the program with a device more.
whole=(--locked --workspace --exclude quadrille-testbed "${profile[@]}")
export QUADRILLE_GPU=${QUADRILLE_GPU:-require}
parts=("$@")
[ ${#parts[@]} -gt 0 ] || parts=(deny features package release book examples testbed gate browser slurm thorough fuzz drivers wheel miri)

deny() { scripts/prepare.sh --deny && scripts/deny.sh; }
features() { scripts/check_features.sh "${profile[@]}"; }
package() { scripts/package.sh "${profile[@]}"; }
release() {
    cargo build --locked "${profile[@]}" --bin quadrille
    rm -rf out/release
    scripts/release.sh --program "${CARGO_TARGET_DIR:-target}/ci/quadrille" archive sbom notes sums
}
book() { make book; }
examples() {
    cargo build "${whole[@]}" --examples
    target/ci/quadrille demo --overwrite --output out/demo
    target/ci/examples/identify_from_images out/demo/test/case.toml out/example
    target/ci/examples/pair
    target/ci/examples/series
}
testbed() { cargo test --locked "${profile[@]}" -p quadrille-testbed --tests; }
gate() { cargo bench --locked "${profile[@]}" -p quadrille-testbed --bench report -- gate; }
browser() {
    scripts/prepare.sh --chromium
    QUADRILLE_CHROMIUM=require scripts/test.sh "${profile[@]}" --test commands -- view:: studio:: run:: metrology::
}
slurm() { scripts/prepare.sh --slurm && QUADRILLE_SLURM=require cargo test "${whole[@]}" --test slurm; }
thorough() {
    cargo test "${whole[@]}" --tests -- --ignored thorough
    cargo test --locked "${profile[@]}" -p quadrille-testbed --tests -- --ignored thorough
}
fuzz() { QUADRILLE_FUZZ_SECONDS=60 cargo test "${whole[@]}" --test commands -- fuzz:: --nocapture --test-threads=8; }
drivers() { scripts/prepare.sh --chromium && scripts/prepare.sh --validation && scripts/drivers.sh --workspace --exclude quadrille-testbed "${profile[@]}"; }
wheel() { make wheel PROFILE=ci WHEEL=--notebooks; }
miri() { scripts/prepare.sh --miri && scripts/miri.sh; }

table=""
for part in "${parts[@]}"; do
    [ "$(type -t "$part")" = function ] || { echo "release-check: there is no part '$part'" >&2; exit 2; }
    echo "== $part"
    begin=$SECONDS
    "$part"
    table+=$(printf '%-9s %5d s' "$part" $((SECONDS - begin)))$'\n'
done
printf '\nwhat ran:\n%s' "$table"
