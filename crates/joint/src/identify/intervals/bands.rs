//! Confidence bands: tractions along the joint, the force, and the law itself. Tables, figures and pages all draw these.

use crate::identify::{
    Axes, ConstantEffect, Fit, FitError, NORMAL_95, ObservedInstant, Problem, Refinement, Statistics,
};
use crate::linalg::Dense;
use crate::mechanics::ReactionAt;
use crate::mechanics::cohesive::{CohesiveLaw, CohesiveResponse, Jump, Traction};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

/// Tractions of one instant, with their standard uncertainties and 95 % bands.
#[derive(Debug, Clone, PartialEq)]
pub struct Band {
    /// The instant, from 1.
    pub instant: usize,
    /// Traction at each node pair, MPa.
    pub traction: Vec<Traction>,
    /// Standard uncertainty of its components, MPa: noise and uncertain constants, to first order.
    pub std: Vec<Traction>,
    /// Lower ends of the 95 % bands, MPa.
    pub low: Vec<Traction>,
    /// Upper ends of the 95 % bands, MPa.
    pub high: Vec<Traction>,
    /// The computed force where the load cell has a value, to first order.
    pub force: Option<ForceBand>,
}

/// The computed force of one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ForceBand {
    /// Its standard uncertainty, N: noise and uncertain constants, that of the width where the force takes part.
    pub std_n: f64,
    /// How far its 95 % band reaches below and above it, N.
    pub sides_n: [f64; 2],
}

/// Traction against separation in pure opening and pure sliding.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CurveBand {
    /// The jumps, mm: in opening `normal`, in sliding `tangential`.
    pub jumps: Vec<Jump>,
    /// Traction along the jump, MPa.
    pub traction: Vec<f64>,
    /// Its standard uncertainty, MPa; infinite where the data give none.
    pub std: Vec<f64>,
    /// Lower end of its 95 % band, MPa; minus infinity where the data give none.
    pub low: Vec<f64>,
    /// Upper end of its 95 % band, MPa; infinity where the data give none.
    pub high: Vec<f64>,
}

/// Draws that are led through the law where it is not linear.
const DRAWS: usize = 240;
/// Their seed: a fit has the same bands every time.
const SEED: u64 = 0x5175_6164;

/// Errors of parameters and constants, and the laws that go with them.
struct Draws {
    /// Errors of the scaled unknowns by the noise.
    noise: Vec<Vec<f64>>,
    /// By how many standard uncertainties each constant is off.
    constants: Vec<Vec<f64>>,
    /// Errors of the scaled unknowns by both.
    scaled: Vec<Vec<f64>>,
    laws: Vec<Box<dyn CohesiveLaw>>,
    /// Two independent numbers of variance 1 for each draw.
    more: Vec<[f64; 2]>,
}

impl Draws {
    /// Those of noise with this covariance of the scaled unknowns and of the constants of `fit`; none where it has no
    /// factor or a law refuses.
    fn new(problem: &Problem<'_>, fit: &Fit, covariance: &Dense) -> Option<Self> {
        let unknowns = &problem.unknowns;
        let factor = covariance.cholesky().ok()?;
        let mut random = ChaCha8Rng::seed_from_u64(SEED);
        let mut white = Dense::zeros(unknowns.n(), DRAWS);
        for k in 0..DRAWS {
            white.column_mut(k).iter_mut().for_each(|v| *v = StandardNormal.sample(&mut random));
        }
        let more = (0..DRAWS).map(|_| [(); 2].map(|()| StandardNormal.sample(&mut random))).collect();
        let constants: Vec<Vec<f64>> =
            (0..DRAWS).map(|_| fit.constants.iter().map(|_| StandardNormal.sample(&mut random)).collect()).collect();
        let errors = factor.half_times(&white);
        let noise: Vec<Vec<f64>> = (0..DRAWS).map(|k| errors.column(k).to_vec()).collect();
        let both = |(noise, off): (&Vec<f64>, &Vec<f64>)| -> Vec<f64> {
            let by = |k: usize| off.iter().zip(&fit.constants).map(|(off, effect)| off * effect.scaled[k]).sum::<f64>();
            noise.iter().enumerate().map(|(k, e)| e + by(k)).collect()
        };
        let scaled: Vec<Vec<f64>> = noise.iter().zip(&constants).map(both).collect();
        let law = |(error, off): (&Vec<f64>, &Vec<f64>)| law_off(problem, fit, error, off, 1.0);
        let laws = scaled.iter().zip(&constants).map(law).collect::<Option<_>>()?;
        Some(Self { noise, constants, scaled, laws, more })
    }
}

/// The law of `fit` off by a `share` of `error` of the scaled unknowns and of `off` standard uncertainties of each
/// constant; `None` where there is none.
fn law_off(problem: &Problem<'_>, fit: &Fit, error: &[f64], off: &[f64], share: f64) -> Option<Box<dyn CohesiveLaw>> {
    let unknowns = &problem.unknowns;
    let there: Vec<f64> = unknowns.scaled(&fit.evaluation.x).iter().zip(error).map(|(z, e)| z + share * e).collect();
    let law = unknowns.law_at(&unknowns.unscaled(&there)).ok()?;
    let mut values = law.values();
    for (index, value) in values.iter_mut().enumerate().filter(|(index, _)| !is_fitted(problem, *index)) {
        *value += share * off.iter().zip(&fit.constants).map(|(off, effect)| off * effect.law[index]).sum::<f64>();
    }
    law.with_values(&values).ok()
}

/// Draws along the axes of the likelihood: more than where first order takes part, since their quantiles stand for
/// themselves.
const ALONG_AXES: usize = 480;
/// Times that a draw is made which is no law.
const TRIALS: usize = 20;
/// Scaled distance (of logarithms: a factor of 20) that no draw goes beyond.
const FAR: f64 = 3.0;

/// Laws that noise and constants make of that of `fit`: what noise does follows `axes`, constants go to first order. A
/// draw that is no law is drawn again, and after some trials drawn back to where it is one.
fn laws_along(problem: &Problem<'_>, fit: &Fit, axes: &Axes) -> Vec<Box<dyn CohesiveLaw>> {
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    let mut draw = || -> f64 { StandardNormal.sample(&mut random) };
    let level = noise_factor(fit).sqrt();
    let mut trial = |last: bool| {
        let t: Vec<f64> = (0..problem.unknowns.n()).map(|_| level * draw()).collect();
        let off: Vec<f64> = fit.constants.iter().map(|_| draw()).collect();
        let mut error = axes.at(&t);
        for (off, effect) in off.iter().zip(&fit.constants) {
            error.iter_mut().zip(&effect.scaled).for_each(|(e, by)| *e += off * by);
        }
        let longest = error.iter().fold(FAR, |most, e| most.max(e.abs()));
        error.iter_mut().for_each(|e| *e *= FAR / longest);
        (0..if last { 8 } else { 1 }).find_map(|k| law_off(problem, fit, &error, &off, 0.8_f64.powi(k)))
    };
    let one = |_| (1..=TRIALS).find_map(|k| trial(k == TRIALS));
    (0..ALONG_AXES).filter_map(one).collect()
}

/// How far the middle 95 % of sorted `errors` reach below and above: the means of three neighbours about the 2.5th and
/// the 97.5th percentile, of which there are `at` beyond.
fn reach_of_middle(errors: &[f64], at: usize) -> [f64; 2] {
    let n = errors.len();
    let low = -errors[at - 1..=at + 1].iter().sum::<f64>() / 3.0;
    [low, errors[n - at - 2..=n - at].iter().sum::<f64>() / 3.0]
}

/// How far the middle 95 % of `errors` reach below and above, and their standard deviation about zero.
fn spread(errors: &mut [f64]) -> ([f64; 2], f64) {
    errors.sort_by(f64::total_cmp);
    let sides = reach_of_middle(errors, (errors.len() / 40).max(1)).map(|side| side.max(0.0));
    (sides, (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt())
}

/// Whether parameter `index` of the law is an unknown.
fn is_fitted(problem: &Problem<'_>, index: usize) -> bool {
    problem.unknowns.list().iter().any(|unknown| unknown.index == index)
}

/// How far a 95 % band reaches below and above the value whose standard uncertainty to first order is `std`: the
/// quantiles of the `errors` of draws, by those that the same draws have to first order, so that a linear law gives
/// `1.96 std` exactly.
fn reach(std: f64, errors: &mut [f64], linear: &mut [f64]) -> [f64; 2] {
    let half = NORMAL_95 * std;
    errors.sort_by(f64::total_cmp);
    linear.sort_by(f64::total_cmp);
    let n = errors.len();
    let at = n / 40;
    if at == 0 || !(errors[0].is_finite() && errors[n - 1].is_finite()) {
        return [half; 2];
    }
    let (all, first_order) = (reach_of_middle(errors, at), reach_of_middle(linear, at));
    // Never less than the first order: the errors of the jumps beyond it are not among the draws.
    [0, 1].map(|side| if first_order[side] > 0.0 { half * (all[side] / first_order[side]).max(1.0) } else { half })
}

/// By how much the variance of the noise grows since its level is not known exactly.
fn noise_factor(fit: &Fit) -> f64 {
    1.0 + fit.budget.noise_level().powi(2)
}

/// Covariance of the scaled unknowns by the noise alone.
fn by_noise(statistics: &Statistics, fit: &Fit) -> Dense {
    let n = statistics.covariance.n_rows();
    Dense::from_fn(n, n, |r, c| noise_factor(fit) * statistics.covariance[(r, c)])
}

/// What the noise of the measurement does to the jumps and the force of one instant beside what the parameters do: `dJ
/// = by_z^T dz + w`.
struct Errors {
    /// Derivatives of the jumps by the scaled unknowns: a column for D_n and one for D_t of every pair; then, where
    /// there is a load cell, one for the force and one of zeros.
    by_z: Dense,
    /// `Cov(dz, w)`.
    cross: Dense,
    /// `Cov(w)` of each pair of columns.
    own: Vec<[[f64; 2]; 2]>,
}

/// Tractions along the joint at every instant compared, with what the noise of the measurement (through the parameters
/// and, where the boundary is noisy, through the prescribed displacements, the two correlated) and the uncertain
/// constants do to them; bands also hold the effect of the element size and the bias of the noise where the intervals
/// do. Empty without covariance.
///
/// Parameters and jumps have errors to first order: `dJ = G^T dz + H^T d_i` with `dz = A sum_j v_j^T e_j` and `d_i` the
/// error of the prescribed displacements. A constant moves the parameters, the law where it is one of its own, and the
/// jumps together; constants are independent of the noise and of one another. Bands lead all of them through the law
/// itself, with its peak and its kink at zero opening, so that they need not be symmetric.
///
/// # Errors
/// A tangent without inverse.
pub fn bands(problem: &Problem<'_>, fit: &Fit) -> Result<Vec<Band>, FitError> {
    let (Some(statistics), Some(_)) = (&fit.statistics, &fit.covariance) else { return Ok(Vec::new()) };
    let law = problem.unknowns.law_at(&fit.evaluation.x)?;
    let slopes = problem.unknowns.slopes(&fit.evaluation.x);
    let covariance = by_noise(statistics, fit);
    let inverse = covariance.cholesky().ok();
    let draws = Draws::new(problem, fit, &covariance);
    let all = Uncertain { problem, fit, law: &*law, slopes, covariance, draws };
    let band_at = |(i, observed): (usize, &ObservedInstant)| -> Result<Band, FitError> {
        let jumps = problem.joint.model.jumps(&fit.solution().instants[observed.index].displacement);
        let errors = errors(problem, fit, statistics, &all.covariance, i, all.law)?;
        let given_z = inverse.as_ref().map(|inverse| inverse.solve(&errors.cross));
        Ok(all.band(&AtInstant { i, observed, errors, given_z }, &jumps))
    };
    problem.observation.instants.par_iter().enumerate().map(band_at).collect()
}

/// A fit whose law is uncertain.
struct Uncertain<'a> {
    problem: &'a Problem<'a>,
    fit: &'a Fit,
    law: &'a dyn CohesiveLaw,
    /// Derivatives of the unknowns by the scaled unknowns.
    slopes: Vec<f64>,
    /// See [`by_noise`].
    covariance: Dense,
    draws: Option<Draws>,
}

/// An instant compared, the number `i` of them.
struct AtInstant<'a> {
    i: usize,
    observed: &'a ObservedInstant,
    errors: Errors,
    /// `Cov(dz)^-1 Cov(dz, w)`, where that inverse is.
    given_z: Option<Dense>,
}

/// A node pair at an instant, with what changes its traction to first order.
struct AtPair {
    pair: usize,
    jump: Jump,
    response: CohesiveResponse,
    /// Derivatives of both components of the traction by the scaled unknowns.
    g: Dense,
    /// What each constant does, by its own standard uncertainty.
    by_constant: Vec<[f64; 2]>,
    std: [f64; 2],
}

/// Lists of errors of draws, which every pair uses again: of the normal traction, to first order; of the tangential
/// one, likewise.
type ErrorLists = [Vec<f64>; 4];

impl Uncertain<'_> {
    /// Makes the band at an instant whose pairs have these `jumps`.
    fn band(&self, at: &AtInstant<'_>, jumps: &[Jump]) -> Band {
        let traction = jumps.iter().map(|&jump| self.law.response(jump).traction).collect();
        let (std, low, high) = (Vec::new(), Vec::new(), Vec::new());
        let force = self.force(at, jumps.len());
        let mut band = Band { instant: at.observed.index + 1, traction, std, low, high, force };
        let mut lists = [(); 4].map(|()| Vec::with_capacity(DRAWS));
        for (pair, &jump) in jumps.iter().enumerate() {
            let of_pair = self.linearise(at, pair, jump);
            let reaches = self.reaches(at, &of_pair, &mut lists);
            let t = band.traction[pair];
            let end = |side: usize| {
                let sign = [-1.0, 1.0][side];
                Traction {
                    normal: t.normal + sign * reaches[0][side],
                    tangential: t.tangential + sign * reaches[1][side],
                }
            };
            band.std.push(Traction { normal: of_pair.std[0], tangential: of_pair.std[1] });
            band.low.push(end(0));
            band.high.push(end(1));
        }
        band
    }

    /// Makes the band of the force, whose columns follow those of the pairs of nodes.
    fn force(&self, at: &AtInstant<'_>, n_pairs: usize) -> Option<ForceBand> {
        let Self { problem, fit, covariance, .. } = self;
        problem.observation.cell()?.at(at.observed.index)?;
        let Errors { by_z, cross, own } = &at.errors;
        let g = by_z.column(2 * n_pairs);
        let mut through = Dense::zeros(g.len(), 1);
        through.column_mut(0).copy_from_slice(g);
        let of_noise = dot(g, covariance.times(&through).column(0)) + 2.0 * dot(g, cross.column(2 * n_pairs));
        let by_constant = fit.constants.iter().map(|effect| dot(g, &effect.scaled) + effect.forces[at.i]);
        let variance = (of_noise + own[n_pairs][0][0]).max(0.0) + by_constant.map(|by| by * by).sum::<f64>();
        let std_n = variance.sqrt();
        let moved = self.finer().map_or(0.0, |finer| finer.forces[at.i] + dot(g, &finer.scaled));
        let shift = self.bias().map_or(0.0, |bias| dot(g, bias));
        let half = NORMAL_95 * std_n.hypot(moved);
        Some(ForceBand { std_n, sides_n: [half + shift.max(0.0), half + (-shift).max(0.0)] })
    }

    /// What elements half as large would change, where bands hold it.
    fn finer(&self) -> Option<&Refinement> {
        self.fit.refinement.as_ref().filter(|refinement| refinement.included)
    }

    /// To where the bias of the parameters says that the truth is.
    fn bias(&self) -> Option<&Vec<f64>> {
        self.fit.intervals.as_ref().and_then(|basis| basis.bias.as_ref())
    }

    /// Finds what changes the traction of a pair to first order.
    fn linearise(&self, at: &AtInstant<'_>, pair: usize, jump: Jump) -> AtPair {
        let Self { problem, fit, law, slopes, covariance, .. } = self;
        let errors = &at.errors;
        let response = law.response(jump);
        let tangent = response.tangent;
        let mut at_fixed_jump = vec![Traction::default(); law.parameters().len()];
        law.by_parameters(jump, &mut at_fixed_jump);
        let g = Dense::from_fn(problem.unknowns.n(), 2, |k, d| {
            // Of a material there is none.
            let direct = at_fixed_jump.get(problem.unknowns.list()[k].index).copied().unwrap_or_default();
            slopes[k] * [direct.normal, direct.tangential][d]
                + (0..2).map(|c| tangent[(d, c)] * errors.by_z.column(2 * pair + c)[k]).sum::<f64>()
        });
        let through = covariance.times(&g);
        let own = errors.own[pair];
        let by_constant: Vec<[f64; 2]> = (fit.constants.iter())
            .map(|effect| {
                let (moved, change) = (effect.jumps[at.i][pair], law_change(problem, effect, &at_fixed_jump));
                [0, 1].map(|d| {
                    let by_jump = tangent[(d, 0)] * moved.normal + tangent[(d, 1)] * moved.tangential;
                    dot(g.column(d), &effect.scaled) + [change.normal, change.tangential][d] + by_jump
                })
            })
            .collect();
        let std = [0, 1].map(|d| {
            let cross = |c: usize| dot(g.column(d), errors.cross.column(2 * pair + c));
            let mut variance = dot(g.column(d), through.column(d));
            for c in 0..2 {
                variance += 2.0 * tangent[(d, c)] * cross(c);
                variance += (0..2).map(|e| tangent[(d, c)] * own[c][e] * tangent[(d, e)]).sum::<f64>();
            }
            let of_constants: f64 = by_constant.iter().map(|by| by[d] * by[d]).sum();
            (variance.max(0.0) + of_constants).sqrt()
        });
        AtPair { pair, jump, response, g, by_constant, std }
    }

    /// Finds how far the band of each component reaches below and above its value.
    fn reaches(&self, at: &AtInstant<'_>, of: &AtPair, lists: &mut ErrorLists) -> [[f64; 2]; 2] {
        let AtPair { pair, jump, g, std, .. } = of;
        let tangent = of.response.tangent;
        let mut reaches = std.map(|std| [NORMAL_95 * std; 2]);
        if let (Some(draws), Some(given_z)) = (&self.draws, &at.given_z) {
            self.draw_errors(at, of, (draws, given_z), lists);
            let [a, a1, b, b1] = lists;
            reaches = [reach(std[0], a, a1), reach(std[1], b, b1)];
        }
        if let Some(finer) = self.finer() {
            let there = finer.jumps[at.observed.index][*pair];
            let moved = |d: usize| {
                let by_jump = tangent[(d, 0)] * (there.normal - jump.normal)
                    + tangent[(d, 1)] * (there.tangential - jump.tangential);
                by_jump + dot(g.column(d), &finer.scaled)
            };
            for (d, sides) in reaches.iter_mut().enumerate() {
                *sides = sides.map(|half| half.hypot(NORMAL_95 * moved(d)));
            }
        }
        for (d, sides) in reaches.iter_mut().enumerate() {
            let shift = self.bias().map_or(0.0, |bias| dot(g.column(d), bias));
            *sides = [sides[0] + f64::max(shift, 0.0), sides[1] + f64::max(-shift, 0.0)];
        }
        reaches
    }

    /// Leads each draw through the law, and puts its errors into `lists`.
    fn draw_errors(&self, at: &AtInstant<'_>, of: &AtPair, (draws, given_z): (&Draws, &Dense), lists: &mut ErrorLists) {
        let AtPair { pair, jump, response, g, by_constant, .. } = of;
        let (errors, own, tangent, here) = (&at.errors, at.errors.own[*pair], response.tangent, response.traction);
        lists.iter_mut().for_each(Vec::clear);
        // w given dz, and the factor of what is left of its covariance.
        let b = |c: usize| given_z.column(2 * pair + c);
        let left = |c: usize, d: usize| own[c][d] - dot(errors.cross.column(2 * pair + c), b(d));
        let first = left(0, 0).max(0.0).sqrt();
        let tie = if first > 0.0 { left(0, 1) / first } else { 0.0 };
        let second = (left(1, 1) - tie * tie).max(0.0).sqrt();
        for k in 0..DRAWS {
            let (e, off, [p, q]) = (&draws.noise[k], &draws.constants[k], draws.more[k]);
            let w = [dot(b(0), e) + first * p, dot(b(1), e) + tie * p + second * q];
            let mut dj = [0, 1].map(|c| dot(errors.by_z.column(2 * pair + c), &draws.scaled[k]) + w[c]);
            for (off, effect) in off.iter().zip(&self.fit.constants) {
                let moved = effect.jumps[at.i][*pair];
                dj = [dj[0] + off * moved.normal, dj[1] + off * moved.tangential];
            }
            let there = Jump { normal: jump.normal + dj[0], tangential: jump.tangential + dj[1] };
            let t = draws.laws[k].response(there).traction;
            for (d, error) in [t.normal - here.normal, t.tangential - here.tangential].into_iter().enumerate() {
                let of_constants: f64 = off.iter().zip(by_constant).map(|(off, by)| off * by[d]).sum();
                let of_noise = dot(g.column(d), e) + tangent[(d, 0)] * w[0] + tangent[(d, 1)] * w[1];
                lists[2 * d].push(error);
                lists[2 * d + 1].push(of_noise + of_constants);
            }
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Change of the traction by the prescribed parameters of the law that `effect` moves, `by` being its derivatives by
/// all of them.
fn law_change(problem: &Problem<'_>, effect: &ConstantEffect, by: &[Traction]) -> Traction {
    let prescribed = by.iter().zip(&effect.law).enumerate().filter(|(index, _)| !is_fitted(problem, *index));
    prescribed.fold(Traction::default(), |sum, (_, (by, change))| Traction {
        normal: sum.normal + by.normal * change,
        tangential: sum.tangential + by.tangential * change,
    })
}

/// Errors by the noise of jumps and force at the instant number `i` of those compared.
fn errors(
    problem: &Problem<'_>,
    fit: &Fit,
    statistics: &Statistics,
    covariance: &Dense,
    i: usize,
    law: &dyn CohesiveLaw,
) -> Result<Errors, FitError> {
    let (model, observation, noise) = (fit.evaluation.model(problem), &*problem.observation, &*problem.noise);
    let index = observation.instants[i].index;
    let instant = &fit.solution().instants[index];
    let n = problem.unknowns.n();
    let slopes = problem.unknowns.slopes(&fit.evaluation.x);
    let reaction = |cell| problem.reaction((cell, model), law, &instant.displacement);
    let cell = observation.cell().map(|cell| (cell.width_mm, reaction(cell)));
    // Of jumps, force and nothing, for a change of the displacements and, of the force itself, of the law.
    let changes = |by: &Vec<[f64; 2]>, by_law: Option<usize>| -> Vec<f64> {
        let jumps = model.jump_changes(&instant.displacement, by);
        let of_law = |reaction: &ReactionAt| by_law.map_or(0.0, |index| reaction.by_law[index]);
        let force = cell.iter().map(|(width, reaction)| width * (reaction.change(by) + of_law(reaction)));
        let force = force.flat_map(|force| [force, 0.0]);
        jumps.iter().flat_map(|jump| [jump.normal, jump.tangential]).chain(force).collect()
    };
    let by_unknown: Vec<Vec<f64>> = (problem.unknowns.list().iter())
        .map(|unknown| changes(&instant.sensitivities[unknown.index], Some(unknown.index)))
        .collect();
    let n_groups = model.mesh().pairs().len() + usize::from(cell.is_some());
    let by_z = Dense::from_fn(n, 2 * n_groups, |k, at| slopes[k] * by_unknown[k][at]);
    let mut cross = Dense::zeros(n, 2 * n_groups);
    if observation.prescribed.is_empty() {
        return Ok(Errors { by_z, cross, own: vec![[[0.0; 2]; 2]; n_groups] });
    }
    let columns = problem.unit_motions();
    let fields = model.linearise(law, &instant.displacement)?.by_boundary(columns.instants());
    let by_boundary: Vec<Vec<f64>> = fields.iter().map(|field| changes(field, None)).collect();
    let sigma2 = noise_factor(fit) * statistics.sigma * statistics.sigma;
    let products = |a: &Dense, b: &Dense, add: &dyn Fn(usize, usize) -> f64| -> Vec<[[f64; 2]; 2]> {
        let entry = |r: usize, c: usize| dot(a.column(r), b.column(c)) + add(r, c);
        (0..n_groups).map(|p| [0, 1].map(|r| [0, 1].map(|c| entry(2 * p + r, 2 * p + c)))).collect()
    };
    if fit.largest_correction.is_none() {
        let by_coefficients = Dense::from_fn(2 * n_groups, by_boundary.len(), |at, k| by_boundary[k][at]);
        let by_measured = problem.border.by_measured(&by_coefficients);
        let mut h = Dense::zeros(observation.n_rows(), 2 * n_groups);
        for k in 0..by_measured.n_columns() {
            let row = 2 * observation.prescribed[k / 2] + k % 2;
            (0..2 * n_groups).for_each(|at| h[(row, at)] = by_measured[(at, k)]);
        }
        let ch = noise.precision.inverse_times(&h);
        let mut all = Dense::zeros(observation.n_rows(), n);
        statistics.v.iter().for_each(|v| all.add(1.0, v));
        let mut tied = statistics.v[i].transposed_times(&ch);
        tied.add(noise.common, &all.transposed_times(&ch));
        cross.add(sigma2, &statistics.a.times(&tied));
        let mut own = products(&h, &ch, &|_, _| 0.0);
        own.iter_mut().flatten().flatten().for_each(|v| *v *= sigma2 * (1.0 + noise.common));
        return Ok(Errors { by_z, cross, own });
    }
    // The boundary was estimated with the parameters: `d_i = N^-1 T^T M (r - J z - e)` follows z, and what is left is
    // the uncertainty of the boundary given the parameters, with that of the common error e, which is good to
    // sigma^2 common.
    let h = Dense::from_fn(by_boundary.len(), 2 * n_groups, |k, at| by_boundary[k][at]);
    let t = &statistics.by_boundary[i];
    let mt = noise.precision.times(t);
    let Ok(factor) = t.transposed_times(&mt).cholesky() else {
        return Ok(Errors { by_z, cross, own: vec![[[0.0; 2]; 2]; n_groups] });
    };
    let back = factor.solve(&h);
    let pushed = mt.times(&back);
    let follows = fit.evaluation.jacobian()[i].transposed_times(&pushed);
    let taken = covariance.times(&follows);
    cross.add(-1.0, &taken);
    let mut of_common = noise.precision.inverse_times(&pushed);
    noise.precision.leave_force_out(&mut of_common);
    // The common error is known better than before by the number of instants.
    let m = observation.instants.len() as f64;
    let common = if noise.common > 0.0 { 1.0 / (m + 1.0 / noise.common) } else { 0.0 };
    let left = |r: usize, c: usize| {
        sigma2 * (dot(h.column(r), back.column(c)) + common * dot(pushed.column(r), of_common.column(c)))
    };
    let own = products(&follows, &taken, &left);
    Ok(Errors { by_z, cross, own })
}

/// The law in pure opening and in pure sliding, up to where it has nearly no traction left, with its uncertainty; the
/// bands lead the errors of the parameters through the law itself.
///
/// # Errors
/// Values that the law does not allow.
pub fn curve_bands(problem: &Problem<'_>, fit: &Fit) -> Result<[CurveBand; 2], FitError> {
    curve_bands_up_to(problem, fit, reach_of(&*problem.unknowns.law_at(&fit.evaluation.x)?), fit.axes.as_ref())
}

/// Largest jumps of interest in opening and in sliding, mm: where nearly no traction is left.
pub(crate) fn reach_of(law: &dyn CohesiveLaw) -> [f64; 2] {
    let opening = law.front_opening();
    // Sliding goes on until its traction is a hundredth of the peak.
    let peak = law.peak().tangential;
    let mut sliding = opening;
    let traction = |s: f64| law.response(Jump { normal: 0.0, tangential: s }).traction.tangential;
    for _ in 0..60 {
        if traction(sliding) < 0.01 * peak && sliding > opening {
            break;
        }
        sliding *= 1.3;
    }
    [opening, sliding]
}

/// The same up to these jumps in opening and in sliding, mm; of a likelihood that is not that of a normal distribution
/// along its `axes`.
pub(crate) fn curve_bands_up_to(
    problem: &Problem<'_>,
    fit: &Fit,
    [opening, sliding]: [f64; 2],
    axes: Option<&Axes>,
) -> Result<[CurveBand; 2], FitError> {
    let x = &fit.evaluation.x;
    let law: Box<dyn CohesiveLaw> = problem.unknowns.law_at(x)?;
    if law.parameters().is_empty() {
        return Ok([CurveBand::default(), CurveBand::default()]);
    }
    let list = problem.unknowns.list();
    let slopes = problem.unknowns.slopes(x);
    let covariance = fit.statistics.as_ref().map(|statistics| by_noise(statistics, fit));
    let along = axes.map_or(Vec::new(), |axes| laws_along(problem, fit, axes));
    let allowed = axes.map_or(&[][..], Axes::allowed);
    // Few draws have no quantiles.
    let along = if along.len() < ALONG_AXES / 2 { Vec::new() } else { along };
    let draws = covariance.as_ref().filter(|_| along.is_empty());
    let draws = draws.and_then(|covariance| Draws::new(problem, fit, covariance));
    let finer = fit.refinement.as_ref().filter(|refinement| refinement.included);
    let bias = fit.intervals.as_ref().and_then(|basis| basis.bias.as_ref());
    let band = |largest: f64, normal: bool| {
        let pick = |t: Traction| if normal { t.normal } else { t.tangential };
        let n = 101;
        let mut band = CurveBand::default();
        for k in 0..n {
            let s = largest * k as f64 / (n - 1) as f64;
            let jump = if normal { Jump { normal: s, tangential: 0.0 } } else { Jump { normal: 0.0, tangential: s } };
            let value = pick(law.response(jump).traction);
            let mut by = vec![Traction::default(); law.parameters().len()];
            law.by_parameters(jump, &mut by);
            let g: Vec<f64> = list
                .iter()
                .zip(&slopes)
                .map(|(u, slope)| slope * by.get(u.index).map_or(0.0, |&by| pick(by)))
                .collect();
            let variance = |covariance: &Dense| {
                let row_of = |r: usize| (0..g.len()).map(|c| g[r] * covariance[(r, c)] * g[c]).sum::<f64>();
                (0..g.len()).map(row_of).sum::<f64>().max(0.0)
            };
            // Parameters of the law that are fitted, and those that are prescribed, moved by each constant.
            let shift = |effect: &ConstantEffect| effect.law.iter().zip(&by).map(|(p, &by)| p * pick(by)).sum::<f64>();
            let by_constant: Vec<f64> = fit.constants.iter().map(shift).collect();
            // Without a covariance nothing is known.
            let of_noise = if list.is_empty() { 0.0 } else { covariance.as_ref().map_or(f64::INFINITY, variance) };
            let mut std = (of_noise + dot(&by_constant, &by_constant)).sqrt();
            let mut sides = [NORMAL_95 * std; 2];
            if !along.is_empty() {
                let mut errors: Vec<f64> = along.iter().map(|law| pick(law.response(jump).traction) - value).collect();
                (sides, std) = spread(&mut errors);
            }
            for error in allowed.iter().map(|law| pick(law.response(jump).traction) - value) {
                sides = [sides[0].max(-error), sides[1].max(error)];
            }
            if !allowed.is_empty() {
                std = std.max((sides[0] + sides[1]) / (2.0 * NORMAL_95));
            }
            if let Some(draws) = &draws {
                let mut errors: Vec<f64> =
                    draws.laws.iter().map(|law| pick(law.response(jump).traction) - value).collect();
                let first_order = |(e, off): (&Vec<f64>, &Vec<f64>)| dot(&g, e) + dot(off, &by_constant);
                let mut linear: Vec<f64> = draws.noise.iter().zip(&draws.constants).map(first_order).collect();
                sides = reach(std, &mut errors, &mut linear);
            }
            let more = finer.map_or(0.0, |finer| NORMAL_95 * dot(&g, &finer.scaled));
            let [low, high] = sides.map(|half| half.hypot(more));
            let shift = bias.map_or(0.0, |bias| dot(&g, bias));
            let [low, high] = [low + shift.max(0.0), high + (-shift).max(0.0)];
            band.jumps.push(jump);
            band.traction.push(value);
            band.std.push(std);
            band.low.push(value - low);
            band.high.push(value + high);
        }
        band
    };
    Ok([band(opening, true), band(sliding, false)])
}
