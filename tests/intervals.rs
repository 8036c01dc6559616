//! Intervals and bands over many draws of noise: where the problem is linear, and where it is not.

mod mechanics_common;

use mechanics_common::{adhesive, aluminium, virtual_r4};
use quadrille::identify::{
    Fit, FitOptions, FitStatus, NORMAL_95, Noise, Observation, ObservedInstant, Precision, Problem, Unknowns,
    WeightKind, bands, fit, largest_without_rigid_motion,
};
use quadrille::mechanics::cohesive::Traction;
use quadrille::mechanics::{
    BoundaryHistory, ForwardOptions, Joint, JointMesh, MeasuredMesh, Model, ModelOptions, Solution,
};
use rayon::prelude::*;
use std::sync::Arc;

const TRUTH: [f64; 3] = [1.0, 0.005, 0.05];
/// 1 px of the reference test, mm.
const PX: f64 = 0.00193125;

/// A joint whose true displacements are known.
struct Known {
    mesh: JointMesh,
    boundary: BoundaryHistory,
    truth: Solution,
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
        let n = self.mesh.nodes().len();
        let noise = white(2 * n, sigma).draw(self.truth.instants.len(), seed);
        let add = |(u, e): (&[f64; 2], &[f64])| [u[0] + e[0], u[1] + e[1]];
        let of = |(instant, e): (&quadrille::mechanics::Instant, &Vec<f64>)| {
            instant.displacement.iter().zip(e.chunks_exact(2)).map(add).collect()
        };
        self.truth.instants.iter().zip(&noise).map(of).collect()
    }

    /// The joint whose border moves as `fields` say.
    fn joint(&self, fields: &[Vec<[f64; 2]>]) -> Joint {
        let nodes = self.boundary.nodes().to_vec();
        let of = |field: &Vec<[f64; 2]>| nodes.iter().map(|&node| field[node as usize]).collect();
        let boundary = BoundaryHistory::new(nodes.clone(), fields.iter().map(of).collect()).unwrap();
        let materials = aluminium(self.mesh.groups().len());
        let model = Model::new(self.mesh.clone(), materials, &nodes, ModelOptions::default()).unwrap();
        let measured = MeasuredMesh { mesh: self.mesh.clone(), prescribed: nodes, carry: None };
        let law = Box::new(adhesive([1.0; 4]));
        Joint { model, law, boundary, measured, removed: Vec::new(), doubts: Vec::new() }
    }

    /// What is to be fitted to `fields`, the border being prescribed as they say.
    fn problem<'a>(&self, joint: &'a Joint, fields: &[Vec<[f64; 2]>], sigma: f64) -> Problem<'a> {
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
        let observation = Arc::new(Observation { nodes, compared, prescribed, instants });
        Problem { joint, observation, noise: Arc::new(noise), unknowns }
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
    }
}

/// Shares of tractions that lie within their bands: by third of the joint, and where the adhesive is compressed; the bands,
/// and those of 1.96 standard uncertainties; T_n and T_t.
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

fn covariance() -> FitOptions {
    FitOptions {
        weights: WeightKind::Covariance,
        discretisation: quadrille::identify::Discretisation::Off,
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
