//! The book made of `docs/` (`make book`): its summary names every page, every command in it is one that the program
//! knows, the tutorials run as they stand, and the reference of commands is the one that the program writes.

#![cfg(feature = "cli")]

use crate::pages::{pages, root};
use crate::program::Desk;
use std::collections::BTreeSet;
use std::fs;

/// The words of a command line as a shell splits them; `None` where the line holds none.
fn words(line: &str) -> Option<Vec<String>> {
    let (mut words, mut word, mut quote) = (Vec::new(), None::<String>, None);
    for c in line.chars() {
        match (quote, c) {
            (Some(open), _) if open == c => quote = None,
            (Some(_), _) => word.get_or_insert_default().push(c),
            (None, '\'' | '"') => {
                quote = Some(c);
                word.get_or_insert_default();
            }
            (None, '#') if word.is_none() => break,
            (None, '|' | '>' | ';' | '&') => break,
            (None, _) if c.is_whitespace() => words.extend(word.take()),
            (None, _) => word.get_or_insert_default().push(c),
        }
    }
    assert!(quote.is_none(), "a quote is not closed: {line}");
    words.extend(word);
    (!words.is_empty()).then_some(words)
}

/// The blocks of a page between fences, each with what stands behind its first fence.
fn blocks(text: &str) -> Vec<(&str, String)> {
    let mut found: Vec<(&str, String)> = Vec::new();
    let mut inside = false;
    for line in text.lines() {
        match (line.trim_start().strip_prefix("```"), found.last_mut()) {
            (Some(_), _) if inside => inside = false,
            (Some(kind), _) => {
                inside = true;
                found.push((kind.trim(), String::new()));
            }
            (None, Some((_, block))) if inside => *block += &format!("{line}\n"),
            _ => {}
        }
    }
    found
}

/// The commands of a block, each as its words, all parts of `a && b`.
fn commands(block: &str) -> Vec<Vec<String>> {
    let whole = block.replace("\\\n", " ");
    whole.lines().flat_map(|line| line.split("&&")).filter_map(words).collect()
}

/// `line` when it starts the program, under whatever path, with its name alone in front.
fn of_program(mut line: Vec<String>) -> Option<Vec<String>> {
    let program = line.first_mut()?;
    let is_it = program == "quadrille" || program.ends_with("/quadrille");
    is_it.then(|| "quadrille".clone_into(program))?;
    Some(line)
}

#[test]
fn the_summary_names_every_page_once_and_no_other() {
    let docs = root().join("docs");
    let summary = fs::read_to_string(docs.join("SUMMARY.md")).unwrap();
    let named: Vec<&str> = summary.split("](").skip(1).map(|rest| rest.split_once(')').unwrap().0).collect();
    let once: BTreeSet<&str> = named.iter().copied().collect();
    assert_eq!(once.len(), named.len(), "a page is named twice in docs/SUMMARY.md");
    let there = pages().into_iter().filter_map(|(path, _)| {
        let inside = path.strip_prefix(&docs).ok()?.to_str().unwrap().replace('\\', "/");
        (inside != "SUMMARY.md").then_some(inside)
    });
    let there: BTreeSet<String> = there.collect();
    let there: BTreeSet<&str> = there.iter().map(String::as_str).collect();
    assert_eq!(once, there, "left: named in docs/SUMMARY.md; right: the pages that there are");
}

#[test]
fn names_of_pages_can_be_typed_and_every_page_has_one_title() {
    for (path, text) in pages() {
        let name = path.file_stem().unwrap().to_str().unwrap();
        let plain = name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-');
        let usual = ["README", "SUMMARY", "ARCHITECTURE", "CONTRIBUTING", "RESULTS", "CHANGELOG"].contains(&name);
        assert!(plain || usual, "{}: lower case and hyphens", path.display());
        assert!(text.starts_with("# "), "{}: begins without a title", path.display());
        let titles = crate::pages::prose(&text).filter(|line| line.starts_with("# ")).count();
        // The parts of a summary are written as titles.
        assert!(titles == 1 || name == "SUMMARY", "{}: {titles} titles", path.display());
    }
}

#[test]
fn every_command_in_the_pages_is_one_that_the_program_knows() {
    let (mut n, mut wrong) = (0, Vec::new());
    for (path, text) in pages() {
        let of_shell = blocks(&text).into_iter().filter(|(kind, _)| ["sh", "sh not-run"].contains(kind));
        for line in of_shell.flat_map(|(_, block)| commands(&block)).filter_map(of_program) {
            n += 1;
            if let Err(said) = quadrille::cli::check_line(line.iter().map(Into::into)) {
                wrong.push(format!("{}: {}: {said}", path.strip_prefix(root()).unwrap().display(), line.join(" ")));
            }
        }
        // In the middle of a sentence, as far as the name of the command and its flags go.
        for quoted in text.split('`').skip(1).step_by(2).filter(|quoted| quoted.starts_with("quadrille ")) {
            let Some(line) = words(&quoted.replace(['…', '\''], "")) else { continue };
            let is_word = |word: &&String| word.starts_with(|c: char| c.is_ascii_lowercase());
            let line: Vec<&String> = line.iter().skip(1).take_while(is_word).collect();
            if line.is_empty() {
                continue;
            }
            n += 1;
            // Of `make images` both words are the command.
            let help = ["quadrille"].into_iter().chain(line.iter().take(2).map(|word| word.as_str())).chain(["--help"]);
            if let Err(said) = quadrille::cli::check_line(help.map(Into::into)) {
                wrong.push(format!("{}: `{quoted}`: {said}", path.strip_prefix(root()).unwrap().display()));
            }
        }
    }
    assert!(n > 100, "{n} commands");
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn flags_in_the_pages_are_flags_of_the_program() {
    let reference = fs::read_to_string(root().join("docs/commands.md")).unwrap();
    let flag = |word: &str| word.chars().take_while(|c| c.is_ascii_alphanumeric() || *c == '-').collect::<String>();
    let known: BTreeSet<String> =
        reference.split('`').filter_map(|word| Some(flag(&word[word.find("--")?..]))).collect();
    assert!(known.len() > 80, "{}", known.len());
    // Of cargo, of scripts, of programs beside it.
    let others = "--test --tests --bench --example --release --profile --locked --path --no-default-features --features --open \
                  --ignored --nocapture --all-targets --no-deps --json --doc --lib --bin --deny --slurm --chromium --python --skip \
                  --has-vulkan --force --wait --gres --dependency --qos --gpus --no-fail-fast --timings --parts --margin";
    let others: BTreeSet<&str> = others.split_whitespace().collect();
    let mut wrong = Vec::new();
    for (path, text) in pages() {
        for quoted in text.split('`').filter(|quoted| quoted.starts_with("--")) {
            let name = flag(quoted);
            if name.len() > 2 && !known.contains(&name) && !others.contains(name.as_str()) {
                wrong.push(format!("{}: {name}", path.strip_prefix(root()).unwrap().display()));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn the_reference_of_commands_is_the_one_that_the_program_writes() {
    assert_written_by("docs/commands.md", "about commands");
}

#[test]
fn the_page_on_remarks_is_the_one_that_the_program_writes() {
    assert_written_by("docs/remarks.md", "about remarks");
}

/// Whether the page holds what the program prints.
#[track_caller]
fn assert_written_by(page: &str, command: &str) {
    let there = fs::read_to_string(root().join(page)).unwrap_or_default();
    let wanted = Desk::new().run(command).printed();
    let line = there.lines().zip(wanted.lines()).position(|(there, wanted)| there != wanted);
    assert!(
        there == wanted,
        "{page} is not what the program says (line {:?}); write it: quadrille {command} > {page}",
        line.map(|line| line + 1)
    );
}

/// Follows a tutorial in an empty folder: writes the files that it shows (blocks that begin with `# name`), runs its
/// commands, one after the other, and looks for the files that its text promises: every word between backticks that
/// begins with the name of an `--output` folder and a slash.
#[track_caller]
fn follow(page: &str) -> Desk {
    let text = fs::read_to_string(root().join("docs/tutorials").join(page)).unwrap();
    let desk = Desk::new();
    let (mut folders, mut n) = (BTreeSet::new(), 0);
    for (kind, block) in blocks(&text) {
        let name = block.strip_prefix("# ").and_then(|rest| rest.lines().next());
        if let (Some(name), true) = (name, ["toml", "csv"].contains(&kind)) {
            desk.write(name, &block);
        }
        let lines = if kind == "sh" { commands(&block) } else { Vec::new() };
        for line in lines.into_iter().filter_map(of_program) {
            let arguments: Vec<&str> = line.iter().skip(1).map(String::as_str).collect();
            let ran = desk.run_words(&arguments);
            assert_eq!(ran.code, Some(0), "{page}: {ran}");
            folders.extend(line.windows(2).filter(|pair| pair[0] == "--output").map(|pair| format!("{}/", pair[1])));
            n += 1;
        }
    }
    assert!(n > 2, "{page}: {n} commands");
    let outside = text.split("```").step_by(2).collect::<Vec<_>>().join(" ");
    let mut promised = 0;
    for quoted in outside.split('`').skip(1).step_by(2) {
        if folders.iter().any(|folder| quoted.starts_with(folder.as_str())) && !quoted.contains(['*', ' ']) {
            promised += 1;
            assert!(desk.path(quoted).exists(), "{page}: {quoted} is not there; {:#?}", desk.files(""));
        }
    }
    assert!(promised > 1, "{page}: {promised} files are named");
    desk
}

#[test]
fn the_tutorial_of_a_first_pair_can_be_followed() {
    drop(follow("first-pair.md"));
}

#[test]
fn the_tutorial_of_ones_own_test_can_be_followed() {
    drop(follow("own-test.md"));
}

#[test]
fn the_tutorial_of_a_bar_can_be_followed() {
    drop(follow("bar.md"));
}

#[test]
fn the_tutorial_of_a_double_cantilever_beam_can_be_followed() {
    drop(follow("dcb.md"));
}

#[test]
fn the_tutorial_of_a_large_series_can_be_followed() {
    drop(follow("large-series.md"));
}

#[cfg(feature = "store")]
#[test]
fn the_tutorial_in_python_can_be_followed() {
    let desk = follow("python.md");
    let Some((python, _)) = crate::store::python() else { return };
    let text = fs::read_to_string(root().join("docs/tutorials/python.md")).unwrap();
    let examples: Vec<String> =
        blocks(&text).into_iter().filter(|(kind, _)| *kind == "python").map(|(_, block)| block).collect();
    // Those of the module run where it is: scripts/tutorial.py, by scripts/wheel.sh.
    let examples: Vec<String> = examples.into_iter().filter(|text| !text.contains("import quadrille")).collect();
    assert!(!examples.is_empty());
    for example in examples {
        let ran =
            std::process::Command::new(&python).args(["-c", &example]).current_dir(desk.path("")).output().unwrap();
        let said = String::from_utf8_lossy(&ran.stdout);
        assert!(ran.status.success(), "{example}\n{}", String::from_utf8_lossy(&ran.stderr));
        assert!(said.trim_end().ends_with("True"), "not all frames converged: {said}");
    }
}

#[test]
fn the_tutorial_of_the_library_shows_the_examples_that_run() {
    let page = fs::read_to_string(root().join("docs/tutorials/library.md")).unwrap();
    let sources = ["pair", "series", "identify_from_images"]
        .map(|name| fs::read_to_string(root().join("examples").join(name).with_extension("rs")).unwrap());
    let blocks: Vec<&str> = page.split("```rust\n").skip(1).map(|rest| rest.split("```").next().unwrap()).collect();
    assert!(blocks.len() >= 3, "{}", blocks.len());
    for block in blocks {
        for line in block.lines().map(str::trim).filter(|line| !line.is_empty()) {
            assert!(sources.iter().any(|text| text.contains(line)), "no example has the line: {line}");
        }
    }
}

#[test]
fn pages_that_are_to_be_read_at_once_are_short() {
    let text = |name: &str| fs::read_to_string(root().join(name)).unwrap();
    let size = text("README.md").len();
    assert!(size <= 7 * 1024, "README.md has {size} bytes; 7 KiB is the most");
    for (name, most) in [("CHANGELOG.md", 60), ("ARCHITECTURE.md", 110)] {
        let lines = text(name).lines().count();
        assert!(lines <= most, "{name} has {lines} lines; {most} is the most");
    }
    // A bar of a table, or a comment's end, is no word.
    let is_word = |word: &&str| word.contains(char::is_alphanumeric);
    let words = text("benches/RESULTS.md").split_whitespace().filter(is_word).count();
    assert!(words <= 1500, "benches/RESULTS.md has {words} words; 1500 is the most");
}

/// By `make release-check PARTS=thorough`.
mod thorough {
    use super::*;

    #[test]
    #[ignore = "make release-check PARTS=thorough"]
    fn the_tutorial_of_a_joint_can_be_followed() {
        drop(follow("joint.md"));
    }
}
