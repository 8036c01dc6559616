//! Images that are not whole: rows or columns of one grey level where the reference has texture.

use super::image::Image;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Side of the blocks that are looked at, px.
const BLOCK: usize = 16;
/// Share of the blocks across a window that have one grey level in a blank row or column,
const BLANK: f64 = 0.95;
/// and at most have it in the reference.
const TEXTURED: f64 = 0.5;

/// Which blocks of an image have one grey level.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FlatBlocks {
    columns: usize,
    rows: usize,
    flat: Vec<bool>,
}

/// Rows or columns of one grey level.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Blank {
    /// From a first to a last row, px.
    Rows(usize, usize),
    /// From a first to a last column, px.
    Columns(usize, usize),
}

impl fmt::Display for Blank {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (what, first, last) = match self {
            Self::Rows(first, last) => ("rows", first, last),
            Self::Columns(first, last) => ("columns", first, last),
        };
        write!(
            f,
            "{what} {first} to {last} have one grey level each across the zones, where the reference has texture: the image is \
             half black, torn, or not whole"
        )
    }
}

impl FlatBlocks {
    /// Those of `image`; pixels right of and below the last whole block are not looked at.
    pub fn of(image: &Image) -> Self {
        let (columns, rows) = (image.width() / BLOCK, image.height() / BLOCK);
        let flat = |block: usize| {
            let (x, y) = (BLOCK * (block % columns), BLOCK * (block / columns));
            let first = image.grey(x, y);
            (y..y + BLOCK).all(|v| (x..x + BLOCK).all(|u| image.grey(u, v) == first))
        };
        Self { columns, rows, flat: (0..columns * rows).map(flat).collect() }
    }

    /// Rows, or else columns, that have one grey level all across one of the windows `[x0, y0, x1, y1]` (x1, y1 not
    /// included), and not in the `reference`; `None` of a whole image.
    ///
    /// ```
    /// # use quadrille_base as quadrille;
    /// use quadrille::imaging::{Blank, FlatBlocks, Image, Pixels};
    /// let texture = |k: usize| (k * k % 251) as u8;
    /// let image = |whole: usize| {
    ///     Image::new(64, 64, Pixels::U8((0..64 * 64).map(|k| if k < 64 * whole { texture(k) } else { 0 }).collect())).unwrap()
    /// };
    /// let [reference, half] = [64, 32].map(|whole| FlatBlocks::of(&image(whole)));
    /// assert_eq!(half.blank(&reference, &[[0, 0, 64, 64]]), Some(Blank::Rows(32, 63)));
    /// assert_eq!(reference.blank(&reference, &[[0, 0, 64, 64]]), None);
    /// ```
    pub fn blank(&self, reference: &Self, windows: &[[usize; 4]]) -> Option<Blank> {
        if (self.columns, self.rows) != (reference.columns, reference.rows) {
            return None;
        }
        let mut found: Option<Blank> = None;
        for by_rows in [true, false] {
            for &[x0, y0, x1, y1] in windows {
                let inside = |a: usize, b: usize, n: usize| a.div_ceil(BLOCK)..(b / BLOCK).min(n);
                let (across, along) = match by_rows {
                    true => (inside(x0, x1, self.columns), inside(y0, y1, self.rows)),
                    false => (inside(y0, y1, self.rows), inside(x0, x1, self.columns)),
                };
                if across.len() < 2 {
                    continue;
                }
                let share = |of: &Self, line: usize| {
                    let at = |k: usize| if by_rows { line * of.columns + k } else { k * of.columns + line };
                    across.clone().filter(|&k| of.flat[at(k)]).count() as f64 / across.len() as f64
                };
                for line in along.filter(|&line| share(self, line) >= BLANK && share(reference, line) <= TEXTURED) {
                    let [first, last] = [BLOCK * line, BLOCK * line + BLOCK - 1];
                    found = Some(match found {
                        Some(Blank::Rows(a, b)) if by_rows => Blank::Rows(a.min(first), b.max(last)),
                        Some(Blank::Columns(a, b)) => Blank::Columns(a.min(first), b.max(last)),
                        _ if by_rows => Blank::Rows(first, last),
                        _ => Blank::Columns(first, last),
                    });
                }
            }
            if found.is_some() {
                return found;
            }
        }
        None
    }
}
