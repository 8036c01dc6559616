//! What `synth`, `bench` and `devices` take.

use super::shared::Threads;
use super::words::pair;
use super::words::rectangle;
use super::words::size;
use crate::backend::choice::DeviceChoice;
use clap::Args;
use clap::Subcommand;
use clap::ValueEnum;
use std::path::PathBuf;

/// A displacement field that `quadrille synth` can make.
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

/// Arguments of `quadrille synth`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    A pair moved by a quarter pixel, noise of 2 grey levels:\n    \
    quadrille synth translation --shift 0.25,0 --noise 2 --output pair\n  \
    Twenty frames of a peeling joint, 16 bit:\n    \
    quadrille synth peel --size 1280x800 --frames 20 --bits 16 --output peel\n\n\
    Writes DIR/000000.tif (the reference), DIR/000001.tif ..., DIR/exact/NNNNNN.csv with the exact\n\
    displacement on a grid of points, and DIR/synth.json with everything that was chosen.")]
pub struct SynthArgs {
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
    #[arg(long, value_name = "ux,uy", value_parser = pair, default_value = "0.5,0.5", allow_hyphen_values = true)]
    pub shift: [f64; 2],
    /// Angle, degrees (positive from x to y).
    #[arg(long, default_value_t = 1.0, allow_hyphen_values = true)]
    pub degrees: f64,
    /// du_x/dx, du_x/dy, du_y/dx, du_y/dy.
    #[arg(long, value_name = "a,b,c,d", value_parser = rectangle, default_value = "0.01,0,0,-0.003", allow_hyphen_values = true)]
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
}

/// Arguments of `quadrille bench`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    All devices, small to large images, with a plot:\n    \
    quadrille bench --size 512,1024,2048,4096 --output bench\n  \
    The CPU against the first graphics device, as data:\n    \
    quadrille bench --device cpu,0 --json > bench.json\n  \
    A series from its files to its store, uncompressed and PNG:\n    \
    quadrille bench series --size 1024,2048\n\n\
    What the figures mean, and how far they can be trusted: docs/performance.md.")]
#[command(args_conflicts_with_subcommands = true)]
pub struct BenchArgs {
    /// Something else than single passes and images in memory.
    #[command(subcommand)]
    pub what: Option<BenchWhat>,
    /// Devices to measure: cpu, gpu, the number of an adapter, or part of its name. Default: all of this machine.
    #[arg(long, value_name = "cpu|gpu|NAME|INDEX", value_delimiter = ',')]
    pub device: Vec<DeviceChoice>,
    /// Sides of the square images, px.
    #[arg(long, value_name = "PX", value_delimiter = ',', default_values_t = [512, 1024, 2048])]
    pub size: Vec<usize>,
    /// Side of the square elements, px (4 to 128).
    #[arg(long, value_name = "PX", default_value_t = 16)]
    pub element_size: usize,
    /// Frames of the series.
    #[arg(long, value_name = "N", default_value_t = 10)]
    pub frames: usize,
    /// Repetitions of each pass, kernel and pair.
    #[arg(long, value_name = "N", default_value_t = 7)]
    pub runs: usize,
    /// Threads of the CPU path. Default: all cores.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub threads: Option<usize>,
    /// Print the figures as JSON.
    #[arg(long)]
    pub json: bool,
    /// Folder for bench.json and the plot of time against image size (PNG, SVG); an earlier one is replaced.
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
}

/// What else `quadrille bench` measures.
#[derive(Debug, Subcommand)]
pub enum BenchWhat {
    /// A whole series, from image files to the store: frames per second, the share of each stage, and how close that is to
    /// what decoding and correlation alone allow.
    Series(BenchSeriesArgs),
}

/// A format of image files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum FileFormat {
    /// TIFF without compression.
    Tiff,
    /// PNG.
    Png,
}

/// Arguments of `quadrille bench series`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  \
    quadrille bench series --size 1024,2048 --frames 100 --device cpu --threads 2\n\n\
    Makes the images, reads each once (so that they come from the page cache), measures decoding alone and\n\
    correlation alone, then runs `correlate` on the files: 8 bit, noise of one grey level, sinusoids, 0.5 % stretch and\n\
    0.2 degrees that grow over the series, default options, --export none.")]
pub struct BenchSeriesArgs {
    /// Sides of the square images, px.
    #[arg(long, value_name = "PX", value_delimiter = ',', default_values_t = [1024, 2048])]
    pub size: Vec<usize>,
    /// Formats of the files.
    #[arg(long, value_enum, value_delimiter = ',', default_values = ["tiff", "png"])]
    pub format: Vec<FileFormat>,
    /// Frames of the series.
    #[arg(long, value_name = "N", default_value_t = 100)]
    pub frames: usize,
    /// Repetitions of each measurement, alternately.
    #[arg(long, value_name = "N", default_value_t = 3)]
    pub runs: usize,
    /// Side of the square elements, px (4 to 128).
    #[arg(long, value_name = "PX", default_value_t = 16)]
    pub element_size: usize,
    /// Elements left out at each side of the image. With 0 those at the border lose pixels in every frame, which costs.
    #[arg(long, value_name = "N", default_value_t = 2)]
    pub margin: u8,
    /// Device: auto, cpu, gpu, the number of an adapter, or part of its name; or instant, which answers at once and measures nothing: what is left
    /// is the work of the host, which no graphics card makes faster.
    #[arg(long, value_name = "auto|cpu|gpu|NAME|INDEX|instant", env = "QUADRILLE_DEVICE", default_value = "auto")]
    pub device: String,
    #[command(flatten)]
    pub threads: Threads,
    /// Print the figures as JSON.
    #[arg(long)]
    pub json: bool,
    /// Where images and results are kept while it runs, such as a folder on the disk to be measured. Default: the system's
    /// folder for temporary files.
    #[arg(long, value_name = "DIR")]
    pub folder: Option<PathBuf>,
}

/// Arguments of `quadrille devices`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    What is there:\n    \
    quadrille devices\n  \
    Correlate on the second graphics adapter:\n    \
    quadrille correlate --device 1 --output out ref.tif 'frames/*.tif'\n  \
    Whether the graphics devices compute what the CPU does (exit status 1 where one does not):\n    \
    quadrille devices --check")]
pub struct DevicesArgs {
    /// Take small images through every kernel of each graphics device and compare with the CPU. The same is done by
    /// itself whenever one is used.
    #[arg(long)]
    pub check: bool,
    /// Print as JSON.
    #[arg(long)]
    pub json: bool,
}
