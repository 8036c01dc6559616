//! Calibration from a flat target, a chessboard or a grid of dots, in one or several poses (THEORY 22).
//!
//! Unknowns are the camera and the pose of the target in each image; data are the places of its points. Gauss-Newton;
//! the noise of a place is what the fit leaves.

use super::calibrate::{Estimate, GROUPS, PRIOR, Tried, UNDETERMINED};
use super::marked::{MarkedPoint, inverse_of, is_spread};
use super::pose::{ASPECT, CENTRE, COMMON, Homography, NEARNESS, Stand};
use super::{Camera, CameraError, CameraShape, Covariance, PARAMETERS, Theta};
use crate::linalg::Dense;
use crate::plane::Point;
use thiserror::Error;

/// Fewest points of a view: twice as many numbers as a plane has, and some for the lens.
const FEWEST_POINTS: usize = 12;
/// Noise of a place before anything is seen, px.
const NOISE_PX: f64 = 0.1;
/// Rounds in which noise and camera are found from each other.
const ROUNDS: usize = 3;
/// Steps of a search.
const STEPS: usize = 100;
/// A step that moves no unknown by more of its standard uncertainty ends the search.
const SETTLED: f64 = 1e-3;
/// How well the focal length must be known, of itself.
const KNOWN_FOCAL: f64 = 0.3;
/// A target that is turned further away is not that in the plane of the specimen, degrees.
const FAR_TURNED: f64 = 30.0;
/// Half a diagonal by the focal length of a usual lens.
const USUAL_NEARNESS: f64 = 0.3;
/// A point that is further off than this, in standard deviations of all, is none of the target, if also by so many px.
const OFF: f64 = 8.0;
const OFF_PX: f64 = 0.3;
/// How uncertain the shape of a tilted plane at least is: to second order in its tilt.
const SHAPE_FLOOR: f64 = 1e-6;

/// What was found on views of a target.
#[derive(Debug, Clone)]
pub struct TargetCalibration {
    /// The camera, seeing the plane of the first view, with its covariance.
    pub camera: Camera,
    /// Its parameters that were unknown.
    pub estimates: Vec<Estimate>,
    /// Size of a pixel in the plane of the first view, at the centre, mm.
    pub pixel_size_mm: f64,
    /// Its relative standard uncertainty.
    pub relative_std: f64,
    /// Focal length and its standard uncertainty, px; of one view there is none.
    pub focal_px: Option<[f64; 2]>,
    /// By how much the target is turned away from the camera in each view, degrees.
    pub tilt_degrees: Vec<f64>,
    /// Found less computed place of each point of each view, px.
    pub residual: Vec<Vec<Point>>,
    /// Standard deviation of these, of each coordinate: the noise of a place.
    pub noise_px: f64,
    /// How alike those of neighbours are: their correlation, and how many standard deviations that is above chance.
    pub alike: [f64; 2],
    /// Coefficients that were tried beside those that are always unknown.
    pub tried: Vec<Tried>,
}

/// Why views of a target tell nothing.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum TargetFitError {
    /// Too little.
    #[error(
        "image {view}: a target of {n} points is too small; give one with {FEWEST_POINTS} or more that are not in a row"
    )]
    FewPoints {
        /// Number of the image, from 1.
        view: usize,
        /// How many points.
        n: usize,
    },
    /// A number that cannot be.
    #[error("{what} is {value}; give a finite number above zero")]
    Number {
        /// Which.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// Nothing tells the focal length.
    #[error(
        "all poses are parallel, turned from the camera by at most {degrees:.0} degrees: the focal length is not determined; turn \
         the target by 20 to 40 degrees about two axes in some images, or name the one image with the target on the specimen, \
         which suffices for one plane"
    )]
    Parallel {
        /// The largest turn away from the camera, degrees.
        degrees: f64,
    },
    /// The first is no view of the plane of the specimen.
    #[error(
        "image 1: the target is turned away from the camera by {degrees:.0} degrees, so it does not lie in the plane of the \
         specimen; name the image first on which it lies there"
    )]
    NotInPlane {
        /// How far, degrees.
        degrees: f64,
    },
    /// A point that is seen elsewhere.
    #[error(
        "image {view}: point {number} of the target is seen {off_px:.2} px from where the others put it; leave the image out if the \
         target is hidden, blurred or not flat there"
    )]
    Off {
        /// Number of the image, from 1.
        view: usize,
        /// Number of the point, row by row, from 1.
        number: usize,
        /// How far, px.
        off_px: f64,
    },
    /// The search does not end.
    #[error("no camera explains these images: the search does not settle; are they of one camera and one flat target?")]
    NotSettled,
    /// What was found cannot be.
    #[error("what was found is no camera: {0}")]
    Camera(#[from] CameraError),
}

/// The camera that sees a flat target in these views, of images of the size `image_size_px`: the points of each view
/// with their places on the target, mm, right-handed in the image. The first view is that of the plane of the specimen.
/// `dot_radius_mm` is that of round dots whose middles the points are; zero where they are corners.
///
/// # Errors
/// See [`TargetFitError`].
pub fn calibrate_on_target(
    views: &[Vec<MarkedPoint>],
    dot_radius_mm: f64,
    image_size_px: [usize; 2],
) -> Result<TargetCalibration, TargetFitError> {
    let data = Data::new(views, dot_radius_mm, image_size_px)?;
    let free = data.free().ok_or(TargetFitError::NotSettled)?;
    if let [degrees, ..] = data.tilts(&free)[..]
        && degrees > FAR_TURNED
    {
        return Err(TargetFitError::NotInPlane { degrees });
    }
    let start = match data.stand {
        Stand::Free => free.clone(),
        Stand::Rigid => data.rigid(&free).ok_or(TargetFitError::NotSettled)?,
    };
    let parallel = || TargetFitError::Parallel { degrees: data.tilts(&free).into_iter().fold(0.0, f64::max) };
    let mut known = vec![0, CENTRE, CENTRE + 1];
    known.extend((data.stand == Stand::Rigid).then_some(NEARNESS));
    let best = data.fit_with_noise(start, &known);
    let mut best = best.ok_or_else(|| if data.is_flat(&free) { parallel() } else { TargetFitError::NotSettled })?;
    data.refuse_off(&best)?;
    let mut tried = Vec::new();
    let aspect: Option<(&str, &[usize])> = (data.stand == Stand::Rigid).then_some(("fy/fx", &[ASPECT]));
    for (names, group) in GROUPS.into_iter().chain(aspect) {
        let more: Vec<usize> = known.iter().chain(group).copied().collect();
        let Some(fitted) = data.fit_with_noise(best.state.clone(), &more) else { continue };
        let n = data.n_data();
        let evidence = n * (best.squares / fitted.squares).ln() - group.len() as f64 * n.ln();
        tried.push(Tried { names, evidence });
        if evidence > 0.0 {
            (known, best) = (more, fitted);
        }
    }
    known.sort_unstable();
    let best = data.fit_with_noise(best.state, &known).ok_or(TargetFitError::NotSettled)?;
    if let Some([focal, std]) = data.focal(&best, &known)
        && std > KNOWN_FOCAL * focal
    {
        return Err(parallel());
    }
    data.into_calibration(best, &known, tried)
}

/// Views as they are fitted.
struct Data<'v> {
    views: &'v [Vec<MarkedPoint>],
    size: [usize; 2],
    /// Half a diagonal, px.
    half: f64,
    radius: f64,
    stand: Stand,
}

/// Where a search is.
#[derive(Debug, Clone)]
struct State {
    common: Vec<f64>,
    poses: Vec<Vec<f64>>,
}

/// Where it ended.
struct Fitted {
    state: State,
    /// Sum of squares of what is left, px^2.
    squares: f64,
    noise_px: f64,
    /// Of the known numbers, then of those of each pose.
    covariance: Dense,
    residual: Vec<Vec<Point>>,
}

impl<'v> Data<'v> {
    fn new(views: &'v [Vec<MarkedPoint>], radius: f64, size: [usize; 2]) -> Result<Self, TargetFitError> {
        for (k, view) in views.iter().enumerate() {
            let spread = |of: fn(&MarkedPoint) -> Point| is_spread(&view.iter().map(of).collect::<Vec<_>>());
            let mut numbers = view.iter().flat_map(|point| point.px.iter().chain(&point.mm));
            if let Some(&value) = numbers.find(|v| !v.is_finite()) {
                return Err(TargetFitError::Number { what: "a coordinate of a point", value });
            }
            if view.len() < FEWEST_POINTS || !spread(|point| point.px) || !spread(|point| point.mm) {
                return Err(TargetFitError::FewPoints { view: k + 1, n: view.len() });
            }
        }
        if !(radius.is_finite() && radius >= 0.0) {
            return Err(TargetFitError::Number { what: "the radius of a dot", value: radius });
        }
        let stand = match views.len() {
            0 => return Err(TargetFitError::FewPoints { view: 1, n: 0 }),
            1 => Stand::Free,
            _ => Stand::Rigid,
        };
        let half = 0.5 * (size[0] as f64).hypot(size[1] as f64);
        if half <= 0.0 {
            return Err(TargetFitError::Number { what: "the size of the images", value: half });
        }
        Ok(Self { views, size, half, radius, stand })
    }

    fn n_data(&self) -> f64 {
        2.0 * self.views.iter().map(Vec::len).sum::<usize>() as f64
    }

    /// What is known before of a number that all views share: where it should be, and how surely.
    fn prior(&self, k: usize) -> (f64, f64) {
        let middle = |n: usize| 0.5 * (n as f64 - 1.0);
        match k {
            CENTRE => (middle(self.size[0]), PRIOR[k] * self.half),
            NEARNESS => (USUAL_NEARNESS, 1.0),
            ASPECT => (1.0, 0.01),
            k if k == CENTRE + 1 => (middle(self.size[1]), PRIOR[k] * self.half),
            k => (0.0, PRIOR[k]),
        }
    }

    /// The plane of each view, seen without distortion.
    fn free(&self) -> Option<State> {
        let common = (0..COMMON).map(|k| self.prior(k).0).collect();
        let poses = self.views.iter().map(|view| {
            let centre: Point = [0, 1].map(|c| self.prior(CENTRE + c).0);
            let [u, v, x, y] = similarity(view, centre)?;
            Some(vec![0.0, 0.0, 0.0, 0.0, u, v, x, y])
        });
        let state = State { common, poses: poses.collect::<Option<_>>()? };
        Some(self.fit(Stand::Free, state, &[], NOISE_PX)?.state)
    }

    fn homographies(&self, stand: Stand, state: &State) -> Option<Vec<Homography>> {
        state.poses.iter().map(|pose| Homography::new(stand, &state.common, pose, self.half)).collect()
    }

    fn tilts(&self, free: &State) -> Vec<f64> {
        let list = self.homographies(Stand::Free, free).unwrap_or_default();
        list.iter().map(|of| of.tilt_degrees(&free.common, self.half)).collect()
    }

    /// Whether no view is turned by more than what is seen of a lens.
    fn is_flat(&self, free: &State) -> bool {
        self.tilts(free).iter().all(|degrees| *degrees < 10.0)
    }

    /// The rigid poses that come nearest to the planes that were found, with one focal length.
    fn rigid(&self, free: &State) -> Option<State> {
        let list = self.homographies(Stand::Free, free)?;
        let [u, v] = list.iter().map(Homography::focal_sums).fold([0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
        let near = (v / u).sqrt() * self.half;
        let near = if near.is_finite() { near.clamp(0.05, 1.0) } else { USUAL_NEARNESS };
        let poses = list.iter().map(|of| of.rigid(near / self.half)).collect::<Option<_>>()?;
        let mut common = free.common.clone();
        common[NEARNESS] = near;
        Some(State { common, poses })
    }

    /// The fit with the noise that it leaves itself.
    fn fit_with_noise(&self, state: State, known: &[usize]) -> Option<Fitted> {
        let freedom = (self.n_data() - (known.len() + self.stand.n() * self.views.len()) as f64).max(1.0);
        let mut best = self.fit(self.stand, state, known, NOISE_PX)?;
        for _ in 0..ROUNDS {
            // Places are rounded somewhere.
            let noise = (best.squares / freedom).sqrt().max(1e-7);
            best = self.fit(self.stand, best.state, known, noise)?;
        }
        Some(best)
    }

    /// Levenberg-Marquardt on the numbers `known` of all views and on the poses.
    fn fit(&self, stand: Stand, mut state: State, known: &[usize], noise_px: f64) -> Option<Fitted> {
        let weight = 1.0 / (noise_px * noise_px);
        let cost =
            |state: &State, residual: &[Vec<Point>]| weight * squares_of(residual) + self.prior_squares(state, known);
        let mut residual = self.residual(stand, &state)?;
        let mut damping = 0.0;
        for _ in 0..STEPS {
            let (normal, pull) = self.normal(stand, &state, known, &residual, weight)?;
            let n = normal.n_rows();
            let damped = Dense::from_fn(n, n, |r, c| normal[(r, c)] * if r == c { 1.0 + damping } else { 1.0 });
            let inverse = inverse_of(&damped)?;
            let step = inverse.times(&pull);
            let settled = (0..n).all(|k| step[(k, 0)].abs() <= SETTLED * inverse[(k, k)].sqrt());
            let moved = self.stepped(&state, known, &step);
            let then = self.residual(stand, &moved);
            let better = then.filter(|then| cost(&moved, then) <= cost(&state, &residual));
            match better {
                Some(then) => {
                    (state, residual) = (moved, then);
                    damping = if damping > 1e-6 { 0.1 * damping } else { 0.0 };
                }
                None if !settled => damping = (10.0 * damping).max(1e-3),
                None => {}
            }
            if settled {
                let (normal, _) = self.normal(stand, &state, known, &residual, weight)?;
                let covariance = inverse_of(&normal)?;
                return Some(Fitted { squares: squares_of(&residual), state, noise_px, covariance, residual });
            }
            if damping > 1e9 {
                return None;
            }
        }
        None
    }

    fn prior_squares(&self, state: &State, known: &[usize]) -> f64 {
        let off = |&k: &usize| {
            let (value, std) = self.prior(k);
            ((state.common[k] - value) / std).powi(2)
        };
        known.iter().map(off).sum()
    }

    fn stepped(&self, state: &State, known: &[usize], step: &Dense) -> State {
        let mut moved = state.clone();
        known.iter().enumerate().for_each(|(row, &k)| moved.common[k] += step[(row, 0)]);
        let numbers = moved.poses.iter_mut().flatten().enumerate();
        numbers.for_each(|(row, v)| *v += step[(known.len() + row, 0)]);
        moved
    }

    fn seen(&self, stand: Stand, common: &[f64], pose: &[f64], view: &[MarkedPoint]) -> Option<Vec<Point>> {
        let homography = Homography::new(stand, common, pose, self.half)?;
        view.iter().map(|point| homography.disc(common, point.mm, self.radius, self.half)).collect()
    }

    /// Found less computed places; `None` where a point is out of sight.
    fn residual(&self, stand: Stand, state: &State) -> Option<Vec<Vec<Point>>> {
        let of_view = |(view, pose): (&Vec<MarkedPoint>, &Vec<f64>)| {
            let seen = self.seen(stand, &state.common, pose, view)?;
            Some(view.iter().zip(seen).map(|(point, seen)| [0, 1].map(|c| point.px[c] - seen[c])).collect())
        };
        self.views.iter().zip(&state.poses).map(of_view).collect()
    }

    /// The normal matrix and its right-hand side; derivatives are central differences.
    fn normal(
        &self,
        stand: Stand,
        state: &State,
        known: &[usize],
        residual: &[Vec<Point>],
        weight: f64,
    ) -> Option<(Dense, Dense)> {
        let n = known.len() + stand.n() * self.views.len();
        let (mut normal, mut pull) = (Dense::zeros(n, n), Dense::zeros(n, 1));
        for (k, (view, pose)) in self.views.iter().zip(&state.poses).enumerate() {
            let difference = |common: [&[f64]; 2], pose: [&[f64]; 2], by: f64| -> Option<Vec<Point>> {
                let (a, b) = (self.seen(stand, common[0], pose[0], view)?, self.seen(stand, common[1], pose[1], view)?);
                Some(a.iter().zip(b).map(|(a, b)| [0, 1].map(|c| (a[c] - b[c]) / (2.0 * by))).collect())
            };
            let both = |list: &[f64], at: usize, by: f64| {
                [by, -by].map(|by| {
                    let mut list = list.to_vec();
                    list[at] += by;
                    list
                })
            };
            let (mut rows, mut columns) = (Vec::new(), Vec::new());
            for (row, &at) in known.iter().enumerate() {
                let by = if (CENTRE..NEARNESS).contains(&at) { 1e-5 * self.half } else { 1e-5 };
                let [more, less] = both(&state.common, at, by);
                columns.push(difference([&more, &less], [pose, pose], by)?);
                rows.push(row);
            }
            let scale = pose.get(4..6).map_or(1.0, |uv| uv[0].hypot(uv[1]));
            for (at, by) in stand.steps(self.half, scale).into_iter().enumerate() {
                let [more, less] = both(pose, at, by);
                columns.push(difference([&state.common, &state.common], [&more, &less], by)?);
                rows.push(known.len() + stand.n() * k + at);
            }
            let product = |a: &[Point], b: &[Point]| -> f64 {
                weight * a.iter().zip(b).map(|(a, b)| a[0] * b[0] + a[1] * b[1]).sum::<f64>()
            };
            for (&row, a) in rows.iter().zip(&columns) {
                for (&column, b) in rows.iter().zip(&columns) {
                    normal[(row, column)] += product(a, b);
                }
                pull[(row, 0)] += product(a, &residual[k]);
            }
        }
        for (row, &k) in known.iter().enumerate() {
            let (value, std) = self.prior(k);
            normal[(row, row)] += 1.0 / (std * std);
            pull[(row, 0)] += (value - state.common[k]) / (std * std);
        }
        Some((normal, pull))
    }

    /// Refuses a point that is far from where the others put it.
    fn refuse_off(&self, best: &Fitted) -> Result<(), TargetFitError> {
        let mut list: Vec<f64> = best.residual.iter().flatten().map(|r| r[0].hypot(r[1])).collect();
        let middle = list.len() / 2;
        // The median of the length of two normal numbers is 1.18 of their standard deviation.
        let std = *list.select_nth_unstable_by(middle, f64::total_cmp).1 / 1.18;
        let all =
            best.residual.iter().enumerate().flat_map(|(view, list)| list.iter().enumerate().map(move |of| (view, of)));
        let worst = all.map(|(view, (number, r))| (r[0].hypot(r[1]), view, number)).max_by(|a, b| a.0.total_cmp(&b.0));
        match worst {
            Some((off_px, view, number)) if off_px > OFF_PX.max(OFF * std) => {
                Err(TargetFitError::Off { view: view + 1, number: number + 1, off_px })
            }
            _ => Ok(()),
        }
    }

    /// Focal length and its standard uncertainty, px.
    fn focal(&self, best: &Fitted, known: &[usize]) -> Option<[f64; 2]> {
        let row = known.iter().position(|&k| k == NEARNESS)?;
        let near = best.state.common[NEARNESS].abs().max(1e-9);
        Some([self.half / near, self.half / (near * near) * best.covariance[(row, row)].sqrt()])
    }

    /// The plane of the first view in parameters of a camera, for lengths in half diagonals, and the logarithm of the
    /// size of a pixel.
    fn plane(&self, state: &State) -> Option<(Theta, f64)> {
        let homography = Homography::new(self.stand, &state.common, state.poses.first()?, self.half)?;
        let (theta, size) = homography.camera(&state.common, self.half)?;
        Some((theta, size.ln()))
    }

    fn into_calibration(
        self,
        best: Fitted,
        known: &[usize],
        tried: Vec<Tried>,
    ) -> Result<TargetCalibration, TargetFitError> {
        let (theta, log_size) = self.plane(&best.state).ok_or(TargetFitError::NotSettled)?;
        let n = known.len() + self.stand.n();
        // By how much each number of the camera, and the size, change with one standard uncertainty of each unknown.
        let change = |at: usize| {
            let std = best.covariance[(at, at)].sqrt();
            let by = |h: f64| {
                let mut step = Dense::zeros(best.covariance.n_rows(), 1);
                step[(at, 0)] = h * std;
                self.plane(&self.stepped(&best.state, known, &step)).ok_or(TargetFitError::NotSettled)
            };
            let ((a, size_a), (b, size_b)) = (by(0.1)?, by(-0.1)?);
            let mut list: Vec<f64> = a.iter().zip(b).map(|(a, b)| 5.0 * (a - b)).collect();
            list.push(5.0 * (size_a - size_b));
            Ok(list)
        };
        let changes: Vec<Vec<f64>> = (0..n).map(change).collect::<Result<_, TargetFitError>>()?;
        let std = |at: usize| best.covariance[(at, at)].sqrt();
        let correlation = |i: usize, j: usize| best.covariance[(i, j)] / (std(i) * std(j));
        let covariance = |a: usize, b: usize| -> f64 {
            let row = |i: usize| (0..n).map(|j| correlation(i, j) * changes[j][b]).sum::<f64>();
            (0..n).map(|i| changes[i][a] * row(i)).sum()
        };
        // Coefficients are for the focal length, where that is known.
        let focal = self.focal(&best, known);
        let (focal_px, by) = focal.map_or((self.half, 1.0), |[focal, _]| (focal, focal / self.half));
        let scale = |k: usize| match k {
            0 => by.powi(2),
            1 => by.powi(4),
            2 | 3 => by,
            4 => by.powi(6),
            _ => 1.0,
        };
        let of: Vec<usize> = (0..PARAMETERS.len()).filter(|k| *k >= CENTRE || known.contains(k)).collect();
        let floor = |k: usize| match k {
            7 | 8 => SHAPE_FLOOR / self.half,
            9 | 10 => SHAPE_FLOOR,
            _ => 0.0,
        };
        let entry = |i: usize, j: usize| {
            let own = if i == j { floor(i).powi(2) } else { 0.0 };
            scale(i) * scale(j) * (0.5 * (covariance(i, j) + covariance(j, i)) + own)
        };
        let matrix: Vec<Vec<f64>> = of.iter().map(|&i| of.iter().map(|&j| entry(i, j)).collect()).collect();
        let found: Theta = std::array::from_fn(|k| scale(k) * theta[k]);
        let estimate = |(row, &parameter): (usize, &usize)| {
            let (value, std) = (found[parameter], matrix[row][row].sqrt());
            let before = if parameter < 7 { self.prior(parameter).1 * scale(parameter) } else { f64::INFINITY };
            Estimate { parameter, value, std, is_determined: std < UNDETERMINED * before }
        };
        let estimates = of.iter().enumerate().map(estimate).collect();
        let shape = CameraShape {
            focal_px: [focal_px, focal_px * best.state.common[ASPECT]],
            theta: found,
            covariance: Covariance { of, matrix },
            ..CameraShape::plain(self.size)
        };
        let list = self.homographies(self.stand, &best.state).ok_or(TargetFitError::NotSettled)?;
        let last = PARAMETERS.len();
        Ok(TargetCalibration {
            camera: Camera::new(shape)?,
            estimates,
            pixel_size_mm: log_size.exp(),
            relative_std: covariance(last, last).sqrt(),
            focal_px: focal,
            tilt_degrees: list.iter().map(|of| of.tilt_degrees(&best.state.common, self.half)).collect(),
            noise_px: best.noise_px,
            alike: alike(self.views, &best.residual),
            residual: best.residual,
            tried,
        })
    }
}

fn squares_of(residual: &[Vec<Point>]) -> f64 {
    residual.iter().flatten().map(|r| r[0] * r[0] + r[1] * r[1]).sum()
}

/// How alike what is left at neighbours on the target is, and how many standard deviations that is above chance.
fn alike(views: &[Vec<MarkedPoint>], residual: &[Vec<Point>]) -> [f64; 2] {
    let (mut product, mut square, mut n) = (0.0, 0.0, 0.0f64);
    for (points, left) in views.iter().zip(residual) {
        // The next point of a list is a neighbour, unless it begins a row.
        let step =
            points.windows(2).map(|pair| crate::plane::distance(pair[0].mm, pair[1].mm)).fold(f64::INFINITY, f64::min);
        for (pair, at) in left.windows(2).zip(points.windows(2)) {
            if crate::plane::distance(at[0].mm, at[1].mm) < 1.5 * step {
                product += pair[0][0] * pair[1][0] + pair[0][1] * pair[1][1];
                square += 0.5 * pair.iter().flatten().map(|v| v * v).sum::<f64>();
                n += 2.0;
            }
        }
    }
    if square > 0.0 { [product / square, product / square * n.sqrt()] } else { [0.0; 2] }
}

/// The similarity from mm to px about `centre` that fits best: `[u, v, x, y]`.
fn similarity(view: &[MarkedPoint], centre: Point) -> Option<[f64; 4]> {
    let (mut normal, mut pull) = (Dense::zeros(4, 4), Dense::zeros(4, 1));
    for MarkedPoint { px, mm: [x, y] } in view {
        for (row, wanted) in [([*x, -y, 1.0, 0.0], px[0] - centre[0]), ([*y, *x, 0.0, 1.0], px[1] - centre[1])] {
            for i in 0..4 {
                (0..4).for_each(|j| normal[(i, j)] += row[i] * row[j]);
                pull[(i, 0)] += row[i] * wanted;
            }
        }
    }
    let found = inverse_of(&normal)?.times(&pull);
    Some([0, 1, 2, 3].map(|k| found[(k, 0)]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::calibrate::tests::normals;

    const SIZE: [usize; 2] = [640, 480];
    const FOCAL: f64 = 1200.0;

    /// A board of 9 x 6 points, 10 mm apart, turned by these angles about x and y, seen by a pinhole with k1 for the
    /// focal length; written without what is tested.
    fn view(degrees: Point, shift: Point, k1: f64, mut off: impl FnMut() -> f64) -> Vec<MarkedPoint> {
        let (sin_a, cos_a) = degrees[0].to_radians().sin_cos();
        let (sin_b, cos_b) = degrees[1].to_radians().sin_cos();
        let point = |k: usize| {
            let [x, y] = [(k % 9) as f64 * 10.0, (k / 9) as f64 * 10.0];
            let (a, b) = (x - 40.0, y - 25.0);
            let (b, c) = (cos_a * b, sin_a * b);
            let (a, c) = (cos_b * a + sin_b * c, c * cos_b - sin_b * a);
            let z = 250.0 + c;
            let (u, v) = ((a + shift[0]) / z, (b + shift[1]) / z);
            let grown = FOCAL * (1.0 + k1 * (u * u + v * v));
            MarkedPoint { px: [324.0 + grown * u + off(), 236.0 + grown * v + off()], mm: [x, y] }
        };
        (0..54).map(point).collect()
    }

    const POSES: [(Point, Point); 5] = [
        ([0.0, 3.0], [0.0, 0.0]),
        ([25.0, 0.0], [5.0, -4.0]),
        ([-20.0, 10.0], [-6.0, 3.0]),
        ([5.0, 30.0], [2.0, 6.0]),
        ([0.0, -25.0], [-3.0, -2.0]),
    ];

    fn views(n: usize, k1: f64, noise: f64, seed: u64) -> Vec<Vec<MarkedPoint>> {
        let mut normal = normals(seed);
        POSES[..n].iter().map(|&(degrees, shift)| view(degrees, shift, k1, || noise * normal())).collect()
    }

    #[test]
    fn exact_places_give_the_camera_back() {
        for n in [1, 3, 5] {
            let found = calibrate_on_target(&views(n, 0.05, 1e-5, 1), 0.0, SIZE).unwrap();
            let shape = found.camera.shape();
            let by = (FOCAL / shape.focal_px[0]).powi(2);
            assert!((shape.theta[0] * by - 0.05).abs() < 1e-4, "{n}: {:?}", shape.theta);
            assert!((shape.theta[5] - 324.0).hypot(shape.theta[6] - 236.0) < 0.3, "{n}: {:?}", shape.theta);
            // The plane of the first view is turned by 3 degrees about y: at the centre, z is 250 mm within that.
            assert!((found.pixel_size_mm / (250.0 / FOCAL) - 1.0).abs() < 3e-3, "{n}: {}", found.pixel_size_mm);
            if let Some([focal, std]) = found.focal_px {
                assert!((focal - FOCAL).abs() < 0.1 && std < 0.1, "{n}: {focal} {std}");
                assert!((found.tilt_degrees[1] - 25.0).abs() < 0.01, "{:?}", found.tilt_degrees);
            }
        }
    }

    #[test]
    fn what_is_found_scatters_about_the_truth_as_it_says() {
        const DRAWS: usize = 60;
        for n in [1, 4] {
            let exact = calibrate_on_target(&views(n, 0.05, 1e-6, 1), 0.0, SIZE).unwrap();
            let truth = exact.camera.shape().clone();
            let (mut squares, mut inside) = (vec![0.0; 6], 0);
            for draw in 0..DRAWS as u64 {
                let found = calibrate_on_target(&views(n, 0.05, 0.03, draw + 2), 0.0, SIZE).unwrap();
                let shape = found.camera.shape();
                let by = (truth.focal_px[0] / shape.focal_px[0]).powi(2);
                let z = |k: usize, by: f64| {
                    let of = found.estimates.iter().find(|of| of.parameter == k).unwrap();
                    (of.value * by - truth.theta[k]) / (of.std * by)
                };
                let size = (found.pixel_size_mm / exact.pixel_size_mm).ln() / found.relative_std;
                for (sum, z) in squares.iter_mut().zip([z(0, by), z(5, 1.0), z(6, 1.0), z(7, 1.0), z(8, 1.0), size]) {
                    *sum += z * z / DRAWS as f64;
                }
                inside += usize::from(z(0, by).abs() < 1.96);
                assert!((found.noise_px / 0.03 - 1.0).abs() < 0.35, "{}", found.noise_px);
            }
            // 95 % of 60 are 57 +- 1.7; root mean squares of 60 numbers scatter by 9 %. The centre has a prior.
            assert!(inside >= 53, "{n}: {inside} {squares:?}");
            assert!(squares.iter().all(|square| square.sqrt() < 1.25), "{n}: {squares:?}");
        }
    }

    #[test]
    fn views_that_tell_nothing_are_refused() {
        let refused = |views: &[Vec<MarkedPoint>]| calibrate_on_target(views, 0.0, SIZE).unwrap_err();
        let flat: Vec<_> =
            (0..3).map(|k| view([0.0; 2], [2.0 * f64::from(k), 1.0], 0.05, normals(k as u64 + 1))).collect();
        let flat: Vec<Vec<MarkedPoint>> = flat
            .into_iter()
            .map(|list| {
                list.into_iter().map(|p| MarkedPoint { px: p.px.map(|v| (v * 50.0).round() / 50.0), ..p }).collect()
            })
            .collect();
        assert!(
            matches!(refused(&flat), TargetFitError::Parallel { .. } | TargetFitError::Off { .. }),
            "{}",
            refused(&flat)
        );
        let parallel: Vec<_> = (0..3)
            .map(|k| {
                let mut normal = normals(k + 1);
                view([0.0; 2], [2.0 * k as f64, 1.0], 0.05, move || 0.02 * normal())
            })
            .collect();
        assert!(matches!(refused(&parallel), TargetFitError::Parallel { .. }), "{}", refused(&parallel));
        assert!(matches!(refused(&[view([45.0, 0.0], [0.0; 2], 0.0, || 0.0)]), TargetFitError::NotInPlane { .. }));
        let mut off = views(3, 0.05, 0.02, 3);
        off[1][10].px[0] += 1.5;
        assert!(matches!(refused(&off), TargetFitError::Off { view: 2, number: 11, .. }));
        off[1][10].px[0] = f64::NAN;
        assert!(matches!(refused(&off), TargetFitError::Number { .. }));
        assert!(matches!(refused(&[off[0][..9].to_vec()]), TargetFitError::FewPoints { view: 1, n: 9 }));
        assert!(matches!(refused(&[]), TargetFitError::FewPoints { .. }));
        assert!(matches!(
            calibrate_on_target(&off[..1], -1.0, SIZE),
            Err(TargetFitError::Number { what: "the radius of a dot", .. })
        ));
        // Points that no plane explains.
        let mut random = normals(9);
        let scattered: Vec<MarkedPoint> = view([0.0; 2], [0.0; 2], 0.0, || 0.0)
            .iter()
            .map(|p| MarkedPoint { px: p.px.map(|_| 100.0 * random() + 300.0), ..*p })
            .collect();
        assert!(calibrate_on_target(&[scattered], 0.0, SIZE).is_err());
        assert!(matches!(
            calibrate_on_target(&views(1, 0.0, 0.02, 1), 0.0, [0, 0]),
            Err(TargetFitError::Number { what: "the size of the images", .. })
        ));
    }
}
