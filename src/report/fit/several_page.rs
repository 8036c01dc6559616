//! The page of a fit of several tests: what was found, what each test tells of it, how far they agree.

use super::json::{FitRecord, MisfitRecord, TestRecord};
use super::{FitReport, budget_lines, defaults_used};
use crate::report::law_plot::law_plot;
use crate::report::page::{Block, Page, Section};
use crate::report::words::{capital, significant};
use crate::report::{Axis, Name, Plot, PlotSeries, ReportError, Style, to_strings};

/// The page of `record`, made from the `reports` of its tests.
///
/// # Errors
/// A curve without a finite range.
pub fn several_page(record: &FitRecord, reports: &[FitReport<'_>]) -> Result<Page, ReportError> {
    let n = record.tests.len();
    Ok(Page {
        title: format!("One law from {n} test{}", if n == 1 { "" } else { "s" }),
        subtitle: format!("quadrille {}, {}", record.quadrille, record.case),
        sections: vec![result(record), tests(record)?, law(reports)?, remarks(record)],
    })
}

/// A standard uncertainty by its value.
fn percent(std: Option<f64>, value: f64) -> String {
    match std.map(|std| 100.0 * std / value.abs()) {
        Some(percent) if percent > 1000.0 => "beyond 1000 %".to_owned(),
        Some(percent) => format!("{} %", significant(percent, 3)),
        None => "nothing".to_owned(),
    }
}

fn result(record: &FitRecord) -> Section {
    let mut blocks = Vec::new();
    if record.status != "converged" {
        blocks.push(Block::warning(format!("The fit did not converge ({}): {}.", record.status, record.reason)));
    }
    if let Some((first, rest)) = record.verdict.sentences.split_first() {
        let text = format!("Verdict: {}. {}.", record.verdict.outcome, capital(first));
        blocks.push(Block::Lead { text, warning: !record.verdict.determined });
        blocks.extend(rest.iter().map(|line| Block::sentence(line)));
    }
    let rows = record.parameter_order.iter().filter_map(|name| {
        let p = record.parameters.get(name)?;
        let end = |end: Option<f64>| end.map_or("-".to_owned(), |end| significant(end, 5));
        Some(vec![
            name.to_string(),
            format!("{} {}", significant(p.value, 5), unit(&p.unit)),
            percent(p.std, p.value),
            percent(p.std_noise, p.value),
            format!("{} to {}", end(p.ends95[0]), end(p.ends95[1])),
        ])
    });
    let columns = ["parameter", "value", "standard uncertainty", "of the noise alone", "95 % interval"];
    blocks.push(Block::table(&columns, rows));
    let parts = budget_lines(record);
    if !parts.is_empty() {
        blocks.push(Block::Text(format!("Largest standard uncertainties: {}.", parts.join("; "))));
    }
    blocks.extend(defaults_used(record).iter().map(|line| Block::sentence(line)));
    Section { title: "Result".into(), blocks }
}

fn unit(unit: &str) -> &str {
    if unit == "1" { "" } else { unit }
}

/// What each test determines.
fn tests(record: &FitRecord) -> Result<Section, ReportError> {
    let mut blocks = vec![Block::text(
        "Standard uncertainty of each parameter by the noise: of each test if it were alone, from its own information at the \
         parameters found, of the others without it, and of all together.",
    )];
    let mut heads = to_strings(&["test"]);
    heads.extend(record.parameter_order.iter().map(ToString::to_string));
    let row = |name: String, std: &dyn Fn(&Name) -> Option<f64>| {
        let cell = |p: &Name| percent(std(p), record.parameters.get(p).map_or(f64::NAN, |p| p.value));
        std::iter::once(name).chain(record.parameter_order.iter().map(cell)).collect::<Vec<_>>()
    };
    let alone = |test: &TestRecord| {
        row(format!("{} alone", test.name), &|p| test.parameters.get(p).and_then(|told| told.std_alone))
    };
    let mut rows: Vec<Vec<String>> = record.tests.iter().map(alone).collect();
    if record.tests.len() > 2 {
        rows.extend(record.tests.iter().map(|test| {
            row(format!("without {}", test.name), &|p| test.parameters.get(p).and_then(|told| told.std_without))
        }));
    }
    rows.push(row("all together".into(), &|p| record.parameters.get(p).and_then(|p| p.std_noise)));
    blocks.push(Block::Table { columns: heads, rows });
    blocks.push(Block::Heading("Does the model follow each test?".into()));
    let rows = record.tests.iter().map(|test| {
        let misfit = test.misfit.as_ref();
        vec![
            test.name.clone(),
            test.measurement.about.clone(),
            test.opening_share.map_or("-".into(), |share| format!("{:.0} %", 100.0 * share)),
            format!("{:.0}", test.omega),
            misfit.map_or("-".into(), |misfit| format!("{:+.1} %", 100.0 * misfit.excess)),
            misfit.filter(|misfit| misfit.tested).map_or("not tested".into(), |misfit| format!("{:+.1}", misfit.z)),
        ]
    });
    let columns = ["test", "compared", "opening in its work", "omega", "above what is expected", "z"];
    blocks.push(Block::table(&columns, rows));
    let mut curves = Vec::new();
    for test in &record.tests {
        let Some(misfit) = test.misfit.as_ref().filter(|misfit| !misfit.by_instant.is_empty()) else { continue };
        let plot = misfit_plot(format!("{}: measured less computed, over what is expected", test.name), misfit);
        let caption = "The residual of every instant over its expectation: 1 is what noise and element size leave";
        curves.push(Block::curves(&plot, caption)?);
    }
    blocks.push(Block::Grid(curves));
    blocks.push(Block::Text(match &record.consistency {
        Some(c) => format!(
            "With parameters of its own in each test omega would fall by {:.1}, {:.1} expected of noise, constants and element size (z = \
             {:.1}, contradiction above {:.1}).",
            c.omega_falls_by, c.expected, c.z, c.z_limit
        ),
        None => "Whether the tests agree on the parameters is not tested: the noise of one is not known beside its residual, or no \
                 two tests tell the same."
            .into(),
    }));
    Ok(Section { title: "What each test determines".into(), blocks })
}

/// The residual of every instant over its expectation.
pub(in crate::report) fn misfit_plot(title: impl Into<String>, misfit: &MisfitRecord) -> Plot {
    let (place, ratio): (Vec<f64>, Vec<f64>) =
        misfit.by_instant.iter().map(|group| (group.instants[0] as f64, group.times_expected)).unzip();
    let highest = 1.3 * ratio.iter().fold(1.0, |most: f64, v| most.max(*v));
    let y = Axis::linear("root mean square (times expected)").with_range(0.0, highest);
    Plot::new(title, "instant", y, [PlotSeries::new("", Style::LineAndMarkers, place, ratio)])
}

/// The law with its band, in both modes.
fn law(reports: &[FitReport<'_>]) -> Result<Section, ReportError> {
    let curves = reports.iter().take(1).flat_map(|report| report.curves.iter().enumerate());
    let caption = "The law that is fitted to all tests, with its 95 % band";
    let blocks = curves.map(|(mode, curve)| Block::curves(&law_plot(mode, curve), caption));
    Ok(Section { title: "The law".into(), blocks: vec![Block::Grid(blocks.collect::<Result<_, _>>()?)] })
}

fn remarks(record: &FitRecord) -> Section {
    let mut blocks: Vec<Block> = record.remarks.iter().map(Block::of_remark).collect();
    blocks.push(Block::Text(format!("Given: {}.", record.verdict.given.join(", "))));
    Section { title: "Remarks".into(), blocks }
}
