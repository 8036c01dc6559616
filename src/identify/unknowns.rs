//! The parameters that are fitted, their bounds, and their scale.

use crate::mechanics::cohesive::{CohesiveLaw, LawError, LawLimit, Parameter};

/// How a parameter is scaled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Scale {
    /// `z = ln x`: of parameters that are positive by their nature.
    Logarithm,
    /// `z = x / reference`: of those that may be zero.
    Reference(f64),
}

impl Scale {
    fn scaled(self, x: f64) -> f64 {
        match self {
            Self::Logarithm => x.ln(),
            Self::Reference(reference) => x / reference,
        }
    }

    /// `x` at `z`.
    pub fn unscaled(self, z: f64) -> f64 {
        match self {
            Self::Logarithm => z.exp(),
            Self::Reference(reference) => z * reference,
        }
    }

    /// `dx/dz` at `x`.
    pub fn slope(self, x: f64) -> f64 {
        match self {
            Self::Logarithm => x,
            Self::Reference(reference) => reference,
        }
    }
}

/// A parameter that is fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unknown {
    /// The parameter.
    pub parameter: Parameter,
    /// Its place among the parameters of the law.
    pub index: usize,
    /// Where the fit starts.
    pub start: f64,
    /// Its bounds.
    pub bounds: [f64; 2],
    /// Its scale.
    pub scale: Scale,
}

/// Which parameters of a law are fitted; the others keep their values.
#[derive(Debug)]
pub struct Unknowns {
    law: Box<dyn CohesiveLaw>,
    list: Vec<Unknown>,
}

/// Without given bounds a parameter may move by this factor either way.
pub const WIDE: f64 = 1e3;

impl Unknowns {
    /// The unknowns `(index in the law, start, lower, upper)`; where there is no bound, the start times or over
    /// [`WIDE`]. No bound lies outside the range of the law.
    ///
    /// # Errors
    /// A start that the law does not allow.
    pub fn new(law: &dyn CohesiveLaw, list: &[(usize, f64, Option<f64>, Option<f64>)]) -> Result<Self, LawError> {
        let mut values = law.values();
        list.iter().for_each(|&(index, start, ..)| values[index] = start);
        let law = law.with_values(&values)?;
        let unknown = |&(index, start, lower, upper): &(usize, f64, Option<f64>, Option<f64>)| {
            let mut zero = values.clone();
            zero[index] = 0.0;
            let scale = match law.with_values(&zero) {
                Ok(_) => Scale::Reference(start.abs().max(0.1)),
                Err(_) => Scale::Logarithm,
            };
            let wide = match scale {
                Scale::Logarithm => [start / WIDE, start * WIDE],
                Scale::Reference(_) => [0.0, start.abs().max(0.1) * WIDE],
            };
            let [least, most] = law.range(index);
            let bounds = [lower.unwrap_or(wide[0]).max(least), upper.unwrap_or(wide[1]).min(most)];
            Unknown { parameter: law.parameters()[index], index, start, bounds, scale }
        };
        Ok(Self { list: list.iter().map(unknown).collect(), law })
    }

    /// The same without those of the law's parameter `index`, which gets the value `x`.
    ///
    /// # Errors
    /// A value that the law does not allow.
    pub fn with_prescribed(&self, index: usize, x: f64) -> Result<Self, LawError> {
        let mut values = self.law.values();
        values[index] = x;
        let law = self.law.with_values(&values)?;
        let list = self.list.iter().copied().filter(|unknown| unknown.index != index).collect();
        Ok(Self { law, list })
    }

    /// The same that start at `x`.
    ///
    /// # Errors
    /// Values that the law does not allow.
    pub fn starting_at(&self, x: &[f64]) -> Result<Self, LawError> {
        let mut list = self.list.clone();
        list.iter_mut().zip(x).for_each(|(unknown, &x)| unknown.start = x);
        Ok(Self { law: self.law_at(x)?, list })
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
        self.list.iter().zip(x).for_each(|(unknown, &x)| values[unknown.index] = x);
        self.law.with_values(&values)
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
            by: self.list.iter().zip(&slopes).map(|(unknown, slope)| slope * limit.by[unknown.index]).collect(),
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
