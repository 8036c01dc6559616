//! the program `testbed`: its figures are there, mean what they say, and hold together.

use serde_json::Value;
use std::path::Path;
use std::process::Command;
use tempfile::TempDir;

/// A folder in which the program is run.
struct Desk(TempDir);

impl Desk {
    fn new() -> Self {
        Self(TempDir::new().unwrap())
    }

    /// Exit status, standard output, standard error of the program with the words of `line`.
    fn run(&self, line: &str) -> (Option<i32>, String, String) {
        let program = Path::new(env!("CARGO_BIN_EXE_testbed"));
        let done = Command::new(program).args(line.split(' ')).current_dir(&self.0).output().unwrap();
        let [stdout, stderr] = [done.stdout, done.stderr].map(|text| String::from_utf8(text).unwrap());
        (done.status.code(), stdout, stderr)
    }

    /// What it prints when all is fine.
    fn printed(&self, line: &str) -> String {
        let (code, stdout, stderr) = self.run(line);
        assert_eq!(code, Some(0), "{line}: {stderr}");
        stdout
    }

    /// It refuses the line, with all of `words`.
    fn refuses(&self, line: &str, words: &[&str]) {
        let (code, _, stderr) = self.run(line);
        assert_eq!(code, Some(2), "{line}: {stderr}");
        assert!(words.iter().all(|word| stderr.contains(word)), "{words:?} in {stderr}");
    }

    fn files(&self, folder: &str) -> Vec<String> {
        let listed = std::fs::read_dir(self.0.path().join(folder)).unwrap();
        let mut names: Vec<String> = listed.map(|file| file.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }
}

#[track_caller]
fn number(value: &Value, what: &str) -> f64 {
    let number = value.as_f64().unwrap_or_else(|| panic!("{what}: {value} is no number"));
    assert!(number.is_finite() && number >= 0.0, "{what}: {number}");
    number
}

/// All devices of this machine at two sizes.
fn measured(desk: &Desk) -> Value {
    serde_json::from_str(&desk.printed("devices --size 128,256 --runs 2 --frames 2 --json --output out")).unwrap()
}

#[test]
fn every_device_has_every_figure_at_every_size() {
    let desk = Desk::new();
    let record = measured(&desk);
    let usable = quadrille::backend::gpu::adapters().list.iter().filter(|adapter| adapter.unusable.is_none()).count();
    let devices = record["devices"].as_array().unwrap();
    assert_eq!(devices.len(), 1 + usable, "the CPU and every adapter");
    for device in devices {
        let name = device["device"].as_str().unwrap();
        assert!(number(&device["copy_gb_per_s"], name) > 0.0, "{name}");
        let sizes: Vec<u64> =
            device["sizes"].as_array().unwrap().iter().map(|s| s["size_px"].as_u64().unwrap()).collect();
        assert_eq!(sizes, [128, 256], "{name}");
        for cost in device["sizes"].as_array().unwrap() {
            let pixels = number(&cost["size_px"], name).powi(2);
            for pass in cost["passes"].as_array().unwrap() {
                let what = format!("{name}, {}", pass["name"]);
                let clock = if device["clock"] == "processor" { "cpu" } else { "wall" };
                let [fastest, median, slowest] =
                    ["fastest", "median", "slowest"].map(|k| number(&pass["seconds"][clock][k], &what));
                assert!(fastest <= median && median <= slowest, "{what}: {fastest} {median} {slowest}");
                // The same time said in three ways, to the round-off of a product.
                let per_px = number(&pass["ns_per_px"], &what);
                assert!((per_px * pixels - 1e9 * fastest).abs() <= 1e-9 * 1e9 * fastest, "{what}");
                let bytes = number(&pass["bound"]["bytes"], &what);
                let rate = number(&pass["bound"]["gb_per_s"], &what);
                assert!((rate * fastest - 1e-9 * bytes).abs() <= 1e-12 * bytes, "{what}: {rate} GB/s, {bytes} B");
            }
            let on_gpu = device["kind"] != "CPU";
            assert_eq!(cost["kernels"].as_array().unwrap().is_empty(), !on_gpu, "{name}");
            for part in ["pair", "series"] {
                assert!(number(&cost[part]["frame_s"]["wall"]["fastest"], name) > 0.0, "{name}, {part}");
                assert_eq!(cost[part]["traffic"].is_null(), !on_gpu, "{name}, {part}");
            }
            let rate = number(&cost["series"]["frames_per_s"], name);
            assert!((rate * number(&cost["series"]["frame_s"]["wall"]["median"], name) - 1.0).abs() < 1e-9, "{name}");
            if on_gpu {
                let shares = cost["series"]["shares"].as_array().unwrap();
                let all: f64 = shares.iter().map(|share| number(&share["percent"], name)).sum();
                assert!((all - 100.0).abs() < 1e-9, "{name}: parts of {all} %");
            }
        }
        // Compilation and first runs are told apart from everything else, where there are any.
        assert_eq!(device["start_up"].is_null(), device["kind"] == "CPU", "{name}");
        if let Some(start) = device["start_up"].as_object() {
            // What a file of somebody else's card is read for: right, and how far away.
            let compared = start["check"]["compared"].as_array().unwrap();
            let within = |it: &Value| number(&it["difference"], name) <= number(&it["allowed"], name);
            assert!(compared.len() > 10 && compared.iter().all(within), "{name}: {compared:?}");
            let [trip, dispatch] = [&start["round_trip_s"]["median"], &start["dispatch_s"]].map(|s| number(s, name));
            // A millionth of a second is no way to any device, a second is none that works.
            assert!(1e-6 < trip && trip < 1.0 && 0.0 < dispatch && dispatch < 1.0, "{name}: {trip} {dispatch}");
            let rate = number(&start["upload_gb_per_s"], name);
            assert!(0.01 < rate && rate < 1000.0, "{name}: {rate} GB/s");
        }
    }
    assert_eq!(desk.files("out"), ["bench.json", "bench.png", "bench.svg"]);
    let written = std::fs::read_to_string(desk.0.path().join("out/bench.json")).unwrap();
    assert_eq!(serde_json::from_str::<Value>(&written).unwrap(), record);
}

#[test]
fn the_table_has_a_line_for_every_pass_and_says_what_its_clock_is() {
    let desk = Desk::new();
    let text = desk.printed("devices --device cpu --size 128 --runs 1 --frames 1");
    for words in
        ["processor time of this process", "residual", "iteration", "cold pair", "frames/s", "ns/px", "of copy"]
    {
        assert!(text.contains(words), "{words} in\n{text}");
    }
}

#[test]
fn what_cannot_be_measured_is_refused_with_what_can() {
    let desk = Desk::new();
    for (line, words) in [
        ("devices --size 10", ["10", "64 to 32768 px"]),
        ("devices --element-size 3", ["3", "4 to 128 px"]),
        ("devices --size 64 --element-size 64", ["64", "element"]),
        ("devices --size 64 --device abacus", ["abacus", "no graphics device"]),
    ] {
        desk.refuses(line, &words);
    }
}

#[test]
fn a_series_from_its_files_is_measured_against_its_parts() {
    let desk = Desk::new();
    let line = "series --size 192 --frames 6 --runs 2 --device cpu --threads 2 --folder . --json";
    let measured: Value = serde_json::from_str(&desk.printed(line)).unwrap();
    let series = measured["series"].as_array().unwrap();
    let formats: Vec<&str> = series.iter().map(|cost| cost["format"].as_str().unwrap()).collect();
    assert_eq!(formats, ["tiff", "png"]);
    for cost in series {
        assert_eq!((&cost["frames"], &cost["size_px"]), (&6.into(), &192.into()));
        // Whole elements of 16 px on 192 - 4 x 16 px.
        assert_eq!(cost["n_nodes"], 81);
        let median = |name: &str| {
            let [fastest, median, slowest] =
                ["fastest", "median", "slowest"].map(|which| number(&cost[name][which], name));
            assert!(0.0 < fastest && fastest <= median && median <= slowest, "{name}: {fastest} {median} {slowest}");
            median
        };
        median("frame_processor_s");
        let parts = median("decode_alone_s") + median("correlate_alone_s");
        let share = number(&cost["share_of_bound"], "share_of_bound");
        assert!((share * median("frame_s") / parts - 1.0).abs() < 1e-9, "{cost}");
        for stage in cost["stage_percent"].as_array().unwrap() {
            assert!(number(&stage[1], "stage") <= 100.0, "{stage}");
        }
    }
    assert!(desk.files(".").is_empty(), "nothing is left behind: {:?}", desk.files("."));
    desk.refuses("series --size 64", &["--size 64", "96 px at least"]);
    desk.refuses("series --frames 2", &["--frames 2"]);
}

#[test]
fn a_device_that_takes_no_time_shows_what_the_host_does_and_measures_for_nobody() {
    let desk = Desk::new();
    let line = "series --size 1024 --frames 12 --runs 1 --format tiff --threads 2 --folder . --json --device";
    let cost = |device: &str| -> Value {
        let measured: Value = serde_json::from_str(&desk.printed(&format!("{line} {device}"))).unwrap();
        measured["series"][0].clone()
    };
    let [instant, cpu] = ["instant", "cpu"].map(cost);
    assert!(instant["device"].as_str().unwrap().contains("nothing is measured"), "{instant}");
    // Frames end after about as many iterations as on the CPU (those of a frame that was predicted from one alone),
    // without the passes over the pixels: a half of the time where this was written, two cold frames included.
    let iterations = |of: &Value| number(&of["iterations_mean"], "iterations_mean");
    assert!((iterations(&instant) - iterations(&cpu)).abs() < 2.0, "{instant} {cpu}");
    let alone = |of: &Value| number(&of["correlate_alone_s"]["median"], "correlate_alone_s");
    println!("{} of the time on the CPU", alone(&instant) / alone(&cpu));
    assert!(alone(&instant) < 0.9 * alone(&cpu), "{instant} {cpu}");
    // To the product it is no device.
    desk.refuses("devices --device instant", &["no graphics device"]);
}
