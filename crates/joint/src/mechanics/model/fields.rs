//! What a field of displacements says: jumps, tractions, strains, stresses, forces, the crack front.

use super::{GRAIN, Model};
use crate::mechanics::cohesive::{CohesiveLaw, Jump, Touching, Traction};
use crate::mechanics::element::{Interface, InterfacePoint, Q4, Q4Point};
use crate::mechanics::substrate::{EngineeringStrain, Stress, SubstrateLaw, SubstrateState};
use rayon::prelude::*;

impl Model {
    /// The jump at each node pair ([`JointMesh::pairs`](crate::mechanics::JointMesh::pairs)), mm: where two elements
    /// meet, the mean of theirs by length.
    pub fn jumps(&self, u: &[[f64; 2]]) -> Vec<Jump> {
        self.means_of_ends(|element, interface, end| interface.jump(end, &self.gather(element, u)))
    }

    /// The change of the jump at each node pair, to first order, where the displacements `u` change by `by`; where
    /// rotations are small that is the jump of `by`.
    pub fn jump_changes(&self, u: &[[f64; 2]], by: &[[f64; 2]]) -> Vec<Jump> {
        self.means_of_ends(|element, interface, end| {
            interface.jump_change(end, &self.gather(element, u), &self.gather(element, by))
        })
    }

    fn means_of_ends(&self, of_end: impl Fn(usize, &Interface, &InterfacePoint) -> Jump) -> Vec<Jump> {
        let mut sums = vec![[0.0; 3]; self.mesh.pairs().len()];
        self.for_each_end(|pair, element, interface, end| {
            let jump = of_end(element, interface, end);
            let sum = &mut sums[pair];
            *sum = [sum[0] + end.weight * jump.normal, sum[1] + end.weight * jump.tangential, sum[2] + end.weight];
        });
        sums.into_iter()
            .map(|[normal, tangential, w]| Jump { normal: normal / w, tangential: tangential / w })
            .collect()
    }

    /// The traction at each node pair, MPa.
    pub fn tractions(&self, law: &dyn CohesiveLaw, u: &[[f64; 2]]) -> Vec<Traction> {
        let touching = Touching(law);
        let of = |(jump, cracked)| if cracked { touching.response(jump) } else { law.response(jump) }.traction;
        self.jumps(u).into_iter().zip(self.mesh.cracked_pairs()).map(of).collect()
    }

    /// Place of each node pair on the mid-line, mm, and its distance along the joint from the first pair.
    pub fn pair_positions(&self) -> Vec<([f64; 2], f64)> {
        let nodes = self.mesh.nodes();
        let middle: Vec<[f64; 2]> = (self.mesh.pairs().iter())
            .map(|pair| [0, 1].map(|c| 0.5 * (nodes[pair[0] as usize][c] + nodes[pair[1] as usize][c])))
            .collect();
        let mut along = 0.0;
        let mut before = middle.first().copied().unwrap_or_default();
        middle
            .into_iter()
            .map(|at| {
                along += (at[0] - before[0]).hypot(at[1] - before[1]);
                before = at;
                (at, along)
            })
            .collect()
    }

    /// Unit normal of the joint at rest at each node pair, from the lower to the upper strip; its tangent is `(n_y,
    /// -n_x)`.
    pub fn pair_normals(&self) -> Vec<[f64; 2]> {
        let mut sums = vec![[0.0; 2]; self.mesh.pairs().len()];
        self.for_each_end(|pair, _, _, end| {
            (0..2).for_each(|c| sums[pair][c] += end.weight * end.normal[c]);
        });
        sums.into_iter().map(|n| n.map(|v| v / n[0].hypot(n[1]))).collect()
    }

    /// Calls `each` with the number of the pair, the element's number, the element, and the point, for both ends of
    /// each interface element.
    fn for_each_end(&self, mut each: impl FnMut(usize, usize, &Interface, &InterfacePoint)) {
        for (k, (interface, pairs)) in self.interfaces.iter().zip(&self.end_pairs).enumerate() {
            for (end, &pair) in interface.ends().iter().zip(pairs) {
                each(pair as usize, self.quads.len() + k, interface, end);
            }
        }
    }

    /// The interface elements, each with its number among all elements and whether it is cracked.
    pub(in crate::mechanics) fn bonds(&self) -> impl Iterator<Item = (usize, &Interface, bool)> {
        let numbered = (self.quads.len()..).zip(&self.interfaces).zip(self.mesh.cracked());
        numbered.map(|((element, interface), &cracked)| (element, interface, cracked))
    }

    /// What the forces of the strips under the displacements `u` do at the rates `by` of the nodes.
    pub(in crate::mechanics) fn strip_power(&self, u: &[[f64; 2]], by: &[[f64; 2]]) -> f64 {
        let power = |(element, quad): (usize, &Q4)| {
            quad.force(self.material(element), &self.gather(element, u)).dot(&self.gather(element, by))
        };
        let powers: Vec<f64> = self.quads.par_iter().with_min_len(GRAIN).enumerate().map(power).collect();
        powers.iter().sum()
    }

    /// Material, area (mm^2) and strain of every Gauss point of the strips.
    pub(in crate::mechanics) fn each_strain(
        &self,
        u: &[[f64; 2]],
    ) -> impl Iterator<Item = (&dyn SubstrateLaw, f64, EngineeringStrain)> {
        self.quads.iter().enumerate().flat_map(move |(element, quad)| {
            let u = self.gather(element, u);
            quad.points().map(|point| (self.material(element), point.weight, quad.strain(&point, &u)))
        })
    }

    /// Calls `each` with the corners of the element, its material, the point and the strain there, for every Gauss
    /// point of the strips.
    pub(in crate::mechanics) fn for_each_point(
        &self,
        u: &[[f64; 2]],
        mut each: impl FnMut(&[u32; 4], &dyn SubstrateLaw, &Q4Point, EngineeringStrain),
    ) {
        for (element, quad) in self.quads.iter().enumerate() {
            let of_element = self.gather(element, u);
            for point in quad.points() {
                each(&self.corners[element], self.material(element), point, quad.strain(point, &of_element));
            }
        }
    }

    /// The stress at the four Gauss points of each element, MPa, in the order (-,-), (+,-), (+,+), (-,+); with finite
    /// rotations the second Piola-Kirchhoff stress, in the axes of the body at rest.
    pub fn stresses(&self, u: &[[f64; 2]]) -> Vec<[Stress; 4]> {
        let stresses = |(element, quad): (usize, &Q4)| {
            let u = self.gather(element, u);
            quad.points().map(|point| self.material(element).stress(quad.strain(&point, &u)))
        };
        self.quads.iter().enumerate().map(stresses).collect()
    }

    /// Equivalent stress (MPa) and plastic strain at the four Gauss points of each element.
    pub fn states(&self, u: &[[f64; 2]]) -> Vec<[SubstrateState; 4]> {
        let states = |(element, quad): (usize, &Q4)| {
            let u = self.gather(element, u);
            quad.points().map(|point| self.material(element).state(quad.strain(&point, &u)))
        };
        self.quads.iter().enumerate().map(states).collect()
    }

    /// The internal force at every node, N/mm: at prescribed nodes the reaction, at the others the residual.
    pub fn forces(&self, law: &dyn CohesiveLaw, u: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let mut work = self.work();
        self.evaluate_force(law, u, &mut work);
        work.force
    }

    /// Where, along the joint from the first pair (mm), the normal jump passes the law's front opening: the
    /// crack front (THEORY 9), interpolated. Of several the first; `None` where none is.
    pub fn crack_front(&self, law: &dyn CohesiveLaw, u: &[[f64; 2]]) -> Option<f64> {
        let (jumps, positions, opening) = (self.jumps(u), self.pair_positions(), law.front_opening());
        let rest = |k: usize| jumps[k].normal - opening;
        let cracked = self.mesh.cracked_pairs();
        let passes = |&k: &usize| !cracked[k - 1] && !cracked[k] && (rest(k - 1) < 0.0) != (rest(k) < 0.0);
        (1..jumps.len()).find(passes).map(|k| {
            let share = rest(k - 1) / (rest(k - 1) - rest(k));
            positions[k - 1].1 + share * (positions[k].1 - positions[k - 1].1)
        })
    }
}
