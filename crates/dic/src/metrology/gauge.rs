//! The study of virtual strain gauges: the noise that is left over their length, and the waves that they flatten.

use super::theory::strain_period_by_size;
use crate::field::{ELEMENT_NOISE, Measurement, StrainDefinition, StrainField, StrainWindow, StrainWindows};
use crate::units::Px;
use serde::Serialize;

/// Nodes along the side of the windows that are looked at unless others are asked for, beside the element itself.
pub const STRAIN_WINDOWS: [u32; 5] = [3, 5, 7, 9, 11];
/// Gauges beside each other that must fit for their scatter about their own mean to count.
const LEAST_GAUGES: f64 = 4.0;

/// What the noise of strains was measured on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum StrainNoiseOn {
    /// Images of the specimen at rest.
    StaticImages,
    /// Copies of the reference, moved exactly, with noise of their own.
    MovedCopies,
}

/// A virtual strain gauge: strains from elements of one size over windows of one size.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StrainGauge {
    /// Side of the elements, px.
    pub element_size_px: usize,
    /// Nodes along the side of the window; 1 for the strain at the centre of an element.
    pub window_nodes: usize,
    /// Its length, px: [`StrainWindow::gauge_length`].
    pub gauge_length_px: f64,
    /// Standard deviation of exx, eyy and exy at rest, off the edge of the zone; `None` if too few fit or converged.
    pub noise_measured: Option<[f64; 3]>,
    /// Statistical uncertainty of that, per cent: `100 / sqrt(2 n)`, of gauges side by side in all pairs.
    pub statistical_percent: Option<f64>,
    /// The same as `correlate --strain-window` would predict it inside a zone. `None` when no node is left.
    pub noise_predicted: Option<[f64; 3]>,
    /// Shortest period from which on a wave of exx along x (eyy along y) keeps 90 % of its amplitude, px. Computed.
    pub period_along_px: f64,
    /// The same of a wave of exx along y (eyy along x). Computed.
    pub period_across_px: f64,
}

/// All of them.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StrainGauges {
    /// What the noise was measured on.
    pub measured_on: StrainNoiseOn,
    /// Size by size, window by window.
    pub gauges: Vec<StrainGauge>,
}

/// The windows of a study: none, for the element itself, and those over nodes.
pub(super) struct Windows {
    list: Vec<Option<StrainWindow>>,
    /// Of each: `sigma_exx l / sigma_ux` inside a zone, and the periods resolved, in element sizes.
    figures: Vec<(f64, [f64; 2])>,
    /// Whether the user has asked for them: those that do not fit are then listed, too.
    asked: bool,
}

impl Windows {
    pub fn new(asked: Option<&[StrainWindow]>) -> Self {
        let mut windows = match asked {
            Some(asked) => asked.to_vec(),
            None => STRAIN_WINDOWS.into_iter().filter_map(StrainWindow::new).collect(),
        };
        windows.sort_unstable_by_key(|window| window.nodes());
        windows.dedup();
        let list: Vec<_> = std::iter::once(None).chain(windows.into_iter().map(Some)).collect();
        let figures = list.iter().map(|&window| {
            let noise = window.map_or(ELEMENT_NOISE, StrainWindow::noise);
            (noise, [false, true].map(|across| strain_period_by_size(window, across)))
        });
        Self { figures: figures.collect(), list, asked: asked.is_some() }
    }

    /// The gauges on elements of `size` px, `least` nodes along a side, with inner uncertainty `sigma_px`.
    pub fn gauges(&self, size: usize, least: usize, sigma_px: Option<[f64; 2]>, found: &Sums) -> Vec<StrainGauge> {
        let side = size as f64;
        let gauge = |k: usize| {
            let (noise, [along, across]) = self.figures[k];
            let measured = found.0.get(k).and_then(Sum::deviation);
            StrainGauge {
                element_size_px: size,
                window_nodes: self.list[k].map_or(1, StrainWindow::nodes),
                gauge_length_px: self.list[k].map_or(side, |window| window.gauge_length(side)),
                noise_measured: measured,
                statistical_percent: measured.map(|_| 100.0 / (2.0 * found.0[k].gauges).sqrt()),
                noise_predicted: sigma_px.map(|[x, y]| [x, y, 0.5 * x.hypot(y)].map(|sigma| noise * sigma / side)),
                period_along_px: along * side,
                period_across_px: across * side,
            }
        };
        let fits = |k: &usize| self.asked || self.list[*k].is_none_or(|window| window.nodes() + 2 <= least);
        (0..self.list.len()).filter(fits).map(gauge).collect()
    }
}

/// Squares of the strains of one gauge, over pairs.
#[derive(Debug, Clone, Default, PartialEq)]
struct Sum {
    squares: [f64; 3],
    n: f64,
    /// Gauges that fit beside each other, over all pairs.
    gauges: f64,
}

impl Sum {
    fn deviation(&self) -> Option<[f64; 3]> {
        (self.n > 0.0).then(|| self.squares.map(|sum| (sum / self.n).sqrt()))
    }
}

/// What pairs of one element size say, window by window.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Sums(Vec<Sum>);

impl Sums {
    /// Adds a pair whose mean strain is known to be none, or one `about_mean`: a specimen at rest may have grown warmer.
    pub fn add(&mut self, windows: &Windows, field: &Measurement<Px>, about_mean: bool) {
        self.0.resize(windows.list.len(), Sum::default());
        let grid = Lattice::new(field);
        for (sum, &window) in self.0.iter_mut().zip(&windows.list) {
            let (strains, gauges) = grid.strains(field, window);
            let n = strains.len() as f64;
            if strains.is_empty() || (about_mean && gauges < LEAST_GAUGES) {
                continue;
            }
            // A mean of few gauges follows them.
            let few = if about_mean { gauges / (gauges - 1.0) } else { 1.0 };
            for c in 0..3 {
                let mean = if about_mean { strains.iter().map(|e| e[c]).sum::<f64>() / n } else { 0.0 };
                sum.squares[c] += few * strains.iter().map(|e| (e[c] - mean).powi(2)).sum::<f64>();
            }
            sum.n += n;
            sum.gauges += gauges;
        }
    }
}

/// The one rectangle of nodes that a metrology has.
pub(super) struct Lattice {
    /// Nodes along x and y.
    n: [usize; 2],
    /// Column and row of each node.
    places: Vec<[usize; 2]>,
    /// Nodes not measured in the columns and rows before: one more of both than there are nodes.
    missing: Vec<usize>,
}

impl Lattice {
    pub fn new(field: &Measurement<Px>) -> Self {
        let (mesh, size) = (&field.mesh, field.mesh.element_size());
        let low = [0, 1].map(|c| mesh.nodes().iter().map(|x| x[c]).fold(f64::INFINITY, f64::min));
        let places: Vec<[usize; 2]> =
            mesh.nodes().iter().map(|x| [0, 1].map(|c| ((x[c] - low[c]) / size).round() as usize)).collect();
        let n = [0, 1].map(|c| places.iter().map(|place| place[c] + 1).max().unwrap_or(0));
        let mut measured = vec![false; n[0] * n[1]];
        places.iter().zip(&field.measured).for_each(|(&[i, j], &there)| measured[j * n[0] + i] = there);
        let across = n[0] + 1;
        let mut missing = vec![0; across * (n[1] + 1)];
        for j in 0..n[1] {
            for i in 0..n[0] {
                let before = missing[(j + 1) * across + i] + missing[j * across + i + 1] - missing[j * across + i];
                missing[(j + 1) * across + i + 1] = before + usize::from(!measured[j * n[0] + i]);
            }
        }
        Self { n, places, missing }
    }

    /// Whether a node is an inner one, and measured.
    pub fn is_inner(&self, node: usize) -> bool {
        let place = self.places[node].map(|v| v as i64);
        self.is_whole(place, place)
    }

    /// Whether the nodes from column and row `low` to `high` are inner ones, and measured.
    fn is_whole(&self, low: [i64; 2], high: [i64; 2]) -> bool {
        if (0..2).any(|c| low[c] < 1 || high[c] + 2 > self.n[c] as i64) {
            return false;
        }
        let [[i0, j0], [i1, j1]] = [low, high.map(|v| v + 1)].map(|place| place.map(|v| v as usize));
        let at = |i: usize, j: usize| self.missing[j * (self.n[0] + 1) + i];
        at(i1, j1) + at(i0, j0) == at(i0, j1) + at(i1, j0)
    }

    /// The strains of gauges that see inner measured nodes only, and how many such gauges fit beside each other.
    fn strains(&self, field: &Measurement<Px>, window: Option<StrainWindow>) -> (Vec<[f64; 3]>, f64) {
        let definition = StrainDefinition::Infinitesimal;
        let nodes = window.map_or(1, StrainWindow::nodes);
        let found: Vec<[f64; 3]> = match window {
            None => {
                let whole = |nodes: &[u32; 4]| nodes.iter().all(|&node| self.is_inner(node as usize));
                let strains = StrainField::of(field, definition).elements.into_iter().zip(field.mesh.elements());
                strains.filter(|(_, nodes)| whole(nodes)).filter_map(|(e, _)| Some(e?.components())).collect()
            }
            Some(window) => {
                let reach = (nodes / 2) as i64;
                let whole = |place: &[usize; 2]| {
                    let place = place.map(|v| v as i64);
                    self.is_whole(place.map(|v| v - reach), place.map(|v| v + reach))
                };
                // For the values alone: what their noise is inside is known.
                let strains = StrainWindows::new(&field.mesh, window, true).of(field, definition).nodes;
                let strains = strains.into_iter().zip(&self.places).filter(|(_, place)| whole(place));
                strains.filter_map(|(at, _)| Some(at?.0.components())).collect()
            }
        };
        // Places along both axes; what holds with nodes missing in the middle as well.
        let all = self.n.map(|n| (n as f64 - if nodes == 1 { 3.0 } else { nodes as f64 + 1.0 }).max(0.0));
        let share = if all[0] * all[1] > 0.0 { found.len() as f64 / (all[0] * all[1]) } else { 0.0 };
        let beside = all.map(|n| 1.0 + (n - 1.0) / nodes as f64);
        (found, share * beside[0] * beside[1])
    }
}
