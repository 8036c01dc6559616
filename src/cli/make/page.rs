//! `quadrille make page`.

use crate::cli::args::PageArgs;
use crate::cli::{Outcome, Result};
use crate::io::case::CaseDocument;
use crate::io::images::Accepted;
use crate::io::series::{Frame, expand_series};
use crate::report::Backdrop;
use crate::report::view::Drawing;
use crate::run::{read_text, write_file};
use serde_json::Value;
use std::path::Path;

/// Pixels of the picture for one of a figure: zones are drawn to the pixel.
const RATIO: u32 = 2;

/// A case file as its tables, for a page that draws them.
pub(crate) fn read_drawn(path: &Path) -> Result<Value> {
    Ok(CaseDocument::tables(&read_text(path)?, path)?)
}

/// The folder of a case file that does not lie in this one.
fn apart(path: &Path) -> Option<String> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty())?.canonicalize().ok()?;
    let is_here = std::env::current_dir().and_then(|here| here.canonicalize()).is_ok_and(|here| here == folder);
    (!is_here).then(|| folder.display().to_string())
}

pub(crate) fn run(args: &PageArgs) -> Result<Outcome> {
    let (first, others) = args.images.split_first().ok_or("no image is named")?;
    let files = expand_series(std::slice::from_ref(first), Path::new(""))?;
    let file = files.first().ok_or_else(|| format!("{first}: there is no such image"))?;
    let shown = Frame::file(file.clone(), args.page);
    let image = shown.read(Accepted::ANY)?.image;
    let of_glob = others.is_empty() && files.len() > 1;
    let drawing = Drawing {
        backdrop: &Backdrop::new(&image, RATIO),
        shown: file.display().to_string(),
        reference: (!of_glob).then(|| first.clone()),
        page: args.page,
        deformed: if of_glob { vec![first.clone()] } else { others.to_vec() },
        case: args.case.as_deref().map(read_drawn).transpose()?,
        case_folder: args.case.as_deref().and_then(apart),
        folder: std::env::current_dir().map_or_else(|_| "this folder".into(), |folder| folder.display().to_string()),
    };
    let path = &args.output;
    write_file(path, drawing.html())?;
    if !args.talk.quiet {
        eprintln!("{}: open it in a browser, draw, and save its case file in this folder", path.display());
    }
    Ok(Outcome::Fine)
}
