//! J from the measured field of an arm behind the tip, whose faces are free (THEORY 23).
//!
//! `J = -int [W - sigma . n . du/ds] dn` over a section of each arm. Between the loads and the tip an arm is a beam: with y
//! from its middle, `v = a_0 + a_1 s + a_2 s^2 + a_3 s^3`, `u = f(s) - y (v' - c) + (E/G) a_3 y^3`, and
//! `c = -3/4 (E/G) h^2 a_3`, which holds its faces free of traction. Fitted to the nodes, with f a cubic and y^2 (1, s) in v
//! for what is not measured of it, the integral is the same at any section:
//! `J = E I [2 a_2^2 - 6 a_3 (a_1 - c)] + 9/10 P^2/(G h)`, `P = 6 E I a_3`, by unit of width.

use crate::field::Value;
use crate::linalg::Dense;

/// Unknowns: a_1 to a_3 and a_0; those of f; those of y^2.
const N: usize = 10;
/// Of these the first make J.
const OF_J: usize = 3;
/// Nodes for each unknown, at least.
const NODES: usize = 3;

/// A part of an arm behind the tip: along s, in the direction in which the crack grows, and across it along n.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmPart {
    /// From and to, along the crack, mm.
    pub along: [f64; 2],
    /// From and to, across it, mm.
    pub across: [f64; 2],
    /// Modulus along and shear modulus, MPa.
    pub moduli: [f64; 2],
}

/// The nodes of a part of an arm, ready for any field that has measured them.
#[derive(Debug, Clone)]
pub struct ArmSection {
    part: ArmPart,
    /// a_1 to a_3, each by the length to its power, by the displacements of the nodes along s and n.
    by_nodes: [Dense; 2],
    /// Correlations of the errors of the nodes.
    correlation: Dense,
}

impl ArmPart {
    fn half_length(&self) -> f64 {
        0.5 * (self.along[1] - self.along[0])
    }

    fn thickness(&self) -> f64 {
        self.across[1] - self.across[0]
    }

    /// What the displacement along s and n at a place is by the unknowns.
    fn rows(&self, [s, n]: [f64; 2]) -> [[f64; N]; 2] {
        let half = self.half_length();
        let (t, y) = ((s - self.along[0]) / half - 1.0, (n - 0.5 * (self.across[0] + self.across[1])) / half);
        let (ratio, h) = (self.moduli[0] / self.moduli[1], self.thickness() / half);
        let of_shear = ratio * (y.powi(3) - 0.75 * h * h * y);
        let (t2, t3) = (t * t, t * t * t);
        [
            [-y, -2.0 * t * y, -3.0 * t2 * y + of_shear, 0.0, 1.0, t, t2, t3, 0.0, 0.0],
            [t, t2, t3, 1.0, 0.0, 0.0, 0.0, 0.0, y * y, y * y * t],
        ]
    }

    /// J is this quadratic form of a_1 to a_3, each by the length to its power.
    fn form(&self) -> [[f64; OF_J]; OF_J] {
        let (half, h, [young, shear]) = (self.half_length(), self.thickness(), self.moduli);
        let bending = young * h.powi(3) / 12.0;
        // E I [2 a_2^2 - 6 a_3 a_1 + 6 c/a_3 a_3^2] + 9/10 (6 E I a_3)^2/(G h)
        let of_shear = -4.5 * young / shear * h * h * bending + 0.9 * 36.0 * bending * bending / (shear * h);
        let by = [half, half * half, half.powi(3)];
        let mut form = [[0.0; OF_J]; OF_J];
        form[1][1] = 2.0 * bending;
        (form[0][2], form[2][0]) = (-3.0 * bending, -3.0 * bending);
        form[2][2] = of_shear;
        std::array::from_fn(|a| std::array::from_fn(|b| form[a][b] / (by[a] * by[b])))
    }
}

impl ArmSection {
    /// That of nodes at these places (s, n; mm), with the correlation of the errors of any two; `None` where they are
    /// too few.
    pub fn new(part: ArmPart, nodes: &[[f64; 2]], correlation: impl Fn(usize, usize) -> f64) -> Option<Self> {
        let count = nodes.len();
        if count < NODES * N {
            return None;
        }
        let rows: Vec<[[f64; N]; 2]> = nodes.iter().map(|&at| part.rows(at)).collect();
        let normal = Dense::from_fn(N, N, |a, b| rows.iter().flatten().map(|row| row[a] * row[b]).sum());
        let factor = normal.cholesky().ok()?;
        let by_nodes = [0, 1].map(|c| factor.solve(&Dense::from_fn(N, count, |k, node| rows[node][c][k])));
        let correlation = Dense::from_fn(count, count, |a, b| if a == b { 1.0 } else { correlation(a, b) });
        Some(Self { part, by_nodes, correlation })
    }

    /// Its share of J, N/mm, for displacements of the nodes (along s and n, mm) and their standard uncertainties. What
    /// noise adds to it in the mean is taken off.
    pub fn j(&self, displacement: &[[f64; 2]], sigma: &[[f64; 2]]) -> Value {
        let count = displacement.len();
        let mut fitted = [0.0; OF_J];
        let mut covariance = [[0.0; OF_J]; OF_J];
        for (c, by) in self.by_nodes.iter().enumerate() {
            let weighed = Dense::from_fn(count, OF_J, |node, k| sigma[node][c] * by[(k, node)]);
            let through = self.correlation.times(&weighed);
            for a in 0..OF_J {
                fitted[a] += (0..count).map(|node| by[(a, node)] * displacement[node][c]).sum::<f64>();
                for b in 0..OF_J {
                    covariance[a][b] += (0..count).map(|node| weighed[(node, a)] * through[(node, b)]).sum::<f64>();
                }
            }
        }
        let form = self.part.form();
        let product = |a: &[[f64; OF_J]; OF_J], b: &[[f64; OF_J]; OF_J]| -> [[f64; OF_J]; OF_J] {
            std::array::from_fn(|i| std::array::from_fn(|j| (0..OF_J).map(|k| a[i][k] * b[k][j]).sum()))
        };
        let through = product(&form, &covariance);
        let trace = |m: &[[f64; OF_J]; OF_J]| (0..OF_J).map(|k| m[k][k]).sum::<f64>();
        let along: [f64; OF_J] = std::array::from_fn(|a| (0..OF_J).map(|b| form[a][b] * fitted[b]).sum());
        let value: f64 = along.iter().zip(&fitted).map(|(a, b)| a * b).sum();
        let linear: f64 =
            (0..OF_J).map(|a| along[a] * (0..OF_J).map(|b| covariance[a][b] * along[b]).sum::<f64>()).sum();
        let variance = 4.0 * linear + 2.0 * trace(&product(&through, &through));
        Value { value: value - trace(&through), sigma: variance.max(0.0).sqrt() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MODULI: [f64; 2] = [70_000.0, 26_000.0];

    fn nodes() -> Vec<[f64; 2]> {
        (0..15).flat_map(|i| (0..8).map(move |j| [10.0 + 0.3 * f64::from(i), 0.1 + 0.4 * f64::from(j)])).collect()
    }

    fn section() -> ArmSection {
        let part = ArmPart { along: [10.0, 14.2], across: [0.0, 3.0], moduli: MODULI };
        ArmSection::new(part, &nodes(), |_, _| 0.0).unwrap()
    }

    /// A cantilever of thickness 3 mm and unit width, with the force P across its end at s = 0, turned as a whole.
    fn bent(load: f64, turn: f64) -> Vec<[f64; 2]> {
        let (e, g, i) = (MODULI[0], MODULI[1], 27.0 / 12.0);
        let (length, sin, cos) = (20.0, turn.sin(), turn.cos());
        let place = |[s, n]: [f64; 2]| {
            let y = n - 1.5;
            // Moment P s, Timoshenko with the parabola of shear: the exact field of sigma_nn = 0 but for nu.
            let slope = load / (2.0 * e * i) * (s * s - length * length);
            let u = -y * slope + load * y.powi(3) / (6.0 * g * i);
            let v = load / (e * i) * (s.powi(3) / 6.0 - length * length * s / 2.0) - load * 2.25 / (2.0 * g * i) * s;
            // Turned about the origin after it is bent.
            let (x, y) = (s + u, n + v);
            [cos * x - sin * y - s, sin * x + cos * y - n]
        };
        nodes().into_iter().map(place).collect()
    }

    #[test]
    fn a_bent_arm_has_the_j_of_its_moment_and_its_shear_however_it_is_turned() {
        // M^2/(2 E I) and Q theta of the cut make P^2 L^2/(2 E I) at any place; shear 3/2 - 3/5 of P^2/(h G).
        let (load, i) = (4.0, 27.0 / 12.0);
        let zero = vec![[0.0; 2]; nodes().len()];
        let of = |turn: f64| section().j(&bent(load, turn), &zero).value;
        let wanted = load * load * (400.0 / (2.0 * MODULI[0] * i) + 0.9 / (3.0 * MODULI[1]));
        let found = of(0.0);
        // The field of the beam is in the functions.
        assert!((found / wanted - 1.0).abs() < 1e-9, "{found} for {wanted}");
        // A turn of the whole takes the work of its force, P theta, and makes no strain.
        // The cosine of the turn takes 5e-5 of what is bent.
        assert!((of(0.01) - found - -load * 0.01).abs() < 1e-3 * load * 0.01, "{} {found}", of(0.01));
    }

    #[test]
    fn noise_adds_nothing_in_the_mean_and_scatters_as_stated() {
        use rand::SeedableRng;
        use rand_distr::{Distribution, StandardNormal};
        let (section, clean) = (section(), bent(4.0, 0.0));
        let sigma = vec![[4e-4; 2]; clean.len()];
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        let truth = section.j(&clean, &vec![[0.0; 2]; clean.len()]).value;
        let (mut sum, mut square, n) = (0.0, 0.0, 200);
        for _ in 0..n {
            let noisy: Vec<[f64; 2]> = clean
                .iter()
                .map(|u| {
                    u.map(|v| {
                        let z: f64 = StandardNormal.sample(&mut random);
                        v + 4e-4 * z
                    })
                })
                .collect();
            let found = section.j(&noisy, &sigma);
            sum += (found.value - truth) / found.sigma;
            square += ((found.value - truth) / found.sigma).powi(2);
        }
        let (mean, rms) = (sum / f64::from(n), (square / f64::from(n)).sqrt());
        // 200 draws: 0.07 and 0.05.
        assert!(mean.abs() < 0.25 && (0.8..1.2).contains(&rms), "{mean} {rms}");
    }
}
