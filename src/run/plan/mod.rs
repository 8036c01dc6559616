//! From a case and flags to what is to be done.

pub(crate) mod check;
pub(crate) mod found;
pub(crate) mod rehearsal;
pub(crate) mod request;
pub(crate) mod resolved;
pub(crate) mod run_toml;
pub(crate) mod session;
pub(crate) mod shard;
pub(crate) mod stop;
pub(crate) mod wanted;
pub(crate) mod which_reference;
pub(crate) mod zones;

pub use check::{Checked, CheckedZone, check, keeps_to};
pub use request::{Export, Request};
pub(crate) use resolved::MANY;
pub use resolved::{Images, Plan, strain_window};
pub use session::{Existing, Outcome, Ran, Session};
pub use shard::Shard;
pub use stop::Stop;
pub(crate) use zones::{Zones, cut};
