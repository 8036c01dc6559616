//! Where a frame starts when nothing is known: FFT cross-correlation of tiles on a coarse level, the
//! affine motion that most tiles of a zone agree on, and what groups of tiles find beyond it.

use crate::backend::GreyMap;
use crate::correlate::transpose;
use crate::mesh::{PixelSet, Roi};
use quadrille_fourier::num_complex::Complex32;
use quadrille_fourier::{Fft, single};
use rayon::prelude::*;
use std::sync::Arc;

/// Side of a tile, px of the coarse level: small enough to stay coherent under 5 degrees of rotation.
const TILE: usize = 32;
/// How far a tile is looked for in each direction, px of the coarse level.
const REACH: usize = 32;
/// Side of the window that holds the tile at every displacement: no wrap-around reaches the valid part.
const WINDOW: usize = TILE + 2 * REACH;
/// Of every so many tiles along each axis one is looked for first,
const FIRST_OF: usize = 2;
/// if that leaves so many, and what this share of them agrees on is the motion of a zone: the others say no more.
const FIRST_TILES: usize = 12;
const FIRST_AGREE: f64 = 0.75;
/// A tile agrees with a motion that puts it this close to where it was found, px of the coarse level.
const AGREEMENT_PX: f64 = 1.5;

/// An affine displacement `u(x) = shift + gradient (x - centre)`, px of its level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Affine {
    centre: [f64; 2],
    shift: [f64; 2],
    gradient: [[f64; 2]; 2],
}

impl Affine {
    fn translation(shift: [f64; 2]) -> Self {
        Self { centre: [0.0; 2], shift, gradient: [[0.0; 2]; 2] }
    }

    /// Whether it puts a tile where it was found.
    fn agrees(&self, tile: &Match) -> bool {
        let ([ux, uy], [dx, dy]) = (self.displacement(tile.centre), tile.displacement);
        (ux - dx).hypot(uy - dy) < AGREEMENT_PX
    }

    /// The displacement of the point `x`, px of the level.
    pub fn displacement(&self, x: [f64; 2]) -> [f64; 2] {
        let d = [x[0] - self.centre[0], x[1] - self.centre[1]];
        std::array::from_fn(|c| self.shift[c] + self.gradient[c][0] * d[0] + self.gradient[c][1] * d[1])
    }
}

/// A motion of one zone: affine, and the local deviations of tiles from it where there are any.
#[derive(Debug, Clone)]
pub(crate) struct Motion {
    affine: Affine,
    /// Centres of tiles and their displacement beyond the affine one.
    deviations: Vec<([f64; 2], [f64; 2])>,
}

/// The deviation at a point is the median of this many tiles around it: two of them may be wrong.
const NEIGHBOURS: usize = 5;

impl Motion {
    pub fn rest() -> Self {
        Self::of(Affine::translation([0.0; 2]))
    }

    /// The same affine motion everywhere.
    pub fn of(affine: Affine) -> Self {
        Self { affine, deviations: Vec::new() }
    }

    /// The same moved on by a shift.
    pub fn shifted(mut self, by: [f64; 2]) -> Self {
        (0..2).for_each(|c| self.affine.shift[c] += by[c]);
        self
    }

    /// An affine motion with what matches find beyond it around them.
    pub fn with_deviations(affine: Affine, matches: &[Match]) -> Self {
        let deviation = |m: &Match| {
            let u = affine.displacement(m.centre);
            (m.centre, [m.displacement[0] - u[0], m.displacement[1] - u[1]])
        };
        Self { affine, deviations: matches.iter().map(deviation).collect() }
    }

    /// The displacement of the point `x`, px of the level.
    pub fn displacement(&self, x: [f64; 2]) -> [f64; 2] {
        let u = self.affine.displacement(x);
        let mut near: Vec<(f64, [f64; 2])> = self
            .deviations
            .iter()
            .map(|(at, deviation)| ((at[0] - x[0]).powi(2) + (at[1] - x[1]).powi(2), *deviation))
            .collect();
        if near.len() < NEIGHBOURS {
            return u;
        }
        near.select_nth_unstable_by(NEIGHBOURS - 1, |a, b| a.0.total_cmp(&b.0));
        std::array::from_fn(|c| {
            let mut values: [f64; NEIGHBOURS] = std::array::from_fn(|k| near[k].1[c]);
            values.sort_by(f64::total_cmp);
            u[c] + values[NEIGHBOURS / 2]
        })
    }
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct Match {
    /// Its centre in the reference, px of the level.
    pub centre: [f64; 2],
    /// How far it has moved, px of the level.
    pub displacement: [f64; 2],
    /// Its correlation coefficient there.
    pub score: f64,
}

/// The motion of one zone by a quarter of its tiles, if they are enough and most of them agree on it.
pub(crate) fn first_motion(reference: &GreyMap, deformed: &GreyMap, bounds: Roi, pixels: &PixelSet) -> Option<Motion> {
    let tiles = tiles(reference, bounds, pixels, FIRST_OF);
    if tiles.len() < FIRST_TILES {
        return None;
    }
    let matches = match_tiles(reference, deformed, tiles);
    let agreed = find_agreed_motion(&matches)?;
    let n_agree = matches.iter().filter(|tile| agreed.agrees(tile)).count();
    (n_agree as f64 >= FIRST_AGREE * matches.len() as f64).then(|| Motion::of(agreed))
}

/// The motions worth trying for one zone, the most probable first; the last is rest.
pub(crate) fn motions(reference: &GreyMap, deformed: &GreyMap, bounds: Roi, pixels: &PixelSet) -> Vec<Motion> {
    let matches = match_tiles(reference, deformed, tiles(reference, bounds, pixels, 1));
    let agreed = find_agreed_motion(&matches);
    let mut motions: Vec<Motion> = agreed.map(Motion::of).into_iter().collect();
    // A specimen that bends or breaks moves differently in different places.
    motions.push(Motion::with_deviations(agreed.unwrap_or(Affine::translation([0.0; 2])), &matches));
    // The single best tile, for zones of few tiles or in pieces.
    if let Some(best) = matches.iter().max_by(|a, b| a.score.total_cmp(&b.score)) {
        motions.push(Motion::of(Affine::translation(best.displacement)));
    }
    motions.push(Motion::rest());
    motions
}

/// First column and row, and number of both.
type Tile = ([usize; 2], [usize; 2]);

/// The tiles of a zone, of every `step` of them along each axis one.
fn tiles(reference: &GreyMap, zone: Roi, pixels: &PixelSet, step: usize) -> Vec<Tile> {
    let first = |x: f64| x.ceil().max(0.0) as usize;
    let starts = |low: f64, high: f64, n: usize| -> Vec<(usize, usize)> {
        let (a, b) = (first(low), first(high).min(n));
        let length = b.saturating_sub(a);
        let count = (length / TILE).max(1);
        let size = length.min(TILE);
        // Spread over the zone, the remainder shared out as gaps.
        (0..count)
            .step_by(step)
            .map(|k| (a + (length - size * count) * (2 * k + 1) / (2 * count) + k * size, size))
            .collect()
    };
    let (columns, rows) = (starts(zone.x0, zone.x1, reference.width), starts(zone.y0, zone.y1, reference.height));
    rows.into_iter()
        .flat_map(|(y, ny)| columns.iter().map(move |&(x, nx)| ([x, y], [nx, ny])))
        .filter(|(_, size)| size[0] >= 8 && size[1] >= 8)
        // What a tile holds of other things moves otherwise.
        .filter(|([x, y], [nx, ny])| 2 * pixels.count([*x, *y, x + nx, y + ny]) >= nx * ny)
        .collect()
}

fn match_tiles(reference: &GreyMap, deformed: &GreyMap, tiles: Vec<Tile>) -> Vec<Match> {
    let [forward, inverse] = single(WINDOW);
    tiles.into_par_iter().filter_map(|tile| match_tile(reference, deformed, tile, &forward, &inverse)).collect()
}

/// Finds one tile by zero-mean normalised cross-correlation.
fn match_tile(
    reference: &GreyMap,
    deformed: &GreyMap,
    (at, size): Tile,
    forward: &Arc<dyn Fft<f32>>,
    inverse: &Arc<dyn Fft<f32>>,
) -> Option<Match> {
    let n = (size[0] * size[1]) as f32;
    let tile_value = |x: usize, y: usize| reference.values[(at[1] + y) * reference.width + at[0] + x];
    let pixels = || (0..size[1]).flat_map(move |y| (0..size[0]).map(move |x| (x, y)));
    let mean = pixels().map(|(x, y)| tile_value(x, y)).sum::<f32>() / n;
    let tile_power: f32 = pixels().map(|(x, y)| (tile_value(x, y) - mean).powi(2)).sum();
    if tile_power <= 0.0 {
        return None;
    }
    // Real part: the tile; imaginary part: the window. One transform serves both.
    let mut packed = vec![Complex32::default(); WINDOW * WINDOW];
    for (x, y) in pixels() {
        packed[y * WINDOW + x].re = tile_value(x, y) - mean;
    }
    let inside =
        |x: isize, y: isize| x >= 0 && y >= 0 && (x as usize) < deformed.width && (y as usize) < deformed.height;
    // Sums of the window and of its square over the rectangle above and left of each point, and of pixels.
    let side = WINDOW + 1;
    let mut integral = vec![[0.0f64; 3]; side * side];
    for y in 0..WINDOW {
        let mut row = [0.0f64; 3];
        for x in 0..WINDOW {
            let (gx, gy) = (at[0] as isize + x as isize - REACH as isize, at[1] as isize + y as isize - REACH as isize);
            if inside(gx, gy) {
                let value = deformed.values[gy as usize * deformed.width + gx as usize];
                packed[y * WINDOW + x].im = value;
                row[0] += f64::from(value);
                row[1] += f64::from(value).powi(2);
                row[2] += 1.0;
            }
            for k in 0..3 {
                integral[(y + 1) * side + x + 1][k] = integral[y * side + x + 1][k] + row[k];
            }
        }
    }
    transform(&mut packed, forward);
    let mut product = vec![Complex32::default(); WINDOW * WINDOW];
    for y in 0..WINDOW {
        for x in 0..WINDOW {
            let z = packed[y * WINDOW + x];
            let mirrored = packed[(WINDOW - y) % WINDOW * WINDOW + (WINDOW - x) % WINDOW].conj();
            let tile = (z + mirrored) * 0.5;
            let window = (z - mirrored) * Complex32::new(0.0, -0.5);
            product[y * WINDOW + x] = tile.conj() * window;
        }
    }
    transform(&mut product, inverse);
    let scale = 1.0 / (WINDOW * WINDOW) as f32;
    let mut best: Option<Match> = None;
    for dy in 0..=2 * REACH {
        for dx in 0..=2 * REACH {
            let [sum, square, count] = std::array::from_fn(|k| {
                let corner = |x: usize, y: usize| integral[y * side + x][k];
                corner(dx + size[0], dy + size[1]) - corner(dx, dy + size[1]) - corner(dx + size[0], dy)
                    + corner(dx, dy)
            });
            if count < 0.6 * f64::from(n) {
                continue; // mostly outside the deformed image
            }
            let power = square - sum * sum / count;
            if power <= 1e-6 * square {
                continue; // flat
            }
            let score = f64::from(product[dy * WINDOW + dx].re * scale) / (f64::from(tile_power) * power).sqrt();
            if best.is_none_or(|b| score > b.score) {
                best = Some(Match {
                    centre: std::array::from_fn(|c| at[c] as f64 + 0.5 * (size[c] as f64 - 1.0)),
                    displacement: [dx as f64 - REACH as f64, dy as f64 - REACH as f64],
                    score,
                });
            }
        }
    }
    best
}

/// Two-dimensional transform in place: rows, then columns as rows of the transpose, twice.
fn transform(values: &mut [Complex32], fft: &Arc<dyn Fft<f32>>) {
    for _ in 0..2 {
        fft.process(values);
        transpose(values, WINDOW);
    }
}

/// Draws numbers below others, the same for the same `state` (xorshift).
pub(crate) fn draws(mut state: u64) -> impl FnMut(usize) -> usize {
    move |n| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 33) as usize % n
    }
}

/// The affine motion that the most tiles agree on (random sampling with fixed seeds, Fischler & Bolles
/// 1981), refined by least squares on those; `None` when too few agree.
fn find_agreed_motion(matches: &[Match]) -> Option<Affine> {
    /// Draws of three tiles: where three tenths agree, all draws miss them in one of 50 000 searches.
    const TRIALS: usize = 400;
    let mut best: Vec<usize> = Vec::new();
    let mut draw = draws(0x2545_F491_4F6C_DD1D);
    let agreeing =
        |motion: &Affine| -> Vec<usize> { (0..matches.len()).filter(|&k| motion.agrees(&matches[k])).collect() };
    let mut consider = |motion: Affine| {
        // A scale far from one, or a mirror image, is no motion of a specimen.
        let strain_too_large = motion.gradient.iter().flatten().any(|g| g.abs() > 0.5);
        let agree = if strain_too_large { Vec::new() } else { agreeing(&motion) };
        if agree.len() > best.len() {
            best = agree;
        }
    };
    for m in matches {
        consider(Affine::translation(m.displacement));
    }
    if matches.len() >= 4 {
        for _ in 0..TRIALS {
            let triple = [draw(matches.len()), draw(matches.len()), draw(matches.len())];
            if let Some(motion) = fit(&triple.map(|k| matches[k])) {
                consider(motion);
            }
        }
    }
    if best.len() < (matches.len() / 4).max(2) {
        return None;
    }
    let agreeing_tiles: Vec<Match> = best.iter().map(|&k| matches[k]).collect();
    Some(fit(&agreeing_tiles).unwrap_or_else(|| {
        let n = agreeing_tiles.len() as f64;
        let mean = |c: usize| agreeing_tiles.iter().map(|m| m.displacement[c]).sum::<f64>() / n;
        Affine::translation([mean(0), mean(1)])
    }))
}

/// Least-squares affine motion; of tiles on a line a rotation with scale; `None` of fewer than three or one place.
pub(crate) fn fit(matches: &[Match]) -> Option<Affine> {
    let n = matches.len() as f64;
    if matches.len() < 3 {
        return None;
    }
    let mean = |value: &dyn Fn(&Match) -> f64| matches.iter().map(value).sum::<f64>() / n;
    let centre: [f64; 2] = std::array::from_fn(|c| mean(&|m| m.centre[c]));
    let shift: [f64; 2] = std::array::from_fn(|c| mean(&|m| m.displacement[c]));
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    let mut mixed = [[0.0; 2]; 2];
    for m in matches {
        let d = [m.centre[0] - centre[0], m.centre[1] - centre[1]];
        xx += d[0] * d[0];
        xy += d[0] * d[1];
        yy += d[1] * d[1];
        for c in 0..2 {
            for k in 0..2 {
                mixed[c][k] += (m.displacement[c] - shift[c]) * d[k];
            }
        }
    }
    let determinant = xx * yy - xy * xy;
    let spread = xx + yy;
    if spread <= 0.0 {
        return None;
    }
    if determinant <= 1e-3 * spread * spread {
        let stretch = (mixed[0][0] + mixed[1][1]) / spread;
        let turn = (mixed[1][0] - mixed[0][1]) / spread;
        return Some(Affine { centre, shift, gradient: [[stretch, -turn], [turn, stretch]] });
    }
    let gradient = mixed.map(|[a, b]| [(a * yy - b * xy) / determinant, (b * xx - a * xy) / determinant]);
    Some(Affine { centre, shift, gradient })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{PixelMesh, Zone};

    /// A random pattern whose columns have moved by `u`.
    fn moved(u: impl Fn(usize) -> [i64; 2]) -> GreyMap {
        const SIDE: usize = 320;
        let grey = |x: i64, y: i64| {
            let hash = ((x.div_euclid(2) * 7919 + y.div_euclid(2) + 1) as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
            ((hash ^ (hash >> 31)) >> 40 & 0xFF) as f32 - 127.0
        };
        let pixels = (0..SIDE * SIDE).map(|at| {
            let [dx, dy] = u(at % SIDE);
            grey((at % SIDE) as i64 - dx, (at / SIDE) as i64 - dy)
        });
        GreyMap { width: SIDE, height: SIDE, values: pixels.collect() }
    }

    #[test]
    fn a_quarter_of_the_tiles_tells_a_motion_that_most_agree_on_and_no_other() {
        let zone = |x0: f64, x1: f64| Roi { x0, y0: x0, x1, y1: x1 };
        let found = |deformed: &GreyMap, bounds: Roi| {
            let pixels =
                PixelMesh::on_zones(&[Zone::rectangle("all", bounds)], 16, 0.5, [320, 320]).unwrap().zone_pixels;
            let motion = first_motion(&moved(|_| [0, 0]), deformed, bounds, &pixels[0]);
            motion.map(|motion| motion.displacement([170.0, 150.0]).map(|u| (10.0 * u).round() / 10.0))
        };
        let together = moved(|_| [7, -4]);
        assert_eq!(found(&together, zone(32.0, 288.0)), Some([7.0, -4.0]));
        // Four tiles are not enough, and of two halves neither is most.
        assert_eq!(found(&together, zone(64.0, 192.0)), None);
        let torn = moved(|x| if x < 160 { [7, 0] } else { [-9, 3] });
        assert_eq!(found(&torn, zone(32.0, 288.0)), None);
    }
}
