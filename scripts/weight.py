#!/usr/bin/env python3
"""What has to be carried: lines, words, names, commands. A table for the state of the checkout (no build; commands are counted in the
documents).

    scripts/weight.py [ROOT]
"""
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).resolve().parent.parent)
IRREGULAR = set("told found said made given taken seen known written held kept left lost meant sent shown begun drawn chosen".split())


def files(*patterns):
    listed = subprocess.run(["git", "-C", ROOT, "ls-files", *patterns], capture_output=True, text=True, check=True)
    return [ROOT / name for name in listed.stdout.split()]


def text(*patterns):
    return "\n".join(path.read_text() for path in files(*patterns) if path.exists())


def words(page):
    """Words and numbers; the bars and dashes of tables are none."""
    return sum(bool(re.search(r"\w", part)) for part in page.split())


def sentence(page):
    """Mean words of a sentence: prose and items of lists, no tables, code and formulas."""
    page = re.sub(r"```.*?```|\$\$.*?\$\$", "", page, flags=re.S)
    lines = [line for line in page.splitlines() if not line.lstrip().startswith(("|", "#", "!"))]
    prose = re.sub(r"`[^`]*`|\$[^$]*\$", "x", "\n".join(lines))
    parts = [part for part in re.split(r"[.!?](?=\s)|\n\s*\n|\n\s*[-*] ", prose) if len(part.split()) > 2]
    return sum(len(part.split()) for part in parts) / max(len(parts), 1)


def main():
    rust = text("src/*.rs", "crates/*.rs")
    names = re.findall(r"\bfn ([a-z]+)\s*[<(]", rust)
    bare = [name for name in names if name in IRREGULAR or (name.endswith("ed") and len(name) > 4)]
    commands = text("docs/commands.md")
    rooms = [path for path in files("src/*.rs", "crates/*.rs")]
    flat = {}
    for path in rooms:
        flat[path.parent] = flat.get(path.parent, 0) + 1
    most = max(flat, key=flat.get)
    rows = [
        ("lines of src and crates", rust.count("\n")),
        ("lines of tests", text("tests/*.rs").count("\n")),
        ("lines beside the product (web, miri)", text("web", "miri/src").count("\n")),
        ("most files side by side", f"{flat[most]} in {most.relative_to(ROOT)}"),
        ("functions named by a bare participle", len(bare)),
        ('"warning: " in texts of the source', len(re.findall(r'"warning: ', rust))),
        ("commands", len(re.findall(r"^\| \[`quadrille ", commands, flags=re.M))),
        ("lines of code or comment above 120 columns", sum(len(line) > 120 for line in rust.splitlines())),
        ("words of docs", words(text("docs/*.md", "docs/**/*.md"))),
        ("words of benches/RESULTS.md", words(text("benches/RESULTS.md"))),
        ("words of CHANGELOG.md", words(text("CHANGELOG.md"))),
    ]
    for page in ["CHANGELOG.md", "benches/RESULTS.md", "docs/identification.md", "docs/correlation.md"]:
        rows.append((f"words of a sentence, {page}", f"{sentence(text(page)):.0f}"))
    for name, value in rows:
        print(f"| {name} | {value} |")


main()
