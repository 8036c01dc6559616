//! `quadrille simulate`: the forward model of a joint from a case file.

use super::args::SimulateArgs;
use super::run_folder::{FIGURES, RunFolder};
use super::{Outcome, Result, plural};
use crate::field::RigidMotion;
use crate::io::joint::{
    CaseJointMesh, JointCase, counter_clockwise, read_boundary, read_joint_case, read_joint_mesh, write_table,
};
use crate::io::store::{STORE, Store};
use crate::io::vtk::{GridValues, write_grid, write_pvd};
use crate::mechanics::cohesive::{CohesiveLaw, Parameter, law_by_name, parameters_by_name};
use crate::mechanics::substrate::{PlaneState, SubstrateLaw, substrate_by_name, substrate_parameters};
use crate::mechanics::{
    BoundaryHistory, ForwardOptions, Instant, JointMesh, JointParts, Kinematics, Model, ModelOptions, Quadrature,
    Solution, Status,
};
use crate::report::{JointMap, JointProfiles};
use serde::Serialize;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use toml::{Table, Value};

/// Runs the command.
pub(super) fn run(args: &SimulateArgs) -> Result<Outcome> {
    let case = read_joint_case(&args.case)?;
    let mut warnings = Vec::new();
    let joint = Joint::of(&case, &mut warnings)?;
    warnings.extend(joint.doubts());
    let folder = RunFolder::open(&args.output, args.overwrite)?;
    folder.clear(false, true)?;
    folder.make(FIGURES)?;
    if !args.quiet {
        warnings.iter().for_each(|warning| eprintln!("warning: {warning}"));
    }
    let options = ForwardOptions {
        law_sensitivities: true,
        substrate_sensitivities: case.output.substrate_sensitivities,
        ..ForwardOptions::default()
    };
    let begin = std::time::Instant::now();
    let solution =
        super::pool(args.threads)?.install(|| joint.model.forward(&*joint.law, &joint.boundary, &options))?;
    let seconds = begin.elapsed().as_secs_f64();

    joint.write_tables(&folder, &solution)?;
    joint.write_grids(&folder, &solution)?;
    joint.draw(&folder, &solution, case.output.figures.as_deref(), &mut warnings)?;
    let instants: Vec<InstantSummary> =
        (1..).zip(&solution.instants).map(|(number, instant)| joint.summary_of(number, instant)).collect();
    let failed = instants.iter().find(|instant| instant.status == Status::NotConverged.name());
    if !args.quiet {
        // They grow with the test: the last says it all, summary.json has each.
        if let Some(worst) = instants.iter().rfind(|instant| !instant.warnings.is_empty()) {
            worst.warnings.iter().for_each(|warning| eprintln!("warning: instant {}: {warning}", worst.instant));
        }
        if let Some(message) = failed.and_then(|instant| instant.message.as_ref()) {
            eprintln!("{message}");
        }
        let n = solution.instants.iter().filter(|instant| instant.status.converged()).count();
        let total = plural(solution.instants.len(), "instant");
        eprintln!("{n} of {total} converged in {seconds:.3} s, results in {}", args.output.display());
    }
    folder.write_summary(&Summary {
        quadrille: env!("CARGO_PKG_VERSION"),
        case: super::absolute(&args.case),
        seconds,
        units: "mm, MPa, N/mm; x to the right, y up; nodes counted from 0, instants from 1",
        elements: joint.model.mesh().elements().len(),
        interface_elements: joint.model.mesh().interfaces().len(),
        unknowns: joint.model.n_unknowns(),
        solver: joint.model.solver(),
        cohesive: Named::of(joint.law.name(), joint.law.parameters(), &joint.law.values()),
        substrate: (joint.model.mesh().groups().iter().zip(joint.model.materials()))
            .map(|(group, law)| (group.clone(), Named::of(law.name(), law.parameters(), &law.values())))
            .collect(),
        kinematics: joint.model.options().kinematics.name(),
        quadrature: joint.model.options().quadrature.name(),
        remove_rigid_motion: case.boundary.remove_rigid_motion.clone().unwrap_or_else(|| "none".to_owned()),
        rigid_motion_removed: joint.removed.clone(),
        warnings,
        instants,
    })?;
    Ok(if solution.converged() { Outcome::Fine } else { Outcome::Incomplete })
}

/// `summary.json`.
#[derive(Serialize)]
struct Summary {
    quadrille: &'static str,
    case: String,
    /// Solve and sensitivities, without files.
    seconds: f64,
    units: &'static str,
    elements: usize,
    interface_elements: usize,
    unknowns: usize,
    solver: &'static str,
    cohesive: Named,
    substrate: std::collections::BTreeMap<String, Named>,
    kinematics: &'static str,
    quadrature: &'static str,
    remove_rigid_motion: String,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    rigid_motion_removed: Vec<RigidMotion>,
    warnings: Vec<String>,
    instants: Vec<InstantSummary>,
}

/// A law with its values.
#[derive(Serialize)]
struct Named {
    model: &'static str,
    parameters: std::collections::BTreeMap<String, f64>,
}

impl Named {
    fn of(model: &'static str, parameters: &[Parameter], values: &[f64]) -> Self {
        Self { model, parameters: parameters.iter().map(Parameter::key).zip(values.iter().copied()).collect() }
    }
}

#[derive(Serialize)]
struct InstantSummary {
    instant: usize,
    status: &'static str,
    newton_iterations: u32,
    halvings: u32,
    /// Whether node pairs snapped and were carried over.
    rescue: bool,
    rescue_steps: u32,
    /// Largest residual force over the largest nodal force.
    residual: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    crack_front_mm: Option<f64>,
    /// Rotation of the strip that turns most, radians.
    #[serde(skip_serializing_if = "Option::is_none")]
    largest_strip_rotation_rad: Option<f64>,
    /// Node pairs (lower, upper) that snapped, or moved most where the instant failed.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    snapped_pairs: Vec<[u32; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    message: Option<String>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    warnings: Vec<String>,
}

/// Everything that a case says, ready to run.
struct Joint {
    model: Model,
    law: Box<dyn CohesiveLaw>,
    boundary: BoundaryHistory,
    removed: Vec<RigidMotion>,
}

impl Joint {
    fn of(case: &JointCase, warnings: &mut Vec<String>) -> Result<Self> {
        let resolve = |name: &String| case.base.join(name);
        let (law, kinematics, quadrature) = cohesive(&case.cohesive)?;
        let source = Source::of(&case.mesh, &case.base)?;
        let mut mesh = source.mesh()?;
        let (mut boundary, name) = match (&case.boundary.file, &case.boundary.store) {
            (Some(file), None) => (from_table(&resolve(file), &mesh, source.by_position())?, file),
            (None, Some(store)) => (from_store(&resolve(store), &source, &mesh)?, store),
            _ => {
                return Err(
                    "[boundary] needs either file = \"displacements.csv\" or store = \"run/fields.zarr\"".into()
                );
            }
        };
        if let Some(k) = case.mesh.refine {
            let (fine, carry) = mesh.refined(k).map_err(|fault| format!("[mesh] {fault}"))?;
            boundary = mesh.carry_boundary(&carry, &boundary);
            mesh = fine;
        }
        let removed = match case.boundary.remove_rigid_motion.as_deref() {
            None | Some("none") => Vec::new(),
            Some("overall") => {
                let (rest, motions) = boundary.without_rigid_motion(mesh.nodes());
                boundary = rest;
                if kinematics == Kinematics::Paper {
                    let largest = motions.iter().fold(0.0_f64, |most, motion| most.max(motion.rotation_rad.abs()));
                    warnings.push(format!(
                        "the overall rigid motion is taken off (rotation up to {largest:.2e} rad); with kinematics = \
                         \"paper\" this changes the sliding jump by up to {:.2e} mm",
                        largest * mesh.gap()
                    ));
                }
                motions
            }
            Some(other) => {
                return Err(
                    format!("[boundary] remove_rigid_motion = \"{other}\"; give \"none\" or \"overall\"").into()
                );
            }
        };
        let materials = materials(&case.substrate, mesh.groups())?;
        let options = ModelOptions { kinematics, quadrature, ..ModelOptions::default() };
        let model =
            Model::new(mesh, materials, boundary.nodes(), options).map_err(|error| format!("{name}: {error}"))?;
        Ok(Self { model, law, boundary, removed })
    }

    /// What is possible, but hardly meant.
    fn doubts(&self) -> Vec<String> {
        let (size, opening) = (self.model.mesh().element_size(), self.law.front_opening());
        let mut doubts = Vec::new();
        if size > 1e4 * opening || size < 1e-4 * opening {
            doubts.push(format!(
                "elements of {size:.3e} mm beside a joint that is open at {opening:.3e} mm: are all lengths in mm?"
            ));
        }
        let largest = self.boundary.instants().iter().flatten().flatten().fold(0.0_f64, |most, u| most.max(u.abs()));
        let nodes = self.model.mesh().nodes();
        let extent = [0, 1].map(|c| {
            let of = |pick: fn(f64, f64) -> f64, start: f64| nodes.iter().map(|x| x[c]).fold(start, pick);
            of(f64::max, f64::NEG_INFINITY) - of(f64::min, f64::INFINITY)
        });
        if largest > extent[0].max(extent[1]) {
            doubts.push(format!(
                "the border moves by up to {largest:.3e} mm, more than the joint's size of {:.3e} mm: are all lengths in mm?",
                extent[0].max(extent[1])
            ));
        }
        doubts
    }

    fn write_tables(&self, folder: &RunFolder, solution: &Solution) -> Result<()> {
        let version = format!("quadrille {}", env!("CARGO_PKG_VERSION"));
        let note = |what: &str| vec![version.clone(), format!("{what}; mm, MPa; y up; nodes from 0, instants from 1")];
        let names = |columns: &[&str]| columns.iter().map(|&name| name.to_owned()).collect::<Vec<_>>();
        let solved = || (1u64..).zip(&solution.instants).filter(|(_, instant)| instant.status.converged());
        folder.write("solution.csv", |out| {
            let rows = solved().flat_map(|(number, instant)| {
                (0u64..).zip(&instant.displacement).map(move |(node, u)| (vec![number, node], u.to_vec()))
            });
            write_table(out, &note("displacement of every node"), &names(&["instant", "node", "ux_mm", "uy_mm"]), rows)
        })?;
        let columns = ["instant", "lower_node", "upper_node", "x_mm", "y_mm", "Dn_mm", "Dt_mm", "Tn_MPa", "Tt_MPa"];
        let positions = self.model.pair_positions();
        folder.write("tractions.csv", |out| {
            let rows = solved().flat_map(|(number, instant)| {
                let jumps = self.model.jumps(&instant.displacement);
                let rows: Vec<_> = (self.model.mesh().pairs().iter().zip(&positions).zip(jumps))
                    .map(|((&[lower, upper], ([x, y], _)), jump)| {
                        let traction = self.law.response(jump).traction;
                        let values = vec![*x, *y, jump.normal, jump.tangential, traction.normal, traction.tangential];
                        (vec![number, lower.into(), upper.into()], values)
                    })
                    .collect();
                rows
            });
            write_table(out, &note("jump and traction of every node pair, upper minus lower"), &names(&columns), rows)
        })?;
        let parameters = self.parameter_names(solution);
        let mut columns = names(&["instant", "node"]);
        for component in ["ux", "uy"] {
            columns.extend(parameters.iter().map(|name| format!("d{component}_d{name}")));
        }
        folder.write("sensitivities.csv", |out| {
            let rows = solved().flat_map(|(number, instant)| {
                (0..instant.displacement.len()).map(move |node| {
                    let of = |c: usize| instant.sensitivities.iter().map(move |field| field[node][c]);
                    (vec![number, node as u64], of(0).chain(of(1)).collect())
                })
            });
            write_table(out, &note("derivative of every displacement (mm) by each parameter"), &columns, rows)
        })
    }

    fn parameter_names(&self, solution: &Solution) -> Vec<String> {
        let groups = self.model.mesh().groups();
        let name = |sensitivity: &crate::mechanics::Sensitivity| match sensitivity.group {
            None => sensitivity.parameter.name.to_owned(),
            Some(group) => format!("{}_{}", sensitivity.parameter.name, groups[group]),
        };
        solution.parameters.iter().map(name).collect()
    }

    fn write_grids(&self, folder: &RunFolder, solution: &Solution) -> Result<()> {
        let mesh = self.model.mesh();
        let cell = |&[a, b, c, d]: &[u32; 4]| if c == d { vec![a, b, c] } else { vec![a, b, c, d] };
        let cells: Vec<Vec<u32>> = mesh.elements().iter().map(cell).collect();
        let lines: Vec<Vec<u32>> = {
            let place: HashMap<[u32; 2], u32> = (0u32..).zip(mesh.pairs()).map(|(k, &pair)| (pair, k)).collect();
            mesh.interfaces().iter().map(|&[l1, l2, u1, u2]| vec![place[&[l1, u1]], place[&[l2, u2]]]).collect()
        };
        let middle: Vec<[f64; 2]> = self.model.pair_positions().into_iter().map(|(at, _)| at).collect();
        let names = self.parameter_names(solution);
        let spatial = |field: &[[f64; 2]]| field.iter().map(|&[x, y]| [x, y, 0.0]).collect();
        let mut numbers = Vec::new();
        for (number, instant) in (1..).zip(&solution.instants).filter(|(_, instant)| instant.status.converged()) {
            let u = &instant.displacement;
            let mut at_points = vec![GridValues::Vectors("displacement_mm".into(), spatial(u))];
            for (name, field) in names.iter().zip(&instant.sensitivities) {
                at_points.push(GridValues::Vectors(format!("du_d{name}"), spatial(field)));
            }
            let mean = |values: [f64; 4]| values.iter().sum::<f64>() / 4.0;
            let stresses = self.model.stresses(u);
            let states = self.model.states(u);
            let of = |c: usize| stresses.iter().map(|s| mean(s.map(|s| s.0[c]))).collect::<Vec<_>>();
            let [x, y, shear] = [0, 1, 2].map(of);
            let stress = x.into_iter().zip(y).zip(shear).map(|((x, y), shear)| [x, y, shear]).collect();
            let at_cells = [
                GridValues::Vectors("stress_xx_yy_xy_MPa".into(), stress),
                GridValues::Scalars(
                    "equivalent_stress_MPa".into(),
                    states.iter().map(|s| mean(s.map(|s| s.equivalent_stress))).collect(),
                ),
                GridValues::Scalars(
                    "plastic_strain".into(),
                    states.iter().map(|s| mean(s.map(|s| s.plastic_strain))).collect(),
                ),
                GridValues::Scalars("group".into(), mesh.element_group().iter().map(|&g| f64::from(g)).collect()),
            ];
            let title = format!("quadrille {}, instant {number}; mm, MPa, y up", env!("CARGO_PKG_VERSION"));
            folder.write(&format!("vtu/{number:06}.vtu"), |out| {
                write_grid(out, &title, mesh.nodes(), &cells, &at_points, &at_cells).map_err(std::io::Error::other)
            })?;
            let jumps = self.model.jumps(u);
            let values =
                |of: &dyn Fn(crate::mechanics::cohesive::Jump) -> f64| jumps.iter().map(|&jump| of(jump)).collect();
            let along: Vec<[f64; 2]> = mesh
                .pairs()
                .iter()
                .map(|pair| [0, 1].map(|c| 0.5 * (u[pair[0] as usize][c] + u[pair[1] as usize][c])))
                .collect();
            let at_pairs = [
                GridValues::Vectors("displacement_mm".into(), spatial(&along)),
                GridValues::Scalars("normal_jump_mm".into(), values(&|jump| jump.normal)),
                GridValues::Scalars("tangential_jump_mm".into(), values(&|jump| jump.tangential)),
                GridValues::Scalars(
                    "normal_traction_MPa".into(),
                    values(&|jump| self.law.response(jump).traction.normal),
                ),
                GridValues::Scalars(
                    "tangential_traction_MPa".into(),
                    values(&|jump| self.law.response(jump).traction.tangential),
                ),
                GridValues::Scalars("state".into(), values(&|jump| self.state(jump))),
            ];
            let title = format!("{title}; state: -1 compressed, 0 loading, 1 softening, 2 open");
            folder.write(&format!("vtu/{number:06}-interface.vtu"), |out| {
                write_grid(out, &title, &middle, &lines, &at_pairs, &[]).map_err(std::io::Error::other)
            })?;
            numbers.push(number);
        }
        for (list, ending) in [("series.pvd", ""), ("interface.pvd", "-interface")] {
            let entries: Vec<_> =
                numbers.iter().map(|&n: &usize| (n as f64, format!("vtu/{n:06}{ending}.vtu"))).collect();
            folder.write(list, |out| write_pvd(out, &entries).map_err(std::io::Error::other))?;
        }
        Ok(())
    }

    /// -1 compressed, 0 loading, 1 softening, 2 open.
    fn state(&self, jump: crate::mechanics::cohesive::Jump) -> f64 {
        let [[nn, nt], [tn, tt]] = self.law.response(jump).tangent;
        if jump.normal < 0.0 {
            -1.0
        } else if jump.normal >= self.law.front_opening() {
            2.0
        } else if nn * tt - 0.25 * (nt + tn) * (nt + tn) < 0.0 || nn + tt < 0.0 {
            1.0
        } else {
            0.0
        }
    }

    fn draw(
        &self,
        folder: &RunFolder,
        solution: &Solution,
        asked: Option<&[usize]>,
        warnings: &mut Vec<String>,
    ) -> Result<()> {
        let solved: Vec<usize> =
            (1..=solution.instants.len()).filter(|&k| solution.instants[k - 1].status.converged()).collect();
        let Some(&last) = solved.last() else { return Ok(()) };
        let chosen: Vec<usize> = match asked {
            Some(asked) => {
                for &instant in asked.iter().filter(|instant| !solved.contains(instant)) {
                    warnings.push(format!("[output] figures names instant {instant}, which has no solution"));
                }
                asked.iter().copied().filter(|instant| solved.contains(instant)).collect()
            }
            None => {
                let mut chosen = vec![solved[0], solved[solved.len() / 2], last];
                chosen.dedup();
                chosen
            }
        };
        let save = |name: String, picture: crate::report::Picture| -> Result<()> {
            Ok(picture.save(folder.path().join(FIGURES).join(name))?)
        };
        let mesh = self.model.mesh();
        let extent =
            mesh.nodes().iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], x| [a.min(x[0]), b.max(x[0])]);
        for &number in &chosen {
            let instant = &solution.instants[number - 1];
            let u = &instant.displacement;
            let largest = u.iter().flatten().fold(0.0_f64, |most, u| most.max(u.abs()));
            // A round factor that makes the motion about a tenth of the joint's length.
            let wanted = 0.1 * (extent[1] - extent[0]) / largest.max(1e-300);
            let factor = if wanted > 1.0 && wanted < 1e6 { 10f64.powf(wanted.log10().floor()) } else { 1.0 };
            let moved: Vec<[f64; 2]> =
                mesh.nodes().iter().zip(u).map(|(x, u)| [x[0] + factor * u[0], x[1] + factor * u[1]]).collect();
            // Equivalent stress at the nodes: the mean of the elements around.
            let mut stress = vec![[0.0; 2]; u.len()];
            for (corners, states) in mesh.elements().iter().zip(self.model.states(u)) {
                for (&node, state) in corners.iter().zip(states) {
                    stress[node as usize][0] += state.equivalent_stress;
                    stress[node as usize][1] += 1.0;
                }
            }
            let map = JointMap {
                title: format!("Deformed joint at instant {number}"),
                label: "equivalent stress (MPa)".into(),
                notes: vec![format!("displacements times {factor}; largest {largest:.3e} mm")],
                nodes: &moved,
                elements: mesh.elements(),
                values: &stress.iter().map(|[sum, n]| sum / n).collect::<Vec<_>>(),
            };
            save(format!("{number:06}-deformed.png"), map.draw()?)?;
        }
        let along: Vec<f64> = self.model.pair_positions().into_iter().map(|(_, along)| along).collect();
        let profile = |pick: fn(crate::mechanics::cohesive::Traction) -> f64, title: &str, label: &str| {
            let of = |&number: &usize| {
                let u = &solution.instants[number - 1].displacement;
                let values = self.model.tractions(&*self.law, u).into_iter().map(pick).collect();
                (format!("instant {number}"), values, self.model.crack_front(&*self.law, u))
            };
            JointProfiles {
                title: title.into(),
                label: label.into(),
                instants: chosen.iter().map(of).collect(),
                along: along.clone(),
                notes: vec![format!("crack front: where the normal jump reaches {:.3e} mm", self.law.front_opening())],
            }
        };
        let normal = profile(|t| t.normal, "Normal traction along the joint", "T_n (MPa)");
        let tangential = profile(|t| t.tangential, "Tangential traction along the joint", "T_t (MPa)");
        for ending in ["png", "svg"] {
            save(format!("{last:06}-tn.{ending}"), normal.draw()?)?;
            save(format!("{last:06}-tt.{ending}"), tangential.draw()?)?;
        }
        let instant = &solution.instants[last - 1];
        for (sensitivity, (name, field)) in
            solution.parameters.iter().zip(self.parameter_names(solution).iter().zip(&instant.sensitivities))
        {
            let unit = match sensitivity.parameter.unit {
                "1" => "mm".to_owned(),
                unit => format!("mm per {unit}"),
            };
            for (c, component) in ["u_x", "u_y"].into_iter().enumerate() {
                let values: Vec<f64> = field.iter().map(|v| v[c]).collect();
                if values.iter().all(|v| *v == 0.0) {
                    continue;
                }
                let map = JointMap {
                    title: format!("Sensitivity of {component} to {name} at instant {last}"),
                    label: format!("d {component} / d {name} ({unit})"),
                    notes: Vec::new(),
                    nodes: mesh.nodes(),
                    elements: mesh.elements(),
                    values: &values,
                };
                let file = format!("{last:06}-d{}_d{name}.png", component.replace('_', ""));
                save(file, map.draw()?)?;
            }
        }
        Ok(())
    }

    fn summary_of(&self, number: usize, instant: &Instant) -> InstantSummary {
        let mesh = self.model.mesh();
        let pairs: Vec<[u32; 2]> = instant.snapped.iter().map(|&k| mesh.pairs()[k]).collect();
        let converged = instant.status.converged();
        let rotation = converged.then(|| {
            let of = |strip: usize| {
                let nodes = || (0..mesh.nodes().len()).filter(move |&node| mesh.strip()[node] as usize == strip);
                RigidMotion::fit(nodes().map(|node| (mesh.nodes()[node], instant.displacement[node])))
                    .map_or(0.0, |motion| motion.rotation_rad)
            };
            (0..mesh.n_strips()).map(of).fold(0.0, |most: f64, w| if w.abs() > most.abs() { w } else { most })
        });
        let mut warnings = Vec::new();
        let yields = self.model.materials().iter().filter_map(|law| law.yield_strain()).fold(f64::INFINITY, f64::min);
        if let Some(w) = rotation
            && 0.5 * w * w > 0.1 * yields
        {
            warnings.push(format!(
                "a strip turns by {w:.2e} rad: w^2/2 = {:.1e} is more than a tenth of the yield strain {yields:.1e}; \
                 small strains no longer hold",
                0.5 * w * w
            ));
        }
        let message = match instant.status {
            Status::NotConverged => Some(format!(
                "instant {number} did not converge beyond {:.1} % of its step; node pairs (lower, upper) {} moved most. \
                 Give instants closer together, a finer mesh, or a law whose peak traction ({:.0} MPa) is lower",
                100.0 * instant.failure.map_or(0.0, |failure| failure.share),
                pairs.iter().map(|[lower, upper]| format!("({lower}, {upper})")).collect::<Vec<_>>().join(" "),
                self.law.peak().normal
            )),
            Status::NotReached => Some("an earlier instant did not converge".to_owned()),
            Status::Converged | Status::Rescued => None,
        };
        InstantSummary {
            instant: number,
            status: instant.status.name(),
            newton_iterations: instant.iterations,
            halvings: instant.halvings,
            rescue: instant.status == Status::Rescued,
            rescue_steps: instant.rescue_iterations,
            residual: instant.residual,
            crack_front_mm: if converged { self.model.crack_front(&*self.law, &instant.displacement) } else { None },
            largest_strip_rotation_rad: rotation,
            snapped_pairs: pairs,
            message,
            warnings,
        }
    }
}

/// Where the mesh comes from.
enum Source {
    Mesh { mesh: Box<JointMesh>, by_position: bool },
    Store { store: Box<Store>, mesh: Box<JointMesh>, mm: f64 },
}

impl Source {
    fn of(case: &CaseJointMesh, base: &Path) -> Result<Self> {
        let sizes = (case.element_size_mm, case.columns, case.rows, case.gap_mm);
        let any_size = sizes.0.is_some() || sizes.1.is_some() || sizes.2.is_some() || sizes.3.is_some();
        match (&case.file, &case.store, sizes) {
            (Some(file), None, _) if !any_size => {
                let path = base.join(file);
                let read = read_joint_mesh(&path)?;
                let parts = JointParts {
                    nodes: read.nodes,
                    elements: read.elements,
                    interfaces: read.interfaces.clone().unwrap_or_default(),
                    groups: read.groups,
                    element_group: read.element_group,
                };
                let made =
                    if read.interfaces.is_some() { JointMesh::new(parts) } else { JointMesh::from_strips(parts) };
                let mesh = made.map_err(|fault| format!("{}: {fault}", path.display()))?;
                Ok(Self::Mesh { mesh: Box::new(mesh), by_position: read.by_position })
            }
            (None, Some(name), _) if !any_size => {
                let (store, mm) = open_store(&base.join(name))?;
                let measured = store.mesh();
                let nodes: Vec<[f64; 2]> = measured.nodes().iter().map(|&[x, y]| [x * mm, -y * mm]).collect();
                let parts = JointParts {
                    elements: measured.elements().iter().map(|&corners| counter_clockwise(corners, &nodes)).collect(),
                    nodes,
                    interfaces: Vec::new(),
                    groups: measured.zones().to_vec(),
                    element_group: measured.element_zone().to_vec(),
                };
                let mesh = JointMesh::from_strips(parts).map_err(|fault| format!("{name}: {fault}"))?;
                Ok(Self::Store { store: Box::new(store), mesh: Box::new(mesh), mm })
            }
            (None, None, (Some(size), Some(columns), Some(rows), Some(gap))) => {
                let mesh =
                    JointMesh::rectangular(columns, rows, size, gap).map_err(|fault| format!("[mesh] {fault}"))?;
                Ok(Self::Mesh { mesh: Box::new(mesh), by_position: false })
            }
            _ => {
                Err("[mesh] needs file = \"mesh.json\", or store = \"run/fields.zarr\", or element_size_mm, columns, \
                      rows and gap_mm together"
                    .into())
            }
        }
    }

    fn mesh(&self) -> Result<JointMesh> {
        match self {
            Self::Mesh { mesh, .. } | Self::Store { mesh, .. } => Ok((**mesh).clone()),
        }
    }

    fn by_position(&self) -> bool {
        matches!(self, Self::Mesh { by_position: true, .. })
    }
}

/// The store of a correlation run (its folder or `fields.zarr` itself), and mm per px.
fn open_store(path: &Path) -> Result<(Store, f64)> {
    let folder: PathBuf = match path.file_name() {
        Some(name) if name == STORE => path.parent().unwrap_or(Path::new(".")).to_owned(),
        _ => path.to_owned(),
    };
    let folder = if folder.as_os_str().is_empty() { PathBuf::from(".") } else { folder };
    let store = Store::open(&folder)?;
    let mm = store.header().pixel_size.ok_or_else(|| {
        format!("{}: the run has no pixel size; correlate again with --pixel-size MM", path.display())
    })?;
    Ok((store, mm.mm_per_px()))
}

/// The prescribed displacements of a table, for the nodes of `mesh`.
fn from_table(path: &Path, mesh: &JointMesh, by_position: bool) -> Result<BoundaryHistory> {
    let table = read_boundary(path)?;
    let tolerance = 1e-6 * mesh.element_size();
    let far = |node: usize, at: [f64; 2]| {
        let x = mesh.nodes()[node];
        (x[0] - at[0]).abs() > tolerance || (x[1] - at[1]).abs() > tolerance
    };
    let mut nodes = Vec::with_capacity(table.nodes.len());
    for (&node, &at) in table.nodes.iter().zip(&table.positions) {
        let named = (node as usize) < mesh.nodes().len() && !far(node as usize, at);
        if named {
            nodes.push(node);
        } else if by_position && let Some(found) = (0..mesh.nodes().len()).find(|&node| !far(node, at)) {
            nodes.push(found as u32);
        } else {
            let [x, y] = at;
            let there = mesh.nodes().get(node as usize).map_or_else(
                || format!("the mesh has {} nodes", mesh.nodes().len()),
                |[x, y]| format!("the mesh has it at ({x}, {y}) mm"),
            );
            return Err(format!(
                "{}: node {node} at ({x}, {y}) mm is not a node of the mesh: {there}; nodes are counted from 0, y is up",
                path.display()
            )
            .into());
        }
    }
    BoundaryHistory::new(nodes, table.instants).map_err(|fault| format!("{}: {fault}", path.display()).into())
}

/// The measured displacements of the outer nodes, frame by frame.
fn from_store(path: &Path, source: &Source, mesh: &JointMesh) -> Result<BoundaryHistory> {
    let Source::Store { store, mm, .. } = source else {
        return Err("[boundary] store needs [mesh] store, the same run".into());
    };
    let (other, _) = open_store(path)?;
    if other.path() != store.path() {
        return Err("[boundary] store and [mesh] store must be the same run".into());
    }
    let nodes = mesh.outer_nodes();
    let mut instants = Vec::new();
    for number in 1..=store.n_frames() {
        let Some(frame) = store.frame(number)? else { continue };
        let field = frame.measurement;
        if let Some(&node) = nodes.iter().find(|&&node| !field.measured[node as usize]) {
            return Err(format!(
                "{}: frame {number} has no displacement at node {node} of the outer border; correlate with fewer frames or \
                 another region",
                path.display()
            )
            .into());
        }
        let at = |&node: &u32| {
            let [x, y] = field.displacement[node as usize];
            // y down in the image, up in mechanics: the one place of this command where it turns.
            [x * mm, -y * mm]
        };
        instants.push(nodes.iter().map(at).collect());
    }
    BoundaryHistory::new(nodes, instants).map_err(|fault| format!("{}: {fault}", path.display()).into())
}

/// The number under `key`.
fn number(table: &Table, section: &str, key: &str, model: &str, needed: &str) -> Result<f64> {
    match table.get(key) {
        Some(Value::Float(value)) => Ok(*value),
        Some(Value::Integer(value)) => Ok(*value as f64),
        Some(other) => Err(format!("[{section}] {key} = {other}: give a number").into()),
        None => Err(format!("[{section}] {key} is missing; model = \"{model}\" needs {needed}").into()),
    }
}

/// The text under `key`.
fn text<'a>(table: &'a Table, section: &str, key: &str) -> Result<Option<&'a str>> {
    match table.get(key) {
        None => Ok(None),
        Some(Value::String(value)) => Ok(Some(value)),
        Some(other) => Err(format!("[{section}] {key} = {other}: give a name in quotes").into()),
    }
}

/// The values of a law's parameters, when no other keys are there than those and `others`.
fn values(table: &Table, section: &str, model: &str, parameters: &[Parameter], others: &[&str]) -> Result<Vec<f64>> {
    let keys: Vec<String> = parameters.iter().map(Parameter::key).collect();
    let needed = keys.join(", ");
    let known = |key: &String| keys.contains(key) || others.contains(&key.as_str());
    if let Some(key) = table.keys().find(|key| !known(key)) {
        let others = others.join(", ");
        return Err(format!(
            "[{section}] {key}: there is no such key; model = \"{model}\" needs {needed}; also {others}"
        )
        .into());
    }
    keys.iter().map(|key| number(table, section, key, model, &needed)).collect()
}

fn cohesive(table: &Table) -> Result<(Box<dyn CohesiveLaw>, Kinematics, Quadrature)> {
    let model = text(table, "cohesive", "model")?.unwrap_or("extended-xu-needleman");
    let parameters = parameters_by_name(model)?;
    let values = values(table, "cohesive", model, parameters, &["model", "kinematics", "quadrature"])?;
    let kinematics = match text(table, "cohesive", "kinematics")? {
        None | Some("paper") => Kinematics::Paper,
        Some("objective") => Kinematics::Objective,
        Some(other) => {
            return Err(format!("[cohesive] kinematics = \"{other}\"; give \"paper\" or \"objective\"").into());
        }
    };
    let quadrature = match text(table, "cohesive", "quadrature")? {
        None | Some("newton-cotes") => Quadrature::NewtonCotes,
        Some("gauss") => Quadrature::Gauss,
        Some(other) => {
            return Err(format!("[cohesive] quadrature = \"{other}\"; give \"newton-cotes\" or \"gauss\"").into());
        }
    };
    Ok((law_by_name(model, &values)?, kinematics, quadrature))
}

/// One material for each group: that of `[substrate.NAME]`, else that of `[substrate]`.
fn materials(table: &Table, groups: &[String]) -> Result<Vec<Arc<dyn SubstrateLaw>>> {
    let plain: Table = table.iter().filter(|(_, v)| !v.is_table()).map(|(k, v)| (k.clone(), v.clone())).collect();
    let own: HashMap<&String, &Table> = table.iter().filter_map(|(k, v)| Some((k, v.as_table()?))).collect();
    if let Some(name) = own.keys().find(|name| !groups.contains(name)) {
        let there = groups.join(", ");
        return Err(
            format!("[substrate.{name}]: the mesh has no group of elements of that name; it has {there}").into()
        );
    }
    let plane_of = |table: &Table, section: &str| -> Result<Option<PlaneState>> {
        match text(table, section, "plane")? {
            None => Ok(None),
            Some("stress") => Ok(Some(PlaneState::PlaneStress)),
            Some("strain") => Ok(Some(PlaneState::PlaneStrain)),
            Some(other) => Err(format!("[{section}] plane = \"{other}\"; give \"stress\" or \"strain\"").into()),
        }
    };
    let common = plane_of(&plain, "substrate")?;
    let make = |table: &Table, section: &str| -> Result<Arc<dyn SubstrateLaw>> {
        let model = text(table, section, "model")?.unwrap_or("ramberg-osgood");
        let parameters = substrate_parameters(model)?;
        let values = values(table, section, model, parameters, &["model", "plane"])?;
        let plane = plane_of(table, section)?.or(common).unwrap_or_default();
        Ok(Arc::from(substrate_by_name(model, &values, plane)?))
    };
    groups
        .iter()
        .map(|group| match own.get(group) {
            Some(table) => make(table, &format!("substrate.{group}")),
            None => make(&plain, "substrate"),
        })
        .collect()
}
