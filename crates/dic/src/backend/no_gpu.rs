//! What stands for graphics devices in a build without the feature `gpu`: there is none.

pub use super::adapter::{AdapterKind, Adapters, GpuAdapter, GpuOptions};

use super::check::DeviceCheck;
use super::{BackendError, OnDevice};
use std::convert::Infallible;

/// No adapter is ever made.
pub(super) type Handle = Infallible;

/// The adapters of this machine, of which this build can use none.
pub fn adapters() -> Adapters {
    Adapters { list: Vec::new(), reason: Some(super::choice::BUILT_WITHOUT.into()), built_without: true }
}

impl GpuAdapter {
    /// What could be done with one, were there any.
    pub fn never(&self) -> ! {
        match self.handle {}
    }
}

/// Of none there is anything to be found.
///
/// # Errors
/// None.
pub fn check(adapter: &GpuAdapter, _: &GpuOptions) -> Result<DeviceCheck, BackendError> {
    adapter.never()
}

pub(super) fn open<W: OnDevice>(adapter: &GpuAdapter, _: &GpuOptions, _: W) -> Result<W::Output, BackendError> {
    adapter.never()
}
