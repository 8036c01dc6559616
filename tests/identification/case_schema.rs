//! Case files, their schema and the reference of their keys: that no section is lost, and that all three say the same.

use crate::common::schema;
use quadrille::correlate::Options;
use quadrille::field::{StrainDefinition, UpdateReference};
use quadrille::io::case::{CaseDocument, CaseFile, case_reference, case_schema};
use quadrille::io::images::Accepted;
use quadrille::io::run_case::parse_run_case;
use quadrille::mechanics::case_laws;
use quadrille::run::{Images, Plan, Request};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;
use toml::Table;

/// A case for `quadrille run` with every way to write a key.
const RUN: &str = r#"# A case
[images]
reference = "images/0.png"
deformed = ["images/*.png", 'more [1].png']
pixel_size_mm = 0.00193

[correlation]
element_size_px = 16
noise = { a = 1.5, b = 0.05 }
update_reference = "residual"

[[zone]]  # below
name = "lower"
roi = [10, 90, 90.5, 140]

[[zone]]
name = "upper"
roi = [
  10, 10,
  90.5, 58,
]
guard_px = 3

[quantities]
remove_rigid = "all"
[load]
file = """
[fit]
load.csv"""
[[probe]]
point = [20, 30]
[[opening]]
zones = ["upper", "lower"]

[interface]
zones = ["lower", "upper"]
guard_px = 2.5

[mesh]
refine = 2
[boundary]
remove_rigid_motion = "overall"

[substrate]
plane = "strain"
E_MPa = 72000
nu = 0.33
exact = ["nu"]
[substrate.upper]
model = "linear-elastic"
E_MPa = 3000.0
nu = 0.3

[cohesive]
phi_n_N_per_mm = 1.0
delta_n_mm = 5e-3
delta_t_mm = 0.05
r = 4.0
r_std = 0.5
kinematics = "objective"

[output]
figures = [1, 10]
substrate_sensitivities = true

[measurement]
nodes = "free"
weights = "covariance"

[fit]
parameters = ["phi_n", "delta_n"]
bootstrap = 12
exact = true
seed = 7
start.phi_n = 1.5
upper = { phi_n = 10 }
[fit.lower]
phi_n = 0.1
"#;

/// Every value with the path of its key. Whole numbers are numbers, and a list of one name is the name, as in the typed
/// case.
fn leaves(table: &Table) -> BTreeMap<String, String> {
    fn walk(value: &toml::Value, path: String, found: &mut BTreeMap<String, String>) {
        match value {
            toml::Value::Table(table) => {
                table.iter().for_each(|(key, value)| walk(value, format!("{path}.{key}"), found));
            }
            toml::Value::Array(list) => match list.as_slice() {
                [only @ toml::Value::String(_)] => walk(only, path, found),
                list => list.iter().enumerate().for_each(|(k, value)| walk(value, format!("{path}[{k}]"), found)),
            },
            toml::Value::Integer(number) => drop(found.insert(path, format!("{:?}", *number as f64))),
            toml::Value::Float(number) => drop(found.insert(path, format!("{number:?}"))),
            other => drop(found.insert(path, other.to_string())),
        }
    }
    let mut found = BTreeMap::new();
    table.iter().for_each(|(key, value)| walk(value, key.clone(), &mut found));
    found
}

/// `text` with one to three characters deleted, doubled or changed, all three kinds alike.
fn mutated(text: &str, random: &mut ChaCha8Rng) -> String {
    const OTHERS: [char; 17] = ['[', ']', '"', '\'', '#', '=', '.', ',', '\n', ' ', '{', '}', '0', '9', 'a', '_', '\\'];
    let mut characters: Vec<char> = text.chars().collect();
    for _ in 0..random.random_range(1..=3) {
        let at = random.random_range(0..characters.len());
        match random.random_range(0..3) {
            0 => drop(characters.remove(at)),
            1 => characters.insert(at, characters[at]),
            _ => characters[at] = OTHERS[random.random_range(0..OTHERS.len())],
        }
    }
    characters.into_iter().collect()
}

/// The first of `plain` that `typed` does not say.
fn lost(plain: &BTreeMap<String, String>, typed: &BTreeMap<String, String>) -> Option<String> {
    plain.iter().find(|(key, value)| typed.get(*key) != Some(value)).map(|(key, value)| format!("{key} = {value}"))
}

fn json(text: &str) -> Value {
    serde_json::to_value(text.parse::<Table>().unwrap()).unwrap()
}

#[test]
fn whatever_is_accepted_is_read_whole() {
    let schema = case_schema(&case_laws());
    let path = Path::new("case.toml");
    let (mut accepted, mut run) = (0, 0);
    for seed in 0..6000 {
        let text = mutated(RUN, &mut ChaCha8Rng::seed_from_u64(seed));
        let Ok(document) = CaseDocument::parse(&text, path) else { continue };
        accepted += 1;
        let table: Table = text.parse().unwrap_or_else(|error| panic!("seed {seed}: no TOML: {error}\n{text}"));
        let plain = leaves(&table);
        let typed = leaves(&document.case.to_toml().parse().unwrap());
        assert_eq!(lost(&plain, &typed), None, "seed {seed} of the case\n{text}");
        // The schema says the same; it knows the names of laws and of what they take beside.
        let of_law = |fault: &String| fault.starts_with(".substrate") || fault.starts_with(".cohesive");
        let faults: Vec<_> = schema::faults(&schema, &json(&text)).into_iter().filter(|fault| !of_law(fault)).collect();
        assert!(faults.is_empty(), "seed {seed}: {faults:?}\n{text}");
        let Ok(case) = parse_run_case(&text, path) else { continue };
        run += 1;
        let mut typed = leaves(&case.correlation.to_toml().parse().unwrap());
        let joint = CaseFile { interface: Some(case.interface), ..case.joint };
        typed.extend(leaves(&joint.to_toml().parse().unwrap()));
        // The zones are made to meet the adhesive.
        let plain = plain.into_iter().filter(|(key, _)| !key.starts_with("zone")).collect();
        assert_eq!(lost(&plain, &typed), None, "seed {seed} of the run\n{text}");
    }
    // Comments, texts and digits can be changed; less means that the test tries nothing.
    assert!(accepted > 700 && run > 600, "{accepted} accepted, {run} as a run");
}

#[test]
fn a_case_says_what_its_text_says() {
    let document = CaseDocument::parse(RUN, Path::new("a/case.toml")).unwrap();
    let again = CaseDocument::parse(&document.case.to_toml(), Path::new("a/case.toml")).unwrap();
    assert_eq!(again.case, document.case);
    // The section in a text is no section.
    assert!(document.case.load.as_ref().unwrap().file.contains("[fit]"));
    assert!(parse_run_case(RUN, Path::new("case.toml")).unwrap().has_fit());
}

#[test]
fn a_section_for_another_command_is_refused_with_that_command() {
    let parse = |text: &str| CaseDocument::parse(text, Path::new("case.toml")).unwrap();
    let said = parse("[images]\npage = 1\n[fit]\nparameters = []").correlation().unwrap_err().to_string();
    let wanted = "case.toml, line 3: [fit] is for quadrille simulate, identify, run; it is not taken by: correlate, \
                  watch, slurm, probe, reduce";
    assert_eq!(said, wanted);
    let said = parse("mesh.columns = 1\n[images]\npage = 1").joint().unwrap_err().to_string();
    assert!(said.contains("line 2: [images] is for quadrille correlate"), "{said}");
    let said = parse("[mesh]\ncolumns = 1\n").joint().unwrap_err().to_string();
    assert!(said.starts_with("case.toml: [boundary] is missing; give file"), "{said}");
}

#[test]
fn faults_in_the_sections_of_a_joint_are_told_with_line_section_key_and_the_key_meant() {
    for (from, to, wanted) in [
        ("refine = 2", "refin = 2", "line 40: unknown key `refin` in [mesh]; did you mean `refine`? expected one of"),
        ("seed = 7", "seeds = 7", "unknown key `seeds` in [fit]; did you mean `seed`?"),
        ("seed = 7", "colour = 7", "unknown key `colour` in [fit]; expected one of"),
        ("[output]", "[outputs]", "unknown key `outputs` at the top level; did you mean `output`?"),
        ("r = 4.0", "r = \"4\"", "`r` in [cohesive]: is the text \"4\", expected a number"),
        ("nu = 0.3\n", "nu = true\n", "`nu` in [substrate.upper]: is `true`, expected a number"),
        ("\"strain\"", "\"bending\"", "`plane` in [substrate]: unknown word `bending`, expected `stress` or `strain`"),
        (
            "[\"nu\"]",
            "\"nu\"",
            "`exact` in [substrate]: is the text \"nu\", expected true for all of the section, or a list",
        ),
        (
            "\"objective\"",
            "\"exact\"",
            "`kinematics` in [cohesive]: unknown word `exact`, expected one of `paper`, `objective`, `finite`",
        ),
        ("\"free\"", "\"fre\"", "`nodes` in [measurement]: unknown word `fre`, expected `selected` or `free`"),
        ("\"free\"", "1.5", "`nodes` in [measurement]: is the number `1.5`, expected \"selected\", \"free\" or a list"),
        ("bootstrap = 12", "bootstrap = -1", "expected \"auto\" or a number of draws from 0 to 10000"),
        ("phi_n = 0.1", "phi_n = '0.1'", "`phi_n` in [fit.lower]: is the text \"0.1\", expected a number"),
        ("[\"lower\", \"upper\"]", "[\"lower\"]", "`zones` in [interface]: has 1 entry, expected two names [\"lower\""),
        // Such a header was none for the cutting by text that there was: the section was taken and not read.
        ("[fit]\nparam", "[9fit]\nparam", "unknown key `9fit` at the top level; did you mean `fit`?"),
        ("[output]", "[fit]", "the key `fit` is there twice"),
        ("[fit.lower]", "[[fit.lower]]", "`lower` in [fit]"),
    ] {
        assert!(RUN.contains(from), "{from}");
        let text = RUN.replacen(from, to, 1);
        let said = CaseDocument::parse(&text, Path::new("case.toml")).expect_err(to).to_string();
        assert!(said.starts_with("case.toml, line ") && said.contains(wanted), "{said}");
    }
}

#[test]
fn case_files_in_documents_and_help_are_accepted_by_parser_and_schema() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let schema = case_schema(&case_laws());
    let pages = |folder: &str| std::fs::read_dir(root.join(folder)).unwrap().map(|entry| entry.unwrap().path());
    let mut files: Vec<_> = pages("docs").chain(pages("docs/tutorials")).collect();
    files.retain(|path| path.extension().is_some_and(|ending| ending == "md"));
    files.push(root.join("README.md"));
    let mut found = 0;
    let mut accepted = |text: &str, place: &str| {
        found += 1;
        if let Err(error) = CaseDocument::parse(text, Path::new(place)) {
            panic!("{error}\n{text}");
        }
        let faults = schema::faults(&schema, &json(text));
        assert!(faults.is_empty(), "{place}: {faults:?}\n{text}");
    };
    for file in files {
        let text = std::fs::read_to_string(&file).unwrap();
        for block in text.split("```toml\n").skip(1) {
            accepted(block.split("```").next().unwrap(), &file.display().to_string());
        }
    }
    accepted(RUN, "this file");
    let help =
        std::process::Command::new(env!("CARGO_BIN_EXE_quadrille")).args(["simulate", "--help"]).output().unwrap();
    let help = String::from_utf8(help.stdout).unwrap();
    let example = help.split("Example of a case file:\n").nth(1).and_then(|rest| rest.split("\n\n").next()).unwrap();
    accepted(example, "simulate --help");
    assert!(found >= 8, "{found} case files");
}

#[test]
fn the_schema_refuses_what_the_parser_refuses() {
    let schema = case_schema(&case_laws());
    for (from, to) in [
        ("refine = 2", "refin = 2"),
        ("refine = 2", "refine = -2"),
        ("r = 4.0", "r = \"4\""),
        ("r_std", "s_std"),
        ("\"linear-elastic\"", "\"wood\""),
        ("nu = 0.3\n", "nu = true\n"),
        ("\"strain\"", "\"bending\""),
        ("\"free\"", "\"fre\""),
        ("bootstrap = 12", "bootstrap = \"many\""),
        ("[\"lower\", \"upper\"]", "[\"lower\"]"),
        ("guard_px = 3", "guard_px = { lower = 1 }"),
        ("element_size_px = 16", "element_size_px = 1.5"),
        ("point = [20, 30]", "name = \"a\""),
        ("deformed = [\"images/*.png\", 'more [1].png']", "deformed = 3"),
        ("noise = { a = 1.5, b = 0.05 }", "noise = { a = 1.5 }"),
        ("\"residual\"", "true"),
        ("[output]", "[outputs]"),
    ] {
        assert!(RUN.contains(from), "{from}");
        let text = RUN.replacen(from, to, 1);
        assert!(!schema::faults(&schema, &json(&text)).is_empty(), "{to} is accepted");
    }
}

#[test]
fn defaults_in_the_schema_are_those_of_the_code() {
    let schema = case_schema(&case_laws());
    let images = Images { reference: Vec::new(), deformed: Vec::new(), grows: false, said: Vec::new() };
    let plan = Plan::with(&Request::default(), &CaseFile::default(), images).unwrap();
    assert_eq!(plan.options, Options { n_references: 0, ..Options::default() });
    let fields = (plan.update, plan.strain, plan.strain_window, plan.accepted);
    assert_eq!(fields, (UpdateReference::Never, StrainDefinition::default(), None, Accepted::default()));
    let most = &schema["properties"]["images"]["properties"]["max_image_mpx"]["default"];
    assert_eq!(*most, Accepted::default().max_mpx);
    let evaluations = quadrille::identify::TrustRegionOptions::default().max_evaluations;
    assert_eq!(schema["properties"]["fit"]["properties"]["max_evaluations"]["default"], evaluations);
}

#[test]
fn the_reference_of_keys_is_the_one_in_the_documents() {
    let there = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/case.md")).unwrap_or_default();
    let wanted = written(&["about", "case"]);
    let line = there.lines().zip(wanted.lines()).position(|(there, wanted)| there != wanted);
    assert!(
        there == wanted,
        "docs/case.md is not what the schema says (line {:?}); write it: quadrille about case > docs/case.md",
        line.map(|line| line + 1)
    );
}

fn written(arguments: &[&str]) -> String {
    let done = std::process::Command::new(env!("CARGO_BIN_EXE_quadrille")).args(arguments).output().unwrap();
    assert!(done.status.success() && done.stderr.is_empty());
    String::from_utf8(done.stdout).unwrap()
}

/// Takes out what the program adds: the flags of keys.
fn without_flags(schema: &mut Value) {
    match schema {
        Value::Object(keys) => {
            keys.remove("x-flag");
            keys.values_mut().for_each(without_flags);
        }
        Value::Array(list) => list.iter_mut().for_each(without_flags),
        _ => {}
    }
}

/// Flags of `quadrille correlate` that are not keys of a case, and why.
const NOT_KEYS: [(&str, &str); 16] = [
    ("--case", "it names the case"),
    ("--camera", "it names a file of the section [camera]"),
    ("--output", "the same case may go into several folders"),
    ("--overwrite", "a decision of the moment"),
    ("--resume", "a decision of the moment"),
    ("--export", "a run records it in [run]"),
    ("--no-report", "no measured value depends on it"),
    ("--figures", "no measured value depends on it"),
    ("--shard", "each process has its own"),
    ("--device", "of the machine, not of the test"),
    ("--trust-device", "of the machine, not of the test"),
    ("--isa", "of the machine, not of the test"),
    ("--threads", "of the machine, not of the test"),
    ("--quiet", "no measured value depends on it"),
    ("--verbose", "no measured value depends on it"),
    ("--progress", "no measured value depends on it"),
];

/// Keys of the sections of a correlation that no flag stands for, and why.
const NOT_FLAGS: [(&str, &str); 9] = [
    ("correlation.poisson", "hardly a field depends on it"),
    ("zone.name", "a flag gives several zones at once"),
    ("zone.exclude", "a list of lists is no word"),
    ("zone.group", "each group of --mesh is a zone"),
    ("zone.elements", "a flag gives several zones at once"),
    ("zone.in_mm", "a flag gives several zones at once"),
    ("crack.name", "a flag gives several cracks at once"),
    ("crack.snap", "a flag gives several cracks at once"),
    ("crack.drawn", "a run records it"),
];

#[test]
fn every_option_of_a_correlation_is_a_flag_and_a_documented_key_or_says_why_not() {
    let page = written(&["about", "commands"]);
    let of_command = page.split("\n## `quadrille correlate`\n").nth(1).unwrap().split("\n## ").next().unwrap();
    let cells = of_command.lines().filter_map(|line| line.strip_prefix("| `"));
    let flags: Vec<&str> = cells.filter_map(|cell| cell.split('`').next()?.split(", ").last()).collect();
    assert!(flags.contains(&"--element-size") && flags.contains(&"DEFORMED"), "{flags:?}");
    let schema: Value = serde_json::from_str(&written(&["about", "schema"])).unwrap();
    let mut of_keys = Vec::new();
    for section in ["images", "correlation", "zone", "crack"] {
        let schema = &schema["properties"][section];
        let schema = if schema["type"] == "array" { &schema["items"] } else { schema };
        for (key, about) in schema["properties"].as_object().unwrap() {
            let name = format!("{section}.{key}");
            assert!(about["description"].as_str().is_some_and(|text| text.len() > 10), "{name} is not explained");
            let flag = about["x-flag"].as_str().map(|flag| flag.trim_end_matches("..."));
            assert_ne!(flag.is_some(), NOT_FLAGS.iter().any(|(key, _)| *key == name), "{name}: {flag:?}");
            of_keys.extend(flag.map(str::to_owned));
        }
    }
    for flag in &of_keys {
        assert!(flags.contains(&flag.as_str()), "{flag} is in the schema and not a flag");
    }
    for flag in flags {
        let is_key = of_keys.iter().any(|of_key| of_key == flag);
        assert_ne!(is_key, NOT_KEYS.iter().any(|(name, _)| *name == flag), "{flag}");
    }
}

#[test]
fn the_program_writes_the_schema() {
    let mut schema: Value = serde_json::from_str(&written(&["about", "schema"])).unwrap();
    assert_eq!(written(&["about", "case"]), case_reference(&schema));
    let mut wanted = case_schema(&case_laws());
    [&mut schema, &mut wanted].into_iter().for_each(without_flags);
    assert!(schema == wanted, "the program adds more than flags");
    assert_eq!(schema["$schema"], "https://json-schema.org/draft/2020-12/schema");
    let roi = &schema["properties"]["zone"]["items"]["properties"]["roi"];
    assert!(roi["description"].as_str().unwrap().contains("px") && roi["minItems"] == 4, "{roi}");
    let e = &schema["properties"]["substrate"]["additionalProperties"]["properties"]["E_MPa"];
    assert!(e["description"].as_str().unwrap().contains("MPa"), "{e}");
}
