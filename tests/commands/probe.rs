//! `quadrille probe`, as a user meets it.

#![cfg(feature = "cli")]

use crate::program;
use program::{Desk, INSIDE};
use quadrille::report::Palette;
use quadrille::synth::{Depth, RenderOptions, Texture, Translation, render};
use std::collections::BTreeMap;

/// Two zones on either side of a gap of 8 px.
const ZONES: &str =
    "[[zone]]\nname = 'upper'\nroi = [16, 8, 112, 40]\n[[zone]]\nname = 'lower'\nroi = [16, 48, 112, 80]\n";

/// The rows of a table as maps from column to cell. Every number is finite; its first lines say what it is.
#[track_caller]
fn table(desk: &Desk, name: &str) -> Vec<BTreeMap<String, String>> {
    let text = desk.read(name);
    assert!(text.starts_with("# quadrille ") && text.contains("# lengths in px"), "{text}");
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_reader(text.as_bytes());
    let rows: Vec<BTreeMap<String, String>> = reader.deserialize().map(|row| row.unwrap()).collect();
    for (column, cell) in rows.iter().flatten() {
        if !["status", "point", "line", "extensometer", "region", "opening", "zone", "of", "quantity"]
            .contains(&column.as_str())
        {
            assert!(cell.is_empty() || cell.parse::<f64>().is_ok_and(f64::is_finite), "{name}, {column}: {cell}");
        }
    }
    rows
}

#[track_caller]
fn number(row: &BTreeMap<String, String>, column: &str) -> f64 {
    row.get(column).unwrap_or_else(|| panic!("no column {column} in {row:?}")).parse().unwrap()
}

#[test]
fn points_of_a_run_are_those_of_its_tables() {
    let desk = Desk::with_series();
    desk.correlate(&format!("{INSIDE} --pixel-size 0.01 --output out ref.png a.png b.png c.png")).fine();
    desk.write("load.txt", "time [s];load [kN]\n0;0\n0,5;1,25\n1;2,5\n1,5;3,75\n");
    let ran = desk.run("probe out --point 48,48 --point 50.5,61.5 --load load.txt --strain hencky").fine();
    assert!(ran.stderr.contains("3 frames probed, tables in out/quantities"), "{ran}");
    let rows = table(&desk, "out/quantities/points.csv");
    assert_eq!(rows.len(), 6);
    for (k, frame) in (1..=3).enumerate() {
        let [node, between] = [&rows[2 * k], &rows[2 * k + 1]];
        let nodes = desk.rows(&format!("out/csv/{frame:06}.csv"));
        let there = nodes.iter().find(|row| row.px.position == [48.0, 48.0]).unwrap();
        // The value at the point, not the coefficient of the field; rounding of what is interpolated between four of
        // them.
        let value = there.point_px.unwrap();
        assert!(value.is_value && (value.displacement[0] - there.px.displacement[0]).abs() > 1e-6, "{value:?}");
        assert!((number(node, "ux_px") - value.displacement[0]).abs() < 1e-9);
        assert!((number(node, "uy_mm") - 0.01 * value.displacement[1]).abs() < 1e-11);
        // Summed in another order from sigmas of 32 bits.
        assert!((number(node, "sigma_ux_px") / value.sigma[0] - 1.0).abs() < 1e-5);
        // Moved by a quarter pixel per frame, as a whole.
        assert!((number(between, "ux_px") - 0.25 * frame as f64).abs() < 0.02, "{between:?}");
        assert!(number(between, "exx").abs() < 2e-3 && number(between, "sigma_exx") > 0.0);
        assert_eq!((number(node, "load_N"), number(node, "time_s")), (1250.0 * frame as f64, 0.5 * frame as f64));
        assert_eq!((node["point"].as_str(), between["point"].as_str()), ("point1", "point2"));
    }
    let text = desk.read("out/quantities/points.csv");
    assert!(text.contains("strain: hencky") && text.contains("load file: load.txt"), "{text}");
    assert!(text.contains("# load_N: kN in the load file, times 1000\n"), "{text}");
}

#[test]
fn a_region_is_a_rectangle_a_polygon_or_a_zone_and_says_how_much_of_it_is_measured() {
    let desk = Desk::with_series();
    desk.write(
        "regions.toml",
        format!(
            "{ZONES}[[region]]\nzone = 'upper'\n[[region]]\nroi = [40, 56, 140, 76]\n[[region]]\nname = 'three'\n\
             polygon = [[20, 50], [100, 50], [60, 78]]\n"
        ),
    );
    desk.correlate("--case regions.toml --output out ref.png a.png").fine();
    let rows = table(&desk, "out/quantities/regions.csv");
    let names: Vec<_> = rows.iter().map(|row| row["region"].as_str()).collect();
    assert_eq!(names, ["upper", "region2", "three"]);
    for (row, measured) in rows.iter().zip([100.0, 71.5, 100.0]) {
        // a.png moved by a quarter of a pixel along x.
        assert!((number(row, "ux_px") - 0.25).abs() < 4.0 * number(row, "sigma_ux_px") + 0.005, "{row:?}");
        assert!(number(row, "least_exx") < number(row, "exx") && number(row, "exx") < number(row, "largest_exx"));
        assert!(
            number(row, "spread_ux_px") > number(row, "sigma_ux_px"),
            "the noise of a mean is less than that of nodes"
        );
        assert!((number(row, "measured_percent") - measured).abs() < 2.0, "{row:?}");
    }
    let alone = desk.run("probe out --region 40,56,140,76 --curves").fine();
    assert!(alone.stderr.contains("tables in out/quantities"), "{alone}");
    assert_eq!(number(&table(&desk, "out/quantities/regions.csv")[0], "ux_px"), number(&rows[1], "ux_px"));
    assert!(desk.path("out/curves").is_dir());
    for (section, part) in [
        ("zone = 'lowest'", "there is no zone 'lowest'; the zones are upper, lower"),
        ("zone = 'lower'\nroi = [0, 0, 9, 9]", "give one of roi, polygon and zone"),
        ("roi = [5, 5, 5, 9]", "a region has no area"),
    ] {
        desk.write("wrong.toml", format!("{ZONES}[[region]]\n{section}\n"));
        desk.run("probe out --case wrong.toml").refused(&[part]);
    }
}

#[test]
fn a_case_file_says_the_same_as_flags_and_names_its_places() {
    let desk = Desk::with_series();
    // The lower half moves 2 px down: a joint that opens, without a joint.
    let options = RenderOptions { depth: Depth::U8, ..RenderOptions::new(128, 96) };
    let texture = Texture::new(7, 4.5).unwrap();
    let [up, down] = [[0.0, -0.5], [0.25, 1.5]].map(|u| render(&texture, &Translation(u), &options).unwrap());
    let pixels = (0..96).flat_map(|y| (0..128).map(move |x| (x, y)));
    let pixels = pixels.map(|(x, y)| if y < 44 { up.grey(x, y) } else { down.grey(x, y) } as u8).collect();
    let image = quadrille::imaging::Image::new(128, 96, quadrille::imaging::Pixels::U8(pixels)).unwrap();
    desk.image("open.png", &image);
    desk.write("cases/run.toml", format!("images.reference = '../ref.png'\nimages.deformed = '../open.png'\n{ZONES}"));
    desk.correlate("--case cases/run.toml --output out").fine();
    desk.write(
        "cases/probe.toml",
        "[load]\nfile = 'load.txt'\n[[probe]]\nname = 'middle'\npoint = [64, 24]\n\
         [[line]]\nfrom = [20, 20]\nto = [100, 20]\nstep_px = 8\n\
         [[extensometer]]\nfrom = [40, 24]\nto = [40, 64]\nwidth_px = 20\n\
         [[opening]]\nzones = ['upper', 'lower']\n",
    );
    desk.write("cases/load.txt", "load_N\n7\n");
    desk.run("probe out --case cases/probe.toml --output by-case").fine();
    assert_eq!(
        desk.files("by-case"),
        ["extensometers", "lines", "openings", "openings_mean", "points"].map(|n| format!("quantities/{n}.csv"))
    );
    assert_eq!(table(&desk, "by-case/quantities/points.csv")[0]["point"], "middle");
    assert_eq!(table(&desk, "by-case/quantities/lines.csv").len(), 11);
    let gauge = &table(&desk, "by-case/quantities/extensometers.csv")[0];
    assert!((number(gauge, "elongation_px") - 2.0).abs() < 0.05, "{gauge:?}");
    let mean = &table(&desk, "by-case/quantities/openings_mean.csv")[0];
    // Faces 8 px apart whose elements end 4 px from the cut: the interpolation mixes nothing.
    assert!((number(mean, "opening_px") - 2.0).abs() < 0.03, "{mean:?}");
    assert!((number(mean, "sliding_px") + 0.25).abs() < 0.03, "{mean:?}");
    assert_eq!((mean["opening"].as_str(), number(mean, "load_N")), ("upper-lower", 7.0));

    let flags =
        "--point 64,24 --line 20,20,100,20 --step 8 --extensometer 40,24,40,64 --width 20 --opening upper,lower";
    desk.run(&format!("probe out {flags} --load cases/load.txt --output by-flags")).fine();
    for name in ["lines", "extensometers", "openings", "openings_mean"] {
        let [a, b] = ["by-case", "by-flags"].map(|folder| table(&desk, &format!("{folder}/quantities/{name}.csv")));
        assert_eq!(a, b, "{name}");
    }
    // Flags of a kind replace the sections of that kind, and leave the others.
    desk.run("probe out --case cases/probe.toml --point 30,30 --point 31,31 --output both").fine();
    assert_eq!(table(&desk, "both/quantities/points.csv").len(), 2);
    assert_eq!(table(&desk, "both/quantities/lines.csv").len(), 11);

    // The rigid motion of each zone is all there is; the tables of the last call are those that are there.
    desk.write("both/quantities/notes.txt", "mine");
    desk.run("probe out --remove-rigid zone --point 64,24 --output both").fine();
    assert_eq!(desk.files("both"), ["notes.txt", "points.csv", "rigid_motions.csv"].map(|n| format!("quantities/{n}")));
    let rigid = table(&desk, "both/quantities/rigid_motions.csv");
    assert_eq!((rigid[0]["zone"].as_str(), rigid[1]["zone"].as_str()), ("upper", "lower"));
    assert!((number(&rigid[1], "translation_y_px") - 1.5).abs() < 0.03, "{rigid:?}");
    assert!(number(&table(&desk, "both/quantities/points.csv")[0], "uy_px").abs() < 0.05);
}

#[test]
fn frames_without_field_and_places_without_value_are_empty_cells_and_said() {
    let desk = Desk::with_series();
    desk.write("b.png", "no image");
    desk.correlate(&format!("{INSIDE} --output out ref.png a.png b.png c.png")).incomplete();
    let ran = desk.run("probe out --point 60,60 --point 5,5").fine();
    assert!(ran.stderr.contains("1 of 3 frames have no field, the first is 2"), "{ran}");
    assert!(ran.stderr.contains("point 'point2' (5, 5) px") && ran.stderr.contains("outside the mesh"), "{ran}");
    let rows = table(&desk, "out/quantities/points.csv");
    let filled: Vec<bool> = rows.iter().map(|row| !row["ux_px"].is_empty()).collect();
    assert_eq!(filled, [true, false, false, false, true, false]);
    assert_eq!(rows[2]["status"], "unreadable");
    // Named, it is missing.
    assert_eq!(desk.run("probe out --point 60,60 --frames 1-2").code, Some(1));
    let ran = desk.run("probe out --point 60,60 --frames last --quiet").fine();
    assert_eq!(ran.stderr, "");
    assert_eq!(table(&desk, "out/quantities/points.csv")[0]["frame"], "3");
    desk.run("probe out --point 60,60 --frames 2").refused(&["out", "none of the frames asked for has a field"]);
}

#[test]
fn what_cannot_be_drawn_is_refused_with_a_reason() {
    let desk = Desk::with_series();
    desk.write("run.toml", format!("images.reference = 'ref.png'\nimages.deformed = ['a.png', 'b.png']\n{ZONES}"));
    desk.correlate("--case run.toml --output out").fine();
    let refused = |line: &str, wanted: &[&str]| {
        desk.run(&format!("probe out {line}")).refused(wanted);
    };
    desk.run("probe nowhere --point 1,1").refused(&["nowhere"]);
    refused("", &["nothing is asked for", "--point"]);
    refused("--load load.txt", &["nothing is asked for"]);
    refused("--point 1,2,3", &["3 numbers instead of 2"]);
    refused("--point nan,3", &["not finite"]);
    refused("--line 1,1,1,1", &["line1", "to the same point"]);
    refused("--line 1,1,9,1 --step -2", &["the step of a line is -2"]);
    refused("--line 1,1,9e9,1", &["more than 100000 points"]);
    refused("--extensometer 3,3,3,3", &["extensometer1", "to the same point"]);
    refused("--extensometer 3,3,9,3 --width -1", &["the width of an extensometer is -1"]);
    refused("--opening upper", &["names 1 zones instead of two"]);
    refused("--opening upper,middle", &["no zone 'middle'", "upper, lower"]);
    refused("--opening upper,upper", &["'upper' is given twice"]);
    refused("--opening upper,lower --opening upper,lower", &["two openings are named 'upper-lower'"]);
    refused("--opening upper,lower --remove-rigid zone", &["nothing is left of it"]);
    refused("--remove-rigid each", &["all or zone"]);
    refused("--point 60,60 --strain true", &["infinitesimal, green-lagrange or hencky"]);
    refused("--point 60,60 --frames 3", &["frame 3; the series has 2"]);
    refused("--point 60,60 --load load.txt", &["load.txt", "no such load file"]);
    desk.write("load.txt", "load_N\n1\n");
    refused("--point 60,60 --load load.txt", &["load.txt", "1 rows for 2 deformed images"]);
    desk.write("load.txt", "load_N\n1\nx\n");
    refused("--point 60,60 --load load.txt", &["load.txt, line 3", "'x' is not a finite number"]);
    desk.write("same.toml", "[[probe]]\nname = 'a'\npoint = [1, 2]\n[[probe]]\nname = 'a'\npoint = [3, 4]\n");
    refused("--case same.toml", &["two points are named 'a'"]);
    desk.write("inf.toml", "[[probe]]\npoint = [inf, 2]\n");
    refused("--case inf.toml", &["point1", "inf"]);
    desk.write("file", "no folder");
    refused("--point 60,60 --output file", &["file", "cannot be written"]);
    assert!(desk.files("out").iter().all(|name| !name.contains("quantities")), "{:?}", desk.files("out"));
}

#[test]
fn a_run_draws_what_its_case_asks_for() {
    let desk = Desk::with_series();
    let images = "images.reference = '../ref.png'\nimages.deformed = ['../a.png', '../b.png']\n";
    let case = |more: &str| desk.write("cases/run.toml", format!("{images}{ZONES}{more}"));
    desk.write("cases/load.txt", "load_N\n0\n5\n");
    case("[load]\nfile = 'load.txt'\n[[probe]]\npoint = [60, 30]\n[[opening]]\nzones = ['upper', 'lower']\n");
    desk.correlate("--case cases/run.toml --output out").fine();
    let points = table(&desk, "out/quantities/points.csv");
    assert_eq!((points.len(), number(&points[1], "load_N")), (2, 5.0));
    assert!((number(&points[1], "ux_px") - 0.5).abs() < 0.02, "{points:?}");
    // The run knows what it drew: asked for nothing, `probe` draws the same; so does a second run of run.toml.
    desk.run("probe out --output again").fine();
    desk.correlate("--case out/run.toml --output third").fine();
    for name in ["points", "openings", "openings_mean"] {
        let [first, again, third] =
            ["out", "again", "third"].map(|folder| table(&desk, &format!("{folder}/quantities/{name}.csv")));
        assert_eq!(first, again, "{name}");
        assert_eq!(first, third, "{name}");
    }
    // What does not fit is refused before the series runs, and leaves the earlier results alone.
    let refused = |wanted: &[&str]| {
        desk.correlate("--case cases/run.toml --output out --overwrite").refused(wanted);
        assert!(desk.path("out/quantities/points.csv").exists() && desk.path("out/fields.zarr").exists());
    };
    desk.write("cases/load.txt", "load_N\n0\n");
    refused(&["load.txt", "1 rows for 2 deformed images"]);
    case("[[opening]]\nzones = ['upper', 'middle']\n");
    refused(&["no zone 'middle'"]);
    case("[[line]]\nfrom = [1, 2]\nto = [1, 2]\n");
    refused(&["line1", "to the same point"]);
    // A run without quantities leaves none of an earlier one behind.
    case("");
    desk.correlate("--case cases/run.toml --output out --overwrite").fine();
    assert!(!desk.path("out/quantities").exists());
}

#[test]
fn quantities_have_a_rate_a_strain_through_the_thickness_and_begin_at_the_reference() {
    let desk = Desk::with_series();
    desk.correlate(&format!("{INSIDE} --output out ref.png a.png b.png c.png")).fine();
    let words =
        "probe out --point 48,48 --extensometer 30,40,90,40 --rate-window 2 --poisson 0.3 --strain infinitesimal";
    desk.run(words).refused(&["--rate-window needs the times of the frames"]);
    // Moved by a quarter of a pixel in each of three frames, half a second apart.
    desk.run(&format!("{words} --frame-interval 0.5 --curves")).fine();
    let rows = table(&desk, "out/quantities/rates.csv");
    let of_ux: Vec<_> = rows.iter().filter(|row| row["quantity"] == "ux_px").collect();
    assert_eq!(of_ux.len(), 3);
    for (k, row) in of_ux.iter().enumerate() {
        assert_eq!((row["of"].as_str(), number(row, "time_s")), ("point1", 0.5 * (k + 1) as f64));
        assert!((number(row, "rate_per_s") - 0.5).abs() < 4.0 * number(row, "sigma_rate_per_s") + 0.01, "{row:?}");
        assert!((number(row, "smooth") - 0.25 * (k + 1) as f64).abs() < 0.02, "{row:?}");
    }
    assert!(rows.iter().any(|row| row["of"] == "extensometer1" && row["quantity"] == "strain_engineering"));
    for row in table(&desk, "out/quantities/points.csv") {
        let sum = number(&row, "exx") + number(&row, "eyy");
        assert!((number(&row, "ezz") + 0.3 / 0.7 * sum).abs() < 1e-12 && number(&row, "sigma_ezz") > 0.0, "{row:?}");
        assert_eq!(number(&row, "time_s"), 0.5 * number(&row, "frame"));
    }
    let files = desk.files("out/curves");
    assert!(files.iter().any(|file| file.ends_with("point1-ux_px_per_s-against-time_s.svg")), "{files:?}");
    assert!(desk.read("out/curves/point1-ux_px_per_s-against-time_s.svg").contains("ux rate (px/s)"));
    for (flags, part) in
        [("--frame-interval 0.5 --rate-window 0", "give seconds above 0"), ("--poisson 0.6", "from -1 to 0.5")]
    {
        desk.run(&format!("probe out --point 48,48 {flags}")).refused(&[part]);
    }
}

#[test]
fn curves_are_drawn_against_the_load_or_the_frame() {
    let desk = Desk::with_series();
    desk.correlate(&format!("{INSIDE} --output out ref.png a.png b.png c.png")).fine();
    desk.write("load.csv", "load_N\n10\n20\n30\n");
    for (against, label, load) in [("load_N", "load (N)", "--load load.csv"), ("frame", "frame", "")] {
        desk.run(&format!("probe out --extensometer 30,40,90,40 {load} --curves --output {against}")).fine();
        let files = desk.files(&format!("{against}/curves"));
        for ending in ["png", "svg"] {
            let tail = format!("-strain_true-against-{against}.{ending}");
            assert!(files.iter().any(|file| file.ends_with(&tail)), "no {tail} among {files:?}");
        }
        let curve = desk.read(&format!("{against}/curves/extensometer1-elongation_px-against-{against}.svg"));
        for words in ["elongation (px)", label] {
            assert!(curve.contains(&format!("aria-label=\"{words}\"")), "no '{words}'");
        }
        // Of a load also the other way round: what the specimen does along x.
        let turned = files.iter().any(|file| file == "extensometer1-load_N-against-strain_true.png");
        assert_eq!(turned, against == "load_N", "{files:?}");
    }
}

#[test]
fn what_lies_along_a_line_is_drawn_over_the_frames_or_their_times() {
    let desk = Desk::with_series();
    desk.correlate(&format!("{INSIDE} --output out ref.png a.png b.png c.png")).fine();
    for (against, label, times) in [("frame", "frame", ""), ("time_s", "time (s)", "--frame-interval 0.5")] {
        desk.run(&format!("probe out --line 40,48,80,48 {times} --curves --output {against}")).fine();
        let files = desk.files(&format!("{against}/curves"));
        assert!(files.contains(&format!("line1-exx-against-{against}.png")), "{files:?}");
        let map = desk.read(&format!("{against}/curves/line1-ux_px-against-{against}.svg"));
        for words in ["ux (px)", "along the line (px)", label] {
            assert!(map.contains(&format!("aria-label=\"{words}\"")), "no '{words}'");
        }
    }
    // Moved by a quarter of a pixel from frame to frame: three columns, each of one colour but for noise.
    let picture = image::open(desk.path("frame/curves/line1-ux_px-against-frame.png")).unwrap().into_rgb8();
    let (y, n) = (picture.height() / 2, picture.width());
    let colours: Vec<_> = (0..n).map(|x| *picture.get_pixel(x, y)).collect();
    let [low, high] = [0.0, 1.0].map(|t| Palette::Viridis.colour(t));
    let is = |wanted: [u8; 3]| move |c: &image::Rgb<u8>| c.0.iter().zip(wanted).all(|(a, b)| a.abs_diff(b) < 40);
    let [first, last] = [low, high].map(|wanted| colours.iter().position(is(wanted)).unwrap());
    assert!(first + 100 < last, "{first} {last}");
}

#[test]
fn a_record_at_another_rate_is_joined_by_time_and_gives_a_stress() {
    let desk = Desk::with_series();
    desk.correlate(&format!("{INSIDE} --output out ref.png a.png b.png c.png")).fine();
    // 10 Hz beside frames every 0.25 s; the record ends before the last frame.
    let rows: String = (0..7).map(|k| format!("{:.1};{}\n", 0.1 * f64::from(k), 2 * k).replace('.', ",")).collect();
    desk.write("machine.txt", format!("Time;Force;\ns;kN;\n{rows}"));
    let probe = "probe out --point 48,48 --load machine.txt --load-time time";
    let ran = desk.run(&format!("{probe} --frame-interval 0.25 --area 50")).fine();
    for wanted in
        ["frame 3 lies outside the load record (0 to 0.6 s)", "a frame every 0.25 s", "kN in the load file, times 1000"]
    {
        assert!(ran.stderr.contains(wanted), "'{wanted}' is not said: {ran}");
    }
    let rows = table(&desk, "out/quantities/points.csv");
    for (row, want) in rows.iter().zip([5000.0, 10000.0]) {
        // 20 kN per second, between rows.
        assert!((number(row, "Force_N") / want - 1.0).abs() < 1e-12, "{row:?}");
        assert!((number(row, "stress_MPa") / (want / 50.0) - 1.0).abs() < 1e-12, "{row:?}");
    }
    assert_eq!((rows[2]["Force_N"].as_str(), rows[2]["stress_MPa"].as_str()), ("", ""), "nothing is extrapolated");
    assert_eq!(number(&rows[2], "Time_s"), 0.75);
    // Width by thickness is an area; the true stress is that over the section that is left.
    let drawn = "probe out --extensometer 30,40,90,40 --load machine.txt --load-time time --frame-interval 0.25";
    desk.run(&format!("{drawn} --area 10x5 --curves")).fine();
    for row in &table(&desk, "out/quantities/extensometers.csv")[..2] {
        let (stress, strain) = (number(row, "stress_MPa"), number(row, "strain_engineering"));
        assert!((number(row, "stress_true_MPa") / (stress * (1.0 + strain)) - 1.0).abs() < 1e-12, "{row:?}");
        let sigma = stress * number(row, "sigma_strain_engineering");
        assert!((number(row, "sigma_stress_true_MPa") / sigma - 1.0).abs() < 1e-12 && sigma > 0.0, "{row:?}");
    }
    assert!(desk.files("out/curves").contains(&"extensometer1-stress_true_MPa-against-strain_true.svg".to_owned()));
    desk.run(&format!("{drawn} --area 10x5 --curves=stress_MPa:strain_engineering --output one")).fine();
    let ending = |kind: &str| format!("extensometer1-stress_MPa-against-strain_engineering.{kind}");
    assert_eq!(desk.files("one/curves"), [ending("png"), ending("svg")]);
    let refused = desk.run(&format!("{drawn} --curves=stress:strain --output one"));
    refused.refused(&["no curve stress:strain; there are ", "strain_engineering:Force_N"]);
    desk.run(&format!("{drawn} --area 10x5x2")).refused(&["width by thickness in mm as 12.5x3"]);
    // The same from the camera's own times, and by a case file.
    desk.write("camera.txt", "file,time [ms]\nref.png,0\na.png,250\nb.png,500\nc.png,600\n");
    desk.run(&format!("{probe} --frame-times camera.txt")).fine();
    assert_eq!(number(&table(&desk, "out/quantities/points.csv")[2], "Force_N"), 12000.0);
    desk.write(
        "case.toml",
        "[load]\nfile = 'machine.txt'\ntime = 'time'\nframe_times = 'camera.txt'\nstart_s = -0.05\narea_mm2 = 10\n\
         [[probe]]\npoint = [48, 48]\n",
    );
    desk.run("probe out --case case.toml").fine();
    assert!((number(&table(&desk, "out/quantities/points.csv")[2], "stress_MPa") - 1100.0).abs() < 1e-9);
    for (line, wanted) in [
        (probe.to_owned(), "nobody knows when the frames were taken"),
        ("probe out --point 48,48 --load machine.txt --frame-interval 1".to_owned(), "not the column of the load file"),
        (format!("{probe} --frame-interval 0"), "is 0; give a finite number above 0"),
        (format!("{probe} --frame-interval 5 --load-start 9"), "no frame lies within the record"),
        (
            "probe out --point 48,48 --load machine.txt --load-time clock --frame-interval 1".to_owned(),
            "no column 'clock'",
        ),
        ("probe out --point 48,48 --area 3".to_owned(), "give --load FILE as well"),
    ] {
        let ran = desk.run(&line);
        ran.refused(&[wanted]);
    }
}

#[test]
fn strains_over_a_window_stand_beside_the_others_at_points() {
    let desk = Desk::with_series();
    desk.correlate(&format!("{INSIDE} --strain-window 3 --output out ref.png a.png b.png c.png")).fine();
    desk.run("probe out --point 48,48 --line 40,48,80,48").fine();
    let rows = table(&desk, "out/quantities/points.csv");
    let nodes = desk.rows("out/csv/000001.csv");
    let (strain, sigma) = nodes.iter().find(|row| row.px.position == [48.0, 48.0]).unwrap().window_strain.unwrap();
    // At a node it is that of the node; tables of frames have 32 bits.
    for (column, want) in [("exx_window", strain.xx), ("exy_window", strain.xy), ("sigma_eyy_window", sigma[1])] {
        let found = number(&rows[0], column);
        assert!((found - want).abs() < 1e-6 * want.abs().max(1e-4), "{column}: {found}, {want}");
    }
    assert!(number(&rows[0], "sigma_exx_window") < number(&rows[0], "sigma_exx"));
    for over in ["", "_window"] {
        let value = |name: &str| number(&rows[0], &format!("{name}{over}"));
        assert!((value("e1") + value("e2") - value("exx") - value("eyy")).abs() < 1e-12, "{over}");
        assert!(value("sigma_e1") > 0.0 && value("sigma_shear_max") > 0.0, "{over}");
    }
    assert!(number(&rows[0], "sigma_e1_window") < number(&rows[0], "sigma_e1"));
    let model = nodes.iter().find(|row| row.px.position == [48.0, 48.0]).unwrap().window_model_error.unwrap();
    assert!((number(&rows[0], "model_error_eyy_window") - model[1]).abs() < 1e-6 * model[1].max(1e-4));
    assert!(desk.read("out/quantities/points.csv").contains("virtual strain gauge"));
    assert!(desk.read("out/quantities/lines.csv").contains("exx_window"));
    desk.run("probe out --point 48,48 --strain-window 1").fine();
    assert!(!desk.read("out/quantities/points.csv").contains("exx_window"));
    desk.run("probe out --point 48,48 --strain-window 4").refused(&["give an odd number from 3 to 51"]);
}
