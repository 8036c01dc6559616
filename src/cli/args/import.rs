//! What `quadrille import` takes.

use super::shared::{Quiet, Results};
use crate::field::StrainDefinition;
use crate::io::foreign::{Layout, LengthUnit, YAxis};
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// Where the positions of a table are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Coordinates {
    /// In the reference state.
    Reference,
    /// In the deformed state: the displacement is taken off.
    Deformed,
}

#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    A series that VIC-2D exported, noise from a picture at rest:\n    \
    quadrille import 'vic/step_*.csv' --static vic/rest.csv --output out\n  \
    Nodemaps of ARAMIS, which are in mm:\n    \
    quadrille import 'stage_*.txt' --pixel-size 0.05 --sigma 0.02 --output out\n\n\
    Exit status: 0 fine; 1 a frame has no valid point; 2 nothing could be imported.")]
pub struct ImportArgs {
    /// Tables (csv, txt, dat) with a frame each, or an archive of arrays (npz): names or quoted globs, in order.
    #[arg(value_name = "FILES", required = true)]
    pub files: Vec<String>,
    /// Layout of the files: quadrille, dice, matchid, nodemap, pyaldic, davis, vic-2d, table. Default: recognised by
    /// the names of the columns.
    #[arg(long, value_name = "NAME", help_heading = "Input")]
    pub layout: Option<&'static Layout>,
    /// Unit that the files do not name: px, um, mm, m, inch.
    #[arg(long, value_name = "px|mm|..", help_heading = "Input")]
    pub unit: Option<LengthUnit>,
    /// Where y points in the files: up or down. Default: as in the layout.
    #[arg(long, value_name = "up|down", help_heading = "Input")]
    pub y: Option<YAxis>,
    /// Whether positions are those of the reference or of the deformed state.
    #[arg(long, value_name = "reference|deformed", default_value = "reference", help_heading = "Input")]
    pub coordinates: Coordinates,
    /// Size of a pixel on the specimen, mm: files in lengths need it.
    #[arg(long, value_name = "MM", allow_hyphen_values = true, help_heading = "Input")]
    pub pixel_size: Option<f64>,
    /// The reference image, over which the fields are drawn.
    #[arg(long, value_name = "FILE", help_heading = "Input")]
    pub reference: Option<PathBuf>,
    /// Standard uncertainty of each displacement component, px. Default: from `--static`, else from the files.
    #[arg(long, value_name = "PX", allow_hyphen_values = true, help_heading = "Noise")]
    pub sigma: Option<f64>,
    /// Fields of the specimen at rest, in the same layout: their scatter about a plane is the standard uncertainty.
    #[arg(long = "static", value_name = "FILE", help_heading = "Noise")]
    pub at_rest: Vec<String>,
    /// Definition of the strains.
    #[arg(
        long,
        value_name = "infinitesimal|green-lagrange|hencky",
        default_value = "infinitesimal",
        help_heading = "Output"
    )]
    pub strain: StrainDefinition,
    #[command(flatten)]
    pub results: Results,
    #[command(flatten)]
    pub talk: Quiet,
}
