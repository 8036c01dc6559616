//! Runs that are stopped and go on: killed, cut, refused, shared among processes; what they say of themselves.
#![cfg(feature = "cli")]
#![cfg(unix)] // signals

use crate::program;
use program::process::{assert_same, end, frames_done, results, signal, start, wait_for_frames};
use program::{Desk, INSIDE, Ran, moved, remarks, speckle};
use quadrille::field::Status;
use quadrille::imaging::{Image, Levels, Pixels};
use quadrille::io::store::Store;
use quadrille::remark::Code;
use quadrille::synth::{Depth, Motion, RenderOptions, Rotation, Texture, Translation, render};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs::{self, OpenOptions};
use std::process::{Child, Command};
use std::time::Duration;

/// Frames of the series of most tests.
const N: usize = 24;

/// A desk with `s/00.png` ..., a series that drifts by 0.45 px a frame: elements at the border of the image leave it
/// one by one, which are nodes that are not measured. One frame jumps, one is no image, one shows something else.
fn desk() -> Desk {
    desk_of(|k| Translation([0.45 * k, -0.3 * k]))
}

/// The same of another motion, given for each frame.
fn desk_of<M: Motion>(motion: impl Fn(f64) -> M) -> Desk {
    let desk = Desk::new();
    for k in 0..N {
        match k {
            7 => desk.write("s/07.png", "no image"),
            9 => desk.image("s/09.png", &moved([300.0, 200.0])),
            _ => desk.image(&format!("s/{k:02}.png"), &speckle(&motion(k as f64), Depth::U8)),
        }
    }
    desk
}

/// The arguments of most runs.
const LINE: &str = "--element-size 8 --threads 2 --roi 0,0,128,96";

/// A run without any interruption, to compare with. Two frames of the series have no field.
#[track_caller]
fn whole_run(desk: &Desk, more: &str) -> BTreeMap<String, Vec<u8>> {
    desk.correlate(&format!("{LINE} {more} --output whole s/*.png")).incomplete();
    let store = Store::open(desk.path("whole")).unwrap();
    let unmeasured =
        |number| store.frame(number).unwrap().is_some_and(|frame| !frame.measurement.measured.iter().all(|&m| m));
    assert!((1..N).any(unmeasured), "the test wants nodes that are not measured");
    assert_eq!(store.status(7).unwrap(), Some(Status::Unreadable));
    assert_eq!(store.status(N - 1).unwrap(), Some(Status::Converged));
    results(desk, "whole")
}

// ---- stopped and gone on ----

/// Kills runs with the flags `more` so often, each once a number of frames are done that chance tells, and gives them again.
#[track_caller]
fn killed(desk: &Desk, more: &str, n_kills: usize, seed: u64) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let whole = whole_run(desk, more);
    let renewed = desk.json("whole/summary.json")["reference_updates"].is_array();
    assert_eq!(renewed, more.contains("--update-reference"));
    let (mut kills, mut runs) = (0, 0);
    while kills < n_kills || runs < 2 {
        runs += 1;
        let output = format!("out{runs}");
        loop {
            let mut child = start(desk, &format!("correlate {LINE} {more} --output {output} s/*.png"));
            let done = frames_done(desk, &output) + random.next_u32() as usize % 4;
            while kills < n_kills && frames_done(desk, &output) < done && child.try_wait().unwrap().is_none() {
                std::thread::sleep(Duration::from_millis(1));
            }
            if kills < n_kills && child.try_wait().unwrap().is_none() {
                child.kill().unwrap();
                child.wait().unwrap();
                kills += 1;
                continue;
            }
            let (code, said) = end(child);
            assert_eq!(code, Some(1), "seed {seed}, after {kills} kills: {said}");
            break;
        }
        assert_same(&whole, &results(desk, &output), &format!("seed {seed}, after {kills} kills"));
    }
}

#[test]
fn a_run_that_is_killed_after_some_frames_and_given_again_ends_with_the_same_bits() {
    killed(&desk(), "", 5, 20_261_121);
}

#[test]
fn so_does_one_whose_reference_is_renewed() {
    let turning = desk_of(|k| Rotation::new(3.0 * k, program::WIDTH, program::HEIGHT));
    killed(&turning, "--update-reference every:4", 4, 20_261_122);
}

/// More of the same, by `make release-check PARTS=thorough`.
mod thorough {
    use super::*;

    #[test]
    #[ignore = "make release-check PARTS=thorough"]
    fn runs_that_are_killed_tens_of_times_end_with_the_same_bits() {
        let turning = desk_of(|k| Rotation::new(3.0 * k, program::WIDTH, program::HEIGHT));
        killed(&desk(), "", 20, 20_261_124);
        killed(&turning, "--update-reference every:4", 15, 20_261_125);
        killed(&desk(), "--update-reference every:2", 15, 20_261_126);
    }
}

#[test]
fn a_frame_whose_files_are_cut_or_lost_is_done_again_and_nothing_else() {
    let desk = desk();
    let whole = whole_run(&desk, "--export csv");
    let line = format!("{LINE} --export csv --output whole s/*.png");
    // Frame 15 starts from 13 and 14 again.
    let files = [
        "fields.zarr/displacement_px/c.14.0.0",
        "fields.zarr/status/c.14",
        "fields.zarr/residual_grey/c.14.0",
        "restart/frames/000015.json",
        "csv/000015.csv",
    ];
    for file in files {
        let bytes = desk.bytes(&format!("whole/{file}"));
        let mut changed = bytes.clone();
        changed[bytes.len() / 2] ^= 0x15;
        // Of tables and of the record only the length is known.
        let of_store = file.starts_with("fields");
        for (what, content) in [
            ("cut", Some(&bytes[..bytes.len() / 2])),
            ("empty", Some(&[][..])),
            ("lost", None),
            ("changed", Some(&changed[..])),
        ] {
            let path = desk.path(&format!("whole/{file}"));
            match content {
                Some(_) if what == "changed" && !of_store => continue,
                Some(content) => fs::write(&path, content).unwrap(),
                None => fs::remove_file(&path).unwrap(),
            }
            let ran = desk.correlate(&line).incomplete();
            // The frame that is no image is read again each time.
            assert!(ran.stderr.contains(&format!("{} frames done before, 2 to do", N - 3)), "{file}, {what}: {ran}");
            let said = ran.stderr.contains("incomplete and will be recomputed: 15\n");
            assert_eq!(said, !(file.contains("status") && what == "lost"), "{file}, {what}: {ran}");
            assert_same(&whole, &results(&desk, "whole"), &format!("{file}, {what}"));
        }
    }
}

#[test]
fn frames_lost_from_anywhere_are_done_again_from_the_frames_before_them() {
    let desk = desk();
    let whole = whole_run(&desk, "--export none");
    for lost in [&[1][..], &[2, 3], &[4, 8, 9, 10, 23], &[10, 11, 12, 14, 16], &[22, 23]] {
        for number in lost {
            fs::remove_file(desk.path(&format!("whole/fields.zarr/status/c.{}", number - 1))).unwrap();
        }
        desk.correlate(&format!("{LINE} --export none --output whole s/*.png")).incomplete();
        assert_same(&whole, &results(&desk, "whole"), &format!("{lost:?}"));
    }
}

#[test]
fn a_finished_run_is_left_as_it_is_and_resume_says_the_same_as_nothing() {
    let desk = Desk::with_series();
    let line = format!("{INSIDE} --output out ref.png a.png b.png");
    desk.correlate(&line).fine();
    let before = results(&desk, "out");
    for flag in ["", "--resume"] {
        let ran = desk.correlate(&format!("{flag} {line}")).fine();
        assert!(ran.stderr.contains("2 frames done before, nothing is missing"), "{ran}");
        assert_same(&before, &results(&desk, "out"), flag);
    }
    desk.correlate(&format!("--resume --overwrite {line}")).refused(&["--resume", "--overwrite"]);
    // Quadrille of other threads gives the same bits: that is no other run.
    desk.correlate(&format!("--threads 1 {line}")).fine();
}

/// Runs the series `s/` of the desk with one thread, where each frame waits for the one before, and with more, where it
/// begins at a forecast.
#[track_caller]
fn overlapped(desk: &Desk, line: &str) {
    let frames = |threads: usize| {
        let ran = desk.correlate(&format!("{line} --export csv --threads {threads} --overwrite --output out s/*.png"));
        let mut all = results(desk, "out");
        // Frames may be no images: the exit code is that of the series.
        all.insert("exit code".into(), format!("{:?}", ran.code).into_bytes());
        let summary: Value = serde_json::from_slice(&all["summary.json"]).unwrap();
        all.insert("summary.json".into(), format!("{:#}", summary["frames"]).into_bytes());
        // All but the number of threads.
        all.retain(|file, _| !["fields.zarr/zarr.json", "run.toml"].contains(&file.as_str()));
        all
    };
    let whole = frames(1);
    for threads in [2, 5] {
        assert_same(&whole, &frames(threads), &format!("{threads} threads"));
    }
}

#[test]
fn frames_that_are_done_at_the_same_time_have_the_bits_of_one_after_the_other() {
    overlapped(&desk(), "--element-size 8 --roi 0,0,128,96");
}

#[test]
fn a_frame_begun_at_a_forecast_that_was_wrong_is_begun_again() {
    // Under one element of three frames lies something else: it converges, is then left out, and the field is another
    // one than was forecast. Of a program that keeps what was begun at the forecast 15 of the 23 frames differ.
    const SIDE: usize = 256;
    const HIDDEN: [usize; 5] = [8, 9, 15, 16, 17];
    let desk = Desk::new();
    let texture = Texture::new(1, 4.5).unwrap();
    for k in 0..24 {
        let options = RenderOptions { noise: 2.0, frame: k, ..RenderOptions::new(SIDE, SIDE) };
        let image = render(&texture, &Translation([0.15 * k as f64, -0.1 * k as f64]), &options).unwrap();
        let Levels::U8(pixels) = image.pixels() else { panic!("8 bit are asked for") };
        let mut pixels = pixels.to_vec();
        if HIDDEN.contains(&(k as usize)) {
            let mut random = ChaCha8Rng::seed_from_u64(1);
            let block = (48..64).flat_map(|y| (48..64).map(move |x| y * SIDE + x));
            block.for_each(|at| pixels[at] = random.next_u32() as u8);
        }
        desk.image(&format!("s/{k:02}.png"), &Image::new(SIDE, SIDE, Pixels::U8(pixels)).unwrap());
    }
    overlapped(&desk, "--element-size 16");
    for number in HIDDEN {
        assert!(
            desk.read(&format!("out/csv/{number:06}.csv")).contains("no_match"),
            "frame {number} leaves nothing out"
        );
    }
    // Gone on with after frame 16, the next one begins without the same elements.
    let whole = results(&desk, "out");
    fs::remove_file(desk.path("out/restart/frames/000017.json")).unwrap();
    let record = desk.read("out/restart/frames/000016.json");
    assert!(record.contains("\"left_out\":["), "{record}");
    desk.correlate("--element-size 16 --export csv --threads 5 --output out s/*.png").fine();
    assert_same(&whole, &results(&desk, "out"), "gone on after frame 16");
}

#[test]
fn ctrl_c_finishes_the_frames_in_flight_and_says_how_to_go_on() {
    for (name, frame) in [("INT", 3), ("TERM", 1)] {
        let desk = desk();
        // A longer series: it shall not be over before the signal comes.
        for k in N..150 {
            fs::hard_link(desk.path(&format!("s/{:02}.png", 10 + k % 4)), desk.path(&format!("s/{k}.png"))).unwrap();
        }
        let child = start(&desk, &format!("correlate {LINE} --output out s/*.png"));
        wait_for_frames(&desk, "out", frame);
        signal(&child, name);
        let (code, said) = end(child);
        assert_eq!(code, Some(130), "{name}: {said}");
        assert!(said.contains("of 149 frames done: the same command goes on from here"), "{name}: {said}");
        let store = Store::open(desk.path("out")).unwrap();
        let done = (1..150).filter(|&number| store.status(number).unwrap().is_some()).count();
        assert_eq!(desk.json("out/summary.json")["frames"].as_array().unwrap().len(), done);
        assert!((frame..149).contains(&done), "{name}: {done} frames");
        assert!(desk.files("out").iter().all(|file| !file.ends_with(".part")));
        if name == "INT" {
            desk.correlate(&format!("{LINE} --output out s/*.png")).incomplete();
            desk.correlate(&format!("{LINE} --output whole s/*.png")).incomplete();
            assert_same(&results(&desk, "whole"), &results(&desk, "out"), name);
        }
    }
}

#[test]
fn a_disk_that_was_full_and_has_room_again_is_gone_on_with() {
    let desk = Desk::with_series();
    fs::create_dir(desk.path("many")).unwrap();
    for k in 0..40 {
        fs::copy(desk.path(["a.png", "b.png"][k % 2]), desk.path(&format!("many/{k:02}.png"))).unwrap();
    }
    fs::create_dir(desk.path("disk")).unwrap();
    let line = "correlate --quiet --export none --reference ref.png --roi 16,16,112,80 --element-size 8";
    let script = format!(
        "mount -t tmpfs -o size=700k tmpfs disk || exit 99
        \"$1\" {line} --output disk/out 'many/*.png'; full=$?
        mount -o remount,size=20m disk || exit 99
        \"$1\" {line} --output disk/out 'many/*.png' || exit 98
        cp -r disk/out saved; exit $full"
    );
    let run = Command::new("unshare")
        .args(["--map-root-user", "--mount", "sh", "-c", &script, "sh", env!("CARGO_BIN_EXE_quadrille")])
        .env("QUADRILLE_DEVICE", "cpu")
        .current_dir(desk.path(""))
        .output();
    let Ok(run) = run else { return println!("SKIPPED: there is no unshare") };
    let said = String::from_utf8_lossy(&run.stderr);
    if run.status.code() == Some(99) || said.contains("unshare: ") {
        return println!("SKIPPED: no file system can be mounted here: {said}");
    }
    assert_eq!(run.status.code(), Some(2), "{said}");
    assert!(said.contains("disk/out/") && said.contains("No space left"), "{said}");
    desk.run(&format!("{line} --output whole many/*.png")).fine();
    assert_same(&results(&desk, "whole"), &results(&desk, "saved"), "after a full disk");
}

// ---- whose reference is renewed ----

/// Runs of the usual series into `whole`, with a new reference after every two frames.
fn renewing() -> String {
    format!("{LINE} --update-reference 2 --export none --output whole s/*.png")
}

/// A desk with such a run, and its results.
fn renewed() -> (Desk, BTreeMap<String, Vec<u8>>) {
    let desk = desk();
    let whole = whole_run(&desk, "--update-reference 2 --export none");
    let updates = desk.json("whole/summary.json")["reference_updates"].clone();
    assert!(updates.as_array().unwrap().len() > 5, "{updates}");
    (desk, whole)
}

#[test]
fn frames_after_one_that_is_lost_are_done_again_when_the_reference_depends_on_it() {
    let (desk, whole) = renewed();
    let cut = |file: String| {
        let bytes = desk.bytes(&file);
        fs::write(desk.path(&file), &bytes[..bytes.len() / 2]).unwrap();
    };
    for (number, again, done) in [
        // After frame 20 a state stays.
        (22, "21, 23", Some((20, 3))),
        (21, "22-23", Some((20, 3))),
        (12, "1-11, 13-23", None),
    ] {
        cut(format!("whole/fields.zarr/displacement_px/c.{}.0.0", number - 1));
        let ran = desk.correlate(&renewing()).incomplete();
        assert!(ran.stderr.contains(&format!("incomplete and will be recomputed: {number}\n")), "{ran}");
        assert!(ran.stderr.contains(&format!("depends on all frames before: {again}\n")), "{ran}");
        let before = done.map(|(done, left)| format!("{done} frames done before, {left} to do"));
        assert_eq!(before.is_none(), !ran.stderr.contains("done before"), "{ran}");
        assert!(ran.stderr.contains(&before.unwrap_or_default()), "{ran}");
        assert_same(&whole, &results(&desk, "whole"), &format!("frame {number}"));
    }
    // Nothing is missing now: the frame that is no image is one of the chain and is not tried again.
    let ran = desk.correlate(&renewing()).incomplete();
    assert!(ran.stderr.contains("23 frames done before, nothing is missing"), "{ran}");
    assert_same(&whole, &results(&desk, "whole"), "a finished run");
}

#[test]
fn a_state_that_is_damaged_or_lost_leads_to_frames_done_again_and_to_no_other_result() {
    let (desk, whole) = renewed();
    let state = |number: usize| format!("whole/restart/chain/{number:06}.npz");
    assert_eq!(desk.all_files("whole/restart/chain"), ["000020.npz", "000023.npz"]);
    let status = desk.path("whole/fields.zarr/status/c.22");
    let mark = fs::read(&status).unwrap();
    let [at_20, at_23] = [20, 23].map(|number| desk.bytes(&state(number)));
    let mut changed = at_23.clone();
    changed[at_23.len() / 2] ^= 4;
    let damages = [
        ("changed", Some(changed)),
        ("cut", Some(at_23[..at_23.len() - 9].to_vec())),
        ("empty", Some(Vec::new())),
        ("lost", None),
        ("of another frame", Some(at_20.clone())),
    ];
    for (what, content) in damages {
        match content {
            Some(content) => fs::write(desk.path(&state(23)), content).unwrap(),
            None => fs::remove_file(desk.path(&state(23))).unwrap(),
        }
        let ran = desk.correlate(&renewing()).incomplete();
        assert!(ran.stderr.contains("depends on all frames before: 21-23\n"), "{what}: {ran}");
        assert_same(&whole, &results(&desk, "whole"), what);
        assert_eq!(desk.bytes(&state(23)), at_23, "{what}");
    }
    // Killed after the state and before the status of the last frame was written.
    fs::remove_file(&status).unwrap();
    fs::remove_file(desk.path(&state(20))).unwrap();
    desk.correlate(&renewing()).incomplete();
    assert_same(&whole, &results(&desk, "whole"), "no state at all");
    assert_eq!((fs::read(&status).unwrap(), desk.bytes(&state(20))), (mark, at_20));
}

#[test]
fn an_unreadable_frame_that_came_back_begins_another_chain_from_there() {
    let (desk, _) = renewed();
    desk.image("s/07.png", &moved([3.15, -2.1]));
    let ran = desk.correlate(&renewing()).incomplete();
    assert!(ran.stderr.contains("depends on all frames before: 1-23"), "{ran}");
    let again = results(&desk, "whole");
    desk.correlate(&renewing().replace("whole", "fresh")).incomplete();
    assert_same(&results(&desk, "fresh"), &again, "with the frame that came back");
    assert_eq!(desk.json("whole/summary.json")["counts"]["unreadable"], Value::Null);
}

#[test]
fn a_replaced_image_is_measured_again_with_all_that_depends_on_it() {
    let (desk, whole) = renewed();
    let was = desk.bytes("s/20.png");
    desk.image("s/20.png", &moved([9.1, -6.1]));
    let ran = desk.correlate(&renewing()).incomplete();
    assert!(ran.stderr.contains("the images of 1 frame were replaced since and will be measured again: 20\n"), "{ran}");
    assert!(ran.stderr.contains("depends on all frames before: 1-19, 21-23\n"), "{ran}");
    let fields = |results: &BTreeMap<String, Vec<u8>>| -> BTreeMap<String, Vec<u8>> {
        results
            .iter()
            .filter(|(name, _)| name.contains("displacement_px"))
            .map(|(k, v)| (k.clone(), v.clone()))
            .collect()
    };
    assert_ne!(fields(&whole), fields(&results(&desk, "whole")));
    // And again, when it is as it was.
    desk.write("s/20.png", was);
    desk.correlate(&renewing()).incomplete();
    assert_same(&fields(&whole), &fields(&results(&desk, "whole")), "with the image as it was");
}

// ---- what is refused ----

#[test]
fn a_store_of_before_there_was_a_choice_of_references_is_gone_on_with() {
    let desk = Desk::with_series();
    let line = format!("{INSIDE} --output out ref.png a.png b.png");
    desk.correlate(&line).fine();
    let group = desk.read("out/fields.zarr/zarr.json");
    let before = group.replace("update_reference = \\\"never\\\"\\n", "");
    assert_ne!(group, before);
    desk.write("out/fields.zarr/zarr.json", before);
    let ran = desk.correlate(&line).fine();
    assert!(ran.stderr.contains("2 frames done before, nothing is missing"), "{ran}");
    desk.correlate(&format!("--update-reference residual {line}"))
        .refused(&["update_reference: \"never\" in the store, \"residual\" asked"]);
}

#[test]
fn other_options_and_images_are_refused_with_the_difference_and_change_nothing() {
    let desk = Desk::with_series();
    let line = |flags: &str| format!("{flags} --output out ref.png a.png b.png");
    desk.correlate(&line(INSIDE)).fine();
    let before = results(&desk, "out");
    let inside = format!("{INSIDE} --element-size 8");
    for (flags, wanted) in [
        (inside.as_str(), "element_size_px: 16 in the store, 8 asked"),
        ("--roi 16,16,112,64", "zone: "),
        (&format!("{INSIDE} --start independent"), "start: \"previous\" in the store, \"independent\" asked"),
        (&format!("{INSIDE} --interpolation cubic"), "interpolation: \"quintic\" in the store, \"cubic\" asked"),
        (
            &format!("{INSIDE} --update-reference every 3"),
            "update_reference: \"never\" in the store, \"every 3\" asked",
        ),
        (&format!("{INSIDE} --noise 2"), "noise: none in the store, 2.0 asked"),
        (&format!("{INSIDE} --isa scalar"), "run.isa: "),
        (&format!("{INSIDE} --export none"), "run.export: "),
    ] {
        desk.correlate(&line(flags)).refused(&["out: ", "another run", wanted, "--overwrite"]);
        assert_same(&before, &results(&desk, "out"), flags);
    }
    // A series may be extended at its end.
    desk.correlate(&format!("{INSIDE} --output out ref.png a.png")).refused(&["2 frames in the store, 1 frames asked"]);
    desk.correlate(&format!("{INSIDE} --output out ref.png c.png a.png b.png"))
        .refused(&["a.png\" in the store", "c.png\" asked"]);
    desk.correlate(&format!("{INSIDE} --output out ref.png a.png c.png"))
        .refused(&["b.png\" in the store", "c.png\" asked"]);
    desk.image("ref.png", &moved([0.1, 0.0]));
    desk.correlate(&line(INSIDE)).refused(&["content of ref.png, SHA-256"]);
    assert_same(&before, &results(&desk, "out"), "refused runs");
    desk.correlate(&format!("--overwrite {}", line(&inside))).fine();
    assert_eq!(Store::open(desk.path("out")).unwrap().header().element_size_px, 8.0);
}

#[test]
fn an_input_that_was_removed_is_named_and_one_that_came_back_is_read() {
    let desk = Desk::with_series();
    let line = format!("{INSIDE} --output out --reference ref.png [abc].png");
    desk.write("b.png", "not yet");
    let ran = desk.correlate(&line).incomplete();
    assert_eq!(ran.statuses("out"), ["converged", "unreadable", "converged"]);
    fs::remove_file(desk.path("b.png")).unwrap();
    desk.correlate(&line).refused(&["3 frames in the store, 2 frames asked"]);
    desk.image("b.png", &moved([0.5, -0.5]));
    let ran = desk.correlate(&line).fine();
    assert!(ran.stderr.contains("2 frames done before, 1 to do"), "{ran}");
    assert_eq!(ran.statuses("out"), ["converged"; 3]);
}

#[test]
fn a_second_process_is_told_who_works_on_the_run() {
    let desk = desk();
    let line = format!("correlate {LINE} --output out s/*.png");
    let child = start(&desk, &line);
    wait_for_frames(&desk, "out", 1);
    signal(&child, "STOP");
    let who = format!("process {} on ", child.id());
    desk.run(&line).refused(&["out: is being worked on", &who, "another --output folder"]);
    desk.run(&format!("{line} --overwrite")).refused(&[&who]);
    desk.run(&format!("{line} --start independent --shard 1/2")).refused(&[&who]);
    let status = desk.run("status out --json");
    assert_eq!(status.code, Some(1), "{status}");
    let status: Value = serde_json::from_str(&status.stdout).unwrap();
    assert_eq!(status["workers"][0]["pid"], child.id());
    signal(&child, "CONT");
    let (code, said) = end(child);
    assert_eq!(code, Some(1), "{said}");
    assert_same(&whole_run(&desk, ""), &results(&desk, "out"), "with others at the door");
}

// ---- a series that grows ----

#[test]
fn more_files_behind_those_of_before_extend_the_series_to_the_bits_of_one_run() {
    let desk = desk();
    for start in ["previous", "independent"] {
        let line = |files: &str| format!("{LINE} --start {start} --export csv --output {start} {files}");
        desk.correlate(&line("s/0[0-3].png"));
        let ran = desk.correlate(&line("s/0*.png")).incomplete();
        assert!(ran.stderr.contains("3 frames done before, 6 to do"), "{ran}");
        assert_eq!(desk.run(&format!("status {start}")).code, Some(1));
        // From another folder, and without saying which tables.
        let from = desk.path("elsewhere");
        fs::create_dir_all(&from).unwrap();
        let [output, files] = [start, "s/*.png"].map(|name| desk.path(name).display().to_string());
        let line = format!("correlate {LINE} --start {start} --output {output} {files}");
        let ran = Command::new(env!("CARGO_BIN_EXE_quadrille"))
            .args(line.split_whitespace())
            .env("QUADRILLE_DEVICE", "cpu")
            .current_dir(&from)
            .output()
            .unwrap();
        assert_eq!(ran.status.code(), Some(1), "{ran:?}");
        desk.correlate(&format!("{LINE} --start {start} --export csv --output whole-{start} s/*.png")).incomplete();
        let [whole, grown] = [format!("whole-{start}"), start.to_owned()].map(|folder| results(&desk, &folder));
        for name in ["fields.zarr/displacement_px/c.22.0.0", "fields.zarr/sigma_px/zarr.json", "run.toml"] {
            assert_eq!(whole[name], grown[name], "{start}: {name}");
        }
        assert_eq!(whole.keys().collect::<Vec<_>>(), grown.keys().collect::<Vec<_>>());
    }
    // The series in the store has more frames now: that is for one process to add.
    let line = format!("{LINE} --start independent --shard 1/2 --export csv --output independent s/*.png");
    fs::copy(desk.path("s/03.png"), desk.path("s/99.png")).unwrap();
    desk.correlate(&line).refused(&["images.deformed: 23 entries in the store, 24 entries asked"]);
}

// ---- frames in any order ----

#[test]
fn four_shards_at_once_write_what_one_process_writes() {
    let desk = desk();
    let whole = whole_run(&desk, "--start independent");
    let line = |shard: usize| format!("correlate {LINE} --shard {shard}/4 --output out s/*.png");
    let shards: Vec<Child> = (1..=4).map(|shard| start(&desk, &line(shard))).collect();
    let ended: Vec<_> = shards.into_iter().map(end).collect();
    let store = Store::open(desk.path("whole")).unwrap();
    let fails = |number: &usize| store.status(*number).unwrap() != Some(Status::Converged);
    for (shard, (code, said)) in (1..).zip(&ended) {
        let failed = (shard..N).step_by(4).filter(fails).count();
        assert_eq!(*code, Some(i32::from(failed > 0)), "{failed} frames of shard {shard} fail: {said}");
    }
    assert_same(&whole, &results(&desk, "out"), "four shards");
    // One more time, some of them lost; and one process may do what is missing of all.
    for number in [4, 8, 12, 17] {
        fs::remove_file(desk.path(&format!("out/fields.zarr/status/c.{}", number - 1))).unwrap();
    }
    let ran = desk.run(&line(4));
    assert!(ran.stderr.contains("2 frames done before, 3 to do"), "{ran}");
    assert_eq!(desk.run("status out").code, Some(1));
    desk.correlate(&format!("{LINE} --start independent --output out s/*.png")).incomplete();
    assert_same(&whole, &results(&desk, "out"), "four shards and one process");
}

#[test]
fn shards_that_cannot_be_are_refused() {
    let desk = Desk::with_series();
    let line = |flags: &str| format!("{INSIDE} --output out {flags} ref.png a.png b.png c.png");
    for (flags, wanted) in [
        ("--shard 3/2", "'3/2' is not a share"),
        ("--shard x", "such as 2/4"),
        ("--shard slurm", "SLURM_ARRAY_TASK_ID is not set"),
        ("--shard 1/2 --start previous", "--start independent"),
        ("--shard 1/2 --overwrite", "--overwrite"),
    ] {
        desk.correlate(&line(flags)).refused(&[wanted]);
    }
    let words = line("--shard slurm");
    let words: Vec<&str> = ["correlate"].into_iter().chain(words.split_whitespace()).collect();
    let environment =
        |id| [("SLURM_ARRAY_TASK_ID", id), ("SLURM_ARRAY_TASK_COUNT", "2"), ("SLURM_ARRAY_TASK_MIN", "0")];
    desk.run_with(&environment("1"), &words).fine();
    let store = Store::open(desk.path("out")).unwrap();
    assert_eq!([1, 2, 3].map(|number| store.status(number).unwrap().is_some()), [false, true, false]);
    assert_eq!(desk.json("out/summary.json")["frames"].as_array().unwrap().len(), 0, "the summary is of the whole");
    desk.run_with(&environment("0"), &words).fine();
    assert_eq!(desk.json("out/summary.json")["frames"].as_array().unwrap().len(), 3);
}

#[test]
fn tracked_and_independent_frames_agree() {
    let desk = desk();
    for start in ["previous", "independent"] {
        desk.correlate(&format!("{LINE} --start {start} --export none --output {start} s/*.png")).incomplete();
    }
    let stores = ["previous", "independent"].map(|name| Store::open(desk.path(name)).unwrap());
    let (mut compared, mut other_elements) = (0, 0);
    for number in 1..N {
        let fields = stores.each_ref().map(|store| store.frame(number).unwrap().map(|frame| frame.measurement));
        let [Some(tracked), Some(alone)] = fields else { continue };
        if tracked.status != Status::Converged || alone.status != Status::Converged {
            continue;
        }
        compared += 1;
        let both = || (0..tracked.measured.len()).filter(|&node| tracked.measured[node] && alone.measured[node]);
        let larger = |node: usize| (0..2).map(|c| tracked.sigma[node][c].max(alone.sigma[node][c])).fold(0.0, f64::max);
        // An element that has lost about half of its pixels is in or out by where the iteration came from, which the
        // uncertainties beside it tell; the fields then agree within these.
        let differs = both().any(|node| (tracked.sigma[node][0] / alone.sigma[node][0] - 1.0).abs() > 0.05);
        other_elements += usize::from(differs);
        for node in both() {
            let (a, b) = (tracked.displacement[node], alone.displacement[node]);
            let difference = (a[0] - b[0]).abs().max((a[1] - b[1]).abs());
            let allowed = if differs { 1e-3 + 2.0 * larger(node) } else { 1e-3 };
            assert!(difference < allowed, "frame {number}, node {node}: {difference} px");
        }
    }
    assert!(other_elements <= 4, "{other_elements} frames with other elements");
    assert!(compared > N - 6, "{compared} frames");
}

#[test]
fn a_frame_that_tracking_loses_is_searched_for_and_says_so() {
    let desk = Desk::new();
    for (k, u) in [[0.0, 0.0], [0.3, 0.0], [0.6, 0.0], [21.0, 17.0], [21.3, 17.0]].into_iter().enumerate() {
        desk.image(&format!("s/{k}.png"), &moved(u));
    }
    let ran = desk.correlate("--roi 40,32,88,64 --output out s/*.png").fine();
    let frames = ran.frames("out");
    let lost: Vec<_> =
        frames.iter().filter(|frame| frame["start"] == "cold").map(|frame| frame["number"].as_u64()).collect();
    // Frame 4 is predicted to jump as well.
    assert_eq!(lost, [Some(1), Some(3), Some(4)], "{frames:#?}");
    assert_eq!(remarks(&frames[2], Code::TrackingRestarted).len(), 1, "{frames:#?}");
    assert!(frames[0].get("remarks").is_none());
}

// ---- what it says of itself ----

#[test]
fn status_tells_what_is_done_failed_and_missing() {
    let desk = desk();
    assert_eq!(desk.run("status out").refused(&["out", "no fields.zarr"]).code, Some(2));
    whole_run(&desk, "");
    let status = |n: i32| {
        let ran = desk.run("status whole --json");
        assert_eq!(ran.code, Some(n), "{ran}");
        serde_json::from_str::<Value>(&ran.stdout).unwrap()
    };
    let told = status(1);
    assert_eq!(told["complete"], true);
    assert_eq!([&told["frames"], &told["done"], &told["converged"]], [N - 1, N - 1, N - 3]);
    assert_eq!(told["failed"]["unreadable"], serde_json::json!([[7, 7]]));
    assert_eq!(told["quadrille_of_store"], env!("CARGO_PKG_VERSION"));
    assert!(told["device"].as_str().unwrap().starts_with("cpu"));
    assert!(told["frames_per_second"].as_f64().unwrap() > 0.0);
    assert_eq!(told["workers"], serde_json::json!([]));
    for number in [3, 4, 5, 20] {
        fs::remove_file(desk.path(&format!("whole/fields.zarr/status/c.{}", number - 1))).unwrap();
    }
    let told = status(1);
    assert_eq!((&told["complete"], &told["done"]), (&Value::from(false), &Value::from(N - 5)));
    assert_eq!(told["missing"], serde_json::json!([[3, 5], [20, 20]]));
    let ran = desk.run("status whole");
    assert_eq!(ran.code, Some(1));
    for wanted in
        ["19 of 23 frames done", "unreadable: 7", "missing: 3-5, 20", "the same `quadrille correlate` command"]
    {
        assert!(ran.stdout.contains(wanted), "'{wanted}' is not said: {ran}");
    }
    let fine = Desk::with_series();
    fine.correlate(&format!("{INSIDE} --output out ref.png a.png b.png")).fine();
    assert!(fine.run("status out").printed().contains("2 of 2 frames done, 2 converged"));
    // The last of several shards was killed before it wrote the summary.
    let mut summary = fine.json("out/summary.json");
    let frames = summary["frames"].take();
    summary["frames"] = serde_json::json!([]);
    fine.write("out/summary.json", summary.to_string());
    fine.run("status out/fields.zarr").printed();
    assert_eq!(fine.json("out/summary.json")["frames"], frames);
}

#[test]
fn progress_comes_as_json_lines_when_that_is_asked_for() {
    let desk = Desk::with_series();
    let ran: Ran = desk.correlate(&format!("{INSIDE} --progress json --output out ref.png a.png b.png c.png")).fine();
    let lines: Vec<Value> = ran.stderr.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let progress: Vec<&Value> = lines.iter().filter(|line| line.get("done").is_some()).collect();
    assert_eq!((&progress[0]["done"], &progress[0]["total"]), (&Value::from(1), &Value::from(3)));
    let last = progress.last().unwrap();
    assert_eq!(
        (&last["done"], &last["failed"], &last["seconds_left"]),
        (&Value::from(3), &Value::from(0), &Value::from(0.0))
    );
    assert!(last["frames_per_second"].as_f64().unwrap() > 0.0 && last["residual_grey"].as_f64().unwrap() > 0.0);
    assert!(["decode", "correlate", "write"].contains(&last["limited_by"].as_str().unwrap()), "{last}");
    assert!(lines.iter().any(|line| line["message"].as_str().is_some_and(|text| text.contains("results in out"))));
}

// ---- memory ----

/// The most memory that a run over `n` frames of images of `size` had, KiB. The zone stays inside, as zones should.
fn peak_kib(desk: &Desk, n: usize, size: [usize; 2], element: usize) -> u64 {
    let names = format!("n{n}");
    fs::create_dir(desk.path(&names)).unwrap();
    for k in 0..n {
        let from = desk.path(["a.png", "b.png", "c.png"][k % 3]);
        fs::hard_link(from, desk.path(&format!("{names}/{k:05}.png"))).unwrap();
    }
    let [x1, y1] = size.map(|side| side - 16);
    let line = "correlate --quiet --export none --threads 2 --reference ref.png";
    let options = format!("--element-size {element} --roi 16,16,{x1},{y1}");
    let mut child = start(desk, &format!("{line} {options} --output o{n} {names}/*.png"));
    let mut most = 0;
    while child.try_wait().unwrap().is_none() {
        let status = fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap_or_default();
        let peak =
            status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB")?.parse().ok());
        most = most.max(peak.unwrap_or(0));
        std::thread::sleep(Duration::from_millis(1));
    }
    assert_eq!(end(child).0, Some(0));
    most
}

/// The most memory, KiB, of 50 frames and of `n`, of images of this size.
#[track_caller]
fn peaks_kib(n: usize, width: usize, height: usize, element: usize) -> [u64; 2] {
    let desk = Desk::new();
    let options = RenderOptions { depth: Depth::U8, ..RenderOptions::new(width, height) };
    for (name, u) in [("ref.png", 0.0), ("a.png", 0.2), ("b.png", 0.4), ("c.png", 0.6)] {
        let motion = Translation([u, 0.0]);
        desk.image(name, &render(&Texture::new(7, 4.5).unwrap(), &motion, &options).unwrap());
    }
    let [short, long] = [50, n].map(|n| peak_kib(&desk, n, [width, height], element));
    println!("peak of 50 frames {short} KiB, of {n} frames {long} KiB");
    [short, long]
}

#[test]
fn memory_grows_with_the_series_by_the_summary_alone() {
    let (n, [width, height], element) = (600, [256, 192], 4);
    let [short, long] = peaks_kib(n, width, height, element);
    if short == 0 {
        return println!("SKIPPED: there is no /proc here");
    }
    // What must not stay is the field of a frame: displacement and standard uncertainty of every node, 32 bytes. Names,
    // hashes and entries of the summary are 3 to 5 KiB a frame; half a field leaves room for them and for the
    // allocator.
    let nodes = ((width - 32) / element + 1) * ((height - 32) / element + 1);
    let field_kib = 32 * nodes as u64 / 1024;
    let allowed = short + field_kib * (n as u64 - 50) / 2;
    assert!(long < allowed, "50 frames {short} KiB, {n} frames {long} KiB, {allowed} KiB allowed");
}

#[test]
#[ignore = "a minute and a half: docs/scale.md has its command"]
fn memory_of_2000_frames_of_a_megapixel_is_that_of_50_within_a_tenth() {
    let [short, long] = peaks_kib(2000, 1024, 1024, 16);
    assert!(short > 0 && (long as f64) < 1.1 * short as f64, "50 frames {short} KiB, 2000 frames {long} KiB");
}

// ---- locks ----

#[test]
fn a_lock_that_nobody_holds_any_more_is_no_obstacle() {
    let desk = Desk::with_series();
    desk.write("out/restart/lock", r#"{"host":"elsewhere","pid":1,"since":0}"#);
    let line = format!("{INSIDE} --output out ref.png a.png");
    let lock = OpenOptions::new().write(true).open(desk.path("out/restart/lock")).unwrap();
    lock.lock().unwrap();
    desk.correlate(&line).refused(&["process 1 on elsewhere"]);
    drop(lock);
    desk.correlate(&line).fine();
}
