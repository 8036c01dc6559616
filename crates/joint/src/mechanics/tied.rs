//! Rigid blocks among the unknowns: their numbers, and the elements that hang on them.

use super::RigidBlock;
use crate::linalg::SparsePattern;

/// Place of a component that is prescribed, or of a matrix entry that is not stored.
pub(super) const NONE: u32 = u32::MAX;

#[derive(Debug, Clone)]
pub(super) struct TiedBlock {
    /// Of its point along x and y, and of its rotation times its radius.
    pub unknowns: [u32; 3],
    /// Its radius, mm.
    pub radius: f64,
    /// Mean position of its nodes, mm.
    pub centre: [f64; 2],
    /// Which components of its point are unknown.
    free: [bool; 2],
}

impl TiedBlock {
    pub fn new(block: &RigidBlock, positions: &[[f64; 2]]) -> Self {
        Self {
            unknowns: [NONE; 3],
            radius: block.radius(positions),
            centre: block.centre(positions),
            free: [0, 1].map(|c| block.tied[c] && !block.held[c]),
        }
    }

    /// Gives it the next numbers; `id` is its own among the owners.
    pub fn number(&mut self, id: u32, owners: &mut Vec<(u32, u8)>) {
        for c in (0..3).filter(|&c| c == 2 || self.free[c]) {
            self.unknowns[c] = owners.len() as u32;
            owners.push((id, c as u8));
        }
    }
}

/// An element with nodes of blocks.
#[derive(Debug, Clone)]
pub(super) struct Tied {
    pub element: u32,
    /// Its unknowns, rising.
    pub unknowns: Vec<u32>,
    /// Where each entry of its stiffness, column by column, goes among the values of the matrix.
    pub places: Vec<u32>,
}

impl Tied {
    pub fn new(element: u32, unknowns: Vec<u32>, pattern: &SparsePattern) -> Self {
        let place = |column: u32, row: u32| {
            pattern.place(row as usize, column as usize).expect("an entry of the pattern") as u32
        };
        let places = unknowns.iter().flat_map(|&column| unknowns.iter().map(move |&row| place(column, row)));
        let places = places.collect();
        Self { element, unknowns, places }
    }
}
