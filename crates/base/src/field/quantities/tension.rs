//! Constants of a bar under tension or compression, from its stress and the strains of gauges (THEORY 24).

use super::{Elongation, RegionValues, Value};
use crate::field::StrainDefinition;

/// Rounds of the straight line whose weights follow its slope: each is as good as exact after some five.
const ROUNDS: usize = 20;
/// Fewest frames of a line: with two nothing tells whether they lie on one.
const FEWEST: usize = 3;
/// Frames are beyond a range where their strain is by so many standard uncertainties.
const CLEARLY: f64 = 4.0;
/// A line is bent where its parabola is this many standard uncertainties from none and changes the slope by
const BENT: f64 = 4.0;
/// this share between the ends of the range.
const BENT_SHARE: f64 = 0.05;

/// Which constants, and from which part of the curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TensionOptions {
    /// Strain of the first and the last frame of modulus and Poisson's ratio. By default that of ISO 527-1.
    pub modulus_range: [f64; 2],
    /// Plastic strain of the proof stress.
    pub proof_strain: f64,
    /// True plastic strain of the first and the last frame of Lankford's ratio, before the largest load.
    pub r_range: [f64; 2],
    /// Standard uncertainty of each stress, MPa: the noise of the load cell.
    pub stress_std_mpa: f64,
    /// Relative standard uncertainty of the area, or of the scale of the load cell.
    pub area_relative_std: f64,
    /// Share of each variance of the strain that is the same in all frames: that of the reference.
    pub common: f64,
}

impl Default for TensionOptions {
    fn default() -> Self {
        let (modulus_range, proof_strain, r_range) = ([0.0005, 0.0025], 0.002, [0.02, 0.2]);
        Self { modulus_range, proof_strain, r_range, stress_std_mpa: 0.0, area_relative_std: 0.01, common: 0.5 }
    }
}

/// What reads a strain, by its place in the list of its kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Gauge {
    /// An extensometer.
    Extensometer(usize),
    /// The mean gradient of a region.
    Region(usize),
}

/// What all extensometers and regions read in a frame.
pub type Readings<'a> = (&'a [Option<Elongation>], &'a [Option<RegionValues>]);

impl Gauge {
    /// The engineering strain of the material along x (0) or y (1); of an extensometer that along itself.
    fn read(self, (lengths, regions): Readings<'_>, definition: StrainDefinition, axis: usize) -> Option<Value> {
        match self {
            Self::Extensometer(k) => lengths.get(k).copied().flatten().map(|read| read.engineering),
            Self::Region(k) => {
                let (strain, sigma) = regions.get(k).copied().flatten()?.mean.strain?;
                let (e, sigma) = (strain.components()[axis], sigma[axis]);
                Some(match definition {
                    StrainDefinition::Infinitesimal => Value { value: e, sigma },
                    StrainDefinition::GreenLagrange => {
                        let stretch = (1.0 + 2.0 * e).sqrt();
                        Value { value: stretch - 1.0, sigma: sigma / stretch }
                    }
                    StrainDefinition::Hencky => Value { value: e.exp_m1(), sigma: sigma * e.exp() },
                })
            }
        }
    }
}

/// Where the strains of a tensile test are read, and what follows from them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TensionGauges {
    /// Along the load.
    pub along: Gauge,
    /// Across it; where there is none, a region along the load has both.
    pub across: Option<Gauge>,
    /// Direction of the load for regions: 0 for x, 1 for y; `None` for that of the larger strain.
    pub axis: Option<usize>,
    /// What is found.
    pub options: TensionOptions,
}

/// Strain along the load and across it.
pub type Strains = (Value, Option<Value>);

impl TensionGauges {
    /// The strains along and across the load, were it along x and were it along y.
    pub fn read(&self, drawn: Readings<'_>, definition: StrainDefinition) -> [Option<Strains>; 2] {
        let both = match self.along {
            Gauge::Region(_) => Some(self.along),
            Gauge::Extensometer(_) => None,
        };
        [0, 1].map(|axis| {
            let along = self.along.read(drawn, definition, axis)?;
            Some((along, self.across.or(both).and_then(|gauge| gauge.read(drawn, definition, 1 - axis))))
        })
    }

    /// Which of both it is: the one that is stated, or that with the larger strain in `frames`.
    pub fn axis_of(&self, frames: &[[Option<Strains>; 2]]) -> usize {
        let largest = |axis: usize| {
            frames.iter().filter_map(|both| both[axis]).fold(0.0_f64, |most, (along, _)| most.max(along.value.abs()))
        };
        self.axis.unwrap_or_else(|| usize::from(largest(1) > largest(0)))
    }
}

/// A frame of the test. Strains are engineering ones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TensionPoint {
    /// Its number.
    pub frame: usize,
    /// Force over the area of the reference, MPa; `None` without a load file.
    pub stress_mpa: Option<f64>,
    /// Strain along the load.
    pub along: Value,
    /// Strain across it, in the plane.
    pub across: Option<Value>,
}

/// A constant with what its uncertainty is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TensionConstant {
    /// The constant.
    pub value: f64,
    /// Standard uncertainty by the noise of images and load cell, and by the scatter about a line.
    pub noise: f64,
    /// By the area.
    pub area: f64,
    /// By the camera.
    pub camera: f64,
    /// The first and the last strain that it is made of.
    pub range: [f64; 2],
    /// How many frames.
    pub n_frames: usize,
    /// Squares of what is left of a line over those expected, 1 where noise is all; `None` where it is no line, or no
    /// noise is known.
    pub squares: Option<f64>,
    /// Relative change of the slope over the range, where the line is clearly bent.
    pub bent: Option<f64>,
}

impl TensionConstant {
    /// Its standard uncertainty.
    pub fn sigma(&self) -> f64 {
        self.noise.hypot(self.area).hypot(self.camera)
    }

    fn of(value: f64, noise: f64, range: [f64; 2], n_frames: usize) -> Self {
        Self { value, noise, area: 0.0, camera: 0.0, range, n_frames, squares: None, bent: None }
    }

    /// The same with what an uncertain area makes of a stress.
    fn by_area(self, relative: f64) -> Self {
        Self { area: relative * self.value.abs(), ..self }
    }
}

/// The constants of a bar; of those that are `None` [`Tension::missing`] says why.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Tension {
    /// Young's modulus (that of the first loading), MPa.
    pub modulus: Option<TensionConstant>,
    /// Strain of the line of the modulus without stress: what a grip or a first load leaves.
    pub zero_strain: f64,
    /// Poisson's ratio.
    pub poisson: Option<TensionConstant>,
    /// Proof stress: where the curve leaves the line by [`TensionOptions::proof_strain`], MPa.
    pub proof: Option<TensionConstant>,
    /// The largest stress, MPa.
    pub strength: Option<TensionConstant>,
    /// Strain at the largest stress.
    pub strain_at_strength: Option<TensionConstant>,
    /// Lankford's ratio, of the plastic strain across over that through the thickness.
    pub lankford: Option<TensionConstant>,
    /// Of each constant that there is not, its name and why.
    pub missing: Vec<(&'static str, String)>,
}

/// A straight line `y = at_zero + slope x` through points that are uncertain in both.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Line {
    slope: f64,
    at_zero: f64,
    /// Variance of the slope, and of `y` at the mean of `x`.
    of_slope: f64,
    of_mean: f64,
    mean: f64,
    squares: Option<f64>,
    bent: Option<f64>,
}

/// A point of a line with the standard uncertainties of both.
#[derive(Debug, Clone, Copy)]
struct Point {
    x: f64,
    y: f64,
    sx: f64,
    sy: f64,
}

impl Line {
    /// The line through `points`: weights by the uncertainty of both coordinates (York 1966, York and others 2004). Where
    /// the points scatter by more than that, or none is known, the scatter is what counts.
    fn through(points: &[Point]) -> Option<Self> {
        let n = points.len() as f64;
        if points.len() < FEWEST {
            return None;
        }
        let known = points.iter().all(|p| p.sx > 0.0 || p.sy > 0.0);
        let variances = |p: &Point| if known { [p.sx * p.sx, p.sy * p.sy] } else { [0.0, 1.0] };
        let mean = |of: &dyn Fn(&Point) -> f64| points.iter().map(of).sum::<f64>() / n;
        let (x0, y0) = (mean(&|p| p.x), mean(&|p| p.y));
        let mut slope = mean(&|p| (p.x - x0) * (p.y - y0)) / mean(&|p| (p.x - x0).powi(2));
        let mut line = None;
        for _ in 0..ROUNDS {
            let weight = |p: &Point| {
                let [vx, vy] = variances(p);
                1.0 / (vy + slope * slope * vx)
            };
            let sum = |of: &dyn Fn(&Point) -> f64| points.iter().map(|p| weight(p) * of(p)).sum::<f64>();
            let total = sum(&|_| 1.0);
            let (x, y) = (sum(&|p| p.x) / total, sum(&|p| p.y) / total);
            // Where the point itself probably lies, from the mean.
            let adjusted = |p: &Point| {
                let [vx, vy] = variances(p);
                weight(p) * ((p.x - x) * vy + slope * (p.y - y) * vx)
            };
            let next = sum(&|p| adjusted(p) * (p.y - y)) / sum(&|p| adjusted(p) * (p.x - x));
            if !next.is_finite() {
                return None;
            }
            let middle = sum(&|p| adjusted(p)) / total;
            let left = sum(&|p| (p.y - y - next * (p.x - x)).powi(2)) / (n - 2.0);
            let factor = if known { left.max(1.0) } else { left };
            line = Some(Self {
                slope: next,
                at_zero: y - next * x,
                of_slope: factor / sum(&|p| (adjusted(p) - middle).powi(2)),
                of_mean: factor / total,
                mean: x + middle,
                squares: known.then_some(left),
                bent: None,
            });
            let settled = (next - slope).abs() <= 1e-14 * next.abs();
            slope = next;
            if settled {
                break;
            }
        }
        line.map(|line: Self| Self { bent: line.bend(points, known), ..line })
    }

    /// Relative change of the slope over the points by the parabola that fits them, where it clearly is one.
    fn bend(&self, points: &[Point], known: bool) -> Option<f64> {
        let n = points.len() as f64;
        if points.len() < FEWEST + 2 {
            return None;
        }
        let weight = |p: &Point| match known {
            true => 1.0 / (p.sy * p.sy + (self.slope * p.sx).powi(2)),
            false => 1.0,
        };
        let sum = |of: &dyn Fn(f64, f64) -> f64| points.iter().map(|p| weight(p) * of(p.x - self.mean, p.y)).sum();
        let total: f64 = sum(&|_, _| 1.0);
        let (m1, m2, m3): (f64, f64, f64) =
            (sum(&|x, _| x) / total, sum(&|x, _| x * x) / total, sum(&|x, _| x * x * x) / total);
        // The square without what a line has of it.
        let tilt = (m3 - m1 * m2) / (m2 - m1 * m1);
        let square = |x: f64| x * x - m2 - tilt * (x - m1);
        let norm: f64 = sum(&|x, _| square(x).powi(2));
        let c = sum(&|x, y| square(x) * y) / norm;
        let line = |x: f64| self.at_zero + self.slope * (x + self.mean);
        let left: f64 = sum(&|x, y| (y - line(x) - c * square(x)).powi(2));
        let factor = left / (n - 3.0);
        let variance = if known { factor.max(1.0) } else { factor } / norm;
        let [least, most] = ends(points.iter().map(|p| p.x));
        let change = 2.0 * c * (most - least) / self.slope;
        (c * c > BENT * BENT * variance && change.abs() > BENT_SHARE).then_some(change)
    }

    /// Variance of `y` at `x`.
    fn variance(&self, x: f64) -> f64 {
        self.of_mean + (x - self.mean).powi(2) * self.of_slope
    }
}

fn ends(values: impl Iterator<Item = f64>) -> [f64; 2] {
    values.fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], v| [least.min(v), most.max(v)])
}

/// A frame whose stress is known.
#[derive(Debug, Clone, Copy)]
struct Loaded {
    stress: f64,
    along: Value,
}

impl Tension {
    /// The constants of the frames `points`, in their order; those without a stress give Poisson's ratio alone.
    /// Under compression stresses and strains are negative: both are turned, and so are ranges.
    pub fn of(points: &[TensionPoint], options: &TensionOptions) -> Self {
        let pulls = points.iter().map(|p| p.along.value).max_by(|a, b| a.abs().total_cmp(&b.abs()));
        let sign = if pulls.is_some_and(|largest| largest < 0.0) { -1.0 } else { 1.0 };
        let turned = |value: Value| Value { value: sign * value.value, ..value };
        let own = (1.0 - options.common).max(0.0).sqrt();
        let point = |p: &TensionPoint| TensionPoint {
            stress_mpa: p.stress_mpa.map(|stress| sign * stress),
            along: turned(p.along),
            across: p.across.map(turned),
            ..*p
        };
        let points: Vec<TensionPoint> = points.iter().map(point).collect();
        let mut tension = Self::default();
        let first = &first_loading(&points, options.modulus_range, own);
        tension.add_poisson(first, own);
        let loaded: Vec<Loaded> =
            (points.iter()).filter_map(|p| Some(Loaded { stress: p.stress_mpa?, along: p.along })).collect();
        if loaded.is_empty() {
            let lacks = |name| (name, "no force is known: give a load file and the area".to_owned());
            tension.missing.extend(["E", "Rp", "Rm"].map(lacks));
        } else {
            let line = tension.add_modulus(first, options, own);
            tension.add_strength(&loaded, options, own);
            tension.add_proof(&loaded, line.as_ref(), options, own);
        }
        tension.add_lankford(&points, options, own);
        let stresses = [&mut tension.proof, &mut tension.strength, &mut tension.strain_at_strength];
        for constant in stresses.into_iter().flatten() {
            constant.value *= sign;
            constant.range = constant.range.map(|strain| sign * strain);
        }
        for constant in [&mut tension.modulus, &mut tension.poisson, &mut tension.lankford].into_iter().flatten() {
            constant.range = constant.range.map(|strain| sign * strain);
        }
        tension.zero_strain *= sign;
        tension
    }

    /// The constants with their names in files.
    pub fn constants(&self) -> [(&'static str, Option<TensionConstant>); 6] {
        [
            ("E_MPa", self.modulus),
            ("nu", self.poisson),
            ("Rp_MPa", self.proof),
            ("Rm_MPa", self.strength),
            ("strain_at_Rm", self.strain_at_strength),
            ("r", self.lankford),
        ]
    }

    /// Adds what the constants of the same frames under another camera differ by.
    pub fn add_camera(&mut self, changed: &Self) {
        let other = changed.constants().map(|(_, constant)| constant);
        let own = [
            &mut self.modulus,
            &mut self.poisson,
            &mut self.proof,
            &mut self.strength,
            &mut self.strain_at_strength,
            &mut self.lankford,
        ];
        for (own, other) in own.into_iter().zip(other) {
            if let (Some(own), Some(other)) = (own, other) {
                own.camera = own.camera.hypot(own.value - other.value);
            }
        }
    }

    fn add_modulus(&mut self, first: &[TensionPoint], options: &TensionOptions, own: f64) -> Option<Line> {
        let known = first.iter().filter_map(|p| Some((p.stress_mpa?, p.along)));
        let of = |(x, y): (f64, Value)| Point { x, y: y.value, sx: options.stress_std_mpa, sy: own * y.sigma };
        let points: Vec<Point> = known.map(of).collect();
        let line = Line::through(&points).filter(|line| line.slope > 0.0);
        let Some(line) = line else {
            self.missing.push(("E", few(points.len(), options.modulus_range)));
            return None;
        };
        let (modulus, range) = (1.0 / line.slope, ends(points.iter().map(|p| p.y)));
        let noise = modulus * modulus * line.of_slope.sqrt();
        let constant = TensionConstant::of(modulus, noise, range, points.len()).by_area(options.area_relative_std);
        // The slope of the strain: that of the stress changes the other way.
        let bent = line.bent.map(|change| -change);
        self.modulus = Some(TensionConstant { squares: line.squares, bent, ..constant });
        self.zero_strain = line.at_zero;
        Some(line)
    }

    fn add_poisson(&mut self, first: &[TensionPoint], own: f64) {
        let both = first.iter().filter_map(|p| Some((p.along, p.across?)));
        let of = |(x, y): (Value, Value)| Point { x: x.value, y: y.value, sx: own * x.sigma, sy: own * y.sigma };
        let points: Vec<Point> = both.map(of).collect();
        match Line::through(&points) {
            Some(line) => {
                let range = ends(points.iter().map(|p| p.x));
                let constant = TensionConstant::of(-line.slope, line.of_slope.sqrt(), range, points.len());
                self.poisson = Some(TensionConstant { squares: line.squares, bent: line.bent, ..constant });
            }
            None if first.iter().any(|p| p.across.is_some()) => {
                self.missing.push(("nu", "too few frames lie in the range of the modulus".to_owned()));
            }
            None => self
                .missing
                .push(("nu", "no strain across the load is known: name a region or a second gauge".to_owned())),
        }
    }

    fn add_strength(&mut self, loaded: &[Loaded], options: &TensionOptions, own: f64) {
        let Some(top) = loaded.iter().max_by(|a, b| a.stress.total_cmp(&b.stress)) else { return };
        let at = [top.along.value; 2];
        let strength = TensionConstant::of(top.stress, options.stress_std_mpa, at, 1);
        self.strength = Some(strength.by_area(options.area_relative_std));
        self.strain_at_strength = Some(TensionConstant::of(top.along.value, own * top.along.sigma, at, 1));
    }

    fn add_proof(&mut self, loaded: &[Loaded], line: Option<&Line>, options: &TensionOptions, own: f64) {
        let Some(line) = line else {
            self.missing.push(("Rp", "there is no modulus".to_owned()));
            return;
        };
        let beyond = |p: &Loaded| p.along.value - line.at_zero - line.slope * p.stress - options.proof_strain;
        let crossing = loaded.windows(2).position(|pair| beyond(&pair[0]) < 0.0 && beyond(&pair[1]) >= 0.0);
        let Some(k) = crossing else {
            self.missing.push(("Rp", format!("the curve does not leave the line by {}", options.proof_strain)));
            return;
        };
        let (a, b) = (loaded[k], loaded[k + 1]);
        let (fa, fb) = (beyond(&a), beyond(&b));
        let t = -fa / (fb - fa);
        let stress = a.stress + t * (b.stress - a.stress);
        // What an error of the strain there makes of the stress; a stress that stands still is not moved.
        let by_strain = (b.stress - a.stress) / (fb - fa);
        let of_strain = ((1.0 - t) * own * a.along.sigma).powi(2) + (t * own * b.along.sigma).powi(2);
        let noise = by_strain * (of_strain + line.variance(stress)).sqrt();
        // The curve between two frames is no line: what the next frame makes of it.
        let chord = parabola(loaded, k, &beyond).map_or(0.0, |other| other - stress);
        let noise = noise.hypot(chord).hypot(options.stress_std_mpa);
        let range = [a.along.value, b.along.value];
        self.proof = Some(TensionConstant::of(stress, noise, range, 2).by_area(options.area_relative_std));
    }

    fn add_lankford(&mut self, points: &[TensionPoint], options: &TensionOptions, own: f64) {
        let Some(all) = points.iter().map(|p| p.across).collect::<Option<Vec<Value>>>().filter(|all| !all.is_empty())
        else {
            return;
        };
        let elastic = self.modulus.map_or(0.0, |modulus| 1.0 / modulus.value);
        let nu = self.poisson.map_or(0.0, |poisson| poisson.value);
        let last = points.iter().enumerate().filter_map(|(k, p)| Some((k, p.stress_mpa?)));
        let last = last.max_by(|a, b| a.1.total_cmp(&b.1)).map_or(points.len(), |(k, _)| k + 1);
        let plastic = |(p, across): (&TensionPoint, &Value)| {
            let true_stress = p.stress_mpa.unwrap_or(0.0) * (1.0 + p.along.value);
            Point {
                x: p.along.value.ln_1p() - self.zero_strain - true_stress * elastic,
                y: across.value.ln_1p() + nu * true_stress * elastic,
                sx: own * p.along.sigma / (1.0 + p.along.value),
                sy: own * across.sigma / (1.0 + across.value),
            }
        };
        let [least, most] = options.r_range;
        if points.iter().all(|p| p.along.value < least) {
            return; // a bar that does not flow has none
        }
        let line: Vec<Point> = (points[..last].iter().zip(&all).map(plastic))
            .take_while(|p| p.x <= most)
            .filter(|p| p.x >= least)
            .collect();
        let Some(found) = Line::through(&line).filter(|line| line.slope > -1.0 && line.slope < 0.0) else {
            let few = format!("{} frames lie between plastic strains of {least} and {most}", line.len());
            self.missing.push(("r", few));
            return;
        };
        let through = 1.0 + found.slope;
        let noise = found.of_slope.sqrt() / (through * through);
        let constant = TensionConstant::of(-found.slope / through, noise, ends(line.iter().map(|p| p.x)), line.len());
        self.lankford = Some(TensionConstant { squares: found.squares, bent: found.bent, ..constant });
    }
}

fn few(n: usize, [least, most]: [f64; 2]) -> String {
    format!("{n} frames lie between strains of {least} and {most}: take more images there, or give modulus_range")
}

/// The frames of the first loading in a range of strain, by what is measured or, where the stress is known, by the line
/// through them: chosen by what is measured alone, noise at both ends would make the line too steep.
fn first_loading(points: &[TensionPoint], [least, most]: [f64; 2], own: f64) -> Vec<TensionPoint> {
    let beyond = |p: &TensionPoint| p.along.value > most + CLEARLY * own * p.along.sigma;
    let end = points.iter().position(beyond).unwrap_or(points.len());
    let largest = (points[..end].iter().enumerate()).max_by(|a, b| a.1.along.value.total_cmp(&b.1.along.value));
    let loading = &points[..largest.map_or(0, |(k, _)| k + 1)];
    let choose = |strain: &dyn Fn(&TensionPoint) -> f64| -> Vec<TensionPoint> {
        let begin = loading.iter().rposition(|p| strain(p) < least).map_or(0, |k| k + 1);
        loading[begin..].iter().filter(|p| strain(p) <= most).copied().collect()
    };
    let mut chosen = choose(&|p| p.along.value);
    for _ in 0..ROUNDS {
        let point = |p: &TensionPoint| Some(Point { x: p.stress_mpa?, y: p.along.value, sx: 0.0, sy: p.along.sigma });
        let line = chosen.iter().map(point).collect::<Option<Vec<_>>>().and_then(|points| Line::through(&points));
        let Some(line) = line.filter(|line| line.slope > 0.0) else { break };
        let next = choose(&|p| p.stress_mpa.map_or(p.along.value, |stress| line.at_zero + line.slope * stress));
        if next == chosen || next.len() < FEWEST {
            break;
        }
        chosen = next;
    }
    chosen
}

/// Where the parabola through the two frames from `k` on and their nearest neighbour crosses zero, as a stress.
fn parabola(loaded: &[Loaded], k: usize, beyond: &dyn Fn(&Loaded) -> f64) -> Option<f64> {
    let third = loaded.get(k + 2).or_else(|| loaded.get(k.checked_sub(1)?))?;
    let [a, b, c] = [&loaded[k], &loaded[k + 1], third].map(|p| (beyond(p), p.stress));
    // The stress as a function of what it is beyond the line (Lagrange), at zero.
    let term = |p: (f64, f64), q: f64, r: f64| p.1 * q * r / ((p.0 - q) * (p.0 - r));
    let at_zero = term(a, b.0, c.0) + term(b, a.0, c.0) + term(c, a.0, b.0);
    let [least, most] = ends([a.1, b.1].into_iter());
    at_zero.is_finite().then(|| at_zero.clamp(least, most))
}

#[cfg(test)]
mod tests {
    use super::*;

    const YOUNG: f64 = 70_000.0;

    /// Ramberg and Osgood: strain of a stress.
    fn strain(stress: f64) -> f64 {
        stress / YOUNG + 0.002 * (stress / 250.0_f64).powi(30)
    }

    /// A normal number from a counter (Box and Muller on a hashed sequence).
    fn normal(seed: u64) -> f64 {
        let hash = |k: u64| {
            let mut z = seed.wrapping_mul(2).wrapping_add(k).wrapping_mul(0x9E37_79B9_7F4A_7C15);
            z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
            ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
        };
        (-2.0 * (1.0 - hash(0)).ln()).sqrt() * (std::f64::consts::TAU * hash(1)).cos()
    }

    /// A bar pulled in `n` steps, the noise of each strain `sigma`, drawn by `seed`.
    fn bar(n: usize, sigma: f64, seed: u64) -> Vec<TensionPoint> {
        let reference = normal(1_000_003 * seed) * sigma / 2.0_f64.sqrt();
        let point = |k: usize| {
            let stress = 265.0 * k as f64 / n as f64;
            let e = strain(stress);
            let noise = |of: u64| normal(7919 * seed + 2 * k as u64 + of + 1) * sigma / 2.0_f64.sqrt() + reference;
            // r = 0.8: true plastic strain across is -0.8/1.8 of that along.
            let plastic = e.ln_1p() - stress * (1.0 + e) / YOUNG;
            let across = (-0.33 * stress * (1.0 + e) / YOUNG - 0.8 / 1.8 * plastic).exp_m1();
            let value = |value: f64| Value { value, sigma };
            TensionPoint {
                frame: k,
                stress_mpa: Some(stress),
                along: value(e + noise(0)),
                across: Some(value(across + noise(1_000_000))),
            }
        };
        (1..=n).map(point).collect()
    }

    #[test]
    fn a_bar_without_noise_has_the_constants_that_it_was_made_of() {
        let tension = Tension::of(&bar(400, 0.0, 0), &TensionOptions::default());
        let value = |of: Option<TensionConstant>| of.expect("found").value;
        // Plastic strain at 0.0025 is 2e-5 of it; the proof stress is that of the definition.
        assert!((value(tension.modulus) / YOUNG - 1.0).abs() < 1e-4, "{tension:?}");
        // Engineering strains of 0.25 % part from true ones by as much.
        assert!((value(tension.poisson) - 0.33).abs() < 2e-3);
        // A chord of 0.7 MPa lies below the curve by some 0.01 MPa.
        assert!((value(tension.proof) - 250.0).abs() < 0.03, "{:?}", tension.proof);
        assert!((value(tension.strength) - 265.0).abs() < 1e-12);
        assert!(tension.modulus.unwrap().bent.is_none());
        let long = TensionOptions { r_range: [0.002, 0.01], ..TensionOptions::default() };
        assert!((value(Tension::of(&bar(400, 0.0, 0), &long).lankford) - 0.8).abs() < 1e-3);
    }

    #[test]
    fn constants_scatter_as_their_standard_uncertainties_say() {
        // The area is the same in all draws.
        let options = TensionOptions { r_range: [0.002, 0.01], area_relative_std: 0.0, ..TensionOptions::default() };
        let draws: Vec<Tension> = (1..=300).map(|seed| Tension::of(&bar(80, 1e-4, seed), &options)).collect();
        let truth = Tension::of(&bar(80, 0.0, 0), &options);
        for (k, (name, exact)) in
            truth.constants().into_iter().enumerate().filter(|(_, (name, _))| !name.contains("Rm"))
        {
            let exact = exact.expect("found").value;
            let errors: Vec<f64> = (draws.iter())
                .map(|tension| tension.constants()[k].1.expect("found"))
                .map(|constant| (constant.value - exact) / constant.sigma())
                .collect();
            let n = errors.len() as f64;
            let (mean, rms) = (errors.iter().sum::<f64>() / n, (errors.iter().map(|z| z * z).sum::<f64>() / n).sqrt());
            // 300 draws: 0.058 of the mean and 0.041 of the scatter are chance; a chord adds to that of the proof stress.
            assert!(mean.abs() < 0.25 && (0.8..1.15).contains(&rms), "{name}: mean {mean}, scatter {rms}");
        }
    }

    #[test]
    fn noise_of_strain_does_not_lower_the_modulus() {
        // A third of the range is noise: a line of stress over strain would be 8 % too flat.
        let found: Vec<f64> = (1..=300)
            .map(|s| Tension::of(&bar(80, 3e-4, s), &TensionOptions::default()).modulus.unwrap().value)
            .collect();
        let mean = found.iter().sum::<f64>() / found.len() as f64;
        assert!((mean / YOUNG - 1.0).abs() < 0.02, "{mean}");
    }

    #[test]
    fn a_range_that_is_bent_is_told_and_one_without_frames_names_itself() {
        let plastic = TensionOptions { modulus_range: [0.0005, 0.012], ..TensionOptions::default() };
        let bent = Tension::of(&bar(80, 2e-5, 1), &plastic).modulus.unwrap().bent.expect("bent");
        assert!(bent < -0.3, "the stress flattens: {bent}");
        let tension = Tension::of(&bar(4, 1e-5, 1), &TensionOptions::default());
        assert!(tension.modulus.is_none());
        assert!(tension.missing.iter().any(|(name, why)| *name == "E" && why.contains("modulus_range")), "{tension:?}");
    }

    #[test]
    fn compression_is_tension_turned_round() {
        let pulled = bar(80, 1e-5, 3);
        let turned = |v: Value| Value { value: -v.value, ..v };
        let pushed: Vec<TensionPoint> = (pulled.iter())
            .map(|p| TensionPoint {
                stress_mpa: p.stress_mpa.map(|s| -s),
                along: turned(p.along),
                across: p.across.map(turned),
                ..*p
            })
            .collect();
        let [pulled, pushed] = [&pulled, &pushed].map(|points| Tension::of(points, &TensionOptions::default()));
        assert_eq!(pulled.modulus.unwrap().value.to_bits(), pushed.modulus.unwrap().value.to_bits());
        assert_eq!(pulled.proof.unwrap().value, -pushed.proof.unwrap().value);
        assert_eq!(pulled.poisson.unwrap().value.to_bits(), pushed.poisson.unwrap().value.to_bits());
    }

    #[test]
    fn without_a_force_poissons_ratio_is_left() {
        let bare: Vec<TensionPoint> =
            (bar(80, 1e-5, 3).into_iter()).map(|p| TensionPoint { stress_mpa: None, ..p }).collect();
        let tension = Tension::of(&bare, &TensionOptions::default());
        assert!((tension.poisson.unwrap().value - 0.33).abs() < 0.01);
        assert!(tension.modulus.is_none() && tension.missing.iter().any(|(_, why)| why.contains("load file")));
    }
}
