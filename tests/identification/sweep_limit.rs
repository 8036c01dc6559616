//! A sweep that is ended before its time keeps what it has, and says what it has not.

#![cfg(feature = "cli")]

use crate::mechanics_common;
use mechanics_common::{measured_table, pulled};
use quadrille::identify::{Case, Ended, FitStatus, FitWatch, sweep};
use quadrille::io::joint::read_joint;
use serde_json::Value;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

const CASE: &str = "[mesh]\nelement_size_mm = 0.0309\ncolumns = 8\nrows = 3\ngap_mm = 0.06\n[boundary]\n\
                    file = \"border.csv\"\n[substrate]\nE_MPa = 72000.0\nnu = 0.33\nsigma_0_MPa = 180.0\nalpha = 0.06\n\
                    n = 7.0\nexact = true\n[cohesive]\nphi_n_N_per_mm = 1.0\ndelta_n_mm = 0.005\ndelta_t_mm = 0.05\nr = 4.0\n\
                    exact = true\n[measurement]\nfile = \"measured.csv\"\nnodes = \"free\"\n\
                    [fit]\nparameters = [\"phi_n\", \"delta_n\", \"delta_t\"]\n[fit.start]\nphi_n = 1.4\ndelta_n = 0.006\n";

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let joint = pulled(8, 3, 4, 0.003);
    std::fs::write(folder.path().join("case.toml"), CASE).unwrap();
    std::fs::write(folder.path().join("border.csv"), &joint.border).unwrap();
    std::fs::write(folder.path().join("measured.csv"), measured_table(&joint.fields, || 0.0)).unwrap();
    folder
}

fn run(folder: &Path, more: &[&str]) -> (Option<i32>, String) {
    let (case, out) = (folder.join("case.toml"), folder.join("out"));
    let output = Command::new(env!("CARGO_BIN_EXE_quadrille"))
        .args(["identify", case.to_str().unwrap(), "--overwrite", "--output", out.to_str().unwrap()])
        .args(more)
        .output()
        .expect("the program runs");
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

#[test]
fn a_sweep_that_is_ended_keeps_finished_fits_and_the_best_point_of_the_one_that_goes_on() {
    let folder = folder();
    let path = folder.path().join("case.toml");
    let input = read_joint(&path).unwrap();
    let joint = Case::joint(&input).unwrap();
    let mut case = Case::new(&joint, &input, &path).unwrap();
    let values = [4.0, 4.5, 5.0, 5.5];
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let whole = pool.install(|| sweep(&case.problem, &case.options, 3, &values)).unwrap();
    assert!(whole.len() == 4 && whole.iter().all(|row| row.fit.status == FitStatus::Converged));
    // Ended at the third point of the second fit: after the forward runs of the first and two more.
    let stop = Arc::new(AtomicBool::new(false));
    let (flag, count) = (Arc::clone(&stop), Arc::new(std::sync::Mutex::new((0usize, f64::INFINITY, 0usize))));
    let hear = move |at: quadrille::identify::FitProgress| {
        let mut seen = count.lock().unwrap();
        let Some(omega) = at.omega else { return };
        // A fit begins where the objective jumps up to that of the start.
        let (fits, before, points) = *seen;
        let fits = fits + usize::from(before == f64::INFINITY || omega > 1e3 * before);
        let points = if fits >= 2 { points + 1 } else { 0 };
        *seen = (fits, omega, points);
        if points == 3 {
            flag.store(true, Ordering::SeqCst);
        }
    };
    case.problem.watch = FitWatch::new(None, Some(stop), hear);
    let rows = pool.install(|| sweep(&case.problem, &case.options, 3, &values)).unwrap();
    let kept: Vec<f64> = rows.iter().map(|row| row.value).collect();
    assert_eq!(kept, [4.0, 4.5], "the fits that were not begun have no row");
    assert_eq!(rows[0].fit.values, whole[0].fit.values, "a fit that had ended is what it is without the limit");
    assert_eq!((rows[0].fit.status, rows[0].fit.cut_short.is_none()), (FitStatus::Converged, true));
    let cut = rows[1].fit.cut_short.as_ref().expect("the second is cut short");
    assert_eq!((rows[1].fit.status, cut.ended), (FitStatus::Stopped, Ended::Stopped));
    assert!(rows[1].fit.omega.is_finite() && rows[1].fit.omega > whole[1].fit.omega);
    // No time at all: no row, and no error either.
    case.problem.watch = FitWatch::new(Some(0.0), None, |_| ());
    assert!(pool.install(|| sweep(&case.problem, &case.options, 3, &values)).unwrap().is_empty());
}

#[test]
fn the_program_writes_what_the_limit_left_time_for_and_exits_1() {
    let folder = folder();
    // More than any machine fits on one thread in that time.
    let values: Vec<String> = (0..20_000).map(|k| format!("{}", 4.0 + 1e-5 * f64::from(k))).collect();
    let case = format!("{CASE}[fit.sweep]\nr = [{}]\n", values.join(", "));
    std::fs::write(folder.path().join("case.toml"), case).unwrap();
    let (status, said) = run(folder.path(), &["--sweep", "--max-seconds", "3", "--threads", "1"]);
    assert_eq!(status, Some(1), "{said}");
    assert!(said.contains("the limit of 3 s (max_seconds) was reached") && said.contains("not fitted: r = "), "{said}");
    let sweep: Value =
        serde_json::from_str(&std::fs::read_to_string(folder.path().join("out/sweep.json")).unwrap()).unwrap();
    let [rows, missing] = ["rows", "not_fitted"].map(|key| sweep[key].as_array().unwrap().len());
    assert!(rows > 0 && missing > 0 && rows + missing == 20_000, "{rows} rows, {missing} not fitted");
    assert!(sweep["ended"].as_str().unwrap().contains("max_seconds"));
    let table = std::fs::read_to_string(folder.path().join("out/sweep.csv")).unwrap();
    let lines = table.lines().filter(|line| !line.starts_with('#')).count();
    assert_eq!(lines, rows + 1);
    assert!(folder.path().join("out/figures/sweep.png").is_file());
    // A limit that is over before anything was found leaves nothing to show, as of a fit.
    std::fs::write(folder.path().join("case.toml"), CASE.replace("[fit]\n", "[fit]\nmax_seconds = 1e-9\n")).unwrap();
    let (status, said) = run(folder.path(), &["--sweep", "r=3,4"]);
    assert!(status == Some(2) && said.contains("max_seconds") && said.contains("nothing is kept"), "{said}");
}
