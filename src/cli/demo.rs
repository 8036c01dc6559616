//! `quadrille demo`: a peeling joint, made, measured and compared with the truth.

use super::args::DemoArgs;
use super::{Outcome, Result};
pub(super) fn run(_args: &DemoArgs) -> Result<Outcome> {
    Err("not yet".into())
}
