//! What the commands of a bonded joint take.

use super::series::ProgressKind;
use super::shared::{Drawn, FitLimits, Quiet, Results, Threads};
use crate::backend::choice::DeviceChoice;
use crate::mechanics::SpecimenKind;
use crate::mechanics::cohesive::{ExtendedXuNeedleman, LAW_NAMES, USUAL_LAWS};
use clap::Args;
use clap::ValueEnum;
use clap::builder::PossibleValuesParser;
use std::path::PathBuf;

/// Arguments of `quadrille run`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  \
    quadrille virtual --output test && quadrille run test/case.toml --output test/run\n\n\
    Steps already done with the same images and options are not done again. DIR/report.html shows everything; the measured\n\
    fields are in DIR/correlation.\n\n\
    Exit status: 0 all is there; 1 a frame or the fit did not converge, or --max-seconds was reached; 2 nothing could be
\
    run; 130 Ctrl-C or SIGTERM: what is done is kept, the best point of the fit too.")]
pub struct RunArgs {
    /// The case file (TOML): [images], [correlation], two [[zone]], [interface], [substrate], [cohesive], [measurement],
    /// [fit]. Names of files in it are relative to its folder.
    #[arg(value_name = "CASE.toml")]
    pub case: PathBuf,
    /// Folder for the results; made when it is not there.
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Do all steps again, and replace the results of any earlier run in the output folder.
    #[arg(long)]
    pub overwrite: bool,
    /// What does the pixel work: auto, cpu, gpu, part of the name of an adapter, or its number.
    #[arg(long, value_name = "auto|cpu|gpu|NAME|INDEX", env = "QUADRILLE_DEVICE", default_value = "auto")]
    pub device: DeviceChoice,
    /// Use a graphics device even if it computes other numbers than the CPU, and check none of its frames.
    #[arg(long, env = "QUADRILLE_TRUST_DEVICE")]
    pub trust_device: bool,
    #[command(flatten)]
    pub threads: Threads,
    #[command(flatten)]
    pub limits: FitLimits,
    #[command(flatten)]
    pub talk: Quiet,
    /// How progress is written to stderr: as text, or as one JSON object a line for other programs.
    #[arg(long, value_name = "text|json", default_value = "text")]
    pub progress: ProgressKind,
    #[command(flatten)]
    pub drawn: Drawn,
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

/// Arguments of `quadrille virtual`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    quadrille virtual --output test && quadrille run test/case.toml --output test/run\n  \
    quadrille virtual --law trapezoidal-power --output other       a truth that the law of the case file does not know\n\n\
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
    #[arg(long, value_name = "NAME", default_value = ExtendedXuNeedleman::NAME, value_parser = PossibleValuesParser::new(LAW_NAMES))]
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
}

/// Arguments of `quadrille paper`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  quadrille paper --output out/paper\n\n\
    It writes table-1 and table-2 as CSV, tables.md, and the figures as PNG and SVG, with their numbers as CSV.\n\n\
    Exit status: 0 all fits below 2 px of noise converged inside their bounds; 1 some did not; 2 it could not run.")]
pub struct PaperArgs {
    #[command(flatten)]
    pub results: Results,
    /// Draws of the noise at each level.
    #[arg(long, value_name = "N", default_value_t = 20, allow_negative_numbers = true)]
    pub seeds: usize,
    /// Seed of the first draw, of speckles and of the noise of images.
    #[arg(long, default_value_t = 1, allow_negative_numbers = true)]
    pub seed: u64,
    #[command(flatten)]
    pub threads: Threads,
    #[command(flatten)]
    pub drawn: Drawn,
}

/// Arguments of `quadrille demo`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  quadrille demo --output out/demo && xdg-open out/demo/run/report.html\n  \
    quadrille demo --laws --output out/laws        six laws on the same images, side by side in the report")]
pub struct DemoArgs {
    /// Folder for images and results.
    #[arg(short, long, value_name = "DIR", default_value = "out/demo")]
    pub output: PathBuf,
    /// Seed of speckles and noise: changes the images, not the conclusion.
    #[arg(long, default_value_t = 1, allow_negative_numbers = true)]
    pub seed: u64,
    /// Fit these laws too and put them side by side in the report; one of each kind when none is named.
    #[arg(long, value_name = "LAW,LAW,...", value_delimiter = ',', num_args = 0..=1,
        default_missing_values = USUAL_LAWS)]
    pub laws: Vec<String>,
    #[command(flatten)]
    pub threads: Threads,
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

/// Arguments of `quadrille specimen`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  \
    quadrille specimen dcb --output dcb && quadrille simulate dcb/case.toml --output dcb/out\n\n\
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
    #[command(flatten)]
    pub results: Results,
    #[command(flatten)]
    pub threads: Threads,
    #[command(flatten)]
    pub talk: Quiet,
    #[command(flatten)]
    pub drawn: Drawn,
}

/// Arguments of `quadrille identify`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  \
    quadrille identify joint.toml --output out/fit\n\n\
    Exit status: 0 the fit converged; 1 it did not, the best point is in DIR/fit.json; 2 it could not run; 130 Ctrl-C or
\
    SIGTERM, the best point is in DIR/fit.json.")]
pub struct IdentifyArgs {
    /// The case file (TOML): the tables of `quadrille simulate` with [measurement] and [fit]; or [[test]] tables, each with
    /// the case of one test, beside the [fit] that all share. Names of files in it are relative to its folder.
    #[arg(value_name = "CASE.toml")]
    pub case: PathBuf,
    #[command(flatten)]
    pub results: Results,
    #[command(flatten)]
    pub threads: Threads,
    #[command(flatten)]
    pub limits: FitLimits,
    #[command(flatten)]
    pub talk: Quiet,
    /// How progress is written to stderr: as text, or as one JSON object a line for other programs.
    #[arg(long, value_name = "text|json", default_value = "text")]
    pub progress: ProgressKind,
    #[command(flatten)]
    pub drawn: Drawn,
}

/// Arguments of `quadrille tournament`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  \
    quadrille tournament joint.toml --laws extended-xu-needleman,bilinear-power,trapezoidal-power --output out/laws\n\n\
    It writes tournament.json, tournament-tractions.csv, tournament.html and figures.\n\n\
    Exit status: 0 all fits converged and a law is left; 1 one did not, or the data reject all laws; 2 it could not run;\n\
    130 Ctrl-C or SIGTERM.")]
pub struct TournamentArgs {
    /// The case file of `quadrille identify`; its law starts the others.
    #[arg(value_name = "CASE.toml")]
    pub case: PathBuf,
    /// The laws, by the names that [cohesive] model takes. Default: [fit] laws of the case.
    #[arg(long, value_name = "LAW,LAW,...", value_delimiter = ',')]
    pub laws: Vec<String>,
    #[command(flatten)]
    pub results: Results,
    #[command(flatten)]
    pub threads: Threads,
    #[command(flatten)]
    pub limits: FitLimits,
    #[command(flatten)]
    pub talk: Quiet,
    /// How progress is written to stderr: as text, or as one JSON object a line for other programs.
    #[arg(long, value_name = "text|json", default_value = "text")]
    pub progress: ProgressKind,
    #[command(flatten)]
    pub drawn: Drawn,
}

/// Arguments of `quadrille sweep`.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  \
    quadrille sweep joint.toml --values 3,4,5,6 --output out/sweep\n\n\
    The time limit holds for all fits together: what was computed until then is kept.\n\n\
    Exit status: 0 all fits converged; 1 some did not, or were not begun; 2 it could not run; 130 stopped by Ctrl-C or \
    SIGTERM.")]
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
    #[command(flatten)]
    pub results: Results,
    #[command(flatten)]
    pub threads: Threads,
    #[command(flatten)]
    pub limits: FitLimits,
    #[command(flatten)]
    pub talk: Quiet,
    #[command(flatten)]
    pub drawn: Drawn,
}
