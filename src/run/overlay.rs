//! What overlays a case.

use super::shard::Shard;
use crate::backend::choice::DeviceChoice;
use crate::backend::gpu::GpuOptions;
use crate::field::{
    Brightness, Elements, Noise, NoiseCorrelation, RegularisationKind, StartFrom, StrainDefinition, UpdateReference,
};
use crate::imaging::Interpolation;
use crate::io::case::{CrackPath, Pages};
use std::path::PathBuf;

/// A table of values per frame that is written beside the store.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Export {
    /// `csv/NNNNNN.csv`: one row per measured node.
    Csv,
    /// `vtu/NNNNNN.vtu` and `series.pvd` for ParaView.
    Vtu,
    /// Nothing beside `run.toml`, `summary.json` and `fields.zarr`.
    None,
}

impl Export {
    /// The one of this name in `run.toml`.
    pub fn named(name: &str) -> Option<Self> {
        match name {
            "csv" => Some(Self::Csv),
            "vtu" => Some(Self::Vtu),
            "none" => Some(Self::None),
            _ => None,
        }
    }
}

/// What overlays a case: everything given here wins over what the case says, as the flags of `quadrille correlate` do. The default
/// changes nothing.
#[derive(Debug, Clone, Default)]
pub struct Overlay {
    /// Files or globs of the reference, from the current folder; of several the mean is taken.
    pub reference: Vec<String>,
    /// Files or globs of the deformed images, from the current folder.
    pub deformed: Vec<String>,
    /// Page of multi-page files, from 0.
    pub page: Option<u32>,
    /// Whether every page of a file is a frame.
    pub pages: Option<Pages>,
    /// Millimetres per pixel.
    pub pixel_size: Option<f64>,
    /// The most pixels of an image, in millions.
    pub max_image_mpx: Option<u32>,
    /// The share of the frames that this process does.
    pub shard: Option<Shard>,
    /// Rectangles to measure, px: left, top, right, bottom; with polygons, mask and mesh they replace the zones of the case.
    pub roi: Vec<[f64; 4]>,
    /// Polygons to measure, px.
    pub polygon: Vec<Vec<[f64; 2]>>,
    /// An image that is white where it is measured.
    pub mask: Option<PathBuf>,
    /// A mesh file in px of the reference.
    pub mesh: Option<PathBuf>,
    /// Pixels this close to the border of a zone are left out, px.
    pub guard: Option<f64>,
    /// Paths along which the mesh is cut, px, or that they are to be found; they replace the cracks of the case.
    pub crack: Vec<CrackPath>,
    /// Pixels this close to a crack are left out, px.
    pub crack_guard: Option<f64>,
    /// Young's modulus around the cracks, MPa.
    pub crack_young: Option<f64>,
    /// Poisson's ratio around the cracks.
    pub crack_poisson: Option<f64>,
    /// Outer radius of the domain of the interaction integral, px.
    pub crack_radius: Option<f64>,
    /// Least share of an element's pixels inside a zone.
    pub element_share: Option<f64>,
    /// Side of the elements, px.
    pub element_size: Option<i64>,
    /// What the displacement is between the nodes.
    pub elements: Option<Elements>,
    /// Interpolation between pixels.
    pub interpolation: Option<Interpolation>,
    /// Error of the iteration that may be left when a frame counts as converged, px.
    pub tolerance: Option<f64>,
    /// Iterations after which a frame is given up.
    pub max_iterations: Option<u32>,
    /// How brightness and contrast are followed.
    pub brightness: Option<Brightness>,
    /// Where frames start from.
    pub start: Option<StartFrom>,
    /// When the reference is renewed.
    pub update_reference: Option<UpdateReference>,
    /// The camera noise.
    pub noise: Option<Noise>,
    /// Noise that is correlated from pixel to pixel.
    pub noise_correlation: Option<NoiseCorrelation>,
    /// What holds the displacement.
    pub regularisation: Option<RegularisationKind>,
    /// Cut-off length of the regularisation, px.
    pub cutoff: Option<f64>,
    /// Whether any number of nodes without texture is left out.
    pub drop_textureless: bool,
    /// Tables beside the store.
    pub export: Option<Vec<Export>>,
    /// Definition of the strains.
    pub strain: Option<StrainDefinition>,
    /// Nodes along a side of the window of further strains; 1 for none.
    pub strain_window: Option<u32>,
    /// Whether the report is left out.
    pub no_report: bool,
    /// Where the pixel work is done.
    pub device: DeviceChoice,
    /// How a graphics device is opened.
    pub gpu: GpuOptions,
    /// Instruction path of the CPU by its name.
    pub isa: Option<String>,
}
