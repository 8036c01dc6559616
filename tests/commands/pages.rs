//! The pages of the documentation hold together: links lead somewhere, chapters that the source names are there, and commands name
//! tests and scripts that there are.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    env!("CARGO_MANIFEST_DIR").into()
}

/// README, CONTRIBUTING and all of `docs/`, with their texts.
fn pages() -> Vec<(PathBuf, String)> {
    let mut paths = vec![root().join("README.md"), root().join("CONTRIBUTING.md"), root().join("benches/RESULTS.md")];
    paths.extend(fs::read_dir(root().join("docs")).unwrap().map(|entry| entry.unwrap().path()));
    paths.retain(|path| path.extension().is_some_and(|ending| ending == "md"));
    paths.sort();
    paths.into_iter().map(|path| (path.clone(), fs::read_to_string(path).unwrap())).collect()
}

/// Lines that are not between fences.
fn prose(text: &str) -> impl Iterator<Item = &str> {
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
            let found = match (heading, fs::read_to_string(&target)) {
                (None, _) => target.exists(),
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

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        match entry.is_dir() {
            true => sources(&entry, found),
            false if entry.extension().is_some_and(|ending| ending == "rs" || ending == "wgsl") => found.push(entry),
            false => {}
        }
    }
}

#[test]
fn every_chapter_of_the_theory_that_the_source_names_is_there() {
    let theory = fs::read_to_string(root().join("docs/theory.md")).unwrap();
    let there: BTreeSet<u32> =
        (theory.lines().filter_map(|line| line.strip_prefix("## ")?.split_once('.')?.0.parse().ok())).collect();
    let mut files = Vec::new();
    for folder in ["src", "shaders", "tests", "benches"] {
        sources(&root().join(folder), &mut files);
    }
    let (mut named, mut wrong) = (0, Vec::new());
    for file in files.iter().filter(|file| !file.ends_with("pages.rs")) {
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
                "--bench" if of_cargo => !there("benches"),
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
