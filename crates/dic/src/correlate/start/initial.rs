//! Where an iteration begins.

use crate::backend::GreyTransfer;

/// Where an iteration begins: displacements, px, grey transfers, and the elements that it begins without.
#[derive(Debug, Clone, PartialEq)]
pub struct Start {
    /// Per node.
    pub displacement: Vec<[f64; 2]>,
    /// Per zone.
    pub transfer: Vec<GreyTransfer>,
    /// The elements, by number, that did not match in the frame before; they come back where they match.
    pub left_out: Vec<u32>,
}

impl Start {
    /// With all elements.
    pub fn new(displacement: Vec<[f64; 2]>, transfer: Vec<GreyTransfer>) -> Self {
        Self { displacement, transfer, left_out: Vec::new() }
    }
}

/// Which of `n` these numbers name.
pub(crate) fn named(numbers: &[u32], n: usize) -> Vec<bool> {
    let mut named = vec![false; n];
    numbers.iter().for_each(|&number| named[number as usize] = true);
    named
}

pub(crate) fn numbers(of: &[bool]) -> Vec<u32> {
    of.iter().enumerate().filter(|(_, of)| **of).map(|(number, _)| number as u32).collect()
}
