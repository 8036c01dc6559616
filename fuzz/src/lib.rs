//! The targets, one for each reader, are those of the tests.

#[path = "../../tests/common/readers.rs"]
pub mod readers;
