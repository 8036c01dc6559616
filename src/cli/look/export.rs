//! `quadrille export`.

use crate::camera::Rectifier;
use crate::cli::args::{ExportArgs, Target};
use crate::cli::{Outcome, Result, plural, without_doubles};
use crate::io::arrays::{ArrayFile, ArrayFileError, Shape, Values};
use crate::io::foreign::{Border, Exchange, WrittenLayout, write_points};
use crate::io::mat::MatWriter;
use crate::io::npz::NpzWriter;
use crate::io::store::{Place, Store, Variable};
use crate::run::{About, RunFolder, frame_in_words};
use crate::units::PixelSize;
use std::io::{self, Seek, Write};
use std::path::Path;
use std::time::{Duration, Instant};

/// How often a long export says how far it is.
const EVERY: Duration = Duration::from_secs(10);

pub(crate) fn run(args: &ExportArgs) -> Result<Outcome> {
    let store = Store::open(&args.run)?;
    let (numbers, without_field) = args.frames.with_field(&store, args.talk.quiet)?;
    if numbers.is_empty() {
        let path = store.path().display();
        return Err(format!("{path}: none of {} has a field; see summary.json", plural(without_field, "frame")).into());
    }
    let about = About::new(store.header().clone())?;
    let output = args.output.as_deref().unwrap_or(&args.run);
    let targets = without_doubles(&args.to);
    if !args.overwrite {
        refuse_to_replace(args, output, &targets, &numbers)?;
    }
    if targets.contains(&Target::Mat) && !args.split {
        check::<MatWriter<Vec<u8>>>(&store, &numbers, false)?;
    }
    let (folder, split) = (RunFolder::for_export(output)?, args.split);
    let ticker = Ticker { quiet: args.talk.quiet, last: Instant::now() };
    let mut export = Export { store: &store, folder, numbers: &numbers, split, ticker };
    for target in targets {
        match target {
            Target::Csv | Target::Vtu => export.write_by_frame(target, &about)?,
            Target::Nodemap => export.write_points(target, WrittenLayout::Nodemap)?,
            Target::Vic2d => export.write_points(target, WrittenLayout::Vic2d)?,
            Target::MatchId => export.write_points(target, WrittenLayout::MatchId)?,
            Target::Boundary => export.write_border()?,
            Target::Npz | Target::Mat => export.write_arrays(target)?,
            Target::Hdf5 => export.write_exchange()?,
        }
    }
    if !args.talk.quiet {
        let left_out = match without_field {
            n if n > 0 && !args.frames.are_named() && !args.frames.is_last() => {
                format!(" ({} without a field left out)", plural(n, "frame"))
            }
            _ => String::new(),
        };
        eprintln!("{} exported to {}{left_out}", plural(numbers.len(), "frame"), output.display());
    }
    Ok(args.frames.outcome(without_field))
}

/// Says now and then how far a long export is.
struct Ticker {
    quiet: bool,
    last: Instant,
}

impl Ticker {
    fn tick(&mut self, what: &str, done: usize, total: usize) {
        if !self.quiet && self.last.elapsed() > EVERY {
            self.last = Instant::now();
            eprintln!("{what}: {done} of {total}");
        }
    }
}

/// The folder of the files of frames, and the ending of their names.
fn place(target: Target) -> [&'static str; 2] {
    match target {
        Target::Csv => ["csv"; 2],
        Target::Vtu => ["vtu"; 2],
        Target::Npz => ["npz"; 2],
        Target::Mat => ["mat"; 2],
        Target::Nodemap => ["nodemap", "txt"],
        Target::Vic2d => ["vic-2d", "csv"],
        Target::MatchId => ["matchid", "csv"],
        Target::Boundary => ["boundary", "csv"],
        Target::Hdf5 => ["hdf5", "h5"],
    }
}

/// The file of a frame, or of the whole series.
fn name(target: Target, number: Option<usize>) -> String {
    let [folder, ending] = place(target);
    number.map_or_else(|| format!("fields.{ending}"), |number| format!("{folder}/{number:06}.{ending}"))
}

fn refuse_to_replace(args: &ExportArgs, output: &Path, targets: &[Target], numbers: &[usize]) -> Result<()> {
    for &target in targets {
        let single = matches!(target, Target::Npz | Target::Mat | Target::Hdf5) && !args.split;
        let names: Vec<String> = match single {
            true => vec![name(target, None)],
            false => numbers.iter().map(|&number| name(target, Some(number))).collect(),
        };
        if let Some(there) = names.iter().map(|name| output.join(name)).find(|path| path.exists()) {
            let there = there.display();
            return Err(
                format!("{there}: is there already; replace it with --overwrite, or choose another --output").into()
            );
        }
    }
    Ok(())
}

/// A series on its way into files.
struct Export<'a> {
    store: &'a Store,
    folder: RunFolder,
    numbers: &'a [usize],
    /// Whether each frame has files of its own.
    split: bool,
    ticker: Ticker,
}

impl Export<'_> {
    fn write_by_frame(&mut self, target: Target, about: &About) -> Result<()> {
        let Self { store, folder, numbers, .. } = self;
        folder.make(place(target)[0])?;
        let camera = Rectifier::new(about.header.camera()?, store.mesh())?;
        for (done, &number) in numbers.iter().enumerate() {
            // Both are there: the status was looked at.
            let (Some(frame), Some(strain)) = (store.frame(number)?, store.strain(number)?) else { continue };
            let file = frame_in_words(&frame.file, store.reference_frame(number)?.unwrap_or(0));
            let tables = [target == Target::Csv, target == Target::Vtu];
            let plane = camera.rectify(&frame.measurement);
            folder.write_tables(tables, number, about, &file, [&frame.measurement, &*plane], &strain)?;
            self.ticker.tick(place(target)[0], done + 1, numbers.len());
        }
        if target == Target::Vtu {
            // Those of an earlier call and of the run itself as well: the list is that of the folder.
            let is_there = |&number: &usize| folder.path().join(name(target, Some(number))).is_file();
            let listed: Vec<usize> = (1..=store.n_frames()).filter(is_there).collect();
            folder.write_series(&listed)?;
        }
        Ok(())
    }

    /// Writes the frames in the layout of another program.
    fn write_points(&mut self, target: Target, layout: WrittenLayout) -> Result<()> {
        let Self { store, folder, numbers, .. } = self;
        let header = store.header();
        if layout.needs_scale() && header.pixel_size.is_none() {
            return Err(
                "a nodemap is in mm, and the run has no pixel size; correlate again with --pixel-size MM".into()
            );
        }
        let [subfolder, _] = place(target);
        folder.make(subfolder)?;
        let camera = Rectifier::new(header.camera()?, store.mesh())?;
        for (done, &number) in numbers.iter().enumerate() {
            let (Some(frame), Some(strain)) = (store.frame(number)?, store.strain(number)?) else { continue };
            // Millimetres are those of the plane; px stay raw.
            let in_plane = layout.needs_scale().then(|| camera.rectify(&frame.measurement));
            let field = in_plane.as_deref().unwrap_or(&frame.measurement);
            let comments = [format!("quadrille {}, frame {number}: {}", header.quadrille, frame.file)];
            folder.write(&name(target, Some(number)), |out| {
                write_points(out, layout, &comments, field, &strain, header.pixel_size)
            })?;
            self.ticker.tick(subfolder, done + 1, numbers.len());
        }
        Ok(())
    }

    /// Writes the displacements of the borders of zones.
    fn write_border(&mut self) -> Result<()> {
        let Self { store, folder, numbers, .. } = self;
        let Some(scale) = store.header().pixel_size else {
            return Err(
                "a boundary is in mm, and the run has no pixel size; correlate again with --pixel-size MM".into()
            );
        };
        let [subfolder, _] = place(Target::Boundary);
        folder.make(subfolder)?;
        let camera = Rectifier::new(store.header().camera()?, store.mesh())?;
        for (done, &number) in numbers.iter().enumerate() {
            let Some(frame) = store.frame(number)? else { continue };
            let title = format!("quadrille {}, frame {number}: {}", store.header().quadrille, frame.file);
            let border = Border::of(&camera.rectify(&frame.measurement), scale);
            folder.write(&name(Target::Boundary, Some(number)), |out| border.write_csv(out, &title))?;
            folder.write(&format!("{subfolder}/{number:06}.inp"), |out| border.write_inp(out, &title))?;
            self.ticker.tick(subfolder, done + 1, numbers.len());
        }
        Ok(())
    }

    /// Each file that is to be written, and its frames.
    fn files(&self, target: Target) -> Result<Vec<(String, Vec<usize>)>> {
        if !self.split {
            return Ok(vec![(name(target, None), self.numbers.to_vec())]);
        }
        self.folder.make(place(target)[0])?;
        Ok(self.numbers.iter().map(|&number| (name(target, Some(number)), vec![number])).collect())
    }

    /// Writes exchange files: the reference and frames behind it.
    fn write_exchange(&mut self) -> Result<()> {
        /// Bytes of a file, which is made in memory.
        const MOST: usize = 1 << 30;
        let files = self.files(Target::Hdf5)?;
        let (store, header) = (self.store, self.store.header());
        let steps = files.iter().map(|(_, numbers)| numbers.len() + 1).max().unwrap_or(0);
        if steps.saturating_mul(Exchange::step_bytes(store.mesh().n_nodes())) > MOST {
            return Err("the HDF5 file would have more than 1 GiB; use --split or --frames".into());
        }
        let camera = Rectifier::new(header.camera()?, store.mesh())?;
        let about = format!("quadrille {}; strains: {}", header.quadrille, header.strain.name());
        let (mut done, total) = (0, self.numbers.len());
        for (name, numbers) in files {
            let mut file: Option<Exchange> = None;
            for &number in &numbers {
                let (Some(frame), Some(strain)) = (store.frame(number)?, store.strain(number)?) else { continue };
                // Millimetres are those of the plane; px stay raw.
                let in_plane = header.pixel_size.is_some().then(|| camera.rectify(&frame.measurement));
                let field = in_plane.as_deref().unwrap_or(&frame.measurement);
                let file = file.get_or_insert_with(|| Exchange::new(&field.mesh, header.pixel_size));
                file.add(number as f64, field, &strain);
                done += 1;
                self.ticker.tick("hdf5", done, total);
            }
            if let Some(file) = file {
                self.folder.write(&name, |out| file.write(out, &about, "number of the frame"))?;
            }
        }
        Ok(())
    }

    fn write_arrays(&mut self, target: Target) -> Result<()> {
        let files = self.files(target)?;
        let Self { store, folder, split, ticker, .. } = self;
        let n_files = files.len();
        for (done, (name, numbers)) in files.into_iter().enumerate() {
            folder.write(&name, |out| {
                let written = match target {
                    Target::Mat => write_mat(&mut *out, store, &numbers, *split, ticker),
                    _ => write_npz(&mut *out, store, &numbers, *split, ticker),
                };
                written.map_err(io::Error::other)
            })?;
            ticker.tick(place(target)[0], done + 1, n_files);
        }
        Ok(())
    }
}

fn write_mat<W: Write>(out: W, store: &Store, numbers: &[usize], split: bool, ticker: &mut Ticker) -> Result<()> {
    let mut file = MatWriter::new(out, &format!("quadrille {}", store.header().quadrille))?;
    fill(&mut file, store, numbers, split, ticker)?;
    file.finish()?;
    Ok(())
}

fn write_npz<W: Write + Seek>(
    out: W,
    store: &Store,
    numbers: &[usize],
    split: bool,
    ticker: &mut Ticker,
) -> Result<()> {
    let mut file = NpzWriter::new(out);
    fill(&mut file, store, numbers, split, ticker)?;
    file.finish()?.flush()?;
    Ok(())
}

fn shape(store: &Store, variable: Variable, numbers: &[usize], split: bool) -> Shape {
    let rows = match variable.place() {
        Place::Nodes => store.mesh().n_nodes(),
        Place::Elements => store.mesh().n_elements(),
    };
    let frames = (!split).then_some(numbers.len());
    Shape { frames, rows, components: variable.n_components() }
}

fn variables_in(store: &Store) -> impl Iterator<Item = Variable> {
    Variable::ALL.into_iter().filter(|&variable| store.has(variable))
}

/// Whether all arrays fit, before the first is written.
fn check<F: ArrayFile>(store: &Store, numbers: &[usize], split: bool) -> std::result::Result<(), ArrayFileError> {
    variables_in(store)
        .try_for_each(|variable| F::check(variable.name(), variable.number(), shape(store, variable, numbers, split)))
}

/// Writes what all frames share, then array by array the frames.
fn fill<F: ArrayFile>(file: &mut F, store: &Store, numbers: &[usize], split: bool, ticker: &mut Ticker) -> Result<()> {
    let header = store.header();
    let mesh = store.mesh();
    let counted = |numbers: &[u32]| Values::U32(numbers.iter().map(|number| number + F::FIRST).collect());
    file.texts("about", &header.about())?;
    file.texts("run_toml", &header.case.lines().map(str::to_owned).collect::<Vec<_>>())?;
    file.texts("reference_file", &header.reference)?;
    let size = header.image_size_px.map(|n| n as f64);
    file.table("image_size_px", 2, &Values::F64(size.to_vec()))?;
    if let Some(size) = header.pixel_size.map(PixelSize::mm_per_px) {
        file.table("pixel_size_mm", 1, &Values::F64(vec![size]))?;
    }
    file.table("range_grey", 1, &Values::F64(vec![header.range_grey]))?;
    file.table("element_size_px", 1, &Values::F64(vec![header.element_size_px]))?;
    file.texts("zone_name", mesh.zones())?;
    file.table("node_position_px", 2, &Values::F64(mesh.nodes().as_flattened().to_vec()))?;
    file.table("node_zone", 1, &counted(mesh.node_zone()))?;
    file.table("element_nodes", 4, &counted(mesh.elements().as_flattened()))?;
    file.table("element_zone", 1, &counted(mesh.element_zone()))?;
    file.table("frame", 1, &Values::U32(numbers.iter().map(|&number| number as u32).collect()))?;
    let files: Vec<String> = numbers.iter().map(|&number| header.frames[number - 1].clone()).collect();
    file.texts("frame_file", &files)?;
    let mut codes = Vec::with_capacity(numbers.len());
    let mut references = Vec::new();
    for &number in numbers {
        codes.extend(store.status(number)?.map(|status| status.code()));
        references.extend(store.reference_frame(number)?.map(|frame| frame as u32));
    }
    file.table("status", 1, &Values::U8(codes))?;
    if !references.is_empty() {
        file.table("reference_frame", 1, &Values::U32(references))?;
    }
    for variable in variables_in(store) {
        file.begin(variable.name(), variable.number(), shape(store, variable, numbers, split))?;
        for (done, &number) in numbers.iter().enumerate() {
            let values = store.values(number, variable)?;
            file.block(&values.ok_or_else(|| format!("frame {number} has changed during the export"))?)?;
            ticker.tick(variable.name(), done + 1, numbers.len());
        }
    }
    Ok(())
}
