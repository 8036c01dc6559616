//! The program as a user meets it: commands, messages, runs that are stopped and go on, what is written.

#[path = "../common/mod.rs"]
mod common;
#[path = "../program/mod.rs"]
mod program;
#[cfg(feature = "cli")]
#[path = "../common/readers.rs"]
mod readers;

mod armour;
mod bad_input;
mod book;
mod camera;
mod cli;
mod doors;
mod exports;
mod figures;
mod films;
mod foreign;
mod fuzz;
mod inputs;
mod maps;
mod metrology;
mod pages;
mod probe;
mod reduce;
mod restart;
mod run;
mod run_library;
mod store;
mod studio;
mod tension;
mod update_cli;
mod view;
mod watch;
#[cfg(unix)]
mod words;
