//! `quadrille demo`: the virtual test, run from its images to the report, against the truth.

use crate::cli::about::devices;
use crate::cli::args::{DemoArgs, ProgressKind};
use crate::cli::identify::case;
use crate::cli::talk::{Paint, Talk};
use crate::cli::{Outcome, Result};
use crate::field::{Measurement, Status};
use crate::identify::laws_of;
use crate::io::store::Store;
use crate::report::Name;
use crate::report::fit::FitRecord;
use crate::report::tournament::TournamentRecord;
use crate::run::{CaseRun, RunFolder, correlation_in, read_json, write_file, write_virtual_test};
use crate::units::Px;
use crate::virtual_test::{ELEMENT_PX, VirtualOptions, VirtualTest};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

/// One frame against the truth.
#[derive(Debug, Clone, Serialize)]
struct Comparison {
    number: usize,
    status: Status,
    /// Opening at the right end of the facing edges.
    opening_exact_px: f64,
    opening_measured_px: f64,
    opening_sigma_px: f64,
    /// Root mean square over all nodes and both components of measured less exact.
    error_rms_px: f64,
    error_max_px: f64,
    /// Root mean square of the predicted standard uncertainty.
    sigma_rms_px: f64,
}

/// One parameter against the truth.
#[derive(Debug, Clone, Serialize)]
struct Found {
    unit: &'static str,
    truth: f64,
    identified: f64,
    std: Option<f64>,
    interval95: Option<[f64; 2]>,
    error_percent: f64,
    interval_holds_truth: Option<bool>,
}

/// `demo.json`.
#[derive(Debug, Serialize)]
struct Demo {
    quadrille: &'static str,
    seed: u64,
    noise_grey: f32,
    element_size_px: f64,
    status: String,
    parameters: BTreeMap<&'static str, Found>,
    frames: Vec<Comparison>,
    /// Over all frames.
    error_rms_px: f64,
    sigma_rms_px: f64,
    seconds: f64,
    /// What the comparison of laws came to; null without.
    laws: Option<Laws>,
    /// File and SHA-256 of every image, reference first.
    images: Value,
}

/// A comparison of laws against the truth.
#[derive(Debug, Serialize)]
struct Laws {
    truth: Name,
    best: Option<Name>,
    /// Those that the data cannot tell from it, itself among them.
    alike: Vec<Name>,
    alike_holds_truth: bool,
}

/// What `truth.json` says of the images.
#[derive(Deserialize)]
struct Truth {
    images: Value,
}

pub(crate) fn run(args: &DemoArgs, paint: Paint) -> Result<Outcome> {
    let begin = Instant::now();
    // The demo owns its folder: running it again replaces what it made.
    let folder = RunFolder::open(&args.output, true)?;
    // Before the images are made.
    if !args.laws.is_empty() {
        laws_of(&args.laws)?;
    }
    let options = VirtualOptions { seed: args.seed, ..VirtualOptions::default() };
    args.talk.say(format_args!(
        "the virtual test: a bonded joint is pulled apart in the computer and photographed {} times",
        options.instants + 1
    ));
    let (test_folder, run_folder) = (args.output.join("test"), args.output.join("run"));
    let pool = args.threads.pool()?;
    let test = pool.install(|| VirtualTest::new(options))?;
    write_virtual_test(&test, &test_folder, &pool)?;
    if !args.laws.is_empty() {
        write_file(&test_folder.join("case.toml"), test.case_toml_with(&args.laws))?;
    }
    let asked = CaseRun {
        overwrite: true,
        gpu: devices::options(false),
        ..CaseRun::new(test_folder.join("case.toml"), &run_folder)
    };
    // The page is named with the other results, at the end.
    let outcome = case::of_case(&asked, args.threads, (Talk::of(ProgressKind::Text, args.talk.quiet), paint), |_| ())?;
    let fit: FitRecord = read_json(&run_folder.join("fit.json"))?;
    let Truth { images } = read_json(&test_folder.join("truth.json"))?;
    let store = Store::open(correlation_in(&run_folder))?;
    let mut frames = Vec::new();
    for number in 1..=store.n_frames() {
        if let Some(frame) = store.frame(number)? {
            frames.push(compare(number, &test, &frame.measurement));
        }
    }
    let rms = |value: fn(&Comparison) -> f64| {
        (frames.iter().map(|c| value(c).powi(2)).sum::<f64>() / frames.len().max(1) as f64).sqrt()
    };
    let demo = Demo {
        quadrille: env!("CARGO_PKG_VERSION"),
        seed: args.seed,
        noise_grey: options.noise_grey,
        element_size_px: ELEMENT_PX,
        status: fit.status.to_string(),
        parameters: compare_parameters(&test, &fit),
        error_rms_px: rms(|c| c.error_rms_px),
        sigma_rms_px: rms(|c| c.sigma_rms_px),
        frames,
        laws: if args.laws.is_empty() { None } else { Some(laws(&test, &run_folder)?) },
        seconds: begin.elapsed().as_secs_f64(),
        images,
    };
    folder.write_json("demo.json", &demo)?;
    if !args.talk.quiet {
        print(&demo, &args.output);
    }
    Ok(outcome)
}

fn laws(test: &VirtualTest, folder: &Path) -> Result<Laws> {
    let TournamentRecord { best, alike, .. } = read_json(&folder.join("tournament.json"))?;
    let truth = Name::from(test.law().name());
    Ok(Laws { alike_holds_truth: alike.contains(&truth), truth, best, alike })
}

/// The fitted parameters beside the true ones.
fn compare_parameters(test: &VirtualTest, fit: &FitRecord) -> BTreeMap<&'static str, Found> {
    let law = test.law();
    let one = |(parameter, truth): (&crate::mechanics::cohesive::Parameter, f64)| {
        let entry = fit.parameters.get(parameter.name)?;
        let (identified, interval95) = (entry.value, entry.interval95);
        let found = Found {
            unit: parameter.unit,
            truth,
            identified,
            std: entry.std,
            interval95,
            error_percent: 100.0 * (identified / truth - 1.0),
            interval_holds_truth: interval95.map(|[low, high]| low <= truth && truth <= high),
        };
        Some((parameter.name, found))
    };
    law.parameters().iter().zip(law.values()).filter_map(one).collect()
}

fn compare(number: usize, test: &VirtualTest, measured: &Measurement<Px>) -> Comparison {
    let mesh = &measured.mesh;
    let exact = test.exact_at(number, mesh.nodes());
    let nodes: Vec<usize> = (0..mesh.n_nodes()).filter(|&node| measured.measured[node]).collect();
    let n = (2 * nodes.len()).max(1) as f64;
    let (mut error, mut largest, mut sigma) = (0.0, 0.0f64, 0.0);
    for &node in &nodes {
        for c in 0..2 {
            let e = measured.displacement[node][c] - exact[node][c];
            error += e * e;
            largest = largest.max(e.abs());
            sigma += measured.sigma[node][c].powi(2);
        }
    }
    // The facing edges at their right end: of zone 0, below the adhesive, the node highest up; of zone 1 the one
    // furthest down.
    let end = |zone: usize, sign: f64| {
        let nodes = mesh.zone_nodes(zone);
        let rank = |node: &usize| (sign * mesh.nodes()[*node][1], mesh.nodes()[*node][0]);
        nodes.max_by(|a, b| rank(a).partial_cmp(&rank(b)).unwrap_or(std::cmp::Ordering::Equal)).unwrap_or(0)
    };
    let (below, above) = (end(0, -1.0), end(1, 1.0));
    // y is down: the joint opens when the lower strip moves down more than the upper one.
    let opening = |u: &[[f64; 2]]| u[below][1] - u[above][1];
    Comparison {
        number,
        status: measured.status,
        opening_exact_px: opening(&exact),
        opening_measured_px: opening(&measured.displacement),
        opening_sigma_px: measured.sigma[above][1].hypot(measured.sigma[below][1]),
        error_rms_px: (error / n).sqrt(),
        error_max_px: largest,
        sigma_rms_px: (sigma / n).sqrt(),
    }
}

fn print(demo: &Demo, output: &Path) {
    println!("opening at the right end, and error over all nodes, against the exact field (px)");
    println!("frame      exact   measured  +- sigma   node error rms  largest   predicted sigma");
    for c in &demo.frames {
        println!(
            "{:5}  {:9.4}  {:9.4}   {:7.4}   {:14.4}  {:7.4}   {:15.4}",
            c.number,
            c.opening_exact_px,
            c.opening_measured_px,
            c.opening_sigma_px,
            c.error_rms_px,
            c.error_max_px,
            c.sigma_rms_px
        );
    }
    println!(
        "all frames: error {:.4} px rms, predicted {:.4} px, from images with noise of {} grey levels",
        demo.error_rms_px, demo.sigma_rms_px, demo.noise_grey
    );
    println!();
    println!("parameter      identified       95 % interval                truth      error");
    for (name, found) in &demo.parameters {
        // Lengths in um, as people speak of them.
        let (scale, unit) = if found.unit == "mm" { (1e3, "um") } else { (1.0, found.unit) };
        let interval =
            found.interval95.map_or("-".to_owned(), |[low, high]| format!("{:.4} to {:.4}", scale * low, scale * high));
        println!(
            "{name:9} {:9.4} {unit:5}   {interval:24}  {:9.4} {unit:5}  {:+.2} %",
            scale * found.identified,
            scale * found.truth,
            found.error_percent
        );
    }
    println!("the fit: {}", demo.status);
    if let Some(laws) = &demo.laws {
        let alike: Vec<&str> = laws.alike.iter().map(|name| &**name).collect();
        println!("laws that the data leave: {} (the truth is {})", alike.join(", "), laws.truth);
    }
    println!();
    let shown = |name: &str| output.join(name).display().to_string();
    println!("report:   {}", shown("run/report.html"));
    println!("images:   {}  (with the truth: truth.json)", shown("test/images"));
    println!("results:  {}  (fit.json; correlation: measured fields, csv, vtu for ParaView)", shown("run"));
    println!("numbers:  {}  ({:.1} s in all)", shown("demo.json"), demo.seconds);
}
