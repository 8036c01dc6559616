//! Cracks over a series: what `summary.json` holds of them, and their figures.

use super::{Axis, Name, Plot, PlotSeries, Style};
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

/// The figures of a crack, each with the name of its file: opening along it in some frames, and its tips over the
/// frames.
pub fn crack_figures(history: &CrackHistory) -> Vec<(String, Plot)> {
    let plain = |c: char| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    let file: String = history.name.chars().map(plain).collect();
    let with_places: Vec<&CrackFrame> = history.frames.iter().filter(|frame| !frame.places.is_empty()).collect();
    let n = with_places.len();
    let chosen = (0..n.min(PROFILES)).map(|k| with_places[n - 1 - k * n / n.clamp(1, PROFILES)]);
    let mut profiles: Vec<PlotSeries> = chosen
        .map(|CrackFrame { number, places, .. }| {
            let x = places.iter().map(|(along, _)| *along).collect();
            let y = places.iter().map(|(_, jump)| jump.opening.value).collect();
            let band = places.iter().map(|(_, jump)| 2.0 * jump.opening.sigma).collect();
            PlotSeries::new(format!("frame {number}"), Style::LineAndMarkers, x, y).with_band(band)
        })
        .collect();
    profiles.reverse();
    let mut figures = Vec::new();
    if !profiles.is_empty() {
        let plot = Plot {
            title: format!("{}: opening along the path", history.name),
            x: Axis::linear("distance along the path (px)"),
            y: Axis::linear("opening (px)"),
            series: profiles,
            notes: vec!["bars: \u{b1}2 standard uncertainties".into()],
            ..Plot::default()
        };
        figures.push((format!("{file}-opening"), plot));
    }
    let over = |end: usize, value: &dyn Fn(&CrackTip) -> Option<Value>| {
        let found: Vec<(f64, Value)> = history
            .frames
            .iter()
            .flat_map(|frame| frame.tips.iter().map(|tip| (frame.number as f64, tip)))
            .filter(|(_, tip)| tip.end == end)
            .filter_map(|(number, tip)| Some((number, value(tip)?)))
            .collect();
        let x = found.iter().map(|(number, _)| *number).collect();
        let y = found.iter().map(|(_, value)| value.value).collect();
        let band = found.iter().map(|(_, value)| 2.0 * value.sigma).collect();
        (found.len() > 1).then_some((x, y, band))
    };
    let series = |name: &str, value: &dyn Fn(&CrackTip) -> Option<Value>| {
        let of_end = |end: usize| {
            let (x, y, band): (Vec<f64>, Vec<f64>, Vec<f64>) = over(end, value)?;
            let end = if end == 0 { "first end" } else { "last end" };
            Some(PlotSeries::new(format!("{name} {end}"), Style::Markers, x, y).with_band(band))
        };
        (0..2).filter_map(of_end).collect::<Vec<_>>()
    };
    let place = |tip: &CrackTip| tip.along.filter(|_| tip.state == TipState::Found);
    let limit = |tip: &CrackTip| tip.along.filter(|_| tip.state == TipState::OpenToEnd);
    let tips = [series("tip,", &place), series("open to the", &limit)].concat();
    if !tips.is_empty() {
        let plot = Plot {
            title: format!("{}: tip over the series", history.name),
            x: Axis::linear("frame"),
            y: Axis::linear("distance along the path (px)"),
            series: tips,
            notes: vec![format!("tip: opening below {OPEN_BY_SIGMA} sigma; bars: \u{b1}2 standard uncertainties")],
            ..Plot::default()
        };
        figures.push((format!("{file}-tip"), plot));
    }
    let modes =
        [series("K_I,", &|tip| Some(tip.intensity?.k1)), series("K_II,", &|tip| Some(tip.intensity?.k2))].concat();
    if !modes.is_empty() {
        let plot = Plot {
            title: format!("{}: stress intensity over the series", history.name),
            x: Axis::linear("frame"),
            y: Axis::linear("K (MPa \u{221a}m)"),
            series: modes,
            notes: vec!["interaction integral, plane stress; bars: \u{b1}2 standard uncertainties".into()],
            ..Plot::default()
        };
        figures.push((format!("{file}-stress-intensity"), plot));
    }
    figures
}
