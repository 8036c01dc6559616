//! Whether the data contradict the model: the objective against its expectation, as a whole and by instant and region
//! (THEORY 11).

use crate::identify::{
    ConstantEffect, Evaluation, FALSE_REJECTIONS, FitError, NOISE_LEVEL_STD, Problem, Statistics, Weights, as_normal,
    full_weights, normal_tail,
};
use crate::linalg::Dense;
use crate::mechanics::JointMesh;
use rayon::prelude::*;
use std::ops::Deref;

/// A group whose residual is above its expectation by less than this is not worth a rejection, however well it is
/// known.
const LEAST_RATIO: f64 = 1.1;
/// Most groups that are named in words.
const NAMED: usize = 3;
/// Parts that the instants are divided into for the groups of instants and region together.
const PERIODS: usize = 4;

/// The misfit test: what of the objective the noise does not explain.
#[derive(Debug, Clone, PartialEq)]
pub struct Misfit {
    /// The sum of the squares of the whitened residual at the best parameters: the objective under the inverse
    /// covariance.
    pub omega: f64,
    /// What noise alone leaves of it on average: numbers compared less parameters.
    pub freedom: f64,
    /// What the size of the elements, of model and correlation, adds (`lambda_h`); `None` where it could not be
    /// computed.
    pub floor: Option<f64>,
    /// What the constants of the error budget add on average, each off by its standard uncertainty.
    pub constants: f64,
    /// Standard deviation of `omega`, with the noise's own uncertainty of [`NOISE_LEVEL_STD`].
    pub std: f64,
    /// `(omega - freedom - floor - constants) / std`.
    pub z: f64,
    /// `omega / (freedom + floor + constants) - 1`.
    pub excess: f64,
    /// Whether the noise is known beside the residual: without that the objective as a whole tests nothing.
    pub tested: bool,
    /// `z` above which the model is rejected.
    pub limit: f64,
    /// The residual of each instant.
    pub by_instant: Vec<MisfitGroup>,
    /// The residual of each region over all instants: strip, distance from the adhesive, third along the joint.
    pub by_region: Vec<MisfitGroup>,
    /// The residual of each region in each quarter of the test.
    pub by_both: Vec<MisfitGroup>,
    /// `z` above which a group is significant, the number of groups counted in.
    pub group_limit: f64,
}

/// The plain residual of some nodes at some instants against its expectation.
#[derive(Debug, Clone, PartialEq)]
pub struct MisfitGroup {
    /// Where and when, in words.
    pub name: String,
    /// First and last instant, from 1.
    pub instants: [usize; 2],
    /// Numbers compared.
    pub n: usize,
    /// Root mean square of measured less computed displacement over its expectation.
    pub ratio: f64,
    /// The normal deviate of the sum of squares, taken for a chi-square with the mean and variance that it has.
    pub z: f64,
}

impl Misfit {
    /// That of an objective with this expectation and standard deviation; groups by instant, region and both.
    pub(crate) fn new(
        [omega, freedom, constants]: [f64; 3],
        floor: Option<f64>,
        (expected, std): (f64, f64),
        tested: bool,
        [by_instant, by_region, by_both]: [Vec<MisfitGroup>; 3],
    ) -> Self {
        let n_groups = by_instant.len() + by_region.len() + by_both.len();
        Self {
            omega,
            freedom,
            floor,
            constants,
            std,
            z: (omega - expected) / std,
            excess: omega / expected - 1.0,
            tested,
            limit: normal_tail(FALSE_REJECTIONS),
            by_instant,
            by_region,
            by_both,
            group_limit: normal_tail(FALSE_REJECTIONS / n_groups.max(1) as f64),
        }
    }

    /// Whether the data reject the model.
    pub fn rejected(&self) -> bool {
        (self.tested && self.z > self.limit) || !self.significant().is_empty()
    }

    /// The groups that contradict the model, the worst first: those of region and time together where there are any,
    /// else those of one kind.
    pub fn significant(&self) -> Vec<&MisfitGroup> {
        let worst_first = |groups: &[MisfitGroup]| -> Vec<usize> {
            let mut places: Vec<usize> = (0..groups.len())
                .filter(|&k| groups[k].z > self.group_limit && groups[k].ratio > LEAST_RATIO)
                .collect();
            places.sort_by(|&a, &b| groups[b].ratio.total_cmp(&groups[a].ratio));
            places
        };
        for groups in [&self.by_both, &self.by_region, &self.by_instant] {
            let places = worst_first(groups);
            if !places.is_empty() {
                return places.into_iter().map(|k| &groups[k]).collect();
            }
        }
        Vec::new()
    }

    /// The worst groups in words, as `instants 15 to 19, upper strip, first 200 um beside the adhesive: 3.2 times
    /// expected`.
    pub fn worst(&self) -> Vec<String> {
        let in_words = |group: &&MisfitGroup| format!("{}: {:.1} times expected", group.name, group.ratio);
        self.significant().iter().take(NAMED).map(in_words).collect()
    }
}

/// What a fit leaves unexplained, in units of the noise's variance.
pub(crate) struct Unexplained {
    /// The objective under the inverse covariance.
    pub omega: f64,
    /// What noise alone leaves of it on average.
    pub freedom: f64,
    /// What the size of the elements adds, and the change of the rows that is left of it.
    pub floor: Option<(f64, Vec<Dense>)>,
    /// The same of each constant, off by its standard uncertainty.
    pub constants: Vec<(f64, Vec<Dense>)>,
}

impl Problem<'_> {
    /// The misfit of a fit that ended at `evaluation` under `weights`; `refined` is the change of the measured rows
    /// that a mesh cut in four would make ([`Problem::refine`]). Errors: a tangent or a covariance without inverse.
    pub(crate) fn misfit(
        &self,
        evaluation: &Evaluation,
        weights: &Weights,
        statistics: &Statistics,
        refined: Option<&[Dense]>,
        effects: &[ConstantEffect],
    ) -> Result<Misfit, FitError> {
        let noise = &self.noise;
        let own;
        let whitening = match weights {
            Weights::Inverse(_) => weights,
            Weights::Diagonal(_) => {
                own = full_weights(self, evaluation)?;
                &own
            }
        };
        // With an unknown noise the inverse covariance holds that of noise 1.
        let unit = if noise.sigma.is_some() { 1.0 } else { 1.0 / (statistics.sigma * statistics.sigma) };
        let local = evaluation.local(whitening, noise);
        let factor = local.h.cholesky().map_err(|_| FitError::NotFinite)?;
        // What other weights leave above the minimum under these, to first order.
        let b = Dense::from_fn(local.b.len(), 1, |k, _| local.b[k]);
        let gain = b.transposed_times(&factor.solve(&b))[(0, 0)];
        let omega = unit * (local.omega - gain).max(0.0);
        let freedom = (self.n_data() as f64 - self.unknowns.n() as f64).max(1.0);
        let jacobian = evaluation.jacobian();
        let inverse = factor.inverse();
        let left = refined.map(|change| self.not_absorbed(whitening, &jacobian, &inverse, change));
        let floor = left.map(|(floor, left)| (unit * floor, left));
        let of_constants = effects.par_iter().map(|effect| {
            let (square, left) = self.not_absorbed(whitening, &jacobian, &inverse, &effect.rows);
            (unit * square, left)
        });
        let constants = of_constants.collect();
        Ok(self.judge(evaluation, statistics, Unexplained { omega, freedom, floor, constants }))
    }

    /// The misfit of what was left unexplained at `evaluation`.
    pub(crate) fn judge(
        &self,
        evaluation: &Evaluation,
        statistics: &Statistics,
        Unexplained { omega, freedom, floor: left, constants: of_constants }: Unexplained,
    ) -> Misfit {
        let floor = left.as_ref().map(|(floor, _)| *floor);
        let squares: Vec<f64> = of_constants.iter().map(|(square, _)| *square).collect();
        // Without any constant the sum is -0, which nobody wants to read.
        let constants = squares.iter().sum::<f64>() + 0.0;
        let moved = floor.unwrap_or(0.0) + constants;
        let expected = freedom + moved;
        // A constant that is off by a normal variable adds its square.
        let of_squares: f64 = squares.iter().map(|square| 2.0 * square * square).sum();
        let std = (2.0 * freedom + 4.0 * moved + of_squares + (2.0 * NOISE_LEVEL_STD * expected).powi(2)).sqrt();
        let left = left.as_ref().map(|(_, left)| left.as_slice());
        let of_constants: Vec<&[Dense]> = of_constants.iter().map(|(_, left)| left.as_slice()).collect();
        let groups = Groups::new(self, evaluation, statistics, left, &of_constants).all(self);
        Misfit::new([omega, freedom, constants], floor, (expected, std), self.noise.sigma.is_some(), groups)
    }

    /// `d^T Q d` of a change `d` of the rows, `Q = W - W J (J^T W J)^-1 J^T W`, and the part of `d` that other
    /// parameters do not take up.
    pub(crate) fn not_absorbed(
        &self,
        weights: &Weights,
        jacobian: &[Dense],
        a: &Dense,
        change: &[Dense],
    ) -> (f64, Vec<Dense>) {
        let weighted = weights.times(&self.noise, change);
        let n = a.n_rows();
        let mut by_unknown = Dense::zeros(n, 1);
        let mut square = 0.0;
        for ((d, wd), j) in change.iter().zip(&weighted).zip(jacobian) {
            square += d.transposed_times(wd)[(0, 0)];
            by_unknown.add(1.0, &j.transposed_times(wd));
        }
        let taken = a.times(&by_unknown);
        let floor = (square - by_unknown.transposed_times(&taken)[(0, 0)]).max(0.0);
        let left = (change.iter().zip(jacobian))
            .map(|(d, j)| {
                let mut left = d.clone();
                left.add(-1.0, &j.times(&taken));
                left
            })
            .collect();
        (floor, left)
    }
}

/// The plain squares of the residual, row by row, and what noise and element size leave of them on average.
struct Groups {
    /// Of each instant: squares of the residual, and their expectation, row by row.
    squares: Vec<Vec<f64>>,
    expected: Vec<Vec<f64>>,
    /// Squares of what each constant may leave, by constant, instant and row.
    constants: Vec<Vec<Vec<f64>>>,
    /// Covariance of the residual of one instant, and the part that it shares with another.
    own: Dense,
    shared: Dense,
    /// The row of the force, which has nothing in common with other instants, and the instants that have one.
    force: Option<(usize, Vec<bool>)>,
}

impl Groups {
    fn new(
        problem: &Problem<'_>,
        evaluation: &Evaluation,
        statistics: &Statistics,
        left: Option<&[Dense]>,
        constants: &[&[Dense]],
    ) -> Self {
        let (noise, observation) = (&problem.noise, &problem.observation);
        let n = observation.n_rows();
        let sigma2 = statistics.sigma * statistics.sigma;
        let covariance = noise.precision.inverse_times(&Dense::from_fn(n, n, |r, c| f64::from(r == c)));
        let border: Vec<usize> = observation.prescribed.iter().flat_map(|&node| [2 * node, 2 * node + 1]).collect();
        // Columns of C at the border, and its block there.
        let to_border = Dense::from_fn(n, border.len(), |r, c| covariance[(r, border[c])]);
        let of_border = Dense::from_fn(border.len(), border.len(), |r, c| covariance[(border[r], border[c])]);
        // C_ff - C_fD S^T - S C_Df + S C_DD S^T (THEORY 7); T holds S, and on the border what smoothing makes of it.
        let variance = |t: &Dense| -> Vec<f64> {
            let through = t.times(&of_border);
            let expected = |r: usize| {
                let sum = (0..border.len()).map(|k| t[(r, k)] * (through[(r, k)] - 2.0 * to_border[(r, k)]));
                covariance[(r, r)] + sum.sum::<f64>()
            };
            (0..n).map(|r| expected(r).max(0.0)).collect()
        };
        let full = |t: Option<&Dense>| match t {
            None => covariance.clone(),
            Some(t) => {
                let mut through = t.times(&of_border);
                through.add(-2.0, &to_border);
                // (S C_DD - 2 C_fD) S^T, made symmetric.
                let transposed = Dense::from_fn(t.n_columns(), n, |r, c| t[(c, r)]);
                let part = through.times(&transposed);
                Dense::from_fn(n, n, |r, c| covariance[(r, c)] + 0.5 * (part[(r, c)] + part[(c, r)]))
            }
        };
        let by_measured: Vec<_> = statistics.by_boundary.par_iter().map(|t| problem.border.by_measured(t)).collect();
        let shared = full(by_measured.get(by_measured.len() / 2).map(Deref::deref));
        let force = observation.force.as_ref().zip(observation.force_row());
        let force = force.map(|(cell, row)| {
            (row, observation.instants.iter().map(|instant| cell.at(instant.index).is_some()).collect::<Vec<bool>>())
        });
        let is_force = |r: usize| force.as_ref().is_some_and(|(row, _)| *row == r);
        let there = |i: usize, r: usize| force.as_ref().is_none_or(|(row, at)| *row != r || at[i]);
        let floor = |i: usize, r: usize| left.map_or(0.0, |left| left[i][(r, 0)] * left[i][(r, 0)]);
        let compared = |r: usize, square: f64| if observation.compares(r) { square } else { 0.0 };
        let squared = |left: &Dense| (0..n).map(|r| compared(r, left[(r, 0)] * left[(r, 0)])).collect::<Vec<f64>>();
        let constants: Vec<Vec<Vec<f64>>> = constants.iter().map(|left| left.iter().map(squared).collect()).collect();
        let of_instant = |i: usize| -> (Vec<f64>, Vec<f64>) {
            let plain = || (0..n).map(|r| covariance[(r, r)]).collect();
            let variance = by_measured.get(i).map_or_else(plain, |t| variance(t));
            let expected = (variance.iter().enumerate())
                .map(|(r, v)| match observation.compares(r) && there(i, r) {
                    true => {
                        let moved: f64 = constants.iter().map(|constant| constant[i][r]).sum();
                        // Of a force only what the border makes of it is common.
                        let alone = if is_force(r) { noise.common * covariance[(r, r)] } else { 0.0 };
                        sigma2 * ((1.0 + noise.common) * v - alone) + floor(i, r) + moved
                    }
                    false => 0.0,
                })
                .collect();
            let residual = evaluation.blocks[i].column(0);
            ((0..n).map(|r| compared(r, residual[r] * residual[r])).collect(), expected)
        };
        let (squares, expected) = (0..observation.instants.len()).map(of_instant).unzip();
        let alone = |r: usize, c: usize| if r == c && is_force(r) { noise.common * covariance[(r, r)] } else { 0.0 };
        let scaled = |factor: f64| Dense::from_fn(n, n, |r, c| sigma2 * (factor * shared[(r, c)] - alone(r, c)));
        let (own, shared) = (scaled(1.0 + noise.common), scaled(noise.common));
        Self { squares, expected, constants, own, shared, force }
    }

    /// Rows with the sums of the squares of the covariances between them, of one instant and of two.
    fn covary<'r>(&self, rows: &'r [usize]) -> (&'r [usize], [f64; 2]) {
        let norm = |of: &Dense| -> f64 {
            rows.iter().map(|&r| rows.iter().map(|&c| of[(r, c)] * of[(r, c)]).sum::<f64>()).sum()
        };
        (rows, [&self.own, &self.shared].map(norm))
    }

    /// The group of rows, which [`covary`](Self::covary) makes, at `instants` (places among those compared).
    fn group(
        &self,
        problem: &Problem<'_>,
        name: String,
        (rows, [own, shared]): (&[usize], [f64; 2]),
        instants: std::ops::Range<usize>,
    ) -> MisfitGroup {
        let sum =
            |of: &[Vec<f64>]| -> f64 { instants.clone().map(|i| rows.iter().map(|&r| of[i][r]).sum::<f64>()).sum() };
        let (squares, expected) = (sum(&self.squares), sum(&self.expected));
        let m = match &self.force {
            Some((row, at)) if rows == [*row] => instants.clone().filter(|&i| at[i]).count(),
            _ => instants.len(),
        };
        let (n, m) = (rows.len() * m, m as f64);
        // Twice the sum of the squares of the covariance of all its numbers.
        let of_noise = 2.0 * (m * own + m * (m - 1.0) * shared);
        let of_constants: f64 = self.constants.iter().map(|constant| 2.0 * sum(constant).powi(2)).sum();
        let variance = of_noise + of_constants;
        let std = (variance + (2.0 * NOISE_LEVEL_STD * expected).powi(2)).sqrt();
        let number = |i: usize| problem.observation.instants[i].index + 1;
        MisfitGroup {
            name,
            instants: [number(instants.start), number(instants.end - 1)],
            n,
            ratio: if expected > 0.0 { (squares / expected).sqrt() } else { 0.0 },
            z: if std > 0.0 { as_normal(squares / expected, 2.0 * (expected / std).powi(2)) } else { 0.0 },
        }
    }

    fn all(&self, problem: &Problem<'_>) -> [Vec<MisfitGroup>; 3] {
        let observation = &problem.observation;
        let n = observation.instants.len();
        let number = |i: usize| observation.instants[i].index + 1;
        let rows: Vec<usize> = (0..2 * observation.nodes.len()).filter(|&r| observation.compares(r)).collect();
        let mut regions = regions(problem, &rows);
        // Millimetres and newtons do not add: the force is a region by itself, and fills the instants where it is
        // alone.
        let force: Vec<usize> = self.force.iter().map(|(row, _)| *row).collect();
        let of_instants = if rows.is_empty() { &force } else { &rows };
        let of_instants = self.covary(of_instants);
        let by_instant = (0..n)
            .map(|i| self.group(problem, format!("instant {}", number(i)), of_instants, i..i + 1))
            .filter(|group| group.n > 0)
            .collect();
        if !force.is_empty() {
            regions.push(("the force of the load cell".to_owned(), force));
        }
        let regions: Vec<_> = regions.iter().map(|(name, rows)| (name, self.covary(rows))).collect();
        let by_region: Vec<_> =
            regions.iter().map(|&(name, rows)| self.group(problem, name.clone(), rows, 0..n)).collect();
        let mut by_both = Vec::new();
        let periods = PERIODS.min(n);
        for (name, rows) in regions {
            for k in 0..periods {
                let part = k * n / periods..(k + 1) * n / periods;
                let when = match [number(part.start), number(part.end - 1)] {
                    [first, last] if first == last => format!("instant {first}"),
                    [first, last] => format!("instants {first} to {last}"),
                };
                let group = self.group(problem, format!("{when}, {name}"), rows, part);
                by_both.extend(Some(group).filter(|group| group.n > 0));
            }
        }
        [by_instant, by_region, by_both]
    }
}

/// The regions that the compared `rows` fall into: strip, distance from the adhesive (up to a sixth of the strip's
/// depth, up to the half, beyond), third along the joint; those without rows left out.
fn regions(problem: &Problem<'_>, rows: &[usize]) -> Vec<(String, Vec<usize>)> {
    let model = &problem.joint.model;
    let mesh = model.mesh();
    if mesh.interfaces().is_empty() {
        return ninths(problem, rows);
    }
    let line = model.pair_positions();
    let length = line.last().map_or(0.0, |(_, along)| *along);
    // Of each node: strip, distance from the mid-line, place along it.
    let place = |row: usize| -> (u32, f64, f64) {
        let node = problem.observation.nodes[row / 2] as usize;
        let [x, y] = mesh.nodes()[node];
        let distance = |at: &([f64; 2], f64)| (at.0[0] - x).hypot(at.0[1] - y);
        let nearest = line.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
        let (distance, along) = nearest.map_or((0.0, 0.0), |at| (distance(at), at.1));
        (mesh.strip()[node], (distance - 0.5 * mesh.gap()).max(0.0), along)
    };
    let places: Vec<(u32, f64, f64)> = rows.iter().map(|&row| place(row)).collect();
    let depth = places.iter().map(|p| p.1).fold(0.0, f64::max);
    let bands = [depth / 6.0, depth / 2.0, f64::INFINITY];
    let micrometres = |mm: f64| format!("{:.0} um", 1e3 * mm);
    let of_band = |band: usize| match band {
        0 => format!("first {} beside the adhesive", micrometres(bands[0])),
        1 => format!("{} to {} from the adhesive", micrometres(bands[0]), micrometres(bands[1])),
        _ => format!("beyond {} from the adhesive", micrometres(bands[1])),
    };
    let thirds = ["first third along the joint", "middle third", "last third"];
    let mut regions = Vec::new();
    for strip in 0..mesh.n_strips() as u32 {
        for band in 0..bands.len() {
            for (third, third_name) in thirds.iter().enumerate() {
                let here = |(s, distance, along): &(u32, f64, f64)| {
                    let of_band = bands.iter().position(|&edge| *distance <= edge * (1.0 + 1e-9)).unwrap_or(2);
                    let of_third = if length > 0.0 { ((3.0 * along / length) as usize).min(2) } else { 0 };
                    *s == strip && of_band == band && of_third == third
                };
                let list: Vec<usize> =
                    rows.iter().zip(&places).filter(|(_, place)| here(place)).map(|(&row, _)| row).collect();
                if !list.is_empty() {
                    let name = format!("{} strip, {}, {third_name}", strip_name(mesh, strip), of_band(band));
                    regions.push((name, list));
                }
            }
        }
    }
    regions
}

/// The regions of a body without an adhesive: thirds of its length and of its height.
fn ninths(problem: &Problem<'_>, rows: &[usize]) -> Vec<(String, Vec<usize>)> {
    let nodes = problem.joint.model.mesh().nodes();
    let bound = |c: usize, pick: fn(f64, f64) -> f64, start: f64| nodes.iter().map(|x| x[c]).fold(start, pick);
    let [low, high] = [(f64::min as fn(f64, f64) -> f64, f64::INFINITY), (f64::max, f64::NEG_INFINITY)]
        .map(|(pick, start)| [0, 1].map(|c| bound(c, pick, start)));
    let third = |row: usize, c: usize| {
        let at = nodes[problem.observation.nodes[row / 2] as usize][c];
        ((3.0 * (at - low[c]) / (high[c] - low[c])) as usize).min(2)
    };
    let mut regions = Vec::new();
    for (j, height) in ["bottom", "middle", "top"].into_iter().enumerate() {
        for (i, along) in ["left", "centre", "right"].into_iter().enumerate() {
            let here: Vec<usize> =
                rows.iter().copied().filter(|&row| third(row, 0) == i && third(row, 1) == j).collect();
            if !here.is_empty() {
                regions.push((format!("{height} third, {along}"), here));
            }
        }
    }
    regions
}

/// The name of a strip: that of its group of elements where it has one to itself, else its number.
fn strip_name(mesh: &JointMesh, strip: u32) -> String {
    let strip_of = |element: &[u32; 4]| mesh.strip()[element[0] as usize];
    let mut own =
        (mesh.elements().iter().zip(mesh.element_group())).filter(|(e, _)| strip_of(e) == strip).map(|(_, g)| *g);
    let Some(first) = own.next() else { return format!("{}.", strip + 1) };
    let shared = (mesh.elements().iter().zip(mesh.element_group())).any(|(e, g)| strip_of(e) != strip && *g == first);
    if shared || own.any(|g| g != first) { format!("{}.", strip + 1) } else { mesh.groups()[first as usize].clone() }
}
