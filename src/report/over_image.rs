//! The frame of every figure over an image: axes in px and mm, colour bar, title, notes.

use super::Picture;
use super::axes::{BORDER, GAP, Letters, Lines, Side, SideAxis};
use super::backdrop::{Backdrop, LONGER_SIDE};
use super::bar::{BAR_WIDTH, Bar, TIP};
use super::raster::Layer;
use super::scale::{Range, ticks};
use super::scene::{Anchor, BLACK, Rect, Scene};
use crate::units::PixelSize;

/// Narrower than this, a title would stand in too many lines.
const LEAST_WIDTH: i32 = 440;

/// The part of the plane that a figure shows, px of the image: x0, y0, x1, y1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct View(pub [f64; 4]);

impl View {
    /// The whole image.
    pub fn image(backdrop: &Backdrop) -> Self {
        let [width, height] = backdrop.size();
        Self([-0.5, -0.5, width as f64 - 0.5, height as f64 - 0.5])
    }

    /// The rectangle that holds this one and the points, with a little room beyond points outside.
    pub fn with(self, points: impl Iterator<Item = [f64; 2]>) -> Self {
        let Some(Self([a, b, c, d])) = Self::bounds(points) else { return self };
        let [x0, y0, x1, y1] = self.0;
        let room = 0.02 * (c.max(x1) - a.min(x0)).max(d.max(y1) - b.min(y0));
        let low = |own: f64, other: f64| if other < own { other - room } else { own };
        let high = |own: f64, other: f64| if other > own { other + room } else { own };
        Self([low(x0, a), low(y0, b), high(x1, c), high(y1, d)])
    }

    /// The rectangle around points with a little room; `None` without any.
    pub fn around(points: impl Iterator<Item = [f64; 2]>) -> Option<Self> {
        let Self([x0, y0, x1, y1]) = Self::bounds(points)?;
        let room = 0.04 * (x1 - x0).max(y1 - y0).max(1.0);
        Some(Self([x0 - room, y0 - room, x1 + room, y1 + room]))
    }

    fn bounds(mut points: impl Iterator<Item = [f64; 2]>) -> Option<Self> {
        let [x, y] = points.next()?;
        let grow = |[a, b, c, d]: [f64; 4], [x, y]: [f64; 2]| [a.min(x), b.min(y), c.max(x), d.max(y)];
        Some(Self(points.fold([x, y, x, y], grow)))
    }

    fn size(self) -> [f64; 2] {
        let [x0, y0, x1, y1] = self.0;
        [x1 - x0, y1 - y0]
    }
}

/// What stands around the map.
#[derive(Debug, Default)]
pub(super) struct Words<'a> {
    pub title: &'a str,
    pub warnings: Vec<String>,
    pub notes: Vec<String>,
}

/// Where everything stands.
pub(super) struct FigureLayout<'a> {
    backdrop: &'a Backdrop,
    words: &'a Words<'a>,
    size: [i32; 2],
    map: Rect,
    bar: Option<(&'a Bar, Rect, SideAxis)>,
    view: View,
    /// Units of the picture per px of the image, along x and y.
    scale: [f64; 2],
    sides: Vec<SideAxis>,
    head: Lines,
    foot: Lines,
    foot_top: i32,
    pub letters: Letters,
}

impl<'a> FigureLayout<'a> {
    pub fn new(
        backdrop: &'a Backdrop,
        view: View,
        pixel_size: Option<PixelSize>,
        bar: Option<&'a Bar>,
        words: &'a Words<'a>,
    ) -> Self {
        let longer = backdrop.look().side(LONGER_SIDE);
        let layout = Self::of_side(longer, backdrop, view, pixel_size, bar, words);
        // What stands beside the map is known now.
        match backdrop.look().narrowed(longer, layout.size[0], layout.map.width) {
            Some(longer) => Self::of_side(longer, backdrop, view, pixel_size, bar, words),
            None => layout,
        }
    }

    fn of_side(
        longer: f64,
        backdrop: &'a Backdrop,
        view: View,
        pixel_size: Option<PixelSize>,
        bar: Option<&'a Bar>,
        words: &'a Words<'a>,
    ) -> Self {
        let letters = Letters::new(backdrop.look());
        let size = view.size();
        let factor = longer / size[0].max(size[1]);
        let [map_width, map_height] = size.map(|side| (side * factor).round().max(1.0) as i32);
        let scale = [f64::from(map_width) / size[0], f64::from(map_height) / size[1]];
        // Beside a wide image a standing bar would be squashed.
        let flat = f64::from(map_width) > 1.5 * f64::from(map_height);
        let sides = sides(&letters, view, [map_width, map_height], scale, pixel_size);
        let axis_at = |side: Side| sides.iter().find(|axis| axis.side == side);
        let thickness = |side: Side| axis_at(side).map_or(0, |axis| axis.thickness(&letters));
        let overhang = |at: [Side; 2], length: i32| {
            at.into_iter().filter_map(axis_at).map(|axis| axis.overhang(&letters, length)).max().unwrap_or(0)
        };
        let beside = overhang([Side::Bottom, Side::Top], map_width);
        let over = overhang([Side::Left, Side::Right], map_height);
        let (mut left, mut right) = (thickness(Side::Left).max(beside), thickness(Side::Right).max(beside));
        let above = thickness(Side::Top).max(over).max(TIP + 2);
        let mut below = thickness(Side::Bottom).max(over).max(TIP + 2);

        let place = bar.map(|bar| {
            let length = if flat { map_width } else { map_height };
            let axis = bar.axis(&letters, length, flat);
            let overhang = axis.overhang(&letters, length).max(TIP + 2);
            if flat {
                let down = below + 2 * GAP;
                left = left.max(overhang);
                right = right.max(overhang);
                below = down + BAR_WIDTH + axis.thickness(&letters);
                (bar, Rect { x: 0, y: map_height + down, width: map_width, height: BAR_WIDTH }, axis)
            } else {
                let aside = right + 2 * GAP;
                right = aside + BAR_WIDTH + axis.thickness(&letters);
                below = below.max(overhang);
                (bar, Rect { x: map_width + aside, y: 0, width: BAR_WIDTH, height: map_height }, axis)
            }
        });

        let needed = left + map_width + right + 2 * BORDER;
        let width = needed.max(LEAST_WIDTH);
        let inner = width - 2 * BORDER;
        let (mut head, mut foot) = (Lines::default(), Lines::default());
        head.title(&letters, words.title, inner);
        head.warnings(&letters, &words.warnings, inner);
        foot.notes(&letters, &words.notes, inner);
        let lines = head.height(&letters);
        let head_height = if lines > 0 { lines + GAP } else { 0 };
        let map = Rect {
            x: BORDER + left + (width - needed) / 2,
            y: BORDER + head_height + above,
            width: map_width,
            height: map_height,
        };
        let lines = foot.height(&letters);
        let foot_top = map.bottom() + below + 2 * GAP;
        let height = if lines > 0 { foot_top + lines } else { map.bottom() + below } + BORDER;
        let bar = place.map(|(bar, place, axis)| (bar, Rect { x: map.x + place.x, y: map.y + place.y, ..place }, axis));
        let size = [width, height];
        Self { backdrop, words, size, map, bar, view, scale, sides, head, foot, foot_top, letters }
    }

    /// A sheet with the image on it.
    pub fn begin(&self) -> Scene {
        let mut scene = Scene::new(self.size[0], self.size[1]);
        scene.clip(self.map);
        if let Some(png) = self.backdrop.png() {
            let [width, height] = self.backdrop.size().map(|side| side as f64);
            let [x, y] = self.place([-0.5, -0.5]);
            scene.image([x, y, width * self.scale[0], height * self.scale[1]], png, 1.0);
        }
        scene
    }

    /// Everything around the map; the finished picture.
    pub fn finish(&self, mut scene: Scene) -> Picture {
        scene.unclip();
        scene.frame(self.map, BLACK);
        let letters = &self.letters;
        self.sides.iter().for_each(|axis| axis.draw(&mut scene, letters, self.map));
        if let Some((bar, rect, axis)) = &self.bar {
            bar.draw(&mut scene, *rect, self.backdrop.mean());
            axis.draw(&mut scene, letters, *rect);
        }
        self.head.draw(&mut scene, letters, Anchor::Middle, f64::from(self.size[0]) / 2.0, BORDER);
        self.foot.draw(&mut scene, letters, Anchor::Start, f64::from(BORDER), self.foot_top);
        let bar = self.bar.as_ref().map(|bar| bar.1);
        let words = (self.words.title, &*self.words.notes);
        let picture = scene.finish(words, self.backdrop.look(), self.map, bar, self.backdrop.ratio());
        picture.with_warnings(self.words.warnings.clone(), self.backdrop.look())
    }

    /// Where a point of the image (px) stands on the sheet.
    pub fn place(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [x0, y0, ..] = self.view.0;
        [f64::from(self.map.x) + (x - x0) * self.scale[0], f64::from(self.map.y) + (y - y0) * self.scale[1]]
    }

    /// Units of the sheet per px of the image.
    pub fn unit(&self) -> f64 {
        self.scale[0].min(self.scale[1])
    }

    pub fn map(&self) -> Rect {
        self.map
    }

    /// An empty layer as large as the map.
    pub fn layer(&self) -> Layer {
        let ratio = self.backdrop.ratio();
        Layer::new(self.map.width as u32 * ratio, self.map.height as u32 * ratio)
    }

    /// Where a point of the image (px) lies on a layer.
    pub fn on_layer(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let ratio = f64::from(self.backdrop.ratio());
        let [x0, y0, ..] = self.view.0;
        [(x - x0) * self.scale[0] * ratio, (y - y0) * self.scale[1] * ratio]
    }

    /// Lays a layer over the map.
    pub fn lay(&self, scene: &mut Scene, layer: &Layer, opacity: f64) {
        let Rect { x, y, width, height } = self.map;
        scene.image([x, y, width, height].map(f64::from), &layer.png(), opacity);
    }
}

/// Axes in px at the left and below, in mm at the right and above.
fn sides(
    letters: &Letters,
    view: View,
    map: [i32; 2],
    scale: [f64; 2],
    pixel_size: Option<PixelSize>,
) -> Vec<SideAxis> {
    let View([x0, y0, x1, y1]) = view;
    let across = |text: &str| letters.small.width(text);
    let upright = |_: &str| f64::from(letters.small.digit());
    let [width, height] = map.map(f64::from);
    // Numbers between two pixels say nothing, unless there are hardly any pixels.
    let least = |from: f64, to: f64| if to - from > 1.0 { 1.0 } else { 0.0 };
    let x = ticks(Range { low: x0, high: x1 }, width, least(x0, x1), 28.0, across);
    let y = ticks(Range { low: y0, high: y1 }, height, least(y0, y1), 18.0, upright);
    let mut sides = vec![
        SideAxis::new(Side::Bottom, &x, |v| (v - x0) * scale[0], "x (px)"),
        SideAxis::new(Side::Left, &y, |v| (v - y0) * scale[1], "y (px), down"),
    ];
    if let Some(mm) = pixel_size.map(PixelSize::mm_per_px) {
        let x = ticks(Range { low: x0 * mm, high: x1 * mm }, width, 0.0, 28.0, across);
        let y = ticks(Range { low: y0 * mm, high: y1 * mm }, height, 0.0, 18.0, upright);
        sides.push(SideAxis::new(Side::Top, &x, |v| (v / mm - x0) * scale[0], "x (mm)"));
        sides.push(SideAxis::new(Side::Right, &y, |v| (v / mm - y0) * scale[1], "y (mm), down"));
    }
    sides
}
