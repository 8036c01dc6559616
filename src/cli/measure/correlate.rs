//! `quadrille correlate`.

use crate::cli::about::devices;
use crate::cli::args::{CorrelateArgs, ProgressKind};
use crate::cli::look::figures;
use crate::cli::talk::{Paint, Progress, Talk};
use crate::cli::{Outcome, Result, signals};
use crate::io::case::read_case;
use crate::io::text::shell_word;
use crate::run::{Existing, Plan, Request, RunError, RunFolder, Session, run_series};

pub(crate) fn run(args: &CorrelateArgs, paint: Paint) -> Result<Outcome> {
    let case = args.case.as_deref().map(read_case).transpose()?.unwrap_or_default();
    let plan = Plan::of(&request(args), &case).map_err(with_command)?;
    let mut progress = Progress::new(talk(args), paint);
    let (folder, pool) = (RunFolder::writable(&args.output)?, args.threads.pool()?);
    let ran = run_series(&plan, &folder, &pool, session(args)?, &mut |event| progress.take(event))?;
    draw(args, ran.complete)?;
    Ok(ran.outcome)
}

/// Words of a command that are shown; of more, as a shell makes of a pattern, the first.
const SHOWN: usize = 14;

/// The error, with the command that was meant when only the reference is to be named.
fn with_command(error: RunError) -> Box<dyn std::error::Error + Send + Sync> {
    let RunError::WhichReference { named, .. } = &error else { return error.into() };
    let given: Vec<String> = std::env::args_os().map(|word| shell_word(&word.to_string_lossy())).collect();
    let rest: Vec<&str> = given.iter().skip_while(|word| *word != "correlate").skip(1).map(String::as_str).collect();
    let mut words = rest.iter().take(SHOWN).copied().collect::<Vec<_>>().join(" ");
    if rest.len() > SHOWN {
        words.push_str(&format!(" ... (and the {} other arguments)", rest.len() - SHOWN));
    }
    let named = shell_word(&named.display().to_string());
    format!("{error}:\n  quadrille correlate --reference {named} {words}").into()
}

/// Draws the figures that the arguments ask for, of a series that is complete.
pub(crate) fn draw(args: &CorrelateArgs, complete: bool) -> Result<()> {
    match args.figures.as_ref().filter(|_| complete) {
        Some(frames) => figures::of_run(&args.output, frames, args.threads.threads, args.quiet),
        None => Ok(()),
    }
}

/// How the arguments want a plan to be carried out.
pub(crate) fn session(args: &CorrelateArgs) -> Result<Session> {
    let existing = if args.overwrite { Existing::Replace } else { Existing::Continue };
    Ok(Session { shard: args.request.shard, stop: signals::listen()?, ..Session::new(existing) })
}

/// How much the arguments want to be said.
pub(crate) fn talk(args: &CorrelateArgs) -> Talk {
    match (args.progress, args.quiet, args.verbose) {
        (_, true, _) => Talk::Quiet,
        (ProgressKind::Json, ..) => Talk::Json,
        (_, _, true) => Talk::Verbose,
        _ => Talk::Normal,
    }
}

/// What the arguments say over the case file.
pub(crate) fn request(args: &CorrelateArgs) -> Request {
    Request { gpu: devices::options(args.trust_device), ..args.request.clone() }
}
