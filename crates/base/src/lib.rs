//! The ground of quadrille: units, linear algebra, images, meshes, fields. Nothing here opens a file or knows a device.

#![cfg_attr(not(test), deny(clippy::unwrap_used))]

pub mod camera;
pub mod clock;
pub mod digest;
pub mod field;
pub mod imaging;
pub mod isa;
pub mod linalg;
pub mod mesh;
pub mod parts;
pub mod plane;
pub mod remark;
pub mod units;
