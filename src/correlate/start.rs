//! Where an iteration begins.

use crate::backend::GreyTransfer;

/// Where an iteration begins: a displacement of all nodes, px, and the grey transfer per zone.
#[derive(Debug, Clone, PartialEq)]
pub struct Start {
    /// Per node.
    pub displacement: Vec<[f64; 2]>,
    /// Per zone.
    pub transfer: Vec<GreyTransfer>,
}
