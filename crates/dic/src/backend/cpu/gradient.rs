//! The gradient of the reference at its pixels.

use super::lanes::Lanes;
use super::plane::View;
use super::sample::load;
use crate::backend::spline::at_pixel;
use crate::imaging::Interpolation;
use crate::isa::mul_add;

/// How the gradient at a pixel is made of the coefficients around it: in whole `unit`s of grey levels per px, since 16
/// bits are half the bytes of `f32` that every pass over the pixels reads, and as many digits as a gradient has (see
/// [`KernelOptions`](crate::backend::KernelOptions)).
#[derive(Debug, Clone, Copy)]
pub(super) struct AtPixel {
    value: [f32; 3],
    derivative: [f32; 3],
    pub unit: f32,
    per_unit: f32,
}

impl AtPixel {
    /// For an interpolation; the coefficients are those of [`Interpolation::of_gradient`].
    pub fn new(interpolation: Interpolation, unit: f32) -> Self {
        let (value, derivative) = at_pixel(interpolation);
        Self { value, derivative, unit, per_unit: 1.0 / unit }
    }
}

/// Added to a number below 2^22, it leaves the nearest whole one in the low bits of the sum. Twin:
/// shaders/gradient.wgsl.
const NEAREST: f32 = 12_582_912.0; // 1.5 * 2^23

/// Room for `L` lanes and one more at both sides.
const ROOM: usize = 32;
/// Rows that are summed along y before the first is summed along x: what has just been written piece by piece cannot be
/// read across the pieces at once.
const ROWS: usize = 16;

/// Sums along y, of the value and of the derivative.
#[derive(Debug)]
pub(super) struct AlongY {
    smooth: [[f32; ROOM]; ROWS],
    slope: [[f32; ROOM]; ROWS],
}

impl Default for AlongY {
    fn default() -> Self {
        Self { smooth: [[0.0; ROOM]; ROWS], slope: [[0.0; ROOM]; ROWS] }
    }
}

/// The gradient of the spline with coefficients `c` in rows of lanes one below the other, of which the first begins at
/// column `x` of row `y`. Beyond the image it is a number, but no gradient.
#[inline(always)]
pub(super) fn gradients<const FMA: bool, const L: usize>(
    c: View<'_>,
    [x, y]: [i32; 2],
    AtPixel { value, derivative, per_unit, .. }: &AtPixel,
    AlongY { smooth, slope }: &mut AlongY,
    lanes: &mut [Lanes<L>],
) {
    const { assert!(L + 2 <= ROOM, "no room for the lanes") };
    let (value, derivative, per_unit) = (*value, *derivative, *per_unit);
    let mut first = c.at(x as isize - 1, y as isize - 1);
    for lanes in lanes.chunks_mut(ROWS) {
        // Along y first, a pixel beyond both ends, then along x.
        for (smooth, slope) in smooth.iter_mut().zip(slope.iter_mut()).take(lanes.len()) {
            for part in [0, 2] {
                let rows: [&[f32; L]; 3] = std::array::from_fn(|k| load(c.data, first + k * c.stride + part));
                let parts = smooth[part..].first_chunk_mut::<L>().zip(slope[part..].first_chunk_mut::<L>());
                let Some((smooth, slope)) = parts else { continue };
                for i in 0..L {
                    let (mut v, mut d) = (0.0, 0.0);
                    for k in 0..3 {
                        v = mul_add::<FMA>(value[k], rows[k][i], v);
                        d = mul_add::<FMA>(derivative[k], rows[k][i], d);
                    }
                    smooth[i] = v;
                    slope[i] = d;
                }
            }
            first += c.stride;
        }
        for ((smooth, slope), lanes) in smooth.iter().zip(slope.iter()).zip(lanes) {
            let smooth: [&[f32; L]; 3] = std::array::from_fn(|k| load(smooth, k));
            let slope: [&[f32; L]; 3] = std::array::from_fn(|k| load(slope, k));
            for i in 0..L {
                let (mut gx, mut gy) = (0.0, 0.0);
                for k in 0..3 {
                    gx = mul_add::<FMA>(derivative[k], smooth[k][i], gx);
                    gy = mul_add::<FMA>(value[k], slope[k][i], gy);
                }
                lanes.fx[i] = whole(per_unit * gx);
                lanes.fy[i] = whole(per_unit * gy);
            }
        }
    }
}

/// The nearest whole number.
#[inline(always)]
fn whole(value: f32) -> i16 {
    (value.clamp(-32767.0, 32767.0) + NEAREST).to_bits() as i16
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backend::KernelOptions;
    use crate::backend::cpu::memory::Pool;
    use crate::backend::cpu::plane::Plane;
    use crate::backend::cpu::prefilter::coefficients;
    use crate::backend::cpu::reference::{Reference, Source};
    use crate::field::Brightness;
    use crate::isa::Isa;
    use crate::mesh::{PixelMesh, Roi, Zone};

    const SIZE: usize = 40;
    const INTERPOLATIONS: [Interpolation; 4] =
        [Interpolation::Cubic, Interpolation::Quintic, Interpolation::Keys, Interpolation::Bilinear];

    /// The coefficients of an image less 127.5, and its gradients in px, row by row, as the passes are given them.
    fn of_image(isa: Isa, image: &[f32], interpolation: Interpolation, unit: f32) -> (Plane, Vec<[f64; 2]>) {
        let roi = Roi { x0: 0.0, y0: 0.0, x1: SIZE as f64, y1: SIZE as f64 };
        let pixels = PixelMesh::on_zones(&[Zone::rectangle("all", roi)], 8, 0.5, [SIZE, SIZE]).unwrap().pixels;
        let (pool, offset, at_pixel) = (Pool::default(), 127.5, AtPixel::new(interpolation, unit));
        let plane = coefficients(&pool, isa, image, SIZE, SIZE, offset, interpolation.of_gradient()).unwrap();
        let source = Source { grey: image, offset, coefficients: plane.view(), at_pixel };
        let reference = Reference::new::<_, 8>(&pool, isa, &source, &pixels).unwrap();
        let mut gradients = vec![[f64::NAN; 2]; SIZE * SIZE];
        for element in 0..pixels.elements().len() {
            reference.for_each::<8>(element, |[x, y], _, _, gradient| {
                gradients[y as usize * SIZE + x as usize] = gradient.map(f64::from);
            });
        }
        (plane, gradients)
    }

    /// The gradient along x of an image whose rows are all `row`, grey levels between 0 and 255, in its middle row.
    fn along(row: &[f32], interpolation: Interpolation, unit: f32) -> Vec<f64> {
        let (_, gradients) = of_image(Isa::detect(), &row.repeat(SIZE), interpolation, unit);
        gradients[SIZE / 2 * SIZE..][..SIZE].iter().map(|[x, _]| *x).collect()
    }

    #[test]
    fn no_image_is_too_steep_for_the_unit_of_its_gradients() {
        for interpolation in INTERPOLATIONS {
            let KernelOptions { gradient_unit: unit, .. } =
                KernelOptions::new((0.0, 255.0), interpolation, Brightness::Zone);
            // What each white column does to each pixel.
            let white =
                |column: usize| (0..SIZE).map(move |x| if x == column { 255.0 } else { 0.0 }).collect::<Vec<f32>>();
            let by: Vec<Vec<f64>> = (0..SIZE).map(|column| along(&white(column), interpolation, unit)).collect();
            for pixel in 0..SIZE {
                // The image that is steepest there: white wherever that makes it steeper.
                let steepest: f64 = by.iter().map(|of| of[pixel].max(0.0)).sum();
                let border = !(2..SIZE - 2).contains(&pixel);
                assert!(steepest < if border { 1.74 } else { 1.1 } * 255.0, "{interpolation:?}, {pixel}: {steepest}");
                let row: Vec<f32> = by.iter().map(|of| if of[pixel] > 0.0 { 255.0 } else { 0.0 }).collect();
                let got = along(&row, interpolation, unit)[pixel];
                // Each of the 40 columns was rounded by half a unit.
                assert!(
                    (got - steepest).abs() <= 20.5 * f64::from(unit),
                    "{interpolation:?}, {pixel}: {got}, {steepest}"
                );
            }
        }
    }

    #[test]
    fn a_gradient_is_right_to_half_its_unit_on_every_instruction_path() {
        let image: Vec<f32> = (0..SIZE * SIZE).map(|k| (255.0 * (12.9898 * k as f32).sin().abs()).round()).collect();
        for (interpolation, isa) in
            INTERPOLATIONS.into_iter().flat_map(|of| Isa::available().into_iter().map(move |isa| (of, isa)))
        {
            let unit = 1.0 / 64.0;
            let (plane, gradients) = of_image(isa, &image, interpolation, unit);
            let (value, derivative) = at_pixel(interpolation);
            let sum = |at: [isize; 2], along_x: [f32; 3], along_y: [f32; 3]| -> f64 {
                let terms = (0..9).map(|k| {
                    let c = plane.data()[plane.at(at[0] + k as isize % 3 - 1, at[1] + k as isize / 3 - 1)];
                    f64::from(along_x[k % 3]) * f64::from(along_y[k / 3]) * f64::from(c)
                });
                terms.sum()
            };
            for at in (0..SIZE * SIZE).map(|k| [k % SIZE, k / SIZE].map(|k| k as isize)) {
                let got = gradients[at[1] as usize * SIZE + at[0] as usize];
                let want = [sum(at, derivative, value), sum(at, value, derivative)];
                // Sums of `f32` products of coefficients up to some thousands, beside half a unit.
                let allowed = 0.5 * f64::from(unit) + 1e-3;
                assert!(
                    (0..2).all(|c| (got[c] - want[c]).abs() <= allowed),
                    "{interpolation:?}, {isa}, {at:?}: {got:?}, {want:?}"
                );
            }
        }
    }
}
