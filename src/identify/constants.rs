//! Model constants that are not known exactly: what their uncertainty adds to that of the parameters (THEORY 7).

use super::objective::{Evaluation, Problem};
use super::statistics::Statistics;
use crate::linalg::Dense;
use crate::mechanics::{BoundaryHistory, ForwardOptions, JointMesh, JointParts, Model, ModelError};

/// A constant with its standard uncertainty.
#[derive(Debug, Clone, PartialEq)]
pub struct Constant {
    /// Its name in files.
    pub name: String,
    /// Which.
    pub kind: ConstantKind,
    /// Its standard uncertainty, in its own unit.
    pub std: f64,
}

/// A kind of constant.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ConstantKind {
    /// Parameter `index` of the material of these groups of elements.
    Material {
        /// The groups; they share the value.
        groups: Vec<usize>,
        /// Place among the parameters of their material.
        index: usize,
    },
    /// Thickness of the adhesive, mm.
    Thickness,
    /// Pixel size, relative.
    PixelSize,
}

/// What a constant does to the scaled unknowns when it is off by its standard uncertainty.
#[derive(Debug, Clone, PartialEq)]
pub struct ConstantEffect {
    /// The constant.
    pub constant: Constant,
    /// Change of each scaled unknown.
    pub scaled: Vec<f64>,
}

impl Problem<'_> {
    /// The effect of each constant on the unknowns, to first order.
    ///
    /// # Errors
    /// Those of the forward model.
    pub(super) fn constant_effects(
        &self,
        evaluation: &Evaluation,
        statistics: &Statistics,
        constants: &[Constant],
        boundary: &BoundaryHistory,
    ) -> Result<Vec<ConstantEffect>, ModelError> {
        let Ok(law) = self.unknowns.law_at(&evaluation.x) else { return Ok(Vec::new()) };
        let of_material = constants.iter().any(|c| matches!(c.kind, ConstantKind::Material { .. }));
        let solution = match of_material {
            true => {
                let options = ForwardOptions { substrate_sensitivities: true, ..ForwardOptions::default() };
                Some(self.joint.model.forward(&*law, boundary, &options)?)
            }
            false => None,
        };
        let n_parameters: Vec<usize> = self.joint.model.materials().iter().map(|law| law.parameters().len()).collect();
        let mut effects = Vec::with_capacity(constants.len());
        for constant in constants {
            let scaled = match &constant.kind {
                ConstantKind::PixelSize => {
                    // All lengths grow alike and stresses stay: a parameter follows by the power of mm in its unit.
                    let slopes = self.unknowns.slopes(&evaluation.x);
                    let of = |(k, unknown): (usize, &super::unknowns::Unknown)| {
                        power_of_length(unknown.parameter.unit) * evaluation.x[k] / slopes[k]
                    };
                    self.unknowns.list().iter().enumerate().map(of).collect()
                }
                ConstantKind::Material { groups, index } => {
                    let solution = solution.as_ref().expect("a run with the derivatives by the materials");
                    let places: Vec<usize> =
                        groups.iter().map(|&group| n_parameters[..group].iter().sum::<usize>() + index).collect();
                    self.shift(statistics, |instant, node, c| {
                        let fields = &solution.instants[instant].sensitivities;
                        places.iter().map(|&place| fields[place][node][c]).sum()
                    })
                }
                ConstantKind::Thickness => {
                    let h = 1e-3 * self.joint.model.mesh().gap().max(constant.std);
                    let moved = [h, -h].map(|h| -> Result<_, ModelError> {
                        let model = &self.joint.model;
                        let Some(mesh) = thicker(model.mesh(), h) else { return Ok(None) };
                        let model = Model::new(mesh, model.materials().to_vec(), model.prescribed(), *model.options())?;
                        model.forward(&*law, boundary, &ForwardOptions::default()).map(Some)
                    });
                    let [Some(more), Some(less)] = [moved[0].clone()?, moved[1].clone()?] else { continue };
                    if !(more.converged() && less.converged()) {
                        continue;
                    }
                    self.shift(statistics, |instant, node, c| {
                        let at =
                            |solution: &crate::mechanics::Solution| solution.instants[instant].displacement[node][c];
                        (at(&more) - at(&less)) / (2.0 * h)
                    })
                }
            };
            let scaled = scaled.into_iter().map(|z: f64| z * constant.std).collect();
            effects.push(ConstantEffect { constant: constant.clone(), scaled });
        }
        Ok(effects)
    }

    /// `-A sum_i v_i^T U_p`: how the estimate moves with a constant that moves the computed displacements by `U_p`.
    pub(super) fn shift(&self, statistics: &Statistics, by_constant: impl Fn(usize, usize, usize) -> f64) -> Vec<f64> {
        let observation = &self.observation;
        let of = |observed: &super::observation::ObservedInstant| {
            Dense::from_fn(observation.n_rows(), 1, |row, _| {
                by_constant(observed.index, observation.nodes[row / 2] as usize, row % 2)
            })
        };
        let moved: Vec<Dense> = observation.instants.iter().map(of).collect();
        statistics.shift(&moved)
    }
}

/// Power of mm in the unit of a parameter.
fn power_of_length(unit: &str) -> f64 {
    match unit {
        "mm" | "N/mm" => 1.0,
        "MPa/mm" => -1.0,
        _ => 0.0,
    }
}

/// The mesh with the faces of the adhesive `by` further apart: the upper strip is moved along the mean normal.
fn thicker(mesh: &JointMesh, by: f64) -> Option<JointMesh> {
    let mut normal = [0.0; 2];
    for &[l1, l2, u1, u2] in mesh.interfaces() {
        let at = |node: u32| mesh.nodes()[node as usize];
        let t = [0, 1].map(|c| at(l2)[c] + at(u2)[c] - at(l1)[c] - at(u1)[c]);
        normal = [normal[0] - t[1], normal[1] + t[0]];
    }
    let length = normal[0].hypot(normal[1]);
    let upper = mesh.strip()[mesh.pairs()[0][1] as usize];
    let moved = |(&[x, y], &strip): (&[f64; 2], &u32)| match strip == upper {
        true => [x + by * normal[0] / length, y + by * normal[1] / length],
        false => [x, y],
    };
    JointMesh::new(JointParts {
        nodes: mesh.nodes().iter().zip(mesh.strip()).map(moved).collect(),
        elements: mesh.elements().to_vec(),
        interfaces: mesh.interfaces().to_vec(),
        groups: mesh.groups().to_vec(),
        element_group: mesh.element_group().to_vec(),
        ..JointParts::default()
    })
    .ok()
}
