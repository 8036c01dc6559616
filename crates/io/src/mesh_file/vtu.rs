//! VTK unstructured grids (`.vtu`): arrays as text, in base64 or appended, uncompressed or zlib.

use super::{FileElement, FileNode, MeshFileFault, Parsed};
use crate::text::line_at;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use flate2::read::ZlibDecoder;
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};
use std::collections::HashMap;
use std::io::Read;

/// Cell data that say which zone a cell belongs to: those of quadrille, and of meshes converted from Gmsh.
const ZONES: [&str; 2] = ["zone", "gmsh:physical"];

/// Whether `bytes` are an XML file of VTK.
pub(super) fn is_vtk_xml(bytes: &[u8]) -> bool {
    bytes.trim_ascii_start().starts_with(b"<") && find(bytes.get(..4096).unwrap_or(bytes), b"<VTKFile").is_some()
}

pub(super) fn parse(bytes: &[u8]) -> Result<Parsed, MeshFileFault> {
    let (file, pieces) = Vtu::open(bytes)?;
    let mut parsed = Parsed::default();
    for piece in pieces {
        file.add(&piece, &mut parsed)?;
    }
    Ok(parsed)
}

/// Vectors at points by their name: x and y of each point.
pub(super) type Vectors = (String, Vec<[f64; 2]>);

/// The vectors at points.
pub(super) fn vectors(bytes: &[u8]) -> Result<Vec<Vectors>, MeshFileFault> {
    let (file, pieces) = Vtu::open(bytes)?;
    let mut found: Vec<Vectors> = Vec::new();
    for array in pieces.iter().flat_map(|piece| &piece.vectors) {
        let values = file.numbers(array)?;
        let pairs = values.chunks_exact(array.components).filter_map(|v| Some([*v.first()?, *v.get(1)?]));
        match found.iter_mut().find(|(name, _)| *name == array.name) {
            Some((_, of_all)) => of_all.extend(pairs),
            None => found.push((array.name.clone(), pairs.collect())),
        }
    }
    Ok(found)
}

/// Bytes behind the XML.
#[derive(Debug, Clone, Copy)]
struct Appended<'a> {
    base64: bool,
    /// From behind the underscore to the end of the file.
    bytes: &'a [u8],
}

impl<'a> Appended<'a> {
    fn of(element: &'a [u8]) -> Result<Self, MeshFileFault> {
        let missing = || MeshFileFault::Truncated("the appended data are missing".into());
        let (head, rest) = split(element, find(element, b">").ok_or_else(missing)?);
        let base64 = find(head, b"\"raw\"").or(find(head, b"'raw'")).is_none();
        let (_, bytes) = split(rest, find(rest, b"_").ok_or_else(missing)? + 1);
        Ok(Self { base64, bytes })
    }
}

/// What is before `at`, and the rest.
fn split(bytes: &[u8], at: usize) -> (&[u8], &[u8]) {
    bytes.split_at_checked(at).unwrap_or((bytes, &[]))
}

fn find(bytes: &[u8], wanted: &[u8]) -> Option<usize> {
    bytes.windows(wanted.len()).position(|window| window == wanted)
}

/// How the file writes numbers in binary.
#[derive(Debug, Clone, Copy, Default)]
struct Encoding {
    big_endian: bool,
    /// Whether the head of an array has 64-bit numbers.
    wide: bool,
    zlib: bool,
}

/// One piece of the grid: arrays by name.
#[derive(Debug, Default)]
struct Piece {
    n_points: usize,
    n_cells: usize,
    points: Option<Array>,
    cells: HashMap<String, Array>,
    zone: Option<Array>,
    /// Vectors at its points.
    vectors: Vec<Array>,
}

impl Piece {
    /// Where an array of cells stands in the file; 0 for one that it does not have.
    fn at(&self, cells: &str) -> usize {
        self.cells.get(cells).map_or(0, |array| array.at)
    }
}

/// An array as the file has it.
#[derive(Debug)]
struct Array {
    /// Byte of the file, for messages.
    at: usize,
    name: String,
    kind: String,
    components: usize,
    content: Stored,
}

#[derive(Debug)]
enum Stored {
    Text(String),
    Base64(String),
    Appended(usize),
}

struct Vtu<'a> {
    xml: &'a [u8],
    appended: Option<Appended<'a>>,
    encoding: Encoding,
}

impl<'a> Vtu<'a> {
    /// Reads what the file is made of.
    fn open(bytes: &'a [u8]) -> Result<(Self, Vec<Piece>), MeshFileFault> {
        // What is appended may be raw bytes, which are no XML: the file is cut there.
        let (xml, behind) = split(bytes, find(bytes, b"<AppendedData").unwrap_or(bytes.len()));
        let appended = if behind.is_empty() { None } else { Some(Appended::of(behind)?) };
        let mut file = Self { xml, appended, encoding: Encoding::default() };
        let pieces = file.pieces()?;
        if appended.is_none() && find(bytes, b"</VTKFile>").is_none() {
            return Err(MeshFileFault::Truncated("its end, </VTKFile>, is missing".into()));
        }
        Ok((file, pieces))
    }

    fn invalid(&self, at: usize, what: impl Into<String>) -> MeshFileFault {
        MeshFileFault::Invalid { place: format!("line {}", line_at(self.xml, at)), what: what.into() }
    }

    /// Reads the XML: the encoding and the arrays that make the mesh.
    fn pieces(&mut self) -> Result<Vec<Piece>, MeshFileFault> {
        let mut reader = Reader::from_reader(self.xml);
        // The file may be cut at the appended data, so that not every element is closed.
        reader.config_mut().check_end_names = false;
        let mut pieces: Vec<Piece> = Vec::new();
        let mut section = String::new();
        let mut array: Option<Array> = None;
        let mut grid = false;
        loop {
            let at = reader.buffer_position() as usize;
            let event = reader.read_event().map_err(|error| self.invalid(at, format!("no XML: {error}")))?;
            let closed = matches!(event, Event::Empty(_));
            match &event {
                Event::Eof => break,
                Event::Start(element) | Event::Empty(element) => {
                    let name = element.name().as_ref().to_owned();
                    match name.as_str() {
                        "VTKFile" => self.encoding = self.encoding(element, at)?,
                        "UnstructuredGrid" => grid = true,
                        "Piece" => {
                            let n = |key| self.count(element, key, at);
                            let (n_points, n_cells) = (n("NumberOfPoints")?, n("NumberOfCells")?);
                            pieces.push(Piece { n_points, n_cells, ..Piece::default() });
                        }
                        "Points" | "Cells" | "CellData" | "PointData" | "FieldData" if !closed => section = name,
                        "DataArray" => array = Some(self.array(element, at)?),
                        _ => {}
                    }
                }
                Event::Text(text) => {
                    if let Some(Array { content: Stored::Text(words) | Stored::Base64(words), .. }) = &mut array {
                        words.push_str(text);
                    }
                }
                _ => {}
            }
            let ended = match &event {
                Event::End(element) => element.name().as_ref() == "DataArray",
                _ => closed,
            };
            if let Event::End(element) = &event
                && element.name().as_ref() == section
            {
                section.clear();
            }
            if ended
                && let Some(array) = array.take()
                && let Some(piece) = pieces.last_mut()
            {
                match section.as_str() {
                    "Points" => piece.points = Some(array),
                    "Cells" => drop(piece.cells.insert(array.name.clone(), array)),
                    "PointData" if array.components == 2 || array.components == 3 => piece.vectors.push(array),
                    "CellData" if ZONES.contains(&array.name.as_str()) => piece.zone = Some(array),
                    _ => {}
                }
            }
        }
        if !grid {
            return Err(MeshFileFault::Truncated("there is no grid in it".into()));
        }
        Ok(pieces)
    }

    fn encoding(&self, element: &BytesStart<'_>, at: usize) -> Result<Encoding, MeshFileFault> {
        let remedy = || "save it as an unstructured grid (.vtu), uncompressed or with zlib".to_owned();
        match self.attribute(element, "type", at)?.as_deref() {
            Some("UnstructuredGrid") => {}
            other => {
                let what = format!("a VTK file of the type {}", other.unwrap_or("unknown"));
                return Err(MeshFileFault::Unsupported { what, remedy: remedy() });
            }
        }
        let zlib = match self.attribute(element, "compressor", at)?.as_deref() {
            None | Some("") => false,
            Some("vtkZLibDataCompressor") => true,
            Some(other) => {
                return Err(MeshFileFault::Unsupported { what: format!("the compression {other}"), remedy: remedy() });
            }
        };
        Ok(Encoding {
            big_endian: self.attribute(element, "byte_order", at)?.as_deref() == Some("BigEndian"),
            wide: self.attribute(element, "header_type", at)?.as_deref() == Some("UInt64"),
            zlib,
        })
    }

    fn attribute(&self, element: &BytesStart<'_>, key: &str, at: usize) -> Result<Option<String>, MeshFileFault> {
        let attribute = element.try_get_attribute(key);
        let attribute = attribute.map_err(|error| self.invalid(at, format!("no XML: {error}")))?;
        Ok(attribute.map(|attribute| attribute.value.into_owned()))
    }

    fn count(&self, element: &BytesStart<'_>, key: &str, at: usize) -> Result<usize, MeshFileFault> {
        let value = self.attribute(element, key, at)?.unwrap_or_default();
        value.trim().parse().map_err(|_| self.invalid(at, format!("{key} is '{}', no count", value.escape_debug())))
    }

    fn array(&self, element: &BytesStart<'_>, at: usize) -> Result<Array, MeshFileFault> {
        let text = |key| Ok::<_, MeshFileFault>(self.attribute(element, key, at)?.unwrap_or_default());
        let content = match text("format")?.as_str() {
            "ascii" => Stored::Text(String::new()),
            "binary" => Stored::Base64(String::new()),
            "appended" => Stored::Appended(self.count(element, "offset", at)?),
            other => return Err(self.invalid(at, format!("an array of the format '{}'", other.escape_debug()))),
        };
        let components = match self.attribute(element, "NumberOfComponents", at)? {
            Some(_) => self.count(element, "NumberOfComponents", at)?,
            None => 1,
        };
        Ok(Array { at, name: text("Name")?, kind: text("type")?, components, content })
    }

    fn add(&self, piece: &Piece, parsed: &mut Parsed) -> Result<(), MeshFileFault> {
        let missing = |what: &str| MeshFileFault::Truncated(format!("a piece of the grid has no {what}"));
        if piece.n_cells == 0 && piece.points.is_none() {
            return Ok(());
        }
        let points = piece.points.as_ref().ok_or_else(|| missing("points"))?;
        if points.components != 3 {
            return Err(self.invalid(points.at, format!("points of {} components", points.components)));
        }
        let positions = self.numbers(points)?;
        self.check_length(points, positions.len(), piece.n_points.checked_mul(3))?;
        let cells = |name| piece.cells.get(name).ok_or_else(|| missing(name));
        let integers = |name, wanted: Option<usize>| {
            let array = cells(name)?;
            let values = self.integers(array)?;
            if wanted.is_some() {
                self.check_length(array, values.len(), wanted)?;
            }
            Ok::<_, MeshFileFault>(values)
        };
        let connectivity = integers("connectivity", None)?;
        let offsets = integers("offsets", Some(piece.n_cells))?;
        let kinds = integers("types", Some(piece.n_cells))?;
        let groups = match &piece.zone {
            Some(array) => {
                let groups = self.integers(array)?;
                self.check_length(array, groups.len(), Some(piece.n_cells))?;
                Some(groups)
            }
            None => None,
        };

        let (first_node, first_cell) = (parsed.nodes.len(), parsed.elements.len() + parsed.n_aside);
        parsed.nodes.extend(
            (positions.as_chunks::<3>().0.iter().zip(first_node..))
                .map(|(&at, number)| FileNode { number: number as u64, at }),
        );
        let mut start = 0;
        for (k, (&end, &kind)) in offsets.iter().zip(&kinds).enumerate() {
            let number = (first_cell + k) as u64;
            let nodes = usize::try_from(end).ok().and_then(|end| connectivity.get(start..end)).ok_or_else(|| {
                let what = format!("cell {number} ends at {end}: there are {} node numbers", connectivity.len());
                self.invalid(piece.at("offsets"), what)
            })?;
            start += nodes.len();
            let wanted = match kind {
                5 => 3,
                8 | 9 => 4,
                1..=4 | 21 | 35 => {
                    parsed.n_aside += 1;
                    continue;
                }
                other => return Err(MeshFileFault::ElementKind { element: number, kind: kind_name(other) }),
            };
            if nodes.len() != wanted {
                let what = format!("cell {number} has {} nodes instead of {wanted}", nodes.len());
                return Err(self.invalid(piece.at("connectivity"), what));
            }
            let mut corners = [0; 4];
            for (corner, &node) in corners.iter_mut().zip(nodes) {
                let place = usize::try_from(node).ok().filter(|&place| place < piece.n_points);
                *corner = first_node + place.ok_or(MeshFileFault::NodeMissing { element: number, node })?;
            }
            match kind {
                5 => corners[3] = corners[2],
                8 => corners.swap(2, 3), // a pixel is stored row by row
                _ => {}
            }
            let group = groups.as_ref().and_then(|groups| groups.get(k)).copied();
            parsed.elements.push(FileElement { number, nodes: corners, group });
        }
        // Zones of quadrille count from 0, their names from 1.
        if piece.zone.as_ref().is_some_and(|array| array.name == ZONES[0]) {
            for &group in groups.iter().flatten() {
                parsed.names.entry(group).or_insert_with(|| format!("zone{}", group.saturating_add(1)));
            }
        }
        Ok(())
    }

    fn check_length(&self, array: &Array, len: usize, wanted: Option<usize>) -> Result<(), MeshFileFault> {
        if Some(len) == wanted {
            return Ok(());
        }
        let wanted = wanted.map_or("another number".to_owned(), |n| n.to_string());
        Err(self.invalid(array.at, format!("the array '{}' has {len} numbers instead of {wanted}", array.name)))
    }

    fn numbers(&self, array: &Array) -> Result<Vec<f64>, MeshFileFault> {
        match array.kind.as_str() {
            "Float32" => self.values(array, |b| f32::from_le_bytes(b).into()),
            "Float64" => self.values(array, f64::from_le_bytes),
            _ => Ok(self.integers(array)?.into_iter().map(|v| v as f64).collect()),
        }
    }

    fn integers(&self, array: &Array) -> Result<Vec<i64>, MeshFileFault> {
        match array.kind.as_str() {
            "Int8" => self.values(array, |b| i8::from_le_bytes(b).into()),
            "UInt8" => self.values(array, |b| u8::from_le_bytes(b).into()),
            "Int16" => self.values(array, |b| i16::from_le_bytes(b).into()),
            "UInt16" => self.values(array, |b| u16::from_le_bytes(b).into()),
            "Int32" => self.values(array, |b| i32::from_le_bytes(b).into()),
            "UInt32" => self.values(array, |b| u32::from_le_bytes(b).into()),
            "Int64" => self.values(array, i64::from_le_bytes),
            // What does not fit is no number of a node either.
            "UInt64" => self.values(array, |b| i64::try_from(u64::from_le_bytes(b)).unwrap_or(-1)),
            other => {
                let what = format!("the array '{}' is of the type '{}'", array.name, other.escape_debug());
                Err(self.invalid(array.at, what))
            }
        }
    }

    /// The values of an array: words of a text, or `N` bytes each, lowest first.
    fn values<const N: usize, T: std::str::FromStr>(
        &self,
        array: &Array,
        value: fn([u8; N]) -> T,
    ) -> Result<Vec<T>, MeshFileFault> {
        let decoder = self.encoding;
        let wrong = |what: String| self.invalid(array.at, format!("the array '{}': {what}", array.name));
        let bytes = match &array.content {
            Stored::Text(text) => {
                let parse =
                    |word: &str| word.parse().map_err(|_| wrong(format!("'{}' is not a number", word.escape_debug())));
                return text.split_ascii_whitespace().map(parse).collect();
            }
            Stored::Base64(text) => decoder.base64(text.as_bytes().trim_ascii()).map_err(wrong)?,
            Stored::Appended(offset) => {
                let appended =
                    self.appended.ok_or_else(|| MeshFileFault::Truncated("the appended data are missing".into()))?;
                let place = appended.bytes.get(*offset..);
                let place = place.ok_or_else(|| MeshFileFault::Truncated("the appended data end early".into()))?;
                if appended.base64 { decoder.base64(place) } else { decoder.raw(place) }.map_err(wrong)?
            }
        };
        if bytes.len() % N != 0 {
            return Err(wrong(format!("{} bytes are not a whole number of values", bytes.len())));
        }
        let read = |bytes: &[u8]| {
            let mut number = [0; N];
            number.copy_from_slice(bytes);
            if self.encoding.big_endian {
                number.reverse();
            }
            value(number)
        };
        Ok(bytes.chunks_exact(N).map(read).collect())
    }
}

/// Unpacks an array with its head: its length in bytes, or the lengths of its compressed blocks.
impl Encoding {
    fn word(self) -> usize {
        if self.wide { 8 } else { 4 }
    }

    /// Number `k` of a head.
    fn head(self, bytes: &[u8], k: usize) -> Result<usize, String> {
        let size = self.word();
        let word = bytes.get(k * size..(k + 1) * size).ok_or("its head is not complete")?;
        let add = |number: u64, byte: &u8| number << 8 | u64::from(*byte);
        let number = if self.big_endian { word.iter().fold(0, add) } else { word.iter().rev().fold(0, add) };
        usize::try_from(number).map_err(|_| "it is too long".to_owned())
    }

    /// Number of words in the head of compressed blocks.
    fn n_head(self, bytes: &[u8]) -> Result<usize, String> {
        let words = self.head(bytes, 0)?.checked_add(3).filter(|n| n.checked_mul(self.word()).is_some());
        words.ok_or_else(|| "its head is not possible".to_owned())
    }

    fn raw(self, bytes: &[u8]) -> Result<Vec<u8>, String> {
        if !self.zlib {
            let n = self.head(bytes, 0)?;
            let (_, data) = split(bytes, self.word());
            return Ok(data.get(..n).ok_or(format!("it should have {n} bytes, more than there are"))?.to_vec());
        }
        let n_head = self.n_head(bytes)? * self.word();
        let (head, blocks) = bytes.split_at_checked(n_head).ok_or("its head is not complete")?;
        self.inflate(head, blocks)
    }

    /// The same in base64. The head may be encoded on its own, or together with what follows.
    fn base64(self, text: &[u8]) -> Result<Vec<u8>, String> {
        // Four letters for every three bytes begun.
        let letters = |n: usize| n.div_ceil(3).saturating_mul(4);
        let decode = |text: Option<&[u8]>| {
            let text = text.ok_or("it is not complete")?;
            BASE64.decode(text).map_err(|error| error.to_string())
        };
        let word = letters(self.word());
        if !self.zlib {
            let (first, rest) = text.split_at_checked(word).ok_or("it is not complete")?;
            let apart = first.ends_with(b"=");
            let n = self.head(&decode(Some(first))?, 0)?;
            if apart {
                let mut data = decode(rest.get(..letters(n)))?;
                data.truncate(n);
                return Ok(data);
            }
            let all = decode(text.get(..letters(n.saturating_add(self.word()))))?;
            return self.raw(&all);
        }
        let n_head = self.n_head(&decode(text.get(..word))?)?;
        let head_letters = letters(n_head * self.word());
        let (head, behind) = text.split_at_checked(head_letters).ok_or("it is not complete")?;
        let head = decode(Some(head))?;
        let n_blocks = n_head - 3;
        let mut packed = 0_usize;
        for k in 0..n_blocks {
            packed = packed.saturating_add(self.head(&head, 3 + k)?);
        }
        let blocks = decode(behind.get(..letters(packed)))?;
        self.inflate(&head, &blocks)
    }

    /// Unpacks the blocks that `head` lists.
    fn inflate(self, head: &[u8], mut blocks: &[u8]) -> Result<Vec<u8>, String> {
        let (n_blocks, size, last) = (self.head(head, 0)?, self.head(head, 1)?, self.head(head, 2)?);
        let mut data = Vec::new();
        for k in 0..n_blocks {
            let packed = self.head(head, 3 + k)?;
            let (block, behind) = blocks.split_at_checked(packed).ok_or("its blocks are not complete")?;
            blocks = behind;
            // The last block may be shorter; 0 says that it is not.
            let wanted = if k + 1 == n_blocks && last > 0 { last } else { size };
            let before = data.len();
            let unpacked = ZlibDecoder::new(block).take(wanted as u64).read_to_end(&mut data);
            unpacked.map_err(|error| format!("block {k} cannot be unpacked: {error}"))?;
            if data.len() - before != wanted {
                return Err(format!("block {k} has {} bytes instead of {wanted}", data.len() - before));
            }
        }
        Ok(data)
    }
}

/// What a cell is that is not taken.
fn kind_name(kind: i64) -> String {
    match kind {
        6 => "a strip of triangles".into(),
        7 => "a polygon".into(),
        10 | 24 | 71 => "a tetrahedron".into(),
        11 => "a voxel".into(),
        12 | 25 | 29 | 33 | 72 => "a hexahedron".into(),
        13 | 26 | 73 => "a prism".into(),
        14 | 27 | 74 => "a pyramid".into(),
        22 | 34 | 69 => "a triangle of second or higher order".into(),
        23 | 28 | 30 | 70 => "a quadrilateral of second or higher order".into(),
        42 => "a polyhedron".into(),
        other => format!("of the VTK type {other}"),
    }
}
