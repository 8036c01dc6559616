#!/usr/bin/env bash
# Packs the crate as crates.io would get it, looks at what is in the archive, and checks that it compiles from that alone. Arguments (such
# as --profile ci) go to `cargo check`, which shares the packages of this checkout. With --release as the first one what a release still
# needs is an error; else it is said (CONTRIBUTING.md, "How do I make a release?").
set -euo pipefail
cd "$(dirname "$0")/.."

release=no
[ "${1:-}" != --release ] || { release=yes; shift; }
needed=()
grep -q '^repository = "https://' Cargo.toml || needed+=('Cargo.toml has no `repository`, which `cargo binstall` takes the place of the archives from')
grep -q '^repository-code:' CITATION.cff || needed+=('CITATION.cff has no `repository-code`')
grep -q '^\[project.urls\]' python/pyproject.toml || needed+=('python/pyproject.toml has no `[project.urls]`')
for what in ${needed[@]+"${needed[@]}"}; do
    echo "package: before a release: $what" >&2
done
[ "$release" = no ] || [ ${#needed[@]} -eq 0 ] || exit 1

target=${CARGO_TARGET_DIR:-target}
cargo package --locked --no-verify --package quadrille
crate=$(ls -t "$target"/package/quadrille-*.crate | head -1)
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
tar xzf "$crate" -C "$folder" --strip-components 1

# All that is in it: sources, shaders, what documentation includes, licences with those of others, and what it is.
wanted='CHANGELOG.md CITATION.cff Cargo.lock Cargo.toml Cargo.toml.orig LICENSE-APACHE LICENSE-MIT README.md docs examples shaders src .cargo_vcs_info.json'
for name in $(ls -A "$folder"); do
    case " $wanted " in *" $name "*) ;; *) echo "package: $name is not to be in it" >&2; exit 1 ;; esac
done
for name in LICENSE-MIT LICENSE-APACHE src/cli/third_party.txt shaders/residual.wgsl; do
    [ -s "$folder/$name" ] || { echo "package: $name is missing" >&2; exit 1; }
done
CARGO_TARGET_DIR=$(realpath "$target") cargo check --locked --manifest-path "$folder/Cargo.toml" "$@"
echo "package: $(basename "$crate"), $(find "$folder" -type f | wc -l) files, $(($(stat -c %s "$crate") / 1024)) KiB"
