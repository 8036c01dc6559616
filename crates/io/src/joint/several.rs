//! Several tests of one adhesive, as a case with `[[test]]` names them.

use super::{CaseFit, CaseJointOutput, JointFileError, JointInput, joint_of};
use crate::case::{CaseCohesive, CaseDocument, CaseError, CaseTest, CaseText, Reader, read_document};
use std::path::{Path, PathBuf};

/// What a folder of `quadrille run` has for `quadrille identify`.
const OF_RUN: &str = "identify.toml";

/// The folder of figures in that of results.
const FIGURES: &str = "figures";

/// Several tests that are fitted together.
#[derive(Debug, Clone, PartialEq)]
pub struct TestsInput {
    /// The case that names them.
    pub text: CaseText,
    /// Whether it gives the law, over those of the tests.
    pub own_law: bool,
    /// Its section `[fit]`.
    pub fit: CaseFit,
    /// Its section `[output]`.
    pub output: CaseJointOutput,
    /// The tests.
    pub tests: Vec<TestInput>,
    /// What was changed or may not be meant.
    pub notes: Vec<String>,
}

/// One of them.
#[derive(Debug, Clone, PartialEq)]
pub struct TestInput {
    /// What it is called.
    pub name: String,
    /// Its case file.
    pub path: PathBuf,
    /// What that holds, with the parameters, starts and bounds of the case that names it.
    pub input: JointInput,
}

/// What `quadrille identify` fits.
#[derive(Debug, Clone, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "there is one of them")]
pub enum IdentifyInput {
    /// One test.
    One(JointInput),
    /// Several, with one law.
    Several(TestsInput),
}

/// Reads the case file `path`, of one test or of several, and every file that it names.
pub fn read_identify(path: &Path) -> Result<IdentifyInput, JointFileError> {
    identify_of(read_document(path)?)
}

/// The case file `text` and every file that it names; `path` gives its folder and stands in messages.
pub fn parse_identify(text: &str, path: &Path) -> Result<IdentifyInput, JointFileError> {
    identify_of(CaseDocument::parse(text, path)?)
}

fn identify_of(document: CaseDocument) -> Result<IdentifyInput, JointFileError> {
    match document.case.tests.is_empty() {
        true => joint_of(document.joint()?).map(IdentifyInput::One),
        false => read_tests(document).map(IdentifyInput::Several),
    }
}

fn read_tests(document: CaseDocument) -> Result<TestsInput, JointFileError> {
    document.taken_by(Reader::Tests)?;
    let CaseDocument { case, text, .. } = document;
    let missing = || {
        CaseError::Missing(
            text.path().to_owned(),
            "fit",
            "give parameters = [\"phi_n\", \"delta_n\", \"delta_t\", \"r\"], which all tests share",
        )
    };
    let fit = case.fit.ok_or_else(missing)?;
    let base = case.base;
    let (mut tests, mut notes): (Vec<TestInput>, Vec<String>) = (Vec::new(), Vec::new());
    for test in &case.tests {
        let name = name_of(test);
        let wrong = |error| JointFileError::InTest(text.place("test", None), name.clone(), Box::new(error));
        if tests.iter().any(|other| other.name == name) {
            let what = "another test has the same name; give each [[test]] a name = \"..\" of its own";
            return Err(wrong(JointFileError::Wrong(what.to_owned())));
        }
        // The results of the test lie in a folder of its name, beside these.
        let plain = |c: char| c.is_alphanumeric() || "-_. ".contains(c);
        if !name.chars().all(plain) || name.starts_with('.') || [FIGURES, ""].contains(&name.trim()) {
            let what = "its results get a folder of its name; give it a name = \"..\" of letters, digits, - and _, other than \
                        figures";
            return Err(wrong(JointFileError::Wrong(what.to_owned())));
        }
        let (path, input) = read_one(&base.join(&test.case)).map_err(wrong)?;
        let input = with_shared(input, &name, case.cohesive.as_ref(), &fit, &mut notes);
        tests.push(TestInput { name, path, input });
    }
    let (own_law, output) = (case.cohesive.is_some(), case.output.unwrap_or_default());
    Ok(TestsInput { text, own_law, fit, output, tests, notes })
}

/// The name of a test: as given, else that of the folder of its case file, or of the file where that lies beside.
fn name_of(test: &CaseTest) -> String {
    let named = || {
        let path = Path::new(&test.case);
        let folder = if path.extension().is_some() { path.parent()? } else { path };
        let name = folder.file_name().or_else(|| path.file_stem())?;
        Some(name.to_string_lossy().into_owned())
    };
    test.name.clone().or_else(named).unwrap_or_else(|| test.case.clone())
}

/// The case of one test: a file, or that in the folder of a run.
fn read_one(path: &Path) -> Result<(PathBuf, JointInput), JointFileError> {
    let path = if path.is_dir() { path.join(OF_RUN) } else { path.to_owned() };
    let document = read_document(&path)?;
    // What begins with images is measured first.
    if document.case.interface.is_some() {
        let what = "is a case of quadrille run, whose images are not measured yet; run it, and give the folder of its results: \
                    case = \"RUN\"";
        return Err(JointFileError::file(&path, what));
    }
    let input = joint_of(document.joint()?)?;
    Ok((path, input))
}

/// The input of the test `name` with the law, the parameters, the starts and the bounds of its case.
fn with_shared(
    mut input: JointInput,
    name: &str,
    law: Option<&CaseCohesive>,
    shared: &CaseFit,
    notes: &mut Vec<String>,
) -> JointInput {
    if let Some(law) = law {
        if input.case.cohesive != *law {
            notes.push(format!("test \"{name}\": its [cohesive] gives way to that of the case of all tests"));
        }
        input.case.cohesive = law.clone();
    }
    let own = input.case.fit.take().unwrap_or_default();
    input.case.fit = Some(CaseFit {
        thickness_mm_std: own.thickness_mm_std.or(shared.thickness_mm_std),
        pixel_size_relative_std: own.pixel_size_relative_std.or(shared.pixel_size_relative_std),
        face_position_px_std: own.face_position_px_std.or(match own.face_position_mm_std {
            None => shared.face_position_px_std,
            Some(_) => None,
        }),
        face_position_mm_std: own.face_position_mm_std.or(match own.face_position_px_std {
            None => shared.face_position_mm_std,
            Some(_) => None,
        }),
        exact: own.exact.or_else(|| shared.exact.clone()),
        discretisation: own.discretisation.or(shared.discretisation),
        shared: None,
        ..shared.clone()
    });
    input
}
