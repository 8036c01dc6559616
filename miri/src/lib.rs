//! The modules of quadrille that its kernels are made of, and no other: what Miri interprets (`make miri`).

#![allow(dead_code, unused_imports, missing_docs, reason = "what uses them lies in the modules that are left out")]

#[path = "../../crates/dic/src/backend/mod.rs"]
pub mod backend;
#[path = "../../crates/base/src/clock.rs"]
pub mod clock;
#[path = "../../crates/base/src/field/mod.rs"]
pub mod field;
#[path = "../../crates/base/src/imaging/mod.rs"]
pub mod imaging;
#[path = "../../crates/base/src/isa.rs"]
pub mod isa;
#[path = "../../crates/base/src/linalg/mod.rs"]
pub mod linalg;
#[path = "../../crates/base/src/mesh/mod.rs"]
pub mod mesh;
#[path = "../../crates/base/src/parts.rs"]
mod parts;
#[path = "../../crates/base/src/units.rs"]
pub mod units;
