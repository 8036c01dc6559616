//! Mesh files: every variant of `.msh` and `.vtu` gives the same zones, broken files are refused in words.

use crate::common::data;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use flate2::{Compression, write::ZlibEncoder};
use quadrille::field::{Measurement, Status};
use quadrille::io::mesh_file::{MeshFile, MeshFileError, parse_mesh, read_mesh};
use quadrille::io::vtk::write_vtu;
use quadrille::mesh::{Mesh, Roi, Zone, ZoneElements};
use quadrille::units::PixelSize;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;
use std::process::Command;

/// Two quadrilaterals and a triangle in two groups that share an edge:
///
/// ```text
/// 30 --- 7 --- 20
///  |  A  |  A  | \ B
/// 40 --- 3 --- 10 - 50
/// ```
///
/// The numbers of the nodes are neither in order nor without gaps, and 99 belongs to nothing.
const NODES: [(u64, [f64; 2]); 8] = [
    (30, [8.0, 8.25]),
    (7, [24.0, 8.0]),
    (20, [40.0, 8.0]),
    (40, [8.0, 24.0]),
    (3, [24.5, 24.0]),
    (10, [40.0, 24.125]),
    (50, [52.0, 24.0]),
    (99, [f64::NAN, 0.0]),
];
const QUADS: [[u64; 4]; 2] = [[30, 7, 3, 40], [7, 20, 10, 3]];
const TRIANGLE: [u64; 3] = [20, 50, 10];

fn place(number: u64) -> usize {
    NODES.iter().position(|(there, _)| *there == number).unwrap()
}

/// The zones in which the test mesh is to be read.
fn wanted(names: [&str; 2]) -> Vec<ZoneElements> {
    let at = |number| NODES[place(number)].1;
    vec![
        ZoneElements {
            name: names[0].into(),
            nodes: [30, 7, 3, 40, 20, 10].map(at).into(),
            elements: vec![[0, 1, 2, 3], [1, 4, 5, 2]],
        },
        ZoneElements { name: names[1].into(), nodes: [20, 50, 10].map(at).into(), elements: vec![[0, 1, 2, 2]] },
    ]
}

#[track_caller]
fn parse(bytes: impl AsRef<[u8]>) -> MeshFile {
    parse_mesh(bytes.as_ref(), Path::new("plate.msh")).unwrap_or_else(|error| panic!("{error}"))
}

/// The error, and that its message is one line with the file's name and all of `says`.
#[track_caller]
fn refused(bytes: impl AsRef<[u8]>, says: &[&str]) -> MeshFileError {
    let error = match parse_mesh(bytes.as_ref(), Path::new("plate.msh")) {
        Ok(mesh) => panic!("read as {mesh:?}"),
        Err(error) => error,
    };
    let said = error.to_string();
    assert!(said.starts_with("plate.msh") && !said.contains('\n'), "{said}");
    for says in says {
        assert!(said.contains(says), "'{says}' is not said: {said}");
    }
    error
}

// ---- Gmsh ----

/// Writes numbers as text or binary.
struct MshWriter {
    /// `None` for text, else whether the lowest byte comes first.
    little: Option<bool>,
    bytes: Vec<u8>,
}

impl MshWriter {
    fn line(&mut self, text: &str) {
        self.bytes.extend(text.bytes());
        self.bytes.push(b'\n');
    }

    fn put(&mut self, mut low_first: Vec<u8>, text: String) {
        match self.little {
            None => self.bytes.extend(format!("{text} ").bytes()),
            Some(little) => {
                if !little {
                    low_first.reverse();
                }
                self.bytes.extend(low_first);
            }
        }
    }

    fn sizes(&mut self, values: &[u64]) {
        values.iter().for_each(|v| self.put(v.to_le_bytes().into(), v.to_string()));
    }

    fn ints(&mut self, values: &[i32]) {
        values.iter().for_each(|v| self.put(v.to_le_bytes().into(), v.to_string()));
    }

    fn doubles(&mut self, values: &[f64]) {
        values.iter().for_each(|v| self.put(v.to_le_bytes().into(), v.to_string()));
    }
}

/// The test mesh as version 4.1.
fn msh_41(little: Option<bool>) -> Vec<u8> {
    let mut out = MshWriter { little, bytes: Vec::new() };
    out.line("$MeshFormat");
    out.line(if little.is_none() { "4.1 0 8" } else { "4.1 1 8" });
    if little.is_some() {
        out.ints(&[1]);
        out.line("");
    }
    out.line("$EndMeshFormat");
    out.line("$PhysicalNames\n3\n1 9 \"edge\"\n2 4 \"upper \\\"A\\\" 1\"\n2 6 \"B\"\n$EndPhysicalNames");
    out.line("$Entities");
    out.sizes(&[1, 1, 2, 0]);
    out.ints(&[1]); // a point, in no group
    out.doubles(&[8.0, 8.0, 0.0]);
    out.sizes(&[0]);
    out.ints(&[1]); // a curve in group 9
    out.doubles(&[8.0, 8.0, 0.0, 40.0, 8.0, 0.0]);
    out.sizes(&[1]);
    out.ints(&[9]);
    out.sizes(&[2]);
    out.ints(&[1, -2]);
    for (surface, group) in [(11, 4), (12, -6)] {
        out.ints(&[surface]);
        out.doubles(&[8.0, 8.0, 0.0, 52.0, 24.0, 0.0]);
        out.sizes(&[1]);
        out.ints(&[group]);
        out.sizes(&[1]);
        out.ints(&[1]);
    }
    out.line("\n$EndEntities");
    out.line("$Nodes");
    out.sizes(&[2, 8, 3, 99]);
    // The first block is parametric: each position is followed by a parameter.
    for (dimension, parametric, nodes) in [(1, 1, &NODES[..3]), (2, 0, &NODES[3..])] {
        out.ints(&[dimension, 1, parametric]);
        out.sizes(&[nodes.len() as u64]);
        nodes.iter().for_each(|(number, _)| out.sizes(&[*number]));
        for (_, [x, y]) in nodes {
            out.doubles(&[*x, *y, 0.5]);
            if parametric == 1 {
                out.doubles(&[0.75]);
            }
        }
    }
    out.line("\n$EndNodes");
    out.line("$Periodic\nwhat this is does not matter\n$EndPeriodic");
    out.line("$Elements");
    out.sizes(&[4, 5, 1, 5]);
    for (dimension, entity, kind, elements) in [
        (0, 1, 15, vec![vec![1, 30]]),
        (1, 1, 1, vec![vec![2, 30, 7]]),
        (2, 11, 3, QUADS.iter().enumerate().map(|(k, q)| [&[3 + k as u64], &q[..]].concat()).collect()),
        (2, 12, 2, vec![[&[5], &TRIANGLE[..]].concat()]),
    ] {
        out.ints(&[dimension, entity, kind]);
        out.sizes(&[elements.len() as u64]);
        elements.iter().for_each(|numbers| out.sizes(numbers));
    }
    out.line("\n$EndElements");
    out.bytes
}

/// The test mesh as text of version 2.2.
fn msh_22() -> String {
    let mut text = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n2\n2 4 \"upper \\\"A\\\" 1\"\n2 6 \"B\"\n\
                    $EndPhysicalNames\n$Nodes\n8\n"
        .to_owned();
    for (number, [x, y]) in NODES {
        writeln!(text, "{number} {x} {y} 0.5").unwrap();
    }
    text += "$EndNodes\n$Elements\n5\n1 15 2 9 1 30\n2 1 2 9 1 30 7\n";
    for (k, [a, b, c, d]) in QUADS.into_iter().enumerate() {
        writeln!(text, "{} 3 2 4 11 {a} {b} {c} {d}", 3 + k).unwrap();
    }
    let [a, b, c] = TRIANGLE;
    writeln!(text, "5 2 3 6 12 0 {a} {b} {c}\n$EndElements").unwrap();
    text
}

const GROUPS: [&str; 2] = ["upper \\\"A\\\" 1", "B"];

#[test]
fn every_variant_of_msh_gives_the_same_zones_by_number_and_group() {
    let windows = String::from_utf8(msh_41(None)).unwrap().replace('\n', "\r\n").into_bytes();
    let all = [msh_41(None), msh_41(Some(true)), msh_41(Some(false)), msh_22().into_bytes(), windows];
    for (variant, bytes) in all.iter().enumerate() {
        let mesh = parse(bytes);
        assert_eq!(mesh.zones, wanted(GROUPS), "variant {variant}");
        assert_eq!(mesh.notes, ["2 points and lines left aside"], "variant {variant}");
    }
}

#[test]
fn without_groups_all_elements_are_one_zone_and_with_groups_others_are_left_aside() {
    let text = msh_22();
    let without = text.replace(" 2 4 11 ", " 2 0 11 ").replace(" 3 6 12 ", " 3 0 12 ");
    let mesh = parse(&without);
    assert_eq!((mesh.zones.len(), mesh.zones[0].name.as_str()), (1, "mesh"));
    assert_eq!(mesh.zones[0].elements, [[0, 1, 2, 3], [1, 4, 5, 2], [4, 6, 5, 5]]);
    let some = text.replace(" 2 4 11 ", " 0 ");
    let mesh = parse(&some);
    assert_eq!(mesh.zones, wanted(GROUPS)[1..]);
    assert!(mesh.notes.contains(&"elements in no group left aside: 2".to_owned()), "{:?}", mesh.notes);
    let unnamed = text.replace("2 6 \"B\"", "1 6 \"B\"");
    assert_eq!(parse(&unnamed).zones[1].name, "group6");
}

#[test]
fn one_group_can_be_asked_for_by_name() {
    let path = Path::new("plate.msh");
    let mesh = parse(msh_22());
    assert_eq!(mesh.clone().group("B", path).unwrap(), wanted(GROUPS)[1]);
    let error = mesh.group("C", path).unwrap_err();
    assert!(matches!(error, MeshFileError::NoGroup { .. }));
    assert!(error.to_string().starts_with("plate.msh: there is no group 'C'; the file has 'upper"), "{error}");
}

// ---- VTK ----

/// How a `.vtu` file is written.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Format {
    Ascii,
    /// In base64, the head encoded together with the data or apart.
    Binary {
        apart: bool,
    },
    AppendedRaw,
    AppendedBase64,
}

#[derive(Debug, Clone, Copy)]
struct Vtu {
    format: Format,
    wide: bool,
    big_endian: bool,
    zlib: bool,
    /// Type of the node numbers.
    integers: &'static str,
    /// Name of the cell data that tell the zones apart.
    zone: &'static str,
}

const PLAIN: Vtu =
    Vtu { format: Format::Ascii, wide: true, big_endian: false, zlib: false, integers: "Int64", zone: "zone" };

impl Vtu {
    fn bytes(self, kind: &str, values: &[f64]) -> Vec<u8> {
        let one = |v: f64| -> Vec<u8> {
            match kind {
                "Float64" => v.to_le_bytes().into(),
                "Float32" => (v as f32).to_le_bytes().into(),
                "Int32" => (v as i32).to_le_bytes().into(),
                "UInt8" => vec![v as u8],
                _ => (v as i64).to_le_bytes().into(),
            }
        };
        values.iter().flat_map(|&v| self.ordered(one(v))).collect()
    }

    fn ordered(self, mut low_first: Vec<u8>) -> Vec<u8> {
        if self.big_endian {
            low_first.reverse();
        }
        low_first
    }

    fn head(self, numbers: &[usize]) -> Vec<u8> {
        let one = |n: usize| match self.wide {
            true => (n as u64).to_le_bytes().to_vec(),
            false => (n as u32).to_le_bytes().to_vec(),
        };
        numbers.iter().flat_map(|&n| self.ordered(one(n))).collect()
    }

    /// Head and data of an array; compressed in blocks of 20 bytes, the last of which is shorter.
    fn parts(self, data: &[u8]) -> (Vec<u8>, Vec<u8>) {
        if !self.zlib {
            return (self.head(&[data.len()]), data.to_vec());
        }
        const BLOCK: usize = 20;
        let blocks: Vec<Vec<u8>> = data
            .chunks(BLOCK)
            .map(|block| {
                let mut out = ZlibEncoder::new(Vec::new(), Compression::default());
                out.write_all(block).unwrap();
                out.finish().unwrap()
            })
            .collect();
        let sizes = blocks.iter().map(Vec::len);
        let head: Vec<usize> = [blocks.len(), BLOCK, data.len() % BLOCK].into_iter().chain(sizes).collect();
        (self.head(&head), blocks.concat())
    }

    fn write(self) -> Vec<u8> {
        let (types, zones): (&[f64], &[f64]) = (&[3.0, 9.0, 8.0, 5.0], &[0.0, 0.0, 0.0, 1.0]);
        let points: Vec<f64> = NODES.iter().flat_map(|(_, [x, y])| [*x, *y, 0.5]).collect();
        let node = |number: u64| place(number) as f64;
        // The second quadrilateral is written as a pixel, which goes row by row.
        let [a, b, c, d] = QUADS[1];
        let lists = [&[30, 7][..], &QUADS[0], &[a, b, d, c], &TRIANGLE];
        let connectivity: Vec<f64> = lists.concat().into_iter().map(node).collect();
        let mut appended = Vec::new();
        let mut array = |name: &str, kind: &str, components: usize, values: &[f64]| {
            let open = format!(
                "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"{}\"",
                match self.format {
                    Format::Ascii => "ascii",
                    Format::Binary { .. } => "binary",
                    _ => "appended",
                }
            );
            let (head, data) = self.parts(&self.bytes(kind, values));
            let encoded = |apart: bool| match apart || self.zlib {
                true => BASE64.encode(&head) + &BASE64.encode(&data),
                false => BASE64.encode([head.clone(), data.clone()].concat()),
            };
            let offset = appended.len();
            match self.format {
                Format::Ascii => {
                    let words: Vec<String> = values.iter().map(ToString::to_string).collect();
                    return format!("{open}>\n {}\n</DataArray>\n", words.join(" "));
                }
                Format::Binary { apart } => return format!("{open}>\n {}\n</DataArray>\n", encoded(apart)),
                Format::AppendedRaw => appended.extend([head, data].concat()),
                Format::AppendedBase64 => appended.extend(encoded(false).bytes()),
            }
            format!("{open} offset=\"{offset}\"/>\n")
        };
        let order = if self.big_endian { "BigEndian" } else { "LittleEndian" };
        let compressor = if self.zlib { " compressor=\"vtkZLibDataCompressor\"" } else { "" };
        let head_type = if self.wide { " header_type=\"UInt64\"" } else { "" };
        let mut text = format!(
            "<?xml version=\"1.0\"?>\n<!-- a comment -->\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" \
             byte_order=\"{order}\"{head_type}{compressor}>\n<UnstructuredGrid>\n<FieldData>\n{}</FieldData>\n\
             <Piece NumberOfPoints=\"8\" NumberOfCells=\"4\">\n",
            array("zone", "Float64", 1, &[7.0])
        );
        let mut section = |name: &str, arrays: &[String]| {
            write!(text, "<{name}>\n{}</{name}>\n", arrays.concat()).unwrap();
        };
        section("PointData", &[array("zone", "Float32", 1, &[1.0; 8])]);
        section("CellData", &[array("other", "Float64", 1, &[9.0; 4]), array(self.zone, "Int32", 1, zones)]);
        section("Points", &[array("Points", "Float64", 3, &points)]);
        let offsets = array("offsets", self.integers, 1, &[2.0, 6.0, 10.0, 13.0]);
        section(
            "Cells",
            &[array("connectivity", self.integers, 1, &connectivity), offsets, array("types", "UInt8", 1, types)],
        );
        text += "</Piece>\n</UnstructuredGrid>\n";
        let mut bytes = text.into_bytes();
        if matches!(self.format, Format::AppendedRaw | Format::AppendedBase64) {
            let encoding = if self.format == Format::AppendedRaw { "raw" } else { "base64" };
            bytes.extend(format!("<AppendedData encoding=\"{encoding}\">\n _").bytes());
            bytes.extend(appended);
            bytes.extend(b"\n</AppendedData>\n");
        }
        bytes.extend(b"</VTKFile>\n");
        bytes
    }
}

fn vtu_variants() -> Vec<Vtu> {
    use Format::{AppendedBase64, AppendedRaw, Ascii, Binary};
    let formats = [Ascii, Binary { apart: false }, Binary { apart: true }, AppendedRaw, AppendedBase64];
    let mut variants = Vec::new();
    for format in formats {
        for bits in 0..8 {
            let integers = if bits & 1 == 0 { "Int64" } else { "Int32" };
            let (wide, big_endian, zlib) = (bits & 1 == 0, bits & 2 != 0, bits & 4 != 0);
            variants.push(Vtu { format, wide, big_endian, zlib, integers, zone: "zone" });
        }
    }
    variants.push(Vtu { zone: "gmsh:physical", ..PLAIN });
    variants
}

#[test]
fn every_variant_of_vtu_gives_the_same_zones() {
    for variant in vtu_variants() {
        let names = if variant.zone == "zone" { ["zone1", "zone2"] } else { ["group0", "group1"] };
        let mesh = parse_mesh(&variant.write(), Path::new("a.vtu")).unwrap_or_else(|e| panic!("{variant:?}: {e}"));
        assert_eq!(mesh.zones, wanted(names), "{variant:?}");
        assert_eq!(mesh.notes, ["1 point or line left aside"], "{variant:?}");
    }
    // Without cell data for zones the cells are one.
    assert_eq!(parse(Vtu { zone: "material", ..PLAIN }.write()).zones.len(), 1);
}

#[test]
fn pieces_of_a_grid_are_put_together() {
    let text = String::from_utf8(PLAIN.write()).unwrap();
    let piece = &text[text.find("<Piece").unwrap()..text.find("</UnstructuredGrid>").unwrap()];
    let points = |below: f64| {
        let points: Vec<String> = NODES.iter().map(|(_, [x, y])| format!("{x} {} 0.5", y + below)).collect();
        points.join(" ")
    };
    assert!(piece.contains(&points(0.0)));
    let mesh = parse(text.replace(piece, &[piece, &piece.replace(&points(0.0), &points(100.0))].concat()));
    assert_eq!(mesh.zones[0].elements.len(), 4);
    assert_eq!(mesh.zones[0].nodes.len(), 12, "the pieces share no node");
}

#[test]
fn a_vtu_file_of_quadrille_is_read_back_as_the_mesh_it_was() {
    let roi = |x0, y0, x1, y1| Roi { x0, y0, x1, y1 };
    let zones = [
        Zone::rectangle("upper", roi(0.5, 2.0, 33.0, 35.0)),
        Zone::rectangle("lower -- <&>", roi(4.0, 40.25, 52.0, 57.0)),
    ];
    let mesh = Mesh::on_zones(&zones, 16, 64, 64).unwrap();
    let (n_nodes, n_elements) = (mesh.n_nodes(), mesh.n_elements());
    let measurement = Measurement {
        mesh: mesh.into(),
        status: Status::Converged,
        displacement: vec![[0.25, -0.5]; n_nodes],
        sigma: vec![[0.01; 2]; n_nodes],
        measured: vec![true; n_nodes],
        element_residual: vec![1.0; n_elements],
        model_error: None,
        marks: None,
        points: None,
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("000001.vtu");
    write_vtu(std::fs::File::create(&path).unwrap(), "frame 1", &measurement, None, 255.0).unwrap();
    let read = read_mesh(&path).unwrap();
    assert_eq!(read.sha256.len(), 64);
    let mesh = &measurement.mesh;
    for (zone, elements) in read.zones.iter().enumerate() {
        assert_eq!(elements.name, format!("zone{}", zone + 1));
        // Nodes come in the order in which the elements name them.
        let positions = |nodes: &[[f64; 2]], corners: [u32; 4]| corners.map(|node| nodes[node as usize]);
        let found: Vec<_> = elements.elements.iter().map(|&corners| positions(&elements.nodes, corners)).collect();
        let wanted = &mesh.elements()[mesh.zone_elements(zone)];
        assert_eq!(found, wanted.iter().map(|&corners| positions(mesh.nodes(), corners)).collect::<Vec<_>>());
        assert_eq!(elements.nodes.len(), mesh.zone_nodes(zone).len());
    }
}

// ---- what is wrong with files ----

#[test]
fn files_that_are_no_mesh_are_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let error = read_mesh(&folder.path().join("none.msh")).unwrap_err();
    assert!(matches!(error, MeshFileError::NotFound { .. }) && error.to_string().contains("none.msh"), "{error}");
    let error = read_mesh(folder.path()).unwrap_err();
    assert!(matches!(error, MeshFileError::Io { .. }), "{error}");
    for (bytes, begins) in [("", "the text \"\""), ("solid plate", "solid plate"), ("\u{1}\u{2}", "01 02")] {
        let error = refused(bytes, &["not a mesh", begins, "version 4.1", ".vtu"]);
        assert!(matches!(error, MeshFileError::NotAMesh { .. }));
    }
}

#[test]
fn versions_and_variants_that_are_not_read_are_named_with_what_to_do() {
    let version = |line: &str| msh_22().replace("2.2 0 8", line);
    for (bytes, what) in [
        (version("4.0 0 8"), "version 4.0"),
        (version("1.0 0 8"), "version 1.0"),
        (version("2.2 1 8"), "a binary .msh file of version 2.2"),
    ] {
        let error = refused(bytes, &[what, "save the mesh as version 4.1"]);
        assert!(matches!(error, MeshFileError::Unsupported { .. }));
    }
    let text = String::from_utf8(PLAIN.write()).unwrap();
    for (there, instead, what) in [
        ("\"UnstructuredGrid\"", "\"PolyData\"", "a VTK file of the type PolyData"),
        (" byte_order=", " compressor=\"vtkLZ4DataCompressor\" byte_order=", "the compression vtkLZ4DataCompressor"),
    ] {
        let error = refused(text.replacen(there, instead, 1), &[what, "unstructured grid (.vtu)"]);
        assert!(matches!(error, MeshFileError::Unsupported { .. }));
    }
}

#[test]
fn elements_that_cannot_be_used_are_named() {
    let msh = |kind: u32, nodes: &str| {
        format!("{}\n7 {kind} 0 {nodes}\n$EndElements\n", cut(&msh_22(), "$EndElements"))
            .replace("$Elements\n5", "$Elements\n6")
    };
    for (kind, name) in [
        (4, "a tetrahedron"),
        (5, "a hexahedron"),
        (6, "a prism"),
        (7, "a pyramid"),
        (9, "a triangle of second order (6 nodes)"),
        (16, "a quadrilateral of second order (8 nodes)"),
        (10, "a quadrilateral of second order (9 nodes)"),
        (21, "a triangle of higher order"),
        (77, "of kind 77"),
    ] {
        let error = refused(msh(kind, "3 7 10 20 30 40"), &["element 7 is", name, "four-node quadrilaterals"]);
        assert!(matches!(error, MeshFileError::ElementKind { element: 7, .. }));
    }
    let vtu = String::from_utf8(PLAIN.write()).unwrap();
    for (kind, name) in [
        (7, "a polygon"),
        (10, "a tetrahedron"),
        (12, "a hexahedron"),
        (22, "a triangle of second"),
        (99, "VTK type 99"),
    ] {
        let error = refused(vtu.replace("3 9 8 5", &format!("3 9 8 {kind}")), &["element 3 is", name]);
        assert!(matches!(error, MeshFileError::ElementKind { element: 3, .. }));
    }
}

fn cut<'a>(text: &'a str, at: &str) -> &'a str {
    text[..text.find(at).unwrap()].trim_end()
}

#[test]
fn wrong_nodes_are_named() {
    let text = msh_22();
    let error =
        refused(text.replace("\n50 52 24", "\n51 52 24"), &["element 5 has the node 50, which is not in the file"]);
    assert!(matches!(error, MeshFileError::NodeMissing { element: 5, node: 50, .. }));
    let vtu = String::from_utf8(PLAIN.write()).unwrap();
    let numbers = "0 1 0 1 4 3 1 2 4 5 2 6 5";
    assert!(vtu.contains(numbers));
    for number in [8, -1, i64::MAX] {
        let error =
            refused(vtu.replace(numbers, &format!("0 1 0 1 4 3 1 2 4 5 2 {number} 5")), &["element 3 has the node"]);
        assert!(matches!(error, MeshFileError::NodeMissing { element: 3, node, .. } if node == number));
    }
    for bad in ["nan", "-inf", "1e999"] {
        let error = refused(text.replace("\n10 40 ", &format!("\n10 {bad} ")), &["node 10 is at (", "must be finite"]);
        assert!(matches!(error, MeshFileError::NotFinite { node: 10, .. }));
    }
    for z in ["0.51", "nan"] {
        let moved = text.replace("\n10 40 24.125 0.5", &format!("\n10 40 24.125 {z}"));
        let error = refused(moved, &["node 10 has z = ", "node 30 z = 0.5", "in the image plane"]);
        assert!(matches!(error, MeshFileError::NotFlat { node: 10, other: 30, .. }));
    }
    let error = refused(text.replace("\n3 24.5", "\n7 24.5"), &["node 7 is there twice"]);
    assert!(matches!(error, MeshFileError::Invalid { .. }));
}

#[test]
fn parametric_nodes_of_gmsh_are_nodes() {
    let mut text = String::new();
    for line in msh_22().lines() {
        let is_node = line.ends_with(" 0.5");
        writeln!(text, "{line}{}", if is_node { " 2 1 0.25 0.75" } else { "" }).unwrap();
    }
    let mesh = parse(text.replace("Nodes\n", "ParametricNodes\n"));
    assert_eq!(mesh.zones, wanted(GROUPS));
}

#[test]
fn elements_that_would_count_twice_and_sides_that_gape_are_named() {
    let msh = |nodes: &[[f64; 2]], elements: &[&[u32]]| {
        let mut text = format!("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{}\n", nodes.len());
        for (k, [x, y]) in nodes.iter().enumerate() {
            writeln!(text, "{} {x} {y} 0", k + 1).unwrap();
        }
        writeln!(text, "$EndNodes\n$Elements\n{}", elements.len()).unwrap();
        for (k, nodes) in elements.iter().enumerate() {
            let names: Vec<String> = nodes.iter().map(u32::to_string).collect();
            writeln!(text, "{} {} 0 {}", 11 + k, nodes.len() - 1, names.join(" ")).unwrap();
        }
        text + "$EndElements\n"
    };
    let grid: Vec<[f64; 2]> = (0..9).map(|k| [16.0 * f64::from(k % 3), 16.0 * f64::from(k / 3)]).collect();
    let quads: [&[u32]; 4] = [&[1, 2, 5, 4], &[2, 3, 6, 5], &[4, 5, 8, 7], &[5, 6, 9, 8]];
    assert_eq!(parse(msh(&grid, &quads)).zones[0].elements.len(), 4);
    // The same once more, with its nodes in another order; the same with nodes of its own.
    let twice = [&quads[..], &[&[5, 4, 1, 2]]].concat();
    let error = refused(msh(&grid, &twice), &["elements 11 and 15 have the same nodes"]);
    assert!(matches!(error, MeshFileError::Twice { element: 11, other: 15, .. }));
    let own = [&grid[..], &[[0.0, 0.0], [16.0, 0.0], [16.0, 16.0], [0.0, 16.0]]].concat();
    let error = refused(msh(&own, &[&quads[..], &[&[10, 11, 12, 13]]].concat()), &["lie over each other"]);
    assert!(matches!(error, MeshFileError::Overlap { .. }));
    let over = [&grid[..], &[[8.0, 8.0], [24.0, 9.0], [23.0, 24.0]]].concat();
    refused(msh(&over, &[&quads[..], &[&[10, 11, 12]]].concat()), &["and 15 lie over each other"]);
    // A long element beside two short ones: the node between these hangs.
    let error =
        refused(msh(&grid, &[quads[0], quads[1], &[4, 6, 9, 7]]), &["node 5 of element", "a side of element 13"]);
    assert!(matches!(error, MeshFileError::Hanging { node: 5, element: 13, .. }));
    // Doubled nodes along a crack lie over each other, and elements touch there.
    let crack = [&grid[..], &[[16.0, 16.0], [32.0, 16.0]]].concat();
    assert_eq!(parse(msh(&crack, &[quads[0], quads[1], quads[2], &[10, 11, 9, 8]])).zones[0].elements.len(), 4);
}

#[test]
fn a_file_without_elements_says_what_it_has_instead() {
    let lines = msh_22().replace("$Elements\n5", "$Elements\n2");
    let error = refused(lines, &["no quadrilateral and no triangle (but 2 points and lines)"]);
    assert!(matches!(error, MeshFileError::Empty { .. }));
    refused("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n", &["no quadrilateral and no triangle;"]);
    let empty = "<VTKFile type=\"UnstructuredGrid\"><UnstructuredGrid></UnstructuredGrid></VTKFile>";
    refused(empty, &["no quadrilateral"]);
}

#[test]
fn damage_is_named_with_its_line() {
    let text = msh_22();
    for (bytes, says) in [
        (text.replace("\n7 24 8 0.5", "\n7 24 eight 0.5"), "line 12: 'eight' where a coordinate should stand"),
        (text.replace("$Nodes\n8", "$Nodes\nmany"), "line 10: 'many' where the number of nodes"),
        (text.replace("$EndMeshFormat\n", "$EndMeshFormat\nwhat\n"), "line 4: 'what' where a section should begin"),
        (text.replace("2 6 \"B\"", "2 6 B"), "line 7: the name of a group is not in quotes"),
        (text.replace("2.2 0 8", "2.2 3 8"), "line 2: '3' is not a kind"),
        (text.replace("2.2 0 8", "4.1 1 7"), "line 2: numbers of 7 bytes"),
        (text.replace("2.2 0 8", "4.1 1 8"), "line 3: the order of bytes is not given"),
    ] {
        let error = refused(bytes, &[says, "copy or save it again"]);
        assert!(matches!(error, MeshFileError::Invalid { .. }));
    }
    for (bytes, says) in [
        (cut(&text, "$EndElements").to_owned(), "$EndElements is missing"),
        (cut(&text, "$EndPhysicalNames").to_owned(), "$EndPhysicalNames is missing"),
        (text[..text.find("\n20 ").unwrap()].to_owned(), "ends where"),
    ] {
        let error = refused(bytes, &["is cut off", says]);
        assert!(matches!(error, MeshFileError::Truncated { .. }));
    }
    let vtu = String::from_utf8(PLAIN.write()).unwrap();
    for (there, instead, says) in [
        ("<Piece NumberOfPoints=\"8\"", "<Piece NumberOfPoints=\"9\"", "'Points' has 24 numbers instead of 27"),
        ("NumberOfCells=\"4\"", "NumberOfCells=\"x\"", "NumberOfCells is 'x', no count"),
        ("NumberOfComponents=\"3\"", "NumberOfComponents=\"2\"", "points of 2 components"),
        ("2 6 10 13", "2 6 10 14", "cell 3 ends at 14: there are 13 node numbers"),
        ("2 6 10 13", "2 5 10 13", "cell 1 has 3 nodes instead of 4"),
        ("2 6 10 13", "2 6 ten 13", "'ten' is not a number"),
        ("<DataArray type=\"Int64\"", "<DataArray type=\"Text\"", "is of the type 'Text'"),
        ("format=\"ascii\"", "format=\"morse\"", "an array of the format 'morse'"),
        ("<CellData>", "<CellData", "no XML"),
    ] {
        let error = refused(vtu.replace(there, instead), &["line ", says]);
        assert!(matches!(error, MeshFileError::Invalid { .. }), "{error}");
    }
    for (there, says) in [("Points", "has no points"), ("Cells", "has no connectivity")] {
        let without = vtu.replace(&format!("<{there}>"), "<Away>").replace(&format!("</{there}>"), "</Away>");
        let error = refused(without, &["is cut off", says]);
        assert!(matches!(error, MeshFileError::Truncated { .. }));
    }
    refused(cut(&vtu, "</UnstructuredGrid>"), &["</VTKFile>, is missing"]);
}

/// A zone of its own elements.
fn whole(elements: ZoneElements) -> Zone {
    Zone { name: elements.name.clone(), elements: Some(elements.into()), ..Zone::default() }
}

/// What becomes of a file that may be damaged: whatever is read is laid over an image, and a place in it looked for.
fn used(bytes: &[u8]) {
    let Ok(file) = parse_mesh(bytes, Path::new("a")) else { return };
    let zones: Vec<_> = file.zones.into_iter().map(whole).collect();
    if let Ok(mesh) = Mesh::on_zones(&zones, 16, 64, 64) {
        for zone in 0..zones.len() {
            let _ = mesh.locate(zone, 20.0, 20.0);
        }
        let _ = mesh.to_mm(PixelSize::new(0.1).unwrap()).locate(0, 1.0, -1.0);
    }
}

#[test]
fn no_number_in_a_mesh_file_makes_a_mesh_that_panics() {
    let text = msh_22();
    let wrong =
        ["0", "1", "-1", "9", "8.000001", "1e-320", "4e-160", "1e-9", "1e9", "1e155", "1e308", "-1e308", "4294967295"];
    let tokens: Vec<(usize, &str)> =
        text.split_whitespace().map(|t| (t.as_ptr() as usize - text.as_ptr() as usize, t)).collect();
    for &(at, token) in tokens.iter().filter(|(_, token)| token.parse::<f64>().is_ok()) {
        for wrong in wrong {
            used([&text[..at], wrong, &text[at + token.len()..]].concat().as_bytes());
        }
    }
    // All coordinates together: elements of every size from the smallest number to the largest.
    for exponent in (-320..309).step_by(3) {
        let nodes = text.split("$Nodes\n").nth(1).unwrap().split("$EndNodes").next().unwrap();
        let scaled: Vec<String> = nodes
            .lines()
            .map(|line| {
                let parts: Vec<&str> = line.split(' ').collect();
                match parts.as_slice() {
                    [n, x, y, z] => format!("{n} {x}e{exponent} {y}e{exponent} {z}"),
                    _ => line.to_owned(),
                }
            })
            .collect();
        used(text.replace(nodes, &(scaled.join("\n") + "\n")).as_bytes());
    }
}

#[test]
fn no_damage_makes_the_readers_panic_or_hang() {
    let mut files = vec![msh_41(None), msh_41(Some(true)), msh_41(Some(false)), msh_22().into_bytes()];
    use Format::{AppendedBase64, AppendedRaw, Binary};
    for format in [Binary { apart: false }, Binary { apart: true }, AppendedRaw, AppendedBase64] {
        files.push(Vtu { format, ..PLAIN }.write());
        files.push(Vtu { format, zlib: true, wide: false, ..PLAIN }.write());
    }
    files.push(PLAIN.write());
    let path = Path::new("a");
    for whole in files {
        assert!(parse_mesh(&whole, path).is_ok());
        for len in 0..whole.len() {
            used(&whole[..len]);
        }
        let mut damaged = whole.clone();
        for at in 0..whole.len() {
            for flip in [0x01, 0x02, 0x08, 0x10, 0x40, 0x80, 0xff] {
                damaged[at] = whole[at] ^ flip;
                if flip == 0x10 { used(&damaged) } else { drop(parse_mesh(&damaged, path)) }
            }
            damaged[at] = whole[at];
        }
        // Runs of bytes that are huge numbers.
        for at in 0..whole.len().saturating_sub(8) {
            damaged[at..at + 8].fill(0xff);
            let _ = parse_mesh(&damaged, path);
            damaged[at..at + 8].copy_from_slice(&whole[at..at + 8]);
        }
    }
    // In a text, the one number that has no positive twin.
    let least = format!(" 2 {} 11 ", i64::MIN);
    assert_eq!(parse(msh_22().replace(" 2 4 11 ", &least)).zones.len(), 2);
}

// ---- files by others ----

/// A real mesh of Gmsh (triangles about a hole), where the folder of real images is there.
#[test]
fn a_mesh_of_gmsh_is_read() {
    let Some(folder) = data::folder("dicchallenge-s12-openhole/reference") else { return };
    let mesh = read_mesh(&folder.join("fe-global-plate-hole.msh")).unwrap();
    // Counted in the file: 1255 nodes, of which 1098 are corners of its 2049 triangles; 146 points, 309 lines.
    assert_eq!(mesh.zones.len(), 1);
    assert_eq!((mesh.zones[0].nodes.len(), mesh.zones[0].elements.len()), (1098, 2049));
    assert!(mesh.zones[0].elements.iter().all(|e| e[2] == e[3]));
    assert_eq!(mesh.notes, ["455 points and lines left aside"]);
    let free = Mesh::<quadrille::units::Px>::from_zones(mesh.zones).unwrap();
    // The area of the plate, 316 x 985 px about, less the hole of radius 50 or so: each triangle has half the
    // area that `element_size` squares; here only that the sizes are those of the drawing, about 13 px.
    assert!((9.0..16.0).contains(&free.element_size()), "{}", free.element_size());
}

/// meshio writes the test mesh in every format it has for us, and each is read as the same mesh.
#[test]
fn files_of_meshio_are_read() {
    let asked = std::env::var("QUADRILLE_PYTHON").ok();
    let python = asked.clone().unwrap_or_else(|| "python3".into());
    let script = "
import sys, meshio, numpy
points = numpy.array([[8, 8.25, 0], [24, 8, 0], [24.5, 24, 0], [8, 24, 0], [40, 8, 0], [40, 24.125, 0], [52, 24, 0]])
cells = [('quad', numpy.array([[0, 1, 2, 3], [1, 4, 5, 2]])), ('triangle', numpy.array([[4, 6, 5]]))]
data = {'zone': [numpy.array([0, 0]), numpy.array([1])]}
tags = {'gmsh:physical': [numpy.array([4, 4]), numpy.array([6])], 'gmsh:geometrical': [numpy.array([1, 1]), numpy.array([2])]}
names = {'upper': numpy.array([4, 2]), 'B': numpy.array([6, 2])}
flat = meshio.Mesh(points, cells, cell_data=data)
quads = meshio.Mesh(points[:6], cells[:1])
named = meshio.Mesh(points, cells, cell_data=tags, field_data=names)
for name, mesh, form, options in [
    ('binary.vtu', flat, 'vtu', {}), ('raw.vtu', flat, 'vtu', {'compression': None}),
    ('text.vtu', flat, 'vtu', {'binary': False}),
    ('binary.msh', quads, 'gmsh', {}), ('text.msh', quads, 'gmsh', {'binary': False}),
    ('old.msh', named, 'gmsh22', {'binary': False}),
]:
    meshio.write(sys.argv[1] + '/' + name, mesh, file_format=form, **options)
";
    let folder = tempfile::tempdir().unwrap();
    let ran = Command::new(&python).arg("-c").arg(script).arg(folder.path()).output();
    if !ran.as_ref().is_ok_and(|output| output.status.success()) {
        let said = ran.map(|output| String::from_utf8_lossy(&output.stderr).into_owned());
        assert!(asked.is_none(), "QUADRILLE_PYTHON is '{python}', which cannot write meshes: {said:?}");
        println!("SKIPPED: no meshio in {python}; set QUADRILLE_PYTHON");
        return;
    }
    for (name, zones) in [
        ("binary.vtu", &["zone1", "zone2"][..]),
        ("raw.vtu", &["zone1", "zone2"]),
        ("text.vtu", &["zone1", "zone2"]),
        ("binary.msh", &["mesh"]),
        ("text.msh", &["mesh"]),
        ("old.msh", &["upper", "B"]),
    ] {
        let mesh = read_mesh(&folder.path().join(name)).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(mesh.zones.iter().map(|zone| zone.name.as_str()).collect::<Vec<_>>(), zones, "{name}");
        let corners = mesh.zones.iter().flat_map(|zone| {
            zone.elements.iter().map(|corners| corners.map(|node| zone.nodes[node as usize])).collect::<Vec<_>>()
        });
        let [a, b] = QUADS.map(|quad| quad.map(|number| NODES[place(number)].1));
        let [c, d, e] = TRIANGLE.map(|number| NODES[place(number)].1);
        // meshio writes version 4.1 with one kind of cells only.
        let wanted = [a, b, [c, d, e, e]];
        let n = if zones == ["mesh"] { 2 } else { 3 };
        assert_eq!(corners.collect::<Vec<_>>(), wanted[..n], "{name}");
    }
}
