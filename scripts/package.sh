#!/usr/bin/env bash
# Packs the crates as crates.io would get them, looks at what is in the archives, and checks that they compile from that alone. Arguments (such
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
rm -f "$target"/package/quadrille*.crate
cargo package --locked --no-verify --workspace --exclude quadrille-python --exclude quadrille-testbed
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
patches=()
for crate in "$target"/package/quadrille*.crate; do
    name=$(basename "$crate" | sed 's/-[0-9][0-9.]*\.crate$//')
    mkdir "$folder/$name"
    tar xzf "$crate" -C "$folder/$name" --strip-components 1
    [ "$name" = quadrille ] || patches+=(--config "patch.crates-io.$name.path='$folder/$name'")
    echo "package: $(basename "$crate"), $(find "$folder/$name" -type f | wc -l) files, $(($(stat -c %s "$crate") / 1024)) KiB"
done

# All that is in them: sources, shaders, what documentation includes, licences with those of others, and what it is.
wanted='CHANGELOG.md CITATION.cff Cargo.lock Cargo.toml Cargo.toml.orig LICENSE-APACHE LICENSE-MIT README.md docs examples src .cargo_vcs_info.json'
for name in $(ls -A "$folder/quadrille"); do
    case " $wanted " in *" $name "*) ;; *) echo "package: $name is not to be in it" >&2; exit 1 ;; esac
done
for name in quadrille/LICENSE-MIT quadrille/LICENSE-APACHE quadrille/src/cli/third_party.txt quadrille-shaders/residual.wgsl; do
    [ -s "$folder/$name" ] || { echo "package: $name is missing" >&2; exit 1; }
done
CARGO_TARGET_DIR=$(realpath "$target") cargo check ${patches[@]+"${patches[@]}"} --manifest-path "$folder/quadrille/Cargo.toml" "$@"
