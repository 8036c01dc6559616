//! Where an iteration begins.

use crate::backend::GreyTransfer;

/// Where an iteration begins: a displacement of all nodes, px, the grey transfer per zone, and the elements that it
/// begins without.
#[derive(Debug, Clone, PartialEq)]
pub struct Start {
    /// Per node.
    pub displacement: Vec<[f64; 2]>,
    /// Per zone.
    pub transfer: Vec<GreyTransfer>,
    /// The elements that did not match in the frame that this is taken from, by number; they come back where they
    /// match.
    pub left_out: Vec<u32>,
}

impl Start {
    /// With all elements.
    pub fn new(displacement: Vec<[f64; 2]>, transfer: Vec<GreyTransfer>) -> Self {
        Self { displacement, transfer, left_out: Vec::new() }
    }
}

/// The numbers of what is true.
pub(crate) fn numbers(of: &[bool]) -> Vec<u32> {
    of.iter().enumerate().filter(|(_, of)| **of).map(|(number, _)| number as u32).collect()
}
