//! Rigid motion taken off a field.

use crate::field::{Measurement, RigidMotion, UnknownChoice};
use crate::units::Length;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::str::FromStr;

/// Which rigid motion is taken off.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum RemoveRigid {
    /// One motion, that of all measured nodes together: what is left keeps the jumps between zones.
    All,
    /// That of each zone by itself: brings every zone into register with its place in the reference.
    Zone,
}

impl RemoveRigid {
    /// Name used in options and files.
    pub fn name(self) -> &'static str {
        match self {
            RemoveRigid::All => "all",
            RemoveRigid::Zone => "zone",
        }
    }
}

impl FromStr for RemoveRigid {
    type Err = UnknownChoice;

    fn from_str(word: &str) -> Result<Self, UnknownChoice> {
        UnknownChoice::or_one_of(&[Self::All, Self::Zone], Self::name, word, ["remove-rigid", "all or zone"])
    }
}

/// A rigid motion that was taken off, and its sizes, in the unit of the field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigidRemoved {
    /// Number of the zone; `None` for all together.
    pub zone: Option<usize>,
    /// The motion.
    pub motion: RigidMotion,
    /// Largest displacement of a measured node under the motion alone.
    pub largest: f64,
    /// Root mean square length of the displacements that are left.
    pub left_rms: f64,
}

/// The field without its rigid motion, and what was taken off (nothing for a zone without measured node).
///
/// With `x = X + u` the place of a node in the deformed image, `C` the centre and `t` the translation of the motion,
/// what is left is `u' = C + R^T (x - C - t) - X`: the exact rotation is undone, not its linear part, so that a body
/// that only moved is left with nothing and strains of type Green-Lagrange and Hencky do not change. Standard
/// uncertainties turn with the axes; that of the motion itself, a mean over all nodes, is left out.
///
/// ```
/// # use quadrille_base as quadrille;
/// # use quadrille::{field::{Measurement, RemoveRigid, Status, remove_rigid}, mesh::{Mesh, Roi, Zone}};
/// # let roi = Roi { x0: 0.0, y0: 0.0, x1: 32.0, y1: 32.0 };
/// # let mesh = Mesh::on_zones(&[Zone::rectangle("all", roi)], 16, 64, 64).unwrap();
/// # let (sin, cos) = 0.1f64.sin_cos();
/// # let displacement: Vec<_> =
/// #     mesh.nodes().iter().map(|[x, y]| [(cos - 1.0) * x - sin * y, sin * x + (cos - 1.0) * y]).collect();
/// # let turned = Measurement { status: Status::Converged, sigma: vec![[0.01; 2]; 9], measured: vec![true; 9],
/// #     element_residual: vec![1.0; 4], model_error: None, marks: None, points: None, mesh: mesh.into(), displacement };
/// let (left, removed) = remove_rigid(&turned, RemoveRigid::All); // a rotation by 0.1
/// assert!(left.displacement.iter().flatten().all(|u| u.abs() < 1e-12));
/// assert!((removed[0].motion.rotation_rad - 0.1).abs() < 1e-12);
/// ```
pub fn remove_rigid<U: Length>(field: &Measurement<U>, which: RemoveRigid) -> (Measurement<U>, Vec<RigidRemoved>) {
    let mesh = &field.mesh;
    let parts: Vec<(Option<usize>, std::ops::Range<usize>)> = match which {
        RemoveRigid::All => vec![(None, 0..mesh.n_nodes())],
        RemoveRigid::Zone => (0..mesh.zones().len()).map(|zone| (Some(zone), mesh.zone_nodes(zone))).collect(),
    };
    let mut left = field.clone();
    let mut removed = Vec::new();
    for (zone, nodes) in parts {
        let measured = nodes.filter(|&node| field.measured[node]);
        let displacements = measured.clone().map(|node| (mesh.nodes()[node], field.displacement[node]));
        let Some(motion) = RigidMotion::fit(displacements) else { continue };
        let (mut largest, mut squares, mut n) = (0.0f64, 0.0, 0.0f64);
        let (sin, cos) = motion.rotation_rad.sin_cos();
        for node in measured {
            let at = mesh.nodes()[node];
            let rigid = motion.displacement(at);
            // R^T (u - rigid) is the formula above, without the cancellation of the positions.
            let [x, y] = [0, 1].map(|c| field.displacement[node][c] - rigid[c]);
            let u = [cos * x + sin * y, cos * y - sin * x];
            let turned = |[x, y]: [f64; 2]| [(cos * x).hypot(sin * y), (cos * y).hypot(sin * x)];
            left.displacement[node] = u;
            left.sigma[node] = turned(field.sigma[node]);
            if let Some(points) = &mut left.points {
                let [x, y] = [0, 1].map(|c| points.displacement[node][c] - rigid[c]);
                points.displacement[node] = [cos * x + sin * y, cos * y - sin * x];
                points.sigma[node] = turned(points.sigma[node]);
            }
            if let Some(model) = &mut left.model_error {
                model.nodes[node] = turned(model.nodes[node]);
            }
            largest = largest.max(rigid[0].hypot(rigid[1]));
            squares += u[0] * u[0] + u[1] * u[1];
            n += 1.0;
        }
        removed.push(RigidRemoved { zone, motion, largest, left_rms: (squares / n.max(1.0)).sqrt() });
    }
    (left, removed)
}
