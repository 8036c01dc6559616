//! `testbed paper`: the numerical experiments of Fedele, Raka, Hild and Roux (2009) done again.

use super::args::PaperArgs;
use super::paper_text::markdown;
use super::{Outcome, Result, plural};
use quadrille::field::{RemoveRigid, remove_rigid};
use quadrille::identify::SweepRow;
use quadrille::io::joint::write_table;
use quadrille::io::run_case::read_run_case;
use quadrille::io::store::Store;
use quadrille::mechanics::cohesive::{CohesiveLaw, Traction};
use quadrille::mechanics::{Joint, Solution};
use quadrille::report::joint::{JointMap, JointProfiles, JointReport};
use quadrille::report::{Axis, Backdrop, MeshOptions, Picture, Plot, PlotSeries, Style, deformed_mesh};
use quadrille::run::{Existing, Plan, Request, RunFolder, Session, run_series};
use quadrille::virtual_test::{VirtualOptions, VirtualTest};
use quadrille_testbed::paper::{
    Experiment, LEVELS_PX, LevelFits, MEASURED_LAW, PaperError, REFERENCE_LAW, SWEEP_NOISE_PX, noisy_fits, summary,
    sweeps,
};
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{BufWriter, Write as _};
use std::path::Path;
use std::time::Instant;

const TABLES: &str = "tables.md";
/// Folder of the figures.
const FIGURES: &str = "figures";
/// Most draws.
const MOST_SEEDS: usize = 1000;
/// Instants of Figures 8 and 9.
const SHOWN: [usize; 4] = [4, 11, 15, 19];
/// Instants of Figure 11.
const PROFILES: [usize; 6] = [8, 10, 12, 14, 17, 19];
/// Instants of Figure 12.
const OVER_R: [usize; 4] = [8, 11, 14, 17];
/// Mode mixity is given where the traction exceeds this part of the peak in opening.
const LEAST_TRACTION: f64 = 0.02;
/// Magnification of the measured meshes: a pixel is hardly seen.
const MAGNIFY: f64 = 2.0;

/// Runs the command.
pub(super) fn run(args: &PaperArgs) -> Result<Outcome> {
    args.style.choose();
    if !(1..=MOST_SEEDS).contains(&args.seeds) {
        return Err(PaperError::Seeds { seeds: args.seeds, most: MOST_SEEDS }.into());
    }
    if args.output.join(TABLES).exists() && !args.overwrite {
        let path = args.output.display();
        return Err(format!(
            "{path}: holds the results of another run; choose another --output folder, or replace them with --overwrite"
        )
        .into());
    }
    let pool = args.threads.pool()?;
    fs::create_dir_all(args.output.join(FIGURES))?;
    let out = Output { folder: &args.output, begin: Instant::now() };

    out.say("a larger joint is pulled apart in the computer, adhesive with r = 6");
    let [phi_n, delta_n, delta_t] = REFERENCE_LAW;
    let with_r =
        |r: f64| VirtualOptions { law: [phi_n, delta_n, delta_t, r], seed: args.seed, ..VirtualOptions::default() };
    let six = pool.install(|| Experiment::of(&VirtualTest::new(with_r(6.0))?))?;
    pool.install(|| mechanics_figures(&out, &six))?;
    out.say("the virtual test, r = 4, and its images");
    let test = pool.install(|| VirtualTest::new(with_r(4.0)))?;
    make_virtual_test(&test, &args.output.join("virtual"))?;
    let four = pool.install(|| Experiment::of(&test))?;

    let mut table_1 = Vec::new();
    for (r, experiment) in [(6, &six), (4, &four)] {
        for s_px in LEVELS_PX {
            // Without noise all draws are one.
            let seeds = if s_px > 0.0 { args.seeds } else { 1 };
            let level = pool.install(|| noisy_fits(experiment, s_px, args.seed, seeds))?;
            out.say(&format!("Table 1, r = {r}: s = {s_px} px, {}", plural(seeds, "fit")));
            table_1.push((r, level));
        }
    }
    write_table_1(&out, &table_1)?;
    let first: Vec<&LevelFits> = table_1.iter().filter(|(r, _)| *r == 6).map(|(_, level)| level).collect();
    figure_10(&out, &first)?;

    out.say("the joint with the parameters of the experiment, r = 4");
    let measured = pool.install(|| Experiment::new(MEASURED_LAW))?;
    let clean = pool.install(|| sweeps(&measured, 0.0, args.seed, 1))?;
    let noisy = pool.install(|| sweeps(&measured, SWEEP_NOISE_PX, args.seed, args.seeds))?;
    out.say(&format!("Table 2: {} at 4 values of r", plural(args.seeds, "draw")));
    write_table_2(&out, &noisy)?;
    let (_, of_first) = &noisy[0];
    traction_figures(&out, measured.joint(), of_first)?;

    out.say("the images of the virtual test are correlated");
    let talk = image_figures(&out, &test, args)?;

    let text = markdown(args, &table_1, &clean, &noisy, talk);
    fs::write(args.output.join(TABLES), &text)?;
    let mut stdout = std::io::stdout().lock();
    // A reader that has gone away wants no more.
    let _ = stdout.write_all(text.as_bytes());
    out.say(&format!("tables and figures in {}", args.output.display()));
    // Under noise a draw whose fit runs to a bound is a result of the experiment, which the table counts.
    let fine = |level: &LevelFits| level.s_px > 0.0 || summary(level).inside == level.fits.len();
    Ok(if table_1.iter().all(|(_, level)| fine(level)) { Outcome::Fine } else { Outcome::Incomplete })
}

/// Writes the virtual test as `quadrille make virtual-test` does.
fn make_virtual_test(test: &VirtualTest, folder: &Path) -> Result<()> {
    let seed = test.options().seed.to_string();
    let words = ["quadrille", "make", "virtual-test", "--overwrite", "--seed", &seed, "--output"].map(OsString::from);
    match quadrille::cli::main_of(words.into_iter().chain([folder.into()])) {
        0 => Ok(()),
        _ => Err("the virtual test could not be made".into()),
    }
}

/// Where results go, and what is said meanwhile.
struct Output<'a> {
    folder: &'a Path,
    begin: Instant,
}

impl Output<'_> {
    fn say(&self, line: &str) {
        eprintln!("{:6.1} s  {line}", self.begin.elapsed().as_secs_f64());
    }

    fn save(&self, name: &str, picture: &Picture) -> Result<()> {
        let path = self.folder.join(FIGURES);
        picture.save(path.join(format!("{name}.png")))?;
        Ok(picture.save(path.join(format!("{name}.svg")))?)
    }

    fn table(&self, name: &str, what: &str, columns: &[&str], rows: Vec<(Vec<u64>, Vec<f64>)>) -> Result<()> {
        let notes = [
            format!("quadrille {}", env!("CARGO_PKG_VERSION")),
            format!("{what}; mm, MPa, N/mm; y up; instants from 1"),
        ];
        let columns: Vec<String> = columns.iter().map(|&name| name.to_owned()).collect();
        let mut out = BufWriter::new(File::create(self.folder.join(name))?);
        write_table(&mut out, &notes, &columns, rows.into_iter())?;
        Ok(out.flush()?)
    }
}

/// Figures 7 (mesh; coarse and fine profiles), 8 (deformed meshes) and 9 (sensitivities).
fn mechanics_figures(out: &Output<'_>, experiment: &Experiment) -> Result<()> {
    let (joint, solution) = (experiment.joint(), experiment.truth());
    let mesh = joint.model.mesh();
    let mut chosen = vec![0.0; mesh.nodes().len()];
    experiment.selected().iter().for_each(|&node| chosen[node as usize] = 1.0);
    let picture = JointMap {
        title: "Mesh of the model; the nodes that are compared".into(),
        label: "1 at the nodes of the objective".into(),
        notes: vec![format!(
            "{} elements of {:.1} \u{b5}m and {} of the adhesive, {} nodes, {} of them compared",
            mesh.elements().len(),
            1e3 * mesh.element_size(),
            mesh.interfaces().len(),
            mesh.nodes().len(),
            experiment.selected().len()
        )],
        nodes: mesh.nodes(),
        elements: mesh.elements(),
        values: &chosen,
    };
    out.save("figure-07-mesh", &picture.draw()?)?;

    let (fine, refined) = experiment.refined()?;
    let mut series = Vec::new();
    let mut rows = Vec::new();
    for (k, &instant) in SHOWN.iter().enumerate() {
        for (fineness, joint, solution) in [(1, joint, solution), (2, &fine, &refined)] {
            let (along, tractions) = tractions_of(joint, &*joint.law, solution, instant);
            let y: Vec<f64> = tractions.iter().map(|t| t.normal).collect();
            for (x, t) in along.iter().zip(&tractions) {
                rows.push((vec![instant as u64, fineness], vec![*x, t.normal, t.tangential]));
            }
            let style = if fineness == 1 { Style::Line } else { Style::Markers };
            let name = if fineness == 1 { format!("instant {instant}") } else { String::new() };
            series.push(PlotSeries { colour: Some(k), ..PlotSeries::new(name, style, along, y) });
        }
    }
    let plot = Plot {
        title: "Normal traction along the joint on two meshes".into(),
        x: Axis::linear("distance along the joint (mm)"),
        y: Axis::linear("T_n (MPa)"),
        series,
        notes: vec!["lines: the mesh of the measurement; markers: elements half as large".into()],
        ..Plot::default()
    };
    out.save("figure-07-profiles", &plot.draw()?)?;
    out.table(
        "figure-07-profiles.csv",
        "tractions on two meshes",
        &["instant", "refine", "along_mm", "Tn_MPa", "Tt_MPa"],
        rows,
    )?;

    let report = JointReport::new(joint, solution);
    let delta_t = solution.parameters.iter().position(|s| s.parameter.name == "delta_t");
    let mut rows = Vec::new();
    for instant in SHOWN {
        out.save(&format!("figure-08-instant-{instant:02}"), &report.deformed(instant)?)?;
        let Some(k) = delta_t else { continue };
        if let Some(picture) = report.sensitivity(instant, k, 0)? {
            out.save(&format!("figure-09-instant-{instant:02}"), &picture)?;
        }
        let field = &solution.instants[instant - 1];
        for (node, (u, du)) in field.displacement.iter().zip(&field.sensitivities[k]).enumerate() {
            let [x, y] = mesh.nodes()[node];
            rows.push((vec![instant as u64, node as u64], vec![x, y, u[0], u[1], du[0], du[1]]));
        }
    }
    let columns = ["instant", "node", "x_mm", "y_mm", "ux_mm", "uy_mm", "dux_ddelta_t", "duy_ddelta_t"];
    out.table("figure-08-09.csv", "displacements and their derivatives by delta_t", &columns, rows)
}

/// Distance along the joint, and tractions, at an instant.
fn tractions_of(
    joint: &Joint,
    law: &dyn CohesiveLaw,
    solution: &Solution,
    instant: usize,
) -> (Vec<f64>, Vec<Traction>) {
    let along = joint.model.pair_positions().into_iter().map(|(_, along)| along).collect();
    (along, joint.model.tractions(law, &solution.instants[instant - 1].displacement))
}

fn write_table_1(out: &Output<'_>, table: &[(u64, LevelFits)]) -> Result<()> {
    let mut rows = Vec::new();
    for (r, level) in table {
        for (seed, fit) in &level.fits {
            let bound = fit.parameters.iter().any(|p| p.at_bound);
            let mut values = vec![level.s_px];
            values.extend(fit.parameters.iter().map(|p| p.value));
            values.push(fit.omega);
            rows.push((vec![*r, *seed, fit.evaluations as u64, fit.rescued as u64, u64::from(bound)], values));
        }
    }
    let columns = [
        "r",
        "seed",
        "evaluations",
        "rescued",
        "at_bound",
        "s_px",
        "phi_n_N_per_mm",
        "delta_n_mm",
        "delta_t_mm",
        "omega",
    ];
    out.table("table-1.csv", "Table 1, one row for each fit", &columns, rows)
}

/// Figure 10: the objective against the iteration at each level of noise.
fn figure_10(out: &Output<'_>, levels: &[&LevelFits]) -> Result<()> {
    let (mut series, mut rows) = (Vec::new(), Vec::new());
    for level in levels {
        let Some((seed, fit)) = level.fits.first() else { continue };
        let accepted = fit.history.iter().filter(|step| step.accepted).filter_map(|step| step.omega);
        let omega: Vec<f64> = accepted.collect();
        let x = (0..omega.len()).map(|k| k as f64).collect();
        rows.extend(omega.iter().enumerate().map(|(k, omega)| (vec![k as u64, *seed], vec![level.s_px, *omega])));
        series.push(PlotSeries::new(format!("s = {} px", level.s_px), Style::LineAndMarkers, x, omega));
    }
    let plot = Plot {
        title: "Objective against iteration, r = 6".into(),
        x: Axis::linear("iteration"),
        y: Axis::log("omega").with_range(1e-8, 1e4),
        series,
        notes: vec!["without noise it goes on falling to the round-off of the model, below this axis".into()],
        ..Plot::default()
    };
    out.save("figure-10", &plot.draw()?)?;
    out.table("figure-10.csv", "objective against iteration, r = 6", &["iteration", "seed", "s_px", "omega"], rows)
}

fn write_table_2(out: &Output<'_>, sweeps: &[(u64, Vec<SweepRow>)]) -> Result<()> {
    let mut rows = Vec::new();
    for (seed, of_seed) in sweeps {
        for row in of_seed {
            let p: Vec<f64> = row.fit.parameters.iter().map(|p| p.value).collect();
            let stiffness = [p[0] / (p[1] * p[1]), 2.0 * row.value * p[0] / (p[2] * p[2])];
            let values = vec![p[0], p[1], p[2], row.value * p[0], stiffness[0], stiffness[1], row.fit.omega];
            rows.push((vec![row.value as u64, *seed, row.fit.evaluations as u64], values));
        }
    }
    let columns = [
        "r",
        "seed",
        "evaluations",
        "phi_n_N_per_mm",
        "delta_n_mm",
        "delta_t_mm",
        "phi_t_N_per_mm",
        "Kn_MPa_per_mm",
        "Kt_MPa_per_mm",
        "omega",
    ];
    out.table("table-2.csv", "Table 2, one row for each fit", &columns, rows)
}

/// Figures 11 and 12, and the mode mixity, of the fits with r prescribed.
fn traction_figures(out: &Output<'_>, joint: &Joint, sweep: &[SweepRow]) -> Result<()> {
    let mut rows = Vec::new();
    let mut of = Vec::new();
    for row in sweep {
        let law = joint.law.with_values(&row.fit.values)?;
        for instant in 1..=row.fit.solution().instants.len() {
            let (along, tractions) = tractions_of(joint, &*law, row.fit.solution(), instant);
            let u = &row.fit.solution().instants[instant - 1].displacement;
            let jumps = joint.model.jumps(u);
            let front = joint.model.crack_front(&*law, u);
            let least = LEAST_TRACTION * law.peak().normal;
            let mixity = |t: &Traction| match t.normal.hypot(t.tangential) > least {
                true => t.tangential.atan2(t.normal).to_degrees(),
                false => f64::NAN,
            };
            let mixity: Vec<f64> = tractions.iter().map(mixity).collect();
            for k in 0..along.len() {
                let (j, t) = (jumps[k], tractions[k]);
                rows.push((
                    vec![row.value as u64, instant as u64],
                    vec![along[k], j.normal, j.tangential, t.normal, t.tangential, mixity[k]],
                ));
            }
            of.push((row.value, instant, along, tractions, mixity, front));
        }
    }
    let columns = ["r", "instant", "along_mm", "Dn_mm", "Dt_mm", "Tn_MPa", "Tt_MPa", "mixity_deg"];
    out.table("figure-11-12.csv", "tractions of the identified models; mixity atan2(T_t, T_n)", &columns, rows)?;
    for (name, label, pick) in
        [("tn", "T_n (MPa)", (|t| t.normal) as fn(&Traction) -> f64), ("tt", "T_t (MPa)", |t| t.tangential)]
    {
        let shown = of.iter().filter(|(r, instant, ..)| *r == 4.0 && PROFILES.contains(instant));
        let instants: Vec<_> = shown
            .map(|(_, instant, _, tractions, _, front)| {
                (format!("instant {instant}"), tractions.iter().map(pick).collect(), *front)
            })
            .collect();
        let profiles = JointProfiles {
            title: format!("Traction along the joint as identified, r = 4, noise of {SWEEP_NOISE_PX} px"),
            label: label.into(),
            instants,
            along: of.first().map(|(_, _, along, ..)| along.clone()).unwrap_or_default(),
            notes: Vec::new(),
        };
        out.save(&format!("figure-11-{name}"), &profiles.draw()?)?;
        let mut series = Vec::new();
        for (k, &shown) in OVER_R.iter().enumerate() {
            for (r, _, along, tractions, ..) in of.iter().filter(|(_, instant, ..)| *instant == shown) {
                let style = if *r == 4.0 { Style::Line } else { Style::Dashed };
                let name = if *r == 4.0 { format!("instant {shown}, r = 4") } else { String::new() };
                let y = tractions.iter().map(pick).collect();
                series.push(PlotSeries { colour: Some(k), ..PlotSeries::new(name, style, along.clone(), y) });
            }
        }
        let plot = Plot {
            title: "Traction along the joint for r = 3 to 6".into(),
            x: Axis::linear("distance along the joint (mm)"),
            y: Axis::linear(label),
            series,
            notes: vec!["full: r = 4; dashed: r = 3, 5, 6".into()],
            ..Plot::default()
        };
        out.save(&format!("figure-12-{name}"), &plot.draw()?)?;
    }
    let series = (of.iter().filter(|(r, instant, ..)| *r == 4.0 && PROFILES.contains(instant)))
        .map(|(_, instant, along, _, mixity, _)| {
            PlotSeries::new(format!("instant {instant}"), Style::Line, along.clone(), mixity.clone())
        })
        .collect();
    let plot = Plot {
        title: "Mode mixity along the joint, r = 4".into(),
        x: Axis::linear("distance along the joint (mm)"),
        y: Axis::linear("atan2(T_t, T_n) (degrees)").with_range(0.0, 180.0),
        series,
        notes: vec!["0: pure opening; 90: pure sliding; beyond 90: compressed; none where the joint is open".into()],
        ..Plot::default()
    };
    out.save("mode-mixity", &plot.draw()?)
}

/// Figures 4 and 5: images and measured meshes without the rigid motion. Gives the number of frames that were
/// correlated, and the root mean square of measured less true displacement, px.
fn image_figures(out: &Output<'_>, test: &VirtualTest, args: &PaperArgs) -> Result<(usize, f64)> {
    let root = &args.output;
    let case = read_run_case(&root.join("virtual").join("case.toml"))?;
    let correlation = root.join("correlation");
    let plan = Plan::of(&Request { ..Request::default() }, &case.correlation)?;
    let session = Session::new(Existing::Replace);
    run_series(&plan, &RunFolder::open(&correlation, true)?, &args.threads.pool()?, session, &mut |_| ())?;
    let store = Store::open(&correlation)?;
    let (mut sum, mut n, mut rows) = (0.0, 0usize, Vec::new());
    let mut frames = 0;
    for number in 1..=store.n_frames() {
        let Some(frame) = store.frame(number)? else { continue };
        frames += 1;
        let measured = &frame.measurement;
        let exact = test.exact_at(number, measured.mesh.nodes());
        for node in (0..exact.len()).filter(|&node| measured.measured[node]) {
            let (u, [x, y]) = (measured.displacement[node], measured.mesh.nodes()[node]);
            sum += (u[0] - exact[node][0]).powi(2) + (u[1] - exact[node][1]).powi(2);
            n += 2;
            if SHOWN.contains(&number) {
                rows.push((vec![number as u64, node as u64], vec![x, y, u[0], u[1], exact[node][0], exact[node][1]]));
            }
        }
        if SHOWN.contains(&number) {
            let backdrop = Backdrop::new(&test.image_without_rigid_motion(number)?, 1);
            let (left, _) = remove_rigid(measured, RemoveRigid::All);
            let options =
                MeshOptions::new(format!("Instant {number}: measured mesh over the image, rigid motion removed"));
            out.save(&format!("figure-04-instant-{number:02}"), &deformed_mesh(&backdrop, true, &left, &options)?)?;
            let [width, height] = backdrop.size();
            let options = MeshOptions {
                magnify: Some(MAGNIFY),
                ..MeshOptions::new(format!("Instant {number}: measured mesh, rigid motion removed"))
            };
            let picture = deformed_mesh(&Backdrop::blank(width, height, 1), false, &left, &options)?;
            out.save(&format!("figure-05-instant-{number:02}"), &picture)?;
        }
    }
    let columns = ["instant", "node", "x_px", "y_px", "ux_px", "uy_px", "ux_true_px", "uy_true_px"];
    out.table("figure-05.csv", "measured and true displacements, px, y DOWN", &columns, rows)?;
    Ok((frames, (sum / n.max(1) as f64).sqrt()))
}
