//! Pixels of the sensor that shine or are dead in every image: they move with nothing.

use crate::imaging::{Image, Pixels};
use rayon::prelude::*;
use std::sync::Arc;

/// A pixel is hot where it is off what its neighbours say by this share of the range of grey levels,
const LEAST_SHARE: f32 = 0.08;
/// and by so many times what pixels nearby are that it does not reach, but for one, which may be hot as well: edges and
/// dots have more such pixels.
const ALONE: f32 = 5.0;
/// More of the pixels than this are texture: dots of one pixel.
const MOST: f64 = 5e-3;
/// A hot pixel shows in an image where it is off by this share of what it is off by in the reference.
const SHOWS: f32 = 0.5;

/// Pixels of the reference that stand alone, far from what their neighbours say.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct HotPixels {
    /// Column, row, and by how much the grey level is off.
    pixels: Vec<(usize, usize, f32)>,
}

impl HotPixels {
    /// Those of the reference.
    pub fn of(reference: &Image) -> Self {
        let (width, height) = (reference.width(), reference.height());
        let (low, high) = reference.range();
        let least = LEAST_SHARE * (high - low);
        if width < 9 || height < 9 || least <= 0.0 {
            return Self::default();
        }
        let of_row = |y: usize| {
            let row = |y: usize| reference.pixels().floats(y * width..(y + 1) * width);
            let [above, up, row, down, below] = [y - 2, y - 1, y, y + 1, y + 2].map(row);
            let off = |x: usize| {
                let near = row[x - 1] + row[x + 1] + up[x] + down[x];
                let far = row[x - 2] + row[x + 2] + above[x] + below[x];
                row[x] - (4.0 * near - far) / 12.0
            };
            let far_off = (4..width - 4).map(|x| (x, y, off(x))).filter(|(_, _, off)| off.abs() > least);
            far_off.filter(|(x, y, off)| off.abs() > ALONE * second_nearby(reference, *x, *y)).collect::<Vec<_>>()
        };
        let pixels = (4..height - 4).into_par_iter().map(of_row).collect::<Vec<_>>().concat();
        let is_texture = pixels.len() as f64 > MOST * (width * height) as f64;
        if is_texture { Self::default() } else { Self { pixels } }
    }

    /// Those of them for which `counts` is true.
    pub fn count(&self, counts: impl Fn(usize, usize) -> bool) -> usize {
        self.pixels.iter().filter(|(x, y, _)| counts(*x, *y)).count()
    }

    /// The image with what the neighbours say in place of the hot pixels that it shows.
    pub fn repair(&self, image: Arc<Image>) -> Arc<Image> {
        let shows = |&&(x, y, off): &&(usize, usize, f32)| off_neighbours(&image, x, y) / off > SHOWS;
        let shown: Vec<_> = self.pixels.iter().filter(shows).collect();
        if shown.is_empty() {
            return image;
        }
        let [width, height] = [image.width(), image.height()];
        let repaired =
            shown.iter().map(|(x, y, _)| (y * width + x, image.grey(*x, *y) - off_neighbours(&image, *x, *y)));
        let mut pixels = Image::clone(&image).into_pixels();
        for (at, grey) in repaired {
            match &mut pixels {
                Pixels::U8(levels) => levels[at] = grey.round() as u8,
                Pixels::U16(levels) => levels[at] = grey.round() as u16,
                Pixels::F32(levels) => levels[at] = grey,
            }
        }
        // Of the same size, and finite as before.
        Image::new(width, height, pixels).map_or(image, Arc::new)
    }
}

/// By how much a pixel is off the polynomials of third degree through its four neighbours along the row, and along the
/// column, in the mean: a sixth of its fourth differences.
fn off_neighbours(image: &Image, x: usize, y: usize) -> f32 {
    let near = image.grey(x - 1, y) + image.grey(x + 1, y) + image.grey(x, y - 1) + image.grey(x, y + 1);
    let far = image.grey(x - 2, y) + image.grey(x + 2, y) + image.grey(x, y - 2) + image.grey(x, y + 2);
    image.grey(x, y) - (4.0 * near - far) / 12.0
}

/// The second largest deviation of the pixels of the 5 x 5 around one, but for those in its row and column, which it
/// reaches.
fn second_nearby(image: &Image, x: usize, y: usize) -> f32 {
    let around = || [-2isize, -1, 1, 2].into_iter();
    let off =
        |(dx, dy): (isize, isize)| off_neighbours(image, x.wrapping_add_signed(dx), y.wrapping_add_signed(dy)).abs();
    let offs = around().flat_map(|dy| around().map(move |dx| (dx, dy))).map(off);
    offs.fold([0.0f32; 2], |[first, second], off| [first.max(off), second.max(off.min(first))])[1]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_that_stays_bright_is_hot_where_an_edge_and_a_dot_that_moves_are_not() {
        let grey = |x: usize, y: usize| {
            let soft = 100.0 + 40.0 * (0.7 * x as f32).sin() * (0.6 * y as f32).cos();
            if x > 40 { soft + 90.0 } else { soft }
        };
        let image = |spots: &[(usize, usize)]| {
            let level = |k: usize| {
                let at = (k % 64, k / 64);
                grey(at.0, at.1) + if spots.contains(&at) { 70.0 } else { 0.0 }
            };
            Arc::new(Image::new(64, 64, Pixels::U8((0..64 * 64).map(|k| level(k) as u8).collect())).unwrap())
        };
        let reference = image(&[(20, 30), (50, 9)]);
        let hot = HotPixels::of(&reference);
        let at: Vec<_> = hot.pixels.iter().map(|(x, y, _)| (*x, *y)).collect();
        assert_eq!(at, [(50, 9), (20, 30)]);
        // The first is still there, the second has moved on: it was a dot.
        let repaired = hot.repair(image(&[(50, 9), (23, 30)]));
        assert_eq!(repaired.grey(23, 30), image(&[(23, 30)]).grey(23, 30));
        let off = (repaired.grey(50, 9) - grey(50, 9)).abs();
        assert!(off < 4.0, "{off}: the soft texture has 3.3 in its fourth differences");
        assert_eq!(*image(&[]), *hot.repair(image(&[])));
        assert_eq!(HotPixels::of(&image(&[])), HotPixels::default());
    }
}
