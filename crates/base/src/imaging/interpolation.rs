//! The sub-pixel interpolations of the deformed image (THEORY 2).

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::str::FromStr;

/// How grey levels between pixels are found.
///
/// Bias of a displacement by a quarter pixel, speckles of 4 to 5 px: cubic about 7e-4 px, quintic
/// about 6e-5 px. Keys and bilinear need no prefilter and are less accurate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Interpolation {
    /// Cubic B-spline through the grey levels (exact recursive prefilter).
    Cubic,
    /// Quintic B-spline through the grey levels: the smallest bias, a tenth more time; the default.
    #[default]
    Quintic,
    /// Keys' cubic convolution (a = -1/2).
    Keys,
    /// Bilinear: for a quick look, not for measuring.
    Bilinear,
}

impl Interpolation {
    /// Name used in options and files.
    pub fn name(self) -> &'static str {
        match self {
            Interpolation::Cubic => "cubic",
            Interpolation::Quintic => "quintic",
            Interpolation::Keys => "keys",
            Interpolation::Bilinear => "bilinear",
        }
    }
}

impl FromStr for Interpolation {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        [Self::Cubic, Self::Quintic, Self::Keys, Self::Bilinear]
            .into_iter()
            .find(|interpolation| interpolation.name() == name)
            .ok_or_else(|| format!("'{name}' is not one of cubic, quintic, keys, bilinear"))
    }
}

/// Impulse response of the prefilter at `-REACH..=REACH`: `REACH` puts what is cut below 1e-11.
const REACH: i32 = 30;

impl Interpolation {
    /// `(degree, poles)` of the B-splines.
    fn b_spline(self) -> Option<(i32, &'static [f64])> {
        match self {
            Interpolation::Cubic => Some((3, &[-0.267_949_192_431_122_7])),
            Interpolation::Quintic => Some((5, &[-0.430_575_347_099_973_8, -0.043_096_288_203_264_65])),
            Interpolation::Keys | Interpolation::Bilinear => None,
        }
    }

    /// Poles of the recursive prefilter (Unser 1999), empty for an interpolation that needs none.
    pub fn poles(self) -> &'static [f64] {
        self.b_spline().map_or(&[], |(_, poles)| poles)
    }

    /// Amplitudes of the impulse response of the prefilter, `sum_p a_p z_p^|k|` over its poles: partial fractions of
    /// `prod_p (1 - z_p)^2 / ((1 - z_p / z) (1 - z_p z))`, which is 1 for a constant (Unser 1999).
    pub fn amplitudes(self) -> impl Iterator<Item = f64> {
        let poles = self.poles();
        poles.iter().map(|&z| {
            let others = poles.iter().filter(move |&&other| other != z);
            let at_pole: f64 = others.map(|o| (1.0 - o).powi(2) / (1.0 + o * o - o * (z + 1.0 / z))).product();
            (1.0 - z) / (1.0 + z) * at_pole
        })
    }

    /// Impulse response of the prefilter `k` pixels away.
    fn prefilter_response(self, k: i32) -> f64 {
        if self.poles().is_empty() {
            return f64::from(u8::from(k == 0));
        }
        self.poles().iter().zip(self.amplitudes()).map(|(z, a)| a * z.powi(k.abs())).sum()
    }

    /// Weight, in the grey level at a point, of the pixel `x` px away: the cardinal function eta(x).
    pub fn cardinal(self, x: f64) -> f64 {
        let a = x.abs();
        match self {
            Interpolation::Bilinear => (1.0 - a).max(0.0),
            Interpolation::Keys if a < 1.0 => (1.5 * a - 2.5) * a * a + 1.0,
            Interpolation::Keys if a < 2.0 => ((-0.5 * a + 2.5) * a - 4.0) * a + 2.0,
            Interpolation::Keys => 0.0,
            Interpolation::Cubic | Interpolation::Quintic => {
                let degree = self.b_spline().map_or(3, |(degree, _)| degree);
                (-REACH..=REACH)
                    .map(|k| {
                        let spline = b_spline(degree, x - f64::from(k));
                        if spline == 0.0 { 0.0 } else { self.prefilter_response(k) * spline }
                    })
                    .sum()
            }
        }
    }

    /// Variance of the interpolated grey level `t` px beyond a pixel, per axis, for white noise of
    /// variance 1 in the pixels: `v(t) = sum_k eta(t + k)^2` (THEORY 2).
    ///
    /// ```
    /// # use quadrille_base as quadrille;
    /// use quadrille::imaging::Interpolation;
    /// assert!((Interpolation::Cubic.noise_gain(0.0) - 1.0).abs() < 1e-9);
    /// assert!((Interpolation::Cubic.noise_gain(0.5) - 0.756).abs() < 1e-3);
    /// ```
    pub fn noise_gain(self, t: f64) -> f64 {
        (-REACH..=REACH).map(|k| self.cardinal(t + f64::from(k)).powi(2)).sum()
    }

    /// The interpolation of which the reference has its gradient: this one, but the cubic spline for the quintic one,
    /// whose own gradient takes 1.36 times the noise. The solution is the same with either (THEORY 10).
    pub fn of_gradient(self) -> Self {
        if self == Self::Quintic { Self::Cubic } else { self }
    }

    /// Variance of the reference gradient at a pixel, per axis, for white noise of variance 1.
    pub fn gradient_noise_gain(self) -> f64 {
        (-REACH..=REACH).map(|k| self.gradient_weight(k).powi(2)).sum()
    }

    /// Weight, in the reference gradient along an axis, of the pixel `k` px away.
    ///
    /// ```
    /// # use quadrille_base as quadrille;
    /// use quadrille::imaging::Interpolation;
    /// for kernel in [Interpolation::Cubic, Interpolation::Quintic, Interpolation::Keys] {
    ///     // Of grey levels that rise by one per pixel it is one.
    ///     let slope: f64 = (-30..=30).map(|k| f64::from(k) * kernel.gradient_weight(k)).sum();
    ///     assert!((slope - 1.0).abs() < 1e-8, "{kernel:?}: {slope}");
    /// }
    /// ```
    pub fn gradient_weight(self, k: i32) -> f64 {
        let h = 1e-5; // central difference of a C1 function: error h^2, round-off 1e-11
        match self.of_gradient() {
            // The reference gradient of these two is the central difference.
            Interpolation::Keys | Interpolation::Bilinear => {
                [0.0, 0.5 * f64::from(k.signum())][usize::from(k.abs() == 1)]
            }
            spline => (spline.cardinal(f64::from(k) - h) - spline.cardinal(f64::from(k) + h)) / (2.0 * h),
        }
    }

    /// Share, along one axis, of the product of two noises left in a sum over pixels: the noise of the reference in its
    /// gradient, and that of the deformed image interpolated `t` px beyond its pixels (THEORY 10).
    ///
    /// `v_D(t) = sum_j R_D(j) R_t(j) / R_D(0)` with the autocorrelations of the weights of both; 1 at whole pixels. It
    /// is not [`noise_gain`](Self::noise_gain): both filters tie neighbouring pixels together.
    ///
    /// ```
    /// # use quadrille_base as quadrille;
    /// use quadrille::imaging::Interpolation;
    /// assert!((Interpolation::Cubic.gradient_noise_passed(0.0) - 1.0).abs() < 1e-9);
    /// let half = Interpolation::Cubic.gradient_noise_passed(0.5);
    /// assert!(half > 0.5 && half < 1.0);
    /// ```
    pub fn gradient_noise_passed(self, t: f64) -> f64 {
        const FAR: i32 = 12; // beyond, what is left is below 1e-6
        let reach = -REACH..=REACH;
        let slopes: Vec<f64> = reach.clone().map(|k| self.gradient_weight(k)).collect();
        let values: Vec<f64> = reach.map(|k| self.cardinal(t + f64::from(k))).collect();
        let correlated =
            |weights: &[f64], j: usize| -> f64 { weights.iter().zip(weights.iter().skip(j)).map(|(a, b)| a * b).sum() };
        let product = |j: i32| correlated(&slopes, j as usize) * correlated(&values, j as usize);
        (product(0) + 2.0 * (1..=FAR).map(product).sum::<f64>()) / correlated(&slopes, 0)
    }
}

/// beta_n(x) by its truncated powers (Schoenberg 1946).
fn b_spline(degree: i32, x: f64) -> f64 {
    if x.abs() >= f64::from(degree + 1) / 2.0 {
        return 0.0;
    }
    let factorial: f64 = (1..=degree).map(f64::from).product();
    let (mut sum, mut binomial) = (0.0, 1.0);
    for k in 0..=degree + 1 {
        let y = x + f64::from(degree + 1) / 2.0 - f64::from(k);
        sum += binomial * if y > 0.0 { y.powi(degree) } else { 0.0 };
        binomial *= -f64::from(degree + 1 - k) / f64::from(k + 1);
    }
    sum / factorial
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cardinal_functions_are_one_at_their_pixel_and_zero_at_the_others() {
        for interpolation in
            [Interpolation::Cubic, Interpolation::Quintic, Interpolation::Keys, Interpolation::Bilinear]
        {
            for k in -5..=5 {
                let want = if k == 0 { 1.0 } else { 0.0 };
                let got = interpolation.cardinal(f64::from(k));
                assert!((got - want).abs() < 1e-10, "{interpolation:?} at {k}: {got}");
            }
        }
    }

    #[test]
    fn noise_gain_is_that_of_the_theory_at_half_a_pixel() {
        // THEORY 2: 0.756 per axis for the cubic spline; two equal weights for the bilinear one.
        assert!((Interpolation::Cubic.noise_gain(0.5) - 0.756).abs() < 5e-4);
        assert!((Interpolation::Bilinear.noise_gain(0.5) - 0.5).abs() < 1e-12);
        assert!((Interpolation::Keys.gradient_noise_gain() - 0.5).abs() < 1e-12);
    }
}
