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
