//! What the page asks for, and what it gets.

use super::folder::{self, Listed};
use super::gauges;
use super::job::{Job, Wanted};
use super::server::{Answer, Asked};
use crate::cli::args::{Quiet, Threads, ViewArgs};
use crate::cli::look::frames::Frames;
use crate::cli::look::view;
use crate::cli::make::page::read_drawn;
use crate::cli::{Result, chain, file_name};
use crate::field::Status;
use crate::io::arrays::Values;
use crate::io::case::CaseDocument;
use crate::io::store::{Place, Store, Variable};
use crate::report::Backdrop;
use crate::report::view::{Drawing, Studio};
use crate::run::{Checked, CheckedZone, Plan, Request, RunError, RunFolder, check, correlation_in, keeps_to};
use hyper::StatusCode;
use rayon::ThreadPool;
use serde::Deserialize;
use serde_json::{Value, json};
use std::path::PathBuf;
use std::sync::Arc;

/// How case files that are written here begin: others are not replaced.
const DRAWN: &str = "# Drawn with quadrille";
/// Size of the page of results, MB.
const VIEW_MB: f64 = 15.0;

/// The folder that is worked in.
pub(super) struct Studied {
    /// Without links.
    pub folder: PathBuf,
    pub case: PathBuf,
    pub output: PathBuf,
    /// Device and the like.
    pub asked: Request,
    pub threads: Threads,
    pub pool: Arc<ThreadPool>,
    pub job: Arc<Job>,
}

#[derive(Deserialize)]
struct Wish {
    #[serde(default)]
    case: String,
    /// Whether results of another run are replaced.
    #[serde(default)]
    replace: bool,
}

impl Studied {
    /// Answers a request that may be made.
    pub fn answer(&self, asked: &Asked) -> Answer {
        let answered = match (asked.is_post, asked.path.as_str()) {
            (false, "") => self.page(asked.number("image")),
            (false, "state") => {
                let number = |key| asked.number(key).unwrap_or(0);
                let mut news = self.job.news(number("since"), number("from"));
                news["report"] = (!self.job.is_running() && self.report().is_some()).into();
                Ok(Answer::json(&news))
            }
            (false, "mesh") => self.mesh(),
            (false, "live") => self.live(),
            (false, "gauges") => self.gauges(asked.number("from").unwrap_or(0)),
            (false, "view") => self.view(),
            (false, "report") => self.read_report(),
            (true, "check") => self.wish(asked).and_then(|wish| self.check(&wish.case)),
            (true, "case") => self.wish(asked).and_then(|wish| self.write(&wish.case)),
            (true, "run") => self.wish(asked).and_then(|wish| self.run(&wish)),
            (true, "stop") => {
                self.job.stop();
                Ok(Answer::json(&json!({})))
            }
            _ => Ok(Answer::refused(StatusCode::NOT_FOUND, "there is nothing here")),
        };
        answered.unwrap_or_else(|error| Answer::refused(StatusCode::UNPROCESSABLE_ENTITY, chain(error.as_ref())))
    }

    fn wish(&self, asked: &Asked) -> Result<Wish> {
        Ok(serde_json::from_slice(&asked.body)?)
    }

    /// The page, on the image of that number; on the first.
    fn page(&self, shown: Option<usize>) -> Result<Answer> {
        let images = folder::images(&self.folder, &self.output);
        let shown = shown.filter(|&shown| shown < images.len()).unwrap_or(0);
        let (backdrop, fault) = match images.get(shown).map(folder::backdrop) {
            Some(Ok(backdrop)) => (backdrop, None),
            Some(Err(error)) => (Backdrop::blank(640, 480, 1), Some(chain(error.as_ref()))),
            None => (Backdrop::blank(640, 480, 1), Some("there is no image in this folder".to_owned())),
        };
        let name = |listed: &Listed| listed.name.clone();
        let page = Studio {
            drawing: Drawing {
                backdrop: &backdrop,
                shown: images.get(shown).map(name).unwrap_or_default(),
                reference: images.get(shown).map(name),
                page: 0,
                deformed: Vec::new(),
                folder: self.folder.display().to_string(),
                case: self.read_case(),
                case_folder: None,
            },
            images: json!(images),
            files: json!({
                "loads": folder::named(&self.folder, &["csv", "txt", "dat"]),
                "cameras": folder::named(&self.folder, &["toml", "yml", "yaml", "json"]),
            }),
            image: shown,
            fault,
            case: file_name(&self.case),
            output: file_name(&self.output),
            has_results: self.results().is_some(),
            has_report: self.report().is_some(),
        };
        Ok(Answer::html(page.html()))
    }

    /// The case file that is there, to go on with; nothing where it is none.
    fn read_case(&self) -> Option<Value> {
        let is_file = std::fs::symlink_metadata(&self.case).is_ok_and(|about| about.is_file());
        is_file.then(|| read_drawn(&self.case).ok()).flatten()
    }

    /// The case with that text, as a correlation takes it, and whether it goes on to the law of an adhesive.
    fn plan(&self, text: &str) -> Result<(Plan, bool)> {
        keeps_to(&self.folder, text, None)?;
        let document = CaseDocument::parse(text, &self.case)?;
        let is_joint = document.case.interface.is_some();
        let case = if is_joint { document.run()?.correlation } else { document.correlation()? };
        let plan = Plan::of(&self.asked, &case)?;
        keeps_to(&self.folder, text, Some(&plan))?;
        Ok((plan, is_joint))
    }

    fn check(&self, text: &str) -> Result<Answer> {
        if self.job.is_running() {
            return Err("a run is in progress: what is drawn is checked when it has ended".into());
        }
        let plan = self.plan(text)?.0;
        let Checked { zones, nodes, elements, without_texture, remarks, grid } = check(&plan, &self.pool)?;
        let mesh = json!({ "nodes": rounded(nodes.iter().flatten(), 2), "elements": elements });
        let zones: Vec<Value> = zones.iter().map(zone).collect();
        let flat =
            |lines: &[Vec<[f64; 2]>]| lines.iter().map(|line| rounded(line.iter().flatten(), 3)).collect::<Vec<_>>();
        let grid =
            grid.map(|grid| json!({ "plain": flat(&grid.plain), "seen": flat(&grid.seen), "most_px": grid.most_px }));
        Ok(Answer::json(&json!({
            "zones": zones, "remarks": remarks, "without_texture": without_texture, "mesh": mesh, "grid": grid,
            "pixel_size_mm": plan.pixel_size.map(|size| size.mm_per_px()),
            "pixel_size_relative_std": plan.camera.as_ref().and_then(|camera| camera.pixel_size_relative_std),
        })))
    }

    /// Writes the case file: what was drawn here, over nothing else.
    fn write(&self, text: &str) -> Result<Answer> {
        let path = &self.case;
        let about = std::fs::symlink_metadata(path);
        if about.is_ok_and(|about| !about.is_file()) {
            return Err(
                format!("{}: this is a link or a folder; name another case file with --case", path.display()).into()
            );
        }
        if std::fs::read_to_string(path).is_ok_and(|there| !there.starts_with(DRAWN)) {
            let words = "this was not drawn here and is not replaced; name another case file with --case";
            return Err(format!("{}: {words}", path.display()).into());
        }
        if !text.starts_with(DRAWN) {
            return Err("this is no case file of this page".into());
        }
        let part = path.with_extension("toml.part");
        let written = std::fs::write(&part, text).and_then(|()| std::fs::rename(&part, path));
        written.map_err(|error| RunError::file(path, "written", error))?;
        Ok(Answer::json(&json!({ "written": file_name(path) })))
    }

    fn run(&self, wish: &Wish) -> Result<Answer> {
        let (_, is_joint) = self.plan(&wish.case)?;
        if self.job.is_running() {
            return Err("a run is in progress; stop it first".into());
        }
        self.write(&wish.case)?;
        let wanted = Wanted {
            case: self.case.clone(),
            output: self.output.clone(),
            replace: wish.replace,
            is_joint,
            asked: self.asked.clone(),
            pool: Arc::clone(&self.pool),
        };
        if !self.job.begin(wanted) {
            return Err("a run is in progress; stop it first".into());
        }
        Ok(Answer::json(&json!({})))
    }

    /// The store of the results, where there is one.
    fn results(&self) -> Option<Store> {
        let inner = correlation_in(&self.output);
        let folder = if inner.is_dir() { inner } else { self.output.clone() };
        folder::is_inside(&self.folder, &folder).then(|| Store::open(&folder).ok())?
    }

    fn mesh(&self) -> Result<Answer> {
        let store = self.results().ok_or("there are no results yet")?;
        let mesh = store.mesh();
        Ok(Answer::json(&json!({ "nodes": rounded(mesh.nodes().iter().flatten(), 2), "elements": mesh.elements() })))
    }

    /// The fields of the last frame that is done.
    fn live(&self) -> Result<Answer> {
        let store = self.results().ok_or("there are no results yet")?;
        let done = self.job.n_done().min(store.n_frames());
        let has_field = |number: &usize| store.status(*number).ok().flatten().is_some_and(Status::has_field);
        let Some(number) = (1..=done).rev().find(has_field) else { return Err("no frame is done yet".into()) };
        let mut fields = Vec::new();
        for variable in [Variable::Displacement, Variable::StrainNode, Variable::Residual] {
            let Some(values) = store.values(number, variable)? else { continue };
            let values: Vec<f64> = match values {
                Values::F64(values) => values,
                Values::F32(values) => values.into_iter().map(f64::from).collect(),
                _ => continue,
            };
            let (names, digits): (&[&str], i32) = match variable {
                Variable::Displacement => (&["u_x", "u_y"], 4),
                Variable::StrainNode => (&["strain e_xx", "strain e_yy", "strain e_xy"], 6),
                _ => (&["residual"], 4),
            };
            let on = if variable.place() == Place::Nodes { "nodes" } else { "elements" };
            for (component, label) in names.iter().enumerate() {
                let own = values.iter().skip(component).step_by(variable.n_components());
                fields.push(json!({"name": label, "unit": variable.unit(), "on": on, "values": rounded(own, digits)}));
            }
        }
        Ok(Answer::json(&json!({ "number": number, "fields": fields })))
    }

    fn gauges(&self, from: usize) -> Result<Answer> {
        let store = self.results().ok_or("there are no results yet")?;
        Ok(Answer::json(&gauges::readings(&store, &self.folder, from)?))
    }

    /// The report of the results, where there is one in the folder.
    fn report(&self) -> Option<PathBuf> {
        let path = self.output.join(RunFolder::REPORT);
        (path.is_file() && folder::is_inside(&self.folder, &path)).then_some(path)
    }

    fn read_report(&self) -> Result<Answer> {
        let path = self.report().ok_or("there is no report yet")?;
        let page = std::fs::read_to_string(&path).map_err(|error| RunError::file(&path, "read", error))?;
        Ok(Answer::html(page))
    }

    fn view(&self) -> Result<Answer> {
        self.results().ok_or("there are no results yet")?;
        let args = ViewArgs {
            run: self.output.clone(),
            frames: Frames::All,
            max_mb: VIEW_MB,
            output: None,
            threads: self.threads,
            talk: Quiet { quiet: true },
        };
        Ok(Answer::html(view::make_page(&args)?.html))
    }
}

/// A zone that was checked, as the page takes it.
fn zone(zone: &CheckedZone) -> Value {
    let CheckedZone { name, n_elements, n_nodes, n_without_texture, look, sigma_px } = zone;
    let look = look.as_ref().map_or_else(
        |why| json!({ "why": why }),
        |look| {
            let texture = &look.texture;
            json!({
                "noise_grey": look.noise.sigma_grey,
                "speckle_px": texture.speckle_px,
                "gradient_grey_per_px": texture.gradient_grey_per_px,
                "saturated_percent": texture.saturated_percent,
            })
        },
    );
    json!({
        "name": name,
        "elements": n_elements,
        "nodes": n_nodes,
        "without_texture": n_without_texture,
        "sigma_px": sigma_px,
        "look": look,
    })
}

/// Numbers with so many digits behind the point; what is none is null.
fn rounded<'a>(numbers: impl Iterator<Item = &'a f64>, digits: i32) -> Vec<Option<f64>> {
    let scale = 10f64.powi(digits);
    numbers.map(|v| v.is_finite().then(|| (v * scale).round() / scale)).collect()
}
