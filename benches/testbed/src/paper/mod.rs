//! The numerical experiments of Fedele, Raka, Hild and Roux (J. Mech. Phys. Solids 57, 2009, 1003-1016), done again.
//!
//! The border of the region that a camera sees is moved as in the virtual test, in which a larger joint is pulled
//! apart; the displacements inside are computed with the paper's mesh, white noise is added, and the law is identified
//! from them at the paper's 80 nodes with the paper's weights. Nothing is read from files. Units: mm, MPa, N/mm; y up.

mod error;
mod published;
mod tables;

pub use error::PaperError;
pub use published::{
    BULK, LEVELS_PX, MEASURED_LAW, PRESCRIBED_R, PUBLISHED_STIFFNESS, PublishedRow, REFERENCE_LAW, SWEEP_NOISE_PX,
    TABLE_1, TABLE_2,
};
pub use tables::{
    LevelFits, LevelSummary, SweepSummary, Trends, noisy_fits, summary, sweep_summary, sweeps, trends_of_means,
};

use quadrille::identify::largest_without_rigid_motion;
use quadrille::identify::{
    Border, Discretisation, FitOptions, FitWatch, Intervals, Noise, Observation, ObservedInstant, Precision, Problem,
    Unknowns, WeightKind,
};
use quadrille::mechanics::cohesive::ExtendedXuNeedleman;
use quadrille::mechanics::substrate::{PlaneState, RambergOsgood, SubstrateLaw};
use quadrille::mechanics::{
    BoundaryHistory, Drives, ForwardOptions, Joint, JointMesh, MeasuredMesh, Model, ModelOptions, Solution,
};
use quadrille::units::Vector;
use quadrille::virtual_test::{
    ALUMINIUM, BAND_PX, ELEMENT_PX, PIXEL_MM, REGION, SCALE, VirtualOptions, VirtualTest, zones_px,
};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use std::sync::Arc;

/// Where every fit starts, as factors of the reference parameters.
pub const START: [f64; 3] = [1.5, 0.7, 1.4];
/// Bounds of every parameter: its reference value over and times this.
pub const BOUND: f64 = 6.0;

/// Rows of elements in each strip: with 39 columns 546 elements and 39 cohesive ones. (The paper's counts, 570 of which
/// 39 cohesive, do not close: 531 is no multiple of 39.)
pub const ROWS: usize = 7;

/// The region that is measured, with its border moved by a larger joint and the displacements inside computed.
#[derive(Debug)]
pub struct Experiment {
    joint: Joint,
    truth: Solution,
    selected: Vec<u32>,
}

impl Experiment {
    /// The experiment for an adhesive with `phi_n` (N/mm), `delta_n`, `delta_t` (mm), `r`.
    ///
    /// # Errors
    /// A law under which the joint has no solution.
    pub fn new(law: [f64; 4]) -> Result<Self, PaperError> {
        let test = VirtualTest::new(VirtualOptions { law, ..VirtualOptions::default() })?;
        Self::of(&test)
    }

    /// The same in a test that was already computed.
    ///
    /// # Errors
    /// A law under which the region has no solution.
    pub fn of(test: &VirtualTest) -> Result<Self, PaperError> {
        let (columns, rows) = (REGION[0], ROWS);
        let mesh = JointMesh::rectangular(columns, rows, ELEMENT_PX * PIXEL_MM, BAND_PX * PIXEL_MM)?;
        let boundary = boundary_of(test, &mesh)?;
        let selected = selected_nodes(columns as u32, rows as u32);
        let [phi_n, delta_n, delta_t, r] = test.options().law;
        let joint = joint_of(mesh, boundary, ExtendedXuNeedleman::new(phi_n, delta_n, delta_t, r)?)?;
        let options = ForwardOptions { law_sensitivities: true, ..ForwardOptions::default() };
        let truth = joint.model.forward(&*joint.law, &joint.boundary, &options)?;
        if let Some(at) = truth.instants.iter().position(|instant| !instant.status.converged()) {
            return Err(PaperError::NoSolution { instant: at + 1 });
        }
        Ok(Self { joint, truth, selected })
    }

    /// The joint, with the true law.
    pub fn joint(&self) -> &Joint {
        &self.joint
    }

    /// The displacements that are measured, without noise, and their derivatives by the parameters.
    pub fn truth(&self) -> &Solution {
        &self.truth
    }

    /// The nodes that are compared.
    pub fn selected(&self) -> &[u32] {
        &self.selected
    }

    /// The same region with elements of half the size, under the same displacements of its border.
    ///
    /// # Errors
    /// What the finer mesh refuses.
    pub fn refined(&self) -> Result<(Joint, Solution), PaperError> {
        let (mesh, carry) = self.joint.model.mesh().refined(2)?;
        let boundary = self.joint.model.mesh().carry_boundary(&carry, &self.joint.boundary);
        let law = ExtendedXuNeedleman::new(self.law()[0], self.law()[1], self.law()[2], self.law()[3])?;
        let joint = joint_of(mesh, boundary, law)?;
        let solution = joint.model.forward(&*joint.law, &joint.boundary, &ForwardOptions::default())?;
        Ok((joint, solution))
    }

    /// The true parameters: `phi_n` (N/mm), `delta_n`, `delta_t` (mm), `r`.
    pub fn law(&self) -> [f64; 4] {
        let values = self.joint.law.values();
        std::array::from_fn(|k| values[k])
    }

    /// The identification of `phi_n`, `delta_n`, `delta_t` from the displacements with white noise of standard
    /// deviation `s_px` at the inner nodes, drawn with `seed`; the border is exact. The draw does not depend on
    /// `s_px`.
    ///
    /// # Errors
    /// A level of noise that is none.
    pub fn problem(&self, s_px: f64, seed: u64) -> Result<Problem<'_>, PaperError> {
        if !(s_px.is_finite() && s_px >= 0.0) {
            return Err(PaperError::Noise { s_px });
        }
        let mesh = self.joint.model.mesh();
        let mut is_prescribed = vec![false; mesh.nodes().len()];
        self.joint.boundary.nodes().iter().for_each(|&node| is_prescribed[node as usize] = true);
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let instants = (self.truth.instants.iter().enumerate())
            .map(|(index, instant)| {
                let mut field = instant.displacement.clone();
                for (_, u) in field.iter_mut().enumerate().filter(|(node, _)| !is_prescribed[*node]) {
                    for u in u {
                        let draw: f64 = StandardNormal.sample(&mut random);
                        *u += s_px * PIXEL_MM * draw;
                    }
                }
                let points: Vec<_> = mesh.nodes().iter().copied().zip(field.iter().copied()).collect();
                ObservedInstant {
                    index,
                    displacement: self.selected.iter().flat_map(|&node| field[node as usize]).collect(),
                    largest: largest_without_rigid_motion(&points),
                    factor: 1.0,
                }
            })
            .collect();
        let observation = Observation {
            nodes: self.selected.clone(),
            compared: vec![true; self.selected.len()],
            prescribed: Vec::new(),
            instants,
            pixel_size_mm: None,
            force: None,
            held: None,
            camera: Vec::new(),
        };
        let noise = Noise {
            precision: Precision::White(observation.n_rows()),
            common: 0.0,
            on_boundary: false,
            sigma: (s_px > 0.0).then_some(s_px * PIXEL_MM),
            source: format!("white, {s_px} px"),
            ratio: None,
        };
        let law = self.law();
        let unknown = |k: usize| (k, START[k] * law[k], Some(law[k] / BOUND), Some(law[k] * BOUND));
        let unknowns = Unknowns::new(&*self.joint.law, &[unknown(0), unknown(1), unknown(2)])?;
        let (observation, noise) = (Arc::new(observation), Arc::new(noise));
        let border = Arc::new(Border::free(&self.joint));
        Ok(Problem { joint: &self.joint, observation, border, noise, unknowns, watch: FitWatch::default() })
    }

    /// How it is fitted: the paper's weights, the step tolerance of every other fit.
    pub fn options() -> FitOptions {
        let discretisation = Discretisation::Off;
        // The paper's uncertainties are linear ones.
        let intervals = Intervals::Linear;
        // No constant is named: all are exact, since the data are computed with the same ones.
        FitOptions { weights: WeightKind::Paper, discretisation, intervals, doubt: false, ..FitOptions::default() }
    }
}

fn joint_of(mesh: JointMesh, boundary: BoundaryHistory, law: ExtendedXuNeedleman) -> Result<Joint, PaperError> {
    let aluminium: Arc<dyn SubstrateLaw> = Arc::new(RambergOsgood::new(ALUMINIUM, PlaneState::PlaneStress)?);
    let materials = mesh.groups().iter().map(|_| Arc::clone(&aluminium)).collect();
    let measured = MeasuredMesh {
        mesh: mesh.clone(),
        prescribed: boundary.nodes().to_vec(),
        carry: None,
        drives: Drives::default(),
    };
    let model = Model::new(mesh, materials, boundary.nodes(), ModelOptions::default())?;
    let (groups, removed, remarks) = (Vec::new(), Vec::new(), Vec::new());
    Ok(Joint { model, law: Box::new(law), boundary, measured, groups, removed, remarks })
}

/// What the larger joint of `test` does to the outer nodes of `mesh`, whose left edge is at x = 0 and middle at y = 0.
fn boundary_of(test: &VirtualTest, mesh: &JointMesh) -> Result<BoundaryHistory, PaperError> {
    let [[x0, _, _, upper_face], [_, lower_face, ..]] = zones_px();
    let origin = SCALE.to_mm(Vector::new([x0, 0.5 * (upper_face + lower_face)])).components();
    let large = test.model().mesh().nodes();
    let nodes = mesh.outer_nodes();
    let mut of = Vec::with_capacity(nodes.len());
    for &node in &nodes {
        let [x, y] = mesh.nodes()[node as usize];
        let distance = |at: &[f64; 2]| (at[0] - origin[0] - x).abs().max((at[1] - origin[1] - y).abs());
        // The nodes of the region are among those of the larger joint, whose elements are half as large.
        let found = large.iter().position(|at| distance(at) < 1e-3 * ELEMENT_PX * PIXEL_MM);
        of.push(found.ok_or(PaperError::NotInJoint { node, x, y })?);
    }
    let instants = test.solution().instants.iter();
    let instants = instants.map(|instant| of.iter().map(|&node| instant.displacement[node]).collect()).collect();
    Ok(BoundaryHistory::new(nodes, instants)?)
}

/// The 80 nodes of the objective: the inner nodes of both faces of the adhesive, and of the row behind each of them
/// those at a third and at two thirds of the length.
fn selected_nodes(columns: u32, rows: u32) -> Vec<u32> {
    let per_row = columns + 1;
    let lower = rows * per_row;
    let upper = lower + per_row;
    let inner = |row: u32| (row + 1..row + columns).collect::<Vec<_>>();
    let behind = |row: u32| vec![row + columns / 3, row + 2 * columns / 3];
    let mut nodes = [inner(lower), behind(lower - per_row), inner(upper), behind(upper + per_row)].concat();
    nodes.sort_unstable();
    nodes
}
