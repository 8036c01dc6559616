//! What people look at: summaries and pictures.

pub mod summary;
