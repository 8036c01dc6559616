//! Standard uncertainty where the specimen has stretched and turned (THEORY 18). At the end of the iteration a change of
//! the displacement acts through the gradient of the deformed image, `F^-T grad f`, so that `Cov(u) = F Cov_0(u) F^T`
//! with `Cov_0` of [`crate::correlate::noise::uncertainty`] and `F = I + grad u`.

use crate::mesh::Mesh;
use crate::units::Px;

/// `F` of one node.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DeformationGradient([[f64; 2]; 2]);

impl DeformationGradient {
    /// That of each node, the mean over the middles of its elements; none where a displacement is no number.
    pub fn of_nodes(mesh: &Mesh<Px>, displacement: &[[f64; 2]]) -> Vec<Self> {
        let mut sums = vec![([[0.0; 2]; 2], 0.0); mesh.n_nodes()];
        for (element, nodes) in mesh.elements().iter().enumerate() {
            let u = nodes.map(|node| displacement[node as usize]);
            let gradient = mesh.geometry(element).map_at([0.5, 0.5]).gradient_of(&u);
            if gradient.as_flattened().iter().all(|slope| slope.is_finite()) {
                for &node in nodes {
                    let (sum, n) = &mut sums[node as usize];
                    (0..4).for_each(|k| sum[k / 2][k % 2] += gradient[k / 2][k % 2]);
                    *n += 1.0;
                }
            }
        }
        let mean = |(sum, n): ([[f64; 2]; 2], f64)| {
            let [[xx, xy], [yx, yy]] = sum.map(|row| row.map(|slope| slope / f64::max(n, 1.0)));
            Self([[1.0 + xx, xy], [yx, 1.0 + yy]])
        };
        sums.into_iter().map(mean).collect()
    }

    /// Variances of the two components in the deformed image, from those of the undeformed one. (What x and y have in
    /// common there is left out: little, where the texture has no direction.)
    pub fn variances(self, [x, y]: [f64; 2]) -> [f64; 2] {
        self.0.map(|[by_x, by_y]| by_x * by_x * x + by_y * by_y * y)
    }
}
