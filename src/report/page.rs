//! A report as one HTML page that needs nothing else: pictures are in it, nothing is fetched.
//!
//! Text stays text: only what has to be a picture is one. Curves are drawn twice, for wide and for narrow screens, so
//! that their letters are as large as the page's on both; the numbers that they draw stand beside them (`data-series`),
//! for programs and for the one script of the page, which says those under the pointer. What is [`Interactive`] brings
//! more of it.

use super::words::capital;
use super::{Picture, Plot, ReportError};
use crate::digest::sha256;
use crate::remark::Remark;
use base64::Engine;
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder};
use maud::{DOCTYPE, Markup, PreEscaped, html};

/// Between the axes of the curves on narrow screens.
const COMPACT: [i32; 2] = [270, 220];
/// Quality of the pictures over images, per cent.
const JPEG_QUALITY: u8 = 85;

/// Says the numbers of curves under the pointer.
const SCRIPT: &str = include_str!("curves.js");

const STYLE: &str = "\
:root{color-scheme:light}\
*{box-sizing:border-box}\
body{margin:0 auto;padding:1rem;max-width:64rem;font:16px/1.5 system-ui,-apple-system,'Segoe UI',Roboto,'DejaVu Sans',sans-serif;color:#1a1a1a;background:#fff;overflow-wrap:break-word}\
h1{font-size:1.6rem;line-height:1.2;margin:.5rem 0}\
h2{font-size:1.25rem;line-height:1.25;margin:2rem 0 .5rem;border-bottom:2px solid #2b5c8a;padding-bottom:.2rem}\
h3{font-size:1rem;margin:1rem 0 .25rem}\
p{margin:.5rem 0;max-width:46rem}\
.lead{border-left:4px solid #2b5c8a;background:#eef4fa;padding:.5rem .75rem;margin:.75rem 0}\
.lead.warn{border-color:#b25d00;background:#fff4e5}\
.small{color:#555;font-size:.875rem}\
.grid{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,26rem),1fr));gap:1rem}\
figure{margin:.75rem 0;break-inside:avoid}\
figure img{display:block;width:100%;height:auto}\
figure img.tall{width:auto;max-width:100%;max-height:32rem}\
figcaption{font-size:.875rem;color:#333}\
.over{position:relative;touch-action:pan-y}\
.over .here{position:absolute;top:0;bottom:0;width:0;border-left:1px dashed #555;pointer-events:none}\
.over .here[hidden]{display:none}\
output{display:block;min-height:1.5em;font-size:.875rem;font-variant-numeric:tabular-nums}\
.bar{display:grid;grid-template-columns:auto 1fr auto;gap:.5rem;align-items:center;font-size:.875rem;margin:.25rem 0}\
.bar img{height:.9rem;width:100%;border:1px solid #333}\
.parts{display:grid;grid-template-columns:auto 1fr auto;gap:.2rem .6rem;align-items:center;font-size:.9375rem;margin:.5rem 0;max-width:46rem;break-inside:avoid}\
.parts .track{background:#eee;height:.9rem;min-width:2rem;print-color-adjust:exact;-webkit-print-color-adjust:exact}\
.parts .fill{background:#2b5c8a;height:100%}\
.parts .fill.apart{background:#b5b5b5}\
.parts .n{font-variant-numeric:tabular-nums;text-align:right}\
table{border-collapse:collapse;width:100%;font-size:.9375rem;margin:.5rem 0;break-inside:avoid}\
th,td{text-align:left;padding:.3rem .5rem;border-bottom:1px solid #ccc;vertical-align:top}\
thead th{border-bottom:2px solid #333}\
td{overflow-wrap:anywhere}\
table.wide td{overflow-wrap:break-word}\
td.n{font-variant-numeric:tabular-nums}\
code{font:.8125rem ui-monospace,'DejaVu Sans Mono',monospace;overflow-wrap:anywhere}\
@media (max-width:640px){\
table.wide thead{display:none}\
table.wide tr{display:block;border-bottom:2px solid #999;padding:.35rem 0}\
table.wide th,table.wide td{display:grid;grid-template-columns:9.5rem 1fr;gap:.5rem;border:0;padding:.1rem 0}\
table.wide th::before,table.wide td::before{content:attr(data-name);font-weight:400;color:#555}\
}\
@media print{output,.over .here{display:none}body{max-width:none;font-size:11pt;padding:0}h2,h3{break-after:avoid}table.wide{font-size:9pt}.grid{grid-template-columns:1fr 1fr}a{color:inherit}}";

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
        let (wide, narrow) = (plot.draw_sized([430, 300])?, plot.draw_sized(COMPACT)?);
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
        let svg = |picture: Picture| picture.svg().to_owned();
        let (data, axes) = (numbers_of(&plot), axes.to_string());
        Ok(Self { wide: svg(wide), narrow: svg(narrow), title: plot.title, caption: caption.into(), data, axes })
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
    /// Whether it is much higher than wide: it is then shown as high as a window.
    is_tall: bool,
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
        Ok(Self { picture: cut(picture.map_area())?, bar, ends: range, caption: caption.into(), is_tall: false })
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

impl Map {
    /// A map that is drawn already, with its bar and what its ends stand for where it has one.
    pub(super) fn of_pixels(
        map: &Pixels,
        bar: Option<(&Pixels, [String; 2])>,
        caption: impl Into<String>,
    ) -> Result<Self, ReportError> {
        let (bar, ends) = match bar {
            Some((bar, ends)) => (Some(bar.jpeg()?), ends),
            None => (None, [String::new(), String::new()]),
        };
        let is_tall = 4 * map.height > 5 * map.width;
        Ok(Self { picture: map.jpeg()?, bar, ends, caption: caption.into(), is_tall })
    }
}

fn data(kind: &str, bytes: &[u8]) -> String {
    format!("data:image/{kind};base64,{}", base64::engine::general_purpose::STANDARD.encode(bytes))
}

impl Page {
    /// The page as HTML.
    pub fn html(&self) -> String {
        let interactive = self.sections.iter().find_map(Section::interactive);
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
                    style { (PreEscaped(STYLE)) @if let Some(part) = interactive { (PreEscaped(&part.style)) } }
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
                    img class=[map.is_tall.then_some("tall")] src=(data("jpeg", &map.picture)) alt=(map.caption);
                    @if let Some(bar) = &map.bar {
                        div.bar { span { (map.ends[0]) } img src=(data("jpeg", bar)) alt="colours from low to high"; span { (map.ends[1]) } }
                    }
                    figcaption { (map.caption) }
                }
            },
            Self::Interactive(part) => html! { (PreEscaped(&part.html)) },
            Self::Grid(blocks) => html! { div.grid { @for block in blocks { div { (block.markup()) } } } },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::{Axis, PlotSeries, Style};

    #[test]
    fn what_users_write_is_text_and_nothing_is_fetched() {
        let plot = Plot {
            title: "<b>".into(),
            x: Axis::linear("x"),
            y: Axis::linear("y"),
            series: vec![PlotSeries::new("a & b", Style::Line, vec![0.0, 1.0], vec![1.0, 2.0])],
            ..Plot::default()
        };
        let blocks = vec![
            Block::Text("<script>alert(1)</script> & \"x\"".into()),
            Block::Table { columns: vec!["a\"b".into()], rows: vec![vec!["<i>".into()]] },
            Block::Curves(Curves::new(&plot, "a < b").unwrap()),
        ];
        let page = Page {
            title: "T<".into(),
            subtitle: String::new(),
            sections: vec![Section { title: "S&".into(), blocks }],
        };
        let html = page.html();
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
