//! Where a zone is when it is far from where it was: motions that points which look alike agree on, shifted or turned.

use crate::correlate::{Features, Match, Motion, Pair, draws, fit};
use crate::mesh::PixelSet;

/// Pairs of points drawn for a motion.
const TRIALS: usize = 2000;
/// Motions of one zone, the one of most points first.
const MOTIONS: usize = 3;
/// A pair agrees with a motion that puts it this close, px of the scale it was found on,
const AGREEMENT: f64 = 2.5;
/// and when it is turned as that motion does, radians.
const TURN: f64 = 0.5;
/// Two points tell a motion when they are this far apart, px of their scale.
const APART: f64 = 16.0;
/// and the motion stretches by no more than this factor.
const STRETCH: f64 = 1.6;
/// So many pairs must agree: of pairs that mean nothing, hardly two do.
const LEAST: usize = 6;
/// Pairs up to so many times the agreement beside the motion are of the same piece, which may be bent.
const BENT: f64 = 6.0;

/// `x -> a x + b` of the plane as complex numbers: rotation, stretch and shift.
#[derive(Clone, Copy)]
struct Similarity {
    a: [f64; 2],
    b: [f64; 2],
}

impl Similarity {
    fn of(p: &Pair, q: &Pair) -> Option<Self> {
        let (d, e) = ([q.from[0] - p.from[0], q.from[1] - p.from[1]], [q.to[0] - p.to[0], q.to[1] - p.to[1]]);
        let square = d[0] * d[0] + d[1] * d[1];
        if square < (APART * p.px.max(q.px)).powi(2) {
            return None;
        }
        let a = [(e[0] * d[0] + e[1] * d[1]) / square, (e[1] * d[0] - e[0] * d[1]) / square];
        let b = [p.to[0] - a[0] * p.from[0] + a[1] * p.from[1], p.to[1] - a[1] * p.from[0] - a[0] * p.from[1]];
        let stretch = a[0].hypot(a[1]);
        let one = Self { a, b };
        let turned = |p: &Pair| angle_between(p.turn, one.angle()) < TURN;
        ((1.0 / STRETCH..STRETCH).contains(&stretch) && turned(p) && turned(q)).then_some(one)
    }

    fn angle(&self) -> f64 {
        self.a[1].atan2(self.a[0])
    }

    fn at(&self, x: [f64; 2]) -> [f64; 2] {
        let Self { a, b } = self;
        [a[0] * x[0] - a[1] * x[1] + b[0], a[1] * x[0] + a[0] * x[1] + b[1]]
    }

    fn has(&self, pair: &Pair) -> bool {
        let [x, y] = self.at(pair.from);
        (x - pair.to[0]).hypot(y - pair.to[1]) < AGREEMENT * pair.px && angle_between(pair.turn, self.angle()) < TURN
    }
}

/// How far two directions are apart, radians, 0..=pi.
fn angle_between(a: f64, b: f64) -> f64 {
    let d = (a - b).rem_euclid(std::f64::consts::TAU);
    d.min(std::f64::consts::TAU - d)
}

/// The motions of a zone that points of both images agree on, on the level that halves the image `level` times.
pub(crate) fn wide_motions(reference: &Features, deformed: &Features, zone: &PixelSet, level: usize) -> Vec<Motion> {
    let mut pairs = reference.pairs(deformed, zone);
    let mut motions = Vec::new();
    for _ in 0..MOTIONS {
        let Some(found) = find_most_agreed(&pairs) else { break };
        let agreed: Vec<Match> =
            pairs.iter().filter(|pair| found.has(pair)).map(|pair| on_level(pair, level)).collect();
        let Some(affine) = fit(&agreed) else { break };
        // On the level itself, all scales alike: a point that bends away still belongs to this piece.
        let beside = |m: &Match, px: f64| {
            let u = affine.displacement(m.centre);
            (u[0] - m.displacement[0]).hypot(u[1] - m.displacement[1]) < BENT * AGREEMENT * px / level_px(level)
        };
        let on_piece = |pair: &Pair| Some(on_level(pair, level)).filter(|m| beside(m, pair.px));
        let piece: Vec<Match> = pairs.iter().filter_map(on_piece).collect();
        motions.push(Motion::of(affine));
        motions.push(Motion::with_deviations(affine, &piece));
        pairs.retain(|pair| !beside(&on_level(pair, level), pair.px));
    }
    motions
}

/// Pixels of the image along one of a level.
fn level_px(level: usize) -> f64 {
    (1u64 << level) as f64
}

fn on_level(pair: &Pair, level: usize) -> Match {
    let px = level_px(level);
    Match {
        centre: pair.from.map(|x| (x - 0.5 * (px - 1.0)) / px),
        displacement: [0, 1].map(|c| (pair.to[c] - pair.from[c]) / px),
        score: 1.0,
    }
}

/// The motion that the most pairs agree on (random sampling with fixed seeds, Fischler & Bolles 1981).
fn find_most_agreed(pairs: &[Pair]) -> Option<Similarity> {
    if pairs.len() < LEAST {
        return None;
    }
    let mut draw = draws(0x9E37_79B9_7F4A_7C15);
    let mut best: (usize, Option<Similarity>) = (LEAST - 1, None);
    for _ in 0..TRIALS {
        let (p, q) = (&pairs[draw(pairs.len())], &pairs[draw(pairs.len())]);
        let Some(one) = Similarity::of(p, q) else { continue };
        let count = pairs.iter().filter(|pair| one.has(pair)).count();
        if count > best.0 {
            best = (count, Some(one));
        }
    }
    best.1
}
