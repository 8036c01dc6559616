//! What `correlate`, `watch`, `slurm` and `status` take.

use super::fields::Target;
use super::shared::Threads;
use super::words::{columns_by_rows, sbatch_option, seconds, slurm_time, slurm_word};
use crate::cli::look::frames::Frames;
use crate::io::case::flags::numbers;
use crate::run::Request;
use clap::{ArgAction, Args, ValueEnum};
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::time::Duration;

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
    /// A case file (TOML) that says the same; flags win.
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
    #[arg(long, hide_short_help = true)]
    pub resume: bool,
    #[command(flatten)]
    pub request: Request,
    /// Frames to draw at the end: 1,5-20, last, all. Into DIR/figures; `quadrille figures` draws more of them later.
    #[arg(long, value_name = "1,5-20|last|all", help_heading = "Output")]
    pub figures: Option<Frames>,
    /// Use a graphics device even if it computes other numbers than the CPU, and check none of its frames.
    #[arg(long, env = "QUADRILLE_TRUST_DEVICE", hide_short_help = true, help_heading = "Machine")]
    pub trust_device: bool,
    #[command(flatten)]
    pub threads: Threads,
    /// Only errors.
    #[arg(long, short, conflicts_with = "verbose", help_heading = "Messages")]
    pub quiet: bool,
    /// One line for every frame.
    #[arg(long, short, help_heading = "Messages")]
    pub verbose: bool,
    /// How progress is written to stderr: as text, or as one JSON object a line for other programs.
    #[arg(long, value_name = "text|json", default_value = "text", hide_short_help = true, help_heading = "Messages")]
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
    mut_arg("file", |arg| arg.hide_short_help(true)),
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
    /// Names of the files that are taken: a quoted glob. Default: those that end like an image (tif, tiff, btf, png,
    /// bmp, jpg, jpeg, pgm, ppm, pnm). Hidden files never are.
    #[arg(long, value_name = "GLOB")]
    pub pattern: Option<String>,
    /// A file is taken when it has not changed for this long. Give more for network folders, which show changes late.
    #[arg(long, value_name = "SECONDS", value_parser = seconds, default_value = "1")]
    pub settle: Duration,
    /// End when no file has arrived or changed for this long. Default: run until Ctrl-C.
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    pub timeout: Option<Duration>,
    #[command(flatten)]
    pub correlate: CorrelateArgs,
}

/// Arguments of `quadrille calibrate`: those of `quadrille correlate`, and what was marked.
#[derive(Debug, Args)]
#[command(
    mut_arg("deformed", |arg| {
        arg.value_name("IMAGES")
            .help("Images of the specimen, moved in its plane by hand between them; the first is the reference. Or of a target; the \
                   first shows it in the plane of the specimen. One alone for marked points and lengths")
    }),
    mut_arg("export", |arg| arg.hide_short_help(true)),
    mut_arg("file", |arg| arg.hide_short_help(true)),
    mut_arg("cutoff_px", |arg| arg.hide_short_help(true)),
    mut_arg("regularisation", |arg| arg.hide_short_help(true)),
    mut_arg("shard", |arg| arg.hide(true)),
    after_help = "Examples:\n  \
    The specimen at rest, moved across, moved along, by 5 to 10 % of the image:\n    \
    quadrille calibrate a.tif b.tif c.tif --output cal\n  \
    With its scale, by a ruler of 50 mm in the plane of the specimen:\n    \
    quadrille calibrate a.tif b.tif c.tif --length 210,400,1810,412,50 --output cal\n  \
    A chessboard of 10 x 7 squares of 5 mm, lying on the specimen, then turned by hand in any way:\n    \
    quadrille calibrate flat.tif turned-*.tif --chessboard 9x6 --pitch 5 --output cal\n  \
    Of one image, by points whose place is known:\n    \
    quadrille calibrate a.tif --point 100,90,0,0 --point 900,95,40,0 --point 890,700,40,30 --point 95,690,0,30 --output cal\n\n\
    DIR/camera.toml is for `--camera` of correlate, or `file` of `[camera]`.\n\n\
    Exit status: 0 a camera was written; 2 nothing could be found."
)]
pub struct CalibrateArgs {
    /// A length in the plane, px and mm; may be repeated. Ends x0,y0,x1,y1 in the first image, and its mm.
    #[arg(long, value_name = "x0,y0,x1,y1,MM", value_parser = numbers::<5>, allow_hyphen_values = true)]
    pub length: Vec<[f64; 5]>,
    /// A point whose place is known; four or more. Its px in the first image, and its mm along any axes of the plane.
    #[arg(long, value_name = "x,y,X,Y", value_parser = numbers::<4>, allow_hyphen_values = true)]
    pub point: Vec<[f64; 4]>,
    /// The images show a chessboard; columns and rows of its inner corners. One more square than that each way.
    #[arg(long, value_name = "NxM", value_parser = columns_by_rows, conflicts_with = "dots")]
    pub chessboard: Option<[usize; 2]>,
    /// The images show a square grid of round dots; their columns and rows.
    #[arg(long, value_name = "NxM", value_parser = columns_by_rows)]
    pub dots: Option<[usize; 2]>,
    /// Distance of neighbouring points of the target, mm.
    #[arg(long, value_name = "MM", allow_hyphen_values = true)]
    pub pitch: Option<f64>,
    /// Standard uncertainty of what was marked, px; 0.5 where none is given.
    #[arg(long, value_name = "PX", allow_hyphen_values = true, hide_short_help = true)]
    pub mark_std: Option<f64>,
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
