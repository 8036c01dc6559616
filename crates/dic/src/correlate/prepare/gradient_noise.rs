//! The share of the normal matrix that is none of texture but of the noise in the reference's gradient (THEORY 10):
//! `E[M] = M0 + lambda P`, `lambda = sigma^2 G / k`.

use crate::backend::{ElementMoments, KernelOptions};
use crate::correlate::{Options, assumed_noise};
use crate::field::Brightness;
use crate::imaging::Image;
use crate::linalg::{BlockMatrix, ElementMatrix, Pattern, alike, upper};
use crate::mesh::{Mesh, PixelSet, mean_products};
use crate::units::Px;
use rayon::prelude::*;
use std::sync::Arc;

/// Steps are made with at least this share of the normal matrix of every element in every direction, whatever noise is
/// taken off: were the noise nothing but fine texture, they would be too long by 1/0.6 and converge all the same.
pub(crate) const LEAST_SHARE_OF_STEPS: f64 = 0.6;
/// The inverse variance of a node keeps at least this share of what the matrix with its noise gives: what is left is
/// then little more than the scatter of the noise's own sums, and the standard uncertainty a lower bound.
pub(crate) const LEAST_SHARE_OF_VARIANCE: f64 = 0.1;

/// What is taken for the noise before any image is correlated with the reference.
#[derive(Debug, Clone, Copy)]
pub(crate) struct AssumedNoise {
    /// Standard deviation of the noise of one image for the texture check, grey levels.
    pub of_check: f64,
    /// Whether that is known, and not a guess on the safe side.
    pub is_stated: bool,
    /// Standard deviation of the noise of the reference for the steps, grey levels.
    pub of_reference: f64,
    /// Standard deviation that the fine structure of the reference has, with its texture, grey levels.
    in_image: f64,
}

impl AssumedNoise {
    /// The noise that is stated for one image, or what the reference looks like.
    ///
    /// Steps are made with the least that either says: too little is slow, and too much is worse.
    pub fn of(reference: &Image, zones: &[PixelSet], options: &Options) -> Self {
        let stated = options.noise.constant();
        let of_mean = |noise: f64| noise / (options.n_references.max(1) as f64).sqrt();
        let in_image = fine_content(reference);
        Self {
            of_check: stated.unwrap_or_else(|| assumed_noise(reference, zones)),
            is_stated: stated.is_some(),
            of_reference: in_image.min(stated.map_or(f64::INFINITY, of_mean)),
            in_image,
        }
    }

    /// The noise that is stated, where it is beyond what the fine structure of the image holds.
    pub fn beyond_image(self) -> Option<f64> {
        /// Of the noise of one image: what its fine structure tells scatters.
        const BEYOND: f64 = 1.25;
        Some(self.of_check).filter(|stated| self.is_stated && *stated > BEYOND * self.in_image)
    }

    /// The same for images of 2^level by 2^level pixels averaged.
    pub fn at_level(self, level: usize) -> Self {
        let scale = 1.0 / f64::from(1u32 << level.min(30));
        Self { of_check: scale * self.of_check, of_reference: scale * self.of_reference, ..self }
    }

    /// What it adds to the mean square of each component of the reference's gradient.
    pub fn lambda(self, kernel: &KernelOptions) -> f64 {
        self.of_reference * self.of_reference * kernel.gradient_noise_gain
    }
}

/// `sum psi_i psi_j` over the pixels of an element; cut by the border of its zone, as if its pixels lay evenly.
pub(crate) fn mass_matrix(mesh: &Mesh<Px>, element: usize, moments: &ElementMoments) -> ElementMatrix {
    alike(mean_products(mesh.corners(element)), moments.n)
}

/// What is taken off an element: `lambda`, or as much less, in steps of a quarter, as leaves [`LEAST_SHARE_OF_STEPS`]
/// of its matrix in every direction. So `M0` is positive definite where `M` is.
fn noise_to_take_off(matrix: &ElementMatrix, mass: &ElementMatrix, lambda: f64) -> f64 {
    /// Steps down to what is not worth taking off: less than a fiftieth of it.
    const STEPS: i32 = 14;
    let after = |steps: i32| lambda * 0.75f64.powi(steps);
    let leaves_enough = |steps: i32| {
        let taken = after(steps);
        is_positive_definite(std::array::from_fn(|k| (1.0 - LEAST_SHARE_OF_STEPS) * matrix[k] - taken * mass[k]))
    };
    if leaves_enough(0) {
        return lambda;
    }
    // The less is taken, the more is left: of the steps above `low` none leaves enough, and those from `high` on do.
    let (mut low, mut high) = (0, STEPS);
    while high - low > 1 {
        let middle = (low + high) / 2;
        if leaves_enough(middle) { high = middle } else { low = middle }
    }
    if high < STEPS { after(high) } else { 0.0 }
}

/// What one element brings to the matrices of a frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OfElement {
    /// Its part of `M0`.
    pub matrix: ElementMatrix,
    /// Its part of `P`.
    pub mass: ElementMatrix,
    /// What was taken off its matrix.
    pub lambda: f64,
}

impl OfElement {
    /// Nothing, of an element that is left out.
    pub const NONE: Self = Self { matrix: [0.0; 36], mass: [0.0; 36], lambda: 0.0 };

    /// From its moments, for noise that adds `lambda` to the mean square of each component of the gradient.
    pub fn new(
        mesh: &Mesh<Px>,
        element: usize,
        moments: &ElementMoments,
        options: &KernelOptions,
        lambda: f64,
    ) -> Self {
        let matrix = match options.brightness {
            Brightness::Element => moments.matrix_without_transfer(),
            _ => moments.matrix(),
        };
        let mass = mass_matrix(mesh, element, moments);
        if lambda <= 0.0 {
            return Self { matrix, mass, lambda: 0.0 };
        }
        let lambda = noise_to_take_off(&matrix, &mass, lambda);
        Self { matrix: std::array::from_fn(|k| matrix[k] - lambda * mass[k]), mass, lambda }
    }

    pub fn all(mesh: &Mesh<Px>, moments: &[ElementMoments], options: &KernelOptions, lambda: f64) -> Vec<Self> {
        let of_element = |(element, moments)| Self::new(mesh, element, moments, options, lambda);
        moments.par_iter().enumerate().with_min_len(64).map(of_element).collect()
    }
}

/// `M0 = M - lambda P`, assembled.
pub(crate) fn without_noise(mesh: &Mesh<Px>, pattern: &Arc<Pattern>, of_elements: &[OfElement]) -> BlockMatrix {
    BlockMatrix::assemble_by(pattern, mesh.elements(), |element| &of_elements[element as usize].matrix)
}

/// The block of `M`, which has the noise of the gradient, on the diagonal at a node: `[xx, xy, yy]`.
pub(crate) fn diagonal_with_noise(
    mesh: &Mesh<Px>,
    pattern: &Pattern,
    of_elements: &[OfElement],
    node: usize,
) -> [f64; 3] {
    pattern.diagonal_block(mesh.elements(), node, |element, at| {
        let OfElement { matrix, mass, lambda } = &of_elements[element as usize];
        matrix[at] + lambda * mass[at]
    })
}

fn is_positive_definite(mut matrix: ElementMatrix) -> bool {
    for k in 0..8 {
        let pivot = matrix[upper(k, k)];
        if pivot <= 0.0 || pivot.is_nan() {
            return false;
        }
        for i in k + 1..8 {
            let factor = matrix[upper(k, i)] / pivot;
            for j in i..8 {
                matrix[upper(i, j)] -= factor * matrix[upper(k, j)];
            }
        }
    }
    true
}

/// Sums of `f_x^2`, `f_x f_y`, `f_y^2` over the pixels of an element.
pub(crate) fn gradient_sums(moments: &ElementMoments) -> [f64; 3] {
    // The weights (1-s)^2, s(1-s), s^2 add up to 1 with the middle one twice.
    let sum = |w: [f64; 3]| w[0] + 2.0 * w[1] + w[2];
    moments.gradient.map(|by| sum(by.map(sum)))
}

/// White noise of an image by its fourth differences along both axes, which texture that a camera resolves hardly has,
/// grey levels: the median over tiles of the image. Sharp edges everywhere count as noise; a few do not.
///
/// It is what steps may be made with, which converge with any value; not a standard uncertainty.
pub(crate) fn fine_content(image: &Image) -> f64 {
    /// Side of a tile, px: its 256 sums tell a noise to a few per cent.
    const TILE: usize = 16;
    /// Fourth difference.
    const MASK: [f64; 5] = [1.0, -4.0, 6.0, -4.0, 1.0];
    let (width, height) = (image.width(), image.height());
    let mut tiles: Vec<f64> = Vec::new();
    // A sample of the tiles is enough.
    let step = TILE * (1 + 3 * width.max(height) / 1024);
    for y0 in (2..height.saturating_sub(TILE + 1)).step_by(step) {
        for x0 in (2..width.saturating_sub(TILE + 1)).step_by(step) {
            let mut sum = 0.0;
            for y in y0..y0 + TILE {
                // Along the row of column differences.
                let mut columns = [0.0; TILE + 4];
                for (k, column) in columns.iter_mut().enumerate() {
                    let x = x0 + k - 2;
                    *column = MASK.iter().enumerate().map(|(j, m)| m * f64::from(image.grey(x, y + j - 2))).sum();
                }
                sum += columns
                    .windows(5)
                    .map(|w| MASK.iter().zip(w).map(|(m, c)| m * c).sum::<f64>().powi(2))
                    .sum::<f64>();
            }
            // The squares of the mask's 25 weights add up to 70^2.
            tiles.push(sum / (70.0 * 70.0 * (TILE * TILE) as f64));
        }
    }
    if tiles.is_empty() {
        return 0.0;
    }
    tiles.sort_by(f64::total_cmp);
    tiles[tiles.len() / 2].sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_the_steps_that_leave_enough_of_a_matrix_the_first_is_taken() {
        // The masses of a square element of 16 px, and a texture of stripes beside a weaker one across, the mean square
        // of which falls.
        const LINE: [[f64; 2]; 2] = [[2.0, 1.0], [1.0, 2.0]];
        let corner = [[0, 0], [1, 0], [1, 1], [0, 1]];
        let products: [[f64; 4]; 4] = std::array::from_fn(|i| {
            std::array::from_fn(|j| LINE[corner[i][0]][corner[j][0]] * LINE[corner[i][1]][corner[j][1]] / 36.0)
        });
        let mass = alike(products, 16.0);
        let (lambda, mut taken) = (2.0, Vec::new());
        for weakest in [100.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.0, 0.5, 0.2, 0.12, 0.1, 0.0] {
            // Odd rows and columns are those of the second component.
            let mut matrix = mass;
            for (row, col) in (0..8).flat_map(|row| (row..8).map(move |col| (row, col))) {
                matrix[upper(row, col)] *= if row % 2 == 1 { weakest } else { 100.0 };
            }
            let leaves_enough = |taken: f64| {
                is_positive_definite(std::array::from_fn(|k| {
                    (1.0 - LEAST_SHARE_OF_STEPS) * matrix[k] - taken * mass[k]
                }))
            };
            let one_by_one = (0..14).map(|step| lambda * 0.75f64.powi(step)).find(|&taken| leaves_enough(taken));
            assert_eq!(noise_to_take_off(&matrix, &mass, lambda), one_by_one.unwrap_or(0.0), "{weakest}");
            taken.push(one_by_one.unwrap_or(0.0));
        }
        assert_eq!((taken[0], taken[11]), (lambda, 0.0));
        taken.dedup();
        assert!(taken.len() > 6, "{taken:?}");
    }
}
