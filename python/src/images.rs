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
use quadrille::imaging::{Image, ImageError, Pixels, SharedPixels};
use quadrille::io::images::Loaded;
use quadrille::mesh::Mask;
use std::path::PathBuf;
use std::sync::Arc;

/// What `array` is said to be when it is none of these.
const WANTED: &str = "give an array of uint8, uint16 or float32 with two axes: rows, columns";

/// Whether the grey levels of an array are copied.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Levels {
    /// What is kept: who gave the array may change it afterwards.
    Copied,
    /// What is looked at during a call alone, where the array has the layout of an image: rows behind one another.
    Borrowed,
}

/// The image in `array`, or in the file that it names.
pub fn image_of(array: &Bound<'_, PyAny>, what: &str, levels: Levels) -> PyResult<Image> {
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
        (b'i', _) | (b'u', _) => return Err(raise("ImageError", whole_numbers(&array, what)?)),
        _ => {
            let text = format!("{what} is an array of {}; {WANTED} (float64 is rounded to float32)", kind.str()?);
            return Err(raise("ImageError", text));
        }
    };
    let options = PyDict::new(array.py());
    options.set_item("copy", false)?;
    let array = array.call_method("astype", (wanted,), Some(&options))?;
    let (rows, columns) = (shape[0], shape[1]);
    let image = match wanted {
        "uint8" => made(&array, levels, [columns, rows], Pixels::U8, |lent| SharedPixels::U8(lent)),
        "uint16" => made(&array, levels, [columns, rows], Pixels::U16, |lent| SharedPixels::U16(lent)),
        _ => made(&array, levels, [columns, rows], Pixels::F32, |lent| SharedPixels::F32(lent)),
    };
    image?.map_err(|error| raise("ImageError", format!("{what}: {error}")))
}

/// What is said of an array of whole numbers that do not tell how many bits a pixel had: which cast keeps its grey levels.
fn whole_numbers(array: &Bound<'_, PyAny>, what: &str) -> PyResult<String> {
    let kind = array.getattr("dtype")?.str()?;
    let initial = PyDict::new(array.py());
    initial.set_item("initial", 0)?;
    let end = |name: &str| array.call_method(name, (), Some(&initial))?.extract::<i128>();
    let (least, most) = (end("min")?, end("max")?);
    let cure = match (least, most) {
        (0, ..=255) => "image.astype(numpy.uint8) keeps them as they are (uint16, where the camera has more bits)",
        (0, ..=65535) => "image.astype(numpy.uint16) keeps them as they are",
        _ => "an image has none below 0 or above 65535; image.astype(numpy.float32) takes any",
    };
    Ok(format!("{what} is an array of {kind}, which no camera writes; its grey levels are {least} to {most}: {cure}"))
}

/// The image of an array of one kind.
fn made<T: Element + Copy + Send + Sync>(
    array: &Bound<'_, PyAny>,
    levels: Levels,
    [columns, rows]: [usize; 2],
    own: impl FnOnce(Vec<T>) -> Pixels,
    shared: impl FnOnce(Arc<Lent<T>>) -> SharedPixels,
) -> PyResult<Result<Image, ImageError>> {
    if levels == Levels::Borrowed
        && let Some(lent) = Lent::of(array.cast::<PyArray2<T>>()?)
    {
        return Ok(Image::shared(columns, rows, shared(Arc::new(lent))));
    }
    Ok(Image::new(columns, rows, own(copied(array)?)))
}

/// The values of an array that is kept alive.
struct Lent<T: Element> {
    values: *const T,
    len: usize,
    /// Whose they are.
    _array: Py<PyArray2<T>>,
}

impl<T: Element> Lent<T> {
    /// `None` where its rows do not lie one behind the other, from the first to the last.
    fn of(array: &Bound<'_, PyArray2<T>>) -> Option<Self> {
        let whole = array.is_c_contiguous() && array.data().is_aligned();
        whole.then(|| Self { values: array.data().cast_const(), len: array.len(), _array: array.clone().unbind() })
    }
}

impl<T: Element> AsRef<[T]> for Lent<T> {
    fn as_ref(&self) -> &[T] {
        // SAFETY: `of` has seen that the array is aligned and without gaps; NumPy does not move or free the memory of
        // an array that is referred to (it refuses to resize it). Of other threads that write into it
        // meanwhile, the documentation asks not to, as NumPy's own functions do, which read without the lock of
        // the interpreter as well.
        #[expect(unsafe_code, reason = "grey levels are not copied")]
        unsafe {
            std::slice::from_raw_parts(self.values, self.len)
        }
    }
}

// SAFETY: the values are numbers, which nobody changes through this, and the array is only kept.
#[expect(unsafe_code, reason = "the pointer is that of an array that is kept alive")]
unsafe impl<T: Element + Sync> Send for Lent<T> {}
// SAFETY: as for Send.
#[expect(unsafe_code, reason = "the pointer is that of an array that is kept alive")]
unsafe impl<T: Element + Sync> Sync for Lent<T> {}

/// The values of an array of any strides, row by row.
fn copied<T: Element + Copy>(array: &Bound<'_, PyAny>) -> PyResult<Vec<T>> {
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
    let bits = copied(array.as_any())?;
    Mask::new(columns, rows, bits).ok_or_else(|| raise("ZoneError", "the mask holds no pixel".to_owned()))
}

/// The array that holds the grey levels of `image`, which are moved.
fn array_of(py: Python<'_>, image: Image) -> PyResult<Bound<'_, PyAny>> {
    let shape = (image.height(), image.width());
    fn moved<T: Element>(py: Python<'_>, shape: (usize, usize), levels: Vec<T>) -> PyResult<Bound<'_, PyAny>> {
        let array = Array2::from_shape_vec(shape, levels).map_err(|error| raise("ImageError", error.to_string()))?;
        Ok(array.into_pyarray(py).into_any())
    }
    match image.into_pixels() {
        Pixels::U8(levels) => moved(py, shape, levels),
        Pixels::U16(levels) => moved(py, shape, levels),
        Pixels::F32(levels) => moved(py, shape, levels),
    }
}

/// The image in a file and what there is to know about it: see `quadrille.read_image`.
#[pyfunction]
#[pyo3(signature = (path, page=0))]
pub fn read_image(py: Python<'_>, path: PathBuf, page: usize) -> PyResult<(Bound<'_, PyAny>, Vec<String>)> {
    let Loaded { image, notes, .. } = py.detach(|| quadrille::io::images::read_image(&path, page)).map_err(raised)?;
    Ok((array_of(py, image)?, notes))
}
