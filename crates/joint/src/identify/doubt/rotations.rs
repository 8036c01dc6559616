//! What rotations that are taken as small cost: the model once more with finite ones, at the parameters found.

use crate::identify::doubt::remarks::{rotations_matter, rotations_unknown};
use crate::identify::{Evaluation, FittedParameter, LoadCell, ObservedInstant, Problem};
use crate::linalg::Dense;
use crate::mechanics::{BoundaryHistory, ForwardOptions, Kinematics, ModelOptions};
use crate::remark::Remark;

/// Change by finite rotations, in standard uncertainties, above which the run says so.
pub const ROTATIONS_TOLD: f64 = 0.1;
/// The same, above which small rotations do not hold: what they cost is more than what is not known.
pub const ROTATIONS_HELD: f64 = 1.0;

/// Share of a parameter up to which its change to first order is a number: beyond, the next order, about the square, is
/// as much as a quarter of it.
const FIRST_ORDER: f64 = 0.25;

/// A change to first order by `share` of the value, in words.
///
/// ```
/// # use quadrille_joint as quadrille;
/// use quadrille::identify::describe_change;
/// assert_eq!(describe_change(-0.031), "-3.10 %");
/// assert_eq!(describe_change(-1.03), "more than 25 % (beyond what first order tells)");
/// ```
pub fn describe_change(share: f64) -> String {
    match share.abs() <= FIRST_ORDER {
        true => format!("{:+.2} %", 100.0 * share),
        false => format!("more than {:.0} % (beyond what first order tells)", 100.0 * FIRST_ORDER),
    }
}

/// What finite rotations would change of a fit with small ones.
#[derive(Debug, Clone, PartialEq)]
pub struct Rotations {
    /// Change of each parameter that was fitted, to first order, in its unit; `None` where the model with finite
    /// rotations has no solution.
    pub change: Option<Vec<f64>>,
}

impl Rotations {
    pub(crate) fn new(scaled: Option<Vec<f64>>, slopes: &[f64]) -> Self {
        Self { change: scaled.map(|scaled| scaled.iter().zip(slopes).map(|(z, slope)| z * slope).collect()) }
    }

    /// The largest change in standard uncertainties of its parameter; `None` where either is not known.
    pub fn in_stds(&self, parameters: &[FittedParameter]) -> Option<f64> {
        let share =
            |(change, p): (&f64, &FittedParameter)| p.std.filter(|std| *std > 0.0).map(|std| change.abs() / std);
        let shares = self.change.as_ref()?.iter().zip(parameters).map(share).collect::<Option<Vec<f64>>>()?;
        Some(shares.into_iter().fold(0.0, f64::max))
    }

    /// What a user has to know, if there is something.
    pub fn remark(&self, parameters: &[FittedParameter]) -> Option<Remark> {
        let Some(change) = &self.change else { return Some(rotations_unknown()) };
        let largest = self.in_stds(parameters).filter(|&largest| largest > ROTATIONS_TOLD)?;
        let told = change.iter().zip(parameters).map(|(change, p)| {
            format!(
                "{} by {} ({:.1} standard uncertainties)",
                p.parameter.name,
                describe_change(change / p.value),
                change.abs() / p.std.unwrap_or(f64::INFINITY)
            )
        });
        let told = told.collect::<Vec<_>>().join(", ");
        Some(rotations_matter(&told, largest, largest <= ROTATIONS_HELD))
    }
}

impl Problem<'_> {
    /// The change of the measured rows of each instant compared, mm, when rotations are finite; `None` where they are
    /// already, or where there is no solution.
    pub(crate) fn turn(&self, evaluation: &Evaluation, boundary: &BoundaryHistory) -> Option<Vec<Dense>> {
        let law = self.unknowns.law_at(&evaluation.x).ok()?;
        let model = evaluation.model(self);
        let options = ModelOptions { kinematics: Kinematics::Finite, ..*model.options() };
        let finite = model.held_alike(model.mesh().clone(), options).ok()?;
        let ended = || self.watch.ended().is_some();
        let of_law = (&*law, evaluation.x.as_slice());
        let solution = self.forward(&finite, of_law, boundary, &ForwardOptions::default(), &ended).ok()?;
        let observation = &self.observation;
        let difference = |observed: &ObservedInstant| {
            let after = &solution.instants[observed.index];
            let before = &evaluation.solution.instants[observed.index].displacement;
            after.status.converged().then(|| {
                let of_force = |cell: &LoadCell| {
                    let turned = cell.reaction(&finite, &*law, &after.displacement).value;
                    cell.width_mm * (turned - cell.reaction(model, &*law, before).value)
                };
                let of_node = |node: usize, c: usize| after.displacement[node][c] - before[node][c];
                observation.column(observed.index, of_node, of_force)
            })
        };
        observation.instants.iter().map(difference).collect()
    }

    /// Whether rotations are taken as small.
    pub(crate) fn is_small(&self) -> bool {
        self.joint.model.options().kinematics.is_small()
    }
}
