#!/usr/bin/env python3
"""Writes the notices of third parties that the program prints with `quadrille about licences`: of every crate in it, on any system,
its version, its licence and who holds the copyright; and each text of a licence once. Those of the module of Python beside them, which
its wheel holds with the former, are in python/THIRD_PARTY.txt.

    scripts/licences.py            writes src/cli/third_party.txt and python/THIRD_PARTY.txt
    scripts/licences.py --check    says whether they are what it would write (CI)
"""

import json
import re
import struct
import subprocess
import sys
import textwrap
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
NOTICES = ROOT / "src/cli/third_party.txt"
OF_PYTHON = ROOT / "python/THIRD_PARTY.txt"
CARGO = ["cargo"]
# Of licences to choose from the first of these is taken.
PREFERRED = ["MIT", "Zlib", "BSD-2-Clause", "BSD-3-Clause", "ISC", "BSL-1.0", "Unlicense", "Unicode-3.0", "0BSD", "Apache-2.0"]
# How the file of a licence is called, for crates that have several.
FILES = {
    "MIT": r"mit|^license(\.\w+)?$|^licence(\.\w+)?$",
    "Apache-2.0": r"apache|^license(\.\w+)?$",
    "Zlib": r"zlib|^license(\.\w+)?$",
    "Unlicense": r"unlicense|^license(\.\w+)?$",
    "BSL-1.0": r"boost|bsl|^license(\.\w+)?$",
}
ANY_FILE = re.compile(r"^(licen[cs]e|copying|copyright|notice|unlicense|ofl)", re.IGNORECASE)
HOLDER = re.compile(r"^\s*(?:[*#/;-]+\s*)?((?:copyright|\(c\)|©).*\d{4}.*|copyright (?:\(c\)|©).*|copyright \S.*(?:contributors|authors|developers|project).*)$", re.IGNORECASE)


def command(*words: str) -> str:
    return subprocess.run([*CARGO, *words], cwd=ROOT, check=True, capture_output=True, text=True).stdout


def crates(package: str) -> list[dict]:
    """The crates in a package: dependencies of any system that are neither macros nor of builds and tests."""
    tree = command("tree", "--locked", "--package", package, "--all-features", "--target", "all", "--edges", "normal,no-proc-macro",
                   "--prefix", "none", "--format", "{p}")
    there = {tuple(line.split()[:2]) for line in tree.splitlines() if line.strip()}
    packages = json.loads(command("metadata", "--locked", "--all-features", "--format-version", "1"))["packages"]
    found = [p for p in packages if (p["name"], f"v{p['version']}") in there and not p["name"].startswith("quadrille")]
    return sorted(found, key=lambda p: (p["name"], [int(n) for n in re.findall(r"\d+", p["version"])]))


def chosen(expression: str) -> list[str]:
    """The licences that are taken of an expression: of alternatives the preferred one, of several all."""
    taken = []
    for part in re.split(r"\s+AND\s+", expression.replace("(", "").replace(")", "")):
        options = [option.strip() for option in re.split(r"\s+OR\s+|/", part)]
        taken.append(min(options, key=lambda option: PREFERRED.index(option) if option in PREFERRED else 99))
    return taken


def texts(folder: Path, licences: list[str]) -> list[str]:
    """The texts of the files of a crate that belong to the licences."""
    files = sorted(path for path in folder.iterdir() if path.is_file() and ANY_FILE.match(path.name))
    wanted = []
    for licence in licences:
        pattern = re.compile(FILES.get(licence, "."), re.IGNORECASE)
        of = [path for path in files if pattern.search(path.name)] or files
        # A plain LICENSE beside LICENSE-MIT only points to it.
        exact = [path for path in of if not re.match(r"^licen[cs]e(\.\w+)?$", path.name, re.IGNORECASE)]
        wanted += exact or of
    notices = [path for path in files if path.name.lower().startswith("notice")]
    # What some crates bring from elsewhere: a library in C, fonts.
    bundled = [folder / "zstd/LICENSE"] if (folder / "zstd/LICENSE").is_file() else []
    fonts = sorted(folder.glob("**/DejaVuSans.ttf"))
    read = [path.read_text(encoding="utf-8", errors="replace") for path in dict.fromkeys(wanted + notices + bundled)]
    return read + [licence_of_font(path) for path in fonts]


def licence_of_font(path: Path) -> str:
    """Copyright, licence and address of it, as the table of names of a TrueType font has them."""
    font = path.read_bytes()
    (n_tables,) = struct.unpack_from(">H", font, 4)
    tables = {font[12 + 16 * k : 16 + 16 * k]: struct.unpack_from(">II", font, 20 + 16 * k) for k in range(n_tables)}
    start, _ = tables[b"name"]
    _, count, strings = struct.unpack_from(">HHH", font, start)
    names = {}
    for k in range(count):
        platform, _, _, name, length, at = struct.unpack_from(">6H", font, start + 6 + 12 * k)
        if platform == 3:
            begin = start + strings + at
            names[name] = font[begin : begin + length].decode("utf-16-be")
    paragraphs = [textwrap.fill(line, 100) for name in (0, 13, 14) for line in names.get(name, "").splitlines()]
    return "\n".join([f"The font {path.stem}", "", *paragraphs])


def split(text: str) -> tuple[list[str], str]:
    """The lines that say who holds the copyright, and the rest, whose lines do not matter."""
    holders, rest = [], []
    for line in text.replace("\r", "").splitlines():
        match = HOLDER.match(line)
        # In the middle of a sentence of the licence it is none.
        if match and not re.search(r"copyright (notice|holder|owner|license|statement|and)", line, re.IGNORECASE):
            holders.append(" ".join(match.group(1).split()))
        else:
            rest.append(line.rstrip())
    return holders, "\n".join(rest).strip("\n")


def notices(first: str, packages: list[dict]) -> str:
    bodies: dict[str, str] = {}  # normalised text -> as it stands, without who holds the copyright
    whole: dict[str, str] = {}  # the same with it
    users: dict[str, list[str]] = {}
    without: list[str] = []
    lines = []
    for package in packages:
        name = f"{package['name']} {package['version']}"
        expression = package["license"] or "see its text"
        holders: list[str] = []
        of = texts(Path(package["manifest_path"]).parent, chosen(expression))
        for text in of:
            held, body = split(text)
            holders += held
            key = re.sub(r"[^a-z0-9]+", " ", body.lower()).strip()
            key = re.sub(r"^(the )?(mit license|mit)( mit)?( all rights reserved)? ", "", key)
            bodies.setdefault(key, body)
            whole.setdefault(key, "\n".join(line.rstrip() for line in text.replace("\r", "").splitlines()).strip("\n"))
            users.setdefault(key, []).append(name)
        if not of:
            without.append(name)
        if not holders:
            authors = ", ".join(re.sub(r"\s*<[^>]*>", "", author) for author in package["authors"])
            holders = [f"Copyright {authors}" if authors else f"Copyright the authors of {package['name']}"]
        lines.append(f"{name}: {expression}")
        lines += [f"    {holder}" for holder in dict.fromkeys(holders)]
    keys = sorted(users, key=lambda key: (-len(users[key]), users[key]))
    out = [
        first,
        "Of licences to choose from, MIT is taken where it is one. The texts follow, each once, with the crates that have it.",
        "",
        *lines,
    ]
    for number, key in enumerate(keys, 1):
        out += ["", "=" * 100, f"Text {number}, of: {', '.join(dict.fromkeys(users[key]))}", "=" * 100, "", bodies[key] if len(set(users[key])) > 1 else whole[key]]
    if without:
        out += ["", "=" * 100, f"Without a text of their own (under the licence named above): {', '.join(without)}", "=" * 100]
    return "\n".join(line.rstrip() for line in "\n".join(out).splitlines()) + "\n"


def main() -> int:
    of_program = crates("quadrille")
    of_python = [package for package in crates("quadrille-python") if package not in of_program]
    listed = "in the crates that are listed here with their licences and who holds the copyright."
    texts_of = {
        NOTICES: notices(f"quadrille contains the work of others, {listed}", of_program),
        OF_PYTHON: notices(
            "The Python module of quadrille contains the work of others, that which `quadrille about licences` prints and beside it that\n"
            f"{listed}", of_python),
    }
    wrong = 0
    for path, text in texts_of.items():
        if "--check" not in sys.argv[1:]:
            path.write_text(text, encoding="utf-8")
            print(f"{path.relative_to(ROOT)}: {len(text) / 1e3:.0f} kB")
        elif not path.is_file() or path.read_text(encoding="utf-8") != text:
            print(f"{path.relative_to(ROOT)} is not what it should be: run scripts/licences.py", file=sys.stderr)
            wrong = 1
    return wrong


if __name__ == "__main__":
    sys.exit(main())
