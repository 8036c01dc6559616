//! `quadrille tournament`: several laws on the same data.

use super::args::TournamentArgs;
use super::lines::wrapped;
use super::paint::Paint;
use super::progress::Progress;
use super::run::or_stopped;
use super::talk::Talk;
use super::{Outcome, Result, signals};
use crate::io::joint::read_joint;
use crate::report::tournament::TournamentRecord;
use crate::run::{Event, compare_laws};
use std::path::Path;

/// Runs the command.
pub(super) fn run(args: &TournamentArgs, paint: Paint) -> Result<Outcome> {
    let mut input = read_joint(&args.case)?;
    if let Some(fit) = &mut input.case.fit {
        args.limits.over(fit);
        if !args.laws.is_empty() {
            fit.laws.clone_from(&args.laws);
        }
        if fit.laws.is_empty() {
            let laws = crate::mechanics::cohesive::LAW_NAMES.join(", ");
            return Err(format!("nothing to compare: give --laws A,B, or laws in [fit]; there are {laws}").into());
        }
    }
    let mut progress = Progress::new(Talk::of(args.progress, args.talk.quiet), paint);
    let (output, pool, stop) = (&args.results.output, args.threads.pool()?, signals::listen()?);
    let mut watcher = |event: Event<'_>| progress.take(event);
    let ran = compare_laws(&input, &args.case, output, args.results.overwrite, &pool, &stop, &mut watcher);
    or_stopped(ran.map(|(_, outcome)| outcome), &stop)
}

/// Prints what a comparison came to.
pub(super) fn print(tournament: &TournamentRecord, folder: &Path) {
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
