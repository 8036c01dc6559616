//! An adapter as its driver gives it.

/// The driver's own.
pub(in crate::backend) type Handle = wgpu::Adapter;
