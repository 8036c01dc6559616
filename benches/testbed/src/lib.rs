//! What is measured of quadrille, and the numerical experiments of Fedele, Raka, Hild and Roux (2009) done again. Not a
//! part of the product: the program `testbed`, `cargo bench` and the tests of this package use it.

pub mod bench;
pub mod paper;
