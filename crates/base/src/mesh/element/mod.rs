//! The four-node element: shape functions, their derivatives, the map of its square onto it, quadrature, mass matrix.
//!
//! Local coordinates `(xi, eta)` run over the square 0..1; its corners, in the order of an element's nodes, are
//! (0,0), (1,0), (1,1), (0,1). Corners that go around the element from x to y make a positive determinant. A triangle
//! is an element whose last two nodes are one: the shape functions of both then add up to the third linear one, and all
//! that is integrated here is right for it as it stands. Derivatives there are the same everywhere but in that corner,
//! where the map is singular.
//!
//! Everything is `f64`. The kernels of `backend` keep sums of their own, in `f32`.

mod inverse;

pub use inverse::{InverseMap, local_coordinates};

/// Local coordinates of the corners, in the order of an element's nodes.
pub const CORNERS: [[f64; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];

/// The two Gauss points along an axis, `1/2 -+ 1/(2 sqrt 3)`, each of weight 1/2: exact for polynomials up to the third
/// degree. As rounded here they are exactly as far from 0 as from 1.
pub const GAUSS: [f64; 2] = [0.211_324_865_405_187_13, 0.788_675_134_594_812_9];

/// The 2 x 2 Gauss points, around the square as its corners, each of weight 1/4.
pub const GAUSS_POINTS: [[f64; 2]; 4] =
    [[GAUSS[0], GAUSS[0]], [GAUSS[1], GAUSS[0]], [GAUSS[1], GAUSS[1]], [GAUSS[0], GAUSS[1]]];

/// Weight of each of [`GAUSS_POINTS`].
pub const GAUSS_WEIGHT: f64 = 0.25;

/// Bilinear shape functions at local coordinates (0..1), in the order of the nodes: (0,0), (1,0), (1,1), (0,1).
///
/// ```
/// # use quadrille_base as quadrille;
/// assert_eq!(quadrille::mesh::shape_functions(0.25, 0.5), [0.375, 0.125, 0.125, 0.375]);
/// ```
#[inline]
pub fn shape_functions(xi: f64, eta: f64) -> [f64; 4] {
    [(1.0 - xi) * (1.0 - eta), xi * (1.0 - eta), xi * eta, (1.0 - xi) * eta]
}

/// `[d/dxi, d/deta]` of each of the [`shape_functions`].
#[inline]
pub fn local_derivatives([xi, eta]: [f64; 2]) -> [[f64; 2]; 4] {
    [[eta - 1.0, xi - 1.0], [1.0 - eta, -xi], [eta, xi], [-eta, 1.0 - xi]]
}

/// The nodes of an element, each once: of a triangle the last two are one.
pub(crate) fn corners_of(nodes: &[u32; 4]) -> &[u32] {
    &nodes[..if nodes[2] == nodes[3] { 3 } else { 4 }]
}

/// `[[da/dxi, da/deta], [db/dxi, db/deta]]` of a field `(a, b)` with these `values` at the corners.
#[inline]
fn derivatives(values: &[[f64; 2]; 4], by_local: &[[f64; 2]; 4]) -> [[f64; 2]; 2] {
    [0, 1].map(|c| [0, 1].map(|k| (0..4).map(|i| values[i][c] * by_local[i][k]).sum()))
}

/// The shape of one element: the places of its corners, in the order of its nodes.
///
/// ```
/// # use quadrille_base as quadrille;
/// use quadrille::mesh::ElementGeometry;
/// let element = ElementGeometry::new([[8.0, 8.0], [24.0, 8.0], [24.0, 16.0], [8.0, 16.0]]);
/// assert_eq!(element.place([0.25, 0.5]), [12.0, 12.0]);
/// assert_eq!(element.map_at([0.5, 0.5]).determinant, 16.0 * 8.0);
/// assert!((element.mass_matrix()[0][2] - 16.0 * 8.0 / 36.0).abs() < 1e-12);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ElementGeometry {
    corners: [[f64; 2]; 4],
}

/// The map of an element at one point of its square, linearised there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalMap {
    /// `[[dx/dxi, dx/deta], [dy/dxi, dy/deta]]`.
    pub jacobian: [[f64; 2]; 2],
    /// Its determinant: area of the element over area of the square.
    pub determinant: f64,
    by_local: [[f64; 2]; 4],
}

impl LocalMap {
    /// `[d/dx, d/dy]` of each shape function; not finite where the determinant is zero.
    pub fn gradients(&self) -> [[f64; 2]; 4] {
        let ([[xx, xe], [yx, ye]], det) = (self.jacobian, self.determinant);
        self.by_local.map(|[by_xi, by_eta]| [(by_xi * ye - by_eta * yx) / det, (by_eta * xx - by_xi * xe) / det])
    }

    /// `[[du_x/dx, du_x/dy], [du_y/dx, du_y/dy]]` of the corner values `u`; not finite where the determinant is zero.
    #[inline]
    pub fn gradient_of(&self, u: &[[f64; 2]; 4]) -> [[f64; 2]; 2] {
        let [[xx, xe], [yx, ye]] = self.jacobian;
        let inverse = 1.0 / self.determinant;
        let u = derivatives(u, &self.by_local);
        u.map(|[by_xi, by_eta]| [(by_xi * ye - by_eta * yx) * inverse, (by_eta * xx - by_xi * xe) * inverse])
    }
}

impl ElementGeometry {
    /// The element with these corners; of a triangle the last one twice.
    pub fn new(corners: [[f64; 2]; 4]) -> Self {
        Self { corners }
    }

    /// Whether its last two corners are one.
    pub fn is_triangle(&self) -> bool {
        self.corners[2] == self.corners[3]
    }

    /// Its area, positive when the corners go from x to y.
    pub fn signed_area(&self) -> f64 {
        let [a, b, c, d] = self.corners;
        0.5 * ((c[0] - a[0]) * (d[1] - b[1]) - (c[1] - a[1]) * (d[0] - b[0]))
    }

    /// Its area, whatever the sense of the corners.
    pub fn area(&self) -> f64 {
        self.signed_area().abs()
    }

    /// The place of a point of the square.
    pub fn place(&self, [xi, eta]: [f64; 2]) -> [f64; 2] {
        let psi = shape_functions(xi, eta);
        [0, 1].map(|c| self.corners.iter().zip(psi).map(|(corner, psi)| psi * corner[c]).sum())
    }

    /// The local coordinates of a place: see [`local_coordinates`].
    pub fn local_coordinates(&self, p: [f64; 2]) -> Option<[f64; 2]> {
        local_coordinates(self.corners, p)
    }

    /// The map at a point of the square, linearised.
    #[inline]
    pub fn map_at(&self, at: [f64; 2]) -> LocalMap {
        let by_local = local_derivatives(at);
        let jacobian = derivatives(&self.corners, &by_local);
        let [[xx, xe], [yx, ye]] = jacobian;
        LocalMap { jacobian, determinant: xx * ye - xe * yx, by_local }
    }

    /// Integrals of the products of the shape functions over the element, exact for any quadrilateral and triangle that
    /// is not folded: on a rectangle 1/9, 1/18 and 1/36 of its area.
    pub fn mass_matrix(&self) -> [[f64; 4]; 4] {
        self.mass_and_area().0
    }

    /// The mass matrix, and the area by the same rule, so that the sum of the one is the other.
    fn mass_and_area(&self) -> ([[f64; 4]; 4], f64) {
        let (mut mass, mut area) = ([[0.0; 4]; 4], 0.0);
        for xi in GAUSS {
            for eta in GAUSS {
                let psi = shape_functions(xi, eta);
                let weight = GAUSS_WEIGHT * self.map_at([xi, eta]).determinant.abs();
                area += weight;
                for (row, i) in mass.iter_mut().zip(psi) {
                    row.iter_mut().zip(psi).for_each(|(sum, j)| *sum += weight * i * j);
                }
            }
        }
        (mass, area)
    }
}

/// The means of `psi_i psi_j` over an element with these corners (the last two equal in a triangle): 1/9, 1/18 and 1/36
/// on a rectangle. Zero without area.
///
/// ```
/// # use quadrille_base as quadrille;
/// let mean = quadrille::mesh::mean_products([[0.0, 0.0], [16.0, 0.0], [16.0, 16.0], [0.0, 16.0]]);
/// assert!((mean[0][0] - 1.0 / 9.0).abs() < 1e-12 && (mean[0][2] - 1.0 / 36.0).abs() < 1e-12);
/// ```
pub fn mean_products(corners: [[f64; 2]; 4]) -> [[f64; 4]; 4] {
    let (mass, area) = ElementGeometry::new(corners).mass_and_area();
    if area > 0.0 { mass.map(|row| row.map(|sum| sum / area)) } else { mass }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Quadrilaterals and, last, a triangle.
    const ELEMENTS: [[[f64; 2]; 4]; 4] = [
        [[8.0, 8.0], [24.0, 8.0], [24.0, 24.0], [8.0, 24.0]],
        [[1.0, 1.0], [4.0, 0.0], [5.0, 4.0], [0.5, 3.0]],
        [[0.0, 0.0], [3.0, 1.0], [4.0, 3.0], [1.0, 2.0]],
        [[0.0, 0.0], [2.0, 0.1], [0.4, 1.7], [0.4, 1.7]],
    ];

    /// Points in, on the border of, and outside the square.
    const POINTS: [[f64; 2]; 5] = [[0.3, 0.6], [0.0, 1.0], [0.5, 0.5], [0.9, 0.05], [1.2, -0.1]];

    #[test]
    fn shape_functions_are_one_at_their_own_corner_and_add_up_to_one() {
        for (k, [xi, eta]) in CORNERS.into_iter().enumerate() {
            let mut want = [0.0; 4];
            want[k] = 1.0;
            assert_eq!(shape_functions(xi, eta), want);
        }
        for at in POINTS {
            let sum: f64 = shape_functions(at[0], at[1]).iter().sum();
            assert!((sum - 1.0).abs() < 4.0 * f64::EPSILON, "{at:?}: {sum}"); // four roundings of numbers near one
            for k in 0..2 {
                let slope: f64 = local_derivatives(at).iter().map(|by| by[k]).sum();
                assert!(slope.abs() < 4.0 * f64::EPSILON, "{at:?}: {slope}");
            }
        }
    }

    #[test]
    fn derivatives_are_differences() {
        // Bilinear: a central difference along an axis has no truncation, only round-off over the step.
        const H: f64 = 1e-3;
        for [xi, eta] in POINTS {
            let along_xi = [shape_functions(xi - H, eta), shape_functions(xi + H, eta)];
            let along_eta = [shape_functions(xi, eta - H), shape_functions(xi, eta + H)];
            for (i, by) in local_derivatives([xi, eta]).iter().enumerate() {
                for (k, [low, high]) in [along_xi, along_eta].iter().enumerate() {
                    let want = (high[i] - low[i]) / (2.0 * H);
                    assert!((by[k] - want).abs() < 1e-12, "({xi}, {eta}), {i}, {k}: {} for {want}", by[k]);
                }
            }
        }
    }

    #[test]
    fn jacobian_and_gradients_are_those_of_the_map() {
        const H: f64 = 1e-3;
        let linear = |[x, y]: [f64; 2]| [0.3 * x - 0.2 * y + 1.0, 0.1 * x + 0.4 * y];
        for corners in ELEMENTS {
            let element = ElementGeometry::new(corners);
            for [xi, eta] in POINTS {
                if element.is_triangle() && eta >= 1.0 {
                    continue; // singular there
                }
                let map = element.map_at([xi, eta]);
                let ends = [
                    [element.place([xi - H, eta]), element.place([xi + H, eta])],
                    [element.place([xi, eta - H]), element.place([xi, eta + H])],
                ];
                for k in 0..2 {
                    for c in 0..2 {
                        let want = (ends[k][1][c] - ends[k][0][c]) / (2.0 * H);
                        assert!((map.jacobian[c][k] - want).abs() < 1e-10, "{corners:?}: {map:?}");
                    }
                }
                // The gradient of a linear field is its own, from both ways of writing it. Some twenty roundings.
                let u = corners.map(linear);
                let (gradient, by) = (map.gradient_of(&u), map.gradients());
                for (c, want) in [[0.3, -0.2], [0.1, 0.4]].into_iter().enumerate() {
                    for k in 0..2 {
                        let sum: f64 = (0..4).map(|i| u[i][c] * by[i][k]).sum();
                        assert!((gradient[c][k] - want[k]).abs() < 1e-12, "{corners:?}: {gradient:?}");
                        assert!((sum - want[k]).abs() < 1e-12, "{corners:?}: {by:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn the_rule_is_exact_up_to_the_third_degree_and_not_beyond() {
        assert_eq!(GAUSS[0] + GAUSS[1], 1.0);
        assert_eq!(1.0 - GAUSS[1], GAUSS[0]);
        let mean = |power: [i32; 2]| -> f64 {
            GAUSS_POINTS.iter().map(|at| GAUSS_WEIGHT * at[0].powi(power[0]) * at[1].powi(power[1])).sum()
        };
        let exact = |power: [i32; 2]| 1.0 / f64::from((power[0] + 1) * (power[1] + 1));
        for (p, q) in (0..=3).flat_map(|p| (0..=3).map(move |q| (p, q))) {
            assert!((mean([p, q]) - exact([p, q])).abs() < 1e-15, "xi^{p} eta^{q}: {}", mean([p, q]));
        }
        assert!((mean([4, 0]) - exact([4, 0]) + 1.0 / 180.0).abs() < 1e-15, "{}", mean([4, 0])); // as known of the rule
    }

    #[test]
    fn the_mass_of_a_rectangle_is_known_and_that_of_any_element_is_the_sum_of_its_parts() {
        let mass = ElementGeometry::new(ELEMENTS[0]).mass_matrix();
        for i in 0..4 {
            for j in 0..4 {
                let want = 256.0 / [9.0, 18.0, 36.0, 18.0][(i + 4 - j) % 4];
                assert!((mass[i][j] - want).abs() < 1e-13 * 256.0, "{i}, {j}: {} for {want}", mass[i][j]);
            }
        }
        // By the midpoint rule on 400 x 400 cells; its error is of the order of their size squared, 6e-6.
        const N: usize = 400;
        for corners in ELEMENTS {
            let element = ElementGeometry::new(corners);
            let mut want = [[0.0; 4]; 4];
            for (i, j) in (0..N).flat_map(|i| (0..N).map(move |j| (i, j))) {
                let [xi, eta] = [i, j].map(|k| (k as f64 + 0.5) / N as f64);
                let (psi, part) = (shape_functions(xi, eta), element.map_at([xi, eta]).determinant / (N * N) as f64);
                (0..4).for_each(|a| (0..4).for_each(|b| want[a][b] += part * psi[a] * psi[b]));
            }
            let (mass, area) = (element.mass_matrix(), element.area());
            let total: f64 = mass.as_flattened().iter().sum();
            assert!((total - area).abs() < 1e-14 * area * 16.0, "{corners:?}: {total} for {area}");
            for a in 0..4 {
                for b in 0..4 {
                    let off = (mass[a][b] - want[a][b]).abs();
                    assert!(off < 1e-5 * area, "{corners:?}, {a}, {b}: {} for {}", mass[a][b], want[a][b]);
                }
            }
        }
        // A triangle's two shape functions of one node, added: a sixth of the area on the diagonal, else a twelfth.
        let triangle = ElementGeometry::new(ELEMENTS[3]);
        let (mass, area) = (triangle.mass_matrix(), triangle.area());
        let third = mass[2][2] + mass[2][3] + mass[3][2] + mass[3][3];
        for (found, want) in [(third, 6.0), (mass[0][0], 6.0), (mass[0][1], 12.0), (mass[1][2] + mass[1][3], 12.0)] {
            assert!((found - area / want).abs() < 1e-14 * area, "{found} for {}", area / want);
        }
    }
}
