//! Images as NumPy arrays.

use crate::errors::{raise, raised};
use numpy::ndarray::Array2;
use numpy::{
    Element, IntoPyArray, PyArray2, PyArrayDescrMethods, PyArrayMethods, PyReadonlyArray2, PyUntypedArray,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};
use quadrille::imaging::{Image, Pixels};
use quadrille::io::images::Loaded;
use quadrille::mesh::Mask;
use std::path::PathBuf;

/// What `array` is said to be when it is none of these.
const WANTED: &str = "give an array of uint8, uint16 or float32 with two axes: rows, columns";

/// The image in `array`, or in the file that it names. Its grey levels are copied once, a byte or a few for each pixel: other threads
/// may change the array while the image is worked on.
pub fn image_of(array: &Bound<'_, PyAny>, what: &str) -> PyResult<Image> {
    if array.is_instance_of::<PyString>() || array.hasattr("__fspath__")? {
        let path: PathBuf = array.extract()?;
        return Ok(array.py().detach(|| quadrille::io::images::read_image(&path, 0)).map_err(raised)?.image);
    }
    let numpy = array.py().import("numpy")?;
    let array = numpy.call_method1("asarray", (array,))?.cast_into::<PyUntypedArray>()?;
    let shape = array.shape().to_vec();
    let array = match shape.as_slice() {
        [_, _] => array,
        [rows, columns, 1] => array.call_method1("reshape", (*rows, *columns))?.cast_into()?,
        [rows, columns, 3 | 4] => {
            let text = format!(
                "{what} has {rows} x {columns} x {} values: it is a colour image; give one grey level for each pixel, as \
                 cv2.imread(file, cv2.IMREAD_UNCHANGED) of a grey file or skimage.color.rgb2gray give it",
                shape[2]
            );
            return Err(raise("ImageError", text));
        }
        _ => return Err(raise("ImageError", format!("{what} has the shape {shape:?}; {WANTED}"))),
    };
    let kind = array.dtype();
    let (letter, bytes) = (kind.kind(), kind.itemsize());
    // Of another order of bytes, or a float that is too fine or too coarse: NumPy brings it into one that is known.
    let wanted = match (letter, bytes) {
        (b'u', 1) => "uint8",
        (b'u', 2) => "uint16",
        (b'f', 2 | 4 | 8) => "float32",
        _ => {
            let text = format!("{what} is an array of {}; {WANTED} (float64 is rounded to float32)", kind.str()?);
            return Err(raise("ImageError", text));
        }
    };
    let options = PyDict::new(array.py());
    options.set_item("copy", false)?;
    let array = array.call_method("astype", (wanted,), Some(&options))?;
    let (rows, columns) = (shape[0], shape[1]);
    let pixels = match wanted {
        "uint8" => Pixels::U8(levels(&array)?),
        "uint16" => Pixels::U16(levels(&array)?),
        _ => Pixels::F32(levels(&array)?),
    };
    Image::new(columns, rows, pixels).map_err(|error| raise("ImageError", format!("{what}: {error}")))
}

/// The values of an array of any strides, row by row.
fn levels<T: Element + Copy>(array: &Bound<'_, PyAny>) -> PyResult<Vec<T>> {
    let array: PyReadonlyArray2<'_, T> = array.cast::<PyArray2<T>>()?.try_readonly().map_err(PyErr::from)?;
    let view = array.as_array();
    Ok(view.to_slice().map_or_else(|| view.iter().copied().collect(), <[T]>::to_vec))
}

/// The mask in an array of bool: where the image is measured.
pub fn mask_of(array: &Bound<'_, PyAny>) -> PyResult<Mask> {
    let numpy = array.py().import("numpy")?;
    let array = numpy.call_method1("asarray", (array,))?;
    let array = array.cast::<PyArray2<bool>>().map_err(|_| {
        PyTypeError::new_err(
            "the mask is no array of bool with two axes; give one such as image > 0, of the size of the reference",
        )
    })?;
    let (rows, columns) = (array.shape()[0], array.shape()[1]);
    let bits = levels(array.as_any())?;
    Mask::new(columns, rows, bits).ok_or_else(|| raise("ZoneError", "the mask holds no pixel".to_owned()))
}

/// The array that holds the grey levels of `image`, which are moved.
fn array_of(py: Python<'_>, image: Image) -> PyResult<Bound<'_, PyAny>> {
    let shape = (image.height(), image.width());
    fn made<T: Element>(py: Python<'_>, shape: (usize, usize), levels: Vec<T>) -> PyResult<Bound<'_, PyAny>> {
        let array = Array2::from_shape_vec(shape, levels).map_err(|error| raise("ImageError", error.to_string()))?;
        Ok(array.into_pyarray(py).into_any())
    }
    match image.into_pixels() {
        Pixels::U8(levels) => made(py, shape, levels),
        Pixels::U16(levels) => made(py, shape, levels),
        Pixels::F32(levels) => made(py, shape, levels),
    }
}

/// The image in a file and what there is to know about it: see `quadrille.read_image`.
#[pyfunction]
#[pyo3(signature = (path, page=0))]
pub fn read_image(py: Python<'_>, path: PathBuf, page: usize) -> PyResult<(Bound<'_, PyAny>, Vec<String>)> {
    let Loaded { image, notes, .. } = py.detach(|| quadrille::io::images::read_image(&path, page)).map_err(raised)?;
    Ok((array_of(py, image)?, notes))
}
