//! `quadrille demo`: a peeling joint, made, measured and compared with the truth.

use super::args::DemoArgs;
use super::correlate::run_series;
use super::plan::Plan;
use super::progress::Talk;
use super::run_folder::RunFolder;
use super::synth::write_series;
use super::{Outcome, Result, pool};
use crate::backend::choice::DeviceChoice;
use crate::correlate::{Correlation, Options};
use crate::field::{Measurement, Status, StrainDefinition};
use crate::io::case::{CaseQuantities, CaseZone, read_case};
use crate::io::images::read_image;
use crate::io::series::Frame;
use crate::isa::Isa;
use crate::report::{MapOptions, Palette, element_map, nodal_map};
use crate::synth::{Peel, RenderOptions, Series, Texture};
use crate::units::Px;
use serde::Serialize;
use std::fs;
use std::path::Path;
use std::time::Instant;

const SIZE: [usize; 2] = [1280, 800];
const FRAMES: usize = 20;
/// Noise of the images, grey levels of 255: that of a fair camera.
const NOISE: f32 = 2.0;
const ELEMENT: f64 = 16.0;
/// Whole elements, three pixels away from the dark band (whose pixels would be mixed into the faces).
const UPPER: [f64; 4] = [16.0, 13.0, 1264.0, 381.0];
const LOWER: [f64; 4] = [16.0, 419.0, 1264.0, 787.0];
/// Frames that are drawn.
const DRAWN: [usize; 3] = [7, 14, 20];

/// One frame against the truth.
#[derive(Debug, Clone, Serialize)]
struct Comparison {
    number: usize,
    status: Status,
    /// Opening at the right end of the facing edges.
    opening_exact_px: f64,
    opening_measured_px: f64,
    /// Standard uncertainty of the measured opening.
    opening_sigma_px: f64,
    /// Root mean square over all nodes and both components of measured less exact.
    error_rms_px: f64,
    error_max_px: f64,
    /// Root mean square of the predicted standard uncertainty.
    sigma_rms_px: f64,
}

/// `demo.json`.
#[derive(Debug, Serialize)]
struct Demo {
    quadrille: &'static str,
    seed: u64,
    noise_grey: f32,
    element_size_px: f64,
    frames: Vec<Comparison>,
    /// Over all frames.
    error_rms_px: f64,
    sigma_rms_px: f64,
    seconds: f64,
    /// File and SHA-256 of every image, reference first.
    images: toml::Value,
}

/// Runs the command.
pub(super) fn run(args: &DemoArgs) -> Result<Outcome> {
    let begin = Instant::now();
    let pool = pool(args.threads)?;
    // The demo owns its folder: running it again replaces what it made.
    let folder = RunFolder::open(&args.output.join("run"), true)?;
    let images = args.output.join("images");
    eprintln!("making {} images of a peeling joint, {} x {} px", FRAMES + 1, SIZE[0], SIZE[1]);
    let options = RenderOptions { noise: NOISE, seed: args.seed, ..RenderOptions::new(SIZE[0], SIZE[1]) };
    let motion = Peel::new(SIZE[0], SIZE[1]);
    let series = Series { texture: Texture::new(args.seed, 4.5)?, motion, n_frames: FRAMES, options };
    pool.install(|| write_series(&series, &images, ELEMENT as usize))?;

    let plan = plan(&images);
    let mut comparisons = Vec::new();
    let mut drawn = Vec::new();
    run_series(&plan, &folder, pool, Talk::Normal, |number, result: &Correlation| {
        comparisons.push(compare(number, &series, &result.measurement));
        if DRAWN.contains(&number) {
            drawn.push((number, result.measurement.clone()));
        }
    })?;
    let reference = read_image(&plan.reference[0].path, 0)?.image;
    let maps = args.output.join("maps");
    fs::create_dir_all(&maps).map_err(|e| format!("{}: cannot be written: {e}", maps.display()))?;
    for (number, measurement) in &drawn {
        draw(&maps, *number, &reference, measurement)?;
    }
    let record = read_case(&folder.path().join("run.toml"))?;
    let hashes = record.run.and_then(|run| run.get("image").cloned()).unwrap_or(toml::Value::Array(Vec::new()));
    let rms = |value: fn(&Comparison) -> f64| {
        (comparisons.iter().map(|c| value(c).powi(2)).sum::<f64>() / comparisons.len().max(1) as f64).sqrt()
    };
    let demo = Demo {
        quadrille: env!("CARGO_PKG_VERSION"),
        seed: args.seed,
        noise_grey: NOISE,
        element_size_px: ELEMENT,
        error_rms_px: rms(|c| c.error_rms_px),
        sigma_rms_px: rms(|c| c.sigma_rms_px),
        frames: comparisons,
        seconds: begin.elapsed().as_secs_f64(),
        images: hashes,
    };
    RunFolder::open(&args.output, true)?.write_json("demo.json", &demo)?;
    print(&demo, &args.output);
    let fine = demo.frames.len() == FRAMES && demo.frames.iter().all(|frame| frame.status == Status::Converged);
    Ok(if fine { Outcome::Fine } else { Outcome::Incomplete })
}

fn plan(images: &Path) -> Plan {
    let file = |number: usize| Frame::file(images.join(format!("{number:06}.tif")), 0);
    let zone = |name: &str, roi| CaseZone { name: Some(name.into()), roi: Some(roi), ..CaseZone::default() };
    Plan {
        reference: vec![file(0)],
        deformed: (1..=FRAMES).map(file).collect(),
        pixel_size: None,
        zones: vec![zone("upper", UPPER), zone("lower", LOWER)],
        guard_px: None,
        options: Options { element_size: ELEMENT as usize, ..Options::default() },
        isa: Isa::detect(),
        device: DeviceChoice::Auto,
        strain: StrainDefinition::default(),
        csv: true,
        vtu: true,
        store_only: false,
        drawn: CaseQuantities::default(),
    }
}

fn compare(number: usize, series: &Series<Peel>, measured: &Measurement<Px>) -> Comparison {
    let mesh = &measured.mesh;
    let exact = series.exact_at(number, mesh.nodes());
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
    // The facing edges: last row of the upper zone, first row of the lower one, at the right end.
    let above = mesh.zone_nodes(0).end - 1;
    let first_row = mesh.boundary(1).into_iter().flatten().map(|node| node as usize);
    let below = first_row.fold(mesh.zone_nodes(1).start, |best, node| {
        let [[x, y], [bx, by]] = [mesh.nodes()[node], mesh.nodes()[best]];
        if y < by || (y == by && x > bx) { node } else { best }
    });
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

fn draw(maps: &Path, number: usize, reference: &crate::imaging::Image, measurement: &Measurement<Px>) -> Result<()> {
    for (c, name) in ["ux", "uy"].into_iter().enumerate() {
        let values: Vec<f64> = measurement.displacement.iter().map(|u| u[c]).collect();
        let title = format!("Displacement {name}, frame {number}");
        let options = MapOptions::new(title, format!("{name} (px)"));
        nodal_map(reference, measurement, &values, &options)?.save(maps.join(format!("{number:06}-{name}.png")))?;
    }
    let options = MapOptions {
        palette: Palette::Plasma,
        ..MapOptions::new(format!("Residual, frame {number}"), "rms residual per element (grey levels)")
    };
    element_map(reference, measurement, &measurement.element_residual, &options)?
        .save(maps.join(format!("{number:06}-residual.png")))?;
    Ok(())
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
    let shown = |name: &str| output.join(name).display().to_string();
    println!("images:   {}", shown("images"));
    println!("results:  {}  (summary.json, fields.zarr, csv, vtu, series.pvd for ParaView)", shown("run"));
    println!("pictures: {}  (open 000020-uy.png)", shown("maps"));
    println!("numbers:  {}  ({:.1} s in all)", shown("demo.json"), demo.seconds);
}
