//! Those entries of the inverse of a sparse matrix that lie on a pattern, from its Cholesky factor.

use super::blocks::{BlockMatrix, Pattern};
use super::cholesky::{Cholesky, NotPositiveDefinite};
use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::{solve_lower_triangular_in_place, solve_upper_triangular_in_place};
use faer::sparse::linalg::cholesky::SymbolicCholeskyRaw;
use faer::sparse::linalg::cholesky::supernodal::SymbolicSupernodalCholesky;
use faer::{Accum, Mat, MatMut, Par};
use std::sync::Arc;

/// The blocks of the inverse of `matrix` on `pattern`, a part of its own; the nodes are eliminated in `order`.
///
/// Exact: the entries of the inverse on the pattern of the factor follow from each other, from the last column to
/// the first (Takahashi, Fagan & Chen 1973). With the factor `L` of the columns `J` of a piece and of the rows `R`
/// below them, `Y = L_RJ L_JJ^-1`:
/// `Z_RJ = -Z_RR Y`, `Z_JJ = (L_JJ L_JJ^T)^-1 - Y^T Z_RJ`. Costs about as much as two to three factorisations.
///
/// # Errors
/// [`NotPositiveDefinite`] when there is no factor.
///
/// # Panics
/// When `order` is not a permutation of the nodes, or `pattern` is not within that of `matrix`.
pub fn selected_inverse(
    matrix: &BlockMatrix,
    order: &[usize],
    pattern: &Arc<Pattern>,
) -> Result<BlockMatrix, NotPositiveDefinite> {
    Ok(inverse_by(&Cholesky::in_pieces(matrix, order)?, order, pattern))
}

/// The same from the factor of the matrix, which was asked for in pieces.
pub(super) fn inverse_by(factor: &Cholesky, order: &[usize], pattern: &Arc<Pattern>) -> BlockMatrix {
    let (symbolic, values) = factor.parts();
    let SymbolicCholeskyRaw::Supernodal(pieces) = symbolic.raw() else {
        unreachable!("the factor was asked for in pieces")
    };
    let mut values = values.to_vec();
    invert(pieces, &mut values);
    let mut place = vec![0u32; pattern.n_nodes()];
    for (at, &node) in order.iter().enumerate() {
        place[node] = 2 * at as u32;
    }
    let piece_of = piece_of(pieces);
    BlockMatrix::from_blocks(pattern, |row, column| {
        let entry = |c: u32, d: u32| {
            let (a, b) = (place[row] + c, place[column] + d);
            entry(pieces, &values, &piece_of, a.max(b), a.min(b))
        };
        [entry(0, 0), entry(0, 1), entry(1, 0), entry(1, 1)]
    })
}

fn piece_of(pieces: &SymbolicSupernodalCholesky<u32>) -> Vec<u32> {
    let mut piece_of = vec![0; pieces.nrows()];
    for (piece, (&begin, &end)) in pieces.supernode_begin().iter().zip(pieces.supernode_end()).enumerate() {
        piece_of[begin as usize..end as usize].fill(piece as u32);
    }
    piece_of
}

/// Columns, rows below them, and values of a piece.
fn shape(pieces: &SymbolicSupernodalCholesky<u32>, piece: usize) -> (usize, usize, &[u32], std::ops::Range<usize>) {
    let (begin, end) = (pieces.supernode_begin()[piece] as usize, pieces.supernode_end()[piece] as usize);
    let values = pieces.col_ptr_for_val()[piece] as usize..pieces.col_ptr_for_val()[piece + 1] as usize;
    (begin, end, pieces.supernode(piece).pattern(), values)
}

/// Entry (row, column), row not above column, of what the values hold.
fn entry(pieces: &SymbolicSupernodalCholesky<u32>, values: &[f64], piece_of: &[u32], row: u32, column: u32) -> f64 {
    let (begin, end, rows, range) = shape(pieces, piece_of[column as usize] as usize);
    let n_columns = end - begin;
    let local = if (row as usize) < end {
        row as usize - begin
    } else {
        match rows.binary_search(&row) {
            Ok(at) => n_columns + at,
            Err(_) => panic!("the pattern asked for is not within that of the matrix"),
        }
    };
    values[range.start + (column as usize - begin) * (n_columns + rows.len()) + local]
}

/// Turns the factor into the inverse, piece by piece from the last: a piece of the factor is needed only for itself.
fn invert(pieces: &SymbolicSupernodalCholesky<u32>, values: &mut [f64]) {
    let piece_of = piece_of(pieces);
    for piece in (0..pieces.n_supernodes()).rev() {
        let (begin, end, rows, range) = shape(pieces, piece);
        let (n, m) = (end - begin, rows.len());
        // What is done lies behind this piece.
        let (head, done) = values.split_at_mut(range.end);
        let below = inverse_below(pieces, done, range.end, &piece_of, rows);
        let own = MatMut::from_column_major_slice_mut(&mut head[range], n + m, n);
        let (mut top, mut bottom) = own.split_at_row_mut(n);
        let mut factor_inverse = Mat::<f64>::identity(n, n);
        solve_lower_triangular_in_place(top.as_ref(), factor_inverse.as_mut(), Par::Seq);
        // Y^T, then Z_RJ = -Z_RR Y.
        let mut y = bottom.as_ref().transpose().to_owned();
        solve_upper_triangular_in_place(top.as_ref().transpose(), y.as_mut(), Par::Seq);
        matmul(bottom.as_mut(), Accum::Replace, below.as_ref(), y.as_ref().transpose(), -1.0, Par::Seq);
        matmul(
            top.as_mut(),
            Accum::Replace,
            factor_inverse.as_ref().transpose(),
            factor_inverse.as_ref(),
            1.0,
            Par::Seq,
        );
        matmul(top.as_mut(), Accum::Add, y.as_ref(), bottom.as_ref(), -1.0, Par::Seq);
    }
}

/// The inverse at all pairs of `rows`, whose pieces are `done`; their values begin at `offset`.
fn inverse_below(
    pieces: &SymbolicSupernodalCholesky<u32>,
    done: &[f64],
    offset: usize,
    piece_of: &[u32],
    rows: &[u32],
) -> Mat<f64> {
    let m = rows.len();
    let mut below = Mat::<f64>::zeros(m, m);
    // Places of the rows from `first` on in the piece of that row.
    let mut places = Vec::with_capacity(m);
    let mut first = 0;
    while first < m {
        let (begin, end, theirs, range) = shape(pieces, piece_of[rows[first] as usize] as usize);
        let n = end - begin;
        places.clear();
        let mut at = 0;
        for &row in &rows[first..] {
            if (row as usize) < end {
                places.push(row as usize - begin);
                continue;
            }
            // Both lists ascend; by the rules of fill theirs holds ours.
            while theirs[at] < row {
                at += 1;
            }
            places.push(n + at);
        }
        let n_own = rows[first..].iter().take_while(|&&row| (row as usize) < end).count();
        for a in 0..n_own {
            let start = range.start - offset + places[a] * (n + theirs.len());
            for (b, &place) in places.iter().enumerate().skip(a) {
                let value = done[start + place];
                below[(first + b, first + a)] = value;
                below[(first + a, first + b)] = value;
            }
        }
        first += n_own;
    }
    below
}
