//! Numbers over a pair of axes, as colours: what lies along a line while time goes on.

use super::backdrop::png;
use super::bar::Bar;
use super::scale::{Palette, Range};
use image::ExtendedColorType;

/// A map behind the curves of a [`Plot`](super::Plot) with linear axes: a rectangle of colour for each number.
#[derive(Debug, Clone, PartialEq)]
pub struct Cells {
    /// Places of the columns along the horizontal axis, rising.
    pub x: Vec<f64>,
    /// Places of the rows along the vertical axis, rising.
    pub y: Vec<f64>,
    /// Column by column the numbers of its rows; NaN where there is none.
    pub values: Vec<Vec<f32>>,
    /// What they are, with the unit.
    pub label: String,
    /// Their colours.
    pub palette: Palette,
}

impl Cells {
    /// Where the first column or row begins, where each meets the next, and where the last ends.
    pub(super) fn edges(places: &[f64]) -> Vec<f64> {
        let (Some(first), Some(last)) = (places.first(), places.last()) else { return Vec::new() };
        let mut edges: Vec<f64> = places.windows(2).map(|pair| pair.iter().sum::<f64>() / 2.0).collect();
        let (begin, end) = match (edges.first(), edges.last()) {
            (Some(second), Some(before)) => (2.0 * first - second, 2.0 * last - before),
            _ => (first - 0.5, last + 0.5),
        };
        edges.insert(0, begin);
        edges.push(end);
        edges
    }

    /// What the colours stand for; `None` where there is no number.
    pub(super) fn bar(&self) -> Option<Bar> {
        let numbers = self.values.iter().flatten().filter(|v| v.is_finite()).map(|v| f64::from(*v));
        let range = Range::of(numbers)?;
        let range = if self.palette.is_diverging() { range.symmetric() } else { range };
        let (palette, label) = (self.palette, self.label.clone());
        Some(Bar { range, palette, opacity: 1.0, below: false, above: false, label })
    }

    /// The map of the axes from `x` to `y` in so many pixels, as a PNG; white where there is no number.
    pub(super) fn png(&self, bar: &Bar, [x, y]: [[f64; 2]; 2], [width, height]: [u32; 2]) -> Vec<u8> {
        // Which column or row holds the middle of a pixel.
        let cells = |edges: &[f64], [from, to]: [f64; 2], n: u32| -> Vec<Option<usize>> {
            let at = |k: u32| from + (to - from) * (f64::from(k) + 0.5) / f64::from(n);
            let cell = |v: f64| edges.partition_point(|edge| *edge <= v).checked_sub(1);
            (0..n).map(|k| cell(at(k)).filter(|cell| cell + 1 < edges.len())).collect()
        };
        let columns = cells(&Self::edges(&self.x), x, width);
        let mut rows = cells(&Self::edges(&self.y), y, height);
        rows.reverse(); // upwards
        let colour = |row: Option<usize>, column: Option<usize>| {
            let value = column.zip(row).and_then(|(column, row)| self.values.get(column)?.get(row).copied());
            match value.filter(|value| value.is_finite()) {
                Some(value) => bar.range.colour(bar.palette, f64::from(value)),
                None => [255; 3],
            }
        };
        let pixels: Vec<u8> =
            rows.iter().flat_map(|&row| columns.iter().flat_map(move |&column| colour(row, column))).collect();
        png(&pixels, width, height, ExtendedColorType::Rgb8)
    }
}
