//! Does every node see texture? (THEORY 2)

use super::gradient_noise::AssumedNoise;
use crate::imaging::{Image, Interpolation, Pixels};
use crate::linalg::BlockMatrix;
use crate::mesh::{Mesh, Roi};
use crate::units::Px;

/// A node is without texture when its weakest gradient direction carries less than this many times what
/// image noise alone would put there on average. The sums over few pixels scatter: a node of `support` (sum
/// of psi^2) sees about 2.8 times as many independent pixels, and the margin is five and a half standard
/// deviations of their mean square.
///
/// An assumed noise may be too small, so that half as much again is asked for; of a stated one it is enough that more is
/// there than the noise can scatter by: that something is left of the matrix without its noise (THEORY 10).
fn noise_margin(support: f64, is_stated: bool) -> f64 {
    let safety = if is_stated { 1.0 } else { 1.5 };
    safety + 4.8 / support.max(1.0).sqrt()
}

/// A node that cannot be measured, and why.
#[derive(Debug, Clone, PartialEq)]
pub struct TextureFault {
    /// Number of the node in the mesh.
    pub node: usize,
    /// Its place, px.
    pub at: [f64; 2],
    /// What is missing there.
    pub lack: Lack,
}

/// What a node lacks to be measured.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Lack {
    /// Texture, in all directions or along stripes.
    Texture {
        /// Root mean square of the gradient in the weakest direction, grey levels per px.
        weakest: f64,
        /// What is needed: the noise's share times a margin.
        needed: f64,
        /// Whether there is texture across stripes, but none along them.
        striped: bool,
    },
    /// Enough texture together with its neighbours: the displacement would be this uncertain, px
    /// (infinite: not determined at all).
    Precision {
        /// Standard uncertainty, px.
        sigma_px: f64,
    },
}

impl Lack {
    /// In a few words.
    pub fn name(self) -> &'static str {
        match self {
            Lack::Texture { striped: false, .. } => "no texture",
            Lack::Texture { striped: true, .. } => "stripes: no texture along them",
            Lack::Precision { .. } => "too little texture",
        }
    }
}

impl std::fmt::Display for TextureFault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "node {} at ({}, {}) px: {} ", self.node, self.at[0], self.at[1], self.lack.name())?;
        match self.lack {
            Lack::Texture { weakest, needed, .. } => {
                write!(f, "(gradient {weakest:.3} of {needed:.3} grey levels/px needed)")
            }
            Lack::Precision { sigma_px } if sigma_px.is_finite() => {
                write!(f, "(the displacement there would be uncertain by {sigma_px:.2} px)")
            }
            Lack::Precision { .. } => write!(f, "(the displacement there is not determined)"),
        }
    }
}

/// The nodes whose 2x2 block is singular within the noise of standard deviation `noise` (grey levels);
/// those without any pixel (`support` zero) among them.
///
/// The block is `sum psi^2 grad f grad f^T`; its smallest eigenvalue over `sum psi^2` is the mean square
/// gradient in the weakest direction. White noise alone gives `noise^2` times the gain of the gradient: `matrix` is the
/// one with its noise.
pub(super) fn faults(
    mesh: &Mesh<Px>,
    matrix: &BlockMatrix,
    support: &[f64],
    noise: &AssumedNoise,
    interpolation: Interpolation,
) -> Vec<TextureFault> {
    let from_noise = noise.of_check * noise.of_check * interpolation.gradient_noise_gain();
    (0..mesh.n_nodes())
        .filter_map(|node| {
            let [xx, xy, yy] = matrix.diagonal(node);
            let (mean, half) = (0.5 * (xx + yy), (0.25 * (xx - yy).powi(2) + xy * xy).sqrt());
            let weight = support[node].max(f64::MIN_POSITIVE);
            let needed = noise_margin(weight, noise.is_stated) * from_noise;
            let (weakest, strongest) = ((mean - half).max(0.0) / weight, (mean + half) / weight);
            // The relative floor catches exact stripes in noise-free images, where f32 leaves a rest.
            let fault = support[node] <= 0.0 || weakest <= needed || weakest <= 1e-5 * strongest;
            fault.then(|| TextureFault {
                node,
                at: mesh.nodes()[node],
                lack: Lack::Texture {
                    weakest: weakest.sqrt(),
                    needed: needed.max(1e-5 * strongest).sqrt(),
                    striped: strongest > needed,
                },
            })
        })
        .collect()
}

/// A node less certain than this (px, standard uncertainty) is not measured but guessed.
const LEAST_CERTAIN_PX: f64 = 0.5;

/// The nodes that their neighbourhood does not determine, whose standard uncertainty would be `sigma_px`: texture confined to a spot gives every node
/// around it a regular block, but not all of them together a displacement.
pub(super) fn undetermined(mesh: &Mesh<Px>, keep: &[bool], sigma_px: impl Fn(usize) -> [f64; 2]) -> Vec<TextureFault> {
    let sigma = |node: usize| larger(sigma_px(node));
    (0..mesh.n_nodes())
        .filter(|&node| keep[node] && sigma(node) > LEAST_CERTAIN_PX)
        .map(|node| fault_of_precision(mesh, node, sigma(node)))
        .collect()
}

/// The nodes to blame when the matrix has no factor although none is uncertain by the noise (images
/// without noise): those far less determined than most, at least the least determined one.
pub(super) fn least_determined(mesh: &Mesh<Px>, inverse_variance: &[[f64; 2]], keep: &[bool]) -> Vec<TextureFault> {
    const FAR: f64 = 1e4;
    let mut kept: Vec<(f64, usize)> =
        (0..mesh.n_nodes()).filter(|&node| keep[node]).map(|node| (larger(inverse_variance[node]), node)).collect();
    kept.sort_by(|a, b| b.0.total_cmp(&a.0));
    let limit = FAR * kept.get(kept.len() / 2).map_or(0.0, |median| median.0);
    let n_beyond = kept.iter().take_while(|(variance, _)| *variance > limit).count().max(1);
    kept.iter().take(n_beyond).map(|&(_, node)| fault_of_precision(mesh, node, f64::INFINITY)).collect()
}

fn larger([a, b]: [f64; 2]) -> f64 {
    a.max(b)
}

fn fault_of_precision(mesh: &Mesh<Px>, node: usize, sigma_px: f64) -> TextureFault {
    TextureFault { node, at: mesh.nodes()[node], lack: Lack::Precision { sigma_px } }
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
/// texture hardly has; Immerkaer 1996), at least the rounding of integer images. Fine or sharp-edged
/// speckles have second differences too, so it is taken to be at most 1 % of the range of grey levels: a
/// good reference must not be refused for a noise that nobody measured.
///
/// Where these tiles hold nothing but white noise there is no fine texture to mistake for it, and only the
/// span of such noise limits it: 8 to 10 standard deviations.
pub fn assumed_noise(image: &Image) -> f64 {
    let (low, high) = image.range();
    let quiet_tiles = &quietest_tiles(image, |_, _| true);
    let quiet = quiet_tiles.last().map_or(0.0, |tile| tile.0);
    // White noise has both alike, texture that a camera resolves has less than half of its contrast there.
    let n_white = quiet_tiles.iter().filter(|(noise, deviation)| *noise > 0.75 * deviation).count();
    let share = if 2 * n_white > quiet_tiles.len() { 0.125 } else { 0.01 };
    quiet.min(share * f64::from(high - low)).max(rounding(image))
}

/// The high-frequency content of the quietest tenth of the zones of `mesh`, grey levels: white noise, and what fine
/// texture adds to it.
pub(super) fn high_frequency(image: &Image, mesh: &Mesh<Px>) -> f64 {
    let bounds: Vec<Roi> = (0..mesh.zones().len()).map(|zone| mesh.bounds(zone)).collect();
    let inside = |x: usize, y: usize| {
        let (x, y) = (x as f64, y as f64);
        bounds.iter().any(|zone| (zone.x0..zone.x1).contains(&x) && (zone.y0..zone.y1).contains(&y))
    };
    quietest_tiles(image, inside).last().map_or(0.0, |tile| tile.0)
}

/// Noise by second differences, and standard deviation, of each tile of the quietest tenth of those that begin where
/// `counts` holds, in rising order.
fn quietest_tiles(image: &Image, counts: impl Fn(usize, usize) -> bool) -> Vec<(f64, f64)> {
    const TILE: usize = 16;
    let (width, height) = (image.width(), image.height());
    let (low, _) = image.range();
    let mut tiles: Vec<(f64, f64)> = Vec::new();
    // Every few rows and columns of tiles: a sample is enough.
    let step = TILE * (1 + width.max(height) / 1024);
    for y0 in (1..height.saturating_sub(TILE)).step_by(step) {
        for x0 in (1..width.saturating_sub(TILE)).step_by(step).filter(|&x0| counts(x0, y0)) {
            let (mut sum, mut greys, mut squares) = (0.0, 0.0, 0.0);
            for y in y0..y0 + TILE {
                for x in x0..x0 + TILE {
                    let row = |y: usize| {
                        f64::from(image.grey(x - 1, y)) - 2.0 * f64::from(image.grey(x, y))
                            + f64::from(image.grey(x + 1, y))
                    };
                    sum += (row(y - 1) - 2.0 * row(y) + row(y + 1)).powi(2);
                    let grey = f64::from(image.grey(x, y) - low);
                    greys += grey;
                    squares += grey * grey;
                }
            }
            let n = (TILE * TILE) as f64;
            // The mask's squared weights sum to 36.
            tiles.push(((sum / 36.0 / n).sqrt(), (squares / n - (greys / n).powi(2)).max(0.0).sqrt()));
        }
    }
    tiles.sort_by(|a, b| a.0.total_cmp(&b.0));
    tiles.truncate(tiles.len().div_ceil(10));
    tiles
}
