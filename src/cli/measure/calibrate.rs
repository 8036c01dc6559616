//! `quadrille calibrate`.

use super::correlate::{request, session, talk};
use crate::cli::args::CalibrateArgs;
use crate::cli::talk::{Paint, Progress, wrapped};
use crate::cli::{Outcome, Result};
use crate::io::case::read_case;
use crate::run::{Calibrated, Calibrating, calibrate};

pub(crate) fn run(args: &CalibrateArgs, paint: Paint) -> Result<Outcome> {
    let asked = Calibrating {
        request: request(&args.correlate),
        case: args.correlate.case.as_deref().map(read_case).transpose()?.unwrap_or_default(),
        lengths: args.length.clone(),
        points: args.point.clone(),
        mark_std_px: args.mark_std,
        chessboard: args.chessboard,
        dots: args.dots,
        pitch_mm: args.pitch,
    };
    let mut progress = Progress::new(talk(&args.correlate), paint);
    let (pool, session) = (args.correlate.threads.pool()?, session(&args.correlate)?);
    let output = &args.correlate.output;
    let Calibrated { file, said } = calibrate(&asked, output, session, &pool, &mut |event| progress.take(event))?;
    said.iter().for_each(|line| println!("{}", wrapped(line, 2)));
    if !args.correlate.quiet {
        eprintln!("camera in {}", file.display());
    }
    Ok(Outcome::Fine)
}
