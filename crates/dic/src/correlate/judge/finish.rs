//! What an iteration has found: status, uncertainty, marks and summary of a frame.

use crate::backend::{Backend, ElementMatch, Found, GreyTransfer, PixelSums};
use crate::correlate::{
    Bent, Correlation, CorrelationError, Correlator, DeformationGradient, Elements, Followed, ImagePair, Iterated,
    LEAST_LEFT, LeftOut, Level, Light, Limits, Look, Looks, MATCHED, Mixed, NodalSpread, OfElement, Outcome, Own,
    PhotonNoise, Residuals, Result, Seen, Settled, StartUsed, State, TOO_SLOW, ZoneResult, continue_field, factors,
    fill_field, follow_nodes, is_named, is_suspected, iterate, lost_in_noise, mark_pulled_along, nothing, numbers,
    rigid, spread_of,
};
use crate::field::{Brightness, ElementMark, Measurement, ModelError, Status};
use crate::linalg::Solver;
use rayon::prelude::*;
use std::cell::Cell;

/// A residual of this many times the noise of the reference says that a zone is misfit everywhere: out of focus, a
/// reflection, another light.
const MISFIT_EVERYWHERE: f64 = 3.0;
/// It is looked at whether something stays still in an element when the mean square of its residual is beyond chance, and
/// this many times that of its zone (a quarter more in amplitude).
const MARKED_RATIO: f64 = 1.5625;
/// Light that is to be held has followed for so many iterations on every device, whenever it was seen that it does not
/// settle.
const LIGHT_ITERATIONS: usize = 20;
/// While elements that do not match are still counted, light that has not settled is one where it leaves half of the
/// elements less than this of their residual; else something that does not match has passed for it.
const HELD_RATIO: f64 = 0.9;
/// Where a zone has settled most of its elements match; where they do not, its residual is noise up to this many times
/// that of the reference.
const NOISE_OF_REFERENCE: f64 = 2.0;
/// No correction above this is next to nothing, px.
const SMALL_PX: f64 = 0.1;
/// A zone of which less than this share of nodes is measured is not.
const LEAST_MEASURED: f64 = 0.2;
/// A zone so misfit that has lost more than this share of its elements is not found at all.
const CHOSEN_SHARE: f64 = 0.2;

/// A field whose iteration has ended, with what its uncertainties are made from.
struct Ended<'a, B: Backend> {
    outcome: &'a Outcome<B>,
    light: Option<&'a Light>,
    /// Per zone.
    sums: &'a [PixelSums],
    spread: &'a NodalSpread,
    by_grey: Elements<'a>,
    photon_noise: Option<PhotonNoise>,
}

/// What is odd about an element.
#[derive(Clone, Copy, PartialEq)]
enum Odd {
    Not,
    /// Its residual is a displacement that the field does not follow.
    Bent,
    /// It is beyond noise in another way.
    Loud,
}

struct Measured {
    /// Standard uncertainty of both components of each node, px; zero where it is not measured.
    sigma: Vec<[f64; 2]>,
    measured: Vec<bool>,
    zones: Vec<ZoneResult>,
    /// Per zone, the share of the data that is not taken by unknowns.
    freedom_left: Vec<f64>,
    /// Per zone, the variance that is left in the residual for image noise of one grey level.
    of_pair: Vec<f64>,
    nodes_at_bound: usize,
}

/// The median over the elements of their residuals in those of `before`.
fn median_ratio(after: &[ElementMatch], before: &[ElementMatch]) -> f64 {
    let both = after.iter().zip(before).filter(|(after, before)| after.n > 0.0 && before.n > 0.0);
    let mut ratios: Vec<f64> = both.map(|(after, before)| after.residual_rms / before.residual_rms).collect();
    ratios.sort_by(f64::total_cmp);
    ratios.get(ratios.len() / 2).copied().unwrap_or(f64::INFINITY)
}

impl<B: Backend> Correlator<B> {
    /// What the misfit test takes of a frame whose nodes take the degrees of `freedom`.
    pub(crate) fn residuals<'a>(
        &'a self,
        elements: &'a [ElementMatch],
        displacement: &'a [[f64; 2]],
        transfer: &'a [GreyTransfer],
        freedom: &'a [f64],
        excluded: &'a [bool],
    ) -> Residuals<'a> {
        let (mesh, gain, noise) = (self.mesh(), &self.noise_gain, self.options.noise.constant());
        let freedom_of_element = if self.options.brightness == Brightness::Element { 2.0 } else { 0.0 };
        Residuals { mesh, gain, elements, displacement, transfer, freedom, freedom_of_element, noise, excluded }
    }

    /// What an iteration has found; where the light asks for smooth fields, after iterating on with them. The fields
    /// follow the displacement one iteration late, as the transfers of the zones do.
    fn find_light(
        &self,
        frame: &mut B::Frame,
        field: &mut B::Field,
        outcome: &mut Outcome<B>,
        excluded: &[bool],
    ) -> Result<(Found, Option<Light>)> {
        let Level { mesh, prepared, moments, .. } = &self.levels[0];
        let found = self.backend.read_field(prepared, frame, field)?;
        let always = match self.options.brightness {
            Brightness::Auto => false,
            Brightness::Smooth => true,
            Brightness::Zone | Brightness::Element | Brightness::Off => return Ok((found, None)),
        };
        let settled = matches!(outcome.status, Status::Converged | Status::IterationLimit);
        if !settled || !(always || is_suspected(mesh, &found.elements, moments)) {
            return Ok((found, None));
        }
        let variances = self.noise_gain.variances(mesh, &found.displacement);
        let (sums, transfer) = self.backend.element_sums(prepared, frame, field)?;
        let of_reference = self.noise_gain.of_reference;
        let seen = Seen { mesh, sums: &sums, transfer: &transfer, variances: &variances, of_reference };
        let Some(mut light) = Light::find(&seen, always) else { return Ok((found, None)) };
        self.backend.light(prepared, frame, field, &light.nodes)?;
        let (turn, is_rest) = (outcome.turn, excluded.contains(&true));
        let limits = if is_rest { self.rest_limits(turn) } else { self.limits(turn) };
        let mut more = self.iterate_in_light(frame, field, &mut light, &found, limits)?;
        more.iterations += outcome.iterations;
        if outcome.status == Status::Converged && more.status != Status::Converged {
            // What was found with one gain and offset per zone is worth more than a field that does not settle.
            outcome.iterations = more.iterations;
            self.remove_light(frame, field, &found.displacement)?;
            return Ok((found, None));
        }
        more.own = more.own.or(outcome.own.take());
        *outcome = more;
        Ok((self.backend.read_field(prepared, frame, field)?, Some(light)))
    }

    pub(crate) fn remove_light(
        &self,
        frame: &mut B::Frame,
        field: &mut B::Field,
        displacement: &[[f64; 2]],
    ) -> Result<()> {
        let Level { mesh, prepared, .. } = &self.levels[0];
        self.backend.light(prepared, frame, field, &vec![GreyTransfer::NONE; mesh.n_nodes()])?;
        self.backend.place(prepared, frame, field, displacement)?;
        self.backend.observe(prepared, frame, field)?;
        Ok(())
    }

    /// Iterates while the light follows the field, which was as `before` when it was found. Where one holds the other
    /// up, and it is light, it stays from some iteration on: what remains to be found is the displacement.
    pub(crate) fn iterate_in_light(
        &self,
        frame: &mut B::Frame,
        field: &mut B::Field,
        light: &mut Light,
        before: &Found,
        limits: Limits<'_>,
    ) -> Result<Outcome<B>> {
        let level @ Level { mesh, prepared, .. } = &self.levels[0];
        let mut iterations = 0;
        if !light.is_held {
            let (variances, of_reference) =
                (self.noise_gain.variances(mesh, &before.displacement), self.noise_gain.of_reference);
            let (mut mixed, is_new) = (Mixed::default(), Cell::new(true));
            let mut follow = |frame: &mut B::Frame, field: &mut B::Field| {
                let (sums, transfer) = self.backend.element_sums(prepared, frame, field)?;
                light.follow(&Seen { mesh, sums: &sums, transfer: &transfer, variances: &variances, of_reference });
                if is_new.take() {
                    mixed.begin_anew();
                }
                let displacement = self.backend.read_field(prepared, frame, field)?.displacement;
                let mut at = State { displacement, light: std::mem::take(&mut light.nodes) };
                if mixed.advance(&mut at) {
                    self.backend.place(prepared, frame, field, &at.displacement)?;
                }
                light.nodes = at.light;
                self.backend.light(prepared, frame, field, &light.nodes)
            };
            let limits = Limits { late_light: true, ..limits };
            let outcome = iterate(&self.backend, level, frame, field, limits, &self.kernel, &mut follow)?;
            if outcome.status != Status::IterationLimit {
                return Ok(outcome);
            }
            let now = self.backend.read_field(prepared, frame, field)?;
            // A solver of its own is asked for once what does not match has been left out.
            if !limits.own && median_ratio(&now.elements, &before.elements) >= HELD_RATIO {
                return Ok(outcome);
            }
            iterations = outcome.iterations;
            while iterations < LIGHT_ITERATIONS {
                let max_iterations = (LIGHT_ITERATIONS - iterations).min(TOO_SLOW[0] - 1);
                let limits = Limits { max_iterations, ..limits };
                is_new.set(true);
                let more = iterate(&self.backend, level, frame, field, limits, &self.kernel, &mut follow)?;
                iterations += more.iterations;
                if more.status != Status::IterationLimit {
                    break;
                }
            }
            light.is_held = true;
        }
        let mut outcome = iterate(&self.backend, level, frame, field, limits, &self.kernel, nothing)?;
        outcome.iterations += iterations;
        Ok(outcome)
    }

    /// Measures a finished iteration, without the elements `left_out` and those that do not match.
    pub(crate) fn finish(
        &self,
        frame: &mut B::Frame,
        field: &mut B::Field,
        outcome: Outcome<B>,
        start: StartUsed,
        coarse_iterations: usize,
        left_out: LeftOut,
    ) -> Result<Correlation> {
        let iterated = self.end_iteration(frame, field, outcome, left_out)?;
        let settled = self.settle(frame, field, iterated)?;
        Ok(self.measure(frame, settled, start, coarse_iterations))
    }

    /// What a finished iteration without what is left out has found, see [`Correlator::find_light`].
    pub(crate) fn end_iteration(
        &self,
        frame: &mut B::Frame,
        field: &mut B::Field,
        mut outcome: Outcome<B>,
        LeftOut { elements: excluded, zones: lost }: LeftOut,
    ) -> Result<Iterated<B>> {
        let (mut found, light) = self.find_light(frame, field, &mut outcome, &excluded)?;
        self.fill(&outcome, &mut found, &excluded);
        Ok(Iterated { outcome, found, light, excluded, lost })
    }

    /// Puts nodes of elements that are `excluded`, and those that noise has kept from settling, where the field around
    /// them would have them: what comes after may be begun from there.
    fn fill(&self, outcome: &Outcome<B>, found: &mut Found, excluded: &[bool]) {
        let mesh = &self.levels[0].mesh;
        if excluded.contains(&true) {
            found.displacement = continue_field(mesh, &found.displacement, &found.elements);
        }
        if outcome.unsettled.is_empty() {
            return;
        }
        let mut known = vec![true; mesh.n_nodes()];
        outcome.unsettled.iter().for_each(|&node| known[node] = false);
        found.displacement = fill_field(mesh, &found.displacement, known);
    }

    /// Its field without those elements that turn out not to match: the end of what the device has to do.
    pub(crate) fn settle(
        &self,
        frame: &mut B::Frame,
        field: &mut B::Field,
        mut iterated: Iterated<B>,
    ) -> Result<Settled<B>> {
        let before = iterated.excluded.clone();
        self.screen(frame, field, &mut iterated)?;
        let Iterated { outcome, mut found, light, excluded, lost } = iterated;
        self.fill(&outcome, &mut found, &excluded);
        let matches = self.zone_matches(&found.zones, &found.elements);
        let of_zones = self.judge_zones(&outcome, &found, &matches, &excluded, &lost);
        let status = of_frame(&of_zones, &lost);
        let is_as_iterated = status == Status::Converged && excluded == before;
        let looks = match status {
            Status::Converged | Status::IterationLimit => self.ask_residual(frame, field, &found)?,
            _ => Looks::default(),
        };
        let of = Iterated { outcome, found, light, excluded, lost };
        Ok(Settled { of, is_as_iterated, matches, status, of_zones, looks })
    }

    /// What the residual follows beyond the field: of a sample, and of the elements that this makes doubtful.
    fn ask_residual(&self, frame: &mut B::Frame, field: &mut B::Field, found: &Found) -> Result<Looks> {
        let (Level { mesh, prepared, .. }, test) = (&self.levels[0], &self.bend_test);
        let mut looks = Looks::default();
        let mut ask = |looks: &mut Looks, elements: &[u32]| {
            let unknown = test.unknown(elements);
            if !unknown.is_empty() {
                test.note(&unknown, &self.backend.bent_moments(prepared, &unknown)?);
            }
            let sums = self.backend.bent_sums(prepared, frame, field, elements)?;
            test.look_at(looks, elements, &sums, &found.elements);
            Ok::<(), CorrelationError>(())
        };
        ask(&mut looks, &test.sample())?;
        let more = test.choose(mesh, &looks, &found.elements);
        ask(&mut looks, &more)?;
        Ok(looks)
    }

    /// Uncertainty, marks and summary of a field, and whether it is one.
    pub(crate) fn measure(
        &self,
        frame: &B::Frame,
        Settled { of: iterated, matches, mut of_zones, looks, .. }: Settled<B>,
        start: StartUsed,
        coarse_iterations: usize,
    ) -> Correlation {
        let level = &self.levels[0];
        let mesh = &level.mesh;
        let Iterated { outcome, found, light, excluded, lost } = iterated;
        let Found { displacement: full_displacement, zones: last, elements, transfer: transfers } = found;
        let (measured, nodes_left) = self.measured_nodes(&elements, &full_displacement, &excluded);
        let own_spread = outcome.own.as_ref().map(|own| self.own_spread(own));
        let by_grey = Elements {
            mesh,
            moments: &level.moments,
            matched: &elements,
            displacement: &full_displacement,
            transfer: &transfers,
            grey_offset: f64::from(self.kernel.grey_offset),
            gain: &self.noise_gain,
            least: self.rounding * self.rounding,
        };
        let photon_noise = by_grey.photon(self.options.noise);
        let spread = own_spread.as_ref().unwrap_or(&self.spread);
        let of = Ended { outcome: &outcome, light: light.as_ref(), sums: &last, spread, by_grey, photon_noise };
        let mut made = self.measure_zones(&of, &matches, measured);
        if self.is_enough(&outcome) {
            of_zones.iter_mut().filter(|of| **of == Status::IterationLimit).for_each(|of| *of = Status::Converged);
        }
        let unfollowed = self.bend_test.test(mesh, &looks, self.solver_of(&outcome));
        let image = self.backend.image(frame);
        let pair = ImagePair::new([&self.image, &image], mesh, &full_displacement);
        let probe = self.probe.as_ref().filter(|_| of_frame(&of_zones, &lost) == Status::Converged);
        let light_nodes = light.as_ref().map(|light| light.nodes.as_slice());
        let noise_colour = probe
            .and_then(|probe| probe.look(&of.by_grey, &image, light_nodes, &made.freedom_left, unfollowed.is_wide()));
        // Correlated noise, as of resampled images, shows little in the fine structure; a reflection may pass for it.
        let is_coloured = noise_colour.is_some_and(|colour| colour.to_apply().is_some());
        let everywhere = self.misfit_everywhere(&elements, &made.zones, &pair, is_coloured);
        let nodes_in_noise = self.leave_out_noise(&of, &everywhere, &mut made);
        let noise_factor = factors(self.options.noise_correlation, noise_colour.as_ref());
        let own_noise = photon_noise.map(|noise| of.by_grey.by_node(noise));
        for (node, sigma) in made.sigma.iter_mut().enumerate() {
            let own = own_noise.as_ref().map_or([1.0; 2], |own| own[node]);
            (0..2).for_each(|c| sigma[c] *= own[c] * noise_factor[c]);
        }
        let (model_error, odd) = self.model_error(&of, &made, &excluded, unfollowed);
        self.judge_settled(&mut of_zones, (&elements, &excluded), &everywhere, &made);
        let status = of_frame(&of_zones, &lost);
        let Measured { sigma, measured, mut zones, nodes_at_bound, .. } = made;
        zones.iter_mut().zip(&of_zones).for_each(|(zone, of)| zone.status = *of);
        let mut marks = self.marks(&pair, &elements, &excluded, &odd, &everywhere);
        mark_pulled_along(mesh, &mut marks, &model_error, &sigma);
        let counted: Vec<bool> = elements.iter().map(|e| e.n > 0.0).collect();
        let mut all = PixelSums::default();
        last.iter().for_each(|sums| all.add(sums));
        let displacement =
            full_displacement.iter().zip(&measured).map(|(u, &m)| if m { *u } else { [0.0; 2] }).collect();
        let rigid = rigid(mesh, &full_displacement, &measured, 0..mesh.n_nodes());
        let interpolation_bias_px = self.mean_bias(&full_displacement, &measured);
        if let Some(own) = outcome.own {
            own.give_back(&self.backend, level);
        }
        Correlation {
            measurement: Measurement {
                mesh: mesh.clone(),
                status,
                displacement,
                sigma,
                measured,
                element_residual: elements.iter().map(|e| e.residual_rms).collect(),
                model_error: Some(model_error),
                marks: Some(marks),
                points: None,
            },
            iterations: outcome.iterations,
            coarse_iterations,
            noise_colour,
            noise_factor,
            photon_noise,
            traffic: self.backend.traffic(frame),
            interpolation_bias_px,
            correction_px: outcome.correction_px,
            correction_at: mesh.nodes()[outcome.worst_node],
            residual_rms: all.residual_rms(),
            residual_percent: 100.0 * all.residual_rms() / self.grey_range.max(f64::MIN_POSITIVE),
            rigid,
            zones,
            start,
            nodes_left,
            nodes_in_noise,
            nodes_at_bound,
            ambiguity: None,
            poor_elements: elements.iter().filter(|e| e.n > 0.0 && e.correlation < MATCHED).count(),
            reference_frame: 0,
            device_checked_px: None,
            full_displacement,
            counted,
            left_out: numbers(&excluded),
            worst_node: outcome.worst_node,
        }
    }

    /// Measures each zone, and gives the `measured` nodes their standard uncertainties: without a finite one none is.
    fn measure_zones(&self, of: &Ended<'_, B>, matches: &[f64], measured: Vec<bool>) -> Measured {
        let Ended { light, sums: last, spread, by_grey, photon_noise, .. } = of;
        let (mesh, transfers, displacement) = (by_grey.mesh, by_grey.transfer, by_grey.displacement);
        let (sigma, zones) = (vec![[0.0; 2]; mesh.n_nodes()], Vec::new());
        let (freedom_left, of_pair) = (Vec::new(), Vec::new());
        let mut made = Measured { sigma, measured, zones, freedom_left, of_pair, nodes_at_bound: 0 };
        let gradients = DeformationGradient::of_nodes(mesh, displacement, &made.measured);
        for (zone, name) in mesh.zones().iter().enumerate() {
            let nodes = mesh.zone_nodes(zone);
            let sums = &last[zone];
            let (transfer, smooth) = match light {
                Some(light) => light.of_zone(mesh, zone, transfers[zone], |transfer| self.offset_of(transfer)),
                None => (transfers[zone], None),
            };
            let of_light = light.map_or(0.0, |light| light.unknowns(zone));
            let n_transfers = match self.options.brightness {
                Brightness::Auto | Brightness::Zone | Brightness::Smooth => 1,
                Brightness::Element => mesh.zone_elements(zone).len(),
                Brightness::Off => 0,
            };
            let taken: f64 = nodes.clone().filter(|&node| made.measured[node]).map(|node| spread.freedom[node]).sum();
            let unknowns = taken + of_light + 2.0 * n_transfers as f64;
            let freedom_left = 1.0 - unknowns / sums.n.max(1.0);
            made.freedom_left.push(freedom_left);
            let by_sums = self.options.brightness.of_sums() == Brightness::Zone && light.is_none();
            let gain = self.noise_gain.of_zone(mesh, zone, displacement, transfer, by_sums.then_some(sums));
            // Identical images still hold the same rounding.
            made.of_pair.push(gain.residual * freedom_left.max(f64::MIN_POSITIVE));
            // The residual holds the noise of f and the interpolated (filtered) noise of g.
            let freedom = (sums.n - unknowns).max(1.0);
            let residual_noise = (sums.rr / freedom / gain.residual).max(0.0).sqrt().max(self.rounding);
            let given = photon_noise.map(|noise| by_grey.in_zone(zone, noise)).or(self.options.noise.constant());
            let noise = given.unwrap_or(residual_noise);
            for node in nodes.clone().filter(|&node| made.measured[node]) {
                let at = [0, 1].map(|c| spread.at(node, c, gain.lambda(noise)));
                made.nodes_at_bound += usize::from(at.iter().any(|at| at.at_bound));
                let variances = [0, 1].map(|c| gain.variance(noise, at[c], c));
                made.sigma[node] = gradients[node].variances(variances).map(f64::sqrt);
            }
            made.zones.push(ZoneResult {
                name: name.clone(),
                status: Status::Converged,
                rigid: rigid(mesh, displacement, &made.measured, nodes),
                transfer,
                light: smooth,
                correlation: matches[zone],
                residual_rms: sums.residual_rms(),
                noise,
                residual_noise,
            });
        }
        for (sigma, measured) in made.sigma.iter_mut().zip(&mut made.measured) {
            if sigma.iter().any(|sigma| !sigma.is_finite()) {
                (*sigma, *measured) = ([0.0; 2], false);
            }
        }
        made
    }

    /// Whether the last correction of the node that moved most is next to nothing beside the standard uncertainty that
    /// the noise of the reference gives it: that of the frame may have been raised by what failed.
    fn is_enough(&self, outcome: &Outcome<B>) -> bool {
        let enough = self.enough.get(outcome.worst_node).filter(|enough| enough.is_noisy);
        enough.is_some_and(|enough| outcome.correction_px < enough.px.min(SMALL_PX))
    }

    /// Takes back that zones have converged where what is left of them is no match.
    fn judge_settled(
        &self,
        of_zones: &mut [Status],
        (elements, excluded): (&[ElementMatch], &[bool]),
        everywhere: &[bool],
        made: &Measured,
    ) {
        for (zone, of) in of_zones.iter_mut().enumerate().filter(|(_, of)| **of == Status::Converged) {
            let of_zone = self.mesh().zone_elements(zone);
            let lost = of_zone.clone().filter(|&element| excluded[element]).count();
            // What is left after the choice of the best is no match: anything would have some.
            let is_chosen = everywhere[zone] && lost as f64 > CHOSEN_SHARE * of_zone.len() as f64;
            if is_chosen || self.is_poor(zone, elements, made) {
                *of = Status::Diverged;
            }
        }
    }

    /// Whether a zone that has settled shows the specimen hardly anywhere: too few of its nodes are measured, or most
    /// of its elements do not match, for which noise is no reason.
    fn is_poor(&self, zone: usize, elements: &[ElementMatch], made: &Measured) -> bool {
        let Level { mesh, keep, .. } = &self.levels[0];
        let nodes = mesh.zone_nodes(zone).filter(|&node| keep[node]);
        let (measured, all) = nodes.fold((0, 0), |(n, all), node| (n + usize::from(made.measured[node]), all + 1));
        let counted = || mesh.zone_elements(zone).map(|element| &elements[element]).filter(|of| of.n > 0.0);
        let poor = counted().filter(|of| of.correlation < MATCHED).count();
        let is_noise = made.zones[zone].residual_noise <= NOISE_OF_REFERENCE * self.misfit_test.fine.max(self.rounding);
        (measured as f64) < LEAST_MEASURED * all as f64 || (2 * poor > counted().count() && !is_noise)
    }

    /// Whether each zone is misfit everywhere; where the noise `is_coloured`, something must not move with its pattern.
    fn misfit_everywhere(
        &self,
        elements: &[ElementMatch],
        zones: &[ZoneResult],
        pair: &ImagePair<'_>,
        is_coloured: bool,
    ) -> Vec<bool> {
        let noisy = |(zone, of): (usize, &ZoneResult)| {
            let noisy = of.residual_noise > MISFIT_EVERYWHERE * self.misfit_test.fine.max(self.rounding);
            let counts = |&element: &usize| elements[element].n > 0.0;
            noisy && (!is_coloured || pair.something_is_still(self.mesh().zone_elements(zone).filter(counts)))
        };
        zones.iter().enumerate().map(noisy).collect()
    }

    /// Leaves out the nodes that noise has kept from settling, and those lost in it; returns how many.
    fn leave_out_noise(&self, of: &Ended<'_, B>, everywhere: &[bool], made: &mut Measured) -> usize {
        let mesh = self.mesh();
        let gain = self.kernel.gradient_noise_gain / self.options.n_references.max(1) as f64;
        let mut in_noise = match self.seen.is_empty() {
            true => Vec::new(),
            false => {
                let most = self.options.sigma_most_px;
                lost_in_noise(mesh, &self.seen, of.by_grey.matched, (&made.of_pair, gain), &made.measured, most)
            }
        };
        // What is misfit everywhere is no noise to be lost in.
        in_noise.retain(|&node| !everywhere[mesh.node_zone()[node] as usize]);
        in_noise.extend(of.outcome.unsettled.iter().filter(|&&node| made.measured[node]));
        in_noise.sort_unstable();
        in_noise.dedup();
        in_noise.iter().for_each(|&node| (made.sigma[node], made.measured[node]) = ([0.0; 2], false));
        if !in_noise.is_empty() {
            for (zone, result) in made.zones.iter_mut().enumerate() {
                result.rigid = rigid(mesh, of.by_grey.displacement, &made.measured, mesh.zone_nodes(zone));
            }
        }
        in_noise.len()
    }

    /// Bias of the interpolation, root mean square over the measured nodes, px.
    fn mean_bias(&self, displacement: &[[f64; 2]], measured: &[bool]) -> [f64; 2] {
        let (mut squares, mut n) = ([0.0; 2], 0.0f64);
        for (u, _) in displacement.iter().zip(measured).filter(|(_, measured)| **measured) {
            let bias = self.interpolation_bias.at(*u);
            (0..2).for_each(|c| squares[c] += bias[c] * bias[c]);
            n += 1.0;
        }
        squares.map(|square| (square / n.max(1.0)).sqrt())
    }

    /// The solver of what a frame has left.
    fn solver_of<'a>(&'a self, outcome: &'a Outcome<B>) -> &'a Solver {
        outcome.own.as_ref().map_or(&*self.levels[0].solver, |own| &own.solver)
    }

    /// What the field may be off beyond noise, and what is odd about each element: misfit where its residual is a
    /// displacement, still where it is beyond noise in another way.
    fn model_error(
        &self,
        of: &Ended<'_, B>,
        made: &Measured,
        excluded: &[bool],
        unfollowed: Bent,
    ) -> (ModelError, Vec<Odd>) {
        let displacement = of.by_grey.displacement;
        let Elements { mesh, matched, transfer, .. } = of.by_grey;
        let residuals = self.residuals(matched, displacement, transfer, &of.spread.freedom, excluded);
        let looks = self.misfit_test.rate_residuals(&residuals);
        let solver = self.solver_of(of.outcome);
        let Bent { not_followed, nodes } = unfollowed;
        let bias = &self.interpolation_bias;
        let nodes = self.mesh_lines.estimate_errors(displacement, &made.sigma, &made.measured, &nodes, solver, bias);
        let model_error = ModelError { nodes, misfit: not_followed };
        let is_loud = |look: &Option<Look>| look.is_some_and(|look| look.is_beyond && look.ratio > MARKED_RATIO);
        let odd = |(is_named, look): (bool, &Option<Look>)| match (is_named, is_loud(look)) {
            (true, _) => Odd::Bent,
            (false, true) => Odd::Loud,
            (false, false) => Odd::Not,
        };
        let odd = is_named(mesh, &model_error, &made.sigma).into_iter().zip(&looks).map(odd).collect();
        (model_error, odd)
    }

    /// What was found, with the nodes on faces of cuts that their elements have lost and that can be followed by
    /// themselves; they keep the marks of their elements. `expected` is where the frame was started, all nodes.
    pub(crate) fn add_faces(
        &self,
        frame: &B::Frame,
        mut found: Correlation,
        expected: Option<&[[f64; 2]]>,
    ) -> Correlation {
        let gone: Vec<bool> = found.counted.iter().map(|counted| !counted).collect();
        if found.measurement.status != Status::Converged || !gone.contains(&true) {
            return found;
        }
        let (mesh, image) = (self.mesh(), self.backend.image(frame));
        let faces = follow_nodes(
            [&self.image, &image],
            mesh,
            self.cut_nodes(),
            &self.zone_pixels,
            [&found.measurement.measured, &self.levels[0].keep, &gone],
            &found.full_displacement,
            expected,
        );
        if faces.is_empty() {
            return found;
        }
        let field = &mut found.measurement;
        for Followed { node, displacement, sigma } in faces {
            found.full_displacement[node] = displacement;
            (field.displacement[node], field.sigma[node], field.measured[node]) = (displacement, sigma, true);
        }
        found.rigid = rigid(mesh, &found.full_displacement, &field.measured, 0..mesh.n_nodes());
        found
    }

    fn own_spread(&self, own: &Own<B>) -> NodalSpread {
        let Level { mesh, moments, pattern, regulariser, lambda, .. } = &self.levels[0];
        let isa = self.backend.host_isa();
        let solvers = (&*own.solver, regulariser.as_ref());
        if let Some(spread) = self.spread.update(isa, (mesh, moments), pattern, solvers, &own.changed) {
            return spread;
        }
        let of_element = |element: usize| match own.changed.elements.binary_search(&(element as u32)) {
            Ok(_) => *own.changed.of(element as u32),
            Err(_) => OfElement::new(mesh, element, &moments[element], &self.kernel, *lambda),
        };
        let of_elements: Vec<_> = (0..mesh.n_elements()).into_par_iter().with_min_len(64).map(of_element).collect();
        spread_of(isa, mesh, &own.solver, regulariser.as_ref(), &of_elements)
    }

    /// How well each zone matches: its correlation coefficient, or what stands for it.
    fn zone_matches(&self, zones: &[PixelSums], elements: &[ElementMatch]) -> Vec<f64> {
        let mesh = self.mesh();
        let match_of = |(zone, sums): (usize, &PixelSums)| match self.options.brightness {
            Brightness::Element => ElementMatch::mean_correlation(&elements[mesh.zone_elements(zone)]),
            // Without a transfer a change of light is misfit, although it correlates.
            Brightness::Off => sums.explained(),
            Brightness::Auto | Brightness::Zone | Brightness::Smooth => sums.correlation(),
        };
        zones.iter().enumerate().map(match_of).collect()
    }

    /// Nodes beside an element that counted, with a displacement that an image of this size can have; and the number of
    /// those all of whose elements have left the image, without any that is `excluded`.
    fn measured_nodes(
        &self,
        elements: &[ElementMatch],
        displacement: &[[f64; 2]],
        excluded: &[bool],
    ) -> (Vec<bool>, usize) {
        let Level { mesh, keep, .. } = &self.levels[0];
        let mut measured = vec![false; mesh.n_nodes()];
        let mut named = vec![false; mesh.n_nodes()];
        for ((nodes, sums), &excluded) in mesh.elements().iter().zip(elements).zip(excluded) {
            for &node in nodes {
                measured[node as usize] |= sums.n > 0.0;
                named[node as usize] |= excluded;
            }
        }
        let left = (0..keep.len()).filter(|&node| keep[node] && !measured[node] && !named[node]).count();
        // From one end of the image to the other; NaN is not within.
        let most = self.size.map(|size| size as f64 + mesh.element_size());
        for (node, measured) in measured.iter_mut().enumerate() {
            *measured &= keep[node] && displacement[node].iter().zip(&most).all(|(u, most)| u.abs() <= *most);
        }
        (measured, left)
    }

    /// What is the matter with each element, by name.
    fn marks(
        &self,
        pair: &ImagePair<'_>,
        elements: &[ElementMatch],
        excluded: &[bool],
        odd: &[Odd],
        everywhere: &[bool],
    ) -> Vec<ElementMark> {
        let Level { mesh, moments, .. } = &self.levels[0];
        let counts = |element: &usize| elements[*element].n > 0.0;
        // What is nearly everywhere in a zone has one name, and is told by all of it.
        let is_wide = |zone: usize| {
            let counted = || mesh.zone_elements(zone).filter(counts);
            let named = counted().filter(|&element| odd[element] != Odd::Not).count();
            everywhere[zone] || 2 * named > counted().count()
        };
        let of_zone = |zone: usize| match is_wide(zone) {
            true if pair.something_is_still(mesh.zone_elements(zone).filter(counts)) => ElementMark::Still,
            true => ElementMark::Misfit,
            false => ElementMark::None,
        };
        let of_zones: Vec<ElementMark> = (0..mesh.zones().len()).map(of_zone).collect();
        let of_element = |element: usize| match (excluded[element], elements[element].n > 0.0) {
            _ if moments[element].n == 0.0 => ElementMark::NoTexture,
            (true, _) => pair.name(element, ElementMark::NoMatch),
            (false, false) => ElementMark::LeftImage,
            (false, true) => {
                let zone = mesh.element_zone()[element] as usize;
                match of_zones[zone] {
                    mark if everywhere[zone] => mark,
                    _ if odd[element] == Odd::Not => ElementMark::None,
                    ElementMark::Still => ElementMark::Still,
                    _ if odd[element] == Odd::Loud => pair.name(element, ElementMark::None),
                    ElementMark::None => pair.name(element, ElementMark::Misfit),
                    mark => mark,
                }
            }
        };
        (0..mesh.n_elements()).map(of_element).collect()
    }

    /// The zones of which no element that shows texture is left, or that have none.
    pub(crate) fn lost_zones(&self, excluded: &[bool]) -> Vec<bool> {
        let Level { mesh, moments, .. } = &self.levels[0];
        let in_use = |zone| mesh.zone_elements(zone).filter(|&element| moments[element].n > 0.0);
        let is_lost = |zone| in_use(zone).all(|element| excluded[element]);
        (0..mesh.zones().len()).map(is_lost).collect()
    }

    /// How each zone has ended. Where one has run away, others that still match have not settled yet.
    fn judge_zones(
        &self,
        outcome: &Outcome<B>,
        found: &Found,
        matches: &[f64],
        excluded: &[bool],
        lost: &[bool],
    ) -> Vec<Status> {
        let Level { mesh, moments, .. } = &self.levels[0];
        let worst = mesh.node_zone()[outcome.worst_node] as usize;
        let of_zone = |zone: usize| {
            let in_use = || mesh.zone_elements(zone).filter(|&element| moments[element].n > 0.0);
            let (all, out) = (in_use().count(), in_use().filter(|&element| found.elements[element].n == 0.0).count());
            let mismatched = in_use().filter(|&element| excluded[element]).count();
            match outcome.status {
                _ if lost[zone] => Status::Diverged,
                _ if out as f64 > (1.0 - LEAST_LEFT) * all as f64 && 2 * mismatched <= out => Status::LeftImage,
                _ if out as f64 > (1.0 - LEAST_LEFT) * all as f64 || matches[zone] <= MATCHED => Status::Diverged,
                Status::Diverged if zone != worst => Status::IterationLimit,
                status => status,
            }
        };
        (0..mesh.zones().len()).map(of_zone).collect()
    }
}

/// The status of a frame by that of its zones, but for those `lost` before where others are left: the worst.
fn of_frame(of_zones: &[Status], lost: &[bool]) -> Status {
    let is_any_kept = lost.contains(&false);
    let has = |status: Status| of_zones.iter().zip(lost).any(|(of, lost)| *of == status && !(is_any_kept && *lost));
    let order = [Status::LeftImage, Status::Diverged, Status::IterationLimit];
    order.into_iter().find(|&status| has(status)).unwrap_or(Status::Converged)
}
