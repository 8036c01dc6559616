//! Standard uncertainty where the specimen has stretched and turned (THEORY 18). At the end of the iteration a change of
//! the displacement acts through the gradient of the deformed image, `F^-T grad f`, so that `Cov(u) = F Cov_0(u) F^T`
//! with `Cov_0` of [`crate::correlate::noise::uncertainty`] and `F = I + grad u`.

use crate::mesh::Mesh;
use crate::units::Px;

/// `F` of one node.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DeformationGradient([[f64; 2]; 2]);

/// A mean in the making.
#[derive(Debug, Clone, Copy, Default)]
struct Mean {
    sum: [[f64; 2]; 2],
    n: f64,
}

impl Mean {
    fn add(&mut self, gradient: [[f64; 2]; 2]) {
        if gradient.as_flattened().iter().all(|slope| slope.is_finite()) {
            (0..4).for_each(|k| self.sum[k / 2][k % 2] += gradient[k / 2][k % 2]);
            self.n += 1.0;
        }
    }
}

impl DeformationGradient {
    /// That of each node: the mean over the middles of those of its elements of which all nodes are `measured`, and of
    /// all such elements of its zone where it has none. A gradient that is no number, as where a frame diverged, is left
    /// out: it would take the uncertainties of the nodes around with it.
    pub fn of_nodes(mesh: &Mesh<Px>, displacement: &[[f64; 2]], measured: &[bool]) -> Vec<Self> {
        let mut of_nodes = vec![Mean::default(); mesh.n_nodes()];
        let mut of_zones = vec![Mean::default(); mesh.zones().len()];
        for (element, nodes) in mesh.elements().iter().enumerate() {
            if nodes.iter().all(|&node| measured[node as usize]) {
                let u = nodes.map(|node| displacement[node as usize]);
                let gradient = mesh.geometry(element).map_at([0.5, 0.5]).gradient_of(&u);
                nodes.iter().for_each(|&node| of_nodes[node as usize].add(gradient));
                of_zones[mesh.element_zone()[element] as usize].add(gradient);
            }
        }
        let of_node = |(node, own): (usize, &Mean)| {
            let mean = if own.n > 0.0 { own } else { &of_zones[mesh.node_zone()[node] as usize] };
            let [[xx, xy], [yx, yy]] = mean.sum.map(|row| row.map(|slope| slope / mean.n.max(1.0)));
            Self([[1.0 + xx, xy], [yx, 1.0 + yy]])
        };
        of_nodes.iter().enumerate().map(of_node).collect()
    }

    /// Variances of the two components in the deformed image, from those of the undeformed one. (What x and y have in
    /// common there is left out: little, where the texture has no direction.)
    pub fn variances(self, [x, y]: [f64; 2]) -> [f64; 2] {
        self.0.map(|[by_x, by_y]| by_x * by_x * x + by_y * by_y * y)
    }
}
