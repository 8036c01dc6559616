//! What varies over an element bilinearly between its corners: the displacement, and light. Along a row of pixels it is
//! affine.

use super::plane::{Plane, View};
use super::sample::{place, weight};
use crate::isa::mul_add;
use crate::mesh::ElementPixels;

/// The displacement of an element's corners: whole pixels plus the rest, in the order of its nodes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Corners {
    pub whole: [i32; 2],
    pub x: [f32; 4],
    pub y: [f32; 4],
}

impl Corners {
    /// Splits the corner displacements so that the rest lies within 0..1 at the element's centre.
    pub fn new(displacement: [[f64; 2]; 4]) -> Self {
        let mean = |c: usize| displacement.iter().map(|u| u[c]).sum::<f64>() / 4.0;
        // A wild field must not overflow; such pixels are outside any image.
        let whole = [0, 1].map(|c| mean(c).floor().clamp(-1e6, 1e6));
        Self {
            whole: whole.map(|w| w as i32),
            x: displacement.map(|u| (u[0] - whole[0]) as f32),
            y: displacement.map(|u| (u[1] - whole[1]) as f32),
        }
    }

    /// Displacement (less the whole offset) at lanes anywhere in the element.
    #[inline(always)]
    pub fn displacement<const FMA: bool, const L: usize>(&self, xi: &[f32; L], eta: &[f32; L]) -> [[f32; L]; 2] {
        [bilinear::<FMA, L>(&self.x, xi, eta), bilinear::<FMA, L>(&self.y, xi, eta)]
    }

    /// Whether the pixels of an element all land beyond one side of the deformed image.
    #[inline(always)]
    pub fn is_outside(&self, element: &ElementPixels, deformed: View<'_>) -> bool {
        // What is bilinear lies between its corners; the margin is more than the round-off of `f32` and what still
        // counts.
        const MARGIN: f32 = 0.5;
        let beyond = |first: i32, n: u16, u: &[f32; 4], size: usize| {
            let (low, high) = u.iter().fold((f32::MAX, f32::MIN), |(low, high), u| (low.min(*u), high.max(*u)));
            // In whole pixels, rounded outwards: the sum would lose the fraction far from zero.
            let last = (first + i32::from(n) - 1).saturating_add((high + MARGIN).ceil() as i32);
            last < 0 || first.saturating_add((low - MARGIN).floor() as i32) > size as i32 - 1
        };
        // What is no number is seen by the kernel.
        self.x.iter().chain(&self.y).all(|u| u.is_finite())
            && (beyond(element.x + self.whole[0], element.nx, &self.x, deformed.width)
                || beyond(element.y + self.whole[1], element.ny, &self.y, deformed.height))
    }

    /// How much the pixels from column `x` on in row `y`, at (xi, eta) of the element, count in the deformed image.
    #[inline(always)]
    pub fn weights<const L: usize>(&self, x: i32, y: i32, xi: &[f32; L], eta: f32, deformed: &Plane) -> [f32; L] {
        let [ux, uy] = self.displacement::<false, L>(xi, &[eta; L]);
        let mut weights = [0.0; L];
        for i in 0..L {
            let ((px, tx), (py, ty)) = (place(x + i as i32 + self.whole[0], ux[i]), place(y + self.whole[1], uy[i]));
            weights[i] = weight(px, tx, deformed.width) * weight(py, ty, deformed.height);
        }
        weights
    }
}

/// Light on an element: gain and offset at its corners, in the order of its nodes, bilinear between them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Light {
    pub gain: [f32; 4],
    pub offset: [f32; 4],
}

impl Light {
    /// That leaves grey levels as they are.
    pub const NONE: Self = Self { gain: [1.0; 4], offset: [0.0; 4] };
}

/// How lanes of the deformed image are brought to the light of the reference, before the transfer.
pub(super) trait Brings: Copy {
    /// A row of lanes at `eta`.
    fn row<const FMA: bool, const L: usize>(self, xi: &[f32; L], eta: f32, g: &mut [f32; L]);

    /// Lanes anywhere in the element.
    fn lanes<const FMA: bool, const L: usize>(self, xi: &[f32; L], eta: &[f32; L], g: &mut [f32; L]);
}

/// As it is.
#[derive(Clone, Copy)]
pub(super) struct AsItIs;

impl Brings for AsItIs {
    #[inline(always)]
    fn row<const FMA: bool, const L: usize>(self, _: &[f32; L], _: f32, _: &mut [f32; L]) {}

    #[inline(always)]
    fn lanes<const FMA: bool, const L: usize>(self, _: &[f32; L], _: &[f32; L], _: &mut [f32; L]) {}
}

impl Brings for &Light {
    #[inline(always)]
    fn row<const FMA: bool, const L: usize>(self, xi: &[f32; L], eta: f32, g: &mut [f32; L]) {
        let ((gain, by), (offset, of)) = (along_row(&self.gain, eta), along_row(&self.offset, eta));
        for i in 0..L {
            g[i] = mul_add::<FMA>(mul_add::<FMA>(xi[i], by, gain), g[i], mul_add::<FMA>(xi[i], of, offset));
        }
    }

    #[inline(always)]
    fn lanes<const FMA: bool, const L: usize>(self, xi: &[f32; L], eta: &[f32; L], g: &mut [f32; L]) {
        let gain = bilinear::<FMA, L>(&self.gain, xi, eta);
        let offset = bilinear::<FMA, L>(&self.offset, xi, eta);
        for i in 0..L {
            g[i] = mul_add::<FMA>(gain[i], g[i], offset[i]);
        }
    }
}

/// What is bilinear between its values at the corners, in lanes anywhere in the element. No `map` over arrays here: it
/// is compiled by itself, without the vector instructions of the kernel.
#[inline(always)]
pub(super) fn bilinear<const FMA: bool, const L: usize>(corner: &[f32; 4], xi: &[f32; L], eta: &[f32; L]) -> [f32; L] {
    let [a, b, c, d] = *corner;
    let (across, down, twist) = (b - a, d - a, a - b + c - d);
    let mut value = [0.0; L];
    for i in 0..L {
        let slope = mul_add::<FMA>(eta[i], twist, across);
        value[i] = mul_add::<FMA>(xi[i], slope, mul_add::<FMA>(eta[i], down, a));
    }
    value
}

/// Affine run of the displacement along row `eta`: its value at xi = 0 and its change to xi = 1.
#[inline(always)]
pub(super) fn along_row(corner: &[f32; 4], eta: f32) -> (f32, f32) {
    let left = corner[0] + eta * (corner[3] - corner[0]);
    let right = corner[1] + eta * (corner[2] - corner[1]);
    (left, right - left)
}

/// Displacement (less the whole offset) of a row of lanes at `eta`.
#[inline(always)]
pub(super) fn row_displacement<const FMA: bool, const L: usize>(
    corners: &Corners,
    xi: &[f32; L],
    eta: f32,
) -> [[f32; L]; 2] {
    let ((ax, dx), (ay, dy)) = (along_row(&corners.x, eta), along_row(&corners.y, eta));
    let (mut ux, mut uy) = ([0.0; L], [0.0; L]);
    for i in 0..L {
        ux[i] = mul_add::<FMA>(xi[i], dx, ax);
        uy[i] = mul_add::<FMA>(xi[i], dy, ay);
    }
    [ux, uy]
}
