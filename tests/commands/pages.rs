//! The pages of the documentation hold together: links lead somewhere, chapters that the source names are there, and
//! commands name tests and scripts that there are.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

pub fn root() -> PathBuf {
    env!("CARGO_MANIFEST_DIR").into()
}

/// README, ARCHITECTURE, CONTRIBUTING, RESULTS and all of `docs/`, with their texts.
pub fn pages() -> Vec<(PathBuf, String)> {
    let of_root = ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "benches/RESULTS.md"];
    let mut paths: Vec<PathBuf> = of_root.iter().map(|name| root().join(name)).collect();
    files(&root().join("docs"), &["md"], &mut paths);
    paths.sort();
    paths.into_iter().map(|path| (path.clone(), fs::read_to_string(path).unwrap())).collect()
}

/// Lines that are not between fences.
pub fn prose(text: &str) -> impl Iterator<Item = &str> {
    let mut code = false;
    text.lines().filter(move |line| {
        let fence = line.trim_start().starts_with("```");
        code ^= fence;
        !code && !fence
    })
}

/// What a heading is called in links, as GitHub does it.
fn anchor(heading: &str) -> String {
    let kept = heading.chars().filter(|c| c.is_alphanumeric() || "-_ ".contains(*c));
    kept.flat_map(char::to_lowercase).map(|c| if c == ' ' { '-' } else { c }).collect()
}

fn anchors(text: &str) -> BTreeSet<String> {
    let headings = prose(text).filter(|line| line.starts_with('#'));
    headings.map(|line| anchor(line.trim_start_matches('#').trim())).collect()
}

/// The targets of the links and pictures of a page.
fn links(text: &str) -> Vec<String> {
    let lines: Vec<&str> = prose(text).collect();
    lines.join(" ").split("](").skip(1).filter_map(|rest| Some(rest.split_once(')')?.0.trim().to_owned())).collect()
}

#[test]
fn every_link_leads_to_a_file_and_a_heading_that_there_are() {
    let mut wrong = Vec::new();
    for (path, text) in pages() {
        for link in links(&text).into_iter().filter(|link| !link.contains("://") && !link.contains(' ')) {
            let (file, heading) = link.split_once('#').map_or((link.as_str(), None), |(file, at)| (file, Some(at)));
            let target = if file.is_empty() { path.clone() } else { path.parent().unwrap().join(file) };
            let source = target.extension().is_some_and(|ending| ending == "rs");
            let found = match (heading, fs::read_to_string(&target)) {
                (None, _) => target.exists(),
                (Some(name), Ok(text)) if source => defines(&text, name),
                (Some(heading), Ok(text)) => anchors(&text).contains(heading),
                (Some(_), Err(_)) => false,
            };
            if !found {
                wrong.push(format!("{}: {link}", path.strip_prefix(root()).unwrap().display()));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// Whether a line of the source `text` defines the item `name`, to which a link `file.rs#name` leads (scripts/book.py).
fn defines(text: &str, name: &str) -> bool {
    let kinds = ["fn", "struct", "enum", "trait", "const", "static", "type", "mod", "macro_rules!"];
    text.lines().any(|line| {
        let words: Vec<&str> = line.split_whitespace().collect();
        let kind = words.iter().position(|word| kinds.contains(word) && *word != "const").or_else(|| {
            // `const fn name` is a function, `const NAME` a constant.
            words.iter().position(|word| *word == "const")
        });
        let item = kind
            .and_then(|at| words.get(at + 1))
            .map(|word| word.split(|c: char| !(c.is_alphanumeric() || c == '_')).next());
        let begins = kind.is_some_and(|at| {
            words[..at].iter().all(|word| {
                word.starts_with("pub") || ["unsafe", "const", "async", "in"].contains(word) || word.ends_with(')')
            })
        });
        begins && item == Some(Some(name))
    })
}

/// The files under `folder` with one of the `endings`.
pub fn files(folder: &Path, endings: &[&str], found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        let wanted = |path: &Path| path.extension().is_some_and(|end| endings.iter().any(|ending| end == *ending));
        match entry.is_dir() {
            true => files(&entry, endings, found),
            false if wanted(&entry) => found.push(entry),
            false => {}
        }
    }
}

#[test]
fn every_chapter_of_the_theory_that_the_source_names_is_there() {
    let mut there = BTreeSet::new();
    let mut chapters = Vec::new();
    files(&root().join("docs/theory"), &["md"], &mut chapters);
    for chapter in chapters.iter().filter(|chapter| !chapter.ends_with("README.md")) {
        // `07-noise.md` begins with `# 7. ` and says where the source computes it.
        let text = fs::read_to_string(chapter).unwrap();
        let number: u32 = text.strip_prefix("# ").and_then(|rest| rest.split_once('.')).unwrap().0.parse().unwrap();
        let name = chapter.file_name().unwrap().to_str().unwrap();
        assert!(name.starts_with(&format!("{number:02}-")), "{name} is chapter {number}");
        let in_source =
            ["](../../crates/", "](../../src/", "](../../benches/"].iter().any(|place| text.contains(place));
        assert!(in_source, "{name} names no place in the source");
        assert!(there.insert(number), "chapter {number} is there twice");
    }
    let mut sources = Vec::new();
    for folder in ["src", "crates", "shaders", "tests", "benches"] {
        files(&root().join(folder), &["rs", "wgsl"], &mut sources);
    }
    let (mut named, mut wrong) = (0, Vec::new());
    for file in sources.iter().filter(|file| !file.ends_with("pages.rs")) {
        let text = fs::read_to_string(file).unwrap();
        for (at, _) in text.match_indices("THEORY ") {
            // `THEORY 7, 11`, `THEORY 6 and 7`: the numbers that follow.
            let rest = text[at + "THEORY ".len()..]
                .split(|c: char| !(c.is_ascii_digit() || ", and".contains(c)))
                .next()
                .unwrap();
            for number in rest.split(|c: char| !c.is_ascii_digit()).filter_map(|word| word.parse::<u32>().ok()) {
                named += 1;
                if !there.contains(&number) {
                    wrong.push(format!("{}: THEORY {number}", file.strip_prefix(root()).unwrap().display()));
                }
            }
        }
    }
    assert!(named > 50, "{named}");
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn commands_in_the_pages_name_tests_and_scripts_that_there_are() {
    let mut wrong = Vec::new();
    for (path, text) in pages() {
        let words: Vec<&str> = text.split_whitespace().collect();
        for (k, pair) in words.windows(2).enumerate() {
            let name = pair[1].trim_matches(|c: char| !c.is_alphanumeric() && c != '_');
            let of_cargo = words[k.saturating_sub(6)..k].iter().any(|word| word.ends_with("cargo"));
            let there = |place: &str| {
                let place = root().join(place).join(name);
                place.with_extension("rs").exists() || place.join("main.rs").exists()
            };
            let missing = match pair[0] {
                "--test" if of_cargo => !there("tests"),
                "--bench" if of_cargo => !there("benches/testbed/benches"),
                "--example" if of_cargo => !there("examples"),
                _ => false,
            };
            if missing {
                wrong.push(format!("{}: {} {}", path.strip_prefix(root()).unwrap().display(), pair[0], pair[1]));
            }
        }
        for word in text.split(|c: char| c.is_whitespace() || "`()[]".contains(c)) {
            let word = word.trim_end_matches(['.', ',', ';', ':']);
            if word.starts_with("scripts/") && word.contains('.') && !root().join(word).exists() {
                wrong.push(format!("{}: {word}", path.strip_prefix(root()).unwrap().display()));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}
