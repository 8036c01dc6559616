//! Whether supports hold a joint: what is refused before anything is computed.

use super::{JointMesh, ModelError, Supports};
use nalgebra::{DMatrix, DVector};

/// Refuses nodes that are not there, nodes that are held or tied twice, blocks that are no bodies, and bodies that
/// could move freely.
pub(super) fn check(supports: &Supports, mesh: &JointMesh, small: bool) -> Result<(), ModelError> {
    let n_nodes = mesh.nodes().len();
    let all = supports.nodes.iter().chain(supports.blocks.iter().flat_map(|block| &block.nodes));
    if let Some(&node) = all.clone().find(|&&node| node as usize >= n_nodes) {
        return Err(ModelError::PrescribedNode { node, n_nodes });
    }
    let mut taken = vec![[false; 2]; n_nodes];
    supports.nodes.iter().zip(&supports.held).for_each(|(&node, held)| taken[node as usize] = *held);
    for block in &supports.blocks {
        if !block.tied.contains(&true) || block.nodes.is_empty() || block.radius(mesh.nodes()) == 0.0 {
            return Err(ModelError::Supports(format!(
                "the rigid block \"{}\" needs two nodes that its rotation moves against each other; tied along y alone they must \
                 differ in x",
                block.name
            )));
        }
        if !small && block.tied != [true; 2] {
            return Err(ModelError::LeverTurns { block: block.name.clone() });
        }
        for &node in &block.nodes {
            for c in (0..2).filter(|&c| block.tied[c]) {
                if std::mem::replace(&mut taken[node as usize][c], true) {
                    return Err(ModelError::Supports(format!(
                        "node {node} of the rigid block \"{}\" is held along {} by a support or another block too; take it out of one \
                         of them",
                        block.name,
                        ["x", "y"][c]
                    )));
                }
            }
        }
    }
    match free_motion(supports, mesh) {
        None => Ok(()),
        Some((what, motion)) => Err(ModelError::Supports(format!(
            "{what} can {motion} freely: nothing holds it; add a [[support]] that does (a roller holds one component, adhesive joins \
             bodies, faces that only touch do not)"
        ))),
    }
}

/// A rigid motion that nothing opposes: of which body, and which. Bodies are the strips, those that adhesive joins
/// being one, and the blocks; what holds them are supports and ties.
fn free_motion(supports: &Supports, mesh: &JointMesh) -> Option<(String, String)> {
    let body_of = bodies(mesh);
    let n_bodies = body_of.iter().max().map_or(0, |&last| last + 1);
    let size = mesh.extent();
    // Unknowns: displacement along x, y, and rotation times the size, of each body about the origin of the mesh, then
    // of each block about its point.
    let n = 3 * (n_bodies + supports.blocks.len());
    let mut rows: Vec<DVector<f64>> = Vec::new();
    let centre = mesh.nodes()[0];
    let moved = |first: usize, about: [f64; 2], at: [f64; 2], c: usize, sign: f64, row: &mut DVector<f64>| {
        row[first + c] += sign;
        let lever = if c == 0 { about[1] - at[1] } else { at[0] - about[0] };
        row[first + 2] += sign * lever / size;
    };
    for (&node, held) in supports.nodes.iter().zip(&supports.held) {
        for c in (0..2).filter(|&c| held[c]) {
            let mut row = DVector::zeros(n);
            moved(3 * body_of[node as usize], centre, mesh.nodes()[node as usize], c, 1.0, &mut row);
            rows.push(row);
        }
    }
    for (k, block) in supports.blocks.iter().enumerate() {
        let first = 3 * (n_bodies + k);
        for c in 0..2 {
            // A component that the block does not move is none of its unknowns.
            if block.held[c] || !block.tied[c] {
                let mut row = DVector::zeros(n);
                row[first + c] = 1.0;
                rows.push(row);
            }
        }
        for &node in &block.nodes {
            for c in (0..2).filter(|&c| block.tied[c]) {
                let (mut row, at) = (DVector::zeros(n), mesh.nodes()[node as usize]);
                moved(3 * body_of[node as usize], centre, at, c, 1.0, &mut row);
                moved(first, block.point, at, c, -1.0, &mut row);
                rows.push(row);
            }
        }
    }
    let mut gram = DMatrix::zeros(n, n);
    rows.iter().for_each(|row| gram += row * row.transpose());
    let eigen = gram.symmetric_eigen();
    let (least, value) = eigen.eigenvalues.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1))?;
    let largest = eigen.eigenvalues.max();
    if *value > 1e-12 * largest {
        return None;
    }
    let motion = eigen.eigenvectors.column(least);
    let size_of = |k: usize| (0..3).map(|c| motion[3 * k + c].abs()).fold(0.0, f64::max);
    let body = (0..n / 3).max_by(|&a, &b| size_of(a).total_cmp(&size_of(b)))?;
    let part = |c: usize| motion[3 * body + c].abs() > 1e-6 * size_of(body);
    let motion = match (part(0), part(1), part(2)) {
        (_, _, true) => "turn",
        (true, false, false) => "move along x",
        (false, true, false) => "move along y",
        _ => "move",
    };
    let what = match body.checked_sub(n_bodies) {
        Some(block) => format!("the rigid block \"{}\"", supports.blocks[block].name),
        None => {
            let node = body_of.iter().position(|&of| of == body)?;
            let [x, y] = mesh.nodes()[node];
            format!("the body with node {node} at ({x}, {y}) mm")
        }
    };
    Some((what, motion.to_owned()))
}

/// Number of the body of each node: strips that adhesive joins are one. Faces that only touch join nothing.
fn bodies(mesh: &JointMesh) -> Vec<usize> {
    let mut body: Vec<usize> = (0..mesh.n_strips()).collect();
    for (corners, &cracked) in mesh.interfaces().iter().zip(mesh.cracked()) {
        let [a, b] = [corners[0], corners[2]].map(|node| body[mesh.strip()[node as usize] as usize]);
        if !cracked && a != b {
            body.iter_mut().filter(|of| **of == a.max(b)).for_each(|of| *of = a.min(b));
        }
    }
    let mut names: Vec<usize> = body.clone();
    names.sort_unstable();
    names.dedup();
    let number = |strip: u32| names.iter().position(|&name| name == body[strip as usize]).unwrap_or(0);
    mesh.strip().iter().map(|&strip| number(strip)).collect()
}
