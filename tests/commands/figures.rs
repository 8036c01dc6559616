//! Curves and figures: what must be in the picture.
//!
//! The pictures stay in `target/tmp/figures`, to be looked at.

#![cfg(feature = "cli")]

use crate::common::blobs;
use crate::common::data;
use crate::program;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use blobs::{speckle, uniform};
use program::Desk;
use program::browser::seen;
use quadrille::backend::cpu::CpuBackend;
use quadrille::correlate::{Correlator, Options};
use quadrille::field::{ElementMark, Measurement, RemoveRigid, Status, StrainWindow};
use quadrille::imaging::Image;
use quadrille::io::images::read_image;
use quadrille::mesh::{Mesh, Roi, Zone, ZoneElements};
use quadrille::report::{
    Area, Axis, Backdrop, Figure, FigureOptions, Format, Look, MapOptions, MeshOptions, Palette, Picture, Plot,
    PlotSeries, ReportError, Style, deformed_mesh, draw_frame, element_map, mesh_figure, nodal_map, nodal_map_on,
    register_figure,
};
use quadrille::units::{PixelSize, Px};
use resvg::{tiny_skia, usvg};
use std::path::{Path, PathBuf};
use std::sync::Arc;

fn folder() -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("figures");
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// What holds for every picture; saves it under `name` as PNG and SVG.
#[track_caller]
fn check(name: &str, picture: &Picture) {
    let (width, height) = (picture.width(), picture.height());
    let png = folder().join(format!("{name}.png"));
    picture.save(&png).unwrap();
    picture.save(folder().join(format!("{name}.svg"))).unwrap();
    let read = image::open(&png).unwrap().into_rgb8();
    assert_eq!((read.width(), read.height()), (width, height), "{name}");
    assert_eq!(read.as_raw(), picture.rgb(), "{name}: the file does not hold the picture");
    for y in 0..height {
        for x in 0..width {
            // A clipped label would leave ink on the border.
            if x < 4 || y < 4 || x + 4 >= width || y + 4 >= height {
                assert_eq!(picture.pixel(x, y).unwrap(), [255; 3], "{name}: ink at the border, ({x}, {y})");
            }
        }
    }
    check_drawing(name, picture.svg(), width, height, picture.rgb());
}

/// The SVG is well-formed, asks for no font, shows what the PNG shows, and nothing reaches beyond the sheet.
#[track_caller]
fn check_drawing(name: &str, svg: &str, width: u32, height: u32, rgb: &[u8]) {
    let mut reader = quick_xml::Reader::from_str(svg);
    reader.config_mut().check_end_names = true;
    loop {
        match reader.read_event() {
            Ok(quick_xml::events::Event::Eof) => break,
            Ok(quick_xml::events::Event::Start(tag) | quick_xml::events::Event::Empty(tag)) => {
                let tag_name = tag.name().as_ref().to_owned();
                assert!(!["text", "tspan", "style", "font"].contains(&tag_name.as_str()), "{name}: <{tag_name}>");
                for attribute in tag.attributes() {
                    let attribute = attribute.unwrap_or_else(|error| panic!("{name}: {error}"));
                    let key = attribute.key.as_ref().to_owned();
                    assert!(!key.contains("font") && key != "class", "{name}: {key}");
                    let value = attribute.value.to_string();
                    // Nothing from outside the file.
                    if key.ends_with("href") {
                        assert!(value.starts_with("data:image/png;base64,"), "{name}");
                    } else {
                        assert!(!value.contains("NaN") && !value.contains("inf"), "{name}: {key}");
                    }
                }
            }
            Ok(_) => {}
            Err(error) => panic!("{name}: {error}"),
        }
    }
    let tree = usvg::Tree::from_str(svg, &usvg::Options::default()).unwrap();
    let mut pixels = tiny_skia::Pixmap::new(width, height).unwrap();
    let scale = width as f32 / tree.size().width();
    resvg::render(&tree, tiny_skia::Transform::from_scale(scale, scale), &mut pixels.as_mut());
    let same = pixels.data().chunks_exact(4).zip(rgb.chunks_exact(3)).all(|(a, b)| a[..3] == *b);
    assert!(same, "{name}: the SVG shows something else than the PNG");
    // Texts, axes and bars are whole. What is clipped to the map may be larger.
    for node in tree.root().children() {
        if node.id().is_empty() && !matches!(node, usvg::Node::Group(group) if group.clip_path().is_some()) {
            let b = node.abs_stroke_bounding_box();
            let (w, h) = (tree.size().width(), tree.size().height());
            // Single precision of some hundred units.
            let off = 1e-4;
            let inside = b.left() >= -off && b.top() >= -off && b.right() <= w + off && b.bottom() <= h + off;
            assert!(inside, "{name}: {b:?} reaches beyond {w} x {h}");
        }
    }
}

/// What is written in a picture, in the order of drawing.
fn labels(picture: &Picture) -> Vec<String> {
    let marked = picture.svg().split("aria-label=\"").skip(1);
    let text = |part: &str| part.split('"').next().unwrap_or_default().replace("&gt;", ">").replace("&lt;", "<");
    marked.map(text).collect()
}

/// Whether something that holds `words` is written in a picture.
#[track_caller]
fn assert_says(picture: &Picture, words: &str) {
    let labels = labels(picture);
    assert!(labels.join(" ").contains(words), "'{words}' is not in {labels:?}");
}

/// Mean position of the pixels of one colour, from the upper left corner of the area, and their number.
fn centre_of(picture: &Picture, area: Area, colour: [u8; 3]) -> ([f64; 2], usize) {
    let (mut sum, mut n) = ([0.0; 2], 0);
    for y in 0..area.height {
        for x in 0..area.width {
            if picture.pixel(area.x + x, area.y + y) == Some(colour) {
                sum = [sum[0] + f64::from(x) + 0.5, sum[1] + f64::from(y) + 0.5];
                n += 1;
            }
        }
    }
    (sum.map(|v| v / n as f64), n)
}

fn count(picture: &Picture, wanted: impl Fn([u8; 3]) -> bool) -> usize {
    picture.rgb().chunks_exact(3).filter(|c| wanted([c[0], c[1], c[2]])).count()
}

/// The red of warnings.
fn warns(picture: &Picture) -> bool {
    count(picture, |c| c == [176, 0, 0]) > 20
}

fn near(a: [u8; 3], b: [u8; 3], by: u8) -> bool {
    a.iter().zip(b).all(|(&a, b)| a.abs_diff(b) <= by)
}

const BLUE: [u8; 3] = [0, 114, 178];
const VERMILION: [u8; 3] = [213, 94, 0];

fn curve(n: usize, f: impl Fn(f64) -> f64) -> (Vec<f64>, Vec<f64>) {
    let x: Vec<f64> = (0..n).map(|k| k as f64 / (n - 1) as f64).collect();
    let y = x.iter().map(|&x| f(x)).collect();
    (x, y)
}

fn load_curves() -> Plot {
    let (x, y) = curve(200, |x| 120.0 * x * (-2.0 * x).exp());
    let (xm, ym) = curve(15, |x| 118.0 * x * (-2.0 * x).exp() + 0.3 * (30.0 * x).sin());
    let scaled = |by: f64| ym.iter().map(|v| by * v).collect::<Vec<_>>();
    Plot {
        title: "Load against opening".into(),
        x: Axis::linear("opening (mm)"),
        y: Axis::linear("load (N)"),
        series: vec![
            PlotSeries::new("model", Style::Line, x, y).with_band(vec![1.5; 200]),
            PlotSeries::new("test 1", Style::Markers, xm.clone(), ym.clone()).with_band(vec![1.0; 15]),
            PlotSeries::new("test 2", Style::LineAndMarkers, xm.clone(), scaled(0.9)),
            PlotSeries::new("limit", Style::Dashed, vec![0.0, 1.0], vec![20.0, 20.0]),
            PlotSeries::new("a", Style::Markers, xm.clone(), scaled(0.6)),
            PlotSeries::new("b", Style::Markers, xm.clone(), scaled(0.3)),
        ],
        notes: vec!["Band and bars: \u{b1}2 standard uncertainties <k = 2> & \"more\".".into()],
        ..Plot::default()
    }
}

#[test]
fn curves_bands_bars_and_names_are_all_in_the_picture() {
    let picture = load_curves().draw().unwrap();
    check("load", &picture);
    for (series, colour) in [[0, 114, 178], [213, 94, 0], [0, 158, 115], [204, 121, 167]].into_iter().enumerate() {
        assert!(centre_of(&picture, picture.map_area(), colour).1 > 100, "series {series} is not drawn");
    }
    for words in ["Load against opening", "opening (mm)", "load (N)", "model", "test 1", "limit", "standard", "0.4"] {
        assert_says(&picture, words);
    }
    // The band: a fifth of the colour over white.
    let light = count(&picture, |c| near(c, [199, 224, 239], 3));
    assert!(light > 10_000, "{light} pixels of the band");
}

#[test]
fn points_stand_where_their_values_say_on_linear_and_logarithmic_axes() {
    let cases = [
        (Axis::linear("x").with_range(0.0, 10.0), Axis::linear("y").with_range(-1.0, 1.0), [2.5, 0.5], [0.25, 0.25]),
        (Axis::log("x").with_range(0.01, 100.0), Axis::linear("y").with_range(0.0, 1.0), [1.0, 0.5], [0.5, 0.5]),
        (
            Axis::log("x").with_range(1.0, 10.0),
            Axis::log("y").with_range(1e-6, 1e-2),
            [10f64.sqrt(), 1e-5],
            [0.5, 0.75],
        ),
    ];
    for (x, y, point, want) in cases {
        let series = vec![PlotSeries::new("", Style::Markers, vec![point[0]], vec![point[1]])];
        let picture = Plot { x, y, series, ..Plot::default() }.draw().unwrap();
        let area = picture.map_area();
        let (at, n) = centre_of(&picture, area, BLUE);
        assert!(n > 20, "no marker at {point:?}");
        // A marker of 8 px is symmetric about its place to half a pixel.
        for (k, length) in [area.width, area.height].into_iter().enumerate() {
            assert!((at[k] - want[k] * f64::from(length)).abs() < 0.5, "{point:?} stands at {at:?}");
        }
    }
}

#[test]
fn what_no_axis_can_show_is_left_out_and_said() {
    let nan = f64::NAN;
    let x: Vec<f64> = (0..9).map(f64::from).collect();
    let y = vec![1.0, 10.0, 100.0, nan, 100.0, 0.0, -3.0, 10.0, 1.0];
    let plot = |y: Vec<f64>, axis| Plot {
        x: Axis::linear("frame (1)"),
        y: axis,
        series: vec![PlotSeries::new("", Style::Line, x.clone(), y)],
        ..Plot::default()
    };
    let picture = plot(y.clone(), Axis::log("load (N)")).draw().unwrap();
    check("gaps", &picture);
    assert_says(&picture, "2 points at or below zero");
    // The gap at 3: nothing between the columns of 2 and 4 but the grid.
    let area = picture.map_area();
    let middle = |k: f64| area.x + ((0.5 + k) / 9.0 * f64::from(area.width)) as u32;
    let column = Area { x: middle(2.7), width: middle(3.3) - middle(2.7), ..area };
    assert_eq!(centre_of(&picture, column, BLUE).1, 0);
    assert!(centre_of(&picture, Area { x: middle(0.4), width: 30, ..area }, BLUE).1 > 20);
    // On a linear axis nothing is missing but what is no number.
    assert!(!warns(&plot(y, Axis::linear("load (N)")).draw().unwrap()));

    for y in [vec![nan; 9], vec![-1.0; 9], vec![f64::INFINITY; 9]] {
        let picture = plot(y, Axis::log("load (N)")).draw().unwrap();
        check("no_value", &picture);
        assert_says(&picture, "no value to show");
    }
    check("nothing", &Plot::default().draw().unwrap());
}

#[test]
fn any_span_of_values_gets_axes_with_two_numbers_at_least() {
    for log in [false, true] {
        for (low, high) in
            [(1e-9, 3e9), (0.9, 1.1), (0.02, 0.05), (3.0, 3.0), (4.0, 128.0), (1e-280, 1e280), (99.0, 101.0)]
        {
            let axis = |label: &str| Axis { log, ..Axis::linear(label) };
            let series = vec![PlotSeries::new("", Style::LineAndMarkers, vec![low, high], vec![low, high])];
            let picture = Plot { x: axis("x"), y: axis("y"), series, ..Plot::default() }.draw().unwrap();
            check("span", &picture);
            let numbers =
                labels(&picture).iter().filter(|label| label.starts_with(|c: char| c.is_ascii_digit())).count();
            assert!(numbers >= 4, "log {log}, {low} to {high}: {:?}", labels(&picture));
        }
    }
}

#[test]
fn long_names_and_many_series_stay_on_the_sheet() {
    let word = "a name that goes on and on ".repeat(9);
    let series = (0..23).map(|k| {
        let (x, y) = curve(30, |x| (f64::from(k) * x).sin());
        let name = if k == 7 { word.clone() } else { format!("series {k}") };
        PlotSeries::new(name, [Style::Line, Style::Dashed, Style::Markers][k as usize % 3], x, y)
    });
    let plot = Plot {
        title: word.clone(),
        x: Axis::linear(word.clone()),
        y: Axis::linear(word.clone()),
        series: series.collect(),
        notes: vec![word.clone(), "blank_free".repeat(40)],
        ..Plot::default()
    };
    check("crowded", &plot.draw().unwrap());
}

/// A field of `u` on `mesh`.
fn field(mesh: Mesh<Px>, u: impl Fn([f64; 2]) -> [f64; 2]) -> Measurement<Px> {
    Measurement {
        status: Status::Converged,
        displacement: mesh.nodes().iter().map(|&x| u(x)).collect(),
        sigma: vec![[0.01, 0.02]; mesh.n_nodes()],
        measured: vec![true; mesh.n_nodes()],
        element_residual: (0..mesh.n_elements()).map(|e| 2.0 + (e as f64).sin()).collect(),
        model_error: None,
        marks: None,
        points: None,
        mesh: mesh.into(),
    }
}

fn grids(rois: &[[f64; 4]], size: usize, width: usize, height: usize) -> Mesh<Px> {
    let zone =
        |(k, &[x0, y0, x1, y1]): (usize, &[f64; 4])| Zone::rectangle(format!("strip {k}"), Roi { x0, y0, x1, y1 });
    Mesh::on_zones(&rois.iter().enumerate().map(zone).collect::<Vec<_>>(), size, width, height).unwrap()
}

/// A free mesh: distorted quadrilaterals, two triangles, and a quadrilateral turned the other way round.
fn distorted() -> Mesh<Px> {
    let nodes = vec![
        [10.0, 10.0],
        [80.0, 20.0],
        [150.0, 5.0],
        [190.0, 30.0],
        [20.0, 90.0],
        [90.0, 70.0],
        [140.0, 85.0],
        [195.0, 80.0],
        [5.0, 145.0],
        [70.0, 140.0],
        [150.0, 130.0],
        [180.0, 145.0],
    ];
    let elements =
        vec![[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 7], [2, 7, 6, 6], [4, 5, 9, 8], [9, 5, 6, 10], [6, 10, 11, 7]];
    Mesh::from_zones(vec![ZoneElements { name: "free".into(), nodes, elements }]).unwrap()
}

#[test]
fn distorted_elements_and_triangles_show_a_linear_field_as_it_is() {
    let image = uniform(200, 150, 128);
    let measurement = field(distorted(), |_| [0.0; 2]);
    let linear = |[x, y]: [f64; 2]| 0.01 * x - 0.02 * y;
    let values: Vec<f64> = measurement.mesh.nodes().iter().map(|&p| linear(p)).collect();
    let options = MapOptions { opacity: 1.0, range: Some((-3.0, 2.0)), ..MapOptions::new("Distorted", "u (px)") };
    let picture = nodal_map(&image, &measurement, &values, &options).unwrap();
    check("distorted", &picture);
    let area = picture.map_area();
    let (mut inside, mut wrong) = (0, 0);
    for j in 0..area.height {
        for i in 0..area.width {
            // 900 picture pixels for 200 image pixels, the first centred on -1/2 + 1/9.
            let [x, y] = [i, j].map(|k| (f64::from(k) + 0.5) * 200.0 / 900.0 - 0.5);
            let covered = measurement.mesh.find(x, y).is_some();
            let got = picture.pixel(area.x + i, area.y + j).unwrap();
            let want = Palette::Viridis.colour((linear([x, y]) + 3.0) / 5.0);
            inside += usize::from(covered);
            // Bilinear elements hold linear fields exactly: what is left is rounding to 8 bit.
            wrong += usize::from(covered != near(got, want, 1));
        }
    }
    // Where an edge goes through the centre of a pixel, round-off decides.
    assert!(inside > 400_000 && wrong < 20, "{wrong} of {inside} pixels are wrong");
}

#[test]
fn signed_quantities_are_white_at_zero_whatever_their_range() {
    let image = uniform(160, 160, 90);
    let measurement = field(grids(&[[0.0, 0.0, 160.0, 160.0]], 16, 160, 160), |_| [0.0; 2]);
    let values: Vec<f64> = (0..100)
        .map(|e| {
            if e < 50 {
                -0.25
            } else if e < 99 {
                0.0
            } else {
                1.0
            }
        })
        .collect();
    let options = MapOptions { palette: Palette::BlueRed, opacity: 1.0, ..MapOptions::new("Strain", "exx (-)") };
    let picture = element_map(&image, &measurement, &values, &options).unwrap();
    check("diverging", &picture);
    let area = picture.map_area();
    let at = |x: u32, y: u32| picture.pixel(area.x + x, area.y + y).unwrap();
    assert!(near(at(450, 600), Palette::BlueRed.colour(0.5), 1));
    assert!(near(at(890, 890), Palette::BlueRed.colour(1.0), 1));
    assert!(near(at(450, 100), Palette::BlueRed.colour(0.375), 1), "-0.25 in a range of +-1");
    let [low, high] = [0.0, 1.0].map(|t| Palette::BlueRed.colour(t));
    assert!(low[2] > low[0] && high[0] > high[2], "blue below, red above");
}

#[test]
fn one_wild_value_does_not_take_all_the_colours() {
    let image = uniform(640, 640, 90);
    let measurement = field(grids(&[[0.0, 0.0, 640.0, 640.0]], 16, 640, 640), |_| [0.0; 2]);
    let mut values: Vec<f64> = (0..1600).map(|e| f64::from(e) / 1600.0).collect();
    let draw = |values: &[f64], trim: f64| {
        let options = MapOptions { trim, opacity: 1.0, ..MapOptions::new("Wild", "u (px)") };
        element_map(&image, &measurement, values, &options).unwrap()
    };
    let calm = draw(&values, 0.005);
    assert_eq!(calm, draw(&values, 0.0), "nothing is cut off an even spread");
    values[800] = 1e6;
    assert!(labels(&draw(&values, 0.0)).iter().any(|label| label == "1000000"));
    let picture = draw(&values, 0.005);
    check("wild", &picture);
    assert!(labels(&picture).iter().any(|label| label == "0.5"), "{:?}", labels(&picture));
    // The tip above the bar has the colour of the end.
    let bar = picture.bar_area().unwrap();
    let end = Palette::Viridis.colour(1.0);
    let tip = picture.pixel(bar.x + bar.width / 2, bar.y - 5).unwrap();
    assert!(near(tip, end, 1), "{tip:?}");
}

#[test]
fn a_frame_that_did_not_converge_says_so_in_its_picture() {
    let image = speckle(160, 120);
    let mut measurement = field(grids(&[[8.0, 8.0, 152.0, 112.0]], 16, 160, 120), |x| [0.01 * x[0], 0.0]);
    let draw = |measurement: &Measurement<Px>| {
        let values: Vec<f64> = measurement.displacement.iter().map(|u| u[0]).collect();
        nodal_map(&image, measurement, &values, &MapOptions::new("Frame 3", "ux (px)")).unwrap()
    };
    assert!(!warns(&draw(&measurement)));
    for (status, words) in [(Status::IterationLimit, "not converged"), (Status::LeftImage, "left the image")] {
        measurement.status = status;
        let picture = draw(&measurement);
        check(status.name(), &picture);
        assert!(warns(&picture));
        assert_says(&picture, words);
    }
}

#[test]
fn axes_in_mm_stand_beside_those_in_px() {
    let image = speckle(300, 200);
    let measurement = field(grids(&[[10.0, 10.0, 290.0, 190.0]], 10, 300, 200), |x| [0.01 * x[0], 0.0]);
    let values: Vec<f64> = measurement.displacement.iter().map(|u| u[0]).collect();
    let options = MapOptions { pixel_size: PixelSize::new(0.01), ..MapOptions::new("Frame 3", "ux (px)") };
    let picture = nodal_map(&image, &measurement, &values, &options).unwrap();
    check("mm", &picture);
    for words in ["x (mm)", "y (mm)", "x (px)", "y (px)", "250", "2.5"] {
        assert_says(&picture, words);
    }
}

#[test]
fn more_pixels_for_print_show_the_same_drawing() {
    let image = speckle(300, 200);
    let measurement = field(grids(&[[10.0, 10.0, 290.0, 190.0]], 10, 300, 200), |x| [0.01 * x[0], 0.0]);
    let values: Vec<f64> = measurement.displacement.iter().map(|u| u[0]).collect();
    let options = MapOptions::new("Frame 3", "ux (px)");
    let draw = |ratio| nodal_map_on(&Backdrop::new(&image, ratio), &measurement, &values, &options).unwrap();
    let (one, two) = (draw(1), draw(2));
    check("print", &two);
    assert_eq!((two.width(), two.height()), (2 * one.width(), 2 * one.height()));
    assert_eq!(two.map_area().width, 2 * one.map_area().width);
    // Four pixels of the large picture make one of the small: the means of both are the same.
    let mean =
        |picture: &Picture| picture.rgb().iter().map(|&v| f64::from(v)).sum::<f64>() / picture.rgb().len() as f64;
    assert!((mean(&one) - mean(&two)).abs() < 0.5, "{} {}", mean(&one), mean(&two));
}

#[test]
fn the_mesh_is_drawn_with_gaps_names_and_guard_bands() {
    let backdrop = Backdrop::new(&uniform(200, 200, 128), 1);
    let mesh = grids(&[[20.0, 20.0, 180.0, 90.0], [20.0, 110.0, 180.0, 180.0]], 10, 200, 200);
    let mut measured = vec![true; mesh.n_nodes()];
    // One node: a gap of four elements around (60, 50).
    let lost = mesh.nodes().iter().position(|p| *p == [60.0, 50.0]).unwrap();
    measured[lost] = false;
    let options = MeshOptions { guard_px: vec![0.0, 4.0], ..MeshOptions::new("Mesh") };
    let picture = mesh_figure(&backdrop, &mesh, Some(&measured), &options).unwrap();
    check("mesh", &picture);
    for words in ["strip 0", "strip 1", "220 of 224 elements", "guard band"] {
        assert_says(&picture, words);
    }
    let area = picture.map_area();
    let at = |x: f64, y: f64| {
        let pixel = |v: f64| ((v + 0.5) * 4.5) as u32;
        picture.pixel(area.x + pixel(x), area.y + pixel(y)).unwrap()
    };
    let grey = at(5.0, 5.0);
    assert_ne!(at(80.0, 55.0), grey, "an edge");
    assert_eq!(at(85.0, 55.0), grey, "inside an element");
    assert_eq!(at(60.0, 55.0), grey, "an edge of the gap");
    assert_ne!(at(50.0, 55.0), grey, "the border of the gap");
    assert_ne!(at(95.0, 112.0), grey, "the guard band");
    assert_eq!(at(95.0, 115.0), grey, "beyond it");
    assert_eq!(at(95.0, 107.0), grey, "outside the zone");
    assert_eq!(at(95.0, 22.5), grey, "the zone without one");
    let whole = mesh_figure(&backdrop, &mesh, None, &options).unwrap();
    assert_says(&whole, "224 of 224 elements");
    check("mesh_free", &mesh_figure(&backdrop, &distorted(), None, &options).unwrap());
}

#[test]
fn a_fine_mesh_on_a_large_image_stays_a_small_file() {
    let mesh = grids(&[[0.0, 0.0, 2048.0, 2048.0]], 8, 2048, 2048);
    assert_eq!(mesh.n_elements(), 65_536);
    let backdrop = Backdrop::new(&speckle(2048, 2048), 1);
    let measurement = field(mesh, |x| [0.01 * x[1], 2.0 * (0.01 * x[0]).sin()]);
    let picture = deformed_mesh(&backdrop, false, &measurement, &MeshOptions::new("Fine")).unwrap();
    check("fine", &picture);
    assert!(picture.svg().len() < 2_000_000, "{} bytes", picture.svg().len());
}

#[test]
fn the_deformed_mesh_stands_where_the_magnified_displacement_puts_it() {
    let backdrop = Backdrop::new(&uniform(100, 100, 128), 1);
    let measurement = field(grids(&[[20.0, 20.0, 60.0, 60.0]], 40, 100, 100), |_| [5.0, -2.0]);
    let options = MeshOptions { magnify: Some(3.0), ..MeshOptions::new("Deformed") };
    let picture = deformed_mesh(&backdrop, false, &measurement, &options).unwrap();
    check("deformed", &picture);
    assert_says(&picture, "displacements magnified 3 times");
    let area = picture.map_area();
    let column = |x: f64| area.x + ((x + 0.5) * 9.0) as u32;
    let row = |y: f64| area.y + ((y + 0.5) * 9.0) as u32;
    // The left edge at 20 + 3 x 5, from y = 20 - 6 to 54.
    assert_eq!(picture.pixel(column(35.0), row(40.0)), Some(VERMILION));
    assert_eq!(picture.pixel(column(50.0), row(14.0)), Some(VERMILION));
    assert_ne!(picture.pixel(column(50.0), row(35.0)), Some(VERMILION));
    // On its own image it is not magnified unless asked.
    let own = deformed_mesh(&backdrop, true, &measurement, &MeshOptions::new("Deformed")).unwrap();
    assert_says(&own, "true size");
    // Chosen here: a round number.
    let small = field(grids(&[[20.0, 20.0, 60.0, 60.0]], 10, 100, 100), |x| [0.003 * (x[0] - 20.0), 0.0]);
    assert_says(&deformed_mesh(&backdrop, false, &small, &MeshOptions::new("")).unwrap(), "magnified 20 times");
    // Far outside the image: the sheet grows.
    let far = MeshOptions { magnify: Some(100.0), ..MeshOptions::new("Far") };
    check("far", &deformed_mesh(&backdrop, false, &measurement, &far).unwrap());
}

#[test]
fn zones_in_register_lose_their_rigid_motion_and_say_it() {
    let backdrop = Backdrop::new(&speckle(200, 200), 1);
    let mesh = grids(&[[20.0, 20.0, 180.0, 90.0], [20.0, 110.0, 180.0, 180.0]], 10, 200, 200);
    // The upper zone moves, the lower one turns by 5 degrees about its centre, (100, 145).
    let (sin, cos) = 5f64.to_radians().sin_cos();
    let turned = |[x, y]: [f64; 2]| {
        [(cos - 1.0) * (x - 100.0) - sin * (y - 145.0), sin * (x - 100.0) + (cos - 1.0) * (y - 145.0)]
    };
    let measurement = field(mesh, |x| if x[1] < 100.0 { [12.5, -30.0] } else { turned(x) });
    let options = MeshOptions { magnify: Some(10.0), ..MeshOptions::new("Register") };
    let draw = |which| register_figure(&backdrop, &measurement, which, &options, None).unwrap();
    let zone = draw(RemoveRigid::Zone);
    check("register", &zone);
    assert_says(&zone, "zone 'strip 0': moved by (12.50, \u{2212}30.00) px, turned by 0 deg");
    assert_says(&zone, "turned by 5.000 deg about (100, 145) px");
    // Nothing is left: the zones stand where they stood, and between them is white paper.
    let area = zone.map_area();
    let view = [20.0 - 6.4, 160.0 + 12.8]; // 4 % of 160 px around the mesh
    let at = |x: f64, y: f64| {
        let pixel = |v: f64| ((v - view[0]) / view[1] * f64::from(area.width)) as u32;
        zone.pixel(area.x + pixel(x), area.y + pixel(y)).unwrap()
    };
    assert_eq!(at(100.0, 100.0), [255; 3]);
    for y in [24.0, 86.0, 114.0, 176.0] {
        assert_ne!(at(100.0, y), [255; 3], "{y}");
    }
    // Round-off has no colours.
    assert!(!labels(&zone).iter().any(|label| label.contains("e\u{2212}1")), "{:?}", labels(&zone));
    let all = draw(RemoveRigid::All);
    check("register_all", &all);
    assert_says(&all, "all zones: moved by");
    assert!(all.map_area() != zone.map_area(), "magnified, the zones are apart");
}

/// Fields that are hard to draw, by name.
fn hard_cases() -> Vec<(&'static str, Image, Measurement<Px>)> {
    let square = || grids(&[[8.0, 8.0, 152.0, 120.0]], 16, 160, 128);
    let mut nothing = field(square(), |_| [0.0; 2]);
    nothing.measured.fill(false);
    let mut one = field(square(), |x| [0.01 * x[0], 0.02 * x[1]]);
    let corners = one.mesh.elements()[10].map(|node| node as usize);
    one.measured.iter_mut().enumerate().for_each(|(node, measured)| *measured = corners.contains(&node));
    let mut checkered = field(square(), |x| [0.01 * x[0], 0.0]);
    checkered.measured.iter_mut().enumerate().for_each(|(node, measured)| *measured = node % 2 == 0);
    let mut folded = field(square(), |x| [-3.0 * x[0], 0.5 * x[1]]);
    folded.status = Status::IterationLimit;
    let mut limit = field(square(), |x| [0.02 * x[1], 0.0]);
    limit.element_residual.fill(0.0);
    vec![
        ("nothing", speckle(160, 128), nothing),
        ("one", speckle(160, 128), one),
        ("checkered", speckle(160, 128), checkered),
        ("constant", uniform(160, 128, 7), field(square(), |_| [2.5, 2.5])),
        ("zero", speckle(160, 128), field(square(), |_| [0.0; 2])),
        ("huge", speckle(160, 128), field(square(), |x| [1e200 * x[0], 0.0])),
        ("folded", speckle(160, 128), folded),
        ("no_residual", speckle(160, 128), limit),
        ("single", speckle(16, 16), field(grids(&[[4.0, 4.0, 12.0, 12.0]], 8, 16, 16), |x| [0.1 * x[0], 0.0])),
        ("wide", speckle(800, 20), field(grids(&[[2.0, 2.0, 798.0, 18.0]], 8, 800, 20), |x| [0.01 * x[0], 0.0])),
        ("tall", speckle(20, 800), field(grids(&[[2.0, 2.0, 18.0, 798.0]], 8, 20, 800), |x| [0.01 * x[1], 0.0])),
        ("free", speckle(200, 150), field(distorted(), |x| [0.01 * x[0], 0.001 * x[1] * x[0]])),
    ]
}

#[test]
fn files_are_named_by_frame_and_quantity_and_come_out_the_same_twice() {
    let out = folder().join("named");
    let _ = std::fs::remove_dir_all(&out);
    let image = speckle(160, 128);
    let mut measurement = field(grids(&[[8.0, 8.0, 152.0, 120.0]], 16, 160, 128), |x| [0.01 * x[0], 0.0]);
    let options = FigureOptions {
        figures: vec![Figure::Ux, Figure::Mesh],
        formats: vec![Format::Svg, Format::Png],
        line: Some([10.0, 60.0, 150.0, 60.0]),
        ..FigureOptions::default()
    };
    let draw = |measurement: &Measurement<Px>| {
        draw_frame(&out, 12, measurement, &Backdrop::new(&image, 1), None, &options).unwrap()
    };
    let bytes = |files: &[PathBuf]| files.iter().map(|file| std::fs::read(file).unwrap()).collect::<Vec<_>>();
    let files = draw(&measurement);
    let first = bytes(&files);
    assert_eq!(bytes(&draw(&measurement)), first);
    let mut there: Vec<_> =
        std::fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    there.sort();
    let want = ["mesh.png", "mesh.svg", "ux-profile.png", "ux-profile.svg", "ux.png", "ux.svg"];
    assert_eq!(there, want.map(|name| format!("000012-{name}")));
    measurement.status = Status::Diverged;
    assert!(draw(&measurement).is_empty(), "a diverged field is no measurement");
}

#[test]
fn nodes_of_large_uncertainty_are_hatched_and_left_out_of_the_percentiles() {
    let out = folder().join("hatched");
    let _ = std::fs::remove_dir_all(&out);
    let image = uniform(160, 128, 100);
    let mut measurement = field(grids(&[[8.0, 8.0, 152.0, 120.0]], 16, 160, 128), |x| [0.01 * x[0], 0.0]);
    let backdrop = Backdrop::new(&image, 1);
    let options = FigureOptions {
        figures: vec![Figure::Ux, Figure::ExxWindow],
        formats: vec![Format::Svg],
        strain_window: StrainWindow::new(3),
        ..FigureOptions::default()
    };
    let draw = |measurement: &Measurement<Px>| {
        let files = draw_frame(&out, 1, measurement, &backdrop, None, &options).unwrap();
        files.iter().map(|file| std::fs::read_to_string(file).unwrap()).collect::<Vec<_>>()
    };
    measurement.sigma.iter_mut().for_each(|sigma| *sigma = [0.01; 2]);
    let sure = draw(&measurement);
    // 80 nodes in 10 columns: one beyond each end is left out by rounding.
    assert!(sure[0].contains("percentiles 1 to 99: 0.08000 to 1.520 px, on 63 of 63 elements"), "{}", sure[0]);
    assert!(!sure[0].contains("hatched") && sure[1].contains("plane fitted to 3 x 3"));
    let wild = 33;
    measurement.sigma[wild] = [0.2; 2];
    measurement.displacement[wild] = [50.0, 0.0];
    let hatched = draw(&measurement);
    let told = "hatched: 1 node has a standard uncertainty above 5 times the median";
    assert!(hatched.iter().all(|svg| svg.contains(told)), "{}", hatched[0]);
    assert!(hatched[0].contains("percentiles 1 to 99: 0.08000 to 1.520 px"), "the wild value is told: {}", hatched[0]);
    let clips = |svg: &str| svg.matches("<clipPath").count();
    assert_eq!(clips(&hatched[0]), clips(&sure[0]) + 1, "its elements are not hatched");
    let options = FigureOptions { strain_window: None, ..options.clone() };
    let error = draw_frame(&out, 1, &measurement, &backdrop, None, &options).unwrap_err().to_string();
    assert!(error.contains("--strain-window"), "{error}");
}

#[test]
fn a_profile_follows_the_field_and_breaks_where_nothing_was_measured() {
    let image = uniform(400, 100, 128);
    let mut measurement = field(grids(&[[0.0, 10.0, 400.0, 90.0]], 10, 400, 100), |x| [0.01 * x[0], 0.0]);
    for (node, at) in measurement.mesh.nodes().iter().enumerate() {
        measurement.measured[node] = at[0] < 195.0 || at[0] > 225.0;
    }
    let out = folder().join("profile");
    let options = FigureOptions {
        figures: vec![Figure::Ux, Figure::Exx, Figure::Residual],
        line: Some([0.0, 50.0, 400.0, 50.0]),
        ..FigureOptions::default()
    };
    let backdrop = Backdrop::new(&image, 1);
    let files = draw_frame(&out, 1, &measurement, &backdrop, None, &options).unwrap();
    let read = |name: &str| image::open(out.join(name)).unwrap().into_rgb8();
    let is_line = |p: &image::Rgb<u8>| near(p.0, BLUE, 40);
    assert_eq!(files.len(), 6);
    for name in ["000001-ux-profile.png", "000001-exx-profile.png", "000001-residual-profile.png"] {
        let picture = read(name);
        let columns: Vec<u32> = picture.enumerate_pixels().filter(|(.., p)| is_line(p)).map(|(x, ..)| x).collect();
        let (first, last) = (*columns.iter().min().unwrap(), *columns.iter().max().unwrap());
        // From 190 to 230 px of 400 there is nothing; two pixels of the line's width.
        let at = |x: f64| first + ((x / 400.0) * f64::from(last - first)) as u32;
        assert!(!columns.iter().any(|c| (at(190.0) + 4..at(230.0) - 4).contains(c)), "{name}");
        assert!(columns.iter().any(|c| *c < at(180.0)) && columns.iter().any(|c| *c > at(240.0)), "{name}");
    }
}

#[test]
fn what_cannot_be_drawn_is_refused() {
    let series = |band: Option<Vec<f64>>, y: usize| PlotSeries {
        name: "odd".into(),
        x: vec![1.0; 3],
        y: vec![1.0; y],
        band: band.map(|half| [half.clone(), half]),
        ..PlotSeries::default()
    };
    for series in [series(None, 2), series(Some(vec![1.0; 4]), 3)] {
        let error = Plot { series: vec![series], ..Plot::default() }.draw().unwrap_err();
        assert!(matches!(error, ReportError::Series { .. }) && error.to_string().contains("odd"), "{error}");
    }
    let plot = |x: Axis| Plot { x, ..Plot::default() }.draw();
    let error = plot(Axis::log("x").with_range(0.0, 1.0)).unwrap_err();
    assert!(matches!(error, ReportError::LogRange { .. }), "{error}");
    for (low, high) in [(1.0, 1.0), (2.0, 1.0), (f64::NAN, 1.0), (0.0, f64::INFINITY)] {
        let error = plot(Axis::linear("x").with_range(low, high)).unwrap_err();
        assert!(matches!(error, ReportError::Range { .. }), "{error}");
    }
    let picture = Plot::default().draw().unwrap();
    for name in ["map.pdf", "map", "png"] {
        let error = picture.save(folder().join(name)).unwrap_err();
        assert!(matches!(error, ReportError::Ending { .. }) && error.to_string().contains(name), "{error}");
    }
    for name in ["a.png", "a.svg"] {
        let error = picture.save(folder().join("no such folder").join(name)).unwrap_err();
        assert!(matches!(error, ReportError::Write { .. }) && error.to_string().contains(name), "{error}");
    }

    let backdrop = Backdrop::new(&uniform(64, 64, 1), 1);
    let measurement = field(grids(&[[0.0, 0.0, 64.0, 64.0]], 16, 64, 64), |x| [0.01 * x[0], 0.0]);
    let error = mesh_figure(&backdrop, &measurement.mesh, Some(&[true; 3]), &MeshOptions::new("")).unwrap_err();
    assert!(matches!(error, ReportError::Length { what: "nodes", got: 3, .. }), "{error}");
    for factor in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e7] {
        let options = MeshOptions { magnify: Some(factor), ..MeshOptions::new("") };
        let error = deformed_mesh(&backdrop, false, &measurement, &options).unwrap_err();
        assert!(matches!(error, ReportError::Magnification { .. }), "{error}");
        let error = register_figure(&backdrop, &measurement, RemoveRigid::All, &options, None).unwrap_err();
        assert!(matches!(error, ReportError::Magnification { .. }), "{error}");
    }
    let options = MeshOptions::new("");
    let error = register_figure(&backdrop, &measurement, RemoveRigid::All, &options, Some((1.0, 0.0))).unwrap_err();
    assert!(matches!(error, ReportError::Range { .. }), "{error}");

    let draw = |out: &Path, options: &FigureOptions| draw_frame(out, 1, &measurement, &backdrop, None, options);
    let out = folder().join("refused");
    for line in [[1.0, 1.0, 1.0, 1.0], [0.0, f64::NAN, 1.0, 1.0], [0.0, 0.0, f64::INFINITY, 1.0]] {
        let options = FigureOptions { figures: vec![Figure::Ux], line: Some(line), ..FigureOptions::default() };
        let error = draw(&out, &options).unwrap_err();
        assert!(matches!(error, ReportError::Line(_)), "{error}");
    }
    let options = FigureOptions { figures: vec![Figure::ResidualPercent], ..FigureOptions::default() };
    assert!(matches!(draw(&out, &options).unwrap_err(), ReportError::Percent));
    let file = folder().join("a file");
    std::fs::write(&file, "").unwrap();
    assert!(matches!(draw(&file, &FigureOptions::default()).unwrap_err(), ReportError::Write { .. }));
    for (word, option) in [("uz", "quantity"), ("", "quantity")] {
        assert_eq!(word.parse::<Figure>().unwrap_err().option, option);
    }
    assert_eq!("pdf".parse::<Format>().unwrap_err().option, "format");
    for figure in Figure::ALL {
        assert_eq!(figure.name().parse::<Figure>(), Ok(figure));
        assert!("x".parse::<Figure>().unwrap_err().expected.contains(figure.name()));
    }
}

#[test]
fn figures_of_real_tests_are_small_and_complete() {
    // A tall palette image with a hole, a very wide one, a square one, two zones along a crack.
    type Case<'a> = (&'a str, &'a str, &'a str, usize, &'a [[f64; 4]], [f64; 4]);
    let cases: [Case; 4] = [
        (
            "dicchallenge-s12-openhole",
            "oht_cfrp_00.tiff",
            "oht_cfrp_11.tiff",
            12,
            &[[44.0, 20.0, 350.0, 1020.0]],
            [60.0, 300.0, 340.0, 300.0],
        ),
        (
            "dicchallenge2-star",
            "DIC_Challenge_Star_Noise_Ref.tiff",
            "DIC_Challenge_Star_Noise_Def.tiff",
            16,
            &[[10.0, 10.0, 3990.0, 490.0]],
            [10.0, 250.0, 3980.0, 250.0],
        ),
        (
            "dicchallenge-s05-contrast",
            "Sample5 Reference.tif",
            "Sample5-001 X0.10 Y0.10 N2 C100 R20.tif",
            16,
            &[[16.0, 16.0, 496.0, 496.0]],
            [20.0, 20.0, 480.0, 480.0],
        ),
        (
            "crack-heterogeneous",
            "img_0000 .png",
            "img_0300 .png",
            16,
            &[[320.0, 40.0, 780.0, 590.0], [320.0, 620.0, 780.0, 1180.0]],
            [500.0, 60.0, 500.0, 1150.0],
        ),
    ];
    for (name, reference, deformed, size, zones, line) in cases {
        let Some(images) = data::folder(name) else { continue };
        let load = |file: &str| {
            let path = images.join(file);
            Arc::new(read_image(&path, 0).unwrap_or_else(|e| panic!("{}: {e}", path.display())).image)
        };
        let zones: Vec<Zone> = zones
            .iter()
            .enumerate()
            .map(|(k, &[x0, y0, x1, y1])| Zone::rectangle(format!("strip {k}"), Roi { x0, y0, x1, y1 }))
            .collect();
        let options = Options { element_size: size, drop_textureless: true, ..Options::default() };
        let image = load(reference);
        let correlator = Correlator::new(CpuBackend::default(), image.clone(), &zones, options).unwrap();
        let moved = load(deformed);
        let measurement = correlator.correlate(moved.clone(), None).unwrap().measurement;
        let options = FigureOptions {
            figures: Figure::ALL.to_vec(),
            strain_window: StrainWindow::new(3),
            formats: vec![Format::Png, Format::Svg],
            line: Some(line),
            pixel_size: PixelSize::new(0.0123),
            range_grey: Some(correlator.grey_range()),
            guard_px: vec![3.0; zones.len()],
            notes: vec![format!("reference: {reference}; image: {deformed}")],
            ..FigureOptions::default()
        };
        let out = folder().join(name);
        let begin = std::time::Instant::now();
        let files =
            draw_frame(&out, 1, &measurement, &Backdrop::new(&image, 1), Some(&Backdrop::new(&moved, 1)), &options)
                .unwrap();
        println!("{name}: {} files in {:.1} s", files.len(), begin.elapsed().as_secs_f64());
        for file in files {
            let n = std::fs::metadata(&file).unwrap().len();
            // Up to two pictures of 900 px, whose speckles hardly compress, 0.75 MB each as base64, and a thousand
            // elements.
            assert!(n < 2_500_000, "{}: {n} bytes", file.display());
        }
    }
}

/// What nobody can read of the pictures before it.
const WORDS: &str = r#"<pre id="r">waiting</pre><script>
onload = () => { const n = document.images.length; r.textContent = `${n} pictures: ${JSON.stringify(crowdedPictures(document))}`; };
</script>"#;

#[test]
fn figures_of_a_run_are_drawn_by_name() {
    let desk = Desk::with_series();
    desk.correlate("--roi 16,16,64,80 --roi 66,16,112,80 --pixel-size 0.01 --output out ref.png a.png b.png c.png")
        .fine();
    let ran = desk.run("figures out").fine();
    assert!(ran.stderr.contains("6 pictures of 1 frame"), "{ran}");
    let names = ["exx", "exy", "eyy", "residual", "ux", "uy"];
    assert_eq!(desk.files("out/figures"), names.map(|name| format!("000003-{name}.png")));
    let svg = |name: &str| desk.read(name);

    desk.run(
        "figures out --frames 1,3 --quantity uy,residual-percent,mesh,deformed,register --format svg \
         --line 20,50,110,50 --strain hencky --output drawn --quiet",
    )
    .fine();
    let names = ["deformed", "mesh", "register", "residual-percent-profile", "residual-percent", "uy-profile", "uy"];
    let want: Vec<_> = [1, 3].iter().flat_map(|n| names.map(|name| format!("00000{n}-{name}.svg"))).collect();
    assert_eq!(desk.files("drawn"), want);
    // Frame 1 is `a.png`, shown in its deformed mesh; frames say their files, axes mm.
    assert!(svg("drawn/000001-deformed.svg").contains("image: deformed"));
    assert!(svg("drawn/000001-uy.svg").contains("image a.png"));
    assert!(svg("drawn/000001-uy.svg").contains("x (mm)"));
    assert!(svg("drawn/000003-register.svg").contains("zone 'zone2': moved by (0.7"));
    assert!(svg("drawn/000003-residual-percent.svg").contains("100 % is the range of the reference"));
    desk.run("figures out --quantity deformed,register --magnify 20 --remove-rigid all --format svg --range 0,1")
        .fine();
    assert!(svg("out/figures/000003-deformed.svg").contains("magnified 20 times"));
    assert!(svg("out/figures/000003-register.svg").contains("all zones"));
    desk.run("figures out --quantity exx --strain-on nodes --strain infinitesimal --scale 2 --frames all").fine();
    let small = image::open(desk.path("out/figures/000003-ux.png")).unwrap().width();
    let large = image::open(desk.path("out/figures/000003-exx.png")).unwrap().width();
    assert!(large > 3 * small / 2, "{small} px, {large} px");
    // No two words of a picture lie on one another, and none leaves it.
    let pictures = ["drawn", "out/figures"].into_iter().flat_map(|folder| {
        desk.files(folder).into_iter().map(move |name| format!("{folder}/{name}")).filter(|name| name.ends_with(".svg"))
    });
    let encoded: Vec<String> = pictures.map(|name| STANDARD.encode(desk.read(&name))).collect();
    let images = encoded.iter().map(|text| format!("<img src=\"data:image/svg+xml;base64,{text}\">"));
    let look = format!("{}{WORDS}", images.collect::<String>());
    if let Some(found) = seen(&desk.path(""), &look) {
        assert_eq!(found, format!("{} pictures: []", encoded.len()));
    }
    assert!(desk.path("out/figures/000001-exx.png").exists());
}

#[test]
fn a_run_draws_its_last_frame_itself_when_asked() {
    let desk = Desk::with_series();
    desk.correlate("--roi 16,16,112,80 --figures last --output out ref.png a.png b.png").fine();
    assert_eq!(desk.files("out/figures").len(), 6);
    // Another run takes the place of this one: its pictures must not pass for those of the new.
    desk.write("out/figures/notes.png", "mine");
    desk.correlate("--roi 16,16,112,80 --overwrite --output out ref.png a.png").fine();
    assert_eq!(desk.files("out/figures"), ["notes.png"]);
}

#[test]
fn without_its_reference_a_run_is_drawn_on_white() {
    let desk = Desk::with_series();
    desk.correlate("--roi 16,16,112,80 --output out ref.png a.png b.png").fine();
    let with = {
        desk.run("figures out --quantity ux").fine();
        desk.bytes("out/figures/000002-ux.png")
    };
    // Another image of the same size must not pass for the reference.
    std::fs::copy(desk.path("b.png"), desk.path("ref.png")).unwrap();
    let ran = desk.run("figures out --quantity ux").fine();
    assert!(
        ran.stderr.contains("ref.png: the file has changed since the run; the figures are drawn on white"),
        "{ran}"
    );
    assert_ne!(desk.bytes("out/figures/000002-ux.png"), with);
    for name in ["ref.png", "b.png"] {
        std::fs::remove_file(desk.path(name)).unwrap();
    }
    let ran = desk.run("figures out --quantity ux,deformed --format svg").fine();
    assert!(ran.stderr.contains("ref.png") && ran.stderr.contains("drawn on white"), "{ran}");
    assert!(ran.stderr.contains("b.png") && ran.stderr.contains("drawn on the reference"), "{ran}");
    desk.image("b.png", &uniform(64, 64, 9));
    let ran = desk.run("figures out --quantity deformed").fine();
    assert!(ran.stderr.contains("b.png: the image has 64 x 64 px, the run 128 x 96"), "{ran}");
}

#[test]
fn a_series_is_an_animation_with_the_same_colours_in_all_frames() {
    let desk = Desk::with_series();
    desk.correlate("--roi 16,16,112,80 --no-report --export none --output out ref.png a.png b.png c.png").fine();
    let ran = desk.run("figures out --frames all --quantity uy --format gif,apng").fine();
    assert!(ran.stderr.contains("2 animations of 3 frames: out/figures/uy.gif"), "{ran}");
    assert_eq!(desk.files("out/figures"), ["uy.apng", "uy.gif"]);
    let apng = desk.bytes("out/figures/uy.apng");
    let mut reader = png::Decoder::new(std::io::Cursor::new(&apng)).read_info().unwrap();
    assert_eq!(reader.info().animation_control().unwrap().num_frames, 3);
    // Motions of -0.25, -0.5 and -0.75 px: along the colours from end to end, and never the same picture.
    let mut frames = Vec::new();
    for _ in 0..3 {
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut pixels).unwrap();
        frames.push(pixels);
    }
    assert!(frames[0] != frames[1] && frames[1] != frames[2]);
    // The colour of most pixels of the zone: dark violet at the low end of viridis, yellow at the high end.
    let mean = |frame: &Vec<u8>, c: usize| frame.chunks(3).map(|p| f64::from(p[c]) - f64::from(p[2])).sum::<f64>();
    assert!(mean(&frames[0], 0) > mean(&frames[1], 0) && mean(&frames[1], 1) > mean(&frames[2], 1));
    assert!(desk.bytes("out/figures/uy.gif").starts_with(b"GIF89a"));
}

#[test]
fn a_series_is_a_video_where_ffmpeg_is_there_and_else_it_is_asked_for() {
    let desk = Desk::with_series();
    desk.correlate("--roi 16,16,112,80 --no-report --export none --output out ref.png a.png b.png c.png").fine();
    let words = ["figures", "out", "--frames", "all", "--quantity", "uy", "--format", "mp4,apng"];
    desk.run_with(&[("PATH", "/nowhere")], &words).refused(&["needs the program ffmpeg", "gif or apng"]);
    if std::process::Command::new("ffmpeg").arg("-version").output().is_err() {
        println!("no ffmpeg here: the video is not made");
        return;
    }
    desk.run_words(&words).fine();
    let still =
        image::load_from_memory_with_format(&desk.bytes("out/figures/uy.apng"), image::ImageFormat::Png).unwrap();
    // What a player would see, without compression.
    let played = std::process::Command::new("ffmpeg")
        .args(["-loglevel", "error", "-i", "out/figures/uy.mp4", "-f", "rawvideo", "-pix_fmt", "rgb24", "-"])
        .current_dir(desk.path(""))
        .output()
        .unwrap();
    assert!(played.status.success(), "{}", String::from_utf8_lossy(&played.stderr));
    // Its coding wants even sides.
    let [width, height] = [still.width(), still.height()].map(|side| side.next_multiple_of(2) as usize);
    let frame = 3 * width * height;
    assert_eq!(played.stdout.len() % frame, 0, "{} bytes of {width} x {height}", played.stdout.len());
    let frames: Vec<&[u8]> = played.stdout.chunks(frame).collect();
    assert!(frames.len() >= 3 && frames[0] != frames[frames.len() - 1], "{} frames", frames.len());
    assert!(frames[0][..3].iter().all(|&white| white > 250), "a figure begins with white");
}

#[test]
fn frames_without_a_field_are_named_and_wrong_words_refused() {
    let desk = Desk::with_series();
    desk.write("b.png", "no image");
    desk.correlate("--roi 16,16,112,80 --output out ref.png a.png b.png c.png").incomplete();
    let ran = desk.run("figures out --frames 1-3 --quantity ux").incomplete();
    assert!(ran.stderr.contains("frame 2 has no field: unreadable"), "{ran}");
    assert_eq!(desk.files("out/figures"), ["000001-ux.png", "000003-ux.png"]);
    desk.run("figures out --frames all --quantity ux").fine();
    desk.run("figures out --frames 2 --quiet").refused(&["no frame asked for has a field"]);
    desk.run("figures out --frames 4").refused(&["frame 4", "3"]);
    desk.run("figures out --frames 0").refused(&["'0'"]);
    desk.run("figures out --quantity uz").refused(&["uz", "ux, uy, magnitude, exx"]);
    desk.run("figures out --format pdf").refused(&["pdf", "png or svg"]);
    desk.run("figures out --line 1,2,1,2").refused(&["line"]);
    desk.run("figures out --line 1,2,3").refused(&["3 numbers instead of 4"]);
    desk.run("figures out --quantity deformed --magnify 0").refused(&["magnified 0 times"]);
    desk.run("figures out --range 1,1").refused(&["1 to 1"]);
    desk.run("figures out --scale 9").refused(&["9"]);
    desk.run("figures out --threads 0").refused(&["--threads is 0"]);
    desk.run("figures nowhere").refused(&["nowhere"]);
    desk.write("file", "");
    desk.run("figures out --output file").refused(&["cannot be written", "file"]);
}

/// Width of the sheet of an SVG, mm.
fn width_mm(picture: &Picture) -> f64 {
    let (_, rest) = picture.svg().split_once("width=\"").unwrap();
    rest.split_once("mm\"").expect("a width in millimetres").0.parse().unwrap()
}

#[test]
fn figures_for_a_column_are_84_mm_wide_and_keep_what_is_no_matter_of_the_caption() {
    let image = speckle(300, 200);
    let mut measurement = field(grids(&[[10.0, 10.0, 290.0, 190.0]], 10, 300, 200), |x| [0.01 * x[0], 0.0]);
    measurement.status = Status::IterationLimit;
    let mut marks = vec![ElementMark::None; measurement.mesh.n_elements()];
    (marks[3], marks[40]) = (ElementMark::Misfit, ElementMark::LeftImage);
    measurement.marks = Some(marks);
    let values: Vec<f64> = measurement.displacement.iter().map(|u| u[0]).collect();
    let note = "Strain of Green and Lagrange.";
    let options = MapOptions {
        pixel_size: PixelSize::new(0.01),
        notes: vec![note.into()],
        ..MapOptions::new("Frame 3", "ux (px)")
    };
    let map = |look| nodal_map_on(&Backdrop::made_for(look, &image, 1), &measurement, &values, &options).unwrap();
    let names = ["measured", "the prediction of a model with a long name"];
    let series = names.map(|name| PlotSeries::new(name, Style::Line, vec![0.0, 1.0, 2.0], vec![0.0, 1e4, 3e4]));
    let curve = Plot {
        title: "Frame 3".into(),
        x: Axis::linear("distance along the joint (mm)"),
        y: Axis::linear("T_n (MPa)"),
        series: series.into(),
        notes: vec![note.into()],
        warnings: vec!["not converged: iteration limit reached".into()],
        ..Plot::default()
    };
    let sheet = |picture: &Picture, ratio: u32| (picture.width() / ratio) as i32;
    for (name, screen, column, slide) in [
        ("map", map(Look::Screen), map(Look::Paper), map(Look::Slide)),
        ("curve", curve.draw_for(Look::Screen).unwrap(), curve.draw_for(Look::Paper).unwrap(), {
            curve.draw_for(Look::Slide).unwrap()
        }),
    ] {
        check(&format!("column-{name}"), &column);
        check(&format!("slide-{name}"), &slide);
        // A unit is 0.188 mm: axes of whole units give or take three; a number less beside the map, seven.
        assert!((82.5..84.6).contains(&width_mm(&column)), "{name}: {} mm", width_mm(&column));
        assert!((600..=623).contains(&sheet(&slide, 3)), "{name}: {} units", sheet(&slide, 3));
        let drawn = |picture: &Picture, words: &str| labels(picture).iter().any(|label| label.contains(words));
        assert!(drawn(&screen, "Frame 3") && drawn(&slide, "Frame 3") && !drawn(&column, "Frame 3"), "{name}");
        assert!(drawn(&screen, note) && !drawn(&slide, note) && !drawn(&column, note), "{name}");
        let kept = format!("<desc>{note}</desc>");
        assert!(column.svg().contains(&kept) && slide.svg().contains(&kept) && !screen.svg().contains(&kept), "{name}");
        // What must not be overlooked is no matter of the caption; nobody prints it.
        let of_map = ["hatched: the residual is beyond noise", "left out: 1 "];
        for told in [&["not converged"][..], if name == "map" { &of_map } else { &[] }].concat() {
            for (look, picture) in [("screen", &screen), ("slide", &slide)] {
                assert!(warns(picture) && drawn(picture, told), "{name}, {look}: '{told}' is not drawn");
                assert!(picture.warnings_beside().is_empty(), "{name}, {look}");
            }
            assert!(!warns(&column) && !drawn(&column, told), "{name}: '{told}' is drawn");
            let file = folder().join(format!("column-{name}.svg"));
            column.save(&file).unwrap();
            let beside = std::fs::read_to_string(file.with_extension("warnings.txt")).unwrap();
            assert!(beside.lines().any(|line| line.contains(told)), "{name}: '{told}' in {beside}");
        }
    }
}

/// By `make release-check PARTS=thorough`.
mod thorough {
    use super::*;

    #[test]
    #[ignore = "make release-check PARTS=thorough"]
    fn every_figure_of_every_hard_field_is_whole() {
        for (name, image, measurement) in hard_cases() {
            let options = FigureOptions {
                figures: Figure::ALL.to_vec(),
                strain_window: StrainWindow::new(3),
                formats: vec![Format::Png, Format::Svg],
                line: Some([5.0, 5.0, 100.0, 90.0]),
                pixel_size: PixelSize::new(0.25),
                range_grey: Some(200.0),
                notes: vec!["reference a.tif".into()],
                ..FigureOptions::default()
            };
            let out = folder().join("hard").join(name);
            let (backdrop, white) = (Backdrop::new(&image, 1), Backdrop::blank(image.width(), image.height(), 1));
            for backdrop in if name == "free" { vec![&white, &backdrop] } else { vec![&backdrop] } {
                let files = draw_frame(&out, 3, &measurement, backdrop, None, &options).unwrap();
                assert_eq!(files.len(), 2 * (16 + 13), "{name}");
                for file in files.iter().filter(|file| file.extension().is_some_and(|ending| ending == "svg")) {
                    let png = image::open(file.with_extension("png")).unwrap().into_rgb8();
                    let svg = std::fs::read_to_string(file).unwrap();
                    check_drawing(&format!("{name} {}", file.display()), &svg, png.width(), png.height(), png.as_raw());
                }
            }
        }
    }
}
