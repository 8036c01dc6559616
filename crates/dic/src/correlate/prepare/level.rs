//! One scale of the pyramid: its mesh, its prepared reference, its solver.

use crate::backend::{Backend, BackendError, ElementMoments, KernelOptions, Place, couple};
use crate::correlate::{
    AssumedNoise, OfElement, PenaltyScale, Regularisation, Regulariser, diagonal_with_noise, find_faults, without_noise,
};
use crate::linalg::{Pattern, Solver};
use crate::mesh::{Mesh, PixelMesh, shape_functions};
use crate::units::Px;
use std::sync::Arc;

/// A scale of the pyramid; level 0 is the image, each further level halves it.
pub(crate) struct Level<B: Backend> {
    pub mesh: Arc<Mesh<Px>>,
    pub prepared: B::Level,
    pub moments: Arc<Vec<ElementMoments>>,
    pub pattern: Arc<Pattern>,
    pub solver: B::Solver,
    /// Nodes that are solved for; the others see no texture.
    pub keep: Vec<bool>,
    /// What holds the displacement beside the images, if anything does.
    pub regulariser: Option<Regulariser>,
    /// What noise adds to the mean square of each component of the gradient, as far as taken off (THEORY 10).
    pub lambda: f64,
}

/// Position on the finer level of a point of the coarser one, and back: a coarse pixel is the mean of two fine ones.
fn finer(x: f64) -> f64 {
    2.0 * x + 0.5
}

pub(crate) fn coarser(x: f64) -> f64 {
    0.5 * (x - 0.5)
}

/// `sum psi^2` per node over its pixels (about 4/9 l^2 inside): the diagonal for gradients of one grey level per px.
pub(crate) fn support(pattern: &Pattern, moments: &[ElementMoments]) -> Vec<f64> {
    (0..pattern.n_nodes()).map(|node| support_of(pattern, moments, node)).collect()
}

pub(crate) fn support_of(pattern: &Pattern, moments: &[ElementMoments], node: usize) -> f64 {
    // The mean of psi^2 over an element is a ninth.
    pattern.elements_of(node).iter().fold(0.0, |sum, &(element, _)| sum + moments[element as usize].n / 9.0)
}

impl<B: Backend> Level<B> {
    /// A coarse level: nodes without texture are held by the regularisation, or stay where they start; none is refused.
    pub fn coarse(
        backend: &B,
        frame: &mut B::Frame,
        level: usize,
        mesh: &PixelMesh,
        noise: &AssumedNoise,
        options: &KernelOptions,
        regularisation: Regularisation,
    ) -> Result<Self, BackendError> {
        let (prepared, moments) = backend.reference(frame, level, mesh, options, None)?;
        let mesh = mesh.mesh.clone();
        let pattern = Arc::new(Pattern::new(mesh.n_nodes(), mesh.elements()));
        // Averaging 2^l by 2^l pixels divides the noise by 2^l.
        let noise = noise.at_level(level);
        let mut keep = vec![true; mesh.n_nodes()];
        let support = support(&pattern, &moments);
        let lambda = noise.lambda(options);
        let of_elements = OfElement::all(&mesh, &moments, options, lambda);
        let blocks: Vec<_> =
            (0..mesh.n_nodes()).map(|node| diagonal_with_noise(&mesh, &pattern, &of_elements, node)).collect();
        let faults = find_faults(&mesh, &blocks, &support, &noise, options.gradient_noise_gain, f64::INFINITY);
        faults.iter().for_each(|fault| keep[fault.node] = false);
        let moments = Arc::new(moments);
        let mut matrix = without_noise(&mesh, &pattern, &of_elements);
        let active = vec![true; mesh.n_elements()];
        let texture = PenaltyScale { matrix: &matrix, support: &support, seen: &keep };
        let regulariser = Regulariser::new(regularisation.at_level(level), &mesh, &pattern, &active, &texture, true);
        let regularised =
            regulariser.and_then(|regulariser| Some((regulariser.solver(matrix.clone()).ok()?, regulariser)));
        let (solver, regulariser) = match regularised {
            Some((solver, regulariser)) => {
                keep.fill(true);
                (solver, Some(regulariser))
            }
            None => {
                matrix.hold(&keep);
                (Solver::iterative(matrix), None)
            }
        };
        let solver = backend.solver(&prepared, couple(solver, &pattern, &moments, options.brightness))?;
        Ok(Self { mesh, prepared, moments, pattern, solver, keep, regulariser, lambda })
    }

    /// Tells the device where the nodes lie in the next coarser level.
    pub fn link(&mut self, backend: &B, coarse: &Mesh<Px>) -> Result<(), BackendError> {
        let places = places(&self.mesh, coarse, coarser).collect();
        backend.link(&mut self.prepared, places)
    }

    /// The displacement on this level's nodes from that on the next finer level's.
    pub fn carry_from_finer(&self, fine: &Mesh<Px>, displacement: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let value = |place: Place| {
            std::array::from_fn(|c| {
                let of_node = |node: &u32| displacement[*node as usize][c];
                0.5 * place.nodes.iter().zip(place.weights).map(|(node, weight)| weight * of_node(node)).sum::<f64>()
            })
        };
        places(&self.mesh, fine, finer).map(value).collect()
    }
}

/// Where the nodes of `mesh` lie in the mesh `other` of a neighbouring level.
fn places<'a>(
    mesh: &'a Mesh<Px>,
    other: &'a Mesh<Px>,
    at: impl Fn(f64) -> f64 + 'a,
) -> impl Iterator<Item = Place> + 'a {
    mesh.sides().into_iter().zip(mesh.node_zone()).map(move |(node, &zone)| {
        let [x, y] = node.map(&at);
        let (element, xi, eta) = other.nearest(zone as usize, x, y);
        Place { nodes: other.elements()[element], weights: shape_functions(xi, eta) }
    })
}
