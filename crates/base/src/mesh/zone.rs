//! Regions of interest.

use super::MeshError;
use std::sync::Arc;

/// A rectangle of the reference image, in pixels; coordinates may be fractional.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Roi {
    /// Left edge.
    pub x0: f64,
    /// Upper edge.
    pub y0: f64,
    /// Right edge, not included.
    pub x1: f64,
    /// Lower edge, not included.
    pub y1: f64,
}

/// How far from the border of a zone pixels are left out, px, while the mesh still reaches the border. Interpolation
/// mixes what lies beyond it into the pixels beside it: three are enough beside an untextured band (THEORY 2).
#[derive(Debug, Clone, PartialEq)]
pub enum Guard {
    /// The same along the whole border, also around holes.
    All(f64),
    /// One number per side: left, top, right, bottom, or from corner k of a polygon on; holes and masks have none.
    Sides(Vec<f64>),
    /// Along a line alone, wherever it runs: a facing edge of a joint.
    Along {
        /// Points of the line in order, px.
        line: Vec<[f64; 2]>,
        /// Pixels whose centre is nearer to it are left out, px.
        width: f64,
    },
}

impl Default for Guard {
    fn default() -> Self {
        Self::All(0.0)
    }
}

impl Guard {
    /// Whether any pixel is left out.
    pub fn is_none(&self) -> bool {
        match self {
            Self::All(guard) => *guard == 0.0,
            Self::Sides(guards) => guards.iter().all(|guard| *guard == 0.0),
            Self::Along { width, .. } => *width == 0.0,
        }
    }

    /// The largest width, px.
    pub(super) fn largest(&self) -> f64 {
        match self {
            Self::All(guard) => *guard,
            Self::Sides(guards) => guards.iter().fold(0.0, |a, b| f64::max(a, *b)),
            Self::Along { width, .. } => *width,
        }
    }
}

/// A path along which the mesh of a zone is cut: on its two sides the displacement is not the same.
#[derive(Debug, Clone, PartialEq)]
pub struct Crack {
    /// Points of the path in order, px. An end inside the zone stays joined: a tip.
    pub path: Vec<[f64; 2]>,
    /// Pixels whose centre is nearer to the path are left out, px: the gap of the open crack is no specimen.
    pub guard: f64,
}

impl Crack {
    /// The guard where none is given, px: what interpolation and gradient reach, and a path that is drawn by hand.
    pub const GUARD: f64 = 3.0;

    /// Refuses paths of less than two points, numbers that are not finite, and negative guards.
    pub(super) fn check(&self, zone: &str) -> Result<(), MeshError> {
        let zone = || zone.to_owned();
        if let Some(corner) = self.path.iter().position(|p| !p.iter().all(|v| v.is_finite())) {
            return Err(MeshError::NotFinite { zone: zone(), corner });
        }
        if !(self.guard.is_finite() && self.guard >= 0.0) {
            return Err(MeshError::Guard { zone: zone(), guard: self.guard });
        }
        if self.path.iter().all(|p| *p == self.path[0]) { Err(MeshError::CrackShort(zone())) } else { Ok(()) }
    }
}

/// A raster as large as the image: which pixels may be measured.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mask {
    width: usize,
    height: usize,
    bits: Vec<bool>,
}

impl Mask {
    /// The mask `bits` row by row, true where the image is measured; `None` unless they are `width * height`.
    pub fn new(width: usize, height: usize, bits: Vec<bool>) -> Option<Self> {
        (width.checked_mul(height) == Some(bits.len())).then_some(Self { width, height, bits })
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Whether the pixel in column `x` and row `y` is measured; false outside.
    pub fn contains(&self, x: usize, y: usize) -> bool {
        x < self.width && y < self.height && self.bits[y * self.width + x]
    }

    /// Number of pixels that are measured.
    pub fn n_inside(&self) -> usize {
        self.bits.iter().filter(|&&bit| bit).count()
    }
}

/// Nodes and elements of one zone that no grid fits.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ZoneElements {
    /// Name, unique among the zones.
    pub name: String,
    /// Node positions.
    pub nodes: Vec<[f64; 2]>,
    /// Corners of each element, numbers in `nodes`, around it in either sense; of a triangle the last one twice.
    pub elements: Vec<[u32; 4]>,
}

/// A named region: the pixels in all of rectangle, polygon and mask, in no excluded polygon. Zones share no node.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Zone {
    /// Name, unique among the zones.
    pub name: String,
    /// Its rectangle; where there is one, the grid starts at its corner. Without, the whole image.
    pub roi: Option<Roi>,
    /// Corners of its polygon, px, in order; empty for none.
    pub polygon: Vec<[f64; 2]>,
    /// Polygons cut out of it.
    pub exclude: Vec<Vec<[f64; 2]>>,
    /// The pixels that may be measured.
    pub mask: Option<Arc<Mask>>,
    /// A mesh of its own instead of a grid.
    pub elements: Option<Arc<ZoneElements>>,
    /// Pixels along the border that are left out.
    pub guard: Guard,
    /// Paths along which its mesh is cut. One with elements of its own is not: there they are for coarser levels.
    pub cracks: Vec<Crack>,
}

impl Zone {
    /// A rectangle.
    pub fn rectangle(name: impl Into<String>, roi: Roi) -> Self {
        Self { name: name.into(), roi: Some(roi), ..Self::default() }
    }

    /// Whether it is nothing but a rectangle (or the whole image).
    pub fn is_rectangle(&self) -> bool {
        self.polygon.is_empty() && self.exclude.is_empty() && self.mask.is_none() && self.elements.is_none()
    }

    /// Its rectangle, or that of the whole image.
    pub(super) fn bounds(&self, width: usize, height: usize) -> Result<Roi, MeshError> {
        let whole = Roi { x0: 0.0, y0: 0.0, x1: width as f64, y1: height as f64 };
        let Roi { x0, y0, x1, y1 } = self.roi.unwrap_or(whole);
        let zone = self.name.clone();
        let finite = [x0, y0, x1, y1].iter().all(|v| v.is_finite());
        if !finite || x0 >= x1 || y0 >= y1 {
            return Err(MeshError::NotARectangle { zone, x0, y0, x1, y1 });
        }
        // The image's pixels cover -0.5..width-0.5; a zone may end at `width`, since its right edge is open.
        if x0 < -0.5 || y0 < -0.5 || x1 > width as f64 || y1 > height as f64 {
            return Err(MeshError::OutsideImage { zone, x0, y0, x1, y1, width, height });
        }
        Ok(Roi { x0, y0, x1, y1 })
    }
}
