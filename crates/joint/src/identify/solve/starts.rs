//! Several starts: a list, or a Latin hypercube over the box of the bounds.

use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// `n` points that fill the box between `lower` and `upper` evenly: each of the `n` slices of every side holds one.
pub fn latin_hypercube(n: usize, [lower, upper]: [&[f64]; 2], seed: u64) -> Vec<Vec<f64>> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut points = vec![Vec::with_capacity(lower.len()); n];
    for (&low, &high) in lower.iter().zip(upper) {
        let mut slices: Vec<usize> = (0..n).collect();
        slices.shuffle(&mut random);
        for (point, slice) in points.iter_mut().zip(slices) {
            let share = (slice as f64 + random.random::<f64>()) / n as f64;
            point.push(low + share * (high - low));
        }
    }
    points
}
