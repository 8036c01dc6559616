//! Elements beside one another.

use crate::mesh::Mesh;
use crate::units::Length;

/// Which elements share a node.
#[derive(Debug)]
pub struct Neighbours<'a> {
    elements: &'a [[u32; 4]],
    of_node: Vec<Vec<u32>>,
}

impl<'a> Neighbours<'a> {
    /// Those of a mesh.
    pub fn of<U: Length>(mesh: &'a Mesh<U>) -> Self {
        Self::among(mesh.n_nodes(), mesh.elements())
    }

    /// Those of elements between `n_nodes` nodes.
    pub fn among(n_nodes: usize, elements: &'a [[u32; 4]]) -> Self {
        let mut of_node = vec![Vec::new(); n_nodes];
        for (element, nodes) in (0u32..).zip(elements) {
            nodes.iter().for_each(|&node| of_node[node as usize].push(element));
        }
        Self { elements, of_node }
    }

    /// The elements that share a node with one, itself among them; those that share two come twice.
    pub fn around(&self, element: usize) -> impl Iterator<Item = usize> {
        let of_node = |node: u32| self.of_node[node as usize].iter().map(|&element| element as usize);
        self.elements[element].into_iter().flat_map(of_node)
    }

    /// The elements that hang together and for which `belongs` is true.
    pub fn bodies(&self, belongs: impl FnMut(usize) -> bool) -> Vec<Vec<usize>> {
        let mut is_left: Vec<bool> = (0..self.elements.len()).map(belongs).collect();
        let mut bodies = Vec::new();
        for first in 0..is_left.len() {
            if !std::mem::take(&mut is_left[first]) {
                continue;
            }
            let (mut body, mut at) = (vec![first], 0);
            while let Some(&element) = body.get(at) {
                body.extend(self.around(element).filter(|&other| std::mem::take(&mut is_left[other])));
                at += 1;
            }
            bodies.push(body);
        }
        bodies
    }

    /// The elements beside those of `body`.
    pub fn ring(&self, body: &[usize]) -> Vec<usize> {
        let mut is_seen = vec![false; self.elements.len()];
        body.iter().for_each(|&element| is_seen[element] = true);
        let beside = body.iter().flat_map(|&element| self.around(element));
        beside.filter(|&element| !std::mem::replace(&mut is_seen[element], true)).collect()
    }
}
