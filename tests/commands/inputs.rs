//! What users feed in, through the program: masks, polygons, mesh files, several references, pages, bit depth.

#![cfg(feature = "cli")]

use crate::program;
use program::{Desk, HEIGHT, INSIDE, Ran, WIDTH, assert_moved, moved, remarks, speckle};
use quadrille::imaging::{Image, Levels, Pixels};
use quadrille::io::csv::DisplacementRow;
use quadrille::io::mask::{MaskError, read_mask};
use quadrille::io::store::Store;
use quadrille::remark::Code;
use quadrille::synth::{Depth, RenderOptions, Texture, Translation, render};
use serde_json::Value;

/// Largest error of a node on 8 bit images; see tests/commands/cli.rs.
const ROUNDED: f64 = 0.02;

/// Asserts that every node moved by `u` within 4.5 times its standard uncertainty (one number in 150 000): at the
/// border of a region elements keep as little as half of their pixels, and so their nodes are less certain.
#[track_caller]
fn assert_moved_within_sigma(rows: &[DisplacementRow], motion: &Translation) {
    assert!(!rows.is_empty(), "the table is empty");
    for row in rows {
        for c in 0..2 {
            let (error, sigma) = (row.px.displacement[c] - motion.0[c], row.px.sigma[c]);
            assert!(error.abs() < 4.5 * sigma && sigma < 0.3, "node {} is off by {error}: {:?}", row.node, row.px);
        }
    }
}

fn image_of(level: impl Fn(usize, usize) -> u8) -> Image {
    let levels = (0..WIDTH * HEIGHT).map(|at| level(at % WIDTH, at / WIDTH)).collect();
    Image::new(WIDTH, HEIGHT, Pixels::U8(levels)).unwrap()
}

/// White in a disc about the middle of the image.
fn in_disc(x: usize, y: usize) -> bool {
    (x as f64 - 64.0).hypot(y as f64 - 48.0) < 40.0
}

/// A TIFF file with the images as pages.
fn stack(images: &[Image]) -> Vec<u8> {
    use tiff::encoder::{TiffEncoder, colortype::Gray8};
    let mut bytes = std::io::Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut bytes).unwrap();
    for image in images {
        let Levels::U8(levels) = image.pixels() else { panic!("8 bit") };
        encoder.write_image::<Gray8>(image.width() as u32, image.height() as u32, levels).unwrap();
    }
    bytes.into_inner()
}

/// The rows of all tables in `folder`, without the comments.
fn tables(desk: &Desk, folder: &str) -> Vec<String> {
    let rows = |name: String| {
        let text = desk.read(&format!("{folder}/csv/{name}"));
        text.lines().filter(|line| !line.starts_with('#')).collect::<Vec<_>>().join("\n")
    };
    desk.files(&format!("{folder}/csv")).into_iter().map(rows).collect()
}

/// Asserts that the run.toml in `folder` gives the same tables again.
#[track_caller]
fn assert_repeats(desk: &Desk, folder: &str) {
    desk.correlate(&format!("--case {folder}/run.toml --output {folder}-again")).fine();
    assert_eq!(tables(desk, folder), tables(desk, &format!("{folder}-again")));
}

fn run_toml(desk: &Desk, folder: &str) -> toml::Table {
    desk.read(&format!("{folder}/run.toml")).parse().unwrap()
}

/// Names of the frames without their folders.
fn frame_names(ran: &Ran<'_>, folder: &str) -> Vec<String> {
    let name = |frame: &Value| frame["file"].as_str().unwrap().rsplit('/').next().unwrap().to_owned();
    ran.frames(folder).iter().map(name).collect()
}

fn zone_names(ran: &Ran<'_>, folder: &str) -> Vec<String> {
    let zones = ran.frames(folder)[0]["zones"].as_array().unwrap().clone();
    zones.iter().map(|zone| zone["name"].as_str().unwrap().to_owned()).collect()
}

// ---- masks ----

#[test]
fn only_what_the_mask_shows_white_is_measured() {
    let desk = Desk::with_series();
    desk.image("mask.png", &image_of(|x, y| if in_disc(x, y) { 255 } else { 0 }));
    let ran = desk.correlate("--mask mask.png --element-size 8 --output out ref.png a.png").fine();
    assert!(ran.stderr.contains("mask.png: 40.8 % of the image is white"), "{ran}"); // pi 40^2 of 128 x 96, about
    let rows = desk.rows("out/csv/000001.csv");
    assert_moved_within_sigma(&rows, &Translation([0.25, -0.25]));
    // Elements with at least half of their pixels in the disc reach at most one diagonal (11.3 px) beyond it.
    let from_middle = |row: &DisplacementRow| (row.px.position[0] - 64.0).hypot(row.px.position[1] - 48.0);
    assert!(rows.iter().all(|row| from_middle(row) < 40.0 + 11.4), "a node outside the mask");
    // The disc has an area of 5027 px: 79 elements of 8 px, some more nodes.
    assert!((70..=120).contains(&rows.len()), "{} nodes", rows.len());
    let strict =
        desk.correlate("--mask mask.png --element-size 8 --element-share 1 --output strict ref.png a.png").fine();
    let rows = desk.rows("strict/csv/000001.csv");
    // Pixels stop one short of the far corner of their element.
    assert!(rows.iter().all(|row| from_middle(row) < 40.0 + 1.5), "with a share of 1 no element is cut");
    assert_eq!(run_toml(&desk, "strict")["correlation"]["element_share"].as_float(), Some(1.0), "{strict}");
    assert_repeats(&desk, "out");
    assert_repeats(&desk, "strict");
    // The mask is on record with its hash.
    let record = run_toml(&desk, "out");
    let file = &record["run"]["zone_file"][0];
    assert!(file["file"].as_str().unwrap().ends_with("mask.png"));
    assert_eq!(file["sha256"].as_str().unwrap().len(), 64);
}

#[test]
fn masks_of_every_depth_and_kind_say_the_same() {
    use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
    let desk = Desk::new();
    let white = |at: usize| in_disc(at % WIDTH, at / WIDTH);
    let n = WIDTH * HEIGHT;
    let png = |channels: usize, kind| {
        let levels: Vec<u8> = (0..n).flat_map(|at| vec![if white(at) { 255 } else { 0 }; channels]).collect();
        let mut bytes = Vec::new();
        PngEncoder::new(&mut bytes).write_image(&levels, WIDTH as u32, HEIGHT as u32, kind).unwrap();
        bytes
    };
    desk.write("rgb.png", png(3, ExtendedColorType::Rgb8));
    desk.write("rgba.png", png(4, ExtendedColorType::Rgba8));
    // A colour that is brighter than half, on black: yellow.
    let yellow: Vec<u8> = (0..n).flat_map(|at| if white(at) { [255, 255, 0] } else { [0; 3] }).collect();
    let mut bytes = Vec::new();
    PngEncoder::new(&mut bytes).write_image(&yellow, WIDTH as u32, HEIGHT as u32, ExtendedColorType::Rgb8).unwrap();
    desk.write("yellow.png", bytes);
    let pbm = (0..n).fold(format!("P1\n{WIDTH} {HEIGHT}\n"), |text, at| text + if white(at) { "0 " } else { "1 " });
    desk.write("bits.pbm", pbm);
    let pgm =
        (0..n).fold(format!("P2\n{WIDTH} {HEIGHT}\n100\n"), |text, at| text + if white(at) { "51 " } else { "9 " });
    desk.write("hundred.pgm", pgm);
    let levels = |high: u16| Pixels::U16((0..n).map(|at| if white(at) { high } else { 0 }).collect());
    desk.image("deep.tif", &Image::new(WIDTH, HEIGHT, levels(40_000)).unwrap());
    desk.image("deep.png", &Image::new(WIDTH, HEIGHT, levels(65535)).unwrap());
    let floats = Pixels::F32((0..n).map(|at| if white(at) { 1.0 } else { 0.0 }).collect());
    desk.image("float.tif", &Image::new(WIDTH, HEIGHT, floats).unwrap());
    let count = (0..n).filter(|&at| white(at)).count();
    for name in ["rgb.png", "rgba.png", "yellow.png", "bits.pbm", "hundred.pgm", "deep.tif", "deep.png", "float.tif"] {
        let loaded = read_mask(&desk.path(name), WIDTH, HEIGHT).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(loaded.mask.n_inside(), count, "{name}");
        assert_eq!(loaded.share, count as f64 / n as f64, "{name}");
        assert!((0..n).all(|at| loaded.mask.contains(at % WIDTH, at / WIDTH) == white(at)), "{name}");
    }
}

#[test]
fn a_mask_that_is_none_is_refused_with_what_to_do() {
    let desk = Desk::with_series();
    desk.image("black.png", &image_of(|_, _| 0));
    desk.image("ones.png", &image_of(|x, y| u8::from(in_disc(x, y))));
    desk.image("photo.png", &moved([0.0, 0.0]));
    desk.image("small.png", &Image::new(64, 48, Pixels::U8(vec![255; 64 * 48])).unwrap());
    desk.write("text.png", "no image");
    for (mask, wanted) in [
        ("black.png", &["black.png: the mask is black everywhere", "largest grey level is 0", "paint white"][..]),
        ("ones.png", &["largest grey level is 1, white is above 127.5", "multiply it"]),
        ("photo.png", &["photo.png: ", "of the pixels are grey", "looks like a photograph"]),
        ("small.png", &["small.png: the mask is 64 x 48 px, the reference image 128 x 96 px"]),
        ("text.png", &["the mask cannot be used", "text.png: not an image"]),
        ("none.png", &["the mask cannot be used", "none.png: there is no such file"]),
    ] {
        desk.correlate(&format!("--mask {mask} --output out ref.png a.png")).refused(wanted);
        assert!(desk.files("out").is_empty(), "{mask}");
    }
    let error = |name: &str| read_mask(&desk.path(name), WIDTH, HEIGHT).unwrap_err();
    assert!(matches!(error("black.png"), MaskError::Black { .. }));
    assert!(matches!(error("photo.png"), MaskError::Grey { .. }));
    assert!(matches!(error("small.png"), MaskError::Size { width: 64, image_width: WIDTH, .. }));
    assert!(matches!(error("none.png"), MaskError::Read(_)));
}

#[test]
fn grey_pixels_of_a_mask_are_mentioned() {
    let desk = Desk::with_series();
    // Every eighth column of the disc is grey, 5 % of the image.
    desk.image(
        "soft.png",
        &image_of(|x, y| match (in_disc(x, y), x % 8) {
            (true, 0) => 200,
            (true, _) => 255,
            _ => 0,
        }),
    );
    let ran = desk.correlate("--mask soft.png --element-size 8 --output out ref.png a.png").fine();
    assert!(ran.stderr.contains("soft.png: 4.9 %"), "{ran}");
    assert!(ran.stderr.contains("% of the mask is neither black nor white; above 127.5 is measured"), "{ran}");
}

// ---- polygons and the keys of a zone ----

#[test]
fn polygons_are_measured_and_repeat_from_the_record() {
    let desk = Desk::with_series();
    let left = "16,16 64,16 64,80 16,80";
    let right = "68,16 112,16 112,80 90,80";
    let words = [
        "correlate",
        "--polygon",
        left,
        "--polygon",
        right,
        "--element-size",
        "8",
        "--guard",
        "1.5",
        "--drop-textureless",
    ];
    let ran = desk.run_words(&[&words[..], &["--output", "out", "ref.png", "a.png"]].concat()).fine();
    assert_eq!(zone_names(&ran, "out"), ["zone1", "zone2"]);
    assert_moved_within_sigma(&desk.rows("out/csv/000001.csv"), &Translation([0.25, -0.25]));
    let zone = &run_toml(&desk, "out")["zone"][1];
    assert_eq!(zone["polygon"].as_array().unwrap().len(), 4);
    assert_eq!(zone["guard_px"].as_float(), Some(1.5));
    assert_repeats(&desk, "out");
    for (polygon, says) in [
        ("1,2 3,4", "fewer than three corners"),
        ("1,2 3,4 5", "instead of 2"),
        ("1,2 3,4 a,b", "not a list of 2 numbers"),
        ("1,2 3,4 nan,5", "not finite"),
    ] {
        desk.run_words(&["correlate", "--polygon", polygon, "--output", "no", "ref.png", "a.png"]).refused(&[says]);
    }
    // The sides of a bow tie cross.
    let bow = "16,16 100,80 100,16 16,80";
    let ran = desk.run_words(&["correlate", "--polygon", bow, "--output", "no", "ref.png", "a.png"]);
    ran.refused(&["zone 'zone1': the polygon crosses itself near (58"]);
}

#[test]
fn a_guard_without_zones_is_that_of_the_whole_image() {
    let desk = Desk::with_series();
    desk.correlate("--guard 4 --output out ref.png a.png").fine();
    assert_eq!(run_toml(&desk, "out")["zone"][0]["guard_px"].as_float(), Some(4.0));
    assert_repeats(&desk, "out");
    desk.correlate("--guard -1 --output no ref.png a.png").refused(&["guard is -1 px", "from 0 on"]);
    desk.correlate("--element-share 0 --output no ref.png a.png").refused(&["share", "is 0", "above 0, at most 1"]);
}

const CASE: &str = r#"
images = { reference = "ref.png", deformed = "[abc].png" }
correlation = { element_size_px = 8, element_share = 0.4, drop_textureless = true }

[[zone]]
name = "disc"
roi = [16, 16, 112, 80]
mask = "mask.png"
exclude = [[[56, 40], [72, 40], [72, 56], [56, 56]]]
guard_px = { bottom = 2 }
"#;

#[test]
fn the_keys_of_a_zone_work_together() {
    let desk = Desk::with_series();
    desk.image("in/mask.png", &image_of(|x, y| if in_disc(x, y) { 255 } else { 0 }));
    for name in ["ref.png", "a.png", "b.png", "c.png"] {
        desk.write(&format!("in/{name}"), desk.bytes(name));
    }
    desk.write("in/case.toml", CASE.replace("guard_px = { bottom = 2 }", "guard_px = 1"));
    let ran = desk.correlate("--case in/case.toml --output out").fine();
    assert_eq!(frame_names(&ran, "out"), ["a.png", "b.png", "c.png"]);
    let rows = desk.rows("out/csv/000002.csv");
    assert_moved_within_sigma(&rows, &Translation([0.5, -0.5]));
    assert!(rows.iter().all(|row| row.px.position != [64.0, 48.0]), "the hole has no node in its middle");
    assert_repeats(&desk, "out");
    // Flags replace all zones of the file.
    let ran = desk.correlate(&format!("--case in/case.toml {INSIDE} --output flags")).fine();
    assert_eq!(zone_names(&ran, "flags"), ["zone1"]);
    assert!(run_toml(&desk, "flags")["zone"][0].get("mask").is_none());
}

#[test]
fn keys_of_a_zone_that_make_no_sense_are_refused() {
    let desk = Desk::with_series();
    for (zone, wanted) in [
        ("name = 'a'", &["zone 'a' has no roi = [x0, y0, x1, y1], no polygon, mask or mesh"][..]),
        ("group = 'a'\nroi = [0, 0, 64, 64]", &["zone 'zone1' has a group but no mesh"]),
        ("polygon = []", &["zone 'zone1': a polygon of 0 corners"]),
        ("polygon = [[1, 2], [3, 4]]", &["zone 'zone1'", "polygon of 2 corners"]),
        ("polygon = [[1, 2, 3], [3, 4]]", &["line 2", "`polygon` in [[zone]]", "a point has 3 entries"]),
        ("polygon = [1, 2]", &["line 2", "`polygon` in [[zone]]", "a point [x, y]"]),
        ("exclude = [[1, 2], [3, 4]]", &["line 2", "`exclude` in [[zone]]", "a point [x, y]"]),
        ("guard_px = 'wide'", &["line 2", "`guard_px` in [[zone]]", "{ left = 0, top = 0"]),
        ("guard_px = { lower = 3 }", &["line 2", "`guard_px` in [[zone]]: unknown side `lower`", "bottom"]),
        ("polygon = [[16,16],[80,16],[80,80]]\nguard_px = { left = 3 }", &["is for the sides of a roi"]),
        ("polygon = [[16,16],[80,16],[80,80]]\nguard_px = [1, 2]", &["2 guards for 3 sides"]),
        ("polygon = [[16,16],[80,16],[80,80]]\nelements = 'mapped'", &["elements = \"mapped\"", "four corners"]),
        ("polygon = [[16,16],[80,16],[30,30],[16,80]]\nelements = 'mapped'", &["points inwards"]),
        ("mesh = 'a.msh'\nelements = 'mapped'", &["mesh file", "leave one of them out"]),
        ("roi = [16, 16, 80, 80]\nguard_px = { along = [[16, 16], [80, 16]], width = -1 }", &["guard is -1 px"]),
        ("roi = [16, 16, 80, 80]\nguard_px = -2", &["guard is -2 px"]),
        ("roi = [16, 16, 80, 80]\nguard_px = nan", &["guard is NaN px"]),
        ("roi = [16, 16, 80, 80]\nguard_px = 40", &["guard is 40 px", "leaves pixels"]),
        ("mask = 'none.png'", &["none.png: there is no such file"]),
        ("mask = 7", &["`mask` in [[zone]]", "a text in quotes"]),
    ] {
        desk.write("case.toml", format!("[[zone]]\n{zone}\n"));
        desk.correlate("--case case.toml --output out ref.png a.png").refused(wanted);
    }
}

// ---- mesh files ----

/// Two groups of quadrilaterals on either side of x = 64, one of them distorted.
const MESH: &str = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n2\n2 1 \"left\"\n2 2 \"right\"\n$EndPhysicalNames\n\
    $Nodes\n9\n1 16 16 0\n2 40 16 0\n3 64 16 0\n4 16 80 0\n5 44 80 0\n6 64 80 0\n7 104 20 0\n8 110 76 0\n9 112 48 0\n$EndNodes\n\
    $Elements\n4\n1 3 2 1 1 1 2 5 4\n2 3 2 1 1 2 3 6 5\n3 3 2 2 2 3 7 8 6\n4 2 2 2 2 7 9 8\n$EndElements\n";

#[test]
fn the_groups_of_a_mesh_file_are_zones() {
    let desk = Desk::with_series();
    desk.write("plate.msh", MESH);
    let ran = desk.correlate("--mesh plate.msh --output out ref.png a.png").fine();
    assert_eq!(zone_names(&ran, "out"), ["left", "right"]);
    let rows = desk.rows("out/csv/000001.csv");
    assert_eq!(rows.len(), 6 + 5);
    assert_moved_within_sigma(&rows, &Translation([0.25, -0.25]));
    assert_repeats(&desk, "out");
    let record = run_toml(&desk, "out");
    assert!(record["zone"][0]["mesh"].as_str().unwrap().ends_with("plate.msh"));
    assert_eq!(record["run"]["zone_file"].as_array().unwrap().len(), 1);

    desk.write("case.toml", "[[zone]]\nmesh = 'plate.msh'\ngroup = 'right'\nname = 'flange'\n");
    let ran = desk.correlate("--case case.toml --output one ref.png a.png").fine();
    assert_eq!(zone_names(&ran, "one"), ["flange"]);
    assert_repeats(&desk, "one");
    desk.write("case.toml", "[[zone]]\nmesh = 'plate.msh'\nname = 'plate'\n");
    let ran = desk.correlate("--case case.toml --output both ref.png a.png").fine();
    assert_eq!(zone_names(&ran, "both"), ["plate left", "plate right"]);
}

#[test]
fn the_grid_of_a_run_can_be_measured_with_again() {
    let desk = Desk::with_series();
    desk.correlate(&format!("{INSIDE} --output grid ref.png a.png")).fine();
    desk.correlate("--mesh grid/vtu/000001.vtu --output mesh ref.png a.png").fine();
    let (grid, mesh) = (desk.rows("grid/csv/000001.csv"), desk.rows("mesh/csv/000001.csv"));
    assert_eq!(grid.len(), mesh.len());
    for row in &grid {
        let same = mesh.iter().find(|other| other.px.position == row.px.position).expect("the same nodes");
        for c in 0..2 {
            // The same equations, summed in another order and stopped at corrections of 1e-4 px.
            assert!((same.px.displacement[c] - row.px.displacement[c]).abs() < 1e-3, "{row:?} {same:?}");
        }
    }
}

#[test]
fn zones_and_meshes_of_a_drawing_in_mm_lie_where_the_camera_sees_them() {
    const MM: f64 = 0.05;
    const K1: f64 = 0.01;
    const ORIGIN: [f64; 2] = [20.0, 76.0];
    let desk = Desk::with_series();
    // Two elements of 1.6 mm by 1.5 mm, from the lower left corner.
    let nodes = [[0.0, 0.0], [1.6, 0.0], [3.2, 0.0], [0.0, 1.5], [1.6, 1.5], [3.2, 1.5]];
    let rows = nodes.iter().zip(1..).map(|([x, y], k)| format!("{k} {x} {y} 0\n")).collect::<String>();
    desk.write(
        "part.msh",
        format!(
            "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n6\n{rows}$EndNodes\n$Elements\n2\n1 3 2 1 1 1 2 5 4\n\
             2 3 2 1 1 2 3 6 5\n$EndElements\n"
        ),
    );
    let case = |zone: &str| {
        format!(
            "[images]\nreference = \"ref.png\"\ndeformed = \"a.png\"\npixel_size_mm = {MM}\n\
             [camera]\ndistortion = [{K1}]\n[[zone]]\nname = \"part\"\n{zone}\n"
        )
    };
    // Brown's model about the middle of the image, with half the diagonal as length.
    let centre = [WIDTH, HEIGHT].map(|n| 0.5 * (n as f64 - 1.0));
    let half = 0.5 * (WIDTH as f64).hypot(HEIGHT as f64);
    let seen = |[x, y]: [f64; 2]| {
        let d = [x - centre[0], y - centre[1]];
        let factor = 1.0 + K1 * (d[0] * d[0] + d[1] * d[1]) / (half * half);
        [centre[0] + factor * d[0], centre[1] + factor * d[1]]
    };
    let mut plane = ORIGIN;
    for _ in 0..30 {
        let off = seen(plane);
        plane = [plane[0] - off[0] + ORIGIN[0], plane[1] - off[1] + ORIGIN[1]];
    }
    let turned = 10_f64.to_radians();
    let wanted = |[x, y]: [f64; 2], turn: f64| {
        let [right, up] = [turn.cos() * x - turn.sin() * y, turn.sin() * x + turn.cos() * y];
        seen([plane[0] + right / MM, plane[1] - up / MM])
    };
    let place = format!("in_mm = {{ origin_px = [{}, {}] }}", ORIGIN[0], ORIGIN[1]);
    let tilted = format!("in_mm = {{ origin_px = [{}, {}], turn_deg = 10 }}", ORIGIN[0], ORIGIN[1]);
    let rectangle = "roi = [0, 0, 3.2, 1.5]\nelements = \"mapped\"";
    for (folder, zone, turn) in [
        ("mesh", format!("mesh = \"part.msh\"\n{place}"), 0.0),
        ("turned", format!("mesh = \"part.msh\"\n{tilted}"), turned),
        ("roi", format!("{rectangle}\n{place}"), 0.0),
    ] {
        desk.write("case.toml", case(&zone));
        desk.correlate(&format!("--case case.toml --element-size 16 --output {folder}")).fine();
        let store = Store::open(desk.path(folder)).unwrap();
        let found = store.mesh().nodes();
        // Of the rectangle the corners alone: between them its sides are straight in the image.
        let of = if folder == "roi" { vec![nodes[0], nodes[2], nodes[3], nodes[5]] } else { nodes.to_vec() };
        for at in of {
            let [x, y] = wanted(at, turn);
            let near = found.iter().map(|node| (node[0] - x).hypot(node[1] - y)).fold(f64::INFINITY, f64::min);
            assert!(near < 1e-6, "{folder}: no node at ({x}, {y}): {found:?}");
        }
        // The record has the drawing, and gives the same run.
        desk.correlate(&format!("--case {folder}/run.toml --output {folder}-again")).fine();
        let again = Store::open(desk.path(&format!("{folder}-again"))).unwrap();
        assert_eq!(found, again.mesh().nodes(), "{folder}");
    }
    desk.write("case.toml", case(&format!("{rectangle}\n{place}")).replace("pixel_size_mm = 0.05", ""));
    desk.correlate("--case case.toml --output none").refused(&["zone 'part' is in mm", "--pixel-size"]);
    desk.write("case.toml", case(&format!("{rectangle}\npolygon = [[0, 0], [1, 0], [1, 1]]\n{place}")));
    desk.correlate("--case case.toml --output none").refused(&["zone 'part' is in mm and has both roi and polygon"]);
    desk.write("case.toml", case("roi = [0, 0, 3.2, 1.5]\nin_mm = { origin_px = [nan, 0] }"));
    desk.correlate("--case case.toml --output none").refused(&["in_mm"]);
}

#[test]
fn a_mesh_file_that_cannot_be_used_is_refused_with_what_to_do() {
    let desk = Desk::with_series();
    desk.write("plate.msh", MESH);
    desk.write("old.msh", MESH.replace("2.2 0 8", "4.0 0 8"));
    desk.write("solid.msh", MESH.replace("4 2 2 2 2 7 9 8", "4 4 2 2 2 7 9 8 1"));
    desk.write("empty.msh", "");
    desk.write("far.msh", MESH.replace("9 112 48", "9 200 48"));
    desk.write("folded.msh", MESH.replace("1 3 2 1 1 1 2 5 4", "1 3 2 1 1 1 5 2 4"));
    for (mesh, wanted) in [
        ("none.msh", &["none.msh: there is no such mesh file"][..]),
        ("old.msh", &["old.msh: version 4.0 of .msh files is not read", "gmsh -format msh41"]),
        ("solid.msh", &["solid.msh: element 4 is a tetrahedron"]),
        ("empty.msh", &["empty.msh: not a mesh"]),
        ("ref.png", &["ref.png: not a mesh", "bytes 89 50"]),
        ("far.msh", &["zone 'right'", "(200, 48) px"]),
        ("folded.msh", &["zone 'left': element 0", "folded"]),
    ] {
        desk.correlate(&format!("--mesh {mesh} --output out ref.png a.png")).refused(wanted);
    }
    desk.write("case.toml", "[[zone]]\nmesh = 'plate.msh'\ngroup = 'middle'\n");
    let ran = desk.correlate("--case case.toml --output out ref.png a.png");
    ran.refused(&["plate.msh: there is no group 'middle'; the file has 'left', 'right'"]);
}

// ---- several references ----

/// The test texture with noise of 4 grey levels, another one for each `frame`.
fn noisy(u: [f64; 2], frame: u64) -> Image {
    let options = RenderOptions { noise: 4.0, seed: 11, frame, ..RenderOptions::new(WIDTH, HEIGHT) };
    render(&Texture::new(7, 4.5).unwrap(), &Translation(u), &options).unwrap()
}

#[test]
fn the_mean_of_several_references_has_less_noise() {
    let desk = Desk::new();
    for k in 0..8 {
        desk.image(&format!("still_{k}.png"), &noisy([0.0; 2], k));
    }
    desk.image("a.png", &noisy([0.25, -0.25], 20));
    let error = |folder: &str| {
        let rows = desk.rows(&format!("{folder}/csv/000001.csv"));
        let squares =
            rows.iter().map(|row| (row.px.displacement[0] - 0.25).powi(2) + (row.px.displacement[1] + 0.25).powi(2));
        (squares.sum::<f64>() / (2 * rows.len()) as f64).sqrt()
    };
    desk.correlate(&format!("{INSIDE} --reference still_0.png --output one a.png")).fine();
    let words = ["--reference", "still_[0-7].png", "--roi", "16,16,112,80", "--output", "eight", "a.png"];
    let ran = desk.run_words(&[&["correlate"], &words[..]].concat()).fine();
    assert!(ran.stderr.contains("reference still_0.png and 7 more (128 x 96 px, 32-bit float)"), "{ran}");
    assert!(!ran.stderr.contains("moved"), "{ran}");
    // sqrt((1 + 1/8)/2) = 0.75 of the error in the mean over noise; 70 numbers scatter by some 10 %.
    let ratio = error("eight") / error("one");
    assert!((0.5..0.95).contains(&ratio), "{ratio}");
    let reference = &desk.json("eight/summary.json")["reference"];
    assert_eq!(reference["mean_of"].as_array().unwrap().len(), 8);
    let record = run_toml(&desk, "eight");
    assert_eq!(record["images"]["reference"].as_array().unwrap().len(), 8);
    assert_eq!(record["run"]["image"].as_array().unwrap().len(), 9);
    assert_repeats(&desk, "eight");
    // References are no frames, whatever the glob; a repeated flag and a case file say the same.
    let ran = desk.run_words(
        &[&["correlate", "--roi", "16,16,112,80", "--output", "glob"][..], &words[..2], &["*.png"]].concat(),
    );
    assert_eq!(frame_names(&ran.fine(), "glob"), ["a.png"]);
    let flags: String = (0..8).map(|k| format!("--reference still_{k}.png ")).collect();
    desk.correlate(&format!("{flags} {INSIDE} --output flags a.png")).fine();
    desk.write("case.toml", "images.reference = ['still_?.png']\n");
    desk.correlate(&format!("--case case.toml {INSIDE} --output case a.png")).fine();
    for other in ["glob", "flags", "case"] {
        assert_eq!(tables(&desk, other), tables(&desk, "eight"), "{other}");
    }
}

#[test]
fn references_between_which_something_moved_or_changed_size_are_told() {
    let desk = Desk::with_series();
    let ran = desk.correlate(&format!("{INSIDE} --reference ref.png --reference b.png --output out a.png")).fine();
    // Moved by (0.5, -0.5) px; one Gauss-Newton step finds that to some hundredths.
    let said = ran.stderr.lines().find(|line| line.contains("moved by about")).unwrap_or_else(|| panic!("{ran}"));
    assert!(
        said.starts_with("b.png: moved by about (0.") && said.contains(", -0.") && said.contains("ref.png"),
        "{said}"
    );
    let numbers: Vec<f64> = said.split(['(', ')', ',']).filter_map(|word| word.trim().parse().ok()).collect();
    assert!((numbers[0] - 0.5).abs() < 0.06 && (numbers[1] + 0.5).abs() < 0.06, "{said}");
    desk.image("small.png", &Image::new(64, 48, Pixels::U8((0..64 * 48).map(|at| (at * 7) as u8).collect())).unwrap());
    let ran = desk.correlate("--reference ref.png --reference small.png --output no a.png");
    ran.refused(&["small.png: the image is 64 x 48 px, the reference ref.png 128 x 96 px"]);
    let ran = desk.correlate("--reference ref.png --reference none.png --output no a.png");
    ran.refused(&["none.png: there is no such file"]);
    desk.run_words(&["correlate", "--reference", "none*.png", "--output", "no", "a.png"])
        .refused(&["`none*.png` matches no file"]);
}

// ---- depth and saturation ----

#[test]
fn the_bits_that_are_used_are_said() {
    let desk = Desk::new();
    // 16 bit renderings are 257 times the grey level of 255: brought to 12 bits, at either end of the 16.
    let twelve = |u: [f64; 2], shift: u32| {
        let Pixels::U16(levels) = speckle(&Translation(u), Depth::U16).into_pixels() else { panic!("16 bit") };
        Image::new(WIDTH, HEIGHT, Pixels::U16(levels.iter().map(|v| (v >> 4) << shift).collect())).unwrap()
    };
    for (shift, said) in [
        (0, "16 bit file, 12 bits used: grey levels 0..4095"),
        (4, "16 bit file, 12 bits used: grey levels are multiples of 16"),
    ] {
        let folder = format!("out{shift}");
        desk.image("ref.tif", &twelve([0.0, 0.0], shift));
        desk.image("a.tif", &twelve([0.25, -0.25], shift));
        let ran = desk.correlate(&format!("{INSIDE} --output {folder} ref.tif a.tif")).fine();
        assert!(ran.stderr.contains(&format!("ref.tif: {said}")), "{ran}");
        let reference = desk.json(&format!("{folder}/summary.json"))["reference"].clone();
        assert_eq!(reference["bits_used"], 12);
        assert_eq!(reference["depth"], "16 bit");
        assert_moved(&desk.rows(&format!("{folder}/csv/000001.csv")), &Translation([0.25, -0.25]), ROUNDED);
    }
}

#[test]
fn the_share_of_saturated_pixels_is_counted_in_the_zones_and_said_when_it_is_much() {
    let desk = Desk::new();
    // Everything brighter than 180 is lost; outside the zone all is black.
    let clipped = |u: [f64; 2], limit: u8| {
        let Pixels::U8(levels) = moved(u).into_pixels() else { panic!("8 bit") };
        image_of(|x, y| match levels[y * WIDTH + x] {
            _ if !(8..120).contains(&x) => 0,
            v if v >= limit => 255,
            v => v.max(1),
        })
    };
    desk.image("ref.png", &clipped([0.0, 0.0], 255));
    desk.image("a.png", &clipped([0.25, -0.25], 180));
    let ran = desk.correlate(&format!("{INSIDE} --output out ref.png a.png"));
    let percent = |value: &Value| value["saturated_percent"].as_f64().unwrap();
    assert!(percent(&desk.json("out/summary.json")["reference"]) < 1.0, "{ran}");
    let Pixels::U8(levels) = clipped([0.25, -0.25], 180).into_pixels() else { panic!("8 bit") };
    let inside = (16..80).flat_map(|y| (16..112).map(move |x| y * WIDTH + x));
    let white = inside.filter(|&at| levels[at] == 255).count() as f64;
    let wanted = 100.0 * white / (96.0 * 64.0);
    let found = percent(&ran.frames("out")[0]);
    assert!(wanted > 1.0 && (found - wanted).abs() < 1e-9, "{found} instead of {wanted}");
    let said = &remarks(&ran.frames("out")[0], Code::ImageSaturated)[0];
    assert_eq!([said.number("black_percent"), said.number("white_percent")], [Some(0.0), Some(found)], "{said:?}");
    assert!(said.text.contains("% at 255)"), "{said:?}");
    // Floats have no largest level.
    desk.image("ref.tif", &speckle(&Translation([0.0, 0.0]), Depth::F32));
    desk.image("a.tif", &speckle(&Translation([0.25, -0.25]), Depth::F32));
    let ran = desk.correlate(&format!("{INSIDE} --output float ref.tif a.tif")).fine();
    assert!(ran.frames("float")[0].get("saturated_percent").is_none());
    assert!(desk.json("float/summary.json")["reference"].get("bits_used").is_none());
}

// ---- pages ----

#[test]
fn a_stack_alone_is_a_series_that_begins_with_its_reference() {
    let desk = Desk::new();
    let pages: Vec<Image> = (0..4).map(|k| moved([0.25 * f64::from(k), 0.0])).collect();
    desk.write("stack.tif", stack(&pages));
    let ran = desk.correlate(&format!("{INSIDE} --output out stack.tif")).fine();
    assert_eq!(frame_names(&ran, "out"), ["stack.tif[1]", "stack.tif[2]", "stack.tif[3]"]);
    assert!(ran.stderr.contains("reference stack.tif[0] (128 x 96 px"), "{ran}");
    assert!(!ran.stderr.contains("--page chooses"), "{ran}");
    for k in 1..4 {
        let shift = 0.25 * k as f64;
        assert_moved(&desk.rows(&format!("out/csv/{k:06}.csv")), &Translation([shift, 0.0]), ROUNDED);
    }
    let record = run_toml(&desk, "out");
    assert_eq!(record["images"]["pages"].as_str(), Some("all"));
    let images = record["run"]["image"].as_array().unwrap();
    assert_eq!(images.iter().map(|image| image["page"].as_integer().unwrap()).collect::<Vec<_>>(), [0, 1, 2, 3]);
    assert!(images.iter().all(|image| image["sha256"] == images[0]["sha256"]), "one file has one hash");
    assert_repeats(&desk, "out");
    // Another page as the reference.
    let ran = desk.correlate(&format!("{INSIDE} --page 2 --pages all --output two stack.tif")).fine();
    assert_eq!(frame_names(&ran, "two"), ["stack.tif[0]", "stack.tif[1]", "stack.tif[3]"]);
    assert_moved(&desk.rows("two/csv/000001.csv"), &Translation([-0.5, 0.0]), ROUNDED);
    assert_repeats(&desk, "two");
}

#[test]
fn pages_are_frames_beside_a_reference_of_their_own_and_of_several_files_when_asked() {
    let desk = Desk::with_series();
    let shifts = |shifts: &[f64]| stack(&shifts.iter().map(|&u| moved([u, -u])).collect::<Vec<_>>());
    desk.write("one.tif", shifts(&[0.25, 0.5]));
    desk.write("two.tif", shifts(&[0.75, 1.0]));
    let ran = desk.correlate(&format!("{INSIDE} --reference ref.png --output alone one.tif")).fine();
    assert_eq!(frame_names(&ran, "alone"), ["one.tif[0]", "one.tif[1]"]);
    assert_repeats(&desk, "alone");
    let ran =
        desk.correlate(&format!("{INSIDE} --pages all --reference ref.png --output both one.tif a.png two.tif")).fine();
    assert_eq!(frame_names(&ran, "both"), ["one.tif[0]", "one.tif[1]", "a.png", "two.tif[0]", "two.tif[1]"]);
    assert_moved(&desk.rows("both/csv/000005.csv"), &Translation([1.0, -1.0]), ROUNDED);
    assert_repeats(&desk, "both");
    // Several files: one page of each, which is said, unless all are asked for.
    let ran = desk.correlate(&format!("{INSIDE} --reference ref.png --output first one.tif two.tif")).fine();
    assert_eq!(frame_names(&ran, "first"), ["one.tif", "two.tif"]);
    let said = &remarks(&ran.frames("first")[0], Code::ImageFile)[0].text;
    assert!(said.contains("2 pages: page 0 is read; --page chooses another, --pages all"), "{ran}");
    let ran = desk.correlate(&format!("{INSIDE} --reference two.tif --page 1 --output second one.tif")).fine();
    assert_eq!(frame_names(&ran, "second"), ["one.tif"]);
    assert_moved(&desk.rows("second/csv/000001.csv"), &Translation([-0.5, 0.5]), ROUNDED);
    desk.correlate("--pages some --output no one.tif").refused(&["--pages", "'some' is not 'all'"]);
    desk.write("case.toml", "[images]\npages = 'some'\n");
    desk.correlate("--case case.toml --output no one.tif").refused(&["line 2", "unknown word `some`", "`all`"]);
}

#[test]
fn a_page_that_cannot_be_used_is_one_bad_frame() {
    let desk = Desk::new();
    let small = Image::new(64, 48, Pixels::U8((0..64 * 48).map(|at| (at * 7) as u8).collect())).unwrap();
    desk.write("stack.tif", stack(&[moved([0.0; 2]), small, moved([0.5, 0.0])]));
    let ran = desk.correlate(&format!("{INSIDE} --output out stack.tif")).incomplete();
    assert_eq!(ran.statuses("out"), ["unreadable", "converged"]);
    let said = &remarks(&ran.frames("out")[0], Code::FrameUnreadable)[0].text;
    assert!(said.contains("stack.tif[1]: the image is 64 x 48 px"), "{said}");
    assert_moved(&desk.rows("out/csv/000002.csv"), &Translation([0.5, 0.0]), ROUNDED);
}

#[test]
fn thumbnails_among_the_pages_are_no_frames() {
    let desk = Desk::new();
    let pages = [moved([0.0; 2]), moved([0.25, 0.0]), moved([0.5, 0.0])];
    let mut bytes = stack(&pages);
    // The encoder writes no subfile type: the tag of the resolution unit (296) of page 1 becomes one (254)...
    let first = u32::from_le_bytes(bytes[4..8].try_into().unwrap()) as usize;
    let entries = |bytes: &[u8], at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]) as usize;
    let next = |bytes: &[u8], at: usize| {
        let link = at + 2 + 12 * entries(bytes, at);
        u32::from_le_bytes(bytes[link..link + 4].try_into().unwrap()) as usize
    };
    let second = next(&bytes, first);
    let mut unit = (0..entries(&bytes, second)).map(|k| second + 2 + 12 * k);
    let unit = unit.find(|&at| bytes[at..at + 2] == 296_u16.to_le_bytes()).expect("a resolution unit");
    // ... with the value 1, a reduced image.
    bytes[unit..unit + 2].copy_from_slice(&254_u16.to_le_bytes());
    bytes[unit + 8..unit + 10].copy_from_slice(&1_u16.to_le_bytes());
    desk.write("stack.tif", bytes);
    let ran = desk.correlate(&format!("{INSIDE} --output out stack.tif")).fine();
    assert_eq!(frame_names(&ran, "out"), ["stack.tif[2]"]);
}
