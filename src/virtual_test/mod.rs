//! The virtual test: a bonded joint that is pulled apart in the computer, and photographed.
//!
//! A joint larger than the image is solved under remote mixed-mode opening (or mostly opening, or mostly sliding:
//! [`Mixity`]), on a mesh twice as fine as that of an identification with elements of 16 px; the images are textures
//! moved by the computed displacements. All that an experiment hides is known here: displacements, tractions,
//! parameters. No image is interpolated.

mod case;
mod options;

pub use options::{Mixity, VirtualError, VirtualOptions};

use crate::field::RigidMotion;
use crate::imaging::Image;
use crate::mechanics::cohesive::{CohesiveLaw, ExtendedXuNeedleman};
use crate::mechanics::substrate::{PlaneState, RambergOsgood, SubstrateLaw};
use crate::mechanics::{
    BoundaryHistory, ForwardOptions, Instant, JointMesh, JointParts, MeshFault, Model, ModelOptions, NodeGroup,
    Solution,
};
use crate::synth::{GridField, RenderOptions, Strips, SynthError, Texture, exact_at, render};
use crate::units::{PixelSize, Vector};
use std::sync::Arc;

/// Millimetres per pixel: 30.9 um over 16 px.
pub const PIXEL_MM: f64 = 30.9e-3 / 16.0;
/// The same as a scale.
pub const SCALE: PixelSize = PixelSize::new(PIXEL_MM).expect("a size above zero");
/// Columns and rows of the images.
pub const SIZE: [usize; 2] = [720, 448];
/// Side of the identification's elements, px.
pub const ELEMENT_PX: f64 = 16.0;
/// Columns of elements in the region that is measured, and rows in each strip.
pub const REGION: [usize; 2] = [39, 10];
/// Thickness of the adhesive, px: 60 um, rounded so that its faces lie at a multiple of 1/32 px.
pub const BAND_PX: f64 = 31.0625;
/// Elements of the truth along the side of one of the identification's.
const FINER: usize = 2;
/// Left end of the computed joint, px; it lies whole elements from the region's.
const LEFT_PX: f64 = -464.0;
/// Columns and rows (of each strip) of the computed joint.
const JOINT: [usize; 2] = [168, 31];
/// Left end of the region, px.
const REGION_LEFT_PX: f64 = 48.0;
/// Young's modulus (MPa), Poisson's ratio, sigma_0 (MPa), alpha, n of the strips: 2024-T3 (Fedele et al. 2009).
pub const ALUMINIUM: [f64; 5] = [72_000.0, 0.33, 180.0, 0.06, 7.0];

/// How the grips move over the test, lengths in mm. The remote edges open by
/// `theta lambda [ln(1 + e^s) - dip exp(-(s + 2)^2/2)]`, `s = (x - a)/lambda`: closed, and pressed together a little,
/// ahead of `a`; turned against each other by `theta` behind it. They slide by `slide` and drift together.
mod remote {
    use super::Mixity;

    /// Angle between the strips behind the front, rad: each turns by half of it. First and last instant. Of a sliding
    /// test it opens the joint by a fifth of what its largest traction takes, so that the data know something of
    /// that too.
    pub const fn theta(mixity: Mixity) -> [f64; 2] {
        match mixity {
            Mixity::Opening | Mixity::Mixed => [0.028, 0.036],
            Mixity::Sliding => [0.0014, 0.0018],
        }
    }
    /// Sliding of the grips, mm. First and last instant. The whole joint of a sliding test passes its largest traction
    /// at about a third of it, and has hardly any left at the end.
    pub const fn slide_mm(mixity: Mixity) -> [f64; 2] {
        match mixity {
            Mixity::Opening => [0.001, 0.006],
            Mixity::Mixed => [0.006, 0.036],
            Mixity::Sliding => [0.02, 0.12],
        }
    }
    /// Place of `a` along the image, px.
    pub const FRONT_PX: [f64; 2] = [330.0, -10.0];
    pub const LAMBDA_PX: f64 = 64.0;
    pub const DIP: f64 = 0.6;
    /// Of the last instant, px.
    pub const DRIFT_PX: [f64; 2] = [1.7, 2.6];
}

/// A test that was computed and can be photographed. What is asked of a frame `k` panics when there is no such frame.
#[derive(Debug)]
pub struct VirtualTest {
    options: VirtualOptions,
    law: Box<dyn CohesiveLaw>,
    model: Model,
    solution: Solution,
    texture: Texture,
}

impl VirtualTest {
    /// Computes the test with the extended law of Xu and Needleman.
    ///
    /// # Errors
    /// Options that mean nothing, and a law under which some instant has no solution.
    pub fn new(options: VirtualOptions) -> Result<Self, VirtualError> {
        let [phi_n, delta_n, delta_t, r] = options.law;
        Self::with_law(options, Box::new(ExtendedXuNeedleman::new(phi_n, delta_n, delta_t, r)?))
    }

    /// The same with any law for the truth; `options.law` is then no more than what its case file would know of `r`.
    ///
    /// # Errors
    /// Those of [`VirtualTest::new`].
    pub fn with_law(options: VirtualOptions, law: Box<dyn CohesiveLaw>) -> Result<Self, VirtualError> {
        options.check()?;
        let texture = Texture::new(options.seed, options.speckle_px)?;
        let mesh = joint_mesh()?;
        let boundary = remote_boundary(&mesh, options.instants, options.mixity);
        let aluminium: Arc<dyn SubstrateLaw> = Arc::new(RambergOsgood::new(ALUMINIUM, PlaneState::PlaneStress)?);
        let materials = mesh.groups().iter().map(|_| Arc::clone(&aluminium)).collect();
        let model_options = ModelOptions { kinematics: options.kinematics, ..ModelOptions::default() };
        let model = Model::new(mesh, materials, boundary.nodes(), model_options)?;
        let solution = model.forward(&*law, &boundary, &ForwardOptions::default())?;
        if let Some(at) = solution.instants.iter().position(|instant| !instant.status.converged()) {
            return Err(VirtualError::NoSolution { instant: at + 1 });
        }
        Ok(Self { options, law, model, solution, texture })
    }

    /// What it was made with.
    pub fn options(&self) -> &VirtualOptions {
        &self.options
    }

    /// The true law of the adhesive.
    pub fn law(&self) -> &dyn CohesiveLaw {
        &*self.law
    }

    /// The computed joint: mm, x to the right from the centre of the top-left pixel, y up from there.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// The true displacements of all nodes of the joint.
    pub fn solution(&self) -> &Solution {
        &self.solution
    }

    /// The motion of frame `k` in the image: 0 is the reference, at rest.
    pub fn motion(&self, k: usize) -> Strips {
        self.motion_with(k, |_, u| u)
    }

    /// The motion of frame `k` after the rigid motion (exact rotation, least squares) of the measured region, both
    /// strips together, is turned back.
    pub fn motion_without_rigid(&self, k: usize) -> Strips {
        let motion = self.motion(k);
        let step = ELEMENT_PX;
        let points = zones_px().into_iter().flat_map(|[x0, y0, ..]| {
            let [columns, rows] = REGION;
            (0..=rows).flat_map(move |j| (0..=columns).map(move |i| [x0 + step * i as f64, y0 + step * j as f64]))
        });
        let points: Vec<[f64; 2]> = points.collect();
        let moved = exact_at(&motion, &points);
        let Some(rigid) = RigidMotion::fit(points.into_iter().zip(moved)) else { return motion };
        let (sin, cos) = rigid.rotation_rad.sin_cos();
        self.motion_with(k, |x, u| {
            let by_rigid = rigid.displacement(x);
            let rest = [u[0] - by_rigid[0], u[1] - by_rigid[1]];
            [cos * rest[0] + sin * rest[1], -sin * rest[0] + cos * rest[1]]
        })
    }

    /// The motion of frame `k` with its displacements (px, y down) made `change(x, u)`.
    fn motion_with(&self, k: usize, change: impl Fn([f64; 2], [f64; 2]) -> [f64; 2]) -> Strips {
        let [columns, rows] = JOINT;
        let step = ELEMENT_PX / FINER as f64;
        let per_strip = (columns + 1) * (rows + 1);
        let strip = |first_node: usize, top: f64| {
            let displacement = |row: usize, column: usize| match k.checked_sub(1) {
                None => [0.0; 2],
                Some(instant) => {
                    // Rows of the mesh are counted from the bottom, those of the image from the top.
                    let node = first_node + (rows - row) * (columns + 1) + column;
                    SCALE.to_px(Vector::new(self.solution.instants[instant].displacement[node])).components()
                }
            };
            let nodes = (0..=rows).flat_map(|row| (0..=columns).map(move |column| (row, column)));
            let place = |row: usize, column: usize| [LEFT_PX + step * column as f64, top + step * row as f64];
            let displacement =
                nodes.map(|(row, column)| change(place(row, column), displacement(row, column))).collect();
            GridField::new([LEFT_PX, top], step, JOINT, displacement).expect("a grid with all its nodes")
        };
        let [upper_face, lower_face] = faces_px();
        Strips::new(strip(per_strip, upper_face - step * rows as f64), strip(0, lower_face))
    }

    /// The image of frame `k`; 0 is the reference.
    ///
    /// # Errors
    /// Those of [`render`].
    pub fn image(&self, k: usize) -> Result<Image, SynthError> {
        self.image_of(k, &self.motion(k))
    }

    /// The image of frame `k` as a camera sees it that follows the rigid motion of the measured region; rendered, not
    /// interpolated.
    ///
    /// # Errors
    /// Those of [`render`].
    pub fn image_without_rigid_motion(&self, k: usize) -> Result<Image, SynthError> {
        self.image_of(k, &self.motion_without_rigid(k))
    }

    fn image_of(&self, k: usize, motion: &Strips) -> Result<Image, SynthError> {
        let VirtualOptions { depth, noise_grey, seed, .. } = self.options;
        let options =
            RenderOptions { depth, noise: noise_grey, seed, frame: k as u64, ..RenderOptions::new(SIZE[0], SIZE[1]) };
        render(&self.texture, motion, &options)
    }

    /// The true displacement (px, y down) of `points` of the reference image in frame `k`.
    pub fn exact_at(&self, k: usize, points: &[[f64; 2]]) -> Vec<[f64; 2]> {
        exact_at(&self.motion(k), points)
    }

    /// The region that is measured, cut out of the computed joint (with its fine elements), and the node of the joint
    /// that each of its nodes is.
    pub fn region(&self) -> (JointMesh, Vec<u32>) {
        let mesh = self.model.mesh();
        let [upper, lower] = zones_px().map(|[x0, y0, x1, y1]| {
            let [low, high] = [[x0, y1], [x1, y0]].map(|corner| SCALE.to_mm(Vector::new(corner)));
            [low.x, low.y, high.x, high.y]
        });
        let inside = |element: usize| {
            let corners = mesh.elements()[element].map(|node| mesh.nodes()[node as usize]);
            let centre = [0, 1].map(|k| corners.iter().map(|at| at[k]).sum::<f64>() / 4.0);
            [upper, lower]
                .iter()
                .any(|[x0, y0, x1, y1]| *x0 < centre[0] && centre[0] < *x1 && *y0 < centre[1] && centre[1] < *y1)
        };
        mesh.part(inside).expect("the region is a joint")
    }

    /// The forces on the upper strip (x, y; N per mm of width) at every instant: what a load cell at the upper grip
    /// shows, and what holds the outer nodes of the region's upper strip, which is the traction of the joint that
    /// the images show.
    ///
    /// # Errors
    /// Those of [`Model::new`] for the region.
    pub fn loads(&self) -> Result<Vec<[[f64; 2]; 2]>, VirtualError> {
        let whole = self.model.mesh();
        let (region, of) = self.region();
        let outer = region.outer_nodes();
        let upper = |mesh: &JointMesh, nodes: &[u32]| {
            let nodes = nodes.iter().copied().filter(|&node| mesh.strip()[node as usize] == 1).collect();
            [NodeGroup::new("upper", nodes)]
        };
        let (grip, cut) = (upper(whole, self.model.prescribed()), upper(&region, &outer));
        let part = Model::new(region, self.model.materials().to_vec(), &outer, *self.model.options())?;
        let loads = |instant: &Instant| {
            let u = &instant.displacement;
            let of_region: Vec<[f64; 2]> = of.iter().map(|&node| u[node as usize]).collect();
            [self.model.reactions(self.law(), u, &grip)[0], part.reactions(self.law(), &of_region, &cut)[0]]
        };
        Ok(self.solution.instants.iter().map(loads).collect())
    }

    /// The largest rotation (rad) of a strip over the test: that of the rigid motion of either strip of the computed
    /// joint.
    pub fn largest_rotation(&self) -> f64 {
        let mesh = self.model.mesh();
        let rotation = |u: &Vec<[f64; 2]>, strip: u32| {
            let nodes = || (0..mesh.nodes().len()).filter(move |&node| mesh.strip()[node] == strip);
            let pairs = nodes().map(|node| (mesh.nodes()[node], u[node]));
            RigidMotion::fit(pairs).map_or(0.0, |motion| motion.rotation_rad.abs())
        };
        let fields = self.solution.instants.iter().map(|instant| &instant.displacement);
        fields.flat_map(|u| [rotation(u, 0), rotation(u, 1)]).fold(0.0, f64::max)
    }
}

/// Rows of the faces of the adhesive in the reference image: of the strip above, of the strip below, px.
pub fn faces_px() -> [f64; 2] {
    let middle = 0.5 * (SIZE[1] as f64 - 1.0);
    [middle - 0.5 * BAND_PX, middle + 0.5 * BAND_PX]
}

/// The rectangles x0, y0, x1, y1 (px) of the zones above and below the band.
pub fn zones_px() -> [[f64; 4]; 2] {
    let [upper, lower] = faces_px();
    let [width, height] = REGION.map(|n| n as f64 * ELEMENT_PX);
    let (x0, x1) = (REGION_LEFT_PX, REGION_LEFT_PX + width);
    [[x0, upper - height, x1, upper], [x0, lower, x1, lower + height]]
}

/// The computed joint. Its node numbers are those of [`JointMesh::rectangular`]; positions are px times the pixel size,
/// so that nodes of a measurement that lie at the same pixels are at the same place to the last bits.
fn joint_mesh() -> Result<JointMesh, MeshFault> {
    let [columns, rows] = JOINT;
    let step = ELEMENT_PX / FINER as f64;
    let plain = JointMesh::rectangular(columns, rows, step * PIXEL_MM, BAND_PX * PIXEL_MM)?;
    let [upper, lower] = faces_px();
    let strip = |bottom: f64| {
        (0..=rows).flat_map(move |j| {
            let y = bottom - step * j as f64;
            (0..=columns).map(move |i| SCALE.to_mm(Vector::new([LEFT_PX + step * i as f64, y])).components())
        })
    };
    JointMesh::new(JointParts {
        nodes: strip(lower + step * rows as f64).chain(strip(upper)).collect(),
        elements: plain.elements().to_vec(),
        interfaces: plain.interfaces().to_vec(),
        groups: plain.groups().to_vec(),
        element_group: plain.element_group().to_vec(),
        ..JointParts::default()
    })
}

/// What the grips do to the outermost rows of the joint.
fn remote_boundary(mesh: &JointMesh, n_instants: usize, mixity: Mixity) -> BoundaryHistory {
    let [columns, rows] = JOINT;
    let per_row = columns as u32 + 1;
    let top_row = per_row * (2 * rows as u32 + 1);
    let nodes: Vec<u32> = (0..per_row).chain(top_row..top_row + per_row).collect();
    let instants = (1..=n_instants)
        .map(|instant| {
            let share = instant as f64 / n_instants as f64;
            let begin = (instant as f64 - 1.0) / (n_instants as f64 - 1.0).max(1.0);
            let between = |[first, last]: [f64; 2]| first + begin * (last - first);
            let lambda = remote::LAMBDA_PX * PIXEL_MM;
            let (theta, front) = (between(remote::theta(mixity)), between(remote::FRONT_PX) * PIXEL_MM);
            let slide = between(remote::slide_mm(mixity));
            let [drift_x, drift_y] = remote::DRIFT_PX.map(|px| share * px * PIXEL_MM);
            let displacement = |&node: &u32| {
                let s = (mesh.nodes()[node as usize][0] - front) / lambda;
                let closed = remote::DIP * (-0.5 * (s + 2.0).powi(2)).exp();
                let opening = theta * lambda * (s.max(0.0) + (-s.abs()).exp().ln_1p() - closed);
                let side = if node >= top_row { 0.5 } else { -0.5 };
                [drift_x + side * slide, drift_y + side * opening]
            };
            nodes.iter().map(displacement).collect()
        })
        .collect();
    BoundaryHistory::new(nodes, instants).expect("finite displacements of nodes that differ")
}
