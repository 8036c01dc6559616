//! No file names another that names it back, directly or through others: inside a room too one can begin to read
//! somewhere.

use super::Source;
use std::collections::{BTreeMap, BTreeSet};

/// Where a module is: the words of its path from the root of the crate.
type Module = Vec<String>;

/// What one file says of others.
#[derive(Debug, Default)]
struct Named {
    /// Paths, as they stand there.
    uses: Vec<Vec<String>>,
    /// Paths whose names it hands on under its own: to name these is to name what they lead to.
    hands_on: Vec<Vec<String>>,
}

fn module(path: &str) -> Module {
    let path = path.trim_end_matches(".rs").trim_end_matches("/mod");
    path.split('/').map(str::to_owned).collect()
}

/// Reads the tree of a `use` that begins at `at` into full paths; gives where it ends.
fn tree(source: &Source, mut at: usize, prefix: &[String], paths: &mut Vec<Vec<String>>) -> usize {
    let mut path = prefix.to_vec();
    loop {
        match source.word(at) {
            "{" => {
                at += 1;
                while !["}", ";", ""].contains(&source.word(at)) {
                    at = tree(source, at, &path, paths);
                    at += usize::from(source.word(at) == ",");
                }
                return at + 1;
            }
            "::" => at += 1,
            "as" => at += 2,
            "," | "}" | ";" | "" => break,
            word => {
                path.push(word.to_owned());
                at += 1;
            }
        }
    }
    paths.push(path);
    at
}

/// What a file names outside its tests.
fn named(source: &Source) -> Named {
    let tests = ["#", "[", "cfg", "(", "test", ")", "]", "mod"];
    let mut found = Named::default();
    let mut at = 0;
    while at < source.tokens.len() && !(0..tests.len()).all(|k| source.word(at + k) == tests[k]) {
        match source.word(at) {
            "use" => {
                let is_public = ["pub", ")"].contains(&source.before(at, 1));
                let mut paths = Vec::new();
                at = tree(source, at + 1, &[], &mut paths);
                // What the head of a room takes in, the files below it may take from there.
                if is_public || source.path.ends_with("/mod.rs") {
                    found.hands_on.extend(paths.iter().cloned());
                }
                if !is_public {
                    found.uses.extend(paths);
                }
            }
            "crate" | "super" if source.before(at, 1) != "::" && source.word(at + 1) == "::" => {
                let mut path = vec![source.word(at).to_owned()];
                while source.word(at + 1) == "::" {
                    at += 2;
                    path.push(source.word(at).to_owned());
                }
                found.uses.push(path);
                at += 1;
            }
            _ => at += 1,
        }
    }
    found
}

/// The module that `path`, named in `from`, leads to, and the name that is taken from it.
fn resolved(modules: &BTreeSet<Module>, from: &Module, path: &[String]) -> Option<(Module, Option<String>)> {
    let n_super = path.iter().take_while(|word| *word == "super").count();
    let (mut at, mut rest) = match path.first()?.as_str() {
        "crate" => (Vec::new(), &path[1..]),
        "self" => (from.clone(), &path[1..]),
        "super" => (from[..from.len().checked_sub(n_super)?].to_vec(), &path[n_super..]),
        _ => (from.clone(), path),
    };
    while let Some(word) = rest.first() {
        at.push(word.clone());
        if !modules.contains(&at) {
            at.pop();
            break;
        }
        rest = &rest[1..];
    }
    // A path that begins with another crate's name leads nowhere.
    let of_another = at == *from && !["crate", "self", "super"].contains(&path[0].as_str());
    (!of_another && !at.is_empty()).then(|| (at, rest.first().cloned()))
}

/// Groups of files that name each other in a circle.
pub fn circles(sources: &[Source]) -> Vec<Vec<String>> {
    let named: BTreeMap<Module, Named> = sources.iter().map(|s| (module(&s.path), named(s))).collect();
    let modules: BTreeSet<Module> = named.keys().cloned().collect();
    let mut handed_on: BTreeMap<(Module, String), Module> = BTreeMap::new();
    for (own, says) in &named {
        for path in &says.hands_on {
            if let Some((to, Some(name))) = resolved(&modules, own, path) {
                handed_on.insert((own.clone(), name), to);
            }
        }
    }
    let mut names: BTreeMap<&Module, BTreeSet<Module>> = BTreeMap::new();
    for (own, says) in &named {
        for (mut to, name) in says.uses.iter().filter_map(|path| resolved(&modules, own, path)) {
            // From hand to hand, as often as names may be handed on.
            for _ in 0..8 {
                match name.clone().and_then(|name| handed_on.get(&(to.clone(), name))) {
                    Some(further) => to.clone_from(further),
                    None => break,
                }
            }
            if to != *own {
                names.entry(own).or_default().insert(to);
            }
        }
    }
    let reach = |from: &Module| {
        let (mut seen, mut next) = (BTreeSet::new(), vec![from.clone()]);
        while let Some(at) = next.pop() {
            let new = names.get(&at).into_iter().flatten().filter(|to| !seen.contains(*to)).cloned();
            let new: Vec<Module> = new.collect();
            seen.extend(new.iter().cloned());
            next.extend(new);
        }
        seen
    };
    let reached: BTreeMap<&Module, BTreeSet<Module>> = modules.iter().map(|own| (own, reach(own))).collect();
    let mut found = BTreeSet::new();
    for own in modules.iter().filter(|own| reached[own].contains(*own)) {
        let circle = reached[own].iter().filter(|other| reached.get(other).is_some_and(|back| back.contains(own)));
        found.insert(circle.map(|module| module.join("/")).collect::<Vec<_>>());
    }
    found.into_iter().collect()
}
