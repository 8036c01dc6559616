//! What passes over the pixels of elements have in common: what they are given, and what they leave.

use super::lanes::Lanes;
use super::plane::{Plane, View};
use super::reference::Reference;
use crate::isa::{Isa, Path};
use crate::mesh::{ElementPixels, PixelMap};

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
    /// With the right-hand side, summed in units of the gradient, in grey levels: no digit changes, since a unit is a
    /// power of two.
    #[inline(always)]
    pub fn times_unit(mut self, unit: f32) -> Self {
        for b in &mut self.b {
            *b *= unit;
        }
        self
    }
}

/// Everything a kernel call needs besides the elements themselves.
pub(super) struct Pass<'a, const L: usize> {
    reference: &'a Reference,
    pub map: &'a PixelMap,
    /// The pixels of all elements.
    lanes: &'a [Lanes<L>],
    /// Of the gradient.
    pub unit: f32,
    pub deformed: View<'a>,
    pub scalar: bool,
}

impl<'a, const L: usize> Pass<'a, L> {
    pub fn new(isa: Isa, reference: &'a Reference, deformed: &'a Plane) -> Self {
        Self {
            reference,
            map: &reference.map,
            lanes: reference.lanes(),
            unit: reference.unit,
            deformed: deformed.view(),
            scalar: isa.path() == Path::Scalar,
        }
    }

    /// An element and its pixels.
    #[inline(always)]
    pub fn element(&self, element: usize) -> (&'a ElementPixels, &'a [Lanes<L>]) {
        (&self.reference.elements[element], &self.lanes[self.reference.range(element)])
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
