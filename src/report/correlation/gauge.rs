//! Noise and strain against the length of the virtual strain gauge.

use super::{CorrelationReport, DrawnFrame};
use crate::field::{ELEMENT_NOISE, Elements, Measurement, StrainWindow, StrainWindows, TensorStrain};
use crate::report::page::{Block, Section};
use crate::report::scale::percentiles;
use crate::report::words::significant;
use crate::report::{Axis, Plot, PlotSeries, ReportError, Style};
use crate::units::Px;

/// The windows of the study.
const WINDOWS: [u32; 4] = [3, 5, 7, 9];
/// On meshes with more nodes the largest windows are left out.
const LARGE: usize = 60_000;
/// Scatter of the first frame above the noise at which it is said not to be at rest.
const AT_REST: f64 = 1.5;

/// One length of the gauge.
struct Row {
    nodes: usize,
    length_px: f64,
    /// Standard uncertainty of exx and eyy, from that of the displacements.
    noise: [f64; 2],
    /// Scatter of exx and eyy in the first frame with a field.
    scatter: Option<[f64; 2]>,
    /// 99th percentile of the largest principal strain in the last frame.
    peak: Option<f64>,
}

/// The middle one of `values`, or the upper of two; `None` without values.
fn median(mut values: Vec<f64>) -> Option<f64> {
    let at = values.len() / 2;
    (at < values.len()).then(|| *values.select_nth_unstable_by(at, f64::total_cmp).1)
}

/// Standard deviation of the bulk: of normal ones that of all.
fn scatter(strains: &[TensorStrain]) -> Option<[f64; 2]> {
    let of = |c: usize| {
        let values: Vec<f64> = strains.iter().map(|e| e.components()[c]).collect();
        let middle = median(values.clone())?;
        Some(1.4826 * median(values.into_iter().map(|v| (v - middle).abs()).collect())?)
    };
    Some([of(0)?, of(1)?])
}

/// The 99th percentile of the principal strain of largest size.
fn peak(strains: &[TensorStrain]) -> Option<f64> {
    let principal = |e: &TensorStrain| {
        let (mean, radius) = (0.5 * (e.xx + e.yy), (0.5 * (e.xx - e.yy)).hypot(e.xy));
        mean.abs() + radius
    };
    percentiles(strains.iter().map(principal).collect()).map(|[_, high]| high)
}

/// Standard uncertainty of the displacements of a field, x and y: medians over its nodes.
pub(super) fn median_sigma(field: &Measurement<Px>) -> Option<[f64; 2]> {
    let of = |c: usize| {
        let known = field.sigma.iter().zip(&field.measured).filter(|(_, measured)| **measured);
        median(known.map(|(sigma, _)| sigma[c]).collect())
    };
    Some([of(0)?, of(1)?])
}

impl CorrelationReport<'_> {
    pub(super) fn gauge(&self) -> Result<Option<Section>, ReportError> {
        let (Some(first), Some(last)) = (self.drawn.first(), self.drawn.last()) else { return Ok(None) };
        let Some(rows) = self.rows(first, last) else { return Ok(None) };
        let definition = last.strain.definition;
        let mut blocks = vec![Block::Text(format!(
            "A strain is a mean over a length, the virtual strain gauge L_VSG = (N - 1) L_step + L_subset, with the element size \
             for step and subset: N elements for a window of N x N nodes, one element for that of the element itself. A longer \
             gauge has less noise and flattens peaks: take the longest at which the peak still stands. Strain: {definition}, {}.",
            definition.formula()
        ))];
        if self.is_regularised() {
            blocks.push(Block::text(
                "A regularisation or splines bind the nodes to each other, which correlates their noise: the noise below is that of \
                 nodes that are not, more than there is, and the cut-off length, or the distance of the knots, takes part in the \
                 length of the gauge.",
            ));
        }
        let number = |v: Option<f64>| v.map_or("-".to_owned(), |v| format!("{v:.2e}"));
        let pair = |v: Option<[f64; 2]>| v.map_or("-".to_owned(), |[x, y]| format!("{x:.1e}, {y:.1e}"));
        let own = rows[0].peak;
        let cells = |row: &Row| {
            vec![
                if row.nodes == 1 { "element".to_owned() } else { row.nodes.to_string() },
                self.length(row.length_px),
                pair(Some(row.noise)),
                pair(row.scatter),
                number(row.peak),
                own.zip(row.peak).map_or("-".to_owned(), |(own, peak)| significant(peak / own, 3)),
            ]
        };
        let columns: [&str; 6] = [
            "window N",
            "gauge length",
            &format!("noise of exx, eyy (from sigma, frame {})", first.number),
            &format!("scatter of exx, eyy in frame {}", first.number),
            &format!("peak strain, frame {}", last.number),
            "of the element's",
        ];
        blocks.push(Block::table(&columns, rows.iter().map(cells)));
        blocks.push(Block::text(
            "Noise: median standard uncertainty, inside a zone. Scatter: of the bulk of the frame (1.48 times the median absolute \
             deviation), the noise floor where the specimen is at rest. Peak: 99th percentile of the largest principal strain by \
             size, without hatched places; of a short gauge it holds noise.",
        ));
        blocks.extend(rest_of(&rows, first.number).map(Block::warning));
        blocks.push(Block::Grid(vec![curves(&rows, self.drawn)?]));
        Ok(Some(Section { title: "Strain, and the length it is measured over".into(), blocks }))
    }

    /// Whether the displacement was held by something beside the images.
    pub(super) fn is_regularised(&self) -> bool {
        let options = &self.case.correlation;
        options.cutoff_px.is_some() || options.elements == Some(Elements::CubicSpline)
    }

    fn rows(&self, first: &DrawnFrame, last: &DrawnFrame) -> Option<Vec<Row>> {
        let sigma = median_sigma(&first.field)?;
        // Those that the maps hatch say nothing of the length.
        let known = |frame: &DrawnFrame| -> Vec<TensorStrain> {
            let (doubtful, elements) = (frame.field.doubtful(), frame.field.mesh.elements().iter());
            let is_sure = |nodes: &[u32; 4]| !nodes.iter().any(|&node| doubtful[node as usize]);
            frame.strain.elements.iter().zip(elements).filter_map(|(e, nodes)| e.filter(|_| is_sure(nodes))).collect()
        };
        let mut rows = vec![Row {
            nodes: 1,
            length_px: self.element_px,
            noise: sigma.map(|sigma| ELEMENT_NOISE * sigma / self.element_px),
            scatter: scatter(&known(first)),
            peak: peak(&known(last)),
        }];
        let n_nodes = last.field.mesh.n_nodes();
        let sizes = WINDOWS.into_iter().filter(|&window| window <= 5 || n_nodes <= LARGE);
        for window in sizes.filter_map(StrainWindow::new) {
            let windows = StrainWindows::new(&last.field.mesh, window, true);
            let strains = |frame: &DrawnFrame| -> Vec<TensorStrain> {
                // The values alone: what their noise is inside is known.
                let found = windows.values(&frame.field, last.strain.definition);
                let sure = found.into_iter().zip(frame.field.doubtful()).filter(|(_, doubtful)| !doubtful);
                sure.filter_map(|(at, _)| at).collect()
            };
            let of_last = strains(last);
            if of_last.is_empty() {
                break;
            }
            rows.push(Row {
                nodes: window.nodes(),
                length_px: window.gauge_length(self.element_px),
                noise: sigma.map(|sigma| window.noise() * sigma / self.element_px),
                scatter: scatter(&strains(first)),
                peak: peak(&of_last),
            });
        }
        Some(rows)
    }
}

/// What to say of a first frame that is not at rest, or noisier than its standard uncertainty.
fn rest_of(rows: &[Row], number: usize) -> Option<String> {
    let (own, longest) = (rows.first()?, rows.last()?);
    let ratio = |row: &Row| {
        let of = row.scatter?;
        Some((of[0] / row.noise[0]).max(of[1] / row.noise[1]))
    };
    let (short, long) = (ratio(own)?, ratio(longest)?);
    (short > AT_REST || long > AT_REST).then(|| {
        format!(
            "The strain of frame {number} scatters {} times as much as its noise (element), {} times over {} nodes: the specimen was \
             strained already, or the frame holds errors that are not noise. For a noise floor take a frame at rest.",
            significant(short, 2),
            significant(long, 2),
            longest.nodes
        )
    })
}

fn curves(rows: &[Row], drawn: &[DrawnFrame]) -> Result<Block, ReportError> {
    let lengths: Vec<f64> = rows.iter().map(|row| row.length_px).collect();
    let series = |name: &str, of: &dyn Fn(&Row) -> f64| {
        PlotSeries::new(name, Style::LineAndMarkers, lengths.clone(), rows.iter().map(of).collect())
    };
    let series = [
        series("noise", &|row| row.noise[0].max(row.noise[1])),
        series("scatter at first", &|row| row.scatter.map_or(f64::NAN, |[x, y]| x.max(y))),
        series("peak at last", &|row| row.peak.unwrap_or(f64::NAN)),
    ];
    let title = "Noise and peak against the length of the gauge";
    let plot = Plot::new(title, "virtual strain gauge (px)", Axis::log("strain"), series);
    let numbers: Vec<String> = drawn.iter().map(|frame| frame.number.to_string()).collect();
    Block::curves(&plot, format!("The larger of exx and eyy; frames {}", numbers.join(", ")))
}
