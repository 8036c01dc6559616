//! `quadrille probe`.

use crate::cli::args::ProbeArgs;
use crate::cli::talk::Paint;
use crate::cli::{Outcome, Result, plural};
use crate::field::Curve;
use crate::io::case::{
    CaseExtensometer, CaseLine, CaseLoad, CaseOpening, CaseProbe, CaseQuantities, CaseRegion, CaseTension, over,
    parse_case, read_case,
};
use crate::io::quantities::{LineHistory, QuantitySummary};
use crate::io::store::Store;
use crate::report::correlation::{along_load, line_maps, turn_axes};
use crate::report::{Plot, tension_lines, tension_plot};
use crate::run::look::quantities::{FOLDER, seen_by, write_of_store};
use crate::run::{Record, save_picture, strain_window};
use std::path::Path;

const CURVES: &str = "curves";

pub(crate) fn run(args: &ProbeArgs) -> Result<Outcome> {
    args.drawn.choose();
    let store = Store::open(&args.run)?;
    let store = match &args.camera {
        Some(file) => seen_by(store, file)?,
        None => store,
    };
    let asked = resolve_asked(args, &store)?;
    if asked.is_empty() && store.header().camera()?.shape().still.is_empty() {
        return Err(
            "nothing is asked for; give --point, --line, --extensometer, --region, --opening or --remove-rigid, or a \
                    --case file with [[probe]], [[line]], [[extensometer]], [[region]] or [[opening]]"
                .into(),
        );
    }
    let numbers = args.frames.numbers(store.n_frames())?;
    let mut wanted = Vec::with_capacity(numbers.len());
    let mut n_fields = 0;
    for number in numbers {
        let field = store.status(number)?.is_some_and(|status| status.has_field());
        n_fields += usize::from(field);
        if field || !args.frames.is_last() {
            wanted.push(number);
        }
        if field && args.frames.is_last() {
            break;
        }
    }
    if n_fields == 0 {
        return Err(
            format!("{}: none of the frames asked for has a field; see summary.json", args.run.display()).into()
        );
    }
    wanted.sort_unstable();
    let n = wanted.len();
    let output = args.output.as_deref().unwrap_or(&args.run);
    let window = args.strain_window.map(|nodes| strain_window(Some(nodes))).transpose()?;
    let summary = write_of_store(&store, &asked, (args.strain, window), &wanted, output, |_, _| ())?;
    if let Some(wanted) = &args.curves {
        let bound = Record::of(store.header()).is_regularised();
        draw_curves(drawings(&summary, bound), &wanted.0, &output.join(CURVES))?;
    }
    if !args.talk.quiet {
        tension_lines(&summary).for_each(|line| eprintln!("{line}"));
        summary.remarks.iter().for_each(|remark| eprintln!("{}", Paint::PLAIN.remark(remark)));
        eprintln!("{} probed, tables in {}", plural(n, "frame"), output.join(FOLDER).display());
    }
    Ok(args.frames.outcome(n - n_fields))
}

/// A drawing: whose it is, the quantity and what it is against, the plot.
type Drawing = (String, [String; 2], Plot);

/// Draws each curve of at least two points, with bars of two standard uncertainties, or of upper bounds of them; and
/// lines over time.
fn drawings(summary: &QuantitySummary, bound: bool) -> Vec<Drawing> {
    let of_bound = if bound { " (upper bounds: neighbouring nodes are bound to each other)" } else { "" };
    let bars = format!("bars: \u{b1}2 standard uncertainties{of_bound}");
    let of_curve = |curve: &Curve| {
        let [of, against] = [&curve.quantity, &curve.against].map(String::clone);
        let plot = Plot { notes: vec![bars.clone()], ..along_load(curve) };
        let turned = curve.is_against_load().then(|| turn_axes(curve));
        let turned = turned.map(|plot| (curve.name.clone(), [against.clone(), of.clone()], plot));
        [(curve.name.clone(), [of, against], plot)].into_iter().chain(turned)
    };
    let of_line = |line: &LineHistory| {
        let maps = line_maps(line, summary.times.as_ref());
        maps.into_iter().map(|(names, plot)| (line.name.clone(), names, plot)).collect::<Vec<_>>()
    };
    let curves = summary.curves.iter().filter(|curve| curve.x.len() > 1).flat_map(of_curve);
    let of_tension = summary.tension.iter().filter_map(|of| {
        Some(("tension".to_owned(), ["stress_MPa", "strain_along"].map(str::to_owned), tension_plot(of)?))
    });
    curves.chain(summary.lines.iter().flat_map(of_line)).chain(of_tension).collect()
}

/// Writes the `wanted` of the `drawings`; all where none is named.
fn draw_curves(drawings: Vec<Drawing>, wanted: &[[String; 2]], folder: &Path) -> Result<()> {
    if let Some([of, against]) = wanted.iter().find(|&wanted| drawings.iter().all(|(_, names, _)| names != wanted)) {
        let mut there: Vec<String> = drawings.iter().map(|(_, [of, against], _)| format!("{of}:{against}")).collect();
        there.sort_unstable();
        there.dedup();
        return Err(format!("there is no curve {of}:{against}; there are {}", there.join(", ")).into());
    }
    std::fs::create_dir_all(folder).map_err(|e| format!("{}: cannot be written: {e}", folder.display()))?;
    let plain = |c: char| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    for (name, names, plot) in drawings {
        if wanted.is_empty() || wanted.contains(&names) {
            let name: String = format!("{name}-{}", names.join("-against-")).chars().map(plain).collect();
            save_picture(folder, &name, &plot.draw()?)?;
        }
    }
    Ok(())
}

/// What flags and case file ask for together. Without a case file, and when no flag asks for anything, what the case
/// of the run asks for.
fn resolve_asked(args: &ProbeArgs, store: &Store) -> Result<CaseQuantities> {
    let of_run = || parse_case(&store.header().case, Path::new("run.toml")).map(|case| case.drawn());
    let by_flags = !(args.point.is_empty()
        && args.line.is_empty()
        && args.extensometer.is_empty()
        && args.region.is_empty()
        && args.opening.is_empty()
        && args.options.remove_rigid.is_none());
    let mut asked = match &args.case {
        Some(case) => read_case(case)?.drawn(),
        None if by_flags => CaseQuantities { load: of_run()?.load, ..CaseQuantities::default() },
        None => of_run()?,
    };
    // Flags of a kind take the place of the file's sections of that kind.
    if !args.point.is_empty() {
        asked.probes = args.point.iter().map(|&point| CaseProbe { name: None, point }).collect();
    }
    if !args.line.is_empty() {
        let line = |&[x0, y0, x1, y1]: &[f64; 4]| CaseLine { name: None, from: [x0, y0], to: [x1, y1], step_px: None };
        asked.lines = args.line.iter().map(line).collect();
    }
    if let Some(step) = args.step {
        asked.lines.iter_mut().for_each(|line| line.step_px = Some(step));
    }
    if !args.extensometer.is_empty() {
        let ends = |&[x0, y0, x1, y1]: &[f64; 4]| ([x0, y0], [x1, y1]);
        let gauge = |(from, to)| CaseExtensometer { name: None, from, to, width_px: None };
        asked.extensometers = args.extensometer.iter().map(ends).map(gauge).collect();
    }
    if let Some(width) = args.width {
        asked.extensometers.iter_mut().for_each(|gauge| gauge.width_px = Some(width));
    }
    if !args.region.is_empty() {
        let region = |&roi: &[f64; 4]| CaseRegion { roi: Some(roi), ..CaseRegion::default() };
        asked.regions = args.region.iter().map(region).collect();
    }
    if !args.opening.is_empty() {
        asked.openings = args.opening.iter().map(|zones| CaseOpening { name: None, zones: zones.clone() }).collect();
    }
    asked.options = over(&args.options, &asked.options)?;
    if args.tension != CaseTension::default() {
        asked.tension = Some(over(&args.tension, &asked.tension.unwrap_or_default())?);
    }
    if let Some(load) = &args.load {
        // Another file has times and areas of its own.
        asked.load = Some(CaseLoad { file: load.display().to_string(), ..CaseLoad::default() });
    }
    let flags = &args.load_options;
    match &mut asked.load {
        Some(load) => {
            if flags.frame_interval_s.is_some() || flags.frame_times.is_some() {
                (load.frame_interval_s, load.frame_times) = (None, None);
            }
            *load = over(flags, load)?;
        }
        None if flags.frame_interval_s.is_some() || flags.frame_times.is_some() => asked.load = Some(flags.clone()),
        None if flags.time.is_some() || flags.area_mm2.is_some() => {
            return Err("--load-time and --area are about a load file; give --load FILE as well".into());
        }
        None => {}
    }
    Ok(asked)
}
