//! Strains from a displacement field.
//!
//! The gradient of the displacement comes from the shape functions, the strain from `F = I + grad u`, all in `f64`; the
//! shear is that of the tensor, `exy = (du_x/dy + du_y/dx)/2` for small strains: half the change of a right angle.

use super::UnknownChoice;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// How a strain is made of `F = I + grad u`.
///
/// A pure rotation has no Green-Lagrange and no Hencky strain. The infinitesimal strain sees it: rotation by `w`
/// gives `exx = eyy = cos w - 1`, -3.8e-3 at 5 degrees.
///
/// ```
/// # use quadrille_base as quadrille;
/// use quadrille::field::StrainDefinition;
/// assert_eq!("hencky".parse(), Ok(StrainDefinition::Hencky));
/// assert_eq!(StrainDefinition::default().to_string(), "green-lagrange");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum StrainDefinition {
    /// `(grad u + grad u^T)/2`: for small strains and small rotations.
    Infinitesimal,
    /// `(F^T F - I)/2`, on the axes of the reference image; the default.
    #[default]
    GreenLagrange,
    /// `ln U = ln(F^T F)/2`, on the axes of the reference image: logarithmic (true) strain.
    Hencky,
}

impl StrainDefinition {
    /// Name used in options and files.
    pub fn name(self) -> &'static str {
        match self {
            StrainDefinition::Infinitesimal => "infinitesimal",
            StrainDefinition::GreenLagrange => "green-lagrange",
            StrainDefinition::Hencky => "hencky",
        }
    }

    /// Its formula.
    pub fn formula(self) -> &'static str {
        match self {
            StrainDefinition::Infinitesimal => "(grad u + grad u^T)/2",
            StrainDefinition::GreenLagrange => "(F^T F - I)/2 with F = I + grad u",
            StrainDefinition::Hencky => "ln U = ln(F^T F)/2 with F = I + grad u",
        }
    }

    /// What a file with strains on elements of `length_px` says about them: definition, shear, length
    /// scale, noise. Without a sign of comment.
    ///
    /// ```
    /// # use quadrille_base as quadrille;
    /// use quadrille::field::StrainDefinition;
    /// let said = StrainDefinition::Hencky.describe(16.0);
    /// assert_eq!(said[0], "strain: hencky, ln U = ln(F^T F)/2 with F = I + grad u");
    /// assert_eq!(said.len(), 4);
    /// ```
    pub fn describe(self, length_px: f64) -> Vec<String> {
        let (element, node) = (ELEMENT_NOISE / length_px, NODE_NOISE / length_px);
        vec![
            format!("strain: {}, {}", self.name(), self.formula()),
            "components exx, eyy, exy, no unit, x to the right, y down; exy is the tensor shear, half the engineering shear"
                .to_owned(),
            format!(
                "length scale of a strain: {length_px} px on elements (their size), {} px on nodes (mean of the elements around)",
                2.0 * length_px
            ),
            format!(
                "noise of a strain, inside: sigma_exx = {element:.2e} sigma_ux on elements, {node:.2e} sigma_ux on nodes \
                 (sigma_ux in px of an inner node); eyy likewise with sigma_uy, exy half the root of the sum of both squares; \
                 more at borders"
            ),
        ]
    }

    /// The strain of the displacement gradient `[[du_x/dx, du_x/dy], [du_y/dx, du_y/dy]]`; `None` where the
    /// field folds (`det F <= 0`) or a number is not finite.
    ///
    /// ```
    /// # use quadrille_base as quadrille;
    /// use quadrille::field::StrainDefinition;
    /// let stretch = [[0.5, 0.0], [0.0, 0.0]];
    /// assert_eq!(StrainDefinition::GreenLagrange.of_gradient(stretch).unwrap().xx, 0.625); // (1.5^2 - 1)/2
    /// assert!((StrainDefinition::Hencky.of_gradient(stretch).unwrap().xx - 1.5f64.ln()).abs() < 1e-15);
    /// ```
    pub fn of_gradient(self, gradient: [[f64; 2]; 2]) -> Option<TensorStrain> {
        let [[xx, xy], [yx, yy]] = gradient;
        let det = 1.0 + (xx + yy) + (xx * yy - xy * yx);
        // Written so that NaN is refused as well.
        if !(det > 0.0 && det.is_finite()) {
            return None;
        }
        // F^T F - I formed without its cancellation: the strain of a tiny gradient keeps all its digits.
        let green = || {
            [
                xx + 0.5 * (xx * xx + yx * yx),
                yy + 0.5 * (xy * xy + yy * yy),
                0.5 * (xy + yx) + 0.5 * (xx * xy + yx * yy),
            ]
        };
        let strain = match self {
            StrainDefinition::Infinitesimal => [xx, yy, 0.5 * (xy + yx)],
            StrainDefinition::GreenLagrange => green(),
            StrainDefinition::Hencky => half_log_of_one_plus_twice(green()),
        };
        strain.iter().all(|e| e.is_finite()).then(|| TensorStrain::of_components(strain))
    }

    /// Derivatives of exx, eyy and exy by the components of the displacement gradient, at `gradient`; `None` where the
    /// field folds. What carries the noise of a gradient to that of its strain.
    pub(super) fn slopes(self, gradient: [[f64; 2]; 2]) -> Option<[[[f64; 2]; 2]; 3]> {
        // Central differences of smooth functions of order one: right to about 1e-10.
        const STEP: f64 = 1e-5;
        let mut slopes = [[[0.0; 2]; 2]; 3];
        for c in 0..2 {
            for k in 0..2 {
                let [low, high] = [-STEP, STEP].map(|step| {
                    let mut moved = gradient;
                    moved[c][k] += step;
                    self.of_gradient(moved)
                });
                let (low, high) = (low?.components(), high?.components());
                for e in 0..3 {
                    slopes[e][c][k] = (high[e] - low[e]) / (2.0 * STEP);
                }
            }
        }
        Some(slopes)
    }
}

/// `ln(I + 2 E)/2` of a symmetric 2x2 matrix `E` = [xx, yy, xy].
///
/// With the eigenvalues `1 + m +- d` of `I + 2 E`: the mean of their logarithms on the diagonal, and half
/// their difference, `atanh(d/(1 + m))`, along the deviator. Neither loses digits when `E` is tiny or isotropic.
fn half_log_of_one_plus_twice([xx, yy, xy]: [f64; 3]) -> [f64; 3] {
    let mean = xx + yy;
    let (deviator, shear) = (xx - yy, 2.0 * xy);
    let radius = deviator.hypot(shear);
    let diagonal = 0.25 * (2.0 * mean + (mean - radius) * (mean + radius)).ln_1p();
    let ratio = radius / (1.0 + mean);
    let along = if ratio < 1e-9 { 1.0 } else { ratio.atanh() / ratio } / (1.0 + mean);
    [diagonal + 0.5 * along * deviator, diagonal - 0.5 * along * deviator, 0.5 * along * shear]
}

impl fmt::Display for StrainDefinition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for StrainDefinition {
    type Err = UnknownChoice;

    fn from_str(word: &str) -> Result<Self, UnknownChoice> {
        let told = ["strain", "infinitesimal, green-lagrange or hencky"];
        UnknownChoice::or_one_of(&[Self::Infinitesimal, Self::GreenLagrange, Self::Hencky], Self::name, word, told)
    }
}

/// A strain with the **tensor** shear, half the change of a right angle; no unit. x to the right, y down.
///
/// The laws of the mechanics take an `mechanics::substrate::EngineeringStrain`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TensorStrain {
    /// `exx`, along x.
    pub xx: f64,
    /// `eyy`, along y.
    pub yy: f64,
    /// `exy`, the shear of the tensor.
    pub xy: f64,
}

impl TensorStrain {
    /// `[exx, eyy, exy]`, as files have it.
    pub fn components(self) -> [f64; 3] {
        [self.xx, self.yy, self.xy]
    }

    /// From `[exx, eyy, exy]`.
    pub fn of_components([xx, yy, xy]: [f64; 3]) -> Self {
        Self { xx, yy, xy }
    }
}

/// A number of a strain in which the axes of the image do not matter, or that says how its own lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Invariant {
    /// `e1`, the larger principal strain in the plane.
    Major,
    /// `e2`, the smaller one.
    Minor,
    /// Angle of the axis of `e1` from x towards y (down), degrees, -90 to 90.
    Direction,
    /// Largest shear in the plane, that of the tensor: `(e1 - e2)/2`.
    ShearMax,
    /// Equivalent strain by von Mises where the volume stays, `e3 = -e1 - e2`: `sqrt(2/3 (e1^2 + e2^2 + e3^2))`.
    VonMises,
}

impl Invariant {
    /// All there are.
    pub const ALL: [Self; 5] = [Self::Major, Self::Minor, Self::Direction, Self::ShearMax, Self::VonMises];

    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Major => "e1",
            Self::Minor => "e2",
            Self::Direction => "e1_direction_deg",
            Self::ShearMax => "shear_max",
            Self::VonMises => "von_mises",
        }
    }
}

impl TensorStrain {
    /// Half the difference of exx and eyy, the shear, and the radius of Mohr's circle.
    fn mohr(self) -> [f64; 3] {
        let half = 0.5 * (self.xx - self.yy);
        [half, self.xy, half.hypot(self.xy)]
    }

    /// One of its invariants.
    ///
    /// ```
    /// # use quadrille_base as quadrille;
    /// use quadrille::field::{Invariant, TensorStrain};
    /// let pulled = TensorStrain { xx: 0.02, yy: -0.01, xy: 0.0 }; // without change of volume: e3 = -0.01
    /// assert_eq!(pulled.invariant(Invariant::Major), 0.02);
    /// assert!((pulled.invariant(Invariant::VonMises) - 0.02).abs() < 1e-15);
    /// ```
    pub fn invariant(self, which: Invariant) -> f64 {
        let Self { xx, yy, xy } = self;
        let [half, _, radius] = self.mohr();
        let mean = 0.5 * (xx + yy);
        match which {
            Invariant::Major => mean + radius,
            Invariant::Minor => mean - radius,
            Invariant::Direction => 0.5 * xy.atan2(half).to_degrees(),
            Invariant::ShearMax => radius,
            Invariant::VonMises => (4.0 / 3.0 * (xx * xx + xx * yy + yy * yy + xy * xy)).sqrt(),
        }
    }

    /// Derivatives of an invariant by exx, eyy and exy; not finite where it has none, as without strain.
    pub(super) fn slopes_of(self, which: Invariant) -> [f64; 3] {
        let Self { xx, yy, xy } = self;
        let [half, shear, radius] = self.mohr();
        // Alike in all directions, any axis is as good as another.
        let [c, s] = if radius > 0.0 { [half / radius, shear / radius] } else { [1.0, 0.0] };
        match which {
            Invariant::Major => [0.5 * (1.0 + c), 0.5 * (1.0 - c), s],
            Invariant::Minor => [0.5 * (1.0 - c), 0.5 * (1.0 + c), -s],
            Invariant::Direction => [-0.25 * s, 0.25 * s, 0.5 * c].map(|slope| (slope / radius).to_degrees()),
            Invariant::ShearMax => [0.5 * c, -0.5 * c, s],
            Invariant::VonMises => {
                let of = self.invariant(Invariant::VonMises);
                [2.0 * xx + yy, 2.0 * yy + xx, 2.0 * xy].map(|slope| 2.0 / 3.0 * slope / of)
            }
        }
    }
}

/// The rotation of the displacement gradient `[[du_x/dx, du_x/dy], [du_y/dx, du_y/dy]]`, that of its polar
/// decomposition, degrees from x towards y (down).
pub fn rotation_deg([[xx, xy], [yx, yy]]: [[f64; 2]; 2]) -> f64 {
    (yx - xy).atan2(2.0 + xx + yy).to_degrees()
}

/// Derivatives of [`rotation_deg`] by the components of the gradient.
pub(super) fn slopes_of_rotation([[xx, xy], [yx, yy]]: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
    let (across, along) = (yx - xy, 2.0 + xx + yy);
    let square = across * across + along * along;
    let [by_along, by_across] = [-across / square, along / square].map(f64::to_degrees);
    [[by_along, -by_across], [by_across, by_along]]
}

/// `sigma_exx l / sigma_ux` of an element far from the borders, 0.963: see [`element_strain_sigma`].
pub const ELEMENT_NOISE: f64 = 0.963_433_044_002_285;

/// `sigma_exx l / sigma_ux` of a node far from the borders, 0.681: [`ELEMENT_NOISE`] over the root of 2.
pub const NODE_NOISE: f64 = 0.681_250_038_633_213_4;

/// Standard uncertainty of the strain (exx, eyy, exy) at the centre of a square element of `length` far from the
/// borders, from that of an inner node's displacement, in the same unit.
///
/// Noise spread evenly makes `Cov = 2 sigma^2/g^2` times the inverse of the mass matrix of the mesh, whose symbol
/// along each axis is `l (2 + cos t)/3`. With mean values over `t`: the variance of a nodal displacement is
/// `<3/(2 + cos t)>^2 = 3`, that of the difference of neighbours `<3 (2 - 2 cos t)/(2 + cos t)> = 6 (sqrt 3 - 1)`,
/// that of the mean of neighbours `<3 (1 + cos t)/(2 (2 + cos t))> = 3/2 (1 - 1/sqrt 3)`, each times its power of
/// `l`. So
///
/// ```text
/// sigma_exx = sqrt(2) sqrt(6 (sqrt 3 - 1) 3/2 (1 - 1/sqrt 3)) sigma/(l^2 g_x) = 2.36 sigma/(l^2 g_x) = 0.963 sigma_ux/l
/// ```
///
/// and the shear, the mean of two gradients with noise of their own, has `0.963/2 sqrt(sigma_ux^2 + sigma_uy^2)/l`.
/// Elements at a border have up to twice as much.
pub fn element_strain_sigma(sigma_u: [f64; 2], length: f64) -> [f64; 3] {
    strain_sigma(ELEMENT_NOISE, sigma_u, length)
}

/// Standard uncertainty of the strain (exx, eyy, exy) at an inner node, from that of its displacement.
///
/// As [`element_strain_sigma`], with the central difference over `2 l`: `<3 sin^2 t/(2 + cos t)> = 3 (2 - sqrt 3)`
/// times `sqrt 3` of the other axis. `1.67 sigma/(l^2 g_x) = 0.681 sigma_ux/l`.
pub fn node_strain_sigma(sigma_u: [f64; 2], length: f64) -> [f64; 3] {
    strain_sigma(NODE_NOISE, sigma_u, length)
}

fn strain_sigma(factor: f64, [x, y]: [f64; 2], length: f64) -> [f64; 3] {
    [x, y, 0.5 * x.hypot(y)].map(|sigma| factor * sigma / length)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invariants_are_those_of_the_eigenvalues_and_their_slopes_are_differences() {
        // Turned by an angle from principal strains that are given: R diag(e1, e2) R^T.
        for (e1, e2, angle) in [(0.02, -0.01, 30.0f64), (3e-4, 1e-4, -75.0), (-0.1, -0.3, 10.0)] {
            let (s, c) = angle.to_radians().sin_cos();
            let strain =
                TensorStrain { xx: e1 * c * c + e2 * s * s, yy: e1 * s * s + e2 * c * c, xy: (e1 - e2) * s * c };
            let e3: f64 = -e1 - e2;
            let von_mises = (2.0 / 3.0 * (e1 * e1 + e2 * e2 + e3 * e3)).sqrt();
            for (which, expected) in Invariant::ALL.into_iter().zip([e1, e2, angle, 0.5 * (e1 - e2), von_mises]) {
                let at = |components: [f64; 3]| TensorStrain::of_components(components).invariant(which);
                assert!((strain.invariant(which) - expected).abs() < 1e-12, "{which:?} of {e1}, {e2}");
                for (k, slope) in strain.slopes_of(which).into_iter().enumerate() {
                    let step = 1e-7;
                    let [low, high] = [-step, step].map(|by| {
                        let mut moved = strain.components();
                        moved[k] += by;
                        at(moved)
                    });
                    let difference = (high - low) / (2.0 * step);
                    // The third derivative of a direction goes with the third power of the radius, 1e-4 at least.
                    assert!((slope - difference).abs() < 1e-5 * (1.0 + slope.abs()), "{which:?} {k}: {slope}");
                }
            }
        }
    }

    #[test]
    fn the_rotation_is_that_of_the_polar_decomposition() {
        // F = R U with a stretch of its own axes.
        for angle in [-100.0f64, -3.0, 0.0, 0.5, 45.0, 120.0] {
            let (s, c) = angle.to_radians().sin_cos();
            let stretch = [[1.1, 0.03], [0.03, 0.95]];
            let f = [[c, -s], [s, c]].map(|row| [0, 1].map(|k| row[0] * stretch[0][k] + row[1] * stretch[1][k]));
            let gradient = [[f[0][0] - 1.0, f[0][1]], [f[1][0], f[1][1] - 1.0]];
            assert!((rotation_deg(gradient) - angle).abs() < 1e-12, "{angle}");
            let slopes = slopes_of_rotation(gradient);
            for i in 0..4 {
                let [low, high] = [-1e-6, 1e-6].map(|by| {
                    let mut moved = gradient;
                    moved[i / 2][i % 2] += by;
                    rotation_deg(moved)
                });
                assert!((slopes[i / 2][i % 2] - (high - low) / 2e-6).abs() < 1e-7, "{angle} {i}");
            }
        }
    }

    /// Mean of `value(cos t)` over a period.
    fn mean(value: impl Fn(f64) -> f64) -> f64 {
        const N: usize = 64; // the integrands are analytic: the sum converges like 0.268^N
        (0..N).map(|k| value((std::f64::consts::TAU * k as f64 / N as f64).cos())).sum::<f64>() / N as f64
    }

    #[test]
    fn noise_factors_are_the_means_over_the_symbol_of_the_mass_matrix() {
        let mass = |c: f64| (2.0 + c) / 3.0;
        let nodal = mean(|c| 1.0 / mass(c));
        let difference = mean(|c| (2.0 - 2.0 * c) / mass(c));
        let average = mean(|c| 0.5 * (1.0 + c) / mass(c));
        let central = mean(|c| (1.0 - c * c) / mass(c));
        assert!((ELEMENT_NOISE - (difference * average).sqrt() / nodal).abs() < 1e-14);
        assert!((NODE_NOISE - (central * nodal).sqrt() / nodal).abs() < 1e-14);
        // The same in terms of the image noise.
        assert!(((2.0 * difference * average).sqrt() - 2.36).abs() < 0.001);
        assert!(((2.0 * central * nodal).sqrt() - 1.67).abs() < 0.002);
    }

    #[test]
    fn the_logarithm_is_that_of_the_power_series_and_of_the_eigenvalues() {
        // ln(I + 2E)/2 = E - E^2 + 4/3 E^3 - ...: the next term is below 4e-15 here.
        let e = [3e-4, -1e-4, 2e-4];
        let multiply = |a: [f64; 3], b: [f64; 3]| {
            [a[0] * b[0] + a[2] * b[2], a[2] * b[2] + a[1] * b[1], a[0] * b[2] + a[2] * b[1]]
        };
        let (e2, e3) = (multiply(e, e), multiply(multiply(e, e), e));
        let log = half_log_of_one_plus_twice(e);
        for k in 0..3 {
            assert!((log[k] - (e[k] - e2[k] + 4.0 / 3.0 * e3[k])).abs() < 1e-13, "{k}: {log:?}");
        }
        // Tiny and isotropic: no digit is lost.
        assert_eq!(half_log_of_one_plus_twice([1e-20, 1e-20, 0.0]), [1e-20, 1e-20, 0.0]);
        let [xx, yy, xy] = half_log_of_one_plus_twice([0.0, 0.0, 1e-12]);
        assert!((xy - 1e-12).abs() < 1e-27 && xx.abs() < 1e-23 && yy.abs() < 1e-23);
        // Large: principal stretches 3 and 1/2, turned by 30 degrees.
        let (sin, cos) = 30f64.to_radians().sin_cos();
        let turned =
            |a: f64, b: f64| [a * cos * cos + b * sin * sin, a * sin * sin + b * cos * cos, (a - b) * sin * cos];
        let log = half_log_of_one_plus_twice(turned(4.0, -0.375));
        let want = turned(3f64.ln(), 0.5f64.ln());
        for k in 0..3 {
            assert!((log[k] - want[k]).abs() < 1e-14, "{k}: {log:?}");
        }
    }
}
