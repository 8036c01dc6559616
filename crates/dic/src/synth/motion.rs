//! Displacement fields given by formulas.

use std::f64::consts::TAU;

/// A displacement field `u(X)` in pixels, on reference coordinates: `g(X + u(X)) = f(X)` (THEORY 1).
///
/// A motion may carry several bodies, with dark gaps between; each moves smoothly, also a little beyond itself.
pub trait Motion: Sync {
    /// The displacement of the material point `x`, px.
    fn displacement(&self, x: [f64; 2]) -> [f64; 2];

    /// Its gradient `[[du_x/dx, du_x/dy], [du_y/dx, du_y/dy]]`; that of body 0 unless given.
    fn gradient(&self, x: [f64; 2]) -> [[f64; 2]; 2] {
        self.body_gradient(0, x)
    }

    /// The same kind of motion, `fraction` of the way from rest (0) to `self` (1).
    fn at(&self, fraction: f64) -> Self
    where
        Self: Sized;

    /// How many bodies move separately.
    fn n_bodies(&self) -> usize {
        1
    }

    /// Whether each body moves so smoothly that its inverse may be interpolated; else every point is solved for.
    fn is_smooth(&self) -> bool {
        true
    }

    /// Whether the material point `x` belongs to `body`.
    fn body_holds(&self, body: usize, x: [f64; 2]) -> bool {
        let _ = (body, x);
        true
    }

    /// The displacement of `body`, extended smoothly beyond it.
    fn body_displacement(&self, body: usize, x: [f64; 2]) -> [f64; 2] {
        let _ = body;
        self.displacement(x)
    }

    /// The gradient of [`Motion::body_displacement`]; by central differences unless given.
    fn body_gradient(&self, body: usize, x: [f64; 2]) -> [[f64; 2]; 2] {
        const STEP: f64 = 1e-3;
        let along = |axis: usize| {
            let [mut low, mut high] = [x; 2];
            low[axis] -= STEP;
            high[axis] += STEP;
            let [low, high] = [self.body_displacement(body, low), self.body_displacement(body, high)];
            [(high[0] - low[0]) / (2.0 * STEP), (high[1] - low[1]) / (2.0 * STEP)]
        };
        let [by_x, by_y] = [along(0), along(1)];
        [[by_x[0], by_y[0]], [by_x[1], by_y[1]]]
    }
}

/// The exact displacements of `points` (reference coordinates, px).
///
/// ```
/// # use quadrille_dic as quadrille;
/// use quadrille::synth::{Translation, exact_at};
/// assert_eq!(exact_at(&Translation([0.25, 0.0]), &[[10.0, 20.0]]), [[0.25, 0.0]]);
/// ```
pub fn exact_at<M: Motion + ?Sized>(motion: &M, points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    points.iter().map(|&x| motion.displacement(x)).collect()
}

/// The centre of an image: half-way between its first and last pixel centres.
fn centre_of(width: usize, height: usize) -> [f64; 2] {
    [width, height].map(|n| 0.5 * (n as f64 - 1.0))
}

/// The same displacement everywhere, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Translation(
    /// The displacement.
    pub [f64; 2],
);

impl Motion for Translation {
    fn displacement(&self, _: [f64; 2]) -> [f64; 2] {
        self.0
    }

    fn at(&self, fraction: f64) -> Self {
        Self(self.0.map(|u| fraction * u))
    }

    fn body_gradient(&self, _: usize, _: [f64; 2]) -> [[f64; 2]; 2] {
        [[0.0; 2]; 2]
    }
}

/// A rigid rotation. With y down a positive angle turns x towards y: clockwise on the screen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rotation {
    degrees: f64,
    affine: Affine,
}

impl Rotation {
    /// A rotation about the centre of an image.
    pub fn new(degrees: f64, width: usize, height: usize) -> Self {
        Self::about(centre_of(width, height), degrees)
    }

    /// A rotation about `centre`, px.
    pub fn about(centre: [f64; 2], degrees: f64) -> Self {
        Self { degrees, affine: Affine { gradient: rotation_gradient(degrees), centre } }
    }
}

/// `R - I` of a rotation by `degrees`, without the cancellation of `cos w - 1`.
fn rotation_gradient(degrees: f64) -> [[f64; 2]; 2] {
    let angle = degrees.to_radians();
    let (sin, half) = (angle.sin(), (0.5 * angle).sin());
    let cos_minus_one = -2.0 * half * half;
    [[cos_minus_one, -sin], [sin, cos_minus_one]]
}

impl Motion for Rotation {
    fn displacement(&self, x: [f64; 2]) -> [f64; 2] {
        self.affine.displacement(x)
    }

    fn at(&self, fraction: f64) -> Self {
        Self::about(self.affine.centre, fraction * self.degrees)
    }

    fn body_gradient(&self, _: usize, _: [f64; 2]) -> [[f64; 2]; 2] {
        self.affine.gradient
    }
}

/// `u = G (X - centre)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Affine {
    /// `[[du_x/dx, du_x/dy], [du_y/dx, du_y/dy]]`.
    pub gradient: [[f64; 2]; 2],
    /// The point at rest, px.
    pub centre: [f64; 2],
}

impl Affine {
    /// An affine motion about the centre of an image.
    pub fn new(gradient: [[f64; 2]; 2], width: usize, height: usize) -> Self {
        Self { gradient, centre: centre_of(width, height) }
    }
}

impl Motion for Affine {
    fn displacement(&self, x: [f64; 2]) -> [f64; 2] {
        let [dx, dy] = [x[0] - self.centre[0], x[1] - self.centre[1]];
        self.gradient.map(|[by_x, by_y]| by_x * dx + by_y * dy)
    }

    fn at(&self, fraction: f64) -> Self {
        Self { gradient: self.gradient.map(|row| row.map(|g| fraction * g)), ..*self }
    }

    fn body_gradient(&self, _: usize, _: [f64; 2]) -> [[f64; 2]; 2] {
        self.gradient
    }
}

/// `u_x = A sin(2 pi x / L)`, `u_y = A sin(2 pi y / L)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sinusoids {
    /// `A`, px.
    pub amplitude: f64,
    /// `L`, px.
    pub wavelength: f64,
}

impl Motion for Sinusoids {
    fn displacement(&self, x: [f64; 2]) -> [f64; 2] {
        x.map(|x| self.amplitude * (TAU * x / self.wavelength).sin())
    }

    fn at(&self, fraction: f64) -> Self {
        Self { amplitude: fraction * self.amplitude, ..*self }
    }

    fn body_gradient(&self, _: usize, x: [f64; 2]) -> [[f64; 2]; 2] {
        let wave_number = TAU / self.wavelength;
        let [xx, yy] = x.map(|x| self.amplitude * wave_number * (wave_number * x).cos());
        [[xx, 0.0], [0.0, yy]]
    }
}

/// The test field of the project: [`Sinusoids`], to which a stretch in x followed by a rotation, both
/// about the image centre, is added: `u = A [sin(2 pi x / L), sin(2 pi y / L)] + (R S - I)(X - centre)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Accuracy {
    sinusoids: Sinusoids,
    stretch: f64,
    degrees: f64,
    affine: Affine,
}

impl Accuracy {
    /// Amplitude 1 px, wavelength 256 px, 0.5 % stretch in x, 0.2 degrees.
    pub fn new(width: usize, height: usize) -> Self {
        let sinusoids = Sinusoids { amplitude: 1.0, wavelength: 256.0 };
        Self::about(centre_of(width, height), sinusoids, 0.005, 0.2)
    }

    /// Other numbers: centre (px), sinusoids, the stretch `S_xx - 1`, and the angle of `R`, degrees, from x towards y.
    pub fn about(centre: [f64; 2], sinusoids: Sinusoids, stretch: f64, degrees: f64) -> Self {
        let [[xx, xy], [yx, yy]] = rotation_gradient(degrees);
        let gradient = [[xx + (1.0 + xx) * stretch, xy], [yx + yx * stretch, yy]];
        Self { sinusoids, stretch, degrees, affine: Affine { gradient, centre } }
    }
}

impl Motion for Accuracy {
    fn displacement(&self, x: [f64; 2]) -> [f64; 2] {
        let [waves, affine] = [self.sinusoids.displacement(x), self.affine.displacement(x)];
        [waves[0] + affine[0], waves[1] + affine[1]]
    }

    fn at(&self, fraction: f64) -> Self {
        let Self { sinusoids, stretch, degrees, affine } = self;
        Self::about(affine.centre, sinusoids.at(fraction), fraction * stretch, fraction * degrees)
    }

    fn body_gradient(&self, body: usize, x: [f64; 2]) -> [[f64; 2]; 2] {
        let [waves, affine] = [self.sinusoids.body_gradient(body, x), self.affine.gradient];
        [0, 1].map(|i| [0, 1].map(|j| waves[i][j] + affine[i][j]))
    }
}

/// The star: `u_x = 0`, `u_y = a cos(2 pi (y - y_c) / p(x))`, the period `p` growing linearly from the
/// left to the right edge of the image. Shows which wavelengths a measurement resolves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Star {
    /// `a`, px.
    pub amplitude: f64,
    /// Periods at the left and at the right edge, px; both positive.
    pub periods: [f64; 2],
    /// Columns of the image.
    pub width: usize,
    /// `y_c`, px.
    pub centre_y: f64,
}

impl Star {
    /// Amplitude 0.5 px, periods from 20 to 200 px.
    pub fn new(width: usize, height: usize) -> Self {
        Self { amplitude: 0.5, periods: [20.0, 200.0], width, centre_y: centre_of(width, height)[1] }
    }

    /// The period at column `x`, and its derivative.
    fn period(&self, x: f64) -> (f64, f64) {
        let slope = (self.periods[1] - self.periods[0]) / (self.width as f64 - 1.0).max(1.0);
        (self.periods[0] + slope * x, slope)
    }
}

impl Motion for Star {
    fn displacement(&self, x: [f64; 2]) -> [f64; 2] {
        let (period, _) = self.period(x[0]);
        [0.0, self.amplitude * (TAU * (x[1] - self.centre_y) / period).cos()]
    }

    fn at(&self, fraction: f64) -> Self {
        Self { amplitude: fraction * self.amplitude, ..*self }
    }

    fn body_gradient(&self, _: usize, x: [f64; 2]) -> [[f64; 2]; 2] {
        let (period, slope) = self.period(x[0]);
        let phase = TAU * (x[1] - self.centre_y) / period;
        let by_phase = -self.amplitude * phase.sin();
        [[0.0, 0.0], [-by_phase * phase * slope / period, by_phase * TAU / period]]
    }
}
