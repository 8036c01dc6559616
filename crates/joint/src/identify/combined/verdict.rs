//! What a fit of several tests comes to: the verdict of a single one, and which test determines what.

use super::consistency::Consistency;
use super::share::TestShare;
use crate::identify::{FALSE_REJECTIONS, FittedParameter, Grounds, Misfit, Outcome, Verdict, normal_tail};

/// A parameter needs the tests together when the best of them alone leaves it with more than this times the
/// uncertainty.
const TOGETHER: f64 = 1.5;

/// What the verdict goes by beside the grounds of a single fit.
pub(super) struct OfTests<'a> {
    pub parameters: &'a [FittedParameter],
    pub shares: &'a [TestShare],
    /// The misfit of each test; none where the fit was cut short.
    pub misfits: &'a [Misfit],
    pub consistency: Option<&'a Consistency>,
}

/// The verdict on a fit of several tests; `grounds` are those of all of them together.
pub(super) fn verdict(of: &OfTests<'_>, grounds: Option<&Grounds<'_>>, unfinished: Vec<String>) -> Verdict {
    let mut verdict = match grounds {
        Some(grounds) => Verdict::new(of.parameters, grounds),
        None => Verdict::singular(of.parameters, unfinished, None),
    };
    let against = find_contradictions(of);
    if !against.is_empty() {
        if verdict.outcome != Outcome::Rejected {
            verdict.outcome = Outcome::Rejected;
            verdict.sentences[0] =
                "the data contradict the model: its parameters and intervals are conditional on a model that is not true"
                    .to_owned();
        }
        verdict.sentences.splice(1..1, against);
    }
    verdict.sentences.extend(who_determines(of));
    verdict.sentences.extend(nothing_new(of));
    verdict.thresholds.push_str(
        "; with several tests also if the misfit test of one of them fails, or the tests ask for different parameters, at 1 %",
    );
    verdict
}

/// What speaks against one law for all tests.
fn find_contradictions(of: &OfTests<'_>) -> Vec<String> {
    let mut sentences = Vec::new();
    // Each test is one more question.
    let limit = normal_tail(FALSE_REJECTIONS / of.misfits.len().max(1) as f64);
    for (share, misfit) in of.shares.iter().zip(of.misfits) {
        if misfit.tested && misfit.z > limit {
            sentences.push(format!(
                "in test \"{}\" omega is {:.0}, {:+.1} % from what is expected (z = {:.1}, rejected above {limit:.1})",
                share.name,
                misfit.omega,
                100.0 * misfit.excess,
                misfit.z
            ));
        }
    }
    if let Some(consistency) = of.consistency.filter(|consistency| consistency.contradicted()) {
        sentences.push(format!(
            "the tests contradict each other: with parameters of its own in each omega would fall by {:.0}, {:.0} expected (z = {:.1}, \
             rejected above {:.1}){}",
            consistency.gain,
            consistency.expected,
            consistency.z,
            consistency.limit,
            worst_moves(of, consistency)
        ));
    }
    sentences
}

/// Which test wants which parameter elsewhere, the strongest wish of each test.
fn worst_moves(of: &OfTests<'_>, consistency: &Consistency) -> String {
    let of_test = |(share, moves): (&TestShare, &Vec<Option<f64>>)| {
        let told = moves.iter().enumerate().filter_map(|(k, by)| Some((k, (*by)?)));
        let (k, by) = told.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;
        let name = of.parameters.get(k)?.parameter.name;
        let side = if by > 0.0 { "higher" } else { "lower" };
        Some(format!("\"{}\" asks for {name} {side}, by {:.1} of its standard uncertainties", share.name, by.abs()))
    };
    let said: Vec<String> = of.shares.iter().zip(&consistency.moves).filter_map(of_test).collect();
    if said.is_empty() { String::new() } else { format!("; {}", said.join(", ")) }
}

fn who_determines(of: &OfTests<'_>) -> Vec<String> {
    if of.shares.len() < 2 || of.shares.iter().any(|share| share.std_alone.len() != of.parameters.len()) {
        return Vec::new();
    }
    let mut sentences = Vec::new();
    for (k, p) in of.parameters.iter().enumerate() {
        let Some(std) = p.std_noise else { continue };
        let percent = |std: f64| relative(std, p.value);
        let alone = |share: &TestShare| match share.std_alone[k] {
            Some(std) => format!("\"{}\" alone {}", share.name, percent(std)),
            None => format!("\"{}\" alone says nothing of it", share.name),
        };
        let told = of.shares.iter().filter_map(|share| Some((share, share.std_alone[k]?)));
        let best = told.min_by(|a, b| a.1.total_cmp(&b.1));
        let name = p.parameter.name;
        sentences.push(match best {
            Some((share, least)) if least <= TOGETHER * std => {
                let others = of.shares.iter().filter(|other| other.name != share.name).map(alone).collect::<Vec<_>>();
                format!(
                    "{name} comes from \"{}\": the noise leaves it {} there and {} with all ({})",
                    share.name,
                    percent(least),
                    percent(std),
                    others.join(", ")
                )
            }
            _ => format!(
                "{name} needs the tests together: the noise leaves it {} ({})",
                percent(std),
                of.shares.iter().map(alone).collect::<Vec<_>>().join(", ")
            ),
        });
    }
    sentences
}

fn nothing_new(of: &OfTests<'_>) -> Vec<String> {
    let said = |share: &TestShare| {
        format!("test \"{}\" adds nothing: without it every standard uncertainty is the same to 1 %", share.name)
    };
    of.shares.iter().filter(|share| share.adds_nothing).map(said).collect()
}

/// A standard uncertainty by its value, in words.
fn relative(std: f64, value: f64) -> String {
    let percent = 100.0 * std / value.abs();
    match percent {
        p if !p.is_finite() => "without limit".to_owned(),
        p if p < 10.0 => format!("{p:.2} %"),
        p if p < 1000.0 => format!("{p:.0} %"),
        _ => "beyond 1000 %".to_owned(),
    }
}
