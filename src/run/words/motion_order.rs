//! The order of a series by its motion: frames that are shuffled, exchanged or out of place, and whether the motion
//! grows from the reference.

#![cfg_attr(
    not(test),
    expect(clippy::indexing_slicing, reason = "places in lists that are made here, of the frames of one summary")
)]

use crate::field::Status;
use crate::io::series::NameOrder;
use crate::remark::{About, Code, Remark};
use crate::report::summary::Summary;
use std::collections::BTreeMap;
use std::path::Path;

/// Motions nearer than this are alike, px.
const ALIKE_PX: f64 = 0.05;
/// Another order of the frames says something when it makes the path of the motion this much shorter,
const SHORTER: f64 = 0.6;
/// and by this many pixels.
const SHORTER_PX: f64 = 1.0;
/// Two frames are exchanged when that leaves less than this share of the squares of the motion's second differences
/// around them: nearly nothing of a smooth motion.
const SMOOTHER: f64 = 0.15;
/// Frames on either side that are looked at, and places of which any two may be exchanged: the roughest.
const AROUND: usize = 3;
const SUSPECTS: usize = 8;
/// Frames from which on an order is judged.
const FRAMES: usize = 4;
const MANY_FRAMES: usize = 8;
/// Squares of the steps of a motion in twice its variance: 1 in a random order, near 0 in a smooth one, 2 when it goes
/// back and forth.
const RANDOM: std::ops::Range<f64> = 0.65..1.4;

/// The rigid motions of the frames that have one, in the order of the series.
pub(crate) struct Motion {
    numbers: Vec<usize>,
    /// Translation and rotation of each zone, px.
    places: Vec<Vec<f64>>,
}

impl Motion {
    pub fn of(summary: &Summary) -> Self {
        // A rotation in pixels at a typical distance.
        let arm = 0.125 * (summary.reference.width_px + summary.reference.height_px) as f64;
        let (mut numbers, mut places) = (Vec::new(), Vec::new());
        for frame in summary.frames.iter().filter(|frame| frame.status == Status::Converged) {
            let motions: Option<Vec<_>> = frame.zones.iter().map(|zone| zone.rigid_motion.as_ref()).collect();
            let Some(motions) = motions.filter(|motions| !motions.is_empty()) else { continue };
            let of_zone = |m: &&crate::report::summary::RigidSummary| {
                [m.translation_px[0], m.translation_px[1], m.rotation_deg.to_radians() * arm]
            };
            numbers.push(frame.number);
            places.push(motions.iter().flat_map(of_zone).collect());
        }
        let n = places.first().map_or(0, Vec::len);
        if places.iter().any(|place: &Vec<f64>| place.len() != n) {
            (numbers, places) = (Vec::new(), Vec::new());
        }
        Self { numbers, places }
    }

    /// The way through frames (by their places here), from the reference on, px.
    fn way(&self, order: &[usize]) -> f64 {
        let mut here: Option<&Vec<f64>> = None;
        let mut way = 0.0;
        for &at in order {
            way += match here {
                Some(here) => distance(here, &self.places[at]),
                None => length(&self.places[at]),
            };
            here = Some(&self.places[at]);
        }
        way
    }

    /// Whether frames that stand in the order of these numbers go a shorter way than in that of the series.
    pub fn is_shorter(&self, numbers: &[usize]) -> bool {
        let order: Vec<usize> = numbers.iter().filter_map(|number| self.numbers.binary_search(number).ok()).collect();
        let mut given = order.clone();
        given.sort_unstable();
        self.way(&order) + ALIKE_PX < self.way(&given)
    }

    /// Two frames that stand in each other's place: the motion is rough around them, and smooth the other way round.
    fn exchanged(&self) -> Option<[usize; 2]> {
        let n = self.places.len();
        let origin = vec![0.0; self.places.first()?.len()];
        // Place 0 is the reference.
        let place = |order: &[usize], k: usize| if k == 0 { &origin } else { &self.places[order[k - 1]] };
        let bend = |order: &[usize], k: usize| {
            let [a, b, c] = [k - 1, k, k + 1].map(|k| place(order, k));
            (0..origin.len()).map(|i| (a[i] - 2.0 * b[i] + c[i]).powi(2)).sum::<f64>()
        };
        let given: Vec<usize> = (0..n).collect();
        let mut rough: Vec<usize> = (1..n).collect();
        rough.sort_by(|&a, &b| bend(&given, b).total_cmp(&bend(&given, a)));
        rough.truncate(SUSPECTS);
        // At the end there is no bend.
        rough.push(n);
        let pairs = rough.iter().flat_map(|&a| rough.iter().map(move |&b| [a.min(b), a.max(b)]));
        let smoother = |[a, b]: [usize; 2]| {
            let mut order = given.clone();
            order.swap(a - 1, b - 1);
            let near = |k: &usize| k.abs_diff(a) <= AROUND || k.abs_diff(b) <= AROUND;
            let of = |order: &[usize]| (1..n).filter(near).map(|k| bend(order, k)).sum::<f64>();
            let step = distance(&self.places[a - 1], &self.places[b - 1]);
            (of(&order) / of(&given).max(f64::MIN_POSITIVE), step > 4.0 * ALIKE_PX)
        };
        let rated = pairs.filter(|[a, b]| a != b).map(|pair| (smoother(pair), pair));
        let ((ratio, _), pair) = rated.filter(|((_, moves), _)| *moves).min_by(|a, b| a.0.0.total_cmp(&b.0.0))?;
        (n >= 2 * FRAMES && ratio < SMOOTHER).then(|| pair.map(|k| k - 1))
    }

    /// By how much the way is longer when it goes from the last of `before` to the first of `behind` through the frame
    /// `at`, px.
    fn detour(&self, before: &[usize], at: usize, behind: &[usize]) -> f64 {
        let between = |end: Option<&usize>| match end {
            Some(&end) => distance(&self.places[end], &self.places[at]),
            None => length(&self.places[at]),
        };
        let Some(&next) = behind.first() else { return between(before.last()) };
        let straight = match before.last() {
            Some(&last) => distance(&self.places[last], &self.places[next]),
            None => length(&self.places[next]),
        };
        between(before.last()) + between(Some(&next)) - straight
    }

    /// Whether the frames are in another order than that of the motion.
    pub fn order(&self, summary: &Summary) -> Option<Remark> {
        let n = self.places.len();
        if n < FRAMES {
            return None;
        }
        let given: Vec<usize> = (0..n).collect();
        let way = self.way(&given);
        let much = |other: f64| other < SHORTER * way && way - other > SHORTER_PX;
        let files = files(summary);
        let file = |at: usize| files.get(&self.numbers[at]).copied().unwrap_or("");
        let mut by_name = given.clone();
        let order = NameOrder::of(&given.iter().map(|&at| file(at)).collect::<Vec<_>>());
        by_name.sort_by(|&a, &b| order.compare(Path::new(file(a)), Path::new(file(b))));
        if by_name != given && much(self.way(&by_name)) {
            let shorter = self.way(&by_name);
            let text = format!(
                "the frames seem to be shuffled: in the order of their names ({}, {}, ...) the motion goes a way of \
                 {shorter:.1} px, in the order given one of {way:.1} px; give the files in the order of the test, or a pattern \
                 in quotes",
                file(by_name[0]),
                file(by_name[1])
            );
            let remark = Remark::new(Code::FramesShuffled, About::Run, text);
            return Some(remark.with("way_px", way).with("way_by_name_px", shorter));
        }
        if let Some(pair) = self.exchanged() {
            let numbers = pair.map(|at| self.numbers[at]);
            let text = format!(
                "frames {} ({}) and {} ({}) seem to be exchanged: the motion is smooth when each stands in the place of the \
                 other",
                numbers[0],
                file(pair[0]),
                numbers[1],
                file(pair[1])
            );
            return Some(Remark::new(Code::FrameOutOfOrder, About::Frames(numbers.to_vec()), text));
        }
        // One frame in another place. The first and the last may be what the test ends with: the reference has a say in
        // that.
        let inner = if n >= 2 * FRAMES { 1..n - 1 } else { 0..0 };
        for at in inner {
            let rest: Vec<usize> = given.iter().copied().filter(|&k| k != at).collect();
            // Most frames lie on the way, which is as long without them: no other place of theirs makes it shorter.
            let without = way - self.detour(&given[at - 1..at], at, &given[at + 1..]);
            if !much(without) {
                continue;
            }
            let moved = (0..n).map(|place| (without + self.detour(&rest[..place], at, &rest[place..]), place));
            let Some((shortest, place)) = moved.min_by(|a, b| a.0.total_cmp(&b.0)) else { continue };
            if place != at && much(shortest) {
                let text = format!(
                    "frame {} ({}) seems to be out of order: without it the motion goes a way of {shortest:.1} px, with it \
                     one of {way:.1} px",
                    self.numbers[at],
                    file(at)
                );
                let remark = Remark::new(Code::FrameOutOfOrder, About::Frames(vec![self.numbers[at]]), text);
                return Some(remark.with("way_px", way).with("way_without_px", shortest));
            }
        }
        if n < MANY_FRAMES {
            return None;
        }
        let components = self.places[0].len();
        let mean: Vec<f64> =
            (0..components).map(|c| self.places.iter().map(|place| place[c]).sum::<f64>() / n as f64).collect();
        let spread: f64 = self.places.iter().map(|place| distance(place, &mean).powi(2)).sum();
        let steps: f64 = self.places.windows(2).map(|pair| distance(&pair[0], &pair[1]).powi(2)).sum();
        let random = RANDOM.contains(&(0.5 * steps / spread.max(f64::MIN_POSITIVE)));
        (random && (spread / n as f64).sqrt() > SHORTER_PX).then(|| {
            let text = format!(
                "the motion jumps from frame to frame as in a random order (a way of {way:.1} px): are the files in the \
                 order of the test?"
            );
            Remark::new(Code::OrderRandom, About::Run, text).with("way_px", way)
        })
    }

    /// Whether another image than the reference is what the motion grows from.
    pub fn reference(&self, summary: &Summary, is_named: bool) -> Option<Remark> {
        let n = self.places.len();
        let last = self.places.last()?;
        if n < 3 {
            return None;
        }
        let reference = &summary.reference.file;
        let files = files(summary);
        let file = |at: usize| files.get(&self.numbers[at]).copied().unwrap_or("");
        // The last one lies a step beyond the reference, and all others on its other side: unloading ends at the
        // reference or before it.
        let given: Vec<usize> = (0..n).collect();
        let (way, first) = (self.way(&given), &self.places[0]);
        let from_last = length(last) + self.way(&given[..n - 1]);
        let along: f64 = last.iter().zip(first).map(|(a, b)| a * b).sum();
        let opposite = along < -0.5 * length(last) * length(first);
        let mut steps: Vec<f64> = self.places.windows(2).map(|pair| distance(&pair[0], &pair[1])).collect();
        steps.sort_by(f64::total_cmp);
        let beyond = length(last) > 0.3 * steps[(n - 1) / 2] && length(last) > 2.0 * ALIKE_PX;
        if opposite && beyond && from_last < 0.75 * way {
            let text = format!(
                "the series fits better the other way: the motion grows from its last image, {}, and not from {reference}; if \
                 that one shows the specimen before the test, give --reference {0}",
                file(n - 1)
            );
            return Some(Remark::new(Code::OrderReversed, About::Reference, text).with("last", file(n - 1)));
        }
        // All of them far from the reference and near each other.
        let nearest = self.places.iter().map(|place| length(place)).fold(f64::INFINITY, f64::min);
        let apart = self.places.iter().map(|place| distance(place, first)).fold(0.0, f64::max);
        (!is_named && nearest > 3.0 * SHORTER_PX && nearest > 5.0 * apart).then(|| {
            let text = format!(
                "{reference} is {nearest:.1} px away from all other images, which are within {apart:.1} px of each other: is \
                 it the reference? Another one is given by --reference FILE"
            );
            Remark::new(Code::ReferenceApart, About::Reference, text).with("away_px", nearest).with("apart_px", apart)
        })
    }
}

pub(crate) fn files(summary: &Summary) -> BTreeMap<usize, &str> {
    summary.frames.iter().map(|frame| (frame.number, frame.file.as_str())).collect()
}

fn length(v: &[f64]) -> f64 {
    v.iter().map(|v| v * v).sum::<f64>().sqrt()
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::Motion;

    #[test]
    fn a_detour_is_what_a_frame_adds_to_the_way_at_any_place() {
        let places = [[3.0, 1.0, 0.2], [-1.0, 4.0, 0.1], [2.0, 2.0, -0.3], [7.0, -5.0, 0.0], [0.5, 0.5, 0.5]];
        let motion = Motion {
            numbers: (1..=places.len()).collect(),
            places: places.iter().map(|place| place.to_vec()).collect(),
        };
        for at in 0..places.len() {
            let rest: Vec<usize> = (0..places.len()).filter(|&k| k != at).collect();
            for place in 0..=rest.len() {
                let mut order = rest.clone();
                order.insert(place, at);
                let added = motion.way(&order) - motion.way(&rest);
                let detour = motion.detour(&rest[..place], at, &rest[place..]);
                // Sums of ten lengths of at most 15 px, each rounded once.
                assert!((added - detour).abs() < 1e-13, "frame {at} at {place}: {added} and {detour}");
            }
        }
    }

    #[test]
    fn two_frames_that_are_exchanged_are_named_in_a_smooth_motion_and_in_no_other() {
        let motion = |at: &dyn Fn(f64) -> [f64; 2], order: &[usize]| Motion {
            numbers: (1..=order.len()).collect(),
            places: order.iter().map(|&k| at(k as f64).to_vec()).collect(),
        };
        let swapped = |n: usize, pair: [usize; 2]| {
            let mut order: Vec<usize> = (1..=n).collect();
            order.swap(pair[0], pair[1]);
            order
        };
        let jitter = |k: f64| 0.03 * ((12.9898 * k).sin() * 43758.5).fract();
        let (ramp, cycle) = (
            |k: f64| [0.8 * k + jitter(k), 0.1 * k + jitter(k + 0.5)],
            |k: f64| [6.0 * (0.4 * k).sin() + jitter(k), jitter(k + 0.5)],
        );
        let holds = |k: f64| [(0.5 * k).floor() + jitter(k), 0.0];
        let (mut found, mut all) = (0, 0);
        for n in [9, 20, 60] {
            for (a, b) in (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b))).step_by(7) {
                for at in [&ramp as &dyn Fn(f64) -> [f64; 2], &cycle] {
                    // What lies in nearly one place, beside steps of up to 2.4 px, is not told apart.
                    let [p, q] = [at(a as f64 + 1.0), at(b as f64 + 1.0)];
                    if (p[0] - q[0]).abs() > 1.0 {
                        all += 1;
                        found += usize::from(motion(at, &swapped(n, [a, b])).exchanged() == Some([a, b]));
                    }
                }
            }
            for at in [&ramp as &dyn Fn(f64) -> [f64; 2], &cycle, &holds] {
                assert_eq!(motion(at, &(1..=n).collect::<Vec<_>>()).exchanged(), None, "{n}");
            }
        }
        assert!(found as f64 >= 0.95 * all as f64, "{found} of {all}");
    }
}
