//! The sums of the kernels, evaluated in `f64`, each with a bound on what `f32` arithmetic may change in it: one
//! rounding of half a unit in the last place per operation, and for a sum the longest path of additions times that
//! times the sum of the terms' magnitudes (Higham, Accuracy and Stability of Numerical Algorithms, section 4.2).
//! Nothing is shared with the library but the pixels of the elements.

use super::plain::{basis, basis_slopes};
use quadrille::backend::kept_and_back_share;
use quadrille::field::Brightness;
use quadrille::imaging::{Image, Interpolation};
use quadrille::mesh::{PixelMesh, shape_functions};

/// What one operation may change, relatively.
const HALF: f64 = f32::EPSILON as f64 / 2.0;

/// A number and how far its `f32` counterpart may be from it.
#[derive(Debug, Clone, Copy, Default)]
pub struct Near {
    pub value: f64,
    pub error: f64,
}

impl Near {
    pub fn exact(value: f64) -> Self {
        Self { value, error: 0.0 }
    }

    /// `value` after so many roundings.
    pub fn rounded(value: f64, roundings: f64) -> Self {
        Self { value, error: roundings * HALF * value.abs() }
    }

    /// With so many more roundings.
    pub fn and(self, roundings: f64) -> Self {
        Self { error: self.error + roundings * HALF * self.value.abs(), ..self }
    }

    pub fn plus(self, other: Self) -> Self {
        Self { value: self.value + other.value, error: self.error + other.error }.and(1.0)
    }

    pub fn minus(self, other: Self) -> Self {
        self.plus(Self { value: -other.value, ..other })
    }

    pub fn times(self, other: Self) -> Self {
        let error = self.error * other.value.abs() + other.error * self.value.abs() + self.error * other.error;
        Self { value: self.value * other.value, error }.and(1.0)
    }

    /// A division may be off by 2.5 units in the last place (the WGSL specification). A divisor that may be zero
    /// makes anything possible.
    pub fn over(self, other: Self) -> Self {
        let least = other.value.abs() - other.error;
        if least <= 0.0 {
            return Self { value: 0.0, error: f64::INFINITY };
        }
        let value = self.value / other.value;
        Self { value, error: (self.error + value.abs() * other.error) / least }.and(5.0)
    }

    /// As a division: the specification derives the root from the inverse root.
    pub fn root(self) -> Self {
        let value = self.value.max(0.0).sqrt();
        let (low, high) = ((self.value - self.error).max(0.0).sqrt(), (self.value + self.error).max(0.0).sqrt());
        Self { value, error: (value - low).max(high - value) }.and(6.0)
    }

    /// As the nearest whole number of units; where the error decides which it is, between those that it may be.
    pub fn in_units(self, unit: f64) -> Self {
        let nearest = |value: f64| (value / unit).round_ties_even().clamp(-32_767.0, 32_767.0) * unit;
        let (low, high) = (nearest(self.value - self.error), nearest(self.value + self.error));
        Self { value: 0.5 * (low + high), error: 0.5 * (high - low) }
    }

    /// Whether `found` is where it may be.
    pub fn holds(self, found: f64) -> bool {
        // Below the smallest normal number devices may give zero.
        (found - self.value).abs() <= self.error + f64::from(f32::MIN_POSITIVE)
    }
}

/// A sum of terms.
#[derive(Debug, Clone, Copy, Default)]
pub struct Sum {
    value: f64,
    error: f64,
    magnitude: f64,
}

impl Sum {
    pub fn add(&mut self, term: Near) {
        self.add_as(term, term.value.abs());
    }

    /// Adds a term that is performed as parts of this `magnitude`.
    pub fn add_as(&mut self, term: Near, magnitude: f64) {
        self.value += term.value;
        self.error += term.error;
        self.magnitude += magnitude + term.error;
    }

    pub fn along(&self, path: f64) -> Near {
        Near { value: self.value, error: self.error + path * HALF * self.magnitude }
    }
}

/// A map of numbers, row by row.
#[derive(Clone)]
struct Map {
    width: usize,
    height: usize,
    values: Vec<Near>,
}

impl Map {
    fn new(width: usize, height: usize, value: impl Fn(usize, usize) -> Near) -> Self {
        let values = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| value(x, y)).collect();
        Self { width, height, values }
    }

    fn at(&self, x: usize, y: usize) -> Near {
        self.values[y * self.width + x]
    }

    /// Grey levels of a pyramid level, less the offset of the series.
    fn grey(image: &Image, offset: f32, level: usize) -> Self {
        let offset = f64::from(offset);
        let mut map =
            Self::new(image.width(), image.height(), |x, y| Near::rounded(f64::from(image.grey(x, y)) - offset, 1.0));
        for _ in 0..level {
            map = Self::new(map.width / 2, map.height / 2, |x, y| {
                let four = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| map.at(2 * x + i, 2 * y + j));
                let mean = |of: fn(&Near) -> f64| four.iter().map(of).sum::<f64>() / 4.0;
                let value = mean(|v| v.value);
                // Two additions and the offset, which may come before or after them.
                let size = mean(|v| v.value.abs()) + offset.abs();
                Near { value, error: mean(|v| v.error) + 3.0 * HALF * size }
            });
        }
        map
    }

    /// Coefficients of the interpolation.
    fn coefficients(&self, interpolation: Interpolation) -> Self {
        let mut map = self.clone();
        for pole in interpolation.poles() {
            for y in 0..map.height {
                let row: Vec<Near> = (0..map.width).map(|x| map.at(x, y)).collect();
                filtered(&row, *pole).into_iter().enumerate().for_each(|(x, v)| map.values[y * map.width + x] = v);
            }
        }
        for pole in interpolation.poles() {
            for x in 0..map.width {
                let column: Vec<Near> = (0..map.height).map(|y| map.at(x, y)).collect();
                filtered(&column, *pole).into_iter().enumerate().for_each(|(y, v)| map.values[y * map.width + x] = v);
            }
        }
        map
    }

    /// The value at a place that may lie in the border, where it is continued through the outermost ones.
    fn beyond(&self, x: isize, y: isize) -> Near {
        let along = |k: isize, n: usize| -> [(usize, f64); 2] {
            let last = n as isize - 1;
            let inner = |beyond: isize| beyond.min(last);
            match k {
                _ if k < 0 => [(0, 2.0), (inner(-k) as usize, -1.0)],
                _ if k > last => [(n - 1, 2.0), ((last - inner(k - last)) as usize, -1.0)],
                _ => [(k as usize, 1.0), (k as usize, 0.0)],
            }
        };
        let mut total = Sum::default();
        for (row, of_row) in along(y, self.height) {
            for (column, of_column) in along(x, self.width) {
                let value = self.at(column, row);
                let share = of_row * of_column;
                total.add(Near { value: share * value.value, error: share.abs() * value.error });
            }
        }
        let inside = (0..self.width as isize).contains(&x) && (0..self.height as isize).contains(&y);
        total.along(if inside { 0.0 } else { 2.0 })
    }
}

/// One pole of the prefilter, on a line that is continued far beyond its ends, `s(-k) = 2 s(0) - s(k)`.
fn filtered(line: &[Near], z: f64) -> Vec<Near> {
    const REACH: usize = 48; // 0.43^48 = 3e-18
    let n = line.len();
    if n == 1 {
        return line.to_vec();
    }
    let last = n as isize - 1;
    let continued = |mut k: isize| {
        let (mut value, mut error, mut sign) = (0.0, 0.0, 1.0);
        while !(0..=last).contains(&k) {
            let (end, through) = if k < 0 { (line[0], 0) } else { (line[n - 1], 2 * last) };
            value += 2.0 * sign * end.value;
            error += 2.0 * end.error;
            sign = -sign;
            k = through - k;
        }
        let inner = line[k as usize];
        Near { value: value + sign * inner.value, error: error + inner.error }
    };
    let largest = line.iter().map(|s| s.value.abs()).fold(0.0, f64::max);
    let gain = (1.0 - z) * (1.0 - 1.0 / z);
    // Two factors that are rounded themselves, and the addition.
    let step = |before: Near, factor: f64, s: Near, gain: f64| {
        let (a, b) = (factor * before.value, gain * s.value);
        let error = factor.abs() * before.error + gain.abs() * s.error + HALF * (2.0 * a.abs() + 2.0 * b.abs());
        Near { value: a + b, error }.and(1.0)
    };
    let mut causal = Vec::with_capacity(n + 2 * REACH);
    let mut v = Near::exact(gain / (1.0 - z) * continued(-(REACH as isize)).value);
    for k in -(REACH as isize)..(n + REACH) as isize {
        v = step(v, z, continued(k), gain);
        if k == 0 {
            // Begun with a sum of 29 terms at most, of weights z^k; a tile on the GPU begins 24 px before its own.
            v.error += HALF * 30.0 * gain / (1.0 - z.abs()) * largest;
        }
        v.error += 16.0 * z.abs().powi(24) * largest;
        causal.push(v);
    }
    let mut filtered = vec![Near::default(); n];
    let mut c = Near::exact(-z / (1.0 - z) * causal.last().expect("not empty").value);
    for (k, v) in causal.iter().enumerate().rev() {
        c = step(c, z, *v, -z);
        if let Some(out) = k.checked_sub(REACH).and_then(|k| filtered.get_mut(k)) {
            *out = Near { error: c.error + 16.0 * z.abs().powi(24) * largest, ..c };
        }
        if k + 1 == REACH + n {
            // Continued through its end the signal keeps its end value: that is where the way back begins.
            c = Near { error: line[n - 1].error + HALF * line[n - 1].value.abs(), ..c };
        }
    }
    filtered
}

/// Weights of the taps from `first` (relative to the floor) on at a fraction `t`, and what `f32` may change in one.
fn weights(interpolation: Interpolation, t: f64) -> (isize, Vec<f64>, f64) {
    match interpolation {
        Interpolation::Cubic => (-1, basis(3, t), 8.0 * HALF),
        Interpolation::Quintic => (-2, basis(5, t), 8.0 * HALF),
        Interpolation::Bilinear => (0, basis(1, t), 2.0 * HALF),
        Interpolation::Keys => {
            // Catmull and Rom's form of it: half of (-t + 2 t^2 - t^3, 2 - 5 t^2 + 3 t^3, ...).
            let at = |a: [f64; 4]| 0.5 * (a[0] + t * (a[1] + t * (a[2] + t * a[3])));
            let weights = [[0.0, -1.0, 2.0, -1.0], [2.0, 0.0, -5.0, 3.0], [0.0, 1.0, 4.0, -3.0], [0.0, 0.0, -1.0, 1.0]];
            (-1, weights.map(at).to_vec(), 20.0 * HALF)
        }
    }
}

/// Weights of value and slope of the reference at a pixel on the coefficients from one before to one after.
fn at_pixel(interpolation: Interpolation) -> [[f64; 3]; 2] {
    match interpolation {
        Interpolation::Cubic => [basis(3, 0.0), basis_slopes(3, 0.0)].map(|w| [w[0], w[1], w[2]]),
        _ => [[0.0, 1.0, 0.0], [-0.5, 0.0, 0.5]],
    }
}

/// What a device is asked to sum.
pub struct Task<'a> {
    pub reference: &'a Image,
    pub deformed: &'a Image,
    pub level: usize,
    /// On the image of that level.
    pub mesh: &'a PixelMesh,
    pub interpolation: Interpolation,
    pub brightness: Brightness,
    pub grey_offset: f32,
    pub gradient_unit: f32,
    /// Elements that are not left out.
    pub active: &'a [bool],
    pub displacement: &'a [[f64; 2]],
    /// Gain and offset per zone.
    pub transfer: &'a [[f64; 2]],
}

/// Sums of the reference in an element.
#[derive(Debug, Clone, Default)]
pub struct Moments {
    /// Products of (fx fx, fx fy, fy fy), weights in eta, weights in xi.
    pub gradient: [[[Near; 3]; 3]; 3],
    /// Of `psi_a fx`, `psi_a fy`, times f and times 1.
    pub coupling: [[Near; 8]; 2],
    pub n: Near,
    pub f: Near,
    pub ff: Near,
}

/// Sums of an element at the displacement.
#[derive(Debug, Clone, Default)]
pub struct Element {
    pub rhs: [Near; 8],
    /// n, f, f^2, g, g^2, f g, r^2 over the pixels counted.
    pub sums: [Near; 7],
    /// All pixels.
    pub n_all: f64,
    /// Left out, because too much of it has left the image; `None` if round-off decides.
    pub out: Option<bool>,
    pub transfer: [Near; 2],
}

/// All of them.
pub struct Evaluation {
    pub moments: Vec<Moments>,
    /// Those over the pixels inside the deformed image.
    pub remaining: Vec<Moments>,
    pub elements: Vec<Element>,
    /// Per zone as of an element, and the number of all pixels.
    pub zones: Vec<([Near; 7], f64)>,
    /// Gain and offset per zone that follow.
    pub transfer: Vec<[Near; 2]>,
    /// Per node.
    pub rhs: Vec<[Near; 2]>,
}

struct Evaluator<'a> {
    task: &'a Task<'a>,
    f: Map,
    gradient: Vec<[Near; 2]>,
    coefficients: Map,
    /// Threads beside each other in an element.
    lanes: usize,
}

/// A pixel of an element and where it lands.
struct Pixel {
    psi: [f64; 4],
    at: usize,
    /// How much it counts.
    weight: Near,
    g: Near,
    xi: f64,
    eta: f64,
}

impl Evaluation {
    pub fn of(task: &Task<'_>) -> Self {
        let f = Map::grey(task.reference, task.grey_offset, task.level);
        // The gradient is that of the cubic spline, whatever spline interpolates the deformed image.
        let of_gradient = match task.interpolation {
            Interpolation::Quintic => Interpolation::Cubic,
            interpolation => interpolation,
        };
        let spline = f.coefficients(of_gradient);
        let [value, slope] = at_pixel(of_gradient);
        let gradient = (0..f.values.len()).map(|at| {
            let (x, y) = ((at % f.width) as isize, (at / f.width) as isize);
            let sum = |wx: &[f64; 3], wy: &[f64; 3]| {
                let mut sum = Sum::default();
                for (j, wy) in wy.iter().enumerate() {
                    for (i, wx) in wx.iter().enumerate().filter(|(_, wx)| **wx * wy != 0.0) {
                        let c = spline.beyond(x + i as isize - 1, y + j as isize - 1);
                        sum.add(Near { value: wx * wy * c.value, error: (wx * wy).abs() * c.error });
                    }
                }
                sum.along(3.0 + 3.0 + 4.0).in_units(f64::from(task.gradient_unit))
            };
            [sum(&slope, &value), sum(&value, &slope)]
        });
        let widest = task.mesh.pixels.elements().iter().map(|e| e.nx).max().unwrap_or(0);
        let lanes = if widest <= 4 {
            4
        } else if widest <= 8 {
            8
        } else {
            16
        };
        let gradient = gradient.collect();
        let coefficients = Map::grey(task.deformed, task.grey_offset, task.level).coefficients(task.interpolation);
        Evaluator { task, f, gradient, coefficients, lanes }.all()
    }
}

impl Evaluator<'_> {
    fn all(&self) -> Evaluation {
        let mesh = &self.task.mesh.mesh;
        let every = 0..mesh.n_elements();
        let moments: Vec<Moments> = every.clone().map(|e| self.moments(e, false)).collect();
        let remaining = every.clone().map(|e| self.moments(e, true)).collect();
        let elements: Vec<Element> = every.map(|e| self.element(e, &moments[e])).collect();
        let mut zones = Vec::new();
        let mut transfer = Vec::new();
        for zone in 0..mesh.zones().len() {
            let of_zone = mesh.zone_elements(zone);
            let n = of_zone.len() as f64;
            // Four elements per thread of a group, its threads, groups per thread of the zone, its threads.
            let path = 4.0 + 64.0 + (n / 256.0 / 64.0).ceil() + 64.0;
            let sums: [Near; 7] = std::array::from_fn(|k| {
                let mut sum = Sum::default();
                of_zone.clone().for_each(|e| match elements[e].out {
                    Some(true) => {}
                    Some(false) => sum.add(elements[e].sums[k]),
                    None => sum.add(Near { value: 0.0, error: f64::INFINITY }),
                });
                sum.along(path)
            });
            transfer.push(match self.task.brightness {
                Brightness::Off => self.task.transfer[zone].map(|v| Near::rounded(v, 1.0)),
                Brightness::Zone | Brightness::Smooth | Brightness::Auto => {
                    fitted(&sums).unwrap_or(self.task.transfer[zone].map(|v| Near::rounded(v, 1.0)))
                }
                Brightness::Element => [0, 1].map(|k| {
                    let mut sum = Sum::default();
                    of_zone.clone().for_each(|e| sum.add(elements[e].transfer[k]));
                    sum.along(path).over(Near::exact(n))
                }),
            });
            zones.push((sums, of_zone.map(|e| elements[e].n_all).sum()));
        }
        let mut rhs = vec![[Sum::default(); 2]; mesh.n_nodes()];
        for (nodes, element) in mesh.elements().iter().zip(&elements) {
            for (k, sum) in element.rhs.iter().enumerate() {
                match element.out {
                    Some(true) => {}
                    Some(false) => rhs[nodes[k / 2] as usize][k % 2].add(*sum),
                    None => rhs[nodes[k / 2] as usize][k % 2].add(Near { value: 0.0, error: f64::INFINITY }),
                }
            }
        }
        // Elements that meet in one node: eight at most here.
        let rhs = rhs.into_iter().map(|both| both.map(|sum| sum.along(8.0))).collect();
        Evaluation { moments, remaining, elements, zones, transfer, rhs }
    }

    /// Additions one after the other in an element, for so many threads beside each other.
    fn path(&self, element: usize, lanes: usize) -> f64 {
        let pixels = &self.task.mesh.pixels;
        let of = &pixels.elements()[element];
        let chunks = |n: usize| n.div_ceil(lanes);
        let rows = if of.n_runs > 0 {
            pixels.runs_of(of).iter().map(|run| chunks(run.n as usize)).sum::<usize>()
        } else {
            of.ny as usize * chunks(of.nx as usize)
        };
        (rows + lanes) as f64
    }

    fn for_each(&self, element: usize, mut visit: impl FnMut(&Pixel)) {
        if !self.task.active[element] {
            return;
        }
        let laid = self.task.mesh;
        let u = laid.mesh.elements()[element].map(|node| self.task.displacement[node as usize]);
        let error = [0, 1].map(|c| {
            let mean = u.iter().map(|u| u[c]).sum::<f64>() / 4.0;
            let largest = u.iter().map(|u| (u[c] - mean.floor()).abs()).fold(1.0, f64::max);
            // To store the rest, to bring the corners together, to go along three edges, xi and eta.
            HALF * 14.0 * largest
        });
        laid.pixels.for_each(&laid.pixels.elements()[element], |x, y, xi, eta| {
            let (x, y, xi, eta) = (x as usize, y as usize, f64::from(xi), f64::from(eta));
            let psi = shape_functions(xi, eta);
            let to = [0, 1].map(|c| [x, y][c] as f64 + (0..4).map(|a| psi[a] * u[a][c]).sum::<f64>());
            let along = [(to[0], error[0], self.f.width), (to[1], error[1], self.f.height)];
            let [along_x, along_y] = along.map(|(at, error, n)| self.weight(at, error, n));
            // Nothing is lost in the product of zeros and ones.
            let whole = along_x.error == 0.0 && along_y.error == 0.0;
            let weight = if whole { Near::exact(along_x.value * along_y.value) } else { along_x.times(along_y) };
            let counts = weight.value > 0.0 || weight.error > 0.0;
            let g = if counts { self.interpolated(to, error) } else { Near::default() };
            visit(&Pixel { psi, at: y * self.f.width + x, weight, g, xi, eta });
        });
    }

    /// How much a place on an axis of `n` pixels counts: it fades out over a quarter of a pixel beyond the ends.
    fn weight(&self, at: f64, error: f64, n: usize) -> Near {
        const EDGE: f64 = 0.25;
        let beyond = (-at).max(at - (n as f64 - 1.0));
        let value = (1.0 - beyond.max(0.0) / EDGE).max(0.0);
        let fades = beyond > -error && beyond < EDGE + error + 4.0 * HALF;
        Near { value, error: if fades { error / EDGE + 8.0 * HALF } else { 0.0 } }
    }

    fn interpolated(&self, to: [f64; 2], error: [f64; 2]) -> Near {
        let floors = to.map(f64::floor);
        let (first, wx, off) = weights(self.task.interpolation, to[0] - floors[0]);
        let (_, wy, _) = weights(self.task.interpolation, to[1] - floors[1]);
        let [x, y] = floors.map(|v| v as isize + first);
        let n = wx.len();
        let taps: Vec<Vec<Near>> = (0..n + 2)
            .map(|j| (0..n + 2).map(|i| self.coefficients.beyond(x + i as isize - 1, y + j as isize - 1)).collect())
            .collect();
        let mut sum = Sum::default();
        for (j, wy) in wy.iter().enumerate() {
            for (i, wx) in wx.iter().enumerate() {
                let c = taps[j + 1][i + 1];
                let of_weights = off * (wx.abs() + wy.abs() + off) * c.value.abs();
                sum.add(Near { value: wx * wy * c.value, error: (wx * wy).abs() * c.error + of_weights });
            }
        }
        // No slope is steeper than the largest step of the coefficients (twice that for Keys, whose weights
        // overshoot).
        let (mut step_x, mut step_y) = (0.0f64, 0.0f64);
        for j in 0..n + 2 {
            for i in 0..n + 2 {
                let c = taps[j][i].value;
                if i > 0 {
                    step_x = step_x.max((c - taps[j][i - 1].value).abs());
                }
                if j > 0 {
                    step_y = step_y.max((c - taps[j - 1][i].value).abs());
                }
            }
        }
        let mut g = sum.along(2.0 * n as f64 + 2.0);
        g.error += 2.0 * (step_x * error[0] + step_y * error[1]);
        g
    }

    fn moments(&self, element: usize, weighted: bool) -> Moments {
        let mut gradient = [[[Sum::default(); 3]; 3]; 3];
        let mut coupling = [[Sum::default(); 8]; 2];
        let mut of_f = [Sum::default(); 3];
        self.for_each(element, |p| {
            let weight = if weighted { p.weight } else { Near::exact(1.0) };
            let (f, [fx, fy]) = (self.f.values[p.at], self.gradient[p.at]);
            // Performed as powers of s, `(1-s)^2 = 1 - 2 s + s^2`, or as what they are.
            let products = |s: f64| {
                [((1.0 - s) * (1.0 - s), (1.0 + s) * (1.0 + s)), (s * (1.0 - s), s * (1.0 + s)), (s * s, s * s)]
            };
            for (sums, product) in gradient.iter_mut().zip([fx.times(fx), fx.times(fy), fy.times(fy)]) {
                let product = product.times(weight);
                for (sums, (eta, eta_size)) in sums.iter_mut().zip(products(p.eta)) {
                    for (sum, (xi, xi_size)) in sums.iter_mut().zip(products(p.xi)) {
                        let share = eta * xi;
                        let term = Near { value: share * product.value, error: eta_size * xi_size * product.error };
                        sum.add_as(term, eta_size * xi_size * product.value.abs());
                    }
                }
            }
            for (k, gradient) in [fx, fy].into_iter().enumerate() {
                for (a, psi) in p.psi.iter().enumerate() {
                    let term = gradient.times(weight).times(Near { value: *psi, error: 4.0 * HALF });
                    coupling[0][2 * a + k].add(term.times(f));
                    coupling[1][2 * a + k].add(term);
                }
            }
            let once = weight.times(f);
            for (sum, term) in of_f.iter_mut().zip([weight, once, once.times(f)]) {
                sum.add(term);
            }
        });
        // The products themselves and the weights.
        let path = self.path(element, 16) + 8.0;
        let [n, f, ff] = of_f.map(|sum| sum.along(path));
        Moments {
            gradient: gradient.map(|q| q.map(|w| w.map(|sum| sum.along(path)))),
            coupling: coupling.map(|all| all.map(|sum| sum.along(path))),
            n: if weighted { n } else { Near::exact(n.value) },
            f,
            ff,
        }
    }

    fn element(&self, element: usize, whole: &Moments) -> Element {
        let zone = self.task.mesh.mesh.element_zone()[element] as usize;
        // Windows of large images add up to eight parts.
        let path = self.path(element, self.lanes) + 8.0;
        let mut of_g = [Sum::default(); 4];
        let mut lost = [Sum::default(); 2];
        let mut counted = true;
        self.for_each(element, |p| {
            let f = self.f.values[p.at];
            let wg = p.weight.times(p.g);
            counted &= p.weight.error == 0.0 && p.weight.value.fract() == 0.0;
            for (sum, term) in of_g.iter_mut().zip([p.weight, wg, wg.times(p.g), wg.times(f)]) {
                sum.add(term);
            }
            let not = Near { value: 1.0 - p.weight.value, error: p.weight.error };
            let once = not.times(f);
            lost[0].add(once);
            lost[1].add(once.times(f));
        });
        let [mut n, g, gg, fg] = of_g.map(|sum| sum.along(path));
        if counted {
            n.error = 0.0; // a sum of whole numbers
        }
        let [f_lost, ff_lost] = lost.map(|sum| sum.along(path));
        let (f, ff) = (whole.f.minus(f_lost), whole.ff.minus(ff_lost));
        let n_all = whole.n.value;
        let [kept, _] = kept_and_back_share(self.task.mesh.mesh.element_size());
        let out = if n.value + n.error < kept * n_all {
            Some(true)
        } else if n.value - n.error >= kept * n_all {
            Some(false)
        } else {
            None
        };
        let mut sums = [n, f, ff, g, gg, fg, Near::default()];
        let given = self.task.transfer[zone].map(|v| Near::rounded(v, 1.0));
        let none = [Near::exact(1.0), Near::exact(0.0)];
        let transfer = match self.task.brightness {
            Brightness::Element if n.value == 0.0 && n.error == 0.0 => none,
            Brightness::Element => fitted_to_g(&sums).unwrap_or([none[0], f.minus(g).over(n)]),
            _ => given,
        };
        let mut rhs = [Sum::default(); 8];
        let mut rr = Sum::default();
        self.for_each(element, |p| {
            let (f, gradient) = (self.f.values[p.at], self.gradient[p.at]);
            let difference = f.minus(transfer[1]).minus(transfer[0].times(p.g));
            let r = p.weight.times(difference);
            rr.add(r.times(difference));
            for k in 0..8 {
                let term = r.times(gradient[k % 2]);
                // Performed as differences of sums of the whole term.
                let psi = p.psi[k / 2];
                rhs[k].add_as(
                    Near { value: psi * term.value, error: 4.0 * psi * term.error + 4.0 * HALF * term.error },
                    4.0 * term.value.abs(),
                );
            }
        });
        sums[6] = rr.along(path);
        Element { rhs: rhs.map(|sum| sum.along(path)), sums, n_all, out, transfer }
    }
}

/// Gain and offset that bring g closest to f, by least squares; `None` where there is no contrast to fit.
fn fitted_to_g(&[n, f, _, g, gg, fg, _]: &[Near; 7]) -> Option<[Near; 2]> {
    let (mean_f, mean_g) = (f.over(n), g.over(n));
    let variance = gg.minus(g.times(mean_g));
    let covariance = fg.minus(f.times(mean_g));
    if [variance, covariance].iter().any(|v| v.value.abs() <= v.error || !v.error.is_finite()) {
        return Some([Near { value: 0.0, error: f64::INFINITY }; 2]);
    }
    let gain = covariance.over(variance);
    (variance.value > 0.0 && covariance.value > 0.0).then(|| [gain, mean_f.minus(gain.times(mean_g))])
}

/// Gain and offset of the line closest to the pairs of f and g in both directions, or that of the contrasts where f and
/// g share less than half of their variance; `None` where there is no contrast to fit.
fn fitted(&[n, f, ff, g, gg, fg, _]: &[Near; 7]) -> Option<[Near; 2]> {
    let (mean_f, mean_g) = (f.over(n), g.over(n));
    let variance = gg.minus(g.times(mean_g));
    let covariance = fg.minus(f.times(mean_g));
    if [variance, covariance].iter().any(|v| v.value.abs() <= v.error || !v.error.is_finite()) {
        return Some([Near { value: 0.0, error: f64::INFINITY }; 2]);
    }
    let variance_f = ff.minus(f.times(mean_f));
    let shared = covariance.over(variance_f).times(covariance.over(variance));
    if (shared.value - 0.5).abs() <= shared.error {
        return Some([Near { value: 0.0, error: f64::INFINITY }; 2]);
    }
    let half = Near::exact(0.5).times(variance_f.minus(variance)).over(covariance);
    let root = half.times(half).plus(Near::exact(1.0)).root();
    // Without cancellation, whichever of the two varies more.
    let gain = match half.value > 0.0 {
        _ if shared.value < 0.5 => variance_f.over(variance).root(),
        true => root.plus(half),
        false => Near::exact(1.0).over(root.minus(half)),
    };
    (variance.value > 0.0 && covariance.value > 0.0).then(|| [gain, mean_f.minus(gain.times(mean_g))])
}

/// Correlation coefficient of the sums.
pub fn correlation(&[n, f, ff, g, gg, fg, _]: &[Near; 7]) -> Near {
    let (mean_f, mean_g) = (f.over(n), g.over(n));
    let variance_f = ff.over(n).minus(mean_f.times(mean_f));
    let variance_g = gg.over(n).minus(mean_g.times(mean_g));
    let covariance = fg.over(n).minus(mean_f.times(mean_g));
    covariance.over(variance_f.times(variance_g).root())
}
