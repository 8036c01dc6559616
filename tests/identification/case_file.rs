//! Case files: read, written, and what is said about wrong ones.

use quadrille::field::{
    Brightness, Elements, Noise, NoiseCorrelation, RegularisationKind, StartFrom, StrainDefinition, UnknownChoice,
};
use quadrille::imaging::Interpolation;
use quadrille::io::case::{
    CaseCorrelation, CaseElements, CaseError, CaseFile, CaseGuard, CaseImages, CaseZone, Pages, parse_case, read_case,
    write_case,
};
use quadrille::mesh::Roi;
use std::path::Path;
use tempfile::TempDir;

const FULL: &str = r#"
[images]
reference = "img 0.tif"
deformed = ["img_*.tif", 'last [1].tif']
page = 1
pages = "all"
pixel_size_mm = 0.00193125
max_image_mpx = 64

[correlation]
element_size_px = 16
elements = "bilinear"
element_share = 0.25
interpolation = "quintic"
tolerance_px = 1e-4
max_iterations = 40
brightness = "element"
start = "cold"
update_reference = "every 20"
noise = 2
noise_correlation = 1.8
regularisation = "equilibrium-gap"
cutoff_px = 64.5
poisson = 0.3
strain = "hencky"
strain_window = 5
sigma_most_px = 0.25
drop_textureless = true

[[zone]]
name = "upper"
roi = [10, 20.5, 300, 400]

[[zone]]
roi = [10, 420, 300, 800]
guard_px = { right = 1, bottom = 3.5 }

[[zone]]
polygon = [[1, 2], [30.5, 4], [5, 60]]
exclude = [[[3, 4], [5, 4], [4, 5]], [[6, 4], [8, 4], [7, 5]]]
mask = "mask of plate.png"
guard_px = [0, 2, 1]

[[zone]]
name = "right"
mesh = "plate.msh"
group = "B"
guard_px = 3

[[zone]]
polygon = [[20, 0], [60, 30], [48, 46], [8, 16]]
elements = "mapped"
guard_px = { along = [[20, 0], [60, 30]], width = 3 }

[run]
version = "0.1.0"
device = { name = "CPU", threads = 2 }
"#;

fn full() -> CaseFile {
    CaseFile {
        base: "tests/case".into(),
        images: CaseImages {
            reference: Some(vec!["img 0.tif".into()]),
            deformed: Some(vec!["img_*.tif".into(), "last [1].tif".into()]),
            page: Some(1),
            pages: Some(Pages::All),
            pixel_size_mm: Some(0.00193125),
            max_image_mpx: Some(64),
        },
        correlation: CaseCorrelation {
            element_size_px: Some(16),
            elements: Some(Elements::Bilinear),
            element_share: Some(0.25),
            interpolation: Some(Interpolation::Quintic),
            tolerance_px: Some(1e-4),
            max_iterations: Some(40),
            brightness: Some(Brightness::Element),
            start: Some(StartFrom::Independent),
            update_reference: Some("every 20".parse().unwrap()),
            noise: Some(Noise::Constant(2.0)),
            noise_correlation: Some(NoiseCorrelation::Factor(1.8)),
            regularisation: Some(RegularisationKind::EquilibriumGap),
            cutoff_px: Some(64.5),
            poisson: Some(0.3),
            strain: Some(StrainDefinition::Hencky),
            strain_window: Some(5),
            sigma_most_px: Some(0.25),
            drop_textureless: Some(true),
        },
        zones: vec![
            CaseZone { name: Some("upper".into()), roi: Some([10.0, 20.5, 300.0, 400.0]), ..CaseZone::default() },
            CaseZone {
                roi: Some([10.0, 420.0, 300.0, 800.0]),
                guard_px: Some(CaseGuard::Rectangle { left: 0.0, top: 0.0, right: 1.0, bottom: 3.5 }),
                ..CaseZone::default()
            },
            CaseZone {
                polygon: Some(vec![[1.0, 2.0], [30.5, 4.0], [5.0, 60.0]]),
                exclude: Some(vec![vec![[3.0, 4.0], [5.0, 4.0], [4.0, 5.0]], vec![[6.0, 4.0], [8.0, 4.0], [7.0, 5.0]]]),
                mask: Some("mask of plate.png".into()),
                guard_px: Some(CaseGuard::Sides(vec![0.0, 2.0, 1.0])),
                ..CaseZone::default()
            },
            CaseZone {
                name: Some("right".into()),
                mesh: Some("plate.msh".into()),
                group: Some("B".into()),
                guard_px: Some(CaseGuard::All(3.0)),
                ..CaseZone::default()
            },
            CaseZone {
                polygon: Some(vec![[20.0, 0.0], [60.0, 30.0], [48.0, 46.0], [8.0, 16.0]]),
                elements: Some(CaseElements::Mapped),
                guard_px: Some(CaseGuard::Along { along: vec![[20.0, 0.0], [60.0, 30.0]], width: 3.0 }),
                ..CaseZone::default()
            },
        ],
        run: toml::toml! {
            version = "0.1.0"
            device = { name = "CPU", threads = 2 }
        }
        .into(),
        ..CaseFile::default()
    }
}

fn parse(text: &str) -> Result<CaseFile, CaseError> {
    parse_case(text, Path::new("tests/case/case.toml"))
}

/// The line, the column, the key and the whole message of the error in `text`.
#[track_caller]
fn error(text: &str) -> (usize, usize, Option<String>, String) {
    let error = parse(text).map(|case| format!("{text:?} is read as {case:?}")).unwrap_err();
    let said = error.to_string();
    match error {
        CaseError::Invalid { line, column, key, .. } => (line, column, key, said),
        other => panic!("{other:?}"),
    }
}

#[track_caller]
fn assert_says(text: &str, wanted: &[&str]) {
    let (.., said) = error(text);
    for wanted in wanted {
        assert!(said.contains(wanted), "{said:?} should say {wanted:?}");
    }
}

#[test]
fn every_key_is_read() {
    assert_eq!(parse(FULL).unwrap(), full());
}

#[test]
fn what_is_written_reads_back_equal() {
    let empty = CaseFile { base: "tests/case".into(), ..CaseFile::default() };
    let tiny = CaseFile {
        correlation: CaseCorrelation { tolerance_px: Some(1.0 / 3.0), ..Default::default() },
        ..empty.clone()
    };
    let quoted = CaseFile {
        images: CaseImages { reference: Some(vec!["C:\\a \"b\"\n'\u{e9}.tif".into()]), ..Default::default() },
        ..empty.clone()
    };
    for case in [full(), empty, tiny, quoted] {
        let text = write_case(&case);
        assert!(text.starts_with('#'), "{text}");
        assert_eq!(parse(&text).unwrap(), case, "{text}");
    }
    // What is not said is not written.
    assert_eq!(write_case(&CaseFile::default()).lines().count(), 1);
}

#[test]
fn one_deformed_image_needs_no_list() {
    let case = parse("images.deformed = 'a*.tif'").unwrap();
    assert_eq!(case.images.deformed, Some(vec!["a*.tif".to_owned()]));
}

#[test]
fn a_written_run_can_be_run_again_whatever_it_says() {
    let case = parse("[run]\nstarted = 2026-01-02T03:04:05Z\nnested = { a = [1, { b = 2 }] }").unwrap();
    assert_eq!(CaseFile { run: None, ..case }, CaseFile { base: "tests/case".into(), ..CaseFile::default() });
}

#[test]
fn relative_names_start_at_the_folder_of_the_case_file() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("my case.toml");
    std::fs::write(&path, FULL).unwrap();
    let case = read_case(&path).unwrap();
    assert_eq!(case.resolve("img 0.tif"), folder.path().join("img 0.tif"));
    let absolute = folder.path().join("there.tif");
    assert_eq!(case.resolve(&absolute.display().to_string()), absolute);
    assert_eq!(parse_case("", Path::new("case.toml")).unwrap().resolve("a.tif"), Path::new("a.tif"));
}

#[test]
fn a_zone_gives_its_rectangle() {
    let case = parse(FULL).unwrap();
    assert_eq!(case.zones[0].rectangle(), Some(Roi { x0: 10.0, y0: 20.5, x1: 300.0, y1: 400.0 }));
    assert_eq!(CaseZone::default().rectangle(), None);
}

#[test]
fn windows_files_are_read() {
    let text = format!("\u{feff}{}", FULL.replace('\n', "\r\n"));
    assert_eq!(parse(&text).unwrap(), full());
    assert_eq!(error("[images]\r\npage = true").0, 2);
}

#[test]
fn an_unknown_key_is_named_with_its_section_and_the_keys_there_are() {
    let (line, column, key, said) = error("[images]\npage = 0\n\n[correlation]\nnoise = 2\n\n  elemnt_size_px = 16");
    assert_eq!((line, column, key.as_deref()), (7, 3, Some("correlation.elemnt_size_px")));
    let start = "tests/case/case.toml, line 7: unknown key `elemnt_size_px` in [correlation]; did you mean `element_size_px`? \
         expected one of `element_size";
    assert!(said.starts_with(start), "{said}");
    assert_says("[correlaton]", &["line 1", "unknown key `correlaton` at the top level", "`correlation`"]);
    assert_says("[[zone]]\n[[zone]]\nrio = 3", &["line 3", "unknown key `rio` in [[zone]]", "`roi`"]);
}

#[test]
fn a_value_of_the_wrong_kind_is_named_with_what_is_expected() {
    for (line, wanted) in [
        ("element_size_px = 'a'", "`element_size_px` in [correlation]: is the text \"a\", expected a whole number"),
        ("element_size_px = 1.5", "is the number `1.5`, expected a whole number"),
        ("max_iterations = -3", "is the number `-3`, expected a whole number, 0 or larger"),
        ("noise = '2'", "expected a number"),
        ("drop_textureless = 1", "expected true or false"),
        ("interpolation = 'cubik'", "unknown word `cubik`, expected one of `cubic`, `quintic`, `keys`, `bilinear`"),
        ("interpolation = 3", "expected a word in quotes"),
        ("brightness = 'on'", "`auto`, `zone`, `smooth`, `element`, `off`"),
        ("regularisation = 'laplace'", "`none`, `tikhonov`, `equilibrium-gap`"),
        ("strain = 'true'", "`infinitesimal`, `green-lagrange`, `hencky`"),
        ("start = 'warm'", "`previous`"),
        ("update_reference = 'often'", "`often` is not a choice for update-reference; expected never, residual or"),
        ("update_reference = 0", "`0` is not a choice for update-reference"),
        ("update_reference = true", "\"residual\" or \"every N\""),
        ("start = warm", "a text without quotes"),
        ("noise =", "no value"),
    ] {
        assert_says(&format!("[correlation]\n{line}"), &["line 2", wanted]);
    }
    assert_says("images = 3", &["`images` at the top level", "expected a section"]);
    assert_says("run = 3", &["`run` at the top level", "expected a section"]);
    assert_says("zone = 3", &["sections [[zone]]"]);
    assert_says("[zone]\nroi = [1, 2, 3, 4]", &["sections [[zone]]"]);
    assert_says("[images]\npage = [1]", &["is a list, expected a whole number"]);
    assert_says("[images]\nreference = 3", &["a file name or glob in quotes, or a list of them"]);
    assert_says("[images]\ndeformed = 1", &["a file name or glob in quotes, or a list of them"]);
    assert_says("[images]\ndeformed = ['a',\n 'b',\n 3]", &["line 4", "`deformed` in [images]", "a text in quotes"]);
    assert_says("[images]\nreference = \"C:\\data\\a.tif\"", &["line 2", "backslash"]);
    assert_says("[images", &["line 1"]);
}

#[test]
fn a_rectangle_of_three_or_five_numbers_is_refused() {
    for (roi, n) in [("[1, 2, 3]", 3), ("[1, 2, 3, 4, 5]", 5)] {
        let wanted = format!("`roi` in [[zone]]: has {n} entries, expected four numbers [x0, y0, x1, y1]");
        assert_says(&format!("[[zone]]\nname = 'a'\nroi = {roi}"), &["line 3", &wanted]);
    }
    assert_says("[[zone]]\nroi = [1, 2, 3, 'a']", &["expected a number"]);
    assert_says("[[zone]]\nroi = 3", &["four numbers [x0, y0, x1, y1]"]);
}

#[test]
fn a_key_that_is_there_twice_is_named() {
    assert_says("[images]\npage = 1\npage = 2", &["line 3", "the key `page` is there twice"]);
    assert_says("[images]\n[correlation]\n[images]", &["line 3", "`images` is there twice"]);
}

#[test]
fn missing_unreadable_and_foreign_files_are_told_apart() {
    let folder = TempDir::new().unwrap();
    let error = read_case(&folder.path().join("none.toml")).unwrap_err();
    assert!(matches!(error, CaseError::NotFound { .. }) && error.to_string().contains("none.toml"), "{error}");
    let error = read_case(folder.path()).unwrap_err();
    assert!(matches!(error, CaseError::Io { .. }), "{error}");
    let path = folder.path().join("latin.toml");
    std::fs::write(&path, b"[images]\nreference = 'caf\xe9.tif'\n").unwrap();
    let error = read_case(&path).unwrap_err();
    assert!(matches!(error, CaseError::NotText { line: 2, .. }), "{error}");
}

#[test]
fn choices_have_the_same_words_in_files_and_options() {
    for choice in Brightness::ALL {
        assert_eq!(choice.to_string().parse(), Ok(choice));
        let case = parse(&format!("correlation.brightness = '{choice}'")).unwrap();
        assert_eq!(case.correlation.brightness, Some(choice));
    }
    for choice in [StartFrom::Previous, StartFrom::Independent] {
        assert_eq!(choice.to_string().parse(), Ok(choice));
        let case = parse(&format!("correlation.start = '{choice}'")).unwrap();
        assert_eq!(case.correlation.start, Some(choice));
    }
    let error: UnknownChoice = "dark".parse::<Brightness>().unwrap_err();
    assert_eq!(error.to_string(), "`dark` is not a choice for brightness; expected auto, zone, smooth, element or off");
    assert!("warm".parse::<StartFrom>().unwrap_err().to_string().contains("previous or independent"));
}

#[test]
fn several_references_are_a_list_and_one_is_a_text() {
    let case = parse("images.reference = ['a.tif', 'b_*.tif']").unwrap();
    assert_eq!(case.images.reference, Some(vec!["a.tif".to_owned(), "b_*.tif".to_owned()]));
    assert!(write_case(&case).contains("reference = [\"a.tif\", \"b_*.tif\"]"), "{}", write_case(&case));
    let case = parse("images.reference = ['a.tif']").unwrap();
    assert!(write_case(&case).contains("reference = \"a.tif\""), "{}", write_case(&case));
}

#[test]
fn wrong_polygons_and_guards_are_named_with_what_is_expected() {
    for (line, wanted) in [
        ("polygon = [[1, 2], [3]]", "`polygon` in [[zone]]: a point has 1 entry, expected a point [x, y]"),
        ("polygon = [[1, 2], 3]", "expected a point [x, y]"),
        ("polygon = [['1', 2]]", "expected a number"),
        ("exclude = [[[1, 2], [3, 4, 5]]]", "`exclude` in [[zone]]: a point has 3 entries"),
        ("guard_px = true", "`guard_px` in [[zone]]: is `true`, expected a number of pixels, { left = 0, top = 0"),
        (
            "guard_px = { lower = 1 }",
            "`guard_px` in [[zone]]: unknown side `lower`, expected left, top, right or bottom",
        ),
        ("elements = 'mapped by hand'", "unknown word `mapped by hand`"),
        ("guard_px = { along = [[1, 2], [3, 4]] }", "a guard along a line needs along = [[x, y], ...]"),
        ("guard_px = { along = [[1, 2]], width = 3 }", "two points or more"),
        ("guard_px = { along = [[1, 2], [3, 4]], width = 3, left = 1 }", "no sides"),
        ("guard_px = { along = [[1, 2], [3]], width = 3 }", "a point has 1 entry"),
        ("guard_px = { left = 'a' }", "is the text \"a\", expected a number"),
        ("guard_px = [1, 'a']", "expected a number"),
    ] {
        assert_says(&format!("[[zone]]\n{line}"), &["line 2", wanted]);
    }
    assert_says("images.pages = 'some'", &["unknown word `some`", "`all`"]);
}

#[test]
fn sections_of_quantities_are_read_written_and_refused_in_words() {
    let text = "[quantities]\nremove_rigid = \"all\"\n[load]\nfile = \"load.csv\"\n[[probe]]\npoint = [1, 2.5]\n\
                [[line]]\nname = \"a\"\nfrom = [1, 2]\nto = [3, 4]\nstep_px = 2\n[[extensometer]]\nfrom = [1, 2]\n\
                to = [3, 4]\nwidth_px = 9\n[[opening]]\nzones = [\"up\", \"down\"]\n";
    let case = parse(text).unwrap();
    let drawn = case.drawn();
    assert!(!drawn.is_empty() && CaseFile::default().drawn().is_empty());
    assert_eq!(drawn.load.as_ref().unwrap().file, Path::new("tests/case/load.csv").display().to_string());
    assert_eq!((drawn.probes[0].point, drawn.lines[0].step_px), ([1.0, 2.5], Some(2.0)));
    assert_eq!(drawn.openings[0].zones, ["up", "down"]);
    assert_eq!(parse(&write_case(&case)).unwrap(), case);
    let moved = CaseFile { base: "tests/case".into(), ..CaseFile::default() }.with_drawn(&drawn);
    assert_eq!(moved.extensometers, case.extensometers);
    // A load file alone draws nothing.
    assert!(parse("load.file = 'a.csv'").unwrap().drawn().is_empty());

    assert_says("[[probe]]\npoint = [1, 2, 3]", &["`point` in [[probe]]", "3 entries, expected two numbers [x, y]"]);
    assert_says("[[probe]]\npoint = 3", &["`point` in [[probe]]", "two numbers [x, y]"]);
    assert_says("[[probe]]\nname = 'a'", &["the key `point` is missing"]);
    assert_says("probe = 3", &["sections [[probe]]"]);
    assert_says("[[line]]\nfrom = [1, 2]\nto = [3, 4]\nstep = 2", &["unknown key `step`", "step_px"]);
    assert_says("[[opening]]\nzones = ['up']", &["1 entry, expected two names"]);
    assert_says("[quantities]\nremove_rigid = 'each'", &["remove_rigid", "all"]);
    assert_says("[load]\nfile = 3", &["`file` in [load]", "text in quotes"]);
}
