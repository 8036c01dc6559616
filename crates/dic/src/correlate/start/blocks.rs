//! Blocks of elements that do not match are looked for by themselves before they are given up: another body than most of
//! its zone, or a piece that has moved otherwise.

use crate::backend::{Backend, GreyMap};
use crate::correlate::{
    Correlation, Correlator, Features, Motion, Result, Start, StartUsed, choose_better, coarser, iterate, motions,
    named, nothing, numbers, wide_motions,
};
use crate::imaging::Image;
use crate::mesh::{Neighbours, PixelSet, Roi};

/// Elements of a block, those around its core included: fewer are looked for by the field around them.
const LEAST_ELEMENTS: usize = 9;
/// Correlation coefficient on the coarsest level from which on a block is found, and no other motion is tried.
const FOUND: f64 = 0.6;
/// Blocks may lie within others: so often they are looked for.
const ROUNDS: usize = 3;

impl<B: Backend> Correlator<B> {
    /// `found`, or the same with blocks of the elements that it has left out where those are found by themselves; not
    /// of those left out `before`.
    pub(crate) fn find_blocks(&self, frame: &mut B::Frame, found: Correlation, before: &[bool]) -> Result<Correlation> {
        let mut best = found;
        for _ in 0..ROUNDS {
            let Some(start) = self.start_of_blocks(frame, &best, before) else { break };
            let (mut field, mut left_out) = self.start_field(frame, &start)?;
            let level = &self.levels[0];
            let limits = self.rest_limits(self.turn(level, &start.displacement));
            let outcome = iterate(&self.backend, level, frame, &mut field, limits, &self.kernel, nothing)?;
            // Not all of a block need be there: what it covers now was left out as well.
            let (safe, excluded) = (&start.displacement, &mut left_out.elements);
            let outcome = self.iterate_without_astray(frame, &mut field, safe, outcome, excluded)?;
            let again = self.finish(frame, &mut field, outcome, StartUsed::Cold, best.coarse_iterations, left_out)?;
            let n_before = best.left_out.len();
            best = choose_better(best, again);
            if best.left_out.len() >= n_before {
                break;
            }
        }
        Ok(best)
    }

    /// Where `found` ended, with the core of every block that matches somewhere put there; none without any.
    fn start_of_blocks(&self, frame: &mut B::Frame, found: &Correlation, before: &[bool]) -> Option<Start> {
        let mut left_out = named(&found.left_out, self.mesh().n_elements());
        let is_new: Vec<bool> = left_out.iter().zip(before).map(|(out, before)| *out && !before).collect();
        let blocks = self.blocks(&is_new);
        if blocks.is_empty() || !self.may_try_again() {
            return None;
        }
        let mut start = found.next_start()?;
        let top = self.levels.len() - 1;
        let deformed = self.backend.grey_map(frame, top);
        for core in blocks {
            let Some(motion) = self.motion_of_block(frame, &deformed, &core) else { continue };
            for element in core {
                left_out[element] = false;
                for node in self.mesh().elements()[element].map(|node| node as usize) {
                    let at = self.mesh().nodes()[node].map(|x| (0..top).fold(x, |x, _| coarser(x)));
                    start.displacement[node] = motion.displacement(at).map(|u| u * 2f64.powi(top as i32));
                }
            }
        }
        let left_out = numbers(&left_out);
        (left_out != found.left_out).then_some(Start { left_out, ..start })
    }

    /// The cores of the blocks of elements `left_out`: those all of whose neighbours are left out as well.
    fn blocks(&self, left_out: &[bool]) -> Vec<Vec<usize>> {
        let neighbours = Neighbours::of(self.mesh());
        let mut cores = neighbours.bodies(|element| neighbours.around(element).all(|other| left_out[other]));
        cores.retain(|core| core.len() + neighbours.ring(core).len() >= LEAST_ELEMENTS);
        cores
    }

    /// The motion with which the elements `core` match, px of the coarsest level.
    fn motion_of_block(&self, frame: &B::Frame, deformed: &GreyMap, core: &[usize]) -> Option<Motion> {
        let top = self.levels.len() - 1;
        let on_image = self.pixels_of(core)?;
        let pixels = (0..top).fold(on_image.clone(), |pixels, _| pixels.halved());
        let [x0, y0, x1, y1] = pixels.bounds()?.map(|at| at as f64);
        let near = motions(&self.search_map, deformed, Roi { x0, y0, x1, y1 }, &pixels);
        let grey = |map: &GreyMap, [x, y]: [usize; 2]| f64::from(map.values[y * map.width + x]);
        let rate = |motion: &Motion| {
            let moved = |at: [usize; 2]| {
                let x = at.map(|x| x as f64);
                let u = motion.displacement(x);
                between(deformed, [x[0] + u[0], x[1] + u[1]])
            };
            coefficient(&pixels, |at| grey(&self.search_map, at), moved)
        };
        let best = |motions: Vec<Motion>| {
            let rated = motions.into_iter().map(|motion| (rate(&motion), motion));
            rated.max_by(|a, b| a.0.total_cmp(&b.0)).filter(|(coefficient, _)| *coefficient >= FOUND)
        };
        let found = best(near).or_else(|| {
            let there = Features::of(&self.backend.image(frame));
            best(wide_motions(self.features(), &there, &on_image, top))
        });
        let (_, motion) = found?;
        Some(self.refine(&self.backend.image(frame), &on_image, motion))
    }

    /// A motion of `pixels`, which the coarsest level tells to a pixel of its own, to one of the image.
    fn refine(&self, deformed: &Image, pixels: &PixelSet, motion: Motion) -> Motion {
        let top = self.levels.len() - 1;
        let (scale, n) = (2f64.powi(top as i32), (1i32 << top) / 2);
        let grey = |x: i64, y: i64| {
            let inside = x >= 0 && y >= 0 && (x as usize) < deformed.width() && (y as usize) < deformed.height();
            inside.then(|| f64::from(deformed.grey(x as usize, y as usize)))
        };
        let rate = |[dx, dy]: [i32; 2]| {
            let of_pixel = |[x, y]: [usize; 2]| {
                let u = motion.displacement([x, y].map(|x| (0..top).fold(x as f64, |x, _| coarser(x))));
                let [x, y] = [x as f64 + scale * u[0], y as f64 + scale * u[1]].map(|x| x.round() as i64);
                grey(x + i64::from(dx), y + i64::from(dy))
            };
            coefficient(pixels, |[x, y]| f64::from(self.image.grey(x, y)), of_pixel)
        };
        let shifts = (-n..=n).flat_map(|dy| (-n..=n).map(move |dx| [dx, dy]));
        let rated = shifts.map(|shift| (rate(shift), shift));
        match rated.max_by(|a, b| a.0.total_cmp(&b.0)) {
            Some((_, shift)) => motion.shifted(shift.map(|px| f64::from(px) / scale)),
            None => motion,
        }
    }

    /// The pixels of elements, by the boxes around them.
    fn pixels_of(&self, elements: &[usize]) -> Option<PixelSet> {
        let [width, height] = self.size();
        let boxes: Vec<[usize; 4]> = elements
            .iter()
            .map(|&element| {
                let [x0, y0, x1, y1] = self.mesh().pixel_box(element);
                [x0, y0, x1.min(width), y1.min(height)]
            })
            .collect();
        let around =
            boxes.iter().copied().reduce(|a, b| [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])])?;
        let [x0, y0, x1, y1] = around;
        let n = x1.saturating_sub(x0);
        let mut bits = vec![false; n * y1.saturating_sub(y0)];
        for [bx0, by0, bx1, by1] in boxes {
            (by0..by1).for_each(|y| (bx0..bx1).for_each(|x| bits[(y - y0) * n + x - x0] = true));
        }
        Some(PixelSet::Raster { x0, y0, width: n, bits })
    }
}

/// Correlation coefficient of `pixels` of the reference, or of some of them, and the deformed image where it has them.
fn coefficient(
    pixels: &PixelSet,
    reference: impl Fn([usize; 2]) -> f64,
    deformed: impl Fn([usize; 2]) -> Option<f64>,
) -> f64 {
    /// Pixels that are enough.
    const ENOUGH: usize = 2000;
    let Some([x0, y0, x1, y1]) = pixels.bounds() else { return 0.0 };
    let step = 1 + ((x1 - x0) * (y1 - y0) / ENOUGH).isqrt();
    let (mut sums, mut n) = ([0.0; 5], 0.0);
    for at in (y0..y1).step_by(step).flat_map(|y| (x0..x1).step_by(step).map(move |x| [x, y])) {
        let Some(g) = pixels.contains(at[0], at[1]).then(|| deformed(at)).flatten() else { continue };
        let f = reference(at);
        sums = [sums[0] + f, sums[1] + g, sums[2] + f * f, sums[3] + g * g, sums[4] + f * g];
        n += 1.0;
    }
    let [f, g, ff, gg, fg] = sums.map(|sum| sum / f64::max(n, 1.0));
    let power = (ff - f * f) * (gg - g * g);
    if power > 0.0 { (fg - f * g) / power.sqrt() } else { 0.0 }
}

/// The grey level between the pixels of a level; none outside.
fn between(map: &GreyMap, [x, y]: [f64; 2]) -> Option<f64> {
    let (i, j) = (x.floor(), y.floor());
    let is_inside = i >= 0.0 && j >= 0.0 && i + 1.0 < map.width as f64 && j + 1.0 < map.height as f64;
    is_inside.then(|| {
        let at = |di: usize, dj: usize| f64::from(map.values[(j as usize + dj) * map.width + i as usize + di]);
        let (s, t) = (x - i, y - j);
        (1.0 - t) * ((1.0 - s) * at(0, 0) + s * at(1, 0)) + t * ((1.0 - s) * at(0, 1) + s * at(1, 1))
    })
}
