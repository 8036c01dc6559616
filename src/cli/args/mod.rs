//! The command line, as the user types it.

mod about;
mod compare;
mod fields;
mod groups;
mod import;
mod joint;
mod keys;
mod make;
mod reference;
mod series;
mod shared;
mod studio;
mod words;

pub use about::*;
pub use compare::*;
pub use fields::*;
pub use groups::{grouped, short_help};
pub use import::*;
pub use joint::*;
pub use keys::name_flags;
pub use make::*;
pub use reference::command_reference;
pub use series::*;
pub use shared::*;
pub use studio::*;
pub use words::Prescribed;

use clap::{Parser, Subcommand, ValueEnum};
use std::ffi::OsString;

/// Displacement fields of tested materials from image series, by global Q4 image correlation.
#[derive(Debug, Parser)]
#[command(name = "quadrille", version, propagate_version = true, arg_required_else_help = true)]
#[command(after_help = "Start with `quadrille demo`, which needs no data, or with your own images:\n  \
    quadrille correlate --output out ref.tif 'frames/*.tif'")]
pub struct Cli {
    #[command(subcommand)]
    pub command: Command,
    /// Whether statuses are coloured: on a terminal (auto; not where NO_COLOR is set), always, or never.
    #[arg(long, global = true, value_name = "auto|always|never", default_value = "auto", hide_short_help = true)]
    pub color: ColorChoice,
}

/// Whether words are coloured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ColorChoice {
    /// On a terminal.
    Auto,
    /// Everywhere.
    Always,
    /// Nowhere.
    Never,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Measure displacement fields: one reference image, any number of deformed ones.
    Correlate(Box<CorrelateArgs>),
    /// Measure while the test runs: correlate images as a camera writes them into a folder.
    Watch(Box<WatchArgs>),
    /// Find lens, tilt and scale of the camera: on the specimen moved by hand, on a target, or by points and lengths.
    Calibrate(Box<CalibrateArgs>),
    /// Show how far a run is: frames done, failed and missing, its rate, and who works on it.
    Status(StatusArgs),
    /// Write the scripts that spread a series over a Slurm cluster.
    Slurm(SlurmArgs),
    /// Make tables, ParaView, NumPy or MATLAB files of the fields of a run.
    Export(ExportArgs),
    /// Take in the displacement fields of another program (VIC-2D, MatchID, ARAMIS, DICe, ...) as a run.
    Import(ImportArgs),
    /// Lay the displacements of a finite-element model over a measured field: difference, map and number.
    Compare(CompareArgs),
    /// Read numbers from the fields of a run: points, lines, extensometers, regions, openings.
    Probe(Box<ProbeArgs>),
    /// Draw the fields of a run as PNG or SVG: maps over the image, meshes, profiles along a line.
    Figures(FiguresArgs),
    /// From a folder of images to results in a browser: draw, check, run, look; all of it is kept in a case file.
    Studio(StudioArgs),
    /// Make a page to explore the fields of a run in any browser.
    View(ViewArgs),
    /// From the images of a virtual test to the law of its adhesive, compared with the truth; needs no data.
    Demo(DemoArgs),
    /// Measure noise, texture, uncertainty and resolution on your own image, and recommend an element size.
    Metrology(MetrologyArgs),
    /// Compute the displacements and tractions of a cohesive joint whose border moves as measured.
    Simulate(SimulateArgs),
    /// Find the parameters of the adhesive's law from measured displacements, with their uncertainty; compare laws.
    Identify(IdentifyArgs),
    /// From images to the law of an adhesive: correlate, identify, report; from one case file.
    Run(RunArgs),
    /// J, energy release rates by the standards and the traction from images and loads, without a model.
    Reduce(ReduceArgs),
    /// Make something to begin with: speckle images, a virtual test, a specimen, a page to draw zones on; repeat the
    /// paper.
    Make(MakeArgs),
    /// About the program: devices, keys of case files, commands, completions for shells, pages of `man`, licences.
    About(AboutArgs),
}

/// The arguments with `every N` as one: a value of two words, which are told from the images that may follow.
pub fn join_every(arguments: impl IntoIterator<Item = OsString>) -> Vec<OsString> {
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
