//! Is a residual a displacement (THEORY 19)? What grows with the gradient need not be one: interpolation of sharp dots,
//! compression, a hair of blur. So the residual is asked: in every element it is fitted by all that a bilinear field and
//! the light can take, and then by displacements that bend within the element.
//!
//! Under noise, the mean square along the latter over that of the rest is a variable F. An element far beyond it shows a
//! displacement by itself. Weaker ones show by their neighbours: a displacement is continuous, so that what bends one
//! element bends the next. Where no mode does, the level of F in the zone is that of its noise, of any colour.
//!
//! A sample of the elements tells what a zone shows. Others are looked at where it shows something, or where their
//! residual is large or beside what is lost: of a frame that is followed a fifth.

use crate::backend::bend::{BentMoments, BentSums, COLUMNS, FLAT, N_PRODUCTS, OF_GREY, POWERS, product};
use crate::backend::{ElementMatch, ElementMoments};
use crate::field::ModelError;
use crate::linalg::{Pattern, Solver};
use crate::mesh::Mesh;
use crate::units::Px;
use rayon::prelude::*;
use std::sync::OnceLock;

/// Columns of the fit that a bilinear field and the light can take: the gradient's components times 1, z, w, zw; f; 1.
const TAKEN: usize = 2 * FLAT + 2;
/// Which of them is f.
const TAKEN_LIGHT: usize = 2 * FLAT;
/// Those that bend, per component.
const BENT: usize = POWERS.len() - FLAT;
/// and of both.
const MODES: usize = 2 * BENT;
/// What a column has beside those before it must be at least this share of its square: of one that the field takes, less
/// is round-off; of one that bends, less tells little of it and makes much of noise.
const LEAST_OWN: [f64; 2] = [1e-4, 0.05];
/// Standard deviates of F at which a single element shows a displacement: one in 3000 of those that are followed.
const SHOWN: f64 = 3.4;
/// Correlation of a mode between neighbouring elements from which on it is a displacement, which is continuous. What
/// interpolation, compression and a blur leave goes with the texture: 0.32 at most in 44 scenes (scripts/verdicts.py).
const COHERENT: f64 = 0.4;
/// and pairs of neighbours without which that is chance.
const PAIRS: usize = 24;
/// Values of a mode are cut at so many of its median sizes: a few elements that are far off do not speak for all.
const CUT: f64 = 3.0;
/// Elements from which the level of F, and its spread, are those of their zone.
const ENOUGH: usize = 16;
/// Elements of a zone from which the sample is taken, with two neighbours each; of smaller zones all are in it.
const SAMPLE: usize = 256;
/// An element is looked at when the mean square of its residual is beyond the median by so many standard deviations of
/// noise and this share, or when its zone shows something.
const DOUBTED: f64 = 1.7;
const LEAST_DOUBTED: f64 = 0.15;
/// Share of the elements that may show a displacement while the residual is taken for noise.
const WIDE: f64 = 0.1;
/// Share of the elements up to which what they do to nodes is told by these alone: one by chance is not worth a solution.
const FEW: f64 = 0.005;
/// An element is named when its displacement is off by so many standard uncertainties of its nodes.
const NAMED_SIGMAS: f64 = 1.7;

/// The place of a column among those of [`BentSums::along`]; the taken ones come first.
const fn column(at: usize) -> usize {
    match at {
        0..TAKEN if at < 2 * FLAT => at / FLAT * POWERS.len() + at % FLAT,
        0..TAKEN => OF_GREY + at - 2 * FLAT,
        _ => (at - TAKEN) / BENT * POWERS.len() + FLAT + (at - TAKEN) % BENT,
    }
}

/// Numbers of [`BentMoments`], and where among them the sum of products of two columns is.
const N_MOMENTS: usize = 3 * N_PRODUCTS + 4 * POWERS.len() + 3;
const PLACES: [[u8; COLUMNS]; COLUMNS] = places();

const fn place(a: usize, b: usize) -> usize {
    let (a, b) = if a < b { (a, b) } else { (b, a) };
    let (n, grey) = (POWERS.len(), OF_GREY);
    if b < grey {
        let ([ka, la], [kb, lb]) = (POWERS[a % n], POWERS[b % n]);
        (a / n + b / n) * N_PRODUCTS + product(ka + kb, la + lb)
    } else if a < grey {
        3 * N_PRODUCTS + (2 * (b - grey) + a / n) * n + a % n
    } else {
        3 * N_PRODUCTS + 4 * n + a + b - 2 * grey
    }
}

const fn places() -> [[u8; COLUMNS]; COLUMNS] {
    let mut places = [[0; COLUMNS]; COLUMNS];
    let mut at = 0;
    while at < COLUMNS * COLUMNS {
        places[at / COLUMNS][at % COLUMNS] = place(column(at / COLUMNS), column(at % COLUMNS)) as u8;
        at += 1;
    }
    places
}

/// Row by row, the lower triangle of the Cholesky factor of the products of an element's columns; zero on the diagonal
/// for one that is not told from those before it.
type Factor = [f32; COLUMNS * (COLUMNS + 1) / 2];

fn entry(i: usize, j: usize) -> usize {
    i * (i + 1) / 2 + j
}

/// Without the column of f, unless it `takes_light`.
fn factor(moments: &BentMoments, takes_light: bool) -> Factor {
    let mut all = [0.0; N_MOMENTS];
    let (of_gradient, rest) = all.split_at_mut(3 * N_PRODUCTS);
    of_gradient.copy_from_slice(moments.gradient.as_flattened());
    let (of_grey, rest) = rest.split_at_mut(4 * POWERS.len());
    of_grey.copy_from_slice(moments.grey.as_flattened());
    rest.copy_from_slice(&moments.of_grey);
    let mut l = PLACES.map(|row| row.map(|place| all[usize::from(place)]));
    for j in 0..COLUMNS {
        let own = all[usize::from(PLACES[j][j])];
        let is_told = l[j][j] > LEAST_OWN[usize::from(j >= TAKEN)] * own && (takes_light || j != TAKEN_LIGHT);
        let root = if is_told { l[j][j].sqrt() } else { 0.0 };
        let mut below = [0.0; COLUMNS];
        for i in j..COLUMNS {
            below[i] = if root > 0.0 { l[i][j] / root } else { 0.0 };
            l[i][j] = below[i];
        }
        for i in j + 1..COLUMNS {
            for k in j + 1..=i {
                l[i][k] -= below[i] * below[k];
            }
        }
    }
    let mut factor = [0.0; COLUMNS * (COLUMNS + 1) / 2];
    for i in 0..COLUMNS {
        (0..=i).for_each(|j| factor[entry(i, j)] = l[i][j] as f32);
    }
    factor
}

/// What the residual of an element says of displacements that bend within it.
#[derive(Debug, Clone, Copy)]
struct Look {
    /// Along the columns that bend, at right angles to each other, in units of the rest of the residual.
    along: [f64; MODES],
    /// The displacement of each mode by itself, px.
    size: [f64; MODES],
    /// Columns that bend, and degrees of freedom of the rest.
    freedom: [f64; 2],
    /// Square of the displacement, px^2, of a unit of `along`.
    unit: f64,
}

/// What is usual in a zone.
struct OfZone {
    /// Mean square along the columns that bend where nothing is followed by them, beside the rest, and the spread of its
    /// deviate: 1 for white noise of one size, more where it goes with the texture.
    level: f64,
    spread: f64,
    /// Correlation between neighbours of the modes that are displacements all over it; 0 of the others.
    coherence: [f64; MODES],
}

/// What the residuals of the elements that are looked at say; nothing where there is no field.
#[derive(Default)]
pub(crate) struct Looks {
    /// Of each element of the mesh its place among the looks, or [`NOWHERE`].
    places: Vec<u32>,
    looks: Vec<Option<Look>>,
}

const NOWHERE: u32 = u32::MAX;

impl Looks {
    fn get(&self, element: usize) -> Option<&Look> {
        self.looks.get(self.places[element] as usize)?.as_ref()
    }
}

/// The elements that tell what is usual in a zone, and what all of it shows.
struct Sample {
    elements: Vec<u32>,
    /// Neighbours along both axes of the mesh.
    pairs: [Vec<[usize; 2]>; 2],
}

/// What a frame's residual follows beyond its field.
pub(crate) struct Bent {
    /// Displacement that each element does not follow, root mean square, px; zero where none shows.
    pub not_followed: Vec<f64>,
    /// What that does to each node, px.
    pub nodes: Vec<[f64; 2]>,
}

impl Bent {
    /// Whether so many elements show a displacement that the residual does not tell about the noise.
    pub fn is_wide(&self) -> bool {
        self.share() > WIDE
    }

    fn share(&self) -> f64 {
        let n = self.not_followed.iter().filter(|px| **px > 0.0).count();
        n as f64 / self.not_followed.len().max(1) as f64
    }
}

pub(crate) struct BendTest {
    /// Made when an element is first looked at.
    factors: Vec<OnceLock<Box<Factor>>>,
    /// Pixels of each element, and mean square of a component of its gradient.
    texture: Vec<[f64; 2]>,
    /// Per zone.
    samples: Vec<Sample>,
    /// Whether a change of light within an element is told from noise.
    takes_light: bool,
}

impl BendTest {
    /// `is_smoothed`: the gradient is that of a smoothed reference. Then hardly more is left of f beside it than noise,
    /// which would take that of the residual.
    pub fn new(mesh: &Mesh<Px>, pattern: &Pattern, moments: &[ElementMoments], is_smoothed: bool) -> Self {
        let texture = |of: &ElementMoments| [of.n, 0.5 * (of.gradient_power(0) + of.gradient_power(2)) / of.n.max(1.0)];
        let sample = |zone: usize| {
            let of_zone = mesh.zone_elements(zone);
            let every = if of_zone.len() <= 2 * SAMPLE { 1 } else { of_zone.len().div_ceil(SAMPLE) };
            let (mut elements, mut pairs): (Vec<u32>, [Vec<[usize; 2]>; 2]) = Default::default();
            for element in of_zone.step_by(every) {
                elements.push(element as u32);
                for (axis, pairs) in pairs.iter_mut().enumerate() {
                    if let Some(other) = beside(mesh, pattern, element, 1 + axis) {
                        elements.push(other as u32);
                        pairs.push([element, other]);
                    }
                }
            }
            elements.sort_unstable();
            elements.dedup();
            Sample { elements, pairs }
        };
        Self {
            factors: std::iter::repeat_with(OnceLock::new).take(mesh.n_elements()).collect(),
            texture: moments.iter().map(texture).collect(),
            samples: (0..mesh.zones().len()).map(sample).collect(),
            takes_light: !is_smoothed,
        }
    }

    /// The elements whose residual is asked for first.
    pub fn sample(&self) -> Vec<u32> {
        self.samples.iter().flat_map(|sample| &sample.elements).copied().collect()
    }

    /// Those of `elements` whose moments are not known yet.
    pub fn unknown(&self, elements: &[u32]) -> Vec<u32> {
        elements.iter().copied().filter(|&element| self.factors[element as usize].get().is_none()).collect()
    }

    /// Notes the moments of `elements`.
    pub fn note(&self, elements: &[u32], moments: &[BentMoments]) {
        let made: Vec<Box<Factor>> =
            moments.par_iter().with_min_len(64).map(|of| Box::new(factor(of, self.takes_light))).collect();
        for (&element, factor) in elements.iter().zip(made) {
            // Another frame may have been first: both are alike.
            let _ = self.factors[element as usize].set(factor);
        }
    }

    /// Adds to `looks` what the `sums` of `elements` say, of those of which something has `matched`.
    pub fn look_at(&self, looks: &mut Looks, elements: &[u32], sums: &[BentSums], matched: &[ElementMatch]) {
        let look = |(&element, sums): (&u32, &BentSums)| match matched[element as usize].n > 0.0 {
            true => self.look(element as usize, sums),
            false => None,
        };
        looks.places.resize(matched.len(), NOWHERE);
        elements.iter().zip(looks.looks.len() as u32..).for_each(|(&at, place)| looks.places[at as usize] = place);
        looks.looks.par_extend(elements.par_iter().zip(sums).with_min_len(64).map(look));
    }

    /// The elements beside the sample that are to be looked at, by what that says and how all have `matched`.
    pub fn choose(&self, mesh: &Mesh<Px>, looks: &Looks, matched: &[ElementMatch]) -> Vec<u32> {
        let mut beside_lost = vec![false; mesh.n_nodes()];
        for (element, nodes) in mesh.elements().iter().enumerate() {
            if matched[element].n == 0.0 && self.texture[element][0] > 0.0 {
                nodes.iter().for_each(|&node| beside_lost[node as usize] = true);
            }
        }
        let square = |element: usize| matched[element].residual_rms.powi(2);
        let counts = |element: &usize| matched[*element].n > 0.0;
        let mut chosen = Vec::new();
        for (zone, sample) in self.samples.iter().enumerate() {
            let of_sample = sample.elements.iter().map(|&element| element as usize).filter(counts);
            let mut squares: Vec<f64> = of_sample.map(square).collect();
            squares.sort_by(f64::total_cmp);
            let Some(&median) = squares.get(squares.len() / 2) else { continue };
            let is_bent = sample.coherence(looks).iter().any(|coherence| *coherence > 0.0);
            for element in mesh.zone_elements(zone).filter(counts) {
                let most = median * (1.0 + (DOUBTED * (2.0 / matched[element].n).sqrt()).max(LEAST_DOUBTED));
                let is_beside = || mesh.elements()[element].iter().any(|&node| beside_lost[node as usize]);
                if looks.places[element] == NOWHERE && (is_bent || square(element) > most || is_beside()) {
                    chosen.push(element as u32);
                }
            }
        }
        chosen
    }

    fn look(&self, element: usize, sums: &BentSums) -> Option<Look> {
        let (l, [n_all, gradient]) = (self.factors[element].get()?, self.texture[element]);
        // Of what has left the image the columns are others.
        if sums.n < n_all - 0.5 || sums.n == 0.0 {
            return None;
        }
        let (mut y, mut n_columns, mut n_bent) = ([0.0; COLUMNS], 0, 0);
        for i in 0..COLUMNS {
            let diagonal = f64::from(l[entry(i, i)]);
            if diagonal > 0.0 {
                let before: f64 = (0..i).map(|k| f64::from(l[entry(i, k)]) * y[k]).sum();
                y[i] = (sums.along[column(i)] - before) / diagonal;
                (n_columns, n_bent) = (n_columns + 1, n_bent + usize::from(i >= TAKEN));
            }
        }
        let rest = sums.n - n_columns as f64;
        if n_bent == 0 || rest < COLUMNS as f64 {
            return None;
        }
        let noise = (sums.rr - y.iter().map(|y| y * y).sum::<f64>()) / rest;
        let along = std::array::from_fn(|k| y[TAKEN + k] / noise.sqrt());
        let coefficients = coefficients(l, &std::array::from_fn(|k| y[TAKEN + k]));
        let size = std::array::from_fn(|k| coefficients[TAKEN + k]);
        let look = Look { along, size, freedom: [n_bent as f64, rest], unit: noise / (sums.n * gradient) };
        (noise > 0.0 && look.unit.is_finite() && look.f().is_finite()).then_some(look)
    }

    /// What the residual of a frame, whose normal equations `solver` solves, follows beyond its field.
    pub fn test(&self, mesh: &Mesh<Px>, looks: &Looks, solver: &Solver) -> Bent {
        let mut bent = Bent { not_followed: vec![0.0; mesh.n_elements()], nodes: vec![[0.0; 2]; mesh.n_nodes()] };
        if looks.places.is_empty() {
            return bent;
        }
        let zones: Vec<OfZone> = self.samples.iter().map(|sample| sample.usual(looks)).collect();
        let by_residual = &mut bent.nodes;
        for (element, nodes) in mesh.elements().iter().enumerate() {
            let (Some(look), Some(l)) = (looks.get(element), self.factors[element].get()) else { continue };
            let zone = &zones[mesh.element_zone()[element] as usize];
            let share = zone.shares(look);
            let square: f64 = look.along.iter().zip(share).map(|(along, share)| share * along * along).sum();
            if square == 0.0 {
                continue;
            }
            bent.not_followed[element] = (square * look.unit).sqrt();
            // Its own noise, as all of its residual is in units of that.
            let noise = (look.unit * self.texture[element].iter().product::<f64>()).sqrt();
            let along = std::array::from_fn(|k| share[k] * look.along[k] * noise);
            for (&node, own) in nodes.iter().zip(at_corners(l, &along)) {
                (0..2).for_each(|c| by_residual[node as usize][c] += own[c]);
            }
        }
        solver.matrix().held().iter().for_each(|&node| by_residual[node as usize] = [0.0; 2]);
        let rhs = std::mem::take(&mut bent.nodes);
        bent.nodes = if bent.share() > FEW { solver.solve(rhs) } else { by_diagonal(solver, rhs) };
        bent
    }
}

impl Sample {
    /// What is usual in its zone.
    fn usual(&self, looks: &Looks) -> OfZone {
        let seen: Vec<&Look> = self.elements.iter().filter_map(|&element| looks.get(element as usize)).collect();
        let coherence = self.coherence(looks);
        let mut of = OfZone { level: 1.0, spread: 1.0, coherence };
        // By the modes that are no displacement.
        let noise: Vec<(f64, f64)> = seen.iter().map(|look| look.beside(&coherence)).collect();
        let n_noise = noise.iter().map(|(_, n)| n).sum::<f64>() / noise.len() as f64;
        let mut f: Vec<f64> = noise.iter().filter(|(_, n)| *n > 0.0).map(|(sum, n)| sum / n).collect();
        if f.len() < ENOUGH {
            return of;
        }
        f.sort_by(f64::total_cmp);
        let quantile = |share: f64| f[(share * (f.len() - 1) as f64) as usize];
        let rest = seen.iter().map(|look| look.freedom[1]).sum::<f64>() / seen.len() as f64;
        // The median of a variable F is where its deviate is nothing.
        let median = ((1.0 - 2.0 / (9.0 * n_noise)) / (1.0 - 2.0 / (9.0 * rest))).powi(3);
        of.level = quantile(0.5) / median;
        of.spread = (-deviate(quantile(0.25) / of.level, n_noise, rest) / 0.674).max(1.0);
        of
    }

    /// Correlation of the modes between neighbouring elements, along one axis of the mesh or the other; 0 where it is
    /// below [`COHERENT`].
    fn coherence(&self, looks: &Looks) -> [f64; MODES] {
        let both = |&[a, b]: &[usize; 2]| Some([looks.get(a)?, looks.get(b)?]);
        let pairs = self.pairs.each_ref().map(|pairs| pairs.iter().filter_map(both).collect::<Vec<_>>());
        let of_mode = |mode: usize| {
            let mut sizes: Vec<f64> = pairs.iter().flatten().map(|[look, _]| look.size[mode].abs()).collect();
            sizes.sort_by(f64::total_cmp);
            let most = CUT * sizes.get(sizes.len() / 2).copied().unwrap_or(0.0);
            let along = |pairs: &Vec<[&Look; 2]>| {
                let (mut product, mut squares) = (0.0, 0.0);
                for pair in pairs {
                    let [a, b] = pair.map(|look| look.size[mode].clamp(-most, most));
                    (product, squares) = (product + a * b, squares + 0.5 * (a * a + b * b));
                }
                if pairs.len() < PAIRS || squares == 0.0 { 0.0 } else { (product / squares).abs() }
            };
            pairs.iter().map(along).fold(0.0, f64::max)
        };
        std::array::from_fn(|mode| Some(of_mode(mode)).filter(|of| *of > COHERENT).unwrap_or(0.0))
    }
}

/// Coefficients of the columns that bend, from those at right angles to each other.
fn coefficients(l: &Factor, along: &[f64; MODES]) -> [f64; COLUMNS] {
    let at = |i: usize, j: usize| f64::from(l[entry(i, j)]);
    let mut v = [0.0; COLUMNS];
    for i in (TAKEN..COLUMNS).rev() {
        if at(i, i) > 0.0 {
            let after: f64 = (i + 1..COLUMNS).map(|k| at(k, i) * v[k]).sum();
            v[i] = (along[i - TAKEN] - after) / at(i, i);
        }
    }
    v
}

/// `sum psi grad f (grad f . w)` at the corners of an element, `w` the displacement that bends, of these modes at right
/// angles, less what is bilinear between its values at the corners: `M e` of the error e of the nodes.
fn at_corners(l: &Factor, along: &[f64; MODES]) -> [[f64; 2]; 4] {
    let at = |i: usize, j: usize| f64::from(l[entry(i, j)]);
    let mut v = coefficients(l, along);
    for c in 0..2 {
        for (k, [a, b]) in POWERS[FLAT..].iter().enumerate() {
            // z^2 is 1 at all corners, z^3 is z, z^2 w is w.
            v[c * FLAT + a % 2 + 2 * (b % 2)] -= v[TAKEN + c * BENT + k];
        }
    }
    let turned: [f64; COLUMNS] = std::array::from_fn(|j| (j..COLUMNS).map(|i| at(i, j) * v[i]).sum());
    let product = |i: usize| (0..=i).map(|j| at(i, j) * turned[j]).sum::<f64>();
    let by_power: [[f64; FLAT]; 2] = [0, 1].map(|c| std::array::from_fn(|k| product(c * FLAT + k)));
    [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
        .map(|[z, w]| by_power.map(|[one, by_z, by_w, by_zw]| 0.25 * (one + z * by_z + w * by_w + z * w * by_zw)))
}

/// Whether each element is to be named: its displacement is off by more than a few `sigma` of its nodes, by what bends
/// within it and by what its nodes are off.
pub(crate) fn is_named(mesh: &Mesh<Px>, error: &ModelError, sigma: &[[f64; 2]]) -> Vec<bool> {
    let mean_square = |of: &[[f64; 2]], nodes: &[u32; 4]| {
        nodes.iter().map(|&node| of[node as usize].iter().map(|v| v * v).sum::<f64>()).sum::<f64>() / 8.0
    };
    let of_element = |(nodes, misfit): (&[u32; 4], &f64)| {
        let square = misfit * misfit + mean_square(&error.nodes, nodes);
        *misfit > 0.0 && square > NAMED_SIGMAS.powi(2) * mean_square(sigma, nodes)
    };
    mesh.elements().iter().zip(&error.misfit).map(of_element).collect()
}

impl Look {
    /// Sum of squares along the columns that are no displacement, and their number. Of a column that its texture does not
    /// tell from others there is exactly nothing.
    fn beside(&self, coherence: &[f64; MODES]) -> (f64, f64) {
        let noise = self.along.iter().zip(coherence).filter(|(along, coherence)| **coherence == 0.0 && **along != 0.0);
        noise.fold((0.0, 0.0), |(sum, n), (along, _)| (sum + along * along, n + 1.0))
    }

    /// Mean square along the columns that bend, over that of the rest.
    fn f(&self) -> f64 {
        self.along.iter().map(|v| v * v).sum::<f64>() / self.freedom[0]
    }
}

impl OfZone {
    /// How much of each mode of an element is a displacement.
    fn shares(&self, look: &Look) -> [f64; MODES] {
        let f = look.f() / self.level;
        let is_shown = deviate(f, look.freedom[0], look.freedom[1]) > SHOWN * self.spread;
        if is_shown { [1.0 - 1.0 / f; MODES] } else { self.coherence }
    }
}

/// The element that shares the side of this number with another, turned alike; none else.
fn beside(mesh: &Mesh<Px>, pattern: &Pattern, element: usize, side: usize) -> Option<usize> {
    let nodes = mesh.elements()[element];
    let [a, b] = [nodes[side], nodes[(side + 1) % 4]];
    let shares = |other: &usize| {
        let of_other = mesh.elements()[*other];
        *other != element && [of_other[(side + 2) % 4], of_other[(side + 3) % 4]] == [b, a]
    };
    pattern.elements_of(a as usize).iter().map(|&(other, _)| other as usize).find(shares)
}

/// The solution of the equations of each node by itself.
fn by_diagonal(solver: &Solver, mut rhs: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    for (node, b) in rhs.iter_mut().enumerate().filter(|(_, b)| **b != [0.0; 2]) {
        let [xx, xy, yy] = solver.data().diagonal(node);
        let det = xx * yy - xy * xy;
        *b = if det > 0.0 { [(yy * b[0] - xy * b[1]) / det, (xx * b[1] - xy * b[0]) / det] } else { [0.0; 2] };
    }
    rhs
}

/// The standard normal deviate of a variable F of `a` and `b` degrees of freedom (Paulson 1942).
fn deviate(f: f64, a: f64, b: f64) -> f64 {
    let ([a, b], root) = ([a, b].map(|n| 2.0 / (9.0 * n)), f.cbrt());
    ((1.0 - b) * root - (1.0 - a)) / (b * root * root + a).sqrt()
}
