//! The transforms of rustfft. A crate of its own: rustfft is generic, and whoever plans a transform compiles all of its
//! algorithms, a quarter of all code in `quadrille-dic` before.

pub use rustfft::Fft;
pub use rustfft::num_complex;

use rustfft::FftPlanner;
use std::sync::Arc;

/// Forward and inverse transform of `length` values, neither of them scaled.
pub fn single(length: usize) -> [Arc<dyn Fft<f32>>; 2] {
    let mut planner = FftPlanner::new();
    [planner.plan_fft_forward(length), planner.plan_fft_inverse(length)]
}

/// As [`single`], in double precision.
pub fn double(length: usize) -> [Arc<dyn Fft<f64>>; 2] {
    let mut planner = FftPlanner::new();
    [planner.plan_fft_forward(length), planner.plan_fft_inverse(length)]
}
