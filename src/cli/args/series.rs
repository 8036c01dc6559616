//! What `correlate`, `watch`, `slurm` and `status` take.

use super::fields::Target;
use super::shared::Threads;
use super::words::Polygon;
use super::words::interpolation;
use super::words::pages;
use super::words::path;
use super::words::polygon;
use super::words::rectangle;
use super::words::sbatch_option;
use super::words::seconds;
use super::words::slurm_time;
use super::words::slurm_word;
use crate::backend::choice::DeviceChoice;
use crate::cli::frames::Frames;
use crate::field::Brightness;
use crate::field::Elements;
use crate::field::Noise;
use crate::field::NoiseCorrelation;
use crate::field::RegularisationKind;
use crate::field::StartFrom;
use crate::field::StrainDefinition;
use crate::field::UpdateReference;
use crate::imaging::Interpolation;
use crate::io::case::CrackPath;
use crate::io::case::Pages;
use crate::run::Shard;
use clap::ArgAction;
use clap::Args;
use clap::ValueEnum;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::time::Duration;

/// A table of values per frame that is written beside the store.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Export {
    /// DIR/csv/NNNNNN.csv: one row per measured node.
    Csv,
    /// DIR/vtu/NNNNNN.vtu and DIR/series.pvd for ParaView.
    Vtu,
    /// Nothing beside run.toml, summary.json and fields.zarr.
    None,
}

impl From<Export> for crate::run::Export {
    fn from(table: Export) -> Self {
        match table {
            Export::Csv => Self::Csv,
            Export::Vtu => Self::Vtu,
            Export::None => Self::None,
        }
    }
}

/// Arguments of `quadrille correlate`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    Whole image, first file is the reference:\n    \
    quadrille correlate --output out ref.tif 'frames/*.tif'\n  \
    Two strips on either side of an adhesive, 32 px elements, scale 1.93 um per pixel:\n    \
    quadrille correlate --reference ref.tif --roi 10,10,1010,400 --roi 10,440,1010,830 \\\n      \
    --element-size 32 --pixel-size 0.00193 --output out 'frames/*.tif'\n  \
    The same from a file, with another element size:\n    \
    quadrille correlate --case joint.toml --element-size 24 --output out24\n  \
    Where a mask is white, the mean of several images as the reference, one frame per page:\n    \
    quadrille correlate --mask mask.png --reference 'static_*.tif' --output out stack.tif\n  \
    A specimen that necks or turns far: the reference is renewed when it no longer matches:\n    \
    quadrille correlate --update-reference residual --output out ref.tif 'frames/*.tif'\n  \
    Search for a crack, its opening and its tip:\n    \
    quadrille correlate --crack auto --output out ref.tif 'frames/*.tif'\n\n\
    Half of a long series on each of two machines that share a disk:\n    \
    quadrille correlate --case long.toml --shard 1/2 --output out      (and 2/2 on the other)\n\n\
    With the noise that `quadrille metrology ref.tif 'static_*.tif'` found: photon noise, and a factor for a demosaiced image:\n    \
    quadrille correlate --noise photon:1.2,0.04 --noise-correlation 1.6 --output out ref.tif 'frames/*.tif'\n\n\
    A run that was stopped goes on when the same command is given again.\n\n\
    Exit status: 0 all frames converged; 1 some frame did not (see DIR/summary.json); 2 nothing could be run; 130 stopped \
    by Ctrl-C or SIGTERM.")]
pub struct CorrelateArgs {
    /// Deformed images: files or quoted globs, taken in natural order (img_2 before img_10). Without
    /// --reference the first one is the reference.
    #[arg(value_name = "DEFORMED")]
    pub deformed: Vec<String>,
    /// The reference image: a file. Repeat it or quote a glob to take the mean of several images.
    #[arg(long, value_name = "FILE")]
    pub reference: Vec<String>,
    /// A case file (TOML) that says the same as these flags; flags win.
    #[arg(long, value_name = "FILE")]
    pub case: Option<PathBuf>,
    /// Folder for the results; made when it is not there.
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Replace the results of an earlier run in the output folder.
    #[arg(long, conflicts_with_all = ["resume", "shard"])]
    pub overwrite: bool,
    /// Continue the run in the output folder: do what is missing. This is the default; a run with other options
    /// or images is refused.
    #[arg(long)]
    pub resume: bool,
    /// Do this share of the frames only: I of N processes that write into one folder, frames I, I+N, I+2N, ... `slurm`
    /// takes the place of the task in its array. Needs --start independent, which is then the default.
    #[arg(long, value_name = "I/N|slurm")]
    pub shard: Option<Shard>,
    /// A rectangle to measure, px: left, top, right, bottom (the last two not included). Repeat it for
    /// several zones. Without any zone the specimen is found in the reference. This, --polygon, --mask and --mesh replace the zones of the
    /// case file.
    #[arg(long, value_name = "x0,y0,x1,y1", value_parser = rectangle, allow_hyphen_values = true)]
    pub roi: Vec<[f64; 4]>,
    /// A polygon to measure, px: its corners in order, separated by blanks. Repeat it for several zones.
    #[arg(long, value_name = "'x,y x,y x,y ...'", value_parser = polygon, allow_hyphen_values = true)]
    pub polygon: Vec<Polygon>,
    /// An image of the reference's size that is white where it is measured. Goes with --roi and --polygon;
    /// alone it makes one zone.
    #[arg(long, value_name = "FILE")]
    pub mask: Option<PathBuf>,
    /// A mesh to measure with, in px of the reference (y down): Gmsh .msh or .vtu, quadrilaterals and
    /// triangles. Each of its groups is a zone.
    #[arg(long, value_name = "FILE")]
    pub mesh: Option<PathBuf>,
    /// Leave out the pixels that lie this close to the border of a zone, px; the mesh still reaches the
    /// border. Default 0; 3 beside bands without texture.
    #[arg(long, value_name = "PX", allow_hyphen_values = true)]
    pub guard: Option<f64>,
    /// Cut the mesh along a crack or joint, px: points along it in order, separated by blanks. An end inside a zone stays joined, a
    /// tip: draw it some elements further than the tip reaches. Writes opening, sliding and tips to DIR/quantities. Repeat it for
    /// several cracks; 'auto' (experimental) finds them in the residual of the last frames and says their paths. Replaces the cracks of the case file.
    #[arg(long, value_name = "'x,y x,y ...'|auto", value_parser = path, allow_hyphen_values = true)]
    pub crack: Vec<CrackPath>,
    /// Leave out the pixels that lie this close to a crack, px. Default 3.
    #[arg(long, value_name = "PX", allow_hyphen_values = true)]
    pub crack_guard: Option<f64>,
    /// Young's modulus around the cracks, MPa: with --crack-poisson and --pixel-size the stress intensity factors at the tips are
    /// found, MPa sqrt(m).
    #[arg(long, value_name = "MPA", allow_hyphen_values = true)]
    pub crack_young: Option<f64>,
    /// Poisson's ratio around the cracks.
    #[arg(long, value_name = "NU", allow_hyphen_values = true)]
    pub crack_poisson: Option<f64>,
    /// Outer radius of the domain that the stress intensity is found in, px. Default: the largest that fits, up to twelve elements.
    #[arg(long, value_name = "PX", allow_hyphen_values = true)]
    pub crack_radius: Option<f64>,
    /// Drop elements with less than this share of their pixels inside a polygon or a mask, above 0 to 1.
    /// Default 0.5.
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    pub element_share: Option<f64>,
    /// Side of the square elements, px (4 to 128). Smaller: finer detail and more noise. Default 16.
    #[arg(long, value_name = "PX", allow_hyphen_values = true)]
    pub element_size: Option<i64>,
    /// Displacement between the nodes: bilinear in each element, or cubic-spline (experimental), smooth over all of them (knots one element size
    /// apart, nodes half as far). Default bilinear.
    #[arg(long, value_name = "bilinear|cubic-spline")]
    pub elements: Option<Elements>,
    /// Interpolation between pixels. Default cubic; quintic has ten times less bias at twice the cost.
    #[arg(long, value_name = "NAME", value_parser = interpolation)]
    pub interpolation: Option<Interpolation>,
    /// Error of the iteration that may be left when a frame counts as converged, px. Default 1e-4.
    #[arg(long, value_name = "PX", allow_hyphen_values = true)]
    pub tolerance: Option<f64>,
    /// Iterations after which a frame is given up. Default 50.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub max_iterations: Option<u32>,
    /// Brightness and contrast followed by one gain and offset per zone (zone), as fields over a zone that follow gradients
    /// of light and moving shadows (smooth), so only in frames where that lowers the residual significantly (auto), by
    /// each element (element), or not at all (off). For example --brightness smooth. Default auto.
    #[arg(long, value_name = "auto|zone|smooth|element|off")]
    pub brightness: Option<Brightness>,
    /// Start each frame from the extrapolation of those before it, or search for each on its own, in any order. Default
    /// previous, with --shard independent.
    #[arg(long, value_name = "previous|independent")]
    pub start: Option<StartFrom>,
    /// Large deformation: take a frame of the series for the reference of those that follow, when the present one matches
    /// badly (residual) or after every N frames. Fields stay those of the first reference. Needs --start previous.
    /// Default never.
    #[arg(long, value_name = "residual|every N|never", allow_hyphen_values = true)]
    pub update_reference: Option<UpdateReference>,
    /// The camera noise: its standard deviation in grey levels; photon:A,B, a variance A + B grey as `metrology` finds it;
    /// or photon, the same with A and B found on each frame's residual. Default: one standard deviation per zone, found on the
    /// residual.
    #[arg(long, value_name = "S|photon|photon:A,B", allow_hyphen_values = true)]
    pub noise: Option<Noise>,
    /// Noise that is correlated from pixel to pixel (demosaicing, smoothing in the camera, noise of rows): auto finds on the
    /// residual by how much it raises the standard uncertainty and says so; a number is that factor, as `metrology` finds it;
    /// off takes noise for white. Default auto.
    #[arg(long, value_name = "auto|off|F", allow_hyphen_values = true)]
    pub noise_correlation: Option<NoiseCorrelation>,
    /// Hold the displacement: tikhonov (small gradients) or equilibrium-gap (an elastic plate). Needs --cutoff.
    /// Nodes without texture are then carried by those around them. Default none.
    #[arg(long, value_name = "none|tikhonov|equilibrium-gap")]
    pub regularisation: Option<RegularisationKind>,
    /// Cut-off length of the regularisation, px: waves of the displacement as long as this lose half of their
    /// amplitude, longer ones less, shorter ones more.
    #[arg(long, value_name = "PX", allow_hyphen_values = true)]
    pub cutoff: Option<f64>,
    /// Leave out nodes that see no texture, however many, instead of refusing the reference. Up to a fifth of a zone, none of
    /// them on a face of a joint, are left out without it.
    #[arg(long)]
    pub drop_textureless: bool,
    /// Page of multi-page TIFF files. Default 0, the first. With --pages all that of the reference.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub page: Option<u32>,
    /// Take every page of the deformed TIFF files as a frame. Default for one file alone, unless --page is
    /// given.
    #[arg(long, value_name = "all", value_parser = pages)]
    pub pages: Option<Pages>,
    /// Millimetres per pixel: adds columns in mm to the CSV files.
    #[arg(long, value_name = "MM", allow_hyphen_values = true)]
    pub pixel_size: Option<f64>,
    /// The most pixels of an image, in millions, up to 2147: a file whose header claims more is not unpacked. Default 1000.
    #[arg(long, value_name = "MPX")]
    pub max_image_mpx: Option<u32>,
    /// What to write per frame beside the store DIR/fields.zarr. Default csv,vtu up to 1000 frames and none
    /// above (or what the run.toml given as --case wrote). `quadrille export` makes them later.
    #[arg(long, value_name = "csv,vtu|none", value_delimiter = ',')]
    pub export: Option<Vec<Export>>,
    /// Frames to draw at the end, into DIR/figures. `quadrille figures` draws more of them later.
    #[arg(long, value_name = "1,5-20|last|all")]
    pub figures: Option<Frames>,
    /// Definition of the strains. Default green-lagrange.
    #[arg(long, value_name = "infinitesimal|green-lagrange|hencky")]
    pub strain: Option<StrainDefinition>,
    /// Strains over a window of N x N nodes as well, N odd, with their standard uncertainty: a virtual strain gauge of N
    /// elements, (N - 1) L_step + L_subset with the element size for both. Default 1: those of elements and nodes alone.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub strain_window: Option<u32>,
    /// Write no DIR/report.html at the end. `--export none` leaves it out as well.
    #[arg(long)]
    pub no_report: bool,
    /// Where the pixel work is done: `auto` (a discrete GPU for 200 megapixels of frames or more, else the CPU), `cpu`, `gpu`
    /// (also an integrated or a software one), or an adapter by its number or part of its name, as `quadrille about devices` lists them.
    #[arg(long, value_name = "auto|cpu|gpu|NAME|INDEX", env = "QUADRILLE_DEVICE", default_value = "auto")]
    pub device: DeviceChoice,
    /// Use a graphics device even if it computes other numbers than the CPU, and check none of its frames.
    #[arg(long, env = "QUADRILLE_TRUST_DEVICE")]
    pub trust_device: bool,
    /// Instruction path of the CPU: avx512, avx2, baseline, scalar. Default: that of the run.toml given as
    /// --case, else the fastest there is. Results differ in the last bits between paths.
    #[arg(long, value_name = "NAME")]
    pub isa: Option<String>,
    #[command(flatten)]
    pub threads: Threads,
    /// Only errors.
    #[arg(long, short, conflicts_with = "verbose")]
    pub quiet: bool,
    /// One line for every frame.
    #[arg(long, short)]
    pub verbose: bool,
    /// How progress is written to stderr: as text, or as one JSON object a line for other programs.
    #[arg(long, value_name = "text|json", default_value = "text")]
    pub progress: ProgressKind,
}

/// Arguments of `quadrille watch`: those of `quadrille correlate`, for which the images are a folder.
#[derive(Debug, Args)]
#[command(
    mut_arg("deformed", |arg| {
        arg.value_name("SHOTS")
            .required(true)
            .num_args(1)
            .action(ArgAction::Set)
            .help("Folder that the camera writes into. Without --reference, and without one in the case file, its first image is \
                   the reference")
    }),
    mut_arg("case", |arg| {
        arg.help("A case file (TOML) with options, zones and the reference; flags win. Its deformed images do not count")
    }),
    mut_arg("export", |arg| {
        arg.help("What to write per frame beside the store DIR/fields.zarr. Default none (or what the run.toml given as --case \
                  wrote). `quadrille export` makes them later")
    }),
    mut_arg("shard", |arg| arg.hide(true)),
    mut_arg("pages", |arg| arg.hide(true)),
    after_help = "Examples:\n  \
    While the test runs; Ctrl-C when it is over:\n    \
    quadrille watch /data/shots --case joint.toml --output out\n  \
    Ends by itself when no image has come for ten minutes, for other programs:\n    \
    quadrille watch /data/shots --case joint.toml --output out --timeout 600 --progress json\n  \
    A camera that stops for seconds in the middle of a file, beside other images:\n    \
    quadrille watch /data/shots --pattern 'cam0_*.tif' --settle 10 --roi 10,10,1010,400 --output out\n\n\
    A file is taken when its size and time of change have been the same for the settling time; one that cannot be decoded then is \
    waited for ten times as long. Files come in natural order; one that is late gets the next number. The same command goes on \
    after a stop, and `quadrille correlate` with the same options and all files does what is missing.\n\n\
    Exit status: 0 every frame that was taken converged, whether the time-out or a signal was the end; 1 some frame did not, or \
    none came; 2 nothing could be run; 130 Ctrl-C or SIGTERM left frames that were taken undone."
)]
pub struct WatchArgs {
    /// Names of the files that are taken: a quoted glob. Default: those that end like an image (tif, tiff, btf, png, bmp,
    /// jpg, jpeg, pgm, ppm, pnm). Hidden files never are.
    #[arg(long, value_name = "GLOB")]
    pub pattern: Option<String>,
    /// A file is taken when it has not changed for this long. Give more for network folders, which show changes late.
    #[arg(long, value_name = "SECONDS", value_parser = seconds, default_value = "1")]
    pub settle: Duration,
    /// End when no file has arrived or changed for this long. Default: run until Ctrl-C.
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    pub timeout: Option<Duration>,
    /// What is shared with `quadrille correlate`.
    #[command(flatten)]
    pub correlate: CorrelateArgs,
}

/// How progress is said.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ProgressKind {
    /// For people.
    Text,
    /// One JSON object a line.
    Json,
}

/// Arguments of `quadrille slurm`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    Eight tasks with four cores each; the printed commands submit them:\n    \
    quadrille slurm long.toml --output /shared/out --array 8 --cpus 4 --time 08:00:00\n  \
    At once:\n    \
    quadrille slurm long.toml --output /shared/out --array 8 | sh\n  \
    One GPU for each of two tasks:\n    \
    quadrille slurm long.toml --output /shared/out --array 2 --gpu --partition gpu\n\n\
    A task that failed or ran out of time is submitted again: what is done is not done again.")]
pub struct SlurmArgs {
    /// Case file of `quadrille correlate`; it and the images have to be reachable from the nodes.
    #[arg(value_name = "CASE")]
    pub case: PathBuf,
    /// Folder for the results, on a file system that all nodes share.
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Number of tasks in the array; each does one share of the series.
    #[arg(long, value_name = "N")]
    pub array: NonZeroUsize,
    /// One GPU for each task. Default: the CPU.
    #[arg(long)]
    pub gpu: bool,
    /// Cores of each task.
    #[arg(long, value_name = "N", default_value = "4")]
    pub cpus: NonZeroUsize,
    /// Time of each task, as Slurm takes it. A task that runs out of it goes on when it is submitted again.
    #[arg(long, value_name = "HH:MM:SS", default_value = "04:00:00", value_parser = slurm_time)]
    pub time: String,
    /// Memory of each task, as Slurm takes it, such as 8G. Default: that of the cluster.
    #[arg(long, value_name = "SIZE", value_parser = slurm_word)]
    pub memory: Option<String>,
    /// Partition of the cluster.
    #[arg(long, value_name = "NAME", value_parser = slurm_word)]
    pub partition: Option<String>,
    /// Account that is charged.
    #[arg(long, value_name = "NAME", value_parser = slurm_word)]
    pub account: Option<String>,
    /// A further option of sbatch for both scripts, such as --sbatch=--qos=long; may be given several times.
    #[arg(long, value_name = "OPTION", value_parser = sbatch_option, allow_hyphen_values = true)]
    pub sbatch: Vec<String>,
    /// A file with lines of bash that every job runs before the program: modules to load, folders to make.
    #[arg(long, value_name = "FILE")]
    pub prologue: Option<PathBuf>,
    /// What the job after the array exports: csv, vtu, npz, mat. Default: nothing, the store holds everything.
    #[arg(long, value_name = "KINDS", value_delimiter = ',')]
    pub export: Vec<Target>,
    /// Folder for the scripts. Default: the current one.
    #[arg(long, value_name = "DIR")]
    pub scripts: Option<PathBuf>,
    /// The program on the nodes. Default: the path of this one.
    #[arg(long, value_name = "PATH")]
    pub program: Option<String>,
    /// Replace scripts that are there.
    #[arg(long)]
    pub overwrite: bool,
}

/// Arguments of `quadrille status`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    How far a run is, while it runs or after it was stopped:\n    \
    quadrille status out\n  \
    The same for another program:\n    \
    quadrille status out --json\n\n\
    Exit status: 0 all frames are done and converged; 1 frames are missing or did not converge; 2 there is no run.")]
pub struct StatusArgs {
    /// Folder of a run of `quadrille correlate`; it may still go on.
    #[arg(value_name = "DIR")]
    pub run: PathBuf,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
}
