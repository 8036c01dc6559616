//! The page on which zones, cracks, gauges and a scale are drawn on the reference image: it writes the case file.

use super::super::Backdrop;
use super::{IMAGE, page_of};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::json;

const HTML: &str = include_str!("draw.html");
const SCRIPT: &str = include_str!("draw.js");

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
}

impl Drawing<'_> {
    /// The page.
    pub fn html(&self) -> String {
        let [width, height] = self.backdrop.size();
        let data = json!({
            "quadrille": env!("CARGO_PKG_VERSION"),
            "shown": self.shown,
            "reference": self.reference,
            "page": self.page,
            "deformed": self.deformed,
            "folder": self.folder,
            "width": width,
            "height": height,
            "png": self.backdrop.png().map(|png| STANDARD.encode(png)),
        });
        page_of(HTML, &[IMAGE, SCRIPT].concat(), &data)
    }
}
