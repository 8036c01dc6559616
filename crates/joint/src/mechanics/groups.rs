//! Named groups of nodes: where reactions are summed.

use super::JointMesh;

/// Nodes with a name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NodeGroup {
    /// Its name in the results.
    pub name: String,
    /// The nodes, rising.
    pub nodes: Vec<u32>,
    /// Whether forces act on its nodes: what acts on free components is counted too.
    pub loaded: bool,
}

impl NodeGroup {
    /// The nodes, sorted and each once, under a name.
    pub fn new(name: impl Into<String>, mut nodes: Vec<u32>) -> Self {
        nodes.sort_unstable();
        nodes.dedup();
        Self { name: name.into(), nodes, loaded: false }
    }

    /// One group for each strip of `mesh`, of those of its nodes that are `prescribed`: called as the groups of its
    /// elements.
    pub fn of_strips(mesh: &JointMesh, prescribed: &[u32]) -> Vec<Self> {
        (0..mesh.n_strips() as u32)
            .map(|strip| {
                let mut names: Vec<&str> = Vec::new();
                for (corners, &group) in mesh.elements().iter().zip(mesh.element_group()) {
                    let name = mesh.groups()[group as usize].as_str();
                    if mesh.strip()[corners[0] as usize] == strip && !names.contains(&name) {
                        names.push(name);
                    }
                }
                let nodes = prescribed.iter().copied().filter(|&node| mesh.strip()[node as usize] == strip).collect();
                // The same material above and below has one name.
                let name = if mesh.groups().len() == 1 { format!("strip {}", strip + 1) } else { names.join("+") };
                Self::new(name, nodes)
            })
            .collect()
    }
}

/// The nodes that a selection such as `y = max and x < 2.5` names: conditions on `x` or `y` (mm, of the mesh at rest)
/// with `=`, `<`, `<=`, `>` or `>=`, all of which must hold; `min` and `max` are the ends of the mesh. Equal is what
/// differs by less than a thousandth of an element.
///
/// # Errors
/// What is wrong with the text, in words.
///
/// ```
/// # use quadrille_joint as quadrille;
/// use quadrille::mechanics::{JointMesh, select_nodes};
/// let mesh = JointMesh::rectangular(3, 2, 1.0, 0.5)?;
/// assert_eq!(select_nodes("y = max", &mesh)?, [20, 21, 22, 23]);
/// assert_eq!(select_nodes("y = min and x >= 2", &mesh)?, [2, 3]);
/// assert!(select_nodes("z = 1", &mesh).is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn select_nodes(text: &str, mesh: &JointMesh) -> Result<Vec<u32>, String> {
    let conditions = text.split(" and ").map(|part| Condition::parse(part, mesh)).collect::<Result<Vec<_>, _>>()?;
    let tolerance = 1e-3 * mesh.element_size();
    let holds = |at: &[f64; 2]| conditions.iter().all(|condition| condition.holds(*at, tolerance));
    Ok((0u32..).zip(mesh.nodes()).filter(|(_, at)| holds(at)).map(|(node, _)| node).collect())
}

struct Condition {
    axis: usize,
    sign: &'static str,
    value: f64,
}

impl Condition {
    fn parse(part: &str, mesh: &JointMesh) -> Result<Self, String> {
        let part = part.trim();
        let wrong = || {
            format!(
                "\"{part}\" is not a condition; write such as \"y = max\", \"x = 0\" or \"x >= 1.5 and y < 0\" (mm, =, <, <=, >, \
                 >=, min, max)"
            )
        };
        let axis = match part.chars().next() {
            Some('x') => 0,
            Some('y') => 1,
            _ => return Err(wrong()),
        };
        let rest = part[1..].trim_start();
        // The longer signs first.
        let sign = ["<=", ">=", "=", "<", ">"].into_iter().find(|sign| rest.starts_with(sign)).ok_or_else(wrong)?;
        let coordinates = || mesh.nodes().iter().map(|at| at[axis]);
        let value = match rest[sign.len()..].trim() {
            "min" => coordinates().fold(f64::INFINITY, f64::min),
            "max" => coordinates().fold(f64::NEG_INFINITY, f64::max),
            number => number.parse().ok().filter(|value: &f64| value.is_finite()).ok_or_else(wrong)?,
        };
        Ok(Self { axis, sign, value })
    }

    fn holds(&self, at: [f64; 2], tolerance: f64) -> bool {
        let above = at[self.axis] - self.value;
        match self.sign {
            "=" => above.abs() <= tolerance,
            "<" => above < -tolerance,
            "<=" => above <= tolerance,
            ">" => above > tolerance,
            _ => above >= -tolerance,
        }
    }
}
