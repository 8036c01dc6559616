//! What the still zones of a series show: the columns of their table, and what is to be said of them.

use crate::camera::StillMotion;
use crate::field::Value;
use crate::remark::{About, Code, Remark};

/// Columns of the table.
pub(super) const STILL: [&str; 13] = [
    "distance_change",
    "sigma_distance_change",
    "centre_x_px",
    "centre_y_px",
    "shift_x_px",
    "sigma_shift_x_px",
    "shift_y_px",
    "sigma_shift_y_px",
    "turn_deg",
    "sigma_turn_deg",
    "strain",
    "sigma_strain",
    "squares",
];
/// Noise and what interpolation adds to it leave less than this of `squares`.
const MORE_THAN_NOISE: f64 = 2.0;
/// Zones are strained, and the distance has changed, where it is this many standard uncertainties: chance among a
/// thousand frames reaches it once in a thousand series.
const BEYOND_CHANCE: f64 = 5.0;

pub(super) fn still_cells(still: Option<StillMotion>) -> [Option<f64>; STILL.len()] {
    let Some(still) = still else { return [None; STILL.len()] };
    let StillMotion { centre, shift: [x, y], turn_rad: turn, strain, squares, .. } = still;
    let distance = still.distance_change();
    let turn = [turn.value, turn.sigma].map(f64::to_degrees);
    let numbers = [distance.value, distance.sigma, centre[0], centre[1], x.value, x.sigma, y.value, y.sigma];
    let [a, b, c, d, e, f, g, h] = numbers;
    [a, b, c, d, e, f, g, h, turn[0], turn[1], strain.value, strain.sigma, squares].map(Some)
}

/// What the still zones of a series show.
pub(super) fn still_remarks(still: &[(usize, Option<StillMotion>)]) -> Vec<Remark> {
    let lost: Vec<usize> = still.iter().filter(|(_, motion)| motion.is_none()).map(|(number, _)| *number).collect();
    let mut remarks = Vec::new();
    if let Some(first) = lost.first() {
        let text = format!(
            "the still zones are measured in too few nodes in {} of {} fields, first in frame {first}: nothing is known there in the \
             plane of the specimen",
            lost.len(),
            still.len()
        );
        remarks.push(Remark::new(Code::StillZones, About::Frames(lost), text));
    }
    let by_sigma = |of: &Value| (of.value / of.sigma).abs();
    let largest = |of: &dyn Fn(&StillMotion) -> Value| {
        let values = still.iter().filter_map(|(number, motion)| Some((*number, of(motion.as_ref()?))));
        let beyond = values.filter(|(_, of)| by_sigma(of) > BEYOND_CHANCE);
        beyond.max_by(|(_, a), (_, b)| a.value.abs().total_cmp(&b.value.abs()))
    };
    if let Some((number, Value { value, sigma })) = largest(&|motion| motion.strain) {
        let text = format!(
            "frame {number}: the still zones are strained by {value:.1e} +- {sigma:.0e}, alike or against each other: they deform, or \
             lie in another plane; what is taken off may be off by as much"
        );
        let remark = Remark::new(Code::StillZones, About::Frames(vec![number]), text);
        remarks.push(remark.with("strain", value).with("sigma", sigma));
    }
    let left = still.iter().filter_map(|(number, motion)| Some((*number, motion.as_ref()?.squares)));
    let worst = left.max_by(|(_, a), (_, b)| a.total_cmp(b)).filter(|(_, squares)| *squares > MORE_THAN_NOISE);
    if let Some((number, squares)) = worst {
        let text = format!(
            "frame {number}: the still zones do not move as one body: what is left of them is {:.1} times their noise; they deform, or \
             move against each other. What is taken off is made as uncertain as that",
            squares.sqrt()
        );
        remarks.push(Remark::new(Code::StillZones, About::Frames(vec![number]), text).with("squares", squares));
    }
    if let Some((number, Value { value, sigma })) = largest(&StillMotion::distance_change) {
        let text = format!(
            "the distance to the specimen changed by up to dZ/Z = {value:.2e} +- {sigma:.0e} (frame {number}), as the still zones show; \
             it is taken off"
        );
        let remark = Remark::new(Code::DistanceChanged, About::Frames(vec![number]), text);
        remarks.push(remark.with("distance_change", value).with("sigma", sigma));
    }
    remarks
}
