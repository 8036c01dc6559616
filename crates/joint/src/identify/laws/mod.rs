//! Law against law, one parameter against the others.

pub(crate) mod averages;
pub(crate) mod sweep;
pub(crate) mod tournament;
