//! Deformation plasticity after a measured uniaxial curve (THEORY 3).

use super::deformation::{Deformation, Modes, Point};
use super::{
    EngineeringStrain, Parameter, PlaneState, Stress, SubstrateEnergy, SubstrateError, SubstrateLaw, SubstrateResponse,
    SubstrateState, SubstrateStiffness, check_elastic, check_positive, exactly,
};
use std::sync::Arc;

/// Share of the strain by which a row of the curve may lie beside what `E` gives: scatter of the elastic part.
const SCATTER: f64 = 0.02;

/// `eps = (1+nu)/E S + (1-2nu)/E p I + 3/2 (eps_p(q)/q) S`, where `eps_p` is the plastic strain of a uniaxial test at
/// the stress `q`: that of the rows of a table, between them by a monotone cubic (Fritsch and Carlson 1980), after the
/// last with its slope.
///
/// `curve_factor` multiplies the stresses of the table: its standard uncertainty is that of the curve. `E` moves the
/// elastic part alone; the plastic strains stay those that the table has with the `E` that it was read with.
#[derive(Debug, Clone, PartialEq)]
pub struct Tabulated {
    elastic: Deformation,
    factor: f64,
    curve: Arc<Curve>,
}

/// Plastic strain over stress: nodes with values, slopes, and the integral of the plastic strain up to each.
#[derive(Debug, PartialEq)]
struct Curve {
    stress: Vec<f64>,
    plastic: Vec<f64>,
    slope: Vec<f64>,
    integral: Vec<f64>,
}

impl Curve {
    /// The curve of rows of total strain and stress (MPa), both rising, of a material of modulus `young`.
    fn new(rows: &[[f64; 2]], young: f64) -> Result<Self, SubstrateError> {
        let refused = |what: String| SubstrateError::Curve { what };
        let rows: Vec<[f64; 2]> = rows.iter().copied().filter(|row| *row != [0.0; 2]).collect();
        if rows.len() < 2 {
            return Err(refused(format!(
                "{} rows beside the origin; give two or more of strain and stress",
                rows.len()
            )));
        }
        let (mut stress, mut plastic) = (vec![0.0], vec![0.0]);
        let mut before = [0.0; 2];
        for (k, &[strain, sigma]) in (1..).zip(&rows) {
            let at = format!("row {k} ({strain}, {sigma} MPa)");
            if !(strain.is_finite() && sigma.is_finite() && strain > before[0] && sigma > before[1]) {
                let what = format!("{at}: strain and stress have to rise from row to row, from the origin on");
                return Err(refused(what));
            }
            if strain > 1.0 {
                return Err(refused(format!("{at}: the strain is above 1; give it in mm/mm, not in %")));
            }
            let of_row = strain - sigma / young;
            let last = *plastic.last().unwrap_or(&0.0);
            if of_row < last - SCATTER * strain {
                let slope = (sigma - before[1]) / (strain - before[0]);
                return Err(refused(format!(
                    "{at}: with E = {young} MPa the plastic strain would be {of_row:.2e} after {last:.2e}; the curve rises by {slope:.0} \
                     MPa there; give the E of the curve"
                )));
            }
            stress.push(sigma);
            plastic.push(of_row.max(last));
            before = [strain, sigma];
        }
        let n = stress.len();
        let width = |k: usize| stress[k + 1] - stress[k];
        let secant = |k: usize| (plastic[k + 1] - plastic[k]) / width(k);
        let slope: Vec<f64> = (0..n)
            .map(|k| match k {
                0 => 0.0,
                k if k == n - 1 => secant(n - 2),
                k => {
                    let (a, b) = (secant(k - 1), secant(k));
                    let (wa, wb) = (2.0 * width(k) + width(k - 1), width(k) + 2.0 * width(k - 1));
                    if a * b > 0.0 { (wa + wb) / (wa / a + wb / b) } else { 0.0 }
                }
            })
            .collect();
        let mut integral = vec![0.0];
        for k in 0..n - 1 {
            let (w, sum) = (width(k), integral[k]);
            integral.push(sum + w * 0.5 * (plastic[k] + plastic[k + 1]) + w * w / 12.0 * (slope[k] - slope[k + 1]));
        }
        Ok(Self { stress, plastic, slope, integral })
    }

    /// Plastic strain, its slope, and its integral at the stress `q`.
    fn at(&self, q: f64) -> [f64; 3] {
        let n = self.stress.len();
        let k = self.stress.partition_point(|&stress| stress <= q).clamp(1, n);
        if k == n {
            let (beyond, slope) = (q - self.stress[n - 1], self.slope[n - 1]);
            let plastic = self.plastic[n - 1] + slope * beyond;
            return [plastic, slope, self.integral[n - 1] + 0.5 * beyond * (self.plastic[n - 1] + plastic)];
        }
        let k = k - 1;
        let w = self.stress[k + 1] - self.stress[k];
        let t = (q - self.stress[k]) / w;
        let (p0, p1, d0, d1) = (self.plastic[k], self.plastic[k + 1], w * self.slope[k], w * self.slope[k + 1]);
        // p0 + d0 t + a t^2 + b t^3.
        let (a, b) = (3.0 * (p1 - p0) - 2.0 * d0 - d1, d0 + d1 - 2.0 * (p1 - p0));
        let plastic = p0 + t * (d0 + t * (a + t * b));
        let slope = (d0 + t * (2.0 * a + t * 3.0 * b)) / w;
        let integral = self.integral[k] + w * t * (p0 + t * (d0 / 2.0 + t * (a / 3.0 + t * b / 4.0)));
        [plastic, slope, integral]
    }
}

impl Tabulated {
    /// Its name in case files.
    pub const NAME: &'static str = "tabulated";

    /// Its parameters.
    pub const PARAMETERS: [Parameter; 3] = [
        Parameter { name: "E", unit: "MPa", meaning: "Young's modulus" },
        Parameter { name: "nu", unit: "1", meaning: "Poisson's ratio" },
        Parameter {
            name: "curve_factor",
            unit: "1",
            meaning: "factor on the stresses of the curve; 1 unless it is given",
        },
    ];

    /// The law with `[E, nu, curve_factor]` and the `curve`: rows of total strain and stress (MPa) of a uniaxial test,
    /// both rising.
    ///
    /// # Errors
    /// [`SubstrateError::Parameter`] for the first that is not allowed, [`SubstrateError::Curve`].
    pub fn new([young, nu, factor]: [f64; 3], curve: &[[f64; 2]], plane: PlaneState) -> Result<Self, SubstrateError> {
        check_elastic(&Self::PARAMETERS, young, nu)?;
        Self::of([young, nu, factor], Arc::new(Curve::new(curve, young)?), plane)
    }

    fn of([young, nu, factor]: [f64; 3], curve: Arc<Curve>, plane: PlaneState) -> Result<Self, SubstrateError> {
        check_elastic(&Self::PARAMETERS, young, nu)?;
        check_positive(&Self::PARAMETERS[2], factor)?;
        Ok(Self { elastic: Deformation::new(young, nu, plane), factor, curve })
    }

    /// Plastic strain, its slope by the stress, and its integral over the stress, at `q`.
    fn plastic(&self, q: f64) -> [f64; 3] {
        let [plastic, slope, integral] = self.curve.at(q / self.factor);
        [plastic, slope / self.factor, self.factor * integral]
    }

    fn at(&self, q: f64) -> Point {
        if q == 0.0 {
            return Point { q, h: 0.0, slope: 0.0 };
        }
        let [plastic, slope, _] = self.plastic(q);
        let h = plastic / q;
        Point { q, h, slope: slope - h }
    }

    /// Everything at a strain: the root of `sum_i w_i/(a_i q + c_i p(q))^2 = 1`, whose left side falls. The elastic
    /// solution is above it; Newton in logarithms, kept in a bracket.
    fn point(&self, strain: EngineeringStrain) -> Point {
        let Modes { weight, elastic, plastic } = self.elastic.modes(strain);
        let norm = weight[0] + weight[1];
        if norm.is_nan() || norm == 0.0 || norm.is_infinite() {
            return Point { q: norm, h: 0.0, slope: 0.0 };
        }
        let of_elastic = (weight[0] / elastic[0].powi(2) + weight[1] / elastic[1].powi(2)).sqrt();
        let (mut low, mut high) = (0.0, of_elastic * (1.0 + 1e-14));
        let mut q = of_elastic;
        for _ in 0..100 {
            let Point { h, slope, .. } = self.at(q);
            let inverse = [1.0 / (elastic[0] + plastic[0] * h), 1.0 / (elastic[1] + plastic[1] * h)];
            let terms = [weight[0] * inverse[0] * inverse[0], weight[1] * inverse[1] * inverse[1]];
            let sum = terms[0] + terms[1];
            let ratio = q / sum.sqrt();
            let bend = (plastic[0] * terms[0] * inverse[0] + plastic[1] * terms[1] * inverse[1]) / sum;
            let step = q * (1.0 - 1.0 / ratio) / (1.0 + bend * slope);
            if ratio > 1.0 {
                high = q;
            } else {
                low = q;
            }
            let next = q - step;
            let inside = next > low && next < high;
            if step.abs() <= 1e-13 * q {
                break;
            }
            let next = if inside { next } else { 0.5 * (low + high) };
            if next == q {
                break;
            }
            q = next;
        }
        self.at(q)
    }
}

impl SubstrateLaw for Tabulated {
    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn parameters(&self) -> &'static [Parameter] {
        &Self::PARAMETERS
    }

    fn values(&self) -> Vec<f64> {
        vec![self.elastic.young, self.elastic.nu, self.factor]
    }

    fn with_values(&self, values: &[f64]) -> Result<Box<dyn SubstrateLaw>, SubstrateError> {
        Ok(Box::new(Self::of(exactly(Self::NAME, values)?, Arc::clone(&self.curve), self.elastic.plane)?))
    }

    fn response(&self, strain: EngineeringStrain) -> SubstrateResponse {
        let point = self.point(strain);
        self.elastic.response_at(strain, &point)
    }

    fn stress(&self, strain: EngineeringStrain) -> Stress {
        self.elastic.stress_at(strain, self.point(strain).h)
    }

    fn by_parameters(&self, strain: EngineeringStrain, derivatives: &mut [Stress]) {
        let point = self.point(strain);
        // h = p(q/f)/q at fixed q: dh/df = -p'(q/f)/f^2.
        let by_factor = if point.q > 0.0 { -(point.slope + point.h) / self.factor } else { 0.0 };
        self.elastic.by_parameters(strain, &point, &[0.0, 0.0, by_factor], derivatives);
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
        let [_, _, integral] = self.plastic(point.q);
        self.elastic.energy(strain, &point, integral)
    }

    fn yield_strain(&self) -> Option<f64> {
        // The last row without plastic strain; of a curve that has none the first row.
        let last = self.curve.plastic.partition_point(|&plastic| plastic <= 0.0).saturating_sub(1).max(1);
        Some(self.factor * self.curve.stress[last] / self.elastic.young)
    }

    fn young(&self) -> f64 {
        self.elastic.young
    }

    fn known_up_to(&self) -> Option<f64> {
        self.curve.plastic.last().copied()
    }
}
