//! The mesh of a joint: quadrilaterals of the strips, interface elements of the adhesive.

use super::element::{Interface, Q4};
use super::{BoundaryHistory, JointParts, Kinematics, MeshFault, Quadrature, border_edges, sorted, strips};
use crate::mesh::{ElementGeometry, shape_functions};
use std::collections::{HashMap, HashSet};

/// The most nodes of a strip of squares: far beyond what can be solved, and few enough that a slip of the pen in a case
/// asks for no terabytes.
const MOST_NODES: usize = 1 << 24;

/// A checked mesh of a joint, in mm with y up. Nodes and elements keep the numbers they are given with.
#[derive(Debug, Clone, PartialEq)]
pub struct JointMesh {
    nodes: Vec<[f64; 2]>,
    elements: Vec<[u32; 4]>,
    interfaces: Vec<[u32; 4]>,
    cracked: Vec<bool>,
    groups: Vec<String>,
    element_group: Vec<u32>,
    pairs: Vec<[u32; 2]>,
    /// Number of the strip (connected part) of each node.
    strip: Vec<u32>,
}

impl JointMesh {
    /// Checks the parts and puts them together.
    ///
    /// # Errors
    /// A [`MeshFault`] names the node or element that cannot be used.
    pub fn new(parts: JointParts) -> Result<Self, MeshFault> {
        match parts.interfaces.is_empty() {
            true => Err(MeshFault::NoInterface),
            false => Self::checked(parts),
        }
    }

    /// The mesh of a body without an adhesive; `parts.interfaces` is left aside.
    ///
    /// # Errors
    /// What [`JointMesh::new`] refuses of elements and groups, and parts that do not hang together.
    pub fn of_body(parts: JointParts) -> Result<Self, MeshFault> {
        let body = Self::checked(JointParts { interfaces: Vec::new(), cracked: Vec::new(), ..parts })?;
        match body.n_strips() {
            1 => Ok(body),
            _ => Err(MeshFault::NoInterface),
        }
    }

    /// The same whether there is an adhesive or not.
    fn like(&self, parts: JointParts) -> Result<Self, MeshFault> {
        if self.interfaces.is_empty() { Self::of_body(parts) } else { Self::new(parts) }
    }

    fn checked(parts: JointParts) -> Result<Self, MeshFault> {
        let JointParts { nodes, elements, interfaces, mut cracked, mut groups, mut element_group, .. } = parts;
        if groups.is_empty() {
            groups = vec!["strips".to_owned()];
        }
        if element_group.is_empty() {
            element_group = vec![0; elements.len()];
        }
        if element_group.len() != elements.len() || element_group.iter().any(|&g| g as usize >= groups.len()) {
            return Err(MeshFault::Groups);
        }
        check_strips(&nodes, &elements)?;
        let missing = |node: u32| node as usize >= nodes.len();
        if cracked.is_empty() {
            cracked = vec![false; interfaces.len()];
        }
        if cracked.len() != interfaces.len() || (!cracked.is_empty() && !cracked.contains(&false)) {
            return Err(MeshFault::NoInterface);
        }
        for (element, corners) in interfaces.iter().enumerate() {
            if let Some(&node) = corners.iter().find(|&&node| missing(node)) {
                return Err(MeshFault::InterfaceNode { element, node, n_nodes: nodes.len() });
            }
            let positions = corners.map(|node| nodes[node as usize]);
            if Interface::new(positions, Quadrature::NewtonCotes, Kinematics::Paper).is_none() {
                return Err(MeshFault::BadInterface { element, nodes: *corners });
            }
        }
        all_different("interface element", &interfaces)?;
        let mut pairs: Vec<[u32; 2]> = Vec::with_capacity(interfaces.len() + 1);
        let mut seen = HashSet::new();
        for (element, &nodes) in interfaces.iter().enumerate() {
            let [l1, l2, u1, u2] = nodes;
            for pair in [[l1, u1], [l2, u2]] {
                if pair[0] != pair[1] && seen.contains(&[pair[1], pair[0]]) {
                    return Err(MeshFault::FacesSwapped { element, nodes, lower: pair[1], upper: pair[0] });
                }
                if seen.insert(pair) {
                    pairs.push(pair);
                }
            }
        }
        let strip = strips(nodes.len(), &elements);
        if let Some(&[lower, upper]) = pairs.iter().find(|pair| strip[pair[0] as usize] == strip[pair[1] as usize]) {
            // A pair within one strip is allowed (a slit), a node paired with itself is not.
            if lower == upper {
                return Err(MeshFault::SelfPair { node: lower });
            }
        }
        Ok(Self { nodes, elements, interfaces, cracked, groups, element_group, pairs, strip })
    }

    /// Two strips of `rows` by `columns` square elements of `element_size`, a `gap` (mm) apart about y = 0, with
    /// the left edge at x = 0. Nodes run from left to right, row by row from the bottom.
    ///
    /// # Errors
    /// [`MeshFault::Size`] when a size is not positive, nothing is asked for, or more than 16 million nodes to a strip.
    pub fn rectangular(columns: usize, rows: usize, element_size: f64, gap: f64) -> Result<Self, MeshFault> {
        let sized = element_size.is_finite() && element_size > 0.0 && gap.is_finite() && gap >= 0.0;
        let nodes = columns.saturating_add(1).saturating_mul(rows.saturating_add(1));
        if !sized || columns == 0 || rows == 0 || nodes > MOST_NODES {
            return Err(MeshFault::Size { columns, rows, element_size, gap });
        }
        let per_row = columns as u32 + 1;
        let mut nodes = Vec::with_capacity(2 * (columns + 1) * (rows + 1));
        for bottom in [-0.5 * gap - rows as f64 * element_size, 0.5 * gap] {
            for j in 0..=rows {
                let y = bottom + j as f64 * element_size;
                nodes.extend((0..=columns).map(|i| [i as f64 * element_size, y]));
            }
        }
        let first_upper = per_row * (rows as u32 + 1);
        let mut elements = Vec::with_capacity(2 * columns * rows);
        for first in [0, first_upper] {
            for j in 0..rows as u32 {
                for i in 0..columns as u32 {
                    let a = first + j * per_row + i;
                    elements.push([a, a + 1, a + 1 + per_row, a + per_row]);
                }
            }
        }
        let face = first_upper - per_row;
        let interfaces =
            (0..columns as u32).map(|i| [face + i, face + i + 1, first_upper + i, first_upper + i + 1]).collect();
        let element_group = [0, 1].iter().flat_map(|&g| std::iter::repeat_n(g, columns * rows)).collect();
        let groups = vec!["lower".to_owned(), "upper".to_owned()];
        Self::new(JointParts { nodes, elements, interfaces, groups, element_group, ..JointParts::default() })
    }

    /// The joint between strips that share no node: nodes that face each other across the gap are paired by
    /// geometry, being each other's nearest on the borders of two different strips. The lower of two strips, from which
    /// the normal points to the other, is that of the group `parts.lower`; without, the one further down (in the
    /// mean), and of two at one height the one to the left. Interface elements follow each other along the tangent,
    /// which has the normal to its left.
    ///
    /// `parts.interfaces` is left aside.
    ///
    /// # Errors
    /// What [`JointMesh::new`] refuses, and faces that do not pair.
    pub fn from_strips(mut parts: JointParts) -> Result<Self, MeshFault> {
        check_strips(&parts.nodes, &parts.elements)?;
        parts.interfaces = super::pairing::interfaces(&parts)?;
        Self::new(parts)
    }

    /// The part made of the elements for which `keep` (called with the element's number) is true, with the
    /// interface elements whose four nodes are all in it: a region cut out of a larger joint. Also the number in
    /// this mesh of each node of the part.
    ///
    /// # Errors
    /// When the part is no joint.
    pub fn part(&self, keep: impl Fn(usize) -> bool) -> Result<(Self, Vec<u32>), MeshFault> {
        let kept: Vec<usize> = (0..self.elements.len()).filter(|&element| keep(element)).collect();
        let mut of: Vec<u32> = kept.iter().flat_map(|&element| self.elements[element]).collect();
        of.sort_unstable();
        of.dedup();
        let number: HashMap<u32, u32> = (0u32..).zip(&of).map(|(new, &old)| (old, new)).collect();
        let renumbered = |corners: &[u32; 4]| corners.map(|node| number[&node]);
        let whole = |corners: &&[u32; 4]| corners.iter().all(|node| number.contains_key(node));
        let parts = JointParts {
            nodes: of.iter().map(|&node| self.nodes[node as usize]).collect(),
            elements: kept.iter().map(|&element| renumbered(&self.elements[element])).collect(),
            interfaces: self.interfaces.iter().filter(whole).map(renumbered).collect(),
            cracked: (self.interfaces.iter().zip(&self.cracked))
                .filter_map(|(corners, &cracked)| whole(&corners).then_some(cracked))
                .collect(),
            groups: self.groups.clone(),
            element_group: kept.iter().map(|&element| self.element_group[element]).collect(),
            ..JointParts::default()
        };
        Ok((self.like(parts)?, of))
    }

    /// Positions of the nodes, mm, y up.
    pub fn nodes(&self) -> &[[f64; 2]] {
        &self.nodes
    }

    /// Corners of the strips' elements.
    pub fn elements(&self) -> &[[u32; 4]] {
        &self.elements
    }

    /// Interface elements: lower left, lower right, upper left, upper right.
    pub fn interfaces(&self) -> &[[u32; 4]] {
        &self.interfaces
    }

    /// Twice the way along the mid-line of an interface element, from its first pair to its second, mm.
    pub(crate) fn twice_along(&self, [l1, l2, u1, u2]: [u32; 4]) -> [f64; 2] {
        let at = |node: u32| self.nodes[node as usize];
        [0, 1].map(|c| at(l2)[c] + at(u2)[c] - at(l1)[c] - at(u1)[c])
    }

    /// Of each interface element, whether it is cracked: its faces press on each other where they meet, and hold
    /// nothing else.
    pub fn cracked(&self) -> &[bool] {
        &self.cracked
    }

    /// This mesh with those interface elements cracked all of whose nodes are among `nodes`.
    ///
    /// # Errors
    /// [`MeshFault::Crack`] when none is, [`MeshFault::NoInterface`] when all are.
    pub fn with_crack(mut self, nodes: &[u32]) -> Result<Self, MeshFault> {
        let nodes: HashSet<u32> = nodes.iter().copied().collect();
        for (cracked, corners) in self.cracked.iter_mut().zip(&self.interfaces) {
            *cracked |= corners.iter().all(|node| nodes.contains(node));
        }
        match (self.cracked.contains(&true), self.cracked.contains(&false)) {
            (false, _) => Err(MeshFault::Crack),
            (_, false) => Err(MeshFault::NoInterface),
            _ => Ok(self),
        }
    }

    /// Of each node pair, whether it is cracked: whether all of its interface elements are.
    pub fn cracked_pairs(&self) -> Vec<bool> {
        let mut held: HashSet<[u32; 2]> = HashSet::new();
        for (&[l1, l2, u1, u2], _) in self.interfaces.iter().zip(&self.cracked).filter(|(_, cracked)| !**cracked) {
            held.extend([[l1, u1], [l2, u2]]);
        }
        self.pairs.iter().map(|pair| !held.contains(pair)).collect()
    }

    /// Names of the element groups.
    pub fn groups(&self) -> &[String] {
        &self.groups
    }

    /// Group of each element.
    pub fn element_group(&self) -> &[u32] {
        &self.element_group
    }

    /// Node pairs of the interface (lower, upper) along it.
    pub fn pairs(&self) -> &[[u32; 2]] {
        &self.pairs
    }

    /// Number of the strip (connected part of the mesh) of each node.
    pub fn strip(&self) -> &[u32] {
        &self.strip
    }

    /// Number of strips.
    pub fn n_strips(&self) -> usize {
        self.strip.iter().max().map_or(0, |&last| last as usize + 1)
    }

    /// Mean side of the elements, mm: the square root of their mean area.
    pub fn element_size(&self) -> f64 {
        let area =
            |corners: &[u32; 4]| ElementGeometry::new(corners.map(|node| self.nodes[node as usize])).signed_area();
        (self.elements.iter().map(area).sum::<f64>() / self.elements.len() as f64).sqrt()
    }

    /// Mean distance of the faces, mm; 0 without an adhesive.
    pub fn gap(&self) -> f64 {
        let gap = |&[l1, l2, u1, u2]: &[u32; 4]| {
            let corners = [l1, l2, u1, u2].map(|node| self.nodes[node as usize]);
            Interface::new(corners, Quadrature::NewtonCotes, Kinematics::Paper).map_or(0.0, |element| element.gap())
        };
        self.interfaces.iter().map(gap).sum::<f64>() / self.interfaces.len().max(1) as f64
    }

    /// The nodes on the outer border: all border nodes of the strips but those that lie inside a face of the
    /// adhesive. The end nodes of the faces belong to it (THEORY 9).
    pub fn outer_nodes(&self) -> Vec<u32> {
        self.outer_nodes_without(|_| false)
    }

    /// The same without edges both of whose nodes are free: a corner of a free and a prescribed side is prescribed.
    pub fn outer_nodes_without(&self, is_free: impl Fn(u32) -> bool) -> Vec<u32> {
        let border = border_edges(&self.elements);
        let faces: HashSet<[u32; 2]> = self.face_edges().collect();
        let is_held = |&[a, b]: &[u32; 2]| !(faces.contains(&sorted([a, b])) || is_free(a) && is_free(b));
        let mut nodes: Vec<u32> = border.into_iter().filter(is_held).flatten().collect();
        nodes.sort_unstable();
        nodes.dedup();
        nodes
    }

    /// The end nodes of the faces of the adhesive: those of one interface element alone.
    pub fn face_ends(&self) -> HashSet<u32> {
        let mut count: HashMap<u32, u32> = HashMap::new();
        self.interfaces.iter().flatten().for_each(|&node| *count.entry(node).or_default() += 1);
        count.into_iter().filter(|&(_, n)| n == 1).map(|(node, _)| node).collect()
    }

    /// Longer side of the rectangle that holds the mesh, mm.
    pub fn extent(&self) -> f64 {
        let side = |c: usize| {
            let bound = |pick: fn(f64, f64) -> f64, start: f64| self.nodes.iter().map(|x| x[c]).fold(start, pick);
            bound(f64::max, f64::NEG_INFINITY) - bound(f64::min, f64::INFINITY)
        };
        side(0).max(side(1))
    }

    /// Edges of the faces, as sorted node pairs.
    fn face_edges(&self) -> impl Iterator<Item = [u32; 2]> {
        self.interfaces.iter().flat_map(|&[l1, l2, u1, u2]| [sorted([l1, l2]), sorted([u1, u2])])
    }

    /// The mesh with every element cut into `k` by `k`, and what carries nodal values to it. Old nodes keep
    /// their numbers; new ones follow.
    ///
    /// # Errors
    /// [`MeshFault::Refinement`] for `k` outside 1..=32, or for a mesh with triangles.
    pub fn refined(&self, k: usize) -> Result<(Self, Carry), MeshFault> {
        if !(1..=32).contains(&k) || self.elements.iter().any(|corners| corners[2] == corners[3]) {
            return Err(MeshFault::Refinement { k });
        }
        let mut weights: Vec<Vec<(u32, f64)>> = (0..self.nodes.len() as u32).map(|node| vec![(node, 1.0)]).collect();
        let mut on_edges: HashMap<[u32; 2], Vec<u32>> = HashMap::new();
        // Nodes on an edge from a to b, both ends included.
        let mut edge = |a: u32, b: u32, weights: &mut Vec<Vec<(u32, f64)>>| -> Vec<u32> {
            let key = sorted([a, b]);
            let inner = on_edges.entry(key).or_insert_with(|| {
                (1..k)
                    .map(|i| {
                        let share = i as f64 / k as f64;
                        weights.push(vec![(key[0], 1.0 - share), (key[1], share)]);
                        weights.len() as u32 - 1
                    })
                    .collect()
            });
            let mut line: Vec<u32> = std::iter::once(key[0]).chain(inner.iter().copied()).chain([key[1]]).collect();
            if a != key[0] {
                line.reverse();
            }
            line
        };
        let mut elements = Vec::with_capacity(self.elements.len() * k * k);
        let mut element_group = Vec::with_capacity(elements.capacity());
        for (&[a, b, c, d], &group) in self.elements.iter().zip(&self.element_group) {
            let (bottom, top) = (edge(a, b, &mut weights), edge(d, c, &mut weights));
            let (left, right) = (edge(a, d, &mut weights), edge(b, c, &mut weights));
            let mut grid = vec![vec![0u32; k + 1]; k + 1];
            for j in 0..=k {
                for i in 0..=k {
                    grid[j][i] = match (i, j) {
                        (_, 0) => bottom[i],
                        (_, j) if j == k => top[i],
                        (0, _) => left[j],
                        (i, _) if i == k => right[j],
                        _ => {
                            let (x, y) = (i as f64 / k as f64, j as f64 / k as f64);
                            let psi = shape_functions(x, y);
                            weights.push([a, b, c, d].into_iter().zip(psi).collect());
                            weights.len() as u32 - 1
                        }
                    };
                }
            }
            for j in 0..k {
                for i in 0..k {
                    elements.push([grid[j][i], grid[j][i + 1], grid[j + 1][i + 1], grid[j + 1][i]]);
                    element_group.push(group);
                }
            }
        }
        let mut interfaces = Vec::with_capacity(self.interfaces.len() * k);
        for &[l1, l2, u1, u2] in &self.interfaces {
            let (lower, upper) = (edge(l1, l2, &mut weights), edge(u1, u2, &mut weights));
            interfaces.extend((0..k).map(|i| [lower[i], lower[i + 1], upper[i], upper[i + 1]]));
        }
        let cracked = self.cracked.iter().flat_map(|&cracked| std::iter::repeat_n(cracked, k)).collect();
        let carry = Carry { weights };
        let nodes = carry.values(&self.nodes);
        let groups = self.groups.clone();
        let parts = JointParts { nodes, elements, interfaces, cracked, groups, element_group, ..JointParts::default() };
        let mesh = self.like(parts)?;
        Ok((mesh, carry))
    }

    /// The prescribed displacements of this mesh on its refinement `fine`: every node of `fine` on an edge of the
    /// outer border both of whose ends are prescribed here (in both components, or in the same one) takes the value
    /// between them. Nodes between those of a rigid block belong to it; forces stay where they are.
    pub fn carry_boundary(&self, carry: &Carry, boundary: &BoundaryHistory) -> BoundaryHistory {
        let place: HashMap<u32, usize> = boundary.nodes().iter().enumerate().map(|(k, &node)| (node, k)).collect();
        let faces: HashSet<[u32; 2]> = self.face_edges().collect();
        let border: HashSet<[u32; 2]> =
            border_edges(&self.elements).into_iter().map(sorted).filter(|edge| !faces.contains(edge)).collect();
        let held = boundary.supports().held;
        let held_by = |weights: &[(u32, f64)]| match *weights {
            [(node, _)] => place.get(&node).map_or([false; 2], |&k| held[k]),
            [(a, _), (b, _)] if border.contains(&sorted([a, b])) => match (place.get(&a), place.get(&b)) {
                (Some(&a), Some(&b)) => [0, 1].map(|c| held[a][c] && held[b][c]),
                _ => [false; 2],
            },
            _ => [false; 2],
        };
        struct Kept<'a> {
            node: u32,
            held: [bool; 2],
            weights: &'a [(u32, f64)],
        }
        let kept: Vec<Kept<'_>> = (0u32..)
            .zip(&carry.weights)
            .map(|(node, weights)| Kept { node, held: held_by(weights), weights })
            .filter(|kept| kept.held.contains(&true))
            .collect();
        let carried = |field: &[[f64; 2]]| {
            let value = |weights: &[(u32, f64)], c: usize| {
                weights.iter().map(|(node, weight)| weight * field[place[node]][c]).sum::<f64>()
            };
            let values = |kept: &Kept<'_>| [0, 1].map(|c| if kept.held[c] { value(kept.weights, c) } else { 0.0 });
            kept.iter().map(values).collect()
        };
        let (nodes, held) = kept.iter().map(|kept| (kept.node, kept.held)).unzip();
        boundary.carried(nodes, held, carried, |nodes| carry.nodes_between(nodes))
    }
}

/// What carries nodal values to a refined mesh, by the bilinear shape functions.
#[derive(Debug, Clone, PartialEq)]
pub struct Carry {
    /// Of each node of the fine mesh: nodes of the coarse one, and their weights.
    weights: Vec<Vec<(u32, f64)>>,
}

impl Carry {
    /// The transposed of [`Carry::values`]: what forces at the nodes of the fine mesh are at the `n` nodes of the
    /// coarse one.
    pub fn gathered(&self, fine: &[[f64; 2]], n: usize) -> Vec<[f64; 2]> {
        let mut coarse = vec![[0.0; 2]; n];
        for (weights, value) in self.weights.iter().zip(fine) {
            for &(node, weight) in weights {
                (0..2).for_each(|c| coarse[node as usize][c] += weight * value[c]);
            }
        }
        coarse
    }

    /// The nodes of the fine mesh that lie between those `nodes` of the coarse one alone, these included.
    pub fn nodes_between(&self, nodes: &[u32]) -> Vec<u32> {
        let between = |weights: &Vec<(u32, f64)>| weights.iter().all(|(node, _)| nodes.contains(node));
        (0u32..).zip(&self.weights).filter(|(_, weights)| between(weights)).map(|(node, _)| node).collect()
    }

    /// Values at the nodes of the fine mesh, from those at the nodes of the coarse one.
    pub fn values(&self, coarse: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let at = |weights: &Vec<(u32, f64)>, c: usize| -> f64 {
            weights.iter().map(|&(node, weight)| weight * coarse[node as usize][c]).sum()
        };
        self.weights.iter().map(|weights| [0, 1].map(|c| at(weights, c))).collect()
    }
}

/// Refuses nodes without a position, elements without an area, and nodes without an element.
fn check_strips(nodes: &[[f64; 2]], elements: &[[u32; 4]]) -> Result<(), MeshFault> {
    if elements.is_empty() {
        return Err(MeshFault::Empty);
    }
    if let Some(node) = nodes.iter().position(|[x, y]| !(x.is_finite() && y.is_finite())) {
        return Err(MeshFault::NotFinite { node });
    }
    let mut used = vec![false; nodes.len()];
    let missing = |node: u32| node as usize >= nodes.len();
    for (element, corners) in elements.iter().enumerate() {
        if let Some(&node) = corners.iter().find(|&&node| missing(node)) {
            return Err(MeshFault::MissingNode { element, node, n_nodes: nodes.len() });
        }
        corners.iter().for_each(|&node| used[node as usize] = true);
        let positions = corners.map(|node| nodes[node as usize]);
        if Q4::new(positions, Kinematics::Paper).is_none() {
            let at = [0, 1].map(|c| positions.iter().map(|p| p[c]).sum::<f64>() / 4.0);
            return Err(MeshFault::BadElement { element, x: at[0], y: at[1] });
        }
    }
    all_different("element", elements)?;
    if let Some(node) = used.iter().position(|&used| !used) {
        return Err(MeshFault::DanglingNode { node, x: nodes[node][0], y: nodes[node][1] });
    }
    Ok(())
}

/// Refuses an element on the nodes of another: its stiffness would count twice.
fn all_different(kind: &'static str, elements: &[[u32; 4]]) -> Result<(), MeshFault> {
    let mut seen: HashMap<[u32; 4], usize> = HashMap::with_capacity(elements.len());
    for (element, corners) in elements.iter().enumerate() {
        let mut nodes = *corners;
        nodes.sort_unstable();
        if let Some(other) = seen.insert(nodes, element) {
            return Err(MeshFault::SameNodes { kind, element, other });
        }
    }
    Ok(())
}
