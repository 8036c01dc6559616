//! The sections of a correlation: images, options, zones.

use super::guard::CaseGuard;
use super::lists::{OneOrMore, four_numbers, name, one_or_list, one_or_more, polygon, polygons};
use crate::field::{
    Brightness, Elements, Noise, NoiseCorrelation, RegularisationKind, StartFrom, StrainDefinition, UpdateReference,
};
use crate::imaging::Interpolation;
use crate::mesh::Roi;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Which images.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseImages {
    /// The reference image, or several whose mean is taken: a name or glob, or a list of them. Without it the first of
    /// `deformed`.
    #[serde(
        default,
        skip_serializing_if = "Option::is_none",
        deserialize_with = "one_or_more",
        serialize_with = "one_or_list"
    )]
    #[schemars(with = "Option<OneOrMore>", extend("x-flag" = "--reference"))]
    pub reference: Option<Vec<String>>,
    /// The deformed images: a name or glob, or a list of them.
    #[serde(default, deserialize_with = "one_or_more")]
    #[schemars(with = "Option<OneOrMore>", extend("x-flag" = "DEFORMED..."))]
    pub deformed: Option<Vec<String>>,
    /// Page of TIFF files with several pages, from 0; with `pages` that of the reference.
    #[schemars(extend("default" = 0, "x-flag" = "--page"))]
    pub page: Option<u32>,
    /// Whether every page of the deformed files is a frame. Without it one page; every page of one file alone.
    #[schemars(extend("x-flag" = "--pages"))]
    pub pages: Option<Pages>,
    /// Size of a pixel on the specimen, mm; adds columns in mm. `quadrille run` needs it.
    #[schemars(extend("x-flag" = "--pixel-size"))]
    pub pixel_size_mm: Option<f64>,
    /// The most pixels of an image, in millions, up to 2147: a file whose header claims more is not unpacked.
    #[schemars(extend("default" = 1000, "x-flag" = "--max-image-mpx"))]
    pub max_image_mpx: Option<u32>,
}

/// Which pages of a file are frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Pages {
    /// Every page.
    All,
}

/// How to correlate.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseCorrelation {
    /// Side of the elements, px, 4 to 128.
    #[schemars(extend("default" = 16, "x-flag" = "--element-size"))]
    pub element_size_px: Option<u32>,
    /// What the displacement is between the nodes: bilinear in each element, or (experimental) a bicubic spline with knots one element size apart, kept at
    /// nodes half as far apart (docs/correlation.md, 2.9.1); on regular meshes, without regularisation.
    #[schemars(extend("default" = "bilinear", "x-flag" = "--elements"))]
    pub elements: Option<Elements>,
    /// Share of its pixels that an element of a polygon or a mask must have inside, to be kept; above 0, up to 1.
    #[schemars(extend("default" = 0.5, "x-flag" = "--element-share"))]
    pub element_share: Option<f64>,
    /// Sub-pixel interpolation of the deformed image.
    #[schemars(extend("default" = "cubic", "x-flag" = "--interpolation"))]
    pub interpolation: Option<Interpolation>,
    /// Error of the iteration that may be left when a frame counts as converged, px, up to 1.
    #[schemars(extend("default" = 1e-4, "x-flag" = "--tolerance"))]
    pub tolerance_px: Option<f64>,
    /// Largest number of iterations of a frame on the image itself, from 1 (coarser scales have limits of their own).
    #[schemars(extend("default" = 50, "x-flag" = "--max-iterations"))]
    pub max_iterations: Option<u32>,
    /// Gain and offset of the grey levels: one for a zone, smooth fields over it, so only where that lowers the residual
    /// significantly, for each element, none (docs/correlation.md, 2.4).
    #[schemars(extend("default" = "auto", "x-flag" = "--brightness"))]
    pub brightness: Option<Brightness>,
    /// Where the correlation of a frame starts: extrapolated from the frames before it, or searched for on its own (frames
    /// may then be done in any order). With --shard the default is `independent`.
    #[schemars(extend("default" = "previous", "x-flag" = "--start"))]
    pub start: Option<StartFrom>,
    /// When a frame becomes the reference of those that follow (docs/correlation.md, 2.10): when the present one matches
    /// badly, after every N frames, never. Needs `start = "previous"` and one process.
    #[schemars(extend("default" = "never", "x-flag" = "--update-reference"))]
    pub update_reference: Option<UpdateReference>,
    /// Noise of one image: its standard deviation, grey levels; `{ a = A, b = B }`, variance A + B times the grey level;
    /// `"photon"`, the same estimated on each frame; `"residual"`, estimated for each zone and frame.
    #[schemars(extend("default" = "residual", "x-flag" = "--noise"))]
    pub noise: Option<Noise>,
    /// Factor on sigma for noise that is correlated from pixel to pixel, 0.1 to 100: `"auto"` finds it on the residual,
    /// `"off"` takes noise for white.
    #[schemars(extend("default" = "auto", "x-flag" = "--noise-correlation"))]
    pub noise_correlation: Option<NoiseCorrelation>,
    /// What the displacement is held by beside the images.
    #[schemars(extend("default" = "none", "x-flag" = "--regularisation"))]
    pub regularisation: Option<RegularisationKind>,
    /// Cut-off length of the regularisation, px, up to 1000 elements: a wave this long loses half of its amplitude. A
    /// regularisation needs it.
    #[schemars(extend("x-flag" = "--cutoff"))]
    pub cutoff_px: Option<f64>,
    /// Poisson's ratio in the equilibrium gap, above -1, up to 0.5.
    #[schemars(extend("default" = 0.33))]
    pub poisson: Option<f64>,
    /// Definition of the strains.
    #[schemars(extend("default" = "green-lagrange", "x-flag" = "--strain"))]
    pub strain: Option<StrainDefinition>,
    /// Strains over a window of this many nodes along a side, odd, 3 to 51, beside those of elements and nodes: a virtual
    /// strain gauge of so many elements (docs/correlation.md, 2.11); 1: none.
    #[schemars(extend("default" = 1, "x-flag" = "--strain-window"))]
    pub strain_window: Option<u32>,
    /// Whether nodes without texture are left out, however many; if not, at most a fifth of a zone are, none on the face of a
    /// joint.
    #[schemars(extend("default" = false, "x-flag" = "--drop-textureless"))]
    pub drop_textureless: Option<bool>,
}

/// A zone of the reference image: what lies in all of rectangle, polygon and mask, and in no excluded polygon. One of
/// `roi`, `polygon`, `exclude`, `mask`, `mesh` at least; without a zone the specimen is found in the reference.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseZone {
    /// Its name, in every output; names must differ. Without it `zone1`, `zone2`, ...
    #[serde(default, deserialize_with = "name")]
    pub name: Option<String>,
    /// Its rectangle `[x0, y0, x1, y1]`, px of the reference image, may be fractional; `x1` and `y1` are not included.
    #[serde(default, deserialize_with = "four_numbers")]
    #[schemars(extend("x-flag" = "--roi"))]
    pub roi: Option<[f64; 4]>,
    /// Corners `[[x, y], ...]` of its polygon, px, in order.
    #[serde(default, deserialize_with = "polygon")]
    #[schemars(extend("x-flag" = "--polygon"))]
    pub polygon: Option<Vec<[f64; 2]>>,
    /// Polygons that are cut out, `[[[x, y], ...], ...]`, px.
    #[serde(default, deserialize_with = "polygons")]
    pub exclude: Option<Vec<Vec<[f64; 2]>>>,
    /// A mask: an image file of the size of the reference, white where it is measured.
    #[schemars(extend("x-flag" = "--mask"))]
    pub mask: Option<String>,
    /// A mesh of its own instead of a grid: a `.msh` or `.vtu` file with positions in px.
    #[schemars(extend("x-flag" = "--mesh"))]
    pub mesh: Option<String>,
    /// The one group of the mesh file that is taken; without it every group is a zone.
    pub group: Option<String>,
    /// Elements other than those of a grid of squares on its polygon.
    pub elements: Option<CaseElements>,
    /// Pixels this close to its border are left out of all sums, px, while the mesh still reaches it: a number; `{ left = 0,
    /// top = 0, right = 0, bottom = 3 }` of a `roi`; a list with one for each side of a polygon (side k from corner k to the
    /// next); `{ along = [[x, y], ...], width = 3 }` along a line alone.
    #[schemars(extend("default" = 0, "x-flag" = "--guard"))]
    pub guard_px: Option<CaseGuard>,
}

/// How the elements of a zone are laid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum CaseElements {
    /// Along the sides of its polygon, of four corners and convex: about as large as the element size, with nodes on every side.
    Mapped,
}

impl CaseZone {
    /// The rectangle, when the file gives one.
    pub fn rectangle(&self) -> Option<Roi> {
        self.roi.map(|[x0, y0, x1, y1]| Roi { x0, y0, x1, y1 })
    }
}
