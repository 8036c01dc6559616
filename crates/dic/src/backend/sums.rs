//! Sums over pixels that backends hand back.

use crate::field::Brightness;
use crate::linalg::{ElementMatrix, Pattern, Solver};

/// Grey-level sums over a set of pixels; `f` reference, `g` deformed, both less the series' offset.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PixelSums {
    /// Pixels counted: those inside the deformed image.
    pub n: f64,
    /// Pixels of the set, counted or not.
    pub n_all: f64,
    /// Sum of f.
    pub f: f64,
    /// Sum of f^2.
    pub ff: f64,
    /// Sum of g.
    pub g: f64,
    /// Sum of g^2.
    pub gg: f64,
    /// Sum of f g.
    pub fg: f64,
    /// Sum of the squared residual (f - gain g - offset)^2.
    pub rr: f64,
}

/// Share of the variance of two images that they have to have in common for the rest to be noise.
const SHARED: f64 = 0.5;

impl PixelSums {
    /// Adds the sums of another set.
    pub fn add(&mut self, other: &Self) {
        self.n += other.n;
        self.n_all += other.n_all;
        self.f += other.f;
        self.ff += other.ff;
        self.g += other.g;
        self.gg += other.gg;
        self.fg += other.fg;
        self.rr += other.rr;
    }

    fn covariances(&self) -> (f64, f64, f64) {
        let (mf, mg) = (self.f / self.n, self.g / self.n);
        (self.ff / self.n - mf * mf, self.gg / self.n - mg * mg, self.fg / self.n - mf * mg)
    }

    /// Correlation coefficient of f and g, 0 when one of them is constant or nothing is counted.
    pub fn correlation(&self) -> f64 {
        if self.n < 2.0 {
            return 0.0;
        }
        let (vf, vg, c) = self.covariances();
        if vf > 0.0 && vg > 0.0 { (c / (vf * vg).sqrt()).clamp(-1.0, 1.0) } else { 0.0 }
    }

    /// How much of f the residual leaves explained, on the scale of a correlation coefficient:
    /// `sqrt(1 - sum r^2 / sum (f - mean f)^2)`, 0 when nothing.
    pub fn explained(&self) -> f64 {
        let variance = self.ff - self.f * self.f / self.n.max(1.0);
        if variance > 0.0 { (1.0 - self.rr / variance).max(0.0).sqrt() } else { 0.0 }
    }

    /// Gain and offset that bring g to f: `(gain, offset)`; `None` when g is constant or the two are not positively
    /// correlated (no sensible change of light turns dark into bright).
    ///
    /// Both images are noisy alike. The gain that leaves the least residual would be too small by the share that noise
    /// has in the variance of g, so the line is the one closest to the pairs (f, g) in both directions (Deming 1943),
    /// whose slope noise does not change. Where the two share less than half of their variance most of the rest is
    /// misfit, far from the solution, and the slope of that line is of any size: there the gain is the ratio of the
    /// two contrasts.
    pub fn transfer(&self) -> Option<super::GreyTransfer> {
        self.transfer_for(1.0)
    }

    /// The same when the noise variance in f is `ratio` times that in g: interpolation and averaged references make it
    /// another than 1.
    pub fn transfer_for(&self, ratio: f64) -> Option<super::GreyTransfer> {
        if self.n < 2.0 {
            return None;
        }
        let (vf, vg, c) = self.covariances();
        if !(vg > 0.0 && c > 0.0) {
            return None;
        }
        if c * c < SHARED * vf * vg {
            let gain = (vf / vg).sqrt();
            return Some(super::GreyTransfer { gain, offset: (self.f - gain * self.g) / self.n });
        }
        // Without cancellation, whichever of the two varies more.
        let half = 0.5 * (vf - ratio * vg);
        let root = half.hypot(ratio.sqrt() * c);
        let gain = if half > 0.0 { (half + root) / c } else { ratio * c / (root - half) };
        Some(super::GreyTransfer { gain, offset: (self.f - gain * self.g) / self.n })
    }

    /// Root mean square of the residual, grey levels; 0 when nothing is counted.
    pub fn residual_rms(&self) -> f64 {
        if self.n > 0.0 { (self.rr / self.n).max(0.0).sqrt() } else { 0.0 }
    }
}

/// How one element matched, from its sums.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ElementMatch {
    /// Pixels counted: 0 when the element is left out.
    pub n: f64,
    /// Root mean square of the residual, grey levels.
    pub residual_rms: f64,
    /// Correlation coefficient of f and g.
    pub correlation: f64,
}

impl From<&PixelSums> for ElementMatch {
    fn from(sums: &PixelSums) -> Self {
        Self { n: sums.n, residual_rms: sums.residual_rms(), correlation: sums.correlation() }
    }
}

impl ElementMatch {
    /// Mean correlation coefficient, by pixels, of several elements that each have a gain and offset of their
    /// own; one that is anticorrelated counts as 0, as a flat one does.
    pub fn mean_correlation(elements: &[Self]) -> f64 {
        let n: f64 = elements.iter().map(|e| e.n).sum();
        let sum: f64 = elements.iter().map(|e| e.n * e.correlation.max(0.0)).sum();
        if n > 0.0 { sum / n } else { 0.0 }
    }
}

/// The sums of one element from which its normal matrix is made (THEORY 2).
///
/// A product of two Q4 shape functions is a product of one of three functions of xi and one of three of
/// eta, so the 36 entries of the 8x8 matrix are combinations of 27 sums.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ElementMoments {
    /// `gradient[p][q][w]`: product p of (fx fx, fx fy, fy fy), eta weight q and xi weight w of
    /// ((1-s)^2, s(1-s), s^2).
    pub gradient: [[[f64; 3]; 3]; 3],
    /// Sums of `psi_a fx`, `psi_a fy` (unknown 2 a + c), times f and times 1: the coupling of displacement
    /// and grey-level transfer. Not filled where brightness is not followed.
    pub transfer: [[f64; 8]; 2],
    /// Pixels.
    pub n: f64,
    /// Sum of f.
    pub f: f64,
    /// Sum of f^2.
    pub ff: f64,
}

/// `solver` with what a gain and an offset of the zones' grey levels move, where they are followed: the solutions for
/// `B_f` and `B_1`, the right-hand sides of residuals f and 1 (THEORY 2). Light is then solved with the displacement.
pub fn couple(solver: Solver, pattern: &Pattern, moments: &[ElementMoments], brightness: Brightness) -> Solver {
    match brightness {
        Brightness::Zone => {
            solver.with_responses([0, 1].map(|k| pattern.gather(|element| moments[element].transfer[k])))
        }
        _ => solver,
    }
}

/// Whether corner a of an element is at the far end along xi and along eta.
const FAR: [[usize; 2]; 4] = [[0, 0], [1, 0], [1, 1], [0, 1]];

impl ElementMoments {
    /// These of `share` as many pixels.
    pub fn scaled(&self, share: f64) -> Self {
        let Self { gradient, transfer, n, f, ff } = *self;
        Self {
            gradient: gradient.map(|of| of.map(|row| row.map(|v| share * v))),
            transfer: transfer.map(|of| of.map(|v| share * v)),
            n: share * n,
            f: share * f,
            ff: share * ff,
        }
    }

    /// Sum over the pixels of product `p` of the gradient's components: fx fx, fx fy, fy fy.
    pub fn gradient_power(&self, p: usize) -> f64 {
        // (1-s)^2 + 2 s (1-s) + s^2 is 1 along both axes.
        const ONE: [f64; 3] = [1.0, 2.0, 1.0];
        let row = |sums: &[f64; 3]| sums.iter().zip(ONE).map(|(sum, one)| one * sum).sum::<f64>();
        self.gradient[p].iter().zip(ONE).map(|(sums, one)| one * row(sums)).sum()
    }

    /// The element's normal matrix `sum (psi_i . grad f)(psi_j . grad f)`.
    pub fn matrix(&self) -> ElementMatrix {
        let mut matrix = [0.0; 36];
        let mut at = 0;
        for i in 0..8 {
            for j in i..8 {
                let ([xa, ya], [xb, yb]) = (FAR[i / 2], FAR[j / 2]);
                matrix[at] = self.gradient[i % 2 + j % 2][ya + yb][xa + xb];
                at += 1;
            }
        }
        matrix
    }

    /// The normal matrix with the element's own gain and offset eliminated: `M - B D^-1 B^T` (THEORY 2).
    pub fn matrix_without_transfer(&self) -> ElementMatrix {
        let mut matrix = self.matrix();
        let determinant = self.ff * self.n - self.f * self.f;
        if determinant > 0.0 {
            let [bf, b1] = &self.transfer;
            let mut at = 0;
            for i in 0..8 {
                for j in i..8 {
                    matrix[at] -= (self.n * bf[i] * bf[j] - self.f * (bf[i] * b1[j] + b1[i] * bf[j])
                        + self.ff * b1[i] * b1[j])
                        / determinant;
                    at += 1;
                }
            }
        }
        matrix
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sums over 100 pixels about zero with these variances and this correlation coefficient.
    fn sums(vf: f64, vg: f64, correlation: f64) -> PixelSums {
        let n = 100.0;
        let fg = n * correlation * (vf * vg).sqrt();
        PixelSums { n, n_all: n, ff: n * vf, gg: n * vg, fg, ..PixelSums::default() }
    }

    #[test]
    fn the_gain_is_free_of_noise_and_does_not_blow_up_far_from_the_solution() {
        // Texture of variance 3 and noise of variance 1 in both: least squares would say 3/4.
        assert_eq!(sums(4.0, 4.0, 0.75).transfer().unwrap().gain, 1.0);
        // Hardly alike: the line closest in both directions would have a gain of 15 and more.
        assert_eq!(sums(16.0, 4.0, 0.2).transfer().unwrap().gain, 2.0);
        assert!(sums(4.0, 4.0, -0.5).transfer().is_none());
    }
}
