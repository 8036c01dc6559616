//! The pixels of a reference in the order in which the passes over them go: element by element, row below row.
//!
//! In an image the rows of an element lie a whole image row apart, each on a page of its own. Side by side they are one
//! stream that the hardware reads ahead of, of the pixels of elements alone.

use super::gradient::{AlongY, AtPixel, gradients};
use super::lanes::Lanes;
use super::memory::{Pages, Pool};
use super::plane::View;
use crate::backend::BackendError;
use crate::backend::pyramid::Grey;
use crate::isa::{Isa, multiversioned};
use crate::mesh::{ElementPixels, PixelMap, Run};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// Elements per piece of parallel work.
pub(super) const PIECE: usize = 32;

/// A reference image at one scale with its elements.
#[derive(Debug)]
pub(super) struct Reference {
    /// The pixels of each element; none for those left out.
    pub elements: Vec<ElementPixels>,
    /// The runs of those that are no rectangle.
    pub map: Arc<PixelMap>,
    /// Grey levels per px in a unit of the gradient.
    pub unit: f32,
    /// Where the lanes of each element begin, and where the last ones end.
    first: Vec<u32>,
    /// [`Lanes`] of all elements. Of a rectangle, columns of lanes one after the other, from its left to its right,
    /// each from top to bottom; else as [`parts`] gives them.
    lanes: Pages<u8>,
    /// Pixels side by side in each.
    width: usize,
}

/// What a reference is made of.
pub(super) struct Source<'a, G> {
    /// Its grey levels, row by row,
    pub grey: &'a [G],
    /// and what is taken away from them.
    pub offset: f32,
    pub coefficients: View<'a>,
    pub at_pixel: AtPixel,
}

impl Reference {
    /// Of the pixels of `map`, `L` side by side.
    pub fn new<G: Grey, const L: usize>(
        pool: &Pool,
        isa: Isa,
        source: &Source<'_, G>,
        map: &Arc<PixelMap>,
    ) -> Result<Self, BackendError> {
        let elements = map.elements().to_vec();
        let mut first = Vec::with_capacity(elements.len() + 1);
        let mut n = 0;
        for element in &elements {
            first.push(n);
            n += n_lanes::<L>(map, element) as u32;
        }
        first.push(n);
        let mut lanes = pool.pages(n as usize * size_of::<Lanes<L>>(), "the pixels of a reference")?;
        let mut pieces = Vec::with_capacity(elements.len().div_ceil(PIECE));
        let mut rest: &mut [Lanes<L>] = bytemuck::cast_slice_mut(lanes.data_mut());
        for piece in elements.chunks(PIECE) {
            let n = piece.iter().map(|element| n_lanes::<L>(map, element)).sum();
            let (of_piece, others) = rest.split_at_mut(n);
            pieces.push((piece, of_piece));
            rest = others;
        }
        pieces.into_par_iter().for_each_init(AlongY::default, |along_y, (elements, mut lanes)| {
            for element in elements {
                let (own, others) = lanes.split_at_mut(n_lanes::<L>(map, element));
                fill::<G, L>(isa, source, element, map.runs_of(element), along_y, own);
                lanes = others;
            }
        });
        let unit = source.at_pixel.unit;
        Ok(Self { elements, map: map.clone(), unit, first, lanes, width: L })
    }

    /// The pixels of all elements, of which [`Self::range`] tells those of one.
    pub fn lanes<const L: usize>(&self) -> &[Lanes<L>] {
        debug_assert_eq!(self.width, L);
        bytemuck::cast_slice(self.lanes.data())
    }

    /// Where the pixels of an element are; nowhere of one that is left out.
    pub fn range(&self, element: usize) -> Range<usize> {
        let [first, end] = [element, element + 1].map(|at| self.first[at] as usize);
        first..if self.elements[element].nx == 0 { first } else { end }
    }

    /// Calls `visit(x, y, xi, eta, f, gradient)` for every pixel of an element.
    pub fn for_each<const L: usize>(&self, element: usize, mut visit: impl FnMut([i32; 2], [f32; 2], f32, [f32; 2])) {
        let (lanes, pixels) = (&self.lanes::<L>()[self.range(element)], &self.elements[element]);
        let mut runs_before = 0;
        let of_runs = self.map.runs_of(pixels).iter().flat_map(|run| {
            let n = run.n as usize;
            let from = runs_before;
            runs_before += n.div_ceil(L);
            (0..n).map(move |k| (from + k / L, k % L))
        });
        let (nx, ny) = (usize::from(pixels.nx), if pixels.n_runs > 0 { 0 } else { usize::from(pixels.ny) });
        let of_rows = (0..ny).flat_map(|row| (0..nx).map(move |column| (column / L * ny + row, column % L)));
        let mut places = of_runs.chain(of_rows);
        self.map.for_each(pixels, |x, y, xi, eta| {
            let Some((at, lane)) = places.next() else { return };
            let Lanes { f, fx, fy } = &lanes[at];
            let gradient = [fx, fy].map(|of| self.unit * f32::from(of[lane]));
            visit([x, y], [xi, eta], f[lane], gradient);
        });
    }
}

/// How many lanes an element has.
fn n_lanes<const L: usize>(map: &PixelMap, element: &ElementPixels) -> usize {
    match element.n_runs {
        0 => usize::from(element.nx).div_ceil(L) * usize::from(element.ny),
        _ => map.runs_of(element).iter().map(|run| (run.n as usize).div_ceil(L)).sum(),
    }
}

/// The runs of an element, lanes by lanes: each with the column of the run.
#[inline(always)]
pub(super) fn parts<const L: usize>(runs: &[Run]) -> impl Iterator<Item = (&Run, usize)> {
    runs.iter().flat_map(|run| (0..run.n as usize).step_by(L).map(move |column| (run, column)))
}

multiversioned! {
    /// Fills the lanes of an element.
    fn fill[G: Grey, const L: usize][G, L](
        source: &Source<'_, G>, element: &ElementPixels, runs: &[Run], along_y: &mut AlongY, lanes: &mut [Lanes<L>],
    ) => fill_body
}

#[inline(always)]
fn fill_body<const FMA: bool, G: Grey, const L: usize>(
    source: &Source<'_, G>,
    element: &ElementPixels,
    runs: &[Run],
    along_y: &mut AlongY,
    lanes: &mut [Lanes<L>],
) {
    if element.n_runs > 0 {
        for ((run, column), lanes) in parts::<L>(runs).zip(lanes) {
            let (at, n) = ([run.x + column as i32, run.y], run.n as usize - column);
            fill_rows::<FMA, G, L>(source, at, n, along_y, std::slice::from_mut(lanes));
        }
        return;
    }
    for (part, lanes) in lanes.chunks_exact_mut(usize::from(element.ny).max(1)).enumerate() {
        let n = usize::from(element.nx) - part * L;
        fill_rows::<FMA, G, L>(source, [element.x + (part * L) as i32, element.y], n, along_y, lanes);
    }
}

/// Fills rows of lanes one below the other, of which the first begins at column `x` of row `y`, with `n` pixels each at
/// most.
#[inline(always)]
fn fill_rows<const FMA: bool, G: Grey, const L: usize>(
    source: &Source<'_, G>,
    [x, y]: [i32; 2],
    n: usize,
    along_y: &mut AlongY,
    lanes: &mut [Lanes<L>],
) {
    gradients::<FMA, L>(source.coefficients, [x, y], &source.at_pixel, along_y, lanes);
    let width = source.coefficients.width;
    let mut first = y as usize * width + x as usize;
    for Lanes { f, fx, fy } in lanes {
        let row = &source.grey[first..][..n.min(L)];
        if let Some(row) = row.first_chunk::<L>() {
            for i in 0..L {
                f[i] = row[i].value() - source.offset;
            }
        } else {
            *f = [0.0; L];
            f.iter_mut().zip(row).for_each(|(f, grey)| *f = grey.value() - source.offset);
            fx[n..].fill(0);
            fy[n..].fill(0);
        }
        first += width;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backend::cpu::prefilter::coefficients;
    use crate::imaging::Interpolation;
    use crate::mesh::{PixelMesh, Roi, Zone};

    const SIZE: usize = 61;

    /// What is known of each pixel of the image that belongs to an element: f and its gradient.
    fn known<const L: usize>(zone: &Zone, size: usize) -> Vec<Option<(f32, [f32; 2])>> {
        let pixels = PixelMesh::on_zones(std::slice::from_ref(zone), size, 0.3, [SIZE, SIZE]).unwrap().pixels;
        let grey: Vec<u16> = (0..SIZE * SIZE).map(|k| (k * 7919 % 4001) as u16).collect();
        let (pool, isa, cubic) = (Pool::default(), Isa::detect(), Interpolation::Cubic);
        let plane = coefficients(&pool, isa, &grey, SIZE, SIZE, 2000.0, cubic).unwrap();
        let (coefficients, at_pixel) = (plane.view(), AtPixel::new(cubic, 0.25));
        let source = Source { grey: &grey, offset: 2000.0, coefficients, at_pixel };
        let reference = Reference::new::<_, L>(&pool, isa, &source, &pixels).unwrap();
        let mut known = vec![None; SIZE * SIZE];
        for element in 0..pixels.elements().len() {
            let (mut n, lanes) = (0, &reference.lanes::<L>()[reference.range(element)]);
            let mut sum = 0.0;
            reference.for_each::<L>(element, |[x, y], _, f, gradient| {
                let at = y as usize * SIZE + x as usize;
                assert!(known[at].replace((f, gradient)).is_none(), "a pixel of two elements");
                assert_eq!(f, f32::from(grey[at]) - 2000.0);
                (n, sum) = (n + 1, sum + f);
            });
            // Nothing but its pixels is in its lanes.
            assert!(lanes.len() * L < n + L * (SIZE + 1), "{} lanes for {n} pixels", lanes.len());
            assert_eq!(lanes.iter().flat_map(|lanes| lanes.f).sum::<f32>(), sum);
        }
        known
    }

    #[test]
    fn every_pixel_has_the_same_level_and_gradient_whatever_element_and_lane_it_is_in() {
        let roi = Roi { x0: 0.0, y0: 0.0, x1: 60.0, y1: 60.0 };
        let all = known::<16>(&Zone::rectangle("all", roi), 30);
        assert_eq!(all.iter().flatten().count(), 3600);
        let polygon = vec![[3.0, 2.0], [58.0, 9.0], [50.0, 57.0], [20.0, 40.0], [6.0, 51.0]];
        let exclude = vec![vec![[30.0, 20.0], [41.0, 22.0], [35.0, 30.0]]];
        let cut = Zone { name: "cut".into(), polygon, exclude, ..Zone::default() };
        for part in [
            known::<8>(&Zone::rectangle("all", roi), 5),
            known::<8>(&Zone::rectangle("all", roi), 12),
            known::<16>(&Zone::rectangle("all", roi), 20),
            known::<8>(&cut, 8),
            known::<16>(&cut, 18),
        ] {
            assert!(part.iter().flatten().count() > 1000);
            let differ = part.iter().zip(&all).filter(|(part, all)| part.is_some() && part != all).count();
            assert_eq!(differ, 0);
        }
    }
}
