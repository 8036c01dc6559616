//! Borders beside which there is nothing to see: dark bands, holes, the edge of a specimen.

use crate::imaging::Image;
use crate::mesh::{Mesh, Zone};
use crate::units::Px;

/// A zone that ends at a place without texture and has no guard there.
///
/// Interpolation and gradient mix what lies beyond a border into the pixels beside it. Where that is a dark
/// band, which does not move with the specimen, the nodes of the border are pulled by 0.1 to 0.2 px; leaving
/// out three pixels ([`crate::mesh::Guard`]) takes this away (THEORY 2).
#[derive(Debug, Clone, PartialEq)]
pub struct BareBorder {
    /// Zone's name.
    pub zone: String,
    /// Length of border beside which there is no texture, px.
    pub length_px: f64,
    /// Middle of the longest piece of it, px.
    pub at: [f64; 2],
}

/// Beyond the border the texture (mean square of differences along it) is less than this share of that
/// within: a tenth in amplitude, and a step in grey level of as much as its own contrast.
const BARE: f64 = 0.15;
/// Rows of pixels looked at beyond the border, and within, px from the border: the reach of the interpolation.
const BEYOND: [f64; 2] = [1.0, 2.0];
const WITHIN: [f64; 4] = [3.0, 4.0, 5.0, 6.0];

/// The zones without guard that border on a place without texture over at least two elements.
pub(super) fn bare_borders(reference: &Image, mesh: &Mesh<Px>, zones: &[Zone]) -> Vec<BareBorder> {
    let mut found = Vec::new();
    for (zone, given) in zones.iter().enumerate().filter(|(_, given)| given.guard.is_none()) {
        let mut length = 0.0;
        let mut longest: (f64, [f64; 2]) = (0.0, [0.0; 2]);
        for [a, b] in mesh.boundary(zone) {
            let [a, b] = [a, b].map(|node| mesh.nodes()[node as usize]);
            if is_bare(reference, a, b) {
                let edge = (b[0] - a[0]).hypot(b[1] - a[1]);
                length += edge;
                if edge > longest.0 {
                    longest = (edge, [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])]);
                }
            }
        }
        if length >= 2.0 * mesh.element_size() {
            found.push(BareBorder { zone: given.name.clone(), length_px: length, at: longest.1 });
        }
    }
    found
}

/// Whether there is no texture beyond the edge from `a` to `b`, which has the inside to its right (y down).
fn is_bare(image: &Image, a: [f64; 2], b: [f64; 2]) -> bool {
    let way = [b[0] - a[0], b[1] - a[1]];
    let length = way[0].hypot(way[1]);
    let along = way.map(|w| w / length);
    let outward = [along[1], -along[0]];
    let n = length.floor() as usize;
    // Zones are half-open: the last row of pixels within lies half a pixel off the border on every side.
    let grey = |distance: f64, step: usize| {
        let at = |c: usize| a[c] - 0.5 + (step as f64 + 0.5) * along[c] + (distance - 0.5) * outward[c];
        let inside = |v: f64, n: usize| (v > -0.5 && v < n as f64 - 0.5).then(|| v.round() as usize);
        Some(f64::from(image.grey(inside(at(0), image.width())?, inside(at(1), image.height())?)))
    };
    let row = |distance: f64| -> Option<Vec<f64>> { (0..n).map(|step| grey(distance, step)).collect() };
    let texture = |row: &Vec<f64>| row.windows(2).map(|w| (w[1] - w[0]).powi(2)).sum::<f64>() / row.len().max(2) as f64;
    let rows = |distances: &[f64]| distances.iter().map(|&distance| row(distance)).collect::<Option<Vec<_>>>();
    // At the border of the image there is nothing to be mixed in.
    let (Some(beyond), Some(within)) = (rows(&BEYOND), rows(&WITHIN.map(|distance| 1.0 - distance))) else {
        return false;
    };
    let mean = |rows: &[Vec<f64>]| rows.iter().map(texture).sum::<f64>() / rows.len() as f64;
    n > 1 && mean(&beyond) < BARE * mean(&within)
}
