//! From a place back to the local coordinates: by iteration for one point, prepared for many.

use super::shape_functions;
use crate::plane::{cross, minus};

/// The local coordinates at which the element with these corners has the point `p`; beyond 0..1 outside of
/// it. `None` where there are none (far outside a distorted element).
pub fn local_coordinates(corners: [[f64; 2]; 4], p: [f64; 2]) -> Option<[f64; 2]> {
    let [a, b, c, d] = corners;
    if c == d {
        // A triangle: its area coordinates are (1 - xi)(1 - eta), xi (1 - eta), eta.
        let area = cross(minus(b, a), minus(c, a));
        let (second, third) = (cross(minus(p, a), minus(c, a)) / area, cross(minus(b, a), minus(p, a)) / area);
        let rest = 1.0 - third;
        let xi = if rest.abs() > 1e-12 { second / rest } else { 0.0 };
        return Some([xi, third]);
    }
    let (e, f) = (minus(b, a), minus(d, a));
    let twist = [a[0] - b[0] + c[0] - d[0], a[1] - b[1] + c[1] - d[1]];
    let (mut xi, mut eta) = (0.5, 0.5);
    for _ in 0..30 {
        let at = |k: usize| a[k] + xi * e[k] + eta * f[k] + xi * eta * twist[k] - p[k];
        let rest = [at(0), at(1)];
        let by_xi = [e[0] + eta * twist[0], e[1] + eta * twist[1]];
        let by_eta = [f[0] + xi * twist[0], f[1] + xi * twist[1]];
        let area = cross(by_xi, by_eta);
        let step = [cross(rest, by_eta) / area, cross(by_xi, rest) / area];
        xi -= step[0];
        eta -= step[1];
        if !(xi.is_finite() && eta.is_finite()) {
            return None;
        }
        if step[0].abs() + step[1].abs() < 1e-14 {
            break;
        }
    }
    let psi = shape_functions(xi, eta);
    let off = |k: usize| corners.iter().zip(psi).map(|(corner, psi)| psi * corner[k]).sum::<f64>() - p[k];
    let size = e[0].abs() + e[1].abs() + f[0].abs() + f[1].abs();
    (off(0).abs() + off(1).abs() < 1e-9 * size).then_some([xi, eta])
}

/// How far beyond an edge a point is inside for [`InverseMap::shape`], locally: round-off, so that no seam opens.
const ROUND_OFF: f64 = 1e-9;

/// The inverse map of one element in closed form, made ready for many points.
///
/// [`local_coordinates`] iterates, point by point. A figure has as many points as pixels, and a magnified element may
/// be folded over: the closed form finds the points of such a one as well.
#[derive(Debug, Clone, Copy)]
pub struct InverseMap(Shape);

#[derive(Debug, Clone, Copy)]
enum Shape {
    /// Three corners, the last two nodes being one: the corner, and the rows of the inverse of its edges.
    Triangle([f64; 2], [[f64; 2]; 2]),
    /// Four corners whose sides are parallel: the first, and the rows of the inverse of its edges.
    Parallelogram([f64; 2], [[f64; 2]; 2]),
    /// Four corners: `a + e xi + f eta + g xi eta`.
    Quad { a: [f64; 2], e: [f64; 2], f: [f64; 2], g: [f64; 2] },
    /// Neither: it covers nothing.
    Nothing,
}

impl InverseMap {
    /// That of the element with these corners, in either sense; of a triangle the last one twice.
    pub fn new([a, b, c, d]: [[f64; 2]; 4]) -> Self {
        let (e, f) = (minus(b, a), minus(d, a));
        let g = minus(minus(c, b), f);
        let size = [e, f].as_flattened().iter().fold(0.0f64, |size, v| size.max(v.abs()));
        // A regular mesh has nothing else, and its map is linear.
        let is_parallelogram = c != d && g[0].abs().max(g[1].abs()) <= 1e-13 * size;
        if c != d && !is_parallelogram {
            return Self(Shape::Quad { a, e, f, g });
        }
        let area = cross(e, f);
        if area == 0.0 {
            return Self(Shape::Nothing);
        }
        let rows = [[f[1] / area, -f[0] / area], [-e[1] / area, e[0] / area]];
        Self(if is_parallelogram { Shape::Parallelogram(a, rows) } else { Shape::Triangle(a, rows) })
    }

    /// The shape functions of the four nodes at a point; `None` outside.
    #[inline]
    pub fn shape(&self, point: [f64; 2]) -> Option<[f64; 4]> {
        let inside = |v: f64| (-ROUND_OFF..=1.0 + ROUND_OFF).contains(&v);
        match self.0 {
            Shape::Nothing => None,
            Shape::Triangle(a, rows) => {
                let p = minus(point, a);
                let [s, t] = rows.map(|row| row[0] * p[0] + row[1] * p[1]);
                (inside(s) && inside(t) && inside(s + t)).then_some([1.0 - s - t, s, t, 0.0])
            }
            Shape::Parallelogram(a, rows) => {
                let p = minus(point, a);
                let [xi, eta] = rows.map(|row| row[0] * p[0] + row[1] * p[1]);
                (inside(xi) && inside(eta)).then(|| shape_functions(xi, eta))
            }
            Shape::Quad { a, e, f, g } => {
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
    use super::super::ElementGeometry;
    use super::*;

    const QUADS: [[[f64; 2]; 4]; 5] = [
        [[0.0, 0.0], [2.0, 0.0], [2.0, 3.0], [0.0, 3.0]],
        [[1.0, 1.0], [4.0, 0.0], [5.0, 4.0], [0.5, 3.0]],
        [[0.0, 0.0], [1.0, 1.0], [0.0, 2.0], [-1.0, 1.0]],
        [[0.0, 3.0], [2.0, 3.0], [2.0, 0.0], [0.0, 0.0]], // turned inside out
        [[0.0, 0.0], [2.0, 0.1], [0.4, 1.7], [0.4, 1.7]], // a triangle
    ];

    #[test]
    fn iterated_local_coordinates_lead_back_to_the_place() {
        for corners in QUADS {
            let element = ElementGeometry::new(corners);
            for (i, j) in (-2..=12).flat_map(|i| (-2..=9).map(move |j| (i, j))) {
                let point = element.place([f64::from(i) / 10.0, f64::from(j) / 10.0]);
                let local = element.local_coordinates(point).unwrap_or_else(|| panic!("{point:?} in {corners:?}"));
                let again = element.place(local);
                // It is given back only when it is this near; the iteration ends at a step of 1e-14.
                assert!((0..2).all(|k| (again[k] - point[k]).abs() < 1e-12), "{corners:?}: {point:?}, {again:?}");
            }
        }
    }

    #[test]
    fn shape_functions_are_found_back_in_any_element() {
        for corners in QUADS {
            let element = InverseMap::new(corners);
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
            assert_eq!(InverseMap::new(corners).shape([0.3, 0.7]), None, "{corners:?}");
        }
    }
}
