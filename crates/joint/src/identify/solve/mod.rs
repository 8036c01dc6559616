//! The minimiser: steps, starts, stages.

pub(crate) mod cone_step;
pub(crate) mod far_starts;
pub(crate) mod fit;
pub(crate) mod law_starts;
pub(crate) mod stage;
pub(crate) mod starts;
pub(crate) mod trust_region;
pub(crate) mod watch;
