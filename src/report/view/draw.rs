//! The page on which zones, cracks, gauges and a scale are drawn on the reference image: it writes the case file.

use super::super::Backdrop;
use super::{IMAGE, page_of};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};

pub(super) const HTML: &str = include_str!("draw.html");
pub(super) const SCRIPT: &str = include_str!("draw.js");

/// What the page shows, and what its case file says of images.
#[derive(Debug)]
pub struct Drawing<'a> {
    /// The reference image.
    pub backdrop: &'a Backdrop,
    /// Its file, as the page names it.
    pub shown: String,
    /// What the case file names as reference; `None` where the first of the deformed images is it.
    pub reference: Option<String>,
    /// Page of TIFF files with several pages.
    pub page: usize,
    /// Names or globs of the deformed images.
    pub deformed: Vec<String>,
    /// Where the case file has to be saved for these names.
    pub folder: String,
    /// The case file that is gone on with, as it was read: what the page can draw of it is there to begin with.
    pub case: Option<Value>,
    /// Its folder, where that is not `folder`.
    pub case_folder: Option<String>,
}

impl Drawing<'_> {
    /// The page.
    pub fn html(&self) -> String {
        let page = Parts::default().of(HTML);
        page_of(&page, &[IMAGE, SCRIPT].concat(), &self.data())
    }

    /// What its script is given.
    pub(super) fn data(&self) -> Value {
        let [width, height] = self.backdrop.size();
        json!({
            "quadrille": env!("CARGO_PKG_VERSION"),
            "shown": self.shown,
            "reference": self.reference,
            "page": self.page,
            "deformed": self.deformed,
            "folder": self.folder,
            "case": self.case,
            "case_folder": self.case_folder,
            "width": width,
            "height": height,
            "png": self.backdrop.png().map(|png| STANDARD.encode(png)),
        })
    }
}

/// What stands around the drawing.
#[derive(Default)]
pub(super) struct Parts {
    /// What else the page may do, as a policy.
    pub also: &'static str,
    /// Before the drawing.
    pub before: &'static str,
    /// Behind it.
    pub after: &'static str,
}

impl Parts {
    /// The page with these parts.
    pub fn of(&self, html: &str) -> String {
        let with = |html: String, name: &str, text: &str| html.replacen(name, text, 1);
        let html = with(html.to_owned(), "{ALSO}", self.also);
        let html = with(html, "{BEFORE}", self.before.trim_end());
        with(html, "{AFTER}", self.after.trim_end())
    }
}
