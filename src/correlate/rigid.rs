//! A prediction that is far off is moved rigidly first, each zone by itself.

use super::correlator::Correlator;
use super::error::CorrelationError;
use super::find::score;
use super::level::{Level, on_finer_level};
use crate::backend::{Backend, GreyTransfer};
use crate::field::RigidMotion;
use crate::mesh::Mesh;
use crate::units::Px;
use nalgebra::{Cholesky, Matrix3, U3, Vector3};
use std::ops::Range;

/// Steps at most,
const STEPS: usize = 12;
/// and none after one that moves no node of a zone by this much, px of the level.
const SMALL_PX: f64 = 0.1;

/// Where a zone has matched best so far.
struct Best {
    score: f64,
    /// Of its nodes.
    displacement: Vec<[f64; 2]>,
}

impl<B: Backend> Correlator<B> {
    /// `displacement` of the nodes of the finest level after the rigid motion of each zone with which it matches best on the coarsest:
    /// Gauss-Newton steps with three unknowns per zone, translation and rotation. A zone as a whole is found from farther off than its
    /// nodes are, of which those at a corner may lie on other speckles when it has turned.
    pub(super) fn moved_rigidly(
        &self,
        frame: &mut B::Frame,
        displacement: &[[f64; 2]],
        transfer: &[GreyTransfer],
    ) -> Result<Vec<[f64; 2]>, CorrelationError> {
        let start = self.on_coarsest(displacement);
        let level = &self.levels[self.levels.len() - 1];
        let system = RigidSystem::new(level);
        let zones = 0..level.mesh.zones().len();
        let mut best: Vec<Option<Best>> = zones.clone().map(|_| None).collect();
        let (mut now, mut transfer) = (start.clone(), transfer.to_vec());
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
                let Some(step) = system.step(zone, &level.mesh, &now, &rhs) else { continue };
                for node in nodes {
                    let x = level.mesh.nodes()[node];
                    let moved = step.displacement([x[0] + now[node][0], x[1] + now[node][1]]);
                    is_small &= moved[0].hypot(moved[1]) < SMALL_PX;
                    (0..2).for_each(|c| now[node][c] += moved[c]);
                }
            }
            if is_small {
                break;
            }
        }
        let mut moved = displacement.to_vec();
        for zone in zones {
            let Some(best) = &best[zone] else { continue };
            let nodes = level.mesh.zone_nodes(zone);
            let places = level.mesh.nodes()[nodes.clone()].iter().zip(&start[nodes]);
            let of_node = |((x, from), to): ((&[f64; 2], &[f64; 2]), &[f64; 2])| {
                ([0, 1].map(|c| x[c] + from[c]), [0, 1].map(|c| to[c] - from[c]))
            };
            let Some(motion) = RigidMotion::fit(places.zip(&best.displacement).map(of_node)) else { continue };
            let motion = (1..self.levels.len()).fold(motion, |motion, _| on_finer_level(motion));
            for node in self.mesh().zone_nodes(zone) {
                let x = self.mesh().nodes()[node];
                let more = motion.displacement([x[0] + moved[node][0], x[1] + moved[node][1]]);
                (0..2).for_each(|c| moved[node][c] += more[c]);
            }
        }
        Ok(moved)
    }
}

/// The three unknowns of each zone: a unit of translation along each axis, and of rotation about the centre of its nodes.
struct RigidSystem {
    /// Of all nodes, each with its zone; at rest those that are not measured.
    motions: [Vec<[f64; 2]>; 3],
    /// The normal matrix of each zone for its three motions; none where its texture says nothing.
    factors: Vec<Option<Cholesky<f64, U3>>>,
}

impl RigidSystem {
    /// Zones share no node: one product of the matrix of `level` with each motion serves all of them.
    fn new<B: Backend>(level: &Level<B>) -> Self {
        let mesh = &level.mesh;
        let mut motions = [(); 3].map(|()| vec![[0.0; 2]; mesh.n_nodes()]);
        for zone in 0..mesh.zones().len() {
            let nodes = mesh.zone_nodes(zone);
            let Some(RigidMotion { centre, .. }) = RigidMotion::fit(nodes.clone().map(|k| (mesh.nodes()[k], [0.0; 2])))
            else {
                continue;
            };
            for node in nodes.filter(|&node| level.keep[node]) {
                let x = mesh.nodes()[node];
                let unit = [[1.0, 0.0], [0.0, 1.0], [centre[1] - x[1], x[0] - centre[0]]];
                motions.iter_mut().zip(unit).for_each(|(motion, unit)| motion[node] = unit);
            }
        }
        let forces = motions.each_ref().map(|motion| level.solver.data().multiply(motion));
        let factors = (0..mesh.zones().len())
            .map(|zone| Matrix3::from_fn(|i, j| dot(&motions[i], &forces[j], mesh.zone_nodes(zone))).cholesky())
            .collect();
        Self { motions, factors }
    }

    /// The rigid motion of a deformed zone of `mesh` that the right-hand sides ask for at `displacement`.
    fn step(&self, zone: usize, mesh: &Mesh<Px>, displacement: &[[f64; 2]], rhs: &[[f64; 2]]) -> Option<RigidMotion> {
        let nodes = mesh.zone_nodes(zone);
        let factor = self.factors[zone].as_ref()?;
        let step = factor.solve(&Vector3::from_fn(|i, _| dot(&self.motions[i], rhs, nodes.clone())));
        let RigidMotion { centre, translation, rotation_rad } =
            RigidMotion::fit(nodes.map(|node| (mesh.nodes()[node], displacement[node])))?;
        // The gradients of the reference are turned with the zone.
        let (sin, cos) = rotation_rad.sin_cos();
        let motion = RigidMotion {
            centre: [centre[0] + translation[0], centre[1] + translation[1]],
            translation: [cos * step[0] - sin * step[1], sin * step[0] + cos * step[1]],
            rotation_rad: step[2],
        };
        step.iter().all(|v| v.is_finite()).then_some(motion)
    }
}

/// The product of two vectors over some nodes.
fn dot(a: &[[f64; 2]], b: &[[f64; 2]], nodes: Range<usize>) -> f64 {
    nodes.map(|k| a[k][0] * b[k][0] + a[k][1] * b[k][1]).sum()
}
