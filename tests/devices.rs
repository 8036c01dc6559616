//! `quadrille about devices`, `--device`, and what a run does when its device fails.

#![cfg(feature = "cli")]

#[path = "common/data.rs"]
mod data;
mod program;

use program::*;
use quadrille::remark::Code;
use serde_json::Value;

/// Where no Vulkan driver is found.
const NO_DRIVER: [(&str, &str); 2] =
    [("VK_DRIVER_FILES", "/nonexistent.json"), ("VK_ICD_FILENAMES", "/nonexistent.json")];

/// Largest difference between GPU and CPU, both converged to 1e-5 px: round-off of f32 sums, px.
const TWINS_PX: f64 = 2e-5;

/// Whether a graphics adapter is there; without one the test `name` says that it did not run, and fails when
/// QUADRILLE_GPU=require.
#[track_caller]
fn has_adapter(desk: &Desk, name: &str) -> bool {
    let listed: Value = serde_json::from_str(&desk.run("about devices --json").printed()).unwrap();
    if listed.as_array().unwrap().len() > 1 {
        return true;
    }
    assert_ne!(std::env::var("QUADRILLE_GPU").as_deref(), Ok("require"), "no graphics adapter: {name} cannot run");
    eprintln!("no graphics adapter: {name} did not run");
    false
}

fn words(line: &str) -> Vec<&str> {
    line.split_whitespace().collect()
}

/// Runs the series on the GPU, failing after so many readbacks.
#[track_caller]
fn failing<'a>(desk: &'a Desk, after: usize, output: &str) -> Ran<'a> {
    let line = format!("correlate --device gpu --tolerance 1e-5 {INSIDE} --output {output} ref.png a.png b.png c.png");
    desk.run_with(&[("QUADRILLE_GPU_FAIL_AFTER", &after.to_string())], &words(&line))
}

#[track_caller]
fn assert_same_fields(desk: &Desk, one: &str, other: &str) {
    for frame in 1..=3 {
        let rows = [one, other].map(|run| desk.rows(&format!("{run}/csv/{frame:06}.csv")));
        assert_eq!(rows[0].len(), N_INSIDE);
        for (a, b) in rows[0].iter().zip(&rows[1]) {
            for c in 0..2 {
                let difference = (a.px.displacement[c] - b.px.displacement[c]).abs();
                assert!(difference <= TWINS_PX, "frame {frame}, node {}: {difference} px", a.node);
            }
        }
    }
}

#[test]
fn devices_lists_the_cpu_and_marks_the_one_that_auto_takes() {
    let desk = Desk::new();
    let text = desk.run("about devices").printed();
    assert!(text.contains("CPU (processor)") && text.contains("* is taken by --device auto"), "{text}");
    let listed: Value = serde_json::from_str(&desk.run("about devices --json").printed()).unwrap();
    let listed = listed.as_array().unwrap();
    assert_eq!(listed[0]["device"], "cpu");
    assert_eq!(listed.iter().filter(|device| device["auto"] == true).count(), 1);
    let software_is_auto = listed.iter().any(|device| device["kind"] == "software" && device["auto"] == true);
    assert!(!software_is_auto, "{listed:?}");
}

#[test]
fn without_a_driver_auto_takes_the_cpu_and_says_so() {
    let desk = Desk::with_series();
    let line = format!("correlate --device auto {INSIDE} --output out ref.png a.png");
    let looking = [NO_DRIVER.as_slice(), &[("QUADRILLE_GPU_FROM_MPX", "0")]].concat();
    let ran = desk.run_with(&looking, &words(&line)).fine();
    assert!(ran.stderr.contains("no graphics device: the CPU does the work"), "{ran}");
    // For one small frame nobody looks.
    let ran = desk.run_with(&NO_DRIVER, &words(&line.replace("out ref", "small ref"))).fine();
    assert!(!ran.stderr.contains("no graphics device"), "{ran}");
    assert!(desk.json("out/summary.json")["device"].as_str().unwrap().starts_with("cpu"), "{ran}");
    let listed = desk.run_with(&NO_DRIVER, &["about", "devices"]).printed();
    assert!(listed.contains("no graphics device:"), "{listed}");
}

#[cfg(not(feature = "gpu"))]
#[test]
fn a_program_without_graphics_devices_says_so_and_works_on_the_cpu() {
    let desk = Desk::with_series();
    let line = |device: &str| format!("correlate --device {device} {INSIDE} --output out ref.png a.png");
    for device in ["gpu", "0", "llvmpipe"] {
        desk.run(&line(device)).refused(&["built without graphics devices", "--device cpu"]);
    }
    let ran = desk.run_with(&[("QUADRILLE_GPU_FROM_MPX", "0")], &words(&line("auto"))).fine();
    assert!(ran.stderr.contains("no graphics device: the CPU does the work"), "{ran}");
    assert!(desk.run("about devices").printed().contains("built without graphics devices"));
}

#[cfg(feature = "gpu")]
#[test]
fn without_a_driver_asking_for_a_gpu_is_refused_with_the_reason_and_what_to_install() {
    let desk = Desk::with_series();
    let line = format!("correlate --device gpu {INSIDE} --output out ref.png a.png");
    let ran = desk.run_with(&NO_DRIVER, &words(&line));
    ran.refused(&["no graphics device", "mesa-vulkan-drivers", "--device cpu"]);
    assert!(!desk.path("out/summary.json").exists());
}

#[test]
fn a_device_that_is_not_there_is_refused_with_the_list() {
    let desk = Desk::with_series();
    if has_adapter(&desk, "a_device_that_is_not_there") {
        for unknown in ["99", "abacus"] {
            let line = format!("correlate --device {unknown} {INSIDE} --output out ref.png a.png");
            desk.run(&line).refused(&[unknown, "this machine has 0"]);
        }
    }
}

#[test]
fn the_device_of_the_environment_is_taken_and_the_flag_wins() {
    let desk = Desk::with_series();
    let line = format!("correlate {INSIDE} --output out ref.png a.png");
    desk.run_with(&[("QUADRILLE_DEVICE", "abacus")], &words(&line)).refused(&["no graphics device"]);
    let line = format!("correlate --device cpu {INSIDE} --output out ref.png a.png");
    desk.run_with(&[("QUADRILLE_DEVICE", "abacus")], &words(&line)).fine();
}

/// Sampling 0.02 px off, which ends as converged with an unchanged uncertainty.
const ALTERED: (&str, &str) =
    ("QUADRILLE_GPU_ALTER", "let tx = ux - f32(floor_x);=>let tx = ux - f32(floor_x) + 0.02;");

#[cfg(feature = "gpu")]
#[test]
fn a_device_that_computes_something_else_is_refused_before_it_measures_and_found_by_the_cpu_where_it_is_trusted() {
    let desk = Desk::with_series();
    if !has_adapter(&desk, "a_device_that_computes_something_else") {
        return;
    }
    let line = format!("correlate --device gpu {INSIDE} --output out ref.png a.png");
    let words = words(&line);
    desk.run_with(&[ALTERED], &words).refused(&["does not compute what the CPU does", "differ by", "--trust-device"]);
    assert!(!desk.path("out/summary.json").exists());
    let checked = desk.run_with(&[ALTERED], &["about", "devices", "--check"]);
    assert_eq!(checked.code, Some(1), "{checked}");
    assert!(checked.stdout.contains("is NOT to be used") && checked.stdout.contains("!"), "{checked}");
    let right = desk.run("about devices --check --json").printed();
    let right: Value = serde_json::from_str(&right).unwrap();
    assert_eq!(right[0]["right"], true, "{right:#}");
    // Trusted, it measures, and nobody looks.
    let trusted = [words.as_slice(), &["--trust-device"]].concat();
    desk.run_with(&[ALTERED], &trusted).fine();
    let frame = &desk.json("out/summary.json")["frames"][0];
    assert!(frame.get("device_checked_px").is_none(), "{frame:#}");
}

#[cfg(feature = "gpu")]
#[test]
fn a_device_whose_first_frame_the_cpu_does_not_find_is_given_up_and_the_series_is_that_of_the_cpu() {
    let desk = Desk::with_series();
    if !has_adapter(&desk, "a_device_whose_first_frame_the_cpu_does_not_find") {
        return;
    }
    let line = |device: &str| {
        format!("correlate --device {device} --tolerance 1e-5 {INSIDE} --output {device} ref.png a.png b.png c.png")
    };
    desk.run(&line("cpu")).fine();
    let ran = desk.run_with(&[("QUADRILLE_GPU_ALTER_LATER", ALTERED.1)], &words(&line("gpu"))).fine();
    assert_eq!(desk.remarks("gpu", Code::DeviceWrong)[0].number("frame"), Some(1.0), "{ran}");
    assert!(ran.stderr.contains("warning: frame 1:") && ran.stderr.contains("px from that of the CPU"), "{ran}");
    assert_same_fields(&desk, "cpu", "gpu");
    let summary = desk.json("gpu/summary.json");
    for frame in summary["frames"].as_array().unwrap() {
        assert!(frame["device"].as_str().unwrap().starts_with("cpu"), "{frame:#}");
    }
}

#[test]
fn a_series_on_the_gpu_is_that_of_the_cpu_and_tells_what_went_to_and_fro() {
    let desk = Desk::with_series();
    if !has_adapter(&desk, "a_series_on_the_gpu") {
        return;
    }
    for device in ["cpu", "gpu"] {
        let flags = format!("--device {device} --tolerance 1e-5 {INSIDE} --output {device}");
        desk.correlate(&format!("{flags} ref.png a.png b.png c.png")).fine();
    }
    assert_same_fields(&desk, "cpu", "gpu");
    let summary = desk.json("gpu/summary.json");
    assert!(summary["device"].as_str().unwrap().starts_with("gpu ("), "{summary:#}");
    assert!(desk.read("gpu/run.toml").contains("device = \"gpu ("));
    // The CPU has looked at the first frame.
    let checked = summary["frames"][0]["device_checked_px"].as_f64().unwrap();
    assert!(checked <= 1e-5 + TWINS_PX, "{checked} px");
    for frame in summary["frames"].as_array().unwrap() {
        let count = |key: &str| frame[key].as_u64().unwrap_or_else(|| panic!("no {key} in {frame:#}"));
        let iterations = count("iterations") + count("iterations_coarse");
        // One for what the residual follows beyond the field, 96 bytes per element. One more, of the sums of the elements,
        // where the light is looked at closely.
        assert!(count("readbacks") <= iterations + 4, "{frame:#}");
        assert!(count("bytes_down") <= 20 * N_INSIDE as u64 + 64 * iterations + 160 * N_INSIDE as u64, "{frame:#}");
        assert!(count("bytes_up") >= (WIDTH * HEIGHT) as u64 && count("submissions") > 0, "{frame:#}");
    }
    // The CPU sends nothing anywhere.
    assert!(desk.json("cpu/summary.json")["frames"][0].get("readbacks").is_none());
}

#[test]
fn frames_that_start_independently_come_out_in_order_and_with_the_same_bits() {
    let desk = Desk::with_series();
    if !has_adapter(&desk, "frames_that_start_independently") {
        return;
    }
    for (name, copy) in [("a.png", "d.png"), ("b.png", "e.png"), ("c.png", "f.png")] {
        desk.write(copy, desk.bytes(name));
    }
    for output in ["one", "two"] {
        let flags = format!("--device gpu --start cold {INSIDE} --output {output}");
        desk.correlate(&format!("{flags} ref.png a.png b.png c.png d.png e.png f.png")).fine();
    }
    for frame in 1..=6 {
        let name = |run: &str| format!("{run}/csv/{frame:06}.csv");
        assert_eq!(desk.bytes(&name("one")), desk.bytes(&name("two")), "frame {frame}");
        let mean = desk.rows(&name("one")).iter().map(|row| row.px.displacement[0]).sum::<f64>() / N_INSIDE as f64;
        let want = 0.25 * f64::from((frame - 1) % 3 + 1);
        assert!((mean - want).abs() < 0.01, "frame {frame}: {mean} px"); // ten times the noise of the mean
    }
}

#[test]
fn a_device_that_fails_in_mid_series_is_opened_anew_and_nothing_is_lost() {
    let desk = Desk::with_series();
    if !has_adapter(&desk, "a_device_that_fails_in_mid_series") {
        return;
    }
    desk.correlate(&format!("--device cpu --tolerance 1e-5 {INSIDE} --output cpu ref.png a.png b.png c.png")).fine();
    // The reference takes a readback per level, each frame three or so: some frame but the first meets the fault.
    let ran = failing(&desk, 9, "out").fine();
    assert!(ran.stderr.contains("injected failure; trying once more on a fresh device"), "{ran}");
    let failed = desk.remarks("out", Code::DeviceFailed);
    assert_eq!((failed.len(), &failed[0].values["goes_on_with"]), (1, &"fresh device".into()), "{ran}");
    assert_ne!(failed[0].number("frame"), Some(1.0), "{ran}");
    assert_same_fields(&desk, "cpu", "out");
}

#[test]
fn when_the_fresh_device_fails_too_the_cpu_goes_on_and_every_frame_says_where_it_was_done() {
    let desk = Desk::with_series();
    if !has_adapter(&desk, "when_the_fresh_device_fails_too") {
        return;
    }
    desk.correlate(&format!("--device cpu --tolerance 1e-5 {INSIDE} --output cpu ref.png a.png b.png c.png")).fine();
    let ran = failing(&desk, 3, "out").fine();
    let failed = desk.remarks("out", Code::DeviceFailed);
    assert_eq!(failed.last().unwrap().values["goes_on_with"], "cpu".into(), "{ran}");
    let summary = desk.json("out/summary.json");
    assert!(summary["device"].as_str().unwrap().starts_with("gpu ("), "{summary:#}");
    for frame in summary["frames"].as_array().unwrap() {
        assert!(frame["device"].as_str().unwrap().starts_with("cpu ("), "{frame:#}");
    }
    assert_same_fields(&desk, "cpu", "out");
}

#[test]
fn a_device_that_fails_while_the_reference_is_renewed_goes_on_from_the_same_references() {
    let desk = Desk::with_series();
    if !has_adapter(&desk, "a_device_that_fails_while_the_reference_is_renewed") {
        return;
    }
    let line = |device: &str, output: &str| {
        let flags = "--update-reference every 1 --tolerance 1e-5";
        format!("correlate --device {device} {flags} {INSIDE} --output {output} ref.png a.png b.png c.png")
    };
    desk.run(&line("cpu", "cpu")).fine();
    // In the first frame, with the first new reference, and later.
    let mut failed = 0;
    for after in [3, 5, 7, 8, 9] {
        let output = format!("out{after}");
        let fail = [("QUADRILLE_GPU_FAIL_AFTER", after.to_string())];
        let ran =
            desk.run_with(&fail.each_ref().map(|(name, value)| (*name, value.as_str())), &words(&line("gpu", &output)));
        ran.fine();
        let remarks = desk.remarks(&output, Code::DeviceFailed);
        failed += usize::from(remarks.iter().any(|r| r.values["goes_on_with"] == "fresh device".into()));
        assert_eq!(desk.json(&format!("{output}/summary.json"))["reference_updates"], serde_json::json!([1, 2]));
        assert_same_fields(&desk, "cpu", &output);
    }
    assert!(failed >= 3, "the device failed in {failed} runs");
}

#[test]
fn a_gpu_asked_for_that_fails_with_the_reference_ends_the_run() {
    let desk = Desk::with_series();
    if has_adapter(&desk, "a_gpu_asked_for_that_fails_with_the_reference") {
        failing(&desk, 0, "out").refused(&["injected failure"]);
    }
}

#[test]
fn a_right_device_is_not_given_up_on_real_images_whose_nodes_in_noise_end_before_they_settle() {
    let desk = Desk::new();
    if !has_adapter(&desk, "a_right_device_is_not_given_up") {
        return;
    }
    let Some(folder) = data::folder("sundic-necking") else { return };
    let [reference, deformed] = ["img_0.tif", "img_3.tif"].map(|name| folder.join(name));
    let words = ["correlate", "--device", "gpu", "--export", "none", "--no-report", "--output", "out"];
    let files = [&reference, &deformed].map(|path| path.to_str().unwrap());
    let ran = desk.run_with(&[], &[&words[..], &files[..]].concat()).fine();
    assert_eq!(desk.remarks("out", Code::DeviceWrong), [], "{ran}");
    let frame = &desk.json("out/summary.json")["frames"][0];
    // It was looked at, after an iteration so long that nodes in noise may have been taken as they were.
    assert!(frame["iterations"].as_u64().unwrap() >= 30 && frame["device_checked_px"].is_number(), "{frame:#}");
}
