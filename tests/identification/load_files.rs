//! Load files: read, joined with frames, and what is said about wrong ones.

use quadrille::io::load::{
    FrameTimes, LoadColumn, LoadError, LoadTable, parse_load, parse_record, read_frame_times, read_load,
};
use quadrille::remark::{About, Code};
use std::path::Path;

fn parse(text: &str, n_frames: usize) -> Result<LoadTable, LoadError> {
    parse_load(text, Path::new("test/load.csv"), n_frames)
}

/// Names and values of the columns.
#[track_caller]
fn columns(text: &str, n_frames: usize) -> Vec<(String, Vec<Option<f64>>)> {
    let table = parse(text, n_frames).unwrap_or_else(|error| panic!("{error}"));
    table.columns.into_iter().map(|LoadColumn { name, values }| (name, values)).collect()
}

/// The error, whose message names the file and says `wanted`.
#[track_caller]
fn error(text: &str, n_frames: usize, wanted: &[&str]) -> LoadError {
    let error = parse(text, n_frames).map(|table| format!("{text:?} is read as {table:?}")).unwrap_err();
    let said = error.to_string();
    for wanted in wanted.iter().chain(&["test/load.csv"]) {
        assert!(said.contains(wanted), "{wanted:?} is not said: {said}");
    }
    error
}

const TWO: [Option<f64>; 2] = [Some(10.0), Some(20.5)];

#[test]
fn rows_are_the_deformed_images_or_all_images_with_the_reference_first() {
    assert_eq!(columns("load_N\n10\n20.5\n", 2), [("load_N".to_owned(), TWO.to_vec())]);
    assert_eq!(columns("load_N\n0\n10\n20.5\n", 2), [("load_N".to_owned(), TWO.to_vec())]);
}

#[test]
fn a_frame_column_puts_rows_in_order_and_leaves_gaps() {
    let read = columns("load_N,frame,time_s\n20.5,2,0.2\n0,0,0\n40,4,\n10,1,0.1\n", 4);
    assert_eq!(read[0], ("load_N".to_owned(), vec![Some(10.0), Some(20.5), None, Some(40.0)]));
    assert_eq!(read[1], ("time_s".to_owned(), vec![Some(0.1), Some(0.2), None, None]));
    assert_eq!(columns("Frame,load_N\n1,10\n2,20.5\n", 2)[0].1, TWO);
}

#[test]
fn separators_decimal_commas_comments_and_spreadsheet_habits_are_understood() {
    for text in [
        "# a machine\nload_N\n\n10\n# later\n20.5\n",
        "\u{feff}load_N\r\n10\r\n20.5\r\n",
        "load [N]\n10\n2.05e1\n",
        "load (N)\n\"10\"\n 20.5 ",
        "load_N\n10\n20.5\n\n\n",
    ] {
        assert_eq!(columns(text, 2), [("load_N".to_owned(), TWO.to_vec())], "{text:?}");
    }
    for text in [
        "time [s];load [N]\n0,5;10\n1;20,5\n;;\n",
        "time_s\tload_N\n0,5\t10\n1\t20.5\n",
        "time_s; load_N\n.5;10\n1;20,5",
    ] {
        let read = columns(text, 2);
        assert_eq!(read[0], ("time_s".to_owned(), vec![Some(0.5), Some(1.0)]), "{text:?}");
        assert_eq!(read[1], ("load_N".to_owned(), TWO.to_vec()), "{text:?}");
    }
    assert_eq!(columns("cross head [mm],cycles [-]\n1,2\n", 1)[0].0, "cross_head_mm");
    assert_eq!(columns("cross head [mm],cycles [-]\n1,2\n", 1)[1].0, "cycles_1");
}

#[test]
fn a_column_knows_its_unit_and_its_frames() {
    let table = parse("cross_head_mm\n1\n2\n", 2).unwrap();
    let column = &table.columns[0];
    assert_eq!(column.name_and_unit(), ("cross_head", "mm"));
    assert_eq!([0, 1, 2, 3].map(|frame| column.at(frame)), [None, Some(1.0), Some(2.0), None]);
}

#[test]
fn another_number_of_rows_is_refused_with_both_numbers() {
    for rows in [1, 2, 5] {
        let text = format!("load_N\n{}", "1\n".repeat(rows));
        let error =
            error(&text, 3, &[&format!("{rows} rows for 3 deformed images"), "give 3 rows, 4 with the reference"]);
        assert!(matches!(error, LoadError::Length { n_rows, n_frames: 3, .. } if n_rows == rows));
    }
}

#[test]
fn wrong_rows_are_named_by_their_line() {
    let wrong = error("# head\nload_N,time_s\n1,2\n3\n", 2, &["line 4", "1 values under 2 columns"]);
    assert!(matches!(wrong, LoadError::Row { line: 4, found: 1, expected: 2, decimal_commas: false, .. }));
    let wrong = error("load_N,time_s\n1,5,0,1\n", 1, &["line 2", "decimal commas separate columns by ;"]);
    assert!(matches!(wrong, LoadError::Row { decimal_commas: true, .. }));
    for cell in ["abc", "nan", "inf", "1e999", "1 000", "1.000.0"] {
        let wrong = error(&format!("time_s,load_N\n1,2\n1,{cell}\n"), 2, &["line 3", "column 'load_N'", cell]);
        assert!(matches!(wrong, LoadError::Number { line: 3, .. }));
    }
    assert!(matches!(error("t_s;l_N\n1;1.000,5\n", 1, &["1.000,5"]), LoadError::Number { .. }));
}

#[test]
fn wrong_frames_are_named_by_their_line() {
    for frame in ["4", "-1", "1.0", "x", ""] {
        let wrong =
            error(&format!("frame,load_N\n1,2\n{frame},3\n"), 3, &["line 3", "not among the 3 deformed images"]);
        assert!(matches!(wrong, LoadError::Frame { line: 3, n_frames: 3, .. }), "{frame}");
    }
    assert!(matches!(
        error("frame,load_N\n2,2\n2,3\n", 3, &["line 3", "frame 2"]),
        LoadError::Twice { line: 3, frame: 2, .. }
    ));
}

#[test]
fn wrong_headers_say_how_to_write_them() {
    for text in ["", "# nothing\n\n", "load_N\n", "frame\n1\n"] {
        assert!(matches!(error(text, 1, &["a header such as `time_s,load_N`"]), LoadError::Empty { .. }), "{text:?}");
    }
    for name in ["load", "_N", "load_"] {
        let wrong = error(&format!("time_s,{name}\n1,2\n"), 1, &["line 1", "has no unit", &format!("{name} [N]")]);
        assert!(matches!(wrong, LoadError::NoUnit { line: 1, .. }));
    }
    for head in ["load_N,load [N]", "load_N,", "frame,FRAME,load_N"] {
        let cells = vec!["1"; head.split(',').count()].join(",");
        let wrong = error(&format!("{head}\n{cells}\n"), 1, &["line 1", "twice or has no name"]);
        assert!(matches!(wrong, LoadError::ColumnName { .. }), "{head}");
    }
    // A file without header begins with numbers.
    assert!(matches!(error("0.5,10\n1,20\n", 2, &["column '0.5' has no unit"]), LoadError::NoUnit { .. }));
}

#[test]
fn files_that_are_not_there_or_no_text_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("load.csv");
    let said = |error: LoadError| {
        let said = error.to_string();
        assert!(said.contains("load.csv"), "{said}");
        error
    };
    assert!(matches!(said(read_load(&path, 1).unwrap_err()), LoadError::NotFound { .. }));
    std::fs::write(&path, b"load_N\n1\n# \xe4\n").unwrap();
    assert!(matches!(said(read_load(&path, 1).unwrap_err()), LoadError::NotText { line: 3, .. }));
    std::fs::write(&path, "load_N\n1\n").unwrap();
    assert_eq!(read_load(&path, 1).unwrap().columns.len(), 1);
    std::fs::create_dir(folder.path().join("folder_load.csv")).unwrap();
    let wrong = read_load(&folder.path().join("folder_load.csv"), 1).unwrap_err();
    assert!(matches!(said(wrong), LoadError::Io { .. }));
}

#[test]
fn units_in_a_line_of_their_own_are_understood_and_converted() {
    for text in [
        "Time;Load\ns;kN\n0,5;0,01\n1;0,0205\n",
        "Time\tLoad\n(s)\t(kN)\n0,5\t0,01\n1\t0,0205\n",
        "\"Time\",\"Load\"\n\"[s]\",\"[kN]\"\n\"0,5\",\"0,01\"\n\"1\",\"0,0205\"\n",
        "Time,Load,\nms,N,\n500,10,\n1000,20.5,\n",
        "Time [s];Load [kN];\n0,5;0,01;\n1;0,0205;\n",
    ] {
        let table = parse(text, 2).unwrap_or_else(|error| panic!("{text:?}: {error}"));
        assert_eq!(
            table.columns[0],
            LoadColumn { name: "Time_s".into(), values: vec![Some(0.5), Some(1.0)] },
            "{text:?}"
        );
        assert_eq!(table.columns[1].name, "Load_N", "{text:?}");
        let off = table.columns[1].values.iter().zip(TWO).map(|(found, want)| (found.unwrap() - want.unwrap()).abs());
        assert!(off.fold(0.0, f64::max) < 1e-12, "{text:?}: {table:?}");
        assert_eq!(table.remarks.len(), 1, "{:?}", table.remarks);
    }
    let read = columns("Axial_Force;Axial_Way\nkN;mm\n1;2\n", 1);
    assert_eq!(read[0], ("Axial_Force_N".to_owned(), vec![Some(1000.0)]), "a name with a mark in it has no unit");
    // A name that only looks as if it ended in a unit keeps its numbers.
    assert_eq!(columns("force_min,load_N\n1,2\n", 1)[0], ("force_min".to_owned(), vec![Some(1.0)]));
    assert_eq!(columns("T,cycle\n\u{b0}C,-\n20,7\n", 1)[0], ("T_\u{b0}C".to_owned(), vec![Some(20.0)]));
    assert_eq!(columns("T,cycle\n\u{b0}C,-\n20,7\n", 1)[1], ("cycle_1".to_owned(), vec![Some(7.0)]));
}

fn record(text: &str, time: &str, times: &FrameTimes) -> Result<LoadTable, LoadError> {
    parse_record(text, Path::new("test/load.csv"), time, times)
}

#[test]
fn a_record_is_interpolated_between_its_rows_and_ends_with_them() {
    // Row spacing changes; a value is missing.
    let text = "Time [s],Load [N],way_mm\n1,0,0\n2,10,\n4,30,6\n4,31,7\n5,40,8\n";
    let table = record(text, "Time", &FrameTimes::every(0.5, 0.0, 11)).unwrap();
    let values = |k: usize| table.columns[k].values.clone();
    assert_eq!(table.columns[0].name, "Time_s");
    assert_eq!(values(0)[3], Some(2.0));
    let load = [None, Some(0.0), Some(5.0), Some(10.0), Some(15.0), Some(20.0), Some(25.0), Some(30.0)];
    assert_eq!(values(1)[..8], load);
    assert_eq!(values(1)[8..], [Some(35.5), Some(40.0), None], "the later of two rows at one time goes on from there");
    assert_eq!(
        values(2)[..8],
        [None, Some(0.0), None, None, None, None, None, Some(6.0)],
        "an empty cell is not bridged"
    );
    let outside = &table.remarks[0];
    assert_eq!((outside.code, &outside.about), (Code::LoadOutside, &About::Frames(vec![1, 11])));
    assert_eq!([outside.number("from_s"), outside.number("to_s")], [Some(1.0), Some(5.0)]);
    let stress = table.with_stress(2.0, Path::new("test/load.csv")).unwrap();
    assert_eq!(stress.columns[3].name, "stress_MPa");
    assert_eq!(stress.columns[3].at(4), Some(5.0));
}

#[test]
fn clock_times_count_from_the_first_row_or_join_two_clocks() {
    let text = "Clock;Load [N]\n10:31:00,0;0\n10:31:10,0;100\n";
    let table = record(text, "clock", &FrameTimes::every(2.5, 0.0, 3)).unwrap();
    assert_eq!(table.columns[1].values, [Some(25.0), Some(50.0), Some(75.0)]);
    assert_eq!(table.columns[0].name, "Clock_s");
    assert!(table.remarks[0].text.contains("counted from the first row (10:31:00,0)"), "{:?}", table.remarks);
    let folder = tempfile::tempdir().unwrap();
    let camera = folder.path().join("camera.csv");
    std::fs::write(&camera, "name,timestamp\na.tif,10:31:01\nb.tif,10:31:09.5\n").unwrap();
    let times = read_frame_times(&camera, 2).unwrap();
    assert_eq!(record(text, "clock", &times).unwrap().columns[1].values, [Some(10.0), Some(95.0)]);
    let wrong = record("t_s,load_N\n0,0\n9,9\n", "t", &times).unwrap_err();
    assert!(matches!(wrong, LoadError::Clocks { .. }), "{wrong}");
}

#[test]
fn records_that_cannot_be_joined_say_why_and_where() {
    let times = FrameTimes::every(1.0, 0.0, 3);
    let error = |text: &str, time: &str, wanted: &[&str]| {
        let error = record(text, time, &times).map(|table| format!("{text:?} is read as {table:?}")).unwrap_err();
        let said = error.to_string();
        for wanted in wanted.iter().chain(&["test/load.csv"]) {
            assert!(said.contains(wanted), "{wanted:?} is not said: {said}");
        }
        error
    };
    let wrong = error("t_s,load_N\n0,1\n1,2\n", "time", &["no column 'time'", "t_s, load_N"]);
    assert!(matches!(wrong, LoadError::NoTime { .. }));
    assert!(matches!(error("t_1,load_N\n0,1\n1,2\n", "t", &["are not seconds", "[min]"]), LoadError::TimeUnit { .. }));
    let wrong = error("t_s,load_N\n0,1\n2,2\n1,3\n", "t", &["line 4", "column 't_s'", "must not fall"]);
    assert!(matches!(wrong, LoadError::TimeOrder { line: 4, .. }));
    assert!(matches!(error("t_s,load_N\n0,1\n,2\n", "t", &["line 3"]), LoadError::TimeOrder { .. }));
    let wrong = error("t_s,load_N\n10,1\n20,2\n", "t", &["from 10 to 20 s", "from 1 to 3 s", "start_s"]);
    assert!(matches!(wrong, LoadError::Apart { .. }));
    assert!(matches!(error("t_s,load_N\n0,1\nx,2\n", "t", &["line 3", "'x'"]), LoadError::Number { line: 3, .. }));
    let path = Path::new("test/load.csv");
    for text in ["way_mm\n1\n", "a_N,b_N\n1,2\n", "load_N,stress_MPa\n1,2\n"] {
        let wrong = parse(text, 1).unwrap().with_stress(2.0, path).unwrap_err();
        assert!(
            matches!(wrong, LoadError::Force { .. }) && wrong.to_string().contains("one column of force"),
            "{wrong}"
        );
    }
    assert_eq!(parse("a_N,Force_N\n1,2\n", 1).unwrap().with_stress(2.0, path).unwrap().columns[2].at(1), Some(1.0));
}
