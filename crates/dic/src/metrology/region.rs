//! The part of the images that is looked at.

use super::MetrologyError;
use super::wave::FADE;
use crate::imaging::{Image, Levels, Pixels};
use crate::mesh::{Roi, Zone};
use std::sync::Arc;

/// The most pixels that are looked at: more of the same texture says nothing new and takes longer.
const MOST_PIXELS: usize = 1 << 20;
/// Width of the band around the zone, px: what is cut out fades there, and faded pixels must not be moved in.
const BAND: usize = FADE + 2;
/// The least zone, px: with its bands 72 px, a number that is fast to transform.
pub(super) const LEAST: usize = 36;

/// A rectangle cut out of the images, and the zone inside it that is measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Region {
    /// First column and row in the image.
    corner: [usize; 2],
    /// Columns and rows.
    pub size: [usize; 2],
    /// The zone in the coordinates of the part cut out: first column and row, and those after the last.
    pub zone: [usize; 4],
}

impl Region {
    /// The middle of `roi` (the whole image if `None`), as much of it as is needed.
    pub fn new(image: &Image, roi: Option<Roi>) -> Result<Self, MetrologyError> {
        let whole = [image.width(), image.height()];
        let (mut low, mut high) = ([0, 0], whole);
        if let Some(roi @ Roi { x0, y0, x1, y1 }) = roi {
            let finite = [x0, y0, x1, y1].iter().all(|v| v.is_finite());
            if !finite || x0 >= x1 || y0 >= y1 {
                return Err(MetrologyError::NotARectangle(roi));
            }
            if x0 < -0.5 || y0 < -0.5 || x1 > whole[0] as f64 || y1 > whole[1] as f64 {
                return Err(MetrologyError::OutsideImage(roi, whole));
            }
            low = [x0, y0].map(|v| v.max(0.0).ceil() as usize);
            high = [x1, y1].map(|v| v.floor().max(0.0) as usize);
        }
        let too_small = || MetrologyError::TooSmall {
            size: [0, 1].map(|k| high[k].saturating_sub(low[k])),
            least: LEAST + 2 * BAND,
        };
        // With its band, as far as the image reaches.
        let outer = [0, 1].map(|k| [low[k].saturating_sub(BAND), (high[k] + BAND).min(whole[k])]);
        if (0..2).any(|k| high[k] <= low[k] || outer[k][1] - outer[k][0] < LEAST + 2 * BAND) {
            return Err(too_small());
        }
        let full = outer.map(|[low, high]| high - low);
        let short = full[0].min(full[1]).min(1 << 10);
        let size = full.map(|n| even_to_transform(n.min(MOST_PIXELS / short)));
        let corner = [0, 1].map(|k| {
            let centred = (low[k] + high[k]).saturating_sub(size[k]) / 2;
            centred.clamp(outer[k][0], outer[k][1] - size[k])
        });
        // In the zone what was asked for and does not fade.
        let first = [0, 1].map(|k| BAND.max(low[k].saturating_sub(corner[k])));
        let last = [0, 1].map(|k| (size[k] - BAND).min(high[k] - corner[k]));
        if (0..2).any(|k| last[k] < first[k] + LEAST) {
            return Err(too_small());
        }
        Ok(Self { corner, size, zone: [first[0], first[1], last[0], last[1]] })
    }

    /// The zone as the one of a mesh.
    pub fn zones(&self) -> [Zone; 1] {
        let [x0, y0, x1, y1] = self.zone.map(|v| v as f64);
        [Zone::rectangle("image", Roi { x0, y0, x1, y1 })]
    }

    /// The zone in the whole image: left, top, right, bottom, the last two not included.
    pub fn in_image(&self) -> [usize; 4] {
        let ([x, y], [x0, y0, x1, y1]) = (self.corner, self.zone);
        [x0 + x, y0 + y, x1 + x, y1 + y]
    }

    /// How many elements of this size the zone holds.
    pub fn elements(&self, element_size: usize) -> usize {
        let [x0, y0, x1, y1] = self.zone;
        ((x1 - x0) / element_size) * ((y1 - y0) / element_size)
    }

    /// Whether elements of this size fit, two by two.
    pub fn fits(&self, element_size: usize) -> bool {
        let [x0, y0, x1, y1] = self.zone;
        2 * element_size <= (x1 - x0).min(y1 - y0)
    }

    /// The part of `image`, in its depth.
    pub fn cut(&self, image: &Image) -> Arc<Image> {
        let [width, height] = self.size;
        let rows = (self.corner[1]..).take(height).map(|y| y * image.width() + self.corner[0]);
        let pixels = match image.pixels() {
            Levels::U8(p) => Pixels::U8(rows.flat_map(|at| &p[at..at + width]).copied().collect()),
            Levels::U16(p) => Pixels::U16(rows.flat_map(|at| &p[at..at + width]).copied().collect()),
            Levels::F32(p) => Pixels::F32(rows.flat_map(|at| &p[at..at + width]).copied().collect()),
        };
        // A part of an image is an image: its length fits and its grey levels are finite.
        Arc::new(Image::new(width, height, pixels).expect("a part of an image"))
    }
}

/// The largest number up to `n` whose prime factors are 2, 3 and 5: fast to transform.
fn even_to_transform(n: usize) -> usize {
    let is_even = |k: &usize| {
        let mut rest = *k;
        for factor in [2, 3, 5] {
            while rest.is_multiple_of(factor) {
                rest /= factor;
            }
        }
        rest == 1
    };
    (1..=n).rev().find(is_even).unwrap_or(n)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(width: usize, height: usize) -> Image {
        Image::new(width, height, Pixels::U8((0..width * height).map(|k| k as u8).collect())).unwrap()
    }

    #[test]
    fn the_zone_lies_in_the_region_asked_for_and_off_the_fading_band() {
        for (width, height, roi) in [
            (512, 512, None),
            (4000, 501, None),
            (72, 73, None),
            (512, 400, Some([100.0, 50.0, 300.0, 390.0])),
            (3000, 3000, Some([0.0, 10.5, 2900.0, 2000.0])),
            (512, 512, Some([-0.5, -0.5, 512.0, 512.0])),
        ] {
            let image = image(width, height);
            let roi = roi.map(|[x0, y0, x1, y1]| Roi { x0, y0, x1, y1 });
            let region = Region::new(&image, roi).unwrap();
            let (zone, [w, h], outer) = (region.zone, region.size, region.in_image());
            assert!(w * h <= MOST_PIXELS && zone[0] >= BAND && zone[2] + BAND <= w && zone[3] + BAND <= h);
            if let Some(Roi { x0, y0, x1, y1 }) = roi {
                assert!(
                    outer[0] as f64 >= x0 && outer[1] as f64 >= y0 && outer[2] as f64 <= x1 && outer[3] as f64 <= y1
                );
            }
            let part = region.cut(&image);
            assert_eq!((part.width(), part.height()), (w, h));
            assert_eq!(part.grey(zone[0], zone[1]), image.grey(outer[0], outer[1]));
            // A long picture is used along its length.
            assert!(width != 4000 || (w >= 2000 && h >= 480), "{w} x {h}");
        }
    }
}
