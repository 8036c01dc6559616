//! A field in colours over the reference image, with axes and a colour bar.

use super::canvas::{BLACK, Canvas, Rgb, Type, mix};
use super::scale::{LARGEST, Palette, Range, Tick, colour, ticks};
use super::{Area, Picture, ReportError};
use crate::field::Measurement;
use crate::imaging::Image;
use crate::mesh::{Mesh, shape_functions};
use crate::units::Px;
use image::imageops::{self, FilterType};
use image::{ImageBuffer, Luma};

/// Longer side of the image in the picture.
const LONGER_SIDE: f64 = 900.0;
/// Free border of the picture.
const BORDER: i32 = 16;
const TICK_LENGTH: i32 = 6;
/// Between a tick, its label and the text beyond.
const GAP: i32 = 6;
const BAR_WIDTH: i32 = 20;
/// Tips of the bar where values lie beyond its range.
const TIP: i32 = 10;
/// Narrower than this, a title would stand in too many lines.
const LEAST_WIDTH: i32 = 440;
const NOTE: Rgb = [176, 0, 0];

/// How a map is drawn.
#[derive(Debug, Clone, PartialEq)]
pub struct MapOptions {
    /// Above the picture; broken into lines where it is long.
    pub title: String,
    /// Beside the colour bar: the quantity and its unit, as `Displacement along x (px)`.
    pub label: String,
    /// The values at the ends of the colour bar; `None` for the smallest and the largest value. Values
    /// beyond take the colour of the end, and a tip of the bar shows that there are such.
    pub range: Option<(f64, f64)>,
    /// The colours.
    pub palette: Palette,
    /// How much the field hides of the image: 0 nothing, 1 all.
    pub opacity: f64,
}

impl MapOptions {
    /// Viridis over the whole range of values, the image showing through.
    pub fn new(title: impl Into<String>, label: impl Into<String>) -> Self {
        Self { title: title.into(), label: label.into(), range: None, palette: Palette::default(), opacity: 0.7 }
    }
}

/// Draws `values`, one per node and interpolated in the elements, over the reference `image`.
///
/// An element with a node that was not measured (or whose value is not finite) is left transparent.
///
/// # Errors
/// Another number of values than of nodes, and a range that is none.
pub fn nodal_map(
    image: &Image,
    measurement: &Measurement<Px>,
    values: &[f64],
    options: &MapOptions,
) -> Result<Picture, ReportError> {
    let mesh = &measurement.mesh;
    if values.len() != mesh.n_nodes() {
        return Err(ReportError::Length { what: "nodes", expected: mesh.n_nodes(), got: values.len() });
    }
    let usable = |node: usize| measurement.measured[node] && values[node].abs() <= LARGEST;
    let cells = mesh.elements().iter().map(|nodes| {
        let nodes = nodes.map(|node| node as usize);
        nodes.iter().all(|&node| usable(node)).then(|| nodes.map(|node| values[node]))
    });
    draw(image, mesh, &cells.collect::<Vec<_>>(), note(measurement), options)
}

/// Draws `values`, one per element, over the reference `image`.
///
/// An element with a node that was not measured (or whose value is not finite) is left transparent.
///
/// # Errors
/// Another number of values than of elements, and a range that is none.
pub fn element_map(
    image: &Image,
    measurement: &Measurement<Px>,
    values: &[f64],
    options: &MapOptions,
) -> Result<Picture, ReportError> {
    let mesh = &measurement.mesh;
    if values.len() != mesh.n_elements() {
        return Err(ReportError::Length { what: "elements", expected: mesh.n_elements(), got: values.len() });
    }
    let cells = mesh.elements().iter().zip(values).map(|(nodes, &value)| {
        let measured = nodes.iter().all(|&node| measurement.measured[node as usize]);
        (measured && value.abs() <= LARGEST).then_some([value; 4])
    });
    draw(image, mesh, &cells.collect::<Vec<_>>(), note(measurement), options)
}

/// What to say when no element can be drawn.
fn note(measurement: &Measurement<Px>) -> &'static str {
    if measurement.measured.contains(&true) { "no element with four measured nodes" } else { "no measured node" }
}

/// The values at the four nodes of an element; `None` where it was not measured.
type Cell = Option<[f64; 4]>;

fn draw(
    image: &Image,
    mesh: &Mesh<Px>,
    cells: &[Cell],
    note: &str,
    options: &MapOptions,
) -> Result<Picture, ReportError> {
    let all = || cells.iter().flatten().flatten().copied();
    let natural = Range::of(all());
    let asked = options.range.map(|(low, high)| Range::new(low, high)).transpose()?;
    let bar = natural.map(|natural| asked.unwrap_or(natural)).map(|range| Bar {
        range,
        palette: options.palette,
        opacity: if options.opacity.is_finite() { options.opacity.clamp(0.0, 1.0) } else { 1.0 },
        below: asked.is_some() && all().any(|v| v < range.low),
        above: asked.is_some() && all().any(|v| v > range.high),
    });
    let layout = Layout::new(image, bar.as_ref(), note, options);
    let mut canvas = Canvas::new(layout.width, layout.height);
    let backdrop = Backdrop::new(image, layout.map.width, layout.map.height);
    layout.paint_backdrop(&mut canvas, &backdrop);
    if let Some(bar) = &bar {
        layout.paint_cells(&mut canvas, mesh, cells, bar);
        layout.paint_bar(&mut canvas, bar, backdrop.mean);
    }
    layout.paint_axes(&mut canvas);
    let bar = bar.is_some().then(|| layout.bar.area());
    Ok(Picture {
        width: canvas.width as u32,
        height: canvas.height as u32,
        rgb: canvas.rgb,
        map: layout.map.area(),
        bar,
    })
}

/// What the colour bar shows.
struct Bar {
    range: Range,
    palette: Palette,
    opacity: f64,
    /// Whether there are values below the range.
    below: bool,
    /// Whether there are values above the range.
    above: bool,
}

/// The image in the size of the picture, stretched from black to white.
struct Backdrop {
    grey: Vec<u8>,
    mean: u8,
}

impl Backdrop {
    fn new(image: &Image, width: i32, height: i32) -> Self {
        let (columns, rows) = (image.width() as u32, image.height() as u32);
        // From 0 to 1 first: `resize` clips floats to that.
        let (darkest, brightest) = image.range();
        let extent = if brightest > darkest { f64::from(brightest) - f64::from(darkest) } else { 1.0 };
        let grey = |x: u32, y: u32| f64::from(image.grey(x as usize, y as usize));
        let source =
            ImageBuffer::from_fn(columns, rows, |x, y| Luma([((grey(x, y) - f64::from(darkest)) / extent) as f32]));
        // Few pixels are shown as the squares they are; many are averaged, or moire would appear.
        let filter = if width as u32 >= 4 * columns { FilterType::Nearest } else { FilterType::Triangle };
        let values = imageops::resize(&source, width as u32, height as u32, filter).into_raw();
        // A few hot or dead pixels must not decide the contrast.
        let mut sorted = values.clone();
        sorted.sort_unstable_by(f32::total_cmp);
        let quantile = |part: f64| f64::from(sorted[((sorted.len() - 1) as f64 * part).round() as usize]);
        let (mut low, mut high) = (quantile(0.002), quantile(0.998));
        if low >= high {
            (low, high) = (quantile(0.0), quantile(1.0));
        }
        let stretch = |v: f32| if low < high { (f64::from(v) - low) / (high - low) } else { 0.5 };
        let grey: Vec<u8> = values.iter().map(|&v| (255.0 * stretch(v).clamp(0.0, 1.0)).round() as u8).collect();
        let mean = grey.iter().map(|&v| u64::from(v)).sum::<u64>() / grey.len() as u64;
        Self { grey, mean: mean as u8 }
    }
}

/// A rectangle of the canvas.
#[derive(Debug, Clone, Copy)]
struct Rect {
    x: i32,
    y: i32,
    width: i32,
    height: i32,
}

impl Rect {
    fn area(self) -> Area {
        let [x, y, width, height] = [self.x, self.y, self.width, self.height].map(|v| v as u32);
        Area { x, y, width, height }
    }
}

/// Where everything stands.
struct Layout {
    width: i32,
    height: i32,
    map: Rect,
    bar: Rect,
    /// Whether the bar lies below the image; otherwise it stands at its right.
    flat: bool,
    /// Picture pixels per image pixel, along x and y.
    scale: [f64; 2],
    title: Vec<String>,
    note: Vec<String>,
    label: String,
    x_ticks: Vec<Tick>,
    y_ticks: Vec<Tick>,
    bar_ticks: Vec<Tick>,
    /// Longest label of `y_ticks`.
    y_labels: i32,
    /// Longest label of `bar_ticks`.
    bar_labels: i32,
    small: Type,
    normal: Type,
    large: Type,
}

const X_TITLE: &str = "x (px)";
const Y_TITLE: &str = "y (px)";

impl Layout {
    fn new(image: &Image, bar: Option<&Bar>, note: &str, options: &MapOptions) -> Self {
        let (small, normal, large) = (Type::new(14), Type::new(15), Type::new(18));
        let size = [image.width() as f64, image.height() as f64];
        let factor = LONGER_SIDE / size[0].max(size[1]);
        let [map_width, map_height] = size.map(|side| (side * factor).round().max(1.0) as i32);
        let scale = [f64::from(map_width) / size[0], f64::from(map_height) / size[1]];
        // Beside a wide image a standing bar would be squashed.
        let flat = f64::from(map_width) > 1.5 * f64::from(map_height);

        let across = |text: &str| f64::from(small.width(text));
        let upright = |_: &str| f64::from(small.digit());
        let pixels = |side: f64| Range { low: -0.5, high: side - 0.5 };
        let x_ticks = ticks(pixels(size[0]), f64::from(map_width), 1.0, 28.0, across);
        let y_ticks = ticks(pixels(size[1]), f64::from(map_height), 1.0, 18.0, upright);
        let bar_ticks = bar.map_or(Vec::new(), |bar| {
            if flat {
                ticks(bar.range, f64::from(map_width), 0.0, 24.0, across)
            } else {
                ticks(bar.range, f64::from(map_height), 0.0, 36.0, upright)
            }
        });
        let longest = |ticks: &[Tick]| ticks.iter().map(|tick| across(&tick.label).ceil() as i32).max().unwrap_or(0);
        let (y_labels, bar_labels) = (longest(&y_ticks), longest(&bar_ticks));
        let half = |ticks: &[Tick]| (longest(ticks) + 1) / 2;

        // Around the image: labels at its corners reach half their size beyond it.
        let line = normal.digit() + normal.below();
        let left = (line + GAP + y_labels + GAP + TICK_LENGTH).max(half(&x_ticks));
        let y_title = normal.width(Y_TITLE).ceil() as i32;
        let above = ((y_title - map_height) / 2).max(TIP + 2).max(small.digit());
        let below_axis = TICK_LENGTH + GAP + small.digit() + GAP + small.below() + line;
        let mut below = below_axis.max((y_title - map_height) / 2 + 1);
        let mut right = half(&x_ticks).max((normal.width(X_TITLE).ceil() as i32 - map_width) / 2 + 1);
        let mut left = left;
        if bar.is_some() && flat {
            right = right.max(half(&bar_ticks)).max(TIP + 2);
            left = left.max(half(&bar_ticks));
            below += 2 * GAP + BAR_WIDTH + TICK_LENGTH + GAP + small.digit() + small.below() + GAP + line;
        } else if bar.is_some() {
            right += 2 * GAP + BAR_WIDTH + TICK_LENGTH + GAP + bar_labels + GAP + line + GAP;
        }

        let needed = left + map_width + right + 2 * BORDER;
        let width = needed.max(LEAST_WIDTH);
        let inner = (width - 2 * BORDER) as f32;
        let title = large.wrap(&options.title, inner);
        let note = if bar.is_some() { Vec::new() } else { normal.wrap(note, inner) };
        let lines = title.len() as i32 * line_height(&large) + note.len() as i32 * line_height(&normal);
        let head = if lines > 0 { lines + GAP } else { 0 };
        let map = Rect {
            x: BORDER + left + (width - needed) / 2,
            y: BORDER + head + above,
            width: map_width,
            height: map_height,
        };
        let height = map.y + map_height + below + BORDER;
        let bar_place = if flat {
            Rect { x: map.x, y: map.y + map_height + below_axis + 2 * GAP, width: map_width, height: BAR_WIDTH }
        } else {
            let gap = half(&x_ticks).max((normal.width(X_TITLE).ceil() as i32 - map_width) / 2 + 1) + 2 * GAP;
            Rect { x: map.x + map_width + gap, y: map.y, width: BAR_WIDTH, height: map_height }
        };
        let label = normal.fit(&options.label, if flat { inner } else { (above + map_height) as f32 });
        Self {
            width,
            height,
            map,
            bar: bar_place,
            flat,
            scale,
            title,
            note,
            label,
            x_ticks,
            y_ticks,
            bar_ticks,
            y_labels,
            bar_labels,
            small,
            normal,
            large,
        }
    }

    fn paint_backdrop(&self, canvas: &mut Canvas, backdrop: &Backdrop) {
        let Rect { x, y, width, height } = self.map;
        let mut grey = backdrop.grey.iter();
        for row in y..y + height {
            for (column, &grey) in (x..x + width).zip(&mut grey) {
                canvas.mix(column, row, [grey; 3], 1.0);
            }
        }
    }

    /// The canvas column (`axis` 0) or row (1) of the image coordinate `v`, as a fraction.
    fn place(&self, axis: usize, v: f64) -> f64 {
        f64::from([self.map.x, self.map.y][axis]) + (v + 0.5) * self.scale[axis]
    }

    /// The columns or rows of the map whose centres lie between the image coordinates `from` and `to`.
    fn centres(&self, axis: usize, from: f64, to: f64) -> std::ops::Range<i32> {
        let (start, length) = [(self.map.x, self.map.width), (self.map.y, self.map.height)][axis];
        let at = |v: f64| ((self.place(axis, v) - 0.5).ceil() as i32).clamp(start, start + length);
        at(from)..at(to)
    }

    fn paint_cells(&self, canvas: &mut Canvas, mesh: &Mesh<Px>, cells: &[Cell], bar: &Bar) {
        for zone in 0..mesh.zones().len() {
            let bounds = mesh.bounds(zone);
            let columns = self.centres(0, bounds.x0, bounds.x1);
            for row in self.centres(1, bounds.y0, bounds.y1) {
                let y = (f64::from(row - self.map.y) + 0.5) / self.scale[1] - 0.5;
                for column in columns.clone() {
                    let x = (f64::from(column - self.map.x) + 0.5) / self.scale[0] - 0.5;
                    let Some((element, xi, eta)) = mesh.locate(zone, x, y) else { continue };
                    if let Some(values) = cells[element] {
                        let shape = shape_functions(xi, eta);
                        let value = shape.iter().zip(values).map(|(n, v)| n * v).sum();
                        canvas.mix(column, row, colour(bar.palette, bar.range, value), bar.opacity);
                    }
                }
            }
        }
    }

    /// The bar, over the mean grey of the image, so that its colours are those of the map.
    fn paint_bar(&self, canvas: &mut Canvas, bar: &Bar, grey: u8) {
        let Rect { x, y, width, height } = self.bar;
        let shown = |t: f64| mix([grey; 3], bar.palette.colour(t), bar.opacity);
        let length = if self.flat { width } else { height };
        for step in 0..length {
            // The ends of the bar have the colours of the ends of the range, exactly.
            let t = f64::from(step) / f64::from((length - 1).max(1));
            if self.flat {
                canvas.fill(x + step, y, 1, height, shown(t));
            } else {
                canvas.fill(x, y + height - 1 - step, width, 1, shown(t));
            }
        }
        canvas.frame(x, y, width, height, BLACK);
        for (there, end) in [(bar.below, 0.0), (bar.above, 1.0)] {
            if there {
                self.paint_tip(canvas, end, shown(end));
            }
        }
        let thick = BAR_WIDTH + TICK_LENGTH + GAP;
        for tick in &self.bar_ticks {
            let along = bar.range.fraction(tick.value) * f64::from(length);
            let along = (along.floor() as i32).clamp(0, length - 1);
            if self.flat {
                canvas.fill(x + along, y + height + 1, 1, TICK_LENGTH, BLACK);
                self.centred(canvas, &self.small, &tick.label, x + along, y + thick + self.small.digit(), BLACK);
            } else {
                let row = y + height - 1 - along;
                canvas.fill(x + width + 1, row, TICK_LENGTH, 1, BLACK);
                let right = (x + thick + self.bar_labels) as f32;
                self.flush_right(canvas, &tick.label, right, row);
            }
        }
        if self.flat {
            let foot = y + thick + self.small.digit() + self.small.below() + GAP + self.normal.digit();
            // A label longer than the bar stays within the border.
            let half = (self.normal.width(&self.label) / 2.0).ceil() as i32;
            let middle = (x + width / 2).clamp(BORDER + half, (self.width - BORDER - half).max(BORDER + half));
            self.centred(canvas, &self.normal, &self.label, middle, foot, BLACK);
        } else {
            let foot = x + thick + self.bar_labels + 2 * GAP + self.normal.digit();
            let half = self.normal.width(&self.label) / 2.0;
            canvas.text_upwards(&self.normal, &self.label, foot, (y + height / 2) as f32 + half, BLACK);
        }
    }

    /// A triangle beyond an end of the bar.
    fn paint_tip(&self, canvas: &mut Canvas, end: f64, inside: Rgb) {
        let Rect { x, y, width, height } = self.bar;
        for step in 1..=TIP {
            let half = (TIP - step) * BAR_WIDTH / (2 * TIP);
            for across in -half - 1..=half {
                let rim = across == -half - 1 || across == half;
                let ink = if rim { BLACK } else { inside };
                let beyond = if end == 0.0 { -step } else { step - 1 };
                if self.flat {
                    let from = if end == 0.0 { x } else { x + width };
                    canvas.mix(from + beyond, y + height / 2 + across, ink, 1.0);
                } else {
                    let from = if end == 0.0 { y + height - 1 } else { y - 1 };
                    canvas.mix(x + width / 2 + across, from - beyond, ink, 1.0);
                }
            }
        }
    }

    fn paint_axes(&self, canvas: &mut Canvas) {
        let Rect { x, y, width, height } = self.map;
        canvas.frame(x, y, width, height, BLACK);
        let foot = y + height + TICK_LENGTH + GAP + self.small.digit();
        for tick in &self.x_ticks {
            let column = (self.place(0, tick.value).floor() as i32).clamp(x, x + width - 1);
            canvas.fill(column, y + height + 1, 1, TICK_LENGTH, BLACK);
            self.centred(canvas, &self.small, &tick.label, column, foot, BLACK);
        }
        for tick in &self.y_ticks {
            let row = (self.place(1, tick.value).floor() as i32).clamp(y, y + height - 1);
            canvas.fill(x - 1 - TICK_LENGTH, row, TICK_LENGTH, 1, BLACK);
            self.flush_right(canvas, &tick.label, (x - TICK_LENGTH - GAP) as f32, row);
        }
        let foot = foot + self.small.below() + GAP + self.normal.digit();
        self.centred(canvas, &self.normal, X_TITLE, x + width / 2, foot, BLACK);
        let foot = x - TICK_LENGTH - GAP - self.y_labels - GAP - self.normal.below();
        let half = self.normal.width(Y_TITLE) / 2.0;
        canvas.text_upwards(&self.normal, Y_TITLE, foot, (y + height / 2) as f32 + half, BLACK);

        let mut top = BORDER;
        let title = self.title.iter().map(|line| (line, &self.large, BLACK));
        for (line, type_, colour) in title.chain(self.note.iter().map(|line| (line, &self.normal, NOTE))) {
            self.centred(canvas, type_, line, self.width / 2, top + type_.em, colour);
            top += line_height(type_);
        }
    }

    fn centred(&self, canvas: &mut Canvas, type_: &Type, text: &str, x: i32, baseline: i32, colour: Rgb) {
        canvas.text(type_, text, x as f32 + 0.5 - type_.width(text) / 2.0, baseline, colour);
    }

    /// A label of a tick in `row`, ending at `right`.
    fn flush_right(&self, canvas: &mut Canvas, text: &str, right: f32, row: i32) {
        let baseline = row + (self.small.digit() + 1) / 2;
        canvas.text(&self.small, text, right - self.small.width(text), baseline, BLACK);
    }
}

fn line_height(type_: &Type) -> i32 {
    type_.em + type_.below() + 2
}
