//! Texture that noise hides from single pixels (THEORY 2): the gradients of pixels a few apart have in common what is
//! texture, and nothing of white noise.

use crate::imaging::Image;
use crate::linalg::Pattern;
use crate::mesh::Mesh;
use crate::units::Px;

/// Pixels apart whose central differences share no pixel, nor what is beside one.
const APART: usize = 3;
/// What is in common is real from this many standard deviations of that of noise on: none of 10^6 nodes by chance.
const SIGNIFICANT: f64 = 5.0;
/// Standard deviation of a mean product of noise, in `0.5 sigma^2 / sqrt(n)`: products two pixels apart share noise.
const SPREAD: f64 = 1.25;

/// What the pixels around a node have in common.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct CommonTexture {
    /// Mean product of gradients in the weakest direction, (grey levels / px)^2.
    weakest: f64,
    /// Number of products.
    n: f64,
}

impl CommonTexture {
    /// Of the elements around a node.
    pub fn around(image: &Image, mesh: &Mesh<Px>, pattern: &Pattern, node: usize) -> Self {
        let mut of = [f64::INFINITY, f64::INFINITY, 0.0, 0.0];
        for [x, y] in pattern.elements_of(node).iter().flat_map(|&(element, _)| mesh.corners(element as usize)) {
            of = [of[0].min(x), of[1].min(y), of[2].max(x), of[3].max(y)];
        }
        Self::within(image, of)
    }

    /// Of the pixels in `[x0, y0, x1, y1]`.
    pub fn within(image: &Image, [x0, y0, x1, y1]: [f64; 4]) -> Self {
        let ends = |low: f64, high: f64, n: usize| {
            let last = (n - 1).saturating_sub(1 + APART);
            (low.ceil().max(1.0) as usize)..(high.max(0.0) as usize).min(last)
        };
        let (columns, rows) = (ends(x0, x1, image.width()), ends(y0, y1, image.height()));
        let gradient = |x: usize, y: usize| {
            let grey = |x: usize, y: usize| f64::from(image.grey(x, y));
            [0.5 * (grey(x + 1, y) - grey(x - 1, y)), 0.5 * (grey(x, y + 1) - grey(x, y - 1))]
        };
        let mut sums = [0.0; 3];
        let mut n = 0.0;
        // Products of rows, and of columns, are one for each pixel.
        for y in rows {
            for x in columns.clone() {
                let [here, right, below] = [gradient(x, y), gradient(x + APART, y), gradient(x, y + APART)];
                let beside = [0, 1].map(|c| right[c] + below[c]);
                sums[0] += here[0] * beside[0];
                sums[1] += 0.5 * (here[0] * beside[1] + here[1] * beside[0]);
                sums[2] += here[1] * beside[1];
                n += 2.0;
            }
        }
        let [xx, xy, yy] = sums.map(|sum| sum / f64::max(n, 1.0));
        let weakest = 0.5 * (xx + yy) - (0.25 * (xx - yy).powi(2) + xy * xy).sqrt();
        Self { weakest: weakest.max(0.0), n }
    }

    /// Whether it is beyond what noise of the standard deviation `noise` brings about.
    pub fn stands_out(self, noise: f64) -> bool {
        self.n > 0.0 && self.weakest > SIGNIFICANT * SPREAD * 0.5 * noise * noise / self.n.sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::Pixels;
    use crate::mesh::{Roi, Zone};

    #[test]
    fn large_speckles_stand_out_of_noise_that_hides_their_gradient_and_noise_does_not() {
        const SIDE: usize = 160;
        let zone = Zone::rectangle("all", Roi { x0: 16.0, y0: 16.0, x1: 144.0, y1: 144.0 });
        let mesh = Mesh::on_zones(&[zone], 32, SIDE, SIDE).unwrap();
        let pattern = Pattern::new(mesh.n_nodes(), mesh.elements());
        let noise = |k: usize| (0..12).map(|j| f64::from(draw(12 * k + j))).sum::<f64>() / 65536.0 - 6.0;
        let out = |height: f64| {
            let grey = |k: usize| {
                let (x, y) = ((k % SIDE) as f64, (k / SIDE) as f64);
                height * (0.15 * x).sin() * (0.13 * y).cos() + 120.0 + 2.0 * noise(k)
            };
            let pixels = (0..SIDE * SIDE).map(|k| grey(k) as f32).collect();
            let image = Image::new(SIDE, SIDE, Pixels::F32(pixels)).unwrap();
            let stands_out = |node: &usize| CommonTexture::around(&image, &mesh, &pattern, *node).stands_out(2.0);
            (0..mesh.n_nodes()).filter(stands_out).count()
        };
        // A gradient of 1.1 grey levels per px, less than that of the noise.
        assert_eq!((out(16.0), out(0.0)), (mesh.n_nodes(), 0));
    }

    fn draw(k: usize) -> u32 {
        let mixed = (k as u64 ^ 0x9E37_79B9).wrapping_mul(0xD6E8_FEB8_6659_FD93);
        ((mixed ^ (mixed >> 32)).wrapping_mul(0xD6E8_FEB8_6659_FD93) >> 40 & 0xFFFF) as u32
    }
}
