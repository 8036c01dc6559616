//! The modules of quadrille that its kernels are made of, and no other: what Miri interprets (`make miri`).

#![allow(dead_code, unused_imports, missing_docs, reason = "what uses them lies in the modules that are left out")]

#[path = "../../src/backend/mod.rs"]
pub mod backend;
#[path = "../../src/clock.rs"]
pub mod clock;
#[path = "../../src/field/mod.rs"]
pub mod field;
#[path = "../../src/imaging/mod.rs"]
pub mod imaging;
#[path = "../../src/isa.rs"]
pub mod isa;
#[path = "../../src/linalg/mod.rs"]
pub mod linalg;
#[path = "../../src/mesh/mod.rs"]
pub mod mesh;
#[path = "../../src/parts.rs"]
mod parts;
#[path = "../../src/units.rs"]
pub mod units;
