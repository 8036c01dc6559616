//! An identification as its case file describes it.

use crate::field::NOISE_CONTRADICTED;
use crate::identify::cases::error::{check_amount, positive, refuse_if};
use crate::identify::cases::uncertainties;
use crate::identify::doubt::remarks;
use crate::identify::laws::tournament::check_laws;
use crate::identify::objective::observation::remove_motion;
use crate::identify::{
    Asked, Border, CameraChange, FitError, FitOptions, FitWatch, LoadCell, Noise, Observation, ObservedInstant,
    OfMaterial, Precision, Problem, TrustRegionOptions, Unknown, Unknowns, even_texture, implausible_joint,
    largest_without_rigid_motion, latin_hypercube, prescribed_of, unless_meant, wrong,
};
use crate::io::case::{
    BorderKind, BoundaryNoise, CaseBootstrap, CaseFit, CaseMeasurement, CaseNodes, CasePathControl, CaseSubstrate,
    Discretisation, Intervals, WeightKind,
};
use crate::io::joint::{
    BoundaryInput, JointInput, JointMeshFile, JointRun, MeasurementInput, MeasurementTable, MeshInput, RunCamera,
    RunMatrix,
};
use crate::io::run_case::RunCase;
use crate::mechanics::cohesive::CohesiveLaw;
use crate::mechanics::substrate::SubstrateLaw;
use crate::mechanics::{Joint, law_of_case, materials_of_case};
use crate::remark::Remark;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::Path;
use std::sync::Arc;

/// What a case file says about the identification of its joint.
#[derive(Debug)]
pub struct Case<'a> {
    /// What is to be solved.
    pub problem: Problem<'a>,
    /// How.
    pub options: FitOptions,
    /// The parameter whose profile likelihood is asked for.
    pub profile: Option<usize>,
    /// The parameter that `sweep` prescribes, and its values.
    pub sweep: Option<(usize, Vec<f64>)>,
    /// The laws that are compared on the same data; none where that is not asked for.
    pub laws: Vec<String>,
    /// What is compared, for people.
    pub about: String,
    /// What is known of the boundary.
    pub boundary: BoundaryNoise,
    /// What is possible, but hardly meant.
    pub remarks: Vec<Remark>,
    /// Time after which the fit ends at the best point so far, s.
    pub max_seconds: Option<f64>,
}

/// The share `v` of a deformed image's noise that acts through the noise of the reference's gradient: its mean over
/// sub-pixel displacements along both axes, quintic interpolation (1 at whole pixels, 0.74 halfway).
const NOISE_PASSED: f64 = 0.87;

impl<'a> Case<'a> {
    /// The joint of a case.
    ///
    /// # Errors
    /// See [`crate::mechanics::JointError`].
    pub fn joint(input: &JointInput) -> Result<Joint, FitError> {
        Joint::new(input).map_err(|error| FitError::from(error).in_case(&input.case.text))
    }

    /// What is to be identified of `joint`, which [`Case::joint`] made of the same `input`; `path` is named in errors.
    ///
    /// # Errors
    /// See [`FitError`].
    pub fn new(joint: &'a Joint, input: &JointInput, path: &Path) -> Result<Self, FitError> {
        Self::of(joint, input, path).map_err(|error| error.in_case(&input.case.text))
    }

    /// The load cell of a case, to be held against a prediction; `None` where there is none.
    ///
    /// # Errors
    /// See [`FitError`].
    pub fn load_cell(joint: &Joint, input: &JointInput, found: &mut Vec<Remark>) -> Result<Option<LoadCell>, FitError> {
        let (Some(asked), Some(read)) = (&input.case.force, &input.force) else { return Ok(None) };
        let made = LoadCell::new(joint, asked, read, false, found);
        made.map(Some).map_err(|error| error.in_case(&input.case.text))
    }

    /// Whether the laws, materials and parameters of a case are some that there are: what can be told before anything
    /// is measured.
    ///
    /// # Errors
    /// See [`FitError`].
    pub fn check(case: &RunCase) -> Result<(), FitError> {
        let checked = || {
            let (Some(cohesive), Some(substrate)) = (&case.joint.cohesive, &case.joint.substrate) else {
                return Ok(());
            };
            let (law, ..) = law_of_case(cohesive)?;
            let materials = materials_of_case(substrate, &case.interface.zones)?;
            if let Some(fit) = &case.joint.fit {
                starts(&unknowns(&*law, (&materials, &case.interface.zones), substrate, fit)?, fit)?;
                if !fit.laws.is_empty() {
                    check_laws(&fit.laws, &*law, usize::MAX)?;
                }
            }
            Ok(())
        };
        checked().map_err(|error: FitError| error.in_case(&case.text))
    }

    fn of(joint: &'a Joint, input: &JointInput, path: &Path) -> Result<Self, FitError> {
        let missing = |section: &str, hint: &str| {
            FitError::Data(format!("{}: there is no table [{section}]; {hint}", path.display()))
        };
        let case = &input.case;
        let used = case.force.as_ref().is_some_and(|force| force.used);
        let nothing = CaseMeasurement::default();
        let (measurement, measured) = match (&case.measurement, &input.measurement) {
            (Some(measurement), Some(measured)) => (measurement, Some(measured)),
            // The load curve alone.
            (measurement, None) if used => (measurement.as_ref().unwrap_or(&nothing), None),
            _ => {
                let hint =
                    "give file = \"measured.csv\" or store = \"run/fields.zarr\"; or [force] for a load curve alone";
                return Err(missing("measurement", hint));
            }
        };
        let Some(table) = &case.fit else {
            return Err(missing("fit", "give parameters = [\"phi_n\", \"delta_n\", \"delta_t\"]"));
        };
        let mut found = Vec::from_iter(table.shared.as_ref().map(|_| remarks::shared_unused()));
        let unknowns =
            unknowns(&*joint.law, (joint.model.materials(), joint.model.mesh().groups()), &case.substrate, table)?;
        if joint.law.has_own_minima() && table.intervals == Some(Intervals::Linear) {
            found.push(remarks::own_minima(joint.law.name()));
        }
        let cell = match (&case.force, &input.force) {
            (Some(asked), Some(read)) => Some(LoadCell::new(joint, asked, read, used, &mut found)?),
            _ => None,
        };
        let of_run = matches!(measured, Some(MeasurementInput::Run(_)));
        let weights = weight_kind(measurement, of_run, used)?;
        let boundary = boundary_noise(measurement, measured, weights, joint)?;
        check_boundary(input, boundary, weights)?;
        let noisy = boundary != BoundaryNoise::Exact;
        if let Some(MeasurementInput::Run(run)) = measured {
            found.extend(run.warnings.iter().map(|warning| warning.clone().after("the correlation warned: ")));
        }
        let (mut observation, mut noise) = match measured {
            Some(measured) => {
                let observation = observation(joint, input, measurement, measured, noisy, &mut found)?;
                let noise = noise(joint, measurement, measured, &observation, noisy, &mut found)?;
                (observation, noise)
            }
            None => of_force_alone(joint, measurement)?,
        };
        match cell {
            Some(cell) if used => (observation, noise) = with_force(observation, noise, cell, &mut found)?,
            cell => observation.held = cell,
        }
        check_weights(&observation, weights)?;
        let n_data = observation.n_data();
        check_amount(n_data, unknowns.n())?;
        let options = FitOptions {
            weights,
            estimate_boundary: boundary == BoundaryNoise::Estimated,
            starts: starts(&unknowns, table)?,
            direct: None,
            region: TrustRegionOptions {
                max_evaluations: table.max_evaluations.unwrap_or(TrustRegionOptions::default().max_evaluations),
                ..TrustRegionOptions::default()
            },
            constants: uncertainties::constants(
                joint,
                input,
                table,
                measurement,
                observation.force.as_ref(),
                &mut found,
            )?,
            doubt: true,
            release: true,
            other_minima: true,
            judge_rotations: uncertainties::judge_rotations(table),
            discretisation: discretisation(table, of_run),
            intervals: table.intervals.unwrap_or_default(),
            bootstrap: bootstrap(table)?,
        };
        let (profile, sweep) = (profile_index(&unknowns, table)?, sweep_of(&unknowns, table)?);
        if !table.laws.is_empty() {
            check_laws(&table.laws, unknowns.law(), n_data)?;
        }
        let border = border(joint, measurement, &observation, &noise, &mut found)?;
        let about = describe(&observation, &noise, weights, &format!("{boundary} boundary{}", border.in_words()));
        let (observation, border, noise) = (Arc::new(observation), Arc::new(border), Arc::new(noise));
        let problem = Problem { joint, observation, border, noise, unknowns, watch: FitWatch::default() };
        let implausible = implausible_joint(&problem, problem.observation.pixel_size_mm);
        found.extend(unless_meant(implausible, &table.meant)?);
        let max_seconds = table.max_seconds.map(|seconds| positive("fit", "max_seconds", seconds)).transpose()?;
        Ok(Self {
            problem,
            options,
            profile,
            sweep,
            laws: table.laws.clone(),
            about,
            boundary,
            remarks: found,
            max_seconds,
        })
    }
}

/// The weights that the case asks for; `of_run` says whether a run was measured, `used` whether the load cell takes
/// part.
fn weight_kind(measurement: &CaseMeasurement, of_run: bool, used: bool) -> Result<WeightKind, FitError> {
    match measurement.weights {
        Some(WeightKind::Paper | WeightKind::Uniform) if used => {
            let what = "weights: with [force] displacements and forces are weighed by their noise; give weights = \
                        \"covariance\", or [force] use = false";
            Err(wrong("measurement", "weights", what))
        }
        None if of_run || used => Ok(WeightKind::Covariance),
        asked => Ok(asked.unwrap_or(WeightKind::Paper)),
    }
}

fn boundary_noise(
    measurement: &CaseMeasurement,
    measured: Option<&MeasurementInput>,
    weights: WeightKind,
    joint: &Joint,
) -> Result<BoundaryNoise, FitError> {
    let is_measured = measured.is_some();
    // Noise of the border pulls constants of a body down; as unknowns it does not (THEORY 24).
    let of_body = matches!(measured, Some(MeasurementInput::Run(_))) && joint.model.mesh().interfaces().is_empty();
    let usual = match of_body && weights == WeightKind::Covariance {
        true => BoundaryNoise::Estimated,
        false => BoundaryNoise::default(),
    };
    match measurement.boundary {
        Some(BoundaryNoise::Measured | BoundaryNoise::Estimated) if !is_measured => {
            let what =
                "boundary: without measured displacements the border is taken as it is; give boundary = \"exact\"";
            Err(wrong("measurement", "boundary", what))
        }
        None if !is_measured => Ok(BoundaryNoise::Exact),
        asked => Ok(asked.unwrap_or(usual)),
    }
}

/// Refuses a control of the path, supports and weights that do not go with a fit on such a boundary.
fn check_boundary(input: &JointInput, boundary: BoundaryNoise, weights: WeightKind) -> Result<(), FitError> {
    let follows = input.case.path.control == Some(CasePathControl::ArcLength);
    let what = "control = \"arc-length\" is for quadrille simulate: a fit compares instants of the test";
    refuse_if(follows, "path", "control", what)?;
    let driven = !input.drives.is_empty() && boundary != BoundaryNoise::Exact;
    let what = "boundary = \"exact\" is needed with [[support]] and [[applied_load]], which are given and not measured";
    refuse_if(driven, "measurement", "boundary", what)?;
    let uncovered = boundary == BoundaryNoise::Estimated && weights != WeightKind::Covariance;
    refuse_if(uncovered, "measurement", "boundary", "boundary = \"estimated\" needs weights = \"covariance\"")
}

/// The border that the case asks for.
fn border(
    joint: &Joint,
    measurement: &CaseMeasurement,
    observation: &Observation,
    noise: &Noise,
    found: &mut Vec<Remark>,
) -> Result<Border, FitError> {
    let asked = measurement.border.unwrap_or_default();
    if asked == BorderKind::Free {
        return Ok(Border::free(joint));
    }
    let forced = asked == BorderKind::Smooth;
    let refuse = |is_wrong: bool, why: &str| {
        refuse_if(forced && is_wrong, "measurement", "border", format!("border = \"smooth\" {why}"))
    };
    refuse(observation.prescribed.is_empty(), "needs a noisy border; give boundary = \"measured\" or \"estimated\"")?;
    refuse(noise.sigma.is_none(), "needs a known noise, with which the degrees are chosen; give noise_mm")?;
    let (border, remark) = Border::by_evidence(joint, observation, noise, forced);
    refuse(border.smooth.is_none(), "leaves nothing of so few nodes at the border; give border = \"free\"")?;
    found.extend(remark);
    Ok(border)
}

fn discretisation(table: &CaseFit, of_run: bool) -> Discretisation {
    let usual = if of_run { Discretisation::Included } else { Discretisation::Stated };
    table.discretisation.unwrap_or(usual)
}

fn bootstrap(table: &CaseFit) -> Result<Option<usize>, FitError> {
    match table.bootstrap.unwrap_or_default() {
        CaseBootstrap::Auto => Ok(None),
        CaseBootstrap::Draws(draws @ 0..=10_000) => Ok(Some(draws as usize)),
        CaseBootstrap::Draws(draws) => {
            let what = format!("bootstrap = {draws}; give \"auto\" or a number of draws from 0 to 10000");
            Err(wrong("fit", "bootstrap", what))
        }
    }
}

fn profile_index(unknowns: &Unknowns, table: &CaseFit) -> Result<Option<usize>, FitError> {
    let Some(name) = &table.profile else { return Ok(None) };
    let what = "profile needs two parameters or more: of one alone the interval says it all";
    refuse_if(unknowns.n() == 1, "fit", "profile", what)?;
    let of_fit = unknowns.list().iter().position(|unknown| unknown.parameter.name == name);
    let missing = || wrong("fit", "profile", format!("profile = \"{name}\": it is not among parameters"));
    of_fit.ok_or_else(missing).map(Some)
}

fn sweep_of(unknowns: &Unknowns, table: &CaseFit) -> Result<Option<(usize, Vec<f64>)>, FitError> {
    let wrong_sweep = |what: String| Err(wrong("fit", "sweep", what));
    let mut sweeps = table.sweep.iter();
    let (name, values) = match (sweeps.next(), sweeps.next()) {
        (None, _) => return Ok(None),
        (Some(sweep), None) => sweep,
        _ => return wrong_sweep("sweep: give the values of one parameter".to_owned()),
    };
    let Some(index) = unknowns.law().parameters().iter().position(|p| p.name == name) else {
        return wrong_sweep(format!("sweep: the law has no parameter '{name}'; it has {}", names(unknowns)));
    };
    let what = format!("sweep: {name} is fitted; take it out of parameters to prescribe it");
    refuse_if(unknowns.list().iter().any(|unknown| unknown.index == index), "fit", "sweep", what)?;
    let what = format!("sweep: {name} has no values; give a list such as [3, 4, 5, 6]");
    refuse_if(values.is_empty(), "fit", "sweep", what)?;
    Ok(Some((index, values.clone())))
}

/// What is compared, for people.
fn describe(observation: &Observation, noise: &Noise, weights: WeightKind, boundary: &str) -> String {
    let n_compared = observation.compared.iter().filter(|c| **c).count();
    let compared = match (n_compared, &observation.force) {
        (0, _) => String::new(),
        (n, None) => format!("{n} nodes"),
        (n, Some(_)) => format!("{n} nodes and "),
    };
    let force = observation.force.as_ref().map_or(String::new(), |cell| format!("the load of {}", cell.group.name));
    format!(
        "{compared}{force} at {} instants, {} weights, {boundary}; noise: {}",
        observation.instants.len(),
        weights.name(),
        noise.source
    )
}

fn names(unknowns: &Unknowns) -> String {
    unknowns.law().parameters().iter().map(|p| p.name).collect::<Vec<_>>().join(", ")
}

/// The unknowns: parameters of the law, and of the material of `[substrate]`.
fn unknowns(
    law: &dyn CohesiveLaw,
    (materials, names): (&[Arc<dyn SubstrateLaw>], &[String]),
    substrate: &CaseSubstrate,
    table: &CaseFit,
) -> Result<Unknowns, FitError> {
    // Groups with a table of their own keep what that says.
    let groups = substrate.without_own(names);
    let material = groups.first().map(|&first| &materials[first]);
    let of_law = law.parameters().iter().map(|p| p.name);
    let of_material = material.iter().flat_map(|material| material.parameters()).map(|p| p.name);
    let known: Vec<&str> = of_law.chain(of_material).collect();
    let n_law = law.parameters().len();
    let what = format!("parameters is empty; give some of {}", known.join(", "));
    refuse_if(table.parameters.is_empty(), "fit", "parameters", what)?;
    let mut of_materials = Vec::new();
    let mut list = Vec::new();
    let mut values = law.values();
    for (k, name) in table.parameters.iter().enumerate() {
        let Some(index) = known.iter().position(|known| known == name) else {
            let what = format!(
                "parameters: neither the law '{}' nor [substrate] has '{name}'; they have {}",
                law.name(),
                known.join(", ")
            );
            return Err(wrong("fit", "parameters", what));
        };
        let twice = table.parameters[..k].contains(name);
        refuse_if(twice, "fit", "parameters", format!("parameters: '{name}' stands there twice"))?;
        let place = match (index.checked_sub(n_law), material) {
            (Some(index), Some(material)) => {
                of_materials.push(OfMaterial { groups: groups.clone(), index });
                values.push(material.values()[index]);
                values.len() - 1
            }
            _ => index,
        };
        list.push((place, name));
    }
    for (key, map) in [("start", &table.start), ("lower", &table.lower), ("upper", &table.upper)] {
        for (name, value) in map {
            let what = format!(
                "{key}: neither the law '{}' nor [substrate] has '{name}'; they have {}",
                law.name(),
                known.join(", ")
            );
            refuse_if(!known.contains(&name.as_str()), "fit", key, what)?;
            let what =
                format!("{key}: '{name}' is not among parameters; its value stands in [cohesive] or [substrate]");
            refuse_if(!table.parameters.contains(name), "fit", key, what)?;
            let infinite = value.is_nan() || (key == "start" && value.is_infinite());
            refuse_if(infinite, "fit", key, format!("{key}: {name} = {value} is not a finite number"))?;
        }
    }
    let asked = |&(index, name): &(usize, &String)| {
        let given = |map: &BTreeMap<String, f64>| map.get(name).copied();
        (index, given(&table.start).unwrap_or(values[index]), given(&table.lower), given(&table.upper))
    };
    let list: Vec<Asked> = list.iter().map(asked).collect();
    let what = "laws: laws are compared beside strips that are known; take the parameters of [substrate] out";
    refuse_if(!(table.laws.is_empty() || of_materials.is_empty()), "fit", "laws", what)?;
    let unknowns = Unknowns::with_materials(law, materials, of_materials, &list)?;
    check_start(&unknowns, &unknowns.start())?;
    Ok(unknowns)
}

fn check_start(unknowns: &Unknowns, start: &[f64]) -> Result<(), FitError> {
    for (&Unknown { parameter, bounds: [lower, upper], .. }, &start) in unknowns.list().iter().zip(start) {
        if !(lower <= start && start <= upper) {
            return Err(FitError::StartOutside { name: parameter.name, start, lower, upper });
        }
    }
    Ok(())
}

fn starts(unknowns: &Unknowns, table: &CaseFit) -> Result<Vec<Vec<f64>>, FitError> {
    let mut starts = table.starts.clone();
    for start in &starts {
        let what = format!("starts: {} values for {} parameters", start.len(), unknowns.n());
        refuse_if(start.len() != unknowns.n(), "fit", "starts", what)?;
        check_start(unknowns, start)?;
    }
    if let Some(n) = table.latin_hypercube {
        let refuse_if = |is_wrong: bool, what: String| refuse_if(is_wrong, "fit", "latin_hypercube", what);
        let what = format!("latin_hypercube = {n}; give a number of starts from 1 to 1000");
        refuse_if(!(1..=1000).contains(&n), what)?;
        for name in unknowns.list().iter().map(|unknown| unknown.parameter.name) {
            let bounded = table.lower.contains_key(name) && table.upper.contains_key(name);
            refuse_if(!bounded, format!("latin_hypercube needs [fit.lower] and [fit.upper] of {name}"))?;
        }
        let [lower, upper] = unknowns.scaled_bounds();
        let open = lower.iter().chain(&upper).any(|z| !z.is_finite());
        refuse_if(open, "latin_hypercube needs finite bounds above zero".to_owned())?;
        let points = latin_hypercube(n, [&lower, &upper], table.seed.unwrap_or(1));
        starts.extend(points.iter().map(|z| unknowns.unscaled(z)));
    }
    Ok(starts)
}

/// Measured displacements by instant (from 0) and node, without the rigid motion where it is taken off; and what is
/// named when one is missing.
struct Fields<'a> {
    path: &'a Path,
    /// Whether a run measured them, not a table.
    of_run: bool,
    instants: Vec<(usize, Vec<Option<[f64; 2]>>)>,
}

fn fields<'a>(joint: &Joint, measured: &'a MeasurementInput, found: &mut Vec<Remark>) -> Result<Fields<'a>, FitError> {
    let n_nodes = joint.measured.mesh.nodes().len();
    let n_instants = joint.boundary.instants().len();
    let not_prescribed = |path: &Path, instant: usize| {
        FitError::Data(format!(
            "{}: instant {instant} is measured, but the boundary has {n_instants} instants; give its boundary, or take it out",
            path.display()
        ))
    };
    let mut fields = match measured {
        MeasurementInput::Table(MeasurementTable { path, instants }) => {
            let mut list = Vec::with_capacity(instants.len());
            for (&instant, rows) in instants {
                if instant > n_instants {
                    return Err(not_prescribed(path, instant));
                }
                let mut field = vec![None; n_nodes];
                for (&node, &u) in rows {
                    let Some(place) = field.get_mut(node as usize) else {
                        return Err(FitError::Data(format!(
                            "{}: instant {instant} has node {node}, but the mesh has {n_nodes} nodes (counted from 0)",
                            path.display()
                        )));
                    };
                    *place = Some(u);
                }
                list.push((instant - 1, field));
            }
            let missing = (1..=n_instants).filter(|k| !instants.contains_key(k)).collect();
            found.extend(remarks::instants_not_compared(missing, path));
            Fields { path, of_run: false, instants: list }
        }
        MeasurementInput::Run(run) => {
            if run.instants.len() != n_instants {
                return Err(not_prescribed(&run.path, run.instants.len()));
            }
            let instants = run.instants.iter().cloned().enumerate().collect();
            Fields { path: &run.path, of_run: true, instants }
        }
    };
    for (index, field) in &mut fields.instants {
        let Some(motion) = joint.removed.get(*index) else { continue };
        for (node, u) in field.iter_mut().enumerate() {
            *u = u.map(|u| remove_motion(motion, joint.measured.mesh.nodes()[node], u));
        }
    }
    Ok(fields)
}

/// The nodes whose displacements are compared with the model, in rising order.
fn compared_nodes(
    joint: &Joint,
    input: &JointInput,
    measurement: &CaseMeasurement,
    fields: &Fields<'_>,
    found: &mut Vec<Remark>,
) -> Result<Vec<u32>, FitError> {
    let n_nodes = joint.measured.mesh.nodes().len();
    let file: Option<&JointMeshFile> = match &input.mesh {
        MeshInput::File(file) | MeshInput::Run(file) => Some(file),
        MeshInput::Rectangle { .. } => None,
    };
    let selected = file.and_then(|file| file.selected.as_ref());
    let wrong_nodes = |what: String| Err(wrong("measurement", "nodes", what));
    let mut chosen: Vec<u32> = match (&measurement.nodes, selected) {
        (None | Some(CaseNodes::Selected), Some(list)) => list.clone(),
        (None | Some(CaseNodes::Free), _) => (0..n_nodes as u32).collect(),
        (Some(CaseNodes::Selected), None) => {
            let what = "nodes = \"selected\": the mesh has no list selected_nodes; give \"free\" or a list of numbers";
            return wrong_nodes(what.to_owned());
        }
        (Some(CaseNodes::List(list)), _) => list.clone(),
    };
    if let Some(node) = chosen.iter().find(|&&node| node as usize >= n_nodes) {
        return wrong_nodes(format!("nodes names node {node}; the mesh has {n_nodes} nodes, counted from 0"));
    }
    chosen.sort_unstable();
    chosen.dedup();
    let listed = matches!(measurement.nodes, Some(CaseNodes::List(_)));
    let n = chosen.len();
    let prescribed: HashSet<&u32> = joint.measured.prescribed.iter().collect();
    chosen.retain(|node| !prescribed.contains(node));
    if listed && chosen.len() < n {
        found.push(remarks::nodes_prescribed(n - chosen.len()));
    }
    if fields.of_run {
        // A node that one frame lost is left out of all: the covariance is one for all instants.
        let lost = |node: &u32| fields.instants.iter().any(|(_, field)| field[*node as usize].is_none());
        let n = chosen.len();
        chosen.retain(|node| !lost(node));
        if chosen.len() < n {
            found.push(remarks::nodes_lost(n - chosen.len()));
        }
    }
    if chosen.is_empty() {
        let what = "nothing is measured: no node is left to compare; choose others with [measurement] nodes";
        return Err(FitError::Data(what.to_owned()));
    }
    Ok(chosen)
}

/// The weights of the instants as the case gives them, the first ones alone where it gives fewer than there are.
fn instant_weights<'a>(
    joint: &Joint,
    measurement: &'a CaseMeasurement,
    measured: &MeasurementInput,
    found: &mut Vec<Remark>,
) -> Result<&'a [f64], FitError> {
    let factors = measurement.instant_weights.as_deref().unwrap_or_default();
    if let Some(factor) = factors.iter().find(|factor| !(factor.is_finite() && **factor >= 0.0)) {
        let what = format!("instant_weights holds {factor}; give finite numbers, zero or more");
        return Err(wrong("measurement", "instant_weights", what));
    }
    let (n_all, left_out) = match measured {
        MeasurementInput::Run(run) => (run.frames.len() + run.left_out.len(), run.left_out.as_slice()),
        MeasurementInput::Table(_) => (joint.boundary.instants().len(), [].as_slice()),
    };
    check_number(factors, n_all)?;
    if !(factors.is_empty() || left_out.is_empty()) {
        found.push(remarks::weights_shifted(left_out));
    }
    Ok(factors)
}

fn check_number(factors: &[f64], n_instants: usize) -> Result<(), FitError> {
    let what = format!("instant_weights has {} entries, but there are {n_instants} instants", factors.len());
    refuse_if(factors.len() > n_instants, "measurement", "instant_weights", what)
}

fn observation(
    joint: &Joint,
    input: &JointInput,
    measurement: &CaseMeasurement,
    measured: &MeasurementInput,
    noisy_boundary: bool,
    found: &mut Vec<Remark>,
) -> Result<Observation, FitError> {
    let mesh = &joint.measured.mesh;
    let n_nodes = mesh.nodes().len();
    let fields = fields(joint, measured, found)?;
    let mut compared = vec![false; n_nodes];
    let chosen = compared_nodes(joint, input, measurement, &fields, found)?;
    chosen.iter().for_each(|&node| compared[node as usize] = true);
    let given = prescribed_of(joint, &joint.boundary);
    let of_border: HashMap<u32, usize> =
        joint.measured.prescribed.iter().enumerate().map(|(k, &node)| (node, k)).collect();
    let nodes: Vec<u32> = (0..n_nodes as u32)
        .filter(|node| compared[*node as usize] || noisy_boundary && of_border.contains_key(node))
        .collect();
    let place: HashMap<u32, usize> = nodes.iter().enumerate().map(|(k, &node)| (node, k)).collect();
    let factors = instant_weights(joint, measurement, measured, found)?;
    let (mut instants, mut unknown_nodes) = (Vec::new(), 0);
    for (index, field) in &fields.instants {
        let factor = factors.get(*index).copied().unwrap_or(1.0);
        if factor == 0.0 {
            continue;
        }
        let border = |node: u32| of_border.get(&node).map(|&k| given[*index][k]);
        let mut displacement = Vec::with_capacity(2 * nodes.len());
        for &node in &nodes {
            let u = match compared[node as usize] {
                true => field[node as usize],
                // The prescribed displacement is the measured one.
                false => border(node),
            };
            let missing = || {
                FitError::Data(format!(
                    "{}: instant {} has no displacement of node {node}, which is compared; measure it, or leave it out with \
                     [measurement] nodes = [...]",
                    fields.path.display(),
                    index + 1
                ))
            };
            displacement.extend(u.ok_or_else(missing)?);
        }
        let known = |node: usize| field[node].or_else(|| border(node as u32)).map(|u| (mesh.nodes()[node], u));
        let points: Vec<_> = (0..n_nodes).filter_map(known).collect();
        unknown_nodes = unknown_nodes.max(n_nodes - points.len());
        let largest = largest_without_rigid_motion(&points);
        instants.push(ObservedInstant { index: *index, displacement, largest, factor });
    }
    if unknown_nodes > 0 && !fields.of_run {
        found.push(remarks::nodes_unmeasured(unknown_nodes));
    }
    if instants.is_empty() {
        let what = match fields.instants.is_empty() {
            true => "nothing is measured: there is no instant",
            false => "all weights are zero: [measurement] instant_weights leaves out every instant",
        };
        return Err(FitError::Data(what.to_owned()));
    }
    let prescribed = match noisy_boundary {
        true => joint.measured.prescribed.iter().map(|node| place[node]).collect(),
        false => Vec::new(),
    };
    let compared = nodes.iter().map(|&node| compared[node as usize]).collect();
    let pixel_size_mm = uncertainties::mm_per_px(input);
    let camera = camera_of(joint, input, measured);
    Ok(Observation { nodes, compared, prescribed, instants, pixel_size_mm, force: None, held: None, camera })
}

/// What the displacements of a run are off when its camera is. The rigid part goes with what was taken off of all.
fn camera_of(joint: &Joint, input: &JointInput, measured: &MeasurementInput) -> Vec<CameraChange> {
    let MeasurementInput::Run(run) = measured else { return Vec::new() };
    let is_of_border = matches!(input.boundary, BoundaryInput::Run(_));
    let turned = |(index, field): (usize, &Vec<[f64; 2]>)| {
        let (sin, cos) = joint.removed.get(index).map_or(0.0, |motion| motion.rotation_rad).sin_cos();
        field.iter().map(|[x, y]| [cos * x + sin * y, cos * y - sin * x]).collect()
    };
    let of_term = |term: &RunCamera| term.instants.iter().enumerate().map(turned).collect();
    run.camera.iter().map(|term| CameraChange { instants: of_term(term), is_of_border }).collect()
}

/// What is compared where no displacement was measured: no node, all instants of the border.
fn of_force_alone(joint: &Joint, measurement: &CaseMeasurement) -> Result<(Observation, Noise), FitError> {
    let factors = measurement.instant_weights.as_deref().unwrap_or_default();
    let n = joint.boundary.instants().len();
    if let Some(factor) = factors.iter().find(|factor| ![0.0, 1.0].contains(*factor)) {
        let what = format!("instant_weights holds {factor}; of a load curve alone they may be 0 or 1 only");
        return Err(wrong("measurement", "instant_weights", what));
    }
    check_number(factors, n)?;
    let instant = |index: usize| ObservedInstant { index, displacement: Vec::new(), largest: [0.0; 2], factor: 1.0 };
    let instants = (0..n).filter(|&index| factors.get(index) != Some(&0.0)).map(instant).collect();
    let (nodes, compared, prescribed) = (Vec::new(), Vec::new(), Vec::new());
    let (camera, force, held) = (Vec::new(), None, None);
    let observation = Observation { nodes, compared, prescribed, instants, pixel_size_mm: None, force, held, camera };
    let (precision, source) = (Precision::White(0), String::new());
    let noise = Noise { precision, common: 0.0, on_boundary: false, sigma: Some(1.0), source, ratio: None };
    Ok((observation, noise))
}

/// The same with the force of the load cell as one more row.
fn with_force(
    mut observation: Observation,
    mut noise: Noise,
    cell: LoadCell,
    found: &mut Vec<Remark>,
) -> Result<(Observation, Noise), FitError> {
    let Some(sigma) = noise.sigma else {
        let what = "noise_mm is missing: displacements and forces are weighed by their noise, and that of the displacements cannot be \
                    estimated from a residual that holds both";
        return Err(wrong("measurement", "noise_mm", what));
    };
    // Asked for where a load cell is made for a fit.
    let Some(std) = cell.std_n else { return Err(wrong("force", "std_N", "std_N is missing")) };
    let without: Vec<usize> = (observation.instants.iter())
        .filter(|instant| cell.at(instant.index).is_none())
        .map(|instant| instant.index + 1)
        .collect();
    let what = "there is no force at any instant that is compared; check the file, its column and its times";
    refuse_if(without.len() == observation.instants.len(), "force", "file", what)?;
    found.extend(remarks::force_unknown(without));
    if observation.nodes.is_empty() {
        // Rows of nothing would count as instants with data.
        observation.instants.retain(|instant| cell.at(instant.index).is_some());
    }
    observation.force = Some(cell);
    let joined = if noise.source.is_empty() { "" } else { "; " };
    noise.source = format!("{}{joined}force {std} N as given", noise.source);
    let weight = sigma * sigma / (std * std);
    noise.precision = Precision::WithForce { displacements: Box::new(noise.precision), weight };
    Ok((observation, noise))
}

fn check_weights(observation: &Observation, weights: WeightKind) -> Result<(), FitError> {
    if weights == WeightKind::Paper && observation.instants.iter().all(|i| i.largest == [0.0; 2]) {
        let what = "all weights are zero: the measured displacements are a rigid motion at every instant; give weights = \
                    \"uniform\"";
        return Err(FitError::Data(what.to_owned()));
    }
    let uneven = observation.instants.iter().any(|i| i.factor != 1.0);
    let what = "with weights = \"covariance\" instant_weights may be 0 or 1 only";
    refuse_if(weights == WeightKind::Covariance && uneven, "measurement", "instant_weights", what)
}

fn noise(
    joint: &Joint,
    measurement: &CaseMeasurement,
    measured: &MeasurementInput,
    observation: &Observation,
    on_boundary: bool,
    found: &mut Vec<Remark>,
) -> Result<Noise, FitError> {
    let given = measurement.noise_mm.map(|noise| positive("measurement", "noise_mm", noise)).transpose()?;
    let shared = measurement.common_reference.unwrap_or(true);
    match measured {
        MeasurementInput::Table(_) => {
            let common = if shared { 1.0 } else { 0.0 };
            let tied = if shared { "one noisy reference for all instants" } else { "instants independent" };
            let from = given.map_or("estimated from the residual".to_owned(), |noise| format!("{noise:e} mm as given"));
            Ok(Noise {
                precision: Precision::White(observation.n_rows()),
                common,
                on_boundary,
                sigma: given.map(|noise| noise / (1.0_f64 + common).sqrt()),
                source: format!("each displacement on its own, {tied}, {from}"),
                ratio: None,
            })
        }
        MeasurementInput::Run(run) => {
            let mesh = &joint.measured.mesh;
            let (matrix, of) = match &run.normal_matrix {
                Some(matrix) => (matrix.clone(), "normal matrix of the correlation"),
                None => {
                    found.push(remarks::normal_matrix_missing());
                    (even_texture(mesh.nodes(), mesh.elements()), "even texture")
                }
            };
            let [least, most] = NOISE_CONTRADICTED;
            if let Some(ratio) = run.noise_ratio.filter(|ratio| !(least..=most).contains(ratio)) {
                found.push(remarks::noise_contradicted(ratio));
            }
            let staged = observation.instants.iter().map(|instant| instant.index);
            let staged: Vec<usize> = staged.filter(|&instant| run.measured_from[instant] > 0).collect();
            found.extend(remarks::reference_later(run, &staged, observation.instants.len()));
            let precision_of = |matrix: &RunMatrix| {
                Precision::of_matrix(mesh.nodes(), &matrix.corners, &matrix.matrices, &observation.nodes)
            };
            let (texture, kappa) = matrix.without_noise(run.noise_grey.unwrap_or(0.0));
            let (precision, kappa) = match precision_of(&texture) {
                Ok(precision) => (precision, kappa),
                // Too little is left somewhere: the matrix with its noise says more than none.
                Err(_) => (precision_of(&matrix).map_err(|fault| FitError::Covariance { row: fault.node })?, 0.0),
            };
            // Of the reference `M0^-1 / k`, of each frame `M0^-1 M M0^-1`, about (1 + v kappa) M0^-1 (THEORY 10).
            let own = 1.0 + NOISE_PASSED * kappa;
            let common = if shared { 1.0 / (own * run.n_references as f64) } else { 0.0 };
            let mut noise =
                Noise { precision, common, on_boundary, sigma: None, source: String::new(), ratio: run.noise_ratio };
            let stated = stated_variances(run, observation);
            let from = match given {
                Some(given) => {
                    noise.sigma = Some((given * given / noise.mean_variance()).sqrt());
                    format!("{given:e} mm in the mean as given")
                }
                None => {
                    // Of logarithms: a node that hardly anything is seen of would be all of a mean of variances.
                    let ratios = stated.iter().zip(noise.variances()).filter(|(stated, _)| **stated > 0.0);
                    noise.sigma = geometric_mean(ratios.map(|(stated, own)| stated / own)).map(f64::sqrt);
                    match geometric_mean(stated.into_iter().filter(|stated| *stated > 0.0)) {
                        Some(stated) => format!("{:.3e} mm in the mean as the store states it", stated.sqrt()),
                        None => "estimated from the residual".to_owned(),
                    }
                }
            };
            noise.source = format!("{of}, mean of {} reference(s) for all frames, {from}", run.n_references);
            Ok(noise)
        }
    }
}

/// The variances that the store states for the rows, each in the mean over the instants, mm^2.
fn stated_variances(run: &JointRun, observation: &Observation) -> Vec<f64> {
    let n = observation.instants.len() as f64;
    let row = |node: u32, c: usize| {
        let sigma = observation.instants.iter().map(|instant| run.sigma[instant.index][node as usize][c]);
        sigma.map(|sigma| sigma * sigma).sum::<f64>() / n
    };
    observation.nodes.iter().flat_map(|&node| [row(node, 0), row(node, 1)]).collect()
}

/// The geometric mean of positive `values`; `None` without any.
fn geometric_mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, n) = values.fold((0.0, 0.0), |(sum, n), value| (sum + value.ln(), n + 1.0));
    (n > 0.0).then(|| f64::exp(sum / n))
}
