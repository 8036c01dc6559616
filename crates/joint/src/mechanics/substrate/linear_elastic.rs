//! Isotropic linear elasticity.

use super::{
    EngineeringStrain, Parameter, PlaneState, Stress, SubstrateEnergy, SubstrateError, SubstrateLaw, SubstrateResponse,
    SubstrateState, SubstrateStiffness, check_elastic, elastic_energy, elastic_state, exactly, isotropic,
};

/// `stress = D strain` with Young's modulus `E` and Poisson's ratio `nu`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinearElastic {
    young: f64,
    nu: f64,
    plane: PlaneState,
}

impl LinearElastic {
    /// Its name in case files.
    pub const NAME: &'static str = "linear-elastic";

    /// Its parameters.
    pub const PARAMETERS: [Parameter; 2] = [
        Parameter { name: "E", unit: "MPa", meaning: "Young's modulus" },
        Parameter { name: "nu", unit: "1", meaning: "Poisson's ratio" },
    ];

    /// The law with `young` (MPa, positive) and `nu` (above -1, below 0.5).
    ///
    /// # Errors
    /// [`SubstrateError::Parameter`] for the first that is not allowed.
    pub fn new(young: f64, nu: f64, plane: PlaneState) -> Result<Self, SubstrateError> {
        check_elastic(&Self::PARAMETERS, young, nu)?;
        Ok(Self { young, nu, plane })
    }

    fn stiffness(&self) -> SubstrateStiffness {
        let Self { young, nu, plane } = *self;
        let shear = young / (2.0 * (1.0 + nu));
        let (along, across) = match plane {
            PlaneState::PlaneStress => (young / (1.0 - nu * nu), nu * young / (1.0 - nu * nu)),
            PlaneState::PlaneStrain => {
                let lame = nu * young / ((1.0 + nu) * (1.0 - 2.0 * nu));
                (lame + 2.0 * shear, lame)
            }
        };
        isotropic(along, across, shear)
    }

    /// Derivative of the stiffness by Poisson's ratio.
    fn stiffness_by_nu(&self) -> SubstrateStiffness {
        let Self { young, nu, plane } = *self;
        let shear = -young / (2.0 * (1.0 + nu).powi(2));
        let (along, across) = match plane {
            PlaneState::PlaneStress => {
                let square = (1.0 - nu * nu).powi(2);
                (2.0 * nu * young / square, young * (1.0 + nu * nu) / square)
            }
            PlaneState::PlaneStrain => {
                let lame = young * (1.0 + 2.0 * nu * nu) / ((1.0 + nu) * (1.0 - 2.0 * nu)).powi(2);
                (lame + 2.0 * shear, lame)
            }
        };
        isotropic(along, across, shear)
    }
}

impl SubstrateLaw for LinearElastic {
    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn parameters(&self) -> &'static [Parameter] {
        &Self::PARAMETERS
    }

    fn values(&self) -> Vec<f64> {
        vec![self.young, self.nu]
    }

    fn with_values(&self, values: &[f64]) -> Result<Box<dyn SubstrateLaw>, SubstrateError> {
        let [young, nu] = exactly(Self::NAME, values)?;
        Ok(Box::new(Self::new(young, nu, self.plane)?))
    }

    fn response(&self, strain: EngineeringStrain) -> SubstrateResponse {
        SubstrateResponse { stress: self.stress(strain), tangent: self.stiffness() }
    }

    fn stress(&self, strain: EngineeringStrain) -> Stress {
        Stress((self.stiffness() * strain.vector()).into())
    }

    fn by_parameters(&self, strain: EngineeringStrain, derivatives: &mut [Stress]) {
        let Stress(stress) = self.stress(strain);
        derivatives.copy_from_slice(&[
            Stress(stress.map(|stress| stress / self.young)),
            Stress((self.stiffness_by_nu() * strain.vector()).into()),
        ]);
    }

    fn secant(&self, _: EngineeringStrain) -> SubstrateStiffness {
        self.stiffness()
    }

    fn state(&self, strain: EngineeringStrain) -> SubstrateState {
        let stress = self.stress(strain);
        let z = match self.plane {
            PlaneState::PlaneStress => 0.0,
            PlaneState::PlaneStrain => self.nu * (stress.0[0] + stress.0[1]),
        };
        elastic_state(stress, z)
    }

    fn energy(&self, strain: EngineeringStrain) -> SubstrateEnergy {
        elastic_energy(self.stress(strain), strain)
    }

    fn young(&self) -> f64 {
        self.young
    }
}
