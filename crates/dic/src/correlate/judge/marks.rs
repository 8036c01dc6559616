//! What is the matter with the elements that are marked, by name (docs/correlation.md, section 2.8.1).

use crate::field::{ElementMark, ModelError};
use crate::imaging::{Image, Levels};
use crate::mesh::{Mesh, shape_functions};
use crate::units::Px;

/// Share of an element's pixels that have become white from which on it counts as saturated.
const WHITE_SHARE: f64 = 0.2;
/// A pixel is white within this share of the range of grey levels.
const WHITE: f32 = 0.995;
/// Correlation coefficient of the reference with the deformed image in the same place from which on an element has not
/// moved, and by which it has to be better there than where the field puts it.
const STILL: f64 = 0.7;
/// Correlation coefficient of the residual with the deformed image in the same place from which on something in the
/// element has not moved.
const PARTLY_STILL: f64 = 0.6;
/// and that of the two images in the one place, at least.
const IN_BOTH: f64 = 0.35;
/// The specimen moves when it moves this far, px: closer, the two are one.
const MOVES_PX: f64 = 1.5;
/// Standard uncertainties that a node beside what does not match may be off by without a mark.
const PULLED_SIGMAS: f64 = 5.0;
/// Points along each side of an element that are looked at.
const POINTS: usize = 12;

pub(crate) struct ImagePair<'a> {
    reference: &'a Image,
    deformed: &'a Image,
    mesh: &'a Mesh<Px>,
    displacement: &'a [[f64; 2]],
    /// From this grey level on a pixel is white.
    white: f32,
}

struct Sample {
    /// Reference, deformed image where the field puts it; the latter in place of the first, and the reverse.
    grey: Vec<[f64; 4]>,
    /// Share of pixels that are white in the deformed image and not in the reference.
    white: f64,
    moves_px: f64,
}

impl<'a> ImagePair<'a> {
    /// Reference, deformed image, and the `displacement` of all nodes: as the field around has it where not measured.
    pub fn new([reference, deformed]: [&'a Image; 2], mesh: &'a Mesh<Px>, displacement: &'a [[f64; 2]]) -> Self {
        let white = WHITE * deformed.range().1.max(deformed.pixels().white().min(255.0));
        Self { reference, deformed, mesh, displacement, white }
    }

    fn sample(&self, element: usize) -> Sample {
        let corners = self.mesh.corners(element);
        let displacement = self.mesh.elements()[element].map(|node| self.displacement[node as usize]);
        let white = self.white;
        let (mut grey, mut n_white, mut moves_px) = (Vec::with_capacity(POINTS * POINTS), 0usize, 0.0f64);
        for k in 0..POINTS * POINTS {
            let along = |k: usize| (k as f64 + 0.5) / POINTS as f64;
            let psi = shape_functions(along(k % POINTS), along(k / POINTS));
            let at = |v: &[[f64; 2]; 4]| [0, 1].map(|c| (0..4).map(|a| psi[a] * v[a][c]).sum::<f64>());
            // Whole pixels of the reference, so that interpolation has no part in it.
            let x = at(&corners).map(f64::round);
            let u = at(&displacement);
            let (Some(f), Some(still)) = (whole(self.reference, x), whole(self.deformed, x)) else { continue };
            let moved = [x[0] + u[0], x[1] + u[1]];
            let (Some(g), Some(before)) = (bilinear(self.deformed, moved), bilinear(self.reference, moved)) else {
                continue;
            };
            n_white += usize::from(g as f32 >= white && (f as f32) < white);
            moves_px = moves_px.max(u[0].hypot(u[1]));
            grey.push([f, g, still, before]);
        }
        let share = n_white as f64 / grey.len().max(1) as f64;
        Sample { grey, white: share, moves_px }
    }

    /// The name of what is the matter with an element: `otherwise` where its pixels say nothing more.
    pub fn name(&self, element: usize, otherwise: ElementMark) -> ElementMark {
        let Sample { grey, white, moves_px } = self.sample(element);
        if grey.len() < POINTS {
            return otherwise;
        }
        if white > WHITE_SHARE {
            return ElementMark::Saturated;
        }
        let of = |pair: fn(&[f64; 4]) -> [f64; 2]| correlation(grey.iter().map(pair));
        let (moved, still) = (of(|[f, g, ..]| [*f, *g]), of(|[f, _, still, _]| [*f, *still]));
        // It shows in the residual where it was, and where it would be had it moved along.
        let was = of(|[f, g, still, _]| [f - g, *still]) > PARTLY_STILL && still > IN_BOTH;
        let would_be = of(|[f, g, _, before]| [g - f, *before]) > PARTLY_STILL && of(|[_, g, _, b]| [*g, *b]) > IN_BOTH;
        let is_still = (still > STILL && still > moved) || was || would_be;
        if moves_px > MOVES_PX && is_still { ElementMark::Still } else { otherwise }
    }

    /// Whether something stays still all over the given elements while the specimen moves.
    pub fn something_is_still(&self, elements: impl Iterator<Item = usize>) -> bool {
        let (mut sums, mut n) = ([0.0; 3], 0usize);
        // Within an element nothing moves further than its corners.
        let moves = |element: &usize| {
            let corners = self.mesh.elements()[*element].map(|node| self.displacement[node as usize]);
            corners.iter().any(|u| u[0].hypot(u[1]) >= MOVES_PX)
        };
        for element in elements.filter(moves) {
            let Sample { grey, moves_px, .. } = self.sample(element);
            if moves_px < MOVES_PX {
                continue;
            }
            let mean = |k: usize| grey.iter().map(|grey| grey[k]).sum::<f64>() / grey.len().max(1) as f64;
            let [f, g, still, before] = [0, 1, 2, 3].map(mean);
            for grey in &grey {
                // What stays is in the residual where it was and, with the other sign, where the material goes.
                let (r, s) = (grey[0] - f - (grey[1] - g), grey[2] - still - (grey[3] - before));
                sums = [sums[0] + r * r, sums[1] + s * s, sums[2] + r * s];
            }
            n += grey.len();
        }
        // Speckles of some 16 px each say one thing.
        let independent = n as f64 / 16.0;
        let coefficient = sums[2] / (sums[0] * sums[1]).sqrt().max(f64::MIN_POSITIVE);
        independent > 50.0 && coefficient > (4.0 / independent.sqrt()).max(0.08)
    }
}

/// Whether an element with this mark shows something that does not match, as a crack may.
pub(crate) fn is_mismatch(mark: ElementMark) -> bool {
    match mark {
        ElementMark::None | ElementMark::NoTexture | ElementMark::LeftImage => false,
        ElementMark::Misfit | ElementMark::Still | ElementMark::Saturated | ElementMark::NoMatch => true,
    }
}

/// Marks the elements beside those that do not match, where less is enough: a displacement not followed, or a node
/// that may be off by more than [`PULLED_SIGMAS`], since what is wrong in an element pulls at the nodes around it.
pub(crate) fn mark_pulled_along(mesh: &Mesh<Px>, marks: &mut [ElementMark], error: &ModelError, sigma: &[[f64; 2]]) {
    let mut beside = vec![false; mesh.n_nodes()];
    for (nodes, &mark) in mesh.elements().iter().zip(marks.iter()) {
        nodes.iter().for_each(|&node| beside[node as usize] |= is_mismatch(mark));
    }
    let is_off = |node: usize| (0..2).any(|c| error.nodes[node][c] > PULLED_SIGMAS * sigma[node][c]);
    let nodes_of = mesh.elements().iter().map(|nodes| nodes.map(|node| node as usize));
    for ((mark, nodes), misfit) in marks.iter_mut().zip(nodes_of).zip(&error.misfit) {
        let is_beside = nodes.iter().any(|&node| beside[node]);
        if *mark == ElementMark::None && is_beside && (*misfit > 0.0 || nodes.iter().any(|&node| is_off(node))) {
            *mark = ElementMark::Misfit;
        }
    }
}

pub(crate) fn correlation(pairs: impl Iterator<Item = [f64; 2]>) -> f64 {
    let (mut s, mut n) = ([0.0; 5], 0.0f64);
    for [a, b] in pairs {
        s = [s[0] + a, s[1] + b, s[2] + a * a, s[3] + b * b, s[4] + a * b];
        n += 1.0;
    }
    let (va, vb) = (s[2] - s[0] * s[0] / n, s[3] - s[1] * s[1] / n);
    let c = s[4] - s[0] * s[1] / n;
    if va > 0.0 && vb > 0.0 { c / (va * vb).sqrt() } else { 0.0 }
}

/// Grey level of a pixel; none outside.
fn whole(image: &Image, [x, y]: [f64; 2]) -> Option<f64> {
    let inside = x >= 0.0 && y >= 0.0 && x < image.width() as f64 && y < image.height() as f64;
    inside.then(|| f64::from(image.grey(x as usize, y as usize)))
}

/// Grey level between pixels; none outside.
pub(crate) fn bilinear(image: &Image, [x, y]: [f64; 2]) -> Option<f64> {
    let inside = x >= 0.0 && y >= 0.0 && x <= (image.width() - 1) as f64 && y <= (image.height() - 1) as f64;
    if !inside {
        return None;
    }
    let ([i, j], [s, t]) = ([x as usize, y as usize], [x.fract(), y.fract()]);
    let [k, l] = [(i + 1).min(image.width() - 1), (j + 1).min(image.height() - 1)];
    let rows = [j * image.width(), l * image.width()];
    fn mean<T: Copy + Into<f64>>(p: &[T], rows: [usize; 2], [i, k]: [usize; 2], [s, t]: [f64; 2]) -> f64 {
        let [above, below] = rows.map(|row| (1.0 - s) * p[row + i].into() + s * p[row + k].into());
        (1.0 - t) * above + t * below
    }
    Some(match image.pixels() {
        Levels::U8(p) => mean(p, rows, [i, k], [s, t]),
        Levels::U16(p) => mean(p, rows, [i, k], [s, t]),
        Levels::F32(p) => mean(p, rows, [i, k], [s, t]),
    })
}
