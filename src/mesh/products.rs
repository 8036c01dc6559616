//! Products of the shape functions of an element.

use super::shape_functions;

/// The means of `psi_i psi_j` over an element with these corners (the last two equal in a triangle): 1/9, 1/18 and 1/36 on
/// a rectangle. Zero without area.
///
/// ```
/// let mean = quadrille::mesh::mean_products([[0.0, 0.0], [16.0, 0.0], [16.0, 16.0], [0.0, 16.0]]);
/// assert!((mean[0][0] - 1.0 / 9.0).abs() < 1e-12 && (mean[0][2] - 1.0 / 36.0).abs() < 1e-12);
/// ```
pub fn mean_products(corners: [[f64; 2]; 4]) -> [[f64; 4]; 4] {
    // Two Gauss points per axis: exact on parallelograms.
    let points = [0.5 - (1.0 / 12f64).sqrt(), 0.5 + (1.0 / 12f64).sqrt()];
    let (mut sums, mut area) = ([[0.0; 4]; 4], 0.0);
    for xi in points {
        for eta in points {
            let by_xi = [eta - 1.0, 1.0 - eta, eta, -eta];
            let by_eta = [xi - 1.0, -xi, xi, 1.0 - xi];
            let along = |by: [f64; 4], axis: usize| (0..4).map(|k| corners[k][axis] * by[k]).sum::<f64>();
            let weight = (along(by_xi, 0) * along(by_eta, 1) - along(by_eta, 0) * along(by_xi, 1)).abs();
            let psi = shape_functions(xi, eta);
            area += weight;
            for (row, i) in sums.iter_mut().zip(psi) {
                row.iter_mut().zip(psi).for_each(|(sum, j)| *sum += weight * i * j);
            }
        }
    }
    if area > 0.0 { sums.map(|row| row.map(|sum| sum / area)) } else { sums }
}
