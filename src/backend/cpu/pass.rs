//! What passes over the pixels of elements have in common: what they are given, and what they leave.

use super::gradient::Gradient;
use super::plane::{Plane, View};
use crate::isa::{Isa, Path};
use crate::mesh::{ElementPixels, PixelMap};
use std::sync::Arc;

/// A reference image at one scale with its elements.
#[derive(Debug)]
pub(super) struct Reference {
    pub f: Plane,
    pub gradient: Gradient,
    /// The pixels of each element; none for those left out.
    pub elements: Vec<ElementPixels>,
    /// The runs of those that are no rectangle.
    pub map: Arc<PixelMap>,
}

/// Sums of one element, as the kernel leaves them.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[repr(C)]
pub(super) struct ElementSums {
    /// Right-hand side, unknown `2 k + c` of corner k.
    pub b: [f32; 8],
    /// Pixels counted; those at the edge of the deformed image by their weight.
    pub n: f32,
    /// Sums of r^2, g, g^2, f g over the pixels counted.
    pub rr: f32,
    pub g: f32,
    pub gg: f32,
    pub fg: f32,
    /// Sums of f, f^2 over the pixels not counted.
    pub f_lost: f32,
    pub ff_lost: f32,
}

impl ElementSums {
    /// With the right-hand side, summed in units of the gradient, in grey levels: no digit changes, since a unit is a power of two.
    #[inline(always)]
    pub fn times_unit(mut self, unit: f32) -> Self {
        for b in &mut self.b {
            *b *= unit;
        }
        self
    }
}

/// Everything a kernel call needs besides the elements themselves.
pub(super) struct Pass<'a> {
    pub elements: &'a [ElementPixels],
    pub map: &'a PixelMap,
    pub f: View<'a>,
    pub fx: View<'a, i16>,
    pub fy: View<'a, i16>,
    /// Of the gradient.
    pub unit: f32,
    pub deformed: View<'a>,
    pub scalar: bool,
}

impl<'a> Pass<'a> {
    pub fn new(isa: Isa, reference: &'a Reference, deformed: &'a Plane) -> Self {
        Self {
            elements: &reference.elements,
            map: &reference.map,
            f: reference.f.view(),
            fx: reference.gradient.x.view(),
            fy: reference.gradient.y.view(),
            unit: reference.gradient.unit,
            deformed: deformed.view(),
            scalar: isa.path() == Path::Scalar,
        }
    }
}

/// Sum of the lanes, pairwise.
#[inline(always)]
pub(super) fn total<const L: usize>(lanes: &[f32; L]) -> f32 {
    let mut part = *lanes;
    let mut n = L;
    while n > 1 {
        n /= 2;
        for i in 0..n {
            part[i] += part[i + n];
        }
    }
    part[0]
}

/// Local coordinates and lane mask of a chunk of columns.
#[inline(always)]
pub(super) fn chunk<const L: usize>(element: &ElementPixels, column: usize) -> (usize, [f32; L], [f32; L]) {
    let lanes = (element.nx as usize - column).min(L);
    let (mut xi, mut mask) = ([0.0; L], [0.0; L]);
    for i in 0..L {
        xi[i] = element.xi0 + (column + i) as f32 * element.dxi;
        mask[i] = if i < lanes { 1.0 } else { 0.0 };
    }
    (lanes, xi, mask)
}
