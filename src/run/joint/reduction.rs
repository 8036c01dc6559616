//! A test of the standards, reduced without a model: from the fields of a run, or a table, to J and the traction
//! (THEORY 23).

use crate::camera::Rectifier;
use crate::field::{FacingPoint, FrameQuantities, Jump, NodalNoise, RegionValues, Value};
use crate::io::case::{CaseFile, CaseOpening, CaseQuantities, CaseReduction, CaseRegion, read_document};
use crate::io::load::{LoadColumn, LoadTable, read_table};
use crate::io::store::Store;
use crate::plane::Point;
use crate::reduction::{Instant, Layout, LoadedSection, Mode, Specimen, reduce as reduce_instants, sections};
use crate::remark::Remark;
use crate::report::ReductionRecord;
use crate::run::folder::record::Record;
use crate::run::folder::run_folder::{REDUCTION, RunFolder, correlation_in};
use crate::run::look::quantities::{load, resolve};
use crate::run::words::{Result, RunError};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Reduces the test of `[reduction]` in the case file `path` into the folder `output`.
///
/// # Errors
/// A case, fields or loads that cannot be read, a test that has nothing to be reduced, and files that cannot be
/// written.
pub fn reduce(path: &Path, output: &Path, overwrite: bool) -> Result<ReductionRecord> {
    let case = read_document(path)?.of_correlation()?;
    let asked = case.reduction.clone().ok_or_else(|| {
        format!("{}: there is no table [reduction]; give its layout, width_mm, and run or table", path.display())
    })?;
    let specimen = specimen(&asked)?;
    let ((instants, remarks), length_scale_std) = match (&asked.run, &asked.table) {
        (Some(run), None) => of_run(&case, &asked, &specimen, &case.resolve(run))?,
        (None, Some(table)) => (of_table(&asked, &case.resolve(table))?, 0.0),
        _ => return Err(wrong("give run (a folder of quadrille correlate) or table (a file), and not both")),
    };
    let specimen = Specimen { length_scale_std, ..specimen };
    let mut found = reduce_instants(&specimen, &instants).map_err(|error| format!("[reduction] {error}"))?;
    found.remarks.splice(0..0, remarks);
    let record = ReductionRecord::new(path.display().to_string(), &specimen, found);
    let is_output = |run: &String| {
        let places = [case.resolve(run).canonicalize(), output.canonicalize()];
        matches!(places, [Ok(run), Ok(output)] if run == output)
    };
    if asked.run.as_ref().is_some_and(is_output) {
        return Err(format!("{}: this is the run itself; choose another --output", output.display()).into());
    }
    let folder = RunFolder::for_joint(output, overwrite, false)?;
    folder.write("reduction.csv", |out| record.write_instants(out))?;
    if record.traction.is_some() {
        folder.write("traction.csv", |out| record.write_traction(out))?;
    }
    for (name, picture) in record.draw()? {
        folder.save_figure(name, &picture)?;
    }
    folder
        .write("report.html", |out| out.write_all(record.page().map_err(std::io::Error::other)?.html().as_bytes()))?;
    folder.write_json(REDUCTION, &record)?;
    Ok(record)
}

fn wrong(what: &str) -> RunError {
    format!("[reduction] {what}").into()
}

/// A number above zero with its standard uncertainty; none where it is not given.
fn given(key: &str, value: Option<f64>, std: Option<f64>) -> Result<Option<Value>> {
    if let Some(wrong) = value.filter(|v| !(v.is_finite() && *v > 0.0)) {
        return Err(format!("[reduction] {key} is {wrong}; give a number above zero").into());
    }
    if let Some(wrong) = std.filter(|v| !(v.is_finite() && *v >= 0.0)) {
        return Err(format!("[reduction] {key}_std is {wrong}; give a standard uncertainty, zero or above").into());
    }
    if value.is_none() && std.is_some() {
        return Err(format!("[reduction] {key}_std is given without {key}").into());
    }
    Ok(value.map(|value| Value { value, sigma: std.unwrap_or(0.0) }))
}

fn specimen(asked: &CaseReduction) -> Result<Specimen> {
    let layout = asked.layout;
    let width_mm = given("width_mm", Some(asked.width_mm), asked.width_mm_std)?;
    let number = |key: &str, value: Option<f64>| Ok::<_, RunError>(given(key, value, None)?.map(|value| value.value));
    number("force_std_N", asked.force_std_n)?;
    number("crack_opening_mm", asked.crack_opening_mm)?;
    let compliance = asked.machine_compliance_mm_per_n;
    if compliance.is_some() && asked.displacement.is_none() {
        return Err(wrong(
            "machine_compliance_mm_per_N is for the machine's displacement: name its column (displacement)",
        ));
    }
    number("machine_compliance_mm_per_N", compliance)?;
    let half_span_mm = number("half_span_mm", asked.half_span_mm)?;
    let lever_mm = number("lever_mm", asked.lever_mm)?;
    if layout == Layout::Mmb && (half_span_mm.is_none() || lever_mm.is_none()) {
        return Err(wrong(
            "layout = \"mmb\" needs half_span_mm and lever_mm: they say what share of the load acts where",
        ));
    }
    Ok(Specimen {
        layout,
        width_mm: width_mm.unwrap_or(Value { value: asked.width_mm, sigma: 0.0 }),
        arm_mm: given("arm_mm", asked.arm_mm, asked.arm_mm_std)?,
        crack_mm: given("crack_mm", asked.crack_mm, asked.crack_mm_std)?,
        half_span_mm,
        lever_mm,
        young_mpa: given("E_MPa", asked.young_mpa, asked.young_mpa_std)?,
        shear_mpa: number("G_MPa", asked.shear_mpa)?,
        load_scale_std: number("force_scale_std", asked.force_scale_std)?.unwrap_or(0.0),
        length_scale_std: 0.0,
    })
}

/// The column of the load, and what makes its largest magnitude positive.
fn force<'a>(asked: &CaseReduction, loads: &'a LoadTable, path: &Path) -> Result<(&'a LoadColumn, f64)> {
    let column = loads.force(asked.force.as_deref(), path)?;
    let largest = column.values.iter().flatten().copied().max_by(|a, b| a.abs().total_cmp(&b.abs()));
    match largest {
        None | Some(0.0) => Err(format!("{}: column {} has no load", path.display(), column.name).into()),
        Some(largest) => Ok((column, largest.signum())),
    }
}

fn exact(value: f64) -> Value {
    Value { value, sigma: 0.0 }
}

/// The displacement of the machine at the instants of `loads_n` (frame, load), less what it gives way; it grows towards
/// the largest load. `None` where none is asked for.
fn of_machine(asked: &CaseReduction, loads: &LoadTable, loads_n: &[(usize, f64)]) -> Result<Option<Vec<Option<f64>>>> {
    let Some(name) = &asked.displacement else { return Ok(None) };
    let called = |column: &&LoadColumn| column.name == *name || column.name_and_unit().0 == name;
    let column = loads.columns.iter().find(called).ok_or_else(|| {
        let there: Vec<&str> = loads.columns.iter().map(|column| column.name.as_str()).collect();
        format!("[reduction] displacement = \"{name}\": there is no such column; there are {}", there.join(", "))
    })?;
    if column.name_and_unit().1 != "mm" {
        return Err(format!("[reduction] displacement: {} is no length", column.name).into());
    }
    let compliance = asked.machine_compliance_mm_per_n.unwrap_or(0.0);
    let largest = loads_n.iter().max_by(|a, b| a.1.total_cmp(&b.1));
    let ends =
        loads_n.iter().find_map(|(frame, _)| column.at(*frame)).zip(largest.and_then(|(frame, _)| column.at(*frame)));
    let sign = if ends.is_some_and(|(first, there)| there < first) { -1.0 } else { 1.0 };
    let at = |(frame, load_n): &(usize, f64)| column.at(*frame).map(|u| sign * u - compliance * load_n);
    Ok(Some(loads_n.iter().map(at).collect()))
}

fn of_table(asked: &CaseReduction, path: &Path) -> Result<Found> {
    let table = read_table(path)?;
    let (column, sign) = force(asked, &table, path)?;
    let value = |name: &str, frame: usize| {
        let column = |name: &str| table.columns.iter().find(|column| column.name == name);
        let sigma = column(&format!("sigma_{name}")).and_then(|column| column.at(frame)).unwrap_or(0.0);
        column(name)?.at(frame).map(|value| Value { value, sigma })
    };
    let loads_n: Vec<(usize, f64)> =
        column.values.iter().enumerate().filter_map(|(k, load)| Some((k + 1, sign * (*load)?))).collect();
    let machine = of_machine(asked, &table, &loads_n)?;
    let instant = |(k, &(frame, load)): (usize, &(usize, f64))| {
        let of_file = || value(&column.name, frame).map(|of| of.sigma);
        let load_n = Value { value: load, sigma: asked.force_std_n.or_else(of_file).unwrap_or(0.0) };
        let displacement_mm = match &machine {
            Some(machine) => machine.get(k).copied().flatten().map(exact),
            None => value("displacement_mm", frame),
        };
        Instant {
            displacement_mm,
            rotation: value("rotation_1", frame),
            opening_mm: value("opening_mm", frame),
            sliding_mm: value("sliding_mm", frame),
            crack_mm: value("crack_mm", frame),
            ..Instant::of_load(frame, load_n)
        }
    };
    Ok((loads_n.iter().enumerate().map(instant).collect(), table.remarks))
}

/// What the fields of a run are asked for.
struct Asked<'a> {
    sections: Vec<LoadedSection>,
    /// At the tip, the places of the joint beside it with their weights.
    at_tip: Vec<(usize, f64)>,
    points: &'a [FacingPoint],
    tip: Point,
    mm_per_px: f64,
    n_references: usize,
}

/// Instants with what there is to say of them.
type Found = (Vec<Instant>, Vec<Remark>);

fn of_run(case: &CaseFile, asked: &CaseReduction, specimen: &Specimen, run: &Path) -> Result<(Found, f64)> {
    let store = Store::open(store_in(run))?;
    let header = store.header();
    let Some(size) = header.pixel_size else {
        return Err(wrong("the run has no scale: correlate with pixel_size_mm"));
    };
    let quantities = quantities(case, asked, specimen)?;
    let camera = &Rectifier::new(header.camera()?, store.mesh())?;
    let gauges = resolve(&quantities, header.strain, header.pixel_size, camera)?;
    let Some(wanted) = &quantities.load else {
        return Err(wrong("there is no table [load]: which file has the loads of the frames?"));
    };
    let loads = load(&quantities, store.n_frames())?;
    let (column, sign) = force(asked, &loads, Path::new(&wanted.file))?;
    let Some((_, facing)) = gauges.openings.first() else {
        return Err(wrong("an [[opening]] between the arms is needed"));
    };
    let points = facing.points();
    let tip = match asked.tip {
        Some([x, y]) => camera.camera().plane([x, y]).ok_or_else(|| wrong("tip lies where the camera folds"))?,
        None => return Err(wrong("tip = [x, y] is missing: the initial tip in the reference image, px")),
    };
    let (half_span, lever) = (specimen.half_span_mm.unwrap_or(1.0), specimen.lever_mm.unwrap_or(0.0));
    let all = sections(specimen.layout, half_span, lever);
    let reader = Asked {
        sections: if asked.sections.is_empty() { Vec::new() } else { all },
        at_tip: places_at(points, tip, header.element_size_px)?,
        points,
        tip,
        mm_per_px: size.mm_per_px(),
        n_references: header.reference.len(),
    };
    let is_bound = Record::of(header).is_regularised();
    let mut noise: Option<NodalNoise> = None;
    let mut read: Vec<Instant> = Vec::new();
    let mut along: Option<Point> = None;
    for frame in 1..=store.n_frames() {
        let Some(load) = column.at(frame) else { continue };
        let load_n = Value { value: sign * load, sigma: asked.force_std_n.unwrap_or(0.0) };
        let has_field = store.status(frame)?.is_some_and(|status| status.has_field());
        let Some(found) = (if has_field { store.frame(frame)? } else { None }) else { continue };
        let field = found.measurement;
        let plane = camera.rectify(&field);
        let of_field = NodalNoise::along(noise.take(), &*plane, is_bound, Some(camera.raw_mesh()));
        let drawn = gauges.draw(&plane, noise.insert(of_field), None);
        along = along.or_else(|| reader.growth(&drawn));
        let growth = along.unwrap_or_else(|| reader.growth_by_opening(&drawn));
        let mut instant = reader.instant(&drawn, growth, Instant::of_load(frame, load_n));
        instant.crack_mm = asked.crack_opening_mm.zip(specimen.crack_mm).and_then(|(least, initial)| {
            let ahead = reader.crack(&drawn, growth, specimen.layout, least)?;
            Some(Value { value: initial.value + ahead.value, ..ahead })
        });
        read.push(instant);
    }
    // Sections move with the load: where they do not, the upper arm is the lower one, or the test lies upside down.
    let largest = read.iter().max_by(|a, b| a.load_n.value.total_cmp(&b.load_n.value));
    if largest.and_then(|instant| instant.displacement_mm).is_some_and(|u| u.value < 0.0) {
        read.iter_mut().for_each(|instant| turn(instant, specimen.layout));
    }
    let loads_n: Vec<(usize, f64)> = read.iter().map(|instant| (instant.frame, instant.load_n.value)).collect();
    if let Some(machine) = of_machine(asked, &loads, &loads_n)? {
        for (instant, u) in read.iter_mut().zip(machine) {
            (instant.displacement_mm, instant.displacement_of_images) = (u.map(exact), false);
        }
    }
    Ok(((read, loads.remarks), header.pixel_size_std()))
}

/// Turns the normal of the joint the other way. Opening does not depend on it, unless the arms are exchanged.
fn turn(instant: &mut Instant, layout: Layout) {
    let turned = |of: Value| Value { value: -of.value, ..of };
    instant.displacement_mm = instant.displacement_mm.map(turned);
    instant.rotation = instant.rotation.map(turned);
    if Mode::of(layout) == Mode::Opening {
        instant.opening_mm = instant.opening_mm.map(turned);
    }
}

/// The folder of the fields of `run`: of `quadrille correlate`, or of `run`.
fn store_in(run: &Path) -> PathBuf {
    let within = correlation_in(run);
    if within.exists() { within } else { run.to_owned() }
}

/// The sections and the opening that the case names, with its loads.
fn quantities(case: &CaseFile, asked: &CaseReduction, specimen: &Specimen) -> Result<CaseQuantities> {
    let drawn = case.drawn();
    let there: Vec<&str> =
        drawn.regions.iter().filter_map(|region| region.name.as_deref().or(region.zone.as_deref())).collect();
    let region = |name: &String| -> Result<CaseRegion> {
        let called = |region: &&CaseRegion| region.name.as_ref().or(region.zone.as_ref()) == Some(name);
        drawn.regions.iter().find(called).cloned().ok_or_else(|| {
            format!("[reduction] sections: there is no [[region]] named \"{name}\"; there are {}", there.join(", "))
                .into()
        })
    };
    let regions = asked.sections.iter().map(region).collect::<Result<Vec<_>>>()?;
    let wanted = sections(specimen.layout, 1.0, 0.5);
    if !regions.is_empty() && regions.len() != wanted.len() {
        let words: Vec<&str> = wanted.iter().map(|section| section.what).collect();
        return Err(format!(
            "[reduction] sections names {} regions; layout = \"{}\" has loads at {}, in this order",
            regions.len(),
            specimen.layout.name(),
            words.join(", ")
        )
        .into());
    }
    let name_of = |opening: &CaseOpening| {
        let [plus, minus] = &opening.zones;
        opening.name.clone().unwrap_or_else(|| format!("{plus}-{minus}"))
    };
    let openings: Vec<CaseOpening> = drawn
        .openings
        .iter()
        .filter(|opening| asked.opening.as_ref().is_none_or(|name| *name == name_of(opening)))
        .cloned()
        .collect();
    if openings.len() != 1 {
        let there: Vec<String> = drawn.openings.iter().map(name_of).collect();
        return Err(format!(
            "[reduction] opening: one [[opening]] between the arms is needed; there are {}: {}",
            there.len(),
            there.join(", ")
        )
        .into());
    }
    Ok(CaseQuantities { load: drawn.load, regions, openings, ..CaseQuantities::default() })
}

/// The two places of the joint beside the tip, with weights that lie between them.
fn places_at(points: &[FacingPoint], tip: Point, element_px: f64) -> Result<Vec<(usize, f64)>> {
    let distance = |point: &FacingPoint| (point.at[0] - tip[0]).hypot(point.at[1] - tip[1]);
    let nearest = points.iter().enumerate().min_by(|a, b| distance(a.1).total_cmp(&distance(b.1)));
    let Some((k, point)) = nearest.filter(|(_, point)| distance(point) <= 2.0 * element_px + point.gap) else {
        let off = nearest.map_or(f64::INFINITY, |(_, point)| distance(point));
        return Err(format!(
            "[reduction] tip = [{}, {}] lies {off:.0} px from the faces of the opening",
            tip[0], tip[1]
        )
        .into());
    };
    let [tx, ty] = point.tangent();
    let ahead = (tip[0] - point.at[0]) * tx + (tip[1] - point.at[1]) * ty;
    let beside = if ahead >= 0.0 { k.checked_add(1) } else { k.checked_sub(1) };
    let other = beside.and_then(|at| Some((at, points.get(at)?))).filter(|(_, other)| other.part == point.part);
    let Some((at, other)) = other else { return Ok(vec![(k, 1.0)]) };
    let length = (other.along - point.along).abs();
    let share = if length > 0.0 { (ahead.abs() / length).min(1.0) } else { 0.0 };
    Ok(vec![(k, 1.0 - share), (at, share)])
}

impl Asked<'_> {
    /// Unit vector along the joint from the first load towards the tip; `None` where no section is measured.
    fn growth(&self, drawn: &FrameQuantities) -> Option<Point> {
        let first = drawn.regions.first().copied().flatten()?;
        let tangent = self.tangent();
        let way = (self.tip[0] - first.at[0]) * tangent[0] + (self.tip[1] - first.at[1]) * tangent[1];
        Some(if way < 0.0 { tangent.map(|c| -c) } else { tangent })
    }

    /// The same away from the side of the tip that is open further.
    fn growth_by_opening(&self, drawn: &FrameQuantities) -> Point {
        let (tangent, mut sums) = (self.tangent(), [[0.0; 2]; 2]);
        let read = drawn.openings.first().map_or(&[][..], |opening| &opening.points);
        for (point, jump) in self.points.iter().zip(read) {
            let Some(jump) = jump else { continue };
            let ahead = (point.at[0] - self.tip[0]) * tangent[0] + (point.at[1] - self.tip[1]) * tangent[1];
            let [sum, n] = if ahead < 0.0 { &mut sums[0] } else { &mut sums[1] };
            *sum += jump.opening.value.hypot(jump.sliding.value);
            *n += 1.0;
        }
        let [behind, ahead] = sums.map(|[sum, n]| if n > 0.0 { sum / n } else { 0.0 });
        if ahead > behind { tangent.map(|c| -c) } else { tangent }
    }

    fn tangent(&self) -> Point {
        self.point_at_tip().map_or([1.0, 0.0], FacingPoint::tangent)
    }

    fn point_at_tip(&self) -> Option<&FacingPoint> {
        self.at_tip.first().and_then(|(k, _)| self.points.get(*k))
    }

    /// What a field says, in mm.
    fn instant(&self, drawn: &FrameQuantities, growth: Point, instant: Instant) -> Instant {
        let mm = |of: Value| Value { value: self.mm_per_px * of.value, sigma: self.mm_per_px * of.sigma };
        let jump = |pick: fn(&Jump) -> Value| -> Option<Value> {
            let opening = drawn.openings.first()?;
            let mut sum = Value { value: 0.0, sigma: 0.0 };
            for (k, weight) in &self.at_tip {
                let there = pick(opening.points.get(*k)?.as_ref()?);
                sum = Value { value: sum.value + weight * there.value, sigma: sum.sigma.hypot(weight * there.sigma) };
            }
            Some(mm(sum))
        };
        let normal = self.point_at_tip().map_or([0.0, -1.0], |point| point.normal);
        let of_sections: Option<Vec<(LoadedSection, RegionValues)>> =
            self.sections.iter().zip(&drawn.regions).map(|(section, read)| Some((*section, (*read)?))).collect();
        let of_sections = of_sections.filter(|list| !list.is_empty());
        let sum = |of: &dyn Fn(&LoadedSection, &RegionValues) -> Option<Value>| -> Option<Value> {
            let add = |sum: Value, (section, read): &(LoadedSection, RegionValues)| {
                let part = of(section, read)?;
                Some(Value {
                    value: sum.value + section.share * part.value,
                    sigma: sum.sigma.hypot(section.share * part.sigma),
                })
            };
            of_sections.as_ref()?.iter().try_fold(exact(0.0), add)
        };
        let displacement = sum(&|section, RegionValues { mean, .. }| {
            let d = normal.map(|n| section.along * n);
            let sigma = (d[0] * mean.sigma[0]).hypot(d[1] * mean.sigma[1]);
            Some(Value { value: d[0] * mean.displacement[0] + d[1] * mean.displacement[1], sigma })
        });
        // A turn from x towards y moves a place that lies s ahead by s x d along d: less the further from the load.
        let rotation = sum(&|section, read| {
            let turn = read.mean.rotation_deg?;
            let d = normal.map(|n| section.along * n);
            let sense = -(growth[0] * d[1] - growth[1] * d[0]);
            let angle = sense * turn.value.to_radians();
            Some(Value { value: angle.sin(), sigma: turn.sigma.to_radians() })
        });
        Instant {
            displacement_mm: displacement.map(mm),
            displacement_of_images: true,
            rotation,
            rotation_common: rotation.map_or(0.0, |of| of.sigma / (1.0 + self.n_references as f64).sqrt()),
            opening_mm: jump(|jump| jump.opening),
            sliding_mm: jump(|jump| jump.sliding),
            ..instant
        }
    }

    /// How far beyond the tip the separation exceeds `least`, mm; `None` where the images do not show where it ends.
    fn crack(&self, drawn: &FrameQuantities, growth: Point, layout: Layout, least: f64) -> Option<Value> {
        let opening = drawn.openings.first()?;
        let place =
            |at: Point| self.mm_per_px * ((at[0] - self.tip[0]) * growth[0] + (at[1] - self.tip[1]) * growth[1]);
        let size = |jump: &Jump| match layout {
            Layout::Dcb | Layout::Peel => jump.opening,
            Layout::Enf => Value { value: jump.sliding.value.abs(), ..jump.sliding },
            Layout::Mmb | Layout::Slb => Value {
                value: jump.opening.value.hypot(jump.sliding.value),
                sigma: jump.opening.sigma.max(jump.sliding.sigma),
            },
        };
        let read = self.points.iter().zip(&opening.points);
        let mut along: Vec<(f64, Value)> =
            read.filter_map(|(point, jump)| Some((place(point.at), size(jump.as_ref()?)))).collect();
        along.sort_by(|a, b| a.0.total_cmp(&b.0));
        let least = least / self.mm_per_px;
        // Closed everywhere, or not yet open to the tip.
        let at_tip = Some(exact(0.0));
        if along.iter().all(|(_, size)| size.value < least) {
            return at_tip;
        }
        // The furthest place that is open.
        let [here, next] =
            along.array_windows::<2>().rfind(|[here, next]| here.1.value >= least && next.1.value < least)?;
        if next.0 <= 0.0 {
            return at_tip;
        }
        let fall = here.1.value - next.1.value;
        let share = (here.1.value - least) / fall;
        let step = next.0 - here.0;
        Some(Value { value: (here.0 + share * step).max(0.0), sigma: step * here.1.sigma.max(next.1.sigma) / fall })
    }
}
