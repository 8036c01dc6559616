//! The camera from images of the specimen that was moved, from points, from lengths.

use crate::camera::calibrate::{Calibration, calibrate as camera_of};
use crate::camera::marked::{Scaled, unknown_plane};
use crate::camera::{Camera, PARAMETERS};
use crate::field::{Measurement, Status};
use crate::io::case::{CaseCamera, CaseFile, write_camera};
use crate::io::images::Accepted;
use crate::io::series::{Frame, expand_series};
use crate::io::store::{STORE, Store};
use crate::report::Backdrop;
use crate::run::RunFolder;
use crate::run::calibration::asked::{Calibrated, Calibrating};
use crate::run::calibration::found::{draw_residual, said_of, said_of_tried};
use crate::run::calibration::target::{asked_target, of_target};
use crate::run::folder::run_folder::FIGURES;
use crate::run::look::reference::reference;
use crate::run::plan::{Plan, Request, Session};
use crate::run::series::files::run_series;
use crate::run::words::{Result, Watcher, plural};
use crate::units::Px;
use rayon::ThreadPool;
use std::path::Path;

/// What is written, to be named by `--camera`.
const CAMERA: &str = "camera.toml";

/// Finds the camera and writes `camera.toml` into `output`, beside the run that shows it.
///
/// # Errors
/// See [`crate::run::RunError`]: also images that do not determine a camera.
pub fn calibrate(
    asked: &Calibrating,
    output: &Path,
    session: Session,
    pool: &ThreadPool,
    watcher: Watcher<'_>,
) -> Result<Calibrated> {
    let marks = marks(asked);
    // What is to be found is not stated.
    let camera = Some(CaseCamera { exact: Some(true), ..CaseCamera::default() });
    let case = CaseFile { camera, ..asked.case.clone() };
    let request = &asked.request;
    if request.camera.file.is_some() {
        return Err("--camera: the camera is what is to be found; leave it out".into());
    }
    let target = asked_target(asked)?;
    let folder = RunFolder::writable(output)?;
    if let Some(target) = target {
        let (scaled, mut said) = pool.install(|| of_target(target, request, &case, &folder))?;
        said.push(said_of_scale(Some(&scaled)));
        return write(asked, &folder, &scaled.camera, Some(&scaled), said);
    }
    let alone = match request.images.deformed.as_deref() {
        Some([name]) if (marks.points.is_some() || marks.lengths.is_some()) && request.images.reference.is_none() => {
            Some(name)
        }
        _ => None,
    };
    let (camera, mut said) = match alone {
        Some(name) => {
            let image = Frame::named(name, 0).read(Accepted::ANY)?.image;
            (unknown_plane([image.width(), image.height()])?, Vec::new())
        }
        None => {
            run_series(&Plan::of(request, &case)?, &folder, pool, session, watcher)?;
            let found = pool.install(|| of_series(&folder))?;
            (found.camera.clone(), verdict(&found))
        }
    };
    let scaled = marks.scaled(&camera)?;
    let camera = scaled.as_ref().map_or(camera, |scaled| scaled.camera.clone());
    said.push(said_of_scale(scaled.as_ref()));
    if alone.is_some() {
        let what = "lens: nothing is seen of it on one image; a usual one is reckoned with (0.1 % at the corner). Two more images, \
                    the specimen moved across and along, tell";
        said.push(what.to_owned());
    }
    write(asked, &folder, &camera, scaled.as_ref(), said)
}

/// Writes the camera, with what there is to say.
fn write(
    asked: &Calibrating,
    folder: &RunFolder,
    camera: &Camera,
    scaled: Option<&Scaled>,
    said: Vec<String>,
) -> Result<Calibrated> {
    let section = CaseCamera {
        taken: taken(&asked.request),
        pixel_size_mm: scaled.map(|scaled| scaled.pixel_size_mm),
        pixel_size_relative_std: scaled.map(|scaled| scaled.relative_std),
        ..CaseCamera::of(camera)
    };
    let head = format!("Camera found by quadrille {}", env!("CARGO_PKG_VERSION"));
    let comments: Vec<String> = std::iter::once(&head).chain(&said).cloned().collect();
    folder.write(CAMERA, |out| std::io::Write::write_all(out, write_camera(&section, &comments).as_bytes()))?;
    Ok(Calibrated { file: folder.path().join(CAMERA), said })
}

/// What was marked: as it is asked for, or else in the case.
fn marks(asked: &Calibrating) -> CaseCamera {
    let given = CaseCamera {
        points: (!asked.points.is_empty()).then(|| asked.points.clone()),
        lengths: (!asked.lengths.is_empty()).then(|| asked.lengths.clone()),
        ..CaseCamera::default()
    };
    let marks = match (&given.points, &given.lengths) {
        (None, None) => asked.case.camera.clone().unwrap_or_default(),
        _ => given,
    };
    CaseCamera { mark_std_px: asked.mark_std_px.or(marks.mark_std_px), ..marks }
}

/// When the first image was taken, where its file says so.
fn taken(request: &Request) -> Option<String> {
    let images = &request.images;
    let patterns = images.reference.as_ref().or(images.deformed.as_ref())?;
    let first = expand_series(patterns, Path::new("")).ok()?.into_iter().next()?;
    Frame::file(first, 0).read(Accepted::ANY).ok()?.taken
}

/// The camera that the fields of a run show; what they leave is drawn.
fn of_series(folder: &RunFolder) -> Result<Calibration> {
    let store = Store::open(folder.path().join(STORE))?;
    let header = store.header();
    let mut fields: Vec<(usize, Measurement<Px>)> = Vec::new();
    for number in 1..=store.n_frames() {
        let field =
            store.frame(number)?.map(|frame| frame.measurement).filter(|field| field.status == Status::Converged);
        fields.extend(field.map(|field| (number, field)));
    }
    let list: Vec<Measurement<Px>> = fields.iter().map(|(_, field)| field.clone()).collect();
    let found = camera_of(&list, header.image_size_px, header.reference.len())?;
    let backdrop = match reference(header, 0) {
        Ok(image) => Backdrop::new(&image, 1),
        Err(_) => Backdrop::blank(header.image_size_px[0], header.image_size_px[1], 1),
    };
    for ((number, field), left) in fields.iter().zip(&found.residual) {
        let note = format!("image {number}: measured less what camera and rigid motion say");
        draw_residual(&folder.path().join(FIGURES), *number, field, left, &backdrop, note)?;
    }
    Ok(found)
}

fn said_of_scale(scaled: Option<&Scaled>) -> String {
    match scaled {
        None => "scale: a length is missing; give --length x0,y0,x1,y1,MM, or pixel_size_mm".to_owned(),
        Some(Scaled { pixel_size_mm, relative_std, left_px, .. }) => format!(
            "scale: 1 px = {pixel_size_mm:.6} mm, known to {:.3} %; marks are left {left_px:.2} px off (root mean square)",
            100.0 * relative_std
        ),
    }
}

/// What was found, in words.
fn verdict(found: &Calibration) -> Vec<String> {
    let shape = found.camera.shape();
    let [width, height] = shape.image_size_px.map(|n| n as f64);
    let half = 0.5 * width.hypot(height);
    let of = |name: &str| {
        let at = PARAMETERS.iter().position(|parameter| *parameter == name);
        found.estimates.iter().find(|estimate| Some(estimate.parameter) == at)
    };
    let shifts = found.moved.iter().map(|moved| moved.shift);
    let largest = shifts.clone().fold(0.0f64, |most, t| most.max(t[0].hypot(t[1])));
    let mut said = vec![format!(
        "{} moved by up to {largest:.1} px; what camera and motion leave is {:.2} of the noise",
        plural(found.moved.len(), "image"),
        found.squares.sqrt()
    )];
    // By half a diagonal, as coefficients are.
    let percent = (half / shape.focal_px[0]).powi(2) * 100.0;
    said.extend(of("k1").map(|k1| said_of("k1", k1, percent, "% at the corner")));
    said.extend(of("tilt_x").map(|tilt| said_of("tilt along x", tilt, 100.0 * width, "% of scale across the image")));
    said.extend(of("tilt_y").map(|tilt| said_of("tilt along y", tilt, 100.0 * height, "% of scale across the image")));
    said.extend(found.tried.iter().map(said_of_tried));
    // Shifts along one line leave what is across it to the second order of the field.
    let across = shifts.clone().flat_map(|a| shifts.clone().map(move |b| (a[0] * b[1] - a[1] * b[0]).abs()));
    if across.fold(0.0, f64::max) < 0.1 * largest * largest {
        said.push(
            "a shift across is missing: all images moved along one line; another makes all of this better known"
                .to_owned(),
        );
    }
    if largest < 0.05 * half {
        said.push(format!("the shifts are small: {:.0} px or more would tell more", 0.1 * half));
    }
    if found.squares > 2.0 {
        said.push(
            "more than noise is left: look at figures/; a lens of another kind, a specimen that bent, or one that left its plane"
                .to_owned(),
        );
    }
    said
}
