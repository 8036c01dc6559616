//! Meshes of four-node elements, in pixels or millimetres, and the pixels of their elements.

mod carried;
mod error;
mod grid;
mod lay;
mod mapped;
mod pixel_set;
mod pixels;
mod polygon;
mod products;
mod q4;
mod zone;

pub use carried::CarriedZones;
pub use error::MeshError;
pub use grid::{Grid, local_coordinates, shape_functions};
pub use lay::{ELEMENT_SHARE, PixelMesh};
pub use pixel_set::PixelSet;
pub use pixels::{ElementPixels, PixelMap, Run};
pub use products::mean_products;
pub use q4::Mesh;
pub use zone::{Guard, Mask, Roi, Zone, ZoneElements};
