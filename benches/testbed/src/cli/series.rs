//! `testbed series`: what a whole series costs, from image files to the store.

use super::args::{FileFormat, SeriesArgs};
use super::{Outcome, Result, devices, plural, pool};
use quadrille::backend::choice::DeviceChoice;
use quadrille::backend::gpu::GpuOptions;
use quadrille::correlate::{History, Overlap, prepare};
use quadrille::field::Status;
use quadrille::io::case::{CaseFile, CaseZone};
use quadrille::io::images::{read_image, write_image};
use quadrille::mesh::{Roi, Zone};
use quadrille::run::{Existing, Export, Plan, Ran, Request, RunFolder, Session, run_series};
use quadrille::synth::{Accuracy, RenderOptions, Series, Texture};
use quadrille_base::clock::{Elapsed, Stopwatch};
use quadrille_testbed::bench::Spread;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Standard deviation of the noise, grey levels: a camera of 8 bit in good light.
const NOISE: f32 = 1.0;

/// What `--device` takes here alone: see [`quadrille::backend::InstantBackend`].
const INSTANT: &str = "instant";

/// Cores of the workstation whose rate is projected.
const PROJECTED_CORES: usize = 16;

/// What one series has cost.
#[derive(Debug, Serialize)]
struct Cost {
    size_px: usize,
    format: &'static str,
    frames: usize,
    n_nodes: usize,
    device: String,
    /// Of the median run.
    frames_per_second: f64,
    /// Seconds per frame without the preparation of the reference: what a long series comes to.
    frame_s: Spread,
    /// Processor seconds per frame of all threads, the preparation of the reference taken off.
    frame_processor_s: Spread,
    /// Seconds between the field before a frame and its own, which no other frame can use, on all threads with nothing
    /// beside it: the median of the frames that were predicted.
    frame_in_turn_s: Spread,
    /// Each alone, on all threads; correlation with the images in memory.
    decode_alone_s: Spread,
    correlate_alone_s: Spread,
    /// Rate of the series over `1/(1/decode + 1/correlate)`, of the medians.
    share_of_bound: f64,
    iterations_mean: f64,
    seconds_reference: f64,
    /// How busy the threads of each stage were, percent of the time of the last run; these go on at the same time.
    stage_percent: Vec<(&'static str, f64)>,
    limited_by: &'static str,
}

/// What was measured, and on what.
#[derive(Debug, Serialize)]
struct Measured {
    quadrille: &'static str,
    machine: String,
    threads: usize,
    element_size_px: usize,
    noise_grey: f32,
    /// Elements left out at each side of the image.
    margin_elements: u8,
    runs: usize,
    series: Vec<Cost>,
}

/// Runs the command.
pub(super) fn run(args: &SeriesArgs) -> Result<Outcome> {
    devices::check_element_size(args.element_size)?;
    if args.frames < 3 {
        return Err(format!("--frames {} is not a series: give 3 or more", args.frames).into());
    }
    let sizes = &args.size;
    sizes
        .iter()
        .try_for_each(|&size| devices::check_size(size, args.element_size, 2 * usize::from(args.margin) + 2))?;
    let threads = args.threads.pool()?.current_num_threads();
    let folder = match &args.folder {
        Some(folder) => tempfile::tempdir_in(folder).map_err(|error| format!("{}: {error}", folder.display()))?,
        None => tempfile::tempdir()?,
    };
    let mut measured = Measured {
        quadrille: env!("CARGO_PKG_VERSION"),
        machine: devices::machine(),
        threads,
        element_size_px: args.element_size,
        noise_grey: NOISE,
        margin_elements: args.margin,
        runs: args.runs.max(1),
        series: Vec::new(),
    };
    for &size in sizes {
        for &format in &args.format {
            let bench = Bench { args, size, format, threads, folder: folder.path() };
            let files = bench.make()?;
            measured.series.push(bench.measure(&files)?);
        }
    }
    if args.json {
        println!("{}", serde_json::to_string_pretty(&measured)?);
    } else {
        print!("{measured}");
    }
    Ok(Outcome::Fine)
}

/// All frames correlated, the images in memory.
struct Correlated {
    seconds: f64,
    in_turn_s: f64,
    /// What the preparation of the reference took before it.
    reference: Elapsed,
    device: String,
}

/// One series.
struct Bench<'a> {
    args: &'a SeriesArgs,
    size: usize,
    format: FileFormat,
    threads: usize,
    folder: &'a Path,
}

impl Bench<'_> {
    fn name(&self) -> &'static str {
        match self.format {
            FileFormat::Tiff => "tiff",
            FileFormat::Png => "png",
        }
    }

    fn is_instant(&self) -> bool {
        self.args.device == INSTANT
    }

    fn images(&self) -> PathBuf {
        self.folder.join(format!("{}-{}", self.size, self.name()))
    }

    /// Writes the images, the reference first.
    fn make(&self) -> Result<Vec<PathBuf>> {
        let Self { args, size, .. } = *self;
        eprintln!("{} of {size} x {size} px as {}", plural(args.frames + 1, "image"), self.name());
        let ending = if self.format == FileFormat::Png { "png" } else { "tif" };
        std::fs::create_dir_all(self.images())?;
        let options = RenderOptions { noise: NOISE, ..RenderOptions::new(size, size) };
        let motion = Accuracy::new(size, size);
        let series = Series { texture: Texture::new(1, 4.5)?, motion, n_frames: args.frames, options };
        let file = |frame: usize| self.images().join(format!("{frame:06}.{ending}"));
        (0..=args.frames)
            .map(|frame| {
                let path = file(frame);
                match frame.checked_sub(1).filter(|&before| self.is_instant() && before > 1) {
                    // What ends as the frame before it shows what that shows.
                    Some(before) => drop(std::fs::copy(file(before), &path)?),
                    None => write_image(&path, &series.image(frame)?)?,
                }
                Ok(path)
            })
            .collect()
    }

    fn roi(&self) -> Roi {
        let margin = f64::from(self.args.margin) * self.args.element_size as f64;
        let far = self.size as f64 - margin;
        Roi { x0: margin, y0: margin, x1: far, y1: far }
    }

    fn measure(&self, files: &[PathBuf]) -> Result<Cost> {
        let size = self.size;
        self.decode(files)?; // they are in the page cache from here on
        let n = (files.len() - 1) as f64;
        let (mut decode, mut correlate, mut in_turn) = (Vec::new(), Vec::new(), Vec::new());
        let (mut series, mut processor) = (Vec::new(), Vec::new());
        // By turns: what slows the machine down for a while slows all of them down.
        let (device, Ran { summary, busy, .. }, run) = loop {
            let run = series.len();
            let plan = self.plan(files)?;
            decode.push(self.decode(files)? / n);
            let Correlated { seconds, in_turn_s, reference, device } = self.correlate(files, &plan)?;
            correlate.push(seconds / n);
            in_turn.push(in_turn_s);
            let (ran, run) = self.run(&plan, run)?;
            series.push((run.wall_s - ran.summary.seconds_reference) / n);
            processor.push((run.cpu_s - reference.cpu_s) / n);
            if series.len() >= self.args.runs.max(1) {
                break (device, ran, run);
            }
        };
        let frames = &summary.frames;
        if let Some(frame) = frames.iter().find(|frame| frame.status != Status::Converged) {
            return Err(format!(
                "frame {} of {size} x {size} px did not converge: choose other elements",
                frame.number
            ))?;
        }
        let [decode, correlate, in_turn] = [decode, correlate, in_turn].map(Spread::of);
        let [series, processor] = [series, processor].map(Spread::of);
        Ok(Cost {
            size_px: size,
            format: self.name(),
            frames: frames.len(),
            n_nodes: summary.n_nodes,
            device,
            frames_per_second: 1.0 / series.median,
            frame_s: series,
            frame_processor_s: processor,
            frame_in_turn_s: in_turn,
            decode_alone_s: decode,
            correlate_alone_s: correlate,
            share_of_bound: (decode.median + correlate.median) / series.median,
            iterations_mean: frames.iter().map(|frame| frame.iterations as f64).sum::<f64>() / n,
            seconds_reference: summary.seconds_reference,
            stage_percent: busy.percent_of(run.wall_s).to_vec(),
            limited_by: busy.limiting(),
        })
    }

    /// Seconds to read all frames on all threads.
    fn decode(&self, files: &[PathBuf]) -> Result<f64> {
        let watch = Stopwatch::start();
        let read = |first: usize| {
            files[1..].iter().skip(first).step_by(self.threads).try_for_each(|file| read_image(file, 0).map(drop))
        };
        std::thread::scope(|scope| -> Result<()> {
            let threads: Vec<_> = (0..self.threads).map(|first| scope.spawn(move || read(first))).collect();
            threads.into_iter().try_for_each(|thread| Ok(thread.join().map_err(|_| "a decoder stopped")??))
        })?;
        Ok(watch.elapsed().wall_s)
    }

    /// Each run has its own: where many files have just been removed, some file systems are slow to make new ones.
    fn results(&self, run: usize) -> PathBuf {
        self.images().join(format!("results{run}"))
    }

    /// What `quadrille correlate` does with these files.
    fn plan(&self, files: &[PathBuf]) -> Result<Plan> {
        let Roi { x0, y0, x1, y1 } = self.roi();
        let mut case = CaseFile::default();
        case.images.deformed = Some(files.iter().map(|file| file.display().to_string()).collect());
        case.zones = vec![CaseZone { roi: Some([x0, y0, x1, y1]), ..CaseZone::default() }];
        case.correlation.element_size_px = Some(u32::try_from(self.args.element_size).unwrap_or(u32::MAX));
        let asked = Request {
            export: Some(vec![Export::None]),
            device: if self.is_instant() { DeviceChoice::Cpu } else { self.args.device.parse()? },
            gpu: GpuOptions { instant: self.is_instant(), ..GpuOptions::default() },
            ..Request::default()
        };
        Ok(Plan::of(&asked, &case)?)
    }

    /// Correlates all frames on all threads, each in memory when its turn comes.
    fn correlate(&self, files: &[PathBuf], plan: &Plan) -> Result<Correlated> {
        let image = |file: &PathBuf| -> Result<_> { Ok(Arc::new(read_image(file, 0)?.image)) };
        let (reference, zones) = (image(&files[0])?, [Zone::rectangle("all", self.roi())]);
        let pool = pool(Some(self.threads))?;
        pool.install(|| {
            let watch = Stopwatch::start();
            let correlator = prepare(
                &plan.device(reference.width() * reference.height())?,
                reference,
                &zones,
                plan.options.clone(),
            )?;
            let prepared = watch.elapsed();
            let mut history = History::new(correlator.options().start);
            let (mut seconds, mut in_turn) = (0.0, Vec::new());
            for (number, file) in (1..).zip(&files[1..]) {
                let image = image(file)?;
                let watch = Stopwatch::start();
                let frame = correlator.upload(image)?;
                let uploaded = watch.elapsed().wall_s;
                let start = history.predict(number, correlator.mesh());
                let mut tell = |_| in_turn.push(watch.elapsed().wall_s - uploaded);
                let overlap = &mut Overlap::new(&pool, &mut tell);
                let correlation = correlator.correlate_in_series(frame, start.as_ref(), overlap)?;
                history.note(number, &correlation);
                seconds += watch.elapsed().wall_s;
            }
            let device = correlator.device().to_owned();
            Ok(Correlated { seconds, in_turn_s: Spread::of(in_turn).median, reference: prepared, device })
        })
    }

    /// Runs the plan, and what it took.
    fn run(&self, plan: &Plan, run: usize) -> Result<(Ran, Elapsed)> {
        let watch = Stopwatch::start();
        let folder = RunFolder::writable(&self.results(run))?;
        let ran = run_series(plan, &folder, &pool(Some(self.threads))?, Session::new(Existing::Replace), &mut |_| ())?;
        Ok((ran, watch.elapsed()))
    }
}

/// Frames per second: those of the median, the slowest and the fastest run.
fn rates(seconds: Spread) -> String {
    format!("{:8.1} ({:.1}-{:.1})", 1.0 / seconds.median, 1.0 / seconds.slowest, 1.0 / seconds.fastest)
}

impl std::fmt::Display for Measured {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { quadrille, machine, threads, element_size_px, noise_grey, margin_elements, runs, series } = self;
        writeln!(f, "quadrille {quadrille}, {machine}, {}", plural(*threads, "thread"))?;
        writeln!(
            f,
            "8 bit, noise of {noise_grey} grey level, files in the page cache, elements of {element_size_px} px on the \
             image less {margin_elements} of them at each side; default options, only the store is written; median (slowest-fastest) of {runs}"
        )?;
        for cost in series {
            let Cost { size_px, format, frames, n_nodes, device, .. } = cost;
            writeln!(f, "\n{size_px} x {size_px} px, {format}, {frames} frames, {n_nodes} nodes, {device}")?;
            let once = format!("and once {:.2} s for the reference", cost.seconds_reference);
            writeln!(f, "  frames/s             {}   {once}", rates(cost.frame_s))?;
            writeln!(f, "  decoding alone       {}", rates(cost.decode_alone_s))?;
            let iterations = format!("{:.1} iterations", cost.iterations_mean);
            writeln!(f, "  correlation alone    {}   {iterations}", rates(cost.correlate_alone_s))?;
            writeln!(f, "  of 1/(1/d + 1/c)     {:8.0} %", 100.0 * cost.share_of_bound)?;
            let Spread { median, fastest, slowest } = cost.frame_processor_s.scaled(1e3);
            let most = PROJECTED_CORES as f64 / cost.frame_processor_s.median;
            writeln!(
                f,
                "  processor, ms/frame  {median:8.1} ({fastest:.1}-{slowest:.1})   all threads together: {PROJECTED_CORES} cores like these \
                 do {most:.0} frames/s at most"
            )?;
            let Spread { median, fastest, slowest } = cost.frame_in_turn_s.scaled(1e3);
            let most = 1.0 / cost.frame_in_turn_s.median;
            writeln!(
                f,
                "  in turn, ms/frame    {median:8.2} ({fastest:.2}-{slowest:.2})   from the field before a frame to its own, nothing beside it: \
                 {most:.0} frames/s at most"
            )?;
            let stages: Vec<String> =
                cost.stage_percent.iter().map(|(stage, percent)| format!("{stage} {percent:.0} %")).collect();
            writeln!(f, "  busy                 {}; limited by: {}", stages.join(", "), cost.limited_by)?;
        }
        Ok(())
    }
}
