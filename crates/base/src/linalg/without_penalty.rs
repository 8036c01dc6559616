//! What the images alone say of a regularised field (docs/correlation.md, 2.9).

use super::blocks::{BlockMatrix, ElementMatrix, Pattern, upper};
use super::cholesky::{Cholesky, NotPositiveDefinite};
use super::dissection::dissection;
use super::selected_inverse::selected_inverse;
use super::spread::{Spread, spread};
use std::sync::Arc;

/// Nodes that the images alone would leave more uncertain than this, px, are not measured without the penalty.
const SIGMA_MOST_PX: f64 = 0.5;
/// Nor are those whose texture is less than this share of that of most.
const LEAST_TEXTURE: f64 = 1e-4;

/// Takes the penalty `w R` out of the fields of a regularised run.
///
/// Such a field has come to rest where `b = w R u`, with the right-hand side `b` of the images. Without the penalty the
/// next step would be `M0^-1 b`: the field after it is what the images alone say, with the covariance `2 sigma^2 M0^-1`
/// of any other, and nothing of what the penalty keeps from it. Nodes without texture say nothing.
pub struct WithoutPenalty {
    penalty: BlockMatrix,
    /// Of `M0`, in which nodes that are not seen are held.
    factor: Cholesky,
    /// The nodes that are coupled by elements.
    pattern: Arc<Pattern>,
    /// Of each node, whether the images alone would measure it.
    seen: Vec<bool>,
    /// Variance of each node with the penalty, and without it, for data of unit variance.
    variance: [Vec<[f64; 2]>; 2],
}

impl WithoutPenalty {
    /// For a mesh of `nodes`, px, and `elements` with the matrices `M0`, and the `noise` of an image, grey levels.
    ///
    /// # Errors
    /// A matrix that the images do not determine.
    pub fn new(
        nodes: &[[f64; 2]],
        elements: &[[u32; 4]],
        matrices: &[ElementMatrix],
        mut penalty: BlockMatrix,
        noise: f64,
    ) -> Result<Self, NotPositiveDefinite> {
        let pattern = Arc::new(Pattern::new(nodes.len(), elements));
        let mut all = BlockMatrix::assemble(&pattern, elements, matrices);
        let (seen, mut data) = (seen_nodes(&all, noise), all.clone());
        data.hold(&seen);
        // Nodes that were left out are in neither.
        let is_in = |node: usize| all.diagonal(node) != [0.0; 3] || penalty.diagonal(node) != [0.0; 3];
        let kept: Vec<bool> = (0..nodes.len()).map(is_in).collect();
        all.hold(&kept);
        penalty.hold(&kept);
        let order = dissection(&pattern, nodes, 0..nodes.len());
        let factor = Cholesky::new(&data, &order)?;
        let alone = selected_inverse(&data, &order, &pattern)?;
        let alone = (0..nodes.len()).map(|node| alone.diagonal(node)).map(|[xx, _, yy]| [xx, yy]).collect();
        let held_order = dissection(penalty.pattern(), nodes, 0..nodes.len());
        let Spread { variance, .. } = spread(&all, &penalty, &held_order)?;
        Ok(Self { penalty, factor, pattern, seen, variance: [variance, alone] })
    }

    /// Takes it out of a field: displacement and standard uncertainty of its nodes, px, and which are measured. What the
    /// penalty does beside a node that is not measured is not known: there, and at the next nodes, none is.
    pub fn apply(&self, displacement: &mut [[f64; 2]], sigma: &mut [[f64; 2]], measured: &mut [bool]) {
        let Self { penalty, factor, pattern, seen, variance: [with, alone] } = self;
        let all =
            |pattern: &Pattern, is: &[bool], node: usize| pattern.neighbours(node).iter().all(|&k| is[k as usize]);
        let known: Vec<bool> = (0..seen.len()).map(|node| all(penalty.pattern(), measured, node)).collect();
        let of_penalty = |(node, seen): (usize, &bool)| match *seen && known[node] {
            true => penalty.row_times(node, displacement),
            false => [0.0; 2],
        };
        let mut step: Vec<[f64; 2]> = seen.iter().enumerate().map(of_penalty).collect();
        factor.solve(&mut step);
        // What the frame's own noise, and its colour, make of the variances for data of unit variance.
        let scale = [0, 1].map(|c| {
            let of_node = |((sigma, with), seen): ((&[f64; 2], &[f64; 2]), &bool)| {
                (*seen && sigma[c] > 0.0 && with[c] > 0.0).then(|| (sigma[c] * sigma[c] / with[c]).ln())
            };
            let logs: Vec<f64> = sigma.iter().zip(with).zip(seen).filter_map(of_node).collect();
            (logs.iter().sum::<f64>() / logs.len().max(1) as f64).exp()
        });
        for (node, seen) in seen.iter().enumerate() {
            measured[node] &= *seen && all(pattern, &known, node);
            let is_measured = measured[node];
            (0..2).for_each(|c| {
                displacement[node][c] += step[node][c];
                sigma[node][c] = if is_measured { (scale[c] * alone[node][c]).sqrt() } else { 0.0 };
            });
        }
    }

    /// Takes nodes that are not seen out of the matrix of an element.
    pub fn forget(&self, matrix: &mut ElementMatrix, corners: &[u32; 4]) {
        for row in 0..8 {
            for column in row..8 {
                if ![row, column].into_iter().all(|at| self.seen[corners[at / 2] as usize]) {
                    matrix[upper(row, column)] = 0.0;
                }
            }
        }
    }
}

/// Of each node, whether its texture would tell where it is.
fn seen_nodes(data: &BlockMatrix, noise: f64) -> Vec<bool> {
    let least = |node: usize| {
        let [xx, xy, yy] = data.diagonal(node);
        0.5 * (xx + yy) - (0.25 * (xx - yy).powi(2) + xy * xy).sqrt()
    };
    let texture: Vec<f64> = (0..data.pattern().n_nodes()).map(least).collect();
    let mut sorted = texture.clone();
    sorted.sort_by(f64::total_cmp);
    let usual = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
    let enough = (2.0 * (noise / SIGMA_MOST_PX).powi(2)).max(LEAST_TEXTURE * usual).max(f64::MIN_POSITIVE);
    texture.into_iter().map(|texture| texture >= enough).collect()
}

#[cfg(test)]
mod tests {
    use super::WithoutPenalty;
    use crate::linalg::{BlockMatrix, ElementMatrix, Pattern, Solver, alike, dissection, selected_inverse, upper};
    use std::sync::Arc;

    /// Strip of `n` squares in a row.
    fn strip(n: u32) -> (Vec<[f64; 2]>, Vec<[u32; 4]>) {
        let nodes = (0..=n).flat_map(|k| [[f64::from(k), 0.0], [f64::from(k), 1.0]]).collect();
        (nodes, (0..n).map(|k| [2 * k, 2 * k + 2, 2 * k + 3, 2 * k + 1]).collect())
    }

    /// Positive definite, each other than the next.
    fn texture(element: u32) -> ElementMatrix {
        let mut matrix = [0.0; 36];
        for row in 0..8 {
            for column in row..8 {
                let mix = f64::from((7 * row as u32 + 3 * column as u32 + element) % 5);
                matrix[upper(row, column)] = if row == column { 40.0 + mix } else { mix };
            }
        }
        matrix
    }

    #[test]
    fn the_field_of_the_images_alone_comes_back_with_its_covariance_whatever_the_penalty() {
        let (nodes, elements) = strip(6);
        let matrices: Vec<ElementMatrix> = (0..6).map(texture).collect();
        let pattern = Arc::new(Pattern::new(nodes.len(), &elements));
        let data = BlockMatrix::assemble(&pattern, &elements, &matrices);
        let truth: Vec<[f64; 2]> = (0..nodes.len()).map(|k| [(k as f64).sin(), 0.3 * k as f64]).collect();
        let order = dissection(&pattern, &nodes, 0..nodes.len());
        let inverse = selected_inverse(&data, &order, &pattern).unwrap();
        for weight in [1.0, 300.0] {
            let together = std::array::from_fn(|i| std::array::from_fn(|j| if i == j { 3.0 } else { -1.0 }));
            let penalty = BlockMatrix::assemble(&pattern, &elements, &vec![alike(together, weight); 6]);
            let solver = Solver::regularised(data.clone(), Arc::new(penalty.clone()), &order).unwrap();
            let mut field = solver.solve(data.multiply(&truth));
            let off = |field: &[[f64; 2]]| {
                field.as_flattened().iter().zip(truth.as_flattened()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
            };
            assert!(off(&field) > 0.03, "the penalty takes something: {}", off(&field));
            // Standard uncertainties of the held field, for noise of variance 9.
            let held = crate::linalg::spread(&data, &penalty, &order).unwrap();
            let mut sigma: Vec<[f64; 2]> = held.variance.iter().map(|v| v.map(|v| (9.0 * v).sqrt())).collect();
            let mut measured = vec![true; nodes.len()];
            let without = WithoutPenalty::new(&nodes, &elements, &matrices, penalty, 0.01).unwrap();
            without.apply(&mut field, &mut sigma, &mut measured);
            // Solved in single precision and refined.
            assert!(off(&field) < 1e-6, "{}", off(&field));
            assert!(!measured.contains(&false));
            for (node, sigma) in sigma.iter().enumerate() {
                let [xx, _, yy] = inverse.diagonal(node);
                for (sigma, variance) in sigma.iter().zip([xx, yy]) {
                    // `spread` differentiates with steps of 1 %.
                    assert!((sigma * sigma / (9.0 * variance) - 1.0).abs() < 1e-3, "{sigma} {variance}");
                }
            }
        }
    }

    #[test]
    fn what_is_not_measured_makes_nothing_of_the_rest_wrong() {
        let (nodes, elements) = strip(30);
        let matrices: Vec<ElementMatrix> = (0..30).map(texture).collect();
        let pattern = Arc::new(Pattern::new(nodes.len(), &elements));
        let data = BlockMatrix::assemble(&pattern, &elements, &matrices);
        let together = std::array::from_fn(|i| std::array::from_fn(|j| if i == j { 3.0 } else { -1.0 }));
        let penalty = BlockMatrix::assemble(&pattern, &elements, &[alike(together, 20.0); 30]);
        let truth: Vec<[f64; 2]> = (0..nodes.len()).map(|k| [(0.2 * k as f64).sin(), 1.0]).collect();
        let order = dissection(&pattern, &nodes, 0..nodes.len());
        let solver = Solver::regularised(data.clone(), Arc::new(penalty.clone()), &order).unwrap();
        let (mut field, mut measured) = (solver.solve(data.multiply(&truth)), vec![true; nodes.len()]);
        let mut sigma = vec![[0.1; 2]; nodes.len()];
        let held = (0..nodes.len()).map(|k| (field[k][0] - truth[k][0]).abs()).fold(0.0, f64::max);
        (field[30], measured[30], sigma[30]) = ([f64::NAN; 2], false, [0.0; 2]);
        let without = WithoutPenalty::new(&nodes, &elements, &matrices, penalty, 0.01).unwrap();
        without.apply(&mut field, &mut sigma, &mut measured);
        // The column of the node, the two beside it, and the two beside those.
        let lost: Vec<usize> = (0..nodes.len()).filter(|&k| !measured[k]).collect();
        assert_eq!(lost, (26..36).collect::<Vec<_>>());
        let left = (0..nodes.len()).filter(|&k| measured[k]);
        let off = left.map(|k| (field[k][0] - truth[k][0]).abs()).fold(0.0, f64::max);
        // What is made of nothing there falls by ten from column to column.
        assert!(off < 0.02 * held, "{off} of {held}");
    }

    #[test]
    fn nodes_without_texture_are_not_measured_and_the_others_as_they_are() {
        let (nodes, elements) = strip(6);
        // The last two squares are bare: the nodes 10 to 13 see nothing.
        let matrices: Vec<ElementMatrix> = (0..6).map(|e| if e < 4 { texture(e) } else { [0.0; 36] }).collect();
        // And two nodes that have been left out, as if they were none.
        let nodes: Vec<[f64; 2]> = nodes.into_iter().chain([[9.0, 0.0], [9.0, 1.0]]).collect();
        let pattern = Arc::new(Pattern::new(nodes.len(), &elements));
        let data = BlockMatrix::assemble(&pattern, &elements, &matrices);
        let together = std::array::from_fn(|i| std::array::from_fn(|j| if i == j { 3.0 } else { -1.0 }));
        let penalty = BlockMatrix::assemble(&pattern, &elements, &[alike(together, 20.0); 6]);
        let truth: Vec<[f64; 2]> = (0..nodes.len()).map(|k| [0.1 * k as f64, 1.0]).collect();
        let order = dissection(&pattern, &nodes, 0..nodes.len());
        let (mut held, mut of_penalty) = (data.clone(), penalty.clone());
        let kept: Vec<bool> = (0..nodes.len()).map(|node| node < 14).collect();
        held.hold(&kept);
        of_penalty.hold(&kept);
        let solver = Solver::regularised(held, Arc::new(of_penalty), &order).unwrap();
        let (mut field, mut measured) = (solver.solve(data.multiply(&truth)), kept);
        let mut sigma = vec![[0.1; 2]; nodes.len()];
        let without = WithoutPenalty::new(&nodes, &elements, &matrices, penalty, 0.01).unwrap();
        without.apply(&mut field, &mut sigma, &mut measured);
        assert_eq!(measured.iter().filter(|seen| **seen).count(), 10);
        for node in 0..10 {
            assert!(measured[node] && (0..2).all(|c| (field[node][c] - truth[node][c]).abs() < 1e-6), "{node}");
            assert!(sigma[node].iter().all(|s| *s > 0.0));
        }
        assert!(sigma[10..].iter().all(|s| *s == [0.0; 2]));
        let mut of_border = [1.0; 36];
        without.forget(&mut of_border, &elements[4]);
        // Of the corners 8, 10, 11 and 9 the middle two see nothing.
        assert_eq!((of_border[upper(0, 0)], of_border[upper(0, 6)]), (1.0, 1.0));
        assert!([(2, 2), (0, 2), (5, 6), (4, 5)].iter().all(|&(r, c)| of_border[upper(r, c)] == 0.0));
    }
}
