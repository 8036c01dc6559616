//! Do force and displacements want the same parameters? The width of the specimen as one more unknown, and other faults
//! of a load, each alone.

use super::one_more::OneMore;
use crate::identify::{ConstantEffect, ConstantKind, Evaluation, NORMAL_95, ObservedInstant, Problem, Weights};
use crate::linalg::Dense;

/// Of several changes that lower the objective those that lower it by this share of what the best one does are named.
const AS_GOOD: f64 = 0.7;

/// The width of the specimen as one more unknown: do force and displacements want the same parameters?
#[derive(Debug, Clone, PartialEq)]
pub struct ReleasedWidth {
    /// The width that the case gives, mm.
    pub prescribed_mm: f64,
    /// The width that the data prefer, mm.
    pub value_mm: f64,
    /// Its standard uncertainty by the noise, mm.
    pub std_mm: f64,
    /// That of the difference: noise, the width as it was given, all other constants and the size of the elements, mm.
    pub allowed_mm: f64,
    /// What the objective falls by.
    pub gain: f64,
    /// What else would bring both together, each alone, where the data ask for it.
    pub others: Vec<LoadFault>,
}

/// A change of the load, or of a constant, that would bring force and displacements together.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadFault {
    /// In words, with its size.
    pub text: String,
    /// What the objective falls by.
    pub gain: f64,
}

/// Takes a change of the rows as one more unknown, which of the constants is the same, and how well that is known.
type Release<'a> = dyn Fn(&[Dense], &dyn Fn(&ConstantKind) -> bool, f64) -> Option<OneMore> + 'a;

impl ReleasedWidth {
    /// Whether the data refuse the width.
    pub fn contradicts(&self) -> bool {
        self.gain > OneMore::LIMIT && (self.value_mm - self.prescribed_mm).abs() > NORMAL_95 * self.allowed_mm
    }

    /// What there is to say, where force and displacements contradict each other.
    pub fn sentence(&self) -> Option<String> {
        let own = self.contradicts().then(|| LoadFault {
            text: format!("width_mm = {:.4} +- {:.2} in place of {}", self.value_mm, self.std_mm, self.prescribed_mm),
            gain: self.gain,
        });
        let mut faults: Vec<&LoadFault> = own.iter().chain(&self.others).collect();
        faults.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        let best = faults.first()?.gain;
        let named = faults.iter().filter(|fault| fault.gain >= AS_GOOD * best);
        let named: Vec<String> =
            named.map(|fault| format!("{} (omega falls by {:.0})", fault.text, fault.gain)).collect();
        Some(format!(
            "force and displacements contradict each other; what would bring them together: {}; check that, the unit and the group \
             of the load cell, and whether the model holds all of the joint that bears the load",
            named.join(", or ")
        ))
    }
}

impl Problem<'_> {
    /// The width of the specimen as one more unknown of the fit that ended at `evaluation` under `weights`, to first
    /// order; `None` without a force, or where the data say nothing of it. `refined` and `effects` as of
    /// [`Problem::misfit`].
    pub(crate) fn width_as_unknown(
        &self,
        evaluation: &Evaluation,
        weights: &Weights,
        refined: Option<&[Dense]>,
        effects: &[ConstantEffect],
        prescribed_std: f64,
    ) -> Option<ReleasedWidth> {
        let cell = self.observation.force.as_ref()?;
        let Weights::Inverse(_) = weights else { return None };
        let law = self.unknowns.law_at(&evaluation.x).ok()?;
        let model = evaluation.model(self);
        let by_width = |observed: &ObservedInstant| {
            let u = &evaluation.solution.instants[observed.index].displacement;
            self.observation.column(observed.index, |_, _| 0.0, |cell| cell.reaction(model, &*law, u).value)
        };
        let change: Vec<Dense> = self.observation.instants.iter().map(by_width).collect();
        let release = |change: &[Dense], own: &dyn Fn(&ConstantKind) -> bool, prescribed_std: f64| {
            let others = effects.iter().filter(|effect| !own(&effect.constant.kind));
            self.one_more_unknown(change, (evaluation, weights), refined, others, prescribed_std)
        };
        let width = release(&change, &|kind| *kind == ConstantKind::Width, prescribed_std)?;
        let others = self.other_faults(&change, cell.width_mm, effects, &release);
        Some(ReleasedWidth {
            prescribed_mm: cell.width_mm,
            value_mm: cell.width_mm + width.value,
            std_mm: width.std,
            allowed_mm: width.allowed,
            gain: width.gain,
            others,
        })
    }

    /// A zero of the load, its time, and moduli: what of these the data ask for. `by_width`: forces by mm of width.
    fn other_faults(
        &self,
        by_width: &[Dense],
        width_mm: f64,
        effects: &[ConstantEffect],
        release: &Release<'_>,
    ) -> Vec<LoadFault> {
        let instants = &self.observation.instants;
        let Some(row) = self.observation.force_row() else { return Vec::new() };
        let mut faults = Vec::new();
        let mut add = |unknown: Option<OneMore>, text: &dyn Fn(&OneMore) -> String| {
            let asked = unknown.filter(OneMore::contradicts);
            faults.extend(asked.map(|unknown| LoadFault { text: text(&unknown), gain: unknown.gain }));
        };
        let of_force = |k: usize, force: f64| self.observation.column(instants[k].index, |_, _| 0.0, |_| force);
        let force = |k: usize| width_mm * by_width[k][(row, 0)];
        let zero: Vec<Dense> = (0..instants.len()).map(|k| of_force(k, 1.0)).collect();
        // What is measured is the computed force and the zero.
        add(release(&zero, &|_| false, 0.0), &|u| {
            format!("a load cell whose zero is {:+.4} +- {:.2} N", u.value, u.std)
        });
        let slope = |k: usize| {
            let (low, high) = (k.saturating_sub(1), (k + 1).min(instants.len() - 1));
            let apart = instants[high].index - instants[low].index;
            if apart == 0 { 0.0 } else { (force(high) - force(low)) / apart as f64 }
        };
        let later: Vec<Dense> = (0..instants.len()).map(|k| of_force(k, slope(k))).collect();
        add(release(&later, &|_| false, 0.0), &|u| {
            let way = if u.value > 0.0 { "later" } else { "earlier" };
            format!("loads of {:.3} +- {:.2} instants {way} than the images", u.value.abs(), u.std)
        });
        for effect in effects.iter().filter(|effect| matches!(effect.constant.kind, ConstantKind::Material { .. })) {
            let own = |kind: &ConstantKind| *kind == effect.constant.kind;
            // One is its standard uncertainty.
            let unknown = release(&effect.rows, &own, 1.0);
            add(unknown, &|u| {
                let constant = &effect.constant;
                format!("{} off by {:+.4} {}", constant.name, u.value * constant.std, constant.unit)
            });
        }
        faults
    }
}
