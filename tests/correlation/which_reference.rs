//! Which image is the reference when nobody says, and what is said of files that are not what they seem.

#[allow(dead_code)]
use crate::common::spots;
use crate::program;
use program::{Desk, remarks};
use quadrille::imaging::{Image, Pixels};
use quadrille::remark::{About, Code};
use spots::{Spots, moved};
use std::sync::Arc;

const SIZE: [usize; 2] = [160, 128];
const ROI: &str = "--roi 32,32,128,96 --export none";

/// Random spots moved by `u` to the right.
fn image(u: f64) -> Arc<Image> {
    Spots::random(160, 1.8, 5).image(SIZE, 1.0, 1 + (10.0 * u.abs()) as u64, moved(0.0, [0.0; 2], [u, 0.3 * u]))
}

fn desk(images: &[(&str, f64)]) -> Desk {
    let desk = Desk::new();
    images.iter().for_each(|(name, u)| desk.image(name, &image(*u)));
    desk
}

#[test]
fn a_name_that_contradicts_the_order_ends_the_program_with_the_command_that_was_meant() {
    let desk = desk(&[("s/def_1.png", 0.5), ("s/def_2.png", 1.0), ("s/ref.png", 0.0)]);
    let words = ["correlate", "--output", "out", "--roi", "32,32,128,96", "s/*.png"];
    let ran = desk.run_words(&words);
    assert_eq!(ran.code, Some(2), "{ran}");
    let command =
        ran.stderr.lines().find(|line| line.trim_start().starts_with("quadrille correlate")).expect("a command");
    assert_eq!(command.trim(), "quadrille correlate --reference s/ref.png --output out --roi 32,32,128,96 's/*.png'");
    assert!(ran.stderr.contains("s/def_1.png would be the reference") && !desk.path("out").exists(), "{ran}");
    // As it says, the program runs, and the signs are right.
    let words = ["correlate", "--reference", "s/ref.png", "--output", "out", "--roi", "32,32,128,96", "s/*.png"];
    desk.run_words(&words).fine();
    let summary = desk.json("out/summary.json");
    let ux = summary["frames"][1]["rigid_motion"]["translation_px"][0].as_f64().unwrap();
    assert!((ux - 1.0).abs() < 0.02 && summary["frames"].as_array().unwrap().len() == 2, "{ux}");
}

#[test]
fn a_text_beside_the_images_is_not_taken_for_the_reference_and_is_named() {
    let desk = desk(&[("s/shot_1.png", 0.0), ("s/shot_2.png", 0.5)]);
    desk.write("s/notes.txt", "Monday, dry run");
    let ran = desk.correlate(&format!("--output out {ROI} s/notes.txt s/shot_1.png s/shot_2.png")).fine();
    assert!(ran.stderr.contains("s/notes.txt is not an image and is left out"), "{ran}");
    let ran = desk.run_words(&["correlate", "--output", "out", "--overwrite", "--roi", "32,32,128,96", "s/*"]).fine();
    assert!(ran.stderr.contains("reference s/shot_1.png"), "{ran}");
    let left_out = desk.remarks("out", Code::FilesLeftOut);
    assert_eq!((left_out.len(), &left_out[0].values["first"]), (1, &"s/notes.txt".into()), "{ran}");
    // Alone with the reference it was meant, and is no image.
    let ran = desk.correlate(&format!("--output two {ROI} --reference s/shot_1.png s/notes.txt"));
    assert_ne!(ran.code, Some(0), "{ran}");
}

#[test]
fn copies_are_named() {
    let desk = desk(&[("a_1.png", 0.0), ("a_2.png", 0.4), ("a_3.png", 0.8)]);
    desk.write("a_4.png", desk.bytes("a_3.png"));
    desk.write("a_5.png", desk.bytes("a_1.png"));
    let ran = desk.correlate(&format!("--output out {ROI} a_1.png a_2.png a_3.png a_4.png a_5.png")).fine();
    let about = |code: Code| desk.remarks("out", code).into_iter().map(|remark| remark.about).collect::<Vec<_>>();
    assert_eq!(about(Code::SameAsReference), [About::Frames(vec![4])], "{ran}");
    assert_eq!(about(Code::FramesCopied), [About::Frames(vec![2, 3])], "{ran}");
    assert!(ran.stderr.contains("warning: frames 2-3 are copies"), "{ran}");
}

#[test]
fn a_half_black_image_is_named_with_its_rows() {
    let desk = desk(&[("a_1.png", 0.0), ("a_2.png", 0.4)]);
    let whole = image(0.8);
    let pixels =
        (0..SIZE[0] * SIZE[1]).map(|k| if k < SIZE[0] * 64 { whole.grey(k % SIZE[0], k / SIZE[0]) as u8 } else { 0 });
    desk.image("a_3.png", &Image::new(SIZE[0], SIZE[1], Pixels::U8(pixels.collect())).unwrap());
    let ran = desk.correlate(&format!("--output out {ROI} a_1.png a_2.png a_3.png"));
    let summary = desk.json("out/summary.json");
    assert_eq!(summary["frames"][1]["blank"], serde_json::json!({ "rows": [64, 95] }), "{ran}");
    assert_eq!(summary["frames"][0].get("blank"), None);
    assert_eq!(desk.remarks("out", Code::ImageIncomplete)[0].about, About::Frames(vec![2]), "{ran}");
    let of_frame = remarks(&summary["frames"][1], Code::ImageIncomplete);
    assert_eq!([of_frame[0].number("first_px"), of_frame[0].number("last_px")], [Some(64.0), Some(95.0)], "{ran}");
}

#[test]
fn a_shuffled_series_is_told_and_a_cyclic_one_is_not() {
    let names: Vec<String> = (0..9).map(|k| format!("t_{k}.png")).collect();
    let shuffled = [0, 1, 5, 2, 8, 3, 7, 4, 6];
    let cyclic = |k: usize| 1.5 * (1.0 - (0.7 * k as f64).cos());
    let grows = |k: usize| 0.7 * k as f64;
    let run = |of: &dyn Fn(usize) -> f64, order: &[usize]| {
        let desk = desk(&names.iter().enumerate().map(|(k, name)| (name.as_str(), of(k))).collect::<Vec<_>>());
        let files: Vec<&str> = order.iter().map(|&k| names[k].as_str()).collect();
        desk.correlate(&format!("--output out {ROI} {}", files.join(" "))).fine();
        desk.json("out/summary.json")
    };
    let said = remarks(&run(&grows, &shuffled), Code::FramesShuffled);
    assert!(said[0].number("way_by_name_px") < said[0].number("way_px"), "{said:?}");
    for summary in [run(&grows, &[0, 1, 2, 3, 4, 5, 6, 7, 8]), run(&cyclic, &[0, 1, 2, 3, 4, 5, 6, 7, 8])] {
        assert_eq!(summary.get("remarks"), None);
    }
}

#[test]
fn a_series_that_grows_from_its_last_image_is_told() {
    let desk = desk(&[("a.png", 0.5), ("b.png", 1.0), ("c.png", 1.5), ("d.png", 2.0), ("e.png", 0.0)]);
    let ran = desk.correlate(&format!("--output out {ROI} a.png b.png c.png d.png e.png")).fine();
    assert_eq!(desk.remarks("out", Code::OrderReversed)[0].values["last"], "e.png".into());
    assert!(ran.stderr.contains("fits better the other way"), "{ran}");
}
