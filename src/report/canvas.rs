//! A white sheet of pixels and the text on it.

use ab_glyph::{Font, FontRef, Glyph, PxScale, ScaleFont, point};

pub(super) type Rgb = [u8; 3];

pub(super) const BLACK: Rgb = [0, 0, 0];

/// The sheet. What is drawn beyond its border is lost.
pub(super) struct Canvas {
    pub width: i32,
    pub height: i32,
    pub rgb: Vec<u8>,
}

impl Canvas {
    pub fn new(width: i32, height: i32) -> Self {
        Self { width, height, rgb: vec![255; 3 * (width * height) as usize] }
    }

    fn pixel(&mut self, x: i32, y: i32) -> Option<&mut Rgb> {
        if !(0..self.width).contains(&x) || !(0..self.height).contains(&y) {
            return None;
        }
        let at = 3 * (y as usize * self.width as usize + x as usize);
        self.rgb[at..].first_chunk_mut()
    }

    /// Mixes `colour` into a pixel; `opacity` 1 replaces it.
    pub fn mix(&mut self, x: i32, y: i32, colour: Rgb, opacity: f64) {
        if let Some(pixel) = self.pixel(x, y) {
            *pixel = mix(*pixel, colour, opacity);
        }
    }

    /// Fills the rectangle of `width` x `height` pixels from (x, y) on.
    pub fn fill(&mut self, x: i32, y: i32, width: i32, height: i32, colour: Rgb) {
        for y in y..y + height {
            for x in x..x + width {
                self.mix(x, y, colour, 1.0);
            }
        }
    }

    /// A line of one pixel around the rectangle, outside it.
    pub fn frame(&mut self, x: i32, y: i32, width: i32, height: i32, colour: Rgb) {
        self.fill(x - 1, y - 1, width + 2, 1, colour);
        self.fill(x - 1, y + height, width + 2, 1, colour);
        self.fill(x - 1, y, 1, height, colour);
        self.fill(x + width, y, 1, height, colour);
    }

    /// Draws `text` from `x` to the right on the line `baseline`.
    pub fn text(&mut self, type_: &Type, text: &str, x: f32, baseline: i32, colour: Rgb) {
        type_.ink(text, x, |x, y, coverage| self.mix(x, baseline + y, colour, coverage));
    }

    /// Draws `text` upwards from `y` on the vertical line `baseline`, its feet to the right.
    pub fn text_upwards(&mut self, type_: &Type, text: &str, baseline: i32, y: f32, colour: Rgb) {
        let start = y.floor() as i32;
        type_.ink(text, 0.0, |along, across, coverage| {
            self.mix(baseline + across, start - along, colour, coverage);
        });
    }
}

pub(super) fn mix(below: Rgb, above: Rgb, opacity: f64) -> Rgb {
    let part = |k: usize| f64::from(below[k]) + opacity * (f64::from(above[k]) - f64::from(below[k]));
    [0, 1, 2].map(|k| part(k).round() as u8)
}

/// DejaVu Sans in one size.
// Set by hand from the outlines: plotters 0.3 drops each glyph's side bearing, which tears words apart.
pub(super) struct Type {
    font: FontRef<'static>,
    scale: PxScale,
    /// Size of an em, px.
    pub em: i32,
}

impl Type {
    pub fn new(em: i32) -> Self {
        let font = FontRef::try_from_slice(dejavu::sans::regular()).expect("the font in the program is a font");
        let units = font.units_per_em().expect("the font in the program states its em");
        Self { scale: PxScale::from(em as f32 * font.height_unscaled() / units), em, font }
    }

    /// Height of a digit, px.
    pub fn digit(&self) -> i32 {
        (0.73 * self.em as f32).round() as i32
    }

    /// Room for what hangs below the baseline, px.
    pub fn below(&self) -> i32 {
        (0.25 * self.em as f32).ceil() as i32
    }

    /// Length of `text`, px.
    pub fn width(&self, text: &str) -> f32 {
        self.set(text, 0.0).1
    }

    /// `text`, shortened with an ellipsis where it is longer than `width`.
    pub fn fit(&self, text: &str, width: f32) -> String {
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
        kept + "…"
    }

    /// `text` in lines not longer than `width`, broken between words and, where a word alone is too
    /// long, inside it.
    pub fn wrap(&self, text: &str, width: f32) -> Vec<String> {
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

    /// The glyphs of `text` from `x` on, and where the next would stand.
    fn set(&self, text: &str, mut x: f32) -> (Vec<Glyph>, f32) {
        let font = self.font.as_scaled(self.scale);
        let mut last = None;
        let mut glyphs = Vec::new();
        for character in text.chars().filter(|c| !c.is_control()) {
            let id = font.glyph_id(character);
            x += last.map_or(0.0, |last| font.kern(last, id));
            glyphs.push(id.with_scale_and_position(self.scale, point(x, 0.0)));
            x += font.h_advance(id);
            last = Some(id);
        }
        (glyphs, x)
    }

    /// Calls `draw` with each pixel that `text` covers, relative to the baseline, and how much of it.
    fn ink(&self, text: &str, x: f32, mut draw: impl FnMut(i32, i32, f64)) {
        for glyph in self.set(text, x).0 {
            if let Some(outline) = self.font.outline_glyph(glyph) {
                let corner = outline.px_bounds().min;
                outline.draw(|x, y, coverage| {
                    draw(corner.x as i32 + x as i32, corner.y as i32 + y as i32, f64::from(coverage.min(1.0)));
                });
            }
        }
    }
}
