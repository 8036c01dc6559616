//! A pattern that stays with the camera, by which its pixels differ (docs/correlation.md, 2.7.2). Static images cannot
//! show it. The residual of a specimen that has moved holds it twice: where the reference had it, and with the other
//! sign where the deformed image has it. So what the residual has in common with itself as far on as the specimen has
//! moved is the variance of the pattern; at a right angle to that, where nothing is, is what else it has in common.

use serde::{Deserialize, Serialize};
use std::fmt;

/// The specimen moves by at least this, px, in one direction: closer, the interpolation mixes neighbours.
const LEAST_LAG: isize = 3;
/// Pixels of a block that a lag leaves along each side.
const LEAST_LEFT: isize = 4;
/// Blocks without which nothing is said: fewer do not tell their scatter well enough for thousands of frames.
const LEAST_BLOCKS: usize = 30;
/// The variance is this many of its standard deviations from nothing.
const SIGNIFICANT: f64 = 5.0;

/// What stays with the camera.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FixedPattern {
    /// Standard deviation from pixel to pixel, grey levels.
    pub grey: f64,
    /// Share by which it draws displacements of less than half a pixel towards zero.
    pub share: f64,
}

impl fmt::Display for FixedPattern {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { grey, share } = self;
        write!(
            f,
            "a pattern of {grey:.1} grey levels stays with the camera while the specimen moves; where the specimen moves by \
             less than half a pixel, displacements are {:.0} % too small",
            100.0 * share
        )
    }
}

/// The variance of the pattern by the residual of a square block of `side` px, whose middle has moved by `u`, px, and
/// of which the deformed image was multiplied by `gain`; `cardinal` is the function of the interpolation.
pub(crate) fn pattern_variance(
    residual: &[f32],
    side: usize,
    u: [f64; 2],
    gain: f64,
    cardinal: impl Fn(f64) -> f64,
) -> Option<f64> {
    let (lag, side) = (u.map(|u| u.round() as isize), side as isize);
    let [x, y] = lag.map(isize::abs);
    if x.max(y) < LEAST_LAG || x.max(y) > side - LEAST_LEFT {
        return None;
    }
    let mean_product = |[dx, dy]: [isize; 2]| {
        let rows = (-dy).max(0)..(side - dy).min(side);
        let sum: f64 = rows
            .flat_map(|j| ((-dx).max(0)..(side - dx).min(side)).map(move |i| (i, j)))
            .map(|(i, j)| {
                let at = |i: isize, j: isize| f64::from(residual[(j * side + i) as usize]);
                at(i, j) * at(i + dx, j + dy)
            })
            .sum();
        sum / ((side - dx.abs()) * (side - dy.abs())) as f64
    };
    let left = [0, 1].map(|c| cardinal(u[c] - lag[c] as f64));
    Some((mean_product([-lag[1], lag[0]]) - mean_product(lag)) / (gain * left[0] * left[1]))
}

/// The pattern by the variances that blocks show; none where it is not significant. `texture` is the mean square of a
/// component of the texture's gradient, and `gain` what a pattern of variance one adds to it.
pub(crate) fn find_pattern(variances: &[f64], texture: f64, gain: f64) -> Option<FixedPattern> {
    if variances.len() < LEAST_BLOCKS {
        return None;
    }
    let n = variances.len() as f64;
    let mean = variances.iter().sum::<f64>() / n;
    let scatter = (variances.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n * (n - 1.0))).sqrt();
    let share = gain * mean / (texture.max(0.0) + gain * mean);
    (mean > SIGNIFICANT * scatter).then(|| FixedPattern { grey: mean.sqrt(), share })
}
