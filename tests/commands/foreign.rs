//! Fields of other programs in and out: every layout, what it leaves open, and that a number stays what it is.

#![cfg(feature = "cli")]

use crate::program;
use program::{Desk, INSIDE};
use quadrille::io::arrays::{ArrayFile, Values};
use quadrille::io::mat::MatWriter;
use quadrille::io::npz::NpzWriter;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Write as _;

/// Points of a grid 8 px apart under a stretch of 1 % along y (down), 0.01 % along x: x, y, u, v in px.
fn grid() -> Vec<[f64; 4]> {
    let at = (0..8).flat_map(|j| (0..12).map(move |i| [16.0 + 8.0 * f64::from(i), 16.0 + 8.0 * f64::from(j)]));
    at.map(|[x, y]| [x, y, 0.25 + 1e-4 * x, -0.5 + 0.01 * y]).collect()
}

/// A table of the grid below `head`, with a line for each point.
fn table(head: &str, line: impl Fn([f64; 4]) -> String) -> String {
    grid().into_iter().fold(format!("{head}\n"), |mut text, point| {
        let _ = writeln!(text, "{}", line(point));
        text
    })
}

/// The one row of the extensometers of a folder.
#[track_caller]
fn gauge(desk: &Desk, folder: &str, ends: &str) -> BTreeMap<String, f64> {
    desk.run(&format!("probe {folder} --extensometer {ends} --quiet")).fine();
    let text = desk.read(&format!("{folder}/quantities/extensometers.csv"));
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_reader(text.as_bytes());
    let rows: Vec<BTreeMap<String, String>> = reader.deserialize().map(|row| row.unwrap()).collect();
    let last = rows.last().unwrap();
    last.iter().filter_map(|(name, cell)| Some((name.clone(), cell.parse().ok()?))).collect()
}

#[test]
fn the_layout_of_every_program_is_recognised_and_a_stretch_is_a_stretch() {
    const MM: f64 = 0.05;
    let mm = |[x, y, u, v]: [f64; 4]| [x * MM, -y * MM, u * MM, -v * MM];
    let comma = |v: f64| v.to_string().replace('.', ",");
    let files = [
        (
            "vic-2d",
            "--sigma 0.01",
            table("\"x\", \"y\", \"u\", \"v\", \"sigma\", \"exx\"", |[x, y, u, v]| {
                format!("{x}, {y}, {u}, {v}, 0.01, 0")
            }),
        ),
        (
            "vic-2d",
            "",
            table("\"x [pixel]\", \"y [pixel]\", \"u [pixel]\", \"v [pixel]\", \"sigma [pixel]\"", |[x, y, u, v]| {
                format!("{x},{y},{u},{v},0.01")
            }),
        ),
        (
            "matchid",
            "--sigma 0.01",
            table(
                "Coordinates.Image X [Pixel];Coordinates.Image Y [Pixel];disp.Horizontal Displacement U [Pixel];disp.Vertical Displacement V [Pixel]",
                |p| p.map(comma).join(";"),
            ),
        ),
        (
            "nodemap",
            "--sigma 0.01 --pixel-size 0.05",
            table(
                "# facet_size : 19\n#\n#   ID; x_undef [mm]; y_undef [mm]; z_undef [mm]; u [mm]; v [mm]; w [mm]",
                |p| {
                    let [x, y, u, v] = mm(p);
                    format!("    7;   {x};   {y}; 0.1;  {u};  {v}; -0.2")
                },
            ),
        ),
        (
            "dice",
            "",
            table(
                "*** Digital Image Correlation Engine\n***\nCOORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y,SIGMA,GAMMA",
                |[x, y, u, v]| format!("{x:.4E},{y:.4E},{u:.9E},{v:.9E},1.0E-02,0"),
            ),
        ),
        (
            "pyaldic",
            "--sigma 0.01",
            table("\u{feff}node_id,x_px,y_px,disp_u,disp_v", |[x, y, u, v]| format!("3,{x},{y},{u},{v}")),
        ),
        (
            "davis",
            "--sigma 0.01 --pixel-size 0.05 --y up",
            table(
                "TITLE = \"B00001\"\nVARIABLES = \"x [mm]\", \"y [mm]\", \"Vx [mm]\", \"Vy [mm]\", \"isValid\"\nZONE T=\"Frame 0\", I=12, J=8",
                |p| {
                    let [x, y, u, v] = mm(p);
                    format!("{x} {y} {u} {v} 1")
                },
            ),
        ),
        ("table", "--sigma 0.01 --unit px --y down", table("x\ty\tux\tuy", |p| p.map(|v| v.to_string()).join("\t"))),
        (
            "table",
            "--sigma 0.01 --y down --pixel-size 0.05",
            table("x,y,u,v\n[m],[m],[mm],[mm]", |[x, y, u, v]| {
                format!("{},{},{},{}", x * MM * 1e-3, y * MM * 1e-3, u * MM, v * MM)
            }),
        ),
        // Positions that move with the specimen.
        (
            "table",
            "--sigma 0.01 --unit px --y down --coordinates deformed",
            table("x y u v", |[x, y, u, v]| format!("{} {} {u} {v}", x + u, y + v)),
        ),
    ];
    let desk = Desk::new();
    for (k, (layout, options, text)) in files.iter().enumerate() {
        let (file, folder) = (format!("{k}.txt"), format!("out-{k}"));
        desk.write(&file, text);
        let ran = desk.run(&format!("import {file} {options} --output {folder}")).fine();
        assert!(ran.stderr.contains(&format!("1 frame of layout {layout}: 96 nodes, 77 elements")), "{ran}");
        let found = gauge(&desk, &folder, "40,24,40,64");
        // 40 px along y; the digits of mm, metres and nine decimals.
        assert!((found["strain_engineering"] - 0.01).abs() < 1e-9, "{layout} {options}: {found:?}");
        assert!((found["elongation_px"] - 0.4).abs() < 1e-7, "{layout} {options}: {found:?}");
    }
}

/// Displacements of two points in the last frame of a folder, px.
#[track_caller]
fn at_points(desk: &Desk, folder: &str) -> Vec<f64> {
    desk.run(&format!("probe {folder} --point 32,32 --point 96,48 --quiet")).fine();
    let text = desk.read(&format!("{folder}/quantities/points.csv"));
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_reader(text.as_bytes());
    let rows: Vec<BTreeMap<String, String>> = reader.deserialize().map(|row| row.unwrap()).collect();
    let last = rows.iter().rev().take(2).rev();
    last.flat_map(|row| ["ux_px", "uy_px"].map(|name| row[name].parse().unwrap())).collect()
}

#[test]
fn what_probe_reads_of_a_run_is_what_it_reads_of_the_same_field_exported_and_imported_again() {
    let desk = Desk::with_series();
    desk.correlate(&format!("{INSIDE} --pixel-size 0.01 --output run ref.png a.png b.png")).fine();
    desk.run("export run --to nodemap,vic-2d,matchid,hdf5 --quiet").fine();
    desk.run("export run --to hdf5 --split --quiet").fine();
    let (points, wanted) = (at_points(&desk, "run"), gauge(&desk, "run", "32,32,96,32"));
    let read = [
        ("run/csv/*.csv", "--pixel-size 0.01"),
        ("run/nodemap/*.txt", "--pixel-size 0.01 --sigma 0.01"),
        ("run/vic-2d/*.csv", "--pixel-size 0.01"),
        ("run/matchid/*.csv", "--pixel-size 0.01 --sigma 0.01"),
        ("run/fields.h5", "--pixel-size 0.01"),
        ("run/hdf5/*.h5", "--pixel-size 0.01"),
    ];
    for (k, (files, options)) in read.into_iter().enumerate() {
        let folder = format!("back-{k}");
        let mut words = vec!["import", files, "--output", &folder];
        words.extend(options.split(' '));
        desk.run_words(&words).fine();
        // Files have every digit; a nodemap is divided by the pixel size again.
        let close = |found: f64, wanted: f64| (found - wanted).abs() < 1e-12;
        let found = gauge(&desk, &folder, "32,32,96,32");
        match k {
            // The table of quadrille has the coefficients of the fitted field, with which gauges are computed.
            0 => assert!(close(found["elongation_px"], wanted["elongation_px"]), "{files}: {found:?} {wanted:?}"),
            // Others have values at points; gauges of both agree well within their uncertainty.
            _ => {
                let back = at_points(&desk, &folder);
                assert!(back.iter().zip(&points).all(|(a, b)| close(*a, *b)), "{files}: {back:?} {points:?}");
                let off = (found["elongation_px"] - wanted["elongation_px"]).abs();
                assert!(off < wanted["sigma_elongation_px"], "{files}: {found:?} {wanted:?}");
            }
        }
        // What has no residual shows none, and everything else is drawn.
        desk.run(&format!("figures {folder} --quiet")).fine();
        assert!(!desk.all_files(&folder).iter().any(|file| file.contains("residual")), "{folder}");
        desk.run(&format!("figures {folder} --quantity residual")).refused(&["imported", "no residual"]);
        desk.run(&format!("view {folder} --quiet")).fine();
        desk.run(&format!("export {folder} --to csv,vtu,npz --quiet")).fine();
        assert!(desk.read(&format!("{folder}/csv/000001.csv")).contains("that"), "{folder}");
    }
}

#[test]
fn points_that_were_not_measured_are_left_out_and_a_frame_keeps_its_nodes() {
    let desk = Desk::new();
    let line = |[x, y, u, v]: [f64; 4], sigma: f64| format!("{x},{y},{u},{v},{sigma}");
    let names = "x,y,u,v,sigma";
    desk.write("a_1.txt", table(names, |p| line(p, 0.02)));
    desk.write("a_2.txt", table(names, |p| line(p, if p[0] == 56.0 && p[1] == 48.0 { -1.0 } else { 0.02 })));
    desk.write(
        "a_10.txt",
        table(names, |p| if p[0] < 60.0 { line(p, 0.02) } else { format!("{},{},NaN,,0.02", p[0], p[1]) }),
    );
    let ran = desk.run_words(&["import", "a_*.txt", "--output", "out"]).fine();
    assert!(
        ran.stderr.contains("3 frames of layout vic-2d: 96 nodes, 77 elements, 0 points without element, 49 not valid"),
        "{ran}"
    );
    desk.run("export out --to csv --quiet").fine();
    let count = |frame: usize| desk.rows(&format!("out/csv/{frame:06}.csv")).len();
    assert_eq!([count(1), count(2), count(3)], [96, 95, 48]);
    let row = &desk.rows("out/csv/000001.csv")[0];
    assert_eq!((row.px.position, row.px.sigma), ([16.0, 16.0], [0.02; 2]));
    // Nothing is replaced unasked, and a frame without a point is told by the exit status.
    desk.run("import a_1.txt --output out").refused(&["holds the results of another run", "--overwrite"]);
    desk.write("b.txt", table(names, |p| line(p, -1.0)));
    desk.run("import a_1.txt b.txt --output out --overwrite").incomplete();
}

#[test]
fn noise_is_stated_measured_at_rest_or_asked_for() {
    let desk = Desk::new();
    let line = |p: [f64; 4]| p.map(|v| v.to_string()).join(",");
    desk.write("a.txt", table("x_px,y_px,u_px,v_px", line));
    desk.run("import a.txt --y down --output out").refused(&["--static", "--sigma"]);
    assert!(!desk.path("out").exists());
    desk.run("import a.txt --y down --output out --sigma=-1").refused(&["--sigma is -1"]);
    // A motion with a gradient is no noise; what is off it is: by 0.03 px along x, 0.01 px along y, in turn.
    let rough = |[x, y, u, v]: [f64; 4]| {
        let sign = if ((x + y) / 8.0) as i64 % 2 == 0 { 1.0 } else { -1.0 };
        line([x, y, u + 0.03 * sign, v - 0.01 * sign])
    };
    desk.write("rest.txt", table("x_px,y_px,u_px,v_px", rough));
    desk.run("import a.txt --y down --static rest.txt --output out").fine();
    let sigma = &desk.json("out/import.json")["sigma_px"];
    // 96 points of which three fix the plane.
    let wanted = (96.0_f64 / 93.0).sqrt();
    for (c, off) in [0.03, 0.01].into_iter().enumerate() {
        assert!((sigma[c].as_f64().unwrap() / (off * wanted) - 1.0).abs() < 1e-3, "{sigma}");
    }
    desk.run("import a.txt --y down --static a.txt --output again").refused(&["do not scatter"]);
}

#[test]
fn what_a_file_leaves_open_is_asked_and_what_is_no_field_is_named() {
    let desk = Desk::new();
    let line = |p: [f64; 4]| p.map(|v| v.to_string()).join(",");
    let cases: [(&str, String, &str, &[&str]); 12] = [
        (
            "unit.txt",
            table("x,y,u,v", line),
            "--y up --sigma 1",
            &["unit.txt", "in which unit column 'x' is", "--unit px"],
        ),
        ("axis.txt", table("x,y,u,v", line), "--unit px --sigma 1", &["axis.txt", "--y up or --y down"]),
        (
            "scale.txt",
            table("x,y,u [mm],v [mm]", line),
            "--unit mm --y up --sigma 1",
            &["column 'x' is a length", "--pixel-size"],
        ),
        (
            "names.txt",
            table("a,b,c,d", line),
            "",
            &["names the columns of a known layout", "found: a, b, c, d", "--layout table"],
        ),
        ("dice.txt", table("x,y,u,v", line), "--layout dice", &["layout dice", "coordinate_x", "found: x, y, u, v"]),
        (
            "short.txt",
            table("x,y,u,v", line) + "1,2\n",
            "--unit px --y up --sigma 1",
            &["line 98 has 2 columns, the names 4"],
        ),
        (
            "word.txt",
            table("x,y,u,v", line) + "1,2,left,4\n",
            "--unit px --y up --sigma 1",
            &["line 98, column 'u': 'left'"],
        ),
        (
            "twice.txt",
            table("x,y,u,v", line) + "16,16,0,0\n",
            "--unit px --y down --sigma 1",
            &["two points are at the place (16, 16)"],
        ),
        ("mat.txt", "MATLAB 7.3 MAT-file".into(), "", &["mat.txt", "the HDF5 file cannot be read"]),
        ("ncorr.txt", table("x,y,u,v", line), "--layout ncorr", &["layout ncorr: it is in HDF5"]),
        ("zip.txt", "PK\x03\x04".into(), "", &["the archive cannot be read"]),
        (
            "line.txt",
            "x_px,y_px,disp_u,disp_v\n1,1,0,0\n2,1,0,0\n3,1,0,0\n4,1,0,0\n5,1,0,0\n".into(),
            "--sigma 1",
            &["form no grid", "regular grid"],
        ),
    ];
    for (file, text, options, wanted) in cases {
        desk.write(file, text);
        desk.run(&format!("import {file} {options} --output out")).refused(wanted);
    }
    assert!(!desk.path("out").exists());
    desk.run("import none.txt --output out").refused(&["none.txt", "cannot be read"]);
    desk.run("import unit.txt --layout vic --output out").refused(&["vic-2d, ncorr, dic-exchange, table"]);
}

#[test]
fn arrays_of_a_series_are_its_frames_and_two_bodies_are_two_zones() {
    let desk = Desk::new();
    let points: Vec<[f64; 4]> = grid().into_iter().filter(|[_, y, ..]| *y != 48.0).collect();
    let mut file = NpzWriter::new(std::io::Cursor::new(Vec::new()));
    let flat = |values: Vec<Vec<f64>>| Values::F64(values.concat());
    file.table("coordinates", 2, &flat(points.iter().map(|p| p[..2].to_vec()).collect())).unwrap();
    // Two frames: half the displacement, and all of it.
    for (name, c) in [("disp_u", 2), ("disp_v", 3)] {
        file.table(name, 2, &flat(points.iter().map(|p| vec![0.5 * p[c], p[c]]).collect())).unwrap();
    }
    desk.write("field.npz", file.finish().unwrap().into_inner());
    let ran = desk.run("import field.npz --sigma 0.01 --output out").fine();
    assert!(ran.stderr.contains("2 frames of layout pyaldic: 84 nodes, 55 elements"), "{ran}");
    desk.run("probe out --opening 1,2 --quiet").fine();
    let found = gauge(&desk, "out", "40,24,40,64");
    assert!((found["strain_engineering"] - 0.01).abs() < 1e-9, "{found:?}");
}

/// A file of MATLAB with these columns of numbers.
fn mat(arrays: &[(&str, Vec<Vec<f64>>)]) -> Vec<u8> {
    let mut file = MatWriter::new(Vec::new(), "test").unwrap();
    for (name, rows) in arrays {
        file.table(name, rows[0].len(), &Values::F64(rows.concat())).unwrap();
    }
    file.finish().unwrap()
}

/// The same with every array packed, as MATLAB saves.
fn packed(mat: &[u8]) -> Vec<u8> {
    let (head, mut rest) = mat.split_at(128);
    let mut file = head.to_vec();
    while !rest.is_empty() {
        let len = u32::from_le_bytes(rest[4..8].try_into().unwrap()) as usize;
        let (element, behind) = rest.split_at(8 + len);
        let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
        encoder.write_all(element).unwrap();
        let data = encoder.finish().unwrap();
        file.extend([&15_u32.to_le_bytes()[..], &(data.len() as u32).to_le_bytes(), &data].concat());
        rest = behind;
    }
    file
}

#[test]
fn arrays_of_matlab_are_read_packed_or_not_and_what_they_lack_is_named() {
    let desk = Desk::new();
    let column = |of: &dyn Fn([f64; 4]) -> f64| grid().into_iter().map(|p| vec![of(p)]).collect::<Vec<_>>();
    let [x, y, u, v] = [0, 1, 2, 3].map(|k| column(&|p| p[k]));
    let marked = column(&|p| if p[..2] == [16.0, 16.0] { -1.0 } else { 0.02 });
    let vic = mat(&[("x", x.clone()), ("y", y), ("u", u.clone()), ("v", v.clone()), ("sigma", marked)]);
    desk.write("vic.mat", packed(&vic));
    let ran = desk.run("import vic.mat --output vic").fine();
    assert!(ran.stderr.contains("1 frame of layout vic-2d"), "{ran}");
    let record = desk.json("vic/import.json");
    assert_eq!((&record["n_invalid"], &record["sigma_from"]), (&1.into(), &"file".into()));
    let both = |c: usize| grid().into_iter().map(|p| vec![0.5 * p[c], p[c]]).collect::<Vec<_>>();
    let at = grid().into_iter().map(|p| p[..2].to_vec()).collect::<Vec<_>>();
    desk.write("aldic.mat", mat(&[("coordinates", at), ("disp_u", both(2)), ("disp_v", both(3))]));
    let ran = desk.run("import aldic.mat --sigma 0.01 --output aldic").fine();
    assert!(ran.stderr.contains("2 frames of layout pyaldic"), "{ran}");
    let found = gauge(&desk, "aldic", "40,24,40,64");
    assert!((found["strain_engineering"] - 0.01).abs() < 1e-9, "{found:?}");
    // What is missing, of another length, cut off or no packed data.
    for (file, content, wanted) in [
        (
            "lacks.mat",
            mat(&[("x", x.clone()), ("u", u.clone())]),
            "no array coordinates, and no x, y, u, v; found: u, x",
        ),
        (
            "short.mat",
            mat(&[("x", x.clone()), ("y", x[1..].to_vec()), ("u", u), ("v", v), ("sigma", x)]),
            "y has not the",
        ),
        ("cut.mat", vic[..vic.len() - 100].to_vec(), "is cut off"),
        ("bad.mat", [&vic[..128], &[15, 0, 0, 0, 4, 0, 0, 0, 1, 2, 3, 4]].concat(), "cannot be unpacked"),
    ] {
        desk.write(file, content);
        desk.run(&format!("import {file} --sigma 1 --output none")).refused(&[file, wanted]);
    }
}

#[test]
fn files_in_hdf5_of_ncorr_matlab_and_the_exchange_are_read_as_h5py_writes_them() {
    // Made by scripts/hdf5_seeds.py.
    let desk = Desk::new();
    let seed = |name: &str| std::fs::read(format!("{}/fuzz/seeds/fields/{name}", env!("CARGO_MANIFEST_DIR"))).unwrap();
    for (file, options, said, n_invalid) in [
        ("ncorr-one.mat", "--sigma 0.01", "1 frame of layout ncorr: 95 nodes", 1),
        ("ncorr.mat", "--sigma 0.01", "2 frames of layout ncorr: 95 nodes", 2),
        ("vic73.mat", "", "1 frame of layout vic-2d: 95 nodes", 1),
        (
            "exchange.h5",
            "--sigma 0.01 --unit mm --y up --pixel-size 0.05",
            "2 frames of layout dic-exchange: 96 nodes",
            1,
        ),
    ] {
        desk.write(file, seed(file));
        let folder = format!("out-{file}");
        let ran = desk.run(&format!("import {file} {options} --output {folder}")).fine();
        assert!(ran.stderr.contains(said), "{ran}");
        assert_eq!(desk.json(&format!("{folder}/import.json"))["n_invalid"], n_invalid, "{file}");
        // 40 px along y under a stretch of 1 %.
        let found = gauge(&desk, &folder, "40,24,40,48");
        assert!((found["strain_engineering"] - 0.01).abs() < 1e-9, "{file}: {found:?}");
        assert!((found["elongation_px"] - 0.24).abs() < 1e-7, "{file}: {found:?}");
    }
    let exchange = "import exchange.h5 --sigma 0.01 --output none";
    desk.run(exchange).refused(&["vector/coordinates", "--unit"]);
    desk.run(&format!("{exchange} --unit mm --pixel-size 0.05")).refused(&["--y up"]);
    desk.run(&format!("{exchange} --layout ncorr")).refused(&["has the layout dic-exchange"]);
    let cut = seed("ncorr.mat");
    desk.write("cut.mat", &cut[..cut.len() / 2]);
    desk.run("import cut.mat --sigma 1 --output none").refused(&["cut.mat"]);
}

/// A model of one element over the whole image with displacements linear in the position, as an input file of Abaqus
/// and the report of its displacements: mm, y up, origin at the lower left corner of the image.
fn model(desk: &Desk, u: impl Fn(f64, f64) -> [f64; 2]) {
    let corners = [[0.0, 0.0], [1.28, 0.0], [1.28, 0.96], [0.0, 0.96]];
    let (mut mesh, mut table) =
        ("*Heading\n*Node\n".to_owned(), "  Node   U.U1   U.U2\n  Label  @Loc 1  @Loc 1\n".to_owned());
    for (k, [x, y]) in (1..).zip(corners) {
        let [ux, uy] = u(x, y);
        let _ = writeln!(mesh, "{k}, {x}, {y}");
        let _ = writeln!(table, "  {k}  {ux:E}  {uy:E}");
    }
    desk.write("job.inp", mesh + "*Element, type=CPS4R\n1, 1, 2, 3, 4\n");
    desk.write("job.rpt", table);
}

#[test]
fn a_model_is_laid_over_the_field_and_the_difference_is_given_in_px_mm_and_sigmas() {
    let desk = Desk::with_series();
    desk.correlate(&format!("{INSIDE} --pixel-size 0.01 --output run ref.png a.png")).fine();
    // The image moves by a quarter of a pixel along x and up; the model by 0.35 px along x and as far up.
    model(&desk, |_, _| [0.0035, 0.0025]);
    let line = "compare run job.inp --displacements job.rpt --origin 0,95";
    let said = desk.run(line).printed();
    assert!(said.starts_with("frame 1: measured less model 0.07"), "{said}");
    let found = desk.json("run/comparison/000001.json");
    assert_eq!((found["method"].as_str(), found["percent"].as_f64()), (Some("projection"), Some(100.0)));
    let number = |name: &str| found[name].as_f64().unwrap();
    // 0.1 px in one of two components; 0.02 px is what 8 bits leave (tests/commands/cli.rs).
    assert!(
        (number("rms_px") - 0.1 / 2.0_f64.sqrt()).abs() < 0.02 && (number("largest_px") - 0.1).abs() < 0.04,
        "{found}"
    );
    assert!((number("rms_mm") - 0.01 * number("rms_px")).abs() < 1e-15 && number("rms_sigma") > 3.0, "{found}");
    let text = desk.read("run/comparison/000001.csv");
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_reader(text.as_bytes());
    for row in reader.deserialize::<BTreeMap<String, f64>>().map(|row| row.unwrap()) {
        // The projection of a constant is that constant.
        assert!((row["model_ux_px"] - 0.35).abs() < 1e-9 && (row["model_uy_px"] + 0.25).abs() < 1e-9, "{row:?}");
        assert!((row["ux_px"] - row["model_ux_px"] - row["difference_ux_px"]).abs() < 1e-12, "{row:?}");
        assert!((row["difference_ux_px"] / row["sigma_ux_px"] - row["difference_ux_sigma"]).abs() < 1e-9, "{row:?}");
        assert!((row["difference_ux_mm"] - 0.01 * row["difference_ux_px"]).abs() < 1e-15, "{row:?}");
    }
    for name in ["difference", "difference-sigma"] {
        assert!(desk.path(&format!("run/comparison/000001-{name}.png")).is_file());
    }
    // A rigid motion is all that is between them.
    desk.run(&format!("{line} --remove-rigid")).printed();
    let found = desk.json("run/comparison/000001.json");
    assert!(found["rms_px"].as_f64().unwrap() < 0.02, "{found}");
    let shift = &found["rigid_motion"]["translation"];
    assert!((shift[0].as_f64().unwrap() + 0.1).abs() < 0.02, "{found}");
    // Beside the model, and without what it needs.
    desk.run("compare run job.inp --displacements job.rpt --origin 9000,0")
        .refused(&["covers no measured element", "--origin"]);
    desk.run("compare run job.inp").refused(&["job.inp", "--displacements"]);
}

#[test]
fn a_stretch_of_another_program_and_of_a_model_agree_at_the_points_and_borders_go_out() {
    let desk = Desk::new();
    let line = |p: [f64; 4]| p.map(|v| v.to_string()).join(",");
    desk.write("a.txt", table("x_px,y_px,u_px,v_px", line));
    desk.run("import a.txt --y down --sigma 0.01 --pixel-size 0.01 --output out").fine();
    // The same stretch: y_px = 95 - y / 0.01, and mm are hundredths of px.
    model(&desk, |x, y| [0.01 * (0.25 + 0.01 * x), -0.01 * (-0.5 + 0.01 * (95.0 - 100.0 * y))]);
    desk.run("compare out job.inp --displacements job.rpt --origin 0,95").printed();
    let found = desk.json("out/comparison/000001.json");
    assert_eq!((found["method"].as_str(), found["n_nodes"].as_u64()), (Some("nodes"), Some(96)));
    // Digits of a report.
    assert!(found["largest_px"].as_f64().unwrap() < 1e-9, "{found}");
    // A table of points on a grid is a model as well: the field itself.
    let said = desk.run("compare out a.txt --y down").printed();
    assert!(said.contains("measured less model 0.0000 px"), "{said}");

    desk.run("export out --to boundary --quiet").fine();
    let text = desk.read("out/boundary/000001.csv");
    // The border of 12 by 8 nodes.
    assert_eq!(text.lines().filter(|line| !line.starts_with(['#', 'n'])).count(), 2 * (12 + 8) - 4);
    assert!(text.contains("\n0,all,0.16,-0.16,0.002516,0.0034,"), "{text}");
    let text = desk.read("out/boundary/000001.inp");
    assert!(text.contains("*BOUNDARY\n1, 1, 1, 0.002516") && text.contains("\n1, 2, 2, 0.0034"), "{text}");
}
