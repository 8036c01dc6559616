//! `quadrille identify`, also with `--sweep`, as a user meets them: files, exit statuses, a clear line for wrong input.

#![cfg(feature = "cli")]

use crate::mechanics_common;
use mechanics_common::{measured_table, pulled};
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};
use std::sync::OnceLock;

const JOINT: &str = "[mesh]\nelement_size_mm = 0.0309\ncolumns = 8\nrows = 3\ngap_mm = 0.06\n[boundary]\n\
                     file = \"border.csv\"\n[substrate]\nE_MPa = 72000.0\nnu = 0.33\nsigma_0_MPa = 180.0\nalpha = 0.06\n\
                     n = 7.0\nexact = true\n[cohesive]\nphi_n_N_per_mm = 1.0\ndelta_n_mm = 0.005\ndelta_t_mm = 0.05\nr = 4.0\nexact = true\n";
const MEASUREMENT: &str = "[measurement]\nfile = \"measured.csv\"\nnodes = \"free\"\n";
const FIT: &str =
    "[fit]\nparameters = [\"phi_n\", \"delta_n\", \"delta_t\"]\n[fit.start]\nphi_n = 1.4\ndelta_n = 0.006\n";

fn quadrille(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_quadrille")).args(arguments).output().expect("the program runs")
}

/// The tables of border and of all displacements of a small joint that opens and slides.
fn tables() -> &'static (String, String) {
    static TABLES: OnceLock<(String, String)> = OnceLock::new();
    TABLES.get_or_init(|| {
        let joint = pulled(8, 3, 4, 0.003);
        let measured = measured_table(&joint.fields, || 0.0);
        (joint.border, measured)
    })
}

fn folder(case: &str, measured: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("case.toml"), case).unwrap();
    std::fs::write(folder.path().join("border.csv"), &tables().0).unwrap();
    std::fs::write(folder.path().join("measured.csv"), measured).unwrap();
    folder
}

fn run(command: &str, folder: &Path, more: &[&str]) -> (Option<i32>, String) {
    let (case, out) = (folder.join("case.toml"), folder.join("out"));
    let mut arguments = vec![command, case.to_str().unwrap(), "--output", out.to_str().unwrap()];
    arguments.extend(more);
    let output = quadrille(&arguments);
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

fn json(path: impl AsRef<Path>) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

#[test]
fn a_case_gives_fit_json_with_tables_and_figures_and_any_number_of_threads_the_same_bits() {
    let folder = folder(&format!("{JOINT}{MEASUREMENT}{FIT}"), &tables().1);
    let (status, said) = run("identify", folder.path(), &["--threads", "1"]);
    assert_eq!(status, Some(0), "{said}");
    assert!(said.contains("determined") && said.contains("phi_n = 1.000000"), "{said}");
    let out = folder.path().join("out");
    let mut one = json(out.join("fit.json"));
    for (name, truth) in [("phi_n", 1.0), ("delta_n", 0.005), ("delta_t", 0.05)] {
        let p = &one["parameters"][name];
        // Data without noise: Gauss-Newton ends at the round-off of the tables.
        assert!((p["value"].as_f64().unwrap() / truth - 1.0).abs() < 1e-9, "{name}: {p}");
        assert!(p["std"].is_number() && p["interval95"].as_array().unwrap().len() == 2 && p["at_bound"] == false);
        // Of a table it is stated, and the interval is that of the noise.
        assert!(p["discretisation"].as_f64().unwrap() != 0.0 && one["discretisation"] == "stated");
    }
    assert!((one["derived"]["phi_t"]["value"].as_f64().unwrap() - 4.0).abs() < 1e-8);
    assert_eq!(one["status"], "converged");
    assert_eq!(one["parameters"]["phi_n"]["start"], 1.4);
    assert_eq!(one["parameters"]["delta_t"]["start"], 0.05);
    assert_eq!(one["prescribed"]["r"], 4.0);
    for key in
        ["correlation", "singular_values", "omega", "omega_expected", "reason", "evaluations", "rescued", "history"]
    {
        assert!(!one[key].is_null(), "{key}");
    }
    let last = one["history"].as_array().unwrap().last().unwrap();
    assert!(last["X"].as_array().unwrap().len() == 3 && last["omega"].is_number() && last["radius"].is_number());
    assert_eq!(last["stage"], 1);
    for name in [
        "solution.csv",
        "tractions.csv",
        "sensitivities.csv",
        "fit-history.csv",
        "traction-bands.csv",
        "law.csv",
        "vtu/000004.vtu",
        "figures/fit-history.png",
        "figures/parameters.svg",
        "figures/tn-bands.png",
        "figures/000004-deformed.png",
    ] {
        assert!(out.join(name).is_file(), "{name}");
    }
    // A second run is refused, and replaced when asked for.
    assert_eq!(run("identify", folder.path(), &[]).0, Some(2));
    let (status, said) = run("identify", folder.path(), &["--overwrite", "--threads", "2", "-q"]);
    assert!(status == Some(0) && said.is_empty(), "{said}");
    let mut two = json(out.join("fit.json"));
    for fit in [&mut one, &mut two] {
        fit.as_object_mut().unwrap().remove("seconds");
    }
    assert_eq!(one, two);
}

#[test]
fn the_limits_of_the_command_line_win_and_a_fit_that_they_end_claims_nothing() {
    let folder = folder(&format!("{JOINT}{MEASUREMENT}{FIT}"), &tables().1);
    let (status, said) = run("identify", folder.path(), &["--max-evaluations", "2", "--progress", "json"]);
    assert_eq!(status, Some(1), "{said}");
    for line in said.lines() {
        serde_json::from_str::<Value>(line).unwrap_or_else(|error| panic!("{error}: {line}"));
    }
    let fit = json(folder.path().join("out/fit.json"));
    assert_eq!((&fit["status"], &fit["verdict"]["determined"]), (&"evaluation_limit".into(), &false.into()));
    let text = fit["verdict"]["text"].as_str().unwrap();
    assert!(text.contains("the fit did not converge"), "{text}");
    // A limit that is over before anything was found leaves nothing to show, and says so.
    let case = format!("{JOINT}{MEASUREMENT}{}", FIT.replace("[fit]", "[fit]\nmax_seconds = 1e-9"));
    std::fs::write(folder.path().join("case.toml"), case).unwrap();
    let (status, said) = run("identify", folder.path(), &["--overwrite"]);
    assert!(status == Some(2) && said.contains("max_seconds") && said.contains("before the forward run"), "{said}");
}

#[test]
fn a_fit_that_does_not_converge_exits_1_with_its_best_point() {
    let case = format!("{JOINT}{MEASUREMENT}{}", FIT.replace("[fit.start]", "max_evaluations = 2\n[fit.start]"));
    let folder = folder(&case, &tables().1);
    let (status, said) = run("identify", folder.path(), &[]);
    assert!(status == Some(1) && said.contains("evaluation_limit"), "{said}");
    let fit = json(folder.path().join("out/fit.json"));
    assert_eq!((&fit["status"], &fit["evaluations"]), (&"evaluation_limit".into(), &2.into()));
    assert!(fit["parameters"]["phi_n"]["value"].as_f64().unwrap() < 1.4);
}

#[test]
fn a_sweep_gives_one_row_for_each_value() {
    let folder = folder(&format!("{JOINT}{MEASUREMENT}{FIT}[fit.sweep]\nr = [3, 4]\n"), &tables().1);
    let (status, said) = run("identify", folder.path(), &["--sweep"]);
    assert_eq!(status, Some(0), "{said}");
    let sweep = json(folder.path().join("out/sweep.json"));
    let rows = sweep["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 2);
    assert!((rows[1]["parameters"]["phi_n"]["value"].as_f64().unwrap() - 1.0).abs() < 1e-9);
    assert!(rows[0]["omega"].as_f64().unwrap() > rows[1]["omega"].as_f64().unwrap());
    assert!(folder.path().join("out/sweep.csv").is_file() && folder.path().join("out/figures/sweep.png").is_file());
    let (status, said) = run("identify", folder.path(), &["--overwrite", "--sweep", "phi_n=1"]);
    assert!(status == Some(2) && said.contains("phi_n is fitted"), "{said}");
    // What is none, two wishes at once, and a case that is taken for a value.
    for (wrong, wanted) in [
        (vec!["--sweep", "r=3;4"], "'3;4' is not a number"),
        (vec!["--sweep", "--tournament"], "cannot be used with"),
        (vec!["--sweep", "joint.toml"], "the case file stands before --sweep"),
        (vec!["--tournament", "joint.toml"], "the case file stands before --tournament"),
    ] {
        let (status, said) = run("identify", folder.path(), &wrong);
        assert!(status == Some(2) && said.contains(wanted), "{said}");
    }
}

#[test]
fn wrong_input_gives_one_clear_line_and_status_2() {
    let good = format!("{JOINT}{MEASUREMENT}{FIT}");
    let measured = &tables().1;
    let refused = |case: &str, measured: &str, words: &[&str]| {
        let folder = folder(case, measured);
        let (status, said) = run("identify", folder.path(), &["-q"]);
        assert_eq!(status, Some(2), "{said}");
        assert_eq!(said.trim().lines().count(), 1, "{said}");
        words.iter().for_each(|word| assert!(said.contains(word), "'{word}' is not in: {said}"));
        assert!(!folder.path().join("out/fit.json").exists());
    };
    let case = |from: &str, to: &str| {
        assert!(good.contains(from), "{from}");
        good.replace(from, to)
    };
    refused(JOINT, measured, &["case.toml", "[measurement]"]);
    refused(&format!("{JOINT}{MEASUREMENT}"), measured, &["case.toml", "[fit]", "parameters"]);
    refused(&case("file = \"measured.csv\"\n", ""), measured, &["[measurement] needs either"]);
    refused(&case("file = \"measured.csv\"\n", "store = \"run\"\n"), measured, &["[measurement] store", "same run"]);
    refused(&case("measured.csv", "other.csv"), measured, &["other.csv", "no such file"]);
    refused(&case("\"free\"", "\"selected\""), measured, &["selected_nodes"]);
    refused(&case("\"free\"", "\"some\""), measured, &["some", "free"]);
    refused(&case("\"free\"", "[1, 999]"), measured, &["999", "72 nodes"]);
    refused(&case("\"free\"", "[0, 1]"), measured, &["no node is left"]);
    refused(&case("\"free\"", "\"free\"\nweights = \"best\""), measured, &["best", "covariance"]);
    refused(&case("\"free\"", "\"free\"\nboundary = \"free\""), measured, &["boundary", "estimated"]);
    refused(&case("\"free\"", "\"free\"\nboundary = \"estimated\""), measured, &["covariance"]);
    for (keys, words) in [
        ("border = \"round\"", ["border", "auto"]),
        ("border = \"smooth\"", ["[measurement] border", "noise_mm"]),
        ("border = \"smooth\"\nnoise_mm = 1e-5\nboundary = \"exact\"", ["[measurement] border", "estimated"]),
    ] {
        refused(&case("\"free\"", &format!("\"free\"\n{keys}")), measured, &words);
    }
    refused(&case("\"free\"", "\"free\"\nnoise_mm = -1"), measured, &["noise_mm", "above zero"]);
    refused(&case("\"free\"", "\"free\"\ninstant_weights = [0, 0, 0, 0]"), measured, &["all weights are zero"]);
    refused(&case("\"free\"", "\"free\"\ninstant_weights = [-1]"), measured, &["instant_weights"]);
    refused(&case("\"phi_n\", ", "\"phi\", "), measured, &["'phi'", "phi_n, delta_n, delta_t, r"]);
    refused(
        &case("\"phi_n\", ", "\"phi_n\", \"phi_n\", "),
        measured,
        &["case.toml, line", "[fit] parameters", "twice"],
    );
    refused(&case("[\"phi_n\", \"delta_n\", \"delta_t\"]", "[]"), measured, &["parameters is empty"]);
    refused(&case("phi_n = 1.4", "r = 3"), measured, &["'r' is not among parameters"]);
    refused(&case("phi_n = 1.4", "phi_n = -1"), measured, &["phi_n", "above zero"]);
    refused(&format!("{good}[fit.lower]\nphi_n = 2\n"), measured, &["phi_n = 1.4", "outside its bounds", "2"]);
    refused(&format!("{good}[fit.upper]\ndelta_n = 0.001\n"), measured, &["delta_n = 0.006", "outside its bounds"]);
    refused(&case("[fit.start]", "latin_hypercube = 3\n[fit.start]"), measured, &["latin_hypercube", "[fit.lower]"]);
    refused(&case("[fit.start]", "starts = [[1.0]]\n[fit.start]"), measured, &["starts", "1 values for 3"]);
    refused(&case("[fit.start]", "profile = \"r\"\n[fit.start]"), measured, &["profile", "\"r\""]);
    refused(
        &case("[fit.start]", "discretisation = \"maybe\"\n[fit.start]"),
        measured,
        &["line", "`maybe`", "included", "off"],
    );
    refused(&case("[fit.start]", "speed = 3\n[fit.start]"), measured, &["speed", "line"]);
    refused(&case("n = 7.0", "n = 7.0\nE_GPa_std = 1"), measured, &["E_GPa_std", "E_MPa_std"]);
    refused(
        &case("\"free\"", "[40]\ninstant_weights = [1, 0, 0, 0]"),
        measured,
        &["2 measured numbers", "3 parameters"],
    );

    refused(&good, "", &["no row"]);
    refused(&good, "instant,node,ux_mm,uy_mm\n", &["no row"]);
    refused(&good, "a,b\n1,2\n", &["instant,node,ux_mm,uy_mm"]);
    refused(&good, "instant,node,ux_px,uy_px\n1,0,1,1\n", &["in pixels", "pixel_size_mm"]);
    refused(&good, &measured.replacen("1,0,", "1,0,nan,", 1), &["line 2", "5 values"]);
    refused(&good, &measured.replacen("\n1,3,", "\n1,300,", 1), &["instant 1", "node 300", "72 nodes"]);
    refused(&good, &measured.replacen("\n2,40,", "\n9,40,", 1), &["instant 9", "4 instants"]);
    let without: String = measured.lines().filter(|l| !l.starts_with("2,40,")).map(|l| format!("{l}\n")).collect();
    refused(&good, &without, &["instant 2", "node 40", "leave it out"]);
    let rigid: String = std::iter::once("instant,node,ux_mm,uy_mm\n".to_owned())
        .chain((0..72).map(|node| format!("1,{node},0,0\n")))
        .collect();
    refused(&good, &rigid, &["all weights are zero", "uniform"]);
}

#[test]
fn an_instant_that_is_not_measured_is_said_and_the_others_suffice() {
    let measured: String = tables().1.lines().filter(|l| !l.starts_with("3,")).map(|l| format!("{l}\n")).collect();
    let folder = folder(&format!("{JOINT}{MEASUREMENT}{FIT}"), &measured);
    let (status, said) = run("identify", folder.path(), &[]);
    assert!(status == Some(0) && said.contains("instants 3 are not in"), "{said}");
    assert_eq!(json(folder.path().join("out/fit.json"))["measurement"]["instants"], serde_json::json!([1, 2, 4]));
}
