//! The page on which zones, cracks, gauges and a scale are drawn on the reference image: it writes the case file.

use super::super::Backdrop;
use super::{IMAGE, TOOLS, fill_in, page_of};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};

const HTML: &str = include_str!("draw.html");
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
        page_of(&with_parts("", "", "", ""), &[IMAGE, TOOLS, SCRIPT].concat(), &self.data())
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

/// The page with what else it may do (a policy), and what stands before, beside and behind the drawing.
pub(super) fn with_parts(also: &str, before: &str, beside: &str, behind: &str) -> String {
    let parts =
        [("{BEFORE}", before), ("{BESIDE}", beside), ("{AFTER}", behind)].map(|(name, part)| (name, part.trim_end()));
    fill_in(HTML, &[&[("{ALSO}", also)], &parts[..]].concat())
}
