//! What lies along a line, kept over the frames of a series.

use crate::field::{FrameQuantities, PointValues, Quantities, Segment, Value};

/// The most frames that are kept of a line, twice that for a moment: of a longer series every second, fourth, ...
const MOST_FRAMES: usize = 512;
/// The most places along a line that are kept.
const MOST_PLACES: usize = 512;

/// A line over the frames of a series: what is drawn as a map over time and place.
#[derive(Debug, Clone, PartialEq)]
pub struct LineHistory {
    /// Its name.
    pub name: String,
    /// Places along it, px from its beginning.
    pub along_px: Vec<f64>,
    /// Names of the quantities, with their unit.
    pub quantities: Vec<&'static str>,
    /// Numbers of the frames.
    pub frames: Vec<usize>,
    /// Of each frame the values of each quantity, place after place; NaN where there is none.
    pub values: Vec<Vec<Vec<f32>>>,
    /// Every how many-th frame and place is kept.
    every: [usize; 2],
    seen: usize,
}

impl LineHistory {
    /// Histories of all lines, without a frame.
    pub(super) fn of(quantities: &Quantities) -> Vec<Self> {
        let names: Vec<_> = PointValues::quantities(quantities.window).iter().map(|(name, _)| *name).collect();
        let history = |(name, line): &(String, Segment)| {
            let points = line.points();
            let every = points.len().div_ceil(MOST_PLACES).max(1);
            Self {
                name: name.clone(),
                along_px: points.iter().step_by(every).map(|(along, _)| *along).collect(),
                quantities: names.clone(),
                frames: Vec::new(),
                values: Vec::new(),
                every: [1, every],
                seen: 0,
            }
        };
        quantities.lines.iter().map(history).collect()
    }

    /// Takes the next frame, of which this is the line number `at`.
    pub(super) fn take(&mut self, number: usize, at: usize, drawn: Option<&FrameQuantities>, q: &Quantities) {
        let [every, places] = self.every;
        self.seen += 1;
        if !(self.seen - 1).is_multiple_of(every) {
            return;
        }
        let line = drawn.and_then(|drawn| drawn.lines.get(at));
        let of = |value: fn(&PointValues) -> Option<Value>| -> Vec<f32> {
            let there = |at: &Option<PointValues>| at.as_ref().and_then(value).map_or(f32::NAN, |v| v.value as f32);
            match line {
                Some(line) => line.iter().step_by(places).map(there).collect(),
                None => vec![f32::NAN; self.along_px.len()],
            }
        };
        self.frames.push(number);
        self.values.push(PointValues::quantities(q.window).iter().map(|&(_, value)| of(value)).collect());
        if self.frames.len() >= 2 * MOST_FRAMES {
            self.frames = self.frames.iter().copied().step_by(2).collect();
            self.values = std::mem::take(&mut self.values).into_iter().step_by(2).collect();
            self.every[0] *= 2;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_a_long_series_frames_are_kept_at_equal_distances_and_no_more_than_can_be_drawn() {
        let line = Segment::new([0.0, 0.0], [10_000.0, 0.0], 1.0).unwrap();
        let asked = Quantities { lines: vec![("line".to_owned(), line)], ..Quantities::default() };
        let mut history = LineHistory::of(&asked).pop().unwrap();
        for number in 1..=5000 {
            history.take(number, 0, None, &asked);
        }
        assert!((MOST_FRAMES..2 * MOST_FRAMES).contains(&history.frames.len()), "{}", history.frames.len());
        assert!(history.frames.windows(2).all(|pair| pair[1] - pair[0] == 8), "{:?}", history.frames);
        assert_eq!(history.values.len(), history.frames.len());
        assert!(history.along_px.len() <= MOST_PLACES && history.values[0][0].len() == history.along_px.len());
    }
}
