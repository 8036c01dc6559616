//! What `studio` takes.

use super::shared::{Quiet, Threads};
use crate::backend::choice::DeviceChoice;
use clap::Args;
use std::path::PathBuf;

#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    The images of this folder:\n    \
    quadrille studio\n  \
    Those of a folder of another machine, seen from here; then open the address that is printed:\n    \
    ssh -L 8765:127.0.0.1:8765 ANNA-PC quadrille studio --port 8765 test7\n\n\
    Prints an address for a browser on this machine. There the images are shown in order; choose the reference, draw zones, cracks, \
    gauges and a scale on it, see texture and expected uncertainty while you draw, and follow the run frame by frame to its results. \
    Nothing outside the folder is read or written, no other machine is contacted, and only requests with the token in the address \
    are answered. All of it is kept in a case file, which `quadrille correlate --case FILE` (with a joint: `quadrille run FILE`) \
    repeats.")]
pub struct StudioArgs {
    /// Folder of the images.
    #[arg(value_name = "FOLDER", default_value = ".")]
    pub folder: PathBuf,
    /// Port of 127.0.0.1. Default: one that is free.
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    pub port: u16,
    /// Name of the case file in the folder.
    #[arg(long, value_name = "NAME", default_value = "case.toml")]
    pub case: PathBuf,
    /// Name of the folder of the results in it.
    #[arg(short, long, value_name = "NAME", default_value = "out")]
    pub output: PathBuf,
    /// Device: auto, cpu, gpu, the number of an adapter, or part of its name.
    #[arg(long, value_name = "auto|cpu|gpu|NAME|INDEX", env = "QUADRILLE_DEVICE", default_value = "auto")]
    pub device: DeviceChoice,
    #[command(flatten)]
    pub threads: Threads,
    #[command(flatten)]
    pub talk: Quiet,
}
