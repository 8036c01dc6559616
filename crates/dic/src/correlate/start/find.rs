//! Where a frame starts of which nothing is known: the motions that are tried, and the correlation that decides.

use crate::backend::{Backend, GreyTransfer, PixelSums};
use crate::correlate::{
    Correlation, Correlator, Features, Level, Motion, Result, StartUsed, choose_better, first_motion, motions,
    wide_motions,
};
use crate::field::Status;

/// With this correlation coefficient a zone is found: no other candidates are tried.
const FOUND: f64 = 0.8;
/// and with less than this one it is lost: it is looked for in the whole image.
const LOST: f64 = 0.6;
/// A motion that leaves less than this share of a zone's pixels inside the image counts for little,
pub(crate) const LEAST_INSIDE: f64 = 0.25;
/// for this much at most, so that others are looked for: few pixels match somewhere by chance.
const FEW_INSIDE: f64 = LOST - 0.01;

/// How well a zone matches: its correlation coefficient, if enough of it is inside the image.
pub(crate) fn score(sums: &PixelSums) -> f64 {
    let is_inside = sums.n >= LEAST_INSIDE * sums.n_all;
    if is_inside { sums.correlation() } else { sums.correlation().min(FEW_INSIDE) }
}

#[derive(Debug, Clone)]
struct Tried {
    /// Its correlation coefficient on the coarsest level.
    score: f64,
    motion: Motion,
    transfer: GreyTransfer,
}

impl Default for Tried {
    fn default() -> Self {
        Self { score: f64::NEG_INFINITY, motion: Motion::rest(), transfer: GreyTransfer::NONE }
    }
}

impl<B: Backend> Correlator<B> {
    /// Finds each zone on the coarsest level, near or, if that fails, in the whole image; iterates down the pyramid.
    ///
    /// What does not converge even so is tried once more from there, smoothly and without what does not match.
    /// The zones that are `lost` are not looked for.
    pub(crate) fn search(&self, frame: &mut B::Frame, lost: &[bool]) -> Result<Correlation> {
        let (found, tried) = self.search_once(frame, lost)?;
        let ended_well = !matches!(found.measurement.status, Status::Diverged | Status::IterationLimit);
        if ended_well || !self.may_try_again() {
            return Ok(found);
        }
        Ok(choose_better(found, self.begin_from(frame, &tried, true, lost)?))
    }

    fn search_once(&self, frame: &mut B::Frame, lost: &[bool]) -> Result<(Correlation, Vec<Tried>)> {
        let top = self.levels.len() - 1;
        let mesh = &self.levels[top].mesh;
        let deformed = self.backend.grey_map(frame, top);
        let zones = 0..mesh.zones().len();
        // What is lost counts as found, at rest.
        let begin = |&lost: &bool| Tried { score: if lost { 1.0 } else { f64::NEG_INFINITY }, ..Tried::default() };
        let mut tried: Vec<Tried> = lost.iter().map(begin).collect();
        let of_few = |zone: usize| {
            if lost[zone] {
                return Vec::new();
            }
            let motion = first_motion(&self.search_map, &deformed, mesh.bounds(zone), &self.search_pixels[zone]);
            motion.into_iter().collect::<Vec<_>>()
        };
        let first: Vec<Vec<Motion>> = zones.clone().map(of_few).collect();
        let has_first: Vec<bool> = first.iter().zip(lost).map(|(motions, lost)| *lost || !motions.is_empty()).collect();
        self.try_motions(frame, &mut tried, first)?;
        let of_all = |zone: usize| match has_first[zone] && tried[zone].score > FOUND {
            true => Vec::new(),
            false => motions(&self.search_map, &deformed, mesh.bounds(zone), &self.search_pixels[zone]),
        };
        let candidates = zones.map(of_all).collect();
        self.try_motions(frame, &mut tried, candidates)?;
        let is_missed = |tried: &Tried| tried.score < LOST;
        let widely = tried.iter().any(is_missed);
        if widely {
            let everywhere = self.search_everywhere(frame, |zone| is_missed(&tried[zone]));
            self.try_motions(frame, &mut tried, everywhere)?;
        }
        let found = self.begin_from(frame, &tried, false, lost)?;
        if widely || !matches!(found.measurement.status, Status::Diverged | Status::LeftImage) {
            return Ok((found, tried));
        }
        // What is dark or bright all over its length matches well anywhere along it.
        let left = found.measurement.status == Status::LeftImage;
        let is_wanted = |zone: usize| !lost[zone] && (left || found.zones[zone].correlation < LOST);
        let everywhere = self.search_everywhere(frame, is_wanted);
        if everywhere.iter().all(Vec::is_empty) {
            return Ok((found, tried));
        }
        let first = tried.clone();
        for (tried, _) in tried.iter_mut().zip(&everywhere).filter(|(_, motions)| !motions.is_empty()) {
            *tried = Tried::default();
        }
        self.try_motions(frame, &mut tried, everywhere)?;
        let again = self.begin_from(frame, &tried, false, lost)?;
        let better = match (again.measurement.status, found.measurement.status) {
            (Status::Converged, _) | (Status::LeftImage, Status::Diverged) => true,
            // What is still in the image is measured.
            (Status::Diverged, Status::LeftImage) => false,
            _ => again.worst_zone() > found.worst_zone(),
        };
        Ok(if better { (again, tried) } else { (found, first) })
    }

    /// The points of the reference by which it is looked for in all of an image.
    pub(crate) fn features(&self) -> &Features {
        // As `periods`: nobody may wait for what is made in parallel.
        let made = self.features.get().is_none().then(|| Features::of(&self.image));
        self.features.get_or_init(|| made.unwrap_or_else(|| Features::of(&self.image)))
    }

    /// The motions of the `wanted` zones by points that look alike, wherever in the image; none of the others.
    fn search_everywhere(&self, frame: &B::Frame, wanted: impl Fn(usize) -> bool) -> Vec<Vec<Motion>> {
        let deformed = Features::of(&self.backend.image(frame));
        let of_zone = |zone: usize| match wanted(zone) {
            true => wide_motions(self.features(), &deformed, &self.zone_pixels[zone], self.levels.len() - 1),
            false => Vec::new(),
        };
        (0..self.zone_pixels.len()).map(of_zone).collect()
    }

    /// Tries the motions on the coarsest level, each zone its next one, until all are found; `best` keeps the best.
    fn try_motions(&self, frame: &mut B::Frame, best: &mut [Tried], candidates: Vec<Vec<Motion>>) -> Result<()> {
        let level = &self.levels[self.levels.len() - 1];
        let rounds = candidates.iter().map(Vec::len).max().unwrap_or(0);
        for round in 0..rounds {
            if best.iter().all(|best| best.score > FOUND) {
                break;
            }
            let motion = |(own, best): (&Vec<Motion>, &Tried)| match own.len() {
                0 => best.motion.clone(),
                n => own[round.min(n - 1)].clone(),
            };
            let tried: Vec<Motion> = candidates.iter().zip(best.iter()).map(motion).collect();
            let displacement = self.displacement_under(level, &tried);
            let transfer = vec![GreyTransfer::NONE; best.len()];
            let mut field = self.backend.start(&level.prepared, frame, &displacement, &transfer)?;
            let observed = self.backend.observe(&level.prepared, frame, &mut field)?;
            for ((best, motion), (sums, transfer)) in best.iter_mut().zip(tried).zip(observed) {
                let score = score(&sums);
                if score > best.score {
                    *best = Tried { score, motion, transfer };
                }
            }
        }
        Ok(())
    }

    /// Iterates down the pyramid from the motion of each zone, `smoothly` until it is known what does not match.
    fn begin_from(&self, frame: &mut B::Frame, tried: &[Tried], smoothly: bool, lost: &[bool]) -> Result<Correlation> {
        let transfer = tried.iter().map(|tried| tried.transfer).collect();
        let motions: Vec<Motion> = tried.iter().map(|tried| tried.motion.clone()).collect();
        let displacement = self.displacement_under(&self.levels[self.levels.len() - 1], &motions);
        match smoothly {
            true => self.smooth_pyramid(frame, displacement, transfer, lost),
            false => self.descend_pyramid(frame, displacement, transfer, StartUsed::Cold, lost),
        }
    }

    /// The displacement of a level's nodes under the motions of their zones.
    fn displacement_under(&self, level: &Level<B>, motions: &[Motion]) -> Vec<[f64; 2]> {
        let zones = level.mesh.node_zone();
        level.mesh.nodes().iter().zip(zones).map(|(&x, &zone)| motions[zone as usize].displacement(x)).collect()
    }
}
