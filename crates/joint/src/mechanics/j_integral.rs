//! Energy release: the J-integral over domains of the strips, and the work of separation by mode along the joint
//! (THEORY 15).
//!
//! For a joint along the unit vector `t` and a weight `q` that is zero at the ends of a window,
//! `D(q) = sum_A (P grad q) . (H t) - W (t . grad q)`, `H` the displacement gradient, `P` the stress (first
//! Piola-Kirchhoff with finite rotations), `W` the energy of the strips. Their outer faces being free, what goes in is
//! what the tractions of the joint take out: `D(q) = -int q T . d(jump)/ds ds`. With `q = 1` over all of the process
//! zone that is J, whatever `q` does beyond.

use super::cohesive::{CohesiveLaw, Jump, Touching, Traction};
use super::{Instant, Kinematics, Model, Solution, works_along};
use nalgebra::{Matrix2, Vector2};
use thiserror::Error;

/// Shares of the window over which `q` rises and falls: three domains, whose difference is the path dependence.
const RAMPS: [f64; 3] = [0.1, 0.2, 0.3];
/// Elements that a ramp needs.
const LEAST: f64 = 1.9;
/// Force on a node, by the largest, up to which nothing pulls at it from outside: what Newton's iteration leaves.
const FREE: f64 = 1e-6;
/// How far normals of the joint may differ.
const STRAIGHT: f64 = 1e-3;

/// The energy that flows to the joint when its front moves by a unit of length, by mm of width.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JIntegral {
    /// Mean over the domains, N/mm; positive.
    pub value: f64,
    /// Largest difference of two domains, N/mm.
    pub spread: f64,
    /// The same from the tractions of the joint, of the largest domain, N/mm: `-int q T . d(jump)`.
    pub of_tractions: f64,
    /// Whether the front moves along the tangent of the joint.
    pub along: bool,
    /// The window that the domains lie in, mm along the joint from its first pair.
    pub window: [f64; 2],
}

/// Why there is no J-integral.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum JFault {
    /// The joint bends.
    #[error("the joint is not straight")]
    Curved,
    /// The border is held or loaded all along.
    #[error("between nodes that are held or loaded there is no room for a domain of free borders")]
    Loaded,
    /// The material of a strip changes along the joint.
    #[error("the material changes along the joint")]
    Graded,
}

/// Work of separation at a node pair, by mode, N/mm.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ModeWork {
    /// `int T_n d(D_n)`.
    pub opening: f64,
    /// `int T_t d(D_t)`.
    pub sliding: f64,
}

impl ModeWork {
    /// Share of sliding in the work, 0 to 1; `None` where nothing was done.
    pub fn sliding_share(&self) -> Option<f64> {
        let (opening, sliding) = (self.opening.max(0.0), self.sliding.max(0.0));
        (opening + sliding > 0.0).then(|| sliding / (opening + sliding))
    }
}

/// The phase angle of a traction, degrees: 0 opens, 90 slides; above that it is pressed.
pub fn phase_deg(traction: Traction) -> f64 {
    traction.tangential.abs().atan2(traction.normal).to_degrees()
}

/// The joint as a line: where its nodes lie along it.
struct Line {
    tangent: [f64; 2],
    /// Of every node, mm from the first pair.
    along: Vec<f64>,
    /// Of every pair.
    pairs: Vec<f64>,
    /// Whether a pair belongs to a crack alone.
    cracked: Vec<bool>,
}

impl Model {
    /// The J-integral under the displacements `u`, a solution.
    ///
    /// # Errors
    /// See [`JFault`].
    pub fn j_integral(&self, law: &dyn CohesiveLaw, u: &[[f64; 2]]) -> Result<JIntegral, JFault> {
        let line = self.line().ok_or(JFault::Curved)?;
        let jumps = self.jumps(u);
        let forces = self.forces(law, u);
        let window = self.window(&line, law, &jumps, &forces).ok_or(JFault::Loaded)?;
        if !self.even_along(&line, window) {
            return Err(JFault::Graded);
        }
        let size = self.mesh().element_size();
        let width = window[1] - window[0];
        let ramps = RAMPS.map(|share| (share * width).max(LEAST * size));
        let of_strips = self.over_domains(&line, u, window, ramps);
        let mean = of_strips.iter().sum::<f64>() / RAMPS.len() as f64;
        let (low, high) = of_strips.iter().fold((f64::MAX, f64::MIN), |(low, high), d| (low.min(*d), high.max(*d)));
        let of_tractions = of_tractions(&line, law, &jumps, window, ramps[0]);
        Ok(JIntegral {
            value: mean.abs(),
            spread: high - low,
            of_tractions: if mean < 0.0 { -of_tractions } else { of_tractions },
            along: mean >= 0.0,
            window,
        })
    }

    /// The J-integral at every instant of `solution`; `None` where there is no solution.
    pub fn j_integrals(&self, law: &dyn CohesiveLaw, solution: &Solution) -> Vec<Option<Result<JIntegral, JFault>>> {
        let of = |instant: &Instant| instant.status.converged().then(|| self.j_integral(law, &instant.displacement));
        solution.instants.iter().map(of).collect()
    }

    /// The work of separation at every node pair after each of the fields `u`, which follow each other.
    pub fn mode_works<'a>(
        &self,
        law: &dyn CohesiveLaw,
        fields: impl IntoIterator<Item = &'a Vec<[f64; 2]>>,
    ) -> Vec<Vec<ModeWork>> {
        let n = self.mesh().pairs().len();
        let (mut before, mut sums) = (vec![Jump::default(); n], vec![ModeWork::default(); n]);
        let (cracked, touching) = (self.mesh().cracked_pairs(), Touching(law));
        let after = |u: &'a Vec<[f64; 2]>| {
            let now = self.jumps(u);
            for (((sum, from), to), &cracked) in sums.iter_mut().zip(&before).zip(&now).zip(&cracked) {
                let [opening, sliding] = works_along(if cracked { &touching } else { law }, *from, *to);
                *sum = ModeWork { opening: sum.opening + opening, sliding: sum.sliding + sliding };
            }
            before = now;
            sums.clone()
        };
        fields.into_iter().map(after).collect()
    }

    /// The joint as a line, where it is one.
    fn line(&self) -> Option<Line> {
        let normals = self.pair_normals();
        let mut mean = [0.0; 2];
        normals.iter().for_each(|n| mean = [mean[0] + n[0], mean[1] + n[1]]);
        let length = mean[0].hypot(mean[1]);
        let normal = mean.map(|c| c / length);
        let straight = |n: &[f64; 2]| (n[0] - normal[0]).hypot(n[1] - normal[1]) < STRAIGHT;
        if !(length > 0.0 && normals.iter().all(straight)) {
            return None;
        }
        let tangent = [normal[1], -normal[0]];
        let positions = self.pair_positions();
        let (origin, _) = *positions.first()?;
        let along = |at: &[f64; 2]| (at[0] - origin[0]) * tangent[0] + (at[1] - origin[1]) * tangent[1];
        Some(Line {
            tangent,
            along: self.mesh().nodes().iter().map(along).collect(),
            pairs: positions.iter().map(|(at, _)| along(at)).collect(),
            cracked: self.mesh().cracked_pairs(),
        })
    }

    /// Between nodes with a force from outside the part of the joint in which the tractions do most.
    fn window(&self, line: &Line, law: &dyn CohesiveLaw, jumps: &[Jump], forces: &[[f64; 2]]) -> Option<[f64; 2]> {
        let size = self.mesh().element_size();
        let largest = forces.iter().flatten().fold(0.0_f64, |most, f| most.max(f.abs()));
        let held = (0..line.along.len()).filter(|&node| {
            let loaded = forces[node].iter().any(|f| f.abs() > FREE * largest);
            loaded || (0..2).any(|c| self.unknown(node, c).is_none())
        });
        let mut ends: Vec<f64> = held.map(|node| line.along[node]).collect();
        ends.extend(line.along.iter().copied().reduce(f64::min));
        ends.extend(line.along.iter().copied().reduce(f64::max));
        ends.sort_by(f64::total_cmp);
        let wide = |pair: &&[f64]| pair[1] - pair[0] > 3.0 * LEAST * size;
        let windows = ends.windows(2).filter(wide).map(|pair| [pair[0], pair[1]]);
        let work = |window: &[f64; 2]| of_tractions(line, law, jumps, *window, LEAST * size).abs();
        windows.max_by(|a, b| work(a).total_cmp(&work(b)))
    }

    /// Whether every group of elements that lies in the window lies there from end to end.
    fn even_along(&self, line: &Line, [from, to]: [f64; 2]) -> bool {
        let mesh = self.mesh();
        let size = mesh.element_size();
        (0..mesh.groups().len()).all(|group| {
            let of_group = mesh.elements().iter().zip(mesh.element_group()).filter(|(_, g)| **g as usize == group);
            let places = || of_group.clone().flat_map(|(corners, _)| corners.map(|node| line.along[node as usize]));
            let (first, last) = places().fold((f64::MAX, f64::MIN), |(first, last), at| (first.min(at), last.max(at)));
            let beside = last <= from || first >= to;
            beside || (first <= from + size && last >= to - size)
        })
    }

    /// `D(q)` for `q` that rises and falls over each of `ramps` at the ends of the window.
    fn over_domains(&self, line: &Line, u: &[[f64; 2]], window: [f64; 2], ramps: [f64; 3]) -> [f64; 3] {
        let tangent = Vector2::from(line.tangent);
        let small = self.options().kinematics != Kinematics::Finite;
        let q: Vec<[f64; 3]> = line.along.iter().map(|&at| ramps.map(|ramp| weight(at, window, ramp))).collect();
        let mut sums = [0.0; 3];
        self.for_each_point(u, |corners, material, point, strain| {
            let mut rises = [Vector2::zeros(); 3];
            let mut gradient = Matrix2::zeros();
            for (&node, &[gx, gy]) in corners.iter().zip(&point.gradients) {
                let [ux, uy] = u[node as usize];
                for (rise, q) in rises.iter_mut().zip(&q[node as usize]) {
                    *rise += *q * Vector2::new(gx, gy);
                }
                gradient += Matrix2::new(ux * gx, ux * gy, uy * gx, uy * gy);
            }
            if rises.iter().all(|rise| *rise == Vector2::zeros()) {
                return;
            }
            let [x, y, shear] = material.stress(strain).0;
            let stress = Matrix2::new(x, shear, shear, y);
            let stress = if small { stress } else { (Matrix2::identity() + gradient) * stress };
            let energy = material.energy(strain);
            let energy = energy.elastic + energy.plastic;
            for (sum, rise) in sums.iter_mut().zip(&rises) {
                *sum += point.weight * ((stress * rise).dot(&(gradient * tangent)) - energy * tangent.dot(rise));
            }
        });
        sums
    }
}

/// `q` at a place along the joint.
fn weight(at: f64, [from, to]: [f64; 2], ramp: f64) -> f64 {
    ((at - from) / ramp).min((to - at) / ramp).clamp(0.0, 1.0)
}

/// `-int q T . d(jump)` along the joint.
fn of_tractions(line: &Line, law: &dyn CohesiveLaw, jumps: &[Jump], window: [f64; 2], ramp: f64) -> f64 {
    let touching = Touching(law);
    let piece = |k: usize| {
        // The faces of a crack press on each other and hold nothing else.
        let law: &dyn CohesiveLaw = if line.cracked[k] || line.cracked[k + 1] { &touching } else { law };
        let q = 0.5 * (weight(line.pairs[k], window, ramp) + weight(line.pairs[k + 1], window, ramp));
        if q == 0.0 { 0.0 } else { -q * works_along(law, jumps[k], jumps[k + 1]).iter().sum::<f64>() }
    };
    (0..jumps.len().saturating_sub(1)).map(piece).sum()
}
