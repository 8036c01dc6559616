//! A number that is a sum of nodal displacements.

use super::NodalNoise;
use crate::field::Measurement;
use crate::units::Length;

/// A number with its standard uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Value {
    /// The number.
    pub value: f64,
    /// Its standard uncertainty.
    pub sigma: f64,
}

/// A number read from a field: `sum (w_x u_x + w_y u_y)` over nodes with fixed weights.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Reading {
    /// The nodes, each once, with the weights of both components.
    weights: Vec<(usize, [f64; 2])>,
}

impl Reading {
    /// The reading with these nodes and weights; those of one node are added, nodes without weight left out.
    pub fn new(weights: impl IntoIterator<Item = (usize, [f64; 2])>) -> Self {
        let mut weights: Vec<(usize, [f64; 2])> = weights.into_iter().collect();
        // In the order in which those of a node came: sums are the same bits.
        weights.sort_by_key(|(node, _)| *node);
        weights.dedup_by(|(next, w), (node, sum)| {
            let is_same = next == node;
            (0..2).filter(|_| is_same).for_each(|c| sum[c] += w[c]);
            is_same
        });
        weights.retain(|(_, w)| *w != [0.0; 2]);
        Self { weights }
    }

    /// The nodes with their weights.
    pub fn weights(&self) -> &[(usize, [f64; 2])] {
        &self.weights
    }

    /// The number in this field; `None` when one of its nodes is not measured.
    pub fn value<U: Length>(&self, field: &Measurement<U>) -> Option<f64> {
        let term = |&(node, w): &(usize, [f64; 2])| {
            let u = field.displacement[node];
            field.measured[node].then_some(w[0] * u[0] + w[1] * u[1])
        };
        self.weights.iter().map(term).sum()
    }

    /// The number in this field with its standard uncertainty; `None` when one of its nodes is not measured.
    pub fn read<U: Length>(&self, field: &Measurement<U>, noise: &NodalNoise) -> Option<Value> {
        Some(Value { value: self.value(field)?, sigma: noise.sigma(&self.weights, &field.sigma) })
    }
}
