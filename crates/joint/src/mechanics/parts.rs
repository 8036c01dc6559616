//! What a mesh of a joint is made of: edges and connected parts.

use std::collections::{BTreeMap, HashMap};

/// What a mesh is made of, before it is checked.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct JointParts {
    /// Positions, mm, y up.
    pub nodes: Vec<[f64; 2]>,
    /// Corners of each element, counter-clockwise; of a triangle the last one twice.
    pub elements: Vec<[u32; 4]>,
    /// Of each interface element: lower left, lower right, upper left, upper right.
    pub interfaces: Vec<[u32; 4]>,
    /// Of each interface element, whether it is cracked: its faces touch where they meet and hold nothing else; empty
    /// for none.
    pub cracked: Vec<bool>,
    /// Nodes that may lie on a face of the adhesive, where faces are found by geometry; empty for all border nodes.
    pub faces: Vec<u32>,
    /// The group of elements whose strip is the lower one, where faces are found by geometry; `None` for the strip
    /// further down.
    pub lower: Option<u32>,
    /// Names of the groups of elements, each of which may have its own material; empty for one group.
    pub groups: Vec<String>,
    /// Group of each element; empty for one group.
    pub element_group: Vec<u32>,
}

/// The two ends of an edge, the lower number first.
pub(super) fn sorted([a, b]: [u32; 2]) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// Edges of one element alone, as that element goes around them, in the order of the elements.
pub(super) fn border_edges(elements: &[[u32; 4]]) -> Vec<[u32; 2]> {
    let edges = |corners: &[u32; 4]| {
        let corners = *corners;
        (0..4).map(move |k| [corners[k], corners[(k + 1) % 4]]).filter(|[a, b]| a != b)
    };
    let mut count: HashMap<[u32; 2], u32> = HashMap::new();
    for edge in elements.iter().flat_map(edges) {
        *count.entry(sorted(edge)).or_default() += 1;
    }
    elements.iter().flat_map(edges).filter(|&edge| count[&sorted(edge)] == 1).collect()
}

/// Connected parts of a mesh: the number of the part of each node, in order of their first nodes.
pub(super) fn strips(n_nodes: usize, elements: &[[u32; 4]]) -> Vec<u32> {
    let mut parent: Vec<u32> = (0..n_nodes as u32).collect();
    fn root(parent: &mut [u32], mut node: u32) -> u32 {
        while parent[node as usize] != node {
            parent[node as usize] = parent[parent[node as usize] as usize];
            node = parent[node as usize];
        }
        node
    }
    for corners in elements {
        for k in 1..4 {
            let (a, b) = (root(&mut parent, corners[0]), root(&mut parent, corners[k]));
            parent[a.max(b) as usize] = a.min(b);
        }
    }
    let mut numbers = BTreeMap::new();
    (0..n_nodes as u32)
        .map(|node| {
            let next = numbers.len() as u32;
            *numbers.entry(root(&mut parent, node)).or_insert(next)
        })
        .collect()
}
