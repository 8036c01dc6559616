//! A plane of values with a border, laid out for unaligned vector loads.

use super::memory::{Pages, Pool};
use crate::backend::BackendError;

/// Border on every side, px: a whole cache line, so that column 0 starts one. The six taps of the quintic
/// spline at a pixel just inside reach three pixels out, and one more when the floor falls just outside.
pub(super) const BORDER: usize = LANES;
const LANES: usize = 16;

/// Values beyond the last row that a vector load may touch.
const TAIL: usize = 4 * LANES;

/// Border above and below, px.
pub(super) const BORDER_ROWS: usize = 4;

/// Row-major values with [`BORDER`] px around them.
#[derive(Debug)]
pub(super) struct Plane {
    pub width: usize,
    pub height: usize,
    pub stride: usize,
    values: Pages<f32>,
}

impl Plane {
    /// A plane for `width` x `height` px; what it holds is arbitrary but finite.
    pub fn new(pool: &Pool, width: usize, height: usize) -> Result<Self, BackendError> {
        let mut stride = (width + 2 * BORDER).next_multiple_of(LANES);
        if stride.is_multiple_of(1024) {
            stride += LANES; // rows a multiple of 4 KiB apart would share cache sets
        }
        let values = pool.pages(stride * (height + 2 * BORDER_ROWS) + TAIL, "an image plane")?;
        Ok(Self { width, height, stride, values })
    }

    /// The values, border included.
    pub fn data(&self) -> &[f32] {
        self.values.data()
    }

    /// The values, to be written.
    pub fn data_mut(&mut self) -> &mut [f32] {
        self.values.data_mut()
    }

    /// Index in `data` of the value at column `x`, row `y`, which may lie in the border.
    #[inline(always)]
    pub fn at(&self, x: isize, y: isize) -> usize {
        index(self.stride, x, y)
    }

    /// The plane as kernels read it: the slice is taken once, not at every access.
    pub fn view(&self) -> View<'_> {
        View { width: self.width, height: self.height, stride: self.stride, data: self.data() }
    }

    /// Fills the border by continuation through the outermost pixels, `c(-k) = 2 c(0) - c(k)` (the rule of
    /// the prefilter).
    pub fn continue_border(&mut self) {
        let (width, height, stride) = (self.width, self.height, self.stride);
        let first = self.at(0, 0);
        let data = self.data_mut();
        let through = |end: f32, inner: f32| 2.0 * end - inner;
        // Only the taps' reach: the rest of the left and right border is never read into a result.
        for row in data[first - BORDER..].chunks_mut(stride).take(height) {
            let last = BORDER + width - 1;
            for k in 1..=BORDER_ROWS {
                let inner = k.min(width - 1);
                row[BORDER - k] = through(row[BORDER], row[BORDER + inner]);
                row[last + k] = through(row[last], row[last - inner]);
            }
        }
        let row_start = |y: isize| (first - BORDER).wrapping_add_signed(y * stride as isize);
        for k in 1..=BORDER_ROWS as isize {
            let last = height as isize - 1;
            let inner = k.min(last);
            for (to, end, from) in [(-k, 0, inner), (last + k, last, last - inner)] {
                let (to, end, from) = (row_start(to), row_start(end), row_start(from));
                for x in 0..width + 2 * BORDER {
                    data[to + x] = through(data[end + x], data[from + x]);
                }
            }
        }
    }
}

/// A borrowed plane.
#[derive(Debug, Clone, Copy)]
pub(super) struct View<'a> {
    pub width: usize,
    pub height: usize,
    pub stride: usize,
    pub data: &'a [f32],
}

impl View<'_> {
    /// As [`Plane::at`].
    #[inline(always)]
    pub fn at(&self, x: isize, y: isize) -> usize {
        index(self.stride, x, y)
    }
}

#[inline(always)]
fn index(stride: usize, x: isize, y: isize) -> usize {
    debug_assert!(x >= -(BORDER as isize) && y >= -(BORDER_ROWS as isize));
    ((y + BORDER_ROWS as isize) * stride as isize + x + BORDER as isize) as usize
}
