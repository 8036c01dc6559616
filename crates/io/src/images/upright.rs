//! Pixels as a viewer shows them: turned as the camera that was held otherwise has noted.

use crate::imaging::Pixels;

/// How stored pixels lie: the number of EXIF and TIFF, 1 (upright) to 8.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Orientation(u8);

impl Orientation {
    pub const UPRIGHT: Self = Self(1);

    /// That of this number; upright where it is none.
    pub fn of(number: u64) -> Self {
        match number {
            2..=8 => Self(number as u8),
            _ => Self::UPRIGHT,
        }
    }

    /// Whether rows become columns.
    pub fn is_across(self) -> bool {
        self.0 >= 5
    }

    /// What is done to the pixels; `None` where nothing.
    pub fn note(self) -> Option<String> {
        let what = match self.0 {
            2 => "mirrored from left to right",
            3 => "turned by 180 degrees",
            4 => "mirrored from top to bottom",
            5 => "mirrored along the diagonal",
            6 => "turned by 90 degrees clockwise",
            7 => "mirrored along the other diagonal",
            8 => "turned by 90 degrees counter-clockwise",
            _ => return None,
        };
        Some(format!("{what}, as its orientation tag ({}) says", self.0))
    }

    /// The image of `width` columns upright: its size and pixels.
    pub fn upright(self, [width, height]: [usize; 2], pixels: Pixels) -> ([usize; 2], Pixels) {
        if self == Self::UPRIGHT {
            return ([width, height], pixels);
        }
        let pixels = match pixels {
            Pixels::U8(levels) => Pixels::U8(self.turn([width, height], &levels)),
            Pixels::U16(levels) => Pixels::U16(self.turn([width, height], &levels)),
            Pixels::F32(levels) => Pixels::F32(self.turn([width, height], &levels)),
        };
        (if self.is_across() { [height, width] } else { [width, height] }, pixels)
    }

    fn turn<T: Copy>(self, [width, height]: [usize; 2], stored: &[T]) -> Vec<T> {
        let (columns, rows) = if self.is_across() { (height, width) } else { (width, height) };
        let (right, low) = (width.saturating_sub(1), height.saturating_sub(1));
        let from = |x: usize, y: usize| match self.0 {
            2 => (right - x, y),
            3 => (right - x, low - y),
            4 => (x, low - y),
            5 => (y, x),
            6 => (y, low - x),
            7 => (right - y, low - x),
            8 => (right - y, x),
            _ => (x, y),
        };
        let all = (0..rows).flat_map(|y| (0..columns).map(move |x| from(x, y)));
        all.filter_map(|(x, y)| stored.get(y * width + x).copied()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_orientation_stands_upright() {
        // What viewers show of the rows 1 2 3 / 4 5 6: the number says where the first row and column lie.
        for (number, size, wanted) in [
            (1, [3, 2], [1, 2, 3, 4, 5, 6]),
            (2, [3, 2], [3, 2, 1, 6, 5, 4]),
            (3, [3, 2], [6, 5, 4, 3, 2, 1]),
            (4, [3, 2], [4, 5, 6, 1, 2, 3]),
            (5, [2, 3], [1, 4, 2, 5, 3, 6]),
            (6, [2, 3], [4, 1, 5, 2, 6, 3]),
            (7, [2, 3], [6, 3, 5, 2, 4, 1]),
            (8, [2, 3], [3, 6, 2, 5, 1, 4]),
            (9, [3, 2], [1, 2, 3, 4, 5, 6]),
        ] {
            let turned = Orientation::of(number).upright([3, 2], Pixels::U8(vec![1, 2, 3, 4, 5, 6]));
            assert_eq!(turned, (size, Pixels::U8(wanted.to_vec())), "{number}");
        }
    }
}
