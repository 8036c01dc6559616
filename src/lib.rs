//! Global Q4 digital image correlation: displacement fields from image series.
//!
//! One straight road: images -> [`field::Measurement`]. Beside it the mechanics of cohesive joints: displacements of
//! the border -> [`mechanics::Solution`]. Modules know only modules of lower rank
//! (`tests/layers.rs`): `units`, `clock`, `isa`; `linalg`; `imaging`, `mesh`; `field`; `backend`, `io`, `synth`;
//! `correlate`, `mechanics`; `bench`, `identify`, `metrology`, `virtual_test`; `paper`, `report`; `run`; `cli`.

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

#[cfg(doctest)]
#[doc = include_str!("../docs/mechanics.md")]
struct Mechanics;

pub mod backend;
pub mod bench;
pub mod cli;
pub mod clock;
pub mod correlate;
pub mod field;
pub mod identify;
pub mod imaging;
pub mod io;
pub mod isa;
pub mod linalg;
pub mod mechanics;
pub mod mesh;
pub mod metrology;
pub mod paper;
pub mod report;
pub mod run;
pub mod synth;
pub mod units;
pub mod virtual_test;
