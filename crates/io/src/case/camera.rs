//! The camera of a case, and the files that hold one.

use super::{CaseError, over, parse_case};
use crate::camera::marked::{
    MarkedError, MarkedLength, MarkedPoint, Scaled, camera_of_points, scale_of_lengths, with_unknown_plane,
};
use crate::camera::{Camera, CameraError, CameraShape, Covariance, PARAMETERS, USUAL_DISTANCE, USUAL_DISTORTION};
use crate::opencv::{OpencvError, parse_opencv};
use crate::text::{read_file, text_of};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::io;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Standard uncertainty of a mark where none is stated, px: a click on a screen.
const MARK_STD_PX: f64 = 0.5;

/// How the camera sees the plane of the specimen (docs/theory/22-camera.md). With it strains, and all that is in mm,
/// are those of the plane; what is in px stays as the images show it.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(next_help_heading = "Input"))]
#[serde(deny_unknown_fields)]
pub struct CaseCamera {
    /// The camera: camera.toml of `quadrille calibrate`, or OpenCV's result as YAML or JSON. Keys beside it win over
    /// those of the file.
    #[cfg_attr(feature = "cli", arg(long = "camera", value_name = "FILE"))]
    pub file: Option<String>,
    /// Whether there is nothing to be known: no uncertainty of the camera is reckoned with, nor is a usual lens where
    /// no distortion is stated.
    #[schemars(extend("default" = false, "x-implied" = true))]
    #[cfg_attr(feature = "cli", arg(skip))]
    pub exact: Option<bool>,
    /// Columns and rows of the images that the camera is of. Default: those of the series.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub image_size_px: Option<[usize; 2]>,
    /// Length along x and y by which coordinates are divided before they are distorted, px: OpenCV's `fx`, `fy`.
    /// Default: half the diagonal, so that `k1` is the distortion at the corner.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub focal_px: Option<[f64; 2]>,
    /// Centre of distortion, px: OpenCV's `cx`, `cy`. Default: the middle of the image.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub centre_px: Option<[f64; 2]>,
    /// `[k1, k2, p1, p2, k3]` in OpenCV's meaning; those left out at the end are zero. Without it a usual lens is
    /// reckoned with: none, with a standard uncertainty of 0.1 % at the corner.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub distortion: Option<Vec<f64>>,
    /// Perspective of a plane that is not square to the camera, 1/px: along `[x, y]` the scale falls by this much per
    /// px.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub tilt_per_px: Option<[f64; 2]>,
    /// `[stretch, shear]` of a plane that is not square: by how much it is seen longer along x than along y, halved,
    /// and how skew.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub stretch: Option<[f64; 2]>,
    /// Standard uncertainties of `distortion`. Zero, or not stated: exact.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub distortion_std: Option<Vec<f64>>,
    /// Of `centre_px`.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub centre_px_std: Option<[f64; 2]>,
    /// Of `tilt_per_px`.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub tilt_per_px_std: Option<[f64; 2]>,
    /// Of `stretch`.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub stretch_std: Option<[f64; 2]>,
    /// Names of the parameters that `covariance` has a row for, instead of standard uncertainties: of `"k1"`, `"k2"`,
    /// `"p1"`, `"p2"`, `"k3"`, `"centre_x"`, `"centre_y"`, `"tilt_x"`, `"tilt_y"`, `"stretch"`, `"shear"`.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub covariance_of: Option<Vec<String>>,
    /// Their covariance, a row for each.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub covariance: Option<Vec<Vec<f64>>>,
    /// Size of a pixel in the plane at `centre_px`, mm; `[images] pixel_size_mm` where that is not given.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub pixel_size_mm: Option<f64>,
    /// Its relative standard uncertainty.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub pixel_size_relative_std: Option<f64>,
    /// Standard uncertainty of a relative change of the distance to the specimen from frame to frame, `dZ/Z`: it
    /// strains all that is seen by as much. Without it a usual one is reckoned with.
    #[schemars(extend("default" = 1e-4, "x-implied" = true))]
    #[cfg_attr(feature = "cli", arg(skip))]
    pub distance_std: Option<f64>,
    /// When the images of the calibration were taken, as their files say: `2024-05-01T10:11:12`. A run says where its own
    /// are of another day.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub taken: Option<String>,
    /// Whether the lens is telecentric: the scale does not change with the distance, and there is no perspective.
    #[schemars(extend("default" = false, "x-implied" = true))]
    #[cfg_attr(feature = "cli", arg(skip))]
    pub telecentric: Option<bool>,
    /// Names of zones in the plane of the specimen that do not deform, best on both sides of it. How they seem to move
    /// (shift, turn, scale) is the camera's, and is taken off each frame; `distance_std` is then not needed.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub still: Option<Vec<String>>,
    /// Points whose place is known, four or more: `[x, y, X, Y]`, px in the reference image and mm along any axes of the
    /// plane. They give `tilt_per_px`, `stretch` and `pixel_size_mm`, with their uncertainty.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub points: Option<Vec<[f64; 4]>>,
    /// Lengths that are known: `[x0, y0, x1, y1, mm]`, the ends in px. They give `pixel_size_mm`.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub lengths: Option<Vec<[f64; 5]>>,
    /// Standard uncertainty of where such a point or end was marked, px.
    #[schemars(extend("default" = 0.5, "x-implied" = true))]
    #[cfg_attr(feature = "cli", arg(skip))]
    pub mark_std_px: Option<f64>,
}

/// Why a camera cannot be taken.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CaseCameraError {
    /// There is no such file.
    #[error("{}: there is no such camera file", .0.display())]
    NotFound(PathBuf),
    /// The system refuses to read it.
    #[error("{}: cannot be read", .0.display())]
    Io(PathBuf, #[source] io::Error),
    /// It is no text.
    #[error("{}:{line}: this is no text; give camera.toml, or OpenCV's YAML or JSON", path.display())]
    NotText {
        /// The file.
        path: PathBuf,
        /// Its first line that is none.
        line: usize,
    },
    /// It is no case file with a camera.
    #[error(transparent)]
    Case(#[from] Box<CaseError>),
    /// It is no result of OpenCV.
    #[error("{}: {error}", path.display())]
    Opencv {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        error: OpencvError,
    },
    /// The file has no `[camera]`, or names another file.
    #[error("{}: it has no section [camera] with numbers; `quadrille calibrate` writes one", .0.display())]
    NoCamera(PathBuf),
    /// A key has no sense.
    #[error("[camera] {key}: {what}")]
    Key {
        /// Which.
        key: &'static str,
        /// What is wrong, and what to do.
        what: String,
    },
    /// The numbers are no camera.
    #[error("[camera]: {0}")]
    Camera(#[from] CameraError),
    /// The points or lengths are of no use.
    #[error("[camera]: {0}")]
    Marked(#[from] MarkedError),
}

impl CaseCamera {
    /// With numbers in the place of its file, which starts at the folder `base`, and of its points or lengths.
    ///
    /// # Errors
    /// A file that cannot be read, or holds no camera; points or lengths that are of no use.
    pub fn resolved(&self, base: &Path) -> Result<Self, CaseCameraError> {
        let Some(name) = &self.file else { return self.without_marks() };
        let of_file = read_camera(&base.join(name))?;
        let own = Self { file: None, ..self.clone() };
        over(&own, &of_file).map_err(|what| CaseCameraError::Key { key: "file", what })?.without_marks()
    }

    /// With the numbers that points or lengths give in their place.
    fn without_marks(&self) -> Result<Self, CaseCameraError> {
        let key = |key, what: &str| CaseCameraError::Key { key, what: what.to_owned() };
        let unmarked = Self { points: None, lengths: None, mark_std_px: None, ..self.clone() };
        let kind = match (&self.points, &self.lengths) {
            (None, None) => return Ok(unmarked),
            (Some(_), _) => "points",
            (None, Some(_)) => "lengths",
        };
        let size =
            self.image_size_px.ok_or_else(|| key(kind, "give image_size_px with them, of the image they are in"))?;
        if self.pixel_size_mm.is_some() {
            return Err(key(kind, "they give the size of a pixel, and pixel_size_mm is given as well; take one away"));
        }
        let before = Self { exact: None, ..unmarked.clone() }.camera(size)?;
        // A telecentric camera sees no perspective.
        let is_open = self.points.is_some() && self.telecentric != Some(true);
        let before = if is_open { with_unknown_plane(&before)? } else { before };
        let Some(Scaled { camera, pixel_size_mm, relative_std, .. }) = self.scaled(&before)? else {
            return Ok(unmarked);
        };
        let found = Self {
            pixel_size_mm: Some(pixel_size_mm),
            pixel_size_relative_std: Some(relative_std),
            distance_std: self.distance_std,
            still: self.still.clone(),
            exact: self.exact,
            taken: self.taken.clone(),
            telecentric: self.telecentric,
            ..Self::of(&camera)
        };
        Ok(found)
    }

    /// The plane and scale that its points or lengths give to `camera`; nothing where it has none.
    ///
    /// # Errors
    /// Both kinds, and what is of no use.
    pub fn scaled(&self, camera: &Camera) -> Result<Option<Scaled>, CaseCameraError> {
        let std = self.mark_std_px.unwrap_or(MARK_STD_PX);
        let point = |&[x, y, a, b]: &[f64; 4]| MarkedPoint { px: [x, y], mm: [a, b] };
        let length = |&[a, b, c, d, mm]: &[f64; 5]| MarkedLength { ends: [[a, b], [c, d]], mm };
        match (&self.points, &self.lengths) {
            (None, None) => Ok(None),
            (Some(points), None) => {
                Ok(Some(camera_of_points(camera, &points.iter().map(point).collect::<Vec<_>>(), std)?))
            }
            (None, Some(lengths)) => {
                Ok(Some(scale_of_lengths(camera, &lengths.iter().map(length).collect::<Vec<_>>(), std)?))
            }
            (Some(_), Some(_)) => Err(CaseCameraError::Key {
                key: "points",
                what: "lengths are given as well; points hold the lengths between them: give one kind".to_owned(),
            }),
        }
    }

    /// The section of a camera.
    pub fn of(camera: &Camera) -> Self {
        let CameraShape { image_size_px, focal_px, theta, covariance, distance_std, still } = camera.shape();
        let &[k1, k2, p1, p2, k3, centre_x, centre_y, tilt_x, tilt_y, stretch, shear] = theta;
        let unless_zero = |pair: [f64; 2]| Some(pair).filter(|pair| *pair != [0.0; 2]);
        let names = || covariance.of.iter().filter_map(|&k| Some((*PARAMETERS.get(k)?).to_owned())).collect();
        let is_uncertain = !covariance.of.is_empty();
        Self {
            image_size_px: Some(*image_size_px),
            focal_px: Some(*focal_px),
            centre_px: Some([centre_x, centre_y]),
            distortion: Some(vec![k1, k2, p1, p2, k3]),
            tilt_per_px: unless_zero([tilt_x, tilt_y]),
            stretch: unless_zero([stretch, shear]),
            covariance_of: is_uncertain.then(names),
            covariance: is_uncertain.then(|| covariance.matrix.clone()),
            distance_std: Some(*distance_std).filter(|std| *std != 0.0),
            still: Some(still.clone()).filter(|still| !still.is_empty()),
            ..Self::default()
        }
    }

    /// Whether it says how the plane is seen.
    pub fn states_camera(&self) -> bool {
        self.distortion.is_some() || self.tilt_per_px.is_some() || self.stretch.is_some() || self.covariance.is_some()
    }

    /// The camera of images of this size.
    ///
    /// # Errors
    /// Numbers that are no camera, one of other images, two kinds of uncertainty.
    pub fn camera(&self, images: [usize; 2]) -> Result<Camera, CaseCameraError> {
        let key = |key, what: &str| CaseCameraError::Key { key, what: what.to_owned() };
        let mut shape = CameraShape::plain(self.image_size_px.unwrap_or(images));
        shape.focal_px = self.focal_px.unwrap_or(shape.focal_px);
        five(&mut shape.theta, self.distortion.as_deref())
            .ok_or_else(|| key("distortion", "give at most five numbers, k1, k2, p1, p2, k3"))?;
        for (k, pair) in [(5, self.centre_px), (7, self.tilt_per_px), (9, self.stretch)] {
            put(&mut shape.theta, k, pair);
        }
        shape.still = self.still.clone().unwrap_or_default();
        let is_known = self.telecentric == Some(true) || !shape.still.is_empty();
        shape.distance_std = self.distance_std.unwrap_or(if is_known { 0.0 } else { USUAL_DISTANCE });
        if self.telecentric == Some(true) {
            let is_tilted = [self.tilt_per_px, self.tilt_per_px_std].iter().flatten().flatten().any(|v| *v != 0.0);
            if is_tilted || shape.distance_std != 0.0 {
                let what = "true, where a perspective or a change of the distance is stated; take that away";
                return Err(key("telecentric", what));
            }
        }
        shape.covariance = self.uncertainty()?;
        if self.exact == Some(true) {
            (shape.covariance, shape.distance_std) = (Covariance::default(), 0.0);
        }
        if let Some(relative) = self.pixel_size_relative_std.filter(|std| !(std.is_finite() && *std >= 0.0)) {
            let what = format!("{relative} is no standard uncertainty; give a finite number, 0 where it is exact");
            return Err(CaseCameraError::Key { key: "pixel_size_relative_std", what });
        }
        let camera = Camera::new(shape)?;
        camera.check_images(images)?;
        Ok(camera)
    }

    fn uncertainty(&self) -> Result<Covariance, CaseCameraError> {
        let key = |key, what: String| CaseCameraError::Key { key, what };
        let mut std = [0.0; PARAMETERS.len()];
        five(&mut std, self.distortion_std.as_deref())
            .ok_or_else(|| key("distortion_std", "give at most five numbers, k1, k2, p1, p2, k3".into()))?;
        for (k, pair) in [(5, self.centre_px_std), (7, self.tilt_per_px_std), (9, self.stretch_std)] {
            put(&mut std, k, pair);
        }
        if let Some((what, &value)) = PARAMETERS.into_iter().zip(&std).find(|(_, v)| !(v.is_finite() && **v >= 0.0)) {
            return Err(CameraError::Std { what, value }.into());
        }
        let (Some(names), Some(matrix)) = (&self.covariance_of, &self.covariance) else {
            if self.covariance.is_some() || self.covariance_of.is_some() {
                return Err(key("covariance", "give covariance_of with it, the names of its rows".into()));
            }
            if !self.states_camera() {
                std[0] = USUAL_DISTORTION;
            }
            return Ok(Covariance::of_std(&std));
        };
        if std.iter().any(|s| *s != 0.0) {
            return Err(key("covariance", "standard uncertainties are given as well; take one of them away".into()));
        }
        let place = |name: &String| {
            let at = PARAMETERS.iter().position(|known| known == name);
            at.ok_or_else(|| key("covariance_of", format!("there is no '{name}'; there are {}", PARAMETERS.join(", "))))
        };
        let of = names.iter().map(place).collect::<Result<Vec<_>, _>>()?;
        if of.windows(2).any(|pair| pair.first() >= pair.last()) {
            return Err(key("covariance_of", format!("name each once, in this order: {}", PARAMETERS.join(", "))));
        }
        Ok(Covariance { of, matrix: matrix.clone() })
    }
}

/// Puts up to five numbers at the begin of `theta`; `None` of more.
fn five(theta: &mut [f64], numbers: Option<&[f64]>) -> Option<()> {
    let numbers = numbers.unwrap_or_default();
    theta.iter_mut().zip(numbers).for_each(|(place, v)| *place = *v);
    (numbers.len() <= 5).then_some(())
}

fn put(theta: &mut [f64], k: usize, pair: Option<[f64; 2]>) {
    theta.iter_mut().skip(k).zip(pair.iter().flatten()).for_each(|(place, v)| *place = *v);
}

/// The camera in a file: `camera.toml`, or a result of OpenCV (YAML, XML is refused, or JSON).
///
/// # Errors
/// A file that cannot be read, or holds no camera.
pub fn read_camera(path: &Path) -> Result<CaseCamera, CaseCameraError> {
    let bytes = read_file(path, CaseCameraError::NotFound, CaseCameraError::Io)?;
    parse_camera(&bytes, path)
}

/// The same of the content `bytes`; `path` stands in messages, and its ending says what it is.
///
/// # Errors
/// As [`read_camera`], but nothing is read.
pub fn parse_camera(bytes: &[u8], path: &Path) -> Result<CaseCamera, CaseCameraError> {
    let text = text_of(bytes).map_err(|line| CaseCameraError::NotText { path: path.to_owned(), line })?;
    if path.extension().is_some_and(|ending| ending == "toml") {
        let case = parse_case(text, path).map_err(Box::new)?;
        let camera = case.camera.filter(|camera| camera.file.is_none());
        return camera.ok_or_else(|| CaseCameraError::NoCamera(path.to_owned()));
    }
    let found = parse_opencv(text).map_err(|error| CaseCameraError::Opencv { path: path.to_owned(), error })?;
    Ok(CaseCamera {
        image_size_px: found.image_size_px,
        focal_px: Some(found.focal_px),
        centre_px: Some(found.centre_px),
        distortion: Some(found.distortion),
        ..CaseCamera::default()
    })
}

/// The text of `camera.toml`; reading it gives an equal section. Comments stand at its head.
pub fn write_camera(camera: &CaseCamera, comments: &[String]) -> String {
    let case = super::CaseFile { camera: Some(camera.clone()), ..super::CaseFile::default() };
    let head: String = comments.iter().map(|line| format!("# {line}\n")).collect();
    format!("{head}{}", case.to_toml())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<CaseCamera, CaseCameraError> {
        parse_camera(text.as_bytes(), Path::new("camera.toml"))
    }

    fn refused(text: &str, part: &str) {
        let said = parse(text).and_then(|section| section.camera([640, 480])).unwrap_err().to_string();
        assert!(said.contains(part), "{text}: {said}");
    }

    #[test]
    fn a_camera_is_written_as_it_is_read() {
        let text = "[camera]\nimage_size_px = [640, 480]\ndistortion = [1e-3, -2e-4]\ntilt_per_px = [1e-5, 0.0]\n\
                    covariance_of = ['k1', 'tilt_x']\ncovariance = [[4e-8, 1e-11], [1e-11, 1e-12]]\n\
                    pixel_size_mm = 0.05\npixel_size_relative_std = 1e-3\ndistance_std = 1e-4\nstill = ['left', 'right']";
        let section = parse(text).unwrap();
        let camera = section.camera([640, 480]).unwrap();
        let again = CaseCamera {
            pixel_size_mm: section.pixel_size_mm,
            pixel_size_relative_std: section.pixel_size_relative_std,
            ..CaseCamera::of(&camera)
        };
        let read = parse(&write_camera(&again, &["a camera".into()])).unwrap();
        assert_eq!((read.camera([640, 480]).unwrap(), &read), (camera, &again));
        assert_eq!(read.pixel_size_mm, Some(0.05));
    }

    #[test]
    fn what_a_camera_cannot_be_is_named_by_its_key() {
        refused("[camera]\ndistortion = [1, 2, 3, 4, 5, 6]", "[camera] distortion: give at most five");
        refused("[camera]\ndistortion_std = [-1e-3]", "uncertainty of k1 is -0.001");
        refused("[camera]\ndistortion = [nan]", "k1 is NaN");
        refused("[camera]\ndistortion = [-0.6]", "folds inside the image");
        refused("[camera]\ndistance_std = -1", "the distance is -1");
        refused("[camera]\ntelecentric = true\ntilt_per_px = [1e-5, 0]", "telecentric: true, where a perspective");
        refused("[camera]\nfocal_px = [0, 1]", "focal_px is 0");
        refused("[camera]\npixel_size_relative_std = nan", "pixel_size_relative_std: NaN");
        refused("[camera]\ncovariance = [[1.0]]", "covariance_of");
        refused("[camera]\ncovariance_of = ['k9']\ncovariance = [[1.0]]", "no 'k9'");
        refused("[camera]\ncovariance_of = ['k2', 'k1']\ncovariance = [[1.0, 0.0], [0.0, 1.0]]", "in this order");
        refused("[camera]\ncovariance_of = ['k1']\ncovariance = [[-1.0]]", "not above zero");
        refused("[camera]\nimage_size_px = [480, 640]\ndistortion = [0.0]", "they are turned");
        refused("[camera]\nimage_size_px = [512, 512]", "calibrate with images of this size");
        refused("[camera]\nfile = 'other.toml'", "no section [camera] with numbers");
        refused("[images]", "no section [camera] with numbers");
        refused("[camera]\nlense = 1", "lense");
    }

    #[test]
    fn points_and_lengths_become_numbers_and_what_they_cannot_be_is_named() {
        let marked = |text: &str| parse(&format!("[camera]\n{text}")).unwrap().resolved(Path::new(""));
        let found = marked("image_size_px = [640, 480]\nlengths = [[100, 100, 500, 100, 20]]\nexact = true").unwrap();
        assert_eq!((found.lengths.as_ref(), found.exact), (None, Some(true)));
        assert!((found.pixel_size_mm.unwrap() - 0.05).abs() < 1e-12);
        // Both ends off by half a pixel.
        let relative = found.pixel_size_relative_std.unwrap();
        assert!((relative - 0.5 * 2f64.sqrt() / 400.0).abs() < 1e-5, "{relative}");
        let square = "points = [[100, 100, 0, 0], [500, 100, 20, 0], [500, 400, 20, 15], [100, 400, 0, 15]]";
        let found = marked(&format!("image_size_px = [640, 480]\ndistance_std = 0\n{square}")).unwrap();
        assert_eq!(found.covariance_of.as_ref().map(Vec::len), Some(5), "k1, tilts, stretch and shear");
        assert!((found.pixel_size_mm.unwrap() - 0.05).abs() < 1e-6 && found.distance_std == Some(0.0));
        let refused = |text: &str, part: &str| {
            let said = marked(text).unwrap_err().to_string();
            assert!(said.contains(part), "{text}: {said}");
        };
        refused(square, "points: give image_size_px");
        refused(&format!("image_size_px = [640, 480]\npixel_size_mm = 0.05\n{square}"), "take one away");
        refused(&format!("image_size_px = [640, 480]\nlengths = [[0, 0, 1, 1, 1]]\n{square}"), "give one kind");
        refused("image_size_px = [640, 480]\npoints = [[1, 1, 0, 0]]", "four or more");
        refused("image_size_px = [640, 480]\nlengths = []", "four or more, or one length");
    }

    #[test]
    fn nothing_stated_is_a_usual_lens_and_exact_is_none() {
        let usual = CaseCamera::default().camera([640, 480]).unwrap();
        assert_eq!(usual, Camera::usual([640, 480]).unwrap());
        let exact = CaseCamera { exact: Some(true), ..CaseCamera::default() }.camera([640, 480]).unwrap();
        assert!(exact.is_plain() && exact.is_exact());
        let distance = |text: &str| parse(text).unwrap().camera([640, 480]).unwrap().shape().distance_std;
        assert_eq!(distance("[camera]\ndistortion = [1e-3]"), USUAL_DISTANCE);
        assert_eq!(distance("[camera]\ndistance_std = 0"), 0.0);
        assert_eq!(distance("[camera]\ntelecentric = true"), 0.0);
        assert_eq!(distance("[camera]\nstill = ['rail']"), 0.0);
    }
}
