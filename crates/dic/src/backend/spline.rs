//! Weights of the sub-pixel interpolations, their derivative at the pixels, and the start of their prefilter.

use crate::imaging::Interpolation;
use crate::isa::mul_add;

/// An interpolation with `K` taps per axis; the taps start `K / 2 - 1` pixels before the floor.
pub(super) trait Spline<const K: usize>: Copy + Send + Sync {
    /// Weights of the taps at the fractions `t` (0..1) of `L` points.
    fn weights<const FMA: bool, const L: usize>(t: &[f32; L]) -> [[f32; L]; K];
}

/// Cubic B-spline.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cubic;

/// Quintic B-spline.
#[derive(Debug, Clone, Copy)]
pub(super) struct Quintic;

/// Keys' cubic convolution, a = -1/2 (Keys 1981).
#[derive(Debug, Clone, Copy)]
pub(super) struct Keys;

/// Bilinear.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bilinear;

impl Spline<4> for Cubic {
    #[inline(always)]
    fn weights<const FMA: bool, const L: usize>(t: &[f32; L]) -> [[f32; L]; 4] {
        let mut w = [[0.0; L]; 4];
        for i in 0..L {
            let t = t[i];
            let s = 1.0 - t;
            let (t2, s2) = (t * t, s * s);
            w[0][i] = s2 * s * (1.0 / 6.0);
            w[1][i] = mul_add::<FMA>(t2, mul_add::<FMA>(t, 0.5, -1.0), 2.0 / 3.0);
            w[2][i] = mul_add::<FMA>(s2, mul_add::<FMA>(s, 0.5, -1.0), 2.0 / 3.0);
            w[3][i] = t2 * t * (1.0 / 6.0);
        }
        w
    }
}

impl Spline<6> for Quintic {
    #[inline(always)]
    fn weights<const FMA: bool, const L: usize>(t: &[f32; L]) -> [[f32; L]; 6] {
        let mut w = [[0.0; L]; 6];
        for i in 0..L {
            let t = t[i];
            let s = 1.0 - t;
            let (t2, s2) = (t * t, s * s);
            w[0][i] = s2 * s2 * s * (1.0 / 120.0);
            w[5][i] = t2 * t2 * t * (1.0 / 120.0);
            // beta5(1 + t): the ring between one and two pixels from the knot.
            let ring = |t: f32, t2: f32| {
                let a = mul_add::<FMA>(t, 5.0 / 120.0, -20.0 / 120.0);
                let b = mul_add::<FMA>(t2, a, 20.0 / 120.0 * t + 20.0 / 120.0);
                mul_add::<FMA>(t2, b, mul_add::<FMA>(t, -50.0 / 120.0, 26.0 / 120.0))
            };
            // beta5(t): within one pixel.
            let core = |t: f32, t2: f32| {
                let a = mul_add::<FMA>(t, -10.0 / 120.0, 30.0 / 120.0);
                mul_add::<FMA>(t2, mul_add::<FMA>(t2, a, -60.0 / 120.0), 66.0 / 120.0)
            };
            w[1][i] = ring(t, t2);
            w[2][i] = core(t, t2);
            w[3][i] = core(s, s2);
            w[4][i] = ring(s, s2);
        }
        w
    }
}

impl Spline<4> for Keys {
    #[inline(always)]
    fn weights<const FMA: bool, const L: usize>(t: &[f32; L]) -> [[f32; L]; 4] {
        let mut w = [[0.0; L]; 4];
        for i in 0..L {
            let t = t[i];
            let s = 1.0 - t;
            let (t2, s2) = (t * t, s * s);
            w[0][i] = -0.5 * t * s2;
            w[1][i] = mul_add::<FMA>(t2, mul_add::<FMA>(1.5, t, -2.5), 1.0);
            w[2][i] = mul_add::<FMA>(s2, mul_add::<FMA>(1.5, s, -2.5), 1.0);
            w[3][i] = -0.5 * s * t2;
        }
        w
    }
}

impl Spline<2> for Bilinear {
    #[inline(always)]
    fn weights<const FMA: bool, const L: usize>(t: &[f32; L]) -> [[f32; L]; 2] {
        [t.map(|t| 1.0 - t), *t]
    }
}

/// Weights of the taps at the fraction `t` (0..1), and how many there are; they start that half less one pixels before
/// the floor.
#[inline]
pub(crate) fn taps(interpolation: Interpolation, t: f32) -> ([f32; 6], usize) {
    fn of<S: Spline<K>, const K: usize>(t: f32) -> ([f32; 6], usize) {
        let mut taps = [0.0; 6];
        taps.iter_mut().zip(S::weights::<false, 1>(&[t])).for_each(|(tap, weight)| *tap = weight[0]);
        (taps, K)
    }
    match interpolation {
        Interpolation::Cubic => of::<Cubic, 4>(t),
        Interpolation::Quintic => of::<Quintic, 6>(t),
        Interpolation::Keys => of::<Keys, 4>(t),
        Interpolation::Bilinear => of::<Bilinear, 2>(t),
    }
}

/// Weights, on the coefficients of [`Interpolation::of_gradient`] one pixel before to one after, of the value and of the
/// derivative at a pixel.
pub(crate) fn at_pixel(interpolation: Interpolation) -> ([f32; 3], [f32; 3]) {
    let value = match interpolation.of_gradient() {
        Interpolation::Cubic | Interpolation::Quintic => [1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0],
        // The derivative of Keys' kernel at a pixel is the central difference; bilinear has none, and takes the same.
        Interpolation::Keys | Interpolation::Bilinear => [0.0, 1.0, 0.0],
    };
    (value, [-0.5, 0.0, 0.5])
}

/// Weights of the samples in the first causal value, `sum_k z^k s(-k)` of the signal continued through its
/// end samples, `s(-k) = 2 s(0) - s(k)`; exact but for powers of the pole below f32. A single sample is a constant,
/// which no filter changes.
pub(super) fn causal_start(pole: f64, n: usize) -> Vec<f32> {
    if n < 2 {
        return vec![1.0; n];
    }
    let horizon = (1e-10f64.ln() / pole.abs().ln()).ceil() as isize;
    let last = n as isize - 1;
    let mut weights = vec![0.0; n.min(horizon as usize + 1)];
    // A signal shorter than the horizon is continued through both ends in turn.
    weights.resize(if last < horizon { n } else { weights.len() }, 0.0);
    for k in 0..=horizon {
        let (mut at, mut sign, power) = (-k, 1.0, pole.powi(k as i32));
        while !(0..=last).contains(&at) {
            let (end, through) = if at < 0 { (0, 0) } else { (n - 1, 2 * last) };
            weights[end] += 2.0 * sign * power;
            sign = -sign;
            at = through - at;
        }
        weights[at as usize] += sign * power;
    }
    weights.into_iter().map(|w| w as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// beta_n(x) by its truncated-power sum (Schoenberg 1946), in f64.
    fn b_spline(degree: i32, x: f64) -> f64 {
        let (mut sum, mut binomial, mut factorial) = (0.0, 1.0, 1.0);
        for k in 1..=degree {
            factorial *= f64::from(k);
        }
        for k in 0..=degree + 1 {
            let y = x + f64::from(degree + 1) / 2.0 - f64::from(k);
            sum += binomial * if y > 0.0 { y.powi(degree) } else { 0.0 };
            binomial *= -f64::from(degree + 1 - k) / f64::from(k + 1);
        }
        sum / factorial
    }

    fn check<S: Spline<K>, const K: usize>(degree: i32) {
        for step in 0..=20 {
            let t = f64::from(step) / 20.0;
            let w = S::weights::<false, 1>(&[t as f32]);
            for (k, w) in w.iter().enumerate() {
                let want = b_spline(degree, t - (k as f64 - (K / 2 - 1) as f64));
                assert!((f64::from(w[0]) - want).abs() < 2e-7, "degree {degree}, t {t}, tap {k}: {} {want}", w[0]);
            }
        }
    }

    #[test]
    fn weights_are_the_b_splines_of_their_degree() {
        check::<Cubic, 4>(3);
        check::<Quintic, 6>(5);
        check::<Bilinear, 2>(1);
    }

    #[test]
    fn keys_weights_reproduce_a_parabola() {
        for step in 0..=10 {
            let t = step as f32 / 10.0;
            let w = Keys::weights::<false, 1>(&[t]);
            let at = |k: f32| 2.0 + 0.5 * k - k * k;
            let got: f32 = (0..4).map(|k| w[k][0] * at(k as f32 - 1.0)).sum();
            assert!((got - at(t)).abs() < 1e-5, "t {t}: {got} instead of {}", at(t));
        }
    }

    #[test]
    fn value_and_derivative_at_a_pixel_are_those_of_the_cubic_spline() {
        for interpolation in [Interpolation::Cubic, Interpolation::Quintic] {
            let (value, derivative) = at_pixel(interpolation);
            for k in 0..3 {
                let x = 1.0 - k as f64; // the pixel seen from tap k
                let h = 1e-4; // truncation h^2, round-off 1e-16 / h: both far below f32
                let slope = (b_spline(3, x + h) - b_spline(3, x - h)) / (2.0 * h);
                assert!((f64::from(value[k]) - b_spline(3, x)).abs() < 1e-7);
                assert!((f64::from(derivative[k]) - slope).abs() < 1e-7, "{k} {slope}");
            }
        }
    }
}
