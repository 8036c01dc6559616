//! Cracks over a series: what `summary.json` holds of them, and their figures.

use super::{Name, Plot, PlotSeries, Style};
use crate::field::{CrackTip, OPEN_BY_SIGMA, TipState, Value};
use crate::io::quantities::{CrackFrame, CrackHistory};
use serde::{Deserialize, Serialize};

/// A crack along which the mesh is cut. The openings along it are in `quantities/cracks.csv`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CrackSummary {
    /// Its name.
    pub name: String,
    /// Frame by frame: its largest opening and its tips. Frames without a field are absent.
    pub frames: Vec<CrackFrameSummary>,
}

/// A crack in one frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CrackFrameSummary {
    /// Number of the frame.
    pub number: usize,
    /// The largest opening; absent when none is measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub largest_opening_px: Option<f64>,
    /// Its standard uncertainty.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sigma_largest_opening_px: Option<f64>,
    /// One for each end of the path inside the mesh.
    pub tips: Vec<CrackTipSummary>,
}

/// The tip of a crack in one frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CrackTipSummary {
    /// The end of the path that it belongs to: `first` or `last`.
    pub end: Name,
    /// `found`; `open_to_end`: at the end of the path, or further on; `closed`: nowhere open.
    pub state: Name,
    /// Distance along the path from its first point.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub along_px: Option<f64>,
    /// Its standard uncertainty.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sigma_along_px: Option<f64>,
    /// Place in the reference image.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at_px: Option<[f64; 2]>,
    /// Stress intensity of the opening mode, with its standard uncertainty.
    #[serde(rename = "K_I_MPa_sqrt_m", default, skip_serializing_if = "Option::is_none")]
    pub k1: Option<[f64; 2]>,
    /// That of the sliding mode.
    #[serde(rename = "K_II_MPa_sqrt_m", default, skip_serializing_if = "Option::is_none")]
    pub k2: Option<[f64; 2]>,
    /// Outer radius of the domain that both are found in.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub radius_px: Option<f64>,
}

impl CrackSummary {
    /// From what a series gave.
    pub fn of(history: &CrackHistory) -> Self {
        let frame = |CrackFrame { number, places, tips, .. }: &CrackFrame| {
            let largest = places.iter().map(|(_, jump)| jump.opening).max_by(|a, b| a.value.total_cmp(&b.value));
            CrackFrameSummary {
                number: *number,
                largest_opening_px: largest.map(|opening| opening.value),
                sigma_largest_opening_px: largest.map(|opening| opening.sigma),
                tips: tips.iter().map(CrackTipSummary::of).collect(),
            }
        };
        Self { name: history.name.clone(), frames: history.frames.iter().map(frame).collect() }
    }
}

impl CrackTipSummary {
    fn of(tip: &CrackTip) -> Self {
        let pair = |value: Value| [value.value, value.sigma];
        Self {
            end: if tip.end == 0 { "first" } else { "last" }.into(),
            state: tip.state.name().into(),
            along_px: tip.along.map(|along| along.value),
            sigma_along_px: tip.along.map(|along| along.sigma),
            at_px: tip.at,
            k1: tip.intensity.map(|k| pair(k.k1)),
            k2: tip.intensity.map(|k| pair(k.k2)),
            radius_px: tip.intensity.map(|k| k.radius),
        }
    }
}

/// Frames whose profiles are drawn, at most.
const PROFILES: usize = 6;

/// The figures of a crack with the names of their files: opening along it in some frames, its tips over the frames.
pub fn crack_figures(history: &CrackHistory) -> Vec<(String, Plot)> {
    let plain = |c: char| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    let file: String = history.name.chars().map(plain).collect();
    let with_places: Vec<&CrackFrame> = history.frames.iter().filter(|frame| !frame.places.is_empty()).collect();
    let n = with_places.len();
    let chosen = (0..n.min(PROFILES)).map(|k| with_places[n - 1 - k * n / n.clamp(1, PROFILES)]);
    let mut profiles: Vec<PlotSeries> = chosen
        .map(|CrackFrame { number, places, .. }| {
            let points = places.iter().map(|(along, jump)| (*along, jump.opening));
            with_bars(format!("frame {number}"), Style::LineAndMarkers, points)
        })
        .collect();
    profiles.reverse();
    let series = |name: &str, value: &dyn Fn(&CrackTip) -> Option<Value>| {
        let of_end = |(end, which): (usize, &str)| {
            let tips = history.frames.iter().flat_map(|frame| frame.tips.iter().map(|tip| (frame.number as f64, tip)));
            let of_end = tips.filter(|(_, tip)| tip.end == end);
            let points = of_end.filter_map(|(number, tip)| Some((number, value(tip)?)));
            let series = with_bars(format!("{name} {which} end"), Style::Markers, points);
            (series.x.len() > 1).then_some(series)
        };
        ["first", "last"].into_iter().enumerate().filter_map(of_end).collect::<Vec<_>>()
    };
    let place = |tip: &CrackTip| tip.along.filter(|_| tip.state == TipState::Found);
    let limit = |tip: &CrackTip| tip.along.filter(|_| tip.state == TipState::OpenToEnd);
    let tips = [series("tip,", &place), series("open to the", &limit)].concat();
    let modes =
        [series("K_I,", &|tip| Some(tip.intensity?.k1)), series("K_II,", &|tip| Some(tip.intensity?.k2))].concat();
    let along = "distance along the path (px)";
    let below = format!("tip: opening below {OPEN_BY_SIGMA} sigma; ");
    let figures = [
        ("opening", "opening along the path", along, "opening (px)", profiles, ""),
        ("tip", "tip over the series", "frame", along, tips, below.as_str()),
        (
            "stress-intensity",
            "stress intensity over the series",
            "frame",
            "K (MPa \u{221a}m)",
            modes,
            "interaction integral, plane stress; ",
        ),
    ];
    let drawn = figures.into_iter().filter(|(.., series, _)| !series.is_empty());
    let plot = |(ending, title, x, y, series, note): (_, _, _, _, Vec<PlotSeries>, _)| {
        let plot = Plot::new(format!("{}: {title}", history.name), x, y, series);
        (format!("{file}-{ending}"), plot.with_note(format!("{note}bars: \u{b1}2 standard uncertainties")))
    };
    drawn.map(plot).collect()
}

/// Points with bars of two standard uncertainties.
fn with_bars(name: String, style: Style, points: impl Iterator<Item = (f64, Value)>) -> PlotSeries {
    let (x, values): (Vec<f64>, Vec<Value>) = points.unzip();
    let bars = values.iter().map(|value| 2.0 * value.sigma).collect();
    PlotSeries::new(name, style, x, values.iter().map(|value| value.value).collect()).with_band(bars)
}
