//! Reactions, and where the work that they do goes (THEORY 15).
//!
//! Along a path of equilibria `dW = F . du_D = dU + dA`: the work of the reactions is stored in the strips or done on the adhesive.
//! `U` is a function of the strain, exactly. `W` is summed along the path by Simpson's rule; `A = sum w int T . d(jump)` along
//! the path of each jump, which is taken as straight from one state to the next: exact for a law with a potential, else wrong
//! with the square of the step. Between two instants states are put in, each solved for, until neither sum changes any more.
//! Forces do work where their nodes go, `int f . du = [f . u] - int u . df`: what is summed along the path is the last term, which
//! needs no velocity.

use super::boundary::{BoundaryHistory, Drive};
use super::cohesive::{CohesiveLaw, Jump, Touching, Traction};
use super::groups::NodeGroup;
use super::model::{Model, Work};
use super::newton::{NewtonOptions, Path};
use super::solution::{Solution, Status};
use super::substrate::SubstrateEnergy;
use crate::mesh::GAUSS;

/// Energies at an instant, N mm per mm of width (mJ/mm).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Energies {
    /// Work that reactions and loads have done since rest.
    pub work: f64,
    /// Elastic energy of the strips.
    pub elastic: f64,
    /// Plastic work in the strips.
    pub plastic: f64,
    /// Work done on the adhesive.
    pub adhesive: f64,
    /// Whether the sums along the path have settled: not where pairs snapped, or where more states were needed than
    /// [`EnergyOptions`] allows.
    pub settled: bool,
}

impl Energies {
    /// What is missing of the balance: work less all energies. Of a snap it is the energy that the test lost in it.
    pub fn imbalance(&self) -> f64 {
        self.work - self.elastic - self.plastic - self.adhesive
    }
}

/// How finely the path between instants is followed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EnergyOptions {
    /// Error of a sum over all instants, relative to the work, at which it has settled.
    pub tolerance: f64,
    /// A step between two instants is halved up to so many times.
    pub max_halvings: u32,
    /// States that are solved for, in all.
    pub max_states: usize,
    /// How each is solved for.
    pub newton: NewtonOptions,
}

impl Default for EnergyOptions {
    fn default() -> Self {
        // A state that is hard to find is worth less than the time.
        let newton = NewtonOptions { max_halvings: 2, max_rescue: 60, ..NewtonOptions::default() };
        Self { tolerance: 1e-7, max_halvings: 12, max_states: 5_000, newton }
    }
}

/// A state of the path from one instant to the next.
struct State {
    /// Share of the step.
    share: f64,
    u: Vec<[f64; 2]>,
    /// `dW/dshare`.
    power: f64,
    /// Jumps at the quadrature points, and their lengths, element by element.
    jumps: Vec<(f64, Jump)>,
}

/// Sums over a part of a step.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    work: f64,
    adhesive: f64,
}

struct Follower<'a> {
    model: &'a Model,
    law: &'a dyn CohesiveLaw,
    path: Path<'a>,
    work: Work,
    /// Border and forces at the begin of the step and at its end, and what they change by.
    from: Drive,
    to: Drive,
    step: Drive,
    /// Error of a whole step that is allowed, N.
    allowed: f64,
    max_halvings: u32,
    states_left: usize,
    settled: bool,
    /// Whether a state of this step was not found by Newton's iteration: no more are looked for in it.
    gave_up: bool,
}

impl Model {
    /// The reaction of each of `groups` under the displacements `u`, a solution: the force from outside on its nodes (of supports,
    /// blocks and loads), N per mm of width.
    ///
    /// # Panics
    /// When `u` has not one displacement per node.
    pub fn reactions(&self, law: &dyn CohesiveLaw, u: &[[f64; 2]], groups: &[NodeGroup]) -> Vec<[f64; 2]> {
        let forces = self.forces(law, u);
        let sum = |group: &NodeGroup| {
            // At a free component without a load it is the rest of the iteration.
            [0, 1].map(|c| {
                let held = |&&node: &&u32| self.unknown(node as usize, c).is_none() || group.loaded;
                group.nodes.iter().filter(held).map(|&node| forces[node as usize][c]).sum::<f64>()
            })
        };
        groups.iter().map(sum).collect()
    }

    /// Elastic energy and plastic work of the strips under the displacements `u`.
    ///
    /// # Panics
    /// When `u` has not one displacement per node.
    pub fn strip_energy(&self, u: &[[f64; 2]]) -> SubstrateEnergy {
        self.each_strain(u).fold(SubstrateEnergy::default(), |sum, (law, weight, strain)| {
            let energy = law.energy(strain);
            SubstrateEnergy {
                elastic: sum.elastic + weight * energy.elastic,
                plastic: sum.plastic + weight * energy.plastic,
            }
        })
    }

    /// The energies at every instant of `solution`, which is that of `boundary` under `law`; `None` where there is no solution.
    /// `go_on` is asked before every state that is solved for; where it says no, nothing more is put in.
    pub fn energies(
        &self,
        law: &dyn CohesiveLaw,
        boundary: &BoundaryHistory,
        solution: &Solution,
        options: &EnergyOptions,
        go_on: &dyn Fn() -> bool,
    ) -> Vec<Option<Energies>> {
        let solved = solution.instants.iter().take_while(|instant| instant.status.converged()).count();
        let yes = |_: usize| true;
        let rest = boundary.rest();
        let mut work = self.work();
        work.loaded = boundary.loaded().to_vec();
        let mut follower = Follower {
            model: self,
            law,
            path: Path::new(self, law, boundary, options.newton, &yes),
            work,
            from: rest.clone(),
            to: rest.clone(),
            step: rest.clone(),
            allowed: 0.0,
            max_halvings: options.max_halvings,
            states_left: options.max_states,
            settled: true,
            gave_up: false,
        };
        // What a trapezoid over each step gives is the scale of what is negligible.
        let mut scale = 0.0;
        let mut before = (rest.clone(), rest.places.clone(), 0.0);
        for (k, instant) in solution.instants.iter().enumerate().take(solved) {
            let drive = boundary.drive(k);
            let (held, done) = follower.held(&drive, &instant.displacement);
            let mut work = 0.0;
            for (((f0, f1), x0), x1) in before.1.iter().zip(&held).zip(&before.0.places).zip(&drive.places) {
                work += (0..2).map(|c| 0.5 * (f0[c] + f1[c]) * (x1[c] - x0[c])).sum::<f64>();
            }
            // Of loads that rise evenly a half is energy: a scale needs no more.
            scale += work.abs() + 0.5 * (done - before.2).abs();
            before = (drive, held, done);
        }
        follower.allowed = options.tolerance * scale / solved.max(1) as f64;
        let mut total = Sums::default();
        let mut found = Vec::with_capacity(solution.instants.len());
        let still = vec![[0.0; 2]; self.mesh().nodes().len()];
        let mut from = (rest, &still, 0.0);
        for (k, instant) in solution.instants.iter().enumerate() {
            if k >= solved {
                found.push(None);
                continue;
            }
            let to = boundary.drive(k);
            follower.step = to.less(&from.0);
            follower.from.clone_from(&from.0);
            follower.to.clone_from(&to);
            let (a, b) = (follower.state(0.0, from.1), follower.state(1.0, &instant.displacement));
            let (_, done) = follower.held(&to, &instant.displacement);
            // Through a snap no path of equilibria leads.
            follower.settled &= instant.status != Status::Rescued;
            follower.gave_up = false;
            let sums = follower.over(&a, &b, go_on);
            total = Sums { work: total.work + sums.work + (done - from.2), adhesive: total.adhesive + sums.adhesive };
            let SubstrateEnergy { elastic, plastic } = self.strip_energy(&instant.displacement);
            let Sums { work, adhesive } = total;
            found.push(Some(Energies { work, elastic, plastic, adhesive, settled: follower.settled }));
            from = (to, &instant.displacement, done);
        }
        found
    }
}

impl Follower<'_> {
    /// The forces that hold the border at `u`, and `f . u` of the loads.
    fn held(&mut self, drive: &Drive, u: &[[f64; 2]]) -> (Vec<[f64; 2]>, f64) {
        self.work.loads.clone_from(&drive.forces);
        self.model.evaluate_force(self.law, u, &mut self.work);
        (self.model.holding(&self.work), along(&drive.forces, &self.model.loaded_places(&self.work.loaded, u)))
    }

    fn state(&mut self, share: f64, u: &[[f64; 2]]) -> State {
        let drive = self.from.between(&self.to, share);
        let (held, _) = self.held(&drive, u);
        let places = self.model.loaded_places(&self.work.loaded, u);
        let power = along(&held, &self.step.places) - along(&self.step.forces, &places);
        State { share, u: u.to_vec(), power, jumps: self.model.weighted_jumps(u) }
    }

    /// The state at `share` of the step, from `a`, which comes before.
    fn between(&mut self, a: &State, share: f64) -> Option<State> {
        self.path.start_at(&a.u, &self.from.between(&self.to, a.share).forces);
        let found = self.path.advance(&self.from.between(&self.to, share));
        self.gave_up |= found.status != Status::Converged;
        found.status.converged().then(|| self.state(share, &found.displacement))
    }

    /// The sums from `a` to `b`, whose middle is not known yet.
    fn over(&mut self, a: &State, b: &State, go_on: &dyn Fn() -> bool) -> Sums {
        match self.middle(a, b, 0, go_on) {
            None => Sums { work: 0.5 * (b.share - a.share) * (a.power + b.power), adhesive: self.straight(a, b) },
            Some(m) => self.over_halves(a, &m, b, 0, go_on),
        }
    }

    fn middle(&mut self, a: &State, b: &State, halvings: u32, go_on: &dyn Fn() -> bool) -> Option<State> {
        if halvings >= self.max_halvings || self.states_left == 0 || self.gave_up || !go_on() {
            self.settled = false;
            return None;
        }
        self.states_left -= 1;
        let middle = self.between(a, 0.5 * (a.share + b.share));
        self.settled &= !self.gave_up;
        middle
    }

    /// The sums from `a` over `m` to `b`: each half is halved once more, and what that changes tells the error.
    fn over_halves(&mut self, a: &State, m: &State, b: &State, halvings: u32, go_on: &dyn Fn() -> bool) -> Sums {
        let simpson = |a: &State, m: &State, b: &State| (b.share - a.share) / 6.0 * (a.power + 4.0 * m.power + b.power);
        let once = Sums { work: simpson(a, m, b), adhesive: self.straight(a, m) + self.straight(m, b) };
        let quarters = self.middle(a, m, halvings + 1, go_on).zip(self.middle(m, b, halvings + 1, go_on));
        let Some((l, r)) = quarters else { return once };
        let twice = Sums {
            work: simpson(a, &l, m) + simpson(m, &r, b),
            adhesive: [[a, &l], [&l, m], [m, &r], [&r, b]].into_iter().map(|[a, b]| self.straight(a, b)).sum(),
        };
        let (work, adhesive) = (twice.work - once.work, twice.adhesive - once.adhesive);
        // Errors left: a fifteenth of the change of Simpson's sum, a third of that of the straight one.
        let allowed = self.allowed * (b.share - a.share);
        if work.abs() <= 15.0 * allowed && adhesive.abs() <= 3.0 * allowed {
            return Sums { work: twice.work + work / 15.0, adhesive: twice.adhesive + adhesive / 3.0 };
        }
        let (left, right) =
            (self.over_halves(a, &l, m, halvings + 1, go_on), self.over_halves(m, &r, b, halvings + 1, go_on));
        Sums { work: left.work + right.work, adhesive: left.adhesive + right.adhesive }
    }

    /// Work on the adhesive when every jump goes straight from `a` to `b`.
    fn straight(&self, a: &State, b: &State) -> f64 {
        let touching = Touching(self.law);
        // Two points for each interface element.
        let bonds = self.model.mesh().cracked().iter().flat_map(|&cracked| [cracked; 2]);
        let mut sum = 0.0;
        for ((&(weight, from), &(_, to)), cracked) in a.jumps.iter().zip(&b.jumps).zip(bonds) {
            sum += weight * work_along(if cracked { &touching } else { self.law }, from, to);
        }
        sum
    }
}

/// `sum f . u`.
fn along(forces: &[[f64; 2]], places: &[[f64; 2]]) -> f64 {
    forces.iter().zip(places).map(|(f, u)| f[0] * u[0] + f[1] * u[1]).sum()
}

/// `int T . d(jump)` along the straight line between two jumps, MPa mm. Pieces are short against the law, and one ends where the
/// faces touch, since laws have a kink there.
fn work_along(law: &dyn CohesiveLaw, from: Jump, to: Jump) -> f64 {
    let by = Jump { normal: to.normal - from.normal, tangential: to.tangential - from.tangential };
    let at = |share: f64| Jump {
        normal: from.normal + share * by.normal,
        tangential: from.tangential + share * by.tangential,
    };
    let touch = if from.normal * to.normal < 0.0 { -from.normal / by.normal } else { 1.0 };
    let pieces = (40.0 * by.normal.hypot(by.tangential) / law.front_opening()).ceil().clamp(1.0, 200.0);
    let mut sum = 0.0;
    for [begin, end] in [[0.0, touch], [touch, 1.0]] {
        let width = (end - begin) / pieces;
        if width <= 0.0 {
            continue;
        }
        for piece in 0..pieces as usize {
            for place in GAUSS {
                let share = begin + (piece as f64 + place) * width;
                let Traction { normal, tangential } = law.response(at(share)).traction;
                sum += 0.5 * width * (normal * by.normal + tangential * by.tangential);
            }
        }
    }
    sum
}
