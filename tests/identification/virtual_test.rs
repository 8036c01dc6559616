//! The virtual test: what is computed, what its images show, what stands beside them.

#![cfg(feature = "cli")]

use quadrille::identify::law_like;
use quadrille::imaging::Image;
use quadrille::io::images::read_image;
use quadrille::mechanics::cohesive::{CohesiveLaw, ExtendedXuNeedleman};
use quadrille::synth::{Depth, Motion};
use quadrille::virtual_test::{ELEMENT_PX, PIXEL_MM, VirtualError, VirtualOptions, VirtualTest, faces_px, zones_px};
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};
use std::sync::OnceLock;

/// Computed once: the same for every seed.
fn test() -> &'static VirtualTest {
    static TEST: OnceLock<VirtualTest> = OnceLock::new();
    TEST.get_or_init(|| VirtualTest::new(VirtualOptions { noise_grey: 0.0, ..VirtualOptions::default() }).unwrap())
}

fn quadrille(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_quadrille")).args(arguments).output().expect("the program runs")
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// Tractions T_n of the pairs within the region, from left to right.
fn normal_tractions(instant: usize) -> Vec<f64> {
    let test = test();
    let [x0, _, x1, _] = zones_px()[0].map(|px| px * PIXEL_MM);
    let tractions = test.model().tractions(test.law(), &test.solution().instants[instant - 1].displacement);
    let pairs = test.model().pair_positions().into_iter().zip(tractions);
    pairs.filter(|((at, _), _)| x0 <= at[0] && at[0] <= x1).map(|(_, t)| t.normal).collect()
}

fn small_strains_hold_because_no_strip_turns_by_more_than_a_fiftieth() {
    // The issue's bound; w^2/2 is then 2e-4, below a tenth of the yield strain of 2.5e-3.
    let largest = test().largest_rotation();
    assert!(largest > 0.005 && largest < 0.02, "{largest} rad");
    // Also locally: no element of the truth turns further than that.
    let test = test();
    let mesh = test.model().mesh();
    for instant in &test.solution().instants {
        for corners in mesh.elements() {
            let at = |k: usize| (mesh.nodes()[corners[k] as usize], instant.displacement[corners[k] as usize]);
            let fit = quadrille::field::RigidMotion::fit((0..4).map(at)).unwrap();
            assert!(fit.rotation_rad.abs() < 0.02, "{} rad", fit.rotation_rad);
        }
    }
}

fn the_crack_runs_from_right_to_left_through_the_region_with_compression_ahead() {
    let test = test();
    let front = |instant: usize| {
        let u = &test.solution().instants[instant - 1].displacement;
        let (first, _) = test.model().pair_positions()[0];
        test.model().crack_front(test.law(), u).map(|along| (first[0] + along) / PIXEL_MM)
    };
    let fronts: Vec<f64> = (1..=19).filter_map(front).collect();
    assert!(fronts.windows(2).all(|pair| pair[1] < pair[0]), "{fronts:?}");
    let [x0, _, x1, _] = zones_px()[0];
    assert!(fronts[0] > x1, "it comes in from the right: {fronts:?}");
    assert!(*fronts.last().unwrap() < 0.5 * (x0 + x1), "it has passed the middle: {fronts:?}");
    // At first some place of the region softens or has opened and another, further left, is compressed; later the
    // compressed zone is left of the region.
    let peak = test.law().peak().normal;
    for instant in 1..=5 {
        let t = normal_tractions(instant);
        let most = t.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let least = t.iter().copied().fold(f64::INFINITY, f64::min);
        assert!(most > 0.8 * peak && least < -1.0, "instant {instant}: {least} to {most} MPa of {peak}");
        let at = |value: f64| t.iter().position(|v| *v == value).unwrap();
        assert!(at(least) < at(most), "compression is ahead, to the left");
    }
}

fn both_modes_are_there() {
    // Where only one were, r and delta_t could not be told: sliding beyond that of the largest traction,
    // delta_t/sqrt(2), while T_n acts elsewhere.
    let test = test();
    let last = test.model().jumps(&test.solution().instants[18].displacement);
    let most = last.iter().map(|jump| jump.tangential).fold(0.0, f64::max);
    assert!(most > 0.030 && most < 0.08, "{most} mm");
}

fn the_motion_of_a_node_is_its_computed_displacement_with_y_turned_down() {
    let test = test();
    let (mesh, u) = (test.model().mesh(), &test.solution().instants[9].displacement);
    for node in (0..mesh.nodes().len()).step_by(97) {
        let [x, y] = mesh.nodes()[node].map(|mm| mm / PIXEL_MM);
        let got = test.motion(10).displacement([x, -y]);
        let want = [u[node][0] / PIXEL_MM, -u[node][1] / PIXEL_MM];
        // Positions near 900 px are right to 1e-13; gradients of 0.05 and a change of cell hardly matter.
        assert!((got[0] - want[0]).abs().max((got[1] - want[1]).abs()) < 1e-10, "node {node}: {got:?} {want:?}");
    }
}

fn the_region_is_cut_where_the_zones_lie() {
    let (region, of) = test().region();
    // Twice as fine as 39 x 10 elements of 16 px in each strip.
    assert_eq!((region.elements().len(), region.interfaces().len()), (2 * 78 * 20, 78));
    assert!((region.element_size() / PIXEL_MM - 0.5 * ELEMENT_PX).abs() < 1e-9);
    assert!((region.gap() / PIXEL_MM - (faces_px()[1] - faces_px()[0])).abs() < 1e-9);
    let mesh = test().model().mesh();
    assert!(of.iter().zip(region.nodes()).all(|(&old, at)| mesh.nodes()[old as usize] == *at));
}

fn the_band_is_dark_and_the_strips_are_not() {
    let image = test().image(19).unwrap();
    let [upper, lower] = faces_px();
    let mean = |image: &Image, y0: usize, y1: usize| {
        let pixels = (y0..y1).flat_map(|y| (0..image.width()).map(move |x| (x, y)));
        let greys: Vec<f64> = pixels.map(|(x, y)| f64::from(image.grey(x, y))).collect();
        greys.iter().sum::<f64>() / greys.len() as f64
    };
    let reference = test().image(0).unwrap();
    let band = [upper.ceil() as usize + 1, lower.floor() as usize - 1];
    // The dark grey level is 12 of 255, the texture's mean 120.
    assert!((mean(&reference, band[0], band[1]) - 12.0).abs() < 0.5);
    for image in [&reference, &image] {
        assert!((mean(image, 0, 180) - 120.0).abs() < 10.0 && (mean(image, 270, 448) - 120.0).abs() < 10.0);
    }
}

#[test]
fn no_instants_and_noise_that_is_none_are_refused() {
    let wrong = |options| VirtualTest::new(options).unwrap_err();
    let options = VirtualOptions::default();
    assert!(matches!(wrong(VirtualOptions { instants: 0, ..options }), VirtualError::Instants { instants: 0 }));
    assert!(matches!(wrong(VirtualOptions { noise_grey: f32::NAN, ..options }), VirtualError::Synth(_)));
    assert!(matches!(wrong(VirtualOptions { speckle_px: 0.0, ..options }), VirtualError::Synth(_)));
    assert!(matches!(wrong(VirtualOptions { law: [-1.0, 0.005, 0.05, 4.0], ..options }), VirtualError::Law(_)));
}

#[test]
fn the_command_writes_images_truth_and_a_case_and_seeds_change_the_images_alone() {
    let folder = tempfile::tempdir().unwrap();
    let (one, two) = (folder.path().join("one"), folder.path().join("two"));
    let make = |out: &Path, more: &[&str]| {
        let done = quadrille(&[&["make", "virtual-test", "--output", out.to_str().unwrap()], more].concat());
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    };
    // Fewer instants than the usual 19, which `quadrille demo` has.
    make(&one, &["--instants", "7", "--threads", "1"]);
    make(&two, &["--instants", "7", "--seed", "2", "--depth", "16", "--noise", "0"]);
    let (first, second) = (json(&one.join("truth.json")), json(&two.join("truth.json")));
    assert_eq!(first["parameters"], second["parameters"]);
    assert_eq!(first["parameters"]["delta_n"], 0.005);
    assert_eq!(first["instants"], second["instants"]);
    assert_eq!(first["images"].as_array().unwrap().len(), 8);
    for entry in first["images"].as_array().unwrap() {
        let loaded = read_image(&one.join(entry["file"].as_str().unwrap()), 0).unwrap();
        assert_eq!(loaded.sha256, entry["sha256"].as_str().unwrap());
    }
    assert_ne!(first["images"][3]["sha256"], second["images"][3]["sha256"]);
    // 16 bit without noise: 257 times the grey level, rounded later.
    let image = |folder: &Path| read_image(&folder.join("images/000007.png"), 0).unwrap().image;
    assert_eq!(image(&two).pixels().depth().to_string(), "16 bit");
    let want = VirtualTest::new(VirtualOptions {
        seed: 2,
        noise_grey: 0.0,
        depth: Depth::U16,
        instants: 7,
        ..VirtualOptions::default()
    });
    let want = want.unwrap().image(7).unwrap();
    assert_eq!(want.pixels(), image(&two).pixels());
    // The same command gives the same bits for any number of threads.
    let again = folder.path().join("again");
    make(&again, &["--instants", "7", "--threads", "3"]);
    for name in ["truth.json", "truth/displacement.csv", "images/000007.png", "case.toml"] {
        assert_eq!(std::fs::read(one.join(name)).unwrap(), std::fs::read(again.join(name)).unwrap(), "{name}");
    }
    // Not over another one, unless asked.
    let refused = quadrille(&["make", "virtual-test", "--output", one.to_str().unwrap()]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("--overwrite"));
}

#[test]
fn the_truth_simulates_to_itself() {
    // The region, cut out and driven by its own border, has the displacements of the whole joint: both are equilibrium
    // to 1e-11 of the largest force.
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("test");
    assert!(quadrille(&["make", "virtual-test", "--noise", "0", "--output", out.to_str().unwrap()]).status.success());
    let [e, nu, sigma_0, alpha, n] = quadrille::virtual_test::ALUMINIUM;
    let case = format!(
        "[mesh]\nfile = \"truth/mesh.json\"\n[boundary]\nfile = \"truth/boundary_displacements.csv\"\n\
         [substrate]\nE_MPa = {e}\nnu = {nu}\nsigma_0_MPa = {sigma_0}\nalpha = {alpha}\nn = {n}\n\
         [cohesive]\nphi_n_N_per_mm = 1.0\ndelta_n_mm = 0.005\ndelta_t_mm = 0.05\nr = 4.0\n\
         [force]\nfile = \"load.csv\"\ncolumn = \"region\"\ngroup = \"upper\"\nwidth_mm = 1.0\nuse = false\n"
    );
    std::fs::write(out.join("cut.toml"), case).unwrap();
    let (case, result) = (out.join("cut.toml"), out.join("cut"));
    let done = quadrille(&["simulate", case.to_str().unwrap(), "--output", result.to_str().unwrap()]);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let read = |path: &Path| -> Vec<Vec<f64>> {
        let text = std::fs::read_to_string(path).unwrap();
        let rows = text.lines().filter(|line| !line.starts_with('#')).skip(1);
        rows.map(|row| row.split(',').map(|v| v.parse().unwrap()).collect()).collect()
    };
    let (got, want) = (read(&result.join("solution.csv")), read(&out.join("truth/displacement.csv")));
    assert_eq!(got.len(), want.len());
    for (got, want) in got.iter().zip(&want) {
        assert_eq!(got[..2], want[..2]);
        let off = (got[2] - want[2]).abs().max((got[3] - want[3]).abs());
        assert!(off < 1e-11, "{off:e} mm at instant {}, node {}", got[0], got[1]); // 1e-9 of the largest displacement
    }
    // The load cell of the part that is shown is its reaction; that of the grips is of another size.
    let text = std::fs::read_to_string(result.join("force.csv")).unwrap();
    let forces: Vec<Vec<f64>> = text
        .lines()
        .filter(|line| !line.starts_with(['#', 'i']))
        .map(|line| line.split(',').map(|v| v.parse().unwrap()).collect())
        .collect();
    let largest = forces.iter().map(|row| row[1].abs()).fold(0.0, f64::max);
    assert!(forces.len() == 19 && largest > 1.0, "{text}");
    for row in &forces {
        assert!((row[1] - row[2]).abs() < 1e-8 * largest, "{row:?}");
    }
    // The opening where the joint opens most: that of the true field, between the faces there.
    let opens = |instant: f64| {
        let at = want.iter().filter(|row| row[0] == instant).map(|row| row[3]);
        at.clone().fold(f64::MIN, f64::max) - at.fold(f64::MAX, f64::min)
    };
    for row in &forces {
        assert!(row[3] > 0.0 && row[3] < 1.001 * opens(row[0]), "{row:?}, {}", opens(row[0]));
    }
    assert!(forces[18][3] > 0.5 * opens(forces[18][0]) && result.join("figures/force-opening.png").is_file());
}

#[test]
fn another_law_has_the_same_strengths_moves_the_joint_otherwise_and_the_case_file_does_not_tell() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("test");
    let done = quadrille(&[
        "make",
        "virtual-test",
        "--law",
        "bilinear-power",
        "--instants",
        "2",
        "--output",
        out.to_str().unwrap(),
    ]);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let truth = json(&out.join("truth.json"));
    assert_eq!(truth["law"], "bilinear-power");
    assert_eq!(truth["instants"].as_array().unwrap().len(), 2);
    let usual = ExtendedXuNeedleman::new(1.0, 0.005, 0.05, 4.0).unwrap();
    for (key, want) in [("normal", usual.peak().normal), ("tangential", usual.peak().tangential)] {
        let is = truth["peak_traction_MPa"][key].as_f64().unwrap();
        // Corners are rounded; the strengths are those of the rounded law.
        assert!((is / want - 1.0).abs() < 1e-9, "{key}: {is} and {want}");
    }
    // The path is the same whatever the number of instants: the last of two is the last of 19.
    let other = VirtualTest::new(VirtualOptions { instants: 2, ..VirtualOptions::default() }).unwrap();
    let law = law_like("bilinear-power", &usual).unwrap();
    let same = VirtualTest::with_law(*other.options(), law).unwrap();
    let apart = |k: usize| {
        let [a, b] = [&other, &same].map(|test| &test.solution().instants[k].displacement);
        a.iter().zip(b).map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]) / PIXEL_MM).fold(0.0, f64::max)
    };
    assert!(apart(0).max(apart(1)) > 0.1, "{} {} px", apart(0), apart(1));
    let case = std::fs::read_to_string(out.join("case.toml")).unwrap();
    assert!(case.contains("model = \"extended-xu-needleman\"") && !case.contains("bilinear"), "{case}");
    assert!(case.contains("\"delta_t\", \"r\"]") && !case.contains("and with this r"), "{case}");
    let refused = quadrille(&["make", "virtual-test", "--law", "linear", "--output", out.to_str().unwrap()]);
    assert!(refused.status.code() == Some(2) && String::from_utf8_lossy(&refused.stderr).contains("trapezoidal-power"));
}

/// The virtual test takes seconds to make: all that is asked of it is one test.
#[test]
fn the_virtual_test_holds_what_each_of_these_says() {
    small_strains_hold_because_no_strip_turns_by_more_than_a_fiftieth();
    the_crack_runs_from_right_to_left_through_the_region_with_compression_ahead();
    both_modes_are_there();
    the_motion_of_a_node_is_its_computed_displacement_with_y_turned_down();
    the_region_is_cut_where_the_zones_lie();
    the_band_is_dark_and_the_strips_are_not();
}
