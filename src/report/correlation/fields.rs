//! Mesh and fields over the reference image.
//!
//! Drawn as pixels at once, without letters: a page with many of them is made in a moment.

use super::{CorrelationReport, DrawnFrame};
use crate::field::{DOUBTFUL, TensorStrain};
use crate::report::map::{Cell, element_cells, nodal_cells};
use crate::report::page::{Block, Map, Pixels, Section};
use crate::report::raster::Layer;
use crate::report::scale::{LARGEST, Palette, Range, percentiles};
use crate::report::scene::{BLACK, COLOURS, Rgb, WHITE};
use crate::report::words::significant;
use crate::report::{Backdrop, ReportError};
use rayon::prelude::*;

/// Longer side of a map.
const LONGER_SIDE: f64 = 640.0;
/// Length of a colour bar.
const BAR: u32 = 256;
/// How much a field hides of the image.
const OPACITY: f64 = 0.75;
/// Meshes with elements smaller than this on the map are shown as areas, without their edges.
const LEAST_ELEMENT: f64 = 3.0;

/// One field as it is drawn.
struct Drawn<'a> {
    caption: String,
    unit: &'a str,
    palette: Palette,
    cells: Vec<Cell>,
}

/// The image in the size of a map.
struct Sheet {
    picture: Pixels,
    /// Pixels of the map per px of the image.
    scale: f64,
    mean: u8,
}

impl Sheet {
    fn new(backdrop: &Backdrop) -> Self {
        let size = backdrop.size();
        let scale = LONGER_SIDE / size[0].max(size[1]) as f64;
        let [width, height] = size.map(|side| (side as f64 * scale).round().max(1.0) as u32);
        let mut rgb = Vec::with_capacity(3 * width as usize * height as usize);
        for row in 0..height {
            for column in 0..width {
                let [x, y] = [column, row].map(|at| (f64::from(at) + 0.5) / scale - 0.5);
                rgb.extend([backdrop.grey(x, y); 3]);
            }
        }
        Self { picture: Pixels { width, height, rgb }, scale, mean: backdrop.mean() }
    }

    /// Where a point of the image (px) lies on the map.
    fn place(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [(x + 0.5) * self.scale, (y + 0.5) * self.scale]
    }

    fn layer(&self) -> Layer {
        Layer::new(self.picture.width, self.picture.height)
    }

    /// A line of one pixel.
    fn line(&self, picture: &mut Pixels, from: [f64; 2], to: [f64; 2], colour: Rgb) {
        let steps = (to[0] - from[0]).abs().max((to[1] - from[1]).abs()).ceil();
        // Nobody sees a line to far beyond the image; a place that is none has no line.
        let last = if steps <= 1e5 { steps as i64 } else { -1 };
        for step in 0..=last {
            let t = step as f64 / steps.max(1.0);
            let [x, y] = [0, 1].map(|c| (from[c] + t * (to[c] - from[c])).floor());
            if (0.0..f64::from(picture.width)).contains(&x) && (0.0..f64::from(picture.height)).contains(&y) {
                let at = 3 * (y as usize * picture.width as usize + x as usize);
                picture.rgb[at..at + 3].copy_from_slice(&colour);
            }
        }
    }
}

impl CorrelationReport<'_> {
    pub(super) fn fields(&self) -> Result<Section, ReportError> {
        let sheet = Sheet::new(self.reference);
        let Some(last) = self.drawn.last() else {
            let blocks = vec![Block::warning("No frame has a field.")];
            return Ok(Section { title: "Fields".into(), blocks });
        };
        let about = format!(
            "Over the reference image. Colours go from the 1st to the 99th percentile of the values that are not hatched; what is \
             beyond has the colour of the end. Hatched: the standard uncertainty of a node is above {DOUBTFUL} times the median. \
             Displacements are positive to the right and down. All frames, with values under the pointer, profiles and gauges: \
             `quadrille view` with the folder of this page."
        );
        let mut drawn = Vec::new();
        for frame in self.drawn {
            let is_last = frame.number == last.number;
            drawn.extend(self.of_frame(frame, is_last)?.into_iter().map(|drawn| (frame, drawn)));
        }
        let maps = drawn.into_par_iter().map(|(frame, drawn)| self.map(&sheet, frame, drawn));
        let mut maps = maps.collect::<Result<Vec<_>, _>>()?;
        maps.insert(0, self.mesh(&sheet, last)?);
        Ok(Section { title: "Fields".into(), blocks: vec![Block::Text(about), Block::Grid(maps)] })
    }

    /// The fields of a frame: of the last one all, of others displacements and the larger of the normal strains.
    fn of_frame(&self, frame: &DrawnFrame, is_last: bool) -> Result<Vec<Drawn<'static>>, ReportError> {
        let (field, number) = (&frame.field, frame.number);
        let mut drawn = Vec::new();
        let mut add = |what: &str, unit, palette, cells| {
            drawn.push(Drawn { caption: format!("{what}, frame {number}"), unit, palette, cells });
        };
        for (c, name) in ["Displacement ux, to the right", "Displacement uy, down"].into_iter().enumerate() {
            let values: Vec<f64> = field.at_points().iter().map(|u| u[c]).collect();
            add(name, "px", Palette::Viridis, nodal_cells(field, &values)?);
        }
        let names = ["Strain exx", "Strain eyy", "Shear strain exy"];
        let spread = |strains: &[Option<TensorStrain>], c: usize| {
            let values = strains.iter().flatten().map(|e| e.components()[c]).collect();
            percentiles(values).map_or(0.0, |[low, high]| low.abs().max(high.abs()))
        };
        let larger = usize::from(spread(&frame.strain.elements, 1) > spread(&frame.strain.elements, 0));
        for c in (0..3).filter(|&c| is_last || c == larger) {
            let value = |e: Option<TensorStrain>| e.map_or(f64::NAN, |e| e.components()[c]);
            match &frame.strain.window {
                Some(window) => {
                    let values: Vec<f64> = window.nodes.iter().map(|at| value(at.map(|(e, _)| e))).collect();
                    let length = window.window.gauge_length(self.element_px);
                    let name = format!("{} over a virtual strain gauge of {length:.0} px", names[c]);
                    add(&name, "", Palette::BlueRed, nodal_cells(field, &values)?);
                }
                None => {
                    let values: Vec<f64> = frame.strain.elements.iter().map(|e| value(*e)).collect();
                    add(names[c], "", Palette::BlueRed, element_cells(field, &values)?);
                }
            }
        }
        if is_last {
            let rms = |s: &[f64; 2]| (0.5 * (s[0] * s[0] + s[1] * s[1])).sqrt();
            let sigma: Vec<f64> = field.sigma_at_points().iter().map(rms).collect();
            let name = "Residual of each element, rms: uniform where there is only noise";
            if !field.element_residual.is_empty() {
                add(name, "grey levels", Palette::Plasma, element_cells(field, &field.element_residual)?);
            }
            let name = "Standard uncertainty of the displacement, rms of both components";
            add(name, "px", Palette::Viridis, nodal_cells(field, &sigma)?);
        }
        Ok(drawn)
    }

    fn mesh(&self, sheet: &Sheet, frame: &DrawnFrame) -> Result<Block, ReportError> {
        let (mesh, measured) = (&frame.field.mesh, &frame.field.measured);
        let mut picture = sheet.picture.clone();
        let is_whole = |nodes: &[u32; 4]| nodes.iter().all(|&node| measured[node as usize]);
        let colour_of = |zone: u32| COLOURS[zone as usize % COLOURS.len()];
        let elements = || mesh.elements().iter().zip(mesh.element_zone()).filter(|(nodes, _)| is_whole(nodes));
        let corners = |nodes: &[u32; 4]| nodes.map(|node| sheet.place(mesh.nodes()[node as usize]));
        let has_edges = self.element_px * sheet.scale >= LEAST_ELEMENT;
        if !has_edges {
            let mut layer = sheet.layer();
            elements().for_each(|(nodes, &zone)| layer.fill(corners(nodes), |_| colour_of(zone)));
            layer.over(&mut picture.rgb, 0.4);
        }
        for (nodes, &zone) in elements().filter(|_| has_edges) {
            let corners = corners(nodes);
            (0..4).for_each(|k| sheet.line(&mut picture, corners[k], corners[(k + 1) % 4], colour_of(zone)));
        }
        let n = elements().count();
        let caption = format!(
            "Mesh, a colour for each zone ({}): {n} of {} elements have all nodes measured in frame {}",
            mesh.zones().join(", "),
            mesh.n_elements(),
            frame.number
        );
        Ok(Block::Map(Map::of_pixels(&picture, None, caption)?))
    }

    fn map(&self, sheet: &Sheet, frame: &DrawnFrame, drawn: Drawn<'_>) -> Result<Block, ReportError> {
        let Drawn { caption, unit, palette, cells } = drawn;
        let mesh = &frame.field.mesh;
        let doubtful = frame.field.doubtful();
        let is_doubtful = |nodes: &[u32; 4]| nodes.iter().any(|&node| doubtful[node as usize]);
        let shown = || mesh.elements().iter().zip(&cells).filter_map(|(nodes, cell)| Some((nodes, cell.as_ref()?)));
        let told = |hatched: bool| -> Vec<f64> {
            let of = shown().filter(|(nodes, _)| hatched || !is_doubtful(nodes));
            of.flat_map(|(_, values)| values.iter().copied()).filter(|v| v.abs() <= LARGEST).collect()
        };
        // Where everything is to be doubted there is nothing else to tell.
        let Some([low, high]) = percentiles(told(false)).or_else(|| percentiles(told(true))) else {
            return Ok(Block::Text(format!("{caption}: nothing to draw.")));
        };
        let ends = if palette.is_diverging() { Range { low, high }.symmetric() } else { Range { low, high } };
        let range = Range::of([ends.low, ends.high].into_iter()).unwrap_or(Range { low: 0.0, high: 1.0 });
        let mut layer = sheet.layer();
        for (nodes, values) in shown() {
            let corners = nodes.map(|node| sheet.place(mesh.nodes()[node as usize]));
            layer.fill_values(corners, *values, palette, range);
        }
        let mut picture = sheet.picture.clone();
        layer.over(&mut picture.rgb, OPACITY);
        let mut hatch = sheet.layer();
        let hatched = frame.field.hatched();
        let drawn = mesh.elements().iter().zip(&cells).zip(hatched);
        for ((nodes, _), _) in drawn.filter(|((_, cell), hatched)| *hatched && cell.is_some()) {
            hatch.hatch(nodes.map(|node| sheet.place(mesh.nodes()[node as usize])), [WHITE, BLACK]);
        }
        hatch.over(&mut picture.rgb, 1.0);
        let mut bar = Pixels { width: BAR, height: 1, rgb: [sheet.mean; 3].repeat(BAR as usize) };
        Layer::bar(palette, BAR).over(&mut bar.rgb, OPACITY);
        let end = |v: f64| format!("{} {unit}", significant(v, 3)).trim_end().to_owned();
        Ok(Block::Map(Map::of_pixels(&picture, Some((&bar, [end(range.low), end(range.high)])), caption)?))
    }
}
