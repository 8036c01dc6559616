//! What `quadrille make` takes.

use super::shared::{Quiet, Results, Threads};
use super::words::size;
use crate::io::case::flags::numbers;
use crate::mechanics::SpecimenKind;
use crate::mechanics::cohesive::{ExtendedXuNeedleman, LAW_NAMES};
use clap::builder::PossibleValuesParser;
use clap::{Args, Subcommand, ValueEnum};
use std::path::PathBuf;

#[derive(Debug, Args)]
#[command(arg_required_else_help = true)]
#[command(after_help = "Examples:\n  \
    quadrille make images translation --shift 0.25,0 --noise 2 --output pair\n  \
    quadrille make virtual-test --output test\n  \
    quadrille make page 'folder/*.tif'")]
pub struct MakeArgs {
    #[command(subcommand)]
    pub what: Make,
}

/// What `quadrille make` makes.
#[derive(Debug, Subcommand)]
pub enum Make {
    /// Speckle images whose displacement is known exactly.
    Images(ImagesArgs),
    /// A virtual test: a computed joint that is pulled apart, its images, and the truth about it.
    VirtualTest(VirtualArgs),
    /// The mesh and the case file of a usual test (double cantilever beam, bending, peel, lap), for `simulate`.
    Specimen(SpecimenArgs),
    /// A page on which zones, cracks, gauges and a scale are drawn on the image: it writes the case file.
    Page(PageArgs),
}

/// A displacement field that `quadrille make images` can make.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Field {
    /// The same displacement everywhere (--shift).
    Translation,
    /// Rotation about the image centre (--degrees).
    Rotation,
    /// A constant gradient about the image centre (--gradient).
    Affine,
    /// u_x = A sin(2 pi x/L), u_y = A sin(2 pi y/L) (--amplitude, --wavelength).
    Sinusoids,
    /// The same with 0.5 % stretch along x and 0.2 degrees of rotation.
    Accuracy,
    /// u_y = A cos(2 pi (y - yc)/p), period p from 10 px (left) to 300 px (right) (--amplitude).
    Star,
    /// Two strips that open like a peeling joint (--opening, --slide).
    Peel,
}

/// Depth of the grey levels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Bits {
    /// 8 bit.
    #[value(name = "8")]
    Eight,
    /// 16 bit.
    #[value(name = "16")]
    Sixteen,
    /// 32-bit float.
    Float,
}

#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    A pair moved by a quarter pixel, noise of 2 grey levels:\n    \
    quadrille make images translation --shift 0.25,0 --noise 2 --output pair\n  \
    Twenty frames of a peeling joint, 16 bit:\n    \
    quadrille make images peel --size 1280x800 --frames 20 --bits 16 --output peel\n\n\
    Writes DIR/000000.tif (the reference), DIR/000001.tif ..., DIR/exact/NNNNNN.csv with the exact\n\
    displacement on a grid of points, and DIR/synth.json with everything that was chosen.")]
pub struct ImagesArgs {
    /// The displacement field of the last frame; earlier frames go part of the way.
    #[arg(value_enum)]
    pub field: Field,
    /// Folder for the images.
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Replace files of an earlier run.
    #[arg(long)]
    pub overwrite: bool,
    /// Columns and rows, px.
    #[arg(long, value_name = "WxH", default_value = "1024x1024", value_parser = size)]
    pub size: [usize; 2],
    /// Number of deformed images.
    #[arg(long, default_value_t = 1, allow_negative_numbers = true)]
    pub frames: usize,
    /// Depth of the images.
    #[arg(long, value_enum, default_value = "8")]
    pub bits: Bits,
    /// Standard deviation of the noise, grey levels of 255.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    pub noise: f32,
    /// Seed of speckles and noise.
    #[arg(long, default_value_t = 1, allow_negative_numbers = true)]
    pub seed: u64,
    /// Mean speckle size, px (2 to 32).
    #[arg(long, value_name = "PX", default_value_t = 4.5, allow_negative_numbers = true)]
    pub speckle: f64,
    /// Displacement, px.
    #[arg(long, value_name = "ux,uy", value_parser = numbers::<2>, default_value = "0.5,0.5", allow_hyphen_values = true)]
    pub shift: [f64; 2],
    /// Angle, degrees (positive from x to y).
    #[arg(long, default_value_t = 1.0, allow_hyphen_values = true)]
    pub degrees: f64,
    /// du_x/dx, du_x/dy, du_y/dx, du_y/dy.
    #[arg(long, value_name = "a,b,c,d", value_parser = numbers::<4>, default_value = "0.01,0,0,-0.003",
        allow_hyphen_values = true)]
    pub gradient: [f64; 4],
    /// Amplitude, px (default 1; star 0.5).
    #[arg(long, value_name = "PX", allow_hyphen_values = true)]
    pub amplitude: Option<f64>,
    /// Wavelength, px.
    #[arg(long, value_name = "PX", default_value_t = 256.0, allow_negative_numbers = true)]
    pub wavelength: f64,
    /// Opening at the right edge in the last frame, px.
    #[arg(long, value_name = "PX", default_value_t = 16.0, allow_negative_numbers = true)]
    pub opening: f64,
    /// Sliding in the last frame, px.
    #[arg(long, value_name = "PX", default_value_t = 2.0, allow_hyphen_values = true)]
    pub slide: f64,
    /// Distance of the points at which the exact displacement is written, px.
    #[arg(long, value_name = "PX", default_value_t = 16, allow_negative_numbers = true)]
    pub grid: usize,
    #[command(flatten)]
    pub talk: Quiet,
}

/// Depth of the images of a virtual test.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum VirtualDepth {
    /// 0 to 255.
    #[value(name = "8")]
    Eight,
    /// 0 to 65535.
    #[value(name = "16")]
    Sixteen,
}

/// How a virtual test is loaded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum VirtualMixity {
    /// Opened, with a little sliding.
    Opening,
    /// Opened and slid.
    Mixed,
    /// Slid, with a little opening.
    Sliding,
}

/// How a virtual test is computed.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum VirtualKinematics {
    /// Small rotations, the jump of the paper.
    Paper,
    /// Rotations of any size.
    Finite,
}

#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    quadrille make virtual-test --output test && quadrille run test/case.toml --output test/run\n  \
    A truth that the law of the case file does not know:\n    \
    quadrille make virtual-test --law trapezoidal-power --output other\n\n\
    It writes images/NNNNNN.png (000000 is the reference), case.toml, truth.json (parameters, hashes of the images)\n\
    and truth: mesh, displacements, border and tractions of the region that is measured.")]
pub struct VirtualArgs {
    /// Folder for the test; made when it is not there.
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Replace a test that is there.
    #[arg(long)]
    pub overwrite: bool,
    /// Law of the adhesive, with the strengths and works of separation of the default one.
    #[arg(long, value_name = "NAME", default_value = ExtendedXuNeedleman::NAME,
        value_parser = PossibleValuesParser::new(LAW_NAMES))]
    pub law: String,
    /// Images after the reference; the motion ends at the same place.
    #[arg(long, value_name = "N", default_value_t = 19, allow_negative_numbers = true)]
    pub instants: usize,
    /// Seed of speckles and noise.
    #[arg(long, default_value_t = 1, allow_negative_numbers = true)]
    pub seed: u64,
    /// Depth of the images, bits.
    #[arg(long, value_enum, default_value = "8")]
    pub depth: VirtualDepth,
    /// Standard deviation of the noise, grey levels of 255.
    #[arg(long, value_name = "S", default_value_t = 2.0, allow_negative_numbers = true)]
    pub noise: f32,
    /// How the joint is loaded: an opening and a sliding test tell together what neither tells alone.
    #[arg(long, value_enum, default_value = "mixed")]
    pub mixity: VirtualMixity,
    /// How it is computed; the case file says the same.
    #[arg(long, value_enum, default_value = "paper")]
    pub kinematics: VirtualKinematics,
    #[command(flatten)]
    pub threads: Threads,
    #[command(flatten)]
    pub talk: Quiet,
}

/// The usual tests of an adhesive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SpecimenName {
    /// Double cantilever beam: opening.
    Dcb,
    /// End-notched flexure: sliding.
    Enf,
    /// Mixed-mode bending.
    Mmb,
    /// A thin arm peeled off a thick adherend.
    Peel,
    /// Single lap joint.
    Lap,
}

impl SpecimenName {
    /// What it is for the mechanics.
    pub fn kind(self) -> SpecimenKind {
        match self {
            Self::Dcb => SpecimenKind::Dcb,
            Self::Enf => SpecimenKind::Enf,
            Self::Mmb => SpecimenKind::Mmb,
            Self::Peel => SpecimenKind::Peel,
            Self::Lap => SpecimenKind::Lap,
        }
    }
}

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  \
    quadrille make specimen dcb --output dcb && quadrille simulate dcb/case.toml --output dcb/out\n  \
    Its images and loads, to be correlated and reduced:\n    \
    quadrille make specimen dcb --images dcb/out --output test\n\n\
    It writes mesh.json and case.toml, whose comments explain every line.")]
pub struct SpecimenArgs {
    /// The test.
    #[arg(value_enum)]
    pub kind: SpecimenName,
    #[command(flatten)]
    pub results: Results,
    /// Length of the specimen, mm; of enf and mmb the span, of lap the free length of each adherend.
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub length: Option<f64>,
    /// Length of the crack, mm; of lap the overlap.
    #[arg(long = "crack", value_name = "MM", allow_negative_numbers = true)]
    pub crack_length: Option<f64>,
    /// Thickness of the arms, mm.
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub arm: Option<f64>,
    /// Thickness of the lower arm, mm, where it is another.
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub lower_arm: Option<f64>,
    /// Thickness of the adhesive, mm.
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub adhesive: Option<f64>,
    /// Length of the elements along the joint, mm, at most.
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub element: Option<f64>,
    /// Rows of elements in each arm.
    #[arg(long, value_name = "N")]
    pub rows: Option<usize>,
    /// Displacement at the last instant, mm.
    #[arg(long = "opening", value_name = "MM", allow_negative_numbers = true)]
    pub last_opening: Option<f64>,
    /// Number of instants.
    #[arg(long, value_name = "N")]
    pub instants: Option<usize>,
    /// Of mmb: from the middle of the span to the load on the lever, mm.
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub lever: Option<f64>,
    /// Take images of what `simulate` has computed of this specimen, in this folder: with the same options, loads and a
    /// case for `correlate` and `reduce`. Not of peel.
    #[arg(long, value_name = "DIR")]
    pub images: Option<PathBuf>,
    #[command(flatten)]
    pub talk: Quiet,
}

#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    Draw on the first image of a folder; the case file is for all of them:\n    \
    quadrille make page 'folder/*.tif'\n  \
    A reference of its own, and the page elsewhere:\n    \
    quadrille make page --output zones.html ref.tif 'frames/*.tif'\n\n\
    The page is one file, fetches nothing and works without a network. Save its case.toml beside this command, then\n  \
    quadrille correlate --case case.toml --output out\n\n\
    Exit status: 0 fine; 2 the image cannot be read, or the page cannot be written.")]
pub struct PageArgs {
    /// The reference image, then the deformed ones: names or globs, as for `quadrille correlate`. With a single glob
    /// its first image is the reference.
    #[arg(value_name = "IMAGE", required = true)]
    pub images: Vec<String>,
    /// A case file to continue: the page begins with its zones, cracks and gauges.
    #[arg(long, value_name = "FILE")]
    pub case: Option<PathBuf>,
    /// Page of a TIFF file with several pages, from 0.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub page: usize,
    /// The file.
    #[arg(short, long, value_name = "FILE", default_value = "draw.html")]
    pub output: PathBuf,
    #[command(flatten)]
    pub talk: Quiet,
}
