//! Axes around a rectangle: marks, numbers and what they count.

use super::letters::Type;
use super::look::Look;
use super::scale::Tick;
use super::scene::{Anchor, BLACK, Rect, Rgb, SOFT, Scene, WARNING};

/// Free border of a picture.
pub(super) const BORDER: i32 = 16;
pub(super) const TICK_LENGTH: i32 = 6;
/// Between a tick, its label and the text beyond.
pub(super) const GAP: i32 = 6;

/// The sizes of letters in a picture.
pub(super) struct Letters {
    /// Numbers and notes.
    pub small: Type,
    /// What an axis counts.
    pub normal: Type,
    /// Titles.
    pub large: Type,
    /// What the picture is for.
    pub look: Look,
}

impl Letters {
    pub fn new(look: Look) -> Self {
        Self { small: Type::new(14), normal: Type::new(15), large: Type::new(18), look }
    }
}

/// A side of a rectangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    Bottom,
    Left,
    Top,
    Right,
}

/// An axis along one side: its title, and its marks at places along the side (from its left or upper end).
#[derive(Debug, Clone)]
pub(super) struct SideAxis {
    pub side: Side,
    pub ticks: Vec<(f64, String)>,
    /// Marks without a number.
    pub minor: Vec<f64>,
    /// Line by line.
    pub title: Vec<String>,
}

impl SideAxis {
    pub fn new(side: Side, ticks: &[Tick], place: impl Fn(f64) -> f64, title: impl Into<String>) -> Self {
        let ticks = ticks.iter().map(|tick| (place(tick.value), tick.label.clone())).collect();
        Self { side, ticks, minor: Vec::new(), title: vec![title.into()] }
    }

    /// The same with `text` as its title, in two lines where one of `room` is too short.
    pub fn titled(self, letters: &Letters, text: &str, room: i32) -> Self {
        let room = f64::from(room);
        let mut title = letters.normal.wrap(text, room);
        if title.len() > 2 {
            let rest = title.split_off(1).join(" ");
            title.push(letters.normal.fit(&rest, room));
        }
        Self { title, ..self }
    }

    /// The longest number, px.
    pub fn longest(&self, letters: &Letters) -> i32 {
        self.ticks.iter().map(|(_, label)| letters.small.width(label).ceil() as i32).max().unwrap_or(0)
    }

    /// How far the axis reaches beyond its side.
    pub fn thickness(&self, letters: &Letters) -> i32 {
        let numbers = match self.side {
            Side::Bottom | Side::Top => letters.small.digit() + letters.small.below(),
            Side::Left | Side::Right => self.longest(letters),
        };
        let further = self.title.len().saturating_sub(1) as i32 * letters.normal.line();
        TICK_LENGTH + GAP + numbers + GAP + letters.normal.digit() + letters.normal.below() + further
    }

    /// How far numbers and title reach beyond the ends of the side of `length`.
    pub fn overhang(&self, letters: &Letters, length: i32) -> i32 {
        let widths = self.title.iter().map(|line| letters.normal.width(line).ceil() as i32);
        let title = (widths.max().unwrap_or(0) - length) / 2 + 1;
        let number = match self.side {
            Side::Bottom | Side::Top => self.longest(letters) / 2 + 1,
            Side::Left | Side::Right => letters.small.digit(),
        };
        title.max(number)
    }

    pub fn draw(&self, scene: &mut Scene, letters: &Letters, rect: Rect) {
        let Rect { x, y, width, height } = rect;
        let across = matches!(self.side, Side::Bottom | Side::Top);
        let length = if across { width } else { height };
        let cell = |place: f64| (place.floor() as i32).clamp(0, length - 1);
        let marks = self.ticks.iter().map(|(place, _)| (*place, TICK_LENGTH));
        for (place, long) in marks.chain(self.minor.iter().map(|&place| (place, TICK_LENGTH / 2))) {
            let at = cell(place);
            let mark = match self.side {
                Side::Bottom => Rect { x: x + at, y: y + height + 1, width: 1, height: long },
                Side::Top => Rect { x: x + at, y: y - 1 - long, width: 1, height: long },
                Side::Left => Rect { x: x - 1 - long, y: y + at, width: long, height: 1 },
                Side::Right => Rect { x: x + width + 1, y: y + at, width: long, height: 1 },
            };
            scene.fill(mark, BLACK);
        }
        let small = &letters.small;
        let beyond = TICK_LENGTH + GAP;
        let longest = self.longest(letters);
        for (place, label) in &self.ticks {
            let at = cell(*place);
            let middle = f64::from(at) + 0.5;
            let row = f64::from(y + at + (small.digit() + 1) / 2);
            let foot = match self.side {
                Side::Bottom => [f64::from(x) + middle, f64::from(y + height + beyond + small.digit())],
                Side::Top => [f64::from(x) + middle, f64::from(y - beyond)],
                Side::Left => [f64::from(x - beyond), row],
                Side::Right => [f64::from(x + width + beyond + longest), row],
            };
            scene.text(small, label, if across { Anchor::Middle } else { Anchor::End }, foot, BLACK);
        }
        let normal = &letters.normal;
        let (middle_x, middle_y) = (f64::from(x) + f64::from(width) / 2.0, f64::from(y) + f64::from(height) / 2.0);
        let (numbers, below) = (small.digit() + small.below() + GAP, normal.below());
        // Lines follow each other downwards, of an upright title to the right.
        let n = self.title.len() as i32;
        for (k, line) in (0..).zip(&self.title) {
            let (after, before) = (k * normal.line(), (n - 1 - k) * normal.line());
            let foot = f64::from(match self.side {
                Side::Bottom => y + height + beyond + numbers + normal.digit() + after,
                Side::Top => y - beyond - numbers - before,
                Side::Left => x - beyond - longest - GAP - below - before,
                Side::Right => x + width + beyond + longest + GAP + normal.digit() + after,
            });
            match across {
                true => scene.text(normal, line, Anchor::Middle, [middle_x, foot], BLACK),
                false => scene.text_upwards(normal, line, Anchor::Middle, [foot, middle_y], BLACK),
            }
        }
    }
}

/// Lines of text across the picture, title above or notes below.
#[derive(Debug, Default)]
pub(super) struct Lines(Vec<(String, bool, Rgb)>);

impl Lines {
    /// A title in large letters, broken to `width`.
    pub fn title(&mut self, letters: &Letters, text: &str, width: i32) {
        if letters.look.has_title() {
            self.0.extend(letters.large.wrap(text, f64::from(width)).into_iter().map(|line| (line, true, BLACK)));
        }
    }

    /// A note in small letters.
    pub fn note(&mut self, letters: &Letters, text: &str, width: i32, colour: Rgb) {
        self.0.extend(letters.small.wrap(text, f64::from(width)).into_iter().map(|line| (line, false, colour)));
    }

    /// Warnings, where they are drawn.
    pub fn warnings(&mut self, letters: &Letters, warnings: &[String], width: i32) {
        if letters.look.has_warnings() {
            warnings.iter().for_each(|warning| self.note(letters, warning, width, WARNING));
        }
    }

    /// Notes in small, soft letters.
    pub fn notes(&mut self, letters: &Letters, notes: &[String], width: i32) {
        if letters.look.has_notes() {
            notes.iter().for_each(|note| self.note(letters, note, width, SOFT));
        }
    }

    pub fn height(&self, letters: &Letters) -> i32 {
        self.0.iter().map(|(_, large, _)| if *large { letters.large.line() } else { letters.small.line() }).sum()
    }

    /// Draws the lines from `top` on, about `middle` or from `left` on.
    pub fn draw(&self, scene: &mut Scene, letters: &Letters, anchor: Anchor, x: f64, mut top: i32) {
        for (line, large, colour) in &self.0 {
            let type_ = if *large { &letters.large } else { &letters.small };
            scene.text(type_, line, anchor, [x, f64::from(top + type_.em)], *colour);
            top += type_.line();
        }
    }
}
