//! Files: images, series of images, case files, tables and VTK.

pub mod case;
pub mod csv;
pub mod images;
pub mod mask;
pub mod mesh_file;
pub mod series;
mod tiff;
pub mod vtk;
