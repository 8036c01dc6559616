//! What stays still beside a specimen that moves: another body, the ground behind it. A mesh that spans both follows
//! neither along the border between them.

use crate::correlate::judge::marks::{bilinear, correlation};
use crate::field::{ElementMark, Measurement};
use crate::imaging::Image;
use crate::mesh::Neighbours;
use crate::units::Px;

/// A node that has moved less than this stays still, px: a camera trembles by some tenths.
const STILL_PX: f64 = 0.5;
/// The specimen moves when nodes of it move this far, px: closer, the two are one.
const MOVES_PX: f64 = 1.5;
/// Elements that make a body, still or moving.
const BODY: usize = 25;
/// What is still ends where most of the elements along its border do not match: a clamped specimen moves on from there.
const PARTED: f64 = 0.7;
/// Rings of elements that do not match, from what is still, in which its border is looked for.
const RINGS: usize = 4;
/// Correlation coefficient with which an element is of one of the two bodies, and by how much more than of the other.
const IS_OF: [f64; 2] = [0.85, 0.2];
/// Points along each side of an element that are looked at.
const POINTS: usize = 12;

/// What stays still in a field.
#[derive(Debug, Clone, PartialEq)]
pub struct StillGround {
    /// Whether each element of the mesh shows what stays still.
    pub still: Vec<bool>,
    /// Whether each element shows both, or neither.
    pub between: Vec<bool>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Shows {
    /// What matches, and has not moved.
    Still,
    /// What matches, and has moved.
    Moving,
    /// What does not match.
    Mismatch,
    /// Nothing.
    Nothing,
}

impl StillGround {
    /// Whether an element shows what stays still.
    pub fn is_still(&self, element: usize) -> bool {
        self.still[element]
    }

    /// Whether it shows what moves alone.
    pub fn is_moving(&self, element: usize) -> bool {
        !self.still[element] && !self.between[element]
    }

    /// What stays still in the `field` of the deformed image while something else moves; `None` without either, and where
    /// the field runs on from one into the other.
    pub fn find(field: &Measurement<Px>, [reference, deformed]: [&Image; 2]) -> Option<Self> {
        let shown = shown_by(field)?;
        let length = |node: usize| field.displacement[node][0].hypot(field.displacement[node][1]);
        let elements = field.mesh.elements();
        let nodes_of = |element: usize| elements[element].map(|node| node as usize);
        let moving: Vec<usize> = (0..elements.len()).filter(|&element| shown[element] == Shows::Moving).collect();
        let far = moving.iter().filter(|&&element| nodes_of(element).into_iter().all(|node| length(node) > MOVES_PX));
        if far.count() < BODY {
            return None;
        }
        let around = Neighbours::of(&field.mesh);
        let mut still = vec![false; elements.len()];
        for body in around.bodies(|element| shown[element] == Shows::Still) {
            let rim = around.ring(&body);
            let count = |what: Shows| rim.iter().filter(|&&element| shown[element] == what).count() as f64;
            let (parted, joined) = (count(Shows::Mismatch), count(Shows::Moving));
            if body.len() >= BODY && parted > 0.0 && parted >= PARTED * (parted + joined) {
                body.into_iter().for_each(|element| still[element] = true);
            }
        }
        if !still.contains(&true) {
            return None;
        }
        let mut between = vec![false; elements.len()];
        let mut reached: Vec<usize> = (0..elements.len()).filter(|&element| still[element]).collect();
        for _ in 0..RINGS {
            let ring = around.ring(&reached);
            let ring: Vec<usize> = ring.into_iter().filter(|&element| shown[element] == Shows::Mismatch).collect();
            ring.iter().for_each(|&element| between[element] = true);
            reached.extend(ring);
        }
        let middle = |element: usize| {
            let corners = field.mesh.corners(element);
            [0, 1].map(|c| 0.25 * corners.iter().map(|corner| corner[c]).sum::<f64>())
        };
        for element in (0..elements.len()).filter(|&element| between[element]).collect::<Vec<_>>() {
            let [x, y] = middle(element);
            let distance = |other: usize| {
                let at = middle(other);
                (at[0] - x).powi(2) + (at[1] - y).powi(2)
            };
            let nearest = moving.iter().min_by(|&&a, &&b| distance(a).total_cmp(&distance(b)));
            let Some(motion) = nearest.map(|&of| field.displacement[nodes_of(of)[0]]) else { continue };
            let matches = |u| coefficient(field, element, [reference, deformed], u);
            let [in_place, moved] = [matches([0.0; 2]), matches(motion)];
            let [least, more] = IS_OF;
            still[element] = in_place > least && in_place > moved + more;
            let is_moving = moved > least && moved > in_place + more;
            between[element] = !still[element] && !is_moving;
        }
        Some(Self { still, between })
    }
}

fn shown_by(field: &Measurement<Px>) -> Option<Vec<Shows>> {
    let marks = field.marks.as_ref()?;
    let is_still = |&node: &u32| {
        let u = field.displacement[node as usize];
        u[0].hypot(u[1]) <= STILL_PX
    };
    let of_element = |(nodes, mark): (&[u32; 4], &ElementMark)| match mark {
        ElementMark::NoTexture | ElementMark::LeftImage | ElementMark::Saturated => Shows::Nothing,
        ElementMark::Misfit | ElementMark::Still | ElementMark::NoMatch => Shows::Mismatch,
        ElementMark::None if nodes.iter().any(|&node| !field.measured[node as usize]) => Shows::Mismatch,
        ElementMark::None if nodes.iter().all(is_still) => Shows::Still,
        ElementMark::None => Shows::Moving,
    };
    Some(field.mesh.elements().iter().zip(marks).map(of_element).collect())
}

/// Correlation coefficient of an element of the reference with the deformed image where the displacement `u` puts it.
fn coefficient(field: &Measurement<Px>, element: usize, [reference, deformed]: [&Image; 2], u: [f64; 2]) -> f64 {
    let corners = field.mesh.corners(element);
    let along = |k: usize, c: usize| {
        let (low, high) = (corners[0][c], corners[2][c]);
        (low + (high - low) * (k as f64 + 0.5) / POINTS as f64).round()
    };
    let pairs = (0..POINTS * POINTS).filter_map(|k| {
        let x = [along(k % POINTS, 0), along(k / POINTS, 1)];
        Some([bilinear(reference, x)?, bilinear(deformed, [x[0] + u[0], x[1] + u[1]])?])
    });
    correlation(pairs)
}
