//! The objective (THEORY 6, 7): residual, Jacobian, and what the trust region needs of them.

use crate::identify::{
    Border, FitError, FitWatch, InverseCovariance, LoadCell, Local, Noise, Observation, ObservedInstant, OfMaterial,
    Unknowns, Weights,
};
use crate::io::case::WeightKind;
use crate::linalg::Dense;
use crate::mechanics::cohesive::CohesiveLaw;
use crate::mechanics::{BoundaryHistory, ForwardOptions, Joint, Model, ModelError, ReactionAt, Solution, Status};
use rayon::prelude::*;
use std::cell::Cell;
use std::sync::Arc;

/// Everything that stays while parameters are tried.
#[derive(Debug)]
pub struct Problem<'a> {
    /// Mesh, materials, prescribed displacements.
    pub joint: &'a Joint,
    /// What is compared.
    pub observation: Arc<Observation>,
    /// What is prescribed at the border.
    pub border: Arc<Border>,
    /// What is known of its noise.
    pub noise: Arc<Noise>,
    /// What is looked for.
    pub unknowns: Unknowns,
    /// What ends the fit from outside, and who hears how it goes.
    pub watch: FitWatch,
}

/// Solutions of equations that one forward run may take for each instant and for each node pair that can snap; one that
/// the data can be fitted with takes a tenth of it. A law that is far off (lengths in another unit) snaps pair by pair
/// in every increment, for hours.
const STEPS: usize = 100;

/// The objective at one set of parameters.
#[derive(Debug, Clone)]
pub struct Evaluation {
    /// The parameters.
    pub x: Vec<f64>,
    /// Per instant compared: the residual, measured less computed, and its derivative by each scaled unknown (that of
    /// the computed displacement), mm.
    pub blocks: Vec<Dense>,
    /// The forward run; its sensitivities are by the parameters of the law, then by the fitted ones of materials.
    pub solution: Solution,
    /// Whether it was rescued.
    pub rescued: bool,
    /// The model, where parameters of its materials are fitted.
    pub(crate) own_model: Option<Arc<Model>>,
}

impl Evaluation {
    /// The objective and its derivatives under `weights`.
    pub fn local(&self, weights: &Weights, noise: &Noise) -> Local {
        let weighted = weights.times(noise, &self.blocks);
        let n = self.blocks[0].n_columns();
        let mut sum = Dense::zeros(n, n);
        self.blocks.iter().zip(&weighted).for_each(|(x, wx)| sum.add(1.0, &x.transposed_times(wx)));
        let symmetric = |r: usize, c: usize| 0.5 * (sum[(r + 1, c + 1)] + sum[(c + 1, r + 1)]);
        Local {
            omega: sum[(0, 0)],
            b: (1..n).map(|k| sum[(k, 0)]).collect(),
            h: Dense::from_fn(n - 1, n - 1, symmetric),
            rescued: self.rescued,
        }
    }

    /// The model with the materials of these parameters.
    pub fn model<'a>(&'a self, problem: &'a Problem<'_>) -> &'a Model {
        self.own_model.as_deref().unwrap_or(&problem.joint.model)
    }

    /// A copy of that model, where parameters of its materials are fitted.
    pub fn fitted_model(&self) -> Option<Model> {
        self.own_model.as_deref().cloned()
    }

    /// The residual alone, a column for each instant.
    pub fn residual(&self) -> Vec<Dense> {
        self.blocks.iter().map(|block| Dense::from_fn(block.n_rows(), 1, |r, _| block[(r, 0)])).collect()
    }

    /// The residual that a step of the scaled unknowns leaves, to first order.
    pub fn residual_after(&self, step: &[f64]) -> Vec<Dense> {
        let left = |block: &Dense, r: usize| {
            block[(r, 0)] - step.iter().enumerate().map(|(k, s)| block[(r, k + 1)] * s).sum::<f64>()
        };
        self.blocks.iter().map(|block| Dense::from_fn(block.n_rows(), 1, |r, _| left(block, r))).collect()
    }

    /// The derivatives alone: one block of columns for each instant.
    pub fn jacobian(&self) -> Vec<Dense> {
        let derivatives =
            |block: &Dense| Dense::from_fn(block.n_rows(), block.n_columns() - 1, |r, c| block[(r, c + 1)]);
        self.blocks.iter().map(derivatives).collect()
    }
}

impl Problem<'_> {
    /// The same data with other unknowns.
    pub fn with_unknowns(&self, unknowns: Unknowns) -> Self {
        let (observation, noise, watch) = (self.observation.clone(), self.noise.clone(), self.watch.clone());
        Self { joint: self.joint, observation, border: self.border.clone(), noise, unknowns, watch }
    }

    /// Numbers compared over all instants, what a smooth border leaves of its components among them.
    pub fn n_data(&self) -> usize {
        self.observation.n_data() + self.border.n_left() * self.observation.instants.len()
    }

    /// Parameters by their names, for those who watch.
    pub(crate) fn named(&self, x: &[f64]) -> Vec<(&'static str, f64)> {
        self.unknowns.list().iter().zip(x).map(|(unknown, &x)| (unknown.parameter.name, x)).collect()
    }

    /// A forward run on `model` with the law at the parameters `x`, which takes no longer than a good one may, and ends
    /// when `ended` says so.
    pub(crate) fn forward(
        &self,
        model: &Model,
        (law, x): (&dyn CohesiveLaw, &[f64]),
        boundary: &BoundaryHistory,
        options: &ForwardOptions,
        ended: &dyn Fn() -> bool,
    ) -> Result<Solution, ModelError> {
        let n_instants = boundary.instants().len();
        let (most, steps) = (STEPS * (10 + n_instants + model.mesh().pairs().len()), Cell::new(0_usize));
        let go_on = |instant: usize| {
            steps.set(steps.get() + 1);
            self.watch.at(instant, n_instants, || self.named(x));
            steps.get() <= most && !ended()
        };
        model.forward_while(law, boundary, options, &go_on)
    }

    /// The objective's ingredients at `x` with the prescribed displacements `boundary`; `None` where the law refuses
    /// the values or the forward model has no solution; or would take too long, or when the fit has to end.
    ///
    /// # Errors
    /// A boundary of other nodes.
    pub fn evaluate(&self, x: &[f64], boundary: &BoundaryHistory) -> Result<Option<Evaluation>, ModelError> {
        self.evaluate_unless(x, boundary, &|| self.watch.ended().is_some())
    }

    /// The same at a point that had a solution before, also when the fit has to end: of what was found the rest is
    /// wanted.
    pub(crate) fn evaluate_again(
        &self,
        x: &[f64],
        boundary: &BoundaryHistory,
    ) -> Result<Option<Evaluation>, ModelError> {
        self.evaluate_unless(x, boundary, &|| false)
    }

    fn evaluate_unless(
        &self,
        x: &[f64],
        boundary: &BoundaryHistory,
        ended: &dyn Fn() -> bool,
    ) -> Result<Option<Evaluation>, ModelError> {
        let (Ok(law), Ok(materials)) = (self.unknowns.law_at(x), self.unknowns.materials_at(x)) else {
            return Ok(None);
        };
        let own_model = materials.map(|materials| Arc::new(self.joint.model.with_materials(materials)));
        let model = own_model.as_deref().unwrap_or(&self.joint.model);
        let substrate_sensitivities = own_model.is_some();
        let options = ForwardOptions { law_sensitivities: true, substrate_sensitivities, ..ForwardOptions::default() };
        let mut solution = self.forward(model, (&*law, x), boundary, &options, ended)?;
        self.unknowns.gather(&mut solution);
        self.watch.note_evaluation();
        let slopes = self.unknowns.slopes(x);
        let Observation { nodes, instants, force, .. } = &*self.observation;
        let mut blocks = Vec::with_capacity(instants.len());
        for observed in instants {
            let instant = &solution.instants[observed.index];
            if !instant.status.converged() {
                return Ok(None);
            }
            let measured = force.as_ref().and_then(|cell| Some((cell, cell.at(observed.index)?)));
            let reaction = measured.map(|(cell, force)| {
                (cell.width_mm, force, self.reaction((cell, model), &*law, &instant.displacement))
            });
            let of_force = |column: usize| match (&reaction, column) {
                (None, _) => 0.0,
                (Some((width, force, reaction)), 0) => force - width * reaction.value,
                (Some((width, _, reaction)), k) => {
                    let index = self.unknowns.list()[k - 1].index;
                    let by = reaction.change(&instant.sensitivities[index]) + reaction.by_law[index];
                    slopes[k - 1] * width * by
                }
            };
            let entry = |row: usize, column: usize| {
                if row == 2 * nodes.len() {
                    return of_force(column);
                }
                let (node, c) = (nodes[row / 2], row % 2);
                match column {
                    0 => observed.displacement[row] - instant.displacement[node as usize][c],
                    k => {
                        let unknown = &self.unknowns.list()[k - 1];
                        slopes[k - 1] * instant.sensitivities[unknown.index][node as usize][c]
                    }
                }
            };
            let block = Dense::from_fn(self.observation.n_rows(), 1 + slopes.len(), entry);
            if (0..block.n_columns()).any(|k| block.column(k).iter().any(|v| !v.is_finite())) {
                return Ok(None);
            }
            blocks.push(block);
        }
        let rescued = solution.instants.iter().any(|instant| instant.status == Status::Rescued);
        Ok(Some(Evaluation { x: x.to_vec(), blocks, solution, rescued, own_model }))
    }

    /// What the load cell sees of the displacements `u` of `model`; its derivatives by the fitted parameters of
    /// materials are behind those by the law's.
    pub(crate) fn reaction(
        &self,
        (cell, model): (&LoadCell, &Model),
        law: &dyn CohesiveLaw,
        u: &[[f64; 2]],
    ) -> ReactionAt {
        let mut reaction = cell.reaction(model, law, u);
        for OfMaterial { groups, index } in self.unknowns.of_materials() {
            let by: f64 = groups.iter().map(|&group| cell.by_material(model, group, u)[*index]).sum();
            reaction.by_law.push(by / cell.width_mm);
        }
        reaction
    }

    /// The paper's weights, or those that are all one, each with the factor of its instant.
    pub fn diagonal_weights(&self, kind: WeightKind) -> Weights {
        let observation = &self.observation;
        // By the noise of a displacement, in the mean.
        let of_force = observation.force.as_ref().and_then(|cell| cell.std_n).map_or(0.0, |std| {
            let sigma = self.noise.sigma.unwrap_or(1.0);
            let variance = sigma * sigma * self.noise.mean_variance();
            if variance > 0.0 { variance / (std * std) } else { 1.0 / (std * std) }
        });
        let weight = |row: usize, largest: [f64; 2], factor: f64| match kind {
            _ if observation.force_row() == Some(row) => factor * of_force,
            _ if !observation.compares(row) => 0.0,
            WeightKind::Paper if largest[row % 2] > 0.0 => factor / (largest[row % 2] * largest[row % 2]),
            WeightKind::Paper => 0.0,
            WeightKind::Uniform | WeightKind::Covariance => factor,
        };
        let rows = observation.n_rows();
        let instants = observation.instants.iter();
        Weights::Diagonal(instants.map(|i| (0..rows).map(|row| weight(row, i.largest, i.factor)).collect()).collect())
    }

    /// The inverse covariance of all instants; `by_boundary` holds their `T_i`, none where the boundary has no noise.
    pub(crate) fn inverse_covariance(&self, by_boundary: Vec<Dense>) -> Result<Weights, FitError> {
        let inverse = InverseCovariance::new(&self.noise, self.observation.instants.len(), by_boundary);
        inverse.map(Weights::Inverse).map_err(|fault| FitError::Covariance { row: fault.node })
    }

    /// The weights of this kind that a fit begins with: the whole covariance follows the parameters where the boundary
    /// has noise.
    pub(crate) fn first_weights(&self, kind: WeightKind) -> Result<Weights, FitError> {
        match kind {
            WeightKind::Covariance if self.observation.prescribed.is_empty() => self.inverse_covariance(Vec::new()),
            kind => Ok(self.diagonal_weights(kind)),
        }
    }

    /// `T_i`: derivatives of all rows by the coefficients of the border (its components, where it is free) at each
    /// instant compared; empty where the boundary has no noise.
    ///
    /// # Errors
    /// A tangent without inverse; values that the law refuses.
    pub fn by_boundary(&self, evaluation: &Evaluation) -> Result<Vec<Dense>, FitError> {
        let observation = &*self.observation;
        let Observation { prescribed, instants, .. } = observation;
        if prescribed.is_empty() {
            return Ok(Vec::new());
        }
        let law = self.unknowns.law_at(&evaluation.x)?;
        let columns = self.unit_motions();
        let by_boundary = |observed: &ObservedInstant| {
            let u = &evaluation.solution.instants[observed.index].displacement;
            let model = evaluation.model(self);
            let fields = model.linearise(&*law, u)?.by_boundary(columns.instants());
            let cell = observation.force.as_ref().filter(|cell| cell.at(observed.index).is_some());
            let reaction = cell.map(|cell| (cell.width_mm, cell.reaction(model, &*law, u)));
            let force: Vec<f64> = (fields.iter())
                .map(|field| reaction.as_ref().map_or(0.0, |(width, reaction)| width * reaction.change(field)))
                .collect();
            let row = |r: usize, c: usize| match observation.nodes.get(r / 2) {
                Some(&node) => fields[c][node as usize][r % 2],
                None => force[c],
            };
            Ok(Dense::from_fn(observation.n_rows(), fields.len(), row))
        };
        instants.par_iter().map(by_boundary).collect()
    }

    /// The motion of the border by a unit of each of its coefficients, as if they were instants.
    pub(crate) fn unit_motions(&self) -> BoundaryHistory {
        let n = self.border.n_coefficients(self.joint);
        let unit = |k: usize| {
            let mut coefficients = vec![0.0; n];
            coefficients[k] = 1.0;
            self.border.displacements(&coefficients)
        };
        self.joint.measured.boundary((0..n).map(unit).collect()).expect("finite motions of nodes that differ")
    }
}
