//! Nodes and elements of an Abaqus input file (`.inp`).

use super::{FileElement, FileNode, MeshFileFault, Parsed};
use std::collections::HashMap;

/// How much of a file is looked at for a keyword.
const HEAD: usize = 1 << 16;
/// Beginnings of the names of plane elements and shells, the number of nodes follows.
const PLANE: [&str; 6] = ["CPS", "CPE", "CAX", "M3D", "STRI", "S"];

/// Whether `bytes` are such a file: a line begins with one of its keywords.
pub(super) fn is_inp(bytes: &[u8]) -> bool {
    let head = String::from_utf8_lossy(bytes.get(..HEAD).unwrap_or(bytes)).to_ascii_uppercase();
    head.lines().any(|line| ["*NODE", "*HEADING", "*PART"].iter().any(|word| line.trim_start().starts_with(word)))
}

/// What the lines below a keyword are.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Section {
    Nodes,
    /// Elements of which so many nodes are given, the first so many of which are corners.
    Elements {
        given: usize,
        corners: usize,
    },
    /// Elements that are left aside.
    Aside,
    /// A moved instance of a part, if it has a line.
    Instance,
    Other,
}

/// The section that a keyword line begins.
fn section_of(line: &str) -> Section {
    let mut words = line.split(',').map(|word| word.trim().to_ascii_uppercase());
    let keyword = words.next().unwrap_or_default();
    match keyword.as_str() {
        "*NODE" => Section::Nodes,
        "*INSTANCE" => Section::Instance,
        "*ELEMENT" => {
            let kind =
                words.find_map(|word| Some(word.strip_prefix("TYPE")?.trim_start_matches([' ', '=']).to_owned()));
            let kind = kind.unwrap_or_default();
            let number = |rest: &str| rest.chars().next().and_then(|digit| digit.to_digit(10));
            let n = PLANE.iter().find_map(|name| number(kind.strip_prefix(name)?)).unwrap_or(0) as usize;
            match n {
                3 | 4 => Section::Elements { given: n, corners: n },
                6 | 8 => Section::Elements { given: n, corners: n / 2 },
                _ => Section::Aside,
            }
        }
        _ => Section::Other,
    }
}

pub(super) fn parse(bytes: &[u8]) -> Result<Parsed, MeshFileFault> {
    let text = String::from_utf8_lossy(bytes);
    let invalid = |line: usize, what: String| MeshFileFault::Invalid { place: format!("line {}", line + 1), what };
    let mut parsed = Parsed::default();
    let mut place_of: HashMap<u64, usize> = HashMap::new();
    let mut listed: Vec<(u64, Vec<u64>)> = Vec::new();
    let mut section = Section::Other;
    // The words of an element whose line ends in a comma go on in the next.
    let mut begun: Vec<u64> = Vec::new();
    for (at, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.starts_with("**") || line.is_empty() {
            continue;
        }
        if line.starts_with('*') {
            if line.to_ascii_uppercase().starts_with("*INCLUDE") {
                let what = "a file that includes another".to_owned();
                return Err(MeshFileFault::Unsupported {
                    what,
                    remedy: "write all nodes and elements into one file".into(),
                });
            }
            begun.clear();
            section = section_of(line);
            continue;
        }
        let mut words = line.split(',').map(str::trim).filter(|word| !word.is_empty());
        match section {
            Section::Nodes => {
                let number = words.next().and_then(|word| word.parse::<u64>().ok());
                let values: Vec<f64> = words.map_while(|word| word.parse().ok()).collect();
                let (Some(number), &[x, y, ..]) = (number, values.as_slice()) else {
                    return Err(invalid(at, format!("'{line}' is not a node: number, x, y")));
                };
                let z = values.get(2).copied().unwrap_or(0.0);
                if place_of.insert(number, parsed.nodes.len()).is_some() {
                    let what =
                        format!("node {number} is given twice; write one part, in its place, into a file of its own");
                    return Err(invalid(at, what));
                }
                parsed.nodes.push(FileNode { number, at: [x, y, z] });
            }
            Section::Elements { given, corners } => {
                for word in words {
                    begun.push(word.parse().map_err(|_| invalid(at, format!("'{word}' is not the number of a node")))?);
                }
                if begun.len() > given {
                    let nodes = begun.get(1..=corners).unwrap_or_default().to_vec();
                    listed.push((begun.first().copied().unwrap_or_default(), nodes));
                    begun.clear();
                }
            }
            Section::Aside => parsed.n_aside += usize::from(!line.ends_with(',')),
            Section::Instance => {
                let what = "an instance of a part that is moved".to_owned();
                return Err(MeshFileFault::Unsupported { what, remedy: "write the nodes at their places".into() });
            }
            Section::Other => {}
        }
    }
    for (number, nodes) in listed {
        let mut places = [0; 4];
        for (place, k) in places.iter_mut().zip([0, 1, 2, 3]) {
            let node = nodes.get(k).or(nodes.last()).copied().unwrap_or_default();
            let missing = MeshFileFault::NodeMissing { element: number, node: node as i64 };
            *place = *place_of.get(&node).ok_or(missing)?;
        }
        parsed.elements.push(FileElement { number, nodes: places, group: None });
    }
    Ok(parsed)
}
