//! Where in an image the specimen is: what carries texture, is not clipped, and hangs together.

use super::{GreyDepth, Image, Levels, Pixels};
use rayon::prelude::*;

/// Side of the cells in which texture is looked at, px.
const CELL: usize = 4;
/// Texture begins where the mean square gradient in the weakest direction is this many times what white noise puts
/// there: holes and dark backgrounds have 1 to 2, speckles in dim light 4, in good light 20 and more.
const ABOVE_NOISE: f32 = 2.5;
/// and this share of what the specimen has in its middle, an eighth in amplitude: machined or blurred is weaker.
const OF_TYPICAL: f32 = 1.0 / 64.0;
/// A cell takes part in the texture around it with this share of the mean square gradient there.
const OF_WINDOW: f32 = 0.2;
/// A window of which this share of pixels is black or white to the end of the range is clipped.
const CLIPPED: f32 = 0.5;
/// Speckles make one body when taking away what is narrower than a window leaves this share of them.
const SOLID: f64 = 0.95;
/// Parts smaller than this share of the largest are no bodies of their own.
const LEAST_PART: f64 = 0.1;
/// Elements are at least so large in means of pixels, px.
const LEAST_COARSE: usize = 8;
/// The smallest part worth measuring, in elements.
const LEAST_ELEMENTS: usize = 1;

/// The specimen in an image, in one part or several that do not touch.
#[derive(Debug, Clone, PartialEq)]
pub struct Specimen {
    /// Its parts, from the largest to the smallest; none when nothing in the image can be measured.
    pub parts: Vec<SpecimenPart>,
    /// What share of the image is left out, and why.
    pub left_out: LeftOut,
}

/// A part of the specimen.
#[derive(Debug, Clone, PartialEq)]
pub struct SpecimenPart {
    /// The box `[x0, y0, x1, y1]` around its pixels (x1, y1 not included).
    pub bounds: [usize; 4],
    /// Which pixels of the box belong to it, row by row; `None` for all.
    pub bits: Option<Vec<bool>>,
    /// Number of its pixels.
    pub n_pixels: usize,
}

impl SpecimenPart {
    /// Whether the pixel in column `x` and row `y` belongs to it.
    pub fn contains(&self, x: usize, y: usize) -> bool {
        let [x0, y0, x1, y1] = self.bounds;
        let inside = (x0..x1).contains(&x) && (y0..y1).contains(&y);
        inside && self.bits.as_ref().is_none_or(|bits| bits[(y - y0) * (x1 - x0) + x - x0])
    }
}

impl SpecimenPart {
    /// The largest rectangle `[x0, y0, x1, y1]` in it, to cells of 4 px or a 256th of its length.
    pub fn largest_rectangle(&self) -> [usize; 4] {
        let [x0, y0, x1, y1] = self.bounds;
        let cell = CELL.max((x1 - x0).max(y1 - y0) / 256);
        let columns = (x1 - x0) / cell;
        let is_in = |column: usize, y: usize| {
            let x = x0 + column * cell;
            (y..y + cell).all(|y| (x..x + cell).all(|x| self.contains(x, y)))
        };
        // Cells that hang on each column from above, and the largest rectangle that ends in this row.
        let (mut hanging, mut best) = (vec![0usize; columns], [0usize; 4]);
        let area = |[x0, y0, x1, y1]: [usize; 4]| (x1 - x0) * (y1 - y0);
        for y in (y0..=y1.saturating_sub(cell)).step_by(cell) {
            hanging.iter_mut().enumerate().for_each(|(column, n)| *n = if is_in(column, y) { *n + 1 } else { 0 });
            for first in 0..columns {
                let mut least = usize::MAX;
                for (last, &n) in hanging.iter().enumerate().skip(first).take_while(|(_, n)| **n > 0) {
                    least = least.min(n);
                    let found = [x0 + first * cell, y + cell - least * cell, x0 + (last + 1) * cell, y + cell];
                    best = if area(found) > area(best) { found } else { best };
                }
            }
        }
        best
    }
}

impl SpecimenPart {
    /// What of it lies in these boxes `[x0, y0, x1, y1]`; `None` without any.
    pub fn within(&self, boxes: &[[usize; 4]]) -> Option<Self> {
        let bounds = boxes.iter().copied().reduce(around)?;
        let width = bounds[2] - bounds[0];
        let mut bits = vec![false; width * (bounds[3] - bounds[1])];
        for &[x0, y0, x1, y1] in boxes {
            for (x, y) in (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y))) {
                bits[(y - bounds[1]) * width + x - bounds[0]] = self.contains(x, y);
            }
        }
        let n_pixels = bits.iter().filter(|bit| **bit).count();
        Some(Self { bounds, bits: Some(bits), n_pixels })
    }

    /// All of the parts as one; `None` without any.
    pub fn joined(parts: &[Self]) -> Option<Self> {
        let bounds = parts.iter().map(|part| part.bounds).reduce(around)?;
        let [x0, y0, x1, y1] = bounds;
        let pixels = (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y)));
        let bits = pixels.map(|(x, y)| parts.iter().any(|part| part.contains(x, y))).collect();
        Some(Self { bounds, bits: Some(bits), n_pixels: parts.iter().map(|part| part.n_pixels).sum() })
    }

    /// The same in an image of twice as many columns and rows.
    fn doubled(self) -> Self {
        let [x0, y0, x1, y1] = self.bounds;
        let width = x1 - x0;
        let of_rows = |bits: Vec<bool>| {
            let twice = |row: &[bool]| row.iter().flat_map(|&bit| [bit, bit]).collect::<Vec<_>>().repeat(2);
            bits.chunks(width.max(1)).flat_map(twice).collect()
        };
        let bounds = [x0, y0, x1, y1].map(|at| 2 * at);
        Self { bounds, bits: self.bits.map(of_rows), n_pixels: 4 * self.n_pixels }
    }
}

/// The box around two boxes `[x0, y0, x1, y1]`.
fn around(a: [usize; 4], b: [usize; 4]) -> [usize; 4] {
    [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])]
}

/// Shares of an image (0 to 1) that are not specimen.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LeftOut {
    /// Without texture: holes, background, what is out of focus; and the edge of the specimen.
    pub textureless: f64,
    /// At the ends of the range of grey levels.
    pub saturated: f64,
    /// Textured, but apart from the rest and small, or too narrow for an element.
    pub apart: f64,
    /// Along the border of the image.
    pub border: f64,
}

impl Specimen {
    /// Looks for the specimen in `image`, for elements of `size` px: where the gradient in its weakest direction stands
    /// above noise, over windows of an element and a half; without what is clipped, without spots and threads that hold
    /// no element, and `margin` px away from the border of the image. The outermost cells of a border beside a place
    /// without texture are left out, since they hold the step to it; holes smaller than an element are not cut out.
    /// Where noise hides the texture everywhere, it is looked for in the mean of 2 x 2 pixels, as long as elements have
    /// 8 px there: of speckles that are many pixels wide the noise falls and the gradient stays.
    ///
    /// The result does not depend on the number of threads (THEORY 2).
    ///
    /// ```
    /// # use quadrille_base as quadrille;
    /// use quadrille::imaging::{Image, Pixels, Specimen};
    /// // Speckles on the left half, nothing on the right.
    /// let grey = |x: usize, y: usize| if x < 64 { (x / 3 * 7 + y / 3 * 5 + x / 3 * (y / 3)) % 4 * 60 } else { 20 };
    /// let levels = (0..128 * 128).map(|at| grey(at % 128, at / 128) as u8).collect();
    /// let image = Image::new(128, 128, Pixels::U8(levels)).unwrap();
    /// let found = Specimen::find(&image, 16, 8);
    /// let [x0, _, x1, _] = found.parts[0].bounds;
    /// assert!(x0 == 8 && (52..=64).contains(&x1));
    /// ```
    pub fn find(image: &Image, size: usize, margin: usize) -> Self {
        let found = Self::find_in(image, size, margin);
        let halved = if found.parts.is_empty() && size / 2 >= LEAST_COARSE { halved(image) } else { None };
        let coarse = halved.map(|halved| Self::find(&halved, size / 2, margin.div_ceil(2)));
        match coarse.filter(|coarse| !coarse.parts.is_empty()) {
            Some(Self { parts, left_out }) => {
                Self { parts: parts.into_iter().map(SpecimenPart::doubled).collect(), left_out }
            }
            None => found,
        }
    }

    fn find_in(image: &Image, size: usize, margin: usize) -> Self {
        let (width, height) = (image.width(), image.height());
        let reach = ((size + CELL) / (2 * CELL)).max(1);
        let cells = Cells::of(image);
        let Classes { textured, clipped } = cells.classes(reach, floor_of(image));
        let grid = textured.grid;
        let found = textured.opened(reach).eroded(1).opened(reach);
        let mut left_out = LeftOut::default();
        let least = LEAST_ELEMENTS * size * size / (CELL * CELL);
        let kept = found.parts(least.max(1));
        let frame = [margin, margin, width.saturating_sub(margin), height.saturating_sub(margin)];
        let mut parts: Vec<SpecimenPart> =
            kept.iter().filter_map(|part| part_of_cells(part, frame, [width, height])).collect();
        parts.retain(|part| part.n_pixels >= LEAST_ELEMENTS * size * size);
        parts.sort_by(|a, b| b.n_pixels.cmp(&a.n_pixels).then(a.bounds.cmp(&b.bounds)));
        // What is left out, by its first reason, in pixels of the cells.
        for row in 0..grid.rows {
            for column in 0..grid.columns {
                let at = row * grid.columns + column;
                let [x0, y0, x1, y1] = grid.pixels(column, row, [width, height]);
                let n = ((x1 - x0) * (y1 - y0)) as f64;
                if kept.iter().any(|part| part.bits[at]) {
                    let across = |a: usize, b: usize, low: usize, high: usize| b.min(high).saturating_sub(a.max(low));
                    let inside = across(x0, x1, frame[0], frame[2]) * across(y0, y1, frame[1], frame[3]);
                    left_out.border += n - inside as f64;
                } else if clipped.bits[at] {
                    left_out.saturated += n;
                } else if textured.bits[at] && !found.bits[at] && cells.is_step(&found, at) {
                    left_out.textureless += n;
                } else if textured.bits[at] {
                    left_out.apart += n;
                } else {
                    left_out.textureless += n;
                }
            }
        }
        let all = (width * height) as f64;
        let LeftOut { textureless, saturated, apart, border } = left_out;
        let [textureless, saturated, apart, border] = [textureless, saturated, apart, border].map(|n| n / all);
        Self { parts, left_out: LeftOut { textureless, saturated, apart, border } }
    }

    /// Share of the image that it covers.
    pub fn share(&self, image: &Image) -> f64 {
        let n: usize = self.parts.iter().map(|part| part.n_pixels).sum();
        n as f64 / (image.width() * image.height()) as f64
    }
}

/// The means of 2 x 2 pixels; none of an image that has not as many.
fn halved(image: &Image) -> Option<Image> {
    let [width, height] = [image.width() / 2, image.height() / 2];
    let mean = |at: usize| {
        let (x, y) = (2 * (at % width), 2 * (at / width));
        0.25 * (image.grey(x, y) + image.grey(x + 1, y) + image.grey(x, y + 1) + image.grey(x + 1, y + 1))
    };
    let means = (0..width * height).into_par_iter().map(mean).collect();
    Image::new(width, height, Pixels::F32(means)).ok()
}

/// Noise that no image is without, grey levels: that of rounding, or what floats of this range could hardly show.
fn floor_of(image: &Image) -> f32 {
    match image.pixels() {
        Levels::F32(_) => {
            let (low, high) = image.range();
            1e-4 * (high - low)
        }
        _ => 1.0 / 12f32.sqrt(),
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct CellGrid {
    columns: usize,
    rows: usize,
}

impl CellGrid {
    fn pixels(self, column: usize, row: usize, [width, height]: [usize; 2]) -> [usize; 4] {
        let end = |k: usize, n: usize| ((k + 1) * CELL).min(n);
        [column * CELL, row * CELL, end(column, width), end(row, height)]
    }
}

/// Sums over a cell: squares and product of the gradient, square and number of fourth differences, clipped, pixels.
const N_SUMS: usize = 7;
type Sums = [f32; N_SUMS];
struct Cells {
    grid: CellGrid,
    sums: Vec<Sums>,
}

struct Window {
    /// Mean square of the gradient in its weakest direction, and of both components together.
    weakest: f32,
    both: f32,
    /// Whether the weakest stands above noise.
    is_above: bool,
    is_clipped: bool,
}

impl Window {
    fn of(sums: &Sums, floor: f32) -> Self {
        let n = sums[6].max(1.0);
        let [xx, xy, yy] = [0, 1, 2].map(|k| sums[k] / n);
        let weakest = (0.5 * (xx + yy) - (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt()).max(0.0);
        let noise = (sums[3] / sums[4].max(1.0)).max(floor * floor);
        // White noise has half of its variance in each component of this gradient.
        let is_above = weakest > ABOVE_NOISE * 0.5 * noise;
        Self { weakest, both: xx + yy, is_above, is_clipped: sums[5] > CLIPPED * sums[6] }
    }
}

struct Classes {
    textured: Marks,
    clipped: Marks,
}

impl Cells {
    fn of(image: &Image) -> Self {
        let grid = CellGrid { columns: image.width().div_ceil(CELL), rows: image.height().div_ceil(CELL) };
        let ends = GreyDepth::of(image).map(|depth| [0.0, f32::from(depth.highest())]);
        let rows = (0..grid.rows).into_par_iter().map(|row| row_of_cells(image, row, grid.columns, ends));
        Self { grid, sums: rows.collect::<Vec<_>>().concat() }
    }

    /// Which cells carry texture within `reach` cells around them, and which are clipped.
    fn classes(&self, reach: usize, floor: f32) -> Classes {
        let grid = self.grid;
        let window: Vec<Window> =
            box_sums(&self.sums, grid, reach).par_iter().map(|sums| Window::of(sums, floor)).collect();
        let mut powers: Vec<f32> = window.iter().filter(|w| w.is_above && !w.is_clipped).map(|w| w.weakest).collect();
        let middle = powers.len() / 2;
        let typical = if powers.is_empty() { 0.0 } else { *powers.select_nth_unstable_by(middle, f32::total_cmp).1 };
        let enough: Vec<bool> =
            window.iter().map(|w| w.is_above && !w.is_clipped && w.weakest > OF_TYPICAL * typical).collect();
        // A window reaches over the border of what is textured by half its width; single cells do not.
        let alive = self.sums.iter().zip(&window).map(|(own, around)| {
            let own = (own[0] + own[2]) / own[6].max(1.0);
            own > OF_WINDOW * around.both && own > OF_TYPICAL * typical
        });
        let alive = Marks { grid, bits: alive.collect() };
        // Gaps between speckles are closed, as few as it takes: a narrow joint between two strips is to stay open.
        let closed = |gap: usize| {
            let bits = alive.closed(gap).bits.iter().zip(&enough).map(|(a, b)| *a && *b).collect();
            Marks { grid, bits }.without_small_holes((2 * reach + 2).pow(2))
        };
        let is_solid = |marks: &Marks| marks.opened(reach).count() as f64 >= SOLID * marks.count() as f64;
        let textured = (1..reach).map(closed).find(is_solid).unwrap_or_else(|| closed(reach));
        let clipped = window.iter().map(|w| w.is_clipped).collect();
        Classes { textured, clipped: Marks { grid, bits: clipped } }
    }

    /// Whether a cell lies beside what was found: the outermost ones, with the step to what is around.
    fn is_step(&self, found: &Marks, at: usize) -> bool {
        let (column, row) = (at % self.grid.columns, at / self.grid.columns);
        let beside = |k: usize, n: usize| k.saturating_sub(1)..(k + 2).min(n);
        beside(row, self.grid.rows)
            .any(|row| beside(column, self.grid.columns).any(|column| found.bits[row * self.grid.columns + column]))
    }
}

fn row_of_cells(image: &Image, row: usize, columns: usize, ends: Option<[f32; 2]>) -> Vec<Sums> {
    let (width, height) = (image.width(), image.height());
    let mut sums = vec![[0.0; N_SUMS]; columns];
    let first = row * CELL;
    let n_rows = CELL.min(height - first);
    // The rows looked at and those beside them, two columns more on either side; beyond the image its border.
    let n_lines = if n_rows > 2 { 6 } else { 5 };
    let lines: Vec<Vec<f32>> =
        (0..n_lines).map(|k| line(image, (first + k).saturating_sub(2).min(height - 1))).collect();
    // By row first and by cell then: what is done to single pixels runs in vectors.
    let mut of_pixels = vec![0.0f32; width];
    let mut across = vec![0.0f32; width + 4];
    // Every other row is enough.
    for k in (0..n_rows).step_by(2) {
        let [above, own, below] = [1, 2, 3].map(|j| &lines[k + j][..width + 4]);
        let y = first + k;
        let mut add = |which: usize, of_pixel: &dyn Fn(&mut [f32])| {
            of_pixel(&mut of_pixels);
            for (sums, pixels) in sums.iter_mut().zip(of_pixels.chunks(CELL)) {
                sums[which] += pixels.iter().sum::<f32>();
            }
        };
        let (left, right) = (&own[1..width + 1], &own[3..width + 3]);
        let (up, down) = (&above[2..width + 2], &below[2..width + 2]);
        let gx = |x: usize| 0.5 * (right[x] - left[x]);
        let gy = |x: usize| 0.5 * (down[x] - up[x]);
        add(0, &|out| (0..width).for_each(|x| out[x] = gx(x) * gx(x)));
        add(1, &|out| (0..width).for_each(|x| out[x] = gx(x) * gy(x)));
        add(2, &|out| (0..width).for_each(|x| out[x] = gy(x) * gy(x)));
        if let Some([black, white]) = ends {
            let own = &own[2..width + 2];
            let is_end = |grey: f32| f32::from(u8::from(grey <= black) | u8::from(grey >= white));
            add(5, &|out| (0..width).for_each(|x| out[x] = is_end(own[x])));
        }
        (0..columns).for_each(|cell| sums[cell][6] += (((cell + 1) * CELL).min(width) - cell * CELL) as f32);
        // Fourth differences along both axes, which texture that a camera resolves hardly has: of the first row, and
        // where the border of the image is not reached.
        if k > 0 || y < 2 || y + 2 >= height || width < 5 {
            continue;
        }
        let [above2, below2] = [0, 4].map(|j| &lines[j][..width + 4]);
        for x in 0..width + 4 {
            across[x] = above2[x] - 4.0 * above[x] + 6.0 * own[x] - 4.0 * below[x] + below2[x];
        }
        let across = &across[..width + 4];
        // The squares of the mask's 25 weights add up to 70^2.
        let fourth = |x: usize| {
            let c: &[f32; 5] = across[x..x + 5].try_into().unwrap_or(&[0.0; 5]);
            let difference = c[0] - 4.0 * c[1] + 6.0 * c[2] - 4.0 * c[3] + c[4];
            difference * difference / 4900.0
        };
        of_pixels.fill(0.0);
        (2..width - 2).for_each(|x| of_pixels[x] = fourth(x));
        for (cell, (sums, pixels)) in sums.iter_mut().zip(of_pixels.chunks(CELL)).enumerate() {
            sums[3] += pixels.iter().sum::<f32>();
            sums[4] += (((cell + 1) * CELL).min(width - 2)).saturating_sub((cell * CELL).max(2)) as f32;
        }
    }
    sums
}

/// Row `y` of the image with its first and last grey level twice more.
fn line(image: &Image, y: usize) -> Vec<f32> {
    let width = image.width();
    let row = image.pixels().floats(y * width..(y + 1) * width);
    let (first, last) = (row[0], row[width - 1]);
    [&[first; 2][..], &row, &[last; 2]].concat()
}

/// Sums over the box of `reach` cells around each cell, cut at the border.
fn box_sums(sums: &[Sums], grid: CellGrid, reach: usize) -> Vec<Sums> {
    let CellGrid { columns, rows } = grid;
    let add = |sum: &mut Sums, one: &Sums| (0..N_SUMS).for_each(|c| sum[c] += one[c]);
    let mut along = vec![[0.0; N_SUMS]; sums.len()];
    along.par_chunks_mut(columns).zip(sums.par_chunks(columns)).for_each(|(out, line)| {
        for (k, sum) in out.iter_mut().enumerate() {
            let around = &line[k.saturating_sub(reach)..(k + reach + 1).min(columns)];
            around.iter().for_each(|one| add(sum, one));
        }
    });
    let mut window = vec![[0.0; N_SUMS]; sums.len()];
    window.par_chunks_mut(columns).enumerate().for_each(|(row, out)| {
        for other in row.saturating_sub(reach)..(row + reach + 1).min(rows) {
            out.iter_mut().zip(&along[other * columns..]).for_each(|(sum, one)| add(sum, one));
        }
    });
    window
}

/// Marked cells. Beyond the border of the image nothing is known: there every cell is as its neighbours would have it.
#[derive(Debug, Clone, PartialEq)]
struct Marks {
    grid: CellGrid,
    bits: Vec<bool>,
}

impl Marks {
    /// The cells within `reach` of which, along both axes, one is `wanted`.
    fn near(&self, wanted: bool, reach: usize) -> Vec<bool> {
        let CellGrid { columns, rows } = self.grid;
        let bits: Vec<bool> = self.bits.iter().map(|&bit| bit == wanted).collect();
        let mut along = vec![false; bits.len()];
        for (line, out) in bits.chunks(columns).zip(along.chunks_mut(columns)) {
            // Cells until the end of what the last one found reaches.
            let pass = |left: usize, k: usize, out: &mut [bool]| {
                let left = if line[k] { reach + 1 } else { left };
                out[k] |= left > 0;
                left.saturating_sub(1)
            };
            (0..columns).fold(0, |left, k| pass(left, k, out));
            (0..columns).rev().fold(0, |left, k| pass(left, k, out));
        }
        let mut near = vec![false; bits.len()];
        for (row, out) in near.chunks_mut(columns).enumerate() {
            for other in row.saturating_sub(reach)..(row + reach + 1).min(rows) {
                out.iter_mut().zip(&along[other * columns..]).for_each(|(near, along)| *near |= *along);
            }
        }
        near
    }

    fn count(&self) -> usize {
        self.bits.iter().filter(|&&bit| bit).count()
    }

    fn dilated(&self, reach: usize) -> Self {
        Self { grid: self.grid, bits: self.near(true, reach) }
    }

    fn eroded(&self, reach: usize) -> Self {
        Self { grid: self.grid, bits: self.near(false, reach).into_iter().map(|near| !near).collect() }
    }

    fn closed(&self, reach: usize) -> Self {
        self.dilated(reach).eroded(reach)
    }

    /// Without what a box of `2 reach + 1` cells does not fit in.
    fn opened(&self, reach: usize) -> Self {
        let opened = self.eroded(reach).dilated(reach);
        Self { grid: self.grid, bits: opened.bits.iter().zip(&self.bits).map(|(a, b)| *a && *b).collect() }
    }

    /// The connected pieces of cells that are `wanted`.
    fn pieces(&self, wanted: bool) -> Vec<Vec<usize>> {
        let CellGrid { columns, rows } = self.grid;
        let mut seen = vec![false; self.bits.len()];
        let mut pieces = Vec::new();
        for start in 0..self.bits.len() {
            if seen[start] || self.bits[start] != wanted {
                continue;
            }
            seen[start] = true;
            let mut piece = vec![start];
            let mut next = 0;
            while let Some(&at) = piece.get(next) {
                next += 1;
                let (column, row) = (at % columns, at / columns);
                let beside = [
                    (column > 0).then(|| at - 1),
                    (column + 1 < columns).then(|| at + 1),
                    (row > 0).then(|| at - columns),
                    (row + 1 < rows).then(|| at + columns),
                ];
                for other in beside.into_iter().flatten() {
                    if !seen[other] && self.bits[other] == wanted {
                        seen[other] = true;
                        piece.push(other);
                    }
                }
            }
            pieces.push(piece);
        }
        pieces
    }

    /// With the holes of fewer than `least` cells filled.
    fn without_small_holes(mut self, least: usize) -> Self {
        let holes = self.pieces(false).into_iter().filter(|hole| hole.len() < least);
        holes.flatten().for_each(|at| self.bits[at] = true);
        self
    }

    /// Its connected pieces, without those of fewer than `least` cells or of a small share of the largest.
    fn parts(&self, least: usize) -> Vec<Self> {
        let pieces = self.pieces(true);
        let largest = pieces.iter().map(Vec::len).max().unwrap_or(0);
        let enough = |piece: &&Vec<usize>| piece.len() >= least && piece.len() as f64 >= LEAST_PART * largest as f64;
        let marks = |piece: &Vec<usize>| {
            let mut bits = vec![false; self.bits.len()];
            piece.iter().for_each(|&at| bits[at] = true);
            Self { grid: self.grid, bits }
        };
        pieces.iter().filter(enough).map(marks).collect()
    }
}

fn part_of_cells(cells: &Marks, frame: [usize; 4], image: [usize; 2]) -> Option<SpecimenPart> {
    let CellGrid { columns, .. } = cells.grid;
    let marked = || cells.bits.iter().enumerate().filter(|(_, bit)| **bit).map(|(at, _)| (at % columns, at / columns));
    let mut bounds: Option<[usize; 4]> = None;
    let cut = |[x0, y0, x1, y1]: [usize; 4]| [x0.max(frame[0]), y0.max(frame[1]), x1.min(frame[2]), y1.min(frame[3])];
    let is_any = |[x0, y0, x1, y1]: &[usize; 4]| x0 < x1 && y0 < y1;
    let boxes = || marked().map(|(column, row)| cut(cells.grid.pixels(column, row, image))).filter(is_any);
    for [x0, y0, x1, y1] in boxes() {
        let [a0, b0, a1, b1] = bounds.unwrap_or([x0, y0, x1, y1]);
        bounds = Some([a0.min(x0), b0.min(y0), a1.max(x1), b1.max(y1)]);
    }
    let bounds = bounds?;
    let [left, top, right, bottom] = bounds;
    let width = right - left;
    let mut bits = vec![false; width * (bottom - top)];
    let mut n_pixels = 0;
    for [x0, y0, x1, y1] in boxes() {
        (y0..y1).for_each(|y| bits[(y - top) * width + x0 - left..(y - top) * width + x1 - left].fill(true));
        n_pixels += (x1 - x0) * (y1 - y0);
    }
    let bits = (n_pixels < bits.len()).then_some(bits);
    Some(SpecimenPart { bounds, bits, n_pixels })
}
