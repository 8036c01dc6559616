//! Strains on the elements and on the nodes of a measured field.

use super::Measurement;
use super::strain::{StrainDefinition, TensorStrain, rotation_deg};
use super::strain_window::WindowStrains;
use crate::mesh::{CORNERS, ElementGeometry, LocalMap, Mesh};
use crate::units::Length;

/// The strains of a measured field, on its elements and on its nodes.
#[derive(Debug, Clone)]
pub struct StrainField {
    /// How they are made.
    pub definition: StrainDefinition,
    /// At the centre of each element; `None` where one of its nodes is not measured or the field folds.
    pub elements: Vec<Option<TensorStrain>>,
    /// At each node; `None` where it is not measured, has no element with all nodes measured, or the field folds.
    pub nodes: Vec<Option<TensorStrain>>,
    /// Length over which the strain of an element is measured: the root of the mean area of the elements, px
    /// (in the unit of the mesh). The strains of nodes have twice that.
    pub length_px: f64,
    /// At each node over a window of nodes, where one was asked for.
    pub window: Option<WindowStrains>,
}

impl StrainField {
    /// The strains of `measurement`.
    ///
    /// On elements: the gradient of the bilinear field at the centre. On nodes: the mean of the gradients in that
    /// corner of the elements around it, weighted by their areas (the central difference on a grid). Both are exact
    /// where the displacement is affine.
    ///
    /// ```
    /// # use quadrille_base as quadrille;
    /// # use quadrille::{field::{Measurement, Status, StrainDefinition, StrainField}, mesh::{Mesh, Roi, Zone}};
    /// # let roi = Roi { x0: 0.0, y0: 0.0, x1: 32.0, y1: 32.0 };
    /// # let mesh = Mesh::on_zones(&[Zone::rectangle("all", roi)], 16, 64, 64).unwrap();
    /// # let displacement: Vec<_> = mesh.nodes().iter().map(|x| [0.01 * x[0], 0.0]).collect();
    /// # let measurement = Measurement { status: Status::Converged, sigma: vec![[0.01; 2]; 9], measured: vec![true; 9],
    /// #     marks: None, points: None, element_residual: vec![1.0; 4], model_error: None, mesh: mesh.into(), displacement };
    /// let strain = StrainField::of(&measurement, StrainDefinition::GreenLagrange); // stretched by 1 % along x
    /// assert!((strain.elements[0].unwrap().xx - 0.01005).abs() < 1e-12);
    /// assert_eq!(strain.length_px, 16.0);
    /// ```
    pub fn of<U: Length>(measurement: &Measurement<U>, definition: StrainDefinition) -> Self {
        let mesh = &measurement.mesh;
        let mut elements = vec![None; mesh.n_elements()];
        let mut sums = vec![([[0.0; 2]; 2], 0.0); mesh.n_nodes()];
        for (element, strain) in elements.iter_mut().enumerate() {
            let geometry = StrainElement::new(mesh, element);
            let nodes = geometry.nodes;
            if !nodes.iter().all(|&node| measurement.measured[node]) {
                continue;
            }
            let u = nodes.map(|node| measurement.displacement[node]);
            let gradient = |at: [f64; 2]| geometry.gradient_of(&u, at);
            *strain = gradient([0.5; 2]).and_then(|gradient| definition.of_gradient(gradient));
            for (corner, at) in geometry.corners() {
                let Some(gradient) = gradient(at) else { continue };
                let (sum, area) = &mut sums[nodes[corner]];
                for c in 0..2 {
                    for k in 0..2 {
                        sum[c][k] += geometry.area * gradient[c][k];
                    }
                }
                *area += geometry.area;
            }
        }
        let nodes = sums.into_iter().map(|(sum, area)| {
            (area > 0.0).then(|| definition.of_gradient(sum.map(|row| row.map(|g| g / area)))).flatten()
        });
        Self { definition, nodes: nodes.collect(), elements, length_px: mesh.element_size(), window: None }
    }
}

/// The rotation at the centre of each element, degrees from x towards y; `None` where a node is not measured.
pub fn rotations<U: Length>(measurement: &Measurement<U>) -> Vec<Option<f64>> {
    let mesh = &measurement.mesh;
    let of_element = |element: usize| {
        let geometry = StrainElement::new(mesh, element);
        let is_whole = geometry.nodes.iter().all(|&node| measurement.measured[node]);
        let u = geometry.nodes.map(|node| measurement.displacement[node]);
        is_whole.then(|| geometry.gradient_of(&u, [0.5; 2]).map(rotation_deg)).flatten()
    };
    (0..mesh.n_elements()).map(of_element).collect()
}

/// One element of a mesh as gradients are taken in it.
pub(super) struct StrainElement {
    pub nodes: [usize; 4],
    /// Positive whatever the sense in which the nodes are numbered.
    pub area: f64,
    shape: ElementGeometry,
}

impl StrainElement {
    pub fn new<U: Length>(mesh: &Mesh<U>, element: usize) -> Self {
        let shape = mesh.geometry(element);
        Self { nodes: mesh.elements()[element].map(|node| node as usize), area: shape.area(), shape }
    }

    /// Its corners, and the local coordinates at which their gradient is taken.
    pub fn corners(&self) -> impl Iterator<Item = (usize, [f64; 2])> {
        // A triangle has one gradient; in its doubled corner the map of the quadrilateral is singular.
        let triangle = self.nodes[2] == self.nodes[3];
        let places = CORNERS.into_iter().enumerate().take(if triangle { 3 } else { 4 });
        places.map(move |(corner, place)| (corner, if triangle { [0.5; 2] } else { place }))
    }

    /// The map at local coordinates; `None` where the element is too flat for its area, as NaN is.
    fn map_at(&self, at: [f64; 2]) -> Option<LocalMap> {
        let map = self.shape.map_at(at);
        (map.determinant.abs() > 1e-9 * self.area).then_some(map)
    }

    /// `[[du_x/dx, du_x/dy], [du_y/dx, du_y/dy]]` at local coordinates for corner values `u`; `None` where flat.
    fn gradient_of(&self, u: &[[f64; 2]; 4], at: [f64; 2]) -> Option<[[f64; 2]; 2]> {
        self.map_at(at).map(|map| map.gradient_of(u))
    }

    /// `[dN/dx, dN/dy]` of the four shape functions at local coordinates; `None` where the element is flat.
    pub fn gradients(&self, at: [f64; 2]) -> Option<[[f64; 2]; 4]> {
        self.map_at(at).map(|map| map.gradients())
    }
}
