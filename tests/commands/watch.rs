//! `quadrille watch`: a thread plays the camera.
#![cfg(feature = "cli")]
#![cfg(unix)] // signals

use crate::program;
use program::process::{assert_same, end, results, signal, start, wait_for_frames};
use program::{Desk, moved};
use quadrille::field::Status;
use quadrille::io::store::Store;
use quadrille::remark::{About, Code};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde_json::Value;
use std::fs::{self, OpenOptions};
use std::io::Write;
use std::process::Child;
use std::thread::sleep;
use std::time::{Duration, Instant};

/// The options of most runs.
const OPTIONS: &str = "--element-size 8 --threads 2 --export none --roi 8,8,120,88";
/// A tenth of the settling time, and half of the time between two looks.
const MOMENT: Duration = Duration::from_millis(20);

/// A desk with an empty folder `shots`, and the images that come into it: `made/N.png`.
fn desk(n: usize) -> Desk {
    let desk = Desk::new();
    fs::create_dir(desk.path("shots")).unwrap();
    (0..n).for_each(|k| desk.image(&format!("made/{k}.png"), &moved([0.25 * k as f64, -0.15 * k as f64])));
    desk
}

/// Begins to watch `shots`.
fn watch(desk: &Desk, more: &str) -> Child {
    start(desk, &format!("watch shots --settle 0.2 --output out {OPTIONS} {more}"))
}

/// The camera writes the image `k` in one of its ways: in two pieces, under another name first, at once.
fn shoot(desk: &Desk, name: &str, k: usize) {
    let (bytes, path) = (desk.bytes(&format!("made/{k}.png")), desk.path(&format!("shots/{name}")));
    match k % 3 {
        0 => {
            let (half, rest) = bytes.split_at(bytes.len() / 2);
            fs::write(&path, half).unwrap();
            sleep(5 * MOMENT);
            OpenOptions::new().append(true).open(&path).unwrap().write_all(rest).unwrap();
        }
        1 => {
            fs::write(path.with_extension("png.part"), &bytes).unwrap();
            sleep(15 * MOMENT);
            fs::rename(path.with_extension("png.part"), &path).unwrap();
        }
        _ => fs::write(&path, bytes).unwrap(),
    }
}

/// Name of the image `k`: a natural order that is not that of the letters.
fn name(k: usize) -> String {
    format!("img_{}.png", k + 6)
}

/// What `correlate` makes of all images that have come.
#[track_caller]
fn assert_is_one_run(desk: &Desk, what: &str) {
    desk.correlate(&format!("--output whole --overwrite {OPTIONS} shots/*.png")).fine();
    assert_same(&results(desk, "whole"), &results(desk, "out"), what);
}

#[test]
fn images_that_come_in_pieces_give_the_bits_of_correlate_over_the_same_files() {
    let desk = desk(8);
    desk.write("shots/notes.txt", "no image");
    let child = watch(&desk, "--timeout 1.5 --progress json");
    for k in 0..8 {
        shoot(&desk, &name(k), k);
        sleep(2 * MOMENT);
    }
    let (code, said) = end(child);
    assert_eq!(code, Some(0), "{said}");
    assert_is_one_run(&desk, "watched");
    let lines: Vec<Value> = said.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let says = |text: &str| lines.iter().any(|line| line["message"].as_str().is_some_and(|said| said.contains(text)));
    for wanted in
        ["the first image, which is the reference", "reference shots/img_6.png", "nothing new in shots for 1.5 s"]
    {
        assert!(says(wanted), "'{wanted}' is not said: {said}");
    }
    let progress: Vec<&Value> = lines.iter().filter(|line| line.get("done").is_some()).collect();
    assert_eq!(
        progress.iter().map(|line| line["done"].as_u64().unwrap()).collect::<Vec<_>>(),
        (1..8).collect::<Vec<_>>()
    );
    for line in progress {
        assert!(line["total"].is_null() && line["seconds_left"].is_null(), "{line}");
        assert!(line["frames_per_second"].as_f64().unwrap() > 0.0 && line["residual_grey"].is_number(), "{line}");
        assert!(["decode", "correlate", "write", "camera"].contains(&line["limited_by"].as_str().unwrap()), "{line}");
    }
}

#[test]
fn a_file_that_stays_half_written_is_no_field_and_is_done_when_it_is_whole() {
    let desk = desk(4);
    (0..3).for_each(|k| {
        fs::write(desk.path(&format!("shots/{}", name(k))), desk.bytes(&format!("made/{k}.png"))).unwrap()
    });
    let (path, bytes) = (desk.path(&format!("shots/{}", name(3))), desk.bytes("made/3.png"));
    let (half, rest) = bytes.split_at(bytes.len() / 2);
    fs::write(&path, half).unwrap();
    let (code, said) = end(watch(&desk, "--timeout 1"));
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("img_9.png: the PNG file is cut off"), "{said}");
    let store = Store::open(desk.path("out")).unwrap();
    assert_eq!(store.status(3).unwrap(), Some(Status::Unreadable));
    assert_eq!([2, 3].map(|number| store.frame(number).unwrap().is_some()), [true, false]);
    OpenOptions::new().append(true).open(&path).unwrap().write_all(rest).unwrap();
    let (code, said) = end(watch(&desk, "--timeout 1"));
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("2 frames done before, 1 to do"), "{said}");
    assert_is_one_run(&desk, "whole at last");
}

#[test]
fn a_file_that_has_not_settled_at_the_end_is_left_out_and_told() {
    let desk = desk(2);
    let line = |settle: &str| format!("watch shots --reference made/0.png --output out {OPTIONS} {settle}");
    shoot(&desk, "a.png", 1);
    let child = start(&desk, &line("--settle 60"));
    let begin = Instant::now();
    while !desk.path("out/run.toml").exists() {
        assert!(begin.elapsed() < Duration::from_secs(30), "it does not begin");
        sleep(MOMENT);
    }
    sleep(5 * MOMENT);
    signal(&child, "INT");
    let (code, said) = end(child);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("1 file had not settled and left out, from shots/a.png"), "{said}");
    assert_eq!(Store::open(desk.path("out")).unwrap().n_frames(), 0);
    assert_eq!(desk.run(&line("--settle 0.1 --timeout 0.3")).fine().statuses("out"), ["converged"]);
    // Nothing at all.
    let line = format!("watch shots --quiet --pattern *.tif --output none {OPTIONS} --settle 0.1 --timeout 0.3");
    desk.run(&line).refused(&["shots: no image came for 0.3 s"]);
}

#[test]
fn a_signal_ends_it_well_and_the_same_command_goes_on() {
    for signal_name in ["INT", "TERM"] {
        let desk = desk(7);
        let child = watch(&desk, "");
        (0..4).for_each(|k| shoot(&desk, &name(k), k));
        wait_for_frames(&desk, "out", 3);
        let told: Value = serde_json::from_str(&desk.run("status out --json").stdout).unwrap();
        assert!(told["workers"][0]["watches"].as_str().is_some_and(|folder| folder.ends_with("shots")), "{told}");
        assert_eq!((&told["done"], &told["seconds_left"]), (&Value::from(3), &Value::Null));
        let status = desk.run("status out");
        assert!(status.stdout.contains(", watching ") && status.stdout.contains("3 of 3 frames done"), "{status}");
        signal(&child, signal_name);
        let (code, said) = end(child);
        assert_eq!(code, Some(0), "{signal_name}: {said}");
        assert!(said.contains("stopped watching shots; the same command resumes"), "{said}");
        assert_is_one_run(&desk, "before the signal");
        let child = watch(&desk, "--timeout 1");
        (4..7).for_each(|k| shoot(&desk, &name(k), k));
        let (code, said) = end(child);
        assert_eq!(code, Some(0), "{said}");
        assert!(said.contains("3 frames done before"), "{said}");
        assert_is_one_run(&desk, "gone on");
    }
}

#[test]
fn a_signal_with_frames_left_finishes_those_in_flight_and_correlate_does_the_rest() {
    let desk = desk(4);
    for k in 0..150 {
        fs::hard_link(desk.path(&format!("made/{}.png", k % 4)), desk.path(&format!("shots/{k:03}.png"))).unwrap();
    }
    let child = watch(&desk, "");
    wait_for_frames(&desk, "out", 3);
    signal(&child, "TERM");
    let (code, said) = end(child);
    assert_eq!(code, Some(130), "{said}");
    assert!(said.contains("of 149 frames done: the same command goes on from here"), "{said}");
    let ran = desk.correlate(&format!("--output out {OPTIONS} shots/*.png")).fine();
    assert!(ran.stderr.contains("frames done before"), "{ran}");
    assert_is_one_run(&desk, "half watched");
}

#[test]
fn killed_at_random_moments_and_watched_again_the_results_have_the_same_bits() {
    let seed = 20_261_122;
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let desk = desk(16);
    std::thread::scope(|scope| {
        let camera = scope.spawn(|| (0..16).for_each(|k| shoot(&desk, &name(k), k)));
        let mut kills = 0;
        while !camera.is_finished() || kills < 6 {
            let mut child = watch(&desk, "");
            sleep(Duration::from_millis(u64::from(random.next_u32() % 700)));
            child.kill().unwrap();
            child.wait().unwrap();
            kills += 1;
        }
    });
    let (code, said) = end(watch(&desk, "--timeout 1"));
    assert_eq!(code, Some(0), "seed {seed}: {said}");
    assert_is_one_run(&desk, &format!("seed {seed}"));
}

#[test]
fn an_image_that_is_late_gets_the_next_number_and_correlate_over_the_folder_says_why_not() {
    let desk = desk(4);
    let child = watch(&desk, "--timeout 1.5 --reference made/0.png");
    shoot(&desk, "b.png", 1);
    wait_for_frames(&desk, "out", 1);
    shoot(&desk, "a.png", 2);
    wait_for_frames(&desk, "out", 2);
    shoot(&desk, "c.png", 3);
    let (code, said) = end(child);
    assert_eq!(code, Some(0), "{said}");
    let late = &desk.remarks("out", Code::FrameLate)[0];
    let (file, after) = (About::File("shots/a.png".into()), "shots/b.png".into());
    assert_eq!((&late.about, &late.values["after"]), (&file, &after), "{said}");
    assert_eq!(
        Store::open(desk.path("out")).unwrap().header().frames,
        ["b", "a", "c"].map(|n| format!("shots/{n}.png"))
    );
    let line = format!("--reference made/0.png --output out {OPTIONS}");
    desk.correlate(&format!("{line} shots/*.png")).refused(&["b.png\" in the store", "a.png\" asked"]);
    let ran = desk.correlate(&format!("{line} shots/b.png shots/a.png shots/c.png")).fine();
    assert!(ran.stderr.contains("3 frames done before, nothing is missing"), "{ran}");
    // The list that it keeps is one to go on with.
    desk.correlate("--case out/run.toml --threads 2 --output out").fine();
}

#[test]
fn what_cannot_be_watched_is_refused_and_changes_nothing() {
    let desk = desk(3);
    (0..3).for_each(|k| shoot(&desk, &name(k), k));
    let line = format!("watch shots --settle 0.1 --timeout 0.5 --output out {OPTIONS}");
    desk.run(&line).fine();
    let before = results(&desk, "out");
    for (line, wanted) in [
        (line.replace("--element-size 8", "--element-size 16"), "element_size_px: 8 in the store, 16 asked"),
        (line.replace("--export none", "--export csv"), "run.export"),
        (line.clone() + " --reference made/1.png", "images.reference"),
        (line.clone() + " --shard 1/2 --start independent", "--shard"),
        (line.clone() + " --pages all", "each file of a watched folder is one frame"),
        (line.clone() + " made", "made"),
        (line.clone() + " --pattern ../*.png", "files of other folders"),
        (line.clone() + " --pattern [.png", "not a valid pattern"),
        (line.replace("--settle 0.1", "--settle 0"), "--settle"),
        (line.replace("--timeout 0.5", "--timeout soon"), "'soon' is not a number"),
        (line.replace("--timeout 0.5", "--timeout 0.1"), "no file can settle"),
        (line.replace("shots", "nowhere"), "nowhere: there is no such folder"),
        (line.replace("shots ", ""), "SHOTS"),
    ] {
        desk.run(&line).refused(&[wanted]);
        assert_same(&before, &results(&desk, "out"), &line);
    }
    let begin = Instant::now();
    let child = watch(&desk, "");
    let who = format!("process {} on ", child.id());
    while !desk.run("status out").stdout.contains(&who) {
        assert!(begin.elapsed() < Duration::from_secs(30), "it does not begin");
    }
    desk.run(&line).refused(&["out: is being worked on", &who, "watching"]);
    signal(&child, "INT");
    assert_eq!(end(child).0, Some(0));
    assert_same(&before, &results(&desk, "out"), "with another at the door");
}

#[test]
fn a_reference_that_is_renewed_while_watching_gives_the_bits_of_correlate() {
    let desk = desk(9);
    let chain = "--update-reference every 2";
    let write = |k: usize| {
        fs::write(desk.path(&format!("shots/{}", name(k))), desk.bytes(&format!("made/{k}.png"))).unwrap();
    };
    (0..5).for_each(write);
    let child = watch(&desk, chain);
    wait_for_frames(&desk, "out", 4);
    signal(&child, "KILL");
    end(child);
    // These were not there when the first watch began: the one that goes on reads its reference again.
    (5..9).for_each(write);
    let (code, said) = end(watch(&desk, &format!("{chain} --timeout 1")));
    assert_eq!(code, Some(0), "{said}");
    // On a busy machine the state of the fourth is not yet on the disk.
    let before = ["3 frames done before", "4 frames done before"];
    assert!(before.iter().any(|words| said.contains(words)) && said.contains("the new reference"), "{said}");
    desk.correlate(&format!("--output whole --overwrite {OPTIONS} {chain} shots/*.png")).fine();
    assert_same(&results(&desk, "whole"), &results(&desk, "out"), "watched twice");
}
