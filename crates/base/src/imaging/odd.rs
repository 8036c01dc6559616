//! Grey levels that are not those of a picture, told from the pixels alone.

use super::{Image, Levels};
use std::fmt;

/// Blocks of 2 x 2 pixels that are looked at, at most.
const BLOCKS: usize = 1 << 20;
/// How much brighter than green another colour of a mosaic is at least, of the mean of all.
const OTHER_COLOUR: f64 = 0.08;
/// How alike the two greens are, of the difference to another colour.
const GREENS_ALIKE: f64 = 0.25;
/// Neighbours differ so many times less when the bytes are put right.
const BYTES: f64 = 4.0;

/// What is odd about the grey levels of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OddLevels {
    /// The raw pixels of a colour camera, each of one colour.
    Mosaic,
    /// There are two levels and no more.
    TwoLevels,
    /// The two bytes of each level are exchanged.
    SwappedBytes,
}

impl fmt::Display for OddLevels {
    /// What shows, what it means and what to do.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Mosaic => {
                "every second row and column has another brightness: this is the raw mosaic of a colour camera (Bayer); \
                 develop the images to grey, or take one colour of them"
            }
            Self::TwoLevels => {
                "there are two grey levels and no more: give the images as the camera took them, without a threshold"
            }
            Self::SwappedBytes => {
                "neighbouring pixels are alike only with the two bytes of each grey level exchanged: save the images in the \
                 other byte order"
            }
        })
    }
}

impl OddLevels {
    /// What is odd about `image`; mostly nothing.
    ///
    /// ```
    /// # use quadrille_base as quadrille;
    /// use quadrille::imaging::{Image, OddLevels, Pixels};
    /// let image = Image::new(4, 4, Pixels::U8((0..16).map(|k| if k % 3 == 0 { 0 } else { 255 }).collect())).unwrap();
    /// assert_eq!(OddLevels::of(&image), Some(OddLevels::TwoLevels));
    /// ```
    pub fn of(image: &Image) -> Option<Self> {
        let has_two = match image.pixels() {
            Levels::U8(levels) => have_two_levels(levels),
            Levels::U16(levels) => have_two_levels(levels),
            Levels::F32(levels) => have_two_levels(levels),
        };
        if has_two {
            return Some(Self::TwoLevels);
        }
        if let Levels::U16(levels) = image.pixels()
            && are_swapped(levels)
        {
            return Some(Self::SwappedBytes);
        }
        is_mosaic(image).then_some(Self::Mosaic)
    }
}

/// Whether there are two levels, far enough apart to be no noise of a flat image.
fn have_two_levels<T: Copy + PartialEq + Into<f64>>(levels: &[T]) -> bool {
    let Some(&first) = levels.first() else { return false };
    let Some(&second) = levels.iter().find(|&&level| level != first) else { return false };
    (first.into() - second.into()).abs() > 1.0 && levels.iter().all(|&level| level == first || level == second)
}

/// Whether neighbours in a row differ much less with the bytes of each level exchanged.
fn are_swapped(levels: &[u16]) -> bool {
    let step = levels.len().div_ceil(BLOCKS).max(1);
    let (mut as_is, mut swapped) = (0_u64, 0_u64);
    for pair in levels.windows(2).step_by(step) {
        as_is += u64::from(pair[0].abs_diff(pair[1]));
        swapped += u64::from(pair[0].swap_bytes().abs_diff(pair[1].swap_bytes()));
    }
    as_is as f64 > BYTES * swapped as f64
}

/// Whether blocks of 2 x 2 pixels have two greens on a diagonal, and red or blue of another brightness on the other.
fn is_mosaic(image: &Image) -> bool {
    let (columns, rows) = (image.width() / 2, image.height() / 2);
    if columns < 8 || rows < 8 {
        return false;
    }
    // Whole rows of blocks, so that few are left out where the texture has a period.
    let step = (columns * rows).div_ceil(BLOCKS).max(1);
    let mut sums = [0.0_f64; 4];
    let mut n = 0.0;
    for y in (0..rows).step_by(step) {
        for x in 0..columns {
            for (k, sum) in sums.iter_mut().enumerate() {
                *sum += f64::from(image.grey(2 * x + k % 2, 2 * y + k / 2));
            }
            n += 1.0;
        }
    }
    let [a, b, c, d] = sums.map(|sum| sum / n);
    let mean = 0.25 * (a + b + c + d);
    let has_greens = |greens: [f64; 2], others: [f64; 2]| {
        let green = 0.5 * (greens[0] + greens[1]);
        let apart = others.map(|other| (other - green).abs()).into_iter().fold(0.0, f64::max);
        apart > OTHER_COLOUR * mean && (greens[0] - greens[1]).abs() < GREENS_ALIKE * apart
    };
    mean > 0.0 && (has_greens([b, c], [a, d]) || has_greens([a, d], [b, c]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::Pixels;

    /// A smooth pattern with a step of noise; `gain` of each pixel.
    fn levels(gain: impl Fn(usize, usize) -> f64) -> Vec<f64> {
        let at = |x: usize, y: usize| {
            let wave = (0.9 * x as f64).sin() * (0.7 * y as f64).cos() + (0.31 * (x + 2 * y) as f64).sin();
            let noise = ((12.9898 * x as f64 + 78.233 * y as f64).sin() * 43758.5453).fract();
            (120.0 + 40.0 * wave + 4.0 * noise) * gain(x, y)
        };
        (0..60).flat_map(|y| (0..80).map(move |x| (x, y))).map(|(x, y)| at(x, y)).collect()
    }

    fn image(gain: impl Fn(usize, usize) -> f64) -> Image {
        Image::new(80, 60, Pixels::U8(levels(gain).into_iter().map(|v| v.round() as u8).collect())).unwrap()
    }

    #[test]
    fn the_mosaic_of_a_colour_camera_is_told_from_rows_columns_and_plain_pictures() {
        let gains = [[[0.62, 1.0], [1.0, 0.5]], [[1.0, 0.62], [0.5, 1.0]], [[1.0, 0.5], [1.0, 0.7]]];
        let of = |k: usize| OddLevels::of(&image(move |x, y| gains[k][y % 2][x % 2]));
        assert_eq!([of(0), of(1)], [Some(OddLevels::Mosaic); 2]);
        assert_eq!(of(2), None);
        assert_eq!(OddLevels::of(&image(|_, _| 1.0)), None);
        // Half-frames of a video, and columns read by two amplifiers.
        assert_eq!(OddLevels::of(&image(|_, y| [1.0, 0.8][y % 2])), None);
        assert_eq!(OddLevels::of(&image(|x, _| [1.0, 0.8][x % 2])), None);
    }

    #[test]
    fn two_levels_and_swapped_bytes_are_told() {
        let two = levels(|_, _| 1.0).into_iter().map(|v| if v > 120.0 { 255 } else { 0 }).collect();
        assert_eq!(OddLevels::of(&Image::new(80, 60, Pixels::U8(two)).unwrap()), Some(OddLevels::TwoLevels));
        let flat = (0..4800).map(|k| 100 + u8::from(k % 7 == 0)).collect();
        assert_eq!(OddLevels::of(&Image::new(80, 60, Pixels::U8(flat)).unwrap()), None);
        for bits in [10, 12, 16] {
            let right: Vec<u16> = levels(|_, _| 1.0).iter().map(|v| (v * f64::from(1 << (bits - 8))) as u16).collect();
            let swapped = right.iter().map(|v| v.swap_bytes()).collect();
            let of = |levels: Vec<u16>| OddLevels::of(&Image::new(80, 60, Pixels::U16(levels)).unwrap());
            assert_eq!((of(right), of(swapped)), (None, Some(OddLevels::SwappedBytes)), "{bits} bits");
        }
    }
}
