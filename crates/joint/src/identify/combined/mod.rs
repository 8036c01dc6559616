//! Several tests in one fit (THEORY 12): one law, each test with its own images, mesh, border, noise and constants.
//!
//! `omega = sum_k omega_k`, each in units of the noise of its own test, and information adds: `J^T W J = sum_k J_k^T
//! W_k J_k`. [`CombinedCase::new`] makes the problem of what the case files say, [`fit_combined`] solves it; what each
//! test tells by itself is in [`TestShare`].

mod alone;
mod case;
mod consistency;
mod fit;
mod known;
mod made;
mod misfit;
mod released;
mod search;
mod share;
mod sources;
mod verdict;

pub use alone::stds_of_information;
pub use case::{CombinedCase, SAME_GAP, TestCase};
pub use consistency::Consistency;
pub use fit::{CombinedFit, TestFit, fit_combined};
pub use share::TestShare;
