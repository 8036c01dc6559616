//! Does every node see texture? (THEORY 2)

use crate::backend::ElementMatch;
use crate::correlate::{AssumedNoise, Lack, TextureFault};
use crate::mesh::Mesh;
use crate::units::Px;
use rayon::prelude::*;

/// A node is without texture when its weakest gradient direction carries less than this many times the average of
/// noise. A node of `support` (sum of psi^2) sees about 2.8 times as many independent pixels, and the margin is five
/// and a half standard deviations of their mean square.
///
/// An assumed noise may be too small: half as much again is asked for. Of a stated one it is enough that something is
/// left of the matrix without its noise (THEORY 10).
fn noise_margin(support: f64, is_stated: bool) -> f64 {
    let safety = if is_stated { 1.0 } else { 1.5 };
    safety + 4.8 / support.max(1.0).sqrt()
}

/// The standard uncertainty, px, that noise alone may pretend where nothing but noise is in the gradient: of a node of
/// `support`, for noise that adds `gain` times its variance to the mean square of each component.
fn pretended_px(support: f64, gain: f64) -> f64 {
    let beyond = noise_margin(support, true) - 1.0;
    (2.0 / (support.max(1.0) * gain * beyond)).sqrt()
}

/// The nodes whose 2x2 block is singular within the `noise`, grey levels; those without any pixel among them.
///
/// The block is `sum psi^2 grad f grad f^T`; its smallest eigenvalue over `sum psi^2` is the mean square gradient in
/// the weakest direction. Noise adds `noise^2` times the `gain` of the gradient, to `blocks`, `[xx, xy, yy]`, too. Where
/// that could not make a node look more certain than `most_px`, its standard uncertainty alone decides.
pub(crate) fn find_faults(
    mesh: &Mesh<Px>,
    blocks: &[[f64; 3]],
    support: &[f64],
    noise: &AssumedNoise,
    gain: f64,
    most_px: f64,
) -> Vec<TextureFault> {
    let from_noise = noise.of_check * noise.of_check * gain;
    (0..mesh.n_nodes())
        .into_par_iter()
        .with_min_len(2048)
        .filter_map(|node| {
            let weight = support[node].max(f64::MIN_POSITIVE);
            let needed = noise_margin(weight, noise.is_stated) * from_noise;
            let [weakest, strongest] = weakest_and_strongest(blocks[node], weight);
            // The relative floor catches exact stripes in noise-free images, where f32 leaves a rest.
            let is_hidden = weakest <= needed && pretended_px(weight, gain) < most_px;
            let fault = support[node] <= 0.0 || is_hidden || weakest <= 1e-5 * strongest;
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

/// Mean squares of the gradient in its weakest and its strongest direction, by a block and the sum of psi^2.
fn weakest_and_strongest([xx, xy, yy]: [f64; 3], weight: f64) -> [f64; 2] {
    let (mean, half) = (0.5 * (xx + yy), (0.25 * (xx - yy).powi(2) + xy * xy).sqrt());
    [(mean - half).max(0.0) / weight, (mean + half) / weight]
}

/// What a node sees: enough to ask again whether that is texture, when the noise is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SeenByNode {
    /// Mean square of the gradient in its weakest direction, with its noise, (grey levels / px)^2.
    weakest: f64,
    /// Sum of psi^2 over the pixels.
    support: f64,
}

/// What every node sees, by its block with its noise.
pub(crate) fn seen_by_nodes(blocks: &[[f64; 3]], support: &[f64]) -> Vec<SeenByNode> {
    let seen = |(&block, &support): (&[f64; 3], &f64)| {
        let [weakest, _] = weakest_and_strongest(block, support.max(f64::MIN_POSITIVE));
        SeenByNode { weakest, support }
    };
    blocks.iter().zip(support).map(seen).collect()
}

impl SeenByNode {
    /// Whether noise that adds `from_noise` is so large a part of it that corrections of the node fall slowly: from a
    /// share of a quarter in many pixels on, and from a smaller one in few, of which the noise scatters.
    pub fn is_noisy(self, from_noise: f64) -> bool {
        self.weakest <= 2.0 * noise_margin(self.support, false) * from_noise
    }

    /// Whether nothing of it stands out of noise of the variance `square`, which adds `gain` times as much to the mean
    /// square of each component of the gradient: noise that was seen, so that it is enough that more is there than it
    /// can scatter by. It stays, with the standard uncertainty that it has, where noise could pretend none of `most_px`.
    fn is_noise(self, square: f64, gain: f64, most_px: f64) -> bool {
        let is_hidden = self.weakest <= noise_margin(self.support, true) * gain * square;
        is_hidden && pretended_px(self.support, gain) < most_px
    }
}

/// The nodes of `measured` that see nothing but noise: the mean square of the residual of a node's elements over
/// `of_pair` (what noise of one grey level in one image gives, per zone). The quietest places of the reference, by
/// which it was checked at first, may be the holes themselves.
///
/// `gain` is what noise of variance one adds to the mean square of the reference's gradient.
pub(crate) fn lost_in_noise(
    mesh: &Mesh<Px>,
    seen: &[SeenByNode],
    elements: &[ElementMatch],
    (of_pair, gain): (&[f64], f64),
    measured: &[bool],
    most_px: f64,
) -> Vec<usize> {
    let mut sums = vec![[0.0; 2]; mesh.n_nodes()];
    for (element, (nodes, matched)) in mesh.elements().iter().zip(elements).enumerate() {
        let square = matched.residual_rms.powi(2) / of_pair[mesh.element_zone()[element] as usize];
        for &node in nodes.iter().filter(|_| matched.n > 0.0 && square.is_finite()) {
            let sums = &mut sums[node as usize];
            *sums = [sums[0] + matched.n * square, sums[1] + matched.n];
        }
    }
    let is_lost = |&node: &usize| {
        let [squares, n] = sums[node];
        measured[node] && n > 0.0 && seen[node].is_noise(squares / n, gain, most_px)
    };
    (0..mesh.n_nodes()).filter(is_lost).collect()
}

/// The nodes that their neighbourhood does not determine, whose standard uncertainty `sigma_px` would exceed `most_px`:
/// texture confined to a spot gives every node around it a regular block, but not all of them together a displacement.
pub(crate) fn find_undetermined(
    mesh: &Mesh<Px>,
    keep: &[bool],
    most_px: f64,
    sigma_px: impl Fn(usize) -> [f64; 2] + Sync,
) -> Vec<TextureFault> {
    let sigma = |node: usize| larger(sigma_px(node));
    (0..mesh.n_nodes())
        .into_par_iter()
        .with_min_len(2048)
        .filter(|&node| keep[node] && sigma(node) > most_px)
        .map(|node| fault_of_precision(mesh, node, sigma(node)))
        .collect()
}

/// The nodes to blame when the matrix has no factor although none is uncertain by the noise (images
/// without noise): those far less determined than most, at least the least determined one.
pub(crate) fn find_least_determined(
    mesh: &Mesh<Px>,
    inverse_variance: &[[f64; 2]],
    keep: &[bool],
) -> Vec<TextureFault> {
    /// Variance by the median one, from which on a node is far less determined: a hundred times in displacement.
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
