//! Borders beside which there is nothing to see: dark bands, holes, the edge of a specimen.

use crate::imaging::Image;
use crate::linalg::Pattern;
use crate::mesh::{Mesh, Zone};
use crate::units::Px;
use rayon::prelude::*;
use std::collections::{HashMap, HashSet};

/// A zone that ends at a place without texture and has no guard there.
///
/// Interpolation and gradient mix what lies beyond a border into the pixels beside it: a dark band, which does not
/// move, pulls the nodes there by 0.1 to 0.2 px; leaving out three pixels ([`crate::mesh::Guard`]) helps (THEORY 2).
#[derive(Debug, Clone, PartialEq)]
pub struct BareBorder {
    /// Zone's name.
    pub zone: String,
    /// Length of border beside which there is no texture, px.
    pub length_px: f64,
    /// Middle of the longest piece of it, px.
    pub at: [f64; 2],
    /// Whether it lies inside the zone, where nodes without texture are left out: no guard helps there.
    pub is_within: bool,
}

/// Beyond the border the texture (mean square of differences along it) is less than this share of that
/// within: a tenth in amplitude, and a step in grey level of as much as its own contrast.
const BARE: f64 = 0.15;
/// Within the zone, places as large as those compared may not come this near to it by chance.
const NEARLY_BARE: f64 = 0.25;
/// Rows of pixels looked at beyond the border, px from it: the reach of the interpolation.
const BEYOND: [usize; 2] = [1, 2];
/// Pairs of rows within, and the first of them, px from the border.
const N_WITHIN: usize = 11;
const FIRST_WITHIN: usize = 3;
/// Elements that border on a band at least, side by side.
const LEAST_EDGES: usize = 4;

/// Mean squares of differences along an edge: beyond it, and within in pairs of rows one after the other.
#[derive(Debug, Clone, Copy)]
struct Beside {
    beyond: f64,
    within: [f64; N_WITHIN],
}

/// The zones that border on a place without texture and have no guard there, without the nodes that are not in `keep`.
///
/// Between sparse speckles there is room for a short bare strip. So strips of as many elements are compared as are
/// never bare within the zone: those along the border, and the same moved inwards by up to 24 px.
pub(crate) fn bare_borders(
    reference: &Image,
    (mesh, pattern): (&Mesh<Px>, &Pattern),
    zones: &[Zone],
    keep: &[bool],
) -> Vec<BareBorder> {
    let mut found = Vec::new();
    for (zone, given) in zones.iter().enumerate() {
        let left = outline((mesh, pattern), zone, |nodes| nodes.iter().all(|&node| keep[node as usize]));
        let own: HashSet<[u32; 2]> = outline((mesh, pattern), zone, |_| true).into_iter().collect();
        let is_own = |edge: &[u32; 2]| own.contains(edge);
        for is_within in [false, true] {
            if !is_within && !given.guard.is_none() {
                continue;
            }
            let edges: Vec<[u32; 2]> = left.iter().filter(|edge| is_own(edge) != is_within).copied().collect();
            let ends = |[a, b]: [u32; 2]| [a, b].map(|node| mesh.nodes()[node as usize]);
            let seen: HashMap<[u32; 2], Beside> = edges
                .iter()
                .filter_map(|&edge| Some((edge, look_beside(reference, ends(edge)[0], ends(edge)[1])?)))
                .collect();
            let chains = chains(edges.iter().copied().filter(|edge| seen.contains_key(edge)));
            let length = |edge: [u32; 2]| {
                let [a, b] = ends(edge);
                (b[0] - a[0]).hypot(b[1] - a[1])
            };
            let bare: Vec<[u32; 2]> = bare_edges(&chains, &seen, is_within);
            let Some(longest) = bare.iter().copied().max_by(|&a, &b| length(a).total_cmp(&length(b))) else { continue };
            let length_px = bare.iter().map(|&edge| length(edge)).sum();
            let [a, b] = ends(longest);
            let at = [0, 1].map(|c| 0.5 * (a[c] + b[c]));
            found.push(BareBorder { zone: given.name.clone(), length_px, at, is_within });
        }
    }
    found
}

/// The edges of a zone that belong to one element alone of those for which `counts` holds, inside to their right.
fn outline(
    (mesh, pattern): (&Mesh<Px>, &Pattern),
    zone: usize,
    counts: impl Fn(&[u32; 4]) -> bool + Sync,
) -> Vec<[u32; 2]> {
    let is_shared = |&[a, b]: &[u32; 2], own: usize| {
        pattern.elements_of(a as usize).iter().any(|&(element, _)| {
            let nodes = &mesh.elements()[element as usize];
            element as usize != own && nodes.contains(&b) && counts(nodes)
        })
    };
    let of_element = |element: usize| {
        let nodes = mesh.elements()[element];
        let sides = (0..4).map(|k| [nodes[k], nodes[(k + 1) % 4]]).filter(|[a, b]| a != b);
        sides.filter(|edge| counts(&nodes) && !is_shared(edge, element)).collect::<Vec<_>>()
    };
    mesh.zone_elements(zone).into_par_iter().with_min_len(2048).flat_map_iter(of_element).collect()
}

/// Edges in a row, each beginning where the one before ends.
fn chains(edges: impl Iterator<Item = [u32; 2]>) -> Vec<Vec<[u32; 2]>> {
    let edges: Vec<[u32; 2]> = edges.collect();
    let mut next: HashMap<u32, Vec<[u32; 2]>> = HashMap::new();
    edges.iter().for_each(|&edge| next.entry(edge[0]).or_default().push(edge));
    let led_to: HashSet<u32> = edges.iter().map(|edge| edge[1]).collect();
    let mut chains = Vec::new();
    // From where nothing leads to first; what is left are closed lines.
    let is_begin = |edge: &&[u32; 2]| !led_to.contains(&edge[0]);
    let order: Vec<[u32; 2]> = edges.iter().filter(is_begin).chain(&edges).copied().collect();
    for start in order {
        let mut chain = Vec::new();
        let mut at = start[0];
        while let Some(edge) = next.get_mut(&at).and_then(|edges| (!edges.is_empty()).then(|| edges.remove(0))) {
            chain.push(edge);
            at = edge[1];
        }
        if !chain.is_empty() {
            chains.push(chain);
        }
    }
    chains
}

/// The edges beside which there is no texture; chance is not asked where that `is_known` (nodes were left out for it).
fn bare_edges(chains: &[Vec<[u32; 2]>], seen: &HashMap<[u32; 2], Beside>, is_known: bool) -> Vec<[u32; 2]> {
    let longest = chains.iter().map(Vec::len).max().unwrap_or(0);
    let mut n = LEAST_EDGES;
    while n <= longest {
        let mut bare: Vec<[u32; 2]> = Vec::new();
        let mut by_chance = false;
        for strip in chains.iter().flat_map(|chain| chain.windows(n)) {
            let mean = |get: &dyn Fn(&Beside) -> f64| strip.iter().map(|edge| get(&seen[edge])).sum::<f64>() / n as f64;
            let rows: [f64; N_WITHIN] = std::array::from_fn(|k| mean(&|beside| beside.within[k]));
            let within = rows.iter().sum::<f64>() / N_WITHIN as f64;
            by_chance |= !is_known && rows.iter().any(|row| *row < NEARLY_BARE * within);
            if mean(&|beside| beside.beyond) < BARE * within {
                bare.extend(strip.iter().filter(|edge| !bare.contains(edge)).copied().collect::<Vec<_>>());
            }
        }
        if !by_chance {
            return bare;
        }
        n *= 2;
    }
    Vec::new()
}

/// What is seen along the edge from `a` to `b`, inside to its right (y down); `None` if rows beyond it are outside.
fn look_beside(image: &Image, a: [f64; 2], b: [f64; 2]) -> Option<Beside> {
    let way = [b[0] - a[0], b[1] - a[1]];
    let length = way[0].hypot(way[1]);
    let along = way.map(|w| w / length);
    let outward = [along[1], -along[0]];
    let n = length.floor() as usize;
    if n < 2 {
        return None;
    }
    // Zones are half-open: the last row of pixels within lies half a pixel off the border on every side.
    let grey = |distance: f64, step: usize| {
        let at = |c: usize| a[c] - 0.5 + (step as f64 + 0.5) * along[c] + (distance - 0.5) * outward[c];
        let inside = |v: f64, n: usize| (v > -0.5 && v < n as f64 - 0.5).then(|| v.round() as usize);
        Some(f64::from(image.grey(inside(at(0), image.width())?, inside(at(1), image.height())?)))
    };
    let texture = |distance: f64| {
        let mut sum = 0.0;
        let mut before = grey(distance, 0)?;
        for step in 1..n {
            let now = grey(distance, step)?;
            sum += (now - before).powi(2);
            before = now;
        }
        Some(sum / n as f64)
    };
    let mut beyond = 0.0;
    for row in BEYOND {
        beyond += texture(row as f64)? / BEYOND.len() as f64;
    }
    let mut within = [0.0; N_WITHIN];
    for (k, within) in within.iter_mut().enumerate() {
        let inward = |row: usize| texture(1.0 - (FIRST_WITHIN + 2 * k + row) as f64);
        // Where a narrow zone ends at the border of the image, there is nothing to compare with.
        *within = 0.5 * (inward(0)? + inward(1)?);
    }
    Some(Beside { beyond, within })
}
