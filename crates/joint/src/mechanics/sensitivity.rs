//! Direct differentiation: derivatives of the converged displacements, from the factor of the tangent
//! (THEORY 5).

use super::cohesive::CohesiveLaw;
use super::{ForwardOptions, Model, ModelError, Sensitivity, Stiffness, Work};
use crate::linalg::SparseMatrix;

/// A nodal field: one vector per node, mm per unit of what it is derived by.
pub type NodalField = Vec<[f64; 2]>;

/// The joint linearised about a converged field: `K = dR_f/dU_f`, factorised.
#[derive(Debug)]
pub struct Linearised<'a> {
    model: &'a Model,
    law: &'a dyn CohesiveLaw,
    u: NodalField,
    work: Work,
}

impl Model {
    /// Linearises about the displacements `u` (one per node, mm), which should be a solution under `law`.
    ///
    /// # Errors
    /// A field of another size, a tangent without inverse.
    pub fn linearise<'a>(&'a self, law: &'a dyn CohesiveLaw, u: &[[f64; 2]]) -> Result<Linearised<'a>, ModelError> {
        self.check_field(u)?;
        let mut work = self.work();
        self.assemble(law, u, Stiffness::Tangent, &mut work);
        let singular = |error: crate::linalg::Singular| ModelError::Singular { node: self.node_of(error.unknown) };
        work.factor.refactor(&work.matrix).map_err(singular)?;
        Ok(Linearised { model: self, law, u: u.to_vec(), work })
    }
}

impl Linearised<'_> {
    /// The tangent of the unknowns, N/mm per mm; places by [`Model::unknown`].
    pub fn tangent(&self) -> &SparseMatrix {
        &self.work.matrix
    }

    /// `-dR/dX` for each parameter of the cohesive law, at the unknowns, one after another.
    pub fn pseudo_loads(&self) -> Vec<Vec<f64>> {
        let n = self.model.n_unknowns().max(1);
        pseudo_loads(self.model, self.law, &self.u, &self.work, true, 0).chunks_exact(n).map(<[f64]>::to_vec).collect()
    }

    /// `dU/dX` for each parameter of the cohesive law: zero at prescribed nodes.
    pub fn by_law(&self) -> Vec<NodalField> {
        solve(self.model, &self.work, &pseudo_loads(self.model, self.law, &self.u, &self.work, true, 0))
    }

    /// `dU/dp` for each parameter of the material of element group `group`.
    ///
    /// # Panics
    /// When there is no such group.
    pub fn by_material(&self, group: usize) -> Vec<NodalField> {
        let forces = self.model.force_by_material(group, &self.u);
        solve(self.model, &self.work, &loads(self.model, &forces, &self.work))
    }

    /// `dU/dh` where the adhesive of each interface element is thicker by its share `along` of `h`, as of one whose
    /// strains, not separations, make its tractions.
    pub fn by_thickness(&self, along: &[f64]) -> NodalField {
        let force = self.model.force_by_thickness(self.law, &self.u, along);
        solve(self.model, &self.work, &loads(self.model, &[force], &self.work)).swap_remove(0)
    }

    /// `-K_ff^-1 F_f` for each of `forces` (internal nodal forces, N/mm): how the free nodes follow when something else
    /// than the displacements adds the force, to first order; zero at prescribed nodes.
    ///
    /// # Panics
    /// When a field has not one vector per node.
    pub fn by_force(&self, forces: &[NodalField]) -> Vec<NodalField> {
        assert!(forces.iter().all(|force| force.len() == self.u.len()), "one force per node");
        solve(self.model, &self.work, &loads(self.model, forces, &self.work))
    }

    /// `dU/dU_D V` for each column of `columns`: how the whole field follows when the prescribed nodes move by
    /// the column (one vector per prescribed node, in the model's order). At the unknowns that is
    /// `-K_ff^-1 K_fD V`, at prescribed nodes `V` itself; of a node that is held in one component the other is an
    /// unknown, and what the column says of it is left aside. Blocks and forces stay.
    ///
    /// # Panics
    /// When a column has not one vector per prescribed node.
    pub fn by_boundary(&self, columns: &[Vec<[f64; 2]>]) -> Vec<NodalField> {
        let n = self.model.n_unknowns();
        let mut fields: Vec<NodalField> = Vec::with_capacity(columns.len());
        let mut rhs = vec![0.0; n * columns.len()];
        for (k, column) in columns.iter().enumerate() {
            assert_eq!(column.len(), self.model.prescribed().len(), "one vector per prescribed node");
            let mut field = vec![[0.0; 2]; self.u.len()];
            let supports = self.model.supports();
            for ((&node, held), &moved) in supports.nodes.iter().zip(&supports.held).zip(column) {
                field[node as usize] = [0, 1].map(|c| if held[c] { moved[c] } else { 0.0 });
            }
            self.model.pull_of_border(&field, &self.work, &mut rhs[k * n..(k + 1) * n]);
            fields.push(field);
        }
        self.work.factor.solve(&mut rhs);
        for (field, values) in fields.iter_mut().zip(rhs.chunks_exact(n.max(1))) {
            self.model.add_to_derivative(values, &self.work, field);
        }
        fields
    }
}

/// What the sensitivities that `options` ask for are by.
pub(super) fn parameters(model: &Model, law: &dyn CohesiveLaw, options: &ForwardOptions) -> Vec<Sensitivity> {
    let mut list = Vec::new();
    if options.law_sensitivities {
        list.extend(law.parameters().iter().map(|&parameter| Sensitivity { parameter, group: None }));
    }
    if options.substrate_sensitivities {
        for (group, material) in model.materials().iter().enumerate() {
            let of_group = |&parameter| Sensitivity { parameter, group: Some(group) };
            list.extend(material.parameters().iter().map(of_group));
        }
    }
    list
}

/// The sensitivities that `options` ask for at the solution `u`, with the factor of the last assembly.
pub(super) fn at(
    model: &Model,
    law: &dyn CohesiveLaw,
    u: &[[f64; 2]],
    work: &Work,
    options: &ForwardOptions,
) -> Vec<NodalField> {
    if !(options.law_sensitivities || options.substrate_sensitivities) {
        return Vec::new();
    }
    let groups = if options.substrate_sensitivities { model.mesh().groups().len() } else { 0 };
    solve(model, work, &pseudo_loads(model, law, u, work, options.law_sensitivities, groups))
}

/// `-dF_int/dX` at the unknowns, parameter after parameter: those of the law if asked for, then those of the
/// first `groups` materials.
fn pseudo_loads(
    model: &Model,
    law: &dyn CohesiveLaw,
    u: &[[f64; 2]],
    work: &Work,
    of_law: bool,
    groups: usize,
) -> Vec<f64> {
    let mut rhs = if of_law { loads(model, &model.force_by_law(law, u), work) } else { Vec::new() };
    for group in 0..groups {
        rhs.extend(loads(model, &model.force_by_material(group, u), work));
    }
    rhs
}

fn loads(model: &Model, forces: &[NodalField], work: &Work) -> Vec<f64> {
    forces.iter().flat_map(|force| model.of_unknowns(force, work)).map(|force| -force).collect()
}

/// Solves for right-hand sides that follow one another, and gives nodal fields.
fn solve(model: &Model, work: &Work, rhs: &[f64]) -> Vec<NodalField> {
    let n = model.n_unknowns();
    if n == 0 {
        return Vec::new();
    }
    let mut rhs = rhs.to_vec();
    work.factor.solve(&mut rhs);
    let field = |values: &[f64]| {
        let mut field = vec![[0.0; 2]; model.mesh().nodes().len()];
        model.add_to_derivative(values, work, &mut field);
        field
    };
    rhs.chunks_exact(n).map(field).collect()
}
