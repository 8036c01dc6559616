//! A prediction that is far off is moved rigidly first, each zone by itself.

use super::correlator::Correlator;
use super::error::CorrelationError;
use super::find::score;
use super::level::{Level, on_finer_level};
use crate::backend::{Backend, GreyTransfer};
use crate::field::RigidMotion;
use nalgebra::{Matrix3, Vector3};

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
                let Some(step) = level.rigid_step(zone, &now, &rhs) else { continue };
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

impl<B: Backend> Level<B> {
    /// The rigid motion of the deformed zone that its right-hand sides ask for at `displacement`; none where its texture says nothing.
    fn rigid_step(&self, zone: usize, displacement: &[[f64; 2]], rhs: &[[f64; 2]]) -> Option<RigidMotion> {
        let nodes = self.mesh.zone_nodes(zone);
        let points = || nodes.clone().map(|node| (self.mesh.nodes()[node], displacement[node]));
        let RigidMotion { centre, translation, rotation_rad } = RigidMotion::fit(points())?;
        let motions: [Vec<[f64; 2]>; 3] = std::array::from_fn(|k| {
            let mut motion = vec![[0.0; 2]; self.mesh.n_nodes()];
            for node in nodes.clone().filter(|&node| self.keep[node]) {
                let x = self.mesh.nodes()[node];
                motion[node] = [[1.0, 0.0], [0.0, 1.0], [centre[1] - x[1], x[0] - centre[0]]][k];
            }
            motion
        });
        let forces = motions.each_ref().map(|motion| self.solver.data().multiply(motion));
        let dot = |a: &[[f64; 2]], b: &[[f64; 2]]| nodes.clone().map(|k| a[k][0] * b[k][0] + a[k][1] * b[k][1]).sum();
        let matrix: Matrix3<f64> = Matrix3::from_fn(|i, j| dot(&motions[i], &forces[j]));
        let wanted = Vector3::from_fn(|i, _| dot(&motions[i], rhs));
        let step = matrix.cholesky()?.solve(&wanted);
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
