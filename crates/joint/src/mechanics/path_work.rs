//! Work along a piece of the path between two states, and along straight changes of a jump.

use super::Model;
use super::cohesive::{CohesiveLaw, Jump, Touching, Traction};
use super::element::{ElementVector, Interface};
use crate::mesh::GAUSS;

/// A solution on the way from one instant to the next.
#[derive(Debug)]
pub(super) struct State {
    /// Share of the step.
    pub share: f64,
    pub u: Vec<[f64; 2]>,
    /// Displacements of the loaded nodes and of the points of blocks.
    pub places: Vec<[f64; 2]>,
    pub rates: Rates,
}

/// What forces are weighed with in the virtual work of a step, and what the reactions do, per share of it.
#[derive(Debug)]
pub(super) struct Rates {
    pub nodes: Vec<[f64; 2]>,
    /// Of the loaded nodes and of the points of blocks.
    pub loaded: Vec<[f64; 2]>,
    pub power: f64,
}

/// Places and weights of three Gauss points from 0 to 1.
const GAUSS_3: [(f64, f64); 3] =
    [(0.112_701_665_379_258_31, 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.887_298_334_620_741_7, 5.0 / 18.0)];

/// A piece of the path: a line or a parabola through its states, at 0, (a half) and 1.
pub(super) struct Piece<'a> {
    pub model: &'a Model,
    pub law: &'a dyn CohesiveLaw,
    /// Both ends, the middle between them of a parabola.
    pub states: Vec<&'a State>,
}

/// Weights of the states at `s`, and the derivatives of these.
fn weights(n: usize, s: f64) -> ([f64; 3], [f64; 3]) {
    match n {
        2 => ([1.0 - s, s, 0.0], [-1.0, 1.0, 0.0]),
        _ => (
            [(1.0 - s) * (1.0 - 2.0 * s), 4.0 * s * (1.0 - s), s * (2.0 * s - 1.0)],
            [4.0 * s - 3.0, 4.0 - 8.0 * s, 4.0 * s - 1.0],
        ),
    }
}

impl Piece<'_> {
    /// A nodal field at `s`.
    fn at(&self, s: f64, of: impl Fn(&State) -> &[[f64; 2]]) -> Vec<[f64; 2]> {
        let (weights, _) = weights(self.states.len(), s);
        let fields: Vec<&[[f64; 2]]> = self.states.iter().map(|state| of(state)).collect();
        let value = |node: usize| {
            [0, 1].map(|c| fields.iter().zip(&weights).map(|(field, weight)| weight * field[node][c]).sum())
        };
        (0..fields[0].len()).map(value).collect()
    }

    /// What the strips do at the rates of the states less what `loads(s, places, rates)` takes, per share of the step.
    pub fn strips(&self, loads: impl Fn(f64, &[[f64; 2]], &[[f64; 2]]) -> f64) -> f64 {
        let power = |&(s, weight): &(f64, f64)| {
            let strips = self.model.strip_power(&self.at(s, |state| &state.u), &self.at(s, |state| &state.rates.nodes));
            let (places, rates) = (self.at(s, |state| &state.places), self.at(s, |state| &state.rates.loaded));
            weight * (strips - loads(s, &places, &rates))
        };
        GAUSS_3.iter().map(power).sum()
    }

    /// What the adhesive does at the rates of the states, per share of the step, and the work done on it, to about
    /// `tolerance` (MPa mm) at every point.
    pub fn interface(&self, tolerance: f64) -> [f64; 2] {
        let touching = Touching(self.law);
        let n = self.states.len();
        let mut sum = [0.0; 2];
        for (element, interface, cracked) in self.model.bonds() {
            let law: &dyn CohesiveLaw = if cracked { &touching } else { self.law };
            let mut u = [ElementVector::zeros(); 3];
            let mut rates = [ElementVector::zeros(); 3];
            for (k, state) in self.states.iter().enumerate() {
                u[k] = self.model.gather(element, &state.u);
                rates[k] = self.model.gather(element, &state.rates.nodes);
            }
            let of =
                Along { interface, law, small: self.model.options().kinematics.is_small(), n, u: &u, rates: &rates };
            for k in 0..2 {
                let weight = interface.points()[k].weight;
                let [virtual_work, work] = of.point(k, tolerance);
                sum = [sum[0] + weight * virtual_work, sum[1] + weight * work];
            }
        }
        sum
    }
}

/// An interface element along a piece.
struct Along<'a> {
    interface: &'a Interface,
    law: &'a dyn CohesiveLaw,
    small: bool,
    n: usize,
    u: &'a [ElementVector; 3],
    rates: &'a [ElementVector; 3],
}

impl Along<'_> {
    /// `int T . rate ds` and `int T . d(jump)` at a point.
    fn point(&self, k: usize, tolerance: f64) -> [f64; 2] {
        let (point, n) = (&self.interface.points()[k], self.n);
        // Where rotations are small both are linear in the displacements.
        let jump = |u: &ElementVector| self.interface.jump(point, u).vector();
        let (jumps, rates) = match self.small {
            true => (self.u.map(|u| jump(&u)), self.rates.map(|rate| jump(&rate))),
            false => Default::default(),
        };
        let power = |s: f64| {
            let (weights, slopes) = weights(n, s);
            let (jump, change, rate) = if self.small {
                let sum =
                    |of: &[nalgebra::Vector2<f64>; 3], by: &[f64; 3]| of[0] * by[0] + of[1] * by[1] + of[2] * by[2];
                (sum(&jumps, &weights), sum(&jumps, &slopes), sum(&rates, &weights))
            } else {
                let sum = |of: &[ElementVector; 3], by: &[f64; 3]| of[0] * by[0] + of[1] * by[1] + of[2] * by[2];
                let u = sum(self.u, &weights);
                let along = |by: ElementVector| self.interface.jump_change(point, &u, &by).vector();
                (jump(&u), along(sum(self.u, &slopes)), along(sum(self.rates, &weights)))
            };
            let traction = self.law.response(Jump::from(jump)).traction.vector();
            [traction.dot(&rate), traction.dot(&change)]
        };
        let over = |begin: f64, end: f64| {
            let mut sum = [0.0; 2];
            for (place, weight) in GAUSS_3 {
                let [a, b] = power(begin + place * (end - begin));
                sum = [sum[0] + weight * (end - begin) * a, sum[1] + weight * (end - begin) * b];
            }
            sum
        };
        halved(&over, [0.0, 1.0], over(0.0, 1.0), tolerance, 14)
    }
}

/// An integral over a range, of which `whole` is known; it is halved until that changes nothing.
fn halved(
    over: &dyn Fn(f64, f64) -> [f64; 2],
    [begin, end]: [f64; 2],
    whole: [f64; 2],
    tolerance: f64,
    depth: u32,
) -> [f64; 2] {
    let middle = 0.5 * (begin + end);
    let (left, right) = (over(begin, middle), over(middle, end));
    let sum = [left[0] + right[0], left[1] + right[1]];
    if depth == 0 || (0..2).all(|k| (sum[k] - whole[k]).abs() <= tolerance) {
        return sum;
    }
    let left = halved(over, [begin, middle], left, 0.5 * tolerance, depth - 1);
    let right = halved(over, [middle, end], right, 0.5 * tolerance, depth - 1);
    [left[0] + right[0], left[1] + right[1]]
}

/// `int T . d(jump)` of opening and of sliding (MPa mm) along the straight line between two jumps. Pieces are short
/// against the law, and one ends where the faces touch, since laws have a kink there.
pub(super) fn works_along(law: &dyn CohesiveLaw, from: Jump, to: Jump) -> [f64; 2] {
    let by = to - from;
    let at = |share: f64| Jump {
        normal: from.normal + share * by.normal,
        tangential: from.tangential + share * by.tangential,
    };
    let touch = if from.normal * to.normal < 0.0 { -from.normal / by.normal } else { 1.0 };
    let pieces = (40.0 * by.normal.hypot(by.tangential) / law.front_opening()).ceil().clamp(1.0, 200.0);
    let mut sum = [0.0; 2];
    for [begin, end] in [[0.0, touch], [touch, 1.0]] {
        let width = (end - begin) / pieces;
        if width <= 0.0 {
            continue;
        }
        for piece in 0..pieces as usize {
            for place in GAUSS {
                let share = begin + (piece as f64 + place) * width;
                let Traction { normal, tangential } = law.response(at(share)).traction;
                sum[0] += 0.5 * width * normal * by.normal;
                sum[1] += 0.5 * width * tangential * by.tangential;
            }
        }
    }
    sum
}
