//! Which pixels belong to a zone.

/// A set of pixels of an image.
#[derive(Debug, Clone, PartialEq)]
pub enum PixelSet {
    /// Columns x0..x1 of rows y0..y1.
    Box {
        /// First column.
        x0: usize,
        /// First row.
        y0: usize,
        /// Column after the last.
        x1: usize,
        /// Row after the last.
        y1: usize,
    },
    /// Any pixels, by a raster.
    Raster {
        /// Column of the raster's first pixel.
        x0: usize,
        /// Row of the raster's first pixel.
        y0: usize,
        /// Columns of the raster.
        width: usize,
        /// Whether a pixel belongs to the set, row by row.
        bits: Vec<bool>,
    },
}

impl PixelSet {
    /// Whether the pixel in column `x` and row `y` belongs to the set.
    pub fn contains(&self, x: usize, y: usize) -> bool {
        match self {
            Self::Box { x0, y0, x1, y1 } => (*x0..*x1).contains(&x) && (*y0..*y1).contains(&y),
            Self::Raster { x0, y0, width, bits } => {
                let inside = x >= *x0 && x < x0 + width && y >= *y0;
                inside && bits.get((y - y0) * width + x - x0).copied().unwrap_or(false)
            }
        }
    }

    /// The smallest box `[x0, y0, x1, y1]`, the last two excluded, of the set's pixels; `None` for the empty set.
    pub fn bounds(&self) -> Option<[usize; 4]> {
        match self {
            Self::Box { x0, y0, x1, y1 } => (x0 < x1 && y0 < y1).then_some([*x0, *y0, *x1, *y1]),
            Self::Raster { x0, y0, width, bits } => {
                let mut bounds: Option<[usize; 4]> = None;
                for at in bits.iter().enumerate().filter(|(_, bit)| **bit).map(|(at, _)| at) {
                    let (x, y) = (x0 + at % width, y0 + at / width);
                    let [bx0, by0, bx1, by1] = bounds.unwrap_or([x, y, x, y]);
                    bounds = Some([bx0.min(x), by0.min(y), bx1.max(x + 1), by1.max(y + 1)]);
                }
                bounds
            }
        }
    }

    /// Number of pixels of the set in columns `x0..x1` and rows `y0..y1`.
    pub fn count(&self, [x0, y0, x1, y1]: [usize; 4]) -> usize {
        match self {
            Self::Box { x0: bx0, y0: by0, x1: bx1, y1: by1 } => {
                let overlap = |a: usize, b: usize, c: usize, d: usize| b.min(d).saturating_sub(a.max(c));
                overlap(x0, x1, *bx0, *bx1) * overlap(y0, y1, *by0, *by1)
            }
            Self::Raster { .. } => (y0..y1).map(|y| (x0..x1).filter(|&x| self.contains(x, y)).count()).sum(),
        }
    }

    /// The set on the image of half the size: pixels at least two of whose four belong to it.
    pub fn halved(&self) -> Self {
        match self {
            Self::Box { x0, y0, x1, y1 } => {
                Self::Box { x0: x0 / 2, y0: y0 / 2, x1: x1.div_ceil(2), y1: y1.div_ceil(2) }
            }
            Self::Raster { x0, y0, width, bits } => {
                let height = bits.len() / (*width).max(1);
                let half = [x0 / 2, y0 / 2, (x0 + width).div_ceil(2), (y0 + height).div_ceil(2)];
                Self::raster(half, |x, y| self.count([2 * x, 2 * y, 2 * x + 2, 2 * y + 2]) >= 2)
            }
        }
    }

    /// The set of the pixels for which `inside` holds, within the box.
    pub(super) fn raster([x0, y0, x1, y1]: [usize; 4], inside: impl Fn(usize, usize) -> bool) -> Self {
        let bits = (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y))).map(|(x, y)| inside(x, y)).collect();
        Self::Raster { x0, y0, width: x1.saturating_sub(x0), bits }
    }
}
