//! Two strips that open like a peeling joint.

use super::motion::Motion;

/// Two bonded strips, one above and one below a dark band without texture, peeled open from the right.
///
/// Each strip bends like a beam: `u_y = -+ w(x)/2`, `u_x = slide +- (y - y_axis) w'(x)/2`, without shear at first
/// order. The opening `w = theta lambda ln(1 + exp((x - a)/lambda))` is nothing ahead of the crack front `a`, a
/// rotation by `theta` behind it. Over the series the front moves in from beyond the right edge, while `theta` and the
/// sliding grow. Body 0 is the upper strip, which moves up in the image (u_y < 0), body 1 the lower.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peel {
    /// Columns of the image.
    pub width: usize,
    /// Rows of the image.
    pub height: usize,
    /// Thickness of the dark band in the reference image, px.
    pub band_px: f64,
    /// Jump of the normal displacement at the right edge in the last frame, px.
    pub opening_px: f64,
    /// Jump of the tangential displacement (upper minus lower) in the last frame, px.
    pub slide_px: f64,
    /// Place in the history: 0 reference, 1 last frame.
    pub fraction: f64,
}

impl Peel {
    /// A band of 31 px (60 um at 1.93 um per pixel), an opening of 16 px, a sliding of 2 px; last frame.
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, band_px: 31.0, opening_px: 16.0, slide_px: 2.0, fraction: 1.0 }
    }

    /// Row of the upper edge of the band in the reference image: the upper strip is above it, px.
    pub fn upper_edge(&self) -> f64 {
        self.middle() - 0.5 * self.band_px
    }

    /// Row of the lower edge of the band in the reference image: the lower strip is below it, px.
    pub fn lower_edge(&self) -> f64 {
        self.middle() + 0.5 * self.band_px
    }

    /// Column of the crack front, px.
    pub fn front(&self) -> f64 {
        (1.25 - self.fraction) * self.width as f64
    }

    /// The jump of the normal displacement between the strips at column `x`, px; positive: open.
    pub fn opening(&self, x: f64) -> f64 {
        self.theta() * self.lambda() * softplus((x - self.front()) / self.lambda())
    }

    /// A bound of the strain components in the image: curvature times half the height of a strip.
    pub fn largest_strain(&self) -> f64 {
        0.125 * self.theta() / self.lambda() * self.half_strip()
    }

    fn middle(&self) -> f64 {
        0.5 * (self.height as f64 - 1.0)
    }

    fn lambda(&self) -> f64 {
        0.25 * self.width as f64
    }

    /// Angle between the strips far behind the front.
    fn theta(&self) -> f64 {
        // The last front is at a quarter of the width, three lambda before the right edge.
        self.fraction * self.opening_px / (self.lambda() * softplus(3.0))
    }

    /// Half the height of a strip within the image, px.
    fn half_strip(&self) -> f64 {
        0.5 * (0.5 * self.height as f64 - 0.5 * self.band_px).max(0.0)
    }

    /// -1 for the upper strip, +1 for the lower: the sign of its share of the opening (y is down).
    fn side(body: usize) -> f64 {
        if body == 0 { -1.0 } else { 1.0 }
    }

    fn body_of(&self, x: [f64; 2]) -> usize {
        usize::from(x[1] > self.middle())
    }

    /// Distance of `y` from the strip's axis.
    fn off_axis(&self, body: usize, y: f64) -> f64 {
        y - (self.middle() + Self::side(body) * (0.5 * self.band_px + self.half_strip()))
    }
}

/// `ln(1 + e^s)` without overflow.
fn softplus(s: f64) -> f64 {
    s.max(0.0) + (-s.abs()).exp().ln_1p()
}

/// Its derivative `1 / (1 + e^-s)`.
fn logistic(s: f64) -> f64 {
    let e = (-s.abs()).exp();
    if s < 0.0 { e / (1.0 + e) } else { 1.0 / (1.0 + e) }
}

impl Motion for Peel {
    /// In the band, where there is no material to follow: the motion of the nearer strip.
    fn displacement(&self, x: [f64; 2]) -> [f64; 2] {
        self.body_displacement(self.body_of(x), x)
    }

    fn gradient(&self, x: [f64; 2]) -> [[f64; 2]; 2] {
        self.body_gradient(self.body_of(x), x)
    }

    fn at(&self, fraction: f64) -> Self {
        Self { fraction: fraction * self.fraction, ..*self }
    }

    fn n_bodies(&self) -> usize {
        2
    }

    fn body_holds(&self, body: usize, x: [f64; 2]) -> bool {
        if body == 0 { x[1] < self.upper_edge() } else { x[1] > self.lower_edge() }
    }

    fn body_displacement(&self, body: usize, x: [f64; 2]) -> [f64; 2] {
        let side = Self::side(body);
        let slope = self.theta() * logistic((x[0] - self.front()) / self.lambda());
        let slide = -0.5 * side * self.fraction * self.slide_px;
        [slide - 0.5 * side * slope * self.off_axis(body, x[1]), 0.5 * side * self.opening(x[0])]
    }

    fn body_gradient(&self, body: usize, x: [f64; 2]) -> [[f64; 2]; 2] {
        let side = Self::side(body);
        let share = logistic((x[0] - self.front()) / self.lambda());
        let slope = self.theta() * share;
        let curvature = slope * (1.0 - share) / self.lambda();
        [[-0.5 * side * curvature * self.off_axis(body, x[1]), -0.5 * side * slope], [0.5 * side * slope, 0.0]]
    }
}
