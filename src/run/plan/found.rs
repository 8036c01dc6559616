//! The zones of a run that names none: where the specimen is in the reference.

use crate::correlate::{Bodies, Reference};
use crate::imaging::{Image, LeftOut, OddLevels, Pixels, Specimen, SpecimenPart};
use crate::io::case::{CaseGuard, CaseZone};
use crate::io::images::{png_bytes, sha256};
use crate::mesh::{Guard, Mask, Mesh, MeshError, Roi, Zone};
use crate::report::summary::STILL;
use crate::report::{Backdrop, MeshOptions, mesh_figure};
use crate::run::folder::FIGURES;
use crate::run::plan::Plan;
use crate::run::words::{Result, RunError, absolute, file_name};
use crate::units::{PixelSize, Px};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Pixels left out along a border beside which there is no texture: as far as interpolation and gradient reach.
const GUARD_PX: f64 = 3.0;
/// Begins the names of masks.
const MASK: &str = "zone";
const PICTURE: &str = "mesh.png";

#[derive(Debug, Default)]
pub(crate) struct Found {
    pub zones: Vec<Zone>,
    /// The same as a case file has them, so that a run of `run.toml` has them without a search.
    pub cases: Vec<CaseZone>,
    /// Their masks, where they are no rectangles: name and content of each file.
    masks: Vec<(PathBuf, Vec<u8>)>,
    /// The pixels of each zone.
    parts: Vec<SpecimenPart>,
    /// What was found and what was left out, on one line.
    pub note: String,
}

impl Found {
    /// Looks for the specimen in `reference`; its masks will lie in `folder`, or nowhere when that is empty. A `guard`
    /// that was asked for stands for the usual one.
    pub fn on(reference: &Image, plan: &Plan, folder: &Path) -> Result<Self> {
        let options = &plan.options;
        let size = options.element_size;
        let (width, height) = (reference.width(), reference.height());
        if !(4..=128).contains(&size) {
            return Err(RunError::Reference(MeshError::ElementSize { size }.to_string()));
        }
        if size > width.min(height) {
            let (zone, width, height) = ("image".to_owned(), width as f64, height as f64);
            let error = MeshError::TooSmall { zone, width, height, size };
            return Err(RunError::Reference(format!("{}: {error}", plan.reference_name())));
        }
        let margin = margin_of(reference, size);
        let specimen = Specimen::find(reference, size, margin);
        let holds_of = |part: &SpecimenPart, size: usize| holds_element(part, size, options.element_share);
        let parts: Vec<&SpecimenPart> = specimen.parts.iter().filter(|part| holds_of(part, size)).collect();
        if parts.is_empty() {
            let left_out = in_words(specimen.left_out);
            let would_do =
                |&size: &usize| Specimen::find(reference, size, margin).parts.iter().any(|part| holds_of(part, size));
            let mut sizes =
                [2 * size, 4 * size, size / 2, size / 4].into_iter().filter(|size| (4..=128).contains(size));
            let advice = match (OddLevels::of(reference), sizes.find(would_do)) {
                (Some(odd), _) => odd.to_string(),
                (None, Some(other)) => format!("with elements of {other} px one is: --element-size {other}"),
                (None, None) => "check exposure and focus".to_owned(),
            };
            return Err(RunError::Reference(format!(
                "{}: no zone is named, and none is found: nowhere does the reference show texture over a few elements of \
                 {size} px ({left_out}); {advice}, or name the zone with --roi",
                plan.reference_name()
            )));
        }
        let percent = |part: &&SpecimenPart| format!("{:.0} %", 100.0 * part.n_pixels as f64 / (width * height) as f64);
        let shares: Vec<String> = parts.iter().map(percent).collect();
        let which = if let [share] = shares.as_slice() {
            format!("zone found: {share}")
        } else {
            format!("{} zones found: {}", shares.len(), shares.join(", "))
        };
        let mut note = format!("{which} of the image; left out: {}", in_words(specimen.left_out));
        if !folder.as_os_str().is_empty() {
            note.push_str(&format!(" (drawn in {})", folder.join(FIGURES).join(PICTURE).display()));
        }
        let parts = parts.into_iter().cloned().collect();
        Self { note, ..Self::default() }.lay(parts, None, reference, plan, folder)
    }

    /// The same with a zone for each of the `bodies` that move apart, by the elements of `mesh`, the mesh on these zones.
    pub fn part(&self, bodies: &Bodies, mesh: &Mesh<Px>, image: &Image, plan: &Plan, folder: &Path) -> Result<Self> {
        let of_body = |body: usize| -> Vec<SpecimenPart> {
            let of_zone = |(zone, part): (usize, &SpecimenPart)| {
                let elements = mesh.zone_elements(zone).filter(|&element| bodies.is_of(element, body));
                part.within(&elements.map(|element| mesh.pixel_box(element)).collect::<Vec<_>>())
            };
            self.parts.iter().enumerate().filter_map(of_zone).collect()
        };
        let moving: Vec<SpecimenPart> = (0..bodies.moving).flat_map(of_body).collect();
        let still = bodies.has_still.then(|| SpecimenPart::joined(&of_body(bodies.moving))).flatten();
        let mut note = self.note.clone();
        if bodies.moving > 1 {
            note.push_str(&format!("; bodies that move apart are zones of their own, {} of them", bodies.moving));
        }
        if still.is_some() {
            note.push_str(&format!("; what stays still while the rest moves is the zone '{STILL}'"));
        }
        Self { note, ..Self::default() }.lay(moving, still, image, plan, folder)
    }

    /// Makes a zone of each part, and of what is `still`.
    fn lay(
        mut self,
        parts: Vec<SpecimenPart>,
        still: Option<SpecimenPart>,
        image: &Image,
        plan: &Plan,
        folder: &Path,
    ) -> Result<Self> {
        let (size, guard) = (plan.options.element_size, plan.guard_px);
        let (width, height, margin) = (image.width(), image.height(), margin_of(image, size));
        let n = parts.len();
        let name = |at: usize| if n == 1 { "specimen".to_owned() } else { format!("specimen{}", at + 1) };
        let named = parts.into_iter().enumerate().map(|(at, part)| (name(at), part));
        for (name, part) in named.chain(still.map(|part| (STILL.to_owned(), part))) {
            let [x0, y0, x1, y1] = part.bounds;
            let (left, right) = whole_elements(x0, x1, width, size, margin);
            let (top, bottom) = whole_elements(y0, y1, height, size, margin);
            let roi = [left, top, right, bottom];
            match &part.bits {
                None => {
                    let at_margin = [x0 == margin, y0 == margin, x1 + margin == width, y1 + margin == height];
                    self.rectangle(name, roi, at_margin, guard);
                }
                Some(_) => self.mask(name, &part, image, roi, guard, folder)?,
            }
            self.parts.push(part);
        }
        Ok(self)
    }

    /// A zone that is all of its box, and a guard at those of its sides that do not end at the margin.
    fn rectangle(&mut self, name: String, roi: [f64; 4], at_margin: [bool; 4], guard: Option<f64>) {
        let sides = at_margin.map(|at_margin| if at_margin { 0.0 } else { GUARD_PX });
        let (guard, guard_px) = match guard {
            Some(guard) => (Guard::All(guard), Some(CaseGuard::All(guard))),
            None if sides == [0.0; 4] => (Guard::default(), None),
            None => {
                let [left, top, right, bottom] = sides;
                (Guard::Sides(sides.to_vec()), Some(CaseGuard::Rectangle { left, top, right, bottom }))
            }
        };
        self.zones.push(Zone { guard, ..Zone::rectangle(name.clone(), in_px(roi)) });
        self.cases.push(CaseZone { name: Some(name), roi: Some(roi), guard_px, ..CaseZone::default() });
    }

    /// A zone of any shape, by its mask.
    fn mask(
        &mut self,
        name: String,
        part: &SpecimenPart,
        image: &Image,
        roi: [f64; 4],
        guard: Option<f64>,
        folder: &Path,
    ) -> Result<()> {
        let (width, height) = (image.width(), image.height());
        let pixels = || (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let bits: Vec<bool> = pixels().map(|(x, y)| part.contains(x, y)).collect();
        let levels = bits.iter().map(|&bit| if bit { u8::MAX } else { 0 }).collect();
        let drawn = Image::new(width, height, Pixels::U8(levels)).map_err(|error| error.to_string())?;
        let number = self.masks.len();
        let file = if number == 0 { format!("{MASK}.png") } else { format!("{MASK}-{}.png", number + 1) };
        let path = folder.join(file);
        self.masks.push((path.clone(), png_bytes(&drawn)?));
        let guard = guard.unwrap_or(GUARD_PX);
        let mask = Mask::new(width, height, bits).map(Arc::new);
        self.zones.push(Zone { mask, guard: Guard::All(guard), ..Zone::rectangle(name.clone(), in_px(roi)) });
        let (mask, guard_px) = (Some(absolute(&path)), Some(CaseGuard::All(guard)));
        self.cases.push(CaseZone { name: Some(name), roi: Some(roi), mask, guard_px, ..CaseZone::default() });
        Ok(())
    }

    pub fn files(&self) -> Vec<(PathBuf, String)> {
        self.masks.iter().map(|(path, bytes)| (path.clone(), sha256(bytes))).collect()
    }

    /// Writes the masks that are not there yet. Other processes may do the same at the same time.
    pub fn write(&self) -> Result<()> {
        for (path, bytes) in &self.masks {
            if std::fs::read(path).is_ok_and(|there| there == *bytes) {
                continue;
            }
            let part = path.with_extension(format!("png.{}.part", std::process::id()));
            let written = std::fs::write(&part, bytes).and_then(|()| std::fs::rename(&part, path));
            written.map_err(|error| RunError::file(path, "written", error))?;
        }
        Ok(())
    }
}

fn in_px([x0, y0, x1, y1]: [f64; 4]) -> Roi {
    Roi { x0, y0, x1, y1 }
}

/// What leaves the image is counted out; half an element keeps that away from the outermost nodes for small motion.
fn margin_of(image: &Image, size: usize) -> usize {
    (size / 2).min(image.width().min(image.height()) / 16)
}

/// An extent from `low` to `high`, cut to whole elements at the margin of the image: there an element that is half
/// outside would do no good.
fn whole_elements(low: usize, high: usize, n: usize, size: usize, margin: usize) -> (f64, f64) {
    let rest = (high - low) % size;
    let (low, high) = match (low == margin, high + margin == n) {
        _ if high - low < size => (low, high),
        (true, true) => (low + rest / 2, high - (rest - rest / 2)),
        (true, false) => (low + rest, high),
        (false, true) => (low, high - rest),
        (false, false) => (low, high),
    };
    (low as f64, high as f64)
}

/// Whether a mesh on the part has an element: squares of `size` px from the corner of its box that hold their share of
/// pixels.
fn holds_element(part: &SpecimenPart, size: usize, share: f64) -> bool {
    let [x0, y0, x1, y1] = part.bounds;
    if part.bits.is_none() {
        return x1 - x0 >= size && y1 - y0 >= size;
    }
    let square = |x: usize, y: usize| {
        let within = (y..y + size).flat_map(|y| (x..x + size).map(move |x| (x, y)));
        within.filter(|&(x, y)| part.contains(x, y)).count() as f64 >= share * (size * size) as f64
    };
    (y0..y1).step_by(size).any(|y| (x0..x1).step_by(size).any(|x| square(x, y)))
}

/// Shares that are left out, the larger first; what is less than half a per cent is not named.
fn in_words(LeftOut { textureless, saturated, apart, border }: LeftOut) -> String {
    let reasons = [
        (textureless, "without texture"),
        (saturated, "saturated"),
        (apart, "in pieces apart or too narrow"),
        (border, "at the border of the image"),
    ];
    let mut named: Vec<_> = reasons.into_iter().filter(|(share, _)| *share >= 0.005).collect();
    named.sort_by(|a, b| b.0.total_cmp(&a.0));
    let words: Vec<String> = named.iter().map(|(share, why)| format!("{:.0} % {why}", 100.0 * share)).collect();
    if words.is_empty() { "nothing".into() } else { words.join(", ") }
}

/// Draws the zones and their mesh into the pictures of the run in `folder`; above stands how large the field of view
/// is.
pub(crate) fn draw(plan: &Plan, image: &Image, prepared: &Reference, folder: &Path, notes: &[String]) -> Result<()> {
    let mesh: &Mesh<Px> = prepared.mesh();
    let (width, height) = (image.width(), image.height());
    let size = format!("{width} x {height} px");
    let field_of_view = plan.pixel_size.map_or(format!("field of view {size}"), |pixel: PixelSize| {
        let [x, y] = [width, height].map(|n| n as f64 * pixel.mm_per_px());
        format!("field of view {} x {} mm ({size})", digits(x), digits(y))
    });
    let name = file_name(plan.reference_name());
    let guard_of = |zone: &CaseZone| match zone.guard_px {
        Some(CaseGuard::All(guard)) => guard,
        _ => 0.0,
    };
    let mut measured = vec![true; mesh.n_nodes()];
    for fault in prepared.dropped() {
        measured.get_mut(fault.node).into_iter().for_each(|measured| *measured = false);
    }
    let options = MeshOptions {
        notes: notes.to_vec(),
        pixel_size: plan.pixel_size,
        guard_px: plan.zones.iter().map(guard_of).collect(),
        ..MeshOptions::new(format!("Zone on {name}: {field_of_view}"))
    };
    let folder = folder.join(FIGURES);
    std::fs::create_dir_all(&folder).map_err(|source| RunError::Folder { folder: folder.clone(), source })?;
    let picture = mesh_figure(&Backdrop::new(image, 1), mesh, Some(&measured), &options)?;
    Ok(picture.save(folder.join(PICTURE))?)
}

/// A length with three digits or more.
fn digits(mm: f64) -> String {
    let decimals = (2.0 - mm.abs().max(f64::MIN_POSITIVE).log10().floor()).clamp(0.0, 6.0) as usize;
    format!("{mm:.decimals$}")
}
