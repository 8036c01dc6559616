//! Elements in pixels.

use super::backdrop::png;
use super::scene::Rgb;
use crate::mesh::shape_functions;
use image::ExtendedColorType;

/// How far beyond an edge a point still counts as inside, in local coordinates: round-off, so that no seam
/// opens between neighbours.
const ROUND_OFF: f64 = 1e-9;

/// A transparent sheet of pixels.
pub(super) struct Layer {
    width: u32,
    height: u32,
    rgba: Vec<u8>,
}

impl Layer {
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height, rgba: vec![0; 4 * width as usize * height as usize] }
    }

    /// Colours the pixels whose centres lie in the element with these corners (in pixels of the layer, from its
    /// upper left corner); `colour` is given the shape functions there.
    pub fn fill(&mut self, corners: [[f64; 2]; 4], mut colour: impl FnMut([f64; 4]) -> Rgb) {
        let cells = |axis: usize, n: u32| {
            let ends = corners.iter().map(|c| c[axis]);
            let (low, high) = ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
            let cell = |v: f64| v.clamp(0.0, f64::from(n)) as u32;
            cell((low - 0.5 - 1e-6).ceil())..cell((high - 0.5 + 1e-6).floor() + 1.0)
        };
        let element = Element::new(corners);
        for row in cells(1, self.height) {
            for column in cells(0, self.width) {
                let Some(shape) = element.shape([f64::from(column) + 0.5, f64::from(row) + 0.5]) else { continue };
                let [r, g, b] = colour(shape);
                let at = 4 * (row as usize * self.width as usize + column as usize);
                self.rgba[at..at + 4].copy_from_slice(&[r, g, b, 255]);
            }
        }
    }

    /// The layer as a PNG file.
    pub fn png(&self) -> Vec<u8> {
        png(&self.rgba, self.width, self.height, ExtendedColorType::Rgba8)
    }
}

/// An element made ready to find the shape functions at points.
///
/// `mesh::local_coordinates` iterates, point by point. Here there are as many points as pixels, and a
/// magnified element may be folded over: the closed form finds the pixels of such a one as well.
#[derive(Debug, Clone, Copy)]
pub(super) enum Element {
    /// Three corners, the last two nodes being one: the corner, and the rows of the inverse of its edges.
    Triangle([f64; 2], [[f64; 2]; 2]),
    /// Four corners: `a + e xi + f eta + g xi eta`.
    Quad { a: [f64; 2], e: [f64; 2], f: [f64; 2], g: [f64; 2] },
    /// Neither: it covers nothing.
    Nothing,
}

fn minus(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

fn cross(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

impl Element {
    pub fn new([a, b, c, d]: [[f64; 2]; 4]) -> Self {
        let (e, f) = (minus(b, a), minus(d, a));
        if c != d {
            return Element::Quad { a, e, f, g: minus(minus(c, b), f) };
        }
        let area = cross(e, f);
        if area == 0.0 {
            return Element::Nothing;
        }
        Element::Triangle(a, [[f[1] / area, -f[0] / area], [-e[1] / area, e[0] / area]])
    }

    /// The shape functions of the four nodes at a point; `None` outside.
    pub fn shape(&self, point: [f64; 2]) -> Option<[f64; 4]> {
        let inside = |v: f64| (-ROUND_OFF..=1.0 + ROUND_OFF).contains(&v);
        match *self {
            Element::Nothing => None,
            Element::Triangle(a, rows) => {
                let p = minus(point, a);
                let [s, t] = rows.map(|row| row[0] * p[0] + row[1] * p[1]);
                (inside(s) && inside(t) && inside(s + t)).then_some([1.0 - s - t, s, t, 0.0])
            }
            Element::Quad { a, e, f, g } => {
                let h = minus(point, a);
                // h = e xi + f eta + g xi eta; crossing with e + g eta leaves a quadratic equation for eta.
                let (k2, k1, k0) = (cross(g, f), cross(e, f) + cross(h, g), cross(h, e));
                let xi = |eta: f64| {
                    let along = [e[0] + g[0] * eta, e[1] + g[1] * eta];
                    let rest = minus(h, [f[0] * eta, f[1] * eta]);
                    let k = usize::from(along[1].abs() > along[0].abs());
                    rest[k] / along[k]
                };
                let good = |eta: f64| {
                    let xi = xi(eta);
                    (inside(eta) && inside(xi)).then(|| shape_functions(xi, eta))
                };
                if k2.abs() <= 1e-12 * (cross(e, f).abs() + k1.abs()) {
                    return good(-k0 / k1);
                }
                let under = k1 * k1 - 4.0 * k2 * k0;
                if under < 0.0 {
                    return None;
                }
                // No difference of nearly equal numbers in either root.
                let q = -0.5 * (k1 + under.sqrt().copysign(k1));
                good(k0 / q).or_else(|| good(q / k2))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const QUADS: [[[f64; 2]; 4]; 5] = [
        [[0.0, 0.0], [2.0, 0.0], [2.0, 3.0], [0.0, 3.0]],
        [[1.0, 1.0], [4.0, 0.0], [5.0, 4.0], [0.5, 3.0]],
        [[0.0, 0.0], [1.0, 1.0], [0.0, 2.0], [-1.0, 1.0]],
        [[0.0, 3.0], [2.0, 3.0], [2.0, 0.0], [0.0, 0.0]], // turned inside out
        [[0.0, 0.0], [2.0, 0.1], [0.4, 1.7], [0.4, 1.7]], // a triangle
    ];

    #[test]
    fn shape_functions_are_found_back_in_any_element() {
        for corners in QUADS {
            let element = Element::new(corners);
            for (i, j) in (0..=10).flat_map(|i| (0..=10).map(move |j| (i, j))) {
                let want = shape_functions(f64::from(i) / 10.0, f64::from(j) / 10.0);
                let point = |k: usize| want.iter().zip(corners).map(|(n, c)| n * c[k]).sum::<f64>();
                let point = [point(0), point(1)];
                let shape = element.shape(point).unwrap_or_else(|| panic!("{point:?} is inside {corners:?}"));
                for k in 0..2 {
                    let again: f64 = shape.iter().zip(corners).map(|(n, c)| n * c[k]).sum();
                    // Some ten roundings of numbers up to 5, and a square root.
                    assert!((again - point[k]).abs() < 1e-7, "{corners:?}: {point:?} became {shape:?}");
                }
            }
            for point in [[9.0, 0.0], [-2.0, 1.0], [1.0, -1.0], [1.0, 7.0]] {
                assert_eq!(element.shape(point), None, "{point:?} is outside {corners:?}");
            }
        }
    }

    #[test]
    fn an_element_without_area_covers_nothing() {
        let line = [[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [3.0, 3.0]];
        for corners in [line, [[1.0, 1.0]; 4], [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 0.0]]] {
            assert_eq!(Element::new(corners).shape([0.3, 0.7]), None, "{corners:?}");
        }
    }
}
