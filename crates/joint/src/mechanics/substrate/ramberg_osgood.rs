//! Ramberg-Osgood deformation plasticity: metals that harden by a power law, without history (THEORY 3).

use super::deformation::{Deformation, Modes, Point};
use super::{
    EngineeringStrain, Parameter, PlaneState, Stress, SubstrateEnergy, SubstrateError, SubstrateLaw, SubstrateResponse,
    SubstrateState, SubstrateStiffness, check_elastic, check_positive, exactly,
};

/// `eps = (1+nu)/E S + (1-2nu)/E p I + 3/2 (alpha/E) (q/sigma_0)^(n-1) S`: in uniaxial tension the plastic strain
/// at `sigma_0` is `alpha sigma_0/E`.
///
/// The stress follows from one scalar monotone equation in the equivalent stress `q`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RambergOsgood {
    elastic: Deformation,
    sigma_0: f64,
    alpha: f64,
    n: f64,
    /// `n - 1` where it is a whole number: its powers are then products.
    whole_power: Option<i32>,
}

impl RambergOsgood {
    /// Its name in case files.
    pub const NAME: &'static str = "ramberg-osgood";

    /// Its parameters.
    pub const PARAMETERS: [Parameter; 5] = [
        Parameter { name: "E", unit: "MPa", meaning: "Young's modulus" },
        Parameter { name: "nu", unit: "1", meaning: "Poisson's ratio" },
        Parameter { name: "sigma_0", unit: "MPa", meaning: "yield stress" },
        Parameter { name: "alpha", unit: "1", meaning: "plastic strain at sigma_0 over sigma_0/E" },
        Parameter { name: "n", unit: "1", meaning: "hardening exponent" },
    ];

    /// The law with `[E, nu, sigma_0, alpha, n]`: `E` and `sigma_0` (MPa) and `alpha` positive, `nu` above -1 and
    /// below 0.5, `n` 1 or more.
    ///
    /// # Errors
    /// [`SubstrateError::Parameter`] for the first that is not allowed.
    pub fn new([young, nu, sigma_0, alpha, n]: [f64; 5], plane: PlaneState) -> Result<Self, SubstrateError> {
        check_elastic(&Self::PARAMETERS, young, nu)?;
        check_positive(&Self::PARAMETERS[2], sigma_0)?;
        check_positive(&Self::PARAMETERS[3], alpha)?;
        if !(1.0..=100.0).contains(&n) {
            let needed = "the hardening exponent must lie between 1 (linear) and 100";
            return Err(SubstrateError::Parameter { key: Self::PARAMETERS[4].key(), value: n, needed });
        }
        let whole_power = (n.fract() == 0.0).then_some(n as i32 - 1);
        Ok(Self { elastic: Deformation::new(young, nu, plane), sigma_0, alpha, n, whole_power })
    }

    /// The plastic compliance `h = (alpha/E)(q/sigma_0)^(n-1)`, 1/MPa.
    fn plastic_compliance(&self, q: f64) -> f64 {
        let ratio = q / self.sigma_0;
        let power = match self.whole_power {
            Some(power) => whole_power(ratio, power),
            None => ratio.powf(self.n - 1.0),
        };
        self.alpha / self.elastic.young * power
    }

    /// The equivalent stress at `N` points: the root of `q^2 = sum_i w_i/(a_i + c_i h(q))^2` at each.
    ///
    /// Both the elastic and the purely plastic solution are above the root; from the smaller of them Newton
    /// comes down to it without overshooting, since `q/sqrt(sum)` is convex. A bracket guards it all the same.
    /// The elastic one is the smaller where its plastic strain is: that takes no root.
    ///
    /// An iteration is a chain of divisions, each of which waits for the one before: those of several points go side by
    /// side, and give the same bits as one after the other.
    fn equivalent_stress<const N: usize>(&self, modes: &[Modes; N]) -> [f64; N] {
        let mut q = [0.0; N];
        let (mut low, mut high) = ([0.0; N], [0.0; N]);
        let mut left = [false; N];
        for (k, Modes { weight, elastic, .. }) in modes.iter().enumerate() {
            let norm = weight[0] + weight[1];
            if norm.is_nan() || norm == 0.0 || norm.is_infinite() {
                q[k] = norm;
                continue;
            }
            let of_elastic = (weight[0] / elastic[0].powi(2) + weight[1] / elastic[1].powi(2)).sqrt();
            // Without elastic compliance: q h = sqrt(w_1/c_1^2 + w_2/c_2^2).
            let plastic_strain = (4.0 * weight[0] + weight[1] / 2.25).sqrt();
            let of_plastic = || {
                let share = plastic_strain * self.elastic.young / (self.alpha * self.sigma_0);
                self.sigma_0 * share.powf(1.0 / self.n)
            };
            let is_elastic = of_elastic * self.plastic_compliance(of_elastic) <= plastic_strain;
            high[k] = if is_elastic { of_elastic } else { of_plastic() } * (1.0 + 1e-14);
            (q[k], left[k]) = (high[k], true);
        }
        for _ in 0..80 {
            if !left.contains(&true) {
                break;
            }
            let steps: [(f64, f64); N] = std::array::from_fn(|k| self.newton_step(&modes[k], q[k]));
            for k in 0..N {
                if !left[k] {
                    continue;
                }
                let (step, root) = steps[k];
                if q[k] > root {
                    high[k] = q[k];
                } else {
                    low[k] = q[k];
                }
                let next = q[k] - step;
                // Quadratic: a step of 1e-9 leaves less than the round-off.
                if step.abs() <= 1e-9 * q[k] {
                    left[k] = false;
                    if next.is_finite() && step.abs() < q[k] {
                        q[k] = next;
                    }
                } else {
                    q[k] = if next > low[k] && next < high[k] { next } else { 0.5 * (low[k] + high[k]) };
                }
            }
        }
        q
    }

    /// A step of Newton's iteration for `q/R - 1`, `R = sqrt(sum_i t_i)`, `t_i = w_i/(a_i + c_i h)^2`, and `R`.
    #[inline(always)]
    fn newton_step(&self, Modes { weight, elastic, plastic }: &Modes, q: f64) -> (f64, f64) {
        let h = self.plastic_compliance(q);
        let inverse = [1.0 / (elastic[0] + plastic[0] * h), 1.0 / (elastic[1] + plastic[1] * h)];
        let terms = [weight[0] * inverse[0] * inverse[0], weight[1] * inverse[1] * inverse[1]];
        let sum = terms[0] + terms[1];
        // R'/R = -(sum c_i t_i/(a_i + c_i h)) h'/sum.
        let root = sum.sqrt();
        let bend = plastic[0] * terms[0] * inverse[0] + plastic[1] * terms[1] * inverse[1];
        ((q - root) * sum / (sum + bend * (self.n - 1.0) * h), root)
    }

    /// Everything at `N` strains.
    fn points<const N: usize>(&self, strains: &[EngineeringStrain; N]) -> [Point; N] {
        self.equivalent_stress(&strains.map(|strain| self.elastic.modes(strain))).map(|q| {
            let h = self.plastic_compliance(q);
            Point { q, h, slope: (self.n - 1.0) * h }
        })
    }

    fn point(&self, strain: EngineeringStrain) -> Point {
        let [point] = self.points(&[strain]);
        point
    }
}

/// `base^power`, of a power that is not negative: inside the loop of every point, without the call that `powi` is.
#[inline]
fn whole_power(mut base: f64, power: i32) -> f64 {
    let (mut product, mut left) = (1.0, power);
    while left > 0 {
        if left & 1 == 1 {
            product *= base;
        }
        base *= base;
        left >>= 1;
    }
    product
}

impl SubstrateLaw for RambergOsgood {
    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn parameters(&self) -> &'static [Parameter] {
        &Self::PARAMETERS
    }

    fn values(&self) -> Vec<f64> {
        vec![self.elastic.young, self.elastic.nu, self.sigma_0, self.alpha, self.n]
    }

    fn with_values(&self, values: &[f64]) -> Result<Box<dyn SubstrateLaw>, SubstrateError> {
        Ok(Box::new(Self::new(exactly(Self::NAME, values)?, self.elastic.plane)?))
    }

    fn response(&self, strain: EngineeringStrain) -> SubstrateResponse {
        self.elastic.response_at(strain, &self.point(strain))
    }

    fn responses(&self, strains: &[EngineeringStrain; 4]) -> [SubstrateResponse; 4] {
        let points = self.points(strains);
        std::array::from_fn(|k| self.elastic.response_at(strains[k], &points[k]))
    }

    fn stress(&self, strain: EngineeringStrain) -> Stress {
        self.elastic.stress_at(strain, self.point(strain).h)
    }

    fn by_parameters(&self, strain: EngineeringStrain, derivatives: &mut [Stress]) {
        let Self { elastic: Deformation { young, .. }, sigma_0, alpha, .. } = *self;
        let point = self.point(strain);
        let Point { q, h, slope } = point;
        // Log of q/sigma_0: no matter at q = 0, h = 0.
        let log = if q > 0.0 { (q / sigma_0).ln() } else { 0.0 };
        // Explicit derivatives of h by E, nu, sigma_0, alpha, n.
        let h_by = [-h / young, 0.0, -slope / sigma_0, h / alpha, h * log];
        self.elastic.by_parameters(strain, &point, &h_by, derivatives);
    }

    fn secant(&self, strain: EngineeringStrain) -> SubstrateStiffness {
        self.elastic.secant_at(self.point(strain).h)
    }

    fn state(&self, strain: EngineeringStrain) -> SubstrateState {
        let Point { q, h, .. } = self.point(strain);
        SubstrateState { equivalent_stress: q, plastic_strain: h * q }
    }

    fn energy(&self, strain: EngineeringStrain) -> SubstrateEnergy {
        let point = self.point(strain);
        // The plastic strain grows as q^n.
        self.elastic.energy(strain, &point, point.q * point.q * point.h / (self.n + 1.0))
    }

    fn yield_strain(&self) -> Option<f64> {
        Some(self.sigma_0 / self.elastic.young)
    }

    fn young(&self) -> f64 {
        self.elastic.young
    }
}
