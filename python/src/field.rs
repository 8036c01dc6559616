//! The field of one frame as arrays.

use crate::errors::raise;
use crate::json::record;
use numpy::ndarray::Array2;
use numpy::{Element, IntoPyArray};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use quadrille::correlate::Correlation;
use quadrille::field::{ElementMark, Measurement, StrainField, TensorStrain};
use quadrille::remark::Remark;
use quadrille::report::remarks_of;
use quadrille::units::Px;

/// An array of `N` columns that holds `rows`, which are moved.
pub fn table<T: Element, const N: usize>(py: Python<'_>, rows: Vec<[T; N]>) -> PyResult<Bound<'_, PyAny>> {
    let shape = (rows.len(), N);
    let array = Array2::from_shape_vec(shape, rows.into_flattened());
    Ok(array.map_err(|error| raise("QuadrilleError", error.to_string()))?.into_pyarray(py).into_any())
}

/// Components of strains; NaN where there is none.
fn components(strains: &[Option<TensorStrain>]) -> Vec<[f64; 3]> {
    strains.iter().map(|strain| strain.map_or([f64::NAN; 3], TensorStrain::components)).collect()
}

/// A field as it was measured, to draw quantities from: see `Correlator.quantities`.
#[pyclass(frozen, module = "quadrille._quadrille")]
pub struct Measured(pub Measurement<Px>);

/// Everything of frame `number` but the mesh, by the names of the attributes of `quadrille.Field`.
pub fn field<'py>(
    py: Python<'py>,
    number: usize,
    found: Correlation,
    strains: &StrainField,
) -> PyResult<Bound<'py, PyDict>> {
    let remarks: Vec<Remark> = remarks_of(number, &found).collect();
    let of = found.measurement;
    let measured = Measured(of.clone());
    let known = |pairs: &[[f64; 2]]| {
        let pairs = pairs.iter().zip(&of.measured);
        pairs.map(|(pair, measured)| if *measured { *pair } else { [f64::NAN; 2] }).collect::<Vec<_>>()
    };
    let dict = PyDict::new(py);
    dict.set_item("measured_field", measured)?;
    dict.set_item("status", of.status.name())?;
    dict.set_item("displacement", table(py, known(&of.displacement))?)?;
    dict.set_item("sigma", table(py, known(&of.sigma))?)?;
    dict.set_item("strain", table(py, components(&strains.nodes))?)?;
    dict.set_item("element_strain", table(py, components(&strains.elements))?)?;
    if let Some(window) = &strains.window {
        let both =
            window.nodes.iter().map(|node| node.map_or(([f64::NAN; 3], [f64::NAN; 3]), |(e, s)| (e.components(), s)));
        let (strain, sigma): (Vec<_>, Vec<_>) = both.unzip();
        dict.set_item("window_strain", table(py, strain)?)?;
        dict.set_item("window_strain_sigma", table(py, sigma)?)?;
        if let Some(errors) = window.model_errors() {
            dict.set_item("window_strain_model_error", table(py, components(&errors))?)?;
        }
    }
    if let Some(points) = &of.points {
        dict.set_item("displacement_point", table(py, known(&points.displacement))?)?;
        dict.set_item("sigma_point", table(py, known(&points.sigma))?)?;
        dict.set_item("is_point_value", points.is_value.clone().into_pyarray(py))?;
    }
    if let Some(error) = &of.model_error {
        dict.set_item("model_error", table(py, known(&error.nodes))?)?;
        dict.set_item("misfit", error.misfit.clone().into_pyarray(py))?;
    }
    let marks: Vec<u8> = of.marks.as_deref().unwrap_or_default().iter().map(|mark: &ElementMark| mark.code()).collect();
    dict.set_item("marks", marks.into_pyarray(py))?;
    dict.set_item("measured", of.measured.into_pyarray(py))?;
    dict.set_item("residual", of.element_residual.into_pyarray(py))?;
    dict.set_item("iterations", found.iterations)?;
    dict.set_item("correction_px", found.correction_px)?;
    dict.set_item("residual_grey", found.residual_rms)?;
    dict.set_item("residual_percent", found.residual_percent)?;
    dict.set_item("interpolation_bias_px", found.interpolation_bias_px.to_vec().into_pyarray(py))?;
    dict.set_item("remarks", record(py, &remarks)?)?;
    dict.set_item("ambiguity", found.ambiguity.as_ref().map(ToString::to_string))?;
    let zones = found.zones.iter().map(|zone| {
        let dict = PyDict::new(py);
        dict.set_item("name", &zone.name)?;
        dict.set_item("correlation", zone.correlation)?;
        dict.set_item("residual_grey", zone.residual_rms)?;
        dict.set_item("noise_grey", zone.noise)?;
        dict.set_item("gain", zone.transfer.gain)?;
        Ok(dict)
    });
    dict.set_item("zones", zones.collect::<PyResult<Vec<_>>>()?)?;
    Ok(dict)
}
