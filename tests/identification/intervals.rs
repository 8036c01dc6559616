//! Intervals and bands over many draws of noise: where the problem is linear, and where it is not.

use crate::mechanics_common;
use mechanics_common::{adhesive, aluminium, virtual_r4};
use quadrille::identify::{
    Border, Fit, FitOptions, FitStatus, FitWatch, IntervalKind, Intervals, NORMAL_95, Noise, Observation,
    ObservedInstant, Precision, Problem, Unknowns, WeightKind, bands, fit, largest_without_rigid_motion,
};
use quadrille::linalg::Dense;
use quadrille::mechanics::cohesive::Traction;
use quadrille::mechanics::{
    BoundaryHistory, Drives, ForwardOptions, Joint, JointMesh, MeasuredMesh, Model, ModelOptions, Solution,
};
use rayon::prelude::*;
use std::sync::Arc;

pub(crate) const TRUTH: [f64; 3] = [1.0, 0.005, 0.05];
/// 1 px of the reference test, mm.
pub(crate) const PX: f64 = 0.00193125;

/// A joint whose true displacements are known.
pub(crate) struct Known {
    pub(crate) mesh: JointMesh,
    boundary: BoundaryHistory,
    pub(crate) truth: Solution,
    /// The nodes compared; all when there is no list.
    selected: Option<Vec<u32>>,
}

impl Known {
    fn new(mesh: JointMesh, boundary: BoundaryHistory, selected: Option<Vec<u32>>) -> Self {
        let model = mechanics_common::model_of(&mesh, &boundary, ModelOptions::default());
        let truth = model.forward(&adhesive([1.0; 4]), &boundary, &ForwardOptions::default()).unwrap();
        assert!(truth.converged());
        Self { mesh, boundary, truth, selected }
    }

    /// The reference test, its first `n` instants, with the nodes that the paper compares or with all.
    fn reference(n: usize, all_nodes: bool) -> Option<Self> {
        let (mesh, boundary) = virtual_r4()?;
        let selected =
            mechanics_common::numbers(&mechanics_common::reference("virtual_r4/mesh.json")?["selected_nodes"]);
        let selected = (!all_nodes).then(|| selected.into_iter().map(|node| node as u32).collect());
        Some(Self::new(mesh, boundary.up_to(n), selected))
    }

    /// The fields with noise of `sigma` mm in each frame, half of its variance from the common reference.
    fn noisy(&self, sigma: f64, seed: u64) -> Vec<Vec<[f64; 2]>> {
        self.with_noise(&white(2 * self.mesh.nodes().len(), sigma), seed)
    }

    /// The fields with a draw of `noise` at all nodes.
    pub(crate) fn with_noise(&self, noise: &Noise, seed: u64) -> Vec<Vec<[f64; 2]>> {
        let noise = noise.draw(self.truth.instants.len(), seed);
        let add = |(u, e): (&[f64; 2], &[f64])| [u[0] + e[0], u[1] + e[1]];
        let of = |(instant, e): (&quadrille::mechanics::Instant, &Vec<f64>)| {
            instant.displacement.iter().zip(e.chunks_exact(2)).map(add).collect()
        };
        self.truth.instants.iter().zip(&noise).map(of).collect()
    }

    /// The joint whose border moves as `fields` say.
    pub(crate) fn joint(&self, fields: &[Vec<[f64; 2]>]) -> Joint {
        let nodes = self.boundary.nodes().to_vec();
        let of = |field: &Vec<[f64; 2]>| nodes.iter().map(|&node| field[node as usize]).collect();
        let boundary = BoundaryHistory::new(nodes.clone(), fields.iter().map(of).collect()).unwrap();
        let materials = aluminium(self.mesh.groups().len());
        let model = Model::new(self.mesh.clone(), materials, &nodes, ModelOptions::default()).unwrap();
        let drives = Drives::default();
        let measured = MeasuredMesh { mesh: self.mesh.clone(), prescribed: nodes, carry: None, drives };
        let law = Box::new(adhesive([1.0; 4]));
        let (groups, removed, remarks) = (Vec::new(), Vec::new(), Vec::new());
        Joint { model, law, boundary, measured, groups, removed, remarks }
    }

    /// What is to be fitted to `fields`, the border being prescribed as they say.
    pub(crate) fn problem<'a>(&self, joint: &'a Joint, fields: &[Vec<[f64; 2]>], sigma: f64) -> Problem<'a> {
        let border = self.boundary.nodes();
        let n = self.mesh.nodes().len();
        let mut compared = vec![self.selected.is_none(); n];
        self.selected.iter().flatten().for_each(|&node| compared[node as usize] = true);
        border.iter().for_each(|&node| compared[node as usize] = false);
        let nodes: Vec<u32> = (0..n as u32).filter(|&node| compared[node as usize] || border.contains(&node)).collect();
        let prescribed = border.iter().map(|node| nodes.iter().position(|other| other == node).unwrap()).collect();
        let instant = |(index, field): (usize, &Vec<[f64; 2]>)| ObservedInstant {
            index,
            displacement: nodes.iter().flat_map(|&node| field[node as usize]).collect(),
            largest: largest_without_rigid_motion(
                &self.mesh.nodes().iter().copied().zip(field.iter().copied()).collect::<Vec<_>>(),
            ),
            factor: 1.0,
        };
        let instants = fields.iter().enumerate().map(instant).collect();
        let compared = nodes.iter().map(|&node| compared[node as usize]).collect();
        let noise = white(2 * nodes.len(), sigma);
        let start = |k: usize| (k, TRUTH[k] * [1.01, 0.996, 1.004][k], None, None);
        let unknowns = Unknowns::new(&adhesive([1.0; 4]), &[start(0), start(1), start(2)]).unwrap();
        let observation = Arc::new(Observation {
            nodes,
            compared,
            prescribed,
            instants,
            pixel_size_mm: None,
            force: None,
            held: None,
            camera: Vec::new(),
        });
        let border = Arc::new(Border::free(joint));
        Problem { joint, observation, border, noise: Arc::new(noise), unknowns, watch: FitWatch::default() }
    }
}

/// White noise of `sigma` mm in each frame, half of its variance from the common reference, at the border too.
fn white(n_rows: usize, sigma: f64) -> Noise {
    Noise {
        precision: Precision::White(n_rows),
        common: 1.0,
        on_boundary: true,
        sigma: Some(sigma * 0.5_f64.sqrt()),
        source: "white".into(),
        ratio: None,
    }
}

/// Shares of tractions that lie within their bands: by third of the joint, and where the adhesive is compressed; the
/// bands, and those of 1.96 standard uncertainties; T_n and T_t.
#[derive(Default, Clone)]
struct Held {
    /// Within the band, within 1.96 std, all.
    counts: [[[f64; 3]; 2]; 4],
}

impl Held {
    fn add(&mut self, problem: &Problem<'_>, found: &Fit, known: &Known) {
        let law = adhesive([1.0; 4]);
        for band in bands(problem, found).unwrap() {
            let truth = problem.joint.model.tractions(&law, &known.truth.instants[band.instant - 1].displacement);
            let n = truth.len();
            for (k, t) in truth.iter().enumerate() {
                let pick: [fn(&Traction) -> f64; 2] = [|t| t.normal, |t| t.tangential];
                for (c, pick) in pick.into_iter().enumerate() {
                    let within = pick(&band.low[k]) <= pick(t) && pick(t) <= pick(&band.high[k]);
                    let linear = (pick(&band.traction[k]) - pick(t)).abs() <= NORMAL_95 * pick(&band.std[k]);
                    let places = [Some(3 * k / n), (t.normal < 0.0).then_some(3)];
                    for place in places.into_iter().flatten() {
                        let count = &mut self.counts[place][c];
                        *count = [count[0] + f64::from(within), count[1] + f64::from(linear), count[2] + 1.0];
                    }
                }
            }
        }
    }

    fn sum(mut self, other: &Self) -> Self {
        let all = self.counts.as_flattened_mut().as_flattened_mut().iter_mut();
        all.zip(other.counts.as_flattened().as_flattened()).for_each(|(a, b)| *a += b);
        self
    }

    /// In per cent: bands, and 1.96 standard uncertainties.
    fn share(&self, place: usize, component: usize) -> [f64; 2] {
        let [held, linear, n] = self.counts[place][component];
        [100.0 * held / n, 100.0 * linear / n]
    }

    fn print(&self) {
        for (place, name) in ["first third", "middle third", "last third", "compressed"].into_iter().enumerate() {
            let [n, t] = [0, 1].map(|c| self.share(place, c));
            println!(
                "  {name}: T_n {:.1} % in the band ({:.1} % in 1.96 std), T_t {:.1} % ({:.1} %) of {}",
                n[0], n[1], t[0], t[1], self.counts[place][0][2]
            );
        }
    }
}

fn one(known: &Known, sigma_px: f64, options: &FitOptions, seed: u64, then: &mut dyn FnMut(&Problem<'_>, &Fit)) {
    let fields = known.noisy(sigma_px * PX, seed);
    let joint = known.joint(&fields);
    let problem = known.problem(&joint, &fields, sigma_px * PX);
    let found = fit(&problem, options).unwrap();
    then(&problem, &found);
}

pub(crate) fn covariance() -> FitOptions {
    FitOptions {
        weights: WeightKind::Covariance,
        discretisation: quadrille::identify::Discretisation::Off,
        doubt: false,
        ..FitOptions::default()
    }
}

#[test]
#[ignore = "minutes: make study"]
fn bands_by_third_and_in_compression_over_many_draws() {
    for (sigma_px, all, options) in
        [(0.05, false, FitOptions { weights: WeightKind::Paper, ..covariance() }), (0.05, true, covariance())]
    {
        let Some(known) = Known::reference(19, all) else { return };
        let n: u64 = std::env::var("DRAWS").ok().and_then(|n| n.parse().ok()).unwrap_or(20);
        let held = (1..=n)
            .into_par_iter()
            .map(|seed| {
                let mut held = Held::default();
                one(&known, sigma_px, &options, seed, &mut |problem, found| {
                    if found.status == FitStatus::Converged {
                        held.add(problem, found, &known);
                    }
                });
                held
            })
            .collect::<Vec<_>>();
        println!("{sigma_px} px, all nodes {all}:");
        held.iter().skip(1).fold(held[0].clone(), |sum, one| sum.sum(one)).print();
    }
}

/// A small joint that opens and slides, `scale` times as far as to break it.
pub(crate) fn small(scale: f64) -> Known {
    let mesh = JointMesh::rectangular(8, 3, 0.0309, 0.06).unwrap();
    let nodes = mesh.outer_nodes();
    let at = |k: u32, node: u32| {
        let [x, y] = mesh.nodes()[node as usize];
        let (side, t) = (y.signum(), scale * f64::from(k));
        [side * 0.004 * t, side * 0.003 * t * (0.1 + 4.0 * x)]
    };
    let instants = (1..=4).map(|k| nodes.iter().map(|&node| at(k, node)).collect()).collect();
    let boundary = BoundaryHistory::new(nodes.clone(), instants).unwrap();
    Known::new(mesh, boundary, None)
}

/// What the intervals of many draws came to, over all parameters.
#[derive(Debug, Default)]
struct Coverage {
    converged: f64,
    in_doubt: f64,
    /// Intervals with two ends that hold the truth, and those that do not.
    held: f64,
    missed: f64,
    /// Intervals without one of their ends: those that say that the data do not determine the parameter.
    open: f64,
    /// Intervals of 1.96 standard uncertainties that hold the truth.
    linear: f64,
    failed: f64,
    errors: [Vec<f64>; 3],
    bias: [f64; 3],
    std: [f64; 3],
    std_bootstrap: [f64; 3],
}

fn coverage(known: &Known, sigma_px: f64, options: &FitOptions, n: u64) -> Coverage {
    let begin = std::time::Instant::now();
    let fits: Vec<Option<(Vec<quadrille::identify::FittedParameter>, bool, usize)>> = (1..=n)
        .into_par_iter()
        .map(|seed| {
            let mut kept = None;
            one(known, sigma_px, options, seed, &mut |_, found| {
                let basis = found.intervals.as_ref();
                let failed = basis.and_then(|b| b.bootstrap.as_ref()).map_or(0, |b| b.failed);
                // An open side is never determined, and the verdict says whose it is.
                for p in found.parameters.iter().filter(|p| p.ends95.contains(&None) && !p.at_bound) {
                    let said = found.verdict.sentences.join(". ");
                    let wanted = format!("{} is not determined: its 95 % interval has", p.parameter.name);
                    assert!(!found.verdict.determined() && said.contains(&wanted), "{p:?} {said}");
                    assert_eq!(p.relative_std(), f64::INFINITY);
                }
                if found.status == FitStatus::Converged {
                    kept = Some((
                        found.parameters.clone(),
                        basis.is_some_and(|b| b.kind == IntervalKind::Profile),
                        failed,
                    ));
                }
            });
            kept
        })
        .collect();
    let mut sum = Coverage::default();
    for (parameters, in_doubt, failed) in fits.iter().flatten() {
        sum.converged += 1.0;
        sum.in_doubt += f64::from(*in_doubt);
        sum.failed += *failed as f64;
        for (k, (p, truth)) in parameters.iter().zip(TRUTH).enumerate() {
            match p.ends95 {
                [Some(low), Some(high)] if low <= truth && truth <= high => sum.held += 1.0,
                [Some(_), Some(_)] => sum.missed += 1.0,
                _ => sum.open += 1.0,
            }
            sum.linear += f64::from((p.value - truth).abs() <= NORMAL_95 * p.std.unwrap());
            sum.errors[k].push(p.value / truth - 1.0);
            sum.bias[k] += p.bias.unwrap_or(0.0) / truth;
            sum.std[k] += (p.std.unwrap() / truth).powi(2);
            sum.std_bootstrap[k] += (p.std_bootstrap.unwrap_or(0.0) / truth).powi(2);
        }
    }
    let c = sum.converged;
    let per_cent = |values: [f64; 3]| values.map(|v| format!("{:+.2}", 100.0 * v)).join(", ");
    let mean = [0, 1, 2].map(|k| sum.errors[k].iter().sum::<f64>() / c);
    let scatter =
        [0, 1, 2].map(|k| (sum.errors[k].iter().map(|e| (e - mean[k]).powi(2)).sum::<f64>() / (c - 1.0)).sqrt());
    println!(
        "{sigma_px} px: {c} of {n} converged, {} in doubt, {:.1} draws of a bootstrap failed; intervals: {:.1} % hold, {:.1} % miss, \
         {:.1} % open; 1.96 std: {:.1} % hold; mean error {} %, told bias {} %, scatter {} %, std {} %, bootstrap std {} %; {:.1} s",
        sum.in_doubt,
        sum.failed / c,
        100.0 * sum.held / (3.0 * c),
        100.0 * sum.missed / (3.0 * c),
        100.0 * sum.open / (3.0 * c),
        100.0 * sum.linear / (3.0 * c),
        per_cent(mean),
        per_cent(sum.bias.map(|b| b / c)),
        per_cent(scatter),
        per_cent(sum.std.map(|v| (v / c).sqrt())),
        per_cent(sum.std_bootstrap.map(|v| (v / c).sqrt())),
        begin.elapsed().as_secs_f64()
    );
    sum
}

fn n_draws(usual: u64) -> u64 {
    std::env::var("DRAWS").ok().and_then(|n| n.parse().ok()).unwrap_or(usual)
}

/// The reference test at `levels` of noise in px, the paper's weights and nodes.
fn over_levels(n_instants: usize, levels: &[f64]) {
    let paper = FitOptions { weights: WeightKind::Paper, ..covariance() };
    for &sigma_px in levels {
        let Some(known) = Known::reference(n_instants, false) else { return };
        println!("{n_instants} instants");
        let sum = coverage(&known, sigma_px, &paper, n_draws(40));
        // The figure, or the interval says that it has no end.
        assert!((sum.held + sum.open) / (3.0 * sum.converged) >= 0.9, "{sum:?}");
    }
}

#[test]
#[ignore = "half an hour: make study"]
fn intervals_of_forty_draws_hold_where_the_problem_is_not_linear() {
    over_levels(19, &[0.05, 0.1, 0.4]);
}

#[test]
#[ignore = "minutes: make study"]
fn intervals_of_forty_draws_hold_where_only_the_elastic_stage_is_loaded() {
    over_levels(3, &[0.05, 0.2]);
}

#[test]
#[ignore = "minutes: make study"]
fn intervals_of_covariance_weights_hold_the_truth() {
    let Some(known) = Known::reference(19, true) else { return };
    for sigma_px in [0.05, 0.1] {
        coverage(&known, sigma_px, &covariance(), n_draws(20));
    }
}

#[test]
fn intervals_hold_on_a_small_joint_with_much_noise_and_where_it_is_loaded_too_little_to_break() {
    let paper = FitOptions { weights: WeightKind::Paper, bootstrap: Some(8), ..covariance() };
    // Linear theory would give standard uncertainties of 10 %, and of any size where the joint is loaded a tenth as
    // far.
    let (broken, elastic) = (coverage(&small(1.0), 0.02, &paper, 8), coverage(&small(0.1), 0.01, &paper, 8));
    for sum in [&broken, &elastic] {
        assert!(sum.in_doubt == sum.converged && sum.converged >= 6.0, "{sum:?}");
        // Of 24 intervals of 95 % fewer than 20 hold once in 200 times.
        assert!((sum.held + sum.open) / (3.0 * sum.converged) >= 0.8, "{sum:?}");
    }
    // The slope of the law alone is felt: works of separation have no upper end, or one far away.
    assert!(elastic.open > 0.0, "{elastic:?}");
}

#[test]
fn a_nearly_linear_problem_keeps_its_linear_intervals_and_profile_intervals_of_it_are_the_same() {
    let known = small(1.0);
    let paper = FitOptions { weights: WeightKind::Paper, ..covariance() };
    let fitted = |intervals: Intervals| {
        let options = FitOptions { intervals, bootstrap: Some(0), ..paper.clone() };
        let mut kept = None;
        one(&known, 0.002, &options, 3, &mut |_, found| {
            kept = Some((found.parameters.clone(), found.intervals.clone()))
        });
        kept.unwrap()
    };
    let (auto, basis) = fitted(Intervals::Auto);
    let basis = basis.unwrap();
    assert!(basis.kind == IntervalKind::Linear && !basis.linearity.in_doubt(), "{:?}", basis.linearity);
    let (profile, basis) = fitted(Intervals::Profile);
    assert_eq!(basis.unwrap().kind, IntervalKind::Profile);
    for (auto, profile) in auto.iter().zip(&profile) {
        assert_eq!(auto.value, profile.value);
        let half = NORMAL_95 * auto.std.unwrap();
        // Extended by the bias that the probe saw, to one side.
        let bias = auto.bias.unwrap();
        let [low, high] = auto.interval95.unwrap();
        assert!((high - low - 2.0 * half - bias.abs()).abs() < 1e-9 * half, "{auto:?}");
        for (side, sign) in [(0, -1.0), (1, 1.0)] {
            let end = profile.ends95[side].unwrap();
            // Second order in a standard uncertainty of about a per cent, and what is left of the search (5 % of a
            // std).
            assert!((end - (auto.value + sign * half)).abs() < 0.08 * half, "{auto:?} {profile:?}");
        }
    }
}

#[test]
fn a_bootstrap_is_the_same_for_any_number_of_threads() {
    let known = small(1.0);
    let intervals = Intervals::Profile;
    let options = FitOptions { weights: WeightKind::Paper, bootstrap: Some(6), intervals, ..covariance() };
    let with = |threads: usize| {
        let mut kept = None;
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            one(&known, 0.02, &options, 5, &mut |_, found| {
                kept = Some((found.parameters.clone(), found.intervals.clone()))
            })
        });
        kept.unwrap()
    };
    let (one, two) = (with(1), with(2));
    assert!(one.1.as_ref().unwrap().bootstrap.as_ref().unwrap().draws == 6);
    assert_eq!(one, two);
}

#[test]
fn draws_of_the_noise_have_its_covariance_in_space_and_time() {
    let (rows, instants, n) = (3, 2, 6000);
    let root = Dense::from_fn(rows, rows, |r, c| [[1.0, 0.0, 0.0], [0.5, 0.8, 0.0], [-0.3, 0.4, 1.2]][r][c]);
    let covariance = Dense::from_fn(rows, rows, |r, c| (0..rows).map(|k| root[(r, k)] * root[(c, k)]).sum());
    let matrix = covariance.cholesky().unwrap().inverse();
    let (common, sigma) = (0.5, 0.2);
    let noise = Noise {
        precision: Precision::Marginal { covariance: covariance.clone(), matrix },
        common,
        on_boundary: false,
        sigma: Some(sigma),
        source: String::new(),
        ratio: None,
    };
    assert_eq!(noise.draw(instants, 9), noise.draw(instants, 9));
    let draws: Vec<Vec<Vec<f64>>> = (0..n).map(|seed| noise.draw(instants, seed)).collect();
    for (i, j, r, c) in (0..36).map(|k| (k % 2, k / 2 % 2, k / 4 % 3, k / 12)) {
        let mean = draws.iter().map(|e| e[i][r] * e[j][c]).sum::<f64>() / n as f64;
        let tie = f64::from(u8::from(i == j)) + common;
        let wanted = sigma * sigma * tie * covariance[(r, c)];
        // Five standard deviations of the mean of n products.
        let scale = sigma * sigma * (1.0 + common) * (covariance[(r, r)] * covariance[(c, c)]).sqrt();
        assert!((mean - wanted).abs() < 5.0 * 1.5 * scale / (n as f64).sqrt(), "{i} {j} {r} {c}: {mean} for {wanted}");
    }
}
