//! Brightness and contrast as smooth fields over a zone: gain and offset at the nodes of a coarse grid, bilinear
//! between them, fitted to the sums of the elements (docs/correlation.md, section 2.4).
//!
//! With `H = gain g + offset` the deformed image as brought to the reference so far and `m = (f + H) / 2`, the residual
//! is `f - H = gamma m + delta` where the light has changed. An element knows of it by the sums of `r = f - H` and of
//! `r m = (f^2 - H^2) / 2`: noise of f and of H has opposite signs there, so that it passes for no loss of contrast.

use crate::backend::{ElementMatch, ElementMoments, GreyTransfer, PixelSums};
use crate::correlate::upper_pairs;
use crate::linalg::{BlockJacobi, BlockMatrix, ElementMatrix, Pattern};
use crate::mesh::{Mesh, shape_functions};
use crate::units::Px;
use std::sync::Arc;

/// Brightness and contrast found in a zone as smooth fields.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SmoothLight {
    /// Nodes of the coarse grid along x and y.
    pub nodes: [usize; 2],
    /// Smallest and largest gain at a node of the mesh.
    pub gain: [f64; 2],
    /// Smallest and largest offset there, grey levels in the images' own scale.
    pub offset: [f64; 2],
    /// Whether it did not come to rest with the displacement: it stayed as it was after some iterations, and what it
    /// does not know is missing in the uncertainty of the displacement.
    pub unsettled: bool,
}

/// Cells of the coarsest grid, px; each finer one halves them.
const CELL_PX: f64 = 128.0;
/// Cells are not smaller than this, px: an edge of a shadow that is sharper is a misfit.
const SMALLEST_PX: f64 = 32.0;
/// Elements along a cell, at least: with fewer their sums do not tell a slope from a step.
const CELL_ELEMENTS: f64 = 2.0;
/// Cells may be smaller by this much than they should be, so that a zone is cut into whole ones.
const ROOM: f64 = 0.75;
/// A field is taken for light only when it lowers the sum of squares of the residual by this share: what is less
/// displaces nothing by a tenth of the noise's effect, and costs iterations.
const SHARE: f64 = 0.01;
/// A residual below this share of the contrast counts as this large: in images without noise it is that of the
/// interpolation, of which 1 % is no light.
const RESIDUAL: f64 = 0.01;
/// Standard normal quantile of the test: 1 % of series without light exceed it.
const ONE_PERCENT: f64 = 2.326;
/// Elements that correlate less than this say nothing about light.
const MATCHED: f64 = 0.5;
/// Weight of the differences between neighbouring nodes beside the mean data of a node: it holds nodes without data,
/// and being on the change of the field since the fit before it leaves no bias.
const HELD: f64 = 1e-3;

#[derive(Debug, Clone, Copy, PartialEq)]
struct Grid {
    corner: [f64; 2],
    size: [f64; 2],
    cells: [usize; 2],
    /// Nodes along x and y that the elements can tell apart.
    nodes: [usize; 2],
}

impl Grid {
    /// The grids that can be tried in a zone, the coarsest first.
    fn of_zone(mesh: &Mesh<Px>, zone: usize) -> Vec<Self> {
        let (bounds, element) = (mesh.bounds(zone), mesh.element_size());
        let size = [bounds.x1 - bounds.x0, bounds.y1 - bounds.y0];
        let smallest = ROOM * SMALLEST_PX.max(CELL_ELEMENTS * element);
        let mut grids = Vec::new();
        let mut cells = size.map(|size| (size / CELL_PX).round().max(1.0));
        loop {
            // An axis along which the elements are too few keeps the cells that it has.
            let nodes = [0, 1].map(|k| if size[k] / cells[k] < smallest { 1 } else { cells[k] as usize + 1 });
            let grid = Self { corner: [bounds.x0, bounds.y0], size, cells: cells.map(|n| n as usize), nodes };
            if nodes != [1, 1] {
                grids.push(grid);
            }
            let halved = [0, 1].map(|k| if size[k] / (2.0 * cells[k]) < smallest { cells[k] } else { 2.0 * cells[k] });
            if halved == cells {
                return grids;
            }
            cells = halved;
        }
    }

    fn n_nodes(&self) -> usize {
        (self.cells[0] + 1) * (self.cells[1] + 1)
    }

    fn elements(&self) -> Vec<[u32; 4]> {
        let across = self.cells[0] + 1;
        let corners = |cell: usize| {
            let first = cell / self.cells[0] * across + cell % self.cells[0];
            [first, first + 1, first + across + 1, first + across].map(|node| node as u32)
        };
        (0..self.cells[0] * self.cells[1]).map(corners).collect()
    }

    fn place(&self, at: [f64; 2]) -> (usize, [f64; 4]) {
        let [(i, s), (j, t)] = [0, 1].map(|k| {
            let along =
                ((at[k] - self.corner[k]) / self.size[k] * self.cells[k] as f64).clamp(0.0, self.cells[k] as f64);
            let cell = (along as usize).min(self.cells[k] - 1);
            (cell, along - cell as f64)
        });
        (j * self.cells[0] + i, shape_functions(s, t))
    }
}

#[derive(Debug, Clone, Copy)]
struct Said {
    /// Its middle, px.
    at: [f64; 2],
    n: f64,
    /// Covariance of f and H, times n: the signal.
    signal: f64,
    /// Mean of m less that of the zone.
    mean: f64,
    /// Sums of r, and of r (m - mean of m).
    residual: [f64; 2],
}

impl Said {
    /// Sums of r and r m that the change `[gamma, delta]` would give.
    fn of(&self, [gamma, delta]: [f64; 2]) -> [f64; 2] {
        [self.n * (gamma * self.mean + delta), self.signal * gamma]
    }

    /// The sum of squares that a gain and an offset of its own would take.
    fn squares(&self) -> f64 {
        self.residual[0].powi(2) / self.n + self.residual[1].powi(2) / self.signal
    }
}

struct Zone {
    said: Vec<Said>,
    /// Mean of m over the zone, and rms of the signal: units in which the fit is well conditioned.
    mean: f64,
    contrast: f64,
    /// Sum of squares of the residual, not below that of [`RESIDUAL`].
    squares: f64,
}

/// Values at the nodes of a grid, and what they leave.
struct Fitted {
    grid: Grid,
    /// `[gamma, delta]`, about the mean of the zone.
    values: Vec<[f64; 2]>,
    /// Sum of squares of the elements that is left.
    left: f64,
    unknowns: f64,
}

impl Zone {
    /// Reads the sums; `None` when nothing in the zone matches.
    fn new(&Seen { mesh, sums, transfer, variances, of_reference }: &Seen<'_>, zone: usize) -> Option<Self> {
        let elements = mesh.zone_elements(zone);
        let GreyTransfer { gain, offset } = transfer[zone];
        let matching = || elements.clone().filter(|&e| sums[e].n >= 2.0 && sums[e].correlation() >= MATCHED);
        let brought = |s: &PixelSums| {
            let h = gain * s.g + offset * s.n;
            [h, gain * (gain * s.gg + 2.0 * offset * s.g) + offset * offset * s.n, gain * s.fg + offset * s.f]
        };
        let (mut n, mut sum, mut signal, mut squares, mut damped) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for element in matching() {
            let s = &sums[element];
            let [h, _, fh] = brought(s);
            n += s.n;
            sum += 0.5 * (s.f + h);
            signal += fh - s.f * h / s.n;
            squares += s.rr;
            damped += s.n * variances[element];
        }
        if n <= 0.0 || signal <= 0.0 {
            return None;
        }
        // Half the difference of the noise of f and that of H, which interpolation damps where it falls between pixels.
        let noise = squares / (of_reference * n + gain * gain * damped);
        let mean = sum / n;
        let said = matching().filter_map(|element| {
            let s = &sums[element];
            let [h, hh, fh] = brought(s);
            let (r, m) = (s.f - h, 0.5 * (s.f + h) / s.n);
            let signal = fh - s.f * h / s.n;
            let of_noise = 0.5 * s.n * noise * (of_reference - gain * gain * variances[element]);
            let rm = 0.5 * (s.ff - hh) - of_noise;
            let corners = mesh.corners(element);
            let at = [0, 1].map(|k| corners.iter().map(|corner| corner[k]).sum::<f64>() / 4.0);
            let said = Said { at, n: s.n, signal, mean: m - mean, residual: [r, rm - m * r] };
            (signal > 0.0).then_some(said)
        });
        let squares = squares.max(RESIDUAL * RESIDUAL * signal);
        let mut zone = Self { said: said.collect(), mean, contrast: (signal / n).sqrt(), squares };
        zone.less_mean();
        Some(zone)
    }

    /// Takes out what the gain and offset of the zone have still to follow.
    fn less_mean(&mut self) {
        let (mut a, mut b) = ([0.0; 3], [0.0; 2]);
        for said in &self.said {
            a[0] += said.signal + said.n * said.mean * said.mean;
            a[1] += said.n * said.mean;
            a[2] += said.n;
            b[0] += said.residual[1] + said.mean * said.residual[0];
            b[1] += said.residual[0];
        }
        let determinant = a[0] * a[2] - a[1] * a[1];
        if determinant > 0.0 {
            let change = [(a[2] * b[0] - a[1] * b[1]) / determinant, (a[0] * b[1] - a[1] * b[0]) / determinant];
            self.said.iter_mut().for_each(|said| {
                let by_light = said.of(change);
                said.residual = [0, 1].map(|k| said.residual[k] - by_light[k]);
            });
        }
    }

    /// The smooth field on `grid` that leaves least.
    fn fit(&self, grid: Grid) -> Fitted {
        let cells = grid.elements();
        let pattern = Arc::new(Pattern::new(grid.n_nodes(), &cells));
        let mut matrices: Vec<ElementMatrix> = vec![[0.0; 36]; cells.len()];
        let mut rhs = vec![[0.0; 2]; grid.n_nodes()];
        let mut share = vec![0.0; grid.n_nodes()];
        let unit = self.contrast; // gamma in units of the contrast, so that both unknowns weigh the same
        for said in &self.said {
            let (cell, weights) = grid.place(said.at);
            let mean = said.mean / unit;
            let data = [said.signal / (unit * unit) + said.n * mean * mean, said.n * mean, said.n];
            for (value, (i, j)) in matrices[cell].iter_mut().zip(upper_pairs()) {
                *value += weights[i / 2] * weights[j / 2] * data[i % 2 + j % 2];
            }
            let residual = [said.residual[1] / unit + mean * said.residual[0], said.residual[0]];
            for (&node, weight) in cells[cell].iter().zip(weights) {
                let node = node as usize;
                share[node] += weight * weight;
                rhs[node] = [0, 1].map(|k| rhs[node][k] + weight * residual[k]);
            }
        }
        let held = HELD * self.said.iter().map(|said| said.n).sum::<f64>() / grid.n_nodes() as f64;
        // Differences along the four sides of a cell, and along its diagonals: corners a and b of opposite sign.
        for (value, (i, j)) in matrices.iter_mut().flat_map(|matrix| matrix.iter_mut().zip(upper_pairs())) {
            *value += match (i / 2 == j / 2, i % 2 == j % 2) {
                (true, true) => 3.0 * held,
                (false, true) => -held,
                _ => 0.0,
            };
        }
        let matrix = BlockMatrix::assemble(&pattern, &cells, &matrices);
        let (scaled, _) = BlockJacobi::new(&matrix).solve(&matrix, &rhs, 1e-6, 1000);
        let values: Vec<[f64; 2]> = scaled.into_iter().map(|[gamma, delta]| [gamma / unit, delta]).collect();
        let left = self.said.iter().map(|said| {
            let by_light = said.of(interpolate(&grid, &cells, &values, said.at));
            Said { residual: [0, 1].map(|k| said.residual[k] - by_light[k]), ..*said }.squares()
        });
        let left = left.sum();
        let seen = share.iter().filter(|&&share| share > 0.05).count();
        let unknowns = 2.0 * (grid.nodes[0] * grid.nodes[1]).min(seen) as f64;
        Fitted { grid, values, left, unknowns }
    }

    /// Whether `finer` leaves significantly less than `left` with `unknowns`, tested on elements, whose scatter about
    /// the field has all that is correlated within them: neither coloured noise nor misfit passes for light.
    fn is_better(&self, finer: &Fitted, left: f64, unknowns: f64) -> bool {
        let lowered = left - finer.left;
        let [more, rest] = [finer.unknowns - unknowns, 2.0 * self.said.len() as f64 - finer.unknowns];
        lowered > SHARE * self.squares
            && more > 0.0
            && rest >= more.min(8.0)
            && rest > 0.0
            && is_significant((lowered / more) / (finer.left / rest), more, rest)
    }

    /// The significant field that the elements ask for; with `always` at least that on the coarsest grid.
    fn choose_field(&self, mesh: &Mesh<Px>, zone: usize, always: bool) -> Option<Fitted> {
        let mut best: Option<Fitted> = None;
        for grid in Grid::of_zone(mesh, zone) {
            let fitted = self.fit(grid);
            let enough = 2.0 * self.said.len() as f64 > fitted.unknowns;
            let better = match &best {
                None if always && enough => true,
                None => self.is_better(&fitted, self.said.iter().map(Said::squares).sum(), 2.0),
                Some(best) => self.is_better(&fitted, best.left, best.unknowns),
            };
            if better {
                best = Some(fitted);
            }
        }
        best
    }

    /// The field on `grid`, or the next finer one if significantly better, as may show once the displacement settles.
    fn refine_field(&self, mesh: &Mesh<Px>, zone: usize, grid: Grid) -> Fitted {
        let fitted = self.fit(grid);
        let finer = Grid::of_zone(mesh, zone).into_iter().find(|finer| finer.n_nodes() > grid.n_nodes());
        match finer.map(|finer| self.fit(finer)) {
            Some(finer) if self.is_better(&finer, fitted.left, fitted.unknowns) => finer,
            _ => fitted,
        }
    }
}

fn interpolate(grid: &Grid, cells: &[[u32; 4]], values: &[[f64; 2]], at: [f64; 2]) -> [f64; 2] {
    let (cell, weights) = grid.place(at);
    let mut value = [0.0; 2];
    for (&node, weight) in cells[cell].iter().zip(weights) {
        value = [0, 1].map(|k| value[k] + weight * values[node as usize][k]);
    }
    value
}

/// Whether a ratio of variances exceeds the 99 % quantile of F with `more` and `rest` degrees of freedom, by Paulson's
/// approximation (Annals of Mathematical Statistics 13, 1942), good to 1 % from three of them on.
fn is_significant(ratio: f64, more: f64, rest: f64) -> bool {
    let (a, b) = (2.0 / (9.0 * more), 2.0 / (9.0 * rest));
    let root = ratio.max(0.0).cbrt();
    ratio == f64::INFINITY || (1.0 - b) * root - (1.0 - a) > ONE_PERCENT * (b * root * root + a).sqrt()
}

/// Whether the elements' own gains and offsets would lower the residual by enough for any smooth field to: what they
/// would take beyond noise, from how each matched. What fails this needs no sums of the elements.
pub(crate) fn is_suspected(mesh: &Mesh<Px>, elements: &[ElementMatch], moments: &[ElementMoments]) -> bool {
    (0..mesh.zones().len()).any(|zone| {
        let (mut squares, mut own, mut n, mut count, mut signal) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for element in mesh.zone_elements(zone) {
            let (found, moments) = (&elements[element], &moments[element]);
            if found.n < 2.0 || found.correlation < MATCHED || moments.n <= 0.0 {
                continue;
            }
            let variance = (moments.ff - moments.f * moments.f / moments.n) / moments.n;
            let of_element = found.n * found.residual_rms.powi(2);
            squares += of_element;
            own += of_element - found.n * variance * (1.0 - found.correlation.powi(2));
            signal += found.n * variance;
            n += found.n;
            count += 1.0;
        }
        let least = f64::max(squares, RESIDUAL * RESIDUAL * signal);
        own > 0.5 * SHARE * least + 2.0 * count * squares / f64::max(n, 1.0)
    })
}

/// The light of all zones while a frame is iterated.
pub(crate) struct Light {
    /// The grid of each zone; none where the transfer of the zone is enough.
    grids: Vec<Option<Grid>>,
    /// At the nodes of the mesh: before the transfer of the zone.
    pub nodes: Vec<GreyTransfer>,
    /// Whether it stays as it is.
    pub is_held: bool,
}

pub(crate) struct Seen<'a> {
    pub mesh: &'a Mesh<Px>,
    /// Per element.
    pub sums: &'a [PixelSums],
    /// Per zone.
    pub transfer: &'a [GreyTransfer],
    /// Variance of the interpolated noise per element, in that of one image.
    pub variances: &'a [f64],
    /// Variance of the reference's noise, in that of one image.
    pub of_reference: f64,
}

impl Light {
    /// The light that the elements ask for; `None` if transfers of zones will do, with `always` if nothing matches.
    pub fn find(seen: &Seen<'_>, always: bool) -> Option<Self> {
        let n_zones = seen.mesh.zones().len();
        let nodes = vec![GreyTransfer::NONE; seen.mesh.n_nodes()];
        let mut light = Self { grids: vec![None; n_zones], nodes, is_held: false };
        for zone in 0..n_zones {
            let Some(said) = Zone::new(seen, zone) else { continue };
            if let Some(fitted) = said.choose_field(seen.mesh, zone, always) {
                light.change(seen, zone, &said, &fitted);
            }
        }
        light.grids.iter().any(Option::is_some).then_some(light)
    }

    pub fn follow(&mut self, seen: &Seen<'_>) {
        for zone in 0..self.grids.len() {
            if let (Some(grid), Some(said)) = (self.grids[zone], Zone::new(seen, zone)) {
                self.change(seen, zone, &said, &said.refine_field(seen.mesh, zone, grid));
            }
        }
    }

    fn change(&mut self, seen: &Seen<'_>, zone: usize, said: &Zone, fitted: &Fitted) {
        let cells = fitted.grid.elements();
        let GreyTransfer { gain, offset } = seen.transfer[zone];
        let after = |node: usize| {
            let [gamma, delta] = interpolate(&fitted.grid, &cells, &fitted.values, seen.mesh.nodes()[node]);
            let before = self.nodes[node];
            // f = H + gamma m + delta with m = (f + H) / 2, in which m counts from the mean of the zone.
            let factor = (1.0 + 0.5 * gamma) / (1.0 - 0.5 * gamma);
            let added = (delta - gamma * said.mean) / (1.0 - 0.5 * gamma);
            let after = GreyTransfer {
                gain: factor * before.gain,
                offset: factor * before.offset + ((factor - 1.0) * offset + added) / gain,
            };
            // No change of light turns dark into bright, nor does it darken to nothing.
            let sensible = gamma.abs() < 1.5 && after.gain.is_finite() && after.offset.is_finite();
            sensible.then_some(after)
        };
        let nodes = seen.mesh.zone_nodes(zone);
        // Where one of them makes no sense the light stays as it was.
        if let Some(all) = nodes.clone().map(after).collect::<Option<Vec<GreyTransfer>>>() {
            self.nodes[nodes].copy_from_slice(&all);
            self.grids[zone] = Some(fitted.grid);
        }
    }

    /// Unknowns of a zone beside those of its transfer.
    pub fn unknowns(&self, zone: usize) -> f64 {
        self.grids[zone].map_or(0.0, |grid| 2.0 * (grid.nodes[0] * grid.nodes[1]) as f64 - 2.0)
    }

    /// Mean over a zone of its light with the transfer that follows, and the range of both; gains are about the
    /// series' offset in the mean, and `own_scale` says what an offset is in the images' scale.
    pub fn of_zone(
        &self,
        mesh: &Mesh<Px>,
        zone: usize,
        transfer: GreyTransfer,
        own_scale: impl Fn(GreyTransfer) -> f64,
    ) -> (GreyTransfer, Option<SmoothLight>) {
        let Some(grid) = self.grids[zone] else { return (transfer, None) };
        let GreyTransfer { gain, offset } = transfer;
        let nodes = &self.nodes[mesh.zone_nodes(zone)];
        let all = || nodes.iter().map(|t| GreyTransfer { gain: gain * t.gain, offset: gain * t.offset + offset });
        let n = nodes.len() as f64;
        let mean = GreyTransfer {
            gain: all().map(|t| t.gain).sum::<f64>() / n,
            offset: all().map(|t| t.offset).sum::<f64>() / n,
        };
        let none = [f64::INFINITY, f64::NEG_INFINITY];
        let wider = |[low, high]: [f64; 2], v: f64| [low.min(v), high.max(v)];
        let gain = all().fold(none, |range, t| wider(range, t.gain));
        let offset = all().fold(none, |range, t| wider(range, own_scale(t)));
        (mean, Some(SmoothLight { nodes: grid.nodes, gain, offset, unsettled: self.is_held }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Roi, Zone as Region};

    #[test]
    fn the_quantile_of_the_test_is_that_of_tables() {
        // F at 99 %, Abramowitz and Stegun, table 26.9.
        for (more, rest, quantile) in [(4.0, 20.0, 4.43), (10.0, 20.0, 3.37), (30.0, 120.0, 1.86), (120.0, 120.0, 1.53)]
        {
            assert!(is_significant(1.02 * quantile, more, rest), "F({more}, {rest})");
            assert!(!is_significant(0.98 * quantile, more, rest), "F({more}, {rest})");
        }
        assert!(!is_significant(f64::NAN, 4.0, 20.0));
    }

    fn grids(roi: [f64; 4], element: usize) -> Vec<[usize; 2]> {
        let [x0, y0, x1, y1] = roi;
        let zone = Region::rectangle("all", Roi { x0, y0, x1, y1 });
        let mesh = Mesh::on_zones(&[zone], element, 1024, 1024).unwrap();
        Grid::of_zone(&mesh, 0).iter().map(|grid| grid.nodes).collect()
    }

    #[test]
    fn a_grid_has_cells_of_two_elements_at_least_and_no_node_that_they_cannot_tell() {
        assert_eq!(grids([0.0, 0.0, 512.0, 256.0], 16), [[5, 3], [9, 5], [17, 9]]);
        assert_eq!(grids([0.0, 0.0, 512.0, 256.0], 32), [[5, 3], [9, 5]]);
        // A strip of one element knows no gradient across it.
        assert_eq!(grids([0.0, 0.0, 256.0, 16.0], 16), [[3, 1], [5, 1], [9, 1]]);
        assert_eq!(grids([0.0, 0.0, 16.0, 16.0], 16), [[0; 2]; 0]);
    }
}
