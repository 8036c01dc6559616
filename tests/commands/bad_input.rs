//! Bad input: one clear line says what, where and what to do; nothing computed is lost; no panic, hang, NaN.

#![cfg(feature = "cli")]

use crate::program;
use program::{Desk, HEIGHT, INSIDE, WIDTH, assert_moved, moved, remarks, speckle};
use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};
use quadrille::imaging::{Image, Pixels};
use quadrille::remark::Code;
use quadrille::synth::{Depth, Translation};

/// Largest error of a node on 8 bit images; see tests/commands/cli.rs.
const ROUNDED: f64 = 0.02;

fn constant(grey: u8) -> Image {
    Image::new(WIDTH, HEIGHT, Pixels::U8(vec![grey; WIDTH * HEIGHT])).unwrap()
}

/// A float TIFF file with `value` in the pixel (5, 7); an [`Image`] would refuse NaN.
fn float_file_with(desk: &Desk, name: &str, value: f32) {
    let image = speckle(&Translation([0.25, -0.25]), Depth::F32);
    let Pixels::F32(mut levels) = image.clone().into_pixels() else { panic!("a float image") };
    let mark = 12345.678_f32;
    levels[7 * WIDTH + 5] = mark;
    desk.image(name, &Image::new(WIDTH, HEIGHT, Pixels::F32(levels)).unwrap());
    let mut bytes = desk.bytes(name);
    let at = bytes.windows(4).position(|four| four == mark.to_le_bytes()).expect("the mark is in the file");
    bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
    desk.write(name, bytes);
}

// ---- references ----

#[test]
fn a_reference_that_cannot_be_read_is_refused_with_its_name_and_what_to_do() {
    let desk = Desk::with_series();
    desk.write("empty.png", "");
    desk.write("letter.png", "Dear reader,\nthis is no image.");
    let whole = desk.bytes("ref.png");
    desk.write("cut.png", &whole[..whole.len() / 2]);
    desk.image("ref.tif", &moved([0.0, 0.0]));
    let whole = desk.bytes("ref.tif");
    desk.write("cut.tif", &whole[..whole.len() / 2]);
    desk.write("folder/a.txt", "");
    float_file_with(&desk, "nan.tif", f32::NAN);
    float_file_with(&desk, "infinite.tif", f32::NEG_INFINITY);
    for (reference, wanted) in [
        ("none.png", &["there is no such file", "check the name"][..]),
        ("none/none.png", &["there is no such file"]),
        ("folder", &["this is a folder", "name an image file"]),
        ("empty.png", &["the file is empty", "copy it again"]),
        ("letter.png", &["not an image", "Dear reader", "use TIFF, PNG"]),
        ("cut.png", &["PNG file", "copy it again"]),
        ("cut.tif", &["TIFF file", "copy it again"]),
        ("nan.tif", &["(5, 7) px is NaN", "replace or mask"]),
        ("infinite.tif", &["(5, 7) px is -inf", "replace or mask"]),
    ] {
        for line in [format!("--reference {reference} a.png"), format!("{reference} a.png")] {
            if reference == "folder" && !line.starts_with("--reference") {
                // As one of a series a folder stands for the images in it.
                desk.correlate(&format!("--output out {line}")).refused(&["`folder` is a folder", "folder/*.tif"]);
                continue;
            }
            let ran = desk.correlate(&format!("--output out {line}")).refused(wanted);
            assert!(ran.stderr.starts_with(&format!("quadrille: {reference}: ")), "{ran}");
            assert!(desk.files("out").is_empty(), "{ran}");
        }
    }
}

#[test]
fn a_reference_without_texture_is_refused_with_nodes_and_their_places() {
    let desk = Desk::with_series();
    for (name, image) in [("black.png", constant(0)), ("grey.png", constant(127)), ("white.png", constant(255))] {
        desk.image(name, &image);
        let wanted =
            [name, "35 of 35 nodes see too little texture", "node 0 at (16, 16) px", "and 32 more", "check the zone"];
        desk.correlate(&format!("{INSIDE} --output out {name} a.png")).refused(&wanted);
        let wanted =
            [name, "no node of the reference image sees enough texture", "check the zone, the exposure and the focus"];
        desk.correlate(&format!("{INSIDE} --drop-textureless --output out {name} a.png")).refused(&wanted);
    }
    // Float images have no rounding that would count as noise.
    let flat = Image::new(WIDTH, HEIGHT, Pixels::F32(vec![0.5; WIDTH * HEIGHT])).unwrap();
    desk.image("flat.tif", &flat);
    desk.correlate(&format!("{INSIDE} --output out flat.tif a.png")).refused(&["flat.tif", "see too little texture"]);
}

#[test]
fn stripes_are_refused_as_such() {
    let desk = Desk::with_series();
    let levels = (0..WIDTH * HEIGHT).map(|at| (127.0 + 100.0 * (0.8 * (at % WIDTH) as f64).sin()) as u8).collect();
    desk.image("stripes.png", &Image::new(WIDTH, HEIGHT, Pixels::U8(levels)).unwrap());
    desk.correlate(&format!("{INSIDE} --output out stripes.png a.png")).refused(&["stripes: no texture along them"]);
}

#[test]
fn noise_alone_is_no_texture_when_the_noise_is_given() {
    let desk = Desk::with_series();
    // Contrast of the speckle is some 40 grey levels: noise of 100 drowns it.
    let ran = desk.correlate(&format!("{INSIDE} --noise 100 --output out ref.png a.png"));
    ran.refused(&["see too little texture", "needed"]);
}

#[test]
fn an_image_of_one_row_or_one_column_has_no_element() {
    let desk = Desk::new();
    for (name, [width, height]) in [("row.png", [96, 1]), ("column.png", [1, 96]), ("dot.png", [1, 1])] {
        let levels = (0..width * height).map(|at| (at * 37 % 251) as u8).collect();
        desk.image(name, &Image::new(width, height, Pixels::U8(levels)).unwrap());
        let size = format!("{width} x {height} px");
        desk.correlate(&format!("--output out {name} {name}")).refused(&[name, "only a reference image was given"]);
        desk.image("a.png", &moved([0.0, 0.0]));
        desk.correlate(&format!("--output out {name} a.png")).refused(&[name, &size, "no element of 16 px fits"]);
    }
}

// ---- regions and elements ----

#[test]
fn a_region_that_does_not_fit_is_refused_with_its_numbers() {
    let desk = Desk::with_series();
    let image = "outside the image of 128 x 96 px";
    for (flags, wanted) in [
        ("--roi 200,200,300,300", &["(200, 200) to (300, 300) px", image][..]),
        ("--roi 64,48,200,90", &["zone 'zone1'", "(64, 48) to (200, 90) px", image]),
        ("--roi -5,0,90,90", &["(-5, 0)", image]),
        ("--roi 0,0,128,96.5", &["(128, 96.5)", image]),
        ("--roi 16,16,31.9,80", &["zone 'zone1' is 15.", "x 64 px", "no element of 16 px fits", "enlarge the zone"]),
        ("--roi 16,16,112,20 --element-size 5", &["96 x 4 px", "no element of 5 px fits"]),
        ("--roi 112,80,16,16", &["(112, 80) to (16, 16) px is not a rectangle", "x0 < x1 and y0 < y1"]),
        ("--roi 16,80,112,16", &["is not a rectangle"]),
        ("--roi 16,16,16,80", &["is not a rectangle"]),
        ("--roi 1e300,0,1e301,50", &[image]),
        ("--roi 16,16,64,64 --roi 60,60,120,90", &["'zone1' and 'zone2' overlap", "one zone only"]),
        ("--roi 16,16,64,64 --roi 16,16,64,64", &["overlap"]),
        ("--roi 1,2,3", &["--roi", "3 numbers instead of 4"]),
        ("--roi 1,2,3,4,5", &["--roi", "5 numbers instead of 4"]),
        ("--roi a,b,c,d", &["--roi", "'a,b,c,d' is not a list of 4 numbers"]),
        ("--roi 0,0,nan,50", &["--roi", "not finite"]),
        ("--roi 0,0,inf,50", &["--roi", "not finite"]),
    ] {
        desk.correlate(&format!("{flags} --output out ref.png a.png")).refused(wanted);
    }
}

#[test]
fn an_element_size_that_cannot_be_is_refused_with_what_can() {
    let desk = Desk::with_series();
    for (size, named) in
        [("0", "0 px"), ("1", "1 px"), ("3", "3 px"), ("129", "129 px"), ("100000000000", "100000000000 px")]
    {
        let wanted = ["the element size is", named, "choose 4 to 128 px"];
        desk.correlate(&format!("--element-size {size} --output out ref.png a.png")).refused(&wanted);
    }
    desk.correlate("--element-size -5 --output out ref.png a.png").refused(&["element size", "4 to 128 px"]);
    for word in ["sixteen", "16.5", "1e400", ""] {
        let ran = desk.run_words(&["correlate", "--element-size", word, "--output", "out", "ref.png", "a.png"]);
        ran.refused(&["--element-size", word]);
    }
    // Allowed, but larger than this image.
    let wanted = ["ref.png", "zone 'image' is 128 x 96 px", "no element of 100 px fits", "smaller elements"];
    desk.correlate("--element-size 100 --output out ref.png a.png").refused(&wanted);
}

#[test]
fn options_that_make_no_sense_are_refused_with_what_does() {
    let desk = Desk::with_series();
    for (flags, wanted) in [
        ("--threads 0", &["--threads is 0", "at least 1"][..]),
        ("--threads 100000", &["--threads is 100000", "cores"]),
        ("--threads two", &["--threads", "'two'"]),
        ("--tolerance 0", &["tolerance is 0", "positive"]),
        ("--tolerance -1", &["tolerance is -1", "positive"]),
        ("--tolerance nan", &["tolerance is NaN", "positive"]),
        ("--tolerance inf", &["tolerance is inf", "positive"]),
        ("--max-iterations 0", &["iterations is 0", "at least 1"]),
        ("--noise -1", &["noise is -1", "positive"]),
        ("--noise 0", &["noise is 0", "positive"]),
        ("--noise nan", &["noise is NaN", "positive"]),
        ("--pixel-size 0", &["pixel size is 0 mm", "positive"]),
        ("--pixel-size -2", &["pixel size is -2 mm", "positive"]),
        ("--pixel-size nan", &["pixel size is NaN mm", "positive"]),
        ("--interpolation cubik", &["'cubik'", "cubic, quintic, keys, bilinear"]),
        ("--brightness dark", &["`dark`", "auto, zone, smooth, element or off"]),
        ("--start warm", &["`warm`", "previous or independent"]),
        ("--export xls", &["'xls'", "csv, vtu, none"]),
        ("--elemnt-size 16", &["--elemnt-size", "--element-size"]),
        ("--page -1", &["--page", "'-1'"]),
        ("--threads -2", &["--threads", "'-2'"]),
        ("--max-iterations -3", &["--max-iterations", "'-3'"]),
    ] {
        desk.correlate(&format!("{flags} --output out ref.png a.png")).refused(wanted);
    }
    desk.correlate("ref.png a.png").refused(&["--output <DIR>"]);
    desk.run("corelate").refused(&["'corelate'", "correlate"]);
}

// ---- case files ----

#[track_caller]
fn assert_case_refused(text: &str, wanted: &[&str]) {
    let desk = Desk::with_series();
    desk.write("my case.toml", text);
    let ran = desk.run_words(&["correlate", "--case", "my case.toml", "--output", "out", "ref.png", "a.png"]);
    ran.refused(wanted);
}

#[test]
fn a_case_file_with_a_fault_is_refused_with_key_and_line() {
    let line = |number: usize| format!("quadrille: my case.toml, line {number}: ");
    for (text, number, wanted) in [
        (
            "[images]\n\n[correlation]\nelemnt_size_px = 16\n",
            4,
            &["unknown key `elemnt_size_px`", "`element_size_px`"][..],
        ),
        ("[correlaton]\n", 1, &["unknown key `correlaton`", "`correlation`"]),
        ("[[zone]]\nroi = [0, 0, 50, 50]\n[[zone]]\nnmae = 'b'\n", 4, &["unknown key `nmae`", "[[zone]]"]),
        ("[correlation]\nelement_size_px = 'large'\n", 2, &["`element_size_px`", "\"large\"", "whole number"]),
        ("[correlation]\nelement_size_px = -5\n", 2, &["`element_size_px`", "-5", "whole number"]),
        ("[images]\nreference = 7\n", 2, &["`reference`", "in quotes"]),
        ("[images]\ndeformed = [1]\n", 2, &["`deformed`"]),
        ("[[zone]]\nroi = [0, 0, 50]\n", 2, &["`roi`", "3 entries"]),
        ("[correlation]\ninterpolation = 'cubik'\n", 2, &["`interpolation`", "`cubik`", "`cubic`"]),
        // Broken TOML.
        ("[images\nreference = 'a'\n", 1, &[]),
        ("[images]\nreference = 'a\n", 2, &[]),
        ("[images]\nreference = a.png\n", 2, &["text without quotes"]),
        ("[images]\npage = \n", 2, &["no value"]),
        ("[images]\npage = 0\npage = 1\n", 3, &["`page`", "twice"]),
        ("[images]\n]]]\n", 2, &[]),
    ] {
        let mut all = vec![line(number)];
        all.extend(wanted.iter().map(ToString::to_string));
        assert_case_refused(text, &all.iter().map(String::as_str).collect::<Vec<_>>());
    }
    assert_case_refused("[[zone]]\nname = 'left'\n", &["zone 'left' has no roi", "[x0, y0, x1, y1]"]);
    let same = "[[zone]]\nname = 'a'\nroi = [16, 16, 48, 48]\n[[zone]]\nname = 'a'\nroi = [64, 16, 96, 48]\n";
    assert_case_refused(same, &["two zones are named 'a'", "names must differ"]);
    let over = "[[zone]]\nname = 'a'\nroi = [16, 16, 48, 48]\n[[zone]]\nname = 'b'\nroi = [47, 16, 96, 48]\n";
    assert_case_refused(over, &["'a' and 'b' overlap"]);
    assert_case_refused("[[zone]]\nroi = [nan, 0, 50, 50]\n", &["is not a rectangle"]);
    assert_case_refused("[correlation]\ntolerance_px = nan\n", &["tolerance is NaN", "positive"]);
    assert_case_refused("[correlation]\nnoise = -inf\n", &["noise is -inf", "positive"]);
    assert_case_refused("[images]\npixel_size_mm = 0\n", &["pixel size is 0 mm"]);
    assert_case_refused("[correlation]\nelement_size_px = 3\n", &["element size is 3 px"]);
}

#[test]
fn a_case_file_that_is_not_there_or_no_text_is_refused() {
    let desk = Desk::with_series();
    let run = |case: &str| desk.correlate(&format!("--case {case} --output out ref.png a.png"));
    run("none.toml").refused(&["quadrille: none.toml: ", "no such case file", "check the name"]);
    run("ref.png").refused(&["quadrille: ref.png, line ", "UTF-8"]);
    desk.write("folder/x", "");
    run("folder").refused(&["quadrille: folder: ", "cannot be read"]);
}

#[test]
fn any_text_as_a_case_file_is_refused_on_one_line_or_run() {
    // Pieces that are nearly right reach further than noise.
    let pieces = [
        "[images]",
        "[correlation]",
        "[[zone]]",
        "\n",
        " = ",
        "roi",
        "page",
        "noise",
        "name",
        "nan",
        "-1",
        "0",
        "16",
        "1e999",
        "[0, 0, 64, 64]",
        "[64, 64, 0, 0]",
        "'a'",
        "\"",
        "'cubic'",
        "element_size_px",
        "interpolation",
        "\u{e9}",
    ];
    let desk = Desk::with_series();
    let config = Config { cases: 150, failure_persistence: None, ..Config::default() };
    let words = proptest::collection::vec(proptest::sample::select(pieces.to_vec()), 0..12);
    TestRunner::new(config)
        .run(&words, |words| {
            desk.write("case.toml", words.concat());
            let ran = desk.correlate("--quiet --overwrite --export csv --case case.toml --output out ref.png a.png");
            prop_assert!(ran.stderr.lines().count() <= 1, "{}", ran);
            prop_assert!(matches!(ran.code, Some(0 | 2)), "{}", ran);
            Ok(())
        })
        .unwrap();
}

// ---- output ----

#[test]
fn an_output_that_cannot_be_written_is_refused_before_anything_is_read() {
    let desk = Desk::with_series();
    desk.write("taken", "a file");
    for output in ["taken", "taken/below", "taken/deep/below"] {
        let ran = desk.correlate(&format!("--output {output} none.png a.png"));
        ran.refused(&[&format!("quadrille: {output}: "), "cannot be written", "choose another --output folder"]);
    }
    assert_eq!(desk.read("taken"), "a file");
    // A file stands where the tables should be.
    desk.write("out/csv", "a file");
    desk.correlate(&format!("{INSIDE} --output out ref.png a.png")).refused(&["out/csv", "cannot be written"]);
    assert_eq!(desk.read("out/csv"), "a file");
    desk.run("make images translation --size 32x32 --output taken").refused(&["taken", "cannot be written"]);
}

#[test]
fn a_table_that_cannot_be_written_ends_the_run_and_what_was_computed_is_kept() {
    let desk = Desk::with_series();
    // Tables are written under this name first; a folder stands in the way of the second.
    desk.write("out/csv/000002.csv.part/x", "");
    let line = format!("{INSIDE} --quiet --export csv --output out ref.png a.png b.png c.png");
    let ran = desk.correlate(&line).refused(&["quadrille: out/csv/000002.csv: cannot be written"]);
    assert_moved(&desk.rows("out/csv/000001.csv"), &Translation([0.25, -0.25]), ROUNDED);
    assert!(ran.statuses("out").len() >= 2, "what was measured is not in the summary");
    assert!(desk.read("out/run.toml").contains("sha256"));
}

#[test]
fn an_output_that_holds_another_run_is_refused_and_left_alone() {
    let desk = Desk::with_series();
    desk.correlate(&format!("{INSIDE} --output out ref.png a.png")).fine();
    let before = desk.bytes("out/summary.json");
    for leftover in ["both", "run.toml", "summary.json"] {
        if leftover != "both" {
            // One of the two files is enough to show that a run was here.
            let text = desk.bytes(&format!("out/{leftover}"));
            desk.write(&format!("{leftover} alone/{leftover}"), text);
        }
        let output = if leftover == "both" { "out".to_owned() } else { format!("{leftover} alone") };
        let ran = desk.run_words(&["correlate", "--output", &output, "ref.png", "b.png"]);
        ran.refused(&[&output, "holds the results of another run", "--overwrite", "another --output folder"]);
    }
    assert_eq!(desk.bytes("out/summary.json"), before);
}

// ---- which images ----

#[test]
fn images_that_are_not_there_are_refused_with_the_pattern() {
    let desk = Desk::with_series();
    for (images, wanted) in [
        ("", &["no image is given", "--case"][..]),
        ("ref.png", &["ref.png", "only a reference image was given"]),
        ("--reference ref.png", &["ref.png", "only a reference image was given"]),
        ("ref.png shots/*.tif", &["`shots/*.tif` matches no file", "check the pattern"]),
        ("--reference ref.png *.tiff", &["`*.tiff` matches no file"]),
        ("ref.png a[.png", &["`a[.png` is not a valid pattern"]),
        ("ref.png ***", &["`***` is not a valid pattern"]),
    ] {
        desk.correlate(&format!("--output out {images}")).refused(wanted);
    }
    desk.write("tests/case.toml", "[images]\nreference = '../ref.png'\ndeformed = 'none_*.png'\n");
    desk.correlate("--case tests/case.toml --output out").refused(&["`none_*.png` matches no file in tests"]);
}

// ---- frames in a series ----

/// Bad frames, what is said of each, and the good ones around them that are measured.
#[test]
fn bad_frames_are_named_with_the_reason_and_the_others_are_measured() {
    let desk = Desk::with_series();
    desk.write("empty.png", "");
    desk.write("letter.png", "Dear reader,\nthis is no image.");
    for name in ["a.png", "a.tif"] {
        desk.image(name, &moved([0.25, -0.25]));
        let whole = desk.bytes(name);
        desk.write(&format!("cut_{name}"), &whole[..whole.len() * 2 / 3]);
    }
    float_file_with(&desk, "nan.tif", f32::NAN);
    float_file_with(&desk, "infinite.tif", f32::INFINITY);
    desk.image("black.png", &constant(0));
    desk.image("grey.png", &constant(127));
    desk.image("white.png", &constant(255));
    let small = Image::new(64, 48, Pixels::U8((0..64 * 48).map(|at| (at * 37 % 251) as u8).collect())).unwrap();
    desk.image("small.png", &small);
    let turned = Image::new(HEIGHT, WIDTH, Pixels::U8((0..WIDTH * HEIGHT).map(|at| (at * 37 % 251) as u8).collect()));
    desk.image("turned.png", &turned.unwrap());
    let bad = [
        ("gone.png", &["there is no such file"][..]),
        ("empty.png", &["the file is empty"]),
        ("letter.png", &["not an image"]),
        ("cut_a.png", &["PNG file", "copy it again"]),
        ("cut_a.tif", &["TIFF file", "copy it again"]),
        ("nan.tif", &["(5, 7) px is NaN"]),
        ("infinite.tif", &["(5, 7) px is inf"]),
        ("black.png", &["every pixel has the grey level 0", "no picture"]),
        ("grey.png", &["every pixel has the grey level 127"]),
        ("white.png", &["every pixel has the grey level 255"]),
        ("small.png", &["64 x 48 px", "128 x 96 px"]),
        ("turned.png", &["96 x 128 px", "128 x 96 px"]),
    ];
    let names: Vec<_> = bad.iter().map(|(name, _)| *name).collect();
    let line = format!("{INSIDE} --output out --reference ref.png a.png {} b.png c.png", names.join(" "));
    let ran = desk.correlate(&line).incomplete();
    let frames = ran.frames("out");
    assert_eq!(frames.len(), bad.len() + 3);
    for ((name, wanted), (at, frame)) in bad.iter().zip(frames.iter().enumerate().skip(1)) {
        assert_eq!((&frame["file"], &frame["status"]), (&(*name).into(), &"unreadable".into()), "{frame:#}");
        assert_eq!(frame["number"], at + 1);
        let message = &remarks(frame, Code::FrameUnreadable)[0].text;
        // It stands in the summary and on one line of stderr.
        let said = ran.stderr.lines().find(|line| line.starts_with(&format!("frame {} ({name}): unreadable", at + 1)));
        let said = said.unwrap_or_else(|| panic!("{name} has no line: {ran}"));
        for wanted in [&[*name][..], wanted].concat() {
            assert!(message.contains(wanted) && said.contains(wanted), "'{wanted}' is not said: {message}\n{said}");
        }
    }
    assert_eq!(desk.json("out/summary.json")["counts"], serde_json::json!({ "converged": 3, "unreadable": bad.len() }));
    // Only measured frames have files; they keep the numbers of the series.
    let last = bad.len() + 2;
    let numbers = [1, last, last + 1];
    assert_eq!(desk.files("out/csv"), numbers.map(|n| format!("{n:06}.csv")));
    assert_eq!(desk.files("out/vtu"), numbers.map(|n| format!("{n:06}.vtu")));
    assert_eq!(desk.read("out/series.pvd").matches("<DataSet").count(), 3);
    for (number, shift) in numbers.into_iter().zip([0.25, 0.5, 0.75]) {
        assert_moved(&desk.rows(&format!("out/csv/{number:06}.csv")), &Translation([shift, -shift]), ROUNDED);
    }
    // The written case runs again to the same end.
    let again = desk.correlate("--case out/run.toml --output again").incomplete();
    assert_eq!(again.statuses("again"), ran.statuses("out"));
}

#[test]
fn every_kind_of_bad_frame_alone_and_first_is_survived() {
    let desk = Desk::with_series();
    desk.write("letter.png", "no image");
    desk.image("grey.png", &constant(9));
    for bad in ["gone.png", "letter.png", "grey.png"] {
        for start in ["previous", "cold"] {
            let ran = desk.correlate(&format!("{INSIDE} --start {start} --overwrite --output out ref.png {bad} b.png"));
            assert_eq!(ran.incomplete().statuses("out"), ["unreadable", "converged"], "{bad}, {start}");
            assert_moved(&desk.rows("out/csv/000002.csv"), &Translation([0.5, -0.5]), ROUNDED);
        }
        let ran = desk.correlate(&format!("{INSIDE} --overwrite --output out ref.png {bad}")).incomplete();
        assert_eq!(ran.statuses("out"), ["unreadable"]);
        assert_eq!(desk.files("out"), ["run.toml", "series.pvd", "summary.json"]);
    }
}

#[test]
fn a_folder_among_the_frames_is_refused_by_name_and_passed_over_by_a_glob() {
    let desk = Desk::with_series();
    desk.write("folder.png/x", "");
    let ran = desk.correlate("--output out ref.png a.png folder.png b.png");
    ran.refused(&["`folder.png` is a folder without images", "name the files", "folder.png/*.tif"]);
    let ran = desk.correlate(&format!("{INSIDE} --output out --reference ref.png *.png")).fine();
    assert_eq!(ran.statuses("out"), ["converged"; 3]);
}

#[test]
fn frames_with_saturated_or_black_patches_and_frames_half_dark_give_no_nan() {
    let desk = Desk::new();
    desk.image("ref.png", &moved([0.0, 0.0]));
    let image = moved([0.5, -0.25]);
    let with = |keep: &dyn Fn(usize, usize) -> bool, grey: u8| {
        let level = |at: usize| {
            let (x, y) = (at % WIDTH, at / WIDTH);
            if keep(x, y) { image.grey(x, y) as u8 } else { grey }
        };
        Image::new(WIDTH, HEIGHT, Pixels::U8((0..WIDTH * HEIGHT).map(level).collect())).unwrap()
    };
    desk.image("glare.png", &with(&|x, y| x.abs_diff(64) + y.abs_diff(48) > 12, 255));
    desk.image("half.png", &with(&|x, _| x < 64, 0));
    desk.image("zone.png", &with(&|x, y| !(16..112).contains(&x) || !(16..80).contains(&y), 0));
    desk.image("rows.png", &with(&|_, y| y % 2 == 0, 0));
    desk.image("dot.png", &with(&|x, y| (x, y) == (64, 48), 0));
    let frames = "glare.png half.png zone.png rows.png dot.png ref.png";
    for brightness in ["auto", "smooth", "element", "off"] {
        // That no number is NaN is checked after every run.
        let ran = desk.correlate(&format!(
            "{INSIDE} --brightness {brightness} --drop-textureless --output {brightness} --reference ref.png {frames}"
        ));
        assert!(matches!(ran.code, Some(0 | 1)), "{ran}");
        let statuses = ran.statuses(brightness);
        assert_eq!(statuses.len(), 5);
        // Diverged, as a rule; whether a half-dark frame without correction of the light settles on nothing,
        // wanders on or out of the image is chance.
        assert!(statuses[2..].iter().all(|status| status != "converged"), "{brightness}: {statuses:?}");
        // The other half of a half-dark frame may be measured; the dark one is then named.
        if statuses[1] == "converged" {
            let marked = ran.frames(brightness)[1]["marked"].as_array().cloned().unwrap_or_default();
            let share: f64 = marked.iter().map(|marked| marked["percent"].as_f64().unwrap()).sum();
            assert!(share > 45.0, "{brightness}: {marked:?}");
        }
        if statuses[0] == "converged" {
            let glare = ran.frames(brightness)[0].clone();
            assert!(!glare["marked"].as_array().unwrap().is_empty(), "the glare is not mentioned: {glare:#}");
        }
    }
}

#[test]
fn frames_that_leave_the_image_are_said_to() {
    let desk = Desk::new();
    desk.image("ref.png", &moved([0.0, 0.0]));
    desk.image("far.png", &moved([112.0, 0.0]));
    desk.image("near.png", &moved([1.0, 0.0]));
    let ran = desk.correlate("--output out ref.png near.png far.png near.png").incomplete();
    let statuses = ran.statuses("out");
    assert_eq!(statuses[0], "converged", "{ran}");
    // Less than a fifth of the speckle is left; what is left may be found or not, but a measurement it is not.
    assert!(["left_image", "diverged"].contains(&statuses[1].as_str()), "{ran}");
}

/// Every cut of a valid file is refused with a reason, or (when only the end marker is gone) measured right.
#[track_caller]
fn assert_cuts_are_survived(name: &str) {
    let desk = Desk::new();
    desk.image("ref.png", &moved([0.0, 0.0]));
    desk.image("b.png", &moved([0.5, -0.5]));
    desk.image(name, &moved([0.25, -0.25]));
    let whole = desk.bytes(name);
    // Every byte of the headers at both ends, and steps between.
    let lengths: Vec<usize> =
        (0..whole.len()).filter(|n| *n < 64 || whole.len() - n <= 48 || n % (whole.len() / 40) == 0).collect();
    assert!(lengths.len() > 100);
    lengths.iter().for_each(|n| desk.write(&format!("cuts/{n}_{name}"), &whole[..*n]));
    let ran = desk.correlate(&format!("{INSIDE} --verbose --output out --reference ref.png cuts/* b.png")).incomplete();
    let frames = ran.frames("out");
    assert_eq!(frames.len(), lengths.len() + 1);
    assert_eq!(frames.last().unwrap()["status"], "converged");
    let mut refused = 0;
    for (frame, length) in frames.iter().zip(&lengths) {
        assert_eq!(frame["file"], format!("cuts/{length}_{name}"));
        if frame["status"] == "unreadable" {
            refused += 1;
            let message = &remarks(frame, Code::FrameUnreadable)[0].text;
            assert!(message.starts_with(&format!("cuts/{length}_{name}: ")) && message.len() < 300, "{message}");
        } else {
            assert_eq!(frame["status"], "converged", "{frame:#}");
            let rows = desk.rows(&format!("out/csv/{:06}.csv", frame["number"].as_u64().unwrap()));
            assert_moved(&rows, &Translation([0.25, -0.25]), ROUNDED);
        }
    }
    assert!(refused >= lengths.len() - 16, "{} of {} cuts are read as images", lengths.len() - refused, lengths.len());
}

#[test]
fn every_cut_of_a_png_frame_is_refused_or_measured_right() {
    assert_cuts_are_survived("a.png");
}

#[test]
fn every_cut_of_a_tiff_frame_is_refused_or_measured_right() {
    assert_cuts_are_survived("a.tif");
}

#[test]
fn a_frame_with_wrong_bytes_never_stops_the_series() {
    let desk = Desk::new();
    desk.image("ref.png", &moved([0.0, 0.0]));
    desk.image("z.png", &moved([0.5, -0.5]));
    // Wrong bytes at fixed pseudo-random places of PNG and TIFF files: header, data, directory.
    let mut state = 2024_u64;
    let mut next = move |below: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    for name in ["a.png", "a.tif"] {
        desk.image(name, &moved([0.25, -0.25]));
        let whole = desk.bytes(name);
        for number in 0..80 {
            let mut bytes = whole.clone();
            for _ in 0..1 + number % 3 {
                // Half of the wrong bytes at the ends, where the headers are.
                let near = next(128);
                let at = [next(whole.len()), near, whole.len() - 1 - near][number % 3];
                bytes[at] = next(256) as u8;
            }
            desk.write(&format!("wrong/{number:02}_{name}"), bytes);
        }
    }
    let ran = desk.correlate(&format!("{INSIDE} --quiet --output out --reference ref.png wrong/* z.png"));
    assert!(matches!(ran.code, Some(0 | 1)), "{ran}");
    let statuses = ran.statuses("out");
    assert_eq!(statuses.len(), 161);
    assert_eq!(statuses.last().unwrap(), "converged");
    assert!(statuses.iter().any(|status| status == "unreadable"), "no wrong byte was noticed");
    assert_moved(&desk.rows("out/csv/000161.csv"), &Translation([0.5, -0.5]), ROUNDED);
}

#[test]
fn synth_refuses_what_cannot_be_rendered() {
    let desk = Desk::new();
    for (line, wanted) in [
        ("translation --size 0x64", &["--size", "'0x64'", "1024x768"][..]),
        ("translation --size 64", &["--size", "'64'"]),
        ("translation --shift 1", &["--shift", "1 numbers instead of 2"]),
        ("translation --shift nan,0", &["--shift", "not finite"]),
        ("translation --speckle 0", &["speckle size is 0 px", "2 to 32 px"]),
        ("translation --speckle nan", &["speckle size is NaN px"]),
        ("translation --noise -1", &["noise", "-1"]),
        ("translation --grid 0", &["--grid is 0"]),
        ("sinusoids --wavelength 0", &["--wavelength is 0", "positive"]),
        ("sinusoids --amplitude inf", &["--amplitude is inf"]),
        ("sinusoids --amplitude 50 --wavelength 20", &["the motion folds", "lower its gradient"]),
        ("rotation --degrees nan", &["--degrees is NaN"]),
        ("peel --opening nan", &["--opening is NaN"]),
        ("bend", &["'bend'", "translation, rotation, affine"]),
        ("translation --bits 12", &["'12'", "8, 16, float"]),
    ] {
        let size = if line.contains("--size") { "" } else { "--size 48x48" };
        let ran = desk.run(&format!("make images {line} {size} --output out"));
        ran.refused(wanted);
    }
}
