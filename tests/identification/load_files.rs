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
    table.columns.into_iter().map(|LoadColumn { name, values, .. }| (name, values)).collect()
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
    // As programs for numbers write whole ones.
    assert_eq!(columns("frame,load_N\n2.0,20.5\n1.0,10\n", 2)[0].1, TWO);
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
}

#[test]
fn wrong_frames_are_named_by_their_line() {
    for frame in ["4", "-1", "1.5", "x", ""] {
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
    std::fs::write(&path, b"load_N\n1\n# \0\xe4\n").unwrap();
    assert!(matches!(said(read_load(&path, 1).unwrap_err()), LoadError::NotText { line: 3, .. }));
    std::fs::write(&path, "load_N\n1\n").unwrap();
    assert_eq!(read_load(&path, 1).unwrap().columns.len(), 1);
    std::fs::create_dir(folder.path().join("folder_load.csv")).unwrap();
    let wrong = read_load(&folder.path().join("folder_load.csv"), 1).unwrap_err();
    assert!(matches!(said(wrong), LoadError::Io { .. }));
}

/// The values of the last column, and what is said of the file.
#[track_caller]
fn last(text: &str, n_frames: usize) -> (Vec<f64>, String) {
    let mut table = parse(text, n_frames).unwrap_or_else(|error| panic!("{text:?}: {error}"));
    let values = table.columns.pop().unwrap().values.into_iter().map(Option::unwrap).collect();
    (values, table.remarks.iter().map(|remark| remark.text.as_str()).collect::<Vec<_>>().join("; "))
}

#[test]
fn a_mark_between_thousands_is_told_from_a_decimal_mark_by_the_numbers_of_its_column_or_of_the_file() {
    for (text, wanted) in [
        // Decimal commas in another column, or in the same.
        ("Zeit [s];Kraft [N]\n1,0;1.250\n2,0;2.500\n", [1250.0, 2500.0]),
        ("Zeit [s];Kraft [N]\n1;1.250\n2;2.500,5\n", [1250.0, 2500.5]),
        ("Zeit [s];Kraft [N]\n1;1.250\n2;1.002.500\n", [1250.0, 1_002_500.0]),
        // Decimal points.
        ("t_s\tload_N\n0.5\t1,250\n1.0\t2,500\n", [1250.0, 2500.0]),
        ("t_s,load_N\n0.5,\"1,250\"\n1.0,\"2,500\"\n", [1250.0, 2500.0]),
        ("t_s,load_N\n0.5,\"1,250.5\"\n1,\"2,500\"\n", [1250.5, 2500.0]),
    ] {
        let (values, said) = last(text, 2);
        assert_eq!(values, wanted, "{text:?}");
        assert!(said.contains("a mark between thousands") || !text.contains("1.250\n"), "{text:?}: {said}");
    }
    for (text, wanted) in [
        ("t_s;load_N\n0.500;1.250\n1;0.750\n", [1.25, 0.75]),
        ("t_s;load_N\n1;1.250\n2;1000.500\n", [1.25, 1000.5]),
        ("t_s,load_N\n1,1.250\n2,2.500\n", [1.25, 2.5]),
        ("t_s;load_N\n1,500;1,250\n2,5;2,500\n", [1.25, 2.5]),
        // Each column by its own numbers.
        ("t_s;load_N\n0.5;12,5\n1.5;1,250\n", [12.5, 1.25]),
    ] {
        assert_eq!(last(text, 2), (wanted.to_vec(), String::new()), "{text:?}");
    }
    for text in [
        "load_N;way_mm\n1.250;1\n",
        "load_N\tway_mm\n1,250\t1\n",
        "load_N,way_mm\n\"1,250\",1\n",
        "load_N;way_mm\n1,5;1\n1.25;1\n",
    ] {
        let wrong = error(text, text.lines().count() - 1, &["column 'load_N'", "decimal = \"point\" or \"comma\""]);
        assert!(matches!(wrong, LoadError::Ambiguous { line: 2, .. }), "{wrong}");
    }
}

#[test]
fn lines_before_the_header_are_passed_over_and_said() {
    for text in [
        "Test 4.1\nUser;NN\nProbe;A1\n\nTime [s];Load [N]\n0,5;10\n1;20,5\n",
        "sep=;\nTime;Load\ns;N\n0,5;10\n1;20,5\n",
        "\"Test\",\"a\"\n\"User\",\"b\"\n\"Time\",\"Load\"\n\"s\",\"N\"\n\"0.5\",\"10\"\n\"1\",\"20.5\"\n",
        "Machine 3\nRate\t1\nTime\tLoad\n(s)\t(N)\n0,5\t10\n1\t20,5\n",
    ] {
        let (values, said) = last(text, 2);
        assert_eq!(
            (values, parse(text, 2).unwrap().columns[1].name.as_str()),
            (vec![10.0, 20.5], "Load_N"),
            "{text:?}"
        );
        assert_eq!(said.contains("before the header"), !text.starts_with("sep"), "{text:?}: {said}");
    }
    // The line of a fault is that of the file.
    error("Test\nUser;NN\nTime [s];Load [N]\n0;1\n1;x\n", 2, &["line 5", "'x'"]);
    error("sep=;\nTime [s];Load [N]\n0;1\n1;x\n", 2, &["line 4", "'x'"]);
}

#[test]
fn files_in_other_encodings_are_read_and_it_is_said() {
    let text = "Zeit [s];Weg [\u{b5}m]\n1;120\n";
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("load.csv");
    let utf16 = |order: fn(u16) -> [u8; 2]| text.encode_utf16().flat_map(order).collect::<Vec<u8>>();
    let with = |mark: &[u8], rest: Vec<u8>| [mark, &rest].concat();
    for (bytes, name) in [
        (text.chars().map(|c| c as u8).collect(), "Windows-1252"),
        (with(&[0xff, 0xfe], utf16(u16::to_le_bytes)), "UTF-16"),
        (with(&[0xfe, 0xff], utf16(u16::to_be_bytes)), "UTF-16"),
        (utf16(u16::to_le_bytes), "UTF-16"),
        (text.as_bytes().to_vec(), ""),
    ] {
        std::fs::write(&path, bytes).unwrap();
        let table = read_load(&path, 1).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!((table.columns[1].name.as_str(), table.columns[1].at(1)), ("Weg_mm", Some(0.12)), "{name}");
        assert_eq!(table.remarks.iter().any(|remark| remark.text.contains("is read as")), !name.is_empty());
        assert!(table.remarks.iter().any(|remark| remark.text.contains(name)), "{name}");
    }
    std::fs::write(&path, [0xff, 0xfe, b'a']).unwrap();
    assert!(matches!(read_load(&path, 1), Err(LoadError::NotText { line: 1, .. })));
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
            LoadColumn { name: "Time_s".into(), values: vec![Some(0.5), Some(1.0)], reference: None },
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
    // Past noon and midnight, with the distance to UTC on one of the two clocks.
    let text = "Clock;Load [N]\n11:59:50 PM;0\n12:00:10 AM;200\n";
    let table = record(text, "clock", &FrameTimes::every(5.0, 0.0, 3)).unwrap();
    assert_eq!(table.columns[1].values, [Some(50.0), Some(100.0), Some(150.0)]);
    std::fs::write(&camera, "timestamp\n2024-05-07T10:00:05+02:00\n").unwrap();
    let times = read_frame_times(&camera, 1).unwrap();
    let text = "Clock;Load [N]\n2024-05-07 08:00:00Z;0\n2024-05-07 08:00:10.000000Z;100\n";
    assert_eq!(record(text, "clock", &times).unwrap().columns[1].values, [Some(50.0)]);
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
