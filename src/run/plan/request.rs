//! What is asked for over a case.

use crate::backend::choice::DeviceChoice;
use crate::backend::gpu::GpuOptions;
use crate::io::case::{CaseCamera, CaseCorrelation, CaseImages, CrackFlags, ZoneFlags};
use crate::run::plan::Shard;
use std::fmt;
use std::str::FromStr;

/// A table of values per frame that is written beside the store.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum Export {
    /// DIR/csv/NNNNNN.csv: one row per measured node.
    Csv,
    /// DIR/vtu/NNNNNN.vtu and DIR/series.pvd for ParaView.
    Vtu,
    /// Nothing beside run.toml, summary.json and fields.zarr.
    None,
}

impl Export {
    /// Name used in options and files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Csv => "csv",
            Self::Vtu => "vtu",
            Self::None => "none",
        }
    }
}

impl FromStr for Export {
    type Err = String;

    fn from_str(word: &str) -> Result<Self, String> {
        let named = [Self::Csv, Self::Vtu, Self::None].into_iter().find(|table| table.name() == word);
        named.ok_or_else(|| format!("export is `{word}`; give csv, vtu or none"))
    }
}

impl fmt::Display for Export {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// What is asked for over a case, as by the flags of `quadrille correlate`: it wins over what the case says. The
/// default changes nothing. Names of files start at the current folder.
#[derive(Debug, Clone, Default)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Request {
    /// Over `[images]`.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub images: CaseImages,
    /// In place of `[camera]`.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub camera: CaseCamera,
    /// In place of all `[[zone]]`.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub zones: ZoneFlags,
    /// Paths in place of all `[[crack]]`, and what holds for all of them.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub cracks: CrackFlags,
    /// Over `[correlation]`.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub correlation: CaseCorrelation,
    /// Tables per frame beside the store: csv,vtu, or none. Default csv,vtu up to 1000 frames and none above (or what
    /// the run.toml given as --case wrote). `quadrille export` makes them later.
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "csv,vtu|none", value_delimiter = ',', help_heading = "Output")
    )]
    pub export: Option<Vec<Export>>,
    /// Write no DIR/report.html at the end. `--export none` leaves it out as well.
    #[cfg_attr(feature = "cli", arg(long, help_heading = "Output"))]
    pub no_report: bool,
    /// Do this share of the frames only: I of N processes that write into one folder, frames I, I+N, I+2N, ... `slurm`
    /// takes the place of the task in its array. Needs --start independent, which is then the default.
    #[cfg_attr(feature = "cli", arg(long, value_name = "I/N|slurm", hide_short_help = true, help_heading = "Machine"))]
    pub shard: Option<Shard>,
    /// Pixel work: auto, cpu, gpu, or one of `quadrille about devices`, by its number or part of its name. `auto` takes
    /// a discrete GPU for 200 megapixels of frames or more, else the CPU; `gpu` also an integrated or a software one.
    #[cfg_attr(
        feature = "cli",
        arg(
            long,
            value_name = "auto|cpu|gpu|NAME|INDEX",
            env = "QUADRILLE_DEVICE",
            default_value = "auto",
            help_heading = "Machine"
        )
    )]
    pub device: DeviceChoice,
    /// How a graphics device is opened.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub gpu: GpuOptions,
    /// Instruction path of the CPU: avx512, avx2, baseline, scalar. Default: that of the run.toml given as --case,
    /// else the fastest there is. Results differ in the last bits between paths.
    #[cfg_attr(feature = "cli", arg(long, value_name = "NAME", hide_short_help = true, help_heading = "Machine"))]
    pub isa: Option<String>,
}
