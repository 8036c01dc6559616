//! The two inner loops of rendering, sixteen points at a time.
//!
//! Positions are 32-bit fixed point relative to the patch: differences to blobs are exact, and a grey level depends on
//! the point alone. Products and sums are kept apart (no fused multiply-add): the same bits on every processor.

#![allow(unsafe_code, reason = "calls of functions compiled for instructions that were detected")]

/// Points evaluated together.
pub(super) const LANES: usize = 16;

/// One blob: its centre in quanta from the patch's origin, and its height in grey levels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Blob {
    pub x: i32,
    pub y: i32,
    pub height: f32,
}

/// The blobs of a rectangle of cells, row by row.
#[derive(Debug, Clone, Default)]
pub(super) struct Patch {
    pub origin: [f64; 2],
    pub n_columns: usize,
    pub n_rows: usize,
    pub blobs: Vec<Blob>,
}

/// What the kernel needs of a texture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Constants {
    /// Quanta per pixel.
    pub quanta: f64,
    /// Radius of a blob, quanta.
    pub radius: f64,
    /// Cells per quantum.
    pub per_cell: f64,
    /// One over the square of the radius in quanta.
    pub by_radius_2: f32,
    pub mean: f32,
    pub by_span: f32,
}

/// Defines `$name` as the body `$body` compiled for the widest vectors of the processor.
macro_rules! for_the_widest_vectors {
    ($(#[$doc:meta])* $name:ident = $body:ident ( $($arg:ident : $type:ty),* $(,)? ) -> $result:ty) => {
        $(#[$doc])*
        pub(super) fn $name($($arg: $type),*) -> $result {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl")]
                fn wide($($arg: $type),*) -> $result {
                    $body($($arg),*)
                }
                #[target_feature(enable = "avx2")]
                fn middle($($arg: $type),*) -> $result {
                    $body($($arg),*)
                }
                if is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512vl")
                {
                    // SAFETY: the processor has just been asked for these instructions.
                    return unsafe { wide($($arg),*) };
                }
                if is_x86_feature_detected!("avx2") {
                    // SAFETY: the processor has just been asked for these instructions.
                    return unsafe { middle($($arg),*) };
                }
            }
            $body($($arg),*)
        }
    };
}

for_the_widest_vectors! {
    /// The matrix product `left right`: `left` has `n` columns, `right` has `n` rows of `width`.
    product = product_body(left: &[f64], n: usize, right: &[f64], width: usize, out: &mut [f64]) -> ()
}

#[inline(always)]
fn product_body(left: &[f64], n: usize, right: &[f64], width: usize, out: &mut [f64]) {
    const WIDE: usize = 2 * LANES;
    for (left, out) in left.chunks_exact(n).zip(out.chunks_exact_mut(width)) {
        let (blocks, rest) = out.as_chunks_mut::<WIDE>();
        let done = WIDE * blocks.len();
        for (at, block) in blocks.iter_mut().enumerate() {
            let mut sum = [0.0; WIDE];
            for (right, &left) in right.chunks_exact(width).zip(left) {
                let (right, _) = right[WIDE * at..].as_chunks::<WIDE>();
                for (sum, right) in sum.iter_mut().zip(&right[0]) {
                    *sum += left * right;
                }
            }
            *block = sum;
        }
        rest.fill(0.0);
        for (right, &left) in right.chunks_exact(width).zip(left) {
            for (sum, right) in rest.iter_mut().zip(&right[done..]) {
                *sum += left * right;
            }
        }
    }
}

for_the_widest_vectors! {
    /// From inverse displacements, less `base`, to material coordinates, on rows of `columns.len()` points at the
    /// deformed coordinates `columns` and `rows`. Returns the smallest rectangle around the points.
    to_material = to_material_body(
        columns: &[f64], rows: &[f64], base: [f64; 2], x: &mut [f64], y: &mut [f64],
    ) -> ([f64; 2], [f64; 2])
}

#[inline(always)]
fn to_material_body(
    columns: &[f64],
    rows: &[f64],
    base: [f64; 2],
    x: &mut [f64],
    y: &mut [f64],
) -> ([f64; 2], [f64; 2]) {
    let (mut low, mut high) = ([[f64::INFINITY; LANES]; 2], [[f64::NEG_INFINITY; LANES]; 2]);
    let width = columns.len();
    for ((&row, x), y) in rows.iter().zip(x.chunks_exact_mut(width)).zip(y.chunks_exact_mut(width)) {
        let ((columns, _), (x, _), (y, _)) =
            (columns.as_chunks::<LANES>(), x.as_chunks_mut::<LANES>(), y.as_chunks_mut::<LANES>());
        for ((column, x), y) in columns.iter().zip(x).zip(y) {
            for lane in 0..LANES {
                x[lane] = column[lane] - (base[0] + x[lane]);
                y[lane] = row - (base[1] + y[lane]);
                for (axis, at) in [x[lane], y[lane]].into_iter().enumerate() {
                    low[axis][lane] = if at < low[axis][lane] { at } else { low[axis][lane] };
                    high[axis][lane] = if at > high[axis][lane] { at } else { high[axis][lane] };
                }
            }
        }
    }
    (
        low.map(|low| low.into_iter().fold(f64::INFINITY, f64::min)),
        high.map(|high| high.into_iter().fold(f64::NEG_INFINITY, f64::max)),
    )
}

for_the_widest_vectors! {
    /// The grey levels at the points `(x, y)` px, whose number is a multiple of [`LANES`]; groups of
    /// points of which `wanted` holds none are left alone (an empty `wanted` wants all).
    texture_at = texture_at_body(
        patch: &Patch, constants: &Constants, x: &[f64], y: &[f64], wanted: &[bool], out: &mut [f32],
    ) -> ()
}

#[inline(always)]
fn texture_at_body(patch: &Patch, constants: &Constants, x: &[f64], y: &[f64], wanted: &[bool], out: &mut [f32]) {
    let ((x, _), (y, _), (out, _)) = (x.as_chunks::<LANES>(), y.as_chunks::<LANES>(), out.as_chunks_mut::<LANES>());
    let (wanted, _) = wanted.as_chunks::<LANES>();
    for (at, ((x, y), out)) in x.iter().zip(y).zip(out).enumerate() {
        if wanted.get(at).is_some_and(|wanted| !wanted.contains(&true)) {
            continue;
        }
        let x = fixed_point(x, patch.origin[0], constants.quanta);
        let y = fixed_point(y, patch.origin[1], constants.quanta);
        let columns = cells(&x, constants, patch.n_columns);
        let rows = cells(&y, constants, patch.n_rows);
        let mut sum = [0.0_f32; LANES];
        for row in patch.blobs.chunks_exact(patch.n_columns).take(rows.end).skip(rows.start) {
            for blob in &row[columns.clone()] {
                for lane in 0..LANES {
                    let dx = x[lane].wrapping_sub(blob.x) as f32;
                    let dy = y[lane].wrapping_sub(blob.y) as f32;
                    let rest = 1.0 - (dx * dx + dy * dy) * constants.by_radius_2;
                    let rest = if rest > 0.0 { rest } else { 0.0 };
                    let rest_2 = rest * rest;
                    let rest_4 = rest_2 * rest_2;
                    sum[lane] += rest_4 * rest_4 * blob.height;
                }
            }
        }
        for lane in 0..LANES {
            let ratio = sum[lane] * constants.by_span;
            out[lane] = constants.mean + sum[lane] / (1.0 + ratio * ratio).sqrt();
        }
    }
}

/// Positions in quanta from `origin`, rounded to the nearest.
#[inline(always)]
fn fixed_point(x: &[f64; LANES], origin: f64, quanta: f64) -> [i32; LANES] {
    // Adding 1.5 * 2^52 leaves the nearest integer in the low bits: a conversion that vectorises.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    let mut fixed = [0; LANES];
    for lane in 0..LANES {
        fixed[lane] = ((x[lane] - origin) * quanta + ROUND).to_bits() as i32;
    }
    fixed
}

/// The cells whose blobs reach one of the positions.
#[inline(always)]
fn cells(x: &[i32; LANES], constants: &Constants, n: usize) -> std::ops::Range<usize> {
    let (mut low, mut high) = (*x, *x);
    // Halving instead of a chain: these are vector instructions.
    let mut half = LANES / 2;
    while half > 0 {
        for lane in 0..half {
            low[lane] = low[lane].min(low[lane + half]);
            high[lane] = high[lane].max(high[lane + half]);
        }
        half /= 2;
    }
    let first = (f64::from(low[0]) - constants.radius) * constants.per_cell;
    let last = (f64::from(high[0]) + constants.radius) * constants.per_cell;
    let end = (last.max(0.0) as usize + 1).min(n);
    (first.max(0.0) as usize).min(end)..end
}

for_the_widest_vectors! {
    /// Adds to each pixel of `out` the weighted sum of its samples: `samples` holds one row of points,
    /// `weights.len()` for each pixel, `by_row` is the weight of that row.
    integrate_row = integrate_row_body(samples: &[f32], weights: &[f32], by_row: f32, out: &mut [f32]) -> ()
}

#[inline(always)]
fn integrate_row_body(samples: &[f32], weights: &[f32], by_row: f32, out: &mut [f32]) {
    #[inline(always)]
    fn with<const POINTS: usize>(samples: &[f32], weights: &[f32], by_row: f32, out: &mut [f32]) {
        let Ok(weights) = <&[f32; POINTS]>::try_from(weights) else { return };
        for (out, samples) in out.iter_mut().zip(samples.as_chunks::<POINTS>().0) {
            let mut sum = 0.0;
            for (sample, weight) in samples.iter().zip(weights) {
                sum += sample * weight;
            }
            *out += by_row * sum;
        }
    }
    match weights.len() {
        1 => with::<1>(samples, weights, by_row, out),
        2 => with::<2>(samples, weights, by_row, out),
        3 => with::<3>(samples, weights, by_row, out),
        4 => with::<4>(samples, weights, by_row, out),
        5 => with::<5>(samples, weights, by_row, out),
        _ => with::<6>(samples, weights, by_row, out),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::Texture;

    #[test]
    fn wide_vectors_give_the_bits_of_the_plain_code() {
        let texture = Texture::new(3, 4.5).unwrap();
        let mut patch = Patch::default();
        texture.patch([-20.0, 5.0], [15.0, 30.0], &mut patch).unwrap();
        let x: Vec<f64> = (0..640).map(|k| -20.0 + 35.0 * (f64::from(k) * 0.618_034).fract()).collect();
        let y: Vec<f64> = (0..640).map(|k| 5.0 + f64::from(k) / 25.6).collect();
        let (mut wide, mut plain) = (vec![0.0; 640], vec![0.0; 640]);
        texture_at(&patch, &texture.constants(), &x, &y, &[], &mut wide);
        texture_at_body(&patch, &texture.constants(), &x, &y, &[], &mut plain);
        assert_eq!(wide, plain);

        let (mut wide, mut plain) = (vec![0.0; 160], vec![0.0; 160]);
        product(&x[..40], 10, &y[..400], 40, &mut wide);
        product_body(&x[..40], 10, &y[..400], 40, &mut plain);
        assert_eq!(wide, plain);
    }
}
