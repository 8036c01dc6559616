//! The paper done again: what `testbed paper` has to find, small.

use quadrille::virtual_test::PIXEL_MM;
use quadrille_testbed::paper::{
    Experiment, MEASURED_LAW, PaperError, REFERENCE_LAW, SWEEP_NOISE_PX, TABLE_2, noisy_fits, summary, sweep_summary,
    sweeps,
};
use std::process::Command;
use std::sync::OnceLock;

/// The artificial data of the paper's section 4.1: r = 6.
fn artificial() -> &'static Experiment {
    static ONCE: OnceLock<Experiment> = OnceLock::new();
    let [phi_n, delta_n, delta_t] = REFERENCE_LAW;
    ONCE.get_or_init(|| Experiment::new([phi_n, delta_n, delta_t, 6.0]).unwrap())
}

fn the_mesh_is_that_of_the_paper_and_80_nodes_are_compared() {
    let mesh = artificial().joint().model.mesh();
    assert_eq!((mesh.elements().len(), mesh.interfaces().len()), (546, 39));
    assert!((mesh.element_size() - 30.9e-3).abs() < 1e-9, "16 px");
    // 60 um, rounded to a multiple of 1/32 px on the virtual test's image.
    assert!((mesh.gap() - 0.06).abs() < PIXEL_MM / 32.0);
    assert_eq!(artificial().selected().len(), 80);
    let prescribed = artificial().joint().boundary.nodes();
    assert!(artificial().selected().iter().all(|node| !prescribed.contains(node)));
}

fn without_noise_the_parameters_are_recovered_to_round_off() {
    let level = noisy_fits(artificial(), 0.0, 1, 1).unwrap();
    let s = summary(&level);
    assert_eq!(s.inside, 1);
    for (k, truth) in REFERENCE_LAW.into_iter().enumerate() {
        // The fit ends at a scaled step of 1e-9, and converges quadratically where nothing is left to explain.
        assert!((s.mean[k] / truth - 1.0).abs() < 1e-9, "{k}: {} for {truth}", s.mean[k]);
    }
    assert!(s.evaluations <= 25, "{} evaluations", s.evaluations);
}

fn with_the_least_noise_of_table_1_the_errors_are_those_of_the_paper() {
    let s = summary(&noisy_fits(artificial(), 0.1, 1, 2).unwrap());
    assert_eq!(s.inside, 2);
    for (k, truth) in REFERENCE_LAW.into_iter().enumerate() {
        // The paper's draw is off by 2, 1 and 1 %; three times the largest for draws that are others.
        assert!((s.mean[k] / truth - 1.0).abs() < 0.06, "{k}: {} for {truth}", s.mean[k]);
    }
}

#[test]
fn over_r_the_parameters_follow_table_2_while_the_initial_normal_stiffness_and_the_objective_stay() {
    let experiment = Experiment::new(MEASURED_LAW).unwrap();
    let (_, trends) = sweep_summary(&sweeps(&experiment, SWEEP_NOISE_PX, 1, 2).unwrap());
    for t in trends {
        assert!(t.monotonic, "phi_n, delta_n fall and delta_t, phi_t rise: {t:?}");
        // The noise of one draw (25 % of the stiffness) tilts what it does over r.
        assert!(t.normal_stiffness < 6e-2, "{t:?}");
        assert!(t.omega < 1e-3, "{t:?}");
    }
    let (rows, trends) = sweep_summary(&sweeps(&experiment, 0.0, 1, 1).unwrap());
    assert!(trends[0].normal_stiffness < 1e-2, "{trends:?}");
    for (row, paper) in rows.iter().zip(&TABLE_2) {
        // What another load path leaves alone: the stiffnesses, here of the paper's two digits (rounding alone: 4 %).
        let normal = paper.phi_n / paper.delta_n.powi(2) * 1e6;
        let tangential = 2.0 * row.r * paper.phi_n / paper.delta_t.powi(2) * 1e6;
        for (ours, paper) in [(row.mean[4], normal), (row.mean[5], tangential)] {
            assert!((ours / paper - 1.0).abs() < 0.07, "r = {}: {ours} for {paper}", row.r);
        }
    }
}

fn noise_that_is_none_is_refused() {
    for s_px in [-1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(artificial().problem(s_px, 1), Err(PaperError::Noise { .. })), "{s_px}");
    }
}

/// The experiment takes seconds to make: all that is asked of it is one test.
#[test]
fn the_experiment_of_the_paper_holds_what_each_of_these_says() {
    the_mesh_is_that_of_the_paper_and_80_nodes_are_compared();
    without_noise_the_parameters_are_recovered_to_round_off();
    with_the_least_noise_of_table_1_the_errors_are_those_of_the_paper();
    noise_that_is_none_is_refused();
}

/// By `make release-check PARTS=thorough`.
mod thorough {
    use super::*;

    #[test]
    #[ignore = "make release-check PARTS=thorough"]
    fn the_command_writes_tables_and_figures_and_refuses_to_replace_them_unasked() {
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join("paper");
        let run = |seeds: &str| {
            Command::new(env!("CARGO_BIN_EXE_testbed"))
                .args(["paper", "--seeds", seeds, "--output"])
                .arg(&output)
                .output()
                .unwrap()
        };
        let none = run("0");
        assert_eq!(none.status.code(), Some(2));
        assert!(String::from_utf8_lossy(&none.stderr).contains("0 seeds; choose 1 to 1000"));
        let done = run("1");
        assert_eq!(done.status.code(), Some(0), "{}", String::from_utf8_lossy(&done.stderr));
        let text = String::from_utf8_lossy(&done.stdout).into_owned();
        for heading in ["## Table 1", "## Table 2", "## Initial stiffness", "## Images"] {
            assert!(text.contains(heading), "{heading}");
        }
        for table in
            ["table-1", "table-2", "figure-05", "figure-07-profiles", "figure-08-09", "figure-10", "figure-11-12"]
        {
            assert!(output.join(format!("{table}.csv")).is_file(), "{table}");
        }
        for figure in [
            "figure-04-instant-19",
            "figure-05-instant-19",
            "figure-07-mesh",
            "figure-07-profiles",
            "figure-08-instant-04",
            "figure-09-instant-04",
            "figure-10",
            "figure-11-tn",
            "figure-11-tt",
            "figure-12-tn",
            "mode-mixity",
        ] {
            for ending in ["png", "svg"] {
                assert!(output.join("figures").join(format!("{figure}.{ending}")).is_file(), "{figure}.{ending}");
            }
        }
        let again = run("1");
        assert_eq!(again.status.code(), Some(2));
        assert!(String::from_utf8_lossy(&again.stderr).contains("--overwrite"));
    }
}
