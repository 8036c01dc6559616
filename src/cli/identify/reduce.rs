//! `quadrille reduce`: a test of the standards without a model.

use crate::cli::args::ReduceArgs;
use crate::cli::talk::Paint;
use crate::cli::{Outcome, Result};
use crate::run::reduce;

pub(crate) fn run(args: &ReduceArgs, paint: Paint) -> Result<Outcome> {
    args.drawn.choose();
    let record = reduce(&args.case, &args.results.output, args.results.overwrite)?;
    if !args.talk.quiet {
        record.remarks().iter().for_each(|remark| eprintln!("{}", paint.remark(remark)));
        record.lines().iter().for_each(|line| eprintln!("{line}"));
        eprintln!("results in {}", args.results.output.display());
    }
    Ok(Outcome::Fine)
}
