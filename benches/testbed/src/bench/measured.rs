//! A device that is measured, and its figures.

use super::{BenchError, Clock, Plan, Scene, SizeCost, StartUp, Subject, size_cost};
use serde::Serialize;

/// Figures of one device.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DeviceRecord {
    /// Its name and driver, or instruction path.
    pub device: String,
    /// What it is.
    pub kind: &'static str,
    /// What its figures are read from.
    pub clock: Clock,
    /// Bytes read and written by long copies, 1e9 per second: by one core on the processor's clock, else by all of it.
    pub copy_gb_per_s: f64,
    /// What comes once.
    pub start_up: Option<StartUp>,
    /// Size by size.
    pub sizes: Vec<SizeCost>,
}

/// A device that is open, whichever it is.
pub(super) trait Measured {
    fn size_cost(&self, scene: &Scene, plan: &Plan, copy_rate: f64) -> Result<SizeCost, BenchError>;
}

impl<B: Subject> Measured for B {
    fn size_cost(&self, scene: &Scene, plan: &Plan, copy_rate: f64) -> Result<SizeCost, BenchError> {
        size_cost(self, scene, plan, copy_rate)
    }
}

/// What is measured of a device before its first image.
pub(super) fn opened<B: Subject>(
    backend: B,
    kind: &'static str,
    start_up: Option<StartUp>,
) -> Result<(Box<dyn Measured>, DeviceRecord), BenchError> {
    let (device, clock, copy_gb_per_s) = (backend.device(), backend.clock(), 1e-9 * backend.copy_rate()?);
    Ok((Box::new(backend), DeviceRecord { device, kind, clock, copy_gb_per_s, start_up, sizes: Vec::new() }))
}
