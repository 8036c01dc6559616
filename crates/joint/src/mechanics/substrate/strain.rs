//! Strain as the laws take it, with the engineering shear.

use crate::field::TensorStrain;
use nalgebra::Vector3;

/// Small strain in the plane with the **engineering** shear `gamma_xy = 2 eps_xy`, the change of a right angle: what a
/// stress does work on entry by entry.
///
/// A measured strain ([`TensorStrain`]) has half of that shear. The two convert here and nowhere else; axes stay as
/// they are.
///
/// ```
/// # use quadrille_joint as quadrille;
/// use quadrille::{field::TensorStrain, mechanics::substrate::EngineeringStrain};
/// let measured = TensorStrain { xx: 1e-3, yy: -3e-4, xy: 2e-4 };
/// let strain = EngineeringStrain::from(measured);
/// assert_eq!(strain, EngineeringStrain { xx: 1e-3, yy: -3e-4, gamma_xy: 4e-4 });
/// assert_eq!(TensorStrain::from(strain), measured);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct EngineeringStrain {
    /// Along x.
    pub xx: f64,
    /// Along y.
    pub yy: f64,
    /// The change of the right angle between x and y, radians.
    pub gamma_xy: f64,
}

impl EngineeringStrain {
    /// `(eps_xx, eps_yy, gamma_xy)`.
    pub fn vector(self) -> Vector3<f64> {
        Vector3::new(self.xx, self.yy, self.gamma_xy)
    }
}

impl From<TensorStrain> for EngineeringStrain {
    fn from(TensorStrain { xx, yy, xy }: TensorStrain) -> Self {
        Self { xx, yy, gamma_xy: 2.0 * xy }
    }
}

impl From<EngineeringStrain> for TensorStrain {
    fn from(EngineeringStrain { xx, yy, gamma_xy }: EngineeringStrain) -> Self {
        Self { xx, yy, xy: 0.5 * gamma_xy }
    }
}
