//! Meshes and case files of the usual tests of adhesives, to begin with.

use super::{JointMesh, JointParts};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use thiserror::Error;

/// A test of an adhesive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SpecimenKind {
    /// Double cantilever beam: opening.
    Dcb,
    /// End-notched flexure: sliding.
    Enf,
    /// Mixed-mode bending: both, in a ratio that the lever gives.
    Mmb,
    /// A thin arm peeled off a thick adherend.
    Peel,
    /// Single lap joint.
    Lap,
}

/// Sizes of a specimen, mm, and how it is loaded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpecimenOptions {
    /// Of the specimen; of bending tests the span; of a lap joint the free length of each adherend.
    pub length: f64,
    /// Length of the crack from the left end; of a lap joint the length of the overlap.
    pub crack: f64,
    /// Thickness of the lower and the upper adherend.
    pub arms: [f64; 2],
    /// Thickness of the adhesive.
    pub adhesive: f64,
    /// Length of the elements along the joint, at most. Bilinear elements are too stiff in bending by half the square
    /// of this over the thickness of the arm: a tenth of that thickness costs half a percent.
    pub element: f64,
    /// Rows of elements in each adherend.
    pub rows: usize,
    /// Displacement at the last instant.
    pub opening: f64,
    /// Instants, evenly.
    pub instants: usize,
    /// Of mixed-mode bending: from the middle of the span to the load on the lever.
    pub lever: f64,
}

/// Sizes that make no specimen.
#[derive(Debug, Clone, PartialEq, Error)]
#[error("{what}")]
pub struct SpecimenError {
    what: String,
}

/// A mesh and a case file that names it `mesh.json`.
#[derive(Debug, Clone, PartialEq)]
pub struct Specimen {
    parts: JointParts,
    groups: BTreeMap<&'static str, Vec<u32>>,
    /// The case file.
    pub case: String,
}

impl SpecimenKind {
    /// Every test.
    pub const ALL: [Self; 5] = [Self::Dcb, Self::Enf, Self::Mmb, Self::Peel, Self::Lap];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Dcb => "dcb",
            Self::Enf => "enf",
            Self::Mmb => "mmb",
            Self::Peel => "peel",
            Self::Lap => "lap",
        }
    }

    fn title(self) -> &'static str {
        match self {
            Self::Dcb => "A double cantilever beam: both arms are pulled apart at pins in their left ends (mode I).",
            Self::Enf => "End-notched flexure: a beam with a crack in its left end is bent in three points (mode II).",
            Self::Mmb => "Mixed-mode bending: a lever presses on the middle of the beam and lifts the upper arm's end.",
            Self::Peel => "Peel: the end of a thin arm is lifted off a thick adherend that is held at its bottom.",
            Self::Lap => {
                "A single lap joint: two adherends, glued over a short length, are pulled; they turn in doing so."
            }
        }
    }

    /// Sizes and loads that show what the test does, for aluminium and a tough epoxy.
    pub fn defaults(self) -> SpecimenOptions {
        let bending = SpecimenOptions {
            length: 120.0,
            crack: 45.0,
            arms: [3.0; 2],
            adhesive: 0.2,
            element: 0.3,
            rows: 4,
            opening: 4.0,
            instants: 40,
            lever: 40.0,
        };
        match self {
            Self::Dcb => SpecimenOptions { length: 100.0, crack: 40.0, opening: 6.0, ..bending },
            Self::Enf | Self::Mmb => bending,
            Self::Peel => SpecimenOptions {
                length: 40.0,
                crack: 15.0,
                arms: [2.0, 0.5],
                element: 0.1,
                rows: 2,
                opening: 10.0,
                ..bending
            },
            Self::Lap => SpecimenOptions {
                length: 30.0,
                crack: 12.5,
                arms: [1.6; 2],
                element: 0.2,
                rows: 3,
                opening: 0.4,
                ..bending
            },
        }
    }
}

/// A strip: the number of its first node, and its columns and rows of nodes.
struct Strip {
    first: u32,
    x: Vec<f64>,
    rows: usize,
}

impl Strip {
    fn node(&self, column: usize, row: usize) -> u32 {
        self.first + (row * self.x.len() + column) as u32
    }

    /// Column of the node nearest to `x`.
    fn column(&self, x: f64) -> usize {
        let off = |k: &usize| (self.x[*k] - x).abs();
        (0..self.x.len()).min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(0)
    }

    fn end(&self, x: f64) -> Vec<u32> {
        (0..=self.rows).map(|row| self.node(self.column(x), row)).collect()
    }
}

impl Specimen {
    /// A strip between `bottom` and `top`, with nodes at all of `breaks` and none further apart than `size`.
    fn strip(&mut self, name: &str, breaks: &[f64], [bottom, top]: [f64; 2], size: f64, rows: usize) -> Strip {
        let mut x = vec![breaks[0]];
        for pair in breaks.windows(2) {
            let n = ((pair[1] - pair[0]) / size - 1e-9).ceil().max(1.0) as usize;
            x.extend((1..=n).map(|k| pair[0] + (pair[1] - pair[0]) * k as f64 / n as f64));
        }
        let strip = Strip { first: self.parts.nodes.len() as u32, x, rows };
        for row in 0..=rows {
            let y = bottom + (top - bottom) * row as f64 / rows as f64;
            self.parts.nodes.extend(strip.x.iter().map(|&x| [x, y]));
        }
        for row in 0..rows {
            for column in 0..strip.x.len() - 1 {
                let [a, b] = [row, row + 1].map(|row| [strip.node(column, row), strip.node(column + 1, row)]);
                self.parts.elements.push([a[0], a[1], b[1], b[0]]);
                self.parts.element_group.push(self.parts.groups.len() as u32);
            }
        }
        self.parts.groups.push(name.to_owned());
        strip
    }

    /// Adhesive from `from` to `to`.
    fn join(&mut self, lower: &Strip, upper: &Strip, [from, to]: [f64; 2]) {
        let (l, u, n) = (lower.column(from), upper.column(from), lower.column(to) - lower.column(from));
        for k in 0..n {
            let pair = |k: usize| [lower.node(l + k, lower.rows), upper.node(u + k, 0)];
            let ([l1, u1], [l2, u2]) = (pair(k), pair(k + 1));
            self.parts.interfaces.push([l1, l2, u1, u2]);
        }
    }
}

impl Specimen {
    /// The mesh and the case file of a test.
    ///
    /// # Errors
    /// Sizes that are not above zero, a crack that reaches the other end, more than a million elements.
    pub fn new(kind: SpecimenKind, options: &SpecimenOptions) -> Result<Self, SpecimenError> {
        check(kind, options)?;
        let &SpecimenOptions { length, crack, arms, adhesive, element, rows, lever, .. } = options;
        let mut b = Self { parts: JointParts::default(), groups: BTreeMap::new(), case: String::new() };
        let (low, high) = ([-0.5 * adhesive - arms[0], -0.5 * adhesive], [0.5 * adhesive, 0.5 * adhesive + arms[1]]);
        let half = 0.5 * length;
        let breaks = match kind {
            SpecimenKind::Dcb | SpecimenKind::Peel => vec![0.0, crack, length],
            SpecimenKind::Enf | SpecimenKind::Mmb if crack == half => vec![0.0, half, length],
            SpecimenKind::Enf | SpecimenKind::Mmb => vec![0.0, crack.min(half), crack.max(half), length],
            SpecimenKind::Lap => vec![0.0, length, length + crack],
        };
        let lower = b.strip("lower", &breaks, low, element, rows);
        let upper_breaks =
            if kind == SpecimenKind::Lap { vec![length, length + crack, 2.0 * length + crack] } else { breaks };
        let upper = b.strip("upper", &upper_breaks, high, element, rows);
        let middle = upper.node(upper.column(half), rows);
        match kind {
            SpecimenKind::Dcb => {
                b.join(&lower, &upper, [crack, length]);
                b.groups.insert("upper_pin", upper.end(0.0));
                b.groups.insert("lower_pin", lower.end(0.0));
            }
            SpecimenKind::Enf | SpecimenKind::Mmb => {
                b.join(&lower, &upper, [0.0, length]);
                b.groups.insert("left", vec![lower.node(0, 0)]);
                b.groups.insert("right", vec![lower.node(lower.x.len() - 1, 0)]);
                match kind {
                    SpecimenKind::Enf => b.groups.insert("middle", vec![middle]),
                    _ => b.groups.insert("lever", vec![upper.node(0, rows), middle]),
                };
            }
            SpecimenKind::Peel => {
                b.join(&lower, &upper, [crack, length]);
                b.groups.insert("grip", upper.end(0.0));
                b.groups.insert("base", (0..lower.x.len()).map(|column| lower.node(column, 0)).collect());
            }
            SpecimenKind::Lap => {
                b.join(&lower, &upper, [length, length + crack]);
                b.groups.insert("left", lower.end(0.0));
                b.groups.insert("right", upper.end(2.0 * length + crack));
            }
        }
        b.case = case(kind, options, half + lever, high[1]);
        Ok(b)
    }

    /// The mesh as a mesh file in JSON.
    pub fn mesh_json(&self) -> String {
        #[derive(Serialize)]
        struct File<'a> {
            nodes: &'a [[f64; 2]],
            quads: &'a [[u32; 4]],
            cohesive: &'a [[u32; 4]],
            groups: &'a [String],
            quad_group: &'a [u32],
            node_groups: &'a BTreeMap<&'static str, Vec<u32>>,
        }
        let JointParts { nodes, elements, interfaces, groups, element_group, .. } = &self.parts;
        let file = File {
            nodes,
            quads: elements,
            cohesive: interfaces,
            groups,
            quad_group: element_group,
            node_groups: &self.groups,
        };
        serde_json::to_string(&file).unwrap_or_else(|error| unreachable!("a mesh has a form in JSON: {error}"))
    }

    /// The mesh.
    ///
    /// # Errors
    /// See [`JointMesh::new`].
    pub fn mesh(&self) -> Result<JointMesh, super::error::MeshFault> {
        JointMesh::new(self.parts.clone())
    }

    /// Groups of nodes by name.
    pub fn groups(&self) -> &BTreeMap<&'static str, Vec<u32>> {
        &self.groups
    }
}

fn check(kind: SpecimenKind, options: &SpecimenOptions) -> Result<(), SpecimenError> {
    let &SpecimenOptions { length, crack, arms, adhesive, element, rows, opening, instants, lever } = options;
    let refuse = |what: String| Err(SpecimenError { what });
    let positive = [("length", length), ("crack", crack), ("lower arm", arms[0]), ("upper arm", arms[1])];
    let more = [("element", element), ("opening", opening), ("lever", lever)];
    for (name, value) in positive.into_iter().chain(more) {
        if !(value.is_finite() && value > 0.0) {
            return refuse(format!("{name} = {value} mm: it must be a finite number above zero"));
        }
    }
    if !(adhesive.is_finite() && adhesive >= 0.0) {
        return refuse(format!("adhesive = {adhesive} mm: it must be a finite number, zero or more"));
    }
    if rows == 0 || instants == 0 {
        return refuse(format!("rows = {rows}, instants = {instants}: there must be one at least"));
    }
    if kind != SpecimenKind::Lap && crack >= length {
        return refuse(format!("a crack of {crack} mm leaves no adhesive in a specimen of {length} mm"));
    }
    let elements = 2.0 * rows as f64 * (length + crack) / element;
    if elements > 1e6 {
        return refuse(format!("{elements:.1e} elements are more than a million; give larger elements or fewer rows"));
    }
    Ok(())
}

fn case(kind: SpecimenKind, options: &SpecimenOptions, lever_x: f64, top: f64) -> String {
    let &SpecimenOptions { crack, opening, instants, .. } = options;
    let ramp = |to: f64| format!("{{ to = {to:?}, instants = {instants} }}");
    let mut text = format!(
        "# {}\n# Made by quadrille make specimen {}. Compute it with: quadrille simulate case.toml --output out\n\
         # mm, MPa, N per mm of width; x to the right, y up. docs/mechanics.md explains every key.\n\n\
         [mesh]\n# Elements bend too stiffly by half the square of their length over the arm's thickness: a tenth costs 0.5 %.\n\
         file = \"mesh.json\"\n",
        kind.title(),
        kind.name()
    );
    // Writing to a String cannot fail.
    let crack_key = format!(
        "# Cracked faces press on each other where they meet, without friction, and hold nothing else.\ncrack = \"x <= {crack:?}\"\n"
    );
    let pin = "# rigid: the nodes of the group move as one body about a pin in their middle, which is held where a displacement is given.\n";
    let supports = match kind {
        SpecimenKind::Dcb => format!(
            "# The crack is where the mesh has no interface elements: nothing holds its faces, nor do they touch.\n\n\
             {pin}[[support]]\ngroup = \"upper_pin\"\nrigid = true\nu_x_mm = 0.0\nu_y_mm = {}\n\n\
             [[support]]\ngroup = \"lower_pin\"\nrigid = true\nu_x_mm = 0.0\nu_y_mm = {}\n",
            ramp(0.5 * opening),
            ramp(-0.5 * opening)
        ),
        SpecimenKind::Enf => format!(
            "{crack_key}\n# Supports hold one component: the beam may slide on the left one.\n\
             [[support]]\ngroup = \"left\"\nu_y_mm = 0.0\n\n[[support]]\ngroup = \"right\"\nu_x_mm = 0.0\nu_y_mm = 0.0\n\n\
             [[support]]\ngroup = \"middle\"\nu_y_mm = {}\n",
            ramp(-opening)
        ),
        SpecimenKind::Mmb => format!(
            "{crack_key}\n[[support]]\ngroup = \"left\"\nu_y_mm = 0.0\n\n\
             [[support]]\ngroup = \"right\"\nu_x_mm = 0.0\nu_y_mm = 0.0\n\n\
             # The lever rests on rollers: it moves its two nodes along y alone. Its point is where the load acts, right of the middle:\n\
             # the further, the more opening.\n\
             [[support]]\ngroup = \"lever\"\nrigid = true\ntied = \"y\"\npoint_mm = [{lever_x:?}, {top:?}]\nu_y_mm = {}\n",
            ramp(-opening)
        ),
        SpecimenKind::Peel => format!(
            "\n[[support]]\ngroup = \"base\"\nu_x_mm = 0.0\nu_y_mm = 0.0\n\n{pin}# Along x the grip is free: the arm may come along.\n\
             [[support]]\ngroup = \"grip\"\nrigid = true\nu_y_mm = {}\n",
            ramp(opening)
        ),
        SpecimenKind::Lap => format!(
            "\n# Clamps: no node of either end turns.\n[[support]]\ngroup = \"left\"\nu_x_mm = 0.0\nu_y_mm = 0.0\n\n\
             [[support]]\ngroup = \"right\"\nu_x_mm = {}\nu_y_mm = 0.0\n",
            ramp(opening)
        ),
    };
    text.push_str(&supports);
    let kinematics = match kind {
        SpecimenKind::Peel | SpecimenKind::Lap => "finite\"                # its arms turn",
        _ => "objective\"             # \"finite\" where arms turn by more than a degree or two",
    };
    let lever = if kind == SpecimenKind::Mmb { ", which a lever on rollers needs" } else { "" };
    let _ = write!(
        text,
        "\n[substrate]\nmodel = \"linear-elastic\"            # or \"ramberg-osgood\" with sigma_0_MPa, alpha, n\nplane = \"strain\"                     # wide specimens; \"stress\" for narrow ones\n\
         E_MPa = 70000.0\nnu = 0.33\n\n\
         [cohesive]\nmodel = \"bilinear-benzeggagh-kenane\"\nkinematics = \"{kinematics}{lever}\n\
         K_MPa_per_mm = 10000.0               # stiffness before damage: about E of the adhesive by its thickness\n\
         T_n0_MPa = 20.0                      # strengths\nT_t0_MPa = 20.0\n\
         G_Ic_N_per_mm = 0.5                  # works of separation\nG_IIc_N_per_mm = 1.0\neta = 2.0                            # how they mix\n"
    );
    text
}
