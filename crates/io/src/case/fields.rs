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
use std::str::FromStr;

/// Which images.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(next_help_heading = "Input"))]
#[serde(deny_unknown_fields)]
pub struct CaseImages {
    /// The reference image; of several the mean is taken. A name or glob, or several of them. Without it the first of
    /// the deformed images.
    #[serde(
        default,
        skip_serializing_if = "Option::is_none",
        deserialize_with = "one_or_more",
        serialize_with = "one_or_list"
    )]
    #[schemars(with = "Option<OneOrMore>")]
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    pub reference: Option<Vec<String>>,
    /// The deformed images: names or quoted globs. The files of a glob are taken in natural order, img_2 before
    /// img_10. Without a reference the first of them is the reference.
    #[serde(default, deserialize_with = "one_or_more")]
    #[schemars(with = "Option<OneOrMore>")]
    #[cfg_attr(feature = "cli", arg(value_name = "DEFORMED", help_heading = None::<&str>))]
    pub deformed: Option<Vec<String>>,
    /// Page of TIFF files with several pages, from 0. Where all pages are frames, that of the reference.
    #[schemars(extend("default" = 0))]
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", allow_negative_numbers = true, hide_short_help = true))]
    pub page: Option<u32>,
    /// Whether every page of the deformed files is a frame. Without it one page; every page of one file alone.
    #[cfg_attr(feature = "cli", arg(long, value_name = "all", hide_short_help = true))]
    pub pages: Option<Pages>,
    /// Size of a pixel on the specimen, mm: adds columns in mm. `quadrille run` needs it.
    #[cfg_attr(
        feature = "cli",
        arg(long = "pixel-size", value_name = "MM", allow_hyphen_values = true, help_heading = "Output")
    )]
    pub pixel_size_mm: Option<f64>,
    /// The most pixels of an image, in millions, up to 2147: a file whose header claims more is not unpacked.
    #[schemars(extend("default" = 1000))]
    #[cfg_attr(feature = "cli", arg(long, value_name = "MPX", hide_short_help = true))]
    pub max_image_mpx: Option<u32>,
}

/// Which pages of a file are frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Pages {
    /// Every page.
    All,
}

impl FromStr for Pages {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "all" => Ok(Self::All),
            other => Err(format!("'{other}' is not 'all'; a single page is --page")),
        }
    }
}

/// How to correlate.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(next_help_heading = "Correlation"))]
#[serde(deny_unknown_fields)]
pub struct CaseCorrelation {
    /// Side of the square elements, px, 4 to 128. Smaller: finer detail and more noise.
    #[schemars(extend("default" = 16))]
    #[cfg_attr(
        feature = "cli",
        arg(long = "element-size", value_name = "PX", value_parser = element_size, allow_hyphen_values = true)
    )]
    pub element_size_px: Option<u32>,
    /// What the displacement is between the nodes: bilinear in each element, or (experimental) a bicubic spline with
    /// knots one element size apart, kept at nodes half as far apart (docs/correlation.md, 2.9.1); on regular
    /// meshes, without regularisation.
    #[schemars(extend("default" = "bilinear", "x-implied" = true))]
    #[cfg_attr(feature = "cli", arg(long, value_name = "bilinear|cubic-spline", hide_short_help = true))]
    pub elements: Option<Elements>,
    /// Share of its pixels that an element of a polygon or a mask must have inside, to be kept; above 0, up to 1.
    #[schemars(extend("default" = 0.5))]
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "S", allow_hyphen_values = true, hide_short_help = true, help_heading = "Zones")
    )]
    pub element_share: Option<f64>,
    /// Between pixels: quintic, cubic, keys, bilinear. How grey levels of the deformed image are interpolated; cubic
    /// takes a tenth less time than quintic, and has 3 to 20 times its bias.
    #[schemars(extend("default" = "quintic"))]
    #[cfg_attr(feature = "cli", arg(long, value_name = "NAME"))]
    pub interpolation: Option<Interpolation>,
    /// Error of the iteration that may be left when a frame counts as converged, px, up to 1.
    #[schemars(extend("default" = 1e-4))]
    #[cfg_attr(
        feature = "cli",
        arg(long = "tolerance", value_name = "PX", allow_hyphen_values = true, hide_short_help = true)
    )]
    pub tolerance_px: Option<f64>,
    /// Iterations on the image itself after which a frame is given up, from 1. Coarser scales have limits of their
    /// own.
    #[schemars(extend("default" = 50))]
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", allow_negative_numbers = true, hide_short_help = true))]
    pub max_iterations: Option<u32>,
    /// Light that changes: auto, zone, smooth, element, off. Brightness and contrast are followed by one gain and
    /// offset per zone (zone), as fields over a zone for gradients of light and moving shadows (smooth), so only
    /// in frames where that lowers the residual significantly (auto), by each element (element), or not at all
    /// (off). docs/correlation.md, 2.4.
    #[schemars(extend("default" = "auto"))]
    #[cfg_attr(feature = "cli", arg(long, value_name = "auto|zone|smooth|element|off"))]
    pub brightness: Option<Brightness>,
    /// Start of a frame: previous, or independent. It is extrapolated from the frames before it, or searched for on
    /// its own; frames may then be done in any order. With --shard the default is independent.
    #[schemars(extend("default" = "previous"))]
    #[cfg_attr(feature = "cli", arg(long, value_name = "previous|independent"))]
    pub start: Option<StartFrom>,
    /// Large deformation: residual, every N, or never. Whether a frame of the series becomes the reference of those
    /// that follow (docs/correlation.md, 2.10): when the present one matches badly, or after every N frames.
    /// Fields stay those of the first reference. Needs frames that start from the previous one, and one process.
    #[schemars(extend("default" = "never"))]
    #[cfg_attr(feature = "cli", arg(long, value_name = "residual|every N|never", allow_hyphen_values = true))]
    pub update_reference: Option<UpdateReference>,
    /// Noise of the camera: grey levels, or photon. A number is the standard deviation of one image. A variance A + B
    /// times the grey level, as `metrology` finds it, is `photon:A,B` as a flag and `{ a = A, b = B }` in a file;
    /// `photon` finds both on each frame's residual. `residual` finds one standard deviation for each zone and
    /// frame.
    #[schemars(extend("default" = "residual", "x-implied" = true))]
    #[cfg_attr(feature = "cli", arg(long, value_name = "S|photon|photon:A,B", allow_hyphen_values = true))]
    pub noise: Option<Noise>,
    /// Noise that is correlated from pixel to pixel (demosaicing, smoothing in the camera, noise of rows): `auto`
    /// finds on the residual by how much it raises the standard uncertainty, and says so; a number, 0.1 to 100, is
    /// that factor, as `metrology` finds it; `off` takes noise for white.
    #[schemars(extend("default" = "auto", "x-implied" = true))]
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "auto|off|F", allow_hyphen_values = true, hide_short_help = true)
    )]
    pub noise_correlation: Option<NoiseCorrelation>,
    /// Hold the field: tikhonov, or equilibrium-gap. Small gradients of the displacement, or an elastic plate; needs a
    /// cut-off length. Nodes without texture are then carried by those around them.
    #[schemars(extend("default" = "none"))]
    #[cfg_attr(feature = "cli", arg(long, value_name = "none|tikhonov|equilibrium-gap"))]
    pub regularisation: Option<RegularisationKind>,
    /// Cut-off length of the regularisation, px, up to 1000 elements: waves of the displacement as long as this lose
    /// half of their amplitude, longer ones less, shorter ones more.
    #[cfg_attr(feature = "cli", arg(long = "cutoff", value_name = "PX", allow_hyphen_values = true))]
    pub cutoff_px: Option<f64>,
    /// Poisson's ratio in the equilibrium gap, above -1, up to 0.5.
    #[schemars(extend("default" = 0.33, "x-implied" = true))]
    #[cfg_attr(feature = "cli", arg(skip))]
    pub poisson: Option<f64>,
    /// Strains: infinitesimal, green-lagrange, hencky. Their definition.
    #[schemars(extend("default" = "green-lagrange"))]
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "infinitesimal|green-lagrange|hencky", help_heading = "Output")
    )]
    pub strain: Option<StrainDefinition>,
    /// Strains over a window of N x N nodes as well, N odd, 3 to 51, with their standard uncertainty: a virtual strain
    /// gauge of N elements (docs/correlation.md, 2.11), (N - 1) L_step + L_subset with the element size for both. 1:
    /// those of elements and nodes alone.
    #[schemars(extend("default" = 1, "x-implied" = true))]
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", allow_negative_numbers = true, help_heading = "Output"))]
    pub strain_window: Option<u32>,
    /// Nodes whose displacement would be less certain than this are left out, px, up to 100: a standard uncertainty, by
    /// the noise and the texture of the reference.
    #[schemars(extend("default" = 0.5))]
    #[cfg_attr(
        feature = "cli",
        arg(
            long = "sigma-most",
            value_name = "PX",
            allow_hyphen_values = true,
            hide_short_help = true,
            help_heading = "Zones"
        )
    )]
    pub sigma_most_px: Option<f64>,
    /// Leave out nodes that see no texture, however many, instead of refusing the reference. Without it up to a fifth
    /// of a zone is left out, none of them on a face of a joint.
    #[schemars(extend("default" = false))]
    #[cfg_attr(
        feature = "cli",
        arg(long, action = clap::ArgAction::SetTrue, hide_short_help = true, help_heading = "Zones")
    )]
    pub drop_textureless: Option<bool>,
}

/// A size of elements, px; one that cannot be is refused as the mesh refuses it.
#[cfg(feature = "cli")]
fn element_size(text: &str) -> Result<u32, Box<dyn std::error::Error + Send + Sync>> {
    let size: i64 = text.parse()?;
    u32::try_from(size)
        .map_err(|_| format!("the element size is {size} px; choose 4 to 128 px (16 is a good start)").into())
}

/// A zone of the reference image: what lies in all of rectangle, polygon and mask, and in no excluded polygon. One of
/// `roi`, `polygon`, `exclude`, `mask`, `mesh` at least; without a zone the specimen is found in the reference.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(next_help_heading = "Zones"))]
#[serde(deny_unknown_fields)]
pub struct CaseZone {
    /// Its name, in every output; names must differ. Without it `zone1`, `zone2`, ...
    #[serde(default, deserialize_with = "name")]
    #[cfg_attr(feature = "cli", arg(skip))]
    pub name: Option<String>,
    /// Its rectangle `[x0, y0, x1, y1]`, px of the reference image, may be fractional; `x1` and `y1` are not included.
    #[serde(default, deserialize_with = "four_numbers")]
    #[cfg_attr(feature = "cli", arg(skip))]
    pub roi: Option<[f64; 4]>,
    /// Corners `[[x, y], ...]` of its polygon, px, in order.
    #[serde(default, deserialize_with = "polygon")]
    #[cfg_attr(feature = "cli", arg(skip))]
    pub polygon: Option<Vec<[f64; 2]>>,
    /// Polygons that are cut out, `[[[x, y], ...], ...]`, px.
    #[serde(default, deserialize_with = "polygons")]
    #[cfg_attr(feature = "cli", arg(skip))]
    pub exclude: Option<Vec<Vec<[f64; 2]>>>,
    /// A mask: an image, white where it is measured. It has the size of the reference. The flag holds for every zone;
    /// alone it makes one zone.
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    pub mask: Option<String>,
    /// A mesh to measure with, .msh or .vtu. Its own instead of a grid: quadrilaterals and triangles, in px of the
    /// reference (y down). Each of its groups is a zone.
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    pub mesh: Option<String>,
    /// The one group of the mesh file that is taken; without it every group is a zone.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub group: Option<String>,
    /// Elements other than those of a grid of squares on its polygon.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub elements: Option<CaseElements>,
    /// Pixels left out near the border of a zone, px. The mesh still reaches the border; 3 next to bands without
    /// texture. A number; in a file also `{ left = 0, top = 0, right = 0, bottom = 3 }` of a `roi`; a list with
    /// one for each side of a polygon (side k from corner k to the next); `{ along = [[x, y], ...], width = 3 }`
    /// along a line alone.
    #[schemars(extend("default" = 0))]
    #[cfg_attr(feature = "cli", arg(long = "guard", value_name = "PX", allow_hyphen_values = true))]
    pub guard_px: Option<CaseGuard>,
    /// Its coordinates, also those of its mesh file, are mm in the plane of the specimen with y up, as in a drawing:
    /// `{ origin_px = [x, y], turn_deg = 0 }` says where their origin is seen in the reference image, and by how much
    /// their x axis is turned from that of the image towards up. The camera is taken into account. Guards stay in px.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub in_mm: Option<CaseInMm>,
}

/// Where the coordinates of a drawing are seen.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseInMm {
    /// Pixel of the origin.
    pub origin_px: [f64; 2],
    /// Angle of the x axis from that of the image towards up, degrees.
    #[serde(default)]
    pub turn_deg: f64,
}

/// Zones as flags give them: several rectangles and polygons, and what holds for all of them.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(next_help_heading = "Zones"))]
pub struct ZoneFlags {
    /// A rectangle to measure, px; may be repeated. Left, top, right, bottom (the last two not included). Without any
    /// zone the specimen is found in the reference. This, --polygon, --mask and --mesh replace the zones of the
    /// case file.
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "x0,y0,x1,y1", value_parser = super::flags::numbers::<4>, allow_hyphen_values = true)
    )]
    pub roi: Vec<[f64; 4]>,
    /// A polygon to measure, px; may be repeated. Its corners in order, separated by blanks.
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "'x,y x,y x,y ...'", value_parser = super::flags::polygon, allow_hyphen_values = true)
    )]
    pub polygon: Vec<Polygon>,
    /// Mask, mesh and guard.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub all: CaseZone,
}

/// Corners of a polygon, px.
pub type Polygon = Vec<[f64; 2]>;

/// How the elements of a zone are laid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum CaseElements {
    /// Along the sides of its polygon, of four corners and convex: about as large as the element size, with nodes on
    /// every side.
    Mapped,
}

impl CaseZone {
    /// Its name in every output, as the zone number `at` (0 the first).
    pub fn name_at(&self, at: usize) -> String {
        self.name.clone().unwrap_or_else(|| format!("zone{}", at + 1))
    }

    /// The rectangle, when the file gives one.
    pub fn rectangle(&self) -> Option<Roi> {
        self.roi.map(|[x0, y0, x1, y1]| Roi { x0, y0, x1, y1 })
    }
}
