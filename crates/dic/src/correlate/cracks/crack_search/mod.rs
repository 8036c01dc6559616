//! Cracks found from the residual (docs/correlation.md, section 2.12): lines of misfit whose two sides part.
//!
//! A frame is correlated without a cut. Where its marked elements form a line, each side is followed up to it by its
//! own motion: the path is where the pixels change sides. With the mesh cut along it, it is a crack when it opens.

mod lines;
mod sides;

use crate::correlate::{Correlation, Result, is_mismatch};
use crate::field::{CrackLine, Jump, Measurement, ModelError, NodalNoise};
use crate::imaging::Image;
use crate::mesh::{Crack, FacePoint, Mesh, Zone, point_along, project};
use crate::plane::distance;
use crate::units::Px;
use lines::{Group, groups, middle};
use sides::{Between, Sides, place_beside, sides};
use std::fmt;

/// A place is open by so many of its standard uncertainties.
const OPEN_BY: f64 = 5.0;
/// Share of the places measured between the ends that have to be open, and of all places that have to be measured.
const OPEN_SHARE: f64 = 0.7;
const MEASURED_SHARE: f64 = 0.5;
/// What only slides opens by less than this share of its sliding: a path is no straighter than that.
const SLIDES: f64 = 0.3;
/// Share of the pieces of a path of an element's length whose sides have to be followed.
const FOLLOWED: f64 = 0.6;
/// Beyond its ends a path goes on by so many elements, or this share of its length: an opening that is too small to be
/// seen in the residual is cut as well.
const FURTHER: f64 = 4.0;
const FURTHER_SHARE: f64 = 0.2;
/// An end this near to the border of its zone goes on to it, in elements, as one whose tip is to be expected beyond;
/// any other stays twice as far from it.
const TO_BORDER: f64 = 2.0;
/// Where so much is marked that it forms no line, elements that do not follow by this much may, px.
const WORST_PX: f64 = 0.5;
/// and are not so many elements from a line that has been found.
const BESIDE: f64 = 2.0;
/// Lines that are looked at in one frame.
const MOST: usize = 8;
/// A path is moved where so many pixels across it follow the wrong side: fewer are within the guard of the crack.
const WRONG_SIDE_PX: f64 = 0.5;
/// Points of a path leave out what lies this near to the line between others, px.
const STRAIGHT_PX: f64 = 0.75;

/// A crack that was found.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundCrack {
    /// Number of the zone that it is in.
    pub zone: usize,
    /// Points along it in order, px of the reference; to the right, or downwards where it is steep.
    pub path: Vec<[f64; 2]>,
    /// Least, median and largest opening of the places between the ends that were seen to part, px.
    pub opening: [f64; 3],
    /// Median of the sliding there, px.
    pub sliding: f64,
}

/// Why a line of elements that do not match is no crack.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum NoCrack {
    /// It is none: as wide as a block, a hole or a shadow. Length and width, px.
    NotALine([f64; 2]),
    /// Too little is measured on one side of it.
    NotMeasured,
    /// The pixels in it do not follow two sides that move differently: something covers them, or the light has changed.
    OneSide,
    /// Its sides slide along each other by this much, px, and do not open.
    Slides(f64),
    /// Its sides come closer by this much, px.
    Closes(f64),
    /// With the mesh cut it opens in this share of its places only.
    Open(f64),
}

impl fmt::Display for NoCrack {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotALine([length, width]) => write!(f, "no line ({length:.0} px long, {width:.0} px wide)"),
            Self::NotMeasured => write!(f, "too little is measured on one side of it"),
            Self::OneSide => write!(f, "covered or in another light: its pixels follow neither of its sides"),
            Self::Slides(px) => write!(f, "its sides slide by {px:.2} px and do not open (--crack 'path' cuts there)"),
            Self::Closes(px) => write!(f, "its sides come closer by {px:.2} px"),
            Self::Open(share) => write!(f, "with the mesh cut it opens in {:.0} % of its places only", 100.0 * share),
        }
    }
}

/// Elements that do not match and are no crack.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rejected {
    /// How many.
    pub elements: usize,
    /// Their middle, px of the reference.
    pub at: [f64; 2],
    /// Why.
    pub why: NoCrack,
}

impl fmt::Display for Rejected {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { elements, at: [x, y], why } = self;
        write!(f, "{elements} elements around ({x:.0}, {y:.0}) px: {why}")
    }
}

/// What the search came to.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CrackSearch {
    /// Cracks, the longest first.
    pub cracks: Vec<FoundCrack>,
    /// Elements that do not match and are no crack, the longest group first.
    pub rejected: Vec<Rejected>,
    /// Elements with a mark.
    pub marked: usize,
}

/// Looks for cracks in one deformed image. `correlate` correlates it on other zones: once on `zones`, which are not
/// cut, and once more when a line was found. Pixels nearer to a path than `guard` px are left out of the second.
///
/// # Errors
/// Those of `correlate`.
pub fn search_cracks(
    reference: &Image,
    deformed: &Image,
    zones: &[Zone],
    guard: f64,
    correlate: &mut dyn FnMut(&[Zone]) -> Result<Correlation>,
) -> Result<CrackSearch> {
    let uncut = correlate(zones)?.measurement;
    let mut search = CrackSearch::default();
    let (Some(marks), true) = (&uncut.marks, uncut.status.has_field()) else { return Ok(search) };
    let bad: Vec<bool> = marks.iter().map(|&mark| is_mismatch(mark)).collect();
    search.marked = bad.iter().filter(|&&bad| bad).count();
    let mut found: Vec<(Group, Between)> = Vec::new();
    let try_groups = |search: &mut CrackSearch, found: &mut Vec<(Group, Between)>, groups: Vec<Group>| {
        for group in groups.into_iter().take(MOST) {
            match group.line.as_ref().map(|line| sides(line, &uncut, [reference, deformed])) {
                None => search.reject(&group, NoCrack::NotALine([group.length_px, group.width_px])),
                Some(Sides::Two(between)) if between.share >= FOLLOWED => found.push((group, between)),
                Some(Sides::Two(_) | Sides::One) => search.reject(&group, NoCrack::OneSide),
                Some(Sides::NotMeasured) => search.reject(&group, NoCrack::NotMeasured),
            }
        }
    };
    try_groups(&mut search, &mut found, groups(&uncut.mesh, &bad));
    // Where much is marked, what is worst may stand out; not beside what has been found.
    let size = uncut.mesh.element_size();
    let is_found = |at: [f64; 2]| {
        let beside = |between: &Between| project(&between.path, at).is_some_and(|place| place.distance < BESIDE * size);
        found.iter().any(|(_, between)| beside(between))
    };
    let mut worst = find_worst(&uncut, &bad);
    worst.iter_mut().enumerate().for_each(|(element, worst)| *worst &= !is_found(middle(&uncut.mesh, element)));
    if search.rejected.iter().any(|rejected| matches!(rejected.why, NoCrack::NotALine(_))) && worst != bad {
        try_groups(&mut search, &mut found, groups(&uncut.mesh, &worst));
    }
    if found.is_empty() {
        return Ok(search);
    }
    let paths: Vec<Vec<[f64; 2]>> =
        found.iter().map(|(group, between)| extend_to_ends(&uncut.mesh, group, between)).collect();
    let mut cut_zones = zones.to_vec();
    for ((group, _), path) in found.iter().zip(&paths) {
        cut_zones[group.zone].cracks.push(Crack { path: path.clone(), guard });
    }
    let cut = correlate(&cut_zones)?.measurement;
    for ((group, between), path) in found.into_iter().zip(paths) {
        match measure_opening(&cut, &path, &between) {
            Ok((opening, sliding)) => search.cracks.push(FoundCrack { zone: group.zone, path, opening, sliding }),
            Err(why) => search.reject(&group, why),
        }
    }
    Ok(search)
}

/// A path that was drawn, on the crack of a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct MovedPath {
    /// Points along it in order, px of the reference.
    pub path: Vec<[f64; 2]>,
    /// The largest move of a point, px; 0 where it was drawn on the crack.
    pub by_px: f64,
}

/// Moves `path`, drawn by hand, onto the crack of a frame whose mesh is `uncut` there: where the pixels change from the
/// motion of one side to that of the other. `None` where no crack is seen.
///
/// What lies between a crack and a path beside it is measured with the wrong side, and openings with it.
pub fn move_onto_crack(path: &[[f64; 2]], uncut: &Measurement<Px>, images: [&Image; 2]) -> Option<MovedPath> {
    // Nodes between it and the crack would count to the wrong side: from further off it is looked for beside itself.
    let size = uncut.mesh.element_size();
    let (steps, between) = [0.0, 0.5, -0.5, 1.0, -1.0].into_iter().find_map(|steps| {
        match sides(&move_across(path, steps * size), uncut, images) {
            Sides::Two(between) if between.share >= FOLLOWED => Some((steps, between)),
            _ => None,
        }
    })?;
    if steps == 0.0 && between.beside < WRONG_SIDE_PX {
        return Some(MovedPath { path: path.to_vec(), by_px: 0.0 });
    }
    let followed = smooth(&between.path);
    let places: Vec<[f64; 2]> = followed.iter().filter_map(|&at| place_beside(path, at)).collect();
    let by_px = places.iter().map(|[_, across]| across.abs()).fold(0.0, f64::max);
    // Its ends lie where they were drawn, as far across as the crack is beside the nearest place that is followed.
    let end = |at: [f64; 2], place: Option<&[f64; 2]>| {
        let (&[along, across], [from, _]) = (place?, place_beside(path, at)?);
        let (_, [tx, ty]) = point_along(path, from)?;
        ((along - from).abs() > 1.0).then(|| [at[0] + across * ty, at[1] - across * tx])
    };
    let [first, last] = [end(*path.first()?, places.first()), end(*path.last()?, places.last())];
    let points: Vec<[f64; 2]> = first.into_iter().chain(followed).chain(last).collect();
    let path = straighten(&points).into_iter().map(|p| p.map(|v| (10.0 * v).round() / 10.0)).collect();
    Some(MovedPath { path, by_px })
}

/// The points of a path moved by `px` to the left of the way from its first to its last.
fn move_across(path: &[[f64; 2]], px: f64) -> Vec<[f64; 2]> {
    let [Some(first), Some(last)] = [path.first(), path.last()] else { return Vec::new() };
    let length = distance(*first, *last).max(f64::MIN_POSITIVE);
    let across = [(last[1] - first[1]) / length, (first[0] - last[0]) / length];
    path.iter().map(|at| [0, 1].map(|c| at[c] + px * across[c])).collect()
}

impl CrackSearch {
    fn reject(&mut self, group: &Group, why: NoCrack) {
        self.rejected.push(Rejected { elements: group.n_elements, at: group.middle, why });
    }
}

/// Of the elements that are bad those that are left out, or do not follow by as much as they would then.
fn find_worst(uncut: &Measurement<Px>, bad: &[bool]) -> Vec<bool> {
    let not_followed = uncut.model_error.as_ref().map_or(&[][..], |error| &error.misfit);
    let marks = uncut.marks.as_deref().unwrap_or_default();
    let is_left_out = |element: usize| marks[element].is_left_out();
    let is_worst = |element: usize| is_left_out(element) || not_followed.get(element).is_some_and(|px| *px > WORST_PX);
    (0..bad.len()).map(|element| bad[element] && is_worst(element)).collect()
}

/// How far beyond the first of the places of a path, an element apart, its tip is to be expected, in elements, where
/// the sides are this far `apart`: the faces of a crack close as the root of the distance from its tip.
fn tip_beyond(apart: &[Option<f64>]) -> f64 {
    let known: Vec<(usize, f64)> =
        apart.iter().enumerate().filter_map(|(place, apart)| Some((place, (*apart)?))).collect();
    let Some(&widest) = known.iter().rev().max_by(|(_, a), (_, b)| a.total_cmp(b)).filter(|(_, apart)| *apart > 0.0)
    else {
        return 0.0;
    };
    // One place says nothing of how they close.
    let [first, _, ..] = known[..] else { return 0.0 };
    if first.0 == widest.0 {
        return f64::INFINITY;
    }
    let share = (first.1 / widest.1).powi(2);
    (widest.0 - first.0) as f64 * share / (1.0 - share) - first.0 as f64
}

/// The path with both of its ends carried on, to the border of the zone or beyond the tip.
fn extend_to_ends(mesh: &Mesh<Px>, group: &Group, between: &Between) -> Vec<[f64; 2]> {
    let size = mesh.element_size();
    let (mut path, mut apart) = (smooth(&between.path), between.apart.clone());
    for _ in 0..2 {
        let n = path.len();
        let (end, before) = (path[n - 1], path[n.saturating_sub(5)]);
        let step = distance(end, before);
        if step > 0.0 {
            let ahead = [0, 1].map(|c| (end[c] - before[c]) / step);
            let at = |px: f64| [0, 1].map(|c| end[c] + px * ahead[c]);
            let inside = |px: &f64| mesh.locate(group.zone, at(*px)[0], at(*px)[1]).is_some();
            let wanted = (FURTHER * size).max(FURTHER_SHARE * group.length_px);
            let steps = || (1..).map(|k| 0.25 * size * f64::from(k));
            let to_border = steps().take_while(|px| *px < wanted + 2.0 * TO_BORDER * size).find(|px| !inside(px));
            // Where it is still wide open it does not end before the border.
            apart.reverse();
            let on_to_border = size * tip_beyond(&apart).max(TO_BORDER);
            path.push(match to_border {
                Some(px) if px <= on_to_border => at(px + size),
                Some(px) => at((px - 2.0 * TO_BORDER * size).clamp(0.5 * size, wanted)),
                None => at(wanted),
            });
        }
        path.reverse();
    }
    straighten(&path).into_iter().map(|p| p.map(|v| (10.0 * v).round() / 10.0)).collect()
}

/// The points of a path moved to the mean of their neighbours by a half, but for its ends.
fn smooth(path: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut smooth = path.to_vec();
    for k in 1..path.len().saturating_sub(1) {
        smooth[k] = [0, 1].map(|c| 0.25 * path[k - 1][c] + 0.5 * path[k][c] + 0.25 * path[k + 1][c]);
    }
    smooth
}

/// The path without the points that lie on the line between others (Ramer, Douglas and Peucker).
fn straighten(path: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let [first, .., last] = path else { return path.to_vec() };
    let off = |k: usize| project(&[*first, *last], path[k]).map_or(0.0, |found| found.distance);
    let furthest = (1..path.len() - 1).max_by(|&a, &b| off(a).total_cmp(&off(b)));
    match furthest.filter(|&k| off(k) > STRAIGHT_PX) {
        Some(k) => {
            let mut begin = straighten(&path[..=k]);
            begin.pop();
            begin.extend(straighten(&path[k..]));
            begin
        }
        None => vec![*first, *last],
    }
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Opening (least, median, largest) and sliding of a path in a field whose mesh is cut along it, when it opens.
fn measure_opening(cut: &Measurement<Px>, path: &[[f64; 2]], between: &Between) -> Result<([f64; 3], f64), NoCrack> {
    let line = if cut.status.has_field() { CrackLine::on(&cut.mesh, path.to_vec(), None) } else { None };
    let Some(line) = line else { return Err(NoCrack::NotMeasured) };
    let values = line.read(cut, &NodalNoise::new(&cut.mesh, &cut.measured).of_coefficients());
    let along = |at: [f64; 2]| project(path, at).map_or(0.0, |found| found.along);
    let ends = [between.path[0], between.path[between.path.len() - 1]].map(along);
    let seen = || {
        let places = line.points().iter().zip(&values.points);
        places.filter(|(place, _)| (ends[0]..=ends[1]).contains(&place.along))
    };
    let doubt = |node: usize| match &cut.model_error {
        Some(ModelError { nodes, .. }) => nodes[node][0].hypot(nodes[node][1]),
        None => 0.0,
    };
    let measured: Vec<_> = seen().filter_map(|(place, jump)| Some((place, (*jump)?))).collect();
    if measured.len() < 2 || (measured.len() as f64) < MEASURED_SHARE * seen().count() as f64 {
        return Err(NoCrack::NotMeasured);
    }
    let mut openings: Vec<f64> = measured.iter().map(|(_, jump)| jump.opening.value).collect();
    let mut slidings: Vec<f64> = measured.iter().map(|(_, jump)| jump.sliding.value).collect();
    let (opening, sliding) = (median(&mut openings), median(&mut slidings));
    let is_open = |(place, jump): &&(&FacePoint, Jump)| {
        jump.opening.value > OPEN_BY * jump.opening.sigma + doubt(place.plus).max(doubt(place.minus))
    };
    let share = measured.iter().filter(is_open).count() as f64 / measured.len() as f64;
    if opening < SLIDES * sliding.abs() && sliding.abs() > opening.abs() {
        return Err(NoCrack::Slides(sliding.abs()));
    }
    match share {
        _ if opening < 0.0 => Err(NoCrack::Closes(-opening)),
        share if share < OPEN_SHARE => Err(NoCrack::Open(share)),
        _ => Ok(([openings[0], opening, openings[openings.len() - 1]], sliding)),
    }
}

#[cfg(test)]
mod tests {
    use super::tip_beyond;

    #[test]
    fn a_tip_is_expected_where_faces_that_close_as_a_root_meet() {
        // The first place lies 5 elements from the tip; what is not measured says nothing.
        let of_tip = |first: f64| -> Vec<Option<f64>> { (0..9).map(|k| Some((first + f64::from(k)).sqrt())).collect() };
        assert!((tip_beyond(&of_tip(5.0)) - 5.0).abs() < 1e-9);
        assert!((tip_beyond(&of_tip(0.25)) - 0.25).abs() < 1e-9);
        let mut apart = of_tip(5.0);
        (apart[0], apart[3]) = (None, None);
        assert!((tip_beyond(&apart) - 5.0).abs() < 1e-9);
        // Widest at the end: not in sight.
        apart.reverse();
        assert_eq!(tip_beyond(&apart), f64::INFINITY);
        // Too little to tell: the tip is where the path ends.
        for apart in [&[][..], &[Some(1.0)], &[None, Some(1.0)], &[Some(0.0), Some(0.0)]] {
            assert_eq!(tip_beyond(apart), 0.0, "{apart:?}");
        }
    }
}
