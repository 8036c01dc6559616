//! `quadrille correlate`.

use super::args::CorrelateArgs;
use super::plan::{MANY, Plan};
use super::progress::{Progress, Talk};
use super::run_folder::{About, RunFolder};
use super::series::{self, Engine};
use super::zones::Zones;
use super::{Outcome, Result, absolute, chain, plural, pool, probe, quantities};
use crate::backend::Backend;
use crate::correlate::{BareBorder, Correlation, CorrelationError, Correlator};
use crate::field::{Status, StrainField};
use crate::imaging::{GreyDepth, Image, Mean, Saturation, small_shift};
use crate::io::case::write_case;
use crate::io::series::Frame;
use crate::io::store::{STORE, Store, StoreHeader, StoreWriter};
use crate::mesh::{Mesh, MeshError};
use crate::report::summary::{ReferenceSummary, Summary, counts, saturation_message, units};
use crate::units::Px;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::{Duration, Instant};

/// Results that wait to be written.
const BEHIND: usize = 4;
/// How often the summary is written while the series runs.
const SUMMARY_EVERY: Duration = Duration::from_secs(10);

/// Runs the command.
pub(super) fn run(args: &CorrelateArgs) -> Result<Outcome> {
    let plan = Plan::new(args)?;
    let talk = match (args.quiet, args.verbose) {
        (true, _) => Talk::Quiet,
        (_, true) => Talk::Verbose,
        _ => Talk::Normal,
    };
    let folder = RunFolder::open(&args.output, args.overwrite)?;
    let summary = run_series(&plan, &folder, pool(args.threads)?, talk, |_, _| ())?;
    if let Some(frames) = &args.figures {
        super::figures::of_run(&args.output, frames, args.threads, args.quiet)?;
    }
    let fine = summary.frames.iter().all(|frame| frame.status == Status::Converged);
    Ok(if fine { Outcome::Fine } else { Outcome::Incomplete })
}

/// Correlates the series of `plan` into `folder`; also the heart of `quadrille demo`. Each result is shown
/// to `look` with its frame number before it is written.
pub(super) fn run_series(
    plan: &Plan,
    folder: &RunFolder,
    pool: rayon::ThreadPool,
    talk: Talk,
    mut look: impl FnMut(usize, &Correlation),
) -> Result<Summary> {
    let begin = Instant::now();
    // Before anything is run: a load file that does not fit, or places that mean nothing, are refused now.
    quantities::load(&plan.drawn, plan.deformed.len())?;
    let Reference { image, sha256, notes } = Reference::read(&plan.reference)?;
    let (width, height) = (image.width(), image.height());
    let Zones { zones, notes: zone_notes, files: zone_files } = Zones::on(&plan.zones, plan.guard_px, width, height)?;
    let depth = image.pixels().depth();
    let reference_image = Arc::new(image);
    let prepare = Instant::now();
    let device = plan.device()?;
    let begin_preparation = || Engine::new(device, Arc::clone(&reference_image), zones, plan.options.clone());
    let engine = pool.install(begin_preparation).map_err(|error| about_reference(plan, &error))?;
    let correlator = engine.correlator();
    let seconds_reference = prepare.elapsed().as_secs_f64();
    quantities::resolve(&plan.drawn, plan.strain, correlator.mesh())?;
    folder.clear(plan.csv, plan.vtu)?;
    quantities::remove(folder.path())?;

    let mut progress = Progress::new(talk, plan.deformed.len());
    let mesh = correlator.mesh();
    progress.say(&format!(
        "reference {} ({width} x {height} px, {depth}), {}, {} elements of {} px, {} nodes; {}, {}",
        plan.reference_name(),
        plural(mesh.zones().len(), "zone"),
        mesh.n_elements(),
        plan.options.element_size,
        mesh.n_nodes(),
        correlator.backend().device(),
        plural(pool.current_num_threads(), "thread"),
    ));
    let saturation = Saturation::of(&reference_image, &windows(mesh));
    let about_grey =
        [GreyDepth::of(&reference_image).and_then(GreyDepth::remark), saturation.and_then(saturation_message)];
    let about_grey = about_grey.into_iter().flatten().map(|note| format!("{}: {note}", plan.reference_name()));
    notes.into_iter().chain(about_grey).chain(zone_notes).for_each(|note| progress.say(&note));
    if !correlator.dropped().is_empty() {
        progress.say(&format!("{} with too little texture left out", plural(correlator.dropped().len(), "node")));
    }
    if !correlator.held().is_empty() {
        progress.say(&format!(
            "{} with too little texture held by the regularisation",
            plural(correlator.held().len(), "node")
        ));
    }
    let border_notes: Vec<String> = correlator.bare_borders().iter().map(bare_border_note).collect();
    border_notes.iter().for_each(|note| progress.say(note));
    let mut summary = Summary {
        quadrille: env!("CARGO_PKG_VERSION").into(),
        device: correlator.backend().device(),
        threads: pool.current_num_threads(),
        units: units(),
        reference: ReferenceSummary {
            file: plan.reference[0].to_string(),
            mean_of: match plan.reference.as_slice() {
                [_] => Vec::new(),
                several => several.iter().map(ToString::to_string).collect(),
            },
            width_px: width,
            height_px: height,
            depth,
            bits_used: GreyDepth::of(&reference_image).map(|depth| depth.used),
            saturated_percent: saturation.map(Saturation::percent),
            range_grey: correlator.grey_range(),
        },
        n_nodes: mesh.n_nodes(),
        n_elements: mesh.n_elements(),
        n_levels: correlator.n_levels(),
        solver: correlator.solver_name(),
        tolerance_px: plan.options.tolerance_px,
        seconds_reference,
        seconds_total: 0.0,
        nodes_left_out: correlator.dropped().iter().map(Into::into).collect(),
        nodes_held: correlator.held().iter().map(Into::into).collect(),
        messages: border_notes,
        counts: counts(&[]),
        frames: Vec::with_capacity(plan.deformed.len()),
    };
    let mut record = Record::new(plan, &*correlator, [width, height], pool.current_num_threads());
    record.images.extend(plan.reference.iter().cloned().zip(sha256.iter().cloned().map(Some)));
    record.zone_files = zone_files;
    folder.write_case(&record.case())?;
    let header = StoreHeader {
        quadrille: env!("CARGO_PKG_VERSION").into(),
        device: correlator.backend().device(),
        mesh: mesh.clone(),
        image_size_px: [width, height],
        reference: plan.reference.iter().map(ToString::to_string).collect(),
        reference_sha256: sha256.clone(),
        frames: plan.deformed.iter().map(ToString::to_string).collect(),
        pixel_size: plan.pixel_size,
        range_grey: correlator.grey_range(),
        element_size_px: element_size_px(mesh, plan.options.element_size),
        strain: plan.strain,
        case: record.without_images(),
    };
    let store = folder.store(&header)?;
    if let Some(matrices) = correlator.normal_matrices() {
        store.write_normal_matrices(&matrices)?;
    }
    let about = About::new(header)?;
    for note in engine.take_notes() {
        progress.say(&note);
        summary.messages.extend(note.starts_with("warning").then_some(note));
    }
    if plan.store_only {
        progress.say(&format!(
            "more than {MANY} frames: fields go to {STORE} alone; `quadrille export` makes tables of them, \
             or --export csv,vtu during the run"
        ));
    }

    let frames = series::Frames { list: &plan.deformed, windows: &windows(mesh), start: plan.options.start };
    let written = std::thread::scope(|scope| -> Result<()> {
        let (finished, to_write) = sync_channel(BEHIND);
        let (store, about) = (&store, &about);
        let writer = scope.spawn(move || write_all(plan, folder, store, about, &to_write));
        let mut last_summary = Instant::now();
        let done = series::run(&engine, &pool, &frames, |done| {
            let series::Done { source, sha256, summary: frame, result } = done;
            let number = frame.number;
            record.images.push((source, sha256));
            if let Some(result) = &result {
                look(number, result);
            }
            let file = frame.file.clone();
            engine.take_notes().into_iter().for_each(|note| {
                progress.say(&note);
                summary.messages.push(note);
            });
            summary.frames.push(frame);
            progress.frame(number, &summary.frames[number - 1]);
            if last_summary.elapsed() > SUMMARY_EVERY {
                last_summary = Instant::now();
                summary.counts = counts(&summary.frames);
                summary.seconds_total = begin.elapsed().as_secs_f64();
                folder.write_summary(&summary)?;
            }
            // When the writer has stopped, its error says why.
            Ok(finished.send(ToWrite { number, file, result }).is_ok())
        });
        drop(finished);
        writer.join().map_err(|_| "the writer stopped: this is a bug in quadrille")??;
        done
    });
    summary.counts = counts(&summary.frames);
    summary.seconds_total = begin.elapsed().as_secs_f64();
    // Also when writing has failed: what is known is kept where it can be.
    let closed = folder.write_case(&record.case()).and_then(|()| folder.write_summary(&summary));
    let closed = closed.and_then(|()| Ok(store.finish(record.sha256())?));
    written?;
    closed?;
    if !plan.drawn.is_empty() {
        let numbers: Vec<usize> = (1..=summary.frames.len()).collect();
        let store = Store::open(folder.path())?;
        let drawn = probe::write_of_store(&store, &plan.drawn, None, &numbers, folder.path(), |_, _| ())?;
        drawn.notes.iter().for_each(|note| progress.say(note));
    }
    progress.finish(&summary.frames, summary.seconds_total);
    progress.say(&format!("results in {}", folder.path().display()));
    Ok(summary)
}

/// Size of the elements: the one asked for, or what the mesh of a file has.
fn element_size_px(mesh: &Mesh<Px>, asked: usize) -> f64 {
    let (size, asked) = (mesh.element_size(), asked as f64);
    // Grids that start at a fraction of a pixel miss it in the last digits.
    if (size - asked).abs() < 1e-9 * asked { asked } else { size }
}

/// What a zone that ends at a place without texture should be told.
fn bare_border_note(border: &BareBorder) -> String {
    let BareBorder { zone, length_px, at: [x, y] } = border;
    format!(
        "warning: zone '{zone}' borders on {length_px:.0} px without texture (about ({x:.0}, {y:.0}) px): what lies beyond \
         is mixed into its outermost pixels and pulls the nodes there; leave these out with --guard 3 or guard_px"
    )
}

/// Why the reference cannot be prepared; its file is named when the fault may be in it.
fn about_reference(plan: &Plan, error: &CorrelationError) -> String {
    use MeshError::{
        CrossedPolygon, ElementShare, ElementSize, GuardSides, NoPolygon, NotARectangle, NotFinite, Overlap, SameName,
    };
    match error {
        CorrelationError::Option { .. }
        | CorrelationError::Backend(_)
        | CorrelationError::Mesh(
            ElementSize { .. }
            | ElementShare { .. }
            | NotARectangle { .. }
            | Overlap { .. }
            | SameName { .. }
            | NoPolygon { .. }
            | CrossedPolygon { .. }
            | NotFinite { .. }
            | GuardSides { .. },
        ) => chain(error),
        _ => format!("{}: {}", plan.reference_name(), chain(error)),
    }
}

/// The reference image, or the mean of several.
struct Reference {
    image: Image,
    /// Of each file.
    sha256: Vec<String>,
    /// What is worth knowing, each with its file.
    notes: Vec<String>,
}

impl Reference {
    /// References further apart than this are said to have moved, px: averaging them blurs the texture.
    const STILL_PX: f64 = 0.02;

    fn read(frames: &[Frame]) -> Result<Self> {
        let mut first: Option<(Image, &Frame)> = None;
        let mut mean: Option<Mean> = None;
        let (mut sha256, mut notes) = (Vec::new(), Vec::new());
        for frame in frames {
            let loaded = frame.read()?;
            sha256.push(loaded.sha256);
            notes.extend(loaded.notes.iter().map(|note| format!("{frame}: {note}")));
            let Some((before, name)) = &first else {
                first = Some((loaded.image, frame));
                continue;
            };
            let mean = mean.get_or_insert_with(|| Mean::new(before));
            if !mean.add(&loaded.image) {
                let size = |image: &Image| format!("{} x {} px", image.width(), image.height());
                let sizes = [size(&loaded.image), size(before)];
                return Err(format!(
                    "{frame}: the image is {}, the reference {name} {}; the mean needs images of one size",
                    sizes[0], sizes[1]
                )
                .into());
            }
            if let Some([x, y]) = small_shift(before, &loaded.image)
                && x.hypot(y) > Self::STILL_PX
            {
                notes.push(format!(
                    "{frame}: moved by about ({x:.2}, {y:.2}) px against {name}: their mean is blurred; take references \
                     between which nothing moves"
                ));
            }
        }
        let (first, _) = first.ok_or("no reference image is given")?;
        let image = mean.map_or(first, Mean::image);
        Ok(Self { image, sha256, notes })
    }
}

/// The rectangles that hold the zones, px: x0, y0, x1, y1.
fn windows(mesh: &Mesh<Px>) -> Vec<[usize; 4]> {
    let window = |zone: usize| {
        let bounds = mesh.bounds(zone);
        // Negative corners are cut at 0.
        [bounds.x0.ceil(), bounds.y0.ceil(), bounds.x1.ceil(), bounds.y1.ceil()].map(|v| v as usize)
    };
    (0..mesh.zones().len()).map(window).collect()
}

/// A frame on its way to the disk; without a result when it could not be read.
struct ToWrite {
    number: usize,
    file: String,
    result: Option<Correlation>,
}

fn write_all(
    plan: &Plan,
    folder: &RunFolder,
    store: &StoreWriter,
    about: &About,
    frames: &Receiver<ToWrite>,
) -> Result<()> {
    let mut in_series = Vec::new();
    for ToWrite { number, file, result } in frames {
        let Some(Correlation { measurement, .. }) = result else {
            store.mark(number, Status::Unreadable)?;
            continue;
        };
        // A diverged field is no measurement: its numbers are not spread.
        if !measurement.status.has_field() {
            store.mark(number, measurement.status)?;
            continue;
        }
        // The length is the one that the store says, to the last digit.
        let length_px = about.element_size_px();
        let strain = StrainField { length_px, ..StrainField::of(&measurement, plan.strain) };
        store.write(number, &measurement, &strain)?;
        if plan.csv {
            folder.write_csv(number, about, &file, &measurement, &strain)?;
        }
        if plan.vtu {
            folder.write_vtu(number, about, &file, &measurement, &strain)?;
            in_series.push(number);
            if in_series.len() % 100 == 0 {
                folder.write_series(&in_series)?;
            }
        }
    }
    if plan.vtu {
        folder.write_series(&in_series)?;
    }
    Ok(())
}

/// What `run.toml` tells beside the options.
struct Record {
    case: crate::io::case::CaseFile,
    about: toml::Table,
    /// The references first.
    images: Vec<(Frame, Option<String>)>,
    n_references: usize,
    zone_files: Vec<(PathBuf, String)>,
}

impl Record {
    fn new<B: Backend>(plan: &Plan, correlator: &Correlator<B>, [width, height]: [usize; 2], threads: usize) -> Self {
        let mut about = toml::Table::new();
        about.insert("quadrille".into(), env!("CARGO_PKG_VERSION").into());
        about.insert("device".into(), correlator.backend().device().into());
        about.insert("isa".into(), plan.isa.name().into());
        about.insert("threads".into(), (threads as i64).into());
        let exports = [(plan.csv, "csv"), (plan.vtu, "vtu")];
        let exports = exports.iter().filter(|(on, _)| *on).map(|(_, name)| (*name).into());
        about.insert("export".into(), toml::Value::Array(exports.collect()));
        about.insert(
            "units".into(),
            units().into_iter().map(|(k, v)| (k.to_owned(), v.into())).collect::<toml::Table>().into(),
        );
        Self {
            case: plan.resolved(width, height),
            about,
            images: Vec::new(),
            n_references: plan.reference.len(),
            zone_files: Vec::new(),
        }
    }

    /// The case file with the record of the run but for its images: the store names them beside it.
    fn without_images(&self) -> String {
        write_case(&crate::io::case::CaseFile { run: Some(self.about.clone()), ..self.case.clone() })
    }

    /// Of each deformed image that was come to.
    fn sha256(&self) -> Vec<Option<String>> {
        self.images[self.n_references..].iter().map(|(_, sha256)| sha256.clone()).collect()
    }

    /// The case file with the record of the run.
    fn case(&self) -> String {
        let entry = |path: &Path, page: Option<usize>, sha256: Option<&str>| {
            let mut table = toml::Table::new();
            table.insert("file".into(), absolute(path).into());
            page.map(|page| table.insert("page".into(), (page as i64).into()));
            // A file that could not be read has none.
            sha256.map(|sha256| table.insert("sha256".into(), sha256.into()));
            toml::Value::Table(table)
        };
        let image = |(frame, sha256): &(Frame, Option<String>)| {
            entry(&frame.path, frame.is_page.then_some(frame.page), sha256.as_deref())
        };
        let mut about = self.about.clone();
        about.insert("image".into(), toml::Value::Array(self.images.iter().map(image).collect()));
        if !self.zone_files.is_empty() {
            let files = self.zone_files.iter().map(|(path, sha256)| entry(path, None, Some(sha256)));
            about.insert("zone_file".into(), toml::Value::Array(files.collect()));
        }
        write_case(&crate::io::case::CaseFile { run: Some(about), ..self.case.clone() })
    }
}
