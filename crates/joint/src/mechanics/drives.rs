//! Supports and loads of a case file, for the nodes of a mesh.

use super::{Carry, Drives, JointError, JointMesh, NodeGroup, RigidBlock, border_edges, select_nodes, wrong};
use crate::io::case::{CaseNodeGroup, CaseTied};
use crate::io::joint::{History, JointInput, MeshInput};

/// The nodes of the case's group `name`, of `[groups]` or of the mesh file, in the mesh that `carry` leads to. Errors:
/// no such group, a condition that is none, a node that is not there, a group without nodes.
pub(super) fn nodes_of_group(
    input: &JointInput,
    name: &str,
    mesh: &JointMesh,
    carry: Option<&Carry>,
) -> Result<Vec<u32>, String> {
    let carried = |nodes: &Vec<u32>| carry.map_or_else(|| nodes.clone(), |carry| carry.nodes_between(nodes));
    let of_file = match &input.mesh {
        MeshInput::File(file) | MeshInput::Run(file) => Some(&file.node_groups),
        MeshInput::Rectangle { .. } => None,
    };
    let nodes = match (input.case.groups.get(name), of_file.and_then(|groups| groups.get(name))) {
        (Some(CaseNodeGroup::Where(text)), _) => select_nodes(text, mesh)?,
        (Some(CaseNodeGroup::List(list)), _) => {
            let n = mesh.nodes().len();
            if let Some(node) = list.iter().find(|&&node| node as usize >= n) {
                return Err(format!("there is no node {node}; the mesh has {n} (counted from 0)"));
            }
            carried(list)
        }
        (None, Some(nodes)) => carried(nodes),
        (None, None) => {
            let there = input.case.groups.keys().chain(of_file.into_iter().flat_map(|groups| groups.keys()));
            let there: Vec<String> = there.map(|name| format!("\"{name}\"")).collect();
            let there = if there.is_empty() { "none".to_owned() } else { there.join(", ") };
            return Err(format!(
                "there is no group of this name; there are: {there}. Name one in [groups], as {name} = \"y = max and x < 2.5\""
            ));
        }
    };
    if nodes.is_empty() { Err("no node of the mesh is there".to_owned()) } else { Ok(nodes) }
}

/// The supports and loads of a case, and the number of instants that they have; `instants` is that of the border, where
/// there is one. Errors: a group that is not there or has no nodes, a support of nothing, lists of different lengths.
pub(super) fn drives_of_case(
    input: &JointInput,
    mesh: &JointMesh,
    carry: Option<&Carry>,
    instants: Option<usize>,
) -> Result<(Drives, usize), JointError> {
    let group = |section: &str, name: &str| {
        nodes_of_group(input, name, mesh, carry)
            .map(|nodes| NodeGroup::new(name, nodes).nodes)
            .map_err(|what| wrong(section, Some("group"), format!("group = \"{name}\": {what}")))
    };
    let n = n_instants(input, instants)?;
    let spread = |history: &Option<History>| match history {
        None => vec![0.0; n],
        Some(History::Constant(value)) => vec![*value; n],
        Some(History::List(values)) => values.clone(),
    };
    let pairs = |x: &Option<History>, y: &Option<History>| -> Vec<[f64; 2]> {
        spread(x).into_iter().zip(spread(y)).map(|(x, y)| [x, y]).collect()
    };
    let mut drives = Drives::default();
    for (support, values) in &input.drives.supports {
        let name = &support.group;
        let nodes = group("support", name)?;
        if !support.rigid {
            if values.iter().all(Option::is_none) {
                let what = format!("group \"{name}\": give u_x_mm or u_y_mm (0 holds the component), or rigid = true");
                return Err(wrong("support", None, what));
            }
            if support.point_mm.is_some() || support.tied.is_some() {
                let what = format!("group \"{name}\": point_mm and tied are for rigid = true");
                return Err(wrong("support", None, what));
            }
            for (c, history) in values.iter().enumerate().filter(|(_, history)| history.is_some()) {
                drives.supports.extend(nodes.iter().map(|&node| (node, c, spread(history), name.clone())));
            }
            continue;
        }
        let tied = match support.tied {
            None | Some(CaseTied::Both) => [true, true],
            Some(CaseTied::X) => [true, false],
            Some(CaseTied::Y) => [false, true],
        };
        let held = [0, 1].map(|c| values[c].is_some());
        if let Some(c) = (0..2).find(|&c| held[c] && !tied[c]) {
            let axis = ["x", "y"][c];
            let what = format!("group \"{name}\": u_{axis}_mm is of a component that tied leaves free");
            return Err(wrong("support", None, what));
        }
        let middle = || {
            let mean = |c: usize| nodes.iter().map(|&node| mesh.nodes()[node as usize][c]).sum::<f64>();
            [0, 1].map(|c| mean(c) / nodes.len() as f64)
        };
        let point = support.point_mm.unwrap_or_else(middle);
        let block = RigidBlock { name: name.clone(), nodes, tied, point, held };
        drives.blocks.push((block, pairs(&values[0], &values[1])));
    }
    for (load, values) in &input.drives.loads {
        let name = &load.group;
        let [fx, fy, tx, ty] = values;
        let refused = |what: &str| Err(wrong("applied_load", None, format!("group \"{name}\": {what}")));
        let (force, traction) = (fx.is_some() || fy.is_some(), tx.is_some() || ty.is_some());
        if !force && !traction {
            return refused("give F_x_N_per_mm, F_y_N_per_mm, T_x_MPa or T_y_MPa");
        }
        if let Some(block) = drives.blocks.iter().position(|(block, _)| block.name == *name) {
            if traction {
                return refused("a rigid body takes forces at its point_mm, not tractions");
            }
            drives.block_loads.push((block, pairs(fx, fy)));
            continue;
        }
        let nodes = group("applied_load", name)?;
        if force {
            let share = 1.0 / nodes.len() as f64;
            let each: Vec<[f64; 2]> = pairs(fx, fy).into_iter().map(|f| f.map(|f| share * f)).collect();
            drives.loads.extend(nodes.iter().map(|&node| (node, each.clone())));
        }
        if traction {
            let inside = |edge: &[u32; 2]| edge.iter().all(|node| nodes.binary_search(node).is_ok());
            let edges: Vec<[u32; 2]> = border_edges(mesh.elements()).into_iter().filter(inside).collect();
            if edges.is_empty() {
                return refused(
                    "no edge of the border lies between its nodes, so that T_x_MPa and T_y_MPa act on nothing",
                );
            }
            let values = pairs(tx, ty);
            for [a, b] in edges {
                let [p, q] = [a, b].map(|node| mesh.nodes()[node as usize]);
                let half = 0.5 * (p[0] - q[0]).hypot(p[1] - q[1]);
                let forces: Vec<[f64; 2]> = values.iter().map(|t| t.map(|t| half * t)).collect();
                drives.loads.push((a, forces.clone()));
                drives.loads.push((b, forces));
            }
        }
    }
    Ok((drives, n))
}

/// The number of instants: that of the border, else that of the lists, which must agree.
fn n_instants(input: &JointInput, border: Option<usize>) -> Result<usize, JointError> {
    let mut known: Option<(usize, String)> = border.map(|n| (n, "[boundary]".to_owned()));
    let of_supports = (input.drives.supports.iter())
        .flat_map(|(support, values)| values.iter().map(|history| ("support", &support.group, history)));
    let of_loads = (input.drives.loads.iter())
        .flat_map(|(load, values)| values.iter().map(|history| ("applied_load", &load.group, history)));
    for (section, group, history) in of_supports.chain(of_loads) {
        let Some(History::List(values)) = history else { continue };
        let of = format!("[[{section}]] of group \"{group}\"");
        match &known {
            Some((n, first)) if *n != values.len() => {
                let what =
                    format!("group \"{group}\" has {} instants, {first} has {n}; give as many values", values.len());
                return Err(wrong(section, None, what));
            }
            Some(_) => {}
            None => known = Some((values.len(), of)),
        }
    }
    Ok(known.map_or(1, |(n, _)| n))
}
