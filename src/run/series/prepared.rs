//! What of the reference is measured: zones that are named or found, parted by motion and cut along cracks, on a device.

use crate::imaging::Image;
use crate::io::store::Store;
use crate::remark::Remark;
use crate::run::frames::{Engine, about_reference};
use crate::run::look::{apart, crack_auto};
use crate::run::plan::found::Found;
use crate::run::plan::{Plan, Zones};
use crate::run::words::{Result, remarks};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// A reference that is prepared.
pub(super) struct Prepared {
    pub reference: Arc<Image>,
    pub engine: Engine,
    /// Zones that were looked for, since none was named.
    pub found: Option<Found>,
    /// Masks and mesh files with their SHA-256.
    pub zone_files: Vec<(PathBuf, String)>,
    /// What is to be said of zones and cracks.
    pub remarks: Vec<Remark>,
    /// What is said below the picture of the mesh, where zones or cracks were found.
    pub drawn: Vec<String>,
    pub seconds: f64,
}

impl Prepared {
    /// Prepares `image`, the reference of `plan`, which gets the zones and cracks that are found. A run that goes on has
    /// those of `there`, its store; masks will lie in `folder`.
    pub fn new(plan: &mut Plan, (there, folder): (Option<&Store>, &Path), image: Image) -> Result<Self> {
        let Zones { mut zones, mut remarks, files: mut zone_files, mut found } = Zones::of(plan, &image, folder)?;
        let reference = Arc::new(image);
        let moved = crack_auto::move_drawn(plan, there, &reference, &zones)?;
        let cracks = crack_auto::cut(plan, there, &reference, &mut zones)?;
        let begin = Instant::now();
        let device = plan.device(reference.width() * reference.height())?;
        let prepare = |zones, plan: &Plan| {
            Engine::new(device.clone(), Arc::clone(&reference), zones, plan.options.clone())
                .map_err(|error| about_reference(plan, &reference, &error))
        };
        let mut engine = prepare(zones, plan)?;
        if let Some(before) = &found
            && let Some(parted) = apart::part(plan, (there, folder), before, &reference, &*engine.correlator())?
        {
            (zone_files, remarks) = (parted.files(), vec![remarks::zones_found(parted.note.clone())]);
            plan.zones.clone_from(&parted.cases);
            engine = prepare(parted.zones.clone(), plan)?;
            found = Some(parted);
        }
        let of_cracks = moved.iter().chain(&cracks.found).chain(&cracks.notes).cloned();
        remarks.extend(of_cracks.map(remarks::of_crack_search));
        let note = found.as_ref().map(|found| found.note.clone());
        let drawn = note.into_iter().chain(moved).chain(cracks.found).collect();
        let seconds = begin.elapsed().as_secs_f64();
        Ok(Self { reference, engine, found, zone_files, remarks, drawn, seconds })
    }
}
