//! Nodes of a coarse level that have lost their way, told by those around them.

use crate::correlate::fill_field;
use crate::linalg::Pattern;
use crate::mesh::Mesh;
use crate::units::Px;

/// A node is off by more than this many times what those around it differ from their own neighbours,
const RATIO: f64 = 2.0;
/// with this much, px, for what correlation leaves anywhere.
const FLOOR_PX: f64 = 0.1;

/// The displacement of a level with that of nodes that have lost their way as the field around them would have it.
pub(crate) fn replace_outliers(mesh: &Mesh<Px>, pattern: &Pattern, displacement: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let known = find_outliers(pattern, displacement).into_iter().map(|off| !off).collect();
    fill_field(mesh, displacement, known)
}

/// Which nodes the displacement of their neighbours speaks against, component by component: the median test (Westerweel
/// and Scarano, Experiments in Fluids 39, 2005). What a node may be off the median of its neighbours is told by what
/// these differ from theirs, since at a border all lie on one side of it.
fn find_outliers(pattern: &Pattern, displacement: &[[f64; 2]]) -> Vec<bool> {
    let others =
        |node: usize| pattern.neighbours(node).iter().map(|&other| other as usize).filter(move |&other| other != node);
    let mut is_off = vec![false; displacement.len()];
    let mut values = Vec::new();
    for c in 0..2 {
        let mut median_around = |node: usize, value: &dyn Fn(usize) -> f64| {
            values.clear();
            values.extend(others(node).map(value));
            median(&mut values)
        };
        let differs: Vec<f64> = (0..displacement.len())
            .map(|node| median_around(node, &|other| (displacement[other][c] - displacement[node][c]).abs()))
            .collect();
        for (node, is_off) in is_off.iter_mut().enumerate() {
            let middle = median_around(node, &|other| displacement[other][c]);
            let limit = RATIO * (median_around(node, &|other| differs[other]) + FLOOR_PX);
            // What is no number is off as well.
            *is_off |= (displacement[node][c] - middle).abs().total_cmp(&limit).is_gt();
        }
    }
    is_off
}

/// The median, of an even number of values the mean of the two in the middle; no number of none.
fn median(values: &mut [f64]) -> f64 {
    let n = values.len();
    if n == 0 {
        return f64::NAN;
    }
    let (before, &mut middle, _) = values.select_nth_unstable_by(n / 2, f64::total_cmp);
    let below = before.iter().copied().max_by(f64::total_cmp);
    below.filter(|_| n.is_multiple_of(2)).map_or(middle, |below| 0.5 * (below + middle))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{PixelMesh, Roi, Zone};

    #[test]
    fn a_node_that_has_gone_its_own_way_is_named_and_a_field_that_strains_turns_or_opens_is_not() {
        let zone = Zone::rectangle("zone", Roi { x0: 0.0, y0: 0.0, x1: 96.0, y1: 80.0 });
        let mesh = PixelMesh::on_zones(&[zone], 8, 0.5, [96, 80]).unwrap().mesh;
        let pattern = Pattern::new(mesh.n_nodes(), mesh.elements());
        let named = |field: &dyn Fn([f64; 2]) -> [f64; 2], moved: &[(usize, [f64; 2])]| -> Vec<usize> {
            let mut displacement: Vec<[f64; 2]> = mesh.nodes().iter().map(|&x| field(x)).collect();
            moved.iter().for_each(|&(node, by)| (0..2).for_each(|c| displacement[node][c] += by[c]));
            let off = find_outliers(&pattern, &displacement);
            (0..off.len()).filter(|&node| off[node]).collect()
        };
        let strained = |[x, y]: [f64; 2]| [3.0 + 0.02 * x - 0.05 * y, 0.05 * x - 0.01 * y];
        let opened = |x: [f64; 2]| [0.01 * x[0], if x[1] > 42.0 { 4.0 } else { 0.0 }];
        let bent = |[x, y]: [f64; 2]| [0.0, 0.001 * (x - 48.0).powi(2) + 0.01 * y];
        let pulled = |[x, _]: [f64; 2]| [0.1 * x, 0.0];
        assert!(named(&strained, &[]).is_empty());
        assert!(named(&pulled, &[]).is_empty());
        assert!(named(&opened, &[]).is_empty());
        assert!(named(&bent, &[]).is_empty());
        // A corner, one at a side, and one within; and what is no number.
        let (corner, side, inside) = (0, 6, 13 * 5 + 6);
        let off = [(corner, [1.2, 0.0]), (side, [0.0, -1.5]), (inside, [f64::NAN, 0.0])];
        for field in [&strained as &dyn Fn([f64; 2]) -> [f64; 2], &opened, &bent] {
            assert_eq!(named(field, &off), [corner, side, inside]);
        }
        // They go where the others are.
        let mut displacement: Vec<[f64; 2]> = mesh.nodes().iter().map(|&x| pulled(x)).collect();
        displacement[inside][0] += 3.0;
        let mended = replace_outliers(&mesh, &pattern, &displacement);
        let far = mended.iter().zip(mesh.nodes()).map(|(u, &x)| (u[0] - pulled(x)[0]).abs()).fold(0.0, f64::max);
        assert!(far < 0.05, "{far}");
        assert_eq!(median(&mut [3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&mut [4.0, 1.0, 3.0, 2.0]), 2.5);
    }
}
