//! `run.toml`: the options of a run with all that was chosen, what did it, and the images that it came to.

use crate::correlate::Reference;
use crate::io::case::{CaseFile, CaseImages, write_case};
use crate::io::series::Frame;
use crate::report::summary::units;
use crate::run::plan::Plan;
use crate::run::plan::resolved as plan;
use crate::run::words::absolute;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What `run.toml` tells beside the options.
pub(crate) struct RunToml {
    case: CaseFile,
    about: toml::Table,
    reference: Vec<(Frame, String)>,
    pub deformed: Vec<Frame>,
    zone_files: toml::value::Array,
}

impl RunToml {
    pub fn new(
        plan: &Plan,
        prepared: &Reference,
        threads: usize,
        sha256: &[String],
        zone_files: Vec<(PathBuf, String)>,
    ) -> Self {
        let mut about = toml::Table::new();
        about.insert("quadrille".into(), env!("CARGO_PKG_VERSION").into());
        about.insert("device".into(), prepared.device().into());
        about.insert("isa".into(), plan.isa.name().into());
        about.insert("threads".into(), (threads as i64).into());
        let exports = [(plan.csv, "csv"), (plan.vtu, "vtu")];
        let exports = exports.iter().filter(|(on, _)| *on).map(|(_, name)| (*name).into());
        about.insert("export".into(), toml::Value::Array(exports.collect()));
        for (key, _) in [("zone_found", plan.zone_found), ("crack_auto", plan.crack_auto)].iter().filter(|(_, so)| *so)
        {
            about.insert((*key).into(), true.into());
        }
        about.insert(
            "units".into(),
            units()
                .into_iter()
                .map(|(ending, meaning)| (ending.into_owned(), meaning.into_owned().into()))
                .collect::<toml::Table>()
                .into(),
        );
        Self {
            case: plan.to_case_file(),
            about,
            reference: plan.reference.iter().cloned().zip(sha256.iter().cloned()).collect(),
            deformed: plan.deformed.clone(),
            zone_files: zone_files.iter().map(|(path, sha256)| Self::entry(path, None, Some(sha256))).collect(),
        }
    }

    fn entry(path: &Path, page: Option<usize>, sha256: Option<&str>) -> toml::Value {
        let mut table = toml::Table::new();
        table.insert("file".into(), absolute(path).into());
        page.map(|page| table.insert("page".into(), (page as i64).into()));
        // A file that could not be read has none.
        sha256.map(|sha256| table.insert("sha256".into(), sha256.into()));
        toml::Value::Table(table)
    }

    /// The case file with the record of the run but for its images: the store names them beside it.
    pub fn without_images(&self) -> String {
        self.text(None)
    }

    /// The case file with the record of the run, and the deformed images that were come to, with their SHA-256.
    pub fn case(&self, sha256: &BTreeMap<usize, Option<String>>) -> String {
        let page = |frame: &Frame| frame.is_page.then_some(frame.page);
        let references =
            self.reference.iter().map(|(frame, sha256)| Self::entry(&frame.path, page(frame), Some(sha256)));
        let deformed = sha256.iter().filter_map(|(number, sha256)| {
            let frame = self.deformed.get(number - 1)?;
            Some(Self::entry(&frame.path, page(frame), sha256.as_deref()))
        });
        self.text(Some(references.chain(deformed).collect()))
    }

    fn text(&self, images: Option<toml::value::Array>) -> String {
        let mut about = self.about.clone();
        if let Some(images) = images {
            about.insert("image".into(), toml::Value::Array(images));
        }
        if !self.zone_files.is_empty() {
            about.insert("zone_file".into(), toml::Value::Array(self.zone_files.clone()));
        }
        // More of them may have come than were planned.
        let images = CaseImages { deformed: Some(plan::files(&self.deformed)), ..self.case.images.clone() };
        write_case(&CaseFile { images, run: Some(about), ..self.case.clone() })
    }
}
