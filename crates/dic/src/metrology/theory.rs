//! What elements and noise allow, by formula: THEORY 2 on a texture spread evenly.

use crate::field::StrainWindow;
use std::f64::consts::{PI, TAU};

/// Share of a wave's amplitude that must be left for its period to count as resolved.
pub const RESOLVED: f64 = 0.9;

/// Where the crest of a wave stands on the mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Crest {
    /// On a row of nodes: the best case.
    AtNode,
    /// Anywhere: the mean over all phases, which is the amplitude of the wave in the field.
    Averaged,
    /// In the middle between two rows of nodes: the worst case.
    AtMiddle,
}

impl Crest {
    /// The three cases, best first.
    pub const ALL: [Self; 3] = [Crest::AtNode, Crest::Averaged, Crest::AtMiddle];

    /// What the amplitude of nodal values becomes at such a crest: bilinear elements join them by straight lines.
    pub(super) fn by_node(self, period_by_size: f64) -> f64 {
        let half = PI / period_by_size;
        match self {
            Crest::AtNode => 1.0,
            Crest::Averaged => sinc(half).powi(2),
            Crest::AtMiddle => half.cos(),
        }
    }

    /// Shortest period resolved at 90 % of the amplitude, in element sizes: 1.80, 2.77 and 4.57.
    pub fn resolved_period_by_size(self) -> f64 {
        // The gain rises between these periods; bisection is good to 1e-15 of them after 60 steps.
        let (mut low, mut high) = if self == Crest::AtNode { (1.5, 2.2) } else { (2.2, 8.0) };
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if wave_gain(self, middle) < RESOLVED { low = middle } else { high = middle }
        }
        high
    }
}

fn sinc(x: f64) -> f64 {
    if x.abs() < 1e-9 { 1.0 } else { x.sin() / x }
}

/// Share of its amplitude that a displacement wave of `period_by_size` element sizes keeps in Q4 elements.
///
/// The least-squares field of linear elements has the nodal values `sinc^2(k l / 2) 3 / (2 + cos k l)` times those of
/// the wave, `k = 2 pi / period` (up to 1.44 near 2.5 sizes), and is straight between them.
///
/// ```
/// # use quadrille_dic as quadrille;
/// use quadrille::metrology::{Crest, wave_gain};
/// assert!((wave_gain(Crest::Averaged, 2.77) - 0.9).abs() < 1e-3); // 2.77 element sizes: resolved at 90 %
/// assert!(wave_gain(Crest::AtMiddle, 2.77) < 0.6);
/// ```
pub fn wave_gain(crest: Crest, period_by_size: f64) -> f64 {
    let phase = TAU / period_by_size;
    let nodal = sinc(0.5 * phase).powi(2) * 3.0 / (2.0 + phase.cos());
    nodal * crest.by_node(period_by_size)
}

/// Share of its amplitude that a wave of strain keeps, far from the borders: exx that varies along x, or `across` it,
/// along y, as eyy and the gradients of the shear do likewise. Exact sines through the least-squares field of linear
/// elements ([`wave_gain`] at the nodes), then through the plane fitted to `window`, at its node in the middle; without
/// a window the gradient at the centre of an element.
pub fn strain_wave_gain(window: Option<StrainWindow>, across: bool, period_by_size: f64) -> f64 {
    let half = PI / period_by_size;
    let operator = match (window, across) {
        (Some(window), _) => window.wave_gain(period_by_size, across),
        (None, false) => sinc(half),
        (None, true) => half.cos(),
    };
    wave_gain(Crest::AtNode, period_by_size) * operator
}

/// Shortest period, in element sizes, from which on strain waves keep 90 % ([`strain_wave_gain`]).
///
/// ```
/// # use quadrille_dic as quadrille;
/// use quadrille::{field::StrainWindow, metrology::strain_period_by_size};
/// assert!((strain_period_by_size(None, true) - 4.57).abs() < 0.005); // the worst case of displacements
/// let of = |nodes| strain_period_by_size(StrainWindow::new(nodes), false);
/// assert!(of(3) < of(5) && of(5) < of(7));
/// ```
pub fn strain_period_by_size(window: Option<StrainWindow>, across: bool) -> f64 {
    let gain = |period: f64| strain_wave_gain(window, across, period);
    // Some per cent are lost at 10 lengths of the gauge; from there down to where a tenth is.
    let mut high = 10.0 * window.map_or(1, StrainWindow::nodes) as f64;
    while gain(0.99 * high) >= RESOLVED {
        high *= 0.99;
    }
    let mut low = 0.99 * high;
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if gain(middle) < RESOLVED { low = middle } else { high = middle }
    }
    high
}

/// Standard uncertainty of an inner node's displacement, px: `sqrt(6) sigma / (l g)`, with noise `sigma_grey` in both
/// images, elements of `size_px` and the rms `gradient` (grey levels per px) along the component.
pub fn displacement_sigma_px(sigma_grey: f64, size_px: f64, gradient: f64) -> f64 {
    6f64.sqrt() * sigma_grey / (size_px * gradient)
}

/// Standard uncertainty of a normal strain at the centre of an element: `2.36 sigma / (l^2 g)`.
///
/// The strain is the difference of two means of two nodal values over `l`. With
/// `m(t) = (2 + cos t) / 3` the symbol of the linear elements' mass matrix, its variance is
/// `2 sigma^2 / g^2 / l^4` times the means over all phases of `4 sin^2(t/2) / m(t)` and `cos^2(t/2) / m(t)`.
pub fn strain_sigma(sigma_grey: f64, size_px: f64, gradient: f64) -> f64 {
    // Both means by the midpoint rule, which is exact to round-off for smooth periodic functions.
    const N: usize = 64;
    let mean = |f: fn(f64) -> f64| {
        (0..N).map(|k| TAU * (k as f64 + 0.5) / N as f64).map(|t| f(t) * 3.0 / (2.0 + t.cos())).sum::<f64>() / N as f64
    };
    let along = mean(|t| 4.0 * (0.5 * t).sin().powi(2));
    let across = mean(|t| (0.5 * t).cos().powi(2));
    (2.0 * along * across).sqrt() * sigma_grey / (size_px * size_px * gradient)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn periods_resolved_are_those_of_the_theory() {
        for (crest, want) in [(Crest::AtNode, 1.80), (Crest::Averaged, 2.77), (Crest::AtMiddle, 4.57)] {
            // Two decimals are stated.
            assert!((crest.resolved_period_by_size() - want).abs() < 0.005, "{crest:?}");
        }
    }

    #[test]
    fn wave_gain_is_that_of_a_least_squares_fit_made_by_hand() {
        // Linear elements of size 1 on a ring of n nodes, so that no border is felt: solve the mass matrix
        // (circulant: by repeated substitution) against exact integrals of the wave.
        let (n, waves) = (120usize, 43.0);
        let k = TAU * waves / n as f64;
        // The integral of cos(k x) times the hat at j, by the midpoint rule.
        let steps = 4000;
        let load = |j: usize| -> f64 {
            (0..2 * steps)
                .map(|s| (s as f64 + 0.5) / steps as f64 - 1.0)
                .map(|t| (1.0 - t.abs()) * (k * (j as f64 + t)).cos())
                .sum::<f64>()
                / steps as f64
        };
        let loads: Vec<f64> = (0..n).map(load).collect();
        let mut u = vec![0.0; n];
        for _ in 0..200 {
            u = (0..n).map(|j| 1.5 * (loads[j] - (u[(j + n - 1) % n] + u[(j + 1) % n]) / 6.0)).collect();
        }
        let gain = u[0]; // the crest stands at node 0
        assert!((gain - wave_gain(Crest::AtNode, n as f64 / waves)).abs() < 1e-6, "{gain}");
    }

    #[test]
    fn strain_noise_has_the_factor_of_the_theory() {
        assert!((strain_sigma(1.0, 1.0, 1.0) - 2.36).abs() < 0.005, "{}", strain_sigma(1.0, 1.0, 1.0));
    }
}
