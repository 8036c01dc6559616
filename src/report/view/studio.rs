//! The page of `quadrille studio`: the images, the drawing, what is checked of it, the run, the results.

use super::draw::{Drawing, SCRIPT as DRAW, with_parts};
use super::{IMAGE, Palette, TOOLS, colours_of, page_of};
use serde_json::{Value, json};

const BEFORE: &str = include_str!("studio_before.html");
const BESIDE: &str = include_str!("studio_beside.html");
const AFTER: &str = include_str!("studio_after.html");
const SCRIPT: &str = include_str!("studio.js");
/// It asks its own server, and shows the page of the results within.
const ALSO: &str = "; connect-src 'self'; frame-src 'self'";

/// What the page shows.
#[derive(Debug)]
pub struct Studio<'a> {
    /// The drawing on the image that is shown.
    pub drawing: Drawing<'a>,
    /// The images of the folder in order: each with `name` and `pattern`.
    pub images: Value,
    /// Names of other files in the folder that a case may name: `loads`, `cameras`.
    pub files: Value,
    /// The number of the one that is shown, from 0.
    pub image: usize,
    /// Why it cannot be.
    pub fault: Option<String>,
    /// Name of the case file.
    pub case: String,
    /// Name of the folder of the results.
    pub output: String,
    /// Whether there are results.
    pub has_results: bool,
    /// Whether there is a report of them.
    pub has_report: bool,
}

impl Studio<'_> {
    /// The page.
    pub fn html(&self) -> String {
        let mut data = self.drawing.data();
        data["studio"] = json!({
            "images": self.images,
            "files": self.files,
            "image": self.image,
            "fault": self.fault,
            "case": self.case,
            "output": self.output,
            "has_results": self.has_results,
            "has_report": self.has_report,
            "colours": colours_of(Palette::Viridis),
        });
        page_of(&with_parts(ALSO, BEFORE, BESIDE, AFTER), &[IMAGE, TOOLS, DRAW, SCRIPT].concat(), &data)
    }
}
