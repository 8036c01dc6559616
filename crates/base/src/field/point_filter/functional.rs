//! Sums of coefficients near a node that are right for polynomials: the least change of the coefficient itself.

/// Powers of both coordinates of the monomials, in the order asked for: up to the third degree, both squared.
pub(super) const MONOMIALS: [[i32; 2]; N_MONOMIALS] =
    [[0, 0], [1, 0], [0, 1], [2, 0], [1, 1], [0, 2], [3, 0], [2, 1], [1, 2], [0, 3], [2, 2]];
/// How many there are.
pub(super) const N_MONOMIALS: usize = 11;
/// The first ones, which bilinear elements have themselves.
pub(super) const STRAIGHT: usize = 3;
/// How many there are up to the third degree, and up to the second.
const CUBIC: usize = 10;
const QUADRATIC: usize = 6;
/// Coefficients so many elements away are used.
pub(super) const REACH: usize = 3;
/// Square of a weight one element further away against that of one nearer, in the sum that is made least: as much as
/// keeps the sum among the nearest that will do.
const WEIGHT_OF_A_RING: f64 = 256.0;
/// What is left of a condition, against what it was, below which the others leave nothing of it.
const DEPENDENT: f64 = 1e-8;
/// How far a condition that the others leave nothing of may be missed.
const MISSED: f64 = 1e-6;
/// Variance of a value, in that of the coefficient, above which the coefficient is kept.
const MOST_VARIANCE: f64 = 4.0;

/// What is known of the coefficients within [`REACH`] elements of a node.
#[derive(Debug)]
pub(super) struct Around {
    /// Elements from the node to each.
    pub rings: Vec<u8>,
    /// Which of them is the node itself.
    pub own: usize,
    /// The coefficients of the projection of each of [`MONOMIALS`] (coordinates from the node).
    pub projected: Vec<[f64; N_MONOMIALS]>,
    /// Their covariance, row by row, but for a factor.
    pub covariance: Vec<f64>,
}

/// Weights of coefficients, with how their noise goes together.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Fit {
    /// Of the value at the node.
    pub value: Vec<f64>,
    /// Of the second derivatives by both coordinates, `tt`, `ts`, `ss`.
    pub second: [Vec<f64>; 3],
    /// Correlations: the lower triangle by rows, without the diagonal.
    correlations: Vec<f32>,
}

/// Conditions made orthogonal one after the other.
struct Conditions {
    /// Orthonormal rows; none where the ones before leave nothing.
    rows: Vec<Option<Vec<f64>>>,
    /// What each condition is made of: components along the rows up to its own.
    parts: Vec<Vec<f64>>,
}

impl Conditions {
    /// `scaled[k]`: condition k on the weights times the square roots of what they cost.
    fn new(scaled: &[Vec<f64>]) -> Self {
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let mut found = Self { rows: Vec::new(), parts: Vec::new() };
        for condition in scaled {
            let mut left = condition.clone();
            let mut parts = vec![0.0; found.rows.len()];
            // Twice: the first leaves its rounding.
            for _ in 0..2 {
                for (part, row) in parts.iter_mut().zip(&found.rows) {
                    let Some(row) = row else { continue };
                    let along = dot(&left, row);
                    *part += along;
                    left.iter_mut().zip(row).for_each(|(left, row)| *left -= along * row);
                }
            }
            let (size, whole) = (dot(&left, &left).sqrt(), dot(condition, condition).sqrt());
            let is_new = size > DEPENDENT * whole;
            parts.push(size);
            found.parts.push(parts);
            found.rows.push(is_new.then(|| left.iter().map(|v| v / size).collect()));
        }
        found
    }

    /// The least scaled weights for which the first `n` conditions are `wanted`, and whether those up to degree 2 hold.
    fn least(&self, wanted: &[f64], n: usize) -> (Vec<f64>, bool) {
        let length = self.rows.iter().flatten().next().map_or(0, Vec::len);
        let mut weights = vec![0.0; length];
        let mut along = vec![0.0; n];
        let mut is_met = true;
        for k in 0..n {
            let known: f64 = self.parts[k][..k].iter().zip(&along).map(|(part, along)| part * along).sum();
            match &self.rows[k] {
                Some(row) => {
                    along[k] = (wanted[k] - known) / self.parts[k][k];
                    weights.iter_mut().zip(row).for_each(|(w, row)| *w += along[k] * row);
                }
                None => is_met &= k >= QUADRATIC || (wanted[k] - known).abs() < MISSED,
            }
        }
        (weights, is_met)
    }
}

impl Around {
    /// Value and second derivatives at the node; `None` with too few coefficients near, or much more noise than theirs.
    pub fn fit(&self) -> Option<Fit> {
        let n = self.rings.len();
        let cost: Vec<f64> = self.rings.iter().map(|&ring| WEIGHT_OF_A_RING.powf(-0.5 * f64::from(ring))).collect();
        let condition = |k: usize| self.projected.iter().zip(&cost).map(|(of, cost)| of[k] * cost).collect();
        let conditions = Conditions::new(&(0..N_MONOMIALS).map(condition).collect::<Vec<Vec<f64>>>());
        let own = self.own;
        let wanted_of = |target: fn([i32; 2]) -> f64, kept: f64| -> Vec<f64> {
            (0..N_MONOMIALS).map(|k| target(MONOMIALS[k]) - kept * self.projected[own][k]).collect()
        };
        let weights = |target: fn([i32; 2]) -> f64, kept: f64, n_conditions: usize| {
            let (mut weights, is_met) = conditions.least(&wanted_of(target, kept), n_conditions);
            weights.iter_mut().zip(&cost).for_each(|(w, cost)| *w *= cost);
            weights[own] += kept;
            (weights, is_met)
        };
        let variance = |w: &[f64]| -> f64 {
            let row = |i: usize| (0..n).map(|j| self.covariance[i * n + j] * w[j]).sum::<f64>();
            (0..n).map(|i| w[i] * row(i)).sum::<f64>() / self.covariance[own * n + own]
        };
        let value = |n_conditions: usize| {
            let (w, is_met) = weights(|power| f64::from(power == [0, 0]), 1.0, n_conditions);
            let variance = variance(&w);
            (is_met && variance <= MOST_VARIANCE).then_some((w, variance, n_conditions))
        };
        let cubic = [N_MONOMIALS, CUBIC].into_iter().filter_map(value).min_by(|a, b| a.1.total_cmp(&b.1));
        let (value, _, n_conditions) = cubic.or_else(|| value(QUADRATIC))?;
        let second = [
            |power: [i32; 2]| if power == [2, 0] { 2.0 } else { 0.0 },
            |power: [i32; 2]| if power == [1, 1] { 1.0 } else { 0.0 },
            |power: [i32; 2]| if power == [0, 2] { 2.0 } else { 0.0 },
        ]
        .map(|target| weights(target, 0.0, n_conditions).0);
        let deviation: Vec<f64> = (0..n).map(|i| self.covariance[i * n + i].sqrt()).collect();
        let correlations = (0..n)
            .flat_map(|i| (0..i).map(move |j| (i, j)))
            .map(|(i, j)| (self.covariance[i * n + j] / (deviation[i] * deviation[j])) as f32)
            .collect();
        Some(Fit { value, second, correlations })
    }
}

/// The sum of products, in eight sums side by side: one alone would wait for each addition.
fn product(parts: &[f64], correlations: &[f32]) -> f64 {
    const LANES: usize = 8;
    let mut sums = [0.0; LANES];
    let (of_parts, of_correlations) = (parts.chunks_exact(LANES), correlations.chunks_exact(LANES));
    let rest = of_parts.remainder().iter().zip(of_correlations.remainder());
    let rest: f64 = rest.map(|(p, r)| p * f64::from(*r)).sum();
    for (p, r) in of_parts.zip(of_correlations) {
        (0..LANES).for_each(|k| sums[k] += p[k] * f64::from(r[k]));
    }
    sums.iter().sum::<f64>() + rest
}

impl Fit {
    /// Standard deviation of the value where the coefficients have those that `sigma` gives by their number.
    pub fn sigma(&self, sigma: impl Fn(usize) -> f64) -> f64 {
        let parts: Vec<f64> = self.value.iter().enumerate().map(|(i, w)| w * sigma(i)).collect();
        let (mut variance, mut at) = (0.0, 0);
        for (i, part) in parts.iter().enumerate() {
            let beside = product(&parts[..i], &self.correlations[at..at + i]);
            variance += part * (part + 2.0 * beside);
            at += i;
        }
        variance.max(0.0).sqrt()
    }
}
