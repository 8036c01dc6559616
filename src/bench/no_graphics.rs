//! What stands for the measurement of graphics devices in a build without them.

use super::record::Measured;
use super::{BenchError, DeviceRecord};
use crate::backend::gpu::GpuAdapter;

pub(super) fn open(adapter: &GpuAdapter) -> Result<(Box<dyn Measured>, DeviceRecord), BenchError> {
    adapter.never()
}
