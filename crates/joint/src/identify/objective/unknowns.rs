//! The parameters that are fitted, their bounds, and their scale.

use crate::identify::FitError;
use crate::mechanics::cohesive::{CohesiveLaw, LawError, LawLimit, Parameter};
use crate::mechanics::substrate::{SubstrateError, SubstrateLaw};
use crate::mechanics::{Instant, Sensitivity, Solution};
use std::sync::Arc;

/// How a parameter is scaled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Scale {
    /// `z = ln x`: of parameters that are positive by their nature.
    Logarithm,
    /// `z = x / reference`: of those that may be zero.
    Reference(f64),
    /// `z = ln(1 + (1 + x)/(2 (1 - x)))`: of shares that may be zero and never one. Of the plateau of a trapezoid it is
    /// the logarithm of what the falling branch needs, so that the end of that law is straight in scaled unknowns.
    Share,
}

impl Scale {
    fn scaled(self, x: f64) -> f64 {
        match self {
            Self::Logarithm => x.ln(),
            Self::Reference(reference) => x / reference,
            Self::Share => (0.5 * (3.0 - x) / (1.0 - x)).ln(),
        }
    }

    /// `x` at `z`.
    pub fn unscaled(self, z: f64) -> f64 {
        match self {
            Self::Logarithm => z.exp(),
            Self::Reference(reference) => z * reference,
            Self::Share => 1.0 - 2.0 / (2.0 * z.exp() - 1.0),
        }
    }

    /// `dx/dz` at `x`.
    pub fn slope(self, x: f64) -> f64 {
        match self {
            Self::Logarithm => x,
            Self::Reference(reference) => reference,
            Self::Share => 0.5 * (3.0 - x) * (1.0 - x),
        }
    }
}

/// A parameter that is fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unknown {
    /// The parameter.
    pub parameter: Parameter,
    /// Its place among the parameters of the law, or behind them that among the fitted ones of materials.
    pub index: usize,
    /// Where the fit starts.
    pub start: f64,
    /// Its bounds.
    pub bounds: [f64; 2],
    /// Its scale.
    pub scale: Scale,
}

/// A parameter of the material of groups of elements, which share its value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OfMaterial {
    /// The groups.
    pub groups: Vec<usize>,
    /// Its place among the parameters of their material.
    pub index: usize,
}

/// Which parameters of a law, and of the materials beside it, are fitted; the others keep their values.
#[derive(Debug)]
pub struct Unknowns {
    law: Box<dyn CohesiveLaw>,
    list: Vec<Unknown>,
    /// One material for each group of elements; none where no parameter of theirs is fitted.
    materials: Vec<Arc<dyn SubstrateLaw>>,
    of_materials: Vec<OfMaterial>,
}

/// Without given bounds a parameter may move by this factor either way.
pub const WIDE: f64 = 1e3;

/// A parameter to be fitted: its index as of [`Unknown`], start, lower and upper bound.
pub type Asked = (usize, f64, Option<f64>, Option<f64>);

impl Unknowns {
    /// The unknowns of `list`, all of them parameters of `law`; where there is no bound, the start times or over
    /// [`WIDE`]. No bound lies outside the range of the law.
    ///
    /// # Errors
    /// A start that the law does not allow.
    pub fn new(law: &dyn CohesiveLaw, list: &[Asked]) -> Result<Self, FitError> {
        Self::with_materials(law, &[], Vec::new(), list)
    }

    /// The same with parameters of the `materials` of the groups of elements among them.
    ///
    /// # Errors
    /// A start that law or material does not allow.
    pub fn with_materials(
        law: &dyn CohesiveLaw,
        materials: &[Arc<dyn SubstrateLaw>],
        of_materials: Vec<OfMaterial>,
        list: &[Asked],
    ) -> Result<Self, FitError> {
        let n_law = law.parameters().len();
        let (mut values, mut materials) = (law.values(), materials.to_vec());
        for &(index, start, ..) in list {
            match index.checked_sub(n_law) {
                None => values[index] = start,
                Some(k) => set(&mut materials, &of_materials[k], start)?,
            }
        }
        let law = law.with_values(&values)?;
        let unknown = |&(index, start, lower, upper): &Asked| {
            if let Some(k) = index.checked_sub(n_law) {
                return unknown_of_material(&materials, &of_materials[k], (index, start, lower, upper));
            }
            let mut zero = values.clone();
            zero[index] = 0.0;
            let [least, most] = law.range(index);
            let scale = match law.with_values(&zero) {
                Ok(_) if [least, most] == [0.0, 1.0] => Scale::Share,
                Ok(_) => Scale::Reference(start.abs().max(0.1)),
                Err(_) => Scale::Logarithm,
            };
            let wide = match scale {
                Scale::Logarithm => [start / WIDE, start * WIDE],
                Scale::Reference(_) => [0.0, start.abs().max(0.1) * WIDE],
                Scale::Share => [0.0, scale.unscaled(scale.scaled(start) + WIDE.ln())],
            };
            let bounds = [lower.unwrap_or(wide[0]).max(least), upper.unwrap_or(wide[1]).min(most)];
            Unknown { parameter: law.parameters()[index], index, start, bounds, scale }
        };
        Ok(Self { list: list.iter().map(unknown).collect(), law, materials, of_materials })
    }

    /// The unknowns of `list` beside the parameters of `law`, of the same materials.
    ///
    /// # Errors
    /// As [`Unknowns::with_materials`].
    pub fn of_list(&self, law: &dyn CohesiveLaw, list: &[Asked]) -> Result<Self, FitError> {
        Self::with_materials(law, &self.materials, self.of_materials.clone(), list)
    }

    /// The same without the parameter `index`, which gets the value `x`.
    ///
    /// # Errors
    /// A value that law or material does not allow.
    pub fn with_prescribed(&self, index: usize, x: f64) -> Result<Self, FitError> {
        let (mut values, mut materials) = (self.law.values(), self.materials.clone());
        match index.checked_sub(values.len()) {
            None => values[index] = x,
            Some(k) => set(&mut materials, &self.of_materials[k], x)?,
        }
        let law = self.law.with_values(&values)?;
        let list = self.list.iter().copied().filter(|unknown| unknown.index != index).collect();
        Ok(Self { law, list, materials, of_materials: self.of_materials.clone() })
    }

    /// The same that start at `x`.
    ///
    /// # Errors
    /// Values that law or material does not allow.
    pub fn starting_at(&self, x: &[f64]) -> Result<Self, FitError> {
        let mut list = self.list.clone();
        list.iter_mut().zip(x).for_each(|(unknown, &x)| unknown.start = x);
        let materials = self.materials_at(x)?.unwrap_or_default();
        Ok(Self { law: self.law_at(x)?, list, materials, of_materials: self.of_materials.clone() })
    }

    /// The unknowns.
    pub fn list(&self) -> &[Unknown] {
        &self.list
    }

    /// How many.
    pub fn n(&self) -> usize {
        self.list.len()
    }

    /// The law at the start.
    pub fn law(&self) -> &dyn CohesiveLaw {
        &*self.law
    }

    /// The law with the unknowns at `x`.
    ///
    /// # Errors
    /// Values that the law does not allow.
    pub fn law_at(&self, x: &[f64]) -> Result<Box<dyn CohesiveLaw>, LawError> {
        let mut values = self.law.values();
        for (unknown, &x) in self.list.iter().zip(x) {
            values.get_mut(unknown.index).into_iter().for_each(|value| *value = x);
        }
        self.law.with_values(&values)
    }

    /// The fitted parameters of materials, which lie behind those of the law.
    pub fn of_materials(&self) -> &[OfMaterial] {
        &self.of_materials
    }

    /// The materials of all groups with the unknowns at `x`; `None` where no parameter of theirs is one.
    ///
    /// # Errors
    /// Values that a material does not allow.
    pub fn materials_at(&self, x: &[f64]) -> Result<Option<Vec<Arc<dyn SubstrateLaw>>>, SubstrateError> {
        if self.of_materials.is_empty() {
            return Ok(None);
        }
        let (n_law, mut materials) = (self.law.parameters().len(), self.materials.clone());
        for (unknown, &x) in self.list.iter().zip(x) {
            if let Some(k) = unknown.index.checked_sub(n_law) {
                set(&mut materials, &self.of_materials[k], x)?;
            }
        }
        Ok(Some(materials))
    }

    /// Brings the sensitivities of `solution`, by the law and by all parameters of all materials, to the order of the
    /// unknowns' indices.
    pub(crate) fn gather(&self, solution: &mut Solution) {
        let n_law = self.law.parameters().len();
        if self.of_materials.is_empty() {
            return;
        }
        let n_parameters = |group: usize| self.materials[group].parameters().len();
        let place = |group: usize, index: usize| n_law + (0..group).map(n_parameters).sum::<usize>() + index;
        for Instant { sensitivities, .. } in &mut solution.instants {
            if sensitivities.is_empty() {
                continue;
            }
            for OfMaterial { groups, index } in &self.of_materials {
                let mut sum = vec![[0.0; 2]; sensitivities[0].len()];
                for &group in groups {
                    let by = &sensitivities[place(group, *index)];
                    sum.iter_mut().zip(by).for_each(|(sum, by)| (0..2).for_each(|c| sum[c] += by[c]));
                }
                sensitivities.push(sum);
            }
            sensitivities.drain(n_law..place(self.materials.len(), 0));
        }
        let by_material = |of: &OfMaterial| Sensitivity {
            parameter: self.materials[of.groups[0]].parameters()[of.index],
            group: Some(of.groups[0]),
        };
        solution.parameters.truncate(n_law);
        solution.parameters.extend(self.of_materials.iter().map(by_material));
    }

    /// The scaled unknowns.
    pub fn scaled(&self, x: &[f64]) -> Vec<f64> {
        self.list.iter().zip(x).map(|(unknown, &x)| unknown.scale.scaled(x)).collect()
    }

    /// The parameters, never outside their bounds, and exactly on a bound where `z` is.
    pub fn unscaled(&self, z: &[f64]) -> Vec<f64> {
        let value = |(unknown, &z): (&Unknown, &f64)| {
            let [lower, upper] = unknown.bounds;
            match () {
                () if z <= unknown.scale.scaled(lower) => lower,
                () if z >= unknown.scale.scaled(upper) => upper,
                () => unknown.scale.unscaled(z).clamp(lower, upper),
            }
        };
        self.list.iter().zip(z).map(value).collect()
    }

    /// `dx/dz` of each.
    pub fn slopes(&self, x: &[f64]) -> Vec<f64> {
        self.list.iter().zip(x).map(|(unknown, &x)| unknown.scale.slope(x)).collect()
    }

    /// Where the law ends near `x`, with the derivatives by the scaled unknowns; only what they can change.
    pub fn limits(&self, x: &[f64]) -> Vec<LawLimit> {
        let Ok(law) = self.law_at(x) else { return Vec::new() };
        let slopes = self.slopes(x);
        let of_unknowns = |limit: LawLimit| LawLimit {
            by: (self.list.iter().zip(&slopes))
                .map(|(unknown, slope)| slope * limit.by.get(unknown.index).copied().unwrap_or(0.0))
                .collect(),
            ..limit
        };
        law.limits().into_iter().map(of_unknowns).filter(|limit| limit.by.iter().any(|by| *by != 0.0)).collect()
    }

    /// The distances of [`Self::limits`] at scaled unknowns, with their derivatives.
    pub fn scaled_limits(&self, z: &[f64]) -> Vec<(f64, Vec<f64>)> {
        self.limits(&self.unscaled(z)).into_iter().map(|limit| (limit.distance, limit.by)).collect()
    }

    /// The starts.
    pub fn start(&self) -> Vec<f64> {
        self.list.iter().map(|unknown| unknown.start).collect()
    }

    /// Scaled bounds, lower and upper.
    pub fn scaled_bounds(&self) -> [Vec<f64>; 2] {
        [0, 1].map(|side| self.list.iter().map(|unknown| unknown.scale.scaled(unknown.bounds[side])).collect())
    }
}

/// Gives a parameter of materials the value `x`.
fn set(materials: &mut [Arc<dyn SubstrateLaw>], of: &OfMaterial, x: f64) -> Result<(), SubstrateError> {
    for &group in &of.groups {
        let mut values = materials[group].values();
        values[of.index] = x;
        materials[group] = Arc::from(materials[group].with_values(&values)?);
    }
    Ok(())
}

/// Bounds of a ratio that may have either sign: Poisson's.
const RATIO: [f64; 2] = [-0.95, 0.495];

/// A parameter of materials that start with it as asked.
fn unknown_of_material(
    materials: &[Arc<dyn SubstrateLaw>],
    of: &OfMaterial,
    (index, start, lower, upper): Asked,
) -> Unknown {
    let material = &materials[of.groups[0]];
    let allows = |x: f64| {
        let mut values = material.values();
        values[of.index] = x;
        material.with_values(&values).is_ok()
    };
    let size = start.abs().max(0.1);
    let (scale, wide) = match (allows(0.0), allows(1.0)) {
        (false, _) => (Scale::Logarithm, [start / WIDE, start * WIDE]),
        (true, false) => (Scale::Reference(size), RATIO),
        (true, true) => (Scale::Reference(size), [if allows(-1.0) { -WIDE * size } else { 0.0 }, WIDE * size]),
    };
    let bounds = [lower.unwrap_or(wide[0]), upper.unwrap_or(wide[1])];
    Unknown { parameter: material.parameters()[of.index], index, start, bounds, scale }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mechanics::cohesive::law_by_name;

    #[test]
    fn every_scale_leads_back_and_has_the_slope_of_its_difference() {
        for (scale, x) in
            [(Scale::Logarithm, 3.0), (Scale::Reference(0.3), 0.0), (Scale::Share, 0.0), (Scale::Share, 0.7)]
        {
            let (z, h) = (scale.scaled(x), 1e-6);
            assert!((scale.unscaled(z) - x).abs() < 1e-15 + 1e-15 * x, "{scale:?}");
            // Truncation h^2, round-off 1e-16/h.
            let difference = (scale.unscaled(z + h) - scale.unscaled(z - h)) / (2.0 * h);
            assert!((scale.slope(x) - difference).abs() < 1e-9 * (1.0 + x), "{scale:?}: {difference}");
        }
    }

    /// In opening and in sliding: the distance is `ln(2 G K/T^2)` less the scaled share.
    #[test]
    fn the_end_of_a_trapezoid_is_straight_in_scaled_unknowns() {
        let law = law_by_name("trapezoidal-power", &[2e4, 50.0, 50.0, 1.0, 4.0, 1.0, 0.4]).unwrap();
        let list: Vec<_> = law.values().into_iter().enumerate().map(|(k, value)| (k, value, None, None)).collect();
        let unknowns = Unknowns::new(&*law, &list).unwrap();
        let z = unknowns.scaled(&unknowns.start());
        let step = [0.2, -0.1, 0.15, 0.1, -0.2, 0.0, 0.3];
        let there: Vec<f64> = z.iter().zip(step).map(|(z, step)| z + step).collect();
        for mode in 0..2 {
            let (distance, by) = &unknowns.scaled_limits(&z)[mode];
            let predicted = distance + by.iter().zip(step).map(|(by, step)| by * step).sum::<f64>();
            assert!((unknowns.scaled_limits(&there)[mode].0 - predicted).abs() < 1e-12, "mode {mode}");
        }
    }
}
