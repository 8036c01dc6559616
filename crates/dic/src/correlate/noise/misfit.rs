//! How far the residual of an element is beyond that of its zone: what does not match, or is not of the specimen.
//!
//! The mean squares of the residual of a zone's elements are fitted by noise, constant and with the grey level, plus a
//! share of the gradient's: a blur, the interpolation and a displacement that is followed nowhere grow with it.

use crate::backend::{ElementMatch, ElementMoments, GreyTransfer};
use crate::correlate::{NoiseGain, displacement_in_middle};
use crate::mesh::Mesh;
use crate::units::Px;

/// Below this correlation coefficient a zone does not match the reference, whatever the corrections say, and an element
/// does not say what the noise is.
pub(crate) const MATCHED: f64 = 0.5;
/// Share of the elements of a zone that are beyond its noise by chance, all of them together.
const FALSE_ALARM: f64 = 0.01;
/// Elements of a zone from which its noise can be told from its misfit.
const ENOUGH: usize = 16;
/// A share of the gradient this many standard deviations from nothing is real.
const SIGNIFICANT: f64 = 3.0;
/// Elements that are enough to tell the noise of a zone by; of more, every second, third, .. is taken.
const SAMPLE: usize = 1024;
/// Of an element without texture the residual is weighed by this share of its zone's: by its own everything would be
/// a displacement.
const LEAST_TEXTURE: f64 = 0.01;
/// Elements beyond this many standard deviations do not say what the noise is.
const OUTLYING: f64 = 3.5;

/// Elements that match are enough to say what the noise of their zone is when they are more than this share of it.
const LEAST_ALIKE: f64 = 0.15;

#[derive(Debug, Clone, Copy)]
struct ElementTexture {
    /// Mean square of each component of the gradient, (grey levels per px)^2.
    gradient: [f64; 2],
    /// Mean grey level, and variance about it.
    grey: f64,
    variance: f64,
}

/// The elements of a reference as the test sees them.
pub(crate) struct MisfitTest {
    texture: Vec<ElementTexture>,
    /// Elements around each node.
    around: Vec<f64>,
    gradient_noise_gain: f64,
    /// Noise of the reference by its fine structure, which texture may add to, grey levels.
    pub fine: f64,
}

/// What one element's residual is against that of its zone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Look {
    /// Mean square of the residual over that of the zone, with what grows with the gradient.
    pub ratio: f64,
    /// Displacement that would leave what is beyond, root mean square, px.
    pub px: f64,
    /// What is beyond, over the variance of the texture.
    pub share: f64,
    /// Whether chance alone does not bring it there.
    pub is_beyond: bool,
}

pub(crate) struct Residuals<'a> {
    pub mesh: &'a Mesh<Px>,
    pub gain: &'a NoiseGain,
    pub elements: &'a [ElementMatch],
    pub displacement: &'a [[f64; 2]],
    /// Per zone.
    pub transfer: &'a [GreyTransfer],
    /// Degrees of freedom that each node takes, and each element beside.
    pub freedom: &'a [f64],
    pub freedom_of_element: f64,
    /// Noise of one image where it is stated, grey levels.
    pub noise: Option<f64>,
    /// Elements that are looked at, but do not say what the noise is.
    pub excluded: &'a [bool],
}

struct Seen {
    element: usize,
    /// Pixels less degrees of freedom.
    n: f64,
    /// Variance of the residual for noise of one grey level.
    gain: f64,
    /// Mean square of the residual over `gain`: the noise's variance, and what is beyond.
    y: f64,
    grey: f64,
    /// Mean square of a component of the gradient over `gain`.
    x: f64,
}

/// The noise of a zone, as its elements show it.
#[derive(Clone, Copy)]
struct ZoneNoise {
    /// Variance at the mean grey level, and its slope.
    constant: f64,
    slope: f64,
    mean_grey: f64,
    /// Standard deviation of an element's mean square of pure noise, in that, times the root of its pixels.
    spread: f64,
    /// What grows with the gradient, px^2; zero where that is not significant.
    by_texture: f64,
}

impl ZoneNoise {
    fn at(&self, seen: &Seen) -> f64 {
        // Dark elements are not without noise.
        (self.constant + self.slope * (seen.grey - self.mean_grey)).max(0.25 * self.constant)
    }
}

impl MisfitTest {
    pub fn new(mesh: &Mesh<Px>, moments: &[ElementMoments], gradient_noise_gain: f64, fine: f64) -> Self {
        let texture = moments
            .iter()
            .map(|m| {
                let n = m.n.max(1.0);
                let grey = m.f / n;
                let variance = m.ff / n - grey * grey;
                ElementTexture { gradient: [m.gradient_power(0) / n, m.gradient_power(2) / n], grey, variance }
            })
            .collect();
        let mut around = vec![0.0; mesh.n_nodes()];
        for (nodes, m) in mesh.elements().iter().zip(moments) {
            let corners = if nodes[2] == nodes[3] { 3 } else { 4 };
            nodes[..corners].iter().for_each(|&node| around[node as usize] += f64::from(u8::from(m.n > 0.0)));
        }
        Self { texture, around, gradient_noise_gain, fine }
    }

    fn look_at_zones(&self, frame: &Residuals<'_>) -> Vec<Vec<Seen>> {
        let mesh = frame.mesh;
        let of_zone = |zone| mesh.zone_elements(zone).filter_map(|element| self.look_at(frame, element)).collect();
        (0..mesh.zones().len()).map(of_zone).collect()
    }

    /// How far the residual of each element is beyond what that of its zone is; none of elements that say nothing.
    /// Elements that do not correlate do not say what the noise is, unless all but a few do not.
    pub fn rate_residuals(&self, frame: &Residuals<'_>) -> Vec<Option<Look>> {
        let mut looks = vec![None; frame.mesh.n_elements()];
        for seen in self.look_at_zones(frame) {
            let kept = |one: &&Seen| !frame.excluded[one.element];
            let alike = |one: &&Seen| kept(one) && frame.elements[one.element].correlation >= MATCHED;
            let n_alike = seen.iter().filter(alike).count();
            let said: Vec<&Seen> = match n_alike as f64 > LEAST_ALIKE * seen.len() as f64 {
                true => seen.iter().filter(alike).collect(),
                false => seen.iter().filter(kept).collect(),
            };
            let sample = sample_of(said);
            let in_both = self.gradient_noise_gain * frame.gain.of_reference.powi(2);
            let Some(mut noise) = zone_noise(&sample, frame.noise, self.fine, in_both) else { continue };
            let by_chance = normal_quantile(1.0 - FALSE_ALARM / seen.len().max(1) as f64);
            if sample.len() < ENOUGH {
                // Of a few, one that is off must not say what the others are held against.
                let mut sorted: Vec<f64> = sample.iter().map(|one| one.y).collect();
                sorted.sort_by(f64::total_cmp);
                noise.constant = noise.constant.min(sorted[(sorted.len() - 1) / 2]);
            }
            let mean = |of: &dyn Fn(&ElementTexture) -> f64| {
                seen.iter().map(|one| of(&self.texture[one.element])).sum::<f64>() / seen.len().max(1) as f64
            };
            let least_power = LEAST_TEXTURE * mean(&|of| 0.5 * (of.gradient[0] + of.gradient[1]));
            let least_variance = LEAST_TEXTURE * mean(&|of| of.variance);
            for one in &seen {
                let expected = noise.at(one) + noise.by_texture * one.x;
                let power = 0.5 * (self.texture[one.element].gradient[0] + self.texture[one.element].gradient[1]);
                let texture = (power - self.gradient_noise_gain * noise.at(one)).max(0.25 * power).max(least_power);
                let excess = one.gain * (one.y - expected).max(0.0);
                let px = (excess / texture.max(f64::MIN_POSITIVE)).sqrt();
                let share = excess / self.texture[one.element].variance.max(least_variance).max(f64::MIN_POSITIVE);
                let ratio = one.y / expected.max(f64::MIN_POSITIVE);
                let is_beyond = ratio > chi_square_ratio(by_chance, noise.spread / one.n.sqrt());
                looks[one.element] = Some(Look { ratio, px, share, is_beyond });
            }
        }
        looks
    }

    fn look_at(&self, frame: &Residuals<'_>, element: usize) -> Option<Seen> {
        let (mesh, found) = (frame.mesh, &frame.elements[element]);
        let nodes = mesh.elements()[element];
        let corners = if nodes[2] == nodes[3] { 3 } else { 4 };
        let of_node = |&node: &u32| frame.freedom[node as usize] / self.around[node as usize].max(1.0);
        let taken: f64 = nodes[..corners].iter().map(of_node).sum();
        let n = found.n - taken - frame.freedom_of_element;
        let transfer = frame.transfer[mesh.element_zone()[element] as usize];
        let gain = frame.gain.of_pair(displacement_in_middle(nodes, frame.displacement), transfer);
        let y = found.residual_rms.powi(2) * found.n / n / gain;
        let ElementTexture { gradient, grey, .. } = self.texture[element];
        let known = n >= 4.0 && y.is_finite() && gain.is_finite() && gain > 0.0;
        known.then(|| Seen { element, n, gain, y, grey, x: 0.5 * (gradient[0] + gradient[1]) / gain })
    }
}

/// Those of the elements of a zone that its noise is told by.
fn sample_of(seen: Vec<&Seen>) -> Vec<&Seen> {
    let every = seen.len().div_ceil(SAMPLE).max(1);
    if every == 1 { seen } else { seen.into_iter().step_by(every).collect() }
}

/// The noise of the elements of a zone; none where nothing is seen. `in_both`: the reference's noise is in residual and
/// gradient, which by chance grow together: their covariance over the noise's variance squared, times n/2.
fn zone_noise(seen: &[&Seen], stated: Option<f64>, fine: f64, in_both: f64) -> Option<ZoneNoise> {
    let mean = |f: &dyn Fn(&Seen) -> f64| {
        let n: f64 = seen.iter().map(|one| one.n).sum();
        seen.iter().map(|one| one.n * f(one)).sum::<f64>() / n
    };
    if seen.is_empty() {
        return None;
    }
    let (mean_grey, mean_x) = (mean(&|one| one.grey), mean(&|one| one.x));
    let spread_grey = mean(&|one| (one.grey - mean_grey).powi(2)).sqrt();
    let white = 2f64.sqrt();
    let constant = mean(&|one| one.y);
    let mut found = ZoneNoise { constant, slope: 0.0, mean_grey, spread: white, by_texture: 0.0 };
    if seen.len() < ENOUGH || mean_x <= 0.0 {
        if let Some(noise) = stated {
            found.constant = found.constant.min(noise * noise);
        }
        return Some(found);
    }
    let mut sorted: Vec<f64> = seen.iter().map(|one| one.y).collect();
    sorted.sort_by(f64::total_cmp);
    let quiet = 1.5 * sorted[sorted.len() / 4];
    let mut limits: Vec<f64> = vec![quiet; seen.len()];
    let mut weights = vec![1.0 / (quiet * quiet).max(f64::MIN_POSITIVE); seen.len()];
    // A slope with the grey level needs elements of different ones.
    let features = |one: &Seen| {
        let grey = if spread_grey > 0.0 { (one.grey - mean_grey) / spread_grey } else { 0.0 };
        [1.0, grey, one.x / mean_x]
    };
    /// Fits under weights that the fit before gives; nothing tests that they have settled.
    const ROUNDS: usize = 5;
    // Variance of the noise by the round before and the fine structure: at first all of the residual may be misfit.
    let fine = stated.map_or(fine, |stated| stated.min(fine));
    let mut noise = 0.0;
    for _ in 0..ROUNDS {
        let mut with_texture = true;
        let kept = || seen.iter().zip(&limits).zip(&weights).filter(|((one, limit), _)| one.y <= **limit);
        let fitted = loop {
            let (mut matrix, mut rhs, mut n_kept) = ([[0.0; 3]; 3], [0.0; 3], 0usize);
            for ((one, _), &weight) in kept() {
                let phi = features(one);
                n_kept += 1;
                for i in 0..3 {
                    rhs[i] += one.n * weight * phi[i] * one.y;
                    (0..3).for_each(|j| matrix[i][j] += one.n * weight * phi[i] * phi[j]);
                }
                rhs[2] -= weight * 2.0 * in_both * (noise / one.gain).powi(2) / mean_x;
            }
            if spread_grey <= 0.0 {
                matrix[1] = [0.0, 1.0, 0.0];
            }
            if !with_texture {
                (0..3).for_each(|k| (matrix[2][k], matrix[k][2]) = (0.0, 0.0));
                (matrix[2][2], rhs[2]) = (1.0, 0.0);
            }
            let Some((solution, variance)) = solve_symmetric(matrix, rhs) else {
                // Grey level and gradient may go together.
                if with_texture {
                    with_texture = false;
                    continue;
                }
                return Some(found);
            };
            // Scatter of an element's mean square about the fit, in that, for one pixel: not below that of white noise.
            let fit = |one: &Seen| features(one).iter().zip(solution).map(|(phi, a)| phi * a).sum::<f64>();
            let low = solution[0].abs().max(f64::MIN_POSITIVE) * 0.25;
            let scatter: f64 =
                kept().map(|((one, _), _)| one.n * (one.y / fit(one).max(low) - 1.0).powi(2)).sum::<f64>();
            let spread = (scatter / n_kept.saturating_sub(3).max(1) as f64).sqrt().clamp(white, 4.0 * white);
            let share = solution[2] / (spread * variance[2].sqrt());
            if with_texture && !(share > SIGNIFICANT && n_kept >= ENOUGH) {
                with_texture = false;
                continue;
            }
            break (solution, spread, with_texture);
        };
        let ([constant, by_grey, by_texture], spread, with_texture) = fitted;
        found.slope = if spread_grey > 0.0 { by_grey / spread_grey } else { 0.0 };
        found.constant = constant.max(0.01 * sorted[0]);
        noise = found.constant.min(fine * fine);
        found.spread = spread;
        found.by_texture = if with_texture { by_texture / mean_x } else { 0.0 };
        for ((limit, weight), one) in limits.iter_mut().zip(&mut weights).zip(seen) {
            let fit = found.at(one) + found.by_texture * one.x;
            *limit = fit * (1.0 + OUTLYING * spread / one.n.sqrt());
            *weight = 1.0 / (fit * fit).max(f64::MIN_POSITIVE);
        }
    }
    Some(found)
}

/// The solution of three symmetric equations, and the diagonal of the inverse; none where they are singular.
fn solve_symmetric(m: [[f64; 3]; 3], rhs: [f64; 3]) -> Option<([f64; 3], [f64; 3])> {
    let cofactor = |i: usize, j: usize| {
        let [a, b, c, d] = [(i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3];
        m[a][c] * m[b][d] - m[a][d] * m[b][c]
    };
    let determinant: f64 = (0..3).map(|j| m[0][j] * cofactor(0, j)).sum();
    let size = m[0][0] * m[1][1] * m[2][2];
    if !(determinant > 1e-9 * size && size.is_finite()) {
        return None;
    }
    let solution = [0, 1, 2].map(|i| (0..3).map(|j| cofactor(j, i) * rhs[j]).sum::<f64>() / determinant);
    Some((solution, [0, 1, 2].map(|i| cofactor(i, i) / determinant)))
}

/// What a mean square of relative standard deviation `spread` exceeds, in its mean, as rarely as a normal variable `z`.
fn chi_square_ratio(z: f64, spread: f64) -> f64 {
    let ninth = spread * spread / 9.0; // 2 / (9 n) for n degrees of freedom
    (1.0 - ninth + z * ninth.sqrt()).powi(3)
}

/// The quantile of a standard normal variable at `p`, above 1/2, to 5e-4 (Abramowitz & Stegun 26.2.23).
fn normal_quantile(p: f64) -> f64 {
    let t = (-2.0 * (1.0 - p).max(1e-300).ln()).sqrt();
    t - (2.515517 + t * (0.802853 + t * 0.010328)) / (1.0 + t * (1.432788 + t * (0.189269 + t * 0.001308)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_tables() {
        // Normal: 2.3263, 4.2649; chi square of 256 degrees of freedom at 1 %: 311.56.
        assert!((normal_quantile(0.99) - 2.3263).abs() < 1e-3);
        assert!((normal_quantile(1.0 - 1e-5) - 4.2649).abs() < 1e-3);
        let ratio = chi_square_ratio(2.3263, (2.0f64 / 256.0).sqrt());
        assert!((256.0 * ratio - 311.56).abs() < 0.1, "{}", 256.0 * ratio);
    }

    /// Mean squares of 256 px of noise of variance 4, with a displacement `px` not followed, on textures that differ.
    fn elements(px: f64, count: usize) -> Vec<Seen> {
        // A fixed scatter of the size that noise has, sqrt(2/256), without any order.
        let scatter = |k: usize| (((k * 7919) % 1009) as f64 / 1009.0 - 0.5) * 12f64.sqrt() * (2.0f64 / 256.0).sqrt();
        (0..count)
            .map(|k| {
                let x = 100.0 * (1.0 + 0.5 * ((k * 31) as f64).sin());
                let y = (4.0 + px * px * x) * (1.0 + scatter(k));
                Seen { element: k, n: 256.0, gain: 2.0, y, grey: 20.0 * ((k * 17) as f64).cos(), x }
            })
            .collect()
    }

    #[test]
    fn noise_is_told_from_a_misfit_that_is_everywhere() {
        for px in [0.0, 0.2, 0.5] {
            let noise = zone_noise(&elements(px, 400).iter().collect::<Vec<_>>(), None, 2.0, 0.0).unwrap();
            // The intercept of 400 elements scatters by about 2 % of the mean, 4 + 100 px^2.
            assert!((noise.constant - 4.0).abs() < 0.08 * (4.0 + 100.0 * px * px), "{px}: {}", noise.constant);
            assert!((noise.by_texture - px * px).abs() < 0.1 * px * px + 1e-12, "{px}: {}", noise.by_texture);
        }
    }

    #[test]
    fn elements_that_are_far_off_do_not_count_as_noise() {
        let mut seen = elements(0.0, 200);
        seen.iter_mut().take(30).for_each(|one| one.y *= 20.0);
        let noise = zone_noise(&seen.iter().collect::<Vec<_>>(), None, 2.0, 0.0).unwrap();
        assert!((noise.constant - 4.0).abs() < 0.1, "{}", noise.constant);
        assert_eq!(noise.by_texture, 0.0);
    }
}
