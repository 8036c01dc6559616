//! Calibration from images of a plane that moved rigidly in itself by unknown amounts (THEORY 22).
//!
//! Unknowns are the camera and, for each image, a shift, a turn and a change of the distance; data are displacement
//! fields. Gauss-Newton with the covariance of the nodes' noise: neighbours go together as the inverse of the mass
//! matrix says, and images share the noise of their reference.

use super::even_noise::EvenNoise;
use super::marked::inverse_of;
use super::model::times;
use super::{Camera, CameraError, CameraShape, Covariance, PARAMETERS};
use crate::field::{Measurement, RigidMotion};
use crate::linalg::{BlockMatrix, Dense};
use crate::plane::Point;
use crate::units::Px;
use thiserror::Error;

/// Shortest shift of the images, by half a diagonal, that anything is to be seen of.
const LEAST_SHIFT: f64 = 0.005;
/// Fewest nodes that are measured in all images.
const FEWEST_NODES: usize = 30;
/// Gauss-Newton on small corrections of a smooth map: five steps are many.
const STEPS: usize = 20;
/// A step that moves no unknown by more of its standard uncertainty ends the search.
const SETTLED: f64 = 1e-3;
/// How far the squares fall, in units of the noise, when each image may also be stretched: chance reaches it once in
/// 1e7.
const STRETCHED: f64 = 32.0;
/// Standard deviation of a change of the distance before anything is seen, `dZ/Z`: a specimen that is moved by hand.
const NEARER: f64 = 2e-3;

/// Standard deviation of each parameter before anything is seen, for lengths in half diagonals: wide, so that data that
/// say nothing leave a parameter uncertain, not wrong.
pub(super) const PRIOR: [f64; PARAMETERS.len()] = [0.05, 0.05, 0.01, 0.01, 0.05, 0.03, 0.03, 0.1, 0.1, 2e-3, 2e-3];
/// A parameter is not determined where the data leave more than this of what was known before.
pub(super) const UNDETERMINED: f64 = 0.5;
/// Parameters that are always unknown: k1, centre, tilt, stretch and shear.
const ALWAYS: [usize; 7] = [0, 5, 6, 7, 8, 9, 10];
/// Groups that are taken in where the data speak for them, in this order.
pub(super) const GROUPS: [(&str, &[usize]); 3] = [("k2", &[1]), ("p1, p2", &[2, 3]), ("k3", &[4])];

/// How an image moved against the reference.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Moved {
    /// Shift of the centre of the image in the plane, px.
    pub shift: Point,
    /// Turn, radians.
    pub turn_rad: f64,
    /// How much larger it is seen, `-dZ/Z`.
    pub nearer: f64,
}

/// A parameter as it was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Its place among [`PARAMETERS`].
    pub parameter: usize,
    /// Its value.
    pub value: f64,
    /// Its standard uncertainty.
    pub std: f64,
    /// Whether the data say anything of it.
    pub is_determined: bool,
}

/// A group of coefficients, and what the data say of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Tried {
    /// Their names.
    pub names: &'static str,
    /// By how much the Bayesian information criterion falls with them: above zero they are taken in.
    pub evidence: f64,
}

/// What was found.
#[derive(Debug, Clone)]
pub struct Calibration {
    /// The camera with its covariance.
    pub camera: Camera,
    /// Its parameters that were unknown.
    pub estimates: Vec<Estimate>,
    /// How each image moved.
    pub moved: Vec<Moved>,
    /// Measured less computed displacement at each node of each image, px; `None` where it was not used.
    pub residual: Vec<Vec<Option<Point>>>,
    /// Sum of squares by its degrees of freedom: 1 where noise is all that is left. The covariance is scaled by it
    /// where it is larger.
    pub squares: f64,
    /// Coefficients that were tried beside those that are always unknown.
    pub tried: Vec<Tried>,
}

/// Why nothing can be calibrated.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CalibrationError {
    /// No field at all.
    #[error("no image could be correlated with the first; see summary.json")]
    NoImage,
    /// Little is measured in all of them.
    #[error("only {0} nodes are measured in all images; move the specimen less, or make the zone larger")]
    FewNodes(usize),
    /// Nothing moved.
    #[error(
        "the images moved by at most {largest_px:.2} px; move the specimen in its plane by 5 to 10 % of the image, {wanted_px:.0} \
         px or more, along and across"
    )]
    NotMoved {
        /// The largest shift, px.
        largest_px: f64,
        /// What would do.
        wanted_px: f64,
    },
    /// The specimen was stretched, or left its plane.
    #[error(
        "image {image} did not move rigidly: it is strained by {strain:.1e} +- {std:.0e}; calibrate with images of a specimen that is \
         free, or held alike, and moves in its plane"
    )]
    Stretched {
        /// Number of the image, from 1.
        image: usize,
        /// Largest of the strains.
        strain: f64,
        /// Its standard uncertainty.
        std: f64,
    },
    /// The search does not end.
    #[error("no camera explains these images: the search does not settle; are they of one camera and one plane?")]
    NotSettled,
    /// What was found cannot be.
    #[error("what was found is no camera: {0}")]
    Camera(#[from] CameraError),
}

/// The camera of images of the size `image_size_px` whose displacement `fields` are those of a plane that moved
/// rigidly, all from one reference that is the mean of `n_references` images.
///
/// # Errors
/// See [`CalibrationError`].
pub fn calibrate(
    fields: &[Measurement<Px>],
    image_size_px: [usize; 2],
    n_references: usize,
) -> Result<Calibration, CalibrationError> {
    let data = Data::new(fields, image_size_px, n_references)?;
    let start = State::new(&data);
    let largest_px = start.moved.iter().fold(0.0f64, |most, moved| most.max(moved.shift[0].hypot(moved.shift[1])));
    if largest_px < LEAST_SHIFT * data.length {
        return Err(CalibrationError::NotMoved { largest_px, wanted_px: 0.1 * data.length });
    }
    let mut known = ALWAYS.to_vec();
    let mut best = data.fit(start.clone(), &known)?;
    let mut tried = Vec::new();
    for (names, group) in GROUPS {
        let more: Vec<usize> = known.iter().chain(group).copied().collect();
        // What too few coefficients came to may lie far from where more of them lead.
        let fitted = data.fit(start.clone(), &more).or_else(|_| data.fit(best.state.clone(), &more));
        let Ok(fitted) = fitted else { continue };
        let scale = (fitted.squares / data.freedom(&more)).max(1.0);
        let evidence = (best.squares - fitted.squares) / scale - group.len() as f64 * (data.n_data() as f64).ln();
        tried.push(Tried { names, evidence });
        if evidence > 0.0 {
            (known, best) = (more, fitted);
        }
    }
    known.sort_unstable();
    let best = data.fit(best.state, &known)?;
    data.refuse_stretch(&best, &known)?;
    data.into_calibration(best, &known, tried)
}

/// Fields as they are fitted.
struct Data {
    shape: CameraShape,
    /// Half a diagonal, px.
    length: f64,
    nodes: Vec<Point>,
    /// Numbers of these nodes in the mesh.
    numbers: Vec<usize>,
    n_mesh: usize,
    /// Displacement at each node of each image.
    fields: Vec<Vec<Point>>,
    /// What makes noise of each displacement white but for its neighbours.
    whitening: Vec<Vec<Point>>,
    mass: BlockMatrix,
    /// Inverse of the covariance between images.
    images: Dense,
}

/// Where a search is.
#[derive(Debug, Clone)]
struct State {
    shape: CameraShape,
    moved: Vec<Moved>,
}

/// Where it ended.
struct Fitted {
    state: State,
    squares: f64,
    covariance: Dense,
}

/// What an image adds to the normal matrix.
struct Block {
    /// Numbers of its unknowns.
    of_image: Vec<usize>,
    /// The derivatives by them, white but for neighbours, and the residual last.
    columns: Vec<Vec<Point>>,
    /// The same times the mass matrix.
    weighed: Vec<Vec<Point>>,
}

/// What is unknown.
#[derive(Debug, Clone, Copy)]
enum Unknown {
    Camera(usize),
    Shift(usize),
    Turn,
    Nearer,
    /// Stretch along x and across, and shear.
    Strain(usize),
}

/// Unknowns of each image: those of its motion.
const OF_IMAGE: [Unknown; 4] = [Unknown::Shift(0), Unknown::Shift(1), Unknown::Turn, Unknown::Nearer];

impl Data {
    fn new(
        fields: &[Measurement<Px>],
        image_size_px: [usize; 2],
        n_references: usize,
    ) -> Result<Self, CalibrationError> {
        let Some(mesh) = fields.first().map(|field| &field.mesh) else { return Err(CalibrationError::NoImage) };
        let everywhere =
            |node: usize| fields.iter().all(|field| field.measured[node] && field.sigma[node].iter().all(|s| *s > 0.0));
        let used: Vec<bool> = (0..mesh.n_nodes()).map(everywhere).collect();
        let whole: Vec<usize> = (0..mesh.n_elements())
            .filter(|&element| mesh.elements()[element].iter().all(|&node| used[node as usize]))
            .collect();
        let EvenNoise { numbers, mass, variance } = EvenNoise::new(mesh, &whole);
        if numbers.len() < FEWEST_NODES {
            return Err(CalibrationError::FewNodes(numbers.len()));
        }
        let at = |list: &[Point]| numbers.iter().map(|&node| list[node]).collect::<Vec<Point>>();
        let white = |field: &Measurement<Px>| {
            let of_node = |(sigma, v): (Point, &Point)| [0, 1].map(|c| v[c].sqrt() / sigma[c]);
            at(&field.sigma).into_iter().zip(&variance).map(of_node).collect()
        };
        // Of the reference noise is in all images: the covariance of images is 1 + 1/k and 1/k, over their sum.
        let (n, k) = (fields.len() as f64, n_references.max(1) as f64);
        let inverse = |i: usize, j: usize| (1.0 + 1.0 / k) * (f64::from(u8::from(i == j)) - 1.0 / (k + n));
        Ok(Self {
            shape: CameraShape::plain(image_size_px),
            length: 0.5 * (image_size_px[0] as f64).hypot(image_size_px[1] as f64),
            nodes: at(mesh.nodes()),
            n_mesh: mesh.n_nodes(),
            fields: fields.iter().map(|field| at(&field.displacement)).collect(),
            whitening: fields.iter().map(white).collect(),
            images: Dense::from_fn(fields.len(), fields.len(), inverse),
            numbers,
            mass,
        })
    }

    fn n_data(&self) -> usize {
        2 * self.nodes.len() * self.fields.len()
    }

    fn freedom(&self, known: &[usize]) -> f64 {
        (self.n_data() as f64 - (known.len() + OF_IMAGE.len() * self.fields.len()) as f64).max(1.0)
    }

    fn prior(&self, unknown: Unknown) -> f64 {
        match unknown {
            Unknown::Camera(k @ (5 | 6)) => PRIOR[k] * self.length,
            Unknown::Camera(k @ (7 | 8)) => PRIOR[k] / self.length,
            Unknown::Camera(k) => PRIOR[k],
            Unknown::Nearer => NEARER,
            Unknown::Shift(_) | Unknown::Turn | Unknown::Strain(_) => f64::INFINITY,
        }
    }

    /// What a parameter is before anything is seen, less what it is.
    fn prior_pull(&self, state: &State, unknown: Unknown, image: usize) -> f64 {
        match unknown {
            Unknown::Camera(k) => self.shape.theta[k] - state.shape.theta[k],
            Unknown::Nearer => -state.moved[image].nearer,
            _ => 0.0,
        }
    }

    /// Gauss-Newton from `state` on the parameters `known` and the motions.
    fn fit(&self, mut state: State, known: &[usize]) -> Result<Fitted, CalibrationError> {
        let unknowns = self.unknowns(known, &OF_IMAGE);
        for _ in 0..STEPS {
            let Some((normal, pull, squares)) = self.normal(&state, &unknowns) else { break };
            let Some(covariance) = inverse_of(&normal) else { break };
            let step: Vec<f64> =
                (0..pull.len()).map(|r| (0..pull.len()).map(|c| covariance[(r, c)] * pull[c]).sum()).collect();
            let settled = step.iter().enumerate().all(|(k, step)| step.abs() <= SETTLED * covariance[(k, k)].sqrt());
            if settled {
                return Ok(Fitted { state, squares, covariance });
            }
            state = state.stepped(&unknowns, &step);
        }
        Err(CalibrationError::NotSettled)
    }

    /// The unknowns in order, each with its image; those of the camera, of all images, first.
    fn unknowns(&self, known: &[usize], of_image: &[Unknown]) -> Vec<(Unknown, usize)> {
        let camera = known.iter().map(|&k| (Unknown::Camera(k), 0));
        let images = (0..self.fields.len()).flat_map(|image| of_image.iter().map(move |&unknown| (unknown, image)));
        camera.chain(images).collect()
    }

    /// The normal matrix, its right-hand side and the sum of squares of noise; `None` where the state is no camera.
    fn normal(&self, state: &State, unknowns: &[(Unknown, usize)]) -> Option<(Dense, Vec<f64>, f64)> {
        let camera = Camera::new(state.shape.clone()).ok()?;
        let n = unknowns.len();
        let mut blocks: Vec<Block> = Vec::new();
        for (image, whitening) in self.whitening.iter().enumerate() {
            let is_own = |k: &usize| matches!(unknowns[*k].0, Unknown::Camera(_)) || unknowns[*k].1 == image;
            let of_image: Vec<usize> = (0..n).filter(is_own).collect();
            let mut columns = vec![vec![[0.0; 2]; self.nodes.len()]; of_image.len() + 1];
            for (node, white) in whitening.iter().enumerate() {
                let (computed, by) = state.displaced(&camera, self.nodes[node], image, &of_image, unknowns)?;
                let left = [0, 1].map(|c| self.fields[image][node][c] - computed[c]);
                for (column, by) in columns.iter_mut().zip(by.iter().chain([&left])) {
                    column[node] = [0, 1].map(|c| white[c] * by[c]);
                }
            }
            let weighed = columns.iter().map(|column| self.mass.multiply(column)).collect();
            blocks.push(Block { of_image, columns, weighed });
        }
        let (mut normal, mut pull, mut squares) = (Dense::zeros(n, n), vec![0.0; n], 0.0);
        for (i, Block { of_image: rows, weighed, .. }) in blocks.iter().enumerate() {
            for (j, Block { of_image: others, columns, .. }) in blocks.iter().enumerate() {
                let of_images = self.images[(i, j)];
                let product = |a: &[Point], b: &[Point]| -> f64 {
                    of_images * a.iter().zip(b).map(|(a, b)| a[0] * b[0] + a[1] * b[1]).sum::<f64>()
                };
                for (a, &row) in rows.iter().enumerate() {
                    for (b, &column) in others.iter().enumerate() {
                        normal[(row, column)] += product(&weighed[a], &columns[b]);
                    }
                    pull[row] += product(&weighed[a], &columns[others.len()]);
                }
                squares += product(&weighed[rows.len()], &columns[others.len()]);
            }
        }
        for (k, &(unknown, image)) in unknowns.iter().enumerate() {
            let weight = 1.0 / self.prior(unknown).powi(2);
            let off = self.prior_pull(state, unknown, image);
            normal[(k, k)] += weight;
            pull[k] += weight * off;
            squares += weight * off * off;
        }
        Some((normal, pull, squares))
    }

    /// Refuses images that explain themselves much better when each may be stretched as well.
    fn refuse_stretch(&self, best: &Fitted, known: &[usize]) -> Result<(), CalibrationError> {
        let strains = [Unknown::Strain(0), Unknown::Strain(1)];
        let of_image: Vec<Unknown> = OF_IMAGE.into_iter().chain(strains).collect();
        let unknowns = self.unknowns(known, &of_image);
        let Some((normal, pull, _)) = self.normal(&best.state, &unknowns) else { return Ok(()) };
        let Some(covariance) = inverse_of(&normal) else { return Ok(()) };
        let step = |r: usize| (0..pull.len()).map(|c| covariance[(r, c)] * pull[c]).sum::<f64>();
        let fall: f64 = (0..pull.len()).map(|k| step(k) * pull[k]).sum();
        let scale = (best.squares / self.freedom(known)).max(1.0);
        if fall / scale < STRETCHED + 2.0 * self.fields.len() as f64 {
            return Ok(());
        }
        let strained = (0..unknowns.len()).filter(|&k| matches!(unknowns[k].0, Unknown::Strain(_)));
        let worst = strained.max_by(|&a, &b| step(a).abs().total_cmp(&step(b).abs()));
        worst.map_or(Ok(()), |k| {
            let std = (scale * covariance[(k, k)]).sqrt();
            Err(CalibrationError::Stretched { image: unknowns[k].1 + 1, strain: step(k).abs(), std })
        })
    }

    fn into_calibration(
        self,
        best: Fitted,
        known: &[usize],
        tried: Vec<Tried>,
    ) -> Result<Calibration, CalibrationError> {
        let Fitted { state, squares, covariance } = best;
        let squares = squares / self.freedom(known);
        let scale = squares.max(1.0);
        let matrix = (0..known.len()).map(|r| (0..known.len()).map(|c| scale * covariance[(r, c)]).collect()).collect();
        let estimate = |(row, &parameter): (usize, &usize)| {
            let std = (scale * covariance[(row, row)]).sqrt();
            let is_determined = covariance[(row, row)].sqrt() < UNDETERMINED * self.prior(Unknown::Camera(parameter));
            Estimate { parameter, value: state.shape.theta[parameter], std, is_determined }
        };
        let estimates = known.iter().enumerate().map(estimate).collect();
        let covariance = Covariance { of: known.to_vec(), matrix };
        let camera = Camera::new(CameraShape { covariance, ..state.shape.clone() })?;
        let mut residual = vec![vec![None; self.n_mesh]; self.fields.len()];
        for (image, (of_image, measured)) in residual.iter_mut().zip(&self.fields).enumerate() {
            for ((&number, &x), u) in self.numbers.iter().zip(&self.nodes).zip(measured) {
                let computed = state.displaced(&camera, x, image, &[], &[]);
                of_image[number] = computed.map(|(computed, _)| [0, 1].map(|c| u[c] - computed[c]));
            }
        }
        Ok(Calibration { camera, estimates, moved: state.moved, residual, squares, tried })
    }
}

impl State {
    /// No distortion, and the rigid motion of each image.
    fn new(data: &Data) -> Self {
        let middle = [data.shape.theta[5], data.shape.theta[6]];
        let moved = |field: &Vec<Point>| {
            let points = data.nodes.iter().copied().zip(field.iter().copied());
            RigidMotion::fit(points).map_or_else(Moved::default, |motion| Moved {
                shift: motion.displacement(middle),
                turn_rad: motion.rotation_rad,
                nearer: 0.0,
            })
        };
        Self { shape: data.shape.clone(), moved: data.fields.iter().map(moved).collect() }
    }

    fn stepped(mut self, unknowns: &[(Unknown, usize)], step: &[f64]) -> Self {
        for (&(unknown, image), step) in unknowns.iter().zip(step) {
            match unknown {
                Unknown::Camera(k) => self.shape.theta[k] += step,
                Unknown::Shift(c) => self.moved[image].shift[c] += step,
                Unknown::Turn => self.moved[image].turn_rad += step,
                Unknown::Nearer => self.moved[image].nearer += step,
                Unknown::Strain(_) => {}
            }
        }
        self
    }

    /// The displacement in `image` of what is seen at `x`, `P(X') - x` with `X' = C + t + (1 + e) R (X - C)`, and its
    /// derivatives by the unknowns numbered `of_image`; `C` is the middle of the image.
    fn displaced(
        &self,
        camera: &Camera,
        x: Point,
        image: usize,
        of_image: &[usize],
        unknowns: &[(Unknown, usize)],
    ) -> Option<(Point, Vec<Point>)> {
        let Moved { shift, turn_rad, nearer } = self.moved[image];
        let middle = self.shape.image_size_px.map(|n| 0.5 * (n as f64 - 1.0));
        let at = camera.plane(x)?;
        let d = [at[0] - middle[0], at[1] - middle[1]];
        let (sin, cos) = turn_rad.sin_cos();
        let turned = |v: Point| [cos * v[0] - sin * v[1], sin * v[0] + cos * v[1]];
        let grown = |v: Point| turned(v).map(|v| (1.0 + nearer) * v);
        let moved = grown(d);
        let to = [0, 1].map(|c| middle[c] + shift[c] + moved[c]);
        let pixel = camera.pixel(to);
        let displacement = [pixel[0] - x[0], pixel[1] - x[1]];
        if of_image.is_empty() {
            return Some((displacement, Vec::new()));
        }
        let (slope, there, back) = (camera.slope(to), camera.by_parameters(to), camera.plane_slope(at)?);
        let here = camera.by_parameters(at);
        let by = |&k: &usize| match unknowns[k].0 {
            // What is seen at x moves by -(dP/dX)^-1 dP/dtheta, and with it where it goes to.
            Unknown::Camera(k) => {
                let along = times(slope, grown(times(back, here[k])));
                [there[k][0] - along[0], there[k][1] - along[1]]
            }
            Unknown::Shift(c) => times(slope, [0, 1].map(|k| f64::from(u8::from(k == c)))),
            Unknown::Turn => times(slope, [-moved[1], moved[0]]),
            Unknown::Nearer => times(slope, turned(d)),
            Unknown::Strain(0) => times(slope, [d[0], -d[1]]),
            Unknown::Strain(_) => times(slope, [d[1], d[0]]),
        };
        Some((displacement, of_image.iter().map(by).collect()))
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::field::Status;
    use crate::isa::Isa;
    use crate::linalg::{BlockJacobi, ElementMatrix, Pattern, alike, inverse_diagonal};
    use crate::mesh::{Mesh, Roi, Zone};
    use std::sync::Arc;

    const SIZE: [usize; 2] = [1024, 1024];
    /// Standard deviation of the load that makes the noise of one image: some 0.02 px at a node inside.
    const NOISE: f64 = 0.12;

    /// Normal numbers from a seed.
    pub(in crate::camera) fn normals(seed: u64) -> impl FnMut() -> f64 {
        let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
        let mut even = move || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        move || (0..12).map(|_| even()).sum::<f64>() - 6.0
    }

    /// The mesh, its mass matrix, and the variance of its inverse.
    struct Plate {
        mesh: Arc<Mesh<Px>>,
        mass: BlockMatrix,
        jacobi: BlockJacobi,
        variance: Vec<Point>,
    }

    impl Plate {
        fn new() -> Self {
            let zone = Zone::rectangle("all", Roi { x0: 64.0, y0: 64.0, x1: 960.0, y1: 960.0 });
            let mesh = Mesh::on_zones(&[zone], 64, SIZE[0], SIZE[1]).unwrap();
            let pattern = Arc::new(Pattern::new(mesh.n_nodes(), mesh.elements()));
            let matrices: Vec<ElementMatrix> =
                (0..mesh.n_elements()).map(|e| alike(mesh.geometry(e).mass_matrix(), 1.0)).collect();
            let mass = BlockMatrix::assemble(&pattern, mesh.elements(), &matrices);
            let jacobi = BlockJacobi::new(&mass);
            let colours = pattern.colours(0..mesh.n_nodes(), 5);
            let variance = inverse_diagonal(Isa::detect(), &mass, &jacobi, &colours);
            Self { mesh: mesh.into(), mass, jacobi, variance }
        }

        /// Noise of one image on the nodes: white in the image, so of the covariance of the inverse mass matrix.
        fn noise(&self, normal: &mut impl FnMut() -> f64) -> Vec<Point> {
            let mut load = vec![[0.0; 2]; self.mesh.n_nodes()];
            for (element, nodes) in self.mesh.elements().iter().enumerate() {
                let matrix = self.mesh.geometry(element).mass_matrix();
                let factor = Dense::from_fn(4, 4, |i, j| matrix[i][j]).cholesky().unwrap();
                let draw: Vec<f64> = (0..8).map(|_| NOISE * normal()).collect();
                let of_corners = factor.half_times(&Dense::from_fn(4, 2, |i, c| draw[2 * i + c]));
                nodes
                    .iter()
                    .enumerate()
                    .for_each(|(i, &n)| (0..2).for_each(|c| load[n as usize][c] += of_corners[(i, c)]));
            }
            self.jacobi.solve(&self.mass, &load, 1e-8, 1000).0
        }

        /// Fields of the images that `truth` makes, with noise of images and of their reference.
        fn fields(&self, truth: &State, normal: &mut impl FnMut() -> f64) -> Vec<Measurement<Px>> {
            let camera = Camera::new(truth.shape.clone()).unwrap();
            let of_reference = self.noise(normal);
            let field = |image: usize, own: Vec<Point>| {
                let of_node = |(node, &x): (usize, &Point)| {
                    let (u, _) = truth.displaced(&camera, x, image, &[], &[]).unwrap();
                    [0, 1].map(|c| u[c] + own[node][c] + of_reference[node][c])
                };
                Measurement {
                    status: Status::Converged,
                    displacement: self.mesh.nodes().iter().enumerate().map(of_node).collect(),
                    sigma: self.variance.iter().map(|v| v.map(|v| NOISE * (2.0 * v).sqrt())).collect(),
                    measured: vec![true; self.mesh.n_nodes()],
                    element_residual: vec![1.0; self.mesh.n_elements()],
                    model_error: None,
                    marks: None,
                    points: None,
                    mesh: Arc::clone(&self.mesh),
                }
            };
            (0..truth.moved.len()).map(|image| field(image, self.noise(normal))).collect()
        }
    }

    fn truth(k1: f64, tilt: Point) -> State {
        let mut shape = CameraShape::plain(SIZE);
        (shape.theta[0], shape.theta[7], shape.theta[8]) = (k1, tilt[0], tilt[1]);
        let moved = |shift, turn_rad, nearer| Moved { shift, turn_rad, nearer };
        State { shape, moved: vec![moved([52.0, 3.0], 1e-3, 4e-4), moved([-4.0, 47.0], -2e-3, -3e-4)] }
    }

    #[test]
    fn what_is_found_scatters_about_the_truth_as_it_says() {
        let plate = Plate::new();
        let mut normal = normals(22);
        let (mut squares, mut inside, mut left) = ([0.0; 3], 0, 0.0);
        const DRAWS: usize = 60;
        for _ in 0..DRAWS {
            // Centre, stretch and changes of the distance are unknown as their priors say.
            let mut truth = truth(1e-3, [2e-5, -1e-5]);
            for k in [5, 6, 9, 10] {
                let length = if k < 7 { 0.5 * 1024f64.hypot(1024.0) } else { 1.0 };
                truth.shape.theta[k] += PRIOR[k] * length * normal();
            }
            truth.moved.iter_mut().for_each(|moved| moved.nearer = NEARER * normal());
            let found = calibrate(&plate.fields(&truth, &mut normal), SIZE, 1).unwrap();
            for (sum, k) in squares.iter_mut().zip([0, 7, 8]) {
                let of = found.estimates.iter().find(|of| of.parameter == k).unwrap();
                assert!(of.is_determined, "{of:?}");
                let z = (of.value - truth.shape.theta[k]) / of.std;
                *sum += z * z / DRAWS as f64;
                inside += usize::from(k == 0 && z.abs() < 1.96);
            }
            left += found.squares / DRAWS as f64;
        }
        // 95 % of 60 are 57 +- 1.7; root mean squares of 60 numbers scatter by 9 %, two of them allowed.
        assert!((54..=60).contains(&inside), "{inside}, {squares:?}");
        assert!(squares.iter().all(|square| (0.82..1.18).contains(&square.sqrt())), "{squares:?}");
        // 900 numbers in each of 60 draws.
        assert!((left - 1.0).abs() < 0.03, "{left}");
    }

    #[test]
    fn a_stronger_lens_is_found_with_the_coefficients_that_it_needs() {
        let plate = Plate::new();
        let mut truth = truth(-0.02, [6e-5, 0.0]);
        truth.shape.theta[1] = 0.01;
        let found = calibrate(&plate.fields(&truth, &mut normals(5)), SIZE, 1).unwrap();
        let taken: Vec<&str> = found.tried.iter().filter(|of| of.evidence > 0.0).map(|of| of.names).collect();
        assert_eq!(taken, ["k2"]);
        for of in &found.estimates {
            let z = (of.value - truth.shape.theta[of.parameter]) / of.std;
            // Nine numbers, none beyond chance.
            assert!(z.abs() < 3.5, "{}: {z}", PARAMETERS[of.parameter]);
        }
    }

    #[test]
    fn images_that_nothing_can_be_found_on_are_refused() {
        let plate = Plate::new();
        let mut normal = normals(3);
        let mut still = truth(1e-3, [0.0; 2]);
        still.moved.iter_mut().for_each(|moved| moved.shift = moved.shift.map(|t| 0.05 * t));
        let fields = plate.fields(&still, &mut normal);
        assert!(matches!(calibrate(&fields, SIZE, 1), Err(CalibrationError::NotMoved { .. })));
        let mut stretched = plate.fields(&truth(1e-3, [0.0; 2]), &mut normal);
        let nodes = plate.mesh.nodes();
        stretched[1].displacement.iter_mut().zip(nodes).for_each(|(u, x)| u[0] += 1e-3 * x[0]);
        let refused = calibrate(&stretched, SIZE, 1).unwrap_err();
        assert!(matches!(refused, CalibrationError::Stretched { .. }), "{refused}");
        assert!(matches!(calibrate(&[], SIZE, 1), Err(CalibrationError::NoImage)));
        stretched[0].measured.iter_mut().for_each(|measured| *measured = false);
        assert!(matches!(calibrate(&stretched, SIZE, 1), Err(CalibrationError::FewNodes(0))));
    }
}
