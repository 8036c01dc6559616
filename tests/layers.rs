//! The map of the modules: who may name whom, where each heavy crate lives, who opens files, who prints.

use std::fmt;
use std::path::{Path, PathBuf};

#[path = "layers/circles.rs"]
mod circles;

/// Ranks of the modules: a module names modules of lower rank only.
const RANKS: [(&str, u8); 24] = [
    ("units", 0),
    ("clock", 0),
    ("digest", 0),
    ("isa", 0),
    ("parts", 0),
    ("plane", 0),
    ("remark", 0),
    ("linalg", 1),
    ("imaging", 2),
    ("mesh", 2),
    ("field", 3),
    ("camera", 4),
    ("backend", 5),
    ("io", 5),
    ("synth", 5),
    ("correlate", 6),
    ("identify", 8),
    ("reduction", 7),
    ("mechanics", 6),
    ("metrology", 7),
    ("virtual_test", 7),
    ("report", 9),
    ("run", 10),
    ("cli", 11),
];

/// Names that belong to a few places only.
struct Home {
    /// What is meant, as a user of the rule would say it.
    what: &'static str,
    named_by: fn(&Source, usize) -> bool,
    /// Beginnings of the paths under `src` where it is at home.
    places: &'static [&'static str],
}

/// What the manifests of the crates do not say: they hold `tiff` and `zarrs` in `io`, `clarabel` in `joint`, and so on.
const HOMES: [Home; 7] = [
    Home { what: "the crate faer", named_by: |s, at| s.names_crate(at, "faer"), places: &["linalg/"] },
    Home { what: "the crate image", named_by: |s, at| s.names_crate(at, "image"), places: &["io/", "report/"] },
    Home { what: "the crate wgpu", named_by: |s, at| s.names_crate(at, "wgpu"), places: &["backend/gpu/"] },
    Home {
        what: "the crate clap",
        named_by: |s, at| s.names_crate(at, "clap"),
        places: &["cli/", "io/case", "run/plan/request.rs"],
    },
    Home { what: "the crate resvg", named_by: |s, at| s.names_crate(at, "resvg"), places: &["report/picture.rs"] },
    Home { what: "printing", named_by: Source::prints, places: &["cli/"] },
    Home { what: "opening files", named_by: Source::opens_files, places: &["io/", "report/", "run/", "cli/"] },
];

/// A file of the source tree, cut into words and signs; comments and texts are left out.
struct Source {
    /// Path from the root of `quadrille::`, with `/`, whatever crate it lies in: `mesh/q4.rs`, `io/csv.rs`.
    path: String,
    /// Words, `::`, and single signs, each with its line.
    tokens: Vec<(String, usize)>,
    /// Modules that the file declares: their names are no crates there.
    own_modules: Vec<String>,
}

#[derive(Debug, Clone, PartialEq)]
struct Violation {
    file: String,
    line: usize,
    rule: String,
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, line {}: {}", self.file, self.line, self.rule)
    }
}

impl Source {
    fn new(path: &str, text: &str) -> Self {
        let mut tokens = tokens(text);
        if path.starts_with("io/") {
            in_io(&mut tokens);
        }
        let declared = tokens.windows(3).filter(|w| w[0].0 == "mod" && [";", "{"].contains(&w[2].0.as_str()));
        let own_modules = declared.map(|w| w[1].0.clone()).collect();
        Self { path: path.to_owned(), tokens, own_modules }
    }

    fn word(&self, at: usize) -> &str {
        self.tokens.get(at).map_or("", |token| &token.0)
    }

    /// The top-level module that the file belongs to; none for `lib.rs` and `main.rs`.
    fn module(&self) -> Option<&str> {
        let top = self.path.split('/').next().unwrap_or_default().trim_end_matches(".rs");
        (!["lib", "main"].contains(&top)).then_some(top)
    }

    /// How many `super` lead from this file to the root of the crate.
    fn depth(&self) -> usize {
        self.path.trim_end_matches("/mod.rs").split('/').count()
    }

    /// The word `back` places before `at`.
    fn before(&self, at: usize, back: usize) -> &str {
        at.checked_sub(back).map_or("", |at| self.word(at))
    }

    /// The first segments after `at`, where `::` stands: one name, or those of a group `{a, b::c}`.
    fn segments_after(&self, at: usize) -> Vec<(String, usize)> {
        if self.word(at) != "::" {
            return Vec::new();
        }
        if self.word(at + 1) != "{" {
            return self.tokens.get(at + 1).cloned().into_iter().collect();
        }
        let (mut names, mut nesting) = (Vec::new(), 0);
        for k in at + 1..self.tokens.len() {
            match self.word(k) {
                "{" => nesting += 1,
                "}" => nesting -= 1,
                _ if nesting == 1 && ["{", ","].contains(&self.word(k - 1)) => names.push(self.tokens[k].clone()),
                _ => {}
            }
            if nesting == 0 {
                break;
            }
        }
        names
    }

    /// Top-level modules named through `crate::` or enough `super::`, with their lines.
    fn modules_named(&self) -> Vec<(String, usize)> {
        let mut found = Vec::new();
        for at in 0..self.tokens.len() {
            match self.word(at) {
                "crate" if self.word(at + 1) == "::" => found.extend(self.segments_after(at + 1)),
                "super" if self.before(at, 2) != "super" => {
                    let n = (0..).take_while(|k| self.word(at + 2 * k) == "super").count();
                    if n == self.depth() {
                        found.extend(self.segments_after(at + 2 * n - 1));
                    }
                }
                _ => {}
            }
        }
        found.retain(|(name, _)| rank(name).is_some());
        found
    }

    fn names_crate(&self, at: usize, name: &str) -> bool {
        if self.word(at) != name {
            return false;
        }
        let (before, next) = (self.before(at, 1), self.word(at + 1));
        if before == "::" {
            // `::image` is the crate even beside a module of that name; `a::image` and `<T>::image` are not.
            let left = self.before(at, 2);
            return left == "use" || !(left == ">" || left.starts_with(|c: char| c.is_alphanumeric() || c == '_'));
        }
        let named = before != "." && next == "::" || ["use", "crate"].contains(&before);
        named && !self.own_modules.iter().any(|own| own == name)
    }

    fn prints(&self, at: usize) -> bool {
        ["println", "eprintln", "print", "eprint", "dbg"].contains(&self.word(at)) && self.word(at + 1) == "!"
    }

    fn opens_files(&self, at: usize) -> bool {
        let of_std = |name: &str| self.word(at) == "std" && self.segments_after(at + 1).iter().any(|s| s.0 == name);
        let path = ["File", "OpenOptions"].contains(&self.word(at)) && self.word(at + 1) == "::";
        of_std("fs") || path
    }
}

fn rank(module: &str) -> Option<u8> {
    RANKS.iter().find(|(name, _)| *name == module).map(|(_, rank)| *rank)
}

/// Cuts Rust text into words, `::` and signs; comments, texts and characters are passed over.
fn tokens(text: &str) -> Vec<(String, usize)> {
    let chars: Vec<char> = text.chars().collect();
    let (mut tokens, mut at, mut line) = (Vec::new(), 0, 1);
    let begins = |at: usize, with: &str| with.chars().enumerate().all(|(k, c)| chars.get(at + k) == Some(&c));
    while at < chars.len() {
        let start = at;
        let c = chars[at];
        if begins(at, "//") {
            while at < chars.len() && chars[at] != '\n' {
                at += 1;
            }
        } else if begins(at, "/*") {
            let mut nesting = 0;
            loop {
                let step = usize::from(begins(at, "/*")) + 2 * usize::from(begins(at, "*/"));
                nesting += [0, 1, -1][step];
                at += if step == 0 { 1 } else { 2 };
                if nesting == 0 || at >= chars.len() {
                    break;
                }
            }
        } else if let Some(hashes) = raw_text(&chars, at) {
            let end = format!("\"{}", "#".repeat(hashes));
            at += 2 + usize::from(c == 'b') + hashes;
            while at < chars.len() && !begins(at, &end) {
                at += 1;
            }
            at += end.len();
        } else if c == '"' {
            at += 1;
            while at < chars.len() && chars[at] != '"' {
                at += 1 + usize::from(chars[at] == '\\');
            }
            at += 1;
        } else if c == '\'' && (chars.get(at + 1) == Some(&'\\') || chars.get(at + 2) == Some(&'\'')) {
            at += 2 + usize::from(chars[at + 1] == '\\');
            while at < chars.len() && chars[at] != '\'' {
                at += 1;
            }
            at += 1;
        } else if c.is_alphanumeric() || c == '_' {
            while at < chars.len() && (chars[at].is_alphanumeric() || chars[at] == '_') {
                at += 1;
            }
            tokens.push((chars[start..at].iter().collect(), line));
        } else {
            at += if begins(at, "::") { 2 } else { 1 };
            if !c.is_whitespace() {
                tokens.push((chars[start..at].iter().collect(), line));
            }
        }
        line += chars[start..at.min(chars.len())].iter().filter(|&&c| c == '\n').count();
    }
    tokens
}

/// The number of `#` when a raw text begins here.
fn raw_text(chars: &[char], at: usize) -> Option<usize> {
    let r = at + usize::from(chars[at] == 'b');
    if chars.get(r) != Some(&'r') || at > 0 && (chars[at - 1].is_alphanumeric() || chars[at - 1] == '_') {
        return None;
    }
    let hashes = chars[r + 1..].iter().take_while(|&&c| c == '#').count();
    (chars.get(r + 1 + hashes) == Some(&'"')).then_some(hashes)
}

/// What is wrong in one file.
fn violations(source: &Source) -> Vec<Violation> {
    let mut found = Vec::new();
    let mut add = |line, rule| found.push(Violation { file: source.path.clone(), line, rule });
    if let Some(module) = source.module() {
        match rank(module) {
            None => {
                add(1, format!("module '{module}' has no rank; give it one in tests/layers.rs and ARCHITECTURE.md"))
            }
            Some(own) => {
                for (name, line) in source.modules_named() {
                    let theirs = rank(&name).unwrap_or(u8::MAX);
                    if name != module && theirs >= own {
                        let rule = format!("{module} (rank {own}) names {name} (rank {theirs}); lower ranks only");
                        add(line, rule);
                    }
                }
            }
        }
    }
    for home in &HOMES {
        if home.places.iter().any(|place| source.path.starts_with(place)) {
            continue;
        }
        for at in (0..source.tokens.len()).filter(|&at| (home.named_by)(source, at)) {
            add(source.tokens[at].1, format!("{} is at home in {} alone", home.what, home.places.join(", ")));
        }
    }
    found
}

/// The crate `io` is a module of `quadrille::`: what it calls `crate::csv` is `crate::io::csv` to others.
fn in_io(tokens: &mut Vec<(String, usize)>) {
    for at in (2..tokens.len()).rev() {
        let [root, colons, name] = [at - 2, at - 1, at].map(|k| tokens[k].0.as_str());
        if root == "crate" && colons == "::" && rank(name).is_none() {
            let line = tokens[at].1;
            tokens.splice(at..at, [("io".to_owned(), line), ("::".to_owned(), line)]);
        }
    }
}

/// Path from the root of `quadrille::` and text of every file of every crate.
fn source_files() -> Vec<(String, String)> {
    fn walk(folder: &Path, files: &mut Vec<PathBuf>) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                walk(&path, files);
            } else if path.extension().is_some_and(|ending| ending == "rs") {
                files.push(path);
            }
        }
    }
    let mut found = Vec::new();
    for (folder, below) in [
        ("src", ""),
        ("crates/base/src", ""),
        ("crates/dic/src", ""),
        ("crates/joint/src", ""),
        ("crates/io/src", "io/"),
    ] {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
        let mut files = Vec::new();
        walk(&root, &mut files);
        for path in files {
            let parts: Vec<_> = path.strip_prefix(&root).unwrap().iter().map(|part| part.to_string_lossy()).collect();
            let name = match (below, parts.join("/").as_str()) {
                ("io/", "lib.rs") => "io/mod.rs".to_owned(),
                (_, name) => format!("{below}{name}"),
            };
            found.push((name, std::fs::read_to_string(path).unwrap()));
        }
    }
    found.sort();
    found
}

fn source_tree() -> Vec<Source> {
    source_files().iter().map(|(path, text)| Source::new(path, text)).collect()
}

#[test]
fn every_module_names_modules_of_lower_rank_and_every_crate_stays_at_home() {
    let sources = source_tree();
    let seen: Vec<_> = sources.iter().filter_map(Source::module).collect();
    for (module, _) in RANKS {
        assert!(seen.contains(&module), "module '{module}' has a rank and is not in src; is the map out of date?");
    }
    let all: Vec<_> = sources.iter().flat_map(violations).map(|v| v.to_string()).collect();
    assert!(all.is_empty(), "{} violation(s):\n{}", all.len(), all.join("\n"));
}

#[test]
fn every_heavy_crate_is_seen_where_it_lives() {
    // Otherwise the rule above would hold because the eyes are shut.
    let sources = source_tree();
    // naga is at home in tests alone.
    for home in HOMES.iter().filter(|home| !home.places.is_empty()) {
        let there = |source: &&Source| home.places.iter().any(|place| source.path.starts_with(place));
        let named = |source: &Source| (0..source.tokens.len()).any(|at| (home.named_by)(source, at));
        assert!(sources.iter().filter(there).any(named), "{} is not seen in {:?}", home.what, home.places);
    }
    let named: usize = sources.iter().map(|source| source.modules_named().len()).sum();
    assert!(named > 50, "only {named} names of modules are seen");
}

/// The paths `src/a/b.rs` and `crates/c/src/a/b.rs` that stand in a text.
fn paths_named(text: &str) -> impl Iterator<Item = &str> {
    let is_part = |c: char| c.is_ascii_alphanumeric() || "_/.".contains(c);
    text.match_indices("src/").filter_map(move |(at, _)| {
        let crate_name = text[..at].strip_suffix('/').and_then(|before| before.rsplit('/').next());
        let prefix = crate_name.map_or(0, |name| "crates/".len() + name.len() + 1);
        let begin = at.checked_sub(prefix).filter(|&b| text[b..].starts_with("crates/")).unwrap_or(at);
        let word = &text[begin..at + text[at..].find(|c| !is_part(c)).unwrap_or(text.len() - at)];
        word.find(".rs").map(|end| &word[..end + 3])
    })
}

#[test]
fn every_file_that_a_document_or_a_shader_names_is_there() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut texts = ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md"].map(|name| root.join(name)).to_vec();
    for folder in ["docs", "shaders", "shaders/shared"] {
        texts.extend(std::fs::read_dir(root.join(folder)).unwrap().map(|entry| entry.unwrap().path()));
    }
    let mut n = 0;
    for path in texts.iter().filter(|path| path.extension().is_some_and(|ending| ending == "md" || ending == "wgsl")) {
        for named in paths_named(&std::fs::read_to_string(path).unwrap()) {
            assert!(root.join(named).is_file(), "{} names {named}, which is not there", path.display());
            n += 1;
        }
    }
    assert!(n > 50, "only {n} paths are seen");
}

#[test]
fn no_files_name_each_other_in_a_circle() {
    let found = circles::circles(&source_tree());
    let lines: Vec<_> = found.iter().map(|circle| circle.join(", ")).collect();
    assert!(
        found.is_empty(),
        "{} circle(s); move what both need into a file below them:\n{}",
        found.len(),
        lines.join("\n")
    );
}

#[test]
fn a_circle_is_found_through_other_files_and_through_names_handed_on() {
    let of = |files: &[(&str, &str)]| {
        circles::circles(&files.iter().map(|(path, text)| Source::new(path, text)).collect::<Vec<_>>())
    };
    let direct =
        [("a/mod.rs", "mod b; mod c;"), ("a/b.rs", "use super::c::C;"), ("a/c.rs", "fn f() { crate::a::b::g() }")];
    assert_eq!(of(&direct), [["a/b", "a/c"]]);
    let handed_on = [
        ("a/mod.rs", "mod b; mod c; pub use c::C;"),
        ("a/b.rs", "use crate::a::{C, x};"),
        ("a/c.rs", "use super::b as d;"),
    ];
    assert_eq!(of(&handed_on), [["a/b", "a/c"]]);
    let child = [("a.rs", "mod b; use b::B;"), ("a/b.rs", "use super::A;")];
    assert_eq!(of(&child), [["a", "a/b"]]);
    let in_tests = [("a/b.rs", "use super::c::C;"), ("a/c.rs", "#[cfg(test)] mod tests { use super::super::b::B; }")];
    assert!(of(&in_tests).is_empty());
}

#[track_caller]
fn assert_violates(path: &str, text: &str, wanted: &[&str]) {
    let found: Vec<_> = violations(&Source::new(path, text)).iter().map(ToString::to_string).collect();
    assert_eq!(found, wanted, "{path}: {text}");
}

#[test]
fn a_name_of_the_same_or_a_higher_rank_is_found_with_file_line_and_rule() {
    let upward = "mesh/grid.rs, line 2: mesh (rank 2) names field (rank 3); lower ranks only";
    assert_violates("mesh/grid.rs", "use crate::units::Px;\nuse crate::field::Status;", &[upward]);
    assert_violates("mesh/grid.rs", "\nfn f() -> crate::field::Status {}", &[upward]);
    assert_violates("mesh/grid.rs", "use crate::{\n    field::{Status, isa}, units::Px};", &[upward]);
    assert_violates("mesh/grid.rs", "\nuse super::super::field::Status;", &[upward]);
    assert_violates("mesh/grid.rs", "/* field \n */ use crate::field as f;", &[upward]);
    let across = "imaging/image.rs, line 1: imaging (rank 2) names mesh (rank 2); lower ranks only";
    assert_violates("imaging/image.rs", "use crate::mesh::Mesh;", &[across]);
    assert_violates(
        "isa.rs",
        "use super::units::Px;",
        &["isa.rs, line 1: isa (rank 0) names units (rank 0); lower ranks only"],
    );
    assert_violates(
        "backend/cpu/plane.rs",
        "use super::super::super::io::csv;",
        &["backend/cpu/plane.rs, line 1: backend (rank 5) names io (rank 5); lower ranks only"],
    );
    let unknown =
        "gadgets.rs, line 1: module 'gadgets' has no rank; give it one in tests/layers.rs and ARCHITECTURE.md";
    assert_violates("gadgets.rs", "", &[unknown]);
}

#[test]
fn what_is_allowed_is_not_held_against_a_file() {
    assert_violates(
        "field/mod.rs",
        "use crate::mesh::Mesh; use crate::field::Status; mod cli; use super::mesh::Mesh;",
        &[],
    );
    assert_violates(
        "mesh/grid.rs",
        "// crate::cli and faer::x\n/// [`crate::cli`]\nconst S: &str = \"crate::cli\";",
        &[],
    );
    assert_violates(
        "mesh/grid.rs",
        "const R: &str = r#\"use \"crate::cli::x\"#; const Q: char = '\"'; fn f<'a>() {}",
        &[],
    );
    assert_violates("imaging/mod.rs", "mod image;\npub use image::Image; use crate::imaging::image::Image;", &[]);
    assert_violates("backend/mod.rs", "fn f(image: &Image) { image.width(); self::image::f(); }", &[]);
    assert_violates("lib.rs", "pub mod cli; use crate::cli::main;", &[]);
}

#[test]
fn a_crate_a_print_and_a_file_away_from_home_are_found() {
    let lost = |line: usize, what: &str| format!("mesh/grid.rs, line {line}: {what} alone");
    let cases = [
        ("\nuse faer::Side;", 2, "the crate faer is at home in linalg/"),
        ("use ::image::open; mod image;", 1, "the crate image is at home in io/, report/"),
        ("fn f(x: image::DynamicImage) {}", 1, "the crate image is at home in io/, report/"),
        ("use wgpu;", 1, "the crate wgpu is at home in backend/gpu/"),
        ("use resvg as r;", 1, "the crate resvg is at home in report/picture.rs"),
        ("extern crate clap;", 1, "the crate clap is at home in cli/, io/case, run/plan/request.rs"),
        ("\n\nfn f() { println!(\"a\"); }", 3, "printing is at home in cli/"),
        ("fn f() { eprintln!(); }", 1, "printing is at home in cli/"),
        ("use std::{io, fs};", 1, "opening files is at home in io/, report/, run/, cli/"),
        ("fn f() { std::fs::read(x); }", 1, "opening files is at home in io/, report/, run/, cli/"),
        ("fn f() { File::open(x); }", 1, "opening files is at home in io/, report/, run/, cli/"),
    ];
    for (text, line, what) in cases {
        assert_violates("mesh/grid.rs", text, &[&lost(line, what)]);
    }
    assert_violates(
        "backend/choice.rs",
        "use wgpu::Device;",
        &["backend/choice.rs, line 1: the crate wgpu is at home in backend/gpu/ alone"],
    );
    // In `io` the root of the crate is `io` itself.
    assert_violates("io/csv.rs", "use crate::text::number; use crate::field::Status; use crate::digest::sha256;", &[]);
}

#[test]
fn files_of_the_program_and_its_engine_stay_short() {
    const MOST: usize = 500;
    let mut files = 0;
    for (path, text) in source_files() {
        if !["cli/", "run/"].iter().any(|room| path.starts_with(room)) {
            continue;
        }
        let lines = text.lines().count();
        assert!(lines <= MOST, "src/{path}: {lines} lines, {MOST} at most");
        files += 1;
    }
    assert!(files > 40, "{files} files");
}
