//! Files: images, series of images, case files, load files, tables and VTK.

pub mod case;
pub mod csv;
pub mod images;
pub mod load;
pub mod quantities;
pub mod series;
mod tiff;
pub mod vtk;
