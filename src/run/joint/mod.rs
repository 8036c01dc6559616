//! The mechanics and the identification of a run.

pub(crate) mod case;
pub(crate) mod identification;
pub(crate) mod several;
pub(crate) mod simulation;
pub(crate) mod tournament;
