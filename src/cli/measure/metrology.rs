//! `quadrille metrology`: what can be measured on the user's own images.

use crate::cli::args::MetrologyArgs;
use crate::cli::measure::gauges;
use crate::cli::talk::{WARNING, wrapped};
use crate::cli::{Outcome, Result, absolute, file_name, plural};
use crate::imaging::{Image, OddLevels, Specimen};
use crate::io::images::{Loaded, read_image};
use crate::io::series::expand_series;
use crate::mesh::Roi;
use crate::metrology::{Metrology, MetrologyError, Noise, Options, Origin, PhotonFit, SizeResult, Still, measure};
use crate::report::metrology::{larger, noise_facts, number};
use crate::report::{Axis, Plot, PlotSeries, Style, metrology_page};
use crate::run::{RunFolder, save_picture, strain_window};
use serde::Serialize;
use serde_json::{Value, json};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// What was found, as numbers.
pub(crate) const METROLOGY: &str = "metrology.json";

/// `metrology.json`.
#[derive(Debug, Serialize)]
struct Record<'a> {
    quadrille: &'static str,
    units: &'static str,
    /// Files, with what their images are.
    reference: Value,
    static_images: Vec<Value>,
    /// As resolved.
    options: Value,
    seconds: f64,
    #[serde(flatten)]
    metrology: &'a Metrology,
}

const UNITS: &str = "_px: pixels; _px2: square pixels; _grey: grey levels in the scale of the images; _grey_per_px: \
    grey levels per pixel; _percent: per cent; _deg: degrees; strains without unit. Pairs are x, y (strains: exx, eyy), x right, y down";

pub(crate) fn run(args: &MetrologyArgs) -> Result<Outcome> {
    args.drawn.choose();
    let begin = Instant::now();
    let mut options = options(args)?;
    let pool = args.threads.pool()?;
    let folder = args.output.as_deref().map(|path| RunFolder::open(path, true)).transpose()?;
    let page = args.page.unwrap_or(0) as usize;
    let (reference, loaded) = read(&args.reference, page)?;
    let files = static_files(args)?;
    let mut stills = Vec::new();
    let mut records = Vec::new();
    for path in &files {
        let (record, image) = read(path, page)?;
        stills.push(Still { name: path.display().to_string(), image });
        records.push(record);
    }
    eprintln!(
        "{}: {} x {} px, {}; {}; moving copies of it, which takes some seconds",
        args.reference.display(),
        loaded.width(),
        loaded.height(),
        loaded.pixels().depth(),
        plural(stills.len(), "static image")
    );
    if options.roi.is_none() {
        options.roi = pool.install(|| find_zone(&loaded));
        let found = options.roi.map(|Roi { x0, y0, x1, y1 }| format!("{x0},{y0},{x1},{y1}"));
        found
            .iter()
            .for_each(|roi| eprintln!("looks where the specimen is found, in its largest rectangle: --roi {roi}"));
    }
    let odd = OddLevels::of(&loaded).map(|odd| format!("{}: {odd}", args.reference.display()));
    let metrology = match (pool.install(|| measure(&loaded, &stills, &options)), odd) {
        (Err(MetrologyError::OnlyNoise(_)), Some(odd)) => return Err(odd.into()),
        (measured, odd) => {
            odd.iter().for_each(|odd| eprintln!("{WARNING}{odd}"));
            measured?
        }
    };
    let seconds = begin.elapsed().as_secs_f64();
    print(&metrology, &options, args.element_sizes.is_some());
    let record = Record {
        quadrille: env!("CARGO_PKG_VERSION"),
        units: UNITS,
        reference,
        static_images: records,
        options: json!({
            "element_sizes_px": metrology.sizes.iter().map(|result| result.element_size_px).collect::<Vec<_>>(),
            "strain_windows": windows_of(&metrology),
            "roi_px": options.roi.map(|Roi { x0, y0, x1, y1 }| [x0, y0, x1, y1]),
            "page": page,
            "noise_grey": args.noise,
            "interpolation": options.interpolation.name(),
            "target_sigma_px": options.target_sigma_px,
            "resolve_period_px": options.resolve_period_px,
            "seed": options.seed,
        }),
        seconds,
        metrology: &metrology,
    };
    if let Some(folder) = folder {
        folder.write_json(METROLOGY, &record)?;
        folder.write("strain_gauges.csv", |out| gauges::write(out, &metrology, &args.reference))?;
        let plots = [plot(&metrology, &args.reference), gauges::plot(&metrology, &args.reference)];
        for (name, plot) in ["metrology", "strain_gauges"].into_iter().zip(&plots) {
            save_picture(folder.path(), name, &plot.draw()?)?;
        }
        let name = file_name(&args.reference);
        let page = metrology_page(&metrology, &name, &loaded, plots.each_ref())?;
        folder.write(RunFolder::REPORT, |out| out.write_all(page.html().as_bytes()))?;
        eprintln!(
            "numbers and curves in {}: report.html, metrology.json, .png, .svg; strain_gauges.csv, .png, .svg",
            folder.path().display()
        );
    }
    eprintln!("{seconds:.1} s");
    Ok(Outcome::Fine)
}

/// The largest rectangle of the specimen that `correlate` would find, where that is not all of the image.
fn find_zone(image: &Image) -> Option<Roi> {
    /// Less than this share of the image is left out along its border.
    const ALL: f64 = 0.9;
    let specimen = Specimen::find(image, 16, 8);
    let part = specimen.parts.first().filter(|_| specimen.share(image) < ALL)?;
    let [x0, y0, x1, y1] = part.largest_rectangle();
    let is_large = (x1 - x0).min(y1 - y0) >= 4 * 16;
    let [x0, y0, x1, y1] = [x0, y0, x1, y1].map(|at| at as f64);
    is_large.then_some(Roi { x0, y0, x1, y1 })
}

fn options(args: &MetrologyArgs) -> Result<Options> {
    let default = Options::default();
    let sizes = args.element_sizes.as_ref().map(|sizes| {
        // A negative size is refused with the same words as 0.
        sizes.iter().map(|&size| usize::try_from(size).unwrap_or(0)).collect()
    });
    let windows = args.strain_windows.as_ref().map(|windows| {
        // That of 1 node is the element, which is there in any case.
        windows.iter().filter_map(|&nodes| strain_window(Some(nodes)).transpose()).collect::<crate::run::Result<_>>()
    });
    Ok(Options {
        element_sizes: sizes,
        strain_windows: windows.transpose()?,
        roi: args.roi.map(|[x0, y0, x1, y1]| Roi { x0, y0, x1, y1 }),
        noise: args.noise,
        interpolation: args.interpolation.unwrap_or(default.interpolation),
        target_sigma_px: args.target_sigma,
        resolve_period_px: args.resolve_period,
        seed: args.seed,
    })
}

/// The windows whose gauges were looked at, each once; 1 for the element.
fn windows_of(found: &Metrology) -> Vec<usize> {
    let windows = found.strain_gauges.gauges.iter().map(|gauge| gauge.window_nodes);
    windows.collect::<std::collections::BTreeSet<_>>().into_iter().collect()
}

/// The static images. A glob over the folder takes the reference along: it is left out, unless it is alone,
/// which is a mistake that deserves a word.
fn static_files(args: &MetrologyArgs) -> Result<Vec<PathBuf>> {
    let mut files = expand_series(&args.stills, Path::new(""))?;
    let same = |path: &Path| std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let (reference, alone) = (same(&args.reference), files.len() == 1);
    files.retain(|path| alone || same(path) != reference);
    Ok(files)
}

/// An image, and what is recorded of it.
fn read(path: &Path, page: usize) -> Result<(Value, Arc<Image>)> {
    let Loaded { image, notes, sha256, .. } = read_image(path, page)?;
    for note in &notes {
        eprintln!("{}: {note}", path.display());
    }
    let record = json!({
        "file": absolute(path),
        "sha256": sha256,
        "width_px": image.width(),
        "height_px": image.height(),
        "depth": image.pixels().depth(),
        "messages": notes,
    });
    Ok((record, Arc::new(image)))
}

/// A strain or a bias: two figures.
fn small(value: Option<f64>) -> String {
    value.map_or("-".into(), |v| format!("{v:.1e}"))
}

/// Uncertainty and resolved period against element size. In thousandths of a pixel the uncertainty has the
/// size of the periods, and both share an axis.
fn plot(found: &Metrology, reference: &Path) -> Plot {
    let series = |name: &str, style, factor: f64, value: fn(&SizeResult) -> Option<f64>| {
        let sizes = found.sizes.iter();
        let (x, y) = sizes.filter_map(|r| Some((r.element_size_px as f64, factor * value(r)?))).unzip();
        PlotSeries::new(name, style, x, y)
    };
    let uncertainty = |name, style, value| series(&format!("uncertainty, {name}"), style, 1e3, value);
    let period = |name, style, value| series(&format!("period, {name}"), style, 1.0, value);
    let drawn = vec![
        uncertainty("formula", Style::Dashed, |r| Some(larger(r.sigma_formula_px))),
        uncertainty("predicted by correlate", Style::Line, |r| r.sigma_predicted_px.map(larger)),
        uncertainty("measured, inner nodes", Style::Markers, SizeResult::sigma_px),
        uncertainty("measured, edge nodes", Style::Markers, |r| r.measured.as_ref()?.edge_px.map(larger)),
        period("theory, mean over phase", Style::Dashed, |r| Some(r.period_theory_px[1])),
        period("measured, mean", Style::Markers, |r| r.period_measured?.averaged_px),
        period("measured, worst phase", Style::Markers, |r| r.period_measured?.at_middle_px),
    ];
    let origin = match found.noise.origin {
        Origin::StaticImages => "measured",
        Origin::Given => "given",
        Origin::Assumed => "assumed, not measured",
    };
    let name = file_name(reference);
    let mut notes = vec![format!("noise of one image {:.2} grey levels ({origin})", found.noise.sigma_grey)];
    notes.push("uncertainty of a node, the larger component; period of which 90 % of the amplitude is left".into());
    if let Some(size) = found.advice.element_size_px {
        notes.push(format!("recommended: elements of {size} px"));
    }
    Plot {
        title: format!("{name}: what elements of a size measure"),
        x: Axis::log("element size (px)"),
        y: Axis::log("uncertainty (0.001 px); period (px)"),
        series: drawn.into_iter().filter(|series| !series.x.is_empty()).collect(),
        notes,
        ..Plot::default()
    }
}

/// What `correlate` should take for noise.
fn case_lines(noise: &Noise) -> Vec<String> {
    let level = match noise.photon.filter(PhotonFit::is_certain) {
        Some(PhotonFit { a_grey2, b_grey, .. }) => format!("noise = {{ a = {a_grey2:.4}, b = {b_grey:.6} }}"),
        None => format!("noise = {:.3}", noise.sigma_grey),
    };
    let factor = noise.correlation.as_ref().and_then(|found| found.factor);
    let factor = factor.map(|[x, y]| format!("noise_correlation = {:.2}", x.max(y).max(1.0)));
    [Some(level), factor].into_iter().flatten().collect()
}

/// `all`: the strain gauges of all element sizes.
fn print(found: &Metrology, options: &Options, all: bool) {
    let Metrology { noise, texture, .. } = found;
    let [x0, y0, x1, y1] = found.zone_px;
    say(&format!("looked at       x {x0} to {x1}, y {y0} to {y1} px ({} x {} px)", x1 - x0, y1 - y0));
    print_noise(noise);
    let [gx, gy] = texture.gradient_grey_per_px;
    say(&format!("gradient        {gx:.2} along x, {gy:.2} along y, rms, grey levels per px"));
    let [sx, sy] = texture.speckle_px.map(|size| number(size, 1));
    say(&format!("speckles        {sx} px along x, {sy} px along y (width of the autocorrelation at half its height)"));
    let ([low, high], [p1, p99], [dark, bright]) =
        (texture.range_grey, texture.percentiles_grey, texture.saturated_percent);
    let used = texture.range_used_percent.map_or(String::new(), |used| format!(", {used:.0} % of the scale"));
    say(&format!("grey levels     {low} to {high}; 98 % of the pixels {p1} to {p99}{used}"));
    println!("saturated       {dark:.2} % dark, {bright:.2} % bright");
    print_sizes(found);
    gauges::print(found, all);
    println!();
    println!("largest bias over sub-pixel displacements, elements of {} px, px", found.bias_element_size_px);
    for bias in found.bias.iter().filter(|bias| !bias.shift_px.is_empty()) {
        let used = if bias.interpolation == options.interpolation { "  (used above)" } else { "" };
        println!("  {:9} {:.1e}{used}", bias.interpolation.name(), bias.largest_px);
    }
    println!();
    match found.advice.element_size_px {
        Some(size) => println!("recommended: --element-size {size}"),
        None => println!("no element size can be recommended"),
    }
    for reason in &found.advice.reasons {
        println!("{}", wrapped(&format!("  {reason}"), 2));
    }
    for hint in &found.advice.hints {
        println!("{}", wrapped(&format!("note: {hint}"), 2));
    }
}

/// A line about one matter, which begins in the column that all have.
fn say(line: &str) {
    println!("{}", wrapped(line, 16));
}

/// What is known of the noise, and what of it goes into a case file.
fn print_noise(noise: &Noise) {
    for (row, (name, value)) in noise_facts(noise).into_iter().enumerate() {
        match row {
            0 => say(&format!("noise           {value}")),
            _ => say(&format!("                {}: {value}", name[..1].to_lowercase() + &name[1..])),
        }
    }
    if noise.origin == Origin::StaticImages {
        println!("for the case file of correlate, in [correlation]:");
        case_lines(noise).iter().for_each(|line| println!("                {line}"));
    }
}

/// A row for each element size: what it measures, and what it resolves.
fn print_sizes(found: &Metrology) {
    println!();
    println!("standard uncertainty of one component (the larger of x and y)");
    println!("element  without | displacement of a node, px           | strain at centre");
    println!("size px  texture | formula predicted measured  on edge  | formula measured");
    for result in &found.sizes {
        let measured = result.measured.as_ref();
        println!(
            "{:7}  {:5.1} % | {:>7} {:>9} {:>8} {:>8}  | {:>7} {:>8}",
            result.element_size_px,
            result.refused_percent,
            number(Some(larger(result.sigma_formula_px)), 4),
            number(result.sigma_predicted_px.map(larger), 4),
            number(result.sigma_px(), 4),
            number(measured.and_then(|scatter| scatter.edge_px).map(larger), 4),
            small(Some(larger(result.strain_sigma_formula))),
            small(measured.and_then(|scatter| scatter.strain).map(larger)),
        );
    }
    println!();
    println!("shortest period resolved at 90 %, px");
    println!("element |         measured        | theory | uncertainty");
    println!("size px |  best     mean    worst |   mean |    x period");
    for result in &found.sizes {
        let periods = result.period_measured;
        println!(
            "{:7} | {:>5} {:>8} {:>8} | {:>6} | {:>11}",
            result.element_size_px,
            number(periods.and_then(|p| p.at_node_px), 0),
            number(periods.and_then(|p| p.averaged_px), 0),
            number(periods.and_then(|p| p.at_middle_px), 0),
            number(Some(result.period_theory_px[1]), 0),
            number(result.sigma_times_period_px2, 2),
        );
    }
}
