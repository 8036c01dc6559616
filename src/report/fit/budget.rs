//! The error budget in words and as a table.

use super::tables::column_of;
use super::{BudgetRecord, FitRecord, FitReport};
use crate::report::{Name, to_strings, version};
use std::io::{self, Write};

/// So many of its largest parts are named for each parameter.
const NAMED: usize = 3;

/// The largest parts of the uncertainty of each parameter, % of its value: `phi_n: E 2.6 %, pixel_size 0.5 %`.
pub fn budget_lines(fit: &FitRecord) -> Vec<String> {
    let largest_of = |name: &Name| {
        let value = fit.parameters.get(name)?.value.abs();
        let effect = |line: &BudgetRecord| Some((line.name.clone(), line.parameters.get(name)?.abs()));
        let mut parts: Vec<(String, f64)> = fit.budget.iter().filter(|line| line.included).filter_map(effect).collect();
        parts.retain(|(_, effect)| *effect > 0.0);
        parts.sort_by(|a, b| b.1.total_cmp(&a.1));
        let percent = |(part, effect): &(String, f64)| format!("{part} {:.2} %", 100.0 * effect / value);
        let named: Vec<String> = parts.iter().take(NAMED).map(percent).collect();
        (!named.is_empty()).then(|| format!("{name}: {}", named.join(", ")))
    };
    fit.parameter_order.iter().filter_map(largest_of).collect()
}

/// With three digits behind the point at most.
fn short(value: f64) -> String {
    format!("{value:.3}").trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// The defaults for constants without a stated uncertainty, and what there is no default for, a sentence each.
pub fn defaults_used(fit: &FitRecord) -> Vec<String> {
    let uncertainty = |line: &BudgetRecord| match (line.std, line.value) {
        (Some(std), Some(value)) if line.name == "nu" || line.name.starts_with("nu_") || value == 0.0 => {
            format!("{} +- {std}", line.name)
        }
        (Some(std), Some(value)) => format!("{} {} %", line.name, short(100.0 * std / value.abs())),
        (Some(std), None) if line.unit == "1" => format!("{} {} %", line.name, short(100.0 * std)),
        (Some(std), None) => format!("{} {std:.3e} {}", line.name, line.unit),
        (None, _) => line.name.clone(),
    };
    let list = |source: &str| {
        fit.budget.iter().filter(|line| line.source == source).map(uncertainty).collect::<Vec<_>>().join(", ")
    };
    let (defaults, unknown) = (list("default"), list("not stated"));
    let mut said = Vec::new();
    if !defaults.is_empty() {
        said.push(format!(
            "standard uncertainties that the case does not state, by default: {defaults}; state them, or exact = true where there \
             is none"
        ));
    }
    if !unknown.is_empty() {
        said.push(format!(
            "not stated, and without a scale of the images not part of the intervals: the uncertainty of {unknown}"
        ));
    }
    said
}

impl FitReport<'_> {
    /// Writes `budget.csv`: of each line what one standard uncertainty does to each parameter and derived quantity, in
    /// its unit; NaN where there is nothing.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_budget<W: Write>(&self, mut out: W) -> io::Result<()> {
        let fit = self.fit;
        let about = "error budget: effect of each standard uncertainty; lines that are included add up as squares";
        writeln!(out, "# {}\n# {about}", version())?;
        let mut columns = to_strings(&["line", "source", "included", "value", "std", "unit"]);
        columns.extend(fit.parameters.iter().map(|p| p.parameter.key()));
        columns.extend(fit.derived.iter().map(|q| column_of(&q.quantity)));
        let mut out = csv::Writer::from_writer(out);
        out.write_record(&columns)?;
        let number = |value: Option<f64>| value.map_or("NaN".to_owned(), |value| format!("{value:e}"));
        for line in &fit.budget.lines {
            let mut row = vec![line.name.clone(), line.source.name().to_owned(), u8::from(line.included).to_string()];
            row.extend([number(line.value), number(line.std), line.unit.to_owned()]);
            row.extend((0..fit.parameters.len()).map(|k| number(line.parameters.get(k).copied())));
            row.extend((0..fit.derived.len()).map(|q| number(line.derived.get(q).copied())));
            out.write_record(&row)?;
        }
        out.flush()
    }
}
