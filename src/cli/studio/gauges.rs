//! What the gauges of a run read, frame by frame, also while it goes on.

use super::folder::is_inside;
use crate::camera::Rectifier;
use crate::cli::Result;
use crate::field::{FrameQuantities, NodalNoise, Quantities, Value as Read};
use crate::io::case::{CaseQuantities, parse_case};
use crate::io::load::LoadTable;
use crate::io::store::Store;
use crate::run::Record;
use crate::run::look::quantities::{load, resolve};
use serde_json::{Value, json};
use std::path::Path;

/// Frames that are read for one answer: some tenths of a second.
const AT_ONCE: usize = 100;

/// The readings of the frames behind `from`, as far as they are done without a gap; of extensometers and openings.
/// `more` says that there are others already.
pub(super) fn readings(store: &Store, folder: &Path, from: usize) -> Result<Value> {
    let header = store.header();
    let asked = parse_case(&header.case, Path::new("run.toml"))?.drawn();
    let loads = loads(&asked, folder, store.n_frames());
    let CaseQuantities { options, extensometers, openings, .. } = asked;
    let asked = CaseQuantities { options, extensometers, openings, ..CaseQuantities::default() };
    let camera = &Rectifier::new(header.camera()?, store.mesh())?;
    let gauges = resolve(&asked, header.strain, header.pixel_size, camera)?;
    // A length in mm is also as uncertain as the scale.
    let mm = header.pixel_size.map(|size| [size.mm_per_px(), header.pixel_size_std()]);
    let is_bound = Record::of(header).is_regularised();
    let mut noise: Option<NodalNoise> = None;
    let (mut rows, mut last) = (Vec::new(), from);
    while last < store.n_frames() && rows.len() < AT_ONCE {
        let Some(status) = store.status(last + 1)? else { break };
        last += 1;
        let field = if status.has_field() { store.frame(last)?.map(|frame| frame.measurement) } else { None };
        let drawn = field.map(|field| {
            let plane = camera.rectify(&field);
            let along = NodalNoise::along(noise.take(), &*plane, is_bound, Some(camera.raw_mesh()));
            gauges.draw(&plane, noise.insert(along), None)
        });
        let of_load: Vec<Option<f64>> = loads.columns.iter().map(|column| column.at(last)).collect();
        rows.push(json!({ "number": last, "loads": of_load, "values": values(&gauges, drawn.as_ref(), mm) }));
    }
    let more = last < store.n_frames() && store.status(last + 1)?.is_some();
    let names: Vec<&str> = names(&gauges).collect();
    let loads: Vec<&str> = loads.columns.iter().map(|column| column.name.as_str()).collect();
    let unit = if mm.is_some() { "mm" } else { "px" };
    Ok(json!({ "names": names, "loads": loads, "unit": unit, "rows": rows, "last": last, "more": more }))
}

/// The load file of the run; nothing where it lies elsewhere, or cannot be read any more.
fn loads(asked: &CaseQuantities, folder: &Path, n_frames: usize) -> LoadTable {
    let files = asked.load.iter().flat_map(|load| [Some(&load.file), load.frame_times.as_ref()]).flatten();
    let are_inside = files.filter(|file| !file.is_empty()).all(|file| is_inside(folder, Path::new(file)));
    let read = are_inside.then(|| load(asked, n_frames).ok()).flatten();
    read.unwrap_or_default()
}

fn names(gauges: &Quantities) -> impl Iterator<Item = &str> {
    let extensometers = gauges.extensometers.iter().map(|(name, _)| name.as_str());
    extensometers.chain(gauges.openings.iter().map(|(name, _)| name.as_str()))
}

/// Of each gauge its elongation with its standard uncertainty, and the same of its engineering strain where it has one.
fn values(gauges: &Quantities, drawn: Option<&FrameQuantities>, mm: Option<[f64; 2]>) -> Vec<Option<[Option<f64>; 4]>> {
    let Some(drawn) = drawn else { return names(gauges).map(|_| None).collect() };
    let length = |of: Read| {
        let [size, relative_std] = mm.unwrap_or([1.0, 0.0]);
        [of.value, of.sigma.hypot(relative_std * of.value)].map(|px| Some(px * size))
    };
    let of_extensometer = drawn.extensometers.iter().map(|read| {
        let ([elongation, sigma], strain) = read.as_ref().map(|read| (length(read.elongation), read.engineering))?;
        Some([elongation, sigma, Some(strain.value), Some(strain.sigma)])
    });
    let of_opening = drawn.openings.iter().map(|read| {
        let [opening, sigma] = length(read.mean.as_ref()?.opening);
        Some([opening, sigma, None, None])
    });
    of_extensometer.chain(of_opening).collect()
}
