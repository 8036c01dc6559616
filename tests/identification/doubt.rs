//! What a fit says when an assumption is wrong: misfit test, prescribed parameters as unknowns, verdict, exit status.

#![cfg(feature = "cli")]

use crate::mechanics_common;
use mechanics_common::{Pulled, measured_table, pulled};
use quadrille::identify::{Case, Ended, Fit, FitProgress, FitStatus, FitWatch, Misfit, Outcome, fit};
use quadrille::io::joint::read_joint;
use quadrille::mechanics::cohesive::ExtendedXuNeedleman;
use quadrille::mechanics::{JointMesh, Model, ModelOptions, NodalField};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock};

/// 1 px of the virtual test, mm.
const PX: f64 = 0.00193125;
const SUBSTRATE: &str = "E_MPa = 72000.0\nnu = 0.33\nsigma_0_MPa = 180.0\nalpha = 0.06\nn = 7.0\n";
const COHESIVE: &str = "phi_n_N_per_mm = 1.2\ndelta_n_mm = 0.006\ndelta_t_mm = 0.045\nr = 4.0\n";

fn truth() -> &'static Pulled {
    static TRUTH: OnceLock<Pulled> = OnceLock::new();
    TRUTH.get_or_init(|| pulled(12, 4, 6, 0.002))
}

/// A case file with its tables in a folder: white noise of `noise_px` on every displacement, independent of each other.
fn folder(
    seed: u64,
    noise_px: f64,
    substrate: &str,
    cohesive: &str,
    measurement: &str,
    fit: &str,
) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let case = format!(
        "[mesh]\nelement_size_mm = 0.0309\ncolumns = 12\nrows = 4\ngap_mm = 0.06\n[boundary]\nfile = \"border.csv\"\n\
         [substrate]\n{substrate}[cohesive]\n{cohesive}[measurement]\nfile = \"measured.csv\"\nnodes = \"free\"\n\
         weights = \"covariance\"\nboundary = \"exact\"\ncommon_reference = false\n{measurement}[fit]\nexact = [\"rotations\"]\n{fit}[output]\nfigures = []\n"
    );
    let (mut random, noise) = (ChaCha8Rng::seed_from_u64(seed), Normal::new(0.0, noise_px * PX).unwrap());
    let measured = measured_table(&truth().fields, || noise.sample(&mut random));
    std::fs::write(folder.path().join("case.toml"), case).unwrap();
    std::fs::write(folder.path().join("border.csv"), &truth().border).unwrap();
    std::fs::write(folder.path().join("measured.csv"), measured).unwrap();
    folder
}

const THREE: &str = "parameters = [\"phi_n\", \"delta_n\", \"delta_t\"]\n";

/// The noise of `px`, as [measurement] states it.
fn stated(px: f64) -> String {
    format!("noise_mm = {:e}\n", px * PX)
}

#[track_caller]
fn fitted(folder: &tempfile::TempDir) -> Fit {
    let path = folder.path().join("case.toml");
    let input = read_joint(&path).unwrap();
    let joint = Case::joint(&input).unwrap();
    let case = Case::new(&joint, &input, &path).unwrap();
    fit(&case.problem, &case.options).unwrap()
}

fn misfit(fit: &Fit) -> &Misfit {
    fit.misfit.as_ref().unwrap()
}

#[test]
fn a_fit_that_is_asked_to_stop_keeps_its_best_point_and_claims_nothing() {
    let folder = folder(11, 0.05, SUBSTRATE, COHESIVE, &stated(0.05), THREE);
    let path = folder.path().join("case.toml");
    let input = read_joint(&path).unwrap();
    let joint = Case::joint(&input).unwrap();
    let mut case = Case::new(&joint, &input, &path).unwrap();
    let (stop, heard) = (Arc::new(AtomicBool::new(false)), Arc::new(Mutex::new(Vec::<FitProgress>::new())));
    let (flag, words) = (stop.clone(), heard.clone());
    case.problem.watch = FitWatch::new(None, Some(stop), move |progress| {
        let mut words = words.lock().unwrap();
        words.push(progress);
        flag.store(words.iter().filter(|word| word.omega.is_some()).count() >= 3, Ordering::SeqCst);
    });
    let found = fit(&case.problem, &case.options).unwrap();
    assert_eq!((found.status, found.evaluations), (FitStatus::Stopped, 3), "{}", found.reason);
    assert!(!found.verdict.determined() && found.verdict.sentences.join(" ").contains("did not converge"));
    let cut = found.cut_short.as_ref().unwrap();
    assert!(cut.ended == Ended::Stopped && cut.missing.contains(&"the misfit test"), "{}", cut.text());
    assert!(found.misfit.is_none() && found.released.is_none() && found.intervals.unwrap().draws == 0);
    // The best of what was tried is what is kept: the same sums give the same bits.
    let heard = heard.lock().unwrap();
    let best = heard.iter().filter_map(|word| word.omega).fold(f64::INFINITY, f64::min);
    assert_eq!(found.omega, best);
    assert!(heard.iter().any(|word| word.parameters.iter().any(|(name, _)| *name == "phi_n")));
}

#[test]
fn a_right_model_is_not_rejected_and_its_residual_is_what_the_noise_leaves() {
    let (mut z, mut groups) = (Vec::new(), Vec::new());
    for seed in 1..=12 {
        let fit = fitted(&folder(seed, 0.05, SUBSTRATE, COHESIVE, &stated(0.05), THREE));
        let misfit = misfit(&fit);
        assert!(misfit.tested && !misfit.rejected(), "seed {seed}: {misfit:?}");
        assert_eq!(fit.verdict.outcome, Outcome::Determined, "seed {seed}: {:?}", fit.verdict);
        z.push(misfit.z);
        groups.extend(misfit.by_both.iter().map(|group| group.z));
        // 176 numbers each: the root mean square is good to 1 / sqrt(2 * 176) = 5 %; five of those.
        misfit.by_instant.iter().for_each(|group| assert!((group.ratio - 1.0).abs() < 0.27, "seed {seed}: {group:?}"));
    }
    // 12 draws of a unit normal variable, somewhat less wide for the stated uncertainty of the noise: mean within 4 /
    // sqrt(12).
    let mean = z.iter().sum::<f64>() / z.len() as f64;
    assert!(mean.abs() < 1.15, "{z:?}");
    // Groups: over eight hundred of them the mean square of unit normal variables is 1 within a quarter.
    let square = groups.iter().map(|z| z * z).sum::<f64>() / groups.len() as f64;
    assert!((0.75..1.25).contains(&square), "{square} over {}", groups.len());
}

#[test]
fn strips_that_are_not_elastic_reject_an_elastic_model_and_the_worst_place_is_named() {
    let elastic = "model = \"linear-elastic\"\nE_MPa = 72000.0\nnu = 0.33\n";
    let folder = folder(3, 0.02, elastic, COHESIVE, &stated(0.02), THREE);
    let fit = fitted(&folder);
    assert!(misfit(&fit).z > 10.0, "{}", misfit(&fit).z);
    assert_eq!(fit.verdict.outcome, Outcome::Rejected);
    let text = fit.verdict.sentences.join(". ");
    for words in ["the data contradict the model", "strip", "times expected", "from the adhesive"] {
        assert!(text.contains(words) || words == "from the adhesive" && text.contains("beside the adhesive"), "{text}");
    }
    // The program: exit status 1, and intervals labelled.
    let case = folder.path().join("case.toml");
    let out = folder.path().join("out");
    let arguments = ["identify", case.to_str().unwrap(), "--output", out.to_str().unwrap()];
    let done = Command::new(env!("CARGO_BIN_EXE_quadrille")).args(arguments).output().unwrap();
    let said = String::from_utf8_lossy(&done.stderr);
    assert_eq!(done.status.code(), Some(1), "{said}");
    assert!(said.contains("verdict: model rejected") && said.contains("if the model were true"), "{said}");
    let json: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(out.join("fit.json")).unwrap()).unwrap();
    assert_eq!(json["verdict"]["conditional"], true);
    assert!(json["misfit"]["rejected"] == true && !json["misfit"]["worst"].as_array().unwrap().is_empty());
}

#[test]
fn a_prescribed_parameter_that_is_wrong_is_found_out_by_trying_it_as_an_unknown() {
    let six = COHESIVE.replace("r = 4.0", "r = 6.0");
    let prescribed = fitted(&folder(5, 0.01, SUBSTRATE, &six, &stated(0.01), THREE));
    let released = prescribed.released.as_ref().unwrap();
    let four = "parameters = [\"phi_n\", \"delta_n\", \"delta_t\", \"r\"]\n";
    let free = fitted(&folder(5, 0.01, SUBSTRATE, &six, &stated(0.01), four));
    assert!(free.released.is_none(), "nothing is left to be tried");
    // Both are minima of the same objective, ended at a scaled step of 1e-4 and less.
    let fall = prescribed.omega - free.omega;
    assert!((released.gain - fall).abs() < 0.01 * fall.max(1.0), "{} and {fall}", released.gain);
    assert!(released.significant() && released.gain > 50.0, "{released:?}");
    let r = &released.parameters[0];
    let found = &free.parameters[3];
    assert!(r.name == "r" && (r.value - found.value).abs() < 1e-3 * found.value, "{r:?} {found:?}");
    assert!((r.std.unwrap() / found.std_noise.unwrap() - 1.0).abs() < 0.05, "{r:?} {found:?}");
    let text = prescribed.verdict.sentences.join(". ");
    assert!(text.contains("r = 6") && text.contains("omega falls by"), "{text}");
}

#[test]
fn a_right_prescription_lets_omega_fall_by_no_more_than_chance() {
    let fit = fitted(&folder(6, 0.05, SUBSTRATE, COHESIVE, &stated(0.05), THREE));
    let released = fit.released.as_ref().unwrap();
    // The quantile of a chi-square of one degree at one in a thousand.
    assert!((released.limit - 10.8276).abs() < 1e-3, "{released:?}");
    assert!(released.converged && !released.significant(), "{released:?}");
    let text = fit.verdict.sentences.join(". ");
    assert!(text.contains("with r as unknown omega falls by") && text.contains("no more than chance"), "{text}");
}

#[test]
fn a_stated_noise_that_the_residual_contradicts_is_never_determined() {
    // Stated too large: the intervals are too wide.
    let loud = fitted(&folder(7, 0.02, SUBSTRATE, COHESIVE, &stated(0.1), THREE));
    assert_eq!(loud.verdict.outcome, Outcome::NotDetermined, "{:?}", loud.verdict);
    assert!(
        loud.verdict.sentences.join(". ").contains("noise is less than what the uncertainties are made with"),
        "{:?}",
        loud.verdict
    );
    // Too small: noise and model cannot be told apart by the residual alone.
    let quiet = fitted(&folder(7, 0.02, SUBSTRATE, COHESIVE, &stated(0.002), THREE));
    assert_eq!(quiet.verdict.outcome, Outcome::Rejected, "{:?}", quiet.verdict);
}

#[test]
fn without_a_stated_noise_the_whole_is_not_tested_but_places_still_are() {
    let right = fitted(&folder(8, 0.02, SUBSTRATE, COHESIVE, "", THREE));
    assert!(!misfit(&right).tested && !misfit(&right).rejected(), "{:?}", right.misfit);
    assert!(right.verdict.sentences.join(". ").contains("not tested"), "{:?}", right.verdict);
    let elastic = "model = \"linear-elastic\"\nE_MPa = 72000.0\nnu = 0.33\n";
    let wrong = fitted(&folder(8, 0.02, elastic, COHESIVE, "", THREE));
    assert_eq!(wrong.verdict.outcome, Outcome::Rejected, "{:?}", wrong.verdict);
}

#[test]
fn a_parameter_on_its_bound_is_never_determined() {
    let bounded = format!("{THREE}[fit.upper]\ndelta_t = 0.046\n");
    let fit = fitted(&folder(9, 0.001, SUBSTRATE, COHESIVE, "", &bounded));
    assert!(fit.parameters[2].at_bound, "{:?}", fit.parameters[2]);
    assert_ne!(fit.verdict.outcome, Outcome::Determined);
    assert!(fit.verdict.sentences.join(". ").contains("delta_t is not determined: it ended on its bound"));
}

#[test]
fn what_the_case_admits_not_to_know_rejects_nothing() {
    // E is a fifth too low: held for exact it leaves a misfit, known to a fifth it is within its own.
    let low = SUBSTRATE.replace("72000.0", "57600.0");
    // The data come from the same mesh.
    let three = format!("{THREE}discretisation = \"off\"\n");
    let of = |more: &str| fitted(&folder(10, 0.01, &format!("{low}{more}"), COHESIVE, &stated(0.01), &three));
    let (exact, uncertain) =
        (of("exact = true\n"), of("E_MPa_std = 14400.0\nexact = [\"nu\", \"sigma_0\", \"alpha\", \"n\"]\n"));
    let (exact, uncertain) = (misfit(&exact), misfit(&uncertain));
    assert!(uncertain.constants > exact.constants, "{} and {}", uncertain.constants, exact.constants);
    assert!(uncertain.z < exact.z, "{} and {}", uncertain.z, exact.z);
    assert!(!uncertain.rejected(), "{uncertain:?}");
}

/// The pulled joint at each instant, and how its displacements follow where the adhesive is thicker, by these shares of its
/// 12 elements.
fn by_thickness(along: &[f64]) -> Vec<NodalField> {
    let mesh = JointMesh::rectangular(12, 4, 0.0309, 0.06).unwrap();
    let nodes = mesh.outer_nodes();
    let model = Model::new(mesh, mechanics_common::aluminium(2), &nodes, ModelOptions::default()).unwrap();
    let law = ExtendedXuNeedleman::new(1.0, 0.005, 0.05, 4.0).unwrap();
    truth().fields.iter().map(|u| model.linearise(&law, u).unwrap().by_thickness(along)).collect()
}

#[test]
fn a_thicker_adhesive_is_one_whose_law_has_longer_separations_and_works_at_the_same_tractions() {
    let mesh = JointMesh::rectangular(12, 4, 0.0309, 0.06).unwrap();
    let nodes = mesh.outer_nodes();
    let model = Model::new(mesh, mechanics_common::aluminium(2), &nodes, ModelOptions::default()).unwrap();
    let law = ExtendedXuNeedleman::new(1.0, 0.005, 0.05, 4.0).unwrap();
    for (u, thicker) in truth().fields.iter().zip(by_thickness(&[1.0; 12])) {
        // phi_n, delta_n, delta_t grow in proportion; r is a ratio.
        let by_law = model.linearise(&law, u).unwrap().by_law();
        let largest = thicker.iter().flatten().fold(0.0f64, |most, v| most.max(v.abs()));
        for (node, by) in thicker.iter().enumerate() {
            for (c, by) in by.iter().enumerate() {
                let sum = by_law[0][node][c] + 0.005 * by_law[1][node][c] + 0.05 * by_law[2][node][c];
                assert!((by - sum).abs() < 1e-9 * largest, "{node}: {by} {sum}");
            }
        }
    }
}

#[test]
fn a_thickness_that_varies_along_the_joint_is_said_with_the_place_whose_law_is_found() {
    let along: Vec<f64> = (0..12).map(|k| (f64::from(k) + 0.5) / 12.0 - 0.5).collect();
    let varied = by_thickness(&along);
    let fit_of = |seed: u64, change: f64| {
        // Of so short a joint constants that are uncertain could do as much.
        let exact = [SUBSTRATE, COHESIVE].map(|section| format!("{section}exact = true\n"));
        let folder = folder(seed, 0.02, &exact[0], &exact[1], &stated(0.02), THREE);
        let (mut random, noise) = (ChaCha8Rng::seed_from_u64(seed), Normal::new(0.0, 0.02 * PX).unwrap());
        let add = |(u, by): (&[f64; 2], &[f64; 2])| [0, 1].map(|c| u[c] + change * by[c]);
        let fields: Vec<NodalField> =
            truth().fields.iter().zip(&varied).map(|(u, by)| u.iter().zip(by).map(add).collect()).collect();
        let measured = measured_table(&fields, || noise.sample(&mut random));
        std::fs::write(folder.path().join("measured.csv"), measured).unwrap();
        fitted(&folder)
    };
    let words = "change along the joint";
    // One in a thousand is said by chance.
    for seed in 1..=8 {
        let even = fit_of(seed, 0.0);
        let found = even.along.as_ref().unwrap();
        assert!(!found.contradicts && found.change.abs() < 4.0 * found.std, "{found:?}");
        assert!(!even.verdict.sentences.iter().any(|sentence| sentence.contains(words)));
    }
    let fit = fit_of(9, 0.3);
    let found = fit.along.as_ref().unwrap();
    assert!(found.contradicts && (found.change - 0.3).abs() < 3.0 * found.std + 0.01, "{found:?}");
    assert_eq!(fit.verdict.outcome, Outcome::Rejected);
    assert!(fit.verdict.sentences.iter().any(|sentence| sentence.contains(words)), "{:?}", fit.verdict.sentences);
    // The fit has found the separations and the work of that place.
    let there = 1.0 + 0.3 * (found.place_mm / found.length_mm - 0.5);
    assert!((found.length_mm - 12.0 * 0.0309).abs() < 1e-9);
    let phi_n = &fit.parameters[0];
    assert!((phi_n.value - there).abs() < 3.0 * phi_n.std_noise.unwrap() + 0.01, "{} for {there}", phi_n.value);
}
