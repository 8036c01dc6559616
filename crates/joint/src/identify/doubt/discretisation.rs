//! What the size of the elements does to the parameters: the model once more with elements half as large.

use crate::identify::{Evaluation, LoadCell, ObservedInstant, Precision, Problem, even_texture};
use crate::io::joint::RunMatrix;
use crate::linalg::Dense;
use crate::mechanics::cohesive::Jump;
use crate::mechanics::{BoundaryHistory, Carry, ForwardOptions, Instant, JointMesh, Model};
use std::collections::HashMap;

/// What elements half as large would change.
#[derive(Debug, Clone, PartialEq)]
pub struct Refinement {
    /// Change of each scaled unknown, to first order.
    pub scaled: Vec<f64>,
    /// The jumps that the finer mesh has at the node pairs of the mesh, at the parameters found; by instant of the
    /// boundary.
    pub jumps: Vec<Vec<Jump>>,
    /// Change of the computed force at each instant compared, N, at the parameters found.
    pub forces: Vec<f64>,
    /// Whether intervals and bands hold it.
    pub included: bool,
}

/// What the model gives with every element cut into four, at the parameters found.
pub(crate) struct Refined {
    /// Change of the measured rows of each instant compared, mm. Of a correlation on the same mesh it is what the
    /// correlation would see of the finer field: its least-squares projection onto the elements (whose nodal
    /// values overshoot between them), not the field at the nodes.
    pub change: Vec<Dense>,
    /// The jumps at the node pairs of the mesh, by instant of the boundary.
    pub jumps: Vec<Vec<Jump>>,
    /// Change of the computed force at each instant compared, N.
    pub forces: Vec<f64>,
}

impl Problem<'_> {
    /// The model with every element cut into four, the displacements `boundary` of the border carried along its edges;
    /// `None` where that mesh cannot be made or has no solution.
    pub(crate) fn refine(&self, evaluation: &Evaluation, boundary: &BoundaryHistory) -> Option<Refined> {
        let law = self.unknowns.law_at(&evaluation.x).ok()?;
        let model = evaluation.model(self);
        let (mesh, carry) = model.mesh().refined(2).ok()?;
        let boundary = model.mesh().carry_boundary(&carry, boundary);
        let fine = Model::for_boundary(mesh, model.materials().to_vec(), &boundary, *model.options()).ok()?;
        let ended = || self.watch.ended().is_some();
        let of_law = (&*law, evaluation.x.as_slice());
        let solution = self.forward(&fine, of_law, &boundary, &ForwardOptions::default(), &ended).ok()?;
        let observation = &self.observation;
        let compared = |i: &ObservedInstant| solution.instants[i.index].status.converged();
        if !observation.instants.iter().all(compared) {
            return None;
        }
        let of_table = matches!(self.noise.precision.of_displacements(), Precision::White(_));
        let correlated = !of_table && self.joint.measured.carry.is_none();
        let projection = match correlated {
            true => Some(Projection::new(model.mesh(), fine.mesh(), &carry)?),
            false => None,
        };
        let difference = |observed: &ObservedInstant| {
            let finer = &solution.instants[observed.index].displacement;
            // Nodes keep their numbers in the finer mesh.
            let seen = projection.as_ref().map_or_else(|| finer.clone(), |projection| projection.of(finer));
            let computed = &evaluation.solution.instants[observed.index].displacement;
            let of_force = |cell: &LoadCell| {
                let nodes = carry.nodes_between(&cell.group.nodes);
                cell.force_on(&fine, nodes, &*law, finer) - cell.width_mm * cell.reaction(model, &*law, computed).value
            };
            let force = observation.cell().map_or(0.0, of_force);
            let rows = observation.column(observed.index, |node, c| seen[node][c] - computed[node][c], |_| force);
            (rows, force)
        };
        let place: HashMap<[u32; 2], usize> = (0..).zip(fine.mesh().pairs()).map(|(k, &pair)| (pair, k)).collect();
        let places: Vec<usize> =
            model.mesh().pairs().iter().map(|pair| place.get(pair).copied()).collect::<Option<_>>()?;
        let jumps = |instant: &Instant| match instant.status.converged() {
            true => {
                let all = fine.jumps(&instant.displacement);
                places.iter().map(|&k| all[k]).collect()
            }
            false => Vec::new(),
        };
        let (change, forces) = observation.instants.iter().map(difference).unzip();
        Some(Refined { change, forces, jumps: solution.instants.iter().map(jumps).collect() })
    }
}

/// The least-squares projection of fields on a mesh cut in four onto the mesh itself: `C^T M_f C x = C^T M_f u`, `M_f`
/// the mass matrix of the fine mesh, `C` what carries nodal values to it.
struct Projection<'a> {
    carry: &'a Carry,
    fine: Precision,
    coarse: Precision,
    n: usize,
}

impl<'a> Projection<'a> {
    fn new(mesh: &JointMesh, fine: &JointMesh, carry: &'a Carry) -> Option<Self> {
        let mass = |mesh: &JointMesh| {
            let RunMatrix { corners, matrices, .. } = even_texture(mesh.nodes(), mesh.elements());
            let all: Vec<u32> = (0..mesh.nodes().len() as u32).collect();
            Precision::of_matrix(mesh.nodes(), &corners, &matrices, &all).ok()
        };
        Some(Self { carry, fine: mass(fine)?, coarse: mass(mesh)?, n: mesh.nodes().len() })
    }

    fn of(&self, fine: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let column = |field: &[[f64; 2]]| Dense::from_fn(2 * field.len(), 1, |row, _| field[row / 2][row % 2]);
        let pairs = |column: &Dense| column.column(0).as_chunks::<2>().0.to_vec();
        let weighted = pairs(&self.fine.times(&column(fine)));
        pairs(&self.coarse.inverse_times(&column(&self.carry.gathered(&weighted, self.n))))
    }
}
