//! Reactions, and where the work that they do goes (THEORY 15).
//!
//! Along a path of equilibria `dW = F . du_D = dU + dA`: the work of the reactions is stored in the strips or done on
//! the adhesive. `U` is a function of the strain, exactly. `W` and `A` are summed along the path, which between states
//! that are solved for is taken as a parabola. There no field is quite in equilibrium: to the reactions `F_D` of the
//! field belongs a residual `r` at the free nodes, and the reaction of the equilibrium next to it is, to first order,
//! what the virtual work says,
//!
//! ```text
//! F . du_D = F_D . du_D + r . w,    K_ff^T w = -K_Df^T du_D,
//! ```
//!
//! with `w` between those of the states. So the error is the square of that of the path, and kinks of the law, which
//! every pair passes at a time of its own, are integrated over pair by pair. States are put in until neither sum
//! changes any more. Forces do work where their nodes go, `int f . du = [f . u] - int u . df`: what is summed along the
//! path is the last term, which needs no velocity.

use super::cohesive::CohesiveLaw;
use super::path_work::{Piece, Rates, State};
use super::substrate::SubstrateEnergy;
use super::{BoundaryHistory, Drive, Model, NewtonOptions, NodeGroup, Path, Solution, Status, Stiffness, Work};

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
    /// Of each entry of the tangent, its mirror image.
    mirror: Vec<u32>,
    /// Border and forces at the begin of the step and at its end, and what they change by.
    from: Drive,
    to: Drive,
    step: Drive,
    /// Error of a whole step that is allowed, N.
    allowed: f64,
    max_halvings: u32,
    states_left: usize,
    settled: bool,
    /// Whether pairs snap in this step: no path of equilibria leads through it, and reactions are what they are at its
    /// states.
    snapped: bool,
    /// Whether a state of this step was not found by Newton's iteration: no more are looked for in it.
    gave_up: bool,
    /// Whether there is a factor of the last state.
    factored: bool,
}

impl Model {
    /// The reaction of each of `groups` under the displacements `u`, a solution: the force from outside on its nodes
    /// (of supports, blocks and loads), N per mm of width.
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
    pub fn strip_energy(&self, u: &[[f64; 2]]) -> SubstrateEnergy {
        self.each_strain(u).fold(SubstrateEnergy::default(), |sum, (law, weight, strain)| {
            let energy = law.energy(strain);
            SubstrateEnergy {
                elastic: sum.elastic + weight * energy.elastic,
                plastic: sum.plastic + weight * energy.plastic,
            }
        })
    }

    /// The energies at every instant of `solution`, which is that of `boundary` under `law`; `None` where there is no
    /// solution. `go_on` is asked before every state that is solved for; where it says no, nothing more is put in.
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
            mirror: work.matrix.mirror().expect("couplings go both ways"),
            work,
            from: rest.clone(),
            to: rest.clone(),
            step: rest.clone(),
            allowed: 0.0,
            max_halvings: options.max_halvings,
            states_left: options.max_states,
            settled: true,
            snapped: false,
            gave_up: false,
            factored: false,
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
        let (mut from, mut done) = (rest, 0.0);
        let mut begin: Option<State> = None;
        for (k, instant) in solution.instants.iter().enumerate() {
            if k >= solved {
                found.push(None);
                continue;
            }
            let (to, u) = (boundary.drive(k), &instant.displacement);
            follower.step = to.less(&from);
            follower.from.clone_from(&from);
            follower.to.clone_from(&to);
            let a = begin.take().unwrap_or_else(|| follower.state(0.0, &still));
            let b = follower.state(1.0, u);
            // The next step begins where this one ends, with the same factor.
            let onward = (k + 1 < solved).then(|| follower.rates(&boundary.drive(k + 1).less(&to)));
            let (_, done_here) = follower.held(&to, u);
            follower.snapped = instant.status == Status::Rescued;
            follower.settled &= !follower.snapped;
            follower.gave_up = false;
            let sums = follower.over(&a, &b, go_on);
            total =
                Sums { work: total.work + sums.work + (done_here - done), adhesive: total.adhesive + sums.adhesive };
            let SubstrateEnergy { elastic, plastic } = self.strip_energy(u);
            let Sums { work, adhesive } = total;
            found.push(Some(Energies { work, elastic, plastic, adhesive, settled: follower.settled }));
            begin = onward.map(|rates| State { share: 0.0, rates, ..b });
            (from, done) = (to, done_here);
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

    /// The state `u`, a solution, at `share` of the step.
    fn state(&mut self, share: f64, u: &[[f64; 2]]) -> State {
        self.work.loads = self.from.between(&self.to, share).forces;
        self.model.assemble(self.law, u, Stiffness::Tangent, &mut self.work);
        self.work.matrix.transpose(&self.mirror);
        self.factored = self.work.factor.refactor(&self.work.matrix).is_ok();
        self.settled &= self.factored;
        let places = self.model.loaded_places(&self.work.loaded, u);
        let step = self.step.clone();
        State { share, u: u.to_vec(), places, rates: self.rates(&step) }
    }

    /// What the virtual work weighs forces with along `step`, at the state whose transposed tangent is factorised:
    /// `K_ff^T w_f = -K_Df^T du_D + df`.
    fn rates(&self, step: &Drive) -> Rates {
        let model = self.model;
        let mut nodes = vec![[0.0; 2]; model.mesh().nodes().len()];
        model.add_border_change(&step.places, &mut nodes);
        let mut values = vec![0.0; model.n_unknowns()];
        model.transposed_pull_of_border(&nodes, &self.work, &mut values);
        model.add_loads(&self.work.loaded, &step.forces, &mut values);
        match self.factored {
            true => self.work.factor.solve(&mut values),
            false => values.fill(0.0),
        }
        model.add_to_derivative(&values, &self.work, &mut nodes);
        let loaded = model.loaded_rates(&self.work.loaded, &values, &step.places, &nodes);
        Rates { power: along(&model.holding(&self.work), &step.places), nodes, loaded }
    }

    /// The state at `share` of the step, near the curve through `known` states; `from` comes before it.
    fn between(&mut self, from: &State, share: f64, known: &[&State]) -> Option<State> {
        let drive = self.from.between(&self.to, share);
        let weights = lagrange(known, share);
        let mut u = vec![[0.0; 2]; from.u.len()];
        for (state, weight) in known.iter().zip(weights) {
            for (sum, u) in u.iter_mut().zip(&state.u) {
                *sum = [sum[0] + weight * u[0], sum[1] + weight * u[1]];
            }
        }
        if self.path.settle(&mut u, &drive) {
            return Some(self.state(share, &u));
        }
        self.path.start_at(&from.u, &self.from.between(&self.to, from.share).forces);
        let found = self.path.advance(&drive);
        self.gave_up |= found.status != Status::Converged;
        found.status.converged().then(|| self.state(share, &found.displacement))
    }

    /// The sums from `a` to `b`, whose middle is not known yet.
    fn over(&mut self, a: &State, b: &State, go_on: &dyn Fn() -> bool) -> Sums {
        let Some(m) = self.middle(a, b, &[a, b], 0, go_on) else { return self.trapezoid(a, b) };
        let once = self.parabola(a, &m, b);
        self.over_halves([a, &m, b], once, 0, go_on)
    }

    fn middle(
        &mut self,
        a: &State,
        b: &State,
        known: &[&State],
        halvings: u32,
        go_on: &dyn Fn() -> bool,
    ) -> Option<State> {
        if halvings >= self.max_halvings || self.states_left == 0 || self.gave_up || !go_on() {
            self.settled = false;
            return None;
        }
        self.states_left -= 1;
        let middle = self.between(a, 0.5 * (a.share + b.share), known);
        self.settled &= !self.gave_up;
        middle
    }

    /// What reactions and loads do at a state, per share of the step.
    fn power(&self, state: &State) -> f64 {
        state.rates.power - along(&self.step.forces, &state.places)
    }

    /// The work as of a force that changes evenly, and jumps that go straight.
    fn trapezoid(&self, a: &State, b: &State) -> Sums {
        let [_, adhesive] = Piece { model: self.model, law: self.law, states: vec![a, b] }.interface(self.per_length());
        Sums { work: 0.5 * (b.share - a.share) * (self.power(a) + self.power(b)), adhesive }
    }

    /// The sums from `a` over `m` to `b` along the parabola through them.
    fn parabola(&self, a: &State, m: &State, b: &State) -> Sums {
        let piece = Piece { model: self.model, law: self.law, states: vec![a, m, b] };
        let width = b.share - a.share;
        let [by_interface, adhesive] = piece.interface(self.per_length());
        let loads = [a, b].map(|state| self.from.between(&self.to, state.share).forces);
        let of_loads = |s: f64, places: &[[f64; 2]], rates: &[[f64; 2]]| {
            let on = |k: usize, c: usize| loads[0][k][c] + s * (loads[1][k][c] - loads[0][k][c]);
            let external: f64 = (0..rates.len()).map(|k| on(k, 0) * rates[k][0] + on(k, 1) * rates[k][1]).sum();
            external + along(&self.step.forces, places)
        };
        let work = match self.snapped || self.gave_up {
            true => (self.power(a) + 4.0 * self.power(m) + self.power(b)) / 6.0,
            false => by_interface + piece.strips(of_loads),
        };
        Sums { work: width * work, adhesive }
    }

    /// Error of an integral of the law at a point over a part of a step, MPa mm.
    fn per_length(&self) -> f64 {
        0.01 * self.allowed / self.model.bonds().map(|(_, bond, _)| bond.length()).sum::<f64>().max(f64::MIN_POSITIVE)
    }

    /// The sums from `a` over `m` to `b`, of which `once` is known: each half is halved once more, and what that
    /// changes tells the error.
    fn over_halves(&mut self, [a, m, b]: [&State; 3], once: Sums, halvings: u32, go_on: &dyn Fn() -> bool) -> Sums {
        let Some(l) = self.middle(a, m, &[a, m, b], halvings + 1, go_on) else { return once };
        let Some(r) = self.middle(m, b, &[a, &l, m, b], halvings + 1, go_on) else { return once };
        let (left, right) = (self.parabola(a, &l, m), self.parabola(m, &r, b));
        let twice = Sums { work: left.work + right.work, adhesive: left.adhesive + right.adhesive };
        // What is left is a small part of the change, and what is left of one interval may have either sign. Where an
        // interval is long, and kinks are many, a change may be small by chance.
        let allowed = if halvings < 2 { 0.05 } else { 8.0 } * self.allowed;
        if (twice.work - once.work).abs() <= allowed && (twice.adhesive - once.adhesive).abs() <= allowed {
            return twice;
        }
        let left = self.over_halves([a, &l, m], left, halvings + 1, go_on);
        let right = self.over_halves([m, &r, b], right, halvings + 1, go_on);
        Sums { work: left.work + right.work, adhesive: left.adhesive + right.adhesive }
    }
}

/// The weights at `share` of the polynomial through `known` states.
fn lagrange(known: &[&State], share: f64) -> Vec<f64> {
    let weight = |k: usize| {
        let others = known.iter().enumerate().filter(|&(other, _)| other != k);
        others.map(|(_, other)| (share - other.share) / (known[k].share - other.share)).product()
    };
    (0..known.len()).map(weight).collect()
}

/// `sum f . u`.
fn along(forces: &[[f64; 2]], places: &[[f64; 2]]) -> f64 {
    forces.iter().zip(places).map(|(f, u)| f[0] * u[0] + f[1] * u[1]).sum()
}
