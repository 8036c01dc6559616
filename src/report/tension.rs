//! A tensile test: its constants in words, its curve.

use super::page::{Block, Section};
use super::words::{plain, significant};
use super::{Plot, PlotSeries, ReportError, Style};
use crate::field::{TensionConstant, TensionPoint};
use crate::io::quantities::{QuantitySummary, TensionResult};

/// Strain that the line of the proof stress is drawn beyond where it meets the curve, of that of its line.
const BEYOND: f64 = 1.15;

/// Symbol, meaning and unit of a constant by its name in files.
fn described(name: &str, proof_strain: f64) -> (String, &'static str, &'static str) {
    match name {
        "E_MPa" => ("E".into(), "modulus", "MPa"),
        "nu" => ("nu".into(), "Poisson's ratio", ""),
        "Rp_MPa" => (format!("Rp{}", plain(100.0 * proof_strain)), "proof stress", "MPa"),
        "Rm_MPa" => ("Rm".into(), "largest stress", "MPa"),
        "strain_at_Rm" => ("e(Rm)".into(), "strain at the largest stress", ""),
        _ => ("r".into(), "Lankford's ratio", ""),
    }
}

/// `70100 +- 300 MPa`.
fn in_words(constant: &TensionConstant, unit: &str) -> String {
    let (value, sigma) = (constant.value, constant.sigma());
    // The digits that the standard uncertainty has two of.
    let digits = match sigma > 0.0 && value != 0.0 {
        true => (value.abs().log10().floor() - sigma.log10().floor() + 2.0).clamp(2.0, 7.0) as usize,
        false => 4,
    };
    let sigma = if sigma > 0.0 { format!(" \u{b1} {}", significant(sigma, 2)) } else { String::new() };
    let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
    format!("{}{sigma}{unit}", significant(value, digits))
}

fn between(constant: &TensionConstant) -> String {
    let [from, to] = constant.range.map(|strain| significant(strain, 3));
    match constant.n_frames {
        1 => format!("at a strain of {from}"),
        n => format!("strains {from} to {to}, {n} frames"),
    }
}

/// The constants of the tensile test among `drawn`, a line each.
pub fn tension_lines(drawn: &QuantitySummary) -> impl Iterator<Item = String> {
    drawn.tension.iter().flat_map(lines)
}

fn lines(of: &TensionResult) -> Vec<String> {
    let line = |(name, constant): (&str, Option<TensionConstant>)| {
        let (symbol, _, unit) = described(name, of.options.proof_strain);
        let constant = constant?;
        Some(format!("{symbol} = {} ({})", in_words(&constant, unit), between(&constant)))
    };
    of.tension.constants().into_iter().filter_map(line).collect()
}

/// Stress over strain with the lines of modulus and proof stress; of a test without forces nothing.
pub fn tension_plot(of: &TensionResult) -> Option<Plot> {
    let known = |p: &TensionPoint| Some((p.along.value, p.stress_mpa?));
    let (x, y): (Vec<f64>, Vec<f64>) = of.points.iter().filter_map(known).unzip();
    let last = *x.last()?;
    let mut series = vec![PlotSeries::new("measured", Style::LineAndMarkers, x, y)];
    if let Some(modulus) = of.tension.modulus {
        let [zero, top] =
            [of.tension.zero_strain, of.tension.proof.map_or(modulus.value * modulus.range[1], |p| p.value)];
        let line = |name: String, from: f64| {
            let to = from + BEYOND * top / modulus.value;
            PlotSeries::new(name, Style::Dashed, vec![from, to], vec![0.0, BEYOND * top])
        };
        series.push(line("modulus".into(), zero));
        let proof = of.options.proof_strain.copysign(last);
        series.extend(
            of.tension.proof.map(|_| line(format!("{} % beyond it", plain(100.0 * proof.abs())), zero + proof)),
        );
    }
    Some(Plot::new("Stress over strain", "engineering strain along the load", "stress (MPa)", series))
}

/// The section of a page.
pub(super) fn tension_section(of: &TensionResult) -> Result<Section, ReportError> {
    let row = |(name, constant): (&str, Option<TensionConstant>)| {
        let (symbol, meaning, unit) = described(name, of.options.proof_strain);
        let constant = constant?;
        let shares = [constant.noise, constant.area, constant.camera].map(|share| significant(share, 2));
        let range = between(&constant);
        Some([vec![symbol, meaning.to_owned(), in_words(&constant, unit)], shares.to_vec(), vec![range]].concat())
    };
    let rows: Vec<Vec<String>> = of.tension.constants().into_iter().filter_map(row).collect();
    let columns = ["constant", "meaning", "value", "by noise", "by area", "by the camera", "from"];
    let missing = of.tension.missing.iter().map(|(name, why)| Block::Text(format!("No {name}: {why}.")));
    let mut blocks = vec![Block::table(&columns, rows)];
    blocks.extend(missing);
    if let Some(plot) = tension_plot(of) {
        blocks.push(Block::curves(&plot, "Stress: force over the area of the reference")?);
    }
    Ok(Section { title: "Tensile test".into(), blocks })
}
