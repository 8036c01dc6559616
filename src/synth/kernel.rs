//! The two inner loops of rendering, sixteen points at a time.
//!
//! Positions are 32-bit fixed point relative to the patch: their differences to the blobs are exact,
//! so that a grey level depends on the point alone, not on the tile or the group it falls into.
//! Products and sums are kept apart (no fused multiply-add): the same bits on every processor.

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
    /// One over the radius in quanta.
    pub by_radius: f32,
    pub mean: f32,
    pub by_span: f32,
}

/// Defines `$name` as the body `$body` compiled for the widest vectors of the processor.
macro_rules! for_the_widest_vectors {
    ($(#[$doc:meta])* $name:ident = $body:ident ( $($arg:ident : $type:ty),* )) => {
        $(#[$doc])*
        pub(super) fn $name($($arg: $type),*) {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl")]
                fn wide($($arg: $type),*) {
                    $body($($arg),*)
                }
                #[target_feature(enable = "avx2")]
                fn middle($($arg: $type),*) {
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
    /// `sum_j weights[j][p] values[j]` added to `out[p]`; `weights` is row-major, `out.len()` wide.
    add_products = add_products_body(weights: &[f64], values: &[f64], out: &mut [f64])
}

#[inline(always)]
fn add_products_body(weights: &[f64], values: &[f64], out: &mut [f64]) {
    const WIDE: usize = 32;
    let width = out.len();
    let whole = width - width % WIDE;
    let (blocks, rest) = out.split_at_mut(whole);
    for (block, out) in blocks.chunks_exact_mut(WIDE).enumerate() {
        let mut sum = [0.0; WIDE];
        sum.copy_from_slice(out);
        for (row, &value) in weights.chunks_exact(width).zip(values) {
            let row = &row[block * WIDE..][..WIDE];
            for lane in 0..WIDE {
                sum[lane] += row[lane] * value;
            }
        }
        out.copy_from_slice(&sum);
    }
    for (at, out) in rest.iter_mut().enumerate() {
        for (row, &value) in weights.chunks_exact(width).zip(values) {
            *out += row[whole + at] * value;
        }
    }
}

for_the_widest_vectors! {
    /// The grey levels at the points `(x, y)` px, whose number is a multiple of [`LANES`]; groups of
    /// points of which `wanted` holds none are left alone (an empty `wanted` wants all).
    texture_at = texture_at_body(
        patch: &Patch, constants: &Constants, x: &[f64], y: &[f64], wanted: &[bool], out: &mut [f32]
    )
}

#[inline(always)]
fn texture_at_body(patch: &Patch, constants: &Constants, x: &[f64], y: &[f64], wanted: &[bool], out: &mut [f32]) {
    let groups = x.chunks_exact(LANES).zip(y.chunks_exact(LANES)).zip(out.chunks_exact_mut(LANES));
    for (at, ((x, y), out)) in groups.enumerate() {
        if !wanted.is_empty() && !wanted[at * LANES..][..LANES].contains(&true) {
            continue;
        }
        let x = fixed_point(x, patch.origin[0], constants.quanta);
        let y = fixed_point(y, patch.origin[1], constants.quanta);
        let columns = cells(&x, constants, patch.n_columns);
        let rows = cells(&y, constants, patch.n_rows);
        let mut sum = [0.0_f32; LANES];
        for row in rows {
            for blob in &patch.blobs[row * patch.n_columns..][columns.clone()] {
                for lane in 0..LANES {
                    let dx = x[lane].wrapping_sub(blob.x) as f32 * constants.by_radius;
                    let dy = y[lane].wrapping_sub(blob.y) as f32 * constants.by_radius;
                    let rest = 1.0 - (dx * dx + dy * dy);
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
fn fixed_point(x: &[f64], origin: f64, quanta: f64) -> [i32; LANES] {
    // Adding 1.5 * 2^52 leaves the nearest integer in the low bits: a conversion that vectorises.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    let mut fixed = [0; LANES];
    for (fixed, x) in fixed.iter_mut().zip(x) {
        *fixed = ((x - origin) * quanta + ROUND).to_bits() as i32;
    }
    fixed
}

/// The cells whose blobs reach one of the positions.
#[inline(always)]
fn cells(x: &[i32; LANES], constants: &Constants, n: usize) -> std::ops::Range<usize> {
    let (mut low, mut high) = (i32::MAX, i32::MIN);
    for &x in x {
        low = low.min(x);
        high = high.max(x);
    }
    let first = (f64::from(low) - constants.radius) * constants.per_cell;
    let last = (f64::from(high) + constants.radius) * constants.per_cell;
    let end = (last.max(0.0) as usize + 1).min(n);
    (first.max(0.0) as usize).min(end)..end
}
