//! Bodies of one zone that move apart: a specimen before a ground that stays still, grips, two halves. A mesh that spans
//! several of them follows neither along the border between them.

use crate::correlate::affine;
use crate::correlate::judge::marks::{bilinear, correlation};
use crate::field::{ElementMark, Measurement};
use crate::imaging::Image;
use crate::mesh::Neighbours;
use crate::units::Px;

/// A node that has moved less than this stays still, px: a camera trembles by some tenths.
const STILL_PX: f64 = 0.5;
/// Bodies move apart when their motions differ by this much where they meet, px: closer, they are one.
const APART_PX: f64 = 1.5;
/// Elements that make a body.
const BODY: usize = 25;
/// A body ends where most of the elements along its border do not match: a clamped specimen moves on from there.
const PARTED: f64 = 0.7;
/// Rings of elements that do not match, from a body, in which its border is looked for.
const RINGS: usize = 4;
/// Correlation coefficient with which an element is of a body, and by how much more than of any other.
const IS_OF: [f64; 2] = [0.85, 0.2];
/// Points along each side of an element that are looked at.
const POINTS: usize = 12;

/// What a field shows of bodies that may move apart.
#[derive(Debug, Clone, PartialEq)]
pub enum Apart {
    /// One body, or nothing that moves yet.
    One,
    /// Bodies whose borders do not match, and which have not moved apart by enough yet.
    NotYet,
    /// Several.
    Bodies(Bodies),
}

/// Bodies that have moved apart.
#[derive(Debug, Clone, PartialEq)]
pub struct Bodies {
    /// Per element the number of its body, from 0; `None` where it shows two of them, or neither.
    pub of: Vec<Option<usize>>,
    /// How many move.
    pub moving: usize,
    /// Whether another one, the last, stays still.
    pub has_still: bool,
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

impl Bodies {
    /// Whether an element shows body `body`.
    pub fn is_of(&self, element: usize, body: usize) -> bool {
        self.of[element] == Some(body)
    }
}

impl Apart {
    /// The bodies that have moved apart in the `field` of the deformed image.
    pub fn find(field: &Measurement<Px>, images: [&Image; 2]) -> Self {
        let Some(look) = Field::new(field, images) else { return Self::One };
        let Some(still) = look.still() else { return Self::One };
        let moving = look.moving(&still);
        let groups = look.groups(&moving);
        let n_moving = groups.iter().max().map_or(0, |most| most + 1);
        if still.is_empty() && n_moving < 2 {
            return if moving.len() > 1 { Self::NotYet } else { Self::One };
        }
        let mut of = vec![None; look.shown.len()];
        for (body, elements) in groups.iter().zip(&moving) {
            elements.iter().for_each(|&element| of[element] = Some(*body));
        }
        still.iter().for_each(|&element| of[element] = Some(n_moving));
        let has_still = !still.is_empty();
        look.label(&mut of, n_moving + usize::from(has_still));
        Self::Bodies(Bodies { of, moving: n_moving, has_still })
    }
}

struct Field<'a> {
    field: &'a Measurement<Px>,
    images: [&'a Image; 2],
    shown: Vec<Shows>,
    around: Neighbours<'a>,
}

impl<'a> Field<'a> {
    fn new(field: &'a Measurement<Px>, images: [&'a Image; 2]) -> Option<Self> {
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
        let shown = field.mesh.elements().iter().zip(marks).map(of_element).collect();
        Some(Self { field, images, shown, around: Neighbours::of(&field.mesh) })
    }

    /// Whether the border of a body is one: most of it does not match.
    fn is_parted(&self, body: &[usize]) -> bool {
        let ring = self.around.ring(body);
        let count = |is: &dyn Fn(Shows) -> bool| ring.iter().filter(|&&element| is(self.shown[element])).count() as f64;
        let parted = count(&|shows| shows == Shows::Mismatch);
        let joined = count(&|shows| matches!(shows, Shows::Moving | Shows::Still));
        body.len() >= BODY && parted > 0.0 && parted >= PARTED * (parted + joined)
    }

    /// The elements of bodies that stay still; `None` where nothing has moved far enough to tell.
    fn still(&self) -> Option<Vec<usize>> {
        let length = |&node: &u32| {
            let u = self.field.displacement[node as usize];
            u[0].hypot(u[1])
        };
        let is_far = |(nodes, shows): &(&[u32; 4], &Shows)| {
            **shows == Shows::Moving && nodes.iter().all(|node| length(node) > APART_PX)
        };
        if self.field.mesh.elements().iter().zip(&self.shown).filter(is_far).count() < BODY {
            return None;
        }
        let bodies = self.around.bodies(|element| self.shown[element] == Shows::Still);
        Some(bodies.into_iter().filter(|body| self.is_parted(body)).flatten().collect())
    }

    /// The bodies of the rest: what hangs together and has a border; all of it where fewer than two have.
    fn moving(&self, still: &[usize]) -> Vec<Vec<usize>> {
        let mut is_rest: Vec<bool> =
            self.shown.iter().map(|shows| matches!(shows, Shows::Moving | Shows::Still)).collect();
        still.iter().for_each(|&element| is_rest[element] = false);
        let all = self.around.bodies(|element| is_rest[element]);
        let parted: Vec<Vec<usize>> = all.iter().filter(|body| self.is_parted(body)).cloned().collect();
        match parted.len() {
            0 | 1 => vec![all.concat()],
            _ => parted,
        }
    }

    /// Which of the `bodies` move as one: the number of the body that each is part of.
    fn groups(&self, bodies: &[Vec<usize>]) -> Vec<usize> {
        let points: Vec<_> = bodies.iter().map(|body| self.points(body)).collect();
        let motions: Vec<_> = points.iter().map(|points| affine(points)).collect();
        let near: Vec<Vec<Option<usize>>> = bodies.iter().map(|body| self.near(body)).collect();
        let mut groups: Vec<usize> = (0..bodies.len()).collect();
        for (a, b) in (0..bodies.len()).flat_map(|b| (0..b).map(move |a| (a, b))) {
            let is_between = |&element: &usize| near[a][element].is_some() && near[b][element].is_some();
            let mut between: Vec<[f64; 2]> =
                (0..self.shown.len()).filter(is_between).map(|element| self.middle(element)).collect();
            if between.is_empty() {
                between.push(middle(points[a].iter().chain(&points[b]).map(|(x, _)| *x)));
            }
            let apart = |x: &[f64; 2]| {
                let (u, v) = (motions[a](*x), motions[b](*x));
                (u[0] - v[0]).hypot(u[1] - v[1])
            };
            if between.iter().map(apart).sum::<f64>() <= APART_PX * between.len() as f64 {
                let (from, to) = (groups[b].max(groups[a]), groups[b].min(groups[a]));
                groups.iter_mut().filter(|group| **group == from).for_each(|group| *group = to);
            }
        }
        let mut seen: Vec<usize> = groups.clone();
        seen.sort_unstable();
        seen.dedup();
        groups.iter().map(|group| seen.partition_point(|seen| seen < group)).collect()
    }

    /// Gives the elements without a body theirs: near the border of two they are compared with the motion of each, others
    /// are of the nearest.
    fn label(&self, of: &mut [Option<usize>], n_bodies: usize) {
        let seeds = |body: usize| (0..of.len()).filter(|&element| of[element] == Some(body)).collect::<Vec<_>>();
        let near: Vec<Vec<Option<usize>>> = (0..n_bodies).map(|body| self.near(&seeds(body))).collect();
        let mut is_between = vec![false; of.len()];
        for element in (0..of.len()).filter(|&element| of[element].is_none()).collect::<Vec<_>>() {
            let beside = |body: usize| near[body][element].map(|origin| (body, origin));
            let beside: Vec<(usize, usize)> = (0..n_bodies).filter_map(beside).collect();
            if beside.len() < 2 {
                continue;
            }
            let matches = |(body, origin): (usize, usize)| {
                (self.coefficient(element, self.field.displacement[self.nodes(origin)[0]]), body)
            };
            let mut by_match: Vec<(f64, usize)> = beside.into_iter().map(matches).collect();
            by_match.sort_by(|a, b| b.0.total_cmp(&a.0));
            let [least, more] = IS_OF;
            of[element] = match by_match[..] {
                [(best, body), (second, _), ..] if best > least && best > second + more => Some(body),
                _ => None,
            };
            is_between[element] = of[element].is_none();
        }
        // From all that is known, ring by ring.
        let mut front: Vec<usize> = (0..of.len()).filter(|&element| of[element].is_some()).collect();
        let mut at = 0;
        while let Some(&element) = front.get(at) {
            for other in self.around.around(element) {
                if of[other].is_none() && !is_between[other] {
                    of[other] = of[element];
                    front.push(other);
                }
            }
            at += 1;
        }
        // Other zones are what they are.
        of.iter_mut()
            .zip(&is_between)
            .filter(|(of, between)| of.is_none() && !**between)
            .for_each(|(of, _)| *of = Some(0));
    }

    /// For the elements that do not match within some rings from a body, the element of it that they are next to.
    fn near(&self, body: &[usize]) -> Vec<Option<usize>> {
        let mut near = vec![None; self.shown.len()];
        let mut front: Vec<(usize, usize)> = body.iter().map(|&element| (element, element)).collect();
        for _ in 0..RINGS {
            let mut next = Vec::new();
            for (element, origin) in front {
                for other in self.around.around(element) {
                    if self.shown[other] == Shows::Mismatch && near[other].is_none() {
                        near[other] = Some(origin);
                        next.push((other, origin));
                    }
                }
            }
            front = next;
        }
        near
    }

    fn nodes(&self, element: usize) -> [usize; 4] {
        self.field.mesh.elements()[element].map(|node| node as usize)
    }

    fn middle(&self, element: usize) -> [f64; 2] {
        middle(self.field.mesh.corners(element).into_iter())
    }

    /// Where the nodes of a body are and by how much they have moved.
    fn points(&self, body: &[usize]) -> Vec<([f64; 2], [f64; 2])> {
        let nodes = body.iter().flat_map(|&element| self.nodes(element));
        nodes.map(|node| (self.field.mesh.nodes()[node], self.field.displacement[node])).collect()
    }

    /// Correlation coefficient of an element of the reference with the deformed image where the displacement `u` puts it.
    fn coefficient(&self, element: usize, u: [f64; 2]) -> f64 {
        let [reference, deformed] = self.images;
        let corners = self.field.mesh.corners(element);
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
}

/// The mean of places.
fn middle(places: impl Iterator<Item = [f64; 2]>) -> [f64; 2] {
    let (sum, n) = places.fold(([0.0; 2], 0.0), |(sum, n), x| ([sum[0] + x[0], sum[1] + x[1]], n + 1.0));
    sum.map(|sum| sum / f64::max(n, 1.0))
}
