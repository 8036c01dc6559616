//! Where points lie on the mesh, and the borders of its zones.

use crate::mesh::Mesh;
use crate::units::Length;
use std::collections::HashMap;

/// The element that holds a point, of whatever zone, and the local coordinates there.
pub fn find<U: Length>(mesh: &Mesh<U>, x: f64, y: f64) -> Option<(usize, f64, f64)> {
    mesh.grids().iter().find_map(|grid| {
        let (element, xi, eta) = grid.locate(x, y);
        ((0.0..=1.0).contains(&xi) && (0.0..=1.0).contains(&eta)).then_some((element, xi, eta))
    })
}

/// Border edges of a zone.
pub fn boundary<U: Length>(mesh: &Mesh<U>, zone: usize) -> Vec<[u32; 2]> {
    let edges = || {
        mesh.zone_elements(zone).flat_map(|element| {
            let nodes = mesh.elements()[element];
            (0..4).map(move |k| [nodes[k], nodes[(k + 1) % 4]]).filter(|[a, b]| a != b)
        })
    };
    let mut times = HashMap::new();
    for [a, b] in edges() {
        *times.entry([a.min(b), a.max(b)]).or_insert(0) += 1;
    }
    edges().filter(|&[a, b]| times[&[a.min(b), a.max(b)]] == 1).collect()
}

/// Root of the mean area of the elements.
pub fn element_size<U: Length>(mesh: &Mesh<U>) -> f64 {
    let area: f64 = (0..mesh.n_elements()).map(|e| crate::field::strain::ElementGeometry::new(mesh, e).area).sum();
    (area / mesh.n_elements().max(1) as f64).sqrt()
}
