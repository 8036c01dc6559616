//! Meshes of four-node elements, in pixels or millimetres, and the pixels of their elements.

mod carried;
mod cells;
mod crack;
mod element;
mod error;
mod grid;
mod lay;
mod mapped;
mod neighbours;
mod pixel_set;
mod pixels;
mod points;
mod polygon;
mod q4;
mod zone;
mod zone_pixels;

pub use carried::CarriedZones;
pub use cells::PointCells;
pub use crack::{CutFaces, CutTip, FacePoint, point_along, project};
pub(crate) use element::corners_of;
pub use element::{
    CORNERS, ElementGeometry, GAUSS, GAUSS_POINTS, GAUSS_WEIGHT, InverseMap, LocalMap, local_coordinates,
    local_derivatives, mean_products, shape_functions,
};
pub use error::MeshError;
pub use grid::Grid;
pub use lay::{ELEMENT_SHARE, PixelMesh};
pub use neighbours::Neighbours;
pub use pixel_set::PixelSet;
pub use pixels::{ElementPixels, PixelMap, Run};
pub use points::elements_of_points;
pub use q4::Mesh;
pub use zone::{Crack, Guard, Mask, Roi, Zone, ZoneElements};
