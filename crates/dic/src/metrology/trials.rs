//! Correlations of the user's own image with copies of it that are moved exactly.

use super::MetrologyError;
use super::gauge::{Lattice, Sums as GaugeSums, Windows};
use super::region::Region;
use super::theory::{Crest, RESOLVED};
use super::wave::{WavePicture, with_noise};
use crate::backend::GreyTransfer;
use crate::backend::cpu::CpuBackend;
use crate::correlate::{Correlation, CorrelationError, Correlator, Options as CorrelateOptions, Start};
use crate::field::{NoiseCorrelation, Status};
use crate::imaging::{Image, Interpolation};
use crate::mesh::Mesh;
use crate::units::Px;
use rayon::prelude::*;
use serde::Serialize;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Displacements of the copies, px: none is a whole pixel, none is half of one along both axes.
const SHIFTS: [[f64; 2]; 4] = [[0.21, 0.37], [0.5, 0.13], [0.67, 0.79], [0.88, 0.5]];
/// Pairs with independent noise: up to this many values (1 % of the standard deviation), as far as time allows.
const ENOUGH_VALUES: f64 = 5000.0;
const MOST_PAIRS: usize = 32;
const PIXELS_OF_PAIRS: usize = 8 << 20;
/// A size none of whose first pairs converged is given up.
const PAIRS_TO_GIVE_UP: usize = 2;
/// Sub-pixel displacements take 5 to 10 iterations; what takes more has failed.
const MOST_ITERATIONS: usize = 25;
/// Sub-pixel displacements along both axes at which the bias is looked for, px; it is odd about 0.5.
const BIAS_SHIFTS: [f64; 7] = [0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875];
/// Periods in element sizes between which each crest's 90 % are looked for.
const PERIODS: [(Crest, &[f64]); 3] = [
    (Crest::AtNode, &[1.7, 1.9, 2.1]),
    (Crest::Averaged, &[2.3, 2.6, 2.9, 3.3]),
    (Crest::AtMiddle, &[4.0, 4.4, 4.8, 5.4]),
];
/// Largest amplitude of the waves, px, and largest share of their period: a shear of 0.06.
const AMPLITUDE_PX: f64 = 0.5;
const AMPLITUDE_BY_PERIOD: f64 = 0.01;
/// Static images that are correlated with every element size, at most.
const MOST_STILLS: usize = 8;
/// Rows of nodes at either edge of the zone that do not count, and rows that must be left.
const EDGE_ROWS: usize = 2;
const LEAST_ROWS: usize = 4;

/// What was made of a reference, unless it has no texture.
pub(super) fn with_texture<T>(made: Result<T, CorrelationError>) -> Result<Option<T>, MetrologyError> {
    match made {
        Ok(made) => Ok(Some(made)),
        Err(CorrelationError::Textureless { .. } | CorrelationError::NoTexture { .. }) => Ok(None),
        Err(error) => Err(error.into()),
    }
}

/// The picture that trials are made of: the user's image, its noise taken off.
pub(super) struct Trials<'a> {
    pub region: &'a Region,
    pub picture: &'a WavePicture,
    pub noise: f64,
    pub interpolation: Interpolation,
}

/// Scatter of the results of one element size over pairs with noise of their own.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Scatter {
    /// Standard deviation of the error of inner nodes about its mean, along x and y, px.
    pub inner_px: [f64; 2],
    /// The same of nodes on the edge of the zone (corners not among them), px; `None` without any.
    pub edge_px: Option<[f64; 2]>,
    /// Mean error of inner nodes, largest over the displacements of the copies, px.
    pub mean_error_px: [f64; 2],
    /// Standard deviation of exx and eyy at the centres of elements off the edge; `None` without any.
    pub strain: Option<[f64; 2]>,
    /// Values of each component behind `inner_px`.
    pub n_values: usize,
    /// Statistical uncertainty of `inner_px`, per cent: `100 / sqrt(2 n)`.
    pub statistical_percent: f64,
    /// Pairs that did not converge, and are left out.
    pub n_pairs_failed: usize,
    /// Pairs made.
    pub n_pairs: usize,
}

/// Bias of one interpolation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Bias {
    /// The interpolation.
    pub interpolation: Interpolation,
    /// Displacements along both axes, px.
    pub shift_px: Vec<f64>,
    /// Mean error over the inner nodes, along x and y, px, without noise.
    pub mean_error_px: Vec<[f64; 2]>,
    /// Largest of their magnitudes, px.
    pub largest_px: f64,
    /// Largest root mean square over the nodes, px: the mean and what varies from node to node.
    pub largest_rms_px: f64,
}

/// Shortest period resolved at 90 %, px: of a displacement wave that crosses the elements squarely.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Resolved {
    /// Crests on rows of nodes (best case).
    pub at_node_px: Option<f64>,
    /// The mean over phases.
    pub averaged_px: Option<f64>,
    /// Crests in the middle of elements (worst case).
    pub at_middle_px: Option<f64>,
}

/// Sums over nodes and pairs.
#[derive(Default, Clone)]
struct Moments {
    n: f64,
    sum: [f64; 2],
    squares: [f64; 2],
}

impl Moments {
    fn add(&mut self, value: [f64; 2]) {
        self.n += 1.0;
        for c in 0..2 {
            self.sum[c] += value[c];
            self.squares[c] += value[c] * value[c];
        }
    }

    fn mean(&self) -> Option<[f64; 2]> {
        (self.n > 0.0).then(|| self.sum.map(|sum| sum / self.n))
    }

    fn rms(&self) -> Option<[f64; 2]> {
        (self.n > 0.0).then(|| self.squares.map(|sum| (sum / self.n).sqrt()))
    }
}

/// What the pairs of one element size have given: inner nodes, edge nodes and strains by displacement.
#[derive(Default)]
struct Sums {
    by_shift: [[Moments; 3]; SHIFTS.len()],
    gauges: GaugeSums,
    n_pairs: usize,
    n_failed: usize,
}

impl Sums {
    /// Whether no pair after the first `pairs` is needed; all displacements come equally often.
    fn done(&self, pairs: usize) -> bool {
        let n: f64 = self.by_shift.iter().map(|sums| sums[0].n).sum();
        let given_up = self.n_failed >= PAIRS_TO_GIVE_UP && self.n_failed == self.n_pairs;
        given_up || (pairs.is_multiple_of(SHIFTS.len()) && n >= ENOUGH_VALUES)
    }

    /// The standard deviation about the mean of each displacement: what differs in the mean is bias.
    fn deviation(&self, kind: usize) -> Option<[f64; 2]> {
        let (mut n, mut squares) = (0.0, [0.0; 2]);
        for moments in self.by_shift.iter().map(|sums| &sums[kind]) {
            let Some(mean) = moments.mean() else { continue };
            n += moments.n;
            for c in 0..2 {
                squares[c] += (moments.squares[c] - moments.n * mean[c] * mean[c]).max(0.0);
            }
        }
        (n > 1.0).then(|| squares.map(|sum| (sum / n).sqrt()))
    }

    fn scatter(&self) -> Option<Scatter> {
        let n: f64 = self.by_shift.iter().map(|sums| sums[0].n).sum();
        let means = self.by_shift.iter().filter_map(|sums| sums[0].mean());
        Some(Scatter {
            inner_px: self.deviation(0)?,
            edge_px: self.deviation(1),
            mean_error_px: means.fold([0.0; 2], |a, mean| [0, 1].map(|c| f64::max(a[c], mean[c].abs()))),
            strain: self.deviation(2),
            n_values: n as usize,
            statistical_percent: 100.0 / (2.0 * n).sqrt(),
            n_pairs_failed: self.n_failed,
            n_pairs: self.n_pairs,
        })
    }
}

/// How many of the zone's four edges each node is on.
fn edges(mesh: &Mesh<Px>) -> Vec<usize> {
    let fold =
        |start: f64, pick: fn(f64, f64) -> f64| [0, 1].map(|k| mesh.nodes().iter().map(|x| x[k]).fold(start, pick));
    let (low, high) = (fold(f64::INFINITY, f64::min), fold(f64::NEG_INFINITY, f64::max));
    let of_node = |x: &[f64; 2]| (0..2).map(|k| usize::from(x[k] == low[k]) + usize::from(x[k] == high[k])).sum();
    mesh.nodes().iter().map(of_node).collect()
}

impl Trials<'_> {
    pub fn correlator(
        &self,
        reference: &Arc<Image>,
        element_size: usize,
        interpolation: Interpolation,
        noise: f64,
    ) -> Result<Correlator<CpuBackend>, CorrelationError> {
        let options = CorrelateOptions {
            element_size,
            interpolation,
            noise: noise.max(f64::MIN_POSITIVE).into(),
            noise_correlation: NoiseCorrelation::Off, // the noise that is added is white
            drop_textureless: true,
            max_iterations: MOST_ITERATIONS,
            ..CorrelateOptions::default()
        };
        Correlator::new(CpuBackend::default(), reference.clone(), &self.region.zones(), options)
    }

    /// The result for a copy whose displacement is below a pixel; `None` if it did not converge.
    fn solve(correlator: &Correlator<CpuBackend>, image: Arc<Image>) -> Result<Option<Correlation>, MetrologyError> {
        let rest = vec![[0.0; 2]; correlator.mesh().n_nodes()];
        let transfer = vec![GreyTransfer::NONE; correlator.mesh().zones().len()];
        let result = correlator.correlate(image, Some(&Start::new(rest, transfer)))?;
        Ok((result.measurement.status == Status::Converged).then_some(result))
    }

    fn image(&self, greys: &[f32], noise: f64, seed: u64) -> Result<Arc<Image>, MetrologyError> {
        Ok(with_noise(greys, self.region.size[0], noise, seed)?)
    }

    /// The scatter for each size, `None` without a converged inner node; and that of strains over `windows`, if given.
    pub fn scatter(
        &self,
        sizes: &[usize],
        windows: Option<&Windows>,
        seed: u64,
    ) -> Result<Vec<(Option<Scatter>, GaugeSums)>, MetrologyError> {
        let [width, height] = self.region.size;
        let most_pairs = (PIXELS_OF_PAIRS / (width * height)).clamp(2 * SHIFTS.len(), MOST_PAIRS);
        let rest = self.picture.at_rest();
        let moved = SHIFTS.map(|shift| self.picture.moved(shift));
        let mut found: Vec<Sums> = sizes.iter().map(|_| Sums::default()).collect();
        for pair in 0..most_pairs {
            let which = pair % SHIFTS.len();
            if found.iter().all(|sums| sums.done(pair)) {
                break;
            }
            let own = seed.wrapping_add(2 * pair as u64);
            let reference = self.image(&rest, self.noise, own)?;
            let deformed = self.image(&moved[which], self.noise, own.wrapping_add(1))?;
            found.par_iter_mut().zip(sizes).filter(|(sums, _)| !sums.done(pair)).try_for_each(|(sums, &size)| {
                sums.n_pairs += 1;
                // With this noise there may be no node left: a pair without result.
                let result = match with_texture(self.correlator(&reference, size, self.interpolation, self.noise))? {
                    Some(correlator) => Self::solve(&correlator, deformed.clone())?,
                    None => None,
                };
                match result {
                    Some(result) => {
                        add_errors(&result, SHIFTS[which], &mut sums.by_shift[which]);
                        if let Some(windows) = windows {
                            sums.gauges.add(windows, &result.measurement, false);
                        }
                    }
                    None => sums.n_failed += 1,
                }
                Ok::<_, MetrologyError>(())
            })?;
        }
        Ok(found.into_iter().map(|sums| (sums.scatter(), sums.gauges)).collect())
    }

    /// The noise of strains between images at rest, with elements of `size` px; standard uncertainty of inner nodes, px.
    pub fn at_rest(
        &self,
        reference: &Arc<Image>,
        stills: &[Arc<Image>],
        windows: &Windows,
        size: usize,
    ) -> Result<(GaugeSums, Option<[f64; 2]>), MetrologyError> {
        let options = CorrelateOptions {
            element_size: size,
            interpolation: self.interpolation,
            drop_textureless: true,
            ..CorrelateOptions::default()
        };
        let (mut sums, mut inner) = (GaugeSums::default(), Moments::default());
        let correlator = Correlator::new(CpuBackend::default(), reference.clone(), &self.region.zones(), options);
        let Some(correlator) = with_texture(correlator)? else { return Ok((sums, None)) };
        for still in stills.iter().take(MOST_STILLS) {
            let field = correlator.correlate(still.clone(), None)?.measurement;
            if field.status != Status::Converged {
                continue;
            }
            sums.add(windows, &field, true);
            let lattice = Lattice::new(&field);
            (0..field.sigma.len()).filter(|&node| lattice.is_inner(node)).for_each(|node| inner.add(field.sigma[node]));
        }
        Ok((sums, inner.rms()))
    }

    /// The bias of each interpolation with elements of `size` px, without noise.
    pub fn bias(&self, size: usize) -> Result<Vec<Bias>, MetrologyError> {
        let reference = self.image(&self.picture.at_rest(), 0.0, 0)?;
        let (mut all, mut correlators) = (Vec::new(), Vec::new());
        for interpolation in
            [Interpolation::Cubic, Interpolation::Quintic, Interpolation::Keys, Interpolation::Bilinear]
        {
            correlators.push(self.correlator(&reference, size, interpolation, self.noise)?);
            let (shift_px, mean_error_px) = (Vec::new(), Vec::new());
            all.push(Bias { interpolation, shift_px, mean_error_px, largest_px: 0.0, largest_rms_px: 0.0 });
        }
        for shift in BIAS_SHIFTS {
            let deformed = self.image(&self.picture.moved([shift; 2]), 0.0, 0)?;
            for (bias, correlator) in all.iter_mut().zip(&correlators) {
                let Some(result) = Self::solve(correlator, deformed.clone())? else { continue };
                let mut sums = Default::default();
                add_errors(&result, [shift; 2], &mut sums);
                let (Some(mean), Some(rms)) = (sums[0].mean(), sums[0].rms()) else { continue };
                bias.shift_px.push(shift);
                bias.mean_error_px.push(mean);
                bias.largest_px = mean.into_iter().fold(bias.largest_px, |a, b| a.max(b.abs()));
                bias.largest_rms_px = rms.into_iter().fold(bias.largest_rms_px, f64::max);
            }
        }
        Ok(all)
    }

    /// The periods that elements of `size` px resolve; `None` where the zone is too low for them.
    pub fn resolved(&self, size: usize) -> Result<Resolved, MetrologyError> {
        let reference = self.image(&self.picture.at_rest(), 0.0, 0)?;
        let correlator = self.correlator(&reference, size, self.interpolation, self.noise)?;
        let mut found = [None; 3];
        for (found, (crest, periods)) in found.iter_mut().zip(PERIODS) {
            let mut before: Option<(f64, f64)> = None;
            for &by_size in periods {
                let period = by_size * size as f64;
                let amplitude = AMPLITUDE_PX.min(AMPLITUDE_BY_PERIOD * period);
                let wave = |y: f64| amplitude * (TAU * y / period).cos();
                let deformed = self.image(&self.picture.sheared(wave), 0.0, 0)?;
                let Some(result) = Self::solve(&correlator, deformed)? else { continue };
                let Some(nodal) = amplitude_of(&result, period) else { continue };
                let gain = crest.by_node(by_size) * nodal / amplitude;
                // Where the straight line between two gains crosses.
                if let Some((low, gain_low)) = before
                    && gain_low < RESOLVED
                    && gain >= RESOLVED
                {
                    let share = (RESOLVED - gain_low) / (gain - gain_low);
                    *found = Some((low + share * (by_size - low)) * size as f64);
                    break;
                }
                before = Some((by_size, gain));
            }
        }
        let [at_node_px, averaged_px, at_middle_px] = found;
        Ok(Resolved { at_node_px, averaged_px, at_middle_px })
    }
}

/// Root mean square over the inner nodes of what `correlate` would print, px, for images with `noise`.
pub(super) fn predicted(correlator: &Correlator<CpuBackend>, noise: f64) -> Option<[f64; 2]> {
    let mut is_inner: Vec<bool> = edges(correlator.mesh()).iter().map(|&edges| edges == 0).collect();
    correlator.dropped().iter().for_each(|fault| is_inner[fault.node] = false);
    let mut sums = Moments::default();
    for (sigma, _) in correlator.unit_sigma().into_iter().zip(is_inner).filter(|(_, is_inner)| *is_inner) {
        sums.add(sigma.map(|sigma| noise * sigma));
    }
    sums.rms()
}

/// Adds the errors at inner nodes, at edge nodes, and of the strains at the centres of inner elements.
fn add_errors(result: &Correlation, exact: [f64; 2], sums: &mut [Moments; 3]) {
    let field = &result.measurement;
    let mesh = &field.mesh;
    let edges = edges(mesh);
    for node in (0..mesh.n_nodes()).filter(|&node| field.measured[node] && edges[node] < 2) {
        sums[edges[node]].add([0, 1].map(|c| field.displacement[node][c] - exact[c]));
    }
    for nodes in mesh.elements() {
        let nodes = nodes.map(|node| node as usize);
        if nodes.iter().any(|&node| !field.measured[node] || edges[node] > 0) {
            continue;
        }
        let [a, b, c, d] = nodes.map(|node| field.displacement[node]);
        let size = mesh.nodes()[nodes[2]][0] - mesh.nodes()[nodes[0]][0];
        let exx = 0.5 * (b[0] - a[0] + c[0] - d[0]) / size;
        let eyy = 0.5 * (d[1] - a[1] + c[1] - b[1]) / size;
        sums[2].add([exx, eyy]);
    }
}

/// The amplitude of the wave `cos(2 pi y / period)` in the nodal u_x: least squares of wave, its quarter-turn
/// and a constant over the means of rows. `None` with too few rows.
fn amplitude_of(result: &Correlation, period: f64) -> Option<f64> {
    let field = &result.measurement;
    let (mesh, edges) = (&field.mesh, edges(&field.mesh));
    let mut rows: Vec<(f64, f64, f64)> = Vec::new();
    for node in (0..mesh.n_nodes()).filter(|&node| field.measured[node] && edges[node] == 0) {
        let (y, u) = (mesh.nodes()[node][1], field.displacement[node][0]);
        match rows.iter_mut().rev().find(|row| row.0 == y) {
            Some(row) => {
                row.1 += u;
                row.2 += 1.0;
            }
            None => rows.push((y, u, 1.0)),
        }
    }
    // The rows on the edges are out already.
    let rows = rows.get(EDGE_ROWS - 1..rows.len().checked_sub(EDGE_ROWS - 1)?)?;
    if rows.len() < LEAST_ROWS {
        return None;
    }
    let mut matrix = [[0.0; 4]; 3];
    for &(y, sum, n) in rows {
        let (sin, cos) = (TAU * y / period).sin_cos();
        let row = [cos, sin, 1.0, sum / n];
        for i in 0..3 {
            (0..4).for_each(|j| matrix[i][j] += row[i] * row[j]);
        }
    }
    solve_3(matrix).map(|[in_phase, ..]| in_phase)
}

/// Gauss's elimination of a symmetric positive definite system; `None` where it is not.
fn solve_3(mut m: [[f64; 4]; 3]) -> Option<[f64; 3]> {
    let largest = m[0][0].max(m[1][1]).max(m[2][2]);
    for k in 0..3 {
        // Rows that cannot tell wave from quarter-turn leave next to nothing here.
        if m[k][k] <= 1e-3 * largest {
            return None;
        }
        for i in (0..3).filter(|&i| i != k) {
            let factor = m[i][k] / m[k][k];
            (0..4).for_each(|j| m[i][j] -= factor * m[k][j]);
        }
    }
    Some([0, 1, 2].map(|k| m[k][3] / m[k][k]))
}
