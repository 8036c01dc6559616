//! What holds the displacement where the texture does not: penalties, splines, borders, places without a value.

pub(crate) mod border;
pub(crate) mod filled;
pub(crate) mod outliers;
pub(crate) mod regularisation;
pub(crate) mod splines;
