//! The matrix of a frame of which elements have lost pixels: that of the level, made anew at their nodes.

use crate::backend::{Backend, BackendError, ElementMoments, KernelOptions};
use crate::correlate::{Level, OfElement, Regulariser};
use crate::linalg::{Pattern, Solver};
use crate::mesh::Mesh;
use crate::parts;
use crate::units::Px;

/// Share of its texture by which an element that is left out takes part in a matrix with a penalty of its own.
const HELD_SHARE: f64 = 1e-3;

/// A frame's own solver, of the pixels inside the deformed image, and in what it differs from that of the level.
pub(crate) struct Own<B: Backend> {
    pub solver: B::Solver,
    pub changed: Changed,
}

impl<B: Backend> Own<B> {
    /// At the last evaluation of `field`; with `regulariser` in place of what the level has.
    pub fn new(
        backend: &B,
        level: &Level<B>,
        frame: &mut B::Frame,
        field: &B::Field,
        options: &KernelOptions,
        regulariser: Option<&Regulariser>,
    ) -> Result<Self, BackendError> {
        let mut lost = backend.remaining_moments(&level.prepared, frame, field)?;
        // What a penalty alone holds may move as a whole: a little of the texture that was there holds it.
        for (element, partial) in lost.iter_mut().filter(|(_, partial)| partial.n == 0.0 && regulariser.is_some()) {
            *partial = level.moments[*element].scaled(HELD_SHARE);
        }
        let changed = Changed::new((&level.mesh, &level.pattern), &level.moments, &lost, level.lambda, options);
        let (nodes, elements) = (&changed.nodes, level.mesh.elements());
        // What the regularisation held with all pixels it may fail to hold with fewer: iterate then.
        let solver = match regulariser.or(level.regulariser.as_ref()) {
            Some(regulariser) => {
                let mut data = level.solver.data().clone();
                data.assemble_rows(nodes, elements, |element| &changed.of(element).matrix);
                let solver = regulariser.solver(data.clone()).unwrap_or_else(|_| Solver::iterative(data));
                solver.with_responses_of(&level.solver)
            }
            None => level.solver.change_rows(nodes, elements, |element| &changed.of(element).matrix),
        };
        Ok(Self { solver: backend.solver_like(&level.prepared, solver, &level.solver)?, changed })
    }

    /// Gives its memory to the next one of the level.
    pub fn give_back(self, backend: &B, level: &Level<B>) {
        if let Some(solver) = backend.reclaim(self.solver) {
            level.solver.take_back(solver);
        }
    }
}

/// In what the normal matrix of a frame differs from that of the level, and what it is made of there.
pub(crate) struct Changed {
    /// The nodes of elements that have lost pixels, ascending.
    pub nodes: Vec<u32>,
    /// All elements of these nodes, ascending: those that have lost pixels with what is left of them.
    pub elements: Vec<u32>,
    of_elements: Vec<OfElement>,
}

impl Changed {
    /// Where the elements `lost`, ascending, have these `moments` left; noise adds `lambda` to the gradient's square.
    pub fn new(
        (mesh, pattern): (&Mesh<Px>, &Pattern),
        moments: &[ElementMoments],
        lost: &[(usize, ElementMoments)],
        lambda: f64,
        options: &KernelOptions,
    ) -> Self {
        let mut nodes: Vec<u32> = lost.iter().flat_map(|(element, _)| mesh.elements()[*element]).collect();
        nodes.sort_unstable();
        nodes.dedup();
        let elements = pattern.elements_around(&nodes);
        let of_element = |at: usize| {
            let element = elements[at] as usize;
            let left = lost.binary_search_by_key(&element, |(element, _)| *element).map(|at| &lost[at].1);
            OfElement::new(mesh, element, left.unwrap_or(&moments[element]), options, lambda)
        };
        let of_elements = parts::map(elements.len(), 64, OfElement::NONE, of_element);
        Self { nodes, elements, of_elements }
    }

    /// What an element around these nodes brings to the matrices.
    pub fn of(&self, element: u32) -> &OfElement {
        let at = self.elements.binary_search(&element).expect("an element of a node that has changed");
        &self.of_elements[at]
    }
}
