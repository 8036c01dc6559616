//! Law against law: several laws fitted to the same data and compared (THEORY 11).
//!
//! A wrong law can hide under noise in the misfit test, and a comparison still finds it: by `omega + 2 p` (Akaike), by
//! `omega + p ln n` (Schwarz), and by the residual of instants that were left out. What is asked for is averaged over
//! the laws that the data do not reject, with Akaike's weights.

use crate::identify::cases::error::check_amount;
use crate::identify::doubt::remarks::own_minima;
use crate::identify::intervals::axes::{WORKS, weights_at_end};
use crate::identify::intervals::bands::{curve_bands_up_to, reach_of};
use crate::identify::solve::law_starts::start_law;
use crate::identify::{
    Axes, Constant, ConstantKind, CurveBand, Fit, FitError, FitOptions, FitStatus, LeftOut, NORMAL_95, Part, Problem,
    Spread, TrustRegionOptions, Unknowns, WORK_REACHED, average, average_curve, fit, interval95, other_minima,
    share_of_interval, within_noise, wrong,
};
use crate::io::case::{Intervals, WeightKind};
use crate::mechanics::cohesive::{CohesiveLaw, LAW_NAMES, Parameter, parameters_by_name};
use rayon::prelude::*;

/// How far the criterion of Akaike of a law may lie above the least for its other minima to be looked for, and for the
/// objective to be followed: beyond, nothing of it is averaged.
const NEAR: f64 = 30.0;
/// Times that a lower minimum is gone on from.
const LOOKS: usize = 3;
/// By how much omega of left-out instants is lower where a law predicts them better: the other is then 5 % as likely,
/// exp(-3).
const BETTER: f64 = 6.0;
/// The reach of the curves beyond that of the best law.
const BEYOND: f64 = 1.2;

/// Several laws on the same data.
#[derive(Debug)]
pub struct Tournament<'a> {
    /// The laws, in the order that was asked for.
    pub laws: Vec<LawFit<'a>>,
    /// The law with the least `omega + 2 p` among those that are not rejected, or among all when all are; `None` where
    /// none can be compared.
    pub best: Option<usize>,
    /// The laws that the data cannot tell from the best one, itself among them; empty when all are rejected.
    pub alike: Vec<usize>,
    /// What is left when the law is not known; `None` when all are rejected.
    pub average: Option<Average>,
    /// What it all comes to, a sentence each.
    pub sentences: Vec<String>,
    /// Numbers compared.
    pub n_data: usize,
}

/// One law and its fit.
#[derive(Debug)]
pub struct LawFit<'a> {
    /// The data with the unknowns of this law.
    pub problem: Problem<'a>,
    /// Where its start comes from, in words.
    pub start: String,
    /// The fit, or why there is none.
    pub fit: Result<Fit, String>,
    /// How it compares; `None` where the fit has no whitened residual.
    pub score: Option<Score>,
    /// The instants left out.
    pub left_out: Option<LeftOut>,
    /// Traction in pure opening and in pure sliding, over the same jumps for all laws; `None` without a fit.
    pub curves: Option<[CurveBand; 2]>,
    /// Work of separation in pure opening and in pure sliding, N/mm; `None` without a fit.
    pub works: Option<[Spread; 2]>,
    /// Work as far as the furthest pair went, N/mm; `None` without a fit.
    pub reached: Option<Spread>,
    /// Other minima of its objective in scaled unknowns, and their values.
    minima: Vec<(Vec<f64>, f64)>,
    /// Whether the misfit test rejects it.
    pub rejected: bool,
    /// Its weight in the average, 0 to 1.
    pub weight: f64,
}

/// By what laws are compared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Score {
    /// The whitened residual: the objective under the inverse covariance.
    pub omega: f64,
    /// Parameters fitted.
    pub n_parameters: usize,
    /// Akaike's criterion: `omega + 2 p`; with an unknown noise `n ln(omega/n) + 2 p`.
    pub aic: f64,
    /// Schwarz's criterion: `p ln n` for `2 p`.
    pub bic: f64,
}

impl Score {
    /// How far it lies above the `best` one without what parameters cost (omega; with an unknown noise `n
    /// ln(omega/n)`), and how far noise alone puts it.
    pub fn above(&self, best: Score) -> (f64, f64) {
        (self.deviance() - best.deviance(), within_noise(best.n_parameters, self.n_parameters))
    }

    fn share_of_interval(&self, best: Score) -> f64 {
        share_of_interval(self.above(best).0, best.n_parameters, self.n_parameters)
    }

    fn deviance(&self) -> f64 {
        self.aic - 2.0 * self.n_parameters as f64
    }
}

/// What is asked for, averaged over the laws.
#[derive(Debug, Clone, PartialEq)]
pub struct Average {
    /// Traction in pure opening and in pure sliding.
    pub curves: [CurveBand; 2],
    /// Work of separation in pure opening and in pure sliding, N/mm.
    pub works: [Spread; 2],
    /// Work as far as the furthest pair went, N/mm.
    pub reached: Option<Spread>,
}

impl LawFit<'_> {
    /// Its name.
    pub fn name(&self) -> &'static str {
        self.problem.unknowns.law().name()
    }

    /// Whether its values are what the data want: the fit came to its end.
    pub fn converged(&self) -> bool {
        self.fit.as_ref().is_ok_and(|fit| fit.status == FitStatus::Converged)
    }

    /// What follows from `fit` to compare it by.
    fn take(&mut self, fit: Fit, options: &FitOptions) {
        self.score = score(&self.problem, &fit, options);
        self.rejected = fit.misfit.as_ref().is_some_and(crate::identify::Misfit::rejected);
        self.works = Some(works_of(self.problem.unknowns.law().parameters(), &fit));
        self.reached = quantity_of(&fit, WORK_REACHED);
        self.fit = Ok(fit);
    }

    /// Its criterion of Akaike above `least`; `None` of a law that cannot be the one looked for.
    fn above(&self, least: f64) -> Option<f64> {
        let score = self.score.filter(|_| self.converged() && !self.rejected);
        score.map(|score| score.aic - least)
    }

    /// Looks for other minima of a law that has some, and goes on from a lower one.
    fn look_around(&mut self, options: &FitOptions) -> Result<(), FitError> {
        for _ in 0..LOOKS {
            let Ok(done) = &self.fit else { return Ok(()) };
            let Some(statistics) = &done.statistics else { return Ok(()) };
            let weights = weights_at_end(&self.problem, statistics, options)?;
            let unknowns = &self.problem.unknowns;
            let z = unknowns.scaled(&done.evaluation.x);
            let here = done.evaluation.local(&weights, &self.problem.noise).omega;
            self.minima = other_minima(&self.problem, options, &weights, &done.boundary, &z);
            let Some((lower, omega)) = self.minima.first() else { return Ok(()) };
            if *omega >= here * (1.0 - 10.0 * options.region.standstill) {
                return Ok(());
            }
            let there = self.problem.with_unknowns(unknowns.starting_at(&unknowns.unscaled(lower))?);
            match fit(&there, &FitOptions { starts: Vec::new(), direct: None, ..options.clone() }) {
                Ok(found) if found.status == FitStatus::Converged && found.omega < done.omega => {
                    self.take(found, options);
                }
                _ => return Ok(()),
            }
        }
        Ok(())
    }

    /// Whether it counts in the average.
    fn counts(&self) -> bool {
        self.above(0.0).is_some() && self.curves.is_some()
    }

    /// Whether it predicts the left-out instants better than `other`, by more than laws that are alike differ.
    fn predicts_better_than(&self, other: &LawFit<'_>) -> bool {
        self.left_out.zip(other.left_out).is_some_and(|(own, others)| own.omega + BETTER < others.omega)
    }
}

/// The laws of a tournament, checked: names that there are, each once, two or more.
///
/// # Errors
/// A key error that names the law.
pub fn laws_of(names: &[String]) -> Result<Vec<&str>, FitError> {
    let mut laws: Vec<&str> = Vec::with_capacity(names.len());
    for name in names.iter().map(|name| name.trim()) {
        if parameters_by_name(name).is_err() {
            let what = format!("laws: there is no law '{name}'; give some of {}", LAW_NAMES.join(", "));
            return Err(wrong("fit", "laws", what));
        }
        if laws.contains(&name) {
            return Err(wrong("fit", "laws", format!("laws: '{name}' stands there twice")));
        }
        laws.push(name);
    }
    match laws.len() {
        0 | 1 => Err(wrong("fit", "laws", "laws: give two laws or more to be compared")),
        _ => Ok(laws),
    }
}

/// The laws that [`laws_of`] gives, each of which can be started from `own`, the law of the case, and has enough data.
/// Errors: what [`laws_of`] refuses; a law that cannot be started; fewer data than parameters.
pub(crate) fn check_laws<'n>(
    names: &'n [String],
    own: &dyn CohesiveLaw,
    n_data: usize,
) -> Result<Vec<&'n str>, FitError> {
    let names = laws_of(names)?;
    for name in names.iter().filter(|name| **name != own.name()) {
        check_amount(n_data, start_law(name, own)?.n())?;
    }
    Ok(names)
}

/// Fits every law called in `names` to the data of `problem`, whose own law is the one that the case starts; it is
/// fitted as the case says where it is among them. The others start from it. All in parallel; the result does not
/// depend on the threads.
///
/// # Errors
/// Names that [`laws_of`] refuses, a law that cannot be started, fewer data than parameters; a covariance without
/// inverse. A law whose fit fails is a result.
pub fn tournament<'a>(
    problem: &Problem<'a>,
    options: &FitOptions,
    names: &[String],
) -> Result<Tournament<'a>, FitError> {
    let own_law = problem.unknowns.law();
    // Whether a law can be started from this one is known at once, and is said before hours of fits.
    let names = check_laws(names, own_law, problem.n_data())?;
    let own = names.iter().position(|name| *name == own_law.name());
    // Where the case wants linear intervals, whatever they are worth, nothing else is looked for.
    let linear = options.intervals == Intervals::Linear;
    let options = &of_tournament(options, problem.n_data());
    let same = |unknowns: &Unknowns| unknowns.starting_at(&unknowns.start());
    let first = own.map(|_| fit(problem, options));
    let like = match &first {
        Some(Ok(found)) if found.status == FitStatus::Converged => problem.unknowns.law_at(&found.evaluation.x)?,
        _ => own_law.with_values(&own_law.values())?,
    };
    let others: Vec<&str> = names.iter().copied().filter(|name| *name != own_law.name()).collect();
    let mut fitted: Vec<(Unknowns, String, Result<Fit, FitError>)> = others
        .par_iter()
        .map(|name| fit_of(problem, options, name, [&*like, own_law]))
        .collect::<Result<_, FitError>>()?;
    if let (Some(place), Some(first)) = (own, first) {
        fitted.insert(place, (same(&problem.unknowns)?, "as the case says".to_owned(), first));
    }
    let mut laws: Vec<LawFit<'a>> = fitted
        .into_iter()
        .map(|(unknowns, start, found)| {
            let mut law = LawFit {
                start,
                fit: Err(String::new()),
                problem: problem.with_unknowns(unknowns),
                score: None,
                left_out: None,
                curves: None,
                works: None,
                reached: None,
                minima: Vec::new(),
                rejected: false,
                weight: 0.0,
            };
            match found {
                Ok(found) => law.take(found, options),
                Err(error) => law.fit = Err(in_words(error)),
            }
            law
        })
        .collect();
    let near = |laws: &[LawFit<'_>]| {
        let least = best_of(laws).and_then(|best| laws[best].score).map_or(f64::NAN, |score| score.aic);
        move |law: &LawFit<'_>| law.above(least).is_some_and(|above| above <= NEAR)
    };
    let is_near = near(&laws);
    laws.par_iter_mut().filter(|law| is_near(law)).try_for_each(|law| law.look_around(options))?;
    let (best, is_near) = (best_of(&laws), near(&laws));
    let reach = match best.and_then(|best| laws[best].fit.as_ref().ok().map(|fit| (best, fit))) {
        Some((best, fit)) => {
            reach_of(&*laws[best].problem.unknowns.law_at(&fit.evaluation.x)?).map(|reach| BEYOND * reach)
        }
        None => reach_of(own_law),
    };
    let ended = problem.watch.ended().is_some();
    laws.par_iter_mut().try_for_each(|law| -> Result<(), FitError> {
        let Ok(fit) = &law.fit else { return Ok(()) };
        let followed = is_near(law) && !ended && !linear;
        let axes = match &fit.statistics {
            Some(statistics) if followed => {
                Axes::new(&law.problem, (&fit.evaluation, &fit.boundary), statistics, options, &law.minima)?
            }
            _ => None,
        };
        law.curves = Some(curve_bands_up_to(&law.problem, fit, reach, axes.as_ref())?);
        if let (Some(axes), Some(works)) = (&axes, &mut law.works) {
            (0..2).for_each(|mode| works[mode] = profile_work(fit, mode, works[mode], axes.works()[mode]));
        }
        law.left_out = if ended { None } else { law.problem.left_out(fit, options, law.rejected)? };
        Ok(())
    })?;
    let alike = weigh(&mut laws, best);
    let average = average_of(&laws, best);
    let mut found = Tournament { laws, best, alike, average, sentences: Vec::new(), n_data: problem.n_data() };
    found.sentences = found.write_sentences();
    Ok(found)
}

/// Share of what one number measured adds to the objective by which a fit has to get on, see
/// [`TrustRegionOptions::standstill`]: a comparison of laws, whose objectives noise makes differ by some units, does
/// not depend on more.
const STANDSTILL: f64 = 0.01;

/// How each law is fitted: with linear intervals of its parameters, unless the case asks for others, and no further
/// than matters to a comparison.
fn of_tournament(options: &FitOptions, n_data: usize) -> FitOptions {
    let intervals = if options.intervals == Intervals::Auto { Intervals::Linear } else { options.intervals };
    let region = TrustRegionOptions { standstill: STANDSTILL / n_data as f64, ..options.region };
    FitOptions { intervals, region, release: false, other_minima: false, ..options.clone() }
}

/// The work of separation `work` of a mode with the ends that its profile likelihood has, and the constants.
fn profile_work(fit: &Fit, mode: usize, work: Spread, ends: [Option<f64>; 2]) -> Spread {
    let parameter = fit.parameters.iter().position(|p| WORKS[mode].contains(&p.parameter.name));
    let quantity = || fit.derived.iter().position(|d| mode == 1 && d.quantity.name == "phi_t");
    let others = match (parameter, quantity()) {
        (Some(k), _) => fit.budget.parameter(k).others,
        (None, Some(q)) => fit.budget.quantity(q).others,
        // Prescribed: nothing to be followed.
        (None, None) => return work,
    };
    let noise = ends.map(|end| end.map(|end| (end / work.value).ln().abs()));
    let ends95 = interval95(0.0, noise, 0.0, others / work.value).map(|end| end.map(|end| work.value * end.exp()));
    let std = match ends95 {
        [Some(low), Some(high)] => Some(0.5 * (high - low) / NORMAL_95),
        _ => None,
    };
    Spread { std, ends95, ..work }
}

/// A law started like the first of `likes`, and like the second where that leads nowhere.
fn fit_of(
    problem: &Problem<'_>,
    options: &FitOptions,
    name: &str,
    likes: [&dyn CohesiveLaw; 2],
) -> Result<(Unknowns, String, Result<Fit, FitError>), FitError> {
    // Starts and prescribed parameters of the case are those of another law.
    let is_other = |constant: &&Constant| !matches!(constant.kind, ConstantKind::Law { .. });
    let constants = options.constants.iter().filter(is_other).cloned().collect();
    let options = FitOptions { starts: Vec::new(), constants, ..options.clone() };
    let mut ends: Vec<(Unknowns, String, Result<Fit, FitError>)> = Vec::new();
    for (k, like) in likes.into_iter().enumerate() {
        let Ok(unknowns) = start_law(name, like) else { continue };
        let start = format!(
            "strengths and works of separation of '{}' as {}",
            like.name(),
            ["it was fitted", "the case starts it"][k]
        );
        let of_law = problem.with_unknowns(unknowns.starting_at(&unknowns.start())?);
        let found = fit(&of_law, &options);
        let done = found.as_ref().is_ok_and(|fit| fit.status == FitStatus::Converged);
        ends.push((unknowns, start, found));
        if done || problem.watch.ended().is_some() {
            break;
        }
    }
    let rank = |end: &(Unknowns, String, Result<Fit, FitError>)| match &end.2 {
        Ok(fit) => (fit.status != FitStatus::Converged, fit.omega),
        Err(_) => (true, f64::INFINITY),
    };
    let best = ends.into_iter().min_by(|a, b| {
        let (a, b) = (rank(a), rank(b));
        a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
    });
    // The start of the case was tried before anything was fitted.
    best.ok_or(FitError::Lost)
}

fn in_words(error: FitError) -> String {
    let causes = std::iter::successors(std::error::Error::source(&error), |error| error.source());
    causes.fold(error.to_string(), |text, cause| format!("{text}: {cause}"))
}

/// What a fit is compared by.
fn score(problem: &Problem<'_>, fit: &Fit, options: &FitOptions) -> Option<Score> {
    let n = problem.n_data() as f64;
    let p = fit.parameters.len();
    let known = problem.noise.sigma.is_some();
    let omega = match (&fit.misfit, options.weights) {
        (Some(misfit), _) => misfit.omega,
        (None, WeightKind::Covariance) if known => fit.omega,
        _ => return None,
    };
    let deviance = match (known, &fit.statistics) {
        (true, _) => omega,
        // In units of its own noise every law would be as good as any other.
        (false, Some(statistics)) => n * (omega * statistics.sigma * statistics.sigma / n).ln(),
        (false, None) => return None,
    };
    let score = Score { omega, n_parameters: p, aic: deviance + 2.0 * p as f64, bic: deviance + p as f64 * n.ln() };
    (score.aic.is_finite() && score.bic.is_finite()).then_some(score)
}

fn quantity_of(fit: &Fit, name: &str) -> Option<Spread> {
    let found = fit.derived.iter().find(|d| d.quantity.name == name)?;
    Some(Spread { value: found.quantity.value, std: found.std, ends95: found.ends95 })
}

/// The works of separation: a parameter, or what follows from the parameters.
fn works_of(parameters: &[Parameter], fit: &Fit) -> [Spread; 2] {
    let [opening, sliding] = WORKS;
    let parameter = |names: &[&str]| {
        let p = fit.parameters.iter().find(|p| names.contains(&p.parameter.name))?;
        Some(Spread { value: p.value, std: p.std, ends95: p.ends95 })
    };
    // A work that the case prescribes is exact here: its uncertainty is among the constants.
    let law = |names: &[&str]| {
        let place = parameters.iter().position(|p| names.contains(&p.name));
        let value = place.map_or(f64::NAN, |place| fit.values[place]);
        Spread { value, std: Some(0.0), ends95: [Some(value); 2] }
    };
    [
        parameter(opening).unwrap_or_else(|| law(opening)),
        parameter(sliding).or_else(|| quantity_of(fit, "phi_t")).unwrap_or_else(|| law(sliding)),
    ]
}

/// The law with the least criterion of Akaike: of those that converged and are not rejected, else of those that
/// converged, else of all.
fn best_of(laws: &[LawFit<'_>]) -> Option<usize> {
    let least = |chosen: &dyn Fn(&LawFit<'_>) -> bool| {
        let aic = |k: &usize| laws[*k].score.map_or(f64::INFINITY, |score| score.aic);
        let places = (0..laws.len()).filter(|&k| laws[k].score.is_some() && chosen(&laws[k]));
        places.min_by(|a, b| aic(a).total_cmp(&aic(b)))
    };
    least(&|law| law.converged() && !law.rejected)
        .or_else(|| least(&|law| law.converged()))
        .or_else(|| least(&|_| true))
}

/// Gives every law its weight, and the laws that cannot be told from the best.
fn weigh(laws: &mut [LawFit<'_>], best: Option<usize>) -> Vec<usize> {
    let Some(best) = best.filter(|&best| laws[best].counts()) else { return Vec::new() };
    let least = laws[best].score.map_or(0.0, |score| score.aic);
    let above = |law: &LawFit<'_>| law.score.filter(|_| law.counts()).map(|score| score.aic - least);
    let likelihoods: Vec<f64> = laws.iter().map(|law| above(law).map_or(0.0, |above| (-0.5 * above).exp())).collect();
    let sum: f64 = likelihoods.iter().sum();
    laws.iter_mut().zip(&likelihoods).for_each(|(law, likelihood)| law.weight = likelihood / sum);
    let lowest_aic = laws[best].score;
    let alike = |law: &LawFit<'_>| {
        let above = law.score.filter(|_| law.counts()).zip(lowest_aic).map(|(score, best)| score.above(best));
        above.is_some_and(|(above, within)| above <= within)
    };
    (0..laws.len()).filter(|&k| alike(&laws[k])).collect()
}

fn average_of(laws: &[LawFit<'_>], best: Option<usize>) -> Option<Average> {
    let places: Vec<usize> = (0..laws.len()).filter(|&k| laws[k].weight > 0.0).collect();
    let best = laws[best.filter(|_| !places.is_empty())?].score?;
    fn part_of<T>(law: &LawFit<'_>, best: Score, of: T) -> Part<T> {
        let share = law.score.map_or(0.0, |score| score.share_of_interval(best));
        Part { weight: law.weight, share, of }
    }
    let mode = |mode: usize| {
        let curve = |&k: &usize| Some(part_of(&laws[k], best, &laws[k].curves.as_ref()?[mode]));
        let work = |&k: &usize| Some(part_of(&laws[k], best, laws[k].works.as_ref()?[mode]));
        let curves: Vec<Part<&CurveBand>> = places.iter().filter_map(curve).collect();
        (average_curve(&curves), average(&places.iter().filter_map(work).collect::<Vec<_>>()))
    };
    let ((opening, work_n), (sliding, work_t)) = (mode(0), mode(1));
    let reached: Vec<_> = places.iter().filter_map(|&k| Some(part_of(&laws[k], best, laws[k].reached?))).collect();
    let reached = (!reached.is_empty()).then(|| average(&reached));
    Some(Average { curves: [opening, sliding], works: [work_n, work_t], reached })
}

impl Tournament<'_> {
    /// What the comparison comes to, a sentence each.
    fn write_sentences(&self) -> Vec<String> {
        let list = |places: &[usize]| places.iter().map(|&k| self.laws[k].name()).collect::<Vec<_>>().join(", ");
        let all = |chosen: &dyn Fn(&LawFit<'_>) -> bool| -> Vec<usize> {
            (0..self.laws.len()).filter(|&k| chosen(&self.laws[k])).collect()
        };
        let aic = |k: usize| self.laws[k].score.map_or(f64::NAN, |score| score.aic);
        let mut said = vec![match (self.best, self.alike.as_slice()) {
            (None, _) => "the laws cannot be compared: none has a fit with a whitened residual".to_owned(),
            (Some(best), []) => format!(
                "no law is left: the data reject every law that was fitted; the least bad is {} (omega + 2 p = {:.1})",
                self.laws[best].name(),
                aic(best)
            ),
            (Some(best), [_]) => {
                let next =
                    all(&|law| law.counts()).into_iter().filter(|&k| k != best).map(aic).fold(f64::INFINITY, f64::min);
                let behind = match next.is_finite() {
                    true => format!("the next has omega + 2 p higher by {:.1}", next - aic(best)),
                    false => "no other is left".to_owned(),
                };
                format!("the data choose {}: {behind}", self.laws[best].name())
            }
            (Some(_), alike) => format!(
                "these data cannot tell {} apart: their omega lies above that of the best by no more than noise explains; what is asked for \
                 is averaged over them",
                list(alike)
            ),
        }];
        let rejected = all(&|law| law.rejected);
        if !rejected.is_empty() && !self.alike.is_empty() {
            said.push(format!("rejected by the misfit test: {}", list(&rejected)));
        }
        let behind: Vec<usize> = all(&|law| law.counts()).into_iter().filter(|k| !self.alike.contains(k)).collect();
        if let (false, Some(best)) = (behind.is_empty(), self.best) {
            let each: Vec<String> =
                behind.iter().map(|&k| format!("{} (by {:.1})", self.laws[k].name(), aic(k) - aic(best))).collect();
            said.push(format!("not rejected alone, but worse than the best: {}", each.join(", ")));
        }
        if let Some(best) = self.best
            && let Some(better) = all(&|law| law.counts() && law.score.is_some_and(|score| score.aic > aic(best)))
                .into_iter()
                .find(|&k| self.laws[k].predicts_better_than(&self.laws[best]))
        {
            said.push(format!("left-out instants are predicted better by {}", self.laws[better].name()));
        }
        for law in &self.laws {
            match &law.fit {
                Err(reason) => said.push(format!("{} could not be fitted: {reason}", law.name())),
                Ok(fit) if fit.status != FitStatus::Converged => {
                    said.push(format!(
                        "the fit of {} did not converge ({}) and is not averaged",
                        law.name(),
                        fit.reason
                    ));
                }
                Ok(_) if law.score.is_none() => said.push(format!(
                    "{} is not compared: the data say nothing of some combination of its parameters, or the time limit was reached",
                    law.name()
                )),
                Ok(_) => {}
            }
        }
        let rough = |law: &&LawFit<'_>| law.problem.unknowns.law().has_own_minima();
        let rough: Vec<&str> = self.alike.iter().map(|&k| &self.laws[k]).filter(rough).map(LawFit::name).collect();
        if !rough.is_empty() {
            said.push(own_minima(&rough.join(", ")).text);
        }
        if self.laws.iter().all(|law| law.problem.noise.sigma.is_none()) {
            said.push(
                "the noise was estimated from the residual of each law: the misfit test as a whole tests nothing"
                    .to_owned(),
            );
        }
        said
    }
}
