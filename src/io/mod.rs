//! (under construction)

pub mod csv;
pub mod vtk;
