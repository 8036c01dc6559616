//! Noise that rises with the grey level, `sigma^2 = a + b grey`: its two numbers from reference and residual, and what
//! it makes of the standard uncertainty of each node (docs/correlation.md, section 2.7).

use crate::backend::{ElementMatch, ElementMoments, GreyTransfer};
use crate::correlate::NoiseGain;
use crate::field::Noise;
use crate::mesh::Mesh;
use crate::units::Px;

/// Variance of the noise of one image, `a + b grey`, grey levels squared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhotonNoise {
    /// Variance of black.
    pub a: f64,
    /// Its rise per grey level.
    pub b: f64,
}

/// A fit is made anew with weights of its own this often: noise of 10 to 1 has settled by then.
const ROUNDS: usize = 4;
/// Elements whose residual is this many times that of the fit hold something else than noise.
const LOUD: f64 = 4.0;

/// The finest level in one frame, element by element.
pub(crate) struct Elements<'a> {
    pub mesh: &'a Mesh<Px>,
    pub moments: &'a [ElementMoments],
    pub matched: &'a [ElementMatch],
    pub displacement: &'a [[f64; 2]],
    pub transfer: &'a [GreyTransfer],
    /// Grey level that all sums are counted from.
    pub grey_offset: f64,
    pub gain: &'a NoiseGain,
    /// Least variance: that of rounding.
    pub least: f64,
}

impl PhotonNoise {
    fn at(self, grey: f64, least: f64) -> f64 {
        (self.a + self.b * grey).max(least)
    }
}

impl Elements<'_> {
    /// What is asked for, or found on the residual; `None` where the noise does not depend on the grey level.
    pub fn photon(&self, asked: Noise) -> Option<PhotonNoise> {
        match asked {
            Noise::Photon { a, b } => Some(PhotonNoise { a, b }),
            Noise::PhotonOfResidual => self.of_residual(),
            Noise::Constant(_) | Noise::Residual => None,
        }
    }

    /// Mean grey level of an element in reference and deformed image, each in its own scale; the gain between them.
    fn greys(&self, element: usize) -> Option<[f64; 3]> {
        let moments = &self.moments[element];
        if moments.n == 0.0 {
            return None;
        }
        let GreyTransfer { gain, offset } = self.transfer[self.mesh.element_zone()[element] as usize];
        let mean = moments.f / moments.n;
        let deformed = if gain > 0.0 { (mean - offset) / gain } else { mean };
        Some([mean + self.grey_offset, deformed + self.grey_offset, gain])
    }

    /// `residual^2 = a p + b q` over the elements by weighted least squares.
    fn of_residual(&self) -> Option<PhotonNoise> {
        let of_reference = self.gain.of_reference;
        let row = |element: usize| {
            let [f, g, gain] = self.greys(element)?;
            let ElementMatch { n, residual_rms, .. } = self.matched[element];
            if n == 0.0 || !residual_rms.is_finite() {
                return None;
            }
            let through = gain * gain * self.gain.in_element(self.mesh, element, self.displacement);
            // Two unknowns of the displacement per node, and about as many nodes as elements.
            let square = residual_rms * residual_rms * n / (n - 2.0).max(1.0);
            Some([of_reference + through, f * of_reference + g * through, square, n])
        };
        let rows: Vec<[f64; 4]> = (0..self.mesh.n_elements()).filter_map(row).collect();
        let sum = |k: usize| rows.iter().map(|row| row[3] * row[k]).sum::<f64>();
        let mut fit = PhotonNoise { a: sum(2) / sum(0).max(f64::MIN_POSITIVE), b: 0.0 };
        for _ in 0..ROUNDS {
            let predicted = |row: &[f64; 4]| (fit.a * row[0] + fit.b * row[1]).max(self.least * row[0]);
            let quiet: Vec<&[f64; 4]> = rows.iter().filter(|row| row[2] <= LOUD * predicted(row)).collect();
            let mut sums = [0.0; 5];
            for row in &quiet {
                let weight = row[3] / predicted(row).powi(2).max(f64::MIN_POSITIVE);
                let [p, q, square, _] = **row;
                let terms = [p * p, p * q, q * q, p * square, q * square];
                sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += weight * term);
            }
            let [pp, pq, qq, ps, qs] = sums;
            let determinant = pp * qq - pq * pq;
            // One grey level everywhere: nothing says how the noise rises.
            if quiet.len() < 3 || determinant <= 1e-9 * pp * qq || determinant.is_nan() {
                break;
            }
            let b = (pp * qs - pq * ps) / determinant;
            fit = match b > 0.0 {
                true => PhotonNoise { a: (qq * ps - pq * qs) / determinant, b },
                false => PhotonNoise { a: ps / pp, b: 0.0 },
            };
        }
        (fit.a.is_finite() && fit.b.is_finite()).then_some(fit)
    }

    /// Standard deviation of the noise in a zone: the root of its mean variance over the pixels of the reference.
    pub fn in_zone(&self, zone: usize, noise: PhotonNoise) -> f64 {
        let (mut n, mut sum) = (0.0, 0.0);
        for element in self.mesh.zone_elements(zone) {
            let Some([grey, ..]) = self.greys(element) else { continue };
            let pixels = self.matched[element].n;
            (n, sum) = (n + pixels, sum + pixels * noise.at(grey, self.least));
        }
        if n > 0.0 { (sum / n).sqrt() } else { self.least.sqrt() }
    }

    /// Per node, by what its standard uncertainty differs from that under the even noise of its zone: its own noise is
    /// the mean of its elements' variances, weighted by their share in its diagonal of `M`.
    pub fn by_node(&self, noise: PhotonNoise) -> Vec<[f64; 2]> {
        let of_reference = self.gain.of_reference;
        let in_zone: Vec<f64> = (0..self.mesh.zones().len()).map(|zone| self.in_zone(zone, noise).powi(2)).collect();
        let mut sums = vec![[[0.0; 2]; 2]; self.mesh.n_nodes()];
        for (element, nodes) in self.mesh.elements().iter().enumerate() {
            let Some([f, g, gain]) = self.greys(element) else { continue };
            if self.matched[element].n == 0.0 {
                continue;
            }
            let even = in_zone[self.mesh.element_zone()[element] as usize] * (of_reference + gain * gain);
            let here = of_reference * noise.at(f, self.least) + gain * gain * noise.at(g, self.least);
            let matrix = self.moments[element].matrix();
            for (corner, &node) in nodes.iter().enumerate() {
                for (c, [sum, weights]) in sums[node as usize].iter_mut().enumerate() {
                    let weight = matrix[diagonal(2 * corner + c)];
                    *sum += weight * here / even;
                    *weights += weight;
                }
            }
        }
        let root = |[sum, weights]: [f64; 2]| if weights > 0.0 { (sum / weights).sqrt() } else { 1.0 };
        sums.into_iter().map(|both| both.map(root)).collect()
    }
}

/// Place of the diagonal entry `i` in the upper triangle of an 8 x 8 matrix, row by row.
fn diagonal(i: usize) -> usize {
    (0..i).map(|row| 8 - row).sum()
}
