//! The camera from images of a flat target.

use crate::camera::PARAMETERS;
use crate::camera::marked::{MarkedPoint, Scaled};
use crate::camera::target::{TargetCalibration, calibrate_on_target};
use crate::field::{Measurement, Status};
use crate::imaging::Image;
use crate::io::case::CaseFile;
use crate::io::images::Accepted;
use crate::io::series::{Frame, expand_series};
use crate::mesh::{Mesh, ZoneElements};
use crate::metrology::target::{Pattern, SeenTarget, Target, find_targets};
use crate::report::Backdrop;
use crate::run::calibration::asked::Calibrating;
use crate::run::calibration::found::{draw_residual, said_of, said_of_tried};
use crate::run::folder::run_folder::FIGURES;
use crate::run::plan::Request;
use crate::run::words::{Result, plural};
use crate::run::{RunError, RunFolder};
use crate::units::Px;
use std::path::Path;
use std::sync::Arc;

/// Neighbours are alike beyond chance from this correlation and so many standard deviations.
const ALIKE: [f64; 2] = [0.3, 5.0];
/// Part of half a diagonal that the points should reach.
const REACHED: f64 = 0.75;

/// A target and the distance of its points, mm, where one is asked for.
pub(super) fn asked_target(asked: &Calibrating) -> Result<Option<(Target, f64)>> {
    let chessboard = asked.chessboard.map(|n| Target { pattern: Pattern::Chessboard, n });
    let dots = asked.dots.map(|n| Target { pattern: Pattern::Dots, n });
    let Some(target) = chessboard.or(dots) else {
        return match asked.pitch_mm {
            Some(_) => Err("--pitch is about a target; give --chessboard or --dots as well".into()),
            None => Ok(None),
        };
    };
    if !asked.points.is_empty() || !asked.lengths.is_empty() {
        return Err("a target holds its own lengths; leave --point and --length out".into());
    }
    match asked.pitch_mm {
        Some(mm) if mm.is_finite() && mm > 0.0 => Ok(Some((target, mm))),
        Some(mm) => Err(format!("--pitch is {mm}; give the mm from one point of the target to the next").into()),
        None => Err("--pitch MM is missing: how far the points of the target are from each other".into()),
    }
}

/// The camera that the images of a target show, and what there is to say of it; what it leaves is drawn.
pub(super) fn of_target(
    (target, pitch_mm): (Target, f64),
    asked: &Request,
    case: &CaseFile,
    folder: &RunFolder,
) -> Result<(Scaled, Vec<String>)> {
    if asked.images.reference.is_some() {
        return Err(
            "--reference: of a target the first image is that in the plane of the specimen; name it first".into()
        );
    }
    let (patterns, base) = match &asked.images.deformed {
        Some(patterns) => (Some(patterns), Path::new("")),
        None => (case.images.deformed.as_ref(), case.base.as_path()),
    };
    let files = expand_series(patterns.map_or(&[][..], |patterns| patterns), base)?;
    let read = |path: std::path::PathBuf| -> Result<(String, Arc<Image>)> {
        let name = path.display().to_string();
        Ok((name, Frame::file(path, 0).read(Accepted::ANY)?.image.into()))
    };
    let images = files.into_iter().map(read).collect::<Result<Vec<_>>>()?;
    let seen = find_targets(&images, target)?;
    let [columns, _] = target.n;
    let points = |seen: &SeenTarget| -> Vec<MarkedPoint> {
        let place = |k: usize| [k % columns, k / columns].map(|n| pitch_mm * n as f64);
        seen.points.iter().enumerate().map(|(k, &px)| MarkedPoint { px, mm: place(k) }).collect()
    };
    let views: Vec<Vec<MarkedPoint>> = seen.iter().map(points).collect();
    let radius_mm = pitch_mm * seen.iter().map(|seen| seen.dot_radius).sum::<f64>() / seen.len().max(1) as f64;
    let size = images.first().map_or([0; 2], |(_, image)| [image.width(), image.height()]);
    let found = calibrate_on_target(&views, radius_mm, size)?;
    for (number, (((_, image), seen), left)) in images.iter().zip(&seen).zip(&found.residual).enumerate() {
        let field = field_of(seen, target, found.noise_px)?;
        let left: Vec<Option<[f64; 2]>> = left.iter().copied().map(Some).collect();
        let note = format!("image {}: found less computed places of the target", number + 1);
        draw_residual(&folder.path().join(FIGURES), number + 1, &field, &left, &Backdrop::new(image, 1), note)?;
    }
    let said = verdict(&found, target, size, &views);
    let left_px = 2f64.sqrt() * found.noise_px;
    let TargetCalibration { camera, pixel_size_mm, relative_std, .. } = found;
    Ok((Scaled { camera, pixel_size_mm, relative_std, left_px }, said))
}

/// The points of a target as the nodes of a field.
fn field_of(seen: &SeenTarget, target: Target, noise_px: f64) -> Result<Measurement<Px>> {
    let [columns, rows] = target.n.map(|n| n as u32);
    let element = |k: u32| {
        let at = k % (columns - 1) + k / (columns - 1) * columns;
        [at, at + 1, at + columns + 1, at + columns]
    };
    let elements = (0..(columns - 1) * (rows - 1)).map(element).collect();
    let zone = ZoneElements { name: "target".to_owned(), nodes: seen.points.clone(), elements };
    let mesh = Arc::new(Mesh::from_zones(vec![zone]).map_err(|error| RunError::Refused(error.to_string()))?);
    let n = mesh.n_nodes();
    Ok(Measurement {
        status: Status::Converged,
        displacement: vec![[0.0; 2]; n],
        sigma: vec![[noise_px; 2]; n],
        measured: vec![true; n],
        element_residual: vec![0.0; mesh.n_elements()],
        model_error: None,
        marks: None,
        points: None,
        mesh,
    })
}

/// What was found, in words.
fn verdict(found: &TargetCalibration, target: Target, size: [usize; 2], views: &[Vec<MarkedPoint>]) -> Vec<String> {
    let shape = found.camera.shape();
    let [width, height] = size.map(|n| n as f64);
    let half = 0.5 * width.hypot(height);
    let what = match target.pattern {
        Pattern::Chessboard => "corners",
        Pattern::Dots => "dots",
    };
    let mut said = vec![format!(
        "{} of {} x {} {what}, each known to {:.3} px, by what the camera leaves",
        plural(views.len(), "image"),
        target.n[0],
        target.n[1],
        found.noise_px
    )];
    if let Some([focal, std]) = found.focal_px {
        said.push(format!("focal length: {focal:.1} +- {std:.1} px"));
    }
    let of = |name: &str| {
        let at = PARAMETERS.iter().position(|parameter| *parameter == name);
        found.estimates.iter().find(|estimate| Some(estimate.parameter) == at)
    };
    for (name, axis) in [("centre_x", "x"), ("centre_y", "y")] {
        let determined = of(name).filter(|centre| centre.is_determined);
        said.extend(determined.map(|of| format!("centre along {axis}: {:.1} +- {:.1} px", of.value, of.std)));
    }
    let percent = (half / shape.focal_px[0]).powi(2) * 100.0;
    said.extend(of("k1").map(|k1| said_of("k1", k1, percent, "% at the corner")));
    for (name, axis, n) in [("tilt_x", "x", width), ("tilt_y", "y", height)] {
        let words = format!("tilt along {axis}");
        said.extend(of(name).map(|tilt| said_of(&words, tilt, 100.0 * n, "% of scale across the image")));
    }
    said.extend(found.tried.iter().map(said_of_tried));
    let middle = [0.5 * (width - 1.0), 0.5 * (height - 1.0)];
    let away = |point: &MarkedPoint| (point.px[0] - middle[0]).hypot(point.px[1] - middle[1]);
    let reached = views.iter().flatten().map(away).fold(0.0, f64::max) / half;
    if reached < REACHED {
        said.push(format!(
            "points in the corners are missing: the target reaches {:.0} % of the way there, and what is beyond is computed from it",
            100.0 * reached
        ));
    }
    if views.len() == 1 {
        said.push(
            "the plane is that of the target; if it did not lie on the specimen, tilt and scale are not those of the test"
                .to_owned(),
        );
    } else {
        said.push("the plane is that of the target in the first image".to_owned());
    }
    if found.alike[0] > ALIKE[0] && found.alike[1] > ALIKE[1] {
        said.push(format!(
            "more than noise is left: neighbours are off alike (correlation {:.1}); look at figures/; a target that is not flat, or a \
             lens of another kind. The uncertainties are too small then",
            found.alike[0]
        ));
    }
    said
}
