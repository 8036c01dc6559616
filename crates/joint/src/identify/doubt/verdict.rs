//! What a fit comes to, in words: determined, not determined, or model rejected (THEORY 11).

use crate::identify::{
    FittedParameter, FittedQuantity, IntervalBasis, Misfit, MissingMode, ROTATIONS_HELD, Released, ReleasedWidth,
    Rotations, ThicknessAlong, as_normal,
};
use crate::linalg::Dense;

/// Relative standard uncertainty above which a parameter is not determined.
pub const LARGEST_STD: f64 = 0.25;
/// Correlation, in magnitude, above which two parameters that are known badly are named together.
pub const LARGEST_CORRELATION: f64 = 0.95;
/// The residual noise over the noise that the uncertainties are made with, above which (or below whose inverse) the two
/// contradict each other.
pub const LARGEST_NOISE_RATIO: f64 = 1.25;

/// Share of the draws of a bootstrap that may fail.
pub const LARGEST_FAILED: f64 = 0.2;

/// What a fit comes to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Outcome {
    /// Every parameter asked for is known within its interval.
    Determined,
    /// The data leave some parameter open.
    #[default]
    NotDetermined,
    /// The data contradict the model: its intervals are conditional on a model that is not true.
    Rejected,
}

impl Outcome {
    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Determined => "determined",
            Self::NotDetermined => "not determined",
            Self::Rejected => "model rejected",
        }
    }
}

/// The verdict on a fit.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Verdict {
    /// What it comes to.
    pub outcome: Outcome,
    /// What there is to say, a sentence each; the first says the outcome.
    pub sentences: Vec<String>,
    /// What the intervals are conditional on: the prescribed values, as `r = 4`.
    pub given: Vec<String>,
    /// The thresholds.
    pub thresholds: String,
}

/// What a verdict goes by beside the parameters.
#[derive(Debug)]
pub struct Grounds<'a> {
    /// Correlation of the parameters.
    pub correlation: &'a Dense,
    /// What the intervals rest on.
    pub intervals: Option<&'a IntervalBasis>,
    /// The misfit test.
    pub misfit: Option<&'a Misfit>,
    /// The prescribed parameters as unknowns.
    pub released: Option<&'a Released>,
    /// The width of the specimen as an unknown, where a load cell takes part.
    pub width: Option<&'a ReleasedWidth>,
    /// The thickness along the joint as an unknown.
    pub along: Option<&'a ThicknessAlong>,
    /// Standard uncertainty of each of those, as the error budget has it; zero where the value is exact.
    pub released_std: &'a [f64],
    /// Noise that the residual shows over the noise that was used, where both are known.
    pub noise_ratio: Option<f64>,
    /// The prescribed values, as `r = 4`.
    pub given: Vec<String>,
    /// Why the fit is not at its end, a sentence each; empty where it is.
    pub unfinished: Vec<String>,
    /// What kind of test would tell what these data leave open.
    pub missing: Option<MissingMode>,
}

impl Verdict {
    /// Whether all parameters are determined.
    pub fn determined(&self) -> bool {
        self.outcome == Outcome::Determined
    }

    /// The verdict where the data say nothing of some combination of the unknowns.
    /// `unfinished` says why the fit is not at its end, where it is not; `missing` what kind of test would tell more.
    pub fn singular(parameters: &[FittedParameter], unfinished: Vec<String>, missing: Option<&MissingMode>) -> Self {
        let singular = format!(
            "these data do not determine {}: they say nothing about some combination of them",
            list_of(parameters)
        );
        Self {
            outcome: Outcome::NotDetermined,
            sentences: std::iter::once(singular)
                .chain(missing.and_then(MissingMode::sentence))
                .chain(unfinished)
                .collect(),
            given: Vec::new(),
            thresholds: thresholds(),
        }
    }

    /// The verdict on `parameters`.
    pub fn new(parameters: &[FittedParameter], grounds: &Grounds<'_>) -> Self {
        let against = find_contradictions(grounds);
        let mut open = grounds.unfinished.clone();
        let undetermined = find_undetermined(parameters, grounds);
        // Another kind of test helps against what the data leave open, not against a wrong model or noise.
        let missing = grounds.missing.as_ref().filter(|_| !undetermined.is_empty() && against.is_empty());
        open.extend(undetermined);
        open.extend(missing.and_then(MissingMode::sentence));
        if let Some(ratio) = grounds.noise_ratio
            && !(1.0 / LARGEST_NOISE_RATIO..=LARGEST_NOISE_RATIO).contains(&ratio)
        {
            open.push(format!(
                "the noise is not what was stated: the images show {ratio:.2} times the noise that the uncertainties are made \
                 with; state another, or none"
            ));
        }
        if let Some(misfit) = grounds.misfit
            && misfit.tested
            && too_quiet(misfit)
        {
            open.push(format!(
                "the noise is less than what the uncertainties are made with: the residual is {:.2} times what that would leave, \
                 and the intervals are too wide",
                (misfit.omega / misfit.freedom).max(0.0).sqrt()
            ));
        }
        let names = list_of(parameters);
        let given = match grounds.given.as_slice() {
            [] => String::new(),
            given => format!(", given {}", given.join(", ")),
        };
        let outcome = match (against.is_empty(), open.is_empty()) {
            (false, _) => Outcome::Rejected,
            (true, false) => Outcome::NotDetermined,
            (true, true) => Outcome::Determined,
        };
        let mut sentences = match outcome {
            Outcome::Rejected => vec![
                "the data contradict the model: its parameters and intervals are conditional on a model that is not true"
                    .to_owned(),
            ],
            Outcome::NotDetermined => vec![format!("these data do not determine all of {names}{given}")],
            Outcome::Determined => {
                let verb = if parameters.len() == 1 { "is" } else { "are" };
                vec![format!("{names} {verb} determined by these data{given}")]
            }
        };
        sentences.extend(against);
        sentences.extend(open);
        sentences.extend(advice(grounds));
        let tested = grounds.misfit.is_some_and(|misfit| misfit.tested);
        if !tested {
            sentences.push(
                "whether the data contradict the model as a whole is not tested: the noise was estimated from the same \
                 residual"
                    .to_owned(),
            );
        }
        Self { outcome, sentences, given: grounds.given.clone(), thresholds: thresholds() }
    }
}

impl Verdict {
    /// The same with what is known of rotations that were taken as small: where they cost more than what is not known,
    /// nothing is determined.
    pub(crate) fn with_rotations(mut self, rotations: Option<&Rotations>, parameters: &[FittedParameter]) -> Self {
        let held = |rotations: &&Rotations| rotations.in_stds(parameters).is_none_or(|cost| cost <= ROTATIONS_HELD);
        let cost = rotations.filter(|rotations| rotations.change.is_some() && !held(rotations));
        let Some(sentence) = cost.and_then(|rotations| rotations.remark(parameters)) else { return self };
        if self.outcome == Outcome::Determined {
            self.outcome = Outcome::NotDetermined;
            let names = list_of(parameters);
            self.sentences[0] = format!("{names} are not determined by a model whose rotations are small");
        }
        let place = self.sentences.len().min(1);
        self.sentences.insert(place, sentence.text);
        self
    }
}

/// Whether even the noise alone, without anything that elements and constants may add, would leave more: by more than
/// the factor at which a stated noise is contradicted, and more than chance (few numbers scatter).
fn too_quiet(misfit: &Misfit) -> bool {
    let chance = as_normal(misfit.omega / misfit.freedom, misfit.freedom);
    misfit.omega < misfit.freedom / LARGEST_NOISE_RATIO.powi(2) && chance < -misfit.limit
}

/// What a load curve by itself tells, and what it leaves open, as a sentence.
pub(crate) fn curve_alone(parameters: &[FittedParameter], derived: &[FittedQuantity]) -> String {
    let relative = |p: &FittedParameter| (p.parameter.name, p.relative_std());
    let of_derived = |q: &FittedQuantity| {
        let std = q.std.unwrap_or(f64::INFINITY);
        (q.quantity.name, std / q.quantity.value.abs().max(f64::MIN_POSITIVE))
    };
    let all: Vec<(&str, f64)> = parameters.iter().map(relative).chain(derived.iter().map(of_derived)).collect();
    let known = |&&(_, std): &&(&str, f64)| std <= LARGEST_STD;
    let told: Vec<String> =
        all.iter().filter(known).map(|(name, std)| format!("{name} to {:.2} %", 100.0 * std)).collect();
    let open: Vec<&str> = all.iter().filter(|one| !known(one)).map(|(name, _)| *name).collect();
    let told = if told.is_empty() { "nothing".to_owned() } else { told.join(", ") };
    let open = match open.as_slice() {
        [] => String::new(),
        open => format!(
            "; it leaves open {} (fields measured beside the adhesive, or prescribed values, tell them)",
            open.join(", ")
        ),
    };
    format!("the load curve alone, without fields, tells {told}{open}; the border is taken as exact")
}

pub(crate) fn thresholds() -> String {
    format!(
        "not determined, if the fit did not finish, a standard uncertainty (with everything in it) is above {:.0} %, a parameter is on a bound or its \
         interval open, the bias is larger than the interval without it, more than {:.0} % of the bootstrap failed, the noise is wrong by more than \
         {LARGEST_NOISE_RATIO} times, or rotations taken as small cost more than a standard uncertainty; rejected, if the misfit test fails at 1 %, or the data \
         contradict prescribed values",
        100.0 * LARGEST_STD,
        100.0 * LARGEST_FAILED
    )
}

pub(crate) fn list_of(parameters: &[FittedParameter]) -> String {
    parameters.iter().map(|p| p.parameter.name).collect::<Vec<_>>().join(", ")
}

/// What speaks against the model.
pub(crate) fn find_contradictions(grounds: &Grounds<'_>) -> Vec<String> {
    let mut sentences = Vec::new();
    if let Some(misfit) = grounds.misfit
        && misfit.rejected()
    {
        if misfit.tested {
            sentences.push(format!(
                "omega is {:.0}, {:+.1} % from the {:.0} expected of noise, element size and constants (z = {:.1}, rejected above {:.1})",
                misfit.omega,
                100.0 * misfit.excess,
                misfit.freedom + misfit.floor.unwrap_or(0.0) + misfit.constants,
                misfit.z,
                misfit.limit
            ));
        }
        let worst = misfit.worst();
        if !worst.is_empty() {
            sentences.push(format!("worst: {}", worst.join("; ")));
        }
    }
    sentences.extend(grounds.width.and_then(ReleasedWidth::sentence));
    sentences.extend(grounds.along.and_then(ThicknessAlong::sentence));
    if let Some(released) = grounds.released.filter(|released| released.significant()) {
        for (p, &std) in released.parameters.iter().zip(grounds.released_std) {
            if p.contradicts(std) {
                sentences.push(format!(
                    "{} = {} is refused by the data: as an unknown it is {:.4} +- {:.2}, and omega falls by {:.0}; add it to \
                     [fit] parameters",
                    p.name,
                    p.prescribed,
                    p.value,
                    p.std.unwrap_or(0.0),
                    released.gain
                ));
            }
        }
    }
    sentences
}

/// The parameters that the data leave open.
pub(crate) fn find_undetermined(parameters: &[FittedParameter], grounds: &Grounds<'_>) -> Vec<String> {
    let correlation = grounds.correlation;
    let mut sentences = Vec::new();
    let relative: Vec<f64> = parameters.iter().map(FittedParameter::relative_std).collect();
    for (k, p) in parameters.iter().enumerate() {
        let name = p.parameter.name;
        if p.at_bound {
            let [low, high] = p.bounds;
            sentences.push(format!(
                "{name} is not determined: it ended on its bound ({} of {low} to {high}), where its interval means little; \
                 widen the bound or prescribe it",
                p.value
            ));
            continue;
        }
        let side = match p.ends95 {
            [Some(_), Some(_)] => None,
            [Some(_), None] => Some("no upper end"),
            [None, Some(_)] => Some("no lower end"),
            [None, None] => Some("neither a lower nor an upper end"),
        };
        if let Some(side) = side {
            sentences.push(format!("{name} is not determined: its 95 % interval has {side}"));
            continue;
        }
        if let Some((bias, half)) = bias_beyond_interval(p) {
            sentences.push(format!(
                "{name} is not determined: noise shifts it by {:+.1} % on average, more than the {:.1} % that its interval \
                 reaches without that",
                100.0 * bias / p.value,
                100.0 * half / p.value.abs()
            ));
        }
        if relative[k] <= LARGEST_STD {
            continue;
        }
        let partner = (0..parameters.len())
            .filter(|&other| other != k)
            .map(|other| (other, correlation[(k, other)]))
            .filter(|(_, value)| value.abs() > LARGEST_CORRELATION)
            .max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
        sentences.push(match partner {
            Some((other, value)) => format!(
                "{name} is not determined: its standard uncertainty is {} of its value, and it is known only together with {} \
                 (correlation {value:.3}); add another mode mixity, or prescribe {name} with its uncertainty",
                percent(relative[k]),
                parameters[other].parameter.name
            ),
            None => format!(
                "{name} is not determined: its standard uncertainty is {} of its value; prescribe it with its uncertainty, or \
                 measure with less noise",
                percent(relative[k])
            ),
        });
    }
    if let Some(basis) = grounds.intervals.filter(|basis| basis.failed() as f64 > LARGEST_FAILED * basis.draws as f64) {
        sentences.push(format!(
            "the intervals are not to be relied on: {} of {} fits of simulated data failed",
            basis.failed(),
            basis.draws
        ));
    }
    sentences
}

/// The bias that noise makes and half the width of the interval without it, where the bias is the larger of the two.
fn bias_beyond_interval(p: &FittedParameter) -> Option<(f64, f64)> {
    let (bias, [low, high]) = (p.bias?, p.interval95?);
    let half = 0.5 * (high - low - bias.abs());
    (bias.abs() > half && half > 0.0).then_some((bias, half))
}

fn percent(share: f64) -> String {
    if share.is_finite() { format!("{:.0} %", 100.0 * share) } else { "without limit".to_owned() }
}

/// What the released parameters tell when they do not contradict.
pub(crate) fn advice(grounds: &Grounds<'_>) -> Option<String> {
    let released = grounds.released?;
    let names: Vec<&str> = released.parameters.iter().map(|p| p.name).collect();
    let found: Vec<String> = (released.parameters.iter())
        .map(|p| match p.std {
            Some(std) => format!("{} = {:.4} +- {:.2}", p.name, p.value, std),
            None => format!("{} = {:.4}", p.name, p.value),
        })
        .collect();
    let prescribed = names.join(", ");
    Some(match (released.converged, released.significant()) {
        (false, _) => format!("with {prescribed} as unknown{} the fit does not converge", plural(&names)),
        (true, false) => format!(
            "with {prescribed} as unknown{} omega falls by {:.1}, no more than chance ({:.1}): {}",
            plural(&names),
            released.gain,
            released.limit,
            found.join(", ")
        ),
        (true, true) if released.parameters.iter().zip(grounds.released_std).any(|(p, &std)| p.contradicts(std)) => {
            return None; // said among the contradictions
        }
        (true, true) => format!(
            "with {prescribed} as unknown{} omega falls by {:.0}: {}; these data determine more than was prescribed, add {} to [fit] \
             parameters",
            plural(&names),
            released.gain,
            found.join(", "),
            if names.len() == 1 { "it" } else { "them" }
        ),
    })
}

fn plural(names: &[&str]) -> &'static str {
    if names.len() == 1 { "" } else { "s" }
}
