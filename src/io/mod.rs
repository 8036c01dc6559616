//! Files: images, series of images, folders that a camera writes into, case files, load files, the store of a run, tables, VTK, NumPy and MATLAB.

pub mod arrays;
pub mod case;
pub mod csv;
pub mod images;
pub mod joint;
pub mod load;
pub mod mask;
pub mod mat;
pub mod mesh_file;
pub mod npz;
pub mod quantities;
pub mod run_case;
pub mod series;
#[cfg(feature = "store")]
pub mod store;
pub mod text;
mod tiff;
pub mod vtk;
pub mod watch;

/// Name of the store in the folder of a run.
pub const STORE: &str = "fields.zarr";
