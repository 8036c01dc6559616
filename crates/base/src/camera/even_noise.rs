//! How the noise of neighbouring nodes goes together on an even texture.

use crate::isa::Isa;
use crate::linalg::{BlockJacobi, BlockMatrix, ElementMatrix, Pattern, alike, inverse_diagonal};
use crate::mesh::Mesh;
use crate::plane::Point;
use crate::units::Px;
use std::sync::Arc;

/// Nodes of one colour are so many steps apart, as `inverse_diagonal` needs them.
const APART: usize = 5;

/// The nodes of some elements. The covariance of each component of their displacement goes as the inverse of the mass
/// matrix; its size is that of the standard uncertainties of a field.
pub(super) struct EvenNoise {
    /// Numbers of the nodes in the mesh, in the order of the rows.
    pub numbers: Vec<usize>,
    /// The mass matrix, alike for both components.
    pub mass: BlockMatrix,
    /// Diagonal of its inverse.
    pub variance: Vec<Point>,
}

impl EvenNoise {
    /// Of these `elements` of a mesh.
    pub fn new(mesh: &Mesh<Px>, elements: &[usize]) -> Self {
        let mut place = vec![None; mesh.n_nodes()];
        let mut numbers = Vec::new();
        for &node in elements.iter().flat_map(|&element| &mesh.elements()[element]) {
            place[node as usize].get_or_insert_with(|| {
                numbers.push(node as usize);
                numbers.len() as u32 - 1
            });
        }
        let own = |node: u32| place[node as usize].unwrap_or_default();
        let corners: Vec<[u32; 4]> = elements.iter().map(|&element| mesh.elements()[element].map(own)).collect();
        let of_element = |&element: &usize| alike(mesh.geometry(element).mass_matrix(), 1.0);
        let matrices: Vec<ElementMatrix> = elements.iter().map(of_element).collect();
        let pattern = Arc::new(Pattern::new(numbers.len(), &corners));
        let mass = BlockMatrix::assemble(&pattern, &corners, &matrices);
        let colours = pattern.colours(0..numbers.len(), APART);
        let variance = inverse_diagonal(Isa::detect(), &mass, &BlockJacobi::new(&mass), &colours);
        Self { numbers, mass, variance }
    }
}
