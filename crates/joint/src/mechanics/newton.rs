//! Newton's iteration along the instants (THEORY 5 and 9).
//!
//! One rule for the branch: every evaluation starts at rest and follows the prescribed displacements in time. The
//! increment of the border enters through the tangent; a line search guards each iteration; an increment that
//! does not converge is halved. Where halving does not help, node pairs snap: the field has to leave the state it
//! was in. It is then carried over to the next stable state as a slightly viscous adhesive would do it, step by
//! step downhill; where that fails, by the secant iteration (Kacanov). From there Newton goes on.

use super::cohesive::{CohesiveLaw, Jump};
use super::sensitivity;
use super::{
    BoundaryHistory, Drive, Failure, ForwardOptions, Instant, Model, ModelError, NewtonOptions, Solution, Status,
    Stiffness, Work,
};

impl Model {
    /// The displacements at every instant of `boundary` under `law`, from rest.
    ///
    /// Not converging is an outcome: the instant says so ([`Status::NotConverged`]), with what is known of the place,
    /// and those after it are [`Status::NotReached`].
    ///
    /// # Errors
    /// A history of other nodes than those of the model.
    pub fn forward(
        &self,
        law: &dyn CohesiveLaw,
        boundary: &BoundaryHistory,
        options: &ForwardOptions,
    ) -> Result<Solution, ModelError> {
        self.forward_while(law, boundary, options, &|_| true)
    }

    /// The same; `go_on` is asked before every solution of equations, with the number of the instant (from 1) that it
    /// is for. Where it says no, that instant has not converged.
    ///
    /// # Errors
    /// As [`Model::forward`].
    pub fn forward_while(
        &self,
        law: &dyn CohesiveLaw,
        boundary: &BoundaryHistory,
        options: &ForwardOptions,
        go_on: &dyn Fn(usize) -> bool,
    ) -> Result<Solution, ModelError> {
        self.check_boundary(boundary)?;
        let mut path = Path::new(self, law, boundary, options.newton, go_on);
        let mut instants: Vec<Instant> = Vec::with_capacity(boundary.instants().len());
        for target in (0..boundary.instants().len()).map(|k| boundary.drive(k)) {
            if instants.last().is_some_and(|last| !last.status.converged()) {
                instants.push(Instant::default());
                continue;
            }
            path.instant += 1;
            let mut instant = path.advance(&target);
            if instant.status.converged() {
                instant.sensitivities = sensitivity::at(self, law, &path.u, &path.work, options);
            }
            instants.push(instant);
        }
        Ok(Solution { instants, parameters: sensitivity::parameters(self, law, options) })
    }
}

/// In so many iterations of an increment other faces of a crack may touch than before.
const MOST_TURNS: u32 = 15;

/// Largest residual force over the largest nodal force of a state between instants, before a last correction.
const SETTLED: f64 = 1e-9;

/// An iteration with an old factor that leaves more of the residual costs more than a new one.
const WORTH_A_FACTOR: f64 = 0.3;

/// Factors made for one state between instants.
const MOST_FACTORS: u32 = 10;

/// How often viscous steps begin again where Newton's did not finish what they began.
const MOST_RETRIES: i32 = 5;

/// Where a run stands: a converged field, and the factor of its tangent.
pub(super) struct Path<'a> {
    model: &'a Model,
    law: &'a dyn CohesiveLaw,
    options: NewtonOptions,
    work: Work,
    /// The converged displacements, and the forces under them.
    u: Vec<[f64; 2]>,
    forces: Vec<[f64; 2]>,
    /// The solution of the last increment that was accepted.
    last: Vec<[f64; 2]>,
    /// Of each node pair, whether it is cracked.
    cracked: Vec<bool>,
    /// The jumps that the tangent predicted for the increment.
    predicted: Vec<Jump>,
    /// Room for the field of an iteration, and for one that is tried.
    field: Vec<[f64; 2]>,
    trial: Vec<[f64; 2]>,
    rhs: Vec<f64>,
    /// Whether `work` holds stiffness and factor at `u`.
    ready: bool,
    /// Whether there is a factor at all.
    factored: bool,
    /// Number of the instant, from 1.
    instant: usize,
    /// Whether to go on with it.
    go_on: &'a dyn Fn(usize) -> bool,
}

#[derive(Debug, Clone, Default)]
struct Effort {
    iterations: u32,
    /// Relative residual at each iterate.
    residuals: Vec<f64>,
}

/// Largest residual force and the largest of all nodal forces, N/mm.
#[derive(Debug, Clone, Copy)]
struct Balance {
    residual: f64,
    force: f64,
    /// Root of the sum of squares of the residual: what the line search lowers.
    norm: f64,
    /// The round-off of the residual.
    floor: f64,
}

impl Balance {
    fn relative(&self) -> f64 {
        if self.force > 0.0 { self.residual / self.force } else { 0.0 }
    }
}

impl<'a> Path<'a> {
    pub(super) fn new(
        model: &'a Model,
        law: &'a dyn CohesiveLaw,
        boundary: &BoundaryHistory,
        options: NewtonOptions,
        go_on: &'a dyn Fn(usize) -> bool,
    ) -> Self {
        let rest = vec![[0.0; 2]; model.mesh().nodes().len()];
        let mut work = model.work();
        work.loaded = boundary.loaded().to_vec();
        work.loads = boundary.rest().forces;
        Self {
            model,
            law,
            options,
            forces: work.loads.clone(),
            cracked: model.mesh().cracked_pairs(),
            work,
            field: rest.clone(),
            trial: rest.clone(),
            last: rest.clone(),
            predicted: Vec::new(),
            u: rest,
            rhs: vec![0.0; model.n_unknowns()],
            ready: false,
            factored: false,
            instant: 0,
            go_on,
        }
    }

    fn goes_on(&self) -> bool {
        (self.go_on)(self.instant)
    }

    /// The factor that it ended with.
    pub(super) fn into_work(self) -> Work {
        self.work
    }

    /// Goes on from `u`, a solution under `forces`.
    pub(super) fn start_at(&mut self, u: &[[f64; 2]], forces: &[[f64; 2]]) {
        self.u.copy_from_slice(u);
        self.forces.copy_from_slice(forces);
        self.last.copy_from_slice(u);
        self.ready = false;
    }

    /// Makes of `guess` the solution under `drive` next to it, with the factor that is at hand as long as it serves.
    /// False where there is none near, or it is not stable.
    pub(super) fn settle(&mut self, guess: &mut [[f64; 2]], drive: &Drive) -> bool {
        self.ready = false;
        self.field.copy_from_slice(guess);
        self.model.set_border(&drive.places, &mut self.field);
        // Blocks are rigid; what lies between two of their places is not.
        self.rhs.fill(0.0);
        self.model.add_to_field(&self.rhs, 0.0, &mut self.field);
        self.work.loads.clone_from(&drive.forces);
        let (mut before, mut factors) = (f64::INFINITY, 0);
        for _ in 0..self.options.max_iterations {
            self.model.evaluate_force(self.law, &self.field, &mut self.work);
            let balance = self.balance();
            if !balance.norm.is_finite() || !self.goes_on() {
                return false;
            }
            let settled = balance.residual <= SETTLED * balance.force + balance.floor;
            if !self.factored || (!settled && balance.norm > WORTH_A_FACTOR * before) {
                factors += 1;
                self.model.assemble(self.law, &self.field, Stiffness::Tangent, &mut self.work);
                self.factored = self.work.factor.refactor(&self.work.matrix).is_ok();
                let stable = || self.work.factor.pivots().is_none_or(|pivots| pivots.positive_determinant());
                if factors > MOST_FACTORS || !self.factored || !stable() {
                    self.factored = false;
                    return false;
                }
            }
            before = balance.norm;
            self.residual_into_rhs();
            self.work.factor.solve(&mut self.rhs);
            self.model.add_to_field(&self.rhs, 1.0, &mut self.field);
            if settled {
                guess.copy_from_slice(&self.field);
                return true;
            }
        }
        false
    }

    /// Moves border and forces to `target`, in as many increments as it takes.
    pub(super) fn advance(&mut self, target: &Drive) -> Instant {
        let from = Drive { places: self.model.border(&self.u), forces: self.forces.clone() };
        let between = |share: f64| if share == 1.0 { target.clone() } else { from.between(target, share) };
        let smallest = 0.5_f64.powi(self.options.max_halvings as i32);
        let mut instant = Instant { status: Status::Converged, ..Instant::default() };
        // Shares are sums of powers of two: exact.
        let (mut done, mut step) = (0.0, 1.0_f64);
        while done < 1.0 {
            step = step.min(1.0 - done);
            let border = between(done + step);
            let before = self.model.jumps(&self.u);
            let mut effort = Effort::default();
            let mut converged = self.increment(&border, &mut effort);
            // Further than the tangent said by an opening at the peak: was the path left on the way?
            let leapt = converged && self.strays();
            if (leapt || (!converged && self.goes_on())) && step > smallest {
                self.step_back(converged);
                instant.iterations += effort.iterations;
                instant.halvings += 1;
                step *= 0.5;
                continue;
            }
            if !converged {
                let mut rescue = 0;
                converged = self.relax(&border, &mut effort, &mut rescue)
                    || (self.has_secants() && self.secant(&border.places, &mut effort, &mut rescue));
                instant.rescue_iterations += rescue;
                if converged {
                    instant.status = Status::Rescued;
                    instant.add_snapped(&before, &self.model.jumps(&self.u));
                }
            }
            if leapt {
                instant.status = Status::Rescued;
                instant.add_snapped(&before, &self.model.jumps(&self.u));
            }
            instant.iterations += effort.iterations;
            instant.residual = effort.residuals.last().copied().unwrap_or(0.0);
            instant.residuals = effort.residuals;
            if !converged {
                instant.status = Status::NotConverged;
                instant.add_snapped(&before, &self.model.jumps(&self.field));
                instant.failure = Some(Failure { share: done });
                break;
            }
            done += step;
            step *= 2.0;
            self.last.clone_from(&self.u);
            self.forces = border.forces;
        }
        instant.displacement.clone_from(&self.u);
        instant
    }

    /// Whether there is a matrix that gives the forces: only of small rotations, and of a border that moves alone.
    fn has_secants(&self) -> bool {
        self.model.options().kinematics.is_small() && self.work.loads.is_empty()
    }

    /// One increment of border and forces; the state is kept only when it converges.
    fn increment(&mut self, border: &Drive, effort: &mut Effort) -> bool {
        if !self.ready {
            self.work.loads.clone_from(&self.forces);
            self.model.assemble(self.law, &self.u, Stiffness::Tangent, &mut self.work);
            if self.work.factor.refactor(&self.work.matrix).is_err() {
                return false;
            }
            self.ready = true;
        }
        self.predict(border);
        self.iterate(self.options.max_iterations, effort)
    }

    /// Sets `field` to the border's new place with the inside following along the stiffness that is factorised,
    /// `K_ff du_f = -K_fD du_D + df`. From here on the forces are those of `border`.
    fn predict(&mut self, border: &Drive) {
        self.field.clone_from(&self.u);
        self.model.set_border(&border.places, &mut self.field);
        for ((by, to), from) in self.trial.iter_mut().zip(&self.field).zip(&self.u) {
            *by = [to[0] - from[0], to[1] - from[1]];
        }
        self.model.pull_of_border(&self.trial, &self.work, &mut self.rhs);
        let more: Vec<[f64; 2]> =
            border.forces.iter().zip(&self.forces).map(|(to, from)| [to[0] - from[0], to[1] - from[1]]).collect();
        self.model.add_loads(&self.work.loaded, &more, &mut self.rhs);
        self.work.loads.clone_from(&border.forces);
        self.work.factor.solve(&mut self.rhs);
        self.model.add_to_field(&self.rhs, 1.0, &mut self.field);
        self.predicted = self.model.jumps(&self.field);
        self.ready = false;
    }

    /// Whether some pair opened much further than predicted.
    fn strays(&self) -> bool {
        let open = self.law.front_opening();
        let allowed = 0.2 * open;
        let found = self.model.jumps(&self.u);
        // Arms that turn far go on their own circle, and no tangent predicts it; where they are apart already that is
        // no snap.
        let apart = |a: &Jump, b: &Jump| !self.model.options().kinematics.is_small() && a.normal.min(b.normal) > open;
        let pairs = found.iter().zip(&self.predicted).zip(&self.cracked);
        // Faces of a crack part without a snap.
        pairs.into_iter().any(|((a, b), cracked)| !cracked && (a.normal - b.normal).abs() > allowed && !apart(a, b))
    }

    /// Back to the last accepted solution, if an increment went on to another.
    fn step_back(&mut self, moved: bool) {
        if moved {
            self.u.clone_from(&self.last);
            self.ready = false;
        }
    }

    /// Newton from `field`, whose border is in place. On success `u` is the solution, and `work` holds the factor
    /// of its tangent.
    fn iterate(&mut self, max_iterations: u32, effort: &mut Effort) -> bool {
        self.model.assemble(self.law, &self.field, Stiffness::Tangent, &mut self.work);
        let mut balance = self.balance();
        let mut stalled = 0;
        // Which faces of a crack touch is found out by going all the way, whatever the residual says in between.
        let mut turns = if self.cracked.contains(&true) { MOST_TURNS } else { 0 };
        loop {
            effort.residuals.push(balance.relative());
            if !self.goes_on() || !balance.norm.is_finite() || self.work.factor.refactor(&self.work.matrix).is_err() {
                return false;
            }
            let converged = balance.residual <= self.options.tolerance * balance.force + balance.floor;
            // The correction is made in any case: at convergence it costs one solve and squares the error.
            self.residual_into_rhs();
            self.work.factor.solve(&mut self.rhs);
            // An odd number of negative eigenvalues: an equilibrium, but not one that a test can show.
            let unstable = || self.work.factor.pivots().is_some_and(|pivots| !pivots.positive_determinant());
            if converged && unstable() {
                return false;
            }
            if converged {
                self.model.add_to_field(&self.rhs, 1.0, &mut self.field);
                std::mem::swap(&mut self.u, &mut self.field);
                self.ready = true;
                return self.u.iter().flatten().all(|u| u.is_finite());
            }
            if effort.iterations >= max_iterations {
                return false;
            }
            effort.iterations += 1;
            match self.line_search(balance, turns > 0) {
                Some((next, true)) => {
                    turns -= 1;
                    balance = next;
                }
                Some((next, false)) => {
                    // A residual that hardly falls is no convergence.
                    stalled = if next.norm > 0.9 * balance.norm { stalled + 1 } else { 0 };
                    balance = next;
                }
                None => return false,
            }
            if stalled > 4 {
                return false;
            }
        }
    }

    fn touching(&self, u: &[[f64; 2]]) -> Vec<bool> {
        self.model.jumps(u).iter().zip(&self.cracked).map(|(jump, cracked)| *cracked && jump.normal < 0.0).collect()
    }

    /// Goes along the correction in `rhs` as far as the residual falls; `None` when it does not. With `turns` it goes
    /// all the way where other faces of a crack touch there, and says so.
    fn line_search(&mut self, before: Balance, turns: bool) -> Option<(Balance, bool)> {
        let mut best: Option<(f64, f64)> = None;
        let mut share = 1.0;
        for attempt in 0..6 {
            self.trial.clone_from(&self.field);
            self.model.add_to_field(&self.rhs, share, &mut self.trial);
            // The first attempt mostly holds: make its tangent at once.
            if attempt == 0 {
                self.model.assemble(self.law, &self.trial, Stiffness::Tangent, &mut self.work);
            } else {
                self.model.evaluate_force(self.law, &self.trial, &mut self.work);
            }
            let balance = self.balance();
            if attempt == 0
                && turns
                && balance.norm.is_finite()
                && self.touching(&self.field) != self.touching(&self.trial)
            {
                std::mem::swap(&mut self.field, &mut self.trial);
                return Some((balance, true));
            }
            if balance.norm <= (1.0 - 1e-4 * share) * before.norm || balance.residual <= balance.floor {
                std::mem::swap(&mut self.field, &mut self.trial);
                if attempt > 0 {
                    self.model.assemble(self.law, &self.field, Stiffness::Tangent, &mut self.work);
                }
                return Some((balance, false));
            }
            if balance.norm.is_finite() && best.is_none_or(|(norm, _)| balance.norm < norm) {
                best = Some((balance.norm, share));
            }
            share *= 0.5;
        }
        // Across a kink the residual may have to rise a little before it falls.
        let (norm, share) = best?;
        if norm > 1.5 * before.norm {
            return None;
        }
        self.model.add_to_field(&self.rhs, share, &mut self.field);
        self.model.assemble(self.law, &self.field, Stiffness::Tangent, &mut self.work);
        Some((self.balance(), false))
    }

    /// Carries the field over a snap: steps of a viscous adhesive at a border that stands still,
    /// `(K + eta C_0) du = -R`, with `eta C_0` a share of the initial stiffness added at the interface.
    ///
    /// With `eta` large enough each step goes downhill in every mode whatever the tangent (the pivots tell); while
    /// the steps do, `eta` falls, and where the tangent is positive again the last of them are those of Newton. (The
    /// secant iteration alone crawls past the place where the equilibrium was lost: hundreds of iterations,
    /// measured.)
    fn relax(&mut self, border: &Drive, effort: &mut Effort, steps: &mut u32) -> bool {
        let longest = 0.2 * self.law.front_opening();
        let mut share = 1.0;
        // As the increment of Newton: the border enters through the tangent, or the elements along it yield.
        self.work.loads.clone_from(&self.forces);
        self.model.assemble(self.law, &self.u, Stiffness::Viscous(share), &mut self.work);
        if self.work.factor.refactor(&self.work.matrix).is_err() {
            return false;
        }
        self.predict(border);
        let mut retries = 0;
        for _ in 0..self.options.max_rescue {
            *steps += 1;
            self.model.assemble(self.law, &self.field, Stiffness::Viscous(share), &mut self.work);
            if !self.goes_on() || !self.balance().norm.is_finite() || share > 1e6 {
                return false;
            }
            if share < 1e-6 {
                let relaxed = self.field.clone();
                if self.iterate(self.options.max_iterations, effort) {
                    return true;
                }
                // The steps fell too fast. Where no other way is left they go on from here, slower each time.
                retries += 1;
                if self.has_secants() || retries > MOST_RETRIES {
                    return false;
                }
                self.field = relaxed;
                share = 4.0_f64.powi(retries);
                continue;
            }
            self.residual_into_rhs();
            let load = self.rhs.clone();
            let stable = self.work.factor.refactor(&self.work.matrix).is_ok()
                && self.work.factor.pivots().is_none_or(|pivots| pivots.all_positive());
            share = match stable && self.downhill(&load, longest) {
                true => 0.5 * share,
                false => 4.0 * share,
            };
        }
        false
    }

    /// One viscous step from `field` under `load`, or half of it, a quarter, ...: none may open a pair further than
    /// `longest` (mm) or overshoot. False when there is none such, and the field stays.
    fn downhill(&mut self, load: &[f64], longest: f64) -> bool {
        self.work.factor.solve(&mut self.rhs);
        let along = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let slope = along(&self.rhs, load);
        if !(slope > 0.0 && slope.is_finite()) {
            return false;
        }
        let before = self.model.jumps(&self.field);
        let mut part = 1.0;
        for _ in 0..5 {
            self.trial.clone_from(&self.field);
            self.model.add_to_field(&self.rhs, part, &mut self.trial);
            let after = self.model.jumps(&self.trial);
            let moved = before.iter().zip(&after).map(|(a, b)| (a.normal - b.normal).abs()).fold(0.0, f64::max);
            if moved <= longest {
                self.model.evaluate_force(self.law, &self.trial, &mut self.work);
                if along(&self.rhs, &self.model.residual(&self.work)) <= 0.5 * slope {
                    std::mem::swap(&mut self.field, &mut self.trial);
                    return true;
                }
            }
            part *= 0.5;
        }
        false
    }

    /// The secant iteration (Kacanov) from the converged field, with Newton tried now and then.
    fn secant(&mut self, border: &[[f64; 2]], effort: &mut Effort, rescue: &mut u32) -> bool {
        let start = self.u.clone();
        let mut current = start.clone();
        self.model.set_border(border, &mut current);
        let mut only_border = vec![[0.0; 2]; start.len()];
        self.model.set_border(border, &mut only_border);
        for iteration in 1..=self.options.max_rescue {
            *rescue += 1;
            if !self.goes_on() {
                break;
            }
            self.model.assemble(self.law, &current, Stiffness::Secant, &mut self.work);
            if self.work.factor.refactor(&self.work.matrix).is_err() {
                break;
            }
            self.model.pull_of_border(&only_border, &self.work, &mut self.rhs);
            self.work.factor.solve(&mut self.rhs);
            let mut next = only_border.clone();
            self.model.add_to_field(&self.rhs, 1.0, &mut next);
            if next.iter().flatten().any(|u| !u.is_finite()) {
                break;
            }
            let moved = largest_difference(&next, &current);
            let size = largest_difference(&next, &start).max(f64::MIN_POSITIVE);
            current = next;
            // Newton once the secant iteration has settled somewhat, and then from time to time.
            if iteration % 10 == 0 || moved < 1e-3 * size {
                self.field.clone_from(&current);
                let mut attempt = Effort::default();
                let converged = self.iterate(10, &mut attempt);
                effort.iterations += attempt.iterations;
                if converged {
                    effort.residuals = attempt.residuals;
                    return true;
                }
            }
            if moved < 1e-13 * size {
                break;
            }
        }
        // Nothing helped: what was reached is left in `field` for the report.
        self.field = current;
        self.u = start;
        self.ready = false;
        false
    }

    /// Residual and largest force of the last evaluation.
    fn balance(&self) -> Balance {
        let mut balance =
            Balance { residual: 0.0, force: 0.0, norm: 0.0, floor: self.model.round_off(self.law, &self.field) };
        let mut squares = 0.0;
        for (node, force) in self.work.force.iter().enumerate() {
            let size = force[0].abs().max(force[1].abs());
            // A NaN must come through: max() would drop it.
            if size.is_nan() {
                return Balance { residual: f64::NAN, norm: f64::NAN, ..balance };
            }
            balance.force = balance.force.max(size);
            match [0, 1].map(|c| self.model.unknown(node, c).is_some()) {
                [true, true] => {
                    balance.residual = balance.residual.max(size);
                    squares += force[0] * force[0] + force[1] * force[1];
                }
                [false, false] => {}
                free => {
                    let force = force[usize::from(free[1])];
                    balance.residual = balance.residual.max(force.abs());
                    squares += force * force;
                }
            }
        }
        for force in self.model.residual_of_blocks(&self.work).into_iter().flatten() {
            balance.residual = balance.residual.max(force.abs());
            squares += force * force;
        }
        // Where forces act alone they are the measure.
        balance.force = self.work.loads.iter().flatten().fold(balance.force, |most, load| most.max(load.abs()));
        balance.norm = squares.sqrt();
        balance
    }

    fn residual_into_rhs(&mut self) {
        self.rhs = self.model.residual(&self.work);
        self.rhs.iter_mut().for_each(|force| *force = -*force);
    }
}

fn largest_difference(a: &[[f64; 2]], b: &[[f64; 2]]) -> f64 {
    let differences = a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a - b).abs());
    differences.fold(0.0, f64::max)
}
