//! Does every node see texture? (THEORY 2)

use crate::imaging::{Image, Interpolation, Pixels};
use crate::linalg::BlockMatrix;
use crate::mesh::Mesh;
use crate::units::Px;

/// A node is without texture when its weakest gradient direction carries less than this many times what
/// image noise alone would put there.
const NOISE_MARGIN: f64 = 4.0;

/// A node that cannot be measured, and why.
#[derive(Debug, Clone, PartialEq)]
pub struct TextureFault {
    /// Number of the node in the mesh.
    pub node: usize,
    /// Its place, px.
    pub at: [f64; 2],
    /// Root mean square of the gradient in the weakest direction, grey levels per px.
    pub weakest_gradient: f64,
    /// What is needed there: the noise's share times a margin.
    pub needed: f64,
    /// Whether there is texture in one direction (stripes) but none across it.
    pub striped: bool,
}

impl std::fmt::Display for TextureFault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let kind = if self.striped { "stripes, no texture along them" } else { "no texture" };
        write!(
            f,
            "node {} at ({}, {}) px: {kind} (gradient {:.3} of {:.3} grey levels/px needed)",
            self.node, self.at[0], self.at[1], self.weakest_gradient, self.needed
        )
    }
}

/// The nodes whose 2x2 block is singular within the noise of standard deviation `noise` (grey levels);
/// those without any pixel (`support` zero) among them.
///
/// The block is `sum psi^2 grad f grad f^T`; its smallest eigenvalue over `sum psi^2` is the mean square
/// gradient in the weakest direction. White noise alone gives `noise^2` times the gain of the gradient.
pub(super) fn faults(
    mesh: &Mesh<Px>,
    matrix: &BlockMatrix,
    support: &[f64],
    noise: f64,
    interpolation: Interpolation,
) -> Vec<TextureFault> {
    let needed = NOISE_MARGIN * noise * noise * interpolation.gradient_noise_gain();
    (0..mesh.n_nodes())
        .filter_map(|node| {
            let [xx, xy, yy] = matrix.diagonal(node);
            let (mean, half) = (0.5 * (xx + yy), (0.25 * (xx - yy).powi(2) + xy * xy).sqrt());
            let weight = support[node].max(f64::MIN_POSITIVE);
            let (weakest, strongest) = ((mean - half).max(0.0) / weight, (mean + half) / weight);
            // The relative floor catches exact stripes in noise-free images, where f32 leaves a rest.
            let fault = support[node] <= 0.0 || weakest <= needed || weakest <= 1e-5 * strongest;
            fault.then(|| TextureFault {
                node,
                at: mesh.nodes()[node],
                weakest_gradient: weakest.sqrt(),
                needed: needed.max(1e-5 * strongest).sqrt(),
                striped: strongest > needed,
            })
        })
        .collect()
}

/// Standard deviation of the rounding to integer grey levels; none for float images.
pub(super) fn rounding(image: &Image) -> f64 {
    match image.pixels() {
        Pixels::F32(_) => 0.0,
        _ => 1.0 / 12f64.sqrt(),
    }
}

/// The image noise assumed for the texture check when none is given, grey levels: the high-frequency
/// content of the quietest tenth of the image (second differences in both directions, which smooth
/// texture hardly has; Immerkaer 1996), at most 2 % of the range of grey levels, at least the rounding
/// of integer images.
pub fn assumed_noise(image: &Image) -> f64 {
    const TILE: usize = 16;
    let (width, height) = (image.width(), image.height());
    let (low, high) = image.range();
    let mut tiles = Vec::new();
    // Every few rows and columns of tiles: a sample is enough.
    let step = TILE * (1 + width.max(height) / 1024);
    for y0 in (1..height.saturating_sub(TILE)).step_by(step) {
        for x0 in (1..width.saturating_sub(TILE)).step_by(step) {
            let mut sum = 0.0;
            for y in y0..y0 + TILE {
                for x in x0..x0 + TILE {
                    let row = |y: usize| {
                        f64::from(image.grey(x - 1, y)) - 2.0 * f64::from(image.grey(x, y))
                            + f64::from(image.grey(x + 1, y))
                    };
                    sum += (row(y - 1) - 2.0 * row(y) + row(y + 1)).powi(2);
                }
            }
            // The mask's squared weights sum to 36.
            tiles.push((sum / 36.0 / (TILE * TILE) as f64).sqrt());
        }
    }
    tiles.sort_by(f64::total_cmp);
    let quiet = tiles.get(tiles.len() / 10).copied().unwrap_or(0.0);
    quiet.min(0.02 * f64::from(high - low)).max(rounding(image))
}
