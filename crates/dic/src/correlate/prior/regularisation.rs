//! Regularisation with a cut-off length (THEORY 2): the penalty `w R` on the displacement.

use crate::correlate::{CorrelationError, Result};
use crate::field::RegularisationKind;
use crate::linalg::{
    BlockMatrix, ElementMatrix, NotPositiveDefinite, Pattern, Solver, Spread, Subspace, dissection, spread,
};
use crate::mesh::{ElementGeometry, GAUSS_POINTS, GAUSS_WEIGHT, Mesh, shape_functions};
use crate::units::Px;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// What holds the displacement beside the images, and up to which wavelength.
///
/// Much longer waves pass, much shorter ones are suppressed; nodes without texture follow their neighbours.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Regularisation {
    /// Nothing.
    #[default]
    None,
    /// Small gradients (Tikhonov & Arsenin 1977): a wave of length `lambda` is damped to
    /// `1 / (1 + (L / lambda)^2)`. Uniform strain is a gradient too: near a border it is measured too small.
    Tikhonov {
        /// Cut-off length `L`, px.
        cutoff_px: f64,
    },
    /// Equilibrium of an elastic plate in plane stress without forces in its plane (Claire, Hild & Roux 2004):
    /// a shear wave is damped to `1 / (1 + (L / lambda)^4)`, a longitudinal one as if L were longer by the factor
    /// `sqrt(2 / (1 - poisson))`. Affine displacements pass unchanged, up to the border.
    EquilibriumGap {
        /// Cut-off length `L` of shear waves, px.
        cutoff_px: f64,
        /// Poisson's ratio of the plate.
        poisson: f64,
    },
}

/// A cut-off of this many elements asks for a field that is all but affine; beyond, the images weigh so little
/// that round-off would decide.
const LONGEST_ELEMENTS: f64 = 1000.0;

impl Regularisation {
    /// Poisson's ratio where none is given: that of most metals.
    pub const POISSON: f64 = 0.33;

    /// Its kind.
    pub fn kind(self) -> RegularisationKind {
        match self {
            Self::None => RegularisationKind::None,
            Self::Tikhonov { .. } => RegularisationKind::Tikhonov,
            Self::EquilibriumGap { .. } => RegularisationKind::EquilibriumGap,
        }
    }

    /// The cut-off length, px; none without regularisation.
    pub fn cutoff_px(self) -> Option<f64> {
        match self {
            Self::None => None,
            Self::Tikhonov { cutoff_px } | Self::EquilibriumGap { cutoff_px, .. } => Some(cutoff_px),
        }
    }

    /// Share left of the amplitude of a wave (a shear wave for the equilibrium gap) in even texture far from borders.
    ///
    /// ```
    /// # use quadrille_dic as quadrille;
    /// use quadrille::correlate::Regularisation;
    /// let tikhonov = Regularisation::Tikhonov { cutoff_px: 64.0 };
    /// assert_eq!(tikhonov.gain(64.0), 0.5);
    /// assert_eq!(tikhonov.gain(128.0), 0.8);
    /// assert_eq!(Regularisation::None.gain(10.0), 1.0);
    /// ```
    pub fn gain(self, wavelength_px: f64) -> f64 {
        match self {
            Self::None => 1.0,
            Self::Tikhonov { cutoff_px } => 1.0 / (1.0 + (cutoff_px / wavelength_px).powi(2)),
            Self::EquilibriumGap { cutoff_px, .. } => 1.0 / (1.0 + (cutoff_px / wavelength_px).powi(4)),
        }
    }

    /// The penalty `w R` on the nodes of `mesh`, for a mean square `gradient` of the reference (one component; (grey
    /// levels per px)^2, per zone): what is minimised becomes `Phi^2 + a . w R a`. None without regularisation.
    ///
    /// # Panics
    /// When there are fewer values than zones.
    pub fn penalty(self, mesh: &Mesh<Px>, gradient: &[f64]) -> Option<BlockMatrix> {
        let pattern = Arc::new(Pattern::new(mesh.n_nodes(), mesh.elements()));
        self.penalty_on(mesh, &pattern, &vec![true; mesh.n_elements()], gradient)
    }

    /// The penalty on the active elements alone; `pattern` is that of the mesh.
    fn penalty_on(
        self,
        mesh: &Mesh<Px>,
        pattern: &Arc<Pattern>,
        active: &[bool],
        gradient: &[f64],
    ) -> Option<BlockMatrix> {
        // Both terms are equal at the cut-off length, where the wave number is 2 pi / L.
        let weight = |power: i32, cutoff_px: f64| -> Vec<f64> {
            gradient.iter().map(|g2| g2 * (cutoff_px / TAU).powi(power)).collect()
        };
        match self {
            Self::None => None,
            Self::Tikhonov { cutoff_px } => Some(laplacian(mesh, pattern, active, &weight(2, cutoff_px))),
            Self::EquilibriumGap { cutoff_px, poisson } => {
                let depth = cutoff_px / (4.0 * PI);
                Some(equilibrium_gap(mesh, pattern, active, &weight(4, cutoff_px), poisson, depth))
            }
        }
    }

    /// Whether its numbers make sense for elements of `element_size` px.
    pub(crate) fn check(self, element_size: usize) -> Result<()> {
        let fault = |name, value: f64, wanted| Err(CorrelationError::Option { name, value: value.to_string(), wanted });
        if let Some(cutoff_px) = self.cutoff_px() {
            if !(cutoff_px.is_finite() && cutoff_px > 0.0) {
                return fault("the cut-off length", cutoff_px, "a positive number of pixels");
            }
            if cutoff_px > LONGEST_ELEMENTS * element_size as f64 {
                return fault("the cut-off length", cutoff_px, "a number of pixels up to 1000 element sizes");
            }
        }
        match self {
            Self::EquilibriumGap { poisson, .. } if !(poisson > -1.0 && poisson <= 0.5) => {
                fault("Poisson's ratio", poisson, "a number above -1 and up to 0.5")
            }
            _ => Ok(()),
        }
    }

    /// The same on a level of the pyramid, in its pixels.
    pub(crate) fn at_level(mut self, level: usize) -> Self {
        if let Self::Tikhonov { cutoff_px } | Self::EquilibriumGap { cutoff_px, .. } = &mut self {
            *cutoff_px *= 0.5f64.powi(level.min(60) as i32);
        }
        self
    }
}

/// What holds the displacement of one level, ready for any matrix of its data.
pub(crate) enum Regulariser {
    Penalty(Penalty),
    /// The nodes are bound to splines.
    Splines(Arc<Subspace>),
}

/// The penalty of one level, ready to be added to any matrix of its data.
pub(crate) struct Penalty {
    matrix: Arc<BlockMatrix>,
    /// Elimination order of factors; empty where it has none, see [`Regulariser::new`].
    order: Vec<usize>,
    /// How far what happens at a node reaches, px.
    reach_px: f64,
}

/// Rows of elements over which splines carry what happens at a node: with every knot, two elements, it falls to about a
/// half.
const SPLINES_REACH: usize = 12;

/// In cut-off lengths: what happens at a node falls by `exp(-2 pi d / (sqrt(2) L))` over a distance d, and a variance
/// by the square of that, 0.1 % here.
const REACH: f64 = 0.75;

/// What the penalty is scaled to: the normal matrix of the level.
pub(crate) struct PenaltyScale<'a> {
    pub matrix: &'a BlockMatrix,
    /// Sum of psi^2 of each node.
    pub support: &'a [f64],
    /// Nodes that see texture.
    pub seen: &'a [bool],
}

impl Regulariser {
    /// The penalty on the elements of `mesh` that are `active`; none without regularisation.
    ///
    /// `w` follows from `g^2`, the mean square of a component of the gradient of the reference over the nodes of a
    /// zone that see texture: a wave of the cut-off length weighs as much in `w R` as in `M`. Only a penalty that acts
    /// over a few elements can be solved with `with_factor` not set, in steps.
    pub fn new(
        regularisation: Regularisation,
        mesh: &Mesh<Px>,
        pattern: &Arc<Pattern>,
        active: &[bool],
        texture: &PenaltyScale<'_>,
        with_factor: bool,
    ) -> Option<Self> {
        let reach_px = REACH * regularisation.cutoff_px()?;
        let gradient = mean_square_gradient(mesh, texture);
        let matrix = Arc::new(regularisation.penalty_on(mesh, pattern, active, &gradient)?);
        let nodes = if with_factor { 0..mesh.n_nodes() } else { 0..0 };
        let order = dissection(matrix.pattern(), mesh.nodes(), nodes);
        Some(Self::Penalty(Penalty { matrix, order, reach_px }))
    }

    /// The solver of the data's matrix with it. Nodes that are not kept must be out of both.
    pub fn solver(&self, data: BlockMatrix) -> Result<Solver, NotPositiveDefinite> {
        match self {
            Self::Splines(subspace) => Solver::within(data, subspace.clone()),
            Self::Penalty(Penalty { matrix, order, .. }) if order.is_empty() => {
                Ok(Solver::smoothed(data, matrix.clone()))
            }
            Self::Penalty(Penalty { matrix, order, .. }) => Solver::regularised(data, matrix.clone(), order),
        }
    }

    /// Rows of elements of `element_size` px over which it carries what happens at a node.
    pub fn reach_rows(&self, element_size: f64) -> usize {
        match self {
            Self::Splines(_) => SPLINES_REACH,
            Self::Penalty(Penalty { reach_px, .. }) => (reach_px / element_size).ceil() as usize,
        }
    }

    /// Variances and degrees of freedom at the nodes `redone` as if all but the `free` ones were held; both ascending.
    pub fn spread_of_part(
        &self,
        data: &BlockMatrix,
        free: &[u32],
        redone: &[u32],
    ) -> Result<Spread, NotPositiveDefinite> {
        let Penalty { matrix, order, .. } = match self {
            Self::Splines(subspace) => return subspace.spread_of_part(data, free, redone),
            Self::Penalty(penalty) => penalty,
        };
        let place = |node: &usize| free.binary_search(&(*node as u32)).ok();
        let order: Vec<usize> = order.iter().filter_map(place).collect();
        let Spread { variance, freedom } = spread(&data.part(free), &matrix.part(free), &order)?;
        let at: Vec<usize> = redone.iter().filter_map(|&node| place(&(node as usize))).collect();
        let (variance, freedom) = at.into_iter().map(|at| (variance[at], freedom[at])).unzip();
        Ok(Spread { variance, freedom })
    }

    /// Variances and degrees of freedom of the solution by a solver of its own; `None` of one that it could not hold.
    pub fn spread(&self, solver: &Solver) -> Option<Spread> {
        match self {
            Self::Splines(_) => solver.spread_within(),
            Self::Penalty(Penalty { matrix, order, .. }) => {
                solver.penalty().and_then(|_| spread(solver.data(), matrix, order).ok())
            }
        }
    }
}

/// `g^2` of each zone: `sum M_ii / (2 sum psi^2)` over the nodes that see texture, or over all if none does.
fn mean_square_gradient(mesh: &Mesh<Px>, texture: &PenaltyScale<'_>) -> Vec<f64> {
    let of_zone = |zone: usize| {
        let any = mesh.zone_nodes(zone).any(|node| texture.seen[node]);
        let (mut trace, mut support) = (0.0, 0.0);
        for node in mesh.zone_nodes(zone).filter(|&node| texture.seen[node] || !any) {
            let [xx, _, yy] = texture.matrix.diagonal(node);
            trace += xx + yy;
            support += 2.0 * texture.support[node];
        }
        if support > 0.0 { trace / support } else { 0.0 }
    };
    (0..mesh.zones().len()).map(of_zone).collect()
}

struct GaussPoint {
    /// Area that it stands for.
    area: f64,
    shape: [f64; 4],
    /// Derivatives of the shape functions by x and y.
    gradient: [[f64; 2]; 4],
}

/// The points of the 2 x 2 Gauss rule, exact here on parallelograms. An element without area holds nothing.
fn gauss_points(element: &ElementGeometry) -> impl Iterator<Item = GaussPoint> {
    GAUSS_POINTS.into_iter().filter_map(move |at| {
        let map = element.map_at(at);
        (map.determinant != 0.0).then(|| GaussPoint {
            area: GAUSS_WEIGHT * map.determinant.abs(),
            shape: shape_functions(at[0], at[1]),
            gradient: map.gradients(),
        })
    })
}

/// An element matrix from its block of every pair of corners, at each Gauss point.
fn element_matrix(shape: &ElementGeometry, block: impl Fn(&GaussPoint, usize, usize) -> [f64; 4]) -> ElementMatrix {
    let mut matrix = [0.0; 36];
    for point in gauss_points(shape) {
        for (value, (i, j)) in matrix.iter_mut().zip(upper_pairs()) {
            *value += point.area * block(&point, i / 2, j / 2)[2 * (i % 2) + j % 2];
        }
    }
    matrix
}

/// Row and column of each number of an [`ElementMatrix`].
pub(crate) fn upper_pairs() -> impl Iterator<Item = (usize, usize)> {
    (0..8).flat_map(|i| (i..8).map(move |j| (i, j)))
}

fn assemble(
    mesh: &Mesh<Px>,
    pattern: &Arc<Pattern>,
    active: &[bool],
    element: impl Fn(usize, &ElementGeometry) -> ElementMatrix,
) -> BlockMatrix {
    let elements = mesh.elements();
    let matrices: Vec<ElementMatrix> =
        (0..elements.len()).map(|at| if active[at] { element(at, &mesh.geometry(at)) } else { [0.0; 36] }).collect();
    BlockMatrix::assemble(pattern, elements, &matrices)
}

/// `w` times the integral of `grad psi_i . grad psi_j`, for both components alike; `weight` per zone.
fn laplacian(mesh: &Mesh<Px>, pattern: &Arc<Pattern>, active: &[bool], weight: &[f64]) -> BlockMatrix {
    assemble(mesh, pattern, active, |at, shape| {
        let weight = weight[mesh.element_zone()[at] as usize];
        element_matrix(shape, |point, i, j| {
            let ([ax, ay], [bx, by]) = (point.gradient[i], point.gradient[j]);
            let product = weight * (ax * bx + ay * by);
            [product, 0.0, 0.0, product]
        })
    })
}

/// `w K^T D^-1 K` over the inner nodes, and at border nodes a penalty on the bending of the border.
///
/// `K` is the stiffness in plane stress, shear modulus 1, `D` the area of each node: `D^-1 K` is the divergence of
/// stress.
///
/// At a border node the balance of forces holds unknown tractions. Instead its displacement is to agree with the plane
/// through its two neighbours along the border and, where these are not in line with it, one more node ([`flatness`]):
/// along a straight border the second difference, at a corner the twist. So no field but the affine ones is left free.
/// `depth` times the length of border at the node is the area that this stands for: an equilibrated wave of the cut-off
/// length along a border reaches `L / (4 pi)` deep (its square, integrated), and is cut at the same length.
fn equilibrium_gap(
    mesh: &Mesh<Px>,
    pattern: &Arc<Pattern>,
    active: &[bool],
    weight: &[f64],
    poisson: f64,
    depth: f64,
) -> BlockMatrix {
    // Plane stress over the shear modulus: sigma_xx = c eps_xx + poisson c eps_yy, sigma_xy = 2 eps_xy.
    let normal = 2.0 / (1.0 - poisson);
    let cross = poisson * normal;
    let stiffness = assemble(mesh, pattern, active, |_, shape| {
        element_matrix(shape, |point, i, j| {
            let ([ax, ay], [bx, by]) = (point.gradient[i], point.gradient[j]);
            [
                normal * ax * bx + ay * by,
                cross * ax * by + ay * bx,
                cross * ay * bx + ax * by,
                normal * ay * by + ax * bx,
            ]
        })
    });
    let mut area = vec![0.0; mesh.n_nodes()];
    for at in (0..mesh.n_elements()).filter(|&at| active[at]) {
        for point in gauss_points(&mesh.geometry(at)) {
            for (&node, psi) in mesh.elements()[at].iter().zip(point.shape) {
                area[node as usize] += point.area * psi;
            }
        }
    }
    let along_border = border_neighbours(mesh, active);
    let wide = Arc::new(pattern.widened());
    let mut penalty = BlockMatrix::zero(&wide);
    for node in (0..mesh.n_nodes()).filter(|&node| area[node] > 0.0) {
        let weight = weight[mesh.node_zone()[node] as usize];
        let Some(sides) = most_opposite(mesh, node, &along_border[node]) else {
            let row = pattern.row(node);
            penalty.add_square(pattern.neighbours(node), &stiffness.blocks()[row], weight / area[node]);
            continue;
        };
        // A corner of one triangle has no other node around it: one of those further away serves.
        let around = |other: u32| pattern.neighbours(node).contains(&other) && area[other as usize] > 0.0;
        let beyond = |other: u32| {
            let near_both = sides.iter().all(|&side| wide.neighbours(side as usize).contains(&other));
            near_both && area[other as usize] > 0.0
        };
        let found = flatness(mesh, node as u32, sides, wide.neighbours(node), around);
        if let Some(Flatness { nodes, coefficients, length }) =
            found.or_else(|| flatness(mesh, node as u32, sides, wide.neighbours(node), beyond))
        {
            let blocks = coefficients.map(|c| [c, 0.0, 0.0, c]);
            let n = if coefficients[3] == 0.0 { 3 } else { 4 };
            penalty.add_square(&nodes[..n], &blocks[..n], weight * depth * length);
        }
    }
    penalty
}

/// Of the neighbours of a node along the border the two that lie the most opposite to each other; there are more than
/// two where only a node joins two parts of a zone. None for an inner node.
fn most_opposite(mesh: &Mesh<Px>, node: usize, neighbours: &[u32]) -> Option<[u32; 2]> {
    let towards = |other: u32| {
        let (a, b) = (mesh.nodes()[other as usize], mesh.nodes()[node]);
        let d = [a[0] - b[0], a[1] - b[1]];
        d.map(|v| v / d[0].hypot(d[1]))
    };
    let pairs = neighbours.iter().enumerate().flat_map(|(at, &a)| neighbours[..at].iter().map(move |&b| [b, a]));
    let cosine = |[a, b]: [u32; 2]| {
        let (a, b) = (towards(a), towards(b));
        a[0] * b[0] + a[1] * b[1]
    };
    pairs.min_by(|&a, &b| cosine(a).total_cmp(&cosine(b)))
}

/// The neighbours of each node along the border of the active elements: none inside, two or more on a border.
fn border_neighbours(mesh: &Mesh<Px>, active: &[bool]) -> Vec<Vec<u32>> {
    let elements = mesh.elements().iter().zip(active).filter(|(_, active)| **active);
    let sides = elements.flat_map(|(nodes, _)| (0..4).map(|k| [nodes[k], nodes[(k + 1) % 4]]));
    let mut edges: Vec<[u32; 2]> = sides.filter(|[a, b]| a != b).map(|[a, b]| [a.min(b), a.max(b)]).collect();
    edges.sort_unstable();
    let mut neighbours = vec![Vec::new(); mesh.n_nodes()];
    for same in edges.chunk_by(|a, b| a == b) {
        if let &[[a, b]] = same {
            neighbours[a as usize].push(b);
            neighbours[b as usize].push(a);
        }
    }
    neighbours
}

/// A second derivative of the displacement at a border node: `sum c_k u_k`, zero for every affine field.
struct Flatness {
    /// The node, its two neighbours along the border, and one more.
    nodes: [u32; 4],
    /// 1 / px^2; the last is zero on a straight border.
    coefficients: [f64; 4],
    /// Length of the border that belongs to the node, px.
    length: f64,
}

/// Sines of angles up to this count as none.
const STRAIGHT: f64 = 1e-6;

/// Compares a border node with the plane through `sides`, its neighbours along the border, and where these are not
/// in line with it that one of `others` that `may` serve and puts it nearest to their middle. On a straight border with
/// distances p and q this is `u'' = 2 (q u_before + p u_after - (p + q) u) / (p q (p + q))`.
fn flatness(
    mesh: &Mesh<Px>,
    node: u32,
    sides: [u32; 2],
    others: &[u32],
    may: impl Fn(u32) -> bool,
) -> Option<Flatness> {
    let place = |other: u32| {
        let (a, b) = (mesh.nodes()[other as usize], mesh.nodes()[node as usize]);
        [a[0] - b[0], a[1] - b[1]]
    };
    let cross = |a: [f64; 2], b: [f64; 2]| a[0] * b[1] - a[1] * b[0];
    let [before, after] = sides.map(place);
    let [p, q] = [before, after].map(|d| d[0].hypot(d[1]));
    if !(p > 0.0 && q > 0.0) {
        return None;
    }
    let scale = -2.0 / (p * q);
    let length = 0.5 * (p + q);
    if cross(before, after).abs() <= STRAIGHT * p * q {
        // Folded back on itself, as at the tip of a slit without width, it has no second derivative.
        let straight = before[0] * after[0] + before[1] * after[1] < 0.0;
        let coefficients = [1.0, -q / (p + q), -p / (p + q), 0.0].map(|c| scale * c);
        return straight.then_some(Flatness { nodes: [node, sides[0], sides[1], node], coefficients, length });
    }
    // The node's barycentric coordinates in the triangle of its sides and each candidate.
    let mut best: Option<(f64, u32, [f64; 3])> = None;
    for &third in others.iter().filter(|&&k| k != node && !sides.contains(&k) && may(k)) {
        let other = place(third);
        let parts = [cross(after, other), cross(other, before), cross(before, after)];
        let sum: f64 = parts.iter().sum();
        if sum.abs() <= STRAIGHT * p * q {
            continue;
        }
        let shares = parts.map(|part| part / sum);
        let least = shares.into_iter().fold(f64::INFINITY, f64::min);
        if best.is_none_or(|(most, ..)| least > most + 1e-9) {
            best = Some((least, third, shares));
        }
    }
    let (_, third, [a, b, c]) = best?;
    Some(Flatness {
        nodes: [node, sides[0], sides[1], third],
        coefficients: [1.0, -a, -b, -c].map(|c| scale * c),
        length,
    })
}
