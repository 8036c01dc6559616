//! What a fit prescribes at the border: the displacements as measured, or smooth fields with fewer coefficients than
//! components (THEORY 7). Noise of the border acts through plasticity; smoothing removes most of it.

use crate::identify::doubt::remarks::border_not_smooth;
use crate::identify::{FALSE_REJECTIONS, NOISE_LEVEL_STD, Noise, Observation, as_normal, normal_tail};
use crate::linalg::{Dense, DenseCholesky};
use crate::mechanics::{BoundaryHistory, Joint};
use crate::remark::Remark;
use std::borrow::Cow;
use std::collections::HashMap;

/// Degrees along and across the joint that a smooth border may have, rising.
const DEGREES: [[usize; 2]; 5] = [[4, 2], [6, 3], [8, 3], [10, 4], [12, 5]];
/// What each coefficient that a free border has more must take off `chi^2` (Akaike), or smoothing predicts better.
const PRICE: f64 = 2.0;
/// Share of a column of the basis that has to be new, beside those before it.
const NEW: f64 = 1e-3;

/// The border that a fit prescribes.
#[derive(Debug)]
pub struct Border {
    /// Displacements of the model's prescribed nodes at every instant.
    pub boundary: BoundaryHistory,
    /// `None` where it is free: as measured, every component its own coefficient.
    pub smooth: Option<Smooth>,
}

/// A border of smooth fields: on the border of each strip, for each component, products of Legendre polynomials along
/// and across the joint in the box of that strip.
#[derive(Debug)]
pub struct Smooth {
    /// Degrees along and across.
    pub degrees: [usize; 2],
    /// `chi^2` of what is left of the measured border, in units of its noise, over all instants compared.
    pub chi2: f64,
    /// Its expectation: components less coefficients, over all instants compared.
    pub freedom: f64,
    /// `B`: components of the prescribed nodes of the measured mesh by coefficients, with orthonormal columns.
    basis: Dense,
    /// `G = (B^T P B)^-1 B^T P`, `P` the inverse covariance of the border's components: coefficients by components.
    estimate: Dense,
}

impl Smooth {
    /// Coefficients of an instant.
    pub fn n_coefficients(&self) -> usize {
        self.basis.n_columns()
    }

    /// Components of the border.
    pub fn n_components(&self) -> usize {
        self.basis.n_rows()
    }

    /// The normal deviate of what is left; the noise itself is known to [`NOISE_LEVEL_STD`] only.
    pub fn z(&self) -> f64 {
        let relative = (2.0 / self.freedom).sqrt().hypot(2.0 * NOISE_LEVEL_STD);
        as_normal(self.chi2 / self.freedom, 2.0 / (relative * relative))
    }

    /// The normal deviate of what `higher` degrees take off, by the noise that they leave.
    fn beyond(&self, higher: &Self) -> f64 {
        let (taken, by) = (self.chi2 - higher.chi2, self.freedom - higher.freedom);
        if by <= 0.0 {
            return 0.0;
        }
        let ratio = taken / by * higher.freedom / higher.chi2;
        // A ratio of two variances, either of its degrees of freedom (Paulson 1942).
        let [a, b] = [by, higher.freedom].map(|freedom| 2.0 / (9.0 * freedom));
        let root = ratio.max(0.0).cbrt();
        ((1.0 - b) * root - (1.0 - a)) / (b * root * root + a).sqrt()
    }

    /// Whether noise explains what is left.
    pub fn holds(&self) -> bool {
        self.z() <= normal_tail(FALSE_REJECTIONS)
    }

    /// Root mean square of what is left by that of the noise.
    pub fn ratio(&self) -> f64 {
        (self.chi2 / self.freedom).sqrt()
    }

    /// `B G b` of components at the border.
    fn smoothed(&self, components: &[f64]) -> Vec<f64> {
        let b = Dense::from_fn(components.len(), 1, |row, _| components[row]);
        self.basis.times(&self.estimate.times(&b)).column(0).to_vec()
    }
}

impl Border {
    /// The border of `joint` as measured.
    pub fn free(joint: &Joint) -> Self {
        Self { boundary: joint.boundary.clone(), smooth: None }
    }

    /// The border of `joint` that the data ask for (free where sigma is not known), and what is to be said where what
    /// smoothing leaves is no noise. `forced`: smooth whatever is left.
    pub fn by_evidence(
        joint: &Joint,
        observation: &Observation,
        noise: &Noise,
        forced: bool,
    ) -> (Self, Option<Remark>) {
        let Some(data) = Data::new(joint, observation, noise) else { return (Self::free(joint), None) };
        let fits: Vec<Smooth> = DEGREES.iter().filter_map(|&degrees| data.smooth(joint, degrees)).collect();
        // The lowest degrees from which no higher ones take more than chance.
        let enough =
            |k: usize| fits[k + 1..].iter().all(|higher| fits[k].beyond(higher) < normal_tail(FALSE_REJECTIONS));
        // One step more: what chance hides there may move parameters by most of their standard uncertainty, while its
        // coefficients cost next to nothing.
        let place = (0..fits.len()).find(|&k| enough(k)).map(|k| (k + 1).min(fits.len() - 1));
        let best = place.and_then(|place| fits.into_iter().nth(place));
        let Some(best) = best.filter(|best| forced || best.chi2 < PRICE * best.freedom) else {
            return (Self::free(joint), None);
        };
        let remark = (!best.holds()).then(|| border_not_smooth(best.degrees, best.ratio(), forced));
        match remark.is_none() || forced {
            true => (Self::smoothed(joint, best), remark),
            false => (Self::free(joint), remark),
        }
    }

    fn smoothed(joint: &Joint, smooth: Smooth) -> Self {
        let of_instant = |u: Vec<[f64; 2]>| smooth.smoothed(u.as_flattened()).as_chunks::<2>().0.to_vec();
        let values = prescribed_of(joint, &joint.boundary).into_iter().map(of_instant).collect();
        // As finite as what was measured.
        let boundary = joint.measured.boundary(values).unwrap_or_else(|_| joint.boundary.clone());
        Self { boundary, smooth: Some(smooth) }
    }

    /// Numbers of each instant that smoothing leaves to be compared with the model.
    pub fn n_left(&self) -> usize {
        self.smooth.as_ref().map_or(0, |smooth| smooth.n_components() - smooth.n_coefficients())
    }

    /// Coefficients of an instant, of `joint`.
    pub(crate) fn n_coefficients(&self, joint: &Joint) -> usize {
        self.smooth.as_ref().map_or(2 * joint.measured.prescribed.len(), Smooth::n_coefficients)
    }

    /// Displacements of the prescribed nodes of the measured mesh that the coefficients `c` stand for.
    pub(crate) fn displacements(&self, c: &[f64]) -> Vec<[f64; 2]> {
        let components = match &self.smooth {
            None => Cow::Borrowed(c),
            Some(smooth) => {
                let c = Dense::from_fn(c.len(), 1, |row, _| c[row]);
                Cow::Owned(smooth.basis.times(&c).column(0).to_vec())
            }
        };
        components.as_chunks::<2>().0.to_vec()
    }

    /// What errors of the measured components make of the prescribed ones.
    pub(crate) fn errors(&self, measured: Vec<f64>) -> Vec<f64> {
        match &self.smooth {
            None => measured,
            Some(smooth) => smooth.smoothed(&measured),
        }
    }

    /// Derivatives by the measured components, from those by the coefficients: `T_B G`.
    pub(crate) fn by_measured<'t>(&self, by_coefficients: &'t Dense) -> Cow<'t, Dense> {
        match &self.smooth {
            None => Cow::Borrowed(by_coefficients),
            Some(smooth) => Cow::Owned(by_coefficients.times(&smooth.estimate)),
        }
    }

    /// In words; nothing of a free one.
    pub(crate) fn in_words(&self) -> String {
        let Some(smooth) = &self.smooth else { return String::new() };
        let ([along, across], ratio) = (smooth.degrees, smooth.ratio());
        format!(
            " (smooth, degrees {along} along and {across} across: {} coefficients for {} components, which leaves \
             {ratio:.2} times the noise)",
            smooth.n_coefficients(),
            smooth.n_components()
        )
    }
}

/// The measured border with its noise.
struct Data {
    /// Components by instants compared.
    measured: Dense,
    /// `P`, the inverse covariance of the components of an instant by `sigma^2`.
    precision: Dense,
    /// What all instants have in common.
    common: f64,
    sigma: f64,
}

impl Data {
    /// `None` where the noise is not known or not at the border.
    fn new(joint: &Joint, observation: &Observation, noise: &Noise) -> Option<Self> {
        let rows: Vec<usize> = observation.prescribed.iter().flat_map(|&node| [2 * node, 2 * node + 1]).collect();
        let sigma = noise.sigma.filter(|sigma| *sigma > 0.0 && !rows.is_empty())?;
        let units = Dense::from_fn(noise.precision.n(), rows.len(), |r, c| f64::from(r == rows[c]));
        let covariance = noise.precision.inverse_times(&units);
        let covariance = Dense::from_fn(rows.len(), rows.len(), |r, c| covariance[(rows[r], c)]);
        let precision = covariance.cholesky().ok()?.inverse();
        let all = prescribed_of(joint, &joint.boundary);
        let of_instant = |i: usize, row: usize| all[observation.instants[i].index][row / 2][row % 2];
        let measured = Dense::from_fn(rows.len(), observation.instants.len(), |row, i| of_instant(i, row));
        Some(Self { measured, precision, common: noise.common, sigma })
    }

    /// The border smoothed with these degrees; `None` where that leaves nothing of it free.
    fn smooth(&self, joint: &Joint, degrees: [usize; 2]) -> Option<Smooth> {
        let basis = basis(joint, degrees);
        let (n, n_instants) = (basis.n_rows(), self.measured.n_columns() as f64);
        let freedom = (n - basis.n_columns()) as f64 * n_instants;
        if freedom == 0.0 {
            return None;
        }
        let weighted = self.precision.times(&basis);
        let normal: DenseCholesky = basis.transposed_times(&weighted).cholesky().ok()?;
        let estimate = normal.solve(&Dense::from_fn(weighted.n_columns(), n, |r, c| weighted[(c, r)]));
        let mut left = self.measured.clone();
        left.add(-1.0, &basis.times(&estimate.times(&self.measured)));
        Some(Smooth { degrees, chi2: self.chi2(&left), freedom, basis, estimate })
    }

    /// `sum r^T (I + common 1 1^T)^-1 (x) P r / sigma^2`, in which `(I + c 1 1^T)^-1 = I - c/(1 + m c) 1 1^T`.
    fn chi2(&self, left: &Dense) -> f64 {
        let (n, m) = (left.n_rows(), left.n_columns());
        let square = |x: &Dense| {
            let px = self.precision.times(x);
            (0..x.n_columns())
                .map(|k| x.column(k).iter().zip(px.column(k)).map(|(a, b)| a * b).sum::<f64>())
                .sum::<f64>()
        };
        let sum = Dense::from_fn(n, 1, |row, _| (0..m).map(|i| left[(row, i)]).sum());
        let share = self.common / (1.0 + m as f64 * self.common);
        (square(left) - share * square(&sum)) / (self.sigma * self.sigma)
    }
}

/// `B` for these degrees: its columns are orthonormal; those that the nodes do not tell from others are left out (a
/// border has no inside).
fn basis(joint: &Joint, [along, across]: [usize; 2]) -> Dense {
    let measured = &joint.measured;
    let (nodes, strip) = (measured.mesh.nodes(), measured.mesh.strip());
    let place = |k: usize| nodes[measured.prescribed[k] as usize];
    // The axis that the joint runs along.
    let line = joint.model.pair_positions();
    let extent = |c: usize| range(line.iter().map(|(at, _)| at[c])).1;
    let axes = if extent(0) >= extent(1) { [0, 1] } else { [1, 0] };
    let n = measured.prescribed.len();
    let mut columns: Vec<Vec<f64>> = Vec::new();
    for s in 0..measured.mesh.n_strips() as u32 {
        let own: Vec<usize> = (0..n).filter(|&k| strip[measured.prescribed[k] as usize] == s).collect();
        let local = axes.map(|c| {
            let (middle, length) = range(own.iter().map(|&k| place(k)[c]));
            let to_unit = |&k: &usize| if length > 0.0 { 2.0 * (place(k)[c] - middle) / length } else { 0.0 };
            own.iter().map(to_unit).collect::<Vec<f64>>()
        });
        let polynomials = [legendre(&local[0], along), legendre(&local[1], across)];
        let mut of_strip: Vec<Vec<f64>> = Vec::new();
        for q in &polynomials[1] {
            for p in &polynomials[0] {
                of_strip.extend(orthonormal(p.iter().zip(q).map(|(p, q)| p * q).collect(), &of_strip));
            }
        }
        for c in 0..2 {
            for values in &of_strip {
                let mut column = vec![0.0; 2 * n];
                own.iter().zip(values).for_each(|(k, value)| column[2 * k + c] = *value);
                columns.push(column);
            }
        }
    }
    Dense::from_fn(2 * n, columns.len(), |row, k| columns[k][row])
}

/// Middle and length of the interval that `values` fill.
fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    if low <= high { (0.5 * (low + high), high - low) } else { (0.0, 0.0) }
}

/// Legendre polynomials of degrees 0 to `degree` at `x`: `(k + 1) P_{k+1} = (2 k + 1) x P_k - k P_{k-1}`.
fn legendre(x: &[f64], degree: usize) -> Vec<Vec<f64>> {
    let mut all = vec![vec![1.0; x.len()], x.to_vec()];
    for k in 1..degree {
        let (n, [before, last]) = (k as f64, [&all[k - 1], &all[k]]);
        let next = |(x, (p, q)): (&f64, (&f64, &f64))| ((2.0 * n + 1.0) * x * q - n * p) / (n + 1.0);
        all.push(x.iter().zip(before.iter().zip(last)).map(next).collect());
    }
    all.truncate(degree + 1);
    all
}

/// What of `column` is new beside `others`, of length 1; `None` where that is nothing.
fn orthonormal(mut column: Vec<f64>, others: &[Vec<f64>]) -> Option<Vec<f64>> {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let whole = dot(&column, &column).sqrt();
    // Twice: once leaves what rounding of large parts has left.
    for _ in 0..2 {
        for other in others {
            let part = dot(&column, other);
            column.iter_mut().zip(other).for_each(|(c, o)| *c -= part * o);
        }
    }
    let left = dot(&column, &column).sqrt();
    column.iter_mut().for_each(|c| *c /= left);
    (left > NEW * whole).then_some(column)
}

/// The displacements of `boundary` at the prescribed nodes of the measured mesh, instant by instant.
pub(crate) fn prescribed_of(joint: &Joint, boundary: &BoundaryHistory) -> Vec<Vec<[f64; 2]>> {
    let place: HashMap<u32, usize> = boundary.nodes().iter().enumerate().map(|(k, &node)| (node, k)).collect();
    let prescribed =
        |values: &Vec<[f64; 2]>| joint.measured.prescribed.iter().map(|node| values[place[node]]).collect();
    boundary.instants().iter().map(prescribed).collect()
}
