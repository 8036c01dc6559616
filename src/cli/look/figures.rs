//! `quadrille figures`.

use crate::camera::Rectifier;
use crate::cli::args::{FiguresArgs, FileKind, StrainPlace};
use crate::cli::look::animate::write_moving;
use crate::cli::look::frames::Frames;
use crate::cli::{Outcome, Result, chain, file_name, plural, pool, without_doubles};
use crate::field::StrainWindow;
use crate::io::images::Accepted;
use crate::io::series::Frame;
use crate::io::store::{Store, StoreHeader, StoredFrame, Variable};
use crate::report::{Backdrop, Figure, FigureOptions, Look, Picture, draw_figure, draw_frame, ends_of};
use crate::run::{FIGURES, Record, frame_in_words, of_size, reference, strain_window};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// How often a long run says how far it is.
const EVERY: Duration = Duration::from_secs(10);

pub(crate) fn run(args: &FiguresArgs) -> Result<Outcome> {
    args.drawn.choose();
    if args.no_warnings {
        Look::choose_without_warnings();
    }
    let store = Store::open(&args.run)?;
    let (numbers, n_without) = drawable(&args.frames, &store, args.talk.quiet)?;
    if numbers.is_empty() {
        return Err(format!("{}: no frame asked for has a field; see summary.json", store.path().display()).into());
    }
    let folder = args.output.clone().unwrap_or_else(|| args.run.join(FIGURES));
    let mut options = options(args, store.header())?;
    let is_residual = |figure: &Figure| matches!(figure, Figure::Residual | Figure::ResidualPercent);
    if !store.has(Variable::Residual) {
        if args.quantity.iter().any(is_residual) {
            return Err("the fields were imported from another program: they have no residual".into());
        }
        options.figures.retain(|figure| !is_residual(figure));
    }
    let series = RunFigures::new(&store, options, args.scale, args.talk.quiet);
    if !series.options.formats.is_empty() {
        series.draw(&numbers, &folder, args.threads.threads)?;
    }
    let moving: Vec<FileKind> =
        without_doubles(&args.format).into_iter().filter(|kind| kind.still().is_none()).collect();
    if !moving.is_empty() {
        series.animate(&numbers, &folder, args.threads.threads, &moving)?;
    }
    Ok(args.frames.outcome(n_without))
}

/// Draws the usual figures of a run that has just ended.
pub(crate) fn of_run(run: &Path, frames: &Frames, threads: Option<usize>, quiet: bool) -> Result<()> {
    let store = Store::open(run)?;
    let (numbers, _) = drawable(frames, &store, quiet)?;
    let header = store.header();
    let options =
        FigureOptions { strain: header.strain, strain_window: header.strain_window, ..FigureOptions::default() };
    let options = of_header(header, FigureOptions { figures: usual(header.strain_window), ..options })?;
    RunFigures::new(&store, options, 1, quiet).draw(&numbers, &run.join(FIGURES), threads)
}

/// The frames with a field, and those without of which the residual shows why; and how many have none.
fn drawable(frames: &Frames, store: &Store, quiet: bool) -> Result<(Vec<usize>, usize)> {
    let (mut numbers, n_without) = frames.with_field(store, quiet)?;
    if n_without > 0 && (!frames.is_last() || numbers.is_empty()) {
        for number in frames.numbers(store.n_frames())? {
            if (!frames.is_last() || numbers.is_empty()) && store.without_field(number)?.is_some() {
                numbers.push(number);
            }
        }
    }
    Ok((numbers, n_without))
}

/// What is drawn, from the arguments and from what the run says.
fn options(args: &FiguresArgs, header: &StoreHeader) -> Result<FigureOptions> {
    let default = FigureOptions::default();
    let asked = args.strain_window.map(|nodes| strain_window(Some(nodes))).transpose()?;
    let window = asked.unwrap_or(header.strain_window);
    let options = FigureOptions {
        figures: if args.quantity.is_empty() { usual(window) } else { without_doubles(&args.quantity) },
        formats: without_doubles(&args.format).into_iter().filter_map(FileKind::still).collect(),
        line: args.line,
        magnify: args.magnify,
        range: args.range.map(|[low, high]| (low, high)),
        strain: args.strain.unwrap_or(header.strain),
        strain_window: window,
        strain_on_nodes: args.strain_on == StrainPlace::Nodes,
        rigid: args.remove_rigid,
        ..default
    };
    of_header(header, options)
}

/// What is drawn of a frame when nobody names it: strains over a window as well, where there is one.
fn usual(window: Option<StrainWindow>) -> Vec<Figure> {
    let mut figures = FigureOptions::default().figures;
    figures.extend(window.iter().flat_map(|_| Figure::OF_WINDOW));
    figures
}

/// `options` with what the run says.
fn of_header(header: &StoreHeader, options: FigureOptions) -> Result<FigureOptions> {
    let record = Record::of(header);
    Ok(FigureOptions {
        pixel_size: header.pixel_size,
        camera: Some(Rectifier::new(header.camera()?, &header.mesh)?),
        range_grey: Some(header.range_grey),
        known_noise: !record.is_regularised(),
        guard_px: record.guards_px(header.mesh.zones()),
        ..options
    })
}

/// The frames of a run, and what their figures share.
struct RunFigures<'a> {
    store: &'a Store,
    options: FigureOptions,
    reference: Backdrop,
    ratio: u32,
    page: usize,
    quiet: bool,
}

impl<'a> RunFigures<'a> {
    fn new(store: &'a Store, options: FigureOptions, ratio: u32, quiet: bool) -> Self {
        let header = store.header();
        let page = Record::of(header).page();
        let [width, height] = header.image_size_px;
        let reference = match reference(header, page) {
            Ok(image) => Backdrop::new(&image, ratio),
            Err(why) => {
                if !quiet {
                    eprintln!("{why}; the figures are drawn on white");
                }
                Backdrop::blank(width, height, ratio)
            }
        };
        Self { store, options, reference, ratio, page, quiet }
    }

    fn draw(&self, numbers: &[usize], folder: &Path, threads: Option<usize>) -> Result<()> {
        let done = Mutex::new((0, Instant::now()));
        let one = |&number: &usize| {
            let n_files = self.draw_one(number, folder)?.len();
            if let Ok(mut done) = done.lock() {
                done.0 += 1;
                if !self.quiet && done.1.elapsed() > EVERY {
                    done.1 = Instant::now();
                    eprintln!("figures: {} of {} frames", done.0, numbers.len());
                }
            }
            Ok(n_files)
        };
        let n_files = pool(threads)?.install(|| numbers.par_iter().map(one).collect::<Result<Vec<_>>>())?;
        if !self.quiet {
            let (n_files, n_frames) = (n_files.iter().sum(), numbers.len());
            eprintln!("{} of {} in {}", plural(n_files, "picture"), plural(n_frames, "frame"), folder.display());
        }
        Ok(())
    }

    fn animate(&self, numbers: &[usize], folder: &Path, threads: Option<usize>, kinds: &[FileKind]) -> Result<()> {
        let pool = pool(threads)?;
        let mut files = Vec::new();
        for &figure in &self.options.figures {
            let range = match self.options.range {
                None => pool.install(|| self.common_range(numbers, figure))?,
                asked => asked,
            };
            let one = |&number: &usize| self.draw_moved(number, figure, range);
            let pictures = pool.install(|| numbers.par_iter().map(one).collect::<Result<Vec<_>>>())?;
            let pictures: Vec<Picture> = pictures.into_iter().flatten().collect();
            files.extend(write_moving(&pictures, numbers.len(), (folder, figure), kinds, &pool)?);
        }
        if !self.quiet {
            let names: Vec<String> = files.iter().map(|path| path.display().to_string()).collect();
            let (n_files, n_frames) = (plural(files.len(), "animation"), plural(numbers.len(), "frame"));
            eprintln!("{n_files} of {n_frames}: {}", names.join(", "));
        }
        Ok(())
    }

    fn measured(&self, number: usize) -> Result<Option<StoredFrame>> {
        Ok(self.store.frame(number)?.filter(|frame| frame.measurement.status.has_field()))
    }

    fn draw_moved(&self, number: usize, figure: Figure, range: Option<(f64, f64)>) -> Result<Option<Picture>> {
        let Some(frame) = self.measured(number)? else { return Ok(None) };
        let options = FigureOptions { range, ..self.noted(&frame, number)? };
        let deformed = if figure == Figure::Deformed { self.deformed(&frame.file) } else { None };
        let picture = draw_figure(number, &frame.measurement, &self.reference, deformed.as_ref(), figure, &options)?;
        Ok(Some(picture.with_ratio(self.ratio)))
    }

    /// Ends that hold the values of all frames; of a strain the same on both sides of zero.
    fn common_range(&self, numbers: &[usize], figure: Figure) -> Result<Option<(f64, f64)>> {
        let ends = |&number: &usize| -> Result<Option<[f64; 2]>> {
            let Some(frame) = self.measured(number)? else { return Ok(None) };
            Ok(ends_of(&frame.measurement, &self.reference, figure, &self.options)?)
        };
        let ends = numbers.par_iter().map(ends).collect::<Result<Vec<_>>>()?.into_iter().flatten();
        let Some([low, high]) = ends.reduce(|[a, b], [low, high]| [a.min(low), b.max(high)]) else { return Ok(None) };
        let most = low.abs().max(high.abs());
        let (low, high) = if figure.is_strain() { (-most, most) } else { (low, high) };
        Ok((high > low).then_some((low, high)))
    }

    /// The options with what is noted below the figures of a frame.
    fn noted(&self, frame: &StoredFrame, number: usize) -> Result<FigureOptions> {
        let mut options = self.options.clone();
        let header = self.store.header();
        let reference = header.reference.first().map(file_name).unwrap_or_default();
        options.notes.push(format!(
            "reference {reference}; image {}; quadrille {}",
            frame_in_words(&file_name(&frame.file), self.store.reference_frame(number)?.unwrap_or(0)),
            header.quadrille
        ));
        Ok(options)
    }

    fn draw_one(&self, number: usize, folder: &Path) -> Result<Vec<PathBuf>> {
        let mut options = self.options.clone();
        let frame = match self.store.frame(number)? {
            Some(frame) => frame,
            None => {
                // Of a frame without a field only the residual says something: why.
                options.figures.retain(|figure| matches!(figure, Figure::Residual | Figure::ResidualPercent));
                options.line = None;
                match self.store.without_field(number)? {
                    Some(frame) if !options.figures.is_empty() => frame,
                    _ => return Ok(Vec::new()),
                }
            }
        };
        options.notes = self.noted(&frame, number)?.notes;
        let on_image = options.magnify.is_none_or(|factor| factor == 1.0);
        let deformed = (on_image && options.figures.contains(&Figure::Deformed)).then(|| self.deformed(&frame.file));
        let deformed = deformed.flatten();
        Ok(draw_frame(folder, number, &frame.measurement, &self.reference, deformed.as_ref(), &options)?)
    }

    /// The deformed image, when it can be read still.
    fn deformed(&self, file: &str) -> Option<Backdrop> {
        let size = self.store.header().image_size_px;
        let loaded = Frame::named(file, self.page).read(Accepted::ANY).map_err(|error| chain(&error));
        let checked = loaded.and_then(|loaded| of_size(file, loaded.image, size));
        match checked {
            Ok(image) => Some(Backdrop::new(&image, self.ratio)),
            Err(why) => {
                if !self.quiet {
                    eprintln!("{why}; the deformed mesh is drawn on the reference");
                }
                None
            }
        }
    }
}
