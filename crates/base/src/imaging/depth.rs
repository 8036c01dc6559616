//! How many of the bits of a file an image uses, and how many of its pixels are saturated.

use super::{Image, Levels};
use std::ops::AddAssign;

/// Depths that cameras have.
const CAMERA_BITS: [u32; 5] = [8, 10, 12, 14, 16];
/// Pixels that are gone through twice, for the range and for what is at its ends: they stay in the first cache.
const RUN: usize = 1 << 13;
/// Pixels side by side in vectors.
const LANES: usize = 64;
/// Pixels of a lane that are counted in one go.
const SHORT: usize = 255;

/// The range of grey levels that a camera used in images of whole numbers.
///
/// Cameras of 10, 12 or 14 bit store their levels in 16, either at the lower end (all below 4096, say) or at the
/// upper end (all multiples of 16, say).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GreyDepth {
    /// Bits of a pixel in the file: 8 or 16.
    pub stored: u32,
    /// Bits used: the smallest of 8, 10, 12, 14, 16 that holds all grey levels; of shifted ones those not always 0.
    pub used: u32,
    /// Lowest bits that are always 0, when they are at least two.
    pub shift: u32,
}

impl GreyDepth {
    /// The depth of `image`; `None` for floats.
    ///
    /// ```
    /// # use quadrille_base as quadrille;
    /// use quadrille::imaging::{GreyDepth, Image, Pixels};
    /// let image = Image::new(2, 1, Pixels::U16(vec![7, 4095])).unwrap();
    /// let depth = GreyDepth::of(&image).unwrap();
    /// assert_eq!((depth.stored, depth.used, depth.highest()), (16, 12, 4095));
    /// ```
    pub fn of(image: &Image) -> Option<Self> {
        match image.pixels() {
            Levels::U8(_) => Some(Self { stored: 8, used: 8, shift: 0 }),
            // One pass: the bits that any pixel has give the largest depth and the shift alike.
            Levels::U16(levels) => Some(Self::of_bits(bits_set(levels))),
            Levels::F32(_) => None,
        }
    }

    /// The depth of 16 bit levels of which `bits` are set anywhere.
    fn of_bits(bits: u16) -> Self {
        let shift = if bits == 0 { 0 } else { bits.trailing_zeros() };
        // A lower end that is empty by chance is empty by one bit; and no camera has fewer than 8.
        if (2..=8).contains(&shift) && bits.leading_zeros() == 0 {
            return Self { stored: 16, used: 16 - shift, shift };
        }
        let needed = u16::BITS - bits.leading_zeros();
        let used = CAMERA_BITS.into_iter().find(|&used| needed <= used).unwrap_or(16);
        Self { stored: 16, used, shift: 0 }
    }

    /// The largest grey level that there can be.
    pub fn highest(self) -> u16 {
        ((((1_u32 << self.used) - 1) << self.shift) & 0xffff) as u16
    }

    /// What is unusual about the depth, in words; `None` when all bits of the file are used.
    pub fn remark(self) -> Option<String> {
        let Self { stored, used, shift } = self;
        match (used < stored, shift) {
            (false, _) => None,
            (true, 0) => Some(format!("{stored} bit file, {used} bits used: grey levels 0..{}", self.highest())),
            (true, _) => {
                let step = 1 << shift;
                Some(format!("{stored} bit file, {used} bits used: grey levels are multiples of {step}"))
            }
        }
    }
}

/// Pixels at the two ends of the range of grey levels, where the camera shows no more difference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Saturation {
    /// The range of the pixels looked at.
    pub depth: GreyDepth,
    /// Pixels at 0.
    pub black: usize,
    /// Pixels at the largest level of the range.
    pub white: usize,
    /// Pixels looked at.
    pub n: usize,
}

impl Saturation {
    /// Counts the saturated pixels of `image` in the windows `[x0, y0, x1, y1]` (x1, y1 not included; what is outside
    /// the image does not count). A pixel in two windows counts twice. `None` for floats, whose range is not known.
    ///
    /// ```
    /// # use quadrille_base as quadrille;
    /// use quadrille::imaging::{Image, Pixels, Saturation};
    /// let image = Image::new(4, 1, Pixels::U16(vec![0, 4095, 4095, 7])).unwrap();
    /// let found = Saturation::of(&image, &[[0, 0, 4, 1]]).unwrap();
    /// assert_eq!((found.depth.used, found.black, found.white, found.percent()), (12, 1, 2, 75.0));
    /// ```
    pub fn of(image: &Image, windows: &[[usize; 4]]) -> Option<Self> {
        let (width, height) = (image.width(), image.height());
        let rows = windows.iter().flat_map(|&[x0, y0, x1, y1]| {
            let x1 = x1.min(width);
            (y0..y1.min(height)).filter(move |_| x0 < x1).map(move |y| y * width + x0..y * width + x1)
        });
        match image.pixels() {
            Levels::U8(levels) => {
                let mut found = Self { depth: GreyDepth { stored: 8, used: 8, shift: 0 }, black: 0, white: 0, n: 0 };
                rows.for_each(|row| levels[row].chunks(RUN).for_each(|run| found.count(run, u8::MAX)));
                Some(found)
            }
            Levels::U16(levels) => {
                let mut found = Self { depth: GreyDepth::of_bits(0), black: 0, white: 0, n: 0 };
                let mut bits = 0;
                for run in rows.flat_map(|row| levels[row].chunks(RUN)) {
                    bits |= bits_set(run);
                    let depth = GreyDepth::of_bits(bits);
                    if depth != found.depth {
                        // No level so far reaches the end of the larger range.
                        found.white = 0;
                        found.depth = depth;
                    }
                    found.count(run, depth.highest());
                }
                Some(found)
            }
            Levels::F32(_) => None,
        }
    }

    fn count<T: Level>(&mut self, run: &[T], highest: T) {
        let [black, white] = count_ends(run, highest);
        self.black += black;
        self.white += white;
        self.n += run.len();
    }

    /// Share of the pixels looked at, per cent.
    pub fn percent(self) -> f64 {
        if self.n == 0 { 0.0 } else { 100.0 * (self.black + self.white) as f64 / self.n as f64 }
    }
}

/// A whole grey level, wide enough to count [`SHORT`] pixels in a lane.
trait Level: Copy + PartialOrd + Default + AddAssign + From<bool> + Into<u64> {}

impl Level for u8 {}
impl Level for u16 {}

/// The bits that any of the levels has.
fn bits_set(levels: &[u16]) -> u16 {
    let (chunks, rest) = levels.as_chunks::<LANES>();
    let mut bits = [0; LANES];
    for chunk in chunks {
        for k in 0..LANES {
            bits[k] |= chunk[k];
        }
    }
    bits.iter().chain(rest).fold(0, |bits, &v| bits | v)
}

/// Levels that are 0, and those at `highest` or above.
fn count_ends<T: Level>(levels: &[T], highest: T) -> [usize; 2] {
    let (mut black, mut white) = (0, 0);
    for short in levels.chunks(SHORT * LANES) {
        let (chunks, rest) = short.as_chunks::<LANES>();
        // Counters as narrow as the levels, so that a vector holds as many.
        let (mut low, mut high) = ([T::default(); LANES], [T::default(); LANES]);
        for chunk in chunks {
            for k in 0..LANES {
                low[k] += T::from(chunk[k] == T::default());
                high[k] += T::from(chunk[k] >= highest);
            }
        }
        let sum = |counts: [T; LANES]| counts.into_iter().map(Into::into).sum::<u64>() as usize;
        black += sum(low) + rest.iter().filter(|&&v| v == T::default()).count();
        white += sum(high) + rest.iter().filter(|&&v| v >= highest).count();
    }
    [black, white]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::Pixels;

    #[test]
    fn the_depth_of_a_camera_is_found_from_the_bits_that_are_set() {
        for (levels, used, shift, highest) in [
            (vec![0_u16, 200], 8, 0, 255),
            (vec![3, 256], 10, 0, 1023),
            (vec![1024, 5], 12, 0, 4095),
            (vec![4096, 5], 14, 0, 16383),
            (vec![16384, 5], 16, 0, 65535),
            (vec![0x8010, 0x0120], 12, 4, 0xfff0),
            (vec![0x8040, 0x0140], 10, 6, 0xffc0),
            (vec![0x8004, 0x0108], 14, 2, 0xfffc),
            (vec![0x8100], 8, 8, 0xff00),
            // One empty bit is chance; a dark image is not shifted.
            (vec![0x8002, 0x0106], 16, 0, 65535),
            (vec![0x0010, 0x0120], 10, 0, 1023),
            (vec![0, 0], 8, 0, 255),
        ] {
            let n = levels.len();
            let image = Image::new(n, 1, Pixels::U16(levels.clone())).unwrap();
            let depth = GreyDepth::of(&image).unwrap();
            assert_eq!((depth.used, depth.shift, depth.highest()), (used, shift, highest), "{levels:?}");
        }
    }

    #[test]
    fn saturated_pixels_are_counted_in_the_windows_alone() {
        let (width, height) = (70_001, 3);
        let levels: Vec<u8> = (0..width * height).map(|at| if at % 2 == 0 { 255 } else { 0 }).collect();
        let image = Image::new(width, height, Pixels::U8(levels)).unwrap();
        let count = |windows: &[[usize; 4]]| {
            let found = Saturation::of(&image, windows).unwrap();
            (found.black, found.white, found.n)
        };
        // More pixels in a row than a narrow counter holds.
        assert_eq!(count(&[[0, 0, width, height]]), (105_001, 105_002, 210_003));
        assert_eq!(count(&[[1, 1, 4, 2]]), (1, 2, 3));
        assert_eq!(count(&[[width - 1, 2, width + 5, 9], [9, 0, 3, 2]]), (0, 1, 1));
        assert_eq!(Saturation::of(&image, &[]).unwrap().percent(), 0.0);
    }

    #[test]
    fn a_range_that_turns_out_larger_is_counted_anew() {
        // Row by row the levels seem to be of 8, 10 and 12 bits.
        let rows = [[255, 255, 255], [1023, 1023, 0], [4095, 4095, 4095], [4094, 4095, 1]];
        let white = |n: usize| {
            let image = Image::new(3, n, Pixels::U16(rows[..n].concat())).unwrap();
            let found = Saturation::of(&image, &[[0, 0, 3, n]]).unwrap();
            (found.depth.used, found.white)
        };
        assert_eq!([1, 2, 3, 4].map(white), [(8, 3), (10, 2), (12, 3), (12, 4)]);
        let shifted = vec![0xff00, 0xff00, 0xfff0, 0xfff0, 0xfff0, 0x0010];
        let image = Image::new(2, 3, Pixels::U16(shifted)).unwrap();
        let found = Saturation::of(&image, &[[0, 0, 2, 3]]).unwrap();
        assert_eq!((found.depth.used, found.depth.shift, found.white), (12, 4, 3));
    }
}
