#!/usr/bin/env bash
# What a release consists of, in out/release: archives of the program, wheels, bills of materials, notes, checksums.
#
#     scripts/release.sh [--program FILE] [PART...]
#
# Without a part all of them, in this order; they can be tried one by one:
#     linux     the program for Linux, x86-64 and aarch64, glibc 2.28 and newer, linked by zig
#     windows   quadrille.exe, as scripts/windows.sh makes it
#     wheels    of Python 3.11 and newer, for the same two of Linux; that of this machine is tested
#     archive   of FILE, a program for this machine that is built already
#     sbom      what is in the program and in the wheel (CycloneDX)
#     notes     of this version, out of CHANGELOG.md
#     sums      SHA256SUMS of all that is there
set -euo pipefail
cd "$(dirname "$0")/.."

program=
[ "${1:-}" != --program ] || { program=$(realpath "$2"); shift 2; }
parts=("$@")
[ ${#parts[@]} -gt 0 ] || parts=(linux windows wheels sbom notes sums)
version=$(sed -n '/^\[workspace.package\]/,/^\[/s/^version = "\(.*\)"/\1/p' Cargo.toml)
out=$PWD/out/release
tools=$PWD/out/release-tools
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
host=$(rustc -vV | sed -n 's/^host: //p')
mkdir -p "$out"

tools() { # zig, and what links with it
    [ -x "$tools/bin/cargo-zigbuild" ] || python3 -m venv "$tools"
    "$tools/bin/python" -m pip install --quiet --disable-pip-version-check cargo-zigbuild 'maturin[zig]>=1.9,<2'
    export PATH=$tools/bin:$PATH
    rustup target add x86_64-unknown-linux-gnu aarch64-unknown-linux-gnu
}
pack() { # TARGET FILE: the archive that `cargo binstall` looks for; the same bytes for the same files
    local name=quadrille-$version-$1 folder
    folder=$(mktemp -d)
    mkdir "$folder/$name"
    cp "$2" README.md CHANGELOG.md LICENSE-MIT LICENSE-APACHE "$folder/$name"
    cp src/cli/third_party.txt "$folder/$name/THIRD_PARTY.txt"
    tar --sort=name --owner=0 --group=0 --numeric-owner --mtime="@$(git log -1 --format=%ct)" -C "$folder" -c "$name" | gzip -n9 > "$out/$name.tar.gz"
    rm -r "${folder:?}/$name"
    if [ "$1" = "$host" ]; then
        tar xzf "$out/$name.tar.gz" -C "$folder"
        [ "$("$folder/$name/quadrille" --version)" = "quadrille $version" ] || { echo "release: $name: is not $version" >&2; exit 1; }
    fi
    rm -r "$folder"
    echo "release: $name.tar.gz, $(($(stat -c %s "$out/$name.tar.gz") / 1048576)) MiB"
}

linux() {
    tools
    for arch in x86_64 aarch64; do
        cargo zigbuild --release --locked --bin quadrille --target "$arch-unknown-linux-gnu.2.28"
        pack "$arch-unknown-linux-gnu" "$target/$arch-unknown-linux-gnu/release/quadrille"
    done
}
windows() {
    scripts/windows.sh
    pack x86_64-pc-windows-gnu "$target/x86_64-pc-windows-gnu/release/quadrille.exe"
}
wheels() {
    scripts/wheel.sh --zig
    cp out/wheel/quadrille-*.whl "$out"
    tools
    (cd python && maturin build --release --locked --zig --compatibility manylinux_2_28 --target aarch64-unknown-linux-gnu --out "$out")
}
archive() {
    [ -n "$program" ] || { echo "release: archive: --program FILE is missing" >&2; exit 2; }
    pack "$host" "$program"
}
sbom() {
    scripts/sbom.py > "$out/quadrille-$version.cdx.json"
    scripts/sbom.py quadrille-python > "$out/quadrille-python-$version.cdx.json"
    echo "release: $(grep -c '"type": "library"' "$out/quadrille-$version.cdx.json") components in the program"
}
notes() {
    awk -v v="$version" '/^## / { on = $2 == v } on' CHANGELOG.md > "$out/NOTES.md"
    [ -s "$out/NOTES.md" ] || { echo "release: CHANGELOG.md says nothing of $version" >&2; exit 1; }
    ! grep -q unreleased "$out/NOTES.md" || echo "release: before a release: CHANGELOG.md gives $version no date" >&2
}
sums() {
    cd "$out"
    rm -f SHA256SUMS
    sha256sum -- * > SHA256SUMS
    sha256sum --check --quiet SHA256SUMS
    cat SHA256SUMS
}

for part in "${parts[@]}"; do
    case $part in
        linux | windows | wheels | archive | sbom | notes | sums) ;;
        *) echo "release: there is no part '$part'" >&2; exit 2 ;;
    esac
    echo "== $part"
    ("$part")
done
