//! A square grid of the plane as the camera sees it, to be looked at.

use super::Camera;
use crate::plane::{Point, distance};

/// Points along a side of the image.
const ALONG: usize = 33;
/// Points from one line to the next.
const EVERY: usize = 4;

/// Lines that are straight and square in the plane.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraGrid {
    /// Points of each line where a plain camera sees them, px.
    pub plain: Vec<Vec<Point>>,
    /// The same points as this camera sees them, px.
    pub seen: Vec<Vec<Point>>,
    /// Largest distance of the two, px.
    pub most_px: f64,
}

impl Camera {
    /// The grid of the plane in an image; `None` where it is that of a plain camera.
    pub fn grid(&self) -> Option<CameraGrid> {
        if self.is_plain() {
            return None;
        }
        let side = |n: usize| (0..ALONG).map(move |k| k as f64 * (n - 1) as f64 / (ALONG - 1) as f64);
        let [width, height] = self.shape().image_size_px;
        let upright = side(width).step_by(EVERY).map(|x| side(height).map(|y| [x, y]).collect());
        let level = side(height).step_by(EVERY).map(|y| side(width).map(|x| [x, y]).collect());
        let plain: Vec<Vec<Point>> = upright.chain(level).collect();
        let seen: Vec<Vec<Point>> = plain.iter().map(|line| line.iter().map(|&at| self.pixel(at)).collect()).collect();
        let off = plain.iter().flatten().zip(seen.iter().flatten()).map(|(&a, &b)| distance(a, b));
        let most_px = off.fold(0.0, f64::max);
        Some(CameraGrid { plain, seen, most_px })
    }
}

#[cfg(test)]
mod tests {
    use super::super::CameraShape;
    use super::*;

    #[test]
    fn a_lens_of_one_percent_bends_the_grid_by_as_much_at_the_corner() {
        let mut shape = CameraShape::plain([641, 481]);
        assert_eq!(Camera::new(shape.clone()).unwrap().grid(), None);
        shape.theta[0] = 0.01;
        let grid = Camera::new(shape).unwrap().grid().unwrap();
        assert_eq!((grid.plain.len(), grid.seen.len()), (18, 18));
        // The corner of the outermost pixel is a little nearer than half the diagonal of the image.
        assert!((grid.most_px - 4.0).abs() < 0.05, "{}", grid.most_px);
        // A line through the centre stays straight.
        assert!(grid.seen[4].iter().all(|p| (p[0] - 320.0).abs() < 1e-9));
    }
}
