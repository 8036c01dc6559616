//! A plane of `f32` with a border, laid out for unaligned vector loads.

/// Border on every side, px: the six taps of the quintic spline at a pixel just inside reach three
/// pixels out, and one more when the floor falls just outside.
pub(super) const BORDER: usize = 4;

/// Values beyond the last row that a vector load may touch.
const TAIL: usize = 64;

/// Row-major `f32` values with [`BORDER`] px around them.
#[derive(Debug, Clone)]
pub(super) struct Plane {
    pub width: usize,
    pub height: usize,
    pub stride: usize,
    pub data: Vec<f32>,
}

impl Plane {
    pub fn zeros(width: usize, height: usize) -> Self {
        let mut stride = (width + 2 * BORDER).next_multiple_of(16);
        if stride.is_multiple_of(1024) {
            stride += 16; // rows a multiple of 4 KiB apart would share cache sets
        }
        let data = vec![0.0; stride * (height + 2 * BORDER) + TAIL];
        Self { width, height, stride, data }
    }

    /// Index in `data` of the value at column `x`, row `y`, which may lie in the border.
    #[inline(always)]
    pub fn at(&self, x: isize, y: isize) -> usize {
        debug_assert!(x >= -(BORDER as isize) && y >= -(BORDER as isize));
        ((y + BORDER as isize) * self.stride as isize + x + BORDER as isize) as usize
    }

    /// Fills the border by reflection about the outermost pixel centres (the rule of the prefilter).
    pub fn reflect_border(&mut self) {
        let (width, height, border) = (self.width, self.height, BORDER as isize);
        for y in 0..height {
            let row = self.at(-border, y as isize);
            let row = &mut self.data[row..row + width + 2 * BORDER];
            for k in 1..=BORDER {
                row[BORDER - k] = row[BORDER + reflect(-(k as isize), width)];
                row[BORDER + width - 1 + k] = row[BORDER + reflect((width - 1 + k) as isize, width)];
            }
        }
        for k in 1..=border {
            for y in [-k, height as isize - 1 + k] {
                let from = self.at(-border, reflect(y, height) as isize);
                let to = self.at(-border, y);
                self.data.copy_within(from..from + width + 2 * BORDER, to);
            }
        }
    }
}

/// Index inside 0..n of the pixel that `at` is reflected to (about the first and last centre).
pub(super) fn reflect(at: isize, n: usize) -> usize {
    if n == 1 {
        return 0;
    }
    let period = 2 * (n as isize - 1);
    let k = at.rem_euclid(period);
    (if k < n as isize { k } else { period - k }) as usize
}
