//! Several tests of one adhesive, as a case with `[[test]]` names them.

use super::{CaseFit, CaseJointOutput, JointFileError, JointInput, joint_of};
use crate::case::{CaseCohesive, CaseDocument, CaseError, CaseTest, CaseText, Reader, read_document};
use std::collections::BTreeSet;
use std::path::{Component, Path, PathBuf};

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
    for (test, name) in case.tests.iter().zip(names_of(&case.tests)) {
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

/// Names of the tests: as given, else those of the folders of their case files, at the innermost level at which these
/// differ (`op/run` and `sl/run` are `op` and `sl`); of a file that lies beside, its own.
fn names_of(tests: &[CaseTest]) -> Vec<String> {
    let levels: Vec<Vec<String>> = tests.iter().map(levels_of).collect();
    let at = |level: usize| -> Option<Vec<String>> {
        let own = tests.iter().zip(&levels).map(|(test, of)| test.name.clone().or_else(|| of.get(level).cloned()));
        own.collect()
    };
    let differ = |names: &Vec<String>| names.iter().collect::<BTreeSet<_>>().len() == names.len();
    let deepest = levels.iter().map(Vec::len).max().unwrap_or(0);
    (0..deepest).map_while(at).find(differ).or_else(|| at(0)).unwrap_or_default()
}

/// The folders of a case file from the inside out, or the name of the file that lies beside.
fn levels_of(test: &CaseTest) -> Vec<String> {
    let path = Path::new(&test.case);
    let folder = if path.extension().is_some() { path.parent().unwrap_or(path) } else { path };
    let name = |part: Component<'_>| match part {
        Component::Normal(name) => Some(name.to_string_lossy().into_owned()),
        _ => None,
    };
    let folders: Vec<String> = folder.components().rev().filter_map(name).collect();
    match (folders.is_empty(), path.file_stem()) {
        (true, Some(stem)) => vec![stem.to_string_lossy().into_owned()],
        (true, None) => vec![test.case.clone()],
        (false, _) => folders,
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tests_without_a_name_have_that_of_the_folder_by_which_they_differ() {
        let names = |cases: &[&str]| -> Vec<String> {
            let test = |case: &&str| CaseTest { name: None, case: (*case).to_owned() };
            names_of(&cases.iter().map(test).collect::<Vec<_>>())
        };
        assert_eq!(names(&["op/run", "sl/run"]), ["op", "sl"]);
        assert_eq!(names(&["tests/op/identify.toml", "../sl/identify.toml"]), ["op", "sl"]);
        assert_eq!(names(&["a/1/run/case.toml", "b/1/run/case.toml"]), ["a", "b"]);
        assert_eq!(names(&["op.toml", "sl.toml"]), ["op", "sl"]);
        assert_eq!(names(&["op/run", "op/run"]), ["run", "run"], "refused where they are used");
        let given = [CaseTest { name: Some("x".into()), case: "op/run".into() }];
        assert_eq!(names_of(&[given[0].clone(), given[0].clone()]), ["x", "x"]);
    }
}
