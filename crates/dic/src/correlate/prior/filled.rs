//! Displacements where nothing, or nothing to be trusted, was found: as the field around them would have it.

use crate::backend::ElementMatch;
use crate::mesh::Mesh;
use crate::units::Px;

/// The displacement, filled ([`fill_field`]) at nodes without elements that count.
pub(crate) fn continue_field(mesh: &Mesh<Px>, displacement: &[[f64; 2]], elements: &[ElementMatch]) -> Vec<[f64; 2]> {
    let mut known = vec![false; mesh.n_nodes()];
    for (nodes, found) in mesh.elements().iter().zip(elements) {
        nodes.iter().for_each(|&node| known[node as usize] |= found.n > 0.0);
    }
    fill_field(mesh, displacement, known)
}

/// The displacement, where not `known` as the field around has it: the affine motion of the zone plus a harmonic rest.
pub(crate) fn fill_field(mesh: &Mesh<Px>, displacement: &[[f64; 2]], mut known: Vec<bool>) -> Vec<[f64; 2]> {
    let mut all = displacement.to_vec();
    for (known, u) in known.iter_mut().zip(&all) {
        *known &= u.iter().all(|u| u.is_finite());
    }
    // Along mesh lines, of the nodes that are not known: few, as a rule.
    let mut neighbours: Vec<Vec<u32>> = vec![Vec::new(); mesh.n_nodes()];
    for (nodes, k) in mesh.elements().iter().flat_map(|nodes| (0..4).map(move |k| (nodes, k))) {
        let [a, b] = [nodes[k], nodes[(k + 1) % 4]];
        for (node, other) in [(a, b), (b, a)] {
            if a != b && !known[node as usize] {
                neighbours[node as usize].push(other);
            }
        }
    }
    for zone in 0..mesh.zones().len() {
        let nodes = mesh.zone_nodes(zone);
        let unknown: Vec<usize> = nodes.clone().filter(|&node| !known[node]).collect();
        if unknown.is_empty() || unknown.len() == nodes.len() {
            continue;
        }
        let given = || nodes.clone().filter(|&node| known[node]);
        let affine = affine(&given().map(|node| (mesh.nodes()[node], all[node])).collect::<Vec<_>>());
        let mut beyond: Vec<[f64; 2]> = vec![[0.0; 2]; nodes.len()];
        for node in given() {
            let by = affine(mesh.nodes()[node]);
            beyond[node - nodes.start] = [0, 1].map(|c| all[node][c] - by[c]);
        }
        let mut reached: Vec<bool> = nodes.clone().map(|node| known[node]).collect();
        /// Sweeps of Gauss and Seidel, which carry a value about as many elements far.
        const SWEEPS: usize = 60;
        for _ in 0..SWEEPS {
            for &node in &unknown {
                let (mut sum, mut n) = ([0.0; 2], 0.0);
                for &other in &neighbours[node] {
                    let other = other as usize - nodes.start;
                    if reached[other] {
                        sum = [sum[0] + beyond[other][0], sum[1] + beyond[other][1]];
                        n += 1.0;
                    }
                }
                if n > 0.0 {
                    beyond[node - nodes.start] = sum.map(|v| v / n);
                    reached[node - nodes.start] = true;
                }
            }
        }
        for node in unknown {
            let by = affine(mesh.nodes()[node]);
            all[node] = [0, 1].map(|c| by[c] + beyond[node - nodes.start][c]);
        }
    }
    all
}

/// The affine displacement closest to the given ones; their mean where they do not say more.
pub(crate) fn affine(points: &[([f64; 2], [f64; 2])]) -> impl Fn([f64; 2]) -> [f64; 2] + use<> {
    let n = points.len().max(1) as f64;
    let mut mean = [[0.0; 2]; 2];
    for (x, u) in points {
        (0..2).for_each(|c| (mean[0][c], mean[1][c]) = (mean[0][c] + x[c] / n, mean[1][c] + u[c] / n));
    }
    let (mut a, mut b) = ([0.0; 3], [[0.0; 2]; 2]);
    for (x, u) in points {
        let d = [x[0] - mean[0][0], x[1] - mean[0][1]];
        a = [a[0] + d[0] * d[0], a[1] + d[0] * d[1], a[2] + d[1] * d[1]];
        for c in 0..2 {
            let v = u[c] - mean[1][c];
            b[c] = [b[c][0] + d[0] * v, b[c][1] + d[1] * v];
        }
    }
    let determinant = a[0] * a[2] - a[1] * a[1];
    let gradient = b.map(|[p, q]| match determinant > 1e-6 * a[0] * a[2] {
        true => [(a[2] * p - a[1] * q) / determinant, (a[0] * q - a[1] * p) / determinant],
        false => [0.0; 2],
    });
    move |x| [0, 1].map(|c| mean[1][c] + (0..2).map(|k| gradient[c][k] * (x[k] - mean[0][k])).sum::<f64>())
}
