//! What the commands of a bonded joint take.

use super::series::ProgressKind;
use super::shared::{Drawn, FitLimits, Quiet, Results, Threads};
use super::words::{Prescribed, law, sweep};
use crate::backend::choice::DeviceChoice;
use crate::mechanics::cohesive::USUAL_LAWS;
use clap::Args;
use std::path::PathBuf;

#[derive(Debug, Args)]
#[command(after_help = "Example:\n  \
    quadrille make virtual-test --output test && quadrille run test/case.toml --output test/run\n\n\
    Steps already done with the same images and options are not done again. DIR/report.html shows everything; the measured\n\
    fields are in DIR/correlation.\n\n\
    Exit status: 0 all is there; 1 a frame or the fit did not converge, or --max-seconds was reached; 2 nothing could be
\
    run; 130 Ctrl-C or SIGTERM: what is done is kept, the best point of the fit too.")]
pub struct RunArgs {
    /// The case file (TOML): [images], [correlation], two [[zone]], [interface], [substrate], [cohesive],
    /// [measurement], [fit]. Names of files in it are relative to its folder.
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
    /// Experimental: fit these laws too and put them side by side in the report; one of each kind when none is named.
    #[arg(long, value_name = "LAW,LAW,...", value_delimiter = ',', num_args = 0..=1,
        default_missing_values = USUAL_LAWS)]
    pub laws: Vec<String>,
    #[command(flatten)]
    pub threads: Threads,
    #[command(flatten)]
    pub talk: Quiet,
}

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

#[derive(Debug, Args)]
#[command(after_help = "Example of a case file:\n  \
    [reduction]\n  layout = \"dcb\"\n  run = \"out\"\n  sections = [\"upper pin\", \"lower pin\"]\n  tip = [620, 512]\n  \
    width_mm = 25.0\n  arm_mm = 6.0\n  crack_mm = 50.0\n  [load]\n  file = \"machine.csv\"\n  \
    [[opening]]\n  zones = [\"upper\", \"lower\"]\n  [[region]]\n  name = \"upper pin\"\n  roi = [40, 380, 120, 480]\n  ...\n\n\
    Exit status: 0 the test is reduced; 2 nothing could be done.")]
pub struct ReduceArgs {
    /// The case file (TOML): [reduction], and for the fields of a run [load], [[opening]] and [[region]]. Names of files
    /// in it are relative to its folder.
    #[arg(value_name = "CASE.toml")]
    pub case: PathBuf,
    #[command(flatten)]
    pub results: Results,
    #[command(flatten)]
    pub talk: Quiet,
    #[command(flatten)]
    pub drawn: Drawn,
}

#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    quadrille identify joint.toml --output out/fit\n  \
    Fits with one parameter prescribed at several values:\n    \
    quadrille identify joint.toml --sweep r=3,4,5,6 --output out/sweep\n  \
    Several laws on the same data:\n    \
    quadrille identify joint.toml --tournament xu-needleman,bilinear-power --output out/laws\n\n\
    A fit writes fit.json, tables and figures; a sweep writes sweep.json, sweep.csv and figures; a tournament writes\n\
    tournament.json, tournament-tractions.csv, report.html and figures.\n\n\
    Exit status: 0 all fits converged, and the data leave a law; 1 one did not, the best point so far is kept; or the\n\
    data reject all laws; 2 it could not run; 130 Ctrl-C or SIGTERM, the best point so far is kept.")]
pub struct IdentifyArgs {
    /// The case file (TOML): the tables of `quadrille simulate` with [measurement] and [fit]; or [[test]] tables, each
    /// with the case of one test, beside the [fit] that all share. Names of files in it are relative to its
    /// folder.
    #[arg(value_name = "CASE.toml")]
    pub case: PathBuf,
    /// Fit once for each value of a parameter that is prescribed. Alone: the table [fit.sweep] of the case. A limit of
    /// time holds for all fits together.
    #[arg(long, value_name = "NAME=X,X,...", num_args = 0..=1, value_parser = sweep,
        conflicts_with_all = ["tournament", "progress"])]
    pub sweep: Option<Option<Prescribed>>,
    /// Experimental: fit several laws and compare them. The law of the case starts the others. Alone: [fit] laws of
    /// the case.
    #[arg(long, value_name = "LAW,LAW,...", num_args = 0..=1, value_delimiter = ',', value_parser = law)]
    pub tournament: Option<Vec<String>>,
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
