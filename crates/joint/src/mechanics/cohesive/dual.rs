//! Numbers that carry their derivatives: a law written once in them has an exact tangent and exact parameter
//! derivatives.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// A value and its derivatives by `N` variables.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dual<const N: usize> {
    /// The value.
    pub value: f64,
    /// Its derivative by each variable.
    pub by: [f64; N],
}

impl<const N: usize> Dual<N> {
    /// A constant.
    pub fn constant(value: f64) -> Self {
        Self { value, by: [0.0; N] }
    }

    /// The variable number `k`.
    pub fn variable(value: f64, k: usize) -> Self {
        let mut by = [0.0; N];
        by[k] = 1.0;
        Self { value, by }
    }

    /// `f(self)` from its value and its slope.
    fn chain(self, value: f64, slope: f64) -> Self {
        Self { value, by: self.by.map(|by| slope * by) }
    }

    /// `exp(self)`.
    pub fn exp(self) -> Self {
        let value = self.value.exp();
        self.chain(value, value)
    }

    /// `1 - exp(-self)`, exact for small numbers.
    pub fn one_minus_exp_minus(self) -> Self {
        self.chain(-(-self.value).exp_m1(), (-self.value).exp())
    }

    /// The natural logarithm of a positive number.
    pub fn ln(self) -> Self {
        self.chain(self.value.ln(), 1.0 / self.value)
    }

    /// The square root of a positive number.
    pub fn sqrt(self) -> Self {
        let value = self.value.sqrt();
        self.chain(value, 0.5 / value)
    }

    /// `self^2`.
    pub fn squared(self) -> Self {
        self.chain(self.value * self.value, 2.0 * self.value)
    }

    /// `self^exponent` for a positive base, or for the base zero and an exponent of one or more.
    pub fn pow(self, exponent: Self) -> Self {
        if self.value == 0.0 {
            // The limit: ln(0) must not be formed.
            return self.chain(0.0, if exponent.value == 1.0 { 1.0 } else { 0.0 });
        }
        let value = self.value.powf(exponent.value);
        let (by_base, by_exponent) = (value * exponent.value / self.value, value * self.value.ln());
        Self { value, by: std::array::from_fn(|k| by_base * self.by[k] + by_exponent * exponent.by[k]) }
    }
}

impl<const N: usize> Add for Dual<N> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self { value: self.value + other.value, by: std::array::from_fn(|k| self.by[k] + other.by[k]) }
    }
}

impl<const N: usize> Sub for Dual<N> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl<const N: usize> Neg for Dual<N> {
    type Output = Self;
    fn neg(self) -> Self {
        self.chain(-self.value, -1.0)
    }
}

impl<const N: usize> Mul for Dual<N> {
    type Output = Self;
    #[allow(clippy::suspicious_arithmetic_impl, reason = "the product rule adds")]
    fn mul(self, other: Self) -> Self {
        let by = std::array::from_fn(|k| self.by[k] * other.value + self.value * other.by[k]);
        Self { value: self.value * other.value, by }
    }
}

impl<const N: usize> Div for Dual<N> {
    type Output = Self;
    #[allow(clippy::suspicious_arithmetic_impl, reason = "the quotient rule subtracts")]
    fn div(self, other: Self) -> Self {
        let value = self.value / other.value;
        Self { value, by: std::array::from_fn(|k| (self.by[k] - value * other.by[k]) / other.value) }
    }
}

impl<const N: usize> Mul<Dual<N>> for f64 {
    type Output = Dual<N>;
    fn mul(self, other: Dual<N>) -> Dual<N> {
        other.chain(self * other.value, self)
    }
}

#[cfg(test)]
mod tests {
    use super::Dual;

    #[test]
    fn every_operation_has_the_slope_of_its_central_difference() {
        type D = Dual<1>;
        let operations: [fn(D) -> D; 10] = [
            |x| x.exp(),
            |x| x.one_minus_exp_minus(),
            |x| x.sqrt(),
            |x| x.ln(),
            |x| x.squared(),
            |x| x.pow(D::constant(2.3)),
            |x| D::constant(2.3).pow(x),
            |x| x * x + 3.0 * x,
            |x| D::constant(1.0) / x - x,
            |x| -x.pow(x),
        ];
        for (k, operation) in operations.iter().enumerate() {
            let (x, h) = (1.7, 1e-6);
            let want = (operation(D::constant(x + h)).value - operation(D::constant(x - h)).value) / (2.0 * h);
            let slope = operation(D::variable(x, 0)).by[0];
            assert!((slope - want).abs() < 1e-8 * (1.0 + want.abs()), "operation {k}: {slope} for {want}");
        }
    }

    #[test]
    fn powers_of_zero_have_their_limits() {
        let zero = Dual::<1>::variable(0.0, 0);
        assert_eq!(zero.pow(Dual::constant(1.0)), zero);
        assert_eq!(zero.pow(Dual::constant(1.5)), Dual::constant(0.0));
    }
}
