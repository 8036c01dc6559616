#!/usr/bin/env python3
"""Builds the book of docs/ into out/book with mdBook: `make book`.

mdBook also calls this file as its preprocessor (book.toml). Then it turns
  - formulas between $ into MathML, which browsers draw without a script or a network;
  - links to files outside docs/ into links to pages of the book: README, CONTRIBUTING and the like become chapters at its
    end, and source files become pages with numbered lines. A link to `file.rs#name` leads to the line that defines `name`.

Needs mdBook and latex2mathml (scripts/requirements.txt; `scripts/prepare.sh --python` installs them into .venv).
"""

import html
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path, PurePosixPath

ROOT = Path(__file__).resolve().parent.parent
BOOK = ROOT / "out" / "book"
# Pages outside docs/ that become chapters, with the place they get in the book.
ABOUT = {
    "README.md": ("README", "project/readme.md"),
    "CHANGELOG.md": ("What changed", "project/changelog.md"),
    "ARCHITECTURE.md": ("Architecture", "project/architecture.md"),
    "CONTRIBUTING.md": ("Working on quadrille", "project/contributing.md"),
    "benches/RESULTS.md": ("Speed and accuracy: figures", "project/results.md"),
}
# Notebooks become chapters, too: with what their cells show where they were run (make wheel WHEEL=--all).
NOTEBOOKS = sorted(path.relative_to(ROOT).as_posix() for path in ROOT.glob("python/notebooks/*.ipynb"))
LINK = re.compile(r"\]\(([^()\s]+)\)")
# Code is left alone: a fence, or a span of it.
CODE = re.compile(r"(^[ ]*```.*?^[ ]*```[ ]*$|`[^`\n]+`)", re.M | re.S)
FORMULA = re.compile(r"\$\$(.+?)\$\$|(?<![\\\w$])\$(?=\S)((?:[^$\\\n]|\\.|\n(?!\n))+?)(?<=\S)\$(?!\w)", re.S)


def definition(name):
    """What defines `name` in Rust or WGSL, at the beginning of a line."""
    kinds = "fn|struct|enum|trait|const|static|type|mod|macro_rules!"
    words = r"(?:pub(?:\([^)]*\))?\s+|unsafe\s+|const\s+|async\s+)*"
    return re.compile(rf"^\s*{words}(?:{kinds})\s+{re.escape(name)}\b")


def line_of(path, name):
    """The number of the line of `path` that defines `name`, or None."""
    pattern = definition(name)
    lines = path.read_text(encoding="utf-8").splitlines()
    return next((number for number, line in enumerate(lines, 1) if pattern.match(line)), None)


def relative(target, page):
    return os.path.relpath(target, PurePosixPath(page).parent).replace(os.sep, "/")


def moved(link, source, page):
    """The link of the file `source` (from the root), as it must be on `page` of the book."""
    if "://" in link or link.startswith(("#", "mailto:")):
        return link
    name, _, at = link.partition("#")
    target = os.path.normpath(PurePosixPath(source).parent / name).replace(os.sep, "/")
    anchor = f"#{at}" if at else ""
    if target in ABOUT:
        return relative(ABOUT[target][1], page) + anchor
    if target.startswith("docs/"):
        # mdBook makes the index of a folder of its README.
        inside = re.sub(r"(^|/)README\.md$", r"\1index.md", target.removeprefix("docs/"))
        return relative(inside, page) + anchor
    if target in NOTEBOOKS:
        return relative(notebook_page(target), page) + anchor
    path = ROOT / target
    if path.is_dir():
        return relative("project/architecture.md", page) + "#the-rooms"
    if at and (line := line_of(path, at)):
        anchor = f"#L{line}"
    # The end keeps mdBook from taking it for a chapter.
    return relative(f"source/{target}.html", page) + anchor


def mathml(tex, block):
    from latex2mathml.converter import convert

    # The converter knows brackets that grow by themselves, and no others.
    tex = re.sub(r"\\[bB]ig+([lr])\b", lambda side: r"\left" if side[1] == "l" else r"\right", tex)
    made = convert(re.sub(r"\s+", " ", tex.strip()), display="block" if block else "inline")
    # Markdown reads it again: nothing in it may look like emphasis or a link.
    return made.replace("*", "&#42;").replace("_", "&#95;").replace("[", "&#91;").replace("\\", "&#92;")


def formulas(text):
    def made(match):
        block, inline = match.groups()
        return mathml(block or inline, bool(block))

    return FORMULA.sub(made, text)


def turned(text, source, page):
    """The text of a page as mdBook takes it."""
    parts = CODE.split(text)
    for k in range(0, len(parts), 2):
        parts[k] = LINK.sub(lambda found: f"]({moved(found[1], source, page)})", parts[k])
    text = "".join(parts)
    parts = CODE.split(text)
    for k in range(0, len(parts), 2):
        parts[k] = formulas(parts[k])
    return "".join(parts)


def notebook_page(source):
    return f"notebooks/{PurePosixPath(source).stem}.md"


def shown(output):
    """An output of a cell, as Markdown."""
    data = {kind: "".join(text) for kind, text in output.get("data", {}).items()}
    if "image/png" in data:
        return f'<img alt="" src="data:image/png;base64,{"".join(data["image/png"].split())}">'
    text = "".join(output.get("text", "")) if output.get("name") != "stderr" else ""
    text = text or data.get("text/plain", "")
    return f"```text\n{text.rstrip()}\n```" if text.strip() else ""


def notebook(source):
    """The name of a notebook and its text: that of the copy that was run, where there is one."""
    path, stem = ROOT / source, PurePosixPath(source).stem
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    ran = ROOT / "out" / "notebooks" / stem / f"{stem}.ipynb"
    if ran.exists():
        done = json.loads(ran.read_text(encoding="utf-8"))["cells"]
        # One that was changed since is shown without.
        cells = done if [cell["source"] for cell in done] == [cell["source"] for cell in cells] else cells
    parts = []
    for cell in cells:
        text = "".join(cell["source"])
        if cell["cell_type"] == "code":
            parts += [f"```python\n{text}\n```", *filter(None, map(shown, cell["outputs"]))]
        else:
            parts.append(text)
    parts.insert(1, f"`{source}`, to be run with `pip install 'quadrille[all]'`.")
    return parts[0].splitlines()[0].lstrip("# "), "\n\n".join(parts)


def preprocess():
    _, book = json.load(sys.stdin)
    items = book.get("items") or book["sections"]

    def walk(items):
        for item in items:
            chapter = item.get("Chapter") if isinstance(item, dict) else None
            if chapter:
                if chapter.get("path"):
                    # The path where the file is, not the one where mdBook puts it (README.md is index.html).
                    source = chapter.get("source_path") or chapter["path"]
                    chapter["content"] = turned(chapter["content"], f"docs/{source}", chapter["path"])
                walk(chapter["sub_items"])

    walk(items)

    def add(name, text, source, page):
        items.append({
            "Chapter": {
                "name": name, "content": turned(text, source, page), "number": None, "sub_items": [], "path": page, "source_path": page,
                "parent_names": [],
            }
        })

    items.append({"PartTitle": "Notebooks"})
    for source in NOTEBOOKS:
        add(*notebook(source), source, notebook_page(source))
    items.append({"PartTitle": "The project"})
    for source, (name, page) in ABOUT.items():
        add(name, (ROOT / source).read_text(encoding="utf-8"), source, page)
    json.dump(book, sys.stdout)


def source_pages():
    """A page with numbered lines for every source file that the book links to."""
    wanted = set()
    for page in BOOK.rglob("*.html"):
        for link in re.findall(r'href="([^"#]+)', page.read_text(encoding="utf-8")):
            target = os.path.normpath(page.parent / link)
            inside = os.path.relpath(target, BOOK).replace(os.sep, "/")
            if "://" not in link and inside.startswith("source/"):
                wanted.add(inside.removeprefix("source/").removesuffix(".html"))
    for name in sorted(wanted):
        lines = (ROOT / name).read_text(encoding="utf-8").splitlines()
        rows = "\n".join(
            f'<span id="L{number}"><a href="#L{number}">{number:5}</a> {html.escape(line)}</span>'
            for number, line in enumerate(lines, 1)
        )
        page = BOOK / "source" / f"{name}.html"
        page.parent.mkdir(parents=True, exist_ok=True)
        page.write_text(
            f"<!doctype html><html lang=en><meta charset=utf-8><title>{html.escape(name)}</title>"
            "<meta name=viewport content='width=device-width'><style>body{font:13px/1.45 monospace;margin:1em}"
            "pre{overflow-x:auto}a{color:#999;text-decoration:none}span:target{background:#ffec99}</style>"
            f"<h1>{html.escape(name)}</h1><pre>{rows}</pre></html>\n",
            encoding="utf-8",
        )
    return len(wanted)


def dead_links():
    """Links of the built book that lead nowhere."""
    dead = []
    for page in BOOK.rglob("*.html"):
        if page.name in ("print.html", "404.html", "toc.html"):  # all pages once more, from another folder
            continue
        for link in re.findall(r'(?:href|src)="([^"#]+)', page.read_text(encoding="utf-8")):
            link = html.unescape(link)
            if "://" in link or link.startswith(("mailto:", "data:")):
                continue
            if not (page.parent / link).exists():
                dead.append(f"{page.relative_to(BOOK)}: {link}")
    return dead


def build():
    mdbook = shutil.which("mdbook", path=f"{ROOT / '.venv' / 'bin'}{os.pathsep}{os.environ.get('PATH', '')}")
    if mdbook is None:
        sys.exit("book: mdbook is missing; run scripts/prepare.sh --python")
    # This Python is the one that has latex2mathml.
    own = {"MDBOOK_PREPROCESSOR__QUADRILLE__COMMAND": f"{sys.executable} {__file__}"}
    shutil.rmtree(BOOK, ignore_errors=True)
    subprocess.run([mdbook, "build", str(ROOT)], check=True, env=os.environ | own)
    n_sources = source_pages()
    if dead := dead_links():
        sys.exit("book: links that lead nowhere:\n  " + "\n  ".join(dead))
    size = sum(path.stat().st_size for path in BOOK.rglob("*") if path.is_file())
    print(f"book: {BOOK / 'index.html'}: {n_sources} pages of source, {size / 2**20:.1f} MiB")


if __name__ == "__main__":
    if sys.argv[1:2] == ["supports"]:
        sys.exit(0)
    elif sys.stdin.isatty() or sys.argv[1:2] == ["build"]:
        build()
    else:
        preprocess()
