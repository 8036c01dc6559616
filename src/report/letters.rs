//! Text as outlines of the font in the program, so that it looks the same on every machine.

use skrifa::instance::{LocationRef, Size};
use skrifa::metrics::GlyphMetrics;
use skrifa::outline::pen::PathStyle;
use skrifa::outline::{DrawSettings, OutlineGlyphCollection, OutlinePen};
use skrifa::raw::TableProvider;
use skrifa::raw::tables::kern::SubtableKind;
use skrifa::{FontRef, GlyphId, MetadataProvider, charmap::Charmap};
use std::fmt::Write;

/// DejaVu Sans in one size.
pub(super) struct Type {
    characters: Charmap<'static>,
    advances: GlyphMetrics<'static>,
    outlines: OutlineGlyphCollection<'static>,
    /// What pairs of glyphs stand closer by.
    kerning: Vec<SubtableKind<'static>>,
    /// px per unit of the font.
    scale: f32,
    /// Size of an em, px.
    pub em: i32,
}

impl Type {
    pub fn new(em: i32) -> Self {
        let font = FontRef::new(dejavu::sans::regular()).expect("the font in the program is a font");
        let units = font.head().expect("the font in the program states its em").units_per_em();
        let tables = font.kern().ok().into_iter().flat_map(|table| table.subtables()).filter_map(Result::ok);
        let kerning =
            tables.filter(|table| table.is_horizontal() && !table.is_variable()).filter_map(|table| table.kind().ok());
        Self {
            characters: font.charmap(),
            // In units of the font.
            advances: font.glyph_metrics(Size::unscaled(), LocationRef::default()),
            outlines: font.outline_glyphs(),
            kerning: kerning.collect(),
            scale: em as f32 / f32::from(units),
            em,
        }
    }

    /// Height of a digit, px.
    pub fn digit(&self) -> i32 {
        (0.73 * self.em as f32).round() as i32
    }

    /// Room for what hangs below the baseline, px.
    pub fn below(&self) -> i32 {
        (0.25 * self.em as f32).ceil() as i32
    }

    /// From one line of text to the next, px.
    pub fn line(&self) -> i32 {
        self.em + self.below() + 2
    }

    /// Length of `text`, px.
    pub fn width(&self, text: &str) -> f64 {
        f64::from(self.set(text, |_, _| ()))
    }

    /// `text`, shortened with an ellipsis where it is longer than `width`.
    pub fn fit(&self, text: &str, width: f64) -> String {
        if self.width(text) <= width {
            return text.to_owned();
        }
        let mut kept = String::new();
        for character in text.chars() {
            if self.width(&format!("{kept}{character}…")) > width {
                break;
            }
            kept.push(character);
        }
        kept.truncate(kept.trim_end().len());
        kept + "…"
    }

    /// `text` in lines of up to `width`, broken between words and, where one alone is too long, inside it.
    pub fn wrap(&self, text: &str, width: f64) -> Vec<String> {
        let mut lines: Vec<String> = Vec::new();
        for word in text.split_whitespace() {
            match lines.last_mut() {
                Some(line) if self.width(&format!("{line} {word}")) <= width => {
                    line.push(' ');
                    line.push_str(word);
                }
                _ => lines.push(word.to_owned()),
            }
            while let Some(line) = lines.last_mut()
                && self.width(line) > width
            {
                let fits = |end: &usize| self.width(&line[..*end]) <= width;
                let ends = line.char_indices().map(|(at, _)| at).skip(1);
                let Some(cut) = ends.take_while(fits).last() else { break };
                let rest = line.split_off(cut);
                lines.push(rest);
            }
        }
        lines
    }

    /// What `right` stands closer to `left` by (negative), units of the font.
    fn kern(&self, left: GlyphId, right: GlyphId) -> f32 {
        let of = |table: &SubtableKind<'_>| match table {
            SubtableKind::Format0(pairs) => pairs.kerning(left, right),
            SubtableKind::Format2(classes) => classes.kerning(left, right),
            SubtableKind::Format3(classes) => classes.kerning(left, right),
            _ => None,
        };
        self.kerning.iter().find_map(of).unwrap_or(0) as f32
    }

    /// Calls `put` with each glyph of `text` and where it stands, px; gives the length.
    fn set(&self, text: &str, mut put: impl FnMut(GlyphId, f32)) -> f32 {
        let (mut x, mut last) = (0.0, None);
        for character in text.chars().filter(|c| !c.is_control()) {
            // Glyph 0 is the box of what the font has not.
            let id = self.characters.map(character).unwrap_or_default();
            x += last.map_or(0.0, |last| self.kern(last, id) * self.scale);
            put(id, x);
            x += self.advances.advance_width(id).unwrap_or(0.0) * self.scale;
            last = Some(id);
        }
        x
    }

    /// The outlines of `text` as the data of an SVG path; `place` takes a point of the text (x along the
    /// baseline, y down, px) to the sheet.
    pub fn outline(&self, text: &str, place: impl Fn(f64, f64) -> [f64; 2]) -> String {
        let mut data = String::new();
        self.set(text, |id, x| {
            let Some(outline) = self.outlines.get(id) else { return };
            let at = |u: f32, v: f32| place(f64::from(x + u * self.scale), f64::from(-v * self.scale));
            let settings =
                DrawSettings::unhinted(Size::unscaled(), LocationRef::default()).with_path_style(PathStyle::HarfBuzz);
            // What cannot be drawn is left out: the font in the program is whole.
            let _ = outline.draw(settings, &mut Pen { data: &mut data, at, start: [0.0; 2], end: [0.0; 2] });
        });
        data
    }
}

/// Writes outlines as the data of an SVG path.
struct Pen<'a, F> {
    data: &'a mut String,
    /// From the font to the sheet.
    at: F,
    /// Of the present contour.
    start: [f32; 2],
    end: [f32; 2],
}

impl<F: Fn(f32, f32) -> [f64; 2]> Pen<'_, F> {
    fn to<const N: usize>(&mut self, letter: char, points: [[f32; 2]; N]) {
        command(self.data, letter, &points.map(|[x, y]| (self.at)(x, y)));
        self.end = points[N - 1];
    }
}

impl<F: Fn(f32, f32) -> [f64; 2]> OutlinePen for Pen<'_, F> {
    fn move_to(&mut self, x: f32, y: f32) {
        self.to('M', [[x, y]]);
        self.start = [x, y];
    }

    fn line_to(&mut self, x: f32, y: f32) {
        self.to('L', [[x, y]]);
    }

    fn quad_to(&mut self, cx: f32, cy: f32, x: f32, y: f32) {
        self.to('Q', [[cx, cy], [x, y]]);
    }

    fn curve_to(&mut self, ax: f32, ay: f32, bx: f32, by: f32, x: f32, y: f32) {
        self.to('C', [[ax, ay], [bx, by], [x, y]]);
    }

    fn close(&mut self) {
        // Filled areas close themselves; an outline that is drawn needs its last side.
        if self.end != self.start {
            self.to('L', [self.start]);
        }
    }
}

/// Appends one command of an SVG path.
fn command(data: &mut String, letter: char, points: &[[f64; 2]]) {
    data.push(letter);
    for (k, [x, y]) in points.iter().enumerate() {
        let gap = if k == 0 { "" } else { " " };
        // Writing to a string does not fail.
        let _ = write!(data, "{gap}{} {}", Short(*x), Short(*y));
    }
}

/// A coordinate with two decimals at most: a fiftieth of what the eye can tell.
pub(super) struct Short(pub f64);

impl std::fmt::Display for Short {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        // Adding zero turns -0 into 0.
        let rounded = (self.0 * 100.0).round() / 100.0 + 0.0;
        let text = rounded.to_string();
        match (text.strip_prefix("0."), text.strip_prefix("-0.")) {
            (Some(decimals), _) => write!(f, ".{decimals}"),
            (_, Some(decimals)) => write!(f, "-.{decimals}"),
            _ => f.write_str(&text),
        }
    }
}
