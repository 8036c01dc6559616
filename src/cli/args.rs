//! The command line, as the user types it.

use super::frames::Frames;
use crate::backend::choice::DeviceChoice;
use crate::field::{
    Brightness, Noise, NoiseCorrelation, RegularisationKind, RemoveRigid, StartFrom, StrainDefinition, UpdateReference,
};
use crate::imaging::Interpolation;
use crate::io::case::Pages;
use crate::report::{Figure, Format};
use crate::run::Shard;
use clap::{ArgAction, Args, Parser, Subcommand, ValueEnum};
use std::ffi::OsString;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::time::Duration;

/// Displacement fields of tested materials from image series, by global Q4 image correlation.
#[derive(Debug, Parser)]
#[command(name = "quadrille", version, propagate_version = true, arg_required_else_help = true)]
#[command(after_help = "Start with `quadrille demo`, which needs no data, or with your own images:\n  \
    quadrille correlate --output out ref.tif 'frames/*.tif'")]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Measure displacement fields: one reference image, any number of deformed ones.
    Correlate(Box<CorrelateArgs>),
    /// Measure while the test runs: correlate images as a camera writes them into a folder.
    Watch(Box<WatchArgs>),
    /// Tell how far a run is: frames done, failed and missing, its rate, and who works on it.
    Status(StatusArgs),
    /// Write the scripts that spread a series over a Slurm cluster.
    Slurm(SlurmArgs),
    /// Make tables, ParaView, NumPy or MATLAB files of the fields of a run.
    Export(ExportArgs),
    /// Draw numbers from the fields of a run: points, lines, extensometers, openings.
    Probe(ProbeArgs),
    /// Draw the fields of a run as PNG or SVG: maps over the image, meshes, profiles along a line.
    Figures(FiguresArgs),
    /// Make speckle images whose displacement is known exactly.
    Synth(SynthArgs),
    /// From the images of a virtual test to the law of its adhesive, compared with the truth; needs no data.
    Demo(DemoArgs),
    /// Measure noise, texture, uncertainty and resolution on your own image, and recommend an element size.
    Metrology(MetrologyArgs),
    /// List the devices that can do the pixel work, and which of them would be taken.
    Devices(DevicesArgs),
    /// Measure what correlation costs on the devices of this machine, side by side.
    Bench(BenchArgs),
    /// Compute the displacements and tractions of a cohesive joint whose border moves as measured.
    Simulate(SimulateArgs),
    /// Find the parameters of the adhesive's law from measured displacements, with their uncertainty.
    Identify(IdentifyArgs),
    /// The same with one parameter prescribed at several values.
    Sweep(SweepArgs),
    /// Make the virtual test: a computed joint that is pulled apart, its images, and the truth about it.
    Virtual(VirtualArgs),
    /// From images to the law of an adhesive: correlate, identify, report; from one case file.
    Run(RunArgs),
    /// The numerical experiments of Fedele, Raka, Hild and Roux (2009) done again: tables and figures.
    Paper(PaperArgs),
}

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
    quadrille correlate --update-reference residual --output out ref.tif 'frames/*.tif'\n\n\
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
    #[arg(long, value_name = "DIR")]
    pub output: PathBuf,
    /// Replace the results of an earlier run in the output folder.
    #[arg(long, conflicts_with_all = ["resume", "shard"])]
    pub overwrite: bool,
    /// Go on with the run in the output folder: do what is missing of it. This is the default; a run with other options
    /// or images is refused.
    #[arg(long)]
    pub resume: bool,
    /// Do this share of the frames only: I of N processes that write into one folder, frames I, I+N, I+2N, ... `slurm`
    /// takes the place of the task in its array. Needs --start independent, which is then the default.
    #[arg(long, value_name = "I/N|slurm")]
    pub shard: Option<Shard>,
    /// A rectangle to measure, px: left, top, right, bottom (the last two not included). Repeat it for
    /// several zones. Default: the whole image. This, --polygon, --mask and --mesh replace the zones of the
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
    /// Drop elements with less than this share of their pixels inside a polygon or a mask, above 0 to 1.
    /// Default 0.5.
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    pub element_share: Option<f64>,
    /// Side of the square elements, px (4 to 128). Smaller: finer detail and more noise. Default 16.
    #[arg(long, value_name = "PX", allow_hyphen_values = true)]
    pub element_size: Option<i64>,
    /// Interpolation between pixels. Default cubic; quintic has ten times less bias at twice the cost.
    #[arg(long, value_name = "NAME", value_parser = interpolation)]
    pub interpolation: Option<Interpolation>,
    /// Largest correction at which a frame counts as converged, px. Default 1e-4.
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
    /// Leave out nodes that see no texture, however many, instead of refusing the reference. Up to 5 % of a zone, none of
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
    /// Where the pixel work is done: `auto` (a discrete or integrated GPU, else the CPU), `cpu`, `gpu` (also a software
    /// one), or an adapter by its number or part of its name, as `quadrille devices` lists them.
    #[arg(long, value_name = "auto|cpu|gpu|NAME|INDEX", env = "QUADRILLE_DEVICE", default_value = "auto")]
    pub device: DeviceChoice,
    /// Instruction path of the CPU: avx512, avx2, baseline, scalar. Default: that of the run.toml given as
    /// --case, else the fastest there is. Results differ in the last bits between paths.
    #[arg(long, value_name = "NAME")]
    pub isa: Option<String>,
    /// Threads. Default: all cores. Results do not depend on it.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub threads: Option<usize>,
    /// Only errors.
    #[arg(long, short, conflicts_with = "verbose")]
    pub quiet: bool,
    /// One line for every frame.
    #[arg(long, short)]
    pub verbose: bool,
    /// How progress is said on stderr: for people, or as one JSON object a line for other programs.
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
    /// A file is taken when it has not changed for so long. Longer for network folders that tell of changes late.
    #[arg(long, value_name = "SECONDS", value_parser = seconds, default_value = "1")]
    pub settle: Duration,
    /// End when no file has come or changed for so long. Default: go on until Ctrl-C.
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    pub timeout: Option<Duration>,
    /// What is shared with `quadrille correlate`.
    #[command(flatten)]
    pub correlate: CorrelateArgs,
}

/// A time above zero.
fn seconds(text: &str) -> Result<Duration, String> {
    let seconds: f64 = text.parse().map_err(|_| format!("'{text}' is no number of seconds"))?;
    // Below a millisecond nothing settles, above a year nothing ends.
    let fine = (1e-3..=3.2e7).contains(&seconds);
    if fine { Ok(Duration::from_secs_f64(seconds)) } else { Err("give seconds from 0.001 to a year".into()) }
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
    #[arg(long, value_name = "DIR")]
    pub output: PathBuf,
    /// Tasks of the array: so many shares of the series.
    #[arg(long, value_name = "N")]
    pub array: NonZeroUsize,
    /// One GPU for each task. Default: the CPU.
    #[arg(long)]
    pub gpu: bool,
    /// Cores of each task.
    #[arg(long, value_name = "N", default_value = "4")]
    pub cpus: NonZeroUsize,
    /// Time of each task, as Slurm takes it. A task that runs out of it goes on when it is submitted again.
    #[arg(long, value_name = "HH:MM:SS", default_value = "04:00:00")]
    pub time: String,
    /// Memory of each task, as Slurm takes it, such as 8G. Default: that of the cluster.
    #[arg(long, value_name = "SIZE")]
    pub memory: Option<String>,
    /// Partition of the cluster.
    #[arg(long, value_name = "NAME")]
    pub partition: Option<String>,
    /// Account that is charged.
    #[arg(long, value_name = "NAME")]
    pub account: Option<String>,
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
    How far a run is, while it goes on or after it was stopped:\n    \
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

/// What `quadrille export` makes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Target {
    /// DIR/csv/NNNNNN.csv: one row per measured node.
    Csv,
    /// DIR/vtu/NNNNNN.vtu and DIR/series.pvd for ParaView.
    Vtu,
    /// DIR/fields.npz for numpy.load; with --split DIR/npz/NNNNNN.npz.
    Npz,
    /// DIR/fields.mat for MATLAB and scipy.io.loadmat; with --split DIR/mat/NNNNNN.mat.
    Mat,
}

/// Arguments of `quadrille export`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    Tables and ParaView files of a long series, every frame from 100 to 200:\n    \
    quadrille export out --to csv,vtu --frames 100-200\n  \
    One file for MATLAB, in another folder:\n    \
    quadrille export out --to mat --output for-matlab\n\n\
    Exit status: 0 everything asked for is there; 1 some frame named by --frames has no field; 2 nothing could \
    be done.")]
pub struct ExportArgs {
    /// Folder of a run of `quadrille correlate`; it may still go on.
    #[arg(value_name = "DIR")]
    pub run: PathBuf,
    /// What to make.
    #[arg(long, value_name = "csv,vtu,npz,mat", value_delimiter = ',', required = true)]
    pub to: Vec<Target>,
    /// Frames: numbers from 1 and ranges such as 1,5-20; last; or all that have a field.
    #[arg(long, value_name = "1,5-20|last|all", default_value = "all")]
    pub frames: Frames,
    /// Folder for the files; made when it is not there. Default: DIR.
    #[arg(long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// npz and mat: a file for each frame instead of one for all.
    #[arg(long)]
    pub split: bool,
    /// Replace files that are there already.
    #[arg(long)]
    pub overwrite: bool,
    /// Only errors.
    #[arg(long, short)]
    pub quiet: bool,
}

/// Arguments of `quadrille probe`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    A point and an extensometer over all frames, beside the load recorded with each image:\n    \
    quadrille probe out --point 512,300 --extensometer 100,400,900,400 --load load.csv\n  \
    Opening and sliding along a joint, the rotation of the specimen taken off:\n    \
    quadrille probe out --opening upper,lower --remove-rigid all\n\n\
    Writes DIR/quantities/points.csv, lines.csv, extensometers.csv, openings.csv, openings_mean.csv and\n\
    rigid_motions.csv, those that are asked for. Sections [[probe]], [[line]], [[extensometer]], [[opening]],\n\
    [load] and [quantities] of a case file say the same.\n\n\
    Exit status: 0 everything asked for is there; 1 some frame named by --frames has no field; 2 nothing could \
    be done.")]
pub struct ProbeArgs {
    /// Folder of a run of `quadrille correlate`; it may still go on.
    #[arg(value_name = "DIR")]
    pub run: PathBuf,
    /// Frames: numbers from 1 and ranges such as 1,5-20; last; or all.
    #[arg(long, value_name = "1,5-20|last|all", default_value = "all")]
    pub frames: Frames,
    /// A case file (TOML) that says what to draw. Flags of a kind replace its sections of that kind. Default,
    /// without any flag: the case of the run.
    #[arg(long, value_name = "FILE")]
    pub case: Option<PathBuf>,
    /// A point, px: displacement and strain with their uncertainty. Repeat it for several.
    #[arg(long, value_name = "x,y", value_parser = pair, allow_hyphen_values = true)]
    pub point: Vec<[f64; 2]>,
    /// A line, px: the same at points along it. Repeat it for several.
    #[arg(long, value_name = "x0,y0,x1,y1", value_parser = rectangle, allow_hyphen_values = true)]
    pub line: Vec<[f64; 4]>,
    /// Distance of the points of lines, px. Default: a quarter of the element size.
    #[arg(long, value_name = "PX", allow_hyphen_values = true)]
    pub step: Option<f64>,
    /// An extensometer from one point to another, px: elongation and strain. Repeat it for several.
    #[arg(long, value_name = "x0,y0,x1,y1", value_parser = rectangle, allow_hyphen_values = true)]
    pub extensometer: Vec<[f64; 4]>,
    /// Average extensometers over gauge lines of this length across their ends, px. Default 0: points.
    #[arg(long, value_name = "PX", allow_hyphen_values = true)]
    pub width: Option<f64>,
    /// Opening and sliding between two zones along their facing edges; for a horizontal joint the upper zone
    /// first. Repeat it for several.
    #[arg(long, value_name = "upper,lower", value_parser = two_zones)]
    pub opening: Vec<[String; 2]>,
    /// Take the rigid motion off before, of all nodes together or of each zone.
    #[arg(long, value_name = "all|zone")]
    pub remove_rigid: Option<RemoveRigid>,
    /// Definition of the strains. Default: that of the run.
    #[arg(long, value_name = "infinitesimal|green-lagrange|hencky")]
    pub strain: Option<StrainDefinition>,
    /// What other instruments recorded (CSV, a row per image): joined to every row.
    #[arg(long, value_name = "FILE")]
    pub load: Option<PathBuf>,
    /// Draw every quantity against each column of the load file, or without one against the frame number, as PNG
    /// and SVG into DIR/curves.
    #[arg(long)]
    pub curves: bool,
    /// Folder for `quantities/`. Default: DIR.
    #[arg(long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Only errors.
    #[arg(long, short)]
    pub quiet: bool,
}

/// Where `quadrille figures` takes a strain from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum StrainPlace {
    /// One value for each element, over its size.
    Elements,
    /// Interpolated between nodes, over twice the element size: smoother.
    Nodes,
}

/// Arguments of `quadrille figures`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    Displacements, strains and residual of the last frame, into out/figures:\n    \
    quadrille figures out\n  \
    Two strains of three frames for a paper, with one colour bar:\n    \
    quadrille figures out --frames 5,10,20 --quantity exx,eyy --range=-0.01,0.01 --format svg\n  \
    The opening along a line across two strips, and both strips brought into register:\n    \
    quadrille figures out --quantity uy,register --line 600,20,600,780\n\n\
    Exit status: 0 everything asked for is there; 1 some frame named by --frames has no field; 2 nothing could \
    be drawn.")]
pub struct FiguresArgs {
    /// Folder of a run of `quadrille correlate`; it may still go on.
    #[arg(value_name = "DIR")]
    pub run: PathBuf,
    /// Frames: numbers from 1 and ranges such as 1,5-20; last; or all that have a field.
    #[arg(long, value_name = "1,5-20|last|all", default_value = "last")]
    pub frames: Frames,
    /// What to draw: ux, uy, exx, eyy, exy, residual, residual-percent, sigma, model-error, misfit, mesh,
    /// deformed, register.
    /// Default ux,uy,exx,eyy,exy,residual.
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub quantity: Vec<Figure>,
    /// Kinds of file.
    #[arg(long, value_name = "png,svg", value_delimiter = ',', default_value = "png")]
    pub format: Vec<Format>,
    /// A line, px: shown in the maps, and each quantity drawn along it with a band of 2 standard uncertainties.
    #[arg(long, value_name = "x0,y0,x1,y1", value_parser = rectangle, allow_hyphen_values = true)]
    pub line: Option<[f64; 4]>,
    /// Factor on displacements in deformed and register. Default: one that makes them visible; 1 where the
    /// deformed image can be shown.
    #[arg(long, value_name = "X", allow_hyphen_values = true)]
    pub magnify: Option<f64>,
    /// Ends of the colour bars, for all maps drawn. Default: the values of each.
    #[arg(long, value_name = "low,high", value_parser = pair, allow_hyphen_values = true)]
    pub range: Option<[f64; 2]>,
    /// Definition of the strains. Default: that of the run.
    #[arg(long, value_name = "infinitesimal|green-lagrange|hencky")]
    pub strain: Option<StrainDefinition>,
    /// Strains of elements or of nodes.
    #[arg(long, value_enum, default_value = "elements")]
    pub strain_on: StrainPlace,
    /// Rigid motion that register takes off: of each zone, or of all together.
    #[arg(long, value_name = "zone|all", default_value = "zone")]
    pub remove_rigid: RemoveRigid,
    /// Pixels per unit of length in PNG files, 1 to 4: 1 for the screen, 2 or 3 for print.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=4))]
    pub scale: u32,
    /// Folder for the pictures; made when it is not there. Default: DIR/figures.
    #[arg(long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Threads. Default: all cores.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub threads: Option<usize>,
    /// Only errors.
    #[arg(long, short)]
    pub quiet: bool,
}

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
    #[arg(long, value_name = "DIR")]
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

/// Arguments of `quadrille run`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  \
    quadrille virtual --output test && quadrille run test/case.toml --output test/run\n\n\
    Steps already done with the same images and options are not done again. DIR/report.html tells all; the measured\n\
    fields are in DIR/correlation.\n\n\
    Exit status: 0 all is there; 1 a frame or the fit did not converge; 2 nothing could be run.")]
pub struct RunArgs {
    /// The case file (TOML): [images], [correlation], two [[zone]], [interface], [substrate], [cohesive], [measurement],
    /// [fit]. Names of files in it are relative to its folder.
    #[arg(value_name = "CASE.toml")]
    pub case: PathBuf,
    /// Folder for the results; made when it is not there.
    #[arg(long, value_name = "DIR")]
    pub output: PathBuf,
    /// Do all steps again, and replace the results of any earlier run in the output folder.
    #[arg(long)]
    pub overwrite: bool,
    /// What does the pixel work: auto, cpu, gpu, part of the name of an adapter, or its number.
    #[arg(long, value_name = "auto|cpu|gpu|NAME|INDEX", env = "QUADRILLE_DEVICE", default_value = "auto")]
    pub device: DeviceChoice,
    /// Threads. Default: all cores. Results do not depend on it.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub threads: Option<usize>,
    /// Only errors.
    #[arg(long, short)]
    pub quiet: bool,
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

/// Arguments of `quadrille virtual`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  \
    quadrille virtual --output test && quadrille run test/case.toml --output test/run\n\n\
    Written are images/NNNNNN.png (000000 is the reference), case.toml, truth.json (parameters, hashes of the images)\n\
    and truth: mesh, displacements, border and tractions of the region that is measured.")]
pub struct VirtualArgs {
    /// Folder for the test; made when it is not there.
    #[arg(long, value_name = "DIR")]
    pub output: PathBuf,
    /// Replace a test that is there.
    #[arg(long)]
    pub overwrite: bool,
    /// Seed of speckles and noise.
    #[arg(long, default_value_t = 1, allow_negative_numbers = true)]
    pub seed: u64,
    /// Depth of the images, bits.
    #[arg(long, value_enum, default_value = "8")]
    pub depth: VirtualDepth,
    /// Standard deviation of the noise, grey levels of 255.
    #[arg(long, value_name = "S", default_value_t = 2.0, allow_negative_numbers = true)]
    pub noise: f32,
    /// Threads. Default: all cores. Results do not depend on it.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub threads: Option<usize>,
}

/// Arguments of `quadrille paper`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  quadrille paper --output out/paper\n\n\
    Written are table-1 and table-2 as CSV, tables.md, and the figures as PNG and SVG, with their numbers as CSV.\n\n\
    Exit status: 0 all fits below 2 px of noise converged inside their bounds; 1 some did not; 2 it could not run.")]
pub struct PaperArgs {
    /// Folder for the results; made when it is not there.
    #[arg(long, value_name = "DIR")]
    pub output: PathBuf,
    /// Replace results that are there.
    #[arg(long)]
    pub overwrite: bool,
    /// Draws of the noise at each level.
    #[arg(long, value_name = "N", default_value_t = 20, allow_negative_numbers = true)]
    pub seeds: usize,
    /// Seed of the first draw, of speckles and of the noise of images.
    #[arg(long, default_value_t = 1, allow_negative_numbers = true)]
    pub seed: u64,
    /// Threads. Default: all cores. Results do not depend on it.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub threads: Option<usize>,
}

/// Arguments of `quadrille demo`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  quadrille demo --output out/demo && xdg-open out/demo/run/report.html")]
pub struct DemoArgs {
    /// Folder for images and results.
    #[arg(long, value_name = "DIR", default_value = "out/demo")]
    pub output: PathBuf,
    /// Seed of speckles and noise: changes the images, not the conclusion.
    #[arg(long, default_value_t = 1, allow_negative_numbers = true)]
    pub seed: u64,
    /// Threads. Default: all cores.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub threads: Option<usize>,
}

/// Arguments of `quadrille metrology`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    One image: texture, uncertainty and resolution, with a noise that is assumed:\n    \
    quadrille metrology ref.tif\n  \
    With images of the specimen at rest, from which the noise is measured, of one zone:\n    \
    quadrille metrology ref.tif 'static/*.tif' --roi 10,10,1010,400 --output out\n  \
    Elements that resolve a period of 100 px:\n    \
    quadrille metrology ref.tif static.tif --resolve-period 100\n\n\
    Prints a table; with --output DIR writes DIR/metrology.json as well.")]
pub struct MetrologyArgs {
    /// The reference image.
    #[arg(value_name = "REFERENCE")]
    pub reference: PathBuf,
    /// Further images of the specimen at rest, as the reference: files or quoted globs.
    #[arg(value_name = "STATIC")]
    pub stills: Vec<String>,
    /// The rectangle to look at, px: left, top, right, bottom. Default: the whole image. Of more than a
    /// million pixels the middle is used.
    #[arg(long, value_name = "x0,y0,x1,y1", value_parser = rectangle, allow_hyphen_values = true)]
    pub roi: Option<[f64; 4]>,
    /// Element sizes to try, px (4 to 128). Default: those of 6,8,12,16,24,32,48,64 that fit.
    #[arg(long, value_name = "PX,PX..", value_delimiter = ',', allow_hyphen_values = true)]
    pub element_sizes: Option<Vec<i64>>,
    /// Standard deviation of the noise of one image, grey levels. Default: measured on the static images;
    /// assumed without any.
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    pub noise: Option<f64>,
    /// Interpolation of the correlation: cubic (default), quintic, keys, bilinear.
    #[arg(long, value_name = "NAME", value_parser = interpolation)]
    pub interpolation: Option<Interpolation>,
    /// Standard uncertainty that the recommended elements reach, px.
    #[arg(long, value_name = "PX", default_value_t = 0.02, allow_hyphen_values = true)]
    pub target_sigma: f64,
    /// Recommend the largest elements that resolve waves of this period at 90 % of their amplitude, px.
    #[arg(long, value_name = "PX", allow_hyphen_values = true)]
    pub resolve_period: Option<f64>,
    /// Folder for metrology.json; made when it is not there, an earlier one is replaced.
    #[arg(long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Seed of the noise that is added to copies of the image.
    #[arg(long, default_value_t = 1, allow_negative_numbers = true)]
    pub seed: u64,
    /// Page of multi-page TIFF files. Default 0, the first.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub page: Option<u32>,
    /// Threads. Default: all cores. Results do not depend on it.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub threads: Option<usize>,
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
    #[arg(long, value_name = "DIR")]
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
    /// Repetitions of each measurement, by turns.
    #[arg(long, value_name = "N", default_value_t = 3)]
    pub runs: usize,
    /// Side of the square elements, px (4 to 128).
    #[arg(long, value_name = "PX", default_value_t = 16)]
    pub element_size: usize,
    /// Elements left out at each side of the image. With 0 those at the border lose pixels in every frame, which costs.
    #[arg(long, value_name = "N", default_value_t = 2)]
    pub margin: u8,
    /// Device: auto, cpu, gpu, the number of an adapter, or part of its name.
    #[arg(long, value_name = "auto|cpu|gpu|NAME|INDEX", env = "QUADRILLE_DEVICE", default_value = "auto")]
    pub device: String,
    /// Threads. Default: all cores.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub threads: Option<usize>,
    /// Print the figures as JSON.
    #[arg(long)]
    pub json: bool,
    /// Where images and results go for the time being: say a folder of the disk to be measured. Default: the system's
    /// folder for temporary files.
    #[arg(long, value_name = "DIR")]
    pub folder: Option<PathBuf>,
}

/// Arguments of `quadrille simulate`.
#[derive(Debug, Args)]
#[command(after_help = "Example of a case file:\n  \
    [mesh]\n  file = \"mesh.json\"\n  \
    [boundary]\n  file = \"boundary_displacements.csv\"\n  \
    [substrate]\n  model = \"ramberg-osgood\"\n  E_MPa = 72000.0\n  nu = 0.33\n  sigma_0_MPa = 180.0\n  alpha = 0.06\n  n = 7.0\n  \
    [cohesive]\n  model = \"extended-xu-needleman\"\n  phi_n_N_per_mm = 1.0\n  delta_n_mm = 0.005\n  delta_t_mm = 0.05\n  r = 4.0\n\n\
    Exit status: 0 all instants converged; 1 some did not (see DIR/summary.json); 2 nothing could be run.")]
pub struct SimulateArgs {
    /// The case file (TOML): tables [mesh], [boundary], [substrate], [cohesive], [output]. Names of files in it are
    /// relative to its folder.
    #[arg(value_name = "CASE.toml")]
    pub case: PathBuf,
    /// Folder for the results; made when it is not there.
    #[arg(long, value_name = "DIR")]
    pub output: PathBuf,
    /// Replace the results of an earlier run in the output folder.
    #[arg(long)]
    pub overwrite: bool,
    /// Threads. Default: all cores. Results do not depend on it.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub threads: Option<usize>,
    /// Only errors.
    #[arg(long, short)]
    pub quiet: bool,
}

/// Arguments of `quadrille identify`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  \
    quadrille identify joint.toml --output out/fit\n\n\
    Exit status: 0 the fit converged; 1 it did not, the best point is in DIR/fit.json; 2 it could not run.")]
pub struct IdentifyArgs {
    /// The case file (TOML): the tables of `quadrille simulate` with [measurement] and [fit]. Names of files in it are
    /// relative to its folder.
    #[arg(value_name = "CASE.toml")]
    pub case: PathBuf,
    /// Folder for the results; made when it is not there.
    #[arg(long, value_name = "DIR")]
    pub output: PathBuf,
    /// Replace the results of an earlier run in the output folder.
    #[arg(long)]
    pub overwrite: bool,
    /// Threads. Default: all cores. Results do not depend on it.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub threads: Option<usize>,
    /// Only errors.
    #[arg(long, short)]
    pub quiet: bool,
}

/// Arguments of `quadrille sweep`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  \
    quadrille sweep joint.toml --values 3,4,5,6 --output out/sweep\n\n\
    Exit status: 0 all fits converged; 1 some did not; 2 it could not run.")]
pub struct SweepArgs {
    /// The case file of `quadrille identify`.
    #[arg(value_name = "CASE.toml")]
    pub case: PathBuf,
    /// The parameter that is prescribed.
    #[arg(long, value_name = "NAME", default_value = "r")]
    pub parameter: String,
    /// Its values. Default: the table [fit.sweep] of the case.
    #[arg(long, value_name = "X,X,...", value_delimiter = ',')]
    pub values: Vec<f64>,
    /// Folder for the results; made when it is not there.
    #[arg(long, value_name = "DIR")]
    pub output: PathBuf,
    /// Replace the results of an earlier run in the output folder.
    #[arg(long)]
    pub overwrite: bool,
    /// Threads. Default: all cores. Results do not depend on it.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub threads: Option<usize>,
    /// Only errors.
    #[arg(long, short)]
    pub quiet: bool,
}

/// The arguments with `every N` as one: a value of two words, which are told from the images that may follow.
pub fn joined(arguments: impl IntoIterator<Item = OsString>) -> Vec<OsString> {
    let mut joined: Vec<OsString> = Vec::new();
    for argument in arguments {
        match joined.as_mut_slice() {
            [.., flag, every] if flag == "--update-reference" && every == "every" => {
                every.push(" ");
                every.push(argument);
            }
            [.., every] if every == "--update-reference=every" => {
                every.push(" ");
                every.push(argument);
            }
            _ => joined.push(argument),
        }
    }
    joined
}

fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let values: Result<Vec<f64>, _> = text.split(',').map(|v| v.trim().parse::<f64>()).collect();
    let values = values.map_err(|_| format!("'{text}' is no list of {N} numbers separated by commas"))?;
    let n = values.len();
    if values.iter().any(|v| !v.is_finite()) {
        return Err(format!("'{text}' holds a number that is not finite"));
    }
    values.try_into().map_err(|_| format!("'{text}' has {n} numbers instead of {N}"))
}

fn rectangle(text: &str) -> Result<[f64; 4], String> {
    numbers(text)
}

/// Corners of a polygon, px.
#[derive(Debug, Clone)]
pub struct Polygon(pub Vec<[f64; 2]>);

fn polygon(text: &str) -> Result<Polygon, String> {
    let corners: Vec<[f64; 2]> = text.split_whitespace().map(numbers).collect::<Result<_, _>>()?;
    match corners.len() {
        0..=2 => Err(format!("'{text}' has fewer than three corners; write x,y x,y x,y")),
        _ => Ok(Polygon(corners)),
    }
}

fn pages(text: &str) -> Result<Pages, String> {
    match text {
        "all" => Ok(Pages::All),
        other => Err(format!("'{other}' is not 'all'; a single page is --page")),
    }
}

fn two_zones(text: &str) -> Result<[String; 2], String> {
    let [plus, minus] = text
        .split(',')
        .map(str::trim)
        .collect::<Vec<_>>()
        .try_into()
        .map_err(|names: Vec<_>| format!("'{text}' names {} zones instead of two: upper,lower", names.len()))?;
    Ok([plus.to_owned(), minus.to_owned()])
}

fn pair(text: &str) -> Result<[f64; 2], String> {
    numbers(text)
}

fn size(text: &str) -> Result<[usize; 2], String> {
    let parse = |v: &str| v.trim().parse::<usize>().ok().filter(|v| (1..=32_768).contains(v));
    text.split_once(['x', 'X'])
        .and_then(|(w, h)| Some([parse(w)?, parse(h)?]))
        .ok_or_else(|| format!("'{text}' is no image size such as 1024x768"))
}

fn interpolation(name: &str) -> Result<Interpolation, String> {
    [Interpolation::Cubic, Interpolation::Quintic, Interpolation::Keys, Interpolation::Bilinear]
        .into_iter()
        .find(|i| i.name() == name)
        .ok_or_else(|| format!("'{name}' is not one of cubic, quintic, keys, bilinear"))
}

/// Arguments of `quadrille devices`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    What is there:\n    \
    quadrille devices\n  \
    Correlate on the second graphics adapter:\n    \
    quadrille correlate --device 1 --output out ref.tif 'frames/*.tif'")]
pub struct DevicesArgs {
    /// Print as JSON.
    #[arg(long)]
    pub json: bool,
}
