//! Commands that make something to begin with, and the demonstration.

pub(crate) mod demo;
pub(crate) mod images;
pub(crate) mod page;
pub(crate) mod specimen;
pub(crate) mod virtual_test;
