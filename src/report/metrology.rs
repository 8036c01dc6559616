//! The page of `quadrille metrology`: the advice first, then what it rests on.

use super::page::{Block, Map, Page, Section};
use super::words::capital;
use super::{Backdrop, Look, MeshOptions, Plot, ReportError, mesh_figure, version};
use crate::imaging::Image;
use crate::mesh::{Mesh, Roi, Zone};
use crate::metrology::{GreyNoise, Metrology, Noise, Origin, PhotonFit, Resolved, SizeResult, StrainGauge};

/// Makes the page of what was `found` on `image`, named `name`. `plots` are the curves over element sizes and those of
/// virtual strain gauges.
///
/// # Errors
/// Those of the figures.
pub fn metrology_page(found: &Metrology, name: &str, image: &Image, plots: [&Plot; 2]) -> Result<Page, ReportError> {
    let [sizes, gauges] = plots;
    let curves = |plot: &Plot| Ok::<_, ReportError>(Block::Grid(vec![Block::curves(plot, plot.notes.join("; "))?]));
    let sections = vec![
        Section { title: "What to do".into(), blocks: advice(found, image)? },
        Section { title: "Element sizes".into(), blocks: vec![curves(sizes)?, size_table(&found.sizes)] },
        Section { title: "Virtual strain gauges".into(), blocks: vec![curves(gauges)?, gauge_table(found)] },
        Section { title: "Noise and texture".into(), blocks: vec![Block::Facts(facts(found))] },
        Section { title: "Interpolation".into(), blocks: vec![bias_table(found)] },
    ];
    let [x0, y0, x1, y1] = found.zone_px;
    let size = format!("{} x {} px", image.width(), image.height());
    Ok(Page {
        title: format!("{name}: what can be measured on it"),
        subtitle: format!("{}, {size}; looked at x {x0} to {x1}, y {y0} to {y1} px", version()),
        sections,
    })
}

fn advice(found: &Metrology, image: &Image) -> Result<Vec<Block>, ReportError> {
    let advice = &found.advice;
    let text = match advice.element_size_px {
        Some(size) => format!("Recommended: elements of {size} px (--element-size {size})."),
        None => "No element size can be recommended.".into(),
    };
    let warning = advice.element_size_px.is_none() || !advice.target_met || advice.period_met == Some(false);
    let mut blocks = vec![Block::Lead { text, warning }];
    let sentence = |text: &String| format!("{}.", capital(text.trim_end_matches('.')));
    blocks.extend(advice.reasons.iter().map(|reason| Block::Text(sentence(reason))));
    blocks.extend(advice.hints.iter().map(|hint| Block::warning(sentence(hint))));
    if let Some(size) = advice.element_size_px {
        let [x0, y0, x1, y1] = found.zone_px.map(|side| side as f64);
        let zone = Zone::rectangle("looked at", Roi { x0, y0, x1, y1 });
        // A zone that has no such element was not the one that the advice is of.
        if let Ok(mesh) = Mesh::on_zones(&[zone], size, image.width(), image.height()) {
            let backdrop = Backdrop::made_for(Look::Screen, image, 1);
            let picture = mesh_figure(&backdrop, &mesh, None, &MeshOptions::default())?;
            let caption = format!("Elements of {size} px on the part of the image that was looked at.");
            blocks.push(Block::Map(Map::new(&picture, Default::default(), caption)?));
        }
    }
    Ok(blocks)
}

/// A number with `digits` places, or a dash.
pub(crate) fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or("-".into(), |v| format!("{v:.digits$}"))
}

/// The larger of two components.
pub(crate) fn larger([a, b]: [f64; 2]) -> f64 {
    a.max(b)
}

fn size_table(sizes: &[SizeResult]) -> Block {
    let columns = [
        "element size, px",
        "nodes without texture, %",
        "uncertainty predicted, px",
        "measured inside, px",
        "measured on the edge, px",
        "strain at the centre, 1e-6",
        "period resolved, best phase, px",
        "mean phase, px",
        "worst phase, px",
    ];
    let row = |result: &SizeResult| {
        let measured = result.measured.as_ref();
        let period = |of: fn(&Resolved) -> Option<f64>| number(result.period_measured.as_ref().and_then(of), 0);
        vec![
            result.element_size_px.to_string(),
            number(Some(result.refused_percent), 1),
            number(result.sigma_predicted_px.map(larger), 4),
            number(result.sigma_px(), 4),
            number(measured.and_then(|scatter| scatter.edge_px).map(larger), 4),
            number(measured.and_then(|scatter| scatter.strain).map(|strain| 1e6 * larger(strain)), 0),
            period(|p| p.at_node_px),
            period(|p| p.averaged_px),
            period(|p| p.at_middle_px),
        ]
    };
    Block::table(&columns, sizes.iter().map(row))
}

/// The gauges of the recommended elements, or of all where none are.
fn gauge_table(found: &Metrology) -> Block {
    let [size, window] = ["element size, px", "window, nodes"];
    let columns = [size, window, "gauge, px", "noise of exx, 1e-6", "eyy", "exy", "resolved along, px", "across"];
    let wanted = |gauge: &&StrainGauge| found.advice.element_size_px.is_none_or(|size| gauge.element_size_px == size);
    let row = |gauge: &StrainGauge| {
        let noise = |c: usize| number(gauge.noise_measured.map(|noise| 1e6 * noise[c]), 1);
        let window = if gauge.window_nodes == 1 { "-".into() } else { gauge.window_nodes.to_string() };
        let mut row = vec![gauge.element_size_px.to_string(), window, number(Some(gauge.gauge_length_px), 0)];
        row.extend((0..3).map(noise));
        row.extend([gauge.period_along_px, gauge.period_across_px].map(|period| number(Some(period), 0)));
        row
    };
    Block::table(&columns, found.strain_gauges.gauges.iter().filter(wanted).map(row))
}

fn facts(found: &Metrology) -> Vec<(String, String)> {
    let texture = &found.texture;
    let both =
        |[x, y]: [Option<f64>; 2], unit: &str| format!("{} along x, {} along y, {unit}", number(x, 2), number(y, 2));
    let mut facts = noise_facts(&found.noise);
    let ([low, high], [dark, bright]) = (texture.range_grey, texture.saturated_percent);
    facts.extend([
        ("Gradient".to_owned(), both(texture.gradient_grey_per_px.map(Some), "rms, grey levels per px")),
        ("Speckles".to_owned(), both(texture.speckle_px, "px (width of the autocorrelation at half its height)")),
        ("Grey levels".to_owned(), format!("{low} to {high}")),
        ("Saturated".to_owned(), format!("{dark:.2} % dark, {bright:.2} % bright")),
    ]);
    facts
}

/// What is known of the noise: names and values, the level first.
pub(crate) fn noise_facts(noise: &Noise) -> Vec<(String, String)> {
    let origin = match noise.origin {
        Origin::StaticImages if noise.pairs.len() == 1 => "measured on 1 static image".into(),
        Origin::StaticImages => format!("measured on {} static images", noise.pairs.len()),
        Origin::Given => "as given".into(),
        Origin::Assumed => "ASSUMED from the highest frequencies of this one image, not measured".into(),
    };
    let (sigma, ceiling) = (noise.sigma_grey, noise.ceiling_grey);
    let level = format!("{sigma:.2} grey levels, {origin} (white noise in it: at most {ceiling:.2})");
    let mut facts = vec![("Noise of one image".to_owned(), level)];
    facts.extend(noise.pairs.iter().map(|pair| {
        let [x, y] = pair.drift_px;
        (format!("With {}", pair.name), format!("{:.2}; it has drifted by ({x:.3}, {y:.3}) px", pair.sigma_grey))
    }));
    if !noise.by_grey.is_empty() {
        let part = |part: &GreyNoise| format!("{:.2} at {:.0} to {:.0}", part.sigma_grey, part.from_grey, part.to_grey);
        facts.push(("By grey level".into(), noise.by_grey.iter().map(part).collect::<Vec<_>>().join(", ")));
    }
    if let Some(photon) = noise.photon.filter(PhotonFit::is_certain) {
        let PhotonFit { a_grey2, b_grey, a_sigma_grey2, b_sigma_grey } = photon;
        let value = format!("a = {a_grey2:.3} +- {a_sigma_grey2:.3}, b = {b_grey:.5} +- {b_sigma_grey:.5}");
        facts.push(("Variance a + b grey".into(), value));
    }
    if let Some(correlation) = &noise.correlation {
        let along = |lags: &[f64]| lags[1..].iter().map(|v| format!("{v:.2}")).collect::<Vec<_>>().join(" ");
        let [x, y] = [&correlation.along_x, &correlation.along_y].map(|lags| along(lags));
        let name = format!("Correlation at 1 to {} px", correlation.along_x.len() - 1);
        facts.push((name, format!("{x} along x, {y} along y")));
        if let (Some([x, y]), Some(sigma)) = (correlation.factor, correlation.factor_sigma) {
            let value = format!("{x:.2} (x), {y:.2} (y) times as uncertain as with white noise, +- {sigma:.2}");
            facts.push(("Displacements by it".into(), value));
        }
    }
    facts
}

fn bias_table(found: &Metrology) -> Block {
    let size = found.bias_element_size_px;
    let bias = format!("largest bias over displacements, elements of {size} px, px");
    let drawn = found.bias.iter().filter(|bias| !bias.shift_px.is_empty());
    let rows = drawn.map(|bias| vec![bias.interpolation.name().to_owned(), format!("{:.1e}", bias.largest_px)]);
    Block::table(&["interpolation", &bias], rows)
}
