//! What stands for the measurement of graphics devices in a build without them.

use super::BenchError;
use super::measured::{DeviceRecord, Measured};
use crate::backend::gpu::GpuAdapter;

pub(super) fn open(adapter: &GpuAdapter) -> Result<(Box<dyn Measured>, DeviceRecord), BenchError> {
    adapter.never()
}
