//! What a whole series says of its files: copies, frames that are missing or out of order, a reference that is none.

#![cfg_attr(
    not(test),
    expect(clippy::indexing_slicing, reason = "places in lists that are made here, of the frames of one summary")
)]

use crate::field::Status;
use crate::io::series::natural_order;
use crate::remark::{About, Code, Remark};
use crate::report::summary::{FrameSummary, Summary};
use crate::run::words::fields::{flattened, in_noise, in_unsettled_light};
use crate::run::words::remarks::{name_frames, name_frames_are};
use std::collections::BTreeMap;
use std::path::Path;

/// Motions nearer than this are alike, px.
const ALIKE_PX: f64 = 0.05;
/// Another order of the frames says something when it makes the path of the motion this much shorter,
const SHORTER: f64 = 0.6;
/// and by this many pixels.
const SHORTER_PX: f64 = 1.0;
/// Frames from which on an order is judged.
const FRAMES: usize = 4;
const MANY_FRAMES: usize = 8;
/// Squares of the steps of a motion in twice its variance: 1 in a random order, near 0 in a smooth one, 2 when it goes
/// back and forth.
const RANDOM: std::ops::Range<f64> = 0.65..1.4;

/// What is to be said of the files of a series: `hashes` has the SHA-256 of the images by their number, `references`
/// those of the reference.
pub(crate) fn about_series(
    summary: &Summary,
    hashes: &BTreeMap<usize, Option<String>>,
    references: &[String],
) -> Vec<Remark> {
    let mut said = copies(summary, hashes, references);
    said.extend(find_dropped(&summary.frames.iter().map(|frame| frame.file.as_str()).collect::<Vec<_>>()));
    said.extend(blank(summary));
    said.extend(taken_out_of_order(&summary.frames));
    said.extend(in_noise(summary));
    said.extend(in_unsettled_light(&summary.frames));
    said.extend(flattened(&summary.frames));
    let motion = Motion::of(summary);
    said.extend(motion.order(summary));
    said.extend(motion.reference(summary));
    said
}

/// Frames that are the same file as the reference or as another, and those that show nothing new.
fn copies(summary: &Summary, hashes: &BTreeMap<usize, Option<String>>, references: &[String]) -> Vec<Remark> {
    let mut said = Vec::new();
    let mut numbers: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    // The pages of a stack are of one file.
    let files = files(summary);
    let is_page = |number: &usize| files.get(number).is_some_and(|file| file.ends_with(']'));
    for (&number, hash) in hashes.iter().filter(|(number, _)| !is_page(number)) {
        if let Some(hash) = hash {
            numbers.entry(hash).or_default().push(number);
        }
    }
    let of_reference = |hash: &str| references.iter().any(|reference| reference == hash);
    let mut same: Vec<usize> =
        numbers.iter().filter(|(hash, _)| of_reference(hash)).flat_map(|(_, n)| n.clone()).collect();
    // Written anew, a copy is another file, but nothing is left of it.
    let nothing_left = summary.frames.iter().filter(|frame| {
        let still = frame.rigid_motion.as_ref().is_some_and(|m| m.translation_px[0].hypot(m.translation_px[1]) < 1e-6);
        frame.reference_frame == 0 && still && frame.residual_grey.is_some_and(|residual| residual < 1e-6)
    });
    same.extend(nothing_left.map(|frame| frame.number));
    same.sort_unstable();
    same.dedup();
    if !same.is_empty() {
        let text = format!(
            "{} the same image as the reference: no displacement, and no noise, is measured there",
            name_frames_are(&same)
        );
        said.push(Remark::new(Code::SameAsReference, About::Frames(same), text));
    }
    for (_, numbers) in numbers.iter().filter(|(hash, numbers)| numbers.len() > 1 && !of_reference(hash)) {
        let text = format!("{} copies of the same file", name_frames_are(numbers));
        said.push(Remark::new(Code::FramesCopied, About::Frames(numbers.clone()), text));
    }
    said
}

/// Numbers that the names of a series skip: the camera dropped frames, or they were not copied.
fn find_dropped(files: &[&str]) -> Option<Remark> {
    // The last number of a name; a longer one is no count.
    let number = |file: &&str| -> Option<u64> {
        let stem = Path::new(file).file_stem()?.to_str()?;
        let end = stem.rfind(|c: char| c.is_ascii_digit())? + 1;
        let begin = stem[..end].rfind(|c: char| !c.is_ascii_digit()).map_or(0, |at| at + 1);
        stem[begin..end].parse().ok().filter(|_| end - begin <= 12)
    };
    let numbers: Vec<u64> = files.iter().map(number).collect::<Option<_>>()?;
    let steps: Vec<u64> =
        numbers.windows(2).map(|pair| pair[1].checked_sub(pair[0]).filter(|&step| step > 0)).collect::<Option<_>>()?;
    let step = *steps.iter().min()?;
    let regular = steps.iter().filter(|&&other| other == step).count();
    let gaps: Vec<usize> = (0..steps.len()).filter(|&k| steps[k] > step && steps[k].is_multiple_of(step)).collect();
    // A choice of frames has no step of its own.
    let counts = numbers.len() >= MANY_FRAMES && regular + gaps.len() == steps.len() && regular >= 4 * gaps.len();
    let &first = gaps.first().filter(|_| counts)?;
    let missing: u64 = gaps.iter().map(|&k| steps[k] / step - 1).sum();
    let others = if gaps.len() > 1 { format!(", and {} more times", gaps.len() - 1) } else { String::new() };
    let text = format!(
        "the numbers in the names of the frames skip {missing}, first between {} and {}{others}: a frame that was \
         dropped shifts the loads and times of those behind it, unless these are given by a column `frame` or by time",
        files[first],
        files[first + 1]
    );
    let remark = Remark::new(Code::FramesMissing, About::Run, text).with("missing", missing as usize);
    Some(remark.with("gaps", gaps.len()).with("first_after", files[first]))
}

/// Frames that stand at another place of the series than the times in their files: as few as there can be.
fn taken_out_of_order(frames: &[FrameSummary]) -> Option<Remark> {
    let taken: Vec<(&FrameSummary, &str)> =
        frames.iter().filter_map(|frame| Some((frame, frame.taken.as_deref()?))).collect();
    // The longest way through the series on which times never fall: by its length, the place of the last frame of the
    // one that ends earliest, and of each frame the one before it.
    let (mut last, mut before): (Vec<usize>, Vec<Option<usize>>) = (Vec::new(), Vec::new());
    for (at, &(_, time)) in taken.iter().enumerate() {
        let length = last.partition_point(|&k| taken[k].1 <= time);
        before.push(length.checked_sub(1).map(|shorter| last[shorter]));
        match last.get_mut(length) {
            Some(place) => *place = at,
            None => last.push(at),
        }
    }
    let mut in_order = vec![false; taken.len()];
    let mut here = last.last().copied();
    while let Some(at) = here {
        in_order[at] = true;
        here = before[at];
    }
    let first = in_order.iter().position(|&kept| !kept)?;
    let out: Vec<usize> =
        taken.iter().zip(&in_order).filter(|(_, kept)| !**kept).map(|((frame, _), _)| frame.number).collect();
    let (frame, time) = taken[first];
    let before = first.checked_sub(1).map(|k| taken[k]).filter(|(_, before)| *before > time);
    let (beside, where_it_stands) = match before {
        Some(before) => (Some(before), "before"),
        None => (taken.get(first + 1).copied(), "behind"),
    };
    let beside = beside.map_or_else(String::new, |(beside, time)| {
        format!(", and frame {}, which stands {where_it_stands} it, at {time}", beside.number)
    });
    let (whose, seem) = (name_frames(&out), if out.len() == 1 { "seems" } else { "seem" });
    let text = format!(
        "{whose} {seem} to be out of order: by the times in the files, {} was taken at {time}{beside}",
        frame.file
    );
    Some(Remark::new(Code::TimesOutOfOrder, About::Frames(out), text).with("first_taken", time))
}

/// Frames with rows or columns of one grey level.
fn blank(summary: &Summary) -> Option<Remark> {
    let blank: Vec<usize> = summary.frames.iter().filter(|f| f.blank.is_some()).map(|f| f.number).collect();
    let torn = "half black, torn, or not whole: rows or columns of them have one grey level (see their messages)";
    let text = format!("{} {torn}", name_frames_are(&blank));
    (!blank.is_empty()).then(|| Remark::new(Code::ImageIncomplete, About::Frames(blank), text))
}

/// The rigid motions of the frames that have one, in the order of the series.
struct Motion {
    numbers: Vec<usize>,
    /// Translation and rotation of each zone, px.
    places: Vec<Vec<f64>>,
}

impl Motion {
    fn of(summary: &Summary) -> Self {
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
    fn order(&self, summary: &Summary) -> Option<Remark> {
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
        by_name.sort_by(|&a, &b| natural_order(Path::new(file(a)), Path::new(file(b))));
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
    fn reference(&self, summary: &Summary) -> Option<Remark> {
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
        (nearest > 3.0 * SHORTER_PX && nearest > 5.0 * apart).then(|| {
            let text = format!(
                "{reference} is {nearest:.1} px away from all other images, which are within {apart:.1} px of each other: is \
                 it the reference? Another one is given by --reference FILE"
            );
            Remark::new(Code::ReferenceApart, About::Reference, text).with("away_px", nearest).with("apart_px", apart)
        })
    }
}

fn files(summary: &Summary) -> BTreeMap<usize, &str> {
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
    use super::{About, Code, Motion, find_dropped, taken_out_of_order};
    use crate::report::summary::FrameSummary;

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
    fn frames_that_were_taken_at_another_time_than_they_stand_at_are_told_and_no_others() {
        let said = |seconds: &[Option<u32>]| {
            let frames: Vec<FrameSummary> = (1..)
                .zip(seconds)
                .map(|(number, second)| FrameSummary {
                    taken: second.map(|second| format!("2024-05-01T10:11:{second:02}")),
                    ..FrameSummary::unreadable(number, format!("{number}.tif"), String::new(), 0.0)
                })
                .collect();
            taken_out_of_order(&frames)
        };
        let all = |seconds: &[u32]| said(&seconds.iter().map(|&second| Some(second)).collect::<Vec<_>>());
        // Several frames of one second are in order, as are those whose files say nothing.
        assert_eq!(all(&[1, 1, 2, 3, 3, 3, 10]), None);
        assert_eq!(said(&[Some(4), None, Some(5), None]), None);
        assert_eq!(all(&[]), None);
        let late = all(&[1, 2, 9, 3, 4, 5]).unwrap();
        assert_eq!((late.code, late.about), (Code::TimesOutOfOrder, About::Frames(vec![3])));
        assert_eq!(late.values["first_taken"], "2024-05-01T10:11:09".into());
        assert!(late.text.contains("and frame 4, which stands behind"), "{}", late.text);
        let early = said(&[Some(5), Some(6), None, Some(1), Some(7), Some(8)]).unwrap();
        assert_eq!(early.about, About::Frames(vec![4]));
        assert!(early.text.contains("and frame 2, which stands before it, at 2024-05-01T10:11:06"), "{}", early.text);
        assert_eq!(all(&[1, 5, 3, 4, 2, 6, 7]).unwrap().about, About::Frames(vec![2, 5]));
        assert_eq!(all(&[5, 4, 3, 2, 1]).unwrap().about, About::Frames(vec![1, 2, 3, 4]), "one of them can stay");
    }

    #[test]
    fn numbers_that_are_skipped_are_told_and_a_choice_of_frames_is_not() {
        let said = |numbers: &[u64]| {
            let files: Vec<String> = numbers.iter().map(|n| format!("s2/cam1_{n:04}.tif")).collect();
            find_dropped(&files.iter().map(String::as_str).collect::<Vec<_>>())
        };
        let one = said(&[1, 2, 3, 4, 6, 7, 8, 9]).unwrap();
        assert_eq!((one.number("missing"), one.number("gaps")), (Some(1.0), Some(1.0)));
        assert_eq!(one.values["first_after"], "s2/cam1_0004.tif".into());
        let two = said(&[10, 20, 30, 60, 70, 80, 90, 100, 110, 130, 140]).unwrap();
        assert_eq!((two.number("missing"), two.number("gaps")), (Some(3.0), Some(2.0)));
        for whole in [&[1, 2, 3, 4, 5, 6, 7, 8][..], &[5, 10, 15, 20, 25, 30, 35, 40, 45], &[1, 2, 4, 5]] {
            assert_eq!(said(whole), None);
        }
        assert_eq!(said(&[1, 3, 4, 9, 11, 12, 20, 21, 22, 40]), None, "chosen by hand");
        assert_eq!(said(&[1, 2, 3, 4, 4, 5, 7, 8, 9]), None, "pages of one file");
        assert_eq!(
            find_dropped(&["a.png", "b.png", "c.png", "d.png", "e.png", "f.png", "g.png", "h.png", "i.png"]),
            None
        );
    }
}
