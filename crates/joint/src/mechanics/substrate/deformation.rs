//! Deformation theory of plasticity: what laws have in common whose plastic strain is `3/2 h(q) S`, without history
//! (THEORY 3).
//!
//! The stress follows from one scalar monotone equation in the equivalent stress `q`. In plane stress elastic and
//! plastic compliance share the modes `sx + sy`, `sx - sy`, `txy`; in plane strain the deviator is proportional to that
//! of the strain.

use super::{EngineeringStrain, PlaneState, Stress, SubstrateEnergy, SubstrateResponse, SubstrateStiffness, isotropic};
use nalgebra::Vector3;

/// The elastic part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Deformation {
    pub young: f64,
    pub nu: f64,
    pub plane: PlaneState,
    /// `(1 - nu)/E` and `(1 + nu)/E`: divided once, since every point of every iteration asks for them.
    compliance: [f64; 2],
}

/// Equivalent stress, the plastic compliance `h(q)` there, 1/MPa, and `q h'(q)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Point {
    pub q: f64,
    pub h: f64,
    pub slope: f64,
}

/// The scalar equation of a strain: `q^2 = sum_i weight_i/(elastic_i + plastic_i h(q))^2`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Modes {
    pub weight: [f64; 2],
    pub elastic: [f64; 2],
    pub plastic: [f64; 2],
}

/// Deviator (xx, yy, zz) of a strain without component out of the plane.
fn deviator(x: f64, y: f64) -> (f64, f64, f64) {
    let mean = (x + y) / 3.0;
    (x - mean, y - mean, -mean)
}

impl Deformation {
    /// The elastic part with Young's modulus and Poisson's ratio.
    pub fn new(young: f64, nu: f64, plane: PlaneState) -> Self {
        Self { young, nu, plane, compliance: [(1.0 - nu) / young, (1.0 + nu) / young] }
    }

    /// The stiffness of the modes `sx + sy`, and `sx - sy` and `txy`, with the plastic compliance `h`.
    #[inline]
    fn stiffness(&self, h: f64) -> [f64; 2] {
        [1.0 / (self.compliance[0] + 0.5 * h), 1.0 / (self.compliance[1] + 1.5 * h)]
    }

    /// The modes of a strain in the plane state.
    #[inline]
    pub fn modes(&self, EngineeringStrain { xx: x, yy: y, gamma_xy: shear }: EngineeringStrain) -> Modes {
        match self.plane {
            PlaneState::PlaneStress => {
                let (sum, difference) = (x + y, x - y);
                Modes {
                    weight: [sum * sum / 4.0, 0.75 * (difference * difference + shear * shear)],
                    elastic: self.compliance,
                    plastic: [0.5, 1.5],
                }
            }
            PlaneState::PlaneStrain => {
                let (x, y, z) = deviator(x, y);
                Modes {
                    weight: [0.0, 1.5 * (x * x + y * y + z * z + 0.5 * shear * shear)],
                    elastic: [1.0, self.compliance[1]],
                    plastic: [0.0, 1.5],
                }
            }
        }
    }

    /// The stress with the plastic compliance `h`.
    #[inline]
    pub fn stress_at(&self, EngineeringStrain { xx: x, yy: y, gamma_xy: shear }: EngineeringStrain, h: f64) -> Stress {
        let Self { young, nu, .. } = *self;
        match self.plane {
            PlaneState::PlaneStress => {
                let [of_sum, stiffness] = self.stiffness(h);
                let sum = (x + y) * of_sum;
                let difference = (x - y) * stiffness;
                Stress([0.5 * (sum + difference), 0.5 * (sum - difference), 0.5 * shear * stiffness])
            }
            PlaneState::PlaneStrain => {
                let [_, stiffness] = self.stiffness(h);
                let pressure = young * (x + y) / (3.0 * (1.0 - 2.0 * nu));
                let (x, y, _) = deviator(x, y);
                Stress([stiffness * x + pressure, stiffness * y + pressure, 0.5 * shear * stiffness])
            }
        }
    }

    /// The secant, with the plastic compliance `h`.
    #[inline]
    pub fn secant_at(&self, h: f64) -> SubstrateStiffness {
        let Self { young, nu, .. } = *self;
        let [sum, stiffness] = self.stiffness(h);
        let (along, across) = match self.plane {
            PlaneState::PlaneStress => (0.5 * (sum + stiffness), 0.5 * (sum - stiffness)),
            PlaneState::PlaneStrain => {
                let bulk = young / (3.0 * (1.0 - 2.0 * nu));
                (bulk + stiffness * 2.0 / 3.0, bulk - stiffness / 3.0)
            }
        };
        isotropic(along, across, 0.5 * stiffness)
    }

    /// Stress and tangent at a strain.
    #[inline]
    pub fn response_at(&self, strain: EngineeringStrain, point: &Point) -> SubstrateResponse {
        let stress = self.stress_at(strain, point.h);
        SubstrateResponse { stress, tangent: self.tangent_at(strain, stress, point) }
    }

    /// The tangent at a strain whose stress is `stress`.
    #[inline]
    pub fn tangent_at(&self, strain: EngineeringStrain, stress: Stress, point: &Point) -> SubstrateStiffness {
        let Point { q, h, slope } = *point;
        let mut tangent = self.secant_at(h);
        // The tangent is the secant less a term of rank one, D = S - k v v^T, v = S (d q^2/d sigma)/(2 q): the
        // inverse of the compliance, written out (Sherman-Morrison).
        let Stress([x, y, shear]) = stress;
        let Self { young, nu, .. } = *self;
        if q > 0.0 && slope != 0.0 {
            let [stiffness_sum, stiffness] = self.stiffness(h);
            let (v, denominator) = match self.plane {
                PlaneState::PlaneStress => {
                    // By modes: normal m = (sum/4, 3 difference/4, 3 shear)/q is d q/d(sum, difference, shear).
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
        tangent
    }

    /// Derivatives of the stress by `E`, `nu` and the parameters of `h`; `h_by` are those of `h` at fixed `q`, by all
    /// of them.
    pub fn by_parameters(
        &self,
        strain: EngineeringStrain,
        &Point { q, h, slope }: &Point,
        h_by: &[f64],
        derivatives: &mut [Stress],
    ) {
        let Self { young, nu, .. } = *self;
        assert_eq!(derivatives.len(), h_by.len(), "one derivative per parameter");
        // At fixed strain a change of the compliances (a of each mode) and of h at fixed q moves the stress; the
        // change of q that follows is that of the scalar equation.
        let Modes { weight, elastic, plastic } = self.modes(strain);
        let elastic_by = |parameter: usize| -> [f64; 2] {
            let mut by = match parameter {
                0 => elastic.map(|a| -a / young),
                1 => [-1.0 / young, 1.0 / young],
                _ => [0.0; 2],
            };
            if self.plane == PlaneState::PlaneStrain {
                by[0] = 0.0;
            }
            by
        };
        let stiffness: [f64; 2] = std::array::from_fn(|k| 1.0 / (elastic[k] + plastic[k] * h));
        let shares: [f64; 2] =
            if q > 0.0 { std::array::from_fn(|k| weight[k] * stiffness[k] * stiffness[k] / (q * q)) } else { [0.0; 2] };
        let bend: f64 = (0..2).map(|k| shares[k] * plastic[k] * stiffness[k]).sum();
        let EngineeringStrain { xx: x, yy: y, gamma_xy: shear } = strain;
        for (parameter, derivative) in derivatives.iter_mut().enumerate() {
            let elastic_by = elastic_by(parameter);
            let compliance_by = |k: usize| elastic_by[k] + plastic[k] * h_by[parameter];
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

    /// Elastic energy, and plastic work of which `complementary` (`int p dq` of the uniaxial plastic strain `p`) is not
    /// done.
    pub fn energy(
        &self,
        strain: EngineeringStrain,
        &Point { q, h, .. }: &Point,
        complementary: f64,
    ) -> SubstrateEnergy {
        let Stress([x, y, shear]) = self.stress_at(strain, h);
        let whole = x * strain.xx + y * strain.yy + shear * strain.gamma_xy;
        let of_plastic = q * q * h;
        SubstrateEnergy { elastic: 0.5 * (whole - of_plastic), plastic: of_plastic - complementary }
    }
}
