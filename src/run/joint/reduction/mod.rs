//! A test of the standards, reduced without a model: from the fields of a run, or a table, to J and the traction
//! (THEORY 23).

mod arms;
mod fields;
mod lap;
mod loads;
mod opened;

use crate::field::Value;
use crate::io::case::{CaseFile, CaseReduction, read_document};
use crate::io::load::read_table;
use crate::reduction::{Instant, Layout, Specimen, reduce as reduce_instants};
use crate::report::{ReducedTest, ReductionRecord};
use crate::run::folder::run_folder::{REDUCTION, RunFolder};
use crate::run::words::{Result, RunError};
use fields::{Found, of_run};
use loads::{exact, force, of_machine, wrong};
use opened::quantities;
use std::io::Write;
use std::path::Path;

/// Reduces the test of `[reduction]` in the case file `path` into the folder `output`.
///
/// # Errors
/// A case, fields or loads that cannot be read, a test that has nothing to be reduced, and files that cannot be
/// written.
pub fn reduce(path: &Path, output: &Path, overwrite: bool) -> Result<ReducedTest> {
    let case = read_document(path)?.of_correlation()?;
    let asked = case.reduction.as_ref().ok_or_else(|| {
        format!("{}: there is no table [reduction]; give its layout, width_mm, and run or table", path.display())
    })?;
    let is_output = |run: &String| {
        let places = [case.resolve(run).canonicalize(), output.canonicalize()];
        matches!(places, [Ok(run), Ok(output)] if run == output)
    };
    if asked.run.as_ref().is_some_and(is_output) {
        return Err(format!("{}: this is the run itself; choose another --output", output.display()).into());
    }
    let run = asked.run.as_ref().map(|run| case.resolve(run));
    let record = record(&case, asked, path, run.as_deref())?;
    write(&record, output, overwrite)?;
    Ok(record)
}

/// Looks at `[reduction]` of a case of `quadrille run`, where there is one, before anything is measured.
///
/// # Errors
/// Numbers, sections and openings that cannot be.
pub(crate) fn check_reduction(case: &CaseFile) -> Result<()> {
    let Some(asked) = &case.reduction else { return Ok(()) };
    if asked.run.is_some() || asked.table.is_some() {
        return Err(wrong("a run has its own fields: leave run and table out"));
    }
    quantities(case, asked, &specimen(asked)?).map(|_| ())
}

/// Reduces the fields in the folder `fields` of a run of the case file `path`, where it asks for that, into `output`.
///
/// # Errors
/// See [`reduce`].
pub(crate) fn reduce_run(case: &CaseFile, path: &Path, fields: &Path, output: &Path) -> Result<Option<ReducedTest>> {
    let Some(asked) = &case.reduction else { return Ok(None) };
    let record = record(case, asked, path, Some(fields))?;
    write(&record, output, true)?;
    Ok(Some(record))
}

fn record(case: &CaseFile, asked: &CaseReduction, path: &Path, fields: Option<&Path>) -> Result<ReducedTest> {
    let specimen = specimen(asked)?;
    if specimen.layout == Layout::Lap {
        let run =
            fields.ok_or_else(|| wrong("layout = \"lap\" needs the fields of a run; a table does not tell strains"))?;
        return Ok(ReducedTest::Lap(lap::record(case, asked, path, &specimen, run)?));
    }
    let of_test = match (fields, &asked.table) {
        (Some(run), None) => of_run(case, asked, &specimen, run)?,
        (None, Some(table)) => of_table(asked, &case.resolve(table))?,
        _ => return Err(wrong("give run (a folder of quadrille correlate) or table (a file), and not both")),
    };
    let specimen = Specimen { length_scale_std: of_test.length_scale_std, ..specimen };
    let mut found = reduce_instants(&specimen, &of_test.instants, &of_test.by_camera)
        .map_err(|error| format!("[reduction] {error}"))?;
    found.remarks.splice(0..0, of_test.remarks);
    Ok(ReducedTest::Loads(ReductionRecord::new(path.display().to_string(), &specimen, found)))
}

fn write(record: &ReducedTest, output: &Path, overwrite: bool) -> Result<()> {
    let folder = RunFolder::for_joint(output, overwrite, false)?;
    match record {
        ReducedTest::Loads(record) => {
            folder.write("reduction.csv", |out| record.write_instants(out))?;
            for (place, name) in record.tables().enumerate() {
                folder.write(&format!("{name}.csv"), |out| record.write_traction(place, out))?;
            }
        }
        ReducedTest::Lap(record) => folder.write("lap.csv", |out| record.write(out))?,
    }
    for (name, picture) in record.draw()? {
        folder.save_figure(name, &picture)?;
    }
    folder
        .write("report.html", |out| out.write_all(record.page().map_err(std::io::Error::other)?.html().as_bytes()))?;
    folder.write_json(REDUCTION, record)?;
    Ok(())
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
    number("adhesive_mm", asked.adhesive_mm)?;
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
    let end_block_mm = asked.end_block_mm.unwrap_or_default();
    if let Some(wrong_mm) = end_block_mm.into_iter().find(|mm| !(mm.is_finite() && *mm >= 0.0)) {
        return Err(wrong(&format!("end_block_mm holds {wrong_mm}; give lengths, zero or above")));
    }
    if asked.end_block_mm.is_some() && layout != Layout::Dcb {
        return Err(wrong("end_block_mm is for layout = \"dcb\""));
    }
    // The free arm begins where the block ends.
    if end_block_mm[1] > 0.0 && !asked.crack_mm.is_some_and(|crack| crack > end_block_mm[1]) {
        return Err(wrong("end_block_mm needs a crack_mm that is longer than half of the block"));
    }
    Ok(Specimen {
        layout,
        width_mm: width_mm.unwrap_or(Value { value: asked.width_mm, sigma: 0.0 }),
        arm_mm: given("arm_mm", asked.arm_mm, asked.arm_mm_std)?,
        crack_mm: given("crack_mm", asked.crack_mm, asked.crack_mm_std)?,
        crack_front_std_mm: number("crack_front_mm_std", asked.crack_front_mm_std)?.unwrap_or(0.0),
        end_block_mm,
        half_span_mm,
        lever_mm,
        young_mpa: given("E_MPa", asked.young_mpa, asked.young_mpa_std)?,
        shear_mpa: number("G_MPa", asked.shear_mpa)?,
        load_scale_std: number("force_scale_std", asked.force_scale_std)?.unwrap_or(0.0),
        length_scale_std: 0.0,
    })
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
            other_end_mm: value("other_end_mm", frame).map(|of| of.value),
            crack_mm: value("crack_mm", frame),
            ..Instant::of_load(frame, load_n)
        }
    };
    let instants = loads_n.iter().enumerate().map(instant).collect();
    Ok(Found { instants, remarks: table.remarks, ..Found::default() })
}
