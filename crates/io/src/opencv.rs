//! Results of a calibration by OpenCV: the YAML and JSON of its `FileStorage` and of its samples, the YAML of ROS, and
//! JSON that a script has made of its arrays.

use serde_json::Value;
use std::str::FromStr;
use thiserror::Error;

/// What such a file holds.
#[derive(Debug, Clone, PartialEq)]
pub struct OpencvCamera {
    /// Columns and rows of the images, where they are noted.
    pub image_size_px: Option<[usize; 2]>,
    /// `fx` and `fy`.
    pub focal_px: [f64; 2],
    /// `cx` and `cy`.
    pub centre_px: [f64; 2],
    /// k1, k2, p1, p2, k3.
    pub distortion: Vec<f64>,
}

/// Why a file is no such result.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum OpencvError {
    /// XML, which OpenCV writes as well.
    #[error("this is XML; write OpenCV's result as .yml or .json, or give camera.toml")]
    Xml,
    /// No JSON.
    #[error("this is no JSON: {0}")]
    Json(String),
    /// A matrix is missing.
    #[error("there is no {0} with numbers; is this a result of OpenCV's calibration?")]
    Missing(&'static str),
    /// A matrix has another size.
    #[error("{what} has {found} numbers, expected {wanted}")]
    Size {
        /// Which.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many there should be.
        wanted: &'static str,
    },
    /// Coefficients of another model.
    #[error(
        "{0} is not zero: this is a rational, thin-prism, tilted or fish-eye model; calibrate with k1, k2, p1, p2, k3 alone"
    )]
    OtherModel(&'static str),
    /// A camera matrix that is none.
    #[error("the camera matrix has a skew, or no third row 0, 0, 1")]
    Skew,
}

/// Keys under which the same is found, in the order of their use.
const MATRIX: [&str; 5] = ["camera_matrix", "cameraMatrix", "Camera_Matrix", "K", "mtx"];
const DISTORTION: [&str; 7] =
    ["distortion_coefficients", "Distortion_Coefficients", "distCoeffs", "dist_coeffs", "dist_coeff", "dist", "D"];
const WIDTH: [&str; 2] = ["image_width", "image_Width"];
const HEIGHT: [&str; 2] = ["image_height", "image_Height"];

/// The camera in the text of a file.
///
/// ```
/// # use quadrille_io as quadrille;
/// let lines = [
///     "%YAML:1.0",
///     "image_width: 640",
///     "image_height: 480",
///     "camera_matrix: !!opencv-matrix",
///     "   data: [ 900., 0., 320., 0., 905., 240., 0., 0., 1. ]",
///     "distortion_coefficients: !!opencv-matrix",
///     "   data: [ -0.1, 0.02, 0., 0., 0. ]",
/// ];
/// let camera = quadrille::io::opencv::parse_opencv(&lines.join("\n")).unwrap();
/// assert_eq!((camera.focal_px, camera.centre_px), ([900.0, 905.0], [320.0, 240.0]));
/// assert_eq!((camera.distortion[0], camera.image_size_px), (-0.1, Some([640, 480])));
/// ```
///
/// # Errors
/// XML, text without the two matrices, coefficients of another model.
pub fn parse_opencv(text: &str) -> Result<OpencvCamera, OpencvError> {
    let start = text.trim_start();
    if start.starts_with('<') {
        return Err(OpencvError::Xml);
    }
    let json = start.starts_with('{').then(|| serde_json::from_str::<Value>(text)).transpose();
    let json = json.map_err(|error| OpencvError::Json(error.to_string()))?;
    let numbers = |keys: &[&str]| -> Option<Vec<f64>> {
        keys.iter().find_map(|key| match &json {
            Some(json) => {
                let mut list = Vec::new();
                flatten(json.get(key)?, &mut list)?;
                Some(list)
            }
            None => of_yaml(text, key),
        })
    };
    let matrix = numbers(&MATRIX).ok_or(OpencvError::Missing("camera_matrix"))?;
    let [fx, skew, cx, a, fy, cy, b, c, one] = *matrix.as_slice() else {
        return Err(OpencvError::Size { what: "camera_matrix", found: matrix.len(), wanted: "9" });
    };
    if [skew, a, b, c].iter().any(|v| *v != 0.0) || one != 1.0 {
        return Err(OpencvError::Skew);
    }
    let mut distortion = numbers(&DISTORTION).ok_or(OpencvError::Missing("distortion_coefficients"))?;
    if !(4..=14).contains(&distortion.len()) {
        return Err(OpencvError::Size {
            what: "distortion_coefficients",
            found: distortion.len(),
            wanted: "4 or 5, or more that are zero",
        });
    }
    const FURTHER: [&str; 9] = ["k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y"];
    if let Some((name, _)) = FURTHER.into_iter().zip(distortion.iter().skip(5)).find(|(_, v)| **v != 0.0) {
        return Err(OpencvError::OtherModel(name));
    }
    distortion.truncate(5);
    let of_size = |keys: &[&str]| numbers(keys).and_then(|list| list.first().copied());
    let whole = |v: f64| (v.fract() == 0.0 && (1.0..=1e6).contains(&v)).then_some(v as usize);
    let size = of_size(&WIDTH).and_then(whole).zip(of_size(&HEIGHT).and_then(whole));
    let image_size_px = size.map(|(width, height)| [width, height]);
    Ok(OpencvCamera { image_size_px, focal_px: [fx, fy], centre_px: [cx, cy], distortion })
}

/// All numbers of a value, row by row: of a matrix as `FileStorage` writes it those of its `data`.
fn flatten(value: &Value, list: &mut Vec<f64>) -> Option<()> {
    match value {
        Value::Number(number) => list.push(number.as_f64()?),
        Value::Array(values) => values.iter().try_for_each(|value| flatten(value, list))?,
        Value::Object(_) => flatten(value.get("data")?, list)?,
        _ => return None,
    }
    Some(())
}

/// The numbers under a key of the first level: those in the brackets of its `data`, or the one behind it.
fn of_yaml(text: &str, key: &str) -> Option<Vec<f64>> {
    let mut at = 0;
    let begin = text.split_inclusive('\n').find_map(|line| {
        let here = at;
        at += line.len();
        line.strip_prefix(key)?.strip_prefix(':').map(|_| here + key.len() + 1)
    })?;
    let behind = text.get(begin..)?;
    // The key has all lines behind it that are indented, or go on with a list.
    let of_key = |line: &&str| line.starts_with([' ', '\t', '-', ']']) || line.trim().is_empty();
    let first = behind.split_inclusive('\n').next().unwrap_or_default();
    let rest = behind.get(first.len()..).unwrap_or_default().split_inclusive('\n').take_while(of_key);
    let block = behind.get(..first.len() + rest.map(str::len).sum::<usize>())?;
    let number = |word: &str| f64::from_str(word.trim()).ok();
    let Some((_, list)) = block.split_once('[') else { return Some(vec![number(block)?]) };
    // Rows of their own brackets as well.
    let list = list.rsplit_once(']')?.0;
    let words = list.split(|c: char| c == ',' || c == '[' || c == ']' || c.is_whitespace());
    words.filter(|word| !word.is_empty()).map(number).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const JSON: &str = r#"{"image_width": 640, "image_height": 480,
        "camera_matrix": {"type_id": "opencv-matrix", "rows": 3, "cols": 3, "dt": "d",
            "data": [900.0, 0.0, 320.0, 0.0, 905.0, 240.0, 0.0, 0.0, 1.0]},
        "distortion_coefficients": {"type_id": "opencv-matrix", "rows": 1, "cols": 5, "dt": "d",
            "data": [-0.1, 0.02, 1e-4, -2e-4, 0.003]}}"#;

    #[test]
    fn the_same_camera_is_read_from_every_form() {
        let wanted = parse_opencv(JSON).unwrap();
        assert_eq!(wanted.distortion, [-0.1, 0.02, 1e-4, -2e-4, 0.003]);
        let script =
            r#"{"mtx": [[900, 0, 320], [0, 905, 240], [0, 0, 1]], "dist": [[-0.1, 0.02, 1e-4, -2e-4, 0.003]]}"#;
        assert_eq!(parse_opencv(script).unwrap(), OpencvCamera { image_size_px: None, ..wanted.clone() });
        let ros = "image_width: 640\nimage_height: 480\ncamera_name: head\ncamera_matrix:\n  rows: 3\n  cols: 3\n  \
                   data: [900, 0, 320, 0, 905, 240, 0, 0, 1]\ndistortion_model: plumb_bob\ndistortion_coefficients:\n  \
                   rows: 1\n  cols: 5\n  data: [-0.1, 0.02, 1e-4, -2e-4, 0.003]\nrectification_matrix:\n  data: [1, 0]\n";
        assert_eq!(parse_opencv(ros).unwrap(), wanted);
    }

    #[test]
    fn what_is_no_camera_is_refused_in_words() {
        let with = |from: &str, to: &str| parse_opencv(&JSON.replace(from, to)).unwrap_err();
        assert_eq!(parse_opencv("<?xml version=\"1.0\"?>"), Err(OpencvError::Xml));
        assert!(matches!(parse_opencv("{"), Err(OpencvError::Json(_))));
        assert_eq!(parse_opencv("a: 1\n"), Err(OpencvError::Missing("camera_matrix")));
        assert_eq!(with("distortion_coefficients", "other"), OpencvError::Missing("distortion_coefficients"));
        assert!(matches!(with("320.0, ", ""), OpencvError::Size { found: 8, .. }));
        assert_eq!(with("0.003]", "0.003, 0.5, 0, 0]"), OpencvError::OtherModel("k4"));
        assert_eq!(with("900.0, 0.0", "900.0, 2.0"), OpencvError::Skew);
        assert!(parse_opencv("camera_matrix: [1, 2").is_err());
        assert!(parse_opencv("K: [nan, 0, 1").is_err());
    }
}
