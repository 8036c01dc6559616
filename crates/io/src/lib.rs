//! Files: images, series of images, folders that a camera writes into, case files, load files, the store of a run,
//! tables, VTK, NumPy and MATLAB.

// What others have written must not end the program: nothing here panics on a file, and what cannot be says why.
// (tests/commands/fuzz.rs and fuzz/ try.)
#![cfg_attr(
    not(test),
    deny(
        clippy::expect_used,
        clippy::indexing_slicing,
        clippy::panic,
        clippy::unreachable,
        clippy::todo,
        clippy::unimplemented
    )
)]

// So that examples in the documents read as users write them: `quadrille::io::...`.
#[doc(hidden)]
pub extern crate self as io;

pub use quadrille_base::{camera, digest, field, imaging, linalg, mesh, plane, remark, units};

pub mod arrays;
pub mod case;
pub mod csv;
pub mod foreign;
pub mod images;
pub mod joint;
pub mod load;
pub mod mask;
pub mod mat;
pub mod mesh_file;
pub mod npz;
pub mod opencv;
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
