//! A sheet and what is drawn on it, written as SVG: the one description from which both the SVG and the PNG
//! of a picture come.

use super::letters::{Short, Type};
use super::look::Look;
use super::picture::{Area, Picture};
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use std::fmt::Write;

pub(super) type Rgb = [u8; 3];

pub(super) const BLACK: Rgb = [0, 0, 0];
pub(super) const WHITE: Rgb = [255, 255, 255];
/// What is said below a picture.
pub(super) const SOFT: Rgb = [80, 80, 80];
/// What must not be overlooked.
pub(super) const WARNING: Rgb = [176, 0, 0];

/// Colours that colour-blind readers can tell apart (Okabe and Ito), dark enough on white.
pub(super) const COLOURS: [Rgb; 7] =
    [[0, 114, 178], [213, 94, 0], [0, 158, 115], [204, 121, 167], [86, 180, 233], [230, 159, 0], [60, 60, 60]];

/// A rectangle of whole units of the sheet, which are the pixels of the picture at 100 %.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rect {
    pub x: i32,
    pub y: i32,
    pub width: i32,
    pub height: i32,
}

impl Rect {
    pub fn area(self) -> Area {
        let [x, y, width, height] = [self.x, self.y, self.width, self.height].map(|v| v.max(0) as u32);
        Area { x, y, width, height }
    }

    pub fn right(self) -> i32 {
        self.x + self.width
    }

    pub fn bottom(self) -> i32 {
        self.y + self.height
    }
}

/// How a line is drawn.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stroke {
    pub colour: Rgb,
    pub width: f64,
    pub opacity: f64,
    /// Lengths of strokes and gaps; empty for a full line.
    pub dash: &'static [f64],
}

impl Stroke {
    pub fn new(colour: Rgb, width: f64) -> Self {
        Self { colour, width, opacity: 1.0, dash: &[] }
    }
}

/// Where a text stands about its point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

/// The data of an SVG path.
#[derive(Debug, Clone, Default)]
pub(super) struct Path(pub String);

impl Path {
    /// A line through `points`; nothing for less than two.
    pub fn line(&mut self, points: impl IntoIterator<Item = [f64; 2]>) {
        let mut points = points.into_iter();
        let (Some(first), Some(second)) = (points.next(), points.next()) else { return };
        let mut at = rounded(first);
        let _ = write!(self.0, "M{} {}l", Short(at[0]), Short(at[1]));
        let mut gap = "";
        // Relative, from rounded to rounded, so that nothing adds up: half the characters.
        for point in std::iter::once(second).chain(points) {
            let next = rounded(point);
            let _ = write!(self.0, "{gap}{} {}", Short(next[0] - at[0]), Short(next[1] - at[1]));
            at = next;
            gap = " ";
        }
    }

    /// A line through `points` that leaves out those on straight stretches.
    pub fn straightened(&mut self, points: impl IntoIterator<Item = [f64; 2]>) {
        let mut kept: Vec<[f64; 2]> = Vec::new();
        let mut passed: Vec<[f64; 2]> = Vec::new();
        for point in points {
            let Some(&from) = kept.last() else {
                kept.push(point);
                continue;
            };
            // No longer than this, or the search would take the square of the length.
            let straight = passed.len() < LONGEST_STRETCH && passed.iter().all(|&p| is_between(from, p, point));
            if !straight && let Some(&last) = passed.last() {
                kept.push(last);
                passed.clear();
            }
            passed.push(point);
        }
        kept.extend(passed.last());
        self.line(kept);
    }

    /// A closed line through `points`.
    pub fn polygon(&mut self, points: impl IntoIterator<Item = [f64; 2]>) {
        let before = self.0.len();
        self.line(points);
        if self.0.len() > before {
            self.0.push('Z');
        }
    }

    /// A circle.
    pub fn circle(&mut self, [x, y]: [f64; 2], radius: f64) {
        let (r, d) = (Short(radius), Short(2.0 * radius));
        let _ = write!(self.0, "M{} {}a{r} {r} 0 1 0 {d} 0a{r} {r} 0 1 0 -{d} 0Z", Short(x - radius), Short(y));
    }

    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

/// How far a point may lie off a stretch that counts as straight.
const STRAIGHT: f64 = 0.06;
const LONGEST_STRETCH: usize = 64;

/// Whether `p` lies on the way from `a` to `b`.
fn is_between(a: [f64; 2], p: [f64; 2], b: [f64; 2]) -> bool {
    let (d, q) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
    let length = d[0].hypot(d[1]);
    let (along, off) = (d[0] * q[0] + d[1] * q[1], d[0] * q[1] - d[1] * q[0]);
    off.abs() <= STRAIGHT * length && (0.0..=length * length).contains(&along)
}

fn rounded(point: [f64; 2]) -> [f64; 2] {
    point.map(|v| (v * 100.0).round() / 100.0)
}

/// The sheet. What is drawn beyond its border is lost.
pub(super) struct Scene {
    width: i32,
    height: i32,
    body: String,
    n_clips: usize,
}

impl Scene {
    pub fn new(width: i32, height: i32) -> Self {
        let mut scene = Self { width, height, body: String::new(), n_clips: 0 };
        scene.fill(Rect { x: 0, y: 0, width, height }, WHITE);
        scene
    }

    fn put(&mut self, arguments: std::fmt::Arguments<'_>) {
        // Writing to a string does not fail.
        let _ = self.body.write_fmt(arguments);
        self.body.push('\n');
    }

    /// Fills a rectangle.
    pub fn fill(&mut self, rect: Rect, colour: Rgb) {
        let Rect { x, y, width, height } = rect;
        let fill = hex(colour);
        self.put(format_args!(r#"<rect x="{x}" y="{y}" width="{width}" height="{height}" fill="{fill}"/>"#));
    }

    /// A line of one unit around the rectangle, outside it.
    pub fn frame(&mut self, rect: Rect, colour: Rgb) {
        let (x, y) = (f64::from(rect.x) - 0.5, f64::from(rect.y) - 0.5);
        let (width, height, stroke) = (rect.width + 1, rect.height + 1, hex(colour));
        self.put(format_args!(
            r#"<rect x="{x}" y="{y}" width="{width}" height="{height}" fill="none" stroke="{stroke}"/>"#
        ));
    }

    /// Draws along a path.
    pub fn stroke(&mut self, path: &Path, stroke: &Stroke) {
        if path.is_empty() {
            return;
        }
        let (colour, width) = (hex(stroke.colour), Short(stroke.width));
        let mut more = String::new();
        if stroke.opacity < 1.0 {
            let _ = write!(more, r#" stroke-opacity="{}""#, Short(stroke.opacity));
        }
        if !stroke.dash.is_empty() {
            let dash: Vec<_> = stroke.dash.iter().map(|v| Short(*v).to_string()).collect();
            let _ = write!(more, r#" stroke-dasharray="{}""#, dash.join(" "));
        }
        self.put(format_args!(
            r#"<path d="{}" fill="none" stroke="{colour}" stroke-width="{width}" stroke-linejoin="round"{more}/>"#,
            path.0
        ));
    }

    /// Fills a path.
    pub fn area(&mut self, path: &Path, colour: Rgb, opacity: f64) {
        if path.is_empty() {
            return;
        }
        let colour = hex(colour);
        let opacity = if opacity < 1.0 { format!(r#" fill-opacity="{}""#, Short(opacity)) } else { String::new() };
        self.put(format_args!(r#"<path d="{}" fill="{colour}"{opacity}/>"#, path.0));
    }

    /// Puts a picture (the bytes of a PNG file) into the rectangle (x, y, width, height), stretched to fill it.
    pub fn image(&mut self, [x, y, width, height]: [f64; 4], png: &[u8], opacity: f64) {
        let [x, y, width, height] = [x, y, width, height].map(Short);
        let opacity = if opacity < 1.0 { format!(r#" opacity="{}""#, Short(opacity)) } else { String::new() };
        let data = BASE64_STANDARD.encode(png);
        self.put(format_args!(
            r#"<image x="{x}" y="{y}" width="{width}" height="{height}" preserveAspectRatio="none"{opacity} xlink:href="data:image/png;base64,{data}"/>"#
        ));
    }

    /// What is drawn from here to [`Scene::unclip`] is seen inside the rectangle only.
    pub fn clip(&mut self, rect: Rect) {
        let Rect { x, y, width, height } = rect;
        self.clip_with(format_args!(r#"<rect x="{x}" y="{y}" width="{width}" height="{height}"/>"#));
    }

    /// The same with the inside of a path.
    pub fn clip_to(&mut self, path: &Path) {
        self.clip_with(format_args!(r#"<path clip-rule="evenodd" d="{}"/>"#, path.0));
    }

    fn clip_with(&mut self, shape: std::fmt::Arguments<'_>) {
        self.n_clips += 1;
        let id = self.n_clips;
        self.put(format_args!(r##"<clipPath id="clip{id}">{shape}</clipPath><g clip-path="url(#clip{id})">"##));
    }

    /// Ends a clip.
    pub fn unclip(&mut self) {
        self.put(format_args!("</g>"));
    }

    /// Draws `text` on the line `baseline`.
    pub fn text(&mut self, type_: &Type, text: &str, anchor: Anchor, [x, baseline]: [f64; 2], colour: Rgb) {
        let x = x - shift(type_, text, anchor);
        let data = type_.outline(text, |along, down| [x + along, baseline + down]);
        self.letters(text, &data, colour);
    }

    /// The same with a white rim, for texts over an image.
    pub fn text_on_image(&mut self, type_: &Type, text: &str, [x, baseline]: [f64; 2], colour: Rgb) {
        let data = Path(type_.outline(text, |along, down| [x + along, baseline + down]));
        self.stroke(&data, &Stroke { opacity: 0.85, ..Stroke::new(WHITE, 4.0) });
        self.letters(text, &data.0, colour);
    }

    /// Draws `text` upwards on the vertical line `baseline`, its feet to the right.
    pub fn text_upwards(&mut self, type_: &Type, text: &str, anchor: Anchor, [baseline, y]: [f64; 2], colour: Rgb) {
        let y = y + shift(type_, text, anchor);
        let data = type_.outline(text, |along, down| [baseline + down, y - along]);
        self.letters(text, &data, colour);
    }

    fn letters(&mut self, text: &str, data: &str, colour: Rgb) {
        if data.is_empty() {
            return;
        }
        // The words stay with their outlines: for whoever searches or listens to the file.
        let (label, colour) = (escape(text), hex(colour));
        self.put(format_args!(r#"<path aria-label="{label}" fill="{colour}" d="{data}"/>"#));
    }

    /// The finished picture; `map` and `bar` are where its parts stand, `ratio` the pixels of the PNG per unit.
    pub fn finish(
        self,
        (title, notes): (&str, &[String]),
        look: Look,
        map: Rect,
        bar: Option<Rect>,
        ratio: u32,
    ) -> Picture {
        let Self { width, height, body, .. } = self;
        let length = |units: i32| match look.unit_mm() {
            Some(mm) => format!("{}mm", Short(f64::from(units) * mm)),
            None => units.to_string(),
        };
        // Notes that are not drawn are kept for whoever writes the caption.
        let notes = if look.has_notes() || notes.is_empty() {
            String::new()
        } else {
            format!("<desc>{}</desc>\n", escape(&notes.join(" ")))
        };
        let svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" xmlns:xlink=\"http://www.w3.org/1999/xlink\" \
             width=\"{}\" height=\"{}\" viewBox=\"0 0 {width} {height}\">\n\
             <title>{}</title>\n{notes}{body}</svg>\n",
            length(width),
            length(height),
            escape(title)
        );
        Picture::new(svg, [width as u32, height as u32], map.area(), bar.map(Rect::area), ratio.max(look.ratio()))
    }
}

fn shift(type_: &Type, text: &str, anchor: Anchor) -> f64 {
    match anchor {
        Anchor::Start => 0.0,
        Anchor::Middle => type_.width(text) / 2.0,
        Anchor::End => type_.width(text),
    }
}

fn hex([r, g, b]: Rgb) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// `text` as it may stand in XML; what XML forbids is left out.
fn escape(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '&' => safe.push_str("&amp;"),
            '"' => safe.push_str("&quot;"),
            '\n' | '\r' | '\t' => safe.push(' '),
            '\u{fffe}' | '\u{ffff}' => {}
            c if c.is_control() => {}
            c => safe.push(c),
        }
    }
    safe
}
