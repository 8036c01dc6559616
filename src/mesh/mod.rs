//! Q4 meshes: zones, nodes, elements.

mod grid;

pub use grid::{Grid, Mesh, MeshError, Roi, Zone, shape_functions};
