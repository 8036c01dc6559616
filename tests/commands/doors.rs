//! What a name, a file or a number may be taken for that its owner does not mean: read as meant, or asked.

#![cfg(feature = "cli")]

use crate::program;
use program::{Desk, HEIGHT, INSIDE, WIDTH, assert_moved, moved, remarks};
use quadrille::imaging::{Image, Levels, Pixels};
use quadrille::remark::Code;
use quadrille::synth::Translation;

/// Largest error of a node on 8 bit images; see tests/commands/cli.rs.
const ROUNDED: f64 = 0.02;

/// A desk with these images, the k-th moved by a quarter of a pixel times k.
fn desk_with(names: &[&str]) -> Desk {
    let desk = Desk::new();
    names.iter().enumerate().for_each(|(k, name)| desk.image(name, &moved([0.25 * k as f64, 0.0])));
    desk
}

fn words(line: &str) -> Vec<&str> {
    line.split_whitespace().collect()
}

#[test]
fn loads_in_names_are_numbers_and_the_smallest_is_the_reference() {
    let names = ["F=0kN.png", "F=0.25kN.png", "F=0.5kN.png", "F=1kN.png"];
    let desk = desk_with(&names);
    let ran = desk.run_words(&[&words("correlate --output out")[..], &words(INSIDE), &["F=*.png"]].concat()).fine();
    assert!(ran.stderr.contains("reference F=0kN.png"), "{ran}");
    let files: Vec<_> = ran.frames("out").iter().map(|frame| frame["file"].as_str().unwrap().to_owned()).collect();
    assert_eq!(files, names[1..]);
    assert_moved(&desk.rows("out/csv/000003.csv"), &Translation([0.75, 0.0]), ROUNDED);
    let said = desk.remarks("out", Code::OrderOfNames);
    assert!(said[0].text.contains("F=0kN.png, F=0.25kN.png, F=0.5kN.png"), "{said:?}");
    // As a shell puts them.
    let ran = desk.correlate("--output two F=0.25kN.png F=0.5kN.png F=0kN.png F=1kN.png");
    assert!(ran.code == Some(2) && ran.stderr.contains("--reference F=0kN.png"), "{ran}");
    // Names in plain order are no news.
    let desk = desk_with(&["img_1.png", "img_2.png", "img_10.png"]);
    desk.run_words(&[&words("correlate --output out")[..], &words(INSIDE), &["*.png"]].concat()).fine();
    assert!(desk.remarks("out", Code::OrderOfNames).is_empty());
}

#[test]
fn two_cameras_in_one_folder_are_named_with_the_pattern_of_each() {
    let desk = desk_with(&["a_1_L.png", "a_1_R.png", "a_2_L.png", "a_2_R.png"]);
    let ran = desk.run_words(&["correlate", "--output", "out", "*.png"]);
    ran.refused(&["L and R", "quadrille correlate --output out-L 'a_*_L.png'", "--output out-R 'a_*_R.png'"]);
    assert!(!desk.path("out").exists());
    desk.run_words(&[&words("correlate --output out")[..], &words(INSIDE), &["a_*_L.png"]].concat()).fine();
    // Numbers alone may be two images of each load.
    let names = ["s_01_0.png", "s_01_1.png", "s_02_0.png", "s_02_1.png", "s_03_0.png", "s_03_1.png"];
    let desk = desk_with(&names);
    let ran = desk.run_words(&[&words("correlate --output out")[..], &words(INSIDE), &["*.png"]].concat()).fine();
    assert!(ran.stderr.contains("warning: the names have _0 and _1 in turn"), "{ran}");
    let said = &desk.remarks("out", Code::CamerasMixed)[0];
    assert_eq!([&said.values["first"], &said.values["second"]], [&"s_*_0.png".into(), &"s_*_1.png".into()]);
}

/// The same picture with its pixels stored as the orientation tag of a TIFF page says.
fn turned(image: &Image, orientation: u16) -> Vec<u8> {
    use tiff::encoder::{TiffEncoder, colortype::Gray8};
    use tiff::tags::Tag;
    let (width, height) = (image.width(), image.height());
    let at = |x: usize, y: usize| image.grey(x, y) as u8;
    let (columns, rows, levels): (usize, usize, Vec<u8>) = match orientation {
        3 => (width, height, (0..width * height).rev().map(|k| at(k % width, k / width)).collect()),
        // The first stored row is the right side of the picture, the first stored column its top.
        6 => (height, width, (0..width * height).map(|k| at(width - 1 - k / height, k % height)).collect()),
        _ => (width, height, (0..width * height).map(|k| at(k % width, k / width)).collect()),
    };
    let mut bytes = std::io::Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut bytes).unwrap();
    let mut page = encoder.new_image::<Gray8>(columns as u32, rows as u32).unwrap();
    page.encoder().write_tag(Tag::Orientation, orientation).unwrap();
    page.write_data(&levels).unwrap();
    bytes.into_inner()
}

#[test]
fn images_of_a_camera_that_was_turned_are_measured_upright_and_it_is_said_once() {
    let desk = Desk::new();
    for (k, orientation) in [1, 3, 6, 6].into_iter().enumerate() {
        desk.write(&format!("{k}.tif"), turned(&moved([0.25 * k as f64, 0.0]), orientation));
    }
    let ran = desk.correlate(&format!("{INSIDE} --output out 0.tif 1.tif 2.tif 3.tif")).fine();
    for k in 1..4 {
        assert_moved(&desk.rows(&format!("out/csv/{k:06}.csv")), &Translation([0.25 * k as f64, 0.0]), ROUNDED);
    }
    assert_eq!(ran.stderr.matches("turned by 90 degrees clockwise").count(), 1, "{ran}");
    assert!(remarks(&ran.frames("out")[2], Code::ImageFile)[0].text.contains("orientation tag (6)"), "{ran}");
    // One that does not fit upright is refused by its name, with the size that it is seen with.
    let tall = Image::new(HEIGHT, WIDTH, Pixels::U8((0..WIDTH * HEIGHT).map(|k| (k % 251) as u8).collect())).unwrap();
    desk.write("tall.tif", turned(&tall, 6));
    let ran = desk.correlate(&format!("{INSIDE} --output two 0.tif 1.tif tall.tif")).incomplete();
    let said = &remarks(&ran.frames("two")[1], Code::FrameUnreadable)[0].text;
    assert!(said.contains(&format!("tall.tif: the image is {HEIGHT} x {WIDTH} px")), "{said}");
}

#[test]
fn the_raw_mosaic_of_a_colour_camera_is_named_where_no_texture_is_found() {
    let desk = Desk::new();
    let mosaic = |u: f64| {
        let image = moved([u, 0.0]);
        let gain = |k: usize| [[0.62, 1.0], [1.0, 0.5]][k / WIDTH % 2][k % WIDTH % 2];
        let Levels::U8(levels) = image.pixels() else { panic!("8 bit") };
        let levels = levels.iter().enumerate().map(|(k, v)| (f64::from(*v) * gain(k)).round() as u8).collect();
        Image::new(WIDTH, HEIGHT, Pixels::U8(levels)).unwrap()
    };
    desk.image("a.png", &mosaic(0.0));
    desk.image("b.png", &mosaic(0.5));
    let ran = desk.correlate(&format!("{INSIDE} --output out a.png b.png"));
    // Refused for its noise, or measured with a warning: either way the cause is named.
    assert!(ran.stderr.contains("the raw mosaic of a colour camera (Bayer)"), "{ran}");
    let ran = desk.run("metrology a.png");
    assert!(ran.stderr.contains("the raw mosaic of a colour camera (Bayer)"), "{ran}");
}

#[test]
fn a_video_is_named_with_what_takes_it_apart_and_beside_images_it_is_left_out() {
    let desk = Desk::with_series();
    let video = [&b"\0\0\0\x20ftypisom"[..], &[0; 100]].concat();
    desk.write("test.mp4", &video);
    desk.write("film", &video);
    let empty = desk.path("empty").display().to_string();
    for line in ["test.mp4", "ref.png test.mp4", "--reference ref.png film", "film a.png b.png"] {
        let line = format!("correlate {INSIDE} --output out {line}");
        let ran = desk.run_with(&[("PATH", &empty)], &words(&line));
        assert!(ran.code != Some(0) && ran.stderr.contains("this is a video (MP4 or MOV), not an image"), "{ran}");
        assert!(ran.stderr.contains("ffmpeg -i "), "{ran}");
        let _ = std::fs::remove_dir_all(desk.path("out"));
    }
    let ran = desk.correlate(&format!("{INSIDE} --output out ref.png a.png test.mp4")).fine();
    assert!(ran.stderr.contains("test.mp4 (a video (MP4 or MOV)) is not an image and is left out"), "{ran}");
    desk.write("a.npy", b"\x93NUMPY\x01\0v\0{'descr'");
    let ran = desk.correlate("--output two a.npy b.png");
    assert!(ran.stderr.contains("a.npy (an array of NumPy (npy)) is not an image") || ran.code == Some(2), "{ran}");
}

#[test]
fn images_of_another_size_are_counted_and_a_reference_that_is_alone_is_named() {
    let desk = Desk::with_series();
    let small = Image::new(64, 48, Pixels::U8(vec![7; 64 * 48])).unwrap();
    desk.image("small.png", &small);
    desk.correlate(&format!("{INSIDE} --output out ref.png a.png small.png b.png")).incomplete();
    let said = &desk.remarks("out", Code::FramesOfOtherSize)[0];
    assert!(said.text.contains("frame 2 is 64 x 48 px; the other 2 are 128 x 96 px"), "{said:?}");
    assert_eq!(desk.json("out/summary.json")["frames"][1]["size_px"], serde_json::json!([64, 48]));
    let from = moved([0.0, 0.0]);
    let wide = (0..144 * HEIGHT).map(|k| from.grey(k % 144 % WIDTH, k / 144) as u8).collect();
    let odd = Image::new(144, HEIGHT, Pixels::U8(wide)).unwrap();
    desk.image("odd.png", &odd);
    desk.correlate(&format!("{INSIDE} --output two --reference odd.png a.png b.png")).incomplete();
    let said = &desk.remarks("two", Code::FramesOfOtherSize)[0];
    assert!(said.text.contains("all 2 frames are 128 x 96 px, and the reference alone is 144 x 96 px"), "{said:?}");
}

#[test]
fn a_folder_stands_for_its_images_and_capital_letters_are_told() {
    let desk = desk_with(&["s/1.png", "s/2.png", "s/10.png"]);
    desk.write("s/notes.txt", "dry run");
    let ran = desk.correlate(&format!("{INSIDE} --output out s")).fine();
    assert_eq!(ran.statuses("out"), ["converged"; 2]);
    assert!(ran.stderr.contains("reference s/1.png"), "{ran}");
    desk.write("s/11.PNG", desk.bytes("s/10.png"));
    let ran = desk.run_words(&[&words("correlate --output two")[..], &words(INSIDE), &["s/*.png"]].concat()).fine();
    assert!(ran.stderr.contains("s/11.PNG is left out: only capital letters"), "{ran}");
    desk.write("empty/notes.txt", "");
    desk.correlate("--output no empty").refused(&["`empty` is a folder without images"]);
}

#[test]
fn a_scale_that_no_image_has_is_refused() {
    let desk = Desk::with_series();
    for size in ["5e-324", "1e300", "0", "nan"] {
        let ran = desk.correlate(&format!("{INSIDE} --pixel-size {size} --output out ref.png a.png"));
        assert!(ran.code == Some(2) && ran.stderr.contains("size"), "{ran}");
    }
}

#[cfg(unix)]
#[test]
fn a_pipe_or_a_device_is_refused_and_not_waited_for() {
    let desk = Desk::with_series();
    let made = std::process::Command::new("mkfifo").arg(desk.path("pipe.png")).status();
    assert!(made.is_ok_and(|made| made.success()));
    for pipe in ["pipe.png", "/dev/zero"] {
        desk.correlate(&format!("--output out {pipe} a.png")).refused(&[pipe, "a pipe or a device"]);
        desk.correlate(&format!("--case {pipe} --output out")).refused(&[pipe, "a pipe or a device"]);
        desk.correlate(&format!("--mask {pipe} --output out ref.png a.png")).refused(&[pipe, "a pipe or a device"]);
    }
}

#[test]
fn a_machine_file_of_another_country_is_read_and_a_number_of_two_meanings_is_asked_for() {
    let desk = Desk::with_series();
    desk.correlate(&format!("{INSIDE} --output out ref.png a.png b.png c.png")).fine();
    let probe =
        |options: &str| desk.run(&format!("probe out --extensometer 30,60,100,60 --load machine.txt {options}"));
    let loads = || {
        let text = desk.read("out/quantities/extensometers.csv");
        let mut rows =
            text.lines().filter(|line| !line.starts_with('#')).map(|line| line.split(',').collect::<Vec<_>>());
        let at = rows.next().unwrap().iter().position(|name| *name == "Kraft_N").unwrap();
        rows.map(|row| row[at].parse::<f64>().unwrap()).collect::<Vec<_>>()
    };
    let preamble = "Pr\u{fc}fprogramm 4.1\nPr\u{fc}fer;NN\nZeit [s];Kraft [N]\n0,5;1.250\n1,0;2.500\n1,5;3.750\n";
    let latin = preamble.chars().map(|c| c as u8).collect::<Vec<_>>();
    desk.write("machine.txt", latin);
    let ran = probe("").fine();
    assert_eq!(loads(), [1250.0, 2500.0, 3750.0], "{ran}");
    for said in ["Windows-1252", "lines 1 to 2 are before the header", "1.250 is 1250"] {
        assert!(ran.stderr.replace("\n  ", " ").contains(said), "'{said}' is not said: {ran}");
    }
    desk.write("machine.txt", "Kraft [N];Weg [mm]\n1.250;2\n2.500;3\n3.750;4\n");
    probe("").refused(&["machine.txt, line 2, column 'Kraft_N'", "'1.250' may be 1250 or 1.250", "--load-decimal"]);
    probe("--load-decimal comma").fine();
    assert_eq!(loads(), [1250.0, 2500.0, 3750.0]);
    probe("--load-decimal point").fine();
    assert_eq!(loads(), [1.25, 2.5, 3.75]);
    probe("--load-decimal both").refused(&["'both' is no decimal mark"]);
}

/// Columns of the extensometers of a folder that end in `_N` and `_mm` of the machine, from the first frame on.
fn of_machine(desk: &Desk, name: &str) -> Vec<f64> {
    let text = desk.read("out/quantities/extensometers.csv");
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_reader(text.as_bytes());
    let at = reader.headers().unwrap().iter().position(|column| column == name);
    let at = at.unwrap_or_else(|| panic!("no column {name}: {:?}", reader.headers()));
    reader.records().map(|row| row.unwrap()[at].parse().unwrap()).collect()
}

#[test]
fn exports_of_testing_machines_are_read_as_they_are() {
    let desk = Desk::with_series();
    desk.correlate(&format!("{INSIDE} --output out ref.png a.png b.png c.png")).fine();
    // As their makers describe them: a preamble, names, units below, decimal marks of the country.
    let files: [(&str, &str); 4] = [
        (
            "Bluehill of Instron",
            "\"Specimen label\",\"A-1\"\n\"Width\",\"10.00\",\"mm\"\n\n\"Time\",\"Extension\",\"Load\"\n\
             \"(s)\",\"(mm)\",\"(kN)\"\n\"0.5\",\"0.10\",\"0.25\"\n\"1.0\",\"0.20\",\"0.50\"\n\"1.5\",\"0.30\",\"0.75\"\n",
        ),
        (
            "testXpert of Zwick",
            "\"Pr\u{fc}fprotokoll\";\"P 1\"\n\"Pr\u{fc}fzeit\";\"Extension\";\"Load\"\n\"s\";\"mm\";\"N\"\n\
             0,5;0,10;250,0\n1,0;0,20;500,0\n1,5;0,30;750,0\n",
        ),
        (
            "TestSuite of MTS",
            "MTS793|MPT|ENU|1|2|.|/|:|1|0|0|A\nData Acquisition: Timed\t\tTime: 0.107 Sec\t\nRunning Time\tExtension\tLoad\n\
             Sec\tmm\tkN\n0.5\t0.10\t0.25\n1.0\t0.20\t0.50\n1.5\t0.30\t0.75\n",
        ),
        (
            "Trapezium of Shimadzu",
            "\"Key Word\",\"Product Name\",\"Test File Name\"\n\"\",\"\",\"plate.xtas\"\n\"Time\",\"Load\",\"Extension\"\n\
             \"sec\",\"N\",\"mm\"\n\"0.5\",\"250\",\"0.10\"\n\"1.0\",\"500\",\"0.20\"\n\"1.5\",\"750\",\"0.30\"\n",
        ),
    ];
    for (machine, text) in files {
        desk.write("machine.txt", text);
        let ran = desk.run("probe out --extensometer 30,60,100,60 --load machine.txt").fine();
        assert_eq!(of_machine(&desk, "Load_N"), [250.0, 500.0, 750.0], "{machine}: {ran}");
        assert_eq!(of_machine(&desk, "Extension_mm"), [0.1, 0.2, 0.3], "{machine}: {ran}");
    }
}

#[test]
fn an_image_that_was_replaced_is_named_and_measured_again_and_a_moved_folder_goes_on() {
    let desk = Desk::with_series();
    let line = format!("correlate {INSIDE} --output out --reference ref.png a.png b.png c.png");
    desk.run(&line).fine();
    let [first, second] = [1, 2].map(|frame| desk.bytes(&format!("out/csv/{frame:06}.csv")));
    // The same content at another time is the same image.
    desk.write("a.png", desk.bytes("a.png"));
    let ran = desk.run(&line).fine();
    assert!(ran.stderr.contains("nothing is missing") && !ran.stderr.contains("replaced"), "{ran}");
    desk.image("b.png", &moved([-0.5, 0.25]));
    let ran = desk.run(&line).fine();
    assert!(ran.stderr.contains("the images of 1 frame were replaced since and will be measured again: 2"), "{ran}");
    assert_moved(&desk.rows("out/csv/000002.csv"), &Translation([-0.5, 0.25]), ROUNDED);
    assert_eq!(first, desk.bytes("out/csv/000001.csv"));
    assert_ne!(second, desk.bytes("out/csv/000002.csv"));
    // The whole project elsewhere, with one frame more to do.
    let other = Desk::new();
    for name in ["ref.png", "a.png", "b.png", "c.png"] {
        other.write(name, desk.bytes(name));
    }
    std::fs::rename(desk.path("out"), other.path("out")).unwrap();
    std::fs::remove_file(other.path("out/restart/frames/000003.json")).unwrap();
    let ran = other.run(&line).fine();
    assert!(ran.stderr.contains("2 frames done before, 1 to do"), "{ran}");
}

#[test]
fn files_of_the_user_with_names_of_results_are_spared() {
    for name in ["report.html", "csv/000001.csv", "vtu/000001.vtu"] {
        let desk = Desk::with_series();
        let line = format!("correlate {INSIDE} --output out ref.png a.png");
        std::fs::create_dir_all(desk.path(&format!("out/{name}")).parent().unwrap()).unwrap();
        desk.write(&format!("out/{name}"), "mine");
        desk.run(&line).refused(&[name, "would be overwritten", "--overwrite"]);
        assert_eq!(desk.read(&format!("out/{name}")), "mine");
        desk.run(&format!("{line} --overwrite")).fine();
    }
}

#[test]
fn a_jpeg_that_ends_early_is_cut_off_also_with_an_end_marker() {
    let desk = Desk::with_series();
    let encoded = |image: &Image| {
        let levels: Vec<u8> = (0..WIDTH * HEIGHT).map(|k| image.grey(k % WIDTH, k / WIDTH) as u8).collect();
        let mut bytes = Vec::new();
        let mut encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 95);
        encoder.encode(&levels, WIDTH as u32, HEIGHT as u32, image::ExtendedColorType::L8).unwrap();
        bytes
    };
    let whole = encoded(&moved([0.25, 0.0]));
    desk.write("whole.jpg", &whole);
    let cut = [&whole[..whole.len() / 2], &[0xff, 0xd9]].concat();
    desk.write("cut.jpg", cut);
    let ran = desk.correlate(&format!("{INSIDE} --output out ref.png whole.jpg cut.jpg")).incomplete();
    assert_eq!(ran.statuses("out"), ["converged", "unreadable"], "{ran}");
    assert!(ran.stderr.contains("the pixel data end early"), "{ran}");
}

#[test]
fn a_surface_of_two_groups_is_refused_since_a_pixel_has_one_zone() {
    let desk = Desk::with_series();
    let text = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Entities\n0 0 1 0\n7 16 16 0 112 80 0 2 3 5 0\n$EndEntities\n\
                $Nodes\n1 4 1 4\n2 7 0 4\n1\n2\n3\n4\n16 16 0\n112 16 0\n112 80 0\n16 80 0\n$EndNodes\n\
                $Elements\n1 1 1 1\n2 7 3 1\n1 1 2 3 4\n$EndElements\n";
    desk.write("two.msh", text);
    desk.run("correlate --mesh two.msh --output out ref.png a.png").refused(&["two.msh", "surface 7", "3 and 5"]);
    desk.write("one.msh", text.replace(" 2 3 5 0\n", " 1 3 0\n"));
    let ran = desk.run("correlate --mesh one.msh --output out ref.png a.png");
    assert!(!ran.stderr.contains("physical groups"), "{ran}");
}
