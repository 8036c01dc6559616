//! The noise of an image, as far as the image alone tells it.

use crate::imaging::{Image, Levels};
use crate::mesh::PixelSet;
use rayon::prelude::*;

/// Standard deviation of the rounding to integer grey levels; none for float images.
pub(crate) fn rounding(image: &Image) -> f64 {
    match image.pixels() {
        Levels::F32(_) => 0.0,
        _ => 1.0 / 12f64.sqrt(),
    }
}

/// The image noise assumed for the texture check when none is given, grey levels: the high-frequency content of the
/// quietest tenth of the zones (second differences in both directions; Immerkaer 1996), at least the rounding of
/// integers. Fine or sharp speckles have it too, so it is at most 1 % of the range of grey levels: a good reference
/// must not be refused for a noise that nobody measured. A dark background is quieter than what is measured.
///
/// Where these tiles hold only white noise, no fine texture is mistaken for it: its span, 8 to 10 sigma, limits it.
pub fn assumed_noise(image: &Image, zones: &[PixelSet]) -> f64 {
    let (low, high) = image.range();
    let quiet_tiles = &quietest_tiles(image, zones);
    let quiet = quiet_tiles.last().map_or(0.0, |tile| tile.0);
    // White noise has both alike, texture that a camera resolves has less than half of its contrast there.
    let n_white = quiet_tiles.iter().filter(|(noise, deviation)| *noise > 0.75 * deviation).count();
    let share = if 2 * n_white > quiet_tiles.len() { 0.125 } else { 0.01 };
    quiet.min(share * f64::from(high - low)).max(rounding(image))
}

/// The high-frequency content of the quietest tenth of the zones, grey levels: white noise, and fine texture.
pub(crate) fn high_frequency(image: &Image, zones: &[PixelSet]) -> f64 {
    quietest_tiles(image, zones).last().map_or(0.0, |tile| tile.0)
}

/// Noise by second differences, and deviation, of the quietest tenth of the tiles of the zones, rising.
fn quietest_tiles(image: &Image, zones: &[PixelSet]) -> Vec<(f64, f64)> {
    /// Side of a tile, px: its 256 differences tell a noise to a few per cent.
    const TILE: usize = 16;
    let (width, height) = (image.width(), image.height());
    let (low, _) = image.range();
    // Every few rows and columns of tiles: a sample is enough.
    let step = TILE * (1 + width.max(height) / 1024);
    let of_tile = |x0: usize, y0: usize| {
        // With one pixel more on every side.
        let grey: [[f32; TILE + 2]; TILE + 2] =
            std::array::from_fn(|v| std::array::from_fn(|u| image.grey(x0 - 1 + u, y0 - 1 + v)));
        let (mut sum, mut greys, mut squares) = (0.0, 0.0, 0.0);
        for y in 1..=TILE {
            for x in 1..=TILE {
                let row =
                    |y: usize| f64::from(grey[y][x - 1]) - 2.0 * f64::from(grey[y][x]) + f64::from(grey[y][x + 1]);
                sum += (row(y - 1) - 2.0 * row(y) + row(y + 1)).powi(2);
                let grey = f64::from(grey[y][x] - low);
                greys += grey;
                squares += grey * grey;
            }
        }
        let n = (TILE * TILE) as f64;
        // The mask's squared weights sum to 36.
        ((sum / 36.0 / n).sqrt(), (squares / n - (greys / n).powi(2)).max(0.0).sqrt())
    };
    let counts = |x: usize, y: usize| zones.iter().any(|zone| zone.contains(x, y));
    let is_in = |x0: usize, y0: usize| {
        let ends = |at: usize| [at, at + TILE - 1];
        ends(y0).into_iter().all(|y| ends(x0).into_iter().all(|x| counts(x, y)))
    };
    let rows: Vec<usize> = (1..height.saturating_sub(TILE)).step_by(step).collect();
    let of_row = |&y0: &usize| {
        let columns = (1..width.saturating_sub(TILE)).step_by(step).filter(|&x0| is_in(x0, y0));
        columns.map(|x0| of_tile(x0, y0)).collect::<Vec<_>>()
    };
    let mut tiles = rows.par_iter().map(of_row).collect::<Vec<_>>().concat();
    tiles.sort_by(|a, b| a.0.total_cmp(&b.0));
    tiles.truncate(tiles.len().div_ceil(10));
    tiles
}
