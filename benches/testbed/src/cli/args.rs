//! What the program takes.

use super::{Result, pool};
use clap::{Args, Parser, ValueEnum};
use quadrille::backend::choice::DeviceChoice;
use quadrille::report::Look;
use rayon::ThreadPool;
use std::path::PathBuf;

/// What is measured of quadrille, and its paper done again.
#[derive(Debug, Parser)]
#[command(name = "testbed", version)]
pub enum Command {
    /// What correlation costs on the devices of this machine: single passes and images in memory.
    Devices(DevicesArgs),
    /// A whole series, from image files to the store: frames per second, the share of each stage, and how close that is
    /// to what decoding and correlation alone allow.
    Series(SeriesArgs),
    /// The numerical experiments of Fedele, Raka, Hild and Roux (2009) again: tables and figures.
    Paper(PaperArgs),
}

/// How many threads do the work.
#[derive(Debug, Clone, Copy, Default, Args)]
pub struct Threads {
    /// Threads. Default: all cores. Results do not depend on it.
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
}

impl Threads {
    /// A pool of so many threads, or of one per core.
    pub fn pool(self) -> Result<ThreadPool> {
        pool(self.threads)
    }
}

/// Arguments of `testbed devices`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    All devices, small to large images, with a plot:\n    \
    testbed devices --size 512,1024,2048,4096 --output bench\n  \
    The CPU against the first graphics device, as data:\n    \
    testbed devices --device cpu,0 --json > bench.json\n  \
    A series from its files to its store, uncompressed and PNG:\n    \
    testbed series --size 1024,2048\n\n\
    What the figures mean, and how far they can be trusted: docs/performance.md.")]
pub struct DevicesArgs {
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

/// A format of image files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum FileFormat {
    /// TIFF without compression.
    Tiff,
    /// PNG.
    Png,
}

/// Arguments of `testbed series`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  \
    testbed series --size 1024,2048 --frames 100 --device cpu --threads 2\n\n\
    Makes the images, reads each once (so that they come from the page cache), measures decoding alone and\n\
    correlation alone, then runs `correlate` on the files: 8 bit, noise of one grey level, sinusoids, 0.5 % stretch and\n\
    0.2 degrees that grow over the series, default options, --export none.")]
pub struct SeriesArgs {
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
    /// Elements left out at each side of the image. With 0 those at the border lose pixels in every frame, which
    /// costs.
    #[arg(long, value_name = "N", default_value_t = 2)]
    pub margin: u8,
    /// Device: auto, cpu, gpu, the number of an adapter, or part of its name; or instant, which answers at once and
    /// measures nothing: what is left is the work of the host, which no graphics card makes faster.
    #[arg(long, value_name = "auto|cpu|gpu|NAME|INDEX|instant", env = "QUADRILLE_DEVICE", default_value = "auto")]
    pub device: String,
    #[command(flatten)]
    pub threads: Threads,
    /// Print the figures as JSON.
    #[arg(long)]
    pub json: bool,
    /// Where images and results are kept while it runs, such as a folder on the disk to be measured. Default: the
    /// system's folder for temporary files.
    #[arg(long, value_name = "DIR")]
    pub folder: Option<PathBuf>,
}

/// Arguments of `testbed paper`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  testbed paper --output out/paper\n\n\
    It writes table-1 and table-2 as CSV, tables.md, and the figures as PNG and SVG, with their numbers as CSV.\n\n\
    Exit status: 0 all fits below 2 px of noise converged inside their bounds; 1 some did not; 2 it could not run.")]
pub struct PaperArgs {
    /// Folder for the results; made when it is not there.
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Replace the results of an earlier run in the output folder.
    #[arg(long)]
    pub overwrite: bool,
    /// Draws of the noise at each level.
    #[arg(long, value_name = "N", default_value_t = 20, allow_negative_numbers = true)]
    pub seeds: usize,
    /// Seed of the first draw, of speckles and of the noise of images.
    #[arg(long, default_value_t = 1, allow_negative_numbers = true)]
    pub seed: u64,
    #[command(flatten)]
    pub threads: Threads,
    /// What figures are made for: screen, paper or slide.
    #[arg(long, value_name = "screen|paper|slide", default_value = "screen")]
    pub style: Look,
}
