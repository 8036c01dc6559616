//! Equilibria that a test cannot show: the path through a snap, followed by its length.
//!
//! Beyond a limit point the prescribed displacement and the load have to go back for the joint to stay in equilibrium
//! (snap-back). Time, that is the share of the history of supports and loads, becomes an unknown; what is prescribed
//! instead is how far the jumps of the adhesive go along the path's tangent (a normal plane in the space of the jumps:
//! what happens in a brittle joint happens there, and the strips only follow).

use super::cohesive::{CohesiveLaw, Jump};
use super::sensitivity;
use super::{
    BoundaryHistory, Drive, ForwardOptions, Instant, Model, ModelError, Path, Solution, Status, Stiffness, Work,
};

/// How a path is followed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FollowOptions {
    /// Largest change of a jump from point to point, over the opening at which the joint counts as cracked.
    pub step: f64,
    /// Points at most.
    pub max_points: usize,
}

impl Default for FollowOptions {
    fn default() -> Self {
        Self { step: 0.25, max_points: 2000 }
    }
}

/// How a path ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PathEnd {
    /// At the last instant of the history.
    Last,
    /// Back at rest: the joint is broken.
    Rest,
    /// No further point was found.
    Lost,
    /// At [`FollowOptions::max_points`], or stopped.
    Points,
}

/// A path of equilibria, stable or not.
#[derive(Debug, Clone, PartialEq)]
pub struct Followed {
    /// The time of each point: 0 at rest, k at instant k of the history that was given.
    pub times: Vec<f64>,
    /// Supports and loads at the points.
    pub boundary: BoundaryHistory,
    /// The points.
    pub solution: Solution,
    /// How it ended.
    pub end: PathEnd,
}

/// Newton iterations of a point; fewer than the second number let the next step grow.
const ITERATIONS: u32 = 12;
const FEW: u32 = 5;
/// How often a step is halved.
const HALVINGS: i32 = 14;

struct Arc<'a> {
    model: &'a Model,
    law: &'a dyn CohesiveLaw,
    boundary: &'a BoundaryHistory,
    work: Work,
    tolerance: f64,
    /// Of each pair, whether its jump counts.
    counts: Vec<bool>,
}

impl Arc<'_> {
    /// What changes in the unit of time that `time` lies in.
    fn rate(&self, time: f64) -> Drive {
        let (k, from) = self.boundary.drive_before(time);
        self.boundary.drive(k).less(&from)
    }

    /// Stiffness and its factor at `u`, `time`; false where there is none.
    fn assemble(&mut self, u: &[[f64; 2]], time: f64) -> bool {
        self.work.loads = self.boundary.drive_at(time).forces;
        self.model.assemble(self.law, u, Stiffness::Tangent, &mut self.work);
        self.work.factor.refactor(&self.work.matrix).is_ok()
    }

    /// How the unknowns follow the time, and the whole field.
    fn velocity(&self, time: f64) -> (Vec<f64>, Vec<[f64; 2]>) {
        let rate = self.rate(time);
        let mut field = vec![[0.0; 2]; self.model.mesh().nodes().len()];
        self.model.add_border_change(&rate.places, &mut field);
        let mut rhs = vec![0.0; self.model.n_unknowns()];
        self.model.pull_of_border(&field, &self.work, &mut rhs);
        self.model.add_loads(&self.work.loaded, &rate.forces, &mut rhs);
        self.work.factor.solve(&mut rhs);
        self.model.add_to_derivative(&rhs, &self.work, &mut field);
        (rhs, field)
    }

    fn along(&self, a: &[Jump], b: &[Jump]) -> f64 {
        let pairs = a.iter().zip(b).zip(&self.counts).filter(|(_, counts)| **counts);
        pairs.map(|((a, b), _)| a.normal * b.normal + a.tangential * b.tangential).sum()
    }

    fn largest(&self, jumps: &[Jump]) -> f64 {
        let pairs = jumps.iter().zip(&self.counts).filter(|(_, counts)| **counts);
        pairs.map(|(jump, _)| jump.normal.hypot(jump.tangential)).fold(0.0, f64::max)
    }

    /// The point a way `step` (of time, along `tangent`) on from `u` at `time`; its residual and iterations.
    fn point(
        &mut self,
        u: &[[f64; 2]],
        time: f64,
        step: f64,
        tangent: &[Jump],
        start: &[f64],
    ) -> Option<(Vec<[f64; 2]>, f64, f64, u32)> {
        let before = self.model.jumps(u);
        let goal = step * self.along(tangent, tangent);
        let (mut field, mut now) = (u.to_vec(), time + step);
        self.model.set_border(&self.boundary.drive_at(now).places, &mut field);
        self.model.add_to_field(start, step, &mut field);
        let mut last = f64::INFINITY;
        for iteration in 1..=ITERATIONS {
            if !self.assemble(&field, now) {
                return None;
            }
            let residual = self.model.residual(&self.work);
            let largest = residual.iter().fold(0.0_f64, |most, force| most.max(force.abs()));
            let forces = self.work.force.iter().flatten().fold(0.0_f64, |most, force| most.max(force.abs()));
            if !largest.is_finite() || (iteration > 4 && largest > 2.0 * last) {
                return None;
            }
            last = largest;
            let jumps = self.model.jumps(&field);
            let change: Vec<Jump> = jumps.iter().zip(&before).map(|(a, b)| *a - *b).collect();
            let off = self.along(&change, tangent) - goal;
            let mut values: Vec<f64> = residual.iter().map(|force| -force).collect();
            self.work.factor.solve(&mut values);
            let mut by = vec![[0.0; 2]; field.len()];
            self.model.add_to_derivative(&values, &self.work, &mut by);
            let (speed, velocity) = self.velocity(now);
            let of_residual = self.along(&self.model.jump_changes(&field, &by), tangent);
            let of_time = self.along(&self.model.jump_changes(&field, &velocity), tangent);
            let more = -(off + of_residual) / of_time;
            if !more.is_finite() || more.abs() > 10.0 * (1.0 + step.abs()) {
                return None;
            }
            now += more;
            self.model.set_border(&self.boundary.drive_at(now).places, &mut field);
            let all: Vec<f64> = values.iter().zip(&speed).map(|(a, b)| a + more * b).collect();
            self.model.add_to_field(&all, 1.0, &mut field);
            // One more correction was made: the error left is the square.
            let settled = off.abs() <= 1e-9 * goal.abs() + f64::MIN_POSITIVE;
            if largest <= self.tolerance * forces + self.model.round_off(self.law, &field) && settled {
                return self.assemble(&field, now).then_some((
                    field,
                    now,
                    largest / forces.max(f64::MIN_POSITIVE),
                    iteration,
                ));
            }
        }
        None
    }
}

impl Model {
    /// The path of equilibria of `boundary` under `law`, from rest, through snaps. Where the history goes on evenly it
    /// is the same as that of [`Model::forward`] until the first of them.
    ///
    /// Sensitivities are those at a fixed time of each point; near a point where the time turns back they grow without
    /// bound.
    ///
    /// # Errors
    /// A history of other supports than those of the model.
    pub fn follow(
        &self,
        law: &dyn CohesiveLaw,
        boundary: &BoundaryHistory,
        options: &ForwardOptions,
        how: &FollowOptions,
        go_on: &dyn Fn(usize) -> bool,
    ) -> Result<Followed, ModelError> {
        self.check_boundary(boundary)?;
        let mut work = self.work();
        work.loaded = boundary.loaded().to_vec();
        work.loads = boundary.rest().forces;
        let counts = self.mesh().cracked_pairs().into_iter().map(|cracked| !cracked).collect();
        let mut arc = Arc { model: self, law, boundary, work, tolerance: options.newton.tolerance, counts };
        let n = boundary.instants().len() as f64;
        let longest = how.step * law.front_opening();
        let (mut u, mut time) = (vec![[0.0; 2]; self.mesh().nodes().len()], 0.0);
        let mut turn: Option<Vec<Jump>> = None;
        let (mut times, mut instants): (Vec<f64>, Vec<Instant>) = (Vec::new(), Vec::new());
        let mut share = 1.0;
        let mut end = PathEnd::Points;
        let mut ready = arc.assemble(&u, time);
        'path: while instants.len() < how.max_points && go_on(instants.len() + 1) {
            if !ready {
                end = PathEnd::Lost;
                break;
            }
            let (speed, velocity) = arc.velocity(time);
            let tangent = self.jump_changes(&u, &velocity);
            // On along the path: as the jumps went last.
            let forward = turn.as_ref().is_none_or(|last| arc.along(&tangent, last) >= 0.0);
            let sign = if forward { 1.0 } else { -1.0 };
            let (mut halvings, mut found) = (0, None);
            while found.is_none() {
                let step = sign * (share * longest / arc.largest(&tangent)).min(1.0);
                found = arc.point(&u, time, step, &tangent, &speed);
                if found.is_none() {
                    share *= 0.5;
                    halvings += 1;
                    if halvings > HALVINGS || !go_on(instants.len() + 1) {
                        end = PathEnd::Lost;
                        break 'path;
                    }
                    // The factor of this point, for its tangent.
                    let _ = arc.assemble(&u, time);
                }
            }
            let Some((field, now, residual, iterations)) = found else { break };
            if now <= 0.0 {
                end = PathEnd::Rest;
                break;
            }
            if now >= n {
                // What is left is a step of its own, to the end of the history.
                let yes = |_: usize| true;
                let mut path = Path::new(self, law, boundary, options.newton, &yes);
                path.start_at(&u, &boundary.drive_at(time).forces);
                let mut last = path.advance(&boundary.drive(boundary.instants().len() - 1));
                if last.status == Status::Converged {
                    arc.work = path.into_work();
                    last.sensitivities = sensitivity::at(self, law, &last.displacement, &arc.work, options);
                    times.push(n);
                    instants.push(last);
                    end = PathEnd::Last;
                } else {
                    end = PathEnd::Lost;
                }
                break;
            }
            let (before, after) = (self.jumps(&u), self.jumps(&field));
            turn = Some(after.iter().zip(&before).map(|(a, b)| *a - *b).collect());
            if iterations <= FEW {
                share = (1.5 * share).min(1.0);
            }
            (u, time, ready) = (field, now, true);
            times.push(time);
            instants.push(Instant {
                status: Status::Converged,
                displacement: u.clone(),
                iterations,
                halvings: halvings as u32,
                residual,
                residuals: vec![residual],
                sensitivities: sensitivity::at(self, law, &u, &arc.work, options),
                ..Instant::default()
            });
        }
        let parameters = sensitivity::parameters(self, law, options);
        let boundary = boundary.at_times(&times);
        Ok(Followed { times, boundary, solution: Solution { instants, parameters }, end })
    }
}
