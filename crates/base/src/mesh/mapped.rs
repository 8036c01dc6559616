//! Elements along the sides of a quadrilateral.

use super::q4::turn;
use super::{MeshError, ZoneElements};
use crate::plane::{Point, distance};

impl ZoneElements {
    /// Elements of about `size` px on the convex quadrilateral with these corners: as many as fit best between corners
    /// 0 and 1, by as many as fit best between corners 1 and 2 and between 3 and 0 in the mean, at least one. Nodes
    /// lie on straight lines from side to side, where the bilinear map of a square has them; they are numbered from
    /// corner 0, first towards corner 1.
    ///
    /// ```
    /// # use quadrille_base as quadrille;
    /// use quadrille::mesh::ZoneElements;
    /// let tilted = [[20.0, 0.0], [60.0, 30.0], [48.0, 46.0], [8.0, 16.0]]; // 50 x 20
    /// let mapped = ZoneElements::mapped("strip", tilted, 10.0).unwrap();
    /// assert_eq!((mapped.elements.len(), mapped.nodes[1]), (10, [28.0, 6.0]));
    /// ```
    ///
    /// # Errors
    /// Corners that are no positions ([`MeshError::NotFinite`]) or go around no convex quadrilateral
    /// ([`MeshError::NotConvex`]).
    pub fn mapped(name: impl Into<String>, corners: [Point; 4], size: f64) -> Result<Self, MeshError> {
        let name = name.into();
        if let Some(corner) = corners.iter().position(|p| !p.iter().all(|v| v.is_finite())) {
            return Err(MeshError::NotFinite { zone: name, corner });
        }
        let turns: [f64; 4] = std::array::from_fn(|k| turn(&corners, k));
        if !(turns.iter().all(|t| *t > 0.0) || turns.iter().all(|t| *t < 0.0)) {
            return Err(MeshError::NotConvex { zone: name });
        }
        let length = |k: usize| distance(corners[(k + 1) % 4], corners[k]);
        // Two faces of the same length but for rounding must be cut alike, also where half an element is left.
        let count = |length: f64| ((length / size - 1e-6).round() as usize).clamp(1, 1 << 15);
        let (columns, rows) = (count(length(0)), count(0.5 * (length(1) + length(3))));
        let between = |a: Point, b: Point, t: f64| [0, 1].map(|c| (1.0 - t) * a[c] + t * b[c]);
        let mut nodes = Vec::with_capacity((columns + 1) * (rows + 1));
        for j in 0..=rows {
            let t = j as f64 / rows as f64;
            let ends = [between(corners[0], corners[3], t), between(corners[1], corners[2], t)];
            nodes.extend((0..=columns).map(|i| between(ends[0], ends[1], i as f64 / columns as f64)));
        }
        let per_row = columns as u32 + 1;
        let first = (0..rows as u32).flat_map(|j| (0..per_row - 1).map(move |i| j * per_row + i));
        let elements = first.map(|a| [a, a + 1, a + 1 + per_row, a + per_row]).collect();
        Ok(Self { name, nodes, elements })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Mesh;
    use crate::units::Px;

    #[test]
    fn a_rectangle_turned_anywhere_carries_squares_with_nodes_on_all_its_sides() {
        for degrees in [0.0, 27.0, 90.0, 200.0f64] {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let at = |[x, y]: Point| [300.0 + cos * x - sin * y, 300.0 + sin * x + cos * y];
            let corners = [[0.0, 0.0], [96.0, 0.0], [96.0, 40.0], [0.0, 40.0]].map(at);
            // 40 px hold two and a half elements; half an element is rounded down, here as on any side of this length.
            let mapped = ZoneElements::mapped("a", corners, 16.0).unwrap();
            let mesh: Mesh<Px> = Mesh::from_zones(vec![mapped]).unwrap();
            assert_eq!((mesh.n_elements(), mesh.n_nodes()), (6 * 2, 7 * 3), "{degrees}");
            for (k, node) in mesh.nodes().iter().enumerate() {
                let want = at([16.0 * (k % 7) as f64, 20.0 * (k / 7) as f64]);
                // Positions near 400: a few of their roundings.
                assert!((node[0] - want[0]).hypot(node[1] - want[1]) < 1e-12 * 400.0, "{degrees}: {node:?} {want:?}");
            }
        }
    }

    #[test]
    fn corners_around_no_convex_quadrilateral_are_refused() {
        let mapped = |corners| ZoneElements::mapped("a", corners, 16.0).unwrap_err();
        let dart = [[0.0, 0.0], [90.0, 0.0], [20.0, 20.0], [0.0, 90.0]];
        assert!(matches!(mapped(dart), MeshError::NotConvex { .. }));
        let crossed = [[0.0, 0.0], [90.0, 0.0], [0.0, 90.0], [90.0, 90.0]];
        assert!(matches!(mapped(crossed), MeshError::NotConvex { .. }));
        let nowhere = [[0.0, 0.0], [90.0, 0.0], [f64::NAN, 90.0], [0.0, 90.0]];
        assert!(matches!(mapped(nowhere), MeshError::NotFinite { corner: 2, .. }));
    }
}
