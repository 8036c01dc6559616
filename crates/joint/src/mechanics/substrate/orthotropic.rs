//! Orthotropic linear elasticity at an angle: laminates, wood, rolled sheet.

use super::{
    EngineeringStrain, Parameter, PlaneState, Stress, SubstrateEnergy, SubstrateError, SubstrateLaw, SubstrateResponse,
    SubstrateState, SubstrateStiffness, check_positive, elastic_energy, elastic_state, exactly,
};
use nalgebra::Matrix3;

/// `stress = T^T Q T strain`: `Q` in the axes of the material, of which 1 lies at `angle` degrees from x towards y, 2
/// across it in the plane, and 3 out of it; `T` turns the strain into these axes.
///
/// `nu_12` is the contraction along 2 by the extension along 1 under a stress along 1, so that `nu_21 = nu_12 E_2/E_1`.
///
/// ```
/// # use quadrille_joint as quadrille;
/// use quadrille::mechanics::substrate::{EngineeringStrain, Orthotropic, PlaneState, SubstrateLaw};
/// // Fibres along y: an extension along y meets them.
/// let law = Orthotropic::new(&[140e3, 10e3, 0.3, 5e3, 90.0], PlaneState::PlaneStress)?;
/// let stress = law.stress(EngineeringStrain { yy: 1e-3, ..EngineeringStrain::default() });
/// assert!((stress.0[1] - 140.9).abs() < 0.1);
/// # Ok::<(), quadrille::mechanics::substrate::SubstrateError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Orthotropic {
    values: Vec<f64>,
    plane: PlaneState,
    /// In the axes of the plane.
    stiffness: SubstrateStiffness,
    /// Its derivative by each parameter.
    by: Vec<SubstrateStiffness>,
}

/// Radians of a degree.
const DEGREE: f64 = std::f64::consts::PI / 180.0;

impl Orthotropic {
    /// Its name in case files.
    pub const NAME: &'static str = "orthotropic";

    /// Its parameters: in plane stress the first five.
    pub const PARAMETERS: [Parameter; 8] = [
        Parameter { name: "E_1", unit: "MPa", meaning: "Young's modulus along axis 1 of the material" },
        Parameter { name: "E_2", unit: "MPa", meaning: "Young's modulus along axis 2, across it in the plane" },
        Parameter { name: "nu_12", unit: "1", meaning: "Poisson's ratio: contraction along 2 by extension along 1" },
        Parameter { name: "G_12", unit: "MPa", meaning: "shear modulus in the plane" },
        Parameter { name: "angle", unit: "deg", meaning: "angle of axis 1 from x towards y" },
        Parameter { name: "E_3", unit: "MPa", meaning: "Young's modulus out of the plane; in plane strain only" },
        Parameter {
            name: "nu_13",
            unit: "1",
            meaning: "contraction along 3 by extension along 1; in plane strain only",
        },
        Parameter {
            name: "nu_23",
            unit: "1",
            meaning: "contraction along 3 by extension along 2; in plane strain only",
        },
    ];

    /// Its parameters in `plane`.
    pub fn parameters_in(plane: PlaneState) -> &'static [Parameter] {
        match plane {
            PlaneState::PlaneStress => &Self::PARAMETERS[..5],
            PlaneState::PlaneStrain => &Self::PARAMETERS,
        }
    }

    /// The law with `[E_1, E_2, nu_12, G_12, angle]` (MPa, degrees) and, in plane strain, `E_3, nu_13, nu_23`.
    ///
    /// # Errors
    /// [`SubstrateError`] for another number of values, moduli that are not above zero, an angle that is no number,
    /// ratios with which the material would give energy when it is loaded.
    pub fn new(values: &[f64], plane: PlaneState) -> Result<Self, SubstrateError> {
        let parameters = Self::parameters_in(plane);
        if values.len() != parameters.len() {
            return Err(SubstrateError::Count { law: Self::NAME, needed: parameters.len(), given: values.len() });
        }
        for (parameter, &value) in parameters.iter().zip(values) {
            let refused = |needed| Err(SubstrateError::Parameter { key: parameter.key(), value, needed });
            match parameter.unit {
                "MPa" => check_positive(parameter, value)?,
                _ if !value.is_finite() => return refused("it must be a finite number"),
                _ => {}
            }
        }
        check_ratios(values, parameters)?;
        let [e_1, e_2, nu_12, g_12, angle] = exactly(Self::NAME, &values[..5])?;
        let (compliance, mut by) = match plane {
            PlaneState::PlaneStress => in_plane_stress([e_1, e_2, nu_12, g_12]),
            PlaneState::PlaneStrain => in_plane_strain([e_1, e_2, nu_12, g_12], exactly(Self::NAME, &values[5..])?),
        };
        let Some(own) = compliance.try_inverse() else {
            let needed = "the compliance of the material has no inverse with it";
            return Err(SubstrateError::Parameter { key: parameters[2].key(), value: nu_12, needed });
        };
        // dQ = -Q dS Q.
        by.iter_mut().for_each(|by| *by = -own * *by * own);
        let (turn, turn_by) = turned(angle * DEGREE);
        let in_axes = |q: Matrix3<f64>| turn.transpose() * q * turn;
        let half = turn_by.transpose() * own * turn * DEGREE;
        let by_angle = half + half.transpose();
        let mut all: Vec<SubstrateStiffness> = by.into_iter().map(in_axes).collect();
        all.insert(4, by_angle);
        let stiffness = in_axes(own);
        // Symmetric to the last bit.
        let stiffness = 0.5 * (stiffness + stiffness.transpose());
        Ok(Self { values: values.to_vec(), plane, stiffness, by: all })
    }

    fn out_of_plane(&self, Stress([x, y, shear]): Stress) -> f64 {
        if self.plane == PlaneState::PlaneStress {
            return 0.0;
        }
        let [e_1, e_2, _, _, angle, e_3, nu_13, nu_23] = self.values[..] else { return 0.0 };
        let (sin, cos) = (angle * DEGREE).sin_cos();
        let along = cos * cos * x + sin * sin * y + 2.0 * sin * cos * shear;
        let across = sin * sin * x + cos * cos * y - 2.0 * sin * cos * shear;
        e_3 * (nu_13 / e_1 * along + nu_23 / e_2 * across)
    }
}

/// Refuses ratios with which some strain would have a negative energy: the minors of the compliance.
fn check_ratios(values: &[f64], parameters: &[Parameter]) -> Result<(), SubstrateError> {
    let refused =
        |k: usize, needed| Err(SubstrateError::Parameter { key: parameters[k].key(), value: values[k], needed });
    let [e_1, e_2, nu_12] = [values[0], values[1], values[2]];
    if nu_12 * nu_12 >= e_1 / e_2 {
        return refused(2, "its square must be below E_1/E_2 (is it nu_21 that was meant?)");
    }
    if let [_, _, _, _, _, e_3, nu_13, nu_23] = *values {
        if nu_13 * nu_13 >= e_1 / e_3 {
            return refused(6, "its square must be below E_1/E_3 (is it nu_31 that was meant?)");
        }
        if nu_23 * nu_23 >= e_2 / e_3 {
            return refused(7, "its square must be below E_2/E_3 (is it nu_32 that was meant?)");
        }
        let determinant = 1.0
            - nu_12 * nu_12 * e_2 / e_1
            - nu_23 * nu_23 * e_3 / e_2
            - nu_13 * nu_13 * e_3 / e_1
            - 2.0 * nu_12 * nu_23 * nu_13 * e_3 / e_1;
        if determinant <= 0.0 {
            return refused(
                2,
                "with nu_13 and nu_23 the material would give energy when it is compressed; they are too large",
            );
        }
    }
    Ok(())
}

/// Compliance in the axes of the material, and its derivatives by E_1, E_2, nu_12, G_12.
fn in_plane_stress([e_1, e_2, nu_12, g_12]: [f64; 4]) -> (Matrix3<f64>, Vec<Matrix3<f64>>) {
    let of =
        |s_11: f64, s_12: f64, s_22: f64, s_66: f64| Matrix3::new(s_11, s_12, 0.0, s_12, s_22, 0.0, 0.0, 0.0, s_66);
    let compliance = of(1.0 / e_1, -nu_12 / e_1, 1.0 / e_2, 1.0 / g_12);
    let by = vec![
        of(-1.0 / (e_1 * e_1), nu_12 / (e_1 * e_1), 0.0, 0.0),
        of(0.0, 0.0, -1.0 / (e_2 * e_2), 0.0),
        of(0.0, -1.0 / e_1, 0.0, 0.0),
        of(0.0, 0.0, 0.0, -1.0 / (g_12 * g_12)),
    ];
    (compliance, by)
}

/// The same without strain out of the plane: `S_ij - S_i3 S_j3/S_33`; derivatives also by E_3, nu_13, nu_23.
fn in_plane_strain(
    [e_1, e_2, nu_12, g_12]: [f64; 4],
    [e_3, nu_13, nu_23]: [f64; 3],
) -> (Matrix3<f64>, Vec<Matrix3<f64>>) {
    let (mut compliance, mut by) = in_plane_stress([e_1, e_2, nu_12, g_12]);
    // s = (S_13, S_23) and its derivatives; S_33 = 1/E_3.
    let s = [-nu_13 / e_1, -nu_23 / e_2];
    let s_by = [
        [nu_13 / (e_1 * e_1), 0.0],
        [0.0, nu_23 / (e_2 * e_2)],
        [0.0; 2],
        [0.0; 2],
        [0.0; 2],
        [-1.0 / e_1, 0.0],
        [0.0, -1.0 / e_2],
    ];
    by.extend([Matrix3::zeros(); 3]);
    for i in 0..2 {
        for j in 0..2 {
            compliance[(i, j)] -= e_3 * s[i] * s[j];
            for (k, by) in by.iter_mut().enumerate() {
                by[(i, j)] -= e_3 * (s_by[k][i] * s[j] + s[i] * s_by[k][j]);
            }
            by[4][(i, j)] -= s[i] * s[j];
        }
    }
    (compliance, by)
}

/// What turns a strain (engineering shear) into axes at `angle`, and its derivative by the angle.
fn turned(angle: f64) -> (Matrix3<f64>, Matrix3<f64>) {
    let (s, c) = angle.sin_cos();
    let (cc, ss, sc, double) = (c * c, s * s, s * c, c * c - s * s);
    #[rustfmt::skip]
    let turn = Matrix3::new(
        cc, ss, sc,
        ss, cc, -sc,
        -2.0 * sc, 2.0 * sc, double,
    );
    #[rustfmt::skip]
    let by = Matrix3::new(
        -2.0 * sc, 2.0 * sc, double,
        2.0 * sc, -2.0 * sc, -double,
        -2.0 * double, 2.0 * double, -4.0 * sc,
    );
    (turn, by)
}

impl SubstrateLaw for Orthotropic {
    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn parameters(&self) -> &'static [Parameter] {
        Self::parameters_in(self.plane)
    }

    fn values(&self) -> Vec<f64> {
        self.values.clone()
    }

    fn with_values(&self, values: &[f64]) -> Result<Box<dyn SubstrateLaw>, SubstrateError> {
        Ok(Box::new(Self::new(values, self.plane)?))
    }

    fn response(&self, strain: EngineeringStrain) -> SubstrateResponse {
        SubstrateResponse { stress: self.stress(strain), tangent: self.stiffness }
    }

    fn stress(&self, strain: EngineeringStrain) -> Stress {
        Stress((self.stiffness * strain.vector()).into())
    }

    fn by_parameters(&self, strain: EngineeringStrain, derivatives: &mut [Stress]) {
        assert_eq!(derivatives.len(), self.by.len(), "one derivative per parameter");
        for (derivative, by) in derivatives.iter_mut().zip(&self.by) {
            *derivative = Stress((by * strain.vector()).into());
        }
    }

    fn secant(&self, _: EngineeringStrain) -> SubstrateStiffness {
        self.stiffness
    }

    fn state(&self, strain: EngineeringStrain) -> SubstrateState {
        let stress = self.stress(strain);
        elastic_state(stress, self.out_of_plane(stress))
    }

    fn energy(&self, strain: EngineeringStrain) -> SubstrateEnergy {
        elastic_energy(self.stress(strain), strain)
    }

    fn young(&self) -> f64 {
        self.values[0].max(self.values[1])
    }
}
