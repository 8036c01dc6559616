//! The parameters that are fitted, their bounds, and their scale.

use crate::mechanics::cohesive::{CohesiveLaw, LawError, LawLimit, Parameter};

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

/// A parameter to be fitted: its index in the law, start, lower and upper bound.
pub type Asked = (usize, f64, Option<f64>, Option<f64>);

impl Unknowns {
    /// The unknowns of `list`; where there is no bound, the start times or over
    /// [`WIDE`]. No bound lies outside the range of the law.
    ///
    /// # Errors
    /// A start that the law does not allow.
    pub fn new(law: &dyn CohesiveLaw, list: &[Asked]) -> Result<Self, LawError> {
        let mut values = law.values();
        list.iter().for_each(|&(index, start, ..)| values[index] = start);
        let law = law.with_values(&values)?;
        let unknown = |&(index, start, lower, upper): &Asked| {
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
