//! The camera: from pixels to mm in the plane of the specimen, and back.

use crate::errors::{Raised, raise, raised};
use crate::field::table;
use crate::json::{case_of, record};
use numpy::PyReadonlyArray2;
use numpy::ndarray::Array3;
use numpy::{IntoPyArray, PyArray3};
use pyo3::prelude::*;
use quadrille::camera::Camera as Seen;
use quadrille::io::case::{CaseCamera, CaseCameraError, read_camera, write_camera};
use quadrille::units::{Mm, PixelSize, Px, Vector};
use std::path::{Path, PathBuf};

impl Raised for CaseCameraError {
    fn kind(&self) -> &'static str {
        "CaseError"
    }
}

/// A camera: see `quadrille.Camera`.
#[pyclass(frozen, module = "quadrille._quadrille")]
pub struct Camera {
    section: CaseCamera,
    camera: Seen,
    size: Option<PixelSize>,
}

impl Camera {
    fn of(section: CaseCamera, images: Option<[usize; 2]>) -> PyResult<Self> {
        let wrong = |what: &str| raise("OptionError", what.to_owned());
        let size = section.image_size_px.or(images);
        let size =
            size.ok_or_else(|| wrong("the size of the images is not noted; give image_size_px=(columns, rows)"))?;
        let camera = section.camera(images.unwrap_or(size)).map_err(raised)?;
        let size = match section.pixel_size_mm {
            Some(mm) => Some(PixelSize::new(mm).ok_or_else(|| wrong("pixel_size_mm is not above zero"))?),
            None => None,
        };
        let section = CaseCamera { image_size_px: Some(camera.shape().image_size_px), ..section };
        Ok(Self { section, camera, size })
    }

    fn size(&self) -> PyResult<PixelSize> {
        let what = "this camera states no pixel_size_mm; calibrate with a length or a target, or give it";
        self.size.ok_or_else(|| raise("OptionError", what.to_owned()))
    }
}

/// Rows of two numbers.
fn rows(points: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<[f64; 2]>> {
    let points = points.as_array();
    if points.ncols() != 2 {
        return Err(raise("OptionError", format!("points have {} columns; give x and y", points.ncols())));
    }
    Ok(points.outer_iter().map(|row| [row[0], row[1]]).collect())
}

#[pymethods]
impl Camera {
    /// Of the keys of `[camera]`, as JSON.
    #[new]
    #[pyo3(signature = (json, image_size_px=None))]
    fn new(json: &str, image_size_px: Option<[usize; 2]>) -> PyResult<Self> {
        let case = case_of(json, Path::new("camera"))?;
        let section = case.camera.unwrap_or_default().resolved(Path::new("")).map_err(raised)?;
        Self::of(section, image_size_px)
    }

    /// Of a file.
    #[staticmethod]
    #[pyo3(signature = (path, image_size_px=None))]
    fn read(path: PathBuf, image_size_px: Option<[usize; 2]>) -> PyResult<Self> {
        Self::of(read_camera(&path).map_err(raised)?, image_size_px)
    }

    /// The text of `camera.toml`.
    fn text(&self) -> String {
        write_camera(&self.section, &[format!("Camera written by quadrille {}", env!("CARGO_PKG_VERSION"))])
    }

    /// The keys of `[camera]`.
    fn keys<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        record(py, &self.section)
    }

    /// Raw px to mm in the plane; NaN where nothing of it is seen.
    fn to_mm<'py>(&self, py: Python<'py>, px: PyReadonlyArray2<'py, f64>) -> PyResult<Bound<'py, PyAny>> {
        let size = self.size()?;
        let place = |at: [f64; 2]| match self.camera.plane(at) {
            Some(at) => size.to_mm(Vector::<Px>::new(at)).components(),
            None => [f64::NAN; 2],
        };
        table(py, rows(&px)?.into_iter().map(place).collect())
    }

    /// The same back.
    fn to_px<'py>(&self, py: Python<'py>, mm: PyReadonlyArray2<'py, f64>) -> PyResult<Bound<'py, PyAny>> {
        let size = self.size()?;
        let place = |at: [f64; 2]| self.camera.pixel(size.to_px(Vector::<Mm>::new(at)).components());
        table(py, rows(&mm)?.into_iter().map(place).collect())
    }

    /// By how much places seen at these raw px move in mm with one standard uncertainty of the distance to the specimen.
    fn distance_mm<'py>(&self, py: Python<'py>, px: PyReadonlyArray2<'py, f64>) -> PyResult<Bound<'py, PyAny>> {
        let (size, shape) = (self.size()?, self.camera.shape());
        let moved = |at: [f64; 2]| match self.camera.plane(at) {
            Some([x, y]) => {
                let by = [x - shape.theta[5], y - shape.theta[6]].map(|v| shape.distance_std * v);
                size.to_mm(Vector::<Px>::new(by)).components()
            }
            None => [f64::NAN; 2],
        };
        table(py, rows(&px)?.into_iter().map(moved).collect())
    }

    /// By how much places in mm change with one standard uncertainty of each of some independent causes: one for each
    /// parameter that its covariance names, and the size of a pixel.
    fn terms_mm<'py>(&self, py: Python<'py>, px: PyReadonlyArray2<'py, f64>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let (size, points) = (self.size()?, rows(&px)?);
        let plane: Vec<Option<[f64; 2]>> = points.iter().map(|&at| self.camera.plane(at)).collect();
        let mm = |at: [f64; 2]| size.to_mm(Vector::<Px>::new(at)).components();
        let mut list: Vec<f64> = Vec::new();
        for theta in self.camera.columns() {
            let change = |at: &Option<[f64; 2]>| (*at).and_then(|at| self.camera.plane_change(at, theta));
            list.extend(plane.iter().flat_map(|at| change(at).map_or([f64::NAN; 2], mm)));
        }
        let relative = self.section.pixel_size_relative_std.unwrap_or(0.0);
        list.extend(plane.iter().flat_map(|at| at.map_or([f64::NAN; 2], |at| mm(at).map(|v| relative * v))));
        let shape = (self.camera.columns().len() + 1, points.len(), 2);
        let array = Array3::from_shape_vec(shape, list).map_err(|error| raise("QuadrilleError", error.to_string()))?;
        Ok(array.into_pyarray(py))
    }
}
