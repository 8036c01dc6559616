//! Load files and records of machines, tables of displacements, tables and borders of a joint, arrays of a restart.
#![no_main]

use libfuzzer_sys::fuzz_target;
use quadrille::io::csv::read_displacements;
use quadrille::io::joint::{read_boundary, read_measurement, read_table};
use quadrille::io::load::{FrameTimes, parse_load, parse_record};
use quadrille::io::npz::read_npz;
use quadrille_fuzz::with_file;

fuzz_target!(|data: &[u8]| {
    let Some((&kind, data)) = data.split_first() else { return };
    let path = "table.csv".as_ref();
    match kind % 8 {
        0 => drop(parse_load(&String::from_utf8_lossy(data), path, 5)),
        1 => drop(parse_record(&String::from_utf8_lossy(data), path, "time", &FrameTimes::every(0.5, 0.0, 5))),
        2 => drop(read_displacements(data)),
        3 => drop(read_npz(std::io::Cursor::new(data))),
        4 => with_file(data, "t.csv", |path| drop(read_table(path))),
        5 => with_file(data, "t.csv", |path| drop(read_boundary(path))),
        6 => with_file(data, "t.csv", |path| drop(read_measurement(path, Some(0.002)))),
        _ => with_file(data, "t.csv", |path| drop(read_measurement(path, None))),
    }
});
