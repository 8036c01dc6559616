#!/usr/bin/env bash
# Attacks everything that reads files of others, guided by coverage: every target for so many seconds (60), as many at a time as there
# are cores, on the stable toolchain.
# Starts from fuzz/seeds and from what earlier runs found (out/fuzz); what ends a target is kept in out/fuzz/findings.
#
#     scripts/fuzz.sh [SECONDS] [TARGET...]
set -euo pipefail
cd "$(dirname "$0")/.."

seconds=${1:-60}
shift || true
targets=("$@")
[ ${#targets[@]} -gt 0 ] || targets=(images masks meshes fields cases joints tables store state)

# libFuzzer's counters on every edge and its view of comparisons; no sanitizer, which stable does not have: wrapping and indices are
# checked by the language, memory by its limit.
coverage="-Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 -Cllvm-args=-sanitizer-coverage-inline-8bit-counters \
-Cllvm-args=-sanitizer-coverage-pc-table -Cllvm-args=-sanitizer-coverage-trace-compares -Ccodegen-units=16 --cfg fuzzing"
host=$(rustc -vV | sed -n 's/^host: //p')
RUSTFLAGS="$coverage" cargo build --release --manifest-path fuzz/Cargo.toml --target-dir target/fuzz --target "$host"
programs=target/fuzz/$host/release

mkdir -p out/fuzz/findings
# Readers that take a path find their file here, in memory where the system has such a folder.
TMPDIR=$(if [ -d /dev/shm ]; then mktemp -d -p /dev/shm; else mktemp -d; fi)
export TMPDIR
trap 'rm -rf "$TMPDIR"' EXIT
# The words of a case file.
words=out/fuzz/words.dict
grep -o '`[][A-Za-z_0-9"-]*`' docs/case.md | tr -d '`[]"' | grep . | sort -u | sed 's/.*/"&"/' > "$words"

attack() { # TARGET: for so many seconds
    local target=$1 log=out/fuzz/$1.log dictionary=() longest=8192 runs edges found line ended=0
    mkdir -p "out/fuzz/$target" "fuzz/seeds/$target"
    case $target in
        cases | joints) dictionary=(-dict="$words") ;;
        fields) longest=32768 ;; # HDF5
    esac
    # Nobody else writes into the folder of its inputs: it need not be looked at every second.
    "$programs/$target" -max_total_time="$seconds" -timeout=60 -rss_limit_mb=1024 -malloc_limit_mb=512 -max_len="$longest" -reload=0 \
        "${dictionary[@]}" -artifact_prefix="out/fuzz/findings/$target-" -print_final_stats=1 "out/fuzz/$target" "fuzz/seeds/$target" \
        > "$log" 2>&1 || ended=1
    # Every run keeps its line: the sum of the executions is the record.
    runs=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")
    edges=$(grep -o 'cov: [0-9]*' "$log" | tail -1)
    found=$(grep -c 'Test unit written' "$log" || true)
    line="$target: ${runs:-0} executions in $seconds s, ${edges:-cov: 0} edges, $found findings"
    echo "$line"
    echo "$(date -u +%FT%TZ) $line" >> out/fuzz/log.txt
    return $ended
}

# One on each core.
failed=0
for target in "${targets[@]}"; do
    while [ "$(jobs -rp | wc -l)" -ge "$(nproc)" ]; do
        wait -n || failed=1
    done
    attack "$target" &
done
while [ -n "$(jobs -p)" ]; do
    wait -n || failed=1
done
exit $failed
