//! What keeps a mesh from being made.

use thiserror::Error;

/// Why a mesh cannot be laid on the given zones.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum MeshError {
    /// The element size is outside 4..=128 px.
    #[error("the element size is {size} px; choose 4 to 128 px (16 is a good start)")]
    ElementSize {
        /// What was asked for, px.
        size: usize,
    },
    /// This share of its pixels, that an element must keep, is none.
    #[error("the share of pixels that an element must keep is {0}; give a number above 0, at most 1")]
    ElementShare(f64),
    /// The rectangle is not one (swapped corners, NaN).
    #[error("zone '{zone}': ({x0}, {y0}) to ({x1}, {y1}) px is not a rectangle; give x0 < x1 and y0 < y1")]
    NotARectangle {
        /// Zone's name.
        zone: String,
        /// Left edge, px.
        x0: f64,
        /// Upper edge, px.
        y0: f64,
        /// Right edge, px.
        x1: f64,
        /// Lower edge, px.
        y1: f64,
    },
    /// The zone reaches beyond the image.
    #[error("zone '{zone}': ({x0}, {y0}) to ({x1}, {y1}) px reaches outside the image of {width} x {height} px")]
    OutsideImage {
        /// Zone's name.
        zone: String,
        /// Left edge, px.
        x0: f64,
        /// Upper edge, px.
        y0: f64,
        /// Right edge, px.
        x1: f64,
        /// Lower edge, px.
        y1: f64,
        /// Image columns.
        width: usize,
        /// Image rows.
        height: usize,
    },
    /// Not one whole element fits.
    #[error(
        "zone '{zone}' is {width} x {height} px: no element of {size} px fits; enlarge the zone or choose smaller elements"
    )]
    TooSmall {
        /// Zone's name.
        zone: String,
        /// Zone's width, px.
        width: f64,
        /// Zone's height, px.
        height: f64,
        /// Element size, px.
        size: usize,
    },
    /// These two zones measure the same pixels.
    #[error("zones '{0}' and '{1}' overlap; a pixel belongs to one zone only")]
    Overlap(String, String),
    /// Two zones have this name.
    #[error("two zones are named '{0}'; names must differ")]
    SameName(String),
    /// No zone was given.
    #[error("there is no zone to measure")]
    NoZone,
    /// The polygon of a zone, with so many corners, has fewer than three or no area.
    #[error("zone '{0}': a polygon of {1} corners encloses nothing; give three or more that are not in line")]
    NoPolygon(String, usize),
    /// Elements along the sides of a polygon that is no convex quadrilateral.
    #[error(
        "zone '{zone}': elements = \"mapped\" needs a polygon with four corners and no corner that points inwards; give those in order around the region, or a mesh file"
    )]
    NotConvex {
        /// Zone's name.
        zone: String,
    },
    /// A polygon whose sides cross.
    #[error(
        "zone '{zone}': the polygon crosses itself near ({x:.1}, {y:.1}) px: its sides {first} and {second} (counted from 0) meet; give its corners in order around the region"
    )]
    CrossedPolygon {
        /// Zone's name.
        zone: String,
        /// Number of one side, from 0: side k leads from corner k to the next.
        first: usize,
        /// Number of the other.
        second: usize,
        /// Where they meet, px.
        x: f64,
        /// Where they meet, px.
        y: f64,
    },
    /// A corner that is not a finite number.
    #[error("zone '{zone}': corner {corner} of the polygon (counted from 0) is not a pair of finite numbers")]
    NotFinite {
        /// Zone's name.
        zone: String,
        /// Number of the corner, from 0.
        corner: usize,
    },
    /// A crack without length in this zone.
    #[error("zone '{0}': a crack has no length; give two or more different points 'x,y x,y ...' along it")]
    CrackShort(String),
    /// A crack that cuts no edge of the mesh.
    #[error(
        "the crack from ({x0:.0}, {y0:.0}) to ({x1:.0}, {y1:.0}) px cuts no zone: it lies outside of them all, or is shorter than two \
         elements of {size} px and ends inside; move or lengthen it, or take smaller elements"
    )]
    CrackCutsNothing {
        /// First point, px.
        x0: f64,
        /// First point, px.
        y0: f64,
        /// Last point, px.
        x1: f64,
        /// Last point, px.
        y1: f64,
        /// Element size, px.
        size: usize,
    },
    /// A crack in a zone with elements of its own.
    #[error(
        "zone '{zone}' has elements of its own (mesh file or mapped), which are not cut along a crack: double the nodes along it \
         in the mesh file, or take a zone of roi, polygon or mask"
    )]
    CrackInOwnElements {
        /// Zone's name.
        zone: String,
    },
    /// A mask of another size than the image.
    #[error(
        "zone '{zone}': the mask is {mask_width} x {mask_height} px, the image {width} x {height} px; they must be the same"
    )]
    MaskSize {
        /// Zone's name.
        zone: String,
        /// Columns of the mask.
        mask_width: usize,
        /// Rows of the mask.
        mask_height: usize,
        /// Columns of the image.
        width: usize,
        /// Rows of the image.
        height: usize,
    },
    /// Nothing is left of this zone.
    #[error("zone '{0}' holds no pixel of the image: check its rectangle, polygon and mask (white is measured)")]
    Empty(String),
    /// No element of a zone, of this size (px), keeps the share of pixels asked for, per cent.
    #[error(
        "zone '{0}': no element of {1} px has {2:.0} % of its pixels inside the region; choose smaller elements or a smaller element share"
    )]
    NoElement(String, usize, f64),
    /// The guard leaves nothing to measure with, or is none.
    #[error("zone '{zone}': the guard is {guard} px; give a number from 0 on that leaves pixels in the zone")]
    Guard {
        /// Zone's name.
        zone: String,
        /// What was asked for, px.
        guard: f64,
    },
    /// A zone with another number of guards than of sides.
    #[error(
        "zone '{0}': {1} guards for {2} sides; give one number for all, or one for each side (rectangle: left, top, right, bottom)"
    )]
    GuardSides(String, usize, usize),
    /// An element names a node that does not exist.
    #[error("zone '{zone}': element {element} names node {node}, there are {n_nodes} (counted from 0)")]
    MissingNode {
        /// Zone's name.
        zone: String,
        /// The element, from 0.
        element: usize,
        /// The node it names.
        node: u32,
        /// Nodes of the zone.
        n_nodes: usize,
    },
    /// An element that is folded, concave or without area.
    #[error(
        "zone '{zone}': element {element} about ({x:.1}, {y:.1}) px is folded or has no area; its corners must go around a convex four-sided (or three-sided) shape"
    )]
    BadElement {
        /// Zone's name.
        zone: String,
        /// The element, from 0.
        element: usize,
        /// Mean of its corners, px.
        x: f64,
        /// Mean of its corners, px.
        y: f64,
    },
    /// A node that no element uses, or that is no position.
    #[error("zone '{zone}': node {node} at ({x}, {y}) px belongs to no element or is not a position in the image")]
    BadNode {
        /// Zone's name.
        zone: String,
        /// The node, from 0.
        node: usize,
        /// Its position.
        x: f64,
        /// Its position.
        y: f64,
    },
    /// The mesh of this zone has no elements.
    #[error("zone '{0}': the mesh has no four-sided or three-sided element")]
    NoElements(String),
}
