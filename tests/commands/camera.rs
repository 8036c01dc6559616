//! The camera as a user meets it: calibrated from images moved by hand, taken off, and reckoned with where nobody
//! states it. The renderer draws spots where lens and tilt put them, and owes nothing to the program.

#![cfg(feature = "cli")]

use crate::common::board::{Board, Pinhole, Pose, Print, photographed};
use crate::common::spots::Spots;
use crate::program;
use program::Desk;
use quadrille::imaging::Image;
use quadrille::remark::Code;
use std::sync::Arc;

const SIDE: usize = 512;
const SIGMA: f64 = 2.2;

/// A lens with distortion `k1` at the corner, and a plane whose scale falls by `tilt` per px along x.
#[derive(Clone, Copy)]
struct Lens {
    k1: f64,
    tilt: f64,
}

impl Lens {
    fn pixel(self, [x, y]: [f64; 2]) -> [f64; 2] {
        let middle = 0.5 * (SIDE as f64 - 1.0);
        let (x, y) = (x - middle, y - middle);
        let w = 1.0 + self.tilt * x;
        let (x, y) = (x / w, y / w);
        let corner = 0.5 * (2.0 * (SIDE * SIDE) as f64).sqrt();
        let grown = 1.0 + self.k1 * (x * x + y * y) / (corner * corner);
        [middle + x * grown, middle + y * grown]
    }

    /// Speckles of the plane moved by `shift` and stretched by `strain` along x, 8 bit, with noise of one grey level.
    fn image(self, shift: [f64; 2], strain: f64, seed: u64) -> Arc<Image> {
        let place = |at: [f64; 2]| self.pixel([at[0] * (1.0 + strain) + shift[0], at[1] + shift[1]]);
        Spots::random(SIDE, SIGMA, 4).image([SIDE; 2], 1.0, seed, place)
    }
}

const ZONE: &str = "--roi 40,40,456,456 --element-size 26";
/// A gauge from the middle to the right, in the mean over most of the height: on one that lies even about the middle what
/// the lens does at both ends cancels.
const GAUGE: &str = "--extensometer 256,250,446,250 --width 300";

/// Value, uncertainty by noise and by the camera of the strain of the gauge, in microstrain.
#[track_caller]
fn gauge(desk: &Desk, folder: &str) -> [Option<f64>; 3] {
    desk.run(&format!("probe {folder} {GAUGE}")).fine();
    let text = desk.read(&format!("{folder}/quantities/extensometers.csv"));
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_reader(text.as_bytes());
    let header = reader.headers().unwrap().clone();
    let row = reader.records().next().unwrap().unwrap();
    ["strain_engineering", "sigma_strain_engineering", "camera_strain_engineering"].map(|name| {
        let at = header.iter().position(|column| column == name)?;
        Some(1e6 * row[at].parse::<f64>().unwrap())
    })
}

#[test]
fn a_camera_is_found_on_images_moved_by_hand_and_a_gauge_reads_the_truth_with_it() {
    let (desk, lens) = (Desk::new(), Lens { k1: 5e-3, tilt: 1e-4 });
    for (name, shift, strain, seed) in [
        ("a", [0.0, 0.0], 0.0, 1),
        ("b", [31.0, 2.0], 0.0, 2),
        ("c", [-3.0, 29.0], 0.0, 3),
        ("d", [22.0, 4.0], 2e-3, 4),
    ] {
        desk.image(&format!("{name}.png"), &lens.image(shift, strain, seed));
    }
    let line = format!("calibrate {ZONE} a.png b.png c.png --length 100,100,400,100,15 --output cal");
    let said = desk.run(&line).printed();
    assert!(said.contains("k1: 0.") && said.contains("known to") && said.contains("scale: 1 px = 0.0"), "{said}");
    assert!(!said.contains("a shift across is missing") && !said.contains("more than noise"), "{said}");
    assert!(desk.path("cal/figures/000001-ux.png").is_file() && desk.read("cal/camera.toml").starts_with("# Camera"));
    desk.correlate(&format!("{ZONE} --output raw a.png d.png")).fine();
    desk.correlate(&format!("{ZONE} --camera cal/camera.toml --output plane a.png d.png")).fine();
    let [before, after] = ["raw", "plane"].map(|folder| gauge(&desk, folder));
    let [Some(value), Some(sigma), Some(camera)] = after else { panic!("{after:?}") };
    // Without a camera it is off by the lens, by more than noise; with it by noise and what is known of the camera.
    assert!((before[0].unwrap() - 2000.0).abs() > 10.0 * before[1].unwrap(), "{before:?}");
    assert!((value - 2000.0).abs() < 3.0 * sigma.hypot(camera), "{after:?}");
    // The same camera after the run: the store holds raw px.
    desk.run(&format!("probe raw {GAUGE} --camera cal/camera.toml --output later")).fine();
    let table = |folder: &str| {
        let text = desk.read(&format!("{folder}/quantities/extensometers.csv"));
        text.lines().filter(|line| !line.starts_with('#')).map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(table("later"), table("plane"));
    desk.write("small.toml", "[camera]\nimage_size_px = [100, 100]\ndistortion = [0.001]");
    desk.run(&format!("probe raw {GAUGE} --camera small.toml")).refused(&["100 x 100 px, these have 512 x 512 px"]);
    desk.run(&format!("probe raw {GAUGE} --camera no.toml")).refused(&["no such camera file"]);
    // Columns in mm are those of the plane.
    let rows = desk.rows("plane/csv/000001.csv");
    let corner = rows.first().unwrap();
    let mm = corner.mm.unwrap();
    let scale = mm.position[0] / corner.px.position[0];
    // The tilt shrinks this side by some per cent; a px is one of the middle.
    assert!((scale / 0.05 - 1.0).abs() < 0.3 && corner.px.position == [40.0, 40.0], "{corner:?}");
    desk.run("export plane --to nodemap").fine();
    let nodemap = desk.read("plane/nodemap/000001.txt");
    let first = nodemap.lines().find(|line| !line.starts_with('#')).unwrap();
    let x_undef: f64 = first.split(';').nth(1).unwrap().trim().parse().unwrap();
    assert!((x_undef / mm.position[0] - 1.0).abs() < 1e-12, "{first} {mm:?}");
    // A model of the motion differs by noise in the plane, and by the lens in the image.
    let places = (0..18).flat_map(|j| (0..18).map(move |i| [26.0 * f64::from(i), 26.0 * f64::from(j)]));
    let rows = places.map(|[x, y]| format!("{x},{y},{},4\n", 22.0 + 2e-3 * x)).collect::<String>();
    desk.write("model.csv", format!("x,y,u,v\n{rows}"));
    let off = |folder: &str| {
        desk.run(&format!("compare {folder} model.csv --unit px --y down")).printed();
        let found = desk.json(&format!("{folder}/comparison/000001.json"));
        ["rms_sigma", "rms_sigma_with_camera"].map(|name| found[name].as_f64())
    };
    // One set of uncertain numbers is behind all nodes: 11 of them are as one sigma, or 1.6 in one of a hundred draws.
    let ([Some(noise), Some(with)], [Some(without), _]) = (off("plane"), off("raw")) else { panic!() };
    assert!(with < noise && with < 1.6 && without > 3.0, "{noise} {with} {without}");
    // The camera that drew them is exact: noise is all that is left.
    let middle = 0.5 * (SIDE as f64 - 1.0);
    desk.write(
        "exact.toml",
        format!(
            "[camera]\nexact = true\ndistortion = [5e-3]\ntilt_per_px = [1e-4, 0.0]\ncentre_px = [{middle}, {middle}]"
        ),
    );
    desk.correlate(&format!("{ZONE} --camera exact.toml --output exact a.png d.png")).fine();
    let [exact, none] = off("exact");
    assert!((0.85..1.15).contains(&exact.unwrap()) && none.is_none(), "{exact:?} {none:?}");
    // A usual lens is said where nothing is stated, and not where something is.
    let [said, silent] = ["raw", "plane"].map(|folder| desk.remarks(folder, Code::LensUnknown));
    assert!(said.len() == 1 && silent.is_empty(), "{said:?} {silent:?}");
}

#[test]
fn nothing_stated_is_a_usual_lens_that_rings_where_it_would_be_seen_and_exact_is_none() {
    let (desk, lens) = (Desk::new(), Lens { k1: 1e-3, tilt: 0.0 });
    desk.image("a.png", &lens.image([0.0, 0.0], 0.0, 1));
    desk.image("b.png", &lens.image([10.15, 0.0], 0.0, 2));
    desk.image("c.png", &lens.image([0.2, 0.0], 0.0, 3));
    desk.correlate(&format!("{ZONE} --output far a.png b.png")).fine();
    desk.correlate(&format!("{ZONE} --output near a.png c.png")).fine();
    desk.write("exact.toml", "[camera]\nexact = true\n");
    desk.correlate(&format!("{ZONE} --case exact.toml --output exact a.png b.png")).fine();
    let rings = |folder: &str| desk.remarks(folder, Code::LensUnknown).len();
    assert_eq!([rings("far"), rings("near"), rings("exact")], [1, 0, 0]);
    let [value, sigma, camera] = gauge(&desk, "far");
    // The lens is the usual one: the gauge is off by what its column says, 3 q d a/R^2 = 44 microstrain for its length a,
    // beside the 100 of a usual change of the distance.
    let (value, sigma, camera) = (value.unwrap(), sigma.unwrap(), camera.unwrap());
    let lens = (camera * camera - 1e4).sqrt();
    assert!((value.abs() - lens).abs() < 4.0 * sigma && (20.0..100.0).contains(&lens), "{value} {sigma} {camera}");
    assert_eq!(gauge(&desk, "exact")[2], None);
    desk.write("stated.toml", "[camera]\ndistortion = [1e-3]\ndistortion_std = [1e-5]\ndistance_std = 0\n");
    desk.correlate(&format!("{ZONE} --case stated.toml --output stated a.png b.png")).fine();
    let [value, sigma, camera] = gauge(&desk, "stated").map(Option::unwrap);
    assert!(value.abs() < 3.0 * sigma.hypot(camera) && camera < 1.0, "{value} {sigma} {camera}");
}

#[test]
fn what_is_no_camera_of_these_images_is_one_clear_line() {
    let desk = Desk::with_series();
    let inside = program::INSIDE;
    let refused = |name: &str, text: &str, part: &str| {
        desk.write(name, text);
        let ran = desk.correlate(&format!("{inside} --camera {name} --output out ref.png a.png"));
        ran.refused(&[part]);
        assert!(!desk.path("out/fields.zarr").exists());
    };
    refused("turned.toml", "[camera]\nimage_size_px = [96, 128]\ndistortion = [0.001]", "they are turned");
    refused(
        "binned.toml",
        "[camera]\nimage_size_px = [256, 192]\ndistortion = [0.001]",
        "256 x 192 px, these have 128 x 96 px",
    );
    refused("folded.toml", "[camera]\ndistortion = [-0.7]", "folds inside the image");
    refused("nan.toml", "[camera]\ndistortion = [nan]", "k1 is NaN");
    refused("std.toml", "[camera]\ndistortion_std = [-1.0]", "uncertainty of k1 is -1");
    refused("other.toml", "[images]\n", "no section [camera]");
    refused("camera.yml", "a: 1\n", "no camera_matrix");
    refused(
        "fish.json",
        "{\"K\": [[100, 0, 64], [0, 100, 48], [0, 0, 1]], \"D\": [0, 0, 0, 0, 0, 0.5]}",
        "k4 is not zero",
    );
    let missing = desk.correlate(&format!("{inside} --camera no.toml --output out ref.png a.png"));
    missing.refused(&["no such camera file"]);
    let still = desk.run(&format!("calibrate {inside} ref.png a.png --output cal"));
    assert!(still.code == Some(2) && still.stderr.contains("moved by at most 0."), "{still}");
    desk.run(&format!("calibrate {inside} ref.png a.png --camera cal.toml --output cal")).refused(&["leave it out"]);
    let alone = desk.run("calibrate ref.png --output cal");
    alone.refused(&["add at least one deformed image"]);
    let line = "calibrate ref.png --point 0,0,0,0 --point 10,10,1,1 --point 20,20,2,2 --point 30,30,3,3 --output cal";
    desk.run(line).refused(&["the points lie on a line"]);
}

#[test]
fn points_and_lengths_give_a_scale_and_a_file_of_opencv_is_a_camera() {
    let desk = Desk::with_series();
    let points = "--point 10,10,0,0 --point 110,10,5,0 --point 110,90,5,4 --point 10,90,0,4";
    let said = desk.run(&format!("calibrate ref.png {points} --output cal")).printed();
    assert!(said.contains("1 px = 0.05") && said.contains("a usual one is reckoned with"), "{said}");
    desk.correlate(&format!("{} --camera cal/camera.toml --output out ref.png a.png", program::INSIDE)).fine();
    let rows = desk.rows("out/csv/000001.csv");
    // Marks of half a pixel over 100: a few per mille.
    assert!((rows[0].mm.unwrap().displacement[0] / rows[0].px.displacement[0] - 0.05).abs() < 1e-3);
    // The same points in a case file: the same numbers; and from there for `calibrate`.
    let points = "points = [[10, 10, 0, 0], [110, 10, 5, 0], [110, 90, 5, 4], [10, 90, 0, 4]]";
    desk.write("marks.toml", format!("[camera]\nimage_size_px = [128, 96]\n{points}"));
    desk.correlate(&format!("{} --case marks.toml --output marks ref.png a.png", program::INSIDE)).fine();
    assert_eq!(desk.rows("marks/csv/000001.csv"), rows);
    let again = desk.run("calibrate ref.png --case marks.toml --output again").printed();
    assert!(again.contains("1 px = 0.05"), "{again}");
    desk.write(
        "cv.yml",
        "%YAML:1.0\n---\nimage_width: 128\nimage_height: 96\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   \
                          cols: 3\n   dt: d\n   data: [ 500., 0., 63.5, 0., 500., 47.5, 0., 0., 1. ]\n\
                          distortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   \
                          data: [ 0.5, 0., 0., 0., 0. ]\n",
    );
    desk.correlate(&format!("{} --camera cv.yml --pixel-size 0.05 --output cv ref.png a.png", program::INSIDE)).fine();
    let run = desk.read("cv/run.toml");
    assert!(run.contains("[camera]") && run.contains("focal_px = [500.0, 500.0]") && !run.contains("cv.yml"), "{run}");
    // The run is told by its numbers, and repeats from them.
    desk.correlate("--case cv/run.toml --output repeated").fine();
    assert_eq!(desk.rows("repeated/csv/000001.csv"), desk.rows("cv/csv/000001.csv"));
}

/// A lens of 0.3 % at the corner of images of 640 x 480 px.
const PINHOLE: Pinhole = Pinhole { size: [640, 480], focal: 1300.0, centre: [322.0, 237.5], k1: 0.0317 };
const POSES: [Pose; 3] = [
    Pose { degrees: [0.0, 3.0, 0.0], at: [0.3, -0.2, 125.0] },
    Pose { degrees: [24.0, 3.0, 10.0], at: [2.0, 1.0, 140.0] },
    Pose { degrees: [4.0, 28.0, 3.0], at: [1.0, -2.0, 138.0] },
];

#[test]
fn a_target_gives_lens_focal_length_plane_and_scale() {
    let desk = Desk::new();
    let chessboard = Board { print: Print::Chessboard, n: [9, 6], pitch_mm: 5.0 };
    let dots = Board { print: Print::Dots(1.4), ..chessboard };
    let draw = |name: &str, board: &Board, pose: &Pose, seed: u64| {
        desk.image(name, &photographed(&board.drawn(&PINHOLE, pose), PINHOLE.size, 2.0, seed));
    };
    for (k, pose) in POSES.iter().enumerate() {
        draw(&format!("chess{k}.png"), &chessboard, pose, k as u64 + 1);
    }
    draw("dots.png", &dots, &POSES[0], 5);
    let line = "calibrate chess0.png chess1.png chess2.png --chessboard 9x6 --pitch 5 --output chess";
    let said = desk.run(line).printed();
    let parts =
        ["3 images of 9 x 6 corners", "focal length: 1", "k1: 0.", "tilt along x: -", "plane is that of the target"];
    assert!(parts.iter().all(|part| said.contains(part)) && !said.contains("more than noise"), "{said}");
    assert!(said.contains("scale: 1 px = 0.096"), "{said}");
    assert!(desk.path("chess/figures/000003-ux.png").is_file());
    let said = desk.run("calibrate dots.png --dots 9x6 --pitch 5 --output dots").printed();
    assert!(said.contains("scale: 1 px = 0.096") && said.contains("if it did not lie on the specimen"), "{said}");
    // Both see the plane of the first image alike: the middle of a diagonal, for one.
    let number = |folder: &str, key: &str| -> f64 {
        let text = desk.read(&format!("{folder}/camera.toml"));
        let table: toml::Table = text.parse().unwrap();
        table["camera"][key].as_float().unwrap()
    };
    let [a, b] = ["chess", "dots"].map(|folder| number(folder, "pixel_size_mm"));
    let std = ["chess", "dots"].map(|folder| number(folder, "pixel_size_relative_std"));
    assert!((a / b - 1.0).abs() < 4.0 * std[0].hypot(std[1]), "{a} {b} {std:?}");
}

#[test]
fn a_target_that_tells_nothing_is_one_clear_line() {
    let desk = Desk::new();
    let chessboard = Board { print: Print::Chessboard, n: [9, 6], pitch_mm: 5.0 };
    let draw = |name: &str, pose: &Pose, seed: u64| {
        desk.image(name, &photographed(&chessboard.drawn(&PINHOLE, pose), PINHOLE.size, 2.0, seed));
    };
    let square = |k: f64| Pose { degrees: [0.0; 3], at: [k, 0.5 * k, 125.0] };
    for k in 0..3u8 {
        draw(&format!("square{k}.png"), &square(f64::from(k)), u64::from(k) + 1);
    }
    draw("turned.png", &Pose { degrees: [0.0, 38.0, 0.0], at: [0.0, 0.0, 150.0] }, 7);
    desk.image("speckles.png", &Lens { k1: 0.0, tilt: 0.0 }.image([0.0; 2], 0.0, 1));
    let refused = |line: &str, part: &str| desk.run(&format!("calibrate {line} --output out")).refused(&[part]);
    let board = "--chessboard 9x6 --pitch 5";
    refused(&format!("square0.png square1.png square2.png {board}"), "all poses are parallel");
    refused(&format!("turned.png square0.png {board}"), "name the image first");
    refused(&format!("square0.png speckles.png {board}"), "speckles.png: the image is 512 x 512 px");
    refused(&format!("speckles.png {board}"), "speckles.png: ");
    refused("square0.png --chessboard 10x6 --pitch 5", "9 x 6 inner corners are found, 10 x 6 are asked for");
    refused("square0.png --chessboard 9x6", "--pitch MM is missing");
    refused("square0.png --chessboard 9x6 --pitch 0", "--pitch is 0");
    refused("square0.png --pitch 5", "give --chessboard or --dots");
    refused("square0.png --chessboard 9 --pitch 5", "columns and rows such as 9x6");
    refused("square0.png --chessboard 1x6 --pitch 5", "columns and rows from 3");
    refused(&format!("square0.png {board} --length 0,0,1,1,1"), "holds its own lengths");
    refused(&format!("square0.png {board} --reference square1.png"), "name it first");
    refused(&format!("no.png {board}"), "no.png");
    assert!(!desk.path("out/camera.toml").exists());
}

/// A specimen, stretched by `strain` along x, between two rails of which the left is stretched by `bent`; all seen
/// larger by `growth` and shifted.
fn between_rails(strain: f64, bent: f64, growth: f64, seed: u64) -> Arc<Image> {
    let middle = 0.5 * (SIDE as f64 - 1.0);
    let stretched = |x: f64| match x {
        x if x < 100.0 => 60.0 + (1.0 + bent) * (x - 60.0),
        x if x > 412.0 => x,
        x => middle + (1.0 + strain) * (x - middle),
    };
    let place = |[x, y]: [f64; 2]| {
        let [x, y] = [stretched(x), y].map(|v| middle + (1.0 + growth) * (v - middle));
        [x + 0.4, y - 1.3]
    };
    Spots::random(SIDE, SIGMA, 4).image([SIDE; 2], 1.0, seed, place)
}

#[test]
fn zones_that_are_still_take_a_change_of_the_distance_off_and_tell_when_they_are_not() {
    let desk = Desk::new();
    for (name, strain, bent, growth, seed) in
        [("a", 0.0, 0.0, 0.0, 1), ("b", 1e-3, 0.0, 4e-4, 2), ("c", 2e-3, 0.0, -1e-3, 3), ("d", 0.0, 3e-3, 0.0, 4)]
    {
        desk.image(&format!("{name}.png"), &between_rails(strain, bent, growth, seed));
    }
    let zone = |name: &str, x0: u32, x1: u32| format!("[[zone]]\nname = '{name}'\nroi = [{x0}, 40, {x1}, 470]\n");
    let zones = [zone("specimen", 120, 392), zone("left", 24, 92), zone("right", 420, 488)].concat();
    let gauge = "[[extensometer]]\nfrom = [140, 250]\nto = [370, 250]\nwidth_px = 300\n";
    let case = |name: &str, still: &str| desk.write(name, format!("[camera]\nexact = true\n{still}\n{zones}{gauge}"));
    case("held.toml", "still = ['left', 'right']");
    case("free.toml", "");
    case("wrong.toml", "still = ['rail']");
    let line = "--element-size 17";
    desk.correlate(&format!("{line} --case wrong.toml --output wrong a.png b.png"))
        .refused(&["no zone 'rail'; there are specimen, left, right"]);
    desk.correlate(&format!("{line} --case held.toml --output held a.png b.png c.png")).fine();
    desk.correlate(&format!("{line} --case free.toml --output free a.png b.png c.png")).fine();
    let numbers = |file: &str, names: &[&str]| -> Vec<Vec<f64>> {
        let text = desk.read(file);
        let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_reader(text.as_bytes());
        let header = reader.headers().unwrap().clone();
        let at: Vec<usize> =
            names.iter().map(|name| header.iter().position(|column| column == *name).unwrap()).collect();
        reader
            .records()
            .map(|row| row.unwrap())
            .map(|row| at.iter().map(|&k| row[k].parse().unwrap()).collect())
            .collect()
    };
    let strain = ["strain_engineering", "sigma_strain_engineering", "camera_strain_engineering"];
    let held = numbers("held/quantities/extensometers.csv", &strain);
    let free = numbers("free/quantities/extensometers.csv", &strain[..2]);
    let distance = numbers("held/quantities/still.csv", &["distance_change", "sigma_distance_change", "squares"]);
    for (k, (truth, growth)) in [(1e-3, 4e-4), (2e-3, -1e-3)].into_iter().enumerate() {
        let (value, sigma) = (held[k][0], held[k][1].hypot(held[k][2]));
        assert!((value - truth).abs() < 4.0 * sigma && held[k][2] > 0.0, "{held:?}");
        // What is seen larger seems strained by as much: the gauge without still zones is off by that.
        let (off, noise) = (free[k][0] - truth - growth * (1.0 + truth), free[k][1]);
        assert!(off.abs() < 4.0 * noise && growth.abs() > 10.0 * noise, "{free:?}");
        let change = 1.0 / (1.0 + growth) - 1.0;
        assert!((distance[k][0] - change).abs() < 4.0 * distance[k][1], "{distance:?} {change}");
        assert!(distance[k][1] < 0.1 * growth.abs() && distance[k][2] < 2.0, "{distance:?}");
    }
    // Pixels stay as the images show them.
    let rows = ["held", "free"].map(|folder| desk.rows(&format!("{folder}/csv/000002.csv")));
    assert_eq!(rows[0][0].px.displacement, rows[1][0].px.displacement);
    let said = desk.remarks("held", Code::DistanceChanged);
    assert!(said.len() == 1 && said[0].text.contains("dZ/Z = 1.00e-3") && said[0].text.contains("frame 2"), "{said:?}");
    assert!(desk.remarks("held", Code::StillZones).is_empty());
    // A rail that is stretched is told of; nothing need be asked for to have the table.
    desk.correlate(&format!("{line} --case held.toml --output bent a.png d.png")).fine();
    let said = desk.remarks("bent", Code::StillZones);
    assert!(said.iter().any(|remark| remark.number("squares").is_some_and(|squares| squares > 4.0)), "{said:?}");
    desk.write("bare.toml", format!("[camera]\nexact = true\nstill = ['left', 'right']\n{zones}"));
    desk.correlate(&format!("{line} --case bare.toml --output bare a.png b.png")).fine();
    assert_eq!(desk.read("bare/quantities/still.csv").lines().filter(|line| !line.starts_with('#')).count(), 2);
    desk.run("probe bare --curves").fine();
    // Nothing stated: what grows alike in all directions may be a distance that changed; what is pulled is not.
    let unstated = "--roi 120,40,392,470 --output";
    desk.image("e.png", &between_rails(0.0, 0.0, 1e-3, 5));
    for (folder, image, rings) in [("grown", "e.png", true), ("pulled", "c.png", false)] {
        desk.correlate(&format!("{line} {unstated} {folder} a.png {image}")).fine();
        let said = desk.remarks(folder, Code::ScaleChanged);
        assert_eq!(said.len(), usize::from(rings), "{said:?}");
        let strain = said.first().and_then(|remark| remark.number("strain"));
        assert!(strain.is_none_or(|strain| (strain - 1e-3).abs() < 1e-4), "{said:?}");
    }
    desk.correlate(&format!("{line} --case held.toml --output held-grown a.png e.png")).fine();
    assert!(desk.remarks("held-grown", Code::ScaleChanged).is_empty());
}
