//! The report from images to the law of an adhesive: what was measured, what was found, how far it can be trusted.

use super::fit::{Banded, LawRows, TractionRows};
use super::page::{Block, Curves, Map, Page, Part, Section};
use super::{Axis, Backdrop, MapOptions, Palette, Plot, ReportError, Series, Style, element_map_on, nodal_map_on};
use crate::field::{Measurement, RigidMotion};
use crate::imaging::Image;
use crate::mechanics::Joint;
use crate::mechanics::cohesive::{CohesiveLaw, Jump};
use crate::units::{PixelSize, Px};
use serde_json::Value;
use std::collections::BTreeMap;

/// What a report is made of.
#[derive(Debug)]
pub struct IdentificationReport<'a> {
    /// Name of the case file.
    pub case: String,
    /// The reference image.
    pub reference: &'a Image,
    /// `summary.json` of the correlation.
    pub correlation: &'a Value,
    /// Millimetres per pixel.
    pub pixel_size: PixelSize,
    /// Side of the elements, px.
    pub element_px: f64,
    /// Thickness of the adhesive, mm.
    pub thickness_mm: f64,
    /// The frames that became instants, in order: their numbers and fields.
    pub frames: &'a [(usize, Measurement<Px>)],
    /// Mesh, materials and border; its law is the identified one (or the given one, without a fit).
    pub joint: &'a Joint,
    /// The identified law.
    pub law: &'a dyn CohesiveLaw,
    /// Computed displacement of every node of the joint at each instant, mm; empty where there is no solution.
    pub computed: &'a [Vec<[f64; 2]>],
    /// The tractions of the fit with their 95 % bands, as `traction-bands.csv` has them; none without a fit.
    pub bands: &'a [TractionRows],
    /// The law of the fit with its 95 % bands in opening and sliding, as `law.csv` has it.
    pub law_bands: Option<&'a [LawRows; 2]>,
    /// `fit.json`; none when nothing was fitted.
    pub fit: Option<&'a Value>,
    /// True values of the parameters by their names, where they are known: of a virtual test.
    pub truth: Option<&'a Value>,
    /// `rigid-motion.json`: the parameters when the rigid motion is treated the other way.
    pub other_rigid_motion: Option<&'a Value>,
    /// Remarks of the steps.
    pub notes: Vec<String>,
    /// Versions, hashes and steps: name and value.
    pub provenance: Vec<(String, String)>,
}

/// Instants that are drawn: one early, one in the middle, the last.
fn chosen(n: usize) -> Vec<usize> {
    let mut chosen = vec![n.div_ceil(4).max(1) - 1, n.div_ceil(2).max(1) - 1, n.max(1) - 1];
    chosen.dedup();
    chosen.retain(|&k| k < n);
    chosen
}

/// A number with `digits` significant digits.
fn significant(value: f64, digits: usize) -> String {
    if value == 0.0 || !value.is_finite() {
        return if value.is_finite() { "0".to_owned() } else { "-".to_owned() };
    }
    let before = value.abs().log10().floor() as i32;
    if (-4..6).contains(&before) {
        format!("{value:.*}", (digits as i32 - 1 - before).max(0) as usize)
    } else {
        format!("{value:.*e}", digits.saturating_sub(1))
    }
}

fn text(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Number(number) if number.is_u64() || number.is_i64() => number.to_string(),
        Value::Number(number) => match number.as_f64() {
            Some(value) if value == value.round() && value.abs() < 1e6 => format!("{value:.0}"),
            Some(value) if (1e-5..1e6).contains(&value.abs()) => {
                format!("{}", significant(value, 5).parse().unwrap_or(value))
            }
            Some(value) => significant(value, 3),
            None => number.to_string(),
        },
        Value::Bool(true) => "yes".to_owned(),
        Value::Bool(false) => "no".to_owned(),
        Value::Null => "-".to_owned(),
        other => other.to_string(),
    }
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().into_iter().flatten().map(|v| v.as_f64().unwrap_or(f64::NAN)).collect()
}

/// Values of a list that may also be an object with a value for each of `names`.
fn by_names(value: &Value, names: &[String]) -> Vec<f64> {
    match value {
        Value::Object(map) => {
            names.iter().map(|name| map.get(name).and_then(Value::as_f64).unwrap_or(f64::NAN)).collect()
        }
        other => numbers(other),
    }
}

impl IdentificationReport<'_> {
    /// The report as a page.
    ///
    /// # Errors
    /// A picture that cannot be drawn.
    pub fn page(&self) -> Result<Page, ReportError> {
        let mut sections = Vec::new();
        if self.fit.is_some() {
            sections.push(self.result()?);
        }
        sections.push(self.measurement()?);
        sections.push(self.comparison()?);
        sections.push(self.tractions()?);
        if let Some(section) = self.history()? {
            sections.push(section);
        }
        sections.push(self.provenance());
        let title = match self.fit {
            Some(_) => "Cohesive law of an adhesive, identified from images",
            None => "A bonded joint, measured on images and computed",
        };
        let subtitle = format!(
            "{}; quadrille {}; units mm, MPa, N/mm, x to the right, y up",
            self.case,
            env!("CARGO_PKG_VERSION")
        );
        Ok(Page { title: title.to_owned(), subtitle, sections })
    }

    /// Names of the fitted parameters.
    fn fitted(&self) -> Vec<String> {
        let Some(fit) = self.fit else { return Vec::new() };
        // In this order stand the rows of its matrices and its iterates.
        if let Some(order) = fit["parameter_order"].as_array() {
            return order.iter().filter_map(|name| name.as_str().map(str::to_owned)).collect();
        }
        let there = |name: &str| fit["parameters"].get(name).is_some();
        self.law.parameters().iter().map(|p| p.name.to_owned()).filter(|name| there(name)).collect()
    }

    fn unit(&self, name: &str) -> &'static str {
        self.law.parameters().iter().find(|p| p.name == name).map_or("", |p| if p.unit == "1" { "" } else { p.unit })
    }

    /// The values that are found, in the units that people speak of: mm below 0.5 as µm.
    fn shown(&self, name: &str) -> (f64, String) {
        match self.unit(name) {
            "mm" => (1e3, "\u{b5}m".to_owned()),
            unit => (1.0, unit.to_owned()),
        }
    }

    fn result(&self) -> Result<Section, ReportError> {
        let fit = self.fit.unwrap_or(&Value::Null);
        let mut blocks = Vec::new();
        let status = text(&fit["status"]);
        let reason = fit["reason"].as_str().unwrap_or("");
        let converged = status == "converged";
        blocks.push(Block::Lead {
            text: match converged {
                true => format!("The fit converged: {reason}"),
                false => format!("The fit did not converge ({status}): {reason}. The values below are the best point that was reached."),
            },
            warning: !converged,
        });
        let verdict = &fit["verdict"];
        let sentences: Vec<String> = strings(&verdict["sentences"]);
        if let Some((first, rest)) = sentences.split_first() {
            let text = format!("Verdict: {}. {}", text(&verdict["outcome"]), capital(first));
            blocks.push(Block::Lead { text, warning: verdict["determined"] != true });
            blocks.extend(rest.iter().map(|line| Block::Text(format!("{}.", capital(line)))));
        }
        if let Some(thresholds) = fit["verdict"]["thresholds"].as_str() {
            blocks.push(Block::Text(format!("What the verdict goes by: {thresholds}.")));
        }
        let names = self.fitted();
        let mut columns: Vec<String> = [
            "parameter",
            "value",
            "standard uncertainty",
            "with half the element size",
            if verdict["conditional"] == true { "95 % interval, if the model were true" } else { "95 % interval" },
            "bias of the noise",
            "start",
            "on a bound",
        ]
        .map(str::to_owned)
        .into();
        if self.truth.is_some() {
            columns.push("truth".into());
        }
        let rows = names
            .iter()
            .map(|name| {
                let entry = &fit["parameters"][name];
                let (scale, unit) = self.shown(name);
                let number = |key: &str| entry[key].as_f64().map(|v| scale * v);
                let value = number("value").unwrap_or(f64::NAN);
                let std = number("std");
                let ends = [0, 1].map(|side| entry["ends95"][side].as_f64().map(|v| significant(scale * v, 5)));
                let mut row = vec![
                    self.label(name),
                    format!("{} {unit}", significant(value, 5)),
                    std.map_or("-".into(), |std| {
                        format!("{} {unit} ({} %)", significant(std, 2), significant(100.0 * std / value.abs(), 2))
                    }),
                    number("discretisation")
                        .map_or("-".into(), |change| format!("{:+.2} %", 100.0 * change / value.abs())),
                    match (ends, std) {
                        ([Some(low), Some(high)], _) => format!("{low} to {high} {unit}"),
                        ([Some(low), None], _) => format!("from {low} {unit}, no upper end"),
                        ([None, Some(high)], _) => format!("up to {high} {unit}, no lower end"),
                        ([None, None], Some(_)) => "without ends".into(),
                        ([None, None], None) => "-".into(),
                    },
                    number("bias").map_or("-".into(), |bias| format!("{:+.2} %", 100.0 * bias / value.abs())),
                    number("start").map_or("-".into(), |v| format!("{} {unit}", significant(v, 4))),
                    text(&entry["at_bound"]),
                ];
                if let Some(truth) = self.truth {
                    row.push(match truth[name].as_f64() {
                        Some(truth) => format!(
                            "{} {unit} ({:+.2} %)",
                            significant(scale * truth, 4),
                            100.0 * (value / (scale * truth) - 1.0)
                        ),
                        None => "-".into(),
                    });
                }
                row
            })
            .collect();
        blocks.push(Block::Table { columns, rows });
        blocks.push(Block::Text(match fit["discretisation"].as_str() {
            Some("included") => "The standard uncertainty is that of noise and constants. The 95 % interval also holds, as \
                                 one more standard uncertainty, the change that elements of half the size would make."
                .into(),
            _ => "Standard uncertainty and 95 % interval are those of noise and uncertain constants; what elements of half the size \
                  would change is not part of them."
                .into(),
        }));
        if fit["intervals"]["kind"] == "profile" {
            let count = |key: &str| text(&fit["intervals"][key]);
            blocks.push(Block::Text(format!(
                "The intervals are those of the profile likelihood, because linear theory is in doubt; they need not be symmetric. Where \
                 refits of data simulated from the fitted model ({} of them, {} failed) are shifted on the average, the interval is \
                 extended to hold the shift; the value is as fitted.",
                count("draws"),
                count("failed")
            )));
        } else if fit["parameters"].as_object().is_some_and(|all| all.values().any(|p| !p["bias"].is_null())) {
            blocks.push(Block::Text(
                "The bias of the noise is what a pair of opposite draws of it shifts each parameter by, through kinks and plasticity; \
                 the interval is extended to hold it, the value is as fitted."
                    .into(),
            ));
        }
        blocks.extend(self.budget());
        let fixed: Vec<String> = (self.law.parameters().iter().zip(self.law.values()))
            .filter(|(p, _)| !names.iter().any(|name| name == p.name))
            .map(|(p, value)| {
                format!(
                    "{} = {}{}",
                    p.name,
                    text(&Value::from(value)),
                    if p.unit == "1" { String::new() } else { format!(" {}", p.unit) }
                )
            })
            .collect();
        if !fixed.is_empty() {
            blocks.push(Block::Text(format!("Prescribed: {}. Law: {}.", fixed.join(", "), self.law.name())));
        }
        let derived: Vec<(String, String)> = match &fit["derived"] {
            Value::Object(map) => map.iter().map(|(name, entry)| (name.clone(), quantity(entry))).collect(),
            Value::Array(list) => list.iter().map(|entry| (text(&entry["name"]), quantity(entry))).collect(),
            _ => Vec::new(),
        };
        if !derived.is_empty() {
            blocks.push(Block::Heading("What follows from them".into()));
            blocks.push(Block::Facts(derived));
        }
        blocks.extend(misfit(&fit["misfit"])?);
        if let Some(matrix) = fit["correlation"].as_array() {
            blocks.push(Block::Heading("Correlation of the parameters".into()));
            let rows =
                matrix.iter().map(|row| numbers(row).into_iter().map(|v| format!("{v:+.3}")).collect()).collect();
            blocks.push(Block::Matrix { names: names.clone(), rows });
        }
        let mut facts = Vec::new();
        for (name, keys) in [
            ("omega (sum of weighted squares)", &["omega"][..]),
            ("omega expected of the noise", &["expected_omega", "omega_expected"]),
            ("evaluations of the model", &["evaluations"]),
            ("evaluations with a snap that was crossed", &["rescued"]),
            ("condition of the scaled problem", &["condition"]),
        ] {
            if let Some(value) = keys.iter().find_map(|key| fit.get(*key)).filter(|value| !value.is_null()) {
                facts.push((name.to_owned(), text(value)));
            }
        }
        let singular = numbers(&fit["singular_values"]);
        if !singular.is_empty() {
            let list: Vec<String> = singular.iter().map(|v| significant(*v, 4)).collect();
            facts.push(("singular values of the scaled Jacobian".into(), list.join(", ")));
        }
        if !facts.is_empty() {
            blocks.push(Block::Facts(facts));
        }
        Ok(Section { title: "Result".into(), blocks })
    }

    /// Where the uncertainty of each parameter comes from, as bars, and what the case left to defaults.
    fn budget(&self) -> Vec<Block> {
        let lines: Vec<&Value> = self.fit.and_then(|fit| fit["budget"].as_array()).into_iter().flatten().collect();
        if lines.is_empty() {
            return Vec::new();
        }
        let mut blocks = vec![
            Block::Heading("Where the uncertainty comes from".into()),
            Block::Text(
                "Change of the parameter for one standard uncertainty of each source, in per cent of its value; the interval is 1.96 \
                 times the root of the sum of their squares. Grey: stated, and not part of the interval."
                    .into(),
            ),
        ];
        for name in self.fitted() {
            let value = self.fit.and_then(|fit| fit["parameters"][&name]["value"].as_f64()).unwrap_or(f64::NAN).abs();
            let effect = |line: &&Value| line["parameters"][&name].as_f64().map(|effect| effect.abs() / value);
            let mut parts: Vec<(&Value, f64)> = lines.iter().filter_map(|line| Some((*line, effect(line)?))).collect();
            parts.retain(|(_, effect)| *effect > 0.0);
            parts.sort_by(|a, b| b.1.total_cmp(&a.1));
            let most = parts.first().map_or(1.0, |(_, effect)| *effect);
            let total: f64 = parts.iter().filter(|(line, _)| line["included"] == true).map(|(_, e)| e * e).sum();
            // What is below a hundredth of the largest is in the table.
            parts.retain(|(_, effect)| *effect >= 0.01 * most);
            let bar = |(line, effect): &(&Value, f64)| Part {
                name: text(&line["name"]).replace('_', " "),
                length: effect / most,
                text: format!("{} %", significant(100.0 * effect, 2)),
                apart: line["included"] != true,
            };
            blocks.push(Block::Text(format!("{name}: in all {} %", significant(100.0 * total.sqrt(), 2))));
            blocks.push(Block::Parts(parts.iter().map(bar).collect()));
        }
        let rows = lines.iter().map(|line| {
            let number = |key: &str| line[key].as_f64().map_or("-".to_owned(), |value| significant(value, 4));
            let unit = line["unit"].as_str().filter(|unit| *unit != "1").unwrap_or("");
            let with_unit = |key: &str| format!("{} {unit}", number(key)).trim_end().to_owned();
            let name = text(&line["name"]).replace('_', " ");
            vec![name, with_unit("value"), with_unit("std"), text(&line["source"])]
        });
        blocks.push(Block::Table {
            columns: ["source of uncertainty", "value", "standard uncertainty", "where from"].map(str::to_owned).into(),
            rows: rows.collect(),
        });
        blocks.push(Block::Text(
            "\"default\": the case states nothing; \"exact\": the case says that there is none; \"not stated\": nothing is known, and \
             it is not part of the intervals. Not in any interval: another law, another model of the strips, \
             a measurement that is wrong by more than its noise."
                .into(),
        ));
        blocks
    }

    /// Symbol and meaning of a parameter.
    fn label(&self, name: &str) -> String {
        let meaning = self.law.parameters().iter().find(|p| p.name == name).map_or("", |p| p.meaning);
        format!("{name}: {meaning}")
    }

    fn measurement(&self) -> Result<Section, ReportError> {
        let summary = self.correlation;
        let mm = self.pixel_size.mm_per_px();
        let count = |status: &str| {
            let frames = summary["frames"].as_array();
            frames.into_iter().flatten().filter(|frame| frame["status"] == status).count()
        };
        let n = summary["frames"].as_array().map_or(0, Vec::len);
        let of_zones = |key: &str| -> Option<f64> {
            let frames = summary["frames"].as_array()?;
            let values: Vec<f64> = frames
                .iter()
                .filter_map(|frame| frame["zones"].as_array())
                .flatten()
                .filter_map(|zone| zone[key].as_f64())
                .collect();
            (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
        };
        let sigma = self.sigma_px();
        let reference = &summary["reference"];
        let mut facts = vec![
            (
                "images".into(),
                format!(
                    "1 reference and {n} deformed, {} x {} px, {}",
                    text(&reference["width_px"]),
                    text(&reference["height_px"]),
                    text(&reference["depth"])
                ),
            ),
            ("resolution".into(), format!("1 px = {} \u{b5}m", significant(1e3 * mm, 5))),
            (
                "elements".into(),
                format!(
                    "squares of {} px = {} \u{b5}m, bilinear; {} elements, {} nodes in two strips",
                    text(&Value::from(self.element_px)),
                    significant(1e3 * mm * self.element_px, 4),
                    text(&summary["n_elements"]),
                    text(&summary["n_nodes"])
                ),
            ),
            (
                "adhesive".into(),
                format!("{} \u{b5}m thick, not correlated; dark", significant(1e3 * self.thickness_mm, 4)),
            ),
            (
                "frames".into(),
                format!("{} of {n} converged (tolerance {} px)", count("converged"), text(&summary["tolerance_px"])),
            ),
        ];
        if let Some(noise) = of_zones("noise_grey") {
            facts.push((
                "noise of one image".into(),
                format!("{} grey levels, from the residual", significant(noise, 3)),
            ));
        }
        if let Some(sigma) = sigma {
            facts.push((
                "standard uncertainty of a nodal displacement (rms)".into(),
                format!("{} px = {} nm", significant(sigma, 3), significant(1e6 * mm * sigma, 3)),
            ));
        }
        facts.push(("device".into(), text(&summary["device"])));
        let mut blocks = vec![
            Block::Text("The displacement of two strips beside the adhesive, by global image correlation on one mesh for each strip; pixels beside the dark adhesive are left out of the sums.".into()),
            Block::Facts(facts),
        ];
        let left_out = n - count("converged");
        if left_out > 0 {
            let frames = summary["frames"].as_array().into_iter().flatten();
            let list: Vec<String> = frames
                .filter(|frame| frame["status"] != "converged")
                .map(|frame| format!("{} ({})", text(&frame["number"]), text(&frame["status"])))
                .collect();
            blocks.push(Block::Lead {
                text: format!("Left out, because they did not converge: frames {}.", list.join(", ")),
                warning: true,
            });
        }
        blocks.extend(self.notes.iter().map(|note| Block::Lead { text: note.clone(), warning: true }));
        blocks.push(self.rigid_motion());
        let backdrop = Backdrop::new(self.reference, 1);
        let mut maps = Vec::new();
        let shown = chosen(self.frames.len());
        for &at in shown.iter().skip(1) {
            let (number, field) = &self.frames[at];
            for (c, name) in [(0, "u_x, to the right"), (1, "u_y, up")] {
                // y up, as everywhere in this report.
                let sign = if c == 1 { -1.0 } else { 1.0 };
                let values: Vec<f64> = field.displacement.iter().map(|u| sign * 1e3 * mm * u[c]).collect();
                maps.push(self.map(
                    &backdrop,
                    field,
                    &values,
                    false,
                    format!("Displacement {name}, frame {number}"),
                    "\u{b5}m",
                )?);
            }
        }
        if let Some((number, field)) = self.frames.last() {
            let caption = format!(
                "Residual |f - g(x + u)| of each element, frame {number}: what the displacement does not explain; cracks and reflections show here, noise alone is even"
            );
            maps.push(self.map(&backdrop, field, &field.element_residual, true, caption, "grey levels")?);
        }
        blocks.push(Block::Grid(maps));
        Ok(Section { title: "What was measured, and how".into(), blocks })
    }

    /// Root mean square of the standard uncertainty of the measured displacements, px.
    fn sigma_px(&self) -> Option<f64> {
        let fields = || self.frames.iter().flat_map(|(_, field)| field.sigma.iter().zip(&field.measured));
        let (sum, n) = fields()
            .filter(|(_, measured)| **measured)
            .fold((0.0, 0.0), |(sum, n), (s, _)| (sum + s[0] * s[0] + s[1] * s[1], n + 2.0));
        (n > 0.0).then(|| (sum / n).sqrt())
    }

    fn rigid_motion(&self) -> Block {
        let removed = &self.joint.removed;
        let motions: Vec<RigidMotion> = if removed.is_empty() {
            let of = |u: &Vec<[f64; 2]>| {
                let nodes = self.joint.boundary.nodes();
                RigidMotion::fit(
                    nodes.iter().zip(u).map(|(&node, &u)| (self.joint.model.mesh().nodes()[node as usize], u)),
                )
            };
            self.joint.boundary.instants().iter().filter_map(of).collect()
        } else {
            removed.clone()
        };
        let largest = |of: fn(&RigidMotion) -> f64| motions.iter().map(of).fold(0.0_f64, |most, v| most.max(v.abs()));
        let shift = 1e3 * largest(|m| m.translation[0].hypot(m.translation[1]));
        let turn = largest(|m| m.rotation_rad);
        let slide = 1e3 * turn * self.thickness_mm;
        let done = if removed.is_empty() { "It was kept" } else { "It was removed" };
        let mut effect = String::new();
        if let (Some(other), Some(fit)) = (self.other_rigid_motion, self.fit) {
            let list: Vec<String> = (self.fitted().iter())
                .filter_map(|name| {
                    let value = fit["parameters"][name]["value"].as_f64()?;
                    let changed = other["parameters"][name].as_f64()?;
                    Some(format!("{name} {:+.2} %", 100.0 * (changed / value - 1.0)))
                })
                .collect();
            let choice = if removed.is_empty() { "Removed" } else { "Kept" };
            effect = match other["failed"].as_str() {
                Some(why) => format!(" What the other choice would change is not known: {why}."),
                None => format!(" {choice}, the parameters would change by (to first order): {}.", list.join(", ")),
            };
        }
        Block::Text(format!(
            "Rigid motion of the whole joint: up to {} \u{b5}m and {turn:.2e} rad. {done} ([boundary] remove_rigid_motion); with kinematics = \"paper\" \
             the choice changes the sliding jump by up to {} \u{b5}m.{effect}",
            significant(shift, 3),
            significant(slide, 2),
        ))
    }

    fn map(
        &self,
        backdrop: &Backdrop,
        field: &Measurement<Px>,
        values: &[f64],
        of_elements: bool,
        caption: String,
        unit: &str,
    ) -> Result<Block, ReportError> {
        let known = values.iter().copied().filter(|v| v.is_finite());
        let (mut low, mut high) =
            known.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        if low >= high {
            (low, high) = (0.0, 1.0);
        }
        let options = MapOptions {
            range: Some((low, high)),
            palette: if of_elements { Palette::Plasma } else { Palette::Viridis },
            pixel_size: Some(self.pixel_size),
            ..MapOptions::new(caption.clone(), unit)
        };
        let picture = match of_elements {
            true => element_map_on(backdrop, field, values, &options)?,
            false => nodal_map_on(backdrop, field, values, &options)?,
        };
        let end = |v: f64| format!("{} {unit}", significant(v, 3));
        Ok(Block::Map(Map::new(&picture, [end(low), end(high)], caption)?))
    }

    /// Instants that have a solution, of those to be drawn.
    fn drawn(&self) -> Vec<usize> {
        let solved: Vec<usize> = (0..self.computed.len()).filter(|&k| !self.computed[k].is_empty()).collect();
        chosen(solved.len()).into_iter().map(|k| solved[k]).collect()
    }

    /// Name of instant `at` in legends.
    fn name_of(&self, at: usize) -> String {
        match self.frames.get(at) {
            Some((number, _)) => format!("frame {number}"),
            None => format!("instant {}", at + 1),
        }
    }

    /// Measured displacement of a node at an instant, mm with y up, less the rigid motion where that was removed.
    fn measured(&self, at: usize, node: usize) -> Option<[f64; 2]> {
        let (_, field) = self.frames.get(at)?;
        let (&measured, &u) = (field.measured.get(node)?, field.displacement.get(node)?);
        let u = measured.then(|| [self.pixel_size.mm_from_px(u[0]), -self.pixel_size.mm_from_px(u[1])])?;
        let Some(motion) = self.joint.removed.get(at) else { return Some(u) };
        let rigid = motion.displacement(self.joint.model.mesh().nodes()[node]);
        let (sin, cos) = motion.rotation_rad.sin_cos();
        let rest = [u[0] - rigid[0], u[1] - rigid[1]];
        Some([cos * rest[0] + sin * rest[1], -sin * rest[0] + cos * rest[1]])
    }

    fn comparison(&self) -> Result<Section, ReportError> {
        let mut blocks = vec![Block::Text(
            "Jumps across the adhesive, upper minus lower face. Points: measured, with two standard uncertainties. Lines: computed with the law above, \
             the measured displacement of the outer border prescribed."
                .into(),
        )];
        let model = &self.joint.model;
        let (pairs, positions) = (model.mesh().pairs(), model.pair_positions());
        let mut curves = Vec::new();
        for (c, title, label) in [(1, "Opening", "opening (\u{b5}m)"), (0, "Sliding", "sliding (\u{b5}m)")] {
            let mut series = Vec::new();
            for at in self.drawn() {
                let u = &self.computed[at];
                let line = |k: usize| 1e3 * (u[pairs[k][1] as usize][c] - u[pairs[k][0] as usize][c]);
                let along: Vec<f64> = positions.iter().map(|(_, along)| *along).collect();
                series.push(Series::new(self.name_of(at), Style::Line, along, (0..pairs.len()).map(line).collect()));
            }
            for at in self.drawn() {
                let (mut x, mut y, mut half) = (Vec::new(), Vec::new(), Vec::new());
                for (&[lower, upper], (_, along)) in pairs.iter().zip(&positions) {
                    let both = [lower, upper].map(|node| self.measured(at, node as usize));
                    if let [Some(below), Some(above)] = both {
                        let sigma = |node: u32| self.pixel_size.mm_from_px(self.frames[at].1.sigma[node as usize][c]);
                        x.push(*along);
                        y.push(1e3 * (above[c] - below[c]));
                        half.push(2e3 * sigma(lower).hypot(sigma(upper)));
                    }
                }
                // The colour of its line.
                let colour = Some(self.drawn().iter().position(|&other| other == at).unwrap_or(0));
                series.push(Series { colour, ..Series::new(String::new(), Style::Markers, x, y).with_band(half) });
            }
            let plot = Plot {
                title: format!("{title} along the joint, measured and computed"),
                x: Axis::linear("distance along the joint (mm)"),
                y: Axis::linear(label),
                series,
                notes: Vec::new(),
            };
            curves.push(Block::Curves(Curves::new(&plot, format!("{title}: points measured, lines computed"))?));
        }
        blocks.push(Block::Grid(curves));
        let (mut instant, mut off, mut noise) = (Vec::new(), Vec::new(), Vec::new());
        for at in (0..self.computed.len()).filter(|&at| !self.computed[at].is_empty()) {
            let (mut sum, mut sigma, mut n) = (0.0, 0.0, 0.0);
            let Some((number, field)) = self.frames.get(at) else { continue };
            for node in 0..field.displacement.len() {
                let free = (0..2).all(|c| model.unknown(node, c).is_some());
                if let (Some(u), true) = (self.measured(at, node), free) {
                    for c in 0..2 {
                        sum += (u[c] - self.computed[at][node][c]).powi(2);
                        sigma += field.sigma[node][c].powi(2);
                        n += 1.0;
                    }
                }
            }
            if n > 0.0 {
                let px = |v: f64| (v / n).sqrt() / self.pixel_size.mm_per_px();
                instant.push(*number as f64);
                off.push(px(sum));
                noise.push((sigma / n).sqrt());
            }
        }
        if !instant.is_empty() {
            let plot = Plot {
                title: "Measured less computed displacement, all free nodes".into(),
                x: Axis::linear("frame"),
                y: Axis::linear("root mean square (px)")
                    .with_range(0.0, 1.3 * off.iter().chain(&noise).fold(1e-6, |most: f64, v| most.max(*v))),
                series: vec![
                    Series::new("measured less computed", Style::LineAndMarkers, instant.clone(), off),
                    Series::new("uncertainty of the measurement", Style::Dashed, instant, noise),
                ],
                notes: Vec::new(),
            };
            let caption = "A line that rises far above the uncertainty shows that the model does not follow the joint; a little above it is the noise of the prescribed border";
            blocks.push(Block::Grid(vec![Block::Curves(Curves::new(&plot, caption)?)]));
        }
        Ok(Section { title: "Measured against computed displacement".into(), blocks })
    }

    fn tractions(&self) -> Result<Section, ReportError> {
        let model = &self.joint.model;
        let along: Vec<f64> = model.pair_positions().into_iter().map(|(_, along)| along).collect();
        let mut curves = Vec::new();
        for (c, title, label) in [(0, "Normal", "T_n (MPa)"), (1, "Tangential", "T_t (MPa)")] {
            let mut series = Vec::new();
            for at in self.drawn() {
                let one = match self.bands.iter().find(|band| band.instant == at + 1) {
                    Some(band) => {
                        let Banded { value, low, high, .. } = &band.tractions[c];
                        Series::new(self.name_of(at), Style::Line, band.along_mm.clone(), value.clone())
                            .with_limits(low, high)
                    }
                    None => {
                        let values = model.tractions(self.law, &self.computed[at]).into_iter();
                        let values = values.map(|t| if c == 0 { t.normal } else { t.tangential }).collect();
                        Series::new(self.name_of(at), Style::Line, along.clone(), values)
                    }
                };
                series.push(one);
            }
            let plot = Plot {
                title: format!("{title} traction along the joint"),
                x: Axis::linear("distance along the joint (mm)"),
                y: Axis::linear(label),
                series,
                notes: Vec::new(),
            };
            curves.push(Block::Curves(Curves::new(&plot, format!("{title} traction of the adhesive on the strips"))?));
        }
        for (c, title, x, y) in [
            (0, "Opening without sliding", "D_n (\u{b5}m)", "T_n (MPa)"),
            (1, "Sliding without opening", "D_t (\u{b5}m)", "T_t (MPa)"),
        ] {
            curves.push(self.law_curve(c, title, x, y)?);
        }
        let bands = match (self.bands.is_empty(), self.fit.is_some_and(|fit| fit["discretisation"] == "included")) {
            (true, _) => "",
            (_, true) => {
                " Bands: 95 %, of the noise of the measurement and its border, uncertain constants and the element size; the \
                 numbers are those of traction-bands.csv and law.csv."
            }
            (_, false) => {
                " Bands: 95 %, of the noise of the measurement and its border and of uncertain constants; the numbers are \
                 those of traction-bands.csv and law.csv."
            }
        };
        let blocks = vec![
            Block::Text(format!(
                "Largest tractions of the law: T_n {} MPa in pure opening, T_t {} MPa in pure sliding.{bands}",
                significant(self.law.peak().normal, 4),
                significant(self.law.peak().tangential, 4)
            )),
            Block::Grid(curves),
        ];
        Ok(Section { title: "Tractions".into(), blocks })
    }

    /// Traction against separation in one pure mode, with the band of the fit.
    fn law_curve(&self, c: usize, title: &str, x: &str, y: &str) -> Result<Block, ReportError> {
        let series = match self.law_bands {
            Some(modes) => {
                let LawRows { jump_mm, traction: Banded { value, low, high, .. } } = &modes[c];
                let um = jump_mm.iter().map(|jump| 1e3 * jump).collect();
                Series::new("", Style::Line, um, value.clone()).with_limits(low, high)
            }
            None => {
                let most = |pick: fn(&Jump) -> f64| {
                    let jumps = self.computed.iter().filter(|u| !u.is_empty()).flat_map(|u| self.joint.model.jumps(u));
                    jumps.map(|jump| pick(&jump).abs()).fold(0.0, f64::max)
                };
                let front = self.law.front_opening();
                let end = if c == 0 { front } else { most(|jump| jump.tangential).max(front) };
                let jumps: Vec<f64> = (0..=120).map(|k| end * f64::from(k) / 120.0).collect();
                let traction = |&d: &f64| match c {
                    0 => self.law.response(Jump { normal: d, tangential: 0.0 }).traction.normal,
                    _ => self.law.response(Jump { normal: 0.0, tangential: d }).traction.tangential,
                };
                let values = jumps.iter().map(traction).collect();
                Series::new("", Style::Line, jumps.iter().map(|d| 1e3 * d).collect(), values)
            }
        };
        let plot = Plot {
            title: title.to_owned(),
            x: Axis::linear(x),
            y: Axis::linear(y),
            series: vec![series],
            notes: Vec::new(),
        };
        Ok(Block::Curves(Curves::new(&plot, format!("{title}: traction of the law against the jump"))?))
    }

    fn history(&self) -> Result<Option<Section>, ReportError> {
        let entries = self.fit.and_then(|fit| fit["history"].as_array()).into_iter().flatten();
        // Trials that were refused are in fit.json; the fit did not go on from them.
        let history: Vec<&Value> = entries.filter(|entry| entry["accepted"] == true).collect();
        if history.is_empty() {
            return Ok(None);
        }
        let names = self.fitted();
        let step: Vec<f64> = (0..history.len()).map(|k| k as f64).collect();
        let omega: Vec<f64> = history.iter().map(|entry| entry["omega"].as_f64().unwrap_or(f64::NAN)).collect();
        let values: Vec<Vec<f64>> = history
            .iter()
            .map(|entry| by_names(entry.get("X").or(entry.get("x")).unwrap_or(&Value::Null), &names))
            .collect();
        let plot = |title: &str, y: Axis, series| Plot {
            title: title.to_owned(),
            x: Axis::linear("iteration"),
            y,
            series,
            notes: Vec::new(),
        };
        let mut stages: BTreeMap<u64, Vec<usize>> = BTreeMap::new();
        for (k, entry) in history.iter().enumerate() {
            stages.entry(entry["stage"].as_u64().unwrap_or(1)).or_default().push(k);
        }
        let n_stages = stages.len();
        let stages: Vec<Series> = stages
            .into_iter()
            .map(|(number, stage)| {
                let last = stage.last().map_or(1.0, |&k| omega[k]);
                let name = if n_stages > 1 { format!("stage {number}") } else { String::new() };
                let (x, y) = stage.iter().map(|&k| (step[k], omega[k] / last)).unzip();
                Series::new(name, Style::LineAndMarkers, x, y)
            })
            .collect();
        let mut curves = vec![Block::Curves(Curves::new(
            &plot("Objective of the fit", Axis::log("omega / last of its stage"), stages),
            "The objective at every iteration; a stage is a run of the trust region with one kind of weights, the last with those asked for",
        )?)];
        let series: Vec<Series> = names
            .iter()
            .enumerate()
            .filter_map(|(k, name)| {
                let of: Vec<f64> = values.iter().map(|x| x.get(k).copied().unwrap_or(f64::NAN)).collect();
                let last = *of.last()?;
                (last != 0.0 && last.is_finite()).then(|| {
                    Series::new(name, Style::LineAndMarkers, step.clone(), of.iter().map(|v| v / last).collect())
                })
            })
            .collect();
        if !series.is_empty() {
            let drawn = plot("Parameters over their last value", Axis::linear("parameter / last value"), series);
            curves.push(Block::Curves(Curves::new(&drawn, "The parameters at every iteration")?));
        }
        let mut blocks = vec![Block::Grid(curves)];
        if let Some(starts) = self.fit.and_then(|fit| fit["starts"].as_array()).filter(|starts| starts.len() > 1) {
            let row = |entry: &Value| {
                let list = |key: &str| {
                    by_names(&entry[key], &names).iter().map(|v| significant(*v, 5)).collect::<Vec<_>>().join(", ")
                };
                vec![list("start"), list("end"), text(&entry["omega"]), text(&entry["status"])]
            };
            blocks.push(Block::Heading(format!("Further starts ({})", names.join(", "))));
            blocks.push(Block::Table {
                columns: ["start", "end", "omega", "status"].map(str::to_owned).into(),
                rows: starts.iter().map(row).collect(),
            });
        }
        Ok(Some(Section { title: "How the fit went".into(), blocks }))
    }

    fn provenance(&self) -> Section {
        let text = "Everything that the numbers above depend on: the same versions and files give the same result.";
        Section {
            title: "Versions and hashes".into(),
            blocks: vec![Block::Text(text.into()), Block::Facts(self.provenance.clone())],
        }
    }
}

/// The misfit test: is what the model leaves of the measurement what the noise leaves?
fn misfit(record: &Value) -> Result<Vec<Block>, ReportError> {
    let groups = |key: &str| record[key].as_array().cloned().unwrap_or_default();
    let by_instant = groups("by_instant");
    if by_instant.is_empty() {
        return Ok(Vec::new());
    }
    let number = |group: &Value, key: &str| group[key].as_f64().unwrap_or(f64::NAN);
    let mut blocks = vec![Block::Heading("Does the model follow the measurement?".into())];
    let fixed = |key: &str| format!("{:.1}", number(record, key));
    blocks.push(Block::Text(match record["tested"] == true {
        true => format!(
            "Omega of the whitened residual is {:.0}; noise leaves {:.0} of it on the average, the element size adds {}, the constants {:.0}: {:+.1} %, {} \
             standard deviations (rejected above {}). The level of the noise counts as known to 2 %.",
            number(record, "omega"),
            number(record, "freedom"),
            record["floor"].as_f64().map_or("an unknown part".into(), |floor| format!("{floor:.0}")),
            number(record, "constants"),
            100.0 * number(record, "excess"),
            fixed("z"),
            fixed("z_limit")
        ),
        false => "The noise was estimated from this residual, so that the objective as a whole tests nothing; instants and \
                  regions can still be held against each other."
            .into(),
    }));
    let worst = strings(&record["worst"]);
    if !worst.is_empty() {
        blocks.push(Block::Text(format!("Worst: {}.", worst.join("; "))));
    }
    let place = by_instant.iter().map(|group| group["instants"][0].as_f64().unwrap_or(f64::NAN)).collect();
    let ratio: Vec<f64> = by_instant.iter().map(|group| number(group, "times_expected")).collect();
    let highest = 1.3 * ratio.iter().fold(1.0, |most: f64, v| most.max(*v));
    let plot = Plot {
        title: "Measured less computed, over what noise and element size leave".into(),
        x: Axis::linear("instant"),
        y: Axis::linear("root mean square (times expected)").with_range(0.0, highest),
        series: vec![Series::new("", Style::LineAndMarkers, place, ratio)],
        notes: Vec::new(),
    };
    let caption =
        "The residual of every instant over its expectation: 1 is what the noise leaves, above it the model fails";
    blocks.push(Block::Grid(vec![Block::Curves(Curves::new(&plot, caption)?)]));
    let row = |group: &Value| {
        vec![
            text(&group["name"]),
            format!("{:.2}", number(group, "times_expected")),
            format!("{:+.1}", number(group, "z")),
        ]
    };
    blocks.push(Block::Table {
        columns: ["region", "times expected", "standard deviations"].map(str::to_owned).into(),
        rows: groups("by_region").iter().map(row).collect(),
    });
    Ok(blocks)
}

/// The strings of a list.
fn strings(value: &Value) -> Vec<String> {
    value.as_array().into_iter().flatten().filter_map(|line| line.as_str().map(str::to_owned)).collect()
}

/// A sentence that begins a paragraph; one that begins with a symbol stays.
fn capital(sentence: &str) -> String {
    let word = sentence.split([' ', ',']).next().unwrap_or("");
    match sentence.chars().next() {
        Some(first) if !word.contains('_') && word.len() > 1 => {
            first.to_uppercase().chain(sentence.chars().skip(1)).collect()
        }
        _ => sentence.to_owned(),
    }
}

/// A quantity with its uncertainty and unit, as `fit.json` has it.
fn quantity(entry: &Value) -> String {
    let unit = entry["unit"].as_str().unwrap_or("");
    let value = entry["value"].as_f64().or(entry.as_f64()).unwrap_or(f64::NAN);
    match entry["std"].as_f64() {
        Some(std) => format!("{} \u{b1} {} {unit}", significant(value, 4), significant(std, 2)),
        None => format!("{} {unit}", significant(value, 4)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_their_significant_digits() {
        assert_eq!(significant(0.0050123, 3), "0.00501");
        assert_eq!(significant(73.576, 4), "73.58");
        assert_eq!(significant(1.0e-9, 2), "1.0e-9");
        assert_eq!(significant(-123456.0, 3), "-123456");
        assert_eq!(significant(f64::NAN, 3), "-");
    }

    #[test]
    fn one_early_one_middle_and_the_last_instant_are_drawn() {
        assert_eq!(chosen(19), [4, 9, 18]);
        assert_eq!(chosen(1), [0]);
        assert_eq!(chosen(2), [0, 1]);
        assert!(chosen(0).is_empty());
    }
}
