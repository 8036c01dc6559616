//! Laws of the adhesive: the traction that the interface opposes to a jump, with all its derivatives.
//!
//! A law is one file: a type that implements [`CohesiveLaw`], and its kind among `KINDS`.

mod bilinear;
mod dual;
mod exponential_damage;
mod extended_xu_needleman;
mod mixed_mode;
mod no_adhesive;
mod park_paulino_roesler;
mod secants;
mod smith_ferrante;
mod touching;
mod trapezoidal;
mod xu_needleman;

pub use bilinear::Bilinear;
pub use exponential_damage::ExponentialDamage;
pub use extended_xu_needleman::ExtendedXuNeedleman;
pub use mixed_mode::MixedModeCriterion;
pub use no_adhesive::NoAdhesive;
pub use park_paulino_roesler::ParkPaulinoRoesler;
pub use smith_ferrante::SmithFerrante;
pub use touching::Touching;
pub use trapezoidal::Trapezoidal;
pub use xu_needleman::XuNeedleman;

use nalgebra::{Matrix2, Vector2};
use std::fmt::Debug;
use std::ops::Sub;
use thiserror::Error;

/// Jump of the displacement across the interface, mm: upper minus lower face, along the normal (from the
/// lower to the upper face; opening is positive) and along the tangent (the normal turned by -90 degrees).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Jump {
    /// Along the normal, mm.
    pub normal: f64,
    /// Along the tangent, mm.
    pub tangential: f64,
}

impl Jump {
    /// `(normal, tangential)`.
    pub fn vector(self) -> Vector2<f64> {
        Vector2::new(self.normal, self.tangential)
    }
}

impl From<Vector2<f64>> for Jump {
    fn from(jump: Vector2<f64>) -> Self {
        Self { normal: jump[0], tangential: jump[1] }
    }
}

impl Sub for Jump {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self { normal: self.normal - other.normal, tangential: self.tangential - other.tangential }
    }
}

/// Traction across the interface, MPa, or its derivative by a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Traction {
    /// Along the normal, MPa; tension is positive.
    pub normal: f64,
    /// Along the tangent, MPa.
    pub tangential: f64,
}

impl Traction {
    /// `(normal, tangential)`.
    pub fn vector(self) -> Vector2<f64> {
        Vector2::new(self.normal, self.tangential)
    }
}

/// `[[dT_n/dD_n, dT_n/dD_t], [dT_t/dD_n, dT_t/dD_t]]`, MPa/mm. Not symmetric in general.
pub type CohesiveStiffness = Matrix2<f64>;

/// What a law answers to a jump.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CohesiveResponse {
    /// The traction, MPa.
    pub traction: Traction,
    /// Its derivative by the jump, MPa/mm.
    pub tangent: CohesiveStiffness,
}

/// One number of a law, as files and results name it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Parameter {
    /// Its symbol: `phi_n`.
    pub name: &'static str,
    /// Its unit, `1` for a pure number.
    pub unit: &'static str,
    /// What it is.
    pub meaning: &'static str,
}

impl Parameter {
    /// Its key in a case file: the name with the unit, as in `phi_n_N_per_mm`.
    pub fn key(&self) -> String {
        match self.unit {
            "1" => self.name.to_owned(),
            unit => format!("{}_{}", self.name, unit.replace('/', "_per_").replace('^', "")),
        }
    }
}

/// A traction law of the interface, holonomic: a function of the jump alone (THEORY 4).
///
/// ```
/// # use quadrille_joint as quadrille;
/// use quadrille::mechanics::cohesive::{CohesiveLaw, ExtendedXuNeedleman, Jump};
/// let law = ExtendedXuNeedleman::new(1.0, 0.005, 0.05, 6.0)?;
/// let peak = law.response(Jump { normal: 0.005, tangential: 0.0 }).traction;
/// assert!((peak.normal - 73.6).abs() < 0.1); // phi_n / (e delta_n), MPa
/// # Ok::<(), quadrille::mechanics::cohesive::LawError>(())
/// ```
pub trait CohesiveLaw: Debug + Send + Sync {
    /// What all laws of its name have in common.
    fn kind(&self) -> &'static LawKind;

    /// The values of the parameters.
    fn values(&self) -> Vec<f64>;

    /// Its name in case files and results.
    fn name(&self) -> &'static str {
        self.kind().name
    }

    /// Its parameters, in the order of [`CohesiveLaw::values`] and of all sensitivities.
    fn parameters(&self) -> &'static [Parameter] {
        self.kind().parameters
    }

    /// The same law with other values of its parameters.
    ///
    /// # Errors
    /// When a value is not allowed, or their number is not that of the parameters.
    fn with_values(&self, values: &[f64]) -> Result<Box<dyn CohesiveLaw>, LawError> {
        (self.kind().make)(values)
    }

    /// Traction and tangent at `jump`.
    fn response(&self, jump: Jump) -> CohesiveResponse;

    /// Derivatives of the traction by each parameter at fixed `jump`, into `derivatives`.
    ///
    /// # Panics
    /// When `derivatives` has not as many entries as there are parameters.
    fn by_parameters(&self, jump: Jump, derivatives: &mut [Traction]);

    /// A stiffness `S` with `S jump = traction` that stays bounded where the tangent turns negative, MPa/mm.
    /// It serves the secant iteration that rescues Newton (THEORY 9).
    fn secant(&self, jump: Jump) -> CohesiveStiffness;

    /// Largest tractions in pure opening and in pure sliding, MPa.
    fn peak(&self) -> Traction;

    /// Work of separation in pure sliding, N/mm, where it is no parameter but follows from them; `None` where it is
    /// one.
    fn sliding_work(&self) -> Option<f64> {
        None
    }

    /// Whether a fit may end in several places that are nearly as good: corners, which make minima where pairs pass
    /// them, or parameters that stand for each other. What is uncertain about it belongs to the one that was found.
    fn has_own_minima(&self) -> bool {
        false
    }

    /// The values that the law allows parameter `index`, whatever the others are.
    fn range(&self, _index: usize) -> [f64; 2] {
        [0.0, f64::INFINITY]
    }

    /// What else ends the range of the parameters: where they restrict each other.
    fn limits(&self) -> Vec<LawLimit> {
        Vec::new()
    }

    /// Normal jump at which the joint counts as cracked, mm: the crack front lies where it is reached.
    fn front_opening(&self) -> f64;
}

/// A place where a law ends because its parameters restrict each other.
#[derive(Debug, Clone, PartialEq)]
pub struct LawLimit {
    /// How far the values are from there: a logarithm that is positive where the law exists.
    pub distance: f64,
    /// Its derivative by each parameter of the law.
    pub by: Vec<f64>,
    /// What ends there, in words.
    pub what: &'static str,
}

/// Why there is no such law.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum LawError {
    /// A parameter outside its range.
    #[error("[cohesive] {key} is {value}: {needed}")]
    Parameter {
        /// Its key.
        key: String,
        /// Its value.
        value: f64,
        /// What it must be.
        needed: &'static str,
    },
    /// Another number of values than of parameters.
    #[error("the cohesive law '{law}' has {needed} parameters, {given} values were given")]
    Count {
        /// Name of the law.
        law: &'static str,
        /// Number of its parameters.
        needed: usize,
        /// Number given.
        given: usize,
    },
    /// No law has this name.
    #[error("[cohesive] model = \"{name}\": there is no such law; give one of {}", LAW_NAMES.join(", "))]
    Unknown {
        /// The name given.
        name: String,
    },
}

/// Makes a law of its parameters.
pub type MakeLaw = fn(&[f64]) -> Result<Box<dyn CohesiveLaw>, LawError>;

/// All laws of one name.
#[derive(Debug)]
pub struct LawKind {
    /// The name in case files and results.
    pub name: &'static str,
    /// The parameters.
    pub parameters: &'static [Parameter],
    /// Makes the law with these values of them.
    pub make: MakeLaw,
}

/// Every kind of law of an adhesive.
static KINDS: [&LawKind; 9] = [
    &extended_xu_needleman::KIND,
    &xu_needleman::KIND,
    &bilinear::KINDS[0],
    &bilinear::KINDS[1],
    &trapezoidal::KINDS[0],
    &trapezoidal::KINDS[1],
    &park_paulino_roesler::KIND,
    &smith_ferrante::KIND,
    &exponential_damage::KIND,
];

/// Names of all laws.
pub const LAW_NAMES: [&str; 9] = {
    let (mut names, mut k) = ([""; 9], 0);
    while k < names.len() {
        names[k] = KINDS[k].name;
        k += 1;
    }
    names
};

/// One law of each kind: what a comparison takes when none is named.
pub const USUAL_LAWS: [&str; 6] = [
    ExtendedXuNeedleman::NAME,
    XuNeedleman::NAME,
    Bilinear::POWER,
    Trapezoidal::POWER,
    ParkPaulinoRoesler::NAME,
    SmithFerrante::NAME,
];

fn kind_by_name(name: &str) -> Result<&'static LawKind, LawError> {
    let kind = KINDS.into_iter().chain([&no_adhesive::KIND]).find(|kind| kind.name == name);
    kind.ok_or_else(|| LawError::Unknown { name: name.to_owned() })
}

/// The parameters of the law called `name`.
///
/// # Errors
/// [`LawError::Unknown`].
pub fn parameters_by_name(name: &str) -> Result<&'static [Parameter], LawError> {
    Ok(kind_by_name(name)?.parameters)
}

/// The law called `name` with the given parameter values, in the order of [`parameters_by_name`].
///
/// # Errors
/// No such law, another number of values, a value that is not allowed.
pub fn law_by_name(name: &str, values: &[f64]) -> Result<Box<dyn CohesiveLaw>, LawError> {
    (kind_by_name(name)?.make)(values)
}

/// The values as an array of the length that the law needs.
fn exactly<const N: usize>(law: &'static str, values: &[f64]) -> Result<[f64; N], LawError> {
    values.try_into().map_err(|_| LawError::Count { law, needed: N, given: values.len() })
}

/// Refuses the first value that is not positive and finite.
fn all_positive(parameters: &[Parameter], values: &[f64]) -> Result<(), LawError> {
    match parameters.iter().zip(values).find(|(_, value)| !(value.is_finite() && **value > 0.0)) {
        None => Ok(()),
        Some((parameter, &value)) => {
            Err(LawError::Parameter { key: parameter.key(), value, needed: "it must be a finite number above zero" })
        }
    }
}

/// The values of a law's parameters as the variables 2, 3, ..: the jump comes first.
fn variables<const P: usize, const N: usize>(values: [f64; P]) -> [dual::Dual<N>; P] {
    std::array::from_fn(|k| dual::Dual::variable(values[k], 2 + k))
}
