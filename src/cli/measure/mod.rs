//! Commands that measure displacement fields, and what images allow to measure.

pub(crate) mod calibrate;
pub(crate) mod correlate;
mod gauges;
pub(crate) mod metrology;
pub(crate) mod slurm;
pub(crate) mod status;
pub(crate) mod watch;
