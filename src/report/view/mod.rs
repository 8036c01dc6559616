//! The page on which one looks around in a run: every frame and quantity over the image, values with their uncertainty,
//! profiles, gauges. One file that needs nothing else: its numbers are in it, its script is in it and the only one that
//! may run.
//!
//! A number has 16 bits: `low + step * code` of its quantity and frame, code 65535 where there is none. The codes of
//! all quantities of a frame stand behind one another, each as the difference from the one before; first the lower
//! bytes of all, then the upper ones, deflated (zlib) and in base64. Read by `page.js` beside this file.
//!
//! [`Drawing`] is its sister: the page on which zones are drawn; [`Studio`] the same with steps before and behind it.

mod draw;
mod law;
mod studio;

pub use draw::Drawing;
pub use law::LawView;
pub use studio::Studio;

use super::page::Interactive;
use super::scale::outer_ends;
use super::{Backdrop, Palette};
use crate::field::{ElementMark, Status};
use crate::mesh::Mesh;
use crate::units::Px;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use serde_json::{Value, json};
use std::io::Write;

const HTML: &str = include_str!("page.html");
/// What stands in a page of its own and in a report.
const EXPLORER: &str = include_str!("explorer.html");
const EXPLORER_STYLE: &str = include_str!("explorer.css");
const STYLE: &str = concat!(include_str!("explorer.css"), include_str!("page.css"));
const SCRIPT: &str = include_str!("page.js");
/// The law explorer.
const LAW: &str = include_str!("law.js");
/// What both pages do with an image: closer, farther, mouse and fingers.
const IMAGE: &str = include_str!("image.js");
/// Numbers and curves, of a run and while it goes on.
const TOOLS: &str = include_str!("tools.js");

/// The code of a number that is not there.
const MISSING: u16 = u16::MAX;
/// Steps between the least and the largest number of a quantity in a frame.
const STEPS: f64 = 65_534.0;
/// Share of the numbers at either end that the colours leave out.
const TRIM: f64 = 0.005;

/// Where the numbers of a quantity live.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum On {
    /// On the nodes.
    Nodes,
    /// On the elements.
    Elements,
}

/// A quantity.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Layer {
    /// Short name, by which the page is asked for it.
    pub key: &'static str,
    /// What people call it.
    pub label: String,
    /// Its unit; `1` without.
    pub unit: &'static str,
    /// Where its numbers live.
    pub on: On,
    /// Place in the list of the quantity that is its standard uncertainty.
    pub sigma: Option<usize>,
    /// Colours.
    pub palette: Palette,
    /// Whether it is shown by itself.
    pub choice: bool,
    /// Nodes along a side of the window that its numbers are taken over; 0 without.
    pub window: usize,
    /// What `quadrille figures --quantity` is given for it.
    pub figure: Option<&'static str>,
    /// Its array in the store, and the component of it as Python selects it.
    pub stored: Option<(&'static str, Option<String>)>,
}

/// The numbers of one frame, made small.
#[derive(Debug, Clone)]
pub struct Packed {
    text: String,
    /// Least number and step of each quantity.
    scale: Vec<[f64; 2]>,
    /// Between which ends the colours of each quantity go.
    ends: Vec<Option<[f64; 2]>>,
}

impl Packed {
    /// Packs the numbers of a frame: of each quantity a list.
    pub fn new(values: &[Vec<f64>]) -> Self {
        let mut codes: Vec<u16> = Vec::with_capacity(values.iter().map(Vec::len).sum());
        let (mut scale, mut ends) = (Vec::new(), Vec::new());
        for list in values {
            let finite = || list.iter().copied().filter(|v| v.is_finite());
            let low = finite().reduce(f64::min).unwrap_or(0.0);
            let step = (finite().reduce(f64::max).unwrap_or(0.0) - low) / STEPS;
            let code = |v: f64| match step > 0.0 {
                true => ((v - low) / step).round().clamp(0.0, STEPS) as u16,
                false => 0,
            };
            let mut before = 0;
            for &v in list {
                let code = if v.is_finite() { code(v) } else { MISSING };
                codes.push(code.wrapping_sub(before));
                before = code;
            }
            scale.push([low, step]);
            ends.push(outer_ends(finite().collect(), TRIM));
        }
        let planes: Vec<u8> = [0, 1].into_iter().flat_map(|k| codes.iter().map(move |c| c.to_le_bytes()[k])).collect();
        let mut deflated = ZlibEncoder::new(Vec::new(), Compression::default());
        // Into memory, which does not fail.
        let bytes = deflated.write_all(&planes).and_then(|()| deflated.finish()).unwrap_or_default();
        Self { text: STANDARD.encode(bytes), scale, ends }
    }

    /// Its size in the page, bytes, nearly.
    pub fn size(&self) -> usize {
        self.text.len() + 48 * self.scale.len()
    }
}

/// A frame of the series, shown or not.
#[derive(Debug, Clone)]
pub struct ViewFrame {
    /// Its number, from 1.
    pub number: usize,
    /// Its file, without folders.
    pub file: String,
    /// How it ended; `None` when it is not done.
    pub status: Option<Status>,
    /// Its numbers; `None` without a field, or where it was left out to keep the page small.
    pub packed: Option<Packed>,
}

/// A number of every frame: its number, its time, its load.
#[derive(Debug, Clone)]
pub struct Column {
    /// Name with unit.
    pub label: String,
    /// One for each frame that is listed; NaN where it is not known.
    pub values: Vec<f64>,
}

/// What the page shows.
#[derive(Debug)]
pub struct View<'a> {
    /// What a page of its own begins with; a report has that already.
    pub head: Option<Head>,
    /// The folder of its fields, as a command is given it.
    pub folder: String,
    /// The reference image.
    pub backdrop: &'a Backdrop,
    /// mm of a pixel, where they are known.
    pub mm_per_px: Option<f64>,
    /// The mesh on it.
    pub mesh: &'a Mesh<Px>,
    /// The quantities.
    pub layers: Vec<Layer>,
    /// Frames of the series.
    pub n_frames: usize,
    /// Those that are listed.
    pub frames: Vec<ViewFrame>,
    /// The first is the number of the frame.
    pub columns: Vec<Column>,
    /// What the numbers mean: names and texts.
    pub about: Vec<(String, String)>,
    /// The fit of a joint, where there is one.
    pub law: Option<LawView<'a>>,
}

/// What stands above all else.
#[derive(Debug, Clone, Default)]
pub struct Head {
    /// The title of the page.
    pub title: String,
    /// One line below it.
    pub subtitle: String,
    /// What must not be missed, and whether it is a warning.
    pub lead: Vec<(String, bool)>,
}

impl View<'_> {
    /// The page.
    pub fn html(&self) -> String {
        let page = HTML.replacen("{EXPLORER}", EXPLORER.replace("{OPEN}", " open").trim_end(), 1);
        page_of(&page, &[IMAGE, TOOLS, SCRIPT, LAW].concat(), &self.data())
    }

    /// The same within a report.
    pub fn interactive(&self) -> Interactive {
        // It stands below a heading there, and what is long is closed.
        let mut html = EXPLORER.replace("{OPEN}", "");
        for (from, to) in [("h3>", "h4>"), ("h2>", "h3>")] {
            html = html.replace(from, to);
        }
        Interactive {
            html,
            style: EXPLORER_STYLE.to_owned(),
            script: [IMAGE, TOOLS, SCRIPT, LAW].concat(),
            data: within_script(&self.data()),
        }
    }

    fn data(&self) -> Value {
        let [width, height] = self.backdrop.size();
        let nodes: Vec<u8> = (self.mesh.nodes().iter().flatten()).flat_map(|x| (*x as f32).to_le_bytes()).collect();
        let elements: Vec<u8> = self.mesh.elements().iter().flatten().flat_map(|node| node.to_le_bytes()).collect();
        let mut palettes = serde_json::Map::new();
        for palette in [Palette::Viridis, Palette::Plasma, Palette::BlueRed] {
            palettes.insert(name_of(palette).into(), colours_of(palette).into());
        }
        let marks = [ElementMark::None].into_iter().chain(ElementMark::ALL);
        let words = |mark: ElementMark| if mark == ElementMark::None { "nothing is the matter" } else { mark.words() };
        let marks: serde_json::Map<String, Value> =
            marks.map(|mark| (mark.code().to_string(), words(mark).into())).collect();
        let lead = self.head.iter().flat_map(|head| &head.lead);
        let lead = lead.map(|(text, warning)| json!({"text": text, "warning": warning}));
        json!({
            "title": self.head.as_ref().map(|head| &head.title),
            "subtitle": self.head.as_ref().map(|head| &head.subtitle),
            "lead": lead.collect::<Vec<_>>(),
            "image": {"width": width, "height": height, "png": self.backdrop.png().map(|png| STANDARD.encode(png))},
            "folder": self.folder,
            "pixel_size_mm": self.mm_per_px,
            "mesh": {"nodes": STANDARD.encode(nodes), "elements": STANDARD.encode(elements)},
            "palettes": palettes,
            "marks": marks,
            "layers": self.layers.iter().enumerate().map(|(k, layer)| self.layer(k, layer)).collect::<Vec<_>>(),
            "n_frames": self.n_frames,
            "frames": self.frames.iter().map(frame).collect::<Vec<_>>(),
            "columns": self.columns.iter().map(|c| json!({"label": c.label, "values": c.values})).collect::<Vec<_>>(),
            "about": self.about,
            "fit": self.law.as_ref().map(LawView::data),
        })
    }

    fn layer(&self, k: usize, layer: &Layer) -> Value {
        let ends = self.frames.iter().filter_map(|frame| frame.packed.as_ref()?.ends[k]);
        let [mut low, mut high] = ends.reduce(|[a, b], [low, high]| [a.min(low), b.max(high)]).unwrap_or([0.0, 1.0]);
        let signed = layer.palette.is_diverging();
        if signed {
            let most = low.abs().max(high.abs());
            (low, high) = (-most, most);
        }
        if high.partial_cmp(&low) != Some(std::cmp::Ordering::Greater) {
            let half = if low == 0.0 { 1.0 } else { 0.1 * low.abs() };
            (low, high) = (low - half, high + half);
        }
        json!({
            "key": layer.key,
            "label": layer.label,
            "unit": layer.unit,
            "place": match layer.on { On::Nodes => "node", On::Elements => "element" },
            "sigma": layer.sigma.map_or(-1, |sigma| sigma as i64),
            "palette": name_of(layer.palette),
            "signed": signed,
            "choice": layer.choice,
            "range": [low, high],
            "window": layer.window,
            "figure": layer.figure,
            "python": layer.stored.as_ref().map(|(name, select)| json!({"name": name, "select": select})),
        })
    }
}

/// The page `html` with its one `script`, which alone may run, and the `data` that it shows.
fn page_of(html: &str, script: &str, data: &Value) -> String {
    let data = within_script(data);
    let sha256 = STANDARD.encode(crate::digest::sha256(script.as_bytes()));
    let style = ("{STYLE}", STYLE.trim_end());
    fill_in(html, &[("{SCRIPT_SHA256}", &sha256), style, ("{SCRIPT}", script), ("{DATA}", &data)])
}

/// `html` with texts for its names, one after the other, each in its first place.
fn fill_in(html: &str, texts: &[(&str, &str)]) -> String {
    texts.iter().fold(html.to_owned(), |html, (name, text)| html.replacen(name, text, 1))
}

/// The 256 colours of a palette in base64.
fn colours_of(palette: Palette) -> String {
    let colours: Vec<u8> = (0..256).flat_map(|t| palette.colour(f64::from(t) / 255.0)).collect();
    STANDARD.encode(colours)
}

/// JSON that no script ends in.
fn within_script(data: &Value) -> String {
    data.to_string().replace('<', "\\u003c")
}

fn name_of(palette: Palette) -> &'static str {
    match palette {
        Palette::Viridis | Palette::Cividis => "viridis",
        Palette::Plasma => "plasma",
        Palette::BlueRed => "blue-red",
    }
}

fn frame(frame: &ViewFrame) -> Value {
    let has_field = frame.status.is_some_and(Status::has_field);
    json!({
        "number": frame.number,
        "file": frame.file,
        "status": frame.status.map_or("not done".to_owned(), |status| status.name().replace('_', " ")),
        "bad": frame.status.is_some_and(|status| status != Status::Converged),
        "note": (has_field && frame.packed.is_none()).then_some("not in this page"),
        "field": frame.packed.as_ref().map(|packed| packed.text.as_str()),
        "scale": frame.packed.as_ref().map(|packed| packed.scale.as_slice()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::read::ZlibDecoder;
    use std::io::Read;

    /// What `page.js` does with the numbers of a frame.
    fn unpacked(packed: &Packed, sizes: &[usize]) -> Vec<Vec<f64>> {
        let mut bytes = Vec::new();
        ZlibDecoder::new(&STANDARD.decode(&packed.text).unwrap()[..]).read_to_end(&mut bytes).unwrap();
        let n = bytes.len() / 2;
        let mut at = 0;
        let list = |(k, &size): (usize, &usize)| {
            let mut code = 0_u16;
            let [low, step] = packed.scale[k];
            (0..size)
                .map(|_| {
                    code = code.wrapping_add(u16::from_le_bytes([bytes[at], bytes[n + at]]));
                    at += 1;
                    if code == MISSING { f64::NAN } else { low + step * f64::from(code) }
                })
                .collect()
        };
        sizes.iter().enumerate().map(list).collect()
    }

    #[test]
    fn numbers_come_back_to_half_a_step_and_missing_ones_stay_missing() {
        let values = vec![
            vec![1.25, f64::NAN, -3.5, 7.0, f64::INFINITY],
            vec![0.125; 3],
            vec![f64::NAN; 2],
            vec![],
            vec![-1e-9, 1e-9],
        ];
        let packed = Packed::new(&values);
        let found = unpacked(&packed, &values.iter().map(Vec::len).collect::<Vec<_>>());
        for ((list, found), [_, step]) in values.iter().zip(&found).zip(&packed.scale) {
            for (v, found) in list.iter().zip(found) {
                // Half a step, and the rounding of one product and sum.
                let off = (v - found).abs();
                assert!(
                    if v.is_finite() { off <= 0.5 * step + 1e-15 * v.abs() } else { found.is_nan() },
                    "{v} {found}"
                );
            }
        }
        assert_eq!((packed.ends[1], packed.ends[2]), (Some([0.125; 2]), None));
    }
}
