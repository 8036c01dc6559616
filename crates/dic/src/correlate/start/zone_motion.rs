//! A prediction that is far off is moved first, each zone as a whole: rigidly, then with its common strain.

use crate::backend::{Backend, GreyTransfer};
use crate::correlate::{Correlator, Level, Result, affine, coarser, score};
use crate::field::RigidMotion;
use crate::mesh::Mesh;
use crate::units::Px;
use nalgebra::{Cholesky, Const, SMatrix, SVector};
use std::ops::Range;

/// Steps at most,
const STEPS: usize = 12;
/// and none after one that moves no node of a zone by this much, px of the level.
const SMALL_PX: f64 = 0.02;

struct Best {
    score: f64,
    /// Of its nodes.
    displacement: Vec<[f64; 2]>,
}

impl<B: Backend> Correlator<B> {
    /// `displacement` of the nodes of the finest level after the motion of each zone with which it matches best on the
    /// coarsest: Gauss-Newton steps with three unknowns per zone, translation and rotation, and then with six,
    /// which are those of an affine motion. A zone as a whole is found from farther off than its nodes are, of
    /// which those at a corner may lie on other speckles when it has turned or stretched.
    pub(crate) fn move_by_zone(
        &self,
        frame: &mut B::Frame,
        displacement: &[[f64; 2]],
        transfer: &[GreyTransfer],
    ) -> Result<Vec<[f64; 2]>> {
        let start = self.carry_to_coarsest(displacement);
        let level = &self.levels[self.levels.len() - 1];
        let system = ZoneSystem::new(level);
        let zones = 0..level.mesh.zones().len();
        let mut best: Vec<Option<Best>> = zones.clone().map(|_| None).collect();
        let (mut now, mut transfer) = (start.clone(), transfer.to_vec());
        for step in [ZoneSystem::rigid_step, ZoneSystem::affine_step] {
            for _ in 0..STEPS {
                let mut field = self.backend.start(&level.prepared, frame, &now, &transfer)?;
                let observed = self.backend.observe(&level.prepared, frame, &mut field)?;
                let rhs = self.backend.right_hand_side(&level.prepared, frame, &field)?;
                let mut is_small = true;
                for (zone, (sums, of_zone)) in observed.into_iter().enumerate() {
                    let nodes = level.mesh.zone_nodes(zone);
                    let score = score(&sums);
                    if best[zone].as_ref().is_none_or(|best| score > best.score) {
                        best[zone] = Some(Best { score, displacement: now[nodes.clone()].to_vec() });
                        transfer[zone] = of_zone;
                    }
                    let Some(step) = step(&system, zone, &level.mesh, &now, &rhs) else { continue };
                    for (now, moved) in now[nodes].iter_mut().zip(step) {
                        is_small &= moved[0].hypot(moved[1]) < SMALL_PX;
                        (0..2).for_each(|c| now[c] += moved[c]);
                    }
                }
                if is_small {
                    break;
                }
            }
            for (zone, best) in best.iter().enumerate() {
                let nodes = level.mesh.zone_nodes(zone);
                best.iter().for_each(|best| now[nodes.clone()].copy_from_slice(&best.displacement));
            }
        }
        let mut moved = displacement.to_vec();
        let halvings = self.levels.len() - 1;
        let on_coarsest = |x: f64| (0..halvings).fold(x, |x, _| coarser(x));
        for zone in zones {
            // Where a node was, and how it has gone on from there.
            let step = |node: usize| {
                let (x, u) = (level.mesh.nodes()[node], start[node]);
                ([0, 1].map(|c| x[c] + u[c]), [0, 1].map(|c| now[node][c] - u[c]))
            };
            let motion = affine(&level.mesh.zone_nodes(zone).map(step).collect::<Vec<_>>());
            for node in self.mesh().zone_nodes(zone) {
                let x = self.mesh().nodes()[node];
                let more = motion([0, 1].map(|c| on_coarsest(x[c] + moved[node][c])));
                (0..2).for_each(|c| moved[node][c] += more[c] * 2f64.powi(halvings as i32));
            }
        }
        Ok(moved)
    }
}

/// A normal matrix for some motions of a zone; none where its texture says nothing.
type Factor<const N: usize> = Option<Cholesky<f64, Const<N>>>;

/// The motions of a zone as a whole, about the centre of its nodes.
const N_MOTIONS: usize = 6;

/// The three of a rigid motion among them: the translations, and the rotation by its gradients.
fn rigid() -> SMatrix<f64, 3, N_MOTIONS> {
    let mut rigid = SMatrix::zeros();
    for (motion, at, share) in [(0, 0, 1.0), (1, 1, 1.0), (2, 3, -1.0), (2, 4, 1.0)] {
        rigid[(motion, at)] = share;
    }
    rigid
}

/// At `d` from the centre, a translation along each axis and the gradients `du_x/dx`, `du_x/dy`, `du_y/dx`, `du_y/dy`.
fn units([x, y]: [f64; 2]) -> [[f64; 2]; N_MOTIONS] {
    [[1.0, 0.0], [0.0, 1.0], [x, 0.0], [y, 0.0], [0.0, x], [0.0, y]]
}

/// The normal matrices of each zone for its motions as a whole.
struct ZoneSystem {
    /// Of all nodes, each with its zone; at rest those that are not measured.
    motions: [Vec<[f64; 2]>; N_MOTIONS],
    centres: Vec<[f64; 2]>,
    rigid: Vec<Factor<3>>,
    affine: Vec<Factor<N_MOTIONS>>,
}

impl ZoneSystem {
    /// Zones share no node: one product of the matrix of `level` with each motion serves all of them.
    fn new<B: Backend>(level: &Level<B>) -> Self {
        let mesh = &level.mesh;
        let mut motions = [(); N_MOTIONS].map(|()| vec![[0.0; 2]; mesh.n_nodes()]);
        let mut centres = Vec::new();
        for zone in 0..mesh.zones().len() {
            let nodes = mesh.zone_nodes(zone);
            let at_rest = RigidMotion::fit(nodes.clone().map(|node| (mesh.nodes()[node], [0.0; 2])));
            let centre = at_rest.map_or([0.0; 2], |motion| motion.centre);
            centres.push(centre);
            for node in nodes.filter(|&node| level.keep[node]) {
                let x = mesh.nodes()[node];
                let units = units([0, 1].map(|c| x[c] - centre[c]));
                motions.iter_mut().zip(units).for_each(|(motion, unit)| motion[node] = unit);
            }
        }
        let forces = motions.each_ref().map(|motion| level.solver.data().multiply(motion));
        let matrix = |zone: usize| {
            SMatrix::<f64, N_MOTIONS, N_MOTIONS>::from_fn(|i, j| dot(&motions[i], &forces[j], mesh.zone_nodes(zone)))
        };
        let matrices: Vec<_> = (0..mesh.zones().len()).map(matrix).collect();
        let rigid = matrices.iter().map(|matrix| (rigid() * matrix * rigid().transpose()).cholesky()).collect();
        let affine = matrices.into_iter().map(SMatrix::cholesky).collect();
        Self { motions, centres, rigid, affine }
    }

    /// The right-hand sides of a zone in its motions.
    fn forces(&self, rhs: &[[f64; 2]], nodes: Range<usize>) -> SVector<f64, N_MOTIONS> {
        SVector::from_fn(|i, _| dot(&self.motions[i], rhs, nodes.clone()))
    }

    /// The rigid motion that the right-hand sides ask for at `displacement`, of the nodes of a zone.
    fn rigid_step(
        &self,
        zone: usize,
        mesh: &Mesh<Px>,
        displacement: &[[f64; 2]],
        rhs: &[[f64; 2]],
    ) -> Option<Vec<[f64; 2]>> {
        let nodes = mesh.zone_nodes(zone);
        let forces = self.forces(rhs, nodes.clone());
        let step = self.rigid[zone].as_ref()?.solve(&(rigid() * forces));
        let places = || nodes.clone().map(|node| (mesh.nodes()[node], displacement[node]));
        let RigidMotion { centre, translation, rotation_rad } = RigidMotion::fit(places())?;
        // The gradients of the reference are turned with the zone.
        let (sin, cos) = rotation_rad.sin_cos();
        let motion = RigidMotion {
            centre: [centre[0] + translation[0], centre[1] + translation[1]],
            translation: [cos * step[0] - sin * step[1], sin * step[0] + cos * step[1]],
            rotation_rad: step[2],
        };
        let at = motion.field();
        let moved = places().map(|(x, u)| at([x[0] + u[0], x[1] + u[1]])).collect();
        step.iter().all(|v| v.is_finite()).then_some(moved)
    }

    fn affine_step(
        &self,
        zone: usize,
        mesh: &Mesh<Px>,
        displacement: &[[f64; 2]],
        rhs: &[[f64; 2]],
    ) -> Option<Vec<[f64; 2]>> {
        let nodes = mesh.zone_nodes(zone);
        let step = self.affine[zone].as_ref()?.solve(&self.forces(rhs, nodes.clone()));
        let places = nodes.clone().map(|node| (mesh.nodes()[node], displacement[node]));
        let (sin, cos) = RigidMotion::fit(places)?.rotation_rad.sin_cos();
        let centre = self.centres[zone];
        let moved = nodes.map(|node| {
            let x = mesh.nodes()[node];
            let units = units([0, 1].map(|c| x[c] - centre[c]));
            let [a, b] = [0, 1].map(|c| units.iter().zip(&step).map(|(unit, by)| by * unit[c]).sum::<f64>());
            [cos * a - sin * b, sin * a + cos * b]
        });
        step.iter().all(|v| v.is_finite()).then(|| moved.collect())
    }
}

fn dot(a: &[[f64; 2]], b: &[[f64; 2]], nodes: Range<usize>) -> f64 {
    nodes.map(|k| a[k][0] * b[k][0] + a[k][1] * b[k][1]).sum()
}
