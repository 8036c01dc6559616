//! The bar that says which number a colour stands for.

use super::axes::{Letters, Side, SideAxis};
use super::backdrop::png;
use super::scale::{Palette, Range, ticks};
use super::scene::{BLACK, Path, Rect, Rgb, Scene, Stroke};
use image::ExtendedColorType;

pub(super) const BAR_WIDTH: i32 = 20;
/// Tips of the bar where values lie beyond its range.
pub(super) const TIP: i32 = 10;

/// What the colour bar shows.
#[derive(Debug, Clone)]
pub(super) struct Bar {
    pub range: Range,
    pub palette: Palette,
    pub opacity: f64,
    /// Whether there are values below the range.
    pub below: bool,
    /// Whether there are values above the range.
    pub above: bool,
    /// Quantity and unit.
    pub label: String,
}

impl Bar {
    /// Its numbers and what they count, along a bar of `length` that lies `flat` or stands.
    pub fn axis(&self, letters: &Letters, length: i32, flat: bool) -> SideAxis {
        let across = |text: &str| letters.small.width(text);
        let upright = |_: &str| f64::from(letters.small.digit());
        let ticks = if flat {
            ticks(self.range, f64::from(length), 0.0, 24.0, across)
        } else {
            ticks(self.range, f64::from(length), 0.0, 36.0, upright)
        };
        let place = |value: f64| {
            let along = self.range.fraction(value) * f64::from(length);
            if flat { along } else { f64::from(length) - along - 1e-6 }
        };
        let side = if flat { Side::Bottom } else { Side::Right };
        SideAxis::new(side, &ticks, place, &self.label).titled(letters, &self.label, length)
    }

    /// Draws it over a `grey`, so that its colours are those of a map on an image of that mean.
    pub fn draw(&self, scene: &mut Scene, rect: Rect, grey: u8) {
        let Rect { x, y, width, height } = rect;
        let flat = width > height;
        let length = width.max(height) as u32;
        // The ends of the bar have the colours of the ends of the range, exactly.
        let Range { low, high } = self.range;
        let value = |step: u32| low + (high - low) * f64::from(step) / f64::from((length - 1).max(1));
        let step = |k: u32| if flat { k } else { length - 1 - k };
        let colours: Vec<u8> = (0..length).flat_map(|k| self.range.colour(self.palette, value(step(k)))).collect();
        let size = if flat { [length, 1] } else { [1, length] };
        let grey: Rgb = [grey; 3];
        scene.fill(rect, grey);
        let strip = png(&colours, size[0], size[1], ExtendedColorType::Rgb8);
        scene.image([x, y, width, height].map(f64::from), &strip, self.opacity);
        scene.frame(rect, BLACK);
        for (there, end) in [(self.below, 0.0), (self.above, 1.0)] {
            if there {
                let tip = tip(rect, flat, end);
                scene.area(&tip, grey, 1.0);
                scene.area(&tip, self.range.colour(self.palette, if end == 0.0 { low } else { high }), self.opacity);
                scene.stroke(&tip, &Stroke::new(BLACK, 1.0));
            }
        }
    }
}

/// A triangle beyond an end of the bar.
fn tip(rect: Rect, flat: bool, end: f64) -> Path {
    let [x, y, width, height, tip] = [rect.x, rect.y, rect.width, rect.height, TIP].map(f64::from);
    let low = end == 0.0;
    let corners = if flat {
        let from = if low { x - 0.5 } else { x + width + 0.5 };
        let apex = if low { from - tip } else { from + tip };
        [[from, y + 0.5], [from, y + height - 0.5], [apex, y + height / 2.0]]
    } else {
        let from = if low { y + height + 0.5 } else { y - 0.5 };
        let apex = if low { from + tip } else { from - tip };
        [[x + 0.5, from], [x + width - 0.5, from], [x + width / 2.0, apex]]
    };
    let mut path = Path::default();
    path.polygon(corners);
    path
}
