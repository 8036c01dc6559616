//! A report as one HTML page that needs nothing else: pictures are in it, nothing is fetched.
//!
//! Text stays text: only what has to be a picture is one. Curves are drawn twice, for wide and for narrow screens, so
//! that their letters are as large as the page's on both; the numbers that they draw stand beside them (`data-series`),
//! for programs and for the one script of the page, which says those under the pointer. What is [`Interactive`] brings
//! more of it.

use super::words::capital;
use super::{Look, Picture, Plot, ReportError, to_strings};
use crate::digest::sha256;
use crate::remark::Remark;
use base64::Engine;
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder};
use maud::{DOCTYPE, Markup, PreEscaped, html};

/// Between the axes of the curves on wide and on narrow screens.
const WIDE: [i32; 2] = [430, 300];
const COMPACT: [i32; 2] = [270, 220];
/// Quality of the pictures over images, per cent.
const JPEG_QUALITY: u8 = 85;

/// Says the numbers of curves under the pointer.
const SCRIPT: &str = include_str!("curves.js");

/// Its line breaks are for who reads it here.
const STYLE: &str = include_str!("page.css");

/// A report.
#[derive(Debug, Clone, Default)]
pub struct Page {
    /// Its title.
    pub title: String,
    /// One line below it.
    pub subtitle: String,
    /// Its sections, in order.
    pub sections: Vec<Section>,
}

/// A part of a report.
#[derive(Debug, Clone, Default)]
pub struct Section {
    /// Its title.
    pub title: String,
    /// What stands in it.
    pub blocks: Vec<Block>,
}

/// A piece of a section.
#[derive(Debug, Clone)]
pub enum Block {
    /// A paragraph.
    Text(String),
    /// A paragraph that must not be missed.
    Lead {
        /// What it says.
        text: String,
        /// Whether it is a warning.
        warning: bool,
    },
    /// A heading within the section.
    Heading(String),
    /// Names with their values.
    Facts(Vec<(String, String)>),
    /// A table; on narrow screens every row is a list with the names of the columns.
    Table {
        /// Names of the columns.
        columns: Vec<String>,
        /// The rows, with a text for each column.
        rows: Vec<Vec<String>>,
    },
    /// A small square table with names at both sides, such as a matrix of correlations.
    Matrix {
        /// Names of rows and columns.
        names: Vec<String>,
        /// Its rows.
        rows: Vec<Vec<String>>,
    },
    /// Parts of a whole, each with a bar.
    Parts(Vec<Part>),
    /// Curves.
    Curves(Curves),
    /// A field over an image.
    Map(Map),
    /// Pieces side by side where there is room.
    Grid(Vec<Block>),
    /// What moves: at most one in a page. Its section is left out on paper and where no script runs.
    Interactive(Interactive),
}

impl Block {
    /// A paragraph that must not be missed, in the colour of warnings where the remark is one.
    pub fn of_remark(remark: &Remark) -> Self {
        Self::Lead { text: capital(&remark.text), warning: remark.is_warning() }
    }

    pub(super) fn text(text: impl Into<String>) -> Self {
        Self::Text(text.into())
    }

    /// A sentence that has neither capital nor full stop yet.
    pub(super) fn sentence(text: &str) -> Self {
        Self::Text(format!("{}.", capital(text)))
    }

    pub(super) fn warning(text: impl Into<String>) -> Self {
        Self::Lead { text: text.into(), warning: true }
    }

    pub(super) fn table(columns: &[&str], rows: impl IntoIterator<Item = Vec<String>>) -> Self {
        Self::Table { columns: to_strings(columns), rows: rows.into_iter().collect() }
    }

    /// Curves, as [`Curves::new`].
    pub(super) fn curves(plot: &Plot, caption: impl Into<String>) -> Result<Self, ReportError> {
        Curves::new(plot, caption).map(Self::Curves)
    }
}

/// A part of a page with a script of its own.
#[derive(Debug, Clone, Default)]
pub struct Interactive {
    /// What stands in the section, as HTML.
    pub html: String,
    /// Its style.
    pub style: String,
    /// Its script.
    pub script: String,
    /// What the script reads from the element `data`, as JSON without `<`.
    pub data: String,
}

/// One bar among others.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// Before the bar.
    pub name: String,
    /// Length of the bar, 0 to 1.
    pub length: f64,
    /// After the bar.
    pub text: String,
    /// Whether it stands beside the whole and is no part of it.
    pub apart: bool,
}

/// Curves, drawn for wide and for narrow screens.
#[derive(Debug, Clone)]
pub struct Curves {
    wide: String,
    narrow: String,
    title: String,
    caption: String,
    data: String,
    axes: String,
}

impl Curves {
    /// Draws `plot`; the caption takes the place of its notes.
    ///
    /// # Errors
    /// Those of [`Plot::draw`].
    pub fn new(plot: &Plot, caption: impl Into<String>) -> Result<Self, ReportError> {
        let plot = Plot { notes: Vec::new(), ..plot.clone() };
        let (wide, narrow) = (plot.draw_in(WIDE, Look::Screen)?, plot.draw_in(COMPACT, Look::Screen)?);
        // Where the horizontal axis begins and ends, as shares of the width of the picture.
        let frame = |picture: &Picture| {
            let (area, width) = (picture.map_area(), f64::from(picture.width()));
            [f64::from(area.x) / width, f64::from(area.x + area.width) / width]
        };
        let axes = serde_json::json!({
            "x": plot.x.label,
            "y": plot.y.label,
            "log": plot.x.log,
            "range": plot.ends_of_x()?,
            "wide": frame(&wide),
            "narrow": frame(&narrow),
        });
        let [wide, narrow] = [wide, narrow].map(|picture| picture.svg().to_owned());
        let (data, axes) = (numbers_of(&plot), axes.to_string());
        Ok(Self { wide, narrow, title: plot.title, caption: caption.into(), data, axes })
    }
}

/// The numbers that `plot` draws, as JSON: of each series `name`, `x`, `y` and, where it has a band, `low` and `high`.
fn numbers_of(plot: &Plot) -> String {
    let numbers_of = |series: &super::PlotSeries| {
        let mut numbers = serde_json::json!({ "name": series.name, "x": series.x, "y": series.y });
        if let Some([below, above]) = &series.band {
            let edge = |reach: &[f64], sign: f64| -> Vec<f64> {
                series.y.iter().zip(reach).map(|(y, reach)| y + sign * reach).collect()
            };
            numbers["low"] = edge(below, -1.0).into();
            numbers["high"] = edge(above, 1.0).into();
        }
        numbers
    };
    serde_json::Value::from(plot.series.iter().map(numbers_of).collect::<Vec<_>>()).to_string()
}

/// A field over an image: the picture without letters, and its bar.
#[derive(Debug, Clone)]
pub struct Map {
    picture: Vec<u8>,
    bar: Option<Vec<u8>>,
    ends: [String; 2],
    caption: String,
    /// Width over height, where it is much higher than wide: several are then side by side.
    tall: Option<f64>,
}

impl Map {
    /// Cuts map and bar out of `picture`; `range` are the values at the ends of the bar, with their unit.
    ///
    /// # Errors
    /// A picture that cannot be encoded.
    pub fn new(picture: &Picture, range: [String; 2], caption: impl Into<String>) -> Result<Self, ReportError> {
        let cut = |area: super::Area| {
            let width = picture.width() as usize;
            let rows = (area.y..area.y + area.height).map(|y| 3 * (y as usize * width + area.x as usize));
            let rgb: Vec<u8> =
                rows.flat_map(|at| picture.rgb()[at..at + 3 * area.width as usize].iter().copied()).collect();
            Pixels { width: area.width, height: area.height, rgb }.jpeg()
        };
        let bar = picture.bar_area().map(cut).transpose()?;
        Ok(Self { picture: cut(picture.map_area())?, bar, ends: range, caption: caption.into(), tall: None })
    }

    /// A map that is drawn already, with its bar and what its ends stand for where it has one.
    pub(super) fn of_pixels(
        map: &Pixels,
        bar: Option<(&Pixels, [String; 2])>,
        caption: String,
    ) -> Result<Self, ReportError> {
        let (bar, ends) = bar.unzip();
        let bar = bar.map(Pixels::jpeg).transpose()?;
        let tall = (4 * map.height > 5 * map.width).then(|| f64::from(map.width) / f64::from(map.height));
        Ok(Self { picture: map.jpeg()?, bar, ends: ends.unwrap_or_default(), caption, tall })
    }
}

/// Pixels of a picture, red, green and blue, row by row.
#[derive(Debug, Clone)]
pub(super) struct Pixels {
    pub width: u32,
    pub height: u32,
    pub rgb: Vec<u8>,
}

impl Pixels {
    fn jpeg(&self) -> Result<Vec<u8>, ReportError> {
        let mut bytes = Vec::new();
        JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY)
            .write_image(&self.rgb, self.width, self.height, ExtendedColorType::Rgb8)
            .map_err(ReportError::Encode)?;
        Ok(bytes)
    }
}

/// How wide a column of a grid is at least, where tall maps stand in it: as high as a window, no less than a caption
/// needs, and two beside each other on a telephone.
fn column_of(blocks: &[Block]) -> Option<String> {
    const HEIGHT_REM: f64 = 28.0;
    const LEAST_REM: f64 = 10.0;
    let tall = blocks.iter().find_map(|block| if let Block::Map(map) = block { map.tall } else { None })?;
    Some(format!("--column:min(47%,{:.1}rem)", (HEIGHT_REM * tall).max(LEAST_REM)))
}

fn data(kind: &str, bytes: &[u8]) -> String {
    format!("data:image/{kind};base64,{}", base64::engine::general_purpose::STANDARD.encode(bytes))
}

impl Page {
    /// The page as HTML.
    pub fn html(&self) -> String {
        let interactive = self.sections.iter().find_map(Section::interactive);
        let style = STYLE.replace('\n', "");
        let script = [SCRIPT, interactive.map_or("", |part| &part.script)].concat();
        let sha256 = base64::engine::general_purpose::STANDARD.encode(sha256(script.as_bytes()));
        let policy =
            format!("default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-{sha256}'");
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    meta http-equiv="Content-Security-Policy" content=(policy);
                    title { (self.title) }
                    style { (PreEscaped(style)) @if let Some(part) = interactive { (PreEscaped(&part.style)) } }
                }
                body {
                    header { h1 { (self.title) } p.small { (self.subtitle) } }
                    main {
                        @for section in &self.sections {
                            section class=[section.interactive().map(|_| "explore")] {
                                h2 { (section.title) }
                                @for block in &section.blocks { (block.markup()) }
                            }
                        }
                    }
                    // Behind all that can be read: it is the larger part.
                    @if let Some(part) = interactive {
                        script id="data" type="application/json" { (PreEscaped(&part.data)) }
                    }
                    script { (PreEscaped(&script)) }
                }
            }
        };
        page.into_string()
    }
}

impl Section {
    fn interactive(&self) -> Option<&Interactive> {
        self.blocks.iter().find_map(|block| match block {
            Block::Interactive(part) => Some(part),
            _ => None,
        })
    }
}

impl Block {
    fn markup(&self) -> Markup {
        match self {
            Self::Text(text) => html! { p { (text) } },
            Self::Lead { text, warning } => html! { p class=(if *warning { "lead warn" } else { "lead" }) { (text) } },
            Self::Heading(text) => html! { h3 { (text) } },
            Self::Facts(facts) => html! {
                table { tbody { @for (name, value) in facts { tr { th scope="row" { (name) } td { (value) } } } } }
            },
            Self::Table { columns, rows } => html! {
                table.wide {
                    thead { tr { @for name in columns { th scope="col" { (name) } } } }
                    tbody {
                        @for row in rows {
                            tr { @for (name, value) in columns.iter().zip(row) { td.n data-name=(name) { (value) } } }
                        }
                    }
                }
            },
            Self::Matrix { names, rows } => html! {
                table {
                    thead { tr { th {} @for name in names { th scope="col" { (name) } } } }
                    tbody {
                        @for (name, row) in names.iter().zip(rows) {
                            tr { th scope="row" { (name) } @for value in row { td.n { (value) } } }
                        }
                    }
                }
            },
            Self::Parts(parts) => html! {
                div.parts {
                    @for part in parts {
                        span { (part.name) }
                        div.track {
                            div class=(if part.apart { "fill apart" } else { "fill" })
                                style=(format!("width:{:.1}%", 100.0 * part.length.clamp(0.0, 1.0))) {}
                        }
                        span.n { (part.text) }
                    }
                }
            },
            Self::Curves(curves) => html! {
                figure data-title=(curves.title) data-series=(curves.data) data-axes=(curves.axes) {
                    div.over tabindex="0" aria-label=(format!("{}; arrow keys say the values", curves.title)) {
                        picture {
                            source media="(max-width: 640px)" srcset=(data("svg+xml", curves.narrow.as_bytes()));
                            img src=(data("svg+xml", curves.wide.as_bytes())) alt=(curves.title);
                        }
                        span.here hidden {}
                    }
                    output {}
                    figcaption { (curves.caption) }
                }
            },
            Self::Map(map) => html! {
                figure {
                    img src=(data("jpeg", &map.picture)) alt=(map.caption);
                    @if let Some(bar) = &map.bar {
                        div.bar { span { (map.ends[0]) } img src=(data("jpeg", bar)) alt="colours from low to high"; span { (map.ends[1]) } }
                    }
                    figcaption { (map.caption) }
                }
            },
            Self::Interactive(part) => html! { (PreEscaped(&part.html)) },
            Self::Grid(blocks) => {
                html! { div.grid style=[column_of(blocks)] { @for block in blocks { div { (block.markup()) } } } }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::{PlotSeries, Style};

    #[test]
    fn what_users_write_is_text_and_nothing_is_fetched() {
        let series = PlotSeries::new("a & b", Style::Line, vec![0.0, 1.0], vec![1.0, 2.0]);
        let blocks = vec![
            Block::text("<script>alert(1)</script> & \"x\""),
            Block::table(&["a\"b"], [vec!["<i>".into()]]),
            Block::curves(&Plot::new("<b>", "x", "y", [series]), "a < b").unwrap(),
        ];
        let sections = vec![Section { title: "S&".into(), blocks }];
        let html = Page { title: "T<".into(), sections, ..Page::default() }.html();
        assert!(html.starts_with("<!DOCTYPE html>"));
        assert!(html.contains("&lt;script&gt;alert(1)&lt;/script&gt; &amp; &quot;x&quot;"));
        // The one script is that of the page.
        assert_eq!(html.matches("<script").count(), 1);
        assert!(html.contains(&format!("<script>{SCRIPT}</script>")));
        assert!(!html.contains("<i>") && !html.contains("data-name=\"a\"b\""));
        // The name space of SVG stands within the encoded pictures alone.
        for address in ["http:", "https:", "src=\"/", "url("] {
            assert!(!html.contains(address), "{address}");
        }
    }

    #[test]
    fn what_moves_brings_the_one_script_that_may_run_and_its_data_stand_behind_the_text() {
        let part = Interactive {
            html: "<canvas></canvas>".into(),
            style: ".x{}".into(),
            script: "run();".into(),
            data: "[1]".into(),
        };
        let section = |title: &str, blocks| Section { title: title.into(), blocks };
        let page = Page {
            sections: vec![section("Fields", vec![Block::Interactive(part)]), section("Last", Vec::new())],
            ..Page::default()
        };
        let html = page.html();
        let script = format!("{SCRIPT}run();");
        let sha256 = base64::engine::general_purpose::STANDARD.encode(sha256(script.as_bytes()));
        assert!(html.contains(&format!("script-src 'sha256-{sha256}'\"")) && html.contains(&script));
        assert!(html.contains("<section class=\"explore\"><h2>Fields</h2><canvas></canvas></section>"));
        assert!(html.contains("<section><h2>Last</h2></section>"));
        let at = |text: &str| html.find(text).unwrap();
        assert!(at(".x{}</style>") < at("Last") && at("Last") < at("id=\"data\"") && at("[1]") < at("run();"));
    }
}
