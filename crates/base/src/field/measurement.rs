//! A measured displacement field.

use super::mark::{ElementMark, Marked};
use crate::mesh::{Mesh, corners_of};
use crate::units::{Length, Mm, PixelSize, Px, Vector};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::sync::Arc;

/// How the correlation of one frame ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// The last correction is below the tolerance: the field can be used.
    Converged,
    /// The corrections were still above the tolerance after the largest number of iterations.
    IterationLimit,
    /// The corrections grew, or the deformed image does not match the reference under the field found.
    Diverged,
    /// Too much of a zone has moved out of the deformed image.
    LeftImage,
    /// The image could not be read, or is not an image of this series.
    Unreadable,
    /// The texture repeats, and the displacement may be off by multiples of its period: nothing says which one it is.
    Ambiguous,
    /// What was measured can be used, but a whole zone, or more than a third of the nodes, was not.
    PartlyLost,
}

impl Status {
    /// All of them, by their code.
    pub const ALL: [Self; 7] = [
        Self::Converged,
        Self::IterationLimit,
        Self::Diverged,
        Self::LeftImage,
        Self::Unreadable,
        Self::Ambiguous,
        Self::PartlyLost,
    ];

    /// Number in files: 0 converged, 1 iteration limit, 2 diverged, 3 left the image, 4 unreadable, 5 ambiguous, 6
    /// partly lost.
    pub fn code(self) -> u8 {
        self as u8
    }

    /// The status with this [`code`](Self::code).
    ///
    /// ```
    /// # use quadrille_base as quadrille;
    /// use quadrille::field::Status;
    /// assert_eq!(Status::from_code(Status::LeftImage.code()), Some(Status::LeftImage));
    /// assert_eq!(Status::from_code(255), None);
    /// ```
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|status| status.code() == code)
    }

    /// Whether a frame that ended so has a field that may be shown: a diverged one is no measurement.
    pub fn has_field(self) -> bool {
        !matches!(self, Status::Diverged | Status::Unreadable)
    }

    /// Whether what is measured can be used: all of the field, or a part.
    pub fn is_measured(self) -> bool {
        matches!(self, Status::Converged | Status::PartlyLost)
    }

    /// Name used in files.
    pub fn name(self) -> &'static str {
        match self {
            Status::Converged => "converged",
            Status::IterationLimit => "iteration_limit",
            Status::Diverged => "diverged",
            Status::LeftImage => "left_image",
            Status::Unreadable => "unreadable",
            Status::Ambiguous => "ambiguous",
            Status::PartlyLost => "partly_lost",
        }
    }
}

/// What a field may be off beyond noise, as it and its residual show (THEORY 11): sizes without signs, in `U`.
///
/// Where the truth is smooth and well resolved the nodal error comes out right within a small factor. Of noise it holds
/// next to nothing: that is what the standard uncertainty says.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ModelError {
    /// Error of each displacement for want of nodes, of focus, or by a regularisation; zero where nothing shows.
    pub nodes: Vec<[f64; 2]>,
    /// Displacement, root mean square over the element, that the field does not follow there; zero where none shows
    /// (THEORY 19).
    pub misfit: Vec<f64>,
}

/// Displacements at the nodes as values at points, beside the coefficients [`Measurement::displacement`] (THEORY 17).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PointField {
    /// Displacement at each node, in `U`; zero where the node was not measured.
    pub displacement: Vec<[f64; 2]>,
    /// Its standard uncertainty.
    pub sigma: Vec<[f64; 2]>,
    /// Whether it is a value, not the bare coefficient: too few measured nodes are near, or the field was regularised.
    pub is_value: Vec<bool>,
}

/// The elements of a frame that cannot follow the displacement.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Misfit {
    /// How many.
    pub elements: usize,
    /// Of how many, per cent.
    pub percent: f64,
    /// Middle of the one whose displacement is followed worst, in the unit of the mesh (of the reference image).
    #[serde(rename = "at_px")]
    pub at: [f64; 2],
    /// Displacement that is not followed there, root mean square, in the same unit.
    #[serde(rename = "displacement_px")]
    pub displacement: f64,
}

impl fmt::Display for Misfit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { elements, percent, at: [x, y], displacement } = self;
        let plural = if *elements == 1 { "" } else { "s" };
        write!(
            f,
            "{elements} element{plural} ({percent:.1} %) cannot follow the displacement, by {displacement:.2} px at \
             ({x:.0}, {y:.0}) px"
        )
    }
}

/// Standard uncertainty, in medians over the field, above which a node is to be doubted.
pub const DOUBTFUL: f64 = 5.0;

/// The displacement field of one deformed image, on the nodes of a mesh of the reference image.
///
/// A node that was not measured (without texture, or outside the deformed image) has
/// `measured == false`; its other numbers are zero and mean nothing.
#[derive(Debug, Clone)]
pub struct Measurement<U: Length> {
    /// The mesh, in `U`.
    pub mesh: Arc<Mesh<U>>,
    /// How the correlation ended.
    pub status: Status,
    /// Displacement of each node, in `U`: the coefficients of the bilinear field that was fitted to the images, whose
    /// covariance is known; what it is at a point says [`Measurement::points`].
    pub displacement: Vec<[f64; 2]>,
    /// Standard uncertainty of each displacement, in `U`.
    pub sigma: Vec<[f64; 2]>,
    /// Whether the node was measured.
    pub measured: Vec<bool>,
    /// Root mean square of the residual `f - g` in each element, in grey levels; empty for the field of another program,
    /// which has none.
    pub element_residual: Vec<f64>,
    /// What the field may be off beyond noise, in `U`; `None` where nothing estimated it, as in earlier stores.
    pub model_error: Option<ModelError>,
    /// What is the matter with each element; `None` where nobody looked, as in stores of earlier versions.
    pub marks: Option<Vec<ElementMark>>,
    /// The displacements at the nodes as values at points (THEORY 17); `None` where nobody made them: earlier stores.
    pub points: Option<PointField>,
}

impl Measurement<Px> {
    /// The same field on the specimen, in mm with y up, on `mesh`: this field's own mesh after [`Mesh::to_mm`].
    ///
    /// # Panics
    /// When `mesh` has another number of nodes.
    pub fn to_mm(&self, mesh: &Arc<Mesh<Mm>>, scale: PixelSize) -> Measurement<Mm> {
        assert_eq!(mesh.n_nodes(), self.displacement.len(), "the mesh of the field");
        let size = |px: &f64| scale.mm_from_px(*px);
        let vector = |u: &[f64; 2]| scale.to_mm(Vector::new(*u)).components();
        let sizes = |list: &[[f64; 2]]| list.iter().map(|v| v.each_ref().map(size)).collect();
        Measurement {
            mesh: Arc::clone(mesh),
            status: self.status,
            displacement: self.displacement.iter().map(vector).collect(),
            sigma: sizes(&self.sigma),
            measured: self.measured.clone(),
            element_residual: self.element_residual.clone(),
            model_error: self.model_error.as_ref().map(|error| ModelError {
                nodes: sizes(&error.nodes),
                misfit: error.misfit.iter().map(size).collect(),
            }),
            marks: self.marks.clone(),
            points: self.points.as_ref().map(|points| PointField {
                displacement: points.displacement.iter().map(vector).collect(),
                sigma: sizes(&points.sigma),
                is_value: points.is_value.clone(),
            }),
        }
    }
}

impl<U: Length> Measurement<U> {
    /// The displacement gradient that these weights of nodes make: `[[du_x/dx, du_x/dy], [du_y/dx, du_y/dy]]`.
    pub(super) fn gradient(&self, weights: impl IntoIterator<Item = (usize, [f64; 2])>) -> [[f64; 2]; 2] {
        let mut gradient = [[0.0; 2]; 2];
        for (node, w) in weights {
            let u = self.displacement[node];
            (0..2).for_each(|c| (0..2).for_each(|k| gradient[c][k] += w[k] * u[c]));
        }
        gradient
    }

    /// Displacement of each node as read at a point: [`Measurement::points`] where known, else the coefficients.
    pub fn at_points(&self) -> &[[f64; 2]] {
        self.points.as_ref().map_or(&self.displacement, |points| &points.displacement)
    }

    /// Standard uncertainty of [`at_points`](Self::at_points).
    pub fn sigma_at_points(&self) -> &[[f64; 2]] {
        self.points.as_ref().map_or(&self.sigma, |points| &points.sigma)
    }

    /// The mark of each node: the gravest of its elements, or [`ElementMark::None`]; `None` where nobody looked.
    pub fn node_marks(&self) -> Option<Vec<ElementMark>> {
        let marks = self.marks.as_ref()?;
        let mut nodes = vec![ElementMark::None; self.mesh.n_nodes()];
        for (of_element, &mark) in self.mesh.elements().iter().zip(marks) {
            of_element.iter().for_each(|&node| nodes[node as usize] = nodes[node as usize].max(mark));
        }
        Some(nodes)
    }

    /// How many elements have each mark; empty where none has one, or nobody looked.
    pub fn marked(&self) -> Vec<Marked> {
        let marks = self.marks.as_deref().unwrap_or_default();
        let count = |mark: ElementMark| marks.iter().filter(|&&found| found == mark).count();
        let marked = |mark| {
            let elements = count(mark);
            Marked { mark, elements, percent: 100.0 * elements as f64 / marks.len().max(1) as f64 }
        };
        ElementMark::ALL.into_iter().map(marked).filter(|marked| marked.elements > 0).collect()
    }

    /// Which measured nodes are to be doubted: those whose standard uncertainty (root mean square of its components) is
    /// above [`DOUBTFUL`] times the median. They are hatched in maps and left out of printed extremes.
    pub fn doubtful(&self) -> Vec<bool> {
        let rms = |s: &[f64; 2]| (0.5 * (s[0] * s[0] + s[1] * s[1])).sqrt();
        let mut known: Vec<f64> =
            self.sigma.iter().zip(&self.measured).filter(|(_, measured)| **measured).map(|(s, _)| rms(s)).collect();
        let middle = known.len() / 2;
        let median = match known.get(middle) {
            Some(_) => *known.select_nth_unstable_by(middle, f64::total_cmp).1,
            None => return vec![false; self.measured.len()],
        };
        let is_doubtful = |(s, &measured): (&[f64; 2], &bool)| measured && rms(s) > DOUBTFUL * median;
        self.sigma.iter().zip(&self.measured).map(is_doubtful).collect()
    }

    /// Which elements are hatched in maps: with a node to be [doubted](Self::doubtful) or a mark of doubt of their own.
    pub fn hatched(&self) -> Vec<bool> {
        let nodes = self.doubtful();
        let by_node = self.mesh.elements().iter().map(|of| of.iter().any(|&node| nodes[node as usize]));
        let marks = self.marks.as_deref().unwrap_or_default();
        let is_marked = |element: usize| marks.get(element).is_some_and(|mark| *mark != ElementMark::None);
        by_node.enumerate().map(|(element, by_node)| by_node || is_marked(element)).collect()
    }

    /// The elements that do not follow a displacement; none where no element is named, or nobody looked.
    pub fn misfit(&self) -> Option<Misfit> {
        let not_followed = &self.model_error.as_ref()?.misfit;
        let is_marked = |element: usize| self.marks.as_ref().is_none_or(|marks| marks[element] == ElementMark::Misfit);
        let named = (0..not_followed.len()).filter(|&element| not_followed[element] > 0.0 && is_marked(element));
        let elements = named.clone().count();
        let worst = named.max_by(|&a, &b| not_followed[a].total_cmp(&not_followed[b]))?;
        let sides = corners_of(self.mesh.elements().get(worst)?).len();
        let corners = self.mesh.corners(worst);
        let middle = [0, 1].map(|c| corners[..sides].iter().map(|p| p[c]).sum::<f64>() / sides as f64);
        // An element that has left the image, or has no texture, has no residual.
        let n_tested = self.element_residual.iter().filter(|&&residual| residual > 0.0).count();
        let percent = 100.0 * elements as f64 / n_tested.max(1) as f64;
        Some(Misfit { elements, percent, at: middle, displacement: not_followed[worst] })
    }
}
