//! What a reference knows of pixels side by side.

#![allow(unsafe_code, reason = "lanes are plain values")]

use bytemuck::{Pod, Zeroable};

/// `L` neighbouring pixels of a row: grey levels less the offset, and the gradient in whole units. Zero where a lane
/// belongs to no element.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub(super) struct Lanes<const L: usize> {
    pub f: [f32; L],
    pub fx: [i16; L],
    pub fy: [i16; L],
}

// SAFETY: numbers alone, all of them 0.
unsafe impl<const L: usize> Zeroable for Lanes<L> {}
// SAFETY: numbers alone, for which all bits will do; those of four bytes first, and as many bytes of the others:
// nothing between them or behind.
unsafe impl<const L: usize> Pod for Lanes<L> {}
