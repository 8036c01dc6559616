//! The order of the unknowns.

use std::collections::BTreeSet;

/// The free nodes in an order in which coupled ones are close: along x, along y, or by neighbourhood (reverse
/// Cuthill-McKee), whichever gives the narrowest band.
pub(super) fn banded_order(nodes: &[[f64; 2]], corners: &[Vec<u32>], prescribed: &[bool]) -> Vec<u32> {
    let free: Vec<u32> = (0..nodes.len() as u32).filter(|&node| !prescribed[node as usize]).collect();
    // Nodes in line count as equal although their coordinates differ in the last bits.
    let size = corners.first().map_or(1.0, |c| {
        let [a, b] = [nodes[c[0] as usize], nodes[c[1] as usize]];
        (a[0] - b[0]).hypot(a[1] - b[1])
    });
    let along = |axis: usize| {
        let key = |node: u32| (nodes[node as usize][axis] / (1e-6 * size)).round() as i64;
        let mut order = free.clone();
        order.sort_by(|&a, &b| {
            let across = nodes[a as usize][1 - axis].total_cmp(&nodes[b as usize][1 - axis]);
            key(a).cmp(&key(b)).then(across).then(a.cmp(&b))
        });
        order
    };
    let mut neighbours: Vec<BTreeSet<u32>> = vec![BTreeSet::new(); nodes.len()];
    for corners in corners {
        for &a in corners {
            for &b in corners {
                if a != b && !prescribed[a as usize] && !prescribed[b as usize] {
                    neighbours[a as usize].insert(b);
                }
            }
        }
    }
    let band = |order: &[u32]| {
        let mut place = vec![0usize; nodes.len()];
        order.iter().enumerate().for_each(|(k, &node)| place[node as usize] = k);
        let reach = |&node: &u32| {
            let at = place[node as usize];
            neighbours[node as usize].iter().map(|&other| at.abs_diff(place[other as usize])).max().unwrap_or(0)
        };
        order.iter().map(reach).max().unwrap_or(0)
    };
    let orders = [along(0), along(1), by_neighbourhood(&free, &neighbours)];
    orders.into_iter().min_by_key(|order| band(order)).unwrap_or_default()
}

/// Reverse Cuthill-McKee: breadth first from the node of least degree, neighbours by degree, backwards.
fn by_neighbourhood(free: &[u32], neighbours: &[BTreeSet<u32>]) -> Vec<u32> {
    let degree = |node: u32| (neighbours[node as usize].len(), node);
    let mut starts = free.to_vec();
    starts.sort_by_key(|&node| degree(node));
    let (mut order, mut seen) = (Vec::with_capacity(free.len()), vec![false; neighbours.len()]);
    for start in starts {
        if std::mem::replace(&mut seen[start as usize], true) {
            continue;
        }
        let mut next = order.len();
        order.push(start);
        while next < order.len() {
            let mut ring: Vec<u32> = neighbours[order[next] as usize].iter().copied().collect();
            ring.retain(|&node| !std::mem::replace(&mut seen[node as usize], true));
            ring.sort_by_key(|&node| degree(node));
            order.extend(ring);
            next += 1;
        }
    }
    order.reverse();
    order
}
