//! What is wrong with a mesh, a boundary or a model.

use thiserror::Error;

/// A mesh that no joint can be made of. Nodes and elements are counted from 0.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum MeshFault {
    /// No element.
    #[error("the mesh has no four-sided or three-sided element")]
    Empty,
    /// Groups that do not fit the elements.
    #[error("the groups of the elements do not fit their number; give one of the named groups for each element")]
    Groups,
    /// A position that is no number.
    #[error("node {node} is at no finite position; give x and y in mm")]
    NotFinite {
        /// The node.
        node: usize,
    },
    /// An element names a node that is not there.
    #[error("element {element} names node {node}, there are {n_nodes} (counted from 0)")]
    MissingNode {
        /// The element.
        element: usize,
        /// The node.
        node: u32,
        /// Number of nodes.
        n_nodes: usize,
    },
    /// An interface element names a node that is not there.
    #[error("interface element {element} names node {node}, there are {n_nodes} (counted from 0)")]
    InterfaceNode {
        /// The interface element.
        element: usize,
        /// The node.
        node: u32,
        /// Number of nodes.
        n_nodes: usize,
    },
    /// An element that is inverted, folded or without area.
    #[error(
        "element {element} about ({x}, {y}) mm is inverted, folded or without area; its corners must go counter-clockwise around a convex shape, with y up"
    )]
    BadElement {
        /// The element.
        element: usize,
        /// Mean of its corners, mm.
        x: f64,
        /// Mean of its corners, mm.
        y: f64,
    },
    /// Two elements on the same nodes.
    #[error("{kind} {element} has the same nodes as {kind} {other}; take one of them out of the mesh")]
    SameNodes {
        /// `element` or `interface element`.
        kind: &'static str,
        /// The later one.
        element: usize,
        /// The one before.
        other: usize,
    },
    /// A node of no element.
    #[error("node {node} at ({x}, {y}) mm belongs to no element; take it out of the mesh")]
    DanglingNode {
        /// The node.
        node: usize,
        /// Its position, mm.
        x: f64,
        /// Its position, mm.
        y: f64,
    },
    /// No interface element.
    #[error("the mesh has no interface element that holds; without adhesive there is no joint")]
    NoInterface,
    /// A crack in which no interface element lies.
    #[error(
        "no interface element lies in the crack with all of its nodes; it must reach over one at least, and the mesh must have interface elements there"
    )]
    Crack,
    /// An interface element whose faces do not pair.
    #[error(
        "interface element {element} (nodes {nodes:?}) does not pair its faces: give lower left, lower right, upper left, upper right, each upper node opposite its lower one"
    )]
    BadInterface {
        /// The interface element.
        element: usize,
        /// Its nodes.
        nodes: [u32; 4],
    },
    /// Interface elements that do not agree which face is the lower one.
    #[error(
        "interface element {element} (nodes {nodes:?}) has the pair ({lower}, {upper}) the other way round than one before it; give all of them with the same face first"
    )]
    FacesSwapped {
        /// The interface element.
        element: usize,
        /// Its nodes.
        nodes: [u32; 4],
        /// Lower node of the pair before.
        lower: u32,
        /// Upper node of the pair before.
        upper: u32,
    },
    /// A node opposite itself.
    #[error("node {node} is paired with itself; the two faces of the adhesive must have nodes of their own")]
    SelfPair {
        /// The node.
        node: u32,
    },
    /// Only one connected part.
    #[error("the mesh is one connected part; a joint needs two strips that share no node")]
    OneStrip,
    /// No faces were found.
    #[error(
        "no edges of two strips face each other node by node; cut both faces of the adhesive at the same places along the joint"
    )]
    NoFaces,
    /// A node on a face without a partner.
    #[error(
        "node {node} at ({x}, {y}) mm on a face of the adhesive has no partner opposite (the nearest, {near}, faces another node); cut both faces at the same places"
    )]
    FacesDoNotPair {
        /// The node.
        node: u32,
        /// Its position, mm.
        x: f64,
        /// Its position, mm.
        y: f64,
        /// The nearest node opposite.
        near: u32,
    },
    /// Sizes that make no mesh.
    #[error(
        "{columns} columns and {rows} rows of elements of {element_size} mm, {gap} mm apart, make no joint; all must be above zero (the gap may be zero), and a strip has at most 16 million nodes"
    )]
    Size {
        /// Columns.
        columns: usize,
        /// Rows per strip.
        rows: usize,
        /// Side of the elements, mm.
        element_size: f64,
        /// Gap, mm.
        gap: f64,
    },
    /// A refinement that is not made.
    #[error("refine = {k}: give a whole number from 1 to 32, and a mesh without triangles")]
    Refinement {
        /// What was asked for.
        k: usize,
    },
}

/// Prescribed displacements that cannot be used. Nodes are counted from 0, instants from 1.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum BoundaryFault {
    /// No node is prescribed.
    #[error("no node is prescribed; give the displacements of the outer border")]
    NoNode,
    /// No instant.
    #[error("there is no instant; give at least one set of displacements")]
    NoInstant,
    /// A node named twice.
    #[error("node {node} is prescribed twice")]
    Twice {
        /// The node.
        node: u32,
    },
    /// An instant with another number of values than there are nodes.
    #[error("instant {instant} gives {given} displacements, {needed} nodes are prescribed")]
    Count {
        /// The instant, from 1.
        instant: usize,
        /// Nodes prescribed.
        needed: usize,
        /// Values given.
        given: usize,
    },
    /// Two values for one component.
    #[error(
        "node {node} is held along {component} by {first} at {} mm and by \"{second}\" at {} mm (instant {instant}); take one of them away, or the node out of one group",
        values[0],
        values[1]
    )]
    Contradiction {
        /// The node.
        node: u32,
        /// `x` or `y`.
        component: &'static str,
        /// Who held it first.
        first: Box<str>,
        /// Who holds it too.
        second: Box<str>,
        /// The instant, from 1.
        instant: usize,
        /// Both values, mm.
        values: [f64; 2],
    },
    /// A force on a node that a block moves.
    #[error(
        "node {node} of a rigid block has a force of its own; load the group of the block, whose force acts at its point_mm"
    )]
    LoadedBlock {
        /// The node.
        node: u32,
    },
    /// A list of another length.
    #[error("a support or load has values for {given} instants, the others have {needed}; give as many")]
    Instants {
        /// Instants of the others.
        needed: usize,
        /// Values given.
        given: usize,
    },
    /// A value that is no number.
    #[error("the displacement of node {node} at instant {instant} is not finite")]
    NotFinite {
        /// The instant, from 1.
        instant: usize,
        /// The node.
        node: u32,
    },
}

/// Why there is no model, or no solution at all.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum ModelError {
    /// A prescribed node that the mesh does not have.
    #[error("node {node} is prescribed and not in the mesh, which has {n_nodes} nodes (counted from 0)")]
    PrescribedNode {
        /// The node.
        node: u32,
        /// Number of nodes.
        n_nodes: usize,
    },
    /// A strip that can move freely.
    #[error(
        "the strip with node {node} at ({x}, {y}) mm has {prescribed} prescribed nodes; prescribe its outer border, at least two nodes"
    )]
    StripNotHeld {
        /// A node of the strip.
        node: usize,
        /// Its position, mm.
        x: f64,
        /// Its position, mm.
        y: f64,
        /// How many of its nodes are prescribed.
        prescribed: usize,
    },
    /// Supports that leave a body free, a rigid block that is no body, a node with two masters.
    #[error("{0}")]
    Supports(String),
    /// A block on rollers in a model with finite rotations.
    #[error(
        "the rigid block \"{block}\" is tied in one component alone, which is for small rotations; with kinematics = \"finite\" tie both"
    )]
    LeverTurns {
        /// Its name.
        block: String,
    },
    /// Another number of materials than groups.
    #[error("{given} materials for {needed} groups of elements; give one for each")]
    Materials {
        /// Groups of the mesh.
        needed: usize,
        /// Materials given.
        given: usize,
    },
    /// A history of other nodes than the model was made for.
    #[error("the prescribed nodes are not those that the model was made for; make a model for them")]
    OtherNodes,
    /// A field with another number of nodes.
    #[error("a field of {given} nodes for a mesh of {needed}")]
    FieldSize {
        /// Nodes of the mesh.
        needed: usize,
        /// Nodes of the field.
        given: usize,
    },
    /// The tangent has no inverse at the field.
    #[error("the tangent is singular at this field, at node {node}: no sensitivity exists there")]
    Singular {
        /// The node.
        node: u32,
    },
}
