//! Gmsh `.msh`: version 4.1 as text and binary, version 2.2 as text.

use super::{FileElement, FileNode, MeshFileFault, Parsed};
use crate::text::line_at;
use std::collections::HashMap;

/// Whether `bytes` begin as a `.msh` file does.
pub(super) fn is_msh(bytes: &[u8]) -> bool {
    bytes.trim_ascii_start().starts_with(b"$MeshFormat")
}

pub(super) fn parse(bytes: &[u8]) -> Result<Parsed, MeshFileFault> {
    let mut file = Msh { bytes, at: 0, numbers: Numbers::Text };
    let mut content = Content::default();
    let version = file.header()?;
    while let Some(section) = file.section()? {
        match (section.as_str(), version) {
            ("PhysicalNames", _) => content.names(&mut file)?,
            ("Entities", Version::V41) => content.entities(&mut file)?,
            ("Nodes", Version::V41) => content.nodes_41(&mut file)?,
            ("Elements", Version::V41) => content.elements_41(&mut file)?,
            ("Nodes" | "ParametricNodes", Version::V22) => content.nodes_22(&mut file)?,
            ("Elements", Version::V22) => content.elements_22(&mut file)?,
            _ => {} // what else a file may hold is not needed
        }
        file.end(&section)?;
    }
    content.resolve()
}

#[derive(Debug, Clone, Copy)]
enum Version {
    V41,
    V22,
}

/// How numbers are written.
#[derive(Debug, Clone, Copy)]
enum Numbers {
    Text,
    Binary {
        little: bool,
        /// Bytes of a count or a number of a node.
        word: usize,
    },
}

/// A file as it is read.
struct Msh<'a> {
    bytes: &'a [u8],
    at: usize,
    numbers: Numbers,
}

impl<'a> Msh<'a> {
    fn invalid(&self, at: usize, what: impl Into<String>) -> MeshFileFault {
        let place = match self.numbers {
            Numbers::Text => format!("line {}", line_at(self.bytes, at)),
            Numbers::Binary { .. } => format!("byte {at}"),
        };
        MeshFileFault::Invalid { place, what: what.into() }
    }

    /// What has not been read yet.
    fn rest(&self) -> &'a [u8] {
        self.bytes.get(self.at..).unwrap_or_default()
    }

    fn skip_blanks(&mut self) {
        self.at += self.rest().iter().take_while(|b| b.is_ascii_whitespace()).count();
    }

    fn skip_line(&mut self) {
        self.at += self.rest().iter().take_while(|&&b| b != b'\n' && b != b'\r').count();
    }

    /// The next word of a text, and where it begins.
    fn word(&mut self, what: &str) -> Result<(usize, &'a str), MeshFileFault> {
        self.skip_blanks();
        let start = self.at;
        let word = self.rest().split(u8::is_ascii_whitespace).next().unwrap_or_default();
        if word.is_empty() {
            return Err(MeshFileFault::Truncated(format!("it ends where {what} should stand")));
        }
        self.at += word.len();
        std::str::from_utf8(word).map(|word| (start, word)).map_err(|_| self.invalid(start, format!("no {what}")))
    }

    fn parse<T: std::str::FromStr>(&mut self, what: &str) -> Result<T, MeshFileFault> {
        let (start, word) = self.word(what)?;
        word.parse().map_err(|_| self.invalid(start, format!("'{}' where {what} should stand", shorten(word))))
    }

    /// The next `size` bytes, lowest first.
    fn take(&mut self, size: usize, little: bool, what: &str) -> Result<[u8; 8], MeshFileFault> {
        let bytes = self.bytes.get(self.at..self.at + size);
        let bytes = bytes.ok_or_else(|| MeshFileFault::Truncated(format!("it ends where {what} should stand")))?;
        self.at += size;
        let mut low_first = [0; 8];
        low_first.iter_mut().zip(bytes).for_each(|(low, byte)| *low = *byte);
        if !little {
            low_first.iter_mut().zip(bytes.iter().rev()).for_each(|(low, byte)| *low = *byte);
        }
        Ok(low_first)
    }

    /// A count, or the number of a node or an element.
    fn size(&mut self, what: &str) -> Result<u64, MeshFileFault> {
        match self.numbers {
            Numbers::Text => self.parse(what),
            Numbers::Binary { little, word } => Ok(u64::from_le_bytes(self.take(word, little, what)?)),
        }
    }

    /// A small number: a dimension, a kind, an entity, a group.
    fn int(&mut self, what: &str) -> Result<i64, MeshFileFault> {
        match self.numbers {
            Numbers::Text => self.parse(what),
            Numbers::Binary { little, .. } => {
                let [a, b, c, d, ..] = self.take(4, little, what)?;
                Ok(i32::from_le_bytes([a, b, c, d]).into())
            }
        }
    }

    fn double(&mut self, what: &str) -> Result<f64, MeshFileFault> {
        match self.numbers {
            Numbers::Text => self.parse(what),
            Numbers::Binary { little, .. } => Ok(f64::from_le_bytes(self.take(8, little, what)?)),
        }
    }

    /// Three coordinates, and `further` that are not needed.
    fn position(&mut self, further: usize) -> Result<[f64; 3], MeshFileFault> {
        let at = [self.double("a coordinate")?, self.double("a coordinate")?, self.double("a coordinate")?];
        for _ in 0..further {
            self.double("a parameter of a node")?;
        }
        Ok(at)
    }

    fn header(&mut self) -> Result<Version, MeshFileFault> {
        self.word("$MeshFormat")?;
        let (_, version) = self.word("the version of the format")?;
        let (kind_at, kind) = self.word("the kind of the file")?;
        let (word_at, word) = self.word("the size of numbers")?;
        let remedy = "save the mesh as version 4.1 (gmsh -format msh41)".to_owned();
        let read = match version {
            "4.1" => Version::V41,
            "2.2" | "2.1" | "2" => Version::V22,
            other => {
                return Err(MeshFileFault::Unsupported {
                    what: format!("version {} of .msh files", shorten(other)),
                    remedy,
                });
            }
        };
        match kind {
            "0" => {}
            "1" if matches!(read, Version::V22) => {
                return Err(MeshFileFault::Unsupported { what: "a binary .msh file of version 2.2".into(), remedy });
            }
            "1" => {
                let word = match word {
                    "8" => 8,
                    "4" => 4,
                    other => return Err(self.invalid(word_at, format!("numbers of {} bytes", shorten(other)))),
                };
                self.at += 1; // the end of the line; a 1 that shows the order of bytes follows
                let one = self.take(4, true, "the order of bytes")?;
                let little = match one[..4] {
                    [1, 0, 0, 0] => true,
                    [0, 0, 0, 1] => false,
                    _ => return Err(self.invalid(self.at - 4, "the order of bytes is not given")),
                };
                self.end("MeshFormat")?;
                self.numbers = Numbers::Binary { little, word };
                return Ok(read);
            }
            other => return Err(self.invalid(kind_at, format!("'{}' is not a kind of .msh file", shorten(other)))),
        }
        self.end("MeshFormat")?;
        Ok(read)
    }

    /// The name of the next section; `None` at the end of the file.
    fn section(&mut self) -> Result<Option<String>, MeshFileFault> {
        self.skip_blanks();
        if self.at == self.bytes.len() {
            return Ok(None);
        }
        let (start, word) = self.word("a section")?;
        match word.strip_prefix('$') {
            Some(name) if !name.is_empty() && !name.starts_with("End") => {
                // The content of a binary section begins after one line break.
                if self.bytes.get(self.at) == Some(&b'\r') {
                    self.at += 1;
                }
                self.at = (self.at + 1).min(self.bytes.len());
                Ok(Some(name.to_owned()))
            }
            _ => Err(self.invalid(start, format!("'{}' where a section should begin", shorten(word)))),
        }
    }

    /// Goes behind the end of `section`; what remains in it is passed over.
    fn end(&mut self, section: &str) -> Result<(), MeshFileFault> {
        let mark = format!("$End{section}");
        let found = self.rest().windows(mark.len()).position(|window| window == mark.as_bytes());
        let found = found.ok_or_else(|| MeshFileFault::Truncated(format!("{mark} is missing")))?;
        self.at += found + mark.len();
        Ok(())
    }
}

/// A word of a damaged file, fit for a message.
fn shorten(word: &str) -> String {
    let short: String = word.chars().take(20).collect();
    short.escape_debug().to_string()
}

/// What the sections say; nodes are named by their numbers, elements by their surface or group.
#[derive(Default)]
struct Content {
    nodes: Vec<FileNode>,
    elements: Vec<(u64, Vec<u64>, Group)>,
    /// Lines of two nodes.
    lines: Vec<(u64, Vec<u64>, Group)>,
    /// First physical group of each surface, and of each curve.
    groups: HashMap<i64, i64>,
    curve_groups: HashMap<i64, i64>,
    curve_names: HashMap<i64, String>,
    parsed: Parsed,
}

enum Group {
    OfEntity(i64),
    Is(Option<i64>),
}

impl Content {
    fn names(&mut self, file: &mut Msh<'_>) -> Result<(), MeshFileFault> {
        // This section is text in binary files as well.
        let n: u64 = file.parse("the number of groups")?;
        for _ in 0..n {
            let dimension: i64 = file.parse("the dimension of a group")?;
            let number: i64 = file.parse("the number of a group")?;
            file.skip_blanks();
            let line = file.rest().split(|b| matches!(b, b'\n' | b'\r')).next().unwrap_or_default();
            let name = String::from_utf8_lossy(line.trim_ascii());
            let name = name.strip_prefix('"').and_then(|name| name.strip_suffix('"'));
            let name = name.ok_or_else(|| file.invalid(file.at, "the name of a group is not in quotes"))?;
            file.at += line.len();
            match dimension {
                1 => drop(self.curve_names.insert(number, name.to_owned())),
                2 => drop(self.parsed.names.insert(number, name.to_owned())),
                _ => {}
            }
        }
        Ok(())
    }

    fn entities(&mut self, file: &mut Msh<'_>) -> Result<(), MeshFileFault> {
        let mut counts = [0; 4];
        for count in &mut counts {
            *count = file.size("the number of entities")?;
        }
        let [points, curves, surfaces, _] = counts;
        for _ in 0..points {
            file.int("the number of a point")?;
            file.position(0)?;
            tags(file)?;
        }
        for k in 0..curves.saturating_add(surfaces) {
            let number = file.int("the number of an entity")?;
            file.position(3)?; // its box: two corners
            let groups = tags(file)?;
            tags(file)?; // its boundary
            if let (false, &[first, second, ..]) = (k < curves, groups.as_slice()) {
                let what = format!("surface {number} in two physical groups ({first} and {second})");
                return Err(MeshFileFault::Unsupported {
                    what,
                    remedy: "a pixel belongs to one zone: keep one group".into(),
                });
            }
            if let Some(&group) = groups.first() {
                let of_kind = if k < curves { &mut self.curve_groups } else { &mut self.groups };
                of_kind.insert(number, group);
            }
        }
        Ok(())
    }

    fn nodes_41(&mut self, file: &mut Msh<'_>) -> Result<(), MeshFileFault> {
        let n_blocks = file.size("the number of blocks of nodes")?;
        for what in ["the number of nodes", "the smallest node", "the largest node"] {
            file.size(what)?;
        }
        for _ in 0..n_blocks {
            let dimension = file.int("the dimension of an entity")?;
            file.int("the number of an entity")?;
            let parametric = file.int("0 or 1")? != 0;
            let n = file.size("the number of nodes of a block")?;
            let start = self.nodes.len();
            for _ in 0..n {
                let number = file.size("the number of a node")?;
                self.nodes.push(FileNode { number, at: [0.0; 3] });
            }
            let further = if parametric { dimension.clamp(0, 3) as usize } else { 0 };
            for node in self.nodes.iter_mut().skip(start) {
                node.at = file.position(further)?;
            }
        }
        Ok(())
    }

    fn elements_41(&mut self, file: &mut Msh<'_>) -> Result<(), MeshFileFault> {
        let n_blocks = file.size("the number of blocks of elements")?;
        for what in ["the number of elements", "the smallest element", "the largest element"] {
            file.size(what)?;
        }
        for _ in 0..n_blocks {
            file.int("the dimension of an entity")?;
            let entity = file.int("the number of an entity")?;
            let kind = file.int("the kind of the elements")?;
            let n = file.size("the number of elements of a block")?;
            for _ in 0..n {
                let number = file.size("the number of an element")?;
                self.element(file, number, kind, Group::OfEntity(entity))?;
            }
        }
        Ok(())
    }

    fn nodes_22(&mut self, file: &mut Msh<'_>) -> Result<(), MeshFileFault> {
        for _ in 0..file.size("the number of nodes")? {
            let number = file.size("the number of a node")?;
            let at = file.position(0)?;
            file.skip_line(); // places on the curve or surface, of $ParametricNodes
            self.nodes.push(FileNode { number, at });
        }
        Ok(())
    }

    fn elements_22(&mut self, file: &mut Msh<'_>) -> Result<(), MeshFileFault> {
        for _ in 0..file.size("the number of elements")? {
            let number = file.size("the number of an element")?;
            let kind = file.int("the kind of an element")?;
            let n_tags = file.size("the number of tags")?;
            let mut group = None;
            for k in 0..n_tags {
                let tag = file.int("a tag")?;
                if k == 0 && tag != 0 {
                    group = Some(group_of(tag));
                }
            }
            self.element(file, number, kind, Group::Is(group))?;
        }
        Ok(())
    }

    fn element(&mut self, file: &mut Msh<'_>, number: u64, kind: i64, group: Group) -> Result<(), MeshFileFault> {
        let n = match kind {
            2 => 3,
            3 => 4,
            // Points, and lines of any order.
            15 => 1,
            1 => 2,
            8 => 3,
            26..=28 => kind - 22,
            other => return Err(MeshFileFault::ElementKind { element: number, kind: kind_name(other) }),
        };
        let nodes = (0..n).map(|_| file.size("a node of an element")).collect::<Result<Vec<_>, _>>()?;
        if matches!(kind, 2 | 3) {
            self.elements.push((number, nodes, group));
        } else {
            self.parsed.n_aside += 1;
            if kind == 1 {
                self.lines.push((number, nodes, group));
            }
        }
        Ok(())
    }

    /// Finds the nodes and groups that are named by number.
    fn resolve(self) -> Result<Parsed, MeshFileFault> {
        let Content { nodes, elements, lines, groups, curve_groups, curve_names, mut parsed } = self;
        let mut places = HashMap::with_capacity(nodes.len());
        for (place, node) in nodes.iter().enumerate() {
            if places.insert(node.number, place).is_some() {
                let what = format!("node {} is there twice", node.number);
                return Err(MeshFileFault::Invalid { place: "$Nodes".into(), what });
            }
        }
        let place = |element: u64, node: u64| {
            places.get(&node).copied().ok_or(MeshFileFault::NodeMissing { element, node: node as i64 })
        };
        let group_of = |group: Group, groups: &HashMap<i64, i64>| match group {
            Group::OfEntity(entity) => groups.get(&entity).copied(),
            Group::Is(group) => group,
        };
        for (number, names, group) in elements {
            let mut corners = [0; 4];
            for (corner, &node) in corners.iter_mut().zip(&names) {
                *corner = place(number, node)?;
            }
            if names.len() == 3 {
                corners[3] = corners[2];
            }
            parsed.elements.push(FileElement { number, nodes: corners, group: group_of(group, &groups) });
        }
        for (number, names, group) in lines {
            if let Some(name) = group_of(group, &curve_groups).and_then(|group| curve_names.get(&group)) {
                let nodes = names.iter().map(|&node| place(number, node)).collect::<Result<Vec<_>, _>>()?;
                parsed.curves.entry(name.clone()).or_default().extend(nodes);
            }
        }
        parsed.nodes = nodes;
        Ok(parsed)
    }
}

/// The first two groups of a list of tags.
fn tags(file: &mut Msh<'_>) -> Result<Vec<i64>, MeshFileFault> {
    let n = file.size("the number of tags")?;
    let mut found = Vec::new();
    for _ in 0..n {
        let group = group_of(file.int("a tag")?);
        if !found.contains(&group) && found.len() < 2 {
            found.push(group); // two say all there is to say
        }
    }
    Ok(found)
}

/// The group that a tag names: a sign is only a direction. A text may hold the one number without a positive twin.
fn group_of(tag: i64) -> i64 {
    tag.saturating_abs()
}

/// What an element is that is not taken.
fn kind_name(kind: i64) -> String {
    match kind {
        4 | 11 | 29..=31 => "a tetrahedron".into(),
        5 | 12 | 17 => "a hexahedron".into(),
        6 | 13 | 18 => "a prism".into(),
        7 | 14 | 19 => "a pyramid".into(),
        9 => "a triangle of second order (6 nodes)".into(),
        16 => "a quadrilateral of second order (8 nodes)".into(),
        10 => "a quadrilateral of second order (9 nodes)".into(),
        20..=25 => "a triangle of higher order".into(),
        other => format!("of kind {other}"),
    }
}
