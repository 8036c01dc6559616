//! What came of a fit or of a computed joint, in a few lines on stderr.

use crate::cli::plural;
use crate::cli::talk::{Paint, wrapped};
use crate::remark::Remark;
use crate::report::fit::{FitRecord, budget_lines, defaults_used};
use crate::report::joint::JointSummary;
use crate::report::tournament::TournamentRecord;
use crate::report::{ForceRecord, Name};
use std::path::Path;

/// What a user has to know at once beside the warnings.
pub(crate) fn of_fit(json: &FitRecord, output: &Path, paint: Paint) {
    for name in &json.parameter_order {
        let p = &json.parameters[name];
        let spread = match p.ends95 {
            [Some(low), Some(high)] => format!(", 95 % {low:.6} to {high:.6}"),
            [Some(low), None] => format!(", 95 % from {low:.6}, no upper end"),
            [None, Some(high)] => format!(", 95 % up to {high:.6}, no lower end"),
            [None, None] if p.std.is_some() => ", 95 % interval without ends".to_owned(),
            [None, None] => String::new(),
        };
        let conditional = json.verdict.conditional && p.std.is_some();
        let conditional = if conditional { " if the model were true" } else { "" };
        let bound = if p.at_bound { ", on its bound" } else { "" };
        eprintln!("{name} = {:.6} {}{spread}{conditional}{bound}", p.value, p.unit);
    }
    of_tests(json);
    json.force.iter().chain(json.tests.iter().filter_map(|test| test.force.as_ref())).for_each(of_force);
    let parts = budget_lines(json);
    if !parts.is_empty() {
        eprintln!("largest standard uncertainties: {}", parts.join("; "));
    }
    defaults_used(json).iter().for_each(|line| eprintln!("{line}"));
    let verdict = &json.verdict;
    let outcome = match (verdict.determined, verdict.conditional) {
        (true, _) => paint.good(&verdict.outcome),
        (_, true) => paint.bad(&verdict.outcome),
        _ => paint.doubtful(&verdict.outcome),
    };
    eprintln!("verdict: {outcome}. {}", verdict.text);
    let evaluations = plural(json.evaluations, "evaluation");
    let rescued = if json.rescued > 0 { format!(", {} rescued", json.rescued) } else { String::new() };
    eprintln!(
        "{}: {}; omega = {:.6e}, {evaluations}{rescued}, {:.3} s, results in {}",
        if json.status == "converged" { paint.good(&json.status) } else { paint.bad(&json.status) },
        json.reason,
        json.omega,
        json.seconds,
        output.display()
    );
}

/// The load cell beside the prediction.
fn of_force(force: &ForceRecord) {
    let used = if force.used { "" } else { " (not part of a fit)" };
    eprintln!("{}", wrapped(&format!("{}{used}", force.text), 2));
}

/// Of several tests: what each tells of each parameter, and how well the model follows it.
fn of_tests(json: &FitRecord) {
    if json.tests.is_empty() {
        return;
    }
    let width = json.tests.iter().map(|test| test.name.chars().count()).max().unwrap_or(0).max(8);
    let percent = |name: &str, std: Option<f64>| match (std, json.parameters.get(name)) {
        (Some(std), Some(p)) if 100.0 * std < 1e3 * p.value.abs() => format!("{:.3} %", 100.0 * std / p.value.abs()),
        (Some(_), Some(_)) => "> 1000 %".to_owned(),
        _ => "nothing".to_owned(),
    };
    let row = |cell: &dyn Fn(&Name) -> String| -> String {
        json.parameter_order.iter().map(|name| format!("{:>11}", cell(name))).collect()
    };
    eprintln!("standard uncertainty by the noise, of each test alone and of all together:");
    eprintln!("{:width$}{}  misfit z", "", row(&|name| name.to_string()));
    for test in &json.tests {
        let cells = row(&|name| percent(name, test.parameters.get(name).and_then(|told| told.std_alone)));
        let z = test.misfit.as_ref().filter(|misfit| misfit.tested);
        let z = z.map_or("-".to_owned(), |misfit| format!("{:+.1}", misfit.z));
        eprintln!("{:width$}{cells}  {z}", test.name);
    }
    let cells = row(&|name| percent(name, json.parameters.get(name).and_then(|p| p.std_noise)));
    eprintln!("{:width$}{cells}", "together");
}

pub(crate) fn of_joint(summary: &JointSummary, output: &Path) {
    summary.remarks.iter().for_each(|remark| eprintln!("{}", Paint::PLAIN.remark(remark)));
    // Those of the instants grow with the test: the last says it all, summary.json has each.
    if let Some(worst) = summary.instants.iter().rfind(|instant| !instant.remarks.is_empty()) {
        let named = |remark: &Remark| remark.clone().after(&format!("instant {}: ", worst.instant));
        worst.remarks.iter().for_each(|remark| eprintln!("{}", Paint::PLAIN.remark(&named(remark))));
    }
    // Of the instants without a solution the first says why.
    if let Some(message) = summary.instants.iter().find_map(|instant| instant.message.as_ref()) {
        eprintln!("{message}");
    }
    summary.force.iter().for_each(of_force);
    if let Some(balance) = &summary.energy_balance {
        eprintln!("{}", balance.text());
    }
    let n = summary.instants.iter().filter(|instant| instant.message.is_none()).count();
    let total = plural(summary.instants.len(), "instant");
    eprintln!("{n} of {total} converged in {:.3} s, results in {}", summary.seconds, output.display());
}

pub(crate) fn of_laws(tournament: &TournamentRecord, folder: &Path) {
    let digits = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.1}"));
    let columns = ["law", "omega", "p", "AIC", "left out", "z", "weight"];
    let row = |[law, omega, p, aic, left_out, z, weight]: [&str; 7]| {
        eprintln!("{law:<29} {omega:>8} {p:>2} {aic:>8} {left_out:>8} {z:>6} {weight:>8}");
    };
    row(columns);
    for law in &tournament.laws {
        let weight = if law.rejected { "rejected".to_owned() } else { format!("{:.3}", law.weight) };
        let [omega, aic, left_out, z] = [law.omega, law.aic, law.left_out_omega, law.z].map(digits);
        row([&law.law, &omega, &law.parameters.len().to_string(), &aic, &left_out, &z, &weight]);
    }
    tournament.sentences.iter().for_each(|sentence| eprintln!("{}", wrapped(sentence, 2)));
    eprintln!("compared in {:.3} s, results in {}", tournament.seconds, folder.display());
}
