//! Where a frame begins: tiles, features, motions of zones, textures that repeat.

pub(crate) mod ambiguity;
pub(crate) mod blocks;
pub(crate) mod features;
pub(crate) mod find;
pub(crate) mod initial;
pub(crate) mod patch;
pub(crate) mod period;
pub(crate) mod search;
pub(crate) mod wide_search;
pub(crate) mod zone_motion;
