//! What was measured, and how.

use super::{IdentificationReport, OtherRigidMotion, choose_instants};
use crate::field::{Measurement, RigidMotion, Status};
use crate::identify::describe_change;
use crate::report::page::{Block, Map, Section};
use crate::report::summary::{ReferenceSummary, Summary};
use crate::report::words::{plain, significant};
use crate::report::{Backdrop, MapOptions, Name, Palette, ReportError, element_map_on, nodal_map_on};
use crate::units::{Px, Vector};

impl IdentificationReport<'_> {
    pub(super) fn measurement(&self) -> Result<Section, ReportError> {
        let summary = self.correlation;
        let mm = self.pixel_size.mm_per_px();
        let frames = &summary.frames;
        let n = frames.len();
        let converged = frames.iter().filter(|frame| frame.status == Status::Converged).count();
        let noise: Vec<f64> = frames.iter().flat_map(|frame| &frame.zones).map(|zone| zone.noise_grey).collect();
        let noise = (!noise.is_empty()).then(|| noise.iter().sum::<f64>() / noise.len() as f64);
        let of_squares = |(_, field): &(usize, Measurement<Px>)| {
            (0..field.mesh.n_elements()).all(|element| is_square(field.mesh.corners(element), self.element_px))
        };
        let shape = if self.frames.first().is_none_or(of_squares) { "squares of" } else { "quadrilaterals of about" };
        let [side, side_um] = [plain(self.element_px), significant(1e3 * mm * self.element_px, 4)];
        let ReferenceSummary { width_px, height_px, depth, .. } = &summary.reference;
        let Summary { n_elements, n_nodes, .. } = summary;
        let mut facts = Vec::new();
        let mut add = |name: &str, value: String| facts.push((name.to_owned(), value));
        add("images", format!("1 reference and {n} deformed, {width_px} x {height_px} px, {depth}"));
        add("resolution", format!("1 px = {} \u{b5}m", significant(1e3 * mm, 5)));
        let counts = format!("{n_elements} elements, {n_nodes} nodes in two strips");
        add("elements", format!("{shape} {side} px = {side_um} \u{b5}m, bilinear; {counts}"));
        add("adhesive", format!("{} \u{b5}m thick, not correlated; dark", significant(1e3 * self.thickness_mm, 4)));
        add("frames", format!("{converged} of {n} converged (tolerance {} px)", plain(summary.tolerance_px)));
        if let Some(noise) = noise {
            add("noise of one image", format!("{} grey levels, from the residual", significant(noise, 3)));
        }
        if let Some(sigma) = self.sigma_px() {
            let value = format!("{} px = {} nm", significant(sigma, 3), significant(1e6 * mm * sigma, 3));
            add("standard uncertainty of a nodal displacement (rms)", value);
        }
        add("device", summary.device.clone());
        let text = "The displacement of two strips beside the adhesive, by global image correlation on one mesh for \
                    each strip; pixels beside the dark adhesive are left out of the sums.";
        let mut blocks = vec![Block::text(text), Block::Facts(facts)];
        // With a fit they stand beside its verdict.
        if self.fit.is_none() {
            blocks.extend(self.warnings());
        }
        blocks.push(self.rigid_motion());
        let backdrop = Backdrop::new(self.reference, 1);
        let mut maps = Vec::new();
        let shown = choose_instants(self.frames.len());
        for &at in shown.iter().skip(1) {
            let (number, field) = &self.frames[at];
            for (c, name) in [(0, "u_x, to the right"), (1, "u_y, up")] {
                let micrometres = |&u: &[f64; 2]| 1e3 * self.pixel_size.to_mm(Vector::new(u)).components()[c];
                let values: Vec<f64> = field.displacement.iter().map(micrometres).collect();
                let caption = format!("Displacement {name}, frame {number}");
                maps.push(self.map(&backdrop, field, &values, false, caption, "\u{b5}m")?);
            }
        }
        if let Some((number, field)) = self.frames.last() {
            let caption = format!(
                "Residual |f - g(x + u)| of each element, frame {number}: what the displacement does not explain; \
                 cracks and reflections show here, noise alone is even"
            );
            maps.push(self.map(&backdrop, field, &field.element_residual, true, caption, "grey levels")?);
        }
        blocks.push(Block::Grid(maps));
        Ok(Section { title: "What was measured, and how".into(), blocks })
    }

    /// Frames that are left out, and remarks of the steps.
    pub(super) fn warnings(&self) -> Vec<Block> {
        let left_out = self.correlation.frames.iter().filter(|frame| frame.status != Status::Converged);
        let list: Vec<String> = left_out.map(|frame| format!("{} ({})", frame.number, frame.status.name())).collect();
        let left_out = format!("Left out, because they did not converge: frames {}.", list.join(", "));
        let left_out = (!list.is_empty()).then_some(Block::warning(left_out));
        left_out.into_iter().chain(self.remarks.iter().map(Block::of_remark)).collect()
    }

    /// Root mean square of the standard uncertainty of the measured displacements, px.
    fn sigma_px(&self) -> Option<f64> {
        let fields = self.frames.iter().flat_map(|(_, field)| field.sigma.iter().zip(&field.measured));
        let known = fields.filter(|(_, measured)| **measured);
        let (sum, n) = known.fold((0.0, 0.0), |(sum, n), (s, _)| (sum + s[0] * s[0] + s[1] * s[1], n + 2.0));
        (n > 0.0).then(|| (sum / n).sqrt())
    }

    fn rigid_motion(&self) -> Block {
        let removed = &self.joint.removed;
        let mut motions = removed.clone();
        if removed.is_empty() {
            let motion = |u: &Vec<[f64; 2]>| {
                let at = |node: u32| self.joint.model.mesh().nodes()[node as usize];
                RigidMotion::fit(self.joint.boundary.nodes().iter().zip(u).map(|(&node, &u)| (at(node), u)))
            };
            motions.extend(self.joint.boundary.instants().iter().filter_map(motion));
        }
        let largest = |of: fn(&RigidMotion) -> f64| motions.iter().map(of).fold(0.0_f64, |most, v| most.max(v.abs()));
        let shift = 1e3 * largest(|m| m.translation[0].hypot(m.translation[1]));
        let turn = largest(|m| m.rotation_rad);
        let slide = 1e3 * turn * self.thickness_mm;
        let done = if removed.is_empty() { "It was kept" } else { "It was removed" };
        let mut effect = String::new();
        if let (Some(other), Some(fit)) = (self.other_rigid_motion, self.fit) {
            let choice = if removed.is_empty() { "Removed" } else { "Kept" };
            effect = match other {
                OtherRigidMotion::Failed { failed } => {
                    format!(" What the other choice would change is not known: {failed}.")
                }
                OtherRigidMotion::Found { parameters, .. } => {
                    let change = |name: &Name| {
                        let (value, changed) = (fit.parameters.get(name)?.value, parameters.get(&**name)?);
                        Some(format!("{name} {}", describe_change(changed / value - 1.0)))
                    };
                    let list: Vec<String> = self.fitted_names().iter().filter_map(change).collect();
                    format!(" {choice}, the parameters would change by (to first order): {}.", list.join(", "))
                }
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
}

/// Whether an element is a square with this side, but for rounding: sides and diagonals are as long.
fn is_square(corners: [[f64; 2]; 4], side: f64) -> bool {
    let length = |a: usize, b: usize| (corners[b][0] - corners[a][0]).hypot(corners[b][1] - corners[a][1]);
    let near = |length: f64, wanted: f64| (length - wanted).abs() < 1e-3 * side;
    (0..4).all(|k| near(length(k, (k + 1) % 4), side)) && near(length(0, 2), length(1, 3))
}
