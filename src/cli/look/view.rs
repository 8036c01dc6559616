//! `quadrille view`.

use crate::cli::args::ViewArgs;
use crate::cli::measure::metrology::METROLOGY;
use crate::cli::{Outcome, Result, chain, plural, pool};
use crate::io::store::Store;
use crate::report::Backdrop;
use crate::run::{Explored, FitOfRun, Record, RunFolder, correlation_in, model_less_measured, reference, write_file};
use std::path::{Path, PathBuf};

const PAGE: &str = "view.html";

pub(crate) struct Made {
    pub html: String,
    /// Frames in it, and those with a field.
    n_shown: usize,
    n_with: usize,
    /// Frames that were asked for and have no field.
    n_without: usize,
}

pub(crate) fn run(args: &ViewArgs) -> Result<Outcome> {
    let path = args.output.clone().unwrap_or_else(|| args.run.join(PAGE));
    if args.run.join(METROLOGY).is_file() && Store::open(fields_in(&args.run)).is_err() {
        // One page is all there is to see of it, and was made with it.
        let made = args.run.join(RunFolder::REPORT);
        let html = std::fs::read_to_string(&made).map_err(|error| {
            format!("{}: cannot be read: {error}; `quadrille metrology --output` makes it again", made.display())
        })?;
        write_file(&path, &html)?;
        if !args.talk.quiet {
            eprintln!("{}: what the images can measure: open it in a browser", path.display());
        }
        return Ok(Outcome::Fine);
    }
    let Made { html, n_shown, n_with, n_without } = make_page(args)?;
    write_file(&path, &html)?;
    if !args.talk.quiet {
        let left =
            if n_shown < n_with { format!(" of {n_with}, evenly spaced (--max-mb for more)") } else { String::new() };
        let mb = html.len() as f64 / 1e6;
        eprintln!("{} with {}{left}, {mb:.1} MB: open it in a browser", path.display(), plural(n_shown, "frame"));
    }
    Ok(args.frames.outcome(n_without))
}

/// The folder of the fields of a run: its own, or that of the correlation in it.
fn fields_in(run: &Path) -> PathBuf {
    let inner = correlation_in(run);
    if inner.is_dir() { inner } else { run.to_owned() }
}

pub(crate) fn make_page(args: &ViewArgs) -> Result<Made> {
    let folder = fields_in(&args.run);
    let store = Store::open(&folder)?;
    let (numbers, n_without) = args.frames.with_field(&store, args.talk.quiet)?;
    if numbers.is_empty() {
        let path = store.path().display();
        return Err(format!("{path}: no frame asked for has a field; `quadrille status` says why").into());
    }
    // What is wrong with the files of a fit keeps no field from being looked at.
    let (fit, model) = (FitOfRun::read(&args.run), model_less_measured(&args.run));
    let mut faults: Vec<String> =
        [fit.as_ref().err(), model.as_ref().err()].into_iter().flatten().map(|e| chain(e)).collect();
    let (fit, model) = (fit.ok().flatten(), model.ok().flatten());
    let header = store.header();
    let image = reference(header, Record::of(header).page());
    let backdrop = image.map(|image| Backdrop::new(&image, 1)).unwrap_or_else(|why| {
        faults.push(format!("{why}; the fields are drawn on white."));
        Backdrop::blank(header.image_size_px[0], header.image_size_px[1], 1)
    });
    let explored = Explored {
        folder: &folder,
        store: &store,
        numbers: &numbers,
        reference: &backdrop,
        faults,
        fit: fit.as_ref(),
        model: model.as_ref(),
    };
    let title = format!("Fields of {}", args.run.display());
    let page = pool(args.threads.threads)?.install(|| explored.page(title, args.max_mb))?;
    Ok(Made { html: page.html, n_shown: page.n_shown, n_with: numbers.len(), n_without })
}
