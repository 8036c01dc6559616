//! What `quadrille compare` takes.

use super::shared::Quiet;
use crate::cli::look::frames::Frames;
use crate::io::case::flags::numbers;
use crate::io::foreign::{LengthUnit, YAxis};
use clap::Args;
use std::path::PathBuf;

#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    The last frame and a VTU file with displacements in mm, its origin at the pixel (120, 940):\n    \
    quadrille compare out model.vtu --origin 120,940\n  \
    Abaqus: the input file and a report of U1 and U2 by node:\n    \
    quadrille compare out job.inp --displacements job.rpt --origin 120,940 --remove-rigid\n\n\
    Writes DIR/comparison/NNNNNN.csv, .json and maps. Exit status: 0 fine; 1 some frame named by --frames has no field; \
    2 nothing could be compared.")]
pub struct CompareArgs {
    /// Folder of a run of `quadrille correlate` or `quadrille import`.
    #[arg(value_name = "DIR")]
    pub run: PathBuf,
    /// The model: .vtu with displacements, a mesh (.vtu, .msh, .inp) with --displacements, or a table of x, y, u, v.
    #[arg(value_name = "MODEL")]
    pub model: PathBuf,
    /// Table of the displacements of its nodes: node, ux, uy; or a report of Abaqus.
    #[arg(long, value_name = "FILE", help_heading = "Input")]
    pub displacements: Option<PathBuf>,
    /// Pixel of the reference image at which the origin of the model is.
    #[arg(long, value_name = "x,y", value_parser = numbers::<2>, default_value = "0,0", allow_hyphen_values = true, help_heading = "Input")]
    pub origin: [f64; 2],
    /// Angle from the x axis of the image to that of a mesh, degrees, counter-clockwise.
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_hyphen_values = true, help_heading = "Input")]
    pub turn: f64,
    /// Unit of the model: mm (default of a mesh), um, m, inch; of a table also px.
    #[arg(long, value_name = "mm|m|..", help_heading = "Input")]
    pub unit: Option<LengthUnit>,
    /// Where y points in a table, up or down; in a mesh it points up.
    #[arg(long, value_name = "up|down", help_heading = "Input")]
    pub y: Option<YAxis>,
    /// Take the rigid motion that fits the difference best off it.
    #[arg(long, help_heading = "Quantities")]
    pub remove_rigid: bool,
    /// Frames: numbers from 1 and ranges such as 1,5-20; last; or all.
    #[arg(long, value_name = "1,5-20|last|all", default_value = "last")]
    pub frames: Frames,
    /// Folder for `comparison/`. Default: DIR.
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    #[command(flatten)]
    pub talk: Quiet,
}
