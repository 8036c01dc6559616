//! Cracks that a plan wants found, and drawn ones that are moved onto the crack beside them: in the images of the test,
//! before the series begins, and kept in `run.toml`.

use crate::correlate::{CrackSearch, FoundCrack, MovedPath, move_onto_crack, prepare, search_cracks};
use crate::imaging::Image;
use crate::io::case::{CaseCrack, CrackPath, parse_case};
use crate::io::store::Store;
use crate::mesh::{Crack, MeshError, Zone};
use crate::run::frames::about_reference;
use crate::run::look::frame::look_at;
use crate::run::plan::Plan;
use crate::run::words::{Result, chain, ranges};
use std::path::Path;
use std::sync::Arc;

/// The frames that are looked at, as shares of the series: the next one when none is found.
const FRAMES: [f64; 4] = [1.0, 0.75, 0.5, 0.25];
/// Groups of elements that are no crack are named up to this many.
const NAMED: usize = 3;

/// What the search came to, in words.
#[derive(Debug, Default)]
pub(crate) struct Searched {
    /// A line for each crack that was found now.
    pub found: Vec<String>,
    /// What else there is to be said: why none was.
    pub notes: Vec<String>,
}

/// Cuts `zones` along the cracks of `plan`, those included that it wants found: they are put into their place there. A
/// run that goes on has those of `there`.
pub(crate) fn cut(
    plan: &mut Plan,
    there: Option<&Store>,
    reference: &Arc<Image>,
    zones: &mut [Zone],
) -> Result<Searched> {
    let searched = find(plan, there, reference, zones)?;
    crate::run::plan::zones::cut(zones, &plan.drawn.cracks)?;
    Ok(searched)
}

/// Moves the cracks of `plan` that were drawn beside one onto it. A run that goes on has those of `there`.
pub(crate) fn move_drawn(
    plan: &mut Plan,
    there: Option<&Store>,
    reference: &Arc<Image>,
    zones: &[Zone],
) -> Result<Vec<String>> {
    let case = there.map(|there| parse_case(&there.header().case, Path::new("run.toml")));
    let before = case.and_then(std::result::Result::ok).map(|case| case.cracks);
    let is_drawn = |crack: &CaseCrack| crack.snap != Some(false) && crack.drawn.is_empty();
    let mut to_look: Vec<usize> = Vec::new();
    for (k, crack) in plan.drawn.cracks.iter_mut().enumerate().filter(|(_, crack)| is_drawn(crack)) {
        let CrackPath::Along(path) = &crack.path else { continue };
        match before.as_ref().map(|before| before.get(k).filter(|moved| moved.drawn == *path)) {
            None => to_look.push(k),
            Some(Some(moved)) => (crack.path, crack.drawn) = (moved.path.clone(), moved.drawn.clone()),
            Some(None) => {}
        }
    }
    if to_look.is_empty() || plan.deformed.is_empty() {
        return Ok(Vec::new());
    }
    let device = plan.device(reference.width() * reference.height())?;
    // What refuses the reference is said when the cut mesh is prepared.
    let Ok(correlator) = prepare(&device, Arc::clone(reference), zones, plan.options.clone()) else {
        return Ok(Vec::new());
    };
    let mut said = Vec::new();
    for number in numbers(plan.deformed.len()) {
        let Some((image, field)) = look_at(plan, number, reference, &*correlator) else { continue };
        to_look.retain(|&k| {
            let Some(crack) = plan.drawn.cracks.get_mut(k) else { return false };
            let CrackPath::Along(path) = &crack.path else { return false };
            let Some(MovedPath { path: moved, by_px }) = move_onto_crack(path, &field, [reference, &image]) else {
                return true;
            };
            if by_px == 0.0 {
                return false;
            }
            said.push(format!(
                "{} was drawn up to {by_px:.1} px beside the crack of frame {number} and is moved onto it: --crack '{}' \
                 (snap = false in [[crack]] leaves it as drawn)",
                crack.name.clone().unwrap_or_else(|| format!("crack{}", k + 1)),
                path_of_flag(&moved)
            ));
            crack.drawn = path.clone();
            crack.path = CrackPath::Along(moved);
            false
        });
        if to_look.is_empty() {
            break;
        }
    }
    Ok(said)
}

/// Puts the cracks that are found into the place of those of `plan` that are to be; without any there is nothing to do.
fn find(plan: &mut Plan, there: Option<&Store>, reference: &Arc<Image>, zones: &[Zone]) -> Result<Searched> {
    let Some(wanted) = plan.drawn.cracks.iter().find(|crack| crack.path == CrackPath::Auto).cloned() else {
        return Ok(Searched::default());
    };
    plan.crack_auto = true;
    if let Some(there) = there {
        // Of a run without a search the differences will be told.
        let case = parse_case(&there.header().case, Path::new("run.toml"));
        plan.drawn.cracks = case.map(|case| case.cracks).unwrap_or_default();
        return Ok(Searched::default());
    }
    if let Some(zone) = zones.iter().find(|zone| zone.elements.is_some()) {
        return Err(MeshError::CrackInOwnElements { zone: zone.name.clone() }.to_string().into());
    }
    if plan.deformed.is_empty() {
        return Err("--crack auto looks for the crack in images of the test, which are still to come: draw it with --crack 'x,y x,y ...', \
                    or correlate when the test is over"
            .into());
    }
    plan.drawn.cracks.retain(|crack| crack.path != CrackPath::Auto);
    let mut zones = zones.to_vec();
    crate::run::plan::zones::cut(&mut zones, &plan.drawn.cracks)?;
    let device = plan.device(reference.width() * reference.height())?;
    let (mut notes, mut looked_at, mut last) = (Vec::new(), Vec::new(), CrackSearch::default());
    for number in numbers(plan.deformed.len()) {
        let Some(frame) = plan.deformed.get(number - 1) else { continue };
        let image = match frame.read(plan.accepted.of_size(reference.width(), reference.height())) {
            Ok(loaded) => Arc::new(loaded.image),
            Err(error) => {
                notes.push(format!("no crack is looked for in frame {number}: {}", chain(&error)));
                continue;
            }
        };
        let mut correlate = |zones: &[Zone]| {
            let correlator = prepare(&device, Arc::clone(reference), zones, plan.options.clone())?;
            correlator.correlate_uploaded(correlator.upload(Arc::clone(&image))?, None)
        };
        let guard = wanted.guard_px.unwrap_or(Crack::GUARD);
        let search = search_cracks(reference, &image, &zones, guard, &mut correlate)
            .map_err(|error| about_reference(plan, reference, &error))?;
        if !search.cracks.is_empty() {
            plan.drawn.cracks.extend(name_cracks(&wanted, &search.cracks, plan.drawn.cracks.len()));
            let found = search.cracks.iter().map(|crack| about_found(crack, number)).collect();
            return Ok(Searched { found, notes });
        }
        if looked_at.is_empty() {
            last = search;
        }
        looked_at.push(number);
    }
    notes.push(about_none(&looked_at, &last));
    Ok(Searched { found: Vec::new(), notes })
}

/// The numbers of the frames that are looked at, the last first.
fn numbers(n: usize) -> Vec<usize> {
    let mut numbers: Vec<usize> = FRAMES.iter().map(|share| ((share * n as f64).round() as usize).max(1)).collect();
    numbers.dedup();
    numbers
}

/// The cracks that were found, with what was `wanted` of them beside the path; `before` others there are already.
fn name_cracks(wanted: &CaseCrack, found: &[FoundCrack], before: usize) -> Vec<CaseCrack> {
    let name = |k: usize| match (&wanted.name, k) {
        (Some(name), 0) => Some(name.clone()),
        (Some(name), k) => Some(format!("{name}-{}", k + 1)),
        (None, k) => (before > 0).then(|| format!("found{}", k + 1)),
    };
    let of = |(k, crack): (usize, &FoundCrack)| CaseCrack {
        name: name(k),
        path: CrackPath::Along(crack.path.clone()),
        ..wanted.clone()
    };
    found.iter().enumerate().map(of).collect()
}

fn about_found(crack: &FoundCrack, number: usize) -> String {
    let FoundCrack { path, opening: [least, median, largest], sliding, .. } = crack;
    format!(
        "crack found in frame {number}: --crack '{}' (open by {median:.2} px, {least:.2} to {largest:.2}; sliding {sliding:.2} px)",
        path_of_flag(path)
    )
}

/// A path as `--crack` takes it.
fn path_of_flag(path: &[[f64; 2]]) -> String {
    path.iter().map(|[x, y]| format!("{x},{y}")).collect::<Vec<String>>().join(" ")
}

fn about_none(frames: &[usize], search: &CrackSearch) -> String {
    let frames_in_words = match frames {
        [] => return "no crack found, since no image could be read: the mesh is not cut".into(),
        [one] => format!("frame {one}"),
        several => {
            let mut numbers = several.to_vec();
            numbers.sort_unstable();
            format!("frames {}", ranges(&numbers))
        }
    };
    let why = match (search.rejected.len(), search.marked) {
        (0, 0) => "all elements match".to_owned(),
        (0, n) => format!("the {n} elements that do not match form no line"),
        (n, _) => {
            let mut named: Vec<String> = search.rejected.iter().take(NAMED).map(ToString::to_string).collect();
            named.extend((n > NAMED).then(|| format!("{} more", n - NAMED)));
            named.join("; ")
        }
    };
    let first = frames.first().map_or(0, |number| *number);
    format!("no crack found in {frames_in_words}: the mesh is not cut (frame {first}: {why})")
}
