//! A given displacement as the measurement would see it.

use crate::linalg::{BlockJacobi, BlockMatrix, ElementMatrix, Pattern, alike};
use crate::mesh::{Mesh, shape_functions};
use crate::units::Px;
use rayon::prelude::*;
use std::sync::Arc;

/// Places along a side of an element at which the displacement is taken.
const SAMPLES: usize = 8;
/// Residual at which the solution stands, and the iterations that it takes at most: the condition of the matrix does not
/// grow with the mesh.
const REDUCTION: f64 = 1e-14;
const MOST_ITERATIONS: usize = 500;

/// The field on the nodes of `mesh` that is closest to `displacement` (px at a place in px) in the mean square over the
/// elements, as the correlation fits its field to the motion of the pixels where the texture is the same everywhere.
///
/// Elements with a node that is not `measured`, and those where `displacement` is nowhere or not everywhere known, are
/// left out; nodes of no other have no value. What the mesh can follow comes back as it is.
#[expect(clippy::indexing_slicing, reason = "numbers of nodes and elements are those of the mesh itself")]
pub(crate) fn project(
    mesh: &Mesh<Px>,
    measured: &[bool],
    displacement: impl Fn([f64; 2]) -> Option<[f64; 2]> + Sync,
) -> Vec<Option<[f64; 2]>> {
    let of_element = |element: usize| -> Option<(ElementMatrix, [f64; 8])> {
        let nodes = mesh.elements()[element];
        if !nodes.iter().all(|&node| measured[node as usize]) {
            return None;
        }
        let geometry = mesh.geometry(element);
        let (mut products, mut sums) = ([[0.0; 4]; 4], [0.0; 8]);
        let middle = |k: usize| (k as f64 + 0.5) / SAMPLES as f64;
        for at in (0..SAMPLES * SAMPLES).map(|k| [middle(k % SAMPLES), middle(k / SAMPLES)]) {
            let u = displacement(geometry.place(at))?;
            let area = geometry.map_at(at).determinant.abs();
            let psi = shape_functions(at[0], at[1]);
            for i in 0..4 {
                (0..4).for_each(|j| products[i][j] += area * psi[i] * psi[j]);
                (0..2).for_each(|c| sums[2 * i + c] += area * psi[i] * u[c]);
            }
        }
        Some((alike(products, 1.0), sums))
    };
    let found: Vec<_> = (0..mesh.n_elements()).into_par_iter().map(of_element).collect();
    let (elements, parts): (Vec<[u32; 4]>, Vec<_>) =
        mesh.elements().iter().zip(found).filter_map(|(nodes, part)| Some((*nodes, part?))).unzip();
    let (matrices, sums): (Vec<ElementMatrix>, Vec<[f64; 8]>) = parts.into_iter().unzip();
    let pattern = Arc::new(Pattern::new(mesh.n_nodes(), &elements));
    let matrix = BlockMatrix::assemble(&pattern, &elements, &matrices);
    let rhs = pattern.gather(|element| sums[element]);
    let (solved, _) = BlockJacobi::new(&matrix).solve(&matrix, &rhs, REDUCTION, MOST_ITERATIONS);
    let is_known = |node: usize| !pattern.elements_of(node).is_empty();
    solved.into_iter().enumerate().map(|(node, u)| is_known(node).then_some(u)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Roi, Zone};

    #[test]
    fn a_wave_is_drawn_through_its_means_and_not_through_its_values() {
        let roi = Roi { x0: 0.0, y0: 0.0, x1: 320.0, y1: 64.0 };
        let mesh = Mesh::on_zones(&[Zone::rectangle("all", roi)], 16, 400, 100).unwrap();
        let wave = |x: f64| (std::f64::consts::TAU * x / 80.0).cos();
        let seen = project(&mesh, &vec![true; mesh.n_nodes()], |[x, _]| Some([wave(x), 0.0]));
        // The transfer of the projection onto linear shape functions at 5 elements a period, W = 3 sinc^2 / (2 + cos).
        let k = std::f64::consts::TAU / 5.0;
        let transfer = 3.0 * (2.0 * (1.0 - k.cos()) / (k * k)) / (2.0 + k.cos());
        let middle = mesh.nodes().iter().position(|at| *at == [160.0, 32.0]).unwrap();
        // The sums over 8 midpoints for integrals, and the ends of the mesh ten elements away.
        assert!((seen[middle].unwrap()[0] - transfer).abs() < 5e-3, "{:?} {transfer}", seen[middle]);
        assert!((transfer - 1.0).abs() > 0.02);
    }

    #[test]
    fn elements_that_are_not_covered_or_not_measured_are_left_out() {
        let roi = Roi { x0: 0.0, y0: 0.0, x1: 64.0, y1: 16.0 };
        let mesh = Mesh::on_zones(&[Zone::rectangle("all", roi)], 16, 100, 100).unwrap();
        let mut measured = vec![true; mesh.n_nodes()];
        measured[0] = false;
        let seen = project(&mesh, &measured, |[x, _]| (x < 40.0).then_some([1.0, 2.0]));
        // Of four elements the second alone: the first has node 0, the third is covered by half.
        let known: Vec<f64> = seen.iter().zip(mesh.nodes()).filter(|(u, _)| u.is_some()).map(|(_, at)| at[0]).collect();
        assert_eq!(known, [16.0, 32.0, 16.0, 32.0]);
        assert!(seen.iter().flatten().all(|u| (u[0] - 1.0).abs() < 1e-12 && (u[1] - 2.0).abs() < 1e-12));
    }
}
