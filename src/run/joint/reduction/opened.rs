//! A run that is reduced: its fields, its loads, and what the case names in them.

use super::loads::{force, wrong};
use crate::camera::Rectifier;
use crate::field::{Facing, Quantities};
use crate::io::case::{CaseFile, CaseOpening, CaseQuantities, CaseReduction, CaseRegion};
use crate::io::load::LoadTable;
use crate::io::store::Store;
use crate::reduction::{Specimen, sections};
use crate::run::folder::record::Record;
use crate::run::folder::run_folder::correlation_in;
use crate::run::look::quantities::{load, resolve};
use crate::run::words::Result;
use crate::units::PixelSize;
use std::path::{Path, PathBuf};

/// A run, opened.
pub(super) struct Opened {
    pub(super) store: Store,
    pub(super) camera: Rectifier,
    pub(super) size: PixelSize,
    /// The sections, in the plane of the specimen.
    pub(super) gauges: Quantities,
    /// The joint.
    pub(super) facing: Facing,
    /// The zones of the upper and the lower arm, by number.
    pub(super) zones: [usize; 2],
    pub(super) loads: LoadTable,
    /// Whether nodes are bound to each other by a regularisation.
    pub(super) is_bound: bool,
    /// Force of each frame, N: the largest is positive.
    forces: Vec<Option<f64>>,
}

impl Opened {
    /// The load of a frame, from 1.
    pub(super) fn load(&self, frame: usize) -> Option<f64> {
        self.forces.get(frame - 1).copied().flatten()
    }
}

/// Opens the run in the folder `run`.
///
/// # Errors
/// A run or loads that cannot be read, no scale, an opening that there is not.
pub(super) fn open(case: &CaseFile, asked: &CaseReduction, specimen: &Specimen, run: &Path) -> Result<Opened> {
    let store = Store::open(store_in(run))?;
    let header = store.header();
    let Some(size) = header.pixel_size else {
        return Err(wrong("the run has no scale: correlate with pixel_size_mm"));
    };
    let quantities = quantities(case, asked, specimen)?;
    let camera = Rectifier::new(header.camera()?, store.mesh())?;
    let mut gauges = resolve(&quantities, header.strain, header.pixel_size, &camera)?;
    let Some(wanted) = &quantities.load else {
        return Err(wrong("there is no table [load]: which file has the loads of the frames?"));
    };
    let loads = load(&quantities, store.n_frames())?;
    let (column, sign) = force(asked, &loads, Path::new(&wanted.file))?;
    let forces = (1..=store.n_frames()).map(|frame| Some(sign * column.at(frame)?)).collect();
    let number = |name: &String| store.mesh().zones().iter().position(|zone| zone == name);
    let zones = quantities.openings.first().map(|opening| opening.zones.each_ref().map(number));
    let Some([Some(upper), Some(lower)]) = zones else {
        return Err(wrong("an [[opening]] between the arms is needed"));
    };
    // Read place by place: what its mean is uncertain by takes longest, and is not asked for.
    let Some((_, facing)) = gauges.openings.pop() else {
        return Err(wrong("an [[opening]] between the arms is needed"));
    };
    let is_bound = Record::of(header).is_regularised();
    Ok(Opened { camera, size, gauges, facing, zones: [upper, lower], loads, is_bound, forces, store })
}

/// The folder of the fields of `run`: of `quadrille correlate`, or of `run`.
fn store_in(run: &Path) -> PathBuf {
    let within = correlation_in(run);
    if within.exists() { within } else { run.to_owned() }
}

/// The sections and the opening that the case names, with its loads.
pub(super) fn quantities(case: &CaseFile, asked: &CaseReduction, specimen: &Specimen) -> Result<CaseQuantities> {
    let drawn = case.drawn();
    let there: Vec<&str> =
        drawn.regions.iter().filter_map(|region| region.name.as_deref().or(region.zone.as_deref())).collect();
    let region = |name: &String| -> Result<CaseRegion> {
        let called = |region: &&CaseRegion| region.name.as_ref().or(region.zone.as_ref()) == Some(name);
        drawn.regions.iter().find(called).cloned().ok_or_else(|| {
            format!("[reduction] sections: there is no [[region]] named \"{name}\"; there are {}", there.join(", "))
                .into()
        })
    };
    let regions = asked.sections.iter().map(region).collect::<Result<Vec<_>>>()?;
    let wanted = sections(specimen.layout, 1.0, 0.5);
    if !regions.is_empty() && regions.len() != wanted.len() {
        let words: Vec<&str> = wanted.iter().map(|section| section.what).collect();
        return Err(format!(
            "[reduction] sections names {} regions; layout = \"{}\" has loads at {}, in this order",
            regions.len(),
            specimen.layout.name(),
            words.join(", ")
        )
        .into());
    }
    let name_of = |opening: &CaseOpening| {
        let [plus, minus] = &opening.zones;
        opening.name.clone().unwrap_or_else(|| format!("{plus}-{minus}"))
    };
    let openings: Vec<CaseOpening> = drawn
        .openings
        .iter()
        .filter(|opening| asked.opening.as_ref().is_none_or(|name| *name == name_of(opening)))
        .cloned()
        .collect();
    if openings.len() != 1 {
        let there: Vec<String> = drawn.openings.iter().map(name_of).collect();
        return Err(format!(
            "[reduction] opening: one [[opening]] between the arms is needed; there are {}: {}",
            there.len(),
            there.join(", ")
        )
        .into());
    }
    Ok(CaseQuantities { load: drawn.load, regions, openings, ..CaseQuantities::default() })
}
