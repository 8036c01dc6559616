//! The module `quadrille._quadrille` of Python: the library on NumPy arrays. What users see of it is in
//! `quadrille/*.py`, which also say what the functions here take and give.
//!
//! Nothing is computed while the interpreter is locked, and nothing here prints: what a run has to say goes to
//! `on_event`.

mod camera;
mod correlator;
mod errors;
mod field;
mod images;
mod json;
mod pool;
mod runs;
mod watched;

/// What `import quadrille._quadrille` brings.
#[pyo3::pymodule]
mod _quadrille {
    #[pymodule_export]
    use super::camera::Camera;
    #[pymodule_export]
    use super::correlator::{Correlator, Tracker};
    #[pymodule_export]
    use super::field::Measured;
    #[pymodule_export]
    use super::images::read_image;
    #[pymodule_export]
    use super::runs::{
        calibrate, command, devices, identify, metrology, reduce, run_case, run_series, simulate, tournament,
        virtual_test,
    };

    /// Version of the engine, that of the program.
    #[pymodule_export]
    const VERSION: &str = env!("CARGO_PKG_VERSION");
}
