//! What the noise and the constants do to the parameters.

pub(crate) mod axes;
pub(crate) mod bands;
pub(crate) mod bootstrap;
pub(crate) mod budget;
pub(crate) mod constants;
pub(crate) mod intervals_;
pub(crate) mod profile;
pub(crate) mod profile_ends;
pub(crate) mod statistics;
