//! `quadrille identify`, of one law or at values of a parameter (`--sweep`): the parameters of the adhesive from
//! measured displacements.

use crate::cli::args::{IdentifyArgs, Prescribed};
use crate::cli::identify::case::or_stopped;
use crate::cli::identify::tournament;
use crate::cli::talk::{Paint, Progress, Talk, WARNING, wrapped};
use crate::cli::{Outcome, Result, absolute, plural, signals};
use crate::identify::{Case, Ended, FitStatus, FitWatch, SweepRow, sweep};
use crate::io::joint::{IdentifyInput, read_identify, read_joint};
use crate::report::fit::{SweepRecord, write_sweep};
use crate::report::{Axis, Plot, PlotSeries, Style};
use crate::run::{Event, RunFolder, identify, identify_several};
use std::time::Instant;

/// Values that are named one by one where some were not fitted; `sweep.json` has them all.
const MOST_NAMED: usize = 10;

pub(crate) fn run(args: &IdentifyArgs, paint: Paint) -> Result<Outcome> {
    args.drawn.choose();
    match (&args.sweep, &args.tournament) {
        (Some(asked), _) => return run_sweep(args, asked.as_ref()),
        (None, Some(laws)) => return tournament::run(args, laws, paint),
        (None, None) => {}
    }
    let mut input = read_identify(&args.case)?;
    match &mut input {
        IdentifyInput::One(input) => input.case.fit.iter_mut().for_each(|fit| args.limits.over(fit)),
        IdentifyInput::Several(input) => {
            args.limits.over(&mut input.fit);
            input.tests.iter_mut().flat_map(|test| &mut test.input.case.fit).for_each(|fit| args.limits.over(fit));
        }
    }
    let mut progress = Progress::new(Talk::of(args.progress, args.talk.quiet), paint);
    let (output, pool, stop) = (&args.results.output, args.threads.pool()?, signals::listen()?);
    let mut watcher = |event: Event<'_>| progress.take(event);
    let overwrite = args.results.overwrite;
    let ran = match &input {
        IdentifyInput::One(input) => identify(input, &args.case, output, overwrite, &pool, &stop, &mut watcher),
        IdentifyInput::Several(input) => {
            identify_several(input, &args.case, output, overwrite, &pool, &stop, &mut watcher)
        }
    };
    or_stopped(ran.map(|(_, outcome)| outcome), &stop)
}

fn run_sweep(args: &IdentifyArgs, asked: Option<&Prescribed>) -> Result<Outcome> {
    let mut input = read_joint(&args.case)?;
    if let Some(fit) = &mut input.case.fit {
        args.limits.over(fit);
    }
    let pool = args.threads.pool()?;
    let joint = Case::joint(&input)?;
    let mut case = Case::new(&joint, &input, &args.case)?;
    let (index, values) = find_prescribed(asked, &case)?;
    let folder = RunFolder::for_joint(&args.results.output, args.results.overwrite, false)?;
    let begin = Instant::now();
    let stop = signals::listen()?;
    // One limit for all fits together.
    let watch = FitWatch::new(case.max_seconds, Some(stop.flag()), |_| ());
    case.problem.watch = watch.clone();
    let rows = pool.install(|| sweep(&case.problem, &case.options, index, &values))?;
    let seconds = begin.elapsed().as_secs_f64();
    let ended = match rows.iter().find_map(|row| row.fit.cut_short.as_ref()) {
        Some(cut) => Some(cut.ended),
        None if rows.len() < values.len() => watch.ended(),
        None => None,
    };
    if let (true, Some(ended)) = (rows.is_empty(), ended) {
        let error = format!("{} before any of the {} fits had a point: nothing is kept", ended.reason(), values.len());
        return match ended {
            Ended::Time(_) => Err(error.into()),
            Ended::Stopped => {
                eprintln!("quadrille: {error}");
                Ok(Outcome::Stopped)
            }
        };
    }
    let missing: Vec<f64> =
        values.iter().copied().filter(|value| !rows.iter().any(|row| row.value == *value)).collect();
    let name = case.problem.unknowns.law().parameters()[index].name;
    let json: Vec<SweepRecord> = rows.iter().map(SweepRecord::of).collect();
    folder.write_json(
        "sweep.json",
        &serde_json::json!({
            "quadrille": env!("CARGO_PKG_VERSION"),
            "case": absolute(&args.case),
            "parameter": name,
            "seconds": seconds,
            "ended": ended.map(Ended::reason),
            "not_fitted": missing,
            "about": case.about,
            "rows": json,
        }),
    )?;
    folder.write("sweep.csv", |out| write_sweep(out, name, &rows))?;
    draw_sweep(&folder, name, &rows)?;
    if !args.talk.quiet {
        joint.remarks.iter().chain(&case.remarks).for_each(|remark| eprintln!("{}", Paint::PLAIN.remark(remark)));
        tell(name, &rows, &missing, ended);
        let converged = rows.iter().filter(|row| row.fit.status == FitStatus::Converged).count();
        let total = plural(values.len(), "fit");
        eprintln!("{converged} of {total} converged in {seconds:.3} s, results in {}", args.results.output.display());
    }
    let whole = rows.iter().all(|row| row.fit.status == FitStatus::Converged) && ended.is_none();
    Ok(match ended {
        Some(Ended::Stopped) => Outcome::Stopped,
        _ if whole => Outcome::Fine,
        _ => Outcome::Incomplete,
    })
}

/// The parameter that is prescribed, by its number, and its values: as given, else those of the case.
fn find_prescribed(asked: Option<&Prescribed>, case: &Case<'_>) -> Result<(usize, Vec<f64>)> {
    let Some(Prescribed { name, values }) = asked else {
        let of_case = case.sweep.clone();
        return of_case
            .ok_or_else(|| "nothing to sweep: give --sweep r=3,4,5,6, or r = [3, 4, 5, 6] in [fit.sweep]".into());
    };
    let parameters = case.problem.unknowns.law().parameters();
    let Some(index) = parameters.iter().position(|p| p.name == name) else {
        let names: Vec<_> = parameters.iter().map(|p| p.name).collect();
        return Err(format!("--sweep {name}: the law has no such parameter; it has {}", names.join(", ")).into());
    };
    if case.problem.unknowns.list().iter().any(|unknown| unknown.index == index) {
        return Err(format!("--sweep {name} is fitted; take it out of [fit] parameters to prescribe it").into());
    }
    Ok((index, values.clone()))
}

/// A line for each fit, and what was not fitted.
fn tell(name: &str, rows: &[SweepRow], missing: &[f64], ended: Option<Ended>) {
    for row in rows {
        let in_words = |p: &crate::identify::FittedParameter| format!("{} = {:.6}", p.parameter.name, p.value);
        let values: Vec<String> = row.fit.parameters.iter().map(in_words).collect();
        let status = row.fit.status.name();
        eprintln!("{name} = {}: {}, omega = {:.6e} ({status})", row.value, values.join(", "), row.fit.omega);
    }
    let Some(ended) = ended else { return };
    let cut: Vec<f64> = rows.iter().filter(|row| row.fit.cut_short.is_some()).map(|row| row.value).collect();
    let list = |values: &[f64]| {
        let text = values.iter().take(MOST_NAMED).map(f64::to_string).collect::<Vec<_>>().join(", ");
        let more = values.len().saturating_sub(MOST_NAMED);
        if more == 0 { text } else { format!("{text} and {more} more") }
    };
    let mut text = format!("{WARNING}{}", ended.reason());
    if !cut.is_empty() {
        text.push_str(&format!("; the best so far is kept of {name} = {}", list(&cut)));
    }
    if !missing.is_empty() {
        text.push_str(&format!("; not fitted: {name} = {}", list(missing)));
    }
    eprintln!("{}", wrapped(&text, 2));
}

/// The parameters over the prescribed one, relative to the first row.
fn draw_sweep(folder: &RunFolder, name: &str, rows: &[SweepRow]) -> Result<()> {
    let x: Vec<f64> = rows.iter().map(|row| row.value).collect();
    let first = &rows[0].fit;
    let mut series: Vec<PlotSeries> = (0..first.parameters.len())
        .map(|k| {
            let y = rows.iter().map(|row| row.fit.parameters[k].value / first.parameters[k].value).collect();
            PlotSeries::new(first.parameters[k].parameter.name, Style::LineAndMarkers, x.clone(), y)
        })
        .collect();
    for (k, quantity) in first.derived.iter().enumerate() {
        if quantity.quantity.name == "initial_normal_stiffness" {
            let y = rows.iter().map(|row| row.fit.derived[k].quantity.value / quantity.quantity.value).collect();
            series.push(PlotSeries::new("initial normal stiffness", Style::Dashed, x.clone(), y));
        }
    }
    let plot = Plot {
        title: format!("Fits with {name} prescribed"),
        x: Axis::linear(name),
        y: Axis::linear("value over that of the first row"),
        series,
        notes: rows.iter().map(|row| format!("{name} = {}: omega = {:.6e}", row.value, row.fit.omega)).collect(),
        ..Plot::default()
    };
    Ok(folder.save_figure("sweep", &plot.draw()?)?)
}
