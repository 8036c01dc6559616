//! A prepared reference and the frames of a series that follow each other.

use crate::errors::{raise, raised};
use crate::field::{Measured, field, table};
use crate::images::{Levels, image_of, mask_of};
use crate::json::{case_of, record};
use crate::pool::pool;
use numpy::IntoPyArray;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use quadrille::correlate::{Correlation, CorrelationError, History, Start};
use quadrille::field::StrainField;
use quadrille::imaging::Image;
use quadrille::run::{InMemory, Request};
use rayon::ThreadPool;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// What messages call the place of the options.
const OPTIONS: &str = "options";

/// A prepared reference: see `quadrille.Correlator`.
#[pyclass(frozen, module = "quadrille._quadrille")]
pub struct Correlator {
    prepared: InMemory,
    pool: Arc<ThreadPool>,
    /// Columns and rows of the images.
    size: [usize; 2],
}

impl Correlator {
    fn correlate_from(
        &self,
        image: Image,
        start: Option<&Start>,
    ) -> Result<(Correlation, StrainField), CorrelationError> {
        self.pool.install(|| {
            let correlator = &self.prepared.correlator;
            let found = correlator.correlate_uploaded(correlator.upload(Arc::new(image))?, start)?;
            let strains = self.prepared.strains(&found.measurement);
            Ok((found, strains))
        })
    }
}

#[pymethods]
impl Correlator {
    #[new]
    #[pyo3(signature = (reference, case, mask=None, device="auto", isa=None, threads=None))]
    fn new(
        py: Python<'_>,
        reference: &Bound<'_, PyAny>,
        case: &str,
        mask: Option<&Bound<'_, PyAny>>,
        device: &str,
        isa: Option<String>,
        threads: Option<i64>,
    ) -> PyResult<Self> {
        let reference = Arc::new(image_of(reference, "the reference", Levels::Copied)?);
        let mask = mask.map(mask_of).transpose()?;
        let case = case_of(case, Path::new(OPTIONS))?;
        let Ok(device) = device.parse();
        let asked = Request { device, isa, ..Request::default() };
        let pool = pool(threads)?;
        let size = [reference.width(), reference.height()];
        let prepared = py.detach(|| pool.install(|| InMemory::new(&asked, &case, reference, mask))).map_err(raised)?;
        Ok(Self { prepared, pool, size })
    }

    /// Finds one image.
    fn correlate<'py>(&self, py: Python<'py>, image: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyDict>> {
        let image = image_of(image, "the image", Levels::Borrowed)?;
        let (found, strains) = py.detach(|| self.correlate_from(image, None)).map_err(raised)?;
        field(py, 1, found, &strains)
    }

    /// What the sections of `case` ask for of a field: the text of a table of CSV by its name.
    fn quantities<'py>(&self, py: Python<'py>, field: &Measured, case: &str) -> PyResult<Bound<'py, PyAny>> {
        let asked = case_of(case, Path::new(OPTIONS))?.drawn();
        let texts = py.detach(|| self.pool.install(|| self.prepared.quantities(&field.0, &asked)));
        record(py, &texts.map_err(raised)?)
    }

    /// Places of the nodes, px.
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        table(py, self.prepared.correlator.mesh().nodes().to_vec())
    }

    /// Nodes of the elements.
    fn elements<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        table(py, self.prepared.correlator.mesh().elements().to_vec())
    }

    /// Number of the zone of each node.
    fn node_zone<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        self.prepared.correlator.mesh().node_zone().to_vec().into_pyarray(py).into_any()
    }

    /// Names of the zones.
    fn zones(&self) -> Vec<String> {
        self.prepared.correlator.mesh().zones().to_vec()
    }

    /// What does the work.
    fn device(&self) -> String {
        self.prepared.correlator.device().to_owned()
    }

    /// What is worth knowing.
    fn remarks<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        record(py, &self.prepared.remarks)
    }

    /// Rows and columns of the images.
    fn shape(&self) -> (usize, usize) {
        (self.size[1], self.size[0])
    }

    /// Name of the definition of the strains.
    fn strain(&self) -> &'static str {
        self.prepared.strain.name()
    }
}

/// Frames that follow each other: see `quadrille.Tracker`.
#[pyclass(frozen, module = "quadrille._quadrille")]
pub struct Tracker {
    correlator: Py<Correlator>,
    /// The number of the last frame, and what is known of the frames so far.
    state: Mutex<(usize, History)>,
}

#[pymethods]
impl Tracker {
    #[new]
    fn new(correlator: Py<Correlator>) -> Self {
        let start = correlator.get().prepared.correlator.options().start;
        Self { correlator, state: Mutex::new((0, History::new(start))) }
    }

    /// Finds the next image, or that of frame `number`.
    #[pyo3(signature = (image, number=None))]
    fn correlate<'py>(
        &self,
        py: Python<'py>,
        image: &Bound<'py, PyAny>,
        number: Option<usize>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let image = image_of(image, "the image", Levels::Borrowed)?;
        let correlator = self.correlator.get();
        // Locked while nothing of Python is held: who waits for it here does not keep others from ending.
        let (number, found, strains) = py.detach(|| {
            let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
            let number = number.unwrap_or(state.0 + 1);
            if number <= state.0 {
                let text = format!("frame {number} comes after frame {}: the numbers of frames must rise", state.0);
                return Err(raise("OptionError", text));
            }
            let start = state.1.predict(number, correlator.prepared.correlator.mesh());
            let (found, strains) = correlator.correlate_from(image, start.as_ref()).map_err(raised)?;
            state.1.note(number, &found);
            state.0 = number;
            Ok((number, found, strains))
        })?;
        field(py, number, found, &strains)
    }
}
