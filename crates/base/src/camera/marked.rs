//! The scale of a camera from a known length, and how the plane stands from points whose place is known.

use super::{Camera, CameraError, CameraShape, Covariance, PARAMETERS};
use crate::linalg::Dense;
use crate::plane::{Point, distance};
use thiserror::Error;

/// Standard deviation of stretch and shear before anything is seen: a plane turned by 30 degrees.
const STRETCH: f64 = 0.05;
/// Of the perspective, for lengths in half diagonals.
const TILT: f64 = 0.1;
/// Largest residual of a point, in standard uncertainties, that chance leaves.
const CHANCE: f64 = 5.0;
/// Least ratio of the extents of points across and along: below they are on a line.
const LEAST_WIDTH: f64 = 0.02;

/// A point that was marked in the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MarkedPoint {
    /// Where it is seen, raw px.
    pub px: Point,
    /// Where it is on the specimen, mm, along any axes.
    pub mm: Point,
}

/// A length that was marked in the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MarkedLength {
    /// Its ends, raw px.
    pub ends: [Point; 2],
    /// Length, mm.
    pub mm: f64,
}

/// A camera with its scale.
#[derive(Debug, Clone)]
pub struct Scaled {
    /// The camera.
    pub camera: Camera,
    /// Size of a pixel in the plane at its centre, mm.
    pub pixel_size_mm: f64,
    /// Its relative standard uncertainty.
    pub relative_std: f64,
    /// Root mean square distance of the points from where they should be seen, px; of lengths that of their ends.
    pub left_px: f64,
}

/// Why points or lengths are of no use.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum MarkedError {
    /// Too few.
    #[error("{0} points with known mm; give four or more, or one length")]
    FewPoints(usize),
    /// All in a row.
    #[error("the points lie on a line; give four or more that span the plane")]
    OnLine,
    /// A number that cannot be.
    #[error("{what} is {value}; give a finite number{}", if *.positive { " above zero" } else { "" })]
    Number {
        /// Which.
        what: &'static str,
        /// Its value.
        value: f64,
        /// Whether it must be positive as well.
        positive: bool,
    },
    /// A point that is seen elsewhere.
    #[error(
        "point {number} is seen {off_px:.1} px from where the others put it; check its mm, and that all points are in one plane"
    )]
    Off {
        /// Its number, from 1.
        number: usize,
        /// How far, px.
        off_px: f64,
    },
    /// Lengths that do not go together.
    #[error("the lengths give scales that differ by {percent:.1} %; check them, and that all are in the plane")]
    Lengths {
        /// By how much.
        percent: f64,
    },
    /// A place that the camera does not map.
    #[error(transparent)]
    Camera(#[from] CameraError),
}

/// The scale of `camera` by lengths whose ends were marked to `std_px`: their mean, weighted by length.
///
/// # Errors
/// Lengths that are none, that do not go together, or lie where the camera does not map.
pub fn scale_of_lengths(camera: &Camera, lengths: &[MarkedLength], std_px: f64) -> Result<Scaled, MarkedError> {
    let positive = |what, value: f64| match value.is_finite() && value > 0.0 {
        true => Ok(value),
        false => Err(MarkedError::Number { what, value, positive: true }),
    };
    positive("the standard uncertainty of a mark (px)", std_px)?;
    let place = |[x, y]: Point| camera.plane([x, y]).ok_or(CameraError::Folds { x, y });
    let (mut mm, mut px) = (Vec::new(), Vec::new());
    for length in lengths {
        mm.push(positive("a length (mm)", length.mm)?);
        px.push(positive("a length (px)", distance(place(length.ends[0])?, place(length.ends[1])?))?);
    }
    let squares: f64 = px.iter().map(|px| px * px).sum();
    if squares == 0.0 {
        return Err(MarkedError::FewPoints(0));
    }
    let pixel_size_mm = mm.iter().zip(&px).map(|(mm, px)| mm * px).sum::<f64>() / squares;
    // Both ends are off.
    let std = 2f64.sqrt() * std_px;
    let off = |(mm, px): (&f64, &f64)| mm / pixel_size_mm - px;
    let worst = mm.iter().zip(&px).map(|pair| (off(pair).abs(), *pair.1)).max_by(|a, b| a.0.total_cmp(&b.0));
    if let Some((off, px)) = worst.filter(|(off, _)| *off > CHANCE * std) {
        return Err(MarkedError::Lengths { percent: 100.0 * off / px });
    }
    let left: f64 = mm.iter().zip(&px).map(|pair| off(pair).powi(2)).sum();
    Ok(Scaled {
        camera: camera.clone(),
        pixel_size_mm,
        relative_std: std / squares.sqrt(),
        left_px: (left / mm.len() as f64).sqrt(),
    })
}

/// Of nothing known but the size of the images: what a plane and a lens usually are.
///
/// # Errors
/// Images without pixels.
pub fn unknown_plane(image_size_px: [usize; 2]) -> Result<Camera, CameraError> {
    let mut std = [0.0; PARAMETERS.len()];
    std[0] = super::USUAL_DISTORTION;
    let covariance = Covariance::of_std(&std);
    with_unknown_plane(&Camera::new(CameraShape { covariance, ..CameraShape::plain(image_size_px) })?)
}

/// The same camera before a plane that may stand in any usual way, as far as nothing is stated of it.
///
/// # Errors
/// None of a camera that is one.
pub fn with_unknown_plane(camera: &Camera) -> Result<Camera, CameraError> {
    let shape = camera.shape();
    let half = 0.5 * (shape.image_size_px[0] as f64).hypot(shape.image_size_px[1] as f64);
    let usual = [(7, TILT / half), (8, TILT / half), (9, STRETCH), (10, STRETCH)];
    let (known, matrix) = (&shape.covariance.of, &shape.covariance.matrix);
    let open = usual.into_iter().filter(|(k, _)| !known.contains(k) && shape.theta[*k] == 0.0);
    // Each parameter with its row in the covariance, or its own standard deviation.
    let rows = known.iter().enumerate().map(|(row, &k)| (k, Ok(row)));
    let mut all: Vec<(usize, Result<usize, f64>)> = rows.chain(open.map(|(k, std)| (k, Err(std)))).collect();
    all.sort_by_key(|(k, _)| *k);
    let entry = |a: &(usize, Result<usize, f64>), b: &(usize, Result<usize, f64>)| match (a.1, b.1) {
        (Ok(row), Ok(column)) => matrix[row][column],
        (Err(std), Err(_)) if a.0 == b.0 => std * std,
        _ => 0.0,
    };
    let matrix = all.iter().map(|a| all.iter().map(|b| entry(a, b)).collect()).collect();
    let covariance = Covariance { of: all.iter().map(|(k, _)| *k).collect(), matrix };
    Camera::new(CameraShape { covariance, ..shape.clone() })
}

/// The plane that points with known places are in, marked to `std_px`; `camera` is what is known before, with its
/// covariance.
///
/// # Errors
/// Fewer than four points, points on a line, points that no plane explains.
pub fn camera_of_points(camera: &Camera, points: &[MarkedPoint], std_px: f64) -> Result<Scaled, MarkedError> {
    if points.len() < 4 {
        return Err(MarkedError::FewPoints(points.len()));
    }
    let numbers = points.iter().flat_map(|point| point.px.iter().chain(&point.mm));
    if let Some(&value) = numbers.chain([&std_px]).find(|v| !v.is_finite()) {
        return Err(MarkedError::Number { what: "a coordinate of a point", value, positive: false });
    }
    if std_px <= 0.0 {
        return Err(MarkedError::Number {
            what: "the standard uncertainty of a mark (px)",
            value: std_px,
            positive: true,
        });
    }
    let spread = |of: fn(&MarkedPoint) -> Point| is_spread(&points.iter().map(of).collect::<Vec<_>>());
    if !(spread(|point| point.px) && spread(|point| point.mm)) {
        return Err(MarkedError::OnLine);
    }
    // Axes of the specimen may be counted up or down.
    let fits = [1.0, -1.0].map(|up| fit(camera, points, up, std_px));
    let best = fits.into_iter().flatten().min_by(|a, b| a.1.total_cmp(&b.1)).map(|(best, _)| best);
    let best = best.ok_or(MarkedError::OnLine)?;
    let worst = squares_of(&best.residual).into_iter().enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
    if let Some((at, off)) = worst.filter(|(_, off)| off.sqrt() > CHANCE * std_px) {
        return Err(MarkedError::Off { number: at + 1, off_px: off.sqrt() });
    }
    let scale = best.similarity[0].hypot(best.similarity[1]);
    let n = best.known.len();
    let by = [best.similarity[0] / scale, best.similarity[1] / scale];
    let variance: f64 =
        (0..2).map(|i| (0..2).map(|j| by[i] * best.covariance[(n + i, n + j)] * by[j]).sum::<f64>()).sum();
    let matrix = (0..n).map(|r| (0..n).map(|c| best.covariance[(r, c)]).collect()).collect();
    let covariance = Covariance { of: best.known, matrix };
    let sum: f64 = squares_of(&best.residual).iter().sum();
    Ok(Scaled {
        camera: Camera::new(CameraShape { covariance, theta: best.theta, ..camera.shape().clone() })?,
        pixel_size_mm: 1.0 / scale,
        relative_std: variance.sqrt() / scale,
        left_px: (sum / points.len() as f64).sqrt(),
    })
}

/// Whether points span the plane.
pub(super) fn is_spread(points: &[Point]) -> bool {
    let n = points.len() as f64;
    let mean = [0, 1].map(|c| points.iter().map(|p| p[c]).sum::<f64>() / n);
    let moment = |i: usize, j: usize| points.iter().map(|p| (p[i] - mean[i]) * (p[j] - mean[j])).sum::<f64>();
    let (xx, yy, xy) = (moment(0, 0), moment(1, 1), moment(0, 1));
    let (half, apart) = (0.5 * (xx + yy), (0.5 * (xx - yy)).hypot(xy));
    half + apart > 0.0 && (half - apart).max(0.0).sqrt() > LEAST_WIDTH * (half + apart).sqrt()
}

fn squares_of(residual: &[Point]) -> Vec<f64> {
    residual.iter().map(|r| r[0] * r[0] + r[1] * r[1]).collect()
}

/// Where a fit of points ended: from mm to the plane by `X = [a x + b y + s, b x - a y + t]`, with y of mm up.
struct FittedPoints {
    known: Vec<usize>,
    theta: super::Theta,
    /// a, b, s, t.
    similarity: [f64; 4],
    covariance: Dense,
    residual: Vec<Point>,
}

/// Gauss-Newton from the similarity; with what is left of the squares. `None` where it does not settle.
fn fit(camera: &Camera, points: &[MarkedPoint], up: f64, std_px: f64) -> Option<(FittedPoints, f64)> {
    let before = camera.shape();
    let known = before.covariance.of.clone();
    let (p, n) = (known.len(), known.len() + 4);
    let matrix = &before.covariance.matrix;
    let prior = Dense::from_fn(p, p, |r, c| matrix[r][c]);
    let prior = if p > 0 { inverse_of(&prior)? } else { prior };
    let mm = |point: &MarkedPoint| [point.mm[0], up * point.mm[1]];
    let mut similarity = start(camera, points, mm)?;
    let mut theta = before.theta;
    for _ in 0..50 {
        let there = Camera::new(CameraShape { theta, covariance: Covariance::default(), ..before.clone() }).ok()?;
        let [a, b, s, t] = similarity;
        let (mut normal, mut pull) = (Dense::zeros(n, n), Dense::zeros(n, 1));
        let mut residual = Vec::new();
        for point in points {
            let [x, y] = mm(point);
            let at = [a * x + b * y + s, b * x - a * y + t];
            let (seen, slope, by) = (there.pixel(at), there.slope(at), there.by_parameters(at));
            let r = [point.px[0] - seen[0], point.px[1] - seen[1]];
            let of_place = [[x, -y], [y, x], [1.0, 0.0], [0.0, 1.0]];
            let of_place = of_place.map(|d| slope.map(|row| row[0] * d[0] + row[1] * d[1]));
            let columns: Vec<Point> = known.iter().map(|&k| by[k]).chain(of_place).collect();
            for (i, u) in columns.iter().enumerate() {
                for (j, v) in columns.iter().enumerate() {
                    normal[(i, j)] += (u[0] * v[0] + u[1] * v[1]) / (std_px * std_px);
                }
                pull[(i, 0)] += (u[0] * r[0] + u[1] * r[1]) / (std_px * std_px);
            }
            residual.push(r);
        }
        let mut squares: f64 = squares_of(&residual).iter().sum::<f64>() / (std_px * std_px);
        let off: Vec<f64> = known.iter().map(|&k| before.theta[k] - theta[k]).collect();
        for i in 0..p {
            for j in 0..p {
                normal[(i, j)] += prior[(i, j)];
                pull[(i, 0)] += prior[(i, j)] * off[j];
                squares += off[i] * prior[(i, j)] * off[j];
            }
        }
        let covariance = inverse_of(&normal)?;
        let step = covariance.times(&pull);
        known.iter().enumerate().for_each(|(row, &k)| theta[k] += step[(row, 0)]);
        (0..4).for_each(|k| similarity[k] += step[(p + k, 0)]);
        if (0..n).all(|k| step[(k, 0)].abs() <= 1e-4 * covariance[(k, k)].sqrt()) {
            return Some((FittedPoints { known, theta, similarity, covariance, residual }, squares));
        }
    }
    None
}

/// The similarity that fits best, without changing the camera.
fn start(camera: &Camera, points: &[MarkedPoint], mm: impl Fn(&MarkedPoint) -> Point) -> Option<[f64; 4]> {
    let (mut normal, mut pull) = (Dense::zeros(4, 4), Dense::zeros(4, 1));
    for point in points {
        let ([x, y], at) = (mm(point), camera.plane(point.px)?);
        for (row, wanted) in [([x, y, 1.0, 0.0], at[0]), ([-y, x, 0.0, 1.0], at[1])] {
            for i in 0..4 {
                (0..4).for_each(|j| normal[(i, j)] += row[i] * row[j]);
                pull[(i, 0)] += row[i] * wanted;
            }
        }
    }
    let found = inverse_of(&normal)?.times(&pull);
    Some([0, 1, 2, 3].map(|k| found[(k, 0)]))
}

/// The inverse of a positive definite matrix whose rows differ by orders of magnitude.
pub(super) fn inverse_of(matrix: &Dense) -> Option<Dense> {
    let n = matrix.n_rows();
    let scale: Vec<f64> = (0..n).map(|k| matrix[(k, k)].sqrt()).collect();
    let scaled = Dense::from_fn(n, n, |r, c| matrix[(r, c)] / (scale[r] * scale[c]));
    let unit = Dense::from_fn(n, n, |r, c| if r == c { 1.0 } else { 0.0 });
    let inverse = scaled.cholesky().ok()?.solve(&unit);
    let inverse = Dense::from_fn(n, n, |r, c| 0.5 * (inverse[(r, c)] + inverse[(c, r)]) / (scale[r] * scale[c]));
    (0..n).all(|k| inverse[(k, k)].is_finite() && inverse[(k, k)] > 0.0).then_some(inverse)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A camera seen from somewhere, 0.05 mm per px, the specimen turned by 20 degrees.
    fn seen(up: f64) -> (Camera, Vec<MarkedPoint>) {
        let mut shape = CameraShape::plain([1000, 800]);
        (shape.theta[7], shape.theta[8], shape.theta[9], shape.theta[10]) = (4e-5, -6e-5, -0.002, 0.001);
        let camera = Camera::new(shape).unwrap();
        let (sin, cos) = 20f64.to_radians().sin_cos();
        let point = |k: usize| {
            let [x, y] = [(k % 4) as f64 * 8.0 - 10.0, (k / 4) as f64 * 7.0 - 9.0];
            let at = [500.0 + (cos * x + sin * y) / 0.05, 400.0 + (sin * x - cos * y) / 0.05];
            MarkedPoint { px: camera.pixel(at), mm: [x, up * y] }
        };
        (camera.clone(), (0..16).map(point).collect())
    }

    #[test]
    fn exact_points_give_the_plane_and_the_scale_back_whichever_way_y_is_counted() {
        for up in [1.0, -1.0] {
            let (truth, points) = seen(up);
            let found = camera_of_points(&unknown_plane([1000, 800]).unwrap(), &points, 1e-4).unwrap();
            // The scale at the centre of the camera, not at the first point; marks are exact to rounding.
            assert!((found.pixel_size_mm - 0.05).abs() < 1e-7, "{}", found.pixel_size_mm);
            for k in 7..11 {
                let off = found.camera.shape().theta[k] - truth.shape().theta[k];
                assert!(off.abs() < 1e-6, "{}: {off}", PARAMETERS[k]);
            }
        }
    }

    #[test]
    fn points_that_are_of_no_use_are_refused() {
        let plane = unknown_plane([1000, 800]).unwrap();
        let (_, points) = seen(1.0);
        let refused = |points: &[MarkedPoint]| camera_of_points(&plane, points, 0.3).unwrap_err();
        assert_eq!(refused(&points[..3]), MarkedError::FewPoints(3));
        assert_eq!(refused(&points[..4]), MarkedError::OnLine);
        let mut wrong = points.clone();
        wrong[5].mm[0] += 2.0;
        assert!(matches!(refused(&wrong), MarkedError::Off { number: 6, .. }));
        wrong[5].mm[0] = f64::NAN;
        assert!(matches!(refused(&wrong), MarkedError::Number { .. }));
        let length = |mm| MarkedLength { ends: [[0.0, 0.0], [400.0, 300.0]], mm };
        let scaled = scale_of_lengths(&plane, &[length(25.0)], 0.5).unwrap();
        assert!(
            (scaled.pixel_size_mm - 0.05).abs() < 1e-12
                && (scaled.relative_std - 0.5 * 2f64.sqrt() / 500.0).abs() < 1e-12
        );
        assert!(matches!(scale_of_lengths(&plane, &[length(-1.0)], 0.5), Err(MarkedError::Number { .. })));
        assert!(matches!(
            scale_of_lengths(&plane, &[length(25.0), length(26.0)], 0.5),
            Err(MarkedError::Lengths { .. })
        ));
    }
}
