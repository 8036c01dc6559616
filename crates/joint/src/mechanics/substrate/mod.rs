//! Laws of the adherends: the stress in a strip of unit thickness from its strain, with all its derivatives.
//!
//! A law is one file: a type that implements [`SubstrateLaw`], and its line in [`substrate_by_name`].

mod deformation;
mod linear_elastic;
mod orthotropic;
mod ramberg_osgood;
mod strain;
mod tabulated;

pub use crate::io::case::PlaneState;
pub use linear_elastic::LinearElastic;
pub use orthotropic::Orthotropic;
pub use ramberg_osgood::RambergOsgood;
pub use strain::EngineeringStrain;
pub use tabulated::Tabulated;

use super::cohesive::Parameter;
use nalgebra::Matrix3;
use std::fmt::Debug;
use thiserror::Error;

/// Stress in the plane, MPa: `sigma_xx`, `sigma_yy`, `sigma_xy`; or its derivative by a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Stress(pub [f64; 3]);

/// `d stress / d strain`, MPa, strain with the engineering shear; symmetric.
pub type SubstrateStiffness = Matrix3<f64>;

/// What a law answers to a strain.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SubstrateResponse {
    /// The stress, MPa.
    pub stress: Stress,
    /// Its derivative by the strain, MPa.
    pub tangent: SubstrateStiffness,
}

/// How far a point is from elastic.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SubstrateState {
    /// Von Mises equivalent stress, out-of-plane stress included, MPa.
    pub equivalent_stress: f64,
    /// Equivalent plastic strain.
    pub plastic_strain: f64,
}

/// Energy of a point, by volume of the body at rest, MPa (N mm per mm^3).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SubstrateEnergy {
    /// What a release of the load gives back.
    pub elastic: f64,
    /// Work on the plastic strain; of a holonomic law it is stored as well.
    pub plastic: f64,
}

/// A holonomic law of the substrate: a function of the strain alone (THEORY 3).
pub trait SubstrateLaw: Debug + Send + Sync {
    /// Its name in case files and results.
    fn name(&self) -> &'static str;

    /// Its parameters, in the order of [`SubstrateLaw::values`] and of all sensitivities.
    fn parameters(&self) -> &'static [Parameter];

    /// The values of the parameters.
    fn values(&self) -> Vec<f64>;

    /// The same law, in the same plane state, with other values of its parameters.
    ///
    /// # Errors
    /// When a value is not allowed, or their number is not that of the parameters.
    fn with_values(&self, values: &[f64]) -> Result<Box<dyn SubstrateLaw>, SubstrateError>;

    /// Stress and consistent tangent at `strain`.
    fn response(&self, strain: EngineeringStrain) -> SubstrateResponse;

    /// The same at the four points of an element, bit for bit: where work can be shared.
    fn responses(&self, strains: &[EngineeringStrain; 4]) -> [SubstrateResponse; 4] {
        strains.map(|strain| self.response(strain))
    }

    /// The stress alone, which costs less; the same bits as in [`SubstrateLaw::response`].
    fn stress(&self, strain: EngineeringStrain) -> Stress;

    /// Derivatives of the stress by each parameter at fixed `strain`, into `derivatives`.
    ///
    /// # Panics
    /// When `derivatives` has not as many entries as there are parameters.
    fn by_parameters(&self, strain: EngineeringStrain, derivatives: &mut [Stress]);

    /// A symmetric positive definite matrix `S` with `S strain = stress`, MPa: for the secant iteration.
    fn secant(&self, strain: EngineeringStrain) -> SubstrateStiffness;

    /// Equivalent stress and plastic strain.
    fn state(&self, strain: EngineeringStrain) -> SubstrateState;

    /// Elastic energy and plastic work: their sum is `int stress . d strain` from rest.
    fn energy(&self, strain: EngineeringStrain) -> SubstrateEnergy;

    /// Strain at which the material yields, if it does: what rotations of the strips are measured by.
    fn yield_strain(&self) -> Option<f64> {
        None
    }

    /// Young's modulus, MPa; of several the largest.
    fn young(&self) -> f64;

    /// Plastic strain up to which the law was measured, where that is told: beyond it is continued.
    fn known_up_to(&self) -> Option<f64> {
        None
    }
}

/// Why there is no such law.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum SubstrateError {
    /// A parameter outside its range.
    #[error("[substrate] {key} is {value}: {needed}")]
    Parameter {
        /// Its key.
        key: String,
        /// Its value.
        value: f64,
        /// What it must be.
        needed: &'static str,
    },
    /// Another number of values than of parameters.
    #[error("the substrate law '{law}' has {needed} parameters, {given} values were given")]
    Count {
        /// Name of the law.
        law: &'static str,
        /// Number of its parameters.
        needed: usize,
        /// Number given.
        given: usize,
    },
    /// A curve that no material has.
    #[error("[substrate] curve: {what}")]
    Curve {
        /// What is wrong with which row.
        what: String,
    },
    /// No law has this name.
    #[error("[substrate] model = \"{name}\": there is no such law; give one of {}", SUBSTRATE_NAMES.join(", "))]
    Unknown {
        /// The name given.
        name: String,
    },
}

/// Names of all laws.
pub const SUBSTRATE_NAMES: [&str; 4] = [RambergOsgood::NAME, LinearElastic::NAME, Orthotropic::NAME, Tabulated::NAME];

/// The parameters of the law called `name` in `plane`.
///
/// # Errors
/// [`SubstrateError::Unknown`].
pub fn substrate_parameters(name: &str, plane: PlaneState) -> Result<&'static [Parameter], SubstrateError> {
    match name {
        RambergOsgood::NAME => Ok(&RambergOsgood::PARAMETERS),
        LinearElastic::NAME => Ok(&LinearElastic::PARAMETERS),
        Orthotropic::NAME => Ok(Orthotropic::parameters_in(plane)),
        Tabulated::NAME => Ok(&Tabulated::PARAMETERS),
        _ => Err(SubstrateError::Unknown { name: name.to_owned() }),
    }
}

/// The law called `name` with the given parameter values, in the order of [`substrate_parameters`].
///
/// # Errors
/// No such law, another number of values, a value that is not allowed; [`SubstrateError::Curve`] for a law that needs
/// more than numbers ([`Tabulated::new`]).
pub fn substrate_by_name(
    name: &str,
    values: &[f64],
    plane: PlaneState,
) -> Result<Box<dyn SubstrateLaw>, SubstrateError> {
    match name {
        RambergOsgood::NAME => Ok(Box::new(RambergOsgood::new(exactly(RambergOsgood::NAME, values)?, plane)?)),
        LinearElastic::NAME => {
            let [young, nu] = exactly(LinearElastic::NAME, values)?;
            Ok(Box::new(LinearElastic::new(young, nu, plane)?))
        }
        Orthotropic::NAME => Ok(Box::new(Orthotropic::new(values, plane)?)),
        Tabulated::NAME => Ok(Box::new(Tabulated::new(exactly(Tabulated::NAME, values)?, &[], plane)?)),
        _ => Err(SubstrateError::Unknown { name: name.to_owned() }),
    }
}

/// The energy of an elastic material under `stress`.
fn elastic_energy(Stress([x, y, shear]): Stress, strain: EngineeringStrain) -> SubstrateEnergy {
    SubstrateEnergy { elastic: 0.5 * (x * strain.xx + y * strain.yy + shear * strain.gamma_xy), plastic: 0.0 }
}

/// How far an elastic material is from yielding under `stress` and `z` out of the plane, MPa.
fn elastic_state(Stress([x, y, shear]): Stress, z: f64) -> SubstrateState {
    let squares = (x - y).powi(2) + (y - z).powi(2) + (z - x).powi(2);
    SubstrateState { equivalent_stress: (0.5 * squares + 3.0 * shear * shear).sqrt(), plastic_strain: 0.0 }
}

/// The values as an array of the length that the law needs.
fn exactly<const N: usize>(law: &'static str, values: &[f64]) -> Result<[f64; N], SubstrateError> {
    values.try_into().map_err(|_| SubstrateError::Count { law, needed: N, given: values.len() })
}

/// Young's modulus above zero, Poisson's ratio above -1 and below 0.5.
fn check_elastic(parameters: &[Parameter], young: f64, nu: f64) -> Result<(), SubstrateError> {
    check_positive(&parameters[0], young)?;
    if !(nu > -1.0 && nu < 0.5) {
        let needed = "Poisson's ratio must be above -1 and below 0.5";
        return Err(SubstrateError::Parameter { key: parameters[1].key(), value: nu, needed });
    }
    Ok(())
}

fn check_positive(parameter: &Parameter, value: f64) -> Result<(), SubstrateError> {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    Err(SubstrateError::Parameter { key: parameter.key(), value, needed: "it must be a finite number above zero" })
}

/// The stiffness of an isotropic material: `sigma_xx = along eps_xx + across eps_yy`, `sigma_xy = shear gamma_xy`.
fn isotropic(along: f64, across: f64, shear: f64) -> SubstrateStiffness {
    #[rustfmt::skip]
    let stiffness = Matrix3::new(
        along, across, 0.0,
        across, along, 0.0,
        0.0, 0.0, shear,
    );
    stiffness
}
