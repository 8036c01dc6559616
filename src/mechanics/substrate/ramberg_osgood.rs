//! Ramberg-Osgood deformation plasticity: metals that harden by a power law, without history (THEORY 3).

use super::{
    EngineeringStrain, Parameter, PlaneState, Stress, SubstrateEnergy, SubstrateError, SubstrateLaw, SubstrateResponse,
    SubstrateState, SubstrateStiffness, check_elastic, check_positive, exactly, isotropic,
};
use nalgebra::Vector3;

/// `eps = (1+nu)/E S + (1-2nu)/E p I + 3/2 (alpha/E) (q/sigma_0)^(n-1) S`: in uniaxial tension the plastic strain
/// at `sigma_0` is `alpha sigma_0/E`.
///
/// The stress follows from one scalar monotone equation in the equivalent stress `q`. In plane stress elastic
/// and plastic compliance share the modes `sx + sy`, `sx - sy`, `txy`; in plane strain the deviator is
/// proportional to that of the strain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RambergOsgood {
    young: f64,
    nu: f64,
    sigma_0: f64,
    alpha: f64,
    n: f64,
    plane: PlaneState,
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
        Ok(Self { young, nu, sigma_0, alpha, n, plane, whole_power })
    }

    /// The plastic compliance `h = (alpha/E)(q/sigma_0)^(n-1)`, 1/MPa.
    fn plastic_compliance(&self, q: f64) -> f64 {
        let ratio = q / self.sigma_0;
        let power = match self.whole_power {
            Some(power) => ratio.powi(power),
            None => ratio.powf(self.n - 1.0),
        };
        self.alpha / self.young * power
    }

    /// The modes of a strain in the plane state.
    fn modes(&self, EngineeringStrain { xx: x, yy: y, gamma_xy: shear }: EngineeringStrain) -> Modes {
        let Self { young, nu, .. } = *self;
        match self.plane {
            PlaneState::PlaneStress => {
                let (sum, difference) = (x + y, x - y);
                Modes {
                    weight: [sum * sum / 4.0, 0.75 * (difference * difference + shear * shear)],
                    elastic: [(1.0 - nu) / young, (1.0 + nu) / young],
                    plastic: [0.5, 1.5],
                }
            }
            PlaneState::PlaneStrain => {
                let (x, y, z) = deviator(x, y);
                Modes {
                    weight: [0.0, 1.5 * (x * x + y * y + z * z + 0.5 * shear * shear)],
                    elastic: [1.0, (1.0 + nu) / young],
                    plastic: [0.0, 1.5],
                }
            }
        }
    }

    /// The equivalent stress: the root of `q^2 = sum_i w_i/(a_i + c_i h(q))^2`.
    ///
    /// Both the elastic and the purely plastic solution are above the root; from the smaller of them Newton
    /// comes down to it without overshooting, since `q/sqrt(sum)` is convex. A bracket guards it all the same.
    fn equivalent_stress(&self, modes: &Modes) -> f64 {
        let Modes { weight, elastic, plastic } = *modes;
        let norm = weight[0] + weight[1];
        if norm.is_nan() || norm == 0.0 || norm.is_infinite() {
            return norm;
        }
        let of_elastic = (weight[0] / elastic[0].powi(2) + weight[1] / elastic[1].powi(2)).sqrt();
        // Without elastic compliance: q h = sqrt(w_1/c_1^2 + w_2/c_2^2).
        let plastic_strain = (4.0 * weight[0] + weight[1] / 2.25).sqrt();
        let of_plastic = self.sigma_0 * (plastic_strain * self.young / (self.alpha * self.sigma_0)).powf(1.0 / self.n);
        let (mut low, mut high) = (0.0, of_elastic.min(of_plastic) * (1.0 + 1e-14));
        let mut q = high;
        for _ in 0..80 {
            let h = self.plastic_compliance(q);
            let inverse = [1.0 / (elastic[0] + plastic[0] * h), 1.0 / (elastic[1] + plastic[1] * h)];
            let terms = [weight[0] * inverse[0] * inverse[0], weight[1] * inverse[1] * inverse[1]];
            let sum = terms[0] + terms[1];
            // q/R - 1 and its slope, R = sqrt(sum): R'/R = -(sum c_i t_i/(a_i + c_i h)) h'/sum.
            let ratio = q / sum.sqrt();
            let bend = (plastic[0] * terms[0] * inverse[0] + plastic[1] * terms[1] * inverse[1]) / sum;
            let step = q * (1.0 - 1.0 / ratio) / (1.0 + bend * (self.n - 1.0) * h);
            if ratio > 1.0 {
                high = q;
            } else {
                low = q;
            }
            let next = q - step;
            let next = if next > low && next < high { next } else { 0.5 * (low + high) };
            // Quadratic: a step of 1e-9 leaves less than the round-off.
            let small = step.abs() <= 1e-9 * q;
            if small {
                return if (q - step).is_finite() && step.abs() < q { q - step } else { q };
            }
            q = next;
        }
        q
    }

    /// Everything at a strain.
    fn point(&self, strain: EngineeringStrain) -> Point {
        let modes = self.modes(strain);
        let q = self.equivalent_stress(&modes);
        Point { q, h: self.plastic_compliance(q) }
    }

    fn stress_at(&self, EngineeringStrain { xx: x, yy: y, gamma_xy: shear }: EngineeringStrain, h: f64) -> Stress {
        let Self { young, nu, .. } = *self;
        match self.plane {
            PlaneState::PlaneStress => {
                let sum = (x + y) / ((1.0 - nu) / young + 0.5 * h);
                let stiffness = 1.0 / ((1.0 + nu) / young + 1.5 * h);
                let difference = (x - y) * stiffness;
                Stress([0.5 * (sum + difference), 0.5 * (sum - difference), 0.5 * shear * stiffness])
            }
            PlaneState::PlaneStrain => {
                let stiffness = 1.0 / ((1.0 + nu) / young + 1.5 * h);
                let pressure = young * (x + y) / (3.0 * (1.0 - 2.0 * nu));
                let (x, y, _) = deviator(x, y);
                Stress([stiffness * x + pressure, stiffness * y + pressure, 0.5 * shear * stiffness])
            }
        }
    }

    /// The secant, with the plastic compliance `h`.
    fn secant_at(&self, h: f64) -> SubstrateStiffness {
        let Self { young, nu, .. } = *self;
        let stiffness = 1.0 / ((1.0 + nu) / young + 1.5 * h);
        let (along, across) = match self.plane {
            PlaneState::PlaneStress => {
                let sum = 1.0 / ((1.0 - nu) / young + 0.5 * h);
                (0.5 * (sum + stiffness), 0.5 * (sum - stiffness))
            }
            PlaneState::PlaneStrain => {
                let bulk = young / (3.0 * (1.0 - 2.0 * nu));
                (bulk + stiffness * 2.0 / 3.0, bulk - stiffness / 3.0)
            }
        };
        isotropic(along, across, 0.5 * stiffness)
    }
}

/// Equivalent stress and plastic compliance at a point.
struct Point {
    q: f64,
    h: f64,
}

/// The scalar equation of a strain: `q^2 = sum_i weight_i/(elastic_i + plastic_i h(q))^2`.
#[derive(Debug, Clone, Copy)]
struct Modes {
    weight: [f64; 2],
    elastic: [f64; 2],
    plastic: [f64; 2],
}

/// Deviator (xx, yy, zz) of a strain without component out of the plane.
fn deviator(x: f64, y: f64) -> (f64, f64, f64) {
    let mean = (x + y) / 3.0;
    (x - mean, y - mean, -mean)
}

impl SubstrateLaw for RambergOsgood {
    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn parameters(&self) -> &'static [Parameter] {
        &Self::PARAMETERS
    }

    fn values(&self) -> Vec<f64> {
        vec![self.young, self.nu, self.sigma_0, self.alpha, self.n]
    }

    fn with_values(&self, values: &[f64]) -> Result<Box<dyn SubstrateLaw>, SubstrateError> {
        Ok(Box::new(Self::new(exactly(Self::NAME, values)?, self.plane)?))
    }

    fn response(&self, strain: EngineeringStrain) -> SubstrateResponse {
        let Point { q, h } = self.point(strain);
        let stress = self.stress_at(strain, h);
        let mut tangent = self.secant_at(h);
        // The tangent is the secant less a term of rank one, D = S - k v v^T, v = S (d q^2/d sigma)/(2 q): the
        // inverse of the compliance, written out (Sherman-Morrison).
        let Stress([x, y, shear]) = stress;
        let slope = (self.n - 1.0) * h; // q h'
        let Self { young, nu, .. } = *self;
        if q > 0.0 && slope > 0.0 {
            let stiffness = 1.0 / ((1.0 + nu) / young + 1.5 * h);
            let (v, denominator) = match self.plane {
                PlaneState::PlaneStress => {
                    // By modes: normal m = (sum/4, 3 difference/4, 3 shear)/q is d q/d(sum, difference, shear).
                    let stiffness_sum = 1.0 / ((1.0 - nu) / young + 0.5 * h);
                    let (sum, difference) = ((x + y) / q, (x - y) / q);
                    let shear = shear / q;
                    let along = 0.5 * stiffness_sum * sum;
                    let apart = 1.5 * stiffness * difference;
                    let v = Vector3::new(0.5 * (along + apart), 0.5 * (along - apart), 1.5 * stiffness * shear);
                    let bend = 0.125 * stiffness_sum * sum * sum
                        + 1.125 * stiffness * difference * difference
                        + 4.5 * stiffness * shear * shear;
                    (v, 1.0 + slope * bend)
                }
                PlaneState::PlaneStrain => {
                    let pressure = young * (strain.xx + strain.yy) / (3.0 * (1.0 - 2.0 * nu));
                    let v = Vector3::new(x - pressure, y - pressure, shear).map(|s| 1.5 * stiffness * s / q);
                    (v, 1.0 + slope * 1.5 * stiffness)
                }
            };
            tangent -= (slope / denominator * v) * v.transpose();
        }
        SubstrateResponse { stress, tangent }
    }

    fn stress(&self, strain: EngineeringStrain) -> Stress {
        self.stress_at(strain, self.point(strain).h)
    }

    fn by_parameters(&self, strain: EngineeringStrain, derivatives: &mut [Stress]) {
        let Self { young, nu, sigma_0, alpha, n, .. } = *self;
        let Point { q, h } = self.point(strain);
        let slope = (n - 1.0) * h;
        // At fixed strain a change of the compliances (a of each mode) and of h at fixed q moves the stress; the
        // change of q that follows is that of the scalar equation. Log of q/sigma_0: no matter at q = 0, h = 0.
        let log = if q > 0.0 { (q / sigma_0).ln() } else { 0.0 };
        // Explicit derivatives of h by E, nu, sigma_0, alpha, n.
        let h_by = [-h / young, 0.0, -slope / sigma_0, h / alpha, h * log];
        let Modes { weight, elastic, plastic } = self.modes(strain);
        let elastic_by: [[f64; 2]; 5] = {
            let mut by = [[0.0; 2]; 5];
            by[0] = elastic.map(|a| -a / young);
            by[1] = [-1.0 / young, 1.0 / young];
            if self.plane == PlaneState::PlaneStrain {
                by[0][0] = 0.0;
                by[1][0] = 0.0;
            }
            by
        };
        let stiffness: [f64; 2] = std::array::from_fn(|k| 1.0 / (elastic[k] + plastic[k] * h));
        let shares: [f64; 2] =
            if q > 0.0 { std::array::from_fn(|k| weight[k] * stiffness[k] * stiffness[k] / (q * q)) } else { [0.0; 2] };
        let bend: f64 = (0..2).map(|k| shares[k] * plastic[k] * stiffness[k]).sum();
        let EngineeringStrain { xx: x, yy: y, gamma_xy: shear } = strain;
        assert_eq!(derivatives.len(), Self::PARAMETERS.len(), "one derivative per parameter");
        for (parameter, derivative) in derivatives.iter_mut().enumerate() {
            let compliance_by = |k: usize| elastic_by[parameter][k] + plastic[k] * h_by[parameter];
            let pull: f64 = (0..2).map(|k| shares[k] * stiffness[k] * compliance_by(k)).sum();
            // d ln q = -pull - bend slope d ln q.
            let log_q_by = -pull / (1.0 + bend * slope);
            let total = |k: usize| -stiffness[k] * stiffness[k] * (compliance_by(k) + plastic[k] * slope * log_q_by);
            *derivative = match self.plane {
                PlaneState::PlaneStress => {
                    let (sum, difference) = (total(0) * (x + y), total(1) * (x - y));
                    Stress([0.5 * (sum + difference), 0.5 * (sum - difference), 0.5 * total(1) * shear])
                }
                PlaneState::PlaneStrain => {
                    let pressure = match parameter {
                        0 => (x + y) / (3.0 * (1.0 - 2.0 * nu)),
                        1 => 2.0 * young * (x + y) / (3.0 * (1.0 - 2.0 * nu).powi(2)),
                        _ => 0.0,
                    };
                    let (x, y, _) = deviator(x, y);
                    Stress([total(1) * x + pressure, total(1) * y + pressure, 0.5 * total(1) * shear])
                }
            };
        }
    }

    fn secant(&self, strain: EngineeringStrain) -> SubstrateStiffness {
        self.secant_at(self.point(strain).h)
    }

    fn state(&self, strain: EngineeringStrain) -> SubstrateState {
        let Point { q, h } = self.point(strain);
        SubstrateState { equivalent_stress: q, plastic_strain: h * q }
    }

    fn energy(&self, strain: EngineeringStrain) -> SubstrateEnergy {
        let Point { q, h } = self.point(strain);
        let Stress([x, y, shear]) = self.stress_at(strain, h);
        let whole = x * strain.xx + y * strain.yy + shear * strain.gamma_xy;
        // The plastic strain grows as q^n.
        let of_plastic = q * q * h;
        SubstrateEnergy { elastic: 0.5 * (whole - of_plastic), plastic: self.n / (self.n + 1.0) * of_plastic }
    }

    fn yield_strain(&self) -> Option<f64> {
        Some(self.sigma_0 / self.young)
    }

    fn young(&self) -> f64 {
        self.young
    }
}
