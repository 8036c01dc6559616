//! Text as outlines of the font in the program, so that it looks the same on every machine.

use ab_glyph::{Font, FontRef, GlyphId, OutlineCurve, Point};
use std::fmt::Write;

/// DejaVu Sans in one size.
pub(super) struct Type {
    font: FontRef<'static>,
    /// px per unit of the font.
    scale: f32,
    /// Size of an em, px.
    pub em: i32,
}

impl Type {
    pub fn new(em: i32) -> Self {
        let font = FontRef::try_from_slice(dejavu::sans::regular()).expect("the font in the program is a font");
        let units = font.units_per_em().expect("the font in the program states its em");
        Self { scale: em as f32 / units, em, font }
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

    /// `text` in lines not longer than `width`, broken between words and, where a word alone is too
    /// long, inside it.
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

    /// Calls `put` with each glyph of `text` and where it stands, units of the font turned into px; gives
    /// the length.
    fn set(&self, text: &str, mut put: impl FnMut(GlyphId, f32)) -> f32 {
        let (mut x, mut last) = (0.0, None);
        for character in text.chars().filter(|c| !c.is_control()) {
            let id = self.font.glyph_id(character);
            x += last.map_or(0.0, |last| self.font.kern_unscaled(last, id) * self.scale);
            put(id, x);
            x += self.font.h_advance_unscaled(id) * self.scale;
            last = Some(id);
        }
        x
    }

    /// The outlines of `text` as the data of an SVG path; `place` takes a point of the text (x along the
    /// baseline, y down, px) to the sheet.
    pub fn outline(&self, text: &str, place: impl Fn(f64, f64) -> [f64; 2]) -> String {
        let mut data = String::new();
        self.set(text, |id, x| {
            let Some(outline) = self.font.outline(id) else { return };
            let at = |p: Point| place(f64::from(x + p.x * self.scale), f64::from(-p.y * self.scale));
            let mut end: Option<Point> = None;
            for curve in outline.curves {
                let (OutlineCurve::Line(start, _) | OutlineCurve::Quad(start, ..) | OutlineCurve::Cubic(start, ..)) =
                    curve;
                if end.is_none_or(|end| end != start) {
                    command(&mut data, 'M', &[at(start)]);
                }
                end = Some(match curve {
                    OutlineCurve::Line(_, b) => {
                        command(&mut data, 'L', &[at(b)]);
                        b
                    }
                    OutlineCurve::Quad(_, b, c) => {
                        command(&mut data, 'Q', &[at(b), at(c)]);
                        c
                    }
                    OutlineCurve::Cubic(_, b, c, d) => {
                        command(&mut data, 'C', &[at(b), at(c), at(d)]);
                        d
                    }
                });
            }
        });
        data
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
