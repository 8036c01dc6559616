//! Figures of a joint: a field on its deformed mesh, and profiles along the adhesive.

use crate::report::axes::{BORDER, GAP, Letters, Lines, Side, SideAxis};
use crate::report::map::check_length;
use crate::report::raster::Layer;
use crate::report::scale::{Palette, Range, ticks};
use crate::report::scene::{Anchor, BLACK, Path, Rect, Scene, Stroke};
use crate::report::{Look, Picture, Plot, PlotSeries, ReportError, Style};

/// Longer side of the map.
const LONGER_SIDE: f64 = 820.0;
const BAR_HEIGHT: i32 = 18;
/// Device pixels per unit of the sheet.
const RATIO: u32 = 2;
/// Meshes with more elements are drawn without their edges.
const EDGES_UP_TO: usize = 4_000;

/// A field on the mesh of a joint, lengths in mm with y up.
#[derive(Debug, Clone)]
pub struct JointMap<'a> {
    /// Above the picture.
    pub title: String,
    /// Beside the bar: the quantity with its unit.
    pub label: String,
    /// Lines of text below the picture.
    pub notes: Vec<String>,
    /// Positions of the nodes, where they are drawn.
    pub nodes: &'a [[f64; 2]],
    /// Corners of the elements.
    pub elements: &'a [[u32; 4]],
    /// One value for each node.
    pub values: &'a [f64],
}

impl JointMap<'_> {
    /// Draws the field in colours, white or neutral at zero where it has both signs.
    ///
    /// # Errors
    /// Another number of values than of nodes, values or positions without a finite range.
    pub fn draw(&self) -> Result<Picture, ReportError> {
        let look = Look::chosen();
        let longer = look.side(LONGER_SIDE);
        let picture = self.of_side(longer, look)?;
        let (width, map) = (picture.sheet()[0] as i32, picture.map_on_sheet().width as i32);
        match look.narrowed(longer, width, map) {
            Some(longer) => self.of_side(longer, look),
            None => Ok(picture),
        }
    }

    fn of_side(&self, longer: f64, look: Look) -> Result<Picture, ReportError> {
        check_length("nodes", self.nodes.len(), self.values.len())?;
        let nothing = ReportError::Range { low: 0.0, high: 0.0 };
        let Some(range) = Range::of(self.values.iter().copied()) else { return Err(nothing) };
        let (range, palette) = match range.low < 0.0 && range.high > 0.0 {
            true => (range.symmetric(), Palette::BlueRed),
            false => (range, Palette::Viridis),
        };
        let bounds =
            |c: usize, pick: fn(f64, f64) -> f64, start: f64| self.nodes.iter().map(|p| p[c]).fold(start, pick);
        let low = [0, 1].map(|c| bounds(c, f64::min, f64::INFINITY));
        let high = [0, 1].map(|c| bounds(c, f64::max, f64::NEG_INFINITY));
        let room = 0.03 * (high[0] - low[0]).max(high[1] - low[1]);
        let (low, high) = (low.map(|v| v - room), high.map(|v| v + room));
        let extent = [high[0] - low[0], high[1] - low[1]];
        if !(extent[0] > 0.0 && extent[1] > 0.0 && extent[0].is_finite() && extent[1].is_finite()) {
            return Err(ReportError::Range { low: low[0], high: high[0] });
        }
        let scale = longer / extent[0].max(extent[1]);
        let [width, height] = extent.map(|side| ((side * scale).round() as i32).max(160));

        let letters = Letters::new(look);
        let across = |text: &str| letters.small.width(text);
        let upright = |_: &str| f64::from(letters.small.digit());
        let axis_x = Range { low: low[0], high: high[0] };
        let axis_y = Range { low: low[1], high: high[1] };
        let factor = [f64::from(width) / extent[0], f64::from(height) / extent[1]];
        let bottom = SideAxis::new(
            Side::Bottom,
            &ticks(axis_x, f64::from(width), 0.0, 28.0, across),
            |v| (v - low[0]) * factor[0],
            "x (mm)",
        );
        let left = SideAxis::new(
            Side::Left,
            &ticks(axis_y, f64::from(height), 0.0, 18.0, upright),
            |v| (high[1] - v) * factor[1],
            "y (mm), up",
        );
        let bar = SideAxis::new(
            Side::Bottom,
            &ticks(range, f64::from(width), 0.0, 24.0, across),
            |v| range.fraction(v) * f64::from(width),
            letters.normal.fit(&self.label, f64::from(width)),
        );
        let aside = [left.thickness(&letters), bottom.overhang(&letters, width).max(bar.overhang(&letters, width))];
        let inner = aside[0].max(aside[1]) + width + aside[1];
        let (mut head, mut foot) = (Lines::default(), Lines::default());
        head.title(&letters, &self.title, inner);
        foot.notes(&letters, &self.notes, inner);
        let over = left.overhang(&letters, height);
        let map =
            Rect { x: BORDER + aside[0].max(aside[1]), y: BORDER + head.height(&letters) + GAP + over, width, height };
        let strip =
            Rect { y: map.bottom() + bottom.thickness(&letters).max(over) + 2 * GAP, height: BAR_HEIGHT, ..map };
        let foot_top = strip.bottom() + bar.thickness(&letters) + 2 * GAP;
        let mut scene = Scene::new(inner + 2 * BORDER, foot_top + foot.height(&letters) + BORDER);

        let place = |node: u32| {
            let [x, y] = self.nodes[node as usize];
            [(x - low[0]) * factor[0], (high[1] - y) * factor[1]]
        };
        let mut layer = Layer::new(width as u32 * RATIO, height as u32 * RATIO);
        for corners in self.elements {
            let values = corners.map(|node| self.values[node as usize]);
            let corners = corners.map(|node| place(node).map(|v| v * f64::from(RATIO)));
            layer.fill_values(corners, values, palette, range);
        }
        let size = |rect: Rect| [rect.x, rect.y, rect.width, rect.height].map(f64::from);
        scene.clip(map);
        scene.image(size(map), &layer.png(), 1.0);
        if self.elements.len() <= EDGES_UP_TO {
            let mut edges = Path::default();
            for corners in self.elements {
                edges.polygon(corners.map(|node| {
                    let [x, y] = place(node);
                    [x + f64::from(map.x), y + f64::from(map.y)]
                }));
            }
            scene.stroke(&edges, &Stroke::new(BLACK, 0.35));
        }
        scene.unclip();
        scene.frame(map, BLACK);
        bottom.draw(&mut scene, &letters, map);
        left.draw(&mut scene, &letters, map);
        scene.image(size(strip), &Layer::bar(palette, width as u32).png(), 1.0);
        scene.frame(strip, BLACK);
        bar.draw(&mut scene, &letters, strip);
        let middle = f64::from(inner + 2 * BORDER) / 2.0;
        head.draw(&mut scene, &letters, Anchor::Middle, middle, BORDER);
        foot.draw(&mut scene, &letters, Anchor::Start, f64::from(BORDER), foot_top);
        Ok(scene.finish((&self.title, &self.notes), look, map, Some(strip), RATIO))
    }
}

/// Values along the adhesive at several instants.
#[derive(Debug, Clone, Default)]
pub struct JointProfiles {
    /// Above the picture.
    pub title: String,
    /// The quantity with its unit.
    pub label: String,
    /// Name of each instant, its values (one per node pair), and the crack front (mm along the joint), if any.
    pub instants: Vec<(String, Vec<f64>, Option<f64>)>,
    /// Distance of each node pair from the first, mm.
    pub along: Vec<f64>,
    /// Lines of text below the picture.
    pub notes: Vec<String>,
}

impl JointProfiles {
    /// The largest value by size.
    pub fn largest(&self) -> f64 {
        self.instants.iter().flat_map(|(_, values, _)| values).fold(0.0, |most, value| most.max(value.abs()))
    }

    /// Draws one line per instant, and a marker on it where its crack front lies.
    ///
    /// # Errors
    /// Another number of values than of node pairs.
    pub fn draw(&self) -> Result<Picture, ReportError> {
        let mut series: Vec<PlotSeries> = (self.instants.iter())
            .map(|(name, values, _)| PlotSeries::new(name, Style::Line, self.along.clone(), values.clone()))
            .collect();
        let (mut x, mut y) = (Vec::new(), Vec::new());
        for (_, values, front) in &self.instants {
            let Some(front) = *front else { continue };
            let after = self.along.partition_point(|&s| s < front).clamp(1, self.along.len() - 1);
            let [a, b] = [self.along[after - 1], self.along[after]];
            let share = if b > a { (front - a) / (b - a) } else { 0.0 };
            x.push(front);
            y.push(values[after - 1] + share * (values[after] - values[after - 1]));
        }
        if !x.is_empty() {
            series.push(PlotSeries::new("crack front", Style::Markers, x, y));
        }
        let plot = Plot::new(&self.title, "distance along the joint (mm)", &self.label, series);
        Plot { notes: self.notes.clone(), ..plot }.draw()
    }
}
