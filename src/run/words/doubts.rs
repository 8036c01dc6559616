//! What a whole series says of its files: copies, frames that are missing or were taken in another order, a pattern
//! of the camera.

#![cfg_attr(
    not(test),
    expect(clippy::indexing_slicing, reason = "places in lists that are made here, of the frames of one summary")
)]

use crate::remark::{About, Code, Remark};
use crate::report::summary::{FrameSummary, Summary};
use crate::run::words::fields::{flattened, in_noise, in_unsettled_light};
use crate::run::words::motion_order::{Motion, files};
use crate::run::words::remarks::{name_frames, name_frames_are};
use std::collections::BTreeMap;
use std::path::Path;

/// Files from which on skipped numbers are named.
const MANY_FRAMES: usize = 8;

/// What is to be said of the files of a series: `hashes` has the SHA-256 of the images by their number, `references`
/// those of the reference, which was `reference_named` or is the first image.
pub(crate) fn about_series(
    summary: &Summary,
    hashes: &BTreeMap<usize, Option<String>>,
    references: &[String],
    reference_named: bool,
) -> Vec<Remark> {
    let motion = Motion::of(summary);
    let mut said = copies(summary, hashes, references);
    said.extend(find_dropped(&summary.frames.iter().map(|frame| frame.file.as_str()).collect::<Vec<_>>()));
    said.extend(of_other_size(summary));
    said.extend(blank(summary));
    said.extend(taken_out_of_order(&summary.frames, |order| motion.is_shorter(order)));
    said.extend(fixed_pattern(&summary.frames));
    said.extend(in_noise(summary));
    said.extend(in_unsettled_light(&summary.frames));
    said.extend(flattened(&summary.frames));
    if !times_rise(&summary.frames) {
        said.extend(motion.order(summary));
    }
    said.extend(motion.reference(summary, reference_named));
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

/// Images that are not as large as the reference, counted: whether it is they that are odd, or the reference.
fn of_other_size(summary: &Summary) -> Option<Remark> {
    let mut sizes: BTreeMap<[u64; 2], Vec<usize>> = BTreeMap::new();
    for frame in &summary.frames {
        frame.size_px.into_iter().for_each(|size| sizes.entry(size).or_default().push(frame.number));
    }
    let n: usize = sizes.values().map(Vec::len).sum();
    let (&[width, height], _) = sizes.iter().max_by_key(|(_, numbers)| numbers.len())?;
    let (of_reference, others) = (&summary.reference, summary.frames.len() - n);
    let own = format!("{} x {} px", of_reference.width_px, of_reference.height_px);
    let text = if others == 0 && sizes.len() == 1 {
        format!("all {n} frames are {width} x {height} px, and the reference alone is {own}: name another reference")
    } else {
        let named: Vec<String> = sizes
            .iter()
            .map(|([width, height], numbers)| format!("{} {width} x {height} px", name_frames_are(numbers)))
            .collect();
        format!("{}; the other {others} are {own} like the reference", named.join(", "))
    };
    let numbers = sizes.into_values().flatten().collect();
    let remark = Remark::new(Code::FramesOfOtherSize, About::Frames(numbers), text).with("frames", n);
    Some(remark.with("width_px", width as usize).with("height_px", height as usize))
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

/// Whether the files have a time each, and a later one than the file before.
fn times_rise(frames: &[FrameSummary]) -> bool {
    let times: Option<Vec<&str>> = frames.iter().map(|frame| frame.taken.as_deref()).collect();
    times.is_some_and(|times| times.windows(2).all(|pair| pair[0] < pair[1]))
}

/// Frames that stand at another place of the series than the times in their files: as few as there can be. Times may be
/// those of a conversion: the motion has to agree with the order of the frames by their times.
fn taken_out_of_order(frames: &[FrameSummary], agrees: impl Fn(&[usize]) -> bool) -> Option<Remark> {
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
    let mut by_time = taken.clone();
    by_time.sort_by_key(|(_, time)| *time);
    if !agrees(&by_time.iter().map(|(frame, _)| frame.number).collect::<Vec<_>>()) {
        return None;
    }
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

/// What stays with the camera: that of the frame in the middle of those that show it.
fn fixed_pattern(frames: &[FrameSummary]) -> Option<Remark> {
    let mut seen: Vec<_> = frames.iter().filter_map(|frame| Some((frame.fixed_pattern?, frame.number))).collect();
    seen.sort_by(|a, b| a.0.grey.total_cmp(&b.0.grey));
    let (pattern, number) = *seen.get(seen.len() / 2)?;
    let text = format!(
        "{pattern} (seen in frame {number}); take a flat image off, or move the specimen by some pixels between reference and \
         test"
    );
    let remark = Remark::new(Code::FixedPattern, About::Frames(seen.iter().map(|(_, number)| *number).collect()), text);
    Some(remark.with("pattern_grey", pattern.grey).with("share", pattern.share))
}

#[cfg(test)]
mod tests {
    use super::{About, Code, find_dropped, taken_out_of_order};
    use crate::report::summary::FrameSummary;

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
            taken_out_of_order(&frames, |_| true)
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
