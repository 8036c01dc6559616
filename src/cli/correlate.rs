//! `quadrille correlate`.

use super::args::{CorrelateArgs, ProgressKind};
use super::paint::Paint;
use super::progress::Progress;
use super::talk::Talk;
use super::{Outcome, Result, devices, signals};
use crate::io::case::read_case;
use crate::run::{Existing, Overlay, Plan, RunFolder, Session, run_series};

/// Runs the command.
pub(super) fn run(args: &CorrelateArgs, paint: Paint) -> Result<Outcome> {
    let case = args.case.as_deref().map(read_case).transpose()?.unwrap_or_default();
    let plan = Plan::of(&overlay(args), &case)?;
    let mut progress = Progress::new(talk(args), paint);
    let (folder, pool) = (RunFolder::writable(&args.output)?, args.threads.pool()?);
    let ran = run_series(&plan, &folder, &pool, session(args)?, &mut |event| progress.take(event))?;
    draw(args, ran.complete)?;
    Ok(ran.outcome)
}

/// Draws the figures that the arguments ask for, of a series that is complete.
pub(super) fn draw(args: &CorrelateArgs, complete: bool) -> Result<()> {
    match args.figures.as_ref().filter(|_| complete) {
        Some(frames) => super::figures::of_run(&args.output, frames, args.threads.threads, args.quiet),
        None => Ok(()),
    }
}

/// How the arguments want a plan to be carried out.
pub(super) fn session(args: &CorrelateArgs) -> Result<Session> {
    let existing = if args.overwrite { Existing::Replace } else { Existing::Continue };
    Ok(Session { shard: args.shard, stop: signals::listen()?, ..Session::new(existing) })
}

/// How much the arguments want to be said.
pub(super) fn talk(args: &CorrelateArgs) -> Talk {
    match (args.progress, args.quiet, args.verbose) {
        (_, true, _) => Talk::Quiet,
        (ProgressKind::Json, ..) => Talk::Json,
        (_, _, true) => Talk::Verbose,
        _ => Talk::Normal,
    }
}

/// What the arguments say beside the case file.
pub(super) fn overlay(args: &CorrelateArgs) -> Overlay {
    Overlay {
        reference: args.reference.clone(),
        deformed: args.deformed.clone(),
        page: args.page,
        pages: args.pages,
        pixel_size: args.pixel_size,
        shard: args.shard,
        roi: args.roi.clone(),
        polygon: args.polygon.iter().map(|polygon| polygon.0.clone()).collect(),
        mask: args.mask.clone(),
        mesh: args.mesh.clone(),
        guard: args.guard,
        element_share: args.element_share,
        element_size: args.element_size,
        interpolation: args.interpolation,
        tolerance: args.tolerance,
        max_iterations: args.max_iterations,
        brightness: args.brightness,
        start: args.start,
        update_reference: args.update_reference,
        noise: args.noise,
        noise_correlation: args.noise_correlation,
        regularisation: args.regularisation,
        cutoff: args.cutoff,
        drop_textureless: args.drop_textureless,
        export: args.export.as_ref().map(|tables| tables.iter().map(|&table| table.into()).collect()),
        strain: args.strain,
        device: args.device.clone(),
        gpu: devices::options(),
        isa: args.isa.clone(),
    }
}
