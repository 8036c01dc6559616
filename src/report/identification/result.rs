//! What was found, and how far it can be trusted.

use super::IdentificationReport;
use crate::identify::NORMAL_95;
use crate::report::fit::{
    BudgetRecord, FitRecord, GroupRecord, MisfitRecord, ParameterRecord, QuantityRecord, misfit_plot,
};
use crate::report::page::{Block, Part, Section};
use crate::report::words::{capital, plain, plain_or_dash, significant};
use crate::report::{Name, ReportError};

impl IdentificationReport<'_> {
    /// The verdict and the values.
    pub(super) fn result(&self, fit: &FitRecord) -> Section {
        let (status, reason) = (&fit.status, &fit.reason);
        let converged = status == "converged";
        let text = match converged {
            true => format!("The fit converged: {reason}"),
            false => format!(
                "The fit did not converge ({status}): {reason}. The values below are the best point that was reached."
            ),
        };
        let mut blocks = vec![Block::Lead { text, warning: !converged }];
        let verdict = &fit.verdict;
        if let Some((first, rest)) = verdict.sentences.split_first() {
            let text = format!("Verdict: {}. {}", verdict.outcome, capital(first));
            blocks.push(Block::Lead { text, warning: !verdict.determined });
            blocks.extend(rest.iter().map(|line| Block::sentence(line)));
        }
        blocks.extend(self.warnings());
        blocks.push(self.parameters(fit));
        blocks.extend(about_intervals(fit));
        Section { title: "Result".into(), blocks }
    }

    /// What the values rest on.
    pub(super) fn trust(&self, fit: &FitRecord) -> Result<Section, ReportError> {
        let mut blocks = self.budget(fit);
        let names = self.fitted_names();
        let fixed: Vec<String> = (self.law.parameters().iter().zip(self.law.values()))
            .filter(|(p, _)| !names.iter().any(|name| name == p.name))
            .map(|(p, value)| {
                let unit = if p.unit == "1" { String::new() } else { format!(" {}", p.unit) };
                format!("{} = {}{unit}", p.name, plain(value))
            })
            .collect();
        if !fixed.is_empty() {
            blocks.push(Block::Text(format!("Prescribed: {}. Law: {}.", fixed.join(", "), self.law.name())));
        }
        let furthest = fit.furthest_mm.map(|mm| {
            let [opening, sliding] = mm.map(|mm| significant(mm, 3));
            ("work_reached is up to (mm)".to_owned(), format!("opening {opening}, sliding {sliding}"))
        });
        let derived = fit.derived.iter().map(|(name, entry)| (name.to_string(), quantity(entry)));
        let derived: Vec<(String, String)> = derived.chain(furthest).collect();
        if !derived.is_empty() {
            blocks.push(Block::Heading("What follows from them".into()));
            blocks.push(Block::Facts(derived));
        }
        if let Some(record) = &fit.misfit {
            blocks.extend(misfit(record)?);
        }
        if let Some(force) = &fit.force {
            blocks.push(Block::Heading("The load cell".into()));
            blocks.push(Block::sentence(&force.text));
            let caption = if force.used { "It took part in the fit" } else { "It took no part in the fit" };
            let plots = force.plots().into_iter().map(|plot| Block::curves(&plot, caption));
            blocks.push(Block::Grid(plots.collect::<Result<_, _>>()?));
        }
        if let Some(matrix) = &fit.correlation {
            blocks.push(Block::Heading("Correlation of the parameters".into()));
            let rows = matrix.iter().map(|row| row.iter().map(|v| format!("{v:+.3}")).collect()).collect();
            blocks.push(Block::Matrix { names: names.iter().map(ToString::to_string).collect(), rows });
        }
        blocks.push(Block::Facts(numbers_of_the_fit(fit)));
        Ok(Section { title: "How far the result can be trusted".into(), blocks })
    }

    /// The parameters with their uncertainty, a row each.
    fn parameters(&self, fit: &FitRecord) -> Block {
        let interval = match fit.verdict.conditional {
            true => "95 % interval, if the model were true",
            false => "95 % interval",
        };
        let mut columns = vec!["parameter", "value", "standard uncertainty", "with half the element size", interval];
        columns.extend(["bias of the noise", "start", "on a bound"].into_iter().chain(self.truth.map(|_| "truth")));
        let row = |name: &Name| Some(self.row(name, fit.parameters.get(name)?));
        Block::table(&columns, self.fitted_names().iter().filter_map(row))
    }

    fn row(&self, name: &str, entry: &ParameterRecord) -> Vec<String> {
        let (scale, unit) = self.shown(name);
        let value = scale * entry.value;
        let std = entry.std.map(|std| scale * std);
        let percent = |part: Option<f64>| {
            part.map_or("-".to_owned(), |part| format!("{:+.2} %", 100.0 * scale * part / value.abs()))
        };
        let ends = entry.ends95.map(|end| end.map(|end| significant(scale * end, 5)));
        let mut row = vec![
            self.label(name),
            format!("{} {unit}", significant(value, 5)),
            std.map_or("-".into(), |std| {
                format!("{} {unit} ({} %)", significant(std, 2), significant(100.0 * std / value.abs(), 2))
            }),
            percent(entry.discretisation),
            match (ends, std) {
                ([Some(low), Some(high)], _) => format!("{low} to {high} {unit}"),
                ([Some(low), None], _) => format!("from {low} {unit}, no upper end"),
                ([None, Some(high)], _) => format!("up to {high} {unit}, no lower end"),
                ([None, None], Some(_)) => "without ends".into(),
                ([None, None], None) => "-".into(),
            },
            percent(entry.bias),
            format!("{} {unit}", significant(scale * entry.start, 4)),
            if entry.at_bound { "yes" } else { "no" }.to_owned(),
        ];
        if let Some(truth) = self.truth {
            row.push(match truth.get(name) {
                Some(truth) => format!(
                    "{} {unit} ({:+.2} %)",
                    significant(scale * truth, 4),
                    100.0 * (value / (scale * truth) - 1.0)
                ),
                None => "-".into(),
            });
        }
        row
    }

    /// Where the uncertainty of each parameter comes from, as bars, and what the case left to defaults.
    fn budget(&self, fit: &FitRecord) -> Vec<Block> {
        let lines = &fit.budget;
        if lines.is_empty() {
            return Vec::new();
        }
        let mut blocks = vec![
            Block::Heading("Where the uncertainty comes from".into()),
            Block::Text(format!(
                "Change of the parameter for one standard uncertainty of each source, in per cent of its value; the interval is \
                 {NORMAL_95:.2} times the root of the sum of their squares. Grey: stated, and not part of the interval."
            )),
        ];
        for name in self.fitted_names() {
            let value = fit.parameters.get(name).map_or(f64::NAN, |p| p.value.abs());
            let effect = |line: &BudgetRecord| line.parameters.get(name).map(|effect| effect.abs() / value);
            let effects = lines.iter().filter_map(|line| Some((line, effect(line)?)));
            let mut parts: Vec<(&BudgetRecord, f64)> = effects.filter(|(_, effect)| *effect > 0.0).collect();
            parts.sort_by(|a, b| b.1.total_cmp(&a.1));
            let most = parts.first().map_or(1.0, |(_, effect)| *effect);
            let total: f64 = parts.iter().filter(|(line, _)| line.included).map(|(_, e)| e * e).sum();
            // What is below a hundredth of the largest is in the table.
            parts.retain(|(_, effect)| *effect >= 0.01 * most);
            let bar = |(line, effect): &(&BudgetRecord, f64)| Part {
                name: line.name.replace('_', " "),
                length: effect / most,
                text: format!("{} %", significant(100.0 * effect, 2)),
                apart: !line.included,
            };
            blocks.push(Block::Text(format!("{name}: in all {} %", significant(100.0 * total.sqrt(), 2))));
            blocks.push(Block::Parts(parts.iter().map(bar).collect()));
        }
        let rows = lines.iter().map(|line| {
            let unit = if line.unit == "1" { "" } else { &*line.unit };
            let with_unit = |value: Option<f64>| {
                value.map_or("-".to_owned(), |value| format!("{} {unit}", significant(value, 4)).trim_end().to_owned())
            };
            vec![line.name.replace('_', " "), with_unit(line.value), with_unit(line.std), line.source.to_string()]
        });
        blocks.push(Block::table(&["source of uncertainty", "value", "standard uncertainty", "where from"], rows));
        blocks.push(Block::text(
            "\"default\": the case states nothing; \"exact\": the case says that there is none; \"not stated\": nothing is known, and \
             it is not part of the intervals. Not in any interval: another law, another model of the strips, \
             a measurement that is wrong by more than its noise.",
        ));
        blocks
    }
}

/// What the intervals hold and what they rest on.
fn about_intervals(fit: &FitRecord) -> Vec<Block> {
    let mut blocks = vec![Block::text(match &*fit.discretisation {
        "included" => {
            "The standard uncertainty is that of noise and constants. The 95 % interval also holds, as one more standard uncertainty, the \
             change that elements of half the size would make."
        }
        _ => {
            "Standard uncertainty and 95 % interval are those of noise and uncertain constants; what elements of half the size would \
             change is not part of them."
        }
    })];
    match &fit.intervals {
        Some(intervals) if intervals.kind == "profile" => blocks.push(Block::Text(format!(
            "The intervals are those of the profile likelihood, because linear theory is in doubt; they need not be symmetric. Where \
             refits of data simulated from the fitted model ({} of them, {} failed) are shifted on average, the interval is \
             extended to hold the shift; the value is as fitted.",
            intervals.draws, intervals.failed
        ))),
        _ if fit.parameters.values().any(|p| p.bias.is_some()) => blocks.push(Block::text(
            "The bias of the noise is what a pair of opposite draws of it shifts each parameter by, through kinks and plasticity; \
             the interval is extended to hold it, the value is as fitted.",
        )),
        _ => {}
    }
    blocks
}

/// Objective, evaluations, condition.
fn numbers_of_the_fit(fit: &FitRecord) -> Vec<(String, String)> {
    let mut facts = vec![("omega (sum of weighted squares)".to_owned(), plain(fit.omega))];
    if fit.omega_expected.is_some() {
        facts.push(("omega expected of the noise".into(), plain_or_dash(fit.omega_expected)));
    }
    facts.push(("evaluations of the model".into(), fit.evaluations.to_string()));
    facts.push(("evaluations with a snap that was crossed".into(), fit.rescued.to_string()));
    if fit.condition.is_some() {
        facts.push(("condition of the scaled problem".into(), plain_or_dash(fit.condition)));
    }
    if !fit.singular_values.is_empty() {
        let list: Vec<String> = fit.singular_values.iter().map(|v| significant(*v, 4)).collect();
        facts.push(("singular values of the scaled Jacobian".into(), list.join(", ")));
    }
    facts
}

/// The misfit test: is what the model leaves of the measurement what the noise leaves?
fn misfit(record: &MisfitRecord) -> Result<Vec<Block>, ReportError> {
    if record.by_instant.is_empty() {
        return Ok(Vec::new());
    }
    let mut blocks = vec![Block::Heading("Does the model follow the measurement?".into())];
    blocks.push(Block::Text(match record.tested {
        true => format!(
            "Omega of the whitened residual is {:.0}; noise leaves {:.0} of it on average, the element size adds {}, the constants \
             {:.0}: {:+.1} %, {:.1} standard deviations (rejected above {:.1}). The level of the noise counts as known to 2 %.",
            record.omega,
            record.freedom,
            record.floor.map_or("an unknown part".into(), |floor| format!("{floor:.0}")),
            record.constants,
            100.0 * record.excess,
            record.z,
            record.z_limit
        ),
        false => "The noise was estimated from this residual, so that the objective as a whole tests nothing; instants and \
                  regions can still be compared with each other."
            .into(),
    }));
    if !record.worst.is_empty() {
        blocks.push(Block::Text(format!("Worst: {}.", record.worst.join("; "))));
    }
    let plot = misfit_plot("Measured less computed, over what noise and element size leave", record);
    let caption =
        "The residual of every instant over its expectation: 1 is what the noise leaves, above it the model fails";
    blocks.push(Block::Grid(vec![Block::curves(&plot, caption)?]));
    let row = |group: &GroupRecord| {
        vec![group.name.clone(), format!("{:.2}", group.times_expected), format!("{:+.1}", group.z)]
    };
    let rows = record.by_region.iter().map(row);
    blocks.push(Block::table(&["region", "times expected", "standard deviations"], rows));
    Ok(blocks)
}

/// A quantity with its uncertainty and unit.
fn quantity(entry: &QuantityRecord) -> String {
    match entry.std {
        Some(std) => format!("{} \u{b1} {} {}", significant(entry.value, 4), significant(std, 2), entry.unit),
        None => format!("{} {}", significant(entry.value, 4), entry.unit),
    }
}
