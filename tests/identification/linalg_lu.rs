//! The LU factors of general matrices, against one another and against the residual.

use quadrille::linalg::{LuChoice, LuPlan, Singular, SparseMatrix, SparsePattern};
use std::sync::Arc;

const CHOICES: [LuChoice; 3] = [LuChoice::Banded, LuChoice::Sparse, LuChoice::Nested];

/// A grid of `columns` by `rows` nodes with two unknowns each, coupled with their eight neighbours.
fn grid(columns: usize, rows: usize) -> (Arc<SparsePattern>, Vec<[f64; 2]>) {
    let mut cells = Vec::new();
    for j in 0..rows - 1 {
        for i in 0..columns - 1 {
            let node = |i: usize, j: usize| (i * rows + j) as u32;
            let corners = [node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)];
            cells.push(corners.iter().flat_map(|&k| [2 * k, 2 * k + 1]).collect::<Vec<u32>>());
        }
    }
    let points = (0..columns).flat_map(|i| (0..rows).flat_map(move |j| [[i as f64, j as f64]; 2])).collect();
    let pattern = SparsePattern::from_groups(2 * columns * rows, cells.iter().map(Vec::as_slice));
    (Arc::new(pattern), points)
}

/// Entries in -1..1 without symmetry, `diagonal` added to the diagonal.
fn filled(pattern: &Arc<SparsePattern>, diagonal: f64) -> SparseMatrix {
    let mut matrix = SparseMatrix::zero(pattern);
    for column in 0..pattern.n() {
        for at in pattern.range(column) {
            matrix.values_mut()[at] = (1.0 + 0.37 * at as f64).sin();
        }
        let at = pattern.place(column, column).unwrap();
        matrix.values_mut()[at] += diagonal;
    }
    matrix
}

#[test]
fn every_factor_solves_matrices_without_symmetry_and_with_small_pivots() {
    for (columns, rows) in [(2, 2), (9, 4), (30, 23)] {
        let (pattern, points) = grid(columns, rows);
        // 0.3: pivots must be exchanged; 12: hardly any.
        for diagonal in [0.3, 12.0] {
            let matrix = filled(&pattern, diagonal);
            let exact: Vec<f64> = (0..3 * pattern.n()).map(|k| (0.1 + 1.3 * k as f64).cos()).collect();
            let rhs: Vec<f64> = exact.chunks(pattern.n()).flat_map(|x| matrix.times(x)).collect();
            for choice in CHOICES {
                let mut factor = LuPlan::new(&pattern, &points, choice).factor();
                // The last factor must not see those before: with exchanges of rows, without, with a NaN.
                let mut broken = filled(&pattern, 5.0);
                broken.values_mut()[7] = f64::NAN;
                factor.refactor(&filled(&pattern, 0.3)).unwrap();
                factor.refactor(&filled(&pattern, 5.0)).unwrap();
                assert!(factor.refactor(&broken).is_err());
                factor.refactor(&matrix).unwrap();
                let mut found = rhs.clone();
                factor.solve(&mut found);
                // One by one the banded factor gives the same bits (of the others libraries decide).
                let alone = rhs.chunks(pattern.n()).flat_map(|rhs| {
                    let mut rhs = rhs.to_vec();
                    factor.solve(&mut rhs);
                    rhs
                });
                assert!(choice != LuChoice::Banded || alone.eq(found.iter().copied()), "{choice:?}");
                let off = found.iter().zip(&exact).fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
                // The matrices with small pivots are badly conditioned, and rows are exchanged within a front only.
                let allowed = if diagonal < 1.0 { 1e-6 } else { 1e-12 };
                assert!(off < allowed, "{choice:?}, {columns} x {rows}, diagonal {diagonal}: {off:e}");
            }
        }
    }
}

#[test]
fn the_signs_of_the_pivots_tell_a_definite_matrix_and_the_sign_of_the_determinant() {
    let (pattern, points) = grid(12, 7);
    for choice in [LuChoice::Banded, LuChoice::Nested] {
        let mut factor = LuPlan::new(&pattern, &points, choice).factor();
        factor.refactor(&filled(&pattern, 20.0)).unwrap();
        assert!(factor.pivots().unwrap().all_positive());
        let mut matrix = filled(&pattern, 20.0);
        let at = pattern.place(31, 31).unwrap();
        matrix.values_mut()[at] = -20.0;
        factor.refactor(&matrix).unwrap();
        let signs = factor.pivots().unwrap();
        assert!(!signs.all_positive() && !signs.positive_determinant(), "{signs:?}");
    }
}

#[test]
fn a_matrix_without_inverse_is_refused_and_so_is_one_with_a_nan() {
    let (pattern, points) = grid(6, 5);
    for choice in CHOICES {
        let mut factor = LuPlan::new(&pattern, &points, choice).factor();
        let mut matrix = filled(&pattern, 12.0);
        pattern.range(17).for_each(|at| matrix.values_mut()[at] = 0.0);
        // faer's factor is made of anything; what comes out is not finite then.
        if choice != LuChoice::Sparse {
            assert!(matches!(factor.refactor(&matrix), Err(Singular { .. })), "{choice:?}");
        }
        let mut matrix = filled(&pattern, 12.0);
        matrix.values_mut()[40] = f64::NAN;
        assert!(factor.refactor(&matrix).is_err(), "{choice:?}");
    }
}
