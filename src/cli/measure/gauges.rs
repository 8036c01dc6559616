//! The study of virtual strain gauges of `quadrille metrology`: table, CSV file and figure.

use crate::cli::talk::wrapped;
use crate::cli::{file_name, plural};
use crate::metrology::{Metrology, StrainGauge, StrainNoiseOn};
use crate::report::{Axis, Plot, PlotSeries, Style};
use std::io::{self, Write};
use std::path::Path;

/// Strains are small numbers: shown in millionths.
const MICRO: f64 = 1e6;

/// What the noise was measured on, in words.
fn measured_on(found: &Metrology) -> String {
    match found.strain_gauges.measured_on {
        StrainNoiseOn::StaticImages => plural(found.noise.pairs.len(), "static image"),
        StrainNoiseOn::MovedCopies => "moved copies".into(),
    }
}

/// A strain in millionths, three figures.
fn micro(strain: f64) -> String {
    let value = strain * MICRO;
    let digits = if value < 10.0 { 2 } else { usize::from(value < 100.0) };
    format!("{value:.digits$}")
}

fn micros(strains: Option<[f64; 3]>) -> [String; 3] {
    strains.map_or([(); 3].map(|()| "-".into()), |strains| strains.map(micro))
}

/// The element size whose gauges are printed when none were asked for: the recommended one, else the largest with a
/// result.
fn size_shown(found: &Metrology) -> Option<usize> {
    let gauges = &found.strain_gauges.gauges;
    let last = || gauges.iter().rev().find(|gauge| gauge.noise_predicted.is_some()).map(|gauge| gauge.element_size_px);
    found.advice.element_size_px.or_else(last)
}

/// Prints the gauges: of all element sizes (`all`), or of one.
pub(crate) fn print(found: &Metrology, all: bool) {
    let gauges = &found.strain_gauges.gauges;
    let Some(one) = size_shown(found) else { return };
    println!();
    println!("virtual strain gauges: standard deviation, 1e-6, measured on {}", measured_on(found));
    println!("element window gauge |      measured       |  predicted inside   | resolved, px");
    println!("size px  nodes    px |   exx    eyy    exy |   exx    eyy    exy | along across");
    for gauge in gauges.iter().filter(|gauge| all || gauge.element_size_px == one) {
        let [[a, b, c], [d, e, f]] = [gauge.noise_measured, gauge.noise_predicted].map(micros);
        println!(
            "{:7} {:>6} {:>5.0} |{a:>6} {b:>6} {c:>6} |{d:>6} {e:>6} {f:>6} |{:>6.0} {:>6.0}",
            gauge.element_size_px,
            if gauge.window_nodes == 1 { "-".to_owned() } else { gauge.window_nodes.to_string() },
            gauge.gauge_length_px,
            gauge.period_along_px,
            gauge.period_across_px,
        );
    }
    let say = |text: &str| println!("{}", wrapped(text, 2));
    say(
        "  gauge length (N - 1) L_step + L_subset, both the element size; without a window the strain of the element; \
         resolved: computed, from these periods on a wave of exx along x, along y keeps 90 % of its amplitude",
    );
    let sizes: std::collections::BTreeSet<usize> = gauges.iter().map(|gauge| gauge.element_size_px).collect();
    if !all && sizes.len() > 1 {
        say("  other element sizes: --element-sizes, or strain_gauges.csv of --output");
    }
}

/// Writes `strain_gauges.csv`.
pub(crate) fn write(out: &mut impl Write, found: &Metrology, reference: &Path) -> io::Result<()> {
    writeln!(out, "# quadrille {}; virtual strain gauges of {}", env!("CARGO_PKG_VERSION"), reference.display())?;
    writeln!(
        out,
        "# noise: standard deviation of exx, eyy, exy (tensor shear) in 1e-6; measured on {}, as correlate predicts it inside a zone",
        measured_on(found)
    )?;
    writeln!(
        out,
        "# period_along_px, period_across_px: from these periods on a wave of exx along x, along y keeps 90 % of its amplitude; computed"
    )?;
    writeln!(
        out,
        "element_size_px,window_nodes,gauge_length_px,\
         measured_exx_microstrain,measured_eyy_microstrain,measured_exy_microstrain,statistical_percent,\
         predicted_exx_microstrain,predicted_eyy_microstrain,predicted_exy_microstrain,period_along_px,period_across_px"
    )?;
    let cell = |value: Option<f64>| value.map_or(String::new(), |value| value.to_string());
    for gauge in &found.strain_gauges.gauges {
        let three = |strains: Option<[f64; 3]>| [0, 1, 2].map(|c| cell(strains.map(|e| e[c] * MICRO))).join(",");
        let StrainGauge { element_size_px, window_nodes, gauge_length_px, .. } = gauge;
        writeln!(
            out,
            "{element_size_px},{window_nodes},{gauge_length_px},{},{},{},{},{}",
            three(gauge.noise_measured),
            cell(gauge.statistical_percent),
            three(gauge.noise_predicted),
            gauge.period_along_px,
            gauge.period_across_px,
        )?;
    }
    Ok(())
}

/// Noise against the length of the gauge, a colour for each element size.
pub(crate) fn plot(found: &Metrology, reference: &Path) -> Plot {
    let mut series = Vec::new();
    let gauges = &found.strain_gauges.gauges;
    for (colour, result) in found.sizes.iter().enumerate() {
        let size = result.element_size_px;
        let mut add = |name: String, style, noise: fn(&StrainGauge) -> Option<[f64; 3]>| {
            let of_size = gauges.iter().filter(|gauge| gauge.element_size_px == size);
            let larger = |gauge: &StrainGauge| noise(gauge).map(|[x, y, _]| MICRO * x.max(y));
            let (x, y): (Vec<f64>, Vec<f64>) =
                of_size.filter_map(|gauge| Some((gauge.gauge_length_px, larger(gauge)?))).unzip();
            if !x.is_empty() {
                series.push(PlotSeries { colour: Some(colour), ..PlotSeries::new(name, style, x, y) });
            }
        };
        add(String::new(), Style::Dashed, |gauge| gauge.noise_predicted);
        add(format!("elements of {size} px"), Style::Markers, |gauge| gauge.noise_measured);
    }
    let name = file_name(reference);
    Plot {
        title: format!("{name}: noise of strains over the length of their gauge"),
        x: Axis::log("virtual strain gauge (px)"),
        y: Axis::log("standard deviation of exx or eyy (1e-6)"),
        series,
        notes: vec![
            format!("points: measured on {}, the larger of exx and eyy; dashed: predicted", measured_on(found)),
            "the shortest gauge of a size is the element, the others windows of N x N nodes".into(),
        ],
        ..Plot::default()
    }
}
