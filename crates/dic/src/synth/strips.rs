//! Two strips that move as finite elements say.

use super::motion::Motion;

/// Displacements (px) at the nodes of a grid of square cells, bilinear within each; the outermost go on beyond it.
#[derive(Debug, Clone, PartialEq)]
pub struct GridField {
    origin: [f64; 2],
    step: f64,
    n_cells: [usize; 2],
    displacement: Vec<[f64; 2]>,
}

impl GridField {
    /// A grid with its first node at `origin` (px), nodes every `step` px, `n_cells` along x and y, and a displacement
    /// for each node, row by row with y down. `None` if these are not as many as the nodes, or nothing.
    pub fn new(origin: [f64; 2], step: f64, n_cells: [usize; 2], displacement: Vec<[f64; 2]>) -> Option<Self> {
        let n_nodes = (n_cells[0] + 1).checked_mul(n_cells[1] + 1)?;
        let fits = n_cells.iter().all(|&n| n > 0) && displacement.len() == n_nodes && step.is_finite() && step > 0.0;
        fits.then_some(Self { origin, step, n_cells, displacement })
    }

    /// The smallest and the largest row (px) of the grid.
    pub fn rows(&self) -> [f64; 2] {
        [self.origin[1], self.origin[1] + self.step * self.n_cells[1] as f64]
    }

    /// Displacements of the corners of the cell that holds `x`, by rows, and the place of `x` in it.
    fn cell(&self, x: [f64; 2]) -> ([[f64; 2]; 4], [f64; 2]) {
        let mut first = [0; 2];
        let mut place = [0.0; 2];
        for k in 0..2 {
            let along = (x[k] - self.origin[k]) / self.step;
            // `as` saturates, and takes NaN to 0.
            first[k] = (along.floor().max(0.0) as usize).min(self.n_cells[k] - 1);
            place[k] = along - first[k] as f64;
        }
        let per_row = self.n_cells[0] + 1;
        let at = first[1] * per_row + first[0];
        let u = &self.displacement;
        ([u[at], u[at + 1], u[at + per_row], u[at + per_row + 1]], place)
    }

    /// The displacement of the point `x`, px.
    pub fn at(&self, x: [f64; 2]) -> [f64; 2] {
        let ([a, b, c, d], [s, t]) = self.cell(x);
        [0, 1].map(|k| (1.0 - t) * ((1.0 - s) * a[k] + s * b[k]) + t * ((1.0 - s) * c[k] + s * d[k]))
    }

    /// Its gradient; on an edge that of the cell to the right and below.
    pub fn gradient(&self, x: [f64; 2]) -> [[f64; 2]; 2] {
        let ([a, b, c, d], [s, t]) = self.cell(x);
        [0, 1].map(|k| {
            let by_x = (1.0 - t) * (b[k] - a[k]) + t * (d[k] - c[k]);
            let by_y = (1.0 - s) * (c[k] - a[k]) + s * (d[k] - b[k]);
            [by_x / self.step, by_y / self.step]
        })
    }

    fn scaled(&self, factor: f64) -> Self {
        Self { displacement: self.displacement.iter().map(|u| u.map(|v| factor * v)).collect(), ..self.clone() }
    }
}

/// Two strips with a dark band between them, each of which moves as the nodes of a grid of finite elements: what
/// a computed joint looks like. Body 0 is the upper strip of the image.
#[derive(Debug, Clone, PartialEq)]
pub struct Strips {
    upper: GridField,
    lower: GridField,
}

impl Strips {
    /// The strip above the band, which ends where `upper` does, and the one below, which begins where `lower` does.
    pub fn new(upper: GridField, lower: GridField) -> Self {
        Self { upper, lower }
    }

    fn body(&self, body: usize) -> &GridField {
        if body == 0 { &self.upper } else { &self.lower }
    }

    fn body_of(&self, x: [f64; 2]) -> usize {
        usize::from(x[1] > 0.5 * (self.upper.rows()[1] + self.lower.rows()[0]))
    }
}

impl Motion for Strips {
    /// In the band, where there is no material to follow: the motion of the nearer strip.
    fn displacement(&self, x: [f64; 2]) -> [f64; 2] {
        self.body(self.body_of(x)).at(x)
    }

    fn gradient(&self, x: [f64; 2]) -> [[f64; 2]; 2] {
        self.body(self.body_of(x)).gradient(x)
    }

    fn at(&self, fraction: f64) -> Self {
        Self { upper: self.upper.scaled(fraction), lower: self.lower.scaled(fraction) }
    }

    fn n_bodies(&self) -> usize {
        2
    }

    fn body_holds(&self, body: usize, x: [f64; 2]) -> bool {
        if body == 0 { x[1] < self.upper.rows()[1] } else { x[1] > self.lower.rows()[0] }
    }

    fn body_displacement(&self, body: usize, x: [f64; 2]) -> [f64; 2] {
        self.body(body).at(x)
    }

    fn body_gradient(&self, body: usize, x: [f64; 2]) -> [[f64; 2]; 2] {
        self.body(body).gradient(x)
    }

    fn is_smooth(&self) -> bool {
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::inverse_at;

    fn field(origin: [f64; 2]) -> GridField {
        // Gradients up to 0.03, different in every cell.
        let nodes = (0..5).flat_map(|j| (0..7).map(move |i| [i as f64, j as f64]));
        let u = nodes.map(|[i, j]| [1.3 + 0.2 * (i * j * 0.7).sin(), -2.0 + 0.25 * (i + 2.0 * j).cos()]).collect();
        GridField::new(origin, 8.0, [6, 4], u).unwrap()
    }

    #[test]
    fn a_node_moves_by_its_displacement_and_the_gradient_is_the_difference_quotient() {
        let field = field([10.0, 20.0]);
        assert_eq!(field.at([10.0 + 3.0 * 8.0, 20.0 + 2.0 * 8.0]), field.displacement[2 * 7 + 3]);
        for x in [[12.3, 21.9], [40.1, 50.7], [5.0, 60.0]] {
            let h = 1e-4; // bilinear: only rounding is left, 1e-16 / 1e-4
            let by = |k: usize| {
                let [mut low, mut high] = [x; 2];
                low[k] -= h;
                high[k] += h;
                let [low, high] = [field.at(low), field.at(high)];
                [(high[0] - low[0]) / (2.0 * h), (high[1] - low[1]) / (2.0 * h)]
            };
            let (by_x, by_y) = (by(0), by(1));
            let want = [[by_x[0], by_y[0]], [by_x[1], by_y[1]]];
            for (got, want) in field.gradient(x).as_flattened().iter().zip(want.as_flattened()) {
                assert!((got - want).abs() < 1e-10, "{got} {want} at {x:?}");
            }
        }
    }

    #[test]
    fn every_point_of_the_image_is_led_back_to_the_material_point_that_moved_there() {
        let strips = Strips::new(field([0.0, 0.0]), field([0.0, 40.0]));
        let material: Vec<[f64; 2]> = (0..40).map(|k| [3.0 + 1.1 * k as f64, 0.77 * k as f64]).collect();
        let moved: Vec<[f64; 2]> = material
            .iter()
            .map(|&x| (x, strips.body_displacement(0, x)))
            .map(|(x, u)| [x[0] + u[0], x[1] + u[1]])
            .collect();
        for (want, got) in material.iter().zip(inverse_at(&strips, &moved).unwrap()) {
            let got = got.expect("a point of the upper strip");
            // The inversion goes on until 3e-13 px is left; gradients of 0.03 hardly change that.
            assert!((got[0] - want[0]).abs().max((got[1] - want[1]).abs()) < 1e-11, "{got:?} {want:?}");
        }
        let band = inverse_at(&strips, &[[20.0, 36.0]]).unwrap();
        assert_eq!(band, [None]);
    }
}
