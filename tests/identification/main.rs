//! Mechanics and identification: laws, model, fits, intervals, doubt, and the case files that start them.

#[path = "../common/mod.rs"]
mod common;
#[path = "../mechanics_common/mod.rs"]
mod mechanics_common;

mod body;
mod budget;
mod case_file;
mod case_schema;
mod doubt;
mod identify;
mod identify_cli;
mod intervals;
mod joint_anywhere;
mod linalg_lu;
mod load_cell;
mod load_files;
mod mechanics_cli;
mod mechanics_laws;
mod mechanics_loads;
mod mechanics_model;
mod mechanics_reference;
mod mechanics_rotation;
mod mechanics_supports;
mod mechanics_tests;
mod several_tests;
mod smooth_border;
mod substrates;
mod sweep_limit;
mod tournament;
mod virtual_test;
