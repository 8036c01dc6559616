//! Images on the device.

use super::device::{Buffer, Gpu, MOST_GROUPS};
use super::layout;
use super::shader::Kernel;
use crate::backend::pyramid::Pyramid;
use crate::backend::spline::{at_pixel, causal_start};
use crate::backend::{BackendError, KernelOptions, Traffic};
use crate::imaging::{Image, Interpolation, Levels};
use bytemuck::Zeroable;
use std::ops::Range;
use std::sync::Arc;

/// Columns and rows of border around a plane; the same in `shaders/shared/types.wgsl`.
pub(super) const BORDER: usize = 4;

/// Columns and rows of a piece of the prefilter; the same in `shaders/prefilter.wgsl`.
const TILE_LINES: usize = 64;
const TILE_LENGTH: usize = 32;
/// Pixels that it runs in over without a pole, with one, that of the cubic spline, and with two, of which the first
/// fades later.
const HALOS: [i32; 3] = [0, 16, 24];
/// Rows of the gradient that a thread makes; the same in `shaders/gradient.wgsl`.
const GRADIENT_ROWS: u32 = 16;
/// Most samples that the first value of a way of the prefilter is made of.
const MOST_START: usize = 32;

/// Row-major `f32` values with a border, in one buffer that kernels see by windows of rows.
#[derive(Debug)]
pub(super) struct Plane {
    pub buffer: Buffer,
    pub width: usize,
    pub height: usize,
    /// Values from one row to the next: rows begin where a binding may.
    pub stride: usize,
}

/// Values from one row of a plane of `width` px to the next.
pub(super) fn stride(gpu: &Gpu, width: usize) -> usize {
    (width + 2 * BORDER).next_multiple_of((gpu.alignment() as usize / 4).max(1))
}

/// Splits `rows` rows into windows of which each, with what it needs `before` and `after`, is at most `most` rows.
pub(super) fn windows(rows: usize, before: usize, after: usize, most: usize) -> Option<Vec<Range<usize>>> {
    let own = if rows + before + after <= most { rows } else { most.checked_sub(before + after).filter(|&n| n > 0)? };
    Some((0..rows).step_by(own.max(1)).map(|from| from..(from + own).min(rows)).collect())
}

impl Plane {
    pub(super) fn new(gpu: &Gpu, width: usize, height: usize) -> Result<Self, BackendError> {
        let stride = stride(gpu, width);
        let bytes = 4 * stride as u64 * (height + 2 * BORDER) as u64;
        let buffer = gpu.storage(bytes, &format!("an image plane of {width} x {height} px"))?;
        Ok(Self { buffer, width, height, stride })
    }

    /// Bytes of a row.
    fn row_bytes(&self) -> u64 {
        4 * self.stride as u64
    }

    /// Rows that a kernel can see at once.
    fn rows_seen(&self, gpu: &Gpu) -> usize {
        (gpu.max_binding_bytes / self.row_bytes()) as usize
    }

    /// Windows of image rows, each seen with so many more rows before and after.
    fn windows(&self, gpu: &Gpu, before: usize, after: usize) -> Result<Vec<Range<usize>>, BackendError> {
        windows(self.height, before, after, self.rows_seen(gpu)).ok_or_else(|| too_wide(gpu, self.width))
    }

    /// The rows from `from` up to `to` of the image, which may lie in the border, as a binding, and the place of
    /// pixel (0, 0) in it.
    pub(super) fn rows(&self, from: isize, to: isize) -> (wgpu::BindingResource<'_>, i32) {
        let first = (from + BORDER as isize).max(0) as u64;
        let last = ((to + BORDER as isize) as u64).min((self.height + 2 * BORDER) as u64);
        let resource = self.buffer.part(first * self.row_bytes(), (last - first) * self.row_bytes());
        let origin = (BORDER as i64 - first as i64) * self.stride as i64 + BORDER as i64;
        (resource, origin as i32)
    }
}

pub(super) fn too_wide(gpu: &Gpu, width: usize) -> BackendError {
    let name = &gpu.adapter.name;
    BackendError::OutOfMemory { what: format!("rows of {width} px, of which {name} shows a kernel too few at once") }
}

/// One pyramid level on the device.
#[derive(Debug, Default)]
struct FrameLevel {
    grey: Option<Plane>,
    coefficients: Option<Arc<Plane>>,
}

/// An image on the device and what has been made of it so far.
#[derive(Debug)]
pub struct GpuFrame {
    pub(super) host: Pyramid,
    options: KernelOptions,
    levels: Vec<FrameLevel>,
    pub(super) traffic: Traffic,
}

impl GpuFrame {
    /// Brings an image to the device and starts on its coefficients.
    pub(super) fn new(gpu: &Gpu, image: Arc<Image>, options: &KernelOptions) -> Result<Self, BackendError> {
        let host = Pyramid::new(image, options.grey_offset);
        let mut frame = Self { host, options: *options, levels: Vec::new(), traffic: Traffic::default() };
        frame.coefficients(gpu, 0)?;
        Ok(frame)
    }

    /// Grey levels of a pyramid level.
    pub(super) fn grey(&mut self, gpu: &Gpu, level: usize) -> Result<&Plane, BackendError> {
        if self.levels.len() <= level {
            self.levels.resize_with(level + 1, FrameLevel::default);
        }
        if self.levels[level].grey.is_none() {
            let plane = if level == 0 { self.unpack(gpu)? } else { self.halve(gpu, level)? };
            self.levels[level].grey = Some(plane);
        }
        Ok(self.levels[level].grey.as_ref().expect("made above"))
    }

    /// Interpolation coefficients of a pyramid level, border included.
    pub(super) fn coefficients(&mut self, gpu: &Gpu, level: usize) -> Result<Arc<Plane>, BackendError> {
        self.grey(gpu, level)?;
        if self.levels[level].coefficients.is_none() {
            let interpolation = self.options.interpolation;
            let grey = self.levels[level].grey.as_ref().expect("made above");
            let plane = coefficients(gpu, grey, interpolation, &mut self.traffic)?;
            self.levels[level].coefficients = Some(Arc::new(plane));
        }
        Ok(self.levels[level].coefficients.clone().expect("made above"))
    }

    /// Those for any interpolation, kept where it is that of the frame.
    fn coefficients_for(
        &mut self,
        gpu: &Gpu,
        level: usize,
        interpolation: Interpolation,
    ) -> Result<Arc<Plane>, BackendError> {
        if interpolation == self.options.interpolation {
            return self.coefficients(gpu, level);
        }
        self.grey(gpu, level)?;
        let grey = self.levels[level].grey.as_ref().expect("made above");
        Ok(Arc::new(coefficients(gpu, grey, interpolation, &mut self.traffic)?))
    }

    /// Gives back all that is on the device.
    pub(super) fn release(&mut self) {
        self.levels.clear();
    }

    /// Gives back the coefficients of a level, which a reference does not need again.
    pub(super) fn forget_coefficients(&mut self, level: usize) {
        self.levels[level].coefficients = None;
    }

    fn unpack(&mut self, gpu: &Gpu) -> Result<Plane, BackendError> {
        let image = self.host.image.clone();
        let (width, height) = (image.width(), image.height());
        let (bytes, depth): (&[u8], usize) = match image.pixels() {
            Levels::U8(p) => (p, 1),
            Levels::U16(p) => (bytemuck::cast_slice(p), 2),
            Levels::F32(p) => (bytemuck::cast_slice(p), 4),
        };
        let raw = gpu.storage(bytes.len() as u64, &format!("an image of {width} x {height} px"))?;
        self.traffic.bytes_up += gpu.write(&raw, bytes);
        let plane = Plane::new(gpu, width, height)?;
        let pipeline = gpu.pipeline(Kernel::Unpack, self.options.interpolation, 0);
        let mut recorder = gpu.record();
        // Rows of the recorded image begin anywhere: a binding begins up to `alignment` bytes before.
        let row_bytes = (width * depth) as u64;
        let most = (gpu.max_binding_bytes.saturating_sub(gpu.alignment() + 16) / row_bytes.max(1)) as usize;
        let most = most.min(plane.rows_seen(gpu)).min(MOST_GROUPS as usize);
        for rows in windows(height, 0, 0, most).ok_or_else(|| too_wide(gpu, width))? {
            let from = rows.start as u64 * row_bytes / gpu.alignment() * gpu.alignment();
            let to = (rows.end as u64 * row_bytes).next_multiple_of(16).min(raw.bytes());
            let (grey, origin) = plane.rows(rows.start as isize, rows.end as isize);
            let constants = layout::Unpack {
                width: width as u32,
                rows: rows.len() as u32,
                stride: plane.stride as u32,
                depth: depth as u32,
                skip: ((rows.start as u64 * row_bytes - from) / depth as u64) as u32,
                first: (origin + (rows.start * plane.stride) as i32) as u32,
                offset: self.options.grey_offset,
                unused: 0,
            };
            let constants = gpu.uniform(&constants);
            let bound = gpu.bind(&pipeline, &[constants.whole(), raw.part(from, to - from), grey]);
            recorder.run_2d(&bound, (width as u32).div_ceil(64), rows.len() as u32);
        }
        recorder.submit(&mut self.traffic);
        Ok(plane)
    }

    fn halve(&mut self, gpu: &Gpu, level: usize) -> Result<Plane, BackendError> {
        self.grey(gpu, level - 1)?;
        let fine = self.levels[level - 1].grey.as_ref().expect("made above");
        let plane = Plane::new(gpu, fine.width / 2, fine.height / 2)?;
        let pipeline = gpu.pipeline(Kernel::Downsample, self.options.interpolation, 0);
        let mut recorder = gpu.record();
        let most = (fine.rows_seen(gpu) / 2).min(plane.rows_seen(gpu)).min(MOST_GROUPS as usize);
        for rows in windows(plane.height, 0, 0, most).ok_or_else(|| too_wide(gpu, fine.width))? {
            let (from, from_origin) = fine.rows(2 * rows.start as isize, 2 * rows.end as isize);
            let (to, to_origin) = plane.rows(rows.start as isize, rows.end as isize);
            let constants = layout::Downsample {
                width: plane.width as u32,
                rows: rows.len() as u32,
                fine_stride: fine.stride as u32,
                coarse_stride: plane.stride as u32,
                fine_first: (from_origin + (2 * rows.start * fine.stride) as i32) as u32,
                coarse_first: (to_origin + (rows.start * plane.stride) as i32) as u32,
                unused: [0; 2],
            };
            let constants = gpu.uniform(&constants);
            let bound = gpu.bind(&pipeline, &[constants.whole(), from, to]);
            recorder.run_2d(&bound, (plane.width as u32).div_ceil(64), rows.len() as u32);
        }
        recorder.submit(&mut self.traffic);
        Ok(plane)
    }
}

/// What all dispatches have in common that filter `source` along its columns, which are the rows of `target`.
fn prefilter_of(source: &Plane, target: &Plane, interpolation: Interpolation) -> layout::Prefilter {
    let poles = interpolation.poles();
    let mut constants = layout::Prefilter {
        n: source.height as i32,
        source_stride: source.stride as i32,
        target_stride: target.stride as i32,
        halo: HALOS[poles.len()],
        own: 1.0,
        ..Zeroable::zeroed()
    };
    if source.height < 2 {
        return constants; // a constant is its own coefficient
    }
    for (p, (&pole, amplitude)) in poles.iter().zip(interpolation.amplitudes()).enumerate() {
        let weights = causal_start(pole, source.height);
        constants.n_start = constants.n_start.max(weights.len() as i32);
        weights.into_iter().zip(&mut constants.start).for_each(|(weight, of)| of[p] = weight);
        (constants.poles[p], constants.amplitudes[p]) = (pole as f32, amplitude as f32);
    }
    if !poles.is_empty() {
        constants.own = -constants.amplitudes.iter().sum::<f32>(); // it is in both ways
    }
    constants
}

/// Interpolation coefficients of `grey`, border included.
fn coefficients(
    gpu: &Gpu,
    grey: &Plane,
    interpolation: Interpolation,
    traffic: &mut Traffic,
) -> Result<Plane, BackendError> {
    let (width, height) = (grey.width, grey.height);
    let between = Plane::new(gpu, height, width)?; // rows and columns exchanged
    let plane = Plane::new(gpu, width, height)?;
    let pipeline = gpu.pipeline(Kernel::Prefilter, interpolation, 0);
    let mut recorder = gpu.record();
    for (source, target) in [(grey, &between), (&between, &plane)] {
        let constants = prefilter_of(source, target, interpolation);
        for rows in source.windows(gpu, MOST_START, MOST_START)? {
            let (from, to) = (rows.start.saturating_sub(MOST_START), (rows.end + MOST_START).min(source.height));
            let (seen, source_first) = source.rows(from as isize, to as isize);
            for columns in target.windows(gpu, 0, 0)? {
                let (written, target_first) = target.rows(columns.start as isize, columns.end as isize);
                let uniform = gpu.uniform(&layout::Prefilter {
                    left: columns.start as i32,
                    right: columns.end as i32,
                    top: rows.start as i32,
                    bottom: rows.end as i32,
                    source_first,
                    target_first,
                    ..constants
                });
                let bound = gpu.bind(&pipeline, &[uniform.whole(), seen.clone(), written]);
                let pieces = [columns.len().div_ceil(TILE_LINES), rows.len().div_ceil(TILE_LENGTH)];
                recorder.run_2d(&bound, pieces[0] as u32, pieces[1] as u32);
            }
        }
    }
    // The border: columns first, rows with the corners then.
    let columns = gpu.pipeline(Kernel::BorderColumns, interpolation, 0);
    let border = |begin: usize, end: usize, first: usize| layout::Border {
        width: width as i32,
        height: height as i32,
        stride: plane.stride as i32,
        first: first as i32,
        begin: begin as i32,
        end: end as i32,
        unused: [0; 2],
    };
    for rows in plane.windows(gpu, 0, 0)? {
        let (seen, _) = plane.rows(rows.start as isize, rows.end as isize);
        let uniform = gpu.uniform(&border(rows.start, rows.end, rows.start + BORDER));
        let bound = gpu.bind(&columns, &[uniform.whole(), seen]);
        recorder.run(&bound, (rows.len() as u32).div_ceil(64));
    }
    let rows_pipeline = gpu.pipeline(Kernel::BorderRows, interpolation, 0);
    let reach = BORDER as isize + 1;
    let (below_from, beyond) = (height as isize - reach, height as isize + BORDER as isize);
    for (from, to, mark) in [(-(BORDER as isize), reach.min(height as isize), 0), (below_from, beyond, 1)] {
        let (seen, _) = plane.rows(from, to);
        let first = (from + BORDER as isize).max(0) as usize;
        let uniform = gpu.uniform(&border(mark, 0, first));
        let bound = gpu.bind(&rows_pipeline, &[uniform.whole(), seen]);
        recorder.run(&bound, ((width + 2 * BORDER) as u32).div_ceil(64));
    }
    recorder.submit(traffic);
    Ok(plane)
}

/// Bytes of a pixel of the reference: its grey level, and both components of the gradient in one word.
const REFERENCE_BYTES: usize = 8;

/// Reference planes: row by row grey levels, then gradients.
#[derive(Debug)]
pub(super) struct Reference {
    pub buffer: Buffer,
    pub stride: usize,
    pub width: usize,
    pub height: usize,
}

impl Reference {
    /// Grey levels and gradients of one level of `frame`.
    pub(super) fn new(
        gpu: &Gpu,
        frame: &mut GpuFrame,
        level: usize,
        options: &KernelOptions,
        smoothed: Option<&Arc<Image>>,
    ) -> Result<Self, BackendError> {
        let KernelOptions { interpolation, gradient_unit, .. } = options.of_gradient();
        frame.grey(gpu, level)?;
        let coefficients = match smoothed {
            Some(image) => GpuFrame::new(gpu, image.clone(), &options.of_gradient())?.coefficients(gpu, level)?,
            None => frame.coefficients_for(gpu, level, interpolation)?,
        };
        frame.forget_coefficients(level);
        let grey = frame.levels[level].grey.as_ref().expect("made above");
        let (width, height, stride) = (grey.width, grey.height, grey.stride);
        let what = format!("a reference of {width} x {height} px");
        let buffer = gpu.storage((REFERENCE_BYTES * stride * height) as u64, &what)?;
        let reference = Self { buffer, stride, width, height };
        let (value, derivative) = at_pixel(interpolation);
        let padded = |[before, at, after]: [f32; 3]| [before, at, after, 0.0];
        let pipeline = gpu.pipeline(Kernel::Gradient, interpolation, 0);
        let mut recorder = gpu.record();
        for rows in windows(height, 1, 1, reference.rows_seen(gpu)).ok_or_else(|| too_wide(gpu, width))? {
            let (from, to) = (rows.start as isize, rows.end as isize);
            let (grey_part, grey_origin) = grey.rows(from, to);
            let (coefficients_part, coefficients_origin) = coefficients.rows(from - 1, to + 1);
            let skip = (rows.start * stride) as i32;
            let constants = layout::Gradient {
                width: width as i32,
                rows: rows.len() as i32,
                stride: stride as i32,
                grey_first: grey_origin + skip,
                coefficients_first: coefficients_origin + skip,
                reference_first: 0,
                per_unit: 1.0 / gradient_unit,
                unused: 0,
                value: padded(value),
                derivative: padded(derivative),
            };
            let uniform = gpu.uniform(&constants);
            let bound = gpu.bind(
                &pipeline,
                &[uniform.whole(), grey_part, coefficients_part, reference.rows(rows.start, rows.end)],
            );
            recorder.run_2d(&bound, (width as u32).div_ceil(64), (rows.len() as u32).div_ceil(GRADIENT_ROWS));
        }
        recorder.submit(&mut frame.traffic);
        Ok(reference)
    }

    /// Rows that a kernel can see at once.
    pub(super) fn rows_seen(&self, gpu: &Gpu) -> usize {
        gpu.max_binding_bytes as usize / (REFERENCE_BYTES * self.stride)
    }

    /// Image rows `from` up to `to` as a binding.
    pub(super) fn rows(&self, from: usize, to: usize) -> wgpu::BindingResource<'_> {
        let row = (REFERENCE_BYTES * self.stride) as u64;
        self.buffer.part(from as u64 * row, (to.min(self.height) - from) as u64 * row)
    }
}

#[cfg(test)]
mod tests {
    use super::super::device::{Recorder, values};
    use super::super::{GpuBackend, GpuOptions, adapters};
    use super::*;
    use crate::field::Brightness;
    use crate::imaging::Pixels;
    use std::io::Write;

    /// A device; none, which is said, where there is no driver.
    fn device() -> Option<GpuBackend> {
        let usable = adapters().list.into_iter().find(|adapter| adapter.unusable.is_none());
        let Some(adapter) = usable else {
            assert_ne!(std::env::var("QUADRILLE_GPU").as_deref(), Ok("require"), "no graphics adapter");
            let _ = writeln!(std::io::stderr(), "no graphics adapter: the tests of image planes did not run"); // nobody to tell
            return None;
        };
        Some(GpuBackend::new(&adapter, &GpuOptions::default()).unwrap())
    }

    fn fetched<T: bytemuck::Pod>(gpu: &Gpu, buffer: &Buffer) -> Vec<T> {
        let bytes = Recorder::untimed(gpu).fetch(&[(buffer, buffer.bytes())], &mut Traffic::default()).unwrap();
        values(&bytes)
    }

    /// Grey levels without any order.
    fn wild(k: usize) -> f64 {
        (k as f64 * 12.9898).sin().mul_add(43758.5453, 0.0).rem_euclid(1.0)
    }

    fn pictures(width: usize, height: usize) -> [Pixels; 3] {
        let each = 0..width * height;
        [
            Pixels::U8(each.clone().map(|k| (255.0 * wild(k)) as u8).collect()),
            Pixels::U16(each.clone().map(|k| (65535.0 * wild(k)) as u16).collect()),
            Pixels::F32(each.map(|k| (1000.0 * wild(k)) as f32).collect()),
        ]
    }

    #[test]
    fn grey_levels_are_exact_and_every_coarser_one_is_the_mean_of_four() {
        let Some(backend) = device() else { return };
        let gpu = &*backend.gpu;
        // Widths that are no multiple of anything, so that pixels begin within words.
        for (width, height) in [(1, 1), (3, 2), (67, 41), (130, 64)] {
            for pixels in pictures(width, height) {
                let image = Arc::new(Image::new(width, height, pixels).unwrap());
                let options = KernelOptions::new((0.0, 200.0), Interpolation::Cubic, Brightness::Zone);
                let mut host = Pyramid::new(image.clone(), options.grey_offset);
                let mut frame = GpuFrame::new(gpu, image, &options).unwrap();
                for level in 0..2usize.min(width.min(height).ilog2() as usize + 1) {
                    let want = host.level(level).clone();
                    let plane = frame.grey(gpu, level).unwrap();
                    let got = fetched::<f32>(gpu, &plane.buffer);
                    for (k, want) in want.values.iter().enumerate() {
                        let (x, y) = (k % want_width(width, level), k / want_width(width, level));
                        let got = got[(y + BORDER) * plane.stride + x + BORDER];
                        // Level 0 takes one subtraction on both sides; a mean of four, three additions in any order.
                        let allowed = if level == 0 { 0.0 } else { 4.0 * f32::EPSILON * 65536.0 };
                        assert!((got - want).abs() <= allowed, "{width} x {height}, level {level}, ({x}, {y})");
                    }
                }
            }
        }
    }

    fn want_width(width: usize, level: usize) -> usize {
        width >> level
    }

    #[test]
    fn splines_go_through_the_grey_levels_and_gradients_are_theirs() {
        let Some(backend) = device() else { return };
        let gpu = &*backend.gpu;
        let methods = [Interpolation::Cubic, Interpolation::Quintic, Interpolation::Keys, Interpolation::Bilinear];
        for interpolation in methods {
            // Below, at and above the length of a tile and its halo; a quintic spline reaches three pixels far.
            for (width, height) in [(5, 3), (3, 9), (64, 33), (65, 200), (151, 90)] {
                let [pixels, ..] = pictures(width, height);
                let image = Arc::new(Image::new(width, height, pixels).unwrap());
                let options = KernelOptions::new((0.0, 255.0), interpolation, Brightness::Zone);
                let mut frame = GpuFrame::new(gpu, image, &options).unwrap();
                let what = format!("{}, {width} x {height}", interpolation.name());
                let grey = frame.grey(gpu, 0).unwrap();
                let (stride, grey) = (grey.stride, fetched::<f32>(gpu, &grey.buffer));
                let [plane, of_gradient] = [interpolation, interpolation.of_gradient()]
                    .map(|of| fetched::<f32>(gpu, &frame.coefficients_for(gpu, 0, of).unwrap().buffer));
                let place =
                    |x: isize, y: isize| ((y + BORDER as isize) * stride as isize + x + BORDER as isize) as usize;
                let at = |x: isize, y: isize| f64::from(plane[place(x, y)]);
                // Continued through the outermost coefficients, as far as the images reach.
                let last = [width as isize - 1, height as isize - 1];
                for k in 1..=BORDER as isize {
                    for y in 0..=last[1] {
                        let inner = k.min(last[0]);
                        assert_eq!(at(-k, y) as f32, (2.0 * at(0, y)) as f32 - at(inner, y) as f32, "{what}");
                    }
                    for x in 0..=last[0] {
                        let inner = k.min(last[1]);
                        let want = (2.0 * at(x, last[1])) as f32 - at(x, last[1] - inner) as f32;
                        assert_eq!(at(x, last[1] + k) as f32, want, "{what}");
                    }
                }
                let reference = Reference::new(gpu, &mut frame, 0, &options, None).unwrap();
                let words = fetched::<u32>(gpu, &reference.buffer);
                let (value, derivative) = at_pixel(interpolation);
                let sum = |x: usize, y: usize, along_x: [f32; 3], along_y: [f32; 3]| {
                    let term = |(j, wy): (usize, f32)| {
                        let row = along_x.iter().enumerate().map(|(i, wx)| {
                            let at = place(x as isize + i as isize - 1, y as isize + j as isize - 1);
                            f64::from(*wx) * f64::from(of_gradient[at])
                        });
                        f64::from(wy) * row.sum::<f64>()
                    };
                    along_y.into_iter().enumerate().map(term).sum::<f64>()
                };
                // Coefficients of grey levels of +- 128 reach some 2000 (quintic: gain 10 per axis); a filter of two
                // poles and a sum of 9 products round by some 30 half steps, and cut off what is below 2e-6 of them.
                let largest = plane.iter().fold(0.0f32, |all, c| all.max(c.abs()));
                let allowed = f64::from(32.0 * f32::EPSILON * largest);
                for y in 0..height {
                    for x in 0..width {
                        let f = grey[(y + BORDER) * stride + x + BORDER];
                        let [grey, gradient] = [0, 1].map(|k| words[(2 * y + k) * reference.stride + x]);
                        assert_eq!(f32::from_bits(grey), f, "{what}: grey level at ({x}, {y})");
                        let through = sum(x, y, value, value);
                        assert!((through - f64::from(f)).abs() <= allowed, "{what}: {through} for {f} at ({x}, {y})");
                        let want = [sum(x, y, derivative, value), sum(x, y, value, derivative)];
                        let unit = f64::from(options.gradient_unit);
                        for (want, got) in want.into_iter().zip([gradient as i16, (gradient >> 16) as i16]) {
                            let got = unit * f64::from(got);
                            // Rounded to whole units.
                            assert!(
                                (want - got).abs() <= allowed + 0.5 * unit,
                                "{what}: {got} for {want} at ({x}, {y})"
                            );
                        }
                    }
                }
            }
        }
    }
}
