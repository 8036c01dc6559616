//! Several tests as their case files describe them.

use super::sources::{CombinedConstant, combined_constants};
use crate::identify::cases::error::refuse_if;
use crate::identify::doubt::remarks;
use crate::identify::{Case, FitError, wrong};
use crate::io::joint::{JointMeshFile, MeshInput, TestInput, TestsInput};
use crate::mechanics::{Joint, Model};
use crate::remark::Remark;

/// Share by which the thickness of the adhesive may differ between tests before it is named: a law may depend on it.
pub const SAME_GAP: f64 = 0.1;
/// Factor between the same lengths or moduli of two tests from which another unit is the likely reason.
const OTHER_UNIT: f64 = 30.0;
/// Share by which two scales of one test may differ.
const SAME_SCALE: f64 = 1e-6;

/// What case files say about the identification of one law from several tests.
#[derive(Debug)]
pub struct CombinedCase<'a> {
    /// The tests.
    pub tests: Vec<TestCase<'a>>,
    /// What is possible, but hardly meant.
    pub remarks: Vec<Remark>,
    /// Time after which the fit ends at the best point so far, s.
    pub max_seconds: Option<f64>,
    /// The constants of all tests.
    pub(super) constants: Vec<CombinedConstant>,
}

/// One of several tests.
#[derive(Debug)]
pub struct TestCase<'a> {
    /// What it is called.
    pub name: String,
    /// Its case, with the unknowns that all share.
    pub case: Case<'a>,
}

impl<'a> CombinedCase<'a> {
    /// The joints of the tests, in their order.
    ///
    /// # Errors
    /// See [`crate::mechanics::JointError`]; the test is named.
    pub fn joints(input: &TestsInput) -> Result<Vec<Joint>, FitError> {
        let joint = |test: &TestInput| Case::joint(&test.input).map_err(|error| in_test(&test.name, error));
        input.tests.iter().map(joint).collect()
    }

    /// What is to be identified of `joints`, which [`CombinedCase::joints`] made of the same `input`.
    ///
    /// # Errors
    /// See [`FitError`]: laws that differ, what a single test refuses, what several tests cannot have.
    pub fn new(joints: &'a [Joint], input: &TestsInput) -> Result<Self, FitError> {
        let fit = &input.fit;
        let alone = [
            ("profile", fit.profile.is_some()),
            ("intervals", fit.intervals == Some(crate::io::case::Intervals::Profile)),
            ("laws", !fit.laws.is_empty()),
            ("sweep", !fit.sweep.is_empty()),
        ];
        for ((key, is_asked), what) in alone.into_iter().zip(ALONE) {
            refuse_if(is_asked, "fit", key, what).map_err(|error| error.in_case(&input.text))?;
        }
        same_law(joints, input)?;
        let mut tests = Vec::with_capacity(joints.len());
        for (joint, TestInput { name, path, input: of_test }) in joints.iter().zip(&input.tests) {
            let made = Case::new(joint, of_test, path).map_err(|error| about_fit(input, in_test(name, error)))?;
            if made.options.estimate_boundary {
                let what = "boundary = \"estimated\" is for a test by itself; give boundary = \"measured\", whose noise is part of the \
                            weights, or fit this case alone";
                let error = wrong("measurement", "boundary", what).in_case(&of_test.case.text);
                return Err(in_test(name, error));
            }
            tests.push(TestCase { name: name.clone(), case: made });
        }
        let mut found: Vec<Remark> = input.notes.iter().map(|note| remarks::law_unused(note)).collect();
        for (test, joint) in tests.iter().zip(joints) {
            let named = |remark: &Remark| remark.clone().of_test(&test.name);
            found.extend(joint.remarks.iter().chain(&test.case.remarks).map(named));
        }
        if let Some(law) = joints.first().map(|joint| &joint.law)
            && law.has_own_minima()
        {
            found.push(remarks::own_minima(law.name()));
        }
        found.extend(input.tests.iter().filter_map(two_scales));
        found.extend(find_contradictions(&tests));
        let names: Vec<&str> = tests.iter().map(|test| test.name.as_str()).collect();
        let constants: Vec<&[_]> = tests.iter().map(|test| test.case.options.constants.as_slice()).collect();
        let constants = combined_constants(&names, &constants, input.fit.shared.as_deref(), &mut found)
            .map_err(|error| error.in_case(&input.text))?;
        let max_seconds = tests.first().and_then(|test| test.case.max_seconds);
        Ok(Self { tests, remarks: found, max_seconds, constants })
    }
}

/// What a fit of several tests has not, and what to do.
const ALONE: [&str; 4] = [
    "profile: that of several tests is not computed; take it out here, and ask for it in the case of one test, fitted alone",
    "intervals = \"profile\": those of several tests are linear; give \"linear\" or nothing here, and ask for them in the case of one \
     test, fitted alone",
    "laws: laws are compared on one test; take them out here, and run quadrille identify --tournament on the case of each test",
    "sweep is for quadrille identify --sweep, which takes one test",
];

fn in_test(name: &str, error: FitError) -> FitError {
    FitError::InTest { name: name.to_owned(), error: Box::new(error) }
}

/// What is wrong with a key of `[fit]` stands in the case of all tests, not in that of the first one.
fn about_fit(input: &TestsInput, error: FitError) -> FitError {
    let FitError::InTest { name, error } = error else { return error };
    match *error {
        FitError::InCase { error: inner, .. }
            if matches!(*inner, FitError::Key { section: "fit", .. } | FitError::StartOutside { .. }) =>
        {
            inner.in_case(&input.text)
        }
        other => in_test(&name, other),
    }
}

/// Whether all tests have one law, but for the values that are fitted.
fn same_law(joints: &[Joint], input: &TestsInput) -> Result<(), FitError> {
    let Some((first, rest)) = joints.split_first() else { return Ok(()) };
    for (joint, test) in rest.iter().zip(&input.tests[1..]) {
        let differ = |what: String| FitError::LawsDiffer {
            path: input.text.path().to_owned(),
            first: input.tests[0].name.clone(),
            second: test.name.clone(),
            what,
        };
        let (a, b) = (&first.law, &joint.law);
        if a.name() != b.name() {
            return Err(differ(format!("{} and {}", a.name(), b.name())));
        }
        for name in &input.fit.parameters {
            if let [Some(x), Some(y)] = [(first, &input.tests[0]), (joint, test)].map(|of| of_strips(of, name))
                && x != y
            {
                return Err(differ(format!("{name} = {x} and {y} in [substrate], and one {name} is fitted to both")));
            }
        }
        let (of_a, of_b) = (first.model.options(), joint.model.options());
        if of_a.kinematics != of_b.kinematics {
            return Err(differ(format!(
                "kinematics = \"{}\" and \"{}\"",
                of_a.kinematics.name(),
                of_b.kinematics.name()
            )));
        }
        for (p, (x, y)) in a.parameters().iter().zip(a.values().into_iter().zip(b.values())) {
            let fitted = input.fit.parameters.iter().any(|name| name == p.name);
            if !fitted && x != y {
                return Err(differ(format!("{} = {x} and {y}, which is not fitted", p.name)));
            }
        }
    }
    Ok(())
}

/// Value of the parameter `name` of the strips that have no table of their own.
fn of_strips((joint, test): (&Joint, &TestInput), name: &str) -> Option<f64> {
    let model = &joint.model;
    let group = *test.input.case.substrate.without_own(model.mesh().groups()).first()?;
    let material = &model.materials()[group];
    let place = material.parameters().iter().position(|p| p.name == name)?;
    material.values().get(place).copied()
}

/// Two scales of the same images.
fn two_scales(test: &TestInput) -> Option<Remark> {
    let of_mesh = match &test.input.mesh {
        MeshInput::File(JointMeshFile { mm_per_px, .. }) | MeshInput::Run(JointMeshFile { mm_per_px, .. }) => {
            *mm_per_px
        }
        MeshInput::Rectangle { .. } => None,
    }?;
    let of_table = test.input.case.measurement.as_ref()?.pixel_size_mm?;
    let differ = (of_mesh - of_table).abs() > SAME_SCALE * of_mesh;
    differ.then(|| remarks::scales_differ(&test.name, of_mesh, of_table))
}

/// What two tests say that hardly goes together.
fn find_contradictions(tests: &[TestCase<'_>]) -> Vec<Remark> {
    let data = |test: &TestCase<'_>| {
        let instants = &test.case.problem.observation.instants;
        instants.iter().map(|instant| instant.displacement.clone()).collect::<Vec<_>>()
    };
    fn model<'a>(test: &TestCase<'a>) -> &'a Model {
        &test.case.problem.joint.model
    }
    let ratio = |[x, y]: [f64; 2]| (x / y).max(y / x);
    let mut found = Vec::new();
    for (k, b) in tests.iter().enumerate() {
        for a in &tests[..k] {
            let names = [a.name.as_str(), b.name.as_str()];
            if data(a) == data(b) {
                found.push(remarks::data_twice(names));
            }
            let gaps = [a, b].map(|test| model(test).mesh().gap());
            if ratio(gaps) > 1.0 + SAME_GAP {
                let other_unit = ratio(gaps).is_finite() && ratio(gaps) > OTHER_UNIT;
                found.push(remarks::thickness_differs(names, gaps, other_unit));
            }
            if let [Some(x), Some(y)] = [a, b].map(|test| model(test).materials().first().map(|law| law.young()))
                && ratio([x, y]) > OTHER_UNIT
            {
                found.push(remarks::stiffness_differs(names, [x, y]));
            }
        }
    }
    found
}
